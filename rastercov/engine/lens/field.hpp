// Field of view of a lens in an ideal plane as a tree of lines, and bounds of its derivatives.
//
// The tree divides the plane by straight lines into convex cells that are inside the image, outside
// it, or so narrow that they are left undecided; field.cpp makes it. The bounds are from the grid
// of slopes.cpp.
//
// Twins: tests/lenses/test_field.py, tests/lenses/test_slopes.py.
#pragma once
#include "array.hpp"
#include "range.hpp"
#include <algorithm>
#include <cmath>
#include <limits>

namespace rastercov {

namespace lens {

// Leaves of the tree, in place of nodes.
enum Leaf : int32_t { INSIDE = -1, OUTSIDE = -2, UNDECIDED = -3 };
// Kinds of nodes: a line without meaning, one that halves the band along a border, and a border of
// the region or one side of the band, where rounding of a position counts.
enum LineKind : uint8_t { HALVING, BAND, BORDER };

// Points (x, y) with a x + b y + c >= 0 are inside a line (a, b, c), (a, b) of unit length.
// `children` follow inside and outside: a node or a leaf; root is node 0 or a leaf.
struct Tree {
    FloatRows<3> lines;
    Array<const int32_t, Any, 2> children;
    Column<const uint8_t> kinds;
    int64_t root;
};

// Cells of a side of the grid for balls, and parts of the side of a cell.
constexpr int64_t CELLS = 32, PARTS = 4;

// Bounds of derivatives along lines of a plane, px per unit^2 and unit^3; A is the first derivative
// of pixels.
struct Slopes {
    double low_x, low_y, per_x, per_y; // corner of the grid, and parts a unit
    // By row (y) and column (x); 0 beyond the region, infinite where nothing is known.
    Array<const double, CELLS * PARTS, CELLS * PARTS> second, third;
    // Least and greatest |det A|, px^2, of each cell; infinite and 0 beyond the region; 0 and
    // infinite where nothing is known.
    Array<const double, 2, CELLS, CELLS> sizes;
    // Bounds of |(A^-1)'| d, |(A^-1)''| d^2, |L'| d and |L''| d^2, L = log |det A|, at a distance d
    // from (0, 0), where the plane has a pole or the ray opposite to the axis; infinite elsewhere.
    Array<const double, 4> near_axis;
};

struct GridParts {
    int64_t left, right, top, bottom; // first and last column, first and last row
};

// Parts that meet a box of a plane.
inline GridParts parts_within(const Slopes &slopes, double low_x, double high_x, double low_y,
                              double high_y) {
    constexpr int64_t last = CELLS * PARTS - 1;
    const auto part = [](double position, double low, double per_unit) {
        const double at = (position - low) * per_unit;
        return at < double(last) ? std::max(int64_t(std::max(at, 0.0)), int64_t(0)) : last;
    };
    return {part(low_x, slopes.low_x, slopes.per_x), part(high_x, slopes.low_x, slopes.per_x),
            part(low_y, slopes.low_y, slopes.per_y), part(high_y, slopes.low_y, slopes.per_y)};
}

// Bounds of derivatives in the region within a box of a plane: second and third of pixels, first
// and second of A^-1 and of log |det A|.
struct Bends {
    double second, third, inverse_1, inverse_2, log_det_1, log_det_2;
};
inline Bends bounds_within(const Slopes &slopes, double low_x, double high_x, double low_y,
                           double high_y) {
    const double x = std::max(std::max(low_x, -high_x), 0.0);
    const double y = std::max(std::max(low_y, -high_y), 0.0);
    const double d2 = x * x + y * y, d = std::sqrt(d2);
    const auto &near = slopes.near_axis;
    Bends most = {0.0, 0.0, near[0] / d, near[1] / d2, near[2] / d, near[3] / d2};
    const auto [left, right, top, bottom] = parts_within(slopes, low_x, high_x, low_y, high_y);
    for (int64_t row = top; row <= bottom; row++)
        for (int64_t column = left; column <= right; column++) {
            most.second = std::max(most.second, slopes.second(row, column));
            most.third = std::max(most.third, slopes.third(row, column));
        }
    return most;
}

// Least and greatest of `sizes` in the region within a box of a plane.
inline Range sizes_within(const Slopes &slopes, double low_x, double high_x, double low_y,
                          double high_y) {
    Range all = {INFINITY, 0.0};
    const auto [left, right, top, bottom] = parts_within(slopes, low_x, high_x, low_y, high_y);
    for (int64_t row = top / PARTS; row <= bottom / PARTS; row++)
        for (int64_t column = left / PARTS; column <= right / PARTS; column++) {
            all.least = std::min(all.least, slopes.sizes(0, row, column));
            all.most = std::max(all.most, slopes.sizes(1, row, column));
        }
    return all;
}

} // namespace lens

RECORD(lens::Tree, lines, children, kinds, root);
RECORD(lens::Slopes, low_x, low_y, per_x, per_y, second, third, sizes, near_axis);

} // namespace rastercov
