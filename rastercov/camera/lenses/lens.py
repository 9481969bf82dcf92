"""Lenses: pixels of rays, rays of pixels, and the valid region between them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import checked_array
from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.planes import IdealPlane, ideal_planes
from rastercov.camera.lenses.region import with_region
from rastercov.camera.models import MODELS, coefficients_by_name
from rastercov.kernels import lens, lens_formulas

FloatArray = NDArray[np.float64]

BASES = (
    *("pinhole", "equidistant", "equisolid", "fov", "unified", "double_sphere", "division"),
    "equirectangular",
)
"""Names of the bases, by their codes in `formulas`."""


@dataclass(frozen=True)
class Lens:
    """A central camera model: a ray (X, Y, Z), x right, y down, z forward, has one pixel (u, v).

    The centre of the top-left pixel is at (0.5, 0.5). `of_camera.lens_of` has the lens of
    a camera.

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


def terms_of(camera: Camera) -> tuple[int, tuple[float, ...]]:
    """Code of the base of a camera's lens, and the parameters of its equations, docs/cameras.md."""
    base, c = MODELS[camera.model].base, coefficients_by_name(camera.model, camera.distortion)

    def of(names: str) -> list[float]:
        return [c.get(name, 0.0) for name in names.split()]

    p = np.zeros(lens_formulas.LATE + 1)
    p[lens_formulas.FX : lens_formulas.K1] = camera.fx, camera.fy, camera.cx, camera.cy, camera.skew
    p[lens_formulas.K1 : lens_formulas.D1] = of("k1 k2 k3 k4 k5 k6")
    if camera.model == "opencv":
        p[lens_formulas.K1 : lens_formulas.P1] = of("k1 k2 k3 . . . k4 k5 k6")
    is_turned = camera.model.startswith("metashape")  # its p1 and p2 are OpenCV's p2 and p1
    p[lens_formulas.P1 : lens_formulas.S1] = of("p2 p1" if is_turned else "p1 p2")
    p[lens_formulas.S1 : lens_formulas.T00] = of("s1 s2 s3 s4")
    (c_x, c_y), (s_x, s_y) = (map(turn, of("tau_x tau_y")) for turn in (math.cos, math.sin))
    # OpenCV's homography of tau_x, tau_y; its first and second row have no more entries.
    p[lens_formulas.T00 : lens_formulas.B0] = c_x, -s_x * s_y, c_y, s_y, -c_y * s_x, c_y * c_x
    of_base = [0.0, 0.0, 0.0]
    if camera.model == "fov" and c["omega"]:
        wide = 2 * math.tan(c["omega"] / 2)
        of_base = [wide, wide / c["omega"], 0.0]
    elif camera.model == "fov":
        base = "pinhole"
    elif camera.model == "omni":
        of_base = [c["xi"], 1.0, 1.0]
    elif camera.model == "eucm":
        of_base = [c["alpha"], 1.0 - c["alpha"], c["beta"]]
    elif camera.model == "equirectangular":
        of_base = [0.0, 1.0, 0.0]  # longitude around 0; its cosine and sine
    elif camera.model in ("division", "double_sphere"):
        of_base = of("k . ." if camera.model == "division" else "xi alpha .")
    p[lens_formulas.B0 : lens_formulas.LATE] = of_base
    p[lens_formulas.LATE] = camera.model == "rad_tan_thin_prism_fisheye"
    return BASES.index(base), tuple(p.tolist())
