"""Selection on bits against selection on lists: the same rule, the same presolve, true bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from selection_cases import best_by_trying_all, covers_faces, dense_of, problems

from rastercov.errors import ConfigError
from rastercov.placement.bits import CoveredBits
from rastercov.placement.select import pricing
from rastercov.placement.select.bit_problem import BitProblem, presolve_bits
from rastercov.placement.select.cover_state import CoverState
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.lazy import select_lazy
from rastercov.placement.select.lazy_cover import LazyCover
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of_matrix

QUICK = 200_000
"""Effort of the local search in tests."""
LARGER = {"angles": (0,), "max_views": 3, "sizes": (1, 7, 30, 60), "faces": (1, 9, 70, 200)}
"""Problems of several words a row."""
SMALL_CORE = 1
"""Pairs of a core with nothing but the chosen cameras and a cover of each face."""
REDUCED = (
    "candidates", "indptr", "face", "starts", "covering", "integer_weights", "views", "need",
    "kind", "least", "least_total", "costs", "rank",
)  # fmt: skip


def on_bits(problem, n_parts=1):
    """The same problem on bits, in one part or in several."""
    dense, bits = dense_of(problem), None
    for part in np.array_split(dense, n_parts):
        some = CoveredBits.from_dense(part)
        bits = some if bits is None else bits.joined(some)
    names = ("weights", "views", "costs", "goal", "groups", "face_group", "mean_coverage")
    return BitProblem(bits=bits, **{name: getattr(problem, name) for name in names})


@examples(30)
@given(problems(**LARGER), st.integers(1, 3))
def test_the_lazy_rule_takes_the_cameras_of_the_plain_rule(problem, n_parts):
    plain = select_greedy(problem, effort=0)
    for core_pairs in (pricing.MOST_CORE_PAIRS, SMALL_CORE):
        lazy = select_lazy(on_bits(problem, n_parts), effort=0, core_pairs=core_pairs)
        np.testing.assert_array_equal(lazy.chosen, plain.chosen)
        np.testing.assert_array_equal(lazy.curve, plain.curve)
        np.testing.assert_array_equal(lazy.covered, plain.covered)
        assert (lazy.share, lazy.cost) == (plain.share, plain.cost)
        if core_pairs > SMALL_CORE:
            assert (lazy.bound, lazy.status) == (plain.bound, plain.status)


@examples(25)
@given(problems(**LARGER))
def test_where_all_candidates_fit_the_selection_is_that_of_lists(problem):
    first, other = select_greedy(problem, effort=QUICK), select_lazy(on_bits(problem), effort=QUICK)
    np.testing.assert_array_equal(first.chosen, other.chosen)
    assert (first.bound, first.status) == (other.bound, other.status)


@examples(25)
@given(problems(**LARGER))
def test_presolve_of_bits_is_that_of_lists(problem):
    large = presolve_bits(on_bits(problem))
    found, wanted = large.reduced(np.arange(large.n_candidates)), presolve(problem)
    for name in REDUCED:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    np.testing.assert_array_equal(on_bits(problem).reachable, problem.reachable)
    assert (large.sizes >= np.diff(wanted.indptr)).all()


@examples(25)
@given(problems(angles=(0,), max_views=3))
def test_no_selection_is_better_than_a_bound_from_a_small_core(problem):
    best = best_by_trying_all(problem)
    found = select_lazy(on_bits(problem), effort=QUICK, core_pairs=SMALL_CORE)
    covered = covers_faces(problem, found.chosen)
    np.testing.assert_array_equal(found.covered, covered)
    if isinstance(problem.goal, FewestCameras):
        assert found.bound <= best + 1e-6
        assert best <= found.objective + 1e-6
    else:
        assert found.bound >= best - 1e-6
        assert best >= found.objective - 1e-6


@examples(25)
@given(
    problems(**LARGER),
    st.lists(st.tuples(st.integers(0, 59), st.booleans()), max_size=12),
)
def test_cameras_that_come_and_go_leave_the_gains_of_lists(problem, steps):
    reduced, large = presolve(problem), presolve_bits(on_bits(problem))
    state, lazy = CoverState(reduced), LazyCover(large)
    for camera, is_asked in steps:  # named twice, a camera comes and goes
        if camera < reduced.n_candidates:
            for cover in (state, lazy):
                (cover.remove if camera in cover.chosen else cover.add)(camera)
        if is_asked:
            assert lazy.next_best() == state.next_best()
            assert lazy.next_best(1.5, by_cost=True) == state.next_best(1.5, by_cost=True)
            assert lazy.next_needed() == state.next_needed()
        assert (lazy.covered, lazy.cost, lazy.is_met) == (state.covered, state.cost, state.is_met)
        assert (lazy.limit.sum(axis=1) >= state.gain.sum(axis=1)).all()
        every = np.arange(large.n_candidates)
        np.testing.assert_array_equal(lazy._gains(every), state.gain)


def caps(n_candidates, n_faces, seed=0):
    """Candidates that cover parts of caps of a sphere, 8 % of its faces each."""
    rng = np.random.default_rng(seed)
    face, axis = rng.normal(size=(n_faces, 3)), rng.normal(size=(n_candidates, 3))
    face, axis = (each / np.linalg.norm(each, axis=1)[:, None] for each in (face, axis))
    cosine = axis @ face.T
    phase = rng.uniform(0, 6, (n_candidates, 1))
    return (cosine > rng.uniform(0.7, 0.9, (n_candidates, 1))) & (
        np.sin(20 * cosine + phase) > -0.8
    )


@pytest.mark.parametrize(
    ("goal", "views"),
    [
        (BestCoverage(8), 1),
        (BestCoverage(12), 2),
        (BestCoverage(budget=6.0), 1),
        (FewestCameras(0.95), 1),
        (FewestCameras(1.0, of_reachable=True), 2),
    ],
)
def test_a_core_of_a_tenth_bounds_all_candidates_about_as_well(goal, views):
    covers = caps(1500, 300)
    rng = np.random.default_rng(2)
    costs = rng.uniform(0.5, 2, len(covers)) if getattr(goal, "budget", None) else None
    problem = problem_of_matrix(covers, goal, views=views, weights=rng.random(300), costs=costs)
    core_pairs = int(covers.sum()) // 10
    plain = select_greedy(problem, effort=QUICK)
    found = select_lazy(on_bits(problem), effort=QUICK, core_pairs=core_pairs)
    if isinstance(goal, BestCoverage):
        assert plain.objective - 1e-9 <= plain.bound
        assert max(found.objective, plain.objective) <= found.bound + 1e-9
        assert found.bound <= plain.bound + 0.02
        assert found.objective >= plain.objective - 0.02
    else:
        assert found.bound <= min(found.objective, plain.objective) + 1e-9
        assert found.bound >= plain.bound - 1
        assert found.objective <= plain.objective + 1


def test_a_camera_reads_a_part_of_the_candidates():
    problem = problem_of_matrix(caps(4000, 500), BestCoverage(10))
    large = presolve_bits(on_bits(problem))
    lazy = LazyCover(large)
    assert lazy.n_read == large.n_candidates
    while len(lazy.chosen) < 10 and (camera := lazy.next_best()) >= 0:
        lazy.add(camera)
    assert lazy.n_read <= 3 * large.n_candidates  # 1 for the first gains, 0.2 a camera


def test_nothing_to_cover_takes_no_camera():
    for goal in (FewestCameras(), FewestCameras(0.0), BestCoverage(3)):
        for covers in (np.zeros((3, 0)), np.zeros((0, 0)), np.zeros((0, 5))):
            if covers.shape[1] and isinstance(goal, FewestCameras) and goal.coverage:
                continue  # refused: it cannot be reached
            found = select_lazy(on_bits(problem_of_matrix(covers, goal)))
            assert len(found.chosen) == 0
            assert found.gap == 0


def test_a_problem_on_bits_is_refused_as_one_on_lists():
    problem = problem_of_matrix([[1, 0]], BestCoverage(1))
    options = {
        name: getattr(problem, name)
        for name in ("views", "costs", "groups", "face_group", "mean_coverage")
    }
    bits = CoveredBits.from_dense([[1, 0]])
    with pytest.raises(ConfigError, match=r"all 1 candidates together cover 0\.5"):
        BitProblem(bits=bits, goal=FewestCameras(), weights=problem.weights, **options)
    with pytest.raises(ConfigError, match="bits must be of 3 faces"):
        BitProblem(bits=bits, goal=problem.goal, weights=np.ones(3), **options)
    options["views"] = np.zeros(2, np.int64)
    with pytest.raises(ConfigError, match="views must be 1 or more"):
        BitProblem(bits=bits, goal=problem.goal, weights=problem.weights, **options)
    with pytest.raises(ConfigError, match="core_pairs must be 0 or more, got -1"):
        select_lazy(on_bits(problem), core_pairs=-1)
