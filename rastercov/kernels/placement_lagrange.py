"""Compiled loops of `lagrange`: one subgradient method for each goal.

A call makes a number of steps; the next call continues from there, so the caller can check the
clock between them. The state is the prices, the best prices so far, and `progress`: best bound,
scale of the steps, steps without a better bound, and 1 once the search has ended.

Arguments of one name are the same in both searches:

indptr, face : (C + 1,) int64, (N,) int32
    Faces of each candidate.
views, weights, costs : (F,), (F,), (C,) float64
u, best_u : (F,) float64
    In and out: prices, and those of the best bound.
progress : (4,) float64
    In and out.
steps : int
"""

import numpy as np

from rastercov.kernels.jit import compiled

PATIENCE = 15
"""Steps without a better bound after which the step length is halved."""
BEST, SCALE, WAITED, ENDED = range(4)
"""Indices into `progress`."""


@compiled
def cheapest_share(indptr, face, costs, prices):
    """Write the least cost / faces over the candidates of each face into `prices`, (F,)."""
    prices[:] = np.inf
    for c in range(len(costs)):
        share = costs[c] / max(1, indptr[c + 1] - indptr[c])
        for j in range(indptr[c], indptr[c + 1]):
            prices[face[j]] = min(prices[face[j]], share)


@compiled
def _earn(indptr, face, prices, earned):
    """Write the sum of the prices of the faces of each candidate into `earned`, (C,)."""
    for c in range(len(earned)):
        total = 0.0
        for j in range(indptr[c], indptr[c + 1]):
            total += prices[face[j]]
        earned[c] = total


@compiled
def _take(indptr, face, amounts, cover):
    """Write the cover of each face by fractions `amounts` of the candidates into `cover`, (F,)."""
    cover[:] = 0.0
    for c in range(len(amounts)):
        if amounts[c] > 0:
            for j in range(indptr[c], indptr[c + 1]):
                cover[face[j]] += amounts[c]


@compiled
def most_earned(earned, costs, cameras, budget, amounts):
    """Most that any candidates within the limits earn, or more.

    That of the `cameras` most valuable candidates; with a budget, also of the most valuable by
    cost, the last one in part. Each is a bound under both limits.

    Parameters
    ----------
    earned, costs : (C,) float64
    cameras, budget : int, float
        Limits; the budget may be inf.
    amounts : (C,) float64
        Out: part of each candidate in the lesser bound.
    """
    n = len(earned)
    amounts[:] = 0.0
    order = np.argsort(-earned)
    income = 0.0
    for c in order[:cameras]:
        amounts[c] = 1.0
        income += earned[c]
    if budget < np.inf:
        order = np.argsort(-earned / np.maximum(costs, 1e-300))
        left, by_cost, last = budget, 0.0, 0
        while last < n and costs[order[last]] <= left:
            left -= costs[order[last]]
            by_cost += earned[order[last]]
            last += 1
        if last < n:
            by_cost += earned[order[last]] * left / costs[order[last]]
        if by_cost < income:
            income = by_cost
            amounts[:] = 0.0
            for c in order[:last]:
                amounts[c] = 1.0
            if last < n:
                amounts[order[last]] = left / costs[order[last]]
    return income


@compiled
def is_set_back(value, is_better, u, best_u, progress):
    """Keep a better bound, or count a step without one; True where prices are the best again."""
    if is_better:
        progress[BEST], progress[WAITED] = value, 0
        best_u[:] = u
        return False
    progress[WAITED] += 1
    if progress[WAITED] < PATIENCE:
        return False
    progress[SCALE], progress[WAITED] = progress[SCALE] / 2, 0
    u[:] = best_u
    return True


@compiled
def has_ended(norm, is_reached, progress):
    """True, and noted, where no step can give a better bound."""
    if norm == 0 or is_reached or progress[SCALE] < 1e-4:
        progress[ENDED] = 1.0
    return progress[ENDED] > 0


