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
#include "bind.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

// Cells of the grid that a face covers, beyond which it is taken apart by them.
constexpr int64_t MOST_CELLS_OF_PART = 12;
// Pieces of a part of a face beyond which it is halved: each occluder is taken from each piece.
constexpr int64_t MOST_PIECES = 48;
// Times that a part is halved: occluders with a common corner are not separated by any number.
constexpr int64_t MOST_HALVINGS = 6;
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

// What some cells leave of a part of a face.
struct Rest {
    enum {
        SOME,
        NO_ROOM,
        ALL_HIDDEN,
        TOO_MANY
    } is;         // too many pieces for the memory; one face hides
                  // all of the face; more pieces than the limit
    double twice; // area, px^2
    int64_t face; // the last face that hides something
};

// Twice the area that the faces listed in some cells leave of a part of face t, whose n corners
// work.target has, and its n_own lines work.own.
Rest visible_in_cells(int64_t t, int64_t n, int64_t n_own, Points part, int64_t n_part,
                      const Cells &cells, int64_t limit, const View &view,
                      Array<int32_t, Any> marks, const Pieces &pieces) {
    const auto &[camera, projected, grid, work] =
        std::tie(view.camera, view.projected, view.grid, view.work);
    const auto &[box, state] = std::tie(projected.box, projected.state);
    const auto &[target, own, lines, corners] =
        std::tie(work.target, work.own, work.lines, work.corners);
    double &area_error = view.area_error[t];
    const double farthest = box(t, W_MIN) * (1 - 2 * DEPTH_TIE_REL);
    const Plane plane = plane_of(t, camera, projected);
    const auto [u_min, u_max, v_min, v_max] = extent_of(part, n_part);
    copy_polygon(part, n_part, pieces.corners[0]);
    pieces.n_corners[0] = n_part;
    int64_t count = 1, last = -1;
    const int32_t number = marks[marks.rows() - 1];
    for (int64_t row = cells.top; row <= cells.bottom; row++)
        for (int64_t column = cells.left; column <= cells.right; column++) {
            const int64_t at = row * grid.columns + column;
            if (!grid.is_sorted[at]) sort_cell(at, box, grid);
            for (int64_t entry = grid.starts[at]; entry < grid.stops[at]; entry++) {
                if (grid.nearest[entry] < farthest) break;
                const int64_t m = grid.entries[entry];
                const Bounds its = bounds_in(box, m);
                if (its.u_min >= u_max || its.u_max <= u_min || m == t) continue;
                if (its.v_min >= v_max || its.v_max <= v_min) continue;
                // Each face once: in the first of the cells that list it.
                if (column != std::max(column_at(its.u_min, grid), cells.left) ||
                    row != std::max(row_at(its.v_min, grid), cells.top))
                    continue;
                if (separates_box(own, n_own, its)) continue;
                const bool is_first = marks[m] != number;
                const double around = common_extent(t, m, box);
                if (state[m] & DOUBTFUL) {
                    if (is_first) {
                        marks[m] = number;
                        area_error +=
                            4 * EDGE_ON_FACTOR * around * outline_error(m, camera, projected);
                    }
                    if (state[m] & THIN) continue;
                }
                // The plane of t where it is farthest within the box of m: most faces that are
                // before t somewhere are far behind it here.
                const double u =
                    plane.a > 0 ? std::max(its.u_min, u_min) : std::min(its.u_max, u_max);
                const double v =
                    plane.b > 0 ? std::max(its.v_min, v_min) : std::min(its.v_max, v_max);
                const double along_u = plane.a * (u - plane.u), along_v = plane.b * (v - plane.v);
                const double rounding =
                    plane.error +
                    4 * DEPTH_TIE_REL * (std::abs(plane.w) + std::abs(along_u) + std::abs(along_v));
                if (box(m, W_MAX) < plane.w + along_u + along_v - rounding) continue;
                const auto [k, n_sides] = outline(m, projected, corners, lines);
                if (separates(lines, n_sides, target, n) || separates(own, n_own, corners, k))
                    continue;
                marks[m] = number;
                Order order = depth_order(t, m, n, n_sides, view, is_first);
                if (order == TIED) {
                    const bool is_before =
                        !(state[t] & TRANSPARENT) && projected.rank[m] < projected.rank[t];
                    order = is_before ? IN_FRONT : BEHIND;
                }
                if (order == BEHIND) continue;
                if (order == IN_FRONT && contains(lines, n_sides, target, n))
                    return {Rest::ALL_HIDDEN, 0.0, m};
                if (is_first) area_error += 4 * around * outline_error(m, camera, projected);
                const int64_t n_lines = order == IN_FRONT_IN_PART ? n_sides + 1 : n_sides;
                count = clip_subtract(pieces, count, lines, n_sides, n_lines, camera.pixel_error,
                                      work.spare, work.values);
                last = m;
                if (count == 0) return {Rest::SOME, 0.0, last};
                if (count < 0) return {Rest::NO_ROOM, 0.0, last};
                if (count > limit) return {Rest::TOO_MANY, 0.0, last};
            }
        }
    double twice = 0.0;
    for (int64_t p = 0; p < count; p++) {
        const double of_piece = std::max(twice_area(pieces.corners[p], pieces.n_corners[p]), 0.0);
        twice += of_piece;
        if (of_piece > 0) store_piece(t, pieces.corners[p], pieces.n_corners[p], work.kept);
    }
    return {Rest::SOME, twice, last};
}

