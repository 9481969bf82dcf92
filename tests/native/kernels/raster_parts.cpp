// Sizes of the rasteriser and the count of one triangle; see solver/raster.hpp.
//
// Twins: tests/support/triangle_samples.py, tests/raster/test_clusters.py.
#include "bind.hpp"
#include "solver/raster.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
RECORD(raster::Plane, origin, slope_x, slope_y);

namespace raster {
namespace {

// Of a band from row `top` on, of whose samples this is 1/z, (H, W).
Counted count_triangle(Array<const int64_t, 3> x, Array<const int64_t, 3> y, const Plane &plane,
                       double least, double greatest, Array<const int32_t, 2, Any> runs,
                       int64_t top, Array<const float, Any, Any> inverse) {
    for (int k = 0; k < 3; k++)
        for (const int64_t step : {x[k], y[k]})
            require(step >= -GUARD_BAND && step <= GUARD_BAND, "corners must be within 2^29 steps");
    const int64_t width = inverse.extent(1), bottom = top + inverse.rows();
    require(top % SIDE == 0 && bottom <= runs.extent(1), "the band must be of the canvas");
    const double lens[4] = {1, 1, 0, 0}, mix[4] = {1, 0, 0, 1};
    const Canvas canvas({}, {width, runs.extent(1), {lens, {}}, {mix, {}}, runs, false, false},
                        MAX_BAND);
    std::vector<float> lanes(size_t((bottom - top + SIDE) / SIDE * canvas.columns * LANES));
    for (int64_t row = top; row < bottom; row++)
        for (int64_t column = 0; column < width; column++) {
            const int64_t block = (row - top) / SIDE * canvas.columns + column / SIDE;
            lanes[size_t(block * LANES + row % SIDE * SIDE + column % SIDE)] =
                inverse(row - top, column);
        }
    const std::vector<uint8_t> marks(lanes.size() / STRIP_SAMPLES + 1, 1);
    return count_samples(
        {{{x[0], y[0]}, {x[1], y[1]}, {x[2], y[2]}}, plane, least, greatest},
        canvas.window(top, bottom, false),
        {{}, {lanes.data(), {int64_t(lanes.size())}}, {marks.data(), {int64_t(marks.size())}}});
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
        "Samples of a band that a triangle covers, and those that no surface is in front of.", "x",
        "y", "plane", "least", "greatest", "runs", "top", "inverse");
}
} // namespace rastercov
