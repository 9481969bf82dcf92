"""Data of the graphics pipeline on the device: the mesh, uploaded once, and poses, once a batch.

Faces that overlap another face of the same plane (`coplanar`) are uploaded a second time, with
their corners in doubles, and drawn by the program "coplanar". It computes depth as the CPU does,
from the plane of the face, so equal surfaces get equal depths. All other faces have the depth that
the device interpolates, which costs less.
"""

from collections.abc import Iterable
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov.base import BoolArray, ByName, Float32Array, FloatArray, IntArray
from rastercov.core.camera import Camera, box_corners
from rastercov.core.camera.near_plane import can_cull, depth_range, limits
from rastercov.core.mesh import Mesh
from rastercov.core.raster.sample_grid import Box, SampleGrid
from rastercov.core.raster.tie_order import in_one_order
from rastercov.gl.resources import Resources, set_uniforms

NEAREST = ("face", "coplanar")
"""Programs that draw the nearest face, each a part of the faces; the others draw all faces."""
POSITIONS = "3f 3f", "position_high", "position_low"
PLANES = "3f8 3f8 3f8 3f8 1u 4x", "corner_a", "corner_b", "corner_c", "normal", "number"
PLANE = np.dtype([("doubles", np.float64, (4, 3)), ("number", np.uint32), ("", np.uint32)])
"""Layout of `PLANES`: three corners, a normal, face index + 1, padding."""
# Rows of struct Pose (vec4) and of struct Ray (dvec4) of face.vert.
RIGHT, DOWN, FORWARD, EYE_HIGH, EYE_LOW, NEAR, RECORD_ROWS = range(7)
EYE, RAYS_ROWS = 3, 4
RECORD_BYTES, RAYS_BYTES = 4 * 4 * RECORD_ROWS, 8 * 4 * RAYS_ROWS
INDEX_BYTES = 4
FIRST_REL = 1e-5
"""Distance of the near plane of parallel rays before the mesh, in its diagonals."""


class DeviceScene:
    """Mesh on the device with its camera.

    Positions are relative to the centre of the mesh and uploaded as sums of two floats. `programs`
    are those that draw the mesh, by fragment shader; the faces `overlapping`, (F,) bool, are drawn
    with the program "coplanar".
    """

    def __init__(
        self,
        resources: Resources,
        programs: ByName,
        mesh: Mesh,
        camera: Camera,
        grid: SampleGrid,
        overlapping: BoolArray,
    ) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.centre
        self._programs = programs
        faces = in_one_order(mesh)
        corners, indices = _number_by_last_corner(faces, mesh.n_vertices)
        high, low = split_floats(mesh.vertices - self.centre)
        positions = np.concatenate((high, low), axis=1)
        vertices = resources.buffer("vertices", positions[corners]), *POSITIONS

        def drawable(program: str, index_buffer: object, *layout: object) -> Any:
            return resources.own(
                resources.gl.vertex_array(
                    programs[program],
                    layout or (vertices,),
                    index_buffer=index_buffer,
                    index_element_size=INDEX_BYTES,
                )
            )

        # Samples of each row inside the image, for shaders that count a rotated grid.
        self.runs = None
        if "corner" in programs["drawn"]:
            self.runs = resources.buffer("rows of samples", grid.runs.T)
        all_faces = resources.buffer("faces", indices)
        self._drawables = {"drawn": drawable("drawn", all_faces)}
        self.has_overlaps = bool(overlapping.any())
        plain, coplanar = np.flatnonzero(~overlapping), np.flatnonzero(overlapping)
        if self.has_overlaps:
            sent, numbered = _number_by_last_corner(faces[coplanar], mesh.n_vertices)
            self._drawables["coplanar"] = drawable(
                "coplanar",
                resources.buffer("coplanar faces", numbered),
                (resources.buffer("vertices of coplanar faces", positions[sent]), *POSITIONS),
                (resources.buffer("planes", self._planes_of(faces, coplanar, len(sent))), *PLANES),
            )
            indices = indices[plain]
            all_faces = resources.buffer("other faces", indices) if len(plain) else None
        if len(plain):
            self._drawables["face"] = drawable("face", all_faces)

    def _planes_of(self, faces: IntArray, chosen: IntArray, n_vertices: int) -> NDArray[np.void]:
        """Attributes `PLANES` of the last corners of the chosen faces; 0 for all other vertices."""
        planes = np.zeros(n_vertices, PLANE)
        corners = self.mesh.vertices[faces[chosen]] - self.centre
        sides = corners[:, 1:] - corners[:, :1]
        sides /= np.abs(sides).max(axis=(1, 2), keepdims=True)  # no square under- or overflows
        planes["doubles"][: len(chosen), :3] = corners
        planes["doubles"][: len(chosen), 3] = np.cross(sides[:, 0], sides[:, 1])
        planes["number"][: len(chosen)] = chosen + 1
        return planes

    def draw(self, programs: Iterable[str], tile: Box, grid: SampleGrid) -> None:
        """Draw the faces of some programs into a tile."""
        for program in (each for each in programs if each in self._drawables):
            set_uniforms(
                self._programs[program],
                corner=tile[:2],
                middle=tuple(grid.lens[2:]),
                image=_projection(tile, grid),
            )
            self._drawables[program].render(moderngl.TRIANGLES)


