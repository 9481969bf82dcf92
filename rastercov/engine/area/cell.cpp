// Cells of faces by bisection of the longest side, and their shares of regions.
//
// The cells of a face are the leaves of a binary tree: a triangle with a side longer than the
// wanted size is halved from the middle of its longest side. Nodes are numbered in preorder, so
// that the left child of node i is i + 1 and the right one i + 2 n, n being the leaves below the
// left one; the tree is stored as the number of leaves below each node.
//
// M.-C. Rivara. Algorithms for Refining Triangular Grids Suitable for Adaptive and Multigrid
// Techniques. 1984.
//
// Invariants: the leaves of both children of a node are those of the node; a polygon is cut by one
// evaluation of a line into its parts on both sides, which share corners to the bit.
//
// Twins: tests/area/test_cells.py.
#include "area/polygon.hpp"
#include "bind.hpp"
#include "interrupt.hpp"
#include <tuple>
#include <vector>

namespace rastercov {
namespace area {
namespace {

using exact::copy_polygon, exact::split, exact::twice_area;
using exact::Line, exact::PIECE_ROOM, exact::Points, exact::U, exact::V;
using Faces = FloatRows<3, 2>; // corners in their planes

constexpr int64_t DEEPEST = 128; // levels of a tree; each halves the area
// Part of the area of a node that may be missing from what counts as all of it.
constexpr double WHOLE_REL = 1e-12;
constexpr double SMALLEST_SHARE = 1e-12; // of a cell: less is rounding along a side of it

struct Trees {
    Faces corners;
    Starts first_cell, first_node;
    Int32Array leaves;
    FloatArray areas;
};

struct Corner {
    double u, v;
};
struct Triangle {
    Corner a, b, c;
    void copy_to(Points target) const {
        target(0, U) = a.u;
        target(0, V) = a.v;
        target(1, U) = b.u;
        target(1, V) = b.v;
        target(2, U) = c.u;
        target(2, V) = c.v;
    }
    double twice_area() const {
        return 0.0 + ((b.u - a.u) * (c.v - a.v) - (c.u - a.u) * (b.v - a.v));
    }
};

Triangle triangle_of(const Faces &corners, int64_t f) {
    const auto at = [&](int p) { return Corner{corners(f, p, U), corners(f, p, V)}; };
    return {at(0), at(1), at(2)};
}

// Turns a triangle so that its longest side, the first of equals, is that from a to b; its squared
// length.
double turn_to_longest(Triangle &triangle) {
    const auto [a, b, c] = triangle;
    const auto squared = [](const Corner &p, const Corner &q) {
        const double x = q.u - p.u, y = q.v - p.v;
        return x * x + y * y;
    };
    const double first = squared(a, b), second = squared(b, c), third = squared(c, a);
    if (first >= second && first >= third) return first;
    if (second >= third) {
        triangle = {b, c, a};
        return second;
    }
    triangle = {c, a, b};
    return third;
}

struct Halves {
    Triangle first, second;
};

// Halves of a triangle, which was turned, from the middle of its longest side.
Halves halves_of(const Triangle &triangle) {
    const auto [a, b, c] = triangle;
    const Corner middle = {(a.u + b.u) / 2, (a.v + b.v) / 2};
    return {{c, a, middle}, {c, middle, b}};
}

// Calls `visit(triangle, is_leaf)` for each node of a face in preorder, until it says false.
template <class Visit> bool visit_nodes(const Faces &corners, int64_t f, double size, Visit visit) {
    Triangle waiting[DEEPEST + 1], triangle = triangle_of(corners, f);
    const double longest = size * size;
    for (int64_t n_waiting = 0;;) {
        Triangle turned = triangle;
        const bool is_leaf = !(turn_to_longest(turned) > longest && n_waiting < DEEPEST);
        if (!visit(triangle, is_leaf)) return false;
        if (!is_leaf) {
            const auto [first, second] = halves_of(turned);
            waiting[n_waiting++] = second;
            triangle = first;
        } else if (n_waiting > 0) {
            triangle = waiting[--n_waiting];
        } else {
            return true;
        }
    }
}

// Counts the cells of each face that is asked for, without sides longer than `size`; returns the
// number of all, or some number above `most`.
int64_t count_cells(Faces corners, BoolArray is_asked, double size, int64_t most,
                    Column<int64_t> counts) {
    require(have_rows(corners.rows(), is_asked, counts),
            "is_asked and counts must have one row for each face");
    int64_t total = 0;
    Poll poll(64);
    for (int64_t f = 0; f < corners.rows(); f++) {
        poll();
        int64_t &count = counts[f] = 0;
        if (!is_asked[f]) continue;
        visit_nodes(corners, f, size, [&](const Triangle &, bool is_leaf) {
            count += is_leaf;
            return total + count <= most;
        });
        total += count;
        if (total > most) break;
    }
    return total;
}

// Fills the trees of all faces: the leaves below each node, the areas of the cells in m^2, and
// their corners, `cells`. `first_cell` and `first_node` follow from the counts of count_cells.
void fill_cells(Faces corners, BoolArray is_asked, double size, Starts first_cell,
                Starts first_node, Column<int32_t> leaves, Column<double> areas,
                Array<double, Any, 3, 2> cells) {
    const int64_t n = corners.rows();
    require(is_asked.rows() == n && areas.rows() == cells.rows(),
            "is_asked must have one row for each face, and areas one for each cell");
    require_starts(first_cell, n, cells.rows(), "first_cell must rise, within the cells");
    require_starts(first_node, n, leaves.rows(), "first_node must rise, within the leaves");
    Poll poll(64);
    for (int64_t f = 0; f < n; f++) {
        poll();
        if (!is_asked[f]) continue;
        const int64_t first = first_node[f], end = first_node[f + 1], last_cell = first_cell[f + 1];
        int64_t node = first;
        int64_t cell = first_cell[f];
        const auto fill = [&](const Triangle &triangle, bool is_leaf) {
            if (node == end || (is_leaf && cell == last_cell)) return false;
            leaves[node++] = is_leaf;
            if (is_leaf) {
                triangle.copy_to({cells[cell].data, {3, 2}});
                areas[cell++] = triangle.twice_area() / 2;
            }
            return true;
        };
        require(visit_nodes(corners, f, size, fill) && cell == last_cell,
                "first_cell and first_node must be those of the cells of this size");
        // Backwards, the leaves below both children of a node are the last two that wait.
        int32_t waiting[DEEPEST + 2];
        for (int64_t top = 0; node-- > first; top++) {
            if (leaves[node]) {
                waiting[top] = 1;
                continue;
            }
            top -= 2;
            leaves[node] = waiting[top] += waiting[top + 1];
        }
    }
}

// A node of the tree of a face, and the part of a piece that lies in it.
struct Part {
    Triangle triangle;
    int64_t node, cell, n_corners;
    double corners[PIECE_ROOM * 2];
    Points polygon() { return {corners, {PIECE_ROOM, 2}}; }
};
using Stack = std::vector<Part>; // of DEEPEST + 2

// Divides what lies in a node at the first child, node + 1, with `left` cells, which `half` takes,
// and the second one, which `part` takes; the number of children that have some of it. Where that
// is one, it is `part`.
int64_t halve(Part &part, Part &half, int64_t left) {
    double values[PIECE_ROOM], spare[PIECE_ROOM * 2];
    const Points whole = {spare, {PIECE_ROOM, 2}};
    const auto [node, cell, n] = std::tuple(part.node, part.cell, part.n_corners);
    Triangle turned = part.triangle;
    turn_to_longest(turned);
    const auto [first_half, second_half] = halves_of(turned);
    // The first half is on the right of the line from the opposite corner to the middle.
    const auto &[opposite, start, middle] = first_half;
    const Line line = {opposite.u, opposite.v, middle.u - opposite.u, middle.v - opposite.v, 0.0};
    copy_polygon(part.polygon(), n, whole);
    for (int64_t p = 0; p < n; p++) values[p] = line.value(whole(p, U), whole(p, V));
    const auto [inside, outside] =
        split(whole, n, {values, {PIECE_ROOM}}, part.polygon(), half.polygon());
    const bool is_first_only = outside >= 3 && inside < 3;
    if (is_first_only) copy_polygon(half.polygon(), outside, part.polygon());
    Part &first = is_first_only ? part : half;
    part.triangle = second_half;
    part.n_corners = inside;
    part.node = node + 2 * left;
    part.cell = cell + left;
    first.triangle = first_half;
    first.n_corners = outside;
    first.node = node + 1;
    first.cell = cell;
    return (inside >= 3) + (outside >= 3);
}

// Adds a piece of face f to the covered area of its cells.
void add_to_cells(int64_t f, const double *piece, int64_t n_corners, const Trees &trees,
                  Stack &stack, std::vector<double> &covered) {
    const int64_t first_cell = trees.first_cell[f], n_cells = trees.first_cell[f + 1] - first_cell;
    const int64_t first_node = trees.first_node[f], n_nodes = trees.first_node[f + 1] - first_node;
    const char *const wanted = "trees must be those of fill_cells";
    require(n_nodes > 0 && trees.leaves[first_node] == n_cells, wanted);
    stack[0].triangle = triangle_of(trees.corners, f);
    stack[0].node = stack[0].cell = 0;
    stack[0].n_corners = n_corners;
    std::copy(piece, piece + 2 * n_corners, stack[0].corners);
    for (int64_t top = 1; top > 0;) {
        Part &part = stack[top - 1];
        const int64_t node = part.node, cell = part.cell, leaves = trees.leaves[first_node + node];
        const double area = twice_area(part.polygon(), part.n_corners) / 2;
        if (leaves == 1) {
            covered[cell] += std::max(area, 0.0);
            top--;
            continue;
        }
        if (area >= (1 - WHOLE_REL) * part.triangle.twice_area() / 2) {
            for (int64_t c = cell; c < cell + leaves; c++)
                covered[c] += trees.areas[first_cell + c];
            top--;
            continue;
        }
        const int64_t left = node + 1 < n_nodes ? trees.leaves[first_node + node + 1] : 0;
        const int64_t right = node + 2 * left;
        require(left > 0 && left < leaves && right < n_nodes && top <= DEEPEST &&
                    trees.leaves[first_node + right] == leaves - left,
                wanted);
        top += halve(part, stack[top], left) - 1;
    }
}

// Shares of the pieces first ... last - 1, ordered by face, appended to `used` of them; returns the
// number of all. Where it is more than there is room for, call again with that much.
int64_t find_shares(const PieceTable &pieces, int64_t first, int64_t last, const Trees &trees,
                    Column<int32_t> cell, Column<double> share, int64_t used) {
    const auto &[xy, starts, face] = pieces;
    const int64_t n_faces = trees.corners.rows();
    require(starts.rows() == face.rows() + 1, "starts must have one row for each piece, and one");
    require(first >= 0 && first <= last && last <= face.rows() && used >= 0,
            "first ... last - 1 must be pieces, and used a number");
    require(cell.rows() == share.rows(), "cell and share must have one row for each pair");
    require_indices(Int32Array{face.data + first, {last - first}}, n_faces, "face must hold faces");
    require(have_rows(n_faces + 1, trees.first_cell, trees.first_node),
            "first_cell and first_node must have one row for each face, and one");
    Stack stack(last > first ? DEEPEST + 2 : 0);
    std::vector<double> covered;
    int64_t count = used;
    Poll poll(64);
    for (int64_t at = first; at < last;) {
        const int64_t f = face[at], begin = trees.first_cell[f], end = trees.first_cell[f + 1];
        require(begin >= 0 && begin <= end && end <= trees.areas.rows() &&
                    trees.first_node[f] >= 0 && trees.first_node[f] <= trees.first_node[f + 1] &&
                    trees.first_node[f + 1] <= trees.leaves.rows(),
                "first_cell and first_node must rise, within the cells and leaves");
        covered.assign(end - begin, 0.0);
        for (; at < last && face[at] == f; at++) {
            poll();
            const int64_t n = corners_of(at, starts, xy.rows());
            add_to_cells(f, xy.data + 2 * starts[at], n, trees, stack, covered);
        }
        for (int64_t c = begin; c < end; c++) {
            if (!(covered[c - begin] > SMALLEST_SHARE * trees.areas[c])) continue;
            if (count < cell.rows()) {
                cell[count] = int32_t(c);
                share[count] = std::min(covered[c - begin] / trees.areas[c], 1.0);
            }
            count++;
        }
    }
    return count;
}

} // namespace
} // namespace area

RECORD(area::Trees, corners, first_cell, first_node, leaves, areas);

void register_area_cell(nanobind::module_ &m) {
    using namespace area;
    def(m, "count_cells", count_cells,
        "Count the cells of each face; the number of all, or some number above `most`.", "corners",
        "is_asked", "size", "most", "counts");
    def(m, "fill_cells", fill_cells,
        "Fill the trees of all faces: leaves below each node, areas and corners of the cells.",
        "corners", "is_asked", "size", "first_cell", "first_node", "leaves", "areas", "cells");
    def(m, "find_shares", find_shares,
        "Shares of the pieces first ... last - 1, ordered by face, appended to those `used`; the "
        "number of all, perhaps more than there is room for.",
        "pieces", "first", "last", "trees", "cell", "share", "used");
}

} // namespace rastercov
