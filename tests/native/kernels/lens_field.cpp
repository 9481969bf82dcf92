// Field of view of a plane as a tree, and bounds in a box of one; see lens/field.hpp.
//
// Twins: tests/lenses/test_field.py, tests/lenses/test_slopes.py.
#include "bind.hpp"
#include "lens/proof.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
using namespace lens;

namespace {
using Pair = std::pair<double, double>;
std::pair<Pair, std::pair<Pair, Pair>> bounds_in_box(const Slopes &slopes, double low_x,
                                                     double high_x, double low_y, double high_y) {
    const Bends bends = bounds_within(slopes, low_x, high_x, low_y, high_y);
    return {{bends.second, bends.third},
            {{bends.inverse_1, bends.inverse_2}, {bends.log_det_1, bends.log_det_2}}};
}

Pair sizes_in_box(const Slopes &slopes, double low_x, double high_x, double low_y, double high_y) {
    const auto [least, most] = sizes_within(slopes, low_x, high_x, low_y, high_y);
    return {least, most};
}

} // namespace

void register_lens_field(nanobind::module_ &m) {
    m.attr("CELLS") = CELLS;
    m.attr("PARTS") = PARTS;
    m.attr("INSIDE") = int(INSIDE);
    m.attr("OUTSIDE") = int(OUTSIDE);
    m.attr("UNDECIDED") = int(UNDECIDED);
    m.attr("BAND") = int(BAND);
    def(m, "divide", divide,
        "Fill a tree with the field of view of a plane within a box; its root, a node or a leaf, "
        "and the number of nodes, which may be more than there is room for.\n\n"
        "`box` has the corners, counter-clockwise; `region_lines` and `hole_lines`, (K, 3), are "
        "sides of the region that cut the box, and of the hole, which is inside all of its own. "
        "`tolerance` is the mean width of undecided cells, in units of the plane.",
        "plane", "box", "region_lines", "hole_lines", "tolerance", "lines", "children", "kinds");
    def(m, "bounds_within", bounds_in_box,
        "Bounds of derivatives in the region within a box of a plane: second and third of pixels; "
        "first and second of A^-1 near an axis, and of log |det A|, A the first of pixels.",
        "slopes", "low_x", "high_x", "low_y", "high_y");
    def(m, "sizes_within", sizes_in_box,
        "Least and greatest `Slopes.sizes` in the region within a box of a plane.", "slopes",
        "low_x", "high_x", "low_y", "high_y");
}
} // namespace rastercov