class PreparedPoses:
    """Uniform blocks and state of the poses of a scene, for a grid of samples.

    Attributes
    ----------
    grid : SampleGrid
        As given.
    near : (P,) float64
        Depths of the near plane, fitted to the mesh in view.
    farthest : (P,) float64
        Depth C beyond the mesh of parallel rays, 0 of pinholes.
    clipped : (P,) bool
        Whether the near plane cuts a surface in view.
    can_cull : (P,) bool
        Whether back faces can be left out.
    records : (P, 6, 4) float32
        Entries of the uniform block, structs `Pose`.
    rays : (P, 4, 4) float64 or None
        Entries of the uniform block of rays; None without overlaps.
    """

    def __init__(self, scene: DeviceScene, poses: FloatArray, grid: SampleGrid) -> None:
        mesh, camera, self.grid = scene.mesh, scene.camera, grid
        self.records = np.zeros((len(poses), RECORD_ROWS, 4), np.float32)
        self.records[:, : FORWARD + 1, :3] = grid.axes(poses)[:, :3, :3].transpose(0, 2, 1)
        if camera.is_parallel:
            self._fill_parallel(scene, poses)
            return
        eyes, self.farthest = poses[:, :3, 3], np.zeros(len(poses))
        self.near, _, self.clipped = depth_range(
            mesh.vertices, mesh.faces, mesh.bounds, camera, poses
        )
        self.can_cull = can_cull(mesh, poses, self.clipped)

        if scene.has_overlaps:
            # Powers of 2, so depths in the buffer have the mantissa of the CPU's. Not where a
            # surface is cut: it must be cut at the near plane, and a power of 2 is nearer.
            power = 2.0 ** np.floor(np.log2(self.near))
            self.near = np.where(self.clipped, self.near, power)
        high, low = split_floats(eyes - scene.centre)
        self.records[:, EYE_HIGH, :3], self.records[:, EYE_LOW, :3] = high, low
        self.records[:, NEAR, 0] = self.near  # clip z = near, so depth = near / z in [0, 1]
        self.records[:, NEAR, 2] = 1.0
        self.rays = self._find_rays(poses, eyes - scene.centre) if scene.has_overlaps else None

    def _fill_parallel(self, scene: DeviceScene, poses: FloatArray) -> None:
        """State of parallel rays: (C - z) / (C - near) for the depth, C beyond the mesh.

        The eye moves along its axis to the depth of the middle of the mesh, so that no distance
        costs precision; the near plane moves to the mesh where it is before it.
        """
        mesh = scene.mesh
        near, self.can_cull, self.clipped = limits(mesh, scene.camera, poses)
        axes = poses[:, :3, 2]
        start = np.einsum("pi,pi->p", scene.centre - poses[:, :3, 3], axes)
        depth = (box_corners(mesh.bounds) - scene.centre) @ axes[:, :, None]
        first, last = depth.min(axis=(1, 2)) + start, depth.max(axis=(1, 2)) + start
        size = max(mesh.diagonal, 1e-300)
        self.near = np.maximum(near, first - FIRST_REL * size)
        self.farthest = np.maximum(last, self.near) + size
        eyes = poses[:, :3, 3] + start[:, None] * axes - scene.centre
        high, low = split_floats(eyes)
        self.records[:, EYE_HIGH, :3], self.records[:, EYE_LOW, :3] = high, low
        scale = 1 / (self.farthest - self.near)
        self.records[:, NEAR, 0] = scale * (self.farthest - start)
        self.records[:, NEAR, 1], self.records[:, NEAR, 3] = -scale, 1.0
        self.rays = None
        if scene.has_overlaps:
            self.rays = self._find_rays(poses, eyes)
            self.rays[:, RIGHT, 3], self.rays[:, FORWARD, 3] = scale, self.farthest - start

    def _find_rays(self, poses: FloatArray, eyes: FloatArray) -> FloatArray:
        """Entries of the uniform block of rays, (P, 4, 4)."""
        rays = np.zeros((len(poses), RAYS_ROWS, 4))
        # Map from x and y on the canvas at depth 1 to the world. The forward axis is perpendicular
        # to the other two, also when these are mixed to rotate the grid.
        axes = self.grid.axes(poses)[:, :3, :3]
        mixed = np.linalg.inv(axes.transpose(0, 2, 1)) if self.grid.is_rolled else axes
        rays[:, : DOWN + 1, :3] = (mixed[:, :, :2] / self.grid.lens[:2]).transpose(0, 2, 1)
        rays[:, FORWARD, :3], rays[:, EYE, :3] = poses[:, :3, 2], eyes
        rays[:, RIGHT, 3] = self.near
        return rays

    def depth(self, row: int, values: Float32Array) -> Float32Array:
        """Camera z of depth buffer values of a pose, in metres; inf for the farthest value."""
        inverse = values.astype(np.float64)
        with np.errstate(divide="ignore"):
            z = self.near[row] / inverse
        if self.farthest[row]:
            z = self.farthest[row] - inverse * (self.farthest[row] - self.near[row])
            z[values == 0] = np.inf
        return z.astype(np.float32)


