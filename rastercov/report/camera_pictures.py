"""The own image of each camera of a network: what it covers, and why not what else it sees.

By area every pixel is judged by its own point, with `coverage.area`; by face by its face. Covered
parts have the camera's colour; others are hatched in the colour of the criterion that fails.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.coverage.area.failures import first_failures
from rastercov.coverage.area.points import covering_poses
from rastercov.coverage.area.regions import Regions
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
    part_drawn,
    stripes,
    target_key,
    targets_in_view,
)
from rastercov.report.panorama import LEAST_LIGHT, PIXELS_AT_A_TIME, FaceImage, points_of_pixels
from rastercov.report.theme import Colour, Pixels

FloatArray = NDArray[np.float64]
States = NDArray[np.uint8]

SIDE = 720
"""Larger side of a picture, pixels."""
WHOLE_REL = 1e-6
"""Area up to which a face may be uncovered and counts as wholly covered here, relative."""
UNJUDGED = 255
"""State of a pixel whose point lies on the outline of a region: drawn like a line of the mesh."""
FEW_REL = 2e-5
"""Part of the image up to which the pixels of a state are such."""


@dataclass(frozen=True, eq=False)
class CameraImage:
    """Image of one camera, judged pixel by pixel.

    Attributes
    ----------
    face, targets : (H, W) int32
        Nearest face, and target over it; -1 for none.
    beneath : (H, W) bool
        Occluders that hide a task face that turns its front to the camera.
    state, target_state : (H, W) uint8
        `Reason` of the point at each pixel of a task face and of a target, or `UNJUDGED`.
    faces : int or None
        Faces that the camera covers; None by area.
    """

    mesh: Mesh
    camera: Camera
    pose: FloatArray
    face: FaceImage
    targets: FaceImage
    beneath: NDArray[np.bool_]
    state: States
    target_state: States
    faces: int | None


def camera_image(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    task: Task,
    regions: Regions | None = None,
    side: int = SIDE,
) -> CameraImage:
    """Judge the pixels of a camera's image, at a size of at most `side`.

    With `regions`, of this pose alone, each pixel is judged by its point; else by its face.
    """
    small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
    with open_rasterizer(mesh, small, "cpu") as rasterizer:
        buffer = rasterizer.render(pose)
    in_view = targets_in_view(mesh, small, pose, buffer.depth)
    targets = np.full_like(buffer.face, -1) if in_view is None else in_view
    is_task = np.append(mesh.task_mask, False)
    beneath = np.zeros(buffer.face.shape, np.bool_)
    scored = np.flatnonzero(mesh.task_mask & ~mesh.target_mask & facing(mesh, pose)[0])
    if not mesh.task_mask.all() and len(scored):
        behind = part_drawn(mesh, small, pose, scored).face >= 0
        beneath = behind & (buffer.face >= 0) & ~is_task[buffer.face]
    n_covered = None
    if regions is None:
        reasons = evaluate(mesh, camera, pose[None], task, fields=("coverage", "reason")).reason[0]
        states = [np.append(reasons, UNJUDGED)[image] for image in (buffer.face, targets)]
        n_covered = int((mesh.task_mask & (reasons == Reason.COVERED)).sum())
    else:
        states = [_states(regions, camera, small, pose, image) for image in (buffer.face, targets)]
    state, target_state = states
    return CameraImage(
        mesh, small, pose, buffer.face, targets, beneath, state, target_state, n_covered
    )


def _states(
    regions: Regions, camera: Camera, small: Camera, pose: FloatArray, face: FaceImage
) -> States:
    """State of the point at each pixel of a scored face."""
    mesh = regions.mesh
    found = np.full(face.shape, UNJUDGED, np.uint8)
    is_task = np.append(mesh.task_mask, False)[face]
    found[is_task] = Reason.COVERED
    pixel = np.nonzero(is_task & ~covered_pixels(regions, small, pose, face))
    if len(pixel[0]):
        faces = face[pixel].astype(np.int64)
        points = points_of_pixels(mesh, small, pose, face[pixel], *pixel)
        judged = first_failures(mesh, camera, regions.task, pose[None], points, faces)
        why, _ = next(iter(judged))
        # The point is in the image and nothing is in front of it: else it is rounding.
        why[np.isin(why, (Reason.COVERED, Reason.OCCLUDED, Reason.OUTSIDE))] = UNJUDGED
        found[pixel] = why
    states = found[is_task]
    count = np.bincount(states, minlength=256)
    states[count[states] <= FEW_REL * face.size] = UNJUDGED
    found[is_task] = states
    return found


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
    covered = np.append(is_whole, False)[face]
    # Only faces that are covered in part have to be asked point by point.
    partly = np.append((area > 0) & ~is_whole, False)[face]
    pixel = np.divmod(np.flatnonzero(partly), face.shape[1])
    faces = face[pixel]
    points = points_of_pixels(mesh, camera, np.asarray(pose, np.float64), faces, *pixel)
    for at in range(0, len(faces), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        found = covering_poses(regions, faces[part], points[part]).any(axis=1)
        covered[pixel[0][part], pixel[1][part]] = found
    return covered


def camera_pixels(image: CameraImage, colour: Colour) -> Pixels:
    """(H, W, 3) pixels of a camera's image, with what it covers in its colour."""
    mesh, face = image.mesh, image.face
    _, cosine = facing(mesh, image.pose)
    light = (LEAST_LIGHT + (1 - LEAST_LIGHT) * np.append(cosine, 1.0))[face]
    table, striped = _colours(colour)
    lines = stripes(face.shape, max(3, round(max(face.shape) / 180)))
    base = np.where(lines[..., None], striped[image.state], table[image.state])
    is_occluder = np.append(~mesh.task_mask, False)[face]
    base[is_occluder] = theme.OCCLUDER_PALE
    hidden = image.beneath & stripes(face.shape, max(2, round(max(face.shape) / 240)), 4)
    base[hidden] = theme.REASONS["occluded"]
    pixels: Pixels = (base * light[..., None]).astype(np.uint8)
    pixels[face < 0] = theme.BACKGROUND
    draw_lines(pixels, face, mesh.n_faces)
    hatch_over(pixels, image.targets, striped[image.target_state], 3)
    return pixels


