// What is proved of a lens, once: its valid region, ideal planes, and bounds of its images there.
//
// A lens that sees up to ONE_PLANE_DEG from its axis has one plane, a wider one the sides of a cube
// that it reaches; see ideal.cpp. All numbers are in pixels and in units of a plane.
//
// Twins: tests/lenses/test_region.py, tests/lenses/test_slopes.py, tests/lenses/test_areas.py.
#pragma once
#include "lens/field.hpp"
#include "lens/planes.hpp"
#include <array>
#include <utility>
#include <vector>

namespace rastercov::lens {

using Numbers = std::array<double, SIZE>; // parameters of a lens
inline Params view_of(const Numbers &p) { return {p.data(), {}}; }

using Outline = std::vector<Point<double>>; // a convex polygon, counter-clockwise in (x, y)
inline Corners view_of(const Outline &outline) {
    return {outline.empty() ? nullptr : &outline[0].x, {int64_t(outline.size())}};
}

inline Rectangle box_of(const Outline &polygon) {
    Rectangle box;
    for (const auto &[x, y] : polygon) box.add(x, y);
    return box;
}

struct Straight { // line a x + b y + c >= 0
    double a, b, c;
    double value(double x, double y) const { return a * x + b * y + c; }
};
// Lines along the sides of a convex polygon, positive inside, with unit normals.
std::vector<Straight> sides_of(const Outline &polygon);
// Part of a convex polygon with a x + b y + c >= 0.
Outline keep(const Outline &polygon, const Straight &line);

// --- models ---

struct Terms {
    int64_t code;
    Numbers params; // up to LATE
    bool is_by_distance, has_closed_form;
};
// Of a model by its code; `pixels` are fx, fy, cx, cy and skew.
Terms terms_of(int64_t model, const double *pixels, const double *coefficients, int64_t n);
// True where the equations of a model with coefficient k are a lens.
bool is_coefficient(int64_t model, int64_t k, double value);

// --- the valid region ---

struct Region {
    Numbers params; // with LIMIT and SLOPE
    double angle;   // of its border from the z axis, radians
    bool is_whole;  // each pixel has a ray of it
};
// `max_angle` is in radians. Fails for a lens that folds at its axis.
Region region_of(int64_t code, const Numbers &given, double width, double height, double max_angle);
// The steps of the proof, for tests; see region.cpp.
double base_limit(int64_t code, const Params &p);
double certified_radius(const Params &p, double top, double enough);
bool are_positive(const std::vector<std::vector<double>> &rows, double low, double high);

// Largest angle from the z axis of a cone of SECTORS flat sides around one, radians; around -z,
// beyond 90 degrees, the flat sides are within the cone that is left out.
double around(double angle);

// Rays of places along the border of the image, NaN where there is none.
std::vector<Ray> border_rays(int64_t code, const Params &p, double width, double height);

// --- ideal planes ---

struct Pinhole {
    double fx, fy, cx, cy, width, height;
};

// Cells of a plane by their middles, and half their sides.
struct Cells {
    std::vector<double> x, y;
    double half_x, half_y;
    double reach() const { return std::max(half_x, half_y); }
};

// Sides of a region and of its hole.
struct Sides {
    std::vector<Straight> region, hole;
    // True for a cell that may have a point of the region, by its middle and half its sides.
    bool meet(double x, double y, double half_x, double half_y) const;
};

// Bounds of |u - u0| and |v - v0| of complex points within a radius of a real one.
struct Reach {
    double radius, u, v;
};

struct Ideal {
    std::array<double, 9> frame; // lens_from_plane
    Pinhole pinhole;             // whose image holds all of the region that the lens needs
    Outline region;              // nothing beyond it has a pixel
    Outline hole;                // to be taken out of it; may reach beyond; empty for none
    int64_t code;
    Numbers params;        // with longitudes that are continuous on this plane
    bool has_pole = false; // (0, 0) is a pole of an equirectangular image, at the border

