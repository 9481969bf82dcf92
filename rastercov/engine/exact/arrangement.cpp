// Visible areas by the arrangement of event edges on a face.
//
// The visibility of a face changes only where an event edge that is visible itself crosses it, or
// where another face passes through it. These lines divide its image into convex cells; in each
// cell the face is wholly visible or wholly hidden, which the faces in front of one point of it
// decide. A face has few such lines, two in the median, whatever number of faces is in front of it.
//
// A face that nothing crosses is one cell. It decides over its region, so three points of it are
// asked, which must agree.
//
// Where rounding could decide - a point that lies too near to an edge or to another surface - the
// face is left to half planes.
//
// A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
//
// Twins: tests/exact/test_arrangement.py, by half planes.
#include "exact/intersection.hpp"
#include "exact/passes.hpp"
#include "interrupt.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

enum Sight { VISIBLE, HIDDEN, UNSURE };

using Row = Array<double, 7>;

// True if the first of u, v, du, dv that differ is less in a segment than in another.
bool comes_before(Row segment, Row other) {
    for (int column = 0; column < FIRST; column++)
        if (segment[column] != other[column]) return segment[column] < other[column];
    return false;
}

// Fills `order` with the crossings of a face from left to right; returns their number, or
// MOST_CROSSINGS + 1 if there are more than MOST_CROSSINGS. The order must not depend on the
// numbers of vertices, which decide the order in the list.
int64_t order_crossings(int64_t t, const Crossings &crossings, Column<int64_t> order) {
    const auto &segments = crossings.segments;
    int64_t n = 0;
    for (int64_t c = crossings.last[t]; c >= 0; c = crossings.before[c]) {
        if (n == MOST_CROSSINGS) return n + 1;
        int64_t at = n;
        for (; at > 0 && comes_before(segments[c], segments[order[at - 1]]); at--)
            order[at] = order[at - 1];
        order[at] = c;
        n++;
    }
    return n;
}

// Divides piece p of `count` by the line of a crossing, or intersection, that runs through it;
// returns the piece count. The piece is changed in place; the part beyond the line is appended.
int64_t divide_piece(const Pieces &pieces, int64_t p, int64_t count, Row segment,
                     const Work &work) {
    const Points corners = pieces.corners[p];
    const auto &values = work.values;
    const int64_t n = pieces.n_corners[p];
    const double u = segment[U], v = segment[V], du = segment[DU], dv = segment[DV];
    const double tolerance = segment[EDGE_ERROR], slack = tolerance * (std::abs(du) + std::abs(dv));
    const auto [least, most] = values_on_line(corners, n, {u, v, du, dv, 0.0}, slack, values);
    if (least == 0 || most == 0) return count;
    // The part of the line within the piece must hold a part of the crossing.
    const double squared = du * du + dv * dv;
    Range along;
    for (int64_t k = 0; k < n; k++) {
        const int64_t m = k + 1 < n ? k + 1 : 0;
        double at_u, at_v;
        if (values[k] == 0) {
            at_u = corners(k, U);
            at_v = corners(k, V);
        } else if (values[k] * values[m] < 0) {
            const double t = values[k] / (values[k] - values[m]);
            at_u = corners(k, U) + t * (corners(m, U) - corners(k, U));
            at_v = corners(k, V) + t * (corners(m, V) - corners(k, V));
        } else {
            continue;
        }
        along.add(((at_u - u) * du + (at_v - v) * dv) / squared);
    }
    const double reach = tolerance * (std::abs(du) + std::abs(dv)) / squared;
    if (std::min(along.most, segment[LAST]) - std::max(along.least, segment[FIRST]) <= reach)
        return count;
    const auto [kept, lost] = split(corners, n, values, work.spare, pieces.corners[count]);
    if (kept < 3 || lost < 3) return count;
    copy_polygon(work.spare, kept, corners);
    pieces.n_corners[p] = kept;
    pieces.n_corners[count] = lost;
    return count + 1;
}

// HIDDEN if the image of a face covers a point, VISIBLE if it does not.
Sight covers(int64_t m, double u, double v, const View &view) {
    const Projected &projected = view.projected;
    const int64_t n_lines = n_sides_of(m, projected);
    const double error = outline_error(m, view.camera, projected);
    Sight result = HIDDEN;
    for (int64_t s = 0; s < n_lines; s++) {
        const Line line = side_of(m, s, projected);
        const double value = line.value(u, v);
        const double margin = slack_of(line, SURE * error);
        if (value < -margin) return VISIBLE;
        if (value < margin && !is_joined(m, s, n_lines, view)) result = UNSURE;
    }
    return result;
}

