"""Buffers of the device: a mesh, sent once, and the poses it is seen from, sent per batch.

Faces that lie on others in one plane (`coplanar`) go there a second time, with their corners in
doubles, to be drawn by the program "coplanar": it computes depth as the CPU does, from the plane of
the face, and so finds equal depths where surfaces are equal. All other faces have the depth that
the device interpolates, which costs less.
"""

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.projection import box_corners, depth_range, image_boxes
from rastercov.raster.gl.resources import Arena
from rastercov.raster.rules import can_cull, in_one_order
from rastercov.raster.sample_grid import Box, SampleGrid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NEAREST = frozenset(("face", "coplanar"))
"""Programs that draw the nearest face, each some of the faces; the others draw all."""
POSITIONS = "3f 3f", "position_high", "position_low"
PLANES = "3f8 3f8 3f8 3f8 1u 4x", "corner_a", "corner_b", "corner_c", "normal", "number"
PLANE = np.dtype([("doubles", np.float64, (4, 3)), ("number", np.uint32), ("", np.uint32)])
PIXELS_A_VERTEX = 64
"""Projecting a vertex costs as much as looking at some ten pixels."""


class Scene:
    """A mesh on the device, and the camera that looks at it.

    Positions are taken from the centre of the mesh in float64 and sent as two floats each.

    Parameters
    ----------
    arena : Arena
        Where the buffers live.
    programs : dict of str to moderngl.Program
        What may draw the mesh.
    mesh, camera
        As given to the rasteriser.
    grid : SampleGrid
        Samples to count.
    max_faces : int
        Most faces of one draw.
    overlapping : (F,) bool
        Faces to draw with the program "coplanar"; where none is, there need be no such program.
    """

    def __init__(
        self,
        arena: Arena,
        programs: dict[str, Any],
        mesh: Mesh,
        camera: Camera,
        grid: SampleGrid,
        max_faces: int,
        overlapping: BoolArray,
    ) -> None:
        self.mesh, self.camera, self.grid = mesh, camera, grid
        self.centre: FloatArray = mesh.bounds.mean(axis=0)
        # Points that span the mesh. Its vertices give the tighter box in the image, which pays
        # as long as there are few of them to the pixels that need not be looked at.
        few = mesh.n_vertices < camera.width * camera.height / PIXELS_A_VERTEX
        self.outline: FloatArray = mesh.vertices if few else box_corners(mesh.bounds)
        self._programs, self._max_faces = programs, max_faces
        self.parts = [
            (first, min(max_faces, mesh.n_faces - first))
            for first in range(0, mesh.n_faces, max_faces)
        ]
        faces = in_one_order(mesh)
        corners, indices = _numbered_by_last_corner(faces, mesh.n_vertices)
        high, low = split_floats(mesh.vertices - self.centre)
        positions = np.concatenate((high, low), axis=1)
        vertices = arena.buffer("vertices", positions[corners]), *POSITIONS

        def drawable(program: str, index_buffer: Any, *layout: Any) -> Any:
            return arena.own(
                arena.gl.vertex_array(
                    programs[program],
                    layout or (vertices,),
                    index_buffer=index_buffer,
                    index_element_size=4,
                )
            )

        # Where each row of samples is inside the image, for the shaders that count rolled ones.
        is_asked = "drawn" in programs and "corner" in programs["drawn"]
        runs = np.stack((grid.first, grid.last), axis=1) if is_asked else None
        self.runs = None if runs is None else arena.buffer("rows of samples", runs)
        all_faces = arena.buffer("faces", indices)
        self._drawables = {name: drawable(name, all_faces) for name in programs.keys() - NEAREST}
        self.has_overlaps = bool(overlapping.any())
        plain, chosen = np.flatnonzero(~overlapping), np.flatnonzero(overlapping)
        self._counts = {"face": len(plain), "coplanar": len(chosen)}
        if self.has_overlaps:
            at, numbered = _numbered_by_last_corner(faces[chosen], mesh.n_vertices)
            self._drawables["coplanar"] = drawable(
                "coplanar",
                arena.buffer("coplanar faces", numbered),
                (arena.buffer("vertices of coplanar faces", positions[at]), *POSITIONS),
                (arena.buffer("planes", self._planes_of(faces, chosen, len(at))), *PLANES),
            )
            indices = indices[plain]
            all_faces = arena.buffer("other faces", indices) if len(plain) else None
        if len(plain):
            self._drawables["face"] = drawable("face", all_faces)
        self.can_draw_front = mesh.can_cull_back_faces and 0 < len(plain) <= max_faces
        if self.can_draw_front:
            self._indices = indices
            self._planes = np.ascontiguousarray(mesh.normals[plain].T)
            middle = mesh.vertices[mesh.faces[plain, 0]] - self.centre
            self._offsets = np.einsum("if,fi->f", self._planes, middle)
            self._front_faces = arena.buffer("front faces", size=indices.nbytes)
            self._front_drawable = drawable("face", self._front_faces)

    def _planes_of(self, faces: IntArray, chosen: IntArray, n_vertices: int) -> NDArray[np.void]:
        """Attributes of the last corners of the chosen faces; the vertices after them have none."""
        planes = np.zeros(n_vertices, PLANE)
        corners = self.mesh.vertices[faces[chosen]] - self.centre
        sides = corners[:, 1:] - corners[:, :1]
        sides /= np.abs(sides).max(axis=(1, 2), keepdims=True)  # no square under- or overflows
        planes["doubles"][: len(chosen), :3] = corners
        planes["doubles"][: len(chosen), 3] = np.cross(sides[:, 0], sides[:, 1])
        planes["number"][: len(chosen)] = chosen + 1
        return planes

    def draw(
        self, program: str, tile: Box, grid: SampleGrid, poses: int, part: tuple[int, int]
    ) -> None:
        """Draw the faces [first, first + n) of `part` into a tile, once a pose.

        Counted among the faces that the program draws: all of them, but for those of `NEAREST`.
        """
        self._aim(program, tile, grid)
        uniforms = self._programs[program]
        for name, value in {
            "first_face": part[0],
            "stride": part[1] + 1,
            "corner": tile[:2],
            "middle": tuple(grid.lens[2:]),
        }.items():
            if name in uniforms:
                uniforms[name].value = value
        self._drawables[program].render(
            moderngl.TRIANGLES, vertices=3 * part[1], first=3 * part[0], instances=poses
        )

    def draw_nearest(self, tile: Box, grid: SampleGrid, poses: int) -> None:
        """Draw all faces into a tile, once a pose, under the depth test."""
        for program in self._counts:
            self._draw_nearest(program, tile, grid, poses)

    def draw_front(self, tile: Box, grid: SampleGrid, eye: FloatArray) -> None:
        """Draw, into a tile and for one pose, the faces that look towards the eye.

        The same image as drawing all with culling on, for half the vertices. What is edge-on to
        within rounding is left to the device to cull.
        """
        self._aim("face", tile, grid)
        x, y, z = eye - self.centre
        height = self._planes[0] * x + self._planes[1] * y + self._planes[2] * z - self._offsets
        looking = np.flatnonzero(height > -1e-6 * np.sqrt(x * x + y * y + z * z))
        front = self._indices.take(looking, axis=0)  # three times as quick as a mask
        self._front_faces.orphan()
        self._front_faces.write(front)
        self._front_drawable.render(moderngl.TRIANGLES, vertices=3 * len(front))
        if self.has_overlaps:
            self._draw_nearest("coplanar", tile, grid, 1)

    def _draw_nearest(self, program: str, tile: Box, grid: SampleGrid, poses: int) -> None:
        n_faces = self._counts[program]
        for first in range(0, n_faces, self._max_faces):
            part = first, min(self._max_faces, n_faces - first)
            self.draw(program, tile, grid, poses, part)

    def _aim(self, program: str, tile: Box, grid: SampleGrid) -> None:
        """Set the way from axes to clip space: x = fx X/Z + cx becomes 2 x/width - 1."""
        x, y, width, height = tile
        fx, fy, cx, cy = grid.lens.tolist()
        self._programs[program]["image"].value = (
            2 * fx / width,
            2 * fy / height,
            2 * (cx - x) / width - 1,
            2 * (cy - y) / height - 1,
        )


