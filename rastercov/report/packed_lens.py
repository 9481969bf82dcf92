"""A lens as one row of numbers, for `rc_lens_create` of rastercov.h and for live pages."""

from rastercov.base import FloatArray
from rastercov.core.camera import MODELS, Camera
from rastercov.core.camera.lenses.of_camera import lens_of


def pack_lens(camera: Camera) -> FloatArray:
    """(N,) numbers of the lens of a camera that is no pinhole.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera(
    ...     width=640, height=480, fx=600, fy=600, model="opencv", distortion=(-0.1, 0.01, 0, 0)
    ... )
    >>> from rastercov.report.packed_lens import pack_lens
    >>> pack_lens(camera)[3]  # planes
    1.0
    """
    row = lens_of(camera).row.copy()
    row[1:3] = not MODELS[camera.model].is_planar, camera._has_closed_form
    return row
