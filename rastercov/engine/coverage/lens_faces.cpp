// Images of faces through a lens; see lens_faces.hpp.
//
// Twins: tests/lenses/test_face_kernels.py.
#include "coverage/lens_faces.hpp"

namespace rastercov::coverage {
namespace {

// Area outside the image, px^2 and relative to the face, up to which a face is inside it.
constexpr double OUTSIDE_TOLERANCE = 1e-9;

template <int64_t n> Array<double, Any, n> view_of(double (&rows)[lens::MOST_CORNERS][n]) {
    return {&rows[0][0], {lens::MOST_CORNERS, n}};
}

lens::Corners region_of(const CurvedLens &lens, int64_t n) {
    return {lens.regions[n].begin(), {lens.region_sides[n], 2}};
}
lens::Corners hole_of(const CurvedLens &lens, int64_t n) {
    return {lens.holes[n].begin(), {lens.hole_sides[n], 2}};
}
lens::PlaneRecord plane_at(const CurvedLens &lens, int64_t n) {
    return {lens.code,
            lens.own_params[n],
            lens.frames[n],
            1.0,
            1.0,
            0.0,
            0.0,
            region_of(lens, n),
            hole_of(lens, n),
            region_of(lens, n),
            lens.longest[n],
            lens.parts_of[n],
            lens.is_graded[n],
            lens.width,
            lens.height,
            lens.bends[n],
            1.0,
            1.0,
            lens.tolerance,
            lens.arc_halves[n],
            lens.arc_bends[n]};
}

// Vertex in the axes of a plane.
Triple<double> rotate_to(const Vertex<double> &vertex, const lens::Frame &frame) {
    return rotate(Triple<double>{vertex[X], vertex[Y], vertex[Z]}, frame);
}

// Fills `polygon` with a face in a plane, in its units; false where some of it is not there. The
// valid vertices of a lens with one plane are in it.
bool lay_in_plane(const Corners<double> &corners, double near, const CurvedLens &lens, int64_t n,
                  exact::Points polygon) {
    double least = INFINITY;
    for (int s = 0; s < 3; s++) {
        const auto [x, y, depth] = rotate_to(corners[s], lens.frames[n]);
        const double z = lens.ahead_at(depth);
        polygon(s, 0) = x / z;
        polygon(s, 1) = y / z;
        least = std::min(least, z);
    }
    if (lens.frames.rows() == 1 || !(least > 0)) return least > 0;
    const bool is_cut = lens.arc_halves[n] > 0 && !lens::Cone(lens.params).is_convex();
    if (least < near || lens.hole_sides[n] > 0 || is_cut) return false;
    return lens::is_in_region(polygon, 3, region_of(lens, n));
}

// Plane that has all of a face whose image stays inside, and its longest edge squared.
struct Plane {
    int64_t n;
    double longest2;
};

// n is -1 where an edge may leave the image, or the face a plane. A line of length L in a plane
// leaves its chord in the image by at most bend L^2 / 8. `polygon` has the face in the plane.
Plane plane_inside(const Corners<double> &corners, double near, const CurvedLens &lens,
                   exact::Points polygon) {
    const auto u = column(corners, U), v = column(corners, V);
    const auto length2 = [&](int64_t p, int64_t q) {
        const double x = polygon(p, 0) - polygon(q, 0), y = polygon(p, 1) - polygon(q, 1);
        return x * x + y * y;
    };
    for (int64_t n = 0; n < lens.frames.rows(); n++) {
        if (!lay_in_plane(corners, near, lens, n, polygon)) continue;
        const double longest2 = std::max({length2(0, 1), length2(1, 2), length2(2, 0)});
        const double stray = lens.bends[n] * longest2 / 8;
        const bool is_inside = min3(u) >= stray && min3(v) >= stray &&
                               max3(u) <= lens.width - stray && max3(v) <= lens.height - stray;
        return {is_inside ? n : -1, longest2};
    }
    return {-1, INFINITY};
}

// Area of the image of a face that is all in plane n, px^2: its triangle and three bulges.
//
// 0 where its longest edge is too long for one rule, on a plane with a pole, and where the image
// has no area.
double area_inside(const Corners<double> &corners, const CurvedLens &lens, const Plane &plane,
                   Memory<CurvedLens> &memory) {
    const lens::PlaneRecord record = plane_at(lens, plane.n);
    const auto [rule, parts] =
        lens::nodes_for(0.5 * std::sqrt(plane.longest2), record.longest, record.parts_of);
    if (parts > 1 || record.is_graded) return 0.0;
    const auto &polygon = memory.polygon;
    lens::EdgeScratch &edges = memory.edges;
    const int64_t inner = rule - 1, nodes = 3 * inner;
    for (int64_t p = 0; p < 3; p++) {
        const int64_t q = p < 2 ? p + 1 : 0;
        const lens::Edge edge = {polygon[p][0], polygon[p][1], polygon[q][0], polygon[q][1]};
        for (int64_t m = 0; m < inner; m++) {
            const auto point = lens::node_of(edge, rule, m + 1);
            edges.x[p * inner + m] = point.x;
            edges.y[p * inner + m] = point.y;
        }
    }
    for (int64_t m = nodes; m < nodes + lens::GROUP; m++) {
        edges.x[m] = edges.x[0];
        edges.y[m] = edges.y[0];
    }
    lens::project_lanes(record, edges.x, edges.y, nodes, edges.u, edges.v);
    const auto [u0, u1, u2] = column(corners, U);
    const auto [v0, v1, v2] = column(corners, V);
    double area = 0.5 * ((u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0));
    for (int64_t s = 0; s < 3; s++) {
        const auto &p = corners[s], &q = corners[s == 2 ? 0 : s + 1];
        edges.U[0] = p[U];
        edges.V[0] = p[V];
        edges.U[rule] = q[U];
        edges.V[rule] = q[V];
        for (int64_t m = 1; m < rule; m++) {
            edges.U[m] = edges.u[s * inner + m - 1];
            edges.V[m] = edges.v[s * inner + m - 1];
        }
        area += lens::bulge(rule, edges.U, edges.V);
    }
    return std::abs(area);
}

// True where all of a face is before the near plane, or beyond one side, in every plane.
bool is_out_of_sight(const Corners<double> &corners, double near, const CurvedLens &lens) {
    for (int64_t n = 0; n < lens.frames.rows(); n++) {
        const auto box = exact::extent_of(lens.regions[n], lens.region_sides[n]);
        bool before = true;
        bool left = true;
        bool right = true;
        bool above = true;
        bool below = true;
        for (int s = 0; s < 3; s++) {
            const auto [x, y, z] = rotate_to(corners[s], lens.frames[n]);
            const double ahead = lens.ahead_at(z);
            before = before && z < near;
            left = left && x < box.u_min * ahead;
            right = right && x > box.u_max * ahead;
            above = above && y < box.v_min * ahead;
            below = below && y > box.v_max * ahead;
        }
        if (!(before || left || right || above || below)) return false;
    }
    return true;
}

} // namespace

Areas curved_areas(const Corners<double> &face, double near, const CurvedLens &lens,
                   Memory<CurvedLens> &memory) {
    Areas sums = {0.0, 0.0};
    const auto corners = view_of(memory.corners), spare_corners = view_of(memory.spare_corners);
    const auto polygon = view_of(memory.polygon), spare = view_of(memory.spare);
    for (int64_t n = 0; n < lens.frames.rows(); n++) {
        for (int s = 0; s < 3; s++) {
            const auto [x, y, z] = rotate_to(face[s], lens.frames[n]);
            corners(s, 0) = x;
            corners(s, 1) = y;
            corners(s, 2) = z;
        }
        int64_t m = exact::cut_in_space(corners, 3, 0.0, 0.0, 1.0, near, spare_corners);
        if (m < 3) continue;
        for (int64_t p = 0; p < m; p++) {
            const double ahead = lens.ahead_at(corners(p, 2));
            polygon(p, 0) = corners(p, 0) / ahead;
            polygon(p, 1) = corners(p, 1) / ahead;
        }
        const lens::PlaneRecord plane = plane_at(lens, n);
        m = lens::cut_to_region(polygon, m, plane.region, spare);
        if (m < 3) continue;
        const auto add = [&](exact::Points piece, int64_t count) {
            const auto [area, part, _] =
                lens::polygon_image(plane, lens::Corners(piece), 0, count, memory.edges, true);
            const double sign = area < 0 ? -1.0 : 1.0;
            sums.whole += sign * area;
            sums.inside += sign * part;
        };
        const int64_t sides = lens.hole_sides[n];
        if (sides == 0) add(polygon, m);
        for (int64_t side = 0; side < sides; side++) { // what is outside the hole
            const int64_t beyond = lens::beyond_side_of(polygon, m, plane.hole, side, spare);
            if (beyond >= 3) add(spare, beyond);
            m = lens::cut_to_side_of(polygon, m, plane.hole, side, spare);
            if (m < 3) break;
        }
    }
    return sums;
}

void finish(const uint64_t *face, double near, const CurvedLens &lens,
            VertexRows<CurvedLens> points) {
    for (int s = 0; s < 3; s++) {
        const auto row = points[int64_t(face[s])];
        if (!std::isnan(row[STATE])) continue;
        const double x = row[X], y = row[Y], z = row[Z];
        double state = BEHIND;
        double u = NAN;
        double v = NAN;
        const double ahead = lens.ahead_at(z);
        if (near_depth(lens, x, y, z) >= near && lens::is_valid(lens.params, x, y, ahead)) {
            const auto pixel = lens::project(lens.code, lens.params, x, y, ahead);
            u = pixel.u;
            v = pixel.v;
            state = is_in_image(lens, u, v) ? INSIDE : AHEAD;
        }
        row[U] = u;
        row[V] = v;
        row[STATE] = state;
        row[SLOPES] = NAN;
    }
}

FieldOfView<double> field_of_view(const Corners<double> &corners, double near,
                                  const CurvedLens &lens, Memory<CurvedLens> &memory,
                                  double known) {
    const double worst = min3(column(corners, STATE));
    if (worst == INSIDE) {
        const Plane plane = plane_inside(corners, near, lens, view_of(memory.polygon));
        if (plane.n >= 0) {
            const double area = known > 0 ? known : area_inside(corners, lens, plane, memory);
            if (area > 0) return {worst, 1.0, area, false};
        }
    }
    if (worst == BEHIND && is_out_of_sight(corners, near, lens)) return {worst, 0.0, 0.0, false};
    const auto [whole, inside] = curved_areas(corners, near, lens, memory);
    if (!(whole > 0)) return {worst, 0.0, 0.0, false};
    if (worst == INSIDE && whole - inside <= OUTSIDE_TOLERANCE * (1.0 + whole))
        return {worst, 1.0, whole, false};
    const double part = std::min(1.0, std::max(0.0, inside / whole));
    return {worst == INSIDE ? AHEAD : worst, part, whole, false};
}

} // namespace rastercov::coverage
