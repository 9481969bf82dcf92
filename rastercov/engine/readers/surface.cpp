// What coordinates of a file must meet, for C and pages.
//
// Twins: tests/mesh/test_page_readers.py, tests/native/test_c_border.py.
#include "readers/text.hpp"
#include "solver/build.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov::readers {
namespace {
// A few indices, and the number of all.
String some(const std::vector<size_t> &rows) {
    String all;
    for (size_t k = 0; k < std::min<size_t>(rows.size(), 5); k++)
        all += text(k ? ", " : "[", rows[k]);
    return text(all, rows.size() > 5 ? ", ...], " : "], ", rows.size(), " in all");
}
} // namespace

void check_coordinates(const MeshFile &mesh) {
    const auto is_wrong = [&](int64_t v) {
        const double *const at = mesh.vertices.data() + 3 * v;
        return !std::all_of(at, at + 3,
                            [](double x) { return std::abs(x) <= engine::LARGEST_COORDINATE; });
    };
    std::vector<size_t> vertices, faces;
    for (size_t v = 0; v < mesh.vertices.size() / 3; v++)
        if (is_wrong(int64_t(v))) vertices.push_back(v);
    if (vertices.empty()) return;
    for (size_t f = 0; f < mesh.polygon.size(); f++)
        if (std::any_of(mesh.faces.data() + 3 * f, mesh.faces.data() + 3 * f + 3, is_wrong))
            faces.push_back(f);
    refuse("expected finite coordinates within ±1e+30, got other values in ",
           faces.empty() ? text("vertices ", some(vertices), ", without a face")
                         : "faces " + some(faces),
           "; repair them or drop them on loading (drop_invalid)");
}
} // namespace rastercov::readers
