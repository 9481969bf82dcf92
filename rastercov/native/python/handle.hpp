// What Python holds of a surface.
//
// Twin: rastercov.exact.surface.
#pragma once
#include "engine/surface.hpp"

namespace rastercov {

struct SurfaceHandle {
    std::shared_ptr<const engine::Surface> surface;
};

} // namespace rastercov
