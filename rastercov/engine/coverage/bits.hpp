// Bits of the faces that poses cover, judged while the counts of a pose are in the cache.
//
// Twins: rastercov.reference.coverage, by tests/raster/test_one_pass.py.
#pragma once
#include "coverage/face.hpp"
#include "solver/raster.hpp"

namespace rastercov {
namespace coverage {

// Faces that the rasteriser does not draw, if there are any: their rows and those of all others,
// and their samples, (P, N).
struct TargetCounts {
    IntArray rows, opaque;
    Array<const int64_t, Any, Any> visible, drawn;
};

// Poses, world_from_camera; what decides about their faces: the mesh, thresholds, units of area,
// samples in a pixel, targets; and what is found: bits of the faces that each pose covers, from the
// lowest of the first byte on; the sums of their area units; and the poses that cover each face.
struct Judging {
    FloatRows<4, 4> poses;
    Scene scene;
    Rules rules;
    IntArray area_units;
    double scale;
    TargetCounts targets;
    Array<uint8_t, Any, Any> words;
    Column<int64_t> areas, views;
};

template <class Camera> struct OnePass {
    // Counts poses, sets the bits of faces that they cover, and adds views.
    static void judge(raster::Rasterizer &rasterizer, const raster::Canvases &canvases,
                      const raster::Looks &looks, const Camera &camera, const Judging &judging,
                      int64_t n_threads);
};

} // namespace coverage

RECORD(coverage::TargetCounts, rows, opaque, visible, drawn);
RECORD(coverage::Judging, poses, scene, rules, area_units, scale, targets, words, areas, views);

} // namespace rastercov
