"""Results of a comparison: errors by face size, bounds by kind, faces, a verdict."""

import math
from dataclasses import dataclass
from typing import Any

from rastercov.validation.methods.convergence import Convergence

MUST_HOLD = 0.999
"""Share of partly hidden faces for which a statistical bound must hold."""


@dataclass(frozen=True)
class SizeClass:
    """Errors of the visible fraction of faces whose images have similar areas.

    Attributes
    ----------
    low, high : float
        Area of the image of a face, px^2; `high` is not in the class.
    figures, partly_hidden : int
        Faces over all poses, and those neither wholly visible nor hidden.
    rms, mean, greatest : float
        Of |value - truth|, over all.
    rms_partly_hidden, mean_bound_partly_hidden : float
        RMS error and mean bound of partly hidden faces.
    median, percentile_99 : float
        Of the error over all, to the next tenth of a power of ten.
    held : int
        Figures whose error was within their bound.
    missed : int
        Visible faces whose figure is 0.
    errors : tuple of (float, int)
        Histogram: upper end of a bin, and the number of errors in it.
    """

    low: float
    high: float
    figures: int
    partly_hidden: int
    rms: float
    mean: float
    greatest: float
    rms_partly_hidden: float
    mean_bound_partly_hidden: float
    median: float
    percentile_99: float
    held: int
    missed: int
    errors: tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class BoundCheck:
    """Validity and tightness of the bounds of one kind.

    Attributes
    ----------
    kind : str
        Name of `Kind` in lower case.
    figures, held : int
        All figures of that kind, and those whose error was within their bound.
    partly_hidden, partly_hidden_held : int
        The same for partly hidden faces.
    median_ratio, greatest_ratio : float or None
        Of |error| / bound over partly hidden faces with a bound greater than 0.
    ratios : tuple of (float, int)
        Histogram of these, as `SizeClass.errors`.
    """

    kind: str
    figures: int
    held: int
    partly_hidden: int
    partly_hidden_held: int
    median_ratio: float | None
    greatest_ratio: float | None
    ratios: tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class FaceError:
    """One figure and its truth; areas in px^2.

    Attributes
    ----------
    pose, face : int
        Row of the poses, row of `mesh.faces`.
    area, visible : float
        True area of the face inside the image, and of its visible part.
    truth, value, bound : float
        True visible fraction, the figure, and its bound.
    kind : str
        Of the bound.
    held : bool
        True when the error was within the bound.
    visible_pixels : float
        Visible area by the method, px^2.
    """

    pose: int
    face: int
    area: float
    visible: float
    truth: float
    value: float
    bound: float
    kind: str
    held: bool
    visible_pixels: float


@dataclass(frozen=True)
class Score:
    """Errors, bounds and time of one candidate.

    Attributes
    ----------
    name, method, supersample : str, str, int
        The candidate.
    roll : float or None
        Rotation of its sample grid, radians; None without samples.
    info : dict
        `RasterizerInfo` of its observer.
    all_sizes, size_classes
        Errors of the visible fraction over all faces, and by the size of their images.
    bounds : tuple of BoundCheck
        One for each kind of bound.
    missed, missed_area, missed_unsaid : int, float, int
        Visible faces whose figure is 0; their visible area, px^2; and the number of those outside
        their bound.
    phantoms : int
        False positives: hidden faces whose figure is above 0.
    unjudged : int
        Faces whose image is smaller than the error of the truth.
    rms_pixels, greatest_pixels : float
        Error of the visible area, px^2.
    worst, missed_faces : tuple of FaceError
        Those with the greatest errors, and missed faces with the largest visible areas.
    open_seconds, seconds_per_pose : float
        To open it and observe one pose, including compilation; and for each pose after that.
    """

    name: str
    method: str
    supersample: int
    roll: float | None
    info: dict[str, str]
    all_sizes: SizeClass
    size_classes: tuple[SizeClass, ...]
    bounds: tuple[BoundCheck, ...]
    missed: int
    missed_area: float
    missed_unsaid: int
    phantoms: int
    unjudged: int
    rms_pixels: float
    greatest_pixels: float
    worst: tuple[FaceError, ...]
    missed_faces: tuple[FaceError, ...]
    open_seconds: float
    seconds_per_pose: float


@dataclass(frozen=True)
class Check:
    """Check of the bounds of one kind of a candidate.

    Attributes
    ----------
    candidate, kind : str
        Name of the candidate, and kind of its bounds.
    held, figures : int
        Figures within their bound, and figures compared.
    must : float
        Share that must hold.
    passed : bool or None
        None with too few figures for a verdict.
    """

    candidate: str
    kind: str
    held: int
    figures: int
    must: float
    passed: bool | None

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
    """Candidates compared with a reference.

    Attributes
    ----------
    against : str
        The reference: exact, polygons or rational.
    truth_error : float
        Error of its areas, px^2.
    truth_seconds_per_pose : float
        Time of the reference.
    faces, poses, poses_done : int
        Of the mesh; requested; compared before the end or an interrupt.
    passed : bool
        True when no check failed.
    checks : tuple of Check
        Checks of all candidates.
    scores : tuple of Score
        One for each candidate.
    convergence : tuple of Convergence
        Of the rasterisers among them.
    interrupted : bool
        True when it ended early.
    run : dict
        Provenance: mesh, camera, poses, versions.
    """

    against: str
    truth_error: float
    truth_seconds_per_pose: float
    faces: int
    poses: int
    poses_done: int
    passed: bool
    checks: tuple[Check, ...]
    scores: tuple[Score, ...]
    convergence: tuple[Convergence, ...]
    interrupted: bool
    run: dict[str, Any]
