// Single points of the surface: why they are not covered, and the pieces they lie in.
//
// See point.hpp.
//
// Twins: rastercov.reference.regions, which judges points without a tree.
#include "area/point.hpp"
#include "area/polygon.hpp"
#include "bind.hpp"
#include "range.hpp"

namespace rastercov {
namespace area {
namespace {

// Pieces by face: those of face f are order[of_face[f]] ... order[of_face[f + 1] - 1]. Corners are
// counter-clockwise.
struct Lookup {
    IntArray order;
    Starts of_face;
    FloatRows<2> corners;
    Starts starts;
};

constexpr int64_t MOST_RUN = 64; // points in a row

// Marks, in `out`, the poses that cover points: `xy` in the planes of their faces, metres. `row` is
// the pose of each piece. A point is inside up to a distance `slack` beyond a side, metres. The
// pieces of a face are looked at once for points of it in a row.
void find_covering(FloatRows<2> xy, Int32Array face, const Lookup &pieces, Int32Array row,
                   double slack, Array<bool, Any, Any> out) {
    const auto &[order, of_face, corners, starts] = pieces;
    require(have_rows(face.rows(), xy, out), "xy and out must have one row for each point");
    require(starts.rows() == row.rows() + 1, "starts must have one row more than there are pieces");
    require_indices(face, of_face.rows() - 1, "face must hold faces");
    require_indices(order, row.rows(), "order must hold pieces");
    require_indices(row, out.extent(1), "row must hold columns of out");
    Poll poll;
    for (int64_t i = 0, end = 0; i < face.rows(); i = end) {
        poll();
        Rectangle run;
        for (; end < face.rows() && end < i + MOST_RUN && face[end] == face[i]; end++)
            run.add(xy(end, U), xy(end, V));
        const int64_t begin = of_face[face[i]], stop = of_face[face[i] + 1];
        require(begin >= 0 && stop <= order.rows(), "of_face must hold places in order");
        for (int64_t at = begin; at < stop; at++) {
            const int64_t piece = order[at], first = starts[piece], last = starts[piece + 1];
            require(first >= 0 && first <= last && last <= corners.rows(),
                    "pieces must lie within corners");
            Rectangle box;
            for (int64_t c = first; c < last; c++) box.add(corners(c, U), corners(c, V));
            const auto is_apart = [&](const Rectangle &of) {
                return of.x.most < box.x.least - slack || of.x.least > box.x.most + slack ||
                       of.y.most < box.y.least - slack || of.y.least > box.y.most + slack;
            };
            if (is_apart(run)) continue;
            for (int64_t k = i; k < end; k++) {
                Rectangle point;
                const double x = xy(k, U), y = xy(k, V);
                point.add(x, y);
                if (!is_apart(point) &&
                    is_inside(x, y, corners.data + 2 * first, last - first, slack))
                    out(k, row[piece]) = true;
            }
        }
    }
}

} // namespace
} // namespace area

RECORD(area::Judged, points, normals, two_sided, own);
RECORD(area::Viewpoint, rotation, eye, near, margin);
RECORD(area::Hiders, corners, nodes, faces, is_nearest);
RECORD(area::Lookup, order, of_face, corners, starts);

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
