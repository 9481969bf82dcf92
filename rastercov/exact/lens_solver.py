"""Exact visible areas in the image of any lens: seen in ideal planes, measured in the image.

A lens bends lines and hides nothing: what is in front of what is decided on each ray. So visibility
is computed in pinholes that together see the valid region of the lens (`camera.lenses.planes`),
and the faces and their visible pieces are mapped to pixels, where their areas are integrals along
their edges (`rastercov.kernels.lens_edges`).
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import planes_of
from rastercov.exact.half_planes import HalfPlaneSolver, room_for_kept
from rastercov.kernels import exact_lens as kernels
from rastercov.kernels.direct import DirectCalls
from rastercov.kernels.exact_lens import edge_bulges, edge_lists, vertex_images, whole_groups
from rastercov.kernels.exact_records import SPARE_ENTRIES, Edges
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.lens_polygons import bulges_by_parts, edge_scratch, measure_polygons
from rastercov.kernels.raster_memory import aligned_zeros

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BESIDE_REL = 1e-9
"""Distance of a surface from the side of a plane's image, relative to its own, that is no rounding.
"""


Visit = Callable[[int, HalfPlaneSolver], None]


class LensSolver:
    """Exact visible areas in the images of lenses, one pose at a time, with memory for one thread.

    Parameters
    ----------
    solver : HalfPlaneSolver
        Solver of the surface in the ideal planes; it keeps its pieces from now on.

    Attributes
    ----------
    area, visible, area_error : (F,) float64
        As of `HalfPlaneSolver`, px^2 in the image of the lens.
    is_certified : (F,) bool
        Faces known to be wholly visible or wholly hidden.
    """

    def __init__(self, solver: HalfPlaneSolver) -> None:
        solver.keep_pieces()
        surface = solver.surface
        n = surface.n_faces
        self.surface, self._solver, self._call = surface, solver, DirectCalls()
        self.figures = kernels.Figures(*np.empty((3, n)), *np.empty((3, n), np.int8))
        self.area, self.visible, self.area_error = self.figures[:3]
        self.is_certified = np.zeros(n, np.bool_)
        self._sides = whole_groups(directed_sides(surface.faces, surface.edges))
        self._faces = whole_groups(surface.faces)
        self._ends, self._lists = whole_groups(surface.edges.vertices), edge_lists()
        self._longer = np.empty(len(self._ends), np.int32)
        n_vertices = -(-len(surface.vertices) // kernels.AT_A_TIME) * kernels.AT_A_TIME
        places = aligned_zeros((n_vertices, 4), np.float64)
        is_inside, bulge = np.empty(n_vertices, np.bool_), np.empty(len(self._ends))
        self._seen = kernels.Seen(places, is_inside, bulge, len(surface.faces))
        self._is_done = np.empty(n + SPARE_ENTRIES, np.bool_)
        self._own, self._own_error = np.empty((2, n + SPARE_ENTRIES))
        self._scratch = kernels.scratch()
        self._found = room_for_kept(1024, 8192)
        self._measured, self._edges = np.empty((1024, 2)), edge_scratch()
        flat: NDArray[np.bool_] = surface.flat
        self._vertices: FloatArray = surface.vertices
        if surface.targets is not None:
            flat = np.concatenate((surface.flat, surface.targets.flat))
            self._vertices = np.concatenate((surface.vertices, surface.targets.vertices))
        self._flat = np.pad(flat, (0, SPARE_ENTRIES))
        ends = np.stack((self._vertices.min(axis=0), self._vertices.max(axis=0)))
        self._box = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(8, 3)

    def write_to(self, visible: FloatArray, area: FloatArray, area_error: FloatArray) -> bool:
        """As of `HalfPlaneSolver`."""
        if self.surface.place is not None:
            return False
        self.area, self.visible, self.area_error = area, visible, area_error
        self.figures = kernels.Figures(area, visible, area_error, *self.figures[3:])
        return True

    def solve(
        self,
        camera: Camera,
        pose: FloatArray,
        near: float,
        front_only: bool,
        visit: Visit | None = None,
        *,
        is_measured: bool = True,
    ) -> None:
        """Compute all figures of every face through a lens.

        Parameters
        ----------
        camera : Camera
        pose, near, front_only
            As for `HalfPlaneSolver.set_pose`.
        visit : callable, optional
            Called with each plane by its number, in the order of `planes_of`, and its solver.
        is_measured : bool
            False where the figures are not needed.
        """
        for array in self.figures:
            array[:] = 0
        solved: FloatArray | None = None
        for index, (plane, record) in enumerate(planes_of(camera)):
            turned = pose.copy()
            turned[:3, :3] = pose[:3, :3] @ plane.frame
            is_seen = self._may_see(turned, plane.camera, record)
            if visit is None and not is_seen:
                continue
            if solved is None or not np.array_equal(plane.frame, solved):
                self._solver.solve_pose(plane.camera, turned, near, front_only)
                solved = plane.frame
            if visit is not None:
                visit(index, self._solver)
            if is_measured and is_seen:
                self._measure(record)
        largest = 2.0 * camera.width * camera.height
        self._call(kernels.settle, self.figures, largest, self.is_certified)

    def _may_see(self, pose: FloatArray, camera: Camera, record: PlaneRecord) -> bool:
        """False where the image shows nothing of a plane, or all of the surface is beside it.

        That is behind the plane, or beyond one side of its image; a box decides in most cases.
        """
        if len(record.window) == 0:
            return False
        sides = sides_of(camera)
        normals = np.ascontiguousarray(sides @ pose[:3, :3].T)
        margin = BESIDE_REL * (1 + np.abs(sides[1:, 2]).max())
        return not any(
            self._call(kernels.are_beyond, points, pose[:3, 3].copy(), normals, margin)
            for points in (self._box, self._vertices)
        )

    def _measure(self, record: PlaneRecord) -> None:
        """Add the images of all faces and pieces in one plane."""
        solver, seen, lists = self._solver, self._seen, self._lists
        projected, kept = solver.image_of_all, solver.kept_pieces
        n_vertices = len(self.surface.vertices)
        own, is_done, uvw = self._own, self._is_done, projected.uvw[:n_vertices]
        places, edges = seen.places, self._ends
        self._call(vertex_images, uvw, record, places, seen.is_inside, lists)
        n_longer = self._call(edge_bulges, record, edges, places, lists, seen.bulge, self._longer)
        if n_longer:
            longer = self._longer[:n_longer]
            self._call(bulges_by_parts, record, longer, edges, places, self._edges, seen.bulge)
        self._call(
            kernels.measure_simple,
            self._faces, self._sides, self._flat, projected.state, seen, record, own,
            self._own_error, is_done, self.figures,
        )  # fmt: skip
        while True:
            found = self._found
            n_outlines = self._call(
                kernels.collect,
                self._vertices, is_done, projected, kept, solver.camera, record, self._scratch,
                found,
            )  # fmt: skip
            n, corners, is_short = found.used.tolist()
            if not is_short:
                break
            self._found = room_for_kept(n * 5 // 4, corners * 5 // 4)
        if len(self._measured) < n:
            self._measured = np.empty((n * 5 // 4, 2))
        images = self._measured[:n]
        self._call(measure_polygons, record, found.corners, found.starts, self._edges, images)
        pinhole = solver.visible, solver.area_error, solver.is_certified
        self._call(
            kernels.add_areas,
            found, n_outlines, images, projected, kept, pinhole, record, own, self.figures,
        )  # fmt: skip


@lru_cache(maxsize=64)
def sides_of(pinhole: Camera) -> FloatArray:
    """(5, 3) inner normals of a plane, and of the four sides of its image, in units of it."""
    left, top = -pinhole.cx / pinhole.fx, -pinhole.cy / pinhole.fy
    right, bottom = left + pinhole.width / pinhole.fx, top + pinhole.height / pinhole.fy
    return np.array([(0, 0, 1), (1, 0, -left), (-1, 0, right), (0, 1, -top), (0, -1, bottom)])


def directed_sides(faces: IntArray, edges: Edges) -> IntArray:
    """(O, 3) edge e from each corner of a face to the next, ~e where it runs backwards."""
    is_forward = edges.vertices[edges.of_face, 0] == faces
    sides = np.where(is_forward, edges.of_face, ~edges.of_face)
    return np.ascontiguousarray(sides.astype(np.int32))
