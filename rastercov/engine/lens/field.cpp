// Field of view of a lens in an ideal plane, as a tree of lines.
//
// The part of a plane that the image shows has curved borders. A border through a cell is replaced
// by two parallel lines: the image of what is beyond the first one is inside the border, of what is
// before the second one outside. What is between them is halved, and each half has lines of its
// own, until it is narrower than a tolerance.
//
// The lines are found from samples, and then verified: the images of both cells are measured by the
// integrals along their edges (polygons.hpp), so that samples decide about the cost alone. Where a
// cell is not inside, or not outside, it is halved, too.
//
// Invariants: a cell is halved DEEPEST_CELL times at most and its stack has STACK_ROOM entries, so
// that the search ends.
//
// Twin: tests/lenses/test_field.py, by points.
#include "lens/field.hpp"
#include "interrupt.hpp"
#include "lens/polygons.hpp"
#include "lens/proof.hpp"
#include <memory>

namespace rastercov {
namespace {
using namespace lens;

constexpr int SAMPLES = 4;      // parts of a side of a triangle between samples
constexpr double MARGIN = 1e-9; // pixels that a line keeps away from the border, for rounding
constexpr double SAFETY = 0.05; // part of the range of the samples by which lines move apart
constexpr double AREA_ROUNDING = 0x1p-46; // of the area under an edge, relative to its length and
                                          // the size of the image
constexpr int64_t DEEPEST_CELL = 60;      // halvings, after which a cell is undecided
// Straight sides of the region that a cell is cut by before it is halved.
constexpr int64_t MOST_STRAIGHT = 16;
constexpr int64_t STACK_ROOM = 512;
// Nodes of a tree, after which cells are undecided: a hundred times those of a lens.
constexpr int64_t MOST_TREE_NODES = 1 << 18;
// Distance from a side of the region, in units of the plane, up to which a corner is on it.
constexpr double ON_LINE = 1e-13;
// Area of a cell, in units of the plane, that no border divides.
constexpr double LEAST_AREA = 1e-26;
// Bits of the borders u = 0, u = width, v = 0, v = height; of a hole that a cell may reach.
constexpr int64_t ALL_BORDERS = 15, HOLE = 16;
enum NoBorder : int64_t { ALL_INSIDE = -1, ALL_OUTSIDE = -2 };
enum NoSide : int64_t { NONE = -1, BEYOND = -2 };

using Lines = FloatRows<3>;

struct Cell {
    double at[2 * MOST_CORNERS];
    Points corners() { return {at, {MOST_CORNERS, 2}}; }
};

// What waits to be divided: corners, the sides of region and hole that may still cut it, a bit for
// each border of the image that it may cross, its place in the tree, 2 times a node and 1 for its
// outer side, and how often it was halved.
struct Entry {
    Cell cell;
    int64_t n, owner, borders, level;
};

// An affine map u = a x + b y + c near a cell, by samples in it; what they differ from it by, and
// the samples. Or of v.
struct Fit {
    Straight map;
    Range rest, all;

    double slope() const { return rounded::hypot(map.a, map.b); }
};

struct Work {
    std::unique_ptr<Entry[]> stack{new Entry[STACK_ROOM]};
    std::unique_ptr<bool[]> open; // of each entry, of the sides of the region and of the hole
    int64_t n_sides, n_hole;
    Cell cell, other, spare;
    Fit fit[2];
    EdgeScratch edges;

