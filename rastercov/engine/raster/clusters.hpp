// A mesh in clusters, and its memory.
//
// Twins: tests/raster/test_clusters.py.
#pragma once
#include "raster/buffer.hpp"
#include "raster/records.hpp"

namespace rastercov::raster {

using Points = FloatRows<3>;
using Triples = Array<const int32_t, Any, 3>;

// The vertices of a cluster are padded to a multiple of this, by the last one.
constexpr int64_t VERTEX_STEP = 8;

// Memory of `Clusters`: whole clusters and vectors are read, beyond the last, too.
struct ClusterMemory {
    int64_t n, stride;
    Buffer<double> points;
    Buffer<int32_t> corners, faces, lines, vertex_starts, face_starts, line_starts;
    Buffer<double> bounds;

    ClusterMemory(int64_t n, int64_t n_slots, int64_t n_points)
        : n(n), stride((n + LANES - 1) / LANES * LANES), points(3 * n_points + LANES),
          corners(n_slots + FACES), faces(n_slots + FACES), vertex_starts(n + 1),
          face_starts(n + 1), line_starts(n + 1), bounds(BOUNDS_OF_CLUSTER * stride) {}

    Array<double, BOUNDS_OF_CLUSTER, Any> bounds_of() const {
        return {bounds.all.data, {BOUNDS_OF_CLUSTER, stride}};
    }
    Clusters clusters() const {
        return {points.all,      corners.all,     faces.all,   lines.all, vertex_starts.all,
                face_starts.all, line_starts.all, bounds_of(), n,         stride};
    }
};

// Groups faces into clusters, their vertices from a centre. Unless a mesh is wound the order of a
// face's corners does not define its front.
ClusterMemory group_faces(const Points &vertices, const Triples &faces,
                          const Array<const double, 3> &centre, bool is_wound);

} // namespace rastercov::raster
