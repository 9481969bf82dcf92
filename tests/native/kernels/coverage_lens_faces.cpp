// Areas of the images of faces through a lens by their polygons alone, for tests of area_inside.
//
// Twins: tests/lenses/test_face_kernels.py.
#include "bind.hpp"
#include "coverage/lens_faces.hpp"
#include <memory>

namespace rastercov {
namespace coverage {
namespace {

void polygon_areas(FloatRows<3> vertices, Array<const uint64_t, Any, 3> faces, Pose pose,
                   double near, const CurvedLens &lens, VertexRows<CurvedLens> points,
                   Column<double> out) {
    require_lens(lens);
    require(points.rows() == vertices.rows(), "points must have a row for each vertex");
    require(out.rows() == faces.rows(), "out must have one row for each face");
    require_indices(faces, vertices.rows(), "faces must hold rows of vertices");
    const auto memory = std::make_unique<Memory<CurvedLens>>();
    project(vertices, pose, near, lens, points);
    for (int64_t f = 0; f < faces.rows(); f++) {
        const auto corners = corners_of<double>(faces[f].begin(), points);
        out[f] = curved_areas(corners, near, lens, *memory).whole;
    }
}

} // namespace
} // namespace coverage

void register_coverage_lens_faces(nanobind::module_ &m) {
    def(m, "polygon_areas", coverage::polygon_areas,
        "Set `out`, (F,), to the areas of the images of faces through a lens, px^2.", "vertices",
        "faces", "pose", "near", "lens", "points", "out");
}

} // namespace rastercov
