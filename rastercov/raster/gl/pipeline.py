"""The plans that draw with the graphics pipeline: triangle-ID and depth buffers, and their counts.

Each face is drawn with its index + 1 as colour into a 32-bit integer image; the depth buffer keeps
the nearest. Depth is float32 and reversed (near is 1, infinity 0), which gives the same relative
precision everywhere, with near fitted to each pose. Two plans share the shaders and the state:

- *software*: one pose at a time, ids read back and counted by numpy. On Mesa's llvmpipe nothing is
  gained by batching, and "reading back" is a copy in memory.
- *hardware*: many poses a draw, one image layer each; a compute shader counts and only counts
  come back.

`drawn` counts come from a second pass with the depth test off, where every sample adds one to its
face's counter; without storage buffers (OpenGL < 4.3) the faces are peeled off layer by layer.

N. Reed. Depth Precision Visualized. 2015, for the reversed depth buffer.
"""

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.raster import self_test as canary
from rastercov.raster.gl.coplanar import coplanar_overlaps
from rastercov.raster.gl.resources import Arena, Target
from rastercov.raster.gl.scene import Scene, Views
from rastercov.raster.gl.strategy import (
    Counts,
    FloatArray,
    IntArray,
    Limits,
    WordArray,
    side_by_side,
)
from rastercov.raster.sample_grid import Box, SampleGrid

MAX_POSES = 128
"""Poses in one uniform block: 128 x 96 bytes stay under the 16 KiB every device grants."""
RAYS = 1
"""Binding of the uniform block of rays: 128 x 128 bytes, likewise."""
NO_LAYER = 0xFFFFFFFF


