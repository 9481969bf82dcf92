"""Factory calibration of Azure Kinect, in the JSON that its recordings and SDK have.

Lengths of the image are parts of its sides, from its corner; Rt is camera_from_depth with our axes,
in metres. `MetricRadius` is the radius in the plane z = 1 up to which the calibration is valid.

Source: Azure Kinect Sensor SDK 1.4, src/transformation/{mode_specific_calibration,
intrinsic_transformation,extrinsic_transformation}.c.
"""

import math
from dataclasses import replace

import numpy as np

from rastercov.base import arctan2
from rastercov.core.camera import Border, Camera, Views, inverse_of, lens_camera
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import Entries, Source, keys_of

PARAMETERS = (
    *("cx", "cy", "fx", "fy", "k1", "k2", "k3", "k4", "k5", "k6"),
    *("codx", "cody", "p2", "p1"),
)
MODEL = "CALIBRATION_LensDistortionModelBrownConrady"


def is_mine(content: object) -> bool:
    """True for calibration information."""
    return "CalibrationInformation" in keys_of(content)


def read(source: Source, border: Border) -> Views:
    """Cameras of a device at the full size of their sensors, in the frame of the depth camera."""
    device = Entries(source.table).table("CalibrationInformation")
    tables = [each for _, each in device.tables("Cameras")]
    if not tables:
        raise device.wrong("Cameras", "a list of cameras", [])
    border.note("cameras are those of the full sensor; a mode of the device may crop or bin it")
    names = [each.text("Location", "camera").removeprefix("CALIBRATION_Camera") for each in tables]
    cameras = [_camera(each) for each in tables]
    places = [each.table("Rt") for each in tables]
    turns = np.array([each.array("Rotation", (9,)).reshape(3, 3) for each in places])
    shifts = np.array([each.array("Translation", (3,)) for each in places])
    return border.views_of_rig(
        cameras, names, inverse_of(motions(turns, shifts)), "the depth camera"
    )


def _camera(entries: Entries) -> Camera:
    lens = entries.table("Intrinsics")
    lens.choice("ModelType", (MODEL,))
    p = lens.named("ModelParameters", PARAMETERS)
    if p["codx"] or p["cody"]:
        raise lens.wrong(
            "ModelParameters", "without a center of distortion", [p["codx"], p["cody"]]
        )
    width, height = entries.side("SensorWidth"), entries.side("SensorHeight")
    p |= {"fx": p["fx"] * width, "cx": p["cx"] * width}
    p |= {"fy": p["fy"] * height, "cy": p["cy"] * height}
    camera = lens_camera("opencv", (width, height), p)
    if "MetricRadius" not in entries:
        return camera
    limit = math.degrees(arctan2(entries.positive("MetricRadius"), 1.0))
    return replace(camera, max_angle_deg=limit)
