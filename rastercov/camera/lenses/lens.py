"""Lenses: pixels of rays, rays of pixels, and the valid region between them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import checked_array
from rastercov.base.checks import focal_length_px, image_side, number, principal_point_px
from rastercov.base.errors import CameraError
from rastercov.camera.lenses.planes import IdealPlane, ideal_planes
from rastercov.camera.lenses.region import with_region
from rastercov.kernels import lens, lens_formulas

FloatArray = NDArray[np.float64]

BASES = (
    *("pinhole", "equidistant", "equisolid", "fov", "unified", "double_sphere", "division"),
    *("backward", "equirectangular"),
)
"""Names of the bases, by their codes in `formulas`."""
LARGEST = 1e12
"""Largest coefficient: a lens with a larger one folds within 1e-12 rad of its axis."""
MOST_TILT = math.radians(60)
"""Radians: largest tilt of a sensor."""


@dataclass(frozen=True)
class Lens:
    """A central camera model: a ray (X, Y, Z), x right, y down, z forward, has one pixel (u, v).

    The centre of the top-left pixel is at (0.5, 0.5). `of_camera.lens_of` has the lens of
    a camera, and `make_lens` makes one from its terms.

    Parameters
    ----------
    width, height : int
        Image size, px.
    code : int
        Base of the lens, as in `rastercov.kernels.lens_formulas`.
    coefficients : tuple of float
        Parameters up to `formulas.LATE`.
    max_angle_deg : float, optional
        Largest angle from the z axis at which the lens is trusted.

    Raises
    ------
    CameraError
        If the lens folds at its axis, so that no region is valid.
    """

    width: int
    height: int
    code: int
    coefficients: tuple[float, ...]
    max_angle_deg: float | None = None

    def __post_init__(self) -> None:
        limit = None if self.max_angle_deg is None else math.radians(self.max_angle_deg)
        params = np.zeros(lens_formulas.SIZE)
        params[: len(self.coefficients)] = self.coefficients
        with np.errstate(all="ignore"):  # coefficients may be huge; what is not finite is no region
            found = with_region(self.code, params, self.width, self.height, limit)
        object.__setattr__(self, "_region", found)

    @property
    def params(self) -> FloatArray:
        """Parameters for the kernels, (32,), with the valid region."""
        params: FloatArray = self._region[0].copy()  # type: ignore[attr-defined]
        return params

    @property
    def base(self) -> str:
        """Name of the base."""
        return BASES[self.code]

    @property
    def valid_angle(self) -> float:
        """Angle of the valid region from the z axis, radians.

        Its border has 128 flat sides, which are nearer to the axis by up to 3e-4 of its tangent.
        """
        angle: float = self._region[1]  # type: ignore[attr-defined]
        return angle

    @property
    def is_whole(self) -> bool:
        """True where each pixel of the image has a ray; False where some see nothing."""
        is_whole: bool = self._region[2]  # type: ignore[attr-defined]
        return is_whole

    def project(self, rays: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of rays (..., 3) of any length, NaN outside the valid region."""
        return self._each(lens.project_many, "rays", rays, 3, (2,))

    def jacobian(self, rays: ArrayLike) -> FloatArray:
        """Derivatives (..., 2, 3) of pixels by rays, px per unit; NaN outside the valid region."""
        return self._each(lens.jacobian_many, "rays", rays, 3, (2, 3))

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Rays (..., 3) of unit length of pixels (..., 2), also beyond the image.

        NaN for a pixel that no ray of the valid region meets.
        """
        return self._each(lens.unproject_many, "pixels", pixels, 2, (3,))

    @cached_property
    def planes(self) -> tuple[IdealPlane, ...]:
        """Ideal pinhole planes that hold the valid region, each pixel in one of them."""
        return ideal_planes(self.code, self.params, self.width, self.height, self.valid_angle)

    def _each(
        self,
        loop: Callable[..., None],
        name: str,
        values: ArrayLike,
        n: int,
        shape: tuple[int, ...],
    ) -> FloatArray:
        wanted = f"real numbers and must have shape (..., {n})"
        given = checked_array(name, values, "iuf", wanted, CameraError)
        if given.ndim < 1 or given.shape[-1] != n:
            raise CameraError(f"{name} must have shape (..., {n}), got {given.shape}")
        flat = np.ascontiguousarray(given, np.float64).reshape(-1, n)
        out = np.empty((len(flat), *shape))
        loop(self.code, self._region[0], flat, out)  # type: ignore[attr-defined]
        return out.reshape(*given.shape[:-1], *shape)


def make_lens(
    base: str,
    width: int,
    height: int,
    *,
    fx: float,
    fy: float,
    cx: float | None = None,
    cy: float | None = None,
    skew: float = 0.0,
    radial: Sequence[float] = (),
    denominator: Sequence[float] = (),
    tangential: Sequence[float] = (),
    prism: Sequence[float] = (),
    tilt: Sequence[float] = (),
    of_base: Sequence[float] = (),
    is_late: bool = False,
    max_angle_deg: float | None = None,
) -> Lens:
    """Lens from the terms of its equations, docs/cameras.md.

    Parameters
    ----------
    base : str
        One of `BASES`.
    width, height : int
        Image size, px.
    fx, fy : float
        Focal lengths, px; px a radian for an equidistant or equirectangular base.
    cx, cy : float, optional
        Principal point, px, the centre of the top-left pixel being (0.5, 0.5); the middle of the
        image unless given.
    skew : float
        u = fx a + skew b + cx.
    radial : sequence of float
        Up to six coefficients of r^2, r^4, ...; of the numerator where there is a denominator.
    denominator : sequence of float
        Up to three coefficients of r^2, r^4, r^6.
    tangential : (p1, p2)
        a += 2 p1 x y + p2 (r^2 + 2 x^2), b += p1 (r^2 + 2 y^2) + 2 p2 x y.
    prism : (s1, s2, s3, s4)
        a += s1 r^2 + s2 r^4, b += s3 r^2 + s4 r^4.
    tilt : (tau_x, tau_y)
        Angles of a tilted sensor, radians.
    of_base : sequence of float
        `fov`: (omega,); `unified`: (A, B, beta), x = X / (A sqrt(beta (X^2 + Y^2) + Z^2) + B Z);
        `double_sphere`: (xi, alpha); `division`: (k,).
    is_late : bool
        Tangential and prism terms take the point after radial distortion.
    max_angle_deg : float, optional
        Largest angle from the z axis at which the lens is trusted; otherwise it is as far as the
        image reaches, or as the lens is proved to be injective.

    Raises
    ------
    CameraError
        For values that describe no lens.
    """
    if base not in BASES:
        raise CameraError(f"the base of a lens must be one of {', '.join(BASES)}, got {base!r}")
    width, height = image_side("width", width), image_side("height", height)
    p = np.zeros(lens_formulas.LATE + 1)
    p[lens_formulas.FX] = focal_length_px("fx", fx)
    p[lens_formulas.FY] = focal_length_px("fy", fy)
    p[lens_formulas.CX] = principal_point_px("cx", width / 2 if cx is None else cx)
    p[lens_formulas.CY] = principal_point_px("cy", height / 2 if cy is None else cy)
    p[lens_formulas.SKEW] = principal_point_px("skew", skew)
    _put(p, lens_formulas.K1, "radial", radial, 6)
    _put(p, lens_formulas.D1, "denominator", denominator, 3)
    _put(p, lens_formulas.P1, "tangential", tangential, 2)
    _put(p, lens_formulas.S1, "prism", prism, 4)
    tau_x, tau_y = (*_numbers("tilt", tilt, 2), 0.0, 0.0)[:2]
    if max(abs(tau_x), abs(tau_y)) > MOST_TILT:
        raise CameraError(
            f"tilt must be within {MOST_TILT:.3g} rad, got ({tau_x:g}, {tau_y:g}): "
            "check that it is in radians"
        )
    c, s, e, t = math.cos(tau_x), math.sin(tau_x), math.cos(tau_y), math.sin(tau_y)
    # OpenCV's homography of tau_x, tau_y; its first and second row have no more entries.
    p[lens_formulas.T00 : lens_formulas.T22 + 1] = c, -s * t, e, t, -e * s, e * c
    p[lens_formulas.B0 : lens_formulas.B2 + 1] = _base_parameters(base, of_base)
    p[lens_formulas.LATE] = float(is_late)
    if max_angle_deg is not None:
        max_angle_deg = number("max_angle_deg", max_angle_deg)
        if not 0 < max_angle_deg <= 180:
            raise CameraError(
                f"max_angle_deg must be above 0 and at most 180, got {max_angle_deg:g}"
            )
    bent = p[lens_formulas.K1 : lens_formulas.T00].any() or tau_x or tau_y
    if base == "equirectangular" and (bent or max_angle_deg is not None):
        raise CameraError("an equirectangular image has no distortion and no largest angle")
    return Lens(width, height, BASES.index(base), tuple(p.tolist()), max_angle_deg)


def _numbers(name: str, values: Sequence[float], most: int) -> list[float]:
    try:
        given = list(values)
    except TypeError:
        raise CameraError(f"{name} must be up to {most} numbers, got {values!r}") from None
    if len(given) > most:
        raise CameraError(f"{name} must be up to {most} numbers, got {len(given)}")
    numbers = [number(name, value) for value in given]
    for value in numbers:
        if abs(value) > LARGEST:
            raise CameraError(
                f"{name} must be numbers within {LARGEST:g}, got {value:g}: check their units"
            )
    return numbers


def _put(p: FloatArray, first: int, name: str, values: Sequence[float], most: int) -> None:
    given = _numbers(name, values, most)
    p[first : first + len(given)] = given


def _base_parameters(base: str, of_base: Sequence[float]) -> tuple[float, float, float]:
    names: dict[str, tuple[str, ...]] = {
        "fov": ("omega",),
        "unified": ("A", "B", "beta"),
        "double_sphere": ("xi", "alpha"),
        "division": ("k",),
    }
    wanted = names.get(base, ())
    given = _numbers("of_base", of_base, 3)
    if len(given) != len(wanted):
        raise CameraError(
            f"base {base} must have {len(wanted)} parameters ({', '.join(wanted) or 'none'}), "
            f"got {len(given)}"
        )

    def check(name: str, is_good: bool, wanted: str, value: Any) -> None:
        if not is_good:
            raise CameraError(f"{name} of base {base} must be {wanted}, got {value:g}")

    if base == "fov":
        (omega,) = given
        check("omega", 0 < omega < math.pi, "above 0 and below pi radians", omega)
        wide = 2 * math.tan(omega / 2)
        return wide, wide / omega, 0.0
    if base == "unified":
        A, B, beta = given
        check("A", A >= 0, "0 or more", A)
        check("B", B >= 0 and A + B > 0, "0 or more, and not 0 where A is", B)
        check("beta", beta > 0, "positive", beta)
        return A, B, beta
    if base == "double_sphere":
        xi, alpha = given
        check("xi", -1 < xi <= 1, "above -1 and at most 1", xi)
        check("alpha", 0 <= alpha <= 1, "0 to 1", alpha)
        return xi, alpha, 0.0
    if base == "equirectangular":
        return 0.0, 1.0, 0.0  # longitude around 0; its cosine and sine
    return (given[0] if base == "division" else 0.0), 0.0, 0.0
