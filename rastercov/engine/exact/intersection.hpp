// Lines along which faces in contact pass through one another.
//
// A face that another one in contact passes through is visible on one side of their intersection at
// most. In the image that is a line, along which 1/z of the two is equal.
//
// Twins: rastercov.reference.polygons.
#pragma once
#include "exact/segments.hpp"
#include <tuple>

namespace rastercov::exact {

// Faces that pass through a face beyond which it is left to half planes.
constexpr int64_t MOST_INTERSECTIONS = 24;
// Error of the image of an intersection, pixels, beyond which the face is left to them, too.
constexpr double MOST_ERROR = 1e-6;
// Width of a face, in the same, below which rounding may decide what is beside it.
constexpr double THINNEST = 1 << 24;
// Number of lines where the visibility may change elsewhere, or rounding decides.
constexpr int64_t NOT_KNOWN = -1;

struct Overlap {
    double area; // px^2; negative if one of the faces is so thin that rounding may decide
    int64_t n_sides;
};

// Area that the images of two live faces have in common, and the sides of that of m, whose lines
// are left in work.lines. For the other arguments see add_intersection.
inline Overlap overlap_of(int64_t t, int64_t m, const Outline &image, const View &view) {
    const auto &[camera, projected, work] = std::tie(view.camera, view.projected, view.work);
    const auto &[box, lines, corners] = std::tie(projected.box, work.lines, work.corners);
    const auto [k, n_sides] = outline(m, projected, corners, lines);
    // Of a clipped needle rounding may leave a short piece.
    const bool is_clipped = projected.state[m] & CLIPPED;
    double extent = camera.width + camera.height;
    if (!is_clipped) extent = bounds_in(box, m).around();
    const bool is_thin =
        twice_area(corners, k) < THINNEST * outline_error(m, camera, projected) * extent;
    if (is_clipped && is_thin) return {-1.0, n_sides};
    if (box(m, U_MIN) > box(t, U_MAX) || box(m, U_MAX) < box(t, U_MIN) ||
        box(m, V_MIN) > box(t, V_MAX) || box(m, V_MAX) < box(t, V_MIN))
        return {0.0, n_sides};
    if (is_thin) return {-1.0, n_sides};
    int64_t n = image.n_corners;
    if (separates(lines, n_sides, work.target, n) || separates(work.own, image.n_lines, corners, k))
        return {0.0, n_sides};
    copy_polygon(work.target, n, work.spare);
    n = clip(work.spare, n, lines, n_sides, work.other);
    if (n < 3) return {0.0, n_sides};
    return {std::abs(twice_area(work.spare, n)) / 2, n_sides};
}

// Adds the line of equal depth that depth_order left in work.lines; returns the number of lines.
//
// Its range is that within the image of face m, which n_sides of work.lines bound, and within three
// times the box of face t. It may be too large, but not too small: the line may run along a side of
// m, so that rounding decides where it meets that side, and on which side of it it is.
inline int64_t take_intersection(int64_t t, int64_t m, int64_t n_sides, int64_t count,
                                 const View &view) {
    const auto &[lines, box] = std::tie(view.work.lines, view.projected.box);
    const Line line = line_at(lines, n_sides);
    const double slope = length(line.du, line.dv, 0.0);
    double error = plane_of(t, view.camera, view.projected).error +
                   plane_of(m, view.camera, view.projected).error;
    if (count == MOST_INTERSECTIONS || !(error <= MOST_ERROR * slope)) return NOT_KNOWN;
    const double du = line.du / slope, dv = line.dv / slope, offset = line.offset / slope;
    const double u = line.u0 + offset * dv, v = line.v0 - offset * du;
    const double reach = bounds_in(box, t).around();
    Part part = narrow(u, u + du, box(t, U_MIN) - reach, box(t, U_MAX) + reach, {-INF, INF});
    part = narrow(v, v + dv, box(t, V_MIN) - reach, box(t, V_MAX) + reach, part);
    error = std::max(error / slope, view.camera.pixel_error);
    const double slack = SURE * std::max(error, outline_error(m, view.camera, view.projected));
    for (int64_t s = 0; s < n_sides; s++) {
        const Line side = line_at(lines, s);
        const double along = side.du * dv - side.dv * du;
        double at = side.du * (v - side.v0) - side.dv * (u - side.u0) + side.offset;
        at += slack_of(side, slack);
        if (along > 0) part.first = std::max(part.first, -at / along);
        else if (along < 0) part.last = std::min(part.last, -at / along);
    }
    const auto row = view.work.intersections[count];
    row[U] = u;
    row[V] = v;
    row[DU] = du;
    row[DV] = dv;
    row[FIRST] = part.first;
    row[LAST] = part.last;
    row[EDGE_ERROR] = error;
    return part.first < part.last ? count + 1 : count;
}

// Adds the line along which a face in contact, m, passes through face t to work.intersections,
// after the first `count`, and what rounding may decide along their contact to the bound of t;
// returns the number of lines. `image` has the corners of t in work.target and its lines in
// work.own.
//
// It is NOT_KNOWN if the visibility of the face may change elsewhere: where the two coincide, or
// where the other, in front of it, continues behind it, beyond an edge that lies in it and is no
// event edge.
inline int64_t add_intersection(int64_t t, int64_t m, const Outline &image, int64_t count,
                                const View &view) {
    const auto &state = view.projected.state;
    double &area_error = view.area_error[t];
    if (!(state[m] & LIVE)) return state[m] & THIN ? NOT_KNOWN : count;
    for (int s = -1; s < 3; s++) { // the other face itself; then, if it is in front, its neighbours
        int64_t other = m;
        if (s >= 0) {
            const int64_t e = view.edges.of_face(m, s);
            if (view.is_event[e] || view.edges.faces(e, 1) < 0) continue;
            other = view.edges.faces(e, 0) != m ? view.edges.faces(e, 0) : view.edges.faces(e, 1);
            if (other == t || !(state[other] & LIVE)) continue;
        }
        const auto [overlap, n_sides] = overlap_of(t, other, image, view);
        if (overlap == 0 && s >= 0) continue;
        if (overlap == 0) return count;
        if (overlap < 0 || state[other] & DOUBTFUL) return NOT_KNOWN;
        if (s < 0) {
            const double error = outline_error(m, view.camera, view.projected);
            const double around = common_extent(t, m, view.projected.box);
            if (overlap <= SURE * error * around) { // neighbours that abut, up to rounding
                area_error += std::max(overlap, 4 * error * around);
                return count;
            }
            area_error += 4 * error * around;
        }
        const Order order = depth_order(t, other, image.n_corners, n_sides, view, s < 0);
        if (order == IN_FRONT) continue;
        if (s >= 0 || order == TIED) return NOT_KNOWN;
        if (order == IN_FRONT_IN_PART) return take_intersection(t, m, n_sides, count, view);
        return count;
    }
    return count;
}

} // namespace rastercov::exact
