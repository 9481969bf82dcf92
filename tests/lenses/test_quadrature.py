"""The rule of an edge: its exactness, its bound, and the search for roots along it."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lens_cases import (
    bounds_of,
    is_outside_hole,
    of_all_kinds,
    pixels_of_plane,
    points_of,
    rays_of_plane,
)
from nightly import amount
from numpy.polynomial import chebyshev, legendre

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.lenses.planes import planes_in
from rastercov.engine import lens_edges as kernels
from rastercov.engine import lens_proof
from rastercov.engine.lens_edges import FEWEST, MOST
from rastercov.engine.lens_proof import DEGREES

pytestmark = pytest.mark.native
LENSES = of_all_kinds()
FINE = 40
NODES, RULE = np.empty((MOST + 1, MOST + 1)), np.empty((MOST + 1, MOST + 1, MOST + 1))
kernels.rules(NODES, RULE)
PAIR_ERRORS = np.empty((MOST + 1, DEGREES + 1, DEGREES + 1))
lens_proof.pair_errors(PAIR_ERRORS)


@cache
def edge_tables(lens, tolerance=1e-9):
    """Records of the planes of a lens whose edges are off by at most a tolerance, px^2."""
    return [each.record for each in planes_in(lens.row_within(tolerance, 1e-3))]


def lobatto(n):
    """Nodes in [0, 1], the matrix S, and Bernstein coefficients from values at the nodes."""
    unit = np.eye(n + 1)[n]
    inner = np.sort(legendre.legroots(legendre.legder(unit)).real)
    x = np.concatenate(([-1.0], inner, [1.0]))
    x = (x - x[::-1]) / 2
    values = legendre.legvander(x, n)
    slopes = np.column_stack([legendre.legval(x, legendre.legder(row)) for row in np.eye(n + 1)])
    weights = 2 / (n * (n + 1) * legendre.legval(x, unit) ** 2)
    product = weights[:, None] * (slopes @ np.linalg.inv(values))
    t = (x + 1) / 2
    basis = [math.comb(n, k) * t**k * t[::-1] ** (n - k) for k in range(n + 1)]
    return t, (product - product.T) / 2, np.linalg.inv(np.column_stack(basis))


@cache
def exact(a, b):
    """Integral of half (T_a dT_b - T_b dT_a) over [-1, 1], less that of the chord."""
    ta, tb = np.eye(a + 1)[a], np.eye(b + 1)[b]
    product = chebyshev.chebmul(ta, chebyshev.chebder(tb) if b else [0.0])
    product = chebyshev.chebsub(
        product, chebyshev.chebmul(tb, chebyshev.chebder(ta) if a else [0.0])
    )
    whole = chebyshev.chebint(product) / 2
    return chebyshev.chebval(1, whole) - chebyshev.chebval(-1, whole)


every_rule = pytest.mark.parametrize("n", range(FEWEST, MOST + 1))


@every_rule
def test_nodes_are_symmetric_and_weights_are_not(n):
    rule = RULE[n, : n + 1, : n + 1]
    assert np.abs(NODES[n, : n + 1] + NODES[n, n::-1] - 1).max() <= 2.3e-16
    assert (NODES[n, 0], NODES[n, n]) == (0, 1)
    # So the bound of errors holds for all degrees: the integral is at most a + b.
    assert np.abs(rule).sum() <= 8 * n
    assert np.abs(rule + rule.T).max() == 0


@every_rule
def test_rules_are_derived_from_legendre_polynomials(n):
    own = slice(n + 1)
    nodes, rule, bernstein = lobatto(n)
    np.testing.assert_allclose(NODES[n, own], nodes, rtol=0, atol=1e-15)
    np.testing.assert_allclose(RULE[n, own, own], rule, rtol=0, atol=1e-14)
    result = np.empty((n + 1, n + 1))
    for values, coefficients in zip(np.eye(n + 1), result, strict=True):
        kernels.bernstein_of(values, 0.0, coefficients)
    np.testing.assert_allclose(result.T, bernstein, rtol=1e-11, atol=1e-11)


@pytest.mark.slow
@every_rule
def test_errors_of_pairs_are_those_of_the_rule(n):
    x, rule, _ = lobatto(n)
    at = [chebyshev.chebval(2 * x - 1, np.eye(k + 1)[k]) for k in range(40)]
    for a in range(40):
        for b in range(40):
            # The sum over j < i counts each pair of an antisymmetric rule once.
            error = abs((at[a] - at[a][0]) @ rule @ (at[b] - at[b][0]) - bulge_of(a, b))
            assert error <= 2 * (a + b) + 8 * n
            if a + b <= 2 * n:
                assert error < 1e-11
            if a + b <= DEGREES:
                assert error - 1e-10 <= PAIR_ERRORS[n, a, b] <= error + 1e-9


def bulge_of(a, b):
    """Bulge of u = T_a, v = T_b: the integral, less the triangle with the start of the edge."""
    start = (-1.0) ** a, (-1.0) ** b
    return exact(a, b) - 0.5 * (start[0] * (1 - start[1]) - start[1] * (1 - start[0]))


def bulges(plane, a, b, n, rule, nodes):
    """Bulges of edges from a to b, (N, 2) each, px^2, by numpy."""
    t = nodes[:, None, None]
    u, v = np.moveaxis(pixels_of_plane(plane, (1 - t) * a + t * b), -1, 0)
    return np.einsum("in,ij,jn->n", u - u[0], rule, v - v[0])


FEW = amount(50, at_night=150)
"""Edges of each plane whose own bound is asked for."""


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_bound_of_an_edge_holds(name):
    """Against n = 40, for edges of all lengths and directions; the table's choice, too."""
    lens = LENSES[name]
    rng = np.random.default_rng(len(name))
    fine = lobatto(FINE)
    tightest = math.inf
    for k, plane in enumerate(lens.planes):
        known = bounds_of(plane)
        table = edge_tables(lens, 1e-6)[k]
        a, b = (points_of(plane, amount(150, 4000), rng) for _ in range(2))
        is_edge = (a != b).any(axis=1)  # not the same corner of the region twice
        a, b = a[is_edge], b[is_edge]
        half = 10 ** rng.uniform(-3.5, -0.3, (len(a), 1))
        b = a + 2 * half * (b - a) / np.hypot(*(b - a).T)[:, None]
        far = is_outside_hole(plane, (a + b) / 2, half[:, 0])
        a, b, half = a[far], b[far], half[far]
        rays = rays_of_plane(plane, np.stack((a, b, (a + b) / 2)))
        inside = np.isfinite(lens.project(rays)).all(axis=(0, 2))
        inside &= np.abs(b).max(axis=1) <= np.abs(plane.region).max()
        if plane.is_graded:
            side = np.sign(plane.region[:, 0].sum())
            inside &= (b[:, 0] * side > 0) & (a[:, 0] * side > 0)
        a, b, half = a[inside], b[inside], half[inside, 0]
        unit = np.hypot(*((a + b) / 2).T) if plane.is_graded else np.ones(len(a))
        wanted = bulges(plane, a, b, FINE, fine[1], fine[0])
        scale = 1e-12 * (1 + np.abs(wanted)) + 1e-10 * lens.width * half
        for n in (2, 3, 4, 5, 7, 9, 11):
            own = slice(n + 1)
            error = np.abs(bulges(plane, a, b, n, RULE[n, own, own], NODES[n, own]) - wanted)
            bound = [
                lens_proof.edge_error(*known, h / u, n)
                for h, u in zip(half[:FEW], unit[:FEW], strict=True)
            ]
            bound = np.array(bound)
            assert (error[:FEW] <= bound + scale[:FEW]).all()
            is_short = half <= table.longest[n] * unit
            assert (error[is_short] <= table.tolerance + scale[is_short]).all()
            is_clear = (error[:FEW] > 10 * scale[:FEW]) & (bound < math.inf)
            ratio = bound[is_clear] / error[:FEW][is_clear]
            tightest = min(tightest, ratio.min(initial=math.inf))
    # Edges are long enough to show an error, unless straight ones stay straight.
    assert tightest < 1e9 or "PINHOLE" in name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "distortion"), [("omni", (0.4,)), ("eucm", (0.3, 1.0)), ("double_sphere", (0.3, 0.3))]
)
def test_a_pole_behind_a_wide_lens_does_not_end_its_bounds(model, distortion):
    lens = lens_of(
        Camera(
            width=1000, height=1000, fx=150, fy=150, model=model, distortion=distortion,
            max_angle_deg=95,
        )
    )  # fmt: skip
    assert math.degrees(lens.valid_angle) == pytest.approx(95)
    assert all(each.record.longest.max() > 0.01 for each in lens.proved)
    side = next(plane for plane in lens.planes if len(plane.hole))
    # All places of the region are in cells that are kept, and cells far from it are not.
    half = (0.02, 0.02)
    middle = np.arange(-0.98, 1, 0.04)
    x, y = (grid.ravel() for grid in np.meshgrid(middle, middle))
    points = np.random.default_rng(1).uniform(-1, 1, (40_000, 2))
    points = points[~np.isnan(lens.project(rays_of_plane(side, points))[:, 0])]
    cells = np.round((points + 0.98) / 0.04).astype(int)
    is_kept = side.meets(x, y, half).reshape(50, 50)
    assert is_kept[cells[:, 1], cells[:, 0]].all()
    rays = rays_of_plane(side, np.column_stack((x, y)))
    cosine = rays[:, 2] / np.linalg.norm(rays, axis=1)
    assert cosine[is_kept.ravel()].min() > math.cos(math.radians(99))


