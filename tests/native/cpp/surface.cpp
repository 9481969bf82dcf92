// Surfaces: who owns what, hostile meshes, contacts.
#include "solver/contacts.hpp"
#include "solver/mesh.hpp"
#include <cmath>
#include <doctest.h>
#include <limits>

using namespace rastercov;
using namespace rastercov::engine;

namespace {
Mesh mesh_of(const std::vector<double> &vertices, const std::vector<int32_t> &faces,
             const std::vector<uint8_t> &roles = {}) {
    return make_mesh({vertices.data(), {int64_t(vertices.size() / 3)}},
                     {faces.data(), {int64_t(faces.size() / 3)}},
                     {roles.data(), {int64_t(roles.size())}});
}
const std::vector<double> SQUARE = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
constexpr double NAN_ = std::numeric_limits<double>::quiet_NaN();
} // namespace

TEST_CASE("a surface outlives the arrays that it was made of, and its mesh") {
    std::shared_ptr<const Surface> kept;
    {
        std::vector<double> vertices = SQUARE;
        std::vector<int32_t> faces = {0, 1, 2, 0, 2, 3};
        kept = mesh_of(vertices, faces).surface;
        vertices.assign(12, NAN_);
        faces.assign(6, -1);
    }
    CHECK(kept->n_faces() == 2);
    CHECK(kept->vertices()(2, 1) == 1.0);
    CHECK(kept->edges().kind.rows() == 5);
    CHECK(!kept->contacts(1.0).faces[0]); // found now, of what the surface keeps
}

TEST_CASE("a surface at other positions keeps the one at rest") {
    std::shared_ptr<const Surface> moved;
    {
        const Mesh mesh = mesh_of(SQUARE, {0, 1, 2, 0, 2, 3});
        std::vector<double> other = SQUARE;
        for (double &each : other) each *= 2.0;
        moved = move_surface(mesh.surface, {other.data(), {4}}, {other.data(), {4}}, {});
        CHECK(moved->faces().data == mesh.surface->faces().data);
    }
    CHECK(moved->vertices()(2, 0) == 2.0);
    CHECK(moved->diagonal() == doctest::Approx(2 * std::sqrt(2.0)));
    CHECK(moved->edges().faces(0, 0) == 0);
    CHECK_THROWS_AS(move_surface(moved, {SQUARE.data(), {2}}, {SQUARE.data(), {4}}, {}), Error);
}

TEST_CASE("meshes that are none are refused") {
    CHECK_THROWS_WITH_AS(mesh_of(SQUARE, {}),
                         "expected 1 face or more, got 0; pass a mesh with faces", Error);
    CHECK_THROWS_AS(mesh_of({}, {0, 0, 0}), Error);
    CHECK_THROWS_AS(mesh_of(SQUARE, {0, 1, 4}), Error);
    CHECK_THROWS_AS(mesh_of(SQUARE, {0, 1, -1}), Error);
    for (const double bad : {NAN_, double(INFINITY), 1e31, -1e300}) {
        std::vector<double> vertices = SQUARE;
        vertices[4] = bad;
        CHECK_THROWS_AS(mesh_of(vertices, {0, 1, 2}), Error);
        CHECK_NOTHROW(mesh_of(vertices, {0, 2, 3})); // of a vertex that no face uses
    }
}

TEST_CASE("odd meshes are surfaces") {
    const auto is_plain = [](const Mesh &mesh) { return bool(mesh.surface->blocks().is_plain[0]); };
    CHECK(mesh_of(SQUARE, {0, 0, 0}).surface->edges().kind[0] == exact::NON_MANIFOLD);
    CHECK(mesh_of(SQUARE, {0, 1, 2}).surface->edges().kind.rows() == 3);
    const Mesh twins = mesh_of(SQUARE, {0, 1, 2, 0, 1, 2});
    CHECK(twins.surface->edges().kind[0] == exact::REVERSED);
    CHECK(twins.surface->contacts(1.0).faces[1]);
    CHECK(!is_plain(twins));
    const Mesh fan = mesh_of(SQUARE, {0, 1, 2, 0, 1, 3, 1, 0, 2});
    CHECK(fan.surface->edges().kind[0] == exact::NON_MANIFOLD);
    const Mesh point = mesh_of({0, 0, 0, 0, 0, -0.0}, {0, 1, 0}, {TARGET}); // nothing hides
    CHECK(point.surface->vertices().rows() == 1);
    CHECK(point.surface->has_targets());
    CHECK(point.surface->place()[0] == 1);
    CHECK(point.arrays->areas[0] == 0.0);
}

TEST_CASE("vertices at one point are one, with either sign of zero") {
    const Mesh mesh =
        mesh_of({0, 0, 0, 1, 0, 0, 0, 1, 0, -0.0, 0, -0.0, 1, 0, 0, 0, -1, 0}, {0, 1, 2, 4, 3, 5});
    CHECK(mesh.surface->vertices().rows() == 4);
    CHECK(mesh.surface->edges().kind.rows() == 5);
}

TEST_CASE("equal rows are found where their digests are equal, too") {
    std::vector<uint64_t> rows;
    for (uint64_t k = 0; k < 500; k++) {
        const uint64_t first = (k % 100) * 0x9E3779B97F4A7C15;
        rows.insert(rows.end(), {k % 100, first ^ first >> 29});
    }
    std::vector<int64_t> first(500);
    find_first_equal({rows.data(), {500, 2}}, {first.data(), {500}});
    for (int64_t k = 0; k < 500; k++) CHECK(first[size_t(k)] == k % 100);
}

TEST_CASE("contacts that a finder cannot find are asked for again") {
    int calls = 0;
    const Mesh mesh = mesh_of(SQUARE, {0, 1, 2, 0, 2, 3});
    const auto find = [&](double) -> Contacts {
        if (++calls == 1) throw std::bad_alloc();
        return {Room<bool>(2, true), Room<int64_t>(3, 0), {}};
    };
    const auto surface =
        move_surface(mesh.surface, {SQUARE.data(), {4}}, {SQUARE.data(), {4}}, {1.0, find});
    CHECK_THROWS_AS(surface->contacts(1.0), std::bad_alloc);
    CHECK(surface->contacts(1.0).blocks[0]);
    CHECK(&surface->contacts(2.0) == &surface->contacts(30.0)); // one decade
    CHECK(calls == 2);
    surface->contacts(31.0);
    CHECK(calls == 3);
}
