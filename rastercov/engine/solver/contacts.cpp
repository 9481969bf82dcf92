// Faces of a mesh in contact: a tree of boxes in a scene of diagonal 1, and fans of faces that
// share a corner by their directions from there.
//
// Twin: tests/mesh/test_contacts.py compares all pairs.
#include "solver/contacts.hpp"
#include "mesh/contacts.hpp"
#include "solver/threads.hpp"
#include "sort.hpp"
#include "vector.hpp"
#include <cmath>
#include <limits>
#include <numeric>

namespace rastercov::engine {
namespace {
using engine::BOX_MARGIN, mesh::INF, mesh::LEAF;

constexpr double LEAST_TOLERANCE_REL = 1e-12; // diagonals: 200 times the rounding of a distance
constexpr int64_t FRAME_SAMPLES = 4096;       // faces at most on which two frames are compared
constexpr double LESS = 0.999;                // of the area of boxes, by which a frame is better

using Point = Coordinates;
using Matrix = Symmetric;

Point times(const Point &a, double s) { return {a[0] * s, a[1] * s, a[2] * s}; }

Point point_at(const Room<double> &points, int64_t v) {
    return {points[3 * v], points[3 * v + 1], points[3 * v + 2]};
}

// Triangles in the order of a Morton curve, those of a group together, and the boxes over them.
struct Tree {
    Room<int32_t> order; // row that each triangle had
    Room<int32_t> faces;
    Room<float> boxes, nodes;

    int64_t n_faces() const { return boxes.size() / 6; }
    int64_t n_leaves() const { return nodes.size() / 12; }
    mesh::ContactTree<int32_t> with(const Room<int32_t> &fans) const {
        return {faces.rows<3>(), boxes.rows<6>(), nodes.rows<6>(), fans.rows()};
    }
};

Tree tree_over(const Room<double> &points, const Room<int32_t> &faces,
               const Room<int32_t> &groups) {
    const int64_t n = faces.size() / 3;
    Room<uint64_t> keys(n);
    mesh::order_keys<int32_t>(points.rows<3>(), faces.rows<3>(), keys.rows());
    Tree tree;
    tree.order = Room<int32_t>(n);
    std::iota(tree.order.begin(), tree.order.end(), 0);
    sort_range(tree.order.begin(), tree.order.end(), [&](int32_t a, int32_t b) {
        return std::tie(groups[a], keys[a], a) < std::tie(groups[b], keys[b], b);
    });
    tree.faces = Room<int32_t>(faces.size());
    for (int64_t f = 0; f < n; f++)
        for (int k = 0; k < 3; k++) tree.faces[3 * f + k] = faces[3 * int64_t(tree.order[f]) + k];
    const auto leaves =
        int64_t(std::bit_ceil(uint64_t(std::max((n + LEAF - 1) / LEAF, int64_t(2)))));
    tree.boxes = Room<float>(6 * n);
    tree.nodes = Room<float>(12 * leaves);
    mesh::grow_boxes<int32_t, float>(points.rows<3>(), tree.faces.rows<3>(), BOX_MARGIN,
                                     tree.boxes.rows<6>(), tree.nodes.rows<6>());
    return tree;
}

// A tree of faces, in its order: which they are, and a corner of each that very many have, or -1.
struct Fan {
    Tree tree;
    Room<int32_t> chosen, fans;
};

// Chosen faces of a mesh, scaled to a bounding box of diagonal 1, in a tree.
struct Placed {
    Room<double> vertices; // of the mesh
    double scale, reach;   // inverse of the diagonal, and the tolerance as a fraction of it
    Room<double> points;   // vertices in the scene
    Fan all;

