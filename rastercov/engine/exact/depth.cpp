// Least depth of a surface inside a pyramid, see depth.hpp.
//
// Twin: tests/test_projection.py, by a linear programme.
#include "exact/depth.hpp"
#include "bind.hpp"

namespace rastercov {
namespace {
using namespace exact;

double depth_in_view(Vertices vertices, Array<const int64_t, Any, 3> faces,
                     Array<const double, 4, 4> pose, FloatRows<3> sides, bool is_prism, double near,
                     double enough) {
    require_indices(faces, vertices.rows(), "faces must be rows of vertices");
    double rotation[9], centre[3];
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) rotation[3 * i + k] = pose(i, k);
        centre[i] = pose(i, 3);
    }
    return least_depth(vertices, faces, {rotation, {3, 3}}, {centre, {3}}, sides, is_prism, near,
                       enough);
}

} // namespace

void register_exact_depth(nanobind::module_ &m) {
    def(m, "least_depth", depth_in_view,
        "Least depth of faces beyond `near` inside a pyramid, metres; `enough` where none is "
        "less.\n"
        "\n`sides`, (S, 3), are normals of the sides in camera axes, inwards; of a prism (a, b, c) "
        "with a x + b y + c >= 0.",
        "vertices", "faces", "pose", "sides", "is_prism", "near", "enough");
}
} // namespace rastercov
