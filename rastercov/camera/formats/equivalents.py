"""Lenses of one camera in the models of several programs, and what no format keeps.

Writers ask here in which of the models of `rastercov.camera.models.PROGRAMS` that their format has
a camera can be expressed without loss.
"""

import math

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS, PROGRAMS, coefficients_by_name


def as_opencv(camera: Camera) -> tuple[float, ...] | None:
    """The 14 coefficients of OpenCV's model for a camera; None if it is not of that model."""
    c = coefficients_by_name(camera.model, camera.distortion)
    if camera.model == "metashape" and not c["k4"]:  # its p1 and p2 are OpenCV's p2 and p1
        c |= {"p1": c["p2"], "p2": c["p1"]}
    elif not (
        camera.model in ("pinhole", "opencv")
        or (camera.model == "omni" and not c["xi"])
        or (camera.model == "fov" and not c["omega"])
    ):
        return None
    return tuple(c.get(name, 0.0) for name in MODELS["opencv"].coefficients.split())


def as_fisheye(camera: Camera) -> tuple[float, ...] | None:
    """The 4 coefficients of cv2.fisheye for a camera; None if it is not of that model."""
    c = coefficients_by_name(camera.model, camera.distortion)
    radial = tuple(c.pop(f"k{i}", 0.0) for i in range(1, 5))
    return radial if MODELS[camera.model].base == "equidistant" and not any(c.values()) else None


def model_in(program: str, camera: Camera) -> tuple[str, dict[str, float]] | None:
    """Name of a model of a program, with fx and fy, that is the lens of a camera; None without one.

    With it, values of its parameters by name.
    """
    forms = [(camera.model, coefficients_by_name(camera.model, camera.distortion))]
    for ours, values in (("opencv_fisheye", as_fisheye(camera)), ("opencv", as_opencv(camera))):
        if values is not None:
            names = MODELS[ours].coefficients.split()
            forms.insert(0, (ours, dict(zip(names, values, strict=True))))
    central = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    for ours, c in forms:
        for name, foreign in PROGRAMS[program].items():
            wanted = foreign.parameters.split()
            held = foreign.ours == ours and all(key in wanted for key in c if c[key])
            if held and "fx" in wanted:
                return name, {key: (central | c)[key] for key in wanted}
    return None


def panorama(width: int, height: int) -> Camera:
    """Equirectangular image of all directions."""
    return Camera(
        width=width,
        height=height,
        fx=width / (2 * math.pi),
        fy=height / math.pi,
        model="equirectangular",
    )


def is_whole_panorama(camera: Camera) -> bool:
    """True for an equirectangular image of all directions around the middle."""
    whole = panorama(camera.width, camera.height)
    return (
        camera.model == whole.model
        and not camera.skew
        and math.isclose(camera.fx, whole.fx, rel_tol=1e-9)
        and math.isclose(camera.fy, whole.fy, rel_tol=1e-9)
        and (camera.cx, camera.cy) == (whole.cx, whole.cy)
    )


def lost(camera: Camera) -> list[str]:
    """Fields that are set and that no format but our own keeps, such as the aperture."""
    fields = ("focal_length", "pixel_size", "aperture", "focus_distance", "focus_range")
    found = [name for name in (*fields, "max_angle_deg") if getattr(camera, name) is not None]
    found += ["near"] if camera.near else []
    return found + (["max_blur"] if camera.max_blur != 1.0 else [])


def no_model(program: str, camera: Camera, name: str = "") -> CameraError:
    """Error of a lens that a program has no model for; `name` is that of the camera."""
    return CameraError(
        f"{name}{': ' if name else ''}{program} has no model for {camera.model}"
        f"{' with skew' if camera.skew and name else ' with these coefficients'}; undistort the "
        "images, or write another format"
    )
