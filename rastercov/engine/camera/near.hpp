// Depth of the near plane of a pose.
//
// Surfaces are cut away nearer than the near plane of the camera, and nearer than NEAR_TO_FAR times
// the distance of the farthest corner of their bounding box.
//
// Twin: tests/test_projection.py.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>

namespace rastercov {

using Box = std::array<std::array<double, 3>, 2>; // lowest and highest coordinates, metres

// Metres: positive even where every vertex is at the camera centre.
constexpr double NEAR_TO_FAR = 1e-6, LEAST_DEPTH = 1e-150;

// Distance of the farthest corner of a box from a point.
template <class Point> double farthest_of(const Box &box, const Point &point) {
    double total = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        const auto k = size_t(axis);
        const double at = point(axis);
        const double reach = std::max(std::abs(box[0][k] - at), std::abs(box[1][k] - at));
        total += reach * reach;
    }
    return std::sqrt(total);
}

inline double near_of(double of_camera, double farthest) {
    return std::max(std::max(of_camera, LEAST_DEPTH), NEAR_TO_FAR * farthest);
}

} // namespace rastercov
