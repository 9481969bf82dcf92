// The functions of lens/rounded.hpp of arrays, for what Python decides.
//
// Twin: tests/test_rounded.py.
#include "lens/rounded.hpp"
#include "bind.hpp"

namespace rastercov {
namespace {

template <auto of> void fill(FloatArray a, FloatArray b, Column<double> out) {
    require(have_rows(out.rows(), a, b), "a, b and out must have equal lengths");
    for (int64_t i = 0; i < out.rows(); i++) out[i] = of(a[i], b[i]);
}

void fill_steps(FloatArray first, FloatArray last, Array<double, Any, Any> out) {
    require(have_rows(out.rows(), first, last), "first, last and out must have equal lengths");
    const auto n = int(out.extent(1));
    for (int64_t i = 0; i < out.rows(); i++)
        for (int k = 0; k < n; k++) out(i, k) = rounded::geometric(first[i], last[i], k, n);
}

} // namespace

void register_base_rounded(nanobind::module_ &m) {
    const auto add = [&](const char *name, auto *function) {
        def(m, name, function, "Set `out`, (N,), to a function of each pair of numbers.", "a", "b",
            "out");
    };
    add("sin", fill<[](double a, double) { return rounded::sin(a); }>);
    add("cos", fill<[](double a, double) { return rounded::cos(a); }>);
    add("tan", fill<[](double a, double) { return rounded::tan(a); }>);
    add("arctan2", fill<rounded::atan2>);
    add("hypot", fill<rounded::hypot>);
    add("fill_steps", fill_steps);
}

} // namespace rastercov
