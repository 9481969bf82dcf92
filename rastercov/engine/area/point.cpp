// Single points of the surface: why they are not covered, and the pieces they lie in.
//
// See point.hpp.
//
// Twins: rastercov.reference.regions, which judges points without a tree.
#include "area/point.hpp"
#include "area/polygon.hpp"
#include "bind.hpp"

namespace rastercov {
namespace area {
namespace {

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
            if (is_inside(x, y, corners.data + 2 * first, last - first, slack))
                out(i, row[piece]) = true;
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
