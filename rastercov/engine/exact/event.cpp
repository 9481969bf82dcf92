// Event edges and the faces that they cross.
//
// Seen from the camera, the set of surfaces in front of a point changes only across event edges:
// silhouette edges, borders, edges of more than two faces, and the rims where the near plane clips.
// `find_event_edges` finds them. Where a surface hides such an edge from the camera, it hides all
// that is behind on both of its sides, so only the visible parts matter: `mark_crossed` finds them,
// by the cells of the grid that an edge runs through, and the faces that they cross in the image,
// at or before the face.
//
// A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
//
// Twins: tests/exact/test_certificate.py, by the exact areas.
#include "exact/passes.hpp"
#include "exact/segments.hpp"
#include "interrupt.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

// Cells in the bounding box of an event edge beyond which all cells are asked for.
constexpr int64_t MOST_CELLS_OF_EDGE = 256;
// Width of the margin around an event edge in which cells are asked for, in tolerances: more than
// mark_segment looks at.
constexpr double MARGIN = 4;
// Relative difference of 1/z up to which a corner counts as one on the near plane.
constexpr double NEAR_PLANE_TOLERANCE_REL = 1e-6;

// True if all faces of a block of edges are seen from one side, so that none is an event.
bool is_of_one_side(int64_t m, const Blocks &blocks, Column<int8_t> block_side) {
    if (!blocks.is_plain[m]) return false;
    const int64_t start = blocks.starts[m], stop = blocks.starts[m + 1];
    const int8_t common = block_side[blocks.of_edges[start]];
    bool is_common = common != MIXED;
    for (int64_t k = start + 1; k < stop; k++)
        is_common &= block_side[blocks.of_edges[k]] == common;
    return is_common;
}

} // namespace

// Finds the edges whose two sides in the image may have different numbers of faces. They include
// each edge of a face that is seen edge-on up to rounding, and of one that contains the camera
// centre: the visible side of it is unknown. Out: is_event, and their indices in `events`. Returns
// their number.
int64_t find_event_edges(const Edges &edges, const Projected &projected, Column<bool> is_event,
                         Column<int32_t> events) {
    const int64_t n_edges = edges.faces.rows();
    int64_t n = 0;
    std::fill(is_event.begin(), is_event.end(), false);
    for (int64_t m = 0; m < projected.blocks.is_plain.rows(); m++) {
        if (is_of_one_side(m, projected.blocks, projected.block_side)) continue;
        for (int64_t e = m * BLOCK; e < std::min((m + 1) * BLOCK, n_edges); e++) {
            const int64_t f = edges.faces(e, 0), g = edges.faces(e, 1);
            const int first = projected.side[f], second = g >= 0 ? projected.side[g] : 0;
            const uint16_t flags =
                g >= 0 ? projected.state[f] | projected.state[g] : projected.state[f];
            bool is_one = edges.kind[e] == CONSISTENT ? first != second : first != -second;
            if (edges.kind[e] == NON_MANIFOLD || flags & DOUBTFUL) is_one = true;
            if (is_one) {
                is_event[e] = true;
                events[n++] = int32_t(e);
            }
        }
    }
    return n;
}

