"""Proof that no camera within its limits can see a face: it faces solid or an enclosed space.

Serves `cavities`. A closed surface divides space into regions of equal winding number

    w(p) = sum over its faces of their solid angle at p / 4 pi,

and a camera that sees a point is in the region of that point, because no surface is between them.
Where the region in front of a face is solid, or is bounded and within a box that the limits of a
camera exclude, the face is out of reach; no sampling is involved. The argument requires the same
winding number all over the face, that is, that no closed surface crosses it; this is tested.

A. Van Oosterom, J. Strackee. The Solid Angle of a Plane Triangle. 1983.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.camera.projection import box_corners
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.candidates.clearance import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    closed_faces,
    in_solid,
)
from rastercov.placement.candidates.hemicube import LIFT_REL

RIM_WIDTH_REL = 1e-3
"""Relative width of the rim of a face that is left out of the proof, to exclude its neighbours."""
WINDING_TOLERANCE = 1e-6
"""Tolerance of an integer winding number."""


class Enclosure:
    """Closed surfaces of a mesh, for proofs that a face is enclosed.

    Parameters
    ----------
    least : float
        Least distance from a camera centre to the centroid of the face it sees, metres.
    clearance : float
        Least distance from a camera centre to any surface, metres.
    keep_out : sequence of KeepOut
        Boxes and spheres count here, because they are convex; others do not.
    """

    def __init__(
        self, mesh: Mesh, least: float, clearance: float, keep_out: Sequence[KeepOut]
    ) -> None:
        self.mesh, self.least, self.clearance = mesh, least, clearance
        self.keep_out = [v for v in keep_out if isinstance(v, KeepOutBox | KeepOutSphere)]
        self._middle = mesh.bounds.mean(axis=0)
        self._lift = LIFT_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        mesh = mesh.opaque  # targets enclose nothing
        rows = np.flatnonzero(closed_faces(mesh))
        # Sorted by component; those of one are from `_starts` of its number to that of the next.
        _, part = np.unique(mesh.topology.components()[rows], return_inverse=True)
        rows = rows[np.argsort(part, kind="stable")]
        self._starts = np.concatenate(([0], np.cumsum(np.bincount(part))))
        self._corners = mesh.vertices[mesh.faces[rows]] - self._middle
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)
        low, high = (
            (
                end.reduceat(corners, self._starts[:-1])
                for end, corners in ((np.minimum, self._low), (np.maximum, self._high))
            )
            if len(rows)
            else np.empty((2, 0, 3))
        )
        self._boxes = np.stack((low, high), axis=1)

    def proofs(self, faces: IntArray, normals: FloatArray) -> list[str]:
        """Reason for each face why no camera can see it from the side of its normal, or "".

        `faces` is (N,); `normals`, (N, 3), are their own, or the opposite for the back of a
        two-sided face.
        """
        found = [""] * len(faces)
        if not len(self._corners):
            return found
        corners = self.mesh.vertices[self.mesh.faces[faces]] - self._middle
        centres = corners.mean(axis=1)
        raised = centres[:, None] + (1 - RIM_WIDTH_REL) * (corners - centres[:, None])
        raised += self._lift * normals[:, None]
        points = raised.mean(axis=1)
        is_solid = in_solid(self.mesh, points + self._middle)
        for row in range(len(faces)):  # tens of microseconds each
            why = (
                "matter lies on it"
                if is_solid[row]
                else self._closed_space(points[row], centres[row])
            )
            if why and not self._is_crossed(raised[row]):
                found[row] = why
        return found

    def _closed_space(self, point: FloatArray, target: FloatArray) -> str:
        """Reason why no camera can be in a closed space around a point; "" for none."""
        beyond = np.maximum(self._boxes[:, 0] - point, point - self._boxes[:, 1])
        for part in np.flatnonzero(beyond.max(axis=1) <= self._lift):
            if why := self._excluded(self._boxes[part], target):
                corners = self._corners[self._starts[part] : self._starts[part + 1]]
                turns = float(_solid_angles(corners - point).sum()) / (4 * np.pi)
                if round(turns) and abs(turns - round(turns)) <= WINDING_TOLERANCE:
                    return why
        return ""

    def _excluded(self, box: FloatArray, target: FloatArray) -> str:
        """Reason why no camera can be in a closed space within a box, (2, 3); "" for none."""
        ends = box_corners(box)
        deep = float(np.linalg.norm(ends - target, axis=1).max())
        if self.least > deep:
            return (
                f"the closed space before it ends within {deep:.3g} m, and cameras stand "
                f"{self.least:.3g} m away or more"
            )
        narrow = float(np.ptp(box, axis=0).min())
        if self.clearance > narrow / 2:
            return (
                f"the closed space before it is {narrow:.3g} m wide or less, and cameras keep "
                f"{self.clearance:.3g} m from every surface"
            )
        for volume in self.keep_out:
            if volume.contains(ends + self._middle).all():
                return f"keep-out {volume.name} holds the closed space before it"
        return ""

    def _is_crossed(self, triangle: FloatArray) -> bool:
        """True where a face of the closed surfaces cuts a triangle, (3, 3)."""
        near = (self._low <= triangle.max(axis=0)) & (self._high >= triangle.min(axis=0))
        others = self._corners[near.all(axis=1)]
        if not len(others):
            return False
        one = np.broadcast_to(triangle, others.shape)
        return bool(_edges_pierce(one, others).any() or _edges_pierce(others, one).any())


def _solid_angles(corners: FloatArray) -> FloatArray:
    """(N,) signed solid angles of triangles (N, 3, 3) at the origin, steradians."""
    a, b, c = np.moveaxis(corners, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    ab, bc, ca = (np.einsum("ni,ni->n", p, q) for p, q in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    angles: FloatArray = 2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angles


def _edges_pierce(ones: FloatArray, others: FloatArray) -> BoolArray:
    """(N,) mask of triangles (N, 3, 3) with an edge through the interior of their partner."""
    origin, along = others[:, 0], others[:, 1:] - others[:, :1]
    normal = np.cross(along[:, 0], along[:, 1])
    pierces = np.zeros(len(ones), np.bool_)
    for corner in range(3):
        start, end = ones[:, corner], ones[:, (corner + 1) % 3]
        before = np.einsum("ni,ni->n", start - origin, normal)
        after = np.einsum("ni,ni->n", end - origin, normal)
        apart = np.where(before == after, 1.0, before - after)
        where = start + (before / apart)[:, None] * (end - start)
        inside = before * after < 0
        for side in range(3):
            p, q = others[:, side], others[:, (side + 1) % 3]
            inside &= np.einsum("ni,ni->n", np.cross(q - p, where - p), normal) >= 0
        pierces |= inside
    return pierces
