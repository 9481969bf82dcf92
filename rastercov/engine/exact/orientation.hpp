// Exact sign of the side from which a camera sees a face.
//
// The sign of (a - e) . ((b - e) x (c - e)) for corners a, b, c and the camera centre e, of the
// doubles as they are: the sum of its products is kept as an expansion, which loses nothing.
// Doubles decide nearly all of them before.
//
// J. R. Shewchuk. Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
// Predicates. 1997.
//
// Twins: tests/exact/test_orientation.py, with fractions.
#pragma once
#include "exact/pairs.hpp"
#include <array>

namespace rastercov::exact {

// Relative error bound of the determinant in doubles: of a product 3 differences, 2 products and 4
// sums of 2^-53 each.
constexpr double ORIENTATION_ERROR_REL = 0x1p-49;
// Exponent that the greatest difference is scaled to, so that no product overflows.
constexpr double SCALED_REACH = 0x1p300;
// Products below this may have lost digits to underflow.
constexpr double LEAST_PRODUCT = 0x1p-800;

// A sum of doubles without rounding.
class Expansion {
  public:
    void add(double b) {
        int kept = 0;
        for (int i = 0; i < n; i++) {
            const Pair sum = exact_sum(terms[i], b);
            if (sum.low != 0) terms[kept++] = sum.low;
            b = sum.high;
        }
        if (b != 0) terms[kept++] = b;
        n = kept;
    }
    // Sign of the greatest term, which is that of all.
    int sign() const { return n == 0 ? 0 : terms[n - 1] > 0 ? 1 : -1; }

  private:
    int n = 0;
    std::array<double, 200> terms; // the determinant has 6 products of 8 parts of 4 terms
};

enum : int8_t { FROM_BEHIND = -1, EDGE_ON_EXACTLY, FROM_FRONT, SIDE_NOT_KNOWN };

// Sign of the determinant of three vectors of pairs, as a side; not known where numbers differ by
// so much that products underflow.
inline int8_t side_of(const Pair (&at)[3][3]) {
    constexpr int ORDERS[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    Expansion total;
    bool is_known = true;
    const auto product = [&](double a, double b) {
        const Pair exact = exact_product(a, b);
        is_known = is_known && (a == 0 || b == 0 || std::abs(exact.high) >= LEAST_PRODUCT);
        return exact;
    };
    for (int order = 0; order < 6; order++) {
        const auto &[i, j, k] = ORDERS[order];
        const Pair &a = at[0][i], &b = at[1][j], &c = at[2][k];
        for (const double x : {a.low, a.high})
            for (const double y : {b.low, b.high})
                for (const double z : {c.low, c.high}) {
                    if (x == 0 || y == 0 || z == 0) continue;
                    const Pair two = product(order < 3 ? x : -x, y);
                    for (const double part : {two.low, two.high}) {
                        const Pair three = product(part, z);
                        total.add(three.low);
                        total.add(three.high);
                    }
                }
    }
    return is_known ? int8_t(-total.sign()) : int8_t(SIDE_NOT_KNOWN);
}

// The same, where doubles may decide; the vectors are scaled in place.
inline int8_t sign_of(Pair (&at)[3][3]) {
    double reach = 0.0;
    for (const auto &corner : at)
        for (const Pair &x : corner) reach = std::max(reach, std::abs(x.high));
    if (reach == 0) return EDGE_ON_EXACTLY;
    if (!std::isfinite(reach)) return SIDE_NOT_KNOWN;
    const double scale = SCALED_REACH / std::exp2(std::floor(std::log2(reach)));
    if (!std::isfinite(scale)) return SIDE_NOT_KNOWN;
    for (auto &corner : at)
        for (Pair &x : corner) {
            const Pair scaled = {x.high * scale, x.low * scale};
            if (x.low != 0 && std::abs(scaled.low) < LEAST_PRODUCT) return SIDE_NOT_KNOWN;
            if (x.high != 0 && std::abs(scaled.high) < LEAST_PRODUCT) return SIDE_NOT_KNOWN;
            x = scaled;
        }
    double total = 0.0;
    double size = 0.0;
    for (int k = 0; k < 3; k++) {
        const int i = k < 2 ? k + 1 : 0, j = k > 0 ? k - 1 : 2;
        const double one = at[1][i].high * at[2][j].high, other = at[1][j].high * at[2][i].high;
        total += at[0][k].high * (one - other);
        size += std::abs(at[0][k].high) * (std::abs(one) + std::abs(other));
    }
    if (std::abs(total) > ORIENTATION_ERROR_REL * size) return total < 0 ? FROM_FRONT : FROM_BEHIND;
    return side_of(at);
}

// Side of a face, with corners a, b, c, that a camera centre sees.
template <class Point, class Centre>
int8_t exact_side(const Point &a, const Point &b, const Point &c, const Centre &centre) {
    Pair at[3][3];
    for (int k = 0; k < 3; k++) {
        at[0][k] = exact_sum(a[k], -centre[k]);
        at[1][k] = exact_sum(b[k], -centre[k]);
        at[2][k] = exact_sum(c[k], -centre[k]);
    }
    return sign_of(at);
}

// Side that rays along a direction see: the sign of direction . ((b - a) x (c - a)).
template <class Point, class Direction>
int8_t exact_side_along(const Point &a, const Point &b, const Point &c,
                        const Direction &direction) {
    Pair at[3][3];
    for (int k = 0; k < 3; k++) {
        at[0][k] = {direction[k], 0.0};
        at[1][k] = exact_sum(b[k], -a[k]);
        at[2][k] = exact_sum(c[k], -a[k]);
    }
    return sign_of(at);
}

} // namespace rastercov::exact
