// Products, quotients and roots of polynomials with intervals as coefficients.
//
// For rastercov.camera.lenses.quadrature: rows are powers of t, columns are lines, of which
// LINES_AT_A_TIME stay in the cache. An interval is a centre and a radius `off`. Results have the
// intervals of all choices from those of the arguments.
//
// Invariants: the order of operations of a line does not depend on the other lines.
//
// Twin: tests/lenses/test_expansions.py, by single points.
#include "bind.hpp"
#include <cmath>

namespace rastercov {
namespace {

constexpr int64_t LINES_AT_A_TIME = 256;

using Given = Array<const double, Any, Any>;
using Filled = Array<double, Any, Any>;
using Given1 = Array<const double, Any>;

// Lines of one power, centres and radii.
template <class T> struct Coefficients {
    T *centre, *off;
};

template <class Arrays>
auto row(const Arrays &centre, const Arrays &off, int64_t i, int64_t start) {
    return Coefficients<typename Arrays::Element>{centre.data + i * centre.extent(1) + start,
                                                  off.data + i * off.extent(1) + start};
}

// Adds sign times a product to c.
template <int SIGN, class A, class B>
void add_product(Coefficients<double> c, A a, B b, int64_t n) {
    for (int64_t k = 0; k < n; k++) {
        if constexpr (SIGN > 0) c.centre[k] += a.centre[k] * b.centre[k];
        else c.centre[k] -= a.centre[k] * b.centre[k];
        c.off[k] +=
            std::abs(a.centre[k]) * b.off[k] + a.off[k] * (std::abs(b.centre[k]) + b.off[k]);
    }
}

template <class F> void scale(Coefficients<double> c, F factor, int64_t n) {
    for (int64_t k = 0; k < n; k++) {
        c.off[k] = c.off[k] * (std::abs(factor.centre[k]) + factor.off[k]) +
                   std::abs(c.centre[k]) * factor.off[k];
        c.centre[k] *= factor.centre[k];
    }
}

void require_lines(const Given &one, const Given &off, int64_t n) {
    require(one.rows() == off.rows() && one.extent(1) == n && off.extent(1) == n,
            "expansions must have radii of the shape of their centres, and the same lines");
}

// Calls with the first line and the number of each group of lines.
template <class Each> void by_groups(int64_t n, Each each) {
    for (int64_t start = 0; start < n; start += LINES_AT_A_TIME)
        each(start, std::min(LINES_AT_A_TIME, n - start));
}

void multiply(Given one, Given one_off, Given two, Given two_off, Filled out, Filled out_off) {
    const int64_t n = out.extent(1);
    require_lines(one, one_off, n);
    require_lines(two, two_off, n);
    require_lines(out, out_off, n);
    by_groups(n, [&](int64_t start, int64_t m) {
        for (int64_t i = 0; i < one.rows(); i++)
            for (int64_t j = 0; j < std::min(two.rows(), out.rows() - i); j++)
                add_product<1>(row(out, out_off, i + j, start), row(one, one_off, i, start),
                               row(two, two_off, j, start), m);
    });
}

void invert(Given one, Given one_off, Filled out, Filled out_off) {
    const int64_t n = out.extent(1);
    require_lines(one, one_off, n);
    require_lines(out, out_off, n);
    by_groups(n, [&](int64_t start, int64_t m) { // q b = 1, from the lowest term on
        for (int64_t k = 1; k < out.rows(); k++) {
            const auto c = row(out, out_off, k, start);
            for (int64_t i = 1; i <= std::min(k, one.rows() - 1); i++)
                add_product<-1>(c, row(one, one_off, i, start), row(out, out_off, k - i, start), m);
            scale(c, row(out, out_off, 0, start), m);
        }
    });
}

void take_root(Given1 inverse, Given1 inverse_off, Filled out, Filled out_off) {
    const int64_t n = out.extent(1);
    require_lines(out, out_off, n);
    require(have_rows(n, inverse, inverse_off), "inverse must have one row a line");
    by_groups(n, [&](int64_t start, int64_t m) { // s s = a, from the lowest term on
        for (int64_t k = 1; k < out.rows(); k++) {
            const auto c = row(out, out_off, k, start);
            for (int64_t i = 1; i < k; i++)
                add_product<-1>(c, row(out, out_off, i, start), row(out, out_off, k - i, start), m);
            scale(c, Coefficients<const double>{inverse.data + start, inverse_off.data + start}, m);
        }
    });
}

} // namespace

void register_lens_expansions(nanobind::module_ &m) {
    def(m, "multiply", multiply, "Add the product to `out`, (N, L), as far as it has rows.", "one",
        "one_off", "two", "two_off", "out", "out_off");
    def(m, "invert", invert,
        "Fill `out`, (N, L), with 1 / one; the first row is known, and the others are 0.", "one",
        "one_off", "out", "out_off");
    def(m, "take_root", take_root,
        "Take the root of `out`, (N, L), in place; its first row is that of the root.\n\n"
        "`inverse`, (L,), is 1 / (2 s_0).",
        "inverse", "inverse_off", "out", "out_off");
}
} // namespace rastercov
