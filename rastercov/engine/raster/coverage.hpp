// Samples that triangles cover: blocks in reach, the image border, and counts without depth.
//
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/depth.hpp"
#include "raster/setup.hpp"

namespace rastercov::raster {

// Samples of a block that are inside the image.
inline int64_t border_mask(int block_x, int block_y, const Window &window) {
    int64_t inside = 0;
    const int left = block_x << SIDE_BITS;
    for (int j = 0; j < SIDE; j++) {
        const int row = (block_y << SIDE_BITS) + j;
        if (row >= window.height) break;
        const int begin = int(std::clamp<int64_t>(int64_t(window.first[row]) - left, 0, SIDE));
        const int end = int(std::clamp<int64_t>(int64_t(window.last[row]) - left, 0, SIDE));
        inside |= int64_t(((1 << end) - 1) & ~((1 << begin) - 1)) << SIDE * j;
    }
    return inside;
}
INLINE int64_t mask_in_image(int64_t bits, int block_x, int block_y, const Window &window) {
    const bool is_inside =
        block_x >= window.inner(block_y, 0) && block_x < window.inner(block_y, 1);
    return is_inside ? bits : bits & border_mask(block_x, block_y, window);
}

INLINE Range samples_of(int k, const Triangles &t) {
    return {t.first_x[k], t.last_x[k], t.first_y[k], t.last_y[k]};
}
INLINE Range blocks_of(int k, const Triangles &t) {
    return {t.first_x[k] >> SIDE_BITS, t.last_x[k] >> SIDE_BITS, t.first_y[k] >> SIDE_BITS,
            t.last_y[k] >> SIDE_BITS};
}
// Blocks of a tile that triangle k may cover samples of, see reach_blocks.
template <class E, class T>
INLINE int64_t blocks_of_tile(int k, int tile_x, int tile_y, const Range &blocks, const Edges<E> &t,
                              const Window &window, TileEdges<T> &tile) {
    const int64_t found =
        reach_blocks(k, tile_x - blocks.first_x, tile_y - blocks.first_y, t, window, tile);
    const int columns = std::min(blocks.last_x - tile_x + 1, SIDE);
    const int rows = std::min(blocks.last_y - tile_y + 1, SIDE);
    return found & ((1 << columns) - 1) * 0x1111 & ((1 << SIDE * rows) - 1);
}

// Requests the places of the scattered samples of blocks of a tile, whose samples are in t.sample.
INLINE void prefetch_places(int tile_x, int tile_y, const Window &window) {
    if (!window.is_scattered()) return;
    const int top = tile_y - (window.top >> SIDE_BITS);
    const int last = (window.bottom - window.top) >> SIDE_BITS;
    for (int y = std::max(top, 0); y <= std::min(top + SIDE - 1, last); y++)
        for (int x = 0; x < SIDE; x++)
            __builtin_prefetch(
                &window.offsets.data[(int64_t(y) * window.columns + tile_x + x) * LANES]);
}

// Samples of block `lane` of the tile at (x, y) that a triangle of E covers; `whole` are blocks
// that it covers wholly, and `is_cut` is true where it may reach beyond the image.
template <class E, class T>
INLINE int64_t covered_in(int lane, int x, int y, int64_t whole, bool is_cut,
                          const TileEdges<T> &tile, int64_t sample, const Window &window) {
    const int64_t covered =
        whole >> lane & 1 ? ALL_LANES : cover_block<E>(lane, tile, sample, window);
    const int block_x = x + (lane & (SIDE - 1)), block_y = y + (lane >> SIDE_BITS);
    return is_cut ? mask_in_image(covered, block_x, block_y, window) : covered;
}

// Number of samples that triangle k covers, of any size, of those that count.
template <class T, class E> int64_t count_covered(int k, const Target &target, Setup<E> &t) {
    const Window &window = target.window;
    const Range reached = blocks_of(k, t);
    const bool is_cut = reached.last_x >= window.full_x || reached.last_y >= window.full_y;
    const int64_t top = window.top >> SIDE_BITS;
    TileEdges<T> tile;
    start_tiles(k, t, window, tile);
    int64_t covered = 0;
    for (int y = reached.first_y; y <= reached.last_y; y += SIDE)
        for (int x = reached.first_x; x <= reached.last_x; x += SIDE) {
            int64_t blocks = blocks_of_tile(k, x, y, reached, t, window, tile);
            if (x + SIDE <= reached.last_x) prefetch_places(x + SIDE, y, window);
            const int64_t whole = whole_scattered(k, t, window, tile);
            for (; blocks; blocks = without_lowest(blocks)) {
                const int lane = lowest(blocks);
                const int64_t row = y + (lane >> SIDE_BITS) - top;
                const int64_t block = row * window.columns + x + (lane & (SIDE - 1));
                const int64_t sample = block << 2 * SIDE_BITS;
                const int64_t found =
                    covered_in<E>(lane, x, y, whole, is_cut, tile, sample, window);
                covered += count_block(found, sample, target.counts);
            }
        }
    return covered;
}

// Adds the samples of listed triangles that reach at most 2 x 2 to `drawn`, all inside the image.
inline void count_samples_2x2(const SmallList &list, const Faces &faces,
                              const Column<int32_t> &drawn) {
    for (int i = 0; i < list.n; i++)
        add(count(list.coverage[i]), faces.faces[list.slots[i]], drawn);
}

// Adds the samples of chosen ones of n triangles of up to LARGE steps to `drawn`.
inline void count_lanes(int64_t chosen, const Target &target, Setup<int32_t> &t) {
    const bool in_blocks = target.counts_in_blocks();
    if (target.window.is_scattered()) {
        const Int columns =
            (Int::load(t.last_x) >> SIDE_BITS) - (Int::load(t.first_x) >> SIDE_BITS);
        const Int rows = (Int::load(t.last_y) >> SIDE_BITS) - (Int::load(t.first_y) >> SIDE_BITS);
        const int64_t in_2x2 = chosen & bits((columns <= Int(1)) & (rows <= Int(1)));
        int64_t found =
            reach_2x2(in_2x2, bits(columns > Int(0)), bits(rows > Int(0)), target.window, t);
        for (; found; found = without_lowest(found)) {
            const int k = lowest(found);
            const int64_t covered = cover_reached(k, target.window, t);
            add(count_block(covered, t.sample[k], target.counts), t.face[k & (LANES - 1)],
                target.counts.drawn);
        }
        chosen &= ~in_2x2;
    }
    int64_t small = in_blocks ? 0 : fit_count_samples(t) & chosen;
    if (count(small) < MIN_VECTOR_FACES) small = 0;
    if (small) count_samples(small, t);
    for (; chosen; chosen = without_lowest(chosen)) {
        const int k = lowest(chosen);
        int64_t covered = 0;
        if (small >> k & 1) covered = t.masks[k];
        else if (in_blocks) covered = count_covered<int32_t>(k, target, t);
        else
            for (int start = 0; start <= t.last_y[k] - t.first_y[k]; start += LANES)
                covered += count_rows(k, start, t);
        add(covered, t.face[k], target.counts.drawn);
    }
}

// Adds the samples of listed triangles to `drawn`; their depths are not computed.
inline void count_hidden(const List &list, const Faces &faces, const Target &target,
                         Setup<int32_t> &t) {
    for (int i = 0; i < list.n; i += LANES) {
        set_up<false>(list.slots + i, true, faces, target.window, t);
        count_lanes(first_lanes(list.n - i), target, t);
    }
}

} // namespace rastercov::raster
