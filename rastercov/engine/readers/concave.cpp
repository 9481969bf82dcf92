// Polygons that are not convex, cut into triangles that cover them once.
//
// A fan about the first corner folds over where a triangle of it is wound against the polygon, seen
// along Newell's normal. Such a polygon loses one ear after another, a triangle that holds no other
// corner. G. H. Meisters. Polygons have ears. 1975. Corners are whole numbers of a grid in the
// plane of the polygon, so no sign is rounded. A sweep finds edges that meet, and a tree of boxes
// the corners in a triangle, so that n corners cost about n log n.
//
// Twins: tests/mesh/test_concave_polygons.py, tests/mesh/test_page_readers.py.
#include "mesh/triangles.hpp"
#include "readers/text.hpp"
#include "sort.hpp"
#include <array>
#include <bit>
#include <numeric>

namespace rastercov::readers {
namespace {
constexpr double FOLD_TOLERANCE_REL = 1e-9;     // of an area that may be wound against its polygon
constexpr double FLATNESS_TOLERANCE_REL = 0.01; // of the size; beyond it other triangles differ
constexpr double TURN_TOLERANCE = 6e-9;         // radians beyond a whole turn
constexpr double GRID = int64_t(1) << 50;       // steps of a size
constexpr const char *WORDS[2][2] = {
    {"are not flat", "other triangles would be another surface"},
    {"cross or touch themselves", "their triangles may overlap, correct them in the modeller"}};

Vector over(Vector a, double size) {
    return size > 0.0 ? Vector{a.x / size, a.y / size, a.z / size} : a;
}

struct Corner {
    int64_t x, y;
    auto operator<=>(const Corner &) const = default;
};
using Corners = std::vector<Corner>;
Wide dot(Corner at, Corner a, Corner b) {
    return Wide(a.x - at.x) * (b.x - at.x) + Wide(a.y - at.y) * (b.y - at.y);
}
// 1 where a, b and c turn left, -1 where they turn right, 0 on a line.
[[gnu::noinline]] int side(Corner a, Corner b, Corner c) {
    const Wide twice = Wide(b.x - a.x) * (c.y - a.y) - Wide(b.y - a.y) * (c.x - a.x);
    return (twice > 0) - (twice < 0);
}

// --- whether a polygon is simple ---

enum Meeting { APART, AT_CORNERS, ACROSS };

// What edges from a to b and from c to d do; the second may be next to the first.
Meeting meeting_of(Corner a, Corner b, Corner c, Corner d, bool is_next) {
    if (std::max(a.x, b.x) < std::min(c.x, d.x) || std::max(c.x, d.x) < std::min(a.x, b.x) ||
        std::max(a.y, b.y) < std::min(c.y, d.y) || std::max(c.y, d.y) < std::min(a.y, b.y))
        return APART;
    if (a == d && b == c) return AT_CORNERS; // a bridge between rings
    const bool is_a = a == c || a == d;
    if (is_a || b == c || b == d) {
        const Corner at = is_a ? a : b, u = is_a ? b : a, w = at == c ? d : c;
        if (side(at, u, w) == 0 && dot(at, u, w) > 0) return ACROSS;
        return is_next ? APART : AT_CORNERS;
    }
    const bool do_meet = side(a, b, c) * side(a, b, d) <= 0 && side(c, d, a) * side(c, d, b) <= 0;
    return do_meet ? ACROSS : APART;
}

// Edges of a polygon from left to right, and from below where they are upright.
struct Edges {
    const Corners &at;

    Corner end(size_t k) const { return at[k + 1 < at.size() ? k + 1 : 0]; }
    Corner low(size_t k) const { return std::min(at[k], end(k)); }
    Corner high(size_t k) const { return std::max(at[k], end(k)); }
    int side(size_t k, Corner p) const { return readers::side(low(k), high(k), p); }

