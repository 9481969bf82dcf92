"""Lenses from the parameters of other programs, in their order and with their pixel origin.

Sources: OpenCV 5 `calib3d` documentation; COLMAP 4.2 `src/colmap/sensor/models.h`; Kalibr wiki,
"Supported models"; Agisoft Metashape Professional manual 2.1, appendix "Camera models".
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import checked_array
from rastercov.base.checks import coefficients_of, image_side, number, shown
from rastercov.base.errors import CameraError
from rastercov.camera.lenses.lens import Lens, make_lens

OPENCV_COUNTS = (0, 4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV's projectPoints takes."""
COLMAP_MODELS: Mapping[str, str] = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s3",
    # Its p0 and p1 are OpenCV's p2 and p1.
    "RAD_TAN_THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 k3 k4 k5 k6 p2 p1 s1 s2 s3 s4",
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
    "EUCM": "fx fy cx cy alpha beta",
    "EQUIRECTANGULAR": "w h",
}
"""COLMAP's models with their parameters, in order and with OpenCV's letters."""
KALIBR_MODELS: Mapping[str, str] = {
    "pinhole": "fx fy cx cy",
    "omni": "xi fx fy cx cy",
    "eucm": "alpha beta fx fy cx cy",
    "ds": "xi alpha fx fy cx cy",
}
KALIBR_DISTORTIONS: Mapping[str, str] = {
    "none": "",
    "radtan": "k1 k2 p1 p2",
    "equi": "k1 k2 k3 k4",
    "fov": "omega",
}


def opencv(
    K: ArrayLike, width: int, height: int, distortion: ArrayLike = (), **others: Any
) -> Lens:
    """Lens from OpenCV's camera matrix and `distCoeffs`.

    Parameters
    ----------
    K : (3, 3) array_like
        Camera matrix, skew included; half a pixel is added to its principal point.
    width, height : int
        Image size, px.
    distortion : sequence of float
        k1 k2 p1 p2, k3, k4 k5 k6, s1 s2 s3 s4, tau_x tau_y: the first 0, 4, 5, 8, 12 or 14.
    **others
        `max_angle_deg` of `make_lens`.
    """
    c = [number("distortion", value) for value in coefficients_of(distortion)]
    if len(c) not in OPENCV_COUNTS:
        raise CameraError(
            f"distortion must be 0, 4, 5, 8, 12 or 14 numbers of OpenCV, got {len(c)}"
        )
    c += [0.0] * (14 - len(c))
    return make_lens(
        "pinhole",
        width,
        height,
        **_matrix(K),
        radial=(c[0], c[1], c[4]),
        denominator=c[5:8],
        tangential=c[2:4],
        prism=c[8:12],
        tilt=c[12:14],
        **others,
    )


def opencv_fisheye(
    K: ArrayLike, width: int, height: int, distortion: ArrayLike = (), **others: Any
) -> Lens:
    """Lens from `cv2.fisheye`: theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8).

    Parameters are those of `opencv`; `distortion` is k1 k2 k3 k4, or none. Unlike OpenCV
    it projects what is behind the image plane, too, as far as the valid region reaches.
    """
    c = [number("distortion", value) for value in coefficients_of(distortion)]
    if len(c) not in (0, 4):
        raise CameraError(f"distortion must be 0 or 4 numbers of cv2.fisheye, got {len(c)}")
    return make_lens("equidistant", width, height, **_matrix(K), radial=c, **others)


