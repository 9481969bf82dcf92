"""Overview of a network: the task in the colours of its cameras, and a floor plan.

Only the covered part of the surface has a camera's colour: by area exactly, point by point.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, figures 6.10
and 6.11.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from rastercov.base.format import plural, short
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.pose import Poses
from rastercov.camera.projection import to_camera, view_border
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.points import covering_poses, views_at
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.area.union import Covered
from rastercov.coverage.network import Network
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.images import Font, Key, draw_scale_bar, font_for, framed, write_labels
from rastercov.report.modes import mode_picture
from rastercov.report.panorama import (
    DIRECTIONS,
    FINE,
    FOOT,
    HEIGHT,
    PIECES,
    PIXELS_AT_A_TIME,
    WIDTH,
    FaceImage,
    FloorPlan,
    Line,
    OwnColours,
    Scene,
    View,
    beside,
    best_directions,
    draw_in_space,
    fill_in_space,
    floor_plan,
    is_in_picture,
    look,
    neutral,
    outline,
    paint,
    paint_plan,
    place_in_image,
    scene_keys,
    smooth,
    task_points,
    two_sides,
)
from rastercov.report.theme import Colour, Pixels

FloatArray = NDArray[np.float64]
FRUSTUM = 0.16
"""Length of the edges of a drawn view pyramid, relative to half the diagonal of the scene."""
WEDGE = 0.16
"""Opacity of view pyramids in a plan."""
MANY = 30
"""Cameras up to which their labels are large."""
CROWD = 16
"""Cameras from which on their view pyramids get smaller."""
PARTS = 12
"""Parts of each side of a distorted image, whose border is a curve."""
FROM_BELOW = 0.6
"""Worth of the task seen from below, relative to what is seen from above."""


@dataclass(frozen=True, eq=False)
class CameraColours:
    """Colours of the surface by the camera that covers it best: of its covered part, no more.

    With `regions` of the poses it is coloured point by point, by the camera with most pixels on it;
    else face by face, by `best_pose`, (F,), -1 for none; without either it has no camera's colour.
    """

    mesh: Mesh
    placed: Poses
    names: Sequence[str]
    best_pose: ArrayLike | None = None
    regions: Regions | None = None

    @property
    def poses(self) -> FloatArray:
        """(K, 4, 4) world_from_camera."""
        return self.placed.world_from_camera

    def pyramids(self, camera: Cameras) -> list[FloatArray]:
        """View pyramid of each pose: the eye, then the corners of its outline."""
        cameras, placed, reach = cameras_of(camera), self.placed, self.reach
        return [
            _pyramid(cameras[index], pose, reach)
            for pose, index in zip(self.poses, placed.camera, strict=True)
        ]

    @property
    def eyes(self) -> FloatArray:
        """(K, 3) positions of the cameras."""
        return self.poses[:, :3, 3]

    @property
    def colours(self) -> list[Colour]:
        """Colours of the cameras."""
        return [(r, g, b) for r, g, b in theme.camera_colours(len(self.poses)).tolist()]

    @property
    def reach(self) -> float:
        """Length of the edges of drawn view pyramids, metres."""
        corners = np.concatenate((task_points(self.mesh), self.eyes))
        size = max(float(np.linalg.norm(np.ptp(corners, axis=0))) / 2, 1e-12)
        return FRUSTUM * size * math.sqrt(min(1.0, CROWD / max(len(self.poses), 1)))

    @property
    def font(self) -> Font:
        """Font of the cameras' names."""
        return font_for(round(FINE * (850 if len(self.poses) <= MANY else 600)))

    def of_points(self, face: NDArray[np.int32], points: FloatArray) -> Pixels:
        """(N, 3) colours of points (N, 3) of faces (N,)."""
        found = neutral(self.mesh)[face]
        if self.regions is not None:
            best = best_pose_at(self.regions, self.placed, face, points)
        elif self.best_pose is not None:
            best = np.asarray(self.best_pose, np.int64)[face]
        else:
            return found
        is_task = self.mesh.task_mask[face]
        found[is_task] = np.array([*self.colours, theme.UNCOVERED], np.uint8)[best[is_task]]
        return found

    def of_image(self, view: View, face: FaceImage) -> Pixels:
        """(H, W, 3) colours of a face image of a view, black where it has no face.

        One point of each block of `FINE` x `FINE` pixels is looked up, and all points of blocks
        beside one of another colour: what differs are details smaller than a pixel of the picture.
        """
        if self.regions is None:  # a colour for each face
            of_face = self.of_points(np.arange(self.mesh.n_faces, dtype=np.int32), np.empty((0, 3)))
            return np.concatenate((of_face, np.zeros((1, 3), np.uint8)))[face]

        found = np.zeros((*face.shape, 3), np.uint8)
        drawn = face >= 0
        if not drawn.any():
            return found

        def look_up(where: NDArray[np.bool_]) -> None:
            of = np.full_like(face, -1)
            of[box][where] = face[box][where]
            faces, places, pixel = view.points(of)
            found[pixel] = self.of_points(faces, places)

        # The smallest box of whole blocks with all that is drawn.
        ends = [np.flatnonzero(drawn.any(axis=axis))[[0, -1]] // FINE * FINE for axis in (1, 0)]
        box = tuple(slice(low, high + FINE) for low, high in ends)
        # Task, occluder or neither: a block that has more than one of them is looked up, too.
        kinds = np.append(self.mesh.task_mask.astype(np.uint32), np.uint32(2))[face[box]]
        first = np.zeros(kinds.shape, np.bool_)
        first[::FINE, ::FINE] = True
        look_up(first)
        colours, kind = found[box][::FINE, ::FINE], kinds[::FINE, ::FINE]
        codes = kind << 24
        for channel in range(3):
            codes |= colours[..., channel].astype(np.uint32) << 8 * channel
        differs = np.zeros(codes.shape, np.bool_)
        across, down = codes[:, 1:] != codes[:, :-1], codes[1:] != codes[:-1]
        for block, changes in (
            (differs[:, 1:], across),
            (differs[:, :-1], across),
            (differs[1:], down),
            (differs[:-1], down),
        ):
            block |= changes
        again = np.zeros(kinds.shape, np.bool_)
        for row, column in np.ndindex(FINE, FINE):
            part = slice(row, None, FINE), slice(column, None, FINE)
            own = tuple(slice(size) for size in kinds[part].shape)
            found[box][part] = colours[own]
            again[part] = differs[own] | (kinds[part] != kind[own])
        look_up(again)
        return found

    def keys(self) -> list[Key]:
        """Legend: each camera with its name, and what none covers."""
        keys = [
            Key.of(f"camera {name}" if row == 0 else str(name), colour)
            for row, (name, colour) in enumerate(zip(self.names, self.colours, strict=True))
        ]
        is_known = self.regions is not None or self.best_pose is not None
        return [*keys, Key.of("covered by none", theme.UNCOVERED)] if is_known else keys

    def title(self) -> str:
        """Number of cameras, and words on their colours."""
        count = len(self.poses)
        text = plural(count, "camera")
        if count and self.regions is not None:
            text += ". Covered surface has the colour of the camera with most pixels on it"
        elif count and self.best_pose is not None:
            text += ". Covered faces have the colour of the camera that covers them best"
        return text

    def caution(self) -> str:
        """Words on cameras that have no colour of their own, or ""."""
        n = len(theme.CAMERAS)
        many = f"Of the {len(self.poses)} colours, those from the {n + 1}th on may look alike."
        return many if len(self.poses) > n else ""


def camera_colours(
    mesh: Mesh,
    poses: ArrayLike | Poses,
    best_pose: ArrayLike | None = None,
    names: Sequence[str] = (),
    regions: Regions | None = None,
) -> CameraColours:
    """Colours by the cameras of poses (K, 4, 4), with names 1, 2, ... unless K are given."""
    if not isinstance(poses, Poses):
        poses = Poses.of(np.asarray(poses, np.float64).reshape(-1, 4, 4))
    titles = names or [str(row + 1) for row in range(len(poses))]
    return CameraColours(mesh, poses, titles, best_pose, regions)


def best_pose_at(
    regions: Regions, placed: Poses, face: NDArray[np.int32], points: FloatArray
) -> NDArray[np.int64]:
    """(N,) pose with most pixels on a m^2 at points (N, 3) of faces (N,), -1 where none covers it.

    `placed` are the P poses of the regions, each with its camera.
    """
    best = np.full(len(face), -1, np.int64)
    mesh, cameras = regions.mesh, cameras_of(regions.camera)
    if not len(placed):
        return best
    pixels = [each.fx * each.fy if each.is_pinhole else 1.0 for each in cameras]
    scales = [pixels[index] / pixels[0] for index in placed.camera]
    for at in range(0, len(face), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        covers = covering_poses(regions, face[part], points[part])
        worth = np.full(len(covers), -np.inf)
        for pose in np.flatnonzero(covers.any(axis=0)).tolist():  # few cameras, many points
            rows = np.flatnonzero(covers[:, pose])
            camera, matrix = cameras[placed.camera[pose]], placed.world_from_camera[pose]
            density = _density(mesh, camera, matrix, face[part][rows], points[part][rows])
            density *= scales[pose]
            is_better = density > worth[rows]
            worth[rows[is_better]] = density[is_better]
            best[at + rows[is_better]] = pose
    return best


def best_covering(network: Network) -> NDArray[np.int64]:
    """(F,) place in `network.pose_ids` of the best camera, -1 where it does not cover the face."""
    # The best camera of a face need not cover it.
    least = max(network.task.min_coverage, np.finfo(np.float64).tiny)
    place = {pose: row for row, pose in enumerate(network.pose_ids)}
    rows = [place.get(pose, -1) for pose in network.best_pose.tolist()]
    return np.where(network.best >= least, np.array(rows, np.int64), -1)


def overview_picture(shown: CameraColours, camera: Cameras) -> Image.Image:
    """The task, which fills the picture, in the colours of its cameras; beside it a floor plan.

    Cameras are drawn where they are in the picture; the plan has all of them, with their view
    pyramids from above.
    """
    mesh = shown.mesh
    scene = look(mesh, _side(shown), eyes=shown.eyes)
    image = _with_cameras(scene, camera, shown)
    plan, plan_image = _plan_picture(shown, camera)
    keys = [*shown.keys(), *scene_keys([scene, plan])]
    return framed(beside([image, plan_image]), shown.title(), keys)


def _side(shown: CameraColours) -> FloatArray:
    """Direction that shows most of the task, an oblique one and from above if that serves."""
    mesh = shown.mesh
    found: FloatArray = best_directions(mesh, mesh.task_mask, 1, shown.eyes, 8, FROM_BELOW)[0]
    return found


def network_picture(shown: CameraColours, camera: Cameras) -> Image.Image:
    """The cameras around the part as view pyramids, from two sides; figures 6.10 and 6.11."""
    pyramids = shown.pyramids(camera)
    more = np.concatenate([*pyramids, np.zeros((0, 3))])
    sides = DIRECTIONS[[0, 1]] if _side(shown)[2] > 0 else DIRECTIONS[[4, 5]]
    scenes = [look(shown.mesh, direction, more, eyes=shown.eyes) for direction in sides]
    images = [_with_cameras(scene, camera, shown) for scene in scenes]
    return framed(beside(images), shown.title(), [*shown.keys(), *scene_keys(scenes)])


def _with_cameras(scene: Scene, camera: Cameras, shown: CameraColours) -> Image.Image:
    """A scene in the colours of its cameras, with those cameras that are in the picture."""
    image = Image.fromarray(paint(scene, neutral(scene.mesh), own=partial(shown.of_image, scene)))
    rows = np.flatnonzero(is_in_picture(scene, shown.eyes)).tolist()
    pyramids, cameras = shown.pyramids(camera), cameras_of(camera)
    for row in rows:
        pyramid = pyramids[row]
        if MODELS[cameras[shown.placed.camera[row]].model].is_planar:  # a flat base
            fill_in_space(image, scene, pyramid[1:], shown.colours[row])
        draw_in_space(image, scene, _edges(pyramid, shown.colours[row]))
    places = place_in_image(scene, shown.eyes[rows])
    names = [shown.names[row] for row in rows]
    write_labels(image, places, names, [shown.colours[row] for row in rows], shown.font, FINE)
    return smooth(image)


def _plan_picture(shown: CameraColours, camera: Cameras) -> tuple[FloorPlan, Image.Image]:
    """The floor plan, and its picture with all cameras."""
    outlines = [outline(pyramid[:, :2]) for pyramid in shown.pyramids(camera)]
    plan = floor_plan(shown.mesh, shown.eyes, np.concatenate([*outlines, np.zeros((0, 2))]))
    image = paint_plan(plan, partial(shown.of_image, plan))
    task = Image.fromarray(plan.shows_task())
    draw = ImageDraw.Draw(image)
    for wedge, colour in zip(outlines, shown.colours, strict=True):
        places = [tuple(place) for place in plan.places(wedge).tolist()]
        if len(places) > 2:
            _tint(image, places, colour, task)
        draw.line([*places, places[0]], theme.PAPER, 4 * FINE, "curve")
        draw.line([*places, places[0]], colour, 2 * FINE, "curve")
    eyes = plan.places(shown.eyes)
    write_labels(image, eyes, list(shown.names), shown.colours, shown.font, FINE)
    foot = FOOT * FINE
    draw.rectangle((0, HEIGHT * FINE - foot, *image.size), theme.EXTERIOR)
    corner = (0.05 * WIDTH * FINE, HEIGHT * FINE - 0.35 * foot)
    font = font_for(FINE * 750)
    draw_scale_bar(image, corner, plan.scale, 0.25 * WIDTH * FINE, font)
    cut = "" if plan.cut is None else f", cut at z = {short(float(f'{plan.cut:.3g}'))} m"
    text = f"from above{cut}; x to the right, y up"
    draw.text((0.95 * WIDTH * FINE, corner[1]), text, theme.INK, font, anchor="rs")
    return plan, smooth(image)


def _tint(
    image: Image.Image, places: Sequence[tuple[float, ...]], colour: Colour, task: Image.Image
) -> None:
    """Tint a polygon with a colour, except the pixels of the task."""
    (x0, y0), (x1, y1) = np.floor(np.min(places, axis=0)), np.ceil(np.max(places, axis=0)) + 1
    left, top = max(0, int(x0)), max(0, int(y0))
    right, bottom = min(image.width, int(x1)), min(image.height, int(y1))
    if left >= right or top >= bottom:
        return
    mask = Image.new("L", (right - left, bottom - top))
    moved = [(place[0] - left, place[1] - top) for place in places]
    ImageDraw.Draw(mask).polygon(moved, round(255 * WEDGE))
    mask.paste(0, (0, 0), task.crop((left, top, right, bottom)))
    image.paste(colour, (left, top), mask)


def _pyramid(camera: Camera, pose: FloatArray, reach: float) -> FloatArray:
    """(N, 3) camera centre and points around the border of its image, the same from each corner on.

    The edges are `reach` long. The border of a distorted image is a curve.
    """
    rays = view_border(camera, 1 if camera.is_pinhole else PARTS)
    # The same length for every field of view.
    rays = rays * (reach / np.linalg.norm(rays, axis=1).max())
    corners: FloatArray = rays @ pose[:3, :3].T + pose[:3, 3]
    return np.concatenate((pose[None, :3, 3], corners))


def _edges(pyramid: FloatArray, colour: Colour) -> list[Line]:
    """Edges of a view pyramid and of its base; the upper edge of its base is the widest."""
    points = [tuple(point) for point in pyramid.tolist()]
    n = len(points) - 1
    parts = n // 4
    pieces = max(1, PIECES // parts)
    lines = [Line(points[0], points[1 + row], colour, 1.6) for row in range(0, n, parts)]
    for row in range(n):
        width = 1.6 if row >= parts else 4.0
        lines.append(Line(points[1 + row], points[1 + (row + 1) % n], colour, width, pieces))
    return lines


def _density(
    mesh: Mesh, camera: Camera, pose: FloatArray, face: NDArray[np.int32], points: FloatArray
) -> FloatArray:
    """(N,) pixels on a m^2 of a pose at points of faces; through a pinhole, divided by fx fy."""
    away = points - pose[:3, 3]
    if not camera.is_pinhole:
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        slopes = lens_of(camera).jacobian(to_camera(points, pose))
        across = np.cross(slopes[:, 0], slopes[:, 1])
        normals = mesh.normals[face] @ pose[:3, :3]
        of_lens: FloatArray = np.nan_to_num(np.abs(np.einsum("ni,ni->n", normals, across)))
        return of_lens
    # The height of the camera above the plane of each face is that above all its points.
    heights = np.einsum("fi,fi->f", mesh.normals, mesh.vertices[mesh.faces[:, 0]] - pose[:3, 3])
    depth = away[:, 0] * pose[0, 2] + away[:, 1] * pose[1, 2] + away[:, 2] * pose[2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        found: FloatArray = np.nan_to_num(np.abs(heights)[face] / depth**3)
    return found


def best_picture(mesh: Mesh, best: ArrayLike, eyes: ArrayLike = ()) -> Image.Image:
    """The part coloured by the best coverage of any camera, red where it is 0."""
    zero = theme.colour_rows(mesh, best) == theme.ZERO_ROW
    return mode_picture("coverage", mesh, best, eyes, through=zero)


def views_picture(covered: Covered, eyes: ArrayLike = ()) -> Image.Image:
    """The part coloured by the number of cameras that cover each point, up to the required one."""
    mesh, views = covered.mesh, len(covered.area)
    levels = theme.coverage_colours()[theme.level_rows(np.arange(views + 1) / views)]
    words = ["covered by none", *(f"by {n}" for n in range(1, views + 1))]
    words[-1] += " or more"

    def colours(scene: Scene) -> OwnColours:
        def own(face: FaceImage) -> Pixels:
            is_task = np.append(mesh.task_mask, False)[face]
            faces, points, pixel = scene.points(np.where(is_task, face, np.int32(-1)))
            found = np.zeros((*face.shape, 3), np.uint8)
            found[pixel] = levels[views_at(covered, faces, points)]
            return found

        return own

    keys = [Key.of(text, colour) for text, colour in zip(words, levels, strict=True)]
    return two_sides(mesh, colours, "Cameras that cover each point of the surface", keys, eyes=eyes)
