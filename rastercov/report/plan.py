"""Report of `rastercov place`: poses, `plan.json`, the page, tables for a terminal.

poses.json   the cameras, as `rastercov evaluate --poses` reads them
plan.json    all figures and their provenance; all times are under "seconds"
flight.*     the flight to them, where the plan has one: for QGroundControl, KML, CSV
page.html    the same with pictures; page.pdf on paper, if asked for
view.html    the network to look around in and to change, without a server
matrix/      visibility matrix of the candidates, used again by later runs, even of a changed plan

All but the matrix replace earlier ones together, at the end or at Ctrl-C. Without earlier ones the
intermediate result of more than a second is saved before each step after the selection, and
`plan.json` names that step under "interrupted", which is still correct when the run is killed
in it.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import asdict, replace
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from time import monotonic
from types import MappingProxyType

import numpy as np
from rich.table import Table
from rich.text import Text

from rastercov.advice.headline import first_lines, other_lines
from rastercov.base import (
    ByName,
    decimals_of,
    first_of,
    hooks_of,
    percent,
    plural,
    write_bytes,
    write_json,
    write_text,
)
from rastercov.base.files import path_from
from rastercov.base.format import area, distance, verb
from rastercov.base.interrupts import hold_interrupts
from rastercov.core.area.feature import in_words
from rastercov.core.area.zones import ZONES
from rastercov.core.coverage.shards import name_cameras, provenance_of
from rastercov.core.raster.contract import RasterizerInfo
from rastercov.placement.plan.check import (
    explain_goals,
    lines_of_goals,
    reasons_of_goal,
    zone_of_goal,
)
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.goals import has_goals
from rastercov.placement.plan.network import OF, goal_lines, goal_of, summary_of, views_by_group
from rastercov.placement.plan.phases import carriers
from rastercov.placement.plan.prepare import Prepared, Step, quiet
from rastercov.placement.plan.run import Placement, Products, is_lowered, place
from rastercov.placement.plan.shortfall import entries_of, line_of
from rastercov.placement.select.problem import BestCoverage, FewestCameras
from rastercov.placement.uncovered import Sight
from rastercov.report.coverage import Options
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.printing import browser, write_page
from rastercov.report.tables import LITTLE, heading_and_tilt, source_of
from rastercov.shards import Staff, Workers

WORTH_SAVING = 1.0
"""Seconds of work from which on an intermediate result is saved: a save may take as long."""
MAX_ROWS = 30
"""Cameras that a table lists."""
STEP_FIGURES = {
    "search": ("method", "share", "evaluations", "generations", "seed"),
    "refinement": ("status", "share", "start_share", "moved", "evaluations", "trace"),
}
"""Figures of the steps that move cameras, as `plan.json` has them."""
STEP_WORDS = {"search": "searched", "refinement": "refined"}
PLACEMENT = ReportKind(
    "place",
    re.compile(
        rf"{'|'.join(name for each in carriers() for name in each.files)}|(poses|plan)\.json"
        r"|flight(_\d+)?\.(plan|kml|csv)|(page|view)\.html|page\.pdf"
    ),
    last="plan.json",
)


def run_into(
    plan: Plan,
    out: Path,
    step: Step = quiet,
    workers: Workers | None = None,
    *,
    pdf: bool = False,
    level: int | None = None,
) -> Placement:
    """Carry out a plan, and leave all its files in a folder.

    Parameters
    ----------
    plan : Plan
        With candidates and a selection.
    out : Path
        Folder, made when it is missing; for one run at a time.
    step : callable
    workers : Workers, optional
        As for `rastercov.placement.plan.run.place`.
    pdf : bool
        True for the page on paper, too.
    level : int, optional
        Of the parts in the table of the page, as of `rastercov.placement.parts.entries_at`.

    Raises
    ------
    PlanError
        As of `rastercov.placement.plan.run.place`.
    ConfigError
        When no candidate is left, and for a folder that cannot be used.
    """
    began = monotonic()
    is_shared = Staff(workers).part is not None
    with ReportFolder(out, PLACEMENT, is_shared=is_shared) as files:
        if pdf:
            browser()  # none fails before the work

        def save_unfinished(placement: Placement) -> None:
            """Save the result before the step `interrupted`, unless there is a whole report."""
            if not files.has_earlier and monotonic() - began >= WORTH_SAVING:
                with step("figures"):
                    save(placement, files)

        placed = place(plan, out, step, save_unfinished, workers)
        pages: Mapping[str, str] = {}
        if placed.interrupted:
            save(placed, files)  # at once: the process of a command ends within a second
        if plan.outputs.page or pdf:
            without_page = replace(placed, interrupted=placed.interrupted or "page")
            save_unfinished(without_page)
            try:
                with step("page") as progress:
                    from rastercov.report.placement import pages_of  # with the first page only

                    pages = pages_of(
                        placed, summary(placed), lines(placed, named=()), progress, level
                    )
            except KeyboardInterrupt:
                placed = without_page
        with step("figures"):
            save(placed, files, pages, pdf=pdf)
    return placed


def save(
    placement: Placement,
    folder: ReportFolder,
    pages: Mapping[str, str] = MappingProxyType({}),
    *,
    pdf: bool = False,
) -> None:
    """Replace the earlier report by poses, all figures, and the texts of pages by their names."""
    with hold_interrupts():
        write_json(folder.file("poses.json"), poses_of(placement))
        for name, text in placement.carried.files().items() if placement.carried else ():
            write_text(folder.file(name), text)
        for each in placement.products:
            for name, content in each.files().items():
                write_bytes(folder.file(name), content)
        for name, text in pages.items():
            write_page(folder, Path(name).stem, text, pdf=pdf and name == "page.html")
        plan = placement.prepared.plan
        at = {"folder": path_from(folder.path, plan.folder), "file": plan.name}
        told = summary(placement) | at
        if pages:
            from rastercov.report.placement import with_features

            told = with_features(placement, told)
        write_json(folder.file("plan.json"), told)
        folder.publish()


def poses_of(placement: Placement) -> ByName:
    """Content of the pose file: cameras, poses, and the camera and origin of each pose."""
    mounts, cameras = placement.prepared.mounts, placement.cameras
    is_chosen = placement.prepared.plan.chooses_cameras
    content: ByName = {
        "world_from_camera": cameras.poses,
        "origin": [placement.origin[row] for row in cameras.owner],
        **({"candidate": placement.chosen[cameras.owner]} if is_chosen else {}),
        **(placement.carried.to_json() if placement.carried else {}),
    }
    for word, choice in placement.choices.items():
        content[word] = choice.plan.rig.equipment[word].to_json()
    content["camera"] = [mounts.rig.names[index] for index in cameras.placed.camera]
    if (
        mounts.has_rigs and is_chosen
    ):  # number of the rig, or the lone camera, and the poses of these
        content["mount"] = cameras.owner
        content["mounts"] = [
            {"name": mounts.names[index], "world_from_mount": pose}
            for index, pose in zip(
                cameras.mounted.camera, cameras.mounted.world_from_camera, strict=True
            )
        ]
    return name_cameras(mounts.rig) | content


def summary(placement: Placement) -> ByName:
    """All figures of a placement, ready for JSON; reproducible except for "seconds"."""
    prepared, cameras = placement.prepared, placement.cameras
    plan, selection = prepared.plan, dict(placement.selection.summary())
    seconds: ByName = {"steps": placement.steps, "selection": selection.pop("seconds")}
    if workers := prepared.tally.to_json():
        seconds["workers"] = workers
    moved, took = _move_figures(placement)
    seconds |= took
    assert plan.selection is not None
    if prepared.cells is not None:
        selection["cells_covered"] = selection["faces_covered"]
    selection |= {"proved_on": placement.proved_on, "status_of": _status_of(placement)}
    opened = prepared.openings
    network = summary_of(plan, cameras)
    zones = {name: network.pop(name) for name in ZONES if name in network}
    if placement.withheld:
        more = map(entries_of, chain(placement.withheld, repeat([])))
        own = zip(zones["dead_zones"], more, strict=False)
        zones["dead_zones"] = [zone | entry for zone, entry in own]
    return {
        "plan": plan.model_dump(),
        "met": placement.is_met if placement.requirements else None,
        "interrupted": placement.interrupted or None,
        "notes": [*prepared.notes, *(note for each in placement.products for note in each.notes)],
        "warnings": prepared.mesh.warnings,
        "result_warnings": placement.doubts,
        "doubts": placement.doubts,
        "size_m": np.ptp(prepared.mesh.bounds, axis=0),
        "requirements": [asdict(each) for each in placement.requirements],
        "goals": explain_goals(placement.requirements, placement.goals),
        "best_change": placement.best_change and placement.best_change._asdict(),
        "share": cameras.share,
        **{name: network[name] for name in ("covered_area",) if name in network},
        **_certified(placement),
        **zones,
        "network": network,
        "cameras": _cameras(placement),
        **{e.key: placement.carried and placement.carried.to_json() for e in carriers()},
        **dict.fromkeys(each.word for each in hooks_of(Products) if each.word),
        **{word: choice.summary() for word, choice in placement.choices.items()},
        **{each.word: each.summary() for each in placement.products},
        "candidates": prepared.pool.summary()
        | {"segments": prepared.segmentation.n_segments if prepared.segmentation else None},
        "cavities": opened.summary() if opened is not None else None,
        "matrix": _matrix(prepared),
        "quarantined": {str(pose): end for pose, end in prepared.quarantined.items()},
        "goal": asdict(prepared.problem.goal),
        "selection": selection,
        "improvement": moved,
        **dict.fromkeys(name for each in hooks_of(Products) for name, *_ in each.steps),
        **{name: each.summary() for name, each in placement.made.items()},
        "left": placement.leftover.summary() if placement.leftover else None,
        "seed": plan.selection.seed,
        "made_from": origin_of(prepared),
        "seconds": seconds,
    }


def _certified(placement: Placement) -> ByName:
    """Exact covered area of cameras that were chosen by samples, if any."""
    if placement.certified is None:
        return {}
    of = views_by_group(placement.prepared.plan, None)
    return {"certified_area": placement.certified.summary(of)}


def _matrix(prepared: Prepared) -> ByName:
    """Size of the matrix of candidates, and its cells."""
    pairs: ByName = {
        "poses": len(prepared.pool.candidates),
        "pairs": prepared.pairs,
        "held_as": "bits" if prepared.is_of_bits else "lists",
    }
    if (cells := prepared.cells) is None:
        return pairs
    least = prepared.task.min_coverage
    return pairs | {"cells": len(cells), "cell_m": cells.size, "least_share": least}


def _move_figures(placement: Placement) -> tuple[ByName, dict[str, float]]:
    """Figures of search and refinement, where they ran, and their seconds."""
    moved: ByName = {}
    seconds: dict[str, float] = {}
    steps = {"search": placement.optimised, "refinement": placement.refined}
    for step, result in steps.items():
        if result is None:
            continue
        seconds[step] = result.seconds
        moved[step] = {name: getattr(result, name) for name in STEP_FIGURES[step]}
        if step == "refinement":
            moved[step]["left_out"] = list(placement.left_out)
        if placement.prepared.cells is not None:
            moved[step]["taken"] = STEP_WORDS[step] not in placement.kept_poses
    return moved, seconds


def origin_of(prepared: Prepared) -> ByName:
    """Inputs with their hashes, device and versions."""
    plan, poses = prepared.plan, prepared.pool.candidates.poses
    options = Options(method=plan.task.method, supersample=plan.task.supersample, pictures=0)
    return provenance_of(
        prepared.mesh,
        prepared.camera,
        poses,
        prepared.task,
        options.record(),
        RasterizerInfo(**prepared.measured_by),
        ("rastercov", "moderngl", "numpy", "pydantic", "highspy"),
    )


def _cameras(placement: Placement) -> list[ByName]:
    """Position, direction, cost and coverage of each camera, and the share covered so far."""
    cameras, mounts = placement.cameras, placement.prepared.mounts
    costs, items = placement.prepared.pool.costs, []
    for row, pose in enumerate(cameras.poses):
        owner = int(cameras.owner[row])
        entry: ByName = {"origin": placement.origin[owner]}
        if placement.prepared.plan.chooses_cameras:
            candidate = int(placement.chosen[owner])
            entry |= {"candidate": candidate, "cost": costs[candidate]}
        entry |= {"position": pose[:3, 3], "direction": pose[:3, 2]}
        if len(mounts.rig) > 1:
            entry["camera"] = mounts.rig.names[cameras.placed.camera[row]]
        if mounts.has_rigs:
            entry["mount"] = owner
        entry["heading_deg"], entry["down_deg"] = heading_and_tilt(pose)
        entry["covered_faces"] = cameras.network.covered_faces[row]
        items.append(entry | {"share_so_far": cameras.curve[row]})
    return items


def cameras_table(placement: Placement) -> Table:
    """The cameras or heads for a terminal of 80 columns, the largest gain first."""
    noun, entries = placement.prepared.noun, _cameras(placement)
    if noun == "head":
        shares = {each["mount"]: each["share_so_far"] for each in entries}
        first = {each["mount"]: each for each in reversed(entries)}
        entries = [first[row] | {"share_so_far": share} for row, share in shares.items()]
    table = Table(title="Heads" if noun == "head" else "Cameras", title_justify="left")
    table.add_column("", justify="right", style="dim")
    several = len(placement.prepared.camera) > 1
    table.add_column("camera" if several else "source", overflow="fold")
    for name in ("position, m", "direction", "adds", "total"):
        table.add_column(name, justify="right", no_wrap=True)
    before, poses = 0.0, placement.cameras.poses
    # Three digits for the coordinate that is furthest from 0, or of the scene where it is far off.
    far = float(np.abs(poses[:, :3, 3]).max(initial=1e-9))
    digits = decimals_of(min(far, placement.cameras.network.mesh.diagonal))
    for row, entry in enumerate(entries):
        share, name = entry["share_so_far"], entry.get("camera", "")
        name = name.rpartition("/")[0] or name if noun == "head" else name
        if row < MAX_ROWS:
            table.add_row(
                str(row + 1),
                Text(name if several else source_of(entry["origin"])),
                " ".join(f"{value:.{digits}f}" for value in entry["position"]),
                " ".join(f"{value:.2f}" for value in entry["direction"]),
                percent(share - before) if share > before else "0 %",
                percent(share),
            )
        before = share
    if len(entries) > MAX_ROWS:
        table.add_row("", f"... {len(entries) - MAX_ROWS} more")
    return table


def head_lines(placement: Placement, level: int | None = None) -> list[str]:
    """Up to four lines: covered area, best change, goal, and worst dead zone.

    `level` is that of the parts that are named.
    """
    prepared, cameras = placement.prepared, placement.cameras
    goal = goal_lines(placement.requirements)[0]
    asked = goal_of(prepared.selection) if prepared.plan.chooses_cameras else None
    if prepared.selection.goal == "all":
        goal = "goal: all candidates"
    elif not goal and isinstance(asked, BestCoverage):
        most = []
        if asked.cameras is not None:
            what = f"{'more ' * (prepared.plan.n_given > 0)}{prepared.noun}"
            most.append(f"at most {plural(asked.cameras, what)}")
        if asked.budget is not None:
            most.append(f"a cost of at most {asked.budget:g}")
        goal = f"goal: best coverage with {' and '.join(most)}"
    zone = zone_of_goal(placement.requirements, placement.goals, level)
    own = summary_of(prepared.plan, cameras)
    return first_lines(own, goal, level, zone, placement.best_change)


def lines(
    placement: Placement, level: int | None = None, *, named: Collection[int] = (0,)
) -> list[str]:
    """Sentences about a placement that neither `head_lines` nor a table has.

    Rows of dead zones `named` before are left out.
    """
    prepared, selection = placement.prepared, placement.selection
    what = prepared.noun
    of_goals, goals = placement.requirements, placement.goals
    reasons = partial(reasons_of_goal, goals=goals, level=level)
    said = lines_of_goals(of_goals, reasons, head_lines(placement, level))
    named = () if zone_of_goal(of_goals, goals) else named
    if prepared.plan.chooses_cameras:
        said += [*prepared.pool.lines(), *prepared.notes, *_cell_questions(prepared)]
        said.append(_selection_note(placement))
    for choice in placement.choices.values():
        said += choice.lines()
    of = _of(prepared)
    if placement.optimised is not None:
        said.append(f"search over free poses: {percent(placement.optimised.share)} of {of}")
    if placement.refined is not None and len(placement.refined.poses):
        done = placement.refined
        moved = f"refinement moved {int(done.moved.sum())} of {plural(len(done.poses), what)}"
        shares = f": {percent(done.start_share)} -> {percent(done.share)} of {of}"
        said.append(f"{moved}{'' if prepared.plan.goals else shares} ({done.status})")
    for certified in _certified(placement).values():
        words = in_words(certified)
        said.append(f"sampled: {percent(placement.cameras.share)} of {of}; certified: {words}")
    if placement.left_out:
        left_out = plural(len(placement.left_out), what)
        why = "adding nothing after refinement" if placement.refined else "not needed for the goal"
        said.append(f"removed from the selection, as {why}: {left_out}")
    has_reasons = prepared.cells is not None
    network = summary_of(prepared.plan, placement.cameras)
    said += other_lines(network, level, has_reasons=has_reasons, said=named)
    for views, zone in zip(placement.withheld, network.get("dead_zones", ()), strict=False):
        said += line_of(views, f"dead zone of {area(zone['area_m2'])}")
    added = np.bincount(placement.cameras.owner, np.diff(placement.cameras.curve, prepend=0.0))
    few = [str(row + 1) for row in np.flatnonzero(added < LITTLE).tolist()]
    if few and prepared.plan.task.views == 1 and not prepared.plan.goals:
        noun = plural(len(few), what).partition(" ")[2]
        each = " each" if len(few) > 1 else ""
        said.append(
            f"{noun} {first_of(few)} {verb(len(few), 'add')} less than 1 % of the total{each}"
        )
    if placement.carried is not None:
        said.append(placement.carried.line())
    for product in placement.products:
        said += product.lines()
        said += filter(
            None, (each.sampling_text(prepared.mesh) for each in prepared.plan.candidates)
        )
    said += [
        f"the {how} poses were discarded: they cover less of the exact area or miss a goal"
        for how in placement.kept_poses
    ]
    for made in placement.made.values():
        said += made.lines()
    is_any = prepared.problem.reachable.any()
    if not placement.is_met and is_any and "stricter selection" in placement.steps:
        advice = ": lower a goal, add candidates, or reduce resolution_of_result"
        if "limits of goals" in placement.steps:
            advice = (
                ", but not every set of candidates within at_most was tried: raise it, lower "
                "another goal, or leave out candidates that cover much of what it limits"
            )
        said.append(f"further selections did not meet all goals either{advice}")
    if placement.interrupted:
        said.append(_interrupt_note(placement))
    elif selection.status == "time_limit":
        said.append("the integer program reached its time limit; more time may improve it")
    return said


def _interrupt_note(placement: Placement) -> str:
    """Words on the step that was interrupted, and on what there is of it."""
    step = placement.interrupted
    table = {"selection": True, "search": placement.optimised, "refinement": placement.refined}
    if table.get(step):
        return f"interrupted during {step}: best result so far"
    return f"interrupted before {step}: result so far"


def _cell_questions(prepared: Prepared) -> list[str]:
    """Line about a share to cover on cells that is more than that of the plan."""
    goal, wanted = prepared.problem.goal, goal_of(prepared.selection)
    if not isinstance(goal, FewestCameras) or not isinstance(wanted, FewestCameras):
        return []
    if has_goals(prepared.problem):  # it is of parts
        return []
    if goal.coverage == wanted.coverage or goal.of_reachable != wanted.of_reachable:
        return []
    of = OF[prepared.plan.task.weight_by]
    return [
        f"the selection targets {percent(goal.coverage)} of {of} on patches, so that the exact "
        f"area reaches the required {percent(wanted.coverage)}"
    ]


def _of(prepared: Prepared) -> str:
    """Words for the whole of a share on the elements of the selection."""
    of, cells = OF[prepared.plan.task.weight_by], prepared.cells
    of += " of task and goals" if has_goals(prepared.problem) else ""
    if cells is not None:
        of += f" on {len(cells):,} patches up to {distance(cells.size)} long"
    return of + prepared.of_mean


def _selection_note(placement: Placement) -> str:
    """Result of the selection and its distance from the best."""
    prepared, selection = placement.prepared, placement.selection
    of, has_costs = _of(prepared), (prepared.pool.costs != 1).any()
    text = f"{len(selection.chosen)} of {plural(len(prepared.pool.candidates), 'candidate')}"
    text += f" {verb(len(selection.chosen), 'cover')} {percent(selection.share)} of {of}"
    if prepared.cells is not None:
        least = 100 * prepared.task.min_coverage
        text += f" (a patch counts if a camera covers at least {least:g} % of it)"
    if has_costs:
        text += f" at a cost of {selection.cost:g}"
    if prepared.selection.goal == "all":
        return text
    if not selection.share > 0:
        what = "any face" if prepared.cells is None else "a patch (smaller: resolution_of_result)"
        return f"{text}: no candidate covers {what}"
    if placement.is_least:
        return f"{text}; no smaller set of candidates reaches the goal (proved for exact area)"
    on = "" if prepared.cells is None else " on patches"
    if selection.status == "optimal":
        return f"{text}: proved optimal{on}{on and ', not for exact area'}"
    if isinstance(prepared.problem.goal, BestCoverage):
        return f"{text}; upper bound for these candidates: {percent(selection.bound)}"
    what = "cost" if has_costs else f"number of {prepared.noun}s"
    return f"{text}; lower bound on the {what}: {selection.bound:g}{on}"


def _status_of(placement: Placement) -> str:
    """Words for what the status of the selection holds for."""
    prepared, goal = placement.prepared, placement.prepared.problem.goal
    if not prepared.plan.chooses_cameras:
        return "cameras that stay, without a choice"
    asked = goal_of(prepared.selection)
    if prepared.selection.goal == "all":
        return "all candidates, without a choice"
    if isinstance(asked, BestCoverage) or isinstance(goal, BestCoverage):
        return f"the best coverage{prepared.of_mean}, not the fewest cameras"
    what = "the least cost" if (prepared.pool.costs != 1).any() else "the fewest cameras"
    if is_lowered(prepared):
        share = percent(goal.coverage)
        reach = f"out of reach{prepared.of_mean}"
        return f"{what} for {share} of what the candidates can cover: the goal is {reach}"
    if has_goals(prepared.problem) or asked.groups:
        return f"{what} for the goals{prepared.of_mean}"
    share = percent(asked.coverage)
    of = OF[prepared.plan.task.weight_by] if placement.is_least else _of(prepared)
    return f"{what} for {share} of {of}{' that candidates can cover' * goal.of_reachable}"


def lines_of_uncovered(placement: Placement) -> list[str]:
    """Sentences about what the network leaves; by area, about what no candidate sees."""
    left, areas = placement.leftover, placement.cameras.areas
    if left is None:
        return []
    if areas is None:
        return left.lines()
    plan = placement.prepared.plan
    zones = areas.zones(plan.rig, placement.cameras.placed, views_by_group(plan, None))
    hidden = (left.sight == Sight.NONE) & (left.n_covering == 0) & left.left
    m2 = float(zones.piece_area[hidden[zones.face]].sum())
    line = f"{area(m2)} of the uncovered area is visible to none of the candidates (proved)"
    return [line] * (m2 > 0)
