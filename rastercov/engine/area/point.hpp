// Single points of the surface: the criteria that each fails in a pose, and what hides it.
//
// Occlusion is a segment from the near plane to the point, traced through a tree of triangles in a
// scene of diagonal 1 about the origin.
//
// Twins: rastercov.reference.regions, which judges points without a tree.
#pragma once
#include "coverage/decision.hpp"
#include "interrupt.hpp"
#include "mesh/place.hpp"

namespace rastercov::area {

// Points, their unit normals, and their triangles in the order of the tree, -1 for none there;
// either side of some of them counts.
struct Judged {
    FloatRows<3> points, normals;
    BoolArray two_sided;
    IntArray own;
};

// A pose in the scene of diagonal 1: the rotation of world_from_camera, the eye, the depth of the
// near plane, and the distance from a point up to which a surface hides nothing.
struct Viewpoint {
    Array<const double, 3, 3> rotation;
    Array<const double, 3> eye;
    double near, margin;
};

// Segment from the near plane to a point, on the way from the camera to it, less a margin.
template <class Camera>
mesh::Segment ray_from_near(const Camera &camera, const Viewpoint &view, const Triple<double> &way,
                            double depth) {
    const auto &[x, y, z] = way;
    const auto &eye = view.eye;
    if constexpr (std::is_same_v<Camera, CurvedLens>)
        if (camera.is_parallel()) return ray_from_near(ParallelLens{}, view, way, depth);
    if constexpr (std::is_same_v<Camera, ParallelLens>) {
        const auto along = ray_along(camera, view.rotation, way);
        const double back = depth - view.near;
        return {
            {eye[0] + x - back * along.x, eye[1] + y - back * along.y, eye[2] + z - back * along.z},
            {along.x, along.y, along.z},
            back - view.margin};
    } else {
        const double length = std::sqrt(x * x + y * y + z * z), share = view.near / depth;
        return {{eye[0] + share * x, eye[1] + share * y, eye[2] + share * z},
                {x / length, y / length, z / length},
                length * (1.0 - share) - view.margin};
    }
}

// What may hide points: a tree of triangles, and their faces; the first of all that hide, also
// points that fail other criteria, or any, of points that fail none.
struct Hiders {
    mesh::Corners corners;
    mesh::Nodes nodes;
    IntArray faces;
    bool is_nearest;
};

// True if a point is nearer than a margin to a triangle, and farther than that from its edges.
inline bool holds(const mesh::Triangle &t, const Vector &point, double margin) {
    const Vector normal = normal_of(t);
    bool is_in = std::abs(dot(normal, point - t.corner[0])) <= margin * length(normal);
    for (int k = 0; k < 3; k++) {
        const Vector inward = cross(normal, t.edge(k));
        is_in &= dot(inward, point - t.corner[k]) > margin * length(inward);
    }
    return is_in;
}

// Triangle of a lower face than `own` that holds a point, or -1: of faces that coincide the first
// one is seen.
inline int64_t coincident(const mesh::Point &point, int64_t own, const Hiders &in, double margin) {
    int64_t found = -1;
    if (own < 0 || own >= in.faces.rows()) return found;
    const auto is_near = [&](int64_t node) {
        return mesh::box_distance(point, in.nodes[node]) <= margin * margin;
    };
    mesh::each_met(in.nodes, in.corners.rows(), is_near, [&](int64_t t) {
        if (in.faces[t] < in.faces[own] &&
            holds(mesh::triangle_of(in.corners[t].data), mesh::vector_of(point.data), margin))
            found = t;
        return found < 0;
    });
    return found;
}

// Sets `reason` to the criteria that each point fails in one pose, and `hider` to the triangle
// that hides it or -1. `rules` are of the scene of diagonal 1.
template <class Camera>
void judge_points(const Judged &points, const Camera &camera, const Rules &rules,
                  const Viewpoint &view, const Hiders &hiders, Column<uint8_t> reason,
                  Column<int64_t> hider) {
    const int64_t n = points.points.rows();
    require(have_rows(n, points.normals, points.two_sided, points.own, reason, hider),
            "normals, two_sided, own, reason and hider must have one row for each point");
    require_lens(camera);
    mesh::require_tree(hiders.corners, hiders.nodes);
    require(have_rows(hiders.corners.rows(), hiders.faces),
            "faces must have one row for each triangle");
    mesh::Hits hits = {hiders.corners, hiders.nodes, hiders.is_nearest};
    Poll poll(64);
    for (int64_t i = 0; i < n; i++) {
        poll();
        const auto at = points.points[i], normal = points.normals[i];
        const Triple<double> way = {at[0] - view.eye[0], at[1] - view.eye[1], at[2] - view.eye[2]};
        const auto [fails, alone, depth] =
            coverage::judge_point(camera, rules, view.rotation, view.near, way,
                                  {normal[0], normal[1], normal[2]}, points.two_sided[i]);
        reason[i] = alone.value_or(coverage::Reason(coverage::REASON_OF[fails]));
        hider[i] = -1;
        if (alone || (fails && !hiders.is_nearest)) continue;
        const mesh::Segment ray = ray_from_near(camera, view, way, depth);
        if (!(ray.reach > 0.0)) continue;
        hider[i] = hits.first(ray, points.own[i]);
        if (hider[i] < 0) hider[i] = coincident(at, points.own[i], hiders, view.margin);
        if (hider[i] >= 0) reason[i] = coverage::REASON_OF[fails | coverage::IS_HIDDEN];
    }
}

} // namespace rastercov::area
