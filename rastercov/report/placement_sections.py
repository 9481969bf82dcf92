"""Sections of the page of a placement: words and tables, with a bound beside every figure.

Part of `page`: from a `PlanReport`, and its pictures as elements of a page, to HTML.
"""

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from rastercov.placement.candidates.cavities import Access
from rastercov.placement.explain.uncovered import WORDS
from rastercov.placement.select.problem import BestCoverage
from rastercov.plan.requirements import percent
from rastercov.report.html import table
from rastercov.report.placement_report import PlanReport

MOST_SENTENCES = 12
"""Faces out of reach that are told one by one."""
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


def scene(report: PlanReport) -> str:
    """What is looked at, and by what."""
    mesh, camera, task = report.mesh, report.camera, report.network.task
    names = ", ".join(source.name for source in mesh.sources)
    extent = " x ".join(f"{length:.3g}" for length in np.ptp(mesh.bounds, axis=0))
    wants = [f"{task.min_pixels:g} px or more"]
    if task.min_visibility:
        wants.append(f"{percent(task.min_visibility)} visible")
    if task.max_incidence_deg < 90:
        wants.append(f"seen within {task.max_incidence_deg:g}° of its normal")
    if task.min_pixel_density:
        wants.append(f"{task.min_pixel_density:g} px/m")
    views = "a camera" if task.views == 1 else f"{task.views} cameras"
    return (
        f"<p>{escape(names + ': ' if names else '')}{mesh.task_mask.sum():,} faces to cover"
        f"{_occluders(report)}, {extent} m, by cameras of {camera.width} x {camera.height} px. "
        f"A face is covered when {views} reach{'es' if task.views == 1 else ''} coverage "
        f"{task.min_coverage:g} of it: all of it in the image and in focus, "
        f"{escape(', '.join(wants))}.</p>"
    )


def _occluders(report: PlanReport) -> str:
    count = int((~report.mesh.task_mask).sum())
    return f" and {count:,} that only hide" if count else ""


def verdict(report: PlanReport) -> str:
    """The answer in a few lines, and the notes."""
    told = report.network.summary()
    covered = told["covered"]
    count = len(report.poses)
    lines = [
        f"{covered['faces']:,} of {told['task_faces']:,} faces "
        f"({percent(covered['percent'] / 100)}) are covered; "
        f"{percent(told['zero_in_every_camera']['percent'] / 100)} have coverage 0 in every camera",
        *report.notes,
    ]
    if report.tolerance:
        worst = report.tolerance.together.worst
        lines.append(
            f"installed with errors, the worst of {report.tolerance.draws} draws covers "
            f"{percent(worst)}"
        )
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    word = "camera covers" if count == 1 else "cameras cover"
    return (
        f'<div class="verdict"><strong>{count} {word} '
        f"{percent(covered['area_percent'] / 100)} of the area</strong><ul>{items}</ul></div>"
    )


def cameras(report: PlanReport, drawn: Mapping[str, str]) -> list[str]:
    """Where the cameras stand, what each covers, and what hangs on it."""
    network, origins = report.network, report.origins
    headings = ["camera", "from", "x, m", "y, m", "z, m", "looks along", "covers, faces"]
    headings += ["mean coverage"]
    if not any(origins):
        headings.remove("from")
    rows = []
    tolerance = report.tolerance
    if tolerance:
        headings += ["covered without it", "its own faces"]
    for row, (name, pose) in enumerate(zip(report.names, report.poses, strict=True)):
        along = ", ".join(f"{_signed(value):.2f}" for value in pose[:3, 2])
        line = [name, *([origins[row]] if any(origins) else [])]
        line += [_length(value) for value in pose[:3, 3]]
        line += [along, f"{network.covered_faces[row]:,}", f"{network.mean_coverage[row]:.3f}"]
        if tolerance:
            of_camera = tolerance.cameras[row]
            line += [percent(of_camera.without), f"{of_camera.own_faces:,}"]
        rows.append(line)
    parts = ["<h2>Cameras</h2>", _figure(drawn, "network", _NETWORK_CAPTION)]
    return parts + ([table(headings, rows)] if rows else [])


_NETWORK_CAPTION = (
    "Each pyramid is the sight of a camera from its numbered eye; the thick edge is the upper edge "
    "of its image."
)


