// The border of what is proved of lenses to Python: rastercov.engine.solver_lens.
//
// Twin: rastercov.core.camera.lenses.of_camera.
#include "bind.hpp"
#include "lens/ball.hpp"
#include "lens/models.hpp"
#include "lens/proof.hpp"
#include "lens/series.hpp"
#include "python/tables.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace {
using namespace lens;

// An ideal plane of Python.
struct PlaneOfPython {
    int64_t code;
    Params params;
    Frame frame;
    Corners region, hole;
    bool has_pole;
    operator Ideal() const {
        Ideal plane = {};
        plane.code = code;
        plane.has_pole = has_pole;
        std::copy(params.begin(), params.end(), plane.params.begin());
        std::copy(frame.begin(), frame.end(), plane.frame.begin());
        for (int64_t k = 0; k < region.rows(); k++)
            plane.region.push_back({region(k, 0), region(k, 1)});
        for (int64_t k = 0; k < hole.rows(); k++) plane.hole.push_back({hole(k, 0), hole(k, 1)});
        return plane;
    }
};

// Line of a model: its name, its base, its coefficients and the numbers of them.
#define LINE_OF(name, base, names, counts, ...) #name ";" #base ";" names ";" counts "\n"

// Sets each of some names, "A, B", to its place among them.
void set_names(nb::module_ &m, const char *names) {
    int place = 0;
    for (const auto each : nb::str(names).attr("split")(", ")) m.attr(each) = place++;
}

int64_t set_terms(int64_t model, Array<const double, 5> pixels, FloatArray coefficients,
                  Array<double, SIZE> params) {
    const Terms found = terms_of(model, pixels.data, coefficients.data, coefficients.rows());
    std::copy(found.params.begin(), found.params.end(), params.begin());
    return found.code;
}

using Limits = std::pair<double, bool>;

Limits find_region(int64_t code, double width, double height, double max_angle,
                   Array<double, SIZE> params) {
    Numbers given;
    std::copy(params.begin(), params.end(), given.begin());
    const Region found = region_of(code, given, width, height, max_angle);
    std::copy(found.params.begin(), found.params.end(), params.begin());
    return {found.angle, found.is_whole};
}

nb::object pack(int64_t code, Array<const double, SIZE> params, double angle, double width,
                double height, double edge_tolerance, double field_tolerance) {
    constexpr auto DOING = "Bound the images of a lens";
    Region valid = {{}, angle, false};
    std::copy(params.begin(), params.end(), valid.params.begin());
    return call_within_memory(DOING, [&] {
        return array_of(call_apart(
            DOING,
            [&] { return packed(code, valid, width, height, edge_tolerance, field_tolerance); },
            params));
    });
}

void find_met(const PlaneOfPython &plane, FloatArray x, FloatArray y, double half_x, double half_y,
              Column<bool> out) {
    require(have_rows(out.rows(), x, y), "x, y and out must have the same length");
    const Sides sides = Ideal(plane).sides();
    for (int64_t k = 0; k < out.rows(); k++) out[k] = sides.meet(x[k], y[k], half_x, half_y);
}

// --- steps of the proofs, for tests ---

std::pair<double, double> reach(const PlaneOfPython &plane, double radius) {
    const Reach found = Ideal(plane).reach(radius, false);
    return {found.u, found.v};
}

std::pair<double, double> reach_around(const PlaneOfPython &plane, double x, double y,
                                       double radius) {
    const Reach found = reach_at(plane, x, y, radius, false);
    return {found.u, found.v};
}

// Their number.
int64_t bounds_of(const PlaneOfPython &plane, Array<double, Any, 3> reaches,
                  Array<double, 2, MOST_ORDER + 1> taylor) {
    const EdgeBounds bounds = edge_bounds(plane);
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

RECORD(PlaneOfPython, code, params, frame, region, hole, has_pole);

void register_solver_lens(nb::module_ &m) {
    m.attr("BASES") = RASTERCOV_NAMES_IN(RASTERCOV_BASES);
    m.attr("MODELS") = RASTERCOV_MODELS(LINE_OF);
    m.attr("LARGEST_COEFFICIENT") = LARGEST_COEFFICIENT;
    set_names(m, RASTERCOV_NAMES_IN(RASTERCOV_BASES));
    set_names(m, RASTERCOV_NAMES_IN(RASTERCOV_PARAMETERS));
    m.attr("SIZE") = int(SIZE);
    m.attr("DEGREES") = DEGREES;
    m.attr("ORDER") = MOST_ORDER;
    m.attr("LINES") = LINES;
    m.attr("EDGE_TOLERANCE") = EDGE_TOLERANCE;
    m.attr("FIELD_TOLERANCE") = FIELD_TOLERANCE;
    def(m, "set_terms", set_terms,
        "Set the parameters of a lens of a model; the code of its base. `pixels` are fx, fy, cx, "
        "cy and skew.",
        "model", "pixels", "coefficients", "params");
    def(m, "is_coefficient", is_coefficient,
        "True where the equations of a model with coefficient k are a lens.", "model", "k",
        "value");
    def(m, "is_planar", is_planar<int64_t>, "True for a base whose sharpness depends on the depth.",
        "code");
    def(m, "find_region", find_region,
        "Set LIMIT and SLOPE of the valid region of a lens; its angle, and whether it is whole.",
        "code", "width", "height", "max_angle", "params");
    m.def("pack", pack, nb::arg("code"), nb::arg("params"), nb::arg("angle"), nb::arg("width"),
          nb::arg("height"), nb::arg("edge_tolerance"), nb::arg("field_tolerance"),
          nb::sig("def pack(code: int, params: object, angle: float, width: float, height: float, "
                  "edge_tolerance: float, field_tolerance: float) -> typing.Any"),
          "Row of numbers of a lens that is valid up to an angle.");
    def(m, "find_met", find_met, "Set `out` to whether cells may have a point of the region.",
        "plane", "x", "y", "half_x", "half_y", "out");
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
