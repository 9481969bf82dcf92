"""Cameras of Open3D: PinholeCameraIntrinsic, PinholeCameraParameters, PinholeCameraTrajectory.

Matrices are lists of their columns. `extrinsic` is camera_from_world with our axes, pixels are
counted from their centres, and lengths are those of the scene, which the file does not state.

Source: Open3D 0.19, cpp/open3d/camera/*.cpp; cpp/open3d/geometry/PointCloudFactory.cpp.
"""

from collections.abc import Mapping

import numpy as np

from rastercov.core.camera import Border, Camera, Views, inverse_of
from rastercov.formats.cameras.source import Entries, Source


def is_mine(content: object) -> bool:
    """True for intrinsics, for parameters of a camera, and for a trajectory."""
    return isinstance(content, Mapping) and (
        "intrinsic_matrix" in content
        or {"extrinsic", "intrinsic"} <= content.keys()
        or content.get("class_name") == "PinholeCameraTrajectory"
    )


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of a trajectory, or of one camera."""
    file = Entries(source.table)
    if "intrinsic_matrix" in file:
        return border.views([_camera(file)])
    parts = [each for _, each in file.tables("parameters")] if "parameters" in file else [file]
    poses = [each.array("extrinsic", (16,)).reshape(4, 4).T for each in parts]
    return border.views_of_images(
        [_camera(each.table("intrinsic")) for each in parts],
        [f"view {row}" for row in range(len(parts))],
        world_from_camera=inverse_of(np.array(poses).reshape(-1, 4, 4)),
    )


def _camera(entries: Entries) -> Camera:
    matrix = entries.array("intrinsic_matrix", (9,)).reshape(3, 3).T
    return Camera.from_opencv(matrix, entries.side("width"), entries.side("height"))
