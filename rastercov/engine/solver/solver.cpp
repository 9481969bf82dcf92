// A pose through a pinhole, or through the planes of a lens.
//
// Twins: tests/exact/test_exactness.py, tests/exact/test_lens_solver.py.
#include "solver/solver.hpp"
#include "solver/limits.hpp"

namespace rastercov::engine {

namespace {
struct NoVisit {};

// Copies figures of faces in another order into that of the mesh.
void fill_sorted(const Areas &from, BoolArray is_certified, const IntArray &place, const Row &row) {
    const Areas &to = row.areas;
    for (int64_t f = 0; f < row.kind.rows(); f++) {
        const int64_t at = place[f];
        to.visible[f] = from.visible[at];
        to.area[f] = from.area[at];
        to.area_error[f] = from.area_error[at];
        row.kind[f] = uint8_t(EXACT - is_certified[at]);
    }
}

} // namespace

bool Solver::set_surface(const Handle &surface) {
    if (surface == _plane.handle()) return true;
    const Surface &own = _plane.surface();
    if (surface->faces().data != own.faces().data || surface->n_faces() != own.n_faces())
        return false;
    _plane.set_surface(surface);
    if (_sums) _sums->set_surface(*surface);
    return true;
}

// Solves the planes of a lens; `visit` is called with each by its number.
template <class Visit> void Solver::solve_planes(const View &view, bool is_measured, Visit visit) {
    const auto &planes = view.camera.planes;
    const double *solved = nullptr;
    for (size_t index = 0; index < planes.size(); index++) {
        const IdealPlane &plane = planes[index];
        const lens::Frame &frame = plane.record.frame;
        const Pose pose = rotate(view.pose, frame);
        const bool is_parallel = view.camera.is_parallel;
        const bool is_seen = _sums->may_see(plane, pose, is_parallel);
        if (std::is_same_v<Visit, NoVisit> && !is_seen) continue;
        if (!solved || !std::equal(frame.begin(), frame.end(), solved)) {
            _plane.set_pose(plane.pinhole, pose, view.near, view.front_only, is_parallel);
            _plane.solve_all();
            solved = frame.data;
        }
        if constexpr (!std::is_same_v<Visit, NoVisit>) visit(index);
        if (is_measured && is_seen) _sums->add(plane, _plane);
    }
    _sums->end(view.camera.image);
}

template <class Visit>
void Solver::solve_with(const View &view, const Row *row, bool is_measured, Visit visit) {
    const bool is_direct = row && !_plane.surface().is_sorted();
    const Areas *const out = is_direct ? &row->areas : nullptr;
    _is_lens = !view.camera.planes.empty();
    if (_is_lens) {
        if (!_sums) _sums = std::make_unique<LensSums>(_plane.surface());
        _sums->begin(out);
        solve_planes(view, is_measured, visit);
    } else {
        _plane.write_to(out);
        _plane.set_pose(view.camera.image, view.pose, view.near, view.front_only,
                        view.camera.is_parallel);
        _plane.solve_all();
        if constexpr (!std::is_same_v<Visit, NoVisit>) visit(0);
    }
    if (!row) return;
    const BoolArray certified = is_certified();
    if (is_direct)
        for (int64_t f = 0; f < row->kind.rows(); f++) row->kind[f] = uint8_t(EXACT - certified[f]);
    else fill_sorted(areas(), certified, _plane.surface().place(), *row);
    _plane.write_to(nullptr);
}

void Solver::solve(const View &view, const Row *row) { solve_with(view, row, true, NoVisit()); }

Regions Solver::find(const View &view, const area::Planes &planes, const CameraTask &task,
                     const Row *row) {
    std::vector<Regions> parts;
    solve_with(view, row, row != nullptr, [&](size_t index) {
        _cutter.cut(_plane, planes, task.planes[index], _is_lens, parts);
    });
    return join_regions(std::move(parts), planes);
}

} // namespace rastercov::engine
