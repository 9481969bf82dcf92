// Mesh of a host without Python: checked arrays, roles and frames of its faces, and its surface.
//
// Twin: rastercov.core.mesh.mesh, rastercov.core.area.polygons.
#pragma once
#include "area/plane.hpp"
#include "solver/build.hpp"

namespace rastercov::engine {

// Roles of a face, added.
enum Role : uint8_t { OCCLUDER = 1, TARGET = 2, TWO_SIDED = 4 };

struct MeshArrays {
    Room<double> vertices;
    Room<int64_t> faces;  // welded corners, of all faces
    Room<int64_t> opaque; // those of the faces that hide
    Room<double> box;     // vertices of a mesh of targets alone
    Room<bool> opaque_is_flat, is_target, two_sided, is_asked; // is_asked: no occluder
    Room<double> origin, x_axis, y_axis, normal, corners, areas;

    area::Planes planes() const {
        return {origin.rows<3>(),     x_axis.rows<3>(), y_axis.rows<3>(), normal.rows<3>(),
                corners.rows<3, 2>(), areas.rows(),     two_sided.rows(), is_asked.rows()};
    }
};

struct Mesh {
    std::shared_ptr<const MeshArrays> arrays;
    std::shared_ptr<const Surface> surface;
    double diagonal; // of the faces that hide, metres

    int64_t n_faces() const { return arrays->areas.size(); }
};

// Copies vertices, (V, 3), faces, (F, 3), and roles, (F,) or none.
Mesh make_mesh(exact::Vertices vertices, Faces faces, Column<const uint8_t> roles);

} // namespace rastercov::engine
