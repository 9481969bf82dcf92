// Bounds of the areas under the images of edges: how long an edge a rule of n + 1 nodes integrates.
//
// With Chebyshev coefficients u_a and v_b of u and v along the edge, the rule is off by
//
//     sum over a, b of e_ab u_a v_b,
//
// e_ab what it is off by for T_a and T_b. That is 0 for a + b <= 2 n; for a + b even, where both
// the rule and the integral are 0, because the nodes are symmetric and the ends change the sign;
// and for a or b = 0. For the others up to DEGREES it is computed, and beyond it is at most 2 (a +
// b) + 8 n: the integral of half (T_a dT_b - T_b dT_a) is at most a + b in size, because T_a varies
// by 2 a, and the rule's value at most sum |S_ij| <= 8 n.
//
// h half the length of an edge, |u_a| <= 2 (h / 2)^a C_a, C_a a bound of the derivative of order a
// over a! on it (`taylor_bounds`). And where u is analytic in the ellipse of Bernstein with sum of
// half axes rho around it, and |u - u0| <= M in there, |u_a| <= 2 M rho^-a. Points of the ellipse
// are within R = h (rho + 1 / rho) / 2 of the middle of the edge, so a bound M of what is within R
// is enough.
//
// By Cauchy's estimate a bound M of |u - u0| within R of a point bounds the derivatives there, too:
// that of order m is at most m! M / R^m.
//
// Twins: tests/lenses/test_quadrature.py, tests/lenses/test_expansions.py.
#include "lens/ball.hpp"
#include "lens/proof.hpp"
#include "lens/rules.hpp"
#include "lens/series.hpp"

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Factor on a bound, for the rounding of the operations on centres and radii.
constexpr double ROUNDING = 1 + 1e-9;
constexpr double PLANE_CELLS = 24;    // of a side of the box around a region, for balls
constexpr double CELLS_OF_LINES = 12; // and for expansions
constexpr int DEEPEST_CELL = 6;       // divisions of a cell that is too large for a bound
constexpr size_t MOST_CELLS = 20'000; // after which divisions end
constexpr int N_RADII = 24, N_RADII_NEAR_POLE = 12;
// Pixels below which cells of a rational lens, whose denominator comes near 0, are not divided.
constexpr double REACH_NEAR_POLE = 1e4;
// Rounding of a coefficient relative to its bound by Cauchy's estimate.
constexpr double ROUNDING_REL = 0x1p-40;
constexpr double PAIR_ROUNDING = 1e-10; // more than the rounding of e_ab
constexpr int HALVINGS = 24;

double binomial(int n, int k) {
    double found = 1.0;
    for (int i = 0; i < k; i++) found = found * (n - i) / (i + 1);
    return std::nearbyint(found);
}

struct Widest { // of some reaches
    double u = 0.0;
    double v = 0.0;
    void add(const Reach &reach) {
        u = std::max(u, reach.u);
        v = std::max(v, reach.v);
    }
};

bool is_limited(const Reach &reach) { return std::max(reach.u, reach.v) < INFINITE; }

// Longitude does not change with the distance from the pole, and latitude changes less and less:
// the ring from 1/2 outwards bounds all smaller ones, and a few are tried.
Reach reach_around_pole(const Ideal &plane, const Cells &cells, double radius, bool is_near_pole) {
    Widest most;
    for (size_t k = 0; k < cells.x.size(); k++) {
        const double x = cells.x[k], y = cells.y[k], size = rounded::hypot(x, y);
        if (size < 0.5 - cells.reach()) continue;
        for (const double part : {1.0, 2.0, 4.0, 8.0})
            most.add(reach_at(plane, x / part, y / part, (radius * size + cells.reach()) / part,
                              is_near_pole));
    }
    return {radius, most.u, most.v};
}

// Coefficients of u and v in a cell, the greatest over all lines: at its middle, and anywhere.
struct InCell {
    double middle[2][MOST_ORDER + 1], everywhere[2][MOST_ORDER + 1];
};

