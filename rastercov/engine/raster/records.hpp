// Records and constants of the CPU rasteriser, which its stages read and write.
//
// Positions are integers, 1/256 sample each, or 1/1024 where samples are scattered; depths are 1/z,
// 0 where a sample is empty. What is set up of triangles is short and in rows of LANES values, so
// that it stays in the level-1 cache. The image is in blocks of 4 x 4 samples, which are one vector
// each; 4 x 4 blocks are a tile, and a tile whose depth is bounded a cell; 16 blocks in a row are a
// strip, cleared at once.
//
// Invariants: a cluster has 1 to 64 vertices and at most 64 faces, whose corners are among them; a
// face is one of the mesh; see clusters.cpp, which groups them.
//
// Twin: rastercov.reference.samples.
#pragma once
#include "array.hpp"
#include "simd.hpp"

namespace rastercov::raster {

// Steps in a sample, as many as graphics devices have.
constexpr int STEP_BITS = 8, STEPS = 1 << STEP_BITS, HALF_SAMPLE = STEPS / 2;
// The same where samples are scattered: the lanes of a block are any 16 places in it.
constexpr int FINE_STEP_BITS = 10;
// Steps from the image origin beyond which a vertex is clipped: edge functions then fit 64 bits.
constexpr int GUARD_BAND = 1 << 29;
// Image position of a vertex beyond the guard band, and of one before the near plane.
constexpr int32_t NEEDS_CLIPPING = INT32_MAX, BEHIND = INT32_MAX - 1;
// Most corners of a triangle that is cut by five planes.
constexpr int CLIP_CORNERS = 8;
// Steps across a triangle beyond which 32 bits do not hold its edge functions.
constexpr int LARGE = 100 * STEPS;

// Samples along the side of a block, and blocks along the side of a tile.
constexpr int SIDE_BITS = 2, SIDE = 1 << SIDE_BITS;
constexpr int64_t ALL_LANES = 0xFFFF;
// Multiplier that repeats a mask of LANES bits four times in a 64-bit word.
constexpr uint64_t FOURFOLD = 1ull << 3 * LANES | 1ull << 2 * LANES | 1ull << LANES | 1;
// Blocks of a strip, and samples along the side of a cell, as powers of 2.
constexpr int STRIP_BITS = 4, CELL_BITS = 2 * SIDE_BITS;
constexpr int64_t STRIP_SAMPLES = int64_t(LANES) << STRIP_BITS;

// Most faces and vertices of a cluster. Corners of clipped faces follow its vertices.
constexpr int FACES = 64, VERTICES = 64;
// Values of each list of a cluster; a byte can number as many vertices.
constexpr int BUFFER_SIZE = 256;
// Samples of an image for each cluster below which the whole image is cleared at once.
constexpr int64_t CLEAR_ALL_SAMPLES = 128;
// Faces of a vector from which on the 2 x 2-block path is faster than the tile path.
constexpr int MIN_VECTOR_FACES = 4;
// Faces of clusters that filled no sample after which the depth of the cells is bounded again.
constexpr int FACES_IN_VAIN = 192;
// Ranges of depth by which the clusters of a band are ordered.
constexpr int DEPTH_BUCKETS = 64;
// Clusters between the one that is drawn and the one whose vertices and faces are prefetched.
constexpr int PREFETCH_DISTANCE = 2;
// Most blocks whose places are prefetched: half of the level-1 cache.
constexpr int MOST_PREFETCHED = 256;
// Bytes of a cache line, and face counts in one, as a power of 2.
constexpr int CACHE_LINE = 64, LINE_BITS = 4;

// Rows of Clusters.bounds: bounding sphere, cone of normals, planes of the faces, least altitude.
enum {
    CENTRE = 0,
    RADIUS = 3,
    CONE_AXIS = 4,
    CONE_COS = 7,
    CONE_SIN = 8,
    PLANE_OFFSET = 9,
    ALTITUDE = 10,
    BOUNDS_OF_CLUSTER = 11
};
enum { LEFT, RIGHT, TOP, BOTTOM, FORWARD, FRUSTUM_PLANES };

// A mesh in clusters: the x of the vertices of each, their y, and their z; the corners of each
// face, by index within the cluster: a + 256 b + 65536 c, where 0 is padding, and its index in the
// mesh; cache lines of the counts of a cluster's faces, indices / 16, without repetition; first
// entries of the clusters; of each the rows above, where the least altitude of a face is 0 if no
// cone contains the normals; their number, and columns of `bounds`.
struct Clusters {
    FloatArray points;
    Int32Array corners, faces, lines, vertex_starts, face_starts, line_starts;
    Array<const double, BOUNDS_OF_CLUSTER, Any> bounds;
    int64_t n, stride;
};
// Ranges of one cluster; `is_safe` where no vertex can need clipping.
struct Cluster {
    int64_t first_vertex, end_vertex, first_slot, end_slot, first_line, end_line;
    bool is_safe;
};

// Rotation world_from_camera by rows, camera centre, intrinsics in samples, depth of the near
// plane, and the greatest magnification of a length parallel to the image over its depth, samples.
// Parallel rays run along the axis: fx and fy are in samples per metre, w is farthest - z in place
// of 1/z, and magnifications are not over a depth; of a pinhole `farthest` is 0.
struct Camera {
    double axes[9], eye[3], fx, fy, cx, cy, near, magnification;
    double farthest = 0.0;
    bool is_parallel() const { return farthest > 0; }
};
// Inward normals of the four sides and the camera axis, their lengths, and what normal . p is more
// than.
struct Frustum {
    double normal[FRUSTUM_PLANES][3], length[FRUSTUM_PLANES], limit[FRUSTUM_PLANES];
};

// Projected vertices of a cluster: u, v in steps, not rounded; 1/z; u, v in whole steps, or
// NEEDS_CLIPPING or BEHIND. Entries behind those of the cluster are of any value.
struct Vertices {
    alignas(CACHE_LINE) double u[BUFFER_SIZE], v[BUFFER_SIZE], w[BUFFER_SIZE];
    Pairs<BUFFER_SIZE> places;
};
struct List {
    alignas(CACHE_LINE) int32_t slots[BUFFER_SIZE];
    int n;
};
// Faces that reach at most 2 x 2 samples, and which of these each covers.
struct SmallList : List {
    alignas(CACHE_LINE) int32_t coverage[BUFFER_SIZE];
};
// Faces of a cluster by the path that fills them, see bin_faces.
struct Bins {
    SmallList samples_2x2, hidden_samples_2x2;
    List larger, hidden_larger, wide, clipped;
};
// Edge functions in units of STEPS, of 1 for scattered samples. Of each triangle of a vector: the
// value at the first sample of its first block, the step to the next column, and to the next row.
template <class E> struct Edges {
    alignas(CACHE_LINE) E value[3][LANES], dx[3][LANES], dy[3][LANES];
};
// Of one triangle: the values at the first samples of the blocks of a tile, or at the corners of
// blocks of scattered samples, and the differences between the samples of a block and its first.
// Scattered samples of edges in 64 bits have them in units of 2^FINE_STEP_BITS, rounded down, where
// 32 bits hold that: `rest` is what is left, `steps` and `low_steps` are the steps to the next step
// divided by 2^SPLIT_BITS, and what is left of these, in 16 bits each, y above x.
template <class E> struct TileEdges {
    alignas(CACHE_LINE) E first[3][LANES], block[3][LANES];
    E step_x[3], step_y[3]; // to the next step, of scattered samples
    int32_t steps[3], low_steps[3], rest[3];
};
// What else is set up of a vector of triangles: the samples in reach, the face; the plane of 1/z,
// with its steps in float32 and the least and greatest 1/z of a corner. And for each of 2 x 2
// samples or blocks of each, or the blocks of a tile: memory index and 1/z of the first sample, and
// coverage mask.
struct Triangles {
    alignas(CACHE_LINE) int32_t first_x[LANES], last_x[LANES], first_y[LANES], last_y[LANES],
        face[LANES];
    alignas(CACHE_LINE) double origin[LANES], slope_x[LANES], slope_y[LANES];
    alignas(CACHE_LINE) float step_x[LANES], step_y[LANES], least[LANES], greatest[LANES];
    alignas(CACHE_LINE) int32_t sample[4 * LANES], masks[4 * LANES];
    alignas(CACHE_LINE) float depth[4 * LANES];
    // Of scattered samples: edge functions at the corners of 2 x 2 blocks, and steps as in
    // TileEdges.
    alignas(CACHE_LINE) int32_t corner[3][4 * LANES], steps[3][LANES];
};
template <class E> struct Setup : Triangles, Edges<E> {};
// Faces in slots: corners and indices of slot 0 and on, and the vertices.
struct Faces {
    const int32_t *corners, *faces;
    const Vertices &vertices;
};
// Plane of 1/z of a face: at the first sample of the image (at its corner
// where samples are scattered), its steps to the next column and row.
struct Plane {
    double origin, slope_x, slope_y;
};

// Band of the image that is drawn: last column, first row, last row; whether back faces are hidden;
// blocks in a row of memory; rows of the image; columns and rows of blocks below which every block
// is wholly inside the image (0 where samples are rolled and a cluster may reach beyond it); for
// each row of blocks the first one that is wholly inside, and the one after the last; for each row
// of samples the first one inside, and the one after the last.
struct Window {
    int right, top, bottom;
    bool hides_back;
    int columns, height, full_x, full_y;
    Array<const int64_t, Any, 2> inner;
    Int32Array first, last;
    // Of the lanes of each block of the band, x + 65536 y from the corner of the block, in fine
    // steps; empty where they are the centres of its samples. Whole cells are then inside the
    // image.
    Int32Array offsets = {};

