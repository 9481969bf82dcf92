"""Pictures of a mesh with faces or points in given colours, by a camera or from outside.

Views from outside are drawn by the CPU rasteriser; lines and marks in space are drawn over them.
The task fills the picture. Faces that turn away from the viewer are left out of an interior, as in
a doll's house; an occluder in front of the task is hatched over it, and hides none of its colours.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    dots,
    first_of,
    frozen_record,
    matmul,
    norm,
    size_in_words,
    sort_order,
)
from rastercov.core.area.polygons import quantile
from rastercov.core.area.zones import DeadZones, zones_at
from rastercov.core.camera import (
    Camera,
    Poses,
    apparent,
    box_corners,
    look_at,
    to_camera,
    to_image,
    upwards,
)
from rastercov.core.camera.projection import rays_of, starts_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import boxes_of
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.raster.contract import VisibilityBuffer
from rastercov.report.images import (
    FaceImage,
    Key,
    OwnColours,
    count_pixels,
    draw_lines,
    draw_part,
    facing,
    font_for,
    hatch_over,
    hatch_pixels,
    layers,
    put,
    stripes,
    target_key,
    write_labels,
)
from rastercov.report.theme import (
    COVERED,
    INK,
    OF_CAMERA,
    OUTSIDE,
    PAPER,
    UNCOVERED,
    Colour,
    Pixels,
    Setting,
)

OfPoints = Callable[[Int32Array, FloatArray], NDArray[Any]]
"""Values (N, ...) of points (N, 3) of faces (N,)."""

WIDTH, HEIGHT = 720, 560
"""Pixels of one view."""
FINE = 2
"""Oversampling: pixels drawn along one of those."""
MARGIN = 0.05
"""Margin on each side, relative to the picture."""
DISTANCE = 4.0
"""Distance of the viewer, in radii of the scene."""
CORNERS = [(1, -1.5), (-1, 1.5), (-1.5, -1), (1.5, 1)]
DIRECTIONS = np.array([(x, y, z) for z in (1, -1) for x, y in CORNERS])
"""Directions from the scene to the viewer; the first two are the default."""
FRONT, FROM_ONE_SIDE = 0.4, 0.75
"""Lengths of the mean normal of a task, and of the mean of unit vectors to cameras, from which on
pictures are from their side."""
ASIDE, ABOVE, STEEP = 0.5, 0.25, 0.9
"""Parts of two such directions beside their middle, and above it; z of one that is from above or
below."""
FROM_BELOW = 0.6
"""Worth of what is seen from below, relative to what is seen from above; to the fourth indoors."""
SHOWN = 0.5
"""Part of the most pixels of a face from any direction from which on it is shown well."""
PIECES = 96
"""Pieces of a line, each visible or hidden."""
PIXELS_AT_A_TIME = 1 << 16
"""Pixels whose points are looked up together."""
MOST_EYES = 16
"""Cameras that are asked for the surfaces around them, spread evenly."""
ENCLOSED = 4
"""Directions of six in which a surface must be around a camera that is indoors."""
SOME = 10_000
"""Faces that the box is found of, spread evenly."""
FEW_REL = 1e-4
"""Part of a picture that needs no entry in its legend."""
LONGEST = 0.2
"""Length of a scale bar at most, relative to the width of a picture."""
BEYOND = 0.01
"""Part of the task's area that may be beyond each side of the box around most of it."""
AROUND = 0.25
"""Part of the longest side of that box up to which faces beyond it are in the picture."""
OPENED = 0.12
"""Part of the task's pixels that a plane of occluders hides from which on it is opened."""
LAYERS = 6
"""Surfaces behind each other that are opened."""
_KEPT: WeakKeyDictionary[Mesh, dict[str, tuple[bytes, Any]]] = WeakKeyDictionary()


