"""Coverage of a network, measured once, with its bounds, and requirements, for `place` and `check`.

Visibility has an error bound, and so has coverage: faces are covered as measured, certainly, or
possibly. The bound is that of visibility alone; where pixels are counted (method sampled),
resolution has an error without a bound too.

By face, required shares are counted in integers, as in `Problem`. A measured share has bounds
because visibility has: `low` counts the certainly covered faces, `high` the possibly covered ones.
By area it is that of the exact area, with its bound.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    frozen_record,
    percent,
    plural,
)
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import points
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions
from rastercov.core.camera import Poses, Rig, eyes_of, is_joint, led_by, renumber, rows_of_result
from rastercov.core.camera.conventions import centre_warning
from rastercov.core.coverage.coverage import (
    Observer,
    in_batches,
    open_observer,
)
from rastercov.core.coverage.doubts import find_warnings
from rastercov.core.coverage.evaluation import ByCamera, cameras_apart
from rastercov.core.coverage.network import Network, share_of_faces
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import rows_of
from rastercov.placement.candidates.rooms import wrong_side
from rastercov.placement.improve.objective import Objective
from rastercov.placement.plan.entries import value_of
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.rig_parts import RigPart, parts_of
from rastercov.placement.plan.sections import (
    AllSelection,
    FewestSelection,
    SelectionSection,
    TaskSection,
)
from rastercov.placement.required import (
    HOLDS,
    SHARE_TOLERANCE,
    UNDECIDED,
    ends_in_words,
    outcome_line,
    share_of,
    short_by,
    status_of,
)
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Goal,
    views_of,
)
from rastercov.placement.uncovered import (
    CandidateBounds,
    Leftover,
    NearestCameras,
    find_rest,
)
from rastercov.shards import Progress, silent

Rows = Mapping[Any, Sequence[int]]


@dataclass(frozen=True)
class Requirement:
    """A required share, and the share that is covered.

    Attributes
    ----------
    group : str or None
        Group or part; None for the whole task, or for all of a named goal.
    limit : float
        Minimum share or, with `is_most`, maximum share, [0, 1].
    low, share, high : float
        Share certainly covered, covered as measured, and possibly covered.
    status : {"holds", "fails", "undecided"}
        undecided: the limit is between `low` and `high`.
    faces, uncovered : int
        Number of faces, and of faces that are not covered as measured.
    of_reachable : bool
        True if shares are of the faces that some candidate covers, not of all.
    n_groups : int
        Number of groups in `group`, 1 unless it is a part.
    goal : str
        Name of a goal of a plan, or "".
    is_most : bool
        True if the limit is a maximum.
    plan_limit : float or None
        Share that the plan requires, if `limit` replaces it.
    """

    group: str | None
    limit: float
    low: float
    share: float
    high: float
    status: str
    faces: int
    uncovered: int
    of_reachable: bool = False
    n_groups: int = 1
    goal: str = ""
    is_most: bool = False
    plan_limit: float | None = None

    @property
    def name(self) -> str:
        """The goal, group or part, or "whole task"."""
        if self.goal:
            return f"goal {self.goal}"
        kind = "group" if self.n_groups == 1 else "part"
        return "whole task" if self.group is None else f"{kind} {self.group}"

    @property
    def called(self) -> str:
        """The same in a sentence."""
        return f"{'the ' * (self.group is None and not self.goal)}{self.name}"

    @property
    def short_by(self) -> float:
        """Difference between limit and share; 0 if the requirement holds."""
        return short_by(self.share, self.limit, self.status, is_most=self.is_most)

    @property
    def lack(self) -> float:
        """Difference between the limit and the bound that decides; 0 if the requirement holds."""
        if self.status == HOLDS:
            return 0.0
        return self.high - self.limit if self.is_most else self.limit - self.low

    def after(self, gain: float, *, is_about: bool = False) -> str:
        """Words on what becomes of it by a change of its share, or an estimate of part of that."""
        share = min(max(self.share + gain, 0.0), 1.0)
        lack, doubt = self.limit - share, self.high - self.low
        too, what, sign = ("too much", "seen", -1) if self.is_most else ("missing", "covered", 1)
        lack *= sign
        end = "the goal is then met" if lack + doubt <= SHARE_TOLERANCE else "too near to say"
        if lack > doubt + SHARE_TOLERANCE:
            end = f"still {too}: {'up to ' * is_about}{points(lack)}"
        elif is_about:
            end = "the goal is then met, if the estimate holds"
        more = " or more" * is_about
        return f"then {'about ' * is_about}{percent(share)}{more} is {what}: {end}"

    def at_most(self, goal: str, limit: float) -> Self:
        """The same share as one that is permitted up to a limit."""
        status = status_of(self.low, self.high, limit, is_most=True)
        return replace(self, goal=goal, limit=limit, status=status, is_most=True)

    def words(self, *, has_share: bool = True) -> str:
        """The requirement and its outcome in one line.

        Without its share where that is the covered area, which another line has.
        """
        if self._is_of_nothing:
            return (
                f"{self.name}: no candidate covers any of it, {percent(self.limit)} of what "
                "candidates can cover required"
            )
        covered, uncovered, ends = self._parts()
        share = f"{percent(self.share)} {covered}, "
        share *= has_share or not self._is_covered_area
        limits = self.limit, self.plan_limit
        start = f"{self.name}: {share}"
        return outcome_line(
            start, self.status, limits, self.short_by, uncovered, ends, is_most=self.is_most
        )

    @property
    def _is_of_nothing(self) -> bool:
        """True where the share is of what candidates cover, and they cover nothing."""
        return self.of_reachable and not self.faces

    @property
    def _is_covered_area(self) -> bool:
        """True where the share is that of the covered area of all."""
        return False

    def _parts(self) -> tuple[str, str, str]:
        """Words on what is covered, on what is not, and on the bounds of both."""
        what = "of what candidates can cover" if self.of_reachable else "covered"
        ends = f"the error bound allows {percent(self.low)} to {percent(self.high)}"
        return what, plural(self.uncovered, "face"), ends


@dataclass(frozen=True)
class AreaRequirement(Requirement):
    """A required share of the exact area; `low` and `high` are the share less and plus its bound.

    Attributes
    ----------
    m2, bound_m2, of_m2 : float
        Covered area, the bound of its error, and the area that the share is of.
    of_seeable : bool
        True where that is without what no camera can ever see.
    faces, uncovered : int
        Faces, and faces that are not covered as a whole.
    """

    m2: float = 0.0
    bound_m2: float = 0.0
    of_m2: float = 0.0
    of_seeable: bool = False

    @property
    def _is_of_nothing(self) -> bool:
        return self.of_reachable and not self.of_m2

    @property
    def _is_covered_area(self) -> bool:
        return self.group is None and not (self.goal or self.of_seeable or self.of_reachable)

    def _parts(self) -> tuple[str, str, str]:
        of = "of the coverable area covered" if self.of_seeable else "of the area covered"
        of = "of the area that candidates can cover" if self.of_reachable else of
        ends = ends_in_words(self.low, self.high)
        return of, in_square_metres(self.of_m2 - self.m2), ends


@dataclass(frozen=True)
class CellRequirement(Requirement):
    """A required share of what can be covered; `faces` and `uncovered` are cells."""

    def words(self, *, has_share: bool = True) -> str:
        """The requirement and its outcome in one line."""
        return f"{super().words(has_share=has_share).replace('faces', 'patches')} (on patches)"


ALL = 1e99
"""Budget of every candidate."""
OF = {"area": "the area", "seeable": "the coverable area", "count": "the faces"}
"""Words for the whole of a share, by `weight_by`."""


def goal_of(selection: SelectionSection, what: str = "cameras") -> Goal:
    """Goal of a plan, as `problem_of` takes it, for its cameras or what else is chosen."""
    if isinstance(selection, FewestSelection):
        return value_of(selection, FewestCameras)
    if isinstance(selection, AllSelection):
        return BestCoverage(budget=ALL)
    return value_of(selection, BestCoverage, cameras=getattr(selection, what))


def _rows(mesh: Mesh, limits: Mapping[str | None, float]) -> Rows:
    """Rows of the groups of each limit."""
    names = [group.name for group in mesh.groups]
    return {None: range(len(names))} | {place: rows_of(names, place) for place in limits if place}


def classify_network(
    mesh: Mesh,
    integer_weights: IntArray,
    limits: Mapping[str | None, float],
    covered: BoolArray,
    certain: BoolArray | None = None,
    possible: BoolArray | None = None,
    reachable: BoolArray | None = None,
    rows: Rows | None = None,
) -> tuple[Requirement, ...]:
    """Evaluate each required share.

    Parameters
    ----------
    integer_weights : (F,) int64
        Weights as of `Problem` or `Objective`.
    limits : mapping of group, part or None to share
        None is the whole task.
    covered, certain, possible : (F,) bool
        Faces covered as measured, certainly and possibly; the same unless given.
    reachable : (F,) bool, optional
        Faces that the shares are of; all that are evaluated unless given.
    rows : mapping of str to list of int, optional
        Rows of the groups that each limit is of; of the part or group unless given.
    """
    parts = [covered if part is None else part for part in (certain, covered, possible)]
    rows = rows or _rows(mesh, limits)
    items = []
    for group, limit in limits.items():
        faces = mesh.task_mask if reachable is None else mesh.task_mask & reachable
        faces = faces & np.isin(mesh.face_group, rows[group])
        whole = int(integer_weights[faces].sum())
        of_none = 1.0 if reachable is None else 0.0
        low, share, high = (
            int(integer_weights[faces & part].sum()) / whole if whole else of_none for part in parts
        )
        counts = int(faces.sum()), int((faces & ~covered).sum())
        common = (group, limit, low, share, high, status_of(low, high, limit), *counts)
        items.append(Requirement(*common, reachable is not None, len(rows[group])))
    return tuple(items)


def seeable_areas(
    plan: Plan, network: Network, areas: AreaNetwork | None = None
) -> FloatArray | None:
    """(F,) area of each face that shares are of, where the plan counts what can be seen.

    Of several phases, that of `areas`, in any. ConfigError where a camera sees faces of which it is
    proved that no camera outside can.
    """
    if plan.task.weight_by != "seeable":
        return None
    from rastercov.core.mesh.unseeable import unseeable_areas

    in_any = areas.unseen_areas() if areas is not None else None
    hidden, proved = in_any or (network.unseeable_areas, unseeable_areas(network.mesh))
    if not hidden.any() and proved.any():
        raise ConfigError(
            'expected cameras outside watertight bodies for weight_by = "seeable", got some '
            "inside; move them out, or omit it if a room is modelled as a solid"
        )
    return network.mesh.areas - hidden


WHOLE_REL = 1e-6
"""Part of the area of a face that cameras may miss and still cover all of it, for people: the
chords of the angle of incidence cut off as much."""


def whole_faces(areas: AreaNetwork, views: int | Mapping[str, int]) -> BoolArray:
    """(F,) faces that a network covers as a whole."""
    from rastercov.core.area.polygons import frames_of

    mesh, rows = areas.mesh, np.arange(areas.mesh.n_faces)
    level = np.clip(views_of(mesh, views), areas.least, areas.views) - 1
    return areas.covered.area[level, rows] >= (1 - WHOLE_REL) * frames_of(mesh).areas


def classify_areas(
    areas: AreaNetwork,
    limits: Mapping[str | None, float],
    views: int | Mapping[str, int],
    reachable: AreaNetwork | None = None,
    rows: Rows | None = None,
    seeable: FloatArray | None = None,
) -> tuple[AreaRequirement, ...]:
    """Evaluate required shares by exact area, with a bound, by the arguments of `classify_network`.

    A requirement holds where the certainly covered area reaches it, fails where the area with its
    bound does not. With `reachable`, shares are of the area that it covers, with its bound, too;
    with `seeable`, of `seeable_areas`. A share of nothing that candidates cover is 0.
    """
    mesh, is_whole = areas.mesh, whole_faces(areas, views)
    rows = rows or _rows(mesh, limits)
    items = []
    for group, limit in limits.items():
        faces, sums, doubtful = np.zeros(mesh.n_faces, bool), np.zeros((2, 2)), 0.0
        for row in rows[group]:
            if (each := mesh.groups[row]).is_occluder:
                continue
            members = mesh.face_group == row
            number = views.get(each.name, 1) if isinstance(views, Mapping) else views
            own = areas.of_faces(members, number)
            whole = own["of_m2"] if seeable is None else float(seeable[members].sum()), 0.0
            if reachable is not None:
                reached = reachable.of_faces(members, number)
                whole = reached["m2"], reached["bound_m2"] + reached.get("doubtful_m2", 0.0)
            faces |= members
            sums += [(own["m2"], own["bound_m2"]), whole]
            doubtful += own.get("doubtful_m2", 0.0)
        (area, bound), (total, of_bound) = sums.tolist()
        most = area + bound + doubtful
        ends = ((area - bound, total + of_bound), (area, total), (most, total - of_bound))
        low, share, high = (share_of(*each) for each in ends)
        if reachable is not None and not total:
            low = share = high = 0.0
        counts = int(faces.sum()), int((faces & ~is_whole).sum())
        status, is_partial = status_of(low, high, limit), reachable is not None
        common = (group, limit, low, share, high, status, *counts, is_partial)
        others: ByName = {
            "m2": area,
            "bound_m2": bound,
            "of_m2": total,
            "n_groups": len(rows[group]),
            "of_seeable": seeable is not None,
        }
        items.append(AreaRequirement(*common, **others))
    return tuple(items)


def limits_of(selection: SelectionSection | None) -> dict[str | None, float]:
    """Required shares of a plan, of all (None) and of groups; none for the best coverage."""
    if not isinstance(selection, FewestSelection):
        return {}
    return {None: selection.coverage, **selection.groups}


def counting(task: TaskSection) -> ByName:
    """Arguments of `problem_of` and `Objective.of` from the task of a plan."""
    return {name: getattr(task, name) for name in ("weight_by", "views")}


class PlanNetwork(Network):
    """A `Network` whose faces may need views that differ by group, or by an angle."""

    def __init__(self, mesh: Mesh, task: Task) -> None:
        super().__init__(mesh, task)
        self.is_covered: BoolArray = np.zeros(mesh.n_faces, bool)

    @property
    def covered(self) -> BoolArray:
        """(F,) faces that are covered as the plan counts it."""
        return self.is_covered

    def add_part(self, part: RigPart, eyes: FloatArray) -> None:
        """Add some cameras, with their centres, (P, 3)."""
        self._take(part.poses.ids, part.clipped, part.sums)
        self._spread_out(eyes, part.masks[0])


def observer_of(plan: Plan, mesh: Mesh) -> Observer:
    """Observer of a mesh by the camera and the method of a plan; to be closed."""
    return open_observer(mesh, plan.rig, plan.engine)


@frozen_record
class Measured:
    """A network of K cameras and the faces it covers.

    Attributes
    ----------
    mounted : Poses
        Poses of the M chosen cameras or rigs.
    placed : Poses
        Poses of their K cameras, with the index of the camera of each.
    owner : (K,) int64
        Row in `mounted` of each camera.
    network : PlanNetwork
        Coverage of each face by all cameras, a `rastercov.Network`.
    nearest : (F,) int64
        Camera that comes nearest to covering each face, as for `Leftover.nearest_camera`.
    covers : (K, F) bool
        True for faces that a camera covers, as measured.
    covered, certain, possible : (F,) bool
        True for faces that the network covers as measured, certainly, and possibly.
    curve : (K,) float64
        Share covered by the first 1, 2, ..., K cameras; of the exact area where they were placed by
        it.
    share : float
        Share covered by all cameras, [0, 1]; with `areas`, of the exact area.
    areas : AreaNetwork or None
        Exact covered area; None if the plan counts faces.
    per_camera : ByCamera or None
        Results of each camera where there are several.
    """

    mounted: Poses
    placed: Poses
    owner: IntArray
    network: PlanNetwork
    nearest: IntArray
    covers: BoolArray
    covered: BoolArray
    certain: BoolArray
    possible: BoolArray
    curve: FloatArray
    share: float
    areas: AreaNetwork | None = None
    per_camera: ByCamera | None = None

    @property
    def poses(self) -> FloatArray:
        """(K, 4, 4) world_from_camera."""
        return self.placed.world_from_camera


def with_areas(
    plan: Plan,
    cameras: Measured,
    finder: RegionPass,
    views: int | None = None,
    progress: Progress = silent,
    *,
    has_curve: bool = False,
) -> Measured:
    """The network with its exact covered area.

    Parameters
    ----------
    finder : RegionPass
        Counts as many views as are needed at most (`most_views`).
    views : int, optional
        Replaces those of the plan.
    has_curve : bool
        True where the curve is to be of the area, too: one camera after the other.
    """
    poses, curve, done = cameras.placed, list[float](), 0
    rig, rows = RigAreas(plan, finder.mesh, poses, views), rows_of_result(plan.rig, poses)
    parts = in_batches(poses, finder.mesh.n_faces, finder.threads, rows)
    if has_curve:
        limits = [*led_by(plan.rig, poses).tolist(), len(poses)]
        parts = (poses[first:last] for first, last in pairwise(limits))
    for some in parts:
        rig.add(finder.find(some, closed=rig.closed), some)
        if has_curve:
            curve += [curve[-1] if curve else 0.0] * (len(some) - 1)
            curve.append(rig.share)
        done += len(some)
        progress(done, len(poses))
    if has_curve:
        cameras = replace(cameras, curve=np.array(curve, np.float64))
    return rig.of(cameras)


class RigAreas:
    """Exact area that the cameras of a plan cover, added up camera by camera.

    Attributes
    ----------
    areas : AreaNetwork
        Counts as many views as are needed at most (`most_views`).
    """

    def __init__(self, plan: Plan, mesh: Mesh, placed: Poses, views: int | None) -> None:
        self._rig, self._views = plan.rig, views or plan.task.views
        self._by_group = views_by_group(plan, views)
        self.areas = AreaNetwork(mesh, plan.build_task(most_views(plan, views)))
        self._apart = ByCamera(mesh, self.areas.task, plan.rig, placed, by_area=True, by_face=False)

    @property
    def closed(self) -> BoolArray:
        """(F,) faces whose further regions change nothing."""
        return self._apart.closed_by_camera(self.areas.closed)

    @property
    def share(self) -> float:
        """Covered share of the area, [0, 1]."""
        return float(self.areas.summary(self._by_group)["percent"] / 100)

    def add(self, regions: Regions, some: Poses) -> None:
        """Add the regions of some cameras."""
        together = with_rule(regions, self._rig, some)
        # With a curve or without, the same figures.
        for own in np.eye(len(together.pose_ids), dtype=bool):
            self.areas.add(together.of_poses(own))
        self._apart.add(regions, some)

    def of(self, cameras: Measured) -> Measured:
        """The measured network with its area."""
        if is_joint(self._rig):
            covered = whole_faces(self.areas, self._views)
            cameras.network.is_covered = covered
            cameras = replace(cameras, covered=covered, certain=covered, possible=covered)
        return replace(cameras, areas=self.areas, share=self.share, per_camera=self._apart)


def most_views(plan: Plan, views: int | None = None) -> int:
    """Largest number of views that a plan counts; `views` replaces its own."""
    wanted = views or plan.task.views
    return max([1, *wanted.values()]) if isinstance(wanted, dict) else wanted


def views_by_group(plan: Plan, views: int | None) -> dict[str, int] | None:
    """Views by group where a plan has them; `views` replaces them."""
    return plan.task.views if isinstance(plan.task.views, dict) and not views else None


def summary_of(plan: Plan, cameras: Measured, views: int | None = None) -> ByName:
    """Summary of the network with its covered area, ready for JSON; `views` as for `with_areas`."""
    unit, reason = plan.unit_of_result()
    summary = cameras.network.summary() | {"by": unit, "by_face_because": reason}
    if cameras.areas is not None:
        by_group = views_by_group(plan, views)
        cameras.areas.add_to(summary, plan.rig, cameras.placed, by_group)
        summary |= cameras.areas.dead_zones(plan.rig, cameras.placed, by_group)
        if of_phases := cameras.areas.of_phases():
            return summary | of_phases
    if by_camera := _by_camera(plan.rig, cameras):
        summary["by_camera"] = by_camera
    if cameras.per_camera is not None:
        summary |= cameras.per_camera.further()
    return summary


def _by_camera(rig: Rig, cameras: Measured) -> list[ByName]:
    """Coverage by the poses of each of several cameras, ready for JSON."""
    mesh, of_pose = cameras.network.mesh, cameras.placed.camera
    by_camera = []
    for index in cameras_apart(rig, cameras.placed):
        own = of_pose == index
        covered = share_of_faces(mesh, cameras.covers[own].any(axis=0), mesh.task_mask)
        entry = {"camera": rig.names[index], "poses": int(own.sum()), "covered": covered}
        by_camera.append(entry | (cameras.per_camera.entry(index) if cameras.per_camera else {}))
    return by_camera


def of_plan(lines: Iterable[str]) -> list[str]:
    """Lines that name entries of a plan file for the options of a command."""
    return [line.replace("--unit", "unit of [[meshes]]") for line in lines]


def warnings_of(plan: Plan, cameras: Measured) -> list[str]:
    """Lines about other cameras than the plan's, the rooms, the unit of the meshes, and sides."""
    lines = [*plan._stated, *wrong_side(list(plan.built_rooms.values()), cameras.placed.eyes)]
    lines += of_plan(find_warnings(cameras.network, plan.rig, cameras.placed))
    for index in np.unique(cameras.placed.camera):
        lines += centre_warning(plan.rig.names[index], plan.rig.cameras[index])
    return lines if cameras.areas is None else [*lines, *cameras.areas.doubts()]


