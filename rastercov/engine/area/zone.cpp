// Connected parts of a surface: convex pieces that share a part of their boundary.
//
// Pieces are the leaves of a forest of parents. Candidates come from sweeps over sorted intervals:
// pieces of a face along one direction of its plane, sides of pieces along the edge of the mesh
// that they lie on, and sides on open edges along one direction in space. No direction is that of
// an axis, along which built surfaces have many sides at one coordinate.
//
// Corners of piece i are rows starts[i] ... starts[i + 1] - 1 of `xy`.
//
// Twins: tests/area/test_zones.py.
#include "area/polygon.hpp"
#include "bind.hpp"
#include "exact/forest.hpp"
#include "interrupt.hpp"
#include "range.hpp"
#include <cmath>

namespace rastercov {
namespace area {
namespace {

using exact::join, exact::root_of;
using Corners = FloatRows<2>;
using Indices = IntArray;
using Faces = Int32Array; // of pieces
using Intervals = FloatRows<2>;
using Forest = Column<int64_t>;

constexpr auto STARTS = "starts must rise, within the corners, one row for each piece and one more";

// Length along which the side p q of one polygon and r s of another run within a tolerance. The
// sides are of two polygons that turn the same way, so that a common side has opposite directions.
double side_overlap(const Corners &xy, int64_t p, int64_t q, int64_t r, int64_t s,
                    double tolerance) {
    double x = xy(q, 0) - xy(p, 0), y = xy(q, 1) - xy(p, 1);
    const double length = std::sqrt(x * x + y * y);
    if (!(length > 0)) return 0.0;
    x /= length;
    y /= length;
    const double a = xy(r, 0) - xy(p, 0), b = xy(r, 1) - xy(p, 1);
    const double c = xy(s, 0) - xy(p, 0), d = xy(s, 1) - xy(p, 1);
    const double start = a * x + b * y, end = c * x + d * y;
    if (!(end < start)) return 0.0;
    const double off = b * x - a * y, off_end = d * x - c * y;
    // Part of r s whose distance from the line is within the tolerance, from 0 to 1.
    double first = 0.0;
    double last = 1.0;
    const double slope = off_end - off;
    if (std::abs(slope) > 0) {
        const double one = (-tolerance - off) / slope, other = (tolerance - off) / slope;
        first = std::max(first, std::min(one, other));
        last = std::min(last, std::max(one, other));
    } else if (std::abs(off) > tolerance) {
        return 0.0;
    }
    if (last <= first) return 0.0;
    const double high = start + first * (end - start), low = start + last * (end - start);
    return std::min(high, length) - std::max(low, 0.0);
}

// True if two convex pieces of a face share a part of their boundary longer than `least`.
bool are_adjacent(const Corners &xy, const Starts &starts, int64_t i, int64_t j, double tolerance,
                  double least) {
    for (int64_t p = starts[i]; p < starts[i + 1]; p++) {
        const int64_t q = p + 1 < starts[i + 1] ? p + 1 : starts[i];
        for (int64_t r = starts[j]; r < starts[j + 1]; r++) {
            const int64_t s = r + 1 < starts[j + 1] ? r + 1 : starts[j];
            if (side_overlap(xy, p, q, r, s, tolerance) > least) return true;
        }
    }
    return false;
}

// Links the pieces of each face that share a part of their boundary. `boxes` are least and greatest
// coordinates of each piece, u, u, v, v; `interval` its extent along the direction of the sweep;
// `order` the pieces by face, then by the start of their interval; `tolerance` and `least` the
// distance of lines that are one, and the length of contact from which pieces are connected, m.
void link_in_faces(const PieceTable &pieces, FloatRows<4> boxes, Intervals interval, Indices order,
                   double tolerance, double least, Forest parent) {
    const auto &[xy, starts, face] = pieces;
    const int64_t n = face.rows();
    require_starts(starts, n, xy.rows(), STARTS);
    require(have_rows(n, boxes, interval, parent),
            "face, boxes, interval and parent must have one row for each piece");
    require_indices(order, n, "order must hold pieces");
    require_indices(parent, n, "parent must hold pieces");
    Poll poll(64);
    for (int64_t a = 0; a < order.rows(); a++) {
        poll();
        const int64_t i = order[a];
        for (int64_t b = a + 1; b < order.rows(); b++) {
            const int64_t j = order[b];
            if (face[j] != face[i] || interval(j, 0) > interval(i, 1) + tolerance) break;
            if (boxes(j, 0) > boxes(i, 1) + tolerance || boxes(i, 0) > boxes(j, 1) + tolerance ||
                boxes(j, 2) > boxes(i, 3) + tolerance || boxes(i, 2) > boxes(j, 3) + tolerance ||
                root_of(parent, i) == root_of(parent, j))
                continue;
            if (are_adjacent(xy, starts, i, j, tolerance, least)) join(i, j, parent);
        }
    }
}

// Links the pieces of different faces whose sides overlap on an edge of the mesh. Sides are sorted
// by edge, then by the start of their interval along it.
void link_along_edges(Indices edge, Intervals interval, Indices piece, Faces face, double least,
                      Forest parent) {
    const int64_t n = edge.rows();
    require(have_rows(n, interval, piece) && face.rows() == parent.rows(),
            "edge, interval and piece must have one row for each side, face one for each piece");
    require_indices(piece, parent.rows(), "piece must hold pieces");
    require_indices(parent, parent.rows(), "parent must hold pieces");
    Poll poll(64);
    for (int64_t a = 0; a < n; a++)
        for (int64_t b = (poll(), a + 1); b < n; b++) {
            if (edge[b] != edge[a] || interval(b, 0) > interval(a, 1) - least) break;
            if (face[piece[a]] != face[piece[b]] && interval(b, 1) > interval(b, 0) + least)
                join(piece[a], piece[b], parent);
        }
}

using Segments = FloatRows<2, 3>;

// Length along which two segments run within a tolerance.
double overlap_in_space(const Segments &ends, int64_t a, int64_t b, double tolerance) {
    double x = ends(a, 1, 0) - ends(a, 0, 0), y = ends(a, 1, 1) - ends(a, 0, 1);
    double z = ends(a, 1, 2) - ends(a, 0, 2);
    const double length = std::sqrt(x * x + y * y + z * z);
    if (!(length > 0)) return 0.0;
    x /= length;
    y /= length;
    z /= length;
    Range all;
    for (int k = 0; k < 2; k++) {
        double u = ends(b, k, 0) - ends(a, 0, 0), v = ends(b, k, 1) - ends(a, 0, 1);
        double w = ends(b, k, 2) - ends(a, 0, 2);
        const double along = u * x + v * y + w * z;
        u -= along * x;
        v -= along * y;
        w -= along * z;
        if (u * u + v * v + w * w > tolerance * tolerance) return 0.0;
        all.add(along);
    }
    return std::min(all.most, length) - std::max(all.least, 0.0);
}

// Links the pieces of different faces whose sides overlap, sorted by the start of `interval`.
void link_in_space(Segments ends, Intervals interval, Indices piece, Faces face, double tolerance,
                   double least, Forest parent) {
    const int64_t n = piece.rows();
    require(have_rows(n, ends, interval) && face.rows() == parent.rows(),
            "ends, interval and piece must have one row for each side, face one for each piece");
    require_indices(piece, parent.rows(), "piece must hold pieces");
    require_indices(parent, parent.rows(), "parent must hold pieces");
    const auto are_apart = [&](int64_t a, int64_t b, int k) {
        const auto [low, high] = std::minmax({ends(a, 0, k), ends(a, 1, k)});
        const auto [first, last] = std::minmax({ends(b, 0, k), ends(b, 1, k)});
        return first > high + tolerance || low > last + tolerance;
    };
    Poll poll(64);
    for (int64_t a = 0; a < n; a++)
        for (int64_t b = (poll(), a + 1); b < n; b++) {
            if (interval(b, 0) > interval(a, 1) + tolerance) break;
            if (face[piece[a]] == face[piece[b]] ||
                root_of(parent, piece[a]) == root_of(parent, piece[b]))
                continue;
            if (are_apart(a, b, 0) || are_apart(a, b, 1) || are_apart(a, b, 2)) continue;
            if (overlap_in_space(ends, a, b, tolerance) > least ||
                overlap_in_space(ends, b, a, tolerance) > least)
                join(piece[a], piece[b], parent);
        }
}

// Side of its face, 0 to 2 or -1, on which each side of each piece lies.
void find_sides(Corners xy, Starts starts, Faces face, FloatRows<3, 2> corners, double tolerance,
                Column<int64_t> side) {
    require_starts(starts, face.rows(), xy.rows(), STARTS);
    require(side.rows() == xy.rows(), "side must have one row for each corner");
    require_indices(face, corners.rows(), "face must hold rows of corners");
    for (int64_t i = 0; i < face.rows(); i++) {
        const auto triangle = corners[face[i]];
        for (int64_t p = starts[i]; p < starts[i + 1]; p++) {
            const int64_t q = p + 1 < starts[i + 1] ? p + 1 : starts[i];
            side[p] = -1;
            for (int k = 0; k < 3; k++) {
                const int m = k < 2 ? k + 1 : 0;
                const double x = triangle(m, 0) - triangle(k, 0),
                             y = triangle(m, 1) - triangle(k, 1);
                const double length = std::sqrt(x * x + y * y);
                if (!(length > 0)) continue;
                const auto distance = [&](int64_t c) {
                    const double u = xy(c, 0) - triangle(k, 0), v = xy(c, 1) - triangle(k, 1);
                    return std::abs(x * v - y * u) / length;
                };
                if (distance(p) <= tolerance && distance(q) <= tolerance) side[p] = k;
            }
        }
    }
}

// Root of each piece.
void find_roots(Forest parent, Column<int64_t> root) {
    require(root.rows() == parent.rows(), "root must have one row for each piece");
    require_indices(parent, parent.rows(), "parent must hold pieces");
    for (int64_t i = 0; i < parent.rows(); i++) root[i] = root_of(parent, i);
}

} // namespace
} // namespace area

void register_area_zone(nanobind::module_ &m) {
    using namespace area;
    def(m, "link_in_faces", link_in_faces, "Link the pieces of each face that share a boundary.",
        "pieces", "boxes", "interval", "order", "tolerance", "least", "parent");
    def(m, "link_along_edges", link_along_edges,
        "Link the pieces of different faces whose sides overlap on an edge.", "edge", "interval",
        "piece", "face", "least", "parent");
    def(m, "link_in_space", link_in_space,
        "Link the pieces of different faces whose sides overlap in space.", "ends", "interval",
        "piece", "face", "tolerance", "least", "parent");
    def(m, "find_sides", find_sides, "Side of its face on which each side of each piece lies.",
        "xy", "starts", "face", "corners", "tolerance", "side");
    def(m, "find_roots", find_roots, "Root of each piece.", "parent", "root");
}

} // namespace rastercov
