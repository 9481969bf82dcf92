// Planes of a lens as loops take them: windows, rules of arcs, and fields of view.
//
// A plane has a window, few sides around all that the image shows of its region. The border of a
// region has 128 sides around a conic, nearly all of whose images are outside the image. A line
// cuts off a piece of it. The lens is a homeomorphism, so a piece whose border misses the image has
// either all of the image or nothing of it, and nothing if a point of the rest of the region has
// its pixel in the image.
//
// Where the image may show the conic itself, areas end at it: its arcs are integrated as edges are,
// by the turn around the axis of the cone (polygons.hpp). For a complex step d of the turn,
// |cos(t + d) - cos t| and |sin(t + d) - sin t| are at most sinh |d|, so that a point of the plane
// is known to stay within the radii at which the lens is bounded.
//
// Twins: tests/lenses/test_window.py, tests/lenses/test_areas.py, tests/lenses/test_field.py.
#include "lens/polygons.hpp"
#include "lens/proof.hpp"
#include "lens/rays.hpp"

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Parts of the border of a piece whose images are compared with the image, each with its bend.
constexpr size_t BORDER_PARTS = 512;
constexpr double ROUNDING_PX = 1e-9; // more than the rounding of a pixel
constexpr int TRIMMINGS = 10; // halvings in the search for a line that cuts off what is not shown
// Directions of these lines, in eighths of a turn.
constexpr int EIGHTHS[] = {0, 2, 4, 6, 1, 3, 5, 7};
constexpr size_t FEW_SIDES = 8; // a window of so few sides is not cut at its corners
// Places of the border of the valid region whose surroundings are compared with the image.
constexpr int TURNS = 1024;
constexpr int64_t FIRST_NODES = 4096;
// Distance from a side of the region, in units of the plane, up to which a corner is on it.
constexpr double ON_LINE = 1e-13;

// True where the image of the border of a piece is outside the image.
bool misses(const Ideal &plane, double width, double height, double bend, const Outline &piece) {
    const size_t n = std::max(BORDER_PARTS / piece.size(), size_t(2));
    for (size_t i = 0; i < piece.size(); i++) {
        const auto &start = piece[i], &end = piece[(i + 1) % piece.size()];
        const double x = end.x - start.x, y = end.y - start.y;
        const double stray = bend * (x * x + y * y) / (8 * double(n * n)) + ROUNDING_PX;
        Pixel<double> before = plane.pixel(start.x, start.y);
        for (size_t k = 1; k <= n; k++) {
            const double t = double(k) / double(n);
            const Pixel<double> here =
                plane.pixel((1 - t) * start.x + t * end.x, (1 - t) * start.y + t * end.y);
            const auto is_out = [&](double a, double b, double size) {
                return std::max(a, b) < -stray || std::min(a, b) > size + stray;
            };
            if (!is_out(before.u, here.u, width) && !is_out(before.v, here.v, height)) return false;
            before = here;
        }
    }
    return true;
}

// True where some point of a polygon has its pixel in the image.
bool shows(const Ideal &plane, double width, double height, const Outline &window) {
    if (window.size() < 3) return false;
    Point<double> middle = {0.0, 0.0};
    for (const auto &[x, y] : window) {
        middle.x += x / double(window.size());
        middle.y += y / double(window.size());
    }
    for (int k = 0; k < 12; k++)
        for (const auto &[x, y] : window) {
            const double t = 0.09 * k;
            const auto [u, v] =
                plane.pixel(middle.x + t * (x - middle.x), middle.y + t * (y - middle.y));
            if (u > 1 && u < width - 1 && v > 1 && v < height - 1) return true;
        }
    return false;
}

