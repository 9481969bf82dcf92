// Segments of a mesh: faces joined over shared edges while their normals stay together.
//
// A face joins when its normal is within an angle of every normal of the segment. The directions
// within less than 90 degrees of a direction form a convex set on the sphere, so it contains all
// normals of the segment if it contains the corners of their spherical convex hull: only those are
// tested. Projected from the centre on the tangent plane at the first normal (gnomonic projection)
// great circles are lines, and the hull is that of points in a plane. Their coordinates are
// integers, in units of 2^-24 of the radius of the angle on that plane, and their hull is exact.
// The error is the rounding to integers, at most 6e-8 tan(angle) radians; finer units would turn
// points on a line or a flat arc into corners.
//
// E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, (6.1),
// (6.2). A. M. Andrew. Another Efficient Algorithm for Convex Hulls in Two Dimensions. 1979.
//
// Twin: tests/placement/test_segments.py compares all normals of a segment.
#include "bind.hpp"
#include "interrupt.hpp"
#include "vector.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov {
namespace placement {
namespace {

using Normal = Array<const double, 3>;

enum Role : uint8_t { TASK, PASSED, BARRIER };
constexpr double UNITS = 1 << 24;      // grid units per radius
constexpr double MOST_UNITS = 1 << 28; // up to which products of differences fit 64 bits

struct Corner {
    int64_t x, y, face;
};

// Twice the area of the triangle of two corners and a point; positive to their left.
int64_t turn(const Corner &p, const Corner &q, int64_t x, int64_t y) {
    return (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
}

int64_t on_grid(double v) {
    return std::abs(v) <= MOST_UNITS ? std::llrint(v) : 0; // farther, and NaN: of no unit normal
}

// Convex hull of points on the grid: its corners, anticlockwise.
class Hull {
  public:
    const std::vector<Corner> &corners() const { return corners_; }

    void clear() { corners_.clear(); }

    // True where a point lies in a hull with an area, border included.
    bool holds(int64_t x, int64_t y) const {
        const size_t n = corners_.size();
        if (n < 3) return false;
        for (size_t i = 0; i < n; i++)
            if (turn(corners_[i], corners_[i + 1 < n ? i + 1 : 0], x, y) < 0) return false;
        return true;
    }

    void add(const Corner &point) {
        points_ = corners_;
        points_.push_back(point);
        std::stable_sort(points_.begin(), points_.end(), [](const Corner &a, const Corner &b) {
            return a.x < b.x || (a.x == b.x && a.y < b.y);
        });
        corners_.clear();
        add_chain(points_.begin(), points_.end());   // from left to right below
        add_chain(points_.rbegin(), points_.rend()); // then back above
        if (corners_.size() == 2 && corners_[0].x == corners_[1].x &&
            corners_[0].y == corners_[1].y)
            corners_.pop_back();
        if (corners_.empty()) corners_.push_back(points_[0]);
    }

  private:
    // Corners of the lower hull of points from left to right, without the last: the next chain
    // begins with it.
    template <class Iterator> void add_chain(Iterator first, Iterator last) {
        const size_t start = corners_.size();
        for (; first != last; ++first) {
            while (corners_.size() - start >= 2 &&
                   turn(corners_[corners_.size() - 2], corners_.back(), first->x, first->y) <= 0)
                corners_.pop_back();
            corners_.push_back(*first);
        }
        corners_.pop_back();
    }

    std::vector<Corner> corners_, points_;
};

// Two axes of the tangent plane at a unit normal.
struct Tangents {
    double u[3], v[3];

    explicit Tangents(const Normal &n) {
        int small = 0;
        for (int k = 1; k < 3; k++)
            if (std::abs(n[k]) < std::abs(n[small])) small = k;
        for (int k = 0; k < 3; k++) u[k] = -n[small] * n[k];
        u[small] += 1.0;
        const double length = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        for (double &part : u) part /= length;
        for (int k = 0; k < 3; k++) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            v[k] = n[i] * u[j] - n[j] * u[i];
        }
    }
};

int64_t grow_segments(FloatRows<3> normals, Column<const uint8_t> role, IntArray starts,
                      IntArray neighbours, double least_cosine, double radius,
                      Column<int64_t> labels) {
    const int64_t n_faces = role.rows();
    require(have_rows(n_faces, normals, labels),
            "normals, role and labels must have one row for each face");
    require_starts(starts, n_faces, neighbours.rows(),
                   "starts must rise, within the neighbours, one for each face and one more");
    require_indices(neighbours, n_faces, "neighbours must hold faces");
    const std::vector<int64_t> none(static_cast<size_t>(n_faces), -1);
    std::vector<int64_t> queue(none), refused(none); // refused: last segment that rejected a face
    std::fill(labels.begin(), labels.end(), -1);
    Hull hull;
    int64_t n_segments = 0;
    Poll poll(64);
    for (int64_t seed = 0; seed < n_faces; seed++) {
        poll();
        if (role[seed] != TASK || labels[seed] >= 0) continue;
        const Normal n = normals[seed];
        const auto [u, v] = Tangents(n);
        hull.clear();
        hull.add({0, 0, seed});
        labels[seed] = n_segments;
        queue[0] = seed;
        for (size_t begin = 0, end = 1; begin < end; begin++) {
            poll();
            const int64_t face = queue[begin];
            for (int64_t at = starts[face]; at < starts[face + 1]; at++) {
                const int64_t other = neighbours[at];
                if (role[other] == BARRIER || labels[other] >= 0 ||
                    refused[size_t(other)] == n_segments)
                    continue;
                if (role[other] == TASK) {
                    const Normal m = normals[other];
                    const double along = dot(m, n);
                    const auto fits = [&](const Corner &corner) {
                        return dot(m, normals[corner.face]) >= least_cosine;
                    };
                    if (!(along >= least_cosine) ||
                        !std::all_of(hull.corners().begin(), hull.corners().end(), fits)) {
                        refused[size_t(other)] = n_segments;
                        continue;
                    }
                    const double unit = UNITS / (radius * along);
                    const int64_t x = on_grid(unit * (m[0] * u[0] + m[1] * u[1] + m[2] * u[2]));
                    const int64_t y = on_grid(unit * (m[0] * v[0] + m[1] * v[1] + m[2] * v[2]));
                    if (!hull.holds(x, y)) hull.add({x, y, other});
                }
                labels[other] = n_segments;
                queue[end++] = other;
            }
        }
        n_segments++;
    }
    return n_segments;
}

} // namespace
} // namespace placement

void register_placement_segments(nanobind::module_ &m) {
    using namespace placement;
    m.attr("TASK") = int(TASK);
    m.attr("PASSED") = int(PASSED);
    m.attr("BARRIER") = int(BARRIER);
    def(m, "grow_segments", grow_segments,
        "Grow segments over shared edges, each from the first unlabelled face; their number.\n\n"
        "`role`, (F,), is TASK for faces that are labelled, PASSED for those passed through, or\n"
        "BARRIER; `neighbours` are the faces across the edges of each face, in rows by `starts`.\n"
        "`least_cosine` and `radius` are the cosine of the largest angle, > 0, and its tangent, "
        "> 0.\n"
        "Set `labels`, (F,), to the segment of each face, -1 for barriers; a passed face has the\n"
        "first segment that passed through it.",
        "normals", "role", "starts", "neighbours", "least_cosine", "radius", "labels");
}

} // namespace rastercov
