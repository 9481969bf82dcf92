"""Strategy of the plan "pipeline": the graphics pipeline.

Each face is drawn with its index + 1 as colour into a 32-bit integer image; the depth buffer keeps
the nearest. Depth is float32 and reversed (near is 1, infinity 0), which gives the same relative
precision at every distance. The mesh is uploaded once. Poses are drawn one at a time, and their ids
are read back and counted by numpy: on Mesa's llvmpipe that is a copy in memory.

`drawn` counts come from a second pass without the depth test, where every sample adds one to its
face's counter.

N. Reed. Depth Precision Visualized. 2015, for the reversed depth buffer.
"""

from functools import partial

import moderngl
import numpy as np

from rastercov.base import ByName, Float32Array, FloatArray, Int32Array, IntArray
from rastercov.core.camera import Camera
from rastercov.core.camera.pose import limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.gl.resources import Resources, Target, set_uniforms
from rastercov.gl.strategy import COUNTER_BYTES, Counts, Strategy

COUNTS_BINDING, RUNS_BINDING = 0, 1  # storage buffers


class DeviceScene:
    """Mesh on the device with its camera.

    Positions are relative to the centre of the mesh and uploaded as sums of two floats. `programs`
    are those that draw the mesh, by fragment shader.
    """

    def __init__(
        self,
        resources: Resources,
        mesh: Mesh,
        camera: Camera,
        grid: SampleGrid,
        programs: ByName,
    ) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.centre
        self._programs = programs
        high, low = split_floats(mesh.vertices - self.centre)
        positions = np.concatenate((high, low), axis=1)
        corners = resources.buffer("vertices", positions[mesh.faces.ravel()])
        vertices = corners, "3f 3f", "position_high", "position_low"

        # Samples of each row inside the image, for shaders that count a rotated grid.
        self.runs = None
        if "corner" in programs["drawn"]:
            self.runs = resources.buffer("rows of samples", grid.runs.T)
        self._drawables = {
            name: resources.own(resources.gl.vertex_array(program, (vertices,)))
            for name, program in programs.items()
        }

    def draw(self, program: str, tile: Box, grid: SampleGrid) -> None:
        """Draw the faces by a program into a tile."""
        set_uniforms(self._programs[program], corner=tile[:2], image=_projection(tile, grid))
        self._drawables[program].render(moderngl.TRIANGLES)


class PreparedPoses:
    """Poses of a scene, for a grid of samples.

    Attributes
    ----------
    grid : SampleGrid
        As given.
    near : (P,) float64
        Depths of the near plane.
    clipped : (P,) bool
        Whether the near plane cuts a surface in view.
    can_cull : (P,) bool
        Whether back faces can be left out.
    axes : (P, 3, 3) float64
        Camera axes, in columns.
    eyes : pair of (P, 3) float32
        Camera centres from that of the mesh, as sums of two floats.
    """

    def __init__(self, scene: DeviceScene, poses: FloatArray, grid: SampleGrid) -> None:
        self.grid, self.axes = grid, grid.axes(poses)[:, :3, :3]
        # Reversed depth in float32 has one relative precision, however near this plane is.
        self.near, self.can_cull, self.clipped = limits(scene.mesh, scene.camera, poses)
        self.eyes = split_floats(poses[:, :3, 3] - scene.centre)

    def uniforms(self, row: int) -> dict[str, object]:
        """Uniforms of face.vert for a pose."""
        right, down, forward = self.axes[row].T.tolist()
        high, low = (each[row].tolist() for each in self.eyes)
        axes: dict[str, object] = {"right": right, "down": down, "forward": forward}
        return axes | {"eye_high": high, "eye_low": low, "near": self.near[row]}


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
        self.scene = partial(DeviceScene, programs=self._programs)
        width, height = max(self.tile[0], self_test.WIDTH), max(self.tile[1], self_test.HEIGHT)
        self._target = Target(resources, width, height)
        stride = max(mesh.n_faces, self_test.MESH.n_faces) + 1
        self._counters = resources.buffer("face counters", size=COUNTER_BYTES * stride)

    def begin(self, prepared: PreparedPoses, rows: slice) -> None:
        """Take the pose of a batch."""
        for program in self._programs.values():
            set_uniforms(program, **prepared.uniforms(rows.start))

    def count(
        self, scene: DeviceScene, prepared: PreparedPoses, rows: slice, tile: Box, *, drawn: bool
    ) -> tuple[Counts, Counts]:
        """Draw a batch into a tile: visible samples, and drawn ones, (L, B, F); background (B,)."""
        self._draw_faces(scene, prepared, rows, tile)
        visible = self._count_ids(scene, tile)[None]
        if not drawn:
            return visible[None, :, 1:], visible[:, 0]
        both = np.stack((visible, self._count_pixels(scene, tile)))
        return both[:, :, 1:], visible[:, 0]

    def image(
        self, scene: DeviceScene, prepared: PreparedPoses, tile: Box
    ) -> tuple[Int32Array, Float32Array]:
        """Draw the first pose into a tile: faces and depths, as in `VisibilityBuffer`."""
        self._draw_faces(scene, prepared, slice(0, 1), tile)
        ids = self._resources.read_faces(self._target, (0, 0, *tile[2:]))
        values = self._resources.read_depth(self._target, (0, 0, *tile[2:]))
        with np.errstate(divide="ignore"):
            depth = prepared.near[0] / values.astype(np.float64)
        return ids.view(np.int32) - 1, depth.astype(np.float32)

    def _draw_faces(
        self, scene: DeviceScene, prepared: PreparedPoses, rows: slice, tile: Box
    ) -> None:
        """Draw the nearest faces of a pose into the triangle-ID image."""
        self._resources.clear(self._target)
        self._begin(tile, cull=bool(prepared.can_cull[rows.start]))
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
        n_faces, last = scene.mesh.n_faces, ids.max(initial=0)  # none in a corner of a rotated grid
        if last > n_faces:
            raise self._resources.distrust(f"drew face {last - 1} of {n_faces}")
        return np.bincount(ids, minlength=n_faces + 1)

    def _count_pixels(self, scene: DeviceScene, tile: Box) -> IntArray:
        """Samples of each face alone: without the depth test, every sample adds to a counter.

        What this leaves in the image is not defined; each begins by clearing it.
        """
        self._counters.bind_to_storage_buffer(COUNTS_BINDING)
        if scene.runs is not None:
            scene.runs.bind_to_storage_buffer(RUNS_BINDING)
        self._begin(tile, test=False)
        self._resources.zero(self._counters, self._counters.size)
        scene.draw("drawn", tile, scene.grid)
        counts = self._resources.read_words(self._counters, 1, scene.mesh.n_faces + 1)
        return counts.astype(np.int64)


def _projection(tile: Box, grid: SampleGrid) -> tuple[float, ...]:
    """Map from camera axes to clip space: x = fx X/Z + cx becomes 2 x/width - 1."""
    x, y, width, height = tile
    fx, fy, cx, cy = grid.lens.tolist()
    return 2 * fx / width, 2 * fy / height, 2 * (cx - x) / width - 1, 2 * (cy - y) / height - 1


def split_floats(values: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Two floats whose sum is each double, to 48 bits."""
    high = values.astype(np.float32)
    return high, (values - high).astype(np.float32)