def _projection(tile: Box, grid: SampleGrid) -> tuple[float, ...]:
    """Map from camera axes to clip space: x = fx X/Z + cx becomes 2 x/width - 1."""
    x, y, width, height = tile
    fx, fy, cx, cy = grid.lens.tolist()
    return 2 * fx / width, 2 * fy / height, 2 * (cx - x) / width - 1, 2 * (cy - y) / height - 1


def split_floats(values: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Two floats whose sum is each double, to 48 bits."""
    high = values.astype(np.float32)
    return high, (values - high).astype(np.float32)


def _number_by_last_corner(faces: IntArray, n_vertices: int) -> tuple[IntArray, NDArray[np.uint32]]:
    """Vertices to upload, (N,), and faces that index them, (F, 3): vertex f is f's last corner.

    The other two corners of a face may be any vertex uploaded for the same position; vertices that
    are the last corner of no face follow the first F.
    """
    n_faces = len(faces)
    sent = np.full(n_vertices, -1, np.int64)
    sent[faces[:, 2]] = np.arange(n_faces)
    others = np.unique(faces[:, :2][sent[faces[:, :2]] < 0])
    sent[others] = n_faces + np.arange(len(others))
    indices = np.empty((n_faces, 3), np.uint32)
    indices[:, :2] = sent[faces[:, :2]]
    indices[:, 2] = np.arange(n_faces)
    return np.concatenate((faces[:, 2], others)), indices
