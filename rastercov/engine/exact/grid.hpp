// Regular grid over the image that lists the faces by cells.
//
// Cells are listed where they are asked for: near event edges, or all. Those of one row and column
// touch the boxes of the faces that they list.
//
// Twins: tests/exact/test_blocks.py lists faces by their boxes.
#pragma once
#include "exact/setup.hpp"
#include <span>
#include <tuple>

namespace rastercov::exact {

enum : uint8_t { NOT_ASKED, ASKED, LISTED }; // states of a cell
constexpr int64_t ENTRIES_AT_A_TIME = 64;    // entries of a cell that are compared at a time
constexpr int64_t MANY = 1024;               // entries of a cell whose corners are compared, too
constexpr int64_t CORNER = 6;                // their first row in CellGrid.bounds
constexpr int64_t GROUP_SIZE = 32;           // entries of the least groups
constexpr double MOST_OF_OUTLINE = 4; // error of the outline of a face, in roundings of a position
constexpr int FRONT = 32;
constexpr int KEYS = 9; // of a face, by which groups are made: its box and the sum of its corners
constexpr int64_t BUCKETS = 64; // ranges of 1/z by which the faces of a cell are sorted first

struct Cells {
    int64_t left, right, top, bottom; // first and last column, first and last row
};

// Row or column of the grid at a position; positions outside go to the first or the last.
inline int64_t cell(double position, double origin, double per_pixel, int64_t n) {
    return std::min(std::max(int64_t((position - origin) * per_pixel), int64_t(0)), n - 1);
}
inline int64_t column_at(double u, const CellGrid &grid) {
    return cell(u, grid.left, grid.per_u, grid.columns);
}
inline int64_t row_at(double v, const CellGrid &grid) {
    return cell(v, grid.top, grid.per_v, grid.rows);
}
inline int64_t cell_at(double u, double v, const CellGrid &grid) {
    return row_at(v, grid) * grid.columns + column_at(u, grid);
}

inline Cells cells_of_rectangle(const Bounds &b, const CellGrid &grid) {
    return {column_at(b.u_min, grid), column_at(b.u_max, grid), row_at(b.v_min, grid),
            row_at(b.v_max, grid)};
}

// Cells that a box touches, of a face or of a block.
template <class Boxes> Cells cells_of_box(const Boxes &box, int64_t f, const CellGrid &grid) {
    return cells_of_rectangle({box(f, U_MIN), box(f, U_MAX), box(f, V_MIN), box(f, V_MAX)}, grid);
}

// Face that hid another one at the centre of the box of a face, -1 for none.
inline int64_t likely_hider(int64_t f, const Array<double, Any, 6> &box, const CellGrid &grid) {
    const double u = (box(f, U_MIN) + box(f, U_MAX)) / 2, v = (box(f, V_MIN) + box(f, V_MAX)) / 2;
    return grid.hider[cell_at(u, v, grid)];
}

// Marks a cell and those before it in its row, and the row above, in grid.is_near.
inline void mark_near(int64_t row, int64_t column, bool is_near, const CellGrid &grid) {
    for (int64_t i = std::max(row - 1, int64_t(0)); i <= row; i++)
        for (int64_t j = std::max(column - 1, int64_t(0)); j <= column; j++)
            grid.is_near[i * grid.columns + j] = is_near;
}

// Asks for the cells of a rectangle.
inline void ask_for_cells(const Cells &cells, const CellGrid &grid) {
    int64_t n = grid.n_fresh[0];
    for (int64_t row = cells.top; row <= cells.bottom; row++)
        for (int64_t column = cells.left; column <= cells.right; column++) {
            const int64_t at = row * grid.columns + column;
            if (grid.asked[at] != NOT_ASKED) continue;
            grid.asked[at] = ASKED;
            grid.fresh_bits(row, column >> 6) |= uint64_t(1) << (column & 63);
            mark_near(row, column, true, grid);
            grid.fresh[n++] = int32_t(at);
        }
    grid.n_fresh[0] = n;
}

// Affine bounds of 1/z in a cell: `least` and `most` at (u, v), with slopes from there.
struct Slab {
    double u, v, slope_u, slope_v, least, most;

