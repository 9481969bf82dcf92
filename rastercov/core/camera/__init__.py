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
from rastercov.core.camera.models import MODELS, PROGRAMS, Foreign
from rastercov.core.camera.pose import Poses, near_limit, near_limits, renumber, valid_poses
from rastercov.core.camera.projection import box_corners, to_camera, to_image
from rastercov.core.camera.rig import (
    KEPT,
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
    heads_of,
    is_joint,
    led_by,
    movers,
    names_by_origin,
    names_of,
    names_of_poses,
    rows_of_result,
)
from rastercov.core.camera.rule import Gate
from rastercov.core.camera.viewpoints import distance_to_keep, fibonacci_sphere, look_at, upwards
