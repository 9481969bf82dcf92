// Figures of faces in an ideal plane of a lens.
//
// The faces of an ideal pinhole are divided into visible pieces. Faces that no other one hides are
// measured by their vertices and edges, several at a time; of the others `collect` lists the
// outlines and pieces in units of the plane, cut to the region of the lens,
// lens_polygons.measure_polygons measures their images, and `add_images` adds them up by face.
//
// An edge that two faces share is integrated once, by the rule that the longest of GROUP edges
// needs.
//
// Invariants: figures of a face depend on its own edges and pieces alone.
//
// Twins: tests/exact/test_lens_measures.py, tests/exact/test_lens_solver.py.
#include "bind.hpp"
#include "exact/passes.hpp"
#include "exact/places.hpp"
#include "exact/polygon.hpp"
#include "lens/polygons.hpp"
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

using lens::Edge, lens::Lanes, lens::PlaneRecord, lens::GROUP, lens::TABLE;

constexpr int64_t WIDTH = AT_A_TIME<Lanes>;
constexpr int64_t VERTICES_AT_A_TIME = 64;
// Sides of a window that a vertex is compared with; a window of more is nearly a disc.
constexpr int64_t MOST_WINDOW_SIDES = 12;

// --- vertices and edges ---

// Square of the radius of the largest disc around 0 in a window.
double inner_radius2(const lens::Corners &window) {
    double radius2 = INFINITY;
    for (int64_t s = 0; s < window.rows(); s++) {
        const Line side = side_at(window, window.rows(), s);
        const double height = side.du * side.v0 - side.dv * side.u0;
        const double size = side.du * side.du + side.dv * side.dv;
        if (size > 0) radius2 = std::min(radius2, height * height / size);
    }
    return radius2;
}

} // namespace

void vertex_images(Vertices uvw, const lens::PlaneRecord &plane, Array<double, Any, 4> places,
                   Column<bool> is_inside) {
    const int64_t n = uvw.rows();
    require(have_rows(n, places, is_inside),
            "places and is_inside must have one row for each vertex");
    const lens::Cone cone(plane.params);
    const bool has_cone = plane.has_border();
    if (plane.hole.rows() > 0 || (has_cone && !cone.is_convex())) {
        std::fill(places.begin(), places.end(), lens::NOT_A_NUMBER);
        std::fill(is_inside.begin(), is_inside.end(), false);
        return;
    }
    const bool is_disc = plane.window.rows() > MOST_WINDOW_SIDES;
    const int64_t n_sides = is_disc ? 0 : plane.window.rows();
    const double radius2 = is_disc ? inner_radius2(plane.window) : INFINITY;
    double x[VERTICES_AT_A_TIME], y[VERTICES_AT_A_TIME], w[VERTICES_AT_A_TIME],
        u[VERTICES_AT_A_TIME], v[VERTICES_AT_A_TIME];
    for (int64_t first = 0; first < n; first += VERTICES_AT_A_TIME) {
        const int64_t m = std::min(VERTICES_AT_A_TIME, n - first);
        const int64_t end = (m + GROUP - 1) / GROUP * GROUP;
        for (int64_t k = 0; k < end; k++) {
            if (k >= m) {
                x[k] = y[k] = w[k] = 0.0;
                continue;
            }
            x[k] = (uvw(first + k, U) - plane.cx) / plane.fx;
            y[k] = (uvw(first + k, V) - plane.cy) / plane.fy;
            w[k] = uvw(first + k, W);
            places(first + k, lens::X) = x[k];
            places(first + k, lens::Y) = y[k];
        }
        int64_t any_inside = 0;
        for (int64_t k = 0; k < end; k += WIDTH) {
            const Lanes px = Lanes::load(x + k), py = Lanes::load(y + k);
            Lanes least = INFINITY;
            for (int64_t s = 0; s < n_sides; s++) {
                const Line side = side_at(plane.window, n_sides, s);
                least = min(side.du * (py - side.v0) - side.dv * (px - side.u0), least);
            }
            if (has_cone) {
                const auto [X, Y, Z] = lens::lanes_in_plane(plane.frame, px, py);
                least = min(Z * cone.sine - sqrt(X * X + Y * Y) * cone.cosine, least);
            }
            const auto is_in =
                (Lanes::load(w + k) > 0.0) & (least >= 0.0) & (px * px + py * py <= Lanes(radius2));
            const int64_t found = bits(is_in);
            for (int64_t lane = 0; lane < std::min(WIDTH, m - k); lane++)
                is_inside[first + k + lane] = found >> lane & 1;
            any_inside |= found;
            select(is_in, px, Lanes(0.0)).store(x + k);
            select(is_in, py, Lanes(0.0)).store(y + k);
        }
        if (any_inside) lens::project_lanes(plane, x, y, m, u, v);
        for (int64_t k = 0; k < m; k++) {
            const bool is_in = is_inside[first + k];
            places(first + k, lens::U) = is_in ? u[k] : lens::NOT_A_NUMBER;
            places(first + k, lens::V) = is_in ? v[k] : lens::NOT_A_NUMBER;
        }
    }
}

