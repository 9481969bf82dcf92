// Pixels of rays of a lens, their derivatives, and rays of pixels, many at a time.
//
// The distortion is undone by bracketed Newton steps for its radial part, by Newton's method from
// there for the rest, and where that leaves the region, along the way from the axis; it is
// injective within LIMIT, so that the answer is the only one.
//
// Invariants: every loop ends for any content of the parameters; a ray or pixel without an answer
// is NaN.
//
// Twins: rastercov.reference.lenses; tests/lenses/test_lens.py.
#include "lens/rays.hpp"
#include "bind.hpp"
#include "interrupt.hpp"

namespace rastercov {
namespace lens {
namespace {

constexpr int BRACKET_STEPS = 200, NEWTON_STEPS = 40, HALVINGS = 20, CONTINUATIONS = 32;
// Margin of reach_of: more than find_by_newton allows beyond LIMIT, and than rounding.
constexpr double BEYOND_REL = 1e-6;
// Residual of Newton's method, of the length of its target, that further steps need not lessen.
constexpr double ROUNDING = 1e-11;
constexpr Point<double> NO_POINT = {NOT_A_NUMBER, NOT_A_NUMBER};

// Radius that nothing within LIMIT is moved beyond, `top` that of radial distortion alone.
double reach_of(const Params &p, double top) {
    const double m = p[LATE] != 0.0 ? top : p[LIMIT];
    const double tangential =
        4.0 * (std::abs(p[P1]) + std::abs(p[P2])) + std::abs(p[S1]) + std::abs(p[S3]);
    return (top + m * m * (tangential + m * m * (std::abs(p[S2]) + std::abs(p[S4])))) *
           (1.0 + BEYOND_REL);
}

// Radius that radial distortion moves to `size`, on the branch that rises from 0; else NaN.
double undo_radial(const Params &p, double size) {
    double low = 0.0;
    double high = p[LIMIT];
    const double top = high * radial_factor(p, high * high);
    if (!(size <= top)) // rounding of the last digits at the very limit
        return size <= top * (1.0 + 4e-16) ? high : NOT_A_NUMBER;
    double r = std::min(size, high);
    for (int step = 0; step < BRACKET_STEPS; step++) {
        Step moved = {r, STEP};
        moved = moved * radial_factor(p, moved * moved);
        const double value = moved.real - size;
        (value > 0.0 ? high : low) = r;
        double following = r - value / (moved.imag / STEP);
        if (!(low < following && following < high)) following = 0.5 * (low + high);
        if (std::abs(following - r) <= 1e-16 * r || value == 0.0)
            return value == 0.0 ? r : following;
        r = following;
    }
    return r;
}

// Distorted point (a, b) of a point (x, y), and its derivatives.
struct Moved {
    double a, b, a_x, a_y, b_x, b_y;
};

Moved moved_point(const Params &p, double x, double y) {
    const auto by_x = distort(p, Step(x, STEP), Step(y));
    const auto by_y = distort(p, Step(x), Step(y, STEP));
    return {by_x.x.real,        by_x.y.real,        by_x.x.imag / STEP,
            by_y.x.imag / STEP, by_x.y.imag / STEP, by_y.y.imag / STEP};
}

struct Found {
    double x, y;
    bool is_good;
};

// Newton's method with halved steps; good where it converges within the limit.
Found find_by_newton(const Params &p, double a, double b, double x, double y) {
    const double limit2 = p[LIMIT] * p[LIMIT] * (1.0 + 1e-9), size = std::abs(a) + std::abs(b);
    Moved at = moved_point(p, x, y);
    double left = rounded::hypot(a - at.a, b - at.b);
    for (int step = 0; step < NEWTON_STEPS; step++) {
        const double det = at.a_x * at.b_y - at.a_y * at.b_x, da = a - at.a, db = b - at.b;
        const double dx = (at.b_y * da - at.a_y * db) / det, dy = (at.a_x * db - at.b_x * da) / det;
        double scale = 1.0;
        double x1 = x;
        double y1 = y;
        double following = left;
        bool is_better = false;
        for (int halving = 0; halving < HALVINGS && !is_better; halving++) {
            x1 = x + scale * dx;
            y1 = y + scale * dy;
            at = moved_point(p, x1, y1);
            following = rounded::hypot(a - at.a, b - at.b);
            is_better = following < left && x1 * x1 + y1 * y1 <= 4.0 * limit2;
            scale *= 0.5;
        }
        if (!is_better) break; // rounding is reached, or there is no way down
        x = x1;
        y = y1;
        left = following;
        if (left == 0.0) break;
    }
    return {x, y, left <= ROUNDING * size && ROUNDING * size < INFINITE && x * x + y * y <= limit2};
}

// Point (x, y) within LIMIT of the axis that `distorted` moves to (a, b); else NaN.
Point<double> undo_distortion(const Params &p, double a, double b) {
    const double size = rounded::hypot(a, b);
    if (size == 0.0) return {0.0 * a, 0.0 * b};
    if (is_radial(p)) {
        const double ratio = undo_radial(p, size) / size;
        return {a * ratio, b * ratio};
    }
    const double top = p[LIMIT] * radial_factor(p, p[LIMIT] * p[LIMIT]);
    // Newton's method would take long to find nothing.
    if (size > reach_of(p, top)) return NO_POINT;
    const double ratio = undo_radial(p, std::min(size, top)) / size;
    Found found = find_by_newton(p, a, b, a * ratio, b * ratio);
    if (found.is_good) return {found.x, found.y};
    found = {0.0, 0.0, true};
    for (int k = 1; k <= CONTINUATIONS; k++) {
        const double part = double(k) / CONTINUATIONS;
        found = find_by_newton(p, part * a, part * b, found.x, found.y);
        if (!found.is_good) return NO_POINT;
    }
    return {found.x, found.y};
}

// Distorted point (a, b) of a pixel, before the tilt; NaN beyond the horizon of the tilt.
Point<double> sensor_point(const Params &p, double u, double v) {
    const double b = (v - p[CY]) / p[FY], a = (u - p[CX] - p[SKEW] * b) / p[FX];
    if (p[T20] == 0.0 && p[T21] == 0.0) return {a, b};
    // a = T00 a0 w, b = (T10 a0 + T11 b0) w, 1/w = T20 a0 + T21 b0 + T22: a0 = x/h, b0 = y/h.
    const double x = a / p[T00], y = (b - p[T10] * x) / p[T11];
    const double h = 1.0 - p[T20] * x - p[T21] * y;
    if (!(h > 0.0)) return NO_POINT;
    return {p[T22] * x / h, p[T22] * y / h};
}

} // namespace

Ray unproject(int64_t code, const Params &p, double u, double v) {
    constexpr double PI = std::numbers::pi;
    const auto [a, b] = sensor_point(p, u, v);
    if (code == EQUIRECTANGULAR) {
        // Pixels of the image alone; beyond it the same rays would come again.
        if (!(std::abs(a) <= PI * (1.0 + 1e-15) && std::abs(b) <= 0.5 * PI * (1.0 + 1e-15)))
            return NO_RAY;
        return {rounded::sin(a) * rounded::cos(b), rounded::sin(b),
                rounded::cos(a) * rounded::cos(b)};
    }
    const auto [x, y] = undo_distortion(p, a, b);
    const Ray ray = ray_of(code, p, x, y);
    return is_valid(p, ray.X, ray.Y, ray.Z) ? ray : NO_RAY;
}

Point<double> base_point(const Params &p, double u, double v) {
    const auto [a, b] = sensor_point(p, u, v);
    return undo_distortion(p, a, b);
}
} // namespace lens

// --- loops ---

namespace {
using namespace lens;

using Rays = FloatRows<3>;
using Pixels = FloatRows<2>;

template <class Given, class Out> void require_rows(const Given &given, const Out &out) {
    require(given.rows() == out.rows(), "out must have one row for each ray, pixel or point");
}

// Visits the rays in the valid region; rows of others are NaN.
template <class Out, class Visit>
void each_valid(Params p, Rays rays, const Out &out, Visit visit) {
    require_rows(rays, out);
    std::fill(out.begin(), out.end(), NOT_A_NUMBER);
    for (int64_t i = 0; i < rays.rows(); i++)
        if (is_valid(p, rays(i, 0), rays(i, 1), rays(i, 2)))
            visit(i, rays(i, 0), rays(i, 1), rays(i, 2));
}

void project_many(int64_t code, Params p, Rays rays, Array<double, Any, 2> out) {
    each_valid(p, rays, out, [&](int64_t i, double X, double Y, double Z) {
        const auto [u, v] = project(code, p, X, Y, Z);
        out(i, 0) = u;
        out(i, 1) = v;
    });
}

void jacobian_many(int64_t code, Params p, Rays rays, Array<double, Any, 2, 3> out) {
    each_valid(p, rays, out, [&](int64_t i, double X, double Y, double Z) {
        const Jacobian d = jacobian(code, p, X, Y, Z);
        out(i, 0, 0) = d.ux;
        out(i, 0, 1) = d.uy;
        out(i, 0, 2) = d.uz;
        out(i, 1, 0) = d.vx;
        out(i, 1, 1) = d.vy;
        out(i, 1, 2) = d.vz;
    });
}

void store_ray(const Ray &ray, Array<double, Any, 3> out, int64_t i) {
    out(i, 0) = ray.X;
    out(i, 1) = ray.Y;
    out(i, 2) = ray.Z;
}

void unproject_many(int64_t code, Params p, Pixels pixels, Array<double, Any, 3> out) {
    require_rows(pixels, out);
    Poll poll;
    for (int64_t i = 0; i < pixels.rows(); i++) {
        poll();
        store_ray(unproject(code, p, pixels(i, 0), pixels(i, 1)), out, i);
    }
}

} // namespace

void register_lens_rays(nanobind::module_ &m) {
    def(m, "project_many", project_many,
        "Set `out`, (N, 2), to the pixels of rays (N, 3), NaN outside the valid region.", "code",
        "p", "rays", "out");
    def(m, "jacobian_many", jacobian_many,
        "Set `out`, (N, 2, 3), to the derivatives of pixels by rays (N, 3), NaN outside the valid "
        "region.",
        "code", "p", "rays", "out");
    def(m, "unproject_many", unproject_many,
        "Set `out`, (N, 3), to the rays of unit length of pixels (N, 2), NaN where there is none.",
        "code", "p", "pixels", "out");
}
} // namespace rastercov
