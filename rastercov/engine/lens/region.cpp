// Valid region of a lens: a cone around the z axis on which it is proved to be injective, and on
// one with SECTORS flat sides around it, to which surfaces are cut before the cone itself is looked
// at.
//
// A polynomial that was fitted inside the image may fold outside it, and then two rays have one
// pixel. So nothing outside the valid region is ever projected. The proof has three parts:
//
// 1. The base is injective up to an angle known in closed form (`limit_of`).
// 2. On the disc of radius s of the plane of the base the distortion is injective. Its derivative
//    there has a symmetric part of at least
//
//        min(f / r, f') - t(r),   f the radial part,
//        t(r) = 6 r |(P1, P2)| + 2 r |(S1, S3)| + 4 r^3 |(S2, S4)|,
//
//    and a map whose derivative has a positive symmetric part on a convex set is injective on it.
//    Where the tangential terms take the radially distorted point, both parts are injective:
//    min(f / r, f') > 0 and t(f) < 1. `certified_radius` proves it by their Taylor series, from
//    the axis on.
// 3. The horizon of a tilted sensor is beyond the image of the disc.
//
// The region is then made as small as covers the image, and 2 % more: a lens is known no further.
//
// Twin: tests/lenses/test_region.py.
#include "lens/proof.hpp"
#include "lens/rays.hpp"

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Largest angle from the axis of a base on a plane in front of the camera, and of any other.
constexpr double PLANE_DEG = 89.9, WIDEST_DEG = 175.0;
// Radians: least angle of a region; a camera of the longest focal length sees 1e-12 rad a pixel.
constexpr double NARROWEST = 1e-12;
// Share of the limit of a base that is used: at the limit itself a radius has half its digits.
constexpr double BELOW_LIMIT = 1 - 1e-6;
constexpr double MARGIN = 1.02; // radius of the region over the least that covers the image
// Radius of the proof over the least that covers the image: derivatives are taken in cells of the
// plane, some of which reach beyond the region.
constexpr double SPARE = 1.25;
// Length of a cell, and over its place, below which a proof fails; and cells after which it does.
constexpr double FIRST_CELL = 1e-12, LEAST_CELL = 1e-7;
constexpr int MOST_CELLS = 20'000;
constexpr double FAR = 1e100;   // radius beyond all pixels
constexpr int64_t BORDER = 256; // places of a side of the image, to find the least region
// More than the rounding of a polynomial, relative to the sum of its terms without their signs.
constexpr double ROUNDING_REL = 1e-9;

// Angle from the z axis, radians, up to which the base is injective.
double limit_of(int64_t code, const Params &p) {
    if (code == UNIFIED) {
        // z > -w sqrt(B2 r^2 + z^2), w the smaller of B0 and B1 over the larger.
        const double w = std::min(p[B0], p[B1]) / std::max(p[B0], p[B1]);
        return PI - rounded::atan2(std::sqrt(1.0 - w * w), w * std::sqrt(p[B2]));
    }
    if (code == DOUBLE_SPHERE) {
        const double xi = p[B0];
        const double w = std::min(p[B1], 1.0 - p[B1]) / std::max(p[B1], 1.0 - p[B1]);
        // From the center of the second sphere, xi + c > -w sqrt(1 + 2 xi c + xi^2), c the cosine
        // of the angle. The paper's (w + xi) / sqrt(2 w xi + xi^2 + 1) > -c is beyond the fold
        // where xi < 0 and alpha is near 1.
        const double rest = 1.0 - w * w;
        return rounded::acos(std::max(-1.0, -xi * rest - w * std::sqrt(1.0 - xi * xi * rest)));
    }
    if (code == DIVISION && p[B0] > 0.0) return rounded::atan(0.5 / std::sqrt(p[B0]));
    return PI;
}

// --- polynomials, by the powers of their terms ---

using Polynomial = std::vector<double>;

