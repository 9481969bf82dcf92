// Bits of the faces that poses cover: the pairs with the reason COVERED, and nothing else of them.
//
// A face without a visible sample is not covered, so neither measured nor judged. Views of faces
// are added up thread by thread.
//
// Twin: tests/raster/test_one_pass.py compares bits of figures.cpp.
#include "coverage/bits.hpp"
#include <tuple>

namespace rastercov::coverage {
namespace {

// Sets the bits of one pose, and adds to areas and views.
template <class View> struct Setter {
    const View &view;
    IntArray area_units;
    Column<uint8_t> words;
    Column<int64_t> views;
    std::tuple<int64_t, Whole<Doubles>> areas = {};

    template <class N> INLINE bool leaves_out(int64_t f) const {
        using W = Whole<N>;
        return !any((read<W>(view.seen.visible.begin() + f) > W(0)) &
                    (read<W>(view.scene.own.begin() + f) == W(COVERED)));
    }
    template <class N> INLINE bool asks_bound(const Face<N> &) const { return false; }
    // Faces from f on share a byte.
    template <class N> INLINE void take(int64_t f, const Face<N> &face) {
        using W = Whole<N>;
        static_assert(8 % AT_A_TIME<N> == 0);
        const Mask<N> is_covered = face.decision.reason == W(COVERED);
        words[f / 8] |= uint8_t(lanes_of(is_covered) << f % 8);
        int64_t *const count = views.begin() + f;
        write(count, read<W>(count) + select(is_covered, W(1), W(0)));
        W &area = std::get<W>(areas);
        area = area + select(is_covered, read<W>(area_units.begin() + f), W(0));
    }
};

// Memory of one thread.
template <class Camera> struct Desk {
    Memory<Camera> memory;
    engine::Room<double> points;
    engine::Room<int64_t> views;
    Desk(int64_t n_vertices, int64_t n_faces)
        : points(n_vertices * COLUMNS_OF<Camera>), views(n_faces, 0) {}
};

} // namespace

template <class Camera>
void OnePass<Camera>::judge(raster::Rasterizer &rasterizer, const raster::Canvases &canvases,
                            const raster::Looks &looks, const Camera &camera,
                            const Judging &judging, int64_t n_threads) {
    const auto &[poses, scene, rules, area_units, scale, words, areas, views] = judging;
    const int64_t n_faces = scene.faces.rows();
    require_lens(camera);
    scene.check();
    require(have_rows(looks.near.rows(), poses, words, areas),
            "there must be one near plane and one row of bits for each pose");
    require(8 * words.extent(1) >= n_faces && have_rows(n_faces, area_units, views),
            "there must be an area, a bit and a number of views for each face");
    using Own = Desk<Camera>;
    engine::Idle<Own> desks(std::max<int64_t>(n_threads, 1));
    const auto take = [&](int64_t row, const raster::Counts &counts) {
        require(counts.visible.rows() == n_faces, "counts must be of all faces");
        auto desk = desks.take();
        if (!desk) desk = std::make_unique<Own>(scene.vertices.rows(), n_faces);
        const std::array<int64_t, 2> shape = {1, n_faces};
        const Seen<int32_t> seen = {{poses[row].begin(), {1}},
                                    {looks.near.begin() + row, {1}},
                                    {counts.visible.begin(), shape},
                                    {counts.drawn.begin(), shape},
                                    scale,
                                    {},
                                    {},
                                    scale};
        using OfPose = View<Camera, int32_t>;
        const auto points = desk->points.template rows<COLUMNS_OF<Camera>>();
        const OfPose view = {scene, camera, seen, rules, points, desk->memory, Asked(rules), 0};
        Setter<OfPose> setter = {view, area_units, words[row], desk->views.all()};
        judge_pose(view, 0, setter);
        auto &[area, lanes] = setter.areas;
        for (int k = 0; k < AT_A_TIME<Doubles>; k++) area += lane_of(lanes, k);
        areas[row] = area;
        desks.give_back(std::move(desk));
    };
    rasterizer.count_each(canvases, looks, n_threads, take);
    while (const auto desk = desks.take())
        for (int64_t f = 0; f < n_faces; f++) views[f] += desk->views[f];
}
template struct OnePass<Lens>;
template struct OnePass<ParallelLens>;
template struct OnePass<CurvedLens>;

} // namespace rastercov::coverage
