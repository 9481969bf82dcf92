// CPU rasteriser: samples of each face in the images of pinholes; loops over poses and bands.
//
// rastercov.raster.cpu has the stages in a table, and their files. A Scene is a mesh in clusters,
// looked at once; a Worker has the memory of one thread, and is used by one call at a time.
//
// Invariants: every sample belongs to exactly one of two faces that share an edge; results depend
// neither on the number of threads, nor on the bands, nor on what was counted before.
//
// Twins: rastercov.reference.raster_stages, of each stage.
#include "bind.hpp"
#include "raster/band.hpp"
#include <mutex>
#include <tuple>

namespace rastercov {
namespace raster {
namespace {

constexpr int64_t MAX_SIDE = GUARD_BAND / STEPS;

struct Scene {
    Clusters clusters;
    int64_t n_faces;
    Scene(const Clusters &clusters, int64_t n_faces);
};

void require_starts(const Array<const int32_t, Any> &starts, int64_t n, int64_t least, int64_t most,
                    int64_t end, const char *wanted) {
    require(starts.rows() == n + 1 && starts[0] == 0 && starts[n] <= end, wanted);
    for (int64_t k = 0; k < n; k++) {
        const int64_t size = int64_t(starts[k + 1]) - starts[k];
        require(size >= least && size <= most, wanted);
    }
}

Scene::Scene(const Clusters &all, int64_t n_faces) : clusters(all), n_faces(n_faces) {
    const int64_t n = all.n, slots = all.corners.rows();
    require(n >= 0 && n_faces >= 0, "n and n_faces must not be negative");
    require(all.stride == all.bounds.extent(1) && all.stride % LANES == 0 && all.stride >= n,
            "stride must be the columns of bounds, whole vectors of n clusters");
    require_starts(all.vertex_starts, n, 1, VERTICES, (all.points.rows() - LANES) / 3,
                   "vertex_starts must rise by 1 to 64, and points hold all and 16 more");
    require_starts(all.face_starts, n, 0, FACES, slots - FACES,
                   "face_starts must rise by at most 64, and corners hold all and 64 more");
    require_starts(all.line_starts, n, 0, FACES, all.lines.rows(),
                   "line_starts must rise by at most 64, within lines");
    require(all.faces.rows() == slots, "corners and faces must have one row for each slot");
    require(n_faces > 0 || n == 0, "clusters must be of some faces");
    require_indices(all.lines, (n_faces >> LINE_BITS) + 1, "lines must hold lines of faces");
    if (n_faces) require_indices(all.faces, n_faces, "faces must hold faces");
    for (int64_t k = 0; k < n; k++) {
        const int count = all.vertex_starts[k + 1] - all.vertex_starts[k];
        require(all.face_starts[k] % LANES == 0 && all.face_starts[k + 1] % LANES == 0,
                "face_starts must be multiples of 16");
        bool is_right = true;
        for (int64_t slot = all.face_starts[k]; slot < all.face_starts[k + 1]; slot++)
            for (int i = 0; i < 3; i++)
                is_right &= (all.corners[slot] >> 8 * i & (BUFFER_SIZE - 1)) < count;
        require(is_right, "corners must hold vertices of their cluster");
    }
}

// `world_from_camera` from the same origin as the vertices; its first two axes need not be
// orthogonal, since rastercov.raster.sample_grid mixes them to rotate the samples. Depth of the
// near plane, and whether back faces are hidden.
struct Poses {
    Array<const double, Any, 4, 4> world_from_camera;
    Array<const double, Any> near;
    Array<const bool, Any> cull;
};
// Least and greatest magnification of a length parallel to the image over its depth, in samples;
// fx, fy, cx, cy; size in samples; first block of each row of blocks that is wholly inside the
// image, and the one after the last; samples of each row that count, from the first up to the last;
// whether samples within the width and the height may be outside the image.
struct Canvas {
    Array<const double, 2> magnification;
    Array<const double, 4> intrinsics;
    int64_t width, height;
    Array<const int64_t, Any, 2> inner;
    Array<const int32_t, Any> first, last;
    bool is_rolled;

    int columns() const {
        constexpr int SHIFT = SIDE_BITS + STRIP_BITS;
        return int((width + (1 << SHIFT) - 1) >> SHIFT << STRIP_BITS);
    }
};
// Samples of each face and, if `drawn` is not empty, of each face alone; samples with a face in
// them. How often each sample of the image counts in the first two, in blocks, and bounds of the
// depth of cells, inf where no sample counts; both are empty where each counts once.
struct Output {
    Array<int32_t, Any, Any> visible, drawn;
    Array<int64_t, Any> filled;
    Array<const uint8_t, Any> weights;
    Array<const float, Any> cell_bounds;
};
// First row of each band of the image, and the row after its last: multiples of SIDE, except at the
// end of the image.
using Bands = Array<const int64_t, Any, 2>;

struct Worker {
    const Scene &scene;
    Memory memory;
    std::mutex in_use;

