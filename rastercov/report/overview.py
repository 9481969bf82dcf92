"""Pictures of a network: the task in the colours of its cameras, and its dead zones.

Only the covered part of the surface has a camera's colour: by area exactly, point by point. Dead
zones are numbered, each in the colour of its reason, by exact pieces.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, figures 6.10
and 6.11.

Images of cameras: what they cover, and why they do not cover the rest.

Covered parts are pale, others have colour and hatch of the criterion that fails, by area that of
each point, else each face as a whole.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from rastercov.base import (
    TINY,
    AnyArray,
    BoolArray,
    ByteArray,
    FloatArray,
    Int32Array,
    IntArray,
    ReadByName,
    WholeArray,
    decimals_of,
    dots,
    first_of,
    frozen_record,
    norm,
    percent,
    plural,
)
from rastercov.base.format import area, text_with_sign
from rastercov.core.area.features import conditions_at
from rastercov.core.area.regions import covering_poses
from rastercov.core.area.stages import first_failures
from rastercov.core.area.table import Regions
from rastercov.core.area.zones import DeadZones, n_unlisted, zone_place, zone_reason, zones_at
from rastercov.core.camera import (
    KEPT,
    Camera,
    Cameras,
    Poses,
    apparent,
    box_corners,
    cameras_of,
)
from rastercov.core.camera.projection import view_frame
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import NAMES, REASONS, Reason, Task, fails, leads
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import apply_pose
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import VisibilityBuffer
from rastercov.report import theme
from rastercov.report.images import (
    FaceImage,
    Key,
    add_frame,
    draw_part,
    facing,
    font_for,
    hatch_pixels,
    outlines,
    stripes,
    write_labels,
)
from rastercov.report.panorama import (
    DIRECTIONS,
    FEW_REL,
    FINE,
    PIECES,
    DrawnScene,
    Line,
    beside,
    best_directions,
    draw_bodies,
    draw_in_space,
    draw_scene,
    front_of,
    in_picture,
    is_inside,
    look,
    neutral,
    on_pixels,
    outer_skin,
    paint,
    remember,
    scene_keys,
    sides,
    smooth,
    task_points,
    upright,
)
from rastercov.report.theme import REASON_COLOURS, REASON_HATCHES, Colour, Pixels

WHOLE_REL = 1e-6
"""Area, relative, that a face may lack and count as whole here: as covered, or as dead."""


def covered_pixels(regions: Regions, scene: DrawnScene, face: FaceImage) -> BoolArray:
    """Pixels of a face image of a scene, (H, W), whose centre is covered by some regions."""
    area = regions.areas().max(axis=0, initial=0.0)
    is_whole = (area > 0) & (area >= (1 - WHOLE_REL) * scene.mesh.areas)
    # Only faces that are covered in part have to be asked point by point.
    partly = on_pixels((area > 0) & ~is_whole, face)

    def is_covered(faces: Int32Array, points: FloatArray) -> BoolArray:
        return np.asarray(covering_poses(regions, faces, points).any(axis=1))

    covered = on_pixels(is_whole, face)
    covered |= scene.at_points(face, is_covered, False, partly)
    return covered


@frozen_record
class CameraImage:
    """Image of one camera and the judgement of what it shows.

    Attributes
    ----------
    scene : Scene
        What it sees, with nothing beneath.
    hidden : (H, W) bool
        Occluders before an evaluated face that turns its front to the camera.
    surface, targets : (H, W) uint8
        `Reason` at each pixel, of the surface and of the targets before it.
    """

    scene: DrawnScene
    hidden: BoolArray
    surface: ByteArray
    targets: ByteArray


def camera_scene(
    mesh: Mesh, camera: Camera, pose: FloatArray, buffer: VisibilityBuffer | None = None
) -> DrawnScene:
    """Scene in the image of a camera, with the task behind occluders; drawn unless given."""
    if buffer is None:
        with open_rasterizer(mesh, camera, "cpu") as rasterizer:
            buffer = rasterizer.render(pose)
    scored = np.flatnonzero(
        mesh.task_mask & ~mesh.target_mask & facing(mesh, apparent(camera, Poses.of(pose))[0])[0]
    )
    return draw_scene(mesh, camera, pose, buffer, scored)


def by_faces(scene: DrawnScene, reasons: ByteArray) -> CameraImage:
    """Image of a `camera_scene` by the `Reason` of each face, (F,)."""
    return _classify_image(scene, lambda face: reasons[face])


def by_points(
    scene: DrawnScene,
    camera: Camera,
    task: Task,
    parts: Regions,
    placed: tuple[Cameras, Poses] | None = None,
) -> CameraImage:
    """Image of a `camera_scene`, each pixel by its own point.

    `camera` is the one of the judgement, at its own size, and `parts` are its regions. With all
    cameras and its pose, points that it sees have the reason of conditions that fail.
    """
    opened = remember(_open_walls, scene.mesh)

    def why(faces: Int32Array, points: FloatArray) -> ByteArray:
        (result,) = first_failures(
            opened, camera, task, scene.pose[None], points, faces.astype(np.int64)
        )
        reason = result[0]
        if placed is not None:
            on = points, faces.astype(np.int64)
            for each in conditions_at(scene.mesh, placed[0], task, *on):
                reason = np.where(reason == Reason.COVERED, each.reasons(placed[1]), reason)
        return reason.astype(np.uint8)

    def judge(face: FaceImage) -> ByteArray:
        asked = on_pixels(scene.mesh.task_mask, face) & ~covered_pixels(parts, scene, face)
        return scene.at_points(face, why, np.uint8(Reason.COVERED), asked)

    return _classify_image(scene, judge)


def _open_walls(mesh: Mesh, _eyes: ArrayLike) -> Mesh:
    """The mesh with faces that hide nothing: what is in an image is not hidden."""
    groups = [replace(each, is_occluder=False, is_target=True) for each in mesh.groups]
    return Mesh(mesh.vertices, mesh.faces, groups, mesh.face_group)


def _classify_image(scene: DrawnScene, judge: Callable[[FaceImage], ByteArray]) -> CameraImage:
    bare = replace(scene, beneath=np.full_like(scene.beneath, -1))
    hidden = (scene.beneath >= 0) & (scene.targets < 0)
    surface = judge(scene.face)
    return CameraImage(
        bare, hidden, surface, judge(scene.targets) if scene.mesh.has_targets else surface
    )


def camera_pixels(image: CameraImage) -> Pixels:
    """(H, W, 3) pixels of a camera's image, with what it does not cover in colour and hatch."""
    scene = image.scene

    def own(face: FaceImage, at: IntArray) -> Pixels:
        rows = (image.surface if face is scene.face else image.targets).ravel()[at]
        of_reasons = REASON_COLOURS.take(rows, axis=0), REASON_HATCHES[rows]
        return hatch_pixels(*of_reasons, at, face.shape[1], scene.hatch)

    pixels = paint(scene, neutral(scene.mesh, scene.setting), own)
    pixels[image.hidden & stripes(scene.face.shape, scene.stripe, 4)] = REASONS["occluded"].colour
    return pixels