// Replaces the part on top of the stack by its halves; returns how many that are.
int64_t halve(int64_t top, const Work &work) {
    const auto &[parts, levels, spare] = std::tie(work.parts, work.levels, work.spare);
    const int64_t n = parts.n_corners[top], level = levels[top] + 1;
    copy_polygon(parts.corners[top], n, spare);
    const Bounds b = extent_of(spare, n);
    const double u = (b.u_min + b.u_max) / 2, v = (b.v_min + b.v_max) / 2;
    const bool is_across = b.u_max - b.u_min >= b.v_max - b.v_min;
    int64_t n_halves = 0;
    for (const double inward : {-1.0, 1.0}) {
        const Line line = is_across ? Line{u, v, 0.0, inward, 0.0} : Line{u, v, inward, 0.0, 0.0};
        const int64_t kept = keep_inside(spare, n, line, parts.corners[top + n_halves]);
        if (kept >= 3) {
            parts.n_corners[top + n_halves] = kept;
            levels[top + n_halves] = level;
            n_halves++;
        }
    }
    return n_halves;
}

// Takes the next number for a target, the last of `marks`, which are of zeros at first. The others
// are the numbers of the targets for which each face was looked at last.
void take_number(Array<int32_t, Any> marks) {
    int32_t &number = marks[marks.rows() - 1];
    if (number == MOST_NUMBERS) std::fill(marks.begin(), marks.end(), 0);
    number++;
}

// Twice the visible area of face t; less than 0 if there is too little room. A large face is taken
// apart by the cells of the grid, and parts of many pieces are halved.
double visible_twice_area(int64_t t, const Outline &image, const View &view,
                          Array<int32_t, Any> marks, const Pieces &pieces) {
    const auto &[grid, work] = std::tie(view.grid, view.work);
    const auto &[parts, levels] = std::tie(work.parts, work.levels);
    const auto [left, right, top_row, bottom] = cells_of_box(view.projected.box, t, grid);
    const bool is_large = (right - left + 1) * (bottom - top_row + 1) > MOST_CELLS_OF_PART;
    const int64_t width = is_large ? 1 : right - left + 1,
                  height = is_large ? 1 : bottom - top_row + 1;
    const int64_t n = image.n_corners;
    double twice = 0.0;
    for (int64_t row = top_row; row <= bottom; row += height)
        for (int64_t column = left; column <= right; column += width) {
            const Cells cells = {column, column + width - 1, row, row + height - 1};
            const int64_t middle = (row + height / 2) * grid.columns + column + width / 2;
            copy_polygon(work.target, n, parts.corners[0]);
            parts.n_corners[0] = n;
            if (is_large) {
                lines_of_cell(column, row, grid, {work.cell.data, {4, 5}});
                parts.n_corners[0] = clip(parts.corners[0], n, work.cell, 4, work.spare);
                if (parts.n_corners[0] < 3) continue;
            }
            levels[0] = 0;
            for (int64_t top = 1; top > 0;) {
                top--;
                const bool can_halve = levels[top] < MOST_HALVINGS && top + 2 < STACK_ROOM;
                const int64_t limit = can_halve ? MOST_PIECES : pieces.corners.rows();
                const Rest rest =
                    visible_in_cells(t, n, image.n_lines, parts.corners[top], parts.n_corners[top],
                                     cells, limit, view, marks, pieces);
                if (rest.is == Rest::ALL_HIDDEN) {
                    grid.hider[middle] = int32_t(rest.face);
                    return 0.0;
                }
                if (rest.is == Rest::NO_ROOM) return -1.0;
                if (rest.is == Rest::TOO_MANY) top += halve(top, work);
                else twice += rest.twice;
                if (rest.is == Rest::SOME && rest.twice == 0)
                    grid.hider[middle] = int32_t(rest.face);
            }
        }
    return twice;
}

// Visible areas of some faces, from the one in place `first` of `targets` on; returns how many of
// these are done. If not all are, there is too little scratch memory, or room in work.kept where
// its `used` says so: call again with more and that number.
//
// Out: `visible` and `area_error` of the targets. `marks`, one for each face and one more, see
// take_number, and `pieces` are scratch.
int64_t visible_areas(Array<const int32_t, Any> targets, int64_t first, View view,
                      Array<int32_t, Any> marks, Pieces pieces) {
    const auto &[state, kept] = std::tie(view.projected.state, view.work.kept);
    require_view(view);
    require_indices(targets, state.rows(), "targets must be faces");
    require(first >= 0, "first must not be negative");
    require(marks.rows() == view.grid.is_whole.rows() + 1 && marks.rows() <= state.rows() + 1,
            "marks must have one row for each face that can be listed, and one more");
    require(pieces.corners.rows() > 0 && pieces.corners.extent(1) >= PIECE_ROOM &&
                pieces.n_corners.rows() >= pieces.corners.rows(),
            "pieces must have room for 64 corners each");
    for (int64_t index = first; index < targets.rows(); index++) {
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
        const double twice = visible_twice_area(t, image, view, marks, pieces);
        if (twice < 0 || kept.used[2]) {
            drop_pieces(kept, n_kept, n_kept_corners);
            return index;
        }
        settle_area(t, twice / 2, view, n_kept, n_kept_corners);
    }
    return targets.rows();
}

} // namespace
} // namespace exact

void register_exact_half_plane(nanobind::module_ &m) {
    using namespace exact;
    def(m, "visible_areas", visible_areas,
        "Visible areas of some faces; how many of the targets are done, fewer if room was too "
        "small.",
        "targets", "first", "view", "marks", "pieces");
}

} // namespace rastercov