    bool *sides(int64_t entry) { return open.get() + entry * (n_sides + n_hole); }
    bool *hole(int64_t entry) { return sides(entry) + n_sides; }
};

struct Growing {
    Array<double, Any, 3> lines;
    Array<int32_t, Any, 2> children;
    Column<uint8_t> kinds;
    int64_t root = OUTSIDE;
    int64_t n_nodes = 0;
};

Range extremes(const Straight &line, const Points &polygon, int64_t n) {
    Range all;
    for (int64_t p = 0; p < n; p++) all.add(line.value(polygon(p, 0), polygon(p, 1)));
    return all;
}

struct Farthest {
    int64_t corner;
    double away;
};
Farthest farthest_from(const Points &polygon, int64_t n, int64_t start) {
    Farthest far = {start, 0.0};
    for (int64_t p = 0; p < n; p++) {
        const double away =
            rounded::hypot(polygon(p, 0) - polygon(start, 0), polygon(p, 1) - polygon(start, 1));
        if (away > far.away) far = {p, away};
    }
    return far;
}

// Area of a polygon, its greatest distance of corners, to a factor of 2, and these corners.
struct Size {
    double area, extent;
    int64_t far, other;
};
Size size_of(const Points &polygon, int64_t n) {
    double area = 0.0;
    for (int64_t p = 1; p < n - 1; p++) {
        area += (polygon(p, 0) - polygon(0, 0)) * (polygon(p + 1, 1) - polygon(0, 1));
        area -= (polygon(p + 1, 0) - polygon(0, 0)) * (polygon(p, 1) - polygon(0, 1));
    }
    const int64_t far = farthest_from(polygon, n, 0).corner;
    const auto [other, extent] = farthest_from(polygon, n, far);
    return {0.5 * area, extent, far, other};
}

// Part of a polygon where sign times a line is >= 0; its corner count.
int64_t keep_side(const Points &polygon, int64_t n, const Straight &line, double sign, Points out) {
    const double a = sign * line.a, b = sign * line.b, c = sign * line.c;
    // The point of the line that is nearest to the origin; the inner side is on the left of (b,
    // -a).
    return keep_inside(polygon, n, {-a * c, -b * c, b, -a, 0.0}, out);
}

// Sets the fits of u and v.
void fit_borders(const PlaneRecord &plane, const Points &polygon, int64_t n, Fit (&fit)[2]) {
    double cx = 0.0;
    double cy = 0.0;
    double reach = 0.0;
    for (int64_t p = 0; p < n; p++) {
        cx += polygon(p, 0) / double(n);
        cy += polygon(p, 1) / double(n);
    }
    for (int64_t p = 0; p < n; p++)
        reach = std::max(reach, rounded::hypot(polygon(p, 0) - cx, polygon(p, 1) - cy));
    const double step = 1e-3 * reach;
    const auto pixel = [&](double x, double y) {
        const auto [u, v] = plane_value(plane, x, y);
        return std::array<double, 2>{u, v};
    };
    const auto here = pixel(cx, cy), right = pixel(cx + step, cy), left = pixel(cx - step, cy),
               below = pixel(cx, cy + step), above = pixel(cx, cy - step);
    for (size_t k = 0; k < 2; k++) {
        auto &[a, b, c] = fit[k].map;
        a = 0.5 * (right[k] - left[k]) / step;
        b = 0.5 * (below[k] - above[k]) / step;
        c = here[k] - a * cx - b * cy;
        fit[k].rest = {0.0, 0.0};
        fit[k].all = {here[k], here[k]};
    }
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = p + 1 < n ? p + 1 : 0;
        for (int i = 0; i <= SAMPLES; i++)
            for (int j = 0; j <= SAMPLES - i; j++) {
                if (i + j == 0) continue;
                const double s = double(i) / SAMPLES, t = double(j) / SAMPLES;
                const double x = cx + s * (polygon(p, 0) - cx) + t * (polygon(q, 0) - cx);
                const double y = cy + s * (polygon(p, 1) - cy) + t * (polygon(q, 1) - cy);
                const auto sample = pixel(x, y);
                for (size_t k = 0; k < 2; k++) {
                    fit[k].all.add(sample[k]);
                    fit[k].rest.add(sample[k] - fit[k].map.value(x, y));
                }
            }
    }
}

double size_along(const PlaneRecord &plane, int64_t border) {
    return border < 2 ? plane.width : plane.height;
}

// INSIDE where a cell is inside the image, OUTSIDE where it is outside, otherwise UNDECIDED; by its
// areas. `slope` is about the pixels to a unit of the plane.
Leaf side_of_image(const PlaneRecord &plane, const Points &polygon, int64_t n, double slope,
                   EdgeScratch &scratch) {
    const Image image = polygon_image(plane, polygon, 0, n, scratch, true);
    const double whole = std::abs(image.whole), inside = std::abs(image.inside);
    double spill = double(image.rules) * plane.tolerance;
    spill += AREA_ROUNDING * (plane.width + plane.height) * 4 * slope * size_of(polygon, n).extent;
    if (whole - inside <= spill && inside > spill) return INSIDE;
    return inside <= spill ? OUTSIDE : UNDECIDED;
}

// Line along border k of an affine fit, moved inwards by an offset, px.
Straight line_of_border(const PlaneRecord &plane, const Fit &fit, int64_t k, double offset) {
    const double sign = k % 2 == 0 ? 1.0 : -1.0;
    const double at = k % 2 == 0 ? 0.0 : size_along(plane, k);
    const double size = fit.slope();
    return {sign * fit.map.a / size, sign * fit.map.b / size,
            (sign * (fit.map.c - at) - offset) / size};
}

// Line across the longest extent of a polygon, through its middle.
Straight halving_line(const Points &polygon, const Size &size) {
    const double dx = polygon(size.far, 0) - polygon(size.other, 0);
    const double dy = polygon(size.far, 1) - polygon(size.other, 1);
    const double length = rounded::hypot(dx, dy);
    const double x = 0.5 * (polygon(size.far, 0) + polygon(size.other, 0));
    const double y = 0.5 * (polygon(size.far, 1) + polygon(size.other, 1));
    return {dx / length, dy / length, -(dx * x + dy * y) / length};
}

// Borders that samples do not have all of a cell inside of, and the one of the narrowest band,
// ALL_INSIDE for none, ALL_OUTSIDE where samples have all of the cell outside of one.
struct Narrowest {
    int64_t borders, border;
    double width;
};
Narrowest narrowest_border(const PlaneRecord &plane, const Points &cell, int64_t n, int64_t borders,
                           Fit (&fit)[2]) {
    fit_borders(plane, cell, n, fit);
    Narrowest best = {borders, ALL_INSIDE, INFINITE};
    for (int64_t k = 0; k < 4; k++) {
        if (!(best.borders >> k & 1)) continue;
        const auto &[map, rest, all] = fit[k / 2];
        // Of u, width - u, v, height - v.
        const double size = size_along(plane, k);
        if ((k % 2 == 0 ? all.least : size - all.most) >= -MARGIN) {
            best.borders -= int64_t(1) << k;
        } else if ((k % 2 == 0 ? all.most : size - all.least) <= MARGIN) {
            return {best.borders, ALL_OUTSIDE, 0.0};
        } else {
            double width = rest.most - rest.least;
            width = (width + 2.0 * (SAFETY * width + MARGIN)) / fit[k / 2].slope();
            if (width < best.width) {
                best.border = k;
                best.width = width;
            }
        }
    }
    return best;
}

// --- the tree ---

// Makes a node or a leaf a child of its owner.
void attach(int64_t what, int64_t owner, Growing &out) {
    if (owner < 0) out.root = what;
    else if (owner / 2 < out.children.rows()) out.children(owner / 2, owner % 2) = int32_t(what);
}

int64_t append_node(const Straight &line, LineKind kind, int64_t owner, Growing &out) {
    const int64_t node = out.n_nodes++;
    if (node < out.children.rows()) {
        out.lines(node, 0) = line.a;
        out.lines(node, 1) = line.b;
        out.lines(node, 2) = line.c;
        out.kinds[node] = kind;
        out.children(node, 0) = out.children(node, 1) = UNDECIDED;
    }
    attach(node, owner, out);
    return node;
}

Straight line_of(const Lines &given, int64_t s) { return {given(s, 0), given(s, 1), given(s, 2)}; }

// First of the open sides that cuts a polygon, NONE or BEYOND where it is beyond a side, and their
// number. Sides that have all of the polygon inside are closed.
struct Cutting {
    int64_t first, count;
};
Cutting first_cutting(const Lines &lines, bool *is_open, const Points &polygon, int64_t n) {
    Cutting found = {NONE, 0};
    for (int64_t s = 0; s < lines.rows(); s++) {
        if (!is_open[s]) continue;
        const auto [least, most] = extremes(line_of(lines, s), polygon, n);
        if (most <= ON_LINE) return {BEYOND, 0};
        if (least >= -ON_LINE) {
            is_open[s] = false;
        } else {
            if (found.first < 0) found.first = s;
            found.count++;
        }
    }
    return found;
}

// The division of a plane: its tree, what waits, and the cell that is divided now, by its entry.
struct Division {
    const PlaneRecord &plane;
    Lines region_lines, hole_lines;
    double tolerance;
    Growing out;
    Work work;
    int64_t top = 0;
    int64_t n = 0;
    int64_t owner = 0;
    int64_t borders = 0;
    int64_t level = 0;
    Size size = {};