def camera_keys(image: CameraImage) -> list[Key]:
    """Legend of a picture of a camera: everything that is in it."""
    scene = image.scene
    is_judged = scene.mesh.task_mask & ~scene.backs
    pairs = (scene.face, image.surface), (scene.targets, image.targets)
    judged = np.concatenate([rows[on_pixels(is_judged, face)] for face, rows in pairs])
    shown = np.flatnonzero(np.bincount(judged))[::-1].tolist()  # what is covered, first
    keys = [Key.of_reason(NAMES[reason]) for reason in shown]
    keys += scene_keys([scene])
    if image.hidden.any():
        colours = scene.setting.occluder, REASONS["occluded"].colour
        keys.append(Key.of("occluder that hides the evaluated surface", *colours, 4, 4))
    if (scene.face < 0).any():
        keys.append(Key.of("background", scene.setting.background))
    return keys


FRUSTUM = 0.16
"""Length of the edges of a drawn view pyramid, relative to half the diagonal of the scene."""
MANY = 30
"""Cameras up to which their labels are large."""
CROWD = 16
"""Cameras from which on their view pyramids get smaller."""
PARTS = 12
"""Parts of each side of a distorted image, whose border is a curve."""
CLOSE_UP = 0.65 * FINE
"""Scale of the picture of one zone, a third of the width of a page."""
CLOSE_UP_REL = 0.04
"""Least distance around a zone in its own picture, relative to the diagonal of the task."""
LEAST_SHOWN = 0.004
"""Part of such a picture that the zone has, or else is drawn over what hides it."""
ENOUGH = 0.4
"""Part of the most pixels of the zone from any direction that an earlier, oblique one may have."""
TILTS = 0.6 * np.array([(0.5, -0.7, 0.5), (-0.5, 0.7, 0.5), (0.7, 0.5, 0.5), (0.0, 0.0, -1.0)])
"""Of directions of such a picture against the normal of the zone, so that it shows depth."""
DASHES = 8
"""Of an edge of the pyramid of a camera that is kept."""
MOST_ZONES = 30
"""Zones with a number."""
FEW_UNSEEN = 3
"""Zones that a title names as hidden."""
COVERED, ASKED = int(Reason.COVERED), -2
DEVICE_HATCHES = (1, 2, 4, 8, 3, 12)
"""Hatches of cameras of a rig with a rule, as in `reasons.Words`."""
LEAST_PERCENT = 0.01
"""Part of the task, in percent, from which a zone has one."""


