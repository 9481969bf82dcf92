"""Report of a comparison of models: page, JSON, pictures, and a table for a terminal.

models.html       figures, pictures, disagreements of models; all inline, for phone and desk
models.json       `ModelComparison` as it is
occlusion_*.png   bivalent and graded occlusion of one pose, and their difference
models_*.png      coverage of that pose by every model

They replace an earlier comparison together, when all are whole. White is covered and black is not,
as in figures 4.2 to 4.6 of E. S. Eissa. Image Space Coverage Model. 2020; a third picture shows the
difference of bivalent and graded occlusion in two hues.

Coverage models side by side: their disagreements, and the visibility of the faces there.

Every model of `MODELS` gets the same mesh, camera, poses and task; the engine computes the visible
fraction of each face, with a proof or to rounding. No model is called wrong, because their criteria
differ; only the bivalent occlusion test of several models is compared with the visible fraction.

E. S. Eissa. Image Space Coverage Model. 2020, section 4.3, does this for one model, by eye.
"""

import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from heapq import nlargest
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image
from rich.table import Table

from rastercov.base import BoolArray, ByName, ByteArray, ConfigError, FloatArray, plural
from rastercov.base.format import number
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.coverage.coverage import Coverage, evaluate_batches, open_observer
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.shards import provenance_of
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import KIND_WORDS, BoundKind
from rastercov.reference.models import MODELS, zhang
from rastercov.reference.models.base import ModelCriteria
from rastercov.reference.pages import milliseconds, open_browser, percent_of, publish
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.images import (
    Key,
    add_frame,
    contact_sheet,
    greys,
    png,
)
from rastercov.report.pages import Picture, render
from rastercov.report.panorama import DrawnScene, draw_scene, neutral, paint, scene_keys
from rastercov.report.theme import Pixels
from rastercov.shards import Progress, silent

Values = dict[str, FloatArray]
"""Coverage by the name of the model."""

OURS = "image_space"
"""The model whose coverage the engine computes together with visibility."""
POSES_A_BATCH = 16
"""Most poses evaluated at a time."""
FACES_KEPT = 24
"""Number of faces to keep: those with the largest errors of the bivalent test."""


@dataclass(frozen=True)
class ModelScore:
    """Coverage of the task's faces by one model, over all poses."""

    name: str  # in `MODELS`
    covered: int  # pairs of pose and face that it covers
    covered_percent: float  # their share of all pairs
    graded_percent: float  # of the pairs with coverage above 0, those below 1
    mean: float  # coverage over all pairs
    seen_percent: float  # visible part of the images of the faces it covers, all together
    seconds_per_pose: float  # computing time


@dataclass(frozen=True)
class Disagreement:
    """Pairs of pose and face that one model covers and another does not."""

    covers: str
    does_not: str
    faces: int
    hidden: int
    partly: int
    whole: int
    mean_visibility: float
    image_pixels: float  # area of their images, px^2
    visible_pixels: float  # of the visible parts, px^2


@dataclass(frozen=True)
class Bivalence:
    """The bivalent test of `zhang.visible` compared with the visible area, for any task.

    Faces in view from the front, wholly inside the image, count, once for each pose.
    """

    faces: int
    partly_hidden: int  # with a visible and a hidden part
    called_hidden: int  # called hidden although a part is visible
    called_seen: int  # called seen although a part is hidden
    called_hidden_visibility: float  # mean visible fraction of these
    called_hidden_pixels: float  # their visible area, px^2
    called_seen_visibility: float  # mean visible fraction of these
    called_seen_pixels: float  # their hidden area, px^2


@dataclass(frozen=True)
class FaceValues:
    """One face in one pose: visibility, and coverage by every model."""

    pose: int  # row of the poses
    face: int  # row of `mesh.faces`
    visibility: float  # visible fraction
    bound: float
    kind: str  # of the bound, see `rastercov.BoundKind`
    bivalent: bool  # True when the bivalent test calls it seen
    image_pixels: float  # area of its image, px^2
    coverage: dict[str, float]  # by the name of the model


