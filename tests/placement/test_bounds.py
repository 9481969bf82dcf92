"""What prices prove: fractional knapsacks of candidates and faces, beside one item at a time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.placement.select.bounds import cheapest, most_earned


@given(st.integers(0, 10**6), st.sampled_from([np.inf, 0.0, 1.0, 2.2, 100.0]))
def test_candidates_earn_most_within_a_number_and_a_budget(seed, budget):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 12))
    earned, costs = rng.integers(0, 4, n) * 0.5, rng.choice([0.0, 0.5, 1.0, 2.0], n)
    cameras = int(rng.integers(0, n + 1))
    income, amounts = most_earned(earned, costs, cameras, budget)
    by_number = np.sort(earned)[::-1][:cameras].sum()
    left, by_cost = budget, 0.0
    for c in np.argsort(-earned / np.maximum(costs, 1e-9), kind="stable"):
        part = 1.0 if costs[c] <= left else left / costs[c]
        by_cost += part * earned[c]
        left -= part * costs[c]
    assert income == pytest.approx(min(by_number, by_cost))
    assert amounts @ earned == pytest.approx(income)
    assert amounts.sum() <= cameras or amounts @ costs <= budget + 1e-9


@given(st.integers(0, 10**6))
def test_faces_give_the_required_weights_at_the_least_price(seed):
    rng = np.random.default_rng(seed)
    n, g = int(rng.integers(1, 12)), int(rng.integers(1, 4))
    price, weights = rng.random(n).round(1), rng.integers(1, 5, n).astype(np.float64)
    kind = rng.integers(0, g, n).astype(np.int32)
    least, total = np.append(0, rng.integers(0, 8, g - 1)), int(rng.integers(0, 20))
    share, missing, order = np.zeros(n), least.astype(np.float64), np.argsort(price, kind="stable")
    for f in order:
        share[f] = min(weights[f], max(0.0, missing[kind[f]])) / weights[f]
        missing[kind[f]] -= share[f] * weights[f]
    left = total - share @ weights
    for f in order:
        more = min(weights[f] * (1 - share[f]), max(0.0, left))
        share[f] += more / weights[f]
        left -= more
    np.testing.assert_allclose(cheapest(price, weights, kind, least, total), share, atol=1e-12)