NO_EDGES = np.zeros((0, 2, 3))


class Volume(NamedTuple):
    """A limit of places of cameras: what it is, its colour, and its edges (N, 2, 3).

    Or a body, in place of edges. The picture has all of it where it is `whole`.
    """

    name: str
    colour: Colour
    edges: FloatArray = NO_EDGES
    whole: bool = False
    body: Mesh | None = None

    @property
    def ends(self) -> FloatArray:
        """(N, 3) points around it that the picture has."""
        corners = NO_EDGES if self.body is None else box_corners(np.array(self.body.bounds))
        return np.concatenate((self.edges.reshape(-1, 3), corners.reshape(-1, 3)))

    @classmethod
    def box(cls, name: str, colour: Colour, low: FloatArray, high: FloatArray) -> "Volume":
        """A box between two corners."""
        unit = np.array(list(np.ndindex(2, 2, 2)))
        pairs = [(a, b) for a in unit for b in unit if (b - a).sum() == 1 == abs(b - a).sum()]
        return cls(name, colour, low + np.array(pairs) * (high - low))

    @classmethod
    def sphere(
        cls, name: str, colour: Colour, centre: FloatArray, radius: float, whole: bool = False
    ) -> "Volume":
        """A sphere, as three circles."""
        turn = np.linspace(0, 2 * np.pi, 25)
        circle = np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=1)
        rings = np.stack([np.roll(circle, axis, axis=1) for axis in range(3)])
        points = centre + radius * rings
        edges = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
        return cls(name, colour, edges, whole)


