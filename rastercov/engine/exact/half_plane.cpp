// Visible areas by half planes.
//
// One pose runs through four passes: `project` and `set_up`; `fill_grid`; and `visible_areas`,
// which takes one face at a time, finds its occluders in the grid cells it touches, and subtracts
// from its image the part that each of them hides.
//
// Subtracting a convex polygon from a convex piece leaves convex pieces: each of its sides slices
// off the part beyond it. The pieces of T partition its visible part, whatever the order of the
// occluders; a misjudged cut misplaces area, it never loses any, so that the error is of the order
// of the rounding. No topology is kept that could become inconsistent.
//
// A target is scored but hides nothing, so no event edge of it exists: what is visible of it
// follows from the opaque faces in front of it. They alone are listed in the grid.
//
// A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
//
// Twins: rastercov.reference.polygons, by Boolean operations of shapely.
#include "exact/half_plane.hpp"
#include "exact/passes.hpp"
#include "interrupt.hpp"
#include <tuple>
#include <vector>

namespace rastercov {
namespace exact {
namespace {

// Cells of the grid that a face covers, beyond which it is taken apart by them.
constexpr int64_t MOST_CELLS_OF_PART = 12;
// Pieces of a part of a face beyond which it is halved: each occluder is taken from each piece.
constexpr int64_t MOST_PIECES = 48;
// Times that a part is halved: occluders with a common corner are not separated by any number.
constexpr int64_t MOST_HALVINGS = 6;
// Width of a strip in which the depth order is unknown, in roundings of a position, from which on
// it is found in pairs of doubles.
constexpr double WIDE_STRIP = 1024;
constexpr size_t N_PLANES = 256; // of faces in pairs of doubles that are kept
constexpr int32_t MOST_NUMBERS = std::numeric_limits<int32_t>::max(); // of targets, see take_number

// Lines that bound a cell of the grid; those at the border of the grid bound nothing.
void lines_of_cell(int64_t column, int64_t row, const CellGrid &grid, Lines lines) {
    const double left = grid.left + column / grid.per_u,
                 right = grid.left + (column + 1) / grid.per_u;
    const double top = grid.top + row / grid.per_v, bottom = grid.top + (row + 1) / grid.per_v;
    store_line({left, 0.0, 0.0, -1.0, column > 0 ? 0.0 : INF}, lines, 0);
    store_line({right, 0.0, 0.0, 1.0, column + 1 < grid.columns ? 0.0 : INF}, lines, 1);
    store_line({0.0, top, 1.0, 0.0, row > 0 ? 0.0 : INF}, lines, 2);
    store_line({0.0, bottom, -1.0, 0.0, row + 1 < grid.rows ? 0.0 : INF}, lines, 3);
}

// What is left of a part of a face: something; nothing; too many pieces for the memory; nothing of
// all of the face, which one face hides.
enum class Rest { SOME, NONE, NO_ROOM, ALL_HIDDEN };

// A convex part of the image of face t, whose n corners work.target has, and its lines work.own.
struct PartOfFace {
    int64_t t, n, n_own;
    Points corners;
    int64_t n_corners;
    const View &view;
    Bounds extent;
    Plane plane;
};

PartOfFace part_of(int64_t t, const Outline &image, Points corners, int64_t n, const View &view) {
    return {t,
            image.n_corners,
            image.n_lines,
            corners,
            n,
            view,
            extent_of(corners, n),
            plane_of(t, view.camera, view.projected)};
}

// Face m beside a face of which it may hide something: the depth order, the line of equal depth
// where it is in front in part, and what of the order is in doubt, px^2; is_new if m is DOUBTFUL
// and was not taken before.
struct Occluder {
    int64_t m;
    Order order;
    Line equal;
    double in_doubt;
    bool is_new;
};

// Plane n . X = d of a face in camera axes, in pairs of doubles; the largest errors of n and of d.
struct PairPlane {
    Pair n[3], d;
    double n_error, d_error, n_size;
    int64_t f = -1; // the face
};

// Memory for all faces of a pose: the occluders of a face, and lists of them for its parts; planes
// of some faces, each in the row of its number.
struct Scratch {
    Column<int32_t> marks;
    const Pieces &pieces;
    Vertices vertices;
    Poll &poll;
    std::vector<Occluder> occluders;
    std::vector<int32_t> lists;
    std::vector<PairPlane> planes;
};

// What is left of a part while faces are taken from it.
struct Left {
    int64_t count, last; // pieces; the last face that hides something, -1 for none
    bool has_many;       // some of these were in a cell of MANY
    int64_t limit;       // pieces beyond which it is halved: the rest of its occluders are listed
    Scratch &scratch;
};

// Lines that have faces on their outer side which hide nothing more of a part: for each of its
// pieces some, or, of more than FEW_PIECES, three sides of its face; and a box around them.
struct Separators {
    static constexpr int64_t FEW_PIECES = 16;
    Line lines[FEW_PIECES * PIECE_ROOM];
    int64_t n_pieces, stops[FEW_PIECES];
    Bounds box;

