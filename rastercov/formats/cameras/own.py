"""Our own files: a camera, poses or a list of them, and both with names in one JSON.

    {"cameras": [{"name": "left", "width": 1280, ...}], "rig_from_camera": [...],
     "world_from_camera": [...], "camera": [0, 1, ...], "images": ["left/0.png", ...],
     "frame": ["0", "0", ...]}

Images of one `frame` were taken at the same instant; `has_unit` is false where lengths are those of
a reconstruction without scale. `rule`, with its entries, is that of a rig whose cameras measure
together; `rigs` has such entries, with names in `cameras`, where only some of the cameras do.
`tasks` has thresholds of cameras by name, and `fixed` names of those that stay. Equipment has its
word. `camera` has the index or the name of the camera of each pose; a file of poses alone may have
names of cameras that another file holds. `read_poses` reads the poses of such files, too. Other
lengths are metres.
"""

import io
import json
from copy import copy
from dataclasses import replace

import numpy as np

from rastercov.base import (
    AnyArray,
    ByName,
    CameraError,
    PoseError,
    ReadByName,
    errors_as,
    plural,
    shown,
)
from rastercov.core.camera import Border, Camera, Views, names_by_origin
from rastercov.core.camera.pose import DRIFT_TOLERANCE, as_matrices, real_numbers
from rastercov.core.camera.rig import entries_of, entries_of_rig, rig_with
from rastercov.formats.cameras.source import Entries, check_ids, keys_of

UNUSED = frozenset({"images", "origin", "candidate", "mount", "mounts"})
UNUSED |= {"joint_names", "joints", "clearance_m", "clearance_pair", "hidden_by_arm_percent"}
UNUSED |= {
    "link_clearance_m",
    "link_clearance_pair",
    "tour",
    "tour_length",
    "tour_length_unit",
    "wrist_flips",
}
"""Entries that no pose depends on: names of images, and what `place` writes beside its poses."""
KNOWN = UNUSED | {
    "cameras",
    "rig_from_camera",
    "world_from_camera",
    "camera",
    "frame",
    "has_unit",
    *entries_of_rig(),
}
"""Entries of a file of cameras and poses."""


def is_mine(content: object) -> bool:
    """True for poses, for named cameras, and for the entries of a camera."""
    return bool({"world_from_camera", "cameras", "width", "preset"} & keys_of(content))


def of_matrices(matrices: AnyArray, border: Border) -> Views:
    """Views of bare poses."""
    return _views(matrices, border, Entries({}), None, [])


def read(content: ReadByName, border: Border) -> Views:
    """Views of a JSON or TOML table."""
    entries = Entries(content)
    if not entries.any_of("cameras", "world_from_camera"):  # a camera by itself has its own check
        return border.views([Camera.from_dict(content)], metres=1.0)
    border.unknown.look("the file", entries.names(), KNOWN, UNUSED)
    poses: AnyArray = np.zeros((0, 4, 4))
    if "world_from_camera" in entries:
        poses = real_numbers("poses", entries.need("world_from_camera"), "(P, 4, 4)")
    if "cameras" in entries:
        views = _views(poses, border, entries, *_cameras(entries))
        return replace(views, rig=views.rig and rig_with(views.rig, content))
    given = entries.get("camera")
    known = [each for each in given if isinstance(each, str) and each] if given else []
    return _views(poses, border, entries, None, list(dict.fromkeys(known)))


def _cameras(entries: Entries) -> tuple[list[Camera], list[str]]:
    """Cameras and their names, which are different."""
    if not isinstance(given := entries.get("cameras"), list):
        raise entries.wrong("cameras", "a list of tables, each with its name", given)
    cameras: list[Camera] = []
    names: list[str] = []
    for (number, each), table in zip(entries.tables("cameras"), given, strict=True):
        names.append(each.text("name", f"camera {int(number) + 1}"))
        with errors_as(CameraError, f"camera {shown(names[-1])}"):
            cameras.append(Camera.from_dict({k: v for k, v in table.items() if k != "name"}))
    if not cameras:
        raise CameraError("expected at least one camera, got none; add one")
    check_ids("name of a camera", names)
    return cameras, names


