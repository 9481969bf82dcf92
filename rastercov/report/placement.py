"""Pages of a placement: figures with two pictures, all inline, and one to look around in.

The tables are those of `plan.json`; the templates `report.html` and `placement.html` have their
headings and words.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from rastercov.base.format import percent, plural
from rastercov.coverage.area.regions import regions
from rastercov.coverage.network import share_of_faces
from rastercov.coverage.reasons import REASONS, reason_rows
from rastercov.placement.candidates.cavities import Access, Openings
from rastercov.placement.plan.prepare import Progress
from rastercov.placement.plan.run import Placement
from rastercov.placement.select.problem import BestCoverage, views_of
from rastercov.placement.uncovered import Leftover
from rastercov.report.modes import mode_picture
from rastercov.report.overview import Overview, best_covering, zone_rows, zones_picture
from rastercov.report.pages import Picture, figures_of, rendered, values_of, view_page, zone_entries
from rastercov.report.panorama import best_directions
from rastercov.report.tables import camera_rows

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
    mesh, network, placed, areas = prepared.mesh, cameras.network, cameras.placed, cameras.areas
    eyes = placed.world_from_camera[:, :3, 3]
    names = [str(row) for row in range(len(placed))]  # rows of poses.json, as everywhere else
    found = zones = None
    covers = cameras.covers * np.where(mesh.task_mask, mesh.areas, 0.0)
    seen_m2 = covers.sum(axis=1)
    alone_m2 = None if areas is not None else covers[:, cameras.covers.sum(axis=0) == 1].sum(axis=1)
    if areas is not None:
        found = regions(mesh, prepared.camera, placed, prepared.task, method=plan.task.method)
        zones = areas.zones(plan.task.views if isinstance(plan.task.views, dict) else None)
        seen_m2 = np.bincount(found.pair_pose, found.area, len(placed)).astype(np.float64)
    progress(0, 2)
    best = best_covering(network)
    overview = Overview(mesh, prepared.camera, placed, names, best, found).picture()
    pictures = {"overview": Picture.of("The task in the colours of its cameras", overview)}
    progress(1, 2)
    if zones:
        drawn = zones_picture(zones, summary, eyes)
        pictures["zones"] = Picture.of("Dead zones by number and reason", drawn)
    elif zones is None and (left := placement.leftover):
        drawn = leftover_picture(left, eyes)
        pictures["left"] = Picture.of("Faces that are not covered, by reason", drawn)
    progress(2, 2)
    figures = summary["network"] | {
        name: summary[name] for name in ("covered_area",) if name in summary
    }
    view = view_page(
        plan.name, mesh, prepared.camera, placed, [f"camera {name}" for name in names],
        values_of(
            network, cameras.covered, names, None if areas is None else areas.covered,
            views_of(mesh, plan.task.views),
        ),
        figures_of(
            figures, network.covered_faces, seen_m2, alone_m2,
            float(mesh.areas[mesh.task_mask].sum()),
        ),
        zone_entries(mesh, zones, summary) if zones else (),
    )  # fmt: skip
    covered, owner = figures["covered"], cameras.owner
    share = figures.get("covered_area", {}).get("percent", covered["area_percent"])
    title = f"Placement of cameras: {plan.name}"
    page = rendered(
        "placement.html",
        title=title,
        heading=title,
        answer=f"{plural(len(placed), 'camera', 'cover')} {percent(share / 100)} of the area",
        lines=notes,
        notes=(),
        summary=summary,
        run=summary["made_from"],
        files="plan.json",
        figures=figures,
        pictures=pictures,
        seen_m2=None if areas is None else seen_m2,
        has_view=view is not None,
        is_best=isinstance(prepared.problem.goal, BestCoverage),
        camera_rows=camera_rows(figures),
        zone_rows=zone_rows(summary) if "dead_zones" in summary else None,
        reasons=REASONS,
        mounts=[
            ", ".join(map(str, np.flatnonzero(owner == row))) for row in range(len(cameras.mounted))
        ],
        out_of_reach=_out_of_reach(prepared.openings),
    )
    return {"page.html": page} | ({} if view is None else {"view.html": view})


def leftover_picture(leftover: Leftover, eyes: Any = ()) -> Image.Image:
    """Faces that no camera covers, by reason, from the directions that show most of them."""
    mesh, left = leftover.mesh, leftover.left
    share = share_of_faces(mesh, left, mesh.task_mask)
    return mode_picture(
        "reason", mesh, reason_rows(leftover.reason, ~left, leftover.n_cameras), eyes,
        title=f"Not covered: {plural(int(share['faces']), 'face')}, "
        f"{percent(share['area_percent'] / 100)} of the area",
        directions=best_directions(mesh, left, eyes=eyes),
    )  # fmt: skip


def _out_of_reach(found: Openings | None) -> list[str]:
    """Sentences on faces of cavities that no camera gets to see."""
    if found is None:
        return []
    shut = np.flatnonzero(found.access != Access.REACHED)
    sentences = [found.words(row) for row in shut[:MAX_SENTENCES].tolist()]
    more = len(shut) - MAX_SENTENCES
    return sentences + ([f"And {more:,} more."] if more > 0 else [])
