// Stages of the CPU rasteriser one by one, for tests against numpy: nothing else calls them.
//
// Twin: rastercov.reference.raster_stages.
#include "bind.hpp"
#include "raster/band.hpp"

namespace rastercov {
namespace raster {
namespace {

template <class T> using Lane = Array<T, LANES>;
using CameraValues = Array<const double, 18>; // the fields of Camera, one after the other
static_assert(sizeof(Camera) == 18 * sizeof(double));

Camera camera_of(const CameraValues &values) {
    Camera camera;
    std::memcpy(&camera, values.data, sizeof camera);
    return camera;
}
Frustum frustum_of(const Array<const double, FRUSTUM_PLANES, 4> &planes) {
    Frustum frustum;
    for (int k = 0; k < FRUSTUM_PLANES; k++) {
        std::copy_n(planes[k].data, 3, frustum.normal[k]);
        frustum.length[k] = planes(k, 3);
    }
    return frustum;
}

// Vertices of a cluster: u, v, w; x, y.
struct Positions {
    Array<const double, 3, VERTICES> exact;
    Array<const int32_t, 2, VERTICES> whole;
};
std::unique_ptr<Vertices> vertices_of(const Positions &positions) {
    auto vertices = std::make_unique<Vertices>();
    std::copy_n(positions.exact[0].data, VERTICES, vertices->u);
    std::copy_n(positions.exact[1].data, VERTICES, vertices->v);
    std::copy_n(positions.exact[2].data, VERTICES, vertices->w);
    for (int i = 0; i < VERTICES; i++)
        vertices->places.put(i, positions.whole(0, i), positions.whole(1, i));
    return vertices;
}

// Projects the n points (3, n) of a cluster, at most 64, which begin at 3 `first`: u, v, w to
// `exact`, x, y to `whole`, least and greatest x and y to `box`.
void project(Array<const double, Any> points, int64_t first, int64_t n, const CameraValues &camera,
             bool is_safe, Array<double, 3, VERTICES> exact, Array<int32_t, 2, VERTICES> whole,
             Array<int64_t, 4> box) {
    require(first >= 0 && n >= 0 && n <= VERTICES && points.rows() >= LANES &&
                first <= points.rows() && 3 * (first + n) + LANES <= points.rows(),
            "points must hold at most 64 points, and 16 values more");
    Clusters clusters = {};
    clusters.points = points;
    Vertices vertices;
    const Cluster cluster = {first, first + n, 0, 0, 0, 0, is_safe};
    const Box found = project_vertices(clusters, cluster, camera_of(camera), STEPS, vertices);
    std::copy_n(vertices.u, n, exact[0].data), std::copy_n(vertices.v, n, exact[1].data);
    std::copy_n(vertices.w, n, exact[2].data);
    for (int64_t at = 0; at < n; at += LANES) {
        alignas(CACHE_LINE) int32_t index[LANES];
        (lane_numbers() + Int(int32_t(at))).store(index);
        Int x, y;
        vertices.places.find<false, 0>(index, x, y);
        x.store(whole[0].data + at), y.store(whole[1].data + at);
    }
    box[0] = found.low_x, box[1] = found.high_x, box[2] = found.low_y, box[3] = found.high_y;
}
float nearest(const Positions &positions, int64_t n) {
    require(n >= 0 && n <= VERTICES, "n must be at most 64");
    return nearest_vertex(*vertices_of(positions), int(n));
}

// Inward normals and their lengths.
void frustum(const CameraValues &camera, double width, double top, double bottom,
             Array<double, FRUSTUM_PLANES, 4> planes) {
    Frustum found;
    put_frustum(camera_of(camera), width, top, bottom, found);
    for (int k = 0; k < FRUSTUM_PLANES; k++) {
        std::copy_n(found.normal[k], 3, planes[k].data);
        planes(k, 3) = found.length[k];
    }
}
// Bits of a vector of clusters that are drawn; above them, of those that are safe.
int64_t cull(Array<const double, BOUNDS_OF_CLUSTER, LANES> bounds, const CameraValues &camera,
             Array<const double, FRUSTUM_PLANES, 4> planes, double magnification, bool hides_backs,
             Array<double, 2, LANES> centres) {
    const Kept kept = cull_clusters({bounds.data, {BOUNDS_OF_CLUSTER, LANES}}, 0, camera_of(camera),
                                    frustum_of(planes), magnification, hides_backs,
                                    {centres[0].data, {LANES}}, {centres[1].data, {LANES}});
    return kept.drawn | kept.safe << LANES;
}
int64_t in_band(Lane<const double> radius, Array<const double, 2, LANES> centres, double fy,
                double up, double up_length, double down, double down_length) {
    return clusters_in_band({radius.data, {LANES}}, 0, {centres[0].data, {LANES}},
                            {centres[1].data, {LANES}}, fy, {up, up_length, down, down_length});
}

// Last column, first and last row; whether back faces are hidden; blocks in a row of memory; rows
// of the image; columns and rows of blocks that are whole.
struct Frame {
    int64_t right, top, bottom;
    bool hides_back;
    int64_t columns, height, full_x, full_y;
};
Window window_of(const Frame &f) {
    constexpr int64_t MOST = 1 << 20;
    for (const int64_t one : {f.right, f.top, f.bottom, f.columns, f.height, f.full_x, f.full_y})
        require(one >= 0 && one <= MOST, "window must be of an image");
    return {int(f.right),
            int(f.top),
            int(f.bottom),
            f.hides_back,
            int(f.columns),
            int(f.height),
            int(f.full_x),
            int(f.full_y),
            {},
            {},
            {}};
}
void require_corners(const Lane<const int32_t> &corners) {
    for (const int32_t packed : corners)
        for (int k = 0; k < 3; k++)
            require((packed >> 8 * k & (BUFFER_SIZE - 1)) < VERTICES, "corners must be vertices");
}
// The first 16 slots of a cluster.
struct Slots {
    alignas(CACHE_LINE) int32_t corners[FACES] = {}, faces[FACES] = {};
    Slots(const Lane<const int32_t> &its_corners, const Lane<const int32_t> &its_faces) {
        require_corners(its_corners);
        std::copy(its_corners.begin(), its_corners.end(), corners);
        std::copy(its_faces.begin(), its_faces.end(), faces);
    }
};

// Bins a vector of faces: the slots in each list, in the order of Binned, -1 behind; and the
// samples that those of the two lists of 2 x 2 samples cover.
void bin(const Positions &positions, Lane<const int32_t> corners, const Frame &frame, bool is_plain,
         Array<int32_t, 6, LANES> listed, Array<int32_t, 2, LANES> coverage) {
    const Slots slots(corners, corners);
    const auto vertices = vertices_of(positions);
    const Image image = {};
    const Counts counts = {{}, {}, {}, true};
    const Target target = {window_of(frame), image, counts, false};
    require(frame.full_x > 0, "full_x must not be 0");
    auto bins = std::make_unique<Bins>();
    cull_and_bin({slots.corners, slots.faces, *vertices}, LANES, target, is_plain, *bins);
    const List *lists[6] = {&bins->samples_2x2,   &bins->larger, &bins->hidden_samples_2x2,
                            &bins->hidden_larger, &bins->wide,   &bins->clipped};
    std::fill(listed.begin(), listed.end(), -1);
    for (int k = 0; k < 6; k++) std::copy_n(lists[k]->slots, lists[k]->n, listed[k].data);
    std::copy_n(bins->samples_2x2.coverage, bins->samples_2x2.n, coverage[0].data);
    std::copy_n(bins->hidden_samples_2x2.coverage, bins->hidden_samples_2x2.n, coverage[1].data);
}

// Appends the index of each set bit, plus base; returns the new length.
int64_t append(int64_t bits, int64_t base, Array<int32_t, 3 * LANES> listed, int64_t n) {
    require(n >= 0 && n <= 2 * LANES, "n must leave room for 16");
    require(base >= 0 && base <= INT32_MAX - LANES, "base must fit 32 bits");
    return append_set_bits(bits & ALL_LANES, base, listed.data, n);
}

// What is set up of a vector of triangles.
struct Figures {
    Array<int64_t, 9, LANES> edges;
    Array<int32_t, 5, LANES> bounds;
    Array<double, 3, LANES> plane64;
    Array<float, 4, LANES> plane32;
    Array<int64_t, 5> sides;
};
// A block a lane.
struct Blocks {
    Lane<int32_t> masks, sample;
    Lane<float> depth;
};

template <class E> struct Stages {
    Window window;
    Sides sides;
    std::unique_ptr<Setup<E>> setup = std::make_unique<Setup<E>>();

    Stages(const Positions &positions, Lane<const int32_t> corners, Lane<const int32_t> faces,
           Lane<const int32_t> chosen, const Frame &frame)
        : window(window_of(frame)) {
        const Slots slots(corners, faces);
        require_indices(chosen, LANES, "slots must be below 16");
        const auto vertices = vertices_of(positions);
        const Faces all = {slots.corners, slots.faces, *vertices};
        sides = set_up<true>(chosen.data, true, all, window, *setup);
    }
};
int checked_lane(int64_t k) {
    require(k >= 0 && k < LANES, "lanes must be below 16");
    return int(k);
}

template <class E> void figures(Stages<E> &stages, const Figures &out) {
    const Setup<E> &t = *stages.setup;
    for (int n = 0; n < 3; n++) {
        std::copy_n(t.value[n], LANES, out.edges[n].data);
        std::copy_n(t.dx[n], LANES, out.edges[3 + n].data);
        std::copy_n(t.dy[n], LANES, out.edges[6 + n].data);
    }
    const int32_t *bounds[5] = {t.first_x, t.last_x, t.first_y, t.last_y, t.face};
    for (int k = 0; k < 5; k++) std::copy_n(bounds[k], LANES, out.bounds[k].data);
    const double *planes[3] = {t.origin, t.slope_x, t.slope_y};
    for (int k = 0; k < 3; k++) std::copy_n(planes[k], LANES, out.plane64[k].data);
    const float *narrow[4] = {t.step_x, t.step_y, t.least, t.greatest};
    for (int k = 0; k < 4; k++) std::copy_n(narrow[k], LANES, out.plane32[k].data);
    const Sides &s = stages.sides;
    const int64_t sides[5] = {s.in_2x2, s.wide, s.tall, s.shown, s.hidden};
    std::copy_n(sides, 5, out.sides.data);
}
void put_blocks(const Triangles &t, int k, const Blocks &out) {
    std::copy_n(t.masks + k * LANES, LANES, out.masks.data);
    std::copy_n(t.sample + k * LANES, LANES, out.sample.data);
    std::copy_n(t.depth + k * LANES, LANES, out.depth.data);
}
int64_t blocks_2x2(Stages<int32_t> &stages, int64_t k, const Blocks &out) {
    require(k >= 0 && k < 4, "k must be below 4");
    const InBlocks found = cover_blocks(int(k), stages.window, *stages.setup);
    put_blocks(*stages.setup, int(k), out);
    return found.covered | found.at_border << LANES;
}
void samples_2x2(Stages<int32_t> &stages, int64_t k, const Blocks &out) {
    require(k >= 0 && k < 4, "k must be below 4");
    depth_of_samples(int(k), stages.window, *stages.setup);
    put_blocks(*stages.setup, int(k), out);
}
int64_t counted_by_rows(Stages<int32_t> &stages) { return fit_count_samples(*stages.setup); }
void counts_by_rows(Stages<int32_t> &stages, int64_t chosen, Lane<int32_t> out) {
    count_samples(chosen & fit_count_samples(*stages.setup), *stages.setup);
    std::copy_n(stages.setup->masks, LANES, out.data);
}
int64_t rows_of_one(Stages<int32_t> &stages, int64_t k, int64_t start) {
    require(start >= 0 && start < LARGE, "start must be a row");
    return count_rows(checked_lane(k), int(start), *stages.setup);
}
// Blocks of the tile at the first block of a triangle that it reaches, covers wholly, and those
// that are hidden behind a bound; the coverage mask of each, and its start.
template <class E>
float tile(Stages<E> &stages, int64_t lane, double bound, Array<int64_t, 3> found,
           const Blocks &out) {
    const int k = checked_lane(lane);
    Setup<E> &t = *stages.setup;
    start_blocks(k, t.first_x[k] >> SIDE_BITS, t.first_y[k] >> SIDE_BITS, stages.window, t);
    found[2] = hidden_blocks(k, float(bound), stages.window, t);
    put_blocks(t, 0, out);
    const auto cover = [&](auto tile) {
        start_tiles(k, t, stages.window, tile);
        found[0] = reach_blocks(k, 0, 0, t, stages.window, tile);
        found[1] = whole_blocks(k, t, stages.window, tile);
        for (int i = 0; i < LANES; i++)
            out.masks[i] = int32_t(cover_block<E>(i, tile, 0, stages.window));
    };
    if constexpr (sizeof(E) == 8)
        if (fits_32_bits(k, t, stages.window)) cover(TileEdges<int32_t>());
        else cover(TileEdges<int64_t>());
    else cover(TileEdges<int32_t>());
    return least_in_tile(k, stages.window, t);
}

// Tests depths in a block of three: masks of won, lost and ties to `found`.
void test_depths(Array<float, Any> image, int64_t covered, Array<const float, 4> plane,
                 double start, Array<int64_t, 3> found) {
    require(image.rows() == 3 * LANES, "image must be three blocks");
    Triangles t;
    t.step_x[0] = plane[0], t.step_y[0] = plane[1], t.least[0] = plane[2], t.greatest[0] = plane[3];
    const Tested tested = depth_test(image, LANES, covered, block_plane(0, t), float(start));
    found[0] = tested.won, found[1] = tested.lost, found[2] = tested.ties;
}
float least_of_cell(Array<const float, Any> depth, int64_t block, int64_t columns, int64_t n_rows) {
    require(n_rows >= 1 && n_rows <= SIDE && columns >= SIDE && columns <= depth.rows() &&
                block >= 0 && block <= depth.rows() &&
                (block + columns * (n_rows - 1) + SIDE) * LANES <= depth.rows(),
            "a cell must be in memory");
    // Nothing is written to it.
    return least_depth({const_cast<float *>(depth.data), {depth.rows()}}, block, int(columns),
                       int(n_rows));
}

template <class E>
nanobind::class_<Stages<E>> define_stages(nanobind::module_ &m, const char *name) {
    namespace nb = nanobind;
    auto type = nb::class_<Stages<E>>(m, name, "A vector of triangles that is set up.");
    def(type,
        nb::init<const Positions &, Lane<const int32_t>, Lane<const int32_t>, Lane<const int32_t>,
                 const Frame &>(),
        "positions", "corners", "faces", "slots", "window");
    def(type, "figures", figures<E>, "Edge functions, bounds, planes and masks.", "out");
    def(type, "tile", tile<E>, "Blocks of a tile of one triangle; returns their least 1/z.", "k",
        "bound", "found", "out");
    return type;
}

} // namespace
} // namespace raster

template <> struct Record<raster::Positions> {
    using S = raster::Positions;
    static constexpr auto fields = Fields<&S::exact, &S::whole>();
};
template <> struct Record<raster::Frame> {
    using S = raster::Frame;
    static constexpr auto fields = Fields<&S::right, &S::top, &S::bottom, &S::hides_back,
                                          &S::columns, &S::height, &S::full_x, &S::full_y>();
};
template <> struct Record<raster::Figures> {
    using S = raster::Figures;
    static constexpr auto fields =
        Fields<&S::edges, &S::bounds, &S::plane64, &S::plane32, &S::sides>();
};
template <> struct Record<raster::Blocks> {
    using S = raster::Blocks;
    static constexpr auto fields = Fields<&S::masks, &S::sample, &S::depth>();
};

void register_raster_stages(nanobind::module_ &m) {
    using namespace raster;
    m.attr("BEHIND") = int(BEHIND), m.attr("NEEDS_CLIPPING") = int(NEEDS_CLIPPING);
    m.attr("LARGE") = LARGE, m.attr("VERTICES") = VERTICES, m.attr("LANES") = LANES;
    def(m, "project_vertices", project, "Project the vertices of a cluster.", "points", "first",
        "n", "camera", "is_safe", "exact", "whole", "box");
    def(m, "nearest_vertex", nearest, "Greatest 1/z of the first n vertices.", "positions", "n");
    def(m, "put_frustum", frustum, "Frustum of some rows of an image.", "camera", "width", "top",
        "bottom", "planes");
    def(m, "cull_clusters", cull, "Bits of clusters that are drawn; above them, that are safe.",
        "bounds", "camera", "planes", "magnification", "hides_backs", "centres");
    def(m, "clusters_in_band", in_band, "Bits of clusters that reach into a band.", "radius",
        "centres", "fy", "up", "up_length", "down", "down_length");
    def(m, "cull_and_bin", bin, "Slots of faces by path, and the samples that small ones cover.",
        "positions", "corners", "window", "is_plain", "listed", "coverage");
    def(m, "append_set_bits", append, "Append the index of each set bit to a list.", "bits", "base",
        "listed", "n");
    auto stages = define_stages<int32_t>(m, "Stages32");
    define_stages<int64_t>(m, "Stages64");
    def(stages, "cover_blocks", blocks_2x2, "Cover block k of 2 x 2 blocks.", "k", "out");
    def(stages, "depth_of_samples", samples_2x2, "Place and 1/z of sample k of 2 x 2.", "k", "out");
    def(stages, "fit_count_samples", counted_by_rows, "Triangles that count_samples can count.");
    def(stages, "count_samples", counts_by_rows, "Samples that chosen triangles cover.", "chosen",
        "out");
    def(stages, "count_rows", rows_of_one, "Samples of triangle k in rows.", "k", "start");
    def(m, "depth_test", test_depths, "Test depths in a block.", "image", "covered", "plane",
        "start", "found");
    def(m, "least_depth", least_of_cell, "Least 1/z of a cell.", "depth", "block", "columns",
        "n_rows");
}

} // namespace rastercov
