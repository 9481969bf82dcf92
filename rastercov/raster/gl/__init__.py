"""The OpenGL rasteriser: contract, context and trust around one of three plans.

- *software*: the graphics pipeline, one pose at a time, counted by numpy; see `pipeline`.
- *hardware*: the graphics pipeline, many poses a draw, counted on the GPU.
- *compute*: no graphics pipeline, many poses at a time, counted on the GPU; see `compute`.

"auto" takes the first on a software device and the second on hardware that has what it needs; the
third for a camera with so long a lens that the pipeline would misplace edges.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov import shaders
from rastercov._arguments import flag
from rastercov._closing import Closing
from rastercov.camera import Camera
from rastercov.errors import ConfigError, DeviceError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.raster import self_test as canary
from rastercov.raster.contract import (
    FaceCounts,
    RasterizerInfo,
    VisibilityBuffer,
    check_counts,
    check_picture,
)
from rastercov.raster.gl.compute import Compute
from rastercov.raster.gl.context import HeadlessContext, open_context
from rastercov.raster.gl.pipeline import Pipeline
from rastercov.raster.gl.resources import Arena
from rastercov.raster.gl.strategy import IMAGE_BUDGET, MAX_FACES_A_DRAW, MAX_TILE, Limits, Plan
from rastercov.raster.sample_grid import SampleGrid

PLANS = ("software", "hardware", "compute")
LONGEST = 1 << 16
"""Pixels: largest focal length, and farthest principal point, of the graphics pipeline. It works in
float32, which places the edges of faces to about 2^-23 of that: 1/128 px."""
CANARY_EVERY = 256
"""Poses between two checks of the device against a scene with known counts."""


class GLRasterizer(Closing):
    """The contract of `rastercov.raster.contract` on OpenGL.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    device : str, int or HeadlessContext
        "auto", "egl:0", "surfaceless" or "osmesa" as for `open_context`; a context that is open
        already is used and left open.
    plan : {"auto", "software", "hardware", "compute"}
        How to run; "auto" follows the device.
    require_hardware : bool
        Refuse a software renderer.
    max_tile, max_faces_a_draw, image_budget : int
        Limits below those of the device: samples a side, faces a draw, bytes of images a batch.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        device: str | int | HeadlessContext = "auto",
        plan: str = "auto",
        require_hardware: bool = False,
        max_tile: int = MAX_TILE,
        max_faces_a_draw: int = MAX_FACES_A_DRAW,
        image_budget: int = IMAGE_BUDGET,
    ) -> None:
        if plan not in ("auto", *PLANS):
            raise ConfigError(f"plan must be auto, {', '.join(PLANS)}, got {plan!r}")
        limits = (max_tile, max_faces_a_draw, image_budget)
        if min(limits) < 1:
            raise ConfigError(
                f"max_tile, max_faces_a_draw and image_budget must be 1 or more, got {limits}"
            )
        self.mesh, self.camera, self.supersample, self.roll = mesh, camera, supersample, roll
        self._is_open = True
        self._owns_context = not isinstance(device, HeadlessContext)
        if isinstance(device, HeadlessContext):
            if require_hardware and device.info.is_software:
                raise DeviceError(f"wanted hardware OpenGL, got {device.info.renderer}")
            self._context = device
        else:
            self._context = open_context(device, require_hardware=require_hardware)
        self._arena = Arena(self._context)
        try:
            self._prepare(self._choose(plan), Limits(*limits))
            self._check_device()
        except BaseException:
            self.close()
            raise

    def _choose(self, plan: str) -> str:
        known = self._context.info
        reach = max(self.camera.fx, self.camera.fy, abs(self.camera.cx), abs(self.camera.cy))
        if plan == "auto" and reach > LONGEST and known.has_compute_raster:
            return "compute"
        if plan != "compute" and reach > LONGEST:
            raise ConfigError(
                f"OpenGL's pipeline takes fx, fy, cx and cy up to {LONGEST:,} px, got {reach:,g}: "
                "float32 would misplace edges; use plan 'compute' or backend 'cpu'"
            )
        if plan == "auto":
            return "hardware" if known.has_batches and not known.is_software else "software"
        needs = {
            "hardware": (known.has_batches, "compute shaders and layered drawing"),
            "compute": (known.has_compute_raster, "compute shaders and storage buffers"),
        }
        if plan in needs and not needs[plan][0]:
            raise DeviceError(
                f"plan '{plan}' needs {needs[plan][1]}, which "
                f"{known.renderer} (OpenGL {known.gl_version}) lacks; use plan 'software'"
            )
        return plan

    def _prepare(self, plan: str, limits: Limits) -> None:
        arena, mesh, camera = self._arena, self.mesh, self.camera
        grid = SampleGrid(camera, self.supersample, self.roll)
        arena.use()
        self._plan: Plan
        if plan == "compute":
            self._plan = Compute(arena, mesh, camera, grid, limits)
        else:
            is_layered = plan == "hardware"
            self._plan = Pipeline(arena, mesh, camera, grid, limits, is_layered=is_layered)
        self.info = RasterizerInfo(
            backend="gl",
            plan=plan,
            renderer=self._context.info.renderer,
            driver=self._context.info.version,
            device=str(self._context.info.device),
            depth=self._plan.depth,
            shaders=shaders.digest(),
        )
        self._scene = self._plan.scene(mesh, camera, grid)
        # Not rolled, so that its counts are known; the programs are those of the rolled grid.
        self._canary = self._plan.scene(canary.MESH, canary.CAMERA, SampleGrid(canary.CAMERA))
        self._pixels = SampleGrid(camera)
        self._canary_view = 0

    # --- the contract ---------------------------------------------------------------------------

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Samples of each face in each pose; see `Rasterizer.count`."""
        matrices, drawn = valid_poses(poses), flag("drawn", drawn)
        n_bytes = np.dtype(self._scene.grid.count_type).itemsize
        check_counts(len(matrices), self.mesh.n_faces, n_bytes * (1 + drawn))
        with self._current():
            return self._count(self._scene, matrices, drawn)

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre; see `Rasterizer.render`."""
        matrices = valid_poses(pose)
        if len(matrices) != 1:
            raise ConfigError(f"render takes one pose, got {len(matrices)}")
        check_picture(self.camera)
        shape = (self.camera.height, self.camera.width)
        face, depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        with self._current():
            views = self._plan.views(self._scene, matrices, self._pixels)
            self._plan.begin(views, np.array([0]))
            for tile in self._pixels.tiles(self._plan.tile):
                x, y, width, height = tile
                part = np.s_[y : y + height, x : x + width]
                face[part], depth[part] = self._plan.image(self._scene, views, tile)
        return VisibilityBuffer(face, depth)

    def close(self) -> None:
        """Give everything on the device back; later calls raise `DeviceError`."""
        if not self._is_open:
            return
        self._context.check_owner()
        self._is_open = False
        self._context.make_current()
        self._arena.release()
        if self._owns_context:
            self._context.release()

    @contextmanager
    def _current(self) -> Iterator[None]:
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")
        self._arena.use()
        yield
        self._arena.poll("drawing")

    # --- counting -------------------------------------------------------------------------------

    def _count(self, scene: Any, poses: NDArray[np.float64], with_drawn: bool) -> FaceCounts:
        shape = (len(poses), scene.mesh.n_faces)
        visible = np.zeros(shape, scene.grid.count_type)
        drawn = np.zeros(shape, scene.grid.count_type) if with_drawn else None
        background = np.zeros(len(poses), np.int64)
        grid, plan = scene.grid, self._plan
        views = plan.views(scene, poses, grid)
        for rows in plan.batches(views):
            plan.begin(views, rows)
            for tile in grid.tiles(plan.tile):
                seen, empty, alone = plan.count(scene, views, rows, tile, drawn=with_drawn)
                visible[rows] += seen
                background[rows] += empty
                if drawn is not None:
                    drawn[rows] += alone
            self._arena.poll("drawing")
            if scene is self._scene:
                self._poses_since_check += len(views.clipped[rows])
                if self._poses_since_check >= CANARY_EVERY:
                    self._check_device()
        wrong = np.flatnonzero(visible.sum(axis=1) + background != grid.n_samples)
        if wrong.size:
            row = int(wrong[0])
            raise self._arena.distrust(
                f"counted {visible[row].sum() + background[row]} samples of {grid.n_samples}"
            )
        scale = grid.supersample
        return FaceCounts(visible, drawn, background, views.clipped, scale, self.info, self.roll)

    # --- trust ----------------------------------------------------------------------------------

    def _check_device(self) -> None:
        """Count a scene whose counts are known, with the same programs, images and buffers."""
        self._poses_since_check = 0
        with self._current():
            view = self._canary_view
            self._canary_view = 1 - view
            counts = self._count(self._canary, canary.POSES[[view]], with_drawn=True)
        if not np.array_equal(counts.visible[0], canary.VISIBLE[view]):
            raise self._arena.distrust("drew a known scene wrongly")
        assert counts.drawn is not None
        if not np.array_equal(counts.drawn, canary.DRAWN[[view]]):
            raise self._arena.distrust("counted a known scene wrongly")
