// The circle of the largest angle of incidence in the plane of a face, and what lies within it.
//
// The angle of incidence is at most theta within h tan(theta) of the foot of the camera's
// perpendicular, h being its height above the plane. The disc is replaced by the regular polygon of
// N corners inscribed in it, whose corners lie in directions that depend on the camera and the
// plane alone, so that it does not matter how the plane is cut into faces. The area between the
// chords and the arc goes into the bound. A piece is taken apart from the inside outwards: what
// lies within 8 chords is covered; beyond each chord only the rectangle around its segment of the
// circle is looked at again, with 8 chords of its own, down to the sides of the polygon.
//
// Twins: rastercov.reference.regions, point by point.
#pragma once
#include "area/density.hpp"
#include "lens/rounded.hpp"
#include <numbers>
#include <tuple>

namespace rastercov::area {

using std::numbers::pi;

constexpr int64_t CHORDS = 8; // that an arc is divided by at a time
// Corners of the polygon in the circle.
constexpr int64_t FEWEST_CHORDS = 16, MOST_CHORDS = 1 << 20;
// Radius within the chords of any circle of incidence, relative to its own.
inline const double LEAST_INNER_REL = rounded::cos(pi / FEWEST_CHORDS) * (1 - 1e-9);

// A point or a direction in the plane of a face.
struct Point {
    double x, y;
};

// Direction in the plane of a face that the polygon's first corner lies in: a tangent of the plane,
// in camera axes, continuous except for a plane seen exactly from behind.
inline Point anchor(const Plane &plane) {
    auto [x, y, z] = plane.normal;
    if (plane.height < 0) {
        x = -x;
        y = -y;
        z = -z;
    }
    const double a = 1.0 / std::max(1.0 - z, 1e-9);
    const double first = 1.0 - x * x * a, second = -x * y * a;
    const double along = first * plane.x_axis.x + second * plane.x_axis.y + x * plane.x_axis.z;
    const double across = first * plane.y_axis.x + second * plane.y_axis.y + x * plane.y_axis.z;
    const double size = length2(along, across);
    return {along / size, across / size};
}

// The part of an arc between corners of the polygon in a circle: its ends, and the greatest
// distance of the arc from its chord, with the error of a position.
struct Arc {
    int64_t first, last;
    Point from, to;
    double over;
};

// The circle of the largest angle of incidence on a face, whose tangent is `slope`, 0 for no limit:
// what all pieces of the face need of it. Its arcs are made for the first piece across it.
class Circle {
  public:
    double slope, radius, error, inner; // inner: radius within its chords, less the error
    int64_t n_chords;

    Circle(const Plane &plane, double slope, double gap)
        : slope(slope), radius(std::abs(plane.height) * slope), error(plane.error * (2 + slope)),
          plane(plane) {
        const double wanted = std::ceil(pi * std::sqrt(radius / (2 * gap)));
        n_chords =
            wanted > FEWEST_CHORDS ? int64_t(std::min(wanted, double(MOST_CHORDS))) : FEWEST_CHORDS;
        inner = radius * rounded::cos(pi / n_chords) - error;
    }

    // Fills `arcs` with the parts of an arc, at most CHORDS; their number.
    int64_t divide(int64_t start, int64_t end, Arc (&arcs)[CHORDS]) {
        const bool is_all = start == 0 && end == n_chords;
        if (is_all && has_first) return std::copy_n(first, CHORDS, arcs) - arcs;
        if (!has_towards) {
            towards = anchor(plane);
            has_towards = true;
        }
        const int64_t n = std::min(CHORDS, end - start);
        Point from = corner(start);
        for (int64_t c = 0; c < n; c++) {
            const int64_t begin = start + (end - start) * c / n;
            const int64_t stop = start + (end - start) * (c + 1) / n;
            const Point to = corner(stop);
            const double turn = rounded::cos(pi * (stop - begin) / n_chords);
            arcs[c] = {begin, stop, from, to, radius * (1 - turn) + error};
            from = to;
        }
        if (is_all) {
            std::copy_n(arcs, CHORDS, first);
            has_first = true;
        }
        return n;
    }

