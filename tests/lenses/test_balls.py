"""Balls hold all values of a lens at complex points near a real one, and bounds hold with them."""

import math
from types import FunctionType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_cases import (
    bounds_of,
    is_outside_hole,
    of_all_kinds,
    pixels_of_plane,
    points_of,
    rays_of_plane,
)

from rastercov.engine import lens_proof
from rastercov.reference import lenses

LENSES = of_all_kinds()


@pytest.fixture(params=LENSES)
def lens(request):
    return LENSES[request.param]


def complex_atan2(y, x):
    """atan2 at complex points next to real ones with the same branch."""
    angle = np.arctan2(y.real, x.real)
    turned = (np.cos(angle) * y - np.sin(angle) * x) / (np.cos(angle) * x + np.sin(angle) * y)
    return angle + np.arctan(turned)


def complex_angle_over_r(r2, z):
    r = np.sqrt(r2)
    return complex_atan2(r, z + 0 * r) / r


def project_on(primitives):
    """`lenses.project` on another arithmetic, given `sqrt`, `atan2` and `angle_over_r` on it."""
    space = {**vars(lenses), **primitives}
    names = "image_of_base", "radial_factor", "distort", "image_of", "project"
    for name in names:  # in the order in which they call one another
        space[name] = FunctionType(getattr(lenses, name).__code__, space, name)
    return space["project"]


COMPLEX = project_on(
    {
        "sqrt": np.sqrt,
        "atan2": complex_atan2,
        "angle_over_r": complex_angle_over_r,
    }
)


def inner_points(plane, n, rng):
    """Random points of the region of a plane, outside its hole."""
    points = points_of(plane, n, rng)
    return points[is_outside_hole(plane, points)]


def reach_at(plane, points, radius):
    """(2, N) bounds around points (N, 2) of a plane, within radii."""
    each = zip(*points.T.tolist(), radius.tolist(), strict=True)
    return np.array([lens_proof.reach_at(plane, *numbers) for numbers in each]).reshape(-1, 2).T


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_values_at_complex_points_are_within_reach(name):
    lens, rng = LENSES[name], np.random.default_rng(7)
    for plane in lens.planes:
        points = inner_points(plane, 60, rng)
        for radius in (0.003, 0.03, 0.1):
            off = np.sqrt(rng.uniform(0, 1, (2, 20, len(points))))
            turn = np.exp(2j * np.pi * rng.uniform(0, 1, off.shape))
            own = radius * np.ones(len(points))
            if plane.is_graded:
                own = radius * np.hypot(*points.T)
            near = points.T[:, None] + own * off * turn
            reach = reach_at(plane, points, own)
            rays = np.stack((*near, 1 + 0 * near[0]), axis=-1) @ plane.frame.T
            with np.errstate(all="ignore"):
                at = COMPLEX(plane.code, plane.params, *np.moveaxis(rays, -1, 0))
                real = pixels_of_plane(plane, points).T
            for k in range(2):
                far = np.abs(at[k] - real[k])
                is_good = reach[k] < np.inf
                assert (far[:, is_good] <= reach[k][is_good] * (1 + 1e-9) + 1e-9).all()
                # One bound for the plane holds for all of its points.
                assert lens_proof.reach(plane, radius)[k] >= reach[k].max(initial=0.0) * (1 - 1e-9)


@pytest.mark.slow
def test_bounds_of_small_balls_are_close_to_the_derivative(lens):
    rng = np.random.default_rng(8)
    plane = lens.planes[0]
    points = inner_points(plane, 200, rng) * 0.9
    radius = 1e-5
    reach = reach_at(plane, points, np.full(len(points), radius))
    slopes = lens.jacobian(rays_of_plane(plane, points)) @ plane.frame[:, :2]
    for k in range(2):
        largest = radius * np.abs(slopes[:, k]).sum(axis=1)  # both coordinates move
        assert (reach[k] >= largest * (1 - 1e-6)).all()
        assert np.median(reach[k] / largest) < 12


@pytest.mark.slow
def test_an_edge_bends_no_more_than_its_bound(lens):
    rng = np.random.default_rng(9)
    for plane in lens.planes:
        if plane.is_graded:
            continue  # a pole bends edges without limit
        bend = min(2 * math.hypot(u, v) / (r * r) for r, u, v in bounds_of(plane)[0])
        assert bend < math.inf
        ends = inner_points(plane, 400, rng)
        ends = ends[: len(ends) // 2 * 2].reshape(2, -1, 2)
        length = rng.uniform(0.001, 0.1, (ends.shape[1], 1))
        towards = ends[1] - ends[0]
        towards *= length / np.hypot(*towards.T)[:, None]
        a, b = ends[0], ends[0] + towards
        seen = pixels_of_plane(plane, np.stack((a, (a + b) / 2, b)))
        chord = np.linalg.norm(seen[1] - (seen[0] + seen[2]) / 2, axis=1)
        bound = bend * length[:, 0] ** 2 / 8
        is_valid = np.isfinite(lens.project(rays_of_plane(plane, b))).all(axis=1)
        assert (chord[is_valid] <= bound[is_valid] * (1 + 1e-9) + 1e-9).all()


NUMBERS = st.complex_numbers(max_magnitude=5, allow_nan=False)
RADII = st.floats(0, 2)
SHARES = st.tuples(st.floats(0, 1), st.floats(0, 2 * math.pi))


@settings(max_examples=25)
@given(NUMBERS, RADII, SHARES, NUMBERS, RADII, SHARES)
def test_balls_hold_all_results(a, r, s, b, q, t):
    z = a + r * s[0] * np.exp(1j * s[1])
    w = b + q * t[0] * np.exp(1j * t[1])
    one, other = (np.array([each.real, each.imag, off]) for each, off in ((a, r), (b, q)))
    result = np.empty((6, 3))
    lens_proof.combine_balls(one, other, result)
    with np.errstate(all="ignore"):
        values = z + w, z - w, z * w, np.divide(z, w), np.sqrt(z), np.arctan(z)
    for (real, imaginary, radius), value in zip(result, values, strict=True):
        slack = 1e-12 * (1 + abs(value))
        if radius < np.inf:
            assert abs(complex(real, imaginary) - value) <= radius * (1 + 1e-9) + slack
