// Near plane of a pose, what it cuts away, and whether back faces can be left out.
//
// Surfaces nearer than the near plane are cut away. Where nothing in view is cut and the camera is
// outside a closed mesh, faces seen from behind cannot be the nearest surface. Targets hide
// nothing, so that they change none of this.
//
// Twin: rastercov.core.camera.near_plane.
#pragma once
#include "solver/camera.hpp"
#include "solver/plane_solver.hpp"

namespace rastercov::engine {

struct Limits {
    double near; // depth of the near plane, metres
    bool front_only;
    bool is_clipped; // the near plane cuts away a surface in view
};

Limits limits_of(const Surface &surface, const Camera &camera, const Pose &pose);

// Tangent of the widest ray of a pinhole.
double widest_of(const Lens &of);

// The pose of the pinhole of an ideal plane.
Pose rotate(const Pose &pose, const lens::Frame &frame);

} // namespace rastercov::engine
