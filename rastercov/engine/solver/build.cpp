// Surface of the faces of a mesh: welded vertices, their order, edges, patches and blocks.
//
// Blocks are consecutive faces of the surface, in the order of the mesh where that is local, as
// generators and CAD programs write it, or where the mesh is small; otherwise sorted along a curve
// that fills space. Vertices of a large mesh are in the order of their use.
//
// G. M. Morton. A Computer Oriented Geodetic Data Base and a New Technique in File Sequencing.
// 1966.
//
// Twin: tests/exact/test_surface.py, by numpy.
#include "solver/build.hpp"
#include "exact/forest.hpp"
#include "interrupt.hpp"
#include "range.hpp"
#include "solver/room.hpp"
#include "sort.hpp"
#include <algorithm>
#include <bit>
#include <cmath>
#include <compare>
#include <limits>
#include <numeric>

namespace rastercov::engine {
namespace {
using namespace exact;

// Vertices of the faces of a block, on average, up to which the order of the mesh is local: a strip
// of them has 66, faces in any order 192.
constexpr int64_t MOST_VERTICES = 96;
constexpr int CURVE_BITS = 10; // of each coordinate along the curve
// Sine of the angle between two edges below which a normal is only rounding.
constexpr double LEAST_SINE = 8 * std::numeric_limits<double>::epsilon();
constexpr double LEAST_VOLUME = 1e-12; // of a part, of the sum of its terms' magnitudes
constexpr int DIGIT_BITS = 11;         // of a sort by digits
constexpr int64_t MOST_FACES = std::numeric_limits<int32_t>::max() / 3; // each has three edges
constexpr int64_t MOST_PROBES = 16; // of a table of rows, on average, before the rows are sorted

using Corners = Array<const int64_t, Any, 3>;

struct BuiltPart {
    Room<double> vertices;
    Room<int32_t> faces;
    Room<int64_t> source;
    Room<int32_t> order; // face of the mesh of each face; of no size: the same
    Room<int32_t> edge_vertices, edge_faces, of_face;
    Room<int8_t> kind;
    Room<bool> has_flat, is_plain;
    Room<int32_t> patch, patch_starts, of_patch, lowest, joins, starts, of_edges;

