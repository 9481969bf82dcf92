// The border to C: what include/rastercov.h declares. Arguments are checked here, once; every error
// becomes a code and a text.
//
// Twin: tests/native/test_c_border.py, by Python.
#include "c/partition.hpp"
#include "camera/look_at.hpp"
#include <bit>

namespace rastercov::c {
namespace {
void check_image(const rc_camera *camera) {
    expect_array(camera, "camera");
    expect(camera->size == sizeof(rc_camera), "size of sizeof(rc_camera) bytes",
           double(camera->size), "set it, and compile against the header of the library");
    for (const double each : {camera->width, camera->height, camera->fx, camera->fy})
        expect(each >= 1e-6 && each <= 1e9, "width, height, fx and fy of 1e-6 to 1e9 px", each,
               "convert them to pixels");
    for (const double each : {camera->cx, camera->cy})
        expect(std::abs(each) <= 1e9, "cx and cy within 1e9 px", each, "convert them to pixels");
    expect(camera->near >= 0.0 && camera->near <= engine::LARGEST_COORDINATE, "near of 0 to 1e30 m",
           camera->near, "pass 0 for the default");
    if (!camera->lens) return;
    const CurvedLens &of_lens = object_of(camera->lens)->curved;
    const double proved[] = {of_lens.width, of_lens.height};
    const auto is_proved = std::equal(proved, proved + 2, &camera->width) &&
                           std::equal(&camera->fx, &camera->fx + 4, of_lens.params.begin());
    expect(is_proved, "width, height, fx, fy, cx and cy of its lens", camera->fx,
           "make a lens of this camera");
}

// Of calls that take parallel rays, too.
void check_any(const rc_camera *camera) {
    check_image(camera);
    const int32_t of = camera->is_parallel;
    expect(of == 0 || (of == 1 && !camera->lens), "is_parallel of 0, or of 1 without a lens", of,
           "set all fields");
}
} // namespace

void check_camera(const rc_camera *camera) {
    check_image(camera);
    expect(camera->is_parallel == 0, "rays through a point", camera->is_parallel,
           "use rc_observe or rc_find_regions");
}

void check_pose(const double *pose) {
    for (int k = 0; k < 16; k++)
        expect(std::abs(pose[k]) <= engine::LARGEST_COORDINATE, "finite numbers in a pose", pose[k],
               "pass world_from_camera in metres");
    for (int k = 0; k < 4; k++)
        expect(pose[12 + k] == (k == 3 ? 1.0 : 0.0), "0 0 0 1 as the last row of a pose",
               pose[12 + k], "pass world_from_camera row by row");
    const auto at = [&](int i, int k) { return pose[4 * i + k]; };
    for (int i = 0; i < 3; i++)
        for (int k = i; k < 3; k++) {
            double product = 0.0;
            for (int row = 0; row < 3; row++) product += at(row, i) * at(row, k);
            expect(std::abs(product - (i == k)) <= RIGID,
                   "orthonormal columns in the rotation of a pose", product,
                   "remove scale and shear");
        }
    double volume = 0.0;
    for (int k = 0; k < 3; k++)
        volume += at(k, 0) * (at((k + 1) % 3, 1) * at((k + 2) % 3, 2) -
                              at((k + 2) % 3, 1) * at((k + 1) % 3, 2));
    expect(volume > 0.0, "a rotation of determinant 1 in a pose", volume, "do not mirror an axis");
}

Rules rules_of(const rc_task &task) {
    expect(task.min_depth >= 0.0, "min_depth of 0 m or more", task.min_depth,
           "pass 0 for no limit");
    expect(task.max_depth >= task.min_depth, "max_depth of at least min_depth", task.max_depth,
           "pass INFINITY for no limit");
    expect(task.max_incidence_deg > 0.0 && task.max_incidence_deg <= 90.0,
           "max_incidence_deg above 0 and at most 90", task.max_incidence_deg,
           "pass 90 for no limit");
    for (const double each :
         {task.min_pixel_density, task.min_facing_density, task.min_pixels_per_m2})
        expect(each >= 0.0 && each <= 1e300, "densities of 0 to 1e300", each,
               "pass 0 for no limit");
    const double angle = task.max_incidence_deg * (3.14159265358979323846 / 180.0);
    const bool is_limited = task.max_incidence_deg < 90.0;
    return {.min_pixels = 1.0,
            .min_visibility = 0.0,
            .min_coverage = 0.0,
            .min_pixel_density = task.min_pixel_density,
            .min_facing_density = task.min_facing_density,
            .min_pixels_per_m2 = task.min_pixels_per_m2,
            .z_n = task.min_depth,
            .z_f = task.max_depth,
            .max_incidence = angle,
            .cos_incidence = is_limited ? cosine_of(angle) : 0.0,
            .tan_incidence = is_limited ? tangent_of(angle) : 0.0,
            .focus_of_centroid = false,
            .cap_resolution = true};
}

void check_faces(const SurfaceObject &surface, int64_t n_faces) {
    expect(n_faces == surface.mesh.n_faces(), "arrays for all faces of the surface", n_faces,
           "pass one element for each");
}

// Corners in space of polygons in the planes of their faces.
void write_corners(const SurfaceObject &surface, const std::vector<int32_t> &faces,
                   const int32_t *counts, const double *xy, double *corners) {
    const engine::MeshArrays &mesh = *surface.mesh.arrays;
    const auto origin = mesh.origin.rows<3>(), x_axis = mesh.x_axis.rows<3>(),
               y_axis = mesh.y_axis.rows<3>();
    for (size_t p = 0; p < faces.size(); p++) {
        const int32_t f = faces[p];
        for (int32_t i = 0; i < counts[p]; i++, xy += 2)
            for (int axis = 0; axis < 3; axis++)
                *corners++ = origin(f, axis) + xy[0] * x_axis(f, axis) + xy[1] * y_axis(f, axis);
    }
}

Placed::Placed(const double *poses, int64_t n) {
    expect(n >= 0 && n <= MOST_FACES, "0 to 715827882 poses", n, "pass the number of matrices");
    if (n > 0) expect_array(poses, "poses");
    for (int64_t p = 0; p < n; p++) check_pose(poses + 16 * p);
    if (n > 0) matrices.assign(poses, poses + 16 * n);
    camera.assign(size_t(n), 0);
    for (int64_t p = 0; p < n; p++) rows.push_back(p);
}

namespace {
// True where numbers are equal, bit for bit.
bool have_bits_of(const double *some, const double *others, int n) {
    return std::equal(some, some + n, others, [](double a, double b) {
        return std::bit_cast<uint64_t>(a) == std::bit_cast<uint64_t>(b);
    });
}
} // namespace

std::shared_ptr<engine::Pass> pass_of(SolverObject &solver, const rc_camera &camera,
                                      const LensPointer &lens_object, const rc_task *task) {
    const std::scoped_lock lock(solver.changes);
    const bool is_same = solver.pass && solver.lens == lens_object &&
                         have_bits_of(&solver.camera.width, &camera.width, 7) &&
                         solver.camera.is_parallel == camera.is_parallel &&
                         solver.has_task == (task != nullptr) &&
                         (!task || have_bits_of(&solver.task.min_depth, &task->min_depth, 6));
    if (is_same) return solver.pass;
    const Lens lens = pinhole_of(camera);
    auto pass = std::make_shared<engine::Pass>(solver.is_certifying, task || lens_object, 1,
                                               solver.n_threads);
    std::shared_ptr<engine::CameraTask> criteria;
    if (task && lens_object) {
        criteria = lens_object->task_of(rules_of(*task));
    } else if (task) {
        criteria = std::make_shared<engine::CameraTask>();
        area::LensCriteria of_pinhole = {};
        of_pinhole.pinhole = {lens, rules_of(*task), GAP_REL, 0.0, false};
        criteria->planes.push_back(of_pinhole);
    }
    auto image = std::make_shared<engine::Camera>();
    image->image = lens;
    image->near = camera.near;
    image->is_parallel = camera.is_parallel != 0;
    if (lens_object) image->planes = lens_object->planes;
    solver.lens = lens_object;
    pass->set_camera(0, std::move(image), std::move(criteria));
    solver.camera = camera;
    solver.has_task = task != nullptr;
    if (task) solver.task = *task;
    solver.pass = pass;
    return pass;
}

RegionsList::RegionsList(const rc_regions *const *regions, int64_t n,
                         std::shared_ptr<const SurfaceObject> of)
    : surface(std::move(of)) {
    expect(n >= 0 && n <= MOST_FACES, "0 to 715827882 regions", n, "pass the number of handles");
    if (n > 0) expect_array(regions, "regions");
    for (int64_t k = 0; k < n; k++) {
        kept.push_back(object_of(regions[k]));
        if (!surface) surface = kept.back()->surface;
        require(surface == kept.back()->surface,
                "expected regions of one surface, got those of another one too; keep those of each "
                "surface apart");
        for (const engine::Regions &each : kept.back()->poses) poses.push_back(&each);
    }
}

void add_poses(engine::Union &to, const std::vector<const engine::Regions *> &poses) {
    engine::Regions all;
    std::vector<int64_t> starts = {0};
    std::vector<int32_t> pose, pair_pose;
    for (size_t p = 0; p < poses.size(); p++) {
        const engine::Regions &own = *poses[p];
        all.xy.insert(all.xy.end(), own.xy.begin(), own.xy.end());
        all.face.insert(all.face.end(), own.face.begin(), own.face.end());
        all.listed.insert(all.listed.end(), own.listed.begin(), own.listed.end());
        all.area.insert(all.area.end(), own.area.begin(), own.area.end());
        all.bound.insert(all.bound.end(), own.bound.begin(), own.bound.end());
        all.excess.insert(all.excess.end(), own.excess.begin(), own.excess.end());
        for (const int64_t n : own.n_corners) starts.push_back(starts.back() + n);
        pose.resize(all.face.size(), int32_t(p));
        pair_pose.resize(all.listed.size(), int32_t(p));
    }
    const auto n = int64_t(pose.size()), n_pairs = int64_t(pair_pose.size());
    const engine::RegionPieces pieces = {{all.xy.data(), {int64_t(all.xy.size() / 2)}},
                                         {starts.data(), {n + 1}},
                                         {all.face.data(), {n}},
                                         {pose.data(), {n}}};
    const engine::RegionPairs pairs = {{pair_pose.data(), {n_pairs}},
                                       {all.listed.data(), {n_pairs}},
                                       {all.area.data(), {n_pairs}},
                                       {all.bound.data(), {n_pairs}},
                                       {all.excess.data(), {n_pairs}}};
    to.add(pieces, pairs, {}, {});
}
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

int rc_version(void) { return RC_API_VERSION; }
const char *rc_last_error(void) { return last_error().c_str(); }
rc_status rc_count_handles(int64_t *count) {
    return guard("counting handles", [&] { *expect_result(count) = handles().count(); });
}

rc_status rc_surface_create(const double *vertices, int64_t n_vertices, const int32_t *faces,
                            int64_t n_faces, const uint8_t *roles, rc_surface **surface) {
    return guard("making a surface", [&] {
        expect_result(surface);
        expect(n_vertices > 0 && n_vertices <= INT32_MAX, "1 to 2147483647 vertices", n_vertices,
               "pass the number of rows");
        expect(n_faces > 0 && n_faces <= MOST_FACES, "1 to 715827882 faces", n_faces,
               "pass the number of rows, or split the mesh");
        expect_array(vertices, "vertices");
        expect_array(faces, "faces");
        for (int64_t f = 0; roles && f < n_faces; f++)
            expect(roles[f] < 16, "roles of 0 to 15", roles[f], "see RC_OCCLUDER");
        const auto made = std::make_shared<SurfaceObject>();
        made->mesh = engine::make_mesh({vertices, {n_vertices}}, {faces, {n_faces}},
                                       {roles, {roles ? n_faces : 0}});
        *surface = handles().add<rc_surface>(made);
    });
}
rc_status rc_surface_free(rc_surface *surface) { return free_handle(surface); }
rc_status rc_surface_areas(const rc_surface *surface, int64_t n_faces, double *areas) {
    return guard("reading areas", [&] {
        const auto object = object_of(surface);
        check_faces(*object, n_faces);
        const auto own = object->mesh.arrays->areas.rows();
        std::copy(own.begin(), own.end(), expect_result(areas));
    });
}

rc_status rc_solver_create(const rc_surface *surface, int32_t method, int32_t n_threads,
                           rc_solver **solver) {
    return guard("making a solver", [&] {
        expect_result(solver);
        expect(method == RC_CERTIFIED || method == RC_EXACT, "RC_CERTIFIED or RC_EXACT", method,
               "pass one of them");
        expect(n_threads >= 1 && n_threads <= MOST_THREADS, "1 to 1024 threads", n_threads,
               "pass the number of processor cores");
        const auto made = std::make_shared<SolverObject>();
        made->surface = object_of(surface);
        made->is_certifying = method == RC_CERTIFIED;
        made->n_threads = n_threads;
        *solver = handles().add<rc_solver>(made);
    });
}
rc_status rc_solver_free(rc_solver *solver) { return free_handle(solver); }

rc_status rc_observe(rc_solver *solver, const rc_camera *camera, const double *poses,
                     int64_t n_poses, rc_go_on go_on, void *context, const rc_figures *figures) {
    return guard("observing poses", [&] {
        const auto object = object_of(solver);
        check_any(camera);
        expect_array(figures, "figures");
        const engine::Mesh &mesh = object->surface->mesh;
        const Placed placed(poses, n_poses);
        if (n_poses == 0) return;
        expect_arrays("each of figures", figures->visible, figures->area, figures->area_error,
                      figures->is_certified);
        const int64_t n_faces = mesh.n_faces();
        const std::array<int64_t, 2> shape = {n_poses, n_faces};
        const auto clipped = std::make_unique<bool[]>(size_t(n_poses));
        engine::Job job = {mesh.surface, placed.poses(), {}, nullptr, {}};
        job.figures = {{figures->visible, shape},
                       {figures->area, shape},
                       {figures->is_certified, shape},
                       {figures->area_error, shape},
                       {clipped.get(), {n_poses}}};
        uint8_t *const kinds = figures->is_certified;
        const auto pass = pass_of(*object, *camera, lens_of(*camera), nullptr);
        std::fill_n(kinds, n_poses * n_faces, uint8_t(engine::EXACT));
        struct AtEnd { // also of rows that are finished where another one fails
            uint8_t *first, *last;
            ~AtEnd() {
                for (; first != last; first++) *first = *first != engine::EXACT;
            }
        } at_end = {kinds, kinds + n_poses * n_faces};
        pass->run(job, object->n_threads, go_on_of(go_on, context));
    });
}

std::shared_ptr<RegionsObject> c::found_by(SolverObject &solver, const rc_camera &camera,
                                           const LensPointer &lens, const rc_task &task,
                                           const Placed &placed, const engine::GoOn &go_on) {
    const engine::Mesh &mesh = solver.surface->mesh;
    const area::Planes planes = mesh.arrays->planes();
    const engine::Job job = {mesh.surface, placed.poses(), {}, &planes, {}};
    auto made = std::make_shared<RegionsObject>();
    made->surface = solver.surface;
    made->poses = pass_of(solver, camera, lens, &task)->run(job, solver.n_threads, go_on);
    return made;
}

rc_status rc_look_at(const double *eye, const double *target, const double *up, double *pose) {
    return guard("looking at a point", [&] {
        constexpr double Z[] = {0.0, 0.0, 1.0};
        if (!up) up = Z;
        expect_arrays("eye, target and pose", eye, target, pose);
        for (const double *each : {eye, target, up})
            for (int k = 0; k < 3; k++)
                expect(std::abs(each[k]) <= engine::LARGEST_COORDINATE,
                       "eye, target and up within 1e30 m", each[k], "convert them to metres");
        expect(!std::equal(eye, eye + 3, target), "eye and target at different points", *eye,
               "move one of them");
        write_pose(eye, target, up, pose);
    });
}

rc_task rc_task_default(void) { return {0.0, INFINITY, 90.0, 0.0, 0.0, 0.0}; }

rc_status rc_find_regions(rc_solver *solver, const rc_camera *camera, const rc_task *task,
                          const double *poses, int64_t n_poses, rc_go_on go_on, void *context,
                          rc_regions **regions) {
    return guard("finding regions", [&] {
        expect_result(regions);
        const auto object = object_of(solver);
        check_any(camera);
        expect_array(task, "task");
        rules_of(*task);
        *regions =
            handles().add<rc_regions>(found_by(*object, *camera, lens_of(*camera), *task,
                                               Placed(poses, n_poses), go_on_of(go_on, context)));
    });
}
rc_status rc_regions_free(rc_regions *regions) { return free_handle(regions); }

rc_status rc_regions_areas(const rc_regions *regions, int64_t pose, int64_t n_poses,
                           int64_t n_faces, double *areas, double *bounds) {
    return guard("reading areas", [&] {
        const auto object = object_of(regions);
        const auto all = int64_t(object->poses.size());
        expect(n_poses >= 1 && n_poses <= all, "1 to all poses", n_poses, "pass 1 for one");
        pose_of(*object, pose);
        pose_of(*object, pose + (n_poses - 1));
        check_faces(*object->surface, n_faces);
        expect_array(areas, "areas");
        expect_array(bounds, "bounds");
        std::fill_n(areas, n_poses * n_faces, 0.0);
        std::fill_n(bounds, n_poses * n_faces, 0.0);
        for (; n_poses-- > 0; areas += n_faces, bounds += n_faces) {
            const engine::Regions &own = object->poses[size_t(pose++)];
            for (size_t k = 0; k < own.listed.size(); k++) {
                areas[own.listed[k]] = own.area[k];
                bounds[own.listed[k]] = own.bound[k];
            }
        }
    });
}

rc_status rc_regions_size(const rc_regions *regions, int64_t pose, int64_t *n_polygons,
                          int64_t *n_corners) {
    return guard("reading regions", [&] {
        const auto object = object_of(regions);
        const engine::Regions &own = pose_of(*object, pose);
        expect_array(n_polygons, "n_polygons");
        expect_array(n_corners, "n_corners");
        *n_polygons = int64_t(own.face.size());
        *n_corners = int64_t(own.xy.size() / 2);
    });
}

rc_status rc_regions_read(const rc_regions *regions, int64_t pose, int64_t n_polygons,
                          int64_t n_corners, int32_t *faces, int32_t *counts, double *corners) {
    return guard("reading regions", [&] {
        const auto object = object_of(regions);
        const engine::Regions &own = pose_of(*object, pose);
        expect(n_polygons == int64_t(own.face.size()) && n_corners == int64_t(own.xy.size() / 2),
               "n_polygons and n_corners of rc_regions_size", n_polygons,
               "call it for this pose first");
        if (own.face.empty()) return;
        expect_array(faces, "faces");
        expect_array(counts, "counts");
        expect_array(corners, "corners");
        for (size_t p = 0; p < own.face.size(); p++) {
            faces[p] = own.face[p];
            counts[p] = int32_t(own.n_corners[p]);
        }
        write_corners(*object->surface, own.face, counts, own.xy.data(), corners);
    });
}

rc_status rc_union_create(const rc_surface *surface, int32_t views, rc_union **unite) {
    return guard("making a union", [&] {
        expect_result(unite);
        expect(views >= 1 && views <= MOST_VIEWS, "views of 1 to 10000", views,
               "pass the largest number of poses to count");
        *unite = handles().add<rc_union>(union_of(object_of(surface), views));
    });
}
rc_status rc_union_free(rc_union *unite) { return free_handle(unite); }

rc_status rc_union_add(rc_union *unite, const rc_regions *regions) {
    return rc_union_add_all(unite, &regions, 1);
}
rc_status rc_union_add_all(rc_union *unite, const rc_regions *const *regions, int64_t n) {
    return guard("uniting regions", [&] {
        const auto object = object_of(unite);
        const RegionsList all(regions, n, object->surface);
        const std::scoped_lock lock(object->changes);
        add_poses(*object->all, all.poses);
    });
}

rc_status rc_union_areas(const rc_union *unite, int32_t views, int64_t n_faces, double *areas,
                         double *bounds) {
    return guard("reading areas", [&] {
        const auto object = object_of(unite);
        check_faces(*object->surface, n_faces);
        expect_array(areas, "areas");
        expect_array(bounds, "bounds");
        const std::scoped_lock lock(object->changes);
        expect(views >= 1 && views <= object->all->views(),
               "views of 1 to those of rc_union_create", views, "create a union with more views");
        std::copy_n(object->all->areas(views).data() + (views - 1) * n_faces, n_faces, areas);
        std::copy_n(object->all->bounds().data(), n_faces, bounds);
    });
}
