"""Choice of lamps for cameras whose poses are known, from candidates that name a lamp.

A set of lamps is worth the exact area that the cameras cover in its light and that of the lamps
that stay. Few sets are all tried. Otherwise sets to start from are chosen on cells, as cameras are,
where m candidates count together that give 1 / m of the least illuminance each: light adds up. Then
lamps are left out, added and exchanged while the exact area of all of them together gains.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from itertools import combinations, takewhile
from math import comb

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    frozen_record,
    plural,
    with_bound,
)
from rastercov.core.area.cells import Cells
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions, any_of, join, take_rows
from rastercov.core.camera import Poses, Rig
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.light.lamp_plan import PlanLamps, build_lamps, lamp_entries, plan_with_lamps
from rastercov.light.lamps import MOST_LAMPS, Lamps
from rastercov.light.regions import Light
from rastercov.placement.bits import CoveredBits
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.goals import open_objectives
from rastercov.placement.plan.network import (
    classify_areas,
    goal_of,
    limits_of,
    most_views,
    seeable_areas,
    views_by_group,
)
from rastercov.placement.plan.phases import Phase, PlanPhases, phases_of
from rastercov.placement.plan.prepare import Prepared, cells_of
from rastercov.placement.plan.run import (
    Choice,
    Placement,
    Products,
    Run,
    measure_by_face,
    own_steps,
    place_at,
)
from rastercov.placement.plan.scene import CandidatePool, candidate_pool
from rastercov.placement.plan.sections import CameraType, SelectionSection
from rastercov.placement.select.methods import select_by
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Problem,
    finish,
    views_of,
    weights_of,
)
from rastercov.placement.uncovered import CandidateBounds
from rastercov.shards import Progress

Rows = tuple[int, ...]
TURNS = 2
"""Times that cameras, and then lamps for these, are chosen."""
MOST_SETS = 64
"""Sets of lamps up to which all are tried."""
TOGETHER = (1, 2, 3)
"""Lamps that give the least illuminance together, in a start on cells."""
START_SHARE = 0.3
"""Share of the time limit after which no further start is made."""
FALLBACK_SHARE = 0.99
"""Share of what single candidates light to cover where a plan requires more."""
DIGITS = 9
"""Of shares and costs that are compared: unions in other orders differ by less."""


@frozen_record
class LampChoice(Choice):
    """Lamps chosen among candidates; the camera of a candidate is the row of its lamp.

    Of the lamps of the plan, it is among those that candidates name.

    Attributes
    ----------
    lamps : Lamps
        Those of the plan that stay, then the chosen ones.
    alone, together : dict
        Covered area where one of the chosen lamps at a time counts with those that stay, and where
        all do, as of `AreaNetwork.summary`.
    n_tried : int
        Sets of lamps whose exact area was found.
    is_best : bool
        True where these were all.
    """

    lamps: Lamps
    alone: ByName
    together: ByName
    n_tried: int
    is_best: bool

    def summary(self) -> ByName:
        """Chosen lamps and figures, ready for JSON."""
        pool, rows = self.pool.candidates, self.chosen
        columns: ByName = {
            "lamp": self.lamps.names[len(self.lamps) - len(rows) :],
            "candidate": rows,
            "from": pool.source[rows],
            "position": pool.poses[rows, :3, 3],
            "direction": pool.poses[rows, :3, 2],
            "cost": self.pool.costs[rows],
        }
        every = zip(*columns.values(), strict=True)
        return {
            "chosen": [dict(zip(columns, each, strict=True)) for each in every],
            "alone": self.alone,
            "together": self.together,
            "sets_tried": self.n_tried,
            "is_best": self.is_best,
            "candidates": self.pool.summary(),
        }

    def table(self) -> tuple[Sequence[str], list[list[str]]]:
        """See `Choice`."""
        lines = [
            [
                each["lamp"],
                str(each["from"]),
                " ".join(f"{x:.3g}" for x in each["position"]),
                " ".join(f"{x:.2f}" for x in each["direction"]),
                f"{each['cost']:g}",
            ]
            for each in self.summary()["chosen"]
        ]
        return ("lamp", "source", "position, m", "direction", "cost"), lines

    def lines(self) -> list[str]:
        """The choice in words."""
        items = [
            f"lamp {name} at ({', '.join(at.split())}) m, direction ({', '.join(towards.split())})"
            for name, _, at, towards, _ in self.table()[1]
        ]
        one, every = (
            with_bound(each["percent"], each["bound_percent"])
            for each in (self.alone, self.together)
        )
        return [
            f"{len(self.chosen)} of {plural(len(self.pool.candidates), 'candidate')} for lamps "
            f"(the best of {'all ' * self.is_best}{plural(self.n_tried, 'set')} tried): {every} of "
            f"the area is visible and lit with all lamps on, {one} by one of those chosen alone",
            *items,
        ]


class LampFrame:
    """Parts that cameras see at one time, and those that lamps light; each point is found once.

    Regions are on the mesh at rest.
    """

    def __init__(
        self,
        moment: Phase,
        rig: Rig,
        task: Task,
        method: str,
        lamps: Sequence[Lamps],
        bounds: FloatArray,
    ) -> None:
        mesh, placed, self._at_rest = moment
        self._rig, self._placed, self._bounds = rig, placed, bounds
        lamps = [each._around(bounds) for each in lamps]
        lamps[0]._check_around(mesh.bounds)
        self._kinds = list(dict.fromkeys(lamp for each in lamps for lamp in each.lamps))
        self._known: dict[bytes, int] = {}
        self._table: list[Regions] = []
        with closing(RegionPass(mesh, rig, task, method=method)) as cameras:
            self._seen = cameras.find(placed)
        eyes = [lamp.eye for lamp in self._kinds]
        with closing(RegionPass(mesh, eyes, method=method, only_task=True)) as self._finder:
            self._reach(
                np.concatenate([each.point_places for each in lamps]),
                [
                    self._kinds.index(lamp)
                    for each in lamps
                    for lamp in each.lamps
                    for _ in range(lamp.points)
                ],
            )
            self.regions(lamps[0], task)  # points on the rig, too

    def regions(self, lamps: Lamps | None, task: Task) -> Regions:
        """Rows of the result, in the light of lamps, or in any light."""
        light: tuple[Light, ...] = ()
        rig = self._rig._equip("lamps", lamps)
        if lamps is not None:
            lamps = lamps._around(self._bounds)
            kind = np.array([self._kinds.index(lamp) for lamp in lamps.lamps])

            def find(points: Poses) -> Regions:
                return self._reach(points.world_from_camera, kind[points.camera])

            light = (Light(lamps, task, self._rig, find),)
        return self._at_rest(with_rule(replace(self._seen, conditions=light), rig, self._placed))

    def _reach(self, places: FloatArray, kinds: Sequence[int] | IntArray) -> Regions:
        """Regions of points of lamps, which are known, or of the open pass."""
        keys = [place.tobytes() + bytes([kind]) for place, kind in zip(places, kinds, strict=True)]
        if new := {key: row for row, key in enumerate(keys) if key not in self._known}:
            rows = [*new.values()]
            result = self._finder.find(Poses.of(places[rows], camera=np.asarray(kinds)[rows]))
            self._table = [join([*self._table, result])]
            self._known |= {key: len(self._known) + row for row, key in enumerate(new)}
        return take_rows(self._table[0], np.array([self._known[key] for key in keys], np.int64))


class Lighting:
    """Lamp candidates of a plan before cameras whose poses are known.

    Parameters
    ----------
    plan : Plan
    mesh : Mesh
    cells : Cells
    placed : Poses
        Of the cameras of the plan.
    phases : PlanPhases or None
        Where the scene has several; lamps stay.
    reachable : AreaNetwork or None
        Area that shares of what can be reached are of; what the cameras see in any light unless
        given.
    """

    def __init__(
        self,
        plan: Plan,
        mesh: Mesh,
        cells: Cells,
        placed: Poses,
        phases: PlanPhases | None = None,
        reachable: AreaNetwork | None = None,
    ) -> None:
        every = build_lamps(plan, plan.folder)
        assert every is not None
        assert plan.selection is not None
        self.plan, self.mesh, self.cells, self.phases = plan, mesh, cells, phases
        self.selection: SelectionSection = plan.selection
        self.task, dark = plan.build_task(), plan_with_lamps(plan, None)
        every._check(vars(self.task))
        kinds = list(dict.fromkeys(str(entry.lamp) for entry in lamp_entries(plan)))
        self._every, self._kinds = every, [every.names.index(name) for name in kinds]
        self._stay = [row for row in range(len(every)) if row not in self._kinds]
        self.pool = _pool(plan, mesh, kinds, every)
        n = len(self.pool.candidates)
        if not n:
            raise ConfigError(
                f"{plan.name}: expected candidates for lamps, got none "
                f"({'; '.join(self.pool.lines())}); allow more, or add some"
            )
        self._camera, self._placed = dark.rig, placed
        single = [each for row in range(n) if (each := self.lamps((row,)))]
        own = dark.rig, dark.build_task(), plan.task.method, single, mesh.bounds
        moments: Iterable[Phase] = [Phase(mesh, placed, lambda result: result)]
        if phases is not None:
            moments = phases.each(dark.rig, placed)
        self._frames = [LampFrame(moment, *own) for moment in moments]
        self.limits = limits_of(self.selection)
        self.reachable, self._weights = None, weights_of(cells, plan.task.weight_by)
        if getattr(self.selection, "of_reachable", False):
            in_any_light = self.regions(None)
            self.reachable = reachable or self.areas(in_any_light)
            self._weights = self._weights * self._on_cells(in_any_light)
        self._worth: dict[Rows, tuple[float, ...]] = {}

    def lamps(self, rows: Rows) -> Lamps | None:
        """Lamps that stay, and those of some candidates; None for none."""
        every, own = self._every, self._of_plan(rows)
        if not own:
            return None
        numbers = [""] * len(self._stay) + [f" {row}" for row in rows]
        names = [every.names[row] + number for row, number in zip(own, numbers, strict=True)]
        stay, chosen = every.places[self._stay], self.pool.candidates.poses[list(rows)]
        return Lamps(
            [every.lamps[row] for row in own],
            np.concatenate([stay, chosen]),
            names,
            rides=[every.rides[row] for row in own],
            ambient=every.ambient,
            exposure=every.exposure,
        )

    def _of_plan(self, rows: Rows) -> list[int]:
        """Lamps of the plan that stay, and those of candidates."""
        return [*self._stay, *(self._kinds[self.pool.candidates.camera[row]] for row in rows)]

    def regions(self, lamps: Lamps | None, task: Task | None = None) -> Regions:
        """Rows of the result, of each phase of the scene, in the light of lamps, or in any."""
        return join([frame.regions(lamps, task or self.task) for frame in self._frames])

    def areas(self, regions: Regions) -> AreaNetwork:
        """Exact covered area, as of the network."""
        if self.phases is not None:
            return self.phases.areas(self._camera, self._placed, self.task, regions)
        areas = AreaNetwork(self.mesh, self.plan.build_task(most_views(self.plan)))
        for row in range(len(regions.pose_ids)):
            areas.add(take_rows(regions, np.array([row])))
        return areas

    def alone(self, rows: Rows) -> ByName:
        """Covered area where one of some lamps at a time counts, with those that stay."""
        each: list[Rows] = [(row,) for row in rows] or [()]
        parts = [self.regions(self.lamps(own)) for own in each]
        return self.figures(self.areas(any_of(parts, one_side=False)))

    def figures(self, areas: AreaNetwork) -> ByName:
        """Covered area, ready for JSON."""
        return areas.summary(views_by_group(self.plan, None))

    def worth(self, rows: Rows) -> tuple[float, ...]:
        """Rank of a set of lamps by their exact area together, see `DIGITS`.

        What the requirements lack, less than 0, then cost, then the share; or share, then cost.
        """
        if rows not in self._worth:
            lamps = self.lamps(rows)
            self._worth[rows] = self._rank(rows, None if lamps is None else self.regions(lamps))
        return self._worth[rows]

    def _rank(self, rows: Rows, regions: Regions | None) -> tuple[float, ...]:
        cost, share, lack = float(self.pool.costs[list(rows)].sum()), 0.0, sum(self.limits.values())
        if regions is not None:
            areas = self.areas(regions)
            share = self.figures(areas)["percent"] / 100
            wanted = self.limits, self.plan.task.views, self.reachable
            seeable = seeable_areas(self.plan, Network(areas.mesh, self.task), areas)
            lack = sum(e.lack for e in classify_areas(areas, *wanted, seeable=seeable))
        rank = (-lack, -cost, share) if self.limits else (share, -cost)
        return tuple(round(value, DIGITS) for value in rank)

    def is_allowed(self, rows: Rows) -> bool:
        """True for a set of lamps within the limits of their number, cost and points."""
        n_points = sum(self._every.lamps[row].points for row in self._of_plan(rows))
        cost, asked = float(self.pool.costs[list(rows)].sum()), self.selection
        budget, most = getattr(asked, "budget", None), getattr(asked, "lamps", None)
        return (
            1 <= n_points <= MOST_LAMPS
            and (most is None or len(rows) <= most)
            and (budget is None or cost <= budget + 10.0**-DIGITS)
        )

    def _on_cells(self, regions: Regions) -> BoolArray:
        """Cells that the network covers, by `task.min_coverage` of each."""
        on_cells = np.zeros(len(self.cells), bool)
        of_cells = self.cells.share(self._enough(regions))
        on_cells[of_cells.cell[of_cells.share >= self.task.min_coverage]] = True
        return on_cells

    def _enough(self, regions: Regions) -> Regions:
        """Parts that enough cameras cover, in enough phases; one row."""
        if self.phases is not None:
            return self.phases.long_enough(regions, self.task.views)
        needed, rows = views_of(self.mesh, self.plan.task.views), len(regions.pose_ids) * [0]
        parts = [
            regions._of_faces(needed == k).at_least(k, rows, one_side=False)
            for k in np.unique(needed).tolist()
        ]
        return any_of(parts, one_side=False)

    def problem(self, together: int) -> Problem:
        """Cells, and the candidates that light these enough, a number of them together."""
        n, least = len(self.pool.candidates), self.task.min_illuminance
        part = (least - self._every.ambient) / together + self._every.ambient
        task = replace(self.task, min_illuminance=min(part, least))
        covers, elements = np.zeros((n, len(self.cells)), bool), self.cells.elements
        for row in range(n):
            regions = self.regions(self.lamps((row,)), task)
            covers[row] = self._on_cells(regions)
            if together == 1:
                self._worth[(row,)] = self._rank((row,), regions)
        return Problem(
            bits=CoveredBits.from_dense(covers),
            weights=self._weights,
            costs=self.pool.costs,
            views=np.full(len(self.cells), together),
            goal=BestCoverage(cameras=0),
            groups=tuple(group.name for group in elements.groups),
            face_group=elements.face_group,
        )

    def _for_goal(self, problem: Problem) -> Problem:
        """The problem with the goal of the plan, or with the nearest one that can be reached.

        Weights are of what the cameras see where shares are of that.
        """
        goal = goal_of(self.selection, "lamps")
        if isinstance(goal, BestCoverage):
            return replace(problem, goal=goal)
        try:
            return replace(problem, goal=replace(goal, of_reachable=False))
        except ConfigError:
            return replace(problem, goal=FewestCameras(FALLBACK_SHARE, of_reachable=True))

    def _start(self, problem: Problem, seconds: float) -> Rows:
        """Lamps chosen on cells, as many as are allowed."""
        selection = select_by(self.selection, self._for_goal(problem), max(seconds, 1.0))
        chosen = selection.chosen.tolist()
        while chosen and not self.is_allowed(tuple(chosen)):
            chosen.pop()  # the last of greedy order
        return tuple(sorted(chosen))

    def exchange(self, best: Rows, until: float) -> Rows:
        """A set of lamps after changes of one lamp that gain, until none does or time is up."""
        while True:
            near = filter(self.is_allowed, self._near(best))
            in_time = takewhile(lambda _: time.perf_counter() < until, near)
            now = self.worth(best)
            gained = next((rows for rows in in_time if self.worth(rows) > now), None)
            if gained is None:
                return best
            best = gained

    def _near(self, rows: Rows) -> Iterator[Rows]:
        """Sets with a lamp less, one more, or another one."""
        own = set(rows)
        others = set(range(len(self.pool.candidates))) - own
        near = [own - {row} for row in rows]
        if not self.limits or self.worth(rows)[0] < 0:
            near += [own | {other} for other in others]
        near += [own - {row} | {other} for row in rows for other in others]
        return (tuple(sorted(each)) for each in near)

    def choose(self, progress: Progress) -> LampChoice:
        """The best lamps that are found within the time limit of the selection.

        ConfigError where no set of lamps lights anything that the cameras see.
        """
        n, began = len(self.pool.candidates), time.perf_counter()
        until = began + self.selection.time_limit
        most = min(getattr(self.selection, "lamps", None) or n, n)
        first = self.problem(1)
        is_best = sum(comb(n, k) for k in range(most + 1)) <= MOST_SETS
        if is_best:
            sets = (rows for k in range(most + 1) for rows in combinations(range(n), k))
            best = max(filter(self.is_allowed, sets), key=self.worth, default=())
        else:
            starts = [self._start(first, until - began), max(self._worth, key=self.worth)]
            for together in TOGETHER[1:]:
                if time.perf_counter() < began + START_SHARE * (until - began):
                    starts.append(self._start(self.problem(together), until - began))
                    progress(together, len(TOGETHER))
            allowed = filter(self.is_allowed, starts)
            best = self.exchange(max(allowed, key=self.worth, default=()), until)
        problem, is_fewest = self._for_goal(first), bool(self.limits)
        bound = (np.inf if is_best else 0.0) if is_fewest else (0.0 if is_best else 1.0)
        seconds = time.perf_counter() - began
        selection = finish("exchanges", problem, np.array(best, np.int64), bound, seconds)
        lamps = self.lamps(tuple(selection.chosen.tolist()))
        if lamps is None or not self.worth(best)[2 * is_fewest] > 0:
            raise ConfigError(
                f"{self.plan.name}: expected lamps that light what cameras see, got none of "
                f"{plural(n, 'candidate')}; relax thresholds of light, or add candidates"
            )
        both = self.alone(best), self.figures(self.areas(self.regions(lamps)))
        lit = plan_with_lamps(self.plan, self._camera._equip("lamps", lamps))
        items = lit, self.pool, problem, selection, lamps
        return LampChoice(*items, *both, n_tried=len(self._worth), is_best=is_best)


def place_lamps(
    job: Run, plan: Plan, eyes: Placement | Poses, reachable: AreaNetwork | None = None
) -> Placement:
    """Lamps chosen for cameras that are placed, or there, and these in the light of all."""
    cells, phases = cells_of(plan, job.mesh), phases_of(plan, job.mesh)
    selection = plan.selection
    assert selection is not None
    assert cells is not None  # light is by area
    placed = eyes if isinstance(eyes, Poses) else eyes.cameras.placed
    with job.clock("lamps") as progress:
        lighting = Lighting(plan, job.mesh, cells, placed, phases, reachable)
        choice = lighting.choose(progress)
    own = choice.plan
    changes: ByName = {
        "plan": own,
        "mounts": own.mounts,
        "task": own.build_task(),
        "reachable": lighting.reachable,
    }
    with open_objectives(own, job.mesh, cells) as objectives:
        if isinstance(eyes, Poses):
            prepared = Prepared(
                selection=selection,
                mesh=job.mesh,
                pool=choice.pool,
                segmentation=None,
                openings=None,
                bounds=CandidateBounds(job.mesh.n_faces, job.mesh.task_mask),
                pairs=choice.pairs,
                measured_by=asdict(objectives.faces.observer.info),
                problem=choice.problem,
                notes=(),
                cells=cells,
                phases=phases,
                **changes,
            )
            cameras, required = measure_by_face(prepared, placed, objectives)
            origin = tuple(f"existing {row}" for row in range(len(placed)))
            eyes = Placement(prepared, choice.selection, cameras, origin, required)
            eyes = replace(eyes, steps=job.clock.seconds)
        copy = replace(eyes, prepared=replace(eyes.prepared, **changes), choices={"lamps": choice})
        return place_at(copy, objectives, copy.cameras.mounted, copy.origin)


def _in_turns(job: Run, plan: Plan) -> Placement:
    """Cameras as if all were lit, and lamps for these; then both again, the former in their light.

    The better of the two; shares of what can be reached are of the same in both.
    """
    placement: Placement | None = None
    for _ in range(TURNS):
        choice = None if placement is None else placement.choices["lamps"]
        own = plan_with_lamps(plan, None) if choice is None else choice.plan
        eyes = job.cameras(own, own_steps())
        if eyes.interrupted:
            return eyes if placement is None else replace(placement, interrupted=eyes.interrupted)
        now = place_lamps(job, plan, eyes, (placement or eyes).prepared.reachable)
        placement = now if placement is None else max(placement, now, key=_rank)
    assert placement is not None
    return placement


def _rank(placement: Placement) -> tuple[float, float, float]:
    """Rank among placements of cameras and lamps: `worth`, and cost before share for a goal."""
    lack, share = placement.worth
    chosen = placement.choices.get("lamps")
    if chosen is None or not placement.requirements:
        return lack, 0.0, share
    cost = placement.prepared.pool.costs[placement.chosen].sum() + chosen.selection.cost
    return round(lack, 9), -float(cost), share


class LampParts(PlanLamps, Products):
    """Lamps beside cameras."""

    def choose(self, job: Run, plan: Plan, eyes: Poses | None) -> Placement:
        """See `Products`."""
        return _in_turns(job, plan) if eyes is None else place_lamps(job, plan, eyes)


HOOKS = LampParts()


def _pool(plan: Plan, mesh: Mesh, kinds: Sequence[str], every: Lamps) -> CandidatePool:
    """Places of lamps, each of which is the camera of its points."""
    own = [
        entry.model_copy(update={"lamp": None, "cameras": [entry.lamp]})
        for entry in lamp_entries(plan)
    ]
    priced = {name: CameraType.model_construct(cost=plan.lamps[name].cost) for name in kinds}
    changes: ByName = {"camera": None, "cameras": priced, "rigs": {}, "candidates": own}
    other = plan.model_copy(update=changes)
    own_lamps = {name: every.lamps[every.names.index(name)] for name in kinds}
    other._mounts = Mounts.of({name: lamp.eye for name, lamp in own_lamps.items()})
    return candidate_pool(other, mesh)
