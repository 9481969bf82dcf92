// Clipping of faces at the near plane and at the guard band.
//
// A cut is always computed from the corner inside to the corner outside, so two faces that share an
// edge cut it at the same point, bit for bit.
// I. Sutherland and G. Hodgman. Reentrant Polygon Clipping. 1974.
//
// Twin: tests/raster/test_cpu.py, by whole numbers.
#pragma once
#include "raster/records.hpp"
#include <algorithm>
#include <tuple>

namespace rastercov::raster {

// Samples from the origin of the canvas beyond which faces are clipped, by the steps of each.
INLINE double reach_of(int steps) { return 0.99 * GUARD_BAND / steps; }

// A convex polygon in camera axes.
struct Polygon {
    double corners[CLIP_CORNERS][3];
    int n = 0;
};
// fx, fy and cx, cy in samples.
struct Lens {
    double focal[2], centre[2];
};
INLINE Lens lens_of(const Camera &camera) {
    return {{camera.fx, camera.fy}, {camera.cx, camera.cy}};
}

// Makes (x, y, 1) / w of a face in camera axes, w = farthest - z, which a pinhole sees where
// parallel rays see the face, with the same w.
inline void make_central(Polygon &face, double farthest) {
    for (int i = 0; i < face.n; i++) {
        auto &[x, y, z] = face.corners[i];
        z = 1.0 / (farthest - z);
        x *= z;
        y *= z;
    }
}

// The whole step that is nearest; of any value where 32 bits do not hold it.
INLINE int32_t to_step(double position) {
    const double step = std::floor(position + 0.5);
    return std::abs(step) <= GUARD_BAND ? int32_t(step) : 0;
}

// The part of a polygon where normal . p >= offset.
inline Polygon clip(const Polygon &in, const double (&normal)[3], double offset) {
    const auto height = [&](int i) {
        const auto &[x, y, z] = in.corners[i];
        return normal[0] * x + normal[1] * y + normal[2] * z - offset;
    };
    Polygon out;
    for (int i = 0; i < in.n; i++) {
        const int j = i + 1 < in.n ? i + 1 : 0;
        const double here = height(i), there = height(j);
        if (here >= 0) {
            if (out.n == CLIP_CORNERS) return out;
            std::copy_n(in.corners[i], 3, out.corners[out.n++]);
        }
        if ((here >= 0) != (there >= 0)) {
            if (out.n == CLIP_CORNERS) return out;
            const auto &p = in.corners[here >= 0 ? i : j], &q = in.corners[here >= 0 ? j : i];
            const double inside = here >= 0 ? here : there, beyond = here >= 0 ? there : here;
            const double t = inside / (inside - beyond);
            for (int k = 0; k < 3; k++) out.corners[out.n][k] = p[k] + t * (q[k] - p[k]);
            out.n++;
        }
    }
    return out;
}
// Place of a corner in steps, and 1/z.
struct Place {
    double u, v, w;
};
inline Place image_of(const double (&corner)[3], const Lens &lens, int steps) {
    const double w = 1.0 / corner[2];
    return {(lens.focal[0] * corner[0] * w + lens.centre[0]) * steps,
            (lens.focal[1] * corner[1] * w + lens.centre[1]) * steps, w};
}
// The part beyond the near plane.
inline Polygon clip_to_near(const Polygon &in, double near) { return clip(in, {0, 0, 1}, near); }

// The part with |u| and |v| of at most reach_of(steps) samples.
inline Polygon clip_to_guard_band(const Polygon &in, const Lens &lens, int steps) {
    const double reach = reach_of(steps);
    bool is_far = false;
    for (int axis = 0; axis < 2; axis++)
        for (int i = 0; i < in.n; i++) {
            const auto &p = in.corners[i];
            const double position = lens.focal[axis] * p[axis] + lens.centre[axis] * p[2];
            is_far |= std::abs(position) > reach * p[2];
        }
    Polygon out = in;
    for (int side = 0; side < (is_far ? 4 : 0); side++) {
        // |u| <= reach, |v| <= reach: +-(f x + c z) <= reach z
        const double sign = 1.0 - 2.0 * (side & 1);
        const int axis = side >> 1;
        double normal[3] = {0.0, 0.0, sign * lens.centre[axis] + reach};
        normal[axis] = sign * lens.focal[axis];
        out = clip(out, normal, 0.0);
    }
    return out;
}

// Plane of 1/z of a face with these corners, not finite where it contains the camera centre.
//
// 1/z = n . r / (n . a) is affine in the image. Corners of a face cut at the near plane can be much
// nearer than the part in camera that a plane through them has lost half of its digits.
inline Plane plane_of(const Polygon &face, const Lens &lens) {
    const auto &[a, b, c] = std::tie(face.corners[0], face.corners[1], face.corners[2]);
    const double ab_x = b[0] - a[0], ab_y = b[1] - a[1], ab_z = b[2] - a[2];
    const double ac_x = c[0] - a[0], ac_y = c[1] - a[1], ac_z = c[2] - a[2];
    const double x = ab_y * ac_z - ab_z * ac_y, y = ab_z * ac_x - ab_x * ac_z;
    const double z = ab_x * ac_y - ab_y * ac_x, height = x * a[0] + y * a[1] + z * a[2];
    const double slope_x = x / (height * lens.focal[0]), slope_y = y / (height * lens.focal[1]);
    const double origin =
        z / height + slope_x * (0.5 - lens.centre[0]) + slope_y * (0.5 - lens.centre[1]);
    return {origin, slope_x, slope_y};
}
INLINE bool is_finite(const Plane &plane) {
    return std::isfinite(plane.origin) && std::isfinite(plane.slope_x) &&
           std::isfinite(plane.slope_y);
}

// Triangles that are left of a clipped face: their corners follow the vertices of the cluster, and
// with the face they are in slots 0 and on. And the plane of the whole face.
struct Fan {
    alignas(CACHE_LINE) int32_t corners[FACES], faces[FACES];
    int n;
    Plane plane;
};

// Clips the face in a slot to the half space beyond the near plane and to the guard band.
inline void clip_and_triangulate(const Clusters &clusters, const Cluster &cluster, int64_t slot,
                                 const Camera &camera, const Window &window, Vertices &vertices,
                                 Fan &fan) {
    const int64_t stride = cluster.end_vertex - cluster.first_vertex;
    const Lens lens = lens_of(camera);
    const int32_t packed = clusters.corners[slot];
    Polygon face;
    face.n = 3;
    for (int i = 0; i < 3; i++) {
        const int64_t at = 3 * cluster.first_vertex + (packed >> 8 * i & (BUFFER_SIZE - 1));
        const double x = clusters.points[at] - camera.eye[0];
        const double y = clusters.points[at + stride] - camera.eye[1];
        const double z = clusters.points[at + 2 * stride] - camera.eye[2];
        const double *axes = camera.axes;
        for (int k = 0; k < 3; k++)
            face.corners[i][k] = x * axes[k] + y * axes[3 + k] + z * axes[6 + k];
    }
    double near = camera.near;
    if (camera.is_parallel()) {
        make_central(face, camera.farthest);
        near = 1.0 / (camera.farthest - near);
    }
    fan.plane = plane_of(face, lens);
    fan.n = 0;
    Polygon part = clip_to_near(face, near);
    // Beyond the border of the window nothing covers a sample.
    const double lows[2] = {0.0, double(window.top)};
    const double highs[2] = {window.right + 1.0, window.bottom + 1.0};
    for (int axis = 0; axis < 2; axis++) {
        int n_below = 0;
        int n_above = 0;
        for (int i = 0; i < part.n; i++) {
            const auto &p = part.corners[i];
            const double position = lens.focal[axis] * p[axis] + lens.centre[axis] * p[2];
            n_below += position<lows[axis] * p[2], n_above += position> highs[axis] * p[2];
        }
        if (n_below == part.n || n_above == part.n) return;
    }
    const int steps = 1 << window.step_bits();
    part = clip_to_guard_band(part, lens, steps);
    for (int i = 0; i < part.n; i++) {
        const auto [u, v, w] = image_of(part.corners[i], lens, steps);
        const int at = VERTICES + i;
        vertices.u[at] = u;
        vertices.v[at] = v;
        vertices.w[at] = w;
        vertices.places.put(at, to_step(u), to_step(v));
    }
    for (int k = 0; k < part.n - 2; k++) {
        fan.corners[k] = VERTICES | (VERTICES + k + 1) << 8 | (VERTICES + k + 2) << 16;
        fan.faces[k] = clusters.faces[slot];
    }
    fan.n = std::max(part.n - 2, 0);
}

} // namespace rastercov::raster
