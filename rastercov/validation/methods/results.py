"""What a comparison gives, in plain values: errors by face size, bounds by kind, faces, a verdict.

Part of `compare`.
"""

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
        Faces over all poses, and those of them that are neither seen whole nor hidden.
    rms, mean, greatest : float
        Of |value - truth|, over all.
    rms_partly_hidden, mean_bound_partly_hidden : float
        The same, and the mean bound, where something is hidden and something seen.
    median, percentile_99 : float
        Of the error over all, to the next tenth of a power of ten.
    held : int
        Figures whose error was within their bound.
    missed : int
        Faces that are seen, of which the figure says 0.
    errors : tuple of (float, int)
        Histogram: errors up to the first number, and more than that of the entry before.
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
    """How often and how tightly the bounds of one kind held.

    Attributes
    ----------
    kind : str
        Name of `Kind` in lower case.
    figures, held : int
        All figures of that kind, and those whose error was within their bound.
    partly_hidden, partly_hidden_held : int
        The same where something is hidden and something seen.
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
    """One figure beside the truth; areas in px^2.

    Attributes
    ----------
    pose, face : int
        Row of the poses, row of `mesh.faces`.
    area, visible : float
        True area of the image of the face inside the image, and of what is seen of it.
    truth, value, bound : float
        True visible fraction, the figure, and how far off it says it may be.
    kind : str
        Of the bound.
    held : bool
        Whether the error was within the bound.
    visible_pixels : float
        What the method says is seen, px^2.
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
    """How one candidate did.

    Attributes
    ----------
    name, method, supersample : str, str, int
        The candidate.
    roll : float or None
        Radians by which its grid of samples is turned; None without samples.
    info : dict
        What computed or counted: `RasterizerInfo`.
    all_sizes, size_classes
        Errors of the visible fraction over all faces, and by the size of their images.
    bounds : tuple of BoundCheck
        One for each kind of bound.
    missed, missed_area, missed_unsaid : int, float, int
        Faces that are seen of which it says 0; what is seen of them, px^2; and of how many the
        bound does not say so.
    phantoms : int
        Faces that are hidden of which it says more than 0.
    unjudged : int
        Faces whose image is too small for the truth to tell anything.
    rms_pixels, greatest_pixels : float
        Error of the visible area, px^2.
    worst, missed_faces : tuple of FaceError
        Those with the greatest errors, and those missed of which most is seen.
    open_seconds, seconds_per_pose : float
        To open it and observe one pose, which may compile; and after that.
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
    """One law that a candidate must keep.

    Attributes
    ----------
    candidate, kind : str
        Whose bounds, and of which kind.
    held, figures : int
        Figures within their bound, and figures judged.
    must : float
        Share that must hold.
    passed : bool or None
        None where there were too few figures to tell.
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
    """Candidates beside the truth.

    Attributes
    ----------
    against : str
        What was taken as the truth: exact, polygons or rational.
    truth_error : float
        How far off its areas may be, px^2.
    truth_seconds_per_pose : float
        What it took.
    faces, poses, poses_done : int
        Of the mesh; asked for; compared before the end or an interrupt.
    passed : bool
        Whether no check failed.
    checks : tuple of Check
        What was asked of the candidates.
    scores : tuple of Score
        One for each candidate.
    convergence : tuple of Convergence
        Of the rasterisers among them.
    interrupted : bool
        Whether it ended before it was done.
    run : dict
        What made it: mesh, camera, poses, versions.
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
