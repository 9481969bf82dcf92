"""Order of stops: a short path from its start through all of them.

Local search by reversals of parts (2-opt) and moves of up to three stops (Or-opt), again from the
best path with four of its parts in another order.

G. A. Croes. A Method for Solving Traveling-Salesman Problems. 1958. I. Or. Traveling
Salesman-Type Combinatorial Problems. 1976. O. Martin, S. Otto, E. Felten. Large-Step Markov Chains
for the Traveling Salesman Problem. 1991.
"""

import numpy as np

from rastercov.base.memory import FloatArray, IntArray

KICKS = 120
"""Searches from the best path so far, less of many stops."""
MOST_WORK = 20_000
"""Stops times searches."""
LONGEST_PART = 3
"""Stops that are moved together."""
GAIN_REL = 1e-12


def tour(costs: FloatArray) -> IntArray:
    """(N,) stops in the order of a short path through all; deterministic.

    Parameters
    ----------
    costs : (N + 1, N + 1) float64
        Of the way between two stops, the same both ways; the first row is the start.
    """
    n = len(costs)
    if n < 3:
        return np.arange(n - 1)
    ways = np.zeros((n + 1, n + 1))  # the end is at no cost
    ways[:n, :n] = costs
    path = np.array([*_greedy(costs), n])
    path = _improved(path, ways)
    rng = np.random.default_rng(0)
    for _ in range(min(KICKS, MOST_WORK // n) if n > 4 else 0):
        a, b, c = np.sort(rng.choice(np.arange(1, n), 3, replace=False))
        trial = np.concatenate([path[:a], path[b:c], path[a:b], path[c:]])
        trial = _improved(trial, ways)
        if length(trial, ways) < length(path, ways):
            path = trial
    return path[1:-1] - 1


def length(path: IntArray, ways: FloatArray) -> float:
    """Cost of a path."""
    return float(ways[path[:-1], path[1:]].sum())


def _greedy(costs: FloatArray) -> list[int]:
    """The nearest stop next."""
    path, left = [0], list(range(1, len(costs)))
    while left:
        path.append(left.pop(int(costs[path[-1], left].argmin())))
    return path


def _improved(path: IntArray, ways: FloatArray) -> IntArray:
    """The path after the moves that shorten it, the best one first."""
    tolerance = GAIN_REL * ways.max(initial=0.0)
    while True:
        gain, better = _reversed(path, ways)
        for size in range(1, min(LONGEST_PART, len(path) - 3) + 1):
            for step in (1, -1):
                other = _moved(path, ways, size, step)
                gain, better = max((gain, better), other, key=lambda each: each[0])
        if not gain > tolerance:
            return path
        path = better


def _reversed(path: IntArray, ways: FloatArray) -> tuple[float, IntArray]:
    """Greatest gain by a part in the other direction, and the path with it."""
    before, own, after = path[:-2], path[1:-1], path[2:]
    now = ways[before, own][:, None] + ways[own, after][None]
    gain = np.triu(now - ways[before[:, None], own[None]] - ways[own[:, None], after[None]])
    first, last = np.unravel_index(gain.argmax(), gain.shape)
    part = path[first + 1 : last + 2]
    better = np.concatenate([path[: first + 1], part[::-1], path[last + 2 :]])
    return float(gain[first, last]), better


def _moved(path: IntArray, ways: FloatArray, size: int, step: int) -> tuple[float, IntArray]:
    """Greatest gain by a part of some stops elsewhere, turned for step -1, and the path with it."""
    first = np.arange(1, len(path) - size)
    start, end = path[first], path[first + size - 1]
    before, after = path[first - 1], path[first + size]
    gain = ways[before, start] + ways[end, after] - ways[before, after]
    head, tail = (start, end)[::step]
    one, other = path[:-1], path[1:]
    cost = ways[one[None], head[:, None]] + ways[tail[:, None], other[None]] - ways[one, other]
    at = np.arange(len(path) - 1)[None]
    is_own = (at >= first[:, None] - 1) & (at < first[:, None] + size)
    whole = np.where(is_own, -np.inf, gain[:, None] - cost)
    row, place = np.unravel_index(whole.argmax(), whole.shape)
    part = path[first[row] : first[row] + size][::step]
    rest = np.delete(path, np.arange(first[row], first[row] + size))
    behind = int(place) + 1 - (size if place > first[row] else 0)
    return float(whole[row, place]), np.insert(rest, behind, part)
