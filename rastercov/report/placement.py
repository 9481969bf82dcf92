"""Pages of a placement: figures with two pictures, all inline, and one to look around in.

The tables are those of `plan.json`; the templates `report.html` and `placement.html` have their
headings and words.
"""

import re
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from rastercov.base import ByName, IntArray, ReadByName, percent
from rastercov.base.format import coordinates
from rastercov.core.area.remedies import Allowed
from rastercov.core.area.zones import ZONES
from rastercov.core.camera import heads_of, led_by
from rastercov.core.coverage.evaluation import regions
from rastercov.placement.candidates.cavities import Access
from rastercov.placement.candidates.rooms import KeepOutBox
from rastercov.placement.plan.check import Checked, worst_of
from rastercov.placement.plan.entries import Table
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.goals import separate_goals
from rastercov.placement.plan.network import limits_of, views_by_group
from rastercov.placement.plan.phases import CarriedPoses, Judged
from rastercov.placement.plan.run import Placement
from rastercov.placement.plan.scene import free_places, places_of
from rastercov.placement.required import FAILS, HOLDS
from rastercov.placement.select.problem import views_of
from rastercov.report.live import Asked, Goals
from rastercov.report.network_page import MOST_CLOSE_UPS, GoalPart, NetworkPage
from rastercov.report.overview import Volume
from rastercov.report.tables import source_of
from rastercov.shards import Progress

SPACES, KEEP_OUT = (26, 127, 55), (196, 85, 0)
"""Colours of places of cameras, and of volumes without."""
ARM = (176, 183, 190), (128, 137, 146), (150, 100, 60)
"""Colours of links of an arm in turn, and of its tool."""
MOST_VOLUMES = 20
"""Of either kind that a picture has."""
REACH = re.compile(
    "out of reach|together reach|reach(ing|es)? the goal|for any selection|by any candidate|^rig "
)
"""In notes on goals that no candidates reach or that kept cameras fail, and on what would."""
MOST_WORK = 100_000_000
"""Pairs of candidate and element up to which it is known what one more camera adds."""
UNCHECKED = "motion between the stops of the arm is neither planned nor checked"


def pages_of(
    placement: Placement,
    summary: ReadByName,
    notes: Sequence[str],
    progress: Progress,
    level: int | None = None,
    *,
    has_view: bool | None = True,
) -> dict[str, str]:
    """Texts of `page.html` and `view.html`; the latter is left out for a large mesh.

    Parameters
    ----------
    placement : Placement
    summary : mapping
        Content of `plan.json`.
    notes : sequence of str
        Sentences for the top of the page.
    progress : callable
        Gets the pictures drawn and the pictures in all.
    level : int, optional
        Of the parts in their table.
    has_view : bool
        None for a page that no other file lies beside.
    """
    prepared, cameras, plan = placement.prepared, placement.cameras, placement.prepared.plan
    products = placement.products
    north = next((each.north for each in products if each.north is not None), None)
    shown = replace(network_of(placement, summary), level=level, north=north)
    drawn, leads = shown.draw(progress), led_by(plan.rig, cameras.placed)
    reach = filter(REACH.search, prepared.notes)
    refused = [text for each in products for text in each.refused]
    columns = {
        "source": [source_of(placement.origin[row]) for row in cameras.owner[leads]],
        "covered so far": [
            percent(cameras.curve[row]) for row in [*(leads[1:] - 1), -1][: len(leads)]
        ],
    }
    page = shown.page(
        "placement.html",
        drawn,
        answer=shown.answer,
        passed=False if refused else placement.is_met if placement.requirements else None,
        title_block=plan.sheet.words(plan=plan.name),
        lines=[
            *((text, FAILS) for text in refused),
            *change_of(placement),
            *verdicts(placement.requirements),
            *reach,
        ],
        placement=placement,
        one_more=_one_more(placement),
        log=notes,
        notes=[
            *(note for each in products for note in each.notes if note not in refused),
            *[UNCHECKED] * (placement.carried is not None),
            *summary["warnings"],
            *summary["result_warnings"],
        ],
        columns=columns,
        summary=summary,
        run=summary["made_from"],
        views=plan.task.views,
        has_view=has_view and shown.view is not None,
        openings=prepared.openings,
        reached=Access.REACHED,
        noun=prepared.noun,
        stops=placement.carried and _stops(placement.carried, shown, cameras.owner[leads]),
        turns=_turns(plan.table),
        choices={word: each.table() for word, each in placement.choices.items()},
        sections={name: each.section() for name, each in placement.made.items()},
        products=[
            (each.figure(), [line for line in each.lines() if line not in each.notes])
            for each in products
        ],
    )
    return {"page.html": page} | ({} if shown.view is None else {"view.html": shown.view})


