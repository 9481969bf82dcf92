// Event edges of a ball of camera centres, and what their shadows and the errors of a camera leave.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/tolerance.hpp"
#include "area/circle.hpp"
#include "camera/near.hpp"
#include "mesh/triangles.hpp"
#include "solver/idle.hpp"
#include "solver/limits.hpp"
#include <numeric>

namespace rastercov::engine {

namespace {
using area::Plane, area::Points, area::U, area::V, area::Vector;
using Corners = FloatRows<2>;

// Sides of the hull round a cap of directions.
constexpr int CAP = 24;
constexpr double MARGIN_REL = 1e-9;        // of the diagonal, by which the ball is larger: rounding
constexpr double LEAST_HEIGHT_REL = 1e-11; // of the same: an edge at this height is in the plane
constexpr double TOUCH_REL = 1e-8; // of the same: nearer than this an edge touches what is seen
// Of the distance of the ball: an edge nearer than this, in view, may be anywhere in the image.
constexpr double LEAST_DEPTH = 1.5;
constexpr double WIDEST = 1.5; // radians; a wider view may see what is beside the camera
constexpr double WIDER = 1.001;
constexpr double PART_MARGIN = 1e-6; // of an edge, on both ends of what is seen of it
// Shadows that are held against one another; more are divided by place, so many times at most.
constexpr size_t MOST_AT_ONCE = 20;
constexpr int DEEPEST = 16;
constexpr int8_t MOST_TIMES = 16;   // that a part of an edge grows before all of it counts
constexpr int64_t MOST_CELLS = 256; // of a side of the grid

area::Seen seen_of(const Mount &mount) {
    area::Seen seen = {};
    seen.rotation = {mount.pose.rotation, {3, 3}};
    seen.centre = {mount.pose.centre, {3}};
    seen.near = mount.near;
    return seen;
}

Vector in_axes(const exact::Vertices &vertices, int64_t v, const Pose &pose) {
    double away[3];
    for (int k = 0; k < 3; k++) away[k] = vertices(v, k) - pose.centre[k];
    const auto along = [&](int k) {
        return away[0] * pose.at(0, k) + away[1] * pose.at(1, k) + away[2] * pose.at(2, k);
    };
    return {along(0), along(1), along(2)};
}

// Angle between the nominal axis and a ray in view with some errors.
double widest_angle(const Mount &mount, double d, double nearest) {
    const double turned = d > 0 ? std::asin(std::min(d / nearest, 1.0)) : 0.0;
    return std::atan(widest_of(mount.criteria.lens) / (1 - mount.errors.focal)) +
           mount.errors.angle + turned;
}

// Inward normals of the four planes through the border of an image.
std::array<Vector, 4> border_of(const Lens &of, double scale) {
    const double fx = of.fx * scale, fy = of.fy * scale;
    std::array<Vector, 4> normals = {Vector{fx, 0, of.cx}, Vector{-fx, 0, of.width - of.cx},
                                     Vector{0, fy, of.cy}, Vector{0, -fy, of.height - of.cy}};
    for (Vector &each : normals) each = 1 / area::length_of(each) * each;
    return normals;
}

// Least of n.v for what is on the inner side of a plane of normal n, turned and shifted, with some
// errors: max n'.v over the n' up to an angle a from n is at most cos a n.v + sin a |v|.
double slack_of(const Errors &errors, double reach) {
    return reach * std::sin(errors.angle) + errors.position;
}

// Leaves the part of an edge that is in the image with some errors; false for none.
bool keep_in_image(const std::array<Vector, 4> &border, const Errors &errors, Vector (&ends)[2]) {
    const double reach = std::max(area::length_of(ends[0]), area::length_of(ends[1]));
    const double slack = slack_of(errors, reach) * (1 + 1e-9), cosine = std::cos(errors.angle);
    for (const Vector &normal : border) {
        const double inside[2] = {cosine * dot(normal, ends[0]) + slack,
                                  cosine * dot(normal, ends[1]) + slack};
        if (inside[0] < 0 && inside[1] < 0) return false;
        for (int i = 0; i < 2; i++)
            if (inside[i] < 0)
                ends[i] =
                    ends[i] + inside[i] / (inside[i] - inside[1 - i]) * (ends[1 - i] - ends[i]);
    }
    return true;
}

// Distance of the nearest face of a part from a point, at most `best`.
double nearest_of(const Part &part, const FacePlanes *planes, const double *eye, double best) {
    for (int64_t f = 0; f < part.faces.rows(); f++) {
        if (planes) {
            const Vector &n = planes->normal[size_t(f)];
            const double height =
                n.x * eye[0] + n.y * eye[1] + n.z * eye[2] + planes->offset[size_t(f)];
            if (std::abs(height) >= best || (n.x == 0 && n.y == 0 && n.z == 0)) continue;
        }
        double corners[9], out[3];
        double apart = 0.0; // square of the distance of the box of the face
        for (int k = 0; k < 3; k++) {
            for (int c = 0; c < 3; c++) corners[3 * c + k] = part.vertices(part.faces(f, c), k);
            const auto [low, high] = std::minmax({corners[k], corners[3 + k], corners[6 + k]});
            const double gap = std::max({low - eye[k], eye[k] - high, 0.0});
            apart += gap * gap;
        }
        if (apart > best * best) continue;
        const double found = std::sqrt(mesh::nearest_on_triangle(eye, corners, out));
        if (found < best) best = found; // false for a face without area
    }
    return best;
}

double distance2(double x, double y, double ax, double ay, double bx, double by) {
    const double dx = bx - ax, dy = by - ay, square = dx * dx + dy * dy;
    const double t =
        square > 0 ? std::clamp(((x - ax) * dx + (y - ay) * dy) / square, 0.0, 1.0) : 0.0;
    return area::length2(x - ax - t * dx, y - ay - t * dy);
}

// Distance of two segments in the image.
double distance_of(const EventField::Edge &a, const EventField::Edge &b) {
    const auto side = [](double x, double y, const EventField::Edge &e) {
        return (e.u1 - e.u0) * (y - e.v0) - (e.v1 - e.v0) * (x - e.u0);
    };
    const bool crosses = side(b.u0, b.v0, a) * side(b.u1, b.v1, a) < 0 &&
                         side(a.u0, a.v0, b) * side(a.u1, a.v1, b) < 0;
    if (crosses) return 0.0;
    return std::min({distance2(a.u0, a.v0, b.u0, b.v0, b.u1, b.v1),
                     distance2(a.u1, a.v1, b.u0, b.v0, b.u1, b.v1),
                     distance2(b.u0, b.v0, a.u0, a.v0, a.u1, a.v1),
                     distance2(b.u1, b.v1, a.u0, a.v0, a.u1, a.v1)});
}

// The hull of points without corners that rounding may have put anywhere: a side between two of
// them has no direction, and may seem to have all of a piece beyond it.
int64_t tidy_hull(Points points, int64_t n, double nearest) {
    area::Polygon memory;
    n = area::make_hull(points, n);
    if (n < 3) return 0;
    const int64_t kept = area::without_needless(points, n, nearest, memory.points());
    area::copy_polygon(memory.points(), kept, points);
    return kept;
}

// Pieces of one face of a table: the first, and the one after the last.
template <class Faces> int64_t end_of_face(const Faces &face, int64_t first, int64_t n) {
    int64_t end = first;
    while (end < n && face[end] == face[first]) end++;
    return end;
}
} // namespace

FacePlanes::FacePlanes(const Surface &surface)
    : normal(size_t(surface.n_opaque())), offset(size_t(surface.n_opaque())),
      mesh_face(size_t(surface.n_opaque())) {
    const auto &place = surface.place();
    for (int64_t f = 0; f < place.rows(); f++)
        if (place[f] < surface.n_opaque()) mesh_face[size_t(place[f])] = int32_t(f);
    for (int64_t f = 0; f < surface.n_opaque(); f++) {
        if (place.rows() == 0) mesh_face[size_t(f)] = int32_t(f);
        const auto corner = [&](int k) {
            const auto at = surface.vertices()[surface.faces()(f, k)];
            return Vector{at[0], at[1], at[2]};
        };
        const Vector a = corner(0), b = corner(1) - a, c = corner(2) - a;
        const Vector n = area::cross(b, c);
        const double size = area::length_of(n);
        if (!(size > 0)) continue;
        normal[size_t(f)] = 1 / size * n;
        offset[size_t(f)] = -dot(normal[size_t(f)], a);
    }
}

// --- event edges ---

bool EventField::set(const Surface &surface, const FacePlanes &planes, const Mount &mount,
                     const std::array<Vector, 4> &border, double widest) {
    _widest = widest;
    const double d = mount.errors.position, k = std::sqrt(1 + _widest * _widest);
    const double *eye = mount.pose.centre;
    const exact::Edges &edges = surface.edges();
    _sides.resize(planes.normal.size());
    for (size_t f = 0; f < _sides.size(); f++) {
        const Vector &n = planes.normal[f];
        const double height = n.x * eye[0] + n.y * eye[1] + n.z * eye[2] + planes.offset[f];
        const double margin = mount.margins.event * d;
        _sides[f] = height > margin ? 1 : height < -margin ? -1 : 0;
    }
    _edges.clear();
    _n_events = 0;
    for (int64_t e = 0; e < edges.faces.rows(); e++) {
        if (is_plain(edges, e)) continue;
        _n_events++;
        Vector ends[2];
        for (int i = 0; i < 2; i++)
            ends[i] = in_axes(surface.vertices(), edges.vertices(e, i), mount.pose);
        const double deepest = std::max(ends[0].z, ends[1].z);
        if (deepest < -d) continue;
        const Vector along = ends[1] - ends[0];
        const double square = dot(along, along);
        const double t = square > 0 ? std::clamp(-dot(ends[0], along) / square, 0.0, 1.0) : 0.0;
        const double zeta = (area::length_of(ends[0] + t * along) - d) / k - d;
        if (deepest <= zeta) continue;
        if (!(zeta > LEAST_DEPTH * d)) return false;
        for (int i = 0; i < 2; i++) {
            if (ends[i].z >= zeta) continue;
            const double part = (zeta - ends[i].z) / (ends[1 - i].z - ends[i].z);
            ends[i] = ends[i] + part * (ends[1 - i] - ends[i]);
            ends[i].z = zeta;
        }
        if (!keep_in_image(border, mount.errors, ends)) continue;
        Edge edge = {{{ends[0], ends[1]}, zeta},     0, 0,         0, 0,
                     std::min(ends[0].z, ends[1].z), 0, int32_t(e)};
        edge.project();
        const double out =
            std::max(edge.u0 * edge.u0 + edge.v0 * edge.v0, edge.u1 * edge.u1 + edge.v1 * edge.v1);
        edge.grow = d * std::sqrt(1 + out) / (edge.nearest - d) * (1 + 1e-9);
        if (!exact::are_apart(edge.box(edge.grow), {-_widest, _widest, -_widest, _widest}))
            _edges.push_back(edge);
    }
    list_edges();
    return true;
}

// Whether all camera centres see an edge, by `_sides`, as one between faces that go on.
bool EventField::is_plain(const exact::Edges &edges, int64_t e) const {
    const int64_t f = edges.faces(e, 0), g = edges.faces(e, 1);
    const int first = _sides[size_t(f)], second = g >= 0 ? _sides[size_t(g)] : 0;
    return edges.kind[e] != exact::NON_MANIFOLD && first != 0 && second != 0 &&
           (edges.kind[e] == exact::CONSISTENT) == (first == second);
}

void EventField::set_parallel(const Surface &surface, const FacePlanes &planes, const Mount &mount,
                              double widest) {
    _widest = widest;
    const double tangent = mount.disc.tangent, far = 4 * widest;
    const double margin = tangent / std::sqrt(1 + tangent * tangent); // sine of the half angle
    const exact::Edges &edges = surface.edges();
    _sides.resize(planes.normal.size());
    for (size_t f = 0; f < _sides.size(); f++) {
        const Vector &n = planes.normal[f];
        const double along =
            -(n.x * mount.pose.at(0, 2) + n.y * mount.pose.at(1, 2) + n.z * mount.pose.at(2, 2));
        _sides[f] = along > margin ? 1 : along < -margin ? -1 : 0;
    }
    clear();
    for (int64_t e = 0; e < edges.faces.rows(); e++) {
        if (is_plain(edges, e)) continue;
        _n_events++;
        const auto end = [&](int i) {
            return in_axes(surface.vertices(), edges.vertices(e, i), mount.pose);
        };
        Edge edge = {{{end(0), end(1)}, 0.0}, 0, 0, 0, 0, 0, 0, int32_t(e), tangent};
        edge.nearest = std::min(edge.hiding.ends[0].z, edge.hiding.ends[1].z);
        edge.grow = tangent * std::max(far - edge.nearest, 0.0);
        edge.project();
        _edges.push_back(edge);
    }
    list_edges();
}

void EventField::set(std::vector<Edge> &&edges) {
    _edges = std::move(edges);
    list_edges();
}

// Calls with the cells that an edge with its margin runs through.
template <class Visit> void EventField::each_cell(const Edge &edge, Visit visit) const {
    const double g = edge.grow, size = 2 * _widest / double(_side);
    const exact::Bounds box = edge.box(g);
    const int64_t top = cell_of(box.v_min), bottom = cell_of(box.v_max);
    const double du = edge.u1 - edge.u0, dv = edge.v1 - edge.v0;
    for (int64_t row = top; row <= bottom; row++) {
        // Part of the edge within the row and its margin; the outer rows hold all beyond them.
        double first = 0.0;
        double last = 1.0;
        if (dv != 0) {
            const double low = row > 0 ? double(row) * size - _widest - 2 * g : -INFINITY;
            const double high =
                row + 1 < _side ? double(row + 1) * size - _widest + 2 * g : INFINITY;
            const double a = (low - edge.v0) / dv, b = (high - edge.v0) / dv;
            first = std::clamp(std::min(a, b), 0.0, 1.0);
            last = std::clamp(std::max(a, b), 0.0, 1.0);
        }
        const double u = edge.u0 + first * du, w = edge.u0 + last * du;
        const int64_t left = cell_of(std::min(u, w) - g), right = cell_of(std::max(u, w) + g);
        for (int64_t column = left; column <= right; column++) visit(row * _side + column);
    }
}

void EventField::Edge::set_part(const Edge &whole, const exact::Part &part) {
    const auto &[from, to] = whole.hiding.ends;
    const Vector along = to - from;
    hiding.ends[0] = from + part.first * along;
    hiding.ends[1] = from + part.last * along;
    project();
}

void EventField::Edge::project() {
    const auto &[from, to] = hiding.ends;
    const double first = tangent > 0 ? 1.0 : from.z, last = tangent > 0 ? 1.0 : to.z;
    u0 = from.x / first;
    v0 = from.y / first;
    u1 = to.x / last;
    v1 = to.y / last;
}

void EventField::list_edges() {
    const double wanted = std::sqrt(double(_edges.size()));
    _side = std::clamp(int64_t(wanted), int64_t(1), MOST_CELLS);
    _starts.assign(size_t(_side * _side + 1), 0);
    for (const Edge &edge : _edges)
        each_cell(edge, [&](int64_t cell) { _starts[size_t(cell) + 1]++; });
    for (size_t c = 1; c < _starts.size(); c++) _starts[c] += _starts[c - 1];
    _entries.resize(size_t(_starts.back()));
    std::vector<int64_t> next(_starts.begin(), _starts.end() - 1);
    for (size_t k = 0; k < _edges.size(); k++)
        each_cell(_edges[k],
                  [&](int64_t cell) { _entries[size_t(next[size_t(cell)]++)] = int32_t(k); });
    _seen.assign(_edges.size(), 0);
    _round = 0;
}

template <class Each> void EventField::each_in(const exact::Bounds &box, Each each) {
    const int64_t left = cell_of(box.u_min), right = cell_of(box.u_max);
    const int64_t top = cell_of(box.v_min), bottom = cell_of(box.v_max);
    for (int64_t row = top; row <= bottom; row++)
        for (int64_t cell = row * _side + left; cell <= row * _side + right; cell++)
            for (int64_t at = _starts[size_t(cell)]; at < _starts[size_t(cell) + 1]; at++) {
                const auto k = size_t(_entries[size_t(at)]);
                const Edge &edge = _edges[k];
                if (_seen[k] == _round || exact::are_apart(edge.box(edge.grow), box)) continue;
                _seen[k] = _round;
                each(k);
            }
}

// --- criteria ---

namespace {
// Directions whose hull holds a cap of directions.
struct Cap {
    Vector middle;
    std::array<Vector, CAP> around;
    int n = 0;

