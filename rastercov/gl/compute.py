"""Strategy of the plan "compute": compute shaders fill the triangles.

For data-centre GPUs, most of whose units can compute but not rasterise. `shaders/raster.comp.glsl`
describes the fill; this module orders the passes. A batch of poses takes these steps, and only
counts are read back:

1. clear the keys, 64 bits a sample: inverse depth, then face index;
2. project, clip and fill all faces of all poses, larger ones through a queue;
3. without 64-bit atomics, a second pass to find the faces that have the depths found;
4. count the faces in the keys; repeat all steps in parts if the queue was too small.

Results equal those of the CPU rasteriser, so its near plane is used, not the one fitted to a pose.
"""

from collections.abc import Iterator

import numpy as np

from rastercov.base import Float32Array, FloatArray, Int32Array
from rastercov.core.camera import Camera
from rastercov.core.camera.near_plane import limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.core.raster.tie_order import in_one_order
from rastercov.gl.resources import Resources, set_uniforms
from rastercov.gl.strategy import COUNTER_BYTES, Strategy, WordArray

MAX_POSES = 256  # poses in one batch, within the limits of memory: enough to fill a large device
GROUP_FACES = 64  # faces of a workgroup, local_size_x of raster.comp
MAX_FACES = 65535 * GROUP_FACES  # faces of one dispatch; OpenGL guarantees 65,535 workgroups
SMALL = 64  # samples of the largest bounding box of a triangle that one invocation fills
ROWS = 32  # rows of a larger triangle that one workgroup fills
MAX_FAN = 6  # most triangles of a clipped face
MAX_PIECES = 1 << 18
"""Capacity of the queue of pieces of larger triangles, unless `GROUP_FACES` faces can need more."""
EMPTY = np.array((0, 1, 1, 0), np.uint32)  # start of the queue: workgroups x, y, z, pieces
HEAD_WORDS, IS_FULL = 6, 4  # words before the pieces, and which of them is set by an overflow
FAR_OUT = 1 << 25
"""Steps of 1/256 sample from the tile beyond which triangles are clipped: products of two such
lengths are integers below 2^53, which a double holds exactly."""
KEY_BYTES, PIECE_BYTES, VERTEX_BYTES, CORNERS_BYTES, RUN_BYTES = 8, 72, 24, 12, 8
"""Bytes of a sample's key, a struct `Piece`, a vertex (3 doubles), a face, a row of samples."""
# Rows of struct Pose of raster.comp, dvec4; the last is (near, cull).
RIGHT, DOWN, FORWARD, EYE, LENS, NEAR_AND_CULL, RECORD_ROWS = range(7)
RECORD_VALUES = 4 * RECORD_ROWS
COUNTS, RUNS, KEYS, QUEUE, POSES, VERTICES, FACES = range(7)  # bindings of storage buffers


