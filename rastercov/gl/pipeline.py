"""Strategy of the plan "pipeline": the graphics pipeline.

Each face is drawn with its index + 1 as colour into a 32-bit integer image; the depth buffer keeps
the nearest. Depth is float32 and reversed (near is 1, infinity 0), which gives the same relative
precision at every distance. Poses are drawn one at a time, and their
ids are read back and counted by numpy: on Mesa's llvmpipe that is a copy in memory.

`drawn` counts come from a second pass without the depth test, where every sample adds one to its
face's counter.

N. Reed. Depth Precision Visualized. 2015, for the reversed depth buffer.
"""

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np

from rastercov.base import Float32Array, Int32Array, IntArray
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.gl.resources import Resources, Target
from rastercov.gl.scene import RECORD_BYTES, DeviceScene, PreparedPoses
from rastercov.gl.strategy import COUNTER_BYTES, Counts, Strategy

POSES_BINDING = 0  # uniform block
COUNTS_BINDING, RUNS_BINDING = 0, 1  # storage buffers


class Pipeline(Strategy):
    """`Strategy` on the graphics pipeline."""

    depth = "float32 reversed"
    prepare = PreparedPoses

    def __init__(self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid) -> None:
        super().__init__(resources, mesh, COUNTER_BYTES, 0)
        device = resources.context.info.limits
        side = min(self.max_tile, device["max_texture_size"], *device["max_viewport_dims"])
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        self.tile = (min(side, wide), min(side, high))
        defines = {"ROLLED": 1} if grid.is_rolled else {}
        self._programs = {name: resources.program(name, **defines) for name in ("face", "drawn")}
        self._poses = resources.buffer("poses", size=RECORD_BYTES)
        width, height = max(self.tile[0], self_test.WIDTH), max(self.tile[1], self_test.HEIGHT)
        self._target = Target(resources, width, height)
        stride = max(mesh.n_faces, self_test.MESH.n_faces) + 1
        self._counters = resources.buffer("face counters", size=COUNTER_BYTES * stride)

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> DeviceScene:
        """Upload a mesh."""
        return DeviceScene(self._resources, self._programs, mesh, camera, grid)

    def batches(self, prepared: PreparedPoses) -> Iterator[IntArray]:
        """Rows of the poses of each batch: one."""
        for row in range(len(prepared.can_cull)):
            yield np.array([row])

    def begin(self, prepared: PreparedPoses, rows: IntArray) -> None:
        """Upload the poses of a batch."""
        self._poses.bind_to_uniform_block(POSES_BINDING)
        self._poses.write(prepared.records[rows])

    def count(
        self, scene: DeviceScene, prepared: PreparedPoses, rows: IntArray, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Any, Counts | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""
        self._draw_faces(scene, prepared, rows, tile)
        counts = self._count_ids(scene, tile)
        visible, background = counts[1:], int(counts[0])
        return visible, background, self._count_pixels(scene, tile) if drawn else None

    def image(
        self, scene: DeviceScene, prepared: PreparedPoses, tile: Box
    ) -> tuple[Int32Array, Float32Array]:
        """Draw the first pose into a tile: faces and depths, as in `VisibilityBuffer`."""
        self._draw_faces(scene, prepared, np.array([0]), tile)
        ids = self._resources.read_faces(self._target, (0, 0, *tile[2:]))
        values = self._resources.read_depth(self._target, (0, 0, *tile[2:]))
        return ids.view(np.int32) - 1, prepared.depth(0, values)

    def _draw_faces(
        self, scene: DeviceScene, prepared: PreparedPoses, rows: IntArray, tile: Box
    ) -> None:
        """Draw the nearest faces of a pose into the triangle-ID image."""
        self._resources.clear(self._target)
        self._begin(tile, cull=bool(prepared.can_cull[rows[0]]))
        scene.draw("face", tile, prepared.grid)

    def _begin(self, tile: Box, *, cull: bool = False, test: bool = True) -> None:
        """Bind the target for a tile; with the depth test, nearer wins and the first of equals."""
        self._target.frame.viewport = (0, 0, *tile[2:])
        self._target.frame.use()
        flags = (moderngl.DEPTH_TEST if test else 0) | (moderngl.CULL_FACE if cull else 0)
        self._resources.gl.enable_only(flags)
        self._resources.gl.depth_func = ">"

    def _count_ids(self, scene: DeviceScene, tile: Box) -> IntArray:
        """Samples of each id in a tile: 0 for background, then one per face."""
        ids = self._resources.read_faces(self._target, (0, 0, *tile[2:]))
        ids = scene.grid.inside(ids, tile)
        if not ids.size:  # a corner of a rotated grid
            return np.zeros(scene.mesh.n_faces + 1, np.int64)
        starts = np.concatenate(([0], np.flatnonzero(ids[1:] != ids[:-1]) + 1))
        lengths = np.diff(starts, append=ids.size)
        values = ids[starts].astype(np.int64)
        if values.max() > scene.mesh.n_faces:
            raise self._resources.distrust(f"drew face {values.max() - 1} of {scene.mesh.n_faces}")
        # Exact: sums of integers in float64 stay far below 2^53.
        counts = np.bincount(values, weights=lengths, minlength=scene.mesh.n_faces + 1)
        return counts.astype(np.int64)

    def _count_pixels(self, scene: DeviceScene, tile: Box) -> Counts:
        """Samples of each face alone: without the depth test, every sample adds to a counter."""
        frame = self._target.frame
        frame.color_mask = (False,) * 4  # the shader writes no id
        self._counters.bind_to_storage_buffer(COUNTS_BINDING)
        if scene.runs is not None:
            scene.runs.bind_to_storage_buffer(RUNS_BINDING)
        try:
            self._begin(tile, test=False)
            self._counters.clear()
            scene.draw("drawn", tile, scene.grid)
            return self._resources.read_words(self._counters, 1, scene.mesh.n_faces + 1)[:, 1:]
        finally:
            frame.color_mask = (True,) * 4  # after an interrupt, too, or later images stay empty
