// Areas of polygons of an ideal plane in the image of a lens, edge by edge.
//
// The area of a polygon's image is the closed integral of u dv along its border, by Green's
// theorem. The part of it inside the image, 0 <= u <= W and 0 <= v <= H, is that of
// clamp(u, 0, W) d clamp(v, 0, H), because the clamped border encloses that part and pieces of no
// area. So each edge is integrated by itself: no curve is ever cut by another.
//
// Edges are evaluated at points that depend on the edge alone and not on its direction, so that two
// polygons that share one agree on it to the last bits.
//
// Invariants: nothing allocates; every search ends for any content.
//
// Twins: tests/lenses/test_quadrature.py, tests/lenses/test_areas.py by polygons of many corners.
#pragma once
#include "lens/planes.hpp"
#include "lens/rules.hpp"
#include "range.hpp"
#include "sort.hpp"
#include <tuple>

namespace rastercov::lens {

// Pixels: a coordinate that stays this near to a border is taken to be on one side of it.
constexpr double FLAT = 1e-10;
// Error of the place of a root, in lengths of its part, and steps of the search for it: one in four
// is a bisection.
constexpr double ROOT_TOLERANCE = 1e-15;
constexpr int MOST_STEPS = 240;
// Steps from the root of a polynomial to that of the lens, and the part of the edge along which its
// slope is found; the root is not moved by more.
constexpr int CORRECTIONS = 3;
constexpr double SECANT = 0x1p-10;
constexpr double CROSSED = 1e-11; // pixels: a coordinate that is this near to a border is on it
// Rounding of a polynomial relative to its coefficients: less is 0.
constexpr double ROUNDING_REL = 0x1p-50;
// Halvings of an edge in the search for a root, and of one that meets a pole.
constexpr int64_t DEEPEST = 48;
constexpr int64_t MOST_CUTS = 12 * MOST;
constexpr int64_t NODE_ROOM = (MOST + GROUP) / GROUP * GROUP; // for the nodes of an edge
constexpr int64_t MOST_EDGE_PARTS = 1 << 18;                  // no edge of a region needs as many
// Parts of an edge that wait to be halved, on a plane with a pole.
constexpr int64_t MOST_WAITING = 64;
// Nodes of a polygon that are projected together, and edges and parts of them that these are of.
constexpr int64_t MOST_NODES = 512, MOST_PARTS = 128;
// Kinds of the cuts of an edge: an end of it, a border crossed by u, one crossed by v.
enum CutKind : int64_t { NO_LEVEL, LEVEL_U, LEVEL_V };

// A line from (ax, ay) to (bx, by); or, where `border` is a plane, an arc along the border of the
// valid region in it, from the turn ax to the turn bx.
struct Edge {
    double ax, ay, bx, by;
    const PlaneRecord *border = nullptr;
};

// Place where an edge is cut, 0 to 1.
struct Cut {
    double place;
    CutKind kind;
};

// Scratch for one edge, and for the parts of all edges of a polygon: they have `ends` and `rules`,
// and all nodes in x ... v; the last of a part is the first of the next.
struct EdgeScratch {
    double U[NODE_ROOM], V[NODE_ROOM], spare[NODE_ROOM], stack[DEEPEST + 2][MOST + 1],
        low[DEEPEST + 2][2];
    Cut cuts[MOST_CUTS];
    double waiting[MOST_WAITING][2];
    double x[MOST_NODES + GROUP], y[MOST_NODES + GROUP], u[MOST_NODES + GROUP],
        v[MOST_NODES + GROUP];
    Edge ends[MOST_PARTS];
    int64_t rules[MOST_PARTS];
};

// Point of an edge with the weights s and t of its ends.
inline Point<double> point_of(const Edge &edge, double s, double t) {
    if (edge.border) return border_point(*edge.border, s * edge.ax + t * edge.bx);
    return {s * edge.ax + t * edge.bx, s * edge.ay + t * edge.by};
}

// Node k of the n + 1 nodes of an edge.
inline Point<double> node_of(const Edge &edge, int64_t n, int64_t k) {
    return point_of(edge, NODES[n][n - k], NODES[n][k]);
}

// Part of an edge from one place to another one, 0 to 1.
inline Edge part_of_edge(const Edge &edge, double start, double end) {
    const double turn = edge.bx - edge.ax;
    if (edge.border) return {edge.ax + start * turn, 0.0, edge.ax + end * turn, 0.0, edge.border};
    const auto a = point_of(edge, 1.0 - start, start), b = point_of(edge, 1.0 - end, end);
    return {a.x, a.y, b.x, b.y};
}

inline double length2_of(const Edge &edge) {
    return (edge.bx - edge.ax) * (edge.bx - edge.ax) + (edge.by - edge.ay) * (edge.by - edge.ay);
}

// Distance, px, by which the image of an edge leaves its chord at most.
inline double stray_of(const PlaneRecord &plane, const Edge &edge) {
    return (edge.border ? plane.arc_bend : plane.bend) * length2_of(edge) / 8;
}

// Pixel (u, v) of node k of the n + 1 nodes of an edge.
inline Pixel<double> node_value(const PlaneRecord &plane, const Edge &edge, int64_t n, int64_t k) {
    const auto [x, y] = node_of(edge, n, k);
    return plane_value(plane, x, y);
}

// Fills scratch.U and scratch.V with the pixels of the n + 1 nodes of an edge.
inline void values_together(const PlaneRecord &plane, const Edge &edge, int64_t n,
                            EdgeScratch &scratch) {
    double x[NODE_ROOM], y[NODE_ROOM];
    for (int64_t k = 0; k < NODE_ROOM; k++) {
        const auto point = node_of(edge, n, std::min(k, n));
        x[k] = point.x;
        y[k] = point.y;
    }
    project_lanes(plane, x, y, n + 1, scratch.U, scratch.V);
}

// Signed area between the image of an edge and its chord, px^2, from values at its nodes.
inline double bulge(int64_t n, const double *U, const double *V) {
    double total = 0.0;
    const double u0 = U[0], v0 = V[0];
    for (int64_t i = 2; i <= n; i++) {
        const double u = U[i] - u0, v = V[i] - v0;
        for (int64_t j = 1; j < i; j++)
            total += WEIGHTS[n][i][j] * (u * (V[j] - v0) - (U[j] - u0) * v);
    }
    return total;
}

// Integral of (u - u0) dv along the image of an edge, px^2, from values at its nodes.
inline double under_edge(int64_t n, const double *U, const double *V, double u0) {
    return 0.5 * ((U[0] - u0) + (U[n] - u0)) * (V[n] - V[0]) + bulge(n, U, V);
}

// Rule for an edge of a half length, and the number of its parts.
struct EdgeRule {
    int64_t n, parts;
};
template <class Longest> EdgeRule nodes_for(double half, const Longest &longest, int64_t parts_of) {
    for (int64_t n = FEWEST; n <= MOST; n++)
        if (half <= longest[n]) return {n, 1};
    const double parts = std::ceil(half / longest[parts_of]);
    // A table that is none may have any sign.
    const bool is_few = 1.0 <= parts && parts < double(MOST_EDGE_PARTS);
    return {parts_of, is_few ? int64_t(parts) : MOST_EDGE_PARTS};
}

// Fills Bernstein coefficients of the polynomial through values at the nodes, less a level.
inline void bernstein_of(int64_t n, const double *values, double level, double *coefficients) {
    for (int64_t k = 0; k <= n; k++) {
        double total = 0.0;
        for (int64_t j = 0; j <= n; j++) total += BERNSTEIN[n][k][j] * (values[j] - level);
        coefficients[k] = total;
    }
}

// False where an edge with values at its nodes cannot take a level: neither can the polynomial
// through them, nor an arc between two nodes, which leaves its chord by the stray at most.
inline bool may_cross(int64_t n, const double *values, double level, double stray) {
    Range all = {values[0], values[0]};
    for (int64_t k = 1; k <= n; k++) all.add(values[k]);
    const auto [low, high] = all;
    if (low - stray > level || high + stray < level) return false;
    return std::abs(level - 0.5 * (low + high)) <= GROWTH[n] * 0.5 * (high - low);
}

// Changes of sign along coefficients, and the largest of these.
struct Changes {
    int64_t count;
    double largest;
};
inline Changes changes_of(int64_t n, const double *row) {
    Changes all = {0, 0.0};
    double last = 0.0;
    for (int64_t k = 0; k <= n; k++) {
        const double c = row[k];
        all.largest = std::max(all.largest, std::abs(c));
        if (c == 0.0) continue;
        all.count += last != 0.0 && (c > 0.0) != (last > 0.0);
        last = c;
    }
    return all;
}

// Root of a polynomial that changes its sign once, by Newton's method within bisections.
inline double only_root(int64_t n, const double *row, double *spare) {
    double a = 0.0;
    double b = 1.0;
    const bool is_up = row[0] < 0.0;
    const double largest = changes_of(n, row).largest;
    double t = row[0] / (row[0] - row[n]);
    for (int step = 0; step < MOST_STEPS; step++) {
        // The polynomial and its derivative at t, by de Casteljau.
        for (int64_t k = 0; k <= n; k++) spare[k] = row[k];
        for (int64_t r = 1; r < n; r++)
            for (int64_t k = 0; k <= n - r; k++) spare[k] += t * (spare[k + 1] - spare[k]);
        const double change = spare[1] - spare[0];
        const double f = spare[0] + t * change, slope = double(n) * change;
        if (std::abs(f) <= ROUNDING_REL * largest) return t;
        ((f < 0.0) == is_up ? a : b) = t;
        double following = t - f / slope;
        if (step % 4 == 3 || !(a < following && following < b)) following = 0.5 * (a + b);
        if (b - a < ROOT_TOLERANCE) break;
        t = following;
    }
    return 0.5 * (a + b);
}

// Appends the places in (0, 1) where a polynomial in Bernstein form changes its sign.
//
// Coefficients are in scratch.stack[0]. By Descartes' rule a part whose coefficients change their
// sign once has one root, one where they do not has none; others are halved, until they are next to
// 0. An edge that is next to 0 from end to end has no root. Returns the new count.
inline int64_t roots(int64_t n, EdgeScratch &scratch, CutKind kind, int64_t count) {
    const auto &[stack, low] = std::tie(scratch.stack, scratch.low);
    const auto append = [&](double place) {
        if (count < MOST_CUTS - 1) scratch.cuts[count++] = {place, kind};
    };
    int64_t top = 1;
    low[0][0] = 0.0;
    low[0][1] = 1.0;
    while (top > 0) {
        top--;
        double *const row = stack[top];
        const double start = low[top][0], length = low[top][1];
        const auto [changes, largest] = changes_of(n, row);
        const bool is_flat = largest <= FLAT;
        if (changes == 0 || (is_flat && length == 1.0)) continue;
        // The search would take an end that is next to 0 for the root.
        const double least_end = std::min(std::abs(row[0]), std::abs(row[n]));
        if (changes == 1 && least_end > ROUNDING_REL * largest && !is_flat) {
            append(start + length * only_root(n, row, scratch.spare));
            continue;
        }
        if (is_flat || top + 2 > DEEPEST || length < 1e-13) {
            append(start + 0.5 * length);
            continue;
        }
        // Halves by de Casteljau: the right one replaces this row, the left one is put on top.
        double *const left = stack[top + 1];
        for (int64_t r = 0; r <= n; r++) {
            left[r] = row[0];
            for (int64_t k = 0; k < n - r; k++) row[k] = 0.5 * (row[k] + row[k + 1]);
        }
        low[top][0] = start + 0.5 * length;
        low[top][1] = 0.5 * length;
        low[top + 1][0] = start;
        low[top + 1][1] = 0.5 * length;
        // Step r leaves coefficient n - r of the row as that of the right half. A root where they
        // meet is an end of both, and neither has it within.
        if (row[0] == 0.0) append(start + 0.5 * length);
        top += 2;
    }
    return count;
}

// Place where the image of an edge takes a level of u, or of v, next to a root t.
//
// The root is that of the polynomial through the nodes, which is next to the lens by area, but may
// be off by much more in its place; steps of the secant method follow while they come nearer.
inline double crossing(const PlaneRecord &plane, const Edge &edge, double t, bool is_u,
                       double level) {
    const auto height_at = [&](double place) {
        const auto [x, y] = point_of(edge, 1.0 - place, place);
        const auto [u, v] = plane_value(plane, x, y);
        return (is_u ? u : v) - level;
    };
    const double step = t < 0.5 ? SECANT : -SECANT;
    double height = height_at(t);
    for (int correction = 0; correction < CORRECTIONS; correction++) {
        if (std::abs(height) < CROSSED) break;
        const double change = height_at(t + step) - height;
        const double move = change != 0.0 ? -step * (height / change) : 1.0;
        if (!(std::abs(move) < SECANT) || !(0.0 < t + move && t + move < 1.0)) break;
        const double following = height_at(t + move);
        if (!(std::abs(following) < std::abs(height))) break;
        t += move;
        height = following;
    }
    return t;
}

// Lists the places where the image of an edge may cross the border of the image, in order. The
// values at its nodes are scratch.U and scratch.V. Returns their number.
inline int64_t find_cuts(const PlaneRecord &plane, const Edge &edge, int64_t n, double stray,
                         EdgeScratch &scratch) {
    Cut *const cuts = scratch.cuts;
    const double levels[4] = {0.0, plane.width, 0.0, plane.height};
    int64_t count = 0;
    for (int side = 0; side < 4; side++) {
        const bool is_u = side < 2;
        const double *const values = is_u ? scratch.U : scratch.V;
        if (!may_cross(n, values, levels[side], stray)) continue;
        bernstein_of(n, values, levels[side], scratch.stack[0]);
        const int64_t found = count;
        count = roots(n, scratch, is_u ? LEVEL_U : LEVEL_V, count);
        for (int64_t i = found; i < count; i++)
            cuts[i].place = crossing(plane, edge, cuts[i].place, is_u, levels[side]);
    }
    sort_range(cuts, cuts + count, [](const Cut &a, const Cut &b) {
        return std::tie(a.place, a.kind) < std::tie(b.place, b.kind);
    });
    return count;
}

// Clamped v of an end of a part of an edge. A cut by v is on the border, to the error of its root:
// the integral must end there, or that error would be multiplied by u.
inline double clamped_end(double v, double height, CutKind kind) {
    if (kind == LEVEL_V) v = v < 0.5 * height ? 0.0 : height;
    return std::min(std::max(v, 0.0), height);
}

struct Integral {
    double value;
    int64_t pieces;
};

// Integral of clamp(u, 0, W) d clamp(v, 0, H) along the image of an edge, px^2, and its pieces.
// scratch.U and scratch.V are the values at the nodes of the edge, and lost. An arc between two
// nodes leaves its chord by `stray` at most, px.
inline Integral clamped_edge(const PlaneRecord &plane, const Edge &edge, int64_t n, double stray,
                             EdgeScratch &scratch) {
    const auto &[U, V, cuts] = std::tie(scratch.U, scratch.V, scratch.cuts);
    const double W = plane.width, H = plane.height;
    bool is_in = true;
    for (int64_t k = 0; k <= n; k++)
        is_in = is_in && 0.0 < U[k] && U[k] < W && 0.0 < V[k] && V[k] < H;
    const int64_t count = find_cuts(plane, edge, n, stray, scratch);
    if (count == 0 && is_in) return {under_edge(n, U, V, 0.0), 1};
    double total = 0.0;
    double start = 0.0;
    CutKind start_kind = NO_LEVEL;
    for (int64_t i = 0; i <= count; i++) {
        const auto [end, end_kind] = i < count ? cuts[i] : Cut{1.0, NO_LEVEL};
        if (end > start) {
            const Edge part = part_of_edge(edge, start, end);
            Pixel<double> middle = {U[n / 2], V[n / 2]};
            if (count > 0) middle = node_value(plane, part, n, n / 2);
            if (middle.u > 0.0 && 0.0 < middle.v && middle.v < H) {
                if (count > 0) values_together(plane, part, n, scratch);
                const double first = clamped_end(V[0], H, start_kind),
                             last = clamped_end(V[n], H, end_kind);
                if (middle.u >= W) {
                    total += W * (last - first);
                } else {
                    total += under_edge(n, U, V, 0.0);
                    total += U[0] * (V[0] - first) + U[n] * (last - V[n]);
                }
            }
        }
        start = end;
        start_kind = end_kind;
    }
    return {total, count + 1};
}

} // namespace rastercov::lens