    // A bound of it at a point; NaN where rounding may count, of faces whose 1/z is w there.
    double value(double bound, double at_u, double at_v, double w) const {
        constexpr double MOST_REL = 1e4; // of 1/z, for the rounding
        const double along_u = slope_u * (at_u - u), along_v = slope_v * (at_v - v);
        const bool is_known =
            std::abs(bound) + std::abs(along_u) + std::abs(along_v) <= MOST_REL * w;
        return is_known ? along_u + along_v + bound : NAN;
    }
    // True if it is surely not above w at a point, or surely above it, except by ties and rounding.
    bool is_below(double at_u, double at_v, double w) const {
        return value(most, at_u, at_v, w) <= w * (1 + DEPTH_TIE_REL);
    }
    bool is_above(double at_u, double at_v, double w) const {
        return value(least, at_u, at_v, w) >= w * (1 + 4 * DEPTH_TIE_REL);
    }
};

// Bounds of u, v and w of a corner of some faces, all of them for one that is not known; the vertex
// that all have there, or `on_edge` of an edge that all have, -1 for none.
struct CornerOfMany {
    Range at[3];
    int32_t common;
};
inline int64_t on_edge(int64_t edge) { return -2 - edge; }

// Entries of a cell of MANY that are near one another, GROUP_SIZE of them or the two groups which
// it was divided into: bounds of the columns of their boxes, of their corners, and of 1/z of their
// planes in the cell; the key by which it is divided, and the least of its upper part.
struct Group {
    Range of[6];
    CornerOfMany corners[CORNERS];
    int32_t n_corners;
    Slab slab;
    int32_t axis;
    double middle, per_w; // that of all groups of a cell has what their keys have, see key_of
    bool is_settled;      // no crossing is listed of any of them any more
    int32_t front[FRONT]; // of all groups of a cell: entries that hid what was left of a face, the
                          // last first
    bool is_joined;       // each is known to coincide with another, see is_loose
    std::span<const CornerOfMany> all_corners() const { return {corners, size_t(n_corners)}; }
};

// The first entry of a group, and how many GROUP_SIZE it has.
struct Place {
    int64_t first, size;
    Place lower() const { return {first, size / 2}; }
    Place upper() const { return {first + size / 2 * GROUP_SIZE, size - size / 2}; }
};
// Each has a row of its own: one of two groups that of its middle.
inline Group &group_at(const Place &place, const CellGrid &grid) {
    if (place.size == 1) return grid.groups[place.first / GROUP_SIZE * 2];
    return grid.groups[place.upper().first / GROUP_SIZE * 2 + 1];
}

// True if something is known to hold of all faces of a group, which remembers it.
template <class Is>
bool holds_of_all(bool Group::*known, const Place &place, const CellGrid &grid, Is is) {
    bool &holds = group_at(place, grid).*known;
    if (!holds && place.size > 1)
        holds = holds_of_all(known, place.lower(), grid, is) &&
                holds_of_all(known, place.upper(), grid, is);
    else if (!holds)
        holds =
            std::all_of(&grid.entries[place.first], &grid.entries[place.first] + GROUP_SIZE, is);
    return holds;
}

// Rectangle of a cell and a little around it.
inline Bounds rectangle_of_cell(int64_t at, const View &view) {
    constexpr double AROUND_REL = 0x1p-6, AROUND = 0x1p27; // of the cell; roundings of a position
    const CellGrid &grid = view.grid;
    const double width = 1 / grid.per_u, height = 1 / grid.per_v;
    const double left = grid.left + double(at % grid.columns) * width;
    const int64_t row = at / grid.columns;
    const double top = grid.top + double(row) * height;
    const double more = AROUND * view.camera.pixel_error;
    const double across = AROUND_REL * width + more, down = AROUND_REL * height + more;
    return {left - across, left + width + across, top - down, top + height + down};
}

// Lets a slab hold another one, too, in a rectangle.
inline void widen(Slab &slab, const Slab &its, const Bounds &rectangle) {
    Range all = {slab.least, slab.most};
    for (const double u : {rectangle.u_min, rectangle.u_max})
        for (const double v : {rectangle.v_min, rectangle.v_max}) {
            const double above = its.slope_u * (u - its.u) + its.slope_v * (v - its.v) -
                                 slab.slope_u * (u - slab.u) - slab.slope_v * (v - slab.v);
            if (std::isfinite(above)) all.add({its.least + above, its.most + above});
            else all = {-INF, INF};
        }
    slab.least = all.least;
    slab.most = all.most;
}

// True if the corners of the image of a face are those of the face.
inline bool has_own_corners(int64_t f, const Projected &projected) {
    return !(projected.state[f] & (CLIPPED | DOUBTFUL | THIN));
}

// Lays the corners of the image of a clipped face, with what they may be off.
inline void lay_clipped_corners(int64_t f, const View &view, Group &group) {
    const auto &[camera, projected] = std::tie(view.camera, view.projected);
    const int64_t s = projected.clipped_index[f];
    const Plane plane = plane_of(f, camera, projected);
    const double error = outline_error(f, camera, projected), off = SURE * error;
    const auto corner_at = [&](double u, double v, double around, int64_t common) {
        const auto [w, size] = plane.at(u, v);
        const double more = plane.error + W_ARITHMETIC_ERROR_REL * size;
        return CornerOfMany{
            {{u - around, u + around}, {v - around, v + around}, {w - more, w + more}},
            int32_t(common)};
    };
    CornerOfMany *const end = group.corners + projected.clipped.n_corners[s];
    group.n_corners = projected.clipped.n_corners[s];
    for (int64_t n = 0; n < group.n_corners; n++) {
        const double u = projected.clipped.polygons(s, n, U),
                     v = projected.clipped.polygons(s, n, V);
        int64_t common = -1;
        for (int side = 0; side < 3; side++) {
            const Line line = line_at(projected.clipped.lines[s], side);
            if (std::abs(line.value(u, v)) <= slack_of(line, off))
                common = on_edge(view.edges.of_face(f, side));
        }
        group.corners[n] = corner_at(u, v, off, common);
    }
    if (error > MOST_OF_OUTLINE * camera.pixel_error) return;
    // Those of the face are the same to the bit in all that have them.
    for (int k = 0; k < 3; k++) {
        const int64_t vertex = projected.faces(f, k);
        const double u = projected.uvw(vertex, U), v = projected.uvw(vertex, V);
        if (!(projected.uvw(vertex, W) > 0 && u > 0 && u < camera.width && v > 0 &&
              v < camera.height))
            continue;
        const auto distance_to = [&](const CornerOfMany &its) {
            return std::abs(its.at[U].least + off - u) + std::abs(its.at[V].least + off - v);
        };
        *std::min_element(group.corners, end, [&](const auto &its, const auto &other) {
            return distance_to(its) < distance_to(other);
        }) = corner_at(u, v, 0.0, vertex);
    }
}

// A group of one face.
inline Group group_of(int64_t f, const View &view) {
    const Projected &projected = view.projected;
    const Plane plane = plane_of(f, view.camera, projected);
    Group group = {};
    group.slab = {plane.u, plane.v, plane.a, plane.b, plane.w, plane.w};
    for (int column = U_MIN; column <= W_MAX; column++)
        group.of[column].add(projected.box(f, column));
    group.n_corners = 3;
    for (int k = 0; k < 3; k++) {
        CornerOfMany &corner = group.corners[k];
        corner.common = projected.faces(f, k);
        for (const int axis : {U, V, W})
            if (has_own_corners(f, projected))
                corner.at[axis].add(projected.uvw(corner.common, axis));
            else corner.at[axis] = {-INF, INF};
    }
    if ((projected.state[f] & (CLIPPED | DOUBTFUL | THIN)) == CLIPPED)
        lay_clipped_corners(f, view, group);
    return group;
}

// Lets a group hold another one, too, whose corners are taken in the order in which each is near
// one of its own.
inline void widen(Group &group, Group other, const Bounds &rectangle) {
    for (int column = U_MIN; column <= W_MAX; column++) group.of[column].add(other.of[column]);
    for (Group *const each : {&group, &other})
        while (each->n_corners < std::max(group.n_corners, other.n_corners)) {
            each->corners[each->n_corners] = each->corners[each->n_corners - 1];
            each->n_corners++;
        }
    const int n = group.n_corners;
    for (int k = 0; k < n; k++) {
        const auto distance_to = [&](const CornerOfMany &its) {
            double total = 0.0;
            for (const int axis : {U, V})
                total += std::abs(its.at[axis].least + its.at[axis].most -
                                  group.corners[k].at[axis].least - group.corners[k].at[axis].most);
            return total;
        };
        for (int j = k + 1; j < n; j++)
            if (distance_to(other.corners[j]) < distance_to(other.corners[k]))
                std::swap(other.corners[j], other.corners[k]);
        for (const int axis : {U, V, W}) group.corners[k].at[axis].add(other.corners[k].at[axis]);
        if (other.corners[k].common != group.corners[k].common) group.corners[k].common = -1;
    }
    widen(group.slab, other.slab, rectangle);
}

// A number in which faces near one another differ little, pixels. `per_w` are those of a unit of
// 1/z: a relative change of it shifts what is seen of a face by about that share of the image.
inline double key_of(int64_t f, int axis, double per_w, const Projected &projected) {
    const double scale = (axis < CORNER ? axis / 2 : axis - CORNER) == W ? per_w : 1.0;
    if (axis < CORNER) return scale * projected.box(f, axis);
    axis -= CORNER;
    if (!has_own_corners(f, projected))
        return scale * 1.5 * (projected.box(f, 2 * axis) + projected.box(f, 2 * axis + 1));
    double sum = 0.0;
    for (int k = 0; k < 3; k++) sum += projected.uvw(projected.faces(f, k), axis);
    return scale * sum;
}

// Sorts n entries so that each of the first `lower` has a key that is not above those of the
// others.
//
// C. A. R. Hoare. Algorithm 65: Find. 1961.
inline void select(int32_t *entries, double *keys, int64_t n, int64_t lower) {
    int64_t low = 0;
    int64_t high = n - 1;
    while (low < high) {
        const double pivot = keys[lower];
        int64_t i = low;
        int64_t j = high;
        while (i <= j) {
            while (keys[i] < pivot) i++;
            while (pivot < keys[j]) j--;
            if (i > j) break;
            std::swap(keys[i], keys[j]);
            std::swap(entries[i++], entries[j--]);
        }
        if (j < lower) low = i;
        if (lower < i) high = j;
    }
}

// Divides `place` of a cell, and the entries behind it if they are fewer than a group, into groups
// of faces near one another, each by the key that differs most in it; by that those of the least
// groups are sorted, and grid.nearest has it.
inline void divide(const Place &place, int64_t n, double per_w, const View &view) {
    int32_t *const entries = view.grid.entries.data + place.first;
    double *const keys = view.grid.nearest.data + place.first;
    int32_t best = 0;
    double widest = -1.0;
    for (int axis = 0; axis < KEYS; axis++) {
        Range all;
        for (int64_t k = 0; k < n; k++) all.add(key_of(entries[k], axis, per_w, view.projected));
        if (all.most - all.least > widest) {
            widest = all.most - all.least;
            best = axis;
        }
    }
    for (int64_t k = 0; k < n; k++) keys[k] = key_of(entries[k], best, per_w, view.projected);
    Group &group = group_at(place, view.grid);
    group.axis = best;
    group.per_w = per_w;
    if (place.size < 2) {
        for (int64_t k = 0; k < n; k++) select(entries + k, keys + k, n - k, 0);
        return;
    }
    const int64_t lower = place.lower().size * GROUP_SIZE;
    select(entries, keys, n, lower);
    group.middle = keys[lower];
    divide(place.lower(), lower, per_w, view);
    divide(place.upper(), n - lower, per_w, view);
}

inline void lay_groups(const Place &place, const Bounds &rectangle, const View &view) {
    const CellGrid &grid = view.grid;
    Group &group = group_at(place, grid);
    const auto [axis, middle, per_w] = std::tuple(group.axis, group.middle, group.per_w);
    if (place.size == 1) {
        group = group_of(grid.entries[place.first], view);
        for (int64_t entry = place.first + 1; entry < place.first + GROUP_SIZE; entry++)
            widen(group, group_of(grid.entries[entry], view), rectangle);
    } else {
        lay_groups(place.lower(), rectangle, view);
        lay_groups(place.upper(), rectangle, view);
        group = group_at(place.lower(), grid);
        widen(group, group_at(place.upper(), grid), rectangle);
    }
    group.axis = axis;
    group.middle = middle;
    group.per_w = per_w;
}

// All groups of a cell of MANY.
inline Place all_groups(int64_t at, const CellGrid &grid) {
    return {grid.starts[at], (grid.stops[at] - grid.starts[at]) / GROUP_SIZE};
}

// Lays the bounds of the faces of a cell one after another in memory, the first time.
//
// More than MANY faces, such as needles of one fan, are divided into groups, and their corners
// follow: boxes hardly separate them. A face that is clipped, or whose outline is in doubt, has NaN
// there, which no comparison excludes.
inline void lay_bounds(int64_t at, const View &view) {
    const auto &[projected, grid] = std::tie(view.projected, view.grid);
    if (grid.has_bounds[at]) return;
    grid.has_bounds[at] = true;
    const int64_t first = grid.starts[at], stop = grid.stops[at];
    const bool has_many = stop - first > MANY;
    if (has_many) {
        double most = 0.0;
        for (int64_t entry = first; entry < stop; entry++)
            most = std::max(most, projected.box(grid.entries[entry], W_MAX));
        divide(all_groups(at, grid), stop - first, most > 0 ? view.camera.width / most : 0.0, view);
    }
    for (int64_t entry = first; entry < stop; entry++)
        for (int column = U_MIN; column <= W_MAX; column++)
            grid.bounds(column, entry) = projected.box(grid.entries[entry], column);
    if (!has_many) return;
    for (int64_t entry = first; entry < stop; entry++) {
        const int64_t f = grid.entries[entry];
        const bool is_known = has_own_corners(f, projected);
        for (int k = 0; k < 3; k++)
            for (const int axis : {U, V})
                grid.bounds(CORNER + 2 * k + axis, entry) =
                    is_known ? projected.uvw(projected.faces(f, k), axis) : NAN;
    }
    lay_groups(all_groups(at, grid), rectangle_of_cell(at, view), view);
    std::fill_n(group_at(all_groups(at, grid), grid).front, FRONT, -1);
}

// Least and greatest value of a line at the corners of an entry of a cell of MANY faces.
inline Range values_at_corners(int64_t entry, const Line &line, const CellGrid &grid) {
    const double *const corner = grid.bounds.data + grid.bounds.extent(1) * CORNER + entry;
    const int64_t stride = grid.bounds.extent(1);
    const double a = line.value(corner[0], corner[stride]),
                 b = line.value(corner[2 * stride], corner[3 * stride]),
                 c = line.value(corner[4 * stride], corner[5 * stride]);
    return {least(a, b, c), greatest(a, b, c)};
}

// Bounds of those values in a group: a value rises or falls with u, and with v, as it is rounded.
// Corners where all have one of two vertices are left out.
inline Range values_at_corners(const Group &group, const Line &line, int64_t without = -1,
                               int64_t or_without = -1) {
    Range all;
    for (const auto &[at, common] : group.all_corners()) {
        if (common >= 0 && (common == without || common == or_without)) continue;
        const auto &[u, v, w] = at;
        const bool rises = line.dv <= 0, falls = line.du <= 0;
        const double low = line.value(rises ? u.least : u.most, falls ? v.most : v.least);
        const double high = line.value(rises ? u.most : u.least, falls ? v.least : v.most);
        if (!(low <= high)) return {NAN, NAN};
        all.add({low, high});
    }
    return all;
}

// True if a segment, or a point, is surely outside of all faces of a group, by more than `margin`
// pixels along u and v: all are beyond it along the middle of a side of them.
inline bool is_outside(const Group &group, double ua, double va, double ub, double vb,
                       double margin) {
    for (int k = 0; k < group.n_corners; k++) {
        const auto &from = group.corners[k].at, &to = group.corners[(k + 1) % group.n_corners].at;
        const auto step = [&](int axis) {
            return to[axis].least + to[axis].most - from[axis].least - from[axis].most;
        };
        const Line line = {ua, va, step(U), step(V), 0.0};
        const Range at = values_at_corners(group, line);
        const double width = slack_of(line, margin), end = line.value(ub, vb);
        if (at.least > std::max(end, 0.0) + width || at.most < std::min(end, 0.0) - width)
            return true;
    }
    return false;
}

// Depths of a face that is asked for: least W_MAX, least and greatest W_MIN.
struct Depths {
    double least_near, least_far, most_far;
};

// Adds the entries first ... last - 1, of one cell with bounds and at most ENTRIES_AT_A_TIME, whose
// boxes touch a rectangle and a range of depths, to grid.found, after the first n there; how many
// there are then.
//
// Only those are added for which `also` is true; it takes an entry.
template <class Also>
__attribute__((always_inline)) inline int64_t
find_faces_if(int64_t first, int64_t last, const Bounds &rectangle, const Depths &depths,
              const CellGrid &grid, int64_t n, Also also) {
    const double *const bounds = grid.bounds.data + first;
    const int64_t stride = grid.bounds.extent(1);
    const auto touches = [&](int64_t k) {
        const auto value = [&](int column) { return bounds[stride * column + k]; };
        return (value(U_MIN) <= rectangle.u_max) & (value(U_MAX) >= rectangle.u_min) &
               (value(V_MIN) <= rectangle.v_max) & (value(V_MAX) >= rectangle.v_min) &
               (value(W_MAX) >= depths.least_near) & (value(W_MIN) >= depths.least_far) &
               (value(W_MIN) <= depths.most_far);
    };
    for (int64_t at = 0; at < last - first; at += AT_A_TIME) {
        int64_t is_found[AT_A_TIME]; // SPARE_ENTRIES behind the last may be read
        for (int k = 0; k < AT_A_TIME; k++) is_found[k] = touches(at + k) & also(first + at + k);
        uint64_t bits = 0;
        for (int k = 0; k < AT_A_TIME; k++) bits |= uint64_t(is_found[k]) << k;
        if (last - first - at < AT_A_TIME) bits &= (uint64_t(1) << (last - first - at)) - 1;
        for (; bits; bits &= bits - 1)
            grid.found[n++] = grid.entries[first + at + lowest_bit(bits)];
    }
    return n;
}

// True if the bounds of a group touch a rectangle and a range of depths.
inline bool touches(const Group &group, const Bounds &rectangle, const Depths &depths) {
    const auto &of = group.of;
    return (of[U_MIN].least <= rectangle.u_max) & (of[U_MAX].most >= rectangle.u_min) &
           (of[V_MIN].least <= rectangle.v_max) & (of[V_MAX].most >= rectangle.v_min) &
           (of[W_MAX].most >= depths.least_near) & (of[W_MIN].most >= depths.least_far) &
           (of[W_MIN].least <= depths.most_far);
}

// A walk through the entries of a cell with bounds: some at a time, or, of MANY, by groups, those
// first that are near a face with some keys.
class Walk {
  public:
    int64_t first, last; // entries of this step
    int32_t axis = -1;   // key by which they are sorted, see divide, -1 for none