// Sight of a point of face t, pixels, whose plane is given.
Sight point_visibility(int64_t t, double u, double v, const Plane &plane, const View &view) {
    const auto &[box, state] = std::tie(view.projected.box, view.projected.state);
    const double w = plane.at(u, v).w;
    const double farthest = w - plane.error - 4 * DEPTH_TIE_REL * w;
    const int64_t at = cell_at(u, v, view.grid);
    lay_bounds(at, view);
    Sight result = VISIBLE;
    Walk walk(at, view.grid);
    int64_t m = view.grid.hider[at];
    int64_t index = -1;
    int64_t n = 0;
    const double margin = MOST_OF_OUTLINE * SURE * view.camera.pixel_error; // see covers
    const Bounds point = {u, u, v, v};
    const Depths depths = {farthest, -INF, INF};
    const auto may = [&](const Group &group, const Place &) {
        return touches(group, point, depths) && !is_outside(group, u, v, u, v, margin);
    };
    while (index < n || walk.next(may)) {
        if (index == n) {
            n = find_faces_if(walk.first, walk.last, point, depths, view.grid, 0,
                              [](int64_t) { return true; });
            view.work.n_compared[0] += n;
            index = 0;
            continue;
        }
        if (index >= 0) m = view.grid.found[index];
        index++;
        if (m < 0 || m == t || box(m, W_MAX) < farthest || !(state[m] & LIVE)) continue;
        if (!(box(m, U_MIN) <= u && u <= box(m, U_MAX) && box(m, V_MIN) <= v && v <= box(m, V_MAX)))
            continue;
        const Sight covered = covers(m, u, v, view);
        if (covered == VISIBLE) continue;
        const Plane its = plane_of(m, view.camera, view.projected);
        const double nearer = its.at(u, v).w - w;
        const double margin = plane.error + its.error + 2 * DEPTH_TIE_REL * (w + std::abs(nearer));
        if (nearer < -margin) continue;
        if (nearer <= margin || covered == UNSURE) {
            result = UNSURE;
            continue;
        }
        view.grid.hider[at] = int32_t(m);
        return HIDDEN;
    }
    return result;
}

// Divides a face into triangles about its centre; returns their number.
int64_t divide_about_centre(Points target, int64_t n, const Pieces &pieces) {
    double u = 0.0;
    double v = 0.0;
    for (int64_t p = 0; p < n; p++) {
        u += target(p, U) / n;
        v += target(p, V) / n;
    }
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = p + 1 < n ? p + 1 : 0;
        const Points corners = pieces.corners[p];
        corners(0, U) = u;
        corners(0, V) = v;
        corners(1, U) = target(p, U);
        corners(1, V) = target(p, V);
        corners(2, U) = target(q, U);
        corners(2, V) = target(q, V);
        pieces.n_corners[p] = 3;
    }
    return n;
}

// Lists the lines along which faces in contact pass through a face; see add_intersection.
int64_t list_intersections(int64_t t, const Outline &image, const Partners &partners,
                           const View &view) {
    int64_t n_lines = 0;
    if (view.projected.state[t] & IN_CONTACT)
        for (int64_t k = partners.starts[t]; k < partners.starts[t + 1] && n_lines != NOT_KNOWN;
             k++)
            n_lines = add_intersection(t, partners.faces[k], image, n_lines, view);
    return n_lines;
}

// Divides a face by its crossings and n_lines intersections; its cells, NOT_KNOWN for too many.
// What the error of a line may move is added to the bound of the face.
int64_t divide_target(int64_t t, int64_t n, int64_t n_crossings, int64_t n_lines,
                      const Crossings &crossings, const View &view, const Pieces &pieces) {
    const Work &work = view.work;
    int64_t count = 1;
    if (view.projected.state[t] & CROSSED) {
        copy_polygon(work.target, n, pieces.corners[0]);
        pieces.n_corners[0] = n;
    } else {
        count = divide_about_centre(work.target, n, pieces);
    }
    for (int64_t k = 0; k < n_crossings + n_lines; k++) {
        const Row segment = k < n_crossings ? crossings.segments[work.levels[k]]
                                            : work.intersections[k - n_crossings];
        view.area_error[t] += 4 * (std::abs(segment[DU]) + std::abs(segment[DV])) *
                              (segment[LAST] - segment[FIRST]) * segment[EDGE_ERROR];
        const int64_t before = count;
        for (int64_t p = 0; p < before; p++) {
            if (count == MOST_CELLS) return NOT_KNOWN;
            count = divide_piece(pieces, p, count, segment, work);
        }
    }
    return count;
}

