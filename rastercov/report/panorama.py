"""Exterior views of a mesh with its faces in given colours, for pictures of a placement.

The mesh is drawn by the CPU rasteriser; lines and marks in space are drawn over it. Walls of a room
that face away from the outside viewer are omitted, as in a doll's house.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.projection import to_camera, to_image
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import VisibilityBuffer
from rastercov.report.images import draw_lines, facing, stripes
from rastercov.report.target_pictures import lay_over, targets_in_view
from rastercov.report.theme import EXTERIOR, Colour, Pixels
from rastercov.viewpoints import look_at

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WIDTH, HEIGHT = 720, 560
"""Pixels of one view."""
FINE = 2
"""Oversampling: pixels drawn along one of those."""
MARGIN = 0.05
"""Margin on each side, relative to the picture."""
DISTANCE = 4.0
"""Distance of the viewer, in radii of the scene."""
DIRECTIONS = np.array(
    [
        *[(1, -1.5, 1), (-1, 1.5, 1), (-1.5, -1, 1), (1.5, 1, 1)],
        *[(1, -1.5, -1), (-1, 1.5, -1), (-1.5, -1, -1), (1.5, 1, -1)],
        *[(0, -0.1, 2), (0, -0.1, -2), (1, 0, 0.1), (-1, 0, 0.1), (0, 1, 0.1), (0, -1, 0.1)],
    ]
)
"""Directions from the scene to the viewer; the first two are the default."""
THROUGH = 0.6
"""Opacity of faces that show through the part."""
PIECES = 96
"""Pieces of a line, each visible or hidden."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An exterior view of a mesh: camera, pose, and the drawn faces."""

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    rows: NDArray[np.int64]  # faces that are drawn: without the back faces of a room's walls
    buffer: VisibilityBuffer  # with indices of the whole mesh
    targets: NDArray[np.int32] | None = None  # in view, drawn over the image

    @property
    def faces(self) -> NDArray[np.int32]:
        """Face of each pixel of a surface, and of each of a target."""
        images = [self.buffer.face] if self.targets is None else [self.buffer.face, self.targets]
        faces: NDArray[np.int32] = np.concatenate([image[image >= 0] for image in images])
        return faces


def look(mesh: Mesh, direction: ArrayLike, more: ArrayLike = (), scale: float = FINE) -> Scene:
    """View a mesh from a direction, so that it and more points (N, 3) just fit into the picture.

    The direction leads from the centre of the scene to the viewer and has any length; `scale` is
    the number of pixels drawn along one of the `WIDTH` x `HEIGHT`.
    """
    used = mesh.vertices[np.unique(mesh.faces)]
    points = np.concatenate((used, np.asarray(more, np.float64).reshape(-1, 3)))
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-12)
    towards = np.asarray(direction, np.float64)
    eye = middle + DISTANCE * radius * towards / np.linalg.norm(towards)
    pose = look_at(eye, middle)[0]
    seen = to_camera(points, pose)
    slopes = seen[:, :2] / seen[:, 2:]
    least, most = slopes.min(axis=0), slopes.max(axis=0)
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    size = np.array([width, height])
    focal = float(((1 - 2 * MARGIN) * size / np.maximum(most - least, 1e-9)).min())
    cx, cy = size / 2 - focal * (least + most) / 2
    camera = Camera(width=width, height=height, fx=focal, fy=focal, cx=float(cx), cy=float(cy))
    rows = np.arange(mesh.n_faces)
    buffer = _drawn(mesh, camera, pose, rows)
    # A view of mostly back faces looks into a room through its walls.
    is_back = ~facing(mesh, pose)[0]
    counts = np.bincount(buffer.face[buffer.face >= 0], minlength=mesh.n_faces)
    front = np.flatnonzero(~is_back & ~mesh.target_mask)
    if 2 * counts[is_back].sum() > counts.sum() and len(front):
        rows = front
        buffer = _drawn(mesh, camera, pose, rows)
    targets = targets_in_view(mesh, camera, pose, buffer.depth)
    return Scene(mesh, camera, pose, rows, buffer, targets)


def best_directions(mesh: Mesh, faces: BoolArray, count: int = 2) -> FloatArray:
    """(count, 3) of `DIRECTIONS` that show most of some faces, chosen greedily.

    Each direction adds most to the visible pixels of those before it.
    """
    if not faces.any():
        return DIRECTIONS[:count].copy()
    shown = np.empty((len(DIRECTIONS), mesh.n_faces))
    for row, direction in enumerate(DIRECTIONS):
        drawn = look(mesh, direction, scale=0.3).faces
        shown[row] = np.bincount(drawn, minlength=mesh.n_faces) * faces
    chosen: list[int] = []
    best = np.zeros(mesh.n_faces)
    for _ in range(count):
        gain = np.maximum(shown - best, 0).sum(axis=1)
        gain[chosen] = -1.0
        chosen.append(int(gain.argmax()))
        best = np.maximum(best, shown[chosen[-1]])
    return DIRECTIONS[chosen]


