// Mesh of a host without Python: checked arrays, roles and frames of its faces, and its surface.
//
// Twin: rastercov.core.mesh.mesh, rastercov.core.area.polygons.
#include "solver/mesh.hpp"
#include "area/frames.hpp"
#include "solver/contacts.hpp"
#include "vector.hpp"
#include <algorithm>
#include <cmath>
#include <thread>

namespace rastercov::engine {
namespace {
// Sets the frame of face f, of three corners.
void set_frame(MeshArrays &mesh, int64_t f, const double *const (&points)[3]) {
    const area::Frame frame(points);
    if (!(frame.area() > 0.0) || is_flat(points[0], points[1], points[2])) return;
    std::copy_n(frame.origin, 3, mesh.origin.begin() + 3 * f);
    std::copy_n(frame.x_axis, 3, mesh.x_axis.begin() + 3 * f);
    std::copy_n(frame.y_axis, 3, mesh.y_axis.begin() + 3 * f);
    for (int i = 0; i < 3; i++) mesh.normal[3 * f + i] = frame.normal(i);
    mesh.corners[6 * f + 2] = frame.longest;
    mesh.corners[6 * f + 4] = frame.x;
    mesh.corners[6 * f + 5] = frame.y;
    mesh.areas[f] = frame.area();
}

void set_frames(MeshArrays &mesh) {
    const int64_t n = mesh.faces.size() / 3;
    for (auto *each : {&mesh.origin, &mesh.x_axis, &mesh.y_axis, &mesh.normal})
        *each = Room<double>(3 * n, 0.0);
    mesh.corners = Room<double>(6 * n, 0.0);
    mesh.areas = Room<double>(n, 0.0);
    for (int64_t f = 0; f < n; f++) {
        const auto corner = [&](int k) {
            return mesh.vertices.begin() + 3 * mesh.faces[3 * f + k];
        };
        set_frame(mesh, f, {corner(0), corner(1), corner(2)});
    }
}

// Corners by the first vertex at each place, among all vertices or those that are kept.
Room<int64_t> weld_corners(const MeshArrays &mesh, Faces faces, const Room<bool> *is_kept) {
    const int64_t n_vertices = mesh.vertices.size() / 3;
    Room<double> places(mesh.vertices.size());
    for (int64_t k = 0; k < places.size(); k++) places[k] = mesh.vertices[k] + 0.0; // no -0.0
    Room<int64_t> first(n_vertices);
    find_first_equal({reinterpret_cast<const uint64_t *>(places.begin()), {n_vertices, 3}},
                     first.rows());
    if (is_kept) {
        Room<int64_t> first_kept(n_vertices, -1);
        for (int64_t v = 0; v < n_vertices; v++)
            if ((*is_kept)[v] && first_kept[first[v]] < 0) first_kept[first[v]] = v;
        for (int64_t v = 0; v < n_vertices; v++)
            if ((*is_kept)[v]) first[v] = first_kept[first[v]];
    }
    Room<int64_t> corners(faces.size());
    for (int64_t k = 0; k < corners.size(); k++) corners[k] = first[faces.data[k]];
    return corners;
}

// Corners of the faces that hide. Vertices of targets alone do not take part.
void set_opaque(MeshArrays &mesh, Faces faces) {
    Room<bool> is_kept(mesh.vertices.size() / 3, true);
    int64_t n = 0;
    for (const bool is_target : {true, false})
        for (int64_t f = 0; f < faces.rows(); f++) {
            if (mesh.is_target[f] != is_target) continue;
            for (int k = 0; k < 3; k++) is_kept[faces(f, k)] = !is_target;
            n += !is_target;
        }
    const Room<int64_t> corners = weld_corners(mesh, faces, &is_kept);
    mesh.opaque = Room<int64_t>(3 * n);
    n = 0;
    for (int64_t f = 0; f < faces.rows(); f++)
        if (!mesh.is_target[f])
            std::copy_n(corners.rows().data + 3 * f, 3, mesh.opaque.begin() + 3 * n++);
}

// A face without area in place of those that hide, where none does.
void set_no_opaque(MeshArrays &mesh) {
    mesh.box = Room<double>(6);
    for (int axis = 0; axis < 3; axis++) {
        mesh.box[axis] = mesh.box[3 + axis] = mesh.vertices[3 * mesh.faces[0] + axis];
        for (const int64_t v : mesh.faces) {
            mesh.box[axis] = std::min(mesh.box[axis], mesh.vertices[3 * v + axis]);
            mesh.box[3 + axis] = std::max(mesh.box[3 + axis], mesh.vertices[3 * v + axis]);
        }
    }
    mesh.opaque = Room<int64_t>(3, 0);
    mesh.opaque[1] =
        mesh.box[0] != mesh.box[3] || mesh.box[1] != mesh.box[4] || mesh.box[2] != mesh.box[5];
}

// Bounds of the corners of faces.
std::array<Coordinates, 2> bounds_of(exact::Vertices vertices, const Room<int64_t> &faces) {
    Coordinates low, high;
    for (int axis = 0; axis < 3; axis++) {
        Range all;
        for (const int64_t v : faces.rows()) all.add(vertices(v, axis));
        low[size_t(axis)] = all.least;
        high[size_t(axis)] = all.most;
    }
    return {low, high};
}

double diagonal_of(const std::array<Coordinates, 2> &bounds) {
    return length(minus(bounds[1], bounds[0]));
}
} // namespace

Mesh make_mesh(exact::Vertices vertices, Faces faces, Column<const uint8_t> roles) {
    const int64_t n = faces.rows();
    expect(n > 0, "1 face or more", n, "pass a mesh with faces");
    for (const int32_t v : faces) {
        expect(v >= 0 && v < vertices.rows(), "faces with indices of vertices", v,
               "count vertices from 0");
        for (int axis = 0; axis < 3; axis++)
            expect(std::abs(vertices(v, axis)) <= LARGEST_COORDINATE,
                   "finite coordinates within 1e30 m", vertices(v, axis), "check the vertices");
    }
    const auto mesh = std::make_shared<MeshArrays>();
    mesh->vertices = Room<double>(vertices.size());
    std::copy(vertices.begin(), vertices.end(), mesh->vertices.begin());
    mesh->faces = weld_corners(*mesh, faces, nullptr);
    const auto mask = [&](uint8_t bit, bool is_set) {
        Room<bool> found(n, !is_set);
        for (int64_t f = 0; f < roles.rows(); f++) found[f] = bool(roles[f] & bit) == is_set;
        return found;
    };
    mesh->is_target = mask(TARGET, true);
    mesh->two_sided = mask(TWO_SIDED, true);
    mesh->is_asked = mask(OCCLUDER, false);
    set_frames(*mesh);
    set_opaque(*mesh, faces);
    const bool is_empty = mesh->opaque.size() == 0, has_targets = mesh->opaque.size() < 3 * n;
    if (is_empty) set_no_opaque(*mesh);
    const exact::Vertices all = mesh->vertices.rows<3>();
    const Welded opaque = {is_empty ? mesh->box.rows<3>() : all, mesh->opaque.rows<3>()};
    mesh->opaque_is_flat = Room<bool>(opaque.faces.rows());
    for (int64_t f = 0; f < opaque.faces.rows(); f++) {
        const auto corner = [&](int k) { return opaque.vertices[opaque.faces(f, k)].data; };
        mesh->opaque_is_flat[f] = is_flat(corner(0), corner(1), corner(2));
    }
    const double diagonal = diagonal_of(bounds_of(opaque.vertices, mesh->opaque));
    const int64_t n_threads = std::max(1U, std::thread::hardware_concurrency());
    const BoolArray is_target = mesh->is_target.rows();
    auto surface =
        build_surface(opaque, {all, mesh->faces.rows<3>()}, has_targets ? is_target : BoolArray(),
                      finder_of(opaque, mesh->opaque_is_flat.rows(), diagonal, mesh, n_threads));
    return {mesh, std::move(surface), diagonal};
}

} // namespace rastercov::engine