    Points cell() { return work.cell.corners(); }
    Points other() { return work.other.corners(); }
    Points spare() { return work.spare.corners(); }

    template <class Source>
    void push(const Source &polygon, int64_t count, int64_t place, int64_t left, int64_t depth) {
        Entry &entry = work.stack[top++];
        copy_polygon(polygon, count, entry.cell.corners());
        entry.n = count;
        entry.owner = place;
        entry.borders = left;
        entry.level = depth;
    }

    // Copies the sides of region and hole that the cell may still be cut by to the next entry.
    void copy_sides() { std::copy(work.sides(top), work.sides(top + 1), work.sides(top + 1)); }

    // Appends a node and pushes the parts of the cell on both of its sides.
    void split(const Straight &line, LineKind kind, int64_t left, int64_t depth) {
        const int64_t node = append_node(line, kind, owner, out);
        copy_sides();
        const int64_t m = keep_side(cell(), n, line, -1.0, other());
        n = keep_side(cell(), n, line, 1.0, spare());
        if (m >= 3) push(other(), m, 2 * node + 1, left, depth);
        if (n >= 3) push(spare(), n, 2 * node, left, depth);
    }
    void halve(LineKind kind, int64_t left) {
        split(halving_line(cell(), size), kind, left, level + 1);
    }

