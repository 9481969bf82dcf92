// Solvers: grids that change no figure, faces left out, regions that a certificate got wrong;
// passes whose callbacks throw.
#include "solver/mesh.hpp"
#include "solver/pass.hpp"
#include <cmath>
#include <doctest.h>
#include <random>
#include <stdexcept>

using namespace rastercov;
using namespace rastercov::engine;

namespace {
const Camera CAMERA = {{140, 150, 80, 60, 160, 120}, 0.0, {}};
const double AHEAD[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
constexpr double NEAR = 0.5;

// Triangles without common vertices.
struct Soup {
    std::vector<double> vertices;
    std::vector<int32_t> faces;

    void add(std::initializer_list<double> corners) {
        for (int k = 0; k < 3; k++) faces.push_back(int32_t(vertices.size() / 3) + k);
        vertices.insert(vertices.end(), corners);
    }
    // Before the camera, across one another; some leave the image.
    explicit Soup(uint64_t seed, int64_t n = 40) {
        std::mt19937_64 numbers(seed);
        const auto any = [&] { return double(numbers() >> 11) * 0x1p-52 - 1; }; // within -1 ... 1
        for (int64_t f = 0; f < n; f++) {
            const double x = 2 * any(), y = 2 * any(), z = 5 + 2 * any();
            add({x + any(), y + any(), z + any(), x + any(), y + any(), z + any(), x + any(),
                 y + any(), z + any()});
        }
    }
    // Behind all of these: n x n small ones across the image.
    void add_behind(int64_t n) {
        for (int64_t row = 0; row < n; row++)
            for (int64_t column = 0; column < n; column++) {
                const double x = double(2 * column) / double(n) - 1,
                             y = double(2 * row) / double(n) - 1;
                const double step = 0.1 / double(n);
                add({12 * x, 9 * y, 25, 12 * x, 9 * y + step, 25, 12 * x + step, 9 * y, 25});
            }
    }
    Mesh mesh() const {
        return make_mesh({vertices.data(), {int64_t(vertices.size() / 3)}},
                         {faces.data(), {int64_t(faces.size() / 3)}}, {});
    }
};

std::vector<double> visible_by(Solver &solver, int64_t n) {
    solver.solve({CAMERA, pose_of({AHEAD}), NEAR, false}, nullptr);
    return {solver.areas().visible.begin(), solver.areas().visible.begin() + n};
}

int64_t n_cells(const Solver &solver) {
    return solver.plane().grid().columns * solver.plane().grid().rows;
}
} // namespace

TEST_CASE("one cell of the grid, or hundreds, give the same figures") {
    for (uint64_t seed = 0; seed < 20; seed++)
        for (const bool is_certifying : {false, true}) {
            Soup soup(seed);
            Solver few(soup.mesh().surface, is_certifying, false);
            const auto expected = visible_by(few, 40);
            soup.add_behind(60);
            Solver many(soup.mesh().surface, is_certifying, false);
            const auto found = visible_by(many, 40);
            CHECK(n_cells(few) < 20);
            CHECK(n_cells(many) > 500);
            double sum = 0.0;
            for (size_t f = 0; f < 40; f++) {
                CHECK(std::abs(found[f] - expected[f]) <= 1e-9);
                sum += expected[f];
            }
            CHECK(sum > 1000);
        }
}

TEST_CASE("some faces are measured as all are, and those left out hide what they hid") {
    for (uint64_t seed = 0; seed < 40; seed++)
        for (const bool is_certifying : {false, true}) {
            const Mesh mesh = Soup(seed).mesh();
            Solver solver(mesh.surface, is_certifying, false);
            const auto all = visible_by(solver, 40);
            Room<bool> left_out(40, true);
            for (uint64_t k = 0; k < 5; k++) left_out[int64_t((seed + 7 * k) % 40)] = false;
            solver.leave_out(left_out.rows());
            const auto some = visible_by(solver, 40);
            int64_t n_left = 0; // by the certificate some are known all the same
            for (int64_t f = 0; f < 40; f++) {
                const double error = left_out[f] ? solver.areas().area_error[f] : 0.0;
                CHECK(std::abs(some[size_t(f)] - all[size_t(f)]) <= error);
                n_left += error > 1.0;
            }
            CHECK((is_certifying || n_left > 15));
            solver.leave_out({});
            CHECK(visible_by(solver, 40) == all);
        }
}

TEST_CASE("a pass whose callbacks throw says so, and goes on") {
    const Soup soup(1);
    const Mesh mesh = soup.mesh();
    const exact::Vertices vertices = {soup.vertices.data(), {120}};
    bool fails = true;
    const auto find = [&](double) -> Contacts {
        if (fails) throw std::runtime_error("no contacts today");
        return {Room<bool>(40, false), Room<int64_t>(41, 0), {}};
    };
    constexpr int64_t N = 50;
    std::vector<double> poses;
    for (int64_t p = 0; p < N; p++) poses.insert(poses.end(), AHEAD, AHEAD + 16);
    const Room<int32_t> camera(N, 0);
    Room<int64_t> rows(N);
    for (int64_t p = 0; p < N; p++) rows[p] = p;
    Room<double> figures[3] = {Room<double>(40 * N), Room<double>(40 * N), Room<double>(40 * N)};
    Room<uint8_t> kind(40 * N);
    Room<bool> clipped(N);
    Job job = {
        nullptr, {{poses.data(), {N}}, camera.rows(), rows.rows(), rows.rows()}, {}, nullptr, {}};
    const std::array<int64_t, 2> shape = {N, 40};
    job.figures = {{figures[0].data(), shape},
                   {figures[1].data(), shape},
                   {kind.data(), shape},
                   {figures[2].data(), shape},
                   clipped.rows()};
    for (const int64_t n_threads : {1, 3}) {
        const auto moved = move_surface(mesh.surface, vertices, vertices, {mesh.diagonal, find});
        job.surface = moved;
        Pass pass(true, false, 1, n_threads);
        pass.set_camera(0, std::make_shared<const Camera>(CAMERA), nullptr);
        const auto run = [&](const GoOn &go_on) { pass.run(job, n_threads, go_on); };
        fails = true;
        CHECK_THROWS_WITH_AS(run({}), "no contacts today", std::runtime_error);
        fails = false;
        for (auto &each : figures) each.fill(-1.0);
        int64_t asked = 0;
        const auto stop = [&] { return ++asked < 3; };
        const auto fail = [&]() -> bool { throw std::runtime_error("not so long"); };
        if (n_threads == 1) { // of several, others may have finished all before it is asked
            CHECK_THROWS_AS(run(stop), Interrupted);
            CHECK(figures[0][40 * 3 - 1] >= 0.0); // of rows that are finished
            CHECK(figures[0][40 * 3] == -1.0);
            CHECK_THROWS_WITH_AS(run(fail), "not so long", std::runtime_error);
        }
        CHECK_NOTHROW(run({}));
        Solver alone(moved, true, false);
        const auto expected = visible_by(alone, 40);
        for (int64_t i = 0; i < 40 * N; i++)
            CHECK(figures[0][i] == doctest::Approx(expected[size_t(i % 40)]));
        CHECK(pass.n_idle() > 0);
    }
}
