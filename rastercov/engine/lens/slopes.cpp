// Bounds of the second and third derivatives of a lens over parts of an ideal plane.
//
// The region is divided into cells. The equations are evaluated at p + t d, d a direction and p all
// points of a cell, as expansions in t up to t^5, whose coefficients are intervals that hold those
// of each p; that of order m is the derivative over m!, and bounds between directions follow as in
// edge_bounds.cpp. Where nothing is known by them, Cauchy's estimate bounds the derivatives. Then
// each cell is divided, differences give the derivatives in the middle of a part, and the bounds of
// the next orders what they are off by, and how much they change in the part.
//
// Next to a pole, and to the ray opposite to the axis of a fisheye, these bounds grow faster than
// what they are used for, the derivatives of the inverse of the first derivative; so that has its
// own.
//
// Twin: tests/lenses/test_slopes.py.
#include "lens/ball.hpp"
#include "lens/proof.hpp"
#include "lens/series.hpp"
#include <tuple>

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Factor on a bound for rounding, and the rounding of a coefficient relative to Cauchy's bound.
constexpr double ROUNDING = 1 + 1e-9, ROUNDING_REL = 0x1p-40;
// Step of the differences, in units of the plane: far less than the least of the radii.
constexpr double APART = 1e-3;
constexpr int FIRST_ORDER = 2, N_ORDERS = 4, LAST_ORDER = 5;
// Radii, in units of the plane, at which bounds are tried.
constexpr double LEAST_RADIUS = 0.01, MOST_RADIUS = 0.5;
constexpr int N_RADII = 12;
constexpr int RINGS = 2048; // around an axis in which a fisheye is bounded
constexpr int64_t N = CELLS, ALL = CELLS * PARTS;

// Derivatives of pixels along lines in a cell, and the size of the determinant of the first, px^2.
struct InCell {
    double most[N_ORDERS] = {}, least_size = 0.0, most_size = INFINITE;
};

InCell derivatives_in(const Ideal &plane, double x, double y, double half_x, double half_y,
                      bool is_behind) {
    static const auto RADII = [] {
        std::array<double, N_RADII> radii;
        for (int k = 0; k < N_RADII; k++)
            radii[size_t(k)] = rounded::geometric(LEAST_RADIUS, MOST_RADIUS, k, N_RADII);
        return radii;
    }();
    InCell found;
    std::fill_n(found.most, N_ORDERS, INFINITE);
    for (const double radius : RADII) {
        // All points of a cell have the ball of its middle within theirs.
        const Reach reach = reach_at(plane, x, y, radius + std::max(half_x, half_y), false);
        double factorial = 1.0;
        for (int order = FIRST_ORDER; order <= LAST_ORDER; order++) {
            factorial *= order;
            double &most = found.most[order - FIRST_ORDER];
            most = std::min(most, factorial * rounded::hypot(reach.u, reach.v) /
                                      rounded::power(radius, order));
        }
    }
    const auto [u, v] = pixels_along_lines(plane, x, y, half_x, half_y, LAST_ORDER, is_behind);
    const auto greatest = [](const Series &series, int order) {
        double most = 0.0;
        for (int k = 0; k < LINES && order < series.n; k++) {
            const double own = std::abs(series.at[order].centre[k]) + series.at[order].off[k];
            most = own <= most ? most : own; // what is no number stays
            if (std::isnan(most)) break;
        }
        return most;
    };
    double factorial = 1.0;
    for (int order = FIRST_ORDER; order <= LAST_ORDER; order++) {
        factorial *= order;
        double own = factorial * rounded::hypot(greatest(u, order), greatest(v, order)) * ROUNDING;
        own /= rounded::cos(order * PI / (2 * LINES)); // between directions
        double &most = found.most[order - FIRST_ORDER];
        most = std::fmin(most, own + ROUNDING_REL * most);
    }
    const auto first = [](const Series &series, int line) {
        if (series.n < 2) return Ball(0.0);
        return Ball(series.at[1].centre[line], series.at[1].off[line]);
    };
    const Ball det = first(u, 0) * first(v, LINES / 2) - first(u, LINES / 2) * first(v, 0);
    const double size = std::abs(det.re), most = (size + det.off) * ROUNDING;
    if (most < INFINITE) {
        found.most_size = most;
        found.least_size = std::max(size - det.off * ROUNDING, 0.0) / ROUNDING;
    }
    return found;
}

// A lens without distortion: pixels are affine in its plane.
bool is_affine(const Ideal &plane) {
    const Numbers &p = plane.params;
    const auto is_zero = [](double value) { return value == 0.0; };
    return plane.code == PINHOLE && std::all_of(p.begin() + K1, p.begin() + T00, is_zero) &&
           p[T20] == 0.0 && p[T21] == 0.0;
}

