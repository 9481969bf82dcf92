"""Faces that touch or cut another face: once for a mesh, whatever the camera.

Serves the certificate, where one point of a face speaks for the whole face only if no other face
cuts it or lies on it, and `Mesh.can_cull_back_faces`, because a closed surface that cuts itself can
show its back. Conservative: a false positive costs time, a false negative would break both. Boxes
in a tree find the pairs, separating axes decide over each; `contact_kernels` has both.
"""

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov._once import Once
from rastercov.mesh import contact_kernels as kernels
from rastercov.mesh.arrays import blocks, normals_and_areas
from rastercov.mesh.topology import first_equal_row

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAST_TOLERANCE = 1e-12
"""Of the bounding box' diagonal: 200 times what rounding does to a distance."""
SLACK = 1.01
"""Covers that rounding where the tolerance is the least."""
STEPS_A_CALL = 20_000
"""Steps along the tree before a compiled loop returns: a few milliseconds, or a second when many
faces meet in one place."""
LEAVES_A_TURN = 2048
"""Leaves that a thread takes at a time."""
SAMPLE = 4096
"""Faces, at most, on which two frames for the boxes are compared."""
CONTACT = 1e-8
"""Of the diagonal of the bounding box: faces that come closer than this are in contact."""
REACH = 30.0
"""Diagonals from which `CONTACT` is too little: from farther away, surfaces that are farther apart
than that are still at equal depth to within `analytic_kernels.TIE`."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """Faces of a mesh in contact with another, worked out when first asked for.

    Parameters
    ----------
    vertices : (V, 3) float64
        Metres.
    faces : (F, 3) int
        Vertex indices.
    degenerate_mask : (F,) bool
        Faces without area, which touch nothing.
    diagonal : float
        Of the bounding box, metres.
    components : callable
        Gives the (F,) number of each face's edge-connected component.
    """

    vertices: FloatArray
    faces: NDArray[np.integer[Any]]
    degenerate_mask: NDArray[np.bool_]
    diagonal: float
    components: Callable[[], NDArray[np.integer[Any]]]
    _known: dict[tuple[int, bool], Once[NDArray[np.bool_]]] = field(
        default_factory=dict, init=False
    )

    @property
    def reach(self) -> float:
        """Distance of cameras up to which one answer holds for all, metres."""
        return REACH * self.diagonal

    def faces_for(self, distance: float = 0.0) -> NDArray[np.bool_]:
        """(F,) faces in contact, for cameras with no surface beyond `distance`, metres."""
        return self._faces(self._decade(distance), within=False)

    def faces_within_components(self, distance: float = 0.0) -> NDArray[np.bool_]:
        """(F,) faces in contact with one of their own edge-connected component; see `faces_for`."""
        decade = self._decade(distance)
        any_contact = self._faces(decade, within=False)
        return self._faces(decade, within=True) if any_contact.any() else any_contact

    def _decade(self, distance: float) -> int:
        far = distance / self.reach if self.diagonal > 0 else 1.0
        return max(0, math.ceil(math.log10(max(far, 1.0))))

    def _faces(self, decade: int, within: bool) -> NDArray[np.bool_]:
        return self._known.setdefault((decade, within), Once()).get(
            lambda: touching_faces(
                self.vertices, self.faces, CONTACT * 10**decade * self.diagonal,
                degenerate_mask=self.degenerate_mask,
                labels=self.components() if within else None,
            )
        )  # fmt: skip


def touching_faces(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]],
    tolerance: float,
    *,
    degenerate_mask: NDArray[np.bool_] | None = None,
    labels: NDArray[np.integer[Any]] | None = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """Faces that another face comes within `tolerance` of, other than where the two are joined.

    Two faces are joined at the corners that lie on the same point, whatever their indices:

    - none: they touch when their distance is at most `tolerance`;
    - one: when the edge opposite to it in one face is within `tolerance` of the other face;
    - two: when the gap between them, at the height of the lower apex over the common edge, is at
      most `tolerance`, as when they are folded onto each other;
    - three: always.

    No touching face is missed, and none that meets another anywhere but in their joint: what two
    triangles have in common is convex, so it reaches one of the places above. Rounding hides none:
    it is below 5e-15 of the bounding box' diagonal, and `tolerance` is raised to 1e-12 of that at
    least, and by 1 %. A face may be marked at a larger distance, where two corners are nearest to
    each other: the separating axes, which do not look from corner to corner, see less than that.

    Parameters
    ----------
    vertices : (V, 3) float64
        Finite, at most 1e30 in magnitude.
    faces : (F, 3) int
        Vertex indices.
    tolerance : float
        In the units of the vertices; at least 0.
    degenerate_mask : (F,) bool, optional
        Faces without area, as `Mesh.degenerate_mask`: they touch nothing. Computed when not given.
    labels : (F,) int, optional
        Only faces with the same label can touch.
    threads : int, optional
        Loops that run side by side; one for each core unless given. The answer is the same.

    Returns
    -------
    (F,) bool
        Time grows with F log F and the number of pairs whose boxes overlap.

    Raises
    ------
    ValueError
        `tolerance` is negative or not a number.
    """
    if not tolerance >= 0:
        raise ValueError(f"tolerance must be at least 0, got {tolerance}")
    touching = np.zeros(len(faces), dtype=bool)
    if degenerate_mask is None:
        degenerate_mask = ~np.any(normals_and_areas(vertices, faces)[0], axis=1)
    chosen = np.flatnonzero(~degenerate_mask)
    if len(chosen) < 2:
        return touching
    vertices = np.ascontiguousarray(vertices, dtype=np.float64) + 0.0  # -0.0 + 0.0 is 0.0
    whole = np.int32 if len(vertices) < 2**31 else np.int64
    position: NDArray[Any] = first_equal_row(vertices.view(np.uint64)).astype(whole)
    corners = _corners(position, faces, chosen)
    low, high = _bounds(vertices, corners)
    extent = math.hypot(*(high - low))  # whose squares may under- and overflow
    scale = 1 / max(extent, 1e-300)  # the inverse of a smaller number can be infinite
    reach = SLACK * max(float(tolerance), LEAST_TOLERANCE * extent) * scale
    placed = (np.clip(vertices, low, high) - (low + high) / 2) * scale
    placed = placed @ _frame(placed, corners)
    keys = np.empty(len(corners), np.uint64)
    kernels.order_keys(placed, corners, keys)
    chosen = chosen[np.argsort(keys)]
    del keys, corners  # large, and no longer in order
    corners = _corners(position, faces, chosen)
    names = np.empty(0, np.int32) if labels is None else labels[chosen].astype(np.int32)
    marks = _marks(vertices, scale, placed, corners, names, reach, threads)
    touching[chosen[marks]] = True
    return touching


def _corners(
    position: NDArray[Any], faces: NDArray[np.integer[Any]], chosen: IntArray
) -> NDArray[np.int32]:
    """(N, 3) vertices of the chosen faces, the same one for all at the same point."""
    corners = np.empty((len(chosen), 3), position.dtype)
    for block in blocks(len(chosen)):
        corners[block] = position[faces[chosen[block]]]
    return corners


def _bounds(vertices: FloatArray, corners: NDArray[np.int32]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates of the vertices that faces use."""
    is_used = np.zeros(len(vertices), dtype=bool)
    is_used[corners] = True
    used = vertices if is_used.all() else vertices[is_used]
    return used.min(axis=0), used.max(axis=0)


