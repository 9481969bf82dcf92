"""Check of a camera rig against the requirements of a plan, `rastercov check`.

Coverage is measured with bounds: a requirement holds when the certainly covered share reaches it,
fails when the possibly covered share does not, and is undecided, which does not pass, in between.
Shares are of the exact area where the plan counts that, and of whole faces otherwise.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, field, replace
from functools import cached_property, partial
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.advice.headline import (
    NO_CHANGE,
    GoalChange,
    by_reason,
    first_lines,
    gain_in_faces,
    gain_line,
    other_lines,
)
from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    InNotebook,
    InOneLine,
    IntArray,
    MeshError,
    PoseError,
    ReadByName,
    first_of,
    frozen_record,
    hooks_of,
    json_bytes,
    matmul,
    parse_json,
    percent,
    plural,
    shown,
    sort_order,
)
from rastercov.base.arguments import finite_number, is_number, share_meant
from rastercov.base.errors import PartMadeError
from rastercov.base.format import area, points
from rastercov.core.area.feature import NEEDS
from rastercov.core.area.features import unmet_lines
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.remedies import TURN, Allowed
from rastercov.core.area.rows import with_rule
from rastercov.core.area.stages import add_rows, failures_of_rows
from rastercov.core.area.table import Regions
from rastercov.core.area.zones import ZONES, DeadZones, areas_by_reason
from rastercov.core.camera import (
    Camera,
    Cameras,
    Poses,
    Rig,
    Views,
    cameras_of,
    gates_of,
    heads_of,
    names_of_poses,
    renumber,
    rows_of_result,
    to_camera,
    to_image,
)
from rastercov.core.coverage.evaluation import LEAST_LOST_REL, lose_without
from rastercov.core.coverage.shards import sha256
from rastercov.core.coverage.task import REASONS, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import (
    Names,
    list_names,
    names_in,
    parts_above,
    quote,
    rows_at,
    rows_of,
)
from rastercov.formats.cameras import read_views
from rastercov.placement.plan.baseline import Against, Told, check_task, compare
from rastercov.placement.plan.file import Plan, PlanError, PlanFeature
from rastercov.placement.plan.goals import (
    AlikeGoals,
    OwnGoal,
    measure_rig,
    permits_of,
    requirements_of,
    separate_goals,
)
from rastercov.placement.plan.network import (
    AreaRequirement,
    Measured,
    Requirement,
    Rows,
    classify_areas,
    classify_network,
    counting,
    find_uncovered,
    goal_lines,
    limits_of,
    most_views,
    observer_of,
    seeable_areas,
    summary_of,
    views_by_group,
    warnings_of,
)
from rastercov.placement.plan.phases import Demand, Verdicts, phases_of
from rastercov.placement.plan.prepare import Step, quiet
from rastercov.placement.plan.rig_parts import Kept
from rastercov.placement.plan.scene import free_places, name_scene, places_of
from rastercov.placement.required import HOLDS, SHARE_TOLERANCE
from rastercov.placement.select.problem import in_whole_numbers, views_of, weights_of
from rastercov.placement.uncovered import Leftover

Limits = Mapping[str | None, float]
Mask = tuple[int, int, int, int] | None
"""First column and row of an image that are masked, and those after the last."""
NOTHING_MORE = Demand()
MOST_GROUPS, MOST_GOALS = 5, 50
"""Groups named, those with the most uncovered weight, and goals explained, the worst."""


@frozen_record(repr=False)
class Checked(InOneLine, InNotebook):
    """Checked cameras and the status of each requirement, as `rastercov.check` returns it.

    Attributes
    ----------
    plan : Plan
        The plan.
    poses_file : Path
        File of the poses.
    mesh : Mesh
        The scene of the plan.
    task : Task
        Thresholds of the plan.
    views : int or dict of str to int
        Number of cameras required, for all faces or by group.
    requirements : tuple of Requirement
        Required shares with the shares that are covered.
    whole : Requirement
        Covered share of the whole task, with limit 0 if nothing is required of it.
    groups : tuple of Requirement
        Covered share of every evaluated group, with limit 0 if nothing is required of it; the least
        covered first.
    cameras : Measured
        The cameras and what they cover.
    leftover : Leftover
        Faces that are not covered, with reasons.
    asked_views : int or None
        Number of cameras required that replaces the one of the plan.
    names : tuple of str
        Names of the cameras.
    against : Against or None
        Differences from the baseline, if there is one.
    goals : mapping of str to Checked
        Result of each named goal of the plan.
    assured : Verdicts or None
        Requirements under what a feature demands, such as under installation errors.
    scene : Mesh or None
        The mesh with the groups of goals.
    """

    plan: Plan
    poses_file: Path
    mesh: Mesh
    task: Task
    views: int | dict[str, int]
    requirements: tuple[Requirement, ...]
    whole: Requirement
    groups: tuple[Requirement, ...]
    cameras: Measured
    leftover: Leftover
    asked_views: int | None = None
    names: tuple[str, ...] = ()
    against: Against | None = None
    goals: Mapping[str, "Checked"] = field(default_factory=dict)
    assured: Verdicts | None = None
    scene: Mesh | None = None

    @property
    def is_met(self) -> bool:
        """True if every requirement holds, and nothing is worse than in the baseline.

        With installation errors, each requirement must hold under these errors as well.
        """
        return not self.unmet

    @property
    def unmet(self) -> list[str]:
        """Names of requirements that are not met: goals, groups, "all", "baseline", "tolerance"."""
        short = [each for each in self.requirements if each.status != HOLDS]
        names = [each.goal or each.group or "all" for each in short]
        names += ["baseline"] if self.against and self.against.is_worse else []
        return names + ([self.assured.word] if self.assured and not self.assured.holds else [])

    def lines(self, level: int | None = None) -> list[str]:
        """The result as lines of text, with the parts of the first `level` levels of names."""
        return [*self.first_lines(level), *self.other_lines(level)]

    def first_lines(self, level: int | None = None) -> list[str]:
        """Up to four lines: covered area, best change, goal, and worst dead zone.

        Where only the baseline fails, its verdict, and the zone that grew most; where only
        installation errors are not withstood, the verdict under them.
        """
        goal, _ = goal_lines(self.requirements, self._where)
        if (lost := self._lost_alone) is None:
            if self.assured is not None and self.unmet == [self.assured.word]:
                goal = self.assured.lines()[0]
            zone = zone_of_goal(self.requirements, self.goals, level)
            return first_lines(self.summary(), goal, level, zone, self.best_change)
        lines = first_lines(self.summary(), lost.lines()[0], level)
        return [*lines[:2], *lost.words_of_zone(lost.zones[0], level)] if lost.zones else lines

    @cached_property
    def best_change(self) -> GoalChange | None:
        """As of `best_change` of all goals."""
        return best_change(self.requirements, self.goals, self.placed, self.summary())

    @property
    def placed(self) -> "PlacedCameras":
        """The cameras in the scene of the task."""
        task = self.plan.build_task(most_views(self.plan, self.asked_views))
        own = self.plan.rig, self.cameras.placed, task, self.views
        return PlacedCameras(self.mesh, *own)

    def other_lines(self, level: int | None = None) -> list[str]:
        """The rest: other goals, each with reasons why it fails, losses, and other dead zones."""
        before = set(self.first_lines(level))
        rows = set() if zone_of_goal(self.requirements, self.goals) else {0}
        lines = lines_of_goals(
            self.requirements, partial(self.reasons, level=level), before, self._where
        )
        if (of_plan := self.plan.task.views) != self.views:
            planned = f" ({of_plan} in the plan)"
            if not isinstance(of_plan, int):
                planned = " for all groups (the plan sets them by group)"
            lines.append(f"required views: {self.views}{planned}")
        if getattr(self.plan.selection, "of_reachable", False):
            lines.append(
                "of_reachable is ignored: a rig has no candidates, so shares are of the whole task"
            )
        if any(each.is_carried for each in self.plan.candidates):
            lines.append(
                "the arm, and the scene beside its turntable, are left out: reach, collisions "
                "and shadows are not checked"
            )
        if self.against is not None:
            lines += self.against.lines(level)
            changed = [zone["row"] for zone in self.against.zones]
            rows = {*changed} if self._lost_alone and changed else {*rows, *changed}
        if self.assured is not None:
            lines += self.assured.lines()
        is_held = all(each.status == HOLDS for each in self.requirements if not each.goal)
        lines += other_lines(self.summary(), level, has_reasons=is_held, said=rows)
        return [line for line in lines if line not in before]

    def summary(self) -> ByName:
        """Figures of the network, with its covered area where the plan counts that."""
        return summary_of(self.plan, self.cameras, self.asked_views)

    @cached_property
    def _worst(self) -> list[Requirement]:
        return worst_of(self.requirements)

    def reasons(self, requirement: Requirement, level: int | None = None) -> list[str]:
        """Reasons why one of the worst does not hold, by its groups or parts, the worst first.

        The parts are those of the level below its own unless `level` is given.
        """
        if requirement not in self._worst:
            return []
        if requirement.goal in self.goals:
            return reasons_of_goal(requirement, self.goals, level)
        if requirement.is_most:
            return self.zone_lines(requirement, level)
        if requirement.status == HOLDS:
            return []
        groups, below, own = self.mesh.groups, 1, None
        if requirement.group is not None:
            own = rows_of([group.name for group in groups], requirement.group)
            below = requirement.group.count("/") + 2
        below = level or below
        parts, lines = rows_at(groups, below, own), list[str]()
        left = {name: self._uncovered[rows].sum() for name, rows in parts.items()}
        wanted = sorted(filter(left.get, left), key=lambda name: -left[name])
        for name in wanted[:MOST_GROUPS]:
            is_one = len(parts[name]) == 1
            kind = "group" if is_one else "part"
            own_name = groups[parts[name][0]].name if is_one else name
            entry = self.leftover.of_groups(name, parts[name], below)
            why, label = self._why(parts[name], entry), REASONS["occluded"].label
            hiders = [
                f"the {kind} itself" if each == name else each for each in entry["hidden_by"]
            ][:3]
            by = f"{label} (by {', '.join(hiders)})" if hiders else label
            lines.append(f"{kind} {own_name}: {why.replace(label, by)}")
        if (rest := len(wanted) - MOST_GROUPS) > 0:
            lines.append(f"and {rest} more")
        return [*self._of_rules, *lines]

    def _why(self, rows: Sequence[int], entry: ReadByName) -> str:
        """Uncovered areas, or faces, of some groups by reason."""
        if self.cameras.areas is not None:
            members = np.isin(self.mesh.face_group, rows) & self.mesh.task_mask
            return by_reason(areas_by_reason(self.zones, members))
        shares = sorted(entry["reasons"].items(), key=lambda item: -item[1]["faces"])
        why = ", ".join(
            f"{share['faces']:,} {REASONS[name].label}{gain_in_faces(share)}"
            for name, share in shares
        )
        return f"{plural(entry['left']['faces'], 'face')} uncovered: {why}"

    @cached_property
    def _uncovered(self) -> FloatArray:
        """(G,) uncovered area by group, m^2; by face the uncovered weight."""
        mesh = self.mesh
        if self.cameras.areas is None:
            row = mesh.face_group
            weights = weights_of(mesh, self.plan.task.weight_by) * self.leftover.left
        else:
            row, weights = mesh.face_group[self.zones.face], self.zones.piece_area
        return np.bincount(row, weights, len(mesh.groups)).astype(np.float64)

    @property
    def zones(self) -> DeadZones:
        """Dead zones by area."""
        assert self.cameras.areas is not None
        by_group = views_by_group(self.plan, self.asked_views)
        return self.cameras.areas.zones(self.plan.rig, self.cameras.placed, by_group)

    def parts(self) -> list[ByName]:
        """Shares of parts of several groups, from those of the groups, ready for JSON."""
        members: dict[str, list[Requirement]] = {}
        for each in self.groups:
            for part in parts_above(str(each.group)):
                members.setdefault(part, []).append(each)
        whole = weights_of(self.mesh, self.plan.task.weight_by) * self.mesh.task_mask
        by_group = np.bincount(self.mesh.face_group, whole, len(self.mesh.groups))
        names: list[str | None] = [group.name for group in self.mesh.groups]
        weight = dict(zip(names, by_group.tolist(), strict=True))
        items = []
        for part, own in members.items():
            outer = members.get(part.rpartition("/")[0], self.groups)
            if 1 < len(own) < len(outer):
                entry: ByName = {"group": part, "faces": sum(each.faces for each in own)}
                sizes = np.array([getattr(each, "of_m2", weight[each.group]) for each in own])
                for name in ("low", "share", "high"):
                    values = np.array([getattr(each, name) for each in own])
                    total = float(sizes.sum())
                    entry[name] = float(matmul(sizes, values)) / total if total > 0 else 1.0
                if self.cameras.areas is not None:
                    entry["of_m2"] = float(sizes.sum())
                items.append(entry)
        return items

    @property
    def _where(self) -> str:
        """Words on the goals, which are of the rig as planned."""
        return "" if self.assured is None else self.assured.as_planned

    @property
    def _lost_alone(self) -> Against | None:
        """Differences from the baseline where something is worse, and all goals hold."""
        is_held = all(each.status == HOLDS for each in self.requirements)
        return self.against if is_held and self.against and self.against.is_worse else None

    @cached_property
    def _regions(self) -> Regions | None:
        """Regions of each camera by itself; None by face, and of a scene of several phases."""
        if self.cameras.areas is None or phases_of(self.plan, self.mesh) is not None:
            return None
        scene = self.mesh, self.plan.rig, self.task
        with closing(RegionPass(*scene, method=self.plan.task.method)) as finder:
            return finder.find(self.cameras.placed)

    @cached_property
    def _of_rules(self) -> list[str]:
        """Lines on limits of rigs with a rule that no place of theirs meets."""
        if not gates_of(self.plan.rig) or (regions := self._regions) is None:
            return []
        scene = regions.mesh, self.plan.rig, self.task
        return unmet_lines(failures_of_rows, regions, scene, self.cameras.placed)

    @cached_property
    def by_camera(self) -> FloatArray | None:
        """(2, R) area that each of `heads` covers, and that is not covered without it, m^2.

        None by face, and of several phases.
        """
        if (regions := self._regions) is None:
            return None
        parts = with_rule(regions, self.plan.rig, self.cameras.placed)
        covers = np.bincount(parts.pair_pose, parts.area, len(parts.pose_ids))
        lost = lose_without(parts, views_of(self.mesh, self.views))
        return np.array((covers, lost), np.float64)

    @cached_property
    def heads(self) -> tuple[IntArray, list[str], str]:
        """Cameras, or heads with a rule, as of `heads_of`."""
        return heads_of(self.plan.rig, self.cameras.placed, self.names)

    def explain(self, requirement: Requirement, level: int | None = None) -> list[str]:
        """Reasons of a goal, and lines as of `zone_lines` and `lost_lines`."""
        zone = [] if requirement.is_most else self.zone_lines(requirement, level)
        return [*self.reasons(requirement, level), *zone, *self.lost_lines(requirement)]

    def lost_lines(self, requirement: Requirement) -> list[str]:
        """A line on the cameras without which less of a goal is covered, the most first."""
        if requirement.is_most or self.by_camera is None:
            return []
        lost = self.by_camera[1]
        lost = np.where(lost > LEAST_LOST_REL * float(self.mesh.areas.sum()), lost, 0.0)
        ranked = sort_order(-lost)[: np.count_nonzero(lost)].tolist()
        items = [f"{self.heads[1][row]} ({area(float(lost[row]))})" for row in ranked]
        return [f"lost without it: {first_of(items)}"] if items else []

    def cameras_of_goal(self) -> list[ByName]:
        """Figures of `by_camera` of those that cover any of it, ready for JSON."""
        covers, lost = ((), ()) if self.by_camera is None else self.by_camera.tolist()
        rows, names, _ = self.heads
        return [
            {"pose": row, "name": name, "m2": m2, "lost_m2": alone}
            for row, name, m2, alone in zip(rows.tolist(), names, covers, lost, strict=False)
            if m2 > 0
        ]

    def zone_lines(self, requirement: Requirement, level: int | None = None) -> list[str]:
        """The worst dead zone of a goal, and advice; of what must not be seen, who sees it."""
        if not requirement.is_most:
            return first_lines(self.summary(), level=level)[1:] if requirement.lack else []
        if requirement.share <= SHARE_TOLERANCE:
            most = f"at most {percent(requirement.high)}, by the error bound"
            is_proved = requirement.high <= SHARE_TOLERANCE
            sees = "sees" if self.counts_all else "covers"
            return [f"no camera {sees} any of it ({'proved' if is_proved else most})"]
        lines = [f"seen by {first_of([said for _, said in self._seeing])}"]
        if requirement.status == HOLDS:
            return lines
        _, _, words, left = self._turned(requirement)
        return [*lines, f"advice: {words}: {percent(left) if left else 'none'} of it would be seen"]

    @property
    def counts_all(self) -> bool:
        """True where all that a camera sees counts as covered."""
        return self.task == Task()

    @cached_property
    def _seeing(self) -> list[tuple[str, str]]:
        """Names of cameras that see any of the task, and the same with the area of each."""
        if self.by_camera is None:
            rows = np.flatnonzero((self.cameras.covers & self.mesh.task_mask).any(axis=1))
            names = [self.names[row] for row in rows.tolist()]
            return [(name,) * 2 for name in names or ("a camera in some frame",)]
        pairs = zip(self.heads[1], self.by_camera[0].tolist(), strict=True)
        return [(name, f"{name} ({area(m2)})") for name, m2 in pairs if m2]

    def _turned(self, requirement: Requirement) -> tuple[list[int], Mask, str, float]:
        """Heads to turn away from what must not be seen, or a mask, in words, and the share left.

        By face all cameras that see it, without rows.
        """
        names, rows, left = [name for name, _ in self._seeing], list[int](), 0.0
        if self.by_camera is not None:
            sees, lost = self.by_camera
            rows = np.flatnonzero(sees).tolist()
            rest = requirement.share - float(lost.max()) / getattr(requirement, "of_m2", 1.0)
            if rest <= requirement.limit + SHARE_TOLERANCE:
                rows, left = [int(lost.argmax())], max(rest, 0.0)
                names = [self.heads[1][rows[0]]]
        mask = None if self.by_camera is None else self._mask(rows)
        if mask is None:
            return rows, None, f"turn, move or mask {first_of(names)}", left
        words = (
            "mask {4}, columns {0} to {2}, rows {1} to {3} of its image (px from the upper left)"
        )
        return rows, mask, f"{words.format(*mask, *names)}, or turn or move it", left

    def _mask(self, rows: list[int]) -> Mask:
        """Pixels in which one camera has all that it sees, one more around; None if not known."""
        regions, rig, placed = self._regions, self.plan.rig, self.cameras.placed
        if regions is None or rows[1:] or rig.gates or rig.tasks or rig.equipment:
            return None
        camera = rig.cameras[placed.camera[rows[0]]]
        if camera.is_curved:
            return None
        own = regions.of_poses(np.arange(len(placed)) == rows[0])
        ends = to_image(to_camera(own.points(), placed.world_from_camera[rows[0]]), camera)
        around = np.array((np.floor(ends.min(axis=0)) - 1, np.ceil(ends.max(axis=0)) + 1))
        a, b, c, d = np.clip(around, 0, (camera.width, camera.height)).astype(int).ravel().tolist()
        behind = masked(camera, (a, b, c, d))
        with closing(RegionPass(self.mesh, behind, self.task)) as finder:
            again = finder.find(Poses.of(placed.world_from_camera[rows]))
        most = SHARE_TOLERANCE * float(self.mesh.areas[self.mesh.task_mask].sum())
        return (a, b, c, d) if (own.area + own.bound).sum() <= again.area.sum() + most else None

    def turn_away(
        self,
        requirement: Requirement,
        lost: Callable[[list[int], Mask], Mapping[str, float]],
    ) -> GoalChange:
        """Cameras that see what must not be seen, turned away, or one with a mask.

        `lost` are the shares of other goals that are lost without rows of `heads`, or by a mask.
        """
        rows, mask, words, left = self._turned(requirement)
        gain = f"{points(requirement.share - left)} less"
        how = " by the mask" if mask else " without it" if len(rows) == 1 else " without them"
        goal = f"{requirement.name}; {requirement.after(left - requirement.share)}"
        line = gain_line(words, goal, gain, lost(rows, mask), how)
        return GoalChange(requirement.share - left, line, words)


def masked(camera: Camera, mask: tuple[int, int, int, int]) -> Camera:
    """The part of a camera that is behind a mask of its image."""
    a, b, c, d = mask
    return replace(camera, width=c - a, height=d - b, cx=camera.cx - a, cy=camera.cy - b)


def limits(
    plan: Plan,
    min_coverage: float | None,
    groups: Sequence[str] | Mapping[str, float],
    *,
    may_be_none: bool = False,
) -> dict[str | None, float]:
    """Required shares: those of the plan, overridden by those of a call or, as texts, of options.

    Raises
    ------
    ConfigError
        For a group that is not NAME=SHARE, or when nothing is required.
    """
    limits = limits_of(plan.selection)
    whole, group, any_of = "--min-coverage", "--group NAME=SHARE", "--group, --baseline"
    if isinstance(groups, Mapping):
        whole, group, any_of = "min_coverage", "groups", "groups, baseline"
        groups = [f"{n}={float(s) if is_number(s) else repr(s)}" for n, s in groups.items()]
    if min_coverage is not None:
        limits[None] = finite_number(min_coverage)
        if not 0 <= limits[None] <= 1:
            raise ConfigError(
                f"{whole}: expected a share from 0 to 1, got {shown(min_coverage)}"
                f"{share_meant(min_coverage)}"
            )
        if limits[None] == 0:
            raise ConfigError(
                f"{whole}: expected a share above 0, got 0, which always holds; increase it"
            )
    for text in groups:
        name, _, share = text.rpartition("=")
        try:
            value = float(share)
        except ValueError:
            value = -1.0
        if not name or not 0 <= value <= 1:
            raise ConfigError(
                f"{group}: expected a share from 0 to 1, got {text!r}{share_meant(value)}"
            )
        if value == 0:
            raise ConfigError(
                f"{group}: expected a share above 0, got {text}, which always holds; increase it"
            )
        limits[name] = value
    if not limits and not plan.goals and not may_be_none:
        raise ConfigError(
            f"{plan.name}: expected a required coverage, got none; give {whole}, {any_of}, "
            'goals, or a selection with goal = "fewest_cameras"'
        )
    return limits


def check(
    plan: Plan,
    poses_file: Path,
    limits: Limits,
    views: int | None = None,
    step: Step = quiet,
    *,
    poses: ArrayLike | Poses | Views | None = None,
    baseline: Told | None = None,
    demand: Demand = NOTHING_MORE,
    kept: Kept | None = None,
) -> Checked:
    """Check a rig against the mesh, camera and task of a plan.

    Parameters
    ----------
    plan : Plan
        Its candidates and constraints are not used. Where it has several cameras, the poses name
        theirs; cameras that the file states go before its own.
    poses_file : Path
        The rig.
    limits : mapping of group name or None to share
        None is the whole task.
    views : int, optional
        Cameras per face, instead of those of the task, also for goals without their own.
    step : callable
        As for `place`.
    poses : (P, 4, 4) array_like, Poses or Views, optional
        Poses of the rig, instead of reading the file; `Poses.camera` counts the cameras of the
        plan, and views are taken as those of a file.
    baseline : mapping, optional
        Outcome of an earlier check to compare it with, see `read_baseline`.
    demand : Demand
        That of a feature, such as errors of installation under which requirements must hold.
    kept : Kept, optional
        Folder for shards of what the cameras cover, which stay, and the processes that make them.

    Raises
    ------
    PartMadeError
        After the shards of workers with `only` are made, for the task and its goals.
    PlanError
        For a plan that does not fit its meshes.
    PoseError
        For a file that cannot be read, a row that is not a pose, and a pose of a camera that the
        plan does not have.
    ConfigError
        For a limit of an unknown group, or of an occluder, and for a baseline of another task.
    """
    given = read_views(poses_file) if poses is None else poses
    images: tuple[str, ...] = ()
    chosen = given.rig if isinstance(given, Views) else None
    if isinstance(given, Views):
        images = given.images
        plan, given = plan_of_cameras(plan, given)
    rig = renumber(given)
    plan = _with_choice(plan, chosen, poses_file)
    rig.check_cameras(len(plan.rig))
    demand.check(plan, rig)
    plan.build_task(views)  # its errors come before the work
    with step("scene"):
        whole, plan, names = name_scene(plan)
        task = plan.task.model_copy(update={"views": views or plan.task.views})
        mesh, goals = separate_goals(plan.model_copy(update={"task": task}), whole)
    if baseline is not None:
        check_task(baseline, _task_of(plan, views))
    demand.check_scene(plan, mesh)
    limits = _by_place(plan, limits, names, mesh)
    asked = limits_of(plan.selection)
    shown = names_of_poses(rig, images)
    if kept is not None and kept.staff.part is not None:
        for alike in AlikeGoals.of(goals):
            with suppress(PartMadeError):
                measure_rig(alike.plan, alike.mesh, rig, None, step, kept)
        measure_rig(plan, mesh, rig, views, step, kept)
        raise PartMadeError("expected cameras, got none; run the command without --only")
    apart = CheckedGoals(goals, rig, shown, step, kept)
    of_goals = [*apart.requirements.values()]
    permits = permits_of([(g, each.high) for g, each in zip(goals, of_goals, strict=True)])
    allowed = Allowed(permits=permits, adds_only=bool(goals))
    checked = _check_rig(plan, mesh, rig, limits, allowed, views, step, kept)
    if (areas := checked.cameras.areas) is not None:
        with step("dead zones") as progress:
            own = plan.rig, checked.cameras.placed, views_by_group(plan, views)
            areas.dead_zones(*own, progress)
    required = [
        replace(each, plan_limit=asked[each.group])
        if asked.get(each.group, each.limit) != each.limit
        else each
        for each in checked.requirements
    ]
    required += of_goals
    checked = replace(
        checked,
        poses_file=poses_file,
        names=shown,
        goals=apart,
        requirements=tuple(required),
        scene=whole,
    )
    if demand.word:
        with step(demand.of):
            under = demand.verdicts(plan, mesh, rig, checked.requirements, views)
        checked = replace(checked, assured=under)
    if baseline is None:
        return checked
    return replace(checked, against=compare(baseline, parse_json(json_bytes(record(checked)))))


class CheckedGoals(Mapping[str, Checked]):
    """Check of each goal of a plan by its name, for a rig with names, made when it is asked for.

    Attributes
    ----------
    requirements : dict of str to Requirement
        Those of all goals, known at once.
    """

    def __init__(
        self,
        goals: Sequence[OwnGoal],
        rig: Poses,
        names: Sequence[str],
        step: Step = quiet,
        kept: Kept | None = None,
    ) -> None:
        self.requirements = requirements_of(goals, rig, step, kept)
        self._goals, self._made = {goal.name: goal for goal in goals}, dict[str, Checked]()
        self._rig, self._names = rig, tuple(names)

    def __getitem__(self, name: str) -> Checked:
        """The check of a goal."""
        if name not in self._made:
            goal, required = self._goals[name], self.requirements
            limits: Limits = {None: goal.limit}
            before = takewhile(
                lambda each: not (goal.is_most and each is goal), self._goals.values()
            )
            permits = permits_of([(each, required[each.name].high) for each in before])
            allowed = Allowed(permits=permits, adds_only=True)
            made = _check_rig(goal.plan, goal.mesh, self._rig, limits, allowed)
            of_goal = (required[name],)
            self._made[name] = replace(made, names=self._names, requirements=of_goal)
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        """True for the name of a goal."""
        return name in self._goals

    def __iter__(self) -> Iterator[str]:
        """Names of the goals, in the order of the plan."""
        return iter(self._goals)

    def __len__(self) -> int:
        """Number of goals."""
        return len(self._goals)


def zone_of_goal(
    requirements: Sequence[Requirement], goals: Mapping[str, Checked], level: int | None = None
) -> list[str]:
    """Lines on the goal that lacks most, as of `Checked.zone_lines`; none where it is the task."""
    for worst in worst_of(requirements)[:1]:
        if worst.status != HOLDS and worst.goal in goals:
            return goals[worst.goal].zone_lines(worst, level)
    return []


class PlacedCameras(NamedTuple):
    """Cameras in a scene, and the thresholds and views by which it is covered."""

    mesh: Mesh
    camera: Cameras
    poses: Poses
    task: Task
    views: int | Mapping[str, int]

    def _shares(
        self, camera: Cameras, poses: Poses, required: Sequence[AreaRequirement]
    ) -> tuple[AreaRequirement, ...]:
        """Requirements of the task with other cameras."""
        areas = AreaNetwork(self.mesh, self.task)
        with closing(RegionPass(self.mesh, camera, self.task)) as finder:
            add_rows(finder, poses, areas)
        return classify_areas(areas, {each.group: each.limit for each in required}, self.views)

    def lost_without(
        self, rows: list[int], mask: Mask, required: Sequence[AreaRequirement]
    ) -> dict[str, float]:
        """Shares of requirements of the task that are lost without rows of poses, by name.

        With a mask of the one row, without what it has there: no other part of its image sees that.
        At most those of the row where others measure with it.
        """
        result, rig = rows_of_result(self.camera, self.poses), self.camera
        left = self.poses[~np.isin(result, result[rows])]
        before, after, least = required, self._shares(rig, left, required), ""
        if mask and isinstance(rig, Rig) and (rig.gates or rig.tasks or rig.equipment):
            least = "at least "
        elif mask:
            cameras = cameras_of(rig)
            behind = masked(cameras[self.poses.camera[rows[0]]], mask)
            matrices = *left.world_from_camera, *self.poses.world_from_camera[rows]
            index = np.append(left.camera, len(cameras))
            placed = Poses.of(np.array(matrices), camera=index)
            before = self._shares((*cameras, behind), placed, required)
        lost = dict[str, float]()
        for own, one, other in zip(required, before, after, strict=True):
            share = (one.m2 - other.m2) / own.of_m2
            rest = f"{percent(own.share - share)}, {percent(own.limit)} required"
            lost[f"{own.called}, which then has {least}{rest}"] = share
        return _losses(lost)


def _losses(shares: Mapping[str, float]) -> dict[str, float]:
    """Those that are above rounding, the largest first."""
    ranked = sorted(shares, key=lambda name: -shares[name])
    return {name: shares[name] for name in ranked if shares[name] > LEAST_LOST_REL}


def best_change(
    requirements: Sequence[Requirement],
    goals: Mapping[str, Checked],
    placed: PlacedCameras,
    summary: ReadByName,
) -> GoalChange | None:
    """The change that gains most of a goal that is not met by area; None where all are met.

    With what other goals lose by it. `placed` and `summary` are those of the task without its named
    goals.
    """
    every = [each for each in requirements if isinstance(each, AreaRequirement) and each.of_m2]
    wanted, found = [each for each in every if not each.is_most], list[GoalChange]()
    needs, is_open = list[str](), False

    def lost(rows: list[int], mask: Mask) -> dict[str, float]:
        shares = dict[str, float]()
        for each in dict.fromkeys(each.goal for each in wanted if rows):
            of = goals[each].placed if each else placed
            shares |= of.lost_without(rows, mask, [own for own in wanted if own.goal == each])
        return _losses(shares)

    short = [each for each in every if each.lack]
    for each in sorted(short, key=lambda each: -each.lack)[:MOST_GOALS]:
        own = goals.get(each.goal)
        if each.is_most and own is not None:
            found.append(own.turn_away(each, lost))
            continue
        of = summary if own is None else own.summary()
        for zone in of.get("dead_zones", ()):
            tried = zone["tried"] or {}
            if not tried.get("gain_m2"):
                needs += zone["advice"].partition(NEEDS)[2:]
                is_open |= "change" in tried
                continue
            if own is None and names_in(placed.mesh.groups, each.group).isdisjoint(zone["groups"]):
                continue
            gains = tried.get("group_gains_m2", {})
            shares = {
                one.called: sum(
                    gains.get(name, 0.0) for name in names_in(placed.mesh.groups, one.group)
                )
                / one.of_m2
                for one in wanted
                if gains and not one.goal
            }
            losses = _losses({name: -share for name, share in shares.items()})
            exact = shares.get(each.called)
            about = tried["gain_m2"] / each.of_m2
            end = each.after(about if exact is None else exact, is_about=exact is None)
            goal = f"{each.called}; {end}"
            found.append(GoalChange.of_zone(zone, goal, exact, losses, each.of_m2))
    none = NO_CHANGE if short else None
    if none and is_open:  # of several views
        none = none._replace(line="best change known: see the advice, whose gain is not known")
    if none and (change := next(filter(None, needs), "")):
        none = none._replace(line=f"best change known: half of a dead zone needs {change}")
    if none and (below := [z for z in summary.get("dead_zones", ()) if TURN in z["advice"]]):
        share = percent(sum(zone["percent"] for zone in below) / 100)
        line = f"{none.line}; {TURN}so that cameras come before dead zones of {share} of the area"
        none = none._replace(line=line)
    return max(found, key=lambda change: change.share, default=none)


def reasons_of_goal(
    requirement: Requirement, goals: Mapping[str, Checked], level: int | None = None
) -> list[str]:
    """Lines on the goal of a requirement, as of `Checked.explain`."""
    own = goals.get(requirement.goal)
    return [] if own is None else own.explain(requirement, level)


def worst_of(requirements: Sequence[Requirement]) -> list[Requirement]:
    """Those that are explained, which lack most."""
    return sorted(requirements, key=lambda each: -each.lack)[:MOST_GOALS]


def lines_of_goals(
    requirements: Sequence[Requirement],
    reasons: Callable[[Requirement], list[str]],
    before: Collection[str],
    where: str = "",
) -> list[str]:
    """Lines on all requirements as of `goal_lines`, the worst with reasons, without `before`."""
    first, others = goal_lines(requirements, where)
    explained, lines = worst_of(requirements), list[str]()
    ranked = sorted(requirements, key=lambda each: each is not explained[0])
    for line, each in zip([first, *others], ranked, strict=False):
        said = reasons(each) if each in explained else ()
        own = [f"  {why}" for why in said if why not in before]
        again = [why if why not in lines else f"{why.partition(':')[0]}: as above" for why in own]
        lines += [f"why the {line.partition(':')[0]}:" if line in before and own else line, *again]
    return [line for line in lines if line not in before]


def explain_goals(
    requirements: Sequence[Requirement], goals: Mapping[str, Checked]
) -> list[ByName]:
    """Reasons, zones and cameras of each goal, those that lack most first, ready for JSON."""
    items = list[ByName]()
    for each in worst_of(requirements):
        if (own := goals.get(each.goal)) is not None:
            told = {} if each.is_most else own.summary()
            items.append(
                {"goal": each.goal, "status": each.status, "lines": own.explain(each)}
                | {name: told[name] for name in ("not_covered_because", *ZONES) if name in told}
                | {
                    "is_unseen": each.is_most and each.high <= SHARE_TOLERANCE and own.counts_all,
                    "cameras": own.cameras_of_goal(),
                }
            )
    return items


def _with_choice(plan: Plan, chosen: Rig | None, poses_file: Path) -> Plan:
    """The plan with the equipment that `place` chose and wrote beside the poses."""
    for each in hooks_of(PlanFeature):
        if each.is_chosen(plan):
            if chosen is None or each.word not in chosen.equipment:
                raise PoseError(
                    f"{poses_file.name}: expected chosen {each.word} for {plan.name}, got none; "
                    "give the poses.json that place wrote"
                )
            plan = each.add_choice(plan, chosen)
    return plan


def _check_rig(
    plan: Plan,
    mesh: Mesh,
    rig: Poses,
    limits: Limits,
    allowed: Allowed,
    views: int | None = None,
    step: Step = quiet,
    kept: Kept | None = None,
) -> Checked:
    """Check of the task of a plan, without its goals; cameras are `allowed` where it permits."""
    task = plan.build_task(views)
    counted = counting(plan.task) | ({"views": views} if views else {})
    cameras = measure_rig(plan, mesh, rig, views, step, kept)
    if cameras.areas is not None:
        places, free = places_of(plan, mesh), partial(free_places, plan)
        cameras.areas.allowed = allowed._replace(places=places, free=free)
    with step("uncovered faces") as progress, observer_of(plan, mesh) as observer:
        leftover = find_uncovered(observer, cameras, progress, views=counted["views"])
    seeable = seeable_areas(plan, cameras.network, cameras.areas)
    masks = cameras.covered, cameras.certain, cameras.possible
    weights = in_whole_numbers(weights_of(mesh, plan.task.weight_by))

    def status_of(wanted: Limits, rows: Rows | None = None) -> tuple[Requirement, ...]:
        if cameras.areas is not None:
            return classify_areas(
                cameras.areas, wanted, counted["views"], rows=rows, seeable=seeable
            )
        return classify_network(mesh, weights, wanted, *masks, rows=rows)

    alone = rows_at(mesh.groups)
    every = status_of({name: limits.get(name, 0.0) for name in alone}, alone)
    (whole,) = status_of({None: limits.get(None, 0.0)})
    return Checked(
        plan=plan,
        poses_file=plan.path,
        mesh=mesh,
        task=task,
        views=counted["views"],
        requirements=status_of(limits),
        whole=whole,
        groups=tuple(sorted(every, key=lambda each: each.share)),
        cameras=cameras,
        leftover=leftover,
        asked_views=views,
    )


def _by_place(plan: Plan, limits: Limits, names: Names, mesh: Mesh) -> dict[str | None, float]:
    """Limits by group or part from limits by name, for evaluated ones; PlanError for others."""
    scored = [group.name for group in mesh.groups if not group.is_occluder]
    by_name = {name: limit for name, limit in limits.items() if name is not None}
    lines: list[str] = []
    for name in by_name:
        try:
            if set(names.groups_of(name)).isdisjoint(scored):
                lines.append(
                    f"expected a group of the task, got {quote(name)}, which occludes or has a "
                    f"separate goal; use {list_names(scored)}"
                )
        except MeshError as error:
            lines.append(str(error))
    if lines:
        is_of_plan = by_name.keys() <= limits_of(plan.selection).keys()
        raise PlanError(plan.name if is_of_plan else "group", lines)
    every = names.by_group(by_name, names.places_of)
    whole = {None: limits[None]} if None in limits else {}
    return whole | {name: limit for name, limit in every.items() if rows_of(scored, name)}


def plan_of_cameras(plan: Plan, views: Views) -> tuple[Plan, Poses]:
    """The plan with its cameras, or those of the file, and the poses with the camera of each.

    Cameras that the file states are used where they differ from the plan's.
    Poses may name rigs of the plan: they are those of all cameras of each.

    Raises
    ------
    PlanError
        For a plan without cameras and a file without.
    PoseError
        For poses without a unit, of several cameras where the plan has one, for names that it does
        not have, and for a rule, thresholds or lamps that are stated with the poses alone.
    """
    views.check_unit()
    if not plan.has_cameras and views.rig is not None:
        return plan.with_cameras(views.rig), views.poses
    rigs, named = set(plan.mounts.names) - set(plan.rig.names), set(views.camera_names)
    if rigs and not plan.rig.is_one and (not named or rigs & named):
        return plan, plan.mounts.cameras(plan.mounts.place(views))[0]
    used, first = np.unique(views.poses.camera, return_index=True)
    if len(plan.rig) > 1 or (plan.cameras and views.camera_names):
        poses = views.with_cameras(plan.rig).poses
    elif len(used) > 1:
        names = ", ".join(views.camera_names[row] for row in used[:MOST_GROUPS])
        raise PoseError(
            f"expected poses of one camera, as {plan.name}, got {len(used)}: {names}; name them as "
            "[cameras.NAME], leave out [camera], or choose one with --camera-name"
        )
    else:
        poses = Poses.of(views.poses, camera=0)
    if views.rig is not None:
        lost = views.rig.equipment.keys() - plan.build_equipment().keys()
        for own, stated in zip(poses.camera[first], used, strict=True):
            off = lost | _has(views.rig, stated) - _has(plan.rig, own)
            if off and not plan._is_given:
                raise PoseError(
                    f"expected {min(off)} of {views.rig.names[stated]} in {plan.name}, as with the "
                    "poses, got none; state it there, or leave out its cameras"
                )
            plan = plan.with_stated(own, views.rig.cameras[stated])
    return plan, poses


def _has(rig: Rig, row: int) -> set[str]:
    """Words on what a camera of a rig has beside its lens."""
    has_rule = any(at <= row < at + gate.n for at, gate in rig.gates.items())
    has = {"the rule": has_rule, "the thresholds": rig.names[row] in rig.tasks}
    return {word for word, is_there in has.items() if is_there}


def _task_of(plan: Plan, views: int | None) -> ByName:
    """Everything that results depend on beside the scene, as in a file of JSON."""
    own: ByName = {"by": plan.unit_of_result()[0], **counting(plan.task)}
    own["views"] = views or own["views"]
    return dict(parse_json(json_bytes(plan.build_task(views)._entries() | own)))


def to_json(checked: Checked) -> ByName:
    """The outcome, ready for JSON."""
    network = checked.summary()
    zones = {name: network.pop(name) for name in ZONES if name in network}
    return {
        "plan": str(checked.plan.path),
        "poses": str(checked.poses_file),
        "met": checked.is_met,
        "unmet": checked.unmet,
        "views": checked.views,
        **(
            {}
            if checked.views == checked.plan.task.views
            else {"plan_views": checked.plan.task.views}
        ),
        "min_angle_deg": checked.plan.task.min_angle_deg,
        "weight_by": checked.plan.task.weight_by,
        "cameras": len(checked.cameras.placed),
        "size_m": np.ptp(checked.mesh.bounds, axis=0).tolist(),
        "warnings": list(checked.mesh.warnings),
        "result_warnings": (warned := warnings_of(checked.plan, checked.cameras)),
        "doubts": warned,
        "requirements": [
            asdict(each) | {"short_by": each.short_by, "reasons": checked.reasons(each)}
            for each in checked.requirements
        ],
        "all": asdict(checked.whole),
        "groups": [asdict(each) for each in checked.groups],
        "parts": checked.parts(),
        "goals": explain_goals(checked.requirements, checked.goals),
        "best_change": checked.best_change and checked.best_change._asdict(),
        "task": _task_of(checked.plan, checked.asked_views),
        **{name: network[name] for name in ("covered_area",) if name in network},
        **zones,
        **({} if checked.against is None else {"baseline": checked.against.to_json()}),
        **({} if checked.assured is None else {checked.assured.word: checked.assured.summary()}),
        "network": network,
        "left": checked.leftover.summary(),
    }


def record(checked: Checked) -> ByName:
    """The outcome with what a later check compares it by, for `check.json`.

    Where the plan counts area, `dead_faces` has rows of the centroid of a face, the row of a dead
    zone, and the area of the face in it, m^2.
    """
    scene = checked.mesh if checked.scene is None else checked.scene
    told = to_json(checked) | {"scene_sha256": sha256(scene.vertices, scene.faces)}
    plan, cameras = checked.plan, checked.cameras
    if cameras.areas is None:
        return told
    wanted = views_by_group(plan, checked.asked_views)
    zones = cameras.areas.zones(plan.rig, cameras.placed, wanted)
    pairs, pieces = np.unique((zones.zone, zones.face), axis=1, return_inverse=True)
    square_metres = np.bincount(pieces.ravel(), zones.piece_area)
    rows = np.column_stack((checked.mesh.centroids[pairs[1]], pairs[0], square_metres))
    return told | {"dead_faces": rows.tolist()}
