"""Cameras of BOP, the benchmark of object poses: camera.json, and scene_camera.json of images.

cam_R_w2c and cam_t_w2c are camera_from_world by rows with our axes, in millimetres; pixels are
counted from their centres, as in OpenCV. An image has its own matrix, and no size: that of
camera.json, in a folder above, is of the sensor.

Source: thodan/bop_toolkit, docs/bop_datasets_format.md; bop_toolkit_lib/misc.py.
"""

from collections.abc import Mapping

import numpy as np

from rastercov.base import CameraError, errors_as
from rastercov.core.camera import Border, Camera, Views, centre_camera, inverse_of
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import Entries, Source, keys_of

MATRIX, POSE = "cam_K", ("cam_R_w2c", "cam_t_w2c")
OF_SENSOR = {"fx", "fy", "cx", "cy", "depth_scale"}
MM = 1e-3
LEVELS = 3
"""Folders from that of a scene to that of its data set, where camera.json is."""


def is_mine(content: object) -> bool:
    """True for a camera with the scale of its depth, and for images with matrices."""
    if isinstance(content, Mapping) and MATRIX not in content:
        first = next(iter(content.values()), None)
        return keys_of(content) >= OF_SENSOR or MATRIX in keys_of(first)
    return MATRIX in keys_of(content)


def read(source: Source, border: Border) -> Views:
    """The camera of a sensor; or the cameras and poses of images."""
    file = Entries(source.table)
    if {*file.names()} >= OF_SENSOR:
        border.note("depth_scale is not used: it is of depth images")
        p = {name: file.number(name) for name in sorted(OF_SENSOR)}
        size = file.side("width"), file.side("height")
        return border.views([centre_camera("pinhole", size, p)], ["camera"])
    of_images = {source.path.name.partition(".")[0]: file}
    if MATRIX not in file:
        of_images = dict(Entries({"image": source.table}).tables("image"))
    size = _size(source, border)
    cameras = {name: _camera(each, size) for name, each in of_images.items()}
    if not cameras:
        raise CameraError("expected images with cam_K, got none; name another file")
    placed = {n: each for n, each in of_images.items() if all(key in each for key in POSE)}
    if len(placed) < len(of_images):
        n, missing = len(of_images) - len(placed), " and ".join(POSE)
        border.note(f"{n} of {len(of_images)} images have no {missing}: read without poses")
    if not placed:
        return border.views(list(dict.fromkeys(cameras.values())))
    turns = [each.array(POSE[0], (9,), (3, 3)).reshape(3, 3) for each in placed.values()]
    shifts = [each.array(POSE[1], (3,), (3, 1)).ravel() for each in placed.values()]
    return border.views_of_images(
        [cameras[name] for name in placed],
        list(placed),
        world_from_camera=inverse_of(motions(turns, shifts)),
        metres=border.metres(MM),
    )


def _camera(image: Entries, size: tuple[int, int]) -> Camera:
    k = image.array(MATRIX, (9,), (3, 3)).reshape(3, 3)
    if k[1, 0] or not np.array_equal(k[2], (0, 0, 1)):
        raise image.wrong(MATRIX, "[fx, skew, cx, 0, fy, cy, 0, 0, 1]", k.tolist())
    (fx, skew, cx), (_, fy, cy) = k[:2].tolist()
    with errors_as(CameraError, image.where or None):
        return centre_camera(
            "pinhole", size, {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew}
        )


def _size(source: Source, border: Border) -> tuple[int, int]:
    """Size of the images of a file; that of the sensor where none is given."""
    name = "camera" + source.path.stem.partition("camera")[2] + source.path.suffix
    places = (folder / name for folder in source.path.absolute().parents[1:LEVELS])
    default = None
    if path := next((place for place in places if place.is_file()), None):
        sensor = Entries(Source(path).table, name)
        default = sensor.side("width"), sensor.side("height")
    if (size := border.image_size(default=default)) is default:
        border.note(f"image size is that of the sensor, {name}; for cropped images give another")
    return size
