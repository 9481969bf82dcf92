"""Strategy of the plan "compute": compute shaders fill triangles, tile by tile, in shared memory.

Most units of a GPU can compute and not rasterise. A batch of poses takes these steps, of which the
host reads three words between the third and the fourth, and counts at the end:

    setup.comp   a workgroup a cluster of faces and pose: leave it out, or project, clip and round
                 its faces, and keep what may cover a sample
    list.comp    count the triangles that may cover a tile of 32 x 32 samples, of each pose
    scan.comp    find exact room for the list of each tile, whatever the scene
    list.comp    enter the triangles in the lists
    fill.comp    a workgroup a tile: depth tests in shared memory, then counts

Where a batch needs more room than a storage block has, it is divided by poses, then by parts of the
canvas. Results equal those of the CPU rasteriser, bit for bit, so its near plane is used.

S. Laine, T. Karras. High-Performance Software Rasterization on GPUs. 2011.
"""

from collections.abc import Iterable
from typing import Any

import moderngl
import numpy as np

from rastercov.base import Float32Array, FloatArray, Int32Array, ResourceError, offsets_of
from rastercov.core.camera import Camera
from rastercov.core.camera.pose import limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.cpu import clusters_of, farthest_depths
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.core.raster.targets import in_one_order
from rastercov.gl.resources import Resources, set_uniforms
from rastercov.gl.strategy import COUNTER_BYTES, Counts, Strategy

MAX_POSES = 1024
"""Poses in one batch, within the limits of memory: enough to fill a large device."""
MOST_LISTED = 1 << 23
"""Entries of lists in one dispatch that fills tiles: below half a second where one takes 50 ns, 25
times what it takes a large GPU; drivers end a dispatch that takes seconds."""
GROUP_TRIANGLES, GROUP_LISTS = 64, 256  # of a workgroup: local_size_x of list.comp, scan.comp
MAX_GROUPS = 65535  # workgroups along one side of a dispatch that OpenGL guarantees
TILE, SMALL = 32, 32
"""Samples along the side of a tile; samples of a triangle in it that one invocation fills."""
GROUP, GROUP_IN_SOFTWARE = 128, 64
"""Invocations that fill a tile."""
KEY_BYTES, TRIANGLE_BYTES, VERTEX_BYTES, CORNERS_BYTES, RUN_BYTES = 8, 64, 24, 16, 8
"""Bytes of a sample's key, a struct `Triangle`, a vertex (3 doubles), a face, a row of samples."""
STATUS_BYTES, POSE_VALUES = 12, 16
"""Bytes of the numbers of triangles; doubles of a pose."""
CLUSTERS, POSES, VERTICES, FACES = 4, 5, 6, 7  # bindings of setup.comp
LISTS, COUNTS, RUNS = 5, 6, 7  # of list.comp and fill.comp; an image may be in place of counts
CLUSTER = np.dtype([("bounds", "11f8"), ("slots", "2u4")])  # struct `Cluster` of setup.comp


