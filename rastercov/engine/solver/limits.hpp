// Near plane of a pose, what it cuts away, and whether back faces can be left out.
//
// Surfaces nearer than the near plane are cut away. Where nothing in view is cut and the camera is
// outside a closed mesh, faces seen from behind cannot be the nearest surface. Targets hide
// nothing, so that they change none of this.
//
// Twin: tests/test_projection.py.
#pragma once
#include "solver/build.hpp"
#include "solver/camera.hpp"
#include "solver/plane_solver.hpp"

namespace rastercov::engine {

struct Limits {
    double near; // depth of the near plane, metres
    bool front_only;
    bool is_clipped; // the near plane cuts away a surface in view
};

Limits limits_of(const Surface &surface, const Camera &camera, const Pose &pose);

// Opaque faces, their bounding box, and that of all that is measured.
template <class Faces> struct Scene {
    exact::Vertices vertices;
    Faces faces;
    Box bounds, all;
};

// Limits without a surface. `away` is the distance by which a closed one hides its back from the
// camera or does not, 0 where it does not: inside, or with a surface cut away.
struct Reach {
    double near, away;
    bool is_clipped; // without `asks_cut` false for a camera inside of pinholes
};
template <class Faces>
Reach reach_of(const Scene<Faces> &scene, const Camera &camera, const Pose &pose, bool asks_cut);

// Tangent of the widest ray of a pinhole.
double widest_of(const Lens &of);

// The pose of the pinhole of an ideal plane.
Pose rotate(const Pose &pose, const lens::Frame &frame);

} // namespace rastercov::engine