def _frame(placed: FloatArray, corners: NDArray[np.int32]) -> FloatArray:
    """(3, 3) rotation that makes boxes small: none, or one along the directions of the edges.

    A needle across the axes has a box that overlaps those of all needles beside it; a part whose
    needles run alike, like a cylinder, is turned until they run along an axis.
    """
    points = placed[corners[:: -(-len(corners) // SAMPLE)]]
    edges = (np.roll(points, -1, axis=1) - points).reshape(-1, 3)
    length = np.linalg.norm(edges, axis=1)
    weighted = edges / np.sqrt(np.where(length > 0, length, 1))[:, None]
    turned = np.linalg.eigh(weighted.T @ weighted)[1]
    still = np.eye(3)
    return turned if _box_area(points @ turned) < 0.5 * _box_area(points) else still


def _box_area(points: FloatArray) -> float:
    """Surface of the boxes of (N, 3, 3) triangles."""
    x, y, z = np.ptp(points, axis=1).T
    return float((x * y + y * z + z * x).sum())


def _marks(
    vertices: FloatArray,
    scale: float,
    placed: FloatArray,
    corners: NDArray[np.int32],
    labels: NDArray[np.int32],
    reach: float,
    threads: int | None,
) -> NDArray[np.bool_]:
    """(N,) which of the faces touch; they come in the order of their keys."""
    last = -(-len(corners) // kernels.LEAF)
    n_nodes = 2 << max((last - 1).bit_length(), 1)
    boxes, nodes = np.empty((len(corners), 6), np.float32), np.empty((n_nodes, 6), np.float32)
    done, marks = np.empty(n_nodes, dtype=bool), np.zeros(len(corners), dtype=bool)
    kernels.grow_boxes(placed, corners, boxes, nodes, done)
    turns = [(start, min(start + LEAVES_A_TURN, last)) for start in range(0, last, LEAVES_A_TURN)]
    stopped = threading.Event()

    def work(_: int) -> None:
        try:
            while turns:
                try:
                    start, end = turns.pop()
                except IndexError:  # another thread took the last one
                    return
                while start < end and not stopped.is_set():
                    start = kernels.mark_contacts(
                        vertices, scale, placed, corners, labels, boxes, nodes, done, reach, start,
                        end, STEPS_A_CALL, marks,
                    )  # fmt: skip
        finally:
            turns.clear()  # empty already, unless something went wrong: then all stop

    n_threads = min(threads or len(os.sched_getaffinity(0)), len(turns))
    if n_threads == 1:
        work(0)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            try:
                list(pool.map(work, range(n_threads)))
            finally:
                turns.clear()  # an interrupt comes here, and ends the threads after their call
                stopped.set()
    return marks