@dataclass(frozen=True)
class ModelComparison:
    """Models side by side."""

    models: tuple[ModelScore, ...]  # in the order asked for
    disagreements: tuple[Disagreement, ...]  # of every pair of models that disagree, both ways
    bivalence: Bivalence  # errors of the bivalent test
    worst: tuple[FaceValues, ...]  # faces with its largest errors by area in the image
    misjudged: tuple[float, ...]  # its error in each pose, px^2
    poses: int
    task_faces: int
    run: ByName  # provenance: mesh, camera, poses, task, versions


def compare_models(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Progress = silent,
) -> ModelComparison:
    """Coverage of models that take a lens, their disagreements, and visibility of faces there.

    Parameters
    ----------
    mesh, camera
        Any scene.
    poses : (P, 4, 4) array_like
        world_from_camera.
    progress : callable
        Called with the poses done and the poses in all.

    Raises
    ------
    ConfigError
        Without poses.
    PoseError
        For a pose that is not a rigid transform.
    """
    task, matrices = Task(), valid_poses(poses)
    if not len(matrices):
        raise ConfigError("expected poses, got none; give some")
    names = tuple(name for name in MODELS if name not in names_without_model(camera))
    statistics = _Statistics(mesh, task, names)
    progress(0, len(matrices))
    with open_observer(mesh, camera) as observer:
        # Kernels are compiled before the time is measured.
        observer.observe(matrices[:1])
        zhang.visible(mesh, camera, matrices[:1])
        for start in range(0, len(matrices), POSES_A_BATCH):
            of_batch = matrices[start : start + POSES_A_BATCH]
            began = time.perf_counter()
            batches = list(evaluate_batches(observer, of_batch, task))
            statistics.seconds[OURS] += time.perf_counter() - began
            values: Values = {}
            for name in names:
                if name == OURS:
                    values[name] = np.concatenate([batch.coverage for batch in batches])
                    continue
                began = time.perf_counter()
                values[name] = MODELS[name](mesh, camera, of_batch, task)
                statistics.seconds[name] += time.perf_counter() - began
            bivalent = zhang.visible(mesh, camera, of_batch) > 0
            rows = [(batch, row) for batch in batches for row in range(len(batch.pose_ids))]
            for pose, (batch, row) in enumerate(rows):
                by_name = {name: value[pose] for name, value in values.items()}
                statistics.add(batch, row, by_name, bivalent[pose])
            progress(start + len(of_batch), len(matrices))
        info = observer.info
    run = provenance_of(mesh, camera, matrices, task, measured_by=info)
    return statistics.result(run)


def names_without_model(camera: Camera) -> dict[str, str]:
    """Reason of each model that does not take the lens of a camera."""
    if camera.is_pinhole:
        return {}
    reasons = {name: model.pinhole_because for name, model in MODELS.items()}
    return {name: reason for name, reason in reasons.items() if reason}


def covers(coverage: FloatArray, task: Task) -> BoolArray:
    """Mask of coverage that is enough for the task: `Task.min_coverage`, and above 0."""
    return (coverage >= task.min_coverage) & (coverage > 0)


