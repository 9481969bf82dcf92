// Faces of a mesh in contact, over the boxes of a triangle tree.
//
// Conservative: a false positive costs time, a false negative would break the certificate. Two
// triangles are apart if their projections on some axis are, of those in triangles.hpp.
//
// The tree is traversed without a stack: a node and its descendants are followed by its right
// sibling, or by that of its nearest ancestor with one. Each leaf is compared only with leaves to
// its right.
//
// T. Akenine-Möller. Fast 3D Triangle-Box Overlap Testing. 2001, for a plane and a box.
//
// Twin: tests/mesh/test_contacts.py compares all pairs.
#pragma once
#include "interrupt.hpp"
#include "mesh/grow.hpp"
#include "mesh/triangles.hpp"
#include <bit>

namespace rastercov::mesh {

using Boxes = Array<const float, Any, 6>;

// Steps through the tree after which boxes are tested against the planes of a leaf's faces, too.
constexpr int64_t STEPS_BEFORE_SLABS = 256;

// Flags that threads share: one that is seen late costs time, nothing else.
inline bool is_set(const bool &flag) { return __atomic_load_n(&flag, __ATOMIC_RELAXED); }
inline void set(bool &flag) { __atomic_store_n(&flag, true, __ATOMIC_RELAXED); }

// True if two boxes are within `reach` of each other along every axis.
inline bool overlap(const float *one, const float *other, double reach) {
    const float x = std::max(one[0] + other[3], other[0] + one[3]);
    const float y = std::max(one[1] + other[4], other[1] + one[4]);
    const float z = std::max(one[2] + other[5], other[2] + one[5]);
    return double(std::max(x, std::max(y, z))) <= reach;
}

// True if two triangles with one common corner also meet elsewhere. Their intersection is convex
// and contains that corner, so it ends on the edge of one of them opposite the corner, which is
// corner 0 of both, and the origin.
inline bool fan_touches(Triangle one, Triangle other, double reach) {
    // Quick answer, if a plane through the corner separates the triangles:
    const auto &a = one.corner, &b = other.corner;
    const Vector axis = b[1] + b[2] - a[1] - a[2];
    const double length = dot(axis, axis);
    const double above = std::min(dot(b[1], axis), dot(b[2], axis));
    const double below = std::max(dot(a[1], axis), dot(a[2], axis));
    if (length > LEAST_AXIS_SQUARED && std::min(above, -below) > reach * std::sqrt(length))
        return false;
    other.corner[0] = b[1];
    if (!are_apart(one, other, reach)) return true;
    other.corner[0] = {0.0, 0.0, 0.0};
    one.corner[0] = a[1];
    return !are_apart(one, other, reach);
}

// True if two triangles with a common edge are folded onto each other. Projected along the edge
// they are two segments from one point. The gap between the triangles is widest at the lower apex.
// The edge starts at corner 0, the origin, and ends at corner 1; corners 2 are the apexes.
inline bool fold_touches(const Triangle &one, const Triangle &other, double reach) {
    const Vector edge = one.corner[1];
    const double length = dot(edge, edge);
    if (!(length > LEAST_AXIS_SQUARED)) return true;
    const auto across = [&](Vector apex) { return apex - dot(apex, edge) / length * edge; };
    const Vector p = across(one.corner[2]), q = across(other.corner[2]);
    const double pp = dot(p, p), qq = dot(q, q);
    if (std::min(pp, qq) <= reach * reach) return true;
    if (dot(p, q) <= 0.0) return false;
    const Vector area = cross(p, q);
    return dot(area, area) <= reach * reach * std::max(pp, qq);
}

template <class I> struct Surface {
    Points vertices; // original coordinates: the rounding of a shift would bend short edges
    double scale;    // inverse of the diagonal of their bounding box
    Faces<I> faces;  // equal indices for vertices at the same point; three different ones a face
    double reach;    // as a fraction of that diagonal

    Vector vertex(I v) const {
        require(uint64_t(v) < uint64_t(vertices.rows()), "faces must hold rows of vertices");
        return vector_of(vertices[v].data);
    }

    // True if two faces come within `reach` of each other, except where they are joined.
    bool touch(int64_t t, int64_t m) const {
        const auto one = faces[t], other = faces[m];
        int shared = 0;
        int at_one = 0;
        int at_other = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                if (one[i] == other[j]) {
                    shared++;
                    at_one += i;
                    at_other += j;
                }
        if (shared >= 3) return true;
        // From a common corner on, followed by the second common corner, if any: apexes are last.
        int first = at_one;
        int first_other = at_other;
        if (shared == 2) { // after the apex, which is 3 - at
            first = (4 - at_one) % 3;
            first_other = (4 - at_other) % 3;
        }
        const Vector origin = vertex(one[first]);
        Triangle a, b;
        for (int i = 0; i < 3; i++) {
            a.corner[i] = scale * (vertex(one[(first + i) % 3]) - origin);
            b.corner[i] = scale * (vertex(other[(first_other + i) % 3]) - origin);
        }
        if (shared == 0) return !are_apart(a, b, reach);
        return shared == 1 ? fan_touches(a, b, reach) : fold_touches(a, b, reach);
    }
};

// Space between two planes that holds a face: their normal, its length, the interval along it.
// An interval, not a value: rounding may have rotated the normal of a needle.
struct Slab {
    double normal[3], length;
    Interval along;

