"""Lens of a camera: pixels of rays, rays of pixels, and all that loops over its images need.

What an image shows of an ideal plane is bounded by curves. Each plane is divided once for a
camera, so that loops over surfaces cut by straight lines only (`engine/lens/field.cpp`).
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import CameraError, FloatArray, check_array, cos, hypot, read_only, shown, sin
from rastercov.core.camera.camera import Camera, border_of
from rastercov.core.camera.lenses.planes import Proved, planes_in
from rastercov.core.camera.lenses.records import MOST_SIDES, CurvedLens, PlaneRecord
from rastercov.core.camera.models import BASES, MODELS, coefficients_by_name
from rastercov.core.camera.parallel import MODEL
from rastercov.engine import lens_rays, solver_lens

CORE_RAYS, CORE_SLOPES, CORE_MARGIN = 64, (1e-3, 8.0, 80), 0.01
"""Rays around a cone, slopes of cones (least, greatest, number), and the part of the image that
they stay away from its border: pixels between those of two rays are a hundredth as far off."""


@contextmanager
def _camera_errors() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise CameraError(str(error)) from None


@dataclass(frozen=True)
class LensModel:
    """A central camera model: a ray (X, Y, Z), x right, y down, z forward, has one pixel (u, v).

    The centre of the top-left pixel is at (0.5, 0.5). `of_camera.lens_of` has the lens of
    a camera.

    Parameters
    ----------
    width, height : int
        Image size, px.
    code : int
        Base of the lens, a row of `rastercov.core.camera.lenses.BASES`.
    coefficients : tuple of float
        Parameters up to `solver_lens.LATE`.
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
    _region: tuple[FloatArray, float, bool] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        limit = math.pi if self.max_angle_deg is None else math.radians(self.max_angle_deg)
        params = np.zeros(solver_lens.SIZE)
        params[: len(self.coefficients)] = self.coefficients
        with _camera_errors():
            region = solver_lens.find_region(self.code, self.width, self.height, limit, params)
        object.__setattr__(self, "_region", (params, *region))

    @property
    def params(self) -> FloatArray:
        """Parameters for the kernels, (32,), with the valid region."""
        return self._region[0].copy()

    @property
    def valid_angle(self) -> float:
        """Angle of the border of the valid region, a cone, from the z axis, radians."""
        return self._region[1]

    @property
    def is_whole(self) -> bool:
        """True where each pixel of the image has a ray; False where some see nothing."""
        return self._region[2]

    def project(self, rays: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of rays (..., 3) of any length, NaN outside the valid region."""
        return self._each(lens_rays.project_many, "rays", rays, 3, (2,))

    def jacobian(self, rays: ArrayLike) -> FloatArray:
        """Derivatives (..., 2, 3) of pixels by rays, px per unit; NaN outside the valid region."""
        return self._each(lens_rays.jacobian_many, "rays", rays, 3, (2, 3))

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Rays (..., 3) of unit length of pixels (..., 2), also beyond the image.

        NaN for a pixel that no ray of the valid region meets.
        """
        return self._each(lens_rays.unproject_many, "pixels", pixels, 2, (3,))

    @cached_property
    def core(self) -> float:
        """Slope of a cone around the axis of which the image shows all rays; 0 for none.

        The lens is continuous and one-to-one: pixels of the cone are within those of its border,
        and so in the image, which is convex, where these are.
        """
        if self.code == BASES.index("equirectangular"):
            return 0.0  # not continuous on one side of the axis
        turn = np.linspace(0, 2 * math.pi, CORE_RAYS)
        slope = np.geomspace(*CORE_SLOPES)[:, None]
        rays = np.stack([slope * cos(turn), slope * sin(turn), np.ones_like(slope * turn)], 2)
        share = self.project(rays) / (self.width, self.height)
        is_beyond = ~(np.abs(share - 0.5) < 0.5 - CORE_MARGIN).all(axis=(1, 2))
        n_shown = int(np.append(is_beyond, True).argmax())
        return float(slope[n_shown - 1, 0]) if n_shown else 0.0

    @cached_property
    def row(self) -> FloatArray:
        """All that is proved of the lens as one row, see `engine/lens/packed.cpp`."""
        return read_only(self.row_within(solver_lens.EDGE_TOLERANCE, solver_lens.FIELD_TOLERANCE))

    def row_within(self, edge: float, field: float) -> FloatArray:
        """The same with other tolerances.

        Parameters
        ----------
        edge : float
            Bound of the error of the area under an edge or a part of one, px^2.
        field : float
            Mean width of the undecided cells along a border of the image, in units of the plane.
        """
        params, angle, _ = self._region
        with _camera_errors():
            size = self.width, self.height
            return solver_lens.pack(self.code, params, angle, *size, edge, field)

    @cached_property
    def proved(self) -> tuple[Proved, ...]:
        """Ideal planes that hold the valid region, each pixel in one of them, as loops take them.

        Their pinholes end where the image of the lens does: those of one frame together, because
        they are solved once.
        """
        return planes_in(self.row)

    @property
    def planes(self) -> tuple[PlaneRecord, ...]:
        """The planes alone."""
        return tuple(each.record for each in self.proved)

    def _each(
        self,
        loop: Callable[..., None],
        name: str,
        values: ArrayLike,
        n: int,
        shape: tuple[int, ...],
    ) -> FloatArray:
        wanted = f"real numbers of shape (..., {n})"
        given = check_array(name, values, "iuf", wanted, CameraError)
        if given.ndim < 1 or given.shape[-1] != n:
            raise CameraError(f"expected {name} of shape (..., {n}), got {given.shape}")
        flat = np.ascontiguousarray(given, np.float64).reshape(-1, n)
        out = np.empty((len(flat), *shape))
        loop(self.code, self._region[0], flat, out)
        return out.reshape(*given.shape[:-1], *shape)


def terms_of(camera: Camera) -> tuple[int, tuple[float, ...]]:
    """Code of the base of a camera's lens, and the parameters of its equations."""
    params = np.zeros(solver_lens.SIZE)
    pixels = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.skew], np.float64)
    model = list(MODELS).index(camera.model)
    code = solver_lens.set_terms(model, pixels, np.array(camera.distortion, np.float64), params)
    return code, tuple(params[: solver_lens.LIMIT].tolist())


