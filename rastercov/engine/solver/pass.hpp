// Poses of a surface through several cameras, shared among threads: figures into rows, regions.
//
// Any number of threads may use one at the same time. The answer does not depend on their number.
//
// Twins: tests/exact/test_batch.py.
#pragma once
#include "solver/idle.hpp"
#include "solver/solver.hpp"

namespace rastercov::engine {

// P poses; `rows` are those that are computed, `turns` the row of the result of each pose.
struct Poses {
    FloatRows<4, 4> world_from_camera;
    Int32Array camera;
    IntArray rows, turns;
};

// Figures to fill, a row a pose in the order of the mesh; no rows where none are asked for.
struct Figures {
    Array<double, Any, Any> visible, area;
    Array<uint8_t, Any, Any> kind;
    Array<double, Any, Any> area_error;
    Column<bool> clipped; // poses whose near plane cuts away a surface in view
    bool are_asked() const { return kind.rows() > 0; }
    Row row(int64_t pose) const {
        return {{visible[pose], area[pose], area_error[pose]}, kind[pose]};
    }
};

// What is computed of the poses of a call.
struct Job {
    Handle surface;
    Poses poses;
    Figures figures;
    const area::Planes *planes = nullptr; // of regions, if they are asked for
    BoolArray left_out;                   // faces that need no figures, in the order of the mesh
};

class Pass {
  public:
    Pass(bool is_certifying, bool keeps_pieces, int64_t n_cameras, int64_t n_idle);

    // Takes a camera, and for regions the criteria of its task; once.
    bool has_camera(int64_t index) const;
    void set_camera(int64_t index, std::shared_ptr<const Camera> camera,
                    std::shared_ptr<const CameraTask> task);

    // Computes the rows of a job; regions of each where they are asked for.
    std::vector<Regions> run(const Job &job, int64_t n_threads, const GoOn &go_on = {});

    // Gives memory back; calls after it keep none.
    void close() { _idle.close(); }
    int64_t n_idle() const { return _idle.size(); }

  private:
    std::unique_ptr<Solver> set(std::unique_ptr<Solver> solver, const Job &job) const;
    void check(const Job &job) const;

    const bool _is_certifying, _keeps_pieces;
    std::vector<std::shared_ptr<const Camera>> _cameras;
    std::vector<std::shared_ptr<const CameraTask>> _tasks;
    Idle<Solver> _idle;
    Pace _pace = INFINITY;
};

} // namespace rastercov::engine
