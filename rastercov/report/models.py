"""Report of a comparison of models: page, JSON, pictures, and a table for a terminal.

models.html       figures, pictures, disagreements of models; all inline, for phone and desk
models.json       `ModelComparison` as it is
occlusion_*.png   bivalent and graded occlusion of one pose, and their difference
models_*.png      coverage of that pose by every model

They replace an earlier comparison together, when all are whole.
"""

import re
from collections.abc import Callable
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from rich.table import Table

from rastercov.base.format import milliseconds, number, percent_of, plural
from rastercov.camera.camera import Camera
from rastercov.camera.pose import valid_poses
from rastercov.coverage.observer import visibility
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.models import MODELS, zhang
from rastercov.models.base import Criteria
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.html import Picture, publish, rendered
from rastercov.report.images import png
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
CRITERIA_HEADINGS = (
    "model",
    *(field.name.replace("_", " ") for field in fields(Criteria)),
)
SCORE_HEADINGS = (
    *("model", "covers", "of all faces", "of these really seen", "between 0 and 1", "mean"),
    "time per pose",
)
DETAIL_HEADINGS = ("covers", "faces", "hidden", "partly", "whole", "px^2", "px^2 seen")
WORST_HEADINGS = ("pose", "face", "px^2", "really seen", "kind", "bivalent")
PICTURES = {"occlusion": "Bivalent and graded occlusion", "models": "Coverage by every model"}
"""Descriptions of the pictures, by the start of their names."""


def write_model_comparison(
    out: Path | ReportFolder,
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    task: Task | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page.

    `progress` gets the poses drawn and the poses to draw.
    """
    with ReportFolder.opened(out, MODEL_COMPARISON) as folder:
        matrices = valid_poses(poses)
        chosen = sorted(np.argsort(-np.array(comparison.misjudged), kind="stable")[:POSES_DRAWN])
        digits = len(str(len(matrices) - 1))
        pictures: dict[str, Picture] = {}
        for done, pose in enumerate(int(row) for row in chosen):
            progress(done, len(chosen))
            for name, image in _draw(comparison, mesh, camera, matrices[pose], task).items():
                # All colours are kept: the grey of a face is its coverage.
                alt = f"{PICTURES[name]}, pose {pose}"
                pictures[f"{name}_{pose:0{digits}d}"] = Picture(alt, png(image))
        progress(len(chosen), len(chosen))
        return publish(folder, page(comparison, pictures), comparison, pictures)


def _draw(
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    pose: NDArray[np.float64],
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


def page(comparison: ModelComparison, pictures: dict[str, Picture]) -> str:
    """HTML of a comparison; pictures by name: `occlusion_*` and `models_*`, a row of the poses."""
    names = [score.name for score in comparison.models]
    of_kind = {
        kind: [(int(n.rpartition("_")[2]), pictures[n]) for n in sorted(pictures) if kind in n]
        for kind in PICTURES
    }
    return rendered(
        "models.html",
        title="rastercov compare --models",
        heading="Coverage models side by side",
        comparison=comparison,
        bivalence=bivalence_lines(comparison),
        occlusion=of_kind["occlusion"],
        coverage=of_kind["models"],
        criteria_headings=CRITERIA_HEADINGS,
        criteria_rows=[(_title(name), *astuple(MODELS[name].criteria)) for name in names],
        score_headings=SCORE_HEADINGS,
        score_rows=score_rows(comparison),
        pair_headings=("covers, but not", *names),
        pair_rows=_pair_rows(comparison, names),
        detail_headings=DETAIL_HEADINGS,
        detail_rows=_detail_rows(comparison),
        worst_headings=(*WORST_HEADINGS, *names),
        worst_rows=[_worst_row(each, names) for each in comparison.worst],
    )


def _title(name: str) -> str:
    """Name of a model, with a mark at ours."""
    return f"{name} (ours)" if name == OURS else name


def bivalence_lines(comparison: ModelComparison) -> list[str]:
    """Errors of the bivalent test, in sentences."""
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


def score_rows(comparison: ModelComparison) -> list[tuple[str, ...]]:
    """Models under `SCORE_HEADINGS`."""
    return [
        (
            _title(score.name),
            f"{score.covered:,}",
            f"{score.covered_percent:.2f} %",
            percent_of(score.seen_percent, 100, 2) if score.covered else "",
            f"{score.graded_percent:.1f} %",
            number(score.mean),
            milliseconds(score.seconds_per_pose),
        )
        for score in comparison.models
    ]


def _pair_rows(comparison: ModelComparison, names: list[str]) -> list[list[str]]:
    """Faces that the row's model covers and the column's does not, and their mean visibility."""
    cells = {
        (each.covers, each.does_not): f"{each.faces:,} ({100 * each.mean_visibility:.0f} %)"
        for each in comparison.disagreements
    }
    return [[_title(a), *("" if a == b else cells.get((a, b), "0") for b in names)] for a in names]


def _detail_rows(comparison: ModelComparison) -> list[tuple[str, ...]]:
    """Disagreements between ours and each other model, under `DETAIL_HEADINGS`."""
    return [
        (
            f"{_title(each.covers)}, not {_title(each.does_not)}",
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


def _worst_row(face: FaceValues, names: list[str]) -> tuple[str, ...]:
    return (
        f"{face.pose}",
        f"{face.face}",
        f"{face.image_pixels:,.0f}",
        f"{100 * face.visibility:.2f} %",
        face.kind,
        "seen" if face.bivalent else "hidden",
        *(number(face.coverage[name]) for name in names),
    )


def score_table(comparison: ModelComparison) -> Table:
    """Models side by side, for a terminal of 80 columns."""
    poses = plural(comparison.poses, "pose")
    table = Table(title=f"{comparison.task_faces:,} faces, {poses}", title_justify="left")
    table.add_column("model", no_wrap=True)
    for name in ("covers", "faces", "seen", "graded", "mean", "time"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in score_rows(comparison):
        table.add_row(*row)
    return table
