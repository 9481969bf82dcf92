"""Camera chains of Kalibr: cam0, cam1, ... with T_cn_cnm1 from each camera to the next.

Axes are ours, lengths are metres (those of its target), and pixels are counted from their centres,
as the detectors of its targets do. Poses are those of the chain: in the frame of cam0, or of the
IMU where there are T_cam_imu, or their inverse T_imu_cam of OpenVINS, alone.

Sources: Kalibr, kalibr_common/ConfigReader.py; wiki, "Yaml formats", "Supported models". OpenVINS,
config/*/kalibr_imucam_chain.yaml.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from rastercov.base.checks import shown
from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import Border, inverse_of, lens_camera
from rastercov.camera.formats.source import Entries
from rastercov.camera.models import PROGRAMS
from rastercov.camera.rig import Views

CAMERA_NAME = re.compile(r"cam(0|[1-9][0-9]{0,5})")
MOST_SHOWN = 8
"""Names of cameras in a message."""
KALIBR = PROGRAMS["kalibr"]
CAMERA_MODELS, DISTORTION_MODELS = (
    tuple(dict.fromkeys(name.split("-")[part] for name in KALIBR)) for part in (0, 1)
)
HARMLESS = frozenset(
    {"rostopic", "cam_overlaps", "timeshift_cam_imu", "line_delay", "shutter_type"}
)
KNOWN = HARMLESS | {
    *("camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution"),
    *("T_cn_cnm1", "T_cam_imu", "T_imu_cam"),
}
"""Entries of a camera."""


def is_mine(content: Any) -> bool:
    """True for a table with a cam0, or another camera by number."""
    return isinstance(content, Mapping) and any(
        CAMERA_NAME.fullmatch(name) and isinstance(value, Mapping) and "camera_model" in value
        for name, value in content.items()
    )


def read(content: Any, border: Border) -> Views:
    """Cameras of a chain, with their places."""
    chain = Entries(content, "camchain")
    found = [name for name in content if CAMERA_NAME.fullmatch(name)]
    names = [f"cam{row}" for row in range(len(found))]
    if not found:
        raise CameraError("cameras cam0, cam1, ... wanted, got none")
    for name in content.keys() - set(found):
        value = content[name]
        if isinstance(value, Mapping) and not value.keys().isdisjoint(KNOWN):
            raise CameraError(
                f"cameras cam0, cam1, ... wanted, got a table {shown(name)} beside them; rename "
                "it, or leave it out"
            )
    border.unknown.look("the chain", [*content], frozenset(found))
    if set(names) != set(found):
        raise CameraError(
            f"cameras {', '.join(names[:MOST_SHOWN])} wanted, each with its place from the one "
            f"before, got {', '.join(found[:MOST_SHOWN])}; number them from 0 without a gap"
        )
    entries = [chain.table(name) for name in names]
    for each in entries:
        border.unknown.look(each.where, each.names(), KNOWN, HARMLESS)
    cameras = [_camera(each) for each in entries]
    border.note("pixels are taken to be counted from their centres, as Kalibr's detectors do")
    later = entries[1:]
    if all("T_cn_cnm1" in each for each in later):
        places = [np.eye(4)]
        for each in later:
            places.append(places[-1] @ _inverse(each, "T_cn_cnm1"))
        frame = "cam0"
    elif all(each.any_of("T_cam_imu", "T_imu_cam") for each in entries):
        places = [
            _inverse(each, "T_cam_imu") if "T_cam_imu" in each else _motion(each, "T_imu_cam")
            for each in entries
        ]
        frame = "the IMU"
    else:
        border.note("the chain has no T_cn_cnm1 or T_cam_imu of each: cameras without places")
        return border.views(cameras, names)
    border.note(f"poses are in the frame of {frame}")
    return border.views(
        cameras,
        names,
        world_from_camera=np.array(places),
        camera=np.arange(len(names)),
        images=names,
        rig_from_camera=np.array(places),
        metres=1.0,
    )


def _motion(entries: Entries, name: str) -> Any:
    # Some tools that write chains by hand have the 16 numbers in one row.
    return entries.array(name, (4, 4), (16,)).reshape(4, 4)


def _inverse(entries: Entries, name: str) -> Any:
    return inverse_of(_motion(entries, name)[None])[0]


def _camera(entries: Entries) -> Camera:
    model = entries.text("camera_model")
    distortion = entries.text("distortion_model", "none")
    if model not in CAMERA_MODELS or distortion not in DISTORTION_MODELS:
        raise CameraError(
            f"{entries.where}: camera_model must be one of {', '.join(CAMERA_MODELS)}, and "
            f"distortion_model one of {', '.join(DISTORTION_MODELS)}, got {shown(model)}, "
            f"{shown(distortion)}"
        )
    foreign = KALIBR.get(f"{model}-{distortion}")
    if foreign is None:
        raise CameraError(
            f"{entries.where}: distortion {distortion} comes with camera model pinhole only, "
            f"got {model}"
        )
    intrinsics, _, coefficients = foreign.parameters.partition(" cy")
    p = dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
    p |= _named(entries, "intrinsics", f"{intrinsics} cy")
    p |= _named(entries, "distortion_coeffs", coefficients.strip())
    p |= {"cx": p["cx"] + 0.5, "cy": p["cy"] + 0.5}
    return lens_camera(foreign.ours, entries.array("resolution", (2,)).tolist(), p)


def _named(entries: Entries, name: str, order: str) -> dict[str, float]:
    names = order.split()
    values = entries.row(name) if names or name in entries else []
    if len(values) != len(names):
        raise CameraError(
            f"{entries.where}: {name} must be {len(names)} numbers"
            f"{f' ({order})' if order else ''}, got {len(values)}"
        )
    return dict(zip(names, values, strict=True))