    mesh::Surface<int32_t> surface(const Tree &of) const {
        return {vertices.rows<3>(), scale, of.faces.rows<3>(), reach};
    }
};

// Eigenvectors of a symmetric matrix as columns, by rotations of Jacobi.
Matrix directions_of(Matrix a) {
    Matrix v = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (int sweep = 0; sweep < 16; sweep++)
        for (const auto &[p, q] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
            if (a[p][q] == 0.0) continue;
            const double theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::hypot(theta, 1.0));
            turn_axes(a, v, p, q, t);
        }
    return v;
}

Point rotate(const Point &p, const Matrix &by) {
    Point out;
    for (int k = 0; k < 3; k++) out[k] = p[0] * by[0][k] + p[1] * by[1][k] + p[2] * by[2][k];
    return out;
}

// Half the surface area of the boxes of triangles.
double box_area(const std::vector<std::array<Point, 3>> &triangles, const Matrix &frame) {
    double total = 0.0;
    for (const auto &each : triangles) {
        Point low = rotate(each[0], frame), high = low;
        for (int i = 1; i < 3; i++) {
            const Point at = rotate(each[i], frame);
            for (int k = 0; k < 3; k++) {
                low[k] = std::min(low[k], at[k]);
                high[k] = std::max(high[k], at[k]);
            }
        }
        const Point side = minus(high, low);
        total += side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
    }
    return total;
}

// A rotation that makes boxes small: the identity, or the main directions of the edges. The box of
// a needle across the axes overlaps those of all needles beside it.
Matrix frame_of(const Room<double> &points, const Room<int32_t> &faces) {
    const Matrix none = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    const int64_t n = faces.size() / 3, step = (n + FRAME_SAMPLES - 1) / FRAME_SAMPLES;
    std::vector<std::array<Point, 3>> samples;
    Matrix sum = {};
    for (int64_t f = 0; f < n; f += step) {
        auto &each = samples.emplace_back();
        for (int k = 0; k < 3; k++) each[k] = point_at(points, faces[3 * f + k]);
        for (int k = 0; k < 3; k++) {
            const Point edge = minus(each[(k + 1) % 3], each[k]);
            const double size = length(edge);
            for (int i = 0; i < 3 && size > 0.0; i++)
                for (int j = 0; j < 3; j++) sum[i][j] += edge[i] * edge[j] / size;
        }
    }
    const Matrix other = directions_of(sum);
    return box_area(samples, other) < LESS * box_area(samples, none) ? other : none;
}

// The one of each n of some corners that most have, if more than `most`, otherwise -1.
Room<int32_t> fans_of(const Room<int32_t> &corners, int64_t n, int64_t most) {
    Room<int32_t> fans(corners.size() / n, -1);
    if (fans.size() <= most) return fans;
    std::vector<int32_t> sorted(corners.rows().begin(), corners.rows().end());
    sort_range(sorted.begin(), sorted.end());
    for (int64_t f = 0; f < fans.size(); f++)
        for (int64_t k = n * f, least = most; k < n * (f + 1); k++) {
            const auto [first, last] = std::equal_range(sorted.begin(), sorted.end(), corners[k]);
            if (last - first <= least) continue;
            least = last - first;
            fans[f] = corners[k];
        }
    return fans;
}

// Faces in a tree over places; `fans` are theirs.
Fan fan_over(const Room<double> &places, const Room<int32_t> &faces, const Room<int32_t> &chosen,
             const Room<int32_t> &fans) {
    Fan fan = {tree_over(places, faces, fans), Room<int32_t>(fans.size()),
               Room<int32_t>(fans.size())};
    for (int64_t f = 0; f < fans.size(); f++) {
        fan.chosen[f] = chosen[fan.tree.order[f]];
        fan.fans[f] = fans[fan.tree.order[f]];
    }
    return fan;
}

// Faces by the first vertex at the position of each corner; and the vertices without -0.0.
Room<int32_t> corners_of(const Welded &mesh, const Room<int32_t> &chosen, Room<double> &vertices) {
    require_indices(mesh.faces, mesh.vertices.rows(), "faces must hold vertices");
    for (int64_t k = 0; k < vertices.size(); k++) vertices[k] = mesh.vertices.data[k] + 0.0;
    Room<int64_t> first(mesh.vertices.rows());
    find_first_equal({reinterpret_cast<const uint64_t *>(vertices.begin()), {first.size(), 3}},
                     first.rows());
    Room<int32_t> corners(3 * chosen.size());
    for (int64_t f = 0; f < chosen.size(); f++)
        for (int k = 0; k < 3; k++) corners[3 * f + k] = int32_t(first[mesh.faces(chosen[f], k)]);
    return corners;
}

Placed place(const Welded &mesh, const Room<int32_t> &chosen, double tolerance,
             int64_t most_at_corner) {
    Placed placed;
    placed.vertices = Room<double>(mesh.vertices.size());
    const Room<int32_t> corners = corners_of(mesh, chosen, placed.vertices);
    const int64_t n_vertices = mesh.vertices.rows();
    Point low, high;
    low.fill(INF);
    high.fill(-INF);
    for (int64_t k = 0; k < corners.size(); k++)
        for (int axis = 0; axis < 3; axis++) {
            const double at = placed.vertices[3 * int64_t(corners[k]) + axis];
            low[axis] = std::min(low[axis], at);
            high[axis] = std::max(high[axis], at);
        }
    const Point size = minus(high, low); // their squares may underflow
    const double extent = std::hypot(size[0], size[1], size[2]);
    placed.scale =
        1.0 / std::max(extent, 1e-300); // the inverse of a smaller number can be infinite
    placed.reach =
        ROUNDING_FACTOR * std::max(tolerance, LEAST_TOLERANCE_REL * extent) * placed.scale;
    placed.points = Room<double>(placed.vertices.size());
    for (int64_t k = 0; k < placed.points.size(); k++) {
        const auto axis = size_t(k % 3);
        const double inside = std::min(std::max(placed.vertices[k], low[axis]), high[axis]);
        placed.points[k] = (inside - (low[axis] + high[axis]) / 2) * placed.scale;
    }
    const Matrix frame = frame_of(placed.points, corners);
    for (int64_t v = 0; v < n_vertices; v++) {
        const Point at = rotate(point_at(placed.points, v), frame);
        std::copy_n(at.begin(), 3, placed.points.begin() + 3 * v);
    }
    placed.all = fan_over(placed.points, corners, chosen, fans_of(corners, 3, most_at_corner));
    return placed;
}

// The two ends of a box of the directions to a face from the common corner of a fan, divided by 4.
// Two faces meet elsewhere only where the edge opposite to that corner of one, at a distance of r
// or more, is within the tolerance of the other: their directions p and q there differ by |p - q|
// <= 2 tolerance / r. A chord c between two directions is off their arc by c^2 / 4 or less.
//
// Of faces about an edge they are those across it; see fold_touches.
std::array<Point, 2> box_of_directions(const Placed &placed, const int32_t *others,
                                       const std::array<int32_t, 2> &hubs) {
    const auto from_hub = [&](int32_t v) {
        const Point hub = point_at(placed.vertices, hubs[0]);
        return times(minus(point_at(placed.vertices, v), hub), placed.scale);
    };
    Point ends[2] = {from_hub(others[0]), from_hub(others[1])}, to[2];
    double height = length(cross(ends[0], ends[1])) / length(minus(ends[1], ends[0]));
    if (hubs[1] >= 0) {
        const Point edge = from_hub(hubs[1]);
        const double squared = dot(edge, edge);
        ends[0] = minus(ends[0], times(edge, dot(ends[0], edge) / squared));
        ends[1] = ends[0];
        height = squared > mesh::LEAST_AXIS_SQUARED ? length(ends[0]) : 0.0;
    }
    for (int k = 0; k < 2; k++) to[k] = times(ends[k], 1.0 / length(ends[k]));
    const double chord = length(minus(to[1], to[0]));
    const double margin = 2 * placed.reach / height + chord * chord / 4 + LEAST_TOLERANCE_REL;
    std::array<Point, 2> box;
    const bool is_whole = !(margin < 1.0) || !std::isfinite(chord);
    for (int axis = 0; axis < 3; axis++) {
        const double low = is_whole ? -2.0 : std::min(to[0][axis], to[1][axis]) - margin;
        const double high = is_whole ? 2.0 : std::max(to[0][axis], to[1][axis]) + margin;
        box[0][axis] = std::max(low / 4, -0.5);
        box[1][axis] = std::min(high / 4, 0.5);
    }
    return box;
}

// Faces first ... last - 1 of a fan, in a tree of their directions from hubs[0] or, unless hubs[1]
// is -1, about the edge of both.
Fan fan_of(const Placed &placed, const Fan &of, int64_t first, int64_t last,
           const std::array<int32_t, 2> &hubs, int64_t most) {
    const int64_t n = last - first;
    Room<double> points(9 * n);
    Room<int32_t> own(3 * n), others(2 * n, hubs[0]), chosen(n);
    std::iota(own.begin(), own.end(), 0);
    for (int64_t f = 0; f < n; f++) {
        const int32_t *corner = of.tree.faces.rows().data + 3 * (first + f);
        int32_t *const its = others.begin() + 2 * f; // one of faces about an edge
        std::copy_if(corner, corner + 3, its,
                     [&](int32_t v) { return v != hubs[0] && v != hubs[1]; });
        const auto box = box_of_directions(placed, its, hubs);
        for (int k = 0; k < 3; k++)
            std::copy_n(box[k > 0].begin(), 3, points.begin() + 9 * f + 3 * k);
        chosen[f] = of.chosen[first + f];
    }
    Fan fan = fan_over(points, own, chosen,
                       hubs[1] < 0 ? fans_of(others, 2, most) : Room<int32_t>(n, -1));
    for (int64_t f = 0; f < n; f++)
        std::copy_n(of.tree.faces.rows().data + 3 * (first + fan.tree.order[f]), 3,
                    fan.tree.faces.begin() + 3 * f);
    return fan;
}

// Fan of all faces of each node, -1 for none; none at all without fans.
Room<int32_t> fans_of_nodes(const Room<int32_t> &fans, int64_t n_leaves) {
    const auto row = fans.rows();
    if (std::all_of(row.begin(), row.end(), [](int32_t fan) { return fan < 0; })) return {};
    Room<int32_t> of_nodes(2 * n_leaves, -1);
    for (int64_t leaf = 0; leaf * LEAF < fans.size(); leaf++) {
        const int64_t first = leaf * LEAF, end = std::min(first + LEAF, fans.size());
        const bool is_one =
            end - first == LEAF && std::all_of(row.data + first, row.data + end,
                                               [&](int32_t fan) { return fan == row[first]; });
        if (is_one) of_nodes[n_leaves + leaf] = row[first];
    }
    for (int64_t node = n_leaves - 1; node > 0; node--)
        if (of_nodes[2 * node] == of_nodes[2 * node + 1]) of_nodes[node] = of_nodes[2 * node];
    return of_nodes;
}

void share(int64_t n, int64_t n_threads, const Worker &work) {
    Pace pace = INFINITY;
    const GoOn go_on;
    const std::function<Worker()> make = [&] { return work; };
    Sharing(n, make, pace, go_on).run(std::min(n, n_threads));
}

// Marks the faces of a tree that are in contact.
void mark_in_tree(const Placed &placed, const Room<double> &points, const Fan &fan,
                  Int32Array labels, const ContactOptions &options, Room<bool> &touching) {
    const Tree &tree = fan.tree;
    const int64_t n = tree.n_faces(), n_leaves = (n + LEAF - 1) / LEAF;
    Room<bool> done(2 * tree.n_leaves()), marks(n, false);
    for (int64_t node = 0; node < done.size(); node++) done[node] = tree.nodes[6 * node] == INF;
    const Room<int32_t> of_nodes = fans_of_nodes(fan.fans, tree.n_leaves());
    Room<int32_t> own(labels.rows() ? n : 0);
    for (int64_t f = 0; f < own.size(); f++) own[f] = labels[fan.chosen[f]];
    const int64_t n_parts = (n_leaves + options.leaves_a_part - 1) / options.leaves_a_part;
    share(n_parts, options.n_threads, [&](int64_t part) {
        const int64_t first = part * options.leaves_a_part;
        const int64_t n_steps = mesh::mark_contacts<int32_t>(
            placed.surface(tree), points.rows<3>(), tree.with(of_nodes), first,
            std::min(first + options.leaves_a_part, n_leaves),
            {own.rows(), done.rows(), marks.rows()});
        if (options.n_steps) *options.n_steps += n_steps;
    });
    for (int64_t f = 0; f < n; f++)
        if (marks[f]) touching[fan.chosen[f]] = true;
}

// Takes the tree of each fan among some faces, in turn, and those of the fans about an edge in it;
// faces of a fan follow one another, after the rest.
template <class Take>
void for_each_fan(const Placed &placed, const Fan &of, int64_t most, const Take &take,
                  int32_t hub = -1) {
    const auto fans = of.fans.rows();
    for (int64_t first = std::upper_bound(fans.begin(), fans.end(), -1) - fans.begin();
         first < fans.rows();) {
        const int64_t last =
            std::upper_bound(fans.begin() + first, fans.end(), fans[first]) - fans.begin();
        const Fan fan = fan_of(placed, of, first, last, {fans[first], hub}, most);
        take(fan);
        for_each_fan(placed, fan, most, take, fans[first]);
        first = last;
    }
}

template <class Is> Room<int32_t> rows_where(int64_t n, Is is) {
    int64_t count = 0;
    for (int64_t f = 0; f < n; f++) count += is(f);
    Room<int32_t> rows(count);
    count = 0;
    for (int64_t f = 0; f < n; f++)
        if (is(f)) rows[count++] = int32_t(f);
    return rows;
}
} // namespace

