// The border of the valid region of a lens in the plane of a face, and what lies within it.
//
// The border is a cone around the axis of the lens, and meets the plane in an ellipse, a parabola
// or a branch of a hyperbola, all the same to this loop: the cone is replaced by flat sides, planes
// through the eye and two of its rays, which are lines in any plane. A piece is taken apart from
// the inside outwards: what lies within some sides is kept; beyond each side only what the plane
// that touches the cone there leaves is looked at again, with sides of its own, until it is
// narrower than the gap. Of a cone around -z, beyond 90 degrees, what is outside is kept.
//
// Twins: tests/area/test_cones.py, by closed forms and by quadrature.
#pragma once
#include "area/plane.hpp"
#include "lens/lens.hpp"

namespace rastercov::area {

// Values of lines along the axes of the lens in the plane of a face.
class Cone {
  public:
    bool is_convex; // the valid region is within the cone; if not, outside of one around -z
    double error;   // greatest of a line

    Cone(const lens::Params &params, const lens::Frame &frame, const Plane &plane)
        : is_convex(lens::Cone(params).is_convex()), error(4 * plane.error) {
        for (int k = 0; k < 3; k++)
            axes[k] = line_in_plane(frame(k, 0), frame(k, 1), frame(k, 2), plane);
        const lens::Cone cone(params);
        sine = is_convex ? cone.sine : -cone.sine;
        cosine = std::abs(cone.cosine);
    }

    // Line of the flat side between two rays of the cone, `half` a turn to both sides of `turn`;
    // >= 0 towards the axis. It touches the cone where half is 0.
    Affine side(double turn, double half) const {
        return sum({-cosine * std::cos(turn), -cosine * std::sin(turn), sine * std::cos(half)});
    }
    // Line through the axis, >= 0 at turns up to a half turn beyond `turn`.
    Affine beyond(double turn) const { return sum({-std::sin(turn), std::cos(turn), 0.0}); }
    // Turn of a point around the axis.
    double turn_of(double x, double y) const {
        return std::atan2(axes[1].at(x, y), axes[0].at(x, y));
    }
    // Value, as of a line, by which a point is within the cone.
    double within(double x, double y) const {
        return sine * axes[2].at(x, y) - cosine * length2(axes[0].at(x, y), axes[1].at(x, y));
    }

  private:
    double sine, cosine; // of half its angle; the sine is negative for a cone around -z
    Affine axes[3];

