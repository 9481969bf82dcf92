// Angle of incidence of one face; see coverage/criteria.hpp.
//
// Twin: tests/test_criteria.py.
#include "bind.hpp"
#include "coverage/criteria.hpp"

namespace rastercov {
void register_coverage_angles(nanobind::module_ &m) {
    def(m, "incidence_angle", coverage::incidence_angle<double>,
        "Angle of incidence, radians: the arccosine, within an ulp.", "cosine");
}
} // namespace rastercov
