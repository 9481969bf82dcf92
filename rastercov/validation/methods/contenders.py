"""Who takes part in a comparison: candidates with their observers, and the truth.

Part of `compare`.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.criteria import ViewOfFaces
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.observer import (
    METHODS,
    ROLL,
    Observation,
    Observer,
    figures,
    open_observer,
)
from rastercov.raster.contract import MAX_SUPERSAMPLE
from rastercov.validation.methods.error_statistics import ROUNDING, Judged, Tally
from rastercov.validation.methods.results import Score

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TRUTHS = {"exact": 0.0, "polygons": 1e-7, "rational": 0.0}
"""What may be the truth, and how far off its areas may be, px^2, unless it says so itself."""


@dataclass(frozen=True)
class Candidate:
    """A way to find visibility.

    Attributes
    ----------
    method : str
        As for `open_observer`.
    device : str
        For method "sampled": auto, cpu, gl, or an OpenGL device by its name.
    supersample : int
        For method "sampled".
    """

    method: str
    device: str = "auto"
    supersample: int = 1

    @classmethod
    def parse(cls, text: str) -> "Candidate":
        """Read METHOD[:DEVICE][@S], such as certified, sampled:cpu or sampled:gl@4.

        Raises
        ------
        ConfigError
            For a method that does not exist, or one without samples that is given a device or S.
        """
        rest, at, scale = text.partition("@")
        method, colon, device = rest.partition(":")
        if method not in METHODS:
            raise ConfigError(
                f"a method to compare is {', '.join(METHODS)}, got {text!r}; "
                "sampled takes a device and samples a side, as in sampled:cpu@4"
            )
        if method != "sampled" and (at or colon):
            raise ConfigError(
                f"{method} has no samples: it takes no device and no @S, got {text!r}"
            )
        if colon and not device:
            raise ConfigError(f"a device is wanted after the colon, such as sampled:cpu: {text!r}")
        if at and not (scale.isdecimal() and 1 <= int(scale[:9]) <= MAX_SUPERSAMPLE):
            raise ConfigError(
                f"samples a side must be a whole number 1 to {MAX_SUPERSAMPLE}, got {text!r}"
            )
        return cls(method, device or "auto", int(scale) if at else 1)

    @property
    def name(self) -> str:
        """What `parse` reads."""
        device = f":{self.device}" if self.device != "auto" else ""
        return self.method + device + (f"@{self.supersample}" if self.supersample > 1 else "")

    def open(self, mesh: Mesh, camera: Camera, supersample: int | None = None, /) -> Observer:
        """Observer of a scene, with another `supersample` if one is given."""
        options: dict[str, Any] = {}
        if self.method == "sampled":
            options = {"backend": self.device, "supersample": supersample or self.supersample}
            if self.device not in ("auto", "cpu", "gl"):
                options |= {"backend": "gl", "device": self.device}
        return open_observer(mesh, camera, self.method, **options)


class Entrant:
    """A candidate at work: its observer, its tally and its watch."""

    def __init__(
        self, candidate: Candidate, observer: Observer, n_worst: int, open_seconds: float
    ) -> None:
        self.candidate, self.observer, self.open_seconds = candidate, observer, open_seconds
        self.tally = Tally(n_worst)
        self.seconds, self.poses = 0.0, 0
        self.seen: Observation

    def look(self, poses: FloatArray) -> None:
        """Observe a batch of poses."""
        started = time.perf_counter()
        self.seen = self.observer.observe(poses)
        self.seconds += time.perf_counter() - started
        self.poses += len(poses)

    def judge(
        self,
        pose: int,
        row: int,
        view: ViewOfFaces,
        face: IntArray,
        visible: FloatArray,
        area: FloatArray,
        truth_error: FloatArray,
    ) -> None:
        """Take in one pose of the batch: `pose` of all, `row` of the batch, and its true areas."""
        value, bound, kind = figures(view, self.seen, row)
        is_judged = area > np.maximum(ROUNDING, truth_error)
        rows = face[is_judged]
        judged = Judged(
            face=rows,
            area=area[is_judged],
            visible=visible[is_judged],
            value=value[rows],
            bound=bound[rows],
            kind=kind[rows],
            visible_pixels=self.seen.visible_pixels[row][rows],
            truth_error=truth_error[is_judged],
        )
        self.tally.add(pose, judged, int((~is_judged).sum()))

    def score(self) -> Score:
        """Give what came out so far."""
        candidate, tally, classes = self.candidate, self.tally, self.tally.all_sizes()
        is_sampled = candidate.method == "sampled"
        return Score(
            name=candidate.name,
            method=candidate.method,
            supersample=candidate.supersample,
            roll=ROLL if is_sampled else None,
            info=asdict(self.observer.info),
            all_sizes=classes,
            size_classes=tally.classes(),
            bounds=tally.bounds(),
            missed=tally.missed,
            missed_area=tally.missed_area,
            missed_unsaid=tally.missed_unsaid,
            phantoms=tally.phantoms,
            unjudged=tally.unjudged,
            rms_pixels=float(np.sqrt(tally.square_pixels / max(1, classes.figures))),
            greatest_pixels=tally.greatest_pixels,
            worst=tally.worst,
            missed_faces=tally.missed_faces,
            open_seconds=self.open_seconds,
            seconds_per_pose=self.seconds / max(1, self.poses),
        )


@contextmanager
def entered(
    candidate: Candidate, mesh: Mesh, camera: Camera, poses: FloatArray, n_worst: int
) -> Iterator[Entrant]:
    """A candidate that has observed a pose: what is compiled or kept for later poses is there."""
    started = time.perf_counter()
    with candidate.open(mesh, camera) as observer:
        observer.observe(poses[:1])
        yield Entrant(candidate, observer, n_worst, time.perf_counter() - started)


class AnalyticTruth:
    """Areas by the analytic method, all faces of a batch of poses at once."""

    def __init__(self, observer: Observer) -> None:
        self._observer, self.error = observer, TRUTHS["exact"]
        self.seconds, self.poses = 0.0, 0
        self._seen: Observation

    def look(self, poses: FloatArray) -> None:
        """Observe a batch of poses."""
        started = time.perf_counter()
        self._seen = self._observer.observe(poses)
        self.seconds += time.perf_counter() - started
        self.poses += len(poses)

    def areas(self, row: int, faces: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Visible area and area of the image of faces in a pose of the batch, and their error."""
        seen, error = self._seen, self._seen.blur[row][faces]
        self.error = max(self.error, float(error.max(initial=0.0)))
        return seen.visible_pixels[row][faces], seen.drawn_pixels[row][faces], error


