// Random calls of the border to C: fuzz N SEED. Handles that are alive, freed, null and of another
// kind; sizes that are right and wrong; coordinates that are none. A crash, or a code that there is
// not, is a fault; the counts of the codes are printed.
#include "camera/camera.hpp"
#include "lens/field.hpp"
#include "lens/rules.hpp"
#include "scenes.hpp"
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

namespace {
std::mt19937_64 numbers;
int64_t below(int64_t n) { return int64_t(numbers() % uint64_t(n)); }
bool rarely() { return below(12) == 0; }
double real() {
    static const double ODD[] = {NAN, INFINITY, -INFINITY, 1e31, 1e-300, -0.0, 1e30};
    return rarely() ? ODD[below(7)] : double(below(9)) / 4 - 1;
}

template <class Handle> class Pool {
  public:
    void keep(Handle *made) { _all.push_back(made); }
    // One that was made, which may be freed; null; or any number.
    Handle *any() const {
        const int64_t way = below(30);
        if (way == 0 || _all.empty()) return nullptr;
        if (way == 1) return reinterpret_cast<Handle *>(uintptr_t(numbers()));
        if (way == 2) return reinterpret_cast<Handle *>(uintptr_t(below(4000)));
        return _all[_all.size() - 1 - size_t(below(std::min<int64_t>(4, int64_t(_all.size()))))];
    }

  private:
    std::vector<Handle *> _all;
};
Pool<rc_surface> surfaces;
Pool<rc_solver> solvers;
Pool<rc_regions> results;
Pool<rc_union> unions;
Pool<rc_lens> lenses;
Pool<rc_network> networks;
Pool<rc_zones> zones;

rc_status make_surface() {
    const int64_t n_vertices = 1 + below(12), n_faces = 1 + below(20);
    std::vector<double> vertices(size_t(3 * n_vertices));
    for (double &each : vertices) each = rarely() && rarely() ? real() : double(below(9)) / 4 - 1;
    std::vector<int32_t> faces(size_t(3 * n_faces));
    for (int32_t &each : faces) each = int32_t(below(n_vertices + (below(200) == 0)));
    std::vector<uint8_t> roles(static_cast<size_t>(n_faces));
    for (uint8_t &each : roles) each = uint8_t(below(below(40) ? 8 : 9));
    const int64_t wrong[] = {0, -1, int64_t(1) << 31, INT64_MAX, INT64_MIN};
    rc_surface *made = nullptr;
    const rc_status status = rc_surface_create(
        rarely() && rarely() ? nullptr : vertices.data(), rarely() ? wrong[below(5)] : n_vertices,
        faces.data(), rarely() ? wrong[below(5)] : n_faces, below(2) ? roles.data() : nullptr,
        rarely() && rarely() ? nullptr : &made);
    if (made) surfaces.keep(made);
    return status;
}

std::vector<double> poses_of(int64_t n) {
    std::vector<double> poses;
    for (int64_t p = 0; p < n; p++) {
        const double a = double(below(8)) * 0.785398163, b = double(below(8)) * 0.785398163;
        const double ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
        const double pose[16] = {ca, -sa * cb, sa * sb,  double(below(9)) / 2 - 2,
                                 sa, ca * cb,  -ca * sb, double(below(9)) / 2 - 2,
                                 0,  sb,       cb,       double(below(9)) / 2 - 2,
                                 0,  0,        0,        1};
        for (const double value : pose) poses.push_back(value);
    }
    if (n > 0 && rarely()) poses[size_t(below(16 * n))] = real();
    return poses;
}

rc_camera camera() {
    rc_lens *const lens = below(5) ? nullptr : lenses.any();
    rc_camera made = {sizeof(rc_camera), 64, 48, 30, 30, 32, 24, 0, lens, 0};
    if (below(4) == 0) made.fx += double(below(3));
    if (below(5) == 0) made.is_parallel = 1;
    if (rarely()) made.is_parallel = int32_t(below(4));
    if (rarely()) made.size = int32_t(below(200));
    if (rarely()) (&made.width)[below(7)] = real();
    return made;
}

int n_asked = 0;
int go_on(void *) { return ++n_asked % 50 != 0; }

rc_status make_solver() {
    rc_solver *made = nullptr;
    const int32_t threads = below(30) ? 1 + int32_t(below(2)) : int32_t(below(5000)) - 2000;
    const rc_status status =
        rc_solver_create(surfaces.any(), int32_t(below(rarely() ? 9 : 2)), threads, &made);
    if (made) solvers.keep(made);
    return status;
}

// Room for the faces of any surface: no more than 20.
rc_status observe() {
    const int64_t n = below(4);
    const auto poses = poses_of(n);
    const rc_camera by = camera();
    Figures figures(4 * 20, 0.0);
    rc_figures out = figures.out();
    if (rarely()) (rarely() ? out.visible : out.area_error) = nullptr;
    return rc_observe(solvers.any(), rarely() ? nullptr : &by, poses.data(), rarely() ? -n : n,
                      below(2) ? go_on : nullptr, nullptr, rarely() ? nullptr : &out);
}

rc_status find() {
    const int64_t n = below(4);
    const auto poses = poses_of(n);
    const rc_camera by = camera();
    rc_task task = rc_task_default();
    if (below(3) == 0) task.max_incidence_deg = double(below(92));
    if (below(3) == 0) task.min_pixel_density = double(below(20));
    if (rarely()) (&task.min_depth)[below(6)] = real();
    rc_regions *made = nullptr;
    const rc_status status =
        rc_find_regions(solvers.any(), &by, rarely() ? nullptr : &task, poses.data(), n,
                        below(2) ? go_on : nullptr, nullptr, &made);
    if (made) results.keep(made);
    return status;
}

rc_status read() {
    double areas[64], bounds[64]; // of the most faces of a surface, 20, in three poses
    const int64_t n = 1 + below(21), pose = below(5) - 1;
    switch (below(4)) {
    case 0:
        return rc_surface_areas(surfaces.any(), n, areas);
    case 1:
        return rc_regions_areas(results.any(), pose, below(3), n, areas,
                                rarely() ? nullptr : bounds);
    case 2:
        return rc_union_areas(unions.any(), int32_t(below(5)), n, areas, bounds);
    default:
        break;
    }
    rc_regions *from = results.any();
    int64_t n_polygons = 0, n_corners = 0;
    if (const rc_status status = rc_regions_size(from, pose, &n_polygons, &n_corners))
        return status;
    std::vector<int32_t> faces(size_t(n_polygons + 1)), counts(faces);
    std::vector<double> corners(size_t(3 * n_corners + 1));
    return rc_regions_read(from, pose, n_polygons + (rarely() ? 1 : 0), n_corners, faces.data(),
                           counts.data(), corners.data());
}

// Of any surface, whose faces are no more than 20.
rc_status light() {
    double directions[12], areas[3][80];
    for (double &each : directions) each = real();
    const int64_t n = below(5);
    rc_lit out = {sizeof(rc_lit), areas[0], areas[1], areas[2]};
    if (rarely()) out.size = int32_t(below(200));
    if (rarely()) (rarely() ? out.lit : out.bound) = nullptr;
    return rc_sunlit(solvers.any(), rarely() ? nullptr : directions, rarely() ? -n : n,
                     below(2) ? go_on : nullptr, nullptr, rarely() ? nullptr : &out);
}

// Some poses of some results; those of a surface are mostly its own.
rc_status place() {
    const rc_regions *const first = results.any();
    const rc_regions *const some[] = {first, first, below(3) ? first : results.any()};
    int32_t views[32];
    for (int32_t &each : views) each = int32_t(below(4)) + (below(40) ? 1 : -1);
    int64_t rows[16], n = 0;
    double gains[16];
    rc_search search = {sizeof(rc_search), int32_t(1 + below(16)), 0.0,
                        below(3),          1 + below(21),          nullptr};
    if (below(2)) search.views = views;
    if (rarely()) search.size = int32_t(below(200));
    if (rarely()) search.most = int32_t(below(3)) - 2;
    if (rarely()) search.n_given = below(20) - 5;
    if (below(3) == 0) search.least = real();
    return rc_place(rarely() && rarely() ? nullptr : some, below(20) ? below(4) : -1,
                    rarely() ? nullptr : &search, below(2) ? go_on : nullptr, nullptr,
                    rarely() ? nullptr : rows, gains, rarely() ? nullptr : &n);
}

// Numbers of a lens of one plane as rc_lens_read lays them out.
std::vector<double> lens_numbers() {
    namespace lens = rastercov::lens;
    std::vector<double> all = {
        double(below(lens::N_BASES + 1)), double(below(2)), double(below(2)), 1, 64, 48, 0};
    const auto add = [&](std::initializer_list<double> some) { all.insert(all.end(), some); };
    const auto fill = [&](int64_t n, double value) { all.insert(all.end(), size_t(n), value); };
    const auto add_params = [&] {
        const size_t first = all.size();
        add({30, 30, 32, 24});
        for (int k = 4; k < lens::SIZE; k++) add({below(3) ? 0.0 : double(below(9)) / 16 - 0.25});
        for (const int k : {lens::T00, lens::T11, lens::T22, lens::B0, lens::LIMIT})
            all[first + size_t(k)] = 1.0;
    };
    add_params();
    add({all[0]});
    add_params();
    add({1, 0, 0, 0, 1, 0, 0, 0, 1, 30, 30, 32, 24, 4, 0, 4});
    for (int k = 0; k < 2; k++) add({-1, -1, 1, -1, 1, 1, -1, 1}); // region and window
    fill(lens::TABLE, 0.25);
    add({double(lens::FEWEST + below(lens::MOST - lens::FEWEST + 1)), double(below(2))});
    add({64, 48, double(below(9)), 1, 30, 1e-6, below(3) ? 0.0 : 0.5, 0.1});
    add({30, 30, 32, 24, 64, 48}); // of the pinhole
    const int64_t n = below(4);    // lines of the field of view
    add({double(n), n ? 0.0 : -double(1 + below(3))});
    for (int64_t k = 0; k < n; k++) add({k % 2 ? 0.0 : 1.0, k % 2 ? 1.0 : 0.0, 0.5});
    for (int64_t k = 0; k < 2 * n; k++) add({double(below(n + 3) - 3)});
    for (int64_t k = 0; k < n; k++) add({double(below(3))});
    add({-1, -1, 16, 16});
    const int64_t n_parts = lens::CELLS * lens::PARTS;
    fill(2 * n_parts * n_parts, double(below(3)));
    fill(lens::CELLS * lens::CELLS, 100);
    fill(lens::CELLS * lens::CELLS, 1000);
    fill(4, INFINITY);
    for (int64_t k = below(3) ? 0 : 1 + below(3); k > 0; k--)
        all[size_t(below(below(2) ? int64_t(all.size()) : 150))] = real();
    return all;
}

rc_status make_lens() {
    std::vector<double> own(size_t(1 + below(200)));
    for (double &each : own) each = rarely() ? real() : double(below(5));
    if (below(3)) own = lens_numbers();
    rc_lens *made = nullptr;
    const rc_status status =
        rc_lens_create(own.data(), int64_t(own.size()) - (rarely() ? 300 : 0), &made);
    if (made) lenses.keep(made);
    return status;
}

rc_status read_parts() {
    rc_union *const from = unions.any();
    int64_t n = 0, n_corners = 0;
    double area = 0;
    uint8_t marks[32] = {};
    switch (below(6)) {
    case 3: {
        const int32_t views[3] = {int32_t(below(5)), int32_t(below(5)), 1};
        int32_t parts[32];
        std::vector<double> sums(3 * 1024);
        for (int32_t &each : parts) each = int32_t(below(5)) - 1;
        return rc_union_sums(from, 1 + below(21), parts, below(4), views, sums.data());
    }
    case 2: {
        double excess[32];
        return rc_union_excess(from, 1 + below(21), excess);
    }
    case 0:
        return rc_union_alone(from, int32_t(below(5)), results.any(), below(4) - 1, &area);
    case 1:
        for (uint8_t &each : marks) each = uint8_t(below(2));
        return rc_union_fill(from, 1 + below(21), marks);
    default:
        break;
    }
    if (const rc_status status = rc_union_size(from, &n, &n_corners)) return status;
    std::vector<int32_t> faces(size_t(n + 1)), counts(faces), tags(faces);
    std::vector<double> areas(size_t(n + 1)), corners(size_t(3 * n_corners + 1));
    return rc_union_read(from, n + (rarely() ? 1 : 0), n_corners, faces.data(), counts.data(),
                         tags.data(), areas.data(), corners.data());
}

rc_status judge() {
    const rc_camera by = camera();
    rc_task task = rc_task_default();
    if (below(3) == 0) task.min_facing_density = double(below(20));
    const auto poses = poses_of(1);
    double points[3 * 4], values[3][32];
    int32_t faces[4], hiders[4];
    uint8_t reasons[32];
    for (double &each : points) each = real();
    for (int32_t &each : faces) each = int32_t(below(21)) - (rarely() ? 1 : 0);
    if (below(3) == 0)
        return rc_clear_places(surfaces.any(), below(5), points, real(),
                               rarely() ? nullptr : reasons);
    const rc_failures failures = {reasons, rarely() ? nullptr : hiders};
    if (below(2))
        return rc_judge_points(surfaces.any(), &by, &task, poses.data(), below(5), points, faces,
                               rarely() ? nullptr : &failures);
    const rc_judged out = {reasons, values[0], values[1], rarely() ? nullptr : values[2]};
    return rc_judge_faces(solvers.any(), &by, &task, poses.data(), 1 + below(21), &out);
}

// A rule of some devices.
struct Rule {
    std::vector<uint8_t> needs, stripes;
    std::vector<double> noise;
    rc_gate gate;