    // Sides of slivers may have a part of them beyond, by rounding: these are no such lines. The
    // others are moved inwards by rounding; long ones by that of a corner that many faces have, so
    // that they pass through it no more.
    void lay(const PartOfFace &part, const Left &left) {
        const double rounding = part.view.camera.pixel_error,
                     reach = rounding * bounds_in(part.view.projected.box, part.t).around();
        n_pieces = left.count > FEW_PIECES ? 1 : left.count;
        int64_t n = 0;
        box = {INF, -INF, INF, -INF};
        for (int64_t p = 0; p < left.count && left.count <= FEW_PIECES; p++) {
            const Points corners = left.scratch.pieces.corners[p];
            const int64_t k = left.scratch.pieces.n_corners[p];
            const Bounds its = extent_of(corners, k);
            box = {std::min(box.u_min, its.u_min), std::max(box.u_max, its.u_max),
                   std::min(box.v_min, its.v_min), std::max(box.v_max, its.v_max)};
            for (int64_t s = 0; s < k; s++) {
                Line line = side_at(corners, k, s);
                const double slack = slack_of(line, rounding);
                const double least =
                    values_on_line(corners, k, line, slack, part.view.work.values).least;
                if (least < 0 || slack == 0) continue; // a side without length has all beyond it
                const bool is_long = 2 * slack >= rounding * its.around();
                line.offset -= is_long ? std::max(slack, reach) : slack;
                lines[n++] = line;
            }
            stops[p] = n;
        }
        if (left.count <= FEW_PIECES) return;
        box = part.extent;
        for (int64_t s = 0; s < 3; s++) lines[s] = line_at(part.view.work.own, s);
        stops[0] = 3;
    }

