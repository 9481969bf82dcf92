"""Data of the graphics pipeline on the device: the mesh, uploaded once, and poses, once a batch.

The device interpolates depth.
"""

import moderngl
import numpy as np

from rastercov.base import ByName, Float32Array, FloatArray
from rastercov.core.camera import Camera
from rastercov.core.camera.near_plane import limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.gl.resources import Resources, set_uniforms


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

    def depth(self, row: int, values: Float32Array) -> Float32Array:
        """Camera z of depth buffer values of a pose, in metres; inf for the farthest value."""
        with np.errstate(divide="ignore"):
            z: Float32Array = (self.near[row] / values.astype(np.float64)).astype(np.float32)
        return z


def _projection(tile: Box, grid: SampleGrid) -> tuple[float, ...]:
    """Map from camera axes to clip space: x = fx X/Z + cx becomes 2 x/width - 1."""
    x, y, width, height = tile
    fx, fy, cx, cy = grid.lens.tolist()
    return 2 * fx / width, 2 * fy / height, 2 * (cx - x) / width - 1, 2 * (cy - y) / height - 1


def split_floats(values: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Two floats whose sum is each double, to 48 bits."""
    high = values.astype(np.float32)
    return high, (values - high).astype(np.float32)
