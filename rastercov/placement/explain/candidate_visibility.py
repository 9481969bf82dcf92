"""What all candidates together see of some faces, and what of that is proved.

Serves `leftover`. Figures of visibility have bounds, so that over all candidates the greatest
visible fraction of a face lies between two numbers. Memory goes with faces, not with candidates.
"""

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rastercov.coverage import Coverage, Reason, Task, evaluate_batches
from rastercov.criteria import view_faces
from rastercov.mesh import Mesh
from rastercov.observer import Kind, Observer

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

SEEN_NOTHING = 1e-6
"""Part of a face's image up to which it counts as not seen: the bound of computed figures is 1e-9
for images of 1 px^2 or more, and in proportion for smaller ones."""
EDGE_ON = 1e-6
"""Square pixels: a computed image no larger than this is that of a face seen from its edge, which
shows nothing."""
POSES_A_STEP = 1024
"""Candidates looked through at a time."""


class Sight(IntEnum):
    """What is proved about all candidates and a face."""

    NONE = 0
    """None of them sees it: of its image at most `SEEN_NOTHING` is in view in any, or it has no
    more than `EDGE_ON`."""
    UNKNOWN = 1
    """The bounds allow neither claim, or there were no candidates."""
    SOME = 2
    """One of them sees some of it."""


class Sights:
    """What candidates see of some faces, added up batch by batch; arrays are (F,).

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
        """Take in the next candidates."""
        if not len(batch.pose_ids):
            return
        value, bound = (a[:, self.faces] for a in (batch.visibility, batch.visibility_bound))
        low = (value - bound).max(axis=0).clip(0, 1)
        is_edge_on = batch.drawn_pixels[:, self.faces] <= EDGE_ON
        is_edge_on &= batch.visibility_kind[:, self.faces] != Kind.STATISTICAL
        high = np.where(is_edge_on, 0.0, value + bound).max(axis=0).clip(0, 1)
        self.low[self.faces] = np.maximum(self.low[self.faces], low)
        self.high[self.faces] = np.maximum(self.high[self.faces], high)
        self.covering[self.faces] += (batch.reason[:, self.faces] == Reason.COVERED).sum(axis=0)

    def claims(self, n_candidates: int) -> NDArray[np.uint8]:
        """(F,) `Sight` of the faces, of so many candidates."""
        claim = np.full(len(self.low), Sight.UNKNOWN, np.uint8)
        if n_candidates:
            claim[self.chosen & (self.high <= SEEN_NOTHING)] = Sight.NONE
            claim[self.chosen & (self.low > SEEN_NOTHING)] = Sight.SOME
        return claim


def batches_in_view(
    observer: Observer, poses: FloatArray, task: Task, chosen: BoolArray
) -> Iterator[tuple[Coverage, int]]:
    """Batches of candidates that have one of some faces in view, and how many are looked through.

    All others see nothing of these faces, by definition: they look at their backs, or past them.
    """
    if not chosen.any():
        return
    mesh = observer.mesh
    used, corners = np.unique(mesh.faces[chosen], return_inverse=True)
    # The bounds of a part are smaller and its near limit nearer: it misses nothing.
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
            seen = view_faces(part, observer.camera, pose)
            in_image = (seen.in_view_fraction > 0) | seen.in_view
            facing[row] = bool((seen.is_front & in_image).any())
        rows = np.flatnonzero(facing)
        if not len(rows):
            continue
        for batch in evaluate_batches(observer, block[rows], task):
            last = batch.pose_ids[-1] if len(batch.pose_ids) else -1
            yield batch, start + int(rows[last]) + 1
