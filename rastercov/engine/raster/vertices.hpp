// Stage 2 of the CPU rasteriser: projection of vertices to fixed-point image positions.
//
// u = s (fx X/Z + cx), v = s (fy Y/Z + cy), s steps in a sample, rounded to the nearest step,
// halves up; X and Y of parallel rays. Twin: rastercov.reference.samples.
#pragma once
#include "raster/records.hpp"
#include <tuple>

namespace rastercov::raster {

// Steps that the vertices of a cluster reach.
struct Box {
    int64_t low_x, high_x, low_y, high_y;
};

// Projects the vertices of a cluster.
inline Box project_vertices(const Clusters &clusters, const Cluster &cluster, const Camera &camera,
                            int steps, Vertices &out) {
    const double fx = camera.fx * steps, fy = camera.fy * steps;
    const double cx = camera.cx * steps, cy = camera.cy * steps;
    const int n = int(cluster.end_vertex - cluster.first_vertex);
    const int64_t start = 3 * cluster.first_vertex;
    const auto &[axes, eye] = std::tie(camera.axes, camera.eye);
    Int low_x(NEEDS_CLIPPING), high_x(-NEEDS_CLIPPING), low_y(low_x), high_y(high_x);
    for (int at = 0; at < n; at += LANES) {
        const Double x = load(clusters.points, start + at) - eye[0];
        const Double y = load(clusters.points, start + n + at) - eye[1];
        const Double z = load(clusters.points, start + 2 * n + at) - eye[2];
        const Double right = x * axes[0] + y * axes[3] + z * axes[6];
        const Double down = x * axes[1] + y * axes[4] + z * axes[7];
        const Double forward = x * axes[2] + y * axes[5] + z * axes[8];
        const bool is_parallel = camera.is_parallel();
        const Double w = is_parallel ? Double(camera.farthest) - forward : Double(1) / forward;
        const Double scale = is_parallel ? Double(1) : w;
        const Double u = Double(fx) * right * scale + cx, v = Double(fy) * down * scale + cy;
        u.store(out.u + at);
        v.store(out.v + at);
        w.store(out.w + at);
        const Double round_u = floor(u + 0.5), round_v = floor(v + 0.5);
        Int whole_x, whole_y;
        if (cluster.is_safe) [[likely]] {
            whole_x = to<int32_t>(round_u);
            whole_y = to<int32_t>(round_v);
        } else {
            const auto is_beyond_near = forward >= Double(camera.near);
            const auto is_seen =
                is_beyond_near & (abs(u) <= Double(GUARD_BAND)) & (abs(v) <= Double(GUARD_BAND));
            const auto seen = to<int32_t>(is_seen);
            const Int unseen = select<int32_t>(to<int32_t>(is_beyond_near), NEEDS_CLIPPING, BEHIND);
            const auto of = [&](Double rounded) {
                const Int whole = to<int32_t>(select<double>(is_seen, rounded, 0.0));
                return select<int32_t>(seen, whole, unseen);
            };
            whole_x = of(round_u);
            whole_y = of(round_v);
        }
        out.places.store(at, whole_x, whole_y);
        const auto is_vertex = lane_numbers() < Int(n - at);
        low_x = select<int32_t>(is_vertex, min<int32_t>(whole_x, low_x), low_x);
        high_x = select<int32_t>(is_vertex, max<int32_t>(whole_x, high_x), high_x);
        low_y = select<int32_t>(is_vertex, min<int32_t>(whole_y, low_y), low_y);
        high_y = select<int32_t>(is_vertex, max<int32_t>(whole_y, high_y), high_y);
    }
    return {least(low_x), greatest(high_x), least(low_y), greatest(high_y)};
}

// Greatest 1/z of the first n vertices of a cluster.
inline float nearest_vertex(const Vertices &vertices, int n) {
    Double nearest(0);
    for (int at = 0; at < n; at += LANES) {
        const auto is_vertex = to<int64_t>(lane_numbers() < Int(n - at));
        const Double w = select<double>(is_vertex, Double::load(vertices.w + at), 0.0);
        nearest = max(nearest, w);
    }
    return float(greatest(nearest));
}

} // namespace rastercov::raster
