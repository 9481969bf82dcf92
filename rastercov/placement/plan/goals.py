"""Goals of a plan with groups, thresholds and views of their own, as plans of the same scene.

The groups of a goal are not of the task. A goal is answered as a plan is whose task has the
thresholds of the goal, in a scene in which only its groups are evaluated: all others occlude, and
targets, which hide nothing, are left out.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import asdict, replace
from functools import cached_property

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    first_of,
    frozen_record,
    hooks_of,
    plural,
)
from rastercov.base.format import verb
from rastercov.core.area.advice import task_in_words
from rastercov.core.area.cells import Cells, cells, usual_size
from rastercov.core.area.regions import RegionObserver, RegionPass
from rastercov.core.camera import Cameras, Poses, Rig, renumber
from rastercov.core.coverage.shards import Wanted, open_for
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.placement.bits import BITS, CoveredBits, n_words, spread_out
from rastercov.placement.improve.objective import CellObjective, Objective, TogetherObjective
from rastercov.placement.matrix import build_matrix, matrices_of_cells
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.entries import extend_entry
from rastercov.placement.plan.file import Plan, PlanError, PlanFeature
from rastercov.placement.plan.network import (
    Measured,
    Requirement,
    RigAreas,
    Rows,
    classify_areas,
    classify_network,
    counting,
    measure_network,
    most_views,
    observer_of,
    seeable_areas,
    views_by_group,
)
from rastercov.placement.plan.phases import phases_of
from rastercov.placement.plan.rig_parts import Kept, RigPart, RigShards, parts_of
from rastercov.placement.plan.sections import GoalSection
from rastercov.placement.required import SHARE_TOLERANCE
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Goal,
    Problem,
    in_whole_numbers,
    problem_of,
    weights_of,
)
from rastercov.shards import Progress, silent

WORSE = 16
"""Weight of what a goal permits up to a limit, in that of the task."""
LEAST_SHARE = 1e-6
"""Share of a cell from which it counts as seen, where it should not be."""
NOTHING = BestCoverage(cameras=0)
OF_TASK, OF_GOALS = "task", "goals"
"""Parts of the elements of a problem with goals: those of the task, and those of each goal."""


@frozen_record
class OwnGoal:
    """A goal as a plan of its own.

    Attributes
    ----------
    plan : Plan
        With the thresholds and views of the goal, and no goals.
    scene : Mesh
        The scene, in which only targets are evaluated.
    scored : sequence of str
        Groups of the goal.
    limit : float
        Share to cover at least or, where `is_most`, at most, [0, 1].
    groups : tuple of str
        Those that the plan names, if any.
    """

    name: str
    plan: Plan
    scene: Mesh
    scored: Sequence[str]
    limit: float
    is_most: bool
    groups: tuple[str, ...]

    @cached_property
    def mesh(self) -> Mesh:
        """The scene, in which only the groups of the goal are evaluated."""
        return keep_scored(self.scene, self.scored, is_most=self.is_most)

    @cached_property
    def is_by_area(self) -> bool:
        """True where its result is by area."""
        return self.plan.unit_of_result()[0] == "area"

    @cached_property
    def kind(self) -> tuple[object, ...]:
        """Key of what poses are measured by; goals of one kind are measured together.

        Targets and what can be seen may differ by the groups of a goal.
        """
        task = self.plan.task
        is_alone = self.scene.has_targets or task.weight_by == "seeable"
        apart = self.name if is_alone or not self.plan.is_still else ""
        return task.model_dump_json(), self.is_most, apart

    @cached_property
    def asked(self) -> str:
        """Groups that the plan names, and what counts as covered, in words."""
        of = f"For {', '.join(self.groups)}: " if self.groups else ""
        task, by_group = asdict(self.plan.build_task()), views_by_group(self.plan, None)
        return of + task_in_words(task, by_group, by_face=not self.is_by_area)

    def rig_of(self, rig: Rig) -> Rig:
        """The cameras of a rig as they count for the goal."""
        return all_sight(rig) if self.is_most else rig

    def requirement_of(self, requirement: Requirement) -> Requirement:
        """The requirement of the goal, from that of its whole plan."""
        if self.is_most:
            return requirement.at_most(self.name, self.limit)
        return replace(requirement, goal=self.name)


def permits_of(goals: Sequence[tuple[OwnGoal, float]]) -> Callable[[Cameras, Poses], bool] | None:
    """True for a further camera that covers no more of goals by area than they permit.

    Parameters
    ----------
    goals : sequence of (OwnGoal, float)
        Each with the largest share that cameras cover of it.
    """
    rest = {
        goal.name: max(goal.limit - high, 0.0)
        for goal, high in goals
        if goal.is_most and goal.is_by_area
    }
    every = AlikeGoals.of([goal for goal, _ in goals if goal.name in rest])

    def permits(camera: Cameras, poses: Poses) -> bool:
        return all(alike.permits(rest, camera, poses) for alike in every)

    return permits if rest else None


def separate_goals(plan: Plan, mesh: Mesh) -> tuple[Mesh, tuple[OwnGoal, ...]]:
    """The scene of the task, without the groups of goals, and the goals.

    Parameters
    ----------
    plan, mesh
        Of `name_scene`.

    Raises
    ------
    PlanError
        Where goals leave no group to the task.
    """
    if not plan.goals:
        return mesh, ()
    scored = [group.name for group in mesh.groups if not group.is_occluder]
    taken = plan.goal_of_groups
    rest = [name for name in scored if name not in taken]
    if not rest:
        raise PlanError(
            plan.name,
            "goals: expected a group without a goal, got none; state the coverage of one as "
            "selection.coverage instead",
        )
    none = mesh.with_groups(occluders=[g.name for g in mesh.groups if not g.is_target])
    goals = tuple(
        OwnGoal(
            name=name,
            plan=_plan_of(plan, goal),
            scene=none,
            scored=goal.groups or rest,
            limit=goal.coverage or goal.at_most or 0.0,
            is_most=goal.coverage is None,
            groups=tuple(goal.groups or ()),
        )
        for name, goal in plan.goals.items()
    )
    return keep_scored(mesh, rest), goals


def _plan_of(plan: Plan, goal: GoalSection) -> Plan:
    """The plan with the task of a goal.

    A goal to cover replaces thresholds of the task; one of what may be covered has its own alone,
    so that all that a camera sees counts unless it says otherwise: dark, blurred, in some frame,
    or without the others of a rule.
    """
    own = {name: getattr(goal, name, None) for name in Task.__dataclass_fields__}
    changes: ByName = {name: value for name, value in own.items() if value is not None}
    if goal.at_most is not None:
        entries = extend_entry("counting", extend_entry("task")).model_fields
        usual = {name: each.default for name, each in entries.items()}
        changes = usual | {name: getattr(Task, name) for name in own} | changes
        plan = _with_all_sight(plan)
    return plan.model_copy(update={"task": plan.task.model_copy(update=changes), "goals": {}})


def _with_all_sight(plan: Plan) -> Plan:
    """The plan without lamps, with cameras that need no other, no focus, and no own thresholds."""
    if not plan.has_cameras:
        return plan
    for each in hooks_of(PlanFeature):
        plan = each.add_choice(plan, None)
    rig, other = plan.rig, plan.model_copy()
    other._mounts = replace(plan.mounts, rig=all_sight(rig)._with(equipment=rig.equipment))
    return other


def all_sight(rig: Rig) -> Rig:
    """The cameras alone, each without focus and thresholds of its own."""
    cameras = [each._without_focus() for each in rig.cameras]
    return Rig(cameras, rig.names, rig.rig_from_camera, fixed=rig.fixed)


def keep_scored(mesh: Mesh, names: Collection[str], *, is_most: bool = False) -> Mesh:
    """The mesh with some groups evaluated; others occlude, but targets among them are omitted.

    What must not be seen, `is_most`, counts from either side, however it is wound.
    """
    own, groups = set(names), mesh.groups
    is_gone = np.array([group.is_target and group.name not in own for group in groups])
    kept = ~is_gone[mesh.face_group]
    if not kept.all():
        mesh = replace(
            mesh,
            faces=mesh.faces[kept],
            face_group=mesh.face_group[kept],
            source_face=mesh.source_face[kept],
        )
    return mesh._with_flags(
        tuple(
            group._flagged(
                {
                    "is_occluder": group.name not in own,
                    "is_target": group.is_target and group.name in own,
                    "is_two_sided": group.name in own if is_most else group.is_two_sided,
                }
            )
            for group in groups
        )
    )


def measure_rig(
    plan: Plan,
    mesh: Mesh,
    rig: Poses,
    views: int | None,
    step: Callable[[str], AbstractContextManager[Progress]],
    kept: Kept | None = None,
) -> Measured:
    """The cameras of a plan in a scene, with their exact area where the plan counts that.

    With `kept` by way of shards; `PartMadeError` where this process makes some of them.
    """
    phases, most = phases_of(plan, mesh), plan.build_task(most_views(plan, views))
    wanted = Wanted(plan.engine, phases is None and plan.unit_of_result()[0] == "area")
    counted = counting(plan.task) | ({"views": views} if views else {})
    with step("coverage") as progress, open_for(mesh, plan.rig, most, wanted) as observer:
        objective = Objective.of(observer, plan.build_task(views), **counted)
        placed = renumber(rig)
        areas = RigAreas(plan, mesh, placed, views) if wanted.by_area else None
        parts = parts_of(observer, placed, most)
        if kept and phases is None and len(placed):
            shards = RigShards(kept.folder, observer, placed, most, wanted)
            parts, progress = shards.parts(replace(kept.staff, progress=progress)), silent

        def each() -> Iterator[RigPart]:
            for part in parts:
                if part.regions is not None and areas is not None:
                    areas.add(part.regions, part.poses)
                    if not kept and isinstance(observer, RegionObserver):
                        observer.closed = areas.closed  # shards do not depend on one another
                yield part

        cameras = measure_network(objective, placed, progress, each())
    if areas is not None:
        return areas.of(cameras)
    if phases is None:
        return cameras
    with step("area"):
        over = phases.areas(plan.rig, cameras.placed, plan.build_task(views), kept=kept)
        return replace(cameras, areas=over)


def mounts_of(plan: Plan) -> Mounts | None:
    """Rigs of a plan whose candidates are places of them."""
    return plan.mounts if plan.chooses_cameras else None


def _finder_of(plan: Plan, mesh: Mesh, views: int | None = None) -> RegionPass:
    """Pass over the regions of a plan in a scene; to be closed."""
    most = plan.build_task(most_views(plan, views))
    return RegionPass(mesh, plan.rig, most, method=plan.task.method)


@frozen_record
class AlikeGoals:
    """Goals of one kind, whose groups are evaluated together: a pose is measured once for all."""

    goals: Sequence[OwnGoal]

    @classmethod
    def of(cls, goals: Sequence[OwnGoal]) -> list["AlikeGoals"]:
        """Goals by their kinds."""
        by_kind: dict[tuple[object, ...], list[OwnGoal]] = {}
        for each in goals:
            by_kind.setdefault(each.kind, []).append(each)
        return [cls(some) for some in by_kind.values()]

    @property
    def plan(self) -> Plan:
        """Plan of the first, whose thresholds all of them have."""
        return self.goals[0].plan

    @cached_property
    def mesh(self) -> Mesh:
        """The scene, in which the groups of all of them are evaluated."""
        first = self.goals[0]
        if len(self.goals) == 1:
            return first.mesh
        scored = {name for each in self.goals for name in each.scored}
        return keep_scored(first.scene, scored, is_most=first.is_most)

    def step(
        self, step: Callable[[str], AbstractContextManager[Progress]]
    ) -> AbstractContextManager[Progress]:
        """A step that names them."""
        names = first_of([goal.name for goal in self.goals], 3)
        return step(f"{'goal' if len(self.goals) == 1 else 'goals'} {names}")

    @cached_property
    def rows(self) -> Rows:
        """Groups of each goal by their rows."""
        row_of = {group.name: row for row, group in enumerate(self.mesh.groups)}
        return {each.name: sorted(row_of[name] for name in each.scored) for each in self.goals}

    @property
    def own_faces(self) -> Iterator[tuple[str, BoolArray]]:
        """Each goal by its name, with the (F,) mask of the faces in it."""
        for name, rows in self.rows.items():
            yield name, np.isin(self.mesh.face_group, rows)

    @property
    def whole_weights(self) -> Iterator[tuple[str, IntArray]]:
        """Each goal by its name, with the (F,) integer weights of faces in it."""
        weights = weights_of(self.mesh, self.plan.task.weight_by)
        for name, is_own in self.own_faces:
            yield name, in_whole_numbers(np.where(is_own, weights, 0.0))

    def requirements(
        self,
        placed: Poses,
        step: Callable[[str], AbstractContextManager[Progress]],
        kept: Kept | None = None,
    ) -> dict[str, Requirement]:
        """Requirement of each goal by its name, by cameras in their places."""
        plan, mesh = self.plan, self.mesh
        cameras = measure_rig(plan, mesh, placed, None, step, kept)
        rows = self.rows
        limits: dict[str | None, float] = {each.name: each.limit for each in self.goals}
        seeable = seeable_areas(plan, cameras.network, cameras.areas)
        found: list[Requirement] = []
        if cameras.areas is not None:
            found += classify_areas(
                cameras.areas, limits, plan.task.views, rows=rows, seeable=seeable
            )
        else:
            masks = cameras.covered, cameras.certain, cameras.possible
            for name, weights in self.whole_weights:
                limit: dict[str | None, float] = {name: limits[name]}
                found += classify_network(mesh, weights, limit, *masks, rows=rows)
        whole: ByName = {"group": None, "n_groups": len(mesh.groups)}
        pairs = zip(self.goals, found, strict=True)
        return {goal.name: goal.requirement_of(replace(each, **whole)) for goal, each in pairs}

    def permits(self, shares: Mapping[str, float], camera: Cameras, poses: Poses) -> bool:
        """True where some cameras cover together at most a share of the area of each goal."""
        mesh = self.mesh
        with closing(RegionPass(mesh, camera, self.plan.build_task())) as finder:
            regions = finder.find(poses)
        most = np.bincount(regions.pair_face, regions.area + regions.bound, mesh.n_faces)
        return all(
            most[is_own].sum() / mesh.areas[is_own].sum() <= shares[name] + SHARE_TOLERANCE
            for name, is_own in self.own_faces
        )

    def most_shares(self, placed: Poses, progress: Progress) -> dict[str, FloatArray]:
        """(C,) share of each goal's area, or faces, that each candidate may cover, its bound in it.

        Of a rig, that of its cameras together at most.
        """
        plan, mesh = self.plan, self.mesh
        with open_objectives(plan, mesh, None) as opened:
            faces = opened.faces
            if not self.goals[0].is_by_area:
                covers = faces.covers(placed).reshape(len(placed), faces.width, mesh.n_faces)
                covered = np.asarray(covers.any(axis=1))
                own = [(name, replace(faces, integer_weights=w)) for name, w in self.whole_weights]
                return {name: each.share(each.worth(covered)) for name, each in own}
            cameras, owner = faces.cameras(placed)
            rows = owner if faces.mounts is None else faces.mounts.rows(cameras, owner)
            most, done = {name: np.zeros(len(rows)) for name in self.rows}, 0
            with closing(_finder_of(plan, mesh)) as finder:
                for regions in finder.batches(cameras):
                    own_most, pose = regions.area + regions.bound, done + regions.pair_pose
                    for name, is_own in self.own_faces:
                        its = is_own[regions.pair_face]
                        np.add.at(most[name], pose[its], own_most[its])
                    done += len(regions.pose_ids)
                    progress(done, len(rows))
        return {
            name: np.bincount(rows, most[name], len(placed)) / mesh.areas[is_own].sum()
            for name, is_own in self.own_faces
        }


def requirements_of(
    goals: Sequence[OwnGoal],
    placed: Poses,
    step: Callable[[str], AbstractContextManager[Progress]],
    kept: Kept | None = None,
) -> dict[str, Requirement]:
    """Requirement of each goal by its name, by cameras in their places, once for each kind."""
    found: dict[str, Requirement] = {}
    for alike in AlikeGoals.of(goals):
        found |= alike.requirements(placed, step, kept)
    return {goal.name: found[goal.name] for goal in goals}


@frozen_record
class Objectives:
    """Objectives of a network, open: by face, and on cells where the result is by area.

    Attributes
    ----------
    goals : sequence of OpenGoal
    """

    faces: Objective
    cells: CellObjective | None = None
    goals: Sequence["OpenGoal"] = ()

    @property
    def chosen(self) -> Objective:
        """The one by which cameras are chosen."""
        return self.faces if self.cells is None else self.cells

    @cached_property
    def moved(self) -> Objective:
        """The one by which cameras are moved: with goals, each counts as much as the task."""
        if not self.goals:
            return self.chosen
        parts = [(self.chosen, 1)]
        for each in self.goals:
            own = each.of.chosen
            if each.goal.is_most:  # any part of a cell
                own = replace(own, task=replace(own.task, min_coverage=LEAST_SHARE))
            parts.append((own, -WORSE if each.goal.is_most else 1))
        return TogetherObjective.together(parts)


@contextmanager
def open_objectives(
    plan: Plan, mesh: Mesh, on: Cells | None, goals: Sequence[OwnGoal] = ()
) -> Iterator[Objectives]:
    """Objectives of networks of a plan, on cells where there are some, and of its goals."""
    with ExitStack() as opened:
        observer = opened.enter_context(observer_of(plan, mesh))
        own: ByName = counting(plan.task)
        own["mounts"] = mounts_of(plan)
        faces = Objective.of(observer, plan.build_task(), **own)
        on_cells: CellObjective | None = None
        if on is not None:
            finder = opened.enter_context(closing(_finder_of(plan, mesh)))
            on_cells = CellObjective.of_cells(observer, finder, on, **own)
        yield Objectives(faces, on_cells, [OpenGoal(each, len(goals), opened) for each in goals])


@frozen_record
class OpenGoal:
    """A goal of several with its objectives, which are open as long as those of the task."""

    goal: OwnGoal
    n_goals: int
    opened: ExitStack

    @cached_property
    def cells(self) -> Cells | None:
        """Patches of the goal; None by face."""
        if not self.goal.is_by_area:
            return None
        return cells(self.goal.mesh, usual_size(self.goal.mesh, self.n_goals))

    @cached_property
    def of(self) -> Objectives:
        """The objectives, opened when they are asked for."""
        goal = self.goal
        return self.opened.enter_context(open_objectives(goal.plan, goal.mesh, self.cells))


@frozen_record
class WithGoals:
    """A problem of the task and of goals together.

    Attributes
    ----------
    problem : Problem
        Elements of the task, and after them those of each goal to cover. Candidates that cover more
        than a goal permits cover nothing.
    wanted : Goal
        Of the parts `OF_TASK` and `OF_GOALS` of the elements, where there are goals to cover.
    shares : dict of str to (C,) float64
        Share that each candidate may cover of what a goal permits up to a limit, by its name.
    barred : (N,) int64
        Candidates that cover more than a goal permits.
    notes : tuple of str
    """

    problem: Problem
    wanted: Goal
    shares: dict[str, FloatArray]
    barred: IntArray
    notes: tuple[str, ...]


def with_goals(
    problem: Problem,
    wanted: Goal,
    goals: Sequence[OpenGoal],
    placed: Poses,
    given: Sequence[int],
    step: Callable[[str], AbstractContextManager[Progress]],
) -> WithGoals:
    """A problem of candidates in their places with goals; the first, `given` by rows, stay.

    Raises
    ------
    ConfigError
        Where the views of the cameras of a rig count in one of both alone.
    """
    notes: list[str] = []
    shares: dict[str, FloatArray] = {}
    parts: list[tuple[str, float, Problem]] = []
    barred = np.zeros(len(placed), bool)
    to_cover = problems_of([each for each in goals if not each.goal.is_most], placed, step)
    for alike in AlikeGoals.of([each.goal for each in goals if each.goal.is_most]):
        with alike.step(step) as progress:
            shares |= alike.most_shares(placed, progress)
    for each in goals:
        goal = each.goal
        if not goal.is_most:
            parts.append((goal.name, goal.limit, to_cover[goal.name]))
            continue
        is_over = shares[goal.name] > goal.limit + SHARE_TOLERANCE
        own = [f"{row}" for row, is_one in zip(given, is_over, strict=False) if is_one]
        if own:
            covers = f"kept: existing {', '.join(own)} (from 0) {verb(len(own), 'cover')} more of"
            notes.append(f"{covers} goal {goal.name} than it permits, for any selection")
        is_over[: len(given)] = False
        if n := int(is_over.sum()):
            left_out = f"{plural(n, 'candidate', 'are')} left out"
            notes.append(f"{left_out}: each covers more of goal {goal.name} than it permits")
        barred |= is_over
    rows = np.flatnonzero(barred)
    problem = without_candidates(problem, rows)
    if parts:
        assert isinstance(wanted, FewestCameras)
        problem = _stack_goals(
            problem, [(name, without_candidates(p, rows)) for name, _, p in parts]
        )
        shares_of = {f"{OF_TASK}/{name}": share for name, share in wanted.groups.items()}
        shares_of |= {OF_TASK: wanted.coverage} if wanted.coverage else {}
        shares_of |= {f"{OF_GOALS}/{name}": limit for name, limit, _ in parts}
        wanted = replace(wanted, coverage=0.0, groups=shares_of)
    return WithGoals(problem, wanted, shares, rows, tuple(notes))


def problems_of(
    goals: Sequence[OpenGoal],
    placed: Poses,
    step: Callable[[str], AbstractContextManager[Progress]],
) -> dict[str, Problem]:
    """Problem of choosing candidates for each goal alone by its name, by arguments of `with_goals`.

    On patches, each candidate is measured once for all goals of a kind.
    """
    opened, found = {each.goal.name: each for each in goals}, dict[str, Problem]()
    for alike in AlikeGoals.of([each.goal for each in goals]):
        plan, mesh = alike.plan, alike.mesh
        own = [opened[goal.name] for goal in alike.goals]
        counted: ByName = {"mounts": mounts_of(plan)} | counting(plan.task)
        on = [each.cells for each in own if each.cells is not None]
        with alike.step(step) as progress, observer_of(plan, mesh) as observer:
            if not on:
                task = plan.build_task()
                matrix = build_matrix(
                    observer, placed, task, mounts=counted["mounts"], progress=progress
                )
                for each in own:
                    found[each.goal.name] = problem_of(matrix, each.goal.mesh, NOTHING, **counted)
                continue
            with closing(_finder_of(plan, mesh)) as finder:
                seen = matrices_of_cells(observer, finder, placed, on, counted["mounts"], progress)
            for each, matrix, patches in zip(own, seen, on, strict=True):
                found[each.goal.name] = problem_of(matrix, patches, NOTHING, **counted)
    return found


def has_goals(problem: Problem) -> bool:
    """True where some elements are of goals to cover."""
    return any(name.startswith(f"{OF_GOALS}/") for name in problem.groups)


def place_of(requirement: Requirement, problem: Problem) -> str | None:
    """Group or part of the elements of a problem that a requirement is of; None for all."""
    if requirement.goal:
        return f"{OF_GOALS}/{requirement.goal}"
    if not has_goals(problem):
        return requirement.group
    return OF_TASK if requirement.group is None else f"{OF_TASK}/{requirement.group}"


def without_candidates(problem: Problem, candidates: IntArray) -> Problem:
    """A problem in which some candidates cover nothing."""
    if not len(candidates):
        return problem
    words = np.concatenate([np.asarray(part) for part in problem.bits.parts])
    for row in candidates:
        words[problem.rows[row] : problem.rows[row + 1]] = 0
    return replace(problem, bits=CoveredBits.of(words, problem.bits.n_faces))


def _stack_goals(problem: Problem, goals: Sequence[tuple[str, Problem]]) -> Problem:
    """One problem of the elements of several; those of each fill whole words of bits."""
    every = [problem, *(each for _, each in goals)]
    if len({each.bits.n_rows for each in every}) > 1:
        raise ConfigError(
            "expected the same views in the task and goals of rigs, got different ones; make "
            "them equal"
        )
    names = [f"{OF_TASK}/{name}" for name in problem.groups]
    rows: list[Int32Array] = [problem.face_group]
    for name, each in goals:
        rows.append(np.full(each.n_faces, len(names), np.int32))
        names.append(f"{OF_GOALS}/{name}")
    counts = [BITS * n_words(each.n_faces) for each in every]
    centroids = np.zeros((sum(counts), 3))
    for at, each in zip(np.cumsum([0, *counts]).tolist(), every, strict=False):
        if each.centroids is not None:
            centroids[at : at + each.n_faces] = each.centroids
    words = [np.concatenate([np.asarray(part) for part in each.bits.parts]) for each in every]
    views = np.concatenate([spread_out(each.views) for each in every])
    return replace(
        problem,
        bits=CoveredBits.of(np.concatenate(words, axis=1), sum(counts)),
        weights=np.concatenate([spread_out(each.weights, np.float64) for each in every]),
        views=np.maximum(views, 1),
        groups=tuple(names),
        face_group=np.concatenate([spread_out(each, np.int32) for each in rows]),
        centroids=centroids,
        goal=NOTHING,
    )