    // True if one is below another where both are; they are the same if neither is.
    bool operator()(size_t k, size_t j) const {
        const bool is_later = low(k) >= low(j);
        if (!is_later) std::swap(k, j);
        int above = side(j, low(k));
        if (above == 0) above = side(j, high(k));
        return is_later ? above < 0 : above > 0;
    }
    Meeting meeting(size_t k, size_t j) const {
        const size_t apart = k < j ? j - k : k - j;
        return meeting_of(at[k], end(k), at[j], end(j), apart == 1 || apart == at.size() - 1);
    }
};

// Some of n corners in their order, without an end.
struct Ring {
    std::vector<size_t> before, after;

    explicit Ring(size_t n) : before(n), after(n) {
        for (size_t k = 0; k < n; k++) {
            before[k] = (k + n - 1) % n;
            after[k] = (k + 1) % n;
        }
    }
    void erase(size_t k) {
        after[before[k]] = after[k];
        before[after[k]] = before[k];
    }
    void insert(size_t k, size_t next) {
        before[k] = before[next];
        after[k] = next;
        after[before[k]] = before[next] = k;
    }
};

// Edges along a sweep line, from below: a heap by drawn ranks that is a tree by their order.
// R. Seidel, C. R. Aragon. Randomized Search Trees. 1996.
class Sweep {
  public:
    explicit Sweep(const Corners &at)
        : order(at.size() + 1), _edges{at}, _none(at.size()), _up(_none + 1, _none) {
        _below.fill(_up);
        order.before[_none] = _none;
        order.after[_none] = _none;
    }
    size_t none() const { return _none; }

    // The edge, or the one that is there already.
    size_t insert(size_t k) {
        size_t up = _none;
        size_t next = _below[0][_none];
        bool is_above = false;
        while (next != _none) {
            up = next;
            is_above = _edges(up, k);
            if (!is_above && !_edges(k, up)) return up;
            next = _below[is_above][up];
        }
        order.insert(k, is_above ? order.after[up] : up);
        _below[is_above][up] = k;
        _up[k] = up;
        while (_up[k] != _none && rank(k) > rank(_up[k])) lift(k);
        return k;
    }
    void erase(size_t k) {
        for (;;) {
            const size_t low = _below[0][k], high = _below[1][k];
            if (low == high) break; // none
            lift(rank(low) > rank(high) ? low : high);
        }
        _below[_below[1][_up[k]] == k][_up[k]] = _none;
        order.erase(k);
    }

    Ring order; // from below, around none

  private:
    uint32_t rank(size_t k) const { return k == _none ? 0 : uint32_t(k + 1) * 2654435769U; }
    // Exchanges a node and the one above it.
    void lift(size_t k) {
        const size_t up = _up[k], top = _up[up];
        const bool is_high = _below[1][up] == k;
        const size_t moved = _below[!is_high][k];
        _below[is_high][up] = moved;
        _below[!is_high][k] = up;
        _below[top != _none && _below[1][top] == up][top] = k;
        _up[moved] = up;
        _up[up] = k;
        _up[k] = top;
    }

