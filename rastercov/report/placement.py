"""Page of a placement: figures, bounds and pictures of a camera network, all inline.

Unknown parts have no section, so that a check of any network has a page, too.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base.format import length, percent, plural, signed, verb
from rastercov.base.output import write_text
from rastercov.camera.rig import cameras_of, names_of
from rastercov.coverage.reasons import REASONS
from rastercov.placement.candidates.cavities import Access, Openings
from rastercov.placement.candidates.clearance import Dropped
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.select.problem import BestCoverage
from rastercov.report.html import rendered
from rastercov.report.placement_pictures import PlanReport, Progress, drawn_for
from rastercov.report.tables import camera_rows, heading_and_tilt
from rastercov.report.zone_pictures import zone_rows

MAX_SENTENCES = 12
"""Faces out of reach that have a sentence of their own."""
ACCESS = {
    Access.ENCLOSED: "cannot be seen: proved",
    Access.CLOSED: "have no open direction",
    Access.NO_ROOM: "are open, but leave no place for a camera",
    Access.REACHED: "have got candidates of their own",
}
STATUS = {
    "optimal": "proved to be the best there is",
    "feasible": "found by a heuristic",
    "time_limit": "the best when time was up",
    "interrupted": "the best when it was interrupted",
}
NOTHING = "nothing: no candidate covers any of it"
CANDIDATE_ANSWERS = {
    "could_be_covered": "one could cover them",
    "seen_never_covered": "one sees them, none covers them",
    "seen_by_no_candidate": "none sees them (proved)",
    "unknown": "not decided",
}


def write_page(
    path: str | Path, report: PlanReport, progress: Progress = lambda done, total: None
) -> Path:
    """Write the page of a report and return its path; it appears there only when it is whole.

    `progress` gets the pictures drawn and the pictures in all.
    """
    write_text(path, page(report, progress))
    return Path(path)


def page(report: PlanReport, progress: Progress = lambda done, total: None) -> str:
    """HTML of a report, pictures inline."""
    mesh, summary = report.mesh, report.summary or report.network.summary()
    covered, figures = summary["covered"], summary["visibility_figures"]
    left = report.leftover.summary() if report.leftover else None
    by_area = summary.get("covered_area", {}).get("percent", covered["area_percent"])
    return rendered(
        "placement.html",
        title=report.title,
        heading=report.title,
        report=report,
        summary=summary,
        drawn=drawn_for(report, progress),
        names=", ".join(source.name for source in mesh.sources),
        n_task=int(mesh.task_mask.sum()),
        n_occluders=int((~mesh.task_mask).sum()),
        n_targets=int(mesh.target_mask.sum()),
        extent=" x ".join(f"{side:.3g}" for side in np.ptp(mesh.bounds, axis=0)),
        wants=_thresholds(report),
        answer=f"{plural(len(report.poses), 'camera', 'cover')} "
        f"{percent(by_area / 100)} of the area",
        lines=_lines(report, summary),
        cameras=_cameras(report),
        sizes=_sizes(report),
        camera_rows=camera_rows(summary),
        groups=_groups(summary),
        n_certain=figures["certified"] + figures["exact"],
        clipped=[report.names[row] for row in summary["near_clipped_poses"]],
        left=left,
        caution=report.colours.caution(),
        zone_rows=zone_rows(summary) if report.zones is not None else [],
        share_headings=["faces", "of all faces", "of the area"],
        **(_uncovered(left) if left else {}),
        openings=_openings(report.openings),
        selection=_selection(report),
        made_by=_made_by(report.candidates),
        dropped=_dropped(report.dropped),
        tolerance=_tolerance(report),
        made_with=_flat(report.made_with),
    )


def _sizes(report: PlanReport) -> str:
    """Width and height of the images of each camera, px, with its name where there are several."""
    cameras = cameras_of(report.camera)
    sizes = [f"{each.width} x {each.height}" for each in cameras]
    if len(cameras) == 1:
        return sizes[0]
    return ", ".join(
        f"{size} ({name})" for size, name in zip(sizes, names_of(report.camera), strict=True)
    )


def _thresholds(report: PlanReport) -> list[str]:
    """Thresholds of the task that a covered face must meet."""
    task = report.network.task
    wants = [f"{task.min_pixels:g} px or more"]
    if task.min_visibility:
        wants.append(f"{percent(task.min_visibility)} visible")
    if task.max_incidence_deg < 90:
        wants.append(f"seen within {task.max_incidence_deg:g}° of its normal")
    if task.min_pixel_density:
        wants.append(f"{task.min_pixel_density:g} px/m on the surface")
    if task.min_facing_density:
        wants.append(f"{task.min_facing_density:g} px/m facing the camera")
    if task.min_pixels_per_m2:
        wants.append(f"{task.min_pixels_per_m2:g} px/m²")
    return wants


def _lines(report: PlanReport, summary: Mapping[str, Any]) -> list[str]:
    """Lines below the answer, with the notes of the report."""
    covered, zero = summary["covered"], summary["zero_in_every_camera"]
    lines = [
        f"{covered['faces']:,} of {plural(summary['task_faces'], 'face')} "
        f"({percent(covered['percent'] / 100)}) {verb(covered['faces'], 'are')} covered"
        + (
            " as a whole, from one camera"
            if report.regions is not None
            else f"; {percent(zero['percent'] / 100)} have coverage 0 in every camera"
        ),
        *report.notes,
    ]
    if found := report.tolerance:
        lines.append(
            f"installed with errors, the worst of {plural(found.draws, 'draw')} covers "
            f"{percent(found.together.worst)}"
        )
    return lines


def _cameras(report: PlanReport) -> dict[str, Any]:
    """Table of positions, directions and figures of the cameras."""
    network, tolerance, poses = report.network, report.tolerance, report.poses
    columns: dict[str, Sequence[str]] = {"camera": report.names}
    if any(report.types):
        columns["type"] = report.types
    if any(report.origins):
        columns["from"] = report.origins
    for axis, name in enumerate("xyz"):
        columns[f"{name}, m"] = [length(pose[axis, 3]) for pose in poses]
    columns["looks along"] = [", ".join(signed(value) for value in pose[:3, 2]) for pose in poses]
    for at, name in enumerate(("heading", "down")):
        columns[name] = [f"{round(heading_and_tilt(pose)[at])}°" for pose in poses]
    if (regions := report.regions) is None:
        columns["covers, faces"] = [f"{faces:,}" for faces in network.covered_faces]
        columns["mean coverage"] = [f"{mean:.3f}" for mean in network.mean_coverage]
    else:
        areas = np.bincount(regions.pair_pose, regions.area, len(poses))
        columns["covers, m²"] = [f"{area:.3g}" for area in areas]
    if tolerance:
        each = [tolerance.cameras[mount] for mount in report.mounts]
        own = "faces" if regions is None else "cells"
        columns["covered without it"] = [percent(camera.without) for camera in each]
        columns[f"its own {own}"] = [f"{camera.own_faces:,}" for camera in each]
    return {"headings": list(columns), "rows": list(zip(*columns.values(), strict=True))}


def _groups(summary: Mapping[str, Any]) -> list[list[str]]:
    """Table of coverage by task group."""
    return [
        [
            group["name"] + (" (target)" if group["role"] == "target" else ""),
            f"{group['faces']:,}",
            percent(whole["percent"] / 100),
            percent(group.get("covered_area", {}).get("percent", whole["area_percent"]) / 100),
            f"{group['faces'] - whole['faces']:,}",
            f"{group['zero_in_every_camera']['faces']:,}",
        ]
        for group in summary["groups"]
        if group["role"] != "occluder"
        for whole in [group["covered"]]
    ]


def _uncovered(left: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of uncovered faces: reasons, answers of other candidates, occluders."""
    reasons = sorted(left["reasons"].items(), key=lambda item: -item[1]["faces"])
    return {
        "reasons": [[REASONS[name].sentence, *_share(share)] for name, share in reasons]
        + [["all that is left", *_share(left["left"])]],
        "candidate_rows": [
            [text, *_share(left[name])]
            for name, text in CANDIDATE_ANSWERS.items()
            if left.get(name, {}).get("faces")
        ],
        "occluders": [
            [group["name"], "itself" if name == group["name"] else name, f"{area:.3g} m²"]
            for group in left["groups"]
            for name, area in group["hidden_by"].items()
        ],
    }