class _Statistics:
    """Sums over poses, by model and by pair of models (covers, does not cover)."""

    def __init__(self, mesh: Mesh, task: Task, names: tuple[str, ...]) -> None:
        self.mesh, self.task, self.names = mesh, task, names
        self.seconds = dict.fromkeys((*names, OURS), 0.0)
        n = len(names)
        self._of_model = np.zeros((n, 3))  # above 0, between 0 and 1, coverage
        # Of covered faces: how many, hidden, partly, whole; visibility, px^2, visible px^2.
        self._covered = np.zeros((n, 7))
        self._of_pair = np.zeros((n, n, 7))
        # Counted, partly; called hidden, called seen: how many, visible fraction, px^2.
        self._judged, self._called = np.zeros(2), np.zeros((2, 3))
        self._misjudged: list[float] = []
        self._worst: list[tuple[float, FaceValues]] = []

    def add(self, batch: Coverage, row: int, values: Values, bivalent: BoolArray) -> None:
        """Add the next pose, a row of the batch."""
        chosen = np.flatnonzero(self.mesh.task_mask)
        visibility = batch.visibility[row, chosen]
        image = batch.drawn_pixels[row, chosen]
        hidden, whole = visibility <= 0, visibility >= 1
        kinds = (hidden | True, hidden, ~hidden & ~whole, whole)
        terms = np.stack([*kinds, visibility, image, visibility * image], axis=1)
        coverage = np.stack([values[name][chosen] for name in self.names])
        above, enough = coverage > 0, covers(coverage, self.task)
        of_face = np.stack((above, above & (coverage < 1), coverage), axis=2)
        self._of_model += of_face.sum(axis=1)
        self._covered += enough @ terms
        self._of_pair += (enough[:, None] & ~enough) @ terms
        self._add_bivalent(batch, row, values, bivalent)

    def _add_bivalent(self, batch: Coverage, row: int, values: Values, bivalent: BoolArray) -> None:
        """Compare the bivalent test of one pose with the visible fractions."""
        image = batch.drawn_pixels[row]
        counted = self.mesh.task_mask & batch.in_view[row] & (image > 0)
        counted &= batch.reason[row] > Reason.BACK_FACING
        visibility, bound = batch.visibility[row], batch.visibility_bound[row]
        # A computed fraction that is 0 or 1 to rounding counts as 0 or 1.
        some, is_whole = visibility > bound, visibility >= 1 - bound
        off = np.where(counted, np.abs(bivalent - visibility) * image, 0.0)
        wrong = counted & np.where(bivalent, ~is_whole, some)
        self._judged += (counted.sum(), (counted & some & ~is_whole).sum())
        terms = np.stack((np.ones(len(off)), visibility, off), axis=1)
        self._called += np.stack((wrong & ~bivalent, wrong & bivalent)) @ terms
        pose = len(self._misjudged)
        self._misjudged.append(float(off.sum()))
        for face in np.argsort(-off, kind="stable")[:FACES_KEPT].tolist():
            if wrong[face]:
                of_face = FaceValues(
                    pose=pose,
                    face=face,
                    visibility=float(visibility[face]),
                    bound=float(bound[face]),
                    kind=BoundKind(batch.visibility_kind[row, face]).name.lower(),
                    bivalent=bool(bivalent[face]),
                    image_pixels=float(image[face]),
                    coverage={name: float(value[face]) for name, value in values.items()},
                )
                self._worst.append((float(off[face]), of_face))
        self._worst = nlargest(FACES_KEPT, self._worst, key=lambda entry: entry[0])

    def result(self, run: ByName) -> ModelComparison:
        """Result of all poses."""
        n_poses = len(self._misjudged)
        n_faces = int(self.mesh.task_mask.sum())
        (n_hidden, of_hidden, lost), (n_seen, of_seen, gained) = self._called.tolist()
        faces, partly = map(int, self._judged.tolist())
        return ModelComparison(
            models=tuple(map(self._score, range(len(self.names)))),
            disagreements=tuple(self._disagreements()),
            bivalence=Bivalence(
                faces=faces,
                partly_hidden=partly,
                called_hidden=int(n_hidden),
                called_seen=int(n_seen),
                called_hidden_visibility=_ratio(of_hidden, n_hidden),
                called_hidden_pixels=lost,
                called_seen_visibility=_ratio(of_seen, n_seen),
                called_seen_pixels=gained,
            ),
            worst=tuple(of_face for _, of_face in self._worst),
            misjudged=tuple(self._misjudged),
            poses=n_poses,
            task_faces=n_faces,
            run=run | {"task": self.task._entries()},
        )

    def _score(self, model: int) -> ModelScore:
        n_poses = len(self._misjudged)
        pairs = max(1, n_poses * int(self.mesh.task_mask.sum()))
        above, between, total = self._of_model[model].tolist()
        covered, *_, image, seen = self._covered[model].tolist()
        return ModelScore(
            name=self.names[model],
            covered=int(covered),
            covered_percent=100 * covered / pairs,
            graded_percent=100 * between / max(1, above),
            mean=total / pairs,
            seen_percent=100 * _ratio(seen, image),
            seconds_per_pose=self.seconds[self.names[model]] / n_poses,
        )

    def _disagreements(self) -> Iterator[Disagreement]:
        pairs = product(self.names, repeat=2)
        for (a, b), sums in zip(pairs, self._of_pair.reshape(-1, 7).tolist(), strict=True):
            faces, hidden, partly, whole = map(int, sums[:4])
            visibility, image, seen = sums[4:]
            if faces:
                mean = visibility / faces
                yield Disagreement(a, b, faces, hidden, partly, whole, mean, image, seen)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 0.0


Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels of the camera's image."""