def _one_more(placement: Placement) -> float | None:
    """Share that the best further candidate adds to the chosen ones; None where not known."""
    problem, chosen = placement.prepared.problem, placement.selection.chosen
    is_moved = placement.optimised is not None or placement.refined is not None
    if is_moved or problem.is_spread or problem.n_candidates * problem.n_faces > MOST_WORK:
        return None
    before, _ = problem.covered_by(chosen)
    best = 0.0
    for row in np.setdiff1d(np.arange(problem.n_candidates), chosen).tolist():
        views = before.copy()
        problem.add(row, views, problem.spread())
        best = max(best, problem.share((views >= problem.views) & (before < problem.views)))
    return best


def _stops(
    carried: CarriedPoses, shown: NetworkPage, owner: IntArray
) -> tuple[list[str], list[list[str]]]:
    """Table of stops, each by the cameras of the page that are there."""
    heads, rows = carried.table()
    names = ([shown.labels[at] for at in np.flatnonzero(owner == own)] for own in carried.order)
    made = [[", ".join(some), *row] for some, row in zip([["rest"], *names], rows, strict=True)]
    return [shown.noun, *heads], made


def _turns(table: Table | None) -> str:
    """Sentences on the sense of a turntable, and on the frame of cameras; "" without one."""
    if table is None:
        return ""
    return (
        f"At positive angles the turntable turns the part about ({coordinates(table.axis, 2)}), "
        f"through ({coordinates(table.centre, 3)}) m, counter-clockwise as seen from where this "
        "axis points. Positions and headings of cameras are in the frame of the part, as it lies "
        "at 0°."
    )


def with_features(placement: Placement | Checked, content: ReadByName) -> ByName:
    """The content of `plan.json` or `check.json` with the table of features."""
    rows = network_of(placement, content, has_parts=False).features
    return {**content, "features": list(map(asdict, rows))}


def change_of(placement: Placement | Checked) -> list[str]:
    """Line on the best change known of a goal that is not met, if any."""
    return [] if placement.best_change is None else [placement.best_change.line]


def verdicts(requirements: Sequence[Judged]) -> list[tuple[str, str | None]]:
    """Lines on requirements for `report.html`: what was wanted, and the status."""
    lines: list[tuple[str, str | None]] = [(each.words(), each.status) for each in requirements]
    return lines or [("no share of the area was required", None)]


