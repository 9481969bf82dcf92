"""Covered pairs of cameras and faces as bits: an eighth of a byte for a pair, covered or not.

Rows are in memory or memory-mapped files. All loops over them are shared by threads; sums are of
integers and do not depend on the number of threads.
"""

from collections.abc import Callable, Iterator
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    AnyArray,
    BoolArray,
    Int32Array,
    IntArray,
    frozen_record,
    offsets_of,
    share_poses,
    thread_count,
)
from rastercov.engine import placement_bits as kernels

Words = NDArray[np.uint64]
Work = Callable[[Words, IntArray, slice], None]
"""Loop over some rows of a part, and their places among all rows that were asked for."""

BITS = 64
"""Bits of a word."""
WORDS_A_TURN = 1 << 18
"""Words of some rows that a thread processes at a time, 2 MiB: 0.3 ms or more."""


def n_words(n_faces: int) -> int:
    """Words of a row."""
    return -(-n_faces // BITS)


@frozen_record
class CoveredBits:
    """Faces, or patches, that each camera covers, one bit each.

    Attributes
    ----------
    parts : tuple of (K1, W), (K2, W), ... uint64
        Rows of consecutive cameras; face f is bit `f % 64` of word `f // 64`. Bits beyond the
        last face are 0.
    n_faces : int
        Number of faces or patches F.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import BestCoverage, problem_of_matrix
    >>> covers = [[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]
    >>> bits = problem_of_matrix(covers, BestCoverage(cameras=1)).bits
    >>> bits.n_faces, [each.tolist() for each in bits.pairs()]
    (4, [[0, 2, 4, 6], [0, 1, 1, 2, 2, 3]])
    """

    parts: tuple[Words, ...]
    n_faces: int

    @classmethod
    def of(cls, words: Words, n_faces: int) -> Self:
        """Bits of one array, (K, W), which is not copied and must not be modified afterwards."""
        view = np.asarray(words).view()
        view.flags.writeable = False  # the compiled loops have one signature for all
        return cls((view,), n_faces)

    @classmethod
    def from_dense(cls, covers: ArrayLike) -> Self:
        """Bits of an array (K, F), 1 where camera c covers face f."""
        dense = np.asarray(covers).astype(bool)
        return cls.of(pack_bits(dense), dense.shape[1])

    @classmethod
    def from_pairs(cls, row: IntArray, face: Int32Array, n_rows: int, n_faces: int) -> Self:
        """Bits of N pairs of row and face, (N,) each."""
        words = np.zeros((n_rows, n_words(n_faces)), np.uint64)
        kernels.set_pairs(row, face, words)
        return cls.of(words, n_faces)

    def joined(self, other: "CoveredBits") -> "CoveredBits":
        """Bits of the rows of both, for the same faces."""
        return CoveredBits((*self.parts, *other.parts), self.n_faces)

    def take(self, rows: IntArray) -> "CoveredBits":
        """Bits of some rows, (N,), in their order, copied."""
        words = np.empty((len(rows), self.n_words), np.uint64)
        for part, own, at in self.runs(rows):
            words[at] = part[own]
        return CoveredBits.of(words, self.n_faces)

    @property
    def n_rows(self) -> int:
        """Number of rows K."""
        return int(self.starts[-1])

    @property
    def n_words(self) -> int:
        """Words of a row W."""
        return n_words(self.n_faces)

    @cached_property
    def starts(self) -> IntArray:
        """Number of the first row of each part, and at the end that of all rows."""
        return offsets_of([len(part) for part in self.parts])

    def row(self, number: int) -> Words:
        """(W,) bits of a row."""
        part = int(np.searchsorted(self.starts, number, side="right")) - 1
        return self.parts[part][number - int(self.starts[part])]

    def faces_of(self, number: int) -> Int32Array:
        """(N,) faces of a row, ascending."""
        return np.flatnonzero(unpack_bits(self.row(number), self.n_faces)).astype(np.int32)

    def counts_up_to(self, most: int) -> IntArray:
        """(F,) number of rows that cover each face, counted up to `most`."""
        planes = np.zeros((min(most, self.n_rows), self.n_words), np.uint64)
        for part in self.parts if len(planes) else ():
            step = max(1, WORDS_A_TURN // max(1, self.n_words))
            for start in range(0, len(part), step):  # a while at a time, for Ctrl-C
                kernels.count_up(part[start : start + step], planes)
        counts = np.zeros(self.n_faces, np.int64)
        for plane in planes:
            counts += unpack_bits(plane, self.n_faces)
        return counts

    def sums(
        self, values: IntArray, masks: Words | None = None, rows: IntArray | None = None
    ) -> IntArray:
        """(N, V) sums of values over the faces of each row.

        Parameters
        ----------
        values : (V, 64 W) int64
            Sums that exceed 64 bits lose their upper ones, as hashes do.
        masks : (V, W) uint64, optional
            Faces that count in each sum; all unless given.
        rows : (N,) int64, optional
            All unless given.
        """
        if masks is None:
            masks = np.full((len(values), self.n_words), ~np.uint64(0))
        n = self.n_rows if rows is None else len(rows)
        result = np.zeros((n, len(values)), np.int64)

        def work(words: Words, own: IntArray, at: slice) -> None:
            kernels.sums(words, own, masks, values, result[at])

        self._share(rows, work)
        return result

    def counts(self, mask: Words, rows: IntArray | None = None) -> IntArray:
        """(N,) number of faces within a mask, (W,), of each row."""
        return self.sums(np.ones((1, BITS * self.n_words), np.int64), mask[None], rows)[:, 0]

    def pairs(self) -> tuple[IntArray, Int32Array]:
        """Row limits (K + 1,), and faces of all rows."""
        every, column = np.arange(self.n_rows), np.arange(BITS * self.n_words, dtype=np.int32)
        return self.listed(every, np.full(self.n_words, ~np.uint64(0)), column)

    def listed(
        self, rows: IntArray, mask: Words, column: Int32Array
    ) -> tuple[IntArray, Int32Array]:
        """Row limits (N + 1,), and columns of the faces within a mask, row after row.

        Parameters
        ----------
        rows : (N,) int64
        mask : (W,) uint64
        column : (64 W,) int32
            Column of each face.
        """
        indptr = offsets_of(self.counts(mask, rows))
        face = np.empty(int(indptr[-1]), np.int32)
        for words, own, at in self.runs(rows):
            out = face[indptr[at.start] : indptr[at.stop]]
            kernels.list_pairs(words, own, mask, column, out)
        return indptr, face

    def runs(self, rows: IntArray) -> Iterator[tuple[Words, IntArray, slice]]:
        """Words, their rows and the places in `rows` of consecutive rows of one part."""
        part = np.searchsorted(self.starts, rows, side="right") - 1
        ends = np.flatnonzero(np.diff(part)) + 1
        for start, end in pairwise([0, *ends.tolist(), len(rows)]):
            if end > start:
                own = int(part[start])
                yield self.parts[own], rows[start:end] - self.starts[own], slice(start, end)

    def _share(self, rows: IntArray | None, work: Work) -> None:
        """Share some rows, or all, among threads."""
        if rows is None:
            rows = np.arange(self.n_rows)
        step = max(1, WORDS_A_TURN // max(1, self.n_words))
        turns: list[tuple[Words, IntArray, slice]] = []
        for words, own, at in self.runs(rows):
            for start in range(0, len(own), step):
                some, first = own[start : start + step], at.start + start
                turns.append((words, some, slice(first, first + len(some))))

        def run(part: slice) -> None:
            for turn in turns[part]:
                work(*turn)

        threads = max(1, min(thread_count(None), len(turns)))
        share_poses(len(turns), [run] * threads)


def by_face(indptr: IntArray, face: Int32Array, n_faces: int) -> tuple[IntArray, Int32Array]:
    """Pairs of `CoveredBits.pairs` by face: row limits, (F + 1,), and the row of each pair."""
    starts, rows = np.empty(n_faces + 1, np.int64), np.empty_like(face)
    kernels.by_face(indptr, face, starts, rows)
    return starts, rows


def unpack_bits(words: Words, n_faces: int) -> BoolArray:
    """(F,) bits of a row."""
    octets = np.ascontiguousarray(words, "<u8").view(np.uint8)
    return np.unpackbits(octets, count=n_faces, bitorder="little").astype(bool)


def pack_bits(faces: BoolArray) -> Words:
    """(..., W) words of some faces, (..., F)."""
    octets = np.packbits(spread_out(faces, bool), axis=-1, bitorder="little")
    return octets.view("<u8").astype(np.uint64)


def spread_out(values: AnyArray, dtype: type = np.int64) -> AnyArray:
    """Values of each face, (..., F), with zeros up to a whole number of words."""
    n_faces = values.shape[-1]
    out = np.zeros((*values.shape[:-1], BITS * n_words(n_faces)), dtype)
    out[..., :n_faces] = values
    return out
