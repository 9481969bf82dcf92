"""Areas of each face in the image, visible fractions (3.14) and their bounds.

Every fraction is (value, bound, kind): the true one lies within `bound` of `value`, in the sense
that `kind` names. Where samples were counted the bound is statistical,

    b = min(1, (3 * 0.27 * sqrt(1.25 L + 1) + L / 20) / N),

with N the samples the face would own alone and L its perimeter in sample spacings: the classical
error of counting lattice points in a shape, and a term for edges along a row of samples, whose
error grows with their length.

D. G. Kendall. On the Number of Lattice Points Inside a Random Oval. 1948, for the square-root law.
"""

from enum import IntEnum
from typing import Self

import numpy as np

from rastercov.base import BoolArray, ByteArray, FloatArray, InOneLine, frozen_record
from rastercov.core.raster.contract import FaceCounts


class BoundKind(IntEnum):
    """Kind of an error bound: STATISTICAL (samples), CERTIFIED (no error) or EXACT (rounding).

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> observation = rc.visibility(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> [rc.BoundKind(kind).name for kind in sorted(set(observation.kind.ravel().tolist()))]
    ['CERTIFIED', 'EXACT']
    """

    STATISTICAL = 0
    """Counted; the bound holds for 99.9 % of the partly visible faces."""
    CERTIFIED = 1
    """Proved to be exactly 0 or 1."""
    EXACT = 2
    """Computed; the bound is rounding."""


KIND_WORDS = {"certified": "proved", "exact": "computed", "statistical": "sampled"}
"""Words for the values of each kind, the most certain first."""


@frozen_record(repr=False)
class Observation(InOneLine):
    """Image areas of each face in each pose, also of back-facing faces; see `Observer.observe`.

    Attributes
    ----------
    visible_pixels, drawn_pixels : (P, F) float64
        Area of the face inside the image that is visible, and that would be without occlusion,
        px^2, whichever side the camera is on.
    kind : (P, F) uint8
        `rastercov.BoundKind` of each visible fraction.
    clipped : (P,) bool
        True where the near plane cuts away a surface in view.
    samples_per_pixel : int
        Samples per px^2 if areas were counted by samples; 1 otherwise.
    area_error : (P, F) float64
        Bound of the errors of both areas together, px^2, if they were computed; 0 otherwise.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=640, height=480, fx=600, fy=600)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     seen = observer.observe(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    >>> round(seen.visible_pixels.sum())  # 200 x 200 pixels: 600 px x 0.2 m / 0.6 m
    40000
    """

    visible_pixels: FloatArray
    drawn_pixels: FloatArray
    kind: ByteArray
    area_error: FloatArray
    clipped: BoolArray
    samples_per_pixel: int = 1

    @classmethod
    def of_counts(cls, counts: FaceCounts) -> Self:
        """Observation of a rasteriser's counts, `drawn` included."""
        kind = np.full(counts.visible.shape, BoundKind.STATISTICAL, np.uint8)
        areas = counts.visible_pixels, counts.drawn_pixels
        area_error = np.broadcast_to(0.0, kind.shape)
        return cls(*areas, kind, area_error, counts.clipped, counts.supersample**2)
