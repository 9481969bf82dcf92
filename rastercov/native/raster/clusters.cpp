// Clusters: groups of up to 64 faces that lie close together and face the same way.
//
// rastercov.raster.cpu.clusters calls these loops one after the other. Faces are in an order;
// `starts` has the first place of each cluster in it, and the place after the last. `marks` has a
// number for each vertex: -1 at first, then the last cluster that had it.
//
// C. A. R. Hoare. Algorithm 65: Find. 1961, for the splits at medians.
//
// Twins: tests/raster/test_clusters.py.
#include "bind.hpp"
#include "raster/records.hpp"

namespace rastercov {
namespace raster {
namespace {

// The vertices of a cluster are padded to a multiple of this, by the last one.
constexpr int64_t VERTEX_STEP = 8;

using Points = Array<const double, Any, 3>;
using Triples = Array<const int32_t, Any, 3>;
using Order = Array<const int32_t, Any>;
using Starts = Array<const int32_t, Any>;
using Words = Array<int32_t, Any>;

int64_t padded(int64_t n, int64_t step) { return (n + step - 1) / step * step; }

struct Vector {
    double x, y, z;
};
double dot(Vector p, Vector q) { return p.x * q.x + p.y * q.y + p.z * q.z; }
// From vertex q to vertex p.
Vector difference(const Points &vertices, int32_t p, int32_t q) {
    return {vertices(p, 0) - vertices(q, 0), vertices(p, 1) - vertices(q, 1),
            vertices(p, 2) - vertices(q, 2)};
}

// Centroids of faces, 0 to 1, and main directions of normals, 0 to 5.
void face_centroids(Points vertices, Triples faces, Array<const double, 3> low, double scale,
                    bool is_wound, Array<float, 3, Any> centroids, Array<uint8_t, Any> directions) {
    require(centroids.extent(1) == faces.rows() && directions.rows() == faces.rows(),
            "centroids and directions must have one element for each face");
    require_indices(faces, vertices.rows(), "faces must hold rows of vertices");
    for (int64_t f = 0; f < faces.rows(); f++) {
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
        }
    }
}

// Reorders a part of the order so that its first `first` faces are the least along an axis, ties
// by index.
void nth_element(const Words &order, int64_t begin, int64_t end, int64_t first,
                 const Array<const float, Any> &centroids) {
    const auto is_before = [&](int32_t f, int32_t g) {
        return centroids[f] < centroids[g] || (centroids[f] == centroids[g] && f < g);
    };
    int64_t low = begin, high = end - 1;
    const int64_t at = begin + first;
    while (low < high) {
        // Pseudo-random pivot: no quadratic time on sorted or adversarial input.
        const int32_t pivot = order[low + int64_t(uint64_t(high - low) * 2654435769ull >> 32)];
        int64_t i = low, j = high;
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
            n += its != mark, its = mark;
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
        float least = along[order[begin]], greatest = least;
        for (int64_t i = begin; i < end; i++) {
            least = std::min(least, along[order[i]]);
            greatest = std::max(greatest, along[order[i]]);
        }
        if (greatest - least > longest) longest = greatest - least, axis = k;
    }
    return axis;
}

// Splits groups of faces into clusters; writes the number of clusters and of face slots to `sizes`.
//
// Median splits across the longest side, at multiples of a cluster or of a vector of faces.
void split_at_medians(Triples faces, Words order, Array<const int64_t, Any> direction_starts,
                      Array<const float, 3, Any> centroids, Words marks, Words starts,
                      Array<int64_t, 2> sizes) {
    const int64_t n_faces = faces.rows(), groups = direction_starts.rows() - 1;
    require(order.rows() == n_faces && centroids.extent(1) == n_faces &&
                starts.rows() == n_faces + 1,
            "order and centroids must have one element for each face, and starts one more");
    require(groups >= 0 && direction_starts[0] == 0 && direction_starts[groups] == n_faces,
            "direction_starts must be from 0 to the number of faces");
    for (int64_t group = 0; group < groups; group++)
        require(direction_starts[group] <= direction_starts[group + 1],
                "direction_starts must rise");
    require_indices(order, n_faces, "order must hold faces");
    require_indices(faces, marks.rows(), "faces must hold rows of marks");
    for (const float c : centroids) require(std::isfinite(c), "centroids must be finite");
    int64_t n = 0, n_slots = 0, stack[64][2];
    int32_t mark = 0;
    for (int64_t group = 0; group < groups; group++) {
        stack[0][0] = direction_starts[group], stack[0][1] = direction_starts[group + 1];
        int n_left = stack[0][0] < stack[0][1];
        while (n_left) {
            const auto [begin, end] = stack[--n_left];
            const int64_t size = end - begin;
            if (size <= FACES &&
                n_vertices_of(faces, order, begin, end, marks, ++mark) <= VERTICES) {
                starts[n++] = int32_t(begin);
                n_slots += padded(size, LANES);
                continue;
            }
            const int64_t whole = size > FACES ? FACES : LANES;
            const int64_t first = std::max(whole, (size + whole) / (2 * whole) * whole);
            nth_element(order, begin, end, first,
                        centroids[longest_axis(order, begin, end, centroids)]);
            stack[n_left][0] = begin + first, stack[n_left++][1] = end;
            stack[n_left][0] = begin, stack[n_left++][1] = begin + first;
        }
    }
    starts[n] = int32_t(order.rows());
    sizes[0] = n, sizes[1] = n_slots;
}

// Clusters of at most FACES faces, of VERTICES vertices each.
void require_clusters(const Triples &faces, const Order &order, const Starts &starts,
                      int64_t n_vertices) {
    const int64_t n = starts.rows() - 1;
    require(n >= 0 && starts[0] == 0 && starts[n] == order.rows(),
            "starts must be from 0 to the length of order");
    for (int64_t k = 0; k < n; k++)
        require(starts[k] < starts[k + 1] && starts[k + 1] - starts[k] <= FACES,
                "starts must rise by 1 to 64");
    require_indices(order, faces.rows(), "order must hold faces");
    require_indices(faces, n_vertices, "faces must hold rows of vertices");
}

// Indexes the vertices of each cluster from 0, in bytes.
void index_local_vertices(Triples faces, Order order, Starts starts, Words marks,
                          Array<uint8_t, Any> local, Words corners, Words face_of,
                          Words face_starts, Words vertex_starts, Words lines, Words line_starts) {
    const int64_t n = starts.rows() - 1;
    require(local.rows() == marks.rows(), "marks and local must have one row for each vertex");
    require_clusters(faces, order, starts, marks.rows());
    int64_t n_slots = 0;
    for (int64_t k = 0; k < n; k++) n_slots += padded(starts[k + 1] - starts[k], LANES);
    require(corners.rows() >= n_slots && face_of.rows() >= n_slots && lines.rows() == order.rows(),
            "corners and face_of must have one row for each slot, lines one for each face");
    require(face_starts.rows() == n + 1 && vertex_starts.rows() == n + 1 &&
                line_starts.rows() == n + 1,
            "starts must have one row for each cluster, and one more");
    int64_t slot = 0, vertex = 0, line = 0;
    face_starts[0] = vertex_starts[0] = line_starts[0] = 0;
    for (int64_t k = 0; k < n; k++) {
        int count = 0;
        for (int64_t i = starts[k]; i < starts[k + 1]; i++) {
            const int32_t f = order[i], own = f >> LINE_BITS;
            int64_t place = line_starts[k];
            while (place < line && lines[place] != own) place++;
            if (place == line) lines[line++] = own;
            int32_t packed = 0;
            for (int j = 0; j < 3; j++) {
                const int32_t v = faces(f, j);
                if (marks[v] != k) {
                    require(count < VERTICES, "clusters must have at most 64 vertices");
                    marks[v] = int32_t(k);
                    local[v] = uint8_t(count++);
                }
                packed |= int32_t(local[v]) << 8 * j;
            }
            corners[slot] = packed;
            face_of[slot++] = f;
        }
        slot = padded(slot, LANES), vertex += padded(count, VERTEX_STEP);
        line_starts[k + 1] = int32_t(line);
        face_starts[k + 1] = int32_t(slot), vertex_starts[k + 1] = int32_t(vertex);
    }
}

void require_vertex_starts(const Starts &vertex_starts, const Starts &starts, int64_t n_points) {
    const int64_t n = starts.rows() - 1;
    require(vertex_starts.rows() == n + 1 && vertex_starts[0] == 0 &&
                3ll * vertex_starts[n] <= n_points,
            "vertex_starts must have one row for each cluster, and one more, within points");
    for (int64_t k = 0; k < n; k++)
        require(vertex_starts[k] < vertex_starts[k + 1], "vertex_starts must rise");
}

// Copies vertex positions to their clusters, in the order of the local indices.
void gather_positions(Points vertices, Triples faces, Order order, Starts starts, Words marks,
                      Starts vertex_starts, Array<double, Any> points) {
    require(marks.rows() == vertices.rows(), "marks must have one row for each vertex");
    require_clusters(faces, order, starts, vertices.rows());
    require_vertex_starts(vertex_starts, starts, points.rows());
    for (int64_t k = 0; k + 1 < starts.rows(); k++) {
        const int64_t begin = 3ll * vertex_starts[k];
        const int64_t width = vertex_starts[k + 1] - vertex_starts[k];
        int64_t count = 0;
        for (int64_t i = starts[k]; i < starts[k + 1]; i++)
            for (int j = 0; j < 3; j++) {
                const int32_t v = faces(order[i], j);
                if (marks[v] == k) continue;
                require(count < width, "vertex_starts must leave room for the vertices");
                marks[v] = int32_t(k);
                for (int axis = 0; axis < 3; axis++)
                    points[begin + axis * width + count] = vertices(v, axis);
                count++;
            }
        for (; count > 0 && count < width; count++)
            for (int axis = 0; axis < 3; axis++) {
                const int64_t at = begin + axis * width + count;
                points[at] = points[at - 1];
            }
    }
}

// Sphere, cone of normals, planes and altitudes of clusters, see Clusters.bounds.
void cluster_bounds(Points vertices, Triples faces, Order order, Starts starts,
                    Starts vertex_starts, Array<const double, Any> points,
                    Array<double, BOUNDS_OF_CLUSTER, Any> bounds) {
    constexpr double INF = std::numeric_limits<double>::infinity();
    require_clusters(faces, order, starts, vertices.rows());
    require_vertex_starts(vertex_starts, starts, points.rows());
    require(bounds.extent(1) >= starts.rows() - 1, "bounds must have one column for each cluster");
    Vector normals[FACES];
    for (int64_t k = 0; k + 1 < starts.rows(); k++) {
        const int64_t begin = 3ll * vertex_starts[k];
        const int64_t width = vertex_starts[k + 1] - vertex_starts[k];
        for (int axis = 0; axis < 3; axis++) {
            const auto along = part(points, begin + axis * width, width);
            double low = along[0], high = low;
            for (const double x : along) low = std::min(low, x), high = std::max(high, x);
            bounds(axis, k) = 0.5 * (low + high);
        }
        const Vector middle = {bounds(0, k), bounds(1, k), bounds(2, k)};
        double squared = 0.0;
        for (int64_t i = begin; i < begin + width; i++) {
            const Vector away = {points[i] - middle.x, points[i + width] - middle.y,
                                 points[i + 2 * width] - middle.z};
            squared = std::max(squared, dot(away, away));
        }
        bounds(RADIUS, k) = std::sqrt(squared);
        Vector sum = {0.0, 0.0, 0.0};
        double offset = INF, altitude = INF;
        const int n = starts[k + 1] - starts[k];
        for (int i = 0; i < n; i++) {
            const auto face = faces[order[starts[k] + i]];
            const Vector ab = difference(vertices, face[1], face[0]);
            const Vector ac = difference(vertices, face[2], face[0]);
            const Vector bc = {ac.x - ab.x, ac.y - ab.y, ac.z - ab.z};
            Vector normal = {ab.y * ac.z - ab.z * ac.y, ab.z * ac.x - ab.x * ac.z,
                             ab.x * ac.y - ab.y * ac.x};
            const double doubled = std::sqrt(dot(normal, normal));
            const double longest = std::max(std::max(dot(ab, ab), dot(ac, ac)), dot(bc, bc));
            altitude = std::min(altitude, longest > 0 ? doubled / std::sqrt(longest) : 0.0);
            const double scale = doubled > 0 ? 1.0 / doubled : 0.0;
            normal = {normal.x * scale, normal.y * scale, normal.z * scale};
            normals[i] = normal;
            sum = {sum.x + normal.x, sum.y + normal.y, sum.z + normal.z};
            const Vector away = {vertices(face[0], 0) - middle.x, vertices(face[0], 1) - middle.y,
                                 vertices(face[0], 2) - middle.z};
            offset = std::min(offset, dot(normal, away));
        }
        const double length = std::sqrt(dot(sum, sum)), scale = length > 0 ? 1.0 / length : 0.0;
        const Vector axis = {sum.x * scale, sum.y * scale, sum.z * scale};
        double cosine = length > 0 ? 1.0 : -1.0;
        for (int i = 0; i < n; i++) cosine = std::min(cosine, dot(normals[i], axis));
        // Rounding, of cosines near 1 above all.
        const double angle = std::acos(std::max(-1.0, cosine)) + 1e-7;
        bounds(CONE_AXIS, k) = axis.x, bounds(CONE_AXIS + 1, k) = axis.y;
        bounds(CONE_AXIS + 2, k) = axis.z;
        bounds(CONE_COS, k) = std::cos(angle), bounds(CONE_SIN, k) = std::sin(angle);
        bounds(PLANE_OFFSET, k) = offset;
        bounds(ALTITUDE, k) = cosine > 0.01 ? altitude : 0.0;
    }
}

} // namespace
} // namespace raster

