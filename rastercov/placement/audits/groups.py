"""Figures of groups of poses: the frames of a rig, and the poses of each camera.

A frame has the images that the cameras of a rig took at the same instant; in it each camera is a
view of its own. So the smallest subset of frames is a selection of rigs (`Problem.starts`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.problem import Problem
from rastercov.placement.select.selection import Selection

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Groups:
    """Figures of G groups of poses.

    Attributes
    ----------
    names : tuple of str
    of_pose : (P,) int64
        Group of each pose.
    seen_m2, lost_m2, alone_m2 : (G,) float64
        Area that any pose of the group covers, that is covered no more without the group, and that
        no other group covers.
    subset : Selection or None
        Fewest groups found that cover the same as all, with a bound; None where it was not asked.
    """

    names: tuple[str, ...]
    of_pose: IntArray
    seen_m2: FloatArray
    lost_m2: FloatArray
    alone_m2: FloatArray
    subset: Selection | None = None

    def entries(self, what: str) -> list[dict[str, Any]]:
        """Figures of each group, with its name as entry `what`, ready for JSON."""
        counts = np.bincount(self.of_pose, minlength=len(self.names))
        return [
            {
                what: self.names[row],
                "poses": int(counts[row]),
                "seen_m2": float(self.seen_m2[row]),
                "lost_m2": float(self.lost_m2[row]),
                "alone_m2": float(self.alone_m2[row]),
            }
            for row in range(len(self.names))
        ]


def groups_of(
    problem: Problem, covered: BoolArray, label: Sequence[str], *, has_subset: bool = False
) -> Groups:
    """Groups of the poses of a problem with equal labels, in the order in which they come.

    Parameters
    ----------
    problem : Problem
        Elements that each of P poses covers.
    covered : (E,) bool
        Elements that all poses together cover.
    label : (P,) sequence of str
    has_subset : bool
        True where the smallest subset of groups is wanted.
    """
    names = tuple(dict.fromkeys(label))
    index = {name: row for row, name in enumerate(names)}
    of_pose = np.array([index[name] for name in label], np.int64)
    indptr, face = problem.bits.pairs()
    # A pair of group and element, and the poses of the group that cover it.
    key = np.repeat(of_pose, np.diff(indptr)) * problem.n_faces + face
    pairs, times = np.unique(key, return_counts=True)
    group, element = np.divmod(pairs, max(1, problem.n_faces))
    weights = problem.weights[element]
    views = np.bincount(face, minlength=problem.n_faces)

    def total(chosen: BoolArray) -> FloatArray:
        found: FloatArray = np.bincount(group[chosen], weights[chosen], len(names)).astype(float)
        return found

    if problem.min_angle > 0:
        lost = _lost_one_by_one(problem, covered, of_pose, len(names))
    else:
        lost = total(covered[element] & (views[element] - times < problem.views[element]))
    subset = select_greedy(_choice(problem, of_pose, len(names))) if has_subset else None
    return Groups(
        names=names,
        of_pose=of_pose,
        seen_m2=total(np.ones(len(pairs), np.bool_)),
        lost_m2=lost,
        alone_m2=total(times == views[element]),
        subset=subset,
    )


def _lost_one_by_one(
    problem: Problem, covered: BoolArray, of_pose: IntArray, n_groups: int
) -> FloatArray:
    """Weight that is covered no more without each group, where directions matter, (G,)."""
    lost = np.zeros(n_groups)
    for group in range(n_groups):  # as much work as all pairs, each
        without = problem.covered_by(np.flatnonzero(of_pose != group))[1]
        lost[group] = problem.weights[covered & ~without].sum()
    return lost


def _choice(problem: Problem, of_pose: IntArray, n_groups: int) -> Problem:
    """The problem with groups as candidates, whose poses are views of their own; each costs 1."""
    order, counts = np.argsort(of_pose, kind="stable"), np.bincount(of_pose, minlength=n_groups)
    assert problem.eyes is not None
    return replace(
        problem,
        bits=problem.bits.take(order),
        starts=np.concatenate(([0], np.cumsum(counts))),
        eyes=problem.eyes[order],
        costs=np.ones(n_groups),
        mean_coverage=np.zeros(n_groups),
    )