namespace {

// Bulges of WIDTH edges, of which all have ends a and b from `lane` on, from the images of their
// n - 1 inner nodes, node by node; see lens::bulge.
INLINE Lanes sum_up(const Places &a, const Places &b, int64_t lane, int64_t n, const double *u,
                    const double *v) {
    const Lanes u0 = Lanes::load(a.u + lane), v0 = Lanes::load(a.v + lane);
    const Lanes du = Lanes::load(b.u + lane) - u0, dv = Lanes::load(b.v + lane) - v0;
    Lanes ku[TABLE], kv[TABLE], total = u0 - u0;
    for (int64_t k = 1; k < n; k++) {
        const int64_t at = (k - 1) * GROUP + lane;
        ku[k] = Lanes::load(u + at) - u0;
        kv[k] = Lanes::load(v + at) - v0;
        total = total + (du * kv[k] - ku[k] * dv) * lens::WEIGHTS[n][n][k];
        for (int64_t j = 1; j < k; j++)
            total = total + (ku[k] * kv[j] - ku[j] * kv[k]) * lens::WEIGHTS[n][k][j];
    }
    return total;
}

// Lays the n - 1 inner nodes of the edges from a to b, node by node.
INLINE void lay_nodes(const Places &a, const Places &b, int64_t n, double *x, double *y) {
    for (int64_t k = 1; k < n; k++)
        for (int64_t lane = 0; lane < GROUP; lane += WIDTH) {
            const double s = lens::NODES[n][n - k], t = lens::NODES[n][k];
            const int64_t at = (k - 1) * GROUP + lane;
            (Lanes::load(a.x + lane) * s + Lanes::load(b.x + lane) * t).store(x + at);
            (Lanes::load(a.y + lane) * s + Lanes::load(b.y + lane) * t).store(y + at);
        }
}

} // namespace

int64_t edge_bulges(const lens::PlaneRecord &plane, Array<const int32_t, Any, 2> ends,
                    FloatRows<4> places, Column<double> bulge, Column<int32_t> longer) {
    require(have_rows(ends.rows(), bulge, longer),
            "bulge and longer must have one row for each edge");
    require_indices(ends, places.rows(), "ends must be rows of places");
    double limits2[TABLE], x[lens::MOST * GROUP], y[lens::MOST * GROUP], u[lens::MOST * GROUP],
        v[lens::MOST * GROUP], found[GROUP];
    for (int64_t k = 0; k < TABLE; k++) limits2[k] = plane.longest[k] * plane.longest[k];
    Places a, b;
    int64_t n_longer = 0;
    for (int64_t first = 0; first < ends.rows(); first += GROUP) {
        // Beyond the last edge it is taken again.
        const int64_t m = std::min(GROUP, ends.rows() - first);
        const auto gather = [&](auto edge_of) __attribute__((always_inline)) {
            gather_places(places, [&](int64_t k) { return ends(edge_of(k), 0); }, a);
            gather_places(places, [&](int64_t k) { return ends(edge_of(k), 1); }, b);
        };
        if (m == GROUP) gather([&](int64_t k) { return first + k; });
        else gather([&](int64_t k) { return first + std::min(k, m - 1); });
        double greatest = 0.0;
        int64_t taken = 0;
        int64_t too_long = 0;
        for (int64_t lane = 0; lane < GROUP; lane += WIDTH) {
            const Lanes ax = Lanes::load(a.x + lane), ay = Lanes::load(a.y + lane),
                        bx = Lanes::load(b.x + lane), by = Lanes::load(b.y + lane),
                        u0 = Lanes::load(a.u + lane), both = u0 + Lanes::load(b.u + lane);
            const Lanes dx = bx - ax, dy = by - ay, quarter2 = (dx * dx + dy * dy) * 0.25;
            const auto has_image = both == both, is_short = quarter2 <= Lanes(limits2[lens::MOST]);
            const auto is_taken = has_image & is_short;
            greatest =
                std::max(greatest, rastercov::greatest(select(is_taken, quarter2, Lanes(0.0))));
            taken |= bits(is_taken) << lane;
            too_long |= bits(has_image & (quarter2 > Lanes(limits2[lens::MOST]))) << lane;
            // A lane that is not taken has a place of the plane, and ends in NaN.
            select(is_taken, ax, Lanes(0.0)).store(a.x + lane);
            select(is_taken, ay, Lanes(0.0)).store(a.y + lane);
            select(is_taken, bx, Lanes(0.0)).store(b.x + lane);
            select(is_taken, by, Lanes(0.0)).store(b.y + lane);
            select(is_taken, u0, Lanes(lens::NOT_A_NUMBER)).store(a.u + lane);
        }
        for (too_long &= (1 << m) - 1; too_long; too_long = without_lowest(too_long))
            longer[n_longer++] = int32_t(first + lowest(too_long));
        if (!taken) {
            std::fill(bulge.data + first, bulge.data + first + m, lens::NOT_A_NUMBER);
            continue;
        }
        // Each rule takes longer edges than the one before, so that too short ones are counted.
        int64_t n = 0;
        for (const double limit2 : limits2) n += greatest > limit2;
        n = std::max(n, lens::FEWEST);
        lay_nodes(a, b, n, x, y);
        lens::project_lanes(plane, x, y, (n - 1) * GROUP, u, v);
        for (int64_t lane = 0; lane < GROUP; lane += WIDTH)
            sum_up(a, b, lane, n, u, v).store((m == GROUP ? &bulge[first] : found) + lane);
        for (int64_t k = 0; m < GROUP && k < m; k++) bulge[first + k] = found[k];
    }
    return n_longer;
}