// In the plane a form of degree k is a trigonometric polynomial of degree k of the angle of its
// direction, so LINES of them bound all others: where such a polynomial is greatest, at M, it is at
// least M cos(k a) at the angle a from there [M. Riesz. Eine trigonometrische Interpolationsformel.
// 1914], and a direction is within half a step.
InCell in_cell(const std::pair<Series, Series> &pixels) {
    InCell found;
    for (int axis = 0; axis < 2; axis++) {
        const Series &series = axis == 0 ? pixels.first : pixels.second;
        for (int order = 0; order <= MOST_ORDER; order++) {
            double size = 0.0;
            double most = 0.0;
            bool is_known = true;
            for (int k = 0; k < LINES && order < series.n; k++) {
                const double own = std::abs(series.at[order].centre[k]);
                const double end = own + series.at[order].off[k];
                is_known = is_known && end < INFINITE;
                size = std::max(size, own);
                most = std::max(most, end);
            }
            const double least = rounded::cos(order * PI / (2 * LINES));
            // Where an interval has no limit, its centre means nothing.
            found.middle[axis][order] = is_known ? size / least : INFINITE;
            found.everywhere[axis][order] = is_known ? most / least : INFINITE;
        }
    }
    return found;
}

// Bounds of the Taylor coefficients of u and v along all lines, at points of the region, px per
// (unit of the plane)^k; infinite for k = 0, which changes nothing.
//
// The equations of the lens are evaluated at p + t d, p all points of a cell and d a unit vector,
// as polynomials in t up to t^MOST_ORDER. Their coefficients are intervals that hold those of each
// p, around those of the middle. A coefficient c_k, the k-th derivative over k!, is a form of
// degree k in d. With C_k the greatest over all d,
//
//     C_k at q <= sum over j < m of binomial(k + j, j) |q - p|^j C_(k+j) at p
//                 + binomial(k + m, m) |q - p|^m C_(k+m) on the way,
//
// because derivatives along different directions are no greater than those along one [S. Banach.
// Über homogene Polynome in (L^2). 1938]. Intervals get wider with each order, and so the best m
// counts: the result is near the truth, while Cauchy's estimate from complex balls is a hundred
// times too large.
void set_taylor_bounds(const Ideal &plane, EdgeBounds &bounds) {
    constexpr int N = MOST_ORDER + 1;
    double by_cauchy[2][N];
    for (int order = 0; order < N; order++) {
        by_cauchy[0][order] = by_cauchy[1][order] = INFINITE;
        for (const auto &[radius, u, v] : bounds.reaches) {
            const double scale = rounded::power(radius, order);
            by_cauchy[0][order] = std::min(by_cauchy[0][order], u / scale);
            by_cauchy[1][order] = std::min(by_cauchy[1][order], v / scale);
        }
    }
    const auto [x, y] = box_of(plane.region);
    const double width = x.most - x.least, height = y.most - y.least;
    const double side = std::sqrt(width * height) / CELLS_OF_LINES;
    const Cells cells = plane.cells(std::ceil(width / side), std::ceil(height / side));
    const bool behind = is_behind(plane, cells);
    const double away = rounded::hypot(cells.half_x, cells.half_y);
    double powers[N];
    for (int j = 0; j < N; j++) powers[j] = rounded::power(away, j);
    double *const most[] = {bounds.u.data(), bounds.v.data()};
    for (int axis = 0; axis < 2; axis++) std::fill(most[axis] + 1, most[axis] + N, 0.0);
    for (size_t cell = 0; cell < cells.x.size(); cell++) {
        const InCell found = in_cell(pixels_along_lines(
            plane, cells.x[cell], cells.y[cell], cells.half_x, cells.half_y, MOST_ORDER, behind));
        for (int axis = 0; axis < 2; axis++) {
            double best[N], middle[N];
            for (int order = 0; order < N; order++) {
                const double rounding = ROUNDING_REL * by_cauchy[axis][order];
                best[order] =
                    std::min(found.everywhere[axis][order] + rounding, by_cauchy[axis][order]);
                middle[order] = found.middle[axis][order] + rounding;
            }
            for (int order = 0; order < MOST_ORDER; order++) {
                double total = 0.0;
                double rest = best[order];
                for (int j = 0; j < N - order; j++) {
                    const double weight = binomial(order + j, j) * powers[j];
                    rest = std::min(rest, total + weight * best[order + j]);
                    total += weight * middle[order + j];
                }
                best[order] = rest;
            }
            for (int order = 1; order < N; order++)
                most[axis][order] = std::max(most[axis][order], best[order]);
        }
    }
}

