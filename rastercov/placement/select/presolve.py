"""Presolve: remove faces that cannot be covered, merge equal candidates and equal faces.

Of candidates that cover the same faces, the k cheapest remain where a face needs k views. Faces
that the same candidates cover become one face with their total weight. Where an angle between views
is required, faces are not merged, and candidates are equal only at the same position.

The remaining candidates are ranked by the faces they cover, not by their numbers, and the rank
breaks ties: shuffling the candidates of a problem does not change the result.
"""

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import placement_presolve as kernels
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.select.problem import AnyProblem, FewestCameras, Problem


class Candidates(Protocol):
    """Candidates after presolve, and the requirements: what all covers and bounds need.

    See `ReducedProblem`; a `LargeProblem` has its faces in another form.
    """

    @property
    def problem(self) -> AnyProblem:
        """Original problem."""

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""

    @property
    def costs(self) -> FloatArray:
        """(C,) cost of each."""

    @property
    def rank(self) -> IntArray:
        """(C,) order of the candidates."""

    @property
    def least(self) -> IntArray:
        """(G,) weight to cover of each kind."""

    @property
    def least_total(self) -> int:
        """Total weight to cover."""


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """A problem after presolve, with C candidates and F faces; each face can be covered.

    Attributes
    ----------
    problem : Problem or BitProblem
        Original problem.
    candidates : (C,) int64
        Their rows in the problem, ascending.
    indptr, face : (C + 1,) int64, (N,) int32
        Faces of each candidate.
    starts, covering : (F + 1,) int64, (N,) int32
        Candidates of each face.
    integer_weights : (F,) int64
        Integer weight of each face.
    views, need : (F,) int32
        Cameras that must cover the face; `need` has one step more where rays must differ.
    kind : (F,) int32
        Requirement that the face counts towards: 0 for the total only.
    least : (G,) int64
        Weight to cover of each kind; 0 for kind 0.
    least_total : int
        Total weight to cover.
    costs : (C,) float64
    rank : (C,) int64
        Order of the candidates, which depends only on the faces they cover.
    eyes, centroids : (K, 3), (F, 3) float64
        Empty where no angle is required.
    min_cosine : float
        2 where no angle is required.
    has_rigs : bool
        True where candidates have a face once for each of their cameras: `kernels.placement_rigs`.
        K is C otherwise.
    eye, covering_eye : (N,) int32
        Of rigs, row in `eyes` of the camera of each pair, in the order of `face` and of `covering`.
    """

    problem: AnyProblem
    candidates: IntArray
    indptr: IntArray
    face: NDArray[np.int32]
    starts: IntArray
    covering: NDArray[np.int32]
    integer_weights: IntArray
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
    has_rigs: bool = False
    eye: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    covering_eye: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return len(self.candidates)

    @property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.integer_weights)

    @property
    def is_spread(self) -> bool:
        """True where the rays to two cameras of a face must differ by an angle."""
        return self.min_cosine <= 1.0 + 1e-12

    @property
    def is_mandatory(self) -> BoolArray:
        """(F,) faces without which the requirements cannot be met."""
        whole = np.zeros(len(self.least), np.int64)
        np.add.at(whole, self.kind, self.integer_weights)
        wanted = (self.least >= whole) & (self.least > 0)
        needed: BoolArray = wanted[self.kind] | (self.least_total >= whole.sum() > 0)
        return needed


def presolve(problem: Problem) -> ReducedProblem:
    """Reduced problem with equal candidates and equal faces merged.

    Equivalent to the problem: the optima are equal, and a selection from the remaining candidates
    covers the same faces in both.
    """
    original, spread = problem, problem.min_angle > 0
    if problem.has_rigs and not spread:
        problem = _without_needless_pairs(problem)
    counted = problem.reachable & (problem.integer_weights > 0)
    kind, least, least_total = kinds_of(problem)
    hashes, sizes = kernels.hash_sets(
        problem.indptr, problem.face, counted, np.arange(problem.n_faces, dtype=np.uint64)
    )
    if spread and problem.has_rigs:
        hashes = _hashes_with_eyes(problem, counted)
    elif spread:  # candidates at different positions are different
        hashes = hashes + kernels.hash_sets(
            np.arange(0, 3 * problem.n_candidates + 1, 3),
            np.arange(3 * problem.n_candidates),
            np.ones(3 * problem.n_candidates, bool),
            (np.asarray(problem.eyes, np.float64) + 0.0).ravel().view(np.uint64),
        )[0] * np.uint64(3)
    copies = int(problem.views[counted].max(initial=1))
    rank_of = ranked(hashes, sizes, problem.costs, copies)
    candidates = np.flatnonzero(rank_of >= 0)

    kept, integer_weights = np.flatnonzero(counted), problem.integer_weights
    if not spread and len(kept):
        owners = kernels.hash_owners(problem.indptr, problem.face, rank_of, problem.n_faces)
        kept, integer_weights = merged(problem, kept, kind, owners)
    new_face = np.full(problem.n_faces, -1, np.int32)
    new_face[kept] = np.arange(len(kept))
    indptr, face = problem.indptr, problem.face
    if len(candidates) < problem.n_candidates or len(kept) < problem.n_faces:
        indptr, face = kernels.subset(indptr, face, candidates, new_face)
    starts, covering = kernels.by_face(indptr, face, len(kept))
    eye = covering_eye = np.zeros(0, np.int32)
    if problem.has_rigs and spread:
        eye = _eyes_of_pairs(problem, candidates, new_face)
        covering_eye = eye[np.argsort(face, kind="stable")]
    views = problem.views[kept].astype(np.int32)
    empty = np.empty((0, 3))
    eyes = empty if problem.eyes is None or not spread else problem.eyes
    return ReducedProblem(
        problem=original,
        candidates=candidates,
        indptr=indptr,
        face=face,
        starts=starts,
        covering=covering,
        integer_weights=integer_weights[kept],
        views=views,
        need=views + np.int32(spread),
        kind=kind[kept],
        least=least,
        least_total=least_total,
        costs=problem.costs[candidates],
        rank=rank_of[candidates],
        eyes=eyes if problem.has_rigs or not spread else eyes[candidates],
        centroids=empty if problem.centroids is None or not spread else problem.centroids[kept],
        min_cosine=problem.min_cosine,
        has_rigs=problem.has_rigs,
        eye=eye,
        covering_eye=covering_eye,
    )