@frozen_record(kw_only=True)
class DrawnScene:
    """A mesh as it is drawn: the faces at the pixels of a picture, in layers.

    Attributes
    ----------
    camera, pose
        Of the viewer.
    face : (H, W) int32
        Nearest face that is no target; -1 for none.
    depth : (H, W) float32
        Its depth, metres.
    targets, beneath : (H, W) int32
        Target that nothing is in front of, and evaluated face behind an occluder; -1 for none.
    light : (F,) float64
        Brightness of each face in [0, 1].
    fronts : (F,) bool
        Faces that turn a valid side to the viewer.
    setting : Setting
        Colours of all but the task.
    opened : sequence of str
        Groups that are left out, all or in part, because they hide the task.
    """

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    face: FaceImage
    depth: Float32Array
    targets: FaceImage
    beneath: FaceImage
    light: FloatArray
    fronts: BoolArray
    setting: Setting
    opened: Sequence[str] = ()

    @property
    def stripe(self) -> int:
        """Width of stripes, pixels."""
        return max(3, int(max(self.face.shape)) // 240)

    @property
    def hatch(self) -> int:
        """Width of a line of a hatch, pixels: it shows where a page has the picture in small."""
        return max(2, int(max(self.face.shape)) // 288)

    @property
    def backs(self) -> BoolArray:
        """(F,) evaluated faces that turn their backs."""
        return self.mesh.task_mask & ~self.mesh.target_mask & ~self.fronts

    @cached_property
    def counts(self) -> FloatArray:
        """(F,) number of pixels of each face as a surface, as a target, and behind occluders."""
        images = self.face, self.beneath, self.targets
        return np.sum([count_pixels(image, self.mesh.n_faces) for image in images], axis=0)

    def shows_backs(self) -> bool:
        """True if evaluated faces are seen from behind, on more than a few pixels."""
        return bool(self.counts[self.backs].sum() > FEW_REL * self.face.size)

    def at_points(
        self, face: FaceImage, values: OfPoints, nothing: ArrayLike, asked: BoolArray | None = None
    ) -> AnyArray:
        """(H, W, ...) values of the points of a face image at the pixels asked for, (H, W).

        `values` gets faces (N,) and points (N, 3), some at a time; other pixels have `nothing`.
        Pixels of the task are asked for unless others are.
        """
        if asked is None:
            asked = on_pixels(self.mesh.task_mask, face)
        pixels, start = np.flatnonzero(asked), np.asarray(nothing)
        result = np.full((face.size, *start.shape), start)
        for at in range(0, len(pixels), PIXELS_AT_A_TIME):
            part = pixels[at : at + PIXELS_AT_A_TIME]
            faces = face.ravel()[part]
            rows, columns = np.divmod(part, face.shape[1])
            points = points_of_pixels(self.mesh, self.camera, self.pose, faces, rows, columns)
            result[part] = values(faces, points)
        return result.reshape((*face.shape, *start.shape))


def draw_scene(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    buffer: VisibilityBuffer,
    task: ArrayLike = (),
    setting: Setting = OF_CAMERA,
) -> DrawnScene:
    """A mesh as a camera sees it, with targets, and some faces of the task behind occluders."""
    matrix = np.asarray(pose, np.float64)
    targets, beneath = layers(mesh, camera, matrix, buffer, np.asarray(task, np.int64))
    cosine = np.abs(mesh.normals @ matrix[:3, 2])  # one for all faces of a plane
    return DrawnScene(
        mesh=mesh,
        face=buffer.face,
        targets=targets,
        beneath=beneath,
        light=setting.least_light + (1 - setting.least_light) * cosine,
        fronts=facing(mesh, apparent(camera, Poses.of(matrix))[0])[0],
        camera=camera,
        pose=matrix,
        depth=buffer.depth,
        setting=setting,
    )


def look(
    mesh: Mesh,
    direction: ArrayLike,
    more: ArrayLike = (),
    scale: float = FINE,
    eyes: ArrayLike = (),
    around: ArrayLike | None = None,
) -> DrawnScene:
    """View a mesh from a direction, so that its task and more points (N, 3) just fit in.

    The direction leads from the centre of the scene to the viewer, in the axes of `upright`, and
    has any length; `scale` is the number of pixels drawn along one of the `WIDTH` x `HEIGHT`.
    `eyes`, (P, 3), are the cameras of the network, or (P, 4, 4), their poses, which say what is up:
    where most of them are inside the mesh, it is an interior and is cut open. `around`, (2, 3), is
    a box that fits in in place of the task.
    """
    own = task_points(mesh) if around is None else box_corners(np.asarray(around, np.float64))
    points = np.concatenate((own, np.asarray(more, np.float64).reshape(-1, 3)))
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = (low + high) / 2, max(float(norm(high - low)) / 2, 1e-12)
    axes = upright(eyes)
    towards = np.asarray(direction, np.float64) @ axes
    eye = middle + DISTANCE * radius * towards / norm(towards)
    pose = look_at(eye, middle, axes[2])[0]
    camera = _fit_camera(points, pose, scale)
    rows = np.flatnonzero(~mesh.target_mask)
    buffer = draw_part(mesh, camera, pose, rows)
    away, skin = back_faces(mesh, eye, eyes), remember(outer_skin, mesh, eyes)
    # A view of mostly back faces looks into a room through its walls.
    counts = count_pixels(buffer.face, mesh.n_faces)
    is_interior = is_inside(mesh, eyes) or 2 * counts[away].sum() > counts.sum()
    kept = rows[~away[rows]]
    if is_interior and 0 < len(kept) < len(rows):
        rows = kept
        buffer = draw_part(mesh, camera, pose, rows)
    is_closed = ~mesh.task_mask | skin
    task = np.flatnonzero(mesh.target_mask | ~(is_closed | away))
    may_hide = is_closed[counts > 0].any() or mesh.target_mask.any()
    behind = draw_part(mesh, camera, pose, task) if may_hide else buffer
    opened, n_behind = rows[:0], (behind.face >= 0).sum()
    for _ in range(LAYERS * may_hide):
        hides = on_pixels(is_closed, buffer.face) & (buffer.depth < behind.depth)
        hides &= behind.face >= 0
        if hides.sum() <= OPENED * n_behind:
            break
        bodies = remember(_bodies, mesh, middle)
        hidden = np.bincount(bodies[buffer.face[hides]], minlength=mesh.n_faces)
        worth = hidden > OPENED * n_behind
        if not worth.any():  # planes of small faces: all of them or none
            worth = hidden > (0 if 2 * hidden.sum() > n_behind else n_behind)
        is_opened = is_closed[rows] & worth[bodies[rows]]
        if not is_opened.any():
            break
        opened, rows = np.append(opened, rows[is_opened]), rows[~is_opened]
        buffer = draw_part(mesh, camera, pose, rows)
    if len(opened) and around is None:  # the rest fills the picture
        left = mesh.vertices[np.unique(mesh.faces[rows[mesh.task_mask[rows]]])]
        is_left = ((low <= left) & (left <= high)).all(axis=1)
        points = np.concatenate((left[is_left], points[len(own) * is_left.any() :]))
        camera = _fit_camera(points, pose, scale)
        buffer = draw_part(mesh, camera, pose, rows)
    scene = draw_scene(mesh, camera, pose, buffer, rows[mesh.task_mask[rows]], OUTSIDE)
    names = [mesh.groups[row].name for row in np.unique(mesh.face_group[opened])]
    return replace(scene, opened=names)


def on_pixels(mask: BoolArray, face: FaceImage) -> BoolArray:
    """(H, W) value of a mask (F,) at the face of each pixel, False where there is none."""
    if mask.all() or not mask.any():
        return (face >= 0) & mask.any()
    return np.append(mask, False).take(face, mode="wrap")


def _fit_camera(points: FloatArray, pose: FloatArray, scale: float) -> Camera:
    """The camera at a pose in whose image points (N, 3) just fit."""
    of_points = to_camera(points, pose)
    slopes = of_points[:, :2] / of_points[:, 2:]
    least, most = slopes.min(axis=0), slopes.max(axis=0)
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    size = np.array([width, height])
    focal = float(((1 - 2 * MARGIN) * size / np.maximum(most - least, 1e-9)).min())
    cx, cy = size / 2 - focal * (least + most) / 2
    return Camera(width=width, height=height, fx=focal, fy=focal, cx=float(cx), cy=float(cy))


def upright(eyes: ArrayLike) -> FloatArray:
    """Axes x, y, z of pictures in the world, as rows: z is up by the poses of `look`, if any."""
    poses = np.asarray(eyes, np.float64)
    up = upwards(poses if poses.ndim == 3 else ())
    x = np.roll(up, 1)
    return np.stack((x, np.cross(up, x), up))


def places_of(eyes: ArrayLike) -> FloatArray:
    """(P, 3) places of cameras, which are given by them or by their poses (P, 4, 4)."""
    given = np.asarray(eyes, np.float64)
    return given[:, :3, 3] if given.ndim == 3 else given.reshape(-1, 3)


def _bodies(mesh: Mesh, middle: ArrayLike) -> IntArray:
    """(F,) number of the body of each face; a body around a point is taken apart into planes."""
    body = mesh.topology.components()
    (low, high), at = boxes_of(body, mesh.vertices[mesh.faces]), np.asarray(middle, np.float64)
    is_around = np.all((low <= at) & (at <= high), axis=1)
    size = mesh.diagonal
    offset = dots(mesh.normals, mesh.vertices[mesh.faces[:, 0]]) / size
    plane = np.column_stack((mesh.normals.round(2), offset.round(3))) * is_around[body, None]
    number: IntArray = np.unique(np.column_stack((body, plane)), axis=0, return_inverse=True)[1]
    return number.ravel()


def task_points(mesh: Mesh) -> FloatArray:
    """(N, 3) vertices of the evaluated faces, or of all faces if none is, without outliers."""
    return remember(_without_outliers, mesh)[0]


def scene_box(mesh: Mesh) -> FloatArray:
    """(2, 3) bounds of the opaque faces, or of all if none is, without outliers."""
    bounds: FloatArray = remember(_without_outliers, mesh)[1]
    return bounds


def _without_outliers(mesh: Mesh, _eyes: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Vertices (N, 3) of evaluated faces and bounds (2, 3) of opaque ones, without outliers.

    Beyond each side of a box is at most `BEYOND` of the area; outliers are faces farther beyond it
    than `AROUND` of its length.
    """
    task = mesh.task_mask if mesh.task_mask.any() else np.ones(mesh.n_faces, bool)
    items = []
    for rows in (np.flatnonzero(task), np.flatnonzero(~mesh.target_mask | mesh.target_mask.all())):
        corners, areas = mesh.vertices[mesh.faces[rows]], mesh.areas[rows]
        ends = np.concatenate((corners.min(axis=1), -corners.max(axis=1)), axis=1)
        some = slice(None, None, 1 + len(rows) // SOME)
        weights = np.maximum(areas[some], 1e-300)
        every = np.ones(len(weights), bool)
        box = np.array([quantile(column, weights, every, BEYOND) for column in ends[some].T])
        slack = AROUND * -(box[:3] + box[3:]).min()
        kept = (ends >= box - slack).all(axis=1)
        is_used = np.zeros(mesh.n_vertices, bool)
        is_used[mesh.faces[rows[kept]]] = True
        items.append(mesh.vertices[is_used])
    return items[0], np.stack((items[1].min(axis=0), items[1].max(axis=0)))


def front_of(mesh: Mesh, eyes: ArrayLike = ()) -> FloatArray | None:
    """(3,) side of a task that has a front, unit, in the axes of `upright`; None for any other.

    It is that of its mean normal, else that of the cameras unless they are inside.
    """
    rows = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
    weights = mesh.areas[rows] / max(float(mesh.areas[rows].sum()), 1e-300)
    front = (weights * ~mesh.two_sided_mask[rows]) @ mesh.normals[rows]
    points = places_of(eyes)
    if norm(front) < FRONT and len(points) and not is_inside(mesh, eyes):
        rays = points - weights @ mesh.centroids[rows]
        rays /= np.maximum(norm(rays), 1e-300)[:, None]
        front = rays.mean(axis=0)
        if norm(front) < FROM_ONE_SIDE:
            return None
    size = float(norm(front))
    return np.asarray(upright(eyes) @ front / size) if size >= FRONT else None


def sides(mesh: Mesh, eyes: ArrayLike = ()) -> FloatArray:
    """(2, 3) directions of the first views of a mesh: both from its front where it has one.

    Otherwise they are the two that show most of the task.
    """
    front = front_of(mesh, eyes)
    if front is None:
        return best_directions(mesh, mesh.task_mask, eyes=eyes)
    if abs(front[2]) > STEEP:
        return DIRECTIONS[sort_order(-DIRECTIONS @ front)[:2]]
    x, y, _ = ASIDE * front / np.hypot(*front[:2])
    return np.asarray(front + np.array([(y, -x, ABOVE), (-y, x, ABOVE)]))


def best_directions(mesh: Mesh, weights: ArrayLike, eyes: ArrayLike = ()) -> FloatArray:
    """(2, 3) of `DIRECTIONS` that show most of faces' fronts, chosen greedily.

    Each direction adds most to the visible pixels of those before it, by `weights` (F,) of faces
    that are not shown well yet.
    """
    shown = remember(_shown_faces, mesh, eyes) * np.asarray(weights, np.float64)
    chosen: list[int] = []
    best = np.zeros(mesh.n_faces)
    for _ in range(2):
        is_shown = best >= SHOWN * shown.max(axis=0)
        gain = (np.maximum(shown - best, 0) * ~(is_shown & (best > 0))).sum(axis=1)
        gain[chosen] = -1.0
        chosen.append(int(gain.argmax()))
        best = np.maximum(best, shown[chosen[-1]])
    return DIRECTIONS[chosen]


def _shown_faces(mesh: Mesh, eyes: ArrayLike) -> FloatArray:
    """Pixels of the front of each face from each of `DIRECTIONS`, (8, F), weighted."""
    shown = np.empty((len(DIRECTIONS), mesh.n_faces))
    for row, direction in enumerate(DIRECTIONS):
        scene = look(mesh, direction, scale=0.3, eyes=eyes)
        shown[row] = scene.counts * ~scene.backs
        if direction[2] < 0:
            shown[row] *= FROM_BELOW**4 if is_inside(mesh, eyes) else FROM_BELOW
    return shown


def remember(make: Callable[[Mesh, ArrayLike], Any], mesh: Mesh, eyes: ArrayLike = ()) -> Any:
    """Answer of a function on a mesh and cameras; the last one for each mesh is kept."""
    known, key = _KEPT.setdefault(mesh, {}), np.asarray(eyes, np.float64).tobytes()
    if make.__name__ not in known or known[make.__name__][0] != key:
        known[make.__name__] = key, make(mesh, eyes)
    return known[make.__name__][1]


def paint(scene: DrawnScene, colours: Pixels, own: OwnColours | None = None) -> Pixels:
    """Pixels of a scene, (H, W, 3), with faces in `colours` (F, 3), lit from the viewer.

    `own` gives the colours of points instead, for those of evaluated faces. Those seen from behind
    have a colour of their own.
    """
    face = scene.face
    pixels = _paint_faces(scene, face, colours, own)
    if (scene.beneath >= 0).any():
        shown = (scene.beneath >= 0) & ~stripes(face.shape, round(scene.stripe / 1.5), 3)
        pixels[shown] = _paint_faces(scene, scene.beneath, colours, own)[shown]
    if (scene.targets >= 0).any():
        of_targets = own or (lambda image, at: colours[image.ravel()[at]])
        hatch_over(pixels, scene.targets, of_targets, scene.stripe)
    return pixels


def _paint_faces(
    scene: DrawnScene, face: FaceImage, colours: Pixels, own: OwnColours | None
) -> Pixels:
    """Pixels of the opaque faces of one image."""
    mesh, light = scene.mesh, scene.light
    pixels, left = np.empty((*face.shape, 3), np.uint8), face >= 0
    pixels[:] = np.full((face.shape[1], 3), scene.setting.background, np.uint8)  # row by row
    if own is not None:
        is_own = on_pixels(mesh.task_mask, face)
        # An axis of three would take three times as long.
        of_points = np.repeat(light.astype(np.float32).take(face[is_own]), 3)
        put(pixels, is_own.ravel(), own(face, np.flatnonzero(is_own)).ravel() * of_points)
        left &= ~is_own
    palette = (colours * light[:, None]).astype(np.uint8)
    put(pixels, left.ravel(), palette.take(face[left], axis=0))
    if scene.backs[scene.counts > 0].any():
        behind = on_pixels(scene.backs, face)
        striped = behind & stripes(face.shape, scene.stripe)
        for colour, rows in ((scene.setting.back, behind), (scene.setting.back_stripe, striped)):
            put(pixels, rows.ravel(), light.take(face[rows])[:, None] * colour)
    draw_lines(pixels, face, mesh, scene.depth if face is scene.face else None)
    return pixels


def points_of_pixels(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    face: Int32Array,
    rows: IntArray,
    columns: IntArray,
) -> FloatArray:
    """(N, 3) points where the rays through the centres of pixels meet the planes of faces (N,)."""
    rotation, eye = pose[:3, :3], pose[:3, 3]
    normals = mesh.normals.take(face, axis=0)
    pixels = np.stack((columns + 0.5, rows + 0.5), axis=1)
    if camera.is_parallel:
        eye = eye + starts_of(pixels, camera) @ rotation.T
        rays = np.tile((0.0, 0.0, 1.0), (len(pixels), 1))
    else:
        rays = rays_of(pixels, camera)
    corners = mesh.vertices.take(mesh.faces[:, 0].take(face), axis=0)
    heights = dots(normals, corners - eye)
    away = matmul(rotation, rays.T).T
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.nan_to_num(heights / dots(normals, away))
    return eye + reach[:, None] * away


def neutral(mesh: Mesh, setting: Setting = OUTSIDE) -> Pixels:
    """(F, 3) colours: the task in light grey, occluders in theirs."""
    colours = np.where(mesh.task_mask[:, None], COVERED, setting.occluder)
    return colours.astype(np.uint8)


class Marks(NamedTuple):
    """Names of parts that a picture numbers, and the part of each face, (F,), -1 for none."""

    names: Sequence[str]
    part: IntArray

    def write(self, image: Image.Image, scene: DrawnScene) -> None:
        """Write the name of each part where it is in a picture."""
        face = np.where(scene.beneath >= 0, scene.beneath, scene.face)
        own = np.where(face >= 0, self.part[face], -1)
        at = np.nonzero((own >= 0) & (own < len(self.names)))
        parts, counts = np.unique(own[at], return_counts=True)
        sums = [np.bincount(own[at], each)[parts] for each in reversed(at)]
        names = [self.names[row] for row in parts]
        middles, font = np.stack(sums, axis=1) / counts[:, None], font_for(round(FINE * 1100))
        write_labels(image, middles, names, [INK] * len(names), font, FINE)


def side_by_side(
    mesh: Mesh,
    colours: Pixels,
    hatch: ByteArray,
    directions: FloatArray,
    eyes: ArrayLike = (),
    scale: float = FINE,
    *,
    marks: Marks | None = None,
    left: tuple[DeadZones, Pixels] | None = None,
    unit: str = "",
) -> tuple[Pixels, list[Key]]:
    """Views from some directions side by side, and their part of a legend.

    `colours`, (F, 3), and `hatch`, (F,), are those of faces; what is `left` of them has the
    colour with it. `scale` is as of `look`, `unit` as of `smooth`.
    """
    scenes = [look(mesh, direction, scale=scale, eyes=eyes) for direction in directions]

    def own(scene: DrawnScene, face: FaceImage, at: IntArray) -> Pixels:
        of_face = face.ravel()[at]
        pixels = colours[of_face]
        if left is not None:
            zones, colour = left
            zone = partial(zones_at, zones, n=0)
            on_left = scene.at_points(face, zone, -1, np.isin(face, zones.face)).ravel()[at]
            pixels = np.where(on_left[:, None] == 0, colour, pixels)
        return hatch_pixels(pixels, hatch[of_face], at, face.shape[1], scenes[0].hatch)

    has_own = hatch.any() or left is not None
    painted = [paint(scene, colours, partial(own, scene) if has_own else None) for scene in scenes]
    images = [Image.fromarray(pixels) for pixels in painted]
    if marks is not None:
        for image, scene in zip(images, scenes, strict=True):
            marks.write(image, scene)
    pairs = zip(images, scenes, strict=True)
    return beside([smooth(*each, unit) for each in pairs]), scene_keys(scenes)


def beside(images: Sequence[Image.Image]) -> Pixels:
    """Pixels of pictures of equal height, side by side."""
    gap, paper = ((0, 0), (6, 0), (0, 0)), PAPER[0]
    parts = [np.pad(np.asarray(image), gap, constant_values=paper) for image in images]
    return np.concatenate(parts, axis=1)[:, 6:]


def scene_keys(scenes: Sequence[DrawnScene]) -> list[Key]:
    """Entries for what several pictures may have: occluders, backs, targets."""
    keys, mesh, setting = [], scenes[0].mesh, scenes[0].setting
    if any(not mesh.task_mask[scene.counts > 0].all() for scene in scenes):
        keys.append(Key.of("occluder", setting.occluder))
    over = [np.append(mesh.task_mask, False)[scene.face[scene.beneath >= 0]] for scene in scenes]
    if not all(each.all() for each in over):
        keys.append(Key.of("occluder in front of the evaluated surface", setting.occluder, COVERED))
    if any(each.any() for each in over):
        keys.append(Key.of("behind another evaluated part", COVERED, UNCOVERED, 4, 3))
    if any(scene.shows_backs() for scene in scenes):
        keys.append(Key.of("back faces", setting.back, setting.back_stripe))
    if any((scene.targets >= 0).any() for scene in scenes):
        keys.append(target_key())
    names = list(dict.fromkeys(name for scene in scenes for name in scene.opened))
    own = -2 if len(names) > 3 else -1  # of many rather what they are parts of
    names = list(dict.fromkeys(name.split("/")[own:][0] for name in names))
    if names:
        what = first_of(names, 3) if len(mesh.groups) > 1 else "parts in front of the task"
        keys.append(Key.of(f"not shown: {what}", PAPER))
    return keys


class Line(NamedTuple):
    """Line in space between points (3,), its width, px, and pieces, visible or hidden each."""

    start: FloatArray
    end: FloatArray
    width: float
    pieces: int


def draw_in_space(
    image: Image.Image, scene: DrawnScene, lines: Sequence[Line], colour: Colour
) -> None:
    """Draw lines over the picture of a scene, fainter where the part hides them."""
    draw, depth, slack = ImageDraw.Draw(image), scene.depth, 1e-3 * scene.mesh.diagonal
    faint = tuple(round(0.3 * c + 0.7 * 205) for c in colour)
    for line in lines:
        seen = to_camera(np.linspace(line.start, line.end, line.pieces + 1), scene.pose)
        image_points = to_image(seen, scene.camera)
        column, row = np.clip(image_points, 0, np.array(depth.shape[::-1]) - 1).T
        before = seen[:, 2] <= depth[row.astype(int), column.astype(int)] + slack
        is_ahead = seen[:, 2] > 1e-3 * DISTANCE * slack  # the viewer may be between them
        width = round(line.width * FINE)
        places = [tuple(place) for place in image_points.tolist()]
        is_drawn = is_ahead[:-1] & is_ahead[1:]
        is_seen = is_drawn & before[:-1] & before[1:]
        for piece in np.flatnonzero(is_drawn & ~is_seen):
            if piece % 2 == 0:
                draw.line(places[piece : piece + 2], faint, max(1, width // 2))
        ends = np.flatnonzero(np.diff(is_seen, prepend=False, append=False))
        # A border, for a surface of the line's colour.
        for own, wide in ((PAPER, width + 2 * FINE), (colour, width)):
            for first, last in ends.reshape(-1, 2).tolist():
                draw.line(places[first : last + 1], own, wide)


def draw_bodies(
    image: Image.Image, scene: DrawnScene, bodies: Sequence[tuple[Mesh, Colour]]
) -> tuple[Image.Image, DrawnScene]:
    """The picture of a scene with further bodies in it, and the scene with their depth."""
    if not bodies:
        return image, scene
    pixels, depth, setting = np.array(image), scene.depth.copy(), scene.setting
    for mesh, colour in bodies:
        buffer = draw_part(mesh, scene.camera, scene.pose, np.arange(mesh.n_faces))
        near = (buffer.face >= 0) & (buffer.depth < depth)
        cosine = np.append(facing(mesh, scene.pose)[1], 0.0)[buffer.face, None]
        light = setting.least_light + (1 - setting.least_light) * cosine
        layer = (light * colour).astype(np.uint8)
        draw_lines(layer, buffer.face, mesh, buffer.depth)
        pixels[near], depth[near] = layer[near], buffer.depth[near]
    return Image.fromarray(pixels), replace(scene, depth=depth)


def in_picture(scene: DrawnScene, points: ArrayLike) -> tuple[IntArray, FloatArray]:
    """Rows of points (N, 3) before the viewer and within the picture, and their places, px."""
    seen = to_camera(np.asarray(points, np.float64).reshape(-1, 3), scene.pose)
    with np.errstate(all="ignore"):
        places = to_image(seen, scene.camera)
        size = scene.camera.width, scene.camera.height
        inside = (places >= 0).all(axis=1) & (places < size).all(axis=1) & (seen[:, 2] > 0)
    return np.flatnonzero(inside), places[inside]


def smooth(image: Image.Image, scene: DrawnScene | None = None, unit: str = "") -> Image.Image:
    """The picture at its final size, with the axes of a scene and, in "m" or "units", its scale.

    Small pictures have neither.
    The scale is that at the median depth of what is in the picture.
    """
    if scene is not None and scene.camera.height >= HEIGHT:
        _draw_axes(ImageDraw.Draw(image), scene, unit)
    return image.reduce(FINE)


def _draw_axes(draw: ImageDraw.ImageDraw, scene: DrawnScene, unit: str) -> None:
    font, size = font_for(round(FINE * 750)), 22 * FINE
    height, some = scene.camera.height, scene.depth[:: 2 * FINE, :: 2 * FINE]
    near = some[some < np.inf]

    def write(ends: ArrayLike, words: str, at: ArrayLike, anchor: str) -> None:
        line = [tuple(each) for each in np.asarray(ends).tolist()]
        draw.line(line, PAPER, 5 * FINE)
        draw.line(line, INK, 2 * FINE)
        place = np.asarray(at).tolist()
        draw.text(place, words, INK, font, anchor, stroke_width=2 * FINE, stroke_fill=PAPER)

    start = np.array((1.6 * size, height - 2.6 * size))
    for name, way in zip("xyz", size * scene.pose[:3, :2], strict=True):
        write([start, start + way], name, start + 1.5 * way, "mm")
    if not (unit and len(near)):
        return
    metre = scene.camera.fx / float(np.median(near))
    most = LONGEST * scene.camera.width / metre
    power = 10.0 ** math.floor(math.log10(most))
    bar = max(n * power for n in (1, 2, 5) if n * power <= most)
    x, y = 0.5 * size, height - 0.5 * size
    words = size_in_words(bar) if unit == "m" else f"{bar:g} units"
    write([(x, y), (x + bar * metre, y)], words, (x + bar * metre + size / 4, y), "lm")


def is_inside(mesh: Mesh, eyes: ArrayLike) -> bool:
    """True if most of some cameras, (P, 3), are in the bounds of the opaque faces."""
    points = places_of(eyes)
    low, high = scene_box(mesh)
    inside = ((points > low) & (points < high)).all(axis=1)
    return 2 * int(inside.sum()) > len(points)


def back_faces(mesh: Mesh, viewer: ArrayLike, eyes: ArrayLike = ()) -> BoolArray:
    """(F,) faces that turn away from a viewer (3,).

    A two-sided face does where the viewer is on one side of it and all cameras, (P, 3), on the
    other, which is the side that they may cover.
    """
    pose = np.eye(4)
    pose[:3, 3] = np.asarray(viewer, np.float64)
    away = ~facing(mesh, pose)[0]
    two_sided = np.flatnonzero(mesh.two_sided_mask)
    points = places_of(eyes)
    if len(two_sided) and len(points):
        normals, middles = mesh.normals[two_sided], mesh.centroids[two_sided]
        own = dots(normals, pose[:3, 3] - middles)
        is_other = np.ones(len(two_sided), bool)
        for eye in points:
            is_other &= dots(normals, eye - middles) * own < 0
        away[two_sided] = is_other
    return away


def is_enclosed(mesh: Mesh, eyes: ArrayLike) -> bool:
    """True if most of some cameras, (P, 3), have opaque faces around them, as indoors.

    Around means in at least four of the directions +x, -x, +y, -y, +z, -z.
    """
    points = places_of(eyes)
    if not is_inside(mesh, points):
        return False
    some = points[np.unique(np.linspace(0, len(points) - 1, MOST_EYES).astype(int))]
    middle, size = mesh.centre, mesh.diagonal
    tree = TriangleTree.over((mesh.vertices - middle) / size, mesh.faces[~mesh.target_mask])
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    starts, directions = np.repeat((some - middle) / size, 6, axis=0), np.tile(axes, (len(some), 1))
    n_rays = len(starts)
    hit = tree.first_hits(starts, directions, np.ones(n_rays), np.full(n_rays, -1))
    around = (hit >= 0).reshape(-1, 6).sum(axis=1)
    return bool(2 * (around >= ENCLOSED).sum() > len(some))


def outer_skin(mesh: Mesh, eyes: ArrayLike) -> BoolArray:
    """(F,) opaque faces of a building that no camera, (P, 3), is in front of.

    None unless the cameras are indoors: then the outside of walls and roof are among them, which
    hide all that is inside.
    """
    points = places_of(eyes)
    is_behind = np.full(mesh.n_faces, is_enclosed(mesh, points))
    if is_behind.any():
        is_behind &= ~mesh.target_mask & ~mesh.degenerate_mask & ~mesh.two_sided_mask
        first = dots(mesh.normals, mesh.vertices[mesh.faces[:, 0]])
        for eye in points:
            is_behind &= mesh.normals @ eye < first
    return is_behind
