// Occlusion of clusters by what is drawn: order by depth, and bounds of depth in cells.
//
// The image is divided into cells of 4 x 4 blocks. Each has a lower bound of 1/z at its samples, 0
// while one of them is empty. Depths only ever come nearer, so a bound stays true when it is not
// updated. A cluster whose vertices are all farther than the bounds of the cells that it reaches
// owns no sample: not even a tie, because its 1/z is strictly less.
//
// N. Greene, M. Kass, G. Miller. Hierarchical Z-Buffer Visibility. 1993.
//
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/depth.hpp"
#include "raster/vertices.hpp"

namespace rastercov::raster {

// Writes the first n clusters in `seen` to `ordered`, about by the nearest depth of their spheres;
// `forward` is that of their centres. Within one of DEPTH_BUCKETS ranges of equal length they keep
// their order.
inline void order_by_depth(const Clusters &clusters, const Column<int32_t> &seen, int64_t n,
                           const Column<double> &forward, const Column<int32_t> &ordered) {
    const auto radius = clusters.bounds[RADIUS];
    const auto nearest = [&](int64_t i) { return forward[seen[i]] - radius[seen[i]]; };
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (int64_t i = 0; i < n; i++) {
        low = std::min(low, nearest(i));
        high = std::max(high, nearest(i));
    }
    const double scale = high > low ? (DEPTH_BUCKETS - 1) / (high - low) : 0.0;
    const auto bucket = [&](int64_t i) {
        const double at = (nearest(i) - low) * scale; // NaN for depths that are not finite
        return at > 0 ? int(std::min(at, DEPTH_BUCKETS - 1.0)) : 0;
    };
    int32_t ends[DEPTH_BUCKETS] = {}, end = 0;
    for (int64_t i = 0; i < n; i++) ends[bucket(i)]++;
    for (int32_t &one : ends) {
        std::swap(one, end);
        end += one;
    }
    for (int64_t i = 0; i < n; i++) ordered[ends[bucket(i)]++] = seen[i];
}

INLINE Range samples_in_box(const Box &box, const Window &window) {
    const int shift = window.step_bits(), half = window.half(), before = std::max(half - 1, 0);
    return {int(std::max<int64_t>((box.low_x + before) >> shift, 0)),
            int(std::min<int64_t>((box.high_x - half) >> shift, window.right)),
            int(std::max<int64_t>((box.low_y + before) >> shift, window.top)),
            int(std::min<int64_t>((box.high_y - half) >> shift, window.bottom))};
}

// True where the first sample of a block and the last one before another are not empty.
INLINE bool is_filled(const Image &image, int64_t first, int64_t last) {
    return image.depth[first << 2 * SIDE_BITS] > 0 && image.depth[(last << 2 * SIDE_BITS) - 1] > 0;
}

// Bounds the depth of the cells that have no bound yet by their samples.
inline void bound_cells(const Window &window, const Image &image) {
    const int n_rows = ((window.bottom - window.top) >> SIDE_BITS) + 1;
    const int64_t columns = window.columns, strips = columns >> STRIP_BITS;
    for (int top = 0; top < n_rows; top += SIDE) {
        const int rows = std::min(n_rows - top, SIDE);
        for (int64_t strip = 0; strip < strips; strip++) {
            bool is_cleared = true;
            for (int row = top; row < top + rows; row++)
                is_cleared &= image.marks[row * strips + strip] != 0;
            if (!is_cleared) continue;
            for (int64_t x = strip << STRIP_BITS; x < (strip + 1) << STRIP_BITS; x += SIDE) {
                const int64_t block = top * columns + x, last = block + (rows - 1) * columns + SIDE;
                float &bound =
                    image.cell_depth[(top * columns >> 2 * SIDE_BITS) + (x >> SIDE_BITS)];
                if (bound == 0 && is_filled(image, block, last))
                    bound = least_depth(image.depth, block, window.columns, rows);
            }
        }
    }
}

// True where all cells of a range of samples are nearer than `nearest`, a greatest 1/z.
INLINE bool is_hidden(const Range &samples, float nearest, const Window &window,
                      const Image &image) {
    const int columns = window.columns >> SIDE_BITS;
    const int last_row = (samples.last_y - window.top) >> CELL_BITS;
    for (int row = (samples.first_y - window.top) >> CELL_BITS; row <= last_row; row++)
        for (int column = samples.first_x >> CELL_BITS; column <= samples.last_x >> CELL_BITS;
             column++)
            if (image.cell_depth[int64_t(row) * columns + column] <= nearest) return false;
    return true;
}

} // namespace rastercov::raster