def _without_needless_pairs(problem: Problem) -> Problem:
    """The problem without the pairs of a rig with a face beyond the views that this needs.

    Where any two rays will do they change nothing but bounds, which are tighter without them.
    """
    starts = np.ones(len(problem.face), np.bool_)
    starts[1:] = problem.face[1:] != problem.face[:-1]
    starts[problem.indptr[:-1][problem.indptr[:-1] < len(starts)]] = True
    at = np.arange(len(starts))
    place = at - at[starts][np.cumsum(starts) - 1] if len(starts) else at
    is_kept = place < problem.views[problem.face]
    ends = np.concatenate(([0], np.cumsum(is_kept)))[problem.indptr]
    return replace(problem, indptr=ends, face=problem.face[is_kept], eye=None)


def _hashes_with_eyes(problem: Problem, counted: BoolArray) -> NDArray[np.uint64]:
    """(C, 2) hashes of the faces of each candidate with the camera centres that they are seen from.

    Those of equal rigs in one place are equal.
    """
    assert problem.eye is not None
    assert problem.eyes is not None
    n = len(problem.eyes)
    of_eye = kernels.hash_sets(
        np.arange(0, 3 * n + 1, 3),
        np.arange(3 * n),
        np.ones(3 * n, bool),
        (np.asarray(problem.eyes, np.float64) + 0.0).ravel().view(np.uint64)
        + np.tile(np.arange(3, dtype=np.uint64), n),
    )[0][:, 0]
    keys = of_eye[problem.eye] * np.uint64(3) + problem.face.astype(np.uint64)
    found: NDArray[np.uint64] = kernels.hash_sets(
        problem.indptr, np.arange(len(problem.face)), counted[problem.face], keys
    )[0]
    return found


def _eyes_of_pairs(
    problem: Problem, candidates: IntArray, new_face: NDArray[np.int32]
) -> NDArray[np.int32]:
    """Row in the eyes of the camera of each pair that remains, in the order of `subset`."""
    assert problem.eye is not None
    is_in = np.zeros(problem.n_candidates, np.bool_)
    is_in[candidates] = True
    kept = np.repeat(is_in, np.diff(problem.indptr)) & (new_face[problem.face] >= 0)
    found: NDArray[np.int32] = problem.eye[kept]
    return found


def kinds_of(problem: AnyProblem) -> tuple[NDArray[np.int32], IntArray, int]:
    """(F,) kind of each face, (G,) weight to cover of each kind, and the total to cover."""
    _, least, total = problem.required
    named = np.flatnonzero(least > 0)
    kind_of_group = np.zeros(len(problem.groups), np.int32)
    if isinstance(problem.goal, FewestCameras):
        kind_of_group[named] = 1 + np.arange(len(named))
    kind: NDArray[np.int32] = kind_of_group[problem.face_group]
    return kind, np.concatenate(([0], least[named])), total


def ranked(hashes: NDArray[np.uint64], sizes: IntArray, costs: FloatArray, copies: int) -> IntArray:
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


def merged(
    problem: AnyProblem, kept: IntArray, kind: NDArray[np.int32], hashes: NDArray[np.uint64]
) -> tuple[IntArray, IntArray]:
    """First face of each set of equal ones, and (F,) weights with the sum of each set there.

    Parameters
    ----------
    kept : (K,) int64
        Faces that count.
    kind : (F,) int32
    hashes : (F, 2) uint64
        Of the candidates that cover each face.
    """
    rows = kept[
        np.lexsort((kept, problem.views[kept], kind[kept], hashes[kept, 1], hashes[kept, 0]))
    ]
    keys = np.column_stack(
        (hashes[rows], kind[rows].astype(np.uint64), problem.views[rows].astype(np.uint64))
    )
    is_first = _place_in_run(keys) == 0
    integer_weights = np.zeros(problem.n_faces, np.int64)
    first = rows[is_first]
    integer_weights[first] = np.add.reduceat(
        problem.integer_weights[rows], np.flatnonzero(is_first)
    )
    return np.sort(first), integer_weights


def _place_in_run(keys: NDArray[np.uint64]) -> IntArray:
    """(N,) number of equal rows directly before each row."""
    if not len(keys):
        return np.zeros(0, np.int64)
    starts = np.concatenate(([True], (keys[1:] != keys[:-1]).any(axis=1)))
    at = np.arange(len(keys))
    place: IntArray = at - at[starts][np.cumsum(starts) - 1]
    return place
