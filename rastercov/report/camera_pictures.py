"""The own image of a camera: what it covers, and why not what else it sees.

Every pixel is judged by its face. Covered parts have the camera's colour; others are hatched in the
colour of the criterion that fails.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.coverage.area.regions import Regions, covering_poses
from rastercov.coverage.job import evaluate
from rastercov.coverage.reasons import REASONS
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh
from rastercov.raster import open_rasterizer
from rastercov.report import theme
from rastercov.report.images import (
    Key,
    draw_lines,
    facing,
    hatch_over,
    layers,
    stripes,
    target_key,
)
from rastercov.report.panorama import LEAST_LIGHT, FaceImage, values_at_pixels
from rastercov.report.theme import Colour, Pixels

FloatArray = NDArray[np.float64]

SIDE = 720
"""Larger side of a picture, pixels."""
WHOLE_REL = 1e-6
"""Area up to which a face may be uncovered and counts as wholly covered here, relative."""


@dataclass(frozen=True, eq=False)
class CameraImage:
    """Image of one camera and the judgement of its faces.

    Attributes
    ----------
    face, targets : (H, W) int32
        Nearest face, and target over it; -1 for none.
    beneath : (H, W) bool
        Occluders that hide a task face that turns its front to the camera.
    reasons : (F,) uint8
        `Reason` of each face.
    faces : int
        Faces that the camera covers.
    """

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    face: FaceImage
    targets: FaceImage
    beneath: NDArray[np.bool_]
    reasons: NDArray[np.uint8]
    faces: int


def camera_image(
    mesh: Mesh, camera: Camera, pose: FloatArray, task: Task, side: int = SIDE
) -> CameraImage:
    """Image of a camera, at a size of at most `side`, and the judgement of its faces."""
    small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
    with open_rasterizer(mesh, small, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    scored = np.flatnonzero(mesh.task_mask & ~mesh.target_mask & facing(mesh, pose)[0])
    targets, behind = layers(mesh, small, pose, buffer, scored)
    reasons = evaluate(mesh, camera, pose[None], task, fields=("coverage", "reason")).reason[0]
    n_covered = int((mesh.task_mask & (reasons == Reason.COVERED)).sum())
    return CameraImage(mesh, small, pose, buffer.face, targets, behind >= 0, reasons, n_covered)


def covered_pixels(
    regions: Regions, camera: Camera, pose: ArrayLike, face: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Pixels at whose centre the surface is covered by a pose of some regions.

    Parameters
    ----------
    regions : Regions
        Of few poses, of the mesh in the image.
    camera, pose
        Of the image, (H, W).
    face : (H, W) int32
        Face at each pixel, -1 for none.

    Returns
    -------
    (H, W) bool
        False where no task face is.
    """
    mesh, area = regions.mesh, regions.areas().max(axis=0, initial=0.0)
    is_whole = (area > 0) & (area >= (1 - WHOLE_REL) * mesh.areas)
    covered: NDArray[np.bool_] = np.append(is_whole, False)[face]
    # Only faces that are covered in part have to be asked point by point.
    partly = np.append((area > 0) & ~is_whole, False)[face]

    def is_covered(faces: NDArray[np.int32], points: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(covering_poses(regions, faces, points).any(axis=1))

    matrix = np.asarray(pose, np.float64)
    covered[partly] = values_at_pixels(mesh, camera, matrix, face, partly, is_covered, False)[
        partly
    ]
    return covered


def camera_pixels(image: CameraImage, colour: Colour) -> Pixels:
    """(H, W, 3) pixels of a camera's image, with what it covers in its colour."""
    mesh, face = image.mesh, image.face
    _, cosine = facing(mesh, image.pose)
    light = (LEAST_LIGHT + (1 - LEAST_LIGHT) * np.append(cosine, 1.0))[face]
    table, striped = (colours[image.reasons] for colours in _colours(colour))
    lines = stripes(face.shape, max(3, round(max(face.shape) / 180)))
    base = np.where(lines[..., None], striped[face], table[face])
    base[np.append(~mesh.task_mask, False)[face]] = theme.OCCLUDER_PALE
    hidden = image.beneath & stripes(face.shape, max(2, round(max(face.shape) / 240)), 4)
    base[hidden] = theme.REASONS["occluded"]
    pixels: Pixels = (base * light[..., None]).astype(np.uint8)
    pixels[face < 0] = theme.BACKGROUND
    draw_lines(pixels, face, mesh.n_faces)
    hatch_over(pixels, image.targets, striped, 3)
    return pixels


def _colours(colour: Colour) -> tuple[Pixels, Pixels]:
    """Colours of reasons, and of the stripes over them."""
    table = np.empty((len(Reason), 3), np.uint8)
    table[:] = theme.COVERED
    striped = table.copy()
    for reason in Reason:
        striped[reason] = theme.REASONS.get(reason.name.lower(), theme.COVERED)
    table[Reason.BACK_FACING], striped[Reason.BACK_FACING] = theme.BEHIND, theme.BEHIND_STRIPE
    table[Reason.COVERED] = striped[Reason.COVERED] = colour
    return table, striped


def camera_keys(image: CameraImage, colour: Colour, name: str) -> list[Key]:
    """Legend of a picture of a camera: everything that is in it."""
    drawn = np.unique(image.face[image.face >= 0])
    is_task = image.mesh.task_mask[drawn]
    targets = np.unique(image.targets[image.targets >= 0])
    shown = set(image.reasons[np.concatenate((drawn[is_task], targets))].tolist())
    table, striped = _colours(colour)
    keys = [Key.of(name, colour)]
    keys += [
        Key.of(REASONS[reason.name.lower()].label, table[reason], striped[reason])
        for reason in Reason
        if reason in shown and reason != Reason.COVERED
    ]
    if not is_task.all():
        keys.append(Key.of("occluder", theme.OCCLUDER_PALE))
    if image.beneath.any():
        red = theme.REASONS["occluded"]
        keys.append(Key.of("occluder that hides the task", theme.OCCLUDER_PALE, red, 4, 4))
    if len(targets):
        keys.append(target_key())
    if (image.face < 0).any():
        keys.append(Key.of("nothing", theme.BACKGROUND))
    return keys
