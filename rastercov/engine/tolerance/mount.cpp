// Poses with errors, and planes of faces.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/mount.hpp"

namespace rastercov::engine {

namespace {
constexpr double LEAST_HEIGHT_REL =
    1e-11; // of the diagonal: an edge at this height is in the plane
} // namespace

FacePlanes::FacePlanes(const Surface &surface)
    : normal(size_t(surface.n_opaque())), offset(size_t(surface.n_opaque())),
      mesh_face(size_t(surface.n_opaque())) {
    const auto &place = surface.place();
    for (int64_t f = 0; f < place.rows(); f++)
        if (place[f] < surface.n_opaque()) mesh_face[size_t(place[f])] = int32_t(f);
    for (int64_t f = 0; f < surface.n_opaque(); f++) {
        if (place.rows() == 0) mesh_face[size_t(f)] = int32_t(f);
        const auto corner = [&](int k) {
            const auto at = surface.vertices()[surface.faces()(f, k)];
            return Vector{at[0], at[1], at[2]};
        };
        const Vector a = corner(0), n = cross(corner(1) - a, corner(2) - a);
        const double size = length(n);
        if (!(size > 0)) continue;
        normal[size_t(f)] = 1 / size * n;
        offset[size_t(f)] = -dot(normal[size_t(f)], a);
    }
}

Posed::Posed(const Surface &surface, const FacePlanes &face_planes, const area::Planes &planes,
             const Mount &mount, const RegionRows &rows)
    : surface(surface), face_planes(face_planes), planes(planes), mount(mount), rows(rows),
      first(size_t(planes.areas.rows()) + 1) {
    for (const int32_t f : rows.pieces.face) first[size_t(f) + 1]++;
    for (size_t f = 1; f < first.size(); f++) first[f] += first[f - 1];
}

area::ShadowCaster Posed::caster(const Plane &plane, double radius, double deepest) const {
    return {plane, radius, deepest, LEAST_HEIGHT_REL * surface.diagonal(), mount.disc};
}

std::array<Vector, 4> border_of(const Lens &of, double longer) {
    std::array<Vector, 4> normals = {Vector{of.fx, 0, of.cx}, Vector{-of.fx, 0, of.width - of.cx},
                                     Vector{0, of.fy, of.cy}, Vector{0, -of.fy, of.height - of.cy}};
    for (Vector &each : normals) {
        const double scale = each.z < 0 ? 1 - longer : 1 + longer;
        each = {scale * each.x, scale * each.y, each.z};
        each = 1 / length(each) * each;
    }
    return normals;
}

int64_t tidy_hull(Points points, int64_t n, double nearest) {
    area::Polygon memory;
    n = area::make_hull(points, n);
    if (n < 3) return 0;
    const int64_t kept = area::without_needless(points, n, nearest, memory.points());
    area::copy_polygon(memory.points(), kept, points);
    return kept;
}

} // namespace rastercov::engine