class ReferenceTruth:
    """Areas by the authority, for the faces asked for only."""

    def __init__(self, against: str, mesh: Mesh, camera: Camera) -> None:
        from rastercov.reference import polygons, rational

        self._module: Any = polygons if against == "polygons" else rational
        self._scene = mesh, camera
        self.error = TRUTHS[against]
        self.seconds, self.poses = 0.0, 0
        self._batch = np.empty((0, 4, 4))

    def look(self, poses: FloatArray) -> None:
        """Observe a batch of poses."""
        self._batch = poses

    def areas(self, row: int, faces: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Visible area and area of the image of faces in a pose of the batch, and their error."""
        started = time.perf_counter()
        visible = self._module.visible_area(*self._scene, self._batch[row], faces)
        area = self._module.image_area(*self._scene, self._batch[row], faces)
        self.seconds += time.perf_counter() - started
        self.poses += 1
        return visible, area, np.full(len(area), self.error)


@contextmanager
def open_truth(
    against: str, mesh: Mesh, camera: Camera
) -> Iterator[AnalyticTruth | ReferenceTruth]:
    """What the candidates are held against."""
    if against != "exact":
        yield ReferenceTruth(against, mesh, camera)
        return
    with open_observer(mesh, camera, "exact") as observer:
        yield AnalyticTruth(observer)
