// The border of readers of plain meshes to Python: rastercov.engine.solver_readers.
//
// Twin: tests/mesh/test_mesh_file.py.
#include "bind.hpp"
#include "python/tables.hpp"
#include "readers/mesh_file.hpp"
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace rastercov {
namespace {

// Vertices, faces, polygon and group of each face, names as bytes, and notes.
nb::tuple read_mesh(int64_t format, Column<const uint8_t> data, int64_t budget) {
    expect(format >= 0 && format < readers::N_FORMATS, "a format of 0 to 3", format,
           "pass one of FORMATS");
    const std::string_view bytes(reinterpret_cast<const char *>(data.data), size_t(data.rows()));
    constexpr auto DOING = "Read a mesh file";
    readers::MeshFile found = call_within_memory(DOING, [&] {
        return call_apart(
            DOING,
            [&] { return readers::read(readers::Format(format), bytes, {budget, INT32_MAX}); },
            data);
    });
    nb::list names;
    for (const std::string &name : found.names) names.append(nb::bytes(name.data(), name.size()));
    return nb::make_tuple(array_of(std::move(found.vertices), 3),
                          array_of(std::move(found.faces), 3), array_of(std::move(found.polygon)),
                          array_of(std::move(found.group)), names, found.notes);
}

std::vector<std::string> cut(FloatRows<3> vertices, Array<int64_t, Any, 3> faces,
                             Column<const int64_t> polygon) {
    require(have_rows(faces.rows(), polygon), "faces and polygon must have the same length");
    return call_within_memory("Cut polygons", [&] {
        return call_apart(
            "Cut polygons",
            [&] {
                return readers::cut_concave(vertices.data, faces.data, polygon.data,
                                            size_t(faces.rows()));
            },
            faces);
    });
}
} // namespace

void register_solver_readers(nb::module_ &m) {
    nb::register_exception_translator([](const std::exception_ptr &raised, void *) {
        try {
            std::rethrow_exception(raised);
        } catch (const readers::TooLarge &error) {
            PyErr_SetString(
                nb::module_::import_("rastercov.base.errors").attr("ResourceError").ptr(),
                error.what());
        }
    });
    m.def("read", read_mesh, nb::arg("format"), nb::arg("data"), nb::arg("budget"),
          nb::sig("def read(format: int, data: object, budget: int) -> tuple[typing.Any, ...]"),
          "Mesh of the bytes of a file.");
    m.def("cut_concave", cut, nb::arg("vertices"), nb::arg("faces"), nb::arg("polygon"),
          nb::sig("def cut_concave(vertices: object, faces: object, polygon: object) -> list[str]"),
          "Cut polygons whose fans fold over; notes.");
}

} // namespace rastercov