def coverage(report: PlanReport, drawn: Mapping[str, str]) -> list[str]:
    """Coverage by group, with how far the figures may be off."""
    told = report.network.summary()
    rows = []
    for group in told["groups"]:
        if group["role"] == "occluder":
            continue
        covered = group["covered"]
        rows.append(
            [
                group["name"],
                f"{group['faces']:,}",
                percent(covered["percent"] / 100),
                percent(covered["area_percent"] / 100),
                f"{group['faces'] - covered['faces']:,}",
                f"{group['zero_in_every_camera']['faces']:,}",
            ]
        )
    kinds = told["visibility_figures"]
    certain = kinds["certified"] + kinds["exact"]
    bound = told["largest_visibility_bound"]
    of_covered = told["largest_visibility_bound_of_covered"]
    how = (
        f"Visibility: {certain:,} figures certified or computed, {kinds['statistical']:,} counted. "
        f"The largest error that a figure may have is {bound:.2g}, and {of_covered:.2g} among the "
        "faces that count as covered."
    )
    if told["near_clipped_poses"]:
        names = ", ".join(report.names[row] for row in told["near_clipped_poses"])
        how += f" Surfaces are cut at the near plane of camera {escape(names)}."
    return [
        "<h2>Coverage</h2>",
        _figure(drawn, "coverage"),
        _grid(drawn, "groups", "overlap"),
        table(("group", "faces", "covered", "of the area", "not covered", "coverage 0"), rows),
        f'<p class="soft">{how}</p>',
    ]


def leftover(report: PlanReport, drawn: Mapping[str, str]) -> list[str]:
    """What is not covered, why, what is in the way, and whether anything could help."""
    left = report.leftover
    if left is None:
        return []
    told = left.summary()
    if not told["left"]["faces"]:
        return ["<h2>What is left</h2>", "<p>Nothing: every face is covered.</p>"]
    parts = ["<h2>What is left</h2>", _figure(drawn, "leftover")]
    reasons = sorted(told["reasons"].items(), key=lambda item: -item[1]["faces"])
    rows = [[f"{WORDS[name]}", *_share(share)] for name, share in reasons]
    rows.append(["all that is left", *_share(told["left"])])
    parts.append(table(("in the camera that comes nearest, they", *_SHARES), rows))
    if left.n_candidates:
        rows = [
            [words, *_share(told[name])]
            for name, words in (
                ("could_be_covered", "one could cover them"),
                ("seen_never_covered", "one sees them, none covers them"),
                ("seen_by_no_candidate", "none sees them (proved)"),
                ("unknown", "not decided"),
            )
            if told[name]["faces"]
        ]
        parts += [
            "<h3>Could another candidate help?</h3>",
            table((f"of {left.n_candidates:,} candidates", *_SHARES), rows),
        ]
    hidden = [
        [group["name"], "itself" if name == group["name"] else name, f"{area:.3g} m²"]
        for group in told["groups"]
        for name, area in group["hidden_by"].items()
    ]
    if hidden:
        parts += [
            "<h3>What is in the way</h3>",
            table(("faces of", "are hidden by", "area, sampled"), hidden),
        ]
    return parts + _openings(report)


def _openings(report: PlanReport) -> list[str]:
    found = report.openings
    if found is None or not len(found.face):
        return []
    told = found.summary()
    rows = [
        [words, f"{told[access.name.lower()]:,}"]
        for access, words in ACCESS.items()
        if told[access.name.lower()]
    ]
    parts = [
        "<h3>Cavities</h3>",
        "<p>From faces that no candidate sees, cameras were sought along the directions that are "
        f"open, {found.least:.3g} m away or more.</p>",
        table(("they", "faces"), rows),
    ]
    shut = np.flatnonzero(found.access != Access.REACHED)
    if len(shut):
        sentences = [found.words(row) for row in shut[:MOST_SENTENCES].tolist()]
        if len(shut) > MOST_SENTENCES:
            sentences.append(f"And {len(shut) - MOST_SENTENCES:,} more.")
        items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
        parts.append(
            f"<details><summary>Faces out of reach, one by one</summary><ul>{items}</ul></details>"
        )
    return parts


