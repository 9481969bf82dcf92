"""Reasons of faces, points and zones that are not covered, with the words and colour of each."""

from enum import IntEnum

import numpy as np

from rastercov.base.features import hooks_of
from rastercov.base.memory import BoolArray, ByteArray
from rastercov.coverage.task import CRITERIA_OF_TASK
from rastercov.coverage.words import Wording, Words


class Reason(IntEnum):
    """First criterion that a face fails, in the order of the numbers; COVERED if it fails none.

    A face is DEGENERATE if it has no area, BACK_FACING if the camera is behind it, OUTSIDE if a
    vertex is outside the image or nearer than the near plane, OUT_OF_FOCUS if it is not within the
    depth of field, UNSAMPLED if it is in view but no sample hits it, TOO_COARSE if it has too few
    pixels, or too few per metre, OCCLUDED if too much of it is occluded, and TOO_OBLIQUE if its
    angle of incidence is too large.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> found = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> int((found.reason == rc.Reason.BACK_FACING).sum())  # of 12 faces
    10
    >>> rc.Reason(found.reason[0, 2]).name
    'COVERED'
    """

    DEGENERATE = 0
    """The face has no area."""
    BACK_FACING = 1
    """The camera is behind it."""
    OUTSIDE = 2
    """A vertex is outside the image or nearer than the near plane."""
    OUT_OF_FOCUS = 3
    """It is not within the depth of field."""
    UNSAMPLED = 4
    """It is in view, but no sample hits it, or its image is within rounding error; its visibility
    is unknown."""
    TOO_COARSE = 5
    """Too few pixels, or too few per metre."""
    OCCLUDED = 6
    """Too much of it is occluded."""
    TOO_OBLIQUE = 7
    """Its angle of incidence is too large."""
    COVERED = 8
    """Every criterion holds."""


REASONS = {
    "degenerate": Words(
        "zero area", "have zero area", "a face of zero area cannot be covered", (84, 96, 100), 10
    ),
    "back_facing": Words(
        "back-facing",
        "are back-facing",
        "move the camera to the front of the face",
        (136, 84, 164),
        1,
    ),
    "outside": Words(
        "outside the image",
        "are not fully in the image",
        "rotate the camera towards it{wider}",
        (0, 114, 178),
        4,
    ),
    "out_of_focus": Words(
        "out of focus",
        "are out of focus",
        "its depth is {depth}, the depth of field {in_focus}: refocus or move the camera",
        (86, 180, 233),
        8,
    ),
    "unsampled": Words(
        "below sampling resolution",
        "are below the sampling resolution",
        "move the camera closer",
        (120, 94, 60),
        5,
    ),
    "too_coarse": Words(
        "resolution too low",
        "have too low a resolution",
        "{found} at {distance}; {wanted} needs a distance of {nearer} or {times} the focal length",
        (240, 160, 0),
        2,
    ),
    "occluded": Words(
        "occluded",
        "are occluded",
        "move the camera so that {hider} no longer blocks the view",
        (214, 39, 40),
        3,
    ),
    "too_oblique": Words(
        "too oblique",
        "are too oblique",
        "incidence {angle}°, at most {max_angle}° allowed: move the camera closer to the face "
        "normal",
        (0, 158, 115),
        12,
    ),
    "covered": Words("covered", "are covered", "", (214, 220, 226)),
    "too_few_views": Words(
        "too few cameras",
        "are covered by too few cameras",
        "add cameras that see this surface",
        (230, 120, 180),
        6,
    ),
    "no_cameras": Words(
        "no cameras",
        "have no camera",
        "add a camera; if no candidate covers it, check unit, camera and thresholds",
        (218, 198, 176),
        9,
    ),
    "baseline": Words(
        "ray angle out of range",
        "have a ray angle out of range",
        "change the baseline of the rig or its distance",
        (150, 160, 60),
        7,
    ),
    "uncertain": Words(
        "too uncertain",
        "are too uncertain",
        "widen the baseline of the rig, move it closer, or use more pixels",
        (130, 20, 20),
        17,
    ),
    "unseeable": Words(
        "not visible from anywhere (proved)",
        "are not visible from anywhere (proved)",
        "it lies inside a body or touches another: exclude it from the evaluation",
        (150, 150, 158),
        16,
    ),
}
"""By the name of the reason: the members of `Reason`, in their order, those of networks, and those
of features."""
OF_FEATURES: dict[str, Words] = {}
WORDINGS = (*hooks_of(Wording), *(each._wording for each in CRITERIA_OF_TASK))
"""Words of features, and of criteria of the surface."""
for _each in WORDINGS:
    OF_FEATURES |= _each.reasons
REASONS |= OF_FEATURES
NAMES = tuple(REASONS)
TOO_FEW_VIEWS, NO_CAMERAS = NAMES.index("too_few_views"), NAMES.index("no_cameras")
BASELINE, UNCERTAIN = NAMES.index("baseline"), NAMES.index("uncertain")
"""Rows of the reasons of a network, and of a rig with a rule."""
UNSEEABLE = NAMES.index("unseeable")
ORDER = (*(each for each in Reason if each < Reason.COVERED), BASELINE, UNCERTAIN,
         *map(NAMES.index, OF_FEATURES), Reason.COVERED)  # fmt: skip
"""Reasons by the order in which criteria are asked: of a point that no camera covers, it is the
latest of any camera."""
RANK = np.full(256, len(ORDER))
"""Place of each row of `REASONS` in it; others are last."""
RANK[list(ORDER)] = np.arange(len(ORDER))


def reason_rows(reason: ByteArray, covered: BoolArray, n_cameras: int) -> ByteArray:
    """(F,) row of `REASONS` of each face of a network.

    Parameters
    ----------
    reason : (F,) uint8
        `Reason` of the camera that comes nearest to covering the face.
    covered : (F,) bool
        Faces that enough cameras cover.
    n_cameras : int
        Cameras of the network.
    """
    if not n_cameras:
        return np.full(len(reason), NO_CAMERAS, np.uint8)
    rows = np.where(reason == Reason.COVERED, np.uint8(TOO_FEW_VIEWS), reason)
    rows[covered] = Reason.COVERED
    return rows


CONDITIONS = {"the angle between rays": "baseline", "the uncertainty": "uncertain"}
"""Conditions that fail of a rig with a rule where no device does, and the reason of each."""


def fails(device: str, reason: str = "") -> str:
    """Words on a sensor, one of `CONDITIONS`, or a lamp, for which something is not covered.

    The reason is of what is not; those of features name lamps.
    """
    if device in CONDITIONS:
        return REASONS[CONDITIONS[device]].label
    return f"nearest or reflected lamp: {device}" if reason in OF_FEATURES else f"{device} fails"
