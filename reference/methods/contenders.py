"""Contenders of a comparison with their observers, and the reference."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from rastercov.base import ByteArray, FloatArray, IntArray, thread_count
from rastercov.core.camera import Camera, Poses
from rastercov.core.coverage.engine import Engine
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.observer import ROLL, Observer, open_observer
from rastercov.core.mesh import Mesh
from rastercov.core.raster.observation import Observation
from rastercov.reference.methods.convergence import fractions
from rastercov.reference.methods.error_statistics import (
    ROUNDING,
    ErrorStatistics,
    PoseFigures,
    Score,
)

REFERENCES = {"exact": 0.0, "polygons": 1e-7, "rational": 0.0}
"""References and the error of their areas, px^2; "exact" gives its own bounds, too."""


def open_engine(engine: Engine, mesh: Mesh, camera: Camera, supersample: int) -> Observer:
    """Observer of a scene with another `supersample`."""
    return open_observer(mesh, camera, replace(engine, supersample=supersample))


class Timed:
    """An observer with its last observation and its computing time."""

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.seconds, self.poses = 0.0, 0
        self.observation: Observation

    def run(self, poses: FloatArray) -> None:
        """Observe a batch of poses."""
        began = time.perf_counter()
        self.observation = self.observer.observe(poses)
        self.seconds += time.perf_counter() - began
        self.poses += len(poses)


class Contender(Timed):
    """An engine with its observer and error statistics."""

    def __init__(
        self, engine: Engine, observer: Observer, n_worst: int, open_seconds: float
    ) -> None:
        super().__init__(observer)
        self.engine, self.open_seconds = engine, open_seconds
        self.statistics = ErrorStatistics(n_worst)
        self._pass = FacePass(observer.mesh, observer.camera, thread_count(None))
        self._fractions: tuple[FloatArray, FloatArray, ByteArray]

    def run(self, poses: FloatArray) -> None:
        """Observe a batch of poses; the time is that of the areas alone."""
        super().run(poses)
        self._fractions = fractions(self._pass, self.observation, Poses.of(poses))

    def add_pose(
        self,
        pose: int,
        row: int,
        face: IntArray,
        visible: FloatArray,
        area: FloatArray,
        truth_error: FloatArray,
    ) -> None:
        """Add one pose with its true areas: `pose` of all poses, `row` of the batch."""
        value, bound, kind = (figures[row] for figures in self._fractions)
        is_large = area > np.maximum(ROUNDING, truth_error)
        rows = face[is_large]
        compared = PoseFigures(
            face=rows,
            area=area[is_large],
            visible=visible[is_large],
            value=value[rows],
            bound=bound[rows],
            kind=kind[rows],
            visible_pixels=self.observation.visible_pixels[row][rows],
            truth_error=truth_error[is_large],
        )
        self.statistics.add(pose, compared, int((~is_large).sum()))

    def score(self) -> Score:
        """Result of the poses so far."""
        engine, errors, classes = self.engine, self.statistics, self.statistics.all_sizes()
        is_sampled = engine.method == "sampled"
        return Score(
            name=str(engine),
            method=engine.method,
            supersample=engine.supersample,
            roll=ROLL if is_sampled else None,
            info=asdict(self.observer.info),
            all_sizes=classes,
            size_classes=errors.classes(),
            bounds=errors.bounds(),
            missed=errors.missed,
            missed_area=errors.missed_area,
            missed_unsaid=errors.missed_unsaid,
            phantoms=errors.false_positives,
            unjudged=errors.unjudged,
            rms_pixels=float(np.sqrt(errors.square_pixels / max(1, classes.figures))),
            greatest_pixels=errors.greatest_pixels,
            worst=errors.worst,
            missed_faces=errors.missed_faces,
            open_seconds=self.open_seconds,
            seconds_per_pose=self.seconds / max(1, self.poses),
        )


@contextmanager
def open_contender(
    engine: Engine, mesh: Mesh, camera: Camera, poses: FloatArray, n_worst: int
) -> Iterator[Contender]:
    """Open an engine and observe one pose, so that its kernels are compiled."""
    began = time.perf_counter()
    with open_observer(mesh, camera, engine) as observer:
        observer.observe(poses[:1])
        yield Contender(engine, observer, n_worst, time.perf_counter() - began)


class AnalyticReference(Timed):
    """Areas by the analytic method, all faces of a batch of poses at once."""

    error = REFERENCES["exact"]

    def areas(self, row: int, faces: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Visible area and area of the image of faces in a pose of the batch, and their error."""
        seen, error = self.observation, self.observation.area_error[row][faces]
        self.error = max(self.error, float(error.max(initial=0.0)))
        return seen.visible_pixels[row][faces], seen.drawn_pixels[row][faces], error


class ReferenceModule:
    """Areas by a module of `rastercov.reference`, for selected faces only."""

    def __init__(self, against: str, mesh: Mesh, camera: Camera) -> None:
        from rastercov.reference import polygons, rational

        self._module: Any = polygons if against == "polygons" else rational
        self._scene = mesh, camera
        self.error = REFERENCES[against]
        self.seconds, self.poses = 0.0, 0
        self._batch = np.empty((0, 4, 4))

    def run(self, poses: FloatArray) -> None:
        """Take a batch of poses, whose areas are computed when they are asked for."""
        self._batch = poses

    def areas(self, row: int, faces: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Visible area and area of the image of faces in a pose of the batch, and their error."""
        began = time.perf_counter()
        visible = self._module.visible_area(*self._scene, self._batch[row], faces)
        area = self._module.image_area(*self._scene, self._batch[row], faces)
        self.seconds += time.perf_counter() - began
        self.poses += 1
        return visible, area, np.full(len(area), self.error)


@contextmanager
def open_reference(
    against: str, mesh: Mesh, camera: Camera
) -> Iterator[AnalyticReference | ReferenceModule]:
    """Open the reference of a comparison."""
    if against != "exact":
        yield ReferenceModule(against, mesh, camera)
        return
    with open_observer(mesh, camera, "exact") as observer:
        yield AnalyticReference(observer)
