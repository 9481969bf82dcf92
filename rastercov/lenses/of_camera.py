"""Lens of a camera, with all that loops over its images need."""

from functools import lru_cache

from rastercov.camera import Camera
from rastercov.camera_models import lens_terms
from rastercov.lenses.lens import Lens, make_lens
from rastercov.lenses.planes import IdealPlane
from rastercov.lenses.quadrature import edge_table
from rastercov.lenses.records import PlaneRecord, record_of
from rastercov.lenses.slopes import Slopes, slopes_in

TOLERANCE = 1e-9
"""Bound of the error of each edge or part of an edge, px^2."""
MOST_LENSES = 1024
"""Lenses that are kept: a reconstruction may have one for each image."""


@lru_cache(maxsize=MOST_LENSES)
def lens_of(camera: Camera) -> Lens:
    """Lens of a camera, the pinhole's own for one without distortion.

    Raises
    ------
    CameraError
        For coefficients that make no lens, or one that folds at its axis.
    """
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
    """Ideal planes of the lens of a camera, and the same for the loops."""
    return tuple(
        (plane, record_of(plane, camera.width, camera.height, edge_table(plane, TOLERANCE)))
        for plane in lens_of(camera).planes
    )


@lru_cache(maxsize=MOST_LENSES)
def slopes_of(camera: Camera) -> tuple[Slopes, ...]:
    """Bounds of derivatives in each plane of a camera, in the order of `planes_of`."""
    return tuple(slopes_in(plane) for plane, _ in planes_of(camera))
