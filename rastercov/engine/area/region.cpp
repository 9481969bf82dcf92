// Exact regions of the faces that a pose covers, in the planes of the faces.
//
// The visible pieces of the solver are brought to the plane of their face; a face that is wholly
// visible in its part of the image is cut in its own plane.
//
// Through a lens, cut_regions finds what the pinhole of an ideal plane sees, within the largest
// angle of incidence. Three steps of cut_pieces follow, each from a list of pieces to another one;
// the first and the last run only where a task asks for them:
//
//   TO_DISCS      focus up to a distance
//   TO_VIEW       the field of view of the lens and its valid region, and focus by depth
//   TO_DENSITIES  densities through the lens, and focus from a distance
//
// The curved borders of the field of view make most pieces, so discs come first. The field of view
// is a tree of lines of an ideal plane. A line a x + b y + c = 0 there is the plane
// a X + b Y + c Z = 0 through the camera, and so a line in the plane of the face: polygons need not
// be projected.
//
// Twins: rastercov.reference.regions, point by point.
#include "area/region.hpp"
#include "area/circle.hpp"
#include "area/cone.hpp"
#include "interrupt.hpp"
#include <memory>
#include <optional>
#include <tuple>

namespace rastercov {
namespace area {
namespace {

// Depth up to which a corner is brought back, relative to the deepest corner of its face.
constexpr double FARTHEST = 2.0;
// Share of a face that rounding of the image may add to nothing, above which it is only in doubt:
// the camera is in the plane of the face, but for rounding.
constexpr double DOUBTFUL_SHARE = 0x1p-10;

// Rows of Borders: before FOCUS_LINE and FAR_LINE a point is out of focus or too far away for its
// pixels per m^2; the others bound the viewing pyramid.
enum { NEAR_LINE, FOCUS_LINE, FAR_LINE, LEFT, N_LINES = LEFT + 4 };
using Borders = Border[N_LINES];

// --- regions of a pinhole ---

// Sets `borders` to those of depth and of the viewing pyramid, or of the prism of parallel rays,
// whose densities do not depend on depth; returns the greatest depth.
double set_borders(const Plane &plane, const Criteria &criteria, double near, double most,
                   Borders &borders) {
    const auto &[camera, rules] = std::tie(criteria.lens, criteria.rules);
    const double z = plane.origin.z, z_x = plane.x_axis.z, z_y = plane.y_axis.z;
    const double error = plane.error, height = std::abs(plane.height);
    borders[NEAR_LINE] = border_of(z - near, z_x, z_y, error);
    borders[FOCUS_LINE] = border_of(z - rules.z_n, z_x, z_y, error);
    double farthest = rules.z_f;
    double its_error = error;
    const bool is_parallel = criteria.is_parallel;
    if (rules.min_facing_density > 0 && !is_parallel) {
        // min(fx, fy) / z, a half plane of depth as the end of the depth of field is.
        const double limit = std::min(camera.fx, camera.fy) / rules.min_facing_density;
        farthest = std::min(farthest, limit);
    }
    if (rules.min_pixels_per_m2 > 0 && !is_parallel) {
        const double limit =
            std::pow(camera.fx * camera.fy * height / rules.min_pixels_per_m2, 1.0 / 3);
        if (limit < farthest) {
            farthest = limit;
            its_error += limit * (height > error ? error / height : 1.0);
        }
    }
    // Beyond the deepest corner there is nothing to cut, however far that is.
    const double limit = std::min(farthest, 2 * std::abs(most) + 2 * its_error);
    borders[FAR_LINE] = border_of(limit - z, -z_x, -z_y, its_error);
    const auto side = [&](double sign, double f, double ahead, double at, double by_x,
                          double by_y) {
        if (is_parallel)
            return border_of(sign * f * at + ahead, sign * f * by_x, sign * f * by_y,
                             error * f + POSITION_ERROR_REL * std::abs(ahead));
        return border_of(sign * f * at + ahead * z, sign * f * by_x + ahead * z_x,
                         sign * f * by_y + ahead * z_y, error * (f + std::abs(ahead)));
    };
    for (int k = 0; k < 2; k++) {
        const double sign = k == 0 ? 1.0 : -1.0;
        borders[LEFT + k] = side(sign, camera.fx, k == 0 ? camera.cx : camera.width - camera.cx,
                                 plane.origin.x, plane.x_axis.x, plane.y_axis.x);
        borders[LEFT + 2 + k] =
            side(sign, camera.fy, k == 0 ? camera.cy : camera.height - camera.cy, plane.origin.y,
                 plane.x_axis.y, plane.y_axis.y);
    }
    return farthest + its_error;
}

// Brings a piece of the image of parallel rays to the plane of its face, counter-clockwise; its
// corner count.
int64_t bring_along_rays(const exact::VisiblePieces &kept, int64_t piece, const Plane &plane,
                         const Lens &camera, Points out) {
    const int64_t first = kept.starts[piece], n = kept.starts[piece + 1] - first;
    const double det = plane.x_axis.x * plane.y_axis.y - plane.x_axis.y * plane.y_axis.x;
    for (int64_t p = 0; p < n; p++) {
        const int64_t at = first + (det < 0 ? n - 1 - p : p);
        const double x = (kept.corners(at, U) - camera.cx) / camera.fx - plane.origin.x;
        const double y = (kept.corners(at, V) - camera.cy) / camera.fy - plane.origin.y;
        out(p, U) = (x * plane.y_axis.y - y * plane.y_axis.x) / det;
        out(p, V) = (y * plane.x_axis.x - x * plane.x_axis.y) / det;
    }
    return n;
}

// Brings a piece of the image to the plane of its face, counter-clockwise; its corner count.
int64_t bring_back(const exact::VisiblePieces &kept, int64_t piece, const Plane &plane,
                   const Criteria &criteria, double deepest, Points out) {
    const Lens &camera = criteria.lens;
    if (criteria.is_parallel) return bring_along_rays(kept, piece, plane, camera, out);
    const int64_t first = kept.starts[piece], n = kept.starts[piece + 1] - first;
    const bool is_reversed = plane.height > 0; // v points down, and the front is seen
    for (int64_t p = 0; p < n; p++) {
        const int64_t at = first + (is_reversed ? n - 1 - p : p);
        const double x = (kept.corners(at, U) - camera.cx) / camera.fx;
        const double y = (kept.corners(at, V) - camera.cy) / camera.fy;
        const double slope = plane.normal.x * x + plane.normal.y * y + plane.normal.z;
        // A corner near the horizon of the plane lies beyond the face.
        double z = FARTHEST * deepest;
        if (slope * plane.height < 0) z = std::min(z, -plane.height / slope);
        const double along = plane.x_axis.x * x + plane.x_axis.y * y + plane.x_axis.z;
        const double across = plane.y_axis.x * x + plane.y_axis.y * y + plane.y_axis.z;
        out(p, U) = plane.foot_x + z * along;
        out(p, V) = plane.foot_y + z * across;
    }
    return n;
}

// True if a face meets all criteria of `borders` and of incidence by more than rounding. It is then
// a piece as it is: most faces of a fine mesh are decided here.
bool is_well_inside(Points corners, const Borders &borders, const Plane &plane,
                    double tan_incidence) {
    double reach = std::abs(plane.height) * tan_incidence * LEAST_INNER_REL;
    reach -= plane.error * (2 + tan_incidence);
    for (int64_t p = 0; p < 3; p++) {
        const double u = corners(p, U), v = corners(p, V);
        for (const auto &[line, error] : borders)
            if (!(line.value(u, v) > error)) return false;
        const double x = u - plane.foot_x, y = v - plane.foot_y;
        if (tan_incidence > 0 && !(reach > 0 && x * x + y * y < reach * reach)) return false;
    }
    return true;
}

// True if a face meets the limits of the angle of incidence and of the densities, which are the
// same all over it, up to rounding: no point of a face is then undecided.
bool suits_rays(const Criteria &criteria, const Vector &normal, double cosine) {
    const auto &[camera, rules] = std::tie(criteria.lens, criteria.rules);
    const double x = camera.fx * camera.fx * (1 - normal.x * normal.x);
    const double y = camera.fy * camera.fy * (1 - normal.y * normal.y);
    const double product = camera.fx * camera.fy, xy = product * normal.x * normal.y;
    const auto meets = [](double value, double limit) {
        return value >= limit * (1 - 2 * POSITION_ERROR_REL);
    };
    // The product of both singular values of diag(fx, fy) in the plane over the greater one.
    const double greatest = std::sqrt((x + y + length2(x - y, 2 * xy)) / 2);
    return meets(cosine, rules.cos_incidence) &&
           meets(product * cosine / greatest, rules.min_pixel_density) &&
           meets(std::min(camera.fx, camera.fy), rules.min_facing_density) &&
           meets(product * cosine, rules.min_pixels_per_m2);
}

// What a pose says about a face.
struct Image {
    double visible, area, error; // px^2; the error is 0 for what is certified
    bool is_whole() const { return visible >= area && visible > 0; }
};

// Calls `append` with what the borders of depth leave of each visible piece of a face, from `piece`
// on, in its plane; what is undecided there, and within `off` of the outlines, is added to the
// bound.
template <class Bring, class Append>
void append_visible(const Array<const double, 3, 2> &corners, const exact::VisiblePieces &kept,
                    int64_t piece, const Borders &borders, double off, double &bound, Bring bring,
                    Append append) {
    Polygon memory;
    const Points part = memory.points();
    const auto row = kept.faces[piece];
    const exact::Sides<Array<const double, 3, 2>> sides = {corners, 3};
    for (; piece < kept.used[0] && kept.faces[piece] == row; piece++) {
        int64_t m = bring(piece, part);
        for (int64_t s = 0; s < 3 && m >= 3; s++) {
            Polygon spare;
            m = exact::cut(part, m, exact::line_at(sides, s), spare.points());
        }
        if (m < 3) continue;
        const Cut cut = cut_by_lines(part, m, borders, FOCUS_LINE, LEFT);
        bound += cut.undecided;
        if (cut.n < 3) continue;
        bound += off * perimeter_of(part, cut.n);
        append(part, cut.n);
    }
}

// Least and greatest depth of a polygon, and the square of its distance from the camera.
struct Span {
    double least = INF;
    double most = 0.0;
    double square = 0.0;