MODEL_COMPARISON = ReportKind(
    "models",
    re.compile(r"models\.(json|html)|(occlusion|models)_\d+\.png"),
    last="models.json",
)
MISSED, FALSELY_SEEN = (232, 92, 16), (24, 88, 214)
"""Visible but called hidden by the bivalent test, and hidden but called visible."""
OF_TARGETS = 0.4
"""Strength of colours on targets, relative to surfaces."""
POSES_DRAWN = 3
"""Maximum number of poses with images: those with the largest errors of the bivalent test."""
CRITERIA_HEADINGS = (
    "model",
    *(field.name.replace("_", " ") for field in fields(ModelCriteria)),
)
SCORE_HEADINGS = (
    *("model", "covered pairs", "of all pairs", "of these visible", "between 0 and 1", "mean"),
    "time per pose",
)
DETAIL_HEADINGS = (
    *("covered by", "pairs", "hidden", "partly visible", "wholly visible"),
    *("image area, px²", "visible, px²"),
)
WORST_HEADINGS = ("pose", "face", "image area, px²", "visible", "kind", "bivalent")
PICTURES = {"occlusion": "Bivalent and graded occlusion", "models": "Coverage by every model"}
"""Descriptions of the pictures, by the start of their names."""
WIDTH = 720
"""Pixels of a picture in a sheet of two or three."""
SMALL = 560
"""The same in a sheet of all models."""
MAX_ASPECT = 1.0
"""Largest height of a picture, relative to its width."""
MARGIN = 0.03
"""Margin around the part, relative to its size in the image."""
MIN_DIFFERENCE = 0.01
"""Difference below which a face keeps its grey."""


def write_model_comparison(
    out: Path | ReportFolder,
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    progress: Progress = silent,
) -> Path:
    """Write the page, the JSON and the pictures; returns the path of the page.

    `progress` gets the poses drawn and the poses to draw.
    """
    with open_browser(out, MODEL_COMPARISON) as folder:
        matrices = valid_poses(poses)
        chosen = sorted(np.argsort(-np.array(comparison.misjudged), kind="stable")[:POSES_DRAWN])
        digits = len(str(len(matrices) - 1))
        pictures: dict[str, Picture] = {}
        for done, pose in enumerate(int(row) for row in chosen):
            progress(done, len(chosen))
            for name, image in _draw(comparison, mesh, camera, matrices[pose]).items():
                # All colours are kept: the grey of a face is its coverage.
                alt = f"{PICTURES[name]}, pose {pose}"
                pictures[f"{name}_{pose:0{digits}d}"] = Picture(alt, png(image))
        progress(len(chosen), len(chosen))
        return publish(folder, page(comparison, pictures), comparison, pictures)


def _draw(
    comparison: ModelComparison,
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
) -> dict[str, Image.Image]:
    """Both sheets of one pose."""
    task = Task()
    graded = evaluate(mesh, camera, pose, fields=["visibility"], by="face").visibility[0]
    bivalent = zhang.visible(mesh, camera, pose[None])[0]
    values = {
        score.name: MODELS[score.name](mesh, camera, pose[None], task)[0]
        for score in comparison.models
    }
    n_faces = max(1, int(mesh.task_mask.sum()))
    captions = [
        f"{name}: {100 * (covers(of_model, task) & mesh.task_mask).sum() / n_faces:.1f} % of faces"
        for name, of_model in values.items()
    ]
    small = look_at_part(mesh, camera, pose, SMALL)
    return {
        "occlusion": occlusion_sheet(look_at_part(mesh, camera, pose), bivalent, graded),
        "models": _sheet([coverage_picture(small, each) for each in values.values()], captions),
    }