    // Cuts the cell by a side of the region; false where none cuts it.
    bool cut_by_region() {
        const Cutting side = first_cutting(region_lines, work.sides(top), cell(), n);
        if (side.first == BEYOND) {
            attach(OUTSIDE, owner, out);
        } else if (side.first >= 0 && side.count > MOST_STRAIGHT) {
            halve(HALVING, borders);
        } else if (side.first >= 0) {
            const Straight line = line_of(region_lines, side.first);
            const int64_t node = append_node(line, BORDER, owner, out);
            attach(OUTSIDE, 2 * node + 1, out);
            work.sides(top)[side.first] = false;
            const int64_t m = keep_side(cell(), n, line, 1.0, other());
            if (m >= 3) push(other(), m, 2 * node, borders, level);
        }
        return side.first != NONE;
    }

    // Cuts the cell by a side of the hole; false where the cell is beyond one.
    bool cut_by_hole() {
        if (!(borders & HOLE)) return false;
        const Cutting side = first_cutting(hole_lines, work.hole(top), cell(), n);
        if (side.first == BEYOND) {
            borders -= HOLE;
            return false;
        }
        if (side.first == NONE) attach(OUTSIDE, owner, out);
        else if (side.count > MOST_STRAIGHT) halve(HALVING, borders);
        else split(line_of(hole_lines, side.first), BORDER, borders, level);
        return true;
    }