namespace {

// Adds the crossing of a face and an edge to the list of the face; returns the number of all. The
// edge runs towards greater u, or v, whatever its vertices. Crossings beyond the room in
// `crossings` are counted, not added.
int64_t record_crossing(int64_t f, int64_t edge, const Segment &segment, Part part,
                        const Crossings &crossings, int64_t n) {
    const auto &uvw = segment.uvw;
    int start = START;
    int end = END;
    const double du = uvw(END, U) - uvw(START, U), dv = uvw(END, V) - uvw(START, V);
    if (du < 0 || (du == 0 && dv < 0)) {
        std::swap(start, end);
        part = {1 - part.last, 1 - part.first};
    }
    const int64_t previous = crossings.last[f];
    if (previous >= 0 && crossings.edge[previous] == edge) {
        const auto row = crossings.segments[previous];
        row[FIRST] = std::min(row[FIRST], part.first);
        row[LAST] = std::max(row[LAST], part.last);
        return n;
    }
    if (n < crossings.edge.rows()) {
        crossings.last[f] = int32_t(n);
        crossings.before[n] = int32_t(previous);
        crossings.edge[n] = int32_t(edge);
        crossings.number[n] = previous >= 0 ? crossings.number[previous] + 1 : 1;
        const auto row = crossings.segments[n];
        row[U] = uvw(start, U);
        row[V] = uvw(start, V);
        row[DU] = uvw(end, U) - row[U];
        row[DV] = uvw(end, V) - row[V];
        row[FIRST] = part.first;
        row[LAST] = part.last;
        row[EDGE_ERROR] = std::max(uvw(START, POSITION_ERROR), uvw(END, POSITION_ERROR));
    }
    return n + 1;
}

// A segment that is followed through the image: a number for it, whether it bounds a doubtful face,
// so that what it crosses is UNFIT, and whether two faces that may be of one region have it, so
// that it matters whether it is hidden; the tolerance of mark_crossed, and where crossings go.
struct Course {
    int64_t edge;
    bool is_doubtful, may_join;
    const Segment &segment;
    double tolerance;
    const View &view;
    const Crossings &crossings;
};

// True if no crossing is listed of a face any more, or none ever was.
bool is_settled(int64_t f, const Projected &projected) {
    return (projected.state[f] & (LIVE | UNFIT)) != LIVE;
}

// The same of all faces of a group.
bool is_settled(const Place &place, const View &view) {
    return holds_of_all(&Group::is_settled, place, view.grid,
                        [&](int64_t f) { return is_settled(f, view.projected); });
}

// A part of a segment in a cell, and which faces matter to it.
struct Passage {
    const Course &course;
    Ends s;
    Part part;
    double ua, ub, va, vb, wa, wb; // its ends
    double reach;                  // of values of its line, within the tolerance
    Line line;                     // see straddles

    Passage(const Course &course, Part part)
        : course(course), s(ends_of(course.segment)), part(part) {
        const double du = s.u1 - s.u0, dv = s.v1 - s.v0, dw = s.w1 - s.w0;
        ua = s.u0 + part.first * du;
        ub = s.u0 + part.last * du;
        va = s.v0 + part.first * dv;
        vb = s.v0 + part.last * dv;
        wa = s.w0 + part.first * dw;
        wb = s.w0 + part.last * dw;
        line = {s.u0, s.v0, du, dv, 0.0};
        reach = slack_of(line, course.tolerance);
    }

    Bounds rectangle() const {
        const double tolerance = course.tolerance;
        return {std::min(ua, ub) - tolerance, std::max(ua, ub) + tolerance,
                std::min(va, vb) - tolerance, std::max(va, vb) + tolerance};
    }
    bool is_beside(const Range &at) const { return (at.least > reach) | (at.most < -reach); }
    double farthest() const { return std::min(s.w0, s.w1); }

    // True if a face of a group may hide a part of it, or, of faces that are not wholly in front, a
    // crossing with it may be listed.
    bool may_meet(Group &group, const Place &place, bool are_in_front) const {
        if (is_beside(values_at_corners(group, line, s.a, s.b))) return false;
        // Beyond a side of them: needles of one line all touch its line. At a tip the sides of a
        // grown needle meet as far as AROUND tolerances away.
        constexpr double AROUND = 0x1p10;
        if (is_outside(group, ua, va, ub, vb, AROUND * course.tolerance)) return false;
        bool has_a = false;
        bool has_b = false;
        for (const CornerOfMany &corner : group.all_corners()) {
            has_a |= corner.common >= 0 && corner.common == s.a;
            has_b |= corner.common >= 0 && corner.common == s.b;
        }
        // See hidden_range.
        const bool may_hide = !has_a && !has_b &&
                              !(group.slab.is_below(ua, va, wa) && group.slab.is_below(ub, vb, wb));
        if (may_hide || are_in_front) return may_hide;
        // See crosses, of faces that are before it but for an end that they share with it.
        const bool is_behind = ((has_a && part.first == 0) || group.slab.is_above(ua, va, wa)) &&
                               ((has_b && part.last == 1) || group.slab.is_above(ub, vb, wb));
        return !(is_behind && !(has_a && has_b)) && !is_settled(place, course.view);
    }

