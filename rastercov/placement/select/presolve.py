"""A problem without what makes no difference: faces that cannot be covered, equal candidates.

Candidates that cover the same faces are merged: where a face needs k views, the k cheapest of them
stay. Faces that the same candidates cover are merged into one with the weight of all. Where an
angle between views is asked for, rays matter, so faces stay apart and only candidates at the same
place are equal.

What is left is ranked by what the candidates cover, not by their numbers, and the rank breaks
ties: shuffling the candidates of a problem changes no answer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.select import presolve_kernels as kernels
from rastercov.placement.select.problem import FewestCameras, Problem

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Merged:
    """A problem with C candidates and F faces left; each face can be covered.

    Attributes
    ----------
    problem : Problem
        Where it came from.
    candidates : (C,) int64
        Their rows in the problem, ascending.
    indptr, face : (C + 1,) int64, (N,) int32
        Faces of each candidate.
    starts, covering : (F + 1,) int64, (N,) int32
        Candidates of each face.
    quanta : (F,) int64
        Weight in whole numbers.
    views, need : (F,) int32
        Cameras that must cover the face; one more step where rays must differ.
    kind : (F,) int32
        Which requirement it counts towards: 0 for none but the total.
    least : (G,) int64
        Weight to cover of each kind; 0 for kind 0.
    least_total : int
        Weight to cover in all.
    costs : (C,) float64
    rank : (C,) int64
        Order of the candidates that depends on what they cover only.
    eyes, centroids : (C, 3), (F, 3) float64
        Empty where no angle is asked for.
    min_cosine : float
        2 where no angle is asked for.
    """

    problem: Problem
    candidates: IntArray
    indptr: IntArray
    face: NDArray[np.int32]
    starts: IntArray
    covering: NDArray[np.int32]
    quanta: IntArray
    views: NDArray[np.int32]
    need: NDArray[np.int32]
    kind: NDArray[np.int32]
    least: IntArray
    least_total: int
    costs: FloatArray
    rank: IntArray
    eyes: FloatArray
    centroids: FloatArray
    min_cosine: float

    @property
    def n_candidates(self) -> int:
        """Candidates that are left."""
        return len(self.candidates)

    @property
    def n_faces(self) -> int:
        """Faces that are left."""
        return len(self.quanta)

    @property
    def is_spread(self) -> bool:
        """Whether rays to two cameras of a face must differ by an angle."""
        return self.min_cosine <= 1.0 + 1e-12

    @property
    def is_mandatory(self) -> BoolArray:
        """(F,) faces without which the requirements cannot be met."""
        whole = np.zeros(len(self.least), np.int64)
        np.add.at(whole, self.kind, self.quanta)
        wanted = (self.least >= whole) & (self.least > 0)
        needed: BoolArray = wanted[self.kind] | (self.least_total >= whole.sum() > 0)
        return needed


def merge(problem: Problem) -> Merged:
    """The problem with equal candidates and equal faces merged.

    Gives the same answers as the problem: the best selection of one is as good as that of the
    other, and any selection from what is left covers the same faces in both.
    """
    spread = problem.min_angle > 0
    counted = problem.reachable & (problem.quanta > 0)
    kind, least, least_total = _kinds(problem)
    hashes, sizes = kernels.hash_sets(
        problem.indptr, problem.face, counted, np.arange(problem.n_faces, dtype=np.uint64)
    )
    if spread:  # where a camera stands is part of what it is
        hashes = hashes + kernels.hash_sets(
            np.arange(0, 3 * problem.n_candidates + 1, 3),
            np.arange(3 * problem.n_candidates),
            np.ones(3 * problem.n_candidates, bool),
            (np.asarray(problem.eyes, np.float64) + 0.0).ravel().view(np.uint64),
        )[0] * np.uint64(3)
    copies = int(problem.views[counted].max(initial=1))
    order = np.lexsort((np.arange(len(sizes)), problem.costs, hashes[:, 1], hashes[:, 0]))
    order = order[sizes[order] > 0]
    order = order[_place_in_run(hashes[order]) < copies]
    rank_of = np.full(problem.n_candidates, -1, np.int64)
    rank_of[order] = np.arange(len(order))
    candidates = np.sort(order)

    kept, quanta = np.flatnonzero(counted), problem.quanta
    if not spread and len(kept):
        kept, quanta = _merge_faces(problem, kept, kind, rank_of)
    new_face = np.full(problem.n_faces, -1, np.int32)
    new_face[kept] = np.arange(len(kept))
    indptr, face = problem.indptr, problem.face
    if len(candidates) < problem.n_candidates or len(kept) < problem.n_faces:
        indptr, face = kernels.subset(indptr, face, candidates, new_face)
    starts, covering = kernels.by_face(indptr, face, len(kept))
    views = problem.views[kept].astype(np.int32)
    empty = np.empty((0, 3))
    return Merged(
        problem=problem,
        candidates=candidates,
        indptr=indptr,
        face=face,
        starts=starts,
        covering=covering,
        quanta=quanta[kept],
        views=views,
        need=views + np.int32(spread),
        kind=kind[kept],
        least=least,
        least_total=least_total,
        costs=problem.costs[candidates],
        rank=rank_of[candidates],
        eyes=empty if problem.eyes is None or not spread else problem.eyes[candidates],
        centroids=empty if problem.centroids is None or not spread else problem.centroids[kept],
        min_cosine=problem.min_cosine,
    )


def _kinds(problem: Problem) -> tuple[NDArray[np.int32], IntArray, int]:
    """(F,) kind of each face, (G,) weight to cover of each kind, and in all."""
    _, least, total = problem.required
    named = np.flatnonzero(least > 0)
    kind_of_group = np.zeros(len(problem.groups), np.int32)
    if isinstance(problem.goal, FewestCameras):
        kind_of_group[named] = 1 + np.arange(len(named))
    kind: NDArray[np.int32] = kind_of_group[problem.face_group]
    return kind, np.concatenate(([0], least[named])), total


def _merge_faces(
    problem: Problem, kept: IntArray, kind: NDArray[np.int32], rank_of: IntArray
) -> tuple[IntArray, IntArray]:
    """The first face of each set of equal ones, and (F,) weights in which it stands for all."""
    hashes = kernels.hash_owners(problem.indptr, problem.face, rank_of, problem.n_faces)
    rows = kept[
        np.lexsort((kept, problem.views[kept], kind[kept], hashes[kept, 1], hashes[kept, 0]))
    ]
    keys = np.column_stack(
        (hashes[rows], kind[rows].astype(np.uint64), problem.views[rows].astype(np.uint64))
    )
    is_first = _place_in_run(keys) == 0
    quanta = np.zeros(problem.n_faces, np.int64)
    first = rows[is_first]
    quanta[first] = np.add.reduceat(problem.quanta[rows], np.flatnonzero(is_first))
    return np.sort(first), quanta


def _place_in_run(keys: NDArray[np.uint64]) -> IntArray:
    """(N,) how many rows just before each are equal to it."""
    if not len(keys):
        return np.zeros(0, np.int64)
    starts = np.concatenate(([True], (keys[1:] != keys[:-1]).any(axis=1)))
    at = np.arange(len(keys))
    place: IntArray = at - at[starts][np.cumsum(starts) - 1]
    return place
