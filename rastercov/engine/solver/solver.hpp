// Figures and regions of a surface through cameras of any kind, one pose at a time, for one thread.
//
// It owns scratch and results; results are views until its next call. After an error it must be
// dropped: what a pose has left half done is never used again.
//
// Twins: tests/exact/test_exactness.py, tests/exact/test_lens_solver.py.
#pragma once
#include "solver/lens_sums.hpp"
#include "solver/regions.hpp"

namespace rastercov::engine {

// Kinds of bounds, as rastercov.core.raster.contract.BoundKind has them.
constexpr uint8_t EXACT = 2; // less 1: certified

// A row to fill with the figures of a pose, in the order of the mesh.
struct Row {
    Areas areas;
    Column<uint8_t> kind;
};

// What is looked for in a pose.
struct View {
    const Camera &camera;
    Pose pose;
    double near; // depth of the near plane, metres
    bool front_only;
};

class Solver {
  public:
    // For regions, and for lenses, it keeps pieces.
    Solver(Handle surface, bool is_certifying, bool keeps_pieces)
        : _plane(std::move(surface), is_certifying, keeps_pieces) {}

    // Takes a surface that differs in positions and contacts alone; false if it cannot.
    bool set_surface(const Handle &surface);
    void leave_out(BoolArray faces) { _plane.leave_out(faces); }

    // Computes all figures of every face, into a row where one is given.
    void solve(const View &view, const Row *row);
    // Regions of a pose, and its figures where a row is given.
    Regions find(const View &view, const area::Planes &planes, const CameraTask &task,
                 const Row *row);

    const PlaneSolver &plane() const { return _plane; } // the last one of a lens
    Areas areas() const { return _is_lens ? _sums->areas() : _plane.areas(); }
    BoolArray is_certified() const {
        return _is_lens ? _sums->is_certified() : _plane.is_certified();
    }

  private:
    template <class Visit> void solve_planes(const View &view, bool is_measured, Visit visit);
    template <class Visit>
    void solve_with(const View &view, const Row *row, bool is_measured, Visit visit);

    PlaneSolver _plane;
    std::unique_ptr<LensSums> _sums; // once a lens is used
    RegionCutter _cutter;
    bool _is_lens = false;
};

} // namespace rastercov::engine
