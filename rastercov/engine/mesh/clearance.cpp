// Least distance of two bodies of triangles under relative poses, by their trees of boxes.
//
// Pairs of nodes are visited in order of a lower bound of their distance, and left where it is not
// below the least distance that is known: the distance of a box of one from the box about the other
// as it is turned. Two triangles intersect where an edge of one passes through the other. Those
// that do not are nearest to each other at a corner of one or at an edge of each.
//
// E. Larsen, S. Gottschalk, M. C. Lin, D. Manocha. Fast Proximity Queries with Swept Sphere
// Volumes. 1999, for the traversal.
//
// Twin: tests/robots/test_clearance.py compares all pairs of triangles.
#include "bind.hpp"
#include "interrupt.hpp"
#include "mesh/triangles.hpp"

namespace rastercov {
namespace mesh {
namespace {

using Pose = Array<const double, 4, 4>;

struct Body {
    Corners corners;
    Nodes nodes;

    int64_t leaves() const { return nodes.rows() / 2; }
    double width(int64_t node) const {
        const auto box = nodes[node];
        return greatest(-box[3] - box[0], -box[4] - box[1], -box[5] - box[2]);
    }
};

// Point of the frame of `other` in that of `one`.
inline void move_point(Pose pose, const double *p, double *out) {
    for (int k = 0; k < 3; k++)
        out[k] = pose(k, 0) * p[0] + pose(k, 1) * p[1] + pose(k, 2) * p[2] + pose(k, 3);
}

// Squared lower bound of the distance of two boxes, the second in a frame that `pose` moves: the
// greater of those along the axes of either frame.
double box_distance(const double *one, const double *other, Pose pose) {
    if (one[0] == INF || other[0] == INF) return INF; // an empty box
    double half[2][3], middle[2][3], centre[3], way[3], total[2] = {0.0, 0.0};
    const double *const boxes[] = {one, other};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            middle[i][k] = 0.5 * (boxes[i][k] - boxes[i][3 + k]);
            half[i][k] = -0.5 * (boxes[i][k] + boxes[i][3 + k]);
        }
    move_point(pose, middle[1], centre);
    for (int k = 0; k < 3; k++) way[k] = centre[k] - middle[0][k];
    for (int k = 0; k < 3; k++) {
        double radius = half[0][k];
        double turned = half[1][k];
        double along = 0.0;
        for (int i = 0; i < 3; i++) {
            radius += std::abs(pose(k, i)) * half[1][i];
            turned += std::abs(pose(i, k)) * half[0][i];
            along += pose(i, k) * way[i];
        }
        const double gap = std::max(std::abs(way[k]) - radius, 0.0);
        const double other_gap = std::max(std::abs(along) - turned, 0.0);
        total[0] += gap * gap;
        total[1] += other_gap * other_gap;
    }
    return std::max(total[0], total[1]);
}

inline double clamp_to_unit(double s) { return std::min(std::max(s, 0.0), 1.0); }

// True if a segment passes through a triangle; at its border rounding decides.
bool pierces(Vector p, Vector q, const Triangle &t) {
    const Vector normal = normal_of(t);
    const double above = dot(normal, p - t.corner[0]), below = dot(normal, q - t.corner[0]);
    if ((above > 0.0) == (below > 0.0) || above == below) return false;
    const Vector at = p + above / (above - below) * (q - p);
    for (int k = 0; k < 3; k++)
        if (dot(normal, cross(t.edge(k), at - t.corner[k])) < 0.0) return false;
    return true;
}

// Squared distance of two segments.
double segment_distance(Vector p, Vector u, Vector q, Vector v) {
    const Vector from = p - q;
    const double a = dot(u, u), e = dot(v, v), b = dot(u, v), c = dot(u, from), f = dot(v, from);
    const double square = a * e - b * b;
    double s = square > 0.0 ? clamp_to_unit((b * f - c * e) / square) : 0.0, t = 0.0;
    if (e > 0.0) t = (b * s + f) / e;
    if (t < 0.0 || t > 1.0 || !(e > 0.0)) {
        t = clamp_to_unit(t);
        s = a > 0.0 ? clamp_to_unit((b * t - c) / a) : 0.0;
    }
    const Vector gap = from + s * u - t * v;
    return dot(gap, gap);
}

// Squared distance of two triangles of nine numbers each.
double triangle_distance(const double *a, const double *b) {
    const Triangle one = triangle_of(a), other = triangle_of(b);
    double best = INF, where[3];
    for (int i = 0; i < 3; i++) {
        if (pierces(one.corner[i], one.corner[(i + 1) % 3], other) ||
            pierces(other.corner[i], other.corner[(i + 1) % 3], one))
            return 0.0;
        best = std::min(best, std::min(nearest_on_triangle(a + 3 * i, b, where),
                                       nearest_on_triangle(b + 3 * i, a, where)));
        for (int j = 0; j < 3; j++)
            best = std::min(
                best, segment_distance(one.corner[i], one.edge(i), other.corner[j], other.edge(j)));
    }
    return best;
}

// The least of `reach` and the distance of two bodies; 0 where they intersect.
double distance_of(const Body &one, const Body &other, Pose pose, double reach) {
    struct Pair {
        int64_t one, other;
        double bound;
    };
    double best = reach * reach;
    Pair stack[2 * STACK_SIZE] = {{1, 1, 0.0}};
    Poll poll;
    for (int64_t depth = 1; depth;) {
        poll();
        const Pair pair = stack[--depth];
        if (!(pair.bound < best)) continue;
        const bool is_leaf = pair.one >= one.leaves(), is_other_leaf = pair.other >= other.leaves();
        if (!is_leaf || !is_other_leaf) {
            const bool splits_one =
                is_other_leaf || (!is_leaf && one.width(pair.one) > other.width(pair.other));
            Pair next[2];
            for (int k = 0; k < 2; k++) {
                next[k] = {splits_one ? 2 * pair.one + k : pair.one,
                           splits_one ? pair.other : 2 * pair.other + k, 0.0};
                next[k].bound = box_distance(one.nodes[next[k].one].data,
                                             other.nodes[next[k].other].data, pose);
            }
            if (next[0].bound < next[1].bound) std::swap(next[0], next[1]);
            for (const Pair &each : next) // the nearer one is visited first
                if (each.bound < best) stack[depth++] = each;
            continue;
        }
        const int64_t start = (pair.one - one.leaves()) * LEAF;
        const int64_t other_start = (pair.other - other.leaves()) * LEAF;
        const int64_t end = std::min(start + LEAF, one.corners.rows());
        for (int64_t j = other_start; j < std::min(other_start + LEAF, other.corners.rows()); j++) {
            double b[9];
            for (int k = 0; k < 3; k++) move_point(pose, &other.corners(j, k, 0), b + 3 * k);
            const Triangle turned = triangle_of(b);
            for (int64_t i = start; i < end; i++) {
                const double *a = one.corners[i].data;
                if (are_apart(triangle_of(a), turned, std::sqrt(best))) continue;
                best = std::min(best, triangle_distance(a, b));
                if (!(best > 0.0)) return 0.0;
            }
        }
    }
    return std::sqrt(best);
}

void distances(Corners corners, Nodes nodes, Corners other_corners, Nodes other_nodes,
               FloatRows<4, 4> poses, Column<double> distance) {
    require(distance.rows() == poses.rows(), "distance must have one row for each pose");
    require_tree(corners, nodes);
    require_tree(other_corners, other_nodes);
    const Body one = {corners, nodes}, other = {other_corners, other_nodes};
    Poll poll(16);
    for (int64_t i = 0; i < poses.rows(); i++)
        if (poll(); distance[i] > 0.0) distance[i] = distance_of(one, other, poses[i], distance[i]);
}

} // namespace
} // namespace mesh

void register_mesh_clearance(nanobind::module_ &m) {
    def(m, "distances", mesh::distances,
        "Lower `distance`, (N,), to that of two bodies under N poses; 0 where they intersect.\n\n"
        "Each is given as corners and nodes of a tree without margin, of triangles with areas.\n"
        "`poses` are those of the second in the frame of the first, rigid motions. Rows that are "
        "0\n"
        "or less stay as they are.",
        "corners", "nodes", "other_corners", "other_nodes", "poses", "distance");
}

} // namespace rastercov
