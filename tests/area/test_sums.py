"""Sums over parts of a surface, by which groups and goals are judged: the engine against numpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from summed import sums_of

from rastercov.engine import area_sums

HOSTILE = np.array([0.0, -0.0, 5e-324, 1e-300, 0.1, 1 / 3, 1.0, 1e16, 1e300])


def engine_sums(levels, bounds, areas, part, views):
    out = np.full((len(views), len(levels) + 3), np.nan)
    area_sums.sum_areas((levels, bounds, areas), part, views, out)
    return out


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 7, 8, 9, 127, 128, 129, 1000, 3001]),
    st.integers(1, 5),
    st.integers(1, 6),
    st.booleans(),
)
def test_parts_are_summed_bit_for_bit_as_numpy_does(seed, n, k, n_parts, is_hostile):
    rng = np.random.default_rng(seed)
    draw = (
        (lambda *s: rng.choice(HOSTILE, s)) if is_hostile else lambda *s: 10 ** rng.normal(size=s)
    )
    levels, areas = np.sort(draw(k, n), axis=0)[::-1].copy(), draw(n)
    bounds = np.sort(draw(2, n) * rng.choice([1e-9, 1.0]), axis=0)[::-1].copy()
    part = rng.integers(-1, n_parts, n).astype(np.int32)
    views = rng.integers(1, k + 1, n_parts).astype(np.int32)
    given = levels, bounds, areas, part, views
    assert engine_sums(*given).tobytes() == (sums_of(*given) + 0.0).tobytes()


@pytest.mark.parametrize(
    ("part", "views"), [([2, 0], [1, 1]), ([0, 0], [3]), ([0, 0], [0]), ([0], [1])]
)
def test_parts_and_views_that_are_not_there_are_refused(part, views):
    given = np.ones((2, 2)), np.zeros((2, 2)), np.ones(2)
    with pytest.raises(ValueError, match="must"):
        engine_sums(*given, np.array(part, np.int32), np.array(views, np.int32))