class Views:
    """Poses of a scene, made ready to be drawn for a grid of samples.

    Attributes
    ----------
    grid : SampleGrid
        As given.
    near, far : (P,) float64
        Depth planes fitted to what is in view.
    clipped : (P,) bool
        Whether the near plane cuts a surface in view.
    can_cull : (P,) bool
        Of `can_cull`.
    boxes : list of (left, top, right, bottom)
        Samples the mesh can reach in each pose.
    eyes : (P, 3) float64
        Camera centres.
    """

    def __init__(
        self, scene: Scene, poses: FloatArray, grid: SampleGrid, is_reversed: bool
    ) -> None:
        mesh, camera, self.grid = scene.mesh, scene.camera, grid
        self.near, self.far, self.clipped = depth_range(
            mesh.vertices, mesh.faces, mesh.bounds, camera, poses
        )
        boxes = grid.boxes(image_boxes(scene.outline, camera, poses))
        self.boxes = [tuple(box) for box in boxes.tolist()]
        self.eyes = eyes = poses[:, :3, 3]
        self.can_cull = can_cull(mesh, poses, self.clipped)

        if is_reversed and scene.has_overlaps:
            # Powers of 2, so that depths in the buffer are those of the CPU but for the exponent,
            # unless a surface is cut: then it is cut here, and not at what is nearer.
            whole = 2.0 ** np.floor(np.log2(self.near))
            self.near = np.where(self.clipped, self.near, whole)
        self._records = np.zeros((len(poses), 6, 4), np.float32)
        self._records[:, :3, :3] = grid.axes(poses)[:, :3, :3].transpose(0, 2, 1)
        self._records[:, 3, :3], self._records[:, 4, :3] = split_floats(eyes - scene.centre)
        if is_reversed:
            self._records[:, 5, 1] = self.near  # clip z = near, so depth = near / z in [0, 1]
        else:
            self._records[:, 5, 0] = (self.far + self.near) / (self.far - self.near)
            self._records[:, 5, 1] = -2 * self.far * self.near / (self.far - self.near)
        self._is_reversed = is_reversed
        self._rays = self._find_rays(poses, eyes - scene.centre) if scene.has_overlaps else None

    def _find_rays(self, poses: FloatArray, eyes: FloatArray) -> FloatArray:
        """Entries of the uniform block of rays, (P, 4, 4)."""
        rays = np.zeros((len(poses), 4, 4))
        # x and y on the canvas at depth 1 to the world; the forward axis is at right angles to both
        # others, mixed or not.
        axes = self.grid.axes(poses)[:, :3, :3]
        mixed = np.linalg.inv(axes.transpose(0, 2, 1)) if self.grid.is_rolled else axes
        rays[:, :2, :3] = (mixed[:, :, :2] / self.grid.lens[:2]).transpose(0, 2, 1)
        rays[:, 2, :3], rays[:, 3, :3] = poses[:, :3, 2], eyes
        if self._is_reversed:
            rays[:, 0, 3] = self.near
        else:
            rays[:, 0, 3] = -self.far * self.near / (self.far - self.near)
            rays[:, 1, 3] = 0.5 + 0.5 * (self.far + self.near) / (self.far - self.near)
        return rays

    def records(self, rows: IntArray) -> NDArray[np.float32]:
        """Entries of the uniform block for these poses."""
        return self._records[rows]

    def rays(self, rows: IntArray) -> FloatArray | None:
        """Entries of the uniform block of rays for these poses; None without overlaps."""
        return None if self._rays is None else self._rays[rows]

    def depth(self, row: int, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Camera z of the depth buffer values of a pose; the farthest value gives inf."""
        near, far = self.near[row], self.far[row]
        with np.errstate(divide="ignore"):
            if self._is_reversed:
                z = near / values.astype(np.float64)
            else:
                ndc = 2 * values.astype(np.float64) - 1
                z = 2 * near * far / ((far + near) - ndc * (far - near))
                z[values == 1] = np.inf
        metres: NDArray[np.float32] = z.astype(np.float32)
        return metres


def split_floats(values: FloatArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Doubles as sums of two floats, good to 48 bits."""
    high = values.astype(np.float32)
    return high, (values - high).astype(np.float32)


def _numbered_by_last_corner(
    faces: IntArray, n_vertices: int
) -> tuple[IntArray, NDArray[np.uint32]]:
    """Vertices to send, (N,), and faces that index them, (F, 3): vertex f is f's last corner.

    The other two corners of a face may be any vertex sent for the same position; the vertices that
    are nobody's last corner come after the first F.
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
