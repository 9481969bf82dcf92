"""Cameras whose rays are parallel: telecentric lenses and orthographic views.

u = fx x + cx and v = fy y + cy, with fx and fy in pixels per metre: the magnification over the size
of a pixel. Rays run along the axis from the front of the lens, the origin of the pose. A surface at
depth z is blurred by |z - z_w| M^2 / (F p) pixels, with the working distance z_w, the working
F-number F and pixels of p metres, so that the depth of field is 2 b p F / M^2 for a blur of b.

Distortion is of places on the sensor, in metres from the principal point, as HALCON has it: Brown's
model from the ideal place to the distorted one, or by "telecentric_division" p' = 2 p / (1 +
sqrt(1 - 4 kappa p^2)). With it, or with skew, the camera is a curved lens, see `lenses.of_camera`.

Opto Engineering. Telecentric lenses tutorial: Depth of field. 2024. MVTec. HALCON operator
reference: camera parameters. 2024.
"""

from rastercov.base import ByName, CameraError, ReadByName, shown
from rastercov.base.arguments import number, pair, positive

MODEL = "telecentric"
MODELS = (MODEL, "telecentric_division")
"""Models of cameras with parallel rays, of which the first may be without distortion."""
ENTRIES = ("magnification", "working_distance", "depth_of_field", "px_per_m")
"""Entries of a camera file that other models lack."""
LACKING = (
    *("focal_length", "aperture", "max_angle_deg", "hfov_deg", "vfov_deg"),
    "principal_point",
)
"""Entries of a camera file that a camera with parallel rays lacks."""
INSTEAD = "use rc.visibility, rc.regions or rc.evaluate"
"""Calls that take parallel rays, for errors of those that do not."""
SUN_RADIUS_DEG = 0.2666
"""Angular radius of the sun, at its mean distance."""
MOST_SKEW = 10.0
"""Skew over fx: of a line scan, motion along the line over that across it."""
SAME_REL = 1e-6
"""Difference of magnifications across and down that is rounding of a file."""
FAR = 2.0**96
"""Distance of the eye of parallel rays, metres: directions to it differ by less than rounding."""


def arguments_of(entries: ReadByName) -> ByName:
    """Arguments of `Camera` from the entries of a telecentric lens or an orthographic view.

    Magnification over pixel_size is fx and fy, and so is px_per_m. The working distance is the
    `focus_distance`, and a depth of field around it the `focus_range`.
    CameraError for entries that contradict one another.
    """
    given = {name: value for name, value in entries.items() if value is not None}
    model = given.get("model", "pinhole")
    if model not in MODELS:
        name = next(name for name in ENTRIES if name in given)
        raise CameraError(f'expected model "{MODEL}" with {name}, got {shown(model)}; set it')
    _refuse(given)
    scales = [name for name in ("magnification", "px_per_m", "fx") if name in given]
    if len(scales) != 1:
        raise CameraError(
            "expected one of magnification, px_per_m and fx for parallel rays, got "
            f"{' and '.join(scales) or 'none'}; give one"
        )
    if "magnification" in given:
        times = positive("magnification", given.pop("magnification"))
        if "pixel_size" not in given:
            raise CameraError("expected pixel_size with magnification, got none; give it in metres")
        s_u, s_v = pair("pixel_size", given["pixel_size"])
        given |= {"fx": times / s_u, "fy": times / s_v}
    elif "px_per_m" in given:
        given["fx"] = given["fy"] = positive("px_per_m", given.pop("px_per_m"))
    given.setdefault("fy", given["fx"])
    if "working_distance" in given:
        at = positive("working_distance", given.pop("working_distance"))
        given["focus_distance"] = at
    if "depth_of_field" in given:
        given["focus_range"] = _range_around(given)
    return given


def _range_around(given: ByName) -> tuple[float, float]:
    """Depths in focus, half of the depth of field to either side of the working distance."""
    half = positive("depth_of_field", given.pop("depth_of_field")) / 2
    if "focus_distance" not in given:
        raise CameraError(
            "expected working_distance with depth_of_field, got none; give it in metres"
        )
    at = number("focus_distance", given["focus_distance"])
    return max(0.0, at - half), at + half


def check(given: ReadByName) -> None:
    """CameraError for arguments of a camera with parallel rays that only others have."""
    _refuse(given)
    if not abs(given["skew"]) <= MOST_SKEW * given["fx"]:
        raise CameraError(
            f"expected skew of parallel rays up to {MOST_SKEW:g} times fx, got {given['skew']:g} "
            f"with {given['fx']:g}; turn the camera about its axis"
        )
    if given["distortion"]:
        if (size := given["pixel_size"]) is None:
            raise CameraError(
                "expected pixel_size with distortion of parallel rays, got none; give it in metres"
            )
        across, down = given["fx"] * size[0], given["fy"] * size[1]
        if not abs(across - down) <= SAME_REL * across:
            raise CameraError(
                "expected equal magnification in x and y with distortion of parallel rays, got "
                f"{across:g} and {down:g}; correct fy or pixel_size"
            )
    if given["f_number"] is None:
        return
    if given["focus_range"] is not None:
        raise CameraError("expected f_number or depth_of_field, got both; remove one")
    if given["focus_distance"] is None or given["pixel_size"] is None:
        raise CameraError(
            "expected working_distance and pixel_size with f_number, got one missing; give both"
        )


def _refuse(given: ReadByName) -> None:
    for name in LACKING:
        if value := given.get(name):
            raise CameraError(
                f"expected no {name} for parallel rays, got {shown(value)}; remove it"
            )


def depths_in_focus(
    at: float, n: float, magnification: float, pixels: float
) -> tuple[float, float]:
    """Depths whose blur is within a length on the sensor, all in metres.

    Parameters
    ----------
    at, n, magnification : float
        Working distance, working F-number, and size in the image over that of the object.
    pixels : float
        The largest blur circle.
    """
    half = pixels * n / magnification**2
    return at - half, at + half
