// The border to C: closed forms, errors as codes and texts, stops, callbacks that throw.
#include "scenes.hpp"
#include <cmath>
#include <doctest.h>
#include <stdexcept>
#include <string>
#include <thread>

namespace {
double total(const std::vector<double> &values) {
    double sum = 0.0;
    for (const double each : values) sum += each;
    return sum;
}
bool says(const char *words) {
    return std::string(rc_last_error()).find(words) != std::string::npos;
}
} // namespace

TEST_CASE("a box from above shows its lid, by area and by pixels, in any number of threads") {
    const Scene scene;
    const int64_t before = n_handles(), n = scene.n_faces(), n_poses = 40;
    rc_surface *surface = scene.surface();
    const auto poses = scene.poses(n_poses);
    for (const rc_method method : {RC_CERTIFIED, RC_EXACT})
        for (const int32_t threads : {1, 3}) {
            rc_solver *solver = nullptr;
            rc_regions *regions = nullptr;
            REQUIRE(rc_solver_create(surface, method, threads, &solver) == RC_OK);
            Figures figures(n_poses * n, -1.0);
            const rc_figures out = figures.out();
            REQUIRE(rc_observe(solver, &scene.camera, poses.data(), n_poses, nullptr, nullptr,
                               &out) == RC_OK);
            REQUIRE(rc_find_regions(solver, &scene.camera, &scene.task, poses.data(), n_poses,
                                    nullptr, nullptr, &regions) == RC_OK);
            std::vector<double> all(size_t(n_poses * n)), all_bounds(all);
            REQUIRE(rc_regions_areas(regions, 0, n_poses, n, all.data(), all_bounds.data()) ==
                    RC_OK);
            for (int64_t p = 0; p < n_poses; p++) {
                const double side = 800.0 / (3.0 + double(p)); // px
                double seen = 0.0, error = 0.0;
                for (int64_t f = 0; f < n; f++) {
                    seen += figures.visible[size_t(p * n + f)];
                    error += figures.error[size_t(p * n + f)];
                }
                CHECK(std::abs(seen - side * side) <= error + 1e-6);
                std::vector<double> areas(static_cast<size_t>(n)), bounds(areas);
                REQUIRE(rc_regions_areas(regions, p, 1, n, areas.data(), bounds.data()) == RC_OK);
                CHECK(std::equal(areas.begin(), areas.end(), all.begin() + p * n));
                CHECK(std::equal(bounds.begin(), bounds.end(), all_bounds.begin() + p * n));
                CHECK(std::abs(total(areas) - 1.0) <= total(bounds) + 1e-12);
            }
            CHECK(rc_regions_free(regions) == RC_OK);
            CHECK(rc_solver_free(solver) == RC_OK);
        }
    CHECK(rc_surface_free(surface) == RC_OK);
    CHECK(n_handles() == before);
}

TEST_CASE("regions are polygons in space; a union counts poses") {
    const Scene scene;
    const int64_t n = scene.n_faces();
    rc_surface *surface = scene.surface();
    rc_solver *solver = nullptr;
    rc_regions *regions = nullptr;
    rc_union *all = nullptr;
    REQUIRE(rc_solver_create(surface, RC_CERTIFIED, 1, &solver) == RC_OK);
    const auto poses = scene.poses(2);
    REQUIRE(rc_find_regions(solver, &scene.camera, &scene.task, poses.data(), 2, nullptr, nullptr,
                            &regions) == RC_OK);
    int64_t n_polygons = 0, n_corners = 0;
    REQUIRE(rc_regions_size(regions, 1, &n_polygons, &n_corners) == RC_OK);
    CHECK(n_polygons == 2);
    std::vector<int32_t> faces(static_cast<size_t>(n_polygons)), counts(faces);
    std::vector<double> corners(size_t(3 * n_corners));
    REQUIRE(rc_regions_read(regions, 1, n_polygons, n_corners, faces.data(), counts.data(),
                            corners.data()) == RC_OK);
    CHECK(counts[0] + counts[1] == n_corners);
    for (int64_t k = 0; k < n_corners; k++)
        CHECK(corners[size_t(3 * k + 2)] == doctest::Approx(1.0));
    REQUIRE(rc_union_create(surface, 3, &all) == RC_OK);
    REQUIRE(rc_union_add(all, regions) == RC_OK);
    std::vector<double> areas(static_cast<size_t>(n)), bounds(areas);
    for (const auto &[views, area] : {std::pair(1, 1.0), std::pair(2, 1.0), std::pair(3, 0.0)}) {
        REQUIRE(rc_union_areas(all, views, n, areas.data(), bounds.data()) == RC_OK);
        CHECK(std::abs(total(areas) - area) <= total(bounds) + 1e-12);
    }
    CHECK(rc_union_areas(all, 4, n, areas.data(), bounds.data()) == RC_BAD_ARGUMENT);
    CHECK(rc_surface_free(surface) == RC_OK); // what was made of it lives on
    CHECK(rc_union_add(all, regions) == RC_OK);
    REQUIRE(rc_union_areas(all, 3, n, areas.data(), bounds.data()) == RC_OK);
    CHECK(total(areas) == doctest::Approx(1.0));
    CHECK(rc_union_free(all) == RC_OK);
    CHECK(rc_regions_free(regions) == RC_OK);
    CHECK(rc_solver_free(solver) == RC_OK);
}

