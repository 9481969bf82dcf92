// A camera as solvers take it: a pinhole, or the ideal planes that together see what a lens does.
//
// A lens bends lines and hides nothing: what is in front of what is decided on each ray. So
// visibility is computed in pinholes, and faces and their visible pieces are mapped to pixels. The
// pinhole of a plane of parallel rays has fx and fy in px/m, its record in pixels a unit.
//
// Twin: rastercov.core.camera.lenses.of_camera.
#pragma once
#include "area/plane.hpp"
#include "lens/planes.hpp"
#include <vector>

namespace rastercov::engine {

struct IdealPlane {
    lens::PlaneRecord record;
    Lens pinhole;
};

struct Camera {
    Lens image;                     // of a lens the size alone
    double near;                    // least depth that is seen, metres
    std::vector<IdealPlane> planes; // none of a pinhole; those of one frame follow one another
    bool is_parallel = false;       // rays run along z: `image` has fx and fy in px/m
};

// Pointwise criteria of a task in the image of a camera: in that of a pinhole, `pinhole` of one row
// alone; or in each of its planes. Gaps are relative to the diagonal of a surface.
struct CameraTask {
    std::vector<area::LensCriteria> planes;
};

} // namespace rastercov::engine
