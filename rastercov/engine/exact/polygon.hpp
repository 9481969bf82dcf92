// Convex polygons in the image and in space: clipping, splitting, outlines.
//
// A polygon is rows of corners, clockwise in the image (v down), with a corner count n; no room is
// ever exceeded. The image of a face is its outline and the plane of 1/z, with the errors of both.
//
// I. Sutherland, G. Hodgman. Reentrant Polygon Clipping. 1974.
//
// Invariants: the order of operations is that of the twins, for the bits of areas; a value at a
// corner that two faces share is 0 to the bit on both sides of their edge.
//
// Twins: rastercov.reference.polygons.
#pragma once
#include "exact/records.hpp"
#include "range.hpp"
#include "simd.hpp"
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace rastercov::exact {

constexpr int64_t MOST_CORNERS = 20; // of a piece; one that gets more is split

inline double length(double x, double y, double z) { return std::sqrt(x * x + y * y + z * z); }

struct Line {
    double u0, v0, du, dv, offset;
    // Positive on its inner side.
    double value(double u, double v) const { return du * (v - v0) - dv * (u - u0) + offset; }
};

// Row s of lines with five or more columns.
template <class Rows> Line line_at(const Rows &lines, int64_t s) {
    return {lines(s, U), lines(s, V), lines(s, DU), lines(s, DV), lines(s, OFFSET)};
}

// The sides of a polygon as rows of lines, each through its first corner; n is not 0.
template <class Source> struct Sides {
    const Source &polygon;
    int64_t n;
};
template <class Source> Line line_at(const Sides<Source> &sides, int64_t s) {
    const auto &polygon = sides.polygon;
    const int64_t next = s + 1 < sides.n ? s + 1 : 0;
    const double u = polygon(s, U), v = polygon(s, V);
    return {u, v, polygon(next, U) - u, polygon(next, V) - v, 0.0};
}

// The corners of a polygon from one on.
template <class Corners> Corners from(const Corners &polygon, int64_t first) {
    return {polygon.data + first * polygon.shape[1], {polygon.rows() - first, polygon.shape[1]}};
}

template <class Source, class Target>
void copy_polygon(const Source &source, int64_t n, Target target) {
    for (int64_t p = 0; p < n; p++) {
        target(p, U) = source(p, U);
        target(p, V) = source(p, V);
    }
}

// Corners of the part of a polygon from corner `first` on, see copy_part.
inline int64_t corners_of_part(int64_t first, int64_t n) {
    return std::min(MOST_CORNERS, n - first + 1);
}

// Copies corner 0 and m - 1 corners from `first` on; the next part begins at first + m - 2. Parts
// of at most MOST_CORNERS corners divide a convex polygon from 1 on.
template <class Source>
void copy_part(const Source &polygon, int64_t first, int64_t m, Points target) {
    target(0, U) = polygon(0, U);
    target(0, V) = polygon(0, V);
    for (int64_t p = 1; p < m; p++) {
        target(p, U) = polygon(first + p - 1, U);
        target(p, V) = polygon(first + p - 1, V);
    }
}

// Appends a polygon to the pieces that are handed out, if anyone asks for them.
inline void store_piece(int64_t face, Points polygon, int64_t n, const VisiblePieces &kept) {
    if (kept.corners.rows() == 0) return;
    const int64_t piece = kept.used[0], at = kept.used[1];
    if (piece < kept.faces.rows() && at + n <= kept.corners.rows()) {
        copy_polygon(polygon, n, from(kept.corners, at));
        kept.faces[piece] = int32_t(face);
        kept.starts[piece + 1] = at + n;
    } else {
        kept.used[2] = 1;
    }
    kept.used[0] = piece + 1;
    kept.used[1] = at + n;
}

// Takes back all pieces after the first n_pieces, which have n_corners corners.
inline void drop_pieces(const VisiblePieces &kept, int64_t n_pieces, int64_t n_corners) {
    kept.used[0] = n_pieces;
    kept.used[1] = n_corners;
}

// Clips a polygon to the inner side of a line; returns the corner count of `out`.
template <class Source>
int64_t keep_inside(const Source &polygon, int64_t n, const Line &line, Points out) {
    if (n < 1) return 0;
    int64_t kept = 0;
    double here = line.value(polygon(0, U), polygon(0, V));
    for (int64_t i = 0; i < n; i++) {
        const int64_t j = i + 1 < n ? i + 1 : 0;
        const double there = line.value(polygon(j, U), polygon(j, V));
        if (here >= 0 && kept < out.rows()) {
            out(kept, U) = polygon(i, U);
            out(kept, V) = polygon(i, V);
            kept++;
        }
        const bool crosses = (here > 0 && there < 0) || (here < 0 && there > 0);
        if (crosses && kept < out.rows()) {
            const double t = here / (here - there);
            out(kept, U) = polygon(i, U) + t * (polygon(j, U) - polygon(i, U));
            out(kept, V) = polygon(i, V) + t * (polygon(j, V) - polygon(i, V));
            kept++;
        }
        here = there;
    }
    return kept;
}

// Clips a polygon in place to the inner side of a line; returns its corner count. Most polygons are
// inside already.
inline int64_t cut(Points polygon, int64_t n, const Line &line, Points spare) {
    int64_t p = 0;
    while (p < n && line.value(polygon(p, U), polygon(p, V)) >= 0) p++;
    if (p == n) return n;
    n = keep_inside(polygon, n, line, spare);
    copy_polygon(spare, n, polygon);
    return n;
}

// Clips a polygon in place to the inner side of some lines; returns its corner count.
template <class Rows>
int64_t clip(Points polygon, int64_t n, const Rows &lines, int64_t n_lines, Points spare) {
    for (int64_t s = 0; s < n_lines; s++) n = cut(polygon, n, line_at(lines, s), spare);
    return n;
}

// Twice the signed area, positive for a clockwise polygon.
template <class Source> double twice_area(const Source &polygon, int64_t n) {
    double total = 0.0;
    const double u = polygon(0, U), v = polygon(0, V);
    for (int64_t i = 1; i < n - 1; i++)
        total += (polygon(i, U) - u) * (polygon(i + 1, V) - v) -
                 (polygon(i + 1, U) - u) * (polygon(i, V) - v);
    return total;
}

struct Bounds {
    double u_min, u_max, v_min, v_max;
    double around() const { return u_max - u_min + v_max - v_min; } // half of it
    double across() const { return length(u_max - u_min, v_max - v_min, 0.0); }
};
inline bool are_apart(const Bounds &a, const Bounds &b) {
    return a.u_min >= b.u_max || a.u_max <= b.u_min || a.v_min >= b.v_max || a.v_max <= b.v_min;
}

template <class Source> Bounds extent_of(const Source &polygon, int64_t n) {
    Bounds all = {polygon(0, U), polygon(0, U), polygon(0, V), polygon(0, V)};
    for (int64_t p = 1; p < n; p++) {
        all.u_min = std::min(all.u_min, polygon(p, U));
        all.u_max = std::max(all.u_max, polygon(p, U));
        all.v_min = std::min(all.v_min, polygon(p, V));
        all.v_max = std::max(all.v_max, polygon(p, V));
    }
    return all;
}

// Side i of a polygon of n corners, as a line through its first corner.
template <class Source> Line side_at(const Source &polygon, int64_t n, int64_t i) {
    const int64_t j = i + 1 < n ? i + 1 : 0;
    const double x = polygon(i, 0), y = polygon(i, 1);
    return {x, y, polygon(j, 0) - x, polygon(j, 1) - y, 0.0};
}

// Fills `values` with those of a line at the corners, 0 within the slack. Neither the least nor the
// greatest is beyond 0, so that it is 0 for a polygon on one side of the line.
inline Range values_on_line(Points polygon, int64_t n, const Line &line, double slack,
                            Column<double> values) {
    Range all = {0.0, 0.0};
    for (int64_t p = 0; p < n; p++) {
        const double value = line.value(polygon(p, U), polygon(p, V));
        values[p] = std::abs(value) > slack ? value : 0.0;
        all.add(values[p]);
    }
    return all;
}

// True if one of the lines has all corners of a polygon on its outer side or on itself. Exact for
// two faces on both sides of an edge they share: the value at a shared corner is 0 to the bit,
// whatever the rounding elsewhere.
template <class Rows>
bool separates(const Rows &lines, int64_t n_lines, Points corners, int64_t n) {
    for (int64_t s = 0; s < n_lines; s++) {
        const Line line = line_at(lines, s);
        bool is_beyond = true;
        for (int64_t p = 0; p < n && is_beyond; p++)
            is_beyond = !(line.value(corners(p, U), corners(p, V)) > 0);
        if (is_beyond) return true;
    }
    return false;
}

// True if one of the lines has a whole rectangle on its outer side or on itself.
template <class Rows> bool separates_box(const Rows &lines, int64_t n_lines, const Bounds &box) {
    for (int64_t s = 0; s < n_lines; s++) {
        const Line line = line_at(lines, s);
        const double u = line.dv > 0 ? box.u_min : box.u_max;
        const double v = line.du > 0 ? box.v_max : box.v_min;
        if (line.value(u, v) <= 0) return true;
    }
    return false;
}

// True if all corners of a polygon are on the inner side of all lines.
template <class Rows> bool contains(const Rows &lines, int64_t n_lines, Points corners, int64_t n) {
    for (int64_t s = 0; s < n_lines; s++) {
        const Line line = line_at(lines, s);
        for (int64_t p = 0; p < n; p++)
            if (line.value(corners(p, U), corners(p, V)) < 0) return false;
    }
    return true;
}

struct Counts {
    int64_t kept, lost;
};

// Splits a convex polygon where `values` change sign; corner counts of the two parts.
inline Counts split(Points polygon, int64_t n, FloatArray values, Points inside, Points outside) {
    int64_t kept = 0;
    int64_t lost = 0;
    const int64_t room = std::min(inside.rows(), outside.rows()) - 2;
    for (int64_t i = 0; i < n; i++) {
        const int64_t j = i + 1 < n ? i + 1 : 0;
        if (kept >= room || lost >= room) break;
        if (values[i] >= 0) {
            inside(kept, U) = polygon(i, U);
            inside(kept, V) = polygon(i, V);
            kept++;
        }
        if (values[i] <= 0) {
            outside(lost, U) = polygon(i, U);
            outside(lost, V) = polygon(i, V);
            lost++;
        }
        if ((values[i] > 0 && values[j] < 0) || (values[i] < 0 && values[j] > 0)) {
            const double t = values[i] / (values[i] - values[j]);
            const double u = polygon(i, U) + t * (polygon(j, U) - polygon(i, U));
            const double v = polygon(i, V) + t * (polygon(j, V) - polygon(i, V));
            inside(kept, U) = outside(lost, U) = u;
            inside(kept, V) = outside(lost, V) = v;
            kept++;
            lost++;
        }
    }
    return {kept, lost};
}

// Copies the part of a polygon beyond the chord from corner n / 2 to corner 0; its corners.
inline int64_t copy_second_half(Points polygon, int64_t n, Points target) {
    const int64_t half = n / 2;
    copy_polygon(from(polygon, half), n - half, target);
    target(n - half, U) = polygon(0, U);
    target(n - half, V) = polygon(0, V);
    return n - half + 1;
}

// Splits a piece of more than MOST_CORNERS corners along chords; returns the piece count. The parts
// after the first are appended; clip_subtract makes sure that there is room for them.
inline int64_t limit_corners(const Pieces &pieces, int64_t at, int64_t count) {
    while (pieces.n_corners[at] > MOST_CORNERS) {
        const int64_t n = pieces.n_corners[at];
        pieces.n_corners[count] = copy_second_half(pieces.corners[at], n, pieces.corners[count]);
        pieces.n_corners[at] = n / 2 + 1;
        count++;
    }
    return count;
}

// What a line may be off at a corner that counts as on it, of `tolerance` pixels.
INLINE double slack_of(const Line &line, double tolerance) {
    return tolerance * (std::abs(line.du) + std::abs(line.dv));
}

constexpr int64_t MISSED = -1;

// Lines that split a piece, a bit each. A side that has all of it beyond ends the search: the piece
// is not hidden, MISSED.
template <class Rows>
INLINE int64_t splitting_lines(const Rows &lines, int64_t n_lines, Points corners, int64_t n,
                               double tolerance) {
    int64_t splitting = 0;
    for (int64_t s = 0; s < n_lines; s++) {
        const Line line = line_at(lines, s);
        const double slack = slack_of(line, tolerance);
        Range all = {0.0, 0.0};
        for (int64_t p = 0; p < n; p++) all.add(line.value(corners(p, U), corners(p, V)));
        if (all.most <= slack) return MISSED;
        if (all.least < -slack) splitting |= int64_t(1) << s;
    }
    return splitting;
}

// Subtracts a convex occluder from `count` pieces; returns their new count, -1 for lack of room.
//
// Each line of the occluder slices off the part of a piece beyond it; these parts stay, the rest is
// hidden. `lines` have the occluder on their inner side: first its n_sides sides, then, where it is
// in front only in part, the line of equal depth, which cuts first: what is left of slivers along a
// common border then follows one after another, and later occluders cut few of them. Up to
// `tolerance` pixels from a line a corner is on it: without that the slivers that rounding leaves
// along the common side of two occluders are split by every line near them, and double with each.
template <class Rows>
int64_t clip_subtract(const Pieces &pieces, int64_t count, const Rows &lines, int64_t n_sides,
                      int64_t n_lines, double tolerance, Points spare, Column<double> values) {
    const auto &corners = pieces.corners;
    const auto &n_corners = pieces.n_corners;
    int64_t old = count;
    int64_t i = 0;
    while (i < old) {
        int64_t n = n_corners[i];
        const int64_t splitting = splitting_lines(lines, n_lines, corners[i], n, tolerance);
        if (splitting == MISSED) {
            i++;
            continue;
        }
        if (count + 4 * n_lines + 4 > corners.rows()) return -1;
        bool is_hidden = true;
        for (int64_t k = 0; k < n_lines; k++) {
            const int64_t s = k < n_lines - n_sides ? n_sides + k : k - (n_lines - n_sides);
            if (!(splitting >> s & 1)) continue;
            const Line line = line_at(lines, s);
            n = n_corners[i];
            const auto [least, most] =
                values_on_line(corners[i], n, line, slack_of(line, tolerance), values);
            if (most == 0) {
                is_hidden = false;
                break;
            }
            if (least < 0) {
                const auto [kept, lost] = split(corners[i], n, values, spare, corners[count]);
                if (lost >= 3) {
                    n_corners[count] = lost;
                    count = limit_corners(pieces, count, count + 1);
                }
                copy_polygon(spare, kept, corners[i]);
                n_corners[i] = kept;
                if (kept < 3) break;
            }
        }
        if (!is_hidden) {
            count = limit_corners(pieces, i, count);
            i++;
            continue;
        }
        // Piece i is gone: the last piece takes its place, a new one or an old one still to be
        // done.
        const bool is_new = count > old;
        const int64_t last = count - 1;
        if (i < last) {
            n_corners[i] = n_corners[last];
            copy_polygon(corners[last], n_corners[last], corners[i]);
        }
        count = last;
        if (is_new) i++;
        else old = last;
    }
    return count;
}

// --- images of faces ---

// Vertices at the ends of side s of a live face, clockwise in the image: the corners of a face seen
// from the front are taken in reverse.
inline std::array<int64_t, 2> ends_of_side(int64_t f, int64_t s, const Projected &projected) {
    const auto &faces = projected.faces;
    if (projected.side[f] < 0) return {faces(f, s), faces(f, (s + 1) % 3)};
    return {faces(f, s == 0 ? s : 3 - s), faces(f, 2 - s)};
}

// Line s of the outline of a live face, as outline fills it.
inline Line side_of(int64_t f, int64_t s, const Projected &projected) {
    if (projected.state[f] & CLIPPED)
        return line_at(projected.clipped.lines[projected.clipped_index[f]], s);
    const auto [p, q] = ends_of_side(f, s, projected);
    const auto &uvw = projected.uvw;
    const double u = uvw(p, U), v = uvw(p, V);
    return {u, v, uvw(q, U) - u, uvw(q, V) - v, 0.0};
}

inline void store_line(const Line &line, Lines lines, int64_t s) {
    lines(s, U) = line.u0;
    lines(s, V) = line.v0;
    lines(s, DU) = line.du;
    lines(s, DV) = line.dv;
    lines(s, OFFSET) = line.offset;
}

// Number of lines that bound the image of a live face.
inline int64_t n_sides_of(int64_t f, const Projected &projected) {
    return projected.state[f] & CLIPPED ? SIDES : 3;
}

struct Outline {
    int64_t n_corners, n_lines;
};

// Fills `corners` and `lines` with the image of a live face. It is clipped to the border of the
// image only if the face is clipped in space.
inline Outline outline(int64_t f, const Projected &projected, Points corners, Lines lines) {
    if (projected.state[f] & CLIPPED) {
        const int64_t s = projected.clipped_index[f];
        const Clipped &clipped = projected.clipped;
        copy_polygon(clipped.polygons[s], clipped.n_corners[s], corners);
        for (int64_t p = 0; p < SIDES; p++) store_line(line_at(clipped.lines[s], p), lines, p);
        return {clipped.n_corners[s], SIDES};
    }
    for (int64_t p = 0; p < 3; p++) {
        const Line line = side_of(f, p, projected);
        corners(p, U) = line.u0;
        corners(p, V) = line.v0;
        store_line(line, lines, p);
    }
    return {3, 3};
}

// True if the surface continues beyond line s of the outline of a face: it is no event edge. Never
// where one of the two faces is clipped in space: its lines may be known to few digits, and the
// near plane may cut it away.
inline bool is_joined(int64_t f, int64_t s, int64_t n_lines, const View &view) {
    if (n_lines == SIDES) return false;
    // The corners of a face seen from the front are taken in reverse.
    const int64_t e = view.edges.of_face(f, view.projected.side[f] < 0 ? s : 2 - s);
    if (view.is_event[e] || view.edges.faces(e, 1) < 0) return false;
    const int64_t other =
        view.edges.faces(e, 0) != f ? view.edges.faces(e, 0) : view.edges.faces(e, 1);
    return (view.projected.state[other] & (LIVE | CLIPPED | DOUBTFUL)) == LIVE;
}

// Largest error of the outline of a face, pixels.
inline double outline_error(int64_t f, const Pinhole &camera, const Projected &projected) {
    if (!(projected.state[f] & CLIPPED)) return camera.pixel_error;
    const int64_t plane = projected.clipped_index[f];
    return std::max(camera.pixel_error, projected.clipped.planes(plane, OUTLINE_ERROR));
}

// 1/z of a face: a point (u, v, w), the slopes of w along u and v, and the error of w.
struct Plane {
    double u, v, w, a, b, error;

    // 1/z at a point, and the size of the numbers that it is the sum of.
    struct Value {
        double w, size;
    };
    Value at(double at_u, double at_v) const {
        const double along_u = a * (at_u - u), along_v = b * (at_v - v);
        return {w + along_u + along_v, std::abs(w) + std::abs(along_u) + std::abs(along_v)};
    }
};

// That in a row of Clipped.planes.
template <class Row> Plane plane_in(const Row &row) {
    return {row[U], row[V], row[W], row[SLOPE_U], row[SLOPE_V], row[W_ERROR]};
}

// The error includes that of the corners and of the arithmetic here, anywhere in the face.
inline Plane plane_of(int64_t f, const Pinhole &camera, const Projected &projected) {
    if (projected.state[f] & CLIPPED)
        return plane_in(projected.clipped.planes[projected.clipped_index[f]]);
    const auto &[faces, uvw] = std::tie(projected.faces, projected.uvw);
    const int64_t i = faces(f, 0), j = faces(f, 1), k = faces(f, 2);
    const double u = uvw(i, U), v = uvw(i, V), w = uvw(i, W);
    const double u1 = uvw(j, U) - u, v1 = uvw(j, V) - v, w1 = uvw(j, W) - w;
    const double u2 = uvw(k, U) - u, v2 = uvw(k, V) - v, w2 = uvw(k, W) - w;
    const double twice = u1 * v2 - u2 * v1;
    const double a = (w1 * v2 - w2 * v1) / twice, b = (u1 * w2 - u2 * w1) / twice;
    // The slope across a needle is known to few digits.
    const double change = std::abs(w1) + std::abs(w2);
    const double skew =
        (std::abs(u1) + std::abs(u2)) * (std::abs(v1) + std::abs(v2)) / std::abs(twice);
    const double error =
        camera.w_error_rel * (w + change * skew) + camera.pixel_error * (std::abs(a) + std::abs(b));
    return {u, v, w, a, b, error};
}

// --- polygons in space ---

// Keeps the part of a polygon in space with a X + b Y + c Z >= d, in place; its corner count.
inline int64_t cut_in_space(Array<double, Any, 3> points, int64_t n, double a, double b, double c,
                            double d, Array<double, Any, 3> spare) {
    int64_t kept = 0;
    const auto value = [&](int64_t i) {
        return a * points(i, 0) + b * points(i, 1) + c * points(i, 2) - d;
    };
    for (int64_t i = 0; i < n; i++) {
        const int64_t j = i + 1 < n ? i + 1 : 0;
        const double here = value(i), there = value(j);
        if (here >= 0 && kept < spare.rows()) {
            for (int k = 0; k < 3; k++) spare(kept, k) = points(i, k);
            kept++;
        }
        if (((here > 0 && there < 0) || (here < 0 && there > 0)) && kept < spare.rows()) {
            const double t = here / (here - there);
            for (int k = 0; k < 3; k++)
                spare(kept, k) = points(i, k) + t * (points(j, k) - points(i, k));
            kept++;
        }
    }
    for (int64_t i = 0; i < kept; i++)
        for (int k = 0; k < 3; k++) points(i, k) = spare(i, k);
    return kept;
}

} // namespace rastercov::exact