// Sum over s > DEGREES of (s + 1) (2 s + 8 n) x^s, 0 < x < 1.
double tail(int64_t n, double x) {
    // s = m + j: (m + 1 + j) (2 m + 8 n + 2 j), summed over j.
    constexpr double m = DEGREES + 1, first = m + 1;
    const double second = 2 * m + 8 * double(n), rest = 1 - x;
    const double series = first * second / rest + (2 * first + second) * x / (rest * rest) +
                          2 * x * (1 + x) / (rest * rest * rest);
    return series * rounded::power(x, m);
}
} // namespace

Reach reach_at(const Ideal &plane, double x, double y, double radius, bool is_near_pole) {
    const Ball X = {x, 0.0, radius, is_near_pole}, Y = {y, 0.0, radius, is_near_pole};
    const auto ray = [&](size_t row) {
        const double *const f = &plane.frame[3 * row];
        return f[0] * X + f[1] * Y + f[2];
    };
    const auto [u, v] = projected(plane.code, view_of(plane.params), ray(0), ray(1), ray(2));
    const auto bound = [](const Ball &pixel) {
        return pixel.off < INFINITE ? pixel.off * ROUNDING : INFINITE;
    };
    return {radius, bound(u), bound(v)};
}

Reach Ideal::reach(double radius, bool is_near_pole) const {
    Cells cells = this->cells(PLANE_CELLS, PLANE_CELLS);
    if (has_pole) return reach_around_pole(*this, cells, radius, is_near_pole);
    const Reach none = {radius, INFINITE, INFINITE};
    const Sides around = sides();
    Widest most;
    for (int depth = 0; depth <= DEEPEST_CELL; depth++) {
        const double enough = is_near_pole && depth < DEEPEST_CELL ? REACH_NEAR_POLE : INFINITE;
        Cells left = {{}, {}, cells.half_x / 2, cells.half_y / 2};
        size_t n_left = 0;
        for (size_t k = 0; k < cells.x.size(); k++) {
            const double x = cells.x[k], y = cells.y[k];
            const Reach found = reach_at(*this, x, y, radius + cells.reach(), is_near_pole);
            if (std::max(found.u, found.v) < enough) {
                most.add(found);
                continue;
            }
            n_left++;
            // No size of cells helps where the point itself has no bound.
            if (depth == DEEPEST_CELL || n_left > MOST_CELLS) return none;
            if (around.meet(x, y, 0.0, 0.0) &&
                !is_limited(reach_at(*this, x, y, radius, is_near_pole)))
                return none;
            // A cell that meets a pole only for its size is divided into four.
            for (const double j : {-1.0, 1.0})
                for (const double i : {-1.0, 1.0}) {
                    const double part_x = x + i * left.half_x, part_y = y + j * left.half_y;
                    if (!around.meet(part_x, part_y, left.half_x, left.half_y)) continue;
                    left.x.push_back(part_x);
                    left.y.push_back(part_y);
                }
        }
        if (n_left == 0) return {radius, most.u, most.v};
        cells = std::move(left);
    }
    return none;
}

