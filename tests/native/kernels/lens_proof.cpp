// Steps of what is proved of lenses: rastercov.engine.lens_proof.
//
// Twins: tests/lenses/test_balls.py, tests/lenses/test_expansions.py, tests/lenses/test_region.py.
#include "bind.hpp"
#include "lens/ball.hpp"
#include "lens/proof.hpp"
#include "lens/series.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace {
using namespace lens;

Outline outline_of(const Corners &polygon) {
    Outline found;
    for (int64_t k = 0; k < polygon.rows(); k++) found.push_back({polygon(k, 0), polygon(k, 1)});
    return found;
}

Ideal ideal_of(const PlaneRecord &of) {
    Ideal plane = {};
    plane.code = of.code;
    plane.has_pole = of.is_graded;
    std::copy(of.params.begin(), of.params.end(), plane.params.begin());
    std::copy(of.frame.begin(), of.frame.end(), plane.frame.begin());
    plane.region = outline_of(of.region);
    plane.hole = outline_of(of.hole);
    return plane;
}

std::pair<double, double> reach(const PlaneRecord &plane, double radius) {
    const Reach found = ideal_of(plane).reach(radius, false);
    return {found.u, found.v};
}

std::pair<double, double> reach_around(const PlaneRecord &plane, double x, double y,
                                       double radius) {
    const Reach found = reach_at(ideal_of(plane), x, y, radius, false);
    return {found.u, found.v};
}

// Their number.
int64_t bounds_of(const PlaneRecord &plane, Array<double, Any, 3> reaches,
                  Array<double, 2, MOST_ORDER + 1> taylor) {
    const EdgeBounds bounds = edge_bounds(ideal_of(plane));
    const auto n = int64_t(bounds.reaches.size());
    require(n <= reaches.rows(), "reaches must have room for all radii");
    for (int64_t k = 0; k < n; k++) {
        const auto &[radius, u, v] = bounds.reaches[size_t(k)];
        const double each[] = {radius, u, v};
        std::copy_n(each, 3, reaches[k].begin());
    }
    std::copy(bounds.u.begin(), bounds.u.end(), taylor[0].begin());
    std::copy(bounds.v.begin(), bounds.v.end(), taylor[1].begin());
    return n;
}

EdgeBounds bounds_from(FloatRows<3> reaches, Array<const double, 2, Any> taylor) {
    EdgeBounds bounds;
    for (int64_t k = 0; k < reaches.rows(); k++)
        bounds.reaches.push_back({reaches(k, 0), reaches(k, 1), reaches(k, 2)});
    bounds.u.assign(taylor[0].begin(), taylor[0].end());
    bounds.v.assign(taylor[1].begin(), taylor[1].end());
    return bounds;
}

double edge_error(FloatRows<3> reaches, Array<const double, 2, Any> taylor, double half,
                  int64_t n) {
    require(n >= 1 && n <= MOST, "n must be a rule");
    return bounds_from(reaches, taylor).error(half, n);
}

void copy_pair_errors(Array<double, TABLE, DEGREES + 1, DEGREES + 1> out) {
    std::copy_n(pair_errors(), out.size(), out.begin());
}

bool is_positive(FloatArray terms, double low, double high) {
    expect(terms.size() > 0, "1 term or more", terms.size(), "give the terms of a polynomial");
    return are_positive({{terms.begin(), terms.end()}}, low, high);
}

double limit_of(int64_t code, Array<const double, SIZE> p) { return base_limit(code, p); }

double radius_of(Array<const double, SIZE> p, double top) {
    return certified_radius(p, top, INFINITE);
}

// Sum, difference, product and quotient of balls (re, im, radius), and root and atan of the first.
void combine_balls(Array<const double, 3> one, Array<const double, 3> other,
                   Array<double, 6, 3> out) {
    const Ball a = {one[0], one[1], one[2], false}, b = {other[0], other[1], other[2], false};
    const Ball found[] = {a + b, a - b, a * b, a / b, sqrt(a), atan(a)};
    for (int64_t k = 0; k < 6; k++) {
        const double each[] = {found[k].re, found[k].im, found[k].off};
        std::copy_n(each, 3, out[k].begin());
    }
}

// The radial factor of a ball around a real number, near its pole.
void radial_ball(Array<const double, SIZE> p, double centre, double radius, Array<double, 3> out) {
    const Ball found = radial_factor(p, Ball(centre, 0.0, radius, true));
    const double each[] = {found.re, found.im, found.off};
    std::copy_n(each, 3, out.begin());
}

// Product of two expansions, inverse and root of the first, of centres and radii by order.
void combine_series(Array<const double, 2, 4, LINES> one, Array<const double, 2, 4, LINES> other,
                    Array<double, 3, 2, MOST_ORDER + 1, LINES> out) {
    const auto from = [](const Array<const double, 2, 4, LINES> &given) {
        Series made = Series::zero(4, MOST_ORDER);
        for (int order = 0; order < 4; order++) {
            std::copy_n(given[0][order].begin(), LINES, made.at[order].centre);
            std::copy_n(given[1][order].begin(), LINES, made.at[order].off);
        }
        return made;
    };
    const Series a = from(one), b = from(other), found[] = {a * b, a.inverse(), sqrt(a)};
    std::fill(out.begin(), out.end(), 0.0);
    for (int64_t k = 0; k < 3; k++)
        for (int order = 0; order < found[k].n; order++) {
            std::copy_n(found[k].at[order].centre, LINES, out[k][0][order].begin());
            std::copy_n(found[k].at[order].off, LINES, out[k][1][order].begin());
        }
}
} // namespace

void register_lens_proof(nanobind::module_ &m) {
    m.attr("DEGREES") = DEGREES;
    m.attr("ORDER") = MOST_ORDER;
    m.attr("LINES") = LINES;
    def(m, "reach", reach, "Bounds over a plane of complex points within a radius.", "plane",
        "radius");
    def(m, "reach_at", reach_around, "The same around one point.", "plane", "x", "y", "radius");
    def(m, "bounds_of", bounds_of, "Fill in all reaches of a plane, and its Taylor bounds.",
        "plane", "reaches", "taylor");
    def(m, "base_limit", limit_of, "Angle from the axis below which the base is injective.", "code",
        "p");
    def(m, "certified_radius", radius_of,
        "Radius up to which the distortion is proved to be injective.", "p", "top");
    def(m, "is_positive", is_positive,
        "True where a polynomial is proved to be positive between two places.", "terms", "low",
        "high");
    def(m, "edge_error", edge_error, "Bound of the error of an edge by rule n.", "reaches",
        "taylor", "half", "n");
    def(m, "pair_errors", copy_pair_errors, "Fill in the bounds of |e_ab| by n.", "out");
    def(m, "combine_balls", combine_balls,
        "Fill in sum, difference, product, quotient of two balls, root and atan of the first.",
        "one", "other", "out");
    def(m, "radial_ball", radial_ball, "Fill in the radial factor of a ball, by an expansion.", "p",
        "centre", "radius", "out");
    def(m, "combine_series", combine_series,
        "Fill in the product of two expansions, and inverse and root of the first.", "one", "other",
        "out");
}

} // namespace rastercov
