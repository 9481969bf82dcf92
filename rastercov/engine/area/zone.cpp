// Dead zones: pieces are the leaves of a forest of parents. Candidates come from sweeps over sorted
// intervals: pieces of a face along one direction of its plane, sides of pieces along the edge of
// the mesh that they lie on, and sides on open edges along one direction in space. No direction is
// that of an axis, along which built surfaces have many sides at one coordinate.
//
// Corners of piece i are rows starts[i] ... starts[i + 1] - 1 of `xy`.
//
// Twin: tests/area/test_zones.py, by GEOS and by numpy.
#include "area/zone.hpp"
#include "bind.hpp"
#include "exact/forest.hpp"
#include "interrupt.hpp"
#include "range.hpp"
#include "sort.hpp"
#include "vector.hpp"
#include <cmath>
#include <tuple>

namespace rastercov {
namespace area {
namespace {

using exact::join, exact::root_of;
using Forest = Column<int64_t>;
using Vector = Coordinates;

// Distance of two sides in one plane that are one, relative to the scale: a hundred times the
// distance of corners that the union merges.
constexpr double TOLERANCE_REL = 1e-10;
// Length of contact from which pieces are connected, relative to the same: a hundred times the
// tolerance, so that lines that cross at more than 0.01 rad are not one.
constexpr double LEAST_REL = 1e-8;
// Distance of open edges that are one: files in float32 have vertices that far from the edge on
// which they lie.
constexpr double OPEN_TOLERANCE_REL = 1e-6;
// Cosine of the angle between the normals of faces at an edge up to which a zone crosses it.
constexpr double CREASE_COSINE = 0.86602540378443865;
// Faces that meet at a line up to which each is compared with all others; more are apart.
constexpr int64_t MOST_AT_A_LINE = 16;
// Direction of the sweep in space; the first two, in a plane.
constexpr Vector SWEEP = {0.4794, 0.6367, 0.6040};

Vector row_of(const FloatRows<3> &rows, int64_t i) { return {rows(i, 0), rows(i, 1), rows(i, 2)}; }

// A leaf of a sweep: those of one line, kind and class are compared, in the order of their starts.
struct Key {
    int64_t line, kind, of_class;
    double start, end;
    int64_t row;

