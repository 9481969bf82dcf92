"""A comparison of models for people: one HTML page by itself, JSON, pictures, a table.

models.html       figures, pictures, where the models disagree; in itself, for phone and desk
models.json       `ModelComparison` as it is
occlusion_*.png   bivalent and graded occlusion of one pose, and where they differ
models_*.png      coverage of that pose by every model

They take the place of an earlier comparison together, when all are whole.
"""

import io
import math
import re
from collections.abc import Callable
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image
from rich.table import Table

from rastercov.camera import Camera
from rastercov.coverage import Task
from rastercov.mesh import Mesh
from rastercov.models import MODELS, zhang
from rastercov.observer import visibility
from rastercov.pose import valid_poses
from rastercov.report.figures import write_bytes, write_json, write_text
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.html import document, picture, table
from rastercov.report.method_words import milliseconds, number
from rastercov.report.model_pictures import (
    SMALL,
    look_at_part,
    look_closer,
    models_sheet,
    occlusion_sheet,
)
from rastercov.validation.models.comparison import OURS, covers
from rastercov.validation.models.results import FaceValues, ModelComparison

MODEL_COMPARISON = ReportKind(
    "models",
    re.compile(r"models\.(json|html)|(occlusion|models)_\d+\.png"),
    last="models.json",
)
POSES_DRAWN = 3
"""Poses with pictures, at most: those in which the bivalent test misjudges most."""
LOOKS_AT = {
    "tarabanis": ("smaller angle", "edges", "", "", ""),
    "scott": ("yes", "centroid", "yes", "", "in resolution"),
    "mavrinac": ("graded", "graded", "graded", "vertices", "graded"),
    "alarcon": ("yes", "distance", "yes", "centroid", "graded"),
    "zhang": ("yes", "graded", "yes", "vertices", "in resolution"),
    "image_space": ("yes", "pixels", "yes", "graded area", "limit"),
}
"""What each model looks at: field of view, resolution, focus, occlusion, angle."""
LOOKS_AT_HEADINGS = ("model", "field of view", "resolution", "focus", "occlusion", "angle")
SCORE_HEADINGS = (
    "model",
    "covers",
    "of all faces",
    "of these really seen",
    "between 0 and 1",
    "mean",
    "time per pose",
)
WORST_HEADINGS = ("pose", "face", "px^2", "really seen", "kind", "bivalent")