namespace {

// --- faces ---

// Numbers of a plane by which faces are measured. `one` is the square of the length of the longest
// edge in one part; longer ones have parts of twice `part` at most.
struct FaceRule {
    double width, height, bend, tolerance, rounding, one, part;

    explicit FaceRule(const PlaneRecord &plane)
        : width(plane.width), height(plane.height), bend(plane.bend), tolerance(plane.tolerance),
          rounding(EDGE_ROUNDING * (width + height)), part(plane.longest[plane.parts_of]) {
        const double limit = plane.longest[lens::MOST];
        one = 4 * limit * limit;
    }
};

// Places of a vertex of WIDTH faces.
struct Corner {
    Lanes x, y, u, v;
};

struct Measured {
    Lanes area, error;
    int64_t is_done; // a bit for each face
};

// Areas of WIDTH faces, px^2, their bounds, and whether they need no more; 0 where unknown.
INLINE Measured measured_faces(const Corner (&corner)[3], const Lanes (&bulge)[3],
                               const Mask<Lanes> &left_out, const FaceRule &rule) {
    const auto &[a, b, c] = corner;
    Lanes total = bulge[0] + bulge[1] + bulge[2];
    const auto length2 = [](const Corner &p, const Corner &q) __attribute__((always_inline)) {
        return (q.x - p.x) * (q.x - p.x) + (q.y - p.y) * (q.y - p.y);
    };
    const Lanes longest2 = max(max(length2(a, b), length2(b, c)), length2(c, a));
    const Lanes low_u = min(min(a.u, b.u), c.u), high_u = max(max(a.u, b.u), c.u);
    const Lanes low_v = min(min(a.v, b.v), c.v), high_v = max(max(a.v, b.v), c.v);
    const Lanes stray = longest2 * rule.bend / 8.0;
    const auto is_out = (high_u < -stray) | (high_v < -stray) | (low_u > stray + rule.width) |
                        (low_v > stray + rule.height);
    const auto is_in = (low_u > stray) & (low_v > stray) & (high_u < -stray + rule.width) &
                       (high_v < -stray + rule.height);
    total = total + ((b.u - a.u) * (c.v - a.v) - (c.u - a.u) * (b.v - a.v)) * 0.5;
    // NaN for a vertex outside the window, or an edge without a bulge.
    const Lanes any = a.u + b.u + c.u;
    const auto is_seen = (any == any) & !left_out;
    const auto is_measured = is_seen & is_in & !is_out & (total == total);
    const Lanes twice = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y), none = 0.0;
    // No side is longer than the box, and a bulge, is wide and high.
    const Lanes around = ((high_u - low_u) + (high_v - low_v)) * 2.0 + stray * 6.0;
    Lanes parts = 1.0;
    const auto is_long = longest2 > Lanes(rule.one);
    if (bits(is_long)) {
        double each[WIDTH];
        (sqrt(longest2) * 0.5 / rule.part).store(each);
        for (double &part : each) part = -std::floor(-part);
        parts = select(is_long, Lanes::load(each), parts);
    }
    const Lanes error = parts * 3.0 * rule.tolerance + around * rule.rounding;
    return {select(is_measured, select(twice > none, total, none - total), none),
            select(is_measured, error, none), bits(left_out | (is_seen & is_out) | is_measured)};
}

} // namespace

