"""Calibrations of basalt, as cereal writes them: cameras on an IMU.

T_imu_cam is imu_from_camera with our axes, in metres, and pixels are counted from their centres.
`rpmax` is the radius in the plane z = 1 up to which the calibration is valid.

Source: basalt-headers, include/basalt/camera/*.hpp, serialization/*.h.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from rastercov.base import arctan2
from rastercov.core.camera import Border, Camera, Foreign, Views, centre_camera
from rastercov.core.camera.conventions import from_quaternions
from rastercov.formats.cameras.source import Entries, Source, check_array_of

MODELS = {
    "pinhole": Foreign("opencv"),
    "pinhole-radtan8": Foreign("opencv", "k1 k2 p1 p2 k3 k4 k5 k6"),
    "kb4": Foreign("opencv_fisheye", "k1 k2 k3 k4"),
    "ds": Foreign("double_sphere", "xi alpha"),
    "eucm": Foreign("eucm", "alpha beta"),
    "ucm": Foreign("eucm", "alpha"),
    "fov": Foreign("fov", "w"),
}
"""Models, whose parameters follow fx, fy, cx and cy; ucm is eucm with beta = 1."""

MOTION = ("qw", "qx", "qy", "qz", "px", "py", "pz")


def is_mine(content: object) -> bool:
    """True for a value of cereal with intrinsics and places on the IMU."""
    value = content.get("value0") if isinstance(content, Mapping) else None
    return isinstance(value, Mapping) and {"intrinsics", "resolution"} <= value.keys()


def read(source: Source, border: Border) -> Views:
    """Cameras of a calibration, in the frame of the IMU."""
    file = Entries(source.table).table("value0")
    resolution = file.need("resolution")
    if not isinstance(resolution, list):
        raise file.wrong("resolution", "a list of sizes", resolution)
    sizes = dict(enumerate(resolution))
    cameras = [
        _camera(each, check_array_of(sizes.get(row), f"{each.where}: resolution", (2,)).tolist())
        for row, (_, each) in enumerate(file.tables("intrinsics"))
    ]
    places = [each for _, each in file.tables("T_imu_cam")]
    rows = [[each.number(name) for name in MOTION] for each in places]
    motion = check_array_of(rows, f"{file.where}: T_imu_cam", (len(cameras), 7))
    poses = from_quaternions(motion[:, :4], motion[:, 4:])
    names = [f"cam{row}" for row in range(len(cameras))]
    return border.views_of_rig(cameras, names, poses, "the IMU")


def _camera(entries: Entries, size: list[int]) -> Camera:
    ours, order = MODELS[entries.choice("camera_type", MODELS)]
    values = entries.table("intrinsics")
    p = {name: values.number(name) for name in ("fx", "fy", "cx", "cy", *order.split())}
    p |= {"beta": p.get("beta", 1.0), "omega": p.get("w", 0.0)}
    camera = centre_camera(ours, size, p)
    if (radius := values.number("rpmax", 0.0)) > 0:
        return replace(camera, max_angle_deg=math.degrees(arctan2(radius, 1.0)))
    return camera
