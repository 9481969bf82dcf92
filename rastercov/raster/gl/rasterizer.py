"""OpenGL rasteriser: the contract of `raster.contract` around the shaders of `compute`.

A device is tested against a scene with known counts at opening and every `SELF_TEST_INTERVAL`
poses, with the programs, images and buffers in use.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from rastercov import shaders
from rastercov.base.memory import FloatArray, Int32Array
from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.raster import self_test
from rastercov.raster.contract import FaceCounts, Rasterizer, RasterizerInfo, check_counts
from rastercov.raster.gl.compute import Compute, ComputePoses, ComputeScene
from rastercov.raster.gl.context import HeadlessContext, open_context
from rastercov.raster.gl.resources import Resources
from rastercov.raster.sample_grid import SampleGrid

SELF_TEST_INTERVAL = 256
"""Poses between two self-tests of the device."""


class GLRasterizer(Rasterizer):
    """The contract of `rastercov.raster.contract` on OpenGL.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    device : str, int or HeadlessContext
        "auto", "hardware", "egl:0", "surfaceless" or "osmesa" as for `open_context`; a context
        that is already open is used and left open.

    Raises
    ------
    CameraError, DeviceError, ResourceError
        For a lens, which `open_rasterizer` draws; a device that lacks a feature or fails its
        self-test; lack of memory.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        device: str | int | HeadlessContext = "auto",
    ) -> None:
        camera.check_pinhole(
            "GLRasterizer draws pinholes only", "take open_rasterizer, which draws any lens"
        )
        super().__init__(mesh, camera, supersample, roll)
        self._owns_context = not isinstance(device, HeadlessContext)
        self._context = device if isinstance(device, HeadlessContext) else open_context(device)
        self._resources = Resources(self._context)
        try:
            self._prepare()
            self._run_self_test()
        except BaseException:
            self.close()
            raise

    def _prepare(self) -> None:
        """Compile the programs, allocate the images and upload the mesh."""
        resources, mesh, camera = self._resources, self.mesh.opaque, self.camera
        grid = SampleGrid(camera, self.supersample, self.roll)
        resources.use()
        self._compute = Compute(resources, mesh, camera, grid)
        self.info = RasterizerInfo(
            backend="gl",
            plan="compute",
            renderer=self._context.info.renderer,
            driver=self._context.info.version,
            device=str(self._context.info.device),
            depth="float32 1/z",
            shaders=shaders.digest(),
        )
        self._scene = ComputeScene(resources, mesh, camera, grid)
        # Not rotated, since its counts are known for that grid; the programs are the same.
        known = self_test.MESH, self_test.CAMERA, SampleGrid(self_test.CAMERA)
        self._self_test_scene = ComputeScene(resources, *known)
        self._pixels = SampleGrid(camera)
        self._self_test_view = 0

    # --- the contract ---------------------------------------------------------------------------

    def _counted(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        n_bytes = np.dtype(self._scene.grid.count_type).itemsize
        check_counts(len(poses), self.mesh.n_faces, n_bytes * (1 + drawn))
        with self._current():
            counts = self._count(self._scene, poses, drawn)
            if self._targets is None:
                return counts
            found = self._compute.count_targets(self._scene, self._targets, poses)
            return self._with_targets(counts, *found)

    def _drawn(self, poses: FloatArray) -> tuple[Int32Array, NDArray[np.float32]]:
        grid = self._pixels
        shape = grid.height, grid.width
        face, depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        with self._current():
            prepared = ComputePoses(self._scene, poses, grid)
            self._compute.begin(prepared, slice(0, 1))
            for tile in grid.tiles(self._compute.tile):
                x, y, width, height = tile
                part = np.s_[y : y + height, x : x + width]
                face[part], depth[part] = self._compute.image(self._scene, prepared, tile)
        return face, depth

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

    def _count(self, scene: ComputeScene, poses: FloatArray, with_drawn: bool) -> FaceCounts:
        """Count poses in batches and tiles; run the self-test when it is due."""
        shape = (len(poses), scene.mesh.n_faces)
        visible = np.zeros(shape, scene.grid.count_type)
        drawn = np.zeros(shape, scene.grid.count_type) if with_drawn else None
        background = np.zeros(len(poses), np.int64)
        grid, compute = scene.grid, self._compute
        prepared = ComputePoses(scene, poses, grid)
        for rows in compute.batches(len(poses)):
            compute.begin(prepared, rows)
            for tile in grid.tiles(compute.tile):
                counts = compute.count(scene, rows.stop - rows.start, tile, drawn=with_drawn)
                tile_visible, tile_background, tile_drawn = counts
                visible[rows] += tile_visible
                background[rows] += tile_background
                if drawn is not None and tile_drawn is not None:
                    drawn[rows] += tile_drawn
            self._resources.poll("drawing")
            if scene is self._scene:
                self._note(rows.stop - rows.start)
        wrong = np.flatnonzero(visible.sum(axis=1) + background != grid.n_samples)
        if wrong.size:
            row = int(wrong[0])
            raise self._resources.untrusted(
                f"counted {visible[row].sum() + background[row]} samples of {grid.n_samples}"
            )
        return self._result(visible, drawn, background, prepared.clipped)

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
        if not np.array_equal(counts.visible[0], self_test.VISIBLE[view]):
            raise self._resources.untrusted("drew a known scene wrongly")
        assert counts.drawn is not None
        if not np.array_equal(counts.drawn, self_test.DRAWN[[view]]):
            raise self._resources.untrusted("counted a known scene wrongly")
