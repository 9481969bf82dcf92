"""Bounds of the greatest visible fraction of each face over all candidates.

Serves `uncovered`. Memory is proportional to the number of faces, not of candidates.
"""

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.pose import Poses, renumbered
from rastercov.coverage.coverage import Coverage, evaluate_batches
from rastercov.coverage.face_pass import faces_in_view
from rastercov.coverage.observer import Observer
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, IntArray

SEEN_NOTHING = 1e-6
"""Visible fraction up to which a face counts as not seen: the bound of computed fractions is 1e-9
for images of 1 px^2 or more, and 1e-9 / area for smaller ones."""
EDGE_ON = 1e-6
"""Square pixels: an image of at most this area is that of a face seen edge-on, which shows
nothing."""
POSES_A_STEP = 1024
"""Candidates processed at a time."""
FIGURES = ("visibility", "visibility_bound", "visibility_kind", "drawn_pixels", "reason")
"""Figures that `CandidateBounds` takes."""


class Sight(IntEnum):
    """Proved statement on all candidates and a face."""

    NONE = 0
    """No candidate sees it: at most `SEEN_NOTHING` of its image is visible in each, or the image is
    at most `EDGE_ON`."""
    UNKNOWN = 1
    """The bounds prove neither, or there are no candidates."""
    SOME = 2
    """A candidate sees a part of it."""


class CandidateBounds:
    """Bounds of the visible fraction of some faces, updated batch by batch; arrays are (F,).

    Attributes
    ----------
    low, high : float64
        Bounds of the greatest visible fraction.
    covering : int64
        Candidates that cover the face.
    n_poses : int
        Candidates so far.
    """

    def __init__(self, n_faces: int, chosen: BoolArray) -> None:
        self.chosen, self.n_poses = chosen, 0
        self.low, self.high = np.zeros(n_faces), np.zeros(n_faces)
        self.covering: IntArray = np.zeros(n_faces, np.int64)

    def add(self, batch: Coverage) -> None:
        """Add a batch of candidates."""
        from rastercov.base.memory import read_only
        from rastercov.kernels.placement_candidates import add_bounds

        arrays = (getattr(batch, name) for name in FIGURES)
        figures = (read_only(array, array.dtype.type) for array in arrays)
        chosen = read_only(self.chosen, np.bool_)
        add_bounds(*figures, EDGE_ON, chosen, self.low, self.high, self.covering)
        self.n_poses += len(batch.pose_ids)

    def of(self, chosen: BoolArray) -> "CandidateBounds":
        """The same for fewer faces."""
        part = CandidateBounds(len(chosen), chosen)
        part.n_poses = self.n_poses
        for name in ("low", "high", "covering"):
            getattr(part, name)[chosen] = getattr(self, name)[chosen]
        return part

    def claims(self, n_candidates: int) -> NDArray[np.uint8]:
        """(F,) `Sight` of the faces, for a number of candidates."""
        claim = np.full(len(self.low), Sight.UNKNOWN, np.uint8)
        if n_candidates:
            claim[self.chosen & (self.high <= SEEN_NOTHING)] = Sight.NONE
            claim[self.chosen & (self.low > SEEN_NOTHING)] = Sight.SOME
        return claim


def batches_in_view(
    observer: Observer, poses: Poses, task: Task, chosen: BoolArray
) -> Iterator[tuple[Coverage, int]]:
    """Batches of candidates with one of the chosen faces in view, and the number processed so far.

    The other candidates see none of these faces, by definition: they are behind them, or the faces
    are outside their images.
    """
    if not chosen.any():
        return
    mesh = observer.mesh
    used, corners = np.unique(mesh.faces[chosen], return_inverse=True)
    # The bounds of a part are smaller and its near limit nearer: conservative.
    part = Mesh(
        vertices=mesh.vertices[used],
        faces=corners.reshape(-1, 3),
        groups=mesh.groups,
        face_group=mesh.face_group[chosen],
    )
    for start in range(0, len(poses), POSES_A_STEP):
        block = poses[start : start + POSES_A_STEP]
        rows = np.flatnonzero(faces_in_view(part, observer.camera, block).any(axis=1))
        if not len(rows):
            continue
        for batch in evaluate_batches(observer, renumbered(block[rows]), task, fields=FIGURES):
            last = batch.pose_ids[-1] if len(batch.pose_ids) else -1
            yield batch, start + int(rows[last]) + 1
