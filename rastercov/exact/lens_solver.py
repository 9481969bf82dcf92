"""Exact visible areas in the image of any lens: seen in ideal planes, measured in the image.

A lens bends lines and hides nothing: what is in front of what is decided on each ray. So visibility
is computed in pinholes that together see the valid region of the lens (`camera.lenses.planes`),
and the faces and their visible pieces are mapped to pixels, where their areas are integrals along
their edges (`lens/edges.hpp`).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import FloatArray, Int32Array
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import planes_of
from rastercov.camera.lenses.records import PlaneRecord
from rastercov.exact.half_planes import HalfPlaneSolver, room_for_kept
from rastercov.exact.records import Edges
from rastercov.exact.surface import Surface
from rastercov.native import exact_lens as native
from rastercov.native.exact_lens import edge_bulges, vertex_images
from rastercov.native.lens_polygons import bulges_by_parts, measure_polygons

BESIDE_REL = 1e-9
"""Distance of a surface from the side of a plane's image, relative to its own, that is no rounding.
"""


Visit = Callable[[int, HalfPlaneSolver], None]


class Figures(NamedTuple):
    """Sums over the planes of a camera, (F,): areas, px^2, and planes by the kind of their figure.

    `n_certified` counts planes with a certified figure, `n_visible` those of them in which the face
    is visible, `n_computed` the others that show it.
    """

    area: FloatArray
    visible: FloatArray
    area_error: FloatArray
    n_certified: NDArray[np.int8]
    n_visible: NDArray[np.int8]
    n_computed: NDArray[np.int8]


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
        self._solver = solver
        self.figures = Figures(*np.empty((3, n)), *np.empty((3, n), np.int8))
        self.area, self.visible, self.area_error = self.figures[:3]
        self.is_certified = np.zeros(n, np.bool_)
        self._sides = directed_sides(surface.faces, surface.edges)
        n_vertices, n_edges = len(surface.vertices), len(surface.edges.vertices)
        self._places, self._is_inside = np.empty((n_vertices, 4)), np.empty(n_vertices, np.bool_)
        self._bulge, self._longer = np.empty(n_edges), np.empty(n_edges, np.int32)
        self._is_done, self._own = np.empty(n, np.bool_), np.empty(n)
        self._found, self._measured = room_for_kept(1024, 8192), np.empty((1024, 2))
        flat: NDArray[np.bool_] = surface.flat
        if surface.targets is not None:
            flat = np.concatenate((surface.flat, surface.targets.flat))
        self._flat = flat
        self.set_surface(surface)

    def set_surface(self, surface: Surface) -> None:
        """As of `HalfPlaneSolver`."""
        self.surface = surface
        self._vertices: FloatArray = surface.vertices
        if surface.targets is not None:
            self._vertices = np.concatenate((surface.vertices, surface.targets.vertices))
        ends = np.stack((self._vertices.min(axis=0), self._vertices.max(axis=0)))
        self._box = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(8, 3)

    def write_to(self, visible: FloatArray, area: FloatArray, area_error: FloatArray) -> bool:
        """As of `HalfPlaneSolver`."""
        if self.surface.place is not None:
            return False
        self.area, self.visible, self.area_error = area, visible, area_error
        self.figures = Figures(area, visible, area_error, *self.figures[3:])
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
        native.settle(self.figures, largest, self.is_certified)

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
            native.are_beyond(points, pose[:3, 3].copy(), normals, margin)
            for points in (self._box, self._vertices)
        )

    def _measure(self, record: PlaneRecord) -> None:
        """Add the images of all faces and pieces in one plane."""
        solver, figures = self._solver, self.figures
        projected, kept = solver.image_of_all, solver.kept_pieces
        own, is_done, places, bulge = self._own, self._is_done, self._places, self._bulge
        faces, edges = self.surface.faces, self.surface.edges.vertices
        vertex_images(projected.uvw[: len(places)], record, places, self._is_inside)
        n_longer = edge_bulges(record, edges, places, bulge, self._longer)
        if n_longer:
            bulges_by_parts(record, self._longer[:n_longer], edges, places, bulge)
        native.measure_simple(
            faces, self._sides, self._flat, projected.state, places, bulge, record, own, is_done,
            figures,
        )  # fmt: skip
        while True:
            found = self._found
            n_outlines = native.collect(
                self._vertices, is_done, projected, kept, solver.camera, record, found
            )
            n, corners, is_short = found.used.tolist()
            if not is_short:
                break
            self._found = room_for_kept(n * 5 // 4, corners * 5 // 4)
        if len(self._measured) < n:
            self._measured = np.empty((n * 5 // 4, 2))
        images = self._measured[:n]
        measure_polygons(record, found.corners, found.starts, images)
        native.add_areas(
            found, n_outlines, images, projected, kept, solver.visible, solver.area_error,
            solver.is_certified, record, own, figures,
        )  # fmt: skip


@lru_cache(maxsize=64)
def sides_of(pinhole: Camera) -> FloatArray:
    """(5, 3) inner normals of a plane, and of the four sides of its image, in units of it."""
    left, top = -pinhole.cx / pinhole.fx, -pinhole.cy / pinhole.fy
    right, bottom = left + pinhole.width / pinhole.fx, top + pinhole.height / pinhole.fy
    return np.array([(0, 0, 1), (1, 0, -left), (-1, 0, right), (0, 1, -top), (0, -1, bottom)])


def directed_sides(faces: Int32Array, edges: Edges) -> Int32Array:
    """(O, 3) edge e from each corner of a face to the next, ~e where it runs backwards."""
    is_forward = edges.vertices[edges.of_face, 0] == faces
    sides = np.where(is_forward, edges.of_face, ~edges.of_face)
    return np.ascontiguousarray(sides.astype(np.int32))
