// Depth order of two faces, and the image of a target face.
//
// In the image w = 1/z is affine on a face, so the part of face T that face M hides is
// T n M n {w_M > w_T}: a convex polygon.
//
// Twins: rastercov.reference.polygons.
#pragma once
#include "exact/grid.hpp"
#include <tuple>

namespace rastercov::exact {

// Relative difference of 1/z up to which two faces nearly coincide.
constexpr double NEARLY_REL = 1e4 * DEPTH_TIE_REL;
// Change of 1/z from a corner of one face to one of another, relative, up to which their planes are
// compared there.
constexpr double MOST_ALONG = 4;

// Width and height together of the rectangle that the boxes of two faces share, pixels.
inline double common_extent(int64_t t, int64_t m, const Array<double, Any, 6> &box) {
    const double across =
        std::min(box(t, U_MAX), box(m, U_MAX)) - std::max(box(t, U_MIN), box(m, U_MIN));
    const double down =
        std::min(box(t, V_MAX), box(m, V_MAX)) - std::max(box(t, V_MIN), box(m, V_MIN));
    return across + down;
}

// Width and height together of the part of the box of a face that is in the image, pixels.
inline double extent_in_image(int64_t t, const View &view) {
    const double width = std::min(view.projected.box(t, U_MAX), view.camera.width) -
                         std::max(view.projected.box(t, U_MIN), 0.0);
    return width + (std::min(view.projected.box(t, V_MAX), view.camera.height) -
                    std::max(view.projected.box(t, V_MIN), 0.0));
}

// Difference of 1/z of face m to face t, over the overlap of their images.
struct Gap : Range {
    int64_t n;    // corners of the overlap, fewer than 3 for none
    double first; // at the first corner
    double apart; // the largest beyond DEPTH_TIE_REL of 1/z
    Range ties;   // in DEPTH_TIE_REL of 1/z, where it is
};

// Measures the difference of the planes of faces t and m; `overlap` has the n corners of t, and
// then those of the overlap, `lines` the n_sides lines that bound m.
template <class Rows>
Gap gap_between(const Plane &of_t, const Plane &of_m, Points overlap, int64_t n, const Rows &lines,
                int64_t n_sides, Points spare) {
    n = clip(overlap, n, lines, n_sides, spare);
    Gap gap = {{}, n, 0.0, -INF, {}};
    for (int64_t p = 0; p < n; p++) {
        const double u = overlap(p, U), v = overlap(p, V);
        const double mine = of_t.at(u, v).w;
        const double its = of_m.at(u, v).w;
        const double nearer = its - mine, tie = DEPTH_TIE_REL * std::max(mine, its);
        if (p == 0) gap.first = nearer;
        gap.apart = std::max(gap.apart, std::abs(nearer) - tie);
        gap.ties.add(nearer / tie);
        gap.add(nearer);
    }
    return gap;
}

// Number of corners that two faces share.
inline int shared_corners(int64_t t, int64_t m, const Array<const int32_t, Any, 3> &faces) {
    int shared = 0;
    for (int p = 0; p < 3; p++)
        shared +=
            faces(m, p) == faces(t, 0) || faces(m, p) == faces(t, 1) || faces(m, p) == faces(t, 2);
    return shared;
}

// Line of equal depth of two faces, with the part where m is in front on its inner side; (u, v) is
// a corner of their overlap and `first` the difference there.
//
// Of two faces that nearly coincide, rounding moves the line by many pixels. It is then the same to
// the bit for t and m and for m and t, so that what one face loses to it the other gains.
inline Line line_of_equal_depth(int64_t t, int64_t m, const Plane &of_t, const Plane &of_m,
                                const Gap &gap, double u, double v) {
    const Plane &a = t < m ? of_t : of_m, &b = t < m ? of_m : of_t;
    const double along_u = b.a * (a.u - b.u), along_v = b.b * (a.v - b.v);
    const double offset = b.w + along_u + along_v - a.w;
    const double nearly = NEARLY_REL * std::abs(a.w);
    const double sign = t < m ? 1.0 : -1.0;
    if (std::max(gap.most, -gap.least) <= nearly && std::abs(offset) <= nearly &&
        std::abs(along_u) + std::abs(along_v) <= MOST_ALONG * std::abs(a.w))
        return {a.u, a.v, sign * (b.b - a.b), sign * (a.a - b.a), sign * offset};
    // first + (a_m - a_t)(u - u0) + (b_m - b_t)(v - v0) >= 0
    return {u, v, of_m.b - of_t.b, of_t.a - of_m.a, gap.first};
}

// Depth order of face m relative to face t, over the overlap of their images.
//
// The order is unknown where w differs by less than its error, a strip along the line of equal
// depth. The smaller the angle at which faces pierce each other, the wider the strip. Its area is
// added to area_error of t if is_first: the two are compared for the first time.
//
// work.target has the n corners of t, work.lines the n_sides lines that bound m. Where m is in
// front in part, the line of equal depth is appended to work.lines. Where the two coincide they are
// TIED; by_depth, only up to rounding.
inline Order depth_order(int64_t t, int64_t m, int64_t n, int64_t n_sides, const View &view,
                         bool is_first, bool by_depth = false) {
    const auto &[box, spare] = std::tie(view.projected.box, view.work.spare);
    double &area_error = view.area_error[t];
    if (box(m, W_MIN) > box(t, W_MAX) * (1 + 2 * DEPTH_TIE_REL)) return IN_FRONT;
    copy_polygon(view.work.target, n, spare);
    const Plane of_t = plane_of(t, view.camera, view.projected),
                of_m = plane_of(m, view.camera, view.projected);
    const Gap gap = gap_between(of_t, of_m, spare, n, view.work.lines, n_sides, view.work.other);
    if (gap.n < 3) return BEHIND;
    const double error = of_t.error + of_m.error, most = std::max(gap.most, -gap.least);
    // The planes of two faces that share an edge meet along that edge and nowhere else.
    const int shared = shared_corners(t, m, view.projected.faces);
    const double apart = by_depth ? most - error : gap.apart;
    const double common = std::abs(twice_area(spare, gap.n)) / 2;
    if (!is_first) {
    } else if ((std::abs(apart) <= error && !by_depth) || (apart > 0 && most <= error)) {
        area_error += common;
    } else if (apart > 0 && shared < 2 && gap.least <= error && gap.most >= -error) {
        const double strip = error / length(of_m.a - of_t.a, of_m.b - of_t.b, 0.0) *
                             extent_of(spare, gap.n).across();
        area_error += std::min(strip, common);
    }
    if (apart <= 0) return TIED;
    if (shared >= 2) return gap.most > -gap.least ? IN_FRONT : BEHIND;
    if (gap.most <= 0) return BEHIND;
    if (gap.least >= 0) return IN_FRONT;
    store_line(line_of_equal_depth(t, m, of_t, of_m, gap, spare(0, U), spare(0, V)),
               view.work.lines, n_sides);
    return IN_FRONT_IN_PART;
}

// True if face m surely hides all of face t, whose n corners work.target has.
inline bool hides_all(int64_t m, int64_t t, int64_t n, const View &view) {
    const auto &box = view.projected.box;
    if (m == t || box(m, U_MIN) > box(t, U_MIN) || box(m, U_MAX) < box(t, U_MAX) ||
        box(m, V_MIN) > box(t, V_MIN) || box(m, V_MAX) < box(t, V_MAX) ||
        box(m, W_MAX) < box(t, W_MIN) * (1 - 2 * DEPTH_TIE_REL) ||
        (view.projected.state[m] & (LIVE | DOUBTFUL)) != LIVE)
        return false;
    const int64_t n_sides = outline(m, view.projected, view.work.corners, view.work.lines).n_lines;
    if (!contains(view.work.lines, n_sides, view.work.target, n)) return false;
    double &area_error = view.area_error[t];
    const double before = area_error;
    const bool hides = depth_order(t, m, n, n_sides, view, true) == IN_FRONT;
    const bool is_sure = area_error == before;
    area_error = before;
    return hides && is_sure;
}

// Fills `corners` and `lines` with what is in the image of a face: fewer than 3 corners outside.
inline Outline outline_inside(int64_t f, const View &view, Points corners, Lines lines,
                              Points spare) {
    const auto &border = view.camera.border;
    Outline image = outline(f, view.projected, corners, lines);
    if (view.projected.state[f] & PARTLY)
        image.n_corners = clip(corners, image.n_corners, border, border.rows(), spare);
    return image;
}

// Fills work.target and work.own so; the face's own error begins its bound.
inline Outline take_target(int64_t t, const View &view) {
    const double error = outline_error(t, view.camera, view.projected);
    view.area_error[t] = OUTLINE_ERROR_FACTOR * extent_in_image(t, view) * error;
    return outline_inside(t, view, view.work.target, view.work.own, view.work.spare);
}

// True if a face that hid another one there hides all of a face, see take_target. Faces beside each
// other often have the same face before them. The figures of a target, and their bounds, must not
// depend on other targets.
inline bool is_hidden_by_one(int64_t t, int64_t n, const View &view) {
    if (view.projected.state[t] & TRANSPARENT) return false;
    const int64_t hider = likely_hider(t, view.projected.box, view.grid);
    return hider >= 0 && hides_all(hider, t, n, view);
}

// Stores the visible area of a face, px^2, and drops its pieces if it is all or nothing. Remainders
// up to the rounding count as nothing, both of the visible and of the hidden part.
inline void settle_area(int64_t t, double seen, const View &view, int64_t n_kept,
                        int64_t n_kept_corners) {
    const double tolerance = view.camera.pixel_error * bounds_in(view.projected.box, t).around();
    view.visible[t] = 0.0;
    if (seen > tolerance)
        view.visible[t] =
            seen >= view.projected.area[t] - tolerance ? view.projected.area[t] : seen;
    if (view.visible[t] == 0 || view.visible[t] == view.projected.area[t])
        drop_pieces(view.work.kept, n_kept, n_kept_corners);
}

} // namespace rastercov::exact
