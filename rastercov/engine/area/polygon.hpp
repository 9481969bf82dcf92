// Convex polygons in the plane of a face: corners that are needed, outlines, parts of few corners.
//
// A polygon is counter-clockwise in the plane of its face, which exact/polygon.hpp calls clockwise:
// there v points down. Piece i of a table has the corners starts[i] ... starts[i + 1] - 1.
//
// Twins: rastercov.reference.polygons.
#pragma once
#include "exact/polygon.hpp"

namespace rastercov {
namespace area {

using exact::copy_polygon, exact::twice_area;
using exact::Line, exact::PIECE_ROOM, exact::Points, exact::U, exact::V;
using Starts = IntArray;

// Distance, relative to the longest edge of the face, below which two corners are one: the side
// between them would have no direction.
constexpr double COINCIDENT_REL = 1e-12;

inline double length2(double x, double y) { return std::sqrt(x * x + y * y); }

// Length of the outline of a polygon.
template <class Source> double perimeter_of(const Source &polygon, int64_t n) {
    double total = 0.0;
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = p + 1 < n ? p + 1 : 0;
        total += length2(polygon(q, U) - polygon(p, U), polygon(q, V) - polygon(p, V));
    }
    return total;
}

// Copies a polygon without corners that rounding may have put anywhere; returns their count.
//
// These are corners no farther than `nearest` from the one before, or from the line through both
// neighbours: a short side that continues a long one has a direction of few digits, and beyond its
// line may lie corners of the polygon itself.
template <class Source>
int64_t without_needless(const Source &polygon, int64_t n, double nearest, Points out) {
    int64_t kept = 0;
    const auto is_apart = [&](double u, double v, int64_t q) {
        return std::max(std::abs(u - out(q, U)), std::abs(v - out(q, V))) > nearest;
    };
    for (int64_t p = 0; p < n; p++)
        if (kept == 0 || is_apart(polygon(p, U), polygon(p, V), kept - 1)) {
            out(kept, U) = polygon(p, U);
            out(kept, V) = polygon(p, V);
            kept++;
        }
    while (kept > 1 && !is_apart(out(0, U), out(0, V), kept - 1)) kept--;
    if (kept <= 3) return kept;
    n = kept;
    kept = 0;
    for (int64_t p = 0; p < n; p++) {
        if (kept + n - p > 3) {
            const int64_t before = kept > 0 ? kept - 1 : n - 1, after = p + 1 < n ? p + 1 : 0;
            const double x = out(after, U) - out(before, U), y = out(after, V) - out(before, V);
            const double away = (out(p, V) - out(before, V)) * x - (out(p, U) - out(before, U)) * y;
            if (std::abs(away) <= nearest * length2(x, y)) continue;
        }
        out(kept, U) = out(p, U);
        out(kept, V) = out(p, V);
        kept++;
    }
    return kept;
}

// Corners of piece `at` of a table of `n_corners` corners; ValueError for more than a polygon has
// room for.
inline int64_t corners_of(int64_t at, const Starts &starts, int64_t n_corners) {
    require(starts[at] >= 0 && starts[at] <= starts[at + 1] && starts[at + 1] <= n_corners &&
                starts[at + 1] - starts[at] >= 3 && starts[at + 1] - starts[at] <= PIECE_ROOM,
            "pieces must have 3 to 64 corners, within xy");
    return starts[at + 1] - starts[at];
}

// True if a point lies in a convex polygon, or beyond a side by `slack` at most.
inline bool is_inside(double x, double y, const double *corners, int64_t n, double slack) {
    int64_t p = n - 1;
    for (int64_t q = 0; q < n; p = q++) {
        const double along_x = corners[2 * q] - corners[2 * p];
        const double along_y = corners[2 * q + 1] - corners[2 * p + 1];
        const double value = along_x * (y - corners[2 * p + 1]) - along_y * (x - corners[2 * p]);
        if (value < -slack * (std::abs(along_x) + std::abs(along_y))) return false;
    }
    return true;
}

// A table of pieces, of corners in the planes of their faces.
struct PieceTable {
    FloatRows<2> xy;
    Starts starts;
    Int32Array face;
};

// A piece of a table.
inline FloatRows<2> piece_at(int64_t at, const Starts &starts, const FloatRows<2> &xy) {
    const int64_t n = corners_of(at, starts, xy.rows());
    return {xy.data + 2 * starts[at], {n, 2}};
}

} // namespace area

RECORD(area::PieceTable, xy, starts, face);

} // namespace rastercov
