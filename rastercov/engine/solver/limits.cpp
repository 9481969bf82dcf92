// Limits of a pose, by the bounding box where that decides.
//
// Twin: tests/test_projection.py.
#include "solver/limits.hpp"
#include "exact/depth.hpp"
#include <cmath>

namespace rastercov::engine {

double widest_of(const Lens &of) {
    return std::hypot(std::max(of.cx, of.width - of.cx) / of.fx,
                      std::max(of.cy, of.height - of.cy) / of.fy);
}

namespace {
// True if a surface in view of a pinhole, or of parallel rays, is beyond `from` and nearer than the
// limit.
template <class Faces>
bool cuts_in(const Scene<Faces> &scene, const Lens &of, const Pose &pose, bool is_parallel,
             double from, double limit) {
    const double sides[12] = {of.fx, 0,     of.cx, -of.fx, 0,      of.width - of.cx,
                              0,     of.fy, of.cy, 0,      -of.fy, of.height - of.cy};
    const double least =
        exact::least_depth(scene.vertices, scene.faces, {pose.rotation, {3, 3}}, {pose.centre, {3}},
                           {sides, {4, 3}}, is_parallel, from, limit);
    return least < limit;
}

// Calls with each pinhole of a camera and its pose until it is true.
template <class Test> bool any_pinhole(const Camera &camera, const Pose &pose, Test test) {
    if (camera.planes.empty()) return test(camera.image, pose);
    const lens::Frame *last = nullptr;
    for (const IdealPlane &plane : camera.planes) {
        const lens::Frame &frame = plane.record.frame;
        const bool is_new = !last || !std::equal(frame.begin(), frame.end(), last->begin());
        if (is_new && test(plane.pinhole, rotate(pose, frame))) return true;
        last = &frame;
    }
    return false;
}

// True if the near plane cuts away a surface in view. Only faces within reach of the eye can: the
// depth of a point in view is never less than its distance times the cosine of the widest ray. So
// the bounding box decides nearly always.
template <class Faces>
bool is_cut(const Scene<Faces> &scene, const Camera &camera, const Pose &pose, double limit) {
    double widest = 0.0;
    any_pinhole(camera, pose, [&](const Lens &of, const Pose &) {
        widest = std::max(widest, widest_of(of));
        return false;
    });
    const double reach = limit * std::sqrt(1 + widest * widest);
    for (int axis = 0; axis < 3; axis++)
        if (!(pose.centre[axis] > scene.bounds[0][axis] - reach &&
              pose.centre[axis] < scene.bounds[1][axis] + reach))
            return false;
    return any_pinhole(camera, pose, [&](const Lens &of, const Pose &own) {
        return cuts_in(scene, of, own, false, 0.0, limit);
    });
}

// True if the camera is beyond the bounding box by more than NEAR_TO_FAR of the farthest distance:
// one that is mounted on a face looks through it, for the near plane cuts it away, which is_cut
// cannot tell where the face is edge-on to rounding.
bool is_outside(const Box &bounds, const Pose &pose, double farthest) {
    const double margin = NEAR_TO_FAR * farthest;
    for (int axis = 0; axis < 3; axis++)
        if (pose.centre[axis] < bounds[0][axis] - margin ||
            pose.centre[axis] > bounds[1][axis] + margin)
            return true;
    return false;
}

// Reach of parallel rays, which are outside of a closed surface where they meet nothing before the
// near plane.
template <class Faces>
Reach reach_of_parallel(const Scene<Faces> &scene, const Camera &camera, const Pose &pose,
                        double near) {
    const Extent extent = extent_along(scene.bounds, scene.all, pose);
    const auto cuts_from = [&](double from) {
        return any_pinhole(camera, pose, [&](const Lens &of, const Pose &own) {
            return cuts_in(scene, of, own, true, from, near);
        });
    };
    const bool is_within = extent.least < near && cuts_from(-INFINITY);
    return {near, is_within ? 0.0 : extent.distance(near), is_within && cuts_from(0.0)};
}
} // namespace

Pose rotate(const Pose &pose, const lens::Frame &frame) {
    Pose out = pose;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double total = 0.0;
            for (int k = 0; k < 3; k++) total += pose.at(i, k) * frame(k, j);
            out.rotation[3 * i + j] = total;
        }
    return out;
}

template <class Faces>
Reach reach_of(const Scene<Faces> &scene, const Camera &camera, const Pose &pose, bool asks_cut) {
    const double farthest = farthest_of(scene.bounds, [&](int axis) { return pose.centre[axis]; });
    const double near = near_of(camera.near, farthest);
    if (camera.is_parallel) return reach_of_parallel(scene, camera, pose, near);
    const bool is_beyond = is_outside(scene.bounds, pose, farthest);
    const bool is_clipped = (asks_cut || is_beyond) && is_cut(scene, camera, pose, near);
    return {near, is_beyond && !is_clipped ? farthest : 0.0, is_clipped};
}
template Reach reach_of(const Scene<decltype(Welded::faces)> &, const Camera &, const Pose &, bool);

Limits limits_of(const Surface &surface, const Camera &camera, const Pose &pose) {
    const Scene<Faces> scene = {surface.vertices(), surface.faces(), surface.bounds(),
                                box_of(surface)};
    const auto [near, away, is_clipped] = reach_of(scene, camera, pose, true);
    return {near, away > 0.0 && surface.hides_its_back(away), is_clipped};
}

} // namespace rastercov::engine
