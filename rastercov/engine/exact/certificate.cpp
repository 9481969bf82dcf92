// Faces that cannot be certified, regions of the others, and decisions over them.
//
// Events are the edges at which the number of surfaces in front may change; `mark_crossed` finds
// the faces that a visible part of one crosses in the image, at or before the face. The remaining
// faces, joined by edges that are no event edges, form regions: a region is wholly visible or
// wholly hidden. Blocks without a crossed face are joined by patches, and only the others face by
// face.
//
// The forest of regions has the patches as its first nodes, of blocks all of whose faces can be
// certified, and after them the faces, of other blocks with a live face. Nodes come in the order of
// their lowest faces, and roots are the lowest node of their region.
//
// A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
// R. E. Tarjan. Efficiency of a Good but not Linear Set Union Algorithm. 1975.
//
// Twins: tests/exact/test_certificate.py.
#include "exact/forest.hpp"
#include "exact/passes.hpp"
#include "exact/setup.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

enum Decision : int32_t { HIDDEN, VISIBLE, IN_DOUBT }; // over a region

using Nodes = Column<int32_t>;

// True if all faces of a block can be certified: they are live, uncrossed, of one side.
bool is_of_a_region(int64_t b, const Projected &projected) {
    return projected.block_state[b] == LIVE && projected.block_side[b] != MIXED;
}

bool is_one_patch(int64_t b, const Blocks &blocks) {
    return blocks.patch_starts[b + 1] - blocks.patch_starts[b] == 1;
}

struct Run {
    int64_t first, stop;
};

// Nodes of a block in the forest of regions.
Run nodes_of(int64_t b, const Projected &projected) {
    const Blocks &blocks = projected.blocks;
    if (is_of_a_region(b, projected)) return {blocks.patch_starts[b], blocks.patch_starts[b + 1]};
    const int64_t first = blocks.lowest.rows() + b * BLOCK;
    if (!(projected.block_state[b] & LIVE)) return {first, first};
    return {first, blocks.lowest.rows() + end_of_block(b, projected)};
}

// Node of a face in the forest of regions, -1 for a face in no region.
int64_t node_of(int64_t f, const Nodes &parent, const Projected &projected) {
    const int64_t b = f / BLOCK, node = projected.blocks.lowest.rows() + f;
    if (is_of_a_region(b, projected)) return projected.blocks.patch[f];
    return projected.block_state[b] & LIVE && parent[node] >= 0 ? node : -1;
}

// True if visibility does not change across an edge that is no event edge. It may if both of its
// faces leave the image and it lies outside, where nothing is checked.
bool is_joint(int64_t e, const View &view) {
    const auto &[edges, camera, uvw, state] =
        std::tie(view.edges, view.camera, view.projected.uvw, view.projected.state);
    if (!(state[edges.faces(e, 0)] & state[edges.faces(e, 1)] & PARTLY)) return true;
    for (int end = 0; end < 2; end++) {
        const int64_t i = edges.vertices(e, end);
        if (0 <= uvw(i, U) && uvw(i, U) <= camera.width && 0 <= uvw(i, V) &&
            uvw(i, V) <= camera.height && uvw(i, W) > 0)
            return true;
    }
    return false;
}

// Joins the region of a node with that of face g beyond an edge, -1 for none, if it may be. A root
// takes the lower parent of both without a jump; nearly always they have the same then.
void join_across(int64_t node, int64_t e, int64_t g, const View &view, const Nodes &parent) {
    if (g < 0) return;
    const int64_t other = node_of(g, parent, view.projected);
    if (other < 0 || !is_joint(e, view)) return;
    int32_t p = parent[node];
    int32_t q = parent[other];
    const int32_t lower = std::min(p, q);
    p = p == node ? lower : p;
    q = q == other ? lower : q;
    parent[node] = p;
    parent[other] = q;
    if (p != q) join(node, other, parent);
}

