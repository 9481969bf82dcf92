// Cameras of the loops: the image of a point, its derivative, and the pixel densities.
//
// A `Lens` is a pinhole, whose formulas are closed; a `ParallelLens` has parallel rays; a
// `CurvedLens` is any other lens, also of parallel rays with distortion or skew. The density
// of a surface follows from the derivative J (2, 3) of pixels by the point, px/m, and its unit
// normal n: its least singular value in the plane of the surface (along), its least singular value,
// which is that of a target facing the camera (facing), and |J_u x J_v . n| (per_m2). Those of a
// pinhole are templates over the number: one, or lanes of a register. Functions of a camera are
// overloads for its kinds.
//
// T. Duff et al. Building an Orthonormal Basis, Revisited. 2017 (tangents of a normal).
//
// Twins: rastercov.reference.coverage.
#pragma once
#include "lens/lens.hpp"
#include "number.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov {

// Intrinsics and image size of a pinhole, pixels.
struct Lens {
    double fx, fy, cx, cy, width, height;
};
RECORD(Lens, fx, fy, cx, cy, width, height);

// Rays along z: fx and fy of `scale` are in px/m.
struct ParallelLens {
    Lens scale;
};
RECORD(ParallelLens, scale);

constexpr int64_t MOST_SIDES = 132; // of a region: 128 around a cone, cut by a square

// A lens for the loops over faces, one row for each of its planes. All rays are in the image that
// are within `core` times z of the axis, 0 for none. Of parallel rays it has one plane, in
// units of `unit` metres across the rays: the point (x, y, z) is at the ray (x, y, unit), whatever
// its depth. `unit` is 0 for rays that meet in a point.
struct CurvedLens {
    int64_t code;
    lens::Params params;
    double width, height;
    bool by_distance; // sharpness depends on the distance, not on the depth
    FloatRows<3, 3> frames;
    Array<const double, Any, lens::SIZE> own_params;
    Array<const double, Any, MOST_SIDES, 2> regions;
    IntArray region_sides;
    Array<const double, Any, MOST_SIDES, 2> holes;
    IntArray hole_sides;
    Array<const double, Any, lens::TABLE> longest;
    IntArray parts_of;
    BoolArray is_graded;
    FloatArray bends, arc_halves, arc_bends;
    double tolerance;
    double unit = 0.0;
    double core = 0.0;
    bool is_parallel() const { return unit > 0; }
    // Third coordinate of the ray to a point at a depth.
    double ahead_at(double z) const { return is_parallel() ? unit : z; }
};
RECORD(CurvedLens, code, params, width, height, by_distance, frames, own_params, regions,
       region_sides, holes, hole_sides, longest, parts_of, is_graded, bends, arc_halves, arc_bends,
       tolerance, unit, core);

inline void require_lens(const Lens &) {}
inline void require_lens(const ParallelLens &) {}
inline void require_lens(const CurvedLens &lens) {
    const int64_t n = lens.frames.rows();
    require(have_rows(n, lens.own_params, lens.regions, lens.region_sides, lens.holes,
                      lens.hole_sides, lens.longest, lens.parts_of, lens.is_graded, lens.bends,
                      lens.arc_halves, lens.arc_bends),
            "the arrays of a lens must have one row for each plane");
    require(!lens.is_parallel() || n == 1, "parallel rays must have one plane");
    require_indices(lens.region_sides, MOST_SIDES + 1,
                    "a region must have MOST_SIDES sides at most");
    require_indices(lens.hole_sides, MOST_SIDES + 1, "a hole must have MOST_SIDES sides at most");
    for (const int64_t n : lens.parts_of)
        require(n >= lens::FEWEST && n <= lens::MOST, "parts_of must be a rule");
}

// Derivative of a pinhole at the points z (right, down, 1).
//
// Its rows are (fx, 0, -fx right) / z and (0, fy, -fy down) / z; z remains a factor, because its
// square would underflow for a very small mesh.
template <class N> struct Slopes {
    N fx, fy, right, down, z;
};
using CurvedSlopes = lens::Jacobian; // of any lens: the rows J_u and J_v, px/m

