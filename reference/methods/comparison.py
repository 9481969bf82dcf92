"""Comparison of visibility methods with a reference, and a verdict on their bounds.

Observers and the reference get the same poses; errors are added up pose by pose, so that memory
does not grow with poses. Compared are the visible fraction (3.14) with its bound and the visible
area in px^2 of all faces in view from the front, including those partly outside the image.

`report.write_comparison` writes the page.

Contenders of a comparison with their observers, and the reference.
"""

import math
import platform
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ByName, ByteArray, ConfigError, FloatArray, IntArray, thread_count
from rastercov.base.interrupts import hold_interrupts
from rastercov.core.camera import Camera, Poses, valid_poses
from rastercov.core.coverage.coverage import ROLL, Observer, open_observer
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.shards import provenance_of
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import Observation
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.methods.convergence import N_POSES as SWEPT_POSES
from rastercov.reference.methods.convergence import (
    SWEEPS,
    Convergence,
    KnownFaces,
    converge,
    fractions,
    levels,
)
from rastercov.reference.methods.error_statistics import (
    MUST_HOLD,
    ROUNDING,
    Check,
    Comparison,
    ErrorStatistics,
    PoseFigures,
    Score,
)
from rastercov.shards import Progress, silent

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


CANDIDATES = ("certified", "sampled", "sampled@4")
"""Methods that are compared by default."""
MIN_FACES = 1000
"""Least number of partly hidden faces for a positive verdict on a statistical bound."""
SIGNIFICANCE = 0.01
"""Largest probability that a valid bound fails its check."""
PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs observed at a time: about 10 MB for each candidate."""
POSES_A_BATCH = 16
"""Most poses observed at a time."""


def compare(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    candidates: Sequence[str | Engine] = CANDIDATES,
    against: str = "exact",
    *,
    worst: int = 6,
    convergence: bool = True,
    progress: Progress = silent,
) -> Comparison:
    """Errors of several visibility methods, and checks of their bounds.

    An interrupt (Ctrl-C) ends it after the current pose; the comparison then covers the poses so
    far. Before the first pose is done, the interrupt is raised.

    Parameters
    ----------
    mesh, camera
        Any scene.
    poses : (P, 4, 4) array_like
        world_from_camera.
    candidates : sequence of str or Engine
        Engines; strings as for `Engine.parse`.
    against : {"exact", "polygons", "rational"}
        The reference: the analytic method; polygon Booleans or exact rational arithmetic, which
        share no code with it and take milliseconds per face.
    worst : int
        Faces with the greatest errors to keep for each candidate.
    convergence : bool
        Measure errors over the density of samples, too.
    progress : callable
        Called with the poses done and the poses in all, those of `convergence` among them.

    Raises
    ------
    ConfigError
        For an unknown candidate or reference, a candidate that is the reference or comes twice, or
        an empty comparison.
    PoseError
        For a pose that is not a rigid transform.
    """
    named = [Engine.parse(c) if isinstance(c, str) else c for c in candidates]
    matrices = valid_poses(poses)
    _check_arguments(named, against, matrices)
    swept = {c.device: replace(c, supersample=1) for c in named if c.method == "sampled"}.values()
    chosen = np.unique(np.linspace(0, len(matrices) - 1, SWEPT_POSES).astype(int)).tolist()
    sweeps = [(c, sweep) for c in swept for sweep in SWEEPS if convergence]
    total = len(matrices) + len(chosen) * sum(len(levels(sweep, camera)) for _, sweep in sweeps)
    progress(0, total)
    counter = count(1)

    def step() -> None:
        progress(next(counter), total)

    with ExitStack() as stack:
        contenders = [
            stack.enter_context(open_contender(c, mesh, camera, matrices, worst)) for c in named
        ]
        reference = stack.enter_context(open_reference(against, mesh, camera))
        own = chosen if sweeps else []
        scene = mesh, camera, matrices
        done, known, interrupted = _measure(*scene, reference, contenders, own, step)
    convergences: list[Convergence] = []
    interrupted = interrupted or _converge(sweeps, mesh, camera, known, step, convergences)
    scores = tuple(contender.score() for contender in contenders)
    if not any(score.all_sizes.figures for score in scores):
        raise ConfigError("expected a face in view from the front, got none; change the poses")
    checks = [check for score in scores for check in _checks(score)]
    return Comparison(
        against=against,
        truth_error=reference.error,
        truth_seconds_per_pose=reference.seconds / reference.poses,
        faces=mesh.n_faces,
        poses=len(matrices),
        poses_done=done,
        passed=all(check.passed is not False for check in checks),
        checks=tuple(checks),
        scores=scores,
        convergence=tuple(convergences),
        interrupted=interrupted,
        run=_provenance(mesh, camera, matrices),
    )


def _measure(
    mesh: Mesh,
    camera: Camera,
    poses: FloatArray,
    reference: AnalyticReference | ReferenceModule,
    contenders: Sequence[Contender],
    chosen: Collection[int],
    step: Callable[[], None],
) -> tuple[int, list[KnownFaces], bool]:
    """Add the poses to all contenders: number of poses, faces of chosen ones, and if interrupted.

    The interrupt is raised where it comes before the first pose is done.
    """
    done, known = 0, list[KnownFaces]()
    at_once = max(1, min(POSES_A_BATCH, PAIRS_A_BATCH // max(1, mesh.n_faces)))
    try:
        for start in range(0, len(poses), at_once):
            of_batch = poses[start : start + at_once]
            for observed in (*contenders, reference):
                observed.run(of_batch)
            for row, pose in enumerate(of_batch):
                face = _in_view(mesh, camera, pose)
                areas = reference.areas(row, face)
                with hold_interrupts():
                    for contender in contenders:
                        contender.add_pose(start + row, row, face, *areas)
                    if start + row in chosen:
                        known.append(_hide_partly(pose, face, *areas))
                    done += 1
                step()
    except KeyboardInterrupt:
        if not done:
            raise
        return done, known, True
    return done, known, False


def _in_view(mesh: Mesh, camera: Camera, pose: FloatArray) -> IntArray:
    """Faces that are seen from the front, in part at least."""
    view = face_geometry(mesh, camera, pose)
    return np.flatnonzero(view.is_front & (view.in_view_fraction > 0))


def _converge(
    sweeps: Sequence[tuple[Engine, str]],
    mesh: Mesh,
    camera: Camera,
    known: Sequence[KnownFaces],
    step: Callable[[], None],
    convergences: list[Convergence],
) -> bool:
    """Add the errors of each sweep to `convergences`; True after an interrupt, which ends it."""
    try:
        for engine, sweep in sweeps:
            opener = partial(open_engine, engine)
            convergences.append(converge(str(engine), opener, sweep, mesh, camera, known, step))
    except KeyboardInterrupt:
        return True
    return False


def _check_arguments(candidates: Sequence[Engine], against: str, poses: FloatArray) -> None:
    if against not in REFERENCES:
        raise ConfigError(f"expected a reference, got {against!r}; use {', '.join(REFERENCES)}")
    names = [str(engine) for engine in candidates]
    if not names:
        raise ConfigError("expected a method to compare, got none; name one")
    if twice := sorted(name for name in set(names) if names.count(name) > 1):
        raise ConfigError(f"expected each method once, got {twice[0]} twice; leave one out")
    if against in names:
        raise ConfigError(
            f"expected a method other than the reference {against}, got it; use polygons"
        )
    if not len(poses):
        raise ConfigError("expected poses, got none; give some")


def _checks(score: Score) -> Iterator[Check]:
    for bound in score.bounds:
        if bound.kind == "statistical":
            held, n = bound.partly_hidden_held, bound.partly_hidden
            yield Check(score.name, bound.kind, held, n, MUST_HOLD, _often_enough(held, n))
        else:
            passed = bound.held == bound.figures
            yield Check(score.name, bound.kind, bound.held, bound.figures, 1.0, passed)


def _often_enough(held: int, n: int) -> bool | None:
    """True when a bound held for `MUST_HOLD` of n faces; None where the result may be chance."""
    broken, expected = n - held, (1 - MUST_HOLD) * n
    if held >= MUST_HOLD * n:
        return True if n >= MIN_FACES else None
    if broken > expected + 10 * math.sqrt(expected) + 20:
        return False
    # Poisson: probability of this many or more broken bounds at the allowed rate.
    fewer = sum(expected**k / math.factorial(k) for k in range(broken)) * math.exp(-expected)
    return False if 1 - fewer < SIGNIFICANCE else None


def _hide_partly(
    pose: FloatArray, face: IntArray, visible: FloatArray, area: FloatArray, error: FloatArray
) -> KnownFaces:
    least = np.maximum(ROUNDING, error) + ROUNDING * area
    rows = (area >= 1) & (visible > least) & (visible < area - least)
    return KnownFaces(pose, face[rows], area[rows], visible[rows] / area[rows])


def _provenance(mesh: Mesh, camera: Camera, poses: FloatArray) -> ByName:
    packages = ("numpy", "shapely")
    entries = provenance_of(mesh, camera, poses, packages=packages)
    del entries["scene"]
    return entries | {"machine": {"system": platform.platform(), "processor": platform.machine()}}