def _colours(colour: Colour) -> tuple[Pixels, Pixels]:
    """(256, 3) colours of states, and of the stripes over them."""
    table = np.empty((256, 3), np.uint8)
    table[:] = theme.COVERED
    striped = table.copy()
    for reason in Reason:
        striped[reason] = theme.REASONS.get(reason.name.lower(), theme.COVERED)
    table[Reason.BACK_FACING], striped[Reason.BACK_FACING] = theme.BEHIND, theme.BEHIND_STRIPE
    table[Reason.COVERED] = striped[Reason.COVERED] = colour
    table[UNJUDGED] = striped[UNJUDGED] = theme.WALL_LINE
    return table, striped


def camera_keys(images: Sequence[CameraImage], colour: Colour | None, name: str) -> list[Key]:
    """Legend of pictures of cameras: everything that is in at least one of them."""
    shown = np.zeros(256, np.bool_)
    for image in images:
        is_task = np.append(image.mesh.task_mask, False)[image.face]
        shown[np.unique(image.state[is_task])] = True
        shown[np.unique(image.target_state[image.targets >= 0])] = True
    table, striped = _colours(colour or theme.PAPER)
    keys = [Key.of(name, colour)] if colour is not None else []
    keys += [
        Key.of(REASONS[reason.name.lower()].label, table[reason], striped[reason])
        for reason in Reason
        if shown[reason] and reason != Reason.COVERED
    ]
    if any((~image.mesh.task_mask[image.face[image.face >= 0]]).any() for image in images):
        keys.append(Key.of("occluder", theme.OCCLUDER_PALE))
    if any(image.beneath.any() for image in images):
        red = theme.REASONS["occluded"]
        keys.append(Key.of("occluder that hides the task", theme.OCCLUDER_PALE, red, 4, 4))
    if any((image.targets >= 0).any() for image in images):
        keys.append(target_key())
    if any((image.face < 0).any() for image in images):
        keys.append(Key.of("nothing", theme.BACKGROUND))
    return keys