TEST_CASE("a callback ends a batch; finished rows stay, and the solver goes on") {
    const Scene scene;
    const int64_t n = scene.n_faces(), n_poses = 30;
    rc_surface *surface = scene.surface();
    rc_solver *solver = nullptr;
    REQUIRE(rc_solver_create(surface, RC_CERTIFIED, 1, &solver) == RC_OK);
    const auto poses = scene.poses(n_poses);
    Figures figures(n_poses * n, -1.0);
    const rc_figures out = figures.out();
    int left = 10;
    const auto count_down = [](void *context) { return int(--*static_cast<int *>(context) > 0); };
    CHECK(rc_observe(solver, &scene.camera, poses.data(), n_poses, count_down, &left, &out) ==
          RC_STOPPED);
    CHECK(says("stopped by the callback"));
    CHECK(figures.area[size_t(9 * n + 2)] > 0.0);
    CHECK(figures.area[size_t(10 * n + 2)] == -1.0);
    const auto fail = [](void *) -> int { throw std::runtime_error("no more of this"); };
    CHECK(rc_observe(solver, &scene.camera, poses.data(), n_poses, fail, nullptr, &out) ==
          RC_FAILED);
    CHECK(says("no more of this"));
    const auto fail_oddly = [](void *) -> int { throw 3; };
    CHECK(rc_observe(solver, &scene.camera, poses.data(), n_poses, fail_oddly, nullptr, &out) ==
          RC_FAILED);
    CHECK(rc_observe(solver, &scene.camera, poses.data(), n_poses, nullptr, nullptr, &out) ==
          RC_OK);
    for (const double each : figures.area) CHECK(each >= 0.0);
    for (const uint8_t each : figures.certified) CHECK(each <= 1);
    CHECK(rc_solver_free(solver) == RC_OK);
    CHECK(rc_surface_free(surface) == RC_OK);
}

TEST_CASE("handles that are null, freed or of another kind are refused") {
    const Scene scene;
    rc_surface *surface = scene.surface();
    rc_solver *solver = nullptr;
    std::vector<double> areas(size_t(scene.n_faces()));
    CHECK(rc_surface_areas(nullptr, 12, areas.data()) == RC_BAD_HANDLE);
    CHECK(says("got null"));
    CHECK(rc_surface_areas(reinterpret_cast<rc_surface *>(&areas), 12, areas.data()) ==
          RC_BAD_HANDLE);
    CHECK(rc_solver_free(reinterpret_cast<rc_solver *>(surface)) == RC_BAD_HANDLE);
    CHECK(rc_surface_free(surface) == RC_OK);
    CHECK(rc_surface_free(surface) == RC_BAD_HANDLE);
    CHECK(says("freed or has another type"));
    rc_surface *next = scene.surface();
    CHECK(next != surface); // no number is used again
    CHECK(rc_solver_create(surface, RC_EXACT, 1, &solver) == RC_BAD_HANDLE);
    CHECK(solver == nullptr);
    CHECK(rc_surface_free(next) == RC_OK);
}