    // True if something may hide a piece; most_at gives the greatest value of a line at its
    // corners.
    template <class MostAt> bool leave(MostAt most_at) const {
        int64_t k = 0;
        for (int64_t p = 0; p < n_pieces; p++) {
            bool is_beyond = false;
            for (; k < stops[p] && !is_beyond; k++) is_beyond = most_at(lines[k]) <= 0;
            if (!is_beyond) return true;
            k = stops[p];
        }
        return false;
    }
};

// True if face t has what all faces of a group have at a corner: a vertex, or an edge.
bool has(int64_t t, int32_t common, const View &view) {
    const auto &faces = view.projected.faces;
    if (common >= -1 || t >= view.edges.of_face.rows())
        return common == faces(t, 0) || common == faces(t, 1) || common == faces(t, 2);
    const auto edges = view.edges.of_face[t];
    return common == on_edge(edges[0]) || common == on_edge(edges[1]) ||
           common == on_edge(edges[2]);
}

// True if all faces of a group are surely behind a part: its plane, which is off by more the
// farther it is from the face, is before all of their corners that the face does not have.
bool is_behind(const PartOfFace &part, const Group &group) {
    const bool is_clipped = part.n_own != 3;
    const auto &own = part.view.work.own;
    const double twice = is_clipped ? 1.0 : std::abs(line_at(own, 0).value(own(2, U), own(2, V)));
    for (const auto &[at, common] : group.all_corners()) {
        if (has(part.t, common, part.view)) continue;
        for (const double u : {at[U].least, at[U].most})
            for (const double v : {at[V].least, at[V].most}) {
                const auto [w, size] = part.plane.at(u, v);
                // Of the corners of the face, from which the plane is known; where it is clipped,
                // that is off in proportion to 1/z beyond the nearest.
                double shares =
                    is_clipped ? std::max(1.0, size / part.view.projected.box(part.t, W_MAX)) : 0.0;
                for (int s = 0; s < 3 && !is_clipped; s++)
                    shares += std::abs(line_at(own, s).value(u, v));
                const double error = part.plane.error * shares + 4 * DEPTH_TIE_REL * size * twice;
                if (!((w - at[W].most) * twice > error)) return false;
            }
    }
    return true;
}

// Takes the faces listed in a cell of MANY, those near a part first, until `take` returns true;
// true if it does. Faces that do not meet what is left are passed over: of pages about one edge the
// next one before a page hides what all the others hide.
template <class Take>
bool any_of_many(const PartOfFace &part, int64_t at, double farthest, const Left &left, Take take) {
    const View &view = part.view;
    const CellGrid &grid = view.grid;
    Separators separators;
    separators.lay(part, left);
    lay_bounds(at, view);
    double keys[KEYS];
    const double per_w = group_at(all_groups(at, grid), grid).per_w;
    for (int axis = 0; axis < KEYS; axis++)
        keys[axis] = key_of(part.t, axis, per_w, view.projected);
    const auto may = [&](const Group &group, const Place &) {
        return touches(group, separators.box, {farthest, -INF, INF}) &&
               separators.leave(
                   [&](const Line &line) { return values_at_corners(group, line).most; }) &&
               !is_behind(part, group);
    };
    int32_t *const front = group_at(all_groups(at, grid), grid).front;
    const auto takes = [&](int64_t entry) {
        const int64_t before = left.last;
        const bool leaves = separators.leave(
            [&](const Line &line) { return values_at_corners(entry, line, grid).most; });
        view.work.n_compared[0] += leaves;
        if (leaves && take(grid.entries[entry])) return true;
        if (left.last != before) separators.lay(part, left);
        return false;
    };
    const auto remember = [&](int64_t entry) {
        int k = 0;
        while (k < FRONT - 1 && front[k] != entry) k++;
        std::copy_backward(front, front + k, front + k + 1);
        front[0] = int32_t(entry);
        return true;
    };
    for (int k = 0; k < FRONT && front[k] >= 0; k++)
        if (takes(front[k])) return remember(front[k]);
    for (Walk walk(at, grid, keys); walk.next(may);) {
        // Outwards from the place of the part among them.
        const double *const sorted = grid.nearest.data,
                            key = walk.axis < 0 ? -INF : keys[walk.axis];
        int64_t upper = walk.first;
        if (walk.axis >= 0)
            upper = std::lower_bound(sorted + walk.first, sorted + walk.last, key) - sorted;
        for (int64_t lower = upper; lower > walk.first || upper < walk.last;) {
            const bool is_above =
                lower == walk.first ||
                (upper < walk.last && sorted[upper] - key < key - sorted[lower - 1]);
            const int64_t entry = is_above ? upper++ : --lower;
            if (takes(entry)) return remember(entry);
        }
    }
    return false;
}

// Takes the faces listed in some cells whose boxes overlap a part, each once, from front to back in
// each cell, but see any_of_many, until `take` returns true; true if it does.
template <class Take>
bool any_near(const PartOfFace &part, const Cells &cells, Left &left, Take take) {
    const View &view = part.view;
    const auto &[box, grid, own] = std::tie(view.projected.box, view.grid, view.work.own);
    const double farthest = box(part.t, W_MIN) * (1 - 2 * DEPTH_TIE_REL);
    for (int64_t row = cells.top; row <= cells.bottom; row++)
        for (int64_t column = cells.left; column <= cells.right; column++) {
            const auto takes = [&](int64_t m) {
                const Bounds its = bounds_in(box, m);
                if (m == part.t || are_apart(its, part.extent)) return false;
                // In the first of the cells that list it.
                return column == std::max(column_at(its.u_min, grid), cells.left) &&
                       row == std::max(row_at(its.v_min, grid), cells.top) &&
                       !separates_box(own, part.n_own, its) && take(m);
            };
            const int64_t at = row * grid.columns + column, stop = grid.stops[at];
            if (stop - grid.starts[at] > MANY) {
                left.has_many = true;
                if (any_of_many(part, at, farthest, left, takes)) return true;
                continue;
            }
            if (!grid.is_sorted[at]) sort_cell(at, box, grid);
            for (int64_t entry = grid.starts[at]; entry < stop; entry++) {
                if (grid.nearest[entry] < farthest) break;
                if (takes(grid.entries[entry])) return true;
            }
        }
    return false;
}

// True if the plane of a part, where it is farthest within the box of a face, is before that face:
// most faces that are before it somewhere are far behind it there.
bool is_before(const PartOfFace &part, int64_t m) {
    const auto &box = part.view.projected.box;
    const double u = part.plane.a > 0 ? std::max(box(m, U_MIN), part.extent.u_min)
                                      : std::min(box(m, U_MAX), part.extent.u_max);
    const double v = part.plane.b > 0 ? std::max(box(m, V_MIN), part.extent.v_min)
                                      : std::min(box(m, V_MAX), part.extent.v_max);
    const auto [w, size] = part.plane.at(u, v);
    return box(m, W_MAX) < w - (part.plane.error + 4 * DEPTH_TIE_REL * size);
}

// Memory for the image of a face and what is beside it.
struct Images {
    double rows[(2 * CORNERS + CORNERS + 2 * PIECE_ROOM) * 2], lines[2 * SIDES * 5];
    Points target() { return {rows, {2 * CORNERS, 2}}; }
    Points corners() { return {rows + 4 * CORNERS, {CORNERS, 2}}; }
    Points overlap() { return {rows + 6 * CORNERS, {PIECE_ROOM, 2}}; }
    Points spare() { return {rows + 6 * CORNERS + 2 * PIECE_ROOM, {PIECE_ROOM, 2}}; }
    Lines own() { return {lines, {SIDES, 5}}; }
    Lines its() { return {lines + SIDES * 5, {SIDES, 5}}; }
};

// Ties that two faces are apart at most that both coincide with a third, and rounding.
constexpr double MOST_TIES = 2.01;

enum Closeness { APART, CLOSE, AMBIGUOUS }; // of two faces, see is_loose

// Closeness of face m to face f.
Closeness closeness(int64_t f, int64_t n, int64_t n_own, int64_t m, const View &view,
                    Images &images) {
    const auto &box = view.projected.box;
    if (box(m, W_MAX) < box(f, W_MIN) * (1 - NEARLY_REL) ||
        box(f, W_MAX) < box(m, W_MIN) * (1 - NEARLY_REL) || !(view.projected.state[m] & LIVE) ||
        shared_corners(f, m, view.projected.faces) == 2)
        return APART;
    const auto [k, n_sides] = outline(m, view.projected, images.corners(), images.its());
    if (separates(images.its(), n_sides, images.target(), n) ||
        separates(images.own(), n_own, images.corners(), k))
        return APART;
    copy_polygon(images.target(), n, images.overlap());
    const Plane plane = plane_of(f, view.camera, view.projected),
                its = plane_of(m, view.camera, view.projected);
    const Gap gap =
        gap_between(plane, its, images.overlap(), n, images.its(), n_sides, images.spare());
    if (gap.n < 3) return APART;
    if (gap.apart <= 0)
        return std::max(gap.most, -gap.least) > plane.error + its.error ? CLOSE : APART;
    const auto [least, most] = gap.ties;
    return std::max(most, -least) * DEPTH_TIE_REL <= NEARLY_REL &&
                   std::max(least, -most) <= MOST_TIES
               ? AMBIGUOUS
               : APART;
}

// Closeness of all faces of a group to a face, in a rectangle within a cell: CLOSE where they
// surely coincide; APART where that is up to rounding, or they are surely more than `far` before or
// behind it.
Closeness closeness_of_group(const Group &group, const Plane &plane, const Bounds &rectangle,
                             double far) {
    const Slab &slab = group.slab;
    bool is_close = true;
    Range all;
    for (const double u : {rectangle.u_min, rectangle.u_max})
        for (const double v : {rectangle.v_min, rectangle.v_max}) {
            const double w = plane.at(u, v).w;
            const double low = slab.value(slab.least, u, v, w) - w,
                         high = slab.value(slab.most, u, v, w) - w;
            if (!(low <= high)) return AMBIGUOUS;
            is_close &= std::max(-low, high) <= DEPTH_TIE_REL / 2 * w;
            all.add({low, high});
        }
    if (all.least > far || all.most < -far) return APART;
    if (!is_close) return AMBIGUOUS;
    return std::max(-all.least, all.most) <= plane.error ? APART : CLOSE;
}

// True if closeness of all faces of a group is known and none is LOOSE.
bool is_joined(const Place &place, const View &view) {
    return holds_of_all(&Group::is_joined, place, view.grid, [&](int64_t f) {
        return (view.projected.state[f] & (HAS_LOOSE | LOOSE)) == HAS_LOOSE;
    });
}

// Calls `take` for the cells that list a face, until it returns true; true if it does.
template <class Take> bool any_cell_of(int64_t f, const View &view, Take take) {
    const CellGrid &grid = view.grid;
    const Cells cells = cells_of_box(view.projected.box, f, grid);
    for (int64_t row = cells.top; row <= cells.bottom; row++)
        for (int64_t column = cells.left; column <= cells.right; column++) {
            const int64_t at = row * grid.columns + column;
            if (grid.asked[at] == LISTED && take(at)) return true;
        }
    return false;
}

// Appends the faces that coincide with face f, beyond rounding, to `members`, those that are not
// there yet; true if it is ambiguous which ones these are. Groups of members that all coincide with
// it are passed over.
bool add_members(int64_t f, std::vector<int64_t> &members, const View &view) {
    const auto &[box, state] = std::tie(view.projected.box, view.projected.state);
    Images images;
    const auto [n, n_own] =
        outline_inside(f, view, images.target(), images.own(), images.overlap());
    const Bounds own = bounds_in(box, f);
    const Plane plane = plane_of(f, view.camera, view.projected);
    const Depths depths = {box(f, W_MIN) * (1 - NEARLY_REL), -INF,
                           box(f, W_MAX) * (1 + 2 * NEARLY_REL)};
    Bounds rectangle = own; // within a cell
    const double slack = state[f] & CLIPPED ? outline_error(f, view.camera, view.projected) : 0.0;
    const auto may = [&](const Group &group, const Place &place) {
        if (!touches(group, own, depths)) return false;
        for (int64_t s = 0; s < n_own; s++) {
            const Line line = line_at(images.own(), s);
            if (values_at_corners(group, line).most <= slack_of(line, slack)) return false;
        }
        const Closeness all =
            closeness_of_group(group, plane, rectangle, 2 * NEARLY_REL * box(f, W_MAX));
        return all != APART && !(all == CLOSE && is_joined(place, view));
    };
    // Of two faces alone, as far apart as just counts as one, either may be in front.
    int64_t one = -1;
    bool is_ambiguous = false;
    Poll poll(16);
    const auto takes = [&](int64_t m) {
        const Bounds its = bounds_in(box, m);
        if (m == f || are_apart(its, own)) return false;
        poll();
        view.work.n_compared[0]++;
        const Closeness found = closeness(f, n, n_own, m, view, images);
        if (found == APART) return false;
        if (one < 0) one = m;
        is_ambiguous |= found == AMBIGUOUS || state[m] & LOOSE;
        if (is_ambiguous && (m != one || members.size() > 2)) return true;
        if (found == CLOSE && !(state[m] & HAS_LOOSE)) {
            state[m] |= HAS_LOOSE;
            members.push_back(m);
        }
        return false;
    };
    return any_cell_of(f, view, [&](int64_t at) {
        lay_bounds(at, view);
        const Bounds cell = rectangle_of_cell(at, view);
        rectangle = {std::max(own.u_min, cell.u_min), std::min(own.u_max, cell.u_max),
                     std::max(own.v_min, cell.v_min), std::min(own.v_max, cell.v_max)};
        for (Walk walk(at, view.grid); walk.next(may);)
            for (int64_t entry = walk.first; entry < walk.last; entry++)
                if (takes(view.grid.entries[entry])) return true;
        return false;
    });
}

// Lets the groups of a place forget what is_joined found.
void forget_joined(const Place &place, const CellGrid &grid) {
    group_at(place, grid).is_joined = false;
    if (place.size == 1) return;
    forget_joined(place.lower(), grid);
    forget_joined(place.upper(), grid);
}

// True if faces nearly coincide with a face, or with one that coincides with it, and so on, that do
// not all coincide with one another. Then the lower index cannot decide which one is in front: a
// before b, b before c and c before a would hide all three.
bool is_loose(int64_t f, const View &view) {
    const auto &state = view.projected.state;
    if (state[f] & HAS_LOOSE) return state[f] & LOOSE;
    state[f] |= HAS_LOOSE;
    std::vector<int64_t> members = {f};
    bool is_ambiguous = false;
    for (size_t k = 0; k < members.size() && !is_ambiguous; k++)
        is_ambiguous = add_members(members[k], members, view);
    if (!is_ambiguous) return false;
    for (const int64_t m : members) {
        state[m] |= LOOSE;
        any_cell_of(m, view, [&](int64_t at) {
            const Place all = all_groups(at, view.grid);
            if (view.grid.stops[at] - view.grid.starts[at] > MANY && view.grid.has_bounds[at])
                forget_joined(all, view.grid);
            return false;
        });
    }
    return true;
}

PairPlane pair_plane_of(int64_t f, const View &view, Scratch &scratch) {
    scratch.planes.resize(N_PLANES);
    PairPlane &plane = scratch.planes[size_t(f) % N_PLANES];
    if (plane.f == f) return plane;
    const Vertices vertices = scratch.vertices;
    Corners corners;
    double far = 0.0;
    for (int k = 0; k < 3; k++) {
        const auto &at = corners.at[k];
        to_camera(vertices[view.projected.faces(f, k)], view.camera, corners.at[k]);
        far = std::max(far, length(at[0].high, at[1].high, at[2].high));
    }
    const bool is_parallel = view.camera.is_parallel();
    if (is_parallel) flatten(corners, view.camera);
    const Normals normals = normals_of_sides(corners, view.camera, UNDERFLOW_ERROR);
    plane = {{}, {0.0, 0.0}, normals.errors[3], 0.0, 0.0, f};
    for (int k = 0; k < 3; k++) {
        plane.n[k] = normals.face[k];
        plane.d = plane.d + corners.at[0][k] * normals.face[k];
        plane.n_size += std::abs(plane.n[k].high);
    }
    plane.d_error = far * (plane.n_error + PAIR_ERROR_REL * plane.n_size);
    if (is_parallel) {
        plane.d = normals.d;
        plane.d_error = normals.errors[4];
    }
    return plane;
}

// Depth order of face m relative to face t whose planes are nearly parallel, from the vertices in
// pairs of doubles: 1/z of projected vertices leaves a wide strip undecided. Adds to area_error of
// t what is still in doubt; work.spare has the `gap_n` corners of the overlap.
//
// 1/z_m - 1/z_t = (n_m / d_m - n_t / d_t) . ray, and its sign is that of
// (n_m d_t - n_t d_m) . ray d_m d_t. It is computed in one order, so that t and m agree.
Order order_in_pairs(int64_t t, int64_t m, int64_t gap_n, int64_t n_sides, const View &view,
                     Scratch &scratch, double &in_doubt) {
    const auto &[camera, work] = std::tie(view.camera, view.work);
    const PairPlane a = pair_plane_of(std::min(t, m), view, scratch),
                    b = pair_plane_of(std::max(t, m), view, scratch);
    double normal[3];
    const double sign = ((a.d.high > 0) == (b.d.high > 0) ? 1.0 : -1.0) * (t < m ? 1.0 : -1.0);
    for (int k = 0; k < 3; k++) normal[k] = sign * (b.n[k] * a.d + -(a.n[k] * b.d)).high;
    const double slope_u = normal[0] / camera.fx, slope_v = normal[1] / camera.fy;
    const Line line = {camera.cx, camera.cy, slope_v, -slope_u, normal[2]};
    const double far_a = std::abs(a.d.high), far_b = std::abs(b.d.high);
    double error = b.n_error * far_a + a.n_error * far_b + b.n_size * a.d_error +
                   a.n_size * b.d_error + PAIR_ERROR_REL * (b.n_size * far_a + a.n_size * far_b);
    error *= camera.longest_ray;
    Range all;
    double size = std::abs(normal[2]);
    for (int64_t p = 0; p < gap_n; p++) {
        const double u = work.spare(p, U), v = work.spare(p, V);
        all.add(line.value(u, v));
        size = std::max(size, std::abs(slope_u * (u - camera.cx)) +
                                  std::abs(slope_v * (v - camera.cy)) + std::abs(normal[2]));
    }
    error += UNIT_ROUNDING * size + camera.pixel_error * (std::abs(slope_u) + std::abs(slope_v));
    const double common = std::abs(twice_area(work.spare, gap_n)) / 2;
    if (!(a.d_error < far_a && b.d_error < far_b)) {
        in_doubt = common;
    } else if (all.least <= error && all.most >= -error) {
        const double extent = extent_of(work.spare, gap_n).across();
        in_doubt = std::min(2 * error / length(slope_u, slope_v, 0.0) * extent, common);
    } else {
        in_doubt = 0.0;
    }
    if (all.most <= 0) return BEHIND;
    if (all.least >= 0) return IN_FRONT;
    store_line(line, work.lines, n_sides);
    return IN_FRONT_IN_PART;
}

// Depth order of face m relative to the face of a part, see depth_order, in which one of two that
// coincide is in front.
Occluder strict_order(const PartOfFace &part, int64_t m, int64_t n_sides, Scratch &scratch) {
    const auto &[t, view] = std::tie(part.t, part.view);
    const auto &[projected, work] = std::tie(view.projected, view.work);
    double &area_error = view.area_error[t];
    const double before = area_error;
    area_error = 0.0; // what is in doubt
    Order order = depth_order(t, m, part.n, n_sides, view, true);
    const bool is_transparent = projected.state[t] & TRANSPARENT;
    if (order == TIED && !is_transparent) {
        const double of_tie = area_error;
        area_error = 0.0;
        order = depth_order(t, m, part.n, n_sides, view, true, true);
        if (order == TIED || !(is_loose(t, view) || is_loose(m, view))) {
            order = projected.rank[m] < projected.rank[t] ? IN_FRONT : BEHIND;
            area_error = of_tie;
        }
    }
    if (order == TIED) order = BEHIND;
    double in_doubt = area_error;
    const double around = common_extent(t, m, projected.box);
    const auto has_vertices = [&](int64_t f) {
        const auto &faces = projected.faces;
        return std::max(faces(f, 0), std::max(faces(f, 1), faces(f, 2))) < scratch.vertices.rows();
    };
    if (in_doubt > WIDE_STRIP * view.camera.pixel_error * around && !is_transparent &&
        (is_loose(t, view) || is_loose(m, view)) && has_vertices(t) && has_vertices(m)) {
        copy_polygon(work.target, part.n, work.spare);
        const int64_t n = clip(work.spare, part.n, work.lines, n_sides, work.other);
        if (n >= 3) order = order_in_pairs(t, m, n, n_sides, view, scratch, in_doubt);
    }
    area_error = before;
    return {m, order, line_at(work.lines, n_sides), in_doubt, false};
}

// Takes from a part what an occluder hides of it; work.lines has the n_sides lines that bound it.
// SOME if it goes on.
Rest hide(const PartOfFace &part, Occluder &occluder, int64_t n_sides, Left &left) {
    const auto &[camera, projected, work] =
        std::tie(part.view.camera, part.view.projected, part.view.work);
    const Column<int32_t> marks = left.scratch.marks;
    const int64_t m = occluder.m;
    const int32_t number = marks[marks.rows() - 1];
    double &area_error = part.view.area_error[part.t];
    const bool is_first = occluder.is_new || marks[m] != number;
    occluder.is_new = false;
    marks[m] = number;
    if (is_first) area_error += occluder.in_doubt;
    if (occluder.order == BEHIND) return Rest::SOME;
    left.scratch.poll();
    left.last = m;
    work.n_compared[0]++;
    const auto &lines = work.lines;
    if (occluder.order == IN_FRONT && contains(lines, n_sides, work.target, part.n))
        return Rest::ALL_HIDDEN;
    if (is_first)
        area_error +=
            4 * common_extent(part.t, m, projected.box) * outline_error(m, camera, projected);
    int64_t n_lines = n_sides;
    if (occluder.order == IN_FRONT_IN_PART) store_line(occluder.equal, lines, n_lines++);
    left.count = clip_subtract(left.scratch.pieces, left.count, lines, n_sides, n_lines,
                               camera.pixel_error, work.spare, work.values);
    if (left.count == 0) return Rest::NONE;
    return left.count < 0 ? Rest::NO_ROOM : Rest::SOME;
}

// Takes from a part what face m hides of it, whose box overlaps it, and lists it.
Rest hide_by_face(const PartOfFace &part, int64_t m, Left &left) {
    const auto &[camera, projected, work] =
        std::tie(part.view.camera, part.view.projected, part.view.work);
    Scratch &scratch = left.scratch;
    int32_t &mark = scratch.marks[m];
    const int32_t number = scratch.marks[scratch.marks.rows() - 1];
    const bool is_new = projected.state[m] & DOUBTFUL && mark != number;
    if (is_new) {
        mark = number;
        part.view.area_error[part.t] += 4 * EDGE_ON_FACTOR *
                                        common_extent(part.t, m, projected.box) *
                                        outline_error(m, camera, projected);
    }
    if (projected.state[m] & THIN || is_before(part, m)) return Rest::SOME;
    const auto [k, n_sides] = outline(m, projected, work.corners, work.lines);
    if (separates(work.lines, n_sides, work.target, part.n) ||
        separates(work.own, part.n_own, work.corners, k))
        return Rest::SOME;
    Occluder occluder = strict_order(part, m, n_sides, scratch);
    occluder.is_new = is_new;
    if (occluder.order == BEHIND && occluder.in_doubt == 0) return Rest::SOME;
    Rest is = Rest::SOME;
    if (left.count <= left.limit) is = hide(part, occluder, n_sides, left);
    scratch.lists.push_back(int32_t(scratch.occluders.size()));
    scratch.occluders.push_back(occluder);
    return is;
}

// Takes from a part what the occluders first ... last - 1 of the lists hide of it, and lists those
// of them that meet it.
Rest hide_by_list(const PartOfFace &part, int64_t first, int64_t last, Left &left) {
    const View &view = part.view;
    for (int64_t at = first; at < last; at++) {
        Scratch &scratch = left.scratch;
        const int32_t index = scratch.lists[size_t(at)];
        Occluder &occluder = scratch.occluders[size_t(index)];
        if (are_apart(bounds_in(view.projected.box, occluder.m), part.extent) ||
            is_before(part, occluder.m))
            continue;
        const int64_t n_sides =
            outline(occluder.m, view.projected, view.work.corners, view.work.lines).n_lines;
        if (separates(view.work.lines, n_sides, part.corners, part.n_corners)) continue;
        scratch.lists.push_back(index);
        if (left.count > left.limit) continue;
        const Rest is = hide(part, occluder, n_sides, left);
        if (is != Rest::SOME) return is;
    }
    return Rest::SOME;
}

// Twice the area that is left of a part, which keeps its pieces.
double keep_pieces(const PartOfFace &part, const Left &left) {
    const Pieces &pieces = left.scratch.pieces;
    double total = 0.0;
    for (int64_t p = 0; p < left.count; p++) {
        const Points corners = pieces.corners[p];
        const double twice = std::max(twice_area(corners, pieces.n_corners[p]), 0.0);
        total += twice;
        // Faces that were passed over hide at most what is within rounding of its border.
        if (left.has_many) {
            const Bounds b = extent_of(corners, pieces.n_corners[p]);
            const double around = b.around(),
                         reach = bounds_in(part.view.projected.box, part.t).around();
            part.view.area_error[part.t] +=
                part.view.camera.pixel_error * (8 * around + double(pieces.n_corners[p]) * reach);
        }
        if (twice > 0) store_piece(part.t, corners, pieces.n_corners[p], part.view.work.kept);
    }
    return total;
}

// Replaces the part on top of the stack by its halves; returns how many that are.
int64_t halve(int64_t top, const Work &work) {
    const int64_t n = work.parts.n_corners[top], level = work.levels[top] + 1;
    copy_polygon(work.parts.corners[top], n, work.spare);
    const Bounds b = extent_of(work.spare, n);
    const double u = (b.u_min + b.u_max) / 2, v = (b.v_min + b.v_max) / 2;
    const bool is_across = b.u_max - b.u_min >= b.v_max - b.v_min;
    int64_t n_halves = 0;
    for (const double inward : {-1.0, 1.0}) {
        const Line line = is_across ? Line{u, v, 0.0, inward, 0.0} : Line{u, v, inward, 0.0, 0.0};
        const int64_t kept = keep_inside(work.spare, n, line, work.parts.corners[top + n_halves]);
        if (kept >= 3) {
            work.parts.n_corners[top + n_halves] = kept;
            work.levels[top + n_halves] = level;
            n_halves++;
        }
    }
    return n_halves;
}

// Takes the next number for a target, the last of `marks`, which are of zeros at first. The others
// are the numbers of the targets for which each face was looked at last.
void take_number(Column<int32_t> marks) {
    int32_t &number = marks[marks.rows() - 1];
    if (number == MOST_NUMBERS) std::fill(marks.begin(), marks.end(), 0);
    number++;
}

// Twice the area that the faces listed in some cells leave of a part of face t, the first of
// work.parts, whose halves follow if it has many pieces; and SOME, NO_ROOM or ALL_HIDDEN.
std::pair<double, Rest> visible_in_cells(int64_t t, const Outline &image, const Cells &cells,
                                         const View &view, Scratch &scratch) {
    const Pieces &pieces = scratch.pieces;
    int32_t &hider =
        view.grid.hider[(cells.top + (cells.bottom - cells.top + 1) / 2) * view.grid.columns +
                        cells.left + (cells.right - cells.left + 1) / 2];
    struct {
        size_t first, last;
    } lists[STACK_ROOM] = {{0, 0}};
    scratch.occluders.clear();
    double twice = 0.0;
    bool has_many = false;
    view.work.levels[0] = 0;
    for (int64_t top = 1; top > 0;) {
        scratch.poll();
        top--;
        const auto [first, last] = lists[top];
        scratch.lists.resize(last); // halves that are done have listed more
        const bool can_halve = view.work.levels[top] < MOST_HALVINGS && top + 2 < STACK_ROOM;
        const PartOfFace part =
            part_of(t, image, view.work.parts.corners[top], view.work.parts.n_corners[top], view);
        Left left = {1, -1, has_many, can_halve ? MOST_PIECES : pieces.corners.rows(), scratch};
        copy_polygon(part.corners, part.n_corners, pieces.corners[0]);
        pieces.n_corners[0] = part.n_corners;
        Rest is = Rest::SOME;
        if (view.work.levels[top] > 0) is = hide_by_list(part, first, last, left);
        else
            any_near(part, cells, left, [&](int64_t m) {
                is = hide_by_face(part, m, left);
                return is != Rest::SOME;
            });
        has_many = left.has_many;
        if (is == Rest::NO_ROOM) return {0.0, is};
        if (left.count > left.limit) {
            const int64_t n_halves = halve(top, view.work);
            for (int64_t k = 0; k < n_halves; k++) lists[top++] = {last, scratch.lists.size()};
            continue;
        }
        const double its = is == Rest::SOME ? keep_pieces(part, left) : 0.0;
        twice += its;
        if (its == 0) hider = int32_t(left.last);
        if (is == Rest::ALL_HIDDEN) return {0.0, is};
    }
    return {twice, Rest::SOME};
}

// Twice the visible area of face t; less than 0 if there is too little room. A large face is taken
// apart by the cells of the grid.
double visible_twice_area(int64_t t, const Outline &image, const View &view, Scratch &scratch) {
    const Cells all = cells_of_box(view.projected.box, t, view.grid);
    const int64_t n = image.n_corners, width = all.right - all.left + 1,
                  height = all.bottom - all.top + 1;
    const bool is_large = width * height > MOST_CELLS_OF_PART;
    double twice = 0.0;
    for (int64_t row = all.top; row <= all.bottom; row += is_large ? 1 : height)
        for (int64_t column = all.left; column <= all.right; column += is_large ? 1 : width) {
            const Points corners = view.work.parts.corners[0];
            int64_t &n_corners = view.work.parts.n_corners[0];
            copy_polygon(view.work.target, n, corners);
            n_corners = n;
            if (is_large) {
                lines_of_cell(column, row, view.grid, {view.work.cell.data, {4, 5}});
                n_corners = clip(corners, n, view.work.cell, 4, view.work.spare);
                if (n_corners < 3) continue;
            }
            const Cells cells = is_large ? Cells{column, column, row, row} : all;
            const auto [its, is] = visible_in_cells(t, image, cells, view, scratch);
            if (is != Rest::SOME) return is == Rest::NO_ROOM ? -1.0 : 0.0;
            twice += its;
        }
    return twice;
}

} // namespace

// Visible areas of some faces, from the one in place `first` of `targets` on; returns how many of
// these are done. If not all are, there is too little scratch memory, or room in work.kept where
// its `used` says so: call again with more and that number.
//
// Out: `visible` and `area_error` of the targets. `marks`, one for each face and one more, see
// take_number, and `pieces` are scratch.
int64_t visible_areas(Int32Array targets, int64_t first, Vertices vertices, const View &view,
                      Column<int32_t> marks, const Pieces &pieces) {
    const auto &[state, kept] = std::tie(view.projected.state, view.work.kept);
    Poll poll(16);
    Scratch scratch = {marks, pieces, vertices, poll, {}, {}, {}};
    for (int64_t index = first; index < targets.rows(); index++) {
        poll();
        const int64_t t = targets[index];
        const int64_t n_kept = kept.used[0], n_kept_corners = kept.used[1];
        view.visible[t] = view.area_error[t] = 0.0;
        if (!(state[t] & (LIVE | THIN))) continue;
        if (state[t] & THIN) {
            const double error = outline_error(t, view.camera, view.projected);
            view.area_error[t] = 4 * EDGE_ON_FACTOR * extent_in_image(t, view) * error;
            continue;
        }
        const Outline image = take_target(t, view);
        if (image.n_corners < 3 || is_hidden_by_one(t, image.n_corners, view)) continue;
        take_number(marks);
        const double twice = visible_twice_area(t, image, view, scratch);
        if (twice < 0 || kept.used[2]) {
            drop_pieces(kept, n_kept, n_kept_corners);
            return index;
        }
        settle_area(t, twice / 2, view, n_kept, n_kept_corners);
    }
    return targets.rows();
}

} // namespace exact
} // namespace rastercov