    bool is_with(const Key &other) const {
        return line == other.line && kind == other.kind && of_class == other.of_class;
    }
};
using Keys = std::vector<Key>;

void sort_keys(Keys &keys) {
    sort_range(keys.begin(), keys.end(), [](const Key &a, const Key &b) {
        return std::tie(a.line, a.kind, a.of_class, a.start, a.row) <
               std::tie(b.line, b.kind, b.of_class, b.start, b.row);
    });
}

// Sorts keys, and visits each pair of them that are alike and come within `reach` of each other.
template <class Visit> void each_overlap(Keys &keys, double reach, Visit visit) {
    sort_keys(keys);
    Poll poll(64);
    for (size_t a = 0; a < keys.size(); a++)
        for (size_t b = (poll(), a + 1); b < keys.size(); b++) {
            if (!keys[b].is_with(keys[a]) || keys[b].start > keys[a].end + reach) break;
            visit(keys[a], keys[b]);
        }
}

// Trees of n leaves.
struct Trees {
    std::vector<int64_t> memory;
    explicit Trees(int64_t n) : memory(size_t(n)) {
        for (int64_t i = 0; i < n; i++) memory[size_t(i)] = i;
    }
    Forest parents() { return {memory.data(), {int64_t(memory.size())}}; }
};

// A side of a piece on an edge of the mesh.
struct Side {
    int64_t edge, kind, piece, face; // edge: of its lower and higher vertex
    Vector from, to, inward;         // unit vector in the plane of the face, into it
    double start, end;               // along the edge
};

// Length along which the side p q of one polygon and r s of another run within a tolerance. The
// sides are of two polygons that turn the same way, so that a common side has opposite directions.
double side_overlap(const FloatRows<2> &xy, int64_t p, int64_t q, int64_t r, int64_t s,
                    double tolerance) {
    double x = xy(q, 0) - xy(p, 0), y = xy(q, 1) - xy(p, 1);
    const double length = std::sqrt(x * x + y * y);
    if (!(length > 0)) return 0.0;
    x /= length;
    y /= length;
    const double a = xy(r, 0) - xy(p, 0), b = xy(r, 1) - xy(p, 1);
    const double c = xy(s, 0) - xy(p, 0), d = xy(s, 1) - xy(p, 1);
    const double start = a * x + b * y, end = c * x + d * y;
    if (!(end < start)) return 0.0;
    const double off = b * x - a * y, off_end = d * x - c * y;
    // Part of r s whose distance from the line is within the tolerance, from 0 to 1.
    double first = 0.0;
    double last = 1.0;
    const double slope = off_end - off;
    if (std::abs(slope) > 0) {
        const double one = (-tolerance - off) / slope, other = (tolerance - off) / slope;
        first = std::max(first, std::min(one, other));
        last = std::min(last, std::max(one, other));
    } else if (std::abs(off) > tolerance) {
        return 0.0;
    }
    if (last <= first) return 0.0;
    const double high = start + first * (end - start), low = start + last * (end - start);
    return std::min(high, length) - std::max(low, 0.0);
}

// Length along which two sides run within a tolerance in space.
double overlap_in_space(const Side &one, const Side &other, double tolerance) {
    Vector axis = minus(one.to, one.from);
    const double length = std::sqrt(dot(axis, axis));
    if (!(length > 0)) return 0.0;
    for (double &each : axis) each /= length;
    Range all;
    for (const Vector &end : {other.from, other.to}) {
        Vector away = minus(end, one.from);
        const double along = dot(away, axis);
        for (size_t k = 0; k < 3; k++) away[k] -= along * axis[k];
        if (dot(away, away) > tolerance * tolerance) return 0.0;
        all.add(along);
    }
    return std::min(all.most, length) - std::max(all.least, 0.0);
}

// Sets the class of each side, in keys by line, kind and face, to that of the first face that joins
// its own smoothly there, by the first side of each.
void set_smooth(Keys &keys, const std::vector<Side> &sides) {
    sort_keys(keys);
    std::vector<size_t> first; // keys of the faces at a line
    for (size_t at = 0, end = 0; at < keys.size(); at = end) {
        first.clear();
        for (; end < keys.size() && keys[end].line == keys[at].line &&
               keys[end].kind == keys[at].kind;
             end++)
            if (end == at || keys[end].of_class != keys[end - 1].of_class) first.push_back(end);
        const auto n = int64_t(first.size());
        Trees trees(n);
        const auto inward = [&](int64_t i) -> const Vector & {
            return sides[size_t(keys[first[size_t(i)]].row)].inward;
        };
        for (int64_t a = 0; n <= MOST_AT_A_LINE && a < n; a++)
            for (int64_t b = a + 1; b < n; b++)
                if (dot(inward(a), inward(b)) <= -CREASE_COSINE) join(a, b, trees.parents());
        for (int64_t i = 0; i < n; i++) {
            const size_t last = i + 1 < n ? first[size_t(i + 1)] : end;
            for (size_t k = first[size_t(i)]; k < last; k++)
                keys[k].of_class = root_of(trees.parents(), i);
        }
    }
}

class Linker {
  public:
    Linker(const ZoneSurface &surface, const PieceTable &pieces, Column<const uint32_t> reason)
        : _surface(surface), _pieces(pieces), _reason(reason), _trees(pieces.face.rows()),
          _tolerance(TOLERANCE_REL * surface.scale), _least(LEAST_REL * surface.scale) {}

    // The tree of each piece.
    Forest linked() {
        link_in_faces();
        find_sides();
        const std::vector<Side> open = link_along_edges();
        if (!open.empty()) link_in_space(open);
        return _trees.parents();
    }

  private:
    int64_t next(int64_t piece, int64_t corner) const {
        return corner + 1 < _pieces.starts[piece + 1] ? corner + 1 : _pieces.starts[piece];
    }
    int64_t kind_of(int64_t piece) const {
        return int64_t(_surface.group[_pieces.face[piece]]) << 32 | int64_t(_reason[piece]);
    }
    Vector point_at(int64_t f, int64_t corner) const {
        const double x = _pieces.xy(corner, 0), y = _pieces.xy(corner, 1);
        Vector at = {};
        for (size_t k = 0; k < 3; k++) {
            const auto axis = int64_t(k);
            at[k] = _surface.origin(f, axis) +
                    (x * _surface.x_axis(f, axis) + y * _surface.y_axis(f, axis));
        }
        return at;
    }

