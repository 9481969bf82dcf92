"""Order of stops, and the choice at each: a short path from its start through all of them.

Of up to 9 stops, the best by dynamic programming over sets of stops. Of more, local search by
reversals of parts (2-opt), moves of up to three stops (Or-opt) and other choices at the stops of
the same order, again from the best path with four of its parts in another order.

M. Held, R. Karp. A Dynamic Programming Approach to Sequencing Problems. 1962. G. A. Croes. A Method
for Solving Traveling-Salesman Problems. 1958. I. Or. Traveling Salesman-Type Combinatorial
Problems. 1976. O. Martin, S. Otto, E. Felten. Large-Step Markov Chains for the Traveling Salesman
Problem. 1991.
"""

import numpy as np

from rastercov.base import FloatArray, IntArray

MOST_EXACT = 9
"""Stops of which the best path is found."""
KICKS = 120
"""Searches from the best path so far, less of many stops."""
MOST_WORK = 20_000
"""Stops times searches."""
LONGEST_PART = 3
"""Stops that are moved together."""
GAIN_REL = 1e-12


def tour(costs: FloatArray, stop: IntArray | None = None) -> IntArray:
    """(N,) choices, one of each stop, in the order of a short path through all; deterministic.

    Parameters
    ----------
    costs : (M + 1, M + 1) float64
        Of the way between two choices, the same both ways; the first row is the start.
    stop : (M,) int64, optional
        Stop of each choice, 0 to N - 1; one choice a stop unless given.
    """
    own = np.arange(len(costs) - 1) if stop is None else stop
    n = int(own.max(initial=-1)) + 1
    if n <= MOST_EXACT:
        return _best(costs, own, n)
    ways = np.zeros((len(costs) + 1,) * 2)  # the end is at no cost
    ways[:-1, :-1] = costs
    of = np.array([-1, *own, n])
    path = _improve_tour(np.array([*_greedy(costs, of), len(costs)]), ways, of)
    rng = np.random.default_rng(0)
    for _ in range(min(KICKS, MOST_WORK // n)):
        a, b, c = np.sort(rng.choice(np.arange(1, n + 1), 3, replace=False))
        others = [rng.choice(np.flatnonzero(of == of[node])) for node in (*path[b:c], *path[a:b])]
        trial = np.concatenate([path[:a], others, path[c:]])
        trial = _improve_tour(trial, ways, of)
        if length(trial, ways) < length(path, ways):
            path = trial
    return path[1:-1] - 1


def _best(costs: FloatArray, stop: IntArray, n: int) -> IntArray:
    """(N,) choices of the shortest path through N stops."""
    bit, ways = 1 << stop, costs[1:, 1:]
    least = np.full((1 << n, len(stop)), np.inf)  # to a choice, through a set of stops
    least[bit, np.arange(len(stop))] = costs[0, 1:]
    for some in range(1, 1 << n):
        here, there = np.flatnonzero(bit & some), np.flatnonzero(~some & bit)
        if len(there):
            result = (least[some, here, None] + ways[np.ix_(here, there)]).min(axis=0)
            sets = some | bit[there]
            least[sets, there] = np.minimum(least[sets, there], result)
    path, some = list[int](), (1 << n) - 1
    while some:
        here = np.flatnonzero(bit & some)
        onwards = ways[here, path[-1]] if path else np.zeros(len(here))
        path.append(int(here[(least[some, here] + onwards).argmin()]))
        some ^= int(bit[path[-1]])
    return np.array(path[::-1], np.int64)


def length(path: IntArray, ways: FloatArray) -> float:
    """Cost of a path."""
    return float(ways[path[:-1], path[1:]].sum())


def _greedy(costs: FloatArray, of: IntArray) -> list[int]:
    """The nearest choice of another stop next."""
    path, left = [0], np.arange(1, len(costs))
    while len(left):
        path.append(int(left[costs[path[-1], left].argmin()]))
        left = left[of[left] != of[path[-1]]]
    return path


def _improve_tour(path: IntArray, ways: FloatArray, of: IntArray) -> IntArray:
    """The path after the moves that shorten it, the best one first."""
    tolerance = GAIN_REL * ways.max(initial=0.0)
    while True:
        gain, better = _reverse_part(path, ways)
        for size in range(1, LONGEST_PART + 1):
            for step in (1, -1):
                other = _move_part(path, ways, size, step)
                gain, better = max((gain, better), other, key=lambda each: each[0])
        if not gain > tolerance:
            better = _improve_choice(path, ways, of)
            gain = length(path, ways) - length(better, ways)
        if not gain > tolerance:
            return path
        path = better


def _improve_choice(path: IntArray, ways: FloatArray, of: IntArray) -> IntArray:
    """The best choices at the stops of a path, in its order."""
    at, least, before = path[:1], np.zeros(1), list[tuple[IntArray, IntArray]]()
    for stop in of[path[1:]]:
        new = np.flatnonzero(of == stop)
        values = least[:, None] + ways[np.ix_(at, new)]
        before.append((at, values.argmin(axis=0)))
        at, least = new, values.min(axis=0)
    better, row = [int(at[0])], 0
    for nodes, chosen in reversed(before):
        row = int(chosen[row])
        better.append(int(nodes[row]))
    return np.array(better[::-1])


def _reverse_part(path: IntArray, ways: FloatArray) -> tuple[float, IntArray]:
    """Greatest gain by a part in the other direction, and the path with it."""
    before, own, after = path[:-2], path[1:-1], path[2:]
    now = ways[before, own][:, None] + ways[own, after][None]
    gain = np.triu(now - ways[before[:, None], own[None]] - ways[own[:, None], after[None]])
    first, last = np.unravel_index(gain.argmax(), gain.shape)
    part = path[first + 1 : last + 2]
    better = np.concatenate([path[: first + 1], part[::-1], path[last + 2 :]])
    return float(gain[first, last]), better


def _move_part(path: IntArray, ways: FloatArray, size: int, step: int) -> tuple[float, IntArray]:
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
