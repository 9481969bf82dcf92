// Criteria of density in the plane of a face, decided piece by piece.
//
// Let A be the derivative of pixels by the place x = (x, y) in the ideal plane, w = 1/z, T (3, 2)
// the tangents of the face as columns, and h its distance. Pixels change with metres on the face by
//
//     S = w A (I | -x) T,   S^-1 = Q A^-1 / (h w^2),   Q = adj((I | -x) T),
//
// up to its sign, and with metres across the ray by an S of S^-1 = E A^-1 / w,
// E = (I - e e^T)(I 0)^T, e the unit vector of the ray. The criteria at a point are
//
//     pixels a m^2         w >= (R / h)^(1/3) |det A|^(-1/3)
//     worst direction      w^2 >= (d / h) |Q A^-1|
//     of a facing target   w >= d |E A^-1|
//     distance             |P|^2 >= n^2
//
// w is affine in x, and on the right are a scalar and norms of matrices that change little. With
// |A'| <= a', |A''| <= a'' and |A^-1| <= b in a piece, the derivatives along lines of A^-1 are at
// most b' = b^2 a', b'' = b^2 a'' + 2 b^3 a'^2, those of log |det A| = tr log A at most 2 b a' and
// 2 b a'' + 2 b^2 a'^2, those of Q at most 1 and 0, of E 2 and 4.4 (|e'| <= 1, |e''| <= 1.2). Next
// to a pole, and to the ray opposite to the axis of a fisheye, A stretches one direction without
// limit: there b a' is of 1 / d^2 at the distance d, b' and b'' only of 1 / d and 1 / d^2, by
// `Slopes::near_axis`. So in a
// piece each criterion differs from an affine function by K r^2 / 2 at most. The
// norm of an affine matrix M is convex: it lies above u . M v with any unit vectors u, v, and the
// difference is greatest at a corner; w^2 lies above its tangent. So a piece has two parallel
// lines, beyond which a criterion holds and before which it fails. What is between them is halved
// until it is narrower than `gap` of the criteria; then it goes into the bound. The largest part of
// a face comes first, so that what MOST_DIVISIONS leave is the least that they can.
//
// A pinhole is a lens whose A is constant: what differs are the overloads for Criteria and
// LensCriteria. Faces seen by parallel rays are flattened, to w = 1/unit and x affine; across these
// rays E is (I 0)^T.
//
// Twins: rastercov.reference.regions, point by point.
#pragma once
#include "area/plane.hpp"
#include "interrupt.hpp"

