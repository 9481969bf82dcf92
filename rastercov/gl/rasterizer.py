"""OpenGL rasteriser: the contract of `raster.contract` around one of two strategies.

- *pipeline*: graphics pipeline of any driver, a pose at a time; see `pipeline`.
- *compute*: compute shaders, many poses at a time, counted on the device; see `compute`.

"auto" is "compute" on a GPU with integers of 64 bits, else "pipeline". In any case "compute" draws
parallel rays, a focal length so long that the graphics pipeline would misplace edges, and a mesh
whose faces touch others: a pipeline interpolates depth from the corners of each face, so that
rounding would decide between faces of one plane.

A device is tested against a scene with known counts at opening and every `SELF_TEST_INTERVAL`
poses, with the programs, images and buffers in use.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from rastercov import shaders
from rastercov.base import (
    ByName,
    DeviceError,
    Float32Array,
    FloatArray,
    Int32Array,
    MeshError,
    check_choice,
)
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.contract import (
    Criteria,
    FaceCounts,
    Judged,
    Rasterizer,
    RasterizerInfo,
    check_counts,
)
from rastercov.core.raster.sample_grid import SampleGrid
from rastercov.gl.compute import Compute
from rastercov.gl.context import HeadlessContext, open_context
from rastercov.gl.judging import FACE, Judging, why_no_shader
from rastercov.gl.pipeline import Pipeline
from rastercov.gl.resources import Resources

PLANS: ByName = {"pipeline": Pipeline, "compute": Compute}
"""Ways to draw and count."""
MAX_FOCAL_LENGTH = 1 << 16
"""Largest focal length and principal point of the graphics pipeline, in pixels. Its float32 places
edges to about 2^-23 of that: 1/128 px."""
REACHES = 10
"""Distance between faces that touch, in those for which contacts are found by default."""
SELF_TEST_INTERVAL = 256
"""Poses between two self-tests of the device."""


class GLRasterizer(Rasterizer):
    """The contract of `rastercov.core.raster.contract` on OpenGL.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    device : str, int or HeadlessContext
        "auto", "hardware", "egl:0", "surfaceless" or "osmesa" as for `open_context`; a context
        that is already open is used and left open.
    plan : {"auto", "pipeline", "compute"}
        Way to draw and count; "compute" where "pipeline" cannot, see above.

    Raises
    ------
    CameraError, MeshError, ConfigError, DeviceError, ResourceError
        For a lens or targets, which `open_rasterizer` draws; a bad argument; a device that lacks a
        feature or fails its self-test; lack of memory.
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
    ) -> None:
        if camera.is_curved:
            camera.check_pinhole(
                "expected a pinhole for GLRasterizer", "use open_rasterizer, which draws any lens"
            )
        if mesh.has_targets:
            raise MeshError(
                "expected a mesh without targets for GLRasterizer, got some; use open_rasterizer, "
                "which counts them on the CPU"
            )
        check_choice("plan", plan, ("auto", *PLANS))
        super().__init__(mesh, camera, supersample, roll)
        self._owns_context = not isinstance(device, HeadlessContext)
        self._context = device if isinstance(device, HeadlessContext) else open_context(device)
        self._resources = Resources(self._context)
        try:
            self._prepare(self._choose_plan(plan))
            self._run_self_test()
        except BaseException:
            self.close()
            raise

    def _choose_plan(self, plan: str) -> str:
        """Plan to run; ConfigError when it cannot run."""
        camera, info = self.camera, self._context.info
        reach = max(camera.fx, camera.fy, abs(camera.cx), abs(camera.cy))
        is_faster = plan == "auto" and info.has_int64 and not info.is_software
        if is_faster or camera.is_parallel or reach > MAX_FOCAL_LENGTH:
            plan = "compute"
        if plan != "compute":
            contacts = self.mesh.contacts
            touch = contacts.faces_for(REACHES * contacts.reach).any()
            plan = "compute" if touch else "pipeline"
        if plan == "compute" and not info.has_int64:
            raise DeviceError(
                f"expected GL_ARB_gpu_shader_int64 for plan 'compute', got {info.renderer} without "
                "it; use backend 'cpu'"
            )
        return plan

    def _prepare(self, plan: str) -> None:
        """Compile the programs, allocate the images and upload the mesh."""
        resources, mesh, camera = self._resources, self.mesh, self.camera
        grid = SampleGrid(camera, self.supersample, self.roll)
        resources.use()
        self._strategy: Any = PLANS[plan](resources, mesh, camera, grid)
        self.info = RasterizerInfo(
            backend="gl",
            plan=plan,
            renderer=self._context.info.renderer,
            driver=self._context.info.version,
            device=str(self._context.info.device),
            depth=self._strategy.depth,
            shaders=shaders.digest(),
        )
        self._scene = self._strategy.scene(resources, mesh, camera, grid)
        # Not rotated, since its counts are known for that grid; the programs are the same.
        test_grid = SampleGrid(self_test.CAMERA)
        self._self_test_scene = self._strategy.scene(
            resources, self_test.MESH, self_test.CAMERA, test_grid
        )
        self._pixels = SampleGrid(camera)
        self._self_test_view = 0
        self._judging: Judging | None = None

    # --- the contract ---------------------------------------------------------------------------

    def _count_faces(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        n_bytes = np.dtype(self._scene.grid.count_type).itemsize
        check_counts(len(poses), self.mesh.n_faces, n_bytes * (1 + drawn))
        with self._current():
            return self._count(self._scene, poses, drawn)

    def _draw_faces(self, poses: FloatArray) -> tuple[Int32Array, Float32Array]:
        grid = self._pixels
        shape = grid.height, grid.width
        face, depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        with self._current():
            prepared = self._strategy.prepare(self._scene, poses, grid)
            self._strategy.begin(prepared, slice(0, 1))
            for tile in grid.tiles(self._strategy.tile):
                x, y, width, height = tile
                part = np.s_[y : y + height, x : x + width]
                face[part], depth[part] = self._strategy.image(self._scene, prepared, tile)
        return face, depth

    def _why_not_judged(self, criteria: Criteria) -> str:
        """Reason why the host has to judge; see `Rasterizer._why_not_judged`."""
        self._check_open()
        grid, plan, block = self._scene.grid, self.info.plan, self._strategy.block
        if plan != "compute":
            return f"plan {plan!r} judges nothing on the device"
        if grid.count_type != np.int32:
            return "images of 2^31 samples are counted on the host"
        if max(FACE.itemsize * self.mesh.n_faces, self.mesh.vertices.nbytes) > block:
            return f"a storage block of {block:,} bytes holds too little of this mesh"
        return why_no_shader(self.camera, criteria)

    def _judge(self, poses: FloatArray, criteria: Criteria) -> Judged:
        """Faces that poses cover, judged on the device; see `Rasterizer.judge`."""
        with self._current():
            if self._judging is None:
                self._judging = Judging(self._resources, self._strategy, self._scene)
            return self._judging.judge(poses, criteria, self._note)

    def close(self) -> None:
        """Release everything on the device; later calls raise `DeviceError`."""
        if not self._is_open:
            return
        self._context.check_owner()
        super().close()
        self._context.make_current()
        self._resources.release()
        if self._owns_context:
            self._context.release()

    @contextmanager
    def _current(self) -> Iterator[None]:
        """Make the context current, and report the device's errors at the end."""
        self._check_open()
        self._resources.use()
        yield
        self._resources.poll("drawing")

    # --- counting -------------------------------------------------------------------------------

    def _count(self, scene: Any, poses: FloatArray, with_drawn: bool) -> FaceCounts:
        """Count poses in batches and tiles; run the self-test when it is due."""
        grid, strategy = scene.grid, self._strategy
        shape = 1 + with_drawn, len(poses), scene.mesh.n_faces
        counts, background = np.zeros(shape, grid.count_type), np.zeros(len(poses), np.int64)
        prepared = strategy.prepare(scene, poses, grid)
        for rows in strategy.batches(len(poses)):
            strategy.begin(prepared, rows)
            for tile in grid.tiles(strategy.tile):
                of_tile, empty = strategy.count(scene, prepared, rows, tile, drawn=with_drawn)
                counts[:, rows] += of_tile
                background[rows] += empty
            self._resources.poll("drawing")
            if scene is self._scene:
                self._note(rows.stop - rows.start)
        visible, *alone = counts
        wrong = np.flatnonzero(visible.sum(axis=1) + background != grid.n_samples)
        if wrong.size:
            row = int(wrong[0])
            raise self._resources.distrust(
                f"counted {visible[row].sum() + background[row]} samples of {grid.n_samples}"
            )
        return self._result(visible, alone[0] if alone else None, background, prepared.clipped)

    # --- self-test ------------------------------------------------------------------------------

    def _note(self, n_poses: int) -> None:
        """Run the self-test where it is due after some more poses."""
        self._poses_since_self_test += n_poses
        if self._poses_since_self_test >= SELF_TEST_INTERVAL:
            self._run_self_test()

    def _run_self_test(self) -> None:
        """Count a scene with known counts; DeviceError when the device counts it wrongly.

        The two views take turns, so an image left over from the previous test is noticed.
        """
        self._poses_since_self_test = 0
        with self._current():
            view = self._self_test_view
            self._self_test_view = 1 - view
            counts = self._count(self._self_test_scene, self_test.POSES[[view]], with_drawn=True)
        assert counts.drawn is not None
        found = np.concatenate((counts.visible, counts.drawn))
        if not np.array_equal(found, (self_test.VISIBLE[view], self_test.DRAWN[view])):
            raise self._resources.distrust("counted a known scene wrongly")
