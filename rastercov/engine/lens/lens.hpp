// Pixels and derivatives of one ray of a lens.
//
// They do not look at the valid region; `is_valid` does. Nothing allocates; see formulas.hpp.
//
// Twin: rastercov.reference.lenses.
#pragma once
#include "lens/formulas.hpp"

namespace rastercov::lens {

constexpr int64_t SECTORS = 128; // sides of the polygon around the valid region
// Rules for images of edges: least and greatest n, see rules.hpp, and rows by n.
constexpr int64_t FEWEST = 2, MOST = 11, TABLE = MOST + 1;

using Frame = Array<const double, 3, 3>; // lens_from_plane

// Pixel (u, v) of a ray by the equations alone, wherever it is.
inline Pixel<double> project(int64_t code, const Params &p, double X, double Y, double Z) {
    return projected(code, p, X, Y, Z);
}

// Rays of points (x, y, 1) of a plane.
struct RayLanes {
    Lanes X, Y, Z;
};
template <class Rays, class N> INLINE Rays rays_in_plane(const Frame &f, N x, N y) {
    return {f(0, 0) * x + f(0, 1) * y + f(0, 2), f(1, 0) * x + f(1, 1) * y + f(1, 2),
            f(2, 0) * x + f(2, 1) * y + f(2, 2)};
}
inline Ray ray_in_plane(const Frame &frame, double x, double y) {
    return rays_in_plane<Ray>(frame, x, y);
}
INLINE RayLanes lanes_in_plane(const Frame &frame, Lanes x, Lanes y) {
    return rays_in_plane<RayLanes>(frame, x, y);
}
// A ray in the axes of a plane.
inline Ray ray_from_plane(const Frame &f, const Ray &ray) {
    const auto along = [&](int axis) {
        return ray.X * f(0, axis) + ray.Y * f(1, axis) + ray.Z * f(2, axis);
    };
    return {along(0), along(1), along(2)};
}

// Derivative of the pixel by the ray.
struct Jacobian {
    double ux, uy, uz, vx, vy, vz;
};

inline Jacobian jacobian(int64_t code, const Params &p, double X, double Y, double Z) {
    double u[3], v[3];
    // In a loop the equations are compiled once: they are long.
    for (int axis = 0; axis < 3; axis++) {
        const auto pixel =
            projected(code, p, Step(X, axis == 0 ? STEP : 0.0), Step(Y, axis == 1 ? STEP : 0.0),
                      Step(Z, axis == 2 ? STEP : 0.0));
        u[axis] = pixel.u.imag / STEP;
        v[axis] = pixel.v.imag / STEP;
    }
    return {u[0], u[1], u[2], v[0], v[1], v[2]};
}

// Derivatives of the pixel by the place (x, y) in a plane.
struct PlaneSlopes {
    double u_x, u_y, v_x, v_y;
};

inline PlaneSlopes plane_slopes(int64_t code, const Params &p, const Frame &frame, double x,
                                double y) {
    const Ray ray = ray_in_plane(frame, x, y);
    double u[2], v[2];
    for (int axis = 0; axis < 2; axis++) {
        const auto pixel =
            projected(code, p, Step(ray.X, STEP * frame(0, axis)),
                      Step(ray.Y, STEP * frame(1, axis)), Step(ray.Z, STEP * frame(2, axis)));
        u[axis] = pixel.u.imag / STEP;
        v[axis] = pixel.v.imag / STEP;
    }
    return {u[0], u[1], v[0], v[1]};
}

// The valid region: rays within a cone around the z axis whose border is at an angle from it.
struct Cone {
    double sine, cosine;
    explicit Cone(const Params &p) {
        const double size = rounded::hypot(1.0, p[SLOPE]), sign = p[SLOPE] > 0.0 ? 1.0 : -1.0;
        sine = std::abs(p[SLOPE]) / size;
        cosine = sign / size;
    }
    // The cone holds no ray backwards, and is convex.
    bool is_convex() const { return cosine > 0.0; }
    Ray on_border(double turn) const {
        return {sine * rounded::cos(turn), sine * rounded::sin(turn), cosine};
    }
};

// True for a ray of the valid region: within r <= SLOPE Z where SLOPE > 0; where SLOPE <= 0, all
// but the cone r < SLOPE Z around -z.
inline bool is_valid(const Params &p, double X, double Y, double Z) {
    const double r = rounded::hypot(X, Y);
    if (!(r < INFINITE && std::abs(Z) < INFINITE)) return false;
    if (p[SLOPE] > 0.0) return r <= p[SLOPE] * Z && Z > 0.0;
    return r >= p[SLOPE] * Z && (r > 0.0 || Z != 0.0);
}

} // namespace rastercov::lens
