// Pairs of doubles and exact sides of faces; see exact/orientation.hpp.
//
// Twins: tests/test_double_double.py, tests/exact/test_orientation.py.
#include "bind.hpp"
#include "exact/orientation.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace exact {
namespace {

using Two = std::pair<double, double>;
Two two(Pair a) { return {a.high, a.low}; }
Two sum_of(double a, double b) { return two(exact_sum(a, b)); }
Two product_of(double a, double b) { return two(exact_product(a, b)); }
Two add(Two a, Two b) { return two(Pair{a.first, a.second} + Pair{b.first, b.second}); }
Two multiply(Two a, Two b) { return two(Pair{a.first, a.second} * Pair{b.first, b.second}); }
Two determinant(double a, double d, double b, double c) {
    return two(minor_of({a, 0.0}, {d, 0.0}, {b, 0.0}, {c, 0.0}));
}

// Side of a face from which a point sees it.
int64_t side_seen(Array<const double, 3> a, Array<const double, 3> b, Array<const double, 3> c,
                  Array<const double, 3> centre) {
    return exact_side(a, b, c, centre);
}

} // namespace
} // namespace exact

void register_exact_setup(nanobind::module_ &m) {
    using namespace exact;
    def(m, "exact_sum", sum_of, "Sum of two doubles, as a pair.", "a", "b");
    def(m, "exact_product", product_of, "Product of two doubles, as a pair.", "a", "b");
    def(m, "add", add, "Sum of two pairs.", "a", "b");
    def(m, "multiply", multiply, "Product of two pairs.", "a", "b");
    def(m, "minor", determinant, "a d - b c, as a pair.", "a", "d", "b", "c");
    def(m, "side_seen", side_seen,
        "Side of a face from which a point sees it, exactly: 1 front, -1 back, 0 edge-on; 2 where "
        "products underflow.",
        "a", "b", "c", "centre");
}

} // namespace rastercov
