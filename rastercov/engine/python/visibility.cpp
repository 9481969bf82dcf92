// The border of cameras, solvers and passes to Python: rastercov.engine.solver_visibility.
//
// Twins: tests/exact/test_batch.py, tests/exact/test_exactness.py.
#include "bind.hpp"
#include "python/handle.hpp"
#include "python/tables.hpp"
#include "solver/limits.hpp"
#include "solver/pass.hpp"
#include <nanobind/stl/shared_ptr.h>

namespace rastercov {

RECORD(engine::Poses, world_from_camera, camera, rows, turns);
RECORD(engine::Figures, visible, area, kind, area_error, clipped);

namespace {
namespace nb = nanobind;
using engine::Camera, engine::CameraTask, engine::Figures, engine::Pass, engine::Poses;
using Mask = BoolArray;

// --- cameras ---

void make_camera(Camera *self, const Lens &image, double near, bool is_parallel) {
    const double sizes[] = {image.fx, image.fy, image.width, image.height};
    for (const double each : sizes)
        expect(each > 0 && each < INFINITY, "a positive image size and focal length", each,
               "correct the camera");
    require(std::abs(image.cx) < INFINITY && std::abs(image.cy) < INFINITY && near >= 0 &&
                near < INFINITY,
            "a camera must have a finite principal point and near plane");
    new (self) Camera{image, near, {}, is_parallel};
}

void add_plane(Camera &camera, const lens::PlaneRecord &record, const Lens &pinhole) {
    lens::require_plane(record);
    camera.planes.push_back({record, pinhole});
}

void find_limits(const engine::Welded &opaque, Array<const double, 2, 3> bounds,
                 const Camera &camera, FloatRows<4, 4> poses, bool asks_cut, Column<double> near,
                 Column<double> away, Column<bool> clipped) {
    require_indices(opaque.faces, opaque.vertices.rows(), "faces must be rows of vertices");
    require(have_rows(poses.rows(), near, away, clipped), "there must be one row for each pose");
    Box box;
    for (int k = 0; k < 6; k++) box[k / 3][k % 3] = bounds.data[k];
    const engine::Scene<decltype(opaque.faces)> scene = {opaque.vertices, opaque.faces, box, box};
    for (int64_t i = 0; i < poses.rows(); i++) {
        const engine::Pose pose = engine::pose_of(poses[i]);
        const engine::Reach reach = engine::reach_of(scene, camera, pose, asks_cut);
        near[i] = reach.near;
        away[i] = reach.away;
        clipped[i] = reach.is_clipped;
    }
}

void add_pinhole_task(CameraTask &task, const area::Criteria &criteria) {
    area::LensCriteria of_plane = {};
    of_plane.pinhole = criteria;
    task.planes.push_back(of_plane);
}

void add_plane_task(CameraTask &task, const area::LensCriteria &criteria) {
    const lens::Tree &tree = criteria.tree;
    require(have_rows(tree.lines.rows(), tree.children, tree.kinds) &&
                tree.root < tree.lines.rows(),
            "the field of view must have one row for each node");
    task.planes.push_back(criteria);
}

// --- passes ---

constexpr auto FIND =
    "Find regions of poses: corners, corner counts and faces of pieces, pieces of each pose; "
    "faces, faces of each pose, areas, bounds and excess; area cut short.";

void observe(Pass &pass, const SurfaceHandle &surface, const Mask &left_out, const Poses &poses,
             const Figures &figures, int64_t n_threads) {
    pass.run({surface.surface, poses, figures, nullptr, left_out}, n_threads);
}

nb::tuple find_all(Pass &pass, const SurfaceHandle &surface, const area::Planes &planes,
                   const Mask &left_out, const Poses &poses, const Figures &figures,
                   int64_t n_threads) {
    const auto work = [&] {
        return table_of(pass.run({surface.surface, poses, figures, &planes, left_out}, n_threads),
                        poses.turns);
    };
    return call_within_memory(
        FIND, [&] { return arrays_of(call_apart(FIND, work, planes, left_out, poses, figures)); });
}

} // namespace

// A method whose object keeps its first argument alive.
template <class C, class R, class... Args, class... Names>
void def_kept(nb::class_<C> &type, const char *name, R (*function)(C &, Args...), const char *doc,
              Names... names) {
    type.def(name, function, nb::arg(names)..., nb::keep_alive<1, 2>(),
             nb::sig(signature<R, Args...>(name, true, names...).c_str()), doc);
}

void register_solver_visibility(nb::module_ &m) {
    auto camera = nb::class_<Camera>(m, "Camera", "A pinhole, or a lens with its ideal planes.");
    camera.def("__init__", make_camera, nb::arg("image"), nb::arg("near"), nb::arg("is_parallel"),
               nb::sig(signature<void, Lens, double, bool>("__init__", true, "image", "near",
                                                           "is_parallel")
                           .c_str()));
    def_kept(camera, "add_plane", add_plane, "Add an ideal plane.", "record", "pinhole");
    def(m, "find_limits", find_limits,
        "Set the near plane of each pose, the distance of those whose backs may be hidden, or 0, "
        "and whether a surface is cut.",
        "opaque", "bounds", "camera", "poses", "asks_cut", "near", "away", "clipped");
    auto task = nb::class_<CameraTask>(m, "CameraTask", "Criteria of regions of a camera.");
    task.def(nb::init<>());
    def_kept(task, "add_pinhole", add_pinhole_task, "Set those of a pinhole.", "criteria");
    def_kept(task, "add_plane", add_plane_task, "Add those of an ideal plane.", "criteria");
    auto pass = nb::class_<Pass>(m, "Pass", "Poses through cameras, shared among threads.");
    pass.def(nb::init<bool, bool, int64_t, int64_t>(), nb::arg("is_certifying"),
             nb::arg("keeps_pieces"), nb::arg("n_cameras"), nb::arg("n_idle"));
    pass.def("has_camera", &Pass::has_camera, nb::arg("index"));
    pass.def("set_camera", &Pass::set_camera, nb::arg("index"), nb::arg("camera"),
             nb::arg("task").none());
    def(pass, "observe", observe, "Compute figures of poses.", "surface", "left_out", "poses",
        "figures", "n_threads");
    pass.def("find", find_all, nb::arg("surface"), nb::arg("planes"), nb::arg("left_out"),
             nb::arg("poses"), nb::arg("figures"), nb::arg("n_threads"),
             nb::sig("def find(self, surface: rastercov.engine.solver_surface.Surface, "
                     "planes: tuple[typing.Any, ...], left_out: typing.Any, "
                     "poses: tuple[typing.Any, ...], figures: tuple[typing.Any, ...], "
                     "n_threads: int) -> tuple[typing.Any, ...]"),
             FIND);
    def(pass, "close", &Pass::close, "Give memory back.");
    pass.def_prop_ro("n_idle", &Pass::n_idle);
}

} // namespace rastercov