class ComputeScene:
    """Mesh on the device: vertices relative to its centre, corners in the order for ties."""

    def __init__(self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.centre
        self.vertices = resources.buffer("vertices", mesh.vertices - self.centre)
        self.faces = resources.buffer("faces", in_one_order(mesh).astype(np.uint32))


class ComputePoses:
    """Storage buffers of the poses of a scene, for a grid of samples.

    Attributes
    ----------
    runs : (height, 2) int32
        First sample of each row inside the image, and the one after its last.
    near, clipped : (P,) float64, (P,) bool
        Near plane, and whether it cuts a surface in view.
    records : (P, 24) float64
        Entries of the buffer of poses, structs `Pose`.
    """

    def __init__(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> None:
        self.runs = np.ascontiguousarray(grid.runs.T)
        self.near, cull, self.clipped = limits(scene.mesh, scene.camera, poses)
        fields = np.zeros((len(poses), RECORD_ROWS, 4))
        fields[:, : EYE + 1, :3] = grid.axes(poses)[:, :3].transpose(0, 2, 1)
        fields[:, EYE, :3] -= scene.centre
        fields[:, LENS] = grid.lens
        fields[:, NEAR_AND_CULL, :2] = np.stack((self.near, cull), axis=1)
        self.records = fields.reshape(-1, RECORD_VALUES)


class Compute(Strategy):
    """`Strategy` on compute shaders; `image_budget` covers counters, too."""

    depth = "float32 1/z"

    def __init__(self, resources: Resources, mesh: Mesh, camera: Camera, grid: SampleGrid) -> None:
        super().__init__(resources, mesh, CORNERS_BYTES, VERTEX_BYTES * mesh.n_vertices)
        block = self._block
        wide, high = max(grid.width, camera.width), max(grid.height, camera.height)
        width = min(self.max_tile, wide, block // KEY_BYTES)
        self.tile = (width, min(self.max_tile, high, block // (KEY_BYTES * width)))
        n_samples = max(self.tile[0] * self.tile[1], self_test.WIDTH * self_test.HEIGHT)
        most_faces = max(mesh.n_faces, self_test.MESH.n_faces)
        key_bytes, counter_bytes = KEY_BYTES * n_samples, COUNTER_BYTES * (most_faces + 1)
        in_budget = self.image_budget // (key_bytes + counter_bytes)
        fitting = min(in_budget, block // max(key_bytes, counter_bytes))
        self._layers = max(1, min(MAX_POSES, fitting))
        pieces = min(2 * self._layers * most_faces, block // PIECE_BYTES)
        pieces_of_face = MAX_FAN * -(-max(self.tile[1], self_test.HEIGHT) // ROWS)
        self._capacity = max(GROUP_FACES * pieces_of_face, min(MAX_PIECES, pieces))
        self._faces_at_once, self._poses_at_once = MAX_FACES, MAX_POSES
        defines = {"SMALL": SMALL, "ROWS": ROWS, "FAR_OUT": FAR_OUT}
        self._n_passes = 2
        if resources.context.info.has_int64_atomics:
            defines["ATOMIC64"] = self._n_passes = 1
        self._small = resources.compute("raster", **defines)
        self._pieces = resources.compute("raster", QUEUED=1, **defines)
        self._counting = resources.compute("count", KEYS=1, ROLLED=1)
        self._records = resources.buffer("poses", size=8 * RECORD_VALUES * self._layers)
        self._keys = resources.buffer("depths and faces", size=key_bytes * self._layers)
        self._counters = resources.buffer("face counters", size=counter_bytes * self._layers)
        queue_bytes = COUNTER_BYTES * HEAD_WORDS + PIECE_BYTES * self._capacity
        self._queue = resources.buffer("queue", size=queue_bytes)
        rows = max(grid.height, camera.height, self_test.HEIGHT)
        self._runs = resources.buffer("rows of samples", size=RUN_BYTES * rows)

    def scene(self, mesh: Mesh, camera: Camera, grid: SampleGrid) -> ComputeScene:
        """Upload a mesh."""
        return ComputeScene(self._resources, mesh, camera, grid)

    def prepare(self, scene: ComputeScene, poses: FloatArray, grid: SampleGrid) -> ComputePoses:
        """Compute the storage buffers of the poses."""
        return ComputePoses(scene, poses, grid)

    def batches(self, prepared: ComputePoses) -> Iterator[slice]:
        """Rows of the poses of each batch."""
        n_poses = len(prepared.near)
        for start in range(0, n_poses, self._layers):
            yield slice(start, min(start + self._layers, n_poses))

    def begin(self, prepared: ComputePoses, rows: slice) -> None:
        """Upload the poses of a batch."""
        self._records.write(prepared.records[rows])
        self._runs.write(prepared.runs)

    def count(
        self, scene: ComputeScene, prepared: ComputePoses, rows: slice, tile: Box, *, drawn: bool
    ) -> tuple[WordArray, WordArray, WordArray | None]:
        """Draw a batch into a tile: visible samples (B, F), background (B,), drawn samples."""
        n_poses = rows.stop - rows.start
        while True:
            drawn_counts = self._draw(scene, n_poses, tile, drawn=drawn)
            visible, background = self._count_on_device(scene.mesh.n_faces, tile, n_poses)
            if self._queue_sufficed(scene.mesh.n_faces, n_poses):
                return visible, background, drawn_counts

    def image(
        self, scene: ComputeScene, prepared: ComputePoses, tile: Box
    ) -> tuple[Int32Array, Float32Array]:
        """Draw the first pose into a tile: faces and depths, as in `VisibilityBuffer`."""
        while True:
            self._draw(scene, 1, tile, drawn=False)
            if self._queue_sufficed(scene.mesh.n_faces, 1):
                break
        keys = self._resources.read_words(self._keys, tile[3], tile[2], 2)
        owner, inverse = keys[..., 0], keys[..., 1].copy().view(np.float32)
        face = np.where(owner == 0, -1, (~owner).view(np.int32) - 1)
        with np.errstate(divide="ignore"):
            depth = (1 / inverse.astype(np.float64)).astype(np.float32)
        # A face cut at the near plane can cover a sample 1/512 sample beyond its edge.
        return face, np.maximum(depth, np.float32(prepared.near[0]))

    # --- steps ----------------------------------------------------------------------------------

    def _draw(
        self, scene: ComputeScene, n_poses: int, tile: Box, *, drawn: bool
    ) -> WordArray | None:
        """Fill the keys; with `drawn`, return the samples that each face covers alone."""
        buffers = {
            COUNTS: self._counters,
            RUNS: self._runs,
            KEYS: self._keys,
            QUEUE: self._queue,
            POSES: self._records,
            VERTICES: scene.vertices,
            FACES: scene.faces,
        }
        for binding, buffer in buffers.items():
            buffer.bind_to_storage_buffer(binding)
        self._clear(n_poses * tile[2] * tile[3])
        self._resources.zero(self._queue, COUNTER_BYTES * HEAD_WORDS)
        n_faces, counts = scene.mesh.n_faces, None
        for which_pass in range(self._n_passes):
            is_counted = drawn and which_pass == 0
            for program in (self._small, self._pieces):
                set_uniforms(
                    program,
                    size=tile[2:],
                    corner=tile[:2],
                    stride=n_faces + 1,
                    capacity=self._capacity,
                    with_drawn=is_counted,
                    which_pass=which_pass,
                )
            if is_counted:
                self._resources.zero(self._counters, COUNTER_BYTES * n_poses * (n_faces + 1))
            for face in range(0, n_faces, self._faces_at_once):
                faces = face, min(face + self._faces_at_once, n_faces)
                for pose in range(0, n_poses, self._poses_at_once):
                    self._fill(faces, pose, min(self._poses_at_once, n_poses - pose))
            if is_counted:
                counts = self._resources.read_words(self._counters, n_poses, n_faces + 1)[:, 1:]
        return counts

    def _clear(self, n_samples: int) -> None:
        self._resources.zero(self._keys, KEY_BYTES * n_samples)

    def _fill(self, faces: tuple[int, int], first_pose: int, n_poses: int) -> None:
        """Fill the small triangles of a range of faces, then the pieces of the larger ones."""
        set_uniforms(self._small, faces_to_draw=faces, first_view=first_pose)
        self._queue.write(EMPTY)
        self._small.run(-(-(faces[1] - faces[0]) // GROUP_FACES), 1, n_poses)
        self._resources.gl.memory_barrier()
        self._pieces.run_indirect(self._queue)
        self._resources.gl.memory_barrier()

    def _queue_sufficed(self, n_faces: int, poses: int) -> bool:
        """True when the queue held all pieces; if not, later draws take fewer faces or poses.

        Raises
        ------
        DeviceError
            When it was too small for a draw that always fits.
        """
        if not self._resources.read_words(self._queue, HEAD_WORDS)[IS_FULL]:
            return True
        if (faces := min(self._faces_at_once, n_faces)) > GROUP_FACES:
            self._faces_at_once = faces // 2
        elif (at_once := min(self._poses_at_once, poses)) > 1:
            self._poses_at_once = at_once // 2
        else:
            raise self._resources.untrusted(f"has no room for the pieces of {GROUP_FACES} faces")
        return False