@frozen_record
class Overview:
    """A network to be drawn: the surface by the camera that covers it best, no more.

    With `regions` of the poses it is coloured point by point, by the nearest camera that covers it;
    else face by face, by `best_pose`, (F,), -1 for none, -2 for faces that do not matter. `among`
    are all poses of which they are some, and which say what is up; `noun` is a word for a pose. Of
    `zones`, with their entries `said`, those for which a camera of a rig with a rule fails have the
    hatch of that camera. `most` says which camera gives a face its colour, `about` is a title in
    place of that, `left` a word for -1, and `unit` as of `smooth`. `volumes` are limits of the
    places of cameras. The pyramids of cameras that were kept are dashed.
    """

    mesh: Mesh
    camera: Cameras
    placed: Poses
    names: Sequence[str]
    best_pose: IntArray
    regions: Regions | None = None
    among: Poses | None = None
    zones: DeadZones | None = None
    said: Sequence[ReadByName] = ()
    noun: str = "camera"
    most: str = "covers it"
    about: str = ""
    left: str = "not covered"
    volumes: Sequence[Volume] = ()
    unit: str = "m"

    @property
    def devices(self) -> dict[str, int]:
        """As of `device_hatches`."""
        return {} if self.zones is None or self.regions is None else device_hatches(self.said)

    @property
    def eyes(self) -> FloatArray:
        """(K, 3) positions of the cameras."""
        return self.placed.eyes

    @property
    def colours(self) -> list[Colour]:
        """Colours of the cameras."""
        return [(r, g, b) for r, g, b in theme.camera_colours(len(self.placed)).tolist()]

    def pyramids(self) -> list[FloatArray]:
        """View pyramid of each pose: the eye, then the corners of its outline."""
        cameras = cameras_of(self.camera)
        corners = np.concatenate((task_points(self.mesh), self.eyes))
        size = max(float(norm(np.ptp(corners, axis=0))) / 2, 1e-12)
        reach = FRUSTUM * size * math.sqrt(min(1.0, CROWD / max(len(self.placed), 1)))
        return [
            _pyramid(cameras[index], pose, reach)
            for pose, index in zip(self.placed.world_from_camera, self.placed.camera, strict=True)
        ]

    def of_image(self, scene: DrawnScene, face: FaceImage, at: IntArray) -> Pixels:
        """(N, 3) colours of pixels (N,) of the task in a face image of a scene.

        One point of each block of `FINE` x `FINE` pixels is looked up, and those of all pixels of
        the task where that one is not of it.
        """
        colours = np.array([*self.colours, theme.COVERED, theme.UNCOVERED], np.uint8)
        if self.regions is None:
            return colours[self.best_pose[face.ravel()[at]]]
        of_points = partial(nearest_covering, self.regions, self.eyes)
        is_task = on_pixels(self.mesh.task_mask, face)
        asked = is_task & ~_of_blocks(is_task)
        asked[::FINE, ::FINE] = is_task[::FINE, ::FINE]

        def whole(image: WholeArray) -> WholeArray:
            return np.where(asked, image, _of_blocks(image)).ravel()[at]

        best = scene.at_points(face, of_points, np.int32(-1), asked)
        pixels: Pixels = colours.take(whole(best), axis=0, mode="wrap")
        if self.zones is None or not self.devices:
            return pixels
        of_zones = partial(zones_at, self.zones, n=len(self.said))
        zone = scene.at_points(face, of_zones, np.int32(-1), asked & (best < 0))
        hatch = _hatches_of(self.said, self.devices)[whole(zone)]
        return hatch_pixels(pixels, hatch, at, face.shape[1], scene.hatch)

    def picture(self) -> Image.Image:
        """The task, which fills the picture, and from another side with all cameras."""
        mesh, pyramids = self.mesh, self.pyramids()
        poses = (self.among or self.placed).world_from_camera
        first, other = sides(mesh, poses)
        if other[2] < 0 and front_of(mesh, poses) is None:
            other = first * (-1, -1, 1)
        drawn = [*pyramids, *(each.ends for each in self.volumes if each.whole)]
        ends = np.concatenate([*(each.reshape(-1, 3) for each in drawn), np.zeros((0, 3))])
        scenes = [look(mesh, first, eyes=poses), look(mesh, other, ends, eyes=poses)]
        near = pyramids if is_inside(mesh, poses) else []  # others would be before the task
        images = [self.draw(scenes[0], near), self.draw(scenes[1], pyramids, self.volumes)]
        keys = [
            Key.of(f"{f'{self.noun} ' * (row == 0)}{name}", colour)
            for row, (name, colour) in enumerate(zip(self.names, self.colours, strict=True))
        ]
        keys.append(Key.of(self.left, theme.UNCOVERED))
        keys += _device_keys(self.devices)
        keys += {each.name: Key.of(each.name, each.colour) for each in self.volumes}.values()
        title = plural(len(self.placed), self.noun)
        if self.about:
            title += self.about
        elif len(self.placed):
            which = "nearest " if self.regions else "best " if self.most == "covers it" else ""
            title += f"; the surface is coloured by the {which}{self.noun} that {self.most}"
        return add_frame(beside(images), title, [*keys, *scene_keys(scenes)])

    def draw(
        self, scene: DrawnScene, pyramids: Sequence[FloatArray], volumes: Sequence[Volume] = ()
    ) -> Image.Image:
        """A scene in the colours of its cameras, with the first of them, by their pyramids."""
        pixels = paint(scene, neutral(self.mesh), partial(self.of_image, scene))
        bodies = [(each.body, each.colour) for each in volumes if each.body is not None]
        image, scene = draw_bodies(Image.fromarray(pixels), scene, bodies)
        colours = self.colours
        for each in volumes:
            lines = [Line(start, end, 1.6, PIECES) for start, end in each.edges]
            draw_in_space(image, scene, lines, each.colour)
        rows, places = in_picture(scene, self.eyes[: len(pyramids)])
        for row in rows:
            lines = _edges(pyramids[row])
            if self.names[row].endswith(KEPT):
                lines = [dash for line in lines for dash in _dashes(line)]
            draw_in_space(image, scene, lines, colours[row])
        font = font_for(round(FINE * (850 if len(self.placed) <= MANY else 600)))
        names = [self.names[row] for row in rows]
        # Beside what rides on the cameras, or it is hidden.
        areas = 0.0 if any(each.whole and each.body is None for each in volumes) else np.inf
        write_labels(image, places, names, [colours[row] for row in rows], font, FINE, areas)
        return smooth(image, scene, self.unit)