    Affine sum(const std::array<double, 3> &weight) const {
        Affine line = {0.0, 0.0, 0.0};
        for (int k = 0; k < 3; k++) {
            line.value += weight[k] * axes[k].value;
            line.x += weight[k] * axes[k].x;
            line.y += weight[k] * axes[k].y;
        }
        return line;
    }
};

// Turns are counted in parts of a whole one.
constexpr int64_t WHOLE_TURN = int64_t(1) << 40, LEAST_TURN = 1 << 8;
// Sides that an arc is replaced by at a time, as many as make a piece; and a whole turn at first.
constexpr int64_t MOST_FLAT = 17, OF_WHOLE = 4;
// Sides of the last groups on average: an arc is not equally wide everywhere.
constexpr int64_t MEAN_FLAT = 14;

// Sides that a part is cut by at a time; what they leave is as narrow as the gap where they are the
// last ones.
struct Sides {
    int64_t n;
    bool are_last;
};

// Sides for a part that is so many times as wide as the gap: the width falls as the square of the
// number of sides. Of more than MOST_FLAT the last ones are about that many, since each group makes
// a piece.
inline Sides sides_for(double narrow) {
    double wanted = std::ceil(std::sqrt(narrow));
    const bool are_last = wanted <= double(MOST_FLAT);
    while (wanted > double(MOST_FLAT)) wanted = std::ceil(wanted / MEAN_FLAT);
    return {std::max(int64_t(wanted), int64_t(1)), are_last};
}

// Turns between which a polygon is, from 0 to WHOLE_TURN where it may be around the axis.
struct Span {
    int64_t start, end;
};
inline Span turns_of(Points polygon, int64_t n, const Cone &cone) {
    constexpr double WIDEST = 0.4, TURN = 2 * std::numbers::pi;
    const double first = cone.turn_of(polygon(0, U), polygon(0, V)) / TURN;
    Range all = {0.0, 0.0};
    double at = 0.0;
    double last = first;
    for (int64_t p = 1; p <= n; p++) {
        const int64_t q = p < n ? p : 0;
        const double turn = cone.turn_of(polygon(q, U), polygon(q, V)) / TURN;
        at += turn - last - std::round(turn - last);
        last = turn;
        all.add(at);
    }
    if (!(all.most - all.least < WIDEST) || std::abs(at) > 0.25) return {0, WHOLE_TURN};
    return {int64_t(std::floor((first + all.least) * WHOLE_TURN)) - 1,
            int64_t(std::ceil((first + all.most) * WHOLE_TURN)) + 1};
}

// Area before the planes that touch an arc at its ends and in its middle, to that of the last
// alone.
constexpr double BETWEEN_TANGENTS = 0.75;

// Turn in radians.
inline double radians(double turn) { return turn * (2 * std::numbers::pi / WHOLE_TURN); }

// The flat side of a range of turns, and the plane that touches the cone in its middle.
inline Affine flat_side(int64_t start, int64_t end, const Cone &cone) {
    return cone.side(radians(0.5 * double(start + end)), radians(0.5 * double(end - start)));
}
inline Affine touching_side(int64_t start, int64_t end, const Cone &cone) {
    return cone.side(radians(0.5 * double(start + end)), 0.0);
}

// Part of a polygon beyond the flat side of a range of turns; its corner count.
inline int64_t beyond_side(Points part, int64_t n, int64_t start, int64_t end, const Cone &cone,
                           Points out) {
    Polygon memory;
    const Points spare = memory.points();
    int64_t m = keep_beyond(part, n, flat_side(start, end, cone), -1.0, out);
    if (m >= 3) m = keep_beyond(out, m, cone.beyond(radians(double(start))), 1.0, spare);
    if (m >= 3) m = keep_beyond(spare, m, cone.beyond(radians(double(end))), -1.0, out);
    return m;
}

// Mean width of a part along the flat side of a range of turns.
inline double mean_width(Points part, int64_t n, const Affine &flat) {
    const double slope = length2(flat.x, flat.y);
    const Affine along = {0.0, -flat.y / slope, flat.x / slope};
    const auto [least, most] = least_and_most(part, n, along);
    const double length = slope > 0 ? most - least : reach_of(part, n);
    return length > 0 ? std::max(twice_area(part, n) / 2, 0.0) / length : 0.0;
}

// Sides that a polygon across the cone is cut by at first, for a gap: if a few are enough, all.
inline Sides first_sides(Points part, int64_t n, int64_t start, int64_t end, const Cone &cone,
                         double gap) {
    Polygon one, other;
    const int64_t n_sides = end - start == WHOLE_TURN ? OF_WHOLE : 1;
    Sides each = {1, true};
    for (int64_t k = 0; k < n_sides; k++) {
        const int64_t begin = start + (end - start) * k / n_sides;
        const int64_t stop = start + (end - start) * (k + 1) / n_sides;
        int64_t m = beyond_side(part, n, begin, stop, cone, one.points());
        if (m >= 3)
            m = keep_beyond(one.points(), m, touching_side(begin, stop, cone), 1.0, other.points());
        if (m < 3) continue;
        const double width = mean_width(other.points(), m, flat_side(begin, stop, cone));
        const Sides wanted = sides_for(BETWEEN_TANGENTS * width / gap);
        each = {std::max(each.n, wanted.n), each.are_last && wanted.are_last};
    }
    return n_sides * each.n <= MOST_FLAT ? Sides{n_sides * each.n, each.are_last}
                                         : Sides{n_sides, false};
}

// Appends the parts of a polygon in or outside a cone, at one side of it; the rest that is
// undecided, beyond the flat side and before the plane that touches the cone, goes onto the stack.
inline void take_side(int64_t face, Points part, int64_t n, int64_t start, int64_t end,
                      const Cone &cone, Scratch &scratch, const Found &out) {
    Polygon one, other;
    const int64_t m = beyond_side(part, n, start, end, cone, one.points());
    if (m < 3) return;
    const Affine touching = touching_side(start, end, cone);
    const int64_t k = keep_beyond(one.points(), m, touching, 1.0, scratch.caps.next());
    if (k >= 3) scratch.caps.push(k, start, end);
    if (cone.is_convex) return;
    const int64_t n_outside = keep_beyond(one.points(), m, touching, -1.0, other.points());
    if (n_outside >= 3)
        append_piece(face, other.points(), n_outside, scratch.plane.nearest_corners(), out);
}

// Clips a part in place by planes that touch the cone, at the ends and in the middle of each of
// some sides of a range of turns; its corner count.
inline int64_t before_tangents(Points part, int64_t n, int64_t start, int64_t end, int64_t n_sides,
                               const Cone &cone) {
    Polygon memory;
    for (int64_t k = 0; k <= 2 * n_sides && n >= 3; k++) {
        const double turn = double(start) + double(end - start) * double(k) / double(2 * n_sides);
        const Line line = line_of(cone.side(radians(turn), 0.0), 1.0);
        n = exact::cut(part, n, line, memory.points());
    }
    return n;
}

// Clips a part in place by some flat sides of a range of turns; its corner count. `slope` becomes
// the least one of their lines.
inline int64_t within_sides(Points part, int64_t n, int64_t start, int64_t end, int64_t n_sides,
                            const Cone &cone, double &slope) {
    Polygon memory;
    slope = INF;
    for (int64_t k = 0; k < n_sides; k++) {
        const int64_t begin = start + (end - start) * k / n_sides;
        const int64_t stop = start + (end - start) * (k + 1) / n_sides;
        const Affine flat = flat_side(begin, stop, cone);
        slope = std::min(slope, length2(flat.x, flat.y));
        if (n >= 3) n = exact::cut(part, n, line_of(flat, 1.0), memory.points());
    }
    return n;
}

enum Place { WITHIN, OUTSIDE, ACROSS }; // of a polygon, of a cone

// Place of a convex polygon; ACROSS where that is not sure.
inline Place place_of(Points polygon, int64_t n, const Cone &cone) {
    double least = INF;
    double x = 0.0;
    double y = 0.0;
    for (int64_t p = 0; p < n; p++) {
        least = std::min(least, cone.within(polygon(p, U), polygon(p, V)));
        x += polygon(p, U) / double(n);
        y += polygon(p, V) / double(n);
    }
    const Affine towards = cone.side(cone.turn_of(x, y), 0.0);
    if (least_and_most(polygon, n, towards).most < -cone.error) return OUTSIDE;
    return least > cone.error ? WITHIN : ACROSS;
}

// Appends the valid part of a convex polygon. Parts next to the cone of a mean width below the gap
// go into the bound.
inline void append_within_cone(int64_t face, Points polygon, int64_t n, const Cone &cone,
                               double gap, Scratch &scratch, const Found &out) {
    const double nearest = scratch.plane.nearest_corners();
    if (const Place place = place_of(polygon, n, cone); place != ACROSS) {
        if (cone.is_convex == (place == WITHIN)) append_piece(face, polygon, n, nearest, out);
        return;
    }
    Stack &caps = scratch.caps;
    Polygon memory, inside, outside;
    const Points part = memory.points(), inner = inside.points(), outer = outside.points();
    // Rounding moves the sides that what is kept ends at.
    const auto rounding_of = [&](double slope, double around) {
        return slope > 0 ? cone.error / slope * around : 0.0;
    };
    caps.push_parts(polygon, n, 0, WHOLE_TURN);
    while (caps.top > 0) {
        const Stack::Entry &entry = caps.pop();
        const Span whole = {entry.one, entry.other};
        const bool is_first = whole.end - whole.start == WHOLE_TURN;
        n = entry.n;
        copy_polygon(caps.next(), n, part);
        const Span own = turns_of(part, n, cone);
        // Next to the axis rounding decides about turns; what is no narrower is not taken.
        const auto [start, end] = own.end - own.start <= whole.end - whole.start + 2 ? own : whole;
        const Affine side = flat_side(start, end, cone);
        const double around = perimeter_of(part, n);
        const double rounding = rounding_of(length2(side.x, side.y), around);
        if (!is_first && cone.is_convex) n = before_tangents(part, n, start, end, 1, cone);
        if (n < 3) {
            out.bound[face] += rounding;
            continue;
        }
        const double narrow = mean_width(part, n, side) / gap;
        if (!caps.has_room(MOST_FLAT) || n + 2 * MOST_FLAT + 2 > PIECE_ROOM ||
            (!is_first && (!(narrow > 1) || end - start < LEAST_TURN))) {
            out.bound[face] += std::max(twice_area(part, n) / 2, 0.0) + rounding;
            continue;
        }
        const auto [n_sides, are_last] =
            is_first ? first_sides(part, n, start, end, cone, gap) : sides_for(narrow);
        copy_polygon(part, n, inner);
        double least_slope = 0.0;
        const int64_t m = within_sides(inner, n, start, end, n_sides, cone, least_slope);
        if (m >= 3 && cone.is_convex) append_piece(face, inner, m, nearest, out);
        if (are_last && cone.is_convex) {
            // All that is undecided is between the sides and the planes that touch the cone.
            const double kept = m >= 3 ? twice_area(inner, m) / 2 : 0.0;
            copy_polygon(part, n, outer);
            const int64_t k = before_tangents(outer, n, start, end, n_sides, cone);
            const double left = k >= 3 ? std::max(twice_area(outer, k) / 2 - kept, 0.0) : 0.0;
            if (left <= gap * around / 2) {
                out.bound[face] += left + rounding_of(least_slope, around);
                continue;
            }
        }
        for (int64_t k = 0; k < n_sides; k++) {
            const int64_t begin = start + (end - start) * k / n_sides;
            const int64_t stop = start + (end - start) * (k + 1) / n_sides;
            take_side(face, part, n, begin, stop, cone, scratch, out);
        }
    }
}

} // namespace rastercov::area