    // True if two convex pieces of a face share a part of their boundary.
    bool are_adjacent(int64_t i, int64_t j) const {
        const auto &starts = _pieces.starts;
        for (int64_t p = starts[i]; p < starts[i + 1]; p++)
            for (int64_t r = starts[j]; r < starts[j + 1]; r++)
                if (side_overlap(_pieces.xy, p, next(i, p), r, next(j, r), _tolerance) > _least)
                    return true;
        return false;
    }

    void link_in_faces() {
        const int64_t n = _pieces.face.rows();
        std::vector<std::array<Range, 2>> boxes(static_cast<size_t>(n));
        Keys keys;
        for (int64_t i = 0; i < n; i++) {
            Range along;
            for (int64_t p = _pieces.starts[i]; p < _pieces.starts[i + 1]; p++) {
                const double x = _pieces.xy(p, 0), y = _pieces.xy(p, 1);
                boxes[size_t(i)][0].add(x);
                boxes[size_t(i)][1].add(y);
                along.add(x * SWEEP[0] + y * SWEEP[1]);
            }
            keys.push_back({_pieces.face[i], int64_t(_reason[i]), 0, along.least, along.most, i});
        }
        const auto are_apart = [&](const Range &a, const Range &b) {
            return b.least > a.most + _tolerance || a.least > b.most + _tolerance;
        };
        const Forest parents = _trees.parents();
        each_overlap(keys, _tolerance, [&](const Key &a, const Key &b) {
            const int64_t i = a.row, j = b.row;
            const auto &one = boxes[size_t(i)], &other = boxes[size_t(j)];
            if (!are_apart(one[0], other[0]) && !are_apart(one[1], other[1]) &&
                root_of(parents, i) != root_of(parents, j) && are_adjacent(i, j))
                join(i, j, parents);
        });
    }

    // The edge of a face, by the lower and the higher vertex, behind corner k of its frame.
    int64_t edge_of(int64_t f, int64_t k) const {
        int64_t first = 0;
        double least = INFINITY;
        for (int64_t c = 0; c < 3; c++) {
            const Vector away =
                minus(row_of(_surface.vertices, _surface.faces(f, c)), row_of(_surface.origin, f));
            if (!(dot(away, away) < least)) continue;
            least = dot(away, away);
            first = c;
        }
        const auto [low, high] =
            std::minmax(_surface.faces(f, (first + k) % 3), _surface.faces(f, (first + k + 1) % 3));
        return low * _surface.vertices.rows() + high;
    }

    void find_sides() {
        for (int64_t i = 0; i < _pieces.face.rows(); i++)
            for (int64_t p = _pieces.starts[i]; p < _pieces.starts[i + 1]; p++) {
                const int64_t k = side_of(i, p);
                if (k >= 0) add_side(i, p, edge_of(_pieces.face[i], k));
            }
    }

    // Side of its face, 0 to 2 or -1, on which a side of a piece lies.
    int64_t side_of(int64_t piece, int64_t p) const {
        const auto triangle = _surface.corners[_pieces.face[piece]];
        int64_t found = -1;
        for (int64_t k = 0; k < 3; k++) {
            const int64_t m = k < 2 ? k + 1 : 0;
            const double x = triangle(m, 0) - triangle(k, 0), y = triangle(m, 1) - triangle(k, 1);
            const double length = std::sqrt(x * x + y * y);
            if (!(length > 0)) continue;
            const auto is_on = [&](int64_t c) {
                const double u = _pieces.xy(c, 0) - triangle(k, 0);
                const double v = _pieces.xy(c, 1) - triangle(k, 1);
                return std::abs(x * v - y * u) / length <= _tolerance;
            };
            if (is_on(p) && is_on(next(piece, p))) found = k;
        }
        return found;
    }

