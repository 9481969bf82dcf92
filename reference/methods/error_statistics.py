"""Errors of one visibility method, added up pose by pose: by face size, by kind of bound.

`ErrorStatistics` holds histograms, sums and the worst few faces: its memory does not depend on the
number of poses and faces.
"""

import math
from dataclasses import dataclass

import numpy as np

from rastercov.base import BoolArray, ByName, ByteArray, FloatArray, IntArray, frozen_record
from rastercov.core.raster.contract import KIND_WORDS, BoundKind
from rastercov.reference.methods.convergence import Convergence

MUST_HOLD = 0.999
"""Share of partly hidden faces for which a statistical bound must hold."""
SIZES = (0.0, 0.1, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, math.inf)
"""Limits of the size classes: area of a face inside the image, px^2."""
PER_DECADE = 10
"""Bins of the histograms of errors, a power of ten."""
DECADES = 18
"""Powers of ten of the histograms below the largest error of 1; smaller errors count as 0."""
N_BINS = PER_DECADE * DECADES + 2  # one for 0, one for more than 1
ROUNDING = 1e-9
"""Area below which a face cannot be distinguished from rounding, px^2."""
FACE_FIGURES = ("area", "visible", "truth", "value", "bound", "visible_pixels")
"""Numbers of a kept face."""
QUOTIENT_ROUNDING = 1e-12
"""Rounding of a quotient of two areas."""


@dataclass(frozen=True)
class SizeClass:
    """Errors of the visible fraction of faces whose images have similar areas."""

    low: float  # area of the image of a face, px^2
    high: float  # the same; it is not in the class
    figures: int  # faces over all poses
    partly_hidden: int  # those neither wholly visible nor hidden
    rms: float  # of |value - truth| over all, as the next two
    mean: float
    greatest: float
    rms_partly_hidden: float
    mean_bound_partly_hidden: float
    median: float  # of the error over all, to the next tenth of a power of ten
    percentile_99: float
    held: int  # figures whose error was within their bound
    missed: int  # visible faces whose figure is 0
    errors: tuple[tuple[float, int], ...]  # histogram: upper end of a bin, errors in it


@dataclass(frozen=True)
class BoundCheck:
    """Validity and tightness of the bounds of one kind."""

    kind: str  # name of `BoundKind` in lower case
    figures: int
    held: int  # figures whose error was within their bound
    partly_hidden: int
    partly_hidden_held: int
    median_ratio: float | None  # of |error| / bound over partly hidden faces with a bound above 0
    greatest_ratio: float | None
    ratios: tuple[tuple[float, int], ...]  # histogram of these, as `SizeClass.errors`


@dataclass(frozen=True)
class FaceError:
    """One figure and its truth."""

    pose: int  # row of the poses
    face: int  # row of `mesh.faces`
    area: float  # true area of the face inside the image, px^2
    visible: float  # true area of its visible part, px^2
    truth: float  # true visible fraction
    value: float  # visible fraction by the method
    bound: float
    kind: str  # of the bound
    held: bool  # True when the error was within the bound
    visible_pixels: float  # visible area by the method, px^2


@dataclass(frozen=True)
class Score:
    """Errors, bounds and time of one candidate."""

    name: str
    method: str
    supersample: int
    roll: float | None  # rotation of its sample grid, radians; None without samples
    info: dict[str, str]  # `RasterizerInfo` of its observer
    all_sizes: SizeClass
    size_classes: tuple[SizeClass, ...]
    bounds: tuple[BoundCheck, ...]  # one for each kind of bound
    missed: int  # visible faces whose figure is 0
    missed_area: float  # their visible area, px^2
    missed_unsaid: int  # those of them outside their bound
    phantoms: int  # false positives: hidden faces whose figure is above 0
    unjudged: int  # faces whose image is smaller than the error of the truth
    rms_pixels: float  # error of the visible area, px^2
    greatest_pixels: float
    worst: tuple[FaceError, ...]  # faces with the greatest errors
    missed_faces: tuple[FaceError, ...]  # missed faces with the largest visible areas
    open_seconds: float  # to open it and observe one pose, including compilation
    seconds_per_pose: float  # after that