def write_model_comparison(
    out: Path | ReportFolder,
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write the page, the JSON and the pictures; gives the path of the page.

    Parameters
    ----------
    out : Path or ReportFolder
        Folder, made when it is missing; or one that is open.
    comparison, mesh, camera, poses, task
        What `compare_models` gave, and what it was given.
    progress : callable
        Called with the poses drawn and the poses to draw.
    """
    with ReportFolder.opened(out, MODEL_COMPARISON) as folder:
        matrices = valid_poses(poses)
        chosen = sorted(np.argsort(-np.array(comparison.misjudged), kind="stable")[:POSES_DRAWN])
        digits = len(str(len(matrices) - 1))
        drawn: dict[str, bytes] = {}
        for done, pose in enumerate(int(row) for row in chosen):
            progress(done, len(chosen))
            for name, image in _draw(comparison, mesh, camera, matrices[pose], task).items():
                drawn[f"{name}_{pose:0{digits}d}"] = _png(image)
        progress(len(chosen), len(chosen))
        for name, data in drawn.items():
            write_bytes(folder.file(f"{name}.png"), data)
        write_text(folder.file("models.html"), page(comparison, drawn))
        write_json(folder.file("models.json"), comparison)
        folder.publish()
        return folder.path / "models.html"


def _draw(
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    pose: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    task: Task | None,
) -> dict[str, Image.Image]:
    """Both sheets of one pose."""
    task = task or Task()
    graded = visibility(mesh, camera, pose[None]).value[0]
    bivalent = zhang.visible(mesh, camera, pose[None])[0]
    whole = look_at_part(mesh, camera, pose)
    closer = look_closer(mesh, camera, pose, np.abs(graded - bivalent))
    values = {
        score.name: MODELS[score.name](mesh, camera, pose[None], task)[0]
        for score in comparison.models
    }
    n_faces = max(1, int(mesh.task_mask.sum()))
    captions = [
        f"{name}: covers {100 * (covers(of_model, task) & mesh.task_mask).sum() / n_faces:.1f} %"
        for name, of_model in values.items()
    ]
    return {
        "occlusion": occlusion_sheet(whole, closer, bivalent, graded),
        "models": models_sheet(look_at_part(mesh, camera, pose, SMALL), values, captions),
    }


def _png(image: Image.Image) -> bytes:
    """A picture as PNG with all its colours: the grey of a face is its figure."""
    file = io.BytesIO()
    image.save(file, format="PNG", optimize=True)
    return file.getvalue()


def page(comparison: ModelComparison, pictures: dict[str, bytes]) -> str:
    """HTML of a comparison.

    Parameters
    ----------
    comparison : ModelComparison
        What to tell.
    pictures : dict
        PNG by name: `occlusion_*` and `models_*`, with the row of the pose.
    """
    body = [
        "<h1>Coverage models side by side</h1>",
        _scene(comparison),
        _bivalence(comparison),
    ]
    names = sorted(name for name in pictures if name.startswith("occlusion_"))
    if names:
        body.append("<h2>Bivalent and graded occlusion</h2>")
        body.append(
            "<p>White is seen, black is hidden. A bivalent test knows nothing between: it asks "
            "whether a segment from a vertex to the camera meets another face. (c) has in orange "
            "what is seen but called hidden, in blue what is hidden but called seen; the framed "
            "place is shown larger below.</p>"
        )
        body += [_figure("Bivalent and graded occlusion", name, pictures) for name in names]
    body.append("<h2>What each model looks at</h2>")
    body.append(
        table(
            LOOKS_AT_HEADINGS,
            [(_called(s.name), *LOOKS_AT[s.name]) for s in comparison.models],
        )
    )
    body.append("<h2>What each model covers</h2>")
    body.append(table(SCORE_HEADINGS, score_rows(comparison)))
    body.append(
        '<p class="soft">Pairs of pose and face with coverage of at least '
        f"{comparison.run['task']['min_coverage']:g}. Really seen: the visible part of the images "
        "of the faces it covers, with a proof or to rounding. Between 0 and 1: of the faces with "
        "any coverage, those without all of it.</p>"
    )
    body += [
        _figure("Coverage by every model", name, pictures)
        for name in sorted(name for name in pictures if name.startswith("models_"))
    ]
    body += [_disagreements(comparison), _worst(comparison), _colophon(comparison)]
    return document("rastercov compare --models", body)


def _called(name: str) -> str:
    """The name of a model; ours is told."""
    return f"{name} (ours)" if name == OURS else name


def _scene(comparison: ModelComparison) -> str:
    run = comparison.run
    names = ", ".join(str(source["name"]) for source in run["mesh"])
    what = f"{names}: " if names != "arrays" else "A mesh of "
    poses = f"{comparison.poses:,} pose{'' if comparison.poses == 1 else 's'}"
    size = f"{run['camera']['width']} x {run['camera']['height']} px"
    return (
        f"<p>{escape(what)}{comparison.task_faces:,} faces, {poses}, a camera of {size}. All "
        "models have the same task.</p>"
    )


def bivalence_lines(comparison: ModelComparison) -> list[str]:
    """What the bivalent test misjudges, in sentences."""
    found = comparison.bivalence
    lines = [
        f"{found.partly_hidden:,} of {found.faces:,} faces in view from the front are partly hidden"
    ]
    if found.called_hidden:
        lines.append(
            f"the bivalent test calls {found.called_hidden:,} faces hidden of which "
            f"{100 * found.called_hidden_visibility:.0f} % is seen on average, "
            f"{found.called_hidden_pixels:,.0f} px^2 in all"
        )
    if found.called_seen:
        lines.append(
            f"it calls {found.called_seen:,} faces seen of which "
            f"{100 * (1 - found.called_seen_visibility):.0f} % is hidden on average, "
            f"{found.called_seen_pixels:,.0f} px^2 in all"
        )
    return lines


def _bivalence(comparison: ModelComparison) -> str:
    head, *rest = bivalence_lines(comparison)
    lines = "".join(f"<li>{escape(line)}</li>" for line in rest)
    return f'<div class="verdict"><strong>{escape(head)}</strong><ul>{lines}</ul></div>'


def _figure(words: str, name: str, pictures: dict[str, bytes]) -> str:
    pose = int(name.rpartition("_")[2])
    return (
        f"<h3>Pose {pose}</h3><figure>{picture(f'{words}, pose {pose}', pictures[name])}</figure>"
    )


def score_rows(comparison: ModelComparison) -> list[tuple[str, ...]]:
    """Models under `SCORE_HEADINGS`."""
    return [
        (
            _called(score.name),
            f"{score.covered:,}",
            f"{score.covered_percent:.2f} %",
            _floored(score.seen_percent) if score.covered else "",
            f"{score.graded_percent:.1f} %",
            number(score.mean),
            milliseconds(score.seconds_per_pose),
        )
        for score in comparison.models
    ]


def _floored(percent: float) -> str:
    """A percentage, never rounded up to all of it."""
    return "100 %" if percent == 100 else f"{math.floor(100 * percent) / 100:.2f} %"


def _disagreements(comparison: ModelComparison) -> str:
    """A table of pairs: how many faces the row covers and the column does not, and how visible."""
    by_pair = {(each.covers, each.does_not): each for each in comparison.disagreements}
    names = [score.name for score in comparison.models]
    rows = []
    for name in names:
        row = [_called(name)]
        for other in names:
            found = by_pair.get((name, other))
            if name == other:
                row.append("")
            elif found is None:
                row.append("0")
            else:
                row.append(f"{found.faces:,} ({100 * found.mean_visibility:.0f} %)")
        rows.append(row)
    details = [
        (
            f"{_called(each.covers)}, not {_called(each.does_not)}",
            f"{each.faces:,}",
            f"{each.hidden:,}",
            f"{each.partly:,}",
            f"{each.whole:,}",
            f"{each.image_pixels:,.0f}",
            f"{each.visible_pixels:,.0f}",
        )
        for each in comparison.disagreements
        if OURS in (each.covers, each.does_not)
    ]
    headings = ("covers", "faces", "hidden", "partly", "whole", "px^2", "px^2 seen")
    return (
        "<h2>Where they disagree</h2>"
        "<p>Faces that the model of the row covers and that of the column does not; in brackets "
        "how much of them is really seen, on average.</p>"
        + table(("covers, but not", *names), rows)
        + "<p>Ours and each of the others, by how much of the faces is seen:</p>"
        + table(headings, details)
    )


def _worst(comparison: ModelComparison) -> str:
    if not comparison.worst:
        return ""
    names = [score.name for score in comparison.models]
    return (
        "<h2>Faces that the bivalent test misjudges most</h2>"
        "<p>By area in the image. On the right what each model gives.</p>"
        + table((*WORST_HEADINGS, *names), [_worst_row(each, names) for each in comparison.worst])
    )


def _worst_row(of_face: FaceValues, names: list[str]) -> tuple[str, ...]:
    return (
        f"{of_face.pose}",
        f"{of_face.face}",
        f"{of_face.image_pixels:,.0f}",
        f"{100 * of_face.visibility:.2f} %",
        of_face.kind,
        "seen" if of_face.bivalent else "hidden",
        *(number(of_face.coverage[name]) for name in names),
    )


def _colophon(comparison: ModelComparison) -> str:
    run = comparison.run
    versions = ", ".join(f"{name} {number_}" for name, number_ in run["versions"].items())
    task = ", ".join(f"{name} {value}" for name, value in run["task"].items())
    return (
        f'<h2>How it was made</h2><p class="soft">Task: {escape(task)}. What a task does not say '
        "is each model's default; docs/models.md has them, and where our sources disagree. "
        f"{escape(versions)}. Poses sha256 {run['poses']['sha256'][:16]}. All figures are in "
        "models.json.</p>"
    )


def score_table(comparison: ModelComparison) -> Table:
    """Models side by side, for a terminal of 80 columns."""
    poses = f"{comparison.poses:,} pose{'' if comparison.poses == 1 else 's'}"
    found = Table(title=f"{comparison.task_faces:,} faces, {poses}", title_justify="left")
    found.add_column("model", no_wrap=True)
    for name in ("covers", "faces", "seen", "graded", "mean", "time"):
        found.add_column(name, justify="right", no_wrap=True)
    for row in score_rows(comparison):
        found.add_row(*row)
    return found