Polynomial operator*(const Polynomial &a, const Polynomial &b) {
    Polynomial product(a.size() + b.size() - 1);
    for (size_t i = 0; i < a.size(); i++)
        for (size_t j = 0; j < b.size(); j++) product[i + j] += a[i] * b[j];
    while (product.size() > 1 && product.back() == 0.0) product.pop_back();
    return product;
}
Polynomial operator*(double factor, Polynomial a) { return Polynomial{factor} * a; }
Polynomial operator+(Polynomial a, const Polynomial &b) {
    a.resize(std::max(a.size(), b.size()));
    for (size_t i = 0; i < b.size(); i++) a[i] += b[i];
    return a;
}
Polynomial operator-(const Polynomial &a, const Polynomial &b) { return a + -1.0 * b; }
Polynomial derivative_of(const Polynomial &a) {
    Polynomial found(std::max(a.size() - 1, size_t(1)));
    for (size_t i = 1; i < a.size(); i++) found[i - 1] = double(i) * a[i];
    return found;
}
// 1 + c_1 r^2 + ... + c_n r^2n.
Polynomial in_squares(const double *c, int n) {
    Polynomial found(size_t(2 * n) + 1);
    found[0] = 1.0;
    for (int k = 0; k < n; k++) found[size_t(2 * k) + 2] = c[k];
    while (found.size() > 1 && found.back() == 0.0) found.pop_back();
    return found;
}

// Polynomials of the radius that must be positive up to it: the proof, times powers of the
// denominator of the radial factor.
std::vector<Polynomial> conditions(const Params &p) {
    const Polynomial r = {0.0, 1.0}, one = {1.0};
    const Polynomial above = in_squares(&p[K1], 6), below = in_squares(&p[D1], 3);
    const Polynomial across = above * below; // f = r above / below
    const Polynomial along =
        across + r * (derivative_of(above) * below - above * derivative_of(below));
    const double tangential = rounded::hypot(p[P1], p[P2]);
    const double prism = rounded::hypot(p[S1], p[S3]), prism4 = rounded::hypot(p[S2], p[S4]);
    // The place n / d of the tangential terms, and what they add to the derivative and to f.
    const bool is_late = p[LATE] != 0.0;
    const Polynomial n = is_late ? r * above : r, d = is_late ? below : one;
    const Polynomial n2 = n * n, d2 = d * d, d4 = d2 * d2;
    const Polynomial turn = (6 * tangential + 2 * prism) * (n * d2) + 4 * prism4 * (n2 * n);
    const Polynomial shift = (3 * tangential + prism) * (n2 * d2) + prism4 * (n2 * n2);
    const Polynomial horizon =
        p[T22] * (below * d4) - rounded::hypot(p[T20], p[T21]) * (r * above * d4 + shift * below);
    if (is_late) return {across, along, d2 * d - turn, below, horizon};
    const Polynomial turned = turn * (below * below);
    return {across - turned, along - turned, below, horizon};
}

// Least distance from the axis of what the distortion makes of the circle of a radius.
double forward_radius(const Params &p, double radius) {
    const double f = radius * radial_factor(p, radius * radius);
    const double at = p[LATE] != 0.0 ? f : radius;
    const double tangential = 3.0 * rounded::hypot(p[P1], p[P2]) + rounded::hypot(p[S1], p[S3]);
    const double prism4 = rounded::hypot(p[S2], p[S4]);
    return f - (tangential + prism4 * at * at) * at * at;
}

// Calls with places along the border of the image, around it from the top-left corner.
template <class Each> void each_of_border(double width, double height, Each each) {
    constexpr double X[] = {0, 1, 1, 0}, Y[] = {0, 0, 1, 1};
    for (int side = 0; side < 4; side++)
        for (int64_t k = 0; k < BORDER; k++) {
            const double t = double(k) / BORDER;
            const int end = (side + 1) % 4;
            each((1 - t) * (X[side] * width) + t * (X[end] * width),
                 (1 - t) * (Y[side] * height) + t * (Y[end] * height));
        }
}

// Greatest distance from the axis of the border of the image, in the plane of the base; infinite
// where a place of it has no point.
double farthest(const Params &p, double width, double height) {
    double most = 0.0;
    each_of_border(width, height, [&](double u, double v) {
        const auto [x, y] = base_point(p, u, v);
        const double away = rounded::hypot(x, y);
        most = away < INFINITE ? std::max(most, away) : INFINITE;
    });
    return most;
}

double flatten(double angle, bool is_along) {
    const double flat = rounded::cos(PI / SECTORS);
    return is_along ? rounded::atan2(rounded::sin(angle), rounded::cos(angle) * flat)
                    : rounded::atan2(rounded::sin(angle) * flat, rounded::cos(angle));
}

// Angle of the largest cone whose `around` is at most an angle, radians.
double within(double angle) { return flatten(angle, rounded::cos(angle) <= 0.0); }