// By differences in the middle (x, y) of a part, `reach` half its diagonal, given bounds there: the
// second and the third derivative.
//
// With a step h a difference of first derivatives is off by h^2 / 6 times the fourth derivative,
// one of second order by h^2 / 12 times the fifth, or h^2 / 3 for a mixed one.
std::pair<double, double> sharpen(const Ideal &plane, double x, double y, double reach,
                                  const double (&bounds)[N_ORDERS]) {
    constexpr double STEP2 = APART * APART;
    double at[3][3][4]; // derivatives of pixels by x and y
    for (int i = -1; i <= 1; i++)
        for (int j = -1; j <= 1; j++) {
            const PlaneSlopes s = plane_slopes(plane.code, view_of(plane.params), plane.axes(),
                                               x + APART * i, y + APART * j);
            const double each[] = {s.u_x, s.u_y, s.v_x, s.v_y};
            std::copy_n(each, 4, at[i + 1][j + 1]);
        }
    double second = 0.0;
    double third = 0.0;
    for (int k = 0; k < 4; k++) {
        const double here = 2 * at[1][1][k];
        const double by_x = (at[2][1][k] - at[0][1][k]) / (2 * APART);
        const double by_y = (at[1][2][k] - at[1][0][k]) / (2 * APART);
        const double by_xx = (at[2][1][k] - here + at[0][1][k]) / STEP2;
        const double by_yy = (at[1][2][k] - here + at[1][0][k]) / STEP2;
        const double by_xy = (at[2][2][k] - at[2][0][k] - at[0][2][k] + at[0][0][k]) / (4 * STEP2);
        second += by_x * by_x + by_y * by_y;
        third += by_xx * by_xx + 2 * (by_xy * by_xy) + by_yy * by_yy;
    }
    return {std::fmin(bounds[0], std::sqrt(second) + bounds[1] * reach + bounds[2] * STEP2),
            std::fmin(bounds[1], std::sqrt(third) + bounds[2] * reach + bounds[3] * STEP2)};
}

// Greatest stretch of the inverse of (fx, skew; 0, fy).
double stretch_of_inverse(const Params &p) {
    const double a = 1 / p[FX], b = -p[SKEW] / (p[FX] * p[FY]), d = 1 / p[FY];
    if (b == 0.0) return std::max(std::abs(a), std::abs(d));
    return (rounded::hypot(a + d, b) + rounded::hypot(a - d, b)) / 2;
}

// `near_axis` in rings d +- half for pixels F(d) e_d, of intervals of F along lines; see below.
void bound_around_axis(const Series &F, const double *d, const double *half,
                       std::array<double, 4> &most) {
    Series line = Series::zero(2, 2), first = Series::zero(3, 2), slope = first;
    for (int k = 0; k < LINES; k++) {
        line.at[0].centre[k] = d[k];
        line.at[0].off[k] = half[k];
        line.at[1].centre[k] = 1.0;
        for (int order = 0; order < 3; order++) {
            first.at[order].centre[k] = F.at[order].centre[k];
            first.at[order].off[k] = F.at[order].off[k];
            slope.at[order].centre[k] = F.at[order + 1].centre[k] * (order + 1);
            slope.at[order].off[k] = F.at[order + 1].off[k] * (order + 1);
        }
    }
    const Series a = line / first, b = 1.0 / slope, h = b - a;
    const auto size = [](const Series &series, int order, int k) {
        return std::abs(series.at[order].centre[k]) + series.at[order].off[k];
    };
    for (int k = 0; k < LINES; k++) {
        const double far = d[k] + half[k];
        const double a_1 = size(a, 1, k), b_1 = size(b, 1, k), h_0 = size(h, 0, k);
        const double a_2 = 2 * size(a, 2, k), b_2 = 2 * size(b, 2, k), h_1 = size(h, 1, k);
        const double least_a = std::abs(a.at[0].centre[k]) - a.at[0].off[k];
        const double least_b = std::abs(b.at[0].centre[k]) - b.at[0].off[k];
        const double change = a_1 / least_a + b_1 / least_b;
        const double bend =
            (a_2 + a_1 * a_1 / least_a) / least_a + (b_2 + b_1 * b_1 / least_b) / least_b;
        const double found[] = {rounded::hypot(std::max(a_1, b_1) * far, h_0),
                                std::max(a_2, b_2) * (far * far) +
                                    (std::max(a_1, b_1) + h_1) * far + 2 * h_0,
                                change * far, std::max(bend * (far * far), change * far)};
        const bool is_good = std::min(least_a, least_b) > 0.0;
        for (size_t i = 0; i < 4; i++)
            most[i] = std::max(most[i], is_good && std::isfinite(found[i]) ? found[i] : INFINITE);
    }
}