    Edges _edges;
    size_t _none; // also the one above the first
    std::vector<size_t> _up;
    std::array<std::vector<size_t>, 2> _below;
};

// Largest of what two edges do. Each pair is compared that is next to one another along a sweep
// line. M. I. Shamos and D. Hoey. Geometric Intersection Problems. 1976.
Meeting meeting_of(const Corners &at) {
    if (at.size() < 3) return ACROSS;
    const Edges edges = {at};
    Sweep sweep(at);
    const auto &[before, after] = sweep.order;
    std::vector<bool> is_in(at.size());
    std::vector<size_t> events(2 *
                               at.size()); // ends of edges: 2 k the left one of k, then the other
    std::iota(events.begin(), events.end(), size_t(0));
    const auto place = [&](size_t event) {
        return event % 2 ? edges.high(event / 2) : edges.low(event / 2);
    };
    // At a corner edges end before others start.
    sort_range(events.begin(), events.end(), [&](size_t one, size_t other) {
        const auto order = place(one) <=> place(other);
        return order == 0 ? std::pair(!(one % 2), one) < std::pair(!(other % 2), other) : order < 0;
    });
    Meeting most = APART;
    Poll poll(64);
    const auto compare = [&](size_t one, size_t other) {
        if (one != sweep.none() && other != sweep.none())
            most = std::max(most, edges.meeting(one, other));
    };
    for (size_t n = 0; n < events.size(); n++) {
        poll();
        const size_t k = events[n] / 2;
        if (n > 1 && place(events[n]) == place(events[n - 2])) most = std::max(most, AT_CORNERS);
        if (events[n] % 2) {
            if (!is_in[k]) continue; // the same as another edge
            compare(before[k], after[k]);
            sweep.erase(k);
        } else {
            const size_t own = sweep.insert(k);
            is_in[k] = own == k;
            compare(is_in[k] ? before[k] : own, k);
            if (is_in[k]) compare(k, after[k]);
        }
        if (most == ACROSS) return most;
    }
    return most;
}

// --- ears ---

struct Box {
    Corner low = {INT64_MAX, INT64_MAX}, high = {INT64_MIN, INT64_MIN};

    void add(const Box &other) {
        low = {std::min(low.x, other.low.x), std::min(low.y, other.low.y)};
        high = {std::max(high.x, other.high.x), std::max(high.y, other.high.y)};
    }
    // True if it is to the right of a line from a to b.
    bool is_beyond(Corner a, Corner b) const {
        return side(a, b, {b.y >= a.y ? low.x : high.x, b.x >= a.x ? high.y : low.y}) < 0;
    }
};

class Ears {
  public:
    explicit Ears(const Corners &at)
        : _at(at), _left(at.size()), _order(at.size()), _leaves(at.size()),
          _n_leaves(std::bit_ceil(at.size())), _dents(2 * _n_leaves) {
        std::iota(_order.begin(), _order.end(), size_t(0));
        // Along the curve of Morton. T. M. Chan. Closest-Point Problems Simplified on the RAM.
        // 2002.
        sort_range(_order.begin(), _order.end(), [&](size_t j, size_t k) {
            const auto x = uint64_t(at[j].x ^ at[k].x), y = uint64_t(at[j].y ^ at[k].y);
            if (x < y && x < (x ^ y)) return at[j].y < at[k].y;
            return x ? at[j].x < at[k].x : j < k;
        });
        for (size_t leaf = 0; leaf < at.size(); leaf++) {
            const size_t k = _order[leaf];
            _leaves[k] = _n_leaves + leaf;
            if (turn(k) <= 0) _dents[_leaves[k]] = {at[k], at[k]};
        }
        for (size_t node = _n_leaves - 1; node > 0; node--) grow(node);
    }

    // Corners of the triangles; fewer than all but two of the corners where no ear is left.
    Wholes cut() {
        Wholes found;
        Ring todo(_at.size());
        std::vector<bool> is_todo(_at.size(), true);
        size_t at = 0;
        size_t last = 0;
        size_t n_todo = _at.size();
        Poll poll(16);
        for (size_t n = _at.size(); n > 3;) {
            poll();
            if (n_todo == 0) return found;
            const size_t a = _left.before[at], c = _left.after[at];
            const bool is_cut = is_ear(at);
            if (is_cut) {
                add(found, at);
                for (const auto &[k, next] : {std::pair(a, at), {c, todo.after[at]}})
                    if (!is_todo[k]) {
                        todo.insert(k, next);
                        is_todo[k] = true;
                        n_todo++;
                    }
                _left.erase(at);
                for (const size_t k : {a, c})
                    if (turn(k) > 0) drop_dent(k);
                last = _left.after[c]; // not all triangles at one corner
                n--;
            }
            todo.erase(at);
            is_todo[at] = false;
            n_todo--;
            at = todo.after[is_cut ? c : at];
        }
        if (turn(last) >= 0) add(found, last);
        return found;
    }