BLIND = 6
"""Place of the blind area in a row."""
MOST_LENSES = 1024
"""Lenses that are kept: a reconstruction may have one for each image."""
OPTICS = (
    *("width", "height", "fx", "fy", "cx", "cy", "skew", "model", "distortion", "max_angle_deg"),
)
"""Fields of a camera that make its lens."""
Found = TypeVar("Found")


@lru_cache(maxsize=MOST_LENSES)
def optics_of(camera: Camera) -> Camera:
    """A camera with the same lens that is in focus everywhere and has no near plane.

    That of parallel rays sees the plane at depth 1 as they see it in units of `unit_of`.
    """
    own = {name: getattr(camera, name) for name in OPTICS}
    if not camera.is_parallel:
        return Camera(**own)
    unit = unit_of(camera)
    own |= {name: own[name] * unit for name in ("fx", "fy", "skew")}
    if not camera.distortion:
        return Camera(**(own | {"model": "pinhole"}))
    scale = unit * (camera.magnification or 0.0)  # metres of the sensor
    its = coefficients_by_name(camera.model, camera.distortion)
    model = "division" if "kappa" in its else "opencv"
    values = [value * scale ** OF_RADIUS[name] for name, value in its.items()]
    limit = {"max_angle_deg": MOST_ANGLE_DEG}
    return Camera(**(own | limit | {"model": model, "distortion": values}))