def _openings(found: Openings | None) -> dict[str, Any] | None:
    """Access to faces in cavities, with sentences about those out of reach."""
    if found is None or not len(found.face):
        return None
    counts = {access: found.summary()[access.name.lower()] for access in ACCESS}
    shut = np.flatnonzero(found.access != Access.REACHED)
    sentences = [found.words(row) for row in shut[:MAX_SENTENCES].tolist()]
    if len(shut) > MAX_SENTENCES:
        sentences.append(f"And {len(shut) - MAX_SENTENCES:,} more.")
    return {
        "rows": [
            [text, f"{counts[access]:,}"] for access, text in ACCESS.items() if counts[access]
        ],
        "out_of_reach": sentences,
    }


def _selection(report: PlanReport) -> list[list[str]] | None:
    """Result of the selection with its bound."""
    found, goal = report.selection, report.goal
    if found is None or goal is None:
        return None
    is_best = isinstance(goal, BestCoverage)
    share = "share on cells" if report.regions is not None else "share"
    bound = percent if is_best else "{:g}".format
    return [
        ["method", found.method],
        ["cameras", str(len(found.chosen))],
        [share if is_best else "cost", bound(found.objective)],
        [f"no other {'covers more' if is_best else 'costs less'} than", bound(found.bound)],
        ["gap", f"{100 * found.gap:.2g} %"],
        ["which is", STATUS.get(found.status, found.status) if found.share > 0 else NOTHING],
        ["time", f"{found.seconds:.2g} s"],
    ]


