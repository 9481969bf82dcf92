// Sizes of the rasteriser and the count of one triangle; see solver/raster.hpp.
//
// Twins: tests/support/triangle_samples.py, tests/raster/test_clusters.py.
#include "bind.hpp"
#include "solver/raster.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
RECORD(raster::Plane, origin, slope_x, slope_y);
RECORD(raster::Tile, left, top, width, height);
RECORD(raster::Runs, first, last);

namespace raster {
namespace {

Counted count_triangle(Array<const int64_t, 3> x, Array<const int64_t, 3> y, const Plane &plane,
                       double least, double greatest, const Tile &tile, const Runs &runs,
                       Depth depth) {
    for (int k = 0; k < 3; k++)
        for (const int64_t step : {x[k], y[k]})
            require(step >= -GUARD_BAND && step <= GUARD_BAND, "corners must be within 2^29 steps");
    return count_samples({{{x[0], y[0]}, {x[1], y[1]}, {x[2], y[2]}}, plane, least, greatest}, tile,
                         runs, depth);
}

} // namespace
} // namespace raster

void register_raster_parts(nanobind::module_ &m) {
    using namespace raster;
    m.attr("STEPS") = STEPS;
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
