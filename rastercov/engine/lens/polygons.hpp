// Image of one polygon of an ideal plane: its area, and the part of it inside the image.
//
// Most polygons are inside the image or outside it, and their area is the sum over their edges;
// only those that may reach across the border are clamped to it (edges.hpp).
//
// Twin: tests/lenses/test_areas.py, by polygons of many corners.
#pragma once
#include "exact/polygon.hpp"
#include "lens/edges.hpp"

namespace rastercov::lens {

using exact::Points, exact::copy_polygon, exact::keep_inside, exact::side_at;

// Room for a polygon of up to 64 corners cut by a region of up to 132 sides.
constexpr int64_t MOST_CORNERS = 256;

// Signed area of an image, px^2, positive for corners counter-clockwise in (x, y), and of its part
// inside the image of the lens; edges and parts of them that were integrated.
struct Image {
    double whole, inside;
    int64_t rules;
};

// Image of the polygon corners[first] ... corners[last - 1], in units of a plane, within its
// region, as far as it is valid. Unless it is asked for, `whole` may be NaN at the border of the
// image and beyond it.
Image polygon_image(const PlaneRecord &plane, const Corners &corners, int64_t first, int64_t last,
                    EdgeScratch &scratch, bool is_whole_asked);

// --- convex regions, counter-clockwise in (x, y) ---

// True where all corners lie inside a region.
template <class Source> bool is_in_region(const Source &polygon, int64_t n, const Corners &region) {
    for (int64_t i = 0; i < region.rows(); i++) {
        const auto [x0, y0, dx, dy, _] = side_at(region, region.rows(), i);
        for (int64_t p = 0; p < n; p++)
            if (dx * (polygon(p, 1) - y0) - dy * (polygon(p, 0) - x0) < 0) return false;
    }
    return true;
}

// Cuts a polygon in place to one side of a region; returns its corner count.
inline int64_t cut_to_side_of(Points polygon, int64_t n, const Corners &region, int64_t i,
                              Points spare) {
    n = keep_inside(polygon, n, side_at(region, region.rows(), i), spare);
    copy_polygon(spare, n, polygon);
    return n;
}

// Cuts a polygon in place to a region; returns its corner count.
inline int64_t cut_to_region(Points polygon, int64_t n, const Corners &region, Points spare) {
    for (int64_t i = 0; i < region.rows(); i++) {
        n = cut_to_side_of(polygon, n, region, i, spare);
        if (n < 3) return 0;
    }
    return n;
}

// Copies the part of a polygon beyond one side of a region; returns its corner count. Its corners
// on that side are those of cut_to_side_of, bit for bit.
inline int64_t beyond_side_of(Points polygon, int64_t n, const Corners &region, int64_t i,
                              Points out) {
    const exact::Line side = side_at(region, region.rows(), i);
    return keep_inside(polygon, n, {side.u0, side.v0, -side.du, -side.dv, 0.0}, out);
}

// Fills `out` with the whole area, the area inside the image, px^2, and the edges of polygons of a
// plane, in its units and within its region; without the first column the whole area is not found.
void measure_polygons(const PlaneRecord &plane, Corners corners, IntArray starts,
                      Array<double, Any, Any> out);
// Fills in what exact::edge_bulges left: edges, by their rows, too long for one rule. NaN remains
// for an edge of too many parts, and on a plane with a pole.
void bulges_by_parts(const PlaneRecord &plane, Int32Array edges, Array<const int32_t, Any, 2> ends,
                     FloatRows<4> places, Column<double> bulge);

} // namespace rastercov::lens