// True where a pixel has a ray that is outside the region of a plane.
bool is_elsewhere(const Ideal &plane, double u, double v) {
    const auto [x, y, z] =
        ray_from_plane(plane.axes(), unproject(plane.code, view_of(plane.params), u, v));
    if (!std::isfinite(z)) return false;
    const auto sides = sides_of(plane.region);
    return z <= 0.0 || std::any_of(sides.begin(), sides.end(), [&, x, y, z](const Straight &side) {
               return side.a * x + side.b * y + side.c * z < 0.0;
           });
}

// Convex polygon within the region that holds every point of it whose pixel is in the image: the
// region, cut by lines; all of it if nothing is proved, or it has a hole; no corner if it is proved
// that the image shows nothing. `bend` is infinite for a plane with a pole.
Outline window_of(const Ideal &plane, double width, double height, double bend) {
    if (!plane.hole.empty() || !(bend < INFINITE)) return plane.region;
    if (!shows(plane, width, height, plane.region)) {
        const bool is_empty = misses(plane, width, height, bend, plane.region) &&
                              is_elsewhere(plane, width / 2, height / 2);
        return is_empty ? Outline() : plane.region;
    }
    Outline window = plane.region;
    for (const int eighth : EIGHTHS) {
        if (eighth % 2 && window.size() <= FEW_SIDES) break;
        const double a = rounded::cos(eighth * PI / 4), b = rounded::sin(eighth * PI / 4);
        Range range;
        for (const auto &[x, y] : window) range.add(x * a + y * b);
        double low = range.least;
        double high = range.most;
        Outline found = window;
        // About the least c with nothing shown beyond the line a x + b y = c.
        for (int k = 0; k < TRIMMINGS; k++) {
            const double middle = (low + high) / 2;
            const Outline piece = keep(window, {a, b, -middle});
            if (piece.size() >= 3 && misses(plane, width, height, bend, piece)) {
                high = middle;
                found = keep(window, {-a, -b, middle});
            } else {
                low = middle;
            }
        }
        if (shows(plane, width, height, found)) window = found;
    }
    return window;
}

struct ArcRule {
    double half, bend;
};

// A place of an arc in a plane: its greater coordinate, and the depth of its ray.
struct Place {
    double far, z;
};

// Rule for arcs through some places, which what is between the cone and the region moves by `off`.
// A turn d changes coordinates of the ray, and its depth, by at most sinh d times `aside` and
// `ahead`.
ArcRule rule_through(const std::vector<Place> &places, const Proved &of, double off, double aside,
                     double ahead) {
    EdgeBounds bounds = {{}, {INFINITE, INFINITE}, {INFINITE, INFINITE}};
    double bend = INFINITE;
    for (const auto &[radius, u, v] : of.bounds.reaches) {
        const double left = radius - off;
        if (!(left > 0.0)) continue;
        double rise = INFINITE;
        for (const auto &[far, z] : places)
            rise = std::min(rise, left * z / (aside + (far + left) * ahead));
        const double turn = rounded::asinh(rise);
        bounds.reaches.push_back({turn, u, v});
        bend = std::min(bend, 2 * std::max(u, v) / (turn * turn));
    }
    const double half = bounds.longest(of.table.tolerance, MOST);
    require(half > 0.0,
            "expected a lens that can be bounded at max_angle_deg, got another; reduce it");
    return {half, bend};
}

