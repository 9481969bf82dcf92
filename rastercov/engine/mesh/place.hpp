// Places for a camera: the nearest surface, and the backs of faces that enclose a point.
//
// Of the 32 directions to the corners of an icosahedron and its dual, most of those from a point
// within a body of one-sided faces first meet the back of one, also where the body is open. A room
// shows its fronts. From a point outside the box of such faces, half of all directions miss them.
//
// Twin: tests/mesh/test_open_bodies.py asks single triangles.
#pragma once
#include "mesh/triangles.hpp"

namespace rastercov::mesh {

constexpr int N_DIRECTIONS = 32;
// Distance in which nothing is met: a point on a face is on its front.
constexpr double ON_SURFACE = 1e-9;

// Squared distance of a point from a box; 0 inside.
inline double box_distance(Point p, Array<const double, 6> box) {
    double total = 0.0;
    for (int k = 0; k < 3; k++) {
        const double gap = std::max(std::max(box[k] - p[k], p[k] + box[3 + k]), 0.0);
        total += gap * gap;
    }
    return total;
}

struct NearestPoint {
    double squared; // distance
    int64_t triangle;
    double at[3];
};

// Nearest point of triangles with an area. Of several at the same distance it is the first one that
// the traversal reaches. Nodes have no margin.
[[gnu::noinline]] inline NearestPoint nearest_to(Point p, Corners corners, Nodes nodes) {
    const int64_t leaves = nodes.rows() / 2;
    NearestPoint best = {INF, 0, {}};
    double found[3];
    int64_t stack[STACK_SIZE] = {1};
    for (int64_t depth = 1; depth;) {
        const int64_t node = stack[--depth];
        if (box_distance(p, nodes[node]) >= best.squared) continue;
        if (node >= leaves) {
            const int64_t start = (node - leaves) * LEAF;
            for (int64_t t = start; t < std::min(start + LEAF, corners.rows()); t++)
                if (const double d = nearest_on_triangle(p.data, corners[t].data, found);
                    d < best.squared) {
                    best.squared = d;
                    best.triangle = t;
                    std::copy_n(found, 3, best.at);
                }
            continue;
        }
        int64_t near = 2 * node;
        int64_t far = near + 1;
        if (box_distance(p, nodes[near]) > box_distance(p, nodes[far])) std::swap(near, far);
        stack[depth++] = far;
        stack[depth++] = near;
    }
    return best;
}

// Direction k: twelve corners of an icosahedron, then twenty of its dual, of unit length.
inline Vector direction_of(int k) {
    constexpr double SHORT = 0.5257311121191336, LONG = 0.8506508083520399; // 1 and golden ratio
    constexpr double THIRD = 0.5773502691896258, LESS = 0.35682208977308993,
                     MORE = 0.9341723589627157; // 1, its reciprocal and it, of length 1 together
    const double one = k & 1 ? -1.0 : 1.0, two = k & 2 ? -1.0 : 1.0;
    if (k >= 24) return {one * THIRD, two * THIRD, k & 4 ? -THIRD : THIRD};
    const double x = one * (k < 12 ? SHORT : LESS), y = two * (k < 12 ? LONG : MORE);
    const int axis = k / 4 % 3;
    if (axis == 0) return {0.0, x, y};
    return axis == 1 ? Vector{y, 0.0, x} : Vector{x, y, 0.0};
}

// True where most directions from a point first meet the back of a triangle of which
// `counts(triangle)` is true. In a scene of diagonal 1 about the origin.
template <class Counts> bool is_behind(Hits &hits, Vector p, Counts counts) {
    int backs = 0;
    for (int k = 0; k < N_DIRECTIONS; k++) {
        const Vector d = direction_of(k);
        const int64_t hit = hits.first({p + ON_SURFACE * d, d, 2.0}, -1);
        if (hit < 0 || !counts(hit)) continue;
        backs += dot(normal_of(triangle_of(hits.corners[hit].data)), d) > 0.0;
    }
    return 2 * backs > N_DIRECTIONS;
}

} // namespace rastercov::mesh
