"""Selection problem of any form: needs and weights of faces, costs of candidates, and the goal.

The faces that each candidate covers are in the classes derived from `AnyProblem`: lists of pairs
(`problem`), or bits (`bit_problem`).
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import ConfigError
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.select.goals import BestCoverage, Goal

TOTAL_WEIGHT = 1 << 40
"""Total of `Problem.integer_weights`, unless the weights are integers with a smaller sum."""
SHARE_TOLERANCE = 1e-9
"""Absolute tolerance of a required share: 0.98 is not a binary fraction."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AnyProblem(ABC):
    """Needs of each face, costs of the candidates, and the goal of a selection.

    A face is covered when at least `views` of the chosen cameras cover it. The faces that each
    candidate covers are in the classes derived from this one.

    Attributes
    ----------
    weights : (F,) float64
        Weight of each face; 0 leaves it out.
    views : (F,) int64
        Cameras that must cover the face, 1 or more.
    costs : (C,) float64
        Cost of each candidate, 0 or more.
    goal : FewestCameras or BestCoverage
    groups : tuple of str
    face_group : (F,) int32
        Index into `groups`.
    mean_coverage : (C,) float64
        Mean coverage over all faces, for `rastercov.reference.thesis`.
    """

    weights: FloatArray
    views: IntArray
    costs: FloatArray
    goal: Goal
    groups: tuple[str, ...]
    face_group: NDArray[np.int32]
    mean_coverage: FloatArray

    def __post_init__(self) -> None:
        _check(self)
        goal = self.goal
        if isinstance(goal, BestCoverage):
            return
        if unknown := sorted(set(goal.groups) - set(self.groups)):
            raise ConfigError(
                f"there is no group {unknown[0]!r}; groups are {', '.join(self.groups)}"
            )
        _, least, total = self.required
        reached = self.by_group(self.reachable)
        if reached.sum() < total:
            raise ConfigError(
                f"coverage {goal.coverage:g} cannot be reached: all {self.n_candidates} candidates "
                f"together cover {self.share(self.reachable):.6g}; ask for less, of_reachable, or "
                "add candidates"
            )
        if short := [name for name, a, b in zip(self.groups, reached, least, strict=True) if a < b]:
            raise ConfigError(
                f"group {short[0]!r}: coverage {goal.groups[short[0]]:g} cannot be reached by all "
                f"{self.n_candidates} candidates together; ask for less, or add candidates"
            )

    @property
    @abstractmethod
    def n_candidates(self) -> int:
        """Number of candidates C."""

    @property
    def has_rigs(self) -> bool:
        """True where candidates have a face once for each of their cameras."""
        return False

    @property
    def n_faces(self) -> int:
        """Number of faces F."""
        return len(self.weights)

    @cached_property
    def integer_weights(self) -> IntArray:
        """(F,) weights as integers: their own values, or parts of `TOTAL_WEIGHT`."""
        return in_whole_numbers(self.weights)

    @cached_property
    def reachable(self) -> BoolArray:
        """(F,) faces that all candidates together cover."""
        return self.covered_by(np.arange(self.n_candidates))[1]

    @cached_property
    def required(self) -> tuple[IntArray, IntArray, int]:
        """Integer weight of each group, (G,), required weight of each group, (G,), and in total.

        The required weights are 0 for `BestCoverage`.
        """
        goal = self.goal
        nothing = np.zeros(len(self.groups), np.int64)
        if isinstance(goal, BestCoverage):
            return self.by_group(np.ones(self.n_faces, bool)), nothing, 0
        counted = self.reachable if goal.of_reachable else np.ones(self.n_faces, bool)
        whole = self.by_group(counted)
        shares = np.array([goal.groups.get(name, 0.0) for name in self.groups])
        least = np.ceil((shares - SHARE_TOLERANCE).clip(0) * whole).astype(np.int64)
        return whole, least, math.ceil(max(0.0, goal.coverage - SHARE_TOLERANCE) * int(whole.sum()))

    def by_group(self, faces: BoolArray) -> IntArray:
        """(G,) integer weight of the given faces of each group."""
        totals = np.zeros(len(self.groups), np.int64)
        np.add.at(totals, self.face_group[faces], self.integer_weights[faces])
        return totals

    def share(self, faces: BoolArray) -> float:
        """Share of the total weight, [0, 1]; 1 where there is no weight."""
        total = int(self.integer_weights.sum())
        return int(self.integer_weights[faces].sum()) / total if total else 1.0

    @abstractmethod
    def faces_of(self, candidate: int) -> NDArray[np.int32]:
        """(N,) faces that a candidate covers, no face twice."""

    def covered_by(self, chosen: ArrayLike) -> tuple[IntArray, BoolArray]:
        """(F,) number of chosen cameras that cover each face, and (F,) faces that are covered."""
        views = np.zeros(self.n_faces, np.int64)
        for camera in np.asarray(chosen, np.int64):  # microseconds each
            if self.has_rigs:
                np.add.at(views, self.faces_of(camera), 1)
            else:
                views[self.faces_of(camera)] += 1
        return views, views >= self.views

    def is_met(self, covered: BoolArray) -> bool:
        """True where these faces meet the requirements of `FewestCameras`."""
        _, least, total = self.required
        reached = self.by_group(covered)
        return bool((reached >= least).all() and reached.sum() >= total)


def in_whole_numbers(weights: FloatArray) -> IntArray:
    """(F,) weights as integers: their own values, or parts of `TOTAL_WEIGHT`."""
    total = float(weights.sum())
    if total < TOTAL_WEIGHT and bool((weights == np.floor(weights)).all()):
        return weights.astype(np.int64)
    return np.rint(weights / total * TOTAL_WEIGHT).astype(np.int64)


def _check(problem: AnyProblem) -> None:
    """Raise ConfigError when the arrays of a problem are inconsistent."""
    n_candidates, n_faces = problem.n_candidates, problem.n_faces
    check_shapes(
        views=(problem.views, (n_faces,)),
        costs=(problem.costs, (n_candidates,)),
        face_group=(problem.face_group, (n_faces,)),
        mean_coverage=(problem.mean_coverage, (n_candidates,)),
    )
    for name, values in (("weights", problem.weights), ("costs", problem.costs)):
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ConfigError(f"{name} must be 0 or more, and finite")
    if (problem.views < 1).any():
        raise ConfigError(f"views must be 1 or more, got {problem.views.min()}")
    within = (problem.face_group >= 0) & (problem.face_group < len(problem.groups))
    if not within.all() or len(set(problem.groups)) < len(problem.groups):
        raise ConfigError("face_group must index into groups, whose names must be unique")


def check_shapes(**shapes: tuple[Any, tuple[int, ...]]) -> None:
    """Raise ConfigError for an array, by its name, that has not the shape beside it."""
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            raise ConfigError(f"{name} must have shape {shape}, got {array.shape}")