    explicit Rule(size_t count) : needs(count), stripes(count), noise(count) {
        for (size_t d = 0; d < count; d++) {
            needs[d] = uint8_t(below(4) == 0);
            stripes[d] = uint8_t(below(2));
            noise[d] = rarely() ? real() : 1e-3;
        }
        const double least = below(2) ? 0.0 : double(below(60));
        gate = {int32_t(1 + below(below(9) ? int64_t(count) : 99)),
                below(2) ? needs.data() : nullptr,
                least,
                below(2) ? 180.0 : least + double(below(90)),
                below(2) ? 0.0 : double(below(9)) / 16,
                noise.data(),
                below(2) ? stripes.data() : nullptr};
        if (rarely()) (&gate.least_deg)[below(3)] = real();
        if (rarely()) gate.noise = nullptr;
    }
};

// A rule of some results, mostly of one pose each.
rc_status together() {
    const int64_t n = below(30) ? 2 + below(3) : below(70) - 1;
    const auto count = size_t(std::max<int64_t>(n, 1));
    const Rule rule(count);
    std::vector<const rc_regions *> own(count);
    for (size_t d = 0; d < count; d++) own[d] = d > 0 && below(2) ? own[0] : results.any();
    const auto poses = poses_of(n);
    rc_regions *made = nullptr;
    const rc_status status =
        rc_regions_together(rarely() && rarely() ? nullptr : &rule.gate, own.data(),
                            rarely() && rarely() ? nullptr : poses.data(), n, &made);
    if (made) results.keep(made);
    return status;
}

rc_status read_zones(rc_zones *from) {
    int64_t n_zones = 0, n = 0, n_corners = 0;
    if (const rc_status status = rc_zones_size(from, &n_zones, &n, &n_corners)) return status;
    std::vector<int32_t> numbers_of(size_t(5 * n + 1));
    std::vector<double> areas(size_t(n + 1)), corners(size_t(3 * n_corners + 1));
    int32_t *const at = numbers_of.data();
    rc_parts parts = {at, at + n, at + 2 * n, at + 3 * n, at + 4 * n, areas.data(), corners.data()};
    if (below(3) == 0) {
        double points[12];
        int32_t faces[4], found[4], reasons[4];
        for (double &each : points) each = real();
        for (int32_t &each : faces) each = int32_t(below(21)) - (rarely() ? 1 : 0);
        return rc_reason_at(from, below(6) - 1 > 4 ? -1 : below(5), points, faces, found,
                            rarely() ? nullptr : reasons);
    }
    if (rarely()) (rarely() ? parts.faces : parts.reasons) = nullptr;
    return rc_zones_read(from, n + (rarely() ? 1 : 0), n_corners, rarely() ? nullptr : &parts);
}

rc_status find_zones(rc_network *of) {
    const int64_t n = 1 + below(21);
    std::vector<int32_t> views(size_t(n), 1), groups(size_t(n), 0);
    std::vector<double> unseeable(size_t(n), 0.0);
    for (size_t f = 0; f < size_t(n); f++) {
        views[f] += int32_t(below(3)) - (below(300) == 0);
        groups[f] = int32_t(below(3)) - 1;
        if (rarely()) unseeable[f] = rarely() ? real() : 0.01;
    }
    rc_zones *made = nullptr;
    const rc_status status =
        rc_find_zones(of, n, views.data(), below(2) ? groups.data() : nullptr,
                      below(2) ? unseeable.data() : nullptr, rarely() ? nullptr : &made);
    if (made) zones.keep(made);
    return status;
}

rc_status network() {
    rc_network *const of = networks.any();
    const int64_t n = 2 + below(2);
    const rc_camera by = camera();
    rc_task task = rc_task_default();
    if (below(2)) task.max_incidence_deg = double(below(92));
    if (below(3) == 0) task.min_pixel_density = double(below(20));
    const Rule rule(static_cast<size_t>(n));
    rc_network *made = nullptr;
    rc_regions *regions = nullptr;
    rc_union *all = nullptr;
    rc_status status = RC_OK;
    switch (below(10)) {
    case 0:
        status = rc_network_create(surfaces.any(), below(30) ? 1 : int32_t(below(3000)), &made);
        if (made) networks.keep(made);
        return status;
    case 1:
        return rc_network_clear(of);
    case 2:
        status = rc_network_regions(of, below(4) - 1, &regions);
        if (regions) results.keep(regions);
        return status;
    case 3:
        status = rc_network_unite(of, int32_t(below(5)), &all);
        if (all) unions.keep(all);
        return status;
    case 4:
    case 5:
        return find_zones(of);
    case 6:
        return read_zones(zones.any());
    case 7:
        return rc_network_join(of, &rule.gate, n);
    default:
        return rc_network_add(of, &by, rarely() ? nullptr : &task, poses_of(1).data());
    }
}

rc_status unite() {
    const rc_regions *const some[] = {results.any(), results.any(), results.any()};
    if (below(6) == 0)
        return rc_union_add_all(unions.any(), rarely() ? nullptr : some, below(20) ? below(4) : -1);
    if (below(3)) return rc_union_add(unions.any(), results.any());
    rc_union *made = nullptr;
    rc_status status = RC_OK;
    if (below(3)) status = rc_union_create(surfaces.any(), int32_t(below(5)), &made);
    else status = rc_union_complete(unions.any(), &made);
    if (made) unions.keep(made);
    return status;
}

rc_status release() {
    switch (below(7)) {
    case 5:
        return rc_network_free(below(4) ? nullptr : networks.any());
    case 6:
        return rc_zones_free(zones.any());
    case 4:
        return rc_lens_free(lenses.any());
    case 0:
        return rc_surface_free(surfaces.any());
    case 1:
        return rc_solver_free(solvers.any());
    case 2:
        return rc_regions_free(results.any());
    default:
        return rc_union_free(unions.any());
    }
}

rc_status call() {
    switch (below(21)) {
    case 18:
        return light();
    case 19:
    case 20:
        return place();
    case 14:
    case 15:
    case 16:
    case 17:
        return network();
    case 13:
        return together();
    case 10:
        return make_lens();
    case 11:
        return read_parts();
    case 12:
        return judge();
    case 0:
        return make_surface();
    case 1:
        return make_solver();
    case 2:
    case 3:
        return observe();
    case 4:
    case 5:
        return find();
    case 6:
    case 7:
        return read();
    case 8:
        return unite();
    default:
        return release();
    }
}
} // namespace

int main(int n_arguments, char **arguments) {
    const int64_t n = n_arguments > 1 ? std::atoll(arguments[1]) : 20000;
    numbers.seed(n_arguments > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1);
    int64_t counts[6] = {};
    for (int64_t k = 0; k < n; k++) {
        const rc_status status = call();
        if (status < 0 || status > RC_STOPPED || (status && !*rc_last_error())) {
            std::printf("call %lld: code %d: %s\n", static_cast<long long>(k), int(status),
                        rc_last_error());
            return 1;
        }
        counts[status]++;
    }
    std::printf("%lld calls: %lld ok, %lld bad arguments, %lld bad handles, %lld out of memory, "
                "%lld stopped\n",
                static_cast<long long>(n), static_cast<long long>(counts[0]),
                static_cast<long long>(counts[1]), static_cast<long long>(counts[2]),
                static_cast<long long>(counts[3]), static_cast<long long>(counts[4]));
    return 0;
}