// Depth of a point in camera axes; true if it is beyond the near plane and in the image.
struct Place {
    double depth;
    bool is_inside;
};
template <class Camera> bool is_in_image(const Camera &lens, double u, double v) {
    return 0.0 <= u && u <= lens.width && 0.0 <= v && v <= lens.height;
}
inline Place place(const Lens &lens, double near, double x, double y, double z) {
    if (!(z >= near)) return {z, false};
    return {z, is_in_image(lens, lens.fx * (x / z) + lens.cx, lens.fy * (y / z) + lens.cy)};
}
inline Place place(const ParallelLens &lens, double near, double x, double y, double z) {
    const Lens &of = lens.scale;
    return {z, z >= near && is_in_image(of, of.fx * x + of.cx, of.fy * y + of.cy)};
}
// The near planes of a lens are a cube if it has several ideal planes.
inline double near_depth(const CurvedLens &lens, double x, double y, double z) {
    if (lens.frames.rows() <= 1) return z;
    return std::max(std::max(std::abs(x), std::abs(y)), std::abs(z));
}
inline Place place(const CurvedLens &lens, double near, double x, double y, double z) {
    const double depth = near_depth(lens, x, y, z), ahead = lens.ahead_at(z);
    if (!(depth >= near && lens::is_valid(lens.params, x, y, ahead))) return {depth, false};
    const auto [u, v] = lens::project(lens.code, lens.params, x, y, ahead);
    return {depth, is_in_image(lens, u, v)};
}

// Depth of a point in camera axes that its sharpness depends on, metres.
inline double focus_depth(const Lens &, double, double, double z) { return z; }
inline double focus_depth(const ParallelLens &, double, double, double z) { return z; }
inline double focus_depth(const CurvedLens &lens, double x, double y, double z) {
    return lens.by_distance ? std::sqrt(x * x + y * y + z * z) : z;
}

// True for a point in camera axes that a camera has in front of it.
inline bool is_ahead(const Lens &, double, double, double z) { return z > 0; }
inline bool is_ahead(const ParallelLens &, double, double, double z) { return z > 0; }
inline bool is_ahead(const CurvedLens &lens, double x, double y, double z) {
    return (z > 0 || !lens.is_parallel()) && lens::is_valid(lens.params, x, y, lens.ahead_at(z));
}

// Derivative of the image at a point in camera axes, beyond the near plane and in view.
inline Slopes<double> jacobian(const Lens &lens, double x, double y, double z) {
    return {lens.fx, lens.fy, x / z, y / z, z};
}
inline CurvedSlopes jacobian(const ParallelLens &lens, double, double, double) {
    return {lens.scale.fx, 0.0, 0.0, 0.0, lens.scale.fy, 0.0};
}
inline CurvedSlopes jacobian(const CurvedLens &lens, double x, double y, double z) {
    CurvedSlopes found = lens::jacobian(lens.code, lens.params, x, y, lens.ahead_at(z));
    if (lens.is_parallel()) found.uz = found.vz = 0.0;
    return found;
}

// Pixels a metre along the worst direction of a surface with the unit normal (a, b, c).
//
// With tangents e_1, e_2 of the surface column i of the derivative is
// ((fx (e_ix - x/z e_iz))/z, (fy (e_iy - y/z e_iz))/z). Its singular values are the pixels a metre
// along the best and the worst direction on the surface.
template <class N> INLINE N along(const Slopes<N> &slopes, N a, N b, N c) {
    const auto &[fx, fy, right, down, z] = slopes;
    const N way = sign(c);
    const N d = abs(way) / -(way + c);
    const N e = a * b * d;
    const N first_x = way * a * a * d + 1.0, first_y = way * e, first_z = -way * a;
    const N second_x = e, second_y = way + b * b * d, second_z = -b;
    const N a1 = (first_x - right * first_z) * fx, a2 = (second_x - right * second_z) * fx;
    const N b1 = (first_y - down * first_z) * fy, b2 = (second_y - down * second_z) * fy;
    const N total = a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2;
    const N det = abs(a1 * b2 - a2 * b1);
    const N gap = total * total - (det * det) * 4.0;
    return det / (sqrt((total + sqrt(max(gap, N(0.0)))) / 2.0) * z);
}

