"""Exterior views of a mesh with its faces in given colours, for pictures of a placement.

The mesh is drawn by the CPU rasteriser; lines and marks in space are drawn over it. The task fills
the picture. Faces that turn away from the viewer are left out of an interior, as in a doll's house;
an occluder in front of the task is hatched over it, and hides none of its colours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.raster.contract import VisibilityBuffer
from rastercov.report.images import draw_lines, facing, shade, stripes
from rastercov.report.interiors import is_inside, outer_skin, turned_away
from rastercov.report.target_pictures import hatch_over, targets_in_view
from rastercov.report.theme import BACK, BACK_STRIPE, EXTERIOR, PAPER, Colour, Pixels

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
FaceImage = NDArray[np.int32]
"""(H, W) face at each pixel, -1 for none."""
OwnColours = Callable[[FaceImage], Pixels]
"""Colours (H, W, 3) of the points of a face image."""

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
LEAST_LIGHT = 0.72
"""Brightness of a face seen at a right angle to its normal, relative to one seen along it."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An exterior view of a mesh: camera, pose, and the drawn faces."""

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    rows: NDArray[np.int64]  # faces that are drawn: without those of an interior that turn away
    buffer: VisibilityBuffer  # with indices of the whole mesh
    targets: FaceImage | None = None  # in view, drawn over the image
    beneath: FaceImage | None = None  # task faces behind occluders

    @property
    def faces(self) -> FaceImage:
        """Face of each pixel of a surface, of each of a target, and behind occluders."""
        images = [self.buffer.face, self.targets, self.beneath]
        faces: FaceImage = np.concatenate([i[i >= 0] for i in images if i is not None])
        return faces

    @property
    def is_cut(self) -> bool:
        """True if faces are left out."""
        return len(self.rows) < self.mesh.n_faces

    def shows_backs(self) -> bool:
        """True if a task face is seen from behind."""
        drawn = np.unique(self.faces)
        behind = self.mesh.task_mask & ~self.mesh.target_mask & ~facing(self.mesh, self.pose)[0]
        return bool(behind[drawn].any())


def look(
    mesh: Mesh,
    direction: ArrayLike,
    more: ArrayLike = (),
    scale: float = FINE,
    eyes: ArrayLike = (),
) -> Scene:
    """View a mesh from a direction, so that its task and more points (N, 3) just fit in.

    The direction leads from the centre of the scene to the viewer and has any length; `scale` is
    the number of pixels drawn along one of the `WIDTH` x `HEIGHT`. `eyes`, (P, 3), are the cameras
    of the network: where most of them are inside the mesh, it is an interior and is cut open.
    """
    points = np.concatenate((task_points(mesh), np.asarray(more, np.float64).reshape(-1, 3)))
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
    away = turned_away(mesh, eye, eyes) | outer_skin(mesh, eyes)
    # A view of mostly back faces looks into a room through its walls.
    counts = np.bincount(buffer.face[buffer.face >= 0], minlength=mesh.n_faces)
    is_interior = is_inside(mesh, eyes) or 2 * counts[away].sum() > counts.sum()
    kept = np.flatnonzero(~away & ~mesh.target_mask)
    if is_interior and len(kept) and (away & ~mesh.target_mask).any():
        rows = kept
        buffer = _drawn(mesh, camera, pose, rows)
    targets = targets_in_view(mesh, camera, pose, buffer.depth)
    beneath = None
    of_task = rows[mesh.task_mask[rows] & ~mesh.target_mask[rows]]
    if len(of_task) and not mesh.task_mask.all():
        beneath = _drawn(mesh, camera, pose, of_task).face
        is_occluder = np.append(~mesh.task_mask, False)[buffer.face]
        beneath = np.where(is_occluder, beneath, -1).astype(np.int32)
    return Scene(mesh, camera, pose, rows, buffer, targets, beneath)


def task_points(mesh: Mesh) -> FloatArray:
    """(N, 3) vertices of the scored faces, or of all faces if none is."""
    scored = mesh.faces[mesh.task_mask] if mesh.task_mask.any() else mesh.faces
    is_used = np.zeros(len(mesh.vertices), np.bool_)
    is_used[scored] = True
    points: FloatArray = mesh.vertices[is_used]
    return points


