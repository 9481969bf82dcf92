"""Reasons of faces, points and zones that are not covered, with the words on each: one table."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.task import Reason
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind, Observation


class Words(NamedTuple):
    """Words on a reason.

    Attributes
    ----------
    label : str
        Of a legend, and after a number or a colon.
    sentence : str
        After a number of faces.
    advice : str
        For one camera to cover a face; names in braces are figures of the face.
    """

    label: str
    sentence: str
    advice: str = ""


REASONS = {
    "degenerate": Words("without area", "have no area", "it has no area, and cannot be covered"),
    "back_facing": Words(
        "seen from behind",
        "are seen from behind",
        "move the camera to the side that its normal points to",
    ),
    "outside": Words(
        "not all in the image", "are not all in the image", "turn the camera towards it{wider}"
    ),
    "out_of_focus": Words(
        "out of focus",
        "are out of focus",
        "it is {depth} deep, in focus are {in_focus}: focus on it",
    ),
    "unsampled": Words("too small for a sample", "are too small for a sample", "come nearer"),
    "too_coarse": Words(
        "too few pixels",
        "get too few pixels",
        "it gets {finer}: come {times} as near, or take {times} the focal length",
    ),
    "occluded": Words("occluded", "are occluded", "move the camera so that {hider} is not between"),
    "too_oblique": Words(
        "seen too flatly",
        "are seen too flatly",
        "seen at {angle} deg of {max_angle}: move towards its normal",
    ),
    "covered": Words("covered", "are covered"),
    "too_few_views": Words("too few cameras", "are covered by too few cameras"),
    "no_cameras": Words("no cameras", "have no camera"),
}
"""Words by the name of the reason: the members of `Reason`, and two of a network."""
NAMES = tuple(REASONS)
TOO_FEW_VIEWS, NO_CAMERAS = NAMES.index("too_few_views"), NAMES.index("no_cameras")
"""Rows of the reasons of a network."""


def reason_rows(
    reason: NDArray[np.uint8], covered: NDArray[np.bool_], n_cameras: int
) -> NDArray[np.uint8]:
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


def faces_in_view(mesh: Mesh, camera: Cameras, poses: Poses) -> NDArray[np.bool_]:
    """(P, F) faces seen from the front with some part in the image, whatever is before them."""
    shape = len(poses), mesh.n_faces
    none = np.zeros(shape)
    kind = np.full(shape, BoundKind.EXACT, np.uint8)
    measured = Observation(none, none, kind, none, np.zeros(len(poses), np.bool_))
    reason, in_view = np.empty(shape, np.uint8), np.empty(shape, np.bool_)
    part = np.empty(shape)
    figures = {"reason": reason, "in_view": in_view, "in_view_fraction": part}
    FacePass(mesh, camera, 1).fill(measured, poses, figures)
    found: NDArray[np.bool_] = (reason > Reason.BACK_FACING) & (in_view | (part > 0))
    return found