    // True if a face that its line may pass may hide a part of it, or be crossed by it.
    bool meets(int64_t f, bool are_in_front) const {
        const Projected &projected = course.view.projected;
        const bool is_needed =
            ((projected.box(f, W_MAX) >= farthest()) & !shares_end(f, s, projected)) |
            (!are_in_front & !is_settled(f, projected));
        return is_needed & straddles(f, s, course.tolerance, projected);
    }
};

// Takes what face m hides out of n parts of a passage; returns how many are left.
int64_t take_hidden(const Passage &passage, int64_t m, int64_t n) {
    const View &view = passage.course.view;
    const Projected &projected = view.projected;
    if (!(projected.box(m, W_MAX) >= passage.farthest()) ||
        (projected.state[m] & (LIVE | DOUBTFUL)) != LIVE)
        return n;
    const Part hidden = hidden_range(m, passage.s, passage.part, passage.course.tolerance, view);
    return hidden.first < hidden.last ? take_range(view.work.ranges, n, hidden) : n;
}

// Crossings of a face in a cell with n entries beyond which it is UNFIT. Each edge that is seen of
// needles before one another crosses all that are behind; half planes find soon that these are
// hidden.
int64_t most_crossings(int64_t n) {
    const double share = double(MANY) / std::max(n, MANY), square = share * share;
    return 1 + int64_t((MOST_CROSSINGS - 1) * square * square);
}

// Lists the crossings of a face and n parts of a passage; returns the number of all crossings. A
// face with more than `most` is UNFIT.
int64_t add_crossings(const Passage &passage, int64_t f, int64_t n, int64_t n_crossings,
                      int64_t most) {
    const Course &course = passage.course;
    const View &view = course.view;
    for (int64_t i = 0; i < n; i++) {
        const Part across = crosses(f, passage.s, {view.work.ranges(i, 0), view.work.ranges(i, 1)},
                                    course.tolerance, view.projected);
        if (!(across.first <= across.last)) continue;
        view.projected.state[f] |= course.is_doubtful ? CROSSED | UNFIT : CROSSED;
        view.projected.block_state[f / BLOCK] |= CROSSED;
        n_crossings =
            record_crossing(f, course.edge, course.segment, across, course.crossings, n_crossings);
        const int64_t last = course.crossings.last[f];
        if (last >= 0 && course.crossings.number[last] > most) view.projected.state[f] |= UNFIT;
    }
    return n_crossings;
}

// True if it matters which parts of a passage are hidden: of an edge that may join two regions, or
// that may cross a face in cell c. Of faces that nearly coincide each edge meets all of them.
bool matters(const Passage &passage, int64_t c, const Bounds &rectangle, const Depths &depths) {
    const Course &course = passage.course;
    const View &view = course.view;
    const CellGrid &grid = view.grid;
    if (course.may_join || grid.stops[c] - grid.starts[c] <= MANY) return true;
    const auto may = [&](Group &group, const Place &place) {
        return touches(group, rectangle, depths) &&
               !passage.is_beside(
                   values_at_corners(group, passage.line, passage.s.a, passage.s.b)) &&
               !is_settled(place, view);
    };
    for (Walk walk(c, grid); walk.next(may);)
        for (int64_t entry = walk.first; entry < walk.last; entry++) {
            const int64_t f = grid.entries[entry];
            if (!is_settled(f, view.projected) &&
                straddles(f, passage.s, course.tolerance, view.projected))
                return true;
        }
    return false;
}

// Marks the live faces of cell c that the visible parts of a segment there cross; `part` is that in
// the cell. Returns the number of crossings.
int64_t mark_in_cell(int64_t c, const Course &course, Part part, int64_t n_crossings) {
    const View &view = course.view;
    const auto &[projected, grid, ranges] = std::tie(view.projected, view.grid, view.work.ranges);
    const Passage passage(course, part);
    const Bounds rectangle = passage.rectangle();
    const double nearest = std::max(passage.s.w0, passage.s.w1);
    ranges(0, 0) = part.first;
    ranges(0, 1) = part.last;
    int64_t n = 1;
    int64_t n_kept = 0;
    lay_bounds(c, view);
    // Edges beside each other are often hidden by one face.
    if (grid.hider[c] >= 0) n = take_hidden(passage, grid.hider[c], n);
    if (n == 0) return n_crossings;
    const bool has_many = grid.stops[c] - grid.starts[c] > MANY;
    // Faces wholly in front of the edge come first: they can hide it, and it crosses none of them.
    const double in_front = nearest * (1 + 4 * DEPTH_TIE_REL);
    if (!matters(passage, c, rectangle, {-INF, -INF, in_front})) return n_crossings;
    for (const bool are_in_front : {true, false}) {
        const Depths depths =
            are_in_front ? Depths{passage.farthest(), in_front, INF} : Depths{-INF, -INF, in_front};
        n_kept = 0;
        const auto may = [&](Group &group, const Place &place) {
            return touches(group, rectangle, depths) &&
                   passage.may_meet(group, place, are_in_front);
        };
        for (Walk walk(c, grid); walk.next(may);) {
            const int64_t before = n_kept,
                          n_found = find_faces_if(walk.first, walk.last, rectangle, depths, grid,
                                                  n_kept, [&](int64_t k) {
                                                      return !has_many ||
                                                             !passage.is_beside(values_at_corners(
                                                                 k, passage.line, grid));
                                                  });
            view.work.n_compared[0] += n_found - before;
            for (int64_t k = before; k < n_found; k++) {
                // Without a branch: which of them straddle is not predictable.
                grid.found[n_kept] = grid.found[k];
                n_kept += passage.meets(grid.found[k], are_in_front);
            }
            for (int64_t k = before; k < n_kept; k++) {
                n = take_hidden(passage, grid.found[k], n);
                if (n > 0) continue;
                grid.hider[c] = grid.found[k];
                return n_crossings;
            }
        }
    }
    course.segment.ends[IS_VISIBLE] = 1;
    for (int64_t k = 0; k < n_kept; k++) {
        const int64_t f = grid.found[k];
        if (!is_settled(f, projected) &&
            nearest >= projected.box(f, W_MIN) * (1 - 2 * DEPTH_TIE_REL))
            n_crossings = add_crossings(passage, f, n, n_crossings,
                                        most_crossings(grid.stops[c] - grid.starts[c]));
    }
    return n_crossings;
}

// Marks the live faces that the visible parts of a segment cross, by the cells it runs through;
// returns the number of crossings.
int64_t mark_segment(const Course &course, Array<double, 7> extent, int64_t n_crossings) {
    const CellGrid &grid = course.view.grid;
    const double tolerance = course.tolerance;
    const Ends s = ends_of(course.segment);
    const double u = s.u0, v = s.v0, du = s.u1 - u, dv = s.v1 - v;
    Part within =
        narrow(u, u + du, extent[U_MIN] - tolerance, extent[U_MAX] + tolerance, {0.0, 1.0});
    within = narrow(v, v + dv, extent[V_MIN] - tolerance, extent[V_MAX] + tolerance, within);
    const auto [t0, t1] = within;
    course.segment.ends[IS_VISIBLE] = t0 > 0 || t1 < 1 ? 1 : 0;
    if (t0 > t1) return n_crossings;
    const double ua = u + t0 * du, ub = u + t1 * du, va = v + t0 * dv, vb = v + t1 * dv;
    const int64_t top = row_at(std::min(va, vb) - tolerance, grid);
    const int64_t bottom = row_at(std::max(va, vb) + tolerance, grid);
    for (int64_t row = top; row <= bottom; row++) {
        // Range of u while the segment is in this row, which is widened by the tolerance.
        double left = std::min(ua, ub) - tolerance, right = std::max(ua, ub) + tolerance;
        Part in_row = within;
        if (top < bottom) {
            const double upper = grid.top + row / grid.per_v - tolerance;
            const double lower = grid.top + (row + 1) / grid.per_v + tolerance;
            const double enters = std::min(std::max((upper - va) / (vb - va), 0.0), 1.0);
            const double leaves = std::min(std::max((lower - va) / (vb - va), 0.0), 1.0);
            const double at = ua + enters * (ub - ua), to = ua + leaves * (ub - ua);
            left = std::min(at, to) - 2 * tolerance;
            right = std::max(at, to) + 2 * tolerance;
            in_row = {t0 + std::min(enters, leaves) * (t1 - t0),
                      t0 + std::max(enters, leaves) * (t1 - t0)};
        }
        const int64_t first = column_at(left, grid), last = column_at(right, grid);
        for (int64_t column = first; column <= last; column++) {
            // The outermost cells hold all that is beyond them.
            left = column > first ? grid.left + column / grid.per_u - tolerance : -INF;
            right = column < last ? grid.left + (column + 1) / grid.per_u + tolerance : INF;
            const Part in_cell = narrow(u, u + du, left, right, in_row);
            if (in_cell.first <= in_cell.last)
                n_crossings =
                    mark_in_cell(row * grid.columns + column, course, in_cell, n_crossings);
        }
    }
    return n_crossings;
}

// Projects edge a b, which reaches before the near plane or far out; false if nothing is left. Out:
// `segment`, with NO_VERTEX for an end that was clipped.
bool project_clipped(int64_t a, int64_t b, Vertices vertices, const Pinhole &camera,
                     const Segment &segment) {
    double p[3], q[3];
    for (int k = 0; k < 3; k++) {
        p[k] = q[k] = 0.0;
        for (int i = 0; i < 3; i++) {
            p[k] += (vertices(a, i) - camera.centre[i]) * camera.rotation(i, k);
            q[k] += (vertices(b, i) - camera.centre[i]) * camera.rotation(i, k);
        }
    }
    const double fx = camera.fx, fy = camera.fy, cx = camera.cx, cy = camera.cy, near = camera.near;
    Part part = narrow_to_inside(p[2] - near, q[2] - near, {0.0, 1.0});
    const struct {
        int axis;
        double focal, offset;
    } borders[4] = {{0, fx, cx - camera.u_min},
                    {0, -fx, camera.u_max - cx},
                    {1, fy, cy - camera.v_min},
                    {1, -fy, camera.v_max - cy}};
    for (const auto &[axis, focal, offset] : borders)
        part = narrow_to_inside(focal * p[axis] + offset * camera.divisor_at(p[2]),
                                focal * q[axis] + offset * camera.divisor_at(q[2]), part);
    if (part.is_empty()) return false;
    const double reach = length(p[0], p[1], p[2]) + length(q[0], q[1], q[2]);
    segment.ends[START] = part.first == 0 ? a : NO_VERTEX;
    segment.ends[END] = part.last == 1 ? b : NO_VERTEX;
    for (const int end : {START, END}) {
        const double t = end == START ? part.first : part.last;
        const double z = std::max(p[2] + t * (q[2] - p[2]), near);
        const double over = camera.divisor_at(z);
        segment.uvw(end, U) = fx * ((p[0] + t * (q[0] - p[0])) / over) + cx;
        segment.uvw(end, V) = fy * ((p[1] + t * (q[1] - p[1])) / over) + cy;
        segment.uvw(end, W) = camera.w_at(z);
        // Of parallel rays pixel_error has the reach of all vertices.
        const double growth = camera.is_parallel() ? 4.0 : 2 * reach / z;
        segment.uvw(end, POSITION_ERROR) = camera.pixel_error * std::max(1.0, growth);
    }
    return true;
}

// Fills `segment` with the image of an event edge; false if nothing of it is in front.
bool project_event(int64_t e, const Edges &edges, Vertices vertices, const Pinhole &camera,
                   const Array<double, Any, 3> &uvw, const Segment &segment) {
    const int64_t a = edges.vertices(e, 0), b = edges.vertices(e, 1);
    if (!(uvw(a, W) > 0 && uvw(b, W) > 0)) return project_clipped(a, b, vertices, camera, segment);
    segment.ends[START] = a;
    segment.ends[END] = b;
    for (int k = 0; k < 3; k++) {
        segment.uvw(START, k) = uvw(a, k);
        segment.uvw(END, k) = uvw(b, k);
    }
    segment.uvw(START, POSITION_ERROR) = segment.uvw(END, POSITION_ERROR) = camera.pixel_error;
    return true;
}

} // namespace

