// Readers of plain meshes, STL, OBJ, PLY and OFF, for Python, C and pages.
//
// A reader trusts no number of its file: a count is compared with the bytes that are present before
// memory is allocated, and content that cannot be parsed is an error with its line or byte. Readers
// keep the file's order of vertices and polygons and neither merge nor drop any, except for STL,
// which repeats every vertex: those that are equal bit for bit become one.
//
// Twins: tests/mesh/test_mesh_text.py, tests/mesh/test_page_readers.py.
#pragma once
#include "error.hpp"
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace rastercov::readers {

enum Format { STL, OBJ, PLY, OFF, N_FORMATS };

using String = std::string;
using Reals = std::vector<double>;
using Wholes = std::vector<int64_t>;
using Strings = std::vector<String>;

struct Limits {
    int64_t bytes = int64_t(8) << 30; // that reading may need, by an estimate
    int64_t faces = INT32_MAX;
};

// Content of a file, its polygons cut into fans about their first corner.
struct MeshFile {
    Reals vertices; // V x 3, in the unit of the file
    Wholes faces;   // F x 3
    Wholes polygon; // of each face
    Wholes group;   // of each face
    Strings names;  // of the groups, as in the file; empty outside of any
    Strings notes;  // oddities that a user should know

    int64_t n_vertices() const { return int64_t(vertices.size() / 3); }
};

// More faces or memory than the limits allow.
struct TooLarge : Error {
    using Error::Error;
};

// The mesh of the bytes of a file; an Error says what is wrong about it.
MeshFile read(Format format, std::string_view data, const Limits &limits);

// Refuses coordinates that are not finite or too large.
void check_coordinates(const MeshFile &mesh);

// Replaces, in place, fans that fold over by triangles that cover their polygon once: one that
// crosses itself keeps its fan. A fan is consecutive triangles of a polygon that share their first
// corner and an edge. `polygon` is of each of n faces; notes are on polygons that are not flat,
// and that cross or touch themselves.
Strings cut_concave(const double *vertices, int64_t *faces, const int64_t *polygon, size_t n);

} // namespace rastercov::readers
