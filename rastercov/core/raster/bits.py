"""Covered pairs of pose and face as bits, with the covered area of each pose.

A million poses of 10,000 faces take 1.25 GB. Areas are sums of integers, which do not depend on
their order: any device and any number of threads gives the same bits.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    ByteArray,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    StrPath,
    frozen_record,
    once_each,
    read_json,
    read_only,
    shown,
)
from rastercov.core.mesh import Mesh

COVERED = "covered"
"""Name of the bits among the fields of `evaluate`."""
UNITS = 1 << 44
"""Units of area in the evaluated area of a mesh."""
PACKED, AREAS, VIEWS, HEADER = "packed.npy", "area_units.npy", "views.npy", "bits.json"
"""Files of a folder of bits."""
WORD = 8
"""Bytes of a word: rows are whole words."""


@once_each
def whole_area(mesh: Mesh) -> float:
    """Evaluated area, m^2, as one correctly rounded sum."""
    return max(math.fsum(mesh.areas[mesh.task_mask].tolist()), TINY)


def unit_of(mesh: Mesh) -> float:
    """Square metres of a unit of area."""
    return whole_area(mesh) / UNITS


@once_each
def area_units(mesh: Mesh) -> IntArray:
    """(F,) area of each face in units of 2^-44 of `whole_area`, rounded; 0 if it is not evaluated.

    The area of covered faces is the sum of their units, whatever the order.
    """
    share = np.where(mesh.task_mask, mesh.areas, 0.0) / whole_area(mesh)
    return read_only(np.rint(share * UNITS), np.int64)


def room_for_bits(n_poses: int, n_faces: int) -> ByteArray:
    """Memory (P, 8 W) of the bits of poses, all 0, in W words of 64 bits."""
    return np.zeros((n_poses, -(-n_faces // (8 * WORD)) * WORD), np.uint8)


@frozen_record(repr=False)
class CoverageBits(InOneLine):
    """Faces that each pose covers, one bit each: the pairs with `Reason.COVERED`.

    Attributes
    ----------
    packed : (P, ceil(F / 8)) uint8
        Face f is bit `f % 8`, the lowest first, of byte `f // 8`; bits beyond the last face are 0.
        A view of rows of whole 64-bit words.
    area_units : (P,) int64
        Covered area of each pose, in units of 2^-44 of the evaluated area. The area of each face is
        rounded to such units before it is added, so that sums do not depend on their order.
    views : (F,) int64
        Number of poses that cover each face.
    unit : float
        Square metres of a unit.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0, 0, 0.6)], (0, 0, 0))
    >>> bits = rc.evaluate(mesh, camera, poses, method="sampled", fields=("covered",)).bits
    >>> bits.packed.tolist(), bits.areas.round(4).tolist()  # m^2
    ([[12, 0], [0, 12]], [0.04, 0.04])
    >>> bits.dense()[0].nonzero()[0].tolist()
    [2, 3]
    >>> int(np.unpackbits(bits.packed, axis=1, count=12, bitorder="little").sum())
    4
    """

    packed: ByteArray
    area_units: IntArray
    views: IntArray
    unit: float

    @classmethod
    def open(cls, folder: StrPath) -> Self:
        """Bits that `rastercov evaluate --bits` left in a folder; `packed` is mapped, not read.

        ConfigError where there are none.
        """
        try:
            unit = read_json(Path(folder) / HEADER)["unit_m2"]
            packed, areas, views = (
                np.load(Path(folder) / name, "r") for name in (PACKED, AREAS, VIEWS)
            )
            return cls(packed, areas, views, unit)
        except (OSError, ValueError, KeyError) as error:
            where = shown(str(folder))
            raise ConfigError(
                f"{where}: expected bits of evaluate --bits, got none ({error}); make them"
            ) from None

    @property
    def areas(self) -> FloatArray:
        """(P,) covered area of each pose, m^2."""
        return self.area_units * np.float64(self.unit)

    def dense(self, poses: slice = slice(None)) -> BoolArray:
        """(P, F) mask of the pairs of some poses; eight times as large."""
        octets = self.packed[poses]
        return np.unpackbits(octets, axis=1, count=len(self.views), bitorder="little").view(
            np.bool_
        )


Judged = tuple[CoverageBits, BoolArray]
"""Faces that each pose covers by `Rasterizer._judge`, and `FaceCounts.clipped`."""


@frozen_record
class Criteria:
    """Thresholds, and facts of faces, by which a pose covers a face that was counted.

    Attributes
    ----------
    rules : mapping of str to float
        Thresholds of a task for a camera: `Rules` of `rastercov.core.coverage.task`, by name.
    may_be_covered : (F,) bool
        Faces that meet the criteria of the surface itself.
    """

    rules: Mapping[str, float]
    may_be_covered: BoolArray


def add_bits(whole: CoverageBits, batch: CoverageBits, rows: slice | IntArray) -> None:
    """Put the bits of a batch in some rows of all, and add its views."""
    whole.packed[rows] = batch.packed
    whole.area_units[rows] = batch.area_units
    whole.views[:] += batch.views


def bits_of_first(whole: CoverageBits, n: int) -> CoverageBits:
    """Bits of the first n poses, in which all views are."""
    return replace(whole, packed=whole.packed[:n], area_units=whole.area_units[:n])


def bits_of(mesh: Mesh, packed: ByteArray, area_units: IntArray, views: IntArray) -> CoverageBits:
    """Bits of a mesh; further bytes of rows, as of `room_for_bits`, are left out."""
    octets = packed[:, : -(-mesh.n_faces // 8)]
    return CoverageBits(octets, area_units, views, unit_of(mesh))


def bits_of_pairs(mesh: Mesh, covers: BoolArray) -> CoverageBits:
    """Bits of a mask (P, F)."""
    octets = np.packbits(covers, axis=1, bitorder="little")
    return bits_of(mesh, octets, covers @ area_units(mesh), covers.sum(axis=0))


def no_bits(mesh: Mesh, n_poses: int) -> CoverageBits:
    """Bits of poses before any is added, all 0."""
    areas, views = np.zeros(n_poses, np.int64), np.zeros(mesh.n_faces, np.int64)
    return bits_of(mesh, room_for_bits(n_poses, mesh.n_faces), areas, views)
