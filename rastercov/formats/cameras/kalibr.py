"""Camera chains of Kalibr: cam0, cam1, ... with T_cn_cnm1 from each camera to the next.

Axes are ours, lengths are metres (those of its target), and pixels are counted from their centres,
as the detectors of its targets do. Poses are those of the chain: in the frame of cam0, or of the
IMU where there are T_cam_imu, or their inverse T_imu_cam of OpenVINS, alone.

Sources: Kalibr, kalibr_common/ConfigReader.py; wiki, "Yaml formats", "Supported models". OpenVINS,
config/*/kalibr_imucam_chain.yaml.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rastercov.base import ByName, CameraError, ReadByName, matmul, shown
from rastercov.core.camera import PROGRAMS, Border, Camera, Views, centre_camera, inverse_of
from rastercov.formats.cameras.source import Entries, Source, check_array_of, keys_of

CAMERA_NAME = re.compile(r"cam(0|[1-9][0-9]{0,5})")
WANTED = "cam0, cam1, ..."
OF_CAMERA = {"camera_model", "intrinsics", "resolution"}
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


def is_mine(content: object) -> bool:
    """True for a chain, under whatever names."""
    return bool(_cameras_in(content)) and not {"T_BS", "sensor_type"} & keys_of(content)


def _cameras_in(content: object) -> ByName:
    """Tables of cameras by name: of a chain, of one below another name, or of a lone camera."""
    if keys_of(content) >= OF_CAMERA:
        return {"cam0": content}
    tables = (content, *content.values()) if isinstance(content, Mapping) else ()
    chains = (
        {name: each for name, each in table.items() if "camera_model" in keys_of(each)}
        for table in tables
        if isinstance(table, Mapping)
    )
    return next(filter(None, chains), {})


def read(source: Source, border: Border) -> Views:
    """Cameras of a chain, with their places."""
    content = source.table
    own = _cameras_in(content)
    if any(CAMERA_NAME.fullmatch(name) for name in own) and own.keys() <= keys_of(content):
        return of_chain(content, border)
    if not own:
        raise CameraError(f"expected cameras {WANTED}, got none; name another file")
    if {*own} != {f"cam{row}" for row in range(len(own))}:
        names = ", ".join(map(shown, [*own][:MOST_SHOWN]))
        border.note(f"took {names} for cam0, cam1, ... of Kalibr, in the order of the file")
        own = {f"cam{row}": each for row, each in enumerate(own.values())}
    return of_chain(own, border)


def of_chain(content: ReadByName, border: Border) -> Views:
    """Cameras of the table of a chain."""
    chain = Entries(content, "camchain")
    items = [name for name in content if CAMERA_NAME.fullmatch(name)]
    names = [f"cam{row}" for row in range(len(items))]
    for name, value in content.items():
        if name not in items and isinstance(value, Mapping) and value.keys() & KNOWN:
            raise CameraError(
                f"expected cameras {WANTED}, got a table {shown(name)} beside them; rename it"
            )
    border.unknown.look("the chain", [*content], frozenset(items))
    if not items or set(names) != set(items):
        raise CameraError(
            f"expected cameras {WANTED}, got {', '.join(items[:MOST_SHOWN]) or 'none'}; "
            "number them from 0 without a gap"
        )
    entries = [chain.table(name) for name in names]
    for each in entries:
        border.unknown.look(each.where, each.names(), KNOWN, HARMLESS)
    cameras = [_camera(each) for each in entries]
    border.note("pixels are taken to be counted from their centres, as Kalibr's detectors do")
    on_imu = all(each.any_of("T_cam_imu", "T_imu_cam") for each in entries)
    if all("T_cn_cnm1" in each for each in entries[1:]) and not (on_imu and len(entries) == 1):
        places, frame = [np.eye(4)[None]], "cam0"
        for each in entries[1:]:
            places.append(matmul(places[-1], inverse_of(_motion(each, "T_cn_cnm1"))))
    elif on_imu:
        key = "T_cam_imu"
        places = [
            inverse_of(_motion(each, key)) if key in each else _motion(each, "T_imu_cam")
            for each in entries
        ]
        frame = "the IMU"
    else:
        border.note(
            "read cameras without poses on the rig: T_cn_cnm1 or T_cam_imu of some is missing"
        )
        return border.views(cameras, names)
    return border.views_of_rig(cameras, names, np.concatenate(places), frame)


def _motion(entries: Entries, name: str) -> Any:
    """(1, 4, 4): some tools that write chains by hand have the 16 numbers in one row."""
    return entries.array(name, (4, 4), (16,)).reshape(1, 4, 4)


def _camera(entries: Entries) -> Camera:
    model = entries.choice("camera_model", CAMERA_MODELS)
    distortion = entries.choice("distortion_model", DISTORTION_MODELS, "none")
    foreign = KALIBR.get(f"{model}-{distortion}")
    if foreign is None:
        raise entries.wrong("camera_model", f"pinhole with distortion {distortion}", model)
    intrinsics, _, coefficients = foreign.parameters.partition(" cy")
    p = dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
    p |= _name_values(entries, "intrinsics", f"{intrinsics} cy".split())
    p |= _name_values(entries, "distortion_coeffs", coefficients.split())
    return centre_camera(foreign.ours, entries.array("resolution", (2,)).tolist(), p)


def _name_values(entries: Entries, name: str, names: Sequence[str]) -> dict[str, float]:
    given = entries.need(name) if names else entries.get(name, [])
    what = f"{entries.where}: {name} ({' '.join(names)})"
    return dict(zip(names, check_array_of(given, what, (len(names),)).tolist(), strict=True))