    static int64_t at_least_0(int64_t n) {
        require(n >= 0 && n <= MAX_SIDE * MAX_SIDE / STRIP_SAMPLES, "sizes must be of an image");
        return n;
    }
    Worker(const Scene &scene, int64_t n_marks, int64_t n_cells)
        : scene(scene), memory(at_least_0(n_marks), at_least_0(n_cells), scene.clusters.stride) {}
};

void require_canvas(const Canvas &canvas) {
    require(canvas.width > 0 && canvas.width <= MAX_SIDE && canvas.height > 0 &&
                canvas.height <= MAX_SIDE,
            "width and height must be from 1 to 2^21");
    require(canvas.first.rows() == canvas.height && canvas.last.rows() == canvas.height &&
                canvas.inner.rows() == (canvas.height + SIDE - 1) >> SIDE_BITS,
            "first, last and inner must have one row for each row of samples, and of blocks");
}

// Sizes of what a band is drawn to.
struct Sizes {
    int64_t first_block, blocks, first_cell, cells;
};
Sizes sizes_of(int64_t top, int64_t bottom, int64_t columns) {
    const int64_t first = (top >> SIDE_BITS) * columns;
    const int64_t rows = (bottom - top + SIDE - 1) >> SIDE_BITS;
    return {first, rows * columns, first >> 2 * SIDE_BITS,
            ((rows + SIDE - 1) >> SIDE_BITS) * (columns >> SIDE_BITS)};
}

void require_bands(const Bands &bands, const Canvas &canvas, const Output &output,
                   const Memory &memory) {
    for (int64_t band = 0; band < bands.rows(); band++) {
        const int64_t top = bands(band, 0), bottom = bands(band, 1);
        require(top >= 0 && top < bottom && bottom <= canvas.height && top % SIDE == 0,
                "bands must be rows of the canvas, from a multiple of 4 on");
        const Sizes sizes = sizes_of(top, bottom, canvas.columns());
        require(sizes.blocks <= memory.marks.all.rows() << STRIP_BITS &&
                    sizes.cells <= memory.cell_depth.all.rows(),
                "bands must fit the memory");
        const int64_t n_weights = (sizes.first_block + sizes.blocks) * LANES;
        require(output.weights.rows() == 0 || output.weights.rows() >= n_weights,
                "weights must be of all blocks of the canvas");
        require(output.cell_bounds.rows() == 0 ||
                    output.cell_bounds.rows() >= sizes.first_cell + sizes.cells,
                "cell_bounds must be of all cells of the canvas");
    }
}

// Writes the camera of a pose, and the clusters that may be visible in some band.
void cull_pose(const Clusters &clusters, Array<const double, 4, 4> pose, double near,
               bool hides_backs, int64_t top, int64_t bottom, const Canvas &canvas,
               const Memory &memory) {
    const auto &[camera, frustum] = std::tie(memory.scratch->camera, memory.scratch->frustum);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) camera.axes[3 * i + k] = pose(i, k);
        camera.eye[i] = pose(i, 3);
    }
    const auto &lens = canvas.intrinsics;
    camera.fx = lens[0], camera.fy = lens[1], camera.cx = lens[2], camera.cy = lens[3];
    camera.near = near, camera.magnification = canvas.magnification[1];
    put_frustum(camera, double(canvas.width), double(top), double(bottom), frustum);
    for (int64_t at = 0; at < clusters.n; at += LANES) {
        const Kept found =
            cull_clusters(clusters.bounds, at, camera, frustum, canvas.magnification[0],
                          hides_backs, memory.down.all, memory.forward.all);
        memory.kept.all[at / LANES] = int32_t(found.drawn & first_lanes(clusters.n - at));
        memory.safe.all[at / LANES] = int32_t(found.safe);
    }
}

void count(Worker &worker, const Poses &poses, const Canvas &canvas, Bands bands,
           const Output &output) {
    const Clusters &clusters = worker.scene.clusters;
    const Memory &memory = worker.memory;
    const int64_t n_poses = poses.near.rows(), n_faces = worker.scene.n_faces;
    const bool with_drawn = output.drawn.rows() > 0;
    require(poses.world_from_camera.rows() == n_poses && poses.cull.rows() == n_poses &&
                output.visible.rows() == n_poses && output.filled.rows() == n_poses &&
                (!with_drawn || output.drawn.rows() == n_poses),
            "poses and output must have one row for each pose");
    require(output.visible.extent(1) == n_faces &&
                (!with_drawn || output.drawn.extent(1) == n_faces),
            "visible and drawn must have one column for each face");
    require_canvas(canvas);
    require_bands(bands, canvas, output, memory);
    const std::scoped_lock lock(worker.in_use);
    const int64_t n_bands = bands.rows();
    const int columns = canvas.columns();
    for (int64_t p = 0; p < n_poses; p++) {
        Counts counts = {output.visible[p], {}, {}, with_drawn, output.weights.rows() > 0};
        std::fill(counts.visible.begin(), counts.visible.end(), 0);
        if (with_drawn) {
            counts.drawn = output.drawn[p];
            std::fill(counts.drawn.begin(), counts.drawn.end(), 0);
        }
        output.filled[p] = 0;
        if (n_bands == 0) continue;
        cull_pose(clusters, poses.world_from_camera[p], poses.near[p], poses.cull[p] && !with_drawn,
                  bands(0, 0), bands(n_bands - 1, 1), canvas, memory);
        for (int64_t band = 0; band < n_bands; band++) {
            const int64_t top = bands(band, 0), bottom = bands(band, 1);
            const int full_x = canvas.is_rolled ? 0 : int(canvas.width >> SIDE_BITS);
            const int full_y = canvas.is_rolled ? 0 : int(canvas.height >> SIDE_BITS);
            const Window window = {int(canvas.width - 1),
                                   int(top),
                                   int(bottom - 1),
                                   poses.cull[p],
                                   columns,
                                   int(canvas.height),
                                   full_x,
                                   full_y,
                                   canvas.inner,
                                   canvas.first,
                                   canvas.last};
            const Sizes sizes = sizes_of(top, bottom, columns);
            Array<const float, Any> cell_bounds;
            if (counts.is_weighted)
                counts.weights =
                    part(output.weights, sizes.first_block * LANES, sizes.blocks * LANES);
            if (output.cell_bounds.rows())
                cell_bounds = part(output.cell_bounds, sizes.first_cell, sizes.cells);
            output.filled[p] += draw_band(clusters, window, double(canvas.width), n_bands == 1,
                                          counts, cell_bounds, memory);
        }
    }
}

// Copies the band that `count` left in its memory to the rows of an image.
void read_band(Worker &worker, int64_t top, int64_t bottom, Array<int32_t, Any, Any> face,
               Array<float, Any, Any> depth) {
    const int64_t width = face.extent(1), strip = SIDE << STRIP_BITS;
    const int64_t columns = (width + strip - 1) / strip << STRIP_BITS;
    const Memory &memory = worker.memory;
    require(depth.rows() == face.rows() && depth.extent(1) == width,
            "face and depth must have one element for each sample");
    require(top >= 0 && top <= bottom && bottom <= face.rows(), "top and bottom must be rows");
    require(sizes_of(0, bottom - top, columns).blocks <= memory.marks.all.rows() << STRIP_BITS,
            "rows must fit the memory");
    const std::scoped_lock lock(worker.in_use);
    for (int64_t row = top; row < bottom; row++)
        for (int64_t column = 0; column < width; column++) {
            const int64_t block = ((row - top) >> SIDE_BITS) * columns + (column >> SIDE_BITS);
            if (!memory.marks.all[block >> STRIP_BITS]) continue;
            const int64_t in_block = (row & (SIDE - 1)) << SIDE_BITS | (column & (SIDE - 1));
            const int64_t sample = block << 2 * SIDE_BITS | in_block;
            const float inverse = memory.depth.all[sample];
            if (inverse > 0) {
                face(row, column) = memory.face.all[sample];
                depth(row, column) = float(1.0 / double(inverse));
            }
        }
}

} // namespace
} // namespace raster

