"""Presolve: remove faces that cannot be covered, merge equal candidates.

Of candidates that cover the same faces, the k cheapest remain where a face needs k views. Where an
angle between views is required, candidates are equal only at the same positions.

The remaining candidates are ranked by the faces they cover, not by their numbers, and the rank
breaks ties: shuffling the candidates of a problem does not change the result.

One pass over the bits, after that of `Problem.reachable`. Lists of pairs are made of the bits of
all remaining candidates, or of some (`Presolved.list_rows`).

G. L. Steele, D. Lea, C. H. Flood. Fast Splittable Pseudorandom Number Generators. 2014, for the
mixing of 64 bits.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rastercov.base import BoolArray, FloatArray, Int32Array, IntArray, frozen_record, offsets_of
from rastercov.engine import placement_bits
from rastercov.placement.bits import CoveredBits, by_face, pack_bits, spread_out
from rastercov.placement.select.problem import Problem


@frozen_record(kw_only=True)
class Reduced:
    """A problem of C candidates after presolve.

    Attributes
    ----------
    problem : Problem
        Original problem.
    candidates : (C,) int64
        Their rows in the problem, ascending.
    costs, rank : (C,) float64, int64
        `rank` is the order of the candidates, which depends only on the faces they cover.
    integer_weights, kind : (F,) int64, int32
        Of each face: its weight, and the innermost requirement that it counts towards.
    least, ends : (G,) int64
        Weight to cover of each requirement, 0 for all faces. Requirement g is of kinds g ...
        `ends[g]` - 1: its own, and those of the requirements in it.
    """

    problem: Problem
    candidates: IntArray
    costs: FloatArray
    rank: IntArray
    integer_weights: IntArray
    kind: Int32Array
    least: IntArray
    ends: IntArray

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return len(self.candidates)

    @property
    def is_spread(self) -> bool:
        """True where the rays to two cameras of a face must differ by an angle."""
        return self.problem.is_spread

    @cached_property
    def is_of(self) -> BoolArray:
        """(G, G) whether each requirement, by row, is of each kind."""
        kinds = np.arange(len(self.ends))
        return (kinds[:, None] <= kinds) & (kinds < self.ends[:, None])

    @cached_property
    def levels(self) -> list[IntArray]:
        """(G,) requirement that each kind counts towards, or -1, for each depth; inner ones first.

        Requirements of equal depth have no face in common.
        """
        depth = self.is_of.sum(axis=0)
        own = np.where(depth == np.arange(1, depth.max() + 1)[:, None], np.arange(len(depth)), 0)
        outer = np.maximum.accumulate(own, axis=1)
        return [*np.where(depth > np.arange(len(outer))[:, None], outer, -1)[::-1]]


@frozen_record(kw_only=True)
class Presolved(Reduced):
    """A problem after presolve in bits; faces keep their numbers.

    The weight of faces that do not remain is 0.

    Attributes
    ----------
    bits : CoveredBits
        Those of the problem, without pairs of a rig with a face beyond the views that this needs
        where any two rays will do: they change nothing but bounds, which are tighter without them.
    sizes : (C,) int64
        Upper limit of the number of remaining pairs of each.
    kept : (K,) int64
        Remaining faces.
    """

    bits: CoveredBits
    sizes: IntArray
    kept: IntArray

    @cached_property
    def remains(self) -> BoolArray:
        """(F,) remaining faces."""
        remains = np.zeros(self.problem.n_faces, bool)
        remains[self.kept] = True
        return remains

    def sums(self, values: IntArray, faces: BoolArray, rows: IntArray | None = None) -> IntArray:
        """(N, G) sums of values, (F,), over the remaining ones of some faces, (F,), by their kind.

        Of some candidates, or all, each of one camera.
        """
        kinds = np.arange(len(self.least))[:, None]
        masks = pack_bits(faces & self.remains & (self.kind == kinds))
        chosen = self.candidates if rows is None else self.candidates[rows]
        return self.bits.sums(np.stack([spread_out(values)] * len(masks)), masks, chosen)

    def list_rows(self, rows: IntArray | None = None) -> "ReducedProblem":
        """The problem with all candidates, or some, (N,) ascending, in lists.

        All remaining faces are in it, also those that these candidates do not cover.
        """
        problem, kept = self.problem, self.kept
        rows = np.arange(self.n_candidates) if rows is None else rows
        candidates = self.candidates[rows]
        starts = problem.rows
        counts = starts[candidates + 1] - starts[candidates]
        limits = offsets_of(counts)
        owner = np.repeat(np.arange(len(candidates), dtype=np.int32), counts)
        cameras = np.arange(limits[-1]) + (starts[candidates] - limits[:-1])[owner]
        column = np.full(problem.n_faces, -1, np.int32)
        column[kept] = np.arange(len(kept))
        column = spread_out(column, np.int32)
        camera_indptr, face = self.bits.listed(cameras, pack_bits(self.remains), column)
        face_starts, covering = by_face(camera_indptr, face, len(kept))
        views = problem.views[kept].astype(np.int32)
        eyes = centroids = np.empty((0, 3))
        if problem.is_spread:
            assert problem.eyes is not None
            assert problem.centroids is not None
            eyes, centroids = problem.eyes[cameras], problem.centroids[kept]
        return ReducedProblem(
            problem=problem,
            candidates=candidates,
            owner=owner,
            limits=limits,
            camera_indptr=camera_indptr,
            face=face,
            starts=face_starts,
            covering=covering,
            integer_weights=self.integer_weights[kept],
            views=views,
            need=views + np.int32(problem.is_spread),
            kind=self.kind[kept],
            least=self.least,
            ends=self.ends,
            costs=self.costs[rows],
            rank=self.rank[rows],
            eyes=eyes,
            centroids=centroids,
        )


@frozen_record(kw_only=True)
class ReducedProblem(Reduced):
    """A problem after presolve in lists, of K cameras and the F faces that remain.

    Attributes
    ----------
    owner : (K,) int32
        Candidate of each camera, ascending.
    limits : (C + 1,) int64
        Cameras of each candidate.
    camera_indptr, face : (K + 1,) int64, (N,) int32
        Faces of each camera.
    starts, covering : (F + 1,) int64, (N,) int32
        Cameras of each face.
    views, need : (F,) int32
        Cameras that must cover the face; `need` has one step more where rays must differ.
    eyes, centroids : (K, 3), (F, 3) float64
        Empty where no angle is required.
    """

    owner: Int32Array
    limits: IntArray
    camera_indptr: IntArray
    face: Int32Array
    starts: IntArray
    covering: Int32Array
    views: Int32Array
    need: Int32Array
    eyes: FloatArray
    centroids: FloatArray

    @property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.integer_weights)

    @property
    def indptr(self) -> IntArray:
        """(C + 1,) limits in `face` of the pairs of each candidate."""
        return self.camera_indptr[self.limits]

    @property
    def merged(self) -> "ReducedProblem":
        """The problem with one face, of their weight, for all that count alike.

        The same cameras cover them, and they need as many views for the same requirement. Where
        rays must differ, they stay apart.
        """
        if self.is_spread or not self.n_faces:
            return self
        keys = _hashes_of(np.arange(len(self.camera_indptr), dtype=np.uint64))
        sets = np.add.reduceat(keys[self.covering], self.starts[:-1])
        alike = np.column_stack((sets, self.views, self.kind))
        first, of = np.unique(alike, axis=0, return_index=True, return_inverse=True)[1:]
        kept = np.sort(first)
        of = kept.searchsorted(first)[of.ravel()]
        is_kept = np.isin(self.face, kept)
        starts = np.append(0, np.cumsum(is_kept))[self.camera_indptr]
        face = of[self.face[is_kept]].astype(np.int32)
        face_starts, covering = by_face(starts, face, len(kept))
        return replace(
            self,
            camera_indptr=starts,
            face=face,
            starts=face_starts,
            covering=covering,
            integer_weights=np.bincount(of, self.integer_weights).astype(np.int64),
            views=self.views[kept],
            need=self.need[kept],
            kind=self.kind[kept],
        )

    @property
    def is_mandatory(self) -> BoolArray:
        """(F,) faces without which the requirements cannot be met."""
        whole = np.zeros(len(self.least), np.int64)
        np.add.at(whole, self.kind, self.integer_weights)
        wanted = (self.least >= (self.is_of * whole).sum(axis=1)) & (self.least > 0)
        return self.is_of[wanted].any(axis=0)[self.kind]


def presolve(problem: Problem) -> Presolved:
    """The problem with equal candidates merged, and the faces that count and can be covered.

    Equivalent to the problem: the optima are equal, and a selection from the remaining candidates
    covers the same faces in both.
    """
    n_faces, first = problem.n_faces, problem.rows[:-1]
    is_plain_rig = problem.has_rigs and not problem.is_spread
    bits = _without_needless_pairs(problem) if is_plain_rig else problem.bits
    counted = problem.reachable & (problem.integer_weights > 0)
    kind, ends = kinds_of(problem)
    keys = _hashes_of(np.arange(n_faces, dtype=np.uint64)).view(np.int64).T
    values = spread_out(np.concatenate((keys, np.ones((1, n_faces), np.int64))))
    sums = bits.sums(values, np.stack([pack_bits(counted)] * len(values)))
    hashes, sizes = np.ascontiguousarray(sums[:, :2]).view(np.uint64), sums[:, 2]
    if problem.is_spread:
        hashes = hashes + np.uint64(3) * _hashes_of_eyes(problem)
        if problem.has_rigs:  # of a sum of these, faces and eyes could be exchanged
            hashes = _hashes_of(hashes.ravel())[:, 0].reshape(-1, 2)
            hashes[sizes == 0] = 0
    if problem.has_rigs:
        hashes, sizes = np.add.reduceat(hashes, first), np.add.reduceat(sizes, first)
    copies = int(problem.views[counted].max(initial=1))
    rank = rank_faces(hashes, sizes, problem.costs, copies)
    candidates = np.flatnonzero(rank >= 0)
    return Presolved(
        problem=problem,
        bits=bits,
        candidates=candidates,
        costs=problem.costs[candidates],
        rank=rank[candidates],
        sizes=sizes[candidates],
        kept=np.flatnonzero(counted),
        integer_weights=np.where(counted, problem.integer_weights, 0),
        kind=kind,
        least=problem.required[1],
        ends=ends,
    )


def _hashes_of(keys: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """(N, 2) hashes of keys, (N,); that of a set is their sum, modulo 2^64.

    Two different sets have the same 128 bits once in 10^38 pairs.
    """
    first = _mixed(keys)
    return np.stack((first, _mixed(first ^ np.uint64(0x5851F42D4C957F2D))), axis=1)


def _mixed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = numbers + np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ z >> np.uint64(shift)) * np.uint64(factor)
    return z ^ z >> np.uint64(31)


def _without_needless_pairs(problem: Problem) -> CoveredBits:
    """Bits of rigs, of which the n-th camera has the faces that n cameras or more of it cover.

    And that need n views. Where any two rays will do, it does not matter which cameras these are.
    """
    words = np.zeros((problem.bits.n_rows, problem.bits.n_words), np.uint64)
    most = int(np.diff(problem.rows).max())
    needs = [pack_bits(problem.views > n) for n in range(most)]
    for first, last in zip(problem.rows[:-1], problem.rows[1:], strict=True):
        rig = problem.bits.take(np.arange(first, last)).parts[0]
        placement_bits.count_up(rig, words[first:last])
        words[first:last] &= needs[: last - first]
    return CoveredBits.of(words, problem.n_faces)


def _hashes_of_eyes(problem: Problem) -> NDArray[np.uint64]:
    """(K, 2) hashes of the camera centres."""
    assert problem.eyes is not None
    bits = np.ascontiguousarray(problem.eyes + 0.0).view(np.uint64)
    keys = (bits + np.arange(3, dtype=np.uint64)).astype(np.uint64, copy=False)  # for mypy
    return _hashes_of(keys.ravel()).reshape(-1, 3, 2).sum(axis=1)


def kinds_of(problem: Problem) -> tuple[Int32Array, IntArray]:
    """(F,) kind of each face, and (G,) end of the kinds of each requirement."""
    kind_of_group = np.zeros(len(problem.groups), np.int32)
    for kind, rows in enumerate(problem.members):  # the inner ones last
        kind_of_group[rows] = kind
    ends = [1 + kind_of_group[rows].max(initial=0) for rows in problem.members]
    return kind_of_group[problem.face_group], np.array(ends, np.int64)


def rank_faces(
    hashes: NDArray[np.uint64], sizes: IntArray, costs: FloatArray, copies: int
) -> IntArray:
    """(C,) rank of each candidate that remains, -1 for the others.

    Parameters
    ----------
    hashes, sizes : (C, 2) uint64, (C,) int64
        Of the faces that each candidate covers.
    costs : (C,) float64
    copies : int
        Equal candidates that remain, the cheapest ones.
    """
    order = np.lexsort((np.arange(len(sizes)), costs, hashes[:, 1], hashes[:, 0]))
    order = order[sizes[order] > 0]
    order = order[_place_in_run(hashes[order]) < copies]
    rank = np.full(len(sizes), -1, np.int64)
    rank[order] = np.arange(len(order))
    return rank


def _place_in_run(keys: NDArray[np.uint64]) -> IntArray:
    """(N,) number of equal rows directly before each row."""
    if not len(keys):
        return np.zeros(0, np.int64)
    starts = np.concatenate(([True], (keys[1:] != keys[:-1]).any(axis=1)))
    at = np.arange(len(keys))
    return at - at[starts][np.cumsum(starts) - 1]