Room<bool> find_touching(const Welded &mesh, BoolArray is_flat, Int32Array labels, double tolerance,
                         const ContactOptions &options) {
    const int64_t n = mesh.faces.rows();
    require(is_flat.rows() == n && (labels.rows() == 0 || labels.rows() == n),
            "is_flat and labels must have one value for each face");
    require(options.leaves_a_part > 0 && options.n_threads > 0,
            "there must be a thread, and a leaf for it");
    Room<bool> touching(n, false);
    Room<int32_t> chosen = rows_where(n, [&](int64_t f) { return !is_flat[f]; });
    if (chosen.size() < 2) return touching;
    const Placed placed = place(mesh, chosen, tolerance, options.most_at_corner);
    mark_in_tree(placed, placed.points, placed.all, labels, options, touching);
    Room<double> nowhere; // points without extent: their planes separate nothing
    for_each_fan(placed, placed.all, options.most_at_corner, [&](const Fan &fan) {
        if (nowhere.size() == 0) nowhere = Room<double>(placed.points.size(), 0.0);
        mark_in_tree(placed, nowhere, fan, labels, options, touching);
    });
    return touching;
}

Contacts find_partners(const Welded &mesh, Room<bool> touching, double tolerance,
                       const ContactOptions &options) {
    const int64_t n = mesh.faces.rows();
    require(touching.size() == n, "touching must have one value for each face");
    Room<int32_t> chosen = rows_where(n, [&](int64_t f) { return touching[f]; });
    std::vector<std::pair<int32_t, int32_t>> pairs;
    if (chosen.size()) {
        const int64_t room = PAIRS_A_FACE * chosen.size();
        const Placed placed =
            place(mesh, chosen, ROUNDING_FACTOR * tolerance, options.most_at_corner);
        Room<int32_t> rows(2 * room);
        int64_t most = 0;
        int64_t n_steps = 0;
        const auto list = [&](const Fan &fan) {
            if (most > room) return;
            const Tree &tree = fan.tree;
            const int64_t found = mesh::list_contacts<int32_t>(
                placed.surface(tree), tree.with(fans_of_nodes(fan.fans, tree.n_leaves())),
                rows.rows<2>(), n_steps);
            most = std::max(most, found);
            for (int64_t k = 0; k < std::min(found, room); k++) {
                const int32_t f = fan.chosen[rows[2 * k]], g = fan.chosen[rows[2 * k + 1]];
                pairs.emplace_back(f, g);
                pairs.emplace_back(g, f);
            }
        };
        list(placed.all);
        for_each_fan(placed, placed.all, options.most_at_corner, list);
        sort_range(pairs.begin(), pairs.end()); // those of one fan may be in both trees
        pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
        if (most > room || int64_t(pairs.size()) > 2 * room) pairs.clear();
        if (options.n_steps) *options.n_steps += n_steps;
    }
    Room<int64_t> counts(n, 0), starts(n + 1);
    for (const auto &[f, g] : pairs) counts[f]++;
    std::erase_if(pairs, [&](const auto &pair) { return counts[pair.first] > MOST_PARTNERS; });
    starts[0] = 0;
    for (int64_t f = 0; f < n; f++)
        starts[f + 1] = starts[f] + (counts[f] > MOST_PARTNERS ? 0 : counts[f]);
    Room<int32_t> partners{int64_t(pairs.size())};
    for (size_t k = 0; k < pairs.size(); k++) partners[int64_t(k)] = pairs[k].second;
    return {std::move(touching), std::move(starts), std::move(partners)};
}

ContactFinder finder_of(const Welded &mesh, BoolArray is_flat, double diagonal, Owner owner,
                        int64_t n_threads) {
    const auto tolerance_at = [=](double distance) {
        return CONTACT * std::pow(10.0, decade_of(distance, diagonal)) * diagonal;
    };
    const auto touching = [=](Int32Array labels, double distance) {
        return find_touching(mesh, is_flat, labels, tolerance_at(distance),
                             {.n_threads = n_threads});
    };
    const auto hides_its_back = [=](double distance) {
        const Room<int32_t> parts = find_outward_parts(mesh);
        if (parts.size() == 0) return false;
        Room<bool> found = touching(parts.rows(), distance);
        return std::find(found.begin(), found.end(), true) == found.end();
    };
    const auto find = [=, owner = std::move(owner)](double distance) {
        return find_partners(mesh, touching({}, distance), tolerance_at(distance));
    };
    return {diagonal, find, hides_its_back};
}

} // namespace rastercov::engine