    // Those up to an angle from a unit vector.
    static Cap of(const Vector &axis, double angle) {
        static const auto TURNS = area::around<CAP>(0.0);
        Cap cap = {axis, {}, 0};
        if (angle == 0) {
            cap.around[0] = axis;
            cap.n = 1;
            return cap;
        }
        const auto [u, v] = area::across(axis, {1, 0, 0});
        const double out = std::sin(angle) / std::cos(std::numbers::pi / CAP);
        for (const auto &[c, s] : TURNS)
            cap.around[size_t(cap.n++)] = std::cos(angle) * axis + out * (c * u + s * v);
        return cap;
    }
};

// Least of a cap along a vector: its cosine along the middle, less its sine across.
double least_along(const Vector &middle, const Vector &at, double cosine, double sine) {
    const double along = dot(middle, at);
    const double across = std::sqrt(std::max(dot(at, at) - along * along, 0.0));
    return cosine * along - sine * across;
}

// Depths in focus and dense enough on a plane at a height, whatever the errors (sign -1), or with
// some (+1); before the error of the depth itself.
struct DepthRange {
    double least, most;
};
DepthRange depths_of(const Mount &mount, double height, double sign) {
    const auto &[lens, rules] = std::tie(mount.criteria.lens, mount.criteria.rules);
    const double d = mount.errors.position, scale = 1 + sign * mount.errors.focal;
    const double near = mount.near - sign * NEAR_TO_FAR * d;
    DepthRange range = {std::max(near, rules.z_n), rules.z_f};
    if (rules.min_facing_density > 0)
        range.most =
            std::min(range.most, scale * std::min(lens.fx, lens.fy) / rules.min_facing_density);
    if (rules.min_pixels_per_m2 > 0)
        range.most = std::min(range.most, std::pow(scale * scale * lens.fx * lens.fy *
                                                       std::max(height + sign * d, 0.0) /
                                                       rules.min_pixels_per_m2,
                                                   1.0 / 3));
    return range;
}

// Factor by which errors may lessen the density along the worst direction in a polygon, but for the
// focal length: 0 where there is no bound. See docs/appendix/tolerance.md.
double density_factor(const Mount &mount, const Plane &plane, Points polygon, int64_t n) {
    const Errors &errors = mount.errors;
    const Lens &lens = mount.criteria.lens;
    const double d = errors.position, height = std::abs(plane.height);
    double least = INFINITY;
    double widest = 0.0;
    for (int64_t p = 0; p < n; p++) {
        const Vector at =
            plane.origin + polygon(p, U) * plane.x_axis + polygon(p, V) * plane.y_axis;
        least = std::min(least, at.z);
        widest = std::max(widest, at.z > 0 ? area::length2(at.x, at.y) / at.z : INFINITY);
    }
    if (!(height > d && least > 2 * d)) return 0.0;
    const double angle = std::atan(widest) + errors.angle + std::asin(d / least);
    if (!(angle < WIDEST)) return 0.0;
    const double x = std::tan(angle), across = area::length2(plane.normal.x, plane.normal.y);
    // Pixels that are not square turn and shear a little more.
    const double ratio = std::max(lens.fx / lens.fy, lens.fy / lens.fx);
    const double skew = (ratio - 1) / 2 * x + (ratio - 1 / ratio) / 2;
    const double steps = 1 / (least - d) + ratio * std::sqrt(1 + x * x) * across / (height - d);
    return std::exp(-mount.margins.density * ((2 * x + skew) * errors.angle + d * steps));
}

// Appends the part of a polygon within a circle that is dense enough.
void append_criteria(int64_t f, Points polygon, int64_t n, area::Circle &circle,
                     area::Criteria criteria, area::Scratch &scratch, const area::Found &out) {
    if (criteria.rules.min_pixel_density > 0) {
        const int side = area::dense_by_corners(polygon, n, scratch.plane, criteria);
        if (side < 0) return;
        if (side > 0) criteria.rules.min_pixel_density = 0.0;
    }
    area::append_within_angle(f, polygon, n, circle, criteria, scratch, out);
    area::decide_densities(f, criteria, scratch, out);
}
} // namespace

// Directions of the criteria of a pose, in camera axes.
struct ToleranceCutter::Directions {
    Cap axis;
    std::array<Cap, 4> border;
    double cosine, sine;