namespace rastercov::area {

constexpr int64_t MOST_HALVINGS = 48; // of a piece, after which it is undecided
// Parts of a face that are halved, after which the others are undecided.
constexpr int64_t MOST_DIVISIONS = int64_t(1) << 18;
// Bits of the criteria that a piece still has to meet, and rows of their fits.
enum { PER_M2 = 1, DENSE = 2, FACING = 4, DISTANT = 8 };
constexpr int OF_PER_M2 = 0, OF_DISTANT = 3, N_CRITERIA = 4;
// Step of the differences that give an affine part, relative to the radius; in units of the plane.
// A difference is off by K step / 2, and so the affine part by less than K r^2 / 40.
constexpr double STEP_REL = 1.0 / 64, LARGEST_STEP = 1e-5;
constexpr double HALF = 0.5 + 0.05; // of K r^2: the difference from an affine function
// Of a density: by more than it a piece is beyond the limit, or before it, for sure.
constexpr double FAR_REL = 1e-6;
// Of the size of a figure: its rounding and, times the radius over the step, that of its slopes.
constexpr double ROUNDING = 0x1p-46;

// --- what differs with the lens ---

inline const Criteria &pinhole_of(const Criteria &criteria) { return criteria; }
inline const Criteria &pinhole_of(const LensCriteria &criteria) { return criteria.pinhole; }

// Criteria that are decided piece by piece; the others of a pinhole are half planes.
inline int64_t mask_of(const Criteria &criteria) {
    return criteria.rules.min_pixel_density > 0 ? DENSE : 0;
}
inline int64_t mask_of(const LensCriteria &criteria) {
    const Rules &rules = criteria.rules;
    return (rules.min_pixel_density > 0 ? DENSE : 0) | (rules.min_pixels_per_m2 > 0 ? PER_M2 : 0) |
           (rules.min_facing_density > 0 ? FACING : 0) |
           (criteria.by_distance && rules.z_n > 0 ? DISTANT : 0);
}

// Derivatives of the pixel by the place (x, y) in the plane.
inline lens::PlaneSlopes slopes_of(const Criteria &criteria, double, double) {
    return {criteria.lens.fx, 0.0, 0.0, criteria.lens.fy};
}
inline lens::PlaneSlopes slopes_of(const LensCriteria &criteria, double x, double y) {
    return lens::plane_slopes(criteria.code, criteria.params, criteria.frame, x, y);
}

// Bounds of the second and third derivatives within a box of the plane.
inline lens::Bends bounds_of(const Criteria &, const Bounds &) { return {}; }
inline lens::Bends bounds_of(const LensCriteria &criteria, const Bounds &box) {
    return lens::bounds_within(criteria.slopes, box.u_min, box.u_max, box.v_min, box.v_max);
}

// Least and greatest |det A| within a box of the plane.
inline Range sizes_of(const Criteria &criteria, const Bounds &) {
    const double size = criteria.lens.fx * criteria.lens.fy;
    return {size, size};
}
inline Range sizes_of(const LensCriteria &criteria, const Bounds &box) {
    return lens::sizes_within(criteria.slopes, box.u_min, box.u_max, box.v_min, box.v_max);
}

inline bool is_parallel(const Criteria &criteria) { return criteria.is_parallel; }
inline bool is_parallel(const LensCriteria &criteria) { return criteria.unit > 0; }

// --- figures at a place of the plane ---

// A matrix of two columns.
struct Matrix {
    Vector first, second;
};
inline Vector scaled_sum(const Vector &here, const Vector &by_x, const Vector &by_y, double dx,
                         double dy) {
    return {here.x + by_x.x * dx + by_y.x * dy, here.y + by_x.y * dx + by_y.y * dy,
            here.z + by_x.z * dx + by_y.z * dy};
}

// |det A|^(-1/3), and Q A^-1 or E A^-1, which have three rows and two.
struct Figures {
    double size;
    Matrix dense, facing;
};

// Sets figures of the criteria of a mask; the least singular value of A.
template <class C>
double figures_at(const C &criteria, const Plane &plane, double x, double y, int64_t mask,
                  Figures &out) {
    const auto [a, b, c, d] = slopes_of(criteria, x, y);
    const double det = a * d - b * c, total = a * a + b * b + c * c + d * d;
    const double root = std::sqrt(std::max(total * total - 4 * det * det, 0.0));
    const double norm = std::sqrt(0.5 * (total + root)), size = std::abs(det);
    // A^-1, by rows
    const double i_11 = d / det, i_12 = -b / det, i_21 = -c / det, i_22 = a / det;
    if (mask & PER_M2) out.size = std::pow(size, -1.0 / 3);
    if (mask & DENSE) {
        const double q_11 = plane.y_axis.y - y * plane.y_axis.z;
        const double q_12 = x * plane.y_axis.z - plane.y_axis.x;
        const double q_21 = y * plane.x_axis.z - plane.x_axis.y;
        const double q_22 = plane.x_axis.x - x * plane.x_axis.z;
        out.dense.first = {q_11 * i_11 + q_12 * i_21, q_21 * i_11 + q_22 * i_21, 0.0};
        out.dense.second = {q_11 * i_12 + q_12 * i_22, q_21 * i_12 + q_22 * i_22, 0.0};
    }
    if (mask & FACING && is_parallel(criteria)) {
        out.facing.first = {i_11, i_21, 0.0};
        out.facing.second = {i_12, i_22, 0.0};
    } else if (mask & FACING) {
        const double s2 = 1 + x * x + y * y;
        const double e_11 = 1 - x * x / s2, e_12 = -x * y / s2, e_22 = 1 - y * y / s2;
        const double e_31 = -x / s2, e_32 = -y / s2;
        out.facing.first = {e_11 * i_11 + e_12 * i_21, e_12 * i_11 + e_22 * i_21,
                            e_31 * i_11 + e_32 * i_21};
        out.facing.second = {e_11 * i_12 + e_12 * i_22, e_12 * i_12 + e_22 * i_22,
                             e_31 * i_12 + e_32 * i_22};
    }
    return size / norm;
}

// Bounds in a piece: of the first and second derivative of A^-1, and of log |det A|.
struct Turns {
    double inverse_1, inverse_2, log_det_1, log_det_2;
};

// The same within r of a place where A has the least singular value `least`.
inline Turns turns_within(const lens::Bends &bends, double least, double r) {
    const double b = 1 / (least - bends.second * r), first = b * bends.second;
    if (!(b > 0 && bends.third < INF))
        return {bends.inverse_1, bends.inverse_2, bends.log_det_1, bends.log_det_2};
    const double second = b * bends.third + first * first;
    return {std::min(bends.inverse_1, b * first),
            std::min(bends.inverse_2, b * (second + first * first)),
            std::min(bends.log_det_1, 2 * first), std::min(bends.log_det_2, 2 * second)};
}

// Change of figures by a step, over it.
inline Figures differences(const Figures &there, const Figures &here, double step) {
    const auto of = [&](const Vector &a, const Vector &b) -> Vector {
        return {(a.x - b.x) / step, (a.y - b.y) / step, (a.z - b.z) / step};
    };
    const auto both = [&](const Matrix &a, const Matrix &b) -> Matrix {
        return {of(a.first, b.first), of(a.second, b.second)};
    };
    return {(there.size - here.size) / step, both(there.dense, here.dense),
            both(there.facing, here.facing)};
}

struct Singular {
    double value, right_x, right_y;
};

// Largest singular value of a matrix of two columns, and its right vector.
inline Singular largest_singular(const Matrix &matrix) {
    const auto &[first, second] = matrix;
    const double a = dot(first, first), b = dot(first, second), c = dot(second, second);
    const double half = (a + c) / 2, apart = (a - c) / 2;
    const double root = std::sqrt(apart * apart + b * b);
    // The eigenvector of (a b; b c): (root + apart, b) or (b, root - apart), the longer.
    double x = apart >= 0 ? root + apart : b;
    double y = apart >= 0 ? b : root - apart;
    double size = length2(x, y);
    if (!(size > 0)) {
        x = 1.0;
        y = 0.0;
        size = 1.0;
    }
    return {std::sqrt(half + root), x / size, y / size};
}

// Bilinear form left . M right.
inline double form_of(const Matrix &m, const Vector &left, double right_x, double right_y) {
    double total = 0.0;
    total += left.x * (m.first.x * right_x + m.second.x * right_y);
    total += left.y * (m.first.y * right_x + m.second.y * right_y);
    total += left.z * (m.first.z * right_x + m.second.z * right_y);
    return total;
}

// --- a criterion in a polygon ---

// A criterion in a polygon: a x + b y + c is the affine part, with x and y those of the ideal plane
// (of the face, for the distance); the criterion less that is `least` ... `most`, where that is
// known.
struct Fit {
    double a, b, c, least, most;
    bool is_known;
    void set_known(double value) { *this = {0.0, 0.0, value, 0.0, 0.0, true}; }
};
using Fits = Fit[N_CRITERIA];

// A corner (x, y, 1/z) in the ideal plane.
struct Corner {
    double x, y, w;
};
using Corners = Corner[PIECE_ROOM];

inline void place_corners(Points polygon, int64_t n, const Plane &plane, Corners &places) {
    for (int64_t p = 0; p < n; p++) {
        const double a = polygon(p, U), b = polygon(p, V);
        const auto along = [&](double at, double by_a, double by_b) {
            return at + a * by_a + b * by_b;
        };
        const double x = along(plane.origin.x, plane.x_axis.x, plane.y_axis.x);
        const double y = along(plane.origin.y, plane.x_axis.y, plane.y_axis.y);
        const double z = along(plane.origin.z, plane.x_axis.z, plane.y_axis.z);
        places[p] = {x / z, y / z, 1 / z};
    }
}

inline void fit_distance(Points polygon, int64_t n, const Plane &plane, double z_n, Fit &fit) {
    double mean_x = 0.0;
    double mean_y = 0.0;
    double over = 0.0;
    for (int64_t p = 0; p < n; p++) {
        mean_x += polygon(p, U) / n;
        mean_y += polygon(p, V) / n;
    }
    for (int64_t p = 0; p < n; p++) {
        const double away = length2(polygon(p, U) - mean_x, polygon(p, V) - mean_y);
        over = std::max(over, away * away);
    }
    const double a = mean_x - plane.foot_x, b = mean_y - plane.foot_y, h = plane.height;
    const double off = 4 * plane.error * (length2(a, b) + std::sqrt(over) + std::abs(h));
    double c = a * a + b * b + h * h - z_n * z_n;
    c -= 2 * a * mean_x + 2 * b * mean_y;
    fit = {2 * a, 2 * b, c, -off, over + off, true};
}

// Ranges of corners (x, y, 1/z) of a polygon in the ideal plane, their centre, and radius around
// it.
struct Extent {
    Range along_x, along_y, w;
    double x = 0.0;
    double y = 0.0;
    double r = 0.0;