void measure_simple(const Projected &projected, Array<const int32_t, Any, 3> sides,
                    FloatRows<4> places, FloatArray bulge, const PlaneRecord &plane,
                    Column<double> own, Column<bool> is_done, const PlaneSums &out) {
    const auto faces = projected.faces;
    const auto state = projected.state;
    const int64_t n_opaque = sides.rows(), n_faces = state.rows();
    const FaceRule rule(plane);
    const auto &area = out.area, &area_error = out.area_error;
    Places place[3];
    const auto measure_group = [&](auto face_of, int64_t first,
                                   int64_t m) __attribute__((always_inline)) {
        gather_places(places, [&](int64_t k) { return faces(face_of(k), 0); }, place[0]);
        gather_places(places, [&](int64_t k) { return faces(face_of(k), 1); }, place[1]);
        gather_places(places, [&](int64_t k) { return faces(face_of(k), 2); }, place[2]);
        double values[GROUP], errors[GROUP];
        int64_t done = 0;
        for (int64_t lane = 0; lane < GROUP; lane += WIDTH) {
            const auto corner_of = [&](int p) __attribute__((always_inline)) {
                const auto &[x, y, u, v] = place[p];
                return Corner{Lanes::load(x + lane), Lanes::load(y + lane), Lanes::load(u + lane),
                              Lanes::load(v + lane)};
            };
            const auto bulge_of = [&](int p) __attribute__((always_inline)) {
                return lanes_of<Lanes>([&](int64_t k) __attribute__((always_inline)) {
                    const int32_t e = sides(face_of(lane + k), p);
                    return e < 0 ? 0.0 - bulge[~e] : bulge[e];
                });
            };
            const auto left_out =
                lanes_of<Whole<Lanes>>([&](int64_t k) __attribute__((always_inline)) {
                    return int64_t((state[face_of(lane + k)] & (THIN | EDGE_ON)) != 0);
                }) > Whole<Lanes>(0);
            const Measured found =
                measured_faces({corner_of(0), corner_of(1), corner_of(2)},
                               {bulge_of(0), bulge_of(1), bulge_of(2)}, left_out, rule);
            found.area.store(values + lane);
            found.error.store(errors + lane);
            done |= found.is_done << lane;
        }
        for (int64_t k = 0; k < m; k++) {
            own[first + k] = values[k];
            is_done[first + k] = done >> k & 1;
            area[first + k] += values[k];
            area_error[first + k] += errors[k];
        }
    };
    int64_t last = 0;
    for (; last + GROUP <= n_opaque; last += GROUP)
        measure_group([&](int64_t k) { return last + k; }, last, GROUP);
    if (last < n_opaque) // beyond the last face it is taken again
        measure_group([&](int64_t k) { return std::min(last + k, n_opaque - 1); }, last,
                      n_opaque - last);
    for (int64_t f = n_opaque; f < n_faces; f++) {
        own[f] = 0.0;
        is_done[f] = (state[f] & (THIN | EDGE_ON)) != 0;
    }
}

