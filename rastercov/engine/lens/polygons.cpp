// Areas of polygons of an ideal plane in the image of a lens, many at a time; see polygons.hpp.
//
// Twin: tests/lenses/test_areas.py, by polygons of many corners.
#include "lens/polygons.hpp"

namespace rastercov::lens {

namespace {

// Whether an image is inside that of the lens, beyond one side of it, beyond u = W alone.
struct Where {
    bool is_in, is_out, is_right;
};

// Of an image of n + 1 nodes that leaves the chords between them by the stray at most.
Where where_is(const PlaneRecord &plane, const double *u, const double *v, int64_t n,
               double stray) {
    Rectangle all;
    for (int64_t k = 0; k <= n; k++) all.add(u[k], v[k]);
    const auto [low_u, high_u] = all.x;
    const auto [low_v, high_v] = all.y;
    const double W = plane.width, H = plane.height;
    const bool is_in = low_u > stray && low_v > stray && high_u < W - stray && high_v < H - stray;
    const bool is_beside = high_u < -stray || high_v < -stray || low_v > H + stray;
    const bool is_right = !is_beside && low_u > W + stray;
    return {is_in, is_beside || is_right, is_right};
}

// Integral of clamp(u, 0, W) d clamp(v, 0, H) along a part of an edge whose first node is `at`.
//
// An arc between two nodes leaves its chord by bend L^2 / 8 at most; so most parts are known to be
// inside the image, or beyond one side of it. Beyond u = W the integral is W times the change of
// the clamped v, beyond the other sides it is 0.
Integral part_inside(const PlaneRecord &plane, int64_t part, int64_t at, EdgeScratch &scratch) {
    const double *const u = scratch.u + at, *const v = scratch.v + at;
    const Edge edge = scratch.ends[part];
    const int64_t n = scratch.rules[part];
    const double stray = stray_of(plane, edge) * GAP[n] * GAP[n];
    const auto [is_in, is_out, is_right] = where_is(plane, u, v, n, stray);
    if (is_right) {
        const double H = plane.height;
        return {plane.width * (std::min(std::max(v[n], 0.0), H) - std::min(std::max(v[0], 0.0), H)),
                1};
    }
    if (is_out) return {0.0, 1};
    if (is_in) return {under_edge(n, u, v, 0.0), 1};
    for (int64_t k = 0; k <= n; k++) {
        scratch.U[k] = u[k];
        scratch.V[k] = v[k];
    }
    return clamped_edge(plane, edge, n, stray, scratch);
}

// Parts of edges that are listed in scratch, all their nodes, and the greatest distance by which
// the image of one leaves its chord, px.
struct Listed {
    int64_t parts, nodes;
    double stray;
};

// Lists a part of an edge, and its nodes but the last, behind those that are listed.
void lay_part(const Edge &edge, int64_t n, double stray, Listed &listed, EdgeScratch &scratch) {
    scratch.ends[listed.parts] = edge;
    scratch.rules[listed.parts] = n;
    for (int64_t k = 0; k < n; k++) {
        const auto point = node_of(edge, n, k);
        scratch.x[listed.nodes + k] = point.x;
        scratch.y[listed.nodes + k] = point.y;
    }
    listed.parts++;
    listed.nodes += n;
    listed.stray = std::max(listed.stray, stray);
}

// Puts a point, the end of the last part, behind the nodes that are listed, up to a vector of them.
void lay_end(const Listed &listed, const Point<double> &end, EdgeScratch &scratch) {
    for (int64_t k = listed.nodes; k < listed.nodes + GROUP; k++) {
        scratch.x[k] = end.x;
        scratch.y[k] = end.y;
    }
}

// Integrals along the parts of edges that are listed. `is_all` says that they are a whole polygon.
// If not, they are a piece of its border, and the integral of u dv along it is a summand of both
// areas.
Image sum_parts(const PlaneRecord &plane, const Listed &listed, bool is_all, bool is_whole_asked,
                EdgeScratch &scratch) {
    const auto [parts, nodes, stray] = listed;
    double *const u = scratch.u, *const v = scratch.v;
    lay_end(listed, point_of(scratch.ends[parts - 1], 0.0, 1.0), scratch);
    project_lanes(plane, scratch.x, scratch.y, is_all ? nodes : nodes + 1, u, v);
    if (is_all) {
        u[nodes] = u[0];
        v[nodes] = v[0];
    }
    const Where all = where_is(plane, u, v, nodes, stray);
    double whole = NOT_A_NUMBER;
    if (all.is_in || is_whole_asked || !is_all) {
        whole = 0.0;
        for (int64_t part = 0, at = 0; part < parts; at += scratch.rules[part], part++)
            whole += under_edge(scratch.rules[part], u + at, v + at, is_all ? u[0] : 0.0);
    }
    if (is_all && all.is_in) return {whole, whole, parts};
    if (is_all && all.is_out) return {whole, 0.0, parts};
    double inside = 0.0;
    int64_t pieces = 0;
    for (int64_t part = 0, at = 0; part < parts; at += scratch.rules[part], part++) {
        const Integral own = part_inside(plane, part, at, scratch);
        inside += own.value;
        pieces += own.pieces;
    }
    return {whole, inside, pieces};
}

// True where an edge of a plane with a pole is short for its distance from the pole.
bool is_short(const Edge &edge, double longest, int64_t top) {
    const auto [ax, ay, bx, by, _] = edge;
    const double half = 0.5 * rounded::hypot(bx - ax, by - ay);
    const double distance = 0.5 * rounded::hypot(ax + bx, ay + by);
    return half <= longest * distance || half < 1e-15 || top >= MOST_WAITING - 2;
}

// Edges of a polygon within the valid region: at most three, those outside of it moved to its
// border along the meridians of its axis.
//
// That moves nothing across a point inside, and so the border of a polygon becomes one around its
// valid part and pieces of no area.
struct Within {
    int64_t n;
    Edge edges[3];
};
Within edges_within(const PlaneRecord &plane, const Edge &edge) {
    const Cone cone(plane.params);
    const Ray a = ray_in_plane(plane.frame, edge.ax, edge.ay);
    const Ray b = ray_in_plane(plane.frame, edge.bx, edge.by);
    const double dX = b.X - a.X, dY = b.Y - a.Y, dZ = b.Z - a.Z;
    const double s = cone.sine, c = cone.cosine;
    // s^2 Z^2 - c^2 (X^2 + Y^2) along the edge, which is 0 on the cone and on its mirror image.
    const double first =
        (s * a.Z - c * rounded::hypot(a.X, a.Y)) * (s * a.Z + c * rounded::hypot(a.X, a.Y));
    const double slope = 2 * (s * s * a.Z * dZ - c * c * (a.X * dX + a.Y * dY));
    const double square = s * s * dZ * dZ - c * c * (dX * dX + dY * dY);
    double cuts[4] = {0.0, 1.0, 1.0, 1.0};
    int64_t n = 1;
    const double under = slope * slope - 4 * first * square;
    if (under > 0) {
        const double root = -0.5 * (slope + std::copysign(std::sqrt(under), slope));
        for (const double t : {root / square, first / root})
            if (0 < t && t < 1) cuts[n++] = t;
        if (n == 3 && cuts[1] > cuts[2]) std::swap(cuts[1], cuts[2]);
    }
    cuts[n] = 1.0;
    Within found = {0, {}};
    const auto ray_at = [&](double t) { return Ray{a.X + t * dX, a.Y + t * dY, a.Z + t * dZ}; };
    for (int64_t k = 0; k < n; k++) {
        if (!(cuts[k] < cuts[k + 1])) continue;
        // An edge may touch the cone: of some places the farthest from it decides.
        double away = 0.0;
        for (const double part : {0.25, 0.5, 0.75}) {
            const Ray ray = ray_at(cuts[k] + part * (cuts[k + 1] - cuts[k]));
            const double own = s * ray.Z - c * rounded::hypot(ray.X, ray.Y);
            if (std::abs(own) > std::abs(away)) away = own;
        }
        if (away >= 0) {
            const bool is_all = cuts[k] == 0.0 && cuts[k + 1] == 1.0;
            found.edges[found.n++] = is_all ? edge : part_of_edge(edge, cuts[k], cuts[k + 1]);
            continue;
        }
        const Ray begin = ray_at(cuts[k]), end = ray_at(cuts[k + 1]);
        const double turn = rounded::atan2(begin.Y, begin.X);
        double by = rounded::atan2(end.Y, end.X) - turn;
        by -= 2 * std::numbers::pi * std::round(by / (2 * std::numbers::pi));
        found.edges[found.n++] = {turn, 0.0, turn + by, 0.0, &plane};
    }
    return found;
}

// Rule for an edge of a length, and the number of its parts.
EdgeRule rule_of(const PlaneRecord &plane, const Edge &edge, double length) {
    if (plane.is_graded) return {plane.parts_of, 1};
    if (!edge.border) return nodes_for(0.5 * length, plane.longest, plane.parts_of);
    const double parts = std::ceil(0.5 * length / plane.arc_half);
    return {MOST, parts < double(MOST_EDGE_PARTS) ? std::max(int64_t(parts), int64_t(1))
                                                  : MOST_EDGE_PARTS};
}

} // namespace

Image polygon_image(const PlaneRecord &plane, const Corners &corners, int64_t first, int64_t last,
                    EdgeScratch &scratch, bool is_whole_asked) {
    auto &waiting = scratch.waiting;
    Listed listed = {0, 0, 0.0};
    Image all = {0.0, 0.0, 0};
    bool is_first = true;
    const auto sum_up = [&](bool is_all) {
        const Image own = sum_parts(plane, listed, is_all, is_whole_asked, scratch);
        all = {all.whole + own.whole, all.inside + own.inside, all.rules + own.rules};
    };
    const auto lay = [&](const Edge &edge) {
        const double length = std::sqrt(length2_of(edge));
        if (length == 0.0) return;
        const auto [n, parts] = rule_of(plane, edge, length);
        for (int64_t part = 0, n_laid = 0; part < parts; part++) {
            int64_t top = 1;
            waiting[0][0] = double(part) / double(parts);
            waiting[0][1] = double(part + 1) / double(parts);
            while (top > 0) {
                top--;
                const double s = waiting[top][0], e = waiting[top][1];
                const Edge piece = part_of_edge(edge, s, e);
                if (plane.is_graded && n_laid < MOST_EDGE_PARTS &&
                    !is_short(piece, plane.longest[n], top)) {
                    const double m = 0.5 * (s + e);
                    waiting[top][0] = m;
                    waiting[top][1] = e;
                    waiting[top + 1][0] = s;
                    waiting[top + 1][1] = m;
                    top += 2;
                    continue;
                }
                if (listed.parts == MOST_PARTS || listed.nodes + n > MOST_NODES) {
                    sum_up(false);
                    listed = {0, 0, 0.0};
                    is_first = false;
                }
                const double own = (e - s) * length;
                const double bend = edge.border ? plane.arc_bend : plane.bend;
                lay_part(piece, n, bend * own * own / 8, listed, scratch);
                n_laid++;
            }
        }
    };
    for (int64_t i = first; i < last; i++) {
        const int64_t j = i + 1 < last ? i + 1 : first;
        const Edge edge = {corners(i, 0), corners(i, 1), corners(j, 0), corners(j, 1)};
        if (!plane.has_border()) {
            lay(edge);
            continue;
        }
        const Within within = edges_within(plane, edge);
        for (int64_t k = 0; k < within.n; k++) lay(within.edges[k]);
    }
    if (listed.parts > 0) sum_up(is_first);
    return all;
}

// Corners of polygon i are rows starts[i] ... starts[i + 1] - 1. Without the first of three columns
// of `out` the whole area is not found.
void measure_polygons(const PlaneRecord &plane, Corners corners, IntArray starts,
                      Array<double, Any, Any> out) {
    require_plane(plane);
    const int64_t n = out.rows(), first = out.extent(1) - 2;
    require(first == 0 || first == 1, "out must have two or three columns");
    require(n == 0 || starts.rows() > n, "starts must have one row more than out");
    EdgeScratch scratch;
    for (int64_t i = 0; i < n; i++) {
        require(0 <= starts[i] && starts[i + 1] <= corners.rows(),
                "starts must be rows of corners");
        const Image image =
            polygon_image(plane, corners, starts[i], starts[i + 1], scratch, first > 0);
        out(i, 0) = image.whole;
        out(i, first) = image.inside;
        out(i, first + 1) = double(image.rules);
    }
}

void bulges_by_parts(const PlaneRecord &plane, Int32Array edges, Array<const int32_t, Any, 2> ends,
                     FloatRows<4> places, Column<double> bulge) {
    if (plane.is_graded) return;
    EdgeScratch scratch;
    double *const u = scratch.u, *const v = scratch.v;
    for (const int32_t e : edges) {
        const auto a = places[ends(e, 0)], b = places[ends(e, 1)];
        const Edge edge = {a[X], a[Y], b[X], b[Y]};
        const auto [n, parts] =
            nodes_for(0.5 * std::sqrt(length2_of(edge)), plane.longest, plane.parts_of);
        if (parts > MOST_PARTS || n * parts > MOST_NODES) continue;
        Listed listed = {0, 0, 0.0};
        for (int64_t part = 0; part < parts; part++)
            lay_part(
                part_of_edge(edge, double(part) / double(parts), double(part + 1) / double(parts)),
                n, 0.0, listed, scratch);
        lay_end(listed, {b[X], b[Y]}, scratch);
        project_lanes(plane, scratch.x, scratch.y, listed.nodes + 1, u, v);
        double total = 0.0;
        for (int64_t at = 0; at < listed.nodes; at += n)
            total += under_edge(n, u + at, v + at, a[U]);
        bulge[e] = total - 0.5 * (b[U] - a[U]) * (b[V] - a[V]);
    }
}

} // namespace rastercov::lens