def _views(
    matrices: AnyArray,
    border: Border,
    entries: Entries,
    cameras: list[Camera] | None,
    names: list[str],
) -> Views:
    """Views of poses with these cameras; None for those of another file, which have names."""
    poses = as_matrices(matrices[None] if matrices.shape == (4, 4) else matrices)
    places = None
    if cameras is not None and "rig_from_camera" in entries:
        places = entries.array("rig_from_camera", (len(cameras), 4, 4))
    images, frames = (_texts(entries, name, len(poses)) for name in ("images", "frame"))
    exact = copy(border)  # a border reads files of other programs, too
    exact.drift = DRIFT_TOLERANCE
    views = exact.views(
        cameras,
        names,
        world_from_camera=border.of_convention(poses),
        camera=_indices(entries, len(poses), names, has_cameras=cameras is not None),
        images=images or names_by_origin(_texts(entries, "origin", len(poses)) or ()) or None,
        frames=frames or (),
        rig_from_camera=places,
        metres=border.metres(1.0 if entries.get("has_unit", True) else None),
    )
    return replace(views, camera_names=tuple(names))


def _indices(
    entries: Entries, count: int, names: list[str], *, has_cameras: bool
) -> list[int] | None:
    """Index of the camera of each pose, which a file has by index or by name."""
    given = entries.get("camera")
    if given is None:
        if has_cameras and count and len(names) > 1:
            raise PoseError(
                f"expected the camera of each pose, one of {len(names)}, got none; add "
                f'"camera", a list of {count} indices or names'
            )
        return None
    row_of = {name: row for row, name in enumerate(names)}
    given = given if isinstance(given, list) and len(given) == count else [given]
    indices = [row_of.get(each) if isinstance(each, str) else each for each in given]
    rows = range(len(names) if has_cameras or all(type(each) is str for each in given) else 0)
    if not all(type(each) is int and each in rows for each in indices):
        wanted = f"indices or names of {len(names)} cameras" if has_cameras else "names of cameras"
        raise PoseError(f"expected camera to be {count} {wanted}, got {shown(given)}")
    return indices  # type: ignore[return-value] # all whole


def _texts(entries: Entries, name: str, count: int) -> list[str] | None:
    """A text for each pose, or None where the file has no such entry."""
    texts = entries.get(name)
    is_row = isinstance(texts, list) and len(texts) == count
    if texts is not None and not (is_row and all(isinstance(text, str) for text in texts)):
        raise PoseError(f"expected {name} to be {count} strings, got {shown(texts)}")
    return texts


def toml_of(camera: Camera) -> str:
    """Camera file of one camera, in TOML."""

    def value(each: object) -> str:
        if isinstance(each, (list, tuple)):
            return f"[{', '.join(map(value, each))}]"
        # repr: json writes infinity in another way.
        return json.dumps(each) if isinstance(each, (str, bool)) else repr(each)

    return "".join(f"{name} = {value(each)}\n" for name, each in camera.to_json().items())


def bytes_of(views: Views, suffix: str, notes: list[str]) -> bytes:
    """A file for these views; what is lost, unless it is .json, is added to `notes`."""
    if suffix == ".npy":
        if n := len(views.rig.names if views.rig else views.camera_names):
            notes.append(f"left out: {plural(n, 'camera')} and image names: .npy holds poses alone")
        buffer = io.BytesIO()
        np.save(buffer, views.poses.world_from_camera)
        return buffer.getvalue()
    if suffix == ".toml":
        if n_poses := len(views.poses):
            notes.append(f"left out: {plural(n_poses, 'pose')}: a .toml file holds one camera")
        return toml_of(views.camera()).encode()
    # Not `json_bytes`, which has no infinity: a camera may be in focus as far as that.
    return (json.dumps(content_of(views), indent=1) + "\n").encode()


def content_of(views: Views) -> ByName:
    """The table for these views; nothing is lost."""
    content: ByName = {} if views.has_unit else {"has_unit": False}
    if views.rig is not None:
        content["cameras"] = [
            {"name": name, **camera.to_json()}
            for name, camera in zip(views.rig.names, views.rig.cameras, strict=True)
        ]
        if (views.rig.rig_from_camera != np.eye(4)).any():
            content["rig_from_camera"] = views.rig.rig_from_camera.tolist()
        content |= entries_of(views.rig)
    if len(views.poses):
        content["world_from_camera"] = views.poses.world_from_camera.tolist()
        if views.rig is not None:
            content["camera"] = views.poses.camera.tolist()
        elif views.camera_names:
            content["camera"] = [views.camera_names[index] for index in views.poses.camera]
        content["images"] = list(views.images)
        if views.frames:
            content["frame"] = list(views.frames)
    return content