def colmap(model: str, width: int, height: int, params: ArrayLike, **others: Any) -> Lens:
    """Lens from a line of COLMAP's cameras.txt.

    Parameters
    ----------
    model : str
        One of `COLMAP_MODELS`.
    width, height : int
        Image size, px.
    params : sequence of float
        As COLMAP orders them; pixels have the same origin as here.
    **others
        `max_angle_deg` of `make_lens`.
    """
    p = _named("COLMAP model", model, COLMAP_MODELS, params)
    if model == "EQUIRECTANGULAR":
        return equirectangular(width, height, p["w"], p["h"], **others)
    central = _central(p)
    of_base: list[float]
    if "FISHEYE" in model:
        base, of_base = "equidistant", []
    elif model == "FOV":
        base, of_base = ("fov", [p["omega"]]) if p["omega"] else ("pinhole", [])
    elif "DIVISION" in model:
        base, of_base = "division", [p["k"]]
    elif model == "EUCM":
        base, of_base = "unified", [p["alpha"], 1.0 - p["alpha"], p["beta"]]
    else:
        base, of_base = "pinhole", []
    radial, denominator = [p.get(f"k{i}", 0.0) for i in range(1, 7)], []
    if model == "FULL_OPENCV":
        radial, denominator = radial[:3], radial[3:]
    return make_lens(
        base,
        width,
        height,
        **central,
        of_base=of_base,
        radial=radial,
        denominator=denominator,
        tangential=(p.get("p1", 0.0), p.get("p2", 0.0)),
        prism=[p.get(f"s{i}", 0.0) for i in range(1, 5)],
        is_late=model == "RAD_TAN_THIN_PRISM_FISHEYE",
        **others,
    )


def kalibr(
    camera_model: str,
    intrinsics: ArrayLike,
    distortion_model: str,
    distortion_coeffs: ArrayLike,
    resolution: Sequence[int],
    **others: Any,
) -> Lens:
    """Lens from an entry of a Kalibr camchain, whose pixels are counted from their centres.

    Parameters
    ----------
    camera_model : str
        One of `KALIBR_MODELS`; `intrinsics` in its order.
    distortion_model : str
        One of `KALIBR_DISTORTIONS`; `distortion_coeffs` in its order. Distortion other than
        radial-tangential needs camera model pinhole.
    resolution : (int, int)
        Width and height, px.
    **others
        `max_angle_deg` of `make_lens`.
    """
    p = _named("Kalibr camera model", camera_model, KALIBR_MODELS, intrinsics)
    d = _named("Kalibr distortion model", distortion_model, KALIBR_DISTORTIONS, distortion_coeffs)
    if camera_model != "pinhole" and distortion_model not in ("none", "radtan"):
        raise CameraError(
            f"distortion {distortion_model} must come with camera model pinhole, got {camera_model}"
        )
    if np.shape(resolution) != (2,):
        raise CameraError(f"resolution must be width and height, got {shown(resolution)}")
    of_base: list[float]
    base, of_base = "pinhole", []
    if camera_model == "omni":
        base, of_base = "unified", [p["xi"], 1.0, 1.0]
    elif camera_model == "eucm":
        base, of_base = "unified", [p["alpha"], 1.0 - p["alpha"], p["beta"]]
    elif camera_model == "ds":
        base, of_base = "double_sphere", [p["xi"], p["alpha"]]
    elif distortion_model == "equi":
        base = "equidistant"
    elif distortion_model == "fov" and d["omega"]:
        base, of_base = "fov", [d["omega"]]
    return make_lens(
        base,
        *resolution,
        fx=p["fx"],
        fy=p["fy"],
        cx=p["cx"] + 0.5,
        cy=p["cy"] + 0.5,
        of_base=of_base,
        radial=[d.get(f"k{i}", 0.0) for i in range(1, 5)],
        tangential=(d.get("p1", 0.0), d.get("p2", 0.0)),
        **others,
    )


