"""Random scenes of one marker each: photographs, detections, and models as predictors of them.

The draws, each independent of the others:

    distance      1.5 to 20 m, log-uniform; the thesis has 2 to 18 m
    place         middle of the marker anywhere in the image, uniform
    tilt, roll    0 to 75 degrees about any axis in the image plane, and 0 to 360 degrees, uniform
    lens          f/1.4 to f/16, log-uniform; focused at 0.5 m to infinity, uniform in 1/distance
    obstacle      in half of the scenes a grey board, at 0.3 to 0.9 of the distance, tilted up to
                  45 degrees, its middle within 1.2 times where the boards just touch, as the camera
                  sees them head-on; as large as the marker's by default
    noise         of the sensor, see `render.sensor`

Every model of `rastercov.reference.models` gets the same task for the two faces of a marker; the
marker's coverage is the smaller one, because Definition 1 has its conditions at all vertices. Ours
is evaluated for the marker as a whole, too, as in the thesis' tables.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.catalogue import entries_of
from rastercov.camera.projection import to_image
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.markers.detect import detect
from rastercov.reference.markers.render import SHARP, Box, MarkerRenderer, sensor
from rastercov.reference.markers.requirement import (
    DETECTOR,
    ROUNDING,
    THESIS,
    PlateFigures,
    Requirement,
    blur_of,
    plate_figures,
)
from rastercov.reference.markers.scene import (
    CELLS,
    MARGIN,
    MARKER_SIDE,
    Plate,
    PlateScene,
    plate_pose,
)

Model = Callable[..., FloatArray]

OURS = "image_space, marker"
"""Our model, for a marker as a whole."""
NO_LIMIT = {"alarcon"}
"""Models without thresholds: coverage is 1 only in the ideal pose, so any above 0 counts."""
BINS = (0.0, 1e-9, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.995, 1 - 1e-9, 1.01)
"""Edges of the classes of coverage in a calibration curve: 0, parts, and 1."""
BOARD = 1 + 2 * MARGIN / CELLS
"""Side of a board over that of its marker."""
SPARE = 16
"""Pixels drawn around the board and its blur."""


def models() -> dict[str, Model]:
    """Models by name; imported on the first call."""
    from rastercov.reference.models import MODELS
    from rastercov.reference.models.mavrinac import MavrinacParameters

    # Ramps become steps at the thresholds of the requirement.
    steps = MavrinacParameters(ideal_blur=1e6, ideal_incidence_deg=90.0)

    def mavrinac(mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task) -> FloatArray:
        return MODELS["mavrinac"](mesh, camera, poses, task, parameters=steps)

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


@dataclass(frozen=True, eq=False)
class RandomScene:
    """One marker, an obstacle in half of the scenes, and a camera with a random focus."""

    number: int
    scene: PlateScene
    camera: Camera

    @property
    def target(self) -> Plate:
        """The marker."""
        return self.scene.plates[0]


def random_scene(
    seed: int, number: int, obstacle: float = MARKER_SIDE
) -> tuple[RandomScene, np.random.Generator]:
    """The scene of a seed and a number, and the generator of its noise.

    `obstacle` is the size of the occluding board, as the side of a marker that would fit on it.
    """
    rng = np.random.default_rng((seed, number))
    distance = np.exp(rng.uniform(np.log(1.5), np.log(20.0)))
    preset = entries_of("icube-ns4133bu-8mm", {})
    f_number = np.exp(rng.uniform(np.log(1.4), np.log(16.0)))
    nearness = rng.uniform(1e-3, 2.0)
    camera = Camera.from_lens(**preset, f_number=float(f_number), focus_distance=1 / nearness)
    place = rng.uniform(0, 1, 2) * (camera.width, camera.height)
    slope = (place - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    target = Plate(
        plate_pose(
            np.append(slope, 1.0) * distance,
            tilt=np.radians(rng.uniform(0, 75)),
            tilt_axis=rng.uniform(0, 2 * np.pi),
            roll=rng.uniform(0, 2 * np.pi),
        ),
        marker=int(rng.integers(250)),
    )
    plates = [target]
    if rng.random() < 0.5:
        depth = distance * rng.uniform(0.3, 0.9)
        direction, reach = rng.uniform(0, 2 * np.pi), 1.2 * np.sqrt(rng.random())
        # Both boards, at their apparent width, extend half of it to either side.
        offset = reach * BOARD / 2 * (MARKER_SIDE / distance + obstacle / depth)
        aside = slope + offset * np.array((np.cos(direction), np.sin(direction)))
        pose = plate_pose(
            np.append(aside, 1.0) * depth,
            tilt=np.radians(rng.uniform(0, 45)),
            tilt_axis=rng.uniform(0, 2 * np.pi),
            roll=rng.uniform(0, 2 * np.pi),
        )
        plates.append(Plate(pose, side=obstacle))
    return RandomScene(number, PlateScene.of(plates), camera), rng


def cut_out(plate: Plate, camera: Camera) -> Box:
    """Box of the image around a board and its blur."""
    corners = plate.board_corners
    image = to_image(corners, camera)
    spare = SPARE + blur_of(camera, corners[:, 2]).max()
    size = np.array((camera.width, camera.height))
    low = np.clip(np.floor(image.min(axis=0) - spare), 0, size - 1).astype(int)
    high = np.clip(np.ceil(image.max(axis=0) + spare), low + 1, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def photograph(
    renderer: MarkerRenderer, case: RandomScene, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Picture of a random scene, cropped to its marker, (H, W)."""
    box = cut_out(case.target, case.camera)
    depths = np.concatenate([plate.board_corners[:, 2] for plate in case.scene.plates])
    images = SHARP if blur_of(case.camera, depths).max() < 1 else 2 * SHARP
    return sensor(renderer.render(case.scene, case.camera, box=box, images=images), rng)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Prediction and detection of one random scene."""

    number: int  # of the scene
    detected: bool  # True when OpenCV found its marker
    figures: PlateFigures
    coverage: dict[tuple[str, str], float]  # by (requirement, model)

    def is_right(self, requirement: Requirement) -> bool:
        """True when our model predicted the detection."""
        return self.figures.is_met(requirement) == self.detected


@dataclass(frozen=True, eq=False)
class RandomStudy:
    """All random scenes."""

    seed: int
    obstacle: float  # size of the occluding boards, see `random_scene`
    outcomes: tuple[Outcome, ...]  # in the order of their numbers
    scores: tuple[Score, ...]  # of every model by every requirement
    seconds: float

    def score_of(self, model: str, requirement: Requirement) -> Score:
        """The score of a model by a requirement."""
        return next(s for s in self.scores if (s.model, s.requirement) == (model, requirement.name))

    def clear(self, requirement: Requirement) -> tuple[int, int]:
        """Number of right predictions of ours among the clear cases, and of all clear cases."""
        cases = [o for o in self.outcomes if o.figures.is_clear(requirement)]
        return sum(o.is_right(requirement) for o in cases), len(cases)

    def wrong(self, requirement: Requirement) -> list[Outcome]:
        """Wrong predictions of ours, the clearest first."""
        cases = [o for o in self.outcomes if not o.is_right(requirement)]
        return sorted(cases, key=lambda o: -abs(o.figures.decisive(requirement)[1]))


def run_random(
    renderer: MarkerRenderer,
    count: int,
    seed: int,
    asked: dict[str, Model],
    obstacle: float = MARKER_SIDE,
    requirements: Sequence[Requirement] = (THESIS, DETECTOR),
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> RandomStudy:
    """Draw, photograph and score random scenes by each model of `asked`, see `scoring.models`.

    Every model is scored by each of the requirements. `progress` gets the scenes done and the
    scenes in all.
    """
    began = time.perf_counter()
    outcomes = []
    for number in range(count):
        progress(number, count)
        case, rng = random_scene(seed, number, obstacle)
        figures = plate_figures(case.scene, case.camera)[0]
        coverage = {
            (requirement.name, model): value
            for requirement in requirements
            for model, value in coverages(
                case.scene, case.camera, figures, requirement, asked
            ).items()
        }
        found = detect(photograph(renderer, case, rng))
        outcomes.append(Outcome(number, case.target.marker in found, figures, coverage))
    progress(count, count)
    detected = [outcome.detected for outcome in outcomes]
    scores = [
        score(model, requirement, [o.coverage[requirement.name, model] for o in outcomes], detected)
        for requirement in requirements
        for model in (OURS, *asked)
    ]
    return RandomStudy(seed, obstacle, tuple(outcomes), tuple(scores), time.perf_counter() - began)