    Span(Points polygon, int64_t n, const Plane &plane, double height) {
        for (int64_t p = 0; p < n; p++) {
            const double u = polygon(p, U), v = polygon(p, V), depth = plane.depth_at(u, v);
            const double x = u - plane.foot_x, y = v - plane.foot_y;
            most = std::max(most, depth);
            least = std::min(least, depth);
            square = std::max(square, x * x + y * y + height * height);
        }
    }
};

// Area in the plane, m^2, of an area of the image, px^2, at a depth.
double area_in_plane(double area, const Criteria &criteria, double depth, double height) {
    const Lens &camera = criteria.lens;
    if (criteria.is_parallel) return area / (camera.fx * camera.fy * height);
    return area * (depth / camera.fx) * (depth / camera.fy) * (depth / height);
}

// Rounding of the position, the height and the ray, brought to the plane.
double rounding_in_plane(const Criteria &criteria, const Plane &plane, double square,
                         double height) {
    const double pixel = criteria.pixel_error / std::min(criteria.lens.fx, criteria.lens.fy);
    return criteria.is_parallel ? (2 * plane.error + pixel) / height
                                : (2 * POSITION_ERROR_REL + 2 * pixel) * (square / height);
}

// Regions of one face; `piece` is the first that is kept of it, -1 for none. Seen by parallel rays,
// its image is its plane but for an affine map, and densities are the same all over it.
void cut_face(int64_t f, const Planes &planes, const Criteria &criteria, const Seen &seen,
              const Image &image, int64_t piece, Scratch &scratch, const Found &out) {
    const Rules &rules = criteria.rules;
    const bool is_parallel = criteria.is_parallel;
    Plane &plane = scratch.plane;
    double &bound = out.bound[f];
    const auto [least, most] = set_plane(planes, f, seen, plane);
    const double error = is_parallel ? POSITION_ERROR_REL : plane.error;
    double height = is_parallel ? -plane.normal.z : plane.height;
    if (planes.two_sided[f]) height = std::abs(height);
    if (height <= -error) return;
    Borders borders;
    const double farthest = set_borders(plane, criteria, seen.near, most, borders);
    if (most < std::max(seen.near, rules.z_n) - plane.error || least > farthest) return;
    if (is_parallel && !suits_rays(criteria, plane.normal, height)) return;
    Polygon memory;
    const Points base = memory.points();
    copy_polygon(planes.corners[f], 3, base);
    const double slope = is_parallel ? 0.0 : rules.tan_incidence;
    if (image.is_whole() && image.error == 0 &&
        (is_parallel || (height > error && rules.min_pixel_density == 0)) &&
        is_well_inside(base, borders, plane, slope)) {
        if (is_parallel) append_piece(f, base, 3, plane.nearest_corners(), out);
        else append_dense(f, base, 3, criteria, scratch, out);
        bound = std::min(bound, planes.areas[f]);
        return;
    }
    const auto [n, strips] = cut_by_lines(base, 3, borders, 0, N_LINES);
    bound = std::min(strips, planes.areas[f]);
    if (n < 3) return;
    bound = 0.0;
    const Span depths(base, n, plane, height);
    const double least_height = depths.least * rules.cos_incidence * (1 - POSITION_ERROR_REL);
    if (!is_parallel && height + error < least_height) return;
    const double largest = std::min(twice_area(base, n) / 2 + strips, planes.areas[f]);
    // Where an error of the image may be all of the face, nothing of it is certain: what is in
    // doubt can only add to the area.
    if (height > error) bound = area_in_plane(image.error, criteria, depths.most, height);
    if (height <= error || bound >= largest) {
        bound = out.doubt[f] = largest;
        return;
    }
    const bool is_doubtful = bound > DOUBTFUL_SHARE * largest;
    Circle circle(plane, slope, criteria.gap);
    const auto append = [&](Points polygon, int64_t m) {
        if (is_parallel) append_piece(f, polygon, m, plane.nearest_corners(), out);
        else append_within_angle(f, polygon, m, circle, criteria, scratch, out);
    };
    if (image.is_whole()) {
        bound += strips;
        append(base, n);
    } else if (image.visible > 0 && piece >= 0) {
        const double off = rounding_in_plane(criteria, plane, depths.square, height);
        const auto bring = [&](int64_t at, Points part) {
            return bring_back(seen.kept, at, plane, criteria, most, part);
        };
        append_visible(planes.corners[f], seen.kept, piece, borders, off, bound, bring, append);
    }
    if (!is_parallel) decide_densities(f, criteria, scratch, out);
    bound = std::min(bound, largest);
    if (is_doubtful && out.area[f] == 0) out.doubt[f] = bound;
}

} // namespace

// Regions of all faces that one pose covers. Where `used` of `out` is more than there is room for,
// call again with that much.
void cut_regions(const Planes &planes, const Criteria &criteria, const Seen &seen,
                 const Found &out) {
    const int64_t n = planes.areas.rows(), n_rows = seen.state.rows(), n_kept = seen.kept.used[0];
    std::vector<int64_t> first(n_rows, -1);
    for (int64_t p = n_kept - 1; p >= 0; p--) {
        first[seen.kept.faces[p]] = p;
    }
    const auto scratch = std::make_unique_for_overwrite<Scratch>();
    out.used[0] = out.used[1] = 0;
    out.cut_short[0] = 0.0;
    Poll poll(64);
    for (int64_t f = 0; f < n; f++) {
        poll();
        const int64_t row = seen.rows.rows() ? seen.rows[f] : f;
        const int64_t state = seen.state[row];
        out.area[f] = out.bound[f] = out.doubt[f] = 0.0;
        if (!planes.is_asked[f] || !(state & (exact::LIVE | exact::THIN | exact::DOUBTFUL)))
            continue;
        if (seen.side[row] < 0 && !planes.two_sided[f]) continue;
        const Image image = {seen.visible[row], seen.area[row],
                             seen.is_certified[row] ? 0.0 : seen.area_error[row]};
        if ((state & exact::LIVE) && image.visible == 0 && image.error == 0) continue;
        cut_face(f, planes, criteria, seen, image, first[row], *scratch, out);
    }
}

namespace {

// --- through a lens ---

// Line of a node of the field of view in the plane of a face, and its error.
struct NodeLine {
    Affine line;
    double error;
};
NodeLine line_of_node(int64_t node, const lens::Tree &tree, const Plane &plane) {
    const double a = tree.lines(node, 0), b = tree.lines(node, 1), c = tree.lines(node, 2);
    return {line_in_plane(a, b, c, plane), plane.error * (std::abs(a) + std::abs(b) + std::abs(c))};
}

// A child of a node: a later node or a leaf.
int64_t child_of(int64_t node, int side, const lens::Tree &tree) {
    const int64_t child = tree.children(node, side);
    require(child < 0 || (child > node && child < tree.children.rows()),
            "children of the field of view must follow their node");
    return child;
}

// True if a polygon lies in one cell of the tree that is inside the image, without a cut.
bool is_in_view(Points corners, int64_t n, const Plane &plane, const lens::Tree &tree) {
    int64_t node = tree.root;
    while (node >= 0) {
        const auto [line, error] = line_of_node(node, tree, plane);
        const auto [least, most] = least_and_most(corners, n, line);
        if (!(least > error || most < -error)) return false;
        node = child_of(node, least > error ? 0 : 1, tree);
    }
    return node == lens::INSIDE;
}

// Area of the strip along a line within which it is not known on which side a polygon is.
double strip_along(Points polygon, int64_t n, const Affine &line, double error) {
    const double slope = length2(line.x, line.y);
    double strip = twice_area(polygon, n) / 2;
    if (slope > 0) strip = std::min(strip, error / slope * perimeter_of(polygon, n));
    return std::max(strip, 0.0);
}

// Puts what is beyond a line aside, for a child of the field of view; area of what is undecided.
double push_beyond(Points polygon, int64_t n, const Affine &line, int64_t child, Stack &views) {
    if (child == lens::OUTSIDE) return 0.0;
    const int64_t m = keep_beyond(polygon, n, line, -1.0, views.next());
    if (m < 3) return 0.0;
    if (child == lens::UNDECIDED || !views.has_room(2))
        return std::max(twice_area(views.next(), m) / 2, 0.0);
    views.push(m, child, 0);
    return 0.0;
}

// Appends the part of a convex polygon that the image of the lens shows, within the border of the
// valid region where that is shown; the undecided cells of the field of view go into the bound.
void append_in_view(int64_t face, Points polygon, int64_t n, const LensCriteria &criteria,
                    const std::optional<Cone> &cone, Scratch &scratch, const Found &out) {
    const Plane &plane = scratch.plane;
    const lens::Tree &tree = criteria.tree;
    Stack &views = scratch.views;
    double &bound = out.bound[face];
    Polygon memory, spare;
    const Points part = memory.points();
    const double nearest = plane.nearest_corners();
    // A power of two, so that a lamp lights the same to the bit in scenes of about the same size.
    const double cone_gap = std::ldexp(1.0, std::ilogb(criteria.pinhole.gap));
    const auto append = [&](Points found, int64_t m) {
        if (!cone) append_piece(face, found, m, nearest, out);
        else append_within_cone(face, found, m, *cone, cone_gap, scratch, out);
    };
    if (is_in_view(polygon, n, plane, tree)) {
        append(polygon, n);
        return;
    }
    views.push_parts(polygon, n, tree.root, 0);
    Poll poll(64);
    while (views.top > 0) {
        poll();
        const Stack::Entry &entry = views.pop();
        int64_t node = entry.one;
        n = entry.n;
        copy_polygon(views.next(), n, part);
        while (node >= 0) {
            const uint8_t kind = tree.kinds[node];
            if (kind == lens::BAND && twice_area(part, n) / 2 <= criteria.gap * reach_of(part, n)) {
                node = lens::UNDECIDED;
                break;
            }
            const auto [line, error] = line_of_node(node, tree, plane);
            const auto [least, most] = least_and_most(part, n, line);
            if (kind == lens::BORDER && least < error && most > -error)
                bound += strip_along(part, n, line, error);
            if (least >= 0 || most <= 0) {
                node = child_of(node, least >= 0 ? 0 : 1, tree);
                continue;
            }
            bound += push_beyond(part, n, line, child_of(node, 1, tree), views);
            n = keep_beyond(part, n, line, 1.0, spare.points());
            copy_polygon(spare.points(), n, part);
            if (n < 3) break;
            node = child_of(node, 0, tree);
            if (n > 2 * MOST_CORNERS && views.has_room(2)) {
                // A chord divides what has many corners.
                const int64_t m = exact::copy_second_half(part, n, views.next());
                views.push(m, node, 0);
                n = n / 2 + 1;
            }
        }
        if (n < 3) continue;
        if (node == lens::INSIDE) append(part, n);
        else if (node == lens::UNDECIDED) bound += std::max(twice_area(part, n) / 2, 0.0);
    }
}

// Tangent of the angle up to which a face is in focus and not too oblique, 0 for any: both are
// discs around the foot of the perpendicular from the camera; the smaller one counts. Of a disc
// that is hardly there it is -1, and `undecided` the area within which it may be.
struct Disc {
    double slope, undecided;
};
Disc disc_of(const Rules &rules, Plane &plane) {
    const double farthest = rules.z_f, slope = rules.tan_incidence;
    const double height = std::abs(plane.height), square = farthest * farthest - height * height;
    if (!(slope == 0 || square < slope * slope * height * height)) return {slope, 0.0};
    if (square <= 16 * farthest * plane.error) {
        const bool is_near = square > -16 * farthest * plane.error;
        return {-1.0, is_near ? 128 * farthest * plane.error : 0.0};
    }
    // The radius of the circle at that distance is off by height / radius times the error of the
    // height.
    const double radius = std::sqrt(square);
    plane.error *= 1 + height / radius;
    return {radius / height, 0.0};
}

// Sets `borders` to those of the depths in focus; false where any depth is.
bool set_depths(const LensCriteria &criteria, const Plane &plane, Border (&borders)[2]) {
    const auto [z, z_x, z_y] =
        line_in_plane(criteria.axis[0], criteria.axis[1], criteria.axis[2], plane);
    borders[0] = border_of(z - criteria.rules.z_n, z_x, z_y, plane.error);
    // What is infinitely far away needs no line.
    borders[1] = border_of(1.0, 0.0, 0.0, 0.0);
    if (criteria.rules.z_f < INF)
        borders[1] = border_of(criteria.rules.z_f - z, -z_x, -z_y, plane.error);
    return !criteria.by_distance && (criteria.rules.z_n > 0 || criteria.rules.z_f < INF);
}

} // namespace

// Cuts pieces in an ideal plane, by face, by one of the steps for lenses, see above. Where `used`
// of `out` is more than there is room for, call again with that much.
void cut_pieces(const Planes &planes, const LensCriteria &criteria, const Seen &seen,
                const Found &source, Step step, const Found &out) {
    const Int32Array face = {source.face.data, {source.used[0]}};
    const auto scratch = std::make_unique_for_overwrite<Scratch>();
    Plane &plane = scratch->plane;
    Polygon memory;
    const Points polygon = memory.points();
    Border depths[2];
    int64_t last = -1;
    bool has_depths = false;
    Disc disc = {0.0, 0.0};
    std::optional<Circle> circle;
    std::optional<Cone> cone;
    out.used[0] = out.used[1] = 0;
    std::fill(out.area.begin(), out.area.end(), 0.0);
    std::copy(source.bound.begin(), source.bound.end(), out.bound.begin());
    std::copy(source.doubt.begin(), source.doubt.end(), out.doubt.begin());
    out.cut_short[0] = source.cut_short[0];
    Poll poll(16);
    for (int64_t piece = 0; piece < face.rows(); piece++) {
        poll();
        const int64_t f = face[piece];
        if (f != last) {
            if (last >= 0) decide_densities(last, criteria, *scratch, out);
            set_plane(planes, f, seen, plane);
            last = f;
            if (step == TO_DISCS) {
                disc = disc_of(criteria.rules, plane);
                circle.emplace(plane, disc.slope, criteria.pinhole.gap);
            }
            if (step == TO_VIEW) has_depths = set_depths(criteria, plane, depths);
            if (criteria.unit > 0) plane = flatten(plane, criteria.unit);
            if (step == TO_VIEW && criteria.has_border)
                cone.emplace(criteria.params, criteria.frame, plane);
        }
        const auto corners = piece_at(piece, source.starts, source.xy);
        int64_t n = corners.rows();
        copy_polygon(corners, n, polygon);
        if (step == TO_DENSITIES) {
            append_dense(f, polygon, n, criteria, *scratch, out);
        } else if (step == TO_DISCS && disc.slope < 0) {
            out.bound[f] += std::min(twice_area(polygon, n) / 2, disc.undecided);
        } else if (step == TO_DISCS) {
            append_within_angle(f, polygon, n, *circle, criteria.pinhole, *scratch, out);
        } else {
            if (has_depths) {
                const Cut cut = cut_by_lines(polygon, n, depths, 0, 2);
                n = cut.n;
                out.bound[f] += cut.undecided;
            }
            if (n >= 3) append_in_view(f, polygon, n, criteria, cone, *scratch, out);
        }
    }
    if (last >= 0) decide_densities(last, criteria, *scratch, out);
    for (int64_t f = 0; f < out.bound.rows(); f++)
        out.bound[f] = std::min(out.bound[f], planes.areas[f]);
}
} // namespace area
} // namespace rastercov