def test_tables_allow_longer_edges_with_more_nodes():
    table = edge_tables(LENSES["opencv brown"])[0]
    assert (np.diff(table.longest[FEWEST:]) >= 0).all()
    assert (np.diff(table.longest[FEWEST:8]) > 0).all()
    loose = edge_tables(LENSES["opencv brown"], tolerance=1e-6)[0]
    assert (loose.longest[FEWEST:] > table.longest[FEWEST:]).all()
    assert kernels.nodes_for(table.longest[3], table.longest, table.parts_of) == (3, 1)
    n, parts = kernels.nodes_for(10 * table.longest[MOST], table.longest, table.parts_of)
    assert n == table.parts_of
    assert 10 * table.longest[MOST] / parts <= table.longest[n]


@pytest.mark.parametrize("longest", [-1e-30, -0.0, 0.0, math.nan, -math.inf])
def test_a_table_that_is_none_gives_a_number_of_parts(longest):
    n, parts = kernels.nodes_for(1.0, np.full(MOST + 1, longest), FEWEST)
    assert (n, parts) == (FEWEST, 1 << 18)


def roots(values, level):
    """Places where the polynomial through values at its nodes takes a level."""
    coefficients, places = np.empty(len(values)), np.empty(kernels.MOST_CUTS)
    kernels.bernstein_of(values, level, coefficients)
    return np.sort(places[: kernels.roots(coefficients, places)])


