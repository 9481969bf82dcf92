// Faces listed by the cells of a grid that their boxes touch.
//
// Twins: tests/exact/test_blocks.py.
#include "exact/grid.hpp"
#include "exact/passes.hpp"
#include "interrupt.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
// Asks for all cells.
void ask_for_all(const CellGrid &grid) {
    ask_for_cells({0, grid.columns - 1, 0, grid.rows - 1}, grid);
}

// Asks for the cells that the boxes of some faces touch; true if one had not been asked for.
bool ask_for_faces(Int32Array faces, Array<double, Any, 6> box, const CellGrid &grid) {
    for (const int32_t f : faces) ask_for_cells(cells_of_box(box, f, grid), grid);
    return grid.n_fresh[0] > 0;
}

namespace {

// Bits of 64-bit word `word` of a row that are those of columns first ... last.
uint64_t bits_of_word(int64_t word, int64_t first, int64_t last) {
    uint64_t bits = ~uint64_t(0);
    if (word == first >> 6) bits &= ~uint64_t(0) << (first & 63);
    if (word == last >> 6) bits &= ~uint64_t(0) >> (63 - (last & 63));
    return bits;
}

// True if a cell of a rectangle is asked for and not listed.
bool has_fresh(const Cells &cells, const CellGrid &grid) {
    for (int64_t row = cells.top; row <= cells.bottom; row++)
        for (int64_t word = cells.left >> 6; word <= cells.right >> 6; word++)
            if (grid.fresh_bits(row, word) & bits_of_word(word, cells.left, cells.right))
                return true;
    return false;
}

// Bits of those of AT_A_TIME faces whose boxes may touch a cell that is asked for.
uint64_t faces_near(int64_t first, const Projected &projected, const CellGrid &grid) {
    const Lanes p = corners_of(first, 0, projected), q = corners_of(first, 1, projected),
                r = corners_of(first, 2, projected);
    const auto place = [](double position, double origin, double per_pixel, int64_t n) {
        const int32_t at = int32_t((position - origin) * per_pixel);
        return std::min(std::max(at, 0), int32_t(n) - 1);
    };
    int32_t low[AT_A_TIME], upper[AT_A_TIME], is_large[AT_A_TIME];
    for (int k = 0; k < AT_A_TIME; k++) {
        low[k] = place(least(p.u[k], q.u[k], r.u[k]), grid.left, grid.per_u, grid.columns);
        const int32_t high =
            place(greatest(p.u[k], q.u[k], r.u[k]), grid.left, grid.per_u, grid.columns);
        upper[k] = place(least(p.v[k], q.v[k], r.v[k]), grid.top, grid.per_v, grid.rows);
        const int32_t lower =
            place(greatest(p.v[k], q.v[k], r.v[k]), grid.top, grid.per_v, grid.rows);
        is_large[k] = (high - low[k] > 1) | (lower - upper[k] > 1);
    }
    uint64_t bits = 0;
    for (int k = 0; k < AT_A_TIME; k++) {
        const bool is_near = grid.is_near[upper[k] * grid.columns + low[k]];
        bits |= uint64_t(is_near | is_large[k]) << k;
    }
    return bits;
}

// Adds a face and its cells that are asked for to the first n of grid.pairs; their number. If there
// is too little room, that is more than there is room for.
int64_t list_pairs(int64_t n, int64_t f, const Array<double, Any, 6> &box, const CellGrid &grid) {
    const auto [left, right, top, bottom] = cells_of_box(box, f, grid);
    const int64_t n_touched = (right - left + 1) * (bottom - top + 1), room = grid.pairs.rows();
    if (n + std::max(n_touched, int64_t(4)) > room) return room + n_touched;
    const int64_t before = n;
    // Without a branch: which cells are asked for is not predictable.
    const auto list = [&](int64_t row, int64_t column, bool is_touched) {
        const int64_t at = row * grid.columns + column;
        grid.pairs(n, 0) = int32_t(at);
        grid.pairs(n, 1) = int32_t(f);
        n += is_touched & (grid.asked[at] == ASKED);
    };
    if (right - left <= 1 && bottom - top <= 1) {
        list(top, left, true);
        list(top, right, right > left);
        list(bottom, left, bottom > top);
        list(bottom, right, (right > left) & (bottom > top));
    } else {
        for (int64_t row = top; row <= bottom; row++)
            for (int64_t column = left; column <= right; column++) list(row, column, true);
    }
    grid.is_whole[f] = n - before == n_touched;
    return n;
}

// Lists faces by the cells asked for: those of the first n_pairs of grid.pairs.
void list_fresh(int64_t n_pairs, const CellGrid &grid) {
    const int64_t n_fresh = grid.n_fresh[0];
    for (int64_t k = 0; k < n_fresh; k++) {
        const int64_t c = grid.fresh[k];
        grid.is_sorted[c] = grid.has_bounds[c] = false;
        grid.hider[c] = -1;
        grid.stops[c] = 0;
    }
    for (int64_t k = 0; k < n_pairs; k++) grid.stops[grid.pairs(k, 0)]++;
    int64_t at = grid.n_entries[0];
    for (int64_t k = 0; k < n_fresh; k++) {
        const int64_t c = grid.fresh[k], row = c / grid.columns, column = c % grid.columns;
        grid.starts[c] = at;
        at += grid.stops[c];
        grid.stops[c] = grid.starts[c];
        grid.asked[c] = LISTED;
        grid.fresh_bits(row, column >> 6) = 0;
        mark_near(row, column, false, grid);
    }
    for (int64_t k = 0; k < n_pairs; k++)
        grid.entries[grid.stops[grid.pairs(k, 0)]++] = grid.pairs(k, 1);
}

} // namespace

