// Stage 5 of the CPU rasteriser: coverage masks from edge functions.
//
// A sample is covered where no edge function is negative. Blocks within tiles, a vector at a time:
// M. Abrash. Rasterization on Larrabee. 2009.
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/records.hpp"

namespace rastercov::raster {

// Added to quotients: more than their rounding error, less than the least positive fraction. In
// float32 for edges of up to 17 samples, in float64 for all triangles but wide ones.
template <class T> constexpr T QUOTIENT_TOLERANCE = sizeof(T) == 4 ? T(0x1p-14) : T(0x1p-20);
// Half of it is more samples than any triangle reaches; times a value it fits 32 bits.
constexpr int OUT_OF_REACH = 512;

// Greatest step of an edge function in 32 bits, and greatest corner of a tile: less than 16 columns
// and 16 rows of such steps away, the sign stays that of a corner beyond it, and the sum fits.
constexpr int64_t MAX_NARROW_STEP = 1 << 25, MAX_NARROW = 1 << 30;
// Bits of the steps of scattered samples that are multiplied apart from those above them.
constexpr int SPLIT_BITS = 12;

// Memory index and 1/z of the first samples of blocks.
struct Starts {
    Int sample;
    Float depth;
};
INLINE Starts block_starts(Int block_x, Int block_y, const Window &window, Double origin,
                           Double slope_x, Double slope_y) {
    const Int block = (block_y - Int(window.top >> SIDE_BITS)) * Int(window.columns) + block_x;
    const Double x = to<double>(block_x << SIDE_BITS), y = to<double>(block_y << SIDE_BITS);
    return {block << 2 * SIDE_BITS, to<float>(origin + slope_y * y + slope_x * x)};
}
INLINE Starts block_starts(Int block_x, Int block_y, const Window &window, const Triangles &t) {
    return block_starts(block_x, block_y, window, Double::load(t.origin), Double::load(t.slope_x),
                        Double::load(t.slope_y));
}

// 4 masks, side by side, of the triangles that cover sample 0, 1, 2, 3 of their 2 x 2 samples.
INLINE int64_t coverage_of_samples(Int coverage) {
    int64_t found = 0;
    for (int k = 0; k < 4; k++) found |= bits((coverage & Int(1 << k)) > Int(0)) << k * LANES;
    return found;
}

// Triangles that may cover samples of block k of their 2 x 2, and those whose block is at the
// border. Coverage mask, memory index of the block and 1/z at its first sample go to row k of
// masks, sample and depth.
struct InBlocks {
    int64_t covered, at_border;
};
INLINE InBlocks cover_blocks(int k, const Window &window, Setup<int32_t> &t) {
    const int i = k & 1, j = k >> 1;
    const Int block_x = (Int::load(t.first_x) >> SIDE_BITS) + Int(i);
    const Int block_y = (Int::load(t.first_y) >> SIDE_BITS) + Int(j);
    Int dx[3], dy[3], last[3];
    for (int n = 0; n < 3; n++) {
        dx[n] = Int::load(t.dx[n]);
        dy[n] = Int::load(t.dy[n]);
        Int first = Int::load(t.value[n]);
        if (i) first = first + (dx[n] << SIDE_BITS);
        if (j) first = first + (dy[n] << SIDE_BITS);
        last[n] = first + (dx[n] + dy[n]) * Int(SIDE - 1);
    }
    Int outside(0);
    for (int row = 0; row < SIDE; row++) {
        Int values[3] = {last[0], last[1], last[2]};
        for (int column = 0; column < SIDE; column++) {
            outside = append_sign(outside, values[0] | values[1] | values[2]);
            for (int n = 0; n < 3; n++) values[n] = values[n] - dx[n];
        }
        for (int n = 0; n < 3; n++) last[n] = last[n] - dy[n];
    }
    const Int inside = Int(ALL_LANES) - outside;
    inside.store(t.masks + k * LANES);
    const Starts start = block_starts(block_x, block_y, window, t);
    start.sample.store(t.sample + k * LANES);
    start.depth.store(t.depth + k * LANES);
    const auto covered = (block_x <= Int::load(t.last_x) >> SIDE_BITS) & (inside > Int(0)) &
                         (block_y <= Int::load(t.last_y) >> SIDE_BITS);
    return {bits(covered), bits((block_x >= Int(window.full_x)) | (block_y >= Int(window.full_y)))};
}

// Scattered samples: triangles that may cover some of block k of their 2 x 2, whose memory index
// and edge functions at its corner go to row k.
INLINE int64_t reach_block(int k, const Window &window, Setup<int32_t> &t) {
    const int i = k & 1, j = k >> 1;
    const Int block_x = (Int::load(t.first_x) >> SIDE_BITS) + Int(i);
    const Int block_y = (Int::load(t.first_y) >> SIDE_BITS) + Int(j);
    Int outside = ((Int::load(t.last_x) >> SIDE_BITS) - block_x) |
                  ((Int::load(t.last_y) >> SIDE_BITS) - block_y);
    for (int n = 0; n < 3; n++) {
        const Int dx = Int::load(t.dx[n]), dy = Int::load(t.dy[n]);
        Int corner = Int::load(t.value[n]);
        if (i) corner = corner + (dx << SIDE_BITS);
        if (j) corner = corner + (dy << SIDE_BITS);
        corner.store(t.corner[n] + k * LANES);
        const Int rise = max<int32_t>(dx, Int(0)) + max<int32_t>(dy, Int(0));
        outside = outside | (corner + (rise << SIDE_BITS));
        ((dx >> FINE_STEP_BITS & Int(0xFFFF)) | dy >> FINE_STEP_BITS << 16).store(t.steps[n]);
    }
    const Int block = (block_y - Int(window.top >> SIDE_BITS)) * Int(window.columns) + block_x;
    (block << 2 * SIDE_BITS).store(t.sample + k * LANES);
    return ~signs(outside) & ALL_LANES;
}
// Those of chosen triangles in each of 2 x 2 blocks, 4 masks side by side; those in `wide` and
// `tall` have two columns and two rows of them.
INLINE int64_t reach_2x2(int64_t chosen, int64_t wide, int64_t tall, const Window &window,
                         Setup<int32_t> &t) {
    int64_t found = 0;
    for (int k = 0; k < 4; k++)
        if ((!(k & 1) || chosen & wide) && (!(k >> 1) || chosen & tall))
            found |= (reach_block(k, window, t) & chosen) << k * LANES;
    return found;
}
// Coverage mask of a block of reach_2x2.
INLINE int64_t cover_reached(int k, const Window &window, const Triangles &t) {
    const Int offsets = load(window.offsets, t.sample[k]);
    Int sign(0);
    for (int n = 0; n < 3; n++)
        sign = sign | (Int(t.corner[n][k]) + dot_halves(offsets, Int(t.steps[n][k & (LANES - 1)])));
    return ~signs(sign) & ALL_LANES;
}

// Steps for which an edge function stays non-negative: floor(value / |slope|); < 0 for none. For
// slope > 0 it is non-negative from minus that on. A quotient that is not an integer is at least
// 1/|slope| from one, much more than its rounding error and the tolerance.
template <class T> INLINE Int last_covered(Vec<T> value, Vec<T> slope) {
    const Vec<T> size = abs(slope);
    const Vec<T> share = value * (Vec<T>(1) / size) + Vec<T>(QUOTIENT_TOLERANCE<T>);
    // Along a level edge all samples are on the same side.
    const Vec<T> level = (value + Vec<T>(T(0.5))) * Vec<T>(OUT_OF_REACH);
    return to<int32_t>(floor(select<T>(size > Vec<T>(0), share, level)));
}

// Triangles that reach at most LANES columns and rows of samples.
INLINE int64_t fit_count_samples(const Triangles &t) {
    const Int columns = Int::load(t.last_x) - Int::load(t.first_x);
    const Int rows = Int::load(t.last_y) - Int::load(t.first_y);
    return bits((columns < Int(LANES)) & (rows < Int(LANES)));
}

// Numbers of samples that the chosen triangles cover, to `masks`: some of fit_count_samples, taken
// a row at a time.
inline void count_samples(int64_t chosen, Setup<int32_t> &t) {
    const Int first_x = Int::load(t.first_x), first_y = Int::load(t.first_y);
    const Int left = first_x & Int(SIDE - 1), right = Int::load(t.last_x) - first_x + left;
    const Int rows =
        select<int32_t>(as_mask(chosen), Int::load(t.last_y) - first_y + Int(1), Int(0));
    const int n_rows = greatest(rows);
    Int dx[3], dy[3], value[3], total(0);
    for (int n = 0; n < 3; n++) {
        dx[n] = Int::load(t.dx[n]);
        dy[n] = Int::load(t.dy[n]);
        value[n] = Int::load(t.value[n]) + dy[n] * (first_y & Int(SIDE - 1));
    }
    for (int y = 0; y < n_rows; y++) {
        Int begin = left;
        Int end = right;
        for (int n = 0; n < 3; n++) {
            const Int bound = last_covered(to<float>(value[n]), to<float>(dx[n]));
            const auto rises = dx[n] > Int(0);
            begin = select<int32_t>(rises, max<int32_t>(begin, -bound), begin);
            end = select<int32_t>(rises, end, min<int32_t>(end, bound));
            value[n] = value[n] + dy[n];
        }
        const Int covered = total + max<int32_t>(end - begin + Int(1), Int(0));
        total = select<int32_t>(rows > Int(y), covered, total);
    }
    total.store(t.masks);
}

// Number of samples that triangle k covers in LANES rows from row `start` of its own on.
inline int64_t count_rows(int k, int start, const Setup<int32_t> &t) {
    const int corner_x = t.first_x[k] & -SIDE, corner_y = t.first_y[k] & -SIDE;
    const Int y = Int(t.first_y[k] + start) + lane_numbers();
    Int left(t.first_x[k] - corner_x), right(t.last_x[k] - corner_x);
    for (int n = 0; n < 3; n++) {
        const Int value = Int(t.value[n][k]) + Int(t.dy[n][k]) * (y - Int(corner_y));
        const Int bound = last_covered(to<double>(value), Double(t.dx[n][k]));
        if (t.dx[n][k] > 0) left = max<int32_t>(left, -bound);
        else right = min<int32_t>(right, bound);
    }
    const Int covered = max<int32_t>(right - left + Int(1), Int(0));
    return sum(select<int32_t>(y <= Int(t.last_y[k]), covered, Int(0)));
}

// Bits below the unit in which a tile has the edge functions of a triangle: those of scattered
// samples change by whole samples between the corners of blocks.
template <class E, class T> INLINE int unit_bits(const Window &window) {
    return sizeof(T) < sizeof(E) && window.is_scattered() ? FINE_STEP_BITS : 0;
}
// True where 32 bits hold the edge functions of triangle k in a tile that one of its edges crosses.
INLINE bool fits_32_bits(int k, const Edges<int64_t> &t, const Window &window) {
    int64_t greatest = 0;
    for (int n = 0; n < 3; n++)
        greatest = std::max({greatest, std::abs(t.dx[n][k]), std::abs(t.dy[n][k])});
    return greatest >> unit_bits<int64_t, int32_t>(window) < MAX_NARROW_STEP;
}

// Differences of the edge functions of triangle k between the samples of a block and its first one,
// to `block`.
template <class E, class T>
INLINE void start_tiles(int k, const Edges<E> &t, const Window &window, TileEdges<T> &tile) {
    using V = Vec<T>;
    constexpr int HIGH = sizeof(T) < sizeof(E) ? SPLIT_BITS : 0;
    const int bits = unit_bits<E, T>(window);
    for (int n = 0; n < 3; n++) {
        const V dx(T(t.dx[n][k] >> bits)), dy(T(t.dy[n][k] >> bits));
        (dx * lane_x<T>() + dy * lane_y<T>()).store(tile.block[n]);
        const T x = T(t.dx[n][k] >> FINE_STEP_BITS), y = T(t.dy[n][k] >> FINE_STEP_BITS);
        constexpr T LOW = (1 << HIGH) - 1;
        tile.step_x[n] = x;
        tile.step_y[n] = y;
        tile.steps[n] = int32_t(x >> HIGH & 0xFFFF) | int32_t(uint32_t(y >> HIGH) << 16);
        tile.low_steps[n] = int32_t(x & LOW) | int32_t(y & LOW) << 16;
        tile.rest[n] = int32_t(t.value[n][k] & ((1 << bits) - 1));
    }
}

// Blocks of a tile that triangle k, of start_tiles, reaches, and a few more near its corners. The
// tile starts `right` and `down` blocks from the first one of the triangle. Its edge functions go
// to `first`; those of 64 bits in 32 keep their signs, since one that is clamped has no zero here.
template <class E, class T>
INLINE int64_t reach_blocks(int k, int right, int down, const Edges<E> &t, const Window &window,
                            TileEdges<T> &tile) {
    using V = Vec<T>;
    const int bits = unit_bits<E, T>(window), span = window.span();
    V sign(0);
    for (int n = 0; n < 3; n++) {
        const E dx = t.dx[n][k] >> bits, dy = t.dy[n][k] >> bits;
        E corner = (t.value[n][k] >> bits) + (dx * E(right) + dy * E(down)) * SIDE;
        if constexpr (sizeof(T) < sizeof(E))
            corner = std::clamp<E>(corner, -MAX_NARROW, MAX_NARROW);
        // A block is SIDE columns or rows from the next one.
        const V value = V(T(corner)) + (V::load(tile.block[n]) << SIDE_BITS);
        value.store(tile.first[n]);
        sign = sign | (value + V(T((std::max<E>(dx, 0) + std::max<E>(dy, 0)) * span)));
    }
    return ~signs(sign) & ALL_LANES;
}

// Blocks of the tile of reach_blocks that triangle k covers wholly.
template <class E, class T>
INLINE int64_t whole_blocks(int k, const Edges<E> &t, const Window &window,
                            const TileEdges<T> &tile) {
    using V = Vec<T>;
    const int bits = unit_bits<E, T>(window);
    V sign(0);
    for (int n = 0; n < 3; n++) {
        const E least = std::min<E>(t.dx[n][k], 0) + std::min<E>(t.dy[n][k], 0);
        sign = sign | (V::load(tile.first[n]) + V(T((least >> bits) * window.span())));
    }
    return ~signs(sign) & ALL_LANES;
}

// The same of scattered samples, whose places are in memory; 0 of others, which are compared
// faster.
template <class E, class T>
INLINE int64_t whole_scattered(int k, const Edges<E> &t, const Window &window,
                               const TileEdges<T> &tile) {
    return window.is_scattered() ? whole_blocks(k, t, window, tile) : 0;
}

// Memory index and 1/z of triangle k at the first samples of the blocks of a tile, to `sample` and
// `depth`.
INLINE void start_blocks(int k, int tile_x, int tile_y, const Window &window, Triangles &t) {
    const Int x = Int(tile_x) + lane_x<int32_t>(), y = Int(tile_y) + lane_y<int32_t>();
    const Starts start = block_starts(x, y, window, t.origin[k], t.slope_x[k], t.slope_y[k]);
    start.sample.store(t.sample);
    start.depth.store(t.depth);
}

// Coverage mask of a block of the tile of reach_blocks, of E for the triangle, at memory index
// `sample`.
template <class E, class T>
INLINE int64_t cover_block(int block, const TileEdges<T> &tile, int64_t sample,
                           const Window &window) {
    using V = Vec<T>;
    V sign(0);
    if (window.is_scattered()) {
        const Int offsets = load(window.offsets, sample);
        if constexpr (sizeof(E) == 4) { // the steps are less than 2^15, see LARGE
            for (int n = 0; n < 3; n++)
                sign = sign | (V(tile.first[n][block]) + dot_halves(offsets, Int(tile.steps[n])));
        } else if constexpr (sizeof(T) ==
                             4) { // less than 2^25; the sum rounded down keeps its sign
            constexpr int UNIT = SPLIT_BITS - FINE_STEP_BITS;
            for (int n = 0; n < 3; n++) {
                const T first = tile.first[n][block];
                const T rest = (first & ((1 << UNIT) - 1)) << FINE_STEP_BITS | tile.rest[n];
                const Int low = Int(rest) + dot_halves(offsets, Int(tile.low_steps[n]));
                sign = sign | (Int(first >> UNIT) + dot_halves(offsets, Int(tile.steps[n])) +
                               (low >> SPLIT_BITS));
            }
        } else {
            const V x = to<T>(offsets & Int(0xFFFF)), y = to<T>(offsets >> 16);
            for (int n = 0; n < 3; n++)
                sign = sign |
                       (V(tile.first[n][block]) + V(tile.step_x[n]) * x + V(tile.step_y[n]) * y);
        }
        return ~signs(sign) & ALL_LANES;
    }
    for (int n = 0; n < 3; n++) sign = sign | (V(tile.first[n][block]) + V::load(tile.block[n]));
    return ~signs(sign) & ALL_LANES;
}

} // namespace rastercov::raster
