"""Report of a comparison of methods: page, JSON, pictures, and a table for a terminal.

compare.html   verdict, figures, plots, the worst faces; all inline, for phone and desk
compare.json   `Comparison` as it is
plot_*.png     plots of the page
worst_*.png    faces with the greatest errors of each method
missed_*.png   visible faces whose figure is 0

They replace an earlier comparison together, when all are whole.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike
from rich.table import Table
from rich.text import Text

from rastercov.base.format import milliseconds, number, percent_of, plural
from rastercov.camera.camera import Camera
from rastercov.camera.pose import valid_poses
from rastercov.mesh import Mesh
from rastercov.report.face_pictures import face_picture, fraction
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.html import Picture, publish, rendered
from rastercov.report.method_plots import comparison_plots, file_name
from rastercov.report.plots import picture_of
from rastercov.report.theme import DARK, LIGHT
from rastercov.validation.methods.results import (
    BoundCheck,
    Check,
    Comparison,
    FaceError,
    Score,
    SizeClass,
)

COMPARISON = ReportKind(
    "compare",
    re.compile(r"compare\.(json|html)|(plot|worst|missed)_\w+\.png"),
    last="compare.json",
)
NEGLIGIBLE_ERROR = 1e-6
"""Greatest error of a method below which two faces are shown instead of all that were kept."""
TRUTH = {
    "exact": "the analytic method: half-planes, every face computed",
    "polygons": "polygon Booleans by GEOS, which share no code with the methods compared",
    "rational": "exact rational arithmetic: no rounding anywhere",
}
SCORE_HEADINGS = (
    *("method", "faces", "partly hidden", "rms error, partly hidden", "greatest error"),
    *("missed", "bound held", "error / bound", "time per pose"),
)
KIND_HEADINGS = (
    *("kind of figure", "figures", "bound held", "partly hidden", "bound held"),
    *("error / bound, median", "greatest"),
)
SIZE_HEADINGS = (
    *("px^2", "faces", "partly hidden", "median error", "99 % below", "greatest error"),
    *("rms error, partly hidden", "mean bound, partly hidden", "missed", "bound held"),
)
PASSED = "Passed: certain figures are right, and statistical bounds hold as often as they must."
FACE_TITLES = {
    "worst": "Greatest errors: broken bounds first, then figures with a bound below 1",
    "missed": "Missed: of what it calls hidden, the faces of which most is seen",
}


def write_comparison(
    out: Path | ReportFolder,
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page.

    An interrupt (Ctrl-C) while pictures are drawn leaves out the rest of them: the files are
    written, the JSON says `"interrupted": true`, and then the interrupt is raised. `progress` gets
    the pictures drawn and the pictures in all.
    """
    with ReportFolder.opened(out, COMPARISON) as folder:
        pictures: dict[str, Picture] = {}
        interrupted = False
        try:
            _draw(pictures, comparison, mesh, camera, poses, progress)
        except KeyboardInterrupt:
            interrupted = True
            comparison = replace(comparison, interrupted=True)
        path = publish(folder, page(comparison, pictures), comparison, pictures)
        if interrupted:
            raise KeyboardInterrupt
        return path


def _draw(
    pictures: dict[str, Picture],
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Callable[[int, int], None],
) -> None:
    """Add the pictures by the names of their files."""
    light, dark = (comparison_plots(comparison, theme) for theme in (LIGHT, DARK))
    for name in light:
        alt = f"Plot: {name.replace('_', ' ')}"
        pictures[f"plot_{name}"] = picture_of(alt, light[name], dark[name])
    matrices = valid_poses(poses)
    wanted = [
        (score, name, face) for score in comparison.scores for name, face in _shown(score).items()
    ]
    for done, (score, name, face) in enumerate(wanted):
        progress(done, len(wanted))
        image = face_picture(
            mesh, camera, matrices[face.pose], face, score.name, score.supersample, score.roll
        )
        if image:
            alt = (
                f"Face {face.face} in pose {face.pose}: says {fraction(face.value)} ± "
                f"{fraction(face.bound)}, truth {fraction(face.truth)}"
            )
            pictures[name] = Picture.of(alt, image)
    progress(len(wanted), len(wanted))


def _shown(score: Score) -> dict[str, FaceError]:
    """Faces of a method to show, by the names of their pictures."""
    is_good = score.all_sizes.greatest < NEGLIGIBLE_ERROR and all(w.held for w in score.worst)
    faces = {"worst": score.worst[: 2 if is_good else None], "missed": score.missed_faces}
    return {
        f"{kind}_{file_name(score.name)}_{rank}": face
        for kind, of_kind in faces.items()
        for rank, face in enumerate(of_kind, start=1)
    }


