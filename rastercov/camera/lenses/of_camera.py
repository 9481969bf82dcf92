"""Lens of a camera, with all that loops over its images need."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.lenses.lens import Lens, make_lens
from rastercov.camera.lenses.planes import IdealPlane
from rastercov.camera.lenses.quadrature import edge_table
from rastercov.camera.lenses.records import record_of
from rastercov.camera.lenses.slopes import slopes_in
from rastercov.camera.models import lens_terms
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.lens_slopes import Slopes

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-9
"""Bound of the error of each edge or part of an edge, px^2."""
MOST_LENSES = 1024
"""Lenses that are kept: a reconstruction may have one for each image."""


def optics_of(camera: Camera) -> Camera:
    """A camera with the same lens that is in focus everywhere and has no near plane.

    Cameras that differ in those alone share what is found of their lens, which takes seconds.
    """
    return Camera(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        skew=camera.skew,
        model=camera.model,
        distortion=camera.distortion,
        max_angle_deg=camera.max_angle_deg,
    )


@lru_cache(maxsize=MOST_LENSES)
def lens_of(camera: Camera) -> Lens:
    """Lens of a camera, the pinhole's own for one without distortion.

    Raises
    ------
    CameraError
        For coefficients that make no lens, or one that folds at its axis.
    """
    if (optics := optics_of(camera)) != camera:
        return lens_of(optics)
    return make_lens(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        skew=camera.skew,
        max_angle_deg=camera.max_angle_deg,
        **lens_terms(camera.model, camera.distortion),
    )


@lru_cache(maxsize=MOST_LENSES)
def planes_of(camera: Camera) -> tuple[tuple[IdealPlane, PlaneRecord], ...]:
    """Ideal planes of the lens of a camera, and the same for the loops.

    Their pinholes end where the image of the lens does: those of one frame together, because they
    are solved once.
    """
    if (optics := optics_of(camera)) != camera:
        return planes_of(optics)
    planes = lens_of(camera).planes
    records = [
        record_of(plane, camera.width, camera.height, edge_table(plane, TOLERANCE))
        for plane in planes
    ]
    found = []
    for plane, record in zip(planes, records, strict=True):
        windows = [other.window for other in records if np.array_equal(other.frame, record.frame)]
        pinhole = cropped(plane.camera, np.concatenate(windows))
        own = record._replace(cx=float(pinhole.cx), cy=float(pinhole.cy))
        found.append((replace(plane, camera=pinhole), own))
    return tuple(found)


def cropped(pinhole: Camera, points: FloatArray) -> Camera:
    """Pinhole with the pixels of its image that hold some points of its plane; all for none."""
    if len(points) == 0:
        return pinhole
    size = np.array([pinhole.width, pinhole.height])
    pixels = points * (pinhole.fx, pinhole.fy) + (pinhole.cx, pinhole.cy)
    low = np.maximum(np.floor(pixels.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0)), size).astype(int)
    width, height = np.maximum(high - low, 1).tolist()
    left, top = low.tolist()
    return replace(pinhole, width=width, height=height, cx=pinhole.cx - left, cy=pinhole.cy - top)


@lru_cache(maxsize=MOST_LENSES)
def slopes_of(camera: Camera) -> tuple[Slopes, ...]:
    """Bounds of derivatives in each plane of a camera, in the order of `planes_of`."""
    if (optics := optics_of(camera)) != camera:
        return slopes_of(optics)
    # Those planes that `planes_of` has asked for its records, whose slopes are kept.
    return tuple(slopes_in(plane) for plane in lens_of(camera).planes)