bool is_finite(const Ray &ray) {
    return std::isfinite(ray.X) && std::isfinite(ray.Y) && std::isfinite(ray.Z);
}
} // namespace

double around(double angle) { return flatten(angle, rounded::cos(angle) > 0.0); }

double base_limit(int64_t code, const Params &p) {
    const double most = around((is_planar(code) ? PLANE_DEG : WIDEST_DEG) * (PI / 180));
    return std::min(limit_of(code, p) * BELOW_LIMIT, most);
}

// True where polynomials are proved to be positive from `low` to `high`, by their Taylor series in
// the middle, whose other terms are less than the first.
bool are_positive(const std::vector<Polynomial> &rows, double low, double high) {
    const double middle = (low + high) / 2, half = (high - low) / 2;
    for (const Polynomial &row : rows) {
        Polynomial series = row; // by the powers of the distance from the middle
        double most = 0.0;
        double power = 1.0;
        double others = 0.0;
        for (const double term : row) {
            most += std::abs(term) * power;
            power *= high;
        }
        const size_t n = row.size();
        for (size_t first = 0; first + 1 < n; first++)
            for (size_t k = n - 1; k-- > first;) series[k] += middle * series[k + 1];
        power = 1.0;
        for (size_t k = 1; k < n; k++) {
            power *= half;
            others += std::abs(series[k]) * power;
        }
        if (!(series[0] - others > most * ROUNDING_REL)) return false;
    }
    return true;
}

// Largest radius, at most `top`, up to which the distortion is proved to be injective; 0 where it
// folds at the axis itself. Found to LEAST_CELL of its value, unless the image of a disc that is
// SPARE times smaller has all points up to the distance `enough` from the axis.
double certified_radius(const Params &p, double top, double enough) {
    const auto rows = conditions(p);
    double done = 0.0;
    double cell = std::min(top, 1.0) / 16;
    for (int k = 0; k < MOST_CELLS; k++) {
        if (done >= top || cell < std::max(LEAST_CELL * done, FIRST_CELL * std::min(top, 1.0)))
            break;
        const double following = std::min(done + cell, top);
        if (are_positive(rows, done, following)) {
            done = following;
            cell *= 2;
            if (forward_radius(p, done / SPARE) >= enough) break;
        } else {
            cell /= 2;
        }
    }
    return done;
}

std::vector<Ray> border_rays(int64_t code, const Params &p, double width, double height) {
    std::vector<Ray> rays;
    each_of_border(width, height,
                   [&](double u, double v) { rays.push_back(unproject(code, p, u, v)); });
    return rays;
}

Region region_of(int64_t code, const Numbers &given, double width, double height,
                 double max_angle) {
    Region found = {given, PI, false};
    Numbers &p = found.params;
    const Params view = view_of(p);
    if (code == EQUIRECTANGULAR) {
        p[LIMIT] = INFINITE;
        p[SLOPE] = 0.0;
    } else {
        const double top = std::min(base_limit(code, view), around(max_angle));
        const double edge = image_of_base(code, view, rounded::sin(top), 0.0, rounded::cos(top)).x;
        Numbers undistorted = given;
        std::fill(undistorted.begin() + K1, undistorted.begin() + T00, 0.0);
        undistorted[LIMIT] = FAR;
        const double reached = farthest(view_of(undistorted), width, height);
        p[LIMIT] = certified_radius(view, edge, reached);
        require(p[LIMIT] > 0.0,
                "expected distortion that is one-to-one near the axis, got a fold; check the order "
                "and size of its coefficients");
        const double need = farthest(view, width, height);
        const double radius = need < INFINITE ? std::min(p[LIMIT], MARGIN * need) : p[LIMIT];
        const Ray ray = ray_of(code, view, radius, 0.0);
        const double angle = rounded::atan2(rounded::hypot(ray.X, ray.Y), ray.Z);
        found.angle = std::min(within(angle), max_angle);
        expect(found.angle >= NARROWEST, "a lens that is valid to 1e-12 rad from the axis",
               found.angle, "check the order and size of its coefficients");
        p[SLOPE] = rounded::tan(found.angle);
    }
    const auto rays = border_rays(code, view, width, height);
    found.is_whole = std::all_of(rays.begin(), rays.end(), is_finite);
    return found;
}

} // namespace rastercov::lens
