// A face in camera axes, lines in its plane, and the regions that are found in it.
//
// An image point (u, v) has the ray r = ((u - cx)/fx, (v - cy)/fy, 1) in camera axes and shows the
// point P = z r of the plane n . P = -h at depth z = -h / (n . r). Depth is affine in the plane, so
// focus and pixels per m^2 are half planes, and so are the borders of the image and the near plane.
//
// Invariants: a line has the largest error of its value; what lies within it counts as undecided,
// in the bound of the face.
//
// Twins: rastercov.reference.regions.
#pragma once
#include "area/polygon.hpp"
#include "camera/camera.hpp"
#include "coverage/decision.hpp"
#include "lens/field.hpp"
#include "vector.hpp"
#include <algorithm>
#include <tuple>
#include <vector>

namespace rastercov::area {

using exact::Bounds, exact::MOST_CORNERS;

// Largest error of a point in camera axes, relative to its distance and the size of its face: a
// difference, two products of three terms, and their sum.
constexpr double POSITION_ERROR_REL = 8 * 0x1p-52;
constexpr int64_t STACK_ROOM = 96; // parts that are still to be divided
constexpr double INF = std::numeric_limits<double>::infinity();

// Faces of a mesh, of rastercov.core.area.polygons; `is_asked` are those to be measured.
struct Planes {
    FloatRows<3> origin, x_axis, y_axis, normal;
    FloatRows<3, 2> corners;
    FloatArray areas;
    BoolArray two_sided, is_asked;
};

// A solved pose: `rotation` world_from_camera and `centre`; see engine::PlaneSolver. `rows` are
// those of the faces in the arrays of the solver; none where each is its own.
struct Seen {
    Array<const double, 3, 3> rotation;
    Array<const double, 3> centre;
    double near;
    IntArray rows;
    Column<const uint16_t> state;
    Column<const int8_t> side;
    FloatArray visible, area, area_error;
    BoolArray is_certified;
    exact::VisiblePieces kept; // of faces that are seen in part
};

// Pointwise criteria of a task in the image of a pinhole. `gap` is the largest distance between
// the arc of the incidence criterion and its chords, and the mean width of the strips that no test
// decides, metres; `pixel_error` is the largest error of a position in the image, px. Those of
// parallel rays have fx and fy in px/m.
struct Criteria {
    Lens lens;
    Rules rules;
    double gap, pixel_error;
    bool is_parallel;
};

// Pointwise criteria of a task in one ideal plane of a lens. `pinhole` has what a surface must
// meet in the plane itself: to be in its image, and the angle of incidence; `rules` has all. Where
// distances are in focus, by_distance; if not, depths along `axis` are, the axis of the lens in the
// axes of the plane. `gap` is the mean width of the strips that no test decides, metres. `tree` is
// the field of view; `code`, `params` and `frame` are the lens, `slopes` bounds of its derivatives;
// it has_border where the image may show the border of its valid region in the plane. Of parallel
// rays `unit` is the length of a unit of the plane, metres; of others 0.
struct LensCriteria {
    Criteria pinhole;
    Rules rules;
    bool by_distance;
    Array<const double, 3> axis;
    double gap;
    lens::Tree tree;
    int64_t code;
    lens::Params params;
    lens::Frame frame;
    lens::Slopes slopes;
    bool has_border;
    double unit;
};

// Regions of a pose: corners, `starts` of N pieces, their faces; area and bound of each face, m^2,
// and the part `doubt` of the bound that can only add to the area. `used` has the pieces and the
// corners so far, also where there is no room for them, `cut_short` the area that no density
// decides because the divisions of its face ended, m^2.
struct Found {
    Points xy;
    Column<int64_t> starts;
    Column<int32_t> face;
    Array<int64_t, 2> used;
    Column<double> area, bound, doubt;
    Array<double, 1> cut_short;
};

// A face in camera axes: its frame; the distance of the camera from the plane, negative from
// behind, and the foot of its perpendicular; the largest error of a point of the face, and its
// longest edge.
struct Plane {
    Vector origin, x_axis, y_axis, normal;
    double height, foot_x, foot_y, error, longest;
    // Distance below which corners in the plane are the same, metres.
    double nearest_corners() const { return std::max(COINCIDENT_REL * longest, error); }
    double depth_at(double x, double y) const { return origin.z + x * x_axis.z + y * y_axis.z; }
};

struct Depths {
    double least, most;
};

// The image of a face along parallel rays in the plane at the depth `unit`, in the frame of the
// face: a camera at the origin sees it in the same pixels, as if it were there.
inline Plane flatten(const Plane &plane, double unit) {
    Plane flat = plane;
    flat.origin.z = unit;
    flat.x_axis.z = flat.y_axis.z = 0.0;
    flat.normal = {0.0, 0.0, plane.normal.z};
    flat.height = -plane.normal.z * unit;
    return flat;
}

// Sets `plane` to face f; returns the least and the greatest depth of it.
inline Depths set_plane(const Planes &planes, int64_t f, const Seen &seen, Plane &plane) {
    const auto &rotation = seen.rotation;
    const auto &centre = seen.centre;
    const auto in_axes = [&](double a, double b, double c) -> Vector {
        return {a * rotation(0, 0) + b * rotation(1, 0) + c * rotation(2, 0),
                a * rotation(0, 1) + b * rotation(1, 1) + c * rotation(2, 1),
                a * rotation(0, 2) + b * rotation(1, 2) + c * rotation(2, 2)};
    };
    const auto x_axis = planes.x_axis[f], y_axis = planes.y_axis[f], normal = planes.normal[f];
    plane.x_axis = in_axes(x_axis[0], x_axis[1], x_axis[2]);
    plane.y_axis = in_axes(y_axis[0], y_axis[1], y_axis[2]);
    plane.normal = in_axes(normal[0], normal[1], normal[2]);
    const double a = planes.origin(f, 0) - centre[0];
    const double b = planes.origin(f, 1) - centre[1];
    const double c = planes.origin(f, 2) - centre[2];
    plane.origin = in_axes(a, b, c);
    // In the axes of the world: the products with a normal along one of them are exact.
    plane.height = -(a * normal[0] + b * normal[1] + c * normal[2]);
    plane.foot_x = -(a * x_axis[0] + b * x_axis[1] + c * x_axis[2]);
    plane.foot_y = -(a * y_axis[0] + b * y_axis[1] + c * y_axis[2]);
    plane.longest = planes.corners(f, 1, 0);
    plane.error = POSITION_ERROR_REL * (std::abs(a) + std::abs(b) + std::abs(c) + plane.longest);
    Depths depths = {plane.origin.z, plane.origin.z};
    for (int p = 1; p < 3; p++) {
        const double depth = plane.depth_at(planes.corners(f, p, U), planes.corners(f, p, V));
        depths = {std::min(depths.least, depth), std::max(depths.most, depth)};
    }
    return depths;
}

// value + x X + y Y in the plane of a face.
struct Affine {
    double value, x, y;
    double at(double X, double Y) const { return value + x * X + y * Y; }
};

// The line a x + b y + c of the ideal plane, or a X + b Y + c Z in camera axes, in that of a face.
inline Affine line_in_plane(double a, double b, double c, const Plane &plane) {
    const auto along = [&](const Vector &v) { return a * v.x + b * v.y + c * v.z; };
    return {along(plane.origin), along(plane.x_axis), along(plane.y_axis)};
}

// Extremes of a line at the corners of a polygon.
template <class Source>
Depths least_and_most(const Source &polygon, int64_t n, const Affine &line) {
    Depths all = {INF, -INF};
    for (int64_t p = 0; p < n; p++) {
        const double at = line.at(polygon(p, U), polygon(p, V));
        all = {std::min(all.least, at), std::max(all.most, at)};
    }
    return all;
}

// The line sign value + sign x X + sign y Y >= 0.
inline Line line_of(const Affine &line, double sign) {
    return {0.0, 0.0, sign * line.y, -(sign * line.x), sign * line.value};
}

// Part of a polygon where sign times a line is >= 0; its corner count.
inline int64_t keep_beyond(Points polygon, int64_t n, const Affine &line, double sign, Points out) {
    return exact::keep_inside(polygon, n, line_of(line, sign), out);
}

// A line with the largest error of its value.
struct Border {
    Line line;
    double error;
};
inline Border border_of(double value, double along_x, double along_y, double error) {
    return {line_of({value, along_x, along_y}, 1.0), error};
}

// Memory of one polygon.
struct Polygon {
    double corners[PIECE_ROOM * 2];
    Points points() { return {corners, {PIECE_ROOM, 2}}; }
};

struct Cut {
    int64_t n;        // corners, 0 for none
    double undecided; // area of the strips along the lines where rounding decides, m^2
};

// Clips a polygon in place by some lines.
template <size_t N>
Cut cut_by_lines(Points polygon, int64_t n, const Border (&borders)[N], size_t first, size_t last) {
    Polygon spare;
    Cut cut = {n, 0.0};
    for (size_t s = first; s < last; s++) {
        const auto &[line, error] = borders[s];
        Range all;
        for (int64_t p = 0; p < cut.n; p++) all.add(line.value(polygon(p, U), polygon(p, V)));
        if (all.least > error) continue;
        if (all.most < -error) return {0, cut.undecided};
        const double slope = length2(line.du, line.dv);
        const double area = std::max(twice_area(polygon, cut.n) / 2, 0.0);
        double strip = area;
        if (slope > 0) strip = std::min(area, error / slope * perimeter_of(polygon, cut.n));
        cut.undecided += strip;
        if (all.least < 0) {
            cut.n = exact::keep_inside(polygon, cut.n, line, spare.points());
            copy_polygon(spare.points(), cut.n, polygon);
        }
        if (cut.n < 3) return {0, cut.undecided};
    }
    return cut;
}

// Polygons that are still to be divided, and two numbers of each.
struct Stack {
    struct Entry {
        Polygon polygon;
        int64_t n, one, other;
    };
    int64_t top = 0;
    Entry entries[STACK_ROOM];

