"""Goals out of reach of all candidates: what is missing, and changes that are tried to reach them.

    exact area of all candidates -> reasons of the rest -> estimates of changes -> exact area

Changes are cameras with more pixels, another focal length, weaker thresholds, and candidates at
places that a plan leaves out. They are estimated on points of the surface. One is said to reach the
goal only where the exact area that all candidates cover with it does.

Rejected views that would cover dead zones of a placement, with the reasons.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rastercov.advice.headline import advice_line, gain_in_area, most_named
from rastercov.base import ByName, first_of, percent, plural, sort_order
from rastercov.base.format import area, coordinates
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.polygons import points_on, spread_faces
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.remedies import Allowed, longer
from rastercov.core.area.stages import add_rows, failures_of_rows
from rastercov.core.area.zones import (
    LEAST_PERCENT,
    MOST_LINES,
    DeadZones,
    areas_by_reason,
    points_of,
    summary_of,
    zone_line,
)
from rastercov.core.camera import Camera, Poses, Rig, led_by, look_at
from rastercov.core.coverage.task import BETWEEN, NAMES, REASONS, Reason, Task, code_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import rows_of
from rastercov.placement.candidates.pool import Refusal, by_words, in_words
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.network import (
    AreaRequirement,
    classify_areas,
    limits_of,
    views_by_group,
)
from rastercov.placement.plan.prepare import Clock, Prepared
from rastercov.placement.plan.scene import places_of
from rastercov.placement.required import FAILS, HOLDS
from rastercov.placement.select.problem import views_of
from rastercov.shards import Progress, silent
from rastercov.shards.run import count_poses_of

MOST_MISSING = 3
"""Reasons, and groups of each, in a line on a goal that is out of reach."""
MOST_PAIRS = 50_000_000
"""Pairs of candidate and face up to which the exact area of all candidates is computed: about as
long as their visibility matrix takes."""
FEW_POINTS, MANY_POINTS, POINT_PAIRS = 64, 1000, 1_000_000
"""Points on which a change is estimated, and their pairs with candidates: some seconds."""
NEAR = 0.03
"""Share by which an estimate may lack what the exact area has: two deviations of `MANY_POINTS`."""
TIMES_PIXELS, LONGER, WIDER = (1.5, 2.0, 3.0), (1.4, 2.0), (0.7, 0.5)
"""Times the pixels along each side, and times the focal length, that are tried."""
MORE_DEG, MOST_DEG = (10.0, 20.0), 88.0
"""Degrees added to the largest incidence that are tried."""


class PlanChange(NamedTuple):
    """Cameras and thresholds in place of those of a plan, and words on them."""

    words: str
    camera: Rig
    task: Task


class Shortfall(NamedTuple):
    """Goals that all candidates together do not reach: proved.

    Attributes
    ----------
    required : list of AreaRequirement
        Those that fail.
    areas : AreaNetwork
        What all candidates cover.
    zones : DeadZones
        What they leave.
    lines : list of str
        On each requirement, and the change of a candidate that covers most of what is missing.
    reasons : set of str
        Names of what is missing.
    """

    required: list[AreaRequirement]
    areas: AreaNetwork
    zones: DeadZones
    lines: list[str]
    reasons: set[str]


def area_of_all(prepared: Prepared, finder: RegionPass, progress: Progress) -> AreaNetwork | None:
    """Exact area that all candidates together cover; None where it is not affordable."""
    poses = prepared.measured
    if len(poses) * prepared.mesh.n_faces > MOST_PAIRS or finder.task.min_angle_deg:
        return None  # an angle is of all pairs of candidates
    areas = AreaNetwork(prepared.mesh, finder.task)
    add_rows(finder, poses, areas, count_poses_of(len(poses), progress))
    return areas


def shortfall(prepared: Prepared, finder: RegionPass, clock: Clock) -> Shortfall | None:
    """Shortfall of all candidates together of the goals of a plan; None where not proved."""
    plan, poses = prepared.plan, prepared.measured
    if plan.task.weight_by != "area":
        return None
    with clock("area of all candidates") as progress:
        areas = area_of_all(prepared, finder, progress)
    if areas is None:
        return None
    required = classify_areas(areas, limits_of(prepared.selection), plan.task.views)
    failing = [each for each in required if each.status == FAILS]
    if not failing:
        return None
    wanted = views_by_group(plan, None)
    areas.allowed = prepared.allowed
    with clock("what candidates leave") as progress:
        zones = areas.zones(finder.camera, poses, wanted)
        listed = areas.dead_zones(finder.camera, poses, wanted, progress)["dead_zones"]
    lines, reasons = list[str](), set[str]()
    for each in failing:
        own = _rows(prepared.mesh, each)
        members = prepared.mesh.task_mask & np.isin(prepared.mesh.face_group, own)
        why = areas_by_reason(zones, members)
        missing = [
            f"{percent(share['area_percent'] / 100)} {REASONS[name].label}{gain_in_area(share)}"
            + _by_group(zones, own, code_of(map(NAMES.index, name.split(BETWEEN))))
            for name, share in why.items()
            if share["area_percent"] >= LEAST_PERCENT
        ]
        named = most_named(len(missing))
        if others := missing[named:]:
            missing[named:] = [f"and {plural(len(others), 'other reason')}"]
        reasons |= {each for name in why for each in name.split(BETWEEN)}
        lines.append(
            f"{each.name} out of reach: all candidates together cover at most "
            f"{percent(each.high)}, {percent(each.limit)} required; missing: "
            f"{', '.join(missing)}"
        )
    lines += [
        f"largest dead zone that one change helps: {zone_line(zone).removeprefix('dead zone ')}; "
        f"{advice_line(zone, 'candidate')}"
        for zone in listed
        if zone["tried"]
    ][:1]
    return Shortfall(failing, areas, zones, lines, reasons)


def _rows(mesh: Mesh, required: AreaRequirement) -> list[int]:
    """Rows of the groups of a requirement."""
    names = [group.name for group in mesh.groups]
    return [*range(len(names))] if required.group is None else rows_of(names, required.group)


def _by_group(zones: DeadZones, rows: Sequence[int], reason: int) -> str:
    """The groups with most of what is missing for a reason, where there are several."""
    mesh = zones.mesh
    own = zones.piece_area * (zones.reason == reason)
    m2 = np.bincount(mesh.face_group[zones.face], own, len(mesh.groups))[list(rows)]
    if len(rows) < 2 or not m2.any():
        return ""
    order = [at for at in sort_order(-m2)[:MOST_MISSING] if m2[at] > 1e-3 * m2.sum()]
    return f" ({', '.join(f'{mesh.groups[rows[at]].name} {area(m2[at])}' for at in order)})"


# --- what reaches the goal ------------------------------------------------------------------------


def ways(prepared: Prepared, shortfall: Shortfall, finder: RegionPass, clock: Clock) -> list[str]:
    """Lines on changes with which all candidates together reach the goal, one of each kind.

    Where none of those that are tried does, on the one that comes nearest.
    """
    is_free = prepared.carrier is None and not prepared.mounts.has_rigs
    reasons = shortfall.reasons
    if prepared.permitted:  # another camera may cover more of what a goal limits
        reasons = reasons & {"too_oblique"}
    kinds = [*_kinds(prepared.camera, finder.task, reasons)]
    total, tried, lines = 1 + sum(map(len, kinds)), list[tuple[float, str]](), list[str]()
    with clock("changes that reach the goal") as progress:
        lack_of = _estimate(prepared, shortfall)
        for kind in kinds:
            for change in kind:
                tried.append((lack_of(change), change.words))
                progress(len(tried), total)
                if tried[-1][0] <= NEAR and (line := _reach_note(prepared, shortfall, change)):
                    lines.append(line)
                    break
        if is_free:
            lines += _elsewhere(prepared, shortfall, finder)
        progress(total, total)
    if lines or not (tried or is_free):
        return lines
    what = [f"{plural(len(tried), 'change')} of camera and thresholds"] if tried else []
    what += ["further positions"] if is_free else []
    text = f"tried without reaching the goal: {', '.join(what)}"
    if tried:
        lack, words = min(tried)
        text += f"; nearest: {words}, about {100 * lack:.0f} percentage points short"
    return [text]


def _kinds(camera: Rig, task: Task, reasons: set[str]) -> Iterator[list[PlanChange]]:
    """Changes that may help against reasons, those of each kind from the smallest on."""

    def cameras(make: Callable[..., Camera], factors: Sequence[float], of: str) -> list[PlanChange]:
        changes = []
        for times in factors:
            rig = camera
            for name, each in zip(camera.names, camera.cameras, strict=True):
                rig = rig._with_camera(name, make(each, times))
            changes.append(PlanChange(f"{times:g} times the {of}", rig, task))
        return changes

    is_coarse = "too_coarse" in reasons
    if is_coarse:
        yield cameras(_finer, TIMES_PIXELS, "pixels along each side of the image")
    wider = WIDER if "outside" in reasons else ()
    for kind, what in (("is_pinhole", "focal length"), ("is_parallel", "magnification")):
        if all(getattr(each, kind) for each in camera.cameras):
            yield cameras(longer, (*(LONGER if is_coarse else ()), *wider), what)
    if "too_oblique" in reasons and not camera.tasks:
        most = task.max_incidence_deg
        yield [
            PlanChange(
                f"max_incidence_deg = {most + more:g} instead of {most:g}",
                camera,
                replace(task, max_incidence_deg=most + more),
            )
            for more in MORE_DEG
            if most + more <= MOST_DEG
        ]


def _finer(camera: Camera, times: float) -> Camera:
    """A camera of the same field of view with more pixels."""
    own: ByName = {name: times * getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "skew")}
    own |= {name: round(times * getattr(camera, name)) for name in ("width", "height")}
    if camera.pixel_size is not None:
        own["pixel_size"] = tuple(each / times for each in camera.pixel_size)
    return replace(camera, **own)


def _estimate(prepared: Prepared, shortfall: Shortfall) -> Callable[[PlanChange], float]:
    """Largest share that a requirement lacks after a change, by points evenly over its area."""
    mesh, poses = prepared.mesh, prepared.measured
    n, faces = int(np.clip(POINT_PAIRS // max(1, len(poses)), FEW_POINTS, MANY_POINTS)), []
    for each in shortfall.required:
        members = np.isin(mesh.face_group, _rows(mesh, each)) & mesh.task_mask
        faces.append(spread_faces(np.where(members, mesh.areas, 0.0), n))
    face = np.concatenate(faces)
    points = points_on(mesh, face)
    wanted = views_of(mesh, prepared.plan.task.views)[face]
    limits = np.array([each.limit for each in shortfall.required])

    def lack(change: PlanChange) -> float:
        judged = failures_of_rows(mesh, change.camera, change.task, poses, points, face)
        views = np.sum([reason == Reason.COVERED for _, reason, _ in judged], axis=0)
        return float((limits - (views >= wanted).reshape(len(limits), n).mean(axis=1)).max())

    return lack


def _reach_note(prepared: Prepared, shortfall: Shortfall, change: PlanChange) -> str:
    """Line on a change with which the exact area reaches the goal; "" where it does not."""
    scene, method = (prepared.mesh, change.camera, change.task), prepared.plan.task.method
    with closing(RegionPass(*scene, method=method, only_task=True)) as finder:
        areas = area_of_all(prepared, finder, silent)
    return "" if areas is None else _line(prepared, shortfall, areas, change.words)


def _line(prepared: Prepared, shortfall: Shortfall, areas: AreaNetwork, words: str) -> str:
    """Line on a change where an area reaches the goal."""
    required = classify_areas(areas, limits_of(prepared.selection), prepared.plan.task.views)
    if not all(each.status == HOLDS for each in required):
        return ""
    names = {each.name for each in shortfall.required}
    shares = [f"{each.name} {percent(each.share)}" for each in required if each.name in names]
    return f"goal within reach with {words}: {', '.join(shares)} (all candidates, exact area)"


def _elsewhere(prepared: Prepared, shortfall: Shortfall, finder: RegionPass) -> list[str]:
    """Line on further candidates, at places that a plan leaves out, that reach the goal."""
    plan, poses, camera = prepared.plan, prepared.measured, finder.camera
    kind = prepared.allowed.kind
    places = places_of(plan, prepared.mesh, is_anywhere=True)
    allowed = Allowed(places, kind, permits=prepared.permits)
    used = list[str]()
    for zone in summary_of(shortfall.zones, camera, finder.task, poses, allowed)["dead_zones"]:
        tried = zone["tried"]
        if not tried or {"focal_length_times", "focus_distance_m"} & tried.keys():
            continue
        near = zone["nearest"]
        own = kind if near is None else int(poses.camera[poses.ids == near["pose"]][0])
        placed = Poses.of(look_at(tried["position"], tried["looking_at"]), camera=[own])
        add_rows(finder, placed, shortfall.areas)
        used.append(
            f"({coordinates(tried['position'], 2)}) m, "
            f"aimed at ({coordinates(tried['looking_at'], 2)}) m"
        )
        words = f"candidates also at {first_of(used)}"
        if line := _line(prepared, shortfall, shortfall.areas, words):
            return [line]
    return []


MOST_VIEWS = 256
"""Views that are examined, evenly spread over all."""
POINTS = 32
"""Of each zone."""
ENOUGH = 0.5
"""Share of a zone that a view covers, or more."""


def views_for_zones(
    mounts: Mounts, task: Task, zones: DeadZones, refusals: tuple[Refusal, ...]
) -> list[list[Refusal]]:
    """Views that would cover half of each of the first zones, or more."""
    n, mesh = min(zones.listed(), MOST_LINES), zones.mesh
    some = np.unique(np.linspace(0, len(refusals) - 1, MOST_VIEWS).astype(np.int64))
    result: list[list[Refusal]] = [[] for _ in range(n)]
    if not n or not refusals:
        return result
    chosen = [refusals[row] for row in some.tolist()]
    camera = np.array([each.camera for each in chosen], np.int32)
    poses, owner = mounts.cameras(Poses.of(np.array([e.pose for e in chosen]), camera=camera))
    points, piece = points_of(zones, n, POINTS)
    zone, face = zones.zone[piece], zones.face[piece].astype(np.int64)
    covers = np.zeros((len(chosen), len(points)), bool)
    judged = failures_of_rows(mesh, mounts.rig, task, poses, points, face)
    for row, (_, reason, _) in zip(owner[led_by(mounts.rig, poses)], judged, strict=True):
        covers[row] |= reason == Reason.COVERED
    for row in range(n):
        of_zone = covers[:, zone == row]
        result[row] = [chosen[at] for at in np.flatnonzero(of_zone.mean(axis=1) >= ENOUGH)]
    return result


def entries_of(views: list[Refusal]) -> ByName:
    """Views of a zone by their reasons, ready for JSON."""
    return {"refused": by_words(views)} if views else {}


def line_of(views: list[Refusal], zone: str) -> list[str]:
    """Sentence on the views of a zone, none where there are no views."""
    if not views:
        return []
    rejected = f"{plural(len(views), 'rejected candidate')} would cover at least half of it"
    return [f"{zone}: {rejected} ({in_words(views)})"]