    bool is_scattered() const { return offsets.rows() > 0; }
    int step_bits() const { return is_scattered() ? FINE_STEP_BITS : STEP_BITS; }
    // Steps from the side of a sample to where it may be covered from.
    int half() const { return is_scattered() ? 0 : HALF_SAMPLE; }
    // Samples from the first to the last place of a block.
    int span() const { return is_scattered() ? SIDE : SIDE - 1; }
};
// Blocks of samples: 1/z, and the nearest face; lower bounds of 1/z in each cell; marks of strips
// that are cleared; and whether all are.
struct Image {
    Column<float> depth;
    Column<int32_t> face;
    Column<float> cell_depth;
    Column<uint8_t> marks;
    bool is_clear;
};
// Samples of each face, added to; `drawn` is empty where it is not wanted; the lanes of each block
// of the band that count, empty where all do; and whether `drawn` is wanted, also of faces that are
// left out because they are seen from behind.
struct Counts {
    Column<int32_t> visible, drawn;
    Column<const uint16_t> used;
    bool with_drawn, with_backs = with_drawn;
};
// What a band is drawn to, and whether faces are compared with the bounds of depth in cells first.
struct Target {
    Window window;
    const Image &image;
    const Counts &counts;
    bool tests_cells;

    // Samples count by their places: at the border of the image, and where they are scattered.
    bool counts_in_blocks() const { return window.full_x == 0 || window.is_scattered(); }
};

// First and last column, first and last row, of samples or blocks.
struct Range {
    int first_x, last_x, first_y, last_y;
};

// A vector of an array, from an element on.
template <class T> INLINE auto load(const Column<T> &array, int64_t at) {
    check_index(at, array.rows());
    check_index(at + LANES - 1, array.rows());
    return Vec<std::remove_const_t<T>>::load(array.data + at);
}
template <class T> INLINE void store(Vec<T> values, const Column<T> &array, int64_t at) {
    check_index(at, array.rows());
    check_index(at + LANES - 1, array.rows());
    values.store(array.data + at);
}
template <class T> Column<T> part(const Column<T> &array, int64_t begin, int64_t n) {
    return {array.data + begin, {n}};
}

// Bits of the first n of a vector, for n from below 0 to above LANES.
INLINE int64_t first_lanes(int64_t n) {
    return ALL_LANES >> std::min<int64_t>(std::max<int64_t>(LANES - n, 0), LANES);
}
// Columns and rows of the lanes of a block or tile.
template <class T> INLINE Vec<T> lane_x() { return to<T>(lane_numbers() & Int(SIDE - 1)); }
template <class T> INLINE Vec<T> lane_y() { return to<T>(lane_numbers() >> SIDE_BITS); }

} // namespace rastercov::raster
