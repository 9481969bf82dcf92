"""Pointwise criteria through a lens, for the loops over one of its ideal planes."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import read_only
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import fields_of, planes_of, slopes_of
from rastercov.camera.models import MODELS
from rastercov.coverage.task import Task
from rastercov.kernels.area_plane import Rules
from rastercov.kernels.lens_field import Tree
from rastercov.kernels.lens_slopes import Slopes

FloatArray = NDArray[np.float64]


class LensRules(NamedTuple):
    """Criteria in one ideal plane of a lens.

    `pinhole` has what a surface must meet in the plane itself: to be in its image, and the angle of
    incidence. `axis` is the axis of the lens in the axes of the plane, along which depths from
    `z_n` to `z_f` are in focus; distances from `nearest` to `farthest` are. `min_per_m2`,
    `min_density` and `min_facing` are 0 where there is no limit. `strip_gap` is the mean width of
    the strips that no test decides, metres. `tree` is the field of view; `code`, `params` and
    `frame` are the lens, and `slopes` bounds of its derivatives.
    """

    pinhole: Any
    axis: FloatArray
    z_n: float
    z_f: float
    nearest: float
    farthest: float
    min_per_m2: float
    min_density: float
    min_facing: float
    strip_gap: float
    tree: Tree
    code: int
    params: FloatArray
    frame: FloatArray
    slopes: Slopes

    @property
    def has_discs(self) -> bool:
        """True where coverage ends at a distance; `cut_regions` has ended it at an angle."""
        return bool(self.farthest < math.inf)

    @property
    def has_densities(self) -> bool:
        """True where points in view and within the disc must be looked at."""
        return max(self.min_per_m2, self.min_density, self.min_facing, self.nearest) > 0


def lens_rules(
    camera: Camera,
    task: Task,
    index: int,
    pixel_error: float,
    gap: float,
    strip: float,
    size: float,
) -> LensRules:
    """Criteria of a task through one of the ideal planes of a camera.

    Parameters
    ----------
    camera, task
        Camera, and thresholds of `rastercov.regions`.
    index : int
        The plane, in the order of `planes_of`.
    pixel_error : float
        Largest error of a position in the plane's pinhole, px.
    gap : float
        Largest distance of an arc from its chords, metres.
    strip : float
        Mean width of undecided parts, relative to `size`.
    size : float
        Diagonal of the mesh, metres.
    """
    plane, record = planes_of(camera)[index]
    thresholds, pinhole = task.limits(camera), plane.camera
    is_limited = task.max_incidence_deg < 90
    depths, distances = (thresholds.z_n, thresholds.z_f), (0.0, math.inf)
    if not MODELS[camera.model].is_planar:
        depths, distances = distances, depths
    return LensRules(
        pinhole=Rules(
            fx=float(pinhole.fx), fy=float(pinhole.fy), cx=float(pinhole.cx),
            cy=float(pinhole.cy), width=float(pinhole.width), height=float(pinhole.height),
            z_n=0.0, z_f=math.inf, min_per_m2=0.0, min_density=0.0,
            cos_incidence=thresholds.least_cosine if is_limited else 0.0,
            tan_incidence=float(np.tan(thresholds.max_incidence)) if is_limited else 0.0,
            gap=gap, pixel_error=pixel_error,
        ),
        axis=read_only(plane.frame[2], np.float64),
        z_n=depths[0], z_f=depths[1], nearest=distances[0], farthest=distances[1],
        min_per_m2=float(task.min_pixels_per_m2), min_density=float(task.min_pixel_density),
        min_facing=float(task.min_facing_density), strip_gap=strip * size,
        tree=fields_of(camera, strip / 4)[index],
        code=record.code, params=record.params, frame=record.frame,
        slopes=slopes_of(camera)[index],
    )  # fmt: skip