def page(comparison: Comparison, pictures: dict[str, Picture]) -> str:
    """HTML of a comparison; pictures by name: `plot_*`, `worst_*`, `missed_*`, as far as drawn."""
    passed, done = comparison.passed, f"{comparison.poses_done:,}"
    interrupted = f"{done} of {plural(comparison.poses, 'pose')} (it was interrupted)"
    sections = [
        (
            score,
            score_text(score),
            [kind_row(bound) for bound in score.bounds],
            [size_row(size) for size in (*score.size_classes, score.all_sizes)],
            _face_pictures(score, pictures),
        )
        for score in comparison.scores
    ]
    return rendered(
        "methods.html",
        title=f"rastercov compare: {'passed' if passed else 'failed'}",
        heading="Visibility of faces: computed and counted, beside the truth",
        answer=PASSED if passed else "Failed: a bound does not hold.",
        comparison=comparison,
        poses=interrupted
        if comparison.poses_done < comparison.poses
        else plural(comparison.poses_done, "pose"),
        truth=TRUTH[comparison.against],
        checks=[(str(check), check.passed) for check in comparison.checks],
        score_headings=SCORE_HEADINGS,
        score_rows=[score_row(score) for score in comparison.scores],
        kind_headings=KIND_HEADINGS,
        size_headings=SIZE_HEADINGS,
        plots=[picture for name, picture in pictures.items() if name.startswith("plot_")],
        sections=sections,
    )


def _face_pictures(score: Score, pictures: dict[str, Picture]) -> list[tuple[str, list[Picture]]]:
    """Titles and pictures of the faces of a method, without empty ones."""
    names = [name for name in _shown(score) if name in pictures]
    found = [
        (title, [pictures[name] for name in names if name.startswith(kind)])
        for kind, title in FACE_TITLES.items()
    ]
    return [(title, of_kind) for title, of_kind in found if of_kind]


def score_row(score: Score) -> tuple[str, ...]:
    """A method under `SCORE_HEADINGS`."""
    sizes = score.all_sizes
    ratios = [bound.median_ratio for bound in score.bounds if bound.kind == "statistical"]
    return (
        score.name,
        f"{sizes.figures:,}",
        f"{sizes.partly_hidden:,}",
        number(sizes.rms_partly_hidden),
        number(sizes.greatest),
        f"{score.missed:,}",
        percent_of(sizes.held, sizes.figures),
        _optional(ratios[0] if ratios else None),
        milliseconds(score.seconds_per_pose),
    )


def kind_row(bound: BoundCheck) -> tuple[str, ...]:
    """A kind of bound under `KIND_HEADINGS`."""
    return (
        bound.kind,
        f"{bound.figures:,}",
        percent_of(bound.held, bound.figures),
        f"{bound.partly_hidden:,}",
        percent_of(bound.partly_hidden_held, bound.partly_hidden),
        _optional(bound.median_ratio),
        _optional(bound.greatest_ratio),
    )


def size_row(size: SizeClass) -> tuple[str, ...]:
    """A size class under `SIZE_HEADINGS`."""
    if math.isinf(size.high):
        limits = f"from {size.low:g}" if size.low else "all"
    else:
        limits = f"{size.low:g} to {size.high:g}"
    return (
        limits,
        f"{size.figures:,}",
        f"{size.partly_hidden:,}",
        number(size.median),
        number(size.percentile_99),
        number(size.greatest),
        number(size.rms_partly_hidden) if size.partly_hidden else "",
        number(size.mean_bound_partly_hidden) if size.partly_hidden else "",
        f"{size.missed:,}",
        percent_of(size.held, size.figures),
    )


def _optional(value: float | None) -> str:
    return "" if value is None else number(value)


def score_text(score: Score) -> str:
    """Sentences about a method that no table has."""
    text = [
        f"The visible area is off by {number(score.rms_pixels)} px^2 rms, "
        f"{number(score.greatest_pixels)} px^2 at most."
    ]
    if score.missed:
        unsaid = f"all but {score.missed_unsaid:,}" if score.missed_unsaid else "all"
        text.append(
            f"It misses {score.missed:,} faces, of which {score.missed_area:,.3g} px^2 are seen in "
            f"all; its bound allows for that in {unsaid} of them."
        )
    if score.phantoms:
        text.append(f"It calls {score.phantoms:,} hidden faces seen.")
    if score.unjudged:
        text.append(
            f"{plural(score.unjudged, 'face', 'are')} too small in the image for a judgement."
        )
    return " ".join(text)


def comparison_table(comparison: Comparison) -> Table:
    """Methods beside the reference, for a terminal of 80 columns.

    "partly" are faces that are partly hidden; the rms error is theirs.
    """
    title = f"Against {comparison.against}, {plural(comparison.poses_done, 'pose')}"
    table = Table(title=title, title_justify="left")
    table.add_column("method", overflow="fold")
    for name in ("faces", "partly", "rms error", "worst", "missed", "held %", "ms"):
        table.add_column(name, justify="right", no_wrap=True)
    for score in comparison.scores:
        row = score_row(score)
        time = row[8].removesuffix(" ms")
        table.add_row(Text(score.name), *row[1:6], row[6].removesuffix(" %"), time)
    seconds = milliseconds(comparison.truth_seconds_per_pose).removesuffix(" ms")
    table.add_row(f"truth: {comparison.against}", "", "", "", "", "", "", seconds, style="dim")
    return table


def check_lines(checks: Sequence[Check]) -> list[str]:
    """The verdict, one line a check."""
    results = {True: "holds ", False: "FAILS ", None: "      "}
    return [results[check.passed] + str(check) for check in checks]
