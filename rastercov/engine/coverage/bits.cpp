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

    static constexpr bool DECISIONS = true;
    template <class N> INLINE bool leaves_out(int64_t f) const {
        using W = Whole<N>;
        return !any((read<W>(view.seen.visible.begin() + f) > W(0)) &
                    (read<W>(view.scene.own.begin() + f) == W(COVERED)));
    }
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
    engine::Room<int32_t> counts[2]; // of all faces, where some are targets
    Desk(int64_t n_vertices, int64_t n_faces)
        : points(n_vertices * COLUMNS_OF<Camera>), views(n_faces, 0) {}
};

} // namespace

template <class Camera>
void OnePass<Camera>::judge(raster::Rasterizer &rasterizer, const raster::Canvases &canvases,
                            const raster::Looks &looks, const Camera &camera,
                            const Judging &judging, int64_t n_threads) {
    const auto &[poses, scene, rules, area_units, scale, targets, words, areas, views] = judging;
    const int64_t n_faces = scene.faces.rows();
    require_lens(camera);
    scene.check();
    require(have_rows(looks.near.rows(), poses, words, areas),
            "there must be one near plane and one row of bits for each pose");
    require(8 * words.extent(1) >= n_faces && have_rows(n_faces, area_units, views),
            "there must be an area, a bit and a number of views for each face");
    const int64_t n_targets = targets.rows.rows(), n_opaque = n_faces - n_targets;
    for (const auto &each : {targets.visible, targets.drawn})
        require(n_targets == 0 || (each.rows() == poses.rows() && each.extent(1) == n_targets),
                "counts of targets must have a row for each pose");
    require(n_targets == 0 || targets.opaque.rows() == n_opaque,
            "each face must be a target, or opaque");
    require_indices(targets.rows, n_faces, "targets must be faces");
    require_indices(targets.opaque, n_faces, "opaque must hold faces");
    using Own = Desk<Camera>;
    engine::Idle<Own> desks(std::max<int64_t>(n_threads, 1));
    const auto take = [&](int64_t row, const raster::Counts &counts) {
        require(counts.visible.rows() == n_faces ||
                    (n_targets && counts.visible.rows() >= n_opaque),
                "counts must be of all faces");
        auto desk = desks.take();
        if (!desk) desk = std::make_unique<Own>(scene.vertices.rows(), n_faces);
        const auto of_all = [&](int k, const Column<int32_t> &drawn,
                                const auto &of_targets) -> Array<const int32_t, Any, Any> {
            if (n_targets == 0) return {drawn.begin(), {1, n_faces}};
            auto &all = desk->counts[k];
            if (all.size() == 0) all.take(n_faces);
            for (int64_t i = 0; i < n_opaque; i++) all[targets.opaque[i]] = drawn[i];
            for (int64_t i = 0; i < n_targets; i++)
                all[targets.rows[i]] = int32_t(of_targets(row, i));
            return {all.data(), {1, n_faces}};
        };
        const Seen<int32_t> seen = {{poses[row].begin(), {1}},
                                    {looks.near.begin() + row, {1}},
                                    of_all(0, counts.visible, targets.visible),
                                    of_all(1, counts.drawn, targets.drawn),
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
