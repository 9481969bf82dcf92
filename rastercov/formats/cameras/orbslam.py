"""Settings of ORB-SLAM2 and 3: Camera.fx, Camera1.fx, ... with the place of a second camera.

Pixels are counted from their centres. Stereo.T_c1_c2, or Tlr of older files, is the place of the
second camera in the frame of the first, with our axes, in metres.

Source: ORB-SLAM3 1.0, src/Settings.cc, src/Tracking.cc; its Calibration_Tutorial.pdf.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.core.camera import Border, Camera, Views, centre_camera
from rastercov.formats.cameras.source import Entries, Source, keys_of

MODELS = {
    "PinHole": ("opencv", ("k1", "k2", "p1", "p2", "k3")),
    "KannalaBrandt8": ("opencv_fisheye", ("k1", "k2", "k3", "k4")),
    "Rectified": ("opencv", ()),
}
"""Our model and its coefficients, 0 where they are left out."""


def is_mine(content: object) -> bool:
    """True for the focal length of a camera."""
    return bool({"Camera.fx", "Camera1.fx"} & keys_of(content))


def read(source: Source, border: Border) -> Views:
    """One camera, or two on a rig."""
    file = Entries(source.yaml)
    kind = file.choice("Camera.type", MODELS, "PinHole")
    first = "Camera1" if "Camera1.fx" in file else "Camera"
    labels = [first, *(["Camera2"] if "Camera2.fx" in file else [])]
    of_size = next((name for name in ("Camera", "LEFT") if f"{name}.width" in file), None)
    size = [file.side(f"{of_size}.{side}") for side in ("width", "height")] if of_size else None
    cameras = [_camera(file, label, kind, size or border.image_size()) for label in labels]
    if "LEFT.K" in file:
        border.note("cameras are those of the rectified images, not LEFT and RIGHT")
    if len(cameras) == 1 and "Stereo.b" in file:
        border.note("left out Stereo.b: the camera of a rectified pair on the right is not read")
    name = file.any_of("Stereo.T_c1_c2", "Tlr")
    if len(cameras) == 1 or name is None:
        return border.views(cameras, labels)
    places = np.tile(np.eye(4), (2, 1, 1))
    data = file.table(name).array("data", (16,), (12,)).reshape(-1, 4)
    places[1, : len(data)] = data
    return border.views_of_rig(cameras, labels, places, first)


def _camera(file: Entries, label: str, kind: str, size: Sequence[int]) -> Camera:
    ours, coefficients = MODELS[kind]
    p = {name: file.number(f"{label}.{name}") for name in ("fx", "fy", "cx", "cy")}
    p |= {name: file.number(f"{label}.{name}", 0.0) for name in coefficients}
    return centre_camera(ours, size, p)