// Asks for the cells around event edges; false, before the last, if one has too many. They are
// those of its bounding box with a margin.
bool ask_for_events(Int32Array events, const Edges &edges, Vertices vertices, const Pinhole &camera,
                    const Projected &projected, double tolerance, const CellGrid &grid,
                    const Segment &segment) {
    const auto &uvw = segment.uvw;
    for (const int32_t e : events) {
        if (!project_event(e, edges, vertices, camera, projected.uvw, segment)) continue;
        const double margin = MARGIN * tolerance;
        const Cells cells = cells_of_rectangle({std::min(uvw(START, U), uvw(END, U)) - margin,
                                                std::max(uvw(START, U), uvw(END, U)) + margin,
                                                std::min(uvw(START, V), uvw(END, V)) - margin,
                                                std::max(uvw(START, V), uvw(END, V)) + margin},
                                               grid);
        if ((cells.right - cells.left + 1) * (cells.bottom - cells.top + 1) > MOST_CELLS_OF_EDGE)
            return false;
        ask_for_cells(cells, grid);
    }
    return true;
}

namespace {

// Fills `segment` with side p of the image of a clipped face if the near plane cut it there.
bool take_rim(int64_t s, int64_t p, const Pinhole &camera, const Clipped &clipped,
              const Segment &segment) {
    if (p >= clipped.n_corners[s]) return false;
    const auto polygon = clipped.polygons[s];
    const Plane plane = plane_in(clipped.planes[s]);
    const int64_t q = p + 1 < clipped.n_corners[s] ? p + 1 : 0;
    const auto &its = segment.uvw;
    for (const int end : {START, END}) {
        const int64_t corner = end == START ? p : q;
        const double u = polygon(corner, U), v = polygon(corner, V);
        // As near as it may be: 1/z of a face that almost contains the camera centre is known to
        // few digits.
        its(end, U) = u;
        its(end, V) = v;
        its(end, W) = std::min(plane.at(u, v).w + plane.error, 1 / camera.near_depth());
        its(end, POSITION_ERROR) = camera.pixel_error;
        segment.ends[end] = NO_VERTEX;
    }
    const double rim = (1 - NEAR_PLANE_TOLERANCE_REL) / camera.near_depth();
    return its(START, W) >= rim && its(END, W) >= rim;
}

} // namespace

