// An ideal plane of a lens as the loops take it, and the images of its points.
//
// Rays are projected some at a time, lane by lane as one by one but for atan2, whose lanes are
// those of formulas.hpp.
//
// Invariants: the image of a point depends on the point alone, not on its place in a list.
//
// Twin: rastercov.reference.lenses.
#pragma once
#include "lens/lens.hpp"

namespace rastercov {

namespace lens {

using Corners = FloatRows<2>; // of a polygon, in units of a plane

// See rastercov.core.camera.lenses.of_camera. Convex polygons are counter-clockwise in (x, y).
struct PlaneRecord {
    int64_t code;
    Params params;
    Frame frame;
    double fx, fy, cx, cy; // of the pinhole, px
    Corners region, hole, window;
    Array<const double, TABLE> longest;
    int64_t parts_of;
    bool is_graded;
    double width, height, bend, stretch, speed, tolerance;
    // Of arcs along the border of the valid region, by the turn around its axis, radians: half the
    // longest part of one, 0 where the image does not show the border, and the bend, px.
    double arc_half, arc_bend;
    bool has_border() const { return arc_half > 0; }
};

inline void require_plane(const PlaneRecord &plane) {
    require(plane.parts_of >= FEWEST && plane.parts_of <= MOST, "parts_of must be a rule");
}

// Columns of the places of vertices: in a plane, in its units, and in the image, px.
enum { X, Y, U, V };
constexpr int64_t GROUP = 8; // rays of a vector: lists have room for a multiple of it

// Images of m points (x, y) of a plane, into u and v; all have room for a multiple of GROUP. By a
// base that is a number all of them are one loop, of the least bytes.
template <class Code>
void project_group(Code code, const Params &given, const Frame &frame, const double *x,
                   const double *y, int64_t m, double *u, double *v) {
    double own[SIZE], axes[9]; // that no store to u and v can change
    std::copy(given.begin(), given.end(), own);
    std::copy(frame.begin(), frame.end(), axes);
    const Params p = {own, {}};
    const Frame f = {axes, {}};
    const auto project_each = [&](auto pixel_of) __attribute__((always_inline)) {
        for (int64_t i = 0; i < m; i += AT_A_TIME<Lanes>) {
            const Pixel<Lanes> pixel = pixel_of(Lanes::load(x + i), Lanes::load(y + i));
            pixel.u.store(u + i);
            pixel.v.store(v + i);
        }
    };
    constexpr bool is_one_loop = std::is_same_v<Code, int64_t>;
    if (!is_one_loop && code != EQUIRECTANGULAR && f(0, 0) == 1.0 && f(1, 1) == 1.0 &&
        f(2, 2) == 1.0) { // the plane ahead
        project_each([&](Lanes px, Lanes py) __attribute__((always_inline)) {
            return projected(code, p, px, py, One());
        });
        return;
    }
    project_each([&](Lanes px, Lanes py) __attribute__((always_inline)) {
        const auto [X, Y, Z] = lanes_in_plane(f, px, py);
        if (!is_planar(code)) return projected(code, p, X, Y, Z);
        const Lanes w = 1.0 / Z;
        return projected(code, p, X * w, Y * w, One());
    });
}

inline void project_lanes(const PlaneRecord &plane, const double *x, const double *y, int64_t m,
                          double *u, double *v) {
#ifdef __wasm__
    project_group(plane.code, plane.params, plane.frame, x, y, m, u, v);
#else
    const auto with = [&]<int64_t... codes>(std::integer_sequence<int64_t, codes...>) {
        const auto one = [&]<int64_t code>(BaseIs<code> base) {
            if (plane.code != code) return false;
            project_group(base, plane.params, plane.frame, x, y, m, u, v);
            return true;
        };
        return (one(BaseIs<codes>()) || ...);
    };
    if (!with(std::make_integer_sequence<int64_t, N_BASES>()))
        project_group(BaseIs<PINHOLE>(), plane.params, plane.frame, x, y, m, u, v);
#endif
}

// Point of a plane on the border of the valid region, at a turn around its axis.
inline Point<double> border_point(const PlaneRecord &plane, double turn) {
    const auto [x, y, z] = ray_from_plane(plane.frame, Cone(plane.params).on_border(turn));
    return {x / z, y / z};
}

// Pixel (u, v) of a point of a plane.
inline Pixel<double> plane_value(const PlaneRecord &plane, double x, double y) {
    const Ray ray = ray_in_plane(plane.frame, x, y);
    return project(plane.code, plane.params, ray.X, ray.Y, ray.Z);
}

} // namespace lens

RECORD(lens::PlaneRecord, code, params, frame, fx, fy, cx, cy, region, hole, window, longest,
       parts_of, is_graded, width, height, bend, stretch, speed, tolerance, arc_half, arc_bend);

} // namespace rastercov
