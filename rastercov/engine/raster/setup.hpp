// Stage 4 of the CPU rasteriser: edge functions and depth planes of a vector of triangles.
//
// Edge functions are exact integers, in 32 bits up to LARGE steps, else in 64. 1/z is affine in the
// image: w = w_a + slope . (position - a).
// J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/records.hpp"

namespace rastercov::raster {

// Corners of a vector of triangles, in whole steps.
template <class E> struct Places {
    Vec<E> x[3], y[3];
};
// The samples that they reach, and their width and height in steps.
template <class E> struct Bounds {
    Vec<E> first_x, last_x, first_y, last_y, width, height;
};
// Value at a sample, and its steps to the next column and row.
template <class E> struct Edge {
    Vec<E> value, dx, dy;
};

// Corners of the faces in LANES words. Those in 32 bits are vertices of a cluster; triangles in 64
// may be the result of clipping and have corners behind these.
template <class E> constexpr bool IN_CLUSTER = sizeof(E) == 4;

template <class E> INLINE Places<E> places_of(const int32_t *packed, const Vertices &vertices) {
    Places<E> p;
    const auto place = [&](auto k) __attribute__((always_inline)) {
        Int x, y;
        vertices.places.find<IN_CLUSTER<E>, k>(packed, x, y);
        p.x[k] = to<E>(x);
        p.y[k] = to<E>(y);
    };
    unroll<3>(place);
    return p;
}
template <class T> INLINE Vec<T> least_of(const Vec<T> (&a)[3]) {
    return min<T>(min<T>(a[0], a[1]), a[2]);
}
template <class T> INLINE Vec<T> greatest_of(const Vec<T> (&a)[3]) {
    return max<T>(max<T>(a[0], a[1]), a[2]);
}

template <class E> INLINE Bounds<E> sample_bounds(const Places<E> &p, const Window &window) {
    using V = Vec<E>;
    const V low_x = least_of(p.x), high_x = greatest_of(p.x);
    const V low_y = least_of(p.y), high_y = greatest_of(p.y);
    const int shift = window.step_bits(), half = window.half();
    const V before(std::max(half - 1, 0)), behind(half);
    return {max<E>((low_x + before) >> shift, V(0)),
            min<E>((high_x - behind) >> shift, V(window.right)),
            max<E>((low_y + before) >> shift, V(window.top)),
            min<E>((high_y - behind) >> shift, V(window.bottom)),
            high_x - low_x,
            high_y - low_y};
}

// Twice the signed area, negative where the front is seen.
template <class E> INLINE Vec<E> area_of(const Places<E> &p) {
    return (p.x[1] - p.x[0]) * (p.y[2] - p.y[0]) - (p.x[2] - p.x[0]) * (p.y[1] - p.y[0]);
}

// Edge functions at samples, in units of STEPS, rounded down: not negative inside and on left and
// upper edges. Those at the corner of a sample, in units of 1, where samples are scattered.
template <class E>
INLINE void edge_functions(const Places<E> &p, Vec<E> area, Vec<E> column, Vec<E> row,
                           const Window &window, Edge<E> (&out)[3]) {
    using V = Vec<E>;
    constexpr int BITS = 8 * sizeof(E);
    const auto is_turned = area < V(0);
    const V px = select<E>(is_turned, p.x[2], p.x[1]), py = select<E>(is_turned, p.y[2], p.y[1]);
    const V qx = select<E>(is_turned, p.x[1], p.x[2]), qy = select<E>(is_turned, p.y[1], p.y[2]);
    const V from_x[3] = {p.x[0], px, qx}, from_y[3] = {p.y[0], py, qy};
    const V to_x[3] = {px, qx, p.x[0]}, to_y[3] = {py, qy, p.y[0]};
    const int step_bits = window.step_bits(), half = window.half();
    const int unit_bits = half ? step_bits : 0, scale_bits = step_bits - unit_bits;
    const V x = (column << step_bits) + V(half), y = (row << step_bits) + V(half);
    V rest = select<E>(is_turned, -area, area); // the sum of the three
    const auto set_edge = [&](auto k) __attribute__((always_inline)) {
        const V dx = to_x[k] - from_x[k], dy = to_y[k] - from_y[k];
        const V value = k == 2 ? rest : dx * (y - from_y[k]) - dy * (x - from_x[k]);
        rest = rest - value;
        // -1 on a left or an upper edge, where y falls, or stays while x grows; else 0.
        const V is_left_or_upper = ((dy << BITS / 2) - dx) >> (BITS - 1);
        out[k] = {(value - V(1) - is_left_or_upper) >> unit_bits, -dy << scale_bits,
                  dx << scale_bits};
    };
    unroll<3>(set_edge);
}

// Planes of 1/z through the corners before rounding; through the rounded ones where the triangle
// is too thin.
template <class E>
INLINE void put_planes(const int32_t *packed, const Vertices &vertices, const Places<E> &p,
                       Vec<E> area, const Window &window, Triangles &out) {
    const double steps = double(1 << window.step_bits()), half = window.half();
    Double u[3], v[3], w[3];
    unroll<3>([&](auto k) __attribute__((always_inline)) {
        u[k] = find<IN_CLUSTER<E>, k>(vertices.u, packed);
        v[k] = find<IN_CLUSTER<E>, k>(vertices.v, packed);
        w[k] = find<IN_CLUSTER<E>, k>(vertices.w, packed);
    });
    const Double rounded = to<double>(area);
    const Double change =
        abs((u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0]) - rounded);
    const auto is_thin = change > abs(rounded) * 0.25;
    if (bits(is_thin))
        unroll<3>([&](auto k) __attribute__((always_inline)) {
            u[k] = select<double>(is_thin, to<double>(p.x[k]), u[k]);
            v[k] = select<double>(is_thin, to<double>(p.y[k]), v[k]);
        });
    const Double ab_x = u[1] - u[0], ab_y = v[1] - v[0], ac_x = u[2] - u[0], ac_y = v[2] - v[0];
    const Double w_ab = w[1] - w[0], w_ac = w[2] - w[0];
    const Double scale = Double(steps) / (ab_x * ac_y - ac_x * ab_y);
    const Double slope_x = (w_ab * ac_y - w_ac * ab_y) * scale;
    const Double slope_y = (w_ac * ab_x - w_ab * ac_x) * scale;
    const Double shift = slope_x * (Double(half) - u[0]) + slope_y * (Double(half) - v[0]);
    (w[0] + shift * (1.0 / steps)).store(out.origin);
    slope_x.store(out.slope_x);
    slope_y.store(out.slope_y);
    to<float>(slope_x).store(out.step_x);
    to<float>(slope_y).store(out.step_y);
    // Rounding puts samples slightly outside the triangle; their depth stays within the corners'.
    to<float>(least_of(w)).store(out.least);
    to<float>(greatest_of(w)).store(out.greatest);
}