    bool has_room(int64_t more) const { return top + more <= STACK_ROOM; }
    // The polygon that the next push counts.
    Points next() { return entries[top].polygon.points(); }
    void push(int64_t n, int64_t one, int64_t other) {
        Entry &entry = entries[top++];
        entry.n = n;
        entry.one = one;
        entry.other = other;
    }
    Entry &pop() { return entries[--top]; }
    // Puts a polygon on the empty stack, in parts of at most MOST_CORNERS corners.
    void push_parts(Points polygon, int64_t n, int64_t one, int64_t other) {
        top = 0;
        for (int64_t first = 1; first + 1 < n;) {
            const int64_t m = exact::corners_of_part(first, n);
            exact::copy_part(polygon, first, m, next());
            push(m, one, other);
            first += m - 2;
        }
    }
};

// Greatest distance of a corner from the first: between half the diameter and all of it.
inline double reach_of(Points polygon, int64_t n) {
    double reach = 0.0;
    for (int64_t p = 1; p < n; p++)
        reach =
            std::max(reach, length2(polygon(p, U) - polygon(0, U), polygon(p, V) - polygon(0, V)));
    return reach;
}

// Appends a convex polygon to the regions, in pieces of at most MOST_CORNERS corners. The
// difference that leaving out needless corners makes is added to the bound of the face.
inline void append_piece(int64_t face, Points polygon, int64_t n, double nearest,
                         const Found &out) {
    Polygon memory;
    const Points tidy = memory.points();
    const double before = n >= 3 ? twice_area(polygon, n) / 2 : 0.0;
    const int64_t kept = without_needless(polygon, n, nearest, tidy);
    const double area = kept == n ? before : kept >= 3 ? twice_area(tidy, kept) / 2 : 0.0;
    if (!(area > 0)) {
        out.bound[face] += std::max(before, 0.0);
        return;
    }
    out.area[face] += area;
    out.bound[face] += std::abs(area - before);
    for (int64_t first = 1; first + 1 < kept;) {
        const int64_t piece = out.used[0], at = out.used[1];
        const int64_t m = exact::corners_of_part(first, kept);
        if (piece < out.face.rows() && at + m <= out.xy.rows()) {
            exact::copy_part(tidy, first, m, exact::from(out.xy, at));
            out.face[piece] = int32_t(face);
            out.starts[piece + 1] = at + m;
        }
        out.used[0] = piece + 1;
        out.used[1] = at + m;
        first += m - 2;
    }
}

// Polygons of at most MOST_CORNERS corners that are still to be decided, the largest first; of
// equal ones the first that came.
class Queue {
  public:
    struct Part {
        double area; // m^2
        int64_t n, mask, level;
    };