// Rule for arcs of the border of the valid region in a plane: half the longest part, radians around
// the axis, by the rule of most nodes, and a bound of the second derivative of pixels by the turn,
// px; zeros where none is shown.
ArcRule arc_rule(const Proved &of) {
    const Ideal &plane = of.plane;
    if (plane.code == EQUIRECTANGULAR) return {0.0, 0.0};
    const double slope = plane.params[SLOPE];
    const double angle = rounded::atan2(std::abs(slope), std::copysign(1.0, slope));
    const double across = rounded::sin(angle), beside = around(angle) - angle;
    const auto &f = plane.frame;
    const double ahead = across * rounded::hypot(f[2], f[5]);
    const double aside =
        std::max(across * rounded::hypot(f[0], f[3]), across * rounded::hypot(f[1], f[4]));
    // Places around which all points between the cone and the flat sides next to it are; those that
    // the region of the plane meets.
    const double step = rounded::sinh(PI / TURNS) * aside + beside;
    const double step_z = rounded::sinh(PI / TURNS) * ahead + beside;
    const Rectangle box = box_of(plane.region);
    bool are_missed = true;
    double off = 0.0;
    std::vector<Place> places;
    for (int k = 0; k < TURNS; k++) {
        const double turn = 2 * PI * k / TURNS;
        const Ray ray =
            ray_from_plane(plane.axes(), {across * rounded::cos(turn), across * rounded::sin(turn),
                                          rounded::cos(angle)});
        const double z = ray.Z;
        const auto is_met = [&](double value, const Range &range) {
            return value - range.least * z >= -(step + std::abs(range.least) * step_z) &&
                   range.most * z - value >= -(step + std::abs(range.most) * step_z);
        };
        if (!(z > step_z) || !is_met(ray.X, box.x) || !is_met(ray.Y, box.y)) continue;
        const double x = ray.X / z, y = ray.Y / z;
        const double far = std::max(std::abs(x), std::abs(y));
        const double near = (step + far * step_z) / (z - step_z);
        const auto [u, v] = plane.pixel(x, y);
        const Reach by = reach_at(plane, x, y, near, false);
        are_missed = are_missed &&
                     (u + by.u < 0 || u - by.u > of.width || v + by.v < 0 || v - by.v > of.height);
        // What is between the cone and the region changes places besides.
        off = std::max(off, beside * (1 + far) / (z - beside));
        places.push_back({far, z});
    }
    return are_missed ? ArcRule{0.0, 0.0} : rule_through(places, of, off, aside, ahead);
}

// Images of the parts of the region of a plane.
std::vector<Image> images_of(const Ideal &plane, const PlaneRecord &record) {
    EdgeScratch scratch;
    std::vector<Image> images;
    for (const Outline &part : plane.parts())
        images.push_back(
            polygon_image(record, view_of(part), 0, int64_t(part.size()), scratch, true));
    return images;
}
} // namespace

PlaneRecord Proved::record() const {
    return {plane.code,
            view_of(plane.params),
            plane.axes(),
            pinhole.fx,
            pinhole.fy,
            pinhole.cx,
            pinhole.cy,
            view_of(plane.region),
            view_of(plane.hole),
            view_of(window),
            {table.longest.data(), {}},
            table.parts_of,
            plane.has_pole,
            width,
            height,
            bend,
            stretch,
            speed,
            table.tolerance,
            arc_half,
            arc_bend};
}

Proved prove(const Ideal &plane, double width, double height, double tolerance) {
    Proved found;
    found.plane = plane;
    found.bounds = edge_bounds(plane);
    found.slopes = slope_grid(plane);
    found.width = width;
    found.height = height;
    found.table = edge_table(found.bounds, tolerance);
    // Bounds of the first and the second derivative of pixels along lines of a plane, px. Of an
    // analytic u with |u - u0| <= M within R the first is at most M / R, by Cauchy, and that of
    // both coordinates together (x^2 + y^2)^(1/2) times 2^(1/2) at most. The second is that of the
    // slopes, some thirty times less than 2 M / R^2: how many edges are next to the border of the
    // image, and how many tiles of samples a face may reach, depends on it.
    double speed = INFINITE;
    if (!plane.has_pole)
        for (const auto &[radius, u, v] : found.bounds.reaches)
            speed = std::min(speed, std::sqrt(2.0) * rounded::hypot(u, v) / radius);
    found.bend = *std::max_element(found.slopes.second.begin(), found.slopes.second.end());
    const auto &[fx, fy, cx, cy, across, down] = plane.pinhole;
    found.stretch = speed * speed / 2 / (fx * fy);
    found.speed = speed / std::min(fx, fy);
    const ArcRule arcs = arc_rule(found);
    found.arc_half = arcs.half;
    found.arc_bend = arcs.bend;
    found.window = window_of(plane, width, height, found.bend);
    found.pinhole = plane.pinhole;
    return found;
}