  private:
    int turn(size_t k) const { return side(_at[_left.before[k]], _at[k], _at[_left.after[k]]); }
    void add(Wholes &found, size_t k) const {
        for (const size_t each : {_left.before[k], k, _left.after[k]})
            found.push_back(int64_t(each));
    }
    void grow(size_t node) {
        _dents[node] = _dents[2 * node];
        _dents[node].add(_dents[2 * node + 1]);
    }
    void drop_dent(size_t k) {
        size_t node = _leaves[k];
        _dents[node] = {};
        while (node /= 2) grow(node);
    }

    bool is_ear(size_t k) const {
        return turn(k) > 0 &&
               !is_blocked({_at[_left.before[k]], _at[k], _at[_left.after[k]]}, k, 1);
    }

    // True if a dent of a node is in the ear at corner b.
    bool is_blocked(const std::array<Corner, 3> &ear, size_t b, size_t node) const {
        const Box &box = _dents[node];
        if (box.low.x > box.high.x) return false;
        for (size_t j = 0; j < 3; j++)
            if (box.is_beyond(ear[j], ear[(j + 1) % 3])) return false;
        if (node < _n_leaves)
            return is_blocked(ear, b, 2 * node) || is_blocked(ear, b, 2 * node + 1);
        const size_t k = _order[node - _n_leaves];
        return k != _left.before[b] && k != _left.after[b] && blocks(ear, k);
    }

    // True where a corner lies in an ear or, at a corner of it, leaves into it.
    bool blocks(const std::array<Corner, 3> &ear, size_t k) const {
        const Corner p = _at[k];
        for (size_t j = 0; j < 3; j++) {
            const Corner next = ear[(j + 1) % 3], last = ear[(j + 2) % 3];
            if (p != ear[j]) {
                if (p != next && side(ear[j], next, p) < 0) return false;
                continue;
            }
            const auto is_into = [&](Corner to) {
                return side(p, next, to) > 0 && side(p, to, last) > 0;
            };
            return is_into(_at[_left.before[k]]) || is_into(_at[_left.after[k]]);
        }
        return true;
    }

    const Corners &_at;
    Ring _left;
    std::vector<size_t> _order, _leaves; // corners of leaves, and leaves of corners
    size_t _n_leaves;
    std::vector<Box> _dents; // a tree over the corners
};

// --- fans ---

// A direction that is turned to the left, by half a turn at most at once.
struct Turned {
    double x = 1.0;
    double y = 0.0;
    bool is_round = false; // a whole turn
    bool is_wound = false; // more than that

    // Turns it by the angle of (c, s).
    void add(double c, double s) {
        const double size = std::sqrt(c * c + s * s);
        if (size == 0.0) return;
        const bool was_low = is_low();
        const double turned = (x * c - y * s) / size;
        y = (x * s + y * c) / size;
        x = turned;
        is_round |= was_low && !is_low();
        is_wound |= is_round && (x < 0.0 || y > TURN_TOLERANCE);
    }
    bool is_low() const { return y < 0.0 || (y == 0.0 && x < 0.0); }
};

// A fan of triangles, in sizes of it from its first corner.
class Fan {
  public:
    bool is_folded = false;
    bool is_crossing = false;
    bool is_bent = false;

    Fan(const double *vertices, int64_t *faces, size_t n) : _faces(faces), _n(n) {
        const auto place = [&](size_t k) {
            const double *const at = vertices + 3 * corner(k);
            return Vector{at[0], at[1], at[2]};
        };
        double size = 0.0;
        for (size_t k = 0; k < n + 2; k++) {
            const auto [x, y, z] = _points.emplace_back(place(k) - place(0));
            size = std::max({size, std::abs(x), std::abs(y), std::abs(z)});
        }
        for (Vector &point : _points) point = over(point, size);
        judge();
    }

