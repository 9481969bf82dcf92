// Expansions along lines, and the operations of formulas.hpp on them.
//
// Coefficients of t^0 ... t^order of LINES functions are intervals that hold those of all choices
// from the intervals of the arguments, each a centre and a radius `off`; those above are left out.
//
// Invariants: the order of operations of a line does not depend on the other lines.
//
// Twin: tests/lenses/test_expansions.py, by single points.
#pragma once
#include "lens/proof.hpp"

namespace rastercov::lens {

constexpr int MOST_ORDER = 18;

// Of one power, by line.
struct Interval {
    double centre[LINES], off[LINES];
};

struct Series {
    int n = 1;
    int order = 0; // coefficients that are not 0, and the last that is kept
    // Z is negative everywhere, of all that is looked at: see angle_over_r.
    bool is_behind = false;
    Interval at[MOST_ORDER + 1];

    Series() = default;
    Series(double value) {
        for (int k = 0; k < LINES; k++) {
            at[0].centre[k] = value;
            at[0].off[k] = 0.0;
        }
    }
    Series(const Series &other) { *this = other; }
    Series &operator=(const Series &other) {
        n = other.n;
        order = other.order;
        is_behind = other.is_behind;
        std::copy_n(other.at, n, at);
        return *this;
    }

    static Series zero(int n, int order) {
        Series made;
        made.n = n;
        made.order = order;
        std::fill_n(made.at, n, Interval{});
        return made;
    }

    friend Series operator*(double factor, const Series &a) {
        Series made = a;
        made.is_behind = false;
        for (int i = 0; i < a.n; i++)
            for (int k = 0; k < LINES; k++) {
                made.at[i].centre[k] *= factor;
                made.at[i].off[k] *= std::abs(factor);
            }
        return made;
    }
    friend Series operator*(const Series &a, double factor) { return factor * a; }
    friend Series operator+(const Series &a, const Series &b) {
        const Series &less = a.n < b.n ? a : b;
        Series made = a.n < b.n ? b : a;
        made.is_behind = false;
        made.order = std::max(a.order, b.order);
        for (int i = 0; i < less.n; i++)
            for (int k = 0; k < LINES; k++) {
                made.at[i].centre[k] += less.at[i].centre[k];
                made.at[i].off[k] += less.at[i].off[k];
            }
        return made;
    }
    friend Series operator-(const Series &a, const Series &b) { return a + -1.0 * b; }
    friend Series operator*(const Series &a, const Series &b) {
        const int order = std::max(a.order, b.order);
        Series made = zero(std::min(a.n + b.n - 1, order + 1), order);
        for (int i = 0; i < a.n; i++)
            for (int j = 0; j < std::min(b.n, made.n - i); j++)
                add_product(made.at[i + j], 1.0, a.at[i], b.at[j]);
        return made;
    }
    friend Series operator/(const Series &a, const Series &b) { return a * b.inverse(); }
    friend Series operator/(double a, const Series &b) { return a * b.inverse(); }

    // Adds a sign times a product.
    static void add_product(Interval &to, double sign, const Interval &a, const Interval &b) {
        for (int k = 0; k < LINES; k++) {
            to.centre[k] += sign * (a.centre[k] * b.centre[k]);
            to.off[k] +=
                std::abs(a.centre[k]) * b.off[k] + a.off[k] * (std::abs(b.centre[k]) + b.off[k]);
        }
    }
    static void scale(Interval &c, const Interval &by) {
        for (int k = 0; k < LINES; k++) {
            c.off[k] =
                c.off[k] * (std::abs(by.centre[k]) + by.off[k]) + std::abs(c.centre[k]) * by.off[k];
            c.centre[k] *= by.centre[k];
        }
    }
    // 1 / x; without limit where it holds 0.
    static Interval inverse_of(const Interval &x) {
        Interval made;
        for (int k = 0; k < LINES; k++) {
            const double size = std::abs(x.centre[k]);
            const bool is_good = size > x.off[k];
            made.centre[k] = is_good ? 1.0 / x.centre[k] : 0.0;
            made.off[k] = is_good ? x.off[k] / (size * (size - x.off[k])) : INFINITE;
        }
        return made;
    }
    Series inverse() const { // q b = 1, from the lowest term on
        Series made = zero(order + 1, order);
        made.at[0] = inverse_of(at[0]);
        for (int i = 1; i <= order; i++) {
            for (int j = 1; j <= std::min(i, n - 1); j++)
                add_product(made.at[i], -1.0, at[j], made.at[i - j]);
            scale(made.at[i], made.at[0]);
        }
        return made;
    }
};

inline Series sqrt(const Series &x) { // s s = x, from the lowest term on
    Series made = Series::zero(x.order + 1, x.order);
    std::copy_n(x.at, x.n, made.at);
    Interval twice;
    for (int k = 0; k < LINES; k++) {
        const double a = x.at[0].centre[k], off = x.at[0].off[k];
        const bool is_good = a > off;
        const double root = std::sqrt(is_good ? a : 1.0);
        // |sqrt x - sqrt c| = |x - c| / (sqrt x + sqrt c)
        made.at[0].centre[k] = root;
        made.at[0].off[k] = is_good ? off / (root + std::sqrt(a - off)) : INFINITE;
        twice.centre[k] = 2.0 * root;
        twice.off[k] = 2.0 * made.at[0].off[k];
    }
    const Interval inverse = Series::inverse_of(twice);
    for (int i = 1; i <= made.order; i++) {
        for (int j = 1; j < i; j++)
            Series::add_product(made.at[i], -1.0, made.at[j], made.at[i - j]);
        Series::scale(made.at[i], inverse);
    }
    return made;
}

inline Series angle_over_r(const Series &r2, const Series &z) {
    if (z.is_behind) // z + sqrt(r2 + z * z) would cancel
        return std::numbers::pi / sqrt(r2) - angle_over_r(r2, -1.0 * z);
    Series c = 1.0 / (z + sqrt(r2 + z * z));
    for (int halving = 0; halving < 3; halving++) c = c / (1.0 + sqrt(1.0 + r2 * (c * c)));
    const Series q = r2 * (c * c);
    Series series = 1.0 / 21.0;
    for (int odd = 19; odd > 0; odd -= 2) series = 1.0 / odd - q * series;
    return 16.0 * (c * series);
}

// Angle of (x, y) from the x axis, within half a turn, as longitudes of a plane are.
inline Series atan2(const Series &y, const Series &x) { return y * angle_over_r(y * y, x); }

} // namespace rastercov::lens