TEST_CASE("what is asked for in vain has a code and a line") {
    const Scene scene;
    rc_surface *surface = scene.surface(), *none = nullptr;
    const auto refused = [](rc_status status, const char *words) {
        CHECK(status == RC_BAD_ARGUMENT);
        CHECK(says(words));
        CHECK(!says("\n"));
    };
    refused(rc_surface_create(scene.vertices.data(), 8, scene.faces.data(), int64_t(1) << 31,
                              nullptr, &none),
            "split the mesh");
    refused(rc_surface_create(scene.vertices.data(), 8, scene.faces.data(), -1, nullptr, &none),
            "expected 1 to 715827882 faces, got -1");
    refused(rc_surface_create(scene.vertices.data(), 7, scene.faces.data(), 12, nullptr, &none),
            "faces with indices of vertices, got 7; count");
    refused(rc_surface_create(nullptr, 8, scene.faces.data(), 12, nullptr, &none), "got null");
    refused(rc_surface_create(scene.vertices.data(), 8, scene.faces.data(), 12, nullptr, nullptr),
            "got null");
    const std::vector<uint8_t> roles(12, 16);
    refused(
        rc_surface_create(scene.vertices.data(), 8, scene.faces.data(), 12, roles.data(), &none),
        "roles of 0 to 15, got 16");
    rc_solver *solver = nullptr;
    refused(rc_solver_create(surface, 7, 1, &solver), "RC_CERTIFIED or RC_EXACT");
    refused(rc_solver_create(surface, RC_EXACT, 0, &solver), "1 to 1024 threads");
    REQUIRE(rc_solver_create(surface, RC_EXACT, 1, &solver) == RC_OK);
    auto poses = scene.poses(1);
    rc_regions *regions = nullptr;
    const auto find = [&](const rc_camera &camera, const rc_task &task) {
        return rc_find_regions(solver, &camera, &task, poses.data(), 1, nullptr, nullptr, &regions);
    };
    rc_camera camera = scene.camera;
    camera.fx = NAN;
    refused(find(camera, scene.task), "fx and fy");
    for (const int32_t size :
         {0, int32_t(sizeof(rc_camera)) - 8, int32_t(sizeof(rc_camera)) + 8, -1}) {
        camera = scene.camera;
        camera.size = size;
        refused(find(camera, scene.task), "size of sizeof(rc_camera) bytes");
    }
    rc_task task = scene.task;
    task.max_incidence_deg = 91;
    refused(find(scene.camera, task), "max_incidence_deg");
    task = scene.task;
    task.min_depth = NAN;
    refused(find(scene.camera, task), "min_depth");
    poses[3] = NAN;
    refused(find(scene.camera, scene.task), "finite numbers in a pose");
    poses = scene.poses(1);
    poses[0] = -1; // a reflection
    refused(find(scene.camera, scene.task), "determinant 1");
    poses[0] = 2;
    refused(find(scene.camera, scene.task), "remove scale");
    poses = scene.poses(1);
    poses[15] = 2;
    refused(find(scene.camera, scene.task), "last row");
    CHECK(regions == nullptr);
    CHECK(rc_solver_free(solver) == RC_OK);
    CHECK(rc_surface_free(surface) == RC_OK);
}

