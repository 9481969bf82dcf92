// Solvers of a pass, and the poses that they share.
//
// Twins: tests/exact/test_batch.py.
#include "solver/pass.hpp"
#include "solver/limits.hpp"

namespace rastercov::engine {

namespace {
// Faces of the mesh: a surface of targets only has one more.
int64_t rows_of(const Surface &surface) {
    return surface.place().rows() ? surface.place().rows() : surface.n_faces();
}
} // namespace

Pass::Pass(bool is_certifying, bool keeps_pieces, int64_t n_cameras, int64_t n_idle)
    : _is_certifying(is_certifying), _keeps_pieces(keeps_pieces), _cameras(size_t(n_cameras)),
      _tasks(size_t(n_cameras)), _idle(n_idle) {}

bool Pass::has_camera(int64_t index) const {
    require(index >= 0 && index < int64_t(_cameras.size()), "index must be that of a camera");
    return _cameras[size_t(index)] != nullptr;
}

void Pass::set_camera(int64_t index, std::shared_ptr<const Camera> camera,
                      std::shared_ptr<const CameraTask> task) {
    if (has_camera(index)) return; // of another call, which may be at work
    require(camera->planes.empty() || _keeps_pieces, "a pass through lenses must keep pieces");
    require(!task || task->planes.size() == std::max<size_t>(1, camera->planes.size()),
            "a task must have criteria for each plane");
    _tasks[size_t(index)] = std::move(task);
    _cameras[size_t(index)] = std::move(camera);
}

void Pass::check(const Job &job) const {
    const Poses &poses = job.poses;
    const int64_t n = poses.world_from_camera.rows(), n_faces = rows_of(*job.surface);
    require(have_rows(n, poses.camera, poses.turns), "poses must have one row in each array");
    require_indices(poses.rows, n, "rows must be poses");
    require_indices(poses.turns, poses.rows.rows(), "turns must be rows of the result");
    require_indices(poses.camera, int64_t(_cameras.size()), "camera must hold cameras");
    for (const int64_t row : poses.rows) {
        const auto index = size_t(poses.camera[row]);
        require(_cameras[index] && (!job.planes || _tasks[index]),
                "cameras of the poses must have been set");
    }
    const auto fits = [&](const auto &array) {
        return array.rows() == n && array.extent(1) == n_faces;
    };
    require(!job.figures.are_asked() ||
                (fits(job.figures.visible) && fits(job.figures.area) && fits(job.figures.kind) &&
                 fits(job.figures.area_error) && job.figures.clipped.rows() == n),
            "figures must have one row for each pose, and a column for each face");
    require(job.left_out.rows() == 0 || job.left_out.rows() == n_faces,
            "faces to leave out must be those of the mesh");
    if (!job.planes) return;
    const area::Planes &planes = *job.planes;
    require(_keeps_pieces, "a pass with regions must keep pieces");
    require(have_rows(n_faces, planes.origin, planes.x_axis, planes.y_axis, planes.normal,
                      planes.corners, planes.areas, planes.two_sided, planes.is_asked),
            "planes must have one row for each face");
}

std::vector<Regions> Pass::run(const Job &job, int64_t n_threads, const GoOn &go_on) {
    check(job);
    const Poses &poses = job.poses;
    const int64_t n = poses.rows.rows();
    std::vector<Regions> found(job.planes ? size_t(n) : 0);
    const auto prepare = [&](std::unique_ptr<Solver> idle) { return set(std::move(idle), job); };
    const auto work = [&](Solver &solver, int64_t turn) {
        const int64_t at = poses.rows[turn];
        const auto index = size_t(poses.camera[at]);
        const Camera &camera = *_cameras[index];
        const Pose pose = pose_of(poses.world_from_camera[at]);
        const Limits limits = limits_of(*job.surface, camera, pose);
        const View view = {camera, pose, limits.near, limits.front_only};
        Row row;
        if (job.figures.are_asked()) {
            row = job.figures.row(at);
            job.figures.clipped[at] = limits.is_clipped;
        }
        const Row *const out = job.figures.are_asked() ? &row : nullptr;
        if (job.planes) found[size_t(turn)] = solver.find(view, *job.planes, *_tasks[index], out);
        else solver.solve(view, out);
    };
    share(n, n_threads, _idle, prepare, _pace, go_on, work);
    return found;
}

std::unique_ptr<Solver> Pass::set(std::unique_ptr<Solver> solver, const Job &job) const {
    if (!solver || !solver->set_surface(job.surface))
        solver = std::make_unique<Solver>(job.surface, _is_certifying, _keeps_pieces);
    solver->leave_out(job.left_out);
    return solver;
}

} // namespace rastercov::engine
