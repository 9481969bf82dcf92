// Event edges of a ball of camera centres, or of a disc of parallel rays.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/events.hpp"

namespace rastercov::engine {

namespace {
// Of the distance of the ball: an edge nearer than this, in view, may be anywhere in the image.
constexpr double LEAST_DEPTH = 1.5;
constexpr int64_t MOST_CELLS = 256; // of a side of the grid

// Leaves the part of an edge that is in the image with some errors; false for none.
bool keep_in_image(const std::array<Vector, 4> &border, const Errors &errors, Vector (&ends)[2]) {
    const double reach = std::max(length(ends[0]), length(ends[1]));
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
} // namespace

template <class Height>
void EventField::set_sides(const FacePlanes &planes, double margin, Height height) {
    _sides.resize(planes.normal.size());
    for (size_t f = 0; f < _sides.size(); f++) {
        const double own = height(f);
        _sides[f] = own > margin ? 1 : own < -margin ? -1 : 0;
    }
}

// Calls with each edge, but for those that all camera centres see, by `_sides`, as one between
// faces that go on; its ends in camera axes. False where a call is.
template <class Each> bool EventField::each_event(const Posed &of, Each each) {
    const exact::Edges &edges = of.surface.edges();
    clear();
    for (int64_t e = 0; e < edges.faces.rows(); e++) {
        const int64_t f = edges.faces(e, 0), g = edges.faces(e, 1);
        const int first = _sides[size_t(f)], second = g >= 0 ? _sides[size_t(g)] : 0;
        if (edges.kind[e] != exact::NON_MANIFOLD && first != 0 && second != 0 &&
            (edges.kind[e] == exact::CONSISTENT) == (first == second))
            continue;
        _n_events++;
        Vector ends[2];
        for (int i = 0; i < 2; i++)
            ends[i] = in_axes(of.surface.vertices()[edges.vertices(e, i)], of.mount.pose);
        if (!each(int32_t(e), ends)) return false;
    }
    list_edges();
    return true;
}

bool EventField::set(const Posed &of, const std::array<Vector, 4> &border, double widest) {
    _widest = widest;
    const double d = of.d(), k = std::sqrt(1 + _widest * _widest);
    const auto &[x, y, z] = of.mount.pose.centre;
    set_sides(of.face_planes, of.mount.margins.event * d,
              [&](size_t f) { return of.face_planes.height(f, {x, y, z}); });
    return each_event(of, [&](int32_t index, Vector(&ends)[2]) {
        const double deepest = std::max(ends[0].z, ends[1].z);
        if (deepest < -d) return true;
        const Vector along = ends[1] - ends[0];
        const double square = dot(along, along);
        const double t = square > 0 ? std::clamp(-dot(ends[0], along) / square, 0.0, 1.0) : 0.0;
        const double zeta = (length(ends[0] + t * along) - d) / k - d;
        if (deepest <= zeta) return true;
        if (!(zeta > LEAST_DEPTH * d)) return false;
        for (int i = 0; i < 2; i++) {
            if (ends[i].z >= zeta) continue;
            const double part = (zeta - ends[i].z) / (ends[1 - i].z - ends[i].z);
            ends[i] = ends[i] + part * (ends[1 - i] - ends[i]);
            ends[i].z = zeta;
        }
        if (!keep_in_image(border, of.mount.errors, ends)) return true;
        Edge edge = {{{ends[0], ends[1]}, zeta}, index, 0.0, std::min(ends[0].z, ends[1].z)};
        edge.project();
        double out = 0.0;
        for (int i = 0; i < 2; i++)
            out = std::max(out, edge.u[i] * edge.u[i] + edge.v[i] * edge.v[i]);
        edge.grow = d * std::sqrt(1 + out) / (edge.nearest - d) * (1 + 1e-9);
        if (!are_apart(edge.box(edge.grow), {-_widest, _widest, -_widest, _widest}))
            _edges.push_back(edge);
        return true;
    });
}

void EventField::set_parallel(const Posed &of, double widest) {
    _widest = widest;
    const Pose &pose = of.mount.pose;
    const double tangent = of.mount.disc.tangent, far = 4 * widest;
    const double sine = tangent / std::sqrt(1 + tangent * tangent); // of the half angle
    const Vector axis = {pose.at(0, 2), pose.at(1, 2), pose.at(2, 2)};
    set_sides(of.face_planes, sine, [&](size_t f) { return -dot(of.face_planes.normal[f], axis); });
    each_event(of, [&](int32_t index, Vector(&ends)[2]) {
        const double nearest = std::min(ends[0].z, ends[1].z);
        _edges.push_back({{{ends[0], ends[1]}, 0.0},
                          index,
                          tangent,
                          nearest,
                          tangent * std::max(far - nearest, 0.0)});
        _edges.back().project();
        return true;
    });
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
    const double u = edge.u[0], v = edge.v[0], du = edge.u[1] - u, dv = edge.v[1] - v;
    for (int64_t row = top; row <= bottom; row++) {
        // Part of the edge within the row and its margin; the outer rows hold all beyond them.
        double first = 0.0;
        double last = 1.0;
        if (dv != 0) {
            const double low = row > 0 ? double(row) * size - _widest - 2 * g : -INFINITY;
            const double high =
                row + 1 < _side ? double(row + 1) * size - _widest + 2 * g : INFINITY;
            const double a = (low - v) / dv, b = (high - v) / dv;
            first = std::clamp(std::min(a, b), 0.0, 1.0);
            last = std::clamp(std::max(a, b), 0.0, 1.0);
        }
        const double from = u + first * du, to = u + last * du;
        const int64_t left = cell_of(std::min(from, to) - g);
        const int64_t right = cell_of(std::max(from, to) + g);
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
    for (int i = 0; i < 2; i++) {
        const auto &[x, y, z] = hiding.ends[i];
        const double depth = tangent > 0 ? 1.0 : z;
        u[i] = x / depth;
        v[i] = y / depth;
    }
}

double EventField::Edge::distance(const Edge &other) const {
    const auto side = [](const Edge &end, int i, const Edge &e) {
        return (e.u[1] - e.u[0]) * (end.v[i] - e.v[0]) - (e.v[1] - e.v[0]) * (end.u[i] - e.u[0]);
    };
    if (side(other, 0, *this) * side(other, 1, *this) < 0 &&
        side(*this, 0, other) * side(*this, 1, other) < 0)
        return 0.0; // they cross
    const auto from_end = [](const Edge &end, int i, const Edge &e) {
        const double dx = e.u[1] - e.u[0], dy = e.v[1] - e.v[0], square = dx * dx + dy * dy;
        const double x = end.u[i] - e.u[0], y = end.v[i] - e.v[0];
        const double t = square > 0 ? std::clamp((x * dx + y * dy) / square, 0.0, 1.0) : 0.0;
        return area::length2(x - t * dx, y - t * dy);
    };
    return std::min({from_end(*this, 0, other), from_end(*this, 1, other),
                     from_end(other, 0, *this), from_end(other, 1, *this)});
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

} // namespace rastercov::engine