// Pixels a metre along the worst direction of a target that faces the camera.
//
// The derivative is J = D (1 0 -x/z; 0 1 -y/z) / z, D = diag(fx, fy), and J p = 0 for the ray
// p = (x, y, z): restricted to the plane perpendicular to it, it has the singular values of
// J J^T = D (1 + q q^T) D / z^2 with q = (x/z, y/z), which is at least min(fx, fy)^2 / z^2. The
// result is min(fx, fy) / z: exact for fx = fy, and where q is along the axis of the greater one;
// a lower bound elsewhere.
template <class N> INLINE N facing(const Slopes<N> &slopes) {
    return min(slopes.fx, slopes.fy) / slopes.z;
}

// Pixels on a square metre of a surface with the unit normal (a, b, c): fx fy h / z^3,
// h = z |n . ray|.
template <class N> INLINE N per_m2(const Slopes<N> &slopes, N a, N b, N c) {
    const auto &[fx, fy, right, down, z] = slopes;
    return abs(a * right + b * down + c) / z * fx / z * fy;
}

// --- densities of any derivative ---

// Largest singular value of a derivative, by the products of its rows.
inline double largest_of(const CurvedSlopes &s) {
    const double uu = s.ux * s.ux + s.uy * s.uy + s.uz * s.uz;
    const double vv = s.vx * s.vx + s.vy * s.vy + s.vz * s.vz;
    const double uv = s.ux * s.vx + s.uy * s.vy + s.uz * s.vz;
    return std::sqrt(0.5 * (uu + vv + std::sqrt((uu - vv) * (uu - vv) + 4.0 * uv * uv)));
}

// Product of the rows of a derivative, along the ray.
inline Triple<double> cross_of(const CurvedSlopes &s) {
    return {s.uy * s.vz - s.uz * s.vy, s.uz * s.vx - s.ux * s.vz, s.ux * s.vy - s.uy * s.vx};
}

inline double per_m2(const CurvedSlopes &s, double a, double b, double c) {
    const auto [x, y, z] = cross_of(s);
    return std::abs(x * a + y * b + z * c);
}

// The product of both singular values in the plane over the greater one.
inline double along(const CurvedSlopes &s, double a, double b, double c) {
    // In the plane, without the part along its normal.
    const double un = s.ux * a + s.uy * b + s.uz * c, vn = s.vx * a + s.vy * b + s.vz * c;
    const double largest = largest_of(
        {s.ux - un * a, s.uy - un * b, s.uz - un * c, s.vx - vn * a, s.vy - vn * b, s.vz - vn * c});
    return largest > 0 ? per_m2(s, a, b, c) / largest : 0.0;
}

// J is 0 along the ray, so its least singular value is across.
inline double facing(const CurvedSlopes &s) {
    const auto [a, b, c] = cross_of(s);
    const double largest = largest_of(s);
    return largest > 0 ? std::sqrt(a * a + b * b + c * c) / largest : 0.0;
}

// A direction of the world, or the way from the camera, in the camera axes of a pose, or of the
// rotation of one.
template <class N, class Pose> INLINE Triple<N> rotate(const Triple<N> &way, const Pose &pose) {
    const auto &[x, y, z] = way;
    return {x * N(pose(0, 0)) + y * N(pose(1, 0)) + z * N(pose(2, 0)),
            x * N(pose(0, 1)) + y * N(pose(1, 1)) + z * N(pose(2, 1)),
            x * N(pose(0, 2)) + y * N(pose(1, 2)) + z * N(pose(2, 2))};
}

// Ray that a camera sees a point along, in the axes of the world, of any length: the way from the
// camera, or the axis of parallel rays.
template <class Camera, class Rotation>
Triple<double> ray_along(const Camera &, const Rotation &, const Triple<double> &way) {
    return way;
}
template <class Rotation>
Triple<double> ray_along(const ParallelLens &, const Rotation &rotation, const Triple<double> &) {
    return {rotation(0, 2), rotation(1, 2), rotation(2, 2)};
}
template <class Rotation>
Triple<double> ray_along(const CurvedLens &lens, const Rotation &rotation,
                         const Triple<double> &way) {
    return lens.is_parallel() ? ray_along(ParallelLens{}, rotation, way) : way;
}

} // namespace rastercov
