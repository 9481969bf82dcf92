// Pairs of doubles.
//
// A pair (high, low) is the number high + low, where high is that sum rounded: about 106 bits.
//
// T. J. Dekker. A Floating-Point Technique for Extending the Available Precision. 1971.
// M. Joldes, J.-M. Muller, V. Popescu. Tight and Rigorous Error Bounds for Basic Building Blocks of
// Double-Word Arithmetic. 2017: the relative error of a sum is below 3 * 2^-106 of the greater
// term, that of a product below 5 * 2^-106.
//
// Invariant: no operation here is contracted or reordered; tests hold that of the compiler's flags.
//
// Twins: tests/test_double_double.py, with fractions.
#pragma once
#include <algorithm>
#include <cmath>

namespace rastercov::exact {

constexpr double SPLITTER = 0x1p27 + 1;

struct Pair {
    double high, low;
    Pair operator-() const { return {-high, -low}; }
};

// Pair equal to the sum of two doubles (Knuth's TwoSum).
inline Pair exact_sum(double a, double b) {
    const double total = a + b;
    const double part = total - a;
    return {total, (a - (total - part)) + (b - part)};
}

// Pair equal to the product of two doubles below 2^500 (Dekker), except for underflow.
inline Pair exact_product(double a, double b) {
    const double product = a * b;
    double scaled = SPLITTER * a;
    const double a_high = scaled - (scaled - a), a_low = a - a_high;
    scaled = SPLITTER * b;
    const double b_high = scaled - (scaled - b), b_low = b - b_high;
    return {product,
            ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low};
}

inline Pair operator+(Pair a, Pair b) {
    auto [high, low] = exact_sum(a.high, b.high);
    const auto [more, less] = exact_sum(a.low, b.low);
    low += more;
    const double total = high + low;
    low += high - total;
    low += less;
    return exact_sum(total, low);
}

inline Pair operator*(Pair a, Pair b) {
    auto [high, low] = exact_product(a.high, b.high);
    low += a.high * b.low + a.low * b.high;
    return exact_sum(high, low);
}

// Determinant a d - b c; exchanging its rows negates it to the bit.
inline Pair minor_of(Pair a, Pair d, Pair b, Pair c) { return a * d + -(b * c); }

} // namespace rastercov::exact
