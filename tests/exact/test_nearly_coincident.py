"""Copies of a surface that nearly coincide: what one of them loses, another one gains."""

import numpy as np
import pytest
from exact_views import PATHS, HalfPlanes, look
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import surface_of

import rastercov as rc
from rastercov.reference import rational

pytestmark = pytest.mark.native
CAMERA = rc.Camera(width=640, height=480, fx=600, fy=600, cx=320, cy=240)
TRIANGLE = np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])


def copies(n, moved, seed, offset=0.0):
    """A triangle n times, each corner moved at random."""
    random = np.random.default_rng(seed)
    corners = TRIANGLE + offset + moved * random.standard_normal((n, 3, 3))
    return rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))


def solved(mesh, offset=0.0):
    """Visible areas and their bounds, px^2."""
    solver = HalfPlanes(surface_of(mesh), CAMERA)
    eye, target = np.array([[0.3, -0.4, 3.0]]) + offset, np.zeros((1, 3)) + offset
    solver.solve(rc.look_at(eye, target)[0], 1e-3, False)
    return solver.visible, solver.area_error, solver.area


@settings(max_examples=25, deadline=None)
@given(
    n=st.integers(3, 150), exponent=st.floats(-16, -6), seed=st.integers(0, 2**32 - 1),
    offset=st.sampled_from([0.0, 100.0]),
)  # fmt: skip
def test_copies_together_are_seen_as_the_face(n, exponent, seed, offset):
    """Whatever the distance: ties are not transitive, so that indices alone hid a part from all.

    Two alone may be as far apart as just counts as one, which only the bound says.
    """
    moved = 10**exponent
    visible, error, area = solved(copies(n, moved, seed, offset), offset)
    # Borders move by some deviations, px; the bounds are of rounding.
    border = 2000 * 6 * moved * 600 / 2
    assert abs(visible.sum() - area.max()) <= 1e-6 * area.max() + border
    assert error.sum() <= 1e-6 * area.max() * n


@pytest.mark.parametrize("moved", [1e-12, 3e-11, 1e-10, 1e-9, 1e-7])
def test_many_copies_leave_few_pieces(moved):
    visible, error, area = solved(copies(600, moved, 1))
    assert abs(visible.sum() - area.max()) <= 1e-6 * area.max() + 2000 * 6 * moved * 300
    assert error.sum() <= 1e-6 * area.max()


@pytest.mark.parametrize("moved", [0.0, 1e-16, 1e-15, 1e-14, 1e-13])
def test_the_lowest_of_copies_that_coincide_is_seen(moved):
    visible, _, area = solved(copies(20, moved, 2))
    np.testing.assert_allclose(visible[0], area[0], rtol=1e-9)
    assert visible[1:].max() <= 1e-6


NEVER = 10**40
"""No two depths differ by so little, relative to them, that they count as one."""


@settings(max_examples=12, deadline=None)
@given(
    n=st.integers(2, 9), exponent=st.floats(-10.5, -7.5), seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["copies", "sizes", "shifted"]),
)  # fmt: skip
def test_copies_are_within_their_bounds_of_exact_fractions(n, exponent, seed, kind):
    """By the lower index if all that coincide do so with one another, and by depth if not."""
    random = np.random.default_rng(seed)
    corners = TRIANGLE + np.zeros((n, 1, 1))
    if kind == "sizes":
        corners = TRIANGLE * random.uniform(0.2, 1.2, (n, 1, 1))
    elif kind == "shifted":
        corners[..., :2] += random.uniform(-0.5, 0.5, (n, 1, 2))
        corners[..., 2] = corners[..., :2] @ (0.1, -0.2)
    corners = corners + 10**exponent * random.standard_normal((n, 3, 3))
    mesh = rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))
    eye = np.array([[0.3, -0.4, 3.0]]) + 0.3 * random.standard_normal(3)
    pose = rc.look_at(eye, np.zeros((1, 3)))[0]
    area = rational.image_area(mesh, CAMERA, pose)
    with pytest.MonkeyPatch.context() as patch:
        by_index = rational.visible_area(mesh, CAMERA, pose)
        patch.setattr(rational, "TIE", NEVER)
        by_depth = rational.visible_area(mesh, CAMERA, pose)
    for path in PATHS:
        view = look(mesh, CAMERA, pose, path)
        off = np.minimum(*(np.abs(view.visible - each) for each in (by_index, by_depth)))
        assert (off + np.abs(view.area - area) <= view.area_error + 1e-12).all()