def network_of(
    placement: Placement | Checked, content: ReadByName, *, has_parts: bool = True
) -> NetworkPage:
    """Page of the cameras that a plan has placed, or that a check was given.

    Parameters
    ----------
    placement : Placement or Checked
    content : mapping
        That of `plan.json` or `check.json`.
    has_parts : bool
        Measure what each of them covers, too, where the result is by area, which takes longest.
    """
    of, asked = (
        (placement, placement.asked_views)
        if isinstance(placement, Checked)
        else (placement.prepared, None)
    )
    plan, cameras, placed, areas = (
        of.plan,
        placement.cameras,
        placement.cameras.placed,
        placement.cameras.areas,
    )
    title = f"Camera placement: {plan.name}"
    if isinstance(placement, Checked):
        title = f"Check of {placement.poses_file.name} against {plan.name}"
    figures = {name: content[name] for name in ("covered_area", *ZONES) if name in content}
    parts = None
    if areas is not None and has_parts:
        scene = of.mesh, plan.rig, placed, of.task
        parts = areas.parts(partial(regions, *scene, method=plan.task.method))
    rows, shown, noun = heads_of(plan.rig, placed, placement.names)
    return NetworkPage(
        title,
        of.mesh,
        plan.rig,
        placed[rows],
        noun,
        shown,
        cameras.network,
        cameras.covered,
        views_of(of.mesh, asked or plan.task.views),
        content["network"] | figures,
        areas,
        None if areas is None else areas.zones(plan.rig, placed, views_by_group(plan, asked)),
        parts,
        cameras.covers[rows],
        of_faces={} if cameras.per_camera is None else cameras.per_camera.of_faces,
        serves_goals=bool(plan.goals),
        volumes=[*_volumes(plan), *_arm_of(placement, shown, cameras.owner[rows])],
        asked=Asked(
            plan.build_task(asked),
            plan.task.method,
            views_by_group(plan, asked),
            _limits(placement) if plan.task.weight_by == "area" else {},
            placed=(placed, placement.names),
            goals=Goals(of.scene, *separate_goals(plan, of.scene))
            if plan.goals and of.scene
            else None,
        ),
        allowed=Allowed(places_of(plan, of.mesh), free=partial(free_places, plan)),
        goals=_goal_parts(placement),
        required=[each for each in placement.requirements if each.goal not in placement.goals],
    )


def _goal_parts(placement: Placement | Checked) -> list[GoalPart]:
    """Goals of a plan for a page, those that lack most."""
    items = []
    of_goals = [each for each in placement.requirements if each.goal]
    for row, each in enumerate(worst_of(of_goals)):
        if (own := placement.goals.get(each.goal)) is None:
            continue
        told = own.summary() if not each.is_most else dict.fromkeys(ZONES, ())
        is_shown = row < MOST_CLOSE_UPS or (each.is_most and each.status != HOLDS)
        page = network_of(own, {"network": told}, has_parts=is_shown)
        # Of what must not be seen the area that each camera sees.
        areas = None if own.by_camera is None else own.by_camera[int(not each.is_most)]
        groups = own.groups
        if each.is_most:
            groups = tuple(group.at_most(each.goal, each.limit) for group in groups)
        said = each.goal, each.words(), each.status, each.is_most, own.explain(each)
        items.append(GoalPart(*said, page, areas, groups, is_shown))
    return items


def _limits(checked: Checked | Placement) -> dict[str | None, float]:
    """Shares that are required, of all (None) and of groups."""
    if isinstance(checked, Checked):
        return {each.group: each.limit for each in checked.requirements if not each.goal}
    return limits_of(checked.prepared.plan.selection)


def _arm_of(placement: Placement | Checked, names: Sequence[str], owner: IntArray) -> list[Volume]:
    """Arm that carries cameras with names, of their owners, at its first stop."""
    if not isinstance(placement, Placement) or (carried := placement.carried) is None:
        return []
    carrier, first = placement.prepared.carrier, carried.order[:1].tolist()
    if carrier is None or not first:
        return []
    name = names[int(np.flatnonzero(owner == first[0])[0])]
    words = f"arm at {name}", f"arm at {name}", "its tool"
    parts = carrier.parts(carried.joints[first[0]])
    return [
        Volume(word, colour, whole=True, body=mesh)
        for word, colour, mesh in zip(words, ARM, parts, strict=True)
        if mesh is not None
    ]


def _volumes(plan: Plan) -> list[Volume]:
    """Limits of the places of cameras in a plan."""
    limits = plan.constraints
    volumes = [
        Volume.box("mounting box", SPACES, np.array(each.low), np.array(each.high))
        for each in limits.spaces[:MOST_VOLUMES]
    ]
    for entry in limits.keep_out[:MOST_VOLUMES]:
        own, words = entry.volume(), f"keep-out: {entry.name}"
        if isinstance(own, KeepOutBox):
            volumes.append(Volume.box(words, KEEP_OUT, np.array(own.low), np.array(own.high)))
        else:
            volumes.append(Volume.sphere(words, KEEP_OUT, np.array(own.centre), own.radius))
    return volumes