def metashape(
    width: int,
    height: int,
    *,
    f: float,
    cx: float = 0.0,
    cy: float = 0.0,
    b1: float = 0.0,
    b2: float = 0.0,
    k1: float = 0.0,
    k2: float = 0.0,
    k3: float = 0.0,
    k4: float = 0.0,
    p1: float = 0.0,
    p2: float = 0.0,
    kind: str = "frame",
    **others: Any,
) -> Lens:
    """Lens from Agisoft Metashape's calibration.

    Parameters
    ----------
    width, height : int
        Image size, px.
    f : float
        Focal length, px.
    cx, cy : float
        Principal point, px from the centre of the image.
    b1, b2 : float
        Affinity and skew, px: u = width / 2 + cx + a (f + b1) + b b2, v = height / 2 + cy + b f.
    k1, k2, k3, k4 : float
        Coefficients of r^2 to r^8.
    p1, p2 : float
        a += p1 (r^2 + 2 x^2) + 2 p2 x y, b += p2 (r^2 + 2 y^2) + 2 p1 x y: OpenCV's p2 and p1.
    kind : str
        "frame", "fisheye" (equidistant), "equidistant_fisheye" or "equisolid_fisheye".
    **others
        `max_angle_deg` of `make_lens`.
    """
    bases = {
        "frame": "pinhole",
        "fisheye": "equidistant",
        "equidistant_fisheye": "equidistant",
        "equisolid_fisheye": "equisolid",
    }
    if kind not in bases:
        raise CameraError(
            f"the kind of a Metashape sensor must be one of {', '.join(bases)}, got {kind!r}"
        )
    width, height = image_side("width", width), image_side("height", height)
    f = number("f", f)
    return make_lens(
        bases[kind],
        width,
        height,
        fx=f + number("b1", b1),
        fy=f,
        cx=width / 2 + number("cx", cx),
        cy=height / 2 + number("cy", cy),
        skew=b2,
        radial=(k1, k2, k3, k4),
        tangential=(p2, p1),
        **others,
    )


def equirectangular(
    width: int, height: int, w: float | None = None, h: float | None = None, **others: Any
) -> Lens:
    """Lens of a whole panorama: u = w (1/2 + longitude / 2 pi), v = h (1/2 + latitude / pi).

    Longitude is atan2(X, Z), latitude asin(Y), positive downwards; `w` and `h` are the image size
    unless given.
    """
    w = number("w", width if w is None else w)
    h = number("h", height if h is None else h)
    return make_lens(
        "equirectangular",
        width,
        height,
        fx=w / (2 * math.pi),
        fy=h / math.pi,
        cx=w / 2,
        cy=h / 2,
        **others,
    )


def _named(what: str, model: str, models: Mapping[str, str], values: ArrayLike) -> dict[str, float]:
    """Parameters of a model by name."""
    if not isinstance(model, str) or model not in models:
        raise CameraError(f"{what} must be one of {', '.join(models)}, got {shown(model)}")
    names = models[model].split()
    given = coefficients_of(values)
    if len(given) != len(names):
        wanted = f": {' '.join(names)}" if names else ""
        raise CameraError(
            f"{what} {model} must have {len(names)} parameters{wanted}; got {len(given)}"
        )
    return {name: number(name, value) for name, value in zip(names, given, strict=True)}


def _central(p: Mapping[str, float]) -> dict[str, Any]:
    """Focal lengths and principal point of a model with f, or with fx and fy."""
    return {
        "fx": p.get("fx", p.get("f", 0.0)),
        "fy": p.get("fy", p.get("f", 0.0)),
        "cx": p["cx"],
        "cy": p["cy"],
    }


def _matrix(K: ArrayLike) -> dict[str, Any]:
    """Entries of OpenCV's camera matrix, half a pixel added."""
    k = checked_array("K", K, "iuf", "real numbers and must have shape (3, 3)", CameraError)
    if k.shape != (3, 3):
        raise CameraError(f"K must have shape (3, 3), got {k.shape}")
    if k[1, 0] != 0 or not np.array_equal(k[2], (0, 0, 1)):
        raise CameraError("K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    (fx, skew, cx), (_, fy, cy) = k[:2].tolist()
    return {"fx": fx, "fy": fy, "cx": cx + 0.5, "cy": cy + 0.5, "skew": skew}
