"""The OpenGL rasteriser: triangle-ID and depth buffers per pose, and counts from them.

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
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov import shaders
from rastercov.camera import Camera
from rastercov.errors import ConfigError, DeviceError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.raster import canary
from rastercov.raster.arena import Arena, Target
from rastercov.raster.contract import FaceCounts, RasterizerInfo, VisibilityBuffer
from rastercov.raster.egl import HeadlessContext, open_context
from rastercov.raster.grid import Box, SampleGrid
from rastercov.raster.scene import Scene, Views

IntArray = NDArray[np.int64]

MAX_POSES = 128
"""Poses in one uniform block: 128 x 96 bytes stay under the 16 KiB every device grants."""
MAX_TILE = 8192
"""Largest side of one image on the device, in samples; larger images are drawn in tiles."""
MAX_FACES_A_DRAW = 1 << 26
"""Keeps the indices of one draw, and its counters, within 32-bit sizes."""
IMAGE_BUDGET = 512 << 20
"""Bytes of ids and depth that one batch of poses may take."""
CANARY_EVERY = 256
"""Poses between two checks of the device against a scene with known counts."""
NO_LAYER = 0xFFFFFFFF


class GLRasterizer:
    """The contract of `rastercov.raster.contract` on OpenGL.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    device : str, int or HeadlessContext
        "auto", "egl:0", "surfaceless" or "osmesa" as for `open_context`; a context that is open
        already is used and left open.
    plan : {"auto", "software", "hardware"}
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
        if plan not in ("auto", "software", "hardware"):
            raise ConfigError(f"plan must be auto, software or hardware, got {plan!r}")
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
            self._choose_plan(plan)
            self._allocate(max_tile, max_faces_a_draw, image_budget)
            self._check_device()
        except BaseException:
            self.close()
            raise

    def _choose_plan(self, plan: str) -> None:
        known = self._context.info
        if plan == "hardware" and not known.has_batches:
            raise DeviceError(
                f"plan 'hardware' needs compute shaders and layered drawing, which "
                f"{known.renderer} (OpenGL {known.gl_version}) lacks; use plan 'software'"
            )
        if plan == "auto":
            plan = "hardware" if known.has_batches and not known.is_software else "software"
        self._is_layered = plan == "hardware"
        self.info = RasterizerInfo(
            backend="gl",
            plan=plan,
            renderer=known.renderer,
            driver=known.version,
            device=str(known.device),
            depth="float32 reversed" if self._arena.is_reversed else "float32",
            shaders=shaders.digest(),
        )

    def _allocate(self, max_tile: int, max_faces: int, image_budget: int) -> None:
        arena, known, camera = self._arena, self._context.info, self.camera
        limits = known.limits
        grid = SampleGrid(camera, self.supersample, self.roll)
        side = min(max_tile, limits["max_texture_size"], *limits["max_viewport_dims"])
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        self._tile = (min(side, wide), min(side, high))
        layers = 1
        if self._is_layered:
            image = 8 * self._tile[0] * self._tile[1]
            layers = max(1, min(MAX_POSES, limits["max_array_layers"], image_budget // image))
        self._max_faces = min(max_faces, self.mesh.n_faces)
        if known.has_ssbo:
            # A counter a face and one for background must fit one storage block, for each layer.
            counters = int(limits["max_ssbo_bytes"]) // 4
            self._max_faces = min(self._max_faces, counters - 1)
            layers = min(layers, counters // (self._max_faces + 1))
        self._layers = layers

        arena.use()
        flags = {"LAYERED": self._is_layered, "ROLLED": grid.is_rolled}
        defines = {"MAX_POSES": MAX_POSES} | {name: 1 for name in flags if flags[name]}
        version = 430 if known.has_ssbo else 330
        names = ("face", "drawn" if known.has_ssbo else "peel")
        self._programs = {name: arena.program(name, version, **defines) for name in names}
        self._poses = arena.buffer("poses", size=96 * MAX_POSES)
        width, height = (max(self._tile[0], canary.WIDTH), max(self._tile[1], canary.HEIGHT))
        self._targets = [Target(arena, width, height, layers)]
        if known.has_ssbo:
            stride = max(self._max_faces, canary.MESH.n_faces) + 1
            self._counters = arena.buffer("face counters", size=4 * layers * stride)
        else:
            self._targets.append(Target(arena, width, height, 1))
        if self._is_layered:
            self._counting = arena.compute("count", version, **defines)
        programs, most = self._programs, self._max_faces
        self._scene = Scene(arena, programs, self.mesh, camera, grid, most)
        # Not rolled, so that its counts are known; the programs are those of the rolled grid.
        plain = SampleGrid(canary.CAMERA)
        self._canary = Scene(arena, programs, canary.MESH, canary.CAMERA, plain, most)
        self._pixels = SampleGrid(camera)
        self._canary_view = 0

    # --- the contract ---------------------------------------------------------------------------

    def count(self, poses: ArrayLike, *, drawn: bool = True) -> FaceCounts:
        """Samples of each face in each pose; see `Rasterizer.count`."""
        matrices = valid_poses(poses)
        with self._current():
            return self._count(self._scene, matrices, drawn)

    def render(self, pose: ArrayLike) -> VisibilityBuffer:
        """Face index and depth at each pixel centre; see `Rasterizer.render`."""
        matrices = valid_poses(pose)
        if len(matrices) != 1:
            raise ConfigError(f"render takes one pose, got {len(matrices)}")
        shape = (self.camera.height, self.camera.width)
        face, depth = np.empty(shape, np.int32), np.empty(shape, np.float32)
        with self._current():
            views = Views(self._scene, matrices, self._pixels, self._arena.is_reversed)
            self._poses.write(views.records(np.array([0])))
            for tile in self._scene.tiles(self._tile, self._pixels):
                self._draw_faces(self._scene, views, np.array([0]), tile)
                x, y, width, height = tile
                part = np.s_[y : y + height, x : x + width]
                ids = self._arena.read_faces(self._targets[0], (0, 0, width, height))
                face[part] = ids.view(np.int32) - 1
                values = self._arena.read_depth(self._targets[0], (0, 0, width, height))
                depth[part] = views.depth(0, values)
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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @contextmanager
    def _current(self) -> Iterator[None]:
        if not self._is_open:
            raise DeviceError("this rasteriser is closed; open a new one")
        self._arena.use()
        self._poses.bind_to_uniform_block(0)
        yield
        self._arena.poll("drawing")

    # --- counting -------------------------------------------------------------------------------

    def _count(self, scene: Scene, poses: NDArray[np.float64], with_drawn: bool) -> FaceCounts:
        shape = (len(poses), scene.mesh.n_faces)
        visible = np.zeros(shape, np.int64)
        drawn = np.zeros(shape, np.int64) if with_drawn else None
        background = np.zeros(len(poses), np.int64)
        grid = scene.grid
        views = Views(scene, poses, grid, self._arena.is_reversed)
        for rows in self._batches(views):
            self._poses.write(views.records(rows))
            for tile in scene.tiles(self._tile, grid):
                self._draw_faces(scene, views, rows, tile)
                if self._is_layered:
                    seen, empty = self._count_on_device(scene, tile, len(rows))
                else:
                    seen, empty = self._count_here(scene, tile, views.boxes[rows[0]])
                visible[rows] += seen
                background[rows] += empty
                if drawn is not None:
                    drawn[rows] += self._count_drawn(scene, tile, len(rows))
            self._arena.poll("drawing")
            if scene is self._scene:
                self._poses_since_check += len(rows)
                if self._poses_since_check >= CANARY_EVERY:
                    self._check_device()
        wrong = np.flatnonzero(visible.sum(axis=1) + background != grid.n_samples)
        if wrong.size:
            row = int(wrong[0])
            raise self._distrust(
                f"counted {visible[row].sum() + background[row]} samples of {grid.n_samples}"
            )
        scale = grid.supersample
        return FaceCounts(visible, drawn, background, views.clipped, scale, self.info, self.roll)

    def _batches(self, views: Views) -> Iterator[IntArray]:
        """Rows of poses to draw together: culling is a property of a draw, so it never mixes."""
        for cull in (False, True):
            rows = np.flatnonzero(views.can_cull == cull)
            for start in range(0, len(rows), self._layers):
                yield rows[start : start + self._layers]

    def _draw_faces(self, scene: Scene, views: Views, rows: IntArray, tile: Box) -> None:
        can_cull = bool(views.can_cull[rows[0]])
        self._arena.clear(self._targets[0])
        self._begin(self._targets[0], tile, cull=can_cull)
        if can_cull and scene.can_draw_front and not self._is_layered:
            scene.draw_front(tile, views.grid, views.eyes[rows[0]])
        else:
            for part in scene.parts:
                scene.draw("face", tile, views.grid, len(rows), part)

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
            raise self._distrust(f"drew face {values.max() - 1} of {scene.mesh.n_faces}")
        # Sums of whole numbers in float64 are exact far beyond any image.
        counts = np.bincount(values, weights=lengths, minlength=scene.mesh.n_faces + 1)
        return counts.astype(np.int64)

    def _count_on_device(self, scene: Scene, tile: Box, poses: int) -> tuple[IntArray, Any]:
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
            windows.append(self._arena.read_counters(self._counters, poses, n + 1))
        return np.concatenate([w[:, 1:] for w in windows], axis=1), windows[0][:, 0]

    def _count_drawn(self, scene: Scene, tile: Box, poses: int) -> IntArray:
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
                windows.append(self._arena.read_counters(self._counters, poses, part[1] + 1)[:, 1:])
        finally:
            frame.color_mask = (True,) * 4  # after an interrupt, too, or later images stay empty
        return np.concatenate(windows, axis=1)

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

    # --- trust ----------------------------------------------------------------------------------

    def _check_device(self) -> None:
        """Count a scene whose counts are known, with the same programs, images and buffers."""
        self._poses_since_check = 0
        with self._current():
            view = self._canary_view
            self._canary_view = 1 - view
            counts = self._count(self._canary, canary.POSES[[view]], with_drawn=True)
        if not np.array_equal(counts.visible[0], canary.VISIBLE[view]):
            raise self._distrust("drew a known scene wrongly")
        assert counts.drawn is not None
        if not np.array_equal(counts.drawn, canary.DRAWN[[view]]):
            raise self._distrust("counted a known scene wrongly")

    def _distrust(self, what: str) -> DeviceError:
        return DeviceError(
            f"{self.info.renderer} {what}; its answers cannot be trusted, see `rastercov doctor`"
        )