def device_hatches(zones: Sequence[ReadByName]) -> dict[str, int]:
    """Hatch by the words on each sensor and lamp for which zones of a summary are not covered."""
    names = sorted({*map(device_words, zones)} - {""})
    return {name: DEVICE_HATCHES[row % len(DEVICE_HATCHES)] for row, name in enumerate(names)}


def device_words(zone: ReadByName) -> str:
    """Words on the sensor that fails in a zone, or its lamp; "" for neither."""
    return fails(zone["device"], zone["reason"]) if "device" in zone else ""


def _hatches_of(zones: Sequence[ReadByName], devices: Mapping[str, int]) -> ByteArray:
    """(n + 1,) hatch of each of n zones by the camera that fails; none of what is in no zone."""
    return np.array([*(devices.get(device_words(zone), 0) for zone in zones), 0], np.uint8)


def _device_keys(devices: Mapping[str, int]) -> list[Key]:
    return [Key.of(name, theme.UNCOVERED, hatch=hatch) for name, hatch in devices.items()]


def _of_blocks(image: AnyArray) -> AnyArray:
    """(H, W) first pixel of the block of `FINE` x `FINE` pixels that each pixel is in."""
    first = image[::FINE, ::FINE].repeat(FINE, axis=0).repeat(FINE, axis=1)
    return first[: image.shape[0], : image.shape[1]]


def nearest_covering(
    regions: Regions, eyes: FloatArray, face: Int32Array, points: FloatArray
) -> IntArray:
    """(N,) pose whose eye, of (P, 3), is nearest to points (N, 3) of faces (N,) that it covers.

    -1 where none covers the point.
    """
    best, reach = np.full(len(face), -1, np.int64), np.full(len(face), np.inf)
    covers = covering_poses(regions, face, points)
    for pose in np.flatnonzero(covers.any(axis=0)).tolist():  # few cameras, many points
        rows = np.flatnonzero(covers[:, pose])
        away = norm(points.take(rows, axis=0) - eyes[pose])
        nearer = away < reach[rows]
        best[rows[nearer]] = pose
        reach[rows[nearer]] = away[nearer]
    return best


def best_covering(network: Network) -> IntArray:
    """(F,) place in `network.pose_ids` of the best camera, -1 where it does not cover the face."""
    # The best camera of a face need not cover it.
    least = max(network.task.min_coverage, TINY)
    place = {pose: row for row, pose in enumerate(network.pose_ids)}
    rows = [place.get(pose, -1) for pose in network.best_pose.tolist()]
    return np.where(network.best >= least, np.array(rows, np.int64), -1)


def _pyramid(camera: Camera, pose: FloatArray, reach: float) -> FloatArray:
    """(2, N, 3) where rays around the field of view start and end, the same from each corner on.

    The edges are `reach` long, for every field of view. The border of a distorted image is a curve.
    """
    parts = PARTS if camera.is_curved else 1
    ends = np.stack(view_frame(camera, parts, reach))
    return apply_pose(ends, pose)