def goal_lines(requirements: Sequence[Requirement], where: str = "") -> tuple[str, list[str]]:
    """The requirement that lacks most, or the first, in one line, "" for none; then the others.

    `where` follows each status, after a space.
    """
    if not requirements:
        return "", []

    def line(each: Requirement, *, has_share: bool) -> str:
        verdict = "is undecided" if each.status == UNDECIDED else each.status
        who = each.name if each.goal else f"goal for {'' if each.group else 'the '}{each.name}"
        text = each.words(has_share=has_share).replace(", undecided:", ";")
        return f"{who} {verdict}{where}: {text.removeprefix(f'{each.name}: ')}"

    worst = max(requirements, key=lambda each: each.lack)
    others = [line(each, has_share=True) for each in requirements if each is not worst]
    return line(worst, has_share=False), others


def measure_network(
    objective: Objective,
    poses: ArrayLike | Poses,
    progress: Progress = silent,
    parts: Iterable[RigPart] | None = None,
) -> Measured:
    """Coverage of a network, with its bounds.

    Parameters
    ----------
    objective : Objective
        Weights and an open observer.
    poses : (K, 4, 4) array_like, or Poses
        world_from_camera, with the camera of each; K may be 0. Of rigs, those of the rigs.
    progress : callable
        Called with the poses done and the total.
    parts : iterable of RigPart, optional
        What is known of the cameras, instead of measuring them.
    """
    mesh, mounted = objective.observer.mesh, renumber(poses)
    placed, owner = objective.cameras(mounted)
    network, nearest = PlanNetwork(mesh, objective.task), NearestCameras(mesh.n_faces)
    masks = np.zeros((3, len(placed), mesh.n_faces), bool)
    eyes = eyes_of(objective.observer.camera, placed)
    own = parts_of(objective.observer, placed, objective.task) if parts is None else parts
    for part in own:
        network.add_part(part, eyes[part.poses.ids])
        nearest.take(part.nearest.rank, part.nearest.camera)
        masks[:, part.poses.ids] = part.masks
        progress(len(network.pose_ids), len(placed))
    covered, certain, possible = (objective.covered(mask, eyes) for mask in masks)
    network.is_covered = covered
    until = objective.cameras_until_covered(masks[0], eyes)
    worth = [objective.worth(until <= n) for n in range(1, len(placed) + 1)]
    return Measured(
        mounted=mounted,
        placed=placed,
        owner=owner,
        network=network,
        nearest=nearest.camera,
        covers=masks[0],
        covered=covered,
        certain=certain,
        possible=possible,
        curve=np.array([float(objective.share(each)) for each in worth]),
        share=float(objective.share(objective.worth(covered))),
    )


def find_uncovered(
    observer: Observer,
    cameras: Measured,
    progress: Progress,
    candidates: Poses | None = None,
    bounds: CandidateBounds | None = None,
    views: int | Mapping[str, int] = 1,
) -> Leftover:
    """Faces that a measured network does not cover, with reasons; arguments as for `find_rest`.

    By area, those that it does not cover as a whole.
    """
    covered = cameras.covered
    if cameras.areas is not None:
        covered = covered | whole_faces(cameras.areas, views)
    others = renumber(np.zeros((0, 4, 4)) if candidates is None else candidates)
    items = cameras.placed, cameras.network, cameras.nearest, covered
    return find_rest(observer, *items, others, progress, bounds)
