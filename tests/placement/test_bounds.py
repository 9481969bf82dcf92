"""What prices prove: fractional knapsacks of candidates and faces, beside one item at a time."""

import highspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.placement.select.bounds import cheapest, most_earned
from rastercov.placement.select.presolve import presolve
from rastercov.placement.select.problem import FewestCameras, problem_of_matrix


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
    """As the linear program says, where requirements are in others."""
    rng = np.random.default_rng(seed)
    n, g = int(rng.integers(1, 12)), int(rng.integers(1, 6))
    outer = [int(rng.integers(0, row)) for row in range(1, g)]
    places = ["all"]
    for row, parent in enumerate(outer, 1):
        places.append(f"{places[parent]}/{row}")
    shares = dict(zip(places, rng.choice([0.2, 0.5, 0.9, 1.0], g).tolist(), strict=True))
    price, weights = rng.random(n).round(1), rng.integers(1, 5, n).astype(np.float64)
    problem = problem_of_matrix(
        np.ones((1, n)), FewestCameras(0.3, shares), weights=weights, groups=places,
        face_group=rng.integers(0, g, n),
    )  # fmt: skip
    reduced = presolve(problem).list_rows()
    share = cheapest(price, weights, reduced.kind, reduced.least, reduced.levels)
    assert ((share >= 0) & (share <= 1 + 1e-12)).all()
    model = highspy.Highs()
    model.setOptionValue("output_flag", False)
    columns = [model.addVariable(0.0, 1.0, cost) for cost in price * weights]
    for place, least in zip((None, *shares), (0.3, *shares.values()), strict=True):
        rows = [place is None or f"{name}/".startswith(f"{place}/") for name in places]
        own = np.flatnonzero(np.array(rows)[problem.face_group])
        wanted = np.ceil((least - 1e-9) * weights[own].sum())
        assert share[own] @ weights[own] >= wanted - 1e-9
        if len(own):
            model.addConstr(sum(columns[f] * weights[f] for f in own.tolist()) >= wanted)
    model.run()
    assert share @ (price * weights) == pytest.approx(model.getObjectiveValue(), abs=1e-6)
