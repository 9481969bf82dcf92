// The border of the rasteriser to Python: rastercov.engine.solver_raster.
//
// Twin: rastercov.core.raster.cpu.
#include "solver/raster.hpp"
#include "bind.hpp"
#include "coverage/bits.hpp"
#include "python/views.hpp"
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

namespace rastercov {

RECORD(raster::Scattered, offsets, used, cell_bounds, lanes, samples, places);
RECORD(raster::Grid, width, height, lens, mix, runs, is_rolled, is_parallel);
RECORD(raster::Looks, world_from_camera, near, cull);
template <class T> struct Record<raster::Output<T>> {
    using S = raster::Output<T>;
    static constexpr auto fields = Fields<&S::visible, &S::drawn, &S::filled, &S::adds>();
};
template <> inline void put_type<raster::Canvases>(std::string &text, Type<raster::Canvases>) {
    text += "list[Canvas]";
}

namespace raster {
namespace {
namespace nb = nanobind;

nb::tuple clusters_of(nb::handle_t<Scene> self) {
    const Clusters of = nb::cast<const Scene &>(self).clusters();
    return nb::make_tuple(view_of(of.points, self), view_of(of.corners, self),
                          view_of(of.faces, self), view_of(of.lines, self),
                          view_of(of.vertex_starts, self), view_of(of.face_starts, self),
                          view_of(of.line_starts, self), view_of(of.bounds, self));
}
} // namespace
} // namespace raster

void register_solver_raster(nanobind::module_ &m) {
    using namespace raster;
    m.attr("LANES") = LANES;
    m.attr("SIDE") = SIDE;
    m.attr("STRIP_BITS") = STRIP_BITS;
    m.attr("TIE_REL") = TIE_REL;
    m.attr("FINE_STEP_BITS") = FINE_STEP_BITS;
    m.attr("MAX_BAND") = MAX_BAND;
    m.attr("RADIUS") = int(RADIUS);
    auto scene = nb::class_<Scene>(m, "Scene", "Mesh in clusters.");
    def(scene, nb::init<const Points &, const Triples &, const Array<const double, 3> &, bool>(),
        "vertices", "faces", "centre", "is_wound");
    def(scene, "set_bounds", &Scene::set_bounds, "Set other bounds of its clusters, for tests.",
        "bounds");
    offer(scene, "clusters", "tuple[typing.Any, ...]", clusters_of);
    auto canvas = nb::class_<Canvas>(m, "Canvas", "Samples of an image.");
    def(canvas, nb::init<const Scattered &, const Grid &, int64_t>(), "scattered", "grid",
        "max_band");
    auto all = nb::class_<Rasterizer>(m, "Rasterizer", "Poses of a mesh, shared among threads.");
    def(all, nb::init<const Scene &, int64_t>(), "scene", "n_idle");
    def(all, "count", &Rasterizer::count<int32_t>, "Count the samples of faces in poses.",
        "canvases", "looks", "output", "n_parts", "n_threads");
    def(all, "count_long", &Rasterizer::count<int64_t>, "The same in 64 bits.", "canvases", "looks",
        "output", "n_parts", "n_threads");
    const auto add = [&](auto judge) {
        def(all, "judge", judge, "Count poses, set bits of the faces that they cover, add views.",
            "canvases", "looks", "lens", "judging", "n_threads");
    };
    add(coverage::OnePass<rastercov::Lens>::judge);
    add(coverage::OnePass<ParallelLens>::judge);
    add(coverage::OnePass<CurvedLens>::judge);
    def(all, "count_targets", &Rasterizer::count_targets, "Add the samples of targets in poses.",
        "canvases", "looks", "corners", "visible", "drawn", "n_threads");
    def(all, "render", &Rasterizer::render, "Draw images of poses.", "canvas", "looks", "face",
        "depth", "n_threads");
    def(all, "render_lanes", &Rasterizer::render_lanes, "Draw the image of a pose through a lens.",
        "canvases", "looks", "corners", "by_distance", "face", "depth", "n_threads");
    def(all, "close", &Rasterizer::close, "Give memory back.");
    all.def_prop_ro("n_idle", &Rasterizer::n_idle);
}

} // namespace rastercov
