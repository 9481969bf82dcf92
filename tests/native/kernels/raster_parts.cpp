// Sizes of the rasteriser and the count of one triangle; see solver/raster.hpp.
//
// Twins: rastercov.reference.triangle_samples, tests/raster/test_clusters.py.
#include "bind.hpp"
#include "solver/raster.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
RECORD(raster::Plane, origin, slope_x, slope_y);
RECORD(raster::Tile, left, top, width, height);
RECORD(raster::Runs, first, last);

void register_raster_parts(nanobind::module_ &m) {
    using namespace raster;
    m.attr("GUARD_BAND") = GUARD_BAND;
    m.attr("FACES") = FACES;
    m.attr("VERTICES") = VERTICES;
    m.attr("LINE_BITS") = LINE_BITS;
    m.attr("VERTEX_STEP") = VERTEX_STEP;
    m.attr("BOUNDS_OF_CLUSTER") = int(BOUNDS_OF_CLUSTER);
    m.attr("ALTITUDE") = int(ALTITUDE);
    def(m, "count_triangle", count_triangle,
        "Samples of a tile that a triangle covers, and those that no surface is in front of.", "x",
        "y", "plane", "least", "greatest", "tile", "runs", "depth");
}
} // namespace rastercov