// SlopeGrid::near_axis.
//
// Let d be the distance from (0, 0), e_d and e_phi the directions along and across it. Of a
// panorama, pixels are M (longitude, latitude), and A^-1 = (d e_phi, (1 + d^2) e_d) M^-1,
// det A = det M / (d (1 + d^2)): for d <= 2^(1/2), (A^-1)' is at most (1, 4 / d) by columns and
// (A^-1)'' (0, 4 / d^2). Of a fisheye without tangential terms pixels are M F(d) e_d, and
//
//     A^-1 = (a (I - P) + b P) M^-1,   a = d / F,   b = 1 / F',   P = e_d e_d^T,
//
// |P'| <= 1 / d, |P''| <= 2 / d^2. Expansions bound F, and so a and b, in rings.
std::array<double, 4> near_axis(const Ideal &plane) {
    const Params p = view_of(plane.params);
    const double inverse = stretch_of_inverse(p);
    if (plane.has_pole) return {std::sqrt(18.0) * inverse, 4.0 * inverse, 7.0 / 3, 7.0 / 3};
    if (plane.hole.empty() || std::abs(plane.frame[8]) < 1.0 || !is_radial(p) || p[T20] != 0.0 ||
        p[T21] != 0.0)
        return {INFINITE, INFINITE, INFINITE, INFINITE};
    Ideal own = plane;
    const double plain[] = {1.0, 1.0, 0.0, 0.0, 0.0};
    std::copy_n(plain, 5, own.params.begin());
    const double first = 0.99 * std::abs(p[SLOPE]), last = 1.001 * std::sqrt(2.0);
    std::array<double, 4> most = {};
    for (int start = 0; start < RINGS; start += LINES) {
        Series F = Series::zero(4, 3);
        double d[LINES], half[LINES];
        for (int k = 0; k < LINES; k++) {
            const int ring = std::min(start + k, RINGS - 1);
            const double inner = rounded::geometric(first, last, ring, RINGS + 1);
            const double outer = rounded::geometric(first, last, ring + 1, RINGS + 1);
            d[k] = (outer + inner) / 2;
            half[k] = (outer - inner) / 2;
            const auto [u, v] =
                pixels_along_lines(own, d[k], 0.0, half[k], 0.0, 3, plane.frame[8] < 0.0);
            const auto add = [&](const Series &pixel, double along) {
                for (int order = 0; order < std::min(pixel.n, 4); order++) {
                    F.at[order].centre[k] += along * pixel.at[order].centre[0];
                    F.at[order].off[k] += std::abs(along) * pixel.at[order].off[0];
                }
            };
            add(u, plane.frame[0]);
            add(v, plane.frame[3]);
        }
        bound_around_axis(F, d, half, most);
    }
    return {most[0] * inverse * ROUNDING, most[1] * inverse * ROUNDING, most[2] * ROUNDING,
            most[3] * ROUNDING};
}
} // namespace

SlopeGrid slope_grid(const Ideal &plane) {
    constexpr size_t n = size_t(N * N), n_parts = size_t(ALL * ALL);
    const Rectangle box = box_of(plane.region);
    const double low_x = box.x.least, low_y = box.y.least;
    const double half_x = (box.x.most - low_x) / (2 * double(N));
    const double half_y = (box.y.most - low_y) / (2 * double(N));
    SlopeGrid grid = {low_x,
                      low_y,
                      double(PARTS) / (2 * half_x),
                      double(PARTS) / (2 * half_y),
                      std::vector<double>(n_parts),
                      std::vector<double>(n_parts),
                      std::vector<double>(2 * n),
                      near_axis(plane)};
    std::fill(grid.sizes.begin() + int64_t(n), grid.sizes.end(), INFINITE);
    if (plane.has_pole) {
        std::fill(grid.second.begin(), grid.second.end(), INFINITE);
        grid.third = grid.second;
        return grid;
    }
    if (is_affine(plane)) return grid;
    // Which is no limit beyond the region.
    std::fill(grid.sizes.begin(), grid.sizes.begin() + int64_t(n), INFINITE);
    std::fill(grid.sizes.begin() + int64_t(n), grid.sizes.end(), 0.0);
    const bool behind = is_behind(plane, plane.cells(double(N), double(N)));
    const Sides around = plane.sides();
    const double reach = rounded::hypot(half_x / PARTS, half_y / PARTS);
    for (int64_t row = 0; row < N; row++)
        for (int64_t column = 0; column < N; column++) {
            const double x = low_x + half_x * double(2 * column + 1);
            const double y = low_y + half_y * double(2 * row + 1);
            if (!around.meet(x, y, half_x, half_y)) continue;
            const InCell found = derivatives_in(plane, x, y, half_x, half_y, behind);
            const auto cell = size_t(row * N + column);
            grid.sizes[cell] = found.least_size;
            grid.sizes[n + cell] = found.most_size;
            if (found.most[0] == 0.0) continue;
            for (int64_t j = PARTS * row; j < PARTS * (row + 1); j++)
                for (int64_t i = PARTS * column; i < PARTS * (column + 1); i++) {
                    const auto part = size_t(j * ALL + i);
                    std::tie(grid.second[part], grid.third[part]) =
                        sharpen(plane, low_x + half_x / PARTS * double(2 * i + 1),
                                low_y + half_y / PARTS * double(2 * j + 1), reach, found.most);
                }
        }
    return grid;
}

} // namespace rastercov::lens
