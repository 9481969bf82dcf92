// Filling of triangles: the paths from the faces of a cluster to samples of the image.
//
// | path             | triangles                                       | taken together        |
// | ---------------- | ----------------------------------------------- | --------------------- |
// | fill_samples_2x2 | reach at most 2 x 2 samples                     | a vector              |
// | fill_blocks_2x2  | reach at most 2 x 2 blocks of 4 x 4 samples     | a vector              |
// | fill_tiles       | any other of up to LARGE steps                  | one; 4 x 4 blocks     |
// | fill_cells       | wide, or parts of a clipped face, in 64 bits    | one; cells of image   |
//
// Visible counts are kept incrementally: writing a sample increments the count of its face and
// decrements that of the previous one. No pass over the image follows. Each path returns how many
// samples were empty.
//
// Twin: tests/raster/test_cpu.py, by whole numbers.
#pragma once
#include "raster/clipping.hpp"
#include "raster/coverage.hpp"
#include "raster/occlusion.hpp"
#include <tuple>

namespace rastercov::raster {

// Fills chosen triangles that reach at most 2 x 2 samples, and which of these each covers.
INLINE int64_t fill_samples_2x2(int64_t chosen, Int coverage, const Target &target, Triangles &t) {
    const auto &[window, image, counts, _] = target;
    const bool counts_drawn = counts.with_drawn && target.counts_in_blocks();
    int64_t filled = 0;
    int64_t covered = coverage_of_samples(coverage) & int64_t(uint64_t(chosen) * FOURFOLD);
    for (int k = 0; k < 4; k++)
        if (covered >> k * LANES & ALL_LANES) depth_of_samples(k, window, t);
    for (; covered; covered = without_lowest(covered)) {
        const int k = lowest(covered), lane = k & (LANES - 1);
        const int face = t.face[lane], sample = t.sample[k];
        if (window.full_x == 0) {
            const int x = t.first_x[lane] + (k >> 4 & 1), y = t.first_y[lane] + (k >> 5);
            if (x < window.first[y] || x >= window.last[y]) continue;
        }
        if (counts_drawn) add(1, face, counts.drawn);
        const float depth = t.depth[k], old = image.depth[sample];
        if (depth > old || (depth == old && image.face[sample] > face)) {
            if (old > 0) add(-1, image.face[sample], counts.visible);
            else filled++;
            add(1, face, counts.visible);
            image.depth[sample] = depth;
            image.face[sample] = face;
        }
    }
    return filled;
}

// Samples of a block that a face won, of those that count, and how many of them were empty.
struct Won {
    int64_t n, n_new;
};
// Writes the nearer samples of a block.
INLINE Won fill_block(int64_t at, int64_t covered, const BlockPlane &plane, float start, int face,
                      const Target &target) {
    auto [won, lost, ties] = depth_test(target.image.depth, at, covered, plane, start);
    const Int old = load(target.image.face, at);
    if (ties) { // the lower face wins
        ties &= bits(old > Int(face));
        won |= ties;
        lost |= ties;
    }
    if (won == 0) return {0, 0};
    const int64_t n_new = count(won) - count(lost);
    while (lost) {
        const int loser = target.image.face[at + lowest(lost)];
        const int64_t its = bits(old == Int(loser)) & lost;
        add(-count_block(its, at, target.counts), loser, target.counts.visible);
        lost &= ~its;
    }
    store(select<int32_t>(as_mask(won), Int(face), old), target.image.face, at);
    return {count_block(won, at, target.counts), n_new};
}

// Fills chosen triangles that reach at most 2 x 2 blocks.
INLINE int64_t fill_blocks_2x2(int64_t chosen, const Sides &sides, const Target &target,
                               Setup<int32_t> &t) {
    const auto &[window, image, counts, _] = target;
    int64_t filled = 0;
    int64_t found = 0;
    int64_t at_border = 0;
    for (int k = 0; k < 4; k++)
        if ((!(k & 1) || chosen & sides.wide) && (!(k >> 1) || chosen & sides.tall)) {
            const InBlocks some = cover_blocks(k, window, t);
            found |= (some.covered & chosen) << k * LANES;
            at_border |= some.at_border << k * LANES;
        }
    for (; found; found = without_lowest(found)) {
        const int k = lowest(found), lane = k & (LANES - 1), face = t.face[lane];
        int64_t covered = t.masks[k];
        if (at_border >> k & 1) {
            const int block_x = (t.first_x[lane] >> SIDE_BITS) + (k >> 4 & 1);
            const int block_y = (t.first_y[lane] >> SIDE_BITS) + (k >> 5);
            covered &= border_mask(block_x, block_y, window);
        }
        const int64_t at = t.sample[k];
        if (counts.with_drawn) add(count_block(covered, at, counts), face, counts.drawn);
        const Won won = fill_block(at, covered, block_plane(lane, t), t.depth[k], face, target);
        add(won.n, face, counts.visible);
        filled += won.n_new;
    }
    return filled;
}

// The same of scattered samples.
INLINE int64_t fill_scattered(int64_t chosen, const Sides &sides, const Target &target,
                              Setup<int32_t> &t) {
    const auto &[window, image, counts, _] = target;
    int64_t filled = 0;
    for (int64_t found = reach_2x2(chosen, sides.wide, sides.tall, window, t); found;
         found = without_lowest(found)) {
        const int k = lowest(found), lane = k & (LANES - 1), face = t.face[lane];
        const int64_t covered = cover_reached(k, window, t), at = t.sample[k];
        if (covered == 0) continue;
        if (counts.with_drawn) add(count_block(covered, at, counts), face, counts.drawn);
        BlockPlane plane = block_plane(lane, t);
        plane.beyond = beyond_corner(lane, at, window, t);
        const int x = ((t.first_x[lane] >> SIDE_BITS) + (k >> 4 & 1)) << SIDE_BITS;
        const int y = ((t.first_y[lane] >> SIDE_BITS) + (k >> 5)) << SIDE_BITS;
        const double start = t.origin[lane] + t.slope_y[lane] * y + t.slope_x[lane] * x;
        const Won won = fill_block(at, covered, plane, float(start), face, target);
        add(won.n, face, counts.visible);
        filled += won.n_new;
    }
    return filled;
}

// Samples of a triangle: covered, and won; and how many of these were empty.
struct Filled {
    int64_t covered = 0;
    int64_t gained = 0;
    int64_t n_new = 0;
};
// Fills a block of triangle k, of start_blocks.
INLINE void fill_lane(int k, int lane, int64_t covered, const Triangles &t, BlockPlane plane,
                      const Target &target, Filled &filled) {
    const int64_t at = t.sample[lane];
    if (target.window.is_scattered()) plane.beyond = beyond_corner(k, at, target.window, t);
    const Won won = fill_block(at, covered, plane, t.depth[lane], t.face[k], target);
    filled.gained += won.n;
    filled.n_new += won.n_new;
}
INLINE int64_t add_filled(const Filled &filled, int face, const Counts &counts) {
    if (filled.gained) add(filled.gained, face, counts.visible);
    if (counts.with_drawn) add(filled.covered, face, counts.drawn);
    return filled.n_new;
}

// Fills triangle k, a large one. Its tiles are cells, so those behind what is drawn are skipped,
// and those that it covers wholly bound the depth of their cells.
template <class T> int64_t fill_cells(int k, const Target &target, Setup<int64_t> &t) {
    const auto &[window, image, counts, _] = target;
    const Range reached = blocks_of(k, t);
    const int top = window.top >> SIDE_BITS;
    const int first_y = reached.first_y - ((reached.first_y - top) & (SIDE - 1));
    const BlockPlane plane = block_plane(k, t);
    const int face = t.face[k];
    TileEdges<T> tile;
    start_tiles(k, t, window, tile);
    Filled filled;
    for (int y = first_y; y <= reached.last_y; y += SIDE)
        for (int x = reached.first_x & -SIDE; x <= reached.last_x; x += SIDE) {
            if (x + SIDE <= reached.last_x) prefetch_places(x + SIDE, y, window);
            int64_t blocks = blocks_of_tile(k, x, y, reached, t, window, tile);
            if (!blocks) continue;
            const int64_t cells = int64_t((y - top) >> SIDE_BITS) * (window.columns >> SIDE_BITS);
            float &bound = image.cell_depth[cells + (x >> SIDE_BITS)];
            start_blocks(k, x, y, window, t);
            int64_t shown = blocks & ~hidden_blocks(k, bound, window, t);
            const bool is_used = bound < std::numeric_limits<float>::infinity();
            if (!shown && !(counts.with_drawn && is_used)) continue;
            const bool is_cut = x + SIDE > window.full_x || y + SIDE > window.full_y;
            if (blocks == ALL_LANES && !is_cut && whole_blocks(k, t, window, tile) == ALL_LANES) {
                if (counts.with_drawn)
                    for (int lane = 0; lane < LANES; lane++)
                        filled.covered += count_block(ALL_LANES, t.sample[lane], counts);
                const float least = least_in_tile(k, window, t);
                for (; shown; shown = without_lowest(shown))
                    fill_lane(k, lowest(shown), ALL_LANES, t, plane, target, filled);
                bound = std::max(bound, least);
                continue;
            }
            if (!counts.with_drawn) blocks = shown;
            const int64_t whole = whole_scattered(k, t, window, tile);
            for (; blocks; blocks = without_lowest(blocks)) {
                const int lane = lowest(blocks);
                const int64_t covered =
                    covered_in<int64_t>(lane, x, y, whole, is_cut, tile, t.sample[lane], window);
                filled.covered += count_block(covered, t.sample[lane], counts);
                if (covered && shown >> lane & 1)
                    fill_lane(k, lane, covered, t, plane, target, filled);
            }
        }
    return add_filled(filled, face, counts);
}

// Fills chosen triangles of any size.
inline int64_t fill_tiles(int64_t chosen, const Target &target, Setup<int32_t> &t) {
    const auto &[window, image, counts, _] = target;
    int64_t n_new = 0;
    TileEdges<int32_t> tile;
    for (; chosen; chosen = without_lowest(chosen)) {
        const int k = lowest(chosen);
        const Range reached = blocks_of(k, t);
        const bool is_cut = reached.last_x >= window.full_x || reached.last_y >= window.full_y;
        const BlockPlane plane = block_plane(k, t);
        const int face = t.face[k];
        start_tiles(k, t, window, tile);
        Filled filled;
        for (int y = reached.first_y; y <= reached.last_y; y += SIDE)
            for (int x = reached.first_x; x <= reached.last_x; x += SIDE) {
                int64_t blocks = blocks_of_tile(k, x, y, reached, t, window, tile);
                const int64_t whole = whole_scattered(k, t, window, tile);
                start_blocks(k, x, y, window, t);
                for (; blocks; blocks = without_lowest(blocks)) {
                    const int lane = lowest(blocks);
                    const int64_t covered = covered_in<int32_t>(lane, x, y, whole, is_cut, tile,
                                                                t.sample[lane], window);
                    if (covered == 0) continue;
                    if (counts.with_drawn)
                        filled.covered += count_block(covered, t.sample[lane], counts);
                    fill_lane(k, lane, covered, t, plane, target, filled);
                }
            }
        n_new += add_filled(filled, face, counts);
    }
    return n_new;
}

// Those of the chosen triangles that are behind what is drawn in all cells that they reach.
INLINE int64_t hidden_lanes(int64_t chosen, const Target &target, const Triangles &t) {
    int64_t hidden = 0;
    for (; chosen; chosen = without_lowest(chosen)) {
        const int k = lowest(chosen);
        const bool is = is_hidden(samples_of(k, t), t.greatest[k], target.window, target.image);
        hidden |= int64_t(is) << k;
    }
    return hidden;
}

// Fills listed triangles of up to LARGE steps.
inline int64_t fill_small(Bins &bins, const Faces &faces, const Target &target, Setup<int32_t> &t) {
    const int n_small = bins.samples_2x2.n, n = n_small + bins.larger.n;
    int32_t *slots = bins.samples_2x2.slots;
    // The larger ones behind them, so that few lanes stay empty.
    std::copy_n(bins.larger.slots, bins.larger.n, slots + n_small);
    int64_t filled = 0;
    for (int i = 0; i < n; i += LANES) {
        const Sides sides = set_up<true>(slots + i, i + LANES > n_small, faces, target.window, t);
        const int64_t small = first_lanes(n_small - i);
        int64_t others = first_lanes(n - i) & ~small;
        if (target.tests_cells) {
            const int64_t hidden = hidden_lanes(others, target, t);
            others &= ~hidden;
            if (hidden && target.counts.with_backs) count_lanes(hidden, target, t);
        }
        if (small) {
            const Int coverage = Int::load(bins.samples_2x2.coverage + i);
            filled += fill_samples_2x2(small, coverage, target, t);
        }
        int64_t in_blocks = sides.in_2x2 & others;
        if (target.window.is_scattered()) filled += fill_scattered(in_blocks, sides, target, t);
        else if (count(in_blocks) < MIN_VECTOR_FACES) in_blocks = 0;
        else filled += fill_blocks_2x2(in_blocks, sides, target, t);
        const int64_t in_tiles = others & ~in_blocks;
        if (in_tiles) filled += fill_tiles(in_tiles, target, t);
    }
    return filled;
}

// Fills triangles of any size in 64 bits. `plane` is that of the face of which all are parts; each
// has its own where it is not finite.
inline int64_t fill_any(const int32_t *slots, int n, const Faces &faces, const Target &target,
                        const Plane &plane, Setup<int64_t> &t) {
    const bool has_plane = is_finite(plane);
    int64_t filled = 0;
    for (int i = 0; i < n; i += LANES) {
        const Sides sides = set_up<true>(slots + i, true, faces, target.window, t);
        for (int k = 0; k < (has_plane ? std::min(n - i, LANES) : 0); k++) {
            t.origin[k] = plane.origin;
            if (target.window.is_scattered()) t.origin[k] -= 0.5 * (plane.slope_x + plane.slope_y);
            t.slope_x[k] = plane.slope_x;
            t.step_x[k] = float(plane.slope_x);
            t.slope_y[k] = plane.slope_y;
            t.step_y[k] = float(plane.slope_y);
        }
        const int64_t valid = first_lanes(n - i);
        for (int64_t shown = sides.shown & valid; shown; shown = without_lowest(shown)) {
            const int k = lowest(shown);
            filled += fits_32_bits(k, t, target.window) ? fill_cells<int32_t>(k, target, t)
                                                        : fill_cells<int64_t>(k, target, t);
        }
        int64_t hidden = target.counts.with_backs ? sides.hidden & valid : 0;
        for (; hidden; hidden = without_lowest(hidden)) {
            const int k = lowest(hidden);
            const int64_t covered = fits_32_bits(k, t, target.window)
                                        ? count_covered<int32_t>(k, target, t)
                                        : count_covered<int64_t>(k, target, t);
            add(covered, t.face[k], target.counts.drawn);
        }
    }
    return filled;
}

} // namespace rastercov::raster
