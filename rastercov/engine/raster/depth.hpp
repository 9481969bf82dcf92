// Stage 6 of the CPU rasteriser: depth tests, and the face of each sample.
//
// The greatest 1/z wins, and the lower face where two are equal. A rounded product or sum does not
// decrease where an operand increases, so the extremes of a plane in a block are at its corners,
// bit for bit. Where slopes are not finite, 1/z is `least`.
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/cover.hpp"

namespace rastercov::raster {

// Memory index and 1/z of sample k of the 2 x 2 samples of a vector of triangles, to row k.
INLINE void depth_of_samples(int k, const Window &window, Triangles &t) {
    const Int x = Int::load(t.first_x) + Int(k & 1), y = Int::load(t.first_y) + Int(k >> 1);
    const Int in_x = x & Int(SIDE - 1), in_y = y & Int(SIDE - 1);
    const Starts start = block_starts(x >> SIDE_BITS, y >> SIDE_BITS, window, t);
    (start.sample + (in_y << SIDE_BITS) + in_x).store(t.sample + k * LANES);
    const Float depth = start.depth + (Float::load(t.step_x) * to<float>(in_x) +
                                       Float::load(t.step_y) * to<float>(in_y));
    min(max(depth, Float::load(t.least)), Float::load(t.greatest)).store(t.depth + k * LANES);
}

// Blocks of start_blocks where 1/z of triangle k is less than a bound throughout.
INLINE int64_t hidden_blocks(int k, float bound, const Window &window, const Triangles &t) {
    const float span = float(window.span());
    const float right = std::max(0.0f, t.step_x[k] * span),
                down = std::max(0.0f, t.step_y[k] * span); // 0 where it is NaN
    Float highest = Float::load(t.depth) + Float(right + down);
    highest = min(max(highest, Float(t.least[k])), Float(t.greatest[k]));
    return bits(highest < Float(bound));
}

// Least 1/z of triangle k at the samples of the blocks of start_blocks.
INLINE float least_in_tile(int k, const Window &window, const Triangles &t) {
    const auto least_step = [&](float step) {
        const float last = step * window.span(), first = step * 0;
        return last < first ? last : first;
    };
    const Float step(least_step(t.step_x[k]) + least_step(t.step_y[k]));
    const Float lowest = max(Float::load(t.depth) + step, Float(t.least[k]));
    return least(min(lowest, Float(t.greatest[k])));
}

// Differences of 1/z of triangle k between the scattered samples of a block, at memory index
// `sample`, and its corner.
INLINE Float beyond_corner(int k, int64_t sample, const Window &window, const Triangles &t) {
    const Int offsets = load(window.offsets, sample);
    constexpr float STEP = 1.0f / (1 << FINE_STEP_BITS); // exact
    return Float(t.step_x[k] * STEP) * to<float>(offsets & Int(0xFFFF)) +
           Float(t.step_y[k] * STEP) * to<float>(offsets >> 16);
}

// 1/z of a triangle in a block: beyond that of its first sample, and its extremes.
struct BlockPlane {
    Float beyond, least, greatest;
};
INLINE BlockPlane block_plane(int k, const Triangles &t) {
    return {Float(t.step_x[k]) * lane_x<float>() + Float(t.step_y[k]) * lane_y<float>(), t.least[k],
            t.greatest[k]};
}

// Writes 1/z of a triangle to the covered samples of a block where it is nearest. `start` is 1/z at
// the first sample of the block, whose memory index is `at`. Masks of the samples that were
// written, of those of them that were not empty, and of those of equal depth.
struct Tested {
    int64_t won, lost, ties;
};
INLINE Tested depth_test(const Column<float> &image, int64_t at, int64_t covered,
                         const BlockPlane &plane, float start) {
    Float depth = Float(start) + plane.beyond;
    depth = min(max(depth, plane.least), plane.greatest);
    const Float old = load(image, at);
    const auto active = as_mask(covered), wins = (depth > old) & active;
    store(select<float>(wins, depth, old), image, at);
    return {bits(wins), bits(wins & (old > Float(0))), bits((depth == old) & active)};
}

// Least 1/z of a cell: 4 blocks in each of at most 4 rows of `columns` blocks. `block` is the first
// one; of a cell at the lower rim only `n_rows` rows are in memory.
inline float least_depth(const Column<float> &depth, int64_t block, int columns, int n_rows) {
    Float found;
    for (int row = 0; row < SIDE; row++) {
        const int64_t start = (block + int64_t(columns) * std::min(row, n_rows - 1))
                              << 2 * SIDE_BITS;
        for (int k = 0; k < SIDE; k++) {
            const Float values = load(depth, start + k * LANES);
            found = row + k ? min(found, values) : values;
        }
    }
    return least(found);
}

// Number of the samples of a block in a mask that count.
INLINE int64_t count_block(int64_t bits, int64_t at, const Counts &counts) {
    return count(counts.used.rows() ? bits & counts.used[at / LANES] : bits);
}

// Adds to the samples of a face.
INLINE void add(int64_t n, int face, const Column<int32_t> &counts) {
    counts[face] = int32_t(uint32_t(counts[face]) + uint32_t(n));
}

} // namespace rastercov::raster