def _made_by(candidates: Candidates | None) -> list[list[str]]:
    """Counts of candidates by source."""
    counts = candidates.counts() if candidates is not None else {}
    return [[source, f"{n:,}"] for source, n in counts.items()]


def _dropped(found: Dropped | None) -> dict[str, Any] | None:
    """Counts of rejected candidates by reason."""
    if found is None:
        return None
    summary = found.summary()
    reasons = {
        "inside a solid": summary["in_solid"],
        **{f"in keep-out {name}": n for name, n in summary["kept_out"].items()},
        f"nearer than {summary['clearance']:g} m to a surface": summary["too_near"],
    }
    rows = [[text, f"{n:,}"] for text, n in reasons.items() if n]
    rows.append(["dropped in all", f"{summary['candidates'] - summary['kept']:,}"])
    return {"total": summary["candidates"], "rows": rows}


def _tolerance(report: PlanReport) -> dict[str, Any] | None:
    """Coverage under errors of installation: of all cameras, and of each alone."""
    found = report.tolerance
    if found is None:
        return None
    quantiles = zip(found.together.levels, found.together.quantiles, strict=True)
    return {
        "together": [
            ["as planned", percent(found.nominal)],
            ["mean", percent(found.together.mean)],
            *(
                [
                    "worst" if level == 0 else f"{100 * (1 - level):g} % of draws reach",
                    percent(share),
                ]
                for level, share in quantiles
                if level <= 0.5
            ),
        ],
        "each": [
            [name, percent(one.alone.mean), percent(one.alone.worst), percent(one.without)]
            for name, one in zip(report.mount_names, found.cameras, strict=True)
        ],
    }


def _flat(data: Mapping[str, Any], before: str = "") -> list[tuple[str, str]]:
    """Values of nested mappings as text, with their joined names."""
    facts: list[tuple[str, str]] = []
    for name, value in data.items():
        if isinstance(value, Mapping):
            facts += _flat(value, f"{before}{name}, ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            for row, part in enumerate(value, start=1):
                facts += _flat(part, f"{before}{name} {row}, ")
        else:
            facts.append((f"{before}{name}", str(value)))
    return facts


def _share(share: Mapping[str, Any]) -> list[str]:
    return [
        f"{share['faces']:,}",
        percent(share["percent"] / 100),
        percent(share["area_percent"] / 100),
    ]
