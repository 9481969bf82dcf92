"""Shots of OpenDroneMap, odm_report/shots.geojson, with cameras.json of the project.

Rotations are vectors of camera_from_world as in OpenSfM, translations are centers in the UTM zone
of the project, metres. A shot has the focal length of its camera, and since version 2.7 its name;
cameras.json, in the folder above or beside, has the distortion.

Source: OpenDroneMap/ODM, opendm/shots.py, opendm/osfm.py.
"""

from collections.abc import Mapping

import numpy as np

from rastercov.base import CameraError, shown
from rastercov.core.camera import Border, Camera, Views, from_vectors, inverse_of
from rastercov.core.mesh.groups import list_names
from rastercov.formats.cameras.opensfm import camera_of
from rastercov.formats.cameras.source import Entries, Source, first_in, keys_of

CAMERAS = "cameras.json"
PREFIX = "v2 "
"""Of OpenSfM's names of cameras, which ODM leaves out in `CAMERAS`."""


def is_mine(content: object) -> bool:
    """True for features of GeoJSON with a focal length and a rotation."""
    first = first_in(content, "features")
    own = first.get("properties") if isinstance(first, Mapping) else None
    return {"focal", "rotation", "translation"} <= keys_of(own)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the shots."""
    known = _cameras(source)
    shots = [shot.table("properties") for _, shot in Entries(source.table).tables("features")]
    names = [_name(shot, known) for shot in shots]
    cameras: dict[str, Camera] = {}
    for name, shot in zip(names, shots, strict=True):
        if name in cameras:
            continue
        if name not in known:
            where = "beside the file or in the folder above"
            border.note(
                f"ignored lens distortion of {shown(name)}: {CAMERAS} has "
                f"{list_names([*known], name)}"
                if known
                else f"ignored lens distortion: expected {CAMERAS} of the project {where}"
            )
        cameras[name] = camera_of(known.get(name) or _without_distortion(shot))
    if not shots:
        raise CameraError("expected shots, got none; export the report of ODM again")
    centers = np.array([shot.array("translation", (3,)) for shot in shots])
    turns = from_vectors([shot.array("rotation", (3,)) for shot in shots], np.zeros_like(centers))
    poses = inverse_of(turns)
    poses[:, :3, 3] = centers
    row_of = {name: row for row, name in enumerate(cameras)}
    border.note("poses are in the UTM zone of the project, metres")
    return border.views(
        list(cameras.values()),
        list(cameras),
        world_from_camera=poses,
        camera=[row_of[name] for name in names],
        images=[shot.text("filename") for shot in shots],
        metres=1.0,
    )


def _cameras(source: Source) -> dict[str, Entries]:
    """Cameras of the project by name, none where its file is not there."""
    folder = source.path.parent
    for path in (folder.parent / CAMERAS, folder / CAMERAS):
        if path.is_file():
            tables = Entries({"cameras": Source(path).json}).tables("cameras")
            return {name.removeprefix(PREFIX): camera for name, camera in tables}
    return {}


def _name(shot: Entries, known: Mapping[str, Entries]) -> str:
    """Name of the camera of a shot; of the one with its size and focal length if it has none."""
    if "camera" in shot:
        return shot.text("camera").removeprefix(PREFIX)
    for name, camera in known.items():
        focal = camera.any_of("focal", "focal_x")
        own = (camera.get("width"), camera.get("height"), camera.get(focal or "focal"))
        if own == (shot.get("width"), shot.get("height"), shot.get("focal")):
            return name
    return f"focal {shot.get('focal')} of {shot.get('width')} x {shot.get('height')}"


def _without_distortion(shot: Entries) -> Entries:
    """Camera of the entries of a shot."""
    own: dict[str, float] = {"focal": shot.positive("focal")}
    own |= {side: shot.side(side) for side in ("width", "height")}
    return Entries({"projection_type": "perspective", **own}, shot.where)
