"""Areas of polygons of an ideal plane in the image of a lens, edge by edge; by numba.

The area of a polygon's image is the closed integral of u dv along its border, by Green's theorem.
The part of it inside the image, 0 <= u <= W and 0 <= v <= H, is that of clamp(u, 0, W)
d clamp(v, 0, H), because the clamped border encloses that part and pieces of no area. So each edge
is integrated by itself: no curve is ever cut by another.

Edges are evaluated at points that depend on the edge alone and not on its direction, so that two
polygons that share one agree on it to the last bits.

A rule takes n + 1 values of the lens. With U, V of u, v at the Gauss-Lobatto nodes of an edge, the
area between the image of the
edge and its chord is

    bulge = sum over j < i of S_ij ((U_i - U_0) (V_j - V_0) - (U_j - U_0) (V_i - V_0)),

S constant and antisymmetric: S_ij = (w_i D_ij - w_j D_ji) / 2, w the weights and D the derivatives
of the Lagrange polynomials. It is exact where the degrees of u and v add up to 2 n at most.
"""

import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from rastercov.kernels.jit import allocation_free, called_whole, part_of, part_with_arrays
from rastercov.kernels.lens import project
from rastercov.kernels.lens_lanes import GROUP, project_lanes

FloatArray = NDArray[np.float64]

FEWEST, MOST = 2, 11
"""Least and largest n."""


