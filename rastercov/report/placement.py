"""Pages of a placement: figures with two pictures, all inline, and one to look around in.

The tables are those of `plan.json`; the templates `report.html` and `placement.html` have their
headings and words.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rastercov.base.format import percent
from rastercov.coverage.area.regions import regions
from rastercov.coverage.area.zones import ZONES
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.placement.candidates.cavities import Access, Openings
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.network import (
    FAILS,
    HOLDS,
    UNDECIDED,
    Measured,
    Requirement,
    views_by_group,
)
from rastercov.placement.plan.prepare import Progress
from rastercov.placement.plan.run import Placement
from rastercov.placement.select.problem import BestCoverage, views_of
from rastercov.report.network_page import NetworkPage

VERDICTS = {HOLDS: True, FAILS: False, UNDECIDED: None}
MAX_SENTENCES = 12
"""Faces out of reach that have a sentence of their own."""


def pages_of(
    placement: Placement, summary: Mapping[str, Any], notes: Sequence[str], progress: Progress
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
    """
    prepared, cameras, plan = placement.prepared, placement.cameras, placement.prepared.plan
    tolerance = placement.tolerance
    figures = summary["network"] | {
        name: summary[name] for name in ("covered_area", *ZONES) if name in summary
    }
    shown = network_page_of(
        f"Placement of cameras: {plan.name}", prepared.mesh, plan, cameras, prepared.task, figures,
        plan.task.views,
    )  # fmt: skip
    drawn = shown.drawn(progress)
    owner = cameras.owner
    columns = {
        "from": [placement.origin[row] for row in owner],
        "so far": [percent(share) for share in cameras.curve],
    }
    if tolerance is not None and tolerance.cameras:
        columns["covered without it"] = [percent(tolerance.cameras[row].without) for row in owner]
    page = shown.page(
        "placement.html",
        drawn,
        answer=shown.answer,
        passed=placement.is_met if placement.requirements else None,
        lines=verdicts(placement.requirements),
        log=notes,
        notes=(),
        columns=columns,
        summary=summary,
        run=summary["made_from"],
        files="plan.json",
        views=plan.task.views,
        has_view=shown.view is not None,
        is_best=isinstance(prepared.problem.goal, BestCoverage),
        mounts=[
            ", ".join(map(str, np.flatnonzero(owner == row))) for row in range(len(cameras.mounted))
        ],
        out_of_reach=_out_of_reach(prepared.openings),
    )
    return {"page.html": page} | ({} if shown.view is None else {"view.html": shown.view})


def _out_of_reach(found: Openings | None) -> list[str]:
    """Sentences on faces of cavities that no camera gets to see."""
    if found is None:
        return []
    shut = np.flatnonzero(found.access != Access.REACHED)
    sentences = [found.words(row) for row in shut[:MAX_SENTENCES].tolist()]
    more = len(shut) - MAX_SENTENCES
    return sentences + ([f"And {more:,} more."] if more > 0 else [])


def verdicts(requirements: Sequence[Requirement]) -> list[tuple[str, bool | None]]:
    """Lines on requirements for `report.html`: what was wanted, and whether it holds."""
    return [(each.words(), VERDICTS[each.status]) for each in requirements]


def network_page_of(
    title: str,
    mesh: Mesh,
    plan: Plan,
    cameras: Measured,
    task: Task,
    figures: Mapping[str, Any],
    views: int | Mapping[str, int],
    asked: int | None = None,
) -> NetworkPage:
    """Page of the cameras of a plan; `figures` of them all, `views` and `asked` as of `Checked`."""
    placed, areas, zones, parts = cameras.placed, cameras.areas, None, None
    if areas is not None:
        parts = regions(mesh, plan.rig, placed, task, method=plan.task.method)
        zones = areas.zones(views_by_group(plan, asked))
    return NetworkPage(
        title, mesh, plan.rig, placed, "camera", [str(row) for row in range(len(placed))],
        cameras.network, cameras.covered, views_of(mesh, views), figures, areas, zones, parts,
        cameras.covers,
    )  # fmt: skip