@settings(max_examples=25)
@given(
    st.integers(FEWEST, MOST),
    st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=6),
    st.floats(0.1, 1000),
    st.floats(-100, 100),
)
@example(3, [0.25, 0.2, 0.2], 1.0, 0.0)
@example(3, [0.5, 2.0, 2.0], 1.0, 0.0)
@example(2, [0.5, -(2.0**-1022)], 1.0, 0.0)  # it is next to 0 at an end, which is not the root
def test_roots_are_found(n, places, scale, level):
    places = np.sort(places[:n])
    t = NODES[n, : n + 1]
    result = roots(level + scale * np.prod([t - place for place in places], axis=0), level)
    fine = np.linspace(0, 1, 2001)
    at = scale * np.prod([fine - place for place in places], axis=0)
    # Between the roots that were found the polynomial keeps its sign, to rounding.
    part = np.searchsorted(result, fine)
    noise = max(2 * kernels.FLAT, 1e-13 * (abs(level) + scale))
    near = np.abs(fine[:, None] - result).min(axis=1, initial=1.0) < 1e-9
    for k in range(len(result) + 1):
        own = at[(part == k) & ~near]
        assert not ((own > noise).any() and (own < -noise).any())
    # And there are no more than it has, unless it is flat there.
    for root in result:
        slack = np.abs(np.prod([root - place for place in places])) * scale
        assert slack <= 1e-9 * (1 + scale + abs(level))


def test_a_flat_edge_has_no_root():
    assert len(roots(np.zeros(6), 0.0)) == 0
    assert len(roots(1e-12 * np.array([1.0, -1, 1, -1, 1, -1]), 0.0)) == 0


@pytest.mark.parametrize("half", [0.0, 1e-300, 1e-9, 0.1, 1e300])
@pytest.mark.parametrize("size", [1.0, 1e200, math.inf])
@pytest.mark.parametrize("known", [0.0, 1e300, math.inf])
def test_a_bound_of_any_edge_is_found(half, size, known):
    bounds = np.array([(0.2, size, size)]), np.full((2, 19), known)
    edge_errors = [lens_proof.edge_error(*bounds, half, n) for n in range(FEWEST, MOST + 1)]
    assert all(error >= 0 for error in edge_errors)
    assert half < 0.2 or all(math.isinf(error) for error in edge_errors)
    nothing = np.empty((0, 3)), np.full((2, 5), math.inf)
    assert lens_proof.edge_error(*nothing, 1.0, FEWEST) == math.inf
