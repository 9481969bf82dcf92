// Single points of the surface: why they are not covered, and the pieces they lie in.
//
// Occlusion is a segment from the near plane to the point, traced through a tree of triangles in a
// scene of diagonal 1 about the origin.
//
// Twins: rastercov.reference.regions, which judges points without a tree.
#include "area/polygon.hpp"
#include "bind.hpp"
#include "coverage/decision.hpp"
#include "interrupt.hpp"
#include "mesh/tree.hpp"

namespace rastercov {
namespace area {
namespace {

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

// What may hide points: a tree of triangles; the first of all that hide, also points that fail
// other criteria, or any, of points that fail none.
struct Hiders {
    mesh::Corners corners;
    mesh::Nodes nodes;
    bool is_nearest;
};

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
        if (hider[i] >= 0) reason[i] = coverage::REASON_OF[fails | coverage::IS_HIDDEN];
    }
}

// True if a point lies in a convex polygon, counter-clockwise, or beyond a side by `slack` at most.
bool is_inside(double x, double y, const FloatRows<2> &corners, int64_t first, int64_t last,
               double slack) {
    int64_t p = last - 1;
    for (int64_t q = first; q < last; p = q++) {
        const double along_x = corners(q, U) - corners(p, U),
                     along_y = corners(q, V) - corners(p, V);
        const double value = along_x * (y - corners(p, V)) - along_y * (x - corners(p, U));
        if (value < -slack * (std::abs(along_x) + std::abs(along_y))) return false;
    }
    return true;
}

// Pieces by face: those of face f are order[of_face[f]] ... order[of_face[f + 1] - 1]. Corners are
// counter-clockwise; boxes are least and most x, least and most y.
struct Lookup {
    IntArray order;
    Starts of_face;
    FloatRows<2> corners;
    Starts starts;
    FloatRows<4> boxes;
};

// Marks, in `out`, the poses that cover points: `xy` in the planes of their faces, metres. `row` is
// the pose of each piece. A point is inside up to a distance `slack` beyond a side, metres.
void find_covering(FloatRows<2> xy, Int32Array face, const Lookup &pieces, Int32Array row,
                   double slack, Array<bool, Any, Any> out) {
    const auto &[order, of_face, corners, starts, boxes] = pieces;
    const int64_t n = row.rows();
    require(have_rows(face.rows(), xy, out), "xy and out must have one row for each point");
    require(starts.rows() == n + 1 && boxes.rows() == n,
            "starts and boxes must have one row for each piece, starts one more");
    require_indices(face, of_face.rows() - 1, "face must hold faces");
    require_indices(order, n, "order must hold pieces");
    require_indices(row, out.extent(1), "row must hold columns of out");
    Poll poll;
    for (int64_t i = 0; i < face.rows(); i++) {
        poll();
        const int64_t begin = of_face[face[i]], end = of_face[face[i] + 1];
        const double x = xy(i, U), y = xy(i, V);
        require(begin >= 0 && end <= order.rows(), "of_face must hold places in order");
        for (int64_t at = begin; at < end; at++) {
            const int64_t piece = order[at];
            const auto box = boxes[piece];
            if (x < box[0] - slack || x > box[1] + slack) continue;
            if (y < box[2] - slack || y > box[3] + slack || out(i, row[piece])) continue;
            const int64_t first = starts[piece], last = starts[piece + 1];
            require(first >= 0 && first <= last && last <= corners.rows(),
                    "pieces must lie within corners");
            if (is_inside(x, y, corners, first, last, slack)) out(i, row[piece]) = true;
        }
    }
}

} // namespace
} // namespace area

RECORD(area::Judged, points, normals, two_sided, own);
RECORD(area::Viewpoint, rotation, eye, near, margin);
RECORD(area::Hiders, corners, nodes, is_nearest);
RECORD(area::Lookup, order, of_face, corners, starts, boxes);

void register_area_point(nanobind::module_ &m) {
    using namespace area;
    const auto judge = [&]<class Camera>(const Camera &) {
        def(m, "judge_points", judge_points<Camera>,
            "Set `reason` to the criteria that each point fails in one pose, and `hider` "
            "to the triangle that hides it or -1.",
            "points", "camera", "rules", "view", "hiders", "reason", "hider");
    };
    judge(Lens{});
    judge(ParallelLens{});
    judge(CurvedLens{});
    def(m, "find_covering", find_covering, "Mark, in `out`, the poses that cover points.", "xy",
        "face", "pieces", "row", "slack", "out");
}

} // namespace rastercov