std::vector<Proved> prove_all(const std::vector<Ideal> &planes, double width, double height,
                              double tolerance) {
    std::vector<Proved> all;
    for (const Ideal &plane : planes) all.push_back(prove(plane, width, height, tolerance));
    // The pinholes end where the image of the lens does: those of one frame together, because they
    // are solved once.
    for (Proved &own : all) {
        Rectangle shown;
        const auto &[fx, fy, cx, cy, across, down] = own.plane.pinhole;
        for (const Proved &other : all) {
            if (other.plane.frame != own.plane.frame) continue;
            for (const auto &[x, y] : other.window) shown.add(x * fx + cx, y * fy + cy);
        }
        const auto &[u, v] = shown;
        if (!(u.least <= u.most)) continue;
        const double left = std::max(std::floor(u.least), 0.0);
        const double top = std::max(std::floor(v.least), 0.0);
        const double right = std::min(std::ceil(u.most), across);
        const double bottom = std::min(std::ceil(v.most), down);
        own.pinhole = {
            fx, fy, cx - left, cy - top, std::max(right - left, 1.0), std::max(bottom - top, 1.0)};
    }
    return all;
}

double seen_area(const Proved &proved) {
    double seen = 0.0;
    for (const Image &image : images_of(proved.plane, proved.record())) seen += image.inside;
    return seen;
}

OwnTree field_of(const Proved &proved, double tolerance) {
    PlaneRecord record = proved.record();
    if (record.arc_half > 0) { // pieces are cut to the border of the valid region before
        record.arc_half = 0.0;
        const auto images = images_of(proved.plane, record);
        if (std::all_of(images.begin(), images.end(),
                        [](const Image &image) { return image.whole == image.inside; }))
            return {{}, {}, {}, INSIDE};
    }
    const Pinhole &pinhole = proved.pinhole;
    const double left = -pinhole.cx / pinhole.fx, right = left + pinhole.width / pinhole.fx;
    const double top = -pinhole.cy / pinhole.fy, bottom = top + pinhole.height / pinhole.fy;
    const double box[] = {left, top, right, top, right, bottom, left, bottom};
    // The window has few sides; a region has up to 128, by which all surfaces would be cut.
    std::vector<Straight> region;
    for (const Straight &side :
         sides_of(proved.window.empty() ? proved.plane.region : proved.window))
        for (int k = 0; k < 4; k++)
            if (side.value(box[2 * k], box[2 * k + 1]) < -ON_LINE) {
                region.push_back(side);
                break;
            }
    const std::vector<Straight> hole = sides_of(proved.plane.hole);
    const auto lines_of = [](const std::vector<Straight> &sides) {
        return FloatRows<3>{sides.empty() ? nullptr : &sides[0].a, {int64_t(sides.size())}};
    };
    for (int64_t n = FIRST_NODES;;) {
        OwnTree tree = {std::vector<double>(size_t(3 * n)), std::vector<int32_t>(size_t(2 * n)),
                        std::vector<uint8_t>(size_t(n)), 0};
        const auto [root, n_nodes] =
            divide(record, {box, {}}, lines_of(region), lines_of(hole), tolerance,
                   {tree.lines.data(), {n}}, {tree.children.data(), {n}}, {tree.kinds.data(), {n}});
        if (n_nodes <= n) {
            tree.root = root;
            tree.lines.resize(size_t(3 * n_nodes));
            tree.children.resize(size_t(2 * n_nodes));
            tree.kinds.resize(size_t(n_nodes));
            return tree;
        }
        n = n_nodes;
    }
}

} // namespace rastercov::lens
