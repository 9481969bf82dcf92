"""What a comparison of models gives, in plain values: scores, disagreements, faces.

Part of `comparison`.
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ModelScore:
    """What one model says of the task's faces, over all poses.

    Attributes
    ----------
    name : str
        In `MODELS`.
    covered, covered_percent : int, float
        Pairs of pose and face that it covers, and of all pairs.
    graded_percent : float
        Of the pairs with coverage above 0, those below 1.
    mean : float
        Mean coverage over all pairs.
    seen_percent : float
        Visible part of the images of the faces it covers, all together.
    seconds_per_pose : float
        What it took.
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
        How many of them are not seen at all, in part, wholly.
    image_pixels, visible_pixels : float
        Area of their images, and of what is seen of them, px^2.
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
    """The bivalent test of `zhang.visible` against what is really seen, whatever the task.

    Over faces in view from the front, wholly inside the image.

    Attributes
    ----------
    faces : int
        Pairs of pose and face.
    partly_hidden : int
        Those of which a part is seen and a part is not.
    called_hidden : int
        Those the test calls hidden though something is seen of them.
    called_hidden_visibility, called_hidden_pixels : float
        Mean visible fraction of these, and what is seen of them, px^2.
    called_seen : int
        Those the test calls seen though something of them is hidden.
    called_seen_visibility, called_seen_pixels : float
        Mean visible fraction of these, and what is hidden of them, px^2.
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
    """One face in one pose: what every model says, and what is seen.

    Attributes
    ----------
    pose, face : int
        Row of the poses, row of `mesh.faces`.
    visibility, bound, kind : float, float, str
        Visible fraction, how far it may be off, and in what sense, see `rastercov.Kind`.
    bivalent : bool
        Whether the bivalent test calls it seen.
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
        How the bivalent test did.
    worst : tuple of FaceValues
        Faces of which it misjudges most, by area in the image.
    misjudged : tuple of float
        For each pose: how much the bivalent test misjudges, px^2.
    poses, task_faces : int
        Compared.
    run : dict
        What made it: mesh, camera, poses, task, versions.
    """

    models: tuple[ModelScore, ...]
    disagreements: tuple[Disagreement, ...]
    bivalence: Bivalence
    worst: tuple[FaceValues, ...]
    misjudged: tuple[float, ...]
    poses: int
    task_faces: int
    run: dict[str, Any]
