"""Results of a comparison: errors by face size, bounds by kind, faces, a verdict."""

import math
from dataclasses import dataclass
from typing import Any

from rastercov.validation.methods.convergence import Convergence

MUST_HOLD = 0.999
"""Share of partly hidden faces for which a statistical bound must hold."""


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
            what = f"{self.figures:,} {self.kind} figures"
            wrong = f"{broken:,} of {what} are wrong"
            return f"{self.candidate}: " + (wrong if broken else f"all {what} are right")
        if not self.figures:
            return f"{self.candidate}: no face is partly hidden"
        # Never rounded up to all of them.
        share = math.floor(100_000 * self.held / self.figures) / 1000
        few = "; too few to tell" if self.passed is None else ""
        what = f"{self.figures:,} partly hidden faces (must be {100 * self.must:g} %{few})"
        return f"{self.candidate}: bound held for {share:g} % of {what}"


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
    run: dict[str, Any]  # provenance: mesh, camera, poses, versions