def selection(report: PlanReport, drawn: Mapping[str, str]) -> list[str]:
    """What could be chosen, what was dropped, what was chosen, and how good that is at least."""
    parts = []
    found, goal = report.selection, report.goal
    if found is not None and goal is not None:
        is_best = isinstance(goal, BestCoverage)
        what, bound = ("share", percent) if is_best else ("cost", lambda value: f"{value:g}")
        limit = "no other covers more than" if is_best else "no other costs less than"
        rows = [
            ["method", found.method],
            ["cameras", str(len(found.chosen))],
            [what, bound(found.objective)],
            [limit, bound(found.bound)],
            ["gap", f"{100 * found.gap:.2g} %"],
            ["which is", STATUS.get(found.status, found.status)],
            ["time", f"{found.seconds:.2g} s"],
        ]
        parts += [
            "<h2>Selection</h2>",
            '<p class="soft">Bounds are about these candidates; other poses may do better.</p>',
            f'<div class="grid"><div>{table(("", ""), rows)}</div>{_figure(drawn, "curve")}</div>',
        ]
    if report.candidates is not None or report.dropped is not None:
        parts += ["<h2>Candidates</h2>", *_candidates(report)]
    if "segments" in drawn:
        parts += ["<h2>Segments</h2>", _figure(drawn, "segments", _SEGMENT_CAPTION)]
    return parts


_SEGMENT_CAPTION = "Each segment gives candidates square to it; it may have several parts."


def _candidates(report: PlanReport) -> list[str]:
    parts = []
    if report.candidates is not None:
        rows = [[name, f"{n:,}"] for name, n in report.candidates.counts().items()]
        parts.append(table(("made by", "candidates"), rows))
    if report.dropped is not None:
        told = report.dropped.summary()
        reasons = [("inside a solid", told["in_solid"])]
        reasons += [(f"in keep-out {name}", n) for name, n in told["kept_out"].items()]
        reasons.append((f"nearer than {told['clearance']:g} m to a surface", told["too_near"]))
        rows = [[words, f"{n:,}"] for words, n in reasons if n]
        rows.append(["dropped in all", f"{told['candidates'] - told['kept']:,}"])
        parts.append(table((f"of {told['candidates']:,}, dropped because", "candidates"), rows))
    return parts


def tolerance(report: PlanReport) -> list[str]:
    """What is left of coverage under errors of installation."""
    told = report.tolerance
    if told is None:
        return []
    rows = [["as planned", percent(told.nominal)], ["mean", percent(told.together.mean)]]
    rows += [
        ["worst" if level == 0 else f"{100 * (1 - level):g} % of draws reach", percent(share)]
        for level, share in zip(told.together.levels, told.together.quantiles, strict=True)
        if level <= 0.5
    ]
    names = report.names
    each = [
        [name, percent(one.alone.mean), percent(one.alone.worst), percent(one.without)]
        for name, one in zip(names, told.cameras, strict=True)
    ]
    spread = "standard deviation" if told.error.distribution == "normal" else "at most"
    parts = [
        "<h2>Tolerance</h2>",
        f"<p>Errors of {told.error.position_mm:g} mm and {told.error.angle_deg:g}° ({spread}), "
        f"{told.draws:,} draws; the worst of these is no bound.",
    ]
    if told.cameras:
        parts[-1] += (
            f" Least is left without camera {escape(names[told.critical])}; the error of camera "
            f"{escape(names[told.most_sensitive])} costs most."
        )
    parts[-1] += "</p>"
    parts.append(table(("all cameras with errors", "covered"), rows))
    if each:
        headings = ("camera", "mean, only it is off", "worst, only it is off", "without it")
        parts.append(table(headings, each))
    return parts


def colophon(report: PlanReport) -> list[str]:
    """What made the report."""
    facts = _flat(report.made_with)
    if not facts:
        return []
    rows = [[name, value] for name, value in facts]
    return [
        "<h2>How it was made</h2>",
        f"<details><summary>Inputs, versions, hashes</summary>{table(('', ''), rows)}</details>",
    ]


def _flat(data: Mapping[str, Any], before: str = "") -> list[tuple[str, str]]:
    """Names, with those they lie in, and values as words."""
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


_SHARES = ("faces", "of all faces", "of the area")


def _share(share: Mapping[str, Any]) -> list[str]:
    return [
        f"{share['faces']:,}",
        percent(share["percent"] / 100),
        percent(share["area_percent"] / 100),
    ]


def _figure(drawn: Mapping[str, str], name: str, caption: str = "") -> str:
    if name not in drawn:
        return ""
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{drawn[name]}{words}</figure>"


def _grid(drawn: Mapping[str, str], *names: str) -> str:
    return f'<div class="grid">{"".join(_figure(drawn, name) for name in names)}</div>'


def _length(metres: float) -> str:
    """A coordinate to a tenth of a millimetre, or five digits where it is larger."""
    return f"{_signed(metres, 4):.4f}" if abs(metres) < 100 else f"{metres:.8g}"


def _signed(value: float, digits: int = 2) -> float:
    """A number as it is printed, without the sign of -0.00."""
    return round(float(value), digits) + 0.0
