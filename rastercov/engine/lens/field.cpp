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
#include "bind.hpp"
#include "interrupt.hpp"
#include "lens/polygons.hpp"
#include "lens/proof.hpp"
#include <memory>
#include <nanobind/stl/pair.h>

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

struct Work {
    std::unique_ptr<Entry[]> stack{new Entry[STACK_ROOM]};
    std::unique_ptr<bool[]> open; // of each entry, of the sides of the region and of the hole
    int64_t n_sides, n_hole;
    Cell cell, other, spare;
    double fit[4][5];
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

// Fills `fit` with an affine map u = a x + b y + c, and least and greatest u less that; and v.
//
// Rows are (a, b, c, least, greatest) of u and v, from samples in the polygon; then the least
// u, width - u, v, height - v of the samples, and the greatest of each.
void fit_borders(const PlaneRecord &plane, const Points &polygon, int64_t n, double (&fit)[4][5]) {
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
    for (int axis = 0; axis < 2; axis++) {
        const double dx = axis == 0 ? step : 0.0, dy = axis == 0 ? 0.0 : step;
        const auto after = plane_value(plane, cx + dx, cy + dy);
        const auto before = plane_value(plane, cx - dx, cy - dy);
        fit[0][axis] = 0.5 * (after.u - before.u) / step;
        fit[1][axis] = 0.5 * (after.v - before.v) / step;
    }
    auto [u, v] = plane_value(plane, cx, cy);
    fit[0][2] = u - fit[0][0] * cx - fit[0][1] * cy;
    fit[1][2] = v - fit[1][0] * cx - fit[1][1] * cy;
    fit[0][3] = fit[1][3] = fit[0][4] = fit[1][4] = 0.0;
    Range along_u = {u, u};
    Range along_v = {v, v};
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = p + 1 < n ? p + 1 : 0;
        for (int i = 0; i <= SAMPLES; i++)
            for (int j = 0; j <= SAMPLES - i; j++) {
                if (i + j == 0) continue;
                const double s = double(i) / SAMPLES, t = double(j) / SAMPLES;
                const double x = cx + s * (polygon(p, 0) - cx) + t * (polygon(q, 0) - cx);
                const double y = cy + s * (polygon(p, 1) - cy) + t * (polygon(q, 1) - cy);
                auto [su, sv] = plane_value(plane, x, y);
                along_u.add(su);
                along_v.add(sv);
                su -= fit[0][0] * x + fit[0][1] * y + fit[0][2];
                sv -= fit[1][0] * x + fit[1][1] * y + fit[1][2];
                fit[0][3] = std::min(fit[0][3], su);
                fit[0][4] = std::max(fit[0][4], su);
                fit[1][3] = std::min(fit[1][3], sv);
                fit[1][4] = std::max(fit[1][4], sv);
            }
    }
    const auto [low_u, high_u] = along_u;
    const auto [low_v, high_v] = along_v;
    fit[2][0] = low_u;
    fit[2][1] = plane.width - high_u;
    fit[2][2] = low_v;
    fit[2][3] = plane.height - high_v;
    fit[3][0] = high_u;
    fit[3][1] = plane.width - low_u;
    fit[3][2] = high_v;
    fit[3][3] = plane.height - low_v;
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
Straight line_of_border(const PlaneRecord &plane, const double (&fit)[4][5], int64_t k,
                        double offset) {
    const int64_t row = k / 2;
    const double sign = k % 2 == 0 ? 1.0 : -1.0;
    const double at = k % 2 == 0 ? 0.0 : (row == 0 ? plane.width : plane.height);
    const double size = rounded::hypot(fit[row][0], fit[row][1]);
    return {sign * fit[row][0] / size, sign * fit[row][1] / size,
            (sign * (fit[row][2] - at) - offset) / size};
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
                           double (&fit)[4][5]) {
    fit_borders(plane, cell, n, fit);
    Narrowest best = {borders, ALL_INSIDE, INFINITE};
    for (int64_t k = 0; k < 4; k++) {
        if (!(best.borders >> k & 1)) continue;
        if (fit[2][k] >= -MARGIN) {
            best.borders -= int64_t(1) << k;
        } else if (fit[3][k] <= MARGIN) {
            return {best.borders, ALL_OUTSIDE, 0.0};
        } else {
            const auto &row = fit[k / 2];
            double width = row[4] - row[3];
            width = (width + 2.0 * (SAFETY * width + MARGIN)) / rounded::hypot(row[0], row[1]);
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

// First of the open sides that cuts a polygon, NONE or BEYOND where it is beyond a side, and their
// number. Sides that have all of the polygon inside are closed.
struct Cutting {
    int64_t first, count;
};
Cutting first_cutting(const Lines &lines, bool *is_open, const Points &polygon, int64_t n) {
    Cutting found = {NONE, 0};
    for (int64_t s = 0; s < lines.rows(); s++) {
        if (!is_open[s]) continue;
        const auto [least, most] = extremes({lines(s, 0), lines(s, 1), lines(s, 2)}, polygon, n);
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

Straight line_of(const Lines &given, int64_t s) { return {given(s, 0), given(s, 1), given(s, 2)}; }

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
        const auto &row = work.fit[k / 2];
        const double spread = SAFETY * (row[4] - row[3]) + MARGIN;
        // u = fit + rest, rest from least to greatest; of width - u it is the other way round.
        const double least = (k % 2 == 0 ? row[3] : -row[4]) - spread;
        const double most = (k % 2 == 0 ? row[4] : -row[3]) + spread;
        Straight line = line_of_border(plane, work.fit, k, -most);
        int64_t m = 0;
        if (extremes(line, cell(), n).least < 0.0) m = keep_side(cell(), n, line, -1.0, other());
        if (m >= 3 && side_of_image(plane, other(), m, slope, work.edges) == OUTSIDE) {
            const int64_t node = append_node(line, BORDER, owner, out);
            attach(OUTSIDE, 2 * node + 1, out);
            owner = 2 * node;
            n = keep_side(cell(), n, line, 1.0, other());
            copy_polygon(other(), n, cell());
        }
        line = line_of_border(plane, work.fit, k, -least);
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
        const auto &fit = work.fit;
        const int64_t k = narrowest.border;
        borders = narrowest.borders;
        const double slope = rounded::hypot(rounded::hypot(fit[0][0], fit[0][1]),
                                            rounded::hypot(fit[1][0], fit[1][1]));
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

namespace {
using Pair = std::pair<double, double>;
std::pair<Pair, std::pair<Pair, Pair>> bounds_in_box(const Slopes &slopes, double low_x,
                                                     double high_x, double low_y, double high_y) {
    const Bends bends = bounds_within(slopes, low_x, high_x, low_y, high_y);
    return {{bends.second, bends.third},
            {{bends.inverse_1, bends.inverse_2}, {bends.log_det_1, bends.log_det_2}}};
}

Pair sizes_in_box(const Slopes &slopes, double low_x, double high_x, double low_y, double high_y) {
    const auto [least, most] = sizes_within(slopes, low_x, high_x, low_y, high_y);
    return {least, most};
}

} // namespace

void register_lens_field(nanobind::module_ &m) {
    m.attr("CELLS") = CELLS;
    m.attr("PARTS") = PARTS;
    m.attr("INSIDE") = int(INSIDE);
    m.attr("OUTSIDE") = int(OUTSIDE);
    m.attr("UNDECIDED") = int(UNDECIDED);
    m.attr("BAND") = int(BAND);
    m.attr("ON_LINE") = ON_LINE;
    def(m, "divide", divide,
        "Fill a tree with the field of view of a plane within a box; its root, a node or a leaf, "
        "and the number of nodes, which may be more than there is room for.\n\n"
        "`box` has the corners, counter-clockwise; `region_lines` and `hole_lines`, (K, 3), are "
        "sides of the region that cut the box, and of the hole, which is inside all of its own. "
        "`tolerance` is the mean width of undecided cells, in units of the plane.",
        "plane", "box", "region_lines", "hole_lines", "tolerance", "lines", "children", "kinds");
    def(m, "bounds_within", bounds_in_box,
        "Bounds of derivatives in the region within a box of a plane: second and third of pixels; "
        "first and second of A^-1 near an axis, and of log |det A|, A the first of pixels.",
        "slopes", "low_x", "high_x", "low_y", "high_y");
    def(m, "sizes_within", sizes_in_box,
        "Least and greatest `Slopes.sizes` in the region within a box of a plane.", "slopes",
        "low_x", "high_x", "low_y", "high_y");
}
} // namespace rastercov
