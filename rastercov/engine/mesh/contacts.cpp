// Contacts of two bodies.
//
// Twin: tests/mesh/test_contacts.py compares all pairs.
#include "mesh/contacts.hpp"
#include "bind.hpp"

namespace rastercov {
namespace mesh {
namespace {

// A body as it is placed beside another one: the tree over its faces, with boxes of doubles.
struct Body {
    Points points;
    Faces<int32_t> faces;
    Nodes boxes, nodes;

    int64_t leaves() const { return nodes.rows() / 2; }
    bool is_leaf(int64_t node) const { return node >= leaves(); }
    Triangle face(int64_t f, Vector origin, double scale) const {
        Triangle found;
        for (int k = 0; k < 3; k++) {
            const int32_t v = faces(f, k);
            require(uint64_t(v) < uint64_t(points.rows()), "faces must hold rows of points");
            found.corner[k] = scale * (vector_of(points[v].data) - origin);
        }
        return found;
    }
};

bool near_by(Array<const double, 6> one, Array<const double, 6> other, double reach) {
    for (int k = 0; k < 3; k++)
        if (!(std::max(one[k] + other[3 + k], other[k] + one[3 + k]) <= reach)) return false;
    return true;
}

double width_of(Array<const double, 6> box) {
    return -(box[0] + box[3]) - (box[1] + box[4]) - (box[2] + box[5]);
}

int64_t list_between(const Body &one, const Body &other, double scale, double reach,
                     Column<bool> marks, Column<bool> other_marks, Array<int32_t, Any, 2> pairs) {
    const int64_t n_faces = one.faces.rows(), n_others = other.faces.rows();
    require_tree(n_faces, one.boxes, one.nodes);
    require_tree(n_others, other.boxes, other.nodes);
    require(marks.rows() == n_faces && other_marks.rows() == n_others,
            "marks must have one value for each face");
    const double far = reach / scale;
    int64_t n = 0;
    int64_t depth = 1;
    std::array<std::array<int64_t, 2>, 2 * STACK_SIZE> stack;
    Poll poll;
    for (stack[0] = {1, 1}; depth;) {
        poll();
        const auto [a, b] = stack[--depth];
        if (!near_by(one.nodes[a], other.nodes[b], far)) continue;
        if (!one.is_leaf(a) &&
            (other.is_leaf(b) || width_of(one.nodes[a]) >= width_of(other.nodes[b]))) {
            stack[depth++] = {2 * a, b};
            stack[depth++] = {2 * a + 1, b};
            continue;
        }
        if (!other.is_leaf(b)) {
            stack[depth++] = {a, 2 * b};
            stack[depth++] = {a, 2 * b + 1};
            continue;
        }
        const int64_t from = (a - one.leaves()) * LEAF, first = (b - other.leaves()) * LEAF;
        for (int64_t t = from; t < std::min(from + LEAF, n_faces); t++)
            for (int64_t m = first; m < std::min(first + LEAF, n_others); m++) {
                const bool is_full = n >= pairs.rows();
                if ((is_full && marks[t] && other_marks[m]) ||
                    !near_by(one.boxes[t], other.boxes[m], far))
                    continue;
                const Vector origin = vector_of(one.boxes[t].data);
                if (are_apart(one.face(t, origin, scale), other.face(m, origin, scale), reach))
                    continue;
                marks[t] = other_marks[m] = true;
                if (!is_full) {
                    pairs(n, 0) = int32_t(t);
                    pairs(n, 1) = int32_t(m);
                }
                n++;
            }
    }
    return n;
}

} // namespace
} // namespace mesh

RECORD(mesh::Body, points, faces, boxes, nodes);

void register_mesh_contacts(nanobind::module_ &m) {
    def(m, "list_between", mesh::list_between,
        "List the pairs of faces of two bodies in contact, and mark these; a number of pairs.\n\n"
        "Each body has points, faces in the order of its tree, and the boxes of these and of "
        "nodes,\n"
        "with no margin. `reach` is the distance of contact in units of 1 / `scale`. `pairs`, (N, "
        "2),\n"
        "are set to rows of both. A larger number than N says that there are\n"
        "more than N; all of these are marked.",
        "one", "other", "scale", "reach", "marks", "other_marks", "pairs");
}

} // namespace rastercov
