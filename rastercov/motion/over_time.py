"""Figures of coverage over time: by how long, by frame, and what hides the parts that are missed.

A result is `regions_of_frames` with a count. The parts that are covered long enough are regions of
the mesh at rest, and so are the parts that are not, whose reasons are those of the frames in which
they are missed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from rastercov.base import (
    TINY,
    AnyArray,
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    ReadByName,
    check_memory,
    frozen_record,
    norm,
    once_each,
    percent,
    plural,
)
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import percent_of
from rastercov.core.area.advice import general_advice
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.remedies import ANY, MOST_PAIRS, Allowed, Change, Remedies, ZoneSpot
from rastercov.core.area.stages import (
    Divided,
    ReasonPieces,
    Stage,
    any_in_front,
    divide_by_reason,
    failures_of_rows,
    stages_of,
)
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.area.union import Covered, RegionUnion
from rastercov.core.area.zones import CHECKED, MOST_LINES, DeadZones, points_of, zones_of
from rastercov.core.camera import Cameras, Poses, led_by, names_of, rows_of_result
from rastercov.core.coverage.shards import (
    PAIRS_A_SHARD,
    POSES,
    Inputs,
    Wanted,
    arrays_of_regions,
    header_of,
    open_for,
    open_once,
    pack_rows,
    question_of,
    read_npz,
    sha256,
    store_in,
    unpack_rows,
)
from rastercov.core.coverage.task import (
    NO_CAMERAS,
    OWN_CRITERIA,
    TOO_FEW_VIEWS,
    Engine,
    Reason,
    Task,
    name_of,
    nearness,
    own_reasons,
    rows_in,
    tasks_of,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen, inverse
from rastercov.core.mesh.unseeable import areas_in_view, unseeable_areas
from rastercov.motion.motion import Motion
from rastercov.motion.regions import (
    MotionQuery,
    MovingFrames,
    by_time,
    carriers,
    for_long_enough,
    in_units,
    move_with_carrier,
    query_of,
    regions_of_frames,
)
from rastercov.shards import ALONE, Staff, fill
from rastercov.shards.store import whole

MOST_JUDGED = 48
"""Frames, evenly spread, in which the reasons of what is missed are found."""
MOST_NOT_ALWAYS = 5
"""Zones that are not covered all the time in a summary, the largest."""
OF_FRAMES = "rastercov.motion.over_time:make_frames"
"""Function by which workers make a shard."""
OF_MOTION = ("body", "world_from_body", "present")
"""Arrays of a `Motion` that regions depend on."""
IS_COVERED = np.uint8(255)
"""Above all reasons, of which those of light and of rigs with a rule are above `Reason.COVERED`."""
POINTS_OF_ZONE = 8
"""Points of a dead zone that are judged in each."""
CHANGES_A_TURN = 32
"""Changes of cameras that are judged at a time in all frames."""


def check_over_time(task: Task) -> None:
    """Raise `ConfigError` for a threshold that does not apply over time."""
    if task.min_angle_deg > 0:
        raise ConfigError("expected no min_angle_deg over time, got one; leave it out")


@frozen_record(repr=False)
class OverTime(InOneLine):
    """Coverage over time of a moving mesh: `over_time` of an `Evaluation` with `motion`.

    Attributes
    ----------
    asked : MotionQuery
        The motion, and the time for which `Task.views` cameras must cover a point.
    camera : Camera, Rig or sequence of Camera
    poses : Poses
    task : Task
    regions : Regions
        Result of `rastercov.regions` for the motion: R rows per frame, one for each pose of a
        camera, or of a rig with a rule.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> motion = rc.Motion(mesh, {"mesh": rc.turntable(4)})
    >>> eye = rc.look_at((0.6, 0, 0), (0, 0, 0))
    >>> result = rc.evaluate(mesh, camera, eye, motion=motion).over_time
    >>> round(result.share(), 3)  # in some frame: four sides of six
    0.667
    >>> result.share_of_time().round(6).max().item()  # each side in one frame of four
    0.25
    """

    asked: MotionQuery
    camera: Cameras
    poses: Poses
    task: Task
    regions: Regions

    def __post_init__(self) -> None:
        check_over_time(self.task)

    @property
    def motion(self) -> Motion:
        """Motion of the query."""
        return self.asked.motion

    @cached_property
    def frames(self) -> Regions:
        """Parts that at least `Task.views` cameras cover in each frame; one row per frame."""
        return by_time(self.regions, self.motion, self.task.views)

    @cached_property
    def long_enough(self) -> Regions:
        """Parts that are covered for as long as the query asks; one row."""
        if self.asked.views_at == "one time":
            return for_long_enough(self.frames, self.asked)
        return self.asked.long_enough(self.regions, self.task.views)

    def alone(self) -> Regions:
        """Parts that each camera alone covers long enough, one row per camera."""
        return self.asked._alone(self.regions)

    @cached_property
    def time(self) -> Covered:
        """Area of each face that is covered in at least 1 ... N units of time, and its pieces.

        The unit is the greatest common one of `Motion.durations`.
        """
        region_union = RegionUnion(self.motion.mesh, int(self.motion.units.sum()))
        region_union.add(in_units(self.frames, self.motion))
        return region_union.covered()

    def share_of_time(self) -> FloatArray:
        """(F,) covered share, [0, 1], of each face: mean over the time that its body is present."""
        there = (self.motion.units @ self.motion.present)[self.motion.body]
        area = frames_of(self.motion.mesh).areas
        whole = np.maximum(there * area, TINY)
        return np.clip(self.time.area.sum(axis=0) / whole, 0.0, 1.0)

    def longest(self) -> IntArray:
        """(F,) row, of the R rows of a frame, that covers the most of each face, by area and time.

        -1 for a face that is never covered.
        """
        n = self.motion.mesh.n_faces
        n_rows = max(len(self.regions.pose_ids) // len(self.motion), 1)  # none: one that sees none
        frame, row = np.divmod(self.regions.pair_pose.astype(np.int64), n_rows)
        weights = self.regions.area * self.motion.units[frame]
        worth = np.bincount(row * n + self.regions.pair_face, weights, n_rows * n)
        of_rows = worth.reshape(n_rows, n)
        return np.where(of_rows.any(axis=0), of_rows.argmax(axis=0), -1)

    def share(self) -> float:
        """Part of the area of the evaluated faces that is covered long enough."""
        return float(self.areas.summary()["percent"]) / 100

    @cached_property
    def areas(self) -> "TimeAreas":
        """Area that is covered long enough, by face and group, for reports."""
        return TimeAreas(self)

    def curve(self) -> list[dict[str, float]]:
        """Area that is covered in at least 1 ... N units of time, ready for JSON.

        `time` is in the unit of `Motion.durations`, `share` its part of the whole time.
        """
        mesh = self.motion.mesh
        scored, total = mesh.task_mask, float(frames_of(mesh).areas[mesh.task_mask].sum())
        n, unit = len(self.time.area), float(self.motion.durations[0] / self.motion.units[0])
        rows = np.minimum(self.time.area[:, scored].sum(axis=1), total)
        return [
            {"time": unit * k, "share": k / n, "m2": m2, "percent": percent_of(m2, total)}
            for k, m2 in enumerate(rows.tolist(), start=1)
        ]

    def table(self) -> list[ByName]:
        """Start, duration, covered area, camera that covers least, and main occluder by frame.

        `hidden_by` is the moving body that occludes most of the uncovered area; None if none does,
        or if the frame was not analysed.
        """
        motion, mesh = self.motion, self.motion.mesh
        scored, area = mesh.task_mask, frames_of(mesh).areas

        def of_rows(regions: Regions) -> AnyArray:
            weights = np.where(scored[regions.pair_face], regions.area, 0.0)
            return np.bincount(regions.pair_pose, weights, len(regions.pose_ids))

        own, each = of_rows(self.frames), of_rows(self.regions).reshape(len(motion), -1)
        leads, names = self.poses[led_by(self.camera, self.poses)], names_of(self.camera)
        begins = np.cumsum(motion.durations) - motion.durations
        items = []
        for row in range(len(motion)):
            worst = leads[each[row].argsort(stable=True)[:1]]
            total = float(area[scored & motion.present[row][motion.body]].sum())
            items.append(
                {
                    "frame": row,
                    "time": float(begins[row]),
                    "duration": float(motion.durations[row]),
                    "covered_m2": float(own[row]),
                    "of_m2": total,
                    "percent": percent_of(float(own[row]), total),
                    "worst_pose": max(worst.ids.tolist(), default=-1),
                    "worst_camera": next((names[at] for at in worst.camera), ""),
                    "hidden_by": self._judged[1].get(row),
                }
            )
        return items

    @cached_property
    def unseeable(self) -> FloatArray:
        """(F,) area of each face that no camera can ever see in any frame (proved), m^2.

        All 0 if a camera sees into a body.
        """
        mesh = self.motion.mesh
        seen = self.time.area[0] / np.maximum(mesh.areas, 1e-300)
        return areas_in_view(mesh, never_seeable(self.motion), seen)

    @cached_property
    def zones(self) -> DeadZones:
        """Dead zones: parts that are not covered long enough, each of one reason.

        A point passes a criterion if cameras meet it and all criteria before it for long enough;
        its reason is the first one that it fails.
        """
        covered, is_unseeable = self.areas.covered, self.unseeable > 0
        one = np.ones(self.motion.mesh.n_faces, np.int64)
        divide = self._divide if len(self.poses) else None
        return zones_of(covered, one, is_unseeable, divide, NO_CAMERAS)

    def _divide(self, rest: ReasonPieces) -> Divided:
        """As `divide_by_reason`; a stage of one view comes first where several are wanted."""
        mesh, scene = self.motion.mesh, (self.camera, self.task)
        every, *stages = stages_of(mesh, *scene)
        one_view = Stage((TOO_FEW_VIEWS,), *scene, frozenset())
        stages = [every, *[one_view] * (self.task.views > 1), *stages]
        of_surface = own_reasons(mesh, tasks_of(*scene)[0])
        for row in range(len(self.motion)) if OWN_CRITERIA else ():
            moved, kept = self.motion._at(row, of_occluders=False)
            own = own_reasons(moved, tasks_of(*scene)[0])
            of_surface[kept] = np.maximum(of_surface[kept], own)
        ends = self._in_front(self.camera, np.ones(mesh.n_faces, bool)), of_surface
        return divide_by_reason(mesh, rest, iter(stages), self._passes, ends)

    def _passes(self, stage: Stage, asked: BoolArray) -> Covered:
        """Area of faces, (F,), that cameras cover without the criteria of a stage."""
        mesh, query, always = self.motion.mesh, self.asked, self.always()
        union, key = RegionUnion(mesh), (stage.rows, stage.relaxed)
        if key in self._known:
            return self._known.pop(key)
        if stage.rows == (TOO_FEW_VIEWS,):
            union.add(query.long_enough(self.regions))
            return union.covered()
        if always is not self:
            asked = asked | (always.areas.covered.area[0] < frames_of(mesh).areas)
        scene = stage.camera, self.poses, stage.task, Engine()
        job = MovingFrames.of(query, *scene, stage.relaxed, asked)
        regions = job.regions(np.arange(len(self.motion)))
        union.add(query.long_enough(regions))
        if always is not self:
            of_all = RegionUnion(mesh)
            of_all.add(replace(query, over="all").long_enough(regions))
            always._known[key] = of_all.covered()
        return union.covered()

    @cached_property
    def _known(self) -> dict[tuple[tuple[int, ...], frozenset[str]], Covered]:
        """Covered parts by stage, as far as those of another time gave them."""
        return {}

    def _in_front(self, camera: Cameras, asked: BoolArray) -> BoolArray:
        """(F,) faces that cameras are in front of for long enough."""
        motion, rows = self.motion, rows_of_result(camera, self.poses)
        if self.asked.views_at == "one time":
            rows = np.zeros_like(rows)
        carried = carriers(self.asked, camera, self.poses)
        times = np.zeros((int(rows.max()) + 1, motion.mesh.n_faces), np.int64)
        for row in range(len(motion)):
            mesh, kept = motion._at(row, of_occluders=False)
            placed = move_with_carrier(carried[:, row], self.poses)
            for own, time in enumerate(times):
                is_front = any_in_front(mesh, camera, placed[rows == own], asked[kept])
                time[kept] += motion.units[row] * is_front
        return np.asarray((times >= motion._rows_for(self.asked.over)).any(axis=0))

    @cached_property
    def _judged(self) -> tuple[list[ByName], dict[int, str | None]]:
        """Reason and hiding body of each listed zone; and the body that hides most in a frame."""
        motion, zones = self.motion, self.zones
        n = zones.listed()
        winners = zones.reasons(n).tolist()
        if not n or not len(self.poses):
            return [_say_pose(name_of(each)) for each in winners], {}
        points, piece = points_of(zones, n, POINTS_OF_ZONE)
        carried = carriers(self.asked, self.camera, self.poses)
        face, zone = zones.face[piece].astype(np.int64), zones.zone[piece]
        hides = np.zeros((n, len(motion.names)), np.int64)
        of_frames: dict[int, str | None] = {}
        some = np.linspace(0, len(motion) - 1, min(MOST_JUDGED, len(motion)))
        for row in np.unique(some.astype(np.int64)).tolist():
            there = np.flatnonzero(motion.present[row][motion.body[face]])
            if not len(there):
                continue
            mesh, kept = motion._at(row, of_occluders=False)
            own = np.searchsorted(kept, face[there])
            moved = _move_points(
                motion.world_from_body[row, motion.body[face[there]]], points[there]
            )
            placed = move_with_carrier(carried[:, row], self.poses)
            best = np.zeros(len(there), np.uint8)
            hider = np.full(len(there), -1)
            judged = failures_of_rows(mesh, self.camera, self.task, placed, moved, own)
            for _, found_reason, by in judged:
                fails = np.where(found_reason == Reason.COVERED, IS_COVERED, found_reason)
                better = nearness(fails) >= nearness(best)
                hider[better] = by[better]
                best[better] = fails[better]
            weight = int(motion.units[row])
            hidden = np.flatnonzero((best != IS_COVERED) & (hider >= 0))
            body = motion.body[kept[hider[hidden]]]
            np.add.at(hides, (zone[there[hidden]], body), weight)
            counts = np.bincount(body[body > 0], minlength=len(motion.names))
            of_frames[row] = motion.names[int(counts.argmax())] if counts.any() else None
        items = []
        for row, (winner, moving) in enumerate(zip(winners, hides[:, 1:], strict=True)):
            if Reason.OCCLUDED not in rows_in(winner) or not moving.any():
                items.append(_say_pose(name_of(winner)))
                continue
            own, hiding = face[zone == row], 1 + int(moving.argmax())
            if hiding == np.bincount(motion.body[own]).argmax():
                group = motion.mesh.groups[motion.mesh.face_group[own[0]]].name
                items.append(_say_pose(name_of(winner), group, "another part of the same body"))
                continue
            items.append(
                _say_pose(name_of(winner), motion.names[hiding], f'"{motion.names[hiding]}"')
            )
        return items, of_frames

    def dead_zones(self) -> ByName:
        """Dead zones, the largest first, each with its main occluding body, ready for JSON.

        The static world does not count as a body. For the first zones, the advice is to add a
        camera that covers half of the zone for long enough, unless bodies carry cameras.
        """
        return self._advise(ANY)

    def _advise(self, allowed: Allowed) -> ByName:
        """As `dead_zones`, with advice of cameras as for `summary_of`."""
        rows, n = self._entries(), min(self.zones.listed(), MOST_LINES)
        n_pairs = len(self.motion) * self.motion.mesh.n_faces
        is_carried = (carriers(self.asked, self.camera, self.poses) != np.eye(4)).any()
        if n and n_pairs <= MOST_PAIRS and not is_carried:
            remedies = TimeRemedies.of(self, allowed)
            for entry, spot in zip(rows, remedies.spots(self.zones, n), strict=False):
                if entry["reason"] not in ("unseeable", *OWN_CRITERIA):
                    entry |= remedies.add_fact(spot, entry["advice"])
        return {"dead_zones": rows, "other_dead_zones": self.zones.others()}

    def _entries(self) -> list[ByName]:
        """The listed zones, without a change that is tried."""
        places = self.zones.places(self.zones.listed())
        return [place | said for place, said in zip(places, self._judged[0], strict=True)]

    def always(self) -> "OverTime":
        """The same result for points that must be covered all the time."""
        return self if self.asked.over == "all" else self._always

    @cached_property
    def _always(self) -> "OverTime":
        copy = replace(self, asked=replace(self.asked, over="all"))
        copy.__dict__.update(time=self.time, frames=self.frames)
        return copy

    def summary(self) -> ByName:
        """Figures over time, ready for JSON."""
        table, curve, mesh = self.table(), self.curve(), self.motion.mesh
        total = float(frames_of(mesh).areas[mesh.task_mask].sum())
        always, half = self.always(), self.half()
        summary = self.areas.summary()
        said = {
            "over": self.asked.over,
            "views": self.task.views,
            "views_at": self.asked.views_at,
            "frames": len(self.motion),
            "bodies": list(self.motion.names),
            "covered": {
                name: summary[name]
                for name in ("percent", "m2", "bound_m2", "of_m2", "doubtful_m2")
                if name in summary
            },
            "ever_percent": curve[0]["percent"],
            "always_percent": percent_of(float(always.long_enough.area.sum()), total),
            "half_the_frames_percent": half,
            "not_always": always._entries()[:MOST_NOT_ALWAYS],
            "curve": curve,
            "by_frame": table,
        }
        return said | {"in_words": time_words(self.asked.over), "lines": _lines(said)}

    def half(self) -> float | None:
        """Covered percentage with every second frame only; None for fewer than 4 frames.

        Its difference from `100 * share()` shows whether there are enough frames.
        """
        motion = self.motion
        if len(motion) < 4:
            return None
        n_rows = len(self.regions.pose_ids) // len(motion)
        rows = np.arange(len(motion)) % 2 == 0
        some = self.regions.of_poses(np.repeat(rows, n_rows))
        asked = replace(self.asked, motion=motion._of_frames(rows))
        copy = replace(self, asked=asked, regions=some)
        copy.__dict__.update(frames=take_rows(self.frames, np.flatnonzero(rows)))
        return 100 * copy.share()

    def lines(self) -> list[str]:
        """The result as lines of text."""
        return list(self.summary()["lines"])


def time_words(over: str | float) -> str:
    """Time in which a point is covered, in words."""
    named = {"some": "in some frame", "all": "in all frames"}
    return named.get(str(over)) or f"for at least {100 * float(over):.4g} % of the time"


def _lines(said: ReadByName) -> list[str]:
    """Lines about a summary over time."""
    ever, always = (percent(said[f"{name}_percent"] / 100) for name in ("ever", "always"))
    text = f"{percent(said['covered']['percent'] / 100)} of the area {time_words(said['over'])}"
    frames = plural(said["frames"], "frame")
    others = f"{ever} at some time in {frames}", f"{always} in all {frames}"
    over = said["over"]  # whose share is in the text already
    text += f"; {', '.join(others[over == 'some' : 2 - (over == 'all')])}"
    if said["half_the_frames_percent"] is not None:
        text += f"; with only every second frame {percent(said['half_the_frames_percent'] / 100)}"
    hidden = [zone for zone in said["not_always"] if zone["hidden_by"]]
    if not hidden or over == "all":
        return [text]
    most = f"{in_square_metres(hidden[0]['area_m2'])}, mostly by {hidden[0]['hidden_by']}"
    return [text, f"largest zone occluded in at least one frame: {most}"]


def _say_pose(name: str, hidden_by: str | None = None, before: str = "") -> ByName:
    """Reason of a zone, and the body that hides it, named by `before`; no change is tried."""
    general = general_advice(name) if name in ("unseeable", *OWN_CRITERIA) else ""
    advice = f"{before} blocks the view" if before else general
    own = {"nearest": None, "tried": None, "hidden_by": hidden_by}
    return {"reason": name, "advice": advice, **own}


@dataclass
class TimeRemedies(Remedies):
    """Cameras that are added and stay where they are, for zones of a motion.

    The scene is that of the frame in the middle, with all bodies; what a camera covers is judged in
    every frame.

    Attributes
    ----------
    over_time : OverTime
        What is covered already.
    middle : int
        Row of the frame.
    """

    over_time: OverTime = field(kw_only=True)
    middle: int = 0

    @classmethod
    def of(cls, over_time: OverTime, allowed: Allowed) -> Self:
        """For the zones of a result."""
        motion, middle = over_time.motion, len(over_time.motion) // 2
        mesh, _ = motion._place(motion.world_from_body[middle], np.ones(len(motion.names), bool))
        own = over_time.camera, over_time.task, over_time.poses, None, allowed
        return cls(mesh, *own, over_time=over_time, middle=middle)

    def spots(self, zones: DeadZones, n: int) -> Iterator[ZoneSpot]:
        """Points of the first zones where they are in the frame in the middle."""
        points, piece = points_of(zones, n, CHECKED)
        face = zones.face[piece].astype(np.int64)
        motion = self.over_time.motion
        moved = _move_points(motion.world_from_body[self.middle, motion.body[face]], points)
        for own in np.arange(len(points)).reshape(n, CHECKED):
            yield ZoneSpot.of(moved[own], face[own], int(zones.wanted[face[own]].max()))

    def add_fact(self, spot: ZoneSpot, fact: str) -> ByName:
        """`advice`, after what is known of a zone, and what was `tried`."""
        eyes = self.poses.eyes
        row = int(norm(eyes - spot.at).argmin()) if len(eyes) else 0
        words, entries = self.try_change(None, row, spot)
        words += f" {time_words(self.over_time.asked.over)}"
        return {"advice": "; ".join(filter(None, (fact, words))), "tried": entries or None}

    def _frames(self) -> Iterator[Mesh]:
        """As of `Remedies`."""
        motion = self.over_time.motion
        for row in np.flatnonzero(motion.present[:, motion.body].any(axis=1)).tolist():
            yield motion._at(row, of_occluders=True)[0]

    def _shares(self, changes: Sequence[Change], row: int, spot: ZoneSpot) -> Iterator[float]:
        """As of `Remedies`, for long enough."""
        motion = self.over_time.motion
        body = motion.body[spot.face]
        needed = motion._rows_for(self.over_time.asked.over)[spot.face]
        at_rest = _move_points(inverse(motion.world_from_body[self.middle, body]), spot.points)
        for start in range(0, len(changes), CHANGES_A_TURN):
            placed = self._place_changes(changes[start : start + CHANGES_A_TURN], row)
            n_rows = int(rows_of_result(placed[0], placed[2]).max()) + 1
            times = np.zeros((n_rows, len(spot.face)), np.int64)
            for frame in range(len(motion)):
                there = np.flatnonzero(motion.present[frame][body])
                if not len(there):
                    continue
                mesh, kept = motion._at(frame, of_occluders=False)
                points = _move_points(motion.world_from_body[frame, body[there]], at_rest[there])
                face = np.searchsorted(kept, spot.face[there])
                judged = failures_of_rows(mesh, *placed, points, face)
                for time, (_, reason, _) in zip(times, judged, strict=True):
                    time[there] += motion.units[frame] * (reason == Reason.COVERED)
            yield from (times >= needed).mean(axis=1).tolist()


@once_each
def never_seeable(motion: Motion) -> FloatArray:
    """(F,) area that no camera can see in any frame: proved, m^2; all of what is never there.

    As of `rastercov.core.mesh.unseeable`.
    """
    values = np.where(motion.mesh.task_mask, motion.mesh.areas, 0.0)
    for row in range(len(motion)):
        if not values.any():
            break
        mesh, kept = motion._at(row, of_occluders=False)
        values[kept] = np.minimum(values[kept], unseeable_areas(mesh))
    return frozen(values)


def _move_points(poses: FloatArray, points: FloatArray) -> FloatArray:
    """Points, (N, 3), by the poses of their bodies, (N, 4, 4)."""
    moved: FloatArray = np.einsum("nij,nj->ni", poses[:, :3, :3], points) + poses[:, :3, 3]
    return moved


class TimeAreas(AreaNetwork):
    """Area that is covered long enough, as that of a network; zones are those over time."""

    def __init__(self, over_time: OverTime) -> None:
        super().__init__(over_time.motion.mesh, replace(over_time.task, views=1))
        self.over_time = over_time
        self.add(over_time.long_enough)

    def of_faces(self, members: BoolArray, views: int | None = None) -> ByName:
        """As of `AreaNetwork`; views are counted at each time already."""
        return super().of_faces(members, 1)

    def _unseeable(self) -> FloatArray:
        """As of `OverTime`."""
        return self.over_time.unseeable

    def unseen_areas(self) -> tuple[FloatArray, FloatArray]:
        """As of `AreaNetwork`."""
        return self._unseeable(), never_seeable(self.over_time.motion)

    def of_phases(self) -> ByName:
        """As of `AreaNetwork`."""
        return {"over_time": self.over_time.summary()}

    def parts(self, make: Callable[[], Regions]) -> Regions:
        """As of `OverTime.alone`."""
        return self.over_time.alone()

    def dead_zones(self, *asked: object, **named: object) -> ByName:
        """As of `OverTime`; kept like its zones."""
        make = partial(self.over_time._advise, self.allowed)
        return self._once(self.over_time.zones, make)

    def zones(self, *asked: object, **named: object) -> DeadZones:
        """As of `OverTime`."""
        return self.over_time.zones


def regions_in_shards(job: MovingFrames, folder: Path, staff: Staff = ALONE) -> Regions:
    """Regions of all frames, to the bit those of one run, by way of shards of some frames each.

    Parameters
    ----------
    job : Frames
    folder : Path
        As of `EvaluationShards`; shards of each motion are in a folder of their own, and stay.
    staff : Staff
        Processes that measure.

    Raises
    ------
    ConfigError
        For a frame that kills its process.
    ResourceError
        When the regions are more than the memory holds.
    """
    motion, scene = job.motion, (job.motion.mesh, job.camera, job.placed)
    wanted, rows = Wanted(job.engine, True), np.arange(len(motion))
    tables = {name: getattr(motion, name) for name in OF_MOTION}
    tables |= {"carried": job.carried, "source": job.source}
    with open_for(motion.mesh, job.camera, job.task, wanted) as observer:
        header = header_of(observer, job.placed, job.task, wanted)
    size = max(1, PAIRS_A_SHARD // max(1, motion.mesh.n_faces * len(job.placed)))
    header |= {"bodies": motion.names, "motion": sha256(*tables.values()), "poses_a_shard": size}
    store = store_in(folder, header, len(motion), OF_FRAMES, scene, **tables)

    def make(number: int, did: Callable[[int], None]) -> bytes:
        arrays = _of_frames(job, some := rows[store.rows(number)])
        did(len(some))
        return pack_rows(store.folder, number, arrays)

    numbers = list(fill(store, make, partial(unpack_rows, store), staff))
    if left := store.quarantined():
        frame, end = next(iter(left.items()))
        raise ConfigError(
            f"expected a result of frame {frame}, got none: its process {end}; leave the frame "
            f"out, or remove {store.folder} and use fewer workers, each with more memory"
        )
    n_bytes = sum((store.folder / store.name(number)).stat().st_size for number in numbers)
    check_memory(f"regions of {job.source.size:,} images", 2 * n_bytes, "use fewer frames")
    parts = []
    for number in numbers:
        own: Any = unpack_rows(store, number)
        eyes = np.full((len(own["pose_ids"]), 3), np.nan)
        own |= {"mesh": motion.mesh, "camera": job.camera, "task": job.task}
        parts.append(Regions(eyes=eyes, **own))
    return join(parts)


def make_frames(folder: Path, number: int | None, chosen: IntArray) -> bytes:
    """Content of a shard of frames, as `rastercov.shards.ShardStore` wants it."""
    return pack_rows(folder, number, _of_frames(_open_frames(folder), chosen))


def _of_frames(job: MovingFrames, rows: IntArray) -> dict[str, AnyArray]:
    """Arrays of a shard of some frames."""
    regions = job.regions(rows)
    return arrays_of_regions([regions]) | {"pose_ids": regions.pose_ids}


@open_once
def _open_frames(folder: Path, inputs: Inputs) -> MovingFrames:
    tables, (task, wanted) = read_npz(whole(folder, POSES)), question_of(inputs)
    own = [tables[name] for name in OF_MOTION]
    motion = Motion._make(inputs.mesh, inputs.header["bodies"], *own, np.ones(len(own[-1])))
    scene = motion, inputs.cameras, inputs.poses
    return MovingFrames(*scene, task, wanted.engine, tables["carried"], tables["source"])


@frozen_record
class OfFrames:
    """Frames of a motion as `Phases`."""

    asked: MotionQuery

    def check(self, mesh: Mesh, camera: Cameras, poses: Poses, task: Task) -> None:
        """See `Phases`."""
        check_over_time(task)
        query_of(self.asked, mesh)
        carriers(self.asked, camera, poses[:0])  # refuses bodies

    def check_motion(self, placed: Poses) -> None:
        """See `Phases`."""
        self.asked._check_motion(placed)

    def images(self, placed: Poses) -> int:
        """See `Phases`."""
        return len(self.asked.motion) * len(placed)

    def regions(self, camera: Cameras, placed: Poses, task: Task, engine: Engine) -> Regions:
        """See `Phases`."""
        return regions_of_frames(self.asked, camera, placed, task, engine)

    def network(
        self, scene: tuple[Cameras, Poses, Task], engine: Engine, folder: Path | None, staff: Staff
    ) -> TimeAreas:
        """See `Phases`.

        Shards of some frames each stay in the folder, so that a run that was ended continues, and
        any number of frames is taken: docs/scale.md. The figures are the same to the bit.
        """
        if folder is None:
            return OverTime(self.asked, *scene, self.regions(*scene, engine)).areas
        job = MovingFrames.of(self.asked, *scene, engine)
        return OverTime(self.asked, *scene, regions_in_shards(job, folder, staff)).areas
