// Parts of a union for C: read, and completed by the rest of the surface.
//
// Twin: rastercov.core.area.table, by tests/native/test_c_border.py.
#include "c/partition.hpp"
#include "area/sums.hpp"

namespace rastercov::c {
namespace {
// Centroid of a polygon of positive area.
std::array<double, 2> centroid_of(const double *corners, int64_t n) {
    double twice = 0.0;
    std::array<double, 2> sum = {};
    for (int64_t i = 1; i + 1 < n; i++) {
        const double *const a = corners, *const b = corners + 2 * i, *const c = b + 2;
        const double own = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        twice += own;
        for (size_t k = 0; k < 2; k++) sum[k] += own * ((b[k] - a[k]) + (c[k] - a[k])) / 3.0;
    }
    for (size_t k = 0; k < 2; k++) sum[k] = corners[k] + (twice > 0 ? sum[k] / twice : 0.0);
    return sum;
}

// Area that exactly `views` poses cover, one of them that of the regions.
double alone_of(const engine::Union &from, int64_t views, const engine::Regions &own,
                double slack) {
    Partition parts(from);
    double sum = 0.0;
    size_t piece = 0;
    size_t at = 0; // the pieces of a pose are by face, as the parts are
    for (int64_t p = 0; p < parts.size(); p++) {
        if (parts.tag[size_t(p)] != views) continue;
        const int32_t f = parts.face[size_t(p)];
        for (; piece < own.face.size() && own.face[piece] < f; piece++)
            at += size_t(own.n_corners[piece]);
        const int64_t first = parts.starts[size_t(p)];
        const auto [x, y] =
            centroid_of(parts.xy.data() + 2 * first, parts.starts[size_t(p + 1)] - first);
        size_t corner = at;
        for (size_t q = piece; q < own.face.size() && own.face[q] == f; q++) {
            if (area::is_inside(x, y, own.xy.data() + 2 * corner, own.n_corners[q], slack)) {
                sum += parts.area[size_t(p)];
                break;
            }
            corner += size_t(own.n_corners[q]);
        }
    }
    return sum;
}
} // namespace

std::shared_ptr<UnionObject> union_of(const std::shared_ptr<const SurfaceObject> &surface,
                                      int64_t views) {
    auto made = std::make_shared<UnionObject>();
    made->surface = surface;
    const area::Planes planes = surface->mesh.arrays->planes();
    const bool has_few = surface->mesh.n_faces() <= engine::FEW_FACES;
    made->all = std::make_unique<engine::Union>(
        engine::FlatFaces{planes.corners, planes.areas}, FLOOR_REL * surface->mesh.diagonal, views,
        engine::MOST_PIECES, has_few ? engine::POSES_TOGETHER : 1);
    return made;
}

namespace {
engine::Room<bool> conditions_of(const SurfaceObject &surface) {
    const engine::MeshArrays &mesh = *surface.mesh.arrays;
    engine::Room<bool> asked(surface.mesh.n_faces());
    for (int64_t f = 0; f < asked.size(); f++) asked[f] = mesh.is_asked[f] && mesh.areas[f] > 0;
    return asked;
}

} // namespace

std::shared_ptr<UnionObject> complete_union(const UnionObject &from) {
    auto made = union_of(from.surface, from.all->views() + 1);
    Partition parts(*from.all);
    const std::vector<int32_t> none(size_t(parts.size()));
    const int64_t n = made->all->n_faces();
    const engine::Room<double> both = from.all->bounds();
    made->all->begin(parts.pieces(none), {parts.tag.data(), {parts.size()}}, both.first(n),
                     {both.data() + n, {n}});
    const engine::Room<bool> asked = conditions_of(*from.surface);
    made->all->fill(asked.rows());
    return made;
}

void add_set(engine::Union &sets, const engine::Union &more, int64_t views, int64_t bit) {
    Partition parts(more);
    parts.keep([&](int64_t p) {
        const int64_t tag = parts.tag[size_t(p)];
        return (views > 0 ? tag >= views : tag < -views) && parts.area[size_t(p)] > 0;
    });
    std::vector<int32_t> faces;
    std::vector<double> areas;
    for (int64_t p = 0; p < parts.size(); p++) {
        const int32_t f = parts.face[size_t(p)];
        if (faces.empty() || faces.back() != f) {
            faces.push_back(f);
            areas.push_back(0.0);
        }
        areas.back() += parts.area[size_t(p)];
    }
    const auto n = int64_t(faces.size());
    const std::vector<int32_t> pose(size_t(parts.size())), of_pairs(faces.size());
    const std::vector<double> none(faces.size());
    const engine::RegionPairs pairs = {{of_pairs.data(), {n}},
                                       {faces.data(), {n}},
                                       {areas.data(), {n}},
                                       {none.data(), {n}},
                                       {none.data(), {n}}};
    const std::vector<int64_t> number(1, bit);
    sets.add(parts.pieces(pose), pairs, {number.data(), {1}}, {});
}
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_union_fill(rc_union *unite, int64_t n_faces, const uint8_t *faces) {
    return guard("filling faces", [&] {
        const auto object = object_of(unite);
        check_faces(*object->surface, n_faces);
        expect_array(faces, "faces");
        engine::Room<bool> chosen(n_faces);
        for (int64_t f = 0; f < n_faces; f++) chosen[f] = faces[f] != 0;
        const std::scoped_lock lock(object->changes);
        object->all->fill(chosen.rows());
    });
}

rc_status rc_union_excess(const rc_union *unite, int64_t n_faces, double *excess) {
    return guard("reading areas", [&] {
        const auto object = object_of(unite);
        check_faces(*object->surface, n_faces);
        expect_array(excess, "excess");
        const std::scoped_lock lock(object->changes);
        std::copy_n(object->all->bounds().data() + n_faces, n_faces, excess);
    });
}

rc_status rc_union_sums(const rc_union *unite, int64_t n_faces, const int32_t *parts,
                        int64_t n_parts, const int32_t *views, double *sums) {
    return guard("adding up areas", [&] {
        const auto object = object_of(unite);
        check_faces(*object->surface, n_faces);
        expect(n_parts >= 1 && n_parts <= n_faces, "1 part, up to one for each face", n_parts,
               "pass the number of rows");
        expect_array(parts, "parts");
        expect_array(views, "views");
        expect_array(sums, "sums");
        for (int64_t f = 0; f < n_faces; f++)
            expect(parts[f] >= -1 && parts[f] < n_parts, "indices of parts, or -1", parts[f],
                   "count parts from 0");
        const std::scoped_lock lock(object->changes);
        const int64_t k = object->all->views();
        for (int64_t p = 0; p < n_parts; p++)
            expect(views[p] >= 1 && views[p] <= k, "views of 1 to those of rc_union_create",
                   views[p], "create a union with more views");
        const engine::Room<double> levels = object->all->areas(k), both = object->all->bounds();
        area::sum_parts({{levels.data(), {k, n_faces}},
                         {both.data(), {2, n_faces}},
                         object->surface->mesh.arrays->areas.rows()},
                        {parts, {n_faces}}, {views, {n_parts}}, {sums, {n_parts, k + 3}});
    });
}

rc_status rc_union_complete(const rc_union *unite, rc_union **complete) {
    return guard("completing a union", [&] {
        expect_result(complete);
        const auto object = object_of(unite);
        const std::scoped_lock lock(object->changes);
        *complete = handles().add<rc_union>(complete_union(*object));
    });
}

rc_status rc_union_size(const rc_union *unite, int64_t *n_polygons, int64_t *n_corners) {
    return guard("reading parts", [&] {
        const auto object = object_of(unite);
        expect_array(n_polygons, "n_polygons");
        expect_array(n_corners, "n_corners");
        const std::scoped_lock lock(object->changes);
        const auto [n, corners] = object->all->size();
        *n_polygons = n;
        *n_corners = corners;
    });
}

rc_status rc_union_read(const rc_union *unite, int64_t n_polygons, int64_t n_corners,
                        int32_t *faces, int32_t *counts, int32_t *tags, double *areas,
                        double *corners) {
    return guard("reading parts", [&] {
        const auto object = object_of(unite);
        const std::scoped_lock lock(object->changes);
        const auto [n, n_all] = object->all->size();
        expect(n_polygons == n && n_corners == n_all, "n_polygons and n_corners of rc_union_size",
               n_polygons, "call it for this union first");
        if (n == 0) return;
        expect_array(faces, "faces");
        expect_array(counts, "counts");
        expect_array(tags, "tags");
        expect_array(areas, "areas");
        expect_array(corners, "corners");
        const Partition parts(*object->all);
        std::copy(parts.face.begin(), parts.face.end(), faces);
        std::copy(parts.tag.begin(), parts.tag.end(), tags);
        std::copy(parts.area.begin(), parts.area.end(), areas);
        for (size_t p = 0; p < parts.face.size(); p++)
            counts[p] = int32_t(parts.starts[p + 1] - parts.starts[p]);
        write_corners(*object->surface, parts.face, counts, parts.xy.data(), corners);
    });
}

rc_status rc_union_alone(const rc_union *unite, int32_t views, const rc_regions *regions,
                         int64_t pose, double *area) {
    return guard("reading areas", [&] {
        expect_result(area);
        const auto object = object_of(unite);
        const auto own = object_of(regions);
        require(object->surface == own->surface,
                "expected regions of the surface of the union, got those of another surface; "
                "create a union for each surface");
        const std::scoped_lock lock(object->changes);
        expect(views >= 1 && views < object->all->views(), "views below those of rc_union_create",
               views, "create a union with one view more");
        const double slack = SLACK_REL * object->surface->mesh.diagonal;
        *area = alone_of(*object->all, views, pose_of(*own, pose), slack);
    });
}