    Edges edges() const {
        return {edge_vertices.rows<2>(), edge_faces.rows<2>(), kind.rows(), of_face.rows<3>()};
    }
    Part views() const {
        const Blocks blocks = {has_flat.rows(), patch.rows(),  patch_starts.rows(),
                               of_patch.rows(), lowest.rows(), joins.rows<2>(),
                               is_plain.rows(), starts.rows(), of_edges.rows()};
        return {vertices.rows<3>(), faces.rows<3>(), blocks, source.rows()};
    }
};

struct BuiltSurface {
    BuiltPart opaque, targets;
    Room<int32_t> rank;
    Room<int64_t> place;
};

uint64_t digest_of(Rows rows, int64_t i) {
    uint64_t digest = 0;
    for (int64_t k = 0; k < rows.extent(1); k++) {
        digest = (digest ^ rows(i, k)) * 0x9E3779B97F4A7C15;
        digest ^= digest >> 29;
    }
    digest *= 0xC2B2AE3D27D4EB4F;
    return digest ^ digest >> 32;
}

bool are_equal(Rows rows, int64_t i, int64_t j) {
    return std::equal(rows[i].begin(), rows[i].end(), rows[j].begin());
}

// The first equal rows by a table of digests; false if too many rows have one place in it.
bool find_by_digest(Rows rows, Column<int64_t> first) {
    const int64_t n = rows.rows();
    const uint64_t mask = std::bit_ceil(uint64_t(2 * n)) - 1;
    Room<int32_t> table(int64_t(mask + 1), -1);
    int64_t n_probes = 0;
    for (int64_t i = 0; i < n; i++) {
        uint64_t at = digest_of(rows, i) & mask;
        while (table[int64_t(at)] >= 0 && !are_equal(rows, i, table[int64_t(at)])) {
            at = (at + 1) & mask;
            if (++n_probes > MOST_PROBES * n) return false;
        }
        int32_t &own = table[int64_t(at)];
        if (own < 0) own = int32_t(i);
        first[i] = own;
    }
    return true;
}

void find_by_order(Rows rows, Column<int64_t> first) {
    Room<int64_t> order(rows.rows());
    std::iota(order.begin(), order.end(), 0);
    sort_range(order.begin(), order.end(), [&](int64_t i, int64_t j) {
        const auto a = rows[i], b = rows[j];
        const auto c =
            std::lexicographical_compare_three_way(a.begin(), a.end(), b.begin(), b.end());
        return c < 0 || (c == 0 && i < j);
    });
    for (int64_t k = 0; k < order.size(); k++) {
        const bool is_first = k == 0 || !are_equal(rows, order[k], order[k - 1]);
        first[order[k]] = is_first ? order[k] : first[order[k - 1]];
    }
}

int64_t blocks_for(int64_t n) { return (n + BLOCK - 1) / BLOCK; }

// Numbers the vertices that faces use by their indices, and the faces by these numbers.
void weld(const Welded &mesh, BuiltPart &part) {
    require_indices(mesh.faces, mesh.vertices.rows(), "faces must hold vertices");
    Room<int32_t> number(mesh.vertices.rows(), -1);
    for (const int64_t v : mesh.faces) number[v] = 0;
    int32_t n = 0;
    for (int32_t &own : number)
        if (own == 0) own = n++;
    part.source = Room<int64_t>(n);
    for (int64_t v = 0; v < number.size(); v++)
        if (number[v] >= 0) part.source[number[v]] = v;
    part.faces = Room<int32_t>(mesh.faces.size());
    for (int64_t k = 0; k < part.faces.size(); k++) part.faces[k] = number[mesh.faces.data[k]];
}

// True where the faces of a block, on average, have few vertices.
bool is_local(const BuiltPart &part) {
    const int64_t n = part.faces.size() / (3 * BLOCK);
    int64_t n_vertices = 0;
    std::array<int32_t, 3 * BLOCK> used;
    for (int64_t b = 0; b < n; b++) {
        std::copy_n(part.faces.rows().data + b * 3 * BLOCK, 3 * BLOCK, used.begin());
        sort_range(used.begin(), used.end());
        n_vertices += std::unique(used.begin(), used.end()) - used.begin();
    }
    return n_vertices <= MOST_VERTICES * n;
}

// Moves bit i of a number below 2^10 to bit 3 i.
uint32_t spread_bits(uint32_t v) {
    v = (v | v << 16) & 0x030000FF;
    v = (v | v << 8) & 0x0300F00F;
    v = (v | v << 4) & 0x030C30C3;
    return (v | v << 2) & 0x09249249;
}

// Rows of keys in rising order, those of equal keys in the order of the rows.
Room<int32_t> sorted_rows(Room<uint32_t> keys) {
    const int64_t n = keys.size();
    Room<int32_t> rows(n), other(n);
    std::iota(rows.begin(), rows.end(), 0);
    for (int shift = 0; shift < 3 * CURVE_BITS; shift += DIGIT_BITS) {
        poll_interrupt();
        std::array<int64_t, (1 << DIGIT_BITS) + 1> starts = {};
        const auto digit = [&](int64_t f) { return keys[f] >> shift & ((1 << DIGIT_BITS) - 1); };
        for (int64_t f = 0; f < n; f++) starts[digit(f) + 1]++;
        std::partial_sum(starts.begin(), starts.end(), starts.begin());
        for (const int32_t f : rows) other[starts[digit(f)]++] = f;
        std::swap(rows, other);
    }
    return rows;
}

// Faces in the order of their centroids along the curve.
Room<int32_t> order_along_curve(const BuiltPart &part) {
    const int64_t n = part.faces.size() / 3;
    const auto centroid = [&](int64_t f, int axis) {
        double sum = 0.0;
        for (int k = 0; k < 3; k++) sum += part.vertices[3 * int64_t(part.faces[3 * f + k]) + axis];
        return sum / 3.0;
    };
    std::array<Range, 3> along;
    for (int64_t f = 0; f < n; f++)
        for (int axis = 0; axis < 3; axis++) along[axis].add(centroid(f, axis));
    double extent = 0.0;
    for (const auto [least, most] : along) extent = std::max(extent, most - least);
    constexpr double CELLS = (1 << CURVE_BITS) - 1;
    Room<uint32_t> keys(n, 0);
    for (int64_t f = 0; extent > 0.0 && f < n; f++)
        for (int axis = 0; axis < 3; axis++) {
            const double at = (centroid(f, axis) - along[axis].least) / extent * CELLS;
            keys[f] |= spread_bits(uint32_t(std::clamp(at, 0.0, CELLS))) << axis;
        }
    return sorted_rows(std::move(keys));
}

// Sorts faces so that neighbours are close, unless they are.
void sort_faces(BuiltPart &part) {
    if (is_local(part)) return;
    part.order = order_along_curve(part);
    Room<int32_t> faces(part.faces.size());
    for (int64_t f = 0; f < part.order.size(); f++)
        std::copy_n(part.faces.begin() + 3 * int64_t(part.order[f]), 3, faces.begin() + 3 * f);
    part.faces = std::move(faces);
}

// Numbers vertices in the order in which faces use them first: those of a block are then close.
void sort_vertices(BuiltPart &part) {
    Room<int32_t> number(part.source.size(), -1);
    Room<int64_t> source(part.source.size());
    int32_t n = 0;
    for (int32_t &v : part.faces) {
        if (number[v] < 0) {
            source[n] = part.source[v];
            number[v] = n++;
        }
        v = number[v];
    }
    part.source = std::move(source);
}

// Use h of an edge is that of face h / 3 from corner h % 3 to the next one.
struct Use {
    int32_t higher, number;
};

int32_t next_corner(int32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }

// The uses of all edges by their lower and higher vertices, faces ascending within an edge; those
// from lower vertex v are starts[v] ... starts[v + 1] - 1.
Room<Use> sorted_uses(const Room<int32_t> &faces, Room<int64_t> &starts) {
    const auto n = int32_t(faces.size());
    std::fill(starts.begin(), starts.end(), 0);
    const auto ends = [&](int32_t h) { return std::minmax(faces[h], faces[next_corner(h)]); };
    for (int32_t h = 0; h < n; h++) starts[ends(h).first + 1]++;
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    Room<Use> uses(n);
    Room<int64_t> at(starts.size());
    std::copy(starts.begin(), starts.end(), at.begin());
    for (int32_t h = 0; h < n; h++) {
        const auto [lower, higher] = ends(h);
        uses[at[lower]++] = {higher, h};
    }
    for (int64_t v = 0; v + 1 < starts.size(); v++)
        sort_range(uses.begin() + starts[v], uses.begin() + starts[v + 1],
                   [](const Use &a, const Use &b) {
                       return a.higher < b.higher || (a.higher == b.higher && a.number < b.number);
                   });
    return uses;
}

// A face with a repeated vertex has an edge of no length, which is NON_MANIFOLD whatever its number
// of faces, so that no result spreads along it.
void find_edges(BuiltPart &part) {
    Room<int64_t> starts(part.source.size() + 1);
    const Room<Use> uses = sorted_uses(part.faces, starts);
    const auto same_as_before = [&](int64_t first, int64_t k) {
        return k > first && uses[k].higher == uses[k - 1].higher;
    };
    int64_t n_edges = 0;
    for (int64_t v = 0; v + 1 < starts.size(); v++)
        for (int64_t k = starts[v]; k < starts[v + 1]; k++)
            n_edges += !same_as_before(starts[v], k);
    part.edge_vertices = Room<int32_t>(2 * n_edges);
    part.edge_faces = Room<int32_t>(2 * n_edges, -1);
    part.kind = Room<int8_t>(n_edges, CONSISTENT);
    part.of_face = Room<int32_t>(part.faces.size());
    int64_t e = -1;
    int64_t n_uses = 0;
    for (int64_t v = 0; v + 1 < starts.size(); v++)
        for (int64_t k = starts[v]; k < starts[v + 1]; k++) {
            const Use use = uses[k];
            n_uses = same_as_before(starts[v], k) ? n_uses + 1 : 1;
            if (n_uses == 1) {
                e++;
                part.edge_vertices[2 * e] = int32_t(v);
                part.edge_vertices[2 * e + 1] = use.higher;
            }
            part.of_face[use.number] = int32_t(e);
            if (n_uses <= 2) part.edge_faces[2 * e + n_uses - 1] = use.number / 3;
            const auto is_forward = [&](const Use &each) { return part.faces[each.number] == v; };
            if (v == use.higher || n_uses > 2) part.kind[e] = NON_MANIFOLD;
            else if (n_uses == 2 && is_forward(use) == is_forward(uses[k - 1]))
                part.kind[e] = REVERSED;
        }
}

bool has_two_faces(const BuiltPart &part, int64_t e) {
    return part.edge_faces[2 * e + 1] >= 0 && part.kind[e] != NON_MANIFOLD;
}

// Patches: parts of a block whose faces are joined by edges that two of them use in opposite
// directions.
void find_patches(BuiltPart &part) {
    const int64_t n = part.faces.size() / 3, n_blocks = blocks_for(n);
    Room<int32_t> parent(n);
    std::iota(parent.begin(), parent.end(), 0);
    for (int64_t e = 0; e < part.kind.size(); e++) {
        const int64_t f = part.edge_faces[2 * e], g = part.edge_faces[2 * e + 1];
        if (has_two_faces(part, e) && part.kind[e] == CONSISTENT && f / BLOCK == g / BLOCK)
            join(f, g, parent.rows());
    }
    part.patch = Room<int32_t>(n);
    part.patch_starts = Room<int32_t>(n_blocks + 1);
    int32_t n_patches = 0;
    for (int64_t f = 0; f < n; f++) {
        if (f % BLOCK == 0) part.patch_starts[f / BLOCK] = n_patches;
        const int64_t root = root_of(parent.rows(), f); // the lowest face, which has a number
        part.patch[f] = root == f ? n_patches++ : part.patch[root];
    }
    part.patch_starts[n_blocks] = n_patches;
    part.of_patch = Room<int32_t>(n_patches);
    part.lowest = Room<int32_t>(n_patches);
    for (int64_t f = n - 1; f >= 0; f--) {
        part.lowest[part.patch[f]] = int32_t(f);
        part.of_patch[part.patch[f]] = int32_t(f / BLOCK);
    }
}

// Pairs of patches with a common edge of two faces, the lower one first; the complement of the
// other where both faces run along the edge in the same direction.
void find_joins(BuiltPart &part) {
    std::vector<int64_t> pairs; // the other patch above the lower one, as they are sorted
    for (int64_t e = 0; e < part.kind.size(); e++) {
        if (!has_two_faces(part, e)) continue;
        const int32_t f = part.patch[part.edge_faces[2 * e]];
        const int32_t g = part.patch[part.edge_faces[2 * e + 1]];
        if (f == g) continue;
        const int64_t other = std::max(f, g);
        const int64_t signed_other = part.kind[e] == CONSISTENT ? other : ~other;
        pairs.push_back(signed_other * (int64_t(1) << 32) + std::min(f, g));
    }
    sort_range(pairs.begin(), pairs.end());
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    part.joins = Room<int32_t>(2 * int64_t(pairs.size()));
    for (size_t k = 0; k < pairs.size(); k++) {
        part.joins[int64_t(2 * k)] = int32_t(pairs[k]);
        part.joins[int64_t(2 * k + 1)] = int32_t(pairs[k] >> 32);
    }
}

// Blocks of the faces of each BLOCK consecutive edges, of those that are plain.
void find_blocks_of_edges(BuiltPart &part) {
    const int64_t n_edges = part.kind.size(), n = blocks_for(n_edges);
    part.is_plain = Room<bool>(n, true);
    part.starts = Room<int32_t>(n + 1, 0);
    std::vector<int32_t> found;
    std::array<int32_t, 2 * BLOCK> used;
    for (int64_t m = 0; m < n; m++) {
        const int64_t last = std::min((m + 1) * BLOCK, n_edges);
        auto end = used.begin();
        for (int64_t e = m * BLOCK; e < last; e++)
            for (int k = 0; k < 2; k++) {
                if (part.kind[e] != CONSISTENT || part.edge_faces[2 * e + 1] < 0)
                    part.is_plain[m] = false;
                *end++ = part.edge_faces[2 * e + k] / int32_t(BLOCK);
            }
        if (part.is_plain[m]) {
            sort_range(used.begin(), end);
            found.insert(found.end(), used.begin(), std::unique(used.begin(), end));
        }
        part.starts[m + 1] = int32_t(found.size());
    }
    part.of_edges = Room<int32_t>(int64_t(found.size()));
    std::copy(found.begin(), found.end(), part.of_edges.begin());
}

bool is_flat(const BuiltPart &part, int64_t f) {
    const double *const points = part.vertices.rows().data;
    const auto at = [&](int k) { return points + 3 * int64_t(part.faces[3 * f + k]); };
    return engine::is_flat(at(0), at(1), at(2));
}

Room<double> positions_of(IntArray source, Vertices vertices) {
    require_indices(source, vertices.rows(), "source must hold vertices of the mesh");
    Room<double> positions(3 * source.rows());
    for (int64_t v = 0; v < source.rows(); v++)
        std::copy_n(vertices[source[v]].data, 3, positions.begin() + 3 * v);
    for (const double each : positions)
        expect(std::abs(each) <= LARGEST_COORDINATE, "finite coordinates within 1e30 m", each,
               "check the vertices");
    return positions;
}

BuiltPart build_part(const Welded &mesh, int64_t least_sorted) {
    const int64_t n = mesh.faces.rows();
    expect(n <= MOST_FACES, "715827882 faces or fewer", n, "split the mesh");
    BuiltPart part;
    weld(mesh, part);
    part.vertices = positions_of(part.source.rows(), mesh.vertices);
    if (n >= least_sorted) {
        sort_faces(part);
        sort_vertices(part);
        part.vertices = positions_of(part.source.rows(), mesh.vertices);
    }
    poll_interrupt();
    part.has_flat = Room<bool>(blocks_for(n), false);
    for (int64_t f = 0; f < n; f++)
        if (is_flat(part, f)) part.has_flat[f / BLOCK] = true;
    poll_interrupt();
    find_edges(part);
    poll_interrupt();
    find_patches(part);
    find_joins(part);
    find_blocks_of_edges(part);
    return part;
}

// True if the parts of a closed mesh, named by their first faces, have positive volumes.
bool have_volumes(const Welded &mesh, const Room<int32_t> &parts) {
    Room<double> volume(parts.size(), 0.0), scale(parts.size(), 0.0);
    for (int64_t f = 0; f < parts.size(); f++) {
        if (parts[f] < 0) continue;
        const auto origin = mesh.vertices[mesh.faces(parts[f], 0)];
        const auto at = [&](int k, int axis) {
            return mesh.vertices(mesh.faces(f, k), axis % 3) - origin[axis % 3];
        };
        double term = 0.0;
        for (int axis = 0; axis < 3; axis++)
            term += at(0, axis) *
                    (at(1, axis + 1) * at(2, axis + 2) - at(1, axis + 2) * at(2, axis + 1));
        volume[parts[f]] += term;
        scale[parts[f]] += std::abs(term);
    }
    for (int32_t f = 0; f < parts.size(); f++)
        if (parts[f] == f && !(volume[f] > LEAST_VOLUME * scale[f])) return false;
    return true;
}

// Rank of the opaque faces, and the places of all faces of the mesh where these are not their own.
void place_faces(BuiltSurface &built, BoolArray is_target) {
    const int64_t n = built.opaque.faces.size() / 3;
    const bool is_sorted = built.opaque.order.size() > 0;
    built.rank = std::move(built.opaque.order);
    if (!is_sorted) {
        built.rank = Room<int32_t>(n);
        std::iota(built.rank.begin(), built.rank.end(), 0);
    }
    if (!is_sorted && is_target.rows() == 0) return;
    Room<int64_t> own(n);
    for (int64_t f = 0; f < n; f++) own[built.rank[f]] = f;
    if (is_target.rows() == 0) {
        built.place = std::move(own);
        return;
    }
    built.place = Room<int64_t>(is_target.rows());
    int64_t n_opaque = 0;
    int64_t n_targets = 0;
    for (int64_t f = 0; f < is_target.rows(); f++)
        built.place[f] = is_target[f] ? n + n_targets++ : own[n_opaque++];
}
} // namespace

bool is_flat(const double *first, const double *second, const double *third) {
    double side[2][3], size = 0.0;
    const double *const ends[2] = {second, third};
    for (int k = 0; k < 2; k++)
        for (int axis = 0; axis < 3; axis++) {
            side[k][axis] = ends[k][axis] - first[axis];
            size = std::max(size, std::abs(side[k][axis]));
        }
    for (auto &each : side) // scaled, so that no square under- or overflows
        for (double &coordinate : each) coordinate /= size > 0.0 ? size : 1.0;
    const auto &[p, q] = side;
    const double x = p[1] * q[2] - p[2] * q[1];
    const double y = p[2] * q[0] - p[0] * q[2];
    const double z = p[0] * q[1] - p[1] * q[0];
    const auto length = [](double a, double b, double c) {
        return std::sqrt(a * a + b * b + c * c);
    };
    return length(x, y, z) <= LEAST_SINE * (length(p[0], p[1], p[2]) * length(q[0], q[1], q[2]));
}

void find_first_equal(Rows rows, Column<int64_t> first) {
    require(first.rows() == rows.rows(), "first must have one value for each row");
    expect(rows.rows() <= std::numeric_limits<int32_t>::max(), "fewer than 2^31 rows", rows.rows(),
           "split the mesh");
    if (!find_by_digest(rows, first)) find_by_order(rows, first);
}

Room<int32_t> find_outward_parts(const Welded &mesh) {
    BuiltPart part;
    weld(mesh, part);
    const int64_t n_all = mesh.faces.rows();
    Room<int32_t> parts(n_all, -1), kept(n_all);
    int32_t n = 0;
    for (int32_t f = 0; f < n_all; f++) {
        const int32_t *const v = part.faces.begin() + 3 * int64_t(f);
        if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) continue;
        std::copy_n(v, 3, part.faces.begin() + 3 * int64_t(n));
        kept[n++] = f;
    }
    Room<int32_t> faces(3 * int64_t(n)), parent(n);
    std::copy_n(part.faces.begin(), faces.size(), faces.begin());
    part.faces = std::move(faces);
    find_edges(part);
    std::iota(parent.begin(), parent.end(), 0);
    for (int64_t e = 0; e < part.kind.size(); e++) {
        if (part.edge_faces[2 * e + 1] < 0 || part.kind[e] != CONSISTENT) return {};
        join(part.edge_faces[2 * e], part.edge_faces[2 * e + 1], parent.rows());
    }
    for (int32_t f = 0; f < n; f++) parts[kept[f]] = kept[root_of(parent.rows(), f)];
    return n > 0 && have_volumes(mesh, parts) ? std::move(parts) : Room<int32_t>();
}

