"""Coverage models as predictors of marker detection, and their accuracy.

Every model of `rastercov.models` gets the same task for the two faces of a marker; the marker's
coverage is the smaller one, because Definition 1 has its conditions at all vertices. Ours is
evaluated for the marker as a whole, too, as in the thesis' tables.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh
from rastercov.validation.markers.requirement import ROUNDING, PlateFigures, Requirement
from rastercov.validation.markers.scene import PlateScene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Model = Callable[..., FloatArray]

OURS = "image_space, marker"
"""Our model, for a marker as a whole."""
NO_LIMIT = {"alarcon"}
"""Models without thresholds: coverage is 1 only in the ideal pose, so any above 0 counts."""
BINS = (0.0, 1e-9, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.995, 1 - 1e-9, 1.01)
"""Edges of the classes of coverage in a calibration curve: 0, parts, and 1."""


def models() -> dict[str, Model]:
    """Models by name; imported on the first call."""
    from rastercov.models import MODELS
    from rastercov.models.mavrinac import MavrinacParameters

    # Ramps become steps at the thresholds of the requirement.
    steps = MavrinacParameters(ideal_blur=1e6, ideal_incidence_deg=90.0)

    def mavrinac(mesh: Mesh, camera: Camera, poses: ArrayLike, task: Any) -> FloatArray:
        found: FloatArray = MODELS["mavrinac"](mesh, camera, poses, task, parameters=steps)
        return found

    return {**MODELS, "mavrinac": mavrinac}


def coverages(
    scene: PlateScene,
    camera: Camera,
    figures: PlateFigures,
    requirement: Requirement,
    asked: dict[str, Model],
) -> dict[str, float]:
    """Coverage of the first marker of a scene by each model."""
    task = requirement.task(figures.pixels)
    faces, pose = scene.faces_of(0), np.eye(4)[None]
    found = {OURS: figures.coverage(requirement)}
    for name, model in asked.items():
        found[name] = float(model(scene.mesh, camera, pose, task)[0, faces].min())
    return found


@dataclass(frozen=True)
class Score:
    """Accuracy of a model."""

    model: str
    requirement: str  # name of its thresholds
    threshold: float  # coverage from which on it predicts a detection
    hits: int  # predicted and found
    false_alarms: int  # predicted only
    misses: int  # found only
    rejections: int  # neither
    best_threshold: float  # for these very scenes
    best_accuracy: float
    calibration: tuple[tuple[float, float, float, int], ...]
    """Classes of coverage: limits, share of markers found, markers."""

    @property
    def accuracy(self) -> float:
        """Share of right predictions."""
        right = self.hits + self.rejections
        return right / max(1, right + self.false_alarms + self.misses)


def score(
    model: str, requirement: Requirement, coverage: Sequence[float], detected: Sequence[bool]
) -> Score:
    """Score of a model on some scenes."""
    values, found = np.asarray(coverage, np.float64), np.asarray(detected, bool)
    threshold = ROUNDING if model in NO_LIMIT else requirement.threshold
    predicted = values >= threshold
    best, accuracy = best_threshold(values, found)
    classes = []
    for low, high in pairwise(BINS):
        inside = (values >= low) & (values < high)
        if inside.any():
            classes.append((low, high, float(found[inside].mean()), int(inside.sum())))
    return Score(
        model=model,
        requirement=requirement.name,
        threshold=threshold,
        hits=int((predicted & found).sum()),
        false_alarms=int((predicted & ~found).sum()),
        misses=int((~predicted & found).sum()),
        rejections=int((~predicted & ~found).sum()),
        best_threshold=best,
        best_accuracy=accuracy,
        calibration=tuple(classes),
    )


def best_threshold(values: FloatArray, found: BoolArray) -> tuple[float, float]:
    """Threshold with the most right predictions, and their share; inf predicts no detection."""
    order = np.argsort(-values, kind="stable")
    ranked, hits = values[order], np.cumsum(np.where(found[order], 1, -1))
    # Equal values have equal predictions: a threshold lies after the last of them only.
    is_last = np.append(ranked[1:] != ranked[:-1], True)
    gain = np.append(0, hits[is_last])
    at = int(gain.argmax())
    threshold = np.append(np.inf, ranked[is_last])[at]
    right = int((~found).sum()) + int(gain[at])
    return float(threshold), right / max(1, len(found))
