// What stands behind handles of C, and the checks that all calls share.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "c/handles.hpp"
#include "camera/near.hpp"
#include "solver/mesh.hpp"
#include "solver/pass.hpp"
#include "solver/union.hpp"
#pragma GCC visibility push(default) // all else is hidden
#include "rastercov.h"
#pragma GCC visibility pop
#include <array>
#include <cmath>
#include <cstdio>
#include <new>

namespace rastercov::c {
constexpr double GAP_REL = 1e-6;    // as of rastercov.core.area.regions
constexpr double STRIP_REL = 2e-5;  // of borders of the image of a lens, as there
constexpr double FLOOR_REL = 1e-15; // least distance of two corners, relative to the diagonal
constexpr double RIGID = 1e-6;      // largest error of a rotation
constexpr int64_t MOST_FACES = std::numeric_limits<int32_t>::max() / 3;
constexpr int64_t MOST_THREADS = 1024, MOST_VIEWS = 10'000;

// Faces that hide, in a scene of diagonal 1 about the origin, for points: see area_point.
struct Hiders {
    std::array<double, 3> centre;
    double diagonal;
    std::vector<int64_t> faces; // in the order of the tree
    std::vector<int64_t> row;   // of each face in it, -1 for none
    std::vector<double> corners, nodes;

    void place(const double *from, double *to) const {
        for (size_t k = 0; k < 3; k++) to[k] = (from[k] - centre[k]) / diagonal;
    }
};

struct SurfaceObject {
    engine::Mesh mesh;
    mutable std::mutex changes;
    mutable std::unique_ptr<const Hiders> hiders; // made at the first question
};

// A lens: its ideal planes for solvers, and itself for points. Views are of its own numbers.
struct LensObject {
    std::vector<double> numbers;
    std::vector<int32_t> children;
    std::vector<uint8_t> kinds;
    CurvedLens curved = {};
    std::vector<double> rows; // of each plane, those of the lens
    std::vector<int64_t> counts;
    std::unique_ptr<bool[]> flags;
    bool has_closed_form = false;
    std::vector<engine::IdealPlane> planes;
    std::vector<lens::Tree> trees;
    std::vector<lens::Slopes> slopes;

    // Pointwise criteria in each plane.
    std::shared_ptr<engine::CameraTask> task_of(const Rules &rules) const;
};

using LensPointer = std::shared_ptr<const LensObject>;

// Solvers of a camera and a task, kept for the next call with the same.
struct SolverObject {
    std::shared_ptr<const SurfaceObject> surface;
    bool is_certifying;
    int64_t n_threads;
    std::mutex changes;
    rc_camera camera = {};
    LensPointer lens; // of it; what its pass uses
    rc_task task = {};
    bool has_task = false;
    std::shared_ptr<engine::Pass> pass;
};

// Poses as a pass takes them.
struct Placed {
    std::vector<double> matrices;
    std::vector<int32_t> camera;
    std::vector<int64_t> rows;

