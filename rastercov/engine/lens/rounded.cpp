// Functions that round alike everywhere.
//
// Twin: tests/native/test_c_border.py.
//
// Sines that are rounded once are what nearly all results of other libraries of C are: borders of
// the angle of incidence have their bits.
#include "lens/rounded.hpp"
#include <algorithm>
#include <cstdint>
#include <limits>

namespace rastercov::rounded {
namespace {

struct Twin {
    double high, low;
};

Twin sum(double a, double b) {
    const double high = a + b;
    const double own = high - a;
    return {high, (a - (high - own)) + (b - own)};
}

Twin sum(Twin a, Twin b) {
    const Twin high = sum(a.high, b.high);
    const Twin low = sum(a.low, b.low);
    const Twin both = sum(high.high, high.low + low.high);
    return sum(both.high, both.low + low.low);
}

Twin halves(double a) { // of 26 bits
    const double wide = 134217729.0 * a;
    const double high = wide - (wide - a);
    return {high, a - high};
}

Twin product(double a, double b) {
    const double high = a * b;
    const Twin x = halves(a);
    const Twin y = halves(b);
    return {high, ((x.high * y.high - high) + x.high * y.low + x.low * y.high) + x.low * y.low};
}

Twin product(Twin a, Twin b) {
    const Twin high = product(a.high, b.high);
    return sum(high.high, high.low + (a.high * b.low + a.low * b.high));
}

Twin quotient(Twin a, Twin b) {
    const double first = a.high / b.high;
    const Twin rest = sum(a, product({-first, 0.0}, b));
    return sum(first, rest.high / b.high);
}

// r - r^3 / 3! + ... from r, 1 - r^2 / 2! + ... from 1; terms below `least` times the sum, and so
// what follows, to 53 bits each.
Twin series(Twin term, Twin minus_square, int first, double least) {
    Twin total = term;
    int n = first;
    for (; std::abs(term.high) > least * std::abs(total.high); n += 2) {
        term = quotient(product(term, minus_square), {double(n * (n + 1)), 0.0});
        total = sum(total, term);
    }
    double rest = 0.0;
    for (double last = term.high; n < 30; n += 2) {
        last *= minus_square.high / double(n * (n + 1));
        rest += last;
    }
    return sum(total, {rest, 0.0});
}

// The sine of an angle, more quarters of a turn ahead: its cosine for one. To 106 bits.
Twin sine(double angle, int ahead, double least = 0x1p-54) {
    constexpr double QUARTER[] = {1.57079632673412561417e+00, 6.07710050630396597660e-11,
                                  2.02226624871116645580e-21, 8.47842766036889956997e-32};
    const double n = std::nearbyint(angle / QUARTER[0]);
    Twin rest = {angle, 0.0};
    for (const double part : QUARTER) rest = sum(rest, {-n * part, 0.0});
    Twin minus_square = product(rest, rest);
    minus_square = {-minus_square.high, -minus_square.low};
    const int64_t turned = (int64_t(n) + ahead) & 3;
    const Twin found = turned % 2 ? series({1.0, 0.0}, minus_square, 1, least)
                                  : series(rest, minus_square, 2, least);
    return turned < 2 ? found : Twin{-found.high, -found.low};
}

// Few terms of two numbers give 66 bits at least, which round to one number nearly always.
double rounded_sine(double angle, int ahead) {
    if (!(std::abs(angle) < 1e9)) return std::numeric_limits<double>::quiet_NaN();
    const Twin quick = sine(angle, ahead, 0x1p-14);
    const double bound = 0x1p-64 * std::abs(quick.high);
    const bool is_sure = quick.high + (quick.low + bound) == quick.high + (quick.low - bound);
    return (is_sure ? quick : sine(angle, ahead)).high;
}

Twin minus(Twin a) { return {-a.high, -a.low}; }

Twin power_of(Twin x, int n) {
    Twin found = {1.0, 0.0};
    for (; n > 0; n >>= 1, x = product(x, x))
        if (n & 1) found = product(found, x);
    return found;
}

// By 1 + x + x^2 / 2 + ... of x / 2^10, squared.
Twin exponential(double x) {
    constexpr int HALVINGS = 10, TERMS = 12;
    const Twin part = {x / (1 << HALVINGS), 0.0};
    Twin found = {1.0, 0.0};
    for (int k = TERMS; k > 0; k--)
        found = sum({1.0, 0.0}, quotient(product(part, found), {double(k), 0.0}));
    for (int k = 0; k < HALVINGS; k++) found = product(found, found);
    return found;
}

// Sine for a sign of -1, and cosine for 1.
Twin hyperbolic(double x, double sign) {
    const Twin up = exponential(x), down = quotient({1.0, 0.0}, up);
    return product({0.5, 0.0}, sum(up, product({sign, 0.0}, down)));
}

} // namespace

double sin(double angle) { return angle == 0.0 ? angle : rounded_sine(angle, 0); }
double cos(double angle) { return rounded_sine(angle, 1); }
double tan(double angle) { return quotient(sine(angle, 0), sine(angle, 1)).high; }
double sinh(double x) { return hyperbolic(x, -1.0).high; }
double power(double x, int n) { return power_of({x, 0.0}, n).high; }

double atan2(double y, double x) {
    const double start = std::atan2(y, x);
    if (y == 0.0 || x == 0.0 || !(std::abs(x) + std::abs(y) < 0x1p500)) return start;
    const Twin s = sine(start, 0), c = sine(start, 1), by_x = {x, 0.0}, by_y = {y, 0.0};
    const Twin across = sum(product(by_y, c), minus(product(by_x, s)));
    const Twin along = sum(product(by_x, c), product(by_y, s));
    return start + across.high / along.high;
}

// C. F. Borges. An Improved Algorithm for hypot(a,b). 2019.
double hypot(double a, double b) {
    constexpr double INFINITE = std::numeric_limits<double>::infinity();
    const double one = std::abs(a), other = std::abs(b);
    if (one == INFINITE || other == INFINITE) return INFINITE;
    double x = std::max(one, other), y = std::min(one, other);
    if (!(y > 0x1p-54 * x) || std::isnan(one + other)) return one + other;
    const double scale = x > 0x1p500 ? 0x1p-600 : x < 0x1p-400 ? 0x1p600 : 1.0;
    x *= scale;
    y *= scale;
    const double h = std::sqrt(x * x + y * y);
    // h^2 - x^2 - y^2, without cancellation.
    double over, rest;
    if (h <= 2.0 * y) {
        const double off = h - y;
        over = x * (2.0 * off - x);
        rest = (off - 2.0 * (x - y)) * off;
    } else {
        const double off = h - x;
        over = 2.0 * off * (x - 2.0 * y);
        rest = (4.0 * off - y) * y + off * off;
    }
    return (h - (over + rest) / (2.0 * h)) / scale;
}

double asinh(double x) {
    const double start = std::asinh(x);
    if (!(std::abs(start) < 30.0)) return start;
    const Twin rest = sum({x, 0.0}, minus(hyperbolic(start, -1.0)));
    return start + rest.high / hyperbolic(start, 1.0).high;
}

double geometric(double first, double last, int k, int n) {
    if (k == 0 || k == n - 1) return k ? last : first;
    const Twin whole = quotient({last, 0.0}, {first, 0.0});
    const double start = std::pow(whole.high, 1.0 / (n - 1));
    const Twin below = power_of({start, 0.0}, n - 2), at = product(below, {start, 0.0});
    const Twin rest = sum(whole, minus(at));
    const Twin ratio = sum({start, 0.0}, quotient(rest, product({double(n - 1), 0.0}, below)));
    return product({first, 0.0}, power_of(ratio, k)).high;
}

} // namespace rastercov::rounded
