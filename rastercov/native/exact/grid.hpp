// Regular grid over the image that lists the faces by cells.
//
// Cells are listed where they are asked for: near event edges, or all. Those of one row and column
// touch the boxes of the faces that they list.
//
// Twins: tests/exact/test_blocks.py lists faces by their boxes.
#pragma once
#include "exact/setup.hpp"
#include <cstring>
#include <tuple>

namespace rastercov::exact {

enum : uint8_t { NOT_ASKED, ASKED, LISTED }; // states of a cell
constexpr int64_t ENTRIES_AT_A_TIME = 64;    // entries of a cell that are compared at a time
constexpr int64_t MANY = 256;                // entries of a cell whose corners are compared, too
// First row of them in CellGrid.bounds, of groups, and of groups of groups.
enum { CORNER = 6, GROUP = 12, LARGE_GROUP = 13 };
constexpr int64_t GROUP_SIZE = 32; // entries of a group, and groups of a large one
constexpr int64_t LARGE_GROUP_SIZE = GROUP_SIZE * GROUP_SIZE;
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

// Affine bound of 1/z in a cell: `most` at (u, v), with slopes from there; INF for none.
struct Ceiling {
    double u, v, slope_u, slope_v, most;

    // True if it is surely not above w at a point.
    bool is_below(double at_u, double at_v, double w) const {
        const double along_u = slope_u * (at_u - u), along_v = slope_v * (at_v - v);
        const double size = std::abs(most) + std::abs(along_u) + std::abs(along_v);
        return size <= MOST_OF_CEILING * w && most + along_u + along_v <= w * (1 + DEPTH_TIE_REL);
    }
    static constexpr double MOST_OF_CEILING = 1e4; // times 1/z, for the rounding
};

// Bounds of GROUP_SIZE entries, or groups: their boxes, the greatest W_MIN and W_MAX and the least
// W_MIN, the least and greatest u and v of each of their three corners, the vertex that all have
// there, NaN for none, and 1/z of their planes in the cell.
struct Group {
    Bounds box;
    double most_far, most_near, least_far;
    Bounds corners[3];
    double common[3];
    Ceiling ceiling;
    double is_settled; // 1 if no crossing is listed of any of them any more
};
static_assert(sizeof(Group) <= GROUP_SIZE * sizeof(double));

inline Group group_at(int64_t first, const CellGrid &grid, int row = GROUP) {
    Group group;
    std::memcpy(&group, &grid.bounds(row, first), sizeof(Group));
    return group;
}
inline void store_group(const Group &group, int64_t first, const CellGrid &grid, int row = GROUP) {
    std::memcpy(&grid.bounds(row, first), &group, sizeof(Group));
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

// Sets a ceiling that has a point and slopes to the least one above some others, in a rectangle.
template <class At> void raise(Ceiling &ceiling, const Bounds &rectangle, At other) {
    double most = -INF;
    for (int64_t k = 0; k < GROUP_SIZE; k++) {
        const Ceiling its = other(k);
        for (const double u : {rectangle.u_min, rectangle.u_max})
            for (const double v : {rectangle.v_min, rectangle.v_max}) {
                const double above = its.most + its.slope_u * (u - its.u) +
                                     its.slope_v * (v - its.v) - ceiling.slope_u * (u - ceiling.u) -
                                     ceiling.slope_v * (v - ceiling.v);
                most = above <= most ? most : above;
                if (!std::isfinite(above)) most = INF;
            }
    }
    ceiling.most = most;
}

// Vertices of an entry, those that the first one of its group has in the same places.
inline std::array<int32_t, 3> corners_of_entry(int64_t entry, int64_t first, const View &view) {
    const auto &[faces, entries] = std::tie(view.projected.faces, view.grid.entries);
    const int64_t f = entries[entry];
    std::array<int32_t, 3> corners = {faces(f, 0), faces(f, 1), faces(f, 2)};
    for (int k = 0; k < 3 && entry != first; k++)
        for (int32_t &corner : corners)
            if (corner == faces(entries[first], k)) std::swap(corner, corners[k]);
    return corners;
}

inline void lay_group(int64_t first, const Bounds &rectangle, const View &view) {
    const auto &[projected, grid] = std::tie(view.projected, view.grid);
    const auto row = [&](int64_t column) { return &grid.bounds(column, first); };
    const auto least_in = [](const double *values) {
        double least = values[0];
        for (int64_t k = 1; k < GROUP_SIZE; k++) least = std::min(least, values[k]);
        return least;
    };
    const auto most_in = [](const double *values) {
        double most = values[0];
        for (int64_t k = 1; k < GROUP_SIZE; k++) most = std::max(most, values[k]);
        return most;
    };
    Group group;
    group.box = {least_in(row(U_MIN)), most_in(row(U_MAX)), least_in(row(V_MIN)),
                 most_in(row(V_MAX))};
    group.most_far = most_in(row(W_MIN));
    group.least_far = least_in(row(W_MIN));
    group.most_near = most_in(row(W_MAX));
    bool is_known = true;
    for (int64_t k = 0; k < GROUP_SIZE; k++) is_known &= !std::isnan(row(CORNER)[k]);
    for (int k = 0; k < 3; k++) {
        const double *const u = row(CORNER + 2 * k), *const v = row(CORNER + 2 * k + 1);
        group.corners[k] = {NAN, NAN, NAN, NAN};
        if (is_known) group.corners[k] = {least_in(u), most_in(u), least_in(v), most_in(v)};
        const int64_t vertex = corners_of_entry(first, first, view)[k];
        group.common[k] = double(vertex);
        for (int64_t i = 1; i < GROUP_SIZE; i++)
            if (corners_of_entry(first + i, first, view)[k] != vertex) group.common[k] = NAN;
    }
    const auto ceiling_of = [&](int64_t k) -> Ceiling {
        const Plane of = plane_of(grid.entries[first + k], view.camera, view.projected);
        return {of.u, of.v, of.a, of.b, of.w};
    };
    group.ceiling = ceiling_of(0);
    raise(group.ceiling, rectangle, ceiling_of);
    group.is_settled = 0;
    store_group(group, first, grid);
}

inline void lay_large_group(int64_t first, const Bounds &rectangle, const CellGrid &grid) {
    const auto part = [&](int64_t k) { return group_at(first + k * GROUP_SIZE, grid); };
    const auto widen = [](Bounds &all, const Bounds &its) { // of numbers
        all = {all.u_min <= its.u_min ? all.u_min : its.u_min,
               all.u_max >= its.u_max ? all.u_max : its.u_max,
               all.v_min <= its.v_min ? all.v_min : its.v_min,
               all.v_max >= its.v_max ? all.v_max : its.v_max};
    };
    Group all = part(0);
    bool is_known = true;
    for (int64_t k = 0; k < GROUP_SIZE; k++) {
        const Group its = part(k);
        widen(all.box, its.box);
        all.most_far = std::max(all.most_far, its.most_far);
        all.least_far = std::min(all.least_far, its.least_far);
        all.most_near = std::max(all.most_near, its.most_near);
        for (int corner = 0; corner < 3; corner++) {
            widen(all.corners[corner], its.corners[corner]);
            if (its.common[corner] != all.common[corner]) all.common[corner] = NAN;
        }
        is_known &= !std::isnan(its.corners[0].u_min);
    }
    if (!is_known)
        for (Bounds &corner : all.corners) corner = {NAN, NAN, NAN, NAN};
    raise(all.ceiling, rectangle, [&](int64_t k) { return part(k).ceiling; });
    store_group(all, first, grid, LARGE_GROUP);
}

// Lays the bounds of the faces of a cell one after another in memory, the first time.
//
// Of more than MANY faces, such as needles of one fan, the corners follow: boxes hardly separate
// them. A face that is clipped, or whose outline is in doubt, has NaN there, which no comparison
// excludes. Bounds of groups of them follow, those of one group where its entries would be.
inline void lay_bounds(int64_t at, const View &view) {
    const auto &[projected, grid] = std::tie(view.projected, view.grid);
    if (grid.has_bounds[at]) return;
    grid.has_bounds[at] = true;
    const int64_t first = grid.starts[at], stop = grid.stops[at];
    for (int64_t entry = first; entry < stop; entry++)
        for (int column = U_MIN; column <= W_MAX; column++)
            grid.bounds(column, entry) = projected.box(grid.entries[entry], column);
    if (stop - first <= MANY) return;
    for (int64_t entry = first; entry < stop; entry++) {
        const int64_t f = grid.entries[entry];
        const bool is_known = !(projected.state[f] & (CLIPPED | DOUBTFUL | THIN));
        const auto corners = corners_of_entry(entry, entry - (entry - first) % GROUP_SIZE, view);
        for (int k = 0; k < 3; k++)
            for (const int axis : {U, V})
                grid.bounds(CORNER + 2 * k + axis, entry) =
                    is_known ? projected.uvw(corners[k], axis) : NAN;
    }
    const Bounds rectangle = rectangle_of_cell(at, view);
    for (int64_t entry = first; entry + GROUP_SIZE <= stop; entry += GROUP_SIZE)
        lay_group(entry, rectangle, view);
    for (int64_t entry = first; entry + LARGE_GROUP_SIZE <= stop; entry += LARGE_GROUP_SIZE)
        lay_large_group(entry, rectangle, grid);
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
    for (int k = 0; k < 3; k++) {
        const double common = group.common[k];
        if (common == double(without) || common == double(or_without)) continue;
        const auto [u_min, u_max, v_min, v_max] = group.corners[k];
        const double u = line.dv > 0 ? u_max : u_min, v = line.du > 0 ? v_min : v_max;
        const double low = line.value(u, v);
        const double high = line.value(line.dv > 0 ? u_min : u_max, line.du > 0 ? v_max : v_min);
        if (std::isnan(low)) return {NAN, NAN};
        all.add(low);
        all.add(high);
    }
    return all;
}

// True if the first three of some lines have all corners of an entry on the outer side of one of
// them, or on it; of a cell of MANY faces.
template <class Rows>
bool is_beyond_a_line(int64_t entry, const Rows &lines, const CellGrid &grid) {
    return (values_at_corners(entry, line_at(lines, 0), grid).most <= 0) |
           (values_at_corners(entry, line_at(lines, 1), grid).most <= 0) |
           (values_at_corners(entry, line_at(lines, 2), grid).most <= 0);
}
template <class Rows> bool is_beyond_a_line(const Group &group, const Rows &lines) {
    return (values_at_corners(group, line_at(lines, 0)).most <= 0) |
           (values_at_corners(group, line_at(lines, 1)).most <= 0) |
           (values_at_corners(group, line_at(lines, 2)).most <= 0);
}

// True if a point is surely outside of an entry of a cell of MANY faces, by more than `margin`
// pixels along u and v.
inline bool is_outside(int64_t entry, double u, double v, double margin, const CellGrid &grid) {
    const double *const corner = grid.bounds.data + grid.bounds.extent(1) * CORNER + entry;
    const int64_t stride = grid.bounds.extent(1);
    bool is_left = false;
    bool is_right = false;
    for (int k = 0; k < 3; k++) {
        const int j = k < 2 ? k + 1 : 0;
        const double from_u = corner[2 * k * stride], from_v = corner[(2 * k + 1) * stride];
        const double du = corner[2 * j * stride] - from_u,
                     dv = corner[(2 * j + 1) * stride] - from_v;
        const double value = du * (v - from_v) - dv * (u - from_u);
        const double width = margin * (std::abs(du) + std::abs(dv));
        is_left |= value<-width, is_right |= value> width;
    }
    return is_left & is_right;
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
inline int64_t find_faces(int64_t first, int64_t last, const Bounds &rectangle,
                          const Depths &depths, const CellGrid &grid, int64_t n) {
    return find_faces_if(first, last, rectangle, depths, grid, n, [](int64_t) { return true; });
}

// True if the bounds of a group touch a rectangle and a range of depths.
inline bool touches(const Group &group, const Bounds &rectangle, const Depths &depths) {
    const Bounds &box = group.box;
    return (box.u_min <= rectangle.u_max) & (box.u_max >= rectangle.u_min) &
           (box.v_min <= rectangle.v_max) & (box.v_max >= rectangle.v_min) &
           (group.most_near >= depths.least_near) & (group.most_far >= depths.least_far) &
           (group.least_far <= depths.most_far);
}

// The entry of a cell of MANY faces, with bounds, at which a search goes on: after the large groups
// from an entry on that do not touch, or for which `may` is false.
template <class May>
inline int64_t after_groups(int64_t entry, int64_t at, const Bounds &rectangle,
                            const Depths &depths, const CellGrid &grid, May may) {
    const int64_t first = grid.starts[at], stop = grid.stops[at];
    while ((entry - first) % LARGE_GROUP_SIZE == 0 && entry + LARGE_GROUP_SIZE <= stop) {
        const Group group = group_at(entry, grid, LARGE_GROUP);
        if (touches(group, rectangle, depths) && may(group, entry, LARGE_GROUP)) break;
        entry += LARGE_GROUP_SIZE;
    }
    return entry;
}

// The same as find_faces_if in a cell of MANY faces, but for groups whose bounds do not touch, or
// for which `may` is false; `first` is a multiple of GROUP_SIZE entries from the start of the cell.
template <class May, class Also>
inline int64_t find_in_groups(int64_t first, int64_t last, const Bounds &rectangle,
                              const Depths &depths, const CellGrid &grid, int64_t n, May may,
                              Also also) {
    for (; first < last; first += GROUP_SIZE) {
        const int64_t end = std::min(first + GROUP_SIZE, last);
        if (end - first == GROUP_SIZE) {
            const Group group = group_at(first, grid);
            if (!touches(group, rectangle, depths) || !may(group, first, GROUP)) continue;
        }
        n = find_faces_if(first, end, rectangle, depths, grid, n, also);
    }
    return n;
}

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
