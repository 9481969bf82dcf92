// Faces that reach behind the camera or far out of the image, clipped in space.
//
// Where the camera centre lies on a face to the last digit, doubles do not determine the plane of
// the face through it; pairs of doubles do, with about 106 bits.
//
// Twins: tests/test_double_double.py, with fractions.
#pragma once
#include "exact/pairs.hpp"
#include "exact/polygon.hpp"
#include <tuple>

namespace rastercov::exact {

constexpr double INF = std::numeric_limits<double>::infinity();
// Largest rounding of a position in the image, relative to the largest number it is computed from;
// of 1/z, relative to the longest ray: some ten operations of 2^-53 each, of which not all err one
// way.
constexpr double UNIT_ROUNDING = 4 * 0x1p-52;
// Pixels of extent that may be wrong along the outline of a face, for each pixel of rounding and of
// width and height: its perimeter is twice their sum at most. One part for its own image, one for
// its visible part, one for corners that count as on a line, one for remainders that count as
// nothing.
constexpr double OUTLINE_ERROR_FACTOR = 8;
// Relative to the size of the image: faces that reach farther out than this and a pixel are clipped
// in space before they are projected.
constexpr double CLIP_MARGIN = 0.25;
// Relative error bound of the products of three vectors in pairs of doubles: 3 camera coordinates
// of 12 * 2^-106 each, and 8 operations of 5 * 2^-106.
constexpr double PAIR_ERROR_REL = 0x1p-98;
constexpr double UNDERFLOW_ERROR = 0x1p-1000; // more than products of numbers up to 2 lose to it
// A face is doubtful if its image has less than this many pixels of area for each pixel of extent
// and of rounding: (u1 - u0)(v2 - v0) - (u2 - u0)(v1 - v0) is twice the area, each difference is
// off by 2 roundings, and each side of the image is at most its extent.
constexpr double EDGE_ON_FACTOR = 4;
// Distance from an edge, in roundings of a position, that makes a point lie on one side of it.
constexpr double SURE = 16;
constexpr double W_ARITHMETIC_ERROR_REL = 1e-14; // of 1/z evaluated at the corner of a clipped face

// Corners of a face in camera axes, in pairs of doubles; or, of parallel rays, the points
// (x, y, 1), with w and the greatest distance from the origin that they come from.
struct Corners {
    Pair at[3][3];
    Pair w[3];
    double reach = 0.0;
};

inline void to_camera(Array<const double, 3> point, const Pinhole &camera, Pair *corner) {
    const Pair a = exact_sum(point[0], -camera.centre[0]);
    const Pair b = exact_sum(point[1], -camera.centre[1]);
    const Pair c = exact_sum(point[2], -camera.centre[2]);
    for (int k = 0; k < 3; k++) {
        const Pair x = a * Pair{camera.rotation(0, k), 0.0},
                   y = b * Pair{camera.rotation(1, k), 0.0};
        corner[k] = x + y + c * Pair{camera.rotation(2, k), 0.0};
    }
}

// Makes (x, y, 1) and w of corners in camera axes: w is affine on the face in the image as 1/z is.
inline void flatten(Corners &corners, const Pinhole &camera) {
    for (int s = 0; s < 3; s++) {
        auto &[x, y, z] = corners.at[s];
        corners.reach = std::max(corners.reach, length(x.high, y.high, z.high));
        corners.w[s] = Pair{camera.farthest, 0.0} + -z;
        z = {1.0, 0.0};
    }
}

// Normals of a face and of the planes through its edges and the camera centre: (p x q) . ray is
// positive for a ray on the inner side of edge p q. w is face . ray / d.
struct Normals {
    double side[3][3]; // p x q for each edge p q
    Pair face[3], d;
    double errors[5]; // the largest of the four, as vectors, and of d
};

// `underflow` is what that may have taken from the corners.
inline Normals normals_of_sides(const Corners &corners, const Pinhole &camera, double underflow) {
    Normals n = {};
    const auto &at = corners.at;
    const auto far = [&](int p) {
        return length(at[p][0].high, at[p][1].high, at[p][2].high) + corners.reach;
    };
    Pair d = {0.0, 0.0};
    for (int s = 0; s < 3; s++) {
        const int p = s, q = s < 2 ? s + 1 : 0;
        for (int k = 0; k < 3; k++) {
            const int i = k < 2 ? k + 1 : 0, j = k > 0 ? k - 1 : 2;
            const Pair x = minor_of(at[p][i], at[q][j], at[p][j], at[q][i]);
            n.side[s][k] = x.high;
            n.face[k] = n.face[k] + (camera.is_parallel() ? x * corners.w[s > 0 ? s - 1 : 2] : x);
            if (s == 1) d = d + at[0][k] * x; // d = a . (b x c)
        }
        n.errors[s] = PAIR_ERROR_REL * far(p) * far(q) + underflow;
    }
    n.d = d;
    n.errors[3] = n.errors[0] + n.errors[1] + n.errors[2];
    // w, and its error relative to PAIR_ERROR_REL, are at most the sum of both.
    if (camera.is_parallel()) n.errors[3] *= 2 * (camera.farthest + corners.reach);
    n.errors[4] = far(0) * n.errors[1] + underflow;
    return n;
}

// Visible side of a face that is out of sight, 1 or -1; 0 if it is not, or rounding decides.
//
// Out of sight: all of it before the near plane, or beyond one side of the image by CLIP_MARGIN,
// which is more than any rounding.
inline int8_t side_if_out_of_sight(Vertices vertices, const int64_t (&face)[3],
                                   const Pinhole &camera) {
    const auto &rotation = camera.rotation;
    const auto &eye = camera.centre;
    const double wide = CLIP_MARGIN * camera.width + 1, high = CLIP_MARGIN * camera.height + 1;
    bool before = true;
    bool left = true;
    bool right = true;
    bool above = true;
    bool below = true;
    double most = 0.0, corner[3][3];
    for (int s = 0; s < 3; s++) {
        auto &p = corner[s];
        for (int k = 0; k < 3; k++) p[k] = vertices(face[s], k) - eye[k];
        const auto along = [&](int k) {
            return p[0] * rotation(0, k) + p[1] * rotation(1, k) + p[2] * rotation(2, k);
        };
        const double u = camera.fx * along(0), v = camera.fy * along(1), depth = along(2);
        const double over = camera.divisor_at(depth);
        before = before && depth < camera.near;
        left = left && u + (camera.cx + wide) * over < 0;
        right = right && u + (camera.cx - camera.width - wide) * over > 0;
        above = above && v + (camera.cy + high) * over < 0;
        below = below && v + (camera.cy - camera.height - high) * over > 0;
        most = std::max(most, std::abs(p[0]) + std::abs(p[1]) + std::abs(p[2]));
    }
    if (!(before || left || right || above || below)) return 0;
    // a . ((b - a) x (c - a)) is negative for the front, and so is that of a parallel ray for a.
    auto &[a, b, c] = corner;
    for (int k = 0; k < 3; k++) {
        b[k] -= a[k];
        c[k] -= a[k];
    }
    const double nx = b[1] * c[2] - b[2] * c[1], ny = b[2] * c[0] - b[0] * c[2],
                 nz = b[0] * c[1] - b[1] * c[0];
    double ray[3] = {a[0], a[1], a[2]};
    double far = most;
    if (camera.is_parallel()) {
        for (int k = 0; k < 3; k++) ray[k] = rotation(k, 2);
        far = 2.0;
    }
    const double d = nx * ray[0] + ny * ray[1] + nz * ray[2];
    const double reach_b = std::abs(b[0]) + std::abs(b[1]) + std::abs(b[2]);
    const double reach_c = std::abs(c[0]) + std::abs(c[1]) + std::abs(c[2]);
    if (!(std::abs(d) > UNIT_ROUNDING * far * (reach_b * reach_c + most * (reach_b + reach_c))))
        return 0;
    return d > 0 ? -1 : 1;
}

// Image of a face that is clipped in space: lines with their errors in pixels that bound it, 1/z as
// in Clipped.planes, at the principal point, and the polygon, clockwise.
struct ClippedFace {
    double lines[SIDES * 6], plane[7], polygon[CORNERS * 2], spare[CORNERS * 2];
    Array<double, Any, 6> sides() { return {lines, {SIDES, 6}}; }
    Points corners() { return {polygon, {CORNERS, 2}}; }
    Points scratch() { return {spare, {CORNERS, 2}}; }
};

struct Side {
    int64_t n; // corners of its image, 0 for none; negative if only lines moved outwards by their
               // errors leave that many: the image rounds to nothing
    int8_t front; // 1 or -1 for the front or the back, 0 if rounding decides
};

// Clips the image to the inner side of all lines; returns its corner count.
inline int64_t image_within(const Pinhole &camera, ClippedFace &face) {
    const Points polygon = face.corners();
    const double corners[4][2] = {
        {0.0, 0.0}, {camera.width, 0.0}, {camera.width, camera.height}, {0.0, camera.height}};
    for (int p = 0; p < 4; p++) {
        polygon(p, U) = corners[p][0];
        polygon(p, V) = corners[p][1];
    }
    return clip(polygon, 4, face.sides(), SIDES, face.scratch());
}

// Depth of the near plane, and how far the image extends from the principal point, pixels.
struct Field {
    double near, across, down;
};

// Fills in the plane of 1/z of a face, without errors, and the lines that bound its image.
inline void lay_lines(const Normals &normals, const Pinhole &camera, const Field &field,
                      ClippedFace &out) {
    const double d = normals.d.high;
    const int inwards = d < 0 ? -1 : 1;
    auto &plane = out.plane;
    const auto sides = out.sides();
    plane[U] = camera.cx;
    plane[V] = camera.cy;
    plane[W] = normals.face[2].high / d;
    plane[SLOPE_U] = normals.face[0].high / d / camera.fx;
    plane[SLOPE_V] = normals.face[1].high / d / camera.fy;
    for (int s = 0; s < SIDES; s++) {
        double a, b, c, error;
        if (s < 3) {
            const auto &n = normals.side[s];
            a = n[0] / camera.fx * inwards;
            b = n[1] / camera.fy * inwards;
            c = n[2] * inwards;
            error = normals.errors[s] * camera.longest_ray;
        } else {
            a = -plane[SLOPE_U];
            b = -plane[SLOPE_V];
            c = 1 / field.near - plane[W];
            error = (normals.errors[3] * camera.longest_ray + normals.errors[4] / field.near) /
                    std::abs(d);
            error += UNIT_ROUNDING * (1 / field.near + std::abs(plane[W]));
        }
        error +=
            UNIT_ROUNDING * (std::abs(a) * field.across + std::abs(b) * field.down + std::abs(c));
        const double scale = std::max(std::abs(a), std::abs(b));
        if (scale > 0) {
            a /= scale;
            b /= scale;
            c /= scale;
            error /= scale;
        }
        sides(s, U) = camera.cx;
        sides(s, V) = camera.cy;
        sides(s, DU) = b;
        sides(s, DV) = -a;
        sides(s, OFFSET) = c;
        sides(s, LINE_ERROR) = error;
    }
}

// Clips a face to the near plane and the image. Nothing is projected: a side of the image is the
// plane through the camera centre and an edge of the face, and the near plane is the line in the
// image where 1/z = 1/near. The camera centre may lie on the face or on an edge of it, so planes
// are computed in pairs of doubles. The corners are scaled in place.
inline Side clip_in_space(Corners &corners, const Pinhole &camera, ClippedFace &out) {
    // In units of the face's own reach, so that no product under- or overflows; a power of two, so
    // that nothing is rounded.
    double reach = 0.0;
    for (const auto &corner : corners.at)
        for (const Pair &x : corner) reach = std::max(reach, std::abs(x.high));
    reach = camera.is_parallel() ? 1.0 : std::exp2(std::floor(std::log2(reach)));
    if (!(reach > 0 && std::isfinite(1 / reach))) return {0, 0};
    for (auto &corner : corners.at)
        for (Pair &x : corner) x = {x.high / reach, x.low / reach};
    const double near = camera.near_depth() / reach;
    const auto &at = corners.at;
    const bool is_before =
        std::max(std::max(at[0][2].high, at[1][2].high), at[2][2].high) < camera.near / reach;
    if (camera.is_parallel()) flatten(corners, camera);
    // The plane n . X = d of the face: 1/z is n . ((u - cx)/fx, (v - cy)/fy, 1) / d.
    const Normals normals =
        normals_of_sides(corners, camera, UNDERFLOW_ERROR * std::max(1.0, 1 / reach));
    const double d = normals.d.high;
    const auto &errors = normals.errors;
    if (!(std::abs(d) > errors[4])) return {0, 0};
    const int8_t front = d < 0 ? 1 : -1;
    if (is_before) return {0, front};
    const double spread = camera.longest_ray;
    const Field field = {near, std::max(std::abs(camera.cx), std::abs(camera.width - camera.cx)),
                         std::max(std::abs(camera.cy), std::abs(camera.height - camera.cy))};
    auto &plane = out.plane;
    const auto sides = out.sides();
    lay_lines(normals, camera, field, out);
    int64_t n = image_within(camera, out);
    if (n < 3) {
        for (int s = 0; s < SIDES; s++) sides(s, OFFSET) += sides(s, LINE_ERROR);
        n = -image_within(camera, out);
        if (n > -3) return {0, front};
    }
    // Only lines that touch its image matter, and 1/z within it.
    const Points polygon = out.corners();
    double most = plane[OUTLINE_ERROR] = 0.0;
    for (int s = 0; s < SIDES; s++)
        for (int64_t p = 0; p < std::abs(n); p++) {
            const double u = polygon(p, U) - sides(s, U), v = polygon(p, V) - sides(s, V);
            if (sides(s, DU) * v - sides(s, DV) * u + sides(s, OFFSET) <= sides(s, LINE_ERROR))
                plane[OUTLINE_ERROR] = std::max(plane[OUTLINE_ERROR], sides(s, LINE_ERROR));
            most = std::max(most, plane[W] + plane[SLOPE_U] * u + plane[SLOPE_V] * v);
        }
    plane[W_ERROR] = (errors[3] * spread + errors[4] * std::min(most, 1 / near)) / std::abs(d);
    plane[W_ERROR] +=
        UNIT_ROUNDING * (std::abs(plane[W]) + std::abs(plane[SLOPE_U]) * field.across +
                         std::abs(plane[SLOPE_V]) * field.down);
    for (int k = W; k <= W_ERROR; k++) plane[k] /= reach;
    return {n, front};
}

struct Box {
    double u_min, u_max, v_min, v_max, w_min, w_max;
};

inline Box bounds_of_clipped(ClippedFace &face, int64_t n) {
    double w_min = INF;
    double w_max = -INF;
    const Points polygon = face.corners();
    const Plane plane = plane_in(face.plane);
    for (int64_t p = 0; p < n; p++) {
        const auto [w, size] = plane.at(polygon(p, U), polygon(p, V));
        const double error = plane.error + W_ARITHMETIC_ERROR_REL * size;
        w_min = std::min(w_min, w - error);
        w_max = std::max(w_max, w + error);
    }
    const Bounds b = extent_of(polygon, n);
    return {b.u_min, b.u_max, b.v_min, b.v_max, std::max(w_min, 0.0), w_max};
}

// Copies a clipped face to row s.
inline void store_clipped(const Clipped &clipped, int64_t s, ClippedFace &face, int64_t n) {
    clipped.n_corners[s] = int32_t(std::max(n, int64_t(0)));
    copy_polygon(face.corners(), n, clipped.polygons[s]);
    for (int q = 0; q < SIDES; q++)
        for (int column = 0; column <= OFFSET; column++)
            clipped.lines(s, q, column) = face.sides()(q, column);
    for (int column = 0; column <= OUTLINE_ERROR; column++)
        clipped.planes(s, column) = face.plane[column];
}

} // namespace rastercov::exact
