"""Cameras: intrinsics, lenses, poses, rigs, rays, the near plane."""

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.conventions import (
    Border,
    Conventions,
    centre_camera,
    from_vectors,
    inverse_of,
    lens_camera,
    model_in,
    share_frames,
)
from rastercov.core.camera.doubts import size_warnings, unit_warnings
from rastercov.core.camera.gate import Gate
from rastercov.core.camera.models import MODELS, PROGRAMS, Foreign
from rastercov.core.camera.near_plane import near_limit, near_limits
from rastercov.core.camera.pose import Poses, renumber, valid_poses
from rastercov.core.camera.projection import box_corners, to_camera, to_image
from rastercov.core.camera.rig import (
    Cameras,
    EquipmentKind,
    Rig,
    Views,
    apparent,
    axes_of,
    by_gate,
    cameras_of,
    check_scene,
    equipment_on,
    equipment_words,
    eyes_of,
    gates_of,
    is_joint,
    led_by,
    names_of,
    names_of_poses,
    rows_of_result,
)
from rastercov.core.camera.viewpoints import distance_to_keep, fibonacci_sphere, look_at, upwards

__all__ = [
    "MODELS",
    "PROGRAMS",
    "Border",
    "Camera",
    "Cameras",
    "Conventions",
    "EquipmentKind",
    "Foreign",
    "Gate",
    "Poses",
    "Rig",
    "Views",
    "apparent",
    "axes_of",
    "box_corners",
    "by_gate",
    "cameras_of",
    "centre_camera",
    "check_scene",
    "distance_to_keep",
    "equipment_on",
    "equipment_words",
    "eyes_of",
    "fibonacci_sphere",
    "from_vectors",
    "gates_of",
    "inverse_of",
    "is_joint",
    "led_by",
    "lens_camera",
    "look_at",
    "model_in",
    "names_of",
    "names_of_poses",
    "near_limit",
    "near_limits",
    "renumber",
    "rows_of_result",
    "share_frames",
    "size_warnings",
    "to_camera",
    "to_image",
    "unit_warnings",
    "upwards",
    "valid_poses",
]
