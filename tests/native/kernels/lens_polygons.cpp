// Areas of polygons of an ideal plane in the image of a lens, many at a time; see
// lens/polygons.hpp.
//
// Twin: tests/lenses/test_areas.py, by polygons of many corners.
#include "bind.hpp"
#include "lens/polygons.hpp"

namespace rastercov {
void register_lens_polygons(nanobind::module_ &m) {
    def(m, "measure_polygons", lens::measure_polygons,
        "Fill `out`, (M, 3), with the whole area, the area inside the image, px^2, and the edges "
        "of "
        "polygons of a plane.\n\n"
        "The corners of polygon i are rows starts[i] ... starts[i + 1] - 1, in units of the plane "
        "and within its region. Without the first column, (M, 2), the whole area is not found.",
        "plane", "corners", "starts", "out");
}
} // namespace rastercov
