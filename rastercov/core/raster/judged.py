"""Pairs of pose and face that a rasteriser judges where it counts: a bit each."""

from collections.abc import Mapping

from rastercov.base import BoolArray, ByteArray, IntArray, frozen_record


@frozen_record
class Criteria:
    """Thresholds, and facts of faces, by which a pose covers a face that was counted.

    Attributes
    ----------
    rules : mapping of str to float
        Thresholds of a task for a camera: `Rules` of `rastercov.core.coverage.task`, by name.
    may_be_covered : (F,) bool
        Faces that meet the criteria of the surface itself.
    area_units : (F,) int64
        Area of each face in units of 2^-44 of the evaluated area, 0 if it is not evaluated.
    """

    rules: Mapping[str, float]
    may_be_covered: BoolArray
    area_units: IntArray


@frozen_record
class Judged:
    """Pairs of P poses and F faces by `Rasterizer.judge`.

    Attributes
    ----------
    words : (P, 8 W) uint8
        Bits in W words of 64: 1 where the pose covers the face, from the lowest bit of the first
        byte; 0 behind the last face.
    area_units : (P,) int64
        Sum of the area units of the faces that each pose covers.
    views : (F,) int64
        Poses that cover each face.
    clipped : (P,) bool
        As of `FaceCounts`.
    """

    words: ByteArray
    area_units: IntArray
    views: IntArray
    clipped: BoolArray
