"""Results of a comparison of models: scores, disagreements, faces."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ModelScore:
    """Coverage of the task's faces by one model, over all poses.

    Attributes
    ----------
    name : str
        In `MODELS`.
    covered, covered_percent : int, float
        Pairs of pose and face that it covers, and their share of all pairs.
    graded_percent : float
        Of the pairs with coverage above 0, those below 1.
    mean : float
        Mean coverage over all pairs.
    seen_percent : float
        Visible part of the images of the faces it covers, all together.
    seconds_per_pose : float
        Computing time.
    """

    name: str
    covered: int
    covered_percent: float
    graded_percent: float
    mean: float
    seen_percent: float
    seconds_per_pose: float


@dataclass(frozen=True)
class Disagreement:
    """Faces that one model covers and another does not, over all poses.

    Attributes
    ----------
    covers, does_not : str
        The two models.
    faces : int
        Pairs of pose and face.
    mean_visibility : float
        Mean visible fraction of these faces.
    hidden, partly, whole : int
        Numbers of hidden, partly hidden and wholly visible ones.
    image_pixels, visible_pixels : float
        Area of their images, and of the visible parts, px^2.
    """

    covers: str
    does_not: str
    faces: int
    mean_visibility: float
    hidden: int
    partly: int
    whole: int
    image_pixels: float
    visible_pixels: float


@dataclass(frozen=True)
class Bivalence:
    """The bivalent test of `zhang.visible` compared with the visible area, for any task.

    Faces in view from the front, wholly inside the image, count.

    Attributes
    ----------
    faces : int
        Pairs of pose and face.
    partly_hidden : int
        Pairs with a visible and a hidden part.
    called_hidden : int
        Pairs that the test calls hidden although a part is visible.
    called_hidden_visibility, called_hidden_pixels : float
        Mean visible fraction of these, and their visible area, px^2.
    called_seen : int
        Pairs that the test calls seen although a part is hidden.
    called_seen_visibility, called_seen_pixels : float
        Mean visible fraction of these, and their hidden area, px^2.
    """

    faces: int
    partly_hidden: int
    called_hidden: int
    called_hidden_visibility: float
    called_hidden_pixels: float
    called_seen: int
    called_seen_visibility: float
    called_seen_pixels: float


@dataclass(frozen=True)
class FaceValues:
    """One face in one pose: visibility, and coverage by every model.

    Attributes
    ----------
    pose, face : int
        Row of the poses, row of `mesh.faces`.
    visibility, bound, kind : float, float, str
        Visible fraction, its bound, and the kind of the bound, see `rastercov.BoundKind`.
    bivalent : bool
        True when the bivalent test calls it seen.
    image_pixels : float
        Area of its image, px^2.
    coverage : dict
        By the name of the model.
    """

    pose: int
    face: int
    visibility: float
    bound: float
    kind: str
    bivalent: bool
    image_pixels: float
    coverage: dict[str, float]


@dataclass(frozen=True)
class ModelComparison:
    """Models side by side.

    Attributes
    ----------
    models : tuple of ModelScore
        In the order asked for.
    disagreements : tuple of Disagreement
        Of every pair of models that disagree about a face, both ways.
    bivalence : Bivalence
        Errors of the bivalent test.
    worst : tuple of FaceValues
        Faces with its largest errors by area in the image.
    misjudged : tuple of float
        Error of the bivalent test in each pose, px^2.
    poses, task_faces : int
        Compared.
    run : dict
        Provenance: mesh, camera, poses, task, versions.
    """

    models: tuple[ModelScore, ...]
    disagreements: tuple[Disagreement, ...]
    bivalence: Bivalence
    worst: tuple[FaceValues, ...]
    misjudged: tuple[float, ...]
    poses: int
    task_faces: int
    run: dict[str, Any]
