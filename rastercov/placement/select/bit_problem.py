"""Selection problem on covered pairs that are bits, and its presolve.

For more pairs than fit into the memory as lists: the same problem, the same equal candidates and
faces, the same order of candidates as `Problem` and `presolve`. An angle between views needs lists.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.typed import typed
from rastercov.coverage.area.cells import Cells
from rastercov.kernels import placement_presolve as kernels
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.bit_matrix import BitMatrix
from rastercov.placement.bits import CoveredBits, Words, packed, spread_out
from rastercov.placement.select.presolve import ReducedProblem, kinds_of, merged, ranked
from rastercov.placement.select.problem import AnyProblem, Goal, needs_of


@dataclass(frozen=True, eq=False, kw_only=True)
class BitProblem(AnyProblem):
    """Faces that each candidate covers, one bit each, and the goal of the selection.

    Attributes
    ----------
    bits : CoveredBits
    weights, views, costs, goal, groups, face_group, mean_coverage
        As in `AnyProblem`.
    """

    bits: CoveredBits

    def __post_init__(self) -> None:
        if self.bits.n_faces != self.n_faces:
            raise ConfigError(
                f"bits must be of {self.n_faces} faces, as the weights, got {self.bits.n_faces}"
            )
        super().__post_init__()

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return self.bits.n_candidates

    @cached_property
    def reachable(self) -> BoolArray:
        """(F,) faces that all candidates together cover."""
        found = np.zeros(self.n_faces, np.bool_)
        for views in np.unique(self.views):
            enough = self.bits.covered_by_more_than(int(views) - 1)
            found |= enough & (self.views == views)
        return found

    def faces_of(self, candidate: int) -> NDArray[np.int32]:
        """(N,) faces that a candidate covers, no face twice."""
        return self.bits.faces_of(candidate)


@typed
def bit_problem_of(
    matrix: BitMatrix,
    mesh: Mesh | Cells,
    goal: Goal,
    *,
    weight_by: str = "area",
    views: int | Mapping[str, int] | None = None,
    min_angle_deg: float | None = None,
    costs: ArrayLike | None = None,
    min_coverage: float | None = None,
) -> BitProblem:
    """Selection problem of a matrix of bits; parameters as for `problem_of`.

    Raises
    ------
    ConfigError
        As `problem_of`, and for an angle between views, or several views from rigs.
    """
    angle = matrix.task.min_angle_deg if min_angle_deg is None else min_angle_deg
    if angle != 0:
        raise ConfigError(
            f"min_angle_deg must be 0 on a matrix of bits, got {angle:g}; "
            "load a VisibilityMatrix for an angle between views"
        )
    wanted = matrix.task.views if views is None else views
    most = max([1, *wanted.values()]) if isinstance(wanted, Mapping) else wanted
    if "pairs" in matrix.header and most > 1:
        raise ConfigError(
            f"bits do not count the cameras of a rig, and views is {most}; load a VisibilityMatrix"
        )
    bits = matrix.bits if min_coverage is None else matrix.covered_at(min_coverage)
    needs = needs_of(matrix, mesh, weight_by, views, costs)[1]
    return BitProblem(bits=bits, goal=goal, **needs)


@dataclass(frozen=True, eq=False)
class LargeProblem:
    """A `BitProblem` after presolve, with C candidates; faces keep their numbers.

    Attributes
    ----------
    problem : BitProblem
    candidates : (C,) int64
        Their rows in the problem, ascending.
    costs, rank : (C,) float64, int64
    sizes : (C,) int64
        Upper limit of the number of remaining faces of each.
    kept : (K,) int64
        Remaining faces, the first one of each set of equal faces.
    integer_weights : (F,) int64
        With the sum of each set of equal faces at its first one; 0 for faces that do not remain.
    kind : (F,) int32
        Requirement that the face counts towards.
    least, least_total : (G,) int64, int
        Weight to cover of each kind, and in total.
    """

    problem: BitProblem
    candidates: IntArray
    costs: FloatArray
    rank: IntArray
    sizes: IntArray
    kept: IntArray
    integer_weights: IntArray
    kind: NDArray[np.int32]
    least: IntArray
    least_total: int

    @property
    def n_candidates(self) -> int:
        """Number of candidates C."""
        return len(self.candidates)

    @cached_property
    def masks(self) -> Words:
        """(G, W) remaining faces of each kind."""
        remains = np.zeros(self.problem.n_faces, np.bool_)
        remains[self.kept] = True
        kinds = range(len(self.least))
        return np.stack([packed(remains & (self.kind == kind)) for kind in kinds])

    def sums(self, values: IntArray, masks: Words, rows: IntArray | None = None) -> IntArray:
        """(N, V) sums over the faces of some candidates, or all; see `CoveredBits.sums`."""
        chosen = self.candidates if rows is None else self.candidates[rows]
        return self.problem.bits.sums(values, masks, chosen)

    def reduced(self, rows: IntArray) -> ReducedProblem:
        """The problem with some candidates only, (N,) ascending, in lists.

        Of all candidates it is that of `presolve`. All remaining faces are in it, also those that
        these candidates do not cover.
        """
        problem, kept = self.problem, self.kept
        column = np.full(problem.n_faces, -1, np.int32)
        column[kept] = np.arange(len(kept))
        mask = np.bitwise_or.reduce(self.masks, axis=0)
        candidates = self.candidates[rows]
        indptr, face = problem.bits.listed(candidates, mask, spread_out(column, np.int32))
        starts, covering = kernels.by_face(indptr, face, len(kept))
        views = problem.views[kept].astype(np.int32)
        return ReducedProblem(
            problem=problem,
            candidates=candidates,
            indptr=indptr,
            face=face,
            starts=starts,
            covering=covering,
            integer_weights=self.integer_weights[kept],
            views=views,
            need=views,
            kind=self.kind[kept],
            least=self.least,
            least_total=self.least_total,
            costs=self.costs[rows],
            rank=self.rank[rows],
            eyes=np.empty((0, 3)),
            centroids=np.empty((0, 3)),
            min_cosine=2.0,
        )


def presolve_bits(problem: BitProblem) -> LargeProblem:
    """The problem with equal candidates and equal faces merged, as by `presolve`.

    Two passes over the bits, after that of `BitProblem.reachable`.
    """
    bits, n_faces = problem.bits, problem.n_faces
    counted = problem.reachable & (problem.integer_weights > 0)
    kind, least, least_total = kinds_of(problem)
    keys = kernels.hashes_of(np.arange(n_faces, dtype=np.uint64)).view(np.int64).T
    values = spread_out(np.concatenate((keys, np.ones((1, n_faces), np.int64))))
    mask = packed(counted)
    found = bits.sums(values, np.stack([mask] * len(values)))
    hashes, sizes = np.ascontiguousarray(found[:, :2]).view(np.uint64), found[:, 2]
    copies = int(problem.views[counted].max(initial=1))
    rank = ranked(hashes, sizes, problem.costs, copies)
    candidates = np.flatnonzero(rank >= 0)

    kept, integer_weights = np.flatnonzero(counted), problem.integer_weights
    if len(kept):
        amounts = kernels.hashes_of(rank[candidates].astype(np.uint64)).view(np.int64)
        owners = bits.totals(amounts, candidates)[:, :n_faces].T
        hashes = np.ascontiguousarray(owners).view(np.uint64)
        kept, integer_weights = merged(problem, kept, kind, hashes)
    remaining: dict[str, Any] = {
        "candidates": candidates,
        "costs": problem.costs[candidates],
        "rank": rank[candidates],
        "sizes": sizes[candidates],
    }
    is_kept = np.zeros(n_faces, np.bool_)
    is_kept[kept] = True
    return LargeProblem(
        problem=problem,
        kept=kept,
        integer_weights=np.where(is_kept, integer_weights, 0),
        kind=kind,
        least=least,
        least_total=least_total,
        **remaining,
    )
