// Loops over the clusters of a band of the image, from front to back.
//
// Twin: tests/raster/test_cpu.py, by whole numbers.
#pragma once
#include "interrupt.hpp"
#include "raster/buffer.hpp"
#include "raster/cull.hpp"
#include "raster/fill.hpp"
#include <memory>
#include <tuple>

namespace rastercov::raster {

// Memory of one thread: of the stages, which is as long for any image and mesh; of an image in
// strips and cells; of the clusters of a mesh.
struct Scratch {
    Camera camera;
    Frustum frustum;
    Vertices vertices;
    Bins bins;
    Setup<int32_t> setup;
    Setup<int64_t> setup_64;
    Fan fan;
};
struct Memory {
    std::unique_ptr<Scratch> scratch = std::make_unique<Scratch>(); // entries behind lists are read
    Buffer<float> depth;
    Buffer<int32_t> face;
    Buffer<float> cell_depth;
    Buffer<uint8_t> marks;
    Buffer<double> down, forward;
    Buffer<int32_t> kept, safe, seen, ordered;

    explicit Memory(int64_t stride)
        : down(stride), forward(stride), kept(stride / LANES), safe(stride / LANES),
          seen(stride + LANES), ordered(stride) {}
    // Room for a band of an image.
    void fit(int64_t n_marks, int64_t n_cells) {
        if (n_marks > marks.all.rows()) {
            marks = Buffer<uint8_t>(); // given back first
            depth = Buffer<float>();
            face = Buffer<int32_t>();
            depth = Buffer<float>(n_marks * STRIP_SAMPLES);
            face = Buffer<int32_t>(n_marks * STRIP_SAMPLES);
            marks = Buffer<uint8_t>(n_marks);
        }
        if (n_cells > cell_depth.all.rows()) cell_depth = Buffer<float>(n_cells);
    }
};

// Clears the strips of blocks that a range of samples reaches; false where it is empty.
INLINE bool clear(const Range &samples, const Window &window, const Image &image) {
    if (samples.first_x > samples.last_x || samples.first_y > samples.last_y) return false;
    if (image.is_clear) return true;
    constexpr int SHIFT = SIDE_BITS + STRIP_BITS;
    const int64_t strips = window.columns >> STRIP_BITS;
    for (int64_t row = (samples.first_y - window.top) >> SIDE_BITS,
                 last = (samples.last_y - window.top) >> SIDE_BITS;
         row <= last; row++)
        for (int x = samples.first_x >> SHIFT; x <= samples.last_x >> SHIFT; x++) {
            uint8_t &mark = image.marks[row * strips + x];
            if (mark == 0) {
                mark = 1;
                std::fill_n(&image.depth[(row * strips + x) * STRIP_SAMPLES], STRIP_SAMPLES, 0.0f);
            }
        }
    return true;
}

// Window without cut blocks where every sample that a box in steps reaches is inside the image. The
// image is convex, so its rows between the first and the last of the box contain it as well.
INLINE Window uncut(const Box &box, Window window) {
    const int64_t left = box.low_x >> STEP_BITS, right = box.high_x >> STEP_BITS;
    const int64_t top = box.low_y >> STEP_BITS, bottom = box.high_y >> STEP_BITS;
    if (window.full_x == 0 && top >= 0 && bottom < window.height &&
        left >= std::max(window.first[top], window.first[bottom]) &&
        right < std::min(window.last[top], window.last[bottom])) {
        window.full_x = (window.right + 1) >> SIDE_BITS;
        window.full_y = window.height >> SIDE_BITS;
    }
    return window;
}

// Requests the cache lines of the counts of a cluster, for writing.
INLINE void prefetch_counts(const Column<int32_t> &counts, const Clusters &clusters,
                            const Cluster &cluster) {
    for (int64_t at = cluster.first_line; at < cluster.end_line; at++)
        __builtin_prefetch(counts.data + (int64_t(clusters.lines[at]) << LINE_BITS), 1);
}
// Requests the cache lines of elements `begin` up to `end`.
template <class T> INLINE void prefetch(const Column<T> &array, int64_t begin, int64_t end) {
    for (; begin < end; begin += CACHE_LINE / int64_t(sizeof(T)))
        __builtin_prefetch(array.data + begin);
}

// Requests the places of scattered samples, which are not in the cache, for a small cluster.
INLINE void prefetch_offsets(const Range &samples, const Window &window) {
    const int left = samples.first_x >> SIDE_BITS, right = samples.last_x >> SIDE_BITS;
    const int top = window.top >> SIDE_BITS;
    const int first = samples.first_y >> SIDE_BITS, last = samples.last_y >> SIDE_BITS;
    if ((right - left + 1) * (last - first + 1) > MOST_PREFETCHED) return;
    for (int y = first - top; y <= last - top; y++)
        for (int x = left; x <= right; x++)
            __builtin_prefetch(&window.offsets.data[(int64_t(y) * window.columns + x) * LANES]);
}

// How many samples were empty, the faces that were tried (LANES for each wide one), and the number
// of those in bins.clipped.
struct Drawn {
    int64_t filled, n_tried;
    int n_clipped;
};
// Draws the faces of a cluster that need no clipping; those of a cluster behind what is drawn are
// only counted.
inline Drawn draw_cluster(const Clusters &clusters, const Cluster &cluster, Target target,
                          Scratch &scratch) {
    const Counts &counts = target.counts;
    Window &window = target.window;
    if (counts.with_drawn) prefetch_counts(counts.drawn, clusters, cluster);
    Box box = project_vertices(clusters, cluster, scratch.camera, 1 << window.step_bits(),
                               scratch.vertices);
    if (box.low_x == BEHIND && box.high_x == BEHIND) return {};
    bool is_plain = std::max(box.high_x - box.low_x, box.high_y - box.low_y) < LARGE;
    if (box.high_x >= BEHIND) {
        is_plain = target.tests_cells = false;
        const int shift = window.step_bits();
        box = {0, int64_t(window.right + 1) << shift, int64_t(window.top) << shift,
               int64_t(window.bottom + 1) << shift};
    }
    const Range samples = samples_in_box(box, window);
    if (!clear(samples, window, target.image)) return {};
    bool is_behind = false;
    if (target.tests_cells) {
        const int n_vertices = int(cluster.end_vertex - cluster.first_vertex);
        const float nearest = nearest_vertex(scratch.vertices, n_vertices);
        is_behind = is_hidden(samples, nearest, window, target.image);
        if (is_behind && !counts.with_drawn) return {};
    }
    window = uncut(box, window);
    if (window.is_scattered()) prefetch_offsets(samples, window);
    const auto &[samples_2x2, hidden_samples_2x2, larger, hidden_larger, wide, clipped] =
        scratch.bins;
    const Faces faces = {clusters.corners.data + cluster.first_slot,
                         clusters.faces.data + cluster.first_slot, scratch.vertices};
    const int n_slots = int(cluster.end_slot - cluster.first_slot);
    cull_and_bin(faces, n_slots, target, is_plain, scratch.bins);
    const bool in_blocks = target.counts_in_blocks();
    if (counts.with_drawn && !in_blocks) {
        count_samples_2x2(samples_2x2, faces, counts.drawn);
        count_samples_2x2(hidden_samples_2x2, faces, counts.drawn);
    }
    Drawn drawn = {0, int64_t(wide.n) * LANES, clipped.n};
    if (is_behind) {
        if (in_blocks) count_hidden(samples_2x2, faces, target, scratch.setup);
        count_hidden(larger, faces, target, scratch.setup);
    } else if (samples_2x2.n + larger.n) {
        drawn.n_tried += samples_2x2.n + larger.n;
        prefetch_counts(counts.visible, clusters, cluster);
        drawn.filled = fill_small(scratch.bins, faces, target, scratch.setup);
    }
    if (hidden_larger.n) count_hidden(hidden_larger, faces, target, scratch.setup);
    if (wide.n) {
        constexpr double NONE = std::numeric_limits<double>::quiet_NaN();
        drawn.filled +=
            fill_any(wide.slots, wide.n, faces, target, {NONE, NONE, NONE}, scratch.setup_64);
    }
    return drawn;
}

// Clips and draws the first n faces in bins.clipped; returns how many samples were empty.
inline int64_t draw_clipped(const Clusters &clusters, const Cluster &cluster, int n,
                            const Target &target, Scratch &scratch) {
    Fan &fan = scratch.fan;
    const Faces faces = {fan.corners, fan.faces, scratch.vertices};
    int64_t filled = 0;
    for (int k = 0; k < n; k++) {
        const int64_t slot = cluster.first_slot + scratch.bins.clipped.slots[k];
        clip_and_triangulate(clusters, cluster, slot, scratch.camera, target.window,
                             scratch.vertices, fan);
        filled += fill_any(LANE_NUMBERS, fan.n, faces, target, fan.plane, scratch.setup_64);
    }
    return filled;
}

// Writes those of the clusters that are kept and reach into a band to memory.seen; returns their
// number.
inline int64_t find_clusters(const Clusters &clusters, const Window &window, bool is_only_band,
                             const Memory &memory) {
    const Camera &camera = memory.scratch->camera;
    const Frustum &frustum = memory.scratch->frustum;
    const Rims rims = {camera.cy - window.top, frustum.length[TOP], window.bottom + 1 - camera.cy,
                       frustum.length[BOTTOM]};
    const auto radius = clusters.bounds[RADIUS];
    int64_t n = 0;
    for (int64_t at = 0; at < clusters.n; at += LANES) {
        int64_t found = memory.kept.all[at / LANES];
        if (found && !is_only_band)
            found &=
                clusters_in_band(radius, at, memory.down.all, memory.forward.all, camera, rims);
        if (found) n = append_set_bits(found, at, memory.seen.all.data, n);
    }
    return n;
}

// Draws the clusters that reach into a band; returns how many samples were empty. `cell_bounds` is
// inf for cells whose samples do not count, 0 for others; empty where all count.
inline int64_t draw_band(const Clusters &clusters, const Window &window, double width,
                         bool is_only_band, const Counts &counts,
                         const Column<const float> &cell_bounds, const Memory &memory) {
    Scratch &scratch = *memory.scratch;
    const Camera &camera = scratch.camera;
    const double off_centre = std::max(std::abs(camera.cx), std::abs(camera.cy));
    const bool is_centred = off_centre < GUARD_BAND >> window.step_bits() >> 1;
    put_frustum(camera, width, window.top, window.bottom + 1, scratch.frustum);
    const int64_t n_seen = find_clusters(clusters, window, is_only_band, memory);
    const int64_t n_rows = ((window.bottom - window.top) >> SIDE_BITS) + 1;
    const int64_t n_marks = n_rows * (window.columns >> STRIP_BITS);
    const int64_t n_samples = n_marks * STRIP_SAMPLES;
    const bool is_clear = n_samples < CLEAR_ALL_SAMPLES * n_seen;
    const Image image = {memory.depth.all, memory.face.all, memory.cell_depth.all, memory.marks.all,
                         is_clear};
    std::fill_n(image.marks.data, n_marks, uint8_t(is_clear));
    if (is_clear) std::fill_n(image.depth.data, n_samples, 0.0f);
    const int64_t n_cells = ((n_rows + SIDE - 1) >> SIDE_BITS) * (window.columns >> SIDE_BITS);
    const bool has_bounds = cell_bounds.rows() > 0;
    if (has_bounds) std::copy_n(cell_bounds.data, n_cells, image.cell_depth.data);
    else std::fill_n(image.cell_depth.data, n_cells, 0.0f);
    order_by_depth(clusters, memory.seen.all, n_seen, memory.forward.all, memory.ordered.all);
    Target target = {window, image, counts, has_bounds};
    int64_t filled = 0;
    int64_t in_vain = 0;
    int64_t filled_when_bounded = 0;
    Poll poll;
    for (int64_t i = 0; i < n_seen; i++) {
        poll();
        if (i + PREFETCH_DISTANCE < n_seen) {
            const int ahead = memory.ordered.all[i + PREFETCH_DISTANCE];
            prefetch(clusters.points, 3ll * clusters.vertex_starts[ahead],
                     3ll * clusters.vertex_starts[ahead + 1]);
            prefetch(clusters.corners, clusters.face_starts[ahead],
                     clusters.face_starts[ahead + 1]);
            prefetch(clusters.faces, clusters.face_starts[ahead], clusters.face_starts[ahead + 1]);
        }
        const int k = memory.ordered.all[i];
        const bool is_safe = memory.safe.all[k / LANES] >> (k & (LANES - 1)) & 1;
        const Cluster cluster = {clusters.vertex_starts[k], clusters.vertex_starts[k + 1],
                                 clusters.face_starts[k],   clusters.face_starts[k + 1],
                                 clusters.line_starts[k],   clusters.line_starts[k + 1],
                                 is_safe && is_centred};
        const Drawn drawn = draw_cluster(clusters, cluster, target, scratch);
        filled += drawn.filled;
        if (drawn.filled == 0) {
            in_vain += drawn.n_tried;
            if (in_vain >= FACES_IN_VAIN && filled > filled_when_bounded) {
                in_vain = 0;
                target.tests_cells = true;
                filled_when_bounded = filled;
                bound_cells(window, image);
            }
        }
        if (drawn.n_clipped)
            filled += draw_clipped(clusters, cluster, drawn.n_clipped, target, scratch);
    }
    return filled;
}

} // namespace rastercov::raster
