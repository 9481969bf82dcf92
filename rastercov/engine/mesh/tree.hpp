// Tree of boxes over triangles, and the segment that it is asked about.
//
// The triangles lie in the order of a Morton curve. A complete binary tree over that order has
// their boxes: node n has the children 2n and 2n + 1, the last L nodes are the leaves, of LEAF
// triangles each. A box is six numbers: the lowest coordinates, then the highest ones negated, so
// that a union is one minimum; an empty box is six times inf. Node 0 is not used.
//
// G. M. Morton. A Computer Oriented Geodetic Data Base. 1966, for the curve.
// A. Kensler and P. Shirley. Optimizing Ray-Triangle Intersection via Automated Search. 2006, for
// the signs of volumes. S. Woop et al. Watertight Ray/Triangle Intersection. 2013, for equal
// arithmetic on both sides of an edge.
//
// Invariant: a line through an edge or a corner that faces share passes between none of them. Each
// volume is computed from the same numbers in the same order for both faces of an edge, up to sign.
//
// Twin: tests/mesh/test_triangle_tree.py asks single triangles.
#pragma once
#include "array.hpp"
#include "vector.hpp"
#include <algorithm>
#include <cmath>
#include <limits>

namespace rastercov::mesh {

using Points = FloatRows<3>;
using Corners = FloatRows<3, 3>; // of triangles in the order of the tree
using Nodes = FloatRows<6>;
using Point = Array<const double, 3>;

constexpr double INF = std::numeric_limits<double>::infinity();
constexpr int64_t LEAF = 4;        // triangles of a leaf
constexpr int64_t STACK_SIZE = 64; // nodes of a query: at most one for each level of the tree
// Rounding of a volume in a scene of diagonal 1: no line through a vertex passes between faces.
constexpr double VOLUME_TOLERANCE = 1e-15;
constexpr double LEAST_STEP = 1e-12; // least component of a direction in the test of a box
// Growth of boxes on each side, for a segment of length 0 and again for each unit of its length:
// more than rounding and LEAST_STEP move a point.
constexpr double BOX_MARGIN = 1e-11;

struct Segment {
    Vector start, along; // along: a unit vector
    double reach;        // its length
};

inline double least(double a, double b, double c) { return std::min(a, std::min(b, c)); }
inline double greatest(double a, double b, double c) { return std::max(a, std::max(b, c)); }

inline void require_tree(Corners corners, Nodes nodes) {
    require(nodes.rows() >= 2 && corners.rows() <= nodes.rows() / 2 * LEAF,
            "nodes must have two rows for each leaf, of 4 triangles");
}

// Triple product d . (p x q): its sign is the side of edge p q on which direction d passes.
// Swapping p and q changes the sign and no other bit: two faces agree about their edge.
inline double volume(Vector d, Vector p, Vector q) {
    return d.x * (p.y * q.z - p.z * q.y) + d.y * (p.z * q.x - p.x * q.z) +
           d.z * (p.x * q.y - p.y * q.x);
}

// Distance along a segment to triangle t, or to its edges; -1 for none, and edge-on.
inline double distance_to(Corners corners, int64_t t, const Segment &s) {
    const auto corner = [&](int k) -> Vector {
        return {corners(t, k, 0) - s.start.x, corners(t, k, 1) - s.start.y,
                corners(t, k, 2) - s.start.z};
    };
    const Vector a = corner(0), b = corner(1), c = corner(2);
    const double u = volume(s.along, b, c), v = volume(s.along, c, a), w = volume(s.along, a, b);
    // Both true: the line passes outside. Both false: all volumes are rounding, edge-on.
    if ((least(u, v, w) < -VOLUME_TOLERANCE) == (greatest(u, v, w) > VOLUME_TOLERANCE)) return -1.0;
    const double total = u + v + w;
    double along = (u * a.x + v * b.x + w * c.x) / total * s.along.x;
    along += (u * a.y + v * b.y + w * c.y) / total * s.along.y;
    along += (u * a.z + v * b.z + w * c.z) / total * s.along.z;
    return along;
}

// Calls with the triangles below nodes that `is_met`, one after another, until a call is false.
template <class IsMet, class Each>
void each_met(Nodes nodes, int64_t n_triangles, IsMet is_met, Each each) {
    const int64_t leaves = nodes.rows() / 2;
    int64_t stack[STACK_SIZE] = {1};
    for (int64_t depth = 1; depth;) {
        const int64_t node = stack[--depth];
        if (!is_met(node)) continue;
        if (node < leaves) {
            stack[depth++] = 2 * node;
            stack[depth++] = 2 * node + 1;
            continue;
        }
        const int64_t begin = (node - leaves) * LEAF;
        for (int64_t t = begin; t < std::min(begin + LEAF, n_triangles); t++)
            if (!each(t)) return;
    }
}

// Triangle that a segment meets, other than `own`: the nearest, which takes longer, or any; -1 for
// none. In a scene of diagonal 1 about the origin.
[[gnu::noinline]] inline int64_t hit_of(Segment s, int64_t own, bool is_nearest, Corners corners,
                                        Nodes nodes) {
    const double margin = BOX_MARGIN * (1.0 + s.reach);
    // A direction along an axis has no reciprocal; boxes are grown by more than this moves a point.
    const auto inverse = [](double d) { return 1.0 / (std::abs(d) > LEAST_STEP ? d : LEAST_STEP); };
    const double start[3] = {s.start.x, s.start.y, s.start.z};
    const double inverses[3] = {inverse(s.along.x), inverse(s.along.y), inverse(s.along.z)};
    int64_t hit = -1;
    const auto is_met = [&](int64_t node) {
        if (nodes(node, 0) == INF) return false; // an empty box
        double first = -INF;
        double last = INF;
        for (int k = 0; k < 3; k++) {
            const double low = (nodes(node, k) - margin - start[k]) * inverses[k];
            const double high = (margin - nodes(node, 3 + k) - start[k]) * inverses[k];
            first = std::max(first, std::min(low, high));
            last = std::min(last, std::max(low, high));
        }
        return !(first > last || first > s.reach || last < 0.0);
    };
    each_met(nodes, corners.rows(), is_met, [&](int64_t t) {
        if (t == own) return true;
        const double along = distance_to(corners, t, s);
        if (!(0.0 <= along && along <= s.reach)) return true;
        hit = t;
        s.reach = along;
        return is_nearest;
    });
    return hit;
}

// Triangles that segments meet: what was hit before is often near the next one, too.
struct Hits {
    Corners corners;
    Nodes nodes;
    bool is_nearest;
    int64_t last = -1;

    int64_t first(Segment s, int64_t own) {
        int64_t hit = -1;
        if (last >= 0 && last != own) {
            const double along = distance_to(corners, last, s);
            if (0.0 <= along && along <= s.reach) {
                s.reach = along;
                hit = last;
            }
        }
        if (is_nearest || hit < 0) hit = hit_of(s, own, is_nearest, corners, nodes);
        if (hit >= 0) last = hit;
        return hit;
    }
};

} // namespace rastercov::mesh
