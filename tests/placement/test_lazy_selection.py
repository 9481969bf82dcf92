"""Selection whose lists do not fit into the memory: the same rule as with lists, true bounds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from selection_cases import best_by_trying_all, covers_faces, dense_of, problems

from rastercov.placement.bits import CoveredBits
from rastercov.placement.select import bounds
from rastercov.placement.select.cover import LazyCover
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.presolve import kinds_of, presolve
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of_matrix

QUICK = 200_000
"""Effort of the local search in tests."""
LARGER = {"angles": (0,), "max_views": 3, "sizes": (1, 7, 30, 60), "faces": (1, 9, 70, 200)}
"""Problems of several words a row."""
SMALL_CORE = 1
"""Pairs of a core with nothing but the chosen cameras and a cover of each face."""


def in_parts(problem, n_parts):
    """The same problem with its bits in several parts."""
    parts = [CoveredBits.from_dense(part) for part in np.array_split(dense_of(problem), n_parts)]
    bits = parts[0]
    for part in parts[1:]:
        bits = bits.joined(part)
    return replace(problem, bits=bits)


@pytest.mark.slow
@examples(30)
@given(problems(**LARGER), st.integers(1, 3))
def test_the_lazy_rule_takes_the_cameras_of_the_plain_rule(problem, n_parts):
    plain = select_greedy(problem, effort=0)
    lazy = select_greedy(in_parts(problem, n_parts), effort=0, core_pairs=SMALL_CORE)
    np.testing.assert_array_equal(lazy.chosen, plain.chosen)
    np.testing.assert_array_equal(lazy.curve, plain.curve)
    np.testing.assert_array_equal(lazy.covered, plain.covered)
    assert (lazy.share, lazy.cost) == (plain.share, plain.cost)


@examples(25)
@given(problems(**LARGER), st.integers(2, 3))
def test_parts_of_the_bits_change_nothing(problem, n_parts):
    first = select_greedy(problem, effort=QUICK)
    other = select_greedy(in_parts(problem, n_parts), effort=QUICK)
    np.testing.assert_array_equal(first.chosen, other.chosen)
    assert (first.bound, first.status) == (other.bound, other.status)


@examples(25)
@given(problems(**LARGER))
def test_lists_have_the_pairs_of_the_dense_array(problem):
    large = presolve(problem)
    found, dense = large.listed(), dense_of(problem)[large.candidates][:, large.kept]
    wanted = np.nonzero(dense)
    row = np.repeat(np.arange(found.n_candidates), np.diff(found.indptr))
    np.testing.assert_array_equal((row, found.face), wanted)
    column = np.repeat(np.arange(found.n_faces), np.diff(found.starts))
    np.testing.assert_array_equal((column, found.covering), np.nonzero(dense.T))
    assert (large.sizes >= np.diff(found.indptr)).all()


@pytest.mark.slow
@examples(25)
@given(problems(angles=(0,), max_views=3))
def test_no_selection_is_better_than_a_bound_from_a_small_core(problem):
    best = best_by_trying_all(problem)
    found = select_greedy(problem, effort=QUICK, core_pairs=SMALL_CORE)
    covered = covers_faces(problem, found.chosen)
    np.testing.assert_array_equal(found.covered, covered)
    if isinstance(problem.goal, FewestCameras):
        assert found.bound <= best + 1e-6
        assert best <= found.objective + 1e-6
    else:
        assert found.bound >= best - 1e-6
        assert best >= found.objective - 1e-6


def value_of(problem, price):
    """Bound that prices of the faces prove: the relaxation solved face by face, from dense rows."""
    dense = dense_of(problem).astype(float)
    reduced = presolve(problem)
    covers = dense[reduced.candidates]
    earned, needed = covers @ price, problem.views * price
    counted = problem.reachable & (problem.integer_weights > 0)
    goal, costs, weights = problem.goal, reduced.costs, problem.integer_weights.astype(float)
    if isinstance(goal, BestCoverage):
        n = len(costs) if goal.cameras is None else min(goal.cameras, len(costs))
        incomes = [np.sort(earned)[::-1][:n].sum()]
        if goal.budget is not None:
            left, income = goal.budget * (1 + 1e-9), 0.0
            for row in np.argsort(-earned / np.maximum(costs, 1e-300), kind="stable"):
                part = min(1.0, left / costs[row]) if costs[row] > 0 else 1.0
                left, income = left - part * costs[row], income + part * earned[row]
            incomes.append(income)
        share = weights / weights[counted].sum()
        return min(incomes) + np.maximum(share - needed, 0)[counted].sum()
    kind, least, left = kinds_of(problem)
    taken = np.zeros(len(price))
    each = np.argsort(np.where(counted, needed / np.maximum(weights, 1), np.inf), kind="stable")
    each = each[counted[each]]
    for kind_of in (*range(1, len(least)), None):
        amount = max(left, 0) if kind_of is None else least[kind_of]
        for face in each:
            if kind_of is None or kind[face] == kind_of:
                part = min(weights[face] * (1 - taken[face]), amount)
                taken[face] += part / weights[face]
                amount -= part
                left -= part
    return np.minimum(costs - earned, 0).sum() + (needed * taken).sum()


@pytest.mark.slow
@examples(25)
@given(problems(**LARGER), st.integers(0, 2**32 - 1))
def test_a_price_proves_what_the_relaxation_says(problem, seed):
    large = presolve(problem)
    cameras = getattr(problem.goal, "cameras", 1)
    if not len(large.kept) or cameras == 0 or problem.views[large.kept].max() > large.n_candidates:
        return
    rng, price = np.random.default_rng(seed), np.zeros(problem.n_faces)
    price[large.kept] = rng.random(len(large.kept)) * rng.choice([1e-3, 1.0, 30.0])
    # Of equal faces only the first remains, with the weight of all.
    merged = replace(problem, weights=large.integer_weights.astype(float))
    found = bounds._priced(large, price[large.kept])
    assert found.value == pytest.approx(value_of(merged, price), rel=1e-9, abs=1e-9)
    other = bounds._priced(large, rng.permutation(price[large.kept]))
    between = bounds._between(large, other, found)
    sign = -1 if isinstance(problem.goal, BestCoverage) else 1
    ends = (other.price, found.price), (other.earned, found.earned)
    on_the_way = [
        sign * bounds._value(large, *((1 - part) * one + part * other for one, other in ends))
        for part in np.linspace(0, 1, 101)
    ]
    assert sign * between.value >= max(on_the_way) - 0.05 * np.ptp(on_the_way) - 1e-9
    again = np.zeros(problem.n_faces)
    again[large.kept] = between.price
    assert between.value == pytest.approx(value_of(merged, again), rel=1e-9, abs=1e-9)


def test_the_chosen_cameras_are_in_any_core():
    #   0 covers what 1 and 2 together cover of it, and comes first by the greedy rule
    covers = np.zeros((3, 10), bool)
    covers[0, :6], covers[1, [0, 1, 2, 6, 7]], covers[2, [3, 4, 5, 8, 9]] = True, True, True
    large = presolve(problem_of_matrix(covers, BestCoverage(3)))
    state = LazyCover(large)
    state.become([0, 1, 2])
    assert bounds.core_rows(large, state, np.array([0.0, 2.0, 1.0]), 1).tolist() == [0, 1, 2]
    state.become([1])
    assert bounds.core_rows(large, state, np.array([0.0, 2.0, 1.0]), 1).tolist() == [1, 2]


def caps(n_candidates, n_faces, seed=0):
    """Candidates that cover parts of caps of a sphere, 8 % of its faces each."""
    rng = np.random.default_rng(seed)
    face, axis = rng.normal(size=(n_faces, 3)), rng.normal(size=(n_candidates, 3))
    face, axis = (each / np.linalg.norm(each, axis=1)[:, None] for each in (face, axis))
    # Neighbours on the sphere are neighbours in number, about as in a mesh.
    face = face[np.lexsort((face[:, 0], np.floor(8 * face[:, 1]), np.floor(8 * face[:, 2])))]
    cosine = axis @ face.T
    phase = rng.uniform(0, 6, (n_candidates, 1))
    return (cosine > rng.uniform(0.7, 0.9, (n_candidates, 1))) & (
        np.sin(20 * cosine + phase) > -0.8
    )


@pytest.mark.slow
def test_a_camera_reads_a_part_of_the_candidates():
    problem = problem_of_matrix(caps(1500, 4000), BestCoverage(10))
    large = presolve(problem)
    lazy = LazyCover(large)
    assert lazy.passes == 1
    while len(lazy.chosen) < 10 and (camera := lazy.next_best()) >= 0:
        lazy.add(camera)
    assert len(lazy.chosen) == 10
    assert lazy.passes <= 2.3  # 1 for the first gains, a tenth for a camera