def page(comparison: ModelComparison, pictures: dict[str, Picture]) -> str:
    """HTML of a comparison; pictures by name: `occlusion_*` and `models_*`, a row of the poses."""
    names = [score.name for score in comparison.models]
    of_kind = {
        kind: [(int(n.rpartition("_")[2]), pictures[n]) for n in sorted(pictures) if kind in n]
        for kind in PICTURES
    }
    return render(
        "models.html",
        "rastercov.reference",
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
        worst_rows=[
            (
                f"{face.pose}",
                f"{face.face}",
                f"{face.image_pixels:,.0f}",
                f"{100 * face.visibility:.2f} %",
                KIND_WORDS[face.kind],
                "visible" if face.bivalent else "hidden",
                *(number(face.coverage[name]) for name in names),
            )
            for face in comparison.worst
        ],
    )


def _title(name: str) -> str:
    """Name of a model, with a mark at ours."""
    return f"{name} (ours)" if name == OURS else name


def bivalence_lines(comparison: ModelComparison) -> list[str]:
    """Errors of the bivalent test, in sentences."""
    test = comparison.bivalence
    lines = [
        f"{test.partly_hidden:,} of {test.faces:,} pose-face pairs (front-facing, inside the "
        "image) are partly hidden"
    ]
    if test.called_hidden:
        lines.append(
            f"a bivalent test (all or nothing) classifies {test.called_hidden:,} pairs as hidden, "
            f"although {100 * test.called_hidden_visibility:.0f} % of the face is visible on "
            f"average ({test.called_hidden_pixels:,.0f} px² in total)"
        )
    if test.called_seen:
        lines.append(
            f"it classifies {test.called_seen:,} pairs as visible, although "
            f"{100 * (1 - test.called_seen_visibility):.0f} % of the face is hidden on average "
            f"({test.called_seen_pixels:,.0f} px² in total)"
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


def score_table(comparison: ModelComparison) -> Table:
    """Models side by side, for a terminal of 80 columns."""
    poses = plural(comparison.poses, "pose")
    table = Table(
        title=f"{comparison.task_faces:,} faces, {poses}", title_justify="left", pad_edge=False
    )
    table.add_column("model", no_wrap=True)
    names = (
        "pairs\ncovered",
        "of all\npairs",
        "of these\nvisible",
        "score in\n(0, 1)",
        "mean\nscore",
        "ms per\npose",
    )
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    for row in score_rows(comparison):
        table.add_row(*row[:-1], row[-1].removesuffix(" ms"))
    return table


def look_at_part(mesh: Mesh, camera: Camera, pose: FloatArray, width: int = WIDTH) -> DrawnScene:
    """The part of the image that holds the mesh, `width` wide or `MAX_ASPECT * width` high."""
    left, top, right, bottom = _box_of(mesh, camera, pose)
    across, down = right - left, bottom - top
    scale = min(width / across, MAX_ASPECT * width / down)
    cut = replace(
        camera,
        width=max(1, round(across * scale)),
        height=max(1, round(down * scale)),
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx - left) * scale,
        cy=(camera.cy - top) * scale,
        skew=camera.skew * scale,
    )
    with open_rasterizer(mesh, cut, "cpu") as rasterizer:
        return draw_scene(mesh, cut, pose, rasterizer.render(pose))


def coverage_picture(scene: DrawnScene, values: ArrayLike, word: str = "coverage") -> Image.Image:
    """Picture of one pose, brighter where coverage is higher, with its scale below.

    E. S. Eissa. Image Space Coverage Model. 2020, figures 4.2 to 4.6.

    Parameters
    ----------
    scene : Scene
        As `panorama.draw_scene` gives it.
    values : (F,) array_like
        Coverage of each face; beyond [0, 1] it is shown as the nearer end, NaN as 0.
    word : str
        Name of the scale.

    Returns
    -------
    PIL.Image.Image
        RGB; the image is at its own size, see `coverage_pixels`.
        Images narrower than `LEAST_WIDTH` are enlarged without smoothing.
    """
    scale = Key.scale(word, greys(np.linspace(0, 1, 256)), "0", "1")
    return add_frame(coverage_pixels(scene, values), "", [scale, *scene_keys([scene])])


