"""Selection whose lists do not fit into the memory: the same rule as with lists, true bounds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from selection_cases import QUICK, best_by_trying_all, covers_faces, dense_of, problems, sign_of

from rastercov.placement.bits import CoveredBits
from rastercov.placement.select.cover import LazyCover
from rastercov.placement.select.methods import select_greedy
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import BestCoverage, problem_of_matrix

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
@examples(10)
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
    result, dense = large.list_rows(), dense_of(problem)[large.candidates][:, large.kept]
    wanted = np.nonzero(dense)
    row = np.repeat(np.arange(result.n_candidates), np.diff(result.indptr))
    np.testing.assert_array_equal((row, result.face), wanted)
    column = np.repeat(np.arange(result.n_faces), np.diff(result.starts))
    np.testing.assert_array_equal((column, result.covering), np.nonzero(dense.T))
    assert (large.sizes >= np.diff(result.indptr)).all()


@pytest.mark.slow
@examples(8)
@given(problems(angles=(0,), max_views=3))
def test_no_selection_is_better_than_a_bound_from_a_small_core(problem):
    best = best_by_trying_all(problem)
    selection = select_greedy(problem, effort=QUICK, core_pairs=SMALL_CORE)
    covered = covers_faces(problem, selection.chosen)
    np.testing.assert_array_equal(selection.covered, covered)
    sign = sign_of(problem)
    assert sign * selection.bound >= sign * best - 1e-6
    assert sign * best >= sign * selection.objective - 1e-6


def caps(n_candidates, n_faces, seed=0):
    """Candidates that cover caps of a sphere."""
    rng = np.random.default_rng(seed)
    face, axis = rng.normal(size=(n_faces, 3)), rng.normal(size=(n_candidates, 3))
    face, axis = (each / np.linalg.norm(each, axis=1)[:, None] for each in (face, axis))
    # Neighbours on the sphere are neighbours in number, about as in a mesh.
    face = face[np.lexsort((face[:, 0], np.floor(8 * face[:, 1]), np.floor(8 * face[:, 2])))]
    return axis @ face.T > rng.uniform(0.7, 0.9, (n_candidates, 1))


@pytest.mark.slow
def test_a_camera_takes_the_gains_of_a_part_of_the_candidates(monkeypatch):
    asked = []
    gains = LazyCover._gains
    monkeypatch.setattr(
        LazyCover, "_gains", lambda self, rows: asked.append(len(rows)) or gains(self, rows)
    )
    lazy = LazyCover(presolve(problem_of_matrix(caps(1500, 4000), BestCoverage(10))))
    while len(lazy.chosen) < 10:
        lazy.add(lazy.next_best())
    assert 1 < sum(asked) / 1500 <= 2.8  # 1 for the first gains, a sixth for a camera
