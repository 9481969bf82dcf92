// Views of a scene along parallel rays, such as those of the sun, and the areas that they light.
//
// Rotations come from directions alone: the place of the scene rounds none of them.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "camera/look_at.hpp"
#include "camera/near.hpp"

namespace rastercov {

// Pixels of an image of a scene, its size relative to the scene, and the radians between rays and a
// face up to which the face gets nothing.
constexpr double SUN_SIDE = 1280, SUN_MARGIN = 1.01, EDGE_ON_RAD = 1e-9;

// Views of a box by unit vectors to the sun.
struct SunViews {
    Coordinates middle;
    double radius;

    explicit SunViews(const Box &box) : radius(length(minus(box[1], box[0])) / 2) {
        for (size_t k = 0; k < 3; k++) middle[k] = (box[0][k] + box[1][k]) / 2;
        if (radius == 0) radius = 1.0;
    }
    double px_per_m() const { return SUN_SIDE / (2 * SUN_MARGIN * radius); }
    void write(const double *direction, double *pose) const {
        constexpr double ORIGIN[] = {0, 0, 0}, UP[] = {0, 0, 1};
        write_pose(direction, ORIGIN, UP, pose);
        for (size_t k = 0; k < 3; k++) pose[4 * k + 3] = middle[k] + 2 * radius * direction[k];
    }
};

// Areas of a face projected along the rays, m^2: lit, whole, and the bound of their errors.
struct SunlitFace {
    double &lit, &whole, &bound;

    // Leaves nothing where a face turns away or is edge-on, by the cosine of its normal to the rays
    // and its area.
    void keep_front(double cosine, bool two_sided, double area) const {
        if (two_sided) cosine = std::abs(cosine);
        if (cosine > EDGE_ON_RAD) return;
        lit = whole = 0.0;
        bound = cosine > 0 ? cosine * area : 0.0;
    }
};

} // namespace rastercov