    // True if a box is more than `reach` above or below.
    bool misses(const float *box, double reach) const {
        double middle = 0.0;
        double radius = 0.0;
        for (int k = 0; k < 3; k++) {
            middle += normal[k] * 0.5 * double(box[k] - box[3 + k]);
            radius -= std::abs(normal[k]) * 0.5 * double(box[k] + box[3 + k]);
        }
        const double gap = std::max(middle - radius - along.high, along.low - middle - radius);
        return gap > reach * length;
    }
};

inline Slab slab_of(const Triangle &face) {
    Vector normal = normal_of(face);
    const double length = dot(normal, normal);
    if (!(length > LEAST_AXIS_SQUARED)) normal = {0.0, 0.0, 0.0};
    return {{normal.x, normal.y, normal.z}, std::sqrt(length), face.along(normal)};
}

// Node that follows a node and its descendants; 1 after the last.
inline int64_t next_of(int64_t node) { return (node + 1) >> std::countr_zero(uint64_t(node + 1)); }

template <class Rows> void require_tree(int64_t faces, Rows boxes, Rows nodes) {
    const int64_t leaves = nodes.rows() / 2;
    require(leaves > 0 && std::has_single_bit(uint64_t(leaves)) && nodes.rows() == 2 * leaves &&
                boxes.rows() == faces && faces <= leaves * LEAF,
            "boxes must have one row for each face, nodes two for each leaf, a power of two");
}

// Marks a face, and sets `done` of each node where it was the last unmarked one.
inline void mark(int64_t f, Column<bool> marks, Column<bool> done, int64_t leaf) {
    set(marks[f]);
    const int64_t start = (leaf - done.rows() / 2) * LEAF;
    for (int64_t other = start; other < std::min(start + LEAF, marks.rows()); other++)
        if (!is_set(marks[other])) return;
    for (set(done[leaf]); leaf > 1 && is_set(done[leaf ^ 1]); set(done[leaf])) leaf >>= 1;
}

// A tree over faces, in its order: boxes of these and of nodes, and the number of each node in
// `fans`, (2 L,) or empty: nodes of one number are not compared, -1 for none.
template <class I> struct ContactTree {
    Faces<I> faces;
    Boxes boxes, nodes;
    Int32Array fans;

    int64_t n_leaves() const { return nodes.rows() / 2; }
    bool are_of_fan(int64_t a, int64_t b) const {
        return fans.rows() > 0 && fans[a] >= 0 && fans[a] == fans[b];
    }
    void check() const {
        require_tree(faces.rows(), boxes, nodes);
        require(fans.rows() == 0 || fans.rows() == nodes.rows(), "fans must be of all nodes");
    }
};

// What threads know of contacts: labels, (F,) or none, of which only equal ones count; nodes
// without an unmarked face, `done`, (2 L,); and the faces in contact, `marks`.
struct Marking {
    Int32Array labels;
    Column<bool> done, marks;