    // Which criteria all corners of a polygon meet in all poses: least and most depth, four
    // borders.
    std::array<bool, 6> met_by(Points polygon, int64_t n, const Plane &plane, double least,
                               double most, double d) const {
        std::array<bool, 6> is_met;
        is_met.fill(true);
        for (int64_t p = 0; p < n; p++) {
            const Vector at =
                plane.origin + polygon(p, U) * plane.x_axis + polygon(p, V) * plane.y_axis;
            const double far = area::length_of(at);
            const auto holds = [&](const Vector &middle, double limit) {
                return cosine * dot(middle, at) - sine * far >= limit ||
                       least_along(middle, at, cosine, sine) >= limit;
            };
            is_met[0] &= holds(axis.middle, least);
            is_met[1] &= at.z + sine * area::length2(at.x, at.y) <= most;
            for (size_t k = 0; k < 4; k++) is_met[k + 2] &= holds(border[k].middle, d);
        }
        return is_met;
    }

    explicit Directions(const Mount &mount) {
        const double angle = mount.margins.cap * mount.errors.angle;
        axis = Cap::of({0, 0, 1}, angle);
        const auto normals =
            border_of(mount.criteria.lens, 1 + mount.margins.focal * mount.errors.focal);
        for (size_t k = 0; k < 4; k++) border[k] = Cap::of(normals[k], angle);
        cosine = std::cos(angle);
        sine = std::sin(angle);
    }
};

// What a step finds, with more room as it needs it.
template <class Step> void ToleranceCutter::run(Pieces &pieces, int64_t n_faces, Step step) {
    const auto make = [&](int64_t n, int64_t corners) {
        pieces.xy.take(2 * corners);
        pieces.starts.take(n + 1);
        pieces.starts[0] = 0;
        pieces.face.take(n);
        pieces.area.take(n_faces);
        pieces.bound.take(n_faces);
        pieces.doubt.take(n_faces);
    };
    if (pieces.area.size() != n_faces) make(first_room(1024), first_room(8192));
    while (true) {
        pieces.used[0] = pieces.used[1] = 0;
        pieces.cut_short = 0.0;
        pieces.area.fill(0.0);
        pieces.bound.fill(0.0);
        pieces.doubt.fill(0.0);
        step(pieces.found());
        if (pieces.used[0] <= pieces.face.size() && 2 * pieces.used[1] <= pieces.xy.size()) return;
        make(more_room(pieces.used[0]), more_room(pieces.used[1]));
    }
}

// Cuts the pieces of a face by depth, border, incidence and density.
void ToleranceCutter::cut_face(int64_t f, const Mount &mount, const Directions &directions,
                               const RegionRows &source, int64_t first, int64_t last,
                               const area::Found &out) {
    Plane &plane = _scratch.plane;
    const double d = mount.errors.position, height = std::abs(plane.height);
    area::Criteria criteria = mount.criteria;
    const double tangent = criteria.rules.tan_incidence;
    Plane lower = plane;
    if (tangent > 0) {
        lower.height = height - mount.margins.disc * d / (tangent * criteria.rules.cos_incidence);
        if (!(lower.height > 0)) return;
        lower.height = std::copysign(lower.height, plane.height);
    }
    area::Circle circle(lower, tangent, criteria.gap);
    const DepthRange depths = depths_of(mount, height, -1.0);
    const double least = depths.least + d, most = depths.most - d;
    const double wanted = criteria.rules.min_pixel_density;
    area::Polygon memory, spare;
    const Points polygon = memory.points();
    for (int64_t piece = first; piece < last; piece++) {
        const auto corners = area::piece_at(piece, source.starts, source.xy);
        int64_t n = corners.rows();
        area::copy_polygon(corners, n, polygon);
        const auto is_met = directions.met_by(polygon, n, plane, least, most, d);
        const auto keep = [&](const Vector &by, double offset, double sign) {
            const area::Affine line = area::line_in_plane(by.x, by.y, by.z, plane);
            n = exact::cut(polygon, n, area::line_of({line.value - offset, line.x, line.y}, sign),
                           spare.points());
        };
        const auto cut_all = [&](const Cap &cap, double offset) {
            for (int k = 0; k < cap.n && n >= 3; k++) keep(cap.around[size_t(k)], offset, 1.0);
        };
        if (!is_met[0]) cut_all(directions.axis, least);
        for (int k = 0; k < directions.axis.n && n >= 3 && !is_met[1]; k++) {
            const Vector &axis = directions.axis.middle;
            const Vector turned = directions.axis.around[size_t(k)] - directions.cosine * axis;
            keep(directions.axis.n > 1 ? axis + turned : axis, most, -1.0);
        }
        for (size_t k = 0; k < 4; k++)
            if (!is_met[k + 2]) cut_all(directions.border[k], d);
        if (n < 3) continue;
        if (wanted > 0) {
            const double factor =
                (1 - mount.errors.focal) * density_factor(mount, plane, polygon, n);
            if (!(factor > 0)) continue;
            criteria.rules.min_pixel_density = wanted / factor;
        }
        append_criteria(f, polygon, n, circle, criteria, _scratch, out);
    }
}

void ToleranceCutter::cut_criteria(const Mount &mount, const area::Planes &planes,
                                   const RegionRows &source, const area::Found &out) {
    const Directions directions(mount);
    const int64_t n = source.face.rows();
    Poll poll(64);
    for (int64_t first = 0, last = 0; first < n; first = last) {
        poll();
        last = end_of_face(source.face, first, n);
        const int64_t f = source.face[first];
        area::set_plane(planes, f, _seen, _scratch.plane);
        const double height = _scratch.plane.height;
        const double above = planes.two_sided[f] ? std::abs(height) : height;
        if (mount.errors.position > 0 && above <= mount.errors.position) continue;
        cut_face(f, mount, directions, source, first, last, out);
    }
}

// --- shadows ---

// Casts on a face the shadows of edges that may reach its pieces; false where one has no end.
bool ToleranceCutter::cast_all(const Mount &mount, int64_t first, int64_t last,
                               const area::Found &from, Tolerated &told) {
    const Plane &plane = _scratch.plane;
    const double d = mount.errors.position;
    _shadows.clear();
    exact::Bounds flat = {INFINITY, -INFINITY, INFINITY, -INFINITY}, image = flat;
    const auto widen = [](exact::Bounds &box, double u, double v) {
        box = {std::min(box.u_min, u), std::max(box.u_max, u), std::min(box.v_min, v),
               std::max(box.v_max, v)};
    };
    double deepest = 0.0;
    _boxes.clear();
    for (int64_t piece = first; piece < last; piece++) {
        exact::Bounds own = {INFINITY, -INFINITY, INFINITY, -INFINITY};
        for (int64_t at = from.starts[piece]; at < from.starts[piece + 1]; at++) {
            const double x = from.xy(at, U), y = from.xy(at, V);
            const Vector p = plane.origin + x * plane.x_axis + y * plane.y_axis;
            deepest = std::max(deepest, p.z);
            widen(flat, x, y);
            if (mount.disc.tangent > 0) widen(own, p.x, p.y);
            else if (p.z > 0) widen(own, p.x / p.z, p.y / p.z);
            else own = {-_field.widest(), _field.widest(), -_field.widest(), _field.widest()};
        }
        widen(image, own.u_min, own.v_min);
        widen(image, own.u_max, own.v_max);
        _boxes.push_back(own);
    }
    const area::ShadowCaster caster(plane, mount.margins.shadow * d, deepest,
                                    LEAST_HEIGHT_REL * _surface.diagonal(), mount.disc);
    bool is_bounded = true;
    _field.begin();
    const auto cast = [&](size_t k) {
        const EventField::Edge &edge = _field.edges()[k];
        if (!is_bounded) return;
        const double reach = edge.reach(deepest, d);
        if (!(reach > 0) || exact::are_apart(edge.box(reach), image)) return;
        Cast shadow;
        const Points points = shadow.points();
        const area::Shadow kind = caster.cast(edge.hiding, points, shadow.n);
        is_bounded = kind != area::Shadow::UNBOUNDED;
        if (kind != area::Shadow::BOUNDED) return;
        shadow.box = exact::extent_of(points, shadow.n);
        if (exact::are_apart(shadow.box, flat)) return;
        shadow.n = tidy_hull(points, shadow.n, plane.nearest_corners());
        if (shadow.n < 3) return;
        shadow.area = area::twice_area(points, shadow.n);
        _shadows.push_back(shadow);
    };
    for (const exact::Bounds &own : _boxes) _field.each_in(own, cast);
    told.n_shadows += int64_t(_shadows.size());
    if (!is_bounded) told.n_unbounded++;
    std::sort(_shadows.begin(), _shadows.end(), [](const Cast &a, const Cast &b) {
        return std::tie(b.area, a.xy[0], a.xy[1]) < std::tie(a.area, b.xy[0], b.xy[1]);
    });
    _list.resize(_shadows.size());
    std::iota(_list.begin(), _list.end(), 0);
    return is_bounded;
}

namespace {
// Where a polygon is, by a convex one.
enum class Side { BEYOND, ACROSS, WITHIN };
Side side_of(const Corners &convex, int64_t n_sides, Points polygon, int64_t n) {
    const exact::Sides<Corners> sides = {convex, n_sides};
    bool is_within = true;
    for (int64_t s = 0; s < n_sides; s++) {
        const exact::Line line = exact::line_at(sides, s);
        bool is_beyond = true;
        for (int64_t p = 0; p < n; p++) {
            const double value = line.value(polygon(p, U), polygon(p, V));
            is_beyond &= value <= 0;
            is_within &= value >= 0;
        }
        if (is_beyond) return Side::BEYOND;
    }
    return is_within ? Side::WITHIN : Side::ACROSS;
}

// Takes a convex polygon from some parts; their number, -1 for lack of room.
int64_t take(area::Parts &parts, int64_t n_parts, const Corners &polygon, int64_t n,
             double nearest) {
    std::array<double, 2 * area::PIECE_ROOM> spare;
    std::array<double, area::PIECE_ROOM> values;
    const exact::Sides<Corners> sides = {polygon, n};
    return exact::clip_subtract(parts.view(), n_parts, sides, n, n, area::SLACK_REL * nearest,
                                {spare.data(), {area::PIECE_ROOM, 2}},
                                {values.data(), {area::PIECE_ROOM}});
}
} // namespace

// Sets `_own` to a polygon less some convex shapes; the number of parts.
template <class Shapes>
int64_t ToleranceCutter::subtract(const Corners &polygon, int64_t n, const Shapes &shapes,
                                  std::span<const int32_t> list, double nearest) {
    const exact::Bounds box = exact::extent_of(polygon, n);
    while (true) {
        _own.set_first(polygon, n);
        int64_t n_parts = 1;
        for (const int32_t k : list) {
            if (n_parts <= 0) break;
            const Shape shape = shapes(k);
            if (!exact::are_apart(shape.box, box))
                n_parts = take(_own, n_parts, shape.corners, shape.corners.rows(), nearest);
        }
        if (n_parts >= 0) return n_parts;
        _own.grow(2 * _own.room());
    }
}

// Divides a convex polygon by place until few of some convex shapes, those of `_list` from one on,
// reach into a part: calls few(polygon, n, list) for such parts, and all(polygon, n) for those
// within a shape.
template <class Shapes, class Few, class All>
void ToleranceCutter::divide(Points polygon, int64_t n, size_t first, int depth,
                             const Shapes &shapes, const Few &few, const All &all) {
    const exact::Bounds box = exact::extent_of(polygon, n);
    const size_t last = _list.size();
    for (size_t at = first; at < last; at++) {
        const Shape shape = shapes(_list[at]);
        if (exact::are_apart(shape.box, box)) continue;
        const Side side = side_of(shape.corners, shape.corners.rows(), polygon, n);
        if (side == Side::WITHIN) {
            _list.resize(last);
            all(polygon, n);
            return;
        }
        if (side == Side::ACROSS) _list.push_back(_list[at]);
    }
    if (_list.size() - last <= MOST_AT_ONCE || depth == DEEPEST) {
        few(polygon, n, std::span<const int32_t>(_list.data() + last, _list.size() - last));
    } else {
        const double width = box.u_max - box.u_min, height = box.v_max - box.v_min;
        const bool is_wide = width > height;
        const double middle = is_wide ? box.u_min + width / 2 : box.v_min + height / 2;
        const area::Affine line = {-middle, is_wide ? 1.0 : 0.0, is_wide ? 0.0 : 1.0};
        area::Polygon memory, spare;
        const Points part = memory.points();
        for (const double sign : {1.0, -1.0}) {
            area::copy_polygon(polygon, n, part);
            const int64_t m = exact::cut(part, n, area::line_of(line, sign), spare.points());
            if (m >= 3) divide(part, m, last, depth + 1, shapes, few, all);
        }
    }
    _list.resize(last);
}

// Takes the shadows from pieces.
void ToleranceCutter::subtract_shadows(const Mount &mount, const area::Planes &planes,
                                       const area::Found &from, const area::Found &out,
                                       Tolerated &told) {
    const int64_t n = from.used[0];
    told.n_shadows = told.n_unbounded = 0;
    const auto shadows = [&](int32_t k) { return shape_of(k); };
    Poll poll(16);
    for (int64_t first = 0, last = 0; first < n; first = last) {
        poll();
        last = end_of_face(from.face, first, n);
        const int64_t f = from.face[first];
        area::set_plane(planes, f, _seen, _scratch.plane);
        const double nearest = _scratch.plane.nearest_corners();
        if (!cast_all(mount, first, last, from, told)) continue;
        for (int64_t piece = first; piece < last; piece++) {
            const auto polygon = area::piece_at(piece, from.starts, from.xy);
            const int64_t n_rest = subtract(polygon, polygon.rows(), shadows, _list, nearest);
            for (int64_t r = 0; r < n_rest; r++) {
                const Points part = _own[r];
                const int64_t m = _own.n(r);
                if (m >= 3 && area::twice_area(part, m) > 2 * nearest * area::perimeter_of(part, m))
                    area::append_piece(f, part, m, nearest, out);
            }
        }
    }
}

// Sets what all steps of a pose need; false where the surface may reach a camera centre.
bool ToleranceCutter::begin(const Mount &mount, bool is_sure, Tolerated &told) {
    _seen = seen_of(mount);
    _border = border_of(mount.criteria.lens, 1 - mount.errors.focal);
    const double d = mount.errors.position;
    double best = nearest_of({_surface.vertices(), _surface.faces(), {}, {}}, &_face_planes,
                             mount.pose.centre, INFINITY);
    if (_surface.has_targets())
        best = nearest_of(_surface.targets(), nullptr, mount.pose.centre, best);
    told.nearest = best;
    const double angle = widest_angle(mount, d, best);
    const bool is_wide = !(angle < WIDEST);
    const double widest = is_wide ? INFINITY : std::tan(angle) * WIDER;
    // Before the near plane a surface hides nothing: what is beyond it depends on the errors.
    const bool is_near = !(best > d + mount.near * std::sqrt(1 + widest * widest));
    if (d == 0) {
        _field.clear();
        // What is sure is in the image and, without a turn, behind the same near plane.
        told.is_left = is_sure ? is_near && mount.errors.angle > 0 : is_near;
        return !told.is_left;
    }
    told.is_left = is_near || !_field.set(_surface, _face_planes, mount, _border, widest);
    told.n_events = _field.n_events();
    return !told.is_left;
}

Tolerated ToleranceCutter::sure(const Mount &mount, const area::Planes &planes,
                                const RegionRows &nominal) {
    Tolerated told;
    if (!begin(mount, true, told)) {
        told.regions.cut_short = {0.0};
        return told;
    }
    const int64_t n_faces = planes.areas.rows();
    Pieces *found = &_cut;
    run(_cut, n_faces, [&](const area::Found &out) { cut_criteria(mount, planes, nominal, out); });
    if (mount.errors.position > 0 && mount.margins.shadow > 0) {
        const area::Found from = _cut.found();
        run(_left, n_faces,
            [&](const area::Found &out) { subtract_shadows(mount, planes, from, out, told); });
        found = &_left;
        found->cut_short = _cut.cut_short;
    }
    // What is left out where nothing decides can only be missing: as of the nominal regions, the
    // bound is what may be too much.
    const area::Found out = found->found();
    found->bound.fill(0.0);
    for (int64_t k = 0; k < nominal.listed.rows(); k++)
        out.bound[nominal.listed[k]] = nominal.bound[k];
    told.regions = copied(out);
    told.regions.excess = told.regions.bound;
    return told;
}

// --- what is possible ---

namespace {
// Part of a line from 0 to 1, in the plane of a face, that is within a polygon or next to it.
exact::Part part_within(const FloatRows<2> &polygon, int64_t n, const double *x, const double *y,
                        double tolerance) {
    exact::Part part = {0.0, 1.0};
    for (int64_t s = 0; s < n && part.first <= part.last; s++) {
        const exact::Line line = exact::side_at(polygon, n, s);
        const double slack = tolerance * area::length2(line.du, line.dv);
        const double a = line.value(x[0], y[0]) + slack, b = line.value(x[1], y[1]) + slack;
        if (a < 0 && b < 0) return {1.0, 0.0};
        if (a < 0) part.first = std::max(part.first, a / (a - b));
        else if (b < 0) part.last = std::min(part.last, a / (a - b));
    }
    return part;
}

exact::Part hull_of(const exact::Part &a, const exact::Part &b) {
    if (b.first > b.last) return a;
    return {std::min(a.first, b.first), std::max(a.last, b.last)};
}

// An edge in the plane of one of its faces.
struct FlatEdge {
    double x[2], y[2];
    FlatEdge(const EventField::Edge &edge, const Plane &plane) {
        for (int i = 0; i < 2; i++) {
            x[i] = dot(edge.hiding.ends[i], plane.x_axis) + plane.foot_x;
            y[i] = dot(edge.hiding.ends[i], plane.y_axis) + plane.foot_y;
        }
    }
};
} // namespace

// Faces of an edge, in the order of the mesh, -1 for none. False if what is seen of them does not
// say what is seen of the edge: it has more than two, or one without area.
bool ToleranceCutter::faces_of(const EventField::Edge &edge, const area::Planes &planes,
                               std::array<int64_t, 2> &found) const {
    const exact::Edges &edges = _surface.edges();
    found = {-1, -1};
    for (int k = 0; k < 2; k++) {
        const int64_t row = edges.faces(edge.index, k);
        found[size_t(k)] = row < 0 ? -1 : _face_planes.mesh_face[size_t(row)];
        if (row >= 0 && !(planes.areas[found[size_t(k)]] > 0)) return false;
    }
    return edges.kind[edge.index] != exact::NON_MANIFOLD;
}

// Adds to the part of an edge what is next to the pieces that are seen of a face.
void ToleranceCutter::add_seen(int64_t f, const EventField::Edge &edge, const Plane &plane,
                               const RegionRows &seen, exact::Part &all) const {
    const FlatEdge flat(edge, plane);
    const double tolerance = TOUCH_REL * _surface.diagonal();
    for (int64_t piece = _first[size_t(f)]; piece < _first[size_t(f) + 1]; piece++) {
        const auto polygon = area::piece_at(piece, seen.starts, seen.xy);
        const auto part = part_within(polygon, polygon.rows(), flat.x, flat.y, tolerance);
        all = hull_of(all, part);
    }
}

// Part of an edge that is along what the nominal camera centre sees of its faces, or may be.
exact::Part ToleranceCutter::seen_part(const EventField::Edge &edge, const area::Planes &planes,
                                       const RegionRows &seen) const {
    std::array<int64_t, 2> faces;
    if (!faces_of(edge, planes, faces)) return {0.0, 1.0};
    exact::Part part = exact::NOWHERE;
    for (const int64_t f : faces) {
        if (f < 0) continue;
        Plane plane;
        area::set_plane(planes, f, _seen, plane);
        add_seen(f, edge, plane, seen, part);
    }
    return part;
}

// Part of an edge that the shadow of another may reach on one of its faces.
exact::Part ToleranceCutter::reached_part(const EventField::Edge &edge,
                                          const EventField::Edge &other, const Mount &mount,
                                          const area::Planes &planes) const {
    std::array<int64_t, 2> faces;
    if (!faces_of(edge, planes, faces)) return {0.0, 1.0};
    const double d = mount.errors.position, tolerance = TOUCH_REL * _surface.diagonal();
    const double deepest = std::max(edge.hiding.ends[0].z, edge.hiding.ends[1].z);
    exact::Part part = exact::NOWHERE;
    for (const int64_t f : faces) {
        if (f < 0) continue;
        Plane plane;
        area::set_plane(planes, f, _seen, plane);
        if (!(std::abs(plane.height) > d)) return {0.0, 1.0};
        const area::ShadowCaster caster(plane, d, deepest, LEAST_HEIGHT_REL * _surface.diagonal(),
                                        mount.disc);
        Cast shadow;
        const area::Shadow kind = caster.cast(other.hiding, shadow.points(), shadow.n);
        if (kind == area::Shadow::UNBOUNDED) return {0.0, 1.0};
        if (kind == area::Shadow::NONE) continue;
        const FlatEdge flat(edge, plane);
        const exact::Bounds box = exact::extent_of(shadow.points(), shadow.n);
        if (std::min(flat.x[0], flat.x[1]) > box.u_max + tolerance ||
            std::max(flat.x[0], flat.x[1]) < box.u_min - tolerance ||
            std::min(flat.y[0], flat.y[1]) > box.v_max + tolerance ||
            std::max(flat.y[0], flat.y[1]) < box.v_min - tolerance)
            continue;
        shadow.n = tidy_hull(shadow.points(), shadow.n, plane.nearest_corners());
        if (shadow.n < 3) continue;
        part = hull_of(part, part_within(shadow.points(), shadow.n, flat.x, flat.y, tolerance));
    }
    return part;
}

// Narrows edges to what some camera centre may see of them: along what the nominal one sees, and
// where shadows of such parts of others reach, again and again.
void ToleranceCutter::narrow_edges(const Mount &mount, const area::Planes &planes,
                                   const RegionRows &seen) {
    const std::vector<EventField::Edge> &whole = _field.edges();
    std::vector<EventField::Edge> edges = whole;
    const double d = mount.errors.position;
    std::vector<exact::Part> parts(whole.size(), exact::NOWHERE);
    std::vector<int8_t> n_times(whole.size(), 0), is_waiting(whole.size(), 0);
    std::vector<size_t> waiting;
    // Grows by a margin; more than a few times, to all of the edge.
    const auto add = [&](size_t k, const exact::Part &more) {
        exact::Part &part = parts[k];
        if (more.first > more.last || (more.first >= part.first && more.last <= part.last)) return;
        part = hull_of(part, {std::max(more.first - PART_MARGIN, 0.0),
                              std::min(more.last + PART_MARGIN, 1.0)});
        if (++n_times[k] > MOST_TIMES) part = {0.0, 1.0};
        edges[k].set_part(whole[k], part);
        if (!is_waiting[k]) waiting.push_back(k);
        is_waiting[k] = 1;
    };
    // Whether what is not yet counted of an edge is farther than a distance from another one.
    const auto is_far = [&](size_t k, const EventField::Edge &other, double distance) {
        const exact::Part &part = parts[k];
        if (distance_of(other, whole[k]) > distance) return true;
        if (part.first > part.last) return false;
        EventField::Edge rest = whole[k];
        for (const exact::Part &each : {exact::Part{0.0, part.first}, {part.last, 1.0}}) {
            if (each.first == each.last) continue;
            rest.set_part(whole[k], each);
            if (!(distance_of(other, rest) > distance)) return false;
        }
        return true;
    };
    for (size_t k = 0; k < whole.size(); k++) add(k, seen_part(whole[k], planes, seen));
    Poll poll(64);
    for (size_t next = 0; next < waiting.size(); next++) {
        poll();
        const size_t at = waiting[next];
        is_waiting[at] = 0;
        const EventField::Edge edge = edges[at];
        const exact::Bounds box = edge.box(edge.grow);
        _field.begin();
        _field.each_in(box, [&](size_t k) {
            const EventField::Edge &other = whole[k];
            if ((parts[k].first <= 0 && parts[k].last >= 1) || exact::are_apart(box, other.box(0)))
                return;
            const double deepest = std::max(other.hiding.ends[0].z, other.hiding.ends[1].z);
            const double reach = edge.reach(deepest, d);
            if (reach > 0 && !is_far(k, edge, reach))
                add(k, reached_part(other, edge, mount, planes));
        });
    }
    size_t n = 0;
    for (size_t k = 0; k < edges.size(); k++)
        if (parts[k].first <= parts[k].last) edges[n++] = edges[k];
    edges.resize(n);
    _field.set(std::move(edges));
}

namespace {
// Lines in the plane of a face of what depth and border may be with some errors, each from its
// offset on, less a slack that grows with the distance.
struct PossibleLines {
    std::array<area::Affine, 6> lines;
    std::array<double, 6> offsets;
    int n = 0;