    bool is_empty() const { return heap.empty(); }

    // Adds a polygon of any area, with criteria that it must meet and the times that it was halved.
    void push(Points polygon, int64_t n, int64_t mask, int64_t level) {
        for (int64_t first = 1; first + 1 < n;) {
            if (free.empty()) {
                free.push_back(int64_t(parts.size()));
                parts.emplace_back();
                corners.resize(parts.size() * 2 * MOST_CORNERS);
            }
            const int64_t slot = free.back(), m = exact::corners_of_part(first, n);
            const Points own = at(slot);
            exact::copy_part(polygon, first, m, own);
            const double area = twice_area(own, m) / 2;
            first += m - 2;
            if (!(area > 0)) continue;
            free.pop_back();
            parts[slot] = {area, m, mask, level};
            heap.push_back({area, -pushed++, slot});
            std::push_heap(heap.begin(), heap.end());
        }
    }

    // Takes the largest polygon away.
    Part pop(Points out) {
        std::pop_heap(heap.begin(), heap.end());
        const int64_t slot = std::get<2>(heap.back());
        heap.pop_back();
        free.push_back(slot);
        copy_polygon(at(slot), parts[slot].n, out);
        return parts[slot];
    }

  private:
    int64_t pushed = 0;
    std::vector<std::tuple<double, int64_t, int64_t>> heap; // area, order, slot
    std::vector<int64_t> free;
    std::vector<Part> parts;
    std::vector<double> corners;

    Points at(int64_t slot) {
        return {corners.data() + slot * 2 * MOST_CORNERS, {MOST_CORNERS, 2}};
    }
};

// Memory of one call.
struct Scratch {
    Plane plane;
    Stack caps, views;
    Queue strips;
};

} // namespace rastercov::area

namespace rastercov {

RECORD(area::Planes, origin, x_axis, y_axis, normal, corners, areas, two_sided, is_asked);
RECORD(area::Criteria, lens, rules, gap);
RECORD(area::LensCriteria, pinhole, rules, by_distance, axis, gap, tree, code, params, frame,
       slopes, has_border, unit);
} // namespace rastercov
