// What Python holds of a surface.
//
// Twin: rastercov.core.exact.surface.
#pragma once
#include "solver/surface.hpp"

namespace rastercov {

struct SurfaceHandle {
    std::shared_ptr<const engine::Surface> surface;
};

} // namespace rastercov
