"""Bounds of Taylor coefficients: no segment of a line has a greater one, and some nearly as great.

The Chebyshev coefficients of a function on a segment of half a length h are at most 2 (h / 2)^k
times the greatest Taylor coefficient on it, and nearly that for a short one.
"""

import numpy as np
import pytest
from lens_cases import bounds_of, is_outside_hole, of_all_kinds, pixels_of_plane, points_of
from nightly import amount

from rastercov.engine import lens_proof
from rastercov.engine.lens_proof import LINES, ORDER

LENSES = of_all_kinds()
NODES = 32


def segments(plane, half, n, rng):
    """Middles and ends (2, N, 2) of segments of the region, outside its hole."""
    points = points_of(plane, n, rng)
    turn = rng.uniform(0, 2 * np.pi, n)
    along = half * np.column_stack((np.cos(turn), np.sin(turn)))
    is_good = np.ones(n, np.bool_)
    for sign in (-1, 1):
        is_good &= plane.meets(*(points + sign * along).T, (0.0, 0.0))
    is_good &= plane.meets(*points.T, (0.0, 0.0))
    is_good &= is_outside_hole(plane, points, half)
    return points[is_good], along[is_good]


def chebyshev_coefficients(plane, middle, along):
    """(2, NODES, N) coefficients of u and v on segments."""
    k = np.arange(NODES)
    angle = np.pi * (k + 0.5) / NODES
    values = pixels_of_plane(plane, middle + np.cos(angle)[:, None, None] * along)
    return 2 / NODES * np.einsum("kj,jnc->ckn", np.cos(k[:, None] * angle), values)


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_no_coefficient_is_above_its_bound(name):
    rng, k = np.random.default_rng(3), np.arange(1, ORDER + 1)
    for plane in LENSES[name].planes:
        bounds = bounds_of(plane)[1]
        if plane.is_graded:
            assert np.isinf(bounds).all()
            continue
        assert np.isinf(bounds[:, 0]).all()
        assert np.isfinite(bounds[:, 1:]).all()
        for half in (0.3, 0.1, 0.03):
            ends = segments(plane, half, amount(300, at_night=1000), rng)
            values = np.abs(chebyshev_coefficients(plane, *ends))
            allowed = 2 * (half / 2) ** k * bounds[:, 1:]
            assert (values[:, 1 : ORDER + 1] <= allowed[:, :, None] + 1e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["opencv brown", "opencv fisheye", "kalibr ds", "colmap FOV"])
def test_bounds_are_near_the_truth(name):
    rng, k = np.random.default_rng(4), np.arange(1, 5)
    for plane in LENSES[name].planes[:1]:
        values = np.abs(chebyshev_coefficients(plane, *segments(plane, 0.05, 4000, rng)))
        truth = values[:, 1:5].max(axis=2) / (2 * (0.05 / 2) ** k)[:, None].T
        assert (bounds_of(plane)[1][:, 1:5] <= 4 * truth).all()


@pytest.mark.parametrize("operation", ["product", "quotient", "root"])
def test_expansions_hold_those_of_all_points(operation):
    """Against numpy's polynomials, of coefficients anywhere in the intervals."""
    rng = np.random.default_rng(5)
    centre = rng.uniform(-1, 1, (2, 4, LINES))
    centre[:, 0] += 4
    width = np.array([0.3, 0.2, 0.0, 0.1])[:, None] * rng.uniform(0, 1, (2, 4, LINES))
    one, two = np.stack((centre, width), axis=1)
    out = np.empty((3, 2, ORDER + 1, LINES))
    lens_proof.combine_series(np.ascontiguousarray(one), np.ascontiguousarray(two), out)
    power = {"product": None, "quotient": -1, "root": 0.5}[operation]
    result, radius = out[["product", "quotient", "root"].index(operation)]
    for _ in range(20):
        a, b = centre + width * rng.choice([-1, -0.5, 1], width.shape)
        true = np.zeros((7 if power is None else ORDER + 1, LINES))
        for n in range(len(true)):
            terms = (
                range(max(0, n - 3), min(n, 3) + 1) if power is None else range(1, min(n, 3) + 1)
            )
            if power is None:
                true[n] = sum(a[i] * b[n - i] for i in terms)
            elif n == 0:
                true[n] = a[0] ** power
            else:  # a power of a polynomial from its logarithmic derivative
                true[n] = sum((power * i - (n - i)) * a[i] * true[n - i] for i in terms)
                true[n] /= n * a[0]
        assert not result[len(true) :].any()
        off = np.abs(true - result[: len(true)])
        assert (off <= radius[: len(true)] + 1e-12 * (1 + np.abs(true))).all()
