"""sensor.yaml of EuRoC, TUM-VI and other data sets in the layout of ASL: one camera on its body.

The calibration is Kalibr's, with other words, and T_BS is body_from_sensor, in metres.

Source: M. Burri et al. The EuRoC micro aerial vehicle datasets. 2016.
"""

from rastercov.base.errors import CameraError
from rastercov.camera.formats import kalibr
from rastercov.camera.formats.conventions import Border
from rastercov.camera.formats.source import Entries, Source, keys_of
from rastercov.camera.rig import Views

DISTORTION = {"radial-tangential": "radtan", "equidistant": "equi", "none": "none"}
"""Kalibr's words for distortion models."""


def is_mine(content: object) -> bool:
    """True for a sensor at its place on a body."""
    return {"sensor_type", "T_BS"} <= keys_of(content)


def read(source: Source, border: Border) -> Views:
    """The camera, in the frame of the body."""
    sensor = Entries(source.yaml, "sensor")
    if (kind := sensor.text("sensor_type", "none")) != "camera":
        raise CameraError(f"expected sensor_type camera, got {kind}; name the file of a camera")
    model = sensor.choice("distortion_model", DISTORTION, "none")
    camera = {name: sensor.need(name) for name in ("camera_model", "intrinsics", "resolution")}
    camera |= {
        "distortion_model": DISTORTION[model],
        "distortion_coeffs": sensor.get("distortion_coefficients", []),
        "T_imu_cam": sensor.table("T_BS").need("data"),
    }
    return kalibr.of_chain({"cam0": camera}, border)
