"""Results of a comparison of models: scores, disagreements, faces."""

from dataclasses import dataclass
from typing import Any


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
    mean_visibility: float
    hidden: int
    partly: int
    whole: int
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
    called_hidden_visibility: float  # mean visible fraction of these
    called_hidden_pixels: float  # their visible area, px^2
    called_seen: int  # called seen although a part is hidden
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
    run: dict[str, Any]  # provenance: mesh, camera, poses, task, versions
