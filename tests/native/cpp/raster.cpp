// Rasteriser: who owns what, parts and threads, memory that grows.
#include "solver/raster.hpp"
#include <cmath>
#include <doctest.h>

using namespace rastercov;
using namespace rastercov::raster;

namespace {
constexpr int N = 12; // squares along a side of a plane that fills the image
constexpr double EYE[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
constexpr double MIX[4] = {1, 0, 0, 1}, ORIGIN[3] = {0, 0, 1};

Scene plane() {
    std::vector<double> vertices;
    std::vector<int32_t> faces;
    for (int y = 0; y <= N; y++)
        for (int x = 0; x <= N; x++)
            vertices.insert(vertices.end(), {2.0 * x / N - 1, 2.0 * y / N - 1, 1});
    for (int y = 0; y < N; y++)
        for (int x = 0; x < N; x++) {
            const int a = y * (N + 1) + x, b = a + 1, c = a + N + 1, d = c + 1;
            faces.insert(faces.end(), {a, c, b, b, c, d});
        }
    return {{vertices.data(), {int64_t(vertices.size() / 3)}},
            {faces.data(), {int64_t(faces.size() / 3)}},
            {ORIGIN, {}},
            false};
}
Canvas canvas_of(int size, int64_t max_band) {
    std::vector<int32_t> runs(size_t(2 * size), 0);
    std::fill(runs.begin() + size, runs.end(), size);
    const double lens[4] = {size / 2.0, size / 2.0, size / 2.0, size / 2.0};
    const Grid grid = {size, size, {lens, {}}, {MIX, {}}, {runs.data(), {2, size}}, false, false};
    return {{}, grid, max_band};
}

struct Found {
    std::vector<int32_t> visible;
    std::vector<int64_t> filled;
};
// Counts of equal poses that look at the plane.
Found count(Rasterizer &rasterizer, const Canvas &canvas, int64_t n, int64_t parts,
            int64_t threads) {
    const int64_t n_faces = 2 * N * N;
    std::vector<double> poses;
    for (int64_t k = 0; k < n; k++) poses.insert(poses.end(), EYE[0], EYE[0] + 16);
    const std::vector<double> near(size_t(n), 0.1);
    const std::unique_ptr<bool[]> cull(new bool[size_t(n)]());
    Found found = {std::vector<int32_t>(size_t(n * n_faces), -7), std::vector<int64_t>(size_t(n))};
    const Output<int32_t> out = {
        {found.visible.data(), {n, n_faces}}, {}, {found.filled.data(), {n}}, false};
    rasterizer.count({&canvas}, {{poses.data(), {1, n}}, {near.data(), {n}}, {cull.get(), {n}}},
                     out, parts, threads);
    return found;
}
} // namespace

TEST_CASE("counts depend neither on bands, parts and threads, nor on canvases before") {
    const Scene scene = plane();
    Rasterizer rasterizer(scene, 2);
    for (const int size : {9, 100, 64}) // memory grows
        for (const int64_t band : {1, 4096, 1 << 17}) {
            const Canvas canvas = canvas_of(size, band);
            const Found one = count(rasterizer, canvas, 1, 1, 1);
            CHECK(one.filled[0] == size * size);
            int64_t sum = 0;
            for (const int32_t each : one.visible) sum += each;
            CHECK(sum == size * size);
            const Found split = count(rasterizer, canvas, 1, 5, 3);
            CHECK(split.visible == one.visible);
            CHECK(split.filled == one.filled);
            const Found many = count(rasterizer, canvas, 6, 2, 2);
            CHECK(
                std::equal(one.visible.begin(), one.visible.end(), many.visible.end() - 2 * N * N));
        }
    CHECK(rasterizer.n_idle() > 0);
    rasterizer.close();
    CHECK(rasterizer.n_idle() == 0);
    count(rasterizer, canvas_of(20, 1), 2, 1, 2);
    CHECK(rasterizer.n_idle() == 0); // a closed one keeps nothing
}

TEST_CASE("meshes that cannot be grouped are refused") {
    const double vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, std::numeric_limits<double>::quiet_NaN()};
    const int32_t faces[3] = {0, 1, 2}, outside[3] = {0, 1, 3};
    const Array<const double, Any, 3> points = {vertices, {3}};
    CHECK_THROWS_AS(Scene(points, {faces, {1}}, {ORIGIN, {}}, true), Error);
    CHECK_THROWS_AS(Scene(points, {outside, {1}}, {ORIGIN, {}}, true), Error);
    CHECK_THROWS_AS(Scene(points, {faces, {0}}, {ORIGIN, {}}, true), Error);
}
