// Points for C: the first criterion that each of a surface fails in a pose, and what hides it; and
// places for a camera.
//
// Twin: rastercov.core.area.point_pass, by tests/native/test_c_border.py.
#include "area/point.hpp"
#include "c/objects.hpp"
#include "mesh/grow.hpp"
#include "mesh/place.hpp"
#include "sort.hpp"
#include <algorithm>
#include <numeric>

namespace rastercov::c {
Box box_of(const engine::MeshArrays &mesh, bool with_targets) {
    const bool is_of_all = with_targets || mesh.box.size(); // where all faces are targets
    Box box;
    for (size_t axis = 0; axis < 3; axis++) {
        Range all;
        for (const int64_t v : is_of_all ? mesh.faces.rows() : mesh.opaque.rows())
            all.add(mesh.vertices[3 * v + int64_t(axis)]);
        box[0][axis] = all.least;
        box[1][axis] = all.most;
    }
    return box;
}

namespace {
// Distance from a point up to which a surface hides nothing, in diagonals.
constexpr double MARGIN_REL = 1e-9;

std::unique_ptr<const Hiders> make_hiders(const engine::Mesh &of) {
    const engine::MeshArrays &mesh = *of.arrays;
    auto made = std::make_unique<Hiders>();
    const Box box = box_of(mesh, false);
    made->diagonal = of.diagonal > 0 ? of.diagonal : 1.0;
    for (size_t k = 0; k < 3; k++) made->centre[k] = (box[0][k] + box[1][k]) / 2;
    std::vector<int64_t> solid, corners;
    for (int64_t f = 0; f < of.n_faces(); f++) {
        if (mesh.is_target[f] || !(mesh.areas[f] > 0)) continue;
        solid.push_back(f);
        for (int k = 0; k < 3; k++) corners.push_back(mesh.faces[3 * f + k]);
    }
    made->row.assign(size_t(of.n_faces()), -1);
    made->nodes.assign(24, INFINITY);
    if (solid.empty()) return made;
    std::vector<double> placed(size_t(mesh.vertices.size()));
    for (size_t k = 0; k < placed.size(); k++)
        placed[k] = (mesh.vertices[int64_t(k)] - made->centre[k % 3]) / made->diagonal;
    const mesh::Points points = {placed.data(), {int64_t(placed.size() / 3)}};
    const auto n = int64_t(solid.size());
    std::vector<uint64_t> keys(solid.size());
    mesh::order_keys<int64_t>(points, {corners.data(), {n}}, {keys.data(), {n}});
    std::vector<int64_t> sorted;
    for (const int64_t at : order_of(keys)) {
        made->row[size_t(solid[size_t(at)])] = int64_t(made->faces.size());
        made->faces.push_back(solid[size_t(at)]);
        for (int64_t k = 3 * at; k < 3 * at + 3; k++) {
            sorted.push_back(corners[size_t(k)]);
            const double *const corner = placed.data() + 3 * corners[size_t(k)];
            made->corners.insert(made->corners.end(), corner, corner + 3);
        }
    }
    int64_t leaves = 2;
    while (leaves * mesh::LEAF < n) leaves *= 2;
    std::vector<double> boxes(size_t(6 * n));
    made->nodes.resize(size_t(12 * leaves));
    mesh::grow_boxes<int64_t, double>(points, {sorted.data(), {n}}, 0.0, {boxes.data(), {n}},
                                      {made->nodes.data(), {2 * leaves}});
    return made;
}

const Hiders &hiders_of(const SurfaceObject &surface) {
    const std::scoped_lock lock(surface.changes);
    if (!surface.hiders) surface.hiders = make_hiders(surface.mesh);
    return *surface.hiders;
}

area::Hiders tree_of(const Hiders &hiders) {
    return {{hiders.corners.data(), {int64_t(hiders.faces.size())}},
            {hiders.nodes.data(), {int64_t(hiders.nodes.size() / 6)}},
            {hiders.faces.data(), {int64_t(hiders.faces.size())}},
            true};
}

struct Asked {
    const double *points;
    const int32_t *faces;
    int64_t n;
};

Rules in_units_of(Rules rules, double scale) {
    rules.z_n /= scale;
    rules.z_f /= scale;
    rules.min_pixel_density *= scale;
    rules.min_facing_density *= scale;
    rules.min_pixels_per_m2 *= scale * scale;
    return rules;
}

template <class Camera>
void judge(const SurfaceObject &surface, const Camera &camera, double near, const Rules &rules,
           const double *pose, const Asked &asked, const rc_failures &out) {
    const Hiders &hiders = hiders_of(surface);
    const engine::MeshArrays &mesh = *surface.mesh.arrays;
    const double eye_at[3] = {pose[3], pose[7], pose[11]};
    const Box box = box_of(mesh, false);
    const double depth =
        near_of(near, farthest_of(box, [&](int axis) { return eye_at[axis]; })) / hiders.diagonal;
    double rotation[9], eye[3];
    for (size_t k = 0; k < 9; k++) rotation[k] = pose[4 * (k / 3) + k % 3];
    hiders.place(eye_at, eye);
    const int64_t n = asked.n;
    std::vector<double> points(size_t(3 * n)), normals;
    engine::Room<bool> two_sided(n);
    std::vector<int64_t> own, hit(static_cast<size_t>(n));
    for (int64_t i = 0; i < n; i++) {
        const int32_t f = asked.faces[i];
        const double *const normal = &mesh.normal[3 * f];
        hiders.place(asked.points + 3 * i, &points[size_t(3 * i)]);
        normals.insert(normals.end(), normal, normal + 3);
        two_sided[i] = mesh.two_sided[f];
        own.push_back(hiders.row[size_t(f)]);
    }
    area::judge_points<Camera>(
        {{points.data(), {n}}, {normals.data(), {n}}, two_sided.rows(), {own.data(), {n}}}, camera,
        in_units_of(rules, hiders.diagonal), {{rotation, {}}, {eye, {}}, depth, MARGIN_REL},
        tree_of(hiders), {out.reasons, {n}}, {hit.data(), {n}});
    for (int64_t i = 0; i < n; i++) {
        const bool is_flat = !(mesh.areas[asked.faces[i]] > 0);
        if (is_flat) out.reasons[i] = coverage::DEGENERATE;
        const int64_t at = is_flat ? -1 : hit[size_t(i)];
        out.hiders[i] = at < 0 ? -1 : int32_t(hiders.faces[size_t(at)]);
    }
}

// Places that are outside of bodies and keep a distance from every surface.
void find_clear(const SurfaceObject &surface, const double *points, int64_t n, double distance,
                uint8_t *is_clear) {
    const Hiders &hiders = hiders_of(surface);
    const engine::MeshArrays &mesh = *surface.mesh.arrays;
    const double least = distance / hiders.diagonal;
    const auto [corners, nodes, _, is_nearest] = tree_of(hiders);
    mesh::Hits hits = {corners, nodes, is_nearest};
    const auto counts = [&](int64_t t) { return !mesh.two_sided[hiders.faces[size_t(t)]]; };
    for (int64_t i = 0; i < n; i++) {
        double at[3];
        hiders.place(points + 3 * i, at);
        const mesh::NearestPoint near = mesh::nearest_to({at, {}}, hits.corners, hits.nodes);
        is_clear[i] =
            near.squared >= least * least && !mesh::is_behind(hits, {at[0], at[1], at[2]}, counts);
    }
}

void check_points(int64_t n, const double *points) {
    expect(n >= 0 && n <= MOST_FACES, "0 to 715827882 points", n, "pass the number of rows");
    if (n > 0) expect_array(points, "points");
    for (int64_t k = 0; k < 3 * n; k++)
        expect(std::abs(points[k]) <= engine::LARGEST_COORDINATE, "finite points", points[k],
               "pass points in metres");
}
} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_judge_points(const rc_surface *surface, const rc_camera *camera, const rc_task *task,
                          const double *pose, int64_t n_points, const double *points,
                          const int32_t *faces, const rc_failures *failures) {
    return guard("judging points", [&] {
        const auto object = object_of(surface);
        check_camera(camera);
        expect_array(task, "task");
        const Rules rules = rules_of(*task);
        expect_array(pose, "pose");
        check_pose(pose);
        check_points(n_points, points);
        if (n_points == 0) return;
        expect_array(faces, "faces");
        expect_array(failures, "failures");
        expect_array(failures->reasons, "reasons");
        expect_array(failures->hiders, "hiders");
        const int64_t n = object->mesh.n_faces();
        for (int64_t i = 0; i < n_points; i++)
            expect(faces[i] >= 0 && faces[i] < n, "indices of faces", faces[i],
                   "count faces from 0");
        const Asked asked = {points, faces, n_points};
        const double near = camera->near;
        if (const auto lens = lens_of(*camera)) {
            judge(*object, lens->curved, near, rules, pose, asked, *failures);
        } else {
            judge(*object, pinhole_of(*camera), near, rules, pose, asked, *failures);
        }
    });
}

rc_status rc_clear_places(const rc_surface *surface, int64_t n_points, const double *points,
                          double distance, uint8_t *is_clear) {
    return guard("places for a camera", [&] {
        const auto object = object_of(surface);
        check_points(n_points, points);
        expect(distance >= 0 && distance <= engine::LARGEST_COORDINATE, "a distance of 0 m or more",
               distance, "pass metres");
        if (n_points == 0) return;
        expect_array(is_clear, "is_clear");
        find_clear(*object, points, n_points, distance, is_clear);
    });
}
