"""A comparison for people: one HTML page that needs nothing else, JSON, pictures, a table.

compare.html   verdict, figures, plots, the worst faces; in itself, for phone and desk
compare.json   `Comparison` as it is
plot_*.png     the plots of the page
worst_*.png    faces with the greatest errors of each candidate
missed_*.png   faces that are seen but of which it says 0

They take the place of an earlier comparison together, when all are whole.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from html import escape
from pathlib import Path

from numpy.typing import ArrayLike
from PIL import Image

from rastercov._interrupts import interrupts_held
from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.report.canvas import DARK, LIGHT
from rastercov.report.figures import write_bytes, write_json, write_text
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.html import document, picture, png, table, uri
from rastercov.report.method_pictures import face_picture, fraction
from rastercov.report.method_plots import file_name, plots
from rastercov.report.method_words import (
    KIND_HEADINGS,
    SCORE_HEADINGS,
    SIZE_HEADINGS,
    kind_row,
    score_row,
    score_words,
    size_row,
)
from rastercov.validation.methods.results import Comparison, FaceError, Score

COMPARISON = ReportKind(
    "compare",
    re.compile(r"compare\.(json|html)|(plot|worst|missed)_\w+\.png"),
    last="compare.json",
)
NOTHING_BUT_ROUNDING = 1e-6
"""Greatest error of a candidate below which two faces are shown, not all that were kept."""
TRUTH = {
    "exact": "the analytic method: half-planes, every face computed",
    "polygons": "polygon Booleans by GEOS, which share no code with the methods compared",
    "rational": "exact rational arithmetic: no rounding anywhere",
}


def write_comparison(
    out: Path | ReportFolder,
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write the page, the JSON and the pictures; gives the path of the page.

    An interrupt (Ctrl-C) while pictures are drawn leaves out the rest of them: the files are
    written, the JSON says `"interrupted": true`, and then it is raised.

    Parameters
    ----------
    out : Path or ReportFolder
        Folder, made when it is missing; or one that is open.
    comparison, mesh, camera, poses
        What `compare` gave, and what it was given.
    progress : callable
        Called with the pictures drawn and the pictures in all.
    """
    with ReportFolder.opened(out, COMPARISON) as folder:
        drawn: dict[str, bytes] = {}
        interrupted = False
        try:
            _draw(drawn, comparison, mesh, camera, poses, progress)
        except KeyboardInterrupt:
            interrupted = True
            comparison = replace(comparison, interrupted=True)
        with interrupts_held():
            for name, data in drawn.items():
                if not name.startswith("dark_"):
                    write_bytes(folder.file(f"{name}.png"), data)
            write_text(folder.file("compare.html"), page(comparison, drawn))
            write_json(folder.file("compare.json"), comparison)
            folder.publish()
        if interrupted:
            raise KeyboardInterrupt
        return folder.path / "compare.html"


def _draw(
    drawn: dict[str, bytes],
    comparison: Comparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Callable[[int, int], None],
) -> None:
    """Fill in the pictures, as PNG, by the names of their files."""
    for theme, prefix in ((LIGHT, ""), (DARK, "dark_")):
        for name, image in plots(comparison, theme).items():
            drawn[f"{prefix}plot_{name}"] = png(image, Image.Quantize.MEDIANCUT)
    matrices = valid_poses(poses)
    wanted = [
        (score, name, of_face)
        for score in comparison.scores
        for name, of_face in _shown(score).items()
    ]
    for done, (score, name, of_face) in enumerate(wanted):
        progress(done, len(wanted))
        image_ = face_picture(
            mesh,
            camera,
            matrices[of_face.pose],
            of_face,
            score.name,
            score.supersample,
            score.roll,
        )
        if image_:
            drawn[name] = png(image_, Image.Quantize.FASTOCTREE)
    progress(len(wanted), len(wanted))


def _shown(score: Score) -> dict[str, FaceError]:
    """The faces of a candidate to show, by the names of their pictures."""
    is_good = score.all_sizes.greatest < NOTHING_BUT_ROUNDING and all(w.held for w in score.worst)
    faces = {"worst": score.worst[: 2 if is_good else None], "missed": score.missed_faces}
    return {
        f"{kind}_{file_name(score.name)}_{rank}": of_face
        for kind, of_kind in faces.items()
        for rank, of_face in enumerate(of_kind, start=1)
    }