// Marks the live faces crossed by a visible part of an event edge or of a rim at the near plane:
// CROSSED is added to the states of faces and blocks, and UNFIT to those of faces where rounding
// decides what crosses. An edge that passes a face within the tolerance, pixels, counts as crossing
// it. `extent` and n_clipped are those of set_up. Out: `crossings`, in which there was none.
// Returns the number of crossings; if it is more than `crossings` has room for, it ended early:
// call again with more.
int64_t mark_crossed(Int32Array events, Vertices vertices, const View &view,
                     Array<double, 7> extent, double tolerance, int64_t n_clipped,
                     const Segment &segment, const Crossings &crossings) {
    const int64_t n_events = events.rows();
    int64_t n_crossings = 0;
    Poll poll(16);
    // Without room for its crossings no face becomes UNFIT: the rest would cross all of them.
    for (int64_t index = 0;
         index < n_events + n_clipped * CORNERS && n_crossings <= crossings.edge.rows(); index++) {
        poll();
        int64_t e = NO_EDGE;
        bool is_doubtful = true;
        bool may_join = false;
        if (index < n_events) {
            e = events[index];
            crossings.is_hidden[e] = false;
            if (!project_event(e, view.edges, vertices, view.camera, view.projected.uvw, segment))
                continue;
            const int64_t other = view.edges.faces(e, 1);
            uint16_t flags = view.projected.state[view.edges.faces(e, 0)];
            if (other >= 0) flags |= view.projected.state[other];
            is_doubtful = (flags & DOUBTFUL) != 0;
            may_join = other >= 0 && !(flags & CROSSED);
        } else {
            const int64_t side = index - n_events;
            if (!take_rim(side / CORNERS, side % CORNERS, view.camera, view.projected.clipped,
                          segment))
                continue;
        }
        n_crossings = mark_segment({e, is_doubtful, may_join, segment, tolerance, view, crossings},
                                   extent, n_crossings);
        if (may_join && !segment.ends[IS_VISIBLE]) {
            const int64_t a = view.edges.vertices(e, 0), b = view.edges.vertices(e, 1);
            crossings.is_hidden[e] = view.projected.uvw(a, W) > 0 && view.projected.uvw(b, W) > 0;
        }
    }
    return n_crossings;
}

} // namespace exact
} // namespace rastercov