// Lists the crossed faces; returns their number.
int64_t list_crossed(const Projected &projected, Nodes targets) {
    int64_t n = 0;
    for (int64_t b = 0; b < projected.block_state.rows(); b++) {
        if (!(projected.block_state[b] & CROSSED)) continue;
        for (int64_t f = b * BLOCK; f < std::min((b + 1) * BLOCK, projected.state.rows()); f++)
            if (projected.state[f] & CROSSED) targets[n++] = int32_t(f);
    }
    return n;
}

// Makes f the largest face of region r if it is larger, or equal and lower.
void take_larger(int64_t f, int64_t r, const Column<double> &area, const Nodes &largest) {
    const int64_t g = largest[r];
    if (g < 0 || area[f] > area[g] || (area[f] == area[g] && f < g)) largest[r] = int32_t(f);
}

// Finds the largest face of each region among those that the grid lists in all their cells.
void find_largest_listed(const Projected &projected, const CellGrid &grid, const Nodes &region,
                         const Nodes &largest) {
    const Blocks &blocks = projected.blocks;
    const int64_t n_patches = blocks.lowest.rows();
    int64_t block = -1;
    int64_t of_block = -1;
    bool is_whole = false;
    for (int64_t index = 0; index < grid.n_faces[0]; index++) {
        const int64_t f = grid.faces[index];
        if (f / BLOCK != block) { // the faces of a block follow one another
            block = f / BLOCK;
            of_block = -1;
            is_whole = is_of_a_region(block, projected);
            if (is_whole && is_one_patch(block, blocks))
                of_block = region[blocks.patch_starts[block]];
        }
        if (!grid.is_whole[f] || !(projected.block_state[block] & LIVE)) continue;
        int64_t r = of_block;
        if (r < 0) r = region[is_whole ? blocks.patch[f] : n_patches + f];
        if (r >= 0) take_larger(f, r, projected.area, largest);
    }
}

// Finds the largest face of each region that has none yet, the lowest of equal ones. `largest` has
// -1 for a region of which none is known; is_known is scratch.
void find_largest(const Projected &projected, const Nodes &region, const Nodes &is_known,
                  const Nodes &largest) {
    const Blocks &blocks = projected.blocks;
    const int64_t n_patches = blocks.lowest.rows();
    for (int64_t r = 0; r < largest.rows(); r++) is_known[r] = largest[r] >= 0;
    for (int64_t b = 0; b < projected.block_state.rows(); b++) {
        if (!(projected.block_state[b] & LIVE)) continue;
        const bool is_whole = is_of_a_region(b, projected);
        if (is_whole && is_one_patch(b, blocks) && is_known[region[blocks.patch_starts[b]]])
            continue;
        for (int64_t f = b * BLOCK; f < end_of_block(b, projected); f++) {
            const int64_t r = region[is_whole ? blocks.patch[f] : n_patches + f];
            if (r >= 0 && !is_known[r]) take_larger(f, r, projected.area, largest);
        }
    }
}

// Visits the nodes of all blocks, from `least` on.
template <class Visit> void each_node(const Projected &projected, int64_t least, Visit visit) {
    for (int64_t b = 0; b < projected.block_state.rows(); b++) {
        const auto [first, stop] = nodes_of(b, projected);
        for (int64_t node = std::max(first, least); node < stop; node++) visit(node);
    }
}

// Plants the forest of regions, without numbers; joins the patches of blocks that are whole.
void join_blocks(const Projected &projected, const Nodes &parent, const Nodes &region) {
    const Blocks &blocks = projected.blocks;
    const int64_t n_patches = blocks.lowest.rows();
    each_node(projected, 0, [&](int64_t node) {
        const bool is_in =
            node < n_patches || (projected.state[node - n_patches] & (LIVE | CROSSED)) == LIVE;
        parent[node] = is_in ? int32_t(node) : -1;
        region[node] = -1;
    });
    for (int64_t k = 0; k < blocks.joins.rows(); k++) {
        const bool is_reversed = blocks.joins(k, 1) < 0;
        const int64_t c = blocks.joins(k, 0),
                      d = is_reversed ? ~blocks.joins(k, 1) : blocks.joins(k, 1);
        const int64_t its = blocks.of_patch[c], other = blocks.of_patch[d];
        const int side = projected.block_side[other];
        if (projected.block_side[its] == (is_reversed ? -side : side) &&
            is_of_a_region(its, projected) && is_of_a_region(other, projected) &&
            parent[c] != parent[d])
            join(c, d, parent);
    }
}