// Lists the live and thin faces by the cells asked for; returns the number of entries.
//
// Cells that are listed already keep their entries, and those of the others follow. Out: `asked`,
// `starts`, `stops`, `entries`, `is_sorted`, `has_bounds` and `hider` of these cells; `faces`,
// `n_faces` and `is_whole`; `n_entries`. Where `entries` has too little room, none is listed, and
// the result is more than that: call again with more. The faces that are listed have boxes.
int64_t fill_grid(const Projected &projected, const CellGrid &grid) {
    const int64_t n_faces = projected.state.rows(), room = grid.entries.rows();
    const int64_t n_fresh = grid.n_fresh[0];
    const bool is_all = n_fresh == grid.columns * grid.rows;
    for (int64_t index = 0; index < grid.n_faces[0]; index++)
        grid.is_whole[grid.faces[index]] = false;
    int64_t n_pairs = 0;
    int64_t n_listed = 0;
    Poll poll(64);
    for (int64_t b = 0; b < projected.block_box.rows(); b++) {
        poll();
        if (!(projected.block_box(b, U_MIN) <= projected.block_box(b, U_MAX))) continue;
        if (is_all) lay_boxes_of_block(b, projected);
        else if (!has_fresh(cells_of_box(projected.block_box, b, grid), grid)) continue;
        const bool has_boxes = projected.has_boxes[b];
        for (int64_t first = b * BLOCK; first < std::min((b + 1) * BLOCK, n_faces);
             first += AT_A_TIME) {
            // A block without boxes is full.
            uint64_t near = (uint64_t(1) << std::min(AT_A_TIME, n_faces - first)) - 1;
            if (!has_boxes) near = faces_near(first, projected, grid);
            for (; near; near &= near - 1) {
                const int64_t f = first + lowest_bit(near);
                if (!(projected.state[f] & (LIVE | THIN))) continue;
                if (!has_boxes) lay_box(f, projected);
                const int64_t before = n_pairs;
                n_pairs = list_pairs(n_pairs, f, projected.box, grid);
                grid.faces[n_listed] = int32_t(f);
                n_listed += n_pairs > before;
                if (n_pairs > grid.pairs.rows()) {
                    grid.n_faces[0] = n_listed;
                    return 2 * room;
                }
            }
        }
    }
    const int64_t total = grid.n_entries[0] + n_pairs;
    grid.n_faces[0] = n_listed;
    if (total > room) return total;
    list_fresh(n_pairs, grid);
    grid.n_fresh[0] = 0;
    grid.n_entries[0] = total;
    return total;
}

} // namespace exact
} // namespace rastercov
