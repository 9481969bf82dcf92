"""Order of stops: against the best of all orders, and the laws of every order."""

from itertools import permutations

import numpy as np
import pytest
from nightly import amount

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


def best_of(costs):
    """Least cost of a path through all stops, by dynamic programming over sets of them."""
    n = len(costs) - 1
    least = {(1 << stop, stop): costs[0, stop + 1] for stop in range(n)}
    for some in range(1, 1 << n):
        for last in range(n):
            if (some, last) not in least:
                continue
            for stop in range(n):
                if not some >> stop & 1:
                    key = some | 1 << stop, stop
                    way = least[some, last] + costs[last + 1, stop + 1]
                    least[key] = min(way, least.get(key, np.inf))
    return min((least[(1 << n) - 1, last] for last in range(n)), default=0.0)


@pytest.mark.parametrize("kind", ["joints", "line", "clusters", "equal"])
def test_the_tour_is_at_most_5_percent_above_the_best(kind):
    rng, worst = np.random.default_rng(5), 1.0
    for _ in range(amount(8, 300)):
        n = int(rng.integers(0, 9))
        costs = costs_of(rng, n, kind)
        order = tour(costs)
        assert sorted(order.tolist()) == list(range(n))
        best = best_of(costs)
        if n <= 5:
            every = (cost_of(each, costs) for each in permutations(range(n)))
            assert best == pytest.approx(min(every), abs=1e-12)
        assert cost_of(order, costs) >= best - 1e-12
        if best > 0:
            worst = max(worst, cost_of(order, costs) / best)
    assert worst <= 1.05


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
