// Loops of `rastercov.core.mesh.contacts.TriangleTree`: Morton order, boxes, and four queries.
//
// tree.hpp has the tree, and the segment that is traced through it; place.hpp the nearest point,
// and what encloses one. A winding number is found by the signed crossings of a ray along
// +z.
//
// Twins: tests/mesh/test_triangle_tree.py asks single triangles; rastercov.reference.regions and
// rastercov.reference.models.line_of_sight trace segments without a tree.
#include "bind.hpp"
#include "interrupt.hpp"
#include "mesh/grow.hpp"
#include "mesh/place.hpp"

namespace rastercov {
namespace mesh {
namespace {

void first_hits(Points origins, Points directions, FloatArray reaches, IntArray own,
                bool is_nearest, Corners corners, Nodes nodes, Column<int64_t> hit) {
    const int64_t n = origins.rows();
    require(have_rows(n, directions, reaches, own, hit),
            "directions, reaches, own and hit must have one row for each origin");
    require_tree(corners, nodes);
    Hits hits = {corners, nodes, is_nearest};
    Poll poll;
    for (int64_t i = 0; i < n; i++) {
        poll();
        hit[i] = -1;
        if (!(reaches[i] > 0.0)) continue;
        hit[i] = hits.first({vector_of(origins[i].data), vector_of(directions[i].data), reaches[i]},
                            own[i]);
    }
}

// --- places ---

void nearest(Points points, Corners corners, Nodes nodes, Column<double> squared,
             Column<int64_t> triangle, Array<double, Any, 3> where) {
    const int64_t n = points.rows();
    require(have_rows(n, squared, triangle, where),
            "squared, triangle and where must have one row for each point");
    require_tree(corners, nodes);
    Poll poll;
    for (int64_t i = 0; i < n; i++) {
        poll();
        const NearestPoint found = nearest_to(points[i], corners, nodes);
        squared[i] = found.squared;
        triangle[i] = found.triangle;
        std::copy_n(found.at, 3, where[i].data);
    }
}

void behind(Points points, BoolArray counts, Corners corners, Nodes nodes,
            Column<bool> is_enclosed) {
    const int64_t n = points.rows();
    require(have_rows(n, is_enclosed), "is_enclosed must have one row for each point");
    require(counts.rows() == corners.rows(), "counts must have one row for each triangle");
    require_tree(corners, nodes);
    Hits hits = {corners, nodes, true};
    Poll poll;
    for (int64_t i = 0; i < n; i++) {
        poll();
        is_enclosed[i] =
            is_behind(hits, vector_of(points[i].data), [&](int64_t t) { return counts[t]; });
    }
}

// --- winding number ---

// True if a point lies to the left of the line from vertex i to j, seen along z. Computed from the
// lower to the higher index, so the two faces of an edge always agree.
bool is_left(Points vertices, int64_t i, int64_t j, double x, double y) {
    const Point low = vertices[std::min(i, j)], high = vertices[std::max(i, j)];
    const double across = (high[0] - low[0]) * (y - low[1]);
    const double along = (high[1] - low[1]) * (x - low[0]);
    return (across >= along) == (i <= j);
}

template <class I>
int64_t turns_about(double x, double y, double z, Points vertices, Faces<I> faces, Nodes nodes) {
    int64_t total = 0;
    const auto is_met = [&](int64_t node) {
        const auto box = nodes[node];
        return box[0] <= x && x <= -box[3] && box[1] <= y && y <= -box[4] && z <= -box[5];
    };
    each_met(nodes, faces.rows(), is_met, [&](int64_t t) {
        const int64_t i = faces(t, 0), j = faces(t, 1), k = faces(t, 2);
        const bool side = is_left(vertices, i, j, x, y);
        if (is_left(vertices, j, k, x, y) != side || is_left(vertices, k, i, x, y) != side)
            return true;
        const Vector a = vector_of(vertices[i].data);
        const Vector normal =
            cross(vector_of(vertices[j].data) - a, vector_of(vertices[k].data) - a);
        const double above = dot(a - Vector{x, y, z}, normal);
        const int sign = side ? 1 : -1;
        if (above * sign > 0.0) total += sign;
        return true;
    });
    return total;
}

template <class I>
void winding(Points points, Points vertices, Faces<I> faces, Nodes nodes, Column<int64_t> turns) {
    require(turns.rows() == points.rows(), "turns must have one row for each point");
    require(nodes.rows() >= 2, "nodes must have a root");
    require_indices(faces, vertices.rows(), "faces must hold rows of vertices");
    Poll poll;
    for (int64_t i = 0; i < points.rows(); i++) {
        poll();
        turns[i] = turns_about(points(i, 0), points(i, 1), points(i, 2), vertices, faces, nodes);
    }
}

template <class I> void register_of_index(nanobind::module_ &m) {
    def(m, "order_keys", order_keys<I>,
        "Set `keys`, (T,): the position of the centre of each triangle's box along a Morton curve.",
        "points", "faces", "keys");
    const char *boxes =
        "Set the (T, 6) boxes of the triangles, and the (2 L, 6) nodes of the tree above them.\n\n"
        "The faces are in the order of the keys; L is a power of two with L >= 2 and 4 L >= T. "
        "The\n"
        "margin, added on each side, is at least twice the rounding of a coordinate to the type "
        "of\n"
        "the boxes.";
    def(m, "grow_boxes", grow_boxes<I, double>, boxes, "points", "faces", "margin", "boxes",
        "nodes");
    def(m, "grow_boxes", grow_boxes<I, float>, boxes, "points", "faces", "margin", "boxes",
        "nodes");
    def(m, "winding", winding<I>,
        "Set `turns` to the winding number of a surface about each point.\n\n"
        "These are the signed crossings of a ray along +z: 1 inside a surface that faces outward,\n"
        "-1 inside one that faces inward, undefined unless the surface is closed. The faces are "
        "in\n"
        "the order of the tree, and nodes have no margin.",
        "points", "vertices", "faces", "nodes", "turns");
}

} // namespace
} // namespace mesh

void register_mesh_tree(nanobind::module_ &m) {
    using namespace mesh;
    m.attr("LEAF") = LEAF;
    register_of_index<int64_t>(m);
    register_of_index<int32_t>(m);
    def(m, "first_hits", first_hits,
        "Set `hit` to the triangle that each segment meets first, or to any; -1 for none.\n\n"
        "Directions are unit vectors, in a scene of diagonal 1; a segment without a positive "
        "reach,\n"
        "its length, meets nothing. Triangle `own` does not count, -1 for none. The (T, 3, 3)\n"
        "corners of the triangles are in the order of the tree.",
        "origins", "directions", "reaches", "own", "is_nearest", "corners", "nodes", "hit");
    def(m, "nearest", nearest,
        "Set squared distance, triangle and (N, 3) nearest point of the triangles for each "
        "point.\n\n"
        "Of several triangles at the same distance it is the first one that the traversal "
        "reaches.\n"
        "They have an area; their (T, 3, 3) corners are in the order of the tree, and nodes have "
        "no\n"
        "margin.",
        "points", "corners", "nodes", "squared", "triangle", "where");
    def(m, "behind", behind,
        "Set `is_enclosed` where most directions from a point first meet the back of a triangle\n"
        "of which `counts`, (T,), is true.\n\n"
        "All triangles block; their (T, 3, 3) corners are in the order of the tree. In a scene of\n"
        "diagonal 1 about the origin.",
        "points", "counts", "corners", "nodes", "is_enclosed");
}

} // namespace rastercov
