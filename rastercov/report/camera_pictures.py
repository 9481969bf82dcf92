"""Images of cameras: what they cover, and why they do not cover the rest.

Covered parts are pale, others have colour and hatch of the criterion that fails, by area that of
each point, else each face as a whole.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, ByteArray, FloatArray, Int32Array, IntArray, frozen_record
from rastercov.core.area.features import conditions_at
from rastercov.core.area.regions import covering_poses
from rastercov.core.area.stages import first_failures
from rastercov.core.area.table import Regions
from rastercov.core.camera import Camera, Cameras, Poses, apparent
from rastercov.core.coverage.reasons import NAMES, REASONS, Reason
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import VisibilityBuffer
from rastercov.report.images import FaceImage, Key, facing, hatch_pixels, stripes
from rastercov.report.panorama import (
    DrawnScene,
    draw_scene,
    neutral,
    on_pixels,
    paint,
    remember,
    scene_keys,
)
from rastercov.report.theme import REASON_COLOURS, REASON_HATCHES, Pixels

WHOLE_REL = 1e-6
"""Area, relative, that a face may lack and count as whole here: as covered, or as dead."""


def covered_pixels(regions: Regions, scene: DrawnScene, face: FaceImage) -> BoolArray:
    """Pixels of a face image of a scene, (H, W), whose centre is covered by some regions."""
    area = regions.areas().max(axis=0, initial=0.0)
    is_whole = (area > 0) & (area >= (1 - WHOLE_REL) * scene.mesh.areas)
    # Only faces that are covered in part have to be asked point by point.
    partly = on_pixels((area > 0) & ~is_whole, face)

    def is_covered(faces: Int32Array, points: FloatArray) -> BoolArray:
        return np.asarray(covering_poses(regions, faces, points).any(axis=1))

    covered = on_pixels(is_whole, face)
    covered |= scene.at_points(face, is_covered, False, partly)
    return covered


@frozen_record
class CameraImage:
    """Image of one camera and the judgement of what it shows.

    Attributes
    ----------
    scene : Scene
        What it sees, with nothing beneath.
    hidden : (H, W) bool
        Occluders before an evaluated face that turns its front to the camera.
    surface, targets : (H, W) uint8
        `Reason` at each pixel, of the surface and of the targets before it.
    """

    scene: DrawnScene
    hidden: BoolArray
    surface: ByteArray
    targets: ByteArray


def camera_scene(
    mesh: Mesh, camera: Camera, pose: FloatArray, buffer: VisibilityBuffer | None = None
) -> DrawnScene:
    """Scene in the image of a camera, with the task behind occluders; drawn unless given."""
    if buffer is None:
        with open_rasterizer(mesh, camera, "cpu") as rasterizer:
            buffer = rasterizer.render(pose)
    scored = np.flatnonzero(
        mesh.task_mask & ~mesh.target_mask & facing(mesh, apparent(camera, Poses.of(pose))[0])[0]
    )
    return draw_scene(mesh, camera, pose, buffer, scored)


def by_faces(scene: DrawnScene, reasons: ByteArray) -> CameraImage:
    """Image of a `camera_scene` by the `Reason` of each face, (F,)."""
    return _classify_image(scene, lambda face: reasons[face])


def by_points(
    scene: DrawnScene,
    camera: Camera,
    task: Task,
    parts: Regions,
    placed: tuple[Cameras, Poses] | None = None,
) -> CameraImage:
    """Image of a `camera_scene`, each pixel by its own point.

    `camera` is the one of the judgement, at its own size, and `parts` are its regions. With all
    cameras and its pose, points that it sees have the reason of conditions that fail.
    """
    opened = remember(_open_walls, scene.mesh)

    def why(faces: Int32Array, points: FloatArray) -> ByteArray:
        (result,) = first_failures(
            opened, camera, task, scene.pose[None], points, faces.astype(np.int64)
        )
        reason = result[0]
        if placed is not None:
            on = points, faces.astype(np.int64)
            for each in conditions_at(scene.mesh, placed[0], task, *on):
                reason = np.where(reason == Reason.COVERED, each.reasons(placed[1]), reason)
        return reason.astype(np.uint8)

    def judge(face: FaceImage) -> ByteArray:
        asked = on_pixels(scene.mesh.task_mask, face) & ~covered_pixels(parts, scene, face)
        return scene.at_points(face, why, np.uint8(Reason.COVERED), asked)

    return _classify_image(scene, judge)


def _open_walls(mesh: Mesh, _eyes: ArrayLike) -> Mesh:
    """The mesh with faces that hide nothing: what is in an image is not hidden."""
    groups = [replace(each, is_occluder=False, is_target=True) for each in mesh.groups]
    return Mesh(mesh.vertices, mesh.faces, groups, mesh.face_group)


def _classify_image(scene: DrawnScene, judge: Callable[[FaceImage], ByteArray]) -> CameraImage:
    bare = replace(scene, beneath=np.full_like(scene.beneath, -1))
    hidden = (scene.beneath >= 0) & (scene.targets < 0)
    return CameraImage(bare, hidden, judge(scene.face), judge(scene.targets))


def camera_pixels(image: CameraImage) -> Pixels:
    """(H, W, 3) pixels of a camera's image, with what it does not cover in colour and hatch."""
    scene = image.scene

    def own(face: FaceImage, at: IntArray) -> Pixels:
        rows = (image.surface if face is scene.face else image.targets).ravel()[at]
        of_reasons = REASON_COLOURS.take(rows, axis=0), REASON_HATCHES[rows]
        return hatch_pixels(*of_reasons, at, face.shape[1], scene.hatch)

    pixels = paint(scene, neutral(scene.mesh, scene.setting), own)
    pixels[image.hidden & stripes(scene.face.shape, scene.stripe, 4)] = REASONS["occluded"].colour
    return pixels


def camera_keys(image: CameraImage) -> list[Key]:
    """Legend of a picture of a camera: everything that is in it."""
    scene = image.scene
    is_judged = scene.mesh.task_mask & ~scene.backs
    pairs = (scene.face, image.surface), (scene.targets, image.targets)
    judged = np.concatenate([rows[on_pixels(is_judged, face)] for face, rows in pairs])
    shown = np.unique(judged)[::-1].tolist()  # what is covered, first
    keys = [Key.of_reason(NAMES[reason]) for reason in shown]
    keys += scene_keys([scene])
    if image.hidden.any():
        colours = scene.setting.occluder, REASONS["occluded"].colour
        keys.append(Key.of("occluder that hides the evaluated surface", *colours, 4, 4))
    if (scene.face < 0).any():
        keys.append(Key.of("background", scene.setting.background))
    return keys