@dataclass(frozen=True)
class Check:
    """Check of the bounds of one kind of a candidate."""

    candidate: str
    kind: str
    held: int
    figures: int
    must: float  # share that must hold
    passed: bool | None  # None with too few figures for a verdict

    def __str__(self) -> str:
        """The check as a sentence."""
        broken = self.figures - self.held
        if self.kind != "statistical":
            what = f"{self.figures:,} {KIND_WORDS[self.kind]} values"
            wrong = f"{broken:,} of {what} violate their bounds"
            return f"{self.candidate}: " + (
                wrong if broken else f"all {what} are within their bounds"
            )
        if not self.figures:
            return f"{self.candidate}: no face is partly hidden"
        # Never rounded up to all of them.
        share = math.floor(100_000 * self.held / self.figures) / 1000
        few = "; too few to decide" if self.passed is None else ""
        what = f"{self.figures:,} partly hidden pose-face pairs ({100 * self.must:g} % required"
        return f"{self.candidate}: bound held for {share:g} % of {what}{few})"


@dataclass(frozen=True)
class Comparison:
    """Candidates compared with a reference."""

    against: str  # the reference: exact, polygons or rational
    truth_error: float  # error of its areas, px^2
    truth_seconds_per_pose: float
    faces: int  # of the mesh
    poses: int  # requested
    poses_done: int  # compared before the end or an interrupt
    passed: bool  # True when no check failed
    checks: tuple[Check, ...]
    scores: tuple[Score, ...]  # one for each candidate
    convergence: tuple[Convergence, ...]  # of the rasterisers among them
    interrupted: bool
    run: ByName  # provenance: mesh, camera, poses, versions


@frozen_record
class PoseFigures:
    """Figures of one pose and their truth, (N,) each, for faces large enough to be compared."""

    face: IntArray
    area: FloatArray
    visible: FloatArray
    value: FloatArray
    bound: FloatArray
    kind: ByteArray
    visible_pixels: FloatArray
    truth_error: FloatArray

    @property
    def truth(self) -> FloatArray:
        """True visible fraction."""
        return np.minimum(self.visible / self.area, 1.0)

    @property
    def error(self) -> FloatArray:
        """|value - truth|; 1 for a figure that is no number."""
        return np.nan_to_num(np.abs(self.value - self.truth), nan=1.0)

    @property
    def least(self) -> FloatArray:
        """Area that cannot be distinguished from rounding, px^2."""
        return np.maximum(ROUNDING, self.truth_error) + ROUNDING * self.area

    def is_partly_hidden(self) -> BoolArray:
        """Mask of faces neither wholly visible nor hidden."""
        return (self.visible > self.least) & (self.visible < self.area - self.least)

    def is_missed(self) -> BoolArray:
        """Mask of visible faces whose figure is 0."""
        return (self.value == 0) & (self.visible > self.least)

    def is_false_positive(self) -> BoolArray:
        """Mask of hidden faces whose figure is above 0."""
        return (self.value * self.area > self.least) & (self.visible <= self.least)

    def is_held(self) -> BoolArray:
        """Mask of figures within their bound plus the error of the truth.

        The visible area of certain figures must be right too, and certified ones must be 0 or 1.
        """
        slack = QUOTIENT_ROUNDING + 2 * self.truth_error / self.area
        held: BoolArray = np.abs(self.value - self.truth) <= self.bound + slack
        pixels = np.abs(self.visible_pixels - self.visible)
        room = (self.bound + QUOTIENT_ROUNDING) * self.area + ROUNDING + self.truth_error
        held &= (pixels <= room) | (self.kind == BoundKind.STATISTICAL)
        held &= (self.value == 0) | (self.value == 1) | (self.kind != BoundKind.CERTIFIED)
        return held