TEST_CASE("each null, and each size that is none, has a code and writes nothing") {
    const Scene scene;
    rc_surface *surface = scene.surface(), *no_surface = nullptr;
    rc_solver *solver = nullptr, *no_solver = nullptr;
    rc_regions *regions = nullptr, *none = nullptr;
    rc_union *all = nullptr, *no_union = nullptr;
    const auto poses = scene.poses(2);
    const double *vertices = scene.vertices.data(), *at = poses.data();
    const int32_t *faces = scene.faces.data();
    const auto *by = &scene.camera;
    const auto *task = &scene.task;
    REQUIRE(rc_solver_create(surface, RC_EXACT, 1, &solver) == RC_OK);
    REQUIRE(rc_find_regions(solver, by, task, at, 2, nullptr, nullptr, &regions) == RC_OK);
    REQUIRE(rc_union_create(surface, 2, &all) == RC_OK);
    int64_t n_polygons = 0, n_corners = 0, other = -7;
    REQUIRE(rc_regions_size(regions, 0, &n_polygons, &n_corners) == RC_OK);
    std::vector<double> a(100, -7), b(100, -7);
    std::vector<int32_t> counts(100, -7);
    Figures figures(24, -7.0);
    const int64_t before = n_handles();
    const auto refused = [](rc_status status) {
        CHECK((status == RC_BAD_ARGUMENT || status == RC_BAD_HANDLE));
        CHECK(says("expected "));
    };
    const rc_figures out = figures.out();
    for (int k = 0; k < 4; k++) {
        rc_figures some = out;
        if (k == 3) some.is_certified = nullptr;
        else (k == 0 ? some.visible : k == 1 ? some.area : some.area_error) = nullptr;
        refused(rc_observe(solver, by, at, 2, nullptr, nullptr, &some));
    }
    refused(rc_observe(nullptr, by, at, 2, nullptr, nullptr, &out));
    refused(rc_observe(solver, nullptr, at, 2, nullptr, nullptr, &out));
    refused(rc_observe(solver, by, nullptr, 2, nullptr, nullptr, &out));
    refused(rc_observe(solver, by, at, 2, nullptr, nullptr, nullptr));
    refused(rc_find_regions(nullptr, by, task, at, 2, nullptr, nullptr, &none));
    refused(rc_find_regions(solver, nullptr, task, at, 2, nullptr, nullptr, &none));
    refused(rc_find_regions(solver, by, nullptr, at, 2, nullptr, nullptr, &none));
    refused(rc_find_regions(solver, by, task, nullptr, 2, nullptr, nullptr, &none));
    refused(rc_find_regions(solver, by, task, at, 2, nullptr, nullptr, nullptr));
    refused(rc_surface_create(vertices, 8, nullptr, 12, nullptr, &no_surface));
    refused(rc_solver_create(surface, RC_EXACT, 1, nullptr));
    refused(rc_union_create(surface, 2, nullptr));
    refused(rc_union_add(all, nullptr));
    const rc_lit lit = {sizeof(rc_lit), a.data(), a.data(), a.data()};
    for (int k = 0; k < 4; k++) {
        rc_lit some = lit;
        (k == 0 ? some.lit : k == 1 ? some.whole : some.bound) = nullptr;
        if (k == 3) some = {sizeof(rc_lit) + 8, a.data(), a.data(), a.data()};
        refused(rc_sunlit(solver, b.data(), 1, nullptr, nullptr, &some));
    }
    refused(rc_sunlit(nullptr, at, 1, nullptr, nullptr, &lit));
    refused(rc_sunlit(solver, nullptr, 1, nullptr, nullptr, &lit));
    refused(rc_sunlit(solver, at, 1, nullptr, nullptr, nullptr));
    const rc_search search = {sizeof(rc_search), 2, 0.0, 0, 12, nullptr};
    int64_t rows[2] = {-7, -7}, n_rows = -7;
    const std::vector<int32_t> no_views(12, 0);
    for (int k = 0; k < 7; k++) {
        rc_search some = search;
        if (k == 0) some.size -= 8;
        if (k == 1) some.most = 0;
        if (k == 2) some.least = NAN;
        if (k == 3) some.n_given = 3;
        if (k == 4) some.n_given = -1;
        if (k >= 5) some.views = no_views.data();
        if (k == 6) some.n_faces = 11;
        refused(rc_place(&regions, 1, &some, nullptr, nullptr, rows, a.data(), &n_rows));
    }
    refused(rc_place(nullptr, 1, &search, nullptr, nullptr, rows, a.data(), &n_rows));
    refused(rc_place(&regions, -1, &search, nullptr, nullptr, rows, a.data(), &n_rows));
    refused(rc_place(&regions, 1, nullptr, nullptr, nullptr, rows, a.data(), &n_rows));
    refused(rc_place(&regions, 1, &search, nullptr, nullptr, nullptr, a.data(), &n_rows));
    refused(rc_place(&regions, 1, &search, nullptr, nullptr, rows, nullptr, &n_rows));
    refused(rc_place(&regions, 1, &search, nullptr, nullptr, rows, a.data(), nullptr));
    rc_surface *const apart = scene.surface();
    rc_solver *by_other = nullptr;
    rc_regions *of_other = nullptr;
    REQUIRE(rc_solver_create(apart, RC_EXACT, 1, &by_other) == RC_OK);
    REQUIRE(rc_find_regions(by_other, by, task, at, 1, nullptr, nullptr, &of_other) == RC_OK);
    const rc_regions *const both[] = {regions, of_other};
    refused(rc_place(both, 2, &search, nullptr, nullptr, rows, a.data(), &n_rows));
    CHECK(says("regions of one surface"));
    refused(rc_union_add_all(all, both, 2));
    CHECK(rc_regions_free(of_other) == RC_OK);
    CHECK(rc_solver_free(by_other) == RC_OK);
    CHECK(rc_surface_free(apart) == RC_OK);
    CHECK((rows[0] == -7 && n_rows == -7));
    refused(rc_union_add(nullptr, regions));
    refused(rc_regions_size(regions, 0, nullptr, &other));
    refused(rc_regions_size(regions, 0, &other, nullptr));
    refused(rc_regions_areas(regions, 0, 1, 12, nullptr, b.data()));
    refused(rc_regions_areas(regions, 0, 1, 12, a.data(), nullptr));
    refused(rc_union_areas(all, 1, 12, nullptr, b.data()));
    refused(rc_union_areas(all, 1, 12, a.data(), nullptr));
    refused(rc_surface_areas(surface, 12, nullptr));
    refused(rc_count_handles(nullptr));
    refused(rc_regions_read(regions, 0, n_polygons, n_corners, nullptr, counts.data(), a.data()));
    refused(rc_regions_read(regions, 0, n_polygons, n_corners, counts.data(), nullptr, a.data()));
    refused(
        rc_regions_read(regions, 0, n_polygons, n_corners, counts.data(), counts.data(), nullptr));
    for (const int64_t n : {int64_t(-1), int64_t(1) << 31, (int64_t(1) << 31) - 1, int64_t(1) << 32,
                            INT64_MAX, INT64_MIN}) {
        if (n != INT32_MAX) // a number of vertices
            refused(rc_surface_create(vertices, n, faces, 12, nullptr, &no_surface));
        refused(rc_surface_create(vertices, 8, faces, n, nullptr, &no_surface));
        refused(rc_surface_areas(surface, n, a.data()));
        refused(rc_observe(solver, by, at, n, nullptr, nullptr, &out));
        refused(rc_find_regions(solver, by, task, at, n, nullptr, nullptr, &none));
        refused(rc_regions_areas(regions, n, 1, 12, a.data(), b.data()));
        refused(rc_regions_areas(regions, 0, 1, n, a.data(), b.data()));
        refused(rc_regions_areas(regions, 0, n, 12, a.data(), b.data()));
        refused(rc_regions_size(regions, n, &other, &other));
        refused(rc_regions_read(regions, 0, n, n_corners, counts.data(), counts.data(), a.data()));
        refused(rc_regions_read(regions, 0, n_polygons, n, counts.data(), counts.data(), a.data()));
        refused(rc_union_areas(all, 1, n, a.data(), b.data()));
    }
    for (const int32_t n : {-1, 0, INT32_MAX, INT32_MIN}) {
        refused(rc_solver_create(surface, RC_EXACT, n, &no_solver));
        refused(rc_union_create(surface, n, &no_union));
        refused(rc_union_areas(all, n, 12, a.data(), b.data()));
    }
    CHECK(n_handles() == before);
    CHECK((!no_surface && !no_solver && !none && !no_union && other == -7));
    for (const auto *values : {&a, &b, &figures.visible, &figures.area, &figures.error})
        for (const double each : *values) CHECK(each == -7);
    for (const int32_t each : counts) CHECK(each == -7);
    for (const uint8_t each : figures.certified) CHECK(each == 7);
    CHECK(rc_union_free(all) == RC_OK);
    CHECK(rc_regions_free(regions) == RC_OK);
    CHECK(rc_solver_free(solver) == RC_OK);
    CHECK(rc_surface_free(surface) == RC_OK);
}

TEST_CASE("threads have texts of their own, and free what another one uses") {
    const Scene scene;
    rc_surface *surface = scene.surface();
    CHECK(rc_surface_free(nullptr) == RC_BAD_HANDLE);
    std::string other;
    std::thread([&] { other = rc_last_error(); }).join();
    CHECK(other == "no call of this thread has failed");
    std::vector<std::thread> threads;
    std::vector<rc_status> found(6);
    for (size_t k = 0; k < 6; k++)
        threads.emplace_back([&, k] {
            rc_solver *solver = nullptr;
            found[k] = rc_solver_create(surface, RC_CERTIFIED, 2, &solver);
            if (found[k]) return;
            const auto poses = scene.poses(20);
            rc_regions *regions = nullptr;
            found[k] = rc_find_regions(solver, &scene.camera, &scene.task, poses.data(), 20,
                                       nullptr, nullptr, &regions);
            rc_surface_free(surface);
            rc_regions_free(regions);
            rc_solver_free(solver);
        });
    for (auto &each : threads) each.join();
    for (const rc_status each : found) CHECK((each == RC_OK || each == RC_BAD_HANDLE));
}
