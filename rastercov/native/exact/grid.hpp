// Regular grid over the image that lists the faces by cells.
//
// Cells are listed where they are asked for: near event edges, or all. Those of one row and column
// touch the boxes of the faces that they list.
//
// Twins: tests/exact/test_blocks.py lists faces by their boxes.
#pragma once
#include "exact/setup.hpp"

namespace rastercov::exact {

enum : uint8_t { NOT_ASKED, ASKED, LISTED }; // states of a cell
constexpr int64_t ENTRIES_AT_A_TIME = 64;    // entries of a cell that are compared at a time
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

// Lays the bounds of the faces of a cell one after another in memory, the first time.
inline void lay_bounds(int64_t at, const Array<double, Any, 6> &box, const CellGrid &grid) {
    if (grid.has_bounds[at]) return;
    grid.has_bounds[at] = true;
    for (int64_t entry = grid.starts[at]; entry < grid.stops[at]; entry++)
        for (int column = U_MIN; column <= W_MAX; column++)
            grid.bounds(column, entry) = box(grid.entries[entry], column);
}

// Depths of a face that is asked for: least W_MAX, least and greatest W_MIN.
struct Depths {
    double least_near, least_far, most_far;
};

// Adds the entries first ... last - 1, of one cell with bounds and at most ENTRIES_AT_A_TIME, whose
// boxes touch a rectangle and a range of depths, to grid.found, after the first n there; how many
// there are then.
inline int64_t find_faces(int64_t first, int64_t last, const Bounds &rectangle,
                          const Depths &depths, const CellGrid &grid, int64_t n) {
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
        for (int k = 0; k < AT_A_TIME; k++) is_found[k] = touches(at + k);
        uint64_t bits = 0;
        for (int k = 0; k < AT_A_TIME; k++) bits |= uint64_t(is_found[k]) << k;
        if (last - first - at < AT_A_TIME) bits &= (uint64_t(1) << (last - first - at)) - 1;
        for (; bits; bits &= bits - 1)
            grid.found[n++] = grid.entries[first + at + lowest_bit(bits)];
    }
    return n;
}

// Sorts the faces listed in a cell from front to back by their nearest depth, the first time. They
// are sorted into BUCKETS equal ranges of 1/z first, which leaves little to do.
//
// D. Shell. A High-Speed Sorting Procedure. 1959.
inline void sort_cell(int64_t at, const Array<double, Any, 6> &box, const CellGrid &grid) {
    grid.is_sorted[at] = true, grid.has_bounds[at] = false;
    const int64_t first = grid.starts[at], n = grid.stops[at] - first;
    int32_t *const entries = grid.entries.data + first, *const found = grid.found.data;
    double *const nearest = grid.nearest.data + first, *const key = grid.bounds.data + first;
    int64_t *const ends = grid.buckets.data;
    double least = INF, most = -INF;
    for (int64_t i = 0; i < n; i++) {
        const double w = box(entries[i], W_MAX);
        key[i] = w, found[i] = entries[i];
        least = std::min(least, w), most = std::max(most, w);
    }
    const double per_w = most > least ? BUCKETS / (most - least) : 0.0;
    std::fill(ends, ends + BUCKETS + 1, 0);
    for (int64_t i = 0; i < n; i++) ends[cell(-key[i], -most, per_w, BUCKETS) + 1]++;
    for (int64_t bucket = 1; bucket <= BUCKETS; bucket++) ends[bucket] += ends[bucket - 1];
    for (int64_t i = 0; i < n; i++) {
        const int64_t bucket = cell(-key[i], -most, per_w, BUCKETS);
        nearest[ends[bucket]] = key[i], entries[ends[bucket]] = found[i];
        ends[bucket]++;
    }
    int64_t gap = 1;
    while (3 * gap + 1 < n) gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3)
        for (int64_t i = gap; i < n; i++) {
            const double w = nearest[i];
            const int32_t f = entries[i];
            int64_t j = i;
            for (; j >= gap && nearest[j - gap] < w; j -= gap)
                nearest[j] = nearest[j - gap], entries[j] = entries[j - gap];
            nearest[j] = w, entries[j] = f;
        }
}

inline void require_cells(const CellGrid &grid) {
    const int64_t n = grid.columns * grid.rows;
    require(grid.columns > 0 && grid.rows > 0 && grid.columns < (1 << 15) &&
                grid.rows < (1 << 15) && grid.asked.rows() >= n && grid.is_near.rows() >= n &&
                grid.fresh.rows() >= n && grid.starts.rows() >= n && grid.stops.rows() >= n &&
                grid.is_sorted.rows() >= n && grid.has_bounds.rows() >= n && grid.hider.rows() >= n,
            "a grid must have room for its cells");
    require(grid.fresh_bits.extent(0) == grid.rows &&
                grid.fresh_bits.extent(1) == (grid.columns + 63) / 64,
            "fresh_bits must have one bit for each cell");
}

inline void require_grid(const CellGrid &grid, const Projected &projected) {
    const int64_t faces = projected.state.rows(), listed = grid.is_whole.rows();
    const int64_t entries = grid.entries.rows();
    require_cells(grid);
    require(grid.bounds.extent(1) >= entries + SPARE_ENTRIES && grid.pairs.rows() >= entries &&
                grid.nearest.rows() >= entries && grid.buckets.rows() > BUCKETS,
            "a grid must have the same room for its entries in each array");
    require(grid.faces.rows() == listed && grid.found.rows() == listed && listed <= faces,
            "a grid must have one row for each face that can be listed");
}

} // namespace rastercov::exact