    void add_side(int64_t piece, int64_t p, int64_t edge) {
        const int64_t f = _pieces.face[piece], n = _surface.vertices.rows();
        Side side = {edge, kind_of(piece), piece, f, point_at(f, p), {}, {}, 0.0, 0.0};
        side.to = point_at(f, next(piece, p));
        const Vector along = minus(side.to, side.from), normal = row_of(_surface.normal, f);
        Vector inward = {};
        for (size_t k = 0; k < 3; k++)
            inward[k] =
                normal[(k + 1) % 3] * along[(k + 2) % 3] - normal[(k + 2) % 3] * along[(k + 1) % 3];
        const double size = std::max(std::sqrt(dot(inward, inward)), 1e-300);
        for (size_t k = 0; k < 3; k++) side.inward[k] = inward[k] / size;
        const Vector start = row_of(_surface.vertices, edge / n);
        Vector away = minus(row_of(_surface.vertices, edge % n), start);
        const double length = std::sqrt(dot(away, away));
        for (double &each : away) each /= length;
        const double one = dot(minus(side.from, start), away);
        const double other = dot(minus(side.to, start), away);
        side.start = std::min(one, other);
        side.end = std::max(one, other);
        _sides.push_back(side);
    }

    // Links the pieces of different faces whose sides overlap on an edge; returns the sides on
    // edges of one face with area only.
    std::vector<Side> link_along_edges() {
        Keys keys;
        for (size_t s = 0; s < _sides.size(); s++)
            keys.push_back({_sides[s].edge, _sides[s].kind, _sides[s].face, 0.0, 0.0, int64_t(s)});
        set_smooth(keys, _sides);
        for (Key &each : keys) {
            each.start = _sides[size_t(each.row)].start;
            each.end = _sides[size_t(each.row)].end;
        }
        each_overlap(keys, -_least, [&](const Key &a, const Key &b) {
            const Side &one = _sides[size_t(a.row)], &other = _sides[size_t(b.row)];
            if (one.face != other.face && b.end > b.start + _least)
                join(one.piece, other.piece, _trees.parents());
        });
        return open_of(keys);
    }

    std::vector<Side> open_of(const Keys &keys) const {
        std::vector<int64_t> uses(keys.size()); // of an edge, at its first key
        const auto first_of = [&](int64_t edge) {
            return std::lower_bound(keys.begin(), keys.end(), edge,
                                    [](const Key &key, int64_t e) { return key.line < e; }) -
                   keys.begin();
        };
        for (int64_t f = 0; f < _surface.areas.rows(); f++)
            for (int64_t k = 0; k < 3 && _surface.areas[f] > 0; k++) {
                const auto [a, b] =
                    std::minmax(_surface.faces(f, k), _surface.faces(f, k < 2 ? k + 1 : 0));
                const int64_t edge = a * _surface.vertices.rows() + b;
                const auto at = size_t(first_of(edge));
                if (at < keys.size() && keys[at].line == edge) uses[at]++;
            }
        std::vector<Side> open;
        for (const Side &each : _sides)
            if (uses[size_t(first_of(each.edge))] == 1) open.push_back(each);
        return open;
    }

    // Links the pieces of different faces that join smoothly along open edges.
    void link_in_space(const std::vector<Side> &open) {
        Keys keys, by_line;
        for (const Side &each : open) {
            const double one = dot(each.from, SWEEP), other = dot(each.to, SWEEP);
            const auto row = int64_t(keys.size());
            keys.push_back({0, each.kind, 0, std::min(one, other), std::max(one, other), row});
        }
        Trees contact{int64_t(open.size())};
        by_line = keys;
        sweep_space(by_line, open, contact.parents(), false);
        by_line.clear();
        for (const Key &each : keys) {
            const int64_t line = root_of(contact.parents(), each.row);
            by_line.push_back({line, 0, open[size_t(each.row)].face, 0.0, 0.0, each.row});
        }
        set_smooth(by_line, open);
        for (Key &each : by_line) {
            each.start = keys[size_t(each.row)].start;
            each.end = keys[size_t(each.row)].end;
        }
        sweep_space(by_line, open, _trees.parents(), true);
    }

