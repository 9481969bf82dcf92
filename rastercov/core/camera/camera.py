"""Cameras: lens, image and depth of field.

A camera is its image size and intrinsic matrix K in pixels, the model of its lens with its
coefficients, and, where focus matters, focal length and aperture. Pixels follow COLMAP and OpenGL:
the centre of the top-left pixel is at (0.5, 0.5). Camera files are JSON or TOML.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 3.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Doc

from rastercov.base import (
    LARGEST_COORDINATE,
    ByName,
    CameraError,
    FloatArray,
    ReadByName,
    StrPath,
    UnreadableError,
    check_array,
    cos,
    errors_as,
    first_of,
    image_side,
    printable,
    read_json,
    read_toml,
    shown,
    sin,
    suffix_of,
)
from rastercov.base.arguments import (
    MAX_IMAGE_SIDE,
    coefficients_of,
    focal_length_px,
    is_inf,
    is_printable,
    number,
    pair,
    positive,
    principal_point_px,
    two,
)
from rastercov.base.files import write_file
from rastercov.core.camera import parallel
from rastercov.core.camera.catalogue import entries_of, is_name
from rastercov.core.camera.models import MODELS, check_model
from rastercov.core.mesh.groups import list_names

OF_LENS = ("principal_point",)
OPTICS = (
    *("near", "focal_length", "pixel_size", "aperture", "f_number", "focus_distance"),
    *("max_blur", "focus_range", "max_angle_deg"),
)
"""Entries that a calibration lacks, and that are accepted beside `file`."""
ANGLES = ("hfov_deg", "vfov_deg")
"""Entries that give fx and fy by the angles between opposite sides of the image."""
WIDEST_DEG = 175.0
"""Largest angle from the axis: the opposite ray has a circle of pixels, and next to it edges bend
without limit. No lens sees that far."""
MOST_DIFFERENCE_REL = 0.05
"""Difference of the focal lengths across and down the image that is taken for calibration."""


def _arguments_of(entries: object, fields: Sequence[str]) -> ByName:
    """Arguments of `Camera` from the entries of a file.

    "preset" adds the entries of a camera of the catalogue; "hfov_deg" and "vfov_deg" give fx and
    fy, and one of these alone means square pixels; "f_number" is of the focal length, which fx and
    "pixel_size" give where it is not there.
    CameraError for an entry that does not exist, is missing, or contradicts another one.
    """
    if not isinstance(entries, Mapping):
        raise CameraError(f"expected a table of the entries of a camera, got {shown(entries)}")
    if "preset" in entries:
        entries = _change_preset(entries)
    known = {*fields, *OF_LENS, *ANGLES, *parallel.ENTRIES}
    if unknown := sorted(map(shown, entries.keys() - known)):
        near, advice = list_names(sorted(known), unknown[0]), "correct the name"
        if "k1" in entries:
            near, advice = "such as distortion", "give distortion = [k1, k2, p1, p2, k3]"
        elif known.isdisjoint(entries):
            advice = "correct the names, or give poses as world_from_camera"
        raise CameraError(
            f"expected known entries of a camera ({near}), got {first_of(unknown, 1)}; {advice}"
        )
    model = entries.get("model")
    if model is not None and model not in (*MODELS, parallel.MODEL):
        check_model(model, ())
    given = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in entries.items()
        if value is not None or name not in (*OF_LENS, *ANGLES)
    }
    if given.get("model") in parallel.MODELS or not given.keys().isdisjoint(parallel.ENTRIES):
        return parallel.arguments_of(given)
    return central_arguments(given)


def central_arguments(given: ByName) -> ByName:
    """Arguments of a camera whose rays meet in a point, of its entries with other names of some.

    The page has this function, and those that it calls, in JavaScript: see `report/script.py`.
    """
    if "hfov_deg" in given or "vfov_deg" in given:
        given = _with_focal_lengths(given)
    focal = [given[name] for name in ("fx", "fy") if name in given]
    wanted = ["width", "height"]
    if len(focal) == 0:
        wanted = ["width", "height", "focal_length", "pixel_size"]
    missing = [name for name in wanted if name not in given]
    if len(missing) > 0:
        raise CameraError(
            f"expected image size and focal length, got no {', '.join(missing)}; give fx, "
            "hfov_deg, or focal_length and pixel_size"
        )
    if len(focal) == 0:
        given = _of_lens(given)
    elif "principal_point" in given:
        raise CameraError(
            "expected fx and fy, or focal_length, pixel_size and principal_point, got both; remove "
            "one"
        )
    else:
        given = {"fx": focal[0], "fy": focal[0], **given}  # one alone: square pixels
    n = given.get("f_number")
    given = {k: v for k, v in given.items() if k != "f_number"}  # which only other models have
    has_aperture = given.get("aperture") is not None
    if n is not None and has_aperture:
        raise CameraError("expected f_number or aperture, got both; remove one")
    if (n is not None or has_aperture) and given.get("focal_length") is None:
        given["focal_length"] = _focal_length_m(given)
    if n is not None:
        focal_length = positive("focal_length", given["focal_length"])
        given["aperture"] = focal_length / positive("f_number", n)
    return given


def check_optics(entries: ReadByName) -> None:
    """CameraError for an entry beside `file` that a calibration has itself."""
    if others := ", ".join(sorted(map(str, entries.keys() - set(OPTICS)))):
        raise CameraError(
            f"expected only {', '.join(OPTICS)} with file, got {others}; put them into it"
        )


def _of_lens(entries: ByName) -> ByName:
    """Entries with fx, fy and the principal point in pixels: fx = f/s_u, fy = f/s_v."""
    f = positive("focal_length", entries["focal_length"])
    s_u, s_v = pair("pixel_size", entries["pixel_size"])
    own = {"fx": f / s_u, "fy": f / s_v, "focal_length": f, "pixel_size": (s_u, s_v)}
    given = {**entries, **own}
    if "principal_point" in entries:
        if entries.get("cx") is not None or entries.get("cy") is not None:
            raise CameraError("expected principal_point, or cx and cy, got both; remove one")
        r_u, r_v = two("principal_point", entries["principal_point"])
        given["cx"] = number("principal_point", r_u) / s_u
        given["cy"] = number("principal_point", r_v) / s_v
    return {k: v for k, v in given.items() if k != "principal_point"}


def _change_preset(entries: ReadByName) -> ByName:
    """Entries of a camera of the catalogue, or of a file beside it, changed by others."""
    changes = {k: v for k, v in entries.items() if k not in ("preset", "catalogue")}
    return entries_of(entries["preset"], changes, entries.get("catalogue"))


def _with_focal_lengths(entries: ByName) -> ByName:
    """Entries with fx and fy in place of hfov_deg and vfov_deg; one of these is of both."""
    given = [name for name in ("fx", "fy", "focal_length", "principal_point") if name in entries]
    if len(given) > 0:
        raise CameraError(
            f"expected hfov_deg and vfov_deg, or {', '.join(given)}, got both; remove one"
        )
    model = entries.get("model", "pinhole")
    if model != "pinhole":
        raise CameraError(
            f"expected hfov_deg and vfov_deg for a pinhole, got {shown(model)}; give fx and fy"
        )
    made = {k: v for k, v in entries.items() if k not in ANGLES}
    for name, focal, centre in (("hfov_deg", "fx", "cx"), ("vfov_deg", "fy", "cy")):
        if name in entries:
            side = CENTRES[centre]
            if side not in entries:
                raise CameraError(
                    f"expected {side} with {name}, got none; give the image size in pixels"
                )
            length = image_side(side, entries[side])
            at = entries.get(centre)
            middle = length / 2 if at is None else principal_point_px(centre, at)
            made[focal] = focal_length_across(name, number(name, entries[name]), length, middle)
    return made


def focal_length_across(name: str, angle: float, side: int, centre: float) -> float:
    """Focal length in pixels by which a side of the image spans an angle, in degrees.

    atan(c / f) + atan((w - c) / f) = a, so that f^2 sin a - f w cos a - c (w - c) sin a = 0.
    """
    radians = math.radians(angle)  # 0 for the least angles
    if not 0 < radians < math.pi:
        raise CameraError(f"expected {name} above 0 and below 180 degrees, got {angle:g}")
    if not 0 < centre < side:
        raise CameraError(
            f"expected a principal point inside the image for {name}, got {centre:g} px; give fx "
            "and fy"
        )
    sine, cosine = sin(radians), cos(radians)
    root = math.sqrt((side * cosine) ** 2 + 4 * sine * sine * centre * (side - centre))
    return (side * cosine + root) / (2 * sine)


def _focal_length_m(entries: ReadByName) -> float:
    """Focal length in metres that fx, fy and pixel_size give."""
    if entries.get("pixel_size") is None:
        raise CameraError(
            "expected a focal length in metres with f_number or aperture, got none; give "
            "pixel_size or focal_length"
        )
    s_u, s_v = pair("pixel_size", entries["pixel_size"])
    across, down = positive("fx", entries["fx"]) * s_u, positive("fy", entries["fy"]) * s_v
    if not abs(across - down) <= MOST_DIFFERENCE_REL * max(across, down):
        raise CameraError(
            f"expected one focal length from fx, fy and pixel_size, got {across:g} m and {down:g} "
            "m; correct pixel_size"
        )
    return (across + down) / 2


def _near(name: str, value: object) -> float:
    near = number(name, value)
    if not 0 <= near <= LARGEST_COORDINATE:
        raise CameraError(f"expected {name} from 0 to {LARGEST_COORDINATE:g} m, got {near:g}")
    return near


def field_angle(name: str, value: object) -> float:
    """Angle from an axis, degrees: up to `WIDEST_DEG`, or 180; otherwise CameraError."""
    angle = number(name, value)
    if not (0 < angle <= WIDEST_DEG or angle == 180):
        raise CameraError(
            f"expected {name} above 0, up to {WIDEST_DEG:g}, or 180 for all directions, got "
            f"{angle:g}"
        )
    return angle


def _text(name: str, value: object) -> str:
    if not is_printable(value):
        raise CameraError(f"expected {name} to be printable text, got {shown(value)}")
    return value


def _range(name: str, value: object) -> tuple[float, float]:
    first, second = two(name, value)
    is_open = second is None or is_inf(second)  # JSON has no infinity
    z_n, z_f = number(name, first), math.inf if is_open else number(name, second)
    if not 0 <= z_n < z_f:
        raise CameraError(f"expected {name} to satisfy 0 <= near < far, got [{z_n:g}, {z_f:g}]")
    return z_n, z_f


CHECKS: Mapping[str, Callable[[str, Any], Any]] = {
    **dict.fromkeys(("width", "height"), image_side),
    **dict.fromkeys(("fx", "fy"), focal_length_px),
    **dict.fromkeys(("cx", "cy", "skew"), principal_point_px),
    **dict.fromkeys(
        ("focal_length", "aperture", "focus_distance", "max_blur", "f_number"), positive
    ),
    "pixel_size": pair,
    "near": _near,
    "focus_range": _range,
    "max_angle_deg": field_angle,
    "product": _text,
    "ir_range": positive,
}
"""Check of each field by itself."""
CENTRES = {"cx": "width", "cy": "height"}
"""Fields that are the half of others unless given."""


def check_fields(given: ReadByName, defaults: ReadByName) -> ByName:
    """Fields of a camera, each as its check has it; those that are a default are not checked."""
    made = {**given}
    for name, check in CHECKS.items():
        value = made.get(name)
        if value is None and name in CENTRES:
            value = made[CENTRES[name]] / 2
        if value is not defaults.get(name):
            made[name] = check(name, value)
    return made


def check_focus(given: ReadByName) -> None:
    """Raise `CameraError` unless a lens with an aperture has a plane in focus."""
    aperture, f = given.get("aperture"), given.get("focal_length")
    at = given.get("focus_distance")
    if (aperture is None) != (at is None):
        raise CameraError(
            "expected aperture and focus_distance together, got one of them; give both or neither"
        )
    if aperture is not None:
        if f is None or given.get("pixel_size") is None:
            raise CameraError(
                "expected focal_length and pixel_size with an aperture, got none; see "
                "Camera.from_lens"
            )
        if given.get("focus_range") is not None:
            raise CameraError("expected focus_range or aperture, got both; remove one")
        if not at > f:
            raise CameraError(f"expected focus_distance above focal_length {f:g} m, got {at:g} m")


def with_pixels(own: ReadByName, factor: float) -> ByName:
    """Fields of a camera that change with the pixels per side, which are a factor times as many."""
    # A side beyond the limit is refused by the camera; cut to twice that, it is still a number.
    width, height = [
        max(1, int(round(min(own[side] * factor, 2.0 * MAX_IMAGE_SIDE), 0)))
        for side in ("width", "height")
    ]
    across, down = width / own["width"], height / own["height"]
    pitch = own.get("pixel_size")
    return {
        "width": width,
        "height": height,
        "fx": own["fx"] * across,
        "fy": own["fy"] * down,
        "cx": own["cx"] * across,
        "cy": own["cy"] * down,
        "skew": own.get("skew", 0.0) * across,
        "max_blur": own.get("max_blur", 1.0) * min(across, down),
        **({} if pitch is None else {"pixel_size": (pitch[0] / across, pitch[1] / down)}),
    }


def shown_of(own: ReadByName, z_n: float, z_f: float) -> ByName:
    """Figures of a camera for people, of its fields and its depth of field; None for none."""
    f, aperture = own.get("focal_length"), own.get("aperture")
    near, far = own.get("focus_range", (None, None))
    is_focused = z_n > 0 or math.isfinite(z_f)
    return {
        "width": own["width"],
        "height": own["height"],
        "fx": own["fx"],
        "focal_length": f,
        "f_number": f / aperture if f and aperture else own.get("f_number"),
        "focus_distance": own.get("focus_distance"),
        "focus_near": near,
        "focus_far": None if far is None or math.isinf(far) else far,
        "near": own.get("near", 0.0),
        "depth_of_field": [z_n, z_f if math.isfinite(z_f) else None] if is_focused else None,
    }


def border_of(width: float, height: float, n: int) -> FloatArray:
    """Points (4, n, 2) on the borders of an image of that size, px: top, right, bottom and left.

    Each border has its ends, at equal steps, in the order in which they go around the image.
    """
    steps = np.linspace(0.0, 1.0, n)[:, None]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (width, height)
    starts, ends = corners[:, None], np.roll(corners, -1, axis=0)[:, None]
    return (1 - steps) * starts + steps * ends


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera: image size and intrinsics in pixels, model of the lens, focus in metres.

    Parameters
    ----------
    width, height : int
        Image size in pixels.
    fx, fy : float
        Focal length over pixel width and height, in pixels: f/s_u and f/s_v, eq. (3.5) of
        Eissa (2020). For parallel rays, pixels per metre.
    cx, cy : float, optional
        Principal point in pixels; the image centre unless given.
    near : float, optional
        Surfaces nearer than this depth are not visible, metres; for lenses beyond 72 degrees off
        axis, those whose largest coordinate in camera axes is less. 0 (the default) leaves only the
        numerical limit, 1e-6 of the distance to the farthest corner of the mesh's box.
    focal_length : float, optional
        f in metres, for the depth of field; fx and fy are needed all the same (`from_lens`
        computes them).
    pixel_size : float or (float, float), optional
        s_u, s_v in metres; one number for square pixels.
    aperture : float, optional
        Diameter A of the entrance pupil, metres, which limits the depth of field; it requires
        `focus_distance`, `focal_length` and `pixel_size`. Without it or `focus_range`, everything
        is in focus.
    focus_distance : float, optional
        Depth z_s of the plane in focus, metres; the working distance of a telecentric lens.
    max_blur : float, optional
        Largest acceptable diameter c of the blur circle, in pixels, 1 unless given; a `Task` may
        set its own.
    focus_range : (float, float), optional
        The depths between which the camera is in focus, metres, when they are known directly.
        Excludes `aperture`.
    skew : float, optional
        u = fx x + skew y + cx, px.
    model : str, optional
        Model of the lens: "pinhole" unless given, or "opencv", "opencv_fisheye" or another name in
        `rastercov.core.camera.models.MODELS`.
    distortion : sequence of float, optional
        Coefficients of the model, in the order that it has there: k1 k2 p1 p2 k3 ... of "opencv".
    max_angle_deg : float, optional
        Maximum valid angle from the optical axis, degrees, up to 175, or 180 for no limit. Unless
        given, the image, or the angle to which the model is proved not to fold, is the limit.
    product : str, optional
        Product name of camera and lens, for display; set by presets.
    ir_range : float, optional
        Range of the built-in infrared lamps, metres; drawn on plan sheets, but lights no scene.
    f_number : float, optional
        Working F-number of a telecentric lens, which with `focus_distance` and `pixel_size` limits
        its depth of field; for other lenses see `from_lens`.

    Raises
    ------
    CameraError
        For a value that describes no camera.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> camera.cx, camera.cy
    (320.0, 240.0)
    >>> camera.K.tolist()
    [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]
    >>> lens = rc.Camera(width=640, height=480, fx=600, fy=600, model="fov", distortion=(0.9,))
    >>> lens.is_pinhole
    False
    """

    width: Annotated[int, Doc("Image width, px.")]
    height: Annotated[int, Doc("Image height, px.")]
    fx: Annotated[float, Doc("Focal length over pixel width, px.")]
    fy: Annotated[float, Doc("Focal length over pixel height, px.")]
    cx: Annotated[float, Doc("Principal point, px; default: the image centre.")] = None  # type: ignore[assignment] # None asks for the middle
    cy: Annotated[float, Doc("Principal point, px; default: the image centre.")] = None  # type: ignore[assignment] # never None afterwards
    near: Annotated[float, Doc("Surfaces closer than this are not visible, m.")] = 0.0
    focal_length: Annotated[float, Doc("Focal length, m; instead of fx and fy.")] | None = None
    pixel_size: Annotated[tuple[float, float] | None, Doc("Pixel pitch, m; one or two.")] = None
    aperture: Annotated[float, Doc("Aperture, m; instead of f_number.")] | None = None
    focus_distance: Annotated[float, Doc("Depth of the plane in focus, m.")] | None = None
    max_blur: Annotated[float, Doc("Largest diameter of the blur circle, px.")] = 1.0
    focus_range: Annotated[
        tuple[float, float] | None, Doc("[near, far] depths in focus, m; instead of an aperture.")
    ] = None
    skew: Annotated[float, Doc("Skew, px: u = fx x + skew y + cx.")] = 0.0
    model: Annotated[str, Doc("Model of the lens.")] = "pinhole"
    distortion: Annotated[tuple[float, ...], Doc("Coefficients of the model, in its order.")] = ()
    max_angle_deg: Annotated[
        float | None, Doc("Largest angle from the axis at which the lens is trusted, deg.")
    ] = None
    product: Annotated[str, Doc("Product name of camera and lens.")] = field(
        default="", compare=False
    )
    ir_range: Annotated[
        float | None,
        Doc("Range of the built-in infrared lamps, m; drawn on plan sheets, but lights no scene."),
    ] = field(default=None, compare=False)
    f_number: Annotated[float | None, Doc("Working F-number of a telecentric lens.")] = None

    def __post_init__(self) -> None:
        defaults = {each.name: each.default for each in self.__dataclass_fields__.values()}
        self.__dict__.update(check_fields(vars(self), defaults))
        model, coefficients = check_model(self.model, self.distortion)
        self.__dict__.update(model=model, distortion=coefficients)
        if self.is_parallel:
            parallel.check(vars(self))
            return
        if self.f_number is not None:
            raise CameraError(
                f"expected f_number only for a telecentric lens, got {model}; use Camera.from_lens"
            )
        if model == "equirectangular" and self.max_angle_deg is not None:
            raise CameraError(
                "expected no max_angle_deg for an equirectangular image, got "
                f"{self.max_angle_deg:g}; remove it"
            )
        check_focus(vars(self))
        is_tilted = any(self.distortion[12:])
        if self.aperture is not None and (is_tilted or not MODELS[self.model].is_planar):
            lens = "a tilted sensor" if is_tilted else f"a lens of model {self.model}"
            raise CameraError(
                f"expected a lens with a plane of focus for an aperture, got {lens}; give "
                "focus_range instead"
            )

    @classmethod
    def from_lens(
        cls,
        *,
        width: int,
        height: int,
        focal_length: float,
        pixel_size: float | tuple[float, float],
        **others: object,
    ) -> "Camera":
        """Camera from a lens and a sensor in metres: fx = f/s_u, fy = f/s_v.

        Parameters
        ----------
        width, height : int
            Image size in pixels.
        focal_length : float
            f, metres.
        pixel_size : float or (float, float)
            s_u, s_v, metres; one number for square pixels.
        **others
            Other arguments of `Camera`; `principal_point`, R_u and R_v in metres from the top-left
            corner of the sensor, instead of `cx` and `cy`; `f_number`, N, for an aperture of f/N,
            which requires `focus_distance`.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_lens(
        ...     width=1280, height=1024, focal_length=8e-3, pixel_size=5.3e-6, f_number=4,
        ...     focus_distance=0.6,
        ... )
        >>> round(camera.fx, 1)
        1509.4
        >>> [round(depth, 3) for depth in camera.depth_of_field()]  # metres
        [0.502, 0.746]
        """
        lens = {"focal_length": focal_length, "pixel_size": pixel_size}
        return cls.from_dict({"width": width, "height": height} | lens | others)

    @classmethod
    def telecentric(
        cls,
        width: int,
        height: int,
        *,
        magnification: float,
        pixel_size: float | tuple[float, float],
        working_distance: float | None = None,
        f_number: float | None = None,
        depth_of_field: float | None = None,
        **others: object,
    ) -> "Camera":
        """Camera with a telecentric lens, whose rays are parallel to its axis.

        Parameters
        ----------
        width, height : int
            Image size in pixels.
        magnification : float
            Size in the image over size of the object.
        pixel_size : float or (float, float)
            Metres; one number for square pixels.
        working_distance : float, optional
            Distance to the plane of focus from the front of the lens, the origin of a pose,
            metres.
        f_number : float, optional
            Working F-number, by which the depth of field is 2 b p F / M^2, b the largest blur in
            pixels and p the pixel size in metres.
        depth_of_field : float, optional
            Depth of field from a data sheet, metres, half to either side; instead of f_number.
        **others
            Other arguments of `Camera`, such as `near`; `distortion`, k1 k2 p1 p2 k3 for points on
            the sensor in metres, or kappa with `model` "telecentric_division", HALCON's.

        Examples
        --------
        >>> import rastercov as rc
        >>> lens = {"magnification": 0.073, "working_distance": 0.4928, "f_number": 8}
        >>> camera = rc.Camera.telecentric(2448, 2048, pixel_size=3.45e-6, **lens)
        >>> round(1e6 / camera.fx, 1)  # micrometres per pixel
        47.3
        >>> near, far = camera.depth_of_field(max_blur=7.5)  # pixels
        >>> round(far - near, 4)  # metres
        0.0777
        """
        lens = {"magnification": magnification, "pixel_size": pixel_size, "f_number": f_number}
        at = {"working_distance": working_distance, "depth_of_field": depth_of_field}
        size = {"width": width, "height": height, "model": parallel.MODEL}
        return cls.from_dict(size | lens | at | others)

    @classmethod
    def line_scan(
        cls,
        width: int,
        lines: int,
        *,
        magnification: float,
        pixel_size: float,
        vy: float,
        vx: float = 0.0,
        vz: float = 0.0,
        **others: object,
    ) -> "Camera":
        """Image of a part that moves past a line sensor with a telecentric lens.

        All rays are parallel to the axis, so that all lines form one parallel image, exactly, at
        the pose of the middle line.

        Parameters
        ----------
        width, lines : int
            Pixels of a line, and lines of the image.
        magnification : float
            Size in the image over size of the object.
        pixel_size : float
            Along the line, metres.
        vy : float
            Motion of the part per line, across the sensor, metres; of either sign.
        vx, vz : float
            Motion along the sensor, which skews the image, and along the axis, which must be 0:
            HALCON's names.
        **others
            Other arguments of `telecentric`, except distortion.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.line_scan(4096, 2000, magnification=0.1, pixel_size=7e-6, vy=5e-5)
        >>> round(camera.fx), round(camera.fy)  # pixels and lines per metre
        (14286, 20000)
        """
        if number("vz", vz) != 0:
            raise CameraError(
                f"expected vz of 0, got {vz:g}; rotate the camera so that the part moves across "
                "its axis"
            )
        if others.get("distortion"):
            raise CameraError(
                "expected no distortion for a line sensor, got some; undistort its lines"
            )
        pace = positive("magnitude of vy", abs(number("vy", vy)))
        sizes = positive("pixel_size", pixel_size), positive("magnification", magnification) * pace
        skew = -magnification / pixel_size * (number("vx", vx) / vy)
        lens = {"model": parallel.MODEL, "magnification": magnification, "pixel_size": sizes}
        return cls.from_dict({"width": width, "height": lines, "skew": skew} | lens | others)

    @classmethod
    def orthographic(
        cls, width: int, height: int, *, px_per_m: float, **others: object
    ) -> "Camera":
        """Orthographic view, everywhere in focus.

        Parameters
        ----------
        width, height : int
            Image size in pixels.
        px_per_m : float
            Pixels per metre perpendicular to the rays.
        **others
            Other arguments of `Camera`, such as `near`.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.orthographic(640, 480, px_per_m=200)
        >>> camera.is_parallel, camera.width / camera.fx  # metres across
        (True, 3.2)
        """
        size = {"width": width, "height": height, "model": parallel.MODEL}
        return cls.from_dict(size | {"px_per_m": px_per_m} | others)

    @classmethod
    def from_fov(
        cls,
        width: int,
        height: int,
        *,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        **others: object,
    ) -> "Camera":
        """Pinhole from its angles of view, at least one; with one, pixels are square.

        Parameters
        ----------
        width, height : int
            Image size in pixels.
        hfov_deg, vfov_deg : float, optional
            Angles between left and right, and between top and bottom, degrees, (0, 180).
        **others
            Other arguments of `Camera`, such as `near`; `f_number` of `from_lens`, with
            `focus_distance` and `pixel_size`.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=90)
        >>> round(camera.fx, 6), round(camera.fy, 6)
        (320.0, 320.0)
        """
        given = {"width": width, "height": height, "hfov_deg": hfov_deg, "vfov_deg": vfov_deg}
        return cls.from_dict(given | others)

    @classmethod
    def from_opencv(
        cls,
        K: ArrayLike,
        width: int,
        height: int,
        distortion: Sequence[float] = (),
        *,
        fisheye: bool = False,
        **others: Any,
    ) -> "Camera":
        """Camera from an OpenCV calibration, which counts pixels from their centres.

        Parameters
        ----------
        K : (3, 3) array_like
            OpenCV's camera matrix; half a pixel is added to its principal point.
        width, height : int
            Image size in pixels.
        distortion : sequence of float, optional
            OpenCV's `distCoeffs`: 4, 5, 8, 12 or 14 numbers, or none.
        fisheye : bool
            The calibration is of `cv2.fisheye`; `distortion` is its D, of 4 numbers.
        **others
            Further arguments of `Camera`.

        Raises
        ------
        CameraError
            For a matrix K of another shape or form, and another number of coefficients.

        Examples
        --------
        >>> import numpy as np
        >>> import rastercov as rc
        >>> K = np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 511.5], [0.0, 0.0, 1.0]])
        >>> camera = rc.Camera.from_opencv(K, 1280, 1024, distortion=(-0.05, 0.02, 0.0, 0.0, 0.0))
        >>> camera.cx, camera.cy  # half a pixel more: here the corner of the image is (0, 0)
        (640.0, 512.0)
        >>> camera.opencv_K.tolist() == K.tolist()
        True
        """
        k = check_array("K", K, "iuf", "real numbers of shape (3, 3)", CameraError)
        if k.shape != (3, 3):
            raise CameraError(f"expected K of shape (3, 3), got {k.shape}")
        if k[1, 0] != 0 or not np.array_equal(k[2], (0, 0, 1)):
            raise CameraError(
                f"expected K to be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], got {k.tolist()}"
            )
        coefficients = coefficients_of(distortion)
        return cls(
            width=width,
            height=height,
            fx=float(k[0, 0]),
            fy=float(k[1, 1]),
            cx=float(k[0, 2]) + 0.5,
            cy=float(k[1, 2]) + 0.5,
            skew=float(k[0, 1]),
            model="opencv_fisheye" if fisheye else "opencv" if coefficients else "pinhole",
            distortion=coefficients,
            **others,
        )

    @classmethod
    def preset(cls, name: str) -> "Camera":
        """Camera of the catalogue by name, NAME or NAME+LENS; see `rastercov cameras`.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.preset("icube-ns4133bu-8mm")
        >>> camera.width, camera.height, round(camera.fx)
        (1280, 1024, 1509)
        """
        return cls.from_dict({"preset": name})

    @classmethod
    def load(cls, path: StrPath) -> "Camera":
        r"""Camera from a JSON or TOML file.

        Its entries are arguments of the constructor, `from_lens`, `from_fov`, `telecentric` or
        `orthographic`. `preset = "khepra"` starts from a camera of the catalogue; other entries
        change it. Instead of a file, NAME or NAME+LENS of the catalogue is accepted.

        Raises
        ------
        CameraError
            For an unreadable file, unknown or contradictory entries, and an unknown name.

        Examples
        --------
        >>> from pathlib import Path
        >>> import rastercov as rc
        >>> _ = Path("camera.toml").write_text("width = 1280\nheight = 800\nhfov_deg = 60\n")
        >>> camera = rc.Camera.load("camera.toml")
        >>> round(camera.fx, 2)
        1108.51
        """
        if is_name(path):
            return cls.preset(str(path))
        with errors_as(CameraError, printable(str(path)), (UnreadableError, CameraError)):
            suffix = suffix_of(path)
            if suffix not in (".json", ".toml"):
                raise CameraError(
                    f"expected a camera file .json or .toml, got {shown(suffix)}; read_views reads "
                    "other formats"
                )
            entries = read_json(path) if suffix == ".json" else read_toml(path)
            if isinstance(entries, Mapping) and "file" in entries:
                raise CameraError(
                    "expected a camera, got an entry file; use rastercov.read_views(...).cameras()"
                )
            return cls.from_dict(entries)

    @classmethod
    def from_dict(cls, entries: ReadByName) -> "Camera":
        """Camera from a mapping, as `load` reads it.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_dict({"preset": "khepra", "near": 0.1})
        >>> camera.near
        0.1
        """
        return cls(**_arguments_of(entries, list(cls.__dataclass_fields__)))

    def save(self, path: StrPath) -> None:
        """Write the camera as a `.json` file that `load` reads back to an equal camera.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
        >>> camera.save("camera.json")
        >>> rc.Camera.load("camera.json") == camera
        True
        """
        with errors_as(CameraError, printable(str(path)), ValueError):
            suffix = suffix_of(path)
            if suffix != ".json":
                raise CameraError(
                    f"expected the suffix .json for a camera, got {shown(suffix)}; rename the file"
                )
            with write_file(path) as file:
                file.write((json.dumps(self.to_json(), indent=2) + "\n").encode())

    def with_optics(self, entries: ReadByName) -> "Camera":
        """Copy with entries of a camera file for depth of field, near limit and valid angle.

        They are `near`, `focal_length`, `pixel_size`, `aperture`, `f_number`, `focus_distance`,
        `max_blur`, `focus_range` and `max_angle_deg`; `CameraError` for any other.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.from_lens(width=640, height=480, focal_length=8e-3, pixel_size=5e-6)
        >>> focused = camera.with_optics({"f_number": 4, "focus_distance": 0.6})
        >>> [round(depth, 3) for depth in focused.depth_of_field()]  # metres
        [0.506, 0.736]
        """
        check_optics(entries)
        return Camera.from_dict(self.to_json() | dict(entries)) if entries else self

    def to_json(self) -> ByName:
        """Arguments of the constructor, ready for JSON, without empty ones and those that are None.

        There is no `model` for a pinhole.
        """
        own = {name: getattr(self, name) for name in self.__dataclass_fields__}
        own = {k: v for k, v in own.items() if v not in (None, (), "")}
        if self.model == "pinhole":
            del own["model"]
        return own

    @cached_property
    def is_pinhole(self) -> bool:
        """True where fx, fy, cx and cy describe the lens completely."""
        return self.model == "pinhole" and self.skew == 0 and self.max_angle_deg is None

    @cached_property
    def is_parallel(self) -> bool:
        """True where rays are parallel: fx and fy are in pixels per metre."""
        return self.model in parallel.MODELS

    @cached_property
    def is_curved(self) -> bool:
        """True for lenses other than a pinhole, and parallel rays with distortion or skew."""
        if self.is_parallel:
            return bool(self.distortion) or self.skew != 0
        return not self.is_pinhole

    @property
    def _has_closed_form(self) -> bool:
        """True for a panorama or an equal-area lens, whose pixels per m^2 have a closed form."""
        is_equal_area = self.model == "metashape_equisolid" and not any(self.distortion)
        return self.model == "equirectangular" or is_equal_area

    def check_central(self, what: str) -> None:
        """Raise `CameraError` for parallel rays, where a central projection is required.

        Parameters
        ----------
        what : str
            What needs a central projection, for the error.
        """
        if self.is_parallel:
            raise CameraError(
                f"expected a camera whose rays meet in a point for {what}, got a {self.model} one; "
                f"{parallel.INSTEAD}"
            )

    @property
    def magnification(self) -> float | None:
        """Size in the image over size of the object for a telecentric lens; otherwise None."""
        if not self.is_parallel or self.pixel_size is None:
            return None
        return self.fx * self.pixel_size[0]

    @property
    def working_distance(self) -> float | None:
        """Distance from the front of a telecentric lens to its plane of focus, metres, or None."""
        return self.focus_distance if self.is_parallel else None

    def check_pinhole(self, what: str, instead: str = "undistort the images") -> None:
        """Raise `CameraError` for any lens but a pinhole, where only a pinhole is supported.

        Parameters
        ----------
        what : str
            What needs a pinhole, for the error.
        instead : str
            Remedy, at the end of the error.
        """
        if not self.is_pinhole:
            lens = f"a lens of model {self.model}{', with skew' if self.skew else ''}"
            if self.is_parallel:
                instead = parallel.INSTEAD
            raise CameraError(f"{what}, got {lens}; {instead}")

    @property
    def K(self) -> FloatArray:  # noqa: N802 - the field's name for it
        """Intrinsic matrix, (3, 3), without `skew`: eq. (3.5) of Eissa (2020), in pixels.

        f/s_u and f/s_v are on the diagonal; the top-left pixel centre is at (0.5, 0.5).
        """
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def opencv_K(self) -> FloatArray:  # noqa: N802 - the same
        """Intrinsic matrix, (3, 3), in OpenCV's convention, pixel centres at integers."""
        return self.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]

    def resized(self, scale: float) -> "Camera":
        """Camera with the same view and `scale` times the pixels per side (rounded, at least 1).

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
        >>> half = camera.resized(0.5)
        >>> half.width, half.height, half.fx
        (320, 240, 300.0)
        """
        return replace(self, **with_pixels(vars(self), positive("scale", scale)))

    def _without_focus(self) -> "Camera":
        """The camera with everything in focus."""
        return replace(self, aperture=None, f_number=None, focus_distance=None, focus_range=None)

    def depth_of_field(self, max_blur: float | None = None) -> tuple[float, float]:
        """Depths between which the blur circle stays within `max_blur`.

        Eq. (3.10) and (3.11) of Eissa (2020): z_n = A f z_s / (A f + b (z_s - f)) and
        z_f = A f z_s / (A f - b (z_s - f)), where the blur limit c is in pixels, so that
        b = c min(s_u, s_v). Beyond the hyperfocal distance, where the second denominator is not
        positive, z_f is infinite.

        Parameters
        ----------
        max_blur : float, optional
            c in pixels; the camera's own unless given. It does not change a `focus_range`.

        Returns
        -------
        (float, float)
            z_n and z_f in metres: `focus_range` if it is set; (0, inf) for a camera without
            aperture, F-number and focus range.

        Examples
        --------
        >>> import rastercov as rc
        >>> camera = rc.Camera.preset("icube-ns4133bu-8mm")
        >>> camera = camera.with_optics({"f_number": 4, "focus_distance": 0.6})
        >>> [round(depth, 3) for depth in camera.depth_of_field()]  # metres
        [0.502, 0.746]
        >>> [round(depth, 3) for depth in camera.depth_of_field(max_blur=2)]
        [0.431, 0.987]
        """
        if self.focus_range is not None:
            return self.focus_range
        if (self.aperture is None and self.f_number is None) or self.focus_distance is None:
            return 0.0, math.inf
        assert self.pixel_size is not None
        c = self.max_blur if max_blur is None else positive("max_blur", max_blur)
        if self.f_number is not None and self.magnification is not None:
            lens = self.focus_distance, self.f_number, self.magnification
            return parallel.depths_in_focus(*lens, c * min(self.pixel_size))
        assert self.focal_length is not None
        assert self.aperture is not None
        b = c * min(self.pixel_size)
        return depths_in_focus(self.focus_distance, self.focal_length, self.aperture, b)


def depths_in_focus(
    distance: float, focal_length: float, aperture: float, circle: float
) -> tuple[float, float]:
    """(3.10) and (3.11) of `Camera.depth_of_field`, of its z_s, f, A and b, metres."""
    # Divided through by A f, so that no small lens makes 0 / 0.
    blur = circle / aperture * ((distance - focal_length) / focal_length)
    return distance / (1 + blur), distance / (1 - blur) if blur < 1 else math.inf