  private:
    const Plane &plane;
    Point towards; // the first corner
    bool has_towards = false;
    bool has_first = false;
    Arc first[CHORDS]; // of the whole circle

    Point corner(int64_t k) const {
        const double angle = 2 * pi * k / n_chords;
        const double c = radius * rounded::cos(angle), s = radius * rounded::sin(angle);
        return {plane.foot_x + (c * towards.x - s * towards.y),
                plane.foot_y + (c * towards.y + s * towards.x)};
    }
};

// Part of a polygon in the rectangle beyond the chord of an arc that holds its segment; corner
// count. The arc must be less than half of the circle.
inline int64_t cap_of_chord(Points part, int64_t n, const Arc &arc, Points out) {
    Polygon memory;
    const Points spare = memory.points();
    const auto &[from, to] = std::tie(arc.from, arc.to);
    const double dx = to.x - from.x, dy = to.y - from.y;
    // Beyond the chord, between its ends, and not beyond the tangent.
    n = exact::keep_inside(part, n, {from.x, from.y, -dx, -dy, 0.0}, spare);
    if (n >= 3) n = exact::keep_inside(spare, n, {from.x, from.y, dy, -dx, 0.0}, out);
    if (n >= 3) n = exact::keep_inside(out, n, {to.x, to.y, -dy, dx, 0.0}, spare);
    if (n >= 3) {
        const double offset = arc.over * length2(dx, dy);
        n = exact::keep_inside(spare, n, {from.x, from.y, dx, dy, offset}, out);
    }
    return n >= 3 ? n : 0;
}

// Appends the part of a polygon within the polygon in a circle.
template <class C>
void append_within_circle(int64_t face, Points polygon, int64_t n, Circle &circle,
                          const C &criteria, Scratch &scratch, const Found &out) {
    Stack &caps = scratch.caps;
    Polygon memory, inside, spare;
    const Points part = memory.points(), inner = inside.points();
    caps.push_parts(polygon, n, 0, circle.n_chords);
    while (caps.top > 0) {
        const Stack::Entry &entry = caps.pop();
        const int64_t start = entry.one, end = entry.other;
        n = entry.n;
        copy_polygon(caps.next(), n, part);
        const double area = std::max(twice_area(part, n) / 2, 0.0);
        if (end - start == 1) {
            out.bound[face] += area + circle.error * perimeter_of(part, n);
            continue;
        }
        if (!caps.has_room(CHORDS) || !(area > 0)) {
            out.bound[face] += area;
            continue;
        }
        Arc arcs[CHORDS];
        const int64_t n_parts = circle.divide(start, end, arcs);
        copy_polygon(part, n, inner);
        int64_t m = n;
        for (int64_t c = 0; c < n_parts; c++) {
            const auto &[first, last, from, to, over] = arcs[c];
            const int64_t k = cap_of_chord(part, n, arcs[c], caps.next());
            if (k >= 3) caps.push(k, first, last);
            const Line chord = {from.x, from.y, to.x - from.x, to.y - from.y, 0.0};
            if (m >= 3) m = exact::cut(inner, m, chord, spare.points());
        }
        if (m >= 3) append_dense(face, inner, m, criteria, scratch, out);
    }
}

// Appends the part of a convex polygon within the circle of the largest angle of incidence. What
// the polygon in the circle leaves undecided goes into the bound.
template <class C>
void append_within_angle(int64_t face, Points polygon, int64_t n, Circle &circle, const C &criteria,
                         Scratch &scratch, const Found &out) {
    const Plane &plane = scratch.plane;
    double farthest = 0.0;
    for (int64_t p = 0; p < n; p++)
        farthest =
            std::max(farthest, length2(polygon(p, U) - plane.foot_x, polygon(p, V) - plane.foot_y));
    if (circle.slope == 0 || farthest < circle.inner)
        append_dense(face, polygon, n, criteria, scratch, out);
    else append_within_circle(face, polygon, n, circle, criteria, scratch, out);
}

} // namespace rastercov::area