    PossibleLines(const Mount &mount, const std::array<Vector, 4> &border, const Plane &plane) {
        const double cosine = std::cos(mount.errors.angle);
        const auto add = [&](const Vector &by, double offset) {
            lines[size_t(n)] = area::line_in_plane(by.x, by.y, by.z, plane);
            offsets[size_t(n++)] = offset;
        };
        const DepthRange depths = depths_of(mount, std::abs(plane.height), 1.0);
        add({0, 0, cosine}, depths.least);
        if (depths.most < INFINITY) add({0, 0, -cosine}, -depths.most);
        for (const Vector &normal : border) add(cosine * normal, 0.0);
    }

    // Cuts a polygon; its corner count.
    int64_t cut(const Mount &mount, const Plane &plane, Points polygon, int64_t n_corners) const {
        double reach = 0.0;
        for (int64_t p = 0; p < n_corners; p++) {
            const Vector at =
                plane.origin + polygon(p, U) * plane.x_axis + polygon(p, V) * plane.y_axis;
            reach = std::max(reach, dot(at, at));
        }
        const double slack = slack_of(mount.errors, std::sqrt(reach));
        area::Polygon spare;
        for (int k = 0; k < n && n_corners >= 3; k++) {
            const auto &[value, x, y] = lines[size_t(k)];
            const area::Affine line = {value - (offsets[size_t(k)] - slack), x, y};
            n_corners = exact::cut(polygon, n_corners, area::line_of(line, 1.0), spare.points());
        }
        return n_corners >= 3 ? n_corners : 0;
    }
};

// Cuts a polygon by the octagon around a disc about the foot of the camera centre. Corner count.
int64_t keep_around(const Plane &plane, double radius, Points polygon, int64_t n) {
    static const auto TURNS = area::around<8>(0.0);
    area::Polygon spare;
    for (const auto &[c, s] : TURNS)
        if (n >= 3)
            n = exact::cut(
                polygon, n,
                area::line_of({radius + c * plane.foot_x + s * plane.foot_y, -c, -s}, 1.0),
                spare.points());
    return n >= 3 ? n : 0;
}
} // namespace

// Appends a part of a face to `_overlay`, but for slivers; its area.
double ToleranceCutter::lay(Points polygon, int64_t n) {
    area::Polygon tidy, memory;
    const double nearest = _overlay.nearest;
    n = area::without_needless(polygon, n, nearest, tidy.points());
    if (n < 3) return 0.0;
    const double size = area::twice_area(tidy.points(), n) / 2;
    if (!(size > nearest * area::perimeter_of(tidy.points(), n))) return 0.0;
    for (int64_t first = 1; first + 1 < n;) {
        const int64_t m = exact::corners_of_part(first, n);
        exact::copy_part(tidy.points(), first, m, memory.points());
        _overlay.append(memory.points(), m, 1);
        first += m - 2;
    }
    return size;
}

// Sets `_hidden` to what the nominal camera centre does not see of a convex part of a face.
void ToleranceCutter::hide_seen(int64_t f, const RegionRows &seen, Points whole, int64_t n) {
    const int64_t first = _first[size_t(f)], end = _first[size_t(f) + 1];
    _boxes.clear();
    for (int64_t piece = first; piece < end; piece++) {
        const Corners polygon = area::piece_at(piece, seen.starts, seen.xy);
        _boxes.push_back(exact::extent_of(polygon, polygon.rows()));
    }
    const auto pieces = [&](int32_t k) {
        return Shape{area::piece_at(first + k, seen.starts, seen.xy), _boxes[size_t(k)]};
    };
    _hidden_xy.clear();
    _hidden_starts.assign(1, 0);
    const auto few = [&](Points polygon, int64_t m, std::span<const int32_t> list) {
        const int64_t n_parts = subtract(polygon, m, pieces, list, _overlay.nearest);
        for (int64_t q = 0; q < n_parts; q++) {
            const double *corners = &_own[q](0, U);
            _hidden_xy.insert(_hidden_xy.end(), corners, corners + 2 * _own.n(q));
            _hidden_starts.push_back(int64_t(_hidden_xy.size()) / 2);
        }
    };
    _list.resize(size_t(end - first));
    std::iota(_list.begin(), _list.end(), 0);
    divide(whole, n, 0, 0, pieces, few, [](Points, int64_t) {});
}

// Fills `_overlay` with what shadows reach of what is hidden, all of it where one has no end; the
// area that is left out in slivers.
double ToleranceCutter::lay_shadows(const Mount &mount, Tolerated &told) {
    const int64_t n_hidden = int64_t(_hidden_starts.size()) - 1;
    area::Found hidden = {};
    hidden.xy = {_hidden_xy.data(), {int64_t(_hidden_xy.size()) / 2, 2}};
    hidden.starts = {_hidden_starts.data(), {n_hidden + 1}};
    const double nearest = _overlay.nearest;
    const bool is_bounded = cast_all(mount, 0, n_hidden, hidden, told);
    const auto shadows = [&](int32_t k) { return shape_of(k); };
    double left = 0.0;
    area::Polygon memory, spare, own;
    const Points part = memory.points();
    const auto all = [&](Points polygon, int64_t n) {
        left += area::twice_area(polygon, n) / 2 - lay(polygon, n);
    };
    const auto few = [&](Points polygon, int64_t n, std::span<const int32_t> list) {
        for (size_t at = 0; at < list.size(); at++) {
            const Shape shape = shadows(list[at]);
            const int64_t n_sides = shape.corners.rows();
            area::copy_polygon(polygon, n, part);
            const int64_t m = exact::clip(part, n, exact::Sides<Corners>{shape.corners, n_sides},
                                          n_sides, spare.points());
            if (m < 3) continue;
            const int64_t n_own = subtract(part, m, shadows, list.first(at), nearest);
            for (int64_t q = 0; q < n_own; q++) all(_own[q], _own.n(q));
        }
    };
    for (int64_t q = 0; q < n_hidden; q++) {
        const int64_t at = _hidden_starts[size_t(q)], n = _hidden_starts[size_t(q) + 1] - at;
        area::copy_polygon(Corners{&_hidden_xy[size_t(2 * at)], {n, 2}}, n, own.points());
        if (is_bounded) divide(own.points(), n, 0, 0, shadows, few, all);
        else all(own.points(), n);
    }
    return left;
}

// Fills `_overlay` with the parts of a face that some camera centre sees; false for none.
bool ToleranceCutter::lay_possible(int64_t f, const Mount &mount, const RegionRows &seen,
                                   Points whole, int64_t n, const area::Found &out,
                                   Tolerated &told) {
    const Plane &plane = _scratch.plane;
    _overlay.clear(plane.nearest_corners());
    if (told.is_left || std::abs(plane.height) <= mount.errors.position) {
        out.bound[f] += _overlay.fill(whole, n, 1);
        return _overlay.count() > 0;
    }
    double left = area::twice_area(whole, n) / 2;
    if (mount.errors.position > 0) {
        hide_seen(f, seen, whole, n);
        for (size_t q = 0; q + 1 < _hidden_starts.size(); q++) {
            const int64_t at = _hidden_starts[q];
            const Corners part = {&_hidden_xy[size_t(2 * at)], {_hidden_starts[q + 1] - at, 2}};
            left -= area::twice_area(part, part.rows()) / 2;
        }
        if (_hidden_starts.size() > 1) out.bound[f] += lay_shadows(mount, told);
    }
    // What is seen is beside the rest: no piece of these is held against it.
    area::Polygon memory, spare;
    const Points part = memory.points();
    for (int64_t piece = _first[size_t(f)]; piece < _first[size_t(f) + 1]; piece++) {
        const auto polygon = area::piece_at(piece, seen.starts, seen.xy);
        area::copy_polygon(polygon, polygon.rows(), part);
        const int64_t m =
            exact::clip(part, polygon.rows(), exact::Sides<Points>{whole, n}, n, spare.points());
        if (m >= 3) left -= lay(part, m);
    }
    if (mount.errors.position > 0) out.bound[f] += std::max(left, 0.0);
    return _overlay.count() > 0;
}

// Appends the parts of a face that are covered with some errors.
void ToleranceCutter::add_possible(int64_t f, const Mount &mount, const area::Planes &planes,
                                   const RegionRows &seen, const area::Found &out,
                                   Tolerated &told) {
    Plane &plane = _scratch.plane;
    const double d = mount.errors.position;
    const auto [least, most] = area::set_plane(planes, f, _seen, plane);
    if (most <= -d || (!planes.two_sided[f] && plane.height <= -d)) return;
    area::Polygon memory;
    const Points whole = memory.points();
    area::copy_polygon(planes.corners[f], 3, whole);
    area::Criteria criteria = mount.criteria;
    const double tangent = criteria.rules.tan_incidence;
    const double wanted = criteria.rules.min_pixel_density;
    Plane higher = plane;
    if (tangent > 0)
        higher.height = std::copysign(
            std::abs(plane.height) + d / (tangent * criteria.rules.cos_incidence), plane.height);
    const PossibleLines lines(mount, _border, plane);
    int64_t n = lines.cut(mount, plane, whole, 3);
    if (tangent > 0) n = keep_around(plane, tangent * std::abs(higher.height), whole, n);
    if (n < 3 || !lay_possible(f, mount, seen, whole, n, out, told)) return;
    area::Circle circle(higher, tangent, criteria.gap);
    area::Polygon copy;
    const Points part = copy.points();
    for (int64_t q = 0; q < _overlay.count(); q++) {
        int64_t m = _overlay.n_corners(q);
        if (m < 3) continue;
        area::copy_polygon(_overlay.corners(q), m, part);
        m = lines.cut(mount, plane, part, m); // closer than of the whole face
        if (m < 3) continue;
        if (wanted > 0)
            criteria.rules.min_pixel_density =
                wanted * density_factor(mount, plane, part, m) / (1 + mount.errors.focal);
        append_criteria(f, part, m, circle, criteria, _scratch, out);
    }
}

// Sets `_first` to the first piece of each face.
void ToleranceCutter::index_pieces(const RegionRows &rows, int64_t n_faces) {
    _first.assign(size_t(n_faces) + 1, 0);
    for (int64_t p = 0; p < rows.face.rows(); p++) _first[size_t(rows.face[p]) + 1]++;
    for (size_t f = 1; f < _first.size(); f++) _first[f] += _first[f - 1];
}

// Area that shadows leave of some pieces of the face of `_scratch`, or one if a shadow has no end.
double ToleranceCutter::left_of(const Mount &mount, int64_t first, int64_t last,
                                const area::Found &from, double if_unbounded) {
    Tolerated told;
    if (!cast_all(mount, first, last, from, told)) return if_unbounded;
    const auto shadows = [&](int32_t k) { return shape_of(k); };
    double left = 0.0;
    area::Polygon memory;
    for (int64_t piece = first; piece < last; piece++) {
        const auto corners = area::piece_at(piece, from.starts, from.xy);
        const int64_t n = corners.rows();
        const Points polygon = memory.points();
        area::copy_polygon(corners, n, polygon);
        const auto few = [&](Points part, int64_t m, std::span<const int32_t> list) {
            const int64_t n_parts = subtract(part, m, shadows, list, _overlay.nearest);
            for (int64_t q = 0; q < n_parts; q++) left += area::twice_area(_own[q], _own.n(q)) / 2;
        };
        divide(polygon, n, 0, 0, shadows, few, [](Points, int64_t) {});
    }
    return left;
}

void ToleranceCutter::sweep(const Mount &mount, const area::Planes &planes, const RegionRows &lit,
                            Array<double, Any, 3> areas) {
    _seen = seen_of(mount);
    _field.set_parallel(_surface, _face_planes, mount, _surface.diagonal());
    index_pieces(lit, planes.areas.rows());
    narrow_edges(mount, planes, lit);
    area::Found pieces = {};
    std::vector<double> xy(lit.xy.data, lit.xy.data + 2 * lit.xy.rows());
    std::vector<int64_t> starts(lit.starts.data, lit.starts.data + lit.starts.rows());
    pieces.xy = {xy.data(), {lit.xy.rows(), 2}};
    pieces.starts = {starts.data(), {lit.starts.rows()}};
    Mount within = mount;
    within.disc = {mount.disc.tangent * (1 - MARGIN_REL), true};
    Poll poll(16);
    for (int64_t f = 0; f < planes.areas.rows(); f++) {
        poll();
        if (!planes.is_asked[f] || !(planes.areas[f] > 0)) continue;
        Plane &plane = _scratch.plane;
        area::set_plane(planes, f, _seen, plane);
        const int64_t first = _first[size_t(f)], last = _first[size_t(f) + 1];
        double all = 0.0;
        for (int64_t piece = first; piece < last; piece++) {
            const Corners own = area::piece_at(piece, lit.starts, lit.xy);
            all += area::twice_area(own, own.rows()) / 2;
        }
        _overlay.clear(plane.nearest_corners());
        areas(f, 0) = first < last ? left_of(mount, first, last, pieces, 0.0) : 0.0;
        areas(f, 1) = first < last ? left_of(within, first, last, pieces, all) : 0.0;
        area::Polygon memory;
        area::copy_polygon(planes.corners[f], 3, memory.points());
        hide_seen(f, lit, memory.points(), 3);
        const int64_t n_hidden = int64_t(_hidden_starts.size()) - 1;
        area::Found hidden = {};
        hidden.xy = {_hidden_xy.data(), {int64_t(_hidden_xy.size()) / 2, 2}};
        hidden.starts = {_hidden_starts.data(), {n_hidden + 1}};
        areas(f, 2) =
            planes.areas[f] - (n_hidden > 0 ? left_of(mount, 0, n_hidden, hidden, 0.0) : 0.0);
    }
}

Tolerated ToleranceCutter::possible(const Mount &mount, const area::Planes &planes,
                                    const RegionRows &seen) {
    Tolerated told;
    const int64_t n_faces = planes.areas.rows();
    const bool is_known = begin(mount, false, told);
    index_pieces(seen, n_faces);
    if (is_known && mount.errors.position > 0) narrow_edges(mount, planes, seen);
    run(_cut, n_faces, [&](const area::Found &out) {
        told.n_shadows = told.n_unbounded = 0;
        for (int64_t k = 0; k < seen.listed.rows(); k++)
            if (planes.is_asked[seen.listed[k]]) out.bound[seen.listed[k]] = seen.bound[k];
        Poll poll(16);
        for (int64_t f = 0; f < n_faces; f++) {
            poll();
            if (planes.is_asked[f] && planes.areas[f] > 0)
                add_possible(f, mount, planes, seen, out, told);
            out.bound[f] = std::min(out.bound[f], planes.areas[f]);
        }
    });
    told.regions = copied(_cut.found());
    told.regions.excess = told.regions.bound;
    return told;
}

// --- poses of a rig ---

namespace {
void check(const Tolerance &job) {
    const int64_t n = job.world_from_camera.rows();
    require(have_rows(n, job.errors) && have_rows(n + 1, job.pieces, job.pairs),
            "errors and regions must have a row for each pose");
    const area::Planes &planes = *job.planes;
    const int64_t n_faces = planes.areas.rows();
    require(have_rows(n_faces, planes.origin, planes.x_axis, planes.y_axis, planes.normal,
                      planes.corners, planes.two_sided, planes.is_asked),
            "planes must have one row for each face");
    require_starts(job.starts, job.face.rows(), job.xy.rows(), "starts must rise, within xy");
    require_starts(job.pieces, n, job.face.rows(), "pieces must rise, within face");
    require_starts(job.pairs, n, job.listed.rows(), "pairs must rise, within listed");
    require(job.bound.rows() == job.listed.rows(), "bound must have one row for each pair");
    require_indices(job.face, n_faces, "face must hold faces");
    require_indices(job.listed, n_faces, "listed must hold faces");
    for (int64_t i = 0; i < n; i++)
        require(job.errors(i, 0) >= 0 && job.errors(i, 0) < INFINITY && job.errors(i, 1) >= 0 &&
                    job.errors(i, 1) < 1 && job.errors(i, 2) >= 0 && job.errors(i, 2) < 1,
                "errors must be metres, radians below 1, and a share below 1");
    const Surface &surface = *job.surface;
    require(surface.n_faces() == n_faces, "planes must be of the faces of the surface");
}

// Regions of pose i.
RegionRows rows_of(const Tolerance &job, int64_t i) {
    const auto rows = [i](const auto &array, const auto &ends) {
        return std::remove_cvref_t<decltype(array)>{array.data + ends[i], {ends[i + 1] - ends[i]}};
    };
    return {job.xy,
            {job.starts.data + job.pieces[i], {job.pieces[i + 1] - job.pieces[i] + 1}},
            rows(job.face, job.pieces),
            rows(job.listed, job.pairs),
            rows(job.bound, job.pairs)};
}

// Calls with a cutter and each pose.
template <class Work> void each_pose(const Tolerance &job, int64_t n_threads, const Work &work) {
    const FacePlanes face_planes(*job.surface);
    Idle<ToleranceCutter> idle(n_threads);
    const auto prepare = [&](std::unique_ptr<ToleranceCutter> one) {
        return one ? std::move(one) : std::make_unique<ToleranceCutter>(*job.surface, face_planes);
    };
    Pace pace = INFINITY;
    share(job.world_from_camera.rows(), n_threads, idle, prepare, pace, {}, work);
    idle.close();
}
} // namespace

std::vector<double> sweep_discs(const Tolerance &job, double tangent, int64_t n_threads) {
    check(job);
    const int64_t n = job.world_from_camera.rows(), n_faces = job.planes->areas.rows();
    std::vector<double> areas(size_t(3 * n * n_faces));
    each_pose(job, n_threads, [&](ToleranceCutter &cutter, int64_t i) {
        const Mount mount = {
            pose_of(job.world_from_camera[i]), 0.0, {0, 0, 0}, job.criteria, job.margins,
            {tangent * (1 + MARGIN_REL)}};
        cutter.sweep(mount, *job.planes, rows_of(job, i),
                     {areas.data() + 3 * n_faces * i, {n_faces, 3}});
    });
    return areas;
}

std::vector<Tolerated> tolerate(const Tolerance &job, int64_t n_threads) {
    check(job);
    const Surface &surface = *job.surface;
    const area::Planes &planes = *job.planes;
    std::vector<Tolerated> found(static_cast<size_t>(job.world_from_camera.rows()));
    const auto work = [&](ToleranceCutter &cutter, int64_t i) {
        const Pose pose = pose_of(job.world_from_camera[i]);
        area::Criteria criteria = job.criteria;
        criteria.gap *= surface.diagonal();
        const double margin = MARGIN_REL * surface.diagonal();
        const double d = job.errors(i, 0) > 0 ? job.errors(i, 0) + margin : 0.0;
        const double far =
            farthest_of(surface.bounds(), [&](int axis) { return pose.centre[axis]; });
        const Mount mount = {pose,
                             near_of(job.near, far),
                             {d, job.errors(i, 1), job.errors(i, 2)},
                             criteria,
                             job.margins};
        const RegionRows source = rows_of(job, i);
        found[size_t(i)] = job.is_sure ? cutter.sure(mount, planes, source)
                                       : cutter.possible(mount, planes, source);
    };
    each_pose(job, n_threads, work);
    return found;
}

} // namespace rastercov::engine