    // Joins sides, or their pieces.
    void sweep_space(Keys &keys, const std::vector<Side> &open, Forest parents, bool of_pieces) {
        const double tolerance = OPEN_TOLERANCE_REL * _surface.scale, least = 10 * tolerance;
        each_overlap(keys, tolerance, [&](const Key &a, const Key &b) {
            const Side &one = open[size_t(a.row)], &other = open[size_t(b.row)];
            const int64_t i = of_pieces ? one.piece : a.row, j = of_pieces ? other.piece : b.row;
            if (one.face != other.face && root_of(parents, i) != root_of(parents, j) &&
                (overlap_in_space(one, other, tolerance) > least ||
                 overlap_in_space(other, one, tolerance) > least))
                join(i, j, parents);
        });
    }

    const ZoneSurface &_surface;
    const PieceTable &_pieces;
    Column<const uint32_t> _reason;
    Trees _trees;
    std::vector<Side> _sides;
    double _tolerance, _least; // metres
};

// Numbers the zones, without the smallest: those that fit into what the ones before them have left
// of the bounds of their faces, so that the areas of zones add up within the bounds.
int64_t rank_zones(Forest parents, Int32Array face, FloatArray areas, FloatArray excess,
                   Column<int64_t> zone, Column<double> sizes) {
    const int64_t n = face.rows();
    std::vector<double> sum(static_cast<size_t>(n)), left(excess.begin(), excess.end());
    Keys keys, ranked;
    for (int64_t i = 0; i < n; i++) {
        const int64_t root = root_of(parents, i);
        sum[size_t(root)] += areas[i];
        keys.push_back({root, face[i], 0, 0.0, 0.0, i});
    }
    sort_keys(keys);
    for (size_t k = 0; k < keys.size(); k++)
        if (k == 0 || keys[k].line != keys[k - 1].line)
            ranked.push_back({0, 0, 0, -sum[size_t(keys[k].line)], 0.0, int64_t(k)});
    sort_keys(ranked);
    for (size_t at = ranked.size(); at-- > 0;) {
        const auto first = size_t(ranked[at].row);
        const int64_t root = keys[first].line;
        const auto is_own = [&](size_t k) { return k < keys.size() && keys[k].line == root; };
        double bound = 0.0;
        for (size_t k = first; is_own(k); k++)
            if (k == first || !keys[k].is_with(keys[k - 1])) bound += left[size_t(keys[k].kind)];
        double &rest = sum[size_t(root)];
        if (rest > bound) continue;
        for (size_t k = first; is_own(k); k++) {
            double &of_face = left[size_t(keys[k].kind)];
            const double used = std::min(rest, of_face);
            of_face -= used;
            rest -= used;
        }
        rest = 0.0; // what rounding leaves
    }
    std::vector<int64_t> rank(static_cast<size_t>(n), -1);
    int64_t n_zones = 0;
    for (const Key &each : ranked) {
        const auto root = size_t(keys[size_t(each.row)].line);
        if (sum[root] <= 0) continue;
        sizes[n_zones] = sum[root];
        rank[root] = n_zones++;
    }
    for (int64_t i = 0; i < n; i++) zone[i] = rank[size_t(root_of(parents, i))];
    return n_zones;
}

} // namespace

int64_t find_zones(const ZoneSurface &surface, const PieceTable &pieces,
                   Column<const uint32_t> reason, FloatArray areas, FloatArray excess,
                   Column<int64_t> zone, Column<double> sizes) {
    const int64_t n = pieces.face.rows(), n_faces = surface.faces.rows();
    require_starts(pieces.starts, n, pieces.xy.rows(),
                   "starts must rise, within the corners, one row for each piece and one more");
    require(have_rows(n, reason, areas, zone, sizes), "pieces must have one row of each array");
    require(have_rows(n_faces, surface.group, surface.origin, surface.x_axis, surface.y_axis,
                      surface.normal, surface.corners, surface.areas, excess),
            "faces must have one row of each array");
    require_indices(pieces.face, n_faces, "face must hold faces of the surface");
    require_indices(surface.faces, surface.vertices.rows(), "faces must hold vertices");
    Linker linker(surface, pieces, reason);
    return rank_zones(linker.linked(), pieces.face, areas, excess, zone, sizes);
}

} // namespace area

void register_area_zone(nanobind::module_ &m) {
    def(m, "find_zones", area::find_zones, "Connected parts of pieces of a surface.", "surface",
        "pieces", "reason", "areas", "excess", "zone", "sizes");
}

} // namespace rastercov
