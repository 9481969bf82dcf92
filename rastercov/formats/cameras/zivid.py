"""Intrinsics of a Zivid camera, as its SDK saves them: OpenCV's matrix and coefficients by name.

Pixels are counted from their centres. There is no image size, and no pose.

Source: Zivid SDK, CameraIntrinsics; its article "Camera Intrinsics".
"""

from rastercov.core.camera import Border, Views, centre_camera
from rastercov.formats.cameras.source import Entries, Source, keys_of


def is_mine(content: object) -> bool:
    """True for camera intrinsics."""
    return "CameraIntrinsics" in keys_of(content)


def read(source: Source, border: Border) -> Views:
    """The camera."""
    file = Entries(source.table).table("CameraIntrinsics")
    matrix, lens = file.table("CameraMatrix"), file.table("Distortion")
    p = {name.lower(): matrix.number(name) for name in ("FX", "FY", "CX", "CY")}
    p |= {name.lower(): lens.number(name) for name in ("K1", "K2", "P1", "P2", "K3")}
    return border.views([centre_camera("opencv", border.image_size(), p)])
