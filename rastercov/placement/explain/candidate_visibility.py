"""Bounds of the greatest visible fraction of each face over all candidates.

Serves `uncovered`. Memory is proportional to the number of faces, not of candidates.
"""

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rastercov.coverage import Coverage, evaluate_batches
from rastercov.criteria import face_geometry
from rastercov.mesh import Mesh
from rastercov.observation import BoundKind
from rastercov.observer import Observer
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.task import Reason, Task

SEEN_NOTHING = 1e-6
"""Visible fraction up to which a face counts as not seen: the bound of computed fractions is 1e-9
for images of 1 px^2 or more, and 1e-9 / area for smaller ones."""
EDGE_ON = 1e-6
"""Square pixels: an image of at most this area is that of a face seen edge-on, which shows
nothing."""
POSES_A_STEP = 1024
"""Candidates processed at a time."""
_FIGURES = ("visibility", "visibility_bound", "visibility_kind", "drawn_pixels", "reason")
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
    """

    def __init__(self, n_faces: int, chosen: BoolArray) -> None:
        self.chosen, self.faces = chosen, np.flatnonzero(chosen)
        self.low, self.high = np.zeros(n_faces), np.zeros(n_faces)
        self.covering: IntArray = np.zeros(n_faces, np.int64)

    def add(self, batch: Coverage) -> None:
        """Add a batch of candidates."""
        if not len(batch.pose_ids):
            return
        value, bound = (a[:, self.faces] for a in (batch.visibility, batch.visibility_bound))
        low = (value - bound).max(axis=0).clip(0, 1)
        is_edge_on = batch.drawn_pixels[:, self.faces] <= EDGE_ON
        is_edge_on &= batch.visibility_kind[:, self.faces] != BoundKind.STATISTICAL
        high = np.where(is_edge_on, 0.0, value + bound).max(axis=0).clip(0, 1)
        self.low[self.faces] = np.maximum(self.low[self.faces], low)
        self.high[self.faces] = np.maximum(self.high[self.faces], high)
        self.covering[self.faces] += (batch.reason[:, self.faces] == Reason.COVERED).sum(axis=0)

    def claims(self, n_candidates: int) -> NDArray[np.uint8]:
        """(F,) `Sight` of the faces, for a number of candidates."""
        claim = np.full(len(self.low), Sight.UNKNOWN, np.uint8)
        if n_candidates:
            claim[self.chosen & (self.high <= SEEN_NOTHING)] = Sight.NONE
            claim[self.chosen & (self.low > SEEN_NOTHING)] = Sight.SOME
        return claim


def batches_in_view(
    observer: Observer, poses: FloatArray, task: Task, chosen: BoolArray
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
        facing = np.empty(len(block), np.bool_)
        for row, pose in enumerate(block):  # a tenth of a millisecond for a hundred faces
            seen = face_geometry(part, observer.camera, pose)
            in_image = (seen.in_view_fraction > 0) | seen.in_view
            facing[row] = bool((seen.is_front & in_image).any())
        rows = np.flatnonzero(facing)
        if not len(rows):
            continue
        for batch in evaluate_batches(observer, block[rows], task, fields=_FIGURES):
            last = batch.pose_ids[-1] if len(batch.pose_ids) else -1
            yield batch, start + int(rows[last]) + 1