    Placed(const double *poses, int64_t n);
    engine::Poses poses() const {
        const auto n = int64_t(rows.size());
        return {
            {matrices.data(), {n}}, {camera.data(), {n}}, {rows.data(), {n}}, {rows.data(), {n}}};
    }
};

struct RegionsObject {
    std::shared_ptr<const SurfaceObject> surface;
    std::vector<engine::Regions> poses;
};

struct UnionObject {
    std::shared_ptr<const SurfaceObject> surface;
    mutable std::mutex changes;
    std::unique_ptr<engine::Union> all;
};

Handles &handles();
std::string &last_error();

// What is said where there may be no memory for a text.
[[maybe_unused]] inline rc_status fail_with(rc_status status, const char *what) noexcept {
#ifdef __cpp_exceptions
    try {
        last_error() = what;
    } catch (...) {
        last_error().clear();
    }
#endif
    return status;
}

// Runs a call: its code, with a text where it is not RC_OK.
template <class Call> rc_status guard(const char *doing, Call call) noexcept {
#ifndef __cpp_exceptions // errors leave through the host
    (void)doing;
    call();
    return RC_OK;
#else
    try {
        call();
        return RC_OK;
    } catch (const BadHandle &error) {
        return fail_with(RC_BAD_HANDLE, error.what());
    } catch (const Error &error) {
        return fail_with(RC_BAD_ARGUMENT, error.what());
    } catch (const Interrupted &) {
        return fail_with(RC_STOPPED, "stopped by the callback; finished rows are kept");
    } catch (const std::bad_alloc &) {
        char text[160];
        std::snprintf(text, sizeof text,
                      "expected memory for %s, got too little; pass fewer poses or free handles",
                      doing);
        return fail_with(RC_OUT_OF_MEMORY, text);
    } catch (const std::exception &error) {
        return fail_with(RC_FAILED, error.what());
    } catch (...) {
        return fail_with(
            RC_FAILED,
            "expected a std::exception from the callback, got another type; catch it there");
    }
#endif
}

// What stands behind a type of handles, and what errors call it.
template <class Handle> struct Behind;
#define RASTERCOV_HANDLE(HANDLE, OBJECT)                                                           \
    template <> struct Behind<HANDLE> {                                                            \
        using Object = OBJECT;                                                                     \
        static constexpr auto name = #HANDLE;                                                      \
    }
RASTERCOV_HANDLE(rc_surface, SurfaceObject);
RASTERCOV_HANDLE(rc_solver, SolverObject);
RASTERCOV_HANDLE(rc_lens, LensObject);
RASTERCOV_HANDLE(rc_regions, RegionsObject);
RASTERCOV_HANDLE(rc_union, UnionObject);

template <class Handle> auto object_of(const Handle *handle) {
    return handles().get<typename Behind<Handle>::Object>(handle, Behind<Handle>::name);
}
template <class Handle> rc_status free_handle(const Handle *handle) {
    return guard("freeing a handle", [&] {
        handles().free<typename Behind<Handle>::Object>(handle, Behind<Handle>::name);
    });
}

inline void expect_array(const void *array, const char *name) {
    if (array) return;
    fail((std::string("expected a pointer to ") + name + ", got null; pass one").c_str());
}

template <class... T> void expect_arrays(const char *name, const T *...arrays) {
    (expect_array(arrays, name), ...);
}

template <class T> T *expect_result(T *result) {
    expect_array(result, "the result");
    return result;
}

inline engine::GoOn go_on_of(rc_go_on function, void *context) {
    if (!function) return {};
    return [=] { return function(context) != 0; };
}

// Bounds of the corners of faces.
Box box_of(const engine::MeshArrays &mesh, bool with_targets = true);
void check_camera(const rc_camera *camera); // of rays through a point
inline Lens pinhole_of(const rc_camera &camera) {
    return {camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height};
}
void check_pose(const double *pose);
void check_faces(const SurfaceObject &surface, int64_t n_faces);
void write_corners(const SurfaceObject &surface, const std::vector<int32_t> &faces,
                   const int32_t *counts, const double *xy, double *corners);
Rules rules_of(const rc_task &task);
// Regions of n handles and all of their poses, of one surface: the first one's where none is given.
struct RegionsList {
    std::shared_ptr<const SurfaceObject> surface;
    std::vector<std::shared_ptr<const RegionsObject>> kept;
    std::vector<const engine::Regions *> poses;

    RegionsList(const rc_regions *const *regions, int64_t n,
                std::shared_ptr<const SurfaceObject> of = nullptr);
};
// Adds regions of poses, all at once.
void add_poses(engine::Union &to, const std::vector<const engine::Regions *> &poses);
#ifdef __wasm__
double tangent_of(double angle);
inline double cosine_of(double angle) { return std::cos(angle); }
#else // rounded once, by any library of C
inline double cosine_of(double angle) { return double(std::cos(static_cast<long double>(angle))); }
inline double tangent_of(double angle) { return double(std::tan(static_cast<long double>(angle))); }
#endif
// The pass of a solver for a camera with its lens, and for a task or none.
std::shared_ptr<engine::Pass> pass_of(SolverObject &solver, const rc_camera &camera,
                                      const LensPointer &lens, const rc_task *task);
// Regions of poses of a camera with its lens, and of a task.
std::shared_ptr<RegionsObject> found_by(SolverObject &solver, const rc_camera &camera,
                                        const LensPointer &lens, const rc_task &task,
                                        const Placed &placed, const engine::GoOn &go_on);
// A lens of the numbers of one row, see lens/packed.cpp.
std::shared_ptr<LensObject> lens_from(std::vector<double> numbers);
// The lens of a camera that was checked, null for a pinhole.
LensPointer lens_of(const rc_camera &camera);
inline const engine::Regions &pose_of(const RegionsObject &regions, int64_t pose) {
    expect(pose >= 0 && pose < int64_t(regions.poses.size()),
           "a pose index below the number of poses", pose, "count poses from 0");
    return regions.poses[size_t(pose)];
}

} // namespace rastercov::c
