"""Coverage models side by side: their disagreements, and the visibility of the faces there.

Every model of `MODELS` gets the same mesh, camera, poses and task; the engine computes the visible
fraction of each face, with a proof or to rounding. No model is called wrong, because their criteria
differ; only the bivalent occlusion test of several models is compared with the visible fraction.

E. S. Eissa. Image Space Coverage Model. 2020, section 4.3, does this for one model, by eye.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from heapq import nlargest
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, ByName, ConfigError, FloatArray
from rastercov.core.camera import Camera, valid_poses
from rastercov.core.coverage.coverage import Coverage, evaluate_batches
from rastercov.core.coverage.observer import open_observer
from rastercov.core.coverage.provenance import provenance_of
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster.observation import BoundKind
from rastercov.reference.models import MODELS, zhang
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
    task: Task | None = None,
    names: Sequence[str] | None = None,
    *,
    progress: Progress = silent,
) -> ModelComparison:
    """Coverage of every model, their disagreements, and the visibility of the faces there.

    Parameters
    ----------
    mesh, camera
        Any scene.
    poses : (P, 4, 4) array_like
        world_from_camera.
    task : Task, optional
        For all models; each uses the thresholds that it has.
    names : sequence of str, optional
        Names in `MODELS`; all that take the lens of the camera unless given.
    progress : callable
        Called with the poses done and the poses in all.

    Raises
    ------
    ConfigError
        For an unknown model or one named twice, or without poses.
    CameraError
        For a named model that needs a pinhole, with another lens.
    PoseError
        For a pose that is not a rigid transform.
    """
    task = task or Task()
    matrices = valid_poses(poses)
    names = (
        [name for name in MODELS if name not in names_without_model(camera)]
        if names is None
        else names
    )
    _check(names, len(matrices))
    statistics = _Statistics(mesh, task, tuple(names))
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


def _check(names: Sequence[str], n_poses: int) -> None:
    if unknown := [name for name in names if name not in MODELS]:
        raise ConfigError(f"expected a model, got {unknown[0]!r}; models are {', '.join(MODELS)}")
    if not names:
        raise ConfigError(f"expected a model, got none; name one of {', '.join(MODELS)}")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"expected each model once, got {twice[0]} twice; leave one out")
    if not n_poses:
        raise ConfigError("expected poses, got none; give some")


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