def page(comparison: Comparison, pictures: dict[str, bytes]) -> str:
    """HTML of a comparison.

    Parameters
    ----------
    comparison : Comparison
        What to tell.
    pictures : dict
        PNG by name: `plot_*` with their twins `dark_plot_*`, `worst_*` and `missed_*`; those that
        are not there are left out.
    """
    body = [
        "<h1>Visibility of faces: computed and counted, beside the truth</h1>",
        _scene(comparison),
        _verdict(comparison),
        "<h2>At a glance</h2>",
        table(SCORE_HEADINGS, [score_row(score) for score in comparison.scores]),
        '<p class="soft">Errors are |figure - truth| of the visible fraction of each face in view '
        "from the front, 0 to 1. Missed: something of the face is seen, and the figure says 0. "
        "Error / bound is the median over partly hidden faces.</p>",
        _plots(pictures),
    ]
    for score in comparison.scores:
        body += _candidate(score, pictures)
    body.append(_colophon(comparison))
    return document(f"rastercov compare: {'passed' if comparison.passed else 'failed'}", body)


def _scene(comparison: Comparison) -> str:
    run = comparison.run
    names = ", ".join(str(source["name"]) for source in run["mesh"])
    poses = f"{comparison.poses_done:,} poses"
    if comparison.poses_done < comparison.poses:
        poses = f"{comparison.poses_done:,} of {comparison.poses:,} poses (it was interrupted)"
    size = f"{run['camera']['width']} x {run['camera']['height']} px"
    what = f"{names}: " if names != "arrays" else "A mesh of "
    return (
        f"<p>{escape(what)}{comparison.faces:,} faces, {poses}, a camera of {size}. The truth "
        f"is {escape(TRUTH[comparison.against])}.</p>"
    )


def _verdict(comparison: Comparison) -> str:
    words = (
        "Passed: certain figures are right, and statistical bounds hold as often as they must."
        if comparison.passed
        else "Failed: a bound does not hold."
    )
    marks = {True: ("yes", "✓"), False: ("no", "✗"), None: ("soft", "–")}
    lines = []
    for check in comparison.checks:
        name, mark = marks[check.passed]
        lines.append(f'<li><span class="{name}">{mark}</span> {escape(str(check))}</li>')
    style = "verdict" if comparison.passed else "verdict bad"
    return f'<div class="{style}"><strong>{words}</strong><ul>{"".join(lines)}</ul></div>'


def _plots(pictures: dict[str, bytes]) -> str:
    figures = []
    for name, data in pictures.items():
        if not name.startswith("plot_"):
            continue
        words = name.removeprefix("plot_").replace("_", " ")
        image = picture(f"Plot: {words}", data, pictures.get(f"dark_{name}"))
        figures.append(f"<figure>{image}</figure>")
    return f'<div class="grid">{"".join(figures)}</div>' if figures else ""


def _candidate(score: Score, pictures: dict[str, bytes]) -> list[str]:
    renderer = escape(score.info["renderer"])
    parts = [
        f"<h2>{escape(score.name)}</h2>",
        f'<p class="soft">By {renderer}; opened, with its first pose, in '
        f"{score.open_seconds:.2g} s.</p>",
        table(KIND_HEADINGS, [kind_row(bound) for bound in score.bounds]),
        f"<p>{escape(score_words(score))}</p>",
        "<details><summary>By size of the face in the image</summary>"
        + table(SIZE_HEADINGS, [size_row(size) for size in (*score.size_classes, score.all_sizes)])
        + "</details>",
    ]
    titles = {
        "worst": "Greatest errors: broken bounds first, then figures with a bound below 1",
        "missed": "Missed: of what it calls hidden, the faces of which most is seen",
    }
    for kind, title in titles.items():
        figures = [
            f'<figure><img alt="{_alt(of_face)}" src="{uri(pictures[name])}"></figure>'
            for name, of_face in _shown(score).items()
            if name.startswith(kind) and name in pictures
        ]
        if figures:
            parts.append(f'<h3>{title}</h3><div class="grid faces">{"".join(figures)}</div>')
    return parts


def _colophon(comparison: Comparison) -> str:
    run = comparison.run
    versions = ", ".join(f"{name} {number}" for name, number in run["versions"].items())
    return (
        '<h2>How it was made</h2><p class="soft">Areas of the truth may be off by '
        f"{comparison.truth_error:g} px^2; that much is allowed for. Certified and exact figures "
        "must all be within their bound; a statistical bound must hold for 99.9 % of partly hidden "
        f"faces. {escape(versions)}; {escape(run['machine']['system'])}. Poses sha256 "
        f"{run['poses']['sha256'][:16]}. All figures are in compare.json.</p>"
    )


def _alt(of_face: FaceError) -> str:
    return (
        f"Face {of_face.face} in pose {of_face.pose}: says {fraction(of_face.value)} ± "
        f"{fraction(of_face.bound)}, truth {fraction(of_face.truth)}"
    )