    Walk(int64_t at, const CellGrid &grid, const double *keys = nullptr)
        : _rest(grid.starts[at]), _stop(grid.stops[at]), _grid(grid), _keys(keys) {
        if (_stop - _rest <= MANY) return;
        _todo[_n++] = all_groups(at, grid);
        _rest += _todo[0].size * GROUP_SIZE;
    }

    // Takes a step; false after the last one. Groups are passed over for which `may` is false.
    template <class May> bool next(May may) {
        while (_n > 0) {
            const Place place = _todo[--_n];
            Group &group = group_at(place, _grid);
            if (!may(group, place)) continue;
            if (place.size == 1) {
                axis = group.axis;
                first = place.first;
                last = first + GROUP_SIZE;
                return true;
            }
            const bool is_upper = _keys && _keys[group.axis] >= group.middle;
            _todo[_n++] = is_upper ? place.lower() : place.upper();
            _todo[_n++] = is_upper ? place.upper() : place.lower();
        }
        axis = -1;
        first = _rest;
        last = std::min(first + ENTRIES_AT_A_TIME, _stop);
        _rest = last;
        return first < last;
    }

  private:
    int64_t _rest, _stop;
    const CellGrid &_grid;
    const double *_keys;
    Place _todo[64];
    int _n = 0;
};

// Sorts the faces listed in a cell from front to back by their nearest depth, the first time. They
// are sorted into BUCKETS equal ranges of 1/z first, which leaves little to do.
//
// D. Shell. A High-Speed Sorting Procedure. 1959.
inline void sort_cell(int64_t at, const Array<double, Any, 6> &box, const CellGrid &grid) {
    grid.is_sorted[at] = true;
    grid.has_bounds[at] = false;
    const int64_t first = grid.starts[at], n = grid.stops[at] - first;
    int32_t *const entries = grid.entries.data + first, *const found = grid.found.data;
    double *const nearest = grid.nearest.data + first, *const key = grid.bounds.data + first;
    int64_t *const ends = grid.buckets.data;
    Range all;
    for (int64_t i = 0; i < n; i++) {
        const double w = box(entries[i], W_MAX);
        key[i] = w;
        found[i] = entries[i];
        all.add(w);
    }
    const auto [least, most] = all;
    const double per_w = most > least ? BUCKETS / (most - least) : 0.0;
    std::fill(ends, ends + BUCKETS + 1, 0);
    for (int64_t i = 0; i < n; i++) ends[cell(-key[i], -most, per_w, BUCKETS) + 1]++;
    for (int64_t bucket = 1; bucket <= BUCKETS; bucket++) ends[bucket] += ends[bucket - 1];
    for (int64_t i = 0; i < n; i++) {
        const int64_t bucket = cell(-key[i], -most, per_w, BUCKETS);
        nearest[ends[bucket]] = key[i];
        entries[ends[bucket]] = found[i];
        ends[bucket]++;
    }
    int64_t gap = 1;
    while (3 * gap + 1 < n) gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3)
        for (int64_t i = gap; i < n; i++) {
            const double w = nearest[i];
            const int32_t f = entries[i];
            int64_t j = i;
            for (; j >= gap && nearest[j - gap] < w; j -= gap) {
                nearest[j] = nearest[j - gap];
                entries[j] = entries[j - gap];
            }
            nearest[j] = w;
            entries[j] = f;
        }
}

} // namespace rastercov::exact
