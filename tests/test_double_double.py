"""Pairs of doubles against fractions: sums and products to 2^-104, differences that cancel."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.engine import exact_setup as dd

NUMBERS = st.floats(-1e100, 1e100).filter(lambda x: x == 0 or abs(x) > 1e-100)
TINY = st.floats(-(2.0**-54), 2.0**-54)


def exact(pair):
    high, low = pair
    return Fraction(high) + Fraction(low)


def pair(high, part):
    """The number `high` (1 + `part`) in two doubles that do not overlap."""
    low = high * part
    return (high, low) if high + low == high else (high, 0.0)


@given(a=NUMBERS, b=NUMBERS)
def test_the_sum_and_the_product_of_two_doubles_are_exact(a, b):
    a_and_b = Fraction(a) + Fraction(b), Fraction(a) * Fraction(b)
    assert (exact(dd.exact_sum(a, b)), exact(dd.exact_product(a, b))) == a_and_b


@pytest.mark.slow
@given(a=NUMBERS, b=NUMBERS, s=TINY, t=TINY)
def test_sums_and_products_of_pairs_lose_no_more_than_they_say(a, b, s, t):
    one, other = pair(a, s), pair(b, t)
    x, y = exact(one), exact(other)
    assert abs(exact(dd.add(one, other)) - x - y) <= 3 * max(abs(x), abs(y)) / 2**105
    assert abs(exact(dd.multiply(one, other)) - x * y) <= 5 * abs(x * y) / 2**106


@pytest.mark.slow
@given(a=NUMBERS, b=NUMBERS, c=NUMBERS, d=NUMBERS)
def test_exchanging_rows_negates_a_determinant_to_the_bit(a, b, c, d):
    high, low = dd.minor(a, d, b, c)
    other_high, other_low = dd.minor(c, b, d, a)
    assert (other_high, other_low) == (-high, -low)


@pytest.mark.parametrize("power", [30, 60, 90])
def test_a_determinant_keeps_what_doubles_cancel(power):
    a = 1 + 2.0 ** -(power // 2)
    # (1 + e)(1 - e) - 1 = -e^2, of which doubles keep nothing from e = 2^-27 on
    high, low = dd.minor(a, 2 - a, 1.0, 1.0)
    assert exact((high, low)) == -(Fraction(2) ** -(2 * (power // 2)))
    if power > 54:
        assert np.float64(a) * np.float64(2 - a) - 1.0 == 0.0
