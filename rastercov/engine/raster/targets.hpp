// Samples of faces one by one against a band that is drawn; see targets.cpp.
//
// Twin: tests/support/triangle_samples.py.
#pragma once
#include "raster/view.hpp"
#include <utility>

namespace rastercov::raster {

// Depth by which a surface must be in front of a target to hide it, relative: 8 roundings to
// float32, by which the depths of one surface differ between devices.
constexpr double TIE_REL = 0x1p-20;
constexpr int64_t MAX_SIDE = GUARD_BAND / STEPS;

// Lanes of the blocks of a band: those that count, where samples are scattered; 1/z of the nearest
// surface, 0 for none; and marks of strips, 0 where none was drawn.
struct Lanes {
    Column<const uint16_t> used;
    Column<const float> inverse;
    Column<const uint8_t> marks;
};

struct Corner {
    int64_t x, y;
};
// A triangle on the canvas: corners in steps; 1/z, and its extremes at the corners: a sample can
// lie beyond them by rounding, its depth must not.
struct Triangle {
    Corner corners[3];
    Plane plane;
    double least, greatest;
};
using Counted = std::pair<int64_t, int64_t>;
// Samples of a band that a triangle covers, and those of them that no surface is in front of.
Counted count_samples(Triangle triangle, const Window &window, const Lanes &lanes);
// Adds the samples of targets in a band of one pose to their counts.
void count_targets(const View &view, const Window &window, const Lanes &lanes,
                   Column<int64_t> visible, Column<int64_t> drawn);
// True if some target may have samples in a band.
bool reach_band(const View &view, const Window &window);

} // namespace rastercov::raster
