// Areas of parts of a surface for Python, see sums.hpp.
//
// Twin: tests/area/test_sums.py.
#include "area/sums.hpp"
#include "bind.hpp"

namespace rastercov {

RECORD(area::CoveredFaces, levels, bounds, areas);

namespace area {
namespace {

void sum_areas(const CoveredFaces &of, Int32Array part, Int32Array views,
               Array<double, Any, Any> out) {
    const int64_t n = of.areas.rows(), k = of.levels.rows();
    require(of.levels.extent(1) == n && of.bounds.extent(1) == n && part.rows() == n,
            "levels, bounds and part must have one column for each face");
    require(out.rows() == views.rows() && out.extent(1) == k + 3,
            "out must have one row for each part, with three numbers besides its levels");
    for (const int32_t each : part) require(each < views.rows(), "part must hold parts, or -1");
    for (const int32_t each : views)
        require(each >= 1 && each <= k, "views must be of 1 to the number of levels");
    sum_parts(of, part, views, out);
}

} // namespace
} // namespace area

void register_area_sums(nanobind::module_ &m) {
    def(m, "sum_areas", area::sum_areas,
        "Set rows of `out` to the covered areas of parts, their bound, what may be covered "
        "besides, and the area of each.",
        "of", "part", "views", "out");
}

} // namespace rastercov