def _edges(pyramid: FloatArray) -> list[Line]:
    """Edges of a view pyramid and of its base; the upper edge of its base is the widest."""
    starts, base = pyramid
    parts = len(base) // 4
    sides = zip(starts[::parts], base[::parts], strict=True)
    lines = [Line(start, corner, 1.6, PIECES) for start, corner in sides]
    for row, (one, other) in enumerate(zip(base, np.roll(base, -1, axis=0), strict=True)):
        lines.append(Line(one, other, 1.6 if row >= parts else 4.0, max(1, PIECES // parts)))
    return lines


def _dashes(line: Line) -> list[Line]:
    """Every other piece of a line."""
    ends = np.linspace(line.start, line.end, 2 * DASHES)
    return [
        line._replace(start=a, end=b, pieces=1)
        for a, b in zip(*(ends[::2], ends[1::2]), strict=True)
    ]


def number_cameras(summary: ReadByName) -> list[ReadByName]:
    """The zones of a summary that have a number in the picture and in the list: 1, 2, ..."""
    zones = summary.get("dead_zones", ())
    return [zone for zone in zones if zone["percent"] >= LEAST_PERCENT][:MOST_ZONES]


def zone_rows(summary: ReadByName) -> list[list[str]]:
    """Rows of the list: number, area, share of the task, place, groups, reason; and the rest."""
    zones, shown, rows = summary.get("dead_zones", ()), number_cameras(summary), []
    # Three digits of the largest extent.
    digits = decimals_of(np.abs([zone["extent"] for zone in zones]).max(initial=0.0))
    rest = summary["other_dead_zones"]
    whole = max((zone["area_m2"] for zone in zones), default=0.0)  # one unit for the column
    for number, zone in enumerate(shown, start=1):
        place = ", ".join(text_with_sign(value, digits) for value in zone["centroid"])
        size, share = area(zone["area_m2"], whole=whole), percent(round(zone["percent"] / 100, 9))
        rows.append([str(number), size, share, place, zone_place(zone), zone_reason(zone)])
    if count := len(zones) - len(shown) + n_unlisted(summary):
        parts = [*zones[len(shown) :], rest]
        size = area(sum(part["area_m2"] for part in parts), whole=whole)
        share = percent(sum(part["percent"] for part in parts) / 100)
        rows.append([f"{count:,} more", size, share, "", "", ""])
    return rows


def zones_picture(
    zones: DeadZones,
    summary: ReadByName,
    eyes: ArrayLike = (),
    noun: str = "dead zone",
    rest: str = "",
) -> Image.Image:
    """The dead zones by exact pieces, from the two directions that show most of them.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    summary : mapping
        `rastercov.core.area.zones.summary_of` of them.
    eyes : array_like
        Cameras, as for `look`.
    noun, rest : str
        Words for a zone and for what is in none; that this is covered unless given.
    """
    mesh, listed, devices = (
        zones.mesh,
        number_cameras(summary),
        device_hatches(summary["dead_zones"]),
    )
    weights = np.where(zones.zone < max(1, len(listed)), zones.piece_area, 0.0)
    dead = np.bincount(zones.face, weights, mesh.n_faces) / np.maximum(mesh.areas, 1e-300)
    dead[remember(outer_skin, mesh, eyes)] = 0.0
    scenes = [look(mesh, side, eyes=eyes) for side in best_directions(mesh, dead, eyes=eyes)]
    every = range(len(listed))
    drawn = [_with_zones(zones, scene, listed, every, devices) for scene in scenes]
    percents = [part["percent"] for part in (*summary["dead_zones"], summary["other_dead_zones"])]
    share = percent(min(1.0, round(sum(percents) / 100, 9)))
    title = f"{plural(zones.count(), noun)}, {share} of the area"
    which = "the largest is numbered" if listed else "too small to be drawn"
    which = f"the {len(listed)} largest are numbered" if listed[1:] else which
    title += f"; {which if len(listed) < zones.count() else 'numbered from the largest'}"
    seen = {row for _, rows, _ in drawn for row in rows}
    if unseen := [str(row + 1) for row in range(len(listed)) if row not in seen]:
        title += f"; not visible here: {first_of(unseen, FEW_UNSEEN)}"
    keys = _reason_keys([each for _, _, own in drawn for each in own], devices)
    if rest:
        keys[0] = Key.of(rest, REASONS[NAMES[COVERED]].colour)
    keys += scene_keys(scenes)
    return add_frame(beside([image for image, _, _ in drawn]), title, keys)


def zone_close_up(
    zones: DeadZones,
    summary: ReadByName,
    row: int,
    eyes: ArrayLike = (),
) -> Image.Image | None:
    """A zone of the list from near, with what is around it, seen through what hides it.

    Parameters are those of `zones_picture`, and the row of the zone. None for one that is nothing
    but rounding.
    """
    mesh, listed, devices = (
        zones.mesh,
        number_cameras(summary),
        device_hatches(summary["dead_zones"]),
    )
    faces = np.zeros(mesh.n_faces, bool)
    faces[zones.face[zones.zone == row]] = True

    def is_own(scene: DrawnScene, face: FaceImage) -> BoolArray:
        at = partial(zones_at, zones, n=len(listed))
        own = scene.at_points(face, at, np.int32(-1), on_pixels(faces, face))
        return np.asarray(own == row)

    scene = close_up(mesh, faces, np.array(listed[row]["extent"]), eyes, is_own)
    if scene is None:
        return None
    image, _, own = _with_zones(zones, scene, listed, [row], devices)
    return add_frame(np.asarray(image), "", [*_reason_keys(own, devices), *scene_keys([scene])])


def close_up(
    mesh: Mesh,
    faces: BoolArray,
    extent: FloatArray,
    eyes: ArrayLike = (),
    is_own: Callable[[DrawnScene, FaceImage], BoolArray] = lambda scene, face: face >= 0,
) -> DrawnScene | None:
    """Some faces, (F,), of an extent, (2, 3), from near; None where no side has any.

    Where they are hidden from every side, they are beneath what hides them. `is_own` gives the
    pixels (H, W) of a face image that count, of those with the faces; all unless given.
    """
    low, high = extent
    least = CLOSE_UP_REL * float(norm(np.ptp(task_points(mesh), axis=0)))
    reach = (high - low) / 2 + least
    around = np.stack([(low + high) / 2 - reach, (low + high) / 2 + reach])
    normal = upright(eyes) @ (mesh.normals[faces] * mesh.areas[faces, None]).sum(axis=0)
    front = normal / max(float(norm(normal)), 1e-300)
    tried = [side for side in (*(front + TILTS), front, *DIRECTIONS) if norm(side) > 0.1]

    def show(scene: DrawnScene, image: FaceImage) -> FaceImage:
        """A face image with nothing but the fronts of the faces."""
        values = np.where(on_pixels(faces & scene.fronts, image), image, np.int32(-1))
        return np.where(is_own(scene, values), values, np.int32(-1))

    def alone(scene: DrawnScene) -> FaceImage:
        rows = np.flatnonzero(faces & scene.fronts)
        return show(scene, draw_part(mesh, scene.camera, scene.pose, rows).face)

    def count(scene: DrawnScene, *images: FaceImage) -> int:
        return sum(int((show(scene, each) >= 0).sum()) for each in images if each.max() >= 0)

    scenes = [look(mesh, side, scale=0.15, eyes=eyes, around=around) for side in tried]
    counts = [count(scene, scene.face, scene.beneath, scene.targets) for scene in scenes]
    is_hidden = max(counts) < LEAST_SHOWN * scenes[0].face.size
    if is_hidden:
        counts = [count(scene, alone(scene)) for scene in scenes]
        around += np.array([[-1], [1]]) * reach  # with more of what hides them
    if not any(counts):
        return None
    side = tried[int(np.argmax(np.array(counts) >= ENOUGH * max(counts)))]
    scene = look(mesh, side, scale=CLOSE_UP, eyes=eyes, around=around)
    if not is_hidden:
        return scene
    beneath = alone(scene)
    return replace(scene, beneath=np.where(beneath >= 0, beneath, scene.beneath))


def _reason_keys(rows: Sequence[int], devices: Mapping[str, int]) -> list[Key]:
    """Legend of reasons, by their rows in `REASONS`: what is covered, first; of cameras after it.

    Where there are hatches of cameras, reasons have none.
    """
    names = [NAMES[row] for row in dict.fromkeys([COVERED, *sorted(rows)])]
    if not devices:
        return list(map(Key.of_reason, names))
    labels = dict[Colour, list[str]]()
    for name in names:
        labels.setdefault(REASONS[name].colour, []).append(REASONS[name].label)
    keys = [Key.of(" or ".join(own), colour) for colour, own in labels.items()]
    return [*keys, *_device_keys(devices)]


def _with_zones(
    zones: DeadZones,
    scene: DrawnScene,
    listed: Sequence[ReadByName],
    named: Sequence[int],
    devices: Mapping[str, int],
) -> tuple[Image.Image, list[int], list[int]]:
    """One view of the zones, with the numbers of some that are seen; these, and reasons in it."""
    n, mesh = len(listed), zones.mesh
    numbered_reasons = leads(zones.reasons(n)).tolist()
    own_reasons = np.array([*numbered_reasons, *range(len(NAMES)), COVERED], np.uint8)
    of_devices = np.pad(_hatches_of(listed, devices), (0, len(NAMES)))
    # Row of the zone at each pixel; n and its reason without a number, -1 for none.
    layers: list[WholeArray] = []
    row_of = np.where(zones.zone < n, zones.zone, n + zones.leads.astype(np.int64))
    drawn: set[int] = set()
    # Only faces in several zones, or dead in part, have to be asked point by point.
    known = np.full(mesh.n_faces + 1, -1, np.int32)
    known[zones.face] = row_of
    part = zones.piece_area < (1 - WHOLE_REL) * mesh.areas[zones.face]
    known[zones.face[part]] = ASKED

    zone_of = partial(zones_at, zones, n=len(own_reasons) - 1, row=row_of)

    def own(face: FaceImage, at: IntArray) -> Pixels:
        take = known.take(face, mode="wrap")
        asked = take == ASKED
        layers.append(np.where(asked, scene.at_points(face, zone_of, np.int32(-1), asked), take))
        of_zones = layers[-1].ravel()[at]
        rows = own_reasons[of_zones]
        counts = np.bincount(rows, minlength=len(NAMES))
        drawn.update(np.flatnonzero(counts > FEW_REL * face.size).tolist())
        hatch = of_devices[of_zones] if devices else theme.REASON_HATCHES[rows]
        colours = theme.REASON_COLOURS.take(rows, axis=0)
        return hatch_pixels(colours, hatch, at, face.shape[1], scene.hatch)

    pixels = paint(scene, neutral(mesh), own)
    shown = layers[0]
    for of_layer in layers[1:]:
        shown = np.where(of_layer >= 0, of_layer, shown)
    shown = np.where(shown < n, shown, -1).astype(np.int8)
    pixels[outlines(shown)] = theme.INK
    image = Image.fromarray(pixels)
    spots = np.stack(np.nonzero(shown >= 0)[::-1], axis=1) + 0.5
    of_zones = shown[shown >= 0]
    counts = np.bincount(of_zones, minlength=n)
    rows = [row for row in named if counts[row]]
    places = np.array([middle_of(spots[of_zones == row]) for row in rows]).reshape(-1, 2)
    own_colours = [REASONS[listed[row]["reason"]].colour for row in rows]
    names, font = [str(row + 1) for row in rows], font_for(round(FINE * 1200))
    write_labels(image, places, names, own_colours, font, FINE, counts[rows])
    return smooth(image, scene, "m"), rows, sorted(drawn)


def middle_of(places: FloatArray) -> FloatArray:
    """The one of some places, (N, 2), that is nearest to the median of all of them."""
    away: FloatArray = places - np.median(places, axis=0)
    return places[dots(away, away).argmin()]
