"""Coefficients of one lens under the names of several programs.

Readers turn what a file has into a model of `rastercov.camera.models`; writers ask here in which of
the models that their format has a camera can be expressed without loss.
"""

import math

from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS


def coefficients(camera: Camera) -> dict[str, float]:
    """Coefficients of the lens by name, 0 where they were left out."""
    names = MODELS[camera.model].coefficients.split()
    return dict.fromkeys(names, 0.0) | dict(zip(names, camera.distortion, strict=False))


def as_opencv(camera: Camera) -> tuple[float, ...] | None:
    """The 14 coefficients of OpenCV's model for a camera; None if it is not of that model."""
    c = coefficients(camera)
    if camera.model == "metashape" and not c["k4"]:
        # Its p1 and p2 are OpenCV's p2 and p1.
        return (c["k1"], c["k2"], c["p2"], c["p1"], c["k3"], *[0.0] * 9)
    if camera.model == "omni" and not c["xi"]:
        return (c["k1"], c["k2"], c["p1"], c["p2"], *[0.0] * 10)
    if camera.model == "fov" and not c["omega"]:
        return (0.0,) * 14
    if camera.model in ("pinhole", "opencv"):
        return tuple((*c.values(), *[0.0] * 14)[:14])
    return None


def as_fisheye(camera: Camera) -> tuple[float, ...] | None:
    """The 4 coefficients of cv2.fisheye for a camera; None if it is not of that model."""
    c = coefficients(camera)
    radial = tuple(c.get(f"k{i}", 0.0) for i in range(1, 5))
    others = [value for name, value in c.items() if name not in ("k1", "k2", "k3", "k4")]
    is_fisheye = MODELS[camera.model].base == "equidistant"
    return radial if is_fisheye and not any(others) else None


def opencv_length(values: tuple[float, ...], *lengths: int) -> int | None:
    """The least of these lengths that keeps all coefficients which are not 0; None for none."""
    return next((n for n in lengths if not any(values[n:])), None)


def brown(values: tuple[float, ...]) -> tuple[str, tuple[float, ...]]:
    """Model and coefficients for k1 k2 p1 p2 k3 ... of OpenCV; a pinhole where all are 0."""
    values = values[: opencv_length(values, 4, 5, 8, 12, 14)]
    return ("opencv", values) if any(values) else ("pinhole", ())


def is_whole_panorama(camera: Camera) -> bool:
    """True for an equirectangular image of all directions around the middle."""
    return (
        camera.model == "equirectangular"
        and not camera.skew
        and math.isclose(camera.fx, camera.width / (2 * math.pi), rel_tol=1e-9)
        and math.isclose(camera.fy, camera.height / math.pi, rel_tol=1e-9)
        and camera.cx == camera.width / 2
        and camera.cy == camera.height / 2
    )


def panorama(width: int, height: int) -> Camera:
    """Equirectangular image of all directions."""
    return Camera(
        width=width,
        height=height,
        fx=width / (2 * math.pi),
        fy=height / math.pi,
        model="equirectangular",
    )


def lost(camera: Camera) -> list[str]:
    """Fields that are set and that no format but our own keeps, such as the aperture."""
    fields = ("focal_length", "pixel_size", "aperture", "focus_distance", "focus_range")
    found = [name for name in (*fields, "max_angle_deg") if getattr(camera, name) is not None]
    found += ["near"] if camera.near else []
    return found + (["max_blur"] if camera.max_blur != 1.0 else [])
