"""The plan "compute": compute shaders fill the triangles, without the graphics pipeline.

For data-centre GPUs, of which little can draw and all can compute. `shaders/raster.comp.glsl` says
how triangles are filled; here is what goes to the device and in which order. A batch of poses takes
these steps, and only counts come back:

1. clear the keys, 64 bits a sample: inverse depth, then which face;
2. project, clip and fill all faces of all poses, larger ones by way of a queue;
3. without 64-bit atomics once more, to find the faces that have the depths found;
4. count the faces in the keys; and all of it again, in parts, if the queue was too small.

The numbers are those of the CPU rasteriser, so its near plane is used, not the fitted one.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.errors import ResourceError
from rastercov.mesh import Mesh
from rastercov.raster import self_test as canary
from rastercov.raster.gl.resources import Arena
from rastercov.raster.gl.strategy import FloatArray, Limits, WordArray, side_by_side
from rastercov.raster.rules import in_one_order, limits
from rastercov.raster.sample_grid import Box, SampleGrid

MAX_POSES = 256
"""Poses in one batch, as far as the limits allow: enough to fill a large device."""
MAX_FACES = 65535 * 64
"""Faces of one dispatch, 64 a workgroup."""
SMALL = 64
"""Samples of the box about a triangle that one invocation fills by itself."""
ROWS = 32
"""Rows of a larger triangle that one workgroup fills."""
MAX_PIECES = 1 << 18
"""Room in the queue of pieces of larger triangles, unless 64 faces can need more."""
PIECE_BYTES, EMPTY = 72, np.array((0, 1, 1, 0), np.uint32)
HEAD_WORDS = 6
"""Of the queue: `EMPTY`, whether it was too small, and none."""
FAN = 6
"""Triangles that a clipped face can have."""
FAR_OUT = 1 << 25
"""Steps of 1/256 sample from the tile beyond which triangles are clipped: products of two such
lengths are whole numbers below 2^53, which a double holds."""
KEY_BYTES = 8
COUNTS, RUNS, KEYS, QUEUE, POSES, VERTICES, FACES = range(7)  # bindings of storage buffers


class ComputeScene:
    """A mesh on the device, with vertices from its middle and corners in the order for ties."""

    def __init__(
        self, arena: Arena, mesh: Mesh, camera: Camera, grid: SampleGrid, max_faces: int
    ) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.bounds.mean(axis=0)
        self.vertices = arena.buffer("vertices", mesh.vertices - self.centre)
        self.faces = arena.buffer("faces", in_one_order(mesh).astype(np.uint32))
        self.parts = [
            (first, min(max_faces, mesh.n_faces - first))
            for first in range(0, mesh.n_faces, max_faces)
        ]


class ComputeViews:
    """Poses of a scene, made ready to be drawn for a grid of samples.

    Attributes
    ----------
    runs : (height, 2) int32
        Samples of each row inside the image: the first, and the one after the last.
    near, clipped : (P,) float64, (P,) bool
        Near plane, and whether it cuts a surface in view.
    records : (P, 24) float64
        Entries of the buffer of poses.
    """

    def __init__(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> None:
        self.runs = np.stack((grid.first, grid.last), axis=1)
        self.near, cull, self.clipped = limits(scene.mesh, scene.camera, poses)
        fields = np.zeros((len(poses), 6, 4))
        fields[:, :4, :3] = grid.axes(poses)[:, :3].transpose(0, 2, 1)
        fields[:, 3, :3] -= scene.centre
        fields[:, 4] = grid.lens
        fields[:, 5, 0], fields[:, 5, 1] = self.near, cull
        self.records = fields.reshape(-1, 24)


class Compute:
    """`rastercov.raster.gl.strategy.Plan` in compute shaders.

    Parameters
    ----------
    arena : Arena
        Where everything lives; in use.
    mesh, camera, grid
        The largest scene that will be drawn.
    limits : Limits
        As given to the rasteriser; `images` holds counters, too.

    Raises
    ------
    ResourceError
        When the device has no storage block for the mesh.
    """

    depth = "float32 1/z"

    def __init__(
        self, arena: Arena, mesh: Mesh, camera: Camera, grid: SampleGrid, limits: Limits
    ) -> None:
        self._arena = arena
        known = arena.context.info
        block = int(known.limits["max_ssbo_bytes"])
        needed = max(24 * mesh.n_vertices, 12 * mesh.n_faces)
        if needed > block:
            raise ResourceError(
                f"plan 'compute' needs the mesh in storage blocks of {needed:,} bytes, "
                f"{known.renderer} has {block:,}; use another plan or backend 'cpu'"
            )
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        width = min(limits.tile, wide, block // KEY_BYTES)
        self.tile = (width, min(limits.tile, high, block // (KEY_BYTES * width)))
        self._max_faces = min(limits.faces, mesh.n_faces, MAX_FACES, block // 4 - 1)
        keys = KEY_BYTES * max(self.tile[0] * self.tile[1], canary.WIDTH * canary.HEIGHT)
        counters = 4 * (max(self._max_faces, canary.MESH.n_faces) + 1)
        fitting = min(limits.images // (keys + counters), block // max(keys, counters))
        self._layers = max(1, min(MAX_POSES, fitting))

        pieces = 2 * self._layers * max(self._max_faces, canary.MESH.n_faces)
        least = 64 * FAN * -(-max(self.tile[1], canary.HEIGHT) // ROWS)
        self._room = max(least, min(MAX_PIECES, pieces))
        self._faces_at_once, self._poses_at_once = MAX_FACES, MAX_POSES
        defines = {"SMALL": SMALL, "ROWS": ROWS, "FAR_OUT": FAR_OUT}
        self._passes = 2
        if known.has_int64_atomics:
            defines["ATOMIC64"] = self._passes = 1
        self._filling = arena.compute("raster", 430, **defines)
        self._filling_pieces = arena.compute("raster", 430, QUEUED=1, **defines)
        self._counting = arena.compute("count", 430, KEYS=1, ROLLED=1)
        self._poses = arena.buffer("poses", size=24 * 8 * self._layers)
        self._keys = arena.buffer("depths and faces", size=keys * self._layers)
        self._counters = arena.buffer("face counters", size=counters * self._layers)
        self._queue = arena.buffer("queue", size=4 * HEAD_WORDS + PIECE_BYTES * self._room)
        self._runs = arena.buffer("rows of samples", size=8 * max(high, canary.HEIGHT))

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> ComputeScene:
        """Send a mesh to the device."""
        return ComputeScene(self._arena, mesh, camera, grid, self._max_faces)

    def views(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> ComputeViews:
        """Make poses ready to be drawn."""
        return ComputeViews(scene, poses, grid)

    def batches(self, views: ComputeViews) -> Iterator[slice]:
        """Rows of poses to draw together."""
        n_poses = len(views.records)
        for start in range(0, n_poses, self._layers):
            yield slice(start, min(start + self._layers, n_poses))

    def begin(self, views: ComputeViews, rows: slice) -> None:
        """Send the poses of a batch to the device."""
        self._poses.write(views.records[rows])
        self._runs.write(views.runs)

    def count(
        self, scene: ComputeScene, views: ComputeViews, rows: slice, tile: Box, *, drawn: bool
    ) -> tuple[WordArray, WordArray, WordArray | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""
        n_poses = rows.stop - rows.start
        while True:
            alone = self._draw(scene, n_poses, tile, drawn=drawn)
            seen, background = self._count_on_device(scene, tile, n_poses)
            if self._had_room(scene, n_poses):
                return seen, background, alone

    def image(
        self, scene: ComputeScene, views: ComputeViews, tile: Box
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Draw the first of the views into a tile: faces and depths, as in `VisibilityBuffer`."""
        while True:
            self._draw(scene, 1, tile, drawn=False)
            if self._had_room(scene, 1):
                break
        owner, inverse = np.moveaxis(self._arena.read_words(self._keys, tile[3], tile[2], 2), 2, 0)
        face = np.where(owner == 0, -1, (~owner).view(np.int32) - 1)
        inverse_depth = np.ascontiguousarray(inverse).view(np.float32).astype(np.float64)
        with np.errstate(divide="ignore"):
            depth = (1 / inverse_depth).astype(np.float32)
        # A face cut at the near plane can own a sample 1/512 of one beyond its rim.
        return face, np.maximum(depth, np.float32(views.near[0]))

    def _draw(self, scene: ComputeScene, poses: int, tile: Box, *, drawn: bool) -> WordArray | None:
        """Find the nearest face at each sample; the samples each face would own alone, if asked."""
        windows = []
        self._bind(scene)
        self._clear(poses * tile[2] * tile[3])
        self._arena.zero(self._queue, 4 * HEAD_WORDS)
        for which_pass in range(self._passes):
            is_asked = drawn and which_pass == 0
            for first, n in scene.parts:
                for program in (self._filling, self._filling_pieces):
                    _set(
                        program, size=tile[2:], corner=tile[:2], with_drawn=is_asked,
                        first_face=first, stride=n + 1, capacity=self._room, which_pass=which_pass,
                    )  # fmt: skip
                if is_asked:
                    self._arena.zero(self._counters, 4 * poses * (n + 1))
                for face in range(first, first + n, self._faces_at_once):
                    for pose in range(0, poses, self._poses_at_once):
                        faces = min(self._faces_at_once, first + n - face)
                        self._fill(face, faces, pose, min(self._poses_at_once, poses - pose))
                if is_asked:
                    windows.append(self._arena.read_words(self._counters, poses, n + 1))
        return side_by_side(windows) if drawn else None

    def _clear(self, n_samples: int) -> None:
        self._arena.zero(self._keys, KEY_BYTES * n_samples)

    def _fill(self, first: int, faces: int, first_pose: int, poses: int) -> None:
        """Fill the small triangles of some faces, then the pieces of the larger ones."""
        _set(self._filling, faces_to_draw=(first, first + faces), first_pose=first_pose)
        self._queue.write(EMPTY)
        self._filling.run(-(-faces // 64), 1, poses)
        self._arena.gl.memory_barrier()
        self._filling_pieces.run_indirect(self._queue)
        self._arena.gl.memory_barrier()

    def _had_room(self, scene: ComputeScene, poses: int) -> bool:
        """Whether the queue held all pieces; if not, from now on less is drawn at once.

        Raises
        ------
        DeviceError
            When it says it had none for what it must have room for.
        """
        if not self._arena.read_words(self._queue, HEAD_WORDS)[4]:
            return True
        if (faces := min(self._faces_at_once, scene.mesh.n_faces)) > 64:
            self._faces_at_once = faces // 2
        elif (at_once := min(self._poses_at_once, poses)) > 1:
            self._poses_at_once = at_once // 2
        else:
            raise self._arena.distrust("has no room for the pieces of 64 faces")
        return False

    def _count_on_device(
        self, scene: ComputeScene, tile: Box, poses: int
    ) -> tuple[WordArray, WordArray]:
        """Count the keys of a batch, in windows of faces that fit."""
        columns, lines = -(-tile[2] // 128), -(-tile[3] // 8)  # 8 x 8 invocations, runs of 16
        windows = []
        for first, n in scene.parts:
            _set(self._counting, corner=tile[:2], size=tile[2:], stride=n + 1, first_face=first)
            self._arena.zero(self._counters, 4 * poses * (n + 1))
            self._counting.run(columns, lines, poses)
            windows.append(self._arena.read_words(self._counters, poses, n + 1))
        return side_by_side(windows), windows[0][:, 0]

    def _bind(self, scene: ComputeScene) -> None:
        for binding, buffer in (
            (COUNTS, self._counters),
            (RUNS, self._runs),
            (KEYS, self._keys),
            (QUEUE, self._queue),
            (POSES, self._poses),
            (VERTICES, scene.vertices),
            (FACES, scene.faces),
        ):
            buffer.bind_to_storage_buffer(binding)


def _set(program: Any, **uniforms: Any) -> None:
    """Give uniforms their values; a program need not have all of them."""
    for name, value in uniforms.items():
        if name in program:
            program[name].value = value
