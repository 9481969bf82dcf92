"""Scenes of OpenMVG: sfm_data.json with views, intrinsics and extrinsics.

Poses are camera_from_world as a rotation by rows and a center, axes are ours, pixels are counted
from their centres, and there is no unit. The name of a type of camera comes with the first of the
type, and a number after.

Source: OpenMVG, src/openMVG/sfm/sfm_data_io_cereal.cpp, cameras/*_io.hpp, geometry/pose3_io.hpp.
"""

import math
from collections.abc import Mapping

import numpy as np

from rastercov.base import CameraError, matmul, shown
from rastercov.core.camera import Border, Camera, Foreign, Views, centre_camera, inverse_of
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import Entries, Source, check_ids, keys_of

MODELS = {
    "pinhole": Foreign("opencv"),
    "pinhole_radial_k1": Foreign("opencv", "k1"),
    "pinhole_radial_k3": Foreign("opencv", "k1 k2 k3"),
    "pinhole_brown_t2": Foreign("opencv", "k1 k2 k3 p1 p2"),
    "fisheye": Foreign("opencv_fisheye", "k1 k2 k3 k4"),
    "spherical": Foreign("equirectangular"),
}
COEFFICIENTS = ("disto_k1", "disto_k3", "disto_t2", "fisheye")
"""Names of lists of coefficients."""
FIRST = 0x80000000
"""Bit of the number of a type where its name is beside it."""


def is_mine(content: object) -> bool:
    """True for a table with the version of its data."""
    return "sfm_data_version" in keys_of(content)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the views that have both."""
    entries = Entries(source.table, "the scene")
    cameras = {}
    kinds: dict[int, str] = {}
    for key, value in _pairs(entries, "intrinsics"):
        number = int(value.number("polymorphic_id", 0.0))
        if "polymorphic_name" in value:
            kinds[number & ~FIRST] = value.text("polymorphic_name")
        cameras[key] = _camera(_data(value), kinds.get(number & ~FIRST, ""))
    poses = dict(_pairs(entries, "extrinsics"))
    views = [_data(value) for _, value in _pairs(entries, "views")]
    used, images, rotations, translations = [], [], [], []
    for view in views:
        camera = cameras.get(int(view.number("id_intrinsic", -1.0)))
        pose = poses.get(int(view.number("id_pose", -1.0)))
        if camera is None or pose is None:
            continue
        rotation = pose.array("rotation", (3, 3))
        used.append(camera)
        images.append(view.text("filename", ""))
        rotations.append(rotation)
        translations.append(matmul(-rotation, pose.array("center", (3,))))
    if not used:
        raise CameraError(
            "expected views with extrinsics and intrinsics, got none; name the sfm_data of a "
            "reconstruction, in JSON"
        )
    if len(used) < len(views):
        border.note(f"{len(views) - len(used)} views left out: they have no pose, or no camera")
    poses_of_views = inverse_of(motions(np.array(rotations), np.array(translations)))
    return border.views_of_images(used, images, world_from_camera=poses_of_views)


def _pairs(entries: Entries, name: str) -> list[tuple[int, Entries]]:
    """Values of a map by their keys."""
    pairs = [(int(pair.number("key")), pair.table("value")) for _, pair in entries.tables(name)]
    check_ids(f"key of {name}", [key for key, _ in pairs])
    return pairs


def _data(value: Entries) -> Entries:
    """Members of a pointer, with those of its bases, which older versions have in value0."""
    own = value.table("ptr_wrapper").table("data")
    table = {name: own.get(name) for name in own.names()}
    while isinstance(base := table.pop("value0", None), Mapping):
        table = {**table, **base}
    return Entries(table, own.where)


def _camera(own: Entries, kind: str) -> Camera:
    if kind not in MODELS:
        raise CameraError(
            f"{own.where}: expected a camera {', '.join(MODELS)}, got {shown(kind)}; undistort "
            "the images"
        )
    width, height = own.side("width"), own.side("height")
    ours, order = MODELS[kind]
    if ours == "equirectangular":
        f = max(width, height) / (2 * math.pi)
        return Camera(width=width, height=height, fx=f, fy=f, model=ours)
    p = own.named("principal_point", ("cx", "cy"))
    p |= {"f": own.positive("focal_length")}
    if names := order.split():
        name = own.any_of(*COEFFICIENTS) or COEFFICIENTS[0]
        p |= own.named(name, names)
    return centre_camera(ours, (width, height), p)