// Masks of triangles: reaches at most 2 x 2 blocks, two columns of blocks, two rows of blocks; may
// cover a sample, judged by its bounds, and is shown, or hidden.
struct Sides {
    int64_t in_2x2, wide, tall, shown, hidden;
};

// Edge functions (where wanted), bounds and faces of the triangles in `slots`; with PLANES depth
// planes, too.
template <bool PLANES, class E>
INLINE Sides set_up(const int32_t *slots, bool wants_edges, const Faces &faces,
                    const Window &window, Setup<E> &out) {
    using V = Vec<E>;
    alignas(CACHE_LINE) int32_t packed[LANES];
    lookup(faces.corners, slots).store(packed);
    lookup(faces.faces, slots).store(out.face);
    const Places<E> p = places_of<E>(packed, faces.vertices);
    const Bounds<E> b = sample_bounds(p, window);
    const V area = area_of(p);
    if (wants_edges) {
        Edge<E> edges[3];
        edge_functions(p, area, b.first_x & V(-SIDE), b.first_y & V(-SIDE), window, edges);
        unroll<3>([&](auto k) __attribute__((always_inline)) {
            edges[k].value.store(out.value[k]);
            edges[k].dx.store(out.dx[k]);
            edges[k].dy.store(out.dy[k]);
        });
    }
    to<int32_t>(b.first_x).store(out.first_x);
    to<int32_t>(b.last_x).store(out.last_x);
    to<int32_t>(b.first_y).store(out.first_y);
    to<int32_t>(b.last_y).store(out.last_y);
    if constexpr (!PLANES) {
        return {};
    } else {
        put_planes(packed, faces.vertices, p, area, window, out);
        const V columns = (b.last_x >> SIDE_BITS) - (b.first_x >> SIDE_BITS);
        const V rows = (b.last_y >> SIDE_BITS) - (b.first_y >> SIDE_BITS);
        const int64_t in_reach = bits((b.last_x >= b.first_x) & (b.last_y >= b.first_y));
        const int64_t front = in_reach & bits(area < V(0)), back = in_reach & bits(area > V(0));
        return {bits((columns <= V(1)) & (rows <= V(1))), bits(columns > V(0)), bits(rows > V(0)),
                window.hides_back ? front : front | back, window.hides_back ? back : 0};
    }
}

} // namespace rastercov::raster
