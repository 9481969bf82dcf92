// A pose through a pinhole, or through the planes of a lens.
//
// Twins: tests/exact/test_exactness.py, tests/exact/test_lens_solver.py.
#include "engine/solver.hpp"
#include "engine/limits.hpp"

namespace rastercov::engine {

namespace {
struct NoVisit {};

// Copies figures in the order of the mesh.
void fill_row(const Areas &areas, const Row &row, const Array<const int64_t, Any> &place) {
    const auto take = [&](const Array<double, Any> &from, const Array<double, Any> &to) {
        if (from.data == to.data) return;
        for (int64_t f = 0; f < to.rows(); f++) to[f] = from[place.rows() ? place[f] : f];
    };
    take(areas.visible, row.areas.visible);
    take(areas.area, row.areas.area);
    take(areas.area_error, row.areas.area_error);
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
        const Pose pose = turned(view.pose, frame);
        const bool is_seen = _sums->may_see(plane, pose);
        if (std::is_same_v<Visit, NoVisit> && !is_seen) continue;
        if (!solved || !std::equal(frame.begin(), frame.end(), solved)) {
            _plane.set_pose(plane.pinhole, pose, view.near, view.front_only);
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
        _plane.set_pose(view.camera.image, view.pose, view.near, view.front_only);
        _plane.solve_all();
        if constexpr (!std::is_same_v<Visit, NoVisit>) visit(0);
    }
    if (!row) return;
    const auto &place = _plane.surface().place();
    const auto certified = is_certified();
    fill_row(areas(), *row, place);
    for (int64_t f = 0; f < row->kind.rows(); f++)
        row->kind[f] = uint8_t(EXACT - certified[place.rows() ? place[f] : f]);
    _plane.write_to(nullptr);
}

void Solver::solve(const View &view, const Row *row) { solve_with(view, row, true, NoVisit()); }

Regions Solver::find(const View &view, const area::Planes &planes, const CameraTask &task,
                     const Row *row) {
    std::vector<Regions> parts;
    solve_with(view, row, row != nullptr, [&](size_t index) {
        _cutter.cut(_plane, planes, task.planes[index], _is_lens, parts);
    });
    return joined(std::move(parts), planes);
}

} // namespace rastercov::engine
