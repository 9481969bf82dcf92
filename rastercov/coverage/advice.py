"""Advice for a camera to cover a face or a point: the words of `REASONS` with its figures."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.format import number
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera, to_image
from rastercov.coverage.reasons import REASONS, Reason
from rastercov.coverage.task import Task

FloatArray = NDArray[np.float64]

LIMITS = (
    ("drawn_pixels", "min_pixels", 0.5, "px"),
    ("pixel_density", "min_pixel_density", 1.0, "px/m"),
    ("facing_density", "min_facing_density", 1.0, "px/m"),
    ("pixels_per_m2", "min_pixels_per_m2", 0.5, "px/m²"),
)
"""Figure, least value of a task, power of nearness by which it grows, and unit."""
STEP_REL = 1e-4
"""Step of a derivative of the image, relative to the distance of the point."""


class Short(NamedTuple):
    """The least value that is missed by most: factor of nearness that is missing, found, wanted."""

    factor: float
    found: str
    wanted: str


def short_of(figures: Mapping[str, Any], task: Task) -> Short | None:
    """Least value of a task that figures miss by most; None where they miss none."""
    missed = [
        Short(
            (least / figures[name]) ** power, _with_unit(figures[name], unit),
            _with_unit(least, unit),
        )
        for name, of_task, power, unit in LIMITS
        if 0 < figures.get(name, 0.0) < (least := float(getattr(task, of_task)))
    ]  # fmt: skip
    return max(missed, default=None)


def advice(
    reason: Reason, figures: Mapping[str, Any], depth: FloatArray, task: Task, camera: Camera,
    hider: str = "",
) -> str:  # fmt: skip
    """Advice for a camera to cover what it does not cover.

    Parameters
    ----------
    reason : Reason
        Criterion that fails.
    figures : mapping
        `distance`, metres, `incidence`, radians, and those of `LIMITS` that are known.
    depth : (N,) float64
        Depths of its points, metres.
    task, camera
        Thresholds, and the camera that has these figures.
    hider : str
        Name of what is before it.
    """
    short, distance = short_of(figures, task), float(figures["distance"])
    if reason == Reason.TOO_COARSE and short is None:
        return "come nearer, or take a longer lens"
    z_n, z_f = map(float, camera.depth_of_field(task.max_blur))
    reach = "or more" if math.isinf(z_f) else f"to {number(z_f)} m"
    near, far = number(float(depth.min())), number(float(depth.max()))
    factor, found, wanted = short or Short(1.0, "", "")
    return REASONS[reason.name.lower()].advice.format(
        wider=", or take a wider lens" if (depth > 0).all() else "",
        depth=f"{near} m" if near == far else f"{near} to {far} m",
        in_focus=f"{number(z_n)} m {reach}",
        found=found,
        wanted=wanted,
        distance=f"{number(distance)} m",
        nearer=f"{number(distance / factor)} m",
        times=f"{factor:.2g} times",
        hider=hider or "what is before it",
        angle=f"{math.degrees(figures['incidence']):.3g}",
        max_angle=f"{task.max_incidence_deg:g}",
    )


def figures_of_point(
    camera: Camera, pose: FloatArray, point: FloatArray, normal: FloatArray
) -> dict[str, float]:
    """Figures of a point of a surface with a unit normal, for `advice`.

    Densities are singular values of the derivative of the image, by central differences: on the
    surface, and for a target that faces the camera. They are 0 where there is no image.
    """
    ray = point - pose[:3, 3]
    distance = max(float(np.linalg.norm(ray)), 1e-300)
    steps = STEP_REL * distance * np.concatenate((np.eye(3), -np.eye(3)))
    with np.errstate(all="ignore"):
        ends = to_image(to_camera(point + steps, pose), camera)
        slopes = (ends[:3] - ends[3:]).T / (2 * STEP_REL * distance)
    slopes = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
    along = np.linalg.svd(slopes @ (np.eye(3) - np.outer(normal, normal)), compute_uv=False)
    return {
        "distance": distance,
        "incidence": math.acos(min(1.0, abs(float(ray @ normal)) / distance)),
        "pixel_density": float(along[1]),
        "facing_density": float(np.linalg.svd(slopes, compute_uv=False)[1]),
        "pixels_per_m2": float(along[0] * along[1]),
    }


def _with_unit(value: float, unit: str) -> str:
    """A figure of `LIMITS` as text: "1.3 px/mm"."""
    for power, name in ((1, "px/m"), (2, "px/m²")):
        if unit == name and value >= 10 ** (3 * power):
            value, unit = value / 10 ** (3 * power), name.replace("/m", "/mm")
    return f"{number(value)} {unit}"
