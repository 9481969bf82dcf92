"""Arithmetic in pairs of doubles, about 106 bits, for differences that cancel all digits of one.

`exact_setup` needs it where the camera centre lies on a face to the last digit: doubles do
not determine the plane of the face through the camera centre, pairs do. A pair (high, low) is the
number high + low, where high is that sum rounded. All functions take and return scalars, so that
they compile into the loop that calls them.

T. J. Dekker. A Floating-Point Technique for Extending the Available Precision. 1971.
M. Joldes, J.-M. Muller, V. Popescu. Tight and Rigorous Error Bounds for Basic Building Blocks of
Double-Word Arithmetic. 2017: the relative error of a sum is below 3 * 2^-106 of the greater term,
that of a product below 5 * 2^-106.
"""

from rastercov.kernels.jit import part_of

SPLITTER = 2.0**27 + 1


@part_of
def exact_sum(a, b):
    """Pair equal to the sum of two doubles (Knuth's TwoSum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@part_of
def exact_product(a, b):
    """Pair equal to the product of two doubles below 2^500 (Dekker), except for underflow."""
    product = a * b
    scaled = SPLITTER * a
    a_high = scaled - (scaled - a)
    a_low = a - a_high
    scaled = SPLITTER * b
    b_high = scaled - (scaled - b)
    b_low = b - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, rest


@part_of
def add(a_high, a_low, b_high, b_low):
    """Sum of two pairs."""
    high, low = exact_sum(a_high, b_high)
    more, less = exact_sum(a_low, b_low)
    low += more
    total = high + low
    low += high - total
    low += less
    return exact_sum(total, low)


@part_of
def multiply(a_high, a_low, b_high, b_low):
    """Product of two pairs."""
    high, low = exact_product(a_high, b_high)
    low += a_high * b_low + a_low * b_high
    return exact_sum(high, low)


@part_of
def minor(a_high, a_low, d_high, d_low, b_high, b_low, c_high, c_low):
    """2 x 2 determinant a d - b c of pairs; exchanging its rows negates it to the bit."""
    first, first_low = multiply(a_high, a_low, d_high, d_low)
    second, second_low = multiply(b_high, b_low, c_high, c_low)
    return add(first, first_low, -second, -second_low)
