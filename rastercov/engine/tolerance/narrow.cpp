// Parts of event edges that some camera centre may see.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "interrupt.hpp"
#include "tolerance/events.hpp"

namespace rastercov::engine {

namespace {
using exact::NOWHERE;
using Span = exact::Part;
using Edge = EventField::Edge;

constexpr double TOUCH_REL = 1e-8; // of the diagonal: nearer than this an edge touches what is seen
constexpr double PART_MARGIN = 1e-6; // of an edge, on both ends of what is seen of it
constexpr int8_t MOST_TIMES = 16;    // that a part of an edge grows before all of it counts
constexpr Span WHOLE = {0.0, 1.0};

Span hull_of(const Span &a, const Span &b) {
    if (b.is_empty()) return a;
    return {std::min(a.first, b.first), std::max(a.last, b.last)};
}

// An edge in the plane of one of its faces.
struct FlatEdge {
    double x[2], y[2], tolerance;

    // Part of it that is within a polygon or next to it.
    Span within(const Corners &polygon) const {
        Span part = WHOLE;
        for (int64_t s = 0; s < polygon.rows() && !part.is_empty(); s++) {
            const exact::Line line = exact::side_at(polygon, polygon.rows(), s);
            const double slack = tolerance * area::length2(line.du, line.dv);
            part = exact::narrow_to_inside(line.value(x[0], y[0]) + slack,
                                           line.value(x[1], y[1]) + slack, part);
        }
        return part;
    }
    bool misses(const exact::Bounds &box) const {
        return std::min(x[0], x[1]) > box.u_max + tolerance ||
               std::max(x[0], x[1]) < box.u_min - tolerance ||
               std::min(y[0], y[1]) > box.v_max + tolerance ||
               std::max(y[0], y[1]) < box.v_min - tolerance;
    }
};

// Hull of the parts of an edge that `part_on` gives on its faces, of the number and the plane of
// one, in the order of the mesh. All of it if what is seen of them does not say what is seen of it:
// it has more than two, or one without area.
template <class PartOn> Span part_of(const Edge &edge, const Posed &seen, PartOn part_on) {
    const exact::Edges &edges = seen.surface.edges();
    Span part = NOWHERE;
    if (edges.kind[edge.index] == exact::NON_MANIFOLD) return WHOLE;
    for (int k = 0; k < 2; k++) {
        const int64_t row = edges.faces(edge.index, k);
        if (row < 0) continue;
        const int64_t f = seen.face_planes.mesh_face[size_t(row)];
        if (!(seen.planes.areas[f] > 0)) return WHOLE;
        Plane plane;
        seen.set_plane(f, plane);
        FlatEdge flat = {{}, {}, TOUCH_REL * seen.surface.diagonal()};
        for (int i = 0; i < 2; i++) {
            flat.x[i] = dot(edge.hiding.ends[i], plane.x_axis) + plane.foot_x;
            flat.y[i] = dot(edge.hiding.ends[i], plane.y_axis) + plane.foot_y;
        }
        part = hull_of(part, part_on(f, plane, flat));
    }
    return part;
}

// Part of an edge that is along what the nominal camera centre sees of its faces, or may be.
Span seen_part(const Edge &edge, const Posed &seen) {
    return part_of(edge, seen, [&](int64_t f, const Plane &, const FlatEdge &flat) {
        Span part = NOWHERE;
        seen.each_piece(f, [&](const Corners &piece) { part = hull_of(part, flat.within(piece)); });
        return part;
    });
}

// Part of an edge that the shadow of another may reach on one of its faces.
Span reached_part(const Edge &edge, const Edge &other, const Posed &seen) {
    return part_of(edge, seen, [&](int64_t, const Plane &plane, const FlatEdge &flat) {
        if (!(std::abs(plane.height) > seen.d())) return WHOLE;
        area::Polygon memory;
        const Points shadow = memory.points();
        int64_t n = 0;
        const area::Shadow kind =
            seen.caster(plane, seen.d(), edge.deepest()).cast(other.hiding, shadow, n);
        if (kind == area::Shadow::UNBOUNDED) return WHOLE;
        if (kind == area::Shadow::NONE || flat.misses(exact::extent_of(shadow, n))) return NOWHERE;
        n = tidy_hull(shadow, n, plane.nearest_corners());
        return n < 3 ? NOWHERE : flat.within({shadow.data, {n}});
    });
}
} // namespace

void EventField::narrow(const Posed &seen) {
    const std::vector<Edge> &whole = _edges;
    std::vector<Edge> edges = whole;
    std::vector<Span> parts(whole.size(), NOWHERE);
    std::vector<int8_t> n_times(whole.size(), 0), is_waiting(whole.size(), 0);
    std::vector<size_t> waiting;
    // Grows by a margin; more than a few times, to all of the edge.
    const auto add = [&](size_t k, const Span &more) {
        Span &part = parts[k];
        if (more.is_empty() || (more.first >= part.first && more.last <= part.last)) return;
        part = hull_of(part, {std::max(more.first - PART_MARGIN, 0.0),
                              std::min(more.last + PART_MARGIN, 1.0)});
        if (++n_times[k] > MOST_TIMES) part = WHOLE;
        edges[k].set_part(whole[k], part);
        if (!is_waiting[k]) waiting.push_back(k);
        is_waiting[k] = 1;
    };
    // Whether what is not yet counted of an edge is farther than a distance from another one.
    const auto is_far = [&](size_t k, const Edge &other, double distance) {
        const Span &part = parts[k];
        if (other.distance(whole[k]) > distance) return true;
        if (part.is_empty()) return false;
        Edge rest = whole[k];
        for (const Span &each : {Span{0.0, part.first}, {part.last, 1.0}}) {
            if (each.first == each.last) continue;
            rest.set_part(whole[k], each);
            if (!(other.distance(rest) > distance)) return false;
        }
        return true;
    };
    for (size_t k = 0; k < whole.size(); k++) add(k, seen_part(whole[k], seen));
    Poll poll(64);
    for (size_t next = 0; next < waiting.size(); next++) {
        poll();
        const size_t at = waiting[next];
        is_waiting[at] = 0;
        const Edge edge = edges[at];
        const exact::Bounds box = edge.box(edge.grow);
        begin();
        each_in(box, [&](size_t k) {
            const Edge &other = whole[k];
            if ((parts[k].first <= 0 && parts[k].last >= 1) || are_apart(box, other.box(0))) return;
            const double reach = edge.reach(other.deepest(), seen.d());
            if (reach > 0 && !is_far(k, edge, reach)) add(k, reached_part(other, edge, seen));
        });
    }
    size_t n = 0;
    for (size_t k = 0; k < edges.size(); k++)
        if (!parts[k].is_empty()) edges[n++] = edges[k];
    edges.resize(n);
    set(std::move(edges));
}

} // namespace rastercov::engine