// Joins the faces of other blocks with those beside them along edges that are no event edges.
void join_faces(const View &view, const Nodes &parent) {
    const int64_t n_patches = view.projected.blocks.lowest.rows();
    each_node(view.projected, n_patches, [&](int64_t node) {
        const int64_t f = node - n_patches;
        for (int s = 0; s < 3 && parent[node] >= 0; s++) {
            const int64_t e = view.edges.of_face(f, s), g = view.edges.faces(e, 0),
                          h = view.edges.faces(e, 1);
            // Once: from the first of its faces, unless the block of that is whole.
            if ((g == f || is_of_a_region(g / BLOCK, view.projected)) && !view.is_event[e])
                join_across(node, e, g == f ? h : g, view, parent);
        }
    });
}

// Numbers the trees of the forest by their lowest faces; returns how many there are.
int64_t number_regions(const Projected &projected, const Nodes &parent, const Nodes &region) {
    int64_t n = 0;
    each_node(projected, 0, [&](int64_t node) {
        if (parent[node] < 0) return;
        const int64_t root = root_of(parent, node);
        if (region[root] < 0) region[root] = int32_t(n++);
        region[node] = region[root];
    });
    return n;
}

} // namespace

// Collects the uncrossed faces into regions; the number of crossed faces, and of regions. A forest
// of faces is joined edge by edge; in blocks that no event edge comes near, patch by patch.
//
// `view` has CROSSED in the states of faces and blocks. Faces that the grid lists in all their
// cells are preferred as the largest of a region. is_hidden is that of mark_crossed: what hides an
// event edge hides both of its faces. `parent` is scratch. Out: `region`, the number of each
// patch's region, in blocks all of whose faces can be certified; and of each face's region, -1 for
// none, in other blocks with a live face; `out`, the crossed faces, and after them the largest face
// of each region, of those that are listed if any is.
std::pair<int64_t, int64_t> find_regions(Int32Array events, BoolArray is_hidden, const View &view,
                                         Nodes parent, Nodes region, Nodes out) {
    const int64_t n_crossed = list_crossed(view.projected, out);
    join_blocks(view.projected, parent, region);
    join_faces(view, parent);
    for (const int32_t e : events) {
        if (!is_hidden[e]) continue;
        const int64_t node = node_of(view.edges.faces(e, 0), parent, view.projected);
        if (node >= 0) join_across(node, e, view.edges.faces(e, 1), view, parent);
    }
    const int64_t n = number_regions(view.projected, parent, region);
    const Nodes largest = {out.data + n_crossed, {n}};
    std::fill(largest.begin(), largest.end(), -1);
    find_largest_listed(view.projected, view.grid, region, largest);
    if (std::find(largest.begin(), largest.end(), -1) != largest.end())
        find_largest(view.projected, region, parent, largest);
    return {n_crossed, n};
}

