// Polygons that are not convex, cut into triangles that cover them once.
//
// A fan about the first corner folds over where a triangle of it is wound against the polygon, seen
// along Newell's normal. Such a polygon loses one ear after another, a triangle that holds no other
// corner. G. H. Meisters. Polygons have ears. 1975. Corners are whole numbers of a grid in the
// plane of the polygon, so no sign is rounded.
//
// Twins: tests/mesh/test_concave_polygons.py, tests/mesh/test_page_readers.py.
#include "mesh/triangles.hpp"
#include "readers/text.hpp"
#include <array>
#include <numbers>

namespace rastercov::readers {
namespace {
constexpr double FOLD_TOLERANCE_REL = 1e-9;     // of an area that may be wound against its polygon
constexpr double FLATNESS_TOLERANCE_REL = 0.01; // of the size; beyond it other triangles differ
constexpr double WHOLE_TURN = 2 * std::numbers::pi * (1 + 1e-9);
constexpr double GRID = int64_t(1) << 50; // steps of a size
constexpr size_t MOST_CORNERS = 50'000;   // of a polygon that is cut: some seconds
constexpr const char *WORDS[3][2] = {
    {"are not flat", "other triangles would be another surface"},
    {"cross or touch themselves", "their triangles may overlap, correct them in the modeller"},
    {"are concave and have more than 50000 corners",
     "their triangles fold over, cut them in the modeller"}};

Vector over(Vector a, double size) {
    return size > 0.0 ? Vector{a.x / size, a.y / size, a.z / size} : a;
}

struct Corner {
    int64_t x, y;
    bool operator==(const Corner &) const = default;
};
using Corners = std::vector<Corner>;
Wide dot(Corner at, Corner a, Corner b) {
    return Wide(a.x - at.x) * (b.x - at.x) + Wide(a.y - at.y) * (b.y - at.y);
}
// 1 where a, b and c turn left, -1 where they turn right, 0 on a line.
int side(Corner a, Corner b, Corner c) {
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

Meeting meeting_of(const Corners &at) {
    const size_t n = at.size();
    if (n < 3) return ACROSS;
    Meeting most = APART;
    Poll poll(16);
    for (size_t k = 0; k < n; k++) {
        poll();
        for (size_t j = 0; j < k && most < ACROSS; j++) {
            const bool is_next = k - j == 1 || k - j == n - 1;
            most = std::max(most, meeting_of(at[k], at[(k + 1) % n], at[j], at[j + 1], is_next));
        }
    }
    return most;
}

// --- ears ---

class Ears {
  public:
    explicit Ears(const Corners &at) : _at(at), _before(at.size()), _after(at.size()) {
        const size_t n = at.size();
        for (size_t k = 0; k < n; k++) {
            _before[k] = (k + n - 1) % n;
            _after[k] = (k + 1) % n;
            if (turn(k) <= 0) _dents.push_back(k);
        }
    }

    // Corners of the triangles; fewer than all but two of the corners where no ear is left.
    Wholes cut() {
        Wholes found;
        std::vector<int8_t> is_none(_at.size());
        size_t n = _at.size(), at = 0, n_seen = 0;
        Poll poll(16);
        while (n > 3) {
            poll();
            if (!is_none[at] && is_ear(at)) {
                const size_t a = _before[at], c = _after[at];
                add(found, at);
                _after[a] = c;
                _before[c] = a;
                std::erase_if(_dents, [&](size_t k) {
                    return k == at || ((k == a || k == c) && turn(k) > 0);
                });
                is_none[a] = is_none[c] = false;
                n--;
                n_seen = 0;
                at = _after[c]; // not all triangles at one corner
            } else {
                is_none[at] = true;
                at = _after[at];
                if (++n_seen == n) return found;
            }
        }
        if (turn(at) >= 0) add(found, at);
        return found;
    }

  private:
    int turn(size_t k) const { return side(_at[_before[k]], _at[k], _at[_after[k]]); }
    void add(Wholes &found, size_t k) const {
        for (const size_t each : {_before[k], k, _after[k]}) found.push_back(int64_t(each));
    }

    bool is_ear(size_t b) const {
        const size_t a = _before[b], c = _after[b];
        if (turn(b) <= 0) return false;
        const std::array<Corner, 3> ear = {_at[a], _at[b], _at[c]};
        const auto [left, right] = std::minmax({ear[0].x, ear[1].x, ear[2].x});
        return std::none_of(_dents.begin(), _dents.end(), [&](size_t k) {
            const Corner p = _at[k];
            return p.x >= left && p.x <= right && k != a && k != c && blocks(ear, k);
        });
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
            return is_into(_at[_before[k]]) || is_into(_at[_after[k]]);
        }
        return true;
    }

    const Corners &_at;
    std::vector<size_t> _before, _after, _dents; // of what is left
};

// --- fans ---

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
        double angle = 0.0;
        double low = 0.0;
        double high = 0.0;
        for (size_t k = 1; k <= _n; k++) {
            const Vector &own = normals.emplace_back(cross(_points[k], _points[k + 1]));
            _normal = _normal + own;
            total += length(own);
            angle += std::atan2(length(own), dot(_points[k], _points[k + 1]));
            if (length(own) > length(largest)) largest = own;
        }
        const bool has_plane = length(_normal) > FOLD_TOLERANCE_REL * total;
        if (!has_plane) _normal = largest;
        _normal = over(_normal, length(_normal));
        for (const Vector &own : normals)
            is_folded |= dot(own, _normal) < -FOLD_TOLERANCE_REL * length(own);
        // A polygon that does not cross itself is seen within a turn of its first corner.
        const bool is_wound = _n > 2 && angle > WHOLE_TURN && !is_folded;
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
    size_t counts[3] = {}, firsts[3] = {};
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
        const bool is_cut = fan.is_folded && !fan.is_crossing;
        const bool is_long = is_cut && end - f > MOST_CORNERS - 2;
        note(0, fan.is_bent, f);
        note(1, fan.is_crossing || (is_cut && !is_long && fan.cut() != APART), f);
        note(2, is_long, f);
    }
    Strings notes;
    for (size_t kind = 0; kind < 3; kind++)
        if (counts[kind])
            notes.push_back(text(counts[kind], " polygons ", WORDS[kind][0], ", the first is ",
                                 polygon[firsts[kind]], "; ", WORDS[kind][1]));
    return notes;
}
} // namespace rastercov::readers
