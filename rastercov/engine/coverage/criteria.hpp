// Criteria of faces that follow from geometry: (3.7), (3.9), and ours.
//
// project transforms the vertices of a pose; the other functions measure one face, or the faces in
// lanes, by the rows that project leaves. What is a template over the number has the same order of
// operations for both.
//
// I. Sutherland, G. Hodgman. Reentrant Polygon Clipping. 1974.
//
// Twins: rastercov.reference.coverage.
#pragma once
#include "coverage/decision.hpp"
#include "exact/polygon.hpp"
#include <numbers>

namespace rastercov::coverage {

// Columns of a projected vertex: camera axes, metres; x/z and y/z, for a pinhole; pixels; and the
// state.
enum { X, Y, Z, RIGHT, DOWN, U, V, STATE };
constexpr int COLUMNS = 8;
// States: before the near plane, or outside the valid region of the lens; beyond it; beyond it and
// inside the image.
constexpr double BEHIND = 0.0, AHEAD = 1.0, INSIDE = 2.0;

// Corners of a face after five cuts: n corners have c crossings, c even and at most n, and keep at
// most n - c/2 of themselves, so that n becomes n + c/2 at most: 3, 4, 6, 9, 13, 19.
constexpr int64_t MOST_CORNERS = 20;

using Pose = Array<const double, 4, 4>; // world_from_camera
using Indices = std::array<int64_t, 3>; // vertices of a face
template <class N> using Vertex = std::array<N, COLUMNS>;
template <class N> using Corners = std::array<Vertex<N>, 3>;

// Projected vertices, one a row, as they lie in memory; other lenses have more columns.
template <class Camera> constexpr int64_t COLUMNS_OF = COLUMNS;
template <class Camera> using VertexRows = Array<double, Any, COLUMNS_OF<Camera>>;

// What the image of a face needs beside them; other lenses need some.
template <class Camera> struct Memory {};

// Vertices in the axes of a camera.
template <class N> INLINE Triple<N> to_axes(const Triple<N> &vertex, Pose pose) {
    const Triple<N> way = {vertex.x - N(pose(0, 3)), vertex.y - N(pose(1, 3)),
                           vertex.z - N(pose(2, 3))};
    return rotate(way, pose);
}

template <class N> INLINE N state_of(Mask<N> is_ahead, N u, N v, const Lens &lens) {
    const Mask<N> is_inside =
        is_ahead & (u >= N(0.0)) & (u <= N(lens.width)) & (v >= N(0.0)) & (v <= N(lens.height));
    return select(is_inside, N(INSIDE), select(is_ahead, N(AHEAD), N(BEHIND)));
}
// Columns of projected vertices. Those before the near plane have the image of a point on the
// optical axis, which nothing uses.
template <class N>
INLINE Vertex<N> projected(const Triple<N> &vertex, Pose pose, double near, const Lens &lens) {
    const auto [x, y, z] = to_axes(vertex, pose);
    const Mask<N> is_ahead = z >= N(near);
    const N depth = select(is_ahead, z, N(1.0));
    const N right = select(is_ahead, x, N(0.0)) / depth, down = select(is_ahead, y, N(0.0)) / depth;
    const N u = right * N(lens.fx) + N(lens.cx), v = down * N(lens.fy) + N(lens.cy);
    return {x, y, z, right, down, u, v, state_of(is_ahead, u, v, lens)};
}
template <class N>
INLINE Vertex<N> projected(const Triple<N> &vertex, Pose pose, double near,
                           const ParallelLens &lens) {
    const Lens &of = lens.scale;
    const auto [x, y, z] = to_axes(vertex, pose);
    const N u = N(of.fx) * x + N(of.cx), v = N(of.fy) * y + N(of.cy), none = NAN;
    return {x, y, z, none, none, u, v, state_of(z >= N(near), u, v, of)};
}

// Those of another lens have no state yet: many are only of faces that are never measured.
template <class N>
INLINE Vertex<N> projected(const Triple<N> &vertex, Pose pose, double, const CurvedLens &) {
    const auto [x, y, z] = to_axes(vertex, pose);
    const N none = NAN;
    return {x, y, z, none, none, none, none, none};
}

// Transforms the vertices to camera axes and projects those beyond the near plane.
template <class Camera>
void project(FloatRows<3> vertices, Pose pose, double near, const Camera &lens,
             VertexRows<Camera> points) {
    constexpr int W = AT_A_TIME<Doubles>;
    constexpr int64_t C = COLUMNS_OF<Camera>;
    // Those of other lenses are one after another: engine.wasm is smaller by 900 bytes.
    const int64_t n = vertices.rows(), whole = C == COLUMNS ? n / W * W : 0;
    const double *from = vertices.begin();
    double *to = points.begin();
    for (int64_t i = 0; i < whole; i += W) {
        const auto columns = projected(read_triple<Doubles>(from + 3 * i), pose, near, lens);
        unroll<COLUMNS / W>(EACH(part) {
            Register<double> rows[AT_A_TIME<Doubles>];
            unroll<W>(EACH(k) { rows[k] = columns[part * W + k].r[0]; });
            transpose<double>(rows);
            unroll<W>(
                EACH(k) { std::memcpy(to + (i + k) * C + part * W, &rows[k], sizeof rows[k]); });
        });
    }
    for (int64_t i = whole; i < n; i++) {
        const auto columns = projected(read_triple<double>(from + 3 * i), pose, near, lens);
        std::copy(columns.begin(), columns.end(), to + i * C);
    }
}

// What the vertices of a face need before it is measured, alone: nothing but of other lenses.
template <class Camera> void finish(const uint64_t *, double, const Camera &, VertexRows<Camera>) {}

// Columns of the vertices of faces, by rows of three indices.
template <class N, int64_t C>
INLINE Corners<N> corners_of(const uint64_t *faces, Array<double, Any, C> points) {
    Corners<N> found;
    constexpr int W = AT_A_TIME<N>;
    const auto fill = EACH(s) {
        if constexpr (W == 1) {
            const double *row = points.begin() + C * int64_t(faces[s]);
            unroll<COLUMNS>(EACH(k) { found[s][k] = row[k]; });
        } else {
            unroll<COLUMNS / W>(EACH(part) {
                Register<double> rows[AT_A_TIME<N>];
                unroll<W>(EACH(k) {
                    const double *row = points.begin() + C * int64_t(faces[3 * k + s]);
                    std::memcpy(&rows[k], row + part * W, sizeof rows[k]);
                });
                transpose<double>(rows);
                unroll<W>(EACH(k) { found[s][part * W + k].r[0] = rows[k]; });
            });
        }
    };
    unroll<3>(fill);
    return found;
}

// Column of the three vertices, as three numbers.
template <class N> INLINE std::array<N, 3> column(const Corners<N> &corners, int k) {
    return {corners[0][k], corners[1][k], corners[2][k]};
}
template <class N> INLINE N min3(const std::array<N, 3> &a) { return min(min(a[0], a[1]), a[2]); }
template <class N> INLINE N max3(const std::array<N, 3> &a) { return max(max(a[0], a[1]), a[2]); }
template <class N> INLINE N sum3(const std::array<N, 3> &a) { return a[0] + a[1] + a[2]; }

// Three times the centroid of a face, in camera axes.
template <class N> INLINE Triple<N> corner_sums(const Corners<N> &corners) {
    return {sum3(column(corners, X)), sum3(column(corners, Y)), sum3(column(corners, Z))};
}
template <class N> INLINE N length(const Triple<N> &a) {
    return sqrt(a.x * a.x + a.y * a.y + a.z * a.z);
}

// Cosine between the normal and the ray from the centroid to the camera centre.
//
// In camera axes the ray is minus the centroid itself, and three times that has its direction.
template <class N, class Camera>
INLINE N incidence_cosine(const Corners<N> &corners, const Triple<N> &normal, Mask<N> is_two_sided,
                          const Camera &) {
    const Triple<N> sums = corner_sums(corners);
    const N against = -(normal.x * sums.x + normal.y * sums.y + normal.z * sums.z);
    const N reach = length(sums);
    const N cosine = select(reach > N(0.0), against / reach, N(0.0));
    return select(is_two_sided, abs(cosine), cosine);
}

template <class N>
INLINE N incidence_cosine(const Corners<N> &, const Triple<N> &normal, Mask<N> is_two_sided,
                          const ParallelLens &) {
    return select(is_two_sided, abs(normal.z), -normal.z);
}
template <class N>
INLINE N incidence_cosine(const Corners<N> &corners, const Triple<N> &normal, Mask<N> is_two_sided,
                          const CurvedLens &lens) {
    if (lens.is_parallel()) return incidence_cosine(corners, normal, is_two_sided, ParallelLens{});
    return incidence_cosine(corners, normal, is_two_sided, Lens{});
}

// Chebyshev fit of (arcsin(s) / s - 1) / s^2 by powers of s^2 up to 1/4; error 1.5e-17.
constexpr std::array ARCSINE = {
    0.16666666666666669,  0.07499999999998433,  0.04464285714635543,  0.030381944138531247,
    0.02237217294214989,  0.017352392720869973, 0.013971212973552933, 0.011479177415184906,
    0.01032281435018578,  0.005457506718640358, 0.01740087944269402,  -0.014851887071247204,
    0.028757851367421566,
};

// Angle of incidence, radians: the arccosine, within an ulp.
//
// By arcsin s with s = |cosine| up to 1/2 and s = sin(angle / 2) beyond, without branches.
template <class N> INLINE N incidence_angle(N cosine) {
    const N size = min(N(1.0), abs(cosine));
    const Mask<N> is_small = size <= N(0.5);
    const N x = select(is_small, size * size, N(0.5) * (N(1.0) - size));
    const N s = select(is_small, size, sqrt(x));
    N series = ARCSINE.back();
    for (int k = int(ARCSINE.size()) - 2; k >= 0; k--) series = N(ARCSINE[k]) + x * series;
    N angle = s + s * (x * series);
    angle = select(cosine < N(0.0), -angle, angle);
    constexpr double PI = std::numbers::pi;
    return select(is_small, N(PI / 2) - angle,
                  select(cosine >= N(0.0), N(0.0), N(PI)) + N(2.0) * angle);
}

constexpr double COSINE_ROUNDING = 1e-14; // of a cosine, and of the cosine of its arccosine

// True if the angle of incidence is greater than the task allows. The arccosine takes long, so
// cosines decide, except where they are equal to rounding.
template <class N> INLINE Mask<N> exceeds_incidence(N cosine, const Rules &rules) {
    const Mask<N> exceeds = cosine < N(rules.cos_incidence);
    const Mask<N> is_unclear = abs(cosine - N(rules.cos_incidence)) < N(COSINE_ROUNDING);
    if (!any(is_unclear)) return exceeds;
    const Mask<N> by_angle = !(incidence_angle(cosine) <= N(rules.max_incidence));
    return (is_unclear & by_angle) | (exceeds & !is_unclear);
}

// Area of the image of a face wholly beyond the near plane of a pinhole, px^2, (3.9).
template <class N> INLINE N area_ahead(const Corners<N> &corners) {
    const auto [u0, u1, u2] = column(corners, U);
    const auto [v0, v1, v2] = column(corners, V);
    return abs((u1 - u0) * (v2 - v1) - (v1 - v0) * (u2 - u1)) / N(2.0);
}

// Length of the outline of a face beyond the near plane, px.
template <class N> INLINE N perimeter(const Corners<N> &corners) {
    N total = 0.0;
    for (int s = 0; s < 3; s++) {
        const auto &p = corners[s], &q = corners[s == 2 ? 0 : s + 1];
        const N u = q[U] - p[U], v = q[V] - p[V];
        total = total + sqrt(u * u + v * v);
    }
    return total;
}

// A polygon on the stack.
struct Polygon {
    double corners[MOST_CORNERS][2];
    exact::Points view() { return {&corners[0][0], {MOST_CORNERS, 2}}; }
};

// The image of a camera without distortion, and what its points are divided by.
inline const Lens &image_of(const Lens &lens) { return lens; }
inline const Lens &image_of(const ParallelLens &lens) { return lens.scale; }
inline double divisor_of(const Lens &, double z) { return z; }
inline double divisor_of(const ParallelLens &, double) { return 1.0; }

// Fills `polygon` with the image of a face beyond the near plane; its corner count.
template <class Camera>
int64_t image_beyond(const Corners<double> &corners, double near, const Camera &camera,
                     exact::Points polygon) {
    const Lens &lens = image_of(camera);
    int64_t n = 0;
    const auto put = [&](double x, double y, double z) {
        const double over = divisor_of(camera, z);
        polygon(n, 0) = x / over * lens.fx + lens.cx;
        polygon(n, 1) = y / over * lens.fy + lens.cy;
        n++;
    };
    for (int s = 0; s < 3; s++) {
        const auto &p = corners[s], &q = corners[s == 2 ? 0 : s + 1];
        const double here = p[Z] - near, there = q[Z] - near;
        if (here >= 0) put(p[X], p[Y], p[Z]);
        if ((here >= 0) != (there >= 0)) {
            const double t = here / (here - there);
            put(p[X] + t * (q[X] - p[X]), p[Y] + t * (q[Y] - p[Y]), p[Z] + t * (q[Z] - p[Z]));
        }
    }
    return n;
}

// Cuts a polygon in place to the image grown by a margin, px; its corner count.
inline int64_t cut_to_image(exact::Points polygon, int64_t n, const Lens &lens, double margin) {
    Polygon spare;
    const exact::Points other = spare.view();
    n = exact::keep_inside(polygon, n, exact::Line{-margin, 0.0, 0.0, -1.0, 0.0}, other);
    n = exact::keep_inside(other, n, exact::Line{lens.width + margin, 0.0, 0.0, 1.0, 0.0}, polygon);
    n = exact::keep_inside(polygon, n, exact::Line{0.0, -margin, 1.0, 0.0, 0.0}, other);
    return exact::keep_inside(other, n, exact::Line{0.0, lens.height + margin, -1.0, 0.0, 0.0},
                              polygon);
}

// Field of view of a face: state of its worst vertex, part of its area in the image, and the area,
// px^2, of what is beyond the near plane, (3.9). Where `is_cut`, by the near plane or the border of
// the image, part and area are not known.
template <class N> struct FieldOfView {
    N state, part, area;
    Mask<N> is_cut;
};

// True for faces, all ahead, of which the image lies beyond one side of the image grown by a
// margin, px.
template <class N> INLINE Mask<N> is_beside(const Corners<N> &corners, const Lens &lens, N margin) {
    const auto u = column(corners, U), v = column(corners, V);
    return (max3(u) <= -margin) | (min3(u) >= N(lens.width) + margin) | (max3(v) <= -margin) |
           (min3(v) >= N(lens.height) + margin);
}

template <class N, class Camera>
INLINE FieldOfView<N> quick_field_of_view(const Corners<N> &corners, double, const Camera &camera) {
    const Lens &lens = image_of(camera);
    const auto states = column(corners, STATE);
    const N worst = min3(states), area = area_ahead(corners);
    const Mask<N> is_ahead = worst > N(BEHIND), is_inside = worst == N(INSIDE);
    const Mask<N> has_image = is_ahead & (area > N(0.0));
    const N part = select(has_image & is_inside, N(1.0), N(0.0));
    if (all(is_inside)) return {worst, part, area, !is_inside};
    const Mask<N> is_cut =
        select(is_ahead, has_image & !(is_inside | is_beside(corners, lens, N(0.0))),
               max3(states) > N(BEHIND));
    return {worst, part, select(is_ahead, area, N(0.0)), is_cut};
}

template <class Camera>
FieldOfView<double> field_of_view(const Corners<double> &corners, double near, const Camera &camera,
                                  Memory<Camera> &, double) {
    const Lens &lens = image_of(camera);
    FieldOfView<double> field = quick_field_of_view(corners, near, camera);
    if (!field.is_cut) return field;
    Polygon memory;
    const exact::Points polygon = memory.view();
    const auto area_of = [&](int64_t n) {
        return n >= 3 ? std::abs(exact::twice_area(polygon, n) / 2) : 0.0;
    };
    const int64_t n = image_beyond(corners, near, camera, polygon);
    field.area = area_of(n);
    const double shown = area_of(cut_to_image(polygon, n, lens, 0.0));
    const double part = field.area > 0 ? shown / field.area : 0.0;
    field.part = part > 1 ? 1.0 : part;
    return field;
}

// Depth of a point that its sharpness depends on, metres.
template <class N, class Camera> INLINE N focus_depth_of(const Triple<N> &at, const Camera &) {
    return at.z;
}
template <class N> INLINE N focus_depth_of(const Triple<N> &at, const CurvedLens &lens) {
    return lens.by_distance ? length(at) : at.z;
}

// True if faces are within the depth of field, (3.12), by the rule of the task.
template <class N, class Camera>
INLINE Mask<N> in_focus(const Corners<N> &corners, const Camera &camera, const Rules &rules) {
    std::array<N, 3> depth;
    for (int s = 0; s < 3; s++) {
        const auto &at = corners[s];
        depth[s] = focus_depth_of(Triple<N>{at[X], at[Y], at[Z]}, camera);
    }
    if (rules.focus_of_centroid) depth.fill(focus_depth_of(corner_sums(corners), camera) / N(3.0));
    return (N(rules.z_n) <= min3(depth)) & (max3(depth) <= N(rules.z_f));
}

} // namespace rastercov::coverage
