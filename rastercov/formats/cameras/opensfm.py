"""Reconstructions of OpenSfM: reconstruction.json with cameras and shots, and camera_models.json.

Poses are camera_from_world as rotation vectors; axes are ours; lengths in the image are parts of
its longer side, from the middle; there is no unit that the file states. Every shot has its own
pose; instances of a rig give the frames, and the poses of its cameras are camera_from_rig.

Source: OpenSfM documentation, "Coordinate Systems", "Camera Models"; opensfm/io.py;
opensfm/src/geometry/camera_distortions_functions.h.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from rastercov.base import ByName, CameraError, FloatArray
from rastercov.core.camera import (
    PROGRAMS,
    Border,
    Camera,
    Views,
    from_vectors,
    inverse_of,
    lens_camera,
    share_frames,
)
from rastercov.formats.cameras.source import Entries, Source

MODELS = PROGRAMS["opensfm"]


def _own_name(name: str) -> str:
    """Name that OpenSfM has for a coefficient: it counts those of prisms from 0."""
    return f"s{int(name[1]) - 1}" if name[0] == "s" else name


KNOWN_OF_CAMERA = frozenset(
    {"projection_type", "width", "height", "focal", "focal_x", "focal_y", "c_x", "c_y"}
    | {_own_name(name) for each in MODELS.values() for name in each.parameters.split()}
)
OTHERS = frozenset({"points", "biases", "reference_lla", "main_component"})
"""Further entries of a reconstruction."""


def is_mine(content: object) -> bool:
    """True for reconstructions, and for a table of cameras alone."""
    first = content[0] if isinstance(content, list) and content else content
    return isinstance(first, dict) and (
        ("shots" in first and "cameras" in first) or _is_table_of_cameras(first)
    )


def _is_table_of_cameras(content: ByName) -> bool:
    """True for camera_models.json: a table of cameras by name, each with its projection_type."""
    return bool(content) and all(
        isinstance(each, dict) and "projection_type" in each for each in content.values()
    )


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the first reconstruction."""
    content = source.table
    if isinstance(content, list):
        if len(content) > 1:
            border.note(f"read the first of {len(content)} reconstructions, which share no frame")
        content = content[0]
    if isinstance(content, dict) and _is_table_of_cameras(content):
        content = {"cameras": content, "shots": {}}
    entries = Entries(content, "reconstruction")
    known = OTHERS | {"cameras", "shots", "rig_instances", "rig_cameras"}
    border.unknown.look("the reconstruction", entries.names(), known, OTHERS)
    row_of: dict[str, int] = {}
    cameras: list[Camera] = []
    for name, each in entries.tables("cameras"):
        row_of[name] = len(cameras)
        names = [word for word in each.names() if not word.endswith("_prior")]
        border.unknown.look(each.where, names, KNOWN_OF_CAMERA)
        cameras.append(camera_of(each))
    if not cameras:
        raise CameraError("expected a reconstruction with cameras, got none; name another file")
    shots = dict(entries.tables("shots"))
    index = [row_of[shot.choice("camera", row_of)] for shot in shots.values()]
    images = list(shots)
    frames, rig_cameras = _instances(entries, images)
    return border.views(
        cameras,
        list(row_of),
        world_from_camera=_poses(shots.values()),
        camera=index,
        images=images,
        frames=frames,
        rig_from_camera=_places(entries, rig_cameras, index, len(cameras)) if frames else None,
    )


def _instances(entries: Entries, images: Sequence[str]) -> tuple[list[str], list[str]]:
    """Rig instance of each image, none where each has one image, and its camera on the rig."""
    of_image: dict[str, tuple[str, str]] = {}
    if "rig_instances" in entries:
        for name, instance in entries.tables("rig_instances"):
            ids = instance.get("rig_camera_ids", {})
            if not isinstance(ids, Mapping):
                raise instance.wrong("rig_camera_ids", "a table of images", ids)
            of_image |= {str(image): (name, str(camera)) for image, camera in ids.items()}
    result = [of_image.get(image, (None, "")) for image in images]
    return share_frames([frame for frame, _ in result], images), [camera for _, camera in result]


def _places(
    entries: Entries, rig_cameras: Sequence[str], index: Sequence[int], n_cameras: int
) -> FloatArray | None:
    """(N, 4, 4) rig_from_camera; None where a camera is at several places of a rig, or at none."""
    if "rig_cameras" not in entries:
        return None
    table = dict(entries.tables("rig_cameras"))
    on_rig: list[set[str]] = [set() for _ in range(n_cameras)]
    for name, row in zip(rig_cameras, index, strict=True):
        on_rig[row].add(name)
    if any(len(names) != 1 or not names <= table.keys() for names in on_rig):
        return None
    return _poses(table[name] for names in on_rig for name in names)


def _poses(tables: Iterable[Entries]) -> FloatArray:
    """(N, 4, 4) inverse motions of rotation vectors and translations."""
    rows = [(each.array("rotation", (3,)), each.array("translation", (3,))) for each in tables]
    return inverse_of(from_vectors([row for row, _ in rows], [shift for _, shift in rows]))


def camera_of(entries: Entries) -> Camera:
    """Camera of its entries."""
    ours, order = MODELS[entries.choice("projection_type", MODELS, "perspective")]
    width, height = entries.side("width"), entries.side("height")
    side = max(width, height)
    if ours == "equirectangular":
        # Longitude and latitude over 2 pi are both parts of the longer side, also where the image
        # is a part of the sphere.
        f = side / (2 * math.pi)
        return Camera(width=width, height=height, fx=f, fy=f, model=ours)
    focals = ("focal_x", "focal_y") if "focal_x" in entries else ("focal", "focal")
    fx, fy = map(entries.number, focals)
    p = {name: entries.number(_own_name(name), 0.0) for name in order.split()}
    p |= {"fx": fx * side, "fy": fy * side}
    p["cx"] = width / 2 + entries.number("c_x", 0.0) * side
    p["cy"] = height / 2 + entries.number("c_y", 0.0) * side
    return lens_camera(ours, (width, height), p)