struct Sum {
    double twice; // area of the visible cells; NOT_KNOWN where rounding could decide
    int64_t n_hidden;
};

// Twice the area of the visible ones of the cells of a face. A sliver, without a point that surely
// lies inside, goes into the bound of the face; one of more than `error` decides.
Sum sum_cells(int64_t t, int64_t count, double error, const View &view, const Pieces &pieces) {
    const double pixel_error = view.camera.pixel_error;
    const Plane plane = plane_of(t, view.camera, view.projected);
    Sum sum = {0.0, 0};
    for (int64_t p = 0; p < count; p++) {
        const Points corners = pieces.corners[p];
        const int64_t n = pieces.n_corners[p];
        const double u = corners(0, U), v = corners(0, V);
        double around = 0.0;
        double twice = 0.0;
        double mean_u = 0.0;
        double mean_v = 0.0;
        for (int64_t k = 1; k < n; k++) {
            const double u1 = corners(k, U) - u, v1 = corners(k, V) - v;
            around += std::abs(corners(k, U) - corners(k - 1, U));
            around += std::abs(corners(k, V) - corners(k - 1, V));
            if (k + 1 < n) {
                const double u2 = corners(k + 1, U) - u, v2 = corners(k + 1, V) - v;
                const double part = u1 * v2 - u2 * v1;
                twice += part;
                mean_u += part * (u1 + u2);
                mean_v += part * (v1 + v2);
            }
        }
        if (twice <= 4 * SURE * pixel_error * around) {
            if (twice > error) return {double(NOT_KNOWN), sum.n_hidden};
            view.area_error[t] += std::max(twice, 0.0);
            continue;
        }
        const Sight seen =
            point_visibility(t, u + mean_u / (3 * twice), v + mean_v / (3 * twice), plane, view);
        if (seen == UNSURE) return {double(NOT_KNOWN), sum.n_hidden};
        if (seen == HIDDEN) {
            sum.n_hidden++;
        } else {
            sum.twice += twice;
            store_piece(t, corners, n, view.work.kept);
        }
    }
    return sum;
}

// Finds the visible area of a face; false where it is left to half planes.
bool measure_by_cells(int64_t t, const Crossings &crossings, const Partners &partners,
                      const View &view, const Pieces &pieces) {
    const auto &[state, kept] = std::tie(view.projected.state, view.work.kept);
    const int64_t n_crossings = order_crossings(t, crossings, view.work.levels);
    const bool is_crossed = state[t] & CROSSED;
    if (state[t] & UNFIT || n_crossings > MOST_CROSSINGS) return false;
    if (is_crossed && n_crossings == 0 && !(state[t] & IN_CONTACT)) return false;
    view.visible[t] = 0.0;
    const Outline image = take_target(t, view);
    const int64_t n = image.n_corners;
    if (n < 3 || is_hidden_by_one(t, n, view)) return true;
    const double error = view.area_error[t];
    const int64_t n_kept = kept.used[0], n_kept_corners = kept.used[1];
    const int64_t n_lines = list_intersections(t, image, partners, view);
    int64_t count = NOT_KNOWN;
    if (n_lines >= 0) count = divide_target(t, n, n_crossings, n_lines, crossings, view, pieces);
    Sum sum = {0.0, 0};
    if (count >= 0) sum = sum_cells(t, count, error, view, pieces);
    if (count < 0 || sum.twice < 0 || (!is_crossed && sum.n_hidden > 0 && sum.twice > 0)) {
        drop_pieces(kept, n_kept, n_kept_corners);
        return false;
    }
    settle_area(t, sum.twice / 2, view, n_kept, n_kept_corners);
    return true;
}

} // namespace

// Visible areas of crossed faces, and of faces that decide over their regions; returns how many are
// left to half planes, and in `left` which. Out, too: as of visible_areas. work.kept may be too
// small: call again with more. `pieces`, MOST_CELLS or more, are scratch.
int64_t arrangement_areas(Int32Array targets, const Crossings &crossings, const Partners &partners,
                          const View &view, const Pieces &pieces, Column<int32_t> left) {
    int64_t n_left = 0;
    Poll poll(16);
    for (const int32_t t : targets)
        if (poll(); !measure_by_cells(t, crossings, partners, view, pieces)) left[n_left++] = t;
    return n_left;
}

} // namespace exact
} // namespace rastercov
