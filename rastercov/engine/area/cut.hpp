// Pieces where a smooth criterion g >= 0 holds: kept, dropped, or, in a thin band, undecided.
//
// Within r of the centre c of a piece, |g(p) - g(c) - g'(c) (p - c)| <= doubt, such as K r^2 / 2
// with K >= |g''| there. So the half plane where the linear part is at least the doubt is kept,
// that where it is below minus the doubt dropped; the band between is halved across its longest
// extent until its mean width is below `width`. All parts of one depth come before their halves, so
// that what is left at MOST_CUTS, which is counted apart, is thin.
//
// A criterion, see area/criteria.hpp, says what g is at a point of the plane of a face:
//
//   Value at(x, y, r)  value, slopes along the axes of the plane, and the doubt within r of it
//
// Invariants: parts have 3 to PIECE_ROOM - 2 corners; no more than MOST_CUTS parts of a piece are
// looked at, and what is left then is undecided, so that every call ends.
//
// Twin: tests/area/test_point_criteria.py, by points.
#pragma once
#include "area/polygon.hpp"
#include "interrupt.hpp"
#include "vector.hpp"
#include <array>
#include <vector>

namespace rastercov::area::smooth {

constexpr int64_t MOST_CUTS = 1 << 18;

using rastercov::cross, rastercov::dot, rastercov::minus;
using Vector = Coordinates;

struct Value {
    double value, along_x, along_y, doubt;
};

inline double length_between(const Vector &a, const Vector &b) {
    return exact::length(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

// The plane of a face.
struct Plane {
    Vector origin, x_axis, y_axis;
    Vector point(double x, double y) const {
        Vector p;
        for (int k = 0; k < 3; k++) p[k] = origin[k] + x * x_axis[k] + y * y_axis[k];
        return p;
    }
    Vector normal() const { return cross(x_axis, y_axis); }
};

// Area of what is undecided, and the part of it that is so because cuts ended, m^2.
struct Undecided {
    double area, cut_short;
};

// Cuts pieces one by one; memory is kept from piece to piece.
class Cutter {
  public:
    // Calls keep(polygon, n) for each part of a convex piece, of at most PIECE_ROOM - 2 corners,
    // where a criterion holds for certain.
    template <class Criterion, class Keep>
    Undecided cut(const FloatRows<2> &piece, const Criterion &g, double width, Keep keep) {
        halves.clear();
        push(piece, piece.rows());
        Undecided undecided = {0.0, 0.0};
        for (int64_t cuts = 0; !(parts.empty() && halves.empty()); cuts++) {
            poll();
            if (parts.empty()) std::swap(parts, halves);
            Part part = parts.back();
            parts.pop_back();
            const Points corners = part.corners();
            const double area = twice_area(corners, part.n) / 2;
            if (!(area > 0)) continue;
            const exact::Bounds box = exact::extent_of(corners, part.n);
            const double x = (box.u_min + box.u_max) / 2, y = (box.v_min + box.v_max) / 2;
            double r = 0.0;
            for (int64_t p = 0; p < part.n; p++)
                r = std::max(r, length2(corners(p, U) - x, corners(p, V) - y));
            const Value here = g.at(x, y, r);
            const double doubt = here.doubt;
            const auto linear = [&](int64_t p) {
                return here.value + here.along_x * (corners(p, U) - x) +
                       here.along_y * (corners(p, V) - y);
            };
            Range all = {linear(0), linear(0)};
            for (int64_t p = 1; p < part.n; p++) all.add(linear(p));
            const auto [low, high] = all;
            if (low >= doubt) {
                keep(corners, part.n);
                continue;
            }
            if (high < -doubt) continue;
            const bool is_thin = !(area > width * 2 * r);
            if (is_thin || cuts >= MOST_CUTS) {
                undecided.area += area;
                if (!is_thin) undecided.cut_short += area;
                continue;
            }
            if (std::isfinite(doubt) && low < high) {
                // As lines whose inner side is where value + slope . (p - c) + offset >= 0.
                const Line kept = {x, y, here.along_y, -here.along_x, here.value - doubt};
                const Line dropped = {x, y, here.along_y, -here.along_x, here.value + doubt};
                const int64_t n = exact::keep_inside(corners, part.n, kept, spare_points());
                if (n >= 3) keep(spare_points(), n);
                if (!take(part, outside(kept)) || !take(part, dropped)) continue;
            }
            halve(part);
        }
        return undecided;
    }

  private:
    struct Part {
        std::array<double, PIECE_ROOM * 2> xy;
        int64_t n;
        Points corners() { return {xy.data(), {PIECE_ROOM, 2}}; }
    };
    std::vector<Part> parts, halves; // of one depth, and of the next
    Poll poll{64};
    std::array<double, PIECE_ROOM * 2> spare;

    Points spare_points() { return {spare.data(), {PIECE_ROOM, 2}}; }

    // The other side of a line.
    static Line outside(const Line &line) {
        return {line.u0, line.v0, -line.du, -line.dv, -line.offset};
    }

    // Clips a part; false where nothing is left.
    bool take(Part &part, const Line &line) {
        part.n = exact::keep_inside(part.corners(), part.n, line, spare_points());
        copy_polygon(spare_points(), part.n, part.corners());
        return part.n >= 3;
    }

    // Adds a polygon to the halves, in parts of at most MOST_CORNERS corners.
    template <class Source> void push(const Source &polygon, int64_t n) {
        for (int64_t first = 1; first + 1 < n;) {
            halves.emplace_back();
            const int64_t m = exact::corners_of_part(first, n);
            exact::copy_part(polygon, first, m, halves.back().corners());
            halves.back().n = m;
            first += m - 2;
        }
    }

    // Adds both halves of a part, divided across its longest extent.
    void halve(Part &part) {
        const Points corners = part.corners();
        double most = -1.0;
        double x = 0.0;
        double y = 0.0;
        double u = 0.0;
        double v = 0.0;
        for (int64_t p = 0; p < part.n; p++)
            for (int64_t q = 0; q < p; q++) {
                const double du = corners(p, U) - corners(q, U);
                const double dv = corners(p, V) - corners(q, V);
                if (du * du + dv * dv <= most) continue;
                most = du * du + dv * dv;
                x = du;
                y = dv;
                u = (corners(p, U) + corners(q, U)) / 2;
                v = (corners(p, V) + corners(q, V)) / 2;
            }
        const Line middle = {u, v, y, -x, 0.0};
        for (const Line &line : {middle, outside(middle)}) {
            const int64_t n = exact::keep_inside(corners, part.n, line, spare_points());
            if (n >= 3) push(spare_points(), n);
        }
    }
};

// Cuts a piece, and calls keep(polygon, n) for its parts without needless corners: halving leaves
// some that coincide, whose sides have no direction. What is lost with them is undecided, too.
template <class Criterion, class Keep>
Undecided cut_tidily(Cutter &cutter, const FloatRows<2> &piece, const Criterion &g, double width,
                     double nearest, Keep keep) {
    std::array<double, PIECE_ROOM * 2> room;
    const Points tidy = {room.data(), {PIECE_ROOM, 2}};
    double lost = 0.0;
    Undecided found = cutter.cut(piece, g, width, [&](Points polygon, int64_t n) {
        const double area = twice_area(polygon, n) / 2;
        const int64_t kept = without_needless(polygon, n, nearest, tidy);
        const double left = kept >= 3 ? twice_area(tidy, kept) / 2 : 0.0;
        if (left > 0) keep(tidy, kept);
        lost += std::abs(area - std::max(left, 0.0));
    });
    found.area += lost;
    return found;
}

// Calls take(polygon, n) for the parts of few corners of a polygon.
template <class Take> void each_part(Points polygon, int64_t n, Take take) {
    std::array<double, PIECE_ROOM * 2> room;
    const Points part = {room.data(), {PIECE_ROOM, 2}};
    for (int64_t first = 1; first + 1 < n;) {
        const int64_t m = exact::corners_of_part(first, n);
        exact::copy_part(polygon, first, m, part);
        take(part, m);
        first += m - 2;
    }
}

} // namespace rastercov::area::smooth