@compiled
def best_weight(
    indptr, face, views, weights, costs, cameras, budget, u, best_u, progress, reached, steps
):  # fmt: skip
    """Subgradient steps towards an upper bound of the weight covered by a number of cameras.

        L(u) = sum_f max(0, w_f - views_f u_f) + max_x sum_c x_c sum_{f in c} u_f

    Parameters
    ----------
    weights : (F,) float64
        Their sum is 1.
    cameras, budget : int, float
        Limits; the budget may be inf.
    u : (F,) float64
        At most weights / views.
    progress : (4,) float64
        inf, 1, 0, 0 to start from.
    reached : float
        Weight of a selection.
    """
    n, m = len(indptr) - 1, len(weights)
    earned, amounts, cover = np.empty(n), np.empty(n), np.empty(m)
    slope = np.empty(m)
    for _ in range(steps):
        _earn(indptr, face, u, earned)
        income = most_earned(earned, costs, cameras, budget, amounts)
        _take(indptr, face, amounts, cover)
        value, norm = income, 0.0
        for f in range(m):
            spare = weights[f] - views[f] * u[f]
            value += max(0.0, spare)
            slope[f] = cover[f] - (views[f] if spare > 0 else 0.0)
            # A price at its limit cannot move beyond it.
            if (u[f] <= 0 and slope[f] > 0) or (spare <= 0 and slope[f] < 0):
                slope[f] = 0.0
            norm += slope[f] * slope[f]
        if is_set_back(value, value < progress[BEST] - 1e-12, u, best_u, progress):
            continue
        if has_ended(norm, progress[BEST] <= reached * (1 + 1e-12), progress):
            break
        length = progress[SCALE] * max(value - reached, 1e-9) / norm
        for f in range(m):
            u[f] = min(max(u[f] - length * slope[f], 0.0), weights[f] / views[f])


@compiled
def least_cost(
    indptr, face, views, weights, costs, kind, least, least_total, u, best_u, progress, cost, steps
):  # fmt: skip
    """Subgradient steps towards a lower bound of the cost of covering the required weight.

        L(u) = min_x sum_c x_c (cost_c - sum_{f in c} u_f) + min_z sum_f views_f u_f z_f

    with z in [0, 1] covering `least` of each kind and `least_total` in total: the faces of least
    price by weight first, kind by kind, then from all remaining faces.

    Parameters
    ----------
    kind : (F,) int32
    least, least_total : (G,) float64, float
        Weight to cover of each kind, and in total.
    progress : (4,) float64
        0, 1, 0, 0 to start from.
    cost : float
        Of a selection.
    """
    n, m = len(indptr) - 1, len(weights)
    earned, amounts, cover = np.empty(n), np.empty(n), np.empty(m)
    slope, z = np.empty(m), np.ones(m)
    all_of_it = least_total >= weights.sum()
    for _ in range(steps):
        _earn(indptr, face, u, earned)
        value = 0.0
        for c in range(n):
            amounts[c] = 1.0 if earned[c] > costs[c] else 0.0
            value += min(0.0, costs[c] - earned[c])
        if not all_of_it:
            cheapest(views * u / weights, weights, kind, least, least_total, z)
        _take(indptr, face, amounts, cover)
        norm = 0.0
        for f in range(m):
            value += views[f] * u[f] * z[f]
            slope[f] = views[f] * z[f] - cover[f]
            if u[f] <= 0 and slope[f] < 0:
                slope[f] = 0.0
            norm += slope[f] * slope[f]
        if is_set_back(value, value > progress[BEST] + 1e-12, u, best_u, progress):
            continue
        if has_ended(norm, progress[BEST] >= cost * (1 - 1e-12), progress):
            break
        length = progress[SCALE] * max(1.02 * cost - value, 1e-9) / norm
        for f in range(m):
            u[f] = max(u[f] + length * slope[f], 0.0)


@compiled
def cheapest(price, weights, kind, least, least_total, z):
    """Write the fractions of faces that give the required weights at the least price into `z`."""
    order = np.argsort(price)
    missing, total = least.copy(), least_total
    z[:] = 0.0
    for f in order:
        part = min(weights[f], max(0.0, missing[kind[f]]))
        missing[kind[f]] -= part
        total -= part
        z[f] = part / weights[f]
    for f in order:
        if total <= 0:
            break
        part = min(weights[f] * (1 - z[f]), total)
        total -= part
        z[f] += part / weights[f]
