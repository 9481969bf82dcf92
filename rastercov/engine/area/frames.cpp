// Frames of faces, see rastercov.core.area.polygons.
//
// Twin: tests/area/test_face_frames.py.
#include "area/frames.hpp"
#include "bind.hpp"
#include "interrupt.hpp"

namespace rastercov {
namespace area {

using Rows3 = Array<double, Any, 3>;

struct FrameRows {
    Rows3 origin, x_axis, y_axis, normal;
    Array<double, Any, 3, 2> corners;
    Column<double> areas;
};

namespace {

// Sets `out` to the frames of faces; those of faces that are flat, or have no area, stay as they
// are.
void build_frames(FloatRows<3> vertices, Array<const int64_t, Any, 3> faces, BoolArray is_flat,
                  const FrameRows &out) {
    const int64_t n = faces.rows();
    require_indices(faces, vertices.rows(), "faces must hold vertices");
    require(have_rows(n, is_flat, out.origin, out.x_axis, out.y_axis, out.normal, out.corners,
                      out.areas),
            "is_flat and out must have one row for each face");
    Poll poll;
    for (int64_t f = 0; f < n; f++) {
        poll();
        if (is_flat[f]) continue;
        const Frame frame(
            {vertices[faces(f, 0)].data, vertices[faces(f, 1)].data, vertices[faces(f, 2)].data});
        if (!(frame.area() > 0)) continue;
        for (int i = 0; i < 3; i++) {
            out.origin(f, i) = frame.origin[i];
            out.x_axis(f, i) = frame.x_axis[i];
            out.y_axis(f, i) = frame.y_axis[i];
            out.normal(f, i) = frame.normal(i);
        }
        out.corners(f, 1, 0) = frame.longest;
        out.corners(f, 2, 0) = frame.x;
        out.corners(f, 2, 1) = frame.y;
        out.areas[f] = frame.area();
    }
}

} // namespace
} // namespace area

RECORD(area::FrameRows, origin, x_axis, y_axis, normal, corners, areas);

void register_area_frames(nanobind::module_ &m) {
    def(m, "build_frames", area::build_frames, "Set rows of `out` to the frames of faces.",
        "vertices", "faces", "is_flat", "out");
}

} // namespace rastercov
