// Parts of segments in the image: where an edge crosses a face, and where a face hides it.
//
// A part of a segment is a range: 0 at its start, 1 at its end. A coordinate or a value that is
// affine along the segment is given by its numbers at both ends.
//
// Invariants: a value at a corner that an edge and a face share is 0 to the bit; w is affine on a
// face and on an edge, so that their difference is greatest at an end of a range.
//
// Twins: tests/exact/test_certificate.py, by the exact areas.
#pragma once
#include "exact/half_plane.hpp"
#include <tuple>

namespace rastercov::exact {

enum { START, END, IS_VISIBLE }; // rows of a segment; of Segment.ends, 1 if not wholly hidden
constexpr int64_t NO_VERTEX = -1,
                  NO_EDGE = -1; // end that is no vertex of the surface; no such edge

// A part of a segment; empty if the first is above the last.
struct Part {
    double first, last;
    bool is_empty() const { return first > last; }
};
constexpr Part NOWHERE = {1.0, 0.0};

// Part of a range where a coordinate is in low ... high.
inline Part narrow(double start, double end, double low, double high, Part part) {
    const double step = end - start;
    if (step == 0) return low <= start && start <= high ? part : NOWHERE;
    const double enters = (low - start) / step, leaves = (high - start) / step;
    return {std::max(part.first, std::min(enters, leaves)),
            std::min(part.last, std::max(enters, leaves))};
}

// Part of a range where a value is >= 0.
inline Part narrow_to_inside(double start, double end, Part part) {
    if (start < 0 && end < 0) return NOWHERE;
    if (start < 0) part.first = std::max(part.first, start / (start - end));
    else if (end < 0) part.last = std::min(part.last, start / (start - end));
    return part;
}

// A segment in the image with its vertices, or NO_VERTEX.
struct Ends {
    double u0, v0, w0, u1, v1, w1;
    int64_t a, b;
};
inline Ends ends_of(const Segment &segment) {
    const auto &uvw = segment.uvw;
    return {uvw(START, U), uvw(START, V), uvw(START, W),       uvw(END, U),
            uvw(END, V),   uvw(END, W),   segment.ends[START], segment.ends[END]};
}

// True if an end of a segment is a corner of a face.
inline bool shares_end(int64_t f, const Ends &s, const Projected &projected) {
    const auto &faces = projected.faces;
    bool shares = false;
    for (int k = 0; k < 3; k++) shares |= (faces(f, k) == s.a) | (faces(f, k) == s.b);
    return shares;
}

// True if the line of a segment passes a face within the tolerance, pixels, or f is clipped. One
// whose other corners lie on one side only meets the segment at the corner that both have, at most.
inline bool straddles(int64_t f, const Ends &s, double tolerance, const Projected &projected) {
    const Line line = {s.u0, s.v0, s.u1 - s.u0, s.v1 - s.v0, 0.0};
    const double reach = slack_of(line, tolerance);
    bool is_above = true;
    bool is_below = true;
    for (int k = 0; k < 3; k++) {
        const int64_t vertex = projected.faces(f, k);
        const bool is_end = (vertex == s.a) | (vertex == s.b);
        const double side = line.value(projected.uvw(vertex, U), projected.uvw(vertex, V));
        is_above &= is_end | (side > reach);
        is_below &= is_end | (side < -reach);
    }
    return !(is_above | is_below) | ((projected.state[f] & CLIPPED) != 0);
}

// Part of a range where a segment crosses a face at or before its depth. The face f is not clipped
// in space, lies on the line of the segment, see straddles, and is grown by the tolerance, pixels.
inline Part crosses(int64_t f, const Ends &s, Part part, double tolerance,
                    const Projected &projected) {
    const bool starts_within = part.first > 0, ends_within = part.last < 1;
    const auto &[faces, uvw] = std::tie(projected.faces, projected.uvw);
    const int second = projected.side[f] < 0 ? 1 : 2;
    const int64_t i = faces(f, 0), j = faces(f, second), k = faces(f, 3 - second);
    const double du = s.u1 - s.u0, dv = s.v1 - s.v0;
    const double ui = uvw(i, U), vi = uvw(i, V), uj = uvw(j, U), vj = uvw(j, V);
    const double uk = uvw(k, U), vk = uvw(k, V);
    const bool has_a = s.a >= 0 && (s.a == i || s.a == j || s.a == k);
    const bool has_b = s.b >= 0 && (s.b == i || s.b == j || s.b == k);
    if (has_a && has_b) return NOWHERE; // its own edge
    // The part of the segment within the face grown by the tolerance. For a segment that starts at
    // a corner of the face the two sides there are not tested by distance: it is within if its far
    // end is within their wedge.
    const int64_t corner = has_a ? s.a : has_b ? s.b : NO_VERTEX;
    for (int side = 0; side < 3; side++) {
        const auto [p, q] = ends_of_side(f, side, projected);
        const double up = uvw(p, U), vp = uvw(p, V);
        const double along_u = uvw(q, U) - up, along_v = uvw(q, V) - vp;
        const Line line = {up, vp, along_u, along_v,
                           tolerance * (std::abs(along_u) + std::abs(along_v))};
        const double start = line.value(s.u0, s.v0), end = line.value(s.u1, s.v1);
        if (corner == p || corner == q) {
            if ((has_a ? end : start) < 0) return NOWHERE;
            continue;
        }
        part = narrow_to_inside(start, end, part);
        if (part.is_empty()) return NOWHERE;
    }
    const double w = uvw(i, W), wa = uvw(j, W) - w, wb = uvw(k, W) - w;
    const double ua = uj - ui, va = vj - vi, ub = uk - ui, vb = vk - vi;
    const double twice = ua * vb - ub * va;
    const double slope_u = (wa * vb - wb * va) / twice, slope_v = (ua * wb - ub * wa) / twice;
    const double tie = DEPTH_TIE_REL * projected.box(f, W_MAX);
    const auto is_before = [&](double t) {
        const double its = s.w0 + t * (s.w1 - s.w0);
        const double mine = w + slope_u * (s.u0 + t * du - ui) + slope_v * (s.v0 + t * dv - vi);
        return its >= mine - tie;
    };
    if ((starts_within || !has_a) && is_before(part.first)) return part;
    if ((ends_within || !has_b) && is_before(part.last)) return part;
    return NOWHERE;
}

// Part of a range where face m certainly hides a segment. The face is shrunk by the tolerance,
// pixels, along its event edges; along the others, where the surface continues, it is grown by the
// rounding of a position.
inline Part hidden_range(int64_t m, const Ends &s, Part part, double tolerance, const View &view) {
    if (shares_end(m, s, view.projected)) return NOWHERE; // at the depth of the segment there
    const int64_t n_lines = n_sides_of(m, view.projected);
    const double error = outline_error(m, view.camera, view.projected);
    for (int64_t side = 0; side < n_lines; side++) {
        const Line line = side_of(m, side, view.projected);
        const double extent = std::abs(line.du) + std::abs(line.dv);
        const double start = line.value(s.u0, s.v0), end = line.value(s.u1, s.v1);
        const double least = -2 * error * extent, most = (2 * tolerance + error) * extent;
        if (start < least && end < least) return NOWHERE;
        if (start >= most && end >= most) continue;
        const double margin = is_joined(m, side, n_lines, view) ? least : most;
        part = narrow_to_inside(start - margin, end - margin, part);
        if (part.is_empty()) return NOWHERE;
    }
    const Plane of = plane_of(m, view.camera, view.projected);
    const auto &box = view.projected.box;
    const double margin = 2 * of.error + 4 * DEPTH_TIE_REL * box(m, W_MAX);
    const double start = of.at(s.u0, s.v0).w - s.w0 - margin;
    const double end = of.at(s.u1, s.v1).w - s.w1 - margin;
    part = narrow_to_inside(start, end, part);
    // The sides of a needle that is grown meet far beyond its tip.
    part = narrow(s.u0, s.u1, box(m, U_MIN) - 2 * error, box(m, U_MAX) + 2 * error, part);
    return narrow(s.v0, s.v1, box(m, V_MIN) - 2 * error, box(m, V_MAX) + 2 * error, part);
}

// Takes a part out of n ranges; returns how many are left. Where there is no room for another
// range, the part stays in.
inline int64_t take_range(Points ranges, int64_t n, Part part) {
    const auto [first, last] = part;
    for (int64_t i = 0; i < n;) {
        const double start = ranges(i, 0), end = ranges(i, 1);
        if (first <= start && last >= end) {
            n--;
            ranges(i, 0) = ranges(n, 0);
            ranges(i, 1) = ranges(n, 1);
            continue;
        }
        if (last > start && first <= start) {
            ranges(i, 0) = last;
        } else if (first < end && last >= end) {
            ranges(i, 1) = first;
        } else if (first > start && last < end && n < ranges.rows()) {
            ranges(n, 0) = last;
            ranges(n, 1) = end;
            ranges(i, 1) = first;
            n++;
        }
        i++;
    }
    return n;
}

} // namespace rastercov::exact
