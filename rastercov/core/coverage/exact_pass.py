"""Pass over poses by the exact methods: the engine's solvers, and the arrays that they fill."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rastercov.base import BoolArray, ByteArray, FloatArray, Int32Array, IntArray, thread_count
from rastercov.core.camera import Cameras, Poses, Rig, cameras_of
from rastercov.core.camera.pose import engine_camera
from rastercov.core.camera.rig import shared_rows
from rastercov.core.coverage.task import Engine
from rastercov.core.exact.surface import surface_of
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import Observation
from rastercov.engine import solver_visibility

Found = TypeVar("Found")


def room_for(n_poses: int, n_faces: int) -> Observation:
    """Memory for the figures of some poses.

    Not one array of three: the allocator uses memory of less than 32 MiB again, where fresh pages
    take a tenth of the time of a large pose.
    """
    shape = n_poses, n_faces
    kind, clipped = np.empty(shape, np.uint8), np.empty(n_poses, bool)
    return Observation(np.empty(shape), np.empty(shape), kind, np.empty(shape), clipped)


NOTHING = (
    *(np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0), np.uint8), np.empty((0, 0))),
    np.empty(0, bool),
)
"""Figures where none are asked for."""


Figures = tuple[FloatArray, FloatArray, ByteArray, FloatArray, BoolArray]
"""Visible and drawn area, kind and error of each pair, and poses that are clipped."""


class PlacedPoses(NamedTuple):
    """Poses for the engine, which computes `rows`; `turns` are the rows of the result of each.

    A fixed camera is solved once, and its other poses have the same result.
    """

    world_from_camera: FloatArray
    camera: Int32Array
    rows: IntArray
    turns: IntArray


class ExactPass:
    """Pass over poses by solvers; any number of threads may use it.

    Parameters
    ----------
    mesh, camera
        The surface, and the camera that sees it, or several.
    engine : Engine
        Its method is certified or exact.
    keeps_pieces : bool
        Keep the visible pieces of faces, of which regions are made; lenses need them, too.
    """

    def __init__(
        self, mesh: Mesh, camera: Cameras, engine: Engine, *, keeps_pieces: bool = False
    ) -> None:
        cameras = cameras_of(camera)
        self.mesh, self.camera, self.cameras = mesh, camera, cameras
        self.threads, self.method = thread_count(engine.threads), engine.method
        keeps_pieces = keeps_pieces or any(each.is_curved for each in cameras)
        self._has_fixed = isinstance(camera, Rig) and bool(camera.fixed)
        self._solvers = solver_visibility.Pass(
            self.method == "certified", keeps_pieces, len(cameras), self.threads
        )

    def observe(self, poses: Poses, seen: Observation, left_out: BoolArray | None = None) -> None:
        """Fill `seen`, of `room_for`; faces that are left out, (F,), hide and have no figures."""

        def run(placed: PlacedPoses, figures: Figures) -> None:
            mask = mask_of(left_out)
            self._solvers.observe(self._surface, mask, placed, figures, self.threads)

        self._run(poses, seen, run)

    @property
    def _surface(self) -> Any:
        return surface_of(self.mesh)

    def _run(self, poses: Poses, seen: Observation | None, run: Callable[..., Found]) -> Found:
        """Result of a function of the poses and of the figures to fill."""
        for index in poses.check_cameras(len(self.cameras)):
            if not self._solvers.has_camera(index):
                self._set_camera(index)
        rows = turns = np.arange(len(poses))
        if self._has_fixed:
            first = shared_rows(self.camera, poses)
            rows = np.flatnonzero(first == rows)
            turns = np.searchsorted(rows, first)
        matrices = np.ascontiguousarray(poses.world_from_camera, np.float64)
        placed = PlacedPoses(matrices, np.ascontiguousarray(poses.camera), rows, turns)
        if seen is None:
            return run(placed, NOTHING)
        figures = (
            *(seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.area_error),
            seen.clipped,
        )
        run_result = run(placed, figures)
        if len(rows) < len(turns):
            shared = rows[turns]
            for row in np.flatnonzero(shared != np.arange(len(turns))).tolist():
                for array in figures:
                    array[row] = array[shared[row]]
        return run_result

    def _set_camera(self, index: int) -> None:
        self._solvers.set_camera(index, engine_camera(self.cameras[index]), None)

    def set_mesh(self, mesh: Mesh) -> None:
        """Take the mesh with its bodies at other poses, for the poses from now on."""
        self.mesh = mesh

    def close(self) -> None:
        """Release the scratch memory."""
        self._solvers.close()


NO_MASK = np.empty(0, bool)


def mask_of(faces: BoolArray | None) -> BoolArray:
    """Mask of faces for the engine; of no rows where it has none."""
    return NO_MASK if faces is None else np.ascontiguousarray(faces)
