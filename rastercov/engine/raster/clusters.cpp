// Clusters: groups of up to 64 faces that lie close together and face the same way.
//
// A pose culls a whole cluster that is outside the image or back-facing without reading its faces.
// Each cluster has its own consecutive copy of its vertices, which fits the level-1 cache.
//
// Faces are grouped by the main direction of their normals, then by median splits of their
// centroids. They are in an order; `starts` has the first place of each cluster in it, and the
// place after the last. `marks` has a number for each vertex: -1 at first, then the last cluster
// that had it.
//
// A. Kubisch. Introduction to Turing Mesh Shaders. 2018, for the data layout.
// C. A. R. Hoare. Algorithm 65: Find. 1961, for the splits at medians.
//
// Twins: tests/raster/test_clusters.py.
#include "raster/clusters.hpp"
#include "interrupt.hpp"
#include "range.hpp"
#include "solver/room.hpp"
#include "vector.hpp"
#include <cmath>
#include <limits>

namespace rastercov {
namespace raster {
namespace {

using engine::Room;
using Order = Int32Array;
using Starts = Int32Array;
using Words = Column<int32_t>;

// Metres: faces of a smaller mesh are not split by position.
constexpr double MIN_EXTENT = 1e-290;
constexpr int DIRECTIONS = 6;
// So that slots of 32 bits number the vertices of all clusters.
constexpr int64_t MOST_FACES = INT32_MAX / (3 * 8);

int64_t pad(int64_t n, int64_t step) { return (n + step - 1) / step * step; }

Vector corner_of(const Points &vertices, int32_t v) {
    return {vertices(v, 0), vertices(v, 1), vertices(v, 2)};
}

// Centroids of faces, 0 to 1, and main directions of normals, 0 to 5.
void face_centroids(const Points &vertices, const Triples &faces, const double (&low)[3],
                    double scale, bool is_wound, const Array<float, 3, Any> &centroids,
                    const Column<uint8_t> &directions) {
    Poll poll(1 << 16);
    for (int64_t f = 0; f < faces.rows(); f++) {
        poll();
        const int32_t a = faces(f, 0), b = faces(f, 1), c = faces(f, 2);
        double widest = -1.0;
        directions[f] = 0;
        for (int k = 0; k < 3; k++) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            const double normal =
                (vertices(b, i) - vertices(a, i)) * (vertices(c, j) - vertices(a, j)) -
                (vertices(c, i) - vertices(a, i)) * (vertices(b, j) - vertices(a, j));
            if (std::abs(normal) > widest) {
                widest = std::abs(normal);
                directions[f] = uint8_t(2 * k + (is_wound && normal > 0));
            }
            const double centroid = (vertices(a, k) + vertices(b, k) + vertices(c, k)) / 3;
            centroids(k, f) = float((centroid - low[k]) * scale);
            require(std::isfinite(centroids(k, f)), "vertices must be finite");
        }
    }
}

// Reorders a part of the order so that its first `first` faces are the least along an axis, ties
// by index.
void nth_element(const Words &order, int64_t begin, int64_t end, int64_t first,
                 const Column<const float> &centroids) {
    const auto is_before = [&](int32_t f, int32_t g) {
        return centroids[f] < centroids[g] || (centroids[f] == centroids[g] && f < g);
    };
    int64_t low = begin;
    int64_t high = end - 1;
    const int64_t at = begin + first;
    while (low < high) {
        // Pseudo-random pivot: no quadratic time on sorted or adversarial input.
        const int32_t pivot = order[low + int64_t(uint64_t(high - low) * 2654435769ull >> 32)];
        int64_t i = low;
        int64_t j = high;
        while (i <= j) {
            while (is_before(order[i], pivot)) i++;
            while (is_before(pivot, order[j])) j--;
            if (i <= j) std::swap(order[i++], order[j--]);
        }
        if (at <= j) high = j;
        else if (at >= i) low = i;
        else return;
    }
}

// Number of distinct vertices of some faces; sets their marks to the unused value `mark`.
int64_t n_vertices_of(const Triples &faces, const Words &order, int64_t begin, int64_t end,
                      const Words &marks, int32_t mark) {
    int64_t n = 0;
    for (int64_t i = begin; i < end; i++)
        for (int j = 0; j < 3; j++) {
            int32_t &its = marks[faces(order[i], j)];
            n += its != mark;
            its = mark;
        }
    return n;
}

// The longest side of the box of the centroids of some faces.
int longest_axis(const Words &order, int64_t begin, int64_t end,
                 const Array<const float, 3, Any> &centroids) {
    float longest = -1.0f;
    int axis = 0;
    for (int k = 0; k < 3; k++) {
        const auto along = centroids[k];
        float least = along[order[begin]];
        float greatest = least;
        for (int64_t i = begin; i < end; i++) {
            least = std::min(least, along[order[i]]);
            greatest = std::max(greatest, along[order[i]]);
        }
        if (greatest - least > longest) {
            longest = greatest - least;
            axis = k;
        }
    }
    return axis;
}

// Numbers of clusters, of face slots and of padded vertices.
struct Sizes {
    int64_t n, n_slots, n_points;
};
// Splits groups of faces into clusters.
//
// Median splits across the longest side, at multiples of a cluster or of a vector of faces.
Sizes split_at_medians(const Triples &faces, const Words &order,
                       const int64_t (&direction_starts)[DIRECTIONS + 1],
                       const Array<float, 3, Any> &centroids, const Words &marks,
                       const Words &starts) {
    Sizes sizes = {};
    int64_t stack[64][2];
    int32_t mark = 0;
    for (int group = 0; group < DIRECTIONS; group++) {
        stack[0][0] = direction_starts[group];
        stack[0][1] = direction_starts[group + 1];
        int n_left = stack[0][0] < stack[0][1];
        while (n_left) {
            poll_interrupt();
            const auto [begin, end] = stack[--n_left];
            const int64_t size = end - begin;
            const int64_t n_vertices =
                size <= FACES ? n_vertices_of(faces, order, begin, end, marks, ++mark) : INT32_MAX;
            if (n_vertices <= VERTICES) {
                starts[sizes.n++] = int32_t(begin);
                sizes.n_slots += pad(size, LANES);
                sizes.n_points += pad(n_vertices, VERTEX_STEP);
                continue;
            }
            const int64_t whole = size > FACES ? FACES : LANES;
            const int64_t first = std::max(whole, (size + whole) / (2 * whole) * whole);
            nth_element(order, begin, end, first,
                        centroids[longest_axis(order, begin, end, centroids)]);
            stack[n_left][0] = begin + first;
            stack[n_left++][1] = end;
            stack[n_left][0] = begin;
            stack[n_left++][1] = begin + first;
        }
    }
    starts[sizes.n] = int32_t(order.rows());
    return sizes;
}

// Indexes the vertices of each cluster from 0, in bytes, and copies their positions in that order.
void fill_clusters(const Points &vertices, const Triples &faces, const Order &order,
                   const Starts &starts, const Words &marks, ClusterMemory &out) {
    const int64_t n = starts.rows() - 1;
    const Room<uint8_t> memory(marks.rows());
    const Column<uint8_t> local = memory.all();
    Room<int32_t> lines(order.rows());
    int64_t slot = 0;
    int64_t vertex = 0;
    int64_t line = 0;
    for (int64_t k = 0; k < n; k++) {
        int32_t held[VERTICES];
        int count = 0;
        for (int64_t i = starts[k]; i < starts[k + 1]; i++) {
            const int32_t f = order[i], own = f >> LINE_BITS;
            int64_t place = out.line_starts.all[k];
            while (place < line && lines[place] != own) place++;
            if (place == line) lines[line++] = own;
            int32_t packed = 0;
            for (int j = 0; j < 3; j++) {
                const int32_t v = faces(f, j);
                if (marks[v] != k) {
                    marks[v] = int32_t(k);
                    held[count] = v;
                    local[v] = uint8_t(count++);
                }
                packed |= int32_t(local[v]) << 8 * j;
            }
            out.corners.all[slot] = packed;
            out.faces.all[slot++] = f;
        }
        const int64_t width = pad(count, VERTEX_STEP);
        for (int axis = 0; axis < 3; axis++)
            for (int64_t i = 0; i < width; i++)
                out.points.all[3 * vertex + axis * width + i] =
                    vertices(held[std::min<int64_t>(i, count - 1)], axis);
        slot = pad(slot, LANES);
        vertex += width;
        out.line_starts.all[k + 1] = int32_t(line);
        out.face_starts.all[k + 1] = int32_t(slot);
        out.vertex_starts.all[k + 1] = int32_t(vertex);
    }
    out.lines = Buffer<int32_t>(line);
    std::copy_n(lines.data(), line, out.lines.all.data);
}

// Sphere, cone of normals, planes and altitudes of clusters, see Clusters.bounds.
void cluster_bounds(const Points &vertices, const Triples &faces, const Order &order,
                    const Starts &starts, const Starts &vertex_starts, const Column<double> &points,
                    const Array<double, BOUNDS_OF_CLUSTER, Any> &bounds) {
    constexpr double INF = std::numeric_limits<double>::infinity();
    Vector normals[FACES];
    for (int64_t k = 0; k + 1 < starts.rows(); k++) {
        const int64_t begin = 3ll * vertex_starts[k];
        const int64_t width = vertex_starts[k + 1] - vertex_starts[k];
        for (int axis = 0; axis < 3; axis++) {
            const auto along = part(points, begin + axis * width, width);
            rastercov::Range all;
            for (const double x : along) all.add(x);
            bounds(axis, k) = 0.5 * (all.least + all.most);
        }
        const Vector middle = {bounds(0, k), bounds(1, k), bounds(2, k)};
        double squared = 0.0;
        for (int64_t i = begin; i < begin + width; i++) {
            const Vector away =
                Vector{points[i], points[i + width], points[i + 2 * width]} - middle;
            squared = std::max(squared, dot(away, away));
        }
        bounds(RADIUS, k) = std::sqrt(squared);
        Vector sum = {0.0, 0.0, 0.0};
        double offset = INF;
        double altitude = INF;
        const int n = starts[k + 1] - starts[k];
        for (int i = 0; i < n; i++) {
            const auto face = faces[order[starts[k] + i]];
            const Vector a = corner_of(vertices, face[0]);
            const Vector ab = corner_of(vertices, face[1]) - a;
            const Vector ac = corner_of(vertices, face[2]) - a;
            const Vector bc = ac - ab;
            Vector normal = cross(ab, ac);
            const double doubled = length(normal);
            const double longest = std::max(std::max(dot(ab, ab), dot(ac, ac)), dot(bc, bc));
            altitude = std::min(altitude, longest > 0 ? doubled / std::sqrt(longest) : 0.0);
            const double scale = doubled > 0 ? 1.0 / doubled : 0.0;
            normal = scale * normal;
            normals[i] = normal;
            sum = sum + normal;
            offset = std::min(offset, dot(normal, a - middle));
        }
        const double size = length(sum);
        const Vector axis = (size > 0 ? 1.0 / size : 0.0) * sum;
        double cosine = size > 0 ? 1.0 : -1.0;
        for (int i = 0; i < n; i++) cosine = std::min(cosine, dot(normals[i], axis));
        // Rounding, of cosines near 1 above all.
        const double angle = std::acos(std::max(-1.0, cosine)) + 1e-7;
        bounds(CONE_AXIS, k) = axis.x;
        bounds(CONE_AXIS + 1, k) = axis.y;
        bounds(CONE_AXIS + 2, k) = axis.z;
        bounds(CONE_COS, k) = std::cos(angle);
        bounds(CONE_SIN, k) = std::sin(angle);
        bounds(PLANE_OFFSET, k) = offset;
        bounds(ALTITUDE, k) = cosine > 0.01 ? altitude : 0.0;
    }
}

// Faces by direction, those of one in their order; the first place of each direction.
Room<int32_t> order_by(const Column<uint8_t> &directions, int64_t (&starts)[DIRECTIONS + 1]) {
    std::fill_n(starts, DIRECTIONS + 1, 0);
    for (const uint8_t direction : directions) starts[direction + 1]++;
    for (int k = 0; k < DIRECTIONS; k++) starts[k + 1] += starts[k];
    int64_t next[DIRECTIONS];
    std::copy_n(starts, DIRECTIONS, next);
    Room<int32_t> order(directions.rows());
    for (int64_t f = 0; f < directions.rows(); f++) order[next[directions[f]]++] = int32_t(f);
    return order;
}

// Places of vertices from a centre; their least place, and the longest side of their box.
struct Moved {
    Room<double> memory;
    double low[3], extent = 0;