Kept = tuple[bool, float, FaceError]
"""True for one that comes last, its weight times -1, and the face."""


class ErrorStatistics:
    """Sums over poses for one method; the `n_worst` faces with the greatest errors are kept."""

    def __init__(self, n_worst: int) -> None:
        n_classes = len(SIZES) - 1
        self.n_worst = n_worst
        self.unjudged = self.missed = self.missed_unsaid = self.false_positives = 0
        self.missed_area = self.square_pixels = self.greatest_pixels = 0.0
        self._errors = np.zeros((n_classes, N_BINS), np.int64)
        self._counts = np.zeros((n_classes, 4), np.int64)  # all, partly hidden, held, missed
        self._sums = np.zeros((n_classes, 4))  # error^2, error; partly hidden: error^2, bound
        self._greatest = np.zeros(n_classes)
        self._kinds = np.zeros((len(BoundKind), 4), np.int64)  # all, held; partly hidden: all, held
        self._ratios = np.zeros((len(BoundKind), N_BINS), np.int64)
        self._greatest_ratio = np.full(len(BoundKind), -1.0)
        self._worst: list[Kept] = []
        self._missed: list[Kept] = []

    def add(self, pose: int, figures: PoseFigures, unjudged: int) -> None:
        """Add the figures of one pose, and the number of faces too small to compare."""
        error, held, kind = figures.error, figures.is_held(), figures.kind
        partly, missed = figures.is_partly_hidden(), figures.is_missed()
        self.unjudged += unjudged
        self.missed += int(missed.sum())
        self.missed_area += float(figures.visible[missed].sum())
        self.missed_unsaid += int((missed & ~held).sum())
        self.false_positives += int(figures.is_false_positive().sum())
        pixels = np.nan_to_num(np.abs(figures.visible_pixels - figures.visible), nan=math.inf)
        self.square_pixels += float((pixels**2).sum())
        self.greatest_pixels = max(self.greatest_pixels, float(pixels.max(initial=0.0)))

        size, every = np.searchsorted(SIZES, figures.area, side="right") - 1, np.ones_like(held)
        np.add.at(self._errors, (size, _bins(error)), 1)
        np.add.at(self._counts, size, np.stack((every, partly, held, missed), axis=1))
        terms = (error**2, error, error**2 * partly, figures.bound * partly)
        np.add.at(self._sums, size, np.stack(terms, axis=1))
        np.maximum.at(self._greatest, size, error)
        np.add.at(self._kinds, kind, np.stack((every, held, partly, partly & held), axis=1))
        counted = partly & (figures.bound > 0)
        with np.errstate(over="ignore"):
            ratio = error[counted] / figures.bound[counted]
        np.add.at(self._ratios, (kind[counted], _bins(ratio)), 1)
        np.maximum.at(self._greatest_ratio, kind[counted], ratio)
        # The error of a face smaller than a pixel counts by its area, and one of rounding not at
        # all. A bound of 1 claims nothing; such faces are among the missed ones.
        weight = error * np.minimum(figures.area, 1.0)
        claimed = ~held | ((figures.bound < 1) & (weight > QUOTIENT_ROUNDING))
        self._worst = self._keep_figures(
            self._worst, pose, figures, held, np.where(claimed, weight, -1.0)
        )
        seen = np.where(missed, figures.visible, -1.0)
        self._missed = self._keep_figures(self._missed, pose, figures, every, seen)

    def _keep_figures(
        self,
        kept: list[Kept],
        pose: int,
        figures: PoseFigures,
        last: BoolArray,
        weight: FloatArray,
    ) -> list[Kept]:
        """The faces of greatest weight, those of `last` after all others; none below 0."""
        best = np.lexsort((figures.face, -weight, last))[: self.n_worst]
        held = figures.is_held()
        face_errors = [
            FaceError(
                pose=pose,
                face=int(figures.face[at]),
                kind=BoundKind(figures.kind[at]).name.lower(),
                held=bool(held[at]),
                **{name: float(getattr(figures, name)[at]) for name in FACE_FIGURES},
            )
            for at in best
        ]
        order = zip(last[best].tolist(), (-weight[best]).tolist(), face_errors, strict=True)
        new = [entry for entry in order if entry[1] <= 0]
        return sorted([*kept, *new], key=lambda entry: entry[:2])[: self.n_worst]

    @property
    def worst(self) -> tuple[FaceError, ...]:
        """Broken bounds first, then the greatest errors among figures with a bound below 1."""
        return tuple(face for *_, face in self._worst)

    @property
    def missed_faces(self) -> tuple[FaceError, ...]:
        """Missed faces with the largest visible areas."""
        return tuple(face for *_, face in self._missed)

    def classes(self) -> tuple[SizeClass, ...]:
        """Size classes of `SIZES` that have a face."""
        every = range(len(SIZES) - 1)
        return tuple(self._class(slice(i, i + 1)) for i in every if self._counts[i, 0])

    def all_sizes(self) -> SizeClass:
        """All size classes as one."""
        return self._class(slice(0, len(SIZES) - 1))

    def bounds(self) -> tuple[BoundCheck, ...]:
        """Checks of the kinds of bound that occurred."""
        return tuple(self._check(kind) for kind in BoundKind if self._kinds[kind, 0])

    def _check(self, kind: BoundKind) -> BoundCheck:
        figures, held, partly_hidden, partly_hidden_held = self._kinds[kind].tolist()
        greatest = float(self._greatest_ratio[kind])
        is_known = greatest >= 0
        return BoundCheck(
            kind=kind.name.lower(),
            figures=figures,
            held=held,
            partly_hidden=partly_hidden,
            partly_hidden_held=partly_hidden_held,
            median_ratio=_quantile(self._ratios[kind], 0.5) if is_known else None,
            greatest_ratio=greatest if is_known else None,
            ratios=_histogram(self._ratios[kind]),
        )

    def _class(self, rows: slice) -> SizeClass:
        n, partly, held, missed = self._counts[rows].sum(axis=0).tolist()
        square, total, square_partly, bound_partly = self._sums[rows].sum(axis=0).tolist()
        errors = self._errors[rows].sum(axis=0)
        return SizeClass(
            low=SIZES[rows.start],
            high=SIZES[rows.stop],
            figures=n,
            partly_hidden=partly,
            rms=math.sqrt(square / max(n, 1)),
            mean=total / max(n, 1),
            greatest=float(self._greatest[rows].max()),
            rms_partly_hidden=math.sqrt(square_partly / max(partly, 1)),
            mean_bound_partly_hidden=bound_partly / max(partly, 1),
            median=_quantile(errors, 0.5),
            percentile_99=_quantile(errors, 0.99),
            held=held,
            missed=missed,
            errors=_histogram(errors),
        )


def upper_end(index: int) -> float:
    """Largest error in a bin of the histograms; the last one is open."""
    if index == 0:
        return 0.0
    return math.inf if index == N_BINS - 1 else float(10 ** (index / PER_DECADE - DECADES))


def _bins(values: FloatArray) -> IntArray:
    """Bin of each value, 0 for values below 10^-DECADES."""
    with np.errstate(divide="ignore"):
        place = np.ceil(PER_DECADE * (np.log10(values) + DECADES) - 1e-9)
    return np.clip(place, 0, N_BINS - 1).astype(np.int64)


def _histogram(counts: IntArray) -> tuple[tuple[float, int], ...]:
    filled = np.flatnonzero(counts).tolist()
    return tuple((upper_end(index), int(counts[index])) for index in filled)


def _quantile(counts: IntArray, share: float) -> float:
    """Upper end of the bin that holds a quantile; 0 without counts."""
    if not counts.any():
        return 0.0
    return upper_end(int(np.searchsorted(np.cumsum(counts), share * counts.sum())))