std::vector<Reach> Ideal::reaches() const {
    std::vector<Reach> found;
    const auto add = [&](double first, double last, int n, bool is_near_pole) {
        for (int k = 0; k < n; k++) {
            found.push_back(reach(rounded::geometric(first, last, k, n), is_near_pole));
            if (is_limited(found.back())) continue;
            found.pop_back();
            return; // a larger radius meets the same pole
        }
    };
    add(1e-3, 1.5, N_RADII, false);
    if (found.empty() && (params[D1] != 0.0 || params[D2] != 0.0 || params[D3] != 0.0))
        add(3e-5, 1e-2, N_RADII_NEAR_POLE, true);
    return found;
}

bool is_behind(const Ideal &plane, const Cells &cells) {
    const double *const f = &plane.frame[6];
    const double off = std::abs(f[0]) * cells.half_x + std::abs(f[1]) * cells.half_y;
    for (size_t k = 0; k < cells.x.size(); k++)
        if (!(f[0] * cells.x[k] + f[1] * cells.y[k] + f[2] + off < 0.0)) return false;
    return true;
}

std::pair<Series, Series> pixels_along_lines(const Ideal &plane, double x, double y, double half_x,
                                             double half_y, int order, bool is_behind) {
    static const auto DIRECTIONS = [] {
        std::array<Point<double>, LINES> found;
        for (int k = 0; k < LINES; k++)
            found[size_t(k)] = {rounded::cos(PI * k / LINES), rounded::sin(PI * k / LINES)};
        return found;
    }();
    Series X = Series::zero(2, order), Y = X;
    for (int k = 0; k < LINES; k++) {
        X.at[0].centre[k] = x;
        X.at[0].off[k] = half_x;
        X.at[1].centre[k] = DIRECTIONS[size_t(k)].x;
        Y.at[0].centre[k] = y;
        Y.at[0].off[k] = half_y;
        Y.at[1].centre[k] = DIRECTIONS[size_t(k)].y;
    }
    const auto ray = [&](size_t row) {
        const double *const f = &plane.frame[3 * row];
        return f[0] * X + f[1] * Y + f[2];
    };
    Series Z = ray(2);
    Z.is_behind = is_behind;
    const auto [u, v] = projected(plane.code, view_of(plane.params), ray(0), ray(1), Z);
    return {u, v};
}

const double *pair_errors() {
    constexpr int64_t N = DEGREES + 1;
    static const std::vector<double> table = [] {
        std::vector<double> errors(size_t(TABLE * N * N));
        for (int64_t n = 1; n < TABLE; n++) {
            double at[N][TABLE] = {}; // T_a at the nodes, less its value at the first
            for (int64_t i = 0; i <= n; i++) {
                const double turn = rounded::acos(std::clamp(2 * NODES[n][i] - 1, -1.0, 1.0));
                for (int64_t a = 0; a < N; a++)
                    at[a][i] = rounded::cos(double(a) * turn) - (a % 2 ? -1.0 : 1.0);
            }
            for (int64_t a = 1; a < N; a++)
                for (int64_t b = 1 + a % 2; b < N - a; b += 2) {
                    if (a + b <= 2 * n) continue;
                    double rule = 0.0; // u_j v_i - u_i v_j with j < i, of S antisymmetric
                    for (int64_t i = 1; n >= FEWEST && i <= n; i++)
                        for (int64_t j = 0; j < i; j++)
                            rule += WEIGHTS[n][i][j] * (at[a][i] * at[b][j] - at[a][j] * at[b][i]);
                    // Of half (T_a dT_b - T_b dT_a), a + b odd, by the angle of the place.
                    const double a2 = double(a * a), b2 = double(b * b);
                    const double whole = (a2 + b2) / (b2 - a2) + (a % 2 ? 1.0 : -1.0);
                    errors[size_t((n * N + a) * N + b)] = std::abs(rule - whole) + PAIR_ROUNDING;
                }
        }
        return errors;
    }();
    return table.data();
}