std::shared_ptr<const Surface> build_surface(const Welded &opaque, const Welded &all,
                                             BoolArray is_target, ContactFinder finder,
                                             int64_t least_sorted) {
    const int64_t n_targets = std::count(is_target.begin(), is_target.end(), true);
    const int64_t n_rest = is_target.rows() - n_targets;
    expect(opaque.faces.rows() > 0, "1 face or more", opaque.faces.rows(),
           "pass a mesh with faces");
    require(is_target.rows() == 0 ||
                (is_target.rows() == all.faces.rows() &&
                 (n_rest == opaque.faces.rows() || (n_rest == 0 && opaque.faces.rows() == 1))),
            "opaque faces must be those of all that are no targets");
    const auto built = std::make_shared<BuiltSurface>();
    built->opaque = build_part(opaque, least_sorted);
    if (n_targets) {
        Room<int64_t> faces(3 * n_targets);
        int64_t n = 0;
        for (int64_t f = 0; f < is_target.rows(); f++)
            if (is_target[f]) std::copy_n(all.faces[f].data, 3, faces.begin() + 3 * n++);
        built->targets =
            build_part({all.vertices, faces.rows<3>()}, std::numeric_limits<int64_t>::max());
    }
    place_faces(*built, is_target);
    SurfaceArrays arrays = {};
    arrays.opaque = built->opaque.views();
    arrays.edges = built->opaque.edges();
    arrays.rank = built->rank.rows();
    arrays.place = built->place.rows();
    if (n_targets) arrays.targets = built->targets.views();
    return std::make_shared<const Surface>(arrays, built, std::move(finder));
}

std::shared_ptr<const Surface> move_surface(std::shared_ptr<const Surface> rest, Vertices opaque,
                                            Vertices all, ContactFinder finder) {
    struct Moved {
        std::shared_ptr<const Surface> rest;
        Room<double> opaque, targets;
    };
    SurfaceArrays arrays = rest->arrays();
    const auto moved = std::make_shared<Moved>(rest, positions_of(rest->source(), opaque),
                                               positions_of(rest->targets().source, all));
    arrays.opaque.vertices = moved->opaque.rows<3>();
    arrays.targets.vertices = moved->targets.rows<3>();
    return std::make_shared<const Surface>(arrays, moved, std::move(finder));
}

} // namespace rastercov::engine