    Extent(const Corners &places, int64_t n) {
        for (int64_t p = 0; p < n; p++) {
            const Corner &at = places[p];
            along_x.add(at.x);
            along_y.add(at.y);
            w.add(at.w);
            x += at.x / n;
            y += at.y / n;
        }
        for (int64_t p = 0; p < n; p++) r = std::max(r, length2(places[p].x - x, places[p].y - y));
    }
    Bounds box(double step) const {
        return {along_x.least - step, along_x.most + step, along_y.least - step,
                along_y.most + step};
    }
};

// Decides pixels per m^2 by their range in the piece, which is enough for most pieces.
template <class C>
void fit_by_range(const Extent &piece, const Plane &plane, const C &criteria, Fit &fit) {
    const double h = std::abs(plane.height);
    const auto [least_det, most_det] = sizes_of(criteria, piece.box(0.0));
    const double doubt = FAR_REL + 8 * plane.error / h, limit = criteria.rules.min_pixels_per_m2;
    const auto [least, most] = piece.w;
    // w >= (R / h)^(1/3) |det A|^(-1/3)
    if (least * least * least * h * least_det > limit * (1 + doubt)) fit.set_known(1.0);
    else if (most * most * most * h * most_det < limit * (1 - doubt)) fit.set_known(-1.0);
}

// Figures about the centre of a piece, their slopes, and 1/z with its slopes.
struct Expansion {
    const Corners &places;
    int64_t n;
    const Extent &piece;
    Figures here, by_x, by_y;
    double w, w_x, w_y;
    double rounding; // of the figures, of their differences, and of the height

