"""Calibrations of camodocal and VINS: model_type with its tables of parameters.

Pixels are counted from their centres. `body_T_cam0`, ... of VINS-Fusion, and extrinsicRotation with
extrinsicTranslation of VINS-Mono, are imu_from_camera with our axes, in metres.

Sources: camodocal, src/camera_models/*.cc; VINS-Fusion, estimator/parameters.cpp.
"""

from pathlib import Path

import numpy as np

from rastercov.base import CameraError, FloatArray, shown
from rastercov.core.camera import Border, Camera, Views, centre_camera
from rastercov.formats.cameras.source import Entries, Source, keys_of

MODELS = {
    "PINHOLE": ("opencv", "fx fy cx cy k1 k2 p1 p2", ""),
    "PINHOLE_FULL": ("opencv", "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2", ""),
    "KANNALA_BRANDT": ("opencv_fisheye", "fx fy cx cy k1 k2 k3 k4", "mu mv u0 v0 k2 k3 k4 k5"),
    "MEI": ("omni", "fx fy cx cy xi k1 k2 p1 p2", "gamma1 gamma2 u0 v0 xi k1 k2 p1 p2"),
}
"""Our model, its parameters, and their names in the file unless they are the same."""
TABLES = ("mirror_parameters", "distortion_parameters", "projection_parameters")


def is_mine(content: object) -> bool:
    """True for a model_type, and for a rig of such files."""
    return bool({"model_type", "cam0_calib"} & keys_of(content))


def read(source: Source, border: Border) -> Views:
    """The camera of a calibration, or those of VINS-Fusion's configuration beside their files."""
    file = Entries(source.yaml)
    if "model_type" in file:
        name = file.text("camera_name", "camera")
        rotation, shift = (f"extrinsic{name}" for name in ("Rotation", "Translation"))
        if {rotation, shift} <= {*file.names()}:
            place = np.eye(4)
            place[:3, :3], place[:3, 3] = _data(file, rotation, 3, 3), _data(file, shift, 3)
            return border.views_of_rig([_camera(file)], [name], place[None], "the IMU")
        return border.views([_camera(file)], [name])
    names = [name for name in file.names() if name.startswith("cam") and name.endswith("_calib")]
    names = names[: int(file.number("num_of_cam", len(names)))]
    cameras = []
    for name in names:
        other = source.path.with_name(Path(file.text(name)).name or "nothing")
        if not other.is_file():
            raise CameraError(
                f"expected {shown(other.name)}, {name}, beside it, got none; put it into the folder"
            )
        cameras.append(_camera(Entries(Source(other).yaml, other.name)))
    labels = [name.removesuffix("_calib") for name in names]
    places = np.array([_data(file, f"body_T_{label}", 4, 4) for label in labels])
    return border.views_of_rig(cameras, labels, places, "the IMU")


def _data(file: Entries, name: str, *shape: int) -> FloatArray:
    """Numbers of a matrix of OpenCV."""
    return file.table(name).array("data", (int(np.prod(shape)),)).reshape(shape)


def _camera(file: Entries) -> Camera:
    ours, order, theirs = MODELS[file.choice("model_type", MODELS)]
    values: dict[str, object] = {}
    for name in TABLES:
        if name in file:
            own = file.table(name)
            values |= {key: own.get(key) for key in own.names()}
    table = Entries(values, file.part(", ".join(name for name in TABLES if name in file)))
    numbers = map(table.number, (theirs or order).split())
    p = dict(zip(order.split(), numbers, strict=True))
    return centre_camera(ours, (file.side("image_width"), file.side("image_height")), p)
