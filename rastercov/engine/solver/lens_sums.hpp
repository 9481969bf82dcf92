// Figures of faces in the image of a lens: sums over its ideal planes, whose areas are integrals
// along edges (lens/edges.hpp).
//
// Twins: tests/exact/test_lens_solver.py.
#pragma once
#include "solver/camera.hpp"
#include "solver/plane_solver.hpp"

namespace rastercov::engine {

class LensSums {
  public:
    explicit LensSums(const Surface &surface);

    // As of PlaneSolver.
    void set_surface(const Surface &surface);

    // Begins a pose whose figures go to other arrays, or to its own for none.
    void begin(const Areas *out);
    // False where the image shows nothing of a plane, or all of the surface is beside it; of
    // parallel rays the solver finds that.
    bool may_see(const IdealPlane &plane, const Pose &pose, bool is_parallel) const;
    // Adds the images of all faces and pieces of a plane that was solved.
    void add(const IdealPlane &plane, const PlaneSolver &solved);
    // Ends the pose. Bounds are at most twice the size of the image.
    void end(const Lens &image);

    Areas areas() const { return {_sums.visible, _sums.area, _sums.area_error}; }
    BoolArray is_certified() const { return _is_certified.all(); }

  private:
    void make_found(int64_t n, int64_t corners);

    const Surface *_surface = nullptr;
    exact::PlaneSums _sums;
    Room<double> _own[3], _vertices, _places, _bulge, _drawn, _images, _found_corners;
    Room<int8_t> _counts[3];
    Room<bool> _is_certified, _is_inside, _is_done;
    Room<int32_t> _sides, _longer, _found_faces;
    Room<int64_t> _found_starts;
    int64_t _found_used[3] = {};
    exact::VisiblePieces _found;
    double _box[24];
};

} // namespace rastercov::engine