void register_raster_clusters(nanobind::module_ &m) {
    using namespace raster;
    m.attr("VERTEX_STEP") = VERTEX_STEP;
    m.attr("FACES") = FACES;
    m.attr("VERTICES") = VERTICES;
    m.attr("LANES") = LANES;
    m.attr("LINE_BITS") = LINE_BITS;
    m.attr("BOUNDS_OF_CLUSTER") = int(BOUNDS_OF_CLUSTER);
    m.attr("RADIUS") = int(RADIUS);
    m.attr("ALTITUDE") = int(ALTITUDE);
    def(m, "face_centroids", face_centroids,
        "Centroids of faces, (3, F), 0 to 1, and main directions of normals, 0 to 5.", "vertices",
        "faces", "low", "scale", "is_wound", "centroids", "directions");
    def(m, "split_at_medians", split_at_medians,
        "Split groups of faces into clusters; `sizes` gets the numbers of clusters and of slots.",
        "faces", "order", "direction_starts", "centroids", "marks", "starts", "sizes");
    def(m, "index_local_vertices", index_local_vertices,
        "Index the vertices of each cluster from 0.", "faces", "order", "starts", "marks", "local",
        "corners", "face_of", "face_starts", "vertex_starts", "lines", "line_starts");
    def(m, "gather_positions", gather_positions, "Copy vertex positions to their clusters.",
        "vertices", "faces", "order", "starts", "marks", "vertex_starts", "points");
    def(m, "cluster_bounds", cluster_bounds,
        "Sphere, cone of normals, planes and altitudes of clusters.", "vertices", "faces", "order",
        "starts", "vertex_starts", "points", "bounds");
}

} // namespace rastercov
