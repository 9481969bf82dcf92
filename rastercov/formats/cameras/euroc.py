"""Sensors of EuRoC, TUM-VI and Kimera-VIO, and rigs of SVO and maplab: all in ASL's layout.

Calibrations are Kalibr's with other words, pixels are counted from their centres, and T_BS and
T_B_C are body_from_camera, in metres.

Sources: M. Burri et al. The EuRoC micro aerial vehicle datasets. 2016. Kimera-VIO,
src/frontend/CameraParams.cpp. aslam_cv2, aslam_cv_cameras/src/ncamera.cc.
"""

from collections.abc import Mapping

from rastercov.base import ByName, CameraError, ReadByName
from rastercov.core.camera import Border, Views
from rastercov.formats.cameras import kalibr
from rastercov.formats.cameras.source import Entries, Source, first_in, keys_of

DISTORTION = {
    **dict.fromkeys(("radial-tangential", "radtan"), "radtan"),
    **dict.fromkeys(("equidistant", "equi"), "equi"),
    "fisheye": "fov",
    "none": "none",
}
"""Kalibr's words for distortion models; fisheye has one angle, as in PTAM."""
MODELS = {"pinhole": "pinhole", "unified-projection": "omni"}
"""Kalibr's words for cameras of a rig."""


def is_mine(content: object) -> bool:
    """True for a sensor at its place on a body, and for a rig of cameras."""
    return _rig_in(content) is not None or (
        "T_BS" in keys_of(content) and bool({"sensor_type", "intrinsics"} & keys_of(content))
    )


def _rig_in(content: object) -> object:
    """Table with a list of cameras at their places: all of a file, or one of maplab's sensors."""
    sensors = content.get("sensors") if isinstance(content, Mapping) else None
    tables = (content, *(sensors if isinstance(sensors, list) else ()))
    wanted = {"camera", "T_B_C"}
    return next((each for each in tables if wanted <= keys_of(first_in(each, "cameras"))), None)


def read(source: Source, border: Border) -> Views:
    """Cameras in the frame of the body."""
    file = source.table
    if (rig := _rig_in(file)) is not None:
        if rig is not file:
            border.note("read the first rig of cameras; extrinsics of sensors are not read")
        rows = enumerate(Entries(rig).tables("cameras"))
        return kalibr.of_chain({f"cam{row}": _of_rig(each) for row, (_, each) in rows}, border)
    sensor = Entries(file, "sensor")
    if (kind := sensor.text("sensor_type", "camera")) != "camera":
        raise CameraError(f"expected sensor_type camera, got {kind}; name the file of a camera")
    camera = {name: sensor.need(name) for name in ("camera_model", "intrinsics", "resolution")}
    coefficients = sensor.get("distortion_coefficients", [])
    place = sensor.table("T_BS").need("data")
    model = sensor.choice("distortion_model", DISTORTION, "none")
    return kalibr.of_chain({"cam0": camera | _others(model, coefficients, place)}, border)


def _of_rig(entry: Entries) -> ReadByName:
    """Entries of Kalibr for a camera of a rig."""
    camera = entry.table("camera")
    lens = camera.table("distortion") if "distortion" in camera else Entries({})
    model = lens.choice("type", DISTORTION, "none")
    return {
        "camera_model": MODELS[camera.choice("type", MODELS)],
        "intrinsics": _data(camera, "intrinsics"),
        "resolution": [camera.side("image_width"), camera.side("image_height")],
        **_others(model, _data(lens, "parameters"), _data(entry, "T_B_C")),
    }


def _others(model: str, coefficients: object, place: object) -> ByName:
    """Entries of Kalibr for a lens and its place on the body."""
    kind = DISTORTION[model]
    if kind == "none" and isinstance(coefficients, list) and not any(coefficients):
        coefficients = []
    return {"distortion_model": kind, "distortion_coeffs": coefficients, "T_imu_cam": place}


def _data(entries: Entries, name: str) -> object:
    """Numbers of a matrix: a table with data, or a list."""
    value = entries.get(name, [])
    return entries.table(name).need("data") if isinstance(value, Mapping) else value
