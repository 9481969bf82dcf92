"""A part from outside, its faces in given colours: the ground of every picture of a placement.

Serves `pictures`. A view is chosen, the mesh drawn by the CPU rasteriser, and lines and marks in
space are put over it. Where a mesh is a room, whose walls turn their backs on who stands outside,
these walls are left away, as in a doll's house.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.pose import look_at
from rastercov.projection import to_camera, to_image
from rastercov.raster.contract import VisibilityBuffer, open_rasterizer
from rastercov.report.images import draw_lines, faces_eye

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

GROUND = (246, 248, 250)
WIDTH, HEIGHT = 720, 560
"""Pixels of one view, before it is made smooth."""
FINE = 2
"""Pixels drawn along each of these."""
MARGIN = 0.05
"""Of the picture, left free on each side."""
FAR = 4.0
"""From how many radii one looks at a scene."""
DIRECTIONS = np.array(
    [
        *[(1, -1.5, 1), (-1, 1.5, 1), (-1.5, -1, 1), (1.5, 1, 1)],
        *[(1, -1.5, -1), (-1, 1.5, -1), (-1.5, -1, -1), (1.5, 1, -1)],
        *[(0, -0.1, 2), (0, -0.1, -2), (1, 0, 0.1), (-1, 0, 0.1), (0, 1, 0.1), (0, -1, 0.1)],
    ]
)
"""Where one may look from; the first two are taken where none is better."""
HIDDEN = 0.6
"""Strength of what shows through the part."""
PIECES = 96
"""Of a line, each seen or hidden."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A mesh as one looks at it: the camera and pose of the picture, and what was drawn.

    Attributes
    ----------
    mesh, camera, pose
        What is drawn; the mesh without the backs of walls that stand in the way.
    rows : (F',) int64
        Faces of the whole mesh that are drawn.
    buffer : VisibilityBuffer
        `face` counts in the whole mesh.
    """

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    rows: NDArray[np.int64]
    buffer: VisibilityBuffer


def look(mesh: Mesh, direction: ArrayLike, more: ArrayLike = (), scale: float = FINE) -> Scene:
    """Look at a mesh from a direction, so that it and more points just fit into the picture.

    Parameters
    ----------
    mesh : Mesh
    direction : (3,) array_like
        From the middle of all to the eye; any length.
    more : (N, 3) array_like
        Points that must be in the picture too.
    scale : float
        Pixels for each of the `WIDTH` x `HEIGHT`.
    """
    used = mesh.vertices[np.unique(mesh.faces)]
    points = np.concatenate((used, np.asarray(more, np.float64).reshape(-1, 3)))
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-12)
    towards = np.asarray(direction, np.float64)
    eye = middle + FAR * radius * towards / np.linalg.norm(towards)
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
    # The cosine says from which side; who sees mostly backs looks into a room through its walls.
    ray = pose[:3, 3] - mesh.centroids
    is_back = (np.einsum("fi,fi->f", mesh.normals, ray) < 0) & ~mesh.two_sided_mask
    counts = np.bincount(buffer.face[buffer.face >= 0], minlength=mesh.n_faces)
    if 2 * counts[is_back].sum() > counts.sum() and not is_back.all():
        rows = np.flatnonzero(~is_back)
        buffer = _drawn(mesh, camera, pose, rows)
    return Scene(mesh, camera, pose, rows, buffer)


def telling_directions(mesh: Mesh, faces: BoolArray, count: int = 2) -> FloatArray:
    """(count, 3) of `DIRECTIONS` from which most of some faces is seen, one after the other.

    Each after the first is the one that shows most of what those before it do not.
    """
    if not faces.any():
        return DIRECTIONS[:count].copy()
    shown = np.empty((len(DIRECTIONS), mesh.n_faces))
    for row, direction in enumerate(DIRECTIONS):
        face = look(mesh, direction, scale=0.3).buffer.face
        shown[row] = np.bincount(face[face >= 0], minlength=mesh.n_faces) * faces
    chosen: list[int] = []
    best = np.zeros(mesh.n_faces)
    for _ in range(count):
        gain = np.maximum(shown - best, 0).sum(axis=1)
        gain[chosen] = -1.0
        chosen.append(int(gain.argmax()))
        best = np.maximum(best, shown[chosen[-1]])
    return DIRECTIONS[chosen]


def paint(scene: Scene, colours: Pixels, through: BoolArray | None = None) -> Pixels:
    """Pixels of a scene, (H, W, 3), lit from the eye.

    Parameters
    ----------
    scene : Scene
    colours : (F, 3) uint8
    through : (F,) bool, optional
        Faces that show through the part where it hides them, faintly and striped.
    """
    mesh, buffer = scene.mesh, scene.buffer
    _, cosine = faces_eye(mesh, scene.pose)
    palette = np.empty((mesh.n_faces + 1, 3), np.uint8)
    palette[:-1] = colours * (0.6 + 0.4 * cosine[:, None])
    palette[-1] = GROUND
    pixels = palette[buffer.face]
    draw_lines(pixels, buffer.face, mesh.n_faces)
    if through is not None and through.any():
        behind = _drawn(mesh, scene.camera, scene.pose, np.flatnonzero(through)).face
        covered = np.append(through, False)[buffer.face]
        height, width = behind.shape
        rows, columns = np.ogrid[:height, :width]
        striped = (rows + columns) // (3 * FINE) % 2 == 0
        shown = (behind >= 0) & ~covered & striped
        mixed = HIDDEN * colours[behind[shown]] + (1 - HIDDEN) * pixels[shown]
        pixels[shown] = mixed.astype(np.uint8)
    return pixels


@dataclass(frozen=True)
class Line:
    """A line in space from `start` to `end`, in a colour, so many pixels wide."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    colour: Colour
    width: float = 1.5


def draw_in_space(image: Image.Image, scene: Scene, lines: Sequence[Line]) -> None:
    """Draw lines over the picture of a scene, fainter where the part hides them."""
    draw = ImageDraw.Draw(image)
    depth = scene.buffer.depth
    slack = 1e-3 * float(np.linalg.norm(np.ptp(scene.mesh.bounds, axis=0)))
    share = np.linspace(0, 1, PIECES + 1)[:, None]
    for line in lines:
        points = np.asarray(line.start) + share * (np.asarray(line.end) - np.asarray(line.start))
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
    """Fill a flat polygon (N, 3) with a thin colour, unless the part hides its middle."""
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
    """(N, 2) where points (N, 3) are in the picture of a scene, px."""
    return to_image(
        to_camera(np.asarray(points, np.float64).reshape(-1, 3), scene.pose), scene.camera
    )


def smooth(image: Image.Image) -> Image.Image:
    """The picture at the size it is shown."""
    return image.resize((WIDTH, HEIGHT), Image.Resampling.BOX)


def _drawn(
    mesh: Mesh, camera: Camera, pose: FloatArray, rows: NDArray[np.int64]
) -> VisibilityBuffer:
    """Image of some faces of a mesh, with their rows in it."""
    part = mesh
    if len(rows) < mesh.n_faces:
        part = Mesh(vertices=mesh.vertices, faces=mesh.faces[rows])
    with open_rasterizer(part, camera, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    return replace(buffer, face=np.append(rows, -1).astype(np.int32)[buffer.face])