def coverage_pixels(scene: DrawnScene, values: ArrayLike) -> Pixels:
    """Pixels of `coverage_picture` without its frame, (H, W, 3).

    The grey of a face is fixed by its coverage except for a head-light of at most 14 %, which keeps
    the form readable: of two faces the one whose coverage is 0.15 higher is brighter in any
    shading. Lines between faces fade out where faces are small.
    """
    mesh = scene.mesh
    levels = np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0)
    colours = neutral(mesh, scene.setting)
    colours[mesh.task_mask] = greys(levels[mesh.task_mask])
    return paint(scene, colours)


def occlusion_sheet(look: DrawnScene, bivalent: FloatArray, graded: FloatArray) -> Image.Image:
    """Bivalent occlusion, graded occlusion and their difference, of visible fractions, (F,)."""
    three = [coverage_picture(look, each, word="visible fraction") for each in (bivalent, graded)]
    three.append(difference_picture(look, bivalent, graded))
    return _sheet(
        three, ["(a) bivalent occlusion", "(b) graded occlusion", "(c) where they differ"]
    )


def difference_picture(look: DrawnScene, bivalent: FloatArray, graded: FloatArray) -> Image.Image:
    """The look in soft grey, with colour on faces whose bivalent and graded occlusion differ.

    The strength of the colour grows with the difference.
    """
    mesh = look.mesh
    shown = coverage_pixels(look, graded)
    pixels = 0.55 * shown + 0.45 * 205
    differs = np.append(np.where(mesh.task_mask, graded - bivalent, 0.0), 0.0)
    for face, opacity in ((look.face, 1.0), (look.targets, OF_TARGETS)):
        off = differs[face]
        for sign, colour in ((1, MISSED), (-1, FALSELY_SEEN)):
            rows = sign * off > MIN_DIFFERENCE
            strength = opacity * (0.35 + 0.65 * np.abs(off[rows])[:, None])
            pixels[rows] = (1 - strength) * pixels[rows] + strength * np.array(colour)
    keys = [
        Key("visible, classified hidden", _swatch(MISSED), "0", "1"),
        Key("hidden, classified visible", _swatch(FALSELY_SEEN), "0", "1"),
    ]
    return add_frame(pixels.astype(np.uint8), "", keys)


def _sheet(pictures: Sequence[Image.Image], captions: Sequence[str]) -> Image.Image:
    """Pictures in rows of three, at their own size."""
    return contact_sheet(pictures, captions, 3, max(picture.width for picture in pictures))


def _box_of(mesh: Mesh, camera: Camera, pose: FloatArray) -> Box:
    """Bounding box of the mesh in the image with a margin; the image where there is none."""
    points, size = to_camera(mesh.vertices, pose), np.array((camera.width, camera.height))
    low, high = np.zeros(2), size
    if not camera.is_curved and (camera.is_parallel or points[:, 2].min() > 0):
        pixels = to_image(points, camera)
        low, high = (np.clip(each, 0, size) for each in (pixels.min(axis=0), pixels.max(axis=0)))
    if (high <= low).any():
        low, high = np.zeros(2), size
    margin = MARGIN * (high - low)[0]
    left, top = np.maximum(low - margin, 0).tolist()
    right, bottom = np.minimum(high + margin, size).tolist()
    return left, top, right, bottom


def _swatch(colour: tuple[int, int, int]) -> ByteArray:
    """Ramp of a colour from its strength at a small difference to that at 1."""
    strength = np.linspace(0.35, 1.0, 256)[:, None]
    line = (1 - strength) * 205 + strength * np.array(colour)
    return np.broadcast_to(line.astype(np.uint8), (24, 256, 3)).copy()
