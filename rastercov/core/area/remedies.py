"""Advice for dead zones: the camera that comes nearest, what it misses, and a tried change.

The nearest camera is one with a free line of sight to most of a zone where there is any, and of
these the one that misses its criteria by the smallest factor. A change of it (rotated, refocused,
with a longer lens, or moved) is tested against points of the zone, and reported if it covers `SURE`
of them, enough to be sure of half. It takes the place of the camera where all cameras together
then cover no less, exactly, and names the groups that lose by it; otherwise it is one of another
camera of this kind.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    FloatArray,
    IntArray,
    arctan2,
    dots,
    first_of,
    matmul,
    norm,
    sort_order,
)
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import distance as in_metres
from rastercov.base.format import text_with_sign
from rastercov.core.area.advice import figures_of_point, general_advice, short_of
from rastercov.core.area.point_pass import MARGIN_REL
from rastercov.core.area.polygons import frames_of, in_front
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import failures_of_rows, unite_regions
from rastercov.core.area.union import RegionUnion
from rastercov.core.camera import (
    MODELS,
    Camera,
    Cameras,
    Poses,
    Rig,
    axes_of,
    cameras_of,
    distance_to_keep,
    equipment_on,
    eyes_of,
    fibonacci_sphere,
    gates_of,
    is_joint,
    look_at,
    names_of,
    rows_of_result,
    to_camera,
    to_image,
)
from rastercov.core.camera.projection import view_border
from rastercov.core.camera.viewpoints import depth_of_targets
from rastercov.core.coverage.task import (
    NO_CAMERAS,
    REASONS,
    TOO_FEW_VIEWS,
    UNSEEABLE,
    Reason,
    Task,
    name_of,
    rows_in,
    tasks_of,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import inverse
from rastercov.core.mesh.solids import hiders_of, matter_of, rooms_at

SURE, SCREENED = 0.55, 12
"""Part of the points of a zone that a change covers before it is said; points of a first look."""
NO_SIGHT = "no present camera has a clear line of sight to even half of it"
IN_SIGHT = 0.5
"""Part of some points of a zone from which a line of sight to it counts as free."""
PLACES, NEARER, WIDER = 64, (1.0, 0.7, 0.4), (0.7, 1.2, 2.0, 3.5)
"""Directions around a zone of places that are tried; shares of the distance of the camera, and
times the radius of the zone, at which they are."""
TURN, DOWN = "for a second run turn the part ", 0.5
"""Advice for what no arm brings a camera to; cosine from which a side is below."""
LONGER = (1.05, 1.4)
"""Times the focal length that is missing."""
LEAST_REL = 1e-9
"""Area, relative to the task, below which a group gains or loses nothing: rounding of a union."""
UPRIGHT = 1e-3
"""Difference of the axes of a camera from those of an upright image that is rounding."""
MOST_PAIRS = 1_000_000
"""Pairs of camera and face up to which the area after a change is measured, of all zones."""


Places = Callable[[FloatArray, FloatArray], FloatArray]
"""Of a point that is to be covered, and places around it for a camera, (N, 3), those that are
allowed, or others that are."""
IsFree = Callable[[FloatArray], BoolArray]
"""True for each of (N, 3) camera centres that can be where they are."""


def outside_of_matter(mesh: Mesh, clearance: float = 0.0) -> IsFree:
    """Places outside bodies of a mesh, as of `in_solid`, that keep a distance from its surface."""
    matter, hiders = matter_of(mesh), hiders_of(mesh)

    def is_free(eyes: FloatArray) -> BoolArray:
        mask = ~matter.holds(eyes)
        if clearance > 0 and hiders.tree is not None:
            mask &= hiders.tree.nearest(hiders.place(eyes))[0] * hiders.diagonal >= clearance
        return mask

    return is_free


class Allowed(NamedTuple):
    """Cameras that advice may name.

    Attributes
    ----------
    places : Places or None
        Anywhere for None.
    kind : int
        Row of the camera that is added where there is none.
    reaches : callable or None
        True for the world_from_camera of a camera by its row, where what carries it reaches that
        pose; None for any.
    permits : callable or None
        True for a camera and its pose that see no more than they may; None for any.
    adds_only : bool
        True where cameras are changed for no zone, since goals of other surfaces need them.
    free : callable
        Of the mesh in a frame of a motion, and the distance from it that cameras keep unless a plan
        has another, m, the places that it leaves free.
    further : Places or None
        To be tried after `places`.
    """

    places: Places | None = None
    kind: int = 0
    reaches: Callable[[FloatArray, int], bool] | None = None
    permits: Callable[[Cameras, Poses], bool] | None = None
    adds_only: bool = False
    free: Callable[[Mesh, float], IsFree] = outside_of_matter
    further: Places | None = None


ANY = Allowed()
"""All cameras."""


class ZoneSpot(NamedTuple):
    """Points of a zone, (N, 3), their faces, (N,), and the row of the one in the middle.

    `views` is the number of cameras that the zone needs.
    """

    points: FloatArray
    face: IntArray
    middle: int
    views: int = 1

    @classmethod
    def of(cls, points: FloatArray, face: IntArray, views: int = 1) -> "ZoneSpot":
        """With the point that is nearest to the mean."""
        away: FloatArray = points - points.mean(axis=0)
        return cls(points, face, int(dots(away, away).argmin()), views)

    @property
    def at(self) -> FloatArray:
        """The point in the middle."""
        return self.points[self.middle]


class NearestCamera(NamedTuple):
    """A camera and what it misses of a zone.

    Attributes
    ----------
    row : int
        Of its pose.
    figures : dict
        Of the point in the middle, as of `figures_of_point`.
    missed : dict
        Factor by which each criterion is missed that is.
    """

    row: int
    figures: dict[str, float]
    missed: dict[Reason, float]


class Change(NamedTuple):
    """A camera that looks at a zone.

    Attributes
    ----------
    words, other : str
        What is done to the camera that is named, and to another one; {room} is that of the eye.
    eye, target : (3,) float64
    camera : Camera or None
        In place of the camera.
    more : dict or None
        Entries on the camera.
    """

    words: str
    other: str
    eye: FloatArray
    target: FloatArray
    camera: Camera | None = None
    more: dict[str, float] | None = None


@dataclass
class Remedies:
    """Cameras, and changes of them that are tried for zones; one thread may use it.

    Attributes
    ----------
    mesh, camera, task, poses
        The network.
    covered_m2 : (F,) float64 or None
        Area of each face that it covers; None if parts need several cameras.
    allowed : Allowed
        Cameras that may be named.
    pairs : int
        Pairs of camera and face that were measured so far, see `MOST_PAIRS`.
    most_judged : int
        Nearest cameras of which one is named.
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    poses: Poses
    covered_m2: FloatArray | None
    allowed: Allowed = ANY
    pairs: int = 0
    most_judged: ClassVar[int] = 64

    def say(
        self, spot: ZoneSpot, winner: int, failing: IntArray, hider: str, *, is_tried: bool
    ) -> ByName:
        """`nearest`, a pose with its figures, `advice`, and what was `tried`, for a zone.

        Parameters
        ----------
        spot : Spot
            Points of the zone.
        winner : int
            Code of its reasons.
        failing : (K,) int
            Rows of the poses that fail for it, those that fail most of it first.
        hider : str
            What hides it.
        is_tried : bool
            True where a change is looked for.
        """
        reason, rows = name_of(winner), rows_in(winner)
        if winner == UNSEEABLE or REASONS[reason].nearest:
            return {"nearest": None, "advice": general_advice(reason), "tried": None}
        is_alone = max(rows) < Reason.COVERED and not gates_of(self.camera)
        named, facts, row = None, [], 0
        if is_alone and len(self.poses):
            named = self.nearest(spot)
        elif winner not in (TOO_FEW_VIEWS, NO_CAMERAS) and len(failing):
            named = self._nearest_miss(int(failing[0]), spot)
        if named is not None:
            row, facts = named.row, self._facts(named, hider)
            if is_alone and not facts:
                facts = ["it sees half of the zone or more, but not its middle"]
            elif winner == Reason.BACK_FACING:  # of a rig: angles would be those of the other side
                named, facts = None, [NO_SIGHT]
        elif is_alone:
            eyes = self.poses.eyes
            row = int(norm(eyes - spot.at).argmin())
            facts = [NO_SIGHT]
        if is_alone and named is not None and named.missed and not named.missed.keys() >= {*rows}:
            facts[-1] += (
                " (another camera meets more criteria and gives the zone's reason, "
                f"{REASONS[reason].label})"
            )
        words, entries = self.try_change(named, row, spot) if is_tried else ("", None)
        said = None if named is None else self._figures(named)
        text = "; ".join(each for each in (*facts, words) if each)
        return {"nearest": said, "advice": text, "tried": entries or None}

    def _figures(self, named: NearestCamera) -> ByName:
        """Entries of `nearest`."""
        more = dict(named.figures)
        distance, incidence = more.pop("distance"), more.pop("incidence")
        own = {"distance_m": distance, "incidence_deg": math.degrees(incidence)}
        if gates_of(self.camera):
            own["head"] = int(rows_of_result(self.camera, self.poses)[named.row]) + 1
        return {"pose": int(self.poses.ids[named.row]), **own, **more}

    def _facts(self, named: NearestCamera, hider: str) -> list[str]:
        """Criteria that a camera misses, that by the largest factor first; else what hides most."""
        ranked = sorted(named.missed, key=lambda each: -named.missed[each])
        if not ranked:
            return [f"{hider} blocks the view"] if hider else []
        return [self._fact(named, each) for each in ranked]

    def _fact(self, named: NearestCamera, reason: Reason) -> str:
        """Figure by which a camera misses a criterion in the middle of a zone."""
        index = int(self.poses.camera[named.row])
        camera, task = cameras_of(self.camera)[index], tasks_of(self.camera, self.task)[index]
        distance = in_metres(named.figures["distance"])
        if reason == Reason.TOO_COARSE and (short := short_of(named.figures, task)):
            return (
                f"{'just below ' * f'{short.found} '.startswith(f'{short.wanted} ')}{short.found} "
                f"at {distance}, {short.wanted} required"
            )
        if reason == Reason.OUT_OF_FOCUS:
            near, far = camera.depth_of_field(task.max_blur)
            to = "or more" if math.isinf(far) else f"to {in_metres(far)}"
            value = named.figures["distance"]
            just = "just " * (distance in (in_metres(near), in_metres(far)))
            side = "beyond" if value > (near + far) / 2 else "before"
            away = f"{just}{side} the depth of field, {in_metres(near)} {to}"
            return f"it is {distance} away, {away}"
        if reason == Reason.TOO_OBLIQUE:
            angle = math.degrees(named.figures["incidence"])
            return (
                f"incidence {'just above ' * (f'{angle:.3g}' == f'{task.max_incidence_deg:g}')}"
                f"{angle:.3g}°, at most {task.max_incidence_deg:g}° allowed"
            )
        return "the middle is outside the image"

    def nearest(self, spot: ZoneSpot) -> NearestCamera | None:
        """The camera that comes nearest to covering a zone, of those with a line of sight."""
        eyes = self.poses.eyes
        away = norm(eyes - spot.at)
        near = np.sort(sort_order(away)[: self.most_judged])
        some = np.unique(np.append(np.linspace(0, len(spot.face) - 1, 8).astype(int), spot.middle))
        free = self._sees(self.poses[near], spot.points[some], spot.face[some])
        return min(
            (self._nearest_miss(int(row), spot) for row in near[free.mean(axis=1) >= IN_SIGHT]),
            key=lambda each: max(each.missed.values(), default=1.0),
            default=None,
        )

    def _more_figures(self, row: int, spot: ZoneSpot) -> dict[str, float]:
        """Further figures of the middle of a zone in a pose."""
        return {}

    def _nearest_miss(self, row: int, spot: ZoneSpot) -> NearestCamera:
        """Criteria that a camera misses at the middle of a zone, occlusion left out."""
        index, pose = int(self.poses.camera[row]), self.poses.world_from_camera[row]
        camera, task = cameras_of(self.camera)[index], tasks_of(self.camera, self.task)[index]
        normal = frames_of(self.mesh).normal[spot.face[spot.middle]]
        figures = figures_of_point(camera, pose, spot.at, normal) | self._more_figures(row, spot)
        local, missed = to_camera(spot.at[None], pose)[0], dict[Reason, float]()
        off = _off_image(camera, local)
        if off > 0:
            missed[Reason.OUTSIDE] = 1 + off
        is_planar = camera.is_pinhole or MODELS[camera.model].is_planar
        depth = float(local[2] if is_planar else figures["distance"])
        near, far = camera.depth_of_field(task.max_blur)
        if depth > 0 and not near <= depth <= far:
            missed[Reason.OUT_OF_FOCUS] = max(near / depth, depth / far)
        if short := short_of(figures, task):
            missed[Reason.TOO_COARSE] = short.factor
        angle = math.degrees(figures["incidence"])
        if angle > task.max_incidence_deg:
            missed[Reason.TOO_OBLIQUE] = angle / task.max_incidence_deg
        return NearestCamera(row, figures, missed)

    def _sees(self, poses: Poses, points: FloatArray, face: IntArray) -> BoolArray:
        """(P, N) free lines of sight from poses to the sides of points that count."""
        frames, axes = frames_of(self.mesh), axes_of(self.camera, poses)
        is_seen = (
            in_front(eyes_of(self.camera, poses), points, frames.normal[face])
            | self.mesh.two_sided_mask[face]
        )
        rows, columns = np.nonzero(is_seen)
        hiders = hiders_of(self.mesh)
        if hiders.tree is None or not len(rows):
            return is_seen
        own = np.full(self.mesh.n_faces, -1)
        own[hiders.solid] = np.arange(len(hiders.solid))
        starts, ends = poses.world_from_camera[rows, :3, 3], points[columns]
        depth = dots(ends - starts, axes[rows])[:, None]
        starts = np.where(
            (axes[rows] != 0).any(axis=1, keepdims=True), ends - depth * axes[rows], starts
        )
        starts, ends = hiders.place(starts), hiders.place(ends)
        along = ends - starts
        length = np.maximum(norm(along), 1e-300)
        ways, own = along / length[:, None], own[face[columns]]
        is_seen[rows, columns] = hiders.tree.first_hits(starts, ways, length - MARGIN_REL, own) < 0
        return is_seen

    def try_change(
        self, name: NearestCamera | None, row: int, spot: ZoneSpot
    ) -> tuple[str, ByName]:
        """Words on a change that covers half of a zone, and its entries; or on none, and {}.

        `row` is that of the pose of which it is one, and `name` the camera that is named, if any.
        """
        count, reach, is_blocked, is_beyond, is_over = 0, 0.0, False, False, False
        changes = self._changes(name, row, spot)
        rows = np.linspace(0, len(spot.face) - 1, SCREENED).astype(int)
        few = ZoneSpot(spot.points[rows], spot.face[rows], 0)
        for _, some in groupby(changes, lambda each: each.camera):
            own = list(some)
            reach = max(reach, *norm(np.array([each.eye for each in own]) - spot.at).tolist())
            for change, first in zip(own, self._shares(own, row, few), strict=True):
                count += 1
                if first < SURE or (share := self._share(change, row, spot)) < SURE:
                    continue
                if not self._is_free(change, row):
                    is_blocked = True
                    continue
                if not self._reaches(change, row):
                    is_beyond = True
                    continue
                if not self._permits(change, row):
                    is_over = True
                    continue
                gains = {} if name is None else self._gains(change, row)
                is_moved = bool(gains)
                entries = {
                    "pose": int(self.poses.ids[row]) if is_moved else None,
                    "position": change.eye.tolist(),
                    "looking_at": change.target.tolist(),
                    **(change.more or {}),
                    "covers_percent": 100 * share,
                    **({"group_gains_m2": gains} if is_moved else {}),
                }
                (room,) = rooms_at(self.mesh, change.eye[None])
                words = change.words if is_moved else change.other
                words = words.format(room=f" in room {room}" if room else "")
                entries["change"] = words
                gain = "be covered" if spot.views == 1 else f"gain a view, {spot.views} required"
                less = [
                    f"{g} would lose {in_square_metres(-m2)}" for g, m2 in gains.items() if m2 < 0
                ]
                cost = f"; {first_of(less)}" if less else ""
                return f"{words}: about {100 * share:.0f} % of the zone would {gain}{cost}", entries
        if not count:
            return "no position that may hold a camera was found", {}
        words = "no position" if count == 1 else f"none of the {count} positions"
        words += f" tried within {in_metres(reach)} of the zone's middle"
        words += " that are clear of bodies" if is_blocked else ""
        words += " that can be reached" if is_beyond else ""
        end = " and see no more than the goals permit" if is_over else ""
        facing = frames_of(self.mesh).normal[spot.face].mean(axis=0)
        is_below = facing[2] < -DOWN * float(norm(facing))
        if self.allowed.reaches is not None and (is_beyond or is_below):
            end += f"; {TURN}{'over: this side faces down' if is_below else 'towards the arm'}"
        return f"{words} would cover at least half of it{end}", {}

    def _index(self, row: int) -> int:
        """Row of the camera of a pose, or of the one that is added where there is none."""
        return int(self.poses.camera[row]) if len(self.poses) else self.allowed.kind

    def _frames(self) -> Iterator[Mesh]:
        """The scene in each of its frames."""
        yield self.mesh

    @cached_property
    def _free(self) -> list[tuple[IsFree, IsFree]]:
        """Places that each frame leaves free for a camera that stays, and for one that moves."""
        kept = distance_to_keep(cameras_of(self.camera))
        frames = self._frames()
        return [(self.allowed.free(each, 0.0), self.allowed.free(each, kept)) for each in frames]

    def _is_free(self, change: Change, row: int) -> bool:
        """True where the cameras of a change are at free places in every frame."""
        eyes = self._place_changes([change], row)[2].eyes
        here = self.poses.world_from_camera[row : row + 1, :3, 3]
        is_moved = not (len(here) and np.array_equal(change.eye, here[0]))
        return all(bool(free[is_moved](eyes).all()) for free in self._free)

    def _reaches(self, change: Change, row: int) -> bool:
        """True where a camera can be brought to a change."""
        reaches = self.allowed.reaches
        return reaches is None or reaches(look_at(change.eye, change.target)[0], self._index(row))

    def _permits(self, change: Change, row: int) -> bool:
        """True where a camera at a change sees no more than it may."""
        if self.allowed.permits is None:
            return True
        camera, _, poses = self._place_changes([change], row)
        return self.allowed.permits(camera, poses)

    def _changes(self, name: NearestCamera | None, row: int, spot: ZoneSpot) -> Iterator[Change]:
        """Changes of a camera that may cover a zone, the smallest first."""
        scale = max(float(norm(spot.points - spot.at).max()), 1e-12)
        target, to = round_point(spot.at, scale)
        is_one = not is_joint(self.camera)
        index = self._index(row)
        new = "rig with its first sensor" if gates_of(self.camera) else "camera"
        for word, own in equipment_on(self.camera).items():
            if own.carried_by(names_of(self.camera))[:, index].any():
                new += f" and its {word}"
        camera, away = cameras_of(self.camera)[index], self.mesh.diagonal / 2
        origin = spot.at
        if len(self.poses):
            origin = self.poses.world_from_camera[row, :3, 3]
            away = float(norm(origin - spot.at))
        aimed = to
        if len(self.poses) and _is_rolled(self.poses.world_from_camera[row]):
            aimed += " with its image upright"
        if name is not None:
            yield Change(
                f"aim the camera at {aimed}",
                f"add a second {new} at the same place, aimed at {to}",
                origin,
                target,
            )
            depth = float(f"{name.figures['distance']:.3g}")
            is_blurred = is_one and Reason.OUT_OF_FOCUS in name.missed
            if is_blurred and camera.focus_distance and depth > (camera.focal_length or 0):
                focused = replace(camera, focus_distance=depth)
                yield Change(
                    f"focus the camera at {in_metres(depth)} and aim it at {aimed}",
                    f"add a second camera at the same place, focused at {in_metres(depth)}, "
                    f"aimed at {to}",
                    *(origin, target, focused, {"focus_distance_m": depth}),
                )
            factor = name.missed.get(Reason.TOO_COARSE, 0.0)
            most = longest(camera)
            for times in (float(f"{factor * more:.3g}") for more in LONGER):
                if is_one and 1 < times < most:
                    yield Change(
                        f"give the camera {times:g} times the focal length and aim it at {aimed}",
                        f"add a second camera at the same place with {times:g} times the focal "
                        f"length, aimed at {to}",
                        *(origin, target, longer(camera, times), {"focal_length_times": times}),
                    )
        short = 1.0 if name is None else name.missed.get(Reason.TOO_COARSE, 1.0)
        reaches = {away * part / more for part in NEARER for more in (1.0, short)}
        reaches |= {scale * part for part in WIDER}
        if camera.is_parallel:
            reaches.add(depth_of_targets(camera, away))
        near, far = camera.depth_of_field(tasks_of(self.camera, self.task)[index].max_blur)
        near = max(near, camera.near)
        if not any(near <= each <= far for each in reaches):
            reaches.add(camera.focus_distance or (near + min(far, 3 * near)) / 2)
        places, eyes = self._places(spot, reaches, origin), self.poses.eyes
        sizes = np.maximum(norm(places - spot.at), 1e-12).tolist()
        for place, size in zip(places, sizes, strict=True):
            eye, text = round_point(place, size)
            others = eyes[norm(eyes - eye) <= size / 10]
            if (eye == target).all() or text in (round_point(e, size)[1] for e in others):
                continue  # a camera is there
            moved = in_metres(float(norm(eye - origin)))
            yield Change(
                f"move the camera {moved} to {text}{{room}} and aim it at {aimed}",
                f"add a {new} at {text}{{room}}, aimed at {to}",
                *(eye, target),
            )

    def _places(self, spot: ZoneSpot, reaches: set[float], origin: FloatArray) -> FloatArray:
        """(N, 3) permitted places, some distances in front of a zone, by their way from one."""
        normal = frames_of(self.mesh).normal[spot.face]
        ways = fibonacci_sphere(PLACES)
        is_front = matmul(normal, ways.T) > 0
        fronts = (is_front | self.mesh.two_sided_mask[spot.face][:, None]).mean(axis=0)
        ways = ways[fronts >= SURE]
        places = spot.at + np.multiply.outer(np.array(sorted(reaches)), ways).reshape(-1, 3)
        places = places[norm(places - spot.at) > 0]
        kinds = [each for each in (self.allowed.places, self.allowed.further) if each is not None]
        ranked = [each(spot.at, places) for each in kinds] or [places]
        return np.concatenate([own[sort_order(norm(own - origin))] for own in ranked])

    def _place_changes(self, changes: Sequence[Change], row: int) -> tuple[Cameras, Task, Poses]:
        """A camera, or the rig of it, at changes with one camera, alone."""
        eyes, targets = (
            np.array(each) for each in zip(*((c.eye, c.target) for c in changes), strict=True)
        )
        poses = look_at(eyes, targets)
        index = self._index(row)
        if (camera := changes[0].camera) is not None:
            return camera, tasks_of(self.camera, self.task)[index], Poses.of(poses)
        for at, gate in gates_of(self.camera).items():
            if at <= index < at + gate.n and isinstance(self.camera, Rig):
                rows = np.tile(np.arange(at, at + gate.n), len(poses))
                world = matmul(poses, inverse(self.camera.rig_from_camera[at]))
                placed = self.camera._place(np.repeat(world, gate.n, axis=0), rows)
                return self.camera, self.task, Poses.of(placed, camera=rows)
        return self.camera, self.task, Poses.of(poses, camera=np.full(len(poses), index))

    def _shares(self, changes: Sequence[Change], row: int, spot: ZoneSpot) -> Iterator[float]:
        """Share of the points of a zone that each of some changes covers."""
        scene = self.mesh, *self._place_changes(changes, row)
        for _, reason, _ in failures_of_rows(*scene, spot.points, spot.face):
            yield np.count_nonzero(reason == int(Reason.COVERED)) / len(reason)

    def _share(self, change: Change, row: int, spot: ZoneSpot) -> float:
        """The same of one change."""
        return next(self._shares([change], row, spot))

    def _gains(self, change: Change, row: int) -> dict[str, float]:
        """Area, m^2, by group, that all cameras together cover more after a change, below 0 less.

        {} where they cover less in all, or where that is not known.
        """
        n = len(self.poses) * self.mesh.n_faces
        is_known = self.covered_m2 is not None and self.pairs + n <= MOST_PAIRS
        if not is_known or self.allowed.adds_only or gates_of(self.camera):
            return {}
        if isinstance(self.camera, Rig) and np.ptp(self.camera.rig_from_camera, axis=0).any():
            return {}  # one may be fixed to another
        self.pairs += n
        matrices, index = self.poses.world_from_camera.copy(), self.poses.camera.copy()
        matrices[row] = look_at(change.eye, change.target)[0]
        camera: Any = self.camera
        if change.camera is not None:
            if isinstance(camera, Rig) and camera.tasks:
                return {}
            camera = (*cameras_of(camera), change.camera)
            index[row] = len(camera) - 1
        finder = RegionPass(self.mesh, camera, self.task, only_task=True)
        placed, mesh = Poses.of(matrices, camera=index), self.mesh
        union = unite_regions(finder, placed, mesh.task_mask, RegionUnion(mesh))
        more = np.where(mesh.task_mask, union.area[0] - self.covered_m2, 0.0)
        if more.sum() < 0:
            return {}
        by_group = np.bincount(mesh.face_group, more, len(mesh.groups))
        least = LEAST_REL * float(mesh.areas[mesh.task_mask].sum())
        return {
            mesh.groups[at].name: float(by_group[at])
            for at in np.flatnonzero(abs(by_group) > least)
        }


