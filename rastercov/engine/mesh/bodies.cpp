// Points and directions of rigid bodies, each moved by the pose of its body.
//
// Each value is the same sum whatever is beside it: copies of a vertex stay copies to the bit.
// A pose that is the identity changes no bit, but for -0.0.
//
// Twin: tests/mesh/test_body_contacts.py, by numpy.
#include "bind.hpp"
#include <algorithm>
#include <limits>

namespace rastercov {
namespace {

using Vectors = FloatRows<3>;
using Labels = Int32Array;
using Poses = FloatRows<4, 4>;

void require_bodies(Vectors vectors, Labels body, Poses poses, Array<double, Any, 3> out) {
    require(have_rows(vectors.rows(), body, out), "body and out must have one row for each vector");
    require_indices(body, poses.rows(), "body must hold rows of poses");
}

void move_points(Vectors points, Labels body, Poses poses, Array<double, Any, 3> out,
                 Array<double, 2, 3> bounds) {
    require_bodies(points, body, poses, out);
    constexpr double INF = std::numeric_limits<double>::infinity();
    double low[3] = {INF, INF, INF}, high[3] = {-INF, -INF, -INF};
    for (int64_t i = 0; i < points.rows(); i++) {
        const auto pose = poses[body[i]];
        const double x = points(i, 0), y = points(i, 1), z = points(i, 2);
        for (int k = 0; k < 3; k++) {
            const double moved = pose(k, 0) * x + pose(k, 1) * y + pose(k, 2) * z + pose(k, 3);
            out(i, k) = moved;
            low[k] = std::min(low[k], moved);
            high[k] = std::max(high[k], moved);
        }
    }
    for (int k = 0; k < 3; k++) {
        bounds(0, k) = low[k];
        bounds(1, k) = high[k];
    }
}

void turn(Vectors vectors, Labels body, Poses poses, Array<double, Any, 3> out) {
    require_bodies(vectors, body, poses, out);
    for (int64_t i = 0; i < vectors.rows(); i++) {
        const auto pose = poses[body[i]];
        for (int k = 0; k < 3; k++)
            out(i, k) = pose(k, 0) * vectors(i, 0) + pose(k, 1) * vectors(i, 1) +
                        pose(k, 2) * vectors(i, 2);
    }
}

} // namespace

void register_mesh_bodies(nanobind::module_ &m) {
    def(m, "move_points", move_points,
        "Set `out` to the points (N, 3) moved by the poses (B, 4, 4) of their bodies, and "
        "`bounds`\n"
        "to the lowest and highest coordinates.",
        "points", "body", "poses", "out", "bounds");
    def(m, "turn", turn,
        "Set `out` to the vectors (N, 3) turned by the poses (B, 4, 4) of their bodies.", "vectors",
        "body", "poses", "out");
}

} // namespace rastercov
