"""SfM files of AliceVision and Meshroom, .sfm and JSON: views, intrinsics, poses and rigs.

Numbers are texts. Poses are camera_from_world with our axes as a center and a rotation by columns;
views of a rig without a pose of their own take that of the rig, after camera_from_rig. Pixels are
counted from their centres, and the principal point from the middle of the image since version
1.2.1. There is no unit.

Source: AliceVision, src/aliceVision/sfmDataIO/jsonIO.cpp, sfmData/SfMData.hpp, camera/.
"""

import math
from collections.abc import Iterable
from pathlib import PurePosixPath

import numpy as np

from rastercov.base import CameraError, FloatArray, matmul, shown
from rastercov.core.camera import (
    Border,
    Camera,
    Foreign,
    Views,
    centre_camera,
    inverse_of,
    share_frames,
)
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import (
    Entries,
    Source,
    check_array_of,
    check_ids,
    keys_of,
    number_of,
)

MODELS = {
    "none": Foreign("opencv"),
    "radialk1": Foreign("opencv", "k1"),
    "radialk3": Foreign("opencv", "k1 k2 k3"),
    "brown": Foreign("opencv", "k1 k2 k3 p1 p2"),
    "fisheye": Foreign("opencv_fisheye", "k1 k2 k3 k4"),
    "fisheye1": Foreign("fov", "omega"),
}
"""By `distortionType`."""
OLD_TYPES = {
    "pinhole": "none",
    "radial1": "radialk1",
    "radial3": "radialk3",
    "brown": "brown",
    "fisheye4": "fisheye",
    "fisheye1": "fisheye1",
}
"""`distortionType` by the `type` that files before version 1.2.8 have."""
WAY = "undistort the images by PrepareDenseScene"


def is_mine(content: object) -> bool:
    """True for a table with views, and intrinsics or folders of features of AliceVision."""
    keys = keys_of(content)
    return "views" in keys and ("featuresFolders" in keys or {"version", "intrinsics"} <= keys)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the views that have both."""
    entries = Entries(source.table, "the file")
    version = tuple(_numbers(entries, "version", (3,)).tolist())
    cameras = _by_id(entries, "intrinsics", "intrinsicId")
    poses = _by_id(entries, "poses", "poseId")
    mounts = {
        (_id(rig, "rigId"), str(row)): mount
        for rig in _list(entries, "rigs")
        for row, mount in enumerate(_list(rig, "subPoses"))
    }
    table: dict[str, Camera] = {}
    used, images, matrices, frames = [], [], [], []
    views = list(_list(entries, "views"))
    for view in views:
        pose, camera = poses.get(_id(view, "poseId")), _id(view, "intrinsicId")
        on_rig = "rigId" in view and str(view.get("isPoseIndependant", "1")) in ("0", "false")
        mount = mounts.get((_id(view, "rigId"), _id(view, "subPoseId"))) if on_rig else None
        if pose is None or camera not in cameras or (on_rig and mount is None):
            continue
        matrix = _motion(pose.table("pose").table("transform"))
        if mount is not None:
            matrix = matmul(_motion(mount.table("pose")), matrix)
        if camera not in table:
            table[camera] = _camera(cameras[camera], version)
        used.append(table[camera])
        images.append(PurePosixPath(str(view.get("path", ""))).name or _id(view, "viewId"))
        matrices.append(matrix)
        frames.append(_id(view, "poseId") if on_rig else None)
    if not used:
        raise CameraError(
            "expected views with poses and intrinsics, got none; name the sfm.json or cameras.sfm "
            "of the node StructureFromMotion"
        )
    if len(used) < len(views):
        border.note(f"{len(views) - len(used)} views left out: they have no pose, or no camera")
    return border.views_of_images(
        used,
        images,
        world_from_camera=inverse_of(np.array(matrices)),
        frames=share_frames(frames, images),
    )


def _list(entries: Entries, name: str) -> Iterable[Entries]:
    """Tables of a list, which may be missing or, if it is empty, a text."""
    return (each for _, each in entries.tables(name)) if entries.get(name, "") != "" else ()


def _by_id(entries: Entries, name: str, key: str) -> dict[str, Entries]:
    """Tables of a list by their ids."""
    tables = list(_list(entries, name))
    check_ids(key, [_id(each, key) for each in tables])
    return {_id(each, key): each for each in tables}


def _id(entries: Entries, name: str) -> str:
    return str(entries.get(name, ""))


def _numbers(entries: Entries, name: str, *shapes: tuple[int, ...]) -> FloatArray:
    """Numbers of a text, or of a list of texts."""
    value = entries.need(name)
    typed = [_value_of(each) for each in value] if isinstance(value, list) else _value_of(value)
    return check_array_of(typed, f"{entries.where}: {name}", *shapes)


def _value_of(value: object) -> object:
    return number_of(value) if isinstance(value, str) else value


def _motion(entries: Entries) -> FloatArray:
    """(4, 4) camera from the frame that the center is in."""
    rotation = _numbers(entries, "rotation", (9,)).reshape(3, 3).T
    center = _numbers(entries, "center", (3,))
    return motions(rotation, matmul(-rotation, center))[0]


def _camera(entries: Entries, version: tuple[float, ...]) -> Camera:
    where, kind = entries.where, entries.text("type").lower()
    distortion = OLD_TYPES.get(kind, kind)
    if version >= (1, 2, 8):
        distortion = entries.text("distortionType", "none").lower() if kind == "pinhole" else kind
    undone = entries.text("undistortionType", "none").lower()
    if distortion not in MODELS or undone != "none":
        got = shown(
            kind if distortion not in MODELS and kind != "pinhole" else f"{distortion}, {undone}"
        )
        raise CameraError(f"{where}: expected a lens {', '.join(MODELS)}, got {got}; {WAY}")
    width, height = (int(_numbers(entries, name, ())) for name in ("width", "height"))
    p = dict(zip(("fx", "fy"), _focals(entries, version, width), strict=True))
    cx, cy = _numbers(entries, "principalPoint", (2,)).tolist()
    middle = (width / 2, height / 2) if version >= (1, 2, 1) else (0.0, 0.0)
    p |= {"cx": cx + middle[0], "cy": cy + middle[1]}
    ours, names = MODELS[distortion]
    if names:
        count = len(names.split())
        p |= dict(
            zip(
                names.split(), _numbers(entries, "distortionParams", (count,)).tolist(), strict=True
            )
        )
    return centre_camera(ours, (width, height), p)


def _focals(entries: Entries, version: tuple[float, ...], width: int) -> tuple[float, float]:
    """Focal lengths, px: by their own number, and since 1.2.2 of millimetres and the ratio."""
    if version < (1, 2, 2):
        shape = () if version < (1, 2, 0) else (2,)
        fx, fy = np.broadcast_to(_numbers(entries, "pxFocalLength", shape), 2).tolist()
    else:
        sensor = float(_numbers(entries, "sensorWidth", ())) if "sensorWidth" in entries else 36.0
        f = float(_numbers(entries, "focalLength", ())) * width / sensor if sensor > 0 else math.nan
        ratio = float(_numbers(entries, "pixelRatio", ())) if "pixelRatio" in entries else 1.0
        ratio = ratio or math.nan
        fx, fy = f, f * ratio
        if version < (1, 2, 5):
            fy = f / ratio
        elif version >= (1, 2, 11):
            fx, fy = f / ratio, f
    if not (fx > 0 and fy > 0):
        raise CameraError(
            f"{entries.where}: expected a focal length above 0, got {fx:g} x {fy:g} px; run "
            "StructureFromMotion first"
        )
    return fx, fy
