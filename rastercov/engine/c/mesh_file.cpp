// Meshes of C from the bytes of files.
//
// Twins: tests/native/test_c_border.py, tests/mesh/test_page_readers.py.
#include "readers/mesh_file.hpp"
#include "c/objects.hpp"

namespace rastercov::c {
namespace {
struct FileObject {
    readers::MeshFile mesh;
    std::string text;
};

void copy(const std::vector<int64_t> &from, int32_t *to, const char *name) {
    expect_array(to, name);
    std::transform(from.begin(), from.end(), to, [](int64_t each) { return int32_t(each); });
}
} // namespace
RASTERCOV_HANDLE(rc_mesh, FileObject);
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_read_mesh(const uint8_t *bytes, int64_t n_bytes, int32_t format, double unit,
                       int64_t most_faces, int64_t memory_budget, rc_mesh **mesh) {
    return guard("reading a mesh", [&] {
        expect_result(mesh);
        expect_array(bytes, "bytes");
        expect(n_bytes >= 0, "0 bytes or more", n_bytes, "pass the size of the file");
        expect(format >= 0 && format < readers::N_FORMATS, "RC_STL, RC_OBJ, RC_PLY or RC_OFF",
               format, "pass one of them");
        expect(unit > 0.0 && unit <= engine::LARGEST_COORDINATE, "a unit above 0 m", unit,
               "pass 1 for metres, 0.001 for millimetres");
        const auto made = std::make_shared<FileObject>();
        made->mesh = readers::read(
            readers::Format(format), {reinterpret_cast<const char *>(bytes), size_t(n_bytes)},
            {memory_budget, std::min<int64_t>(most_faces, std::numeric_limits<int32_t>::max())});
        expect(made->mesh.n_vertices() <= std::numeric_limits<int32_t>::max(),
               "fewer than 2^31 vertices", made->mesh.n_vertices(), "split the mesh");
        for (double &each : made->mesh.vertices) each *= unit;
        readers::check_coordinates(made->mesh);
        auto &[vertices, faces, polygon, group, names, notes] = made->mesh;
        for (auto &note :
             readers::cut_concave(vertices.data(), faces.data(), polygon.data(), polygon.size()))
            notes.push_back(std::move(note));
        for (const auto *lines : {&made->mesh.names, &made->mesh.notes})
            for (const std::string &line : *lines) made->text += line + '\n';
        *mesh = handles().add<rc_mesh>(made);
    });
}
rc_status rc_mesh_free(rc_mesh *mesh) { return free_handle(mesh); }

rc_status rc_mesh_size(const rc_mesh *mesh, int64_t *n_vertices, int64_t *n_faces,
                       int64_t *n_groups, int64_t *n_text) {
    return guard("reading a mesh", [&] {
        const auto object = object_of(mesh);
        for (const void *each : {n_vertices, n_faces, n_groups, n_text})
            expect_array(each, "each size");
        *n_vertices = object->mesh.n_vertices();
        *n_faces = int64_t(object->mesh.polygon.size());
        *n_groups = int64_t(object->mesh.names.size());
        *n_text = int64_t(object->text.size());
    });
}

rc_status rc_mesh_read(const rc_mesh *mesh, int64_t n_vertices, int64_t n_faces, double *vertices,
                       int32_t *faces, int32_t *polygons, int32_t *groups) {
    return guard("reading a mesh", [&] {
        const auto object = object_of(mesh);
        const readers::MeshFile &own = object->mesh;
        expect(n_vertices == own.n_vertices() && n_faces == int64_t(own.polygon.size()),
               "n_vertices and n_faces of rc_mesh_size", n_vertices, "call it first");
        expect_array(vertices, "vertices");
        std::copy(own.vertices.begin(), own.vertices.end(), vertices);
        copy(own.faces, faces, "faces");
        copy(own.polygon, polygons, "polygons");
        copy(own.group, groups, "groups");
    });
}

rc_status rc_mesh_text(const rc_mesh *mesh, int64_t n_text, uint8_t *text) {
    return guard("reading a mesh", [&] {
        const auto object = object_of(mesh);
        expect(n_text == int64_t(object->text.size()), "n_text of rc_mesh_size", n_text,
               "call it first");
        expect_array(text, "text");
        std::copy(object->text.begin(), object->text.end(), text);
    });
}
