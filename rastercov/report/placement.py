"""Pages of a placement: figures with two pictures, all inline, and one to look around in.

The tables are those of `plan.json`; the templates `report.html` and `placement.html` have their
headings and words.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

import numpy as np

from rastercov.base import ByName, IntArray, ReadByName, percent
from rastercov.core.area.remedies import Allowed
from rastercov.core.area.stages import SLIVER_REL
from rastercov.core.area.zones import ZONES
from rastercov.core.camera import heads_of, led_by
from rastercov.core.coverage.evaluation import regions
from rastercov.core.mesh.groups import body_of
from rastercov.placement.candidates.cavities import Access, Openings
from rastercov.placement.candidates.rooms import KeepOutBox
from rastercov.placement.parts import MOST_ROWS
from rastercov.placement.plan.check import MOST_GOALS, Checked, to_json
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.goals import separate_goals
from rastercov.placement.plan.network import limits_of, views_by_group
from rastercov.placement.plan.phases import CarriedPoses
from rastercov.placement.plan.product import Judged
from rastercov.placement.plan.run import Placement
from rastercov.placement.plan.scene import free_places, places_of
from rastercov.placement.required import HOLDS
from rastercov.placement.select.problem import views_of
from rastercov.report.live import Asked, Goals
from rastercov.report.network_page import GoalPart, NetworkPage
from rastercov.report.overview import Volume
from rastercov.report.tables import source_of
from rastercov.shards import Progress

SPACES, KEEP_OUT = (26, 127, 55), (196, 85, 0)
"""Colours of places of cameras, and of volumes without."""
ARM = (176, 183, 190), (128, 137, 146), (150, 100, 60)
"""Colours of links of an arm in turn, and of its tool."""
MOST_VOLUMES = 20
"""Of either kind that a picture has."""
MAX_SENTENCES = 12
"""Faces out of reach that have a sentence of their own."""


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
    shown = replace(network_of(placement, summary), level=level)
    drawn, leads = shown.draw(progress), led_by(plan.rig, cameras.placed)
    unmet = [note for note in prepared.notes if note.startswith("rig ") and not len(leads)]
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
        passed=placement.is_met if placement.requirements else None,
        title_block=plan.sheet.words(plan=plan.name),
        lines=[*change_of(placement), *verdicts(placement.requirements), *unmet],
        log=notes,
        notes=[*summary["warnings"], *summary["result_warnings"]],
        columns=columns,
        summary=summary,
        run=summary["made_from"],
        views=plan.task.views,
        has_view=has_view and shown.view is not None,
        out_of_reach=_out_of_reach(prepared.openings),
        hiders=_hiders(summary["left"]),
        noun=prepared.noun,
        stops=placement.carried and _stops(placement.carried, shown, cameras.owner[leads]),
        choices={word: each.table() for word, each in placement.choices.items()},
        sections={name: each.section() for name, each in placement.made.items()},
        products=[(each.figure(), each.lines()) for each in placement.products],
    )
    return {"page.html": page} | ({} if shown.view is None else {"view.html": shown.view})


def _stops(
    carried: CarriedPoses, shown: NetworkPage, owner: IntArray
) -> tuple[list[str], list[list[str]]]:
    """Table of stops, each by the cameras of the page that are there."""
    heads, rows = carried.table()
    names = ([shown.labels[at] for at in np.flatnonzero(owner == own)] for own in carried.order)
    made = [[", ".join(some), *row] for some, row in zip(names, rows, strict=True)]
    return [shown.noun, *heads], made


def _hiders(left: ReadByName | None) -> list[tuple[tuple[str, str], float]]:
    """Parts, what hides them, and the hidden area, m^2: `MOST_ROWS` at most, the largest."""
    values: dict[tuple[str, str], float] = defaultdict(float)
    for group in left["groups"] if left else ():
        for name, m2 in group["hidden_by"].items():
            values[body_of(group["name"]), body_of(name)] += m2
    least = SLIVER_REL * max(values.values(), default=0.0)
    ranked = sorted(values.items(), key=lambda each: -each[1])
    return [each for each in ranked[:MOST_ROWS] if each[1] > least]


def _out_of_reach(openings: Openings | None) -> list[str]:
    """Sentences on faces of cavities that no camera gets to see."""
    if openings is None:
        return []
    shut = np.flatnonzero(openings.access != Access.REACHED)
    sentences = [openings.words(row) for row in shut[:MAX_SENTENCES].tolist()]
    more = len(shut) - MAX_SENTENCES
    return sentences + ([f"And {more:,} more."] if more > 0 else [])


def with_features(placement: Placement | Checked, content: ReadByName) -> ByName:
    """The content of `plan.json` or `check.json` with the table of features."""
    rows = network_of(placement, content, has_parts=False).features
    return {**content, "features": list(map(asdict, rows))}


def change_of(placement: Placement | Checked) -> list[str]:
    """Line on the change that gains most of a goal that is not met, if any."""
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
    )


def _goal_parts(placement: Placement | Checked) -> list[GoalPart]:
    """Goals of a plan for a page, those that lack most."""
    items = []
    of_goals = [each for each in placement.requirements if each.goal]
    for each in sorted(of_goals, key=lambda each: -each.lack)[:MOST_GOALS]:
        if (own := placement.goals.get(each.goal)) is None:
            continue
        page = network_of(own, to_json(own), has_parts=each.is_most and each.status != HOLDS)
        # Of what must not be seen the area that each camera sees.
        areas = None if own.by_camera is None else own.by_camera[int(not each.is_most)]
        said = each.goal, each.words(), each.status, each.is_most, own.explain(each)
        items.append(GoalPart(*said, page, areas))
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
        if mesh.n_faces
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
