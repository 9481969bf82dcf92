// What a mesh of a file must meet where no polygon is cut again.
//
// Twins: tests/mesh/test_page_readers.py, tests/native/test_c_border.py.
#include "readers/text.hpp"
#include "solver/build.hpp"
#include <algorithm>
#include <array>
#include <cmath>

namespace rastercov::readers {
namespace {
using Vector = std::array<double, 3>;
constexpr double FOLD_TOLERANCE_REL = 1e-9; // of an area that may be wound against its polygon

double dot(const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// A few indices, and the number of all.
String some(const std::vector<size_t> &rows) {
    String all;
    for (size_t k = 0; k < std::min<size_t>(rows.size(), 5); k++)
        all += text(k ? ", " : "[", rows[k]);
    return text(all, rows.size() > 5 ? ", ...], " : "], ", rows.size(), " in all");
}

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

// Normals of the triangles of a fan, whose largest side is 1.
std::vector<Vector> normals_of(const MeshFile &mesh, size_t first, size_t end) {
    std::vector<Vector> sides, normals;
    double size = 0.0;
    for (size_t f = first; f < end; f++)
        for (size_t k = 1; k < 3; k++) {
            Vector &side = sides.emplace_back();
            for (size_t axis = 0; axis < 3; axis++) {
                const auto at = [&](size_t corner) {
                    return mesh.vertices[size_t(3 * mesh.faces[3 * f + corner]) + axis];
                };
                side[axis] = at(k) - at(0);
                size = std::max(size, std::abs(side[axis]));
            }
        }
    for (Vector &side : sides)
        for (double &each : side) each /= size > 0.0 ? size : 1.0;
    for (size_t k = 0; k < sides.size(); k += 2) {
        const Vector &a = sides[k], &b = sides[k + 1];
        normals.push_back(
            {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]});
    }
    return normals;
}

// True where a triangle of a fan is wound against it, seen along Newell's normal, or there is none.
bool is_folded(const std::vector<Vector> &normals) {
    Vector sum = {};
    double area = 0.0;
    for (const Vector &each : normals) {
        for (size_t axis = 0; axis < 3; axis++) sum[axis] += each[axis];
        area += std::sqrt(dot(each, each));
    }
    const double size = std::sqrt(dot(sum, sum));
    return (area > 0.0 && size <= FOLD_TOLERANCE_REL * area) ||
           std::any_of(normals.begin(), normals.end(), [&](const Vector &each) {
               return dot(each, sum) < -FOLD_TOLERANCE_REL * size * std::sqrt(dot(each, each));
           });
}
} // namespace

void check_surface(const MeshFile &mesh) {
    check_coordinates(mesh);
    Poll poll;
    const size_t n = mesh.polygon.size();
    for (size_t f = 0, end = 0; f < n; f = end) {
        while (end < n && mesh.polygon[end] == mesh.polygon[f]) end++;
        poll();
        if (end - f > 1 && is_folded(normals_of(mesh, f, end)))
            refuse("face ", mesh.polygon[f],
                   ": expected a triangle or a convex polygon, got "
                   "another polygon; triangulate the mesh");
    }
}
} // namespace rastercov::readers
