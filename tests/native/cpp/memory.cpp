// Memory that runs out at any place: a code, nothing leaked, and objects that go on.
#include "scenes.hpp"
#include <cstdlib>
#include <doctest.h>
#include <new>
#include <string>

namespace {
// Allocations that succeed from now on, and those that are not freed; of this thread alone.
thread_local int64_t left = -1, alive = 0;
} // namespace

void *operator new(size_t size) {
    if (left >= 0 && left-- == 0) throw std::bad_alloc();
    void *memory = std::malloc(size ? size : 1);
    if (!memory) throw std::bad_alloc();
    alive++;
    return memory;
}
void operator delete(void *memory) noexcept {
    if (memory) alive--;
    std::free(memory);
}
void operator delete(void *memory, size_t) noexcept { operator delete(memory); }

namespace {
// Calls with ever more memory until it suffices; how often it did not.
template <class Call> int64_t starve(Call call) {
    for (int64_t n = 0;; n++) {
        const int64_t handles = n_handles();
        left = n;
        const rc_status status = call();
        left = -1;
        if (status == RC_OK) return n;
        REQUIRE(status == RC_OUT_OF_MEMORY);
        CHECK(std::string(rc_last_error()).find("expected memory for ") == 0);
        CHECK(n_handles() == handles);
    }
}
} // namespace

TEST_CASE("memory that runs out is a code, and what there was goes on") {
    const Scene scene;
    const auto poses = scene.poses(3);
    rc_surface_free(nullptr); // room for texts
    const int64_t before = alive;
    rc_surface *surface = nullptr;
    rc_solver *solver = nullptr;
    rc_regions *regions = nullptr;
    rc_union *all = nullptr;
    int64_t failed = starve([&] {
        return rc_surface_create(scene.vertices.data(), 8, scene.faces.data(), 12, nullptr,
                                 &surface);
    });
    failed += starve([&] { return rc_solver_create(surface, RC_CERTIFIED, 1, &solver); });
    Figures figures(3 * 12, -1.0);
    const rc_figures out = figures.out();
    failed += starve(
        [&] { return rc_observe(solver, &scene.camera, poses.data(), 3, nullptr, nullptr, &out); });
    failed += starve([&] {
        return rc_find_regions(solver, &scene.camera, &scene.task, poses.data(), 3, nullptr,
                               nullptr, &regions);
    });
    failed += starve([&] { return rc_union_create(surface, 2, &all); });
    failed += starve([&] { return rc_union_add(all, regions); });
    std::vector<double> areas(12), bounds(12);
    failed += starve([&] { return rc_union_areas(all, 2, 12, areas.data(), bounds.data()); });
    std::vector<double> lit(3 * 12), whole(lit), bound(lit);
    const rc_lit out_of_sun = {sizeof(rc_lit), lit.data(), whole.data(), bound.data()};
    const double up[] = {0, 0, 2, 1, 0, 0, 1, 1, 1};
    failed += starve([&] { return rc_sunlit(solver, up, 3, nullptr, nullptr, &out_of_sun); });
    CHECK(lit[2] + lit[3] == doctest::Approx(1.0));
    const rc_search search = {sizeof(rc_search), 2, 0.0, 0, 12, nullptr};
    int64_t row[2], n_rows = 0;
    double gains[2];
    failed += starve(
        [&] { return rc_place(&regions, 1, &search, nullptr, nullptr, row, gains, &n_rows); });
    CHECK((n_rows == 1 && row[0] == 0)); // each sees all of the lid
    CHECK(gains[0] == doctest::Approx(1.0));
    CHECK(failed > 100);
    CHECK(areas[2] + areas[3] == doctest::Approx(1.0));
    CHECK(rc_union_free(all) == RC_OK);
    CHECK(rc_regions_free(regions) == RC_OK);
    CHECK(rc_solver_free(solver) == RC_OK);
    CHECK(rc_surface_free(surface) == RC_OK);
    figures = Figures(0, 0.0);
    figures.visible.shrink_to_fit();
    CHECK(alive - before <= 12); // vectors of this test, and the table of handles
}