class ComputeScene:
    """Mesh on the device: vertices relative to its centre, faces by cluster, as on the CPU.

    Corners are in the order for ties.
    """

    def __init__(self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.centre
        _, corners, faces, _, _, starts, _, bounds = clusters_of(mesh)
        used = corners[: starts[-1]] > 0  # other slots are empty
        order = faces[: starts[-1]][used]
        clusters = np.zeros(len(starts) - 1, CLUSTER)
        clusters["bounds"] = bounds.T[: len(clusters)]
        ends = offsets_of(used)[starts]
        clusters["slots"] = np.stack((ends[:-1], ends[1:]), axis=1)
        rows = np.column_stack((in_one_order(mesh)[order], order)).astype(np.uint32)
        self.n_clusters = len(clusters)
        self.vertices = resources.buffer("vertices", mesh.vertices - self.centre)
        self.faces = resources.buffer("faces", rows)
        self.clusters = resources.buffer("clusters", clusters.view(np.uint8))


class ComputePoses:
    """Storage buffers of the poses of a scene, for a grid of samples.

    Attributes
    ----------
    runs : (height, 2) int32
        First sample of each row inside the image, and the one after its last.
    near, clipped : (P,) float64, (P,) bool
        Near plane, and whether it cuts a surface in view.
    farthest : (P,) float64
        `farthest_depths` of parallel rays, 0 of pinholes.
    records : (P, 16) float64
        Poses as they are, then near plane, whether back faces can be left out, and `farthest`.
    """

    def __init__(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> None:
        self.grid, self.runs = grid, np.ascontiguousarray(grid.runs.T)
        self.near, cull, self.clipped = limits(scene.mesh, scene.camera, poses)
        self.farthest: FloatArray = np.zeros(len(poses))
        if grid.is_parallel:
            self.farthest = farthest_depths(scene.mesh, poses, self.near)
        self.records = np.zeros((len(poses), POSE_VALUES))
        self.records[:, :12] = poses[:, :3].reshape(-1, 12)
        self.records[:, 12:15] = np.stack((self.near, cull, self.farthest), axis=1)


class Compute(Strategy):
    """`Strategy` on compute shaders; `image_budget` covers triangles and counters, too."""

    depth = "float32 1/z"
    scene = ComputeScene
    prepare = ComputePoses

    def __init__(self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid) -> None:
        super().__init__(resources, mesh, CORNERS_BYTES, VERTEX_BYTES * mesh.n_vertices)
        block = self.block
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        width = min(self.max_tile, wide, block // KEY_BYTES)
        self.tile = (width, min(self.max_tile, high, block // (KEY_BYTES * width)))
        most_faces = max(mesh.n_faces, self_test.MESH.n_faces)
        tiles = max(n_tiles(self.tile), n_tiles((self_test.WIDTH, self_test.HEIGHT)))
        sizes = {  # bytes a pose
            "poses": 8 * POSE_VALUES,
            "face counters": 2 * COUNTER_BYTES * (most_faces + 1),
            "lengths of lists": COUNTER_BYTES * tiles,
            "ends of lists": COUNTER_BYTES * tiles,
            # These two grow with what the scene needs.
            "triangles": TRIANGLE_BYTES * most_faces,
            "lists of triangles": COUNTER_BYTES * most_faces,
        }
        fitting = min(self.image_budget // sum(sizes.values()), block // max(sizes.values()))
        self.most_poses = max(1, min(MAX_POSES, fitting))
        info = resources.context.info
        defines = {"TILE": TILE, "SMALL": SMALL}
        defines["GROUP"] = GROUP_IN_SOFTWARE if info.is_software else GROUP
        defines |= {"ATOMIC64": 1} if info.has_int64_atomics else {}
        defines |= {"ROLLED": 1} if grid.is_rolled else {}
        self._setup, self._list, self._scan, self._fill = (
            resources.compute(name, **defines) for name in ("setup", "list", "scan", "fill")
        )
        self._fill_image = resources.compute("fill", KEYS=1, **defines)
        self._status = resources.buffer("numbers of triangles", size=STATUS_BYTES)
        rows = max(grid.height, camera.height, self_test.HEIGHT)
        self._runs = resources.buffer("rows of samples", size=RUN_BYTES * rows)
        self._image = resources.buffer("image", size=KEY_BYTES)
        while not self._allocate(sizes):
            self.most_poses //= 2

    def _allocate(self, sizes: dict[str, int]) -> bool:
        """Allocate buffers of a batch; False, and none, where memory is too short for them."""
        made = list[moderngl.Buffer]()
        try:
            for what, size in sizes.items():
                made.append(self._resources.buffer(what, size=size * self.most_poses))
        except ResourceError:
            if self.most_poses == 1:
                raise
            for each in made:
                each.orphan(COUNTER_BYTES)
            return False
        self.records, self.counters, self._lengths, self._ends, self._triangles, self._lists = made
        return True

    def begin(self, prepared: ComputePoses, rows: slice) -> None:
        """Upload the poses of a batch."""
        self._resources.write(self.records, prepared.records[rows])
        self._resources.write(self._runs, prepared.runs)
        grid = prepared.grid
        lens, turn = grid.lens.tolist(), grid.mix.ravel().tolist()
        set_uniforms(self._setup, lens=lens, turn=turn, is_parallel=grid.is_parallel)

    def count(
        self, scene: ComputeScene, prepared: ComputePoses, rows: slice, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Counts]:
        """Draw a batch into a tile: visible samples, and drawn ones, (L, B, F); background (B,)."""
        n_poses, stride, layers = rows.stop - rows.start, scene.mesh.n_faces + 1, 1 + drawn
        self.fill_counters(scene, n_poses, [tile], drawn=drawn, backs=drawn)
        counts = self._resources.read_words(self.counters, layers, n_poses, stride)
        return counts[:, :, 1:], counts[0, :, 0]

    def fill_counters(
        self, scene: ComputeScene, n_poses: int, tiles: Iterable[Box], *, drawn: bool, backs: bool
    ) -> None:
        """Count a batch in some tiles: (B, F + 1) from the background on, then drawn samples.

        Without `backs` those of faces that are left out because they cannot be seen are 0.
        """
        stride, layers = scene.mesh.n_faces + 1, 1 + drawn
        self._resources.zero(self.counters, COUNTER_BYTES * layers * n_poses * stride)
        set_uniforms(self._fill, stride=stride, first_drawn=n_poses * stride, with_drawn=drawn)
        set_uniforms(self._setup, with_backs=backs)
        for tile in tiles:
            self._draw(scene, range(n_poses), tile, self._fill, self.counters)

    def image(
        self, scene: ComputeScene, prepared: ComputePoses, tile: Box
    ) -> tuple[Int32Array, Float32Array]:
        """Draw the first pose into a tile: faces and depths, as in `VisibilityBuffer`."""
        self._resources.grow(self._image, KEY_BYTES * tile[2] * tile[3], "image")
        set_uniforms(self._setup, with_backs=False)
        set_uniforms(self._fill_image, image_corner=tile[:2], image_width=tile[2])
        self._draw(scene, range(1), tile, self._fill_image, self._image)
        keys = self._resources.read_words(self._image, tile[3], tile[2], 2)
        owner, inverse = keys[..., 0], keys[..., 1].copy().view(np.float32).astype(np.float64)
        face = np.where(owner == 0, -1, (~owner).view(np.int32) - 1)
        with np.errstate(divide="ignore"):
            depth = 1 / inverse
        if prepared.farthest[0]:
            depth = np.where(inverse > 0, prepared.farthest[0] - inverse, depth)
        # A face cut at the near plane can cover a sample 1/512 sample beyond its edge.
        return face, np.maximum(depth.astype(np.float32), np.float32(prepared.near[0]))

    # --- steps ----------------------------------------------------------------------------------

    def _draw(
        self, scene: ComputeScene, views: range, part: Box, fill: Any, result: moderngl.Buffer
    ) -> None:
        """Draw some poses of a batch into a part of the canvas, in as many turns as it needs."""
        n_triangles, n_listed = self._set_up(scene, views, part)
        room = self.block // TRIANGLE_BYTES, self.block // COUNTER_BYTES
        room = min(room[0], self._triangles.size // TRIANGLE_BYTES), room[1]
        list_bytes, what = COUNTER_BYTES * n_listed, "lists of triangles"
        if (
            n_triangles > room[0]
            or n_listed > room[1]
            or not self._resources.has_grown(self._lists, list_bytes, what)
        ):
            for some, smaller in self._halves(views, part):
                self._draw(scene, some, smaller, fill, result)
        else:
            self._bind({LISTS: self._lists, COUNTS: result, RUNS: self._runs})
            self._enter(n_triangles, writes=True)
            set_uniforms(fill, **self._place(views, part))
            self._fill_in_turns(fill, len(views), n_tiles_of(part), n_listed)

    def _fill_in_turns(
        self, fill: Any, n_views: int, tiles: tuple[int, int], n_listed: int
    ) -> None:
        """Fill the tiles of some poses, some poses or some rows of tiles of one at a time."""
        turns = min(max(1, -(-n_listed // MOST_LISTED)), n_views * tiles[1])
        n_rows = tiles[1] if turns <= n_views else max(1, n_views * tiles[1] // turns)
        step = max(1, n_views // turns)
        for view in range(0, n_views, step):
            for row in range(0, tiles[1], n_rows):
                set_uniforms(fill, first_group=(view, row))
                fill.run(tiles[0], min(n_rows, tiles[1] - row), min(step, n_views - view))
                self._resources.gl.memory_barrier()

    def _set_up(self, scene: ComputeScene, views: range, part: Box) -> tuple[int, int]:
        """Set up triangles and find where lists start; numbers of triangles and of entries."""
        n_lists, n_faces = len(views) * n_tiles(part[2:]), scene.mesh.n_faces
        room, uniforms = self.block // TRIANGLE_BYTES, self._place(views, part)
        while True:
            self._resources.zero(self._status, STATUS_BYTES)
            self._resources.zero(self._lengths, COUNTER_BYTES * n_lists)
            capacity = self._triangles.size // TRIANGLE_BYTES
            self._bind({POSES: self.records, VERTICES: scene.vertices})
            self._bind({FACES: scene.faces, CLUSTERS: scene.clusters})
            set_uniforms(self._setup, **uniforms, middle=scene.centre.tolist())
            for first in range(0, scene.n_clusters, MAX_GROUPS):
                set_uniforms(self._setup, first_cluster=first)
                self._setup.run(min(MAX_GROUPS, scene.n_clusters - first), 1, len(views))
            self._resources.gl.memory_barrier()
            set_uniforms(self._list, **uniforms)
            self._enter(min(capacity, n_faces * len(views)), writes=False)
            set_uniforms(self._scan, n_lists=n_lists)
            self._scan.run(min(MAX_GROUPS, -(-n_lists // GROUP_LISTS)))
            n_triangles, n_listed, is_beyond = self._resources.read_words(self._status, 3).tolist()
            size = self._triangles, TRIANGLE_BYTES * n_triangles
            if (
                n_triangles <= capacity
                or n_triangles > room
                or not self._resources.has_grown(*size, "triangles")
            ):
                return n_triangles, n_listed + (is_beyond << 32)

    def _place(self, views: range, part: Box) -> dict[str, object]:
        """Uniforms of some poses in a part of the canvas."""
        tiles = n_tiles_of(part)
        return {"first_view": views.start, "corner": part[:2], "size": part[2:], "tiles": tiles}

    def _bind(self, buffers: dict[int, moderngl.Buffer]) -> None:
        """Bind what all stages share, and the buffers of one."""
        shared = self._status, self._triangles, self._lengths, self._ends
        for binding, buffer in (dict(enumerate(shared)) | buffers).items():
            buffer.bind_to_storage_buffer(binding)

    def _enter(self, n_triangles: int, *, writes: bool) -> None:
        """Count the entries of lists, or write them."""
        set_uniforms(self._list, writes=writes)
        self._list.run(max(1, min(MAX_GROUPS, -(-n_triangles // GROUP_TRIANGLES))))
        self._resources.gl.memory_barrier()

    def _halves(self, views: range, part: Box) -> list[tuple[range, Box]]:
        """Poses in two halves; one pose in two parts of the canvas, along the borders of tiles."""
        if (n := len(views)) > 1:
            return [(views[: n // 2], part), (views[n // 2 :], part)]
        left, top, width, height = part
        across, down = n_tiles_of(part)
        if max(across, down) == 1:
            raise ResourceError(
                f"expected room for the triangles of a tile of {TILE} x {TILE} samples in storage "
                f"blocks of {self.block:,} bytes, got more triangles; use backend 'cpu'"
            )
        if across >= down:
            at = across // 2 * TILE
            parts = (left, top, at, height), (left + at, top, width - at, height)
        else:
            at = down // 2 * TILE
            parts = (left, top, width, at), (left, top + at, width, height - at)
        return [(views, each) for each in parts]


def n_tiles_of(part: Box) -> tuple[int, int]:
    """Tiles in a row of a part of the canvas, and rows of tiles."""
    return -(-part[2] // TILE), -(-part[3] // TILE)


def n_tiles(size: tuple[int, int]) -> int:
    """Tiles of a part of the canvas of some size."""
    across, down = n_tiles_of((0, 0, *size))
    return across * down
