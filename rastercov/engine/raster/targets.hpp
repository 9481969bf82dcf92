// Samples of faces one by one against an image that is drawn; see targets.cpp.
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

// Part of a canvas, in samples.
struct Tile {
    int64_t left, top, width, height;
};
// First sample of each row of the canvas that counts, and the one after the last.
struct Runs {
    Int32Array first, last;
};
// Depth of the nearest surface at each sample of the tile, metres, inf for none; empty where what
// is in front does not matter: then none is counted as seen.
using Depth = Array<const float, Any, Any>;
// Scattered samples of a canvas: the lanes of each of its blocks, and those that count, see Window
// and Counts; their depths as above, and blocks in a row.
struct Lanes {
    Int32Array offsets;
    Column<const uint16_t> used;
    Column<const float> depth;
    int64_t columns;
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
// Samples of a tile that a triangle covers, and those of them that no surface is in front of.
Counted count_samples(Triangle triangle, const Tile &tile, const Runs &runs, const Depth &depth);
// Adds the samples of targets in a tile of one pose to their counts. `rows` are those of
// rows_of_targets.
void count_targets(const View &view, Array<const int64_t, Any, 2> rows, const Tile &tile,
                   const Runs &runs, Depth depth, Column<int64_t> visible, Column<int64_t> drawn);
// Adds the scattered samples of targets in one pose to their counts; the tile is the whole canvas.
void count_scattered(const View &view, const Tile &tile, const Lanes &lanes,
                     Column<int64_t> visible, Column<int64_t> drawn);
// Finds the rows of samples that each target may reach in one pose: the first one and the one
// after the last; both 0 for none.
void rows_of_targets(const View &view, int64_t height, Array<int64_t, Any, 2> rows);

} // namespace rastercov::raster