    Moved(const Points &vertices, const Array<const double, 3> &centre) : memory(vertices.size()) {
        for (int k = 0; k < 3; k++) {
            low[k] = INFINITY;
            double high = -INFINITY;
            for (int64_t v = 0; v < vertices.rows(); v++) {
                const double x = memory[3 * v + k] = vertices(v, k) - centre[k];
                low[k] = std::min(low[k], x);
                high = std::max(high, x);
            }
            extent = std::max(extent, high - low[k]);
        }
    }
};

} // namespace

ClusterMemory group_faces(const Points &given, const Triples &faces,
                          const Array<const double, 3> &centre, bool is_wound) {
    const int64_t n_faces = faces.rows(), n_vertices = given.rows();
    expect(n_faces > 0 && n_faces <= MOST_FACES, "1 to 89478485 faces", n_faces, "split the mesh");
    require_indices(faces, n_vertices, "faces must hold rows of vertices");
    const Moved moved(given, centre);
    const Points vertices = moved.memory.rows<3>(n_vertices);
    Room<int32_t> order, starts(n_faces + 1), marks(n_vertices, -1);
    Sizes sizes;
    {
        const Room<float> centroids(3 * n_faces);
        const Room<uint8_t> directions(n_faces);
        const Array<float, 3, Any> rows = {centroids.data(), {3, n_faces}};
        const double scale = moved.extent > MIN_EXTENT ? 1 / moved.extent : 0.0;
        face_centroids(vertices, faces, moved.low, scale, is_wound, rows, directions.all());
        int64_t direction_starts[DIRECTIONS + 1];
        order = order_by(directions.all(), direction_starts);
        sizes =
            split_at_medians(faces, order.all(), direction_starts, rows, marks.all(), starts.all());
    }
    ClusterMemory out(sizes.n, sizes.n_slots, sizes.n_points);
    const Starts used = starts.first(sizes.n + 1);
    marks.fill(-1);
    fill_clusters(vertices, faces, order.all(), used, marks.all(), out);
    cluster_bounds(vertices, faces, order.all(), used, out.vertex_starts.all, out.points.all,
                   out.bounds_of());
    return out;
}

} // namespace raster
} // namespace rastercov