def lobatto(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes in [0, 1], the matrix S, and Bernstein coefficients from values at the nodes.

    Nodes are symmetric: node k and node n - k add up to 1, to rounding.
    """
    unit = np.zeros(n + 1)
    unit[n] = 1
    inner = np.sort(legendre.legroots(legendre.legder(unit)).real) if n > 1 else np.empty(0)
    x = np.concatenate(([-1.0], inner, [1.0]))
    x = (x - x[::-1]) / 2
    values = legendre.legvander(x, n)
    slopes = np.column_stack([legendre.legval(x, legendre.legder(row)) for row in np.eye(n + 1)])
    weights = 2 / (n * (n + 1) * legendre.legval(x, unit) ** 2)
    product = weights[:, None] * (slopes @ np.linalg.inv(values))
    t = (x + 1) / 2
    basis = [math.comb(n, k) * t**k * t[::-1] ** (n - k) for k in range(n + 1)]
    return t, (product - product.T) / 2, np.linalg.inv(np.column_stack(basis))


def _tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    nodes = np.zeros((MOST + 1, MOST + 1))
    rule, bernstein = np.zeros((2, MOST + 1, MOST + 1, MOST + 1))
    for n in range(1, MOST + 1):
        own = slice(n + 1)
        nodes[n, own], rule[n, own, own], bernstein[n, own, own] = lobatto(n)
    return nodes, rule, bernstein


NODES, RULE, BERNSTEIN = _tables()
"""By n: places of the nodes, S, and Bernstein coefficients from values."""
GAP = np.array([0.0, *(np.diff(NODES[n, : n + 1]).max() for n in range(1, MOST + 1))])
"""By n: largest distance of neighbouring nodes, in lengths of the edge."""
GROWTH = np.abs(BERNSTEIN).sum(axis=2).max(axis=1)
"""By n: largest Bernstein coefficient of a polynomial that is at most 1 at the nodes."""


FLAT = 1e-10
"""Pixels: a coordinate that stays this near to a border is taken to be on one side of it."""
ROOT_TOLERANCE, MOST_STEPS = 1e-15, 240
"""Error of the place of a root, in lengths of its part, and steps of the search for it: one in four
is a bisection."""
CORRECTIONS, SECANT = 3, 2.0**-10
"""Steps from the root of a polynomial to that of the lens, and the part of the edge along which its
slope is found; the root is not moved by more."""
CROSSED = 1e-11
"""Pixels: a coordinate that is this near to a border is on it."""
ROUNDING_REL = 2.0**-50
"""Rounding of a polynomial relative to its coefficients: less is 0."""
DEEPEST = 48
"""Halvings of an edge in the search for a root, and of one that meets a pole."""
MOST_CUTS = 12 * MOST
NODE_ROOM = -(-(MOST + 1) // GROUP) * GROUP
"""Room for the nodes of an edge in `values_together`."""
NO_LEVEL, LEVEL_U, LEVEL_V = 0, 1, 2
"""Kinds of the cuts of an edge: an end of it, a border crossed by u, one crossed by v."""


@part_with_arrays
def plane_value(plane, x, y):
    """Pixel (u, v) of a point of a plane."""
    frame = plane.frame
    X = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2]
    Y = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2]
    Z = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2]
    return project(plane.code, plane.params, X, Y, Z)


@part_of
def point_of(edge, s, t):
    """Point of an edge (ax, ay, bx, by) with the weights s and t of its ends."""
    ax, ay, bx, by = edge
    return s * ax + t * bx, s * ay + t * by


@part_of
def part_of_edge(edge, start, end):
    """Part of an edge from one place to another one, 0 to 1."""
    return (*point_of(edge, 1.0 - start, start), *point_of(edge, 1.0 - end, end))


@allocation_free
def node_value(plane, edge, n, k):
    """Pixel (u, v) of node k of the n + 1 nodes of an edge."""
    x, y = point_of(edge, NODES[n, n - k], NODES[n, k])
    return plane_value(plane, x, y)


@allocation_free
def values_together(plane, edge, n, scratch):
    """Fill `scratch.U` and `scratch.V` with the pixels of the n + 1 nodes of an edge."""
    x, y, z = scratch.nodes[0], scratch.nodes[1], scratch.nodes[2]
    for k in range(NODE_ROOM):
        m = min(k, n)
        x[k], y[k] = point_of(edge, NODES[n, n - m], NODES[n, m])
    project_lanes(plane.code, plane.params, plane.frame, x, y, z, n + 1, scratch.U, scratch.V)


@part_with_arrays
def bulge(n, U, V):
    """Signed area between the image of an edge and its chord, px^2, from values at its nodes."""
    total = 0.0
    u0, v0 = U[0], V[0]
    for i in range(2, n + 1):
        u, v = U[i] - u0, V[i] - v0
        for j in range(1, i):
            total += RULE[n, i, j] * (u * (V[j] - v0) - (U[j] - u0) * v)
    return total


@part_with_arrays
def under_edge(n, U, V, u0):
    """Integral of (u - u0) dv along the image of an edge, px^2, from values at its nodes."""
    return 0.5 * ((U[0] - u0) + (U[n] - u0)) * (V[n] - V[0]) + bulge(n, U, V)


@part_with_arrays
def nodes_for(half, longest, parts_of):
    """Rule for an edge of a half length, and the number of its parts: (n, parts)."""
    for n in range(FEWEST, MOST + 1):
        if half <= longest[n]:
            return n, 1
    return parts_of, math.ceil(half / longest[parts_of])


@part_with_arrays
def bernstein_of(n, values, level, coefficients):
    """Fill Bernstein coefficients of the polynomial through values at the nodes, less a level."""
    for k in range(n + 1):
        total = 0.0
        for j in range(n + 1):
            total += BERNSTEIN[n, k, j] * (values[j] - level)
        coefficients[k] = total


@part_with_arrays
def may_cross(n, values, level, stray):
    """False where an edge with values at its nodes cannot take a level.

    Neither can the polynomial through them, nor an arc between two nodes, which leaves its chord by
    the stray at most.
    """
    low = high = values[0]
    for k in range(1, n + 1):
        low, high = min(low, values[k]), max(high, values[k])
    if low - stray > level or high + stray < level:
        return False
    return abs(level - 0.5 * (low + high)) <= GROWTH[n] * 0.5 * (high - low)


@part_with_arrays
def _changes(n, row):
    """Changes of sign along coefficients, and the largest of these."""
    changes, last, largest = 0, 0.0, 0.0
    for k in range(n + 1):
        c = row[k]
        largest = max(largest, abs(c))
        if c != 0.0:
            if last != 0.0 and (c > 0.0) != (last > 0.0):
                changes += 1
            last = c
    return changes, largest


@part_with_arrays
def _value_and_slope(n, row, t, spare):
    """Polynomial of degree n >= 2 in Bernstein form, and its derivative, at t."""
    for k in range(n + 1):
        spare[k] = row[k]
    for r in range(1, n):
        for k in range(n + 1 - r):
            spare[k] += t * (spare[k + 1] - spare[k])
    change = spare[1] - spare[0]
    return spare[0] + t * change, n * change


@part_with_arrays
def _only_root(n, row, spare):
    """Root of a polynomial that changes its sign once, by Newton's method within bisections."""
    a, b, is_up, largest = 0.0, 1.0, row[0] < 0.0, 0.0
    for k in range(n + 1):
        largest = max(largest, abs(row[k]))
    t = row[0] / (row[0] - row[n])
    for step in range(MOST_STEPS):
        f, slope = _value_and_slope(n, row, t, spare)
        if abs(f) <= ROUNDING_REL * largest:
            return t
        if (f < 0.0) == is_up:
            a = t
        else:
            b = t
        following = t - f / slope
        if step % 4 == 3 or not a < following < b:
            following = 0.5 * (a + b)
        if b - a < ROOT_TOLERANCE:
            break
        t = following
    return 0.5 * (a + b)


@allocation_free
def roots(n, stack, low, spare, out, kinds, kind, count):
    """Append the places in (0, 1) where a polynomial in Bernstein form changes its sign.

    Coefficients are in stack[0], (DEEPEST + 2, MOST + 1); `low` (DEEPEST + 2, 2) has room for the
    places and lengths of parts. By Descartes' rule a part whose coefficients change their sign once
    has one root, one where they do not has none; others are halved, until they are next to 0. An
    edge that is next to 0 from end to end has no root. Returns the new count.
    """
    top = 1
    low[0, 0], low[0, 1] = 0.0, 1.0
    while top > 0:
        top -= 1
        row = stack[top]
        start, length = low[top, 0], low[top, 1]
        changes, largest = _changes(n, row)
        is_flat = largest <= FLAT
        if changes == 0 or (is_flat and length == 1.0):
            continue
        # The search would take an end that is next to 0 for the root.
        least_end = min(abs(row[0]), abs(row[n]))
        if changes == 1 and least_end > ROUNDING_REL * largest and not is_flat:
            t = _only_root(n, row, spare)
            if count < out.shape[0] - 1:
                out[count], kinds[count] = start + length * t, kind
                count += 1
            continue
        if is_flat or top + 2 > DEEPEST or length < 1e-13:
            if count < out.shape[0] - 1:
                out[count], kinds[count] = start + 0.5 * length, kind
                count += 1
            continue
        # Halves by de Casteljau: the right one replaces this row, the left one is put on top.
        left = stack[top + 1]
        for r in range(n + 1):
            left[r] = row[0]
            for k in range(n - r):
                row[k] = 0.5 * (row[k] + row[k + 1])
        low[top, 0], low[top, 1] = start + 0.5 * length, 0.5 * length
        low[top + 1, 0], low[top + 1, 1] = start, 0.5 * length
        # Step r leaves coefficient n - r of the row as that of the right half. A root where they
        # meet is an end of both, and neither has it within.
        if row[0] == 0.0 and count < out.shape[0] - 1:
            out[count], kinds[count] = start + 0.5 * length, kind
            count += 1
        top += 2
    return count


@allocation_free
def height_at(plane, edge, t, is_u, level):
    """Pixels by which u, or v, of the point at t on an edge is above a level."""
    x, y = point_of(edge, 1.0 - t, t)
    u, v = plane_value(plane, x, y)
    return (u if is_u else v) - level


@allocation_free
def crossing(plane, edge, t, is_u, level):
    """Place where the image of an edge takes a level of u, or of v, next to a root t.

    The root is that of the polynomial through the nodes, which is next to the lens by area, but may
    be off by much more in its place; steps of the secant method follow while they come nearer.
    """
    step = SECANT if t < 0.5 else -SECANT
    height = height_at(plane, edge, t, is_u, level)
    for _ in range(CORRECTIONS):
        if abs(height) < CROSSED:
            break
        change = height_at(plane, edge, t + step, is_u, level) - height
        move = -step * (height / change) if change != 0.0 else 1.0
        if not abs(move) < SECANT or not 0.0 < t + move < 1.0:
            break
        following = height_at(plane, edge, t + move, is_u, level)
        if not abs(following) < abs(height):
            break
        t, height = t + move, following
    return t


@allocation_free
def find_cuts(plane, edge, n, stray, scratch):
    """List the places where the image of an edge may cross the border of the image, in order.

    The values at its nodes are `scratch.U` and `scratch.V`. Returns their number.
    """
    cuts, kinds, count = scratch.cuts, scratch.kinds, 0
    for side in range(4):
        is_u, level = side < 2, (0.0, plane.width, 0.0, plane.height)[side]
        values = scratch.U if is_u else scratch.V
        if may_cross(n, values, level, stray):
            bernstein_of(n, values, level, scratch.stack[0])
            found, kind = count, LEVEL_U if is_u else LEVEL_V
            count = roots(
                n, scratch.stack, scratch.low, scratch.spare, cuts, kinds, kind, count
            )  # fmt: skip
            for i in range(found, count):
                cuts[i] = crossing(plane, edge, cuts[i], is_u, level)
    for i in range(1, count):
        cut, kind, j = cuts[i], kinds[i], i - 1
        while j >= 0 and cuts[j] > cut:
            cuts[j + 1], kinds[j + 1] = cuts[j], kinds[j]
            j -= 1
        cuts[j + 1], kinds[j + 1] = cut, kind
    return count


@part_of
def clamped_end(v, height, kind):
    """Clamped v of an end of a part of an edge.

    A cut by v is on the border, to the error of its root: the integral must end there, or that
    error would be multiplied by u.
    """
    if kind == LEVEL_V:
        v = 0.0 if v < 0.5 * height else height
    return min(max(v, 0.0), height)


@called_whole
def clamped_edge(plane, edge, n, stray, scratch):
    """Integral of clamp(u, 0, W) d clamp(v, 0, H) along the image of an edge, px^2, and its pieces.

    `scratch.U` and `scratch.V` are the values at the nodes of the edge, and lost. An arc between
    two nodes leaves its chord by `stray` at most, px.
    """
    U, V, W, H, cuts, kinds = (
        scratch.U, scratch.V, plane.width, plane.height, scratch.cuts, scratch.kinds,
    )  # fmt: skip
    is_in = True
    for k in range(n + 1):
        is_in = is_in and 0.0 < U[k] < W and 0.0 < V[k] < H
    count = find_cuts(plane, edge, n, stray, scratch)
    if count == 0 and is_in:
        return under_edge(n, U, V, 0.0), 1
    total, start, start_kind = 0.0, 0.0, NO_LEVEL
    for i in range(count + 1):
        end, end_kind = (cuts[i], kinds[i]) if i < count else (1.0, np.int64(NO_LEVEL))
        if end > start:
            part = part_of_edge(edge, start, end)
            u, v = U[n // 2], V[n // 2]
            if count > 0:
                u, v = node_value(plane, part, n, n // 2)
            if u > 0.0 and 0.0 < v < H:
                if count > 0:
                    values_together(plane, part, n, scratch)
                first, last = clamped_end(V[0], H, start_kind), clamped_end(V[n], H, end_kind)
                if u >= W:
                    total += W * (last - first)
                else:
                    total += under_edge(n, U, V, 0.0)
                    total += U[0] * (V[0] - first) + U[n] * (last - V[n])
        start, start_kind = end, end_kind
    return total, count + 1
