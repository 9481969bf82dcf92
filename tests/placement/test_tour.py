"""Order of stops: against the best of all orders, and the laws of every order."""

from itertools import permutations, product

import numpy as np
import pytest
from nightly import amount
from tours import best_of

from rastercov.placement.improve.tour import length, tour


def costs_of(rng, n, kind):
    """Ways between a start and n stops: joint angles, stops on a line, equal ways, clusters."""
    joints = rng.uniform(-3, 3, (n + 1, 6))
    if kind == "line":
        joints = joints[:, :1]
    elif kind == "clusters":
        joints = rng.integers(0, 3, (n + 1, 1)) * 2.0 + 0.05 * joints
    elif kind == "equal":
        joints[:] = 0
    return np.abs(joints[:, None] - joints[None]).max(axis=2)


def cost_of(order, costs):
    return length(np.array([0, *(np.asarray(order) + 1)]), costs)


@pytest.mark.parametrize("n", [1, 3, 5, pytest.param(7, marks=pytest.mark.slow)])
def test_order_and_choices_are_the_best_together(n):
    """By brute force over all orders and all choices, and by sets of stops."""
    rng = np.random.default_rng(n)
    for _ in range(amount(4, 40)):
        counts = rng.integers(1, 4, n)
        stop = rng.permutation(np.repeat(np.arange(n), counts))
        costs = costs_of(rng, len(stop), rng.choice(["joints", "line", "clusters", "equal"]))
        nodes = tour(costs, stop)
        assert sorted(stop[nodes]) == list(range(n))
        own, best = cost_of(nodes, costs), best_of(costs, stop)
        assert own == pytest.approx(best, abs=1e-12)
        if n <= 3:
            every = (
                cost_of(some, costs)
                for order in permutations(range(n))
                for some in product(*(np.flatnonzero(stop == row) for row in order))
            )
            assert best == pytest.approx(min(every), abs=1e-12)


def test_of_more_stops_no_other_choice_shortens_a_tour(monkeypatch):
    """And with search alone, tours of few stops are at most 5 % above the best."""
    rng = np.random.default_rng(8)
    stop = np.repeat(np.arange(15), 4)
    costs = costs_of(rng, len(stop), "joints")
    nodes = tour(costs, stop)
    assert sorted(stop[nodes]) == list(range(15))
    for row in range(15):
        for other in np.flatnonzero(stop == stop[nodes[row]]):
            trial = np.concatenate([nodes[:row], [other], nodes[row + 1 :]])
            assert cost_of(trial, costs) >= cost_of(nodes, costs) - 1e-9
    monkeypatch.setattr("rastercov.placement.improve.tour.MOST_EXACT", 3)
    for _ in range(amount(4, 60)):
        stop = np.repeat(np.arange(6), 3)
        costs = costs_of(rng, len(stop), "joints")
        assert cost_of(tour(costs, stop), costs) <= 1.05 * best_of(costs, stop)


@pytest.mark.parametrize("kind", ["joints", "line", "clusters", "equal"])
def test_the_tour_is_the_best(kind):
    rng = np.random.default_rng(5)
    for _ in range(amount(8, 300)):
        n = int(rng.integers(0, 9))
        costs = costs_of(rng, n, kind)
        order = tour(costs)
        assert sorted(order.tolist()) == list(range(n))
        best = best_of(costs)
        if n <= 5:
            every = (cost_of(each, costs) for each in permutations(range(n)))
            assert best == pytest.approx(min(every), abs=1e-12)
        assert cost_of(order, costs) == pytest.approx(best, abs=1e-12)


def test_no_reversal_or_move_shortens_a_tour_of_many_stops():
    rng = np.random.default_rng(6)
    costs = costs_of(rng, 40, "joints")
    order = tour(costs)
    assert sorted(order.tolist()) == list(range(40))
    assert order.tolist() == tour(costs).tolist()
    own = cost_of(order, costs)
    for _ in range(3000):
        a, b = np.sort(rng.integers(0, 41, 2))
        turned = np.concatenate([order[:a], order[a:b][::-1], order[b:]])
        assert cost_of(turned, costs) >= own - 1e-9
        rest = np.delete(order, np.arange(a, min(a + 2, 40)))
        moved = np.insert(rest, rng.integers(0, len(rest) + 1), order[a : a + 2])
        assert cost_of(moved, costs) >= own - 1e-9
    greedy, left, here = [], list(range(40)), 0
    while left:
        here = min(left, key=lambda stop: costs[here, stop + 1])
        greedy.append(here)
        left.remove(here)
        here += 1
    assert own < cost_of(greedy, costs)