def paint(
    scene: Scene,
    colours: Pixels,
    through: BoolArray | None = None,
    own: Pixels | None = None,
) -> Pixels:
    """Pixels of a scene, (H, W, 3), with faces in `colours` (F, 3), lit from the viewer.

    Faces of `through`, (F,), show through the part that hides them, faintly and striped. `own`,
    (H, W, 3), are colours of pixels instead, for those of task faces.
    """
    mesh, buffer = scene.mesh, scene.buffer
    _, cosine = facing(mesh, scene.pose)
    palette = np.empty((mesh.n_faces + 1, 3), np.uint8)
    palette[:-1] = colours * (0.6 + 0.4 * cosine[:, None])
    palette[-1] = EXTERIOR
    pixels = palette[buffer.face]
    if own is not None:
        is_task = np.append(mesh.task_mask, False)[buffer.face]
        light = 0.6 + 0.4 * cosine[buffer.face[is_task]]
        pixels[is_task] = own[is_task] * light[:, None]
    draw_lines(pixels, buffer.face, mesh.n_faces)
    if through is not None and through.any():
        behind = _drawn(mesh, scene.camera, scene.pose, np.flatnonzero(through)).face
        covered = np.append(through, False)[buffer.face]
        shown = (behind >= 0) & ~covered & stripes(behind.shape, 3 * FINE)
        mixed = THROUGH * colours[behind[shown]] + (1 - THROUGH) * pixels[shown]
        pixels[shown] = mixed.astype(np.uint8)
    if scene.targets is not None:
        lay_over(pixels, scene.targets, colours)
    return pixels


@dataclass(frozen=True)
class Line:
    """A line in space, its colour and its width in pixels."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    colour: Colour
    width: float = 1.5


def draw_in_space(image: Image.Image, scene: Scene, lines: Sequence[Line]) -> None:
    """Draw lines over the picture of a scene, fainter where the part hides them."""
    draw = ImageDraw.Draw(image)
    depth = scene.buffer.depth
    slack = 1e-3 * float(np.linalg.norm(np.ptp(scene.mesh.bounds, axis=0)))
    steps = np.linspace(0, 1, PIECES + 1)[:, None]
    for line in lines:
        points = np.asarray(line.start) + steps * (np.asarray(line.end) - np.asarray(line.start))
        seen = to_camera(points, scene.pose)
        image_points = to_image(seen, scene.camera)
        column, row = np.clip(image_points, 0, (depth.shape[1] - 1, depth.shape[0] - 1)).T
        before = seen[:, 2] <= depth[row.astype(int), column.astype(int)] + slack
        faint = tuple(
            round(0.3 * c + 0.7 * g) for c, g in zip(line.colour, (205,) * 3, strict=True)
        )
        width = round(line.width * FINE)
        for piece in range(PIECES):
            is_seen = before[piece] and before[piece + 1]
            if not is_seen and piece % 2:
                continue
            ends = [tuple(image_points[piece]), tuple(image_points[piece + 1])]
            draw.line(
                ends, line.colour if is_seen else faint, width if is_seen else max(1, width // 2)
            )


def fill_in_space(
    image: Image.Image, scene: Scene, polygon: ArrayLike, colour: Colour, strength: float = 0.28
) -> None:
    """Fill a flat polygon (N, 3) with a faint colour, unless the part hides its centre."""
    points = np.asarray(polygon, np.float64)
    middle = points.mean(axis=0, keepdims=True)
    column, row = np.clip(place_in_image(scene, middle)[0], 0, np.array(image.size) - 1).astype(int)
    if to_camera(middle, scene.pose)[0, 2] > scene.buffer.depth[row, column]:
        return
    mask = Image.new("L", image.size)
    corners = [tuple(corner) for corner in place_in_image(scene, points).tolist()]
    ImageDraw.Draw(mask).polygon(corners, round(255 * strength))
    image.paste(colour, (0, 0), mask)


def place_in_image(scene: Scene, points: ArrayLike) -> FloatArray:
    """(N, 2) positions of points (N, 3) in the picture of a scene, px."""
    return to_image(
        to_camera(np.asarray(points, np.float64).reshape(-1, 3), scene.pose), scene.camera
    )


def smooth(image: Image.Image) -> Image.Image:
    """The picture at its final size."""
    return image.reduce(FINE)


def _drawn(
    mesh: Mesh, camera: Camera, pose: FloatArray, rows: NDArray[np.int64]
) -> VisibilityBuffer:
    """Image of some faces of a mesh, with indices of the whole mesh."""
    part = mesh
    if len(rows) < mesh.n_faces:
        part = Mesh(vertices=mesh.vertices, faces=mesh.faces[rows])
    with open_rasterizer(part, camera, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    return replace(buffer, face=np.append(rows, -1).astype(np.int32)[buffer.face])