def best_directions(
    mesh: Mesh,
    faces: BoolArray,
    count: int = 2,
    eyes: ArrayLike = (),
    among: int | None = None,
    from_below: float = 1.0,
) -> FloatArray:
    """(count, 3) of `DIRECTIONS` that show most of some faces' fronts, chosen greedily.

    Each direction adds most to the visible pixels of those before it; `among` is the number of
    directions to choose from, all unless given; pixels seen from below count `from_below` times.
    """
    directions = DIRECTIONS[:among]
    if not faces.any():
        return directions[:count].copy()
    shown = np.empty((len(directions), mesh.n_faces))
    for row, direction in enumerate(directions):
        scene = look(mesh, direction, scale=0.3, eyes=eyes)
        is_front = facing(mesh, scene.pose)[0]
        shown[row] = np.bincount(scene.faces, minlength=mesh.n_faces) * (faces & is_front)
        shown[row] *= from_below if direction[2] < 0 else 1.0
    chosen: list[int] = []
    best = np.zeros(mesh.n_faces)
    for _ in range(count):
        gain = np.maximum(shown - best, 0).sum(axis=1)
        gain[chosen] = -1.0
        chosen.append(int(gain.argmax()))
        best = np.maximum(best, shown[chosen[-1]])
    return directions[chosen]


def paint(
    scene: Scene,
    colours: Pixels,
    through: BoolArray | None = None,
    own: OwnColours | None = None,
) -> Pixels:
    """Pixels of a scene, (H, W, 3), with faces in `colours` (F, 3), lit from the viewer.

    Faces of `through`, (F,), show through the part that hides them, faintly and striped. `own`
    gives the colours of points instead, for those of task faces. Task faces seen from behind have a
    colour of their own.
    """
    mesh, face = scene.mesh, scene.buffer.face
    pixels = _painted(scene, face, colours, own)
    if scene.beneath is not None and (scene.beneath >= 0).any():
        shown = (scene.beneath >= 0) & ~stripes(face.shape, 2 * FINE, 3)
        pixels[shown] = _painted(scene, scene.beneath, colours, own)[shown]
    if through is not None and through.any():
        behind = _drawn(mesh, scene.camera, scene.pose, np.flatnonzero(through)).face
        covered = np.append(through, False)[face]
        shown = (behind >= 0) & ~covered & stripes(behind.shape, 3 * FINE)
        tints = colours[behind] if own is None else own(behind)
        mixed = THROUGH * tints[shown] + (1 - THROUGH) * pixels[shown]
        pixels[shown] = mixed.astype(np.uint8)
    if scene.targets is not None:
        of_targets = colours if own is None else own(scene.targets)
        hatch_over(pixels, scene.targets, of_targets, 3 * FINE)
    return pixels


def _painted(scene: Scene, face: FaceImage, colours: Pixels, own: OwnColours | None) -> Pixels:
    """Pixels of the opaque faces of one image."""
    mesh = scene.mesh
    is_front, cosine = facing(mesh, scene.pose)
    light = (LEAST_LIGHT + (1 - LEAST_LIGHT) * cosine)[:, None]
    palette = np.empty((mesh.n_faces + 1, 3), np.uint8)
    palette[:-1] = colours * light
    palette[-1] = EXTERIOR
    pixels = palette.take(face, axis=0, mode="wrap")
    is_task = np.append(mesh.task_mask, False)[face]
    if own is not None:
        shade(pixels, own(face), face, light[:, 0], is_task)
    behind = is_task & ~np.append(is_front, True)[face]
    if behind.any():
        for colour, rows in (
            (BACK, behind),
            (BACK_STRIPE, behind & stripes(face.shape, 3 * FINE)),
        ):
            pixels[rows] = np.array(colour) * light[face[rows]]
    draw_lines(pixels, face, mesh.n_faces)
    return pixels


