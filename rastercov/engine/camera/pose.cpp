// Poses by where cameras look; faults of poses: what is no rigid motion, and what has drifted from
// one; their near planes; and views along parallel rays.
//
// The rotation R of a pose has drifted by the largest entry of |R^T R - 1|.
//
// Twins: tests/test_pose.py, tests/test_projection.py.
#include "bind.hpp"
#include "camera/look_at.hpp"
#include "camera/near.hpp"
#include "camera/sun.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov {
namespace {

// Sound, and faults in the order in which the first one counts; drift is none.
enum Fault : uint8_t { SOUND, NOT_FINITE, TOO_FAR, BAD_LAST_ROW, NO_ROTATION, REFLECTION, DRIFTED };

struct PoseLimits {
    double farthest;            // coordinate, metres
    double tolerance, rounding; // of drift: more is a fault, more is taken out
};

Fault fault_of(const Array<const double, 4, 4> &pose, const PoseLimits &limits) {
    for (const double each : pose)
        if (!(std::abs(each) < INFINITY)) return NOT_FINITE;
    for (int i = 0; i < 3; i++)
        if (std::abs(pose(i, 3)) > limits.farthest) return TOO_FAR;
    for (int k = 0; k < 4; k++)
        if (pose(3, k) != (k == 3)) return BAD_LAST_ROW;
    double drift = 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) {
            double product = 0.0;
            for (int k = 0; k < 3; k++) product += pose(k, i) * pose(k, j);
            const double off = std::abs(product - (i == j));
            if (!(off <= limits.tolerance)) return NO_ROTATION; // NaN of what overflows, too
            drift = std::max(drift, off);
        }
    double determinant = 0.0;
    for (int j = 0; j < 3; j++) {
        const int k = (j + 1) % 3, l = (j + 2) % 3;
        determinant += pose(0, j) * (pose(1, k) * pose(2, l) - pose(1, l) * pose(2, k));
    }
    if (determinant < 0) return REFLECTION;
    return drift > limits.rounding ? DRIFTED : SOUND;
}

void find_faults(FloatRows<4, 4> poses, const PoseLimits &limits, Column<uint8_t> out) {
    require(out.rows() == poses.rows(), "out must have one row for each pose");
    for (int64_t i = 0; i < poses.rows(); i++) out[i] = fault_of(poses[i], limits);
}

Box box_of(const Array<const double, 2, 3> &bounds) {
    Box box;
    for (int k = 0; k < 6; k++) box[k / 3][k % 3] = bounds.data[k];
    return box;
}

void find_near_limits(FloatRows<4, 4> poses, Array<const double, 2, 3> bounds,
                      FloatArray of_cameras, Column<double> out) {
    require(have_rows(poses.rows(), of_cameras, out),
            "of_cameras and out must have one row for each pose");
    const Box box = box_of(bounds);
    for (int64_t i = 0; i < poses.rows(); i++) {
        const auto centre = [&](int axis) { return poses(i, axis, 3); };
        out[i] = near_of(of_cameras[i], farthest_of(box, centre));
    }
}

void look_at(FloatRows<3> eyes, FloatRows<3> targets, FloatRows<3> ups,
             Array<double, Any, 4, 4> out) {
    require(have_rows(out.rows(), eyes, targets, ups), "there must be one row for each pose");
    for (int64_t i = 0; i < out.rows(); i++)
        write_pose(eyes[i].data, targets[i].data, ups[i].data, out[i].data);
}

double see_along(FloatRows<3> directions, Array<const double, 2, 3> bounds,
                 Array<double, Any, 4, 4> out) {
    require(have_rows(out.rows(), directions), "there must be one row for each pose");
    const SunViews views(box_of(bounds));
    for (int64_t i = 0; i < out.rows(); i++) views.write(directions[i].data, out[i].data);
    return views.px_per_m();
}

struct SunlitFaces {
    FloatRows<3> normals;
    FloatArray areas; // 0 of faces that are not evaluated
    BoolArray two_sided;
};
using Areas = Array<double, Any, Any>;

void keep_front(FloatRows<3> directions, const SunlitFaces &faces, Areas lit, Areas whole,
                Areas bound) {
    const int64_t n = faces.normals.rows();
    require(have_rows(n, faces.areas, faces.two_sided), "faces must have equal lengths");
    for (const Areas &each : {lit, whole, bound})
        require(each.rows() == directions.rows() && each.extent(1) == n,
                "areas must have a row for each direction, and a column for each face");
    for (int64_t i = 0; i < directions.rows(); i++)
        for (int64_t f = 0; f < n; f++) {
            double cosine = 0.0;
            if (faces.areas[f] > 0)
                for (int k = 0; k < 3; k++) cosine += directions(i, k) * faces.normals(f, k);
            SunlitFace{lit(i, f), whole(i, f), bound(i, f)}.keep_front(cosine, faces.two_sided[f],
                                                                       faces.areas[f]);
        }
}

} // namespace

RECORD(PoseLimits, farthest, tolerance, rounding);
RECORD(SunlitFaces, normals, areas, two_sided);

void register_camera_pose(nanobind::module_ &m) {
    m.attr("DRIFTED") = int(DRIFTED);
    def(m, "find_faults", find_faults, "Set `out`, (P,), to the index of the fault of each pose.",
        "poses", "limits", "out");
    m.attr("NEAR_TO_FAR") = NEAR_TO_FAR;
    def(m, "find_near_limits", find_near_limits,
        "Set `out`, (P,), to the depth of the near plane of each pose, metres.", "poses", "bounds",
        "of_cameras", "out");
    def(m, "look_at", look_at,
        "Set `out`, (P, 4, 4), to the pose at each eye that looks at its target.", "eyes",
        "targets", "ups", "out");
    m.attr("EDGE_ON_RAD") = EDGE_ON_RAD;
    m.attr("SUN_SIDE") = int(SUN_SIDE);
    def(m, "see_along", see_along,
        "Set `out`, (N, 4, 4), to poses of parallel rays by unit vectors to their source; returns "
        "pixels per metre of an image of the box.",
        "directions", "bounds", "out");
    def(m, "keep_front", keep_front,
        "Set areas (N, F), lit, whole and their bound, to 0 where faces turn away or are "
        "edge-on.\n\n"
        "faces : normals (F, 3), areas, m^2, or 0 of faces that are not evaluated, and two_sided, "
        "(F,).",
        "directions", "faces", "lit", "whole", "bound");
}

} // namespace rastercov
