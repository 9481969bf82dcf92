// Regions that one pose covers, see region.cpp.
//
// Twins: rastercov.reference.regions, point by point.
#pragma once
#include "area/plane.hpp"

namespace rastercov::area {

// Steps of cut_pieces, in their order.
enum Step { TO_DISCS, TO_VIEW, TO_DENSITIES };

// Where `used` of `out` is more than there is room for, call again with that much.
void cut_regions(const Planes &planes, const Criteria &criteria, const Seen &seen,
                 const Found &out);
void cut_pieces(const Planes &planes, const LensCriteria &criteria, const Seen &seen,
                const Found &source, Step step, const Found &out);

} // namespace rastercov::area
