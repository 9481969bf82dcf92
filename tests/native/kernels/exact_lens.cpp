// Places of vertices and bulges of edges in a plane of a lens; see exact/passes.hpp.
//
// Twin: tests/exact/test_lens_measures.py.
#include "bind.hpp"
#include "exact/passes.hpp"

namespace rastercov {
void register_exact_lens(nanobind::module_ &m) {
    using namespace exact;
    m.attr("EDGE_ROUNDING") = EDGE_ROUNDING;
    def(m, "vertex_images", vertex_images,
        "Fill in `places`, (V, 4): x, y of vertices in a plane, and u, v, px, NaN outside its "
        "window.\n\n"
        "`uvw` is of the pinhole of the plane; `is_inside`, (V,), are those in the window. A "
        "vertex "
        "next to a curved border of the window may count as outside; with a hole all do.",
        "uvw", "plane", "places", "is_inside");
    def(m, "edge_bulges", edge_bulges,
        "Fill in `bulge`, (E,), the area between the image of each edge and its chord, px^2, from "
        "its first end to its second; the number of edges that are too long for any rule.\n\n"
        "NaN for these, which are listed in `longer`, and for an edge with an end outside the "
        "window. `places` are those of `vertex_images`; the plane has no pole.",
        "plane", "ends", "places", "bulge", "longer");
}
} // namespace rastercov
