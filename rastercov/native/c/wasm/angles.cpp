// Sine, cosine and tangent that are rounded once, as nearly all results of other libraries of C
// are: borders of the angle of incidence have their bits. For angles up to 1e6.
//
// Sums of two numbers, 106 bits: T. J. Dekker. A Floating-Point Technique for Extending the
// Available Precision. 1971.
//
// Twin: tests/native/test_wasm.py.
#include "c/objects.hpp"

namespace rastercov {
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
double rounded(double angle, int ahead) {
    const Twin quick = sine(angle, ahead, 0x1p-14);
    const double bound = 0x1p-64 * std::abs(quick.high);
    const bool is_sure = quick.high + (quick.low + bound) == quick.high + (quick.low - bound);
    return (is_sure ? quick : sine(angle, ahead)).high;
}

} // namespace

double c::tangent_of(double angle) { return quotient(sine(angle, 0), sine(angle, 1)).high; }

} // namespace rastercov

extern "C" {
double sin(double angle) { return angle == 0.0 ? angle : rastercov::rounded(angle, 0); }
double cos(double angle) { return rastercov::rounded(angle, 1); }
}