    void set(Fit &fit, double value, double slope_x, double slope_y) const {
        fit.a = slope_x;
        fit.b = slope_y;
        fit.c = value - fit.a * piece.x - fit.b * piece.y;
        fit.is_known = true;
    }

    void fit_per_m2(double c, double change, double log_2, Fit &fit) const {
        const double r = piece.r, size = here.size * std::exp(change * r);
        const double bend = size * (change * change + log_2 / 3);
        const double off = HALF * c * bend * r * r + rounding * (c * here.size + piece.w.most);
        set(fit, w - c * here.size, w_x - c * by_x.size, w_y - c * by_y.size);
        fit.least = -off;
        fit.most = off;
    }

    void fit_norm(Matrix Figures::*of, double c, double bend, bool is_square, Fit &fit) const {
        const Matrix &at = here.*of, &along_x = by_x.*of, &along_y = by_y.*of;
        const auto norm_at = [&](double dx, double dy) {
            return largest_singular(
                {scaled_sum(at.first, along_x.first, along_y.first, dx, dy),
                 scaled_sum(at.second, along_x.second, along_y.second, dx, dy)});
        };
        const auto [size, right_x, right_y] = norm_at(0.0, 0.0);
        const Vector left = {(at.first.x * right_x + at.second.x * right_y) / size,
                             (at.first.y * right_x + at.second.y * right_y) / size,
                             (at.first.z * right_x + at.second.z * right_y) / size};
        const double middle = form_of(at, left, right_x, right_y);
        const double slope_x = form_of(along_x, left, right_x, right_y),
                     slope_y = form_of(along_y, left, right_x, right_y);
        double over = 0.0;
        double square = 0.0;
        for (int64_t p = 0; p < n; p++) {
            const double dx = places[p].x - piece.x, dy = places[p].y - piece.y;
            const double own = norm_at(dx, dy).value;
            over = std::max(over, own - middle - slope_x * dx - slope_y * dy);
            const double change = w_x * dx + w_y * dy;
            if (is_square) square = std::max(square, change * change);
        }
        const double r = piece.r, most_w = piece.w.most;
        const double off =
            HALF * c * bend * r * r + rounding * (c * (size + over) + most_w * (most_w + 1));
        set(fit, (is_square ? w * w : w) - c * middle,
            (is_square ? 2 * w * w_x : w_x) - c * slope_x,
            (is_square ? 2 * w * w_y : w_y) - c * slope_y);
        fit.least = -off - c * over;
        fit.most = off + square;
    }
};

// Sets `fits` to the criteria of a mask in a polygon, with its corners in the ideal plane.
template <class C>
void fit_criteria(Points polygon, int64_t n, int64_t mask, const Plane &plane, const C &criteria,
                  Corners &places, Fits &fits) {
    const Rules &rules = criteria.rules;
    place_corners(polygon, n, plane, places);
    const Extent piece(places, n);
    const double x = piece.x, y = piece.y, r = piece.r;
    for (Fit &fit : fits) fit.is_known = false;
    if (mask & DISTANT) fit_distance(polygon, n, plane, rules.z_n, fits[OF_DISTANT]);
    if (!(mask & (PER_M2 | DENSE | FACING)) || !(r > 0)) return;
    const double h = std::abs(plane.height);
    if (mask & PER_M2) fit_by_range(piece, plane, criteria, fits[OF_PER_M2]);
    if (fits[OF_PER_M2].is_known) mask -= PER_M2;
    if (!(mask & (PER_M2 | DENSE | FACING))) return;
    const double w_x = plane.normal.x / -plane.height, w_y = plane.normal.y / -plane.height,
                 w_0 = plane.normal.z / -plane.height;
    const double step = std::min(STEP_REL * r, LARGEST_STEP);
    const lens::Bends bends = bounds_of(criteria, piece.box(step));
    Figures here = {}, there = {};
    const double least = figures_at(criteria, plane, x, y, mask, here);
    const auto [b_1, b_2, log_1, log_2] = turns_within(bends, least, r);
    if (!(b_2 < INF && log_2 < INF)) return;
    figures_at(criteria, plane, x + step, y + 0.0, mask, there);
    const Figures by_x = differences(there, here, step);
    figures_at(criteria, plane, x + 0.0, y + step, mask, there);
    const Figures by_y = differences(there, here, step);
    const double rounding = ROUNDING * (1 + r / step) + 4 * plane.error / h;
    const Expansion about = {places, n,   piece,   here, by_x, by_y, w_0 + w_x * x + w_y * y,
                             w_x,    w_y, rounding};
    const double b = 1 / least + b_1 * r;
    const double reach = length2(x, y) + r, tall = std::sqrt(1 + reach * reach);
    if (mask & PER_M2)
        about.fit_per_m2(std::pow(rules.min_pixels_per_m2 / h, 1.0 / 3), log_1 / 3, log_2,
                         fits[OF_PER_M2]);
    if (mask & DENSE)
        about.fit_norm(&Figures::dense, rules.min_pixel_density / h, 2 * b_1 + tall * b_2, true,
                       fits[1]);
    if (mask & FACING)
        about.fit_norm(&Figures::facing, rules.min_facing_density, 4.4 * b + 4 * b_1 + b_2, false,
                       fits[2]);
}

// Whether a polygon meets the density along the worst direction of a pinhole: 1 for all of it, -1
// for none, 0 where its corners do not say.
//
// With M = z Q A^-1, affine in the plane of the face, the criterion is z |M| <= h / d. z and |M|
// are greatest at corners; |M| is at least that of a corner less the greatest |M - M_0|.
inline int dense_by_corners(Points polygon, int64_t n, const Plane &plane,
                            const Criteria &criteria) {
    const auto &[x_axis, y_axis] = std::tie(plane.x_axis, plane.y_axis);
    const double by_x = 1 / criteria.lens.fx, by_y = 1 / criteria.lens.fy;
    double first[4];
    double least_z = INF;
    double most_z = 0.0;
    double most = 0.0;  // |M|^2
    double start = 0.0; // that of the first corner
    double apart = 0.0; // |M - M_0|^2
    for (int64_t p = 0; p < n; p++) {
        const Vector at = plane.origin + polygon(p, U) * x_axis + polygon(p, V) * y_axis;
        const double m[4] = {
            (y_axis.y * at.z - y_axis.z * at.y) * by_x, (y_axis.z * at.x - y_axis.x * at.z) * by_y,
            (x_axis.z * at.y - x_axis.y * at.z) * by_x, (x_axis.x * at.z - x_axis.z * at.x) * by_y};
        const double a = m[0] * m[0] + m[2] * m[2], c = m[1] * m[1] + m[3] * m[3];
        const double b = m[0] * m[1] + m[2] * m[3], half = (a - c) / 2;
        const double square = (a + c) / 2 + std::sqrt(half * half + b * b);
        least_z = std::min(least_z, at.z);
        most_z = std::max(most_z, at.z);
        most = std::max(most, square);
        if (p == 0) {
            start = square;
            std::copy_n(m, 4, first);
        }
        double change = 0.0;
        for (int k = 0; k < 4; k++) change += (m[k] - first[k]) * (m[k] - first[k]);
        apart = std::max(apart, change);
    }
    const double height = std::abs(plane.height), doubt = FAR_REL + 8 * plane.error / height;
    const double limit = height / criteria.rules.min_pixel_density;
    if (!(least_z > 0)) return 0;
    if (most_z * std::sqrt(most) < limit * (1 - doubt)) return 1;
    return least_z * (std::sqrt(start) - std::sqrt(apart)) > limit * (1 + doubt) ? -1 : 0;
}

// Line in the plane of the face along criterion i, moved by an offset.
inline Affine line_along(const Fit &fit, int i, double offset, const Plane &plane) {
    const double c = fit.c + offset;
    if (i == OF_DISTANT) return {c, fit.a, fit.b};
    return line_in_plane(fit.a, fit.b, c, plane);
}

// Range of the affine part of criterion i over the corners of a polygon.
inline double range_of(const Fit &fit, int i, Points polygon, int64_t n, const Corners &places) {
    Range all;
    for (int64_t p = 0; p < n; p++) {
        const double x = i == OF_DISTANT ? polygon(p, U) : places[p].x;
        const double y = i == OF_DISTANT ? polygon(p, V) : places[p].y;
        all.add(fit.a * x + fit.b * y);
    }
    return all.most - all.least;
}

// Corner that is farthest from another one, the first of equals.
inline int64_t farthest_from(const Corners &places, int64_t n, int64_t start) {
    int64_t far = 0;
    double extent = -1.0;
    for (int64_t p = 0; p < n; p++) {
        const double away = length2(places[p].x - places[start].x, places[p].y - places[start].y);
        if (away > extent) {
            far = p;
            extent = away;
        }
    }
    return far;
}

// Puts both halves of a polygon across its longest extent in the image on the queue.
inline void halve_part(Points polygon, int64_t n, const Plane &plane, int64_t mask, int64_t level,
                       Queue &queue) {
    Corners places;
    Polygon half;
    place_corners(polygon, n, plane, places);
    const int64_t start = farthest_from(places, n, 0);
    const Corner far = places[start], other = places[farthest_from(places, n, start)];
    const double a = far.x - other.x, b = far.y - other.y;
    const double c = -0.5 * (a * (far.x + other.x) + b * (far.y + other.y));
    const Affine line = line_in_plane(a, b, c + 0.0, plane);
    for (const double sign : {1.0, -1.0})
        queue.push(half.points(), keep_beyond(polygon, n, line, sign, half.points()), mask, level);
}

// Takes from the queue the largest part of a face, and decides it: appends what meets all criteria
// of its mask, drops what fails one, and puts the rest back in halves. Where it may not be
// halved it goes into the bound. True if it was halved.
template <class C>
bool decide_part(int64_t face, const C &criteria, bool may_halve, Scratch &scratch,
                 const Found &out) {
    const Plane &plane = scratch.plane;
    Queue &queue = scratch.strips;
    Polygon memory, other;
    const Points part = memory.points(), spare = other.points();
    const double nearest = plane.nearest_corners();
    Corners places;
    Fits fits;
    auto [area, n, mask, level] = queue.pop(part);
    fit_criteria(part, n, mask, plane, criteria, places, fits);
    int best = -1;
    double narrowest = INF;
    for (int i = 0; i < N_CRITERIA; i++) {
        const Fit &fit = fits[i];
        if (!(mask >> i & 1) || !fit.is_known) continue;
        if (least_and_most(part, n, line_along(fit, i, fit.least, plane)).least > 0) {
            mask -= 1 << i;
            continue;
        }
        if (least_and_most(part, n, line_along(fit, i, fit.most, plane)).most < 0) return false;
        // Share of the range of the criterion in the piece that is undecided.
        const double share =
            (fit.most - fit.least) / std::max(range_of(fit, i, part, n, places), 1e-300);
        if (share < narrowest) {
            best = i;
            narrowest = share;
        }
    }
    if (mask == 0) {
        append_piece(face, part, n, nearest, out);
        return false;
    }
    if (best >= 0 && narrowest < 0.5) {
        const Affine inner = line_along(fits[best], best, fits[best].least, plane);
        const Affine outer = line_along(fits[best], best, fits[best].most, plane);
        const int64_t m = keep_beyond(part, n, inner, 1.0, spare);
        if (mask != 1 << best) queue.push(spare, m, mask - (1 << best), level);
        else if (m >= 3) append_piece(face, spare, m, nearest, out);
        n = keep_beyond(part, n, inner, -1.0, spare);
        if (n >= 3) n = keep_beyond(spare, n, outer, 1.0, part);
        if (n < 3) return false;
    }
    const double rest = std::max(twice_area(part, n) / 2, 0.0);
    const bool is_thin = rest <= criteria.gap * reach_of(part, n) || level == MOST_HALVINGS;
    if (is_thin || !may_halve) {
        out.bound[face] += rest;
        if (!is_thin) out.cut_short[0] += rest;
        return false;
    }
    halve_part(part, n, plane, mask, level + 1, queue);
    return true;
}

// Appends what meets the criteria of densities of the polygons of a face that are on the queue.
template <class C>
void decide_densities(int64_t face, const C &criteria, Scratch &scratch, const Found &out) {
    int64_t divided = 0;
    Poll poll(16);
    while (!scratch.strips.is_empty()) {
        poll();
        divided += decide_part(face, criteria, divided < MOST_DIVISIONS, scratch, out);
    }
}

// Appends a polygon, or puts it on the queue where it must meet criteria of densities.
template <class C>
void append_dense(int64_t face, Points polygon, int64_t n, const C &criteria, Scratch &scratch,
                  const Found &out) {
    const int64_t mask = mask_of(criteria);
    if (mask == 0) append_piece(face, polygon, n, scratch.plane.nearest_corners(), out);
    else scratch.strips.push(polygon, n, mask, 0);
}

} // namespace rastercov::area