def _is_rolled(pose: FloatArray) -> bool:
    """True where the image of a pose is not upright, as it is after a change."""
    eye = pose[:3, 3]
    level = look_at(eye, eye + pose[:3, 2])[0]
    return bool(abs(level[:3, :3] - pose[:3, :3]).max() > UPRIGHT)


def _off_image(camera: Camera, local: FloatArray) -> float:
    """Half angles of view by which a point in camera axes is outside the image; 0 in it."""
    with np.errstate(all="ignore"):
        u, v = to_image(local[None], camera)[0]
    if camera.is_parallel:
        off = max(abs(2 * u / camera.width - 1), abs(2 * v / camera.height - 1)) - 1
        off = float(np.nan_to_num(off, nan=1.0))  # outside the valid region of a lens
        return 0.0 if off <= 0 < local[2] else max(off, 1e-9)
    if (
        0 <= u <= camera.width
        and 0 <= v <= camera.height
        and (local[2] > 0 or not camera.is_pinhole)
    ):
        return 0.0
    border = view_border(camera, 4)
    half = arctan2(norm(border[:, :2]), border[:, 2]).min()
    angle = float(arctan2(norm(local[:2]), local[2]))
    return max(angle / max(float(half), 1e-9) - 1, 1e-9)


def longest(camera: Camera) -> float:
    """Times its focal length that a camera can have, below 1000: a lens focuses beyond it."""
    if not camera.is_pinhole:
        return 0.0
    at, f = camera.focus_distance, camera.focal_length
    return min(1e3, at / f) if at and f else 1e3


def longer(camera: Camera, times: float) -> Camera:
    """A camera with a longer lens."""
    own: ByName = {"fx": camera.fx * times, "fy": camera.fy * times}
    if camera.focal_length is not None:
        own["focal_length"] = camera.focal_length * times
    return replace(camera, **own)


def round_point(point: FloatArray, scale: float) -> tuple[FloatArray, str]:
    """A point to three digits of a length, and its text."""
    digits = min(max(0, 2 - math.floor(math.log10(scale))), 9)
    text = ", ".join(text_with_sign(value, digits) for value in point.tolist())
    return np.array([float(each) for each in text.split(", ")]), f"({text}) m"