// Marks the live faces that cannot be certified, whether an edge crosses them or not: CROSSED is
// added to the states of blocks and, with UNFIT or IN_CONTACT, of faces. The faces in contact get
// boxes.
//
// These are faces that are clipped in space, in contact with another, or as thin as a line, of less
// than `thinnest` pixels; and faces across the image border with a corner on an event edge. There
// the face may be folded onto another one so that inside the image, but not beyond it, both have
// the same depth. in_contact and has_contact are faces that another one touches or cuts, and blocks
// with such a face, n_partners how many a face has; is_at_event is scratch.
void mark_uncertifiable(Int32Array events, const Edges &edges, const Projected &projected,
                        BoolArray in_contact, BoolArray has_contact, IntArray partner_starts,
                        double thinnest, Column<bool> is_at_event) {
    std::fill(is_at_event.begin(), is_at_event.end(), false);
    for (const int32_t e : events)
        is_at_event[edges.vertices(e, 0)] = is_at_event[edges.vertices(e, 1)] = true;
    for (int64_t b = 0; b < has_contact.rows(); b++) {
        if (!(has_contact[b] || projected.block_state[b] & uint16_t(~(LIVE | ABSENT)))) continue;
        lay_boxes_of_block(b, projected);
        for (int64_t f = b * BLOCK; f < end_of_block(b, projected); f++) {
            if (projected.state[f] & LIVE) {
                const double extent = bounds_in(projected.box, f).around();
                bool is_unfit =
                    projected.state[f] & CLIPPED || projected.area[f] < thinnest * extent;
                if (projected.state[f] & PARTLY && !is_unfit)
                    is_unfit = is_at_event[projected.faces(f, 0)] ||
                               is_at_event[projected.faces(f, 1)] ||
                               is_at_event[projected.faces(f, 2)];
                if (in_contact[f]) {
                    projected.state[f] |= CROSSED | IN_CONTACT;
                    is_unfit = is_unfit || partner_starts[f] == partner_starts[f + 1];
                }
                if (is_unfit) projected.state[f] |= CROSSED | UNFIT;
            } else if (projected.state[f] & THIN) {
                projected.state[f] |= CROSSED | UNFIT; // so that its area error is computed
            }
            projected.block_state[b] |= projected.state[f] & CROSSED;
        }
    }
}

// Classifies each face of a region like its largest; the number of faces that remain in doubt.
//
// `visible`, px^2, in: of the largest faces; out: of all faces of regions that are not in doubt,
// and 0 of those that are not in view. Out, too: is_certified, these faces; `doubtful`, faces of
// regions whose largest face is neither wholly visible nor wholly hidden. `certain` is the
// tolerance of that decision, relative to the area of the largest face; `decision` is scratch.
int64_t classify_regions(const Projected &projected, Column<double> visible, Int32Array region,
                         Int32Array largest, Column<int32_t> decision, Column<bool> is_certified,
                         Column<int32_t> doubtful, double certain) {
    const int64_t n_patches = projected.blocks.lowest.rows();
    std::fill(is_certified.begin(), is_certified.end(), false);
    for (int64_t r = 0; r < largest.rows(); r++) {
        const int64_t t = largest[r];
        const bool is_visible = visible[t] >= (1 - certain) * projected.area[t];
        const bool is_hidden = visible[t] <= certain * projected.area[t];
        decision[r] = is_visible ? VISIBLE : is_hidden ? HIDDEN : IN_DOUBT;
    }
    int64_t n = 0;
    for (int64_t b = 0; b < projected.block_state.rows(); b++) {
        const int64_t first = b * BLOCK, last = end_of_block(b, projected);
        if (!(projected.block_state[b] & LIVE)) {
            for (int64_t f = first; f < last; f++)
                if (!(projected.state[f] & THIN)) visible[f] = 0.0;
            continue;
        }
        const bool is_whole = is_of_a_region(b, projected);
        if (is_whole && is_one_patch(b, projected.blocks)) {
            const int32_t decided = decision[region[projected.blocks.patch_starts[b]]];
            if (decided != IN_DOUBT) {
                for (int64_t f = first; f < last; f++) {
                    is_certified[f] = true;
                    visible[f] = decided == VISIBLE ? projected.area[f] : 0.0;
                }
                continue;
            }
        }
        for (int64_t f = first; f < last; f++) {
            const int64_t r = region[is_whole ? projected.blocks.patch[f] : n_patches + f];
            if (r < 0) {
                if (!(projected.state[f] & (LIVE | THIN))) visible[f] = 0.0;
            } else if (decision[r] != IN_DOUBT) {
                visible[f] = decision[r] == VISIBLE ? projected.area[f] : 0.0;
                is_certified[f] = true;
            } else if (f != largest[r]) {
                doubtful[n++] = int32_t(f);
            }
        }
    }
    return n;
}

} // namespace exact
} // namespace rastercov