@dataclass(frozen=True)
class Line:
    """A line in space, its colour, its width in pixels, and its pieces, visible or hidden each."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    colour: Colour
    width: float = 1.5
    pieces: int = PIECES


def draw_in_space(image: Image.Image, scene: Scene, lines: Sequence[Line]) -> None:
    """Draw lines over the picture of a scene, fainter where the part hides them."""
    draw = ImageDraw.Draw(image)
    depth = scene.buffer.depth
    slack = 1e-3 * float(np.linalg.norm(np.ptp(scene.mesh.bounds, axis=0)))
    for line in lines:
        steps = np.linspace(0, 1, line.pieces + 1)[:, None]
        points = np.asarray(line.start) + steps * (np.asarray(line.end) - np.asarray(line.start))
        seen = to_camera(points, scene.pose)
        image_points = to_image(seen, scene.camera)
        column, row = np.clip(image_points, 0, (depth.shape[1] - 1, depth.shape[0] - 1)).T
        before = seen[:, 2] <= depth[row.astype(int), column.astype(int)] + slack
        is_ahead = seen[:, 2] > 1e-3 * DISTANCE * slack  # the viewer may be between them
        faint = tuple(
            round(0.3 * c + 0.7 * g) for c, g in zip(line.colour, (205,) * 3, strict=True)
        )
        width = round(line.width * FINE)
        places = [tuple(place) for place in image_points.tolist()]
        for piece in range(
            line.pieces
        ):  # a border, so that the line shows on a surface of its colour
            if (before & is_ahead)[piece : piece + 2].all():
                draw.line(places[piece : piece + 2], PAPER, width + 2 * FINE)
        for piece in range(line.pieces):
            if not (is_ahead[piece] and is_ahead[piece + 1]):
                continue
            is_seen = before[piece] and before[piece + 1]
            if not is_seen and piece % 2:
                continue
            colour, across = (line.colour, width) if is_seen else (faint, max(1, width // 2))
            draw.line(places[piece : piece + 2], colour, across)


def fill_in_space(
    image: Image.Image, scene: Scene, polygon: ArrayLike, colour: Colour, strength: float = 0.28
) -> None:
    """Fill a flat polygon (N, 3) with a faint colour, unless the part hides its centre."""
    points = np.asarray(polygon, np.float64)
    middle = points.mean(axis=0, keepdims=True)
    if not is_in_picture(scene, points).all():
        return
    column, row = place_in_image(scene, middle)[0].astype(int)
    if to_camera(middle, scene.pose)[0, 2] > scene.buffer.depth[row, column]:
        return
    mask = Image.new("L", image.size)
    corners = [tuple(corner) for corner in place_in_image(scene, points).tolist()]
    ImageDraw.Draw(mask).polygon(corners, round(255 * strength))
    # Over the task, a tint would be taken for its colour.
    is_task = np.append(scene.mesh.task_mask, False)[scene.buffer.face]
    if scene.targets is not None:
        is_task |= scene.targets >= 0
    mask.paste(0, (0, 0), Image.fromarray(is_task))
    image.paste(colour, (0, 0), mask)


def is_in_picture(scene: Scene, points: ArrayLike) -> BoolArray:
    """(N,) points (N, 3) that are before the viewer and within the picture."""
    seen = to_camera(np.asarray(points, np.float64).reshape(-1, 3), scene.pose)
    with np.errstate(all="ignore"):
        places = to_image(seen, scene.camera)
        size = scene.camera.width, scene.camera.height
        inside = (places >= 0).all(axis=1) & (places < size).all(axis=1)
    found: BoolArray = inside & (seen[:, 2] > 0)
    return found


def place_in_image(scene: Scene, points: ArrayLike) -> FloatArray:
    """(N, 2) positions of points (N, 3) in the picture of a scene, px."""
    return to_image(
        to_camera(np.asarray(points, np.float64).reshape(-1, 3), scene.pose), scene.camera
    )


def smooth(image: Image.Image) -> Image.Image:
    """The picture at its final size."""
    return image.reduce(FINE)


def drawn_faces(mesh: Mesh, scene: Scene, rows: NDArray[np.int64]) -> FaceImage:
    """(H, W) face image of some faces alone, as the scene shows the mesh."""
    return _drawn(mesh, scene.camera, scene.pose, rows).face


def _drawn(
    mesh: Mesh, camera: Camera, pose: FloatArray, rows: NDArray[np.int64]
) -> VisibilityBuffer:
    """Image of some faces of a mesh, with indices of the whole mesh."""
    is_part = len(rows) < mesh.n_faces
    part = Mesh(vertices=mesh.vertices, faces=mesh.faces[rows]) if is_part else mesh
    with open_rasterizer(part, camera, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    if not is_part:
        return buffer
    return replace(buffer, face=np.append(rows, -1).astype(np.int32)[buffer.face])
