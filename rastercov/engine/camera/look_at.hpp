// Poses by where a camera looks: world_from_camera with z along the view and y down in the image.
//
// Equations (6.8)-(6.11). Where the view is parallel to up, (6.10) is undefined: then the axis
// furthest from the view takes its place. Source: E. S. Eissa. Image Space Coverage Model. 2020.
//
// Twins: tests/test_pose.py, tests/native/test_c_border.py.
#pragma once
#include "vector.hpp"
#include <algorithm>

namespace rastercov {

constexpr double PARALLEL = 1e-9; // sine of the angle to up from which on (6.10) is undefined

// Over the power of two above the largest number, which rounds nothing: no square can vanish or
// overflow.
inline Coordinates scaled(Coordinates of) {
    int exponent = 0;
    std::frexp(std::max({std::abs(of[0]), std::abs(of[1]), std::abs(of[2])}), &exponent);
    for (double &each : of) each = std::ldexp(each, -exponent);
    return of;
}

inline Coordinates unit_of(Coordinates of) {
    const double along = length(of);
    for (double &each : of) each /= along;
    return of;
}

// The axis furthest from a direction; among equals the later one, so that z stays up if it can.
// Rounded, so that noise does not decide between equals.
inline Coordinates furthest_axis(const Coordinates &from) {
    const auto near = [&](size_t axis) { return std::nearbyint(std::abs(from[axis]) * 1e6); };
    size_t furthest = 2;
    for (size_t axis : {size_t(1), size_t(0)})
        if (near(axis) < near(furthest)) furthest = axis;
    Coordinates found = {};
    found[furthest] = 1.0;
    return found;
}

// Writes a pose, 4 x 4, of two different points and a direction, which may be zero.
inline void write_pose(const double *eye, const double *target, const double *up, double *pose) {
    const Coordinates upward = scaled({up[0], up[1], up[2]});
    const Coordinates forward =
        unit_of(scaled({target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]}));
    Coordinates right = cross(forward, upward);
    if (length(right) <= PARALLEL * length(upward)) right = cross(forward, furthest_axis(forward));
    right = unit_of(right);
    // A product of nearly parallel vectors is short and its rounding great: take out what is along
    // the view.
    const double along = dot(right, forward);
    for (size_t k = 0; k < 3; k++) right[k] -= along * forward[k];
    right = unit_of(right);
    const Coordinates down = cross(forward, right);
    for (size_t k = 0; k < 3; k++)
        for (const double each : {right[k], down[k], forward[k], eye[k]}) *pose++ = each;
    std::copy_n(std::array{0.0, 0.0, 0.0, 1.0}.data(), 4, pose);
}

} // namespace rastercov