    bool is_wanted(int64_t t, int64_t m) const {
        return !(is_set(marks[t]) && is_set(marks[m])) &&
               (labels.rows() == 0 || labels[t] == labels[m]);
    }
};

// Marks the faces in contact, for pairs whose first leaf is in a range; the steps through the tree
// that it took. `placed` are the vertices of the tree. Other threads may work on other ranges.
template <class I>
int64_t mark_contacts(const Surface<I> &surface, Points placed, const ContactTree<I> &tree,
                      int64_t first, int64_t last, const Marking &marking) {
    const auto &[faces, boxes, nodes, fans] = tree;
    const auto &[labels, done, marks] = marking;
    const int64_t leaves = tree.n_leaves(), n = faces.rows();
    tree.check();
    require(0 <= first && last <= leaves, "first and last must be leaves");
    require(placed.rows() == surface.vertices.rows() && done.rows() == nodes.rows() &&
                marks.rows() == n && (labels.rows() == 0 || labels.rows() == n),
            "placed must have one row for each vertex, done for each node, marks for each face");
    const double reach = surface.reach;
    const Surface<I> in_tree = {placed, 1.0, faces, 0.0};
    int64_t spent = 0;
    Poll poll(16);
    for (int64_t leaf = first; leaf < last; leaf++) {
        poll();
        const int64_t start = leaf * LEAF, end = std::min(start + LEAF, n), here = leaves + leaf;
        const auto is_over = [&](int64_t node) {
            return tree.are_of_fan(here, node) || (is_set(done[here]) && is_set(done[node]));
        };
        Slab slabs[LEAF];
        int64_t steps = 0;
        for (int64_t node = here; node != 1; node = next_of(node)) {
            if (++steps == STEPS_BEFORE_SLABS) // a large face among small ones, or a slanted face
                for (int64_t t = start; t < end; t++)
                    slabs[t - start] =
                        slab_of({in_tree.vertex(faces(t, 0)), in_tree.vertex(faces(t, 1)),
                                 in_tree.vertex(faces(t, 2))});
            const auto is_near = [&] {
                return overlap(nodes[here].data, nodes[node].data, reach) && !is_over(node);
            };
            bool enters = is_near();
            while (enters && node < leaves) {
                node *= 2;
                enters = is_near();
            }
            if (!enters) continue;
            const int64_t other = (node - leaves) * LEAF, other_end = std::min(other + LEAF, n);
            for (int64_t t = start; t < end; t++) {
                const float *box = boxes[t].data, *of_node = nodes[node].data;
                if (!overlap(box, of_node, reach) ||
                    (steps >= STEPS_BEFORE_SLABS && slabs[t - start].misses(of_node, reach)))
                    continue;
                for (int64_t m = std::max(other, t + 1); m < other_end; m++)
                    if (overlap(box, boxes[m].data, reach) && marking.is_wanted(t, m) &&
                        surface.touch(t, m)) {
                        mark(t, marks, done, here);
                        mark(m, marks, done, node);
                    }
            }
        }
        spent += steps;
    }
    return spent;
}

// Lists all pairs of faces in contact, rows of `faces`, the lower one first; their number, or one
// more than there is room for. n_steps counts nodes and pairs.
template <class I>
int64_t list_contacts(const Surface<I> &surface, const ContactTree<I> &tree,
                      Array<int32_t, Any, 2> pairs, int64_t &n_steps) {
    const auto &[faces, boxes, nodes, fans] = tree;
    const int64_t leaves = tree.n_leaves(), n_faces = faces.rows();
    tree.check();
    const double reach = surface.reach;
    int64_t n = 0;
    Poll poll(64);
    for (int64_t t = 0; t < n_faces; t++) {
        poll();
        const float *box = boxes[t].data;
        const int64_t here = leaves + t / LEAF;
        const auto is_near = [&](int64_t node) {
            n_steps++;
            return !tree.are_of_fan(here, node) && overlap(box, nodes[node].data, reach);
        };
        for (int64_t node = here; node != 1; node = next_of(node)) {
            bool enters = is_near(node);
            while (enters && node < leaves) {
                node *= 2;
                enters = is_near(node);
            }
            if (!enters) continue;
            const int64_t start = (node - leaves) * LEAF;
            for (int64_t m = std::max(start, t + 1); m < std::min(start + LEAF, n_faces); m++) {
                if (!overlap(box, boxes[m].data, reach)) continue;
                n_steps++;
                if (!surface.touch(t, m)) continue;
                if (n == pairs.rows()) return n + 1;
                pairs(n, 0) = int32_t(t);
                pairs(n, 1) = int32_t(m);
                n++;
            }
        }
    }
    return n;
}

} // namespace rastercov::mesh
