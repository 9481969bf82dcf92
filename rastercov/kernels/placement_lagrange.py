"""Compiled loops of Lagrangian bounds: sums over the pairs of candidates and faces, and orders.

Arguments of one name are the same in all loops:

indptr, face : (C + 1,) int64, (N,) int32
    Faces of each candidate.
costs : (C,) float64
"""

import numpy as np

from rastercov.kernels.jit import compiled


@compiled
def cheapest_share(indptr, face, costs, prices):
    """Write the least cost / faces over the candidates of each face into `prices`, (F,)."""
    prices[:] = np.inf
    for c in range(len(costs)):
        share = costs[c] / max(1, indptr[c + 1] - indptr[c])
        for j in range(indptr[c], indptr[c + 1]):
            prices[face[j]] = min(prices[face[j]], share)


@compiled
def earn(indptr, face, prices, earned):
    """Write the sum of the prices of the faces of each candidate into `earned`, (C,)."""
    for c in range(len(earned)):
        total = 0.0
        for j in range(indptr[c], indptr[c + 1]):
            total += prices[face[j]]
        earned[c] = total


@compiled
def take(indptr, face, amounts, cover):
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