    // Cuts off what is outside border k, and what is inside it, where the images say so.
    void cut_by_band(int64_t k, double slope) {
        const Fit &fit = work.fit[k / 2];
        const auto &[low, high] = fit.rest;
        const double spread = SAFETY * (high - low) + MARGIN;
        // u = fit + rest, rest from least to greatest; of width - u it is the other way round.
        const double least = (k % 2 == 0 ? low : -high) - spread;
        const double most = (k % 2 == 0 ? high : -low) + spread;
        Straight line = line_of_border(plane, fit, k, -most);
        int64_t m = 0;
        if (extremes(line, cell(), n).least < 0.0) m = keep_side(cell(), n, line, -1.0, other());
        if (m >= 3 && side_of_image(plane, other(), m, slope, work.edges) == OUTSIDE) {
            const int64_t node = append_node(line, BORDER, owner, out);
            attach(OUTSIDE, 2 * node + 1, out);
            owner = 2 * node;
            n = keep_side(cell(), n, line, 1.0, other());
            copy_polygon(other(), n, cell());
        }
        line = line_of_border(plane, fit, k, -least);
        m = 0;
        if (n >= 3 && extremes(line, cell(), n).most > 0.0)
            m = keep_side(cell(), n, line, 1.0, other());
        if (m >= 3) {
            const int64_t node = append_node(line, BORDER, owner, out);
            n = keep_side(cell(), n, line, -1.0, spare());
            copy_polygon(spare(), n, cell());
            copy_sides();
            push(other(), m, 2 * node, borders - (int64_t(1) << k), level + 1);
            owner = 2 * node + 1;
        }
        size = size_of(cell(), n);
    }

    // Divides the cell that waits last, or decides it.
    void divide_next() {
        Entry &entry = work.stack[--top];
        n = entry.n;
        owner = entry.owner;
        borders = entry.borders;
        level = entry.level;
        copy_polygon(entry.cell.corners(), n, cell());
        size = size_of(cell(), n);
        if (size.area <= LEAST_AREA || level >= DEEPEST_CELL || top + 4 > STACK_ROOM ||
            out.n_nodes >= MOST_TREE_NODES)
            return attach(UNDECIDED, owner, out);
        if (cut_by_region() || cut_by_hole()) return;
        const Narrowest narrowest = narrowest_border(plane, cell(), n, borders, work.fit);
        const int64_t k = narrowest.border;
        borders = narrowest.borders;
        const double slope = rounded::hypot(work.fit[0].slope(), work.fit[1].slope());
        const auto is_band = [&] { return k >= 0 && narrowest.width <= 0.5 * size.extent; };
        if (k < 0) {
            // The samples have decided; the image of the cell must agree.
            const Leaf wanted = k == ALL_INSIDE ? INSIDE : OUTSIDE;
            if (side_of_image(plane, cell(), n, slope, work.edges) == wanted)
                return attach(wanted, owner, out);
        } else if (is_band()) {
            cut_by_band(k, slope);
        }
        // What the samples have said so far may be wrong: halves start with all borders.
        if (n < 3 || size.area <= tolerance * size.extent) return attach(UNDECIDED, owner, out);
        halve(is_band() ? BAND : HALVING, borders | ALL_BORDERS);
    }
};

} // namespace

std::pair<int64_t, int64_t> lens::divide(const PlaneRecord &plane, Array<const double, 4, 2> box,
                                         Lines region_lines, Lines hole_lines, double tolerance,
                                         Array<double, Any, 3> lines,
                                         Array<int32_t, Any, 2> children, Column<uint8_t> kinds) {
    require_plane(plane);
    require(have_rows(children.rows(), lines, kinds),
            "lines, children and kinds must have one row for each node");
    Division division = {plane, region_lines, hole_lines, tolerance, {lines, children, kinds}, {}};
    Work &work = division.work;
    work.n_sides = region_lines.rows();
    work.n_hole = hole_lines.rows();
    const int64_t n_open = work.n_sides + work.n_hole;
    work.open.reset(new bool[(STACK_ROOM + 1) * n_open]);
    std::fill(work.open.get(), work.open.get() + n_open, true);
    division.push(box, 4, -1, ALL_BORDERS + (work.n_hole > 0 ? HOLE : 0), 0);
    Poll poll(16);
    while (division.top > 0) {
        poll();
        division.divide_next();
    }
    return {division.out.root, division.out.n_nodes};
}

} // namespace rastercov