MOST_ANGLE_DEG = 70.0
"""Of parallel rays with distortion: 2.7 units from the axis, for one plane of any model."""
OF_RADIUS = {"kappa": 2, "k1": 2, "k2": 4, "p1": 1, "p2": 1, "k3": 6}
"""Powers of the radius on the sensor that coefficients of parallel rays are of."""


def unit_of(camera: Camera) -> float:
    """Metres across parallel rays that are a unit of their plane; 0 of rays through a point.

    A power of two, by which nothing is rounded, so that the image reaches to between 1/2 and 1.
    """
    if not camera.is_parallel:
        return 0.0
    y = (border_of(camera.width, camera.height, 2)[..., 1] - camera.cy) / camera.fy
    x = border_of(camera.width, camera.height, 2)[..., 0] - camera.cx - camera.skew * y
    most, exponent = math.frexp(hypot(x / camera.fx, y).max())
    return math.ldexp(1.0, exponent - (most == 0.5))


def ideal_camera(camera: Camera, plane: Proved) -> Camera:
    """Pinhole of an ideal plane of a camera; of parallel rays one of these without distortion."""
    own, unit = plane.camera, unit_of(camera)
    if not camera.is_parallel:
        return own
    scaled = replace(own, fx=own.fx / unit, fy=own.fy / unit)
    return replace(scaled, near=camera.near, model=MODEL)


def _keep_with_camera(function: Callable[..., Found]) -> Callable[..., Found]:
    """Keep the result of a function of a lens, which takes seconds, for all that have the lens."""
    result = lru_cache(maxsize=MOST_LENSES)(function)

    @wraps(function)
    def of_camera(camera: Camera, *others: object) -> Found:
        if not camera.is_parallel:
            return result(optics_of(camera), *others)
        try:
            return result(optics_of(camera), *others)
        except CameraError:
            raise CameraError(
                "expected distortion and skew that do not fold a parallel image, got "
                f"{shown((*camera.distortion, camera.skew))}; give 1/m2 on the sensor"
            ) from None

    return of_camera


@_keep_with_camera
def lens_of(camera: Camera) -> LensModel:
    """Lens of a camera, the pinhole's own for one without distortion.

    That of parallel rays takes rays (x, y, `unit_of`) to points at x and y, whatever their depth.

    Raises
    ------
    CameraError
        For a lens that folds at its axis.
    """
    return LensModel(camera.width, camera.height, *terms_of(camera), camera.max_angle_deg)


@_keep_with_camera
def planes_of(camera: Camera) -> tuple[Proved, ...]:
    """Ideal planes of the lens of a camera."""
    return lens_of(camera).proved


def curved_lens(camera: Camera) -> CurvedLens:
    """Lens of a camera for the loops."""
    lens, records = lens_of(camera), [each.record for each in planes_of(camera)]

    def stack(name: str) -> Any:
        return read_only(np.array([getattr(record, name) for record in records]))

    def pad(name: str) -> tuple[Any, Any]:
        polygons = [getattr(record, name) for record in records]
        rows = np.zeros((len(polygons), MOST_SIDES, 2))
        for row, polygon in zip(rows, polygons, strict=True):
            row[: len(polygon)] = polygon
        return read_only(rows), read_only(np.array([len(each) for each in polygons], np.int64))

    regions, region_sides = pad("region")
    holes, hole_sides = pad("hole")
    return CurvedLens(
        lens.code,
        read_only(lens.params),
        float(camera.width),
        float(camera.height),
        not MODELS[camera.model].is_planar,
        stack("frame"),
        stack("params"),
        regions,
        region_sides,
        holes,
        hole_sides,
        stack("longest"),
        stack("parts_of"),
        stack("is_graded"),
        stack("bend"),
        stack("arc_half"),
        stack("arc_bend"),
        records[0].tolerance,
        unit_of(camera),
        lens.core,
    )


def blind_area(lens: LensModel) -> float:
    """Area of the image whose pixels see nothing, px^2: no ray of the valid region meets them."""
    return float(lens.row[BLIND])
