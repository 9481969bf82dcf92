"""Lens of a camera as a viewer shows and changes it: field of view, focus, aperture, image size."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rastercov.base.checks import image_side, number, positive, shown
from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.projection import view_border

PARTS_OF_BORDER = 8
"""Rays of the border of a field of view along each side of the image."""
FIELDS: tuple[dict[str, Any], ...] = tuple(
    dict(zip(("name", "low", "high", "unit", "words"), row, strict=True))
    for row in (
        ("hfov_deg", 1.0, 175.0, "deg", "Angle between left and right."),
        ("fx", 10.0, 20_000.0, "px", "Focal length over pixel width."),
        ("width", 64, 8192, "px", "Pixels across, at the same field of view."),
        ("focus_distance", 0.02, 100.0, "m", "Depth of the plane in focus."),
        ("f_number", 0.7, 45.0, "", "Focal length over diameter of the aperture."),
        ("focus_near", 0.0, 100.0, "m", "Least depth in focus."),
        ("focus_far", 0.01, 1000.0, "m", "Greatest depth in focus."),
        ("near", 0.0, 10.0, "m", "Surfaces nearer than this are not seen."),
    )
)
"""Values that can be changed, with the ends of their sliders."""


def described(camera: Camera) -> dict[str, Any]:
    """Values of a camera for the page, ready for JSON; None for what it does not have.

    `border` are rays around its field of view, see `camera.projection.view_border`; `plain` is what
    `Camera.from_dict` makes the camera of.
    """
    z_n, z_f = camera.depth_of_field()
    is_focused = camera.aperture is not None or camera.focus_range is not None
    near, far = camera.focus_range or (None, None)
    f_number = None
    if camera.aperture is not None and camera.focal_length is not None:
        f_number = camera.focal_length / camera.aperture
    return {
        "model": camera.model,
        "width": camera.width, "height": camera.height,
        "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "hfov_deg": _angle(camera.cx, camera.width, camera.fx) if camera.is_pinhole else None,
        "vfov_deg": _angle(camera.cy, camera.height, camera.fy) if camera.is_pinhole else None,
        "focal_length": camera.focal_length,
        "f_number": f_number,
        "focus_distance": camera.focus_distance,
        "focus_near": near,
        "focus_far": None if far is None or math.isinf(far) else far,
        "near": camera.near,
        "max_blur": camera.max_blur,
        "aperture": camera.aperture,
        "pixel_size": camera.pixel_size,
        "depth_of_field": [float(z_n), _finite(float(z_f))] if is_focused else None,
        "can_focus": camera.focal_length is not None and camera.pixel_size is not None
        and MODELS[camera.model].is_planar,
        "plain": camera.to_json(),
        "border": view_border(camera, PARTS_OF_BORDER).tolist(),
    }  # fmt: skip


Change = Callable[[Camera, Any], Camera]


def changed(camera: Camera, changes: Mapping[str, Any]) -> Camera:
    """The camera with some of its values changed; see `FIELDS`.

    Another field of view or focal length keeps the ratio of pixels and the coefficients of the
    lens; another width keeps the field of view.

    Raises
    ------
    CameraError
        For an unknown value, one outside its limits, or one that the camera cannot have.
    """
    known = [each["name"] for each in FIELDS]
    for name, value in changes.items():
        if name not in known:
            raise CameraError(f"a camera has {', '.join(known)} to change, got {shown(name)}")
        camera = _CHANGES[name](camera, value)
    return camera


def _angle(centre: float, side: int, focal: float) -> float:
    """Angle between opposite sides of the image of a pinhole, degrees."""
    return math.degrees(math.atan(centre / focal) + math.atan((side - centre) / focal))


def _with_angle(camera: Camera, value: Any) -> Camera:
    wanted = number("hfov_deg", value)
    if not camera.is_pinhole:
        raise CameraError(f"hfov_deg is of a pinhole; change fx of a lens of model {camera.model}")
    if not 0.01 <= wanted <= 179:
        raise CameraError(f"hfov_deg must be 0.01 to 179, got {shown(value)}")
    low, high = 1e-6, 1e6  # factor of the focal length: the angle falls as it grows
    for _ in range(200):
        middle = math.sqrt(low * high)
        is_wide = _angle(camera.cx, camera.width, camera.fx * middle) > wanted
        low, high = (middle, high) if is_wide else (low, middle)
    return _scaled(camera, math.sqrt(low * high))


def _with_focal(camera: Camera, value: Any) -> Camera:
    return _scaled(camera, positive("fx", value) / camera.fx)


def _scaled(camera: Camera, factor: float) -> Camera:
    """With focal lengths times a factor; the aperture keeps its diameter."""
    f = None if camera.focal_length is None else camera.focal_length * factor
    return replace(camera, fx=camera.fx * factor, fy=camera.fy * factor, focal_length=f)


def _with_width(camera: Camera, value: Any) -> Camera:
    return camera.resized(image_side("width", value) / camera.width)


def _with_focus(camera: Camera, value: Any) -> Camera:
    distance = positive("focus_distance", value)
    aperture = camera.aperture
    if aperture is None:
        aperture = _focal_length(camera) / 2.8
    return replace(camera, focus_distance=distance, aperture=aperture, focus_range=None)


def _with_f_number(camera: Camera, value: Any) -> Camera:
    aperture = _focal_length(camera) / positive("f_number", value)
    distance = camera.focus_distance or max(1.0, 2 * _focal_length(camera))
    return replace(camera, focus_distance=distance, aperture=aperture, focus_range=None)


def _focal_length(camera: Camera) -> float:
    if camera.focal_length is None or camera.pixel_size is None:
        raise CameraError(
            "focus needs the focal length and the size of a pixel, in metres; give a camera with "
            "both, or change focus_near and focus_far"
        )
    return camera.focal_length


def _with_range(camera: Camera, low: Any, high: Any) -> Camera:
    near, far = camera.focus_range or (0.0, math.inf)
    near = near if low is None else number("focus_near", low)
    far = far if high is None else number("focus_far", high)
    return replace(camera, focus_range=(near, far), aperture=None, focus_distance=None)


_CHANGES: dict[str, Change] = {
    "hfov_deg": _with_angle,
    "fx": _with_focal,
    "width": _with_width,
    "focus_distance": _with_focus,
    "f_number": _with_f_number,
    "focus_near": lambda camera, value: _with_range(camera, value, None),
    "focus_far": lambda camera, value: _with_range(camera, None, value),
    "near": lambda camera, value: replace(camera, near=value),
}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