namespace {

// --- outlines and pieces ---

// Scratch for one polygon, in a plane and in space.
struct PolygonScratch {
    double polygon[2 * lens::MOST_CORNERS], spare[2 * lens::MOST_CORNERS],
        points[3 * lens::MOST_CORNERS], spare_points[3 * lens::MOST_CORNERS];
};

// Appends the parts of a convex polygon in the window and outside the hole of a plane.
void append_cut(Points polygon, int64_t n, int64_t face, const PlaneRecord &plane, Points spare,
                const VisiblePieces &found) {
    if (!lens::is_in_region(polygon, n, plane.window))
        n = lens::cut_to_region(polygon, n, plane.window, spare);
    if (n < 3) return;
    // Nothing in the hole is ever put through the lens, which may have a pole or fold there: the
    // rest is listed side by side, what is beyond the first side, then beyond the second, ...
    if (plane.hole.rows() == 0) return store_piece(face, polygon, n, found);
    for (int64_t i = 0; i < plane.hole.rows(); i++) {
        const int64_t m = lens::beyond_side_of(polygon, n, plane.hole, i, spare);
        if (m >= 3) store_piece(face, spare, m, found);
        n = lens::cut_to_side_of(polygon, n, plane.hole, i, spare);
        if (n < 3) return;
    }
}

// Fills `polygon` with the part of a face beyond the near plane and in a region of the plane, in
// units of the plane, counter-clockwise in (x, y). Returns the corner count, 0 for none.
int64_t outline_in_space(Vertices vertices, Array<const int32_t, 3> face, const Pinhole &camera,
                         const lens::Corners &region, double unit, Array<double, Any, 3> points,
                         Array<double, Any, 3> spare, Points polygon) {
    for (int p = 0; p < 3; p++) {
        const auto vertex = vertices[face[p]];
        const double x = vertex[0] - camera.centre[0], y = vertex[1] - camera.centre[1],
                     z = vertex[2] - camera.centre[2];
        for (int k = 0; k < 3; k++)
            points(p, k) =
                x * camera.rotation(0, k) + y * camera.rotation(1, k) + z * camera.rotation(2, k);
    }
    if (std::max(std::max(points(0, 2), points(1, 2)), points(2, 2)) < camera.near) return 0;
    // On which side of the plane of the face the camera is decides the direction of its image.
    const double ax = points(0, 0), ay = points(0, 1), az = points(0, 2);
    const double bx = points(1, 0) - ax, by = points(1, 1) - ay, bz = points(1, 2) - az;
    const double cx = points(2, 0) - ax, cy = points(2, 1) - ay, cz = points(2, 2) - az;
    const double nz = bx * cy - by * cx;
    const double height =
        camera.is_parallel() ? nz : (by * cz - bz * cy) * ax + (bz * cx - bx * cz) * ay + nz * az;
    int64_t n = cut_in_space(points, 3, 0.0, 0.0, 1.0, camera.near, spare);
    if (camera.is_parallel()) // (x, y, unit), which the region sees as it is
        for (int64_t p = 0; p < n; p++) points(p, 2) = unit;
    for (int64_t i = 0; i < region.rows(); i++) {
        if (n < 3) return 0;
        const auto [x0, y0, dx, dy, _] = side_at(region, region.rows(), i);
        n = cut_in_space(points, n, -dy, dx, dy * x0 - dx * y0, 0.0, spare);
    }
    if (n < 3) return 0;
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = height > 0 ? p : n - 1 - p;
        polygon(p, 0) = points(q, 0) / points(q, 2);
        polygon(p, 1) = points(q, 1) / points(q, 2);
    }
    return n;
}

// Fills `polygon` with corners in the image of the pinhole of a plane, in its units.
template <class Source>
void to_plane(const Source &corners, int64_t n, bool is_reversed, const PlaneRecord &plane,
              Points polygon) {
    for (int64_t p = 0; p < n; p++) {
        const int64_t q = is_reversed ? n - 1 - p : p;
        polygon(p, 0) = (corners(q, U) - plane.cx) / plane.fx;
        polygon(p, 1) = (corners(q, V) - plane.cy) / plane.fy;
    }
}

} // namespace

int64_t collect(Vertices vertices, BoolArray is_done, const Projected &projected,
                const VisiblePieces &kept, const Pinhole &camera, const PlaneRecord &plane,
                const VisiblePieces &found) {
    const int64_t n_faces = projected.state.rows();
    PolygonScratch scratch;
    const Points polygon = {scratch.polygon, {lens::MOST_CORNERS, 2}},
                 spare = {scratch.spare, {lens::MOST_CORNERS, 2}};
    const Array<double, Any, 3> points = {scratch.points, {lens::MOST_CORNERS, 3}},
                                spare_points = {scratch.spare_points, {lens::MOST_CORNERS, 3}};
    std::fill(found.used.begin(), found.used.end(), 0);
    for (int64_t f = 0; f < n_faces; f++) {
        if (is_done[f]) continue;
        int64_t n = 3;
        if (!(projected.state[f] & LIVE)) {
            // Seen from behind and left out; others have nothing in the image of the pinhole.
            if (!(projected.area[f] > 0.0)) continue;
            n = outline_in_space(vertices, projected.faces[f], camera, plane.window,
                                 plane.fx / camera.fx, points, spare_points, polygon);
            if (n >= 3) append_cut(polygon, n, f, plane, spare, found);
            continue;
        }
        if (projected.state[f] & CLIPPED) {
            const int64_t s = projected.clipped_index[f];
            n = projected.clipped.n_corners[s];
            copy_polygon(projected.clipped.polygons[s], n, spare);
        } else {
            for (int p = 0; p < 3; p++) {
                spare(p, U) = projected.uvw(projected.faces(f, p), U);
                spare(p, V) = projected.uvw(projected.faces(f, p), V);
            }
        }
        if (n < 3) continue;
        to_plane(spare, n, twice_area(spare, n) < 0, plane, polygon);
        append_cut(polygon, n, f, plane, spare, found);
    }
    const int64_t n_outlines = found.used[0];
    for (int64_t i = 0; i < kept.used[0]; i++) {
        const int64_t start = kept.starts[i], n = kept.starts[i + 1] - start;
        to_plane(from(kept.corners, start), n, false, plane, polygon);
        append_cut(polygon, n, kept.faces[i], plane, spare, found);
    }
    return n_outlines;
}

