"""Our own files: a camera or a pose file as they always were, and both with names in one JSON.

    {"cameras": [{"name": "left", "width": 1280, ...}], "rig_from_camera": [...],
     "world_from_camera": [...], "camera": [0, 1, ...], "images": ["left/0.png", ...],
     "frame": ["0", "0", ...]}

Images of one `frame` were taken at the same instant. `camera` has the index or the name of the
camera of each pose; a file of poses alone may have names of cameras that another file holds.
`read_poses` reads the poses of such files, too. Lengths are metres.
"""

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import CameraError, PoseError
from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import Border
from rastercov.camera.formats.source import Entries
from rastercov.camera.pose import DRIFT_TOLERANCE, as_matrices, real_numbers
from rastercov.camera.rig import Views

KNOWN = frozenset({"cameras", "rig_from_camera", "world_from_camera", "camera", "images", "frame"})
"""Entries of a file of cameras and poses."""


def is_mine(content: Any) -> bool:
    """True for poses, for named cameras, and for the entries of a camera."""
    return isinstance(content, Mapping) and bool(
        {"world_from_camera", "cameras", "width", "preset"} & content.keys()
    )


def of_matrices(matrices: NDArray[Any], border: Border, names: Any = None) -> Views:
    """Views of bare poses, maybe with the name of the camera of each."""
    found = as_matrices(matrices[None] if matrices.shape == (4, 4) else matrices)
    known: list[str] = []
    if names is not None:
        if not isinstance(names, list) or len(names) != len(found) or not _are_names(names):
            raise PoseError(f"camera must be {len(found)} names of cameras, got {shown(names)}")
        known = list(dict.fromkeys(names))
        row_of = {name: row for row, name in enumerate(known)}
    return border.views(
        None,
        world_from_camera=border.of_convention(found),
        camera=None if names is None else [row_of[name] for name in names],
        camera_names=known,
        metres=border.metres(1.0),
        drift=DRIFT_TOLERANCE,
    )


def read(content: Any, border: Border) -> Views:
    """Views of a JSON or TOML table."""
    entries = Entries(content, "the file")
    if entries.any_of("cameras", "world_from_camera"):  # a camera by itself has its own check
        border.unknown.look("the file", entries.names(), KNOWN, frozenset({"images"}))
    if "cameras" not in entries:
        if "world_from_camera" not in entries:
            return border.views([Camera.from_dict(content)], metres=1.0)
        return of_matrices(_matrices(entries), border, entries.get("camera"))
    cameras: list[Camera] = []
    names: list[str] = []
    given = entries.get("cameras")
    if not isinstance(given, list):
        raise CameraError(
            f"cameras must be a list of tables, each with its name, got {shown(given)}"
        )
    for number, each in entries.tables("cameras"):
        names.append(each.text("name", f"camera {number}"))
        fields = {k: v for k, v in given[len(cameras)].items() if k != "name"}
        try:
            cameras.append(Camera.from_dict(fields))
        except CameraError as error:
            raise CameraError(f"camera {shown(names[-1])}: {error}") from None
    if not cameras:
        raise CameraError("at least one camera wanted, got none")
    row_of = {name: row for row, name in enumerate(names)}
    if len(row_of) < len(names):
        [(twice, _)] = Counter(names).most_common(1)
        raise CameraError(f"two cameras are named {shown(twice)}; give each a name of its own")
    poses: NDArray[Any] = np.zeros((0, 4, 4))
    if "world_from_camera" in entries:
        poses = border.of_convention(as_matrices(_matrices(entries)))
    index = entries.get("camera")
    if index is not None:
        wanted = f"{len(poses)} indices or names of {len(cameras)} cameras"
        is_list = isinstance(index, list) and len(index) == len(poses)
        if is_list and index and _are_names(index) and row_of.keys() >= set(index):
            index = [row_of[name] for name in index]
        if not is_list or not all(type(i) is int and 0 <= i < len(cameras) for i in index):
            raise PoseError(f"camera must be {wanted}, got {shown(index)}")
    elif len(poses) and len(cameras) > 1:
        raise PoseError(
            f"the poses do not say which of {len(cameras)} cameras each is of; add camera, a list "
            f"of {len(poses)} indices or names"
        )
    images, frames = (_texts(entries, name, len(poses)) for name in ("images", "frame"))
    places = None
    if "rig_from_camera" in entries:
        places = entries.array("rig_from_camera", (len(cameras), 4, 4))
    return border.views(
        cameras,
        names,
        world_from_camera=poses,
        camera=index,
        images=images,
        frames=frames or (),
        rig_from_camera=places,
        metres=border.metres(1.0),
        drift=DRIFT_TOLERANCE,
    )


def _texts(entries: Entries, name: str, count: int) -> list[str] | None:
    """A text for each pose, or None where the file has no such entry."""
    texts = entries.get(name)
    if texts is not None and not (
        isinstance(texts, list)
        and len(texts) == count
        and all(isinstance(text, str) for text in texts)
    ):
        raise PoseError(f"{name} must be {count} texts, got {shown(texts)}")
    return texts


def _are_names(values: list[Any]) -> bool:
    return all(isinstance(value, str) and value for value in values)


def _matrices(entries: Entries) -> NDArray[Any]:
    return real_numbers("poses", entries.need("world_from_camera"), "(P, 4, 4)")


def toml_of(camera: Camera) -> str:
    """Camera file of one camera, as people write it."""

    def value(each: Any) -> str:
        if isinstance(each, (list, tuple)):
            return f"[{', '.join(map(value, each))}]"
        # repr: json writes infinity in another way.
        return json.dumps(each) if isinstance(each, (str, bool)) else repr(each)

    return "".join(f"{name} = {value(each)}\n" for name, each in camera.to_json().items())


def content_of(views: Views) -> dict[str, Any]:
    """The table for these views; nothing is lost."""
    content: dict[str, Any] = {}
    if views.rig is not None:
        content["cameras"] = [
            {"name": name, **camera.to_json()}
            for name, camera in zip(views.rig.names, views.rig.cameras, strict=True)
        ]
        if not np.array_equal(
            views.rig.rig_from_camera, np.tile(np.eye(4), (len(views.rig), 1, 1))
        ):
            content["rig_from_camera"] = views.rig.rig_from_camera.tolist()
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
