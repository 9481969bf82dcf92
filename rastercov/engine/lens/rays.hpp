// Rays of pixels; see rays.cpp.
//
// Twin: tests/lenses/test_lens.py.
#pragma once
#include "lens/lens.hpp"

namespace rastercov::lens {

// Ray of unit length that a pixel sees, NaN where no ray of the valid region meets it.
Ray unproject(int64_t code, const Params &p, double u, double v);
// Point of the plane of the base of a pixel, NaN where there is none within LIMIT.
Point<double> base_point(const Params &p, double u, double v);

} // namespace rastercov::lens
