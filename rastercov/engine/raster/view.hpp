// Faces as one pose sees them: their corners in camera axes, and depths in their planes.
//
// Twin: tests/raster/test_lenses.py, by rays.
#pragma once
#include "raster/clipping.hpp"
#include <tuple>

namespace rastercov {
namespace raster {

// Corners of faces in space, metres; rotation world_from_camera with its first two axes mixed as by
// SampleGrid.axes, and camera centre, from the same origin as the corners; fx, fy, cx, cy in
// samples; depth of the near plane, metres. Faces seen by parallel rays are made central.
struct View {
    FloatRows<3, 3> corners;
    Array<const double, 3, 3> axes;
    Array<const double, 3> eye;
    Array<const double, 4> lens;
    double near;
    double farthest = 0.0; // as of Camera
};
// A face in camera axes.
inline Polygon face_in_camera(const View &view, int64_t f) {
    Polygon face;
    face.n = 3;
    for (int i = 0; i < 3; i++) {
        const auto corner = view.corners[f][i];
        const double x = corner[0] - view.eye[0], y = corner[1] - view.eye[1],
                     z = corner[2] - view.eye[2];
        for (int k = 0; k < 3; k++)
            face.corners[i][k] = x * view.axes(0, k) + y * view.axes(1, k) + z * view.axes(2, k);
    }
    if (view.farthest > 0) make_central(face, view.farthest);
    return face;
}
// Plane of a face in camera axes, normal . p = height, and the depths of its corners.
struct FacePlane {
    int32_t face = -1;
    double normal[3], height, least, greatest;
};
inline FacePlane plane_of_face(const View &view, int32_t f) {
    const Polygon its = face_in_camera(view, f);
    const auto &[a, b, c] = std::tie(its.corners[0], its.corners[1], its.corners[2]);
    FacePlane plane = {f, {}, 0, 0, 0};
    for (int k = 0; k < 3; k++) {
        const int m = (k + 1) % 3, n = (k + 2) % 3;
        plane.normal[k] = (b[m] - a[m]) * (c[n] - a[n]) - (b[n] - a[n]) * (c[m] - a[m]);
    }
    plane.height = plane.normal[0] * a[0] + plane.normal[1] * a[1] + plane.normal[2] * a[2];
    plane.least = std::max(std::min({a[2], b[2], c[2]}), view.near);
    plane.greatest = std::max(std::max({a[2], b[2], c[2]}), view.near);
    return plane;
}
// Depth at a place X / Z and Y / Z, or the distance along its ray; that of
// `inverse`, 1/z, where the face is edge-on.
INLINE double depth_at(const FacePlane &plane, double x, double y, bool by_distance,
                       float inverse) {
    const auto &[_, normal, height, least, greatest] = plane;
    double z = height / (normal[0] * x + normal[1] * y + normal[2]);
    if (!std::isfinite(z)) z = float(1.0 / double(inverse));
    z = std::min(std::max(z, least), greatest);
    return by_distance ? z * std::sqrt(1 + x * x + y * y) : z;
}

} // namespace raster

} // namespace rastercov