void add_images(const VisiblePieces &found, int64_t n_outlines, FloatRows<2> images,
                const PlaneRecord &plane, Column<double> own, const PlaneSums &out) {
    const double rounding = EDGE_ROUNDING * (plane.width + plane.height) * plane.speed;
    for (int64_t i = 0; i < found.used[0]; i++) {
        const int64_t f = found.faces[i], first = found.starts[i];
        const double inside = images(i, 0);
        // Twice its box is as good as the length of an outline.
        const Bounds b = extent_of(from(found.corners, first), found.starts[i + 1] - first);
        const double length = 2 * ((b.u_max - b.u_min) * plane.fx + (b.v_max - b.v_min) * plane.fy);
        out.area_error[f] += images(i, 1) * plane.tolerance + rounding * length;
        if (i < n_outlines) {
            own[f] += inside;
            out.area[f] += inside;
        } else {
            out.visible[f] += inside;
        }
    }
}

void add_figures(Column<const uint16_t> state, const VisiblePieces &kept, FloatArray visible,
                 FloatArray area_error, BoolArray is_certified, double stretch, Column<double> own,
                 const PlaneSums &out) {
    // A face with pieces is partly visible; one without is wholly visible or wholly hidden.
    for (int64_t i = 0; i < kept.used[0]; i++) own[kept.faces[i]] = -1.0;
    for (int64_t f = 0; f < state.rows(); f++) {
        if (!(state[f] & (LIVE | THIN))) continue;
        if (own[f] > 0.0 && visible[f] > 0.0) out.visible[f] += own[f];
        if (is_certified[f]) {
            out.n_certified[f]++;
            if (visible[f] > 0.0) out.n_visible[f]++;
        } else {
            out.n_computed[f]++;
            out.area_error[f] += stretch * area_error[f];
        }
    }
}

// A face is certified if all planes that show it certify it, with one answer.
void settle(const PlaneSums &figures, double largest, Column<bool> is_certified) {
    for (int64_t f = 0; f < is_certified.rows(); f++) {
        const int8_t n = figures.n_certified[f], n_visible = figures.n_visible[f];
        const bool is_one = (n_visible == 0) | (n_visible == n);
        is_certified[f] = (n > 0) & (figures.n_computed[f] == 0) & is_one;
        const bool is_visible = is_certified[f] & (n_visible > 0);
        // Sums of signed parts may round to less than nothing.
        figures.area[f] = std::max(figures.area[f], 0.0);
        figures.visible[f] = is_visible ? figures.area[f] : std::max(figures.visible[f], 0.0);
        figures.area_error[f] = std::min(figures.area_error[f], largest);
    }
}

bool are_beyond(Vertices points, Array<const double, 3> eye, Array<const double, 5, 3> sides,
                double margin) {
    int met = 0;
    double far = 0.0;
    for (int64_t i = 0; i < points.rows(); i++) {
        const double a = points(i, 0) - eye[0], b = points(i, 1) - eye[1],
                     c = points(i, 2) - eye[2];
        far = std::max(std::max(std::max(far, std::abs(a)), std::abs(b)), std::abs(c));
        for (int s = 0; s < 5; s++)
            if (a * sides(s, 0) + b * sides(s, 1) + c * sides(s, 2) >= -margin * far) met |= 1 << s;
        if (met == 31) return false;
    }
    return true;
}

} // namespace exact
} // namespace rastercov