EdgeBounds edge_bounds(const Ideal &plane) {
    const std::vector<double> unknown(MOST_ORDER + 1, INFINITE);
    EdgeBounds bounds = {plane.reaches(), unknown, unknown};
    // The reach of a plane with a pole is not in its units.
    if (!plane.has_pole && !bounds.reaches.empty()) set_taylor_bounds(plane, bounds);
    return bounds;
}

// Bound of the error of the bulge of an edge of half a length by rule n, px^2; infinite where the
// edge is no shorter than twice all radii. What is infinite bounds nothing, nor what is no number.
double EdgeBounds::error(double half, int64_t n) const {
    constexpr int N = DEGREES + 1;
    double most_u[N], most_v[N], beyond = INFINITE;
    std::fill_n(most_u, N, INFINITE);
    std::fill_n(most_v, N, INFINITE);
    bool is_wide = false;
    bool is_number = true;
    for (const auto &[radius, size_u, size_v] : reaches) {
        if (!(radius > half)) continue;
        is_wide = true;
        const double ratio = radius / std::max(half, 1e-300);
        const double x = 1 / (ratio + std::sqrt(ratio - 1) * std::sqrt(ratio + 1));
        double power = 1.0;
        for (int degree = 0; degree < N; degree++, power *= x) {
            most_u[degree] = std::min(most_u[degree], 2 * size_u * power);
            most_v[degree] = std::min(most_v[degree], 2 * size_v * power);
        }
        const double own = 4 * size_u * size_v * tail(n, x);
        is_number = is_number && !std::isnan(own);
        beyond = std::min(beyond, own);
    }
    if (!is_wide || !is_number) return INFINITE;
    double power = 1.0;
    for (int degree = 1; degree < int(u.size()); degree++) {
        power *= half / 2;
        most_u[degree] = std::fmin(most_u[degree], 2 * power * u[size_t(degree)]);
        most_v[degree] = std::fmin(most_v[degree], 2 * power * v[size_t(degree)]);
    }
    const double *const errors = pair_errors() + n * N * N;
    double error = beyond;
    for (int a = 1; a < N; a++)
        for (int b = 1 + a % 2; b < N - a; b += 2)
            if (errors[a * N + b] > 0.0) error += most_u[a] * errors[a * N + b] * most_v[b];
    return error >= 0.0 ? error : INFINITE;
}

// Half the longest edge that a rule integrates to the tolerance; 0 if none.
double EdgeBounds::longest(double tolerance, int64_t n) const {
    double low = 0.0;
    double high = 0.0;
    for (const Reach &reach : reaches) high = std::max(high, reach.radius);
    for (int k = 0; k < HALVINGS; k++) {
        const double middle = (low + high) / 2;
        (error(middle, n) <= tolerance ? low : high) = middle;
    }
    return low;
}

EdgeTable edge_table(const EdgeBounds &bounds, double tolerance) {
    EdgeTable table = {tolerance, {}, FEWEST};
    for (int64_t n = FEWEST; n <= MOST; n++)
        table.longest[size_t(n)] = bounds.longest(tolerance, n);
    // More nodes are good for all edges that fewer are good for.
    for (size_t n = MOST; n-- > FEWEST;)
        table.longest[n] = std::min(table.longest[n], table.longest[n + 1]);
    require(table.longest[MOST] > 0.0,
            "expected a lens without a pole in its valid region, below 89.9 degrees, got one; give "
            "a smaller max_angle_deg");
    // Cost of a length: values are n a part, and products n^2 / 2, which are a tenth of a value.
    double least = INFINITE;
    for (int64_t n = FEWEST; n <= MOST; n++) {
        const double cost =
            double(n) * (1 + double(n) / 20) / std::max(table.longest[size_t(n)], 1e-300);
        if (cost < least) {
            least = cost;
            table.parts_of = n;
        }
    }
    return table;
}

} // namespace rastercov::lens