    // Convex polygons that are the region without the hole.
    std::vector<Outline> parts() const;
    Frame axes() const { return {frame.data(), {}}; }
    Sides sides() const { return {sides_of(region), sides_of(hole)}; }
    // Those of n_x times n_y cells of the box around the region that may have a point of it.
    Cells cells(double n_x, double n_y) const;
    // Over the region; the radius is in units of the distance from the pole of a plane with one.
    Reach reach(double radius, bool is_near_pole) const;
    // At all radii where there are bounds.
    std::vector<Reach> reaches() const;
    // Pixel of a point.
    Pixel<double> pixel(double x, double y) const;
};
std::vector<Ideal> ideal_planes(int64_t code, const Region &region, double width, double height);

// --- bounds ---

// At a point of a plane.
Reach reach_at(const Ideal &plane, double x, double y, double radius, bool is_near_pole);

struct Series;
constexpr int LINES = 20; // of a half turn
// Expansions of u and v at all points of a cell, along LINES lines of half a turn, the first along
// x, that after half of them along y. `is_behind`: see Series.
std::pair<Series, Series> pixels_along_lines(const Ideal &plane, double x, double y, double half_x,
                                             double half_y, int order, bool is_behind);
bool is_behind(const Ideal &plane, const Cells &cells);

// Bounds of a lens along the edges of a plane, and of the error of their rules; see
// edge_bounds.cpp.
struct EdgeBounds {
    std::vector<Reach> reaches;
    std::vector<double> u, v; // bounds of Taylor coefficients by their order, from 0 on

    double error(double half, int64_t n) const;
    double longest(double tolerance, int64_t n) const;
};
EdgeBounds edge_bounds(const Ideal &plane);
// By n, a and b: bounds of the error of a rule for T_a and T_b.
constexpr int64_t DEGREES = 60;
const double *pair_errors();

struct EdgeTable {
    double tolerance;
    std::array<double, TABLE> longest;
    int64_t parts_of;
};
EdgeTable edge_table(const EdgeBounds &bounds, double tolerance);

struct SlopeGrid {
    double low_x, low_y, per_x, per_y;
    std::vector<double> second, third, sizes;
    std::array<double, 4> near_axis;
};
SlopeGrid slope_grid(const Ideal &plane);

// --- what loops take ---

struct OwnTree {
    std::vector<double> lines;
    std::vector<int32_t> children;
    std::vector<uint8_t> kinds;
    int64_t root;
};

// A plane with all that loops take of it.
struct Proved {
    Ideal plane;
    EdgeBounds bounds;
    EdgeTable table;
    SlopeGrid slopes;
    Outline window;
    double width, height, bend, stretch, speed, arc_half, arc_bend;
    Pinhole pinhole; // cropped to what the image of the lens shows

    PlaneRecord record() const;
};
Proved prove(const Ideal &plane, double width, double height, double tolerance);
// Of all planes; those of one frame have one pinhole.
std::vector<Proved> prove_all(const std::vector<Ideal> &planes, double width, double height,
                              double tolerance);
// Area of the image that shows the region of a plane, px^2.
double seen_area(const Proved &proved);
// Field of view in a plane, `tolerance` the mean width of undecided cells in its units.
OwnTree field_of(const Proved &proved, double tolerance);
// Set a tree that has room for some nodes; its root and the number of its nodes.
std::pair<int64_t, int64_t> divide(const PlaneRecord &plane, Array<const double, 4, 2> box,
                                   FloatRows<3> region_lines, FloatRows<3> hole_lines,
                                   double tolerance, Array<double, Any, 3> lines,
                                   Array<int32_t, Any, 2> children, Column<uint8_t> kinds);

// Bounds of the error of the area under an edge or a part of one, px^2; and of the mean width of
// undecided cells along a border of the image, in units of the plane: a quarter of its strip.
constexpr double EDGE_TOLERANCE = 1e-9, FIELD_TOLERANCE = 5e-6;
// All of a lens as one row, see packed.cpp: code, two flags for its caller, planes, size of the
// image, its area that sees nothing, parameters, and what there is of each plane.
std::vector<double> pack_lens(int64_t code, const Region &valid, double width, double height,
                              double edge_tolerance, double field_tolerance);

} // namespace rastercov::lens
