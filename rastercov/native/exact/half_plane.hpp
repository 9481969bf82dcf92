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
    const auto &[box, camera] = std::tie(view.projected.box, view.camera);
    const double width = std::min(box(t, U_MAX), camera.width) - std::max(box(t, U_MIN), 0.0);
    return width + (std::min(box(t, V_MAX), camera.height) - std::max(box(t, V_MIN), 0.0));
}

// Depth order of face m relative to face t, over the overlap of their images.
//
// The order is unknown where w differs by less than its error, a strip along the line of equal
// depth. The smaller the angle at which faces pierce each other, the wider the strip. Its area is
// added to area_error of t if is_first: the two are compared for the first time.
//
// work.target has the n corners of t, work.lines the n_sides lines that bound m. Where m is in
// front in part, the line of equal depth is appended to work.lines.
inline Order depth_order(int64_t t, int64_t m, int64_t n, int64_t n_sides, const View &view,
                         bool is_first) {
    const auto &[camera, projected, work] = std::tie(view.camera, view.projected, view.work);
    const auto &[faces, box, spare] = std::tie(projected.faces, projected.box, work.spare);
    double &area_error = view.area_error[t];
    if (box(m, W_MIN) > box(t, W_MAX) * (1 + 2 * DEPTH_TIE_REL)) return IN_FRONT;
    // The overlap, and the difference of w at its corners.
    copy_polygon(work.target, n, spare);
    n = clip(spare, n, work.lines, n_sides, work.other);
    if (n < 3) return BEHIND;
    const Plane of_t = plane_of(t, camera, projected), of_m = plane_of(m, camera, projected);
    double least = INF, most = -INF, first = 0.0, apart = -INF;
    for (int64_t p = 0; p < n; p++) {
        const double u = spare(p, U), v = spare(p, V);
        const double mine = of_t.w + of_t.a * (u - of_t.u) + of_t.b * (v - of_t.v);
        const double its = of_m.w + of_m.a * (u - of_m.u) + of_m.b * (v - of_m.v);
        const double nearer = its - mine;
        if (p == 0) first = nearer;
        apart = std::max(apart, std::abs(nearer) - DEPTH_TIE_REL * std::max(mine, its));
        least = std::min(least, nearer), most = std::max(most, nearer);
    }
    // The planes of two faces that share an edge meet along that edge and nowhere else.
    int shared = 0;
    for (int p = 0; p < 3; p++)
        shared +=
            faces(m, p) == faces(t, 0) || faces(m, p) == faces(t, 1) || faces(m, p) == faces(t, 2);
    const double error = of_t.error + of_m.error;
    const double common = std::abs(twice_area(spare, n)) / 2;
    if (!is_first) {
    } else if (std::abs(apart) <= error || (apart > 0 && std::max(most, -least) <= error)) {
        area_error += common;
    } else if (apart > 0 && shared < 2 && least <= error && most >= -error) {
        const Bounds b = extent_of(spare, n);
        const double extent = length(b.u_max - b.u_min, b.v_max - b.v_min, 0.0);
        const double strip = error / length(of_m.a - of_t.a, of_m.b - of_t.b, 0.0) * extent;
        area_error += std::min(strip, common);
    }
    if (apart <= 0) return TIED;
    if (shared >= 2) return most > -least ? IN_FRONT : BEHIND;
    if (most <= 0) return BEHIND;
    if (least >= 0) return IN_FRONT;
    // first + (a_m - a_t)(u - u0) + (b_m - b_t)(v - v0) >= 0
    store_line({spare(0, U), spare(0, V), of_m.b - of_t.b, of_t.a - of_m.a, first}, work.lines,
               n_sides);
    return IN_FRONT_IN_PART;
}

// True if face m hides all of face t, whose n corners work.target has.
inline bool hides_all(int64_t m, int64_t t, int64_t n, const View &view) {
    const auto &[projected, work] = std::tie(view.projected, view.work);
    const auto &box = projected.box;
    if (m == t || box(m, U_MIN) > box(t, U_MIN) || box(m, U_MAX) < box(t, U_MAX) ||
        box(m, V_MIN) > box(t, V_MIN) || box(m, V_MAX) < box(t, V_MAX) ||
        box(m, W_MAX) < box(t, W_MIN) * (1 - 2 * DEPTH_TIE_REL) ||
        (projected.state[m] & (LIVE | DOUBTFUL)) != LIVE)
        return false;
    const int64_t n_sides = outline(m, projected, work.corners, work.lines).n_lines;
    return contains(work.lines, n_sides, work.target, n) &&
           depth_order(t, m, n, n_sides, view, true) == IN_FRONT;
}

// Fills work.target and work.own with the image of a face; its own error begins the bound of the
// face. There are fewer than 3 corners outside the image.
inline Outline take_target(int64_t t, const View &view) {
    const auto &[camera, projected, work] = std::tie(view.camera, view.projected, view.work);
    const double error = outline_error(t, camera, projected);
    view.area_error[t] = OUTLINE_ERROR_FACTOR * extent_in_image(t, view) * error;
    Outline image = outline(t, projected, work.target, work.own);
    if (projected.state[t] & PARTLY)
        image.n_corners =
            clip(work.target, image.n_corners, camera.border, camera.border.rows(), work.spare);
    return image;
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
    const auto &[box, area, visible] =
        std::tie(view.projected.box, view.projected.area, view.visible);
    const double tolerance =
        view.camera.pixel_error * (box(t, U_MAX) - box(t, U_MIN) + box(t, V_MAX) - box(t, V_MIN));
    visible[t] = 0.0;
    if (seen > tolerance) visible[t] = seen >= area[t] - tolerance ? area[t] : seen;
    if (visible[t] == 0 || visible[t] == area[t])
        drop_pieces(view.work.kept, n_kept, n_kept_corners);
}

inline void require_view(const View &view) {
    const Projected &projected = view.projected;
    const Work &work = view.work;
    const int64_t n = projected.faces.rows();
    require(projected.side.rows() == n && projected.state.rows() == n &&
                projected.box.rows() == n && projected.area.rows() == n &&
                projected.clipped_index.rows() == n && view.visible.rows() >= n &&
                view.area_error.rows() >= n,
            "the arrays of a view must have one row for each face");
    require_grid(view.grid, projected);
    require(work.target.rows() >= 2 * CORNERS && work.own.rows() >= SIDES &&
                work.corners.rows() >= CORNERS && work.lines.rows() > SIDES &&
                work.spare.rows() >= PIECE_ROOM && work.other.rows() >= PIECE_ROOM &&
                work.values.rows() >= PIECE_ROOM && work.levels.rows() >= STACK_ROOM &&
                work.parts.n_corners.rows() >= STACK_ROOM &&
                work.parts.corners.extent(0) >= STACK_ROOM,
            "work must have room for a face");
}

} // namespace rastercov::exact
