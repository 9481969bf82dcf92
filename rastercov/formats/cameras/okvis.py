"""Configurations of OKVIS: cameras with T_SC, the sensor frame from the camera, in metres.

Axes are ours, and pixels are counted from their centres.

Source: OKVIS, okvis_multisensor_processing/src/VioParametersReader.cpp.
"""

import numpy as np

from rastercov.core.camera import Border, Camera, Foreign, Views, centre_camera
from rastercov.formats.cameras.source import Entries, Source, first_in, keys_of

MODELS = {
    "radialtangential": Foreign("opencv", "k1 k2 p1 p2"),
    "plumb_bob": Foreign("opencv", "k1 k2 p1 p2"),
    "equidistant": Foreign("opencv_fisheye", "k1 k2 k3 k4"),
    "radialtangential8": Foreign("opencv", "k1 k2 p1 p2 k3 k4 k5 k6"),
}


def is_mine(content: object) -> bool:
    """True for a list of cameras at their places on the sensor."""
    return "T_SC" in keys_of(first_in(content, "cameras"))


def read(source: Source, border: Border) -> Views:
    """Cameras in the frame of the sensor, which is the IMU."""
    entries = [each for _, each in Entries(source.table).tables("cameras")]
    names = [f"cam{row}" for row in range(len(entries))]
    places = np.array([each.array("T_SC", (16,)).reshape(4, 4) for each in entries])
    return border.views_of_rig([*map(_camera, entries)], names, places, "the IMU")


def _camera(entries: Entries) -> Camera:
    ours, order = MODELS[entries.choice("distortion_type", MODELS)]
    p = entries.named("distortion_coefficients", order.split())
    p |= entries.named("focal_length", ("fx", "fy"))
    p |= entries.named("principal_point", ("cx", "cy"))
    return centre_camera(ours, entries.array("image_dimension", (2,)).tolist(), p)
