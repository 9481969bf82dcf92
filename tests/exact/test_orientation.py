"""Exact side of a face that a point sees, against fractions."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rastercov.engine.exact_setup import side_seen

pytestmark = pytest.mark.native

NOT_KNOWN = 2
COORDINATE = st.one_of(
    st.integers(-8, 8).map(float),
    st.floats(-1e9, 1e9),
    st.floats(-1.0, 1.0).map(lambda x: x * 2.0**-40),
).filter(lambda x: x == 0 or abs(x) > 1e-60)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)
SHARE = st.floats(-4, 4).map(lambda x: round(x, 6))


def side_of(points):
    """1 where the last of four points is before the face of the first three, -1 behind, else 0."""
    *corners, eye = ([Fraction(x) for x in point] for point in points)
    a, b, c = ([x - y for x, y in zip(corner, eye, strict=True)] for corner in corners)
    volume = sum(a[k] * (b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2]) for k in range(3))
    return (volume < 0) - (volume > 0)


def seen(points):
    return side_seen(*(np.array(point, np.float64) for point in points))


@given(points=st.tuples(POINT, POINT, POINT, POINT))
@example(points=((0.0, 0.0, 5e-324), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (3.0, 4.0, 0.0)))
def test_the_side_of_any_point_is_that_of_fractions(points):
    assert seen(points) == side_of(points)


@given(
    points=st.tuples(POINT, POINT, POINT), along=st.tuples(SHARE, SHARE),
    ulps=st.tuples(*3 * [st.integers(-2, 2)]),
)  # fmt: skip
def test_the_side_of_a_point_in_the_plane_to_rounding_is_that_of_fractions(points, along, ulps):
    a, b, c = np.array(points)
    eye = a + along[0] * (b - a) + along[1] * (c - a)
    eye += np.array(ulps) * np.spacing(np.maximum(np.abs(eye), 1.0))
    assert seen((a, b, c, eye)) == side_of((a.tolist(), b.tolist(), c.tolist(), eye.tolist()))


@pytest.mark.parametrize("scale", [2.0**-300, 1.0, 2.0**300])
def test_a_face_seen_edge_on_has_no_side_at_any_scale(scale):
    points = np.array([(1, 2, 3), (4, 6, 3), (-2, 9, 3), (100, -7, 3)]) * (scale / 3)
    assert seen(points) == 0
    points[3, 2] = np.nextafter(points[3, 2], np.inf)
    assert seen(points) == 1


def test_what_underflows_is_not_known():
    tiny = 1e-280
    points = ((tiny, 0.0, tiny), (0.0, tiny, tiny), (tiny, tiny, tiny), (1.0, 1.0, 1.0))
    assert seen(points) in (side_of(points), NOT_KNOWN)
    apart = ((1e300, 0.0, 0.0), (0.0, 1e-300, 0.0), (0.0, 0.0, 1e-300), (0.0, 0.0, 0.0))
    assert seen(apart) in (side_of(apart), NOT_KNOWN)