class Pipeline:
    """`rastercov.raster.gl.strategy.Plan` on the graphics pipeline.

    Parameters
    ----------
    arena : Arena
        Where everything lives; in use.
    mesh, camera, grid
        The largest scene that will be drawn.
    limits : Limits
        As given to the rasteriser.
    is_layered : bool
        Plan "hardware" rather than "software".
    """

    def __init__(
        self,
        arena: Arena,
        mesh: Mesh,
        camera: Camera,
        grid: SampleGrid,
        limits: Limits,
        *,
        is_layered: bool,
    ) -> None:
        self._arena, self._is_layered = arena, is_layered
        self.depth = "float32 reversed" if arena.is_reversed else "float32"
        known = arena.context.info
        most = known.limits
        side = min(limits.tile, most["max_texture_size"], *most["max_viewport_dims"])
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        self.tile = (min(side, wide), min(side, high))
        layers = 1
        if is_layered:
            image = 8 * self.tile[0] * self.tile[1]
            layers = max(1, min(MAX_POSES, most["max_array_layers"], limits.images // image))
        self._max_faces = min(limits.faces, mesh.n_faces)
        if known.has_ssbo:
            # A counter a face and one for background must fit one storage block, for each layer.
            counters = int(most["max_ssbo_bytes"]) // 4
            self._max_faces = min(self._max_faces, counters - 1)
            layers = min(layers, counters // (self._max_faces + 1))
        self._layers = layers

        flags = {"LAYERED": is_layered, "ROLLED": grid.is_rolled}
        defines = {"MAX_POSES": MAX_POSES} | {name: 1 for name in flags if flags[name]}
        version = 430 if known.has_ssbo else 330
        names = ("face", "drawn" if known.has_ssbo else "peel")
        self._programs = {name: arena.program(name, version, **defines) for name in names}
        self._mesh, self._overlapping = mesh, coplanar_overlaps(mesh)
        if self._overlapping.any() and not known.has_doubles:
            self._overlapping = np.zeros(mesh.n_faces, dtype=bool)
            self.depth += ", undecided where faces of one plane overlap"
        self._poses = arena.buffer("poses", size=96 * MAX_POSES)
        if self._overlapping.any():
            reversed_ = {"REVERSED": 1} if arena.is_reversed else {}
            self._programs["coplanar"] = arena.program(
                "coplanar", version, COPLANAR=1, **defines, **reversed_
            )
            self._programs["coplanar"]["AllRays"].binding = RAYS
            self._rays = arena.buffer("rays", size=128 * MAX_POSES)
        width, height = (max(self.tile[0], canary.WIDTH), max(self.tile[1], canary.HEIGHT))
        self._targets = [Target(arena, width, height, layers)]
        if known.has_ssbo:
            stride = max(self._max_faces, canary.MESH.n_faces) + 1
            self._counters = arena.buffer("face counters", size=4 * layers * stride)
        else:
            self._targets.append(Target(arena, width, height, 1))
        if is_layered:
            self._counting = arena.compute("count", version, **defines)

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> Scene:
        """Send a mesh to the device."""
        overlapping = self._overlapping
        if mesh is not self._mesh:  # the known scene, which is to meet all programs in use
            rectangle = np.arange(mesh.n_faces) // 2
            overlapping = (rectangle % 2 == 1) & self._overlapping.any()
        return Scene(self._arena, self._programs, mesh, camera, grid, self._max_faces, overlapping)

    def views(self, scene: Scene, poses: FloatArray, grid: SampleGrid) -> Views:
        """Make poses ready to be drawn."""
        return Views(scene, poses, grid, self._arena.is_reversed)

    def batches(self, views: Views) -> Iterator[IntArray]:
        """Rows of poses to draw together: culling is a property of a draw, so it never mixes."""
        for cull in (False, True):
            rows = np.flatnonzero(views.can_cull == cull)
            for start in range(0, len(rows), self._layers):
                yield rows[start : start + self._layers]

    def begin(self, views: Views, rows: IntArray) -> None:
        """Send the poses of a batch to the device."""
        self._poses.bind_to_uniform_block(0)
        self._poses.write(views.records(rows))
        if (rays := views.rays(rows)) is not None:
            self._rays.bind_to_uniform_block(RAYS)
            self._rays.write(rays)

    def count(
        self, scene: Scene, views: Views, rows: IntArray, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Any, Counts | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""
        self._draw_faces(scene, views, rows, tile)
        seen: Counts
        if self._is_layered:
            seen, empty = self._count_on_device(scene, tile, len(rows))
        else:
            seen, empty = self._count_here(scene, tile, views.boxes[rows[0]])
        return seen, empty, self._count_drawn(scene, tile, len(rows)) if drawn else None

    def image(
        self, scene: Scene, views: Views, tile: Box
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Draw the first of the views into a tile: faces and depths, as in `VisibilityBuffer`."""
        self._draw_faces(scene, views, np.array([0]), tile)
        ids = self._arena.read_faces(self._targets[0], (0, 0, *tile[2:]))
        values = self._arena.read_depth(self._targets[0], (0, 0, *tile[2:]))
        return ids.view(np.int32) - 1, views.depth(0, values)

    def _draw_faces(self, scene: Scene, views: Views, rows: IntArray, tile: Box) -> None:
        can_cull = bool(views.can_cull[rows[0]])
        self._arena.clear(self._targets[0])
        self._begin(self._targets[0], tile, cull=can_cull)
        if can_cull and scene.can_draw_front and not self._is_layered:
            scene.draw_front(tile, views.grid, views.eyes[rows[0]])
        else:
            scene.draw_nearest(tile, views.grid, len(rows))

    def _begin(self, target: Target, tile: Box, *, cull: bool = False, test: bool = True) -> None:
        """Bind a target for a tile; with the depth test, nearer wins and the first of equals."""
        target.frame.viewport = (0, 0, *tile[2:])
        target.frame.use()
        flags = (moderngl.DEPTH_TEST if test else 0) | (moderngl.CULL_FACE if cull else 0)
        self._arena.gl.enable_only(flags)
        self._arena.gl.depth_func = ">" if self._arena.is_reversed else "<"

    def _count_here(self, scene: Scene, tile: Box, reach: tuple[int, ...]) -> tuple[IntArray, Any]:
        """Software plan: read the ids where the mesh can be, and count runs of equal ones."""
        x, y, width, height = tile
        left, right = (min(max(edge - x, 0), width) for edge in reach[::2])
        top, bottom = (min(max(edge - y, 0), height) for edge in reach[1::2])
        box = (left, top, right - left, bottom - top)
        all_inside = scene.grid.n_inside(tile)
        inside = scene.grid.n_inside((x + left, y + top, *box[2:]))
        if not inside:
            return np.zeros(scene.mesh.n_faces, np.int64), all_inside
        ids = self._arena.read_faces(self._targets[0], box)
        ids = scene.grid.inside(ids, (x + left, y + top, *box[2:]))
        counts = self._count_ids(ids, scene)
        return counts[1:], int(counts[0]) + all_inside - inside

    def _count_ids(self, ids: NDArray[np.uint32], scene: Scene) -> IntArray:
        """Samples of each id in a flat array: 0 for background, then one a face."""
        starts = np.concatenate(([0], np.flatnonzero(ids[1:] != ids[:-1]) + 1))
        lengths = np.diff(starts, append=ids.size)
        values = ids[starts].astype(np.int64)
        if values.max() > scene.mesh.n_faces:
            raise self._arena.distrust(f"drew face {values.max() - 1} of {scene.mesh.n_faces}")
        # Sums of whole numbers in float64 are exact far beyond any image.
        counts = np.bincount(values, weights=lengths, minlength=scene.mesh.n_faces + 1)
        return counts.astype(np.int64)

    def _count_on_device(self, scene: Scene, tile: Box, poses: int) -> tuple[WordArray, Any]:
        """Hardware plan: a compute shader counts the batch, in windows of faces that fit."""
        counting = self._counting
        counting["size"].value = tile[2:]
        self._bind_runs(scene)
        if "corner" in counting:
            counting["corner"].value = tile[:2]
        columns, rows = -(-tile[2] // 128), -(-tile[3] // 8)  # 8 x 8 invocations, runs of 16
        windows = []
        for first, n in scene.parts:
            counting["stride"].value, counting["first_face"].value = n + 1, first
            self._targets[0].faces.use(0)
            self._counters.clear()
            self._counters.bind_to_storage_buffer(0)
            counting.run(columns, rows, poses)
            windows.append(self._arena.read_words(self._counters, poses, n + 1))
        return side_by_side(windows), windows[0][:, 0]

    def _count_drawn(self, scene: Scene, tile: Box, poses: int) -> Counts:
        """Samples of each face alone: without the depth test, every sample adds to a counter."""
        if "peel" in self._programs:
            return self._peel(scene, tile)
        frame = self._targets[0].frame
        frame.color_mask = (False,) * 4  # the shader writes no id
        self._bind_runs(scene)
        windows = []
        try:
            self._begin(self._targets[0], tile, test=False)
            for part in scene.parts:
                self._counters.clear()
                self._counters.bind_to_storage_buffer(0)
                scene.draw("drawn", tile, scene.grid, poses, part)
                windows.append(self._arena.read_words(self._counters, poses, part[1] + 1))
        finally:
            frame.color_mask = (True,) * 4  # after an interrupt, too, or later images stay empty
        return side_by_side(windows)

    def _bind_runs(self, scene: Scene) -> None:
        if scene.runs is not None:
            scene.runs.bind_to_storage_buffer(1)

    def _peel(self, scene: Scene, tile: Box) -> IntArray:
        """Samples of each face alone, where shaders cannot count: one layer of faces at a time."""
        total = np.zeros(scene.mesh.n_faces + 1, np.int64)
        before, layer = self._targets
        self._arena.clear(before)
        while True:
            self._arena.clear(layer, face=NO_LAYER)
            self._begin(layer, tile)
            before.faces.use(0)
            for part in scene.parts:
                scene.draw("peel", tile, scene.grid, 1, part)
            ids = self._arena.read_faces(layer, (0, 0, *tile[2:]))
            ids = scene.grid.inside(ids, tile)
            if (ids == NO_LAYER).all():
                return total[1:]
            total += self._count_ids(np.where(ids == NO_LAYER, 0, ids), scene)
            before, layer = layer, before