    // Cuts it into other triangles; what its edges do.
    Meeting cut() {
        const Vector other = std::abs(_normal.x) < 0.5 ? Vector{1, 0, 0} : Vector{0, 1, 0};
        Vector x_axis = cross(_normal, other);
        x_axis = over(x_axis, length(x_axis));
        const Vector y_axis = cross(_normal, x_axis);
        Corners all, at;
        Wholes row, found;
        for (const Vector &point : _points)
            all.push_back({int64_t(std::nearbyint(GRID * dot(point, x_axis))),
                           int64_t(std::nearbyint(GRID * dot(point, y_axis)))});
        for (size_t k = 0, n = all.size(); k < n; k++)
            if (const size_t before = (k + n - 1) % n; all[k] == all[before]) {
                for (const size_t each : {before, k, (k + 1) % n}) found.push_back(int64_t(each));
            } else {
                at.push_back(all[k]);
                row.push_back(int64_t(k));
            }
        const Meeting meeting = meeting_of(at);
        if (meeting == ACROSS) return meeting;
        for (const int64_t each : Ears(at).cut()) found.push_back(row[size_t(each)]);
        if (found.size() != 3 * _n) return meeting;
        for (int64_t &each : found) each = corner(size_t(each));
        std::copy(found.begin(), found.end(), _faces);
        return meeting;
    }

  private:
    int64_t corner(size_t k) const {
        if (k == 0) return _faces[0];
        return k <= _n ? _faces[3 * k - 2] : _faces[3 * _n - 1];
    }

    void judge() {
        std::vector<Vector> normals;
        Vector largest = {};
        double total = 0.0;
        Turned turned;
        double low = 0.0;
        double high = 0.0;
        for (size_t k = 1; k <= _n; k++) {
            const Vector &own = normals.emplace_back(cross(_points[k], _points[k + 1]));
            _normal = _normal + own;
            total += length(own);
            turned.add(dot(_points[k], _points[k + 1]), length(own));
            if (length(own) > length(largest)) largest = own;
        }
        const bool has_plane = length(_normal) > FOLD_TOLERANCE_REL * total;
        if (!has_plane) _normal = largest;
        _normal = over(_normal, length(_normal));
        for (const Vector &own : normals)
            is_folded |= dot(own, _normal) < -FOLD_TOLERANCE_REL * length(own);
        // A polygon that does not cross itself is seen within a turn of its first corner.
        const bool is_wound = _n > 2 && turned.is_wound && !is_folded;
        is_crossing = (!has_plane && total > 0.0) || is_wound;
        for (const Vector &point : _points) {
            low = std::min(low, dot(point, _normal));
            high = std::max(high, dot(point, _normal));
        }
        is_bent = has_plane && high - low > FLATNESS_TOLERANCE_REL;
    }

    int64_t *_faces;
    size_t _n; // triangles
    std::vector<Vector> _points;
    Vector _normal = {};
};
} // namespace

Strings cut_concave(const double *vertices, int64_t *faces, const int64_t *polygon, size_t n) {
    size_t counts[2] = {}, firsts[2] = {};
    const auto note = [&](size_t kind, bool is_so, size_t f) {
        if (is_so && !counts[kind]++) firsts[kind] = f;
    };
    Poll poll;
    for (size_t f = 0, end = 0; f < n; f = end) {
        poll();
        const auto goes_on = [&](const int64_t *next) {
            return polygon[end] == polygon[f] && next[0] == next[-3] && next[1] == next[-1];
        };
        for (end = f + 1; end < n && goes_on(faces + 3 * end);) end++;
        if (end - f < 2) continue;
        Fan fan(vertices, faces + 3 * f, end - f);
        note(0, fan.is_bent, f);
        note(1, fan.is_crossing || (fan.is_folded && fan.cut() != APART), f);
    }
    Strings notes;
    for (size_t kind = 0; kind < 2; kind++)
        if (counts[kind])
            notes.push_back(text(counts[kind], " polygons ", WORDS[kind][0], ", the first is ",
                                 polygon[firsts[kind]], "; ", WORDS[kind][1]));
    return notes;
}
} // namespace rastercov::readers