template <> struct Record<raster::Clusters> {
    using S = raster::Clusters;
    static constexpr auto fields =
        Fields<&S::points, &S::corners, &S::faces, &S::lines, &S::vertex_starts, &S::face_starts,
               &S::line_starts, &S::bounds, &S::n, &S::stride>();
};
template <> struct Record<raster::Poses> {
    using S = raster::Poses;
    static constexpr auto fields = Fields<&S::world_from_camera, &S::near, &S::cull>();
};
template <> struct Record<raster::Canvas> {
    using S = raster::Canvas;
    static constexpr auto fields = Fields<&S::magnification, &S::intrinsics, &S::width, &S::height,
                                          &S::inner, &S::first, &S::last, &S::is_rolled>();
};
template <> struct Record<raster::Output> {
    using S = raster::Output;
    static constexpr auto fields =
        Fields<&S::visible, &S::drawn, &S::filled, &S::weights, &S::cell_bounds>();
};

void register_raster_loops(nanobind::module_ &m) {
    using namespace raster;
    namespace nb = nanobind;
    m.attr("LANES") = LANES, m.attr("SIDE") = SIDE, m.attr("STRIP_BITS") = STRIP_BITS;
    m.attr("STEPS") = STEPS, m.attr("GUARD_BAND") = GUARD_BAND;
    auto scene = nb::class_<Scene>(m, "Scene", "Mesh in clusters, looked at once.");
    def(scene, nb::init<const Clusters &, int64_t>(), "clusters", "n_faces");
    auto worker = nb::class_<Worker>(m, "Worker", "Memory of one thread, and the loops over it.");
    def(worker, nb::init<const Scene &, int64_t, int64_t>(), "scene", "n_marks", "n_cells");
    def(worker, "count", count, "Count the samples of poses into `output`.", "poses", "canvas",
        "bands", "output");
    def(worker, "read_band", read_band, "Copy the band that was counted last to rows of an image.",
        "top", "bottom", "face", "depth");
}

} // namespace rastercov
