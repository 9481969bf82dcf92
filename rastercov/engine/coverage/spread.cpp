// Faces that several cameras cover: k-coverage with an angle between two of them, the best density
// and the widest angle.
//
// Cameras of elements are compressed rows: element e has camera[starts[e]] ... camera[starts[e + 1]
// - 1], ascending.
//
// Twins: rastercov.reference.views.
#include "coverage/spread.hpp"
#include "bind.hpp"
#include "camera/camera.hpp"
#include "interrupt.hpp"

namespace rastercov {
namespace coverage {
namespace {

using Starts = IntArray;
using Cameras = Int32Array;

constexpr auto STARTS = "starts must rise, within the items, one for each row and one more";

// Cameras that cover each face, as lists of pairs.
struct Chains {
    Column<int64_t> first;
    Column<bool> is_near;
    Column<int64_t> last;
    Column<int64_t> before, camera;
    Column<bool> is_spread;
};

// Adds a camera to the lists of the faces it covers; number of pairs of camera and face.
int64_t add_rays(int64_t c, Int32Array faces, const Rays &rays, const Chains &chains,
                 int64_t n_seen) {
    const auto &[first, is_near, last, before, camera, is_spread] = chains;
    const int64_t n_faces = rays.centroids.rows(), n_eyes = rays.eyes.rows();
    const int64_t room = std::min(before.rows(), camera.rows());
    require(c >= 0 && c < n_eyes, "c must be a row of eyes");
    require_indices(faces, n_faces, "faces must be rows of centroids");
    require(have_rows(n_faces, first, is_near, last, is_spread),
            "arrays of faces must have one row for each");
    require(n_seen >= 0 && n_seen <= room && room - n_seen >= faces.rows(),
            "before and camera must have room for a pair of each face");
    const double half = rays.half_angle();
    const auto require_camera = [&](int64_t b) {
        require(b >= 0 && b < n_eyes, "cameras must be rows of eyes");
    };
    for (const int32_t f : faces) {
        if (is_spread[f]) continue;
        if (first[f] < 0) {
            first[f] = c;
        } else {
            require_camera(first[f]);
            if (!rays.are_near(c, first[f], f, half)) is_near[f] = false;
        }
        int64_t pair = is_near[f] ? -1 : last[f];
        for (int64_t end = n_seen; pair >= 0; end = pair, pair = before[pair]) {
            require(pair < end, "pairs must come after those before them");
            require_camera(camera[pair]);
            if (rays.differ(c, camera[pair], f)) {
                is_spread[f] = true;
                break;
            }
        }
        before[n_seen] = last[f];
        camera[n_seen] = c;
        last[f] = n_seen++;
    }
    return n_seen;
}

// Counts the first cameras that together cover each face.
void cameras_until_covered(Array<const bool, Any, Any> covers, const Rays &rays, IntArray need,
                           Column<int64_t> counts) {
    const int64_t n_cameras = covers.rows(), n_faces = covers.shape[1];
    require(rays.eyes.rows() == n_cameras, "eyes must have one row for each camera");
    require(have_rows(n_faces, rays.centroids, need, counts),
            "arrays of faces must have one row for each");
    std::vector<int64_t> seen(n_cameras);
    const double half = rays.half_angle();
    Poll poll(16);
    for (int64_t f = 0; f < n_faces; f++) {
        poll();
        counts[f] = n_cameras + 1;
        int64_t n = 0;
        bool is_spread = rays.min_cosine > 1;
        bool is_near = true;
        for (int64_t c = 0; c < n_cameras; c++) {
            if (!covers(c, f)) continue;
            if (!is_spread) {
                is_near = is_near && (n == 0 || rays.are_near(c, seen[0], f, half));
                if (!is_near) is_spread = rays.differs_from_any(c, seen, n, f);
                seen[n] = c;
            }
            n++;
            if (is_spread && n >= need[f]) {
                counts[f] = c + 1;
                break;
            }
        }
    }
}

// Faces of the cameras of candidates, which have `width` cameras each.
struct Trials {
    Starts starts;
    Int32Array items;
    int64_t width;

    bool has(int64_t c, int64_t f) const {
        return std::binary_search(items.begin() + starts[c], items.begin() + starts[c + 1], f);
    }
};

// Weight that each of M candidates, cameras or rigs of them, adds to what some others cover.
void worth_added(Array<const bool, Any, Any> rest, const Trials &trials, const Rays &rays,
                 IntArray n_rest, BoolArray is_spread, IntArray weights, IntArray need,
                 Column<int64_t> added) {
    const auto &[starts, items, width] = trials;
    const int64_t n_others = rest.rows(), n_faces = rest.shape[1];
    require(width >= 1 && width <= starts.rows(), "width must be 1 or more, within the cameras");
    require_starts(starts, added.rows() * width, items.rows(), STARTS);
    require_indices(items, n_faces, "items must be faces");
    require(rays.eyes.rows() == n_others + added.rows() * width,
            "eyes must have a row for each camera");
    require(have_rows(n_faces, n_rest, is_spread, weights, rays.centroids, need),
            "arrays of faces must have one row for each");
    std::vector<int64_t> seen(n_others + width), times(n_faces, 1);
    // True where two of the others and the cameras of a rig from `camera` on differ.
    const auto differ = [&](int64_t camera, int64_t end, int64_t f) {
        int64_t n = 0;
        for (int64_t c = 0; c < n_others; c++)
            if (rest(c, f)) seen[n++] = c;
        for (int64_t c = camera; c < end; c++) {
            if (!trials.has(c, f)) continue;
            seen[n] = n_others + c;
            if (rays.differs_from_any(seen[n], seen, n, f)) return true;
            n++;
        }
        return false;
    };
    for (int64_t m = 0; m < added.rows(); m++) {
        poll_interrupt();
        uint64_t total = 0;
        const int64_t begin = m * width, end = begin + width;
        if (width > 1) {
            for (int64_t at = starts[begin]; at < starts[end]; at++) times[items[at]] = 0;
            for (int64_t at = starts[begin]; at < starts[end]; at++) times[items[at]]++;
        }
        for (int64_t camera = begin; camera < end; camera++) {
            for (int64_t at = starts[camera]; at < starts[camera + 1]; at++) {
                const int64_t f = items[at], n_more = times[f];
                if (width > 1) times[f] = 0;
                if (n_more == 0) continue; // judged with an earlier camera
                const bool is_covered = is_spread[f] && n_rest[f] >= need[f];
                const auto n_all = int64_t(uint64_t(n_rest[f]) + uint64_t(n_more));
                if (is_covered || n_all < need[f]) continue;
                if (is_spread[f] || differ(camera, end, f)) total += uint64_t(weights[f]);
            }
        }
        added[m] = int64_t(total);
    }
}

// Pixels a metre along the worst direction of a surface at a point; 0 where it has no image.
template <class Camera>
double density_at(const Triple<double> &point, Array<const double, 4, 4> pose,
                  const Triple<double> &normal, const Camera &camera) {
    const Triple<double> way = {point.x - pose(0, 3), point.y - pose(1, 3), point.z - pose(2, 3)};
    const auto [right, down, depth] = rotate(way, pose);
    if (!is_ahead(camera, right, down, depth)) return 0.0;
    const auto [a, b, c] = rotate(normal, pose);
    return along(jacobian(camera, right, down, depth), a, b, c);
}

// Places on the surface, and the cameras of each.
struct Elements {
    Starts starts;
    Cameras camera;
    Places points, normals;
};

// Takes in the cameras with one lens: the greatest density of each element, and its camera.
template <class Camera>
void best_densities(const Elements &elements, FloatRows<4, 4> poses, Cameras lens_of_pose,
                    int64_t index, const Camera &lens, Column<double> best, Column<int32_t> by) {
    const auto &[starts, camera, points, normals] = elements;
    const int64_t n = points.rows();
    require_lens(lens);
    require_starts(starts, n, camera.rows(), STARTS);
    require_indices(camera, poses.rows(), "cameras must be rows of poses");
    require(have_rows(n, normals, best, by), "arrays of elements must have one row for each");
    require(lens_of_pose.rows() == poses.rows(), "lens_of_pose must have one row for each pose");
    Poll poll(64);
    for (int64_t e = 0; e < n; e++) {
        poll();
        const auto point = read_triple<double>(points[e].begin()),
                   normal = read_triple<double>(normals[e].begin());
        for (int64_t at = starts[e]; at < starts[e + 1]; at++) {
            const int32_t c = camera[at];
            if (lens_of_pose[c] != index) continue;
            const double density = density_at(point, poses[c], normal, lens);
            if (density > best[e] || (density == best[e] && c < by[e])) {
                best[e] = density;
                by[e] = c;
            }
        }
    }
}

// Greatest angle between the rays from each element to two of its cameras, radians.
//
// The angle is atan2(|a x b|, a . b), which is accurate at 0 and at pi.
void widest_angles(Starts starts, Cameras camera, Places points, Places eyes,
                   Column<double> widest) {
    require_starts(starts, points.rows(), camera.rows(), STARTS);
    require_indices(camera, eyes.rows(), "cameras must be rows of eyes");
    require(widest.rows() == points.rows(), "widest must have one row for each element");
    Poll poll(64);
    for (int64_t e = 0; e < points.rows(); e++) {
        poll();
        widest[e] = 0.0;
        for (int64_t first = starts[e]; first < starts[e + 1]; first++) {
            const int32_t p = camera[first];
            const double ax = eyes(p, 0) - points(e, 0), ay = eyes(p, 1) - points(e, 1),
                         az = eyes(p, 2) - points(e, 2);
            for (int64_t second = first + 1; second < starts[e + 1]; second++) {
                const int32_t q = camera[second];
                const double bx = eyes(q, 0) - points(e, 0), by = eyes(q, 1) - points(e, 1),
                             bz = eyes(q, 2) - points(e, 2);
                const double x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
                const double across = std::sqrt(x * x + y * y + z * z);
                const double angle = std::atan2(across, ax * bx + ay * by + az * bz);
                widest[e] = std::max(widest[e], angle);
            }
        }
    }
}

} // namespace
} // namespace coverage

RECORD(coverage::Chains, first, is_near, last, before, camera, is_spread);
RECORD(coverage::Trials, starts, items, width);
RECORD(coverage::Elements, starts, camera, points, normals);

void register_coverage_spread(nanobind::module_ &m) {
    using namespace coverage;
    def(m, "add_rays", add_rays,
        "Add a camera to the lists of the faces it covers; number of pairs of camera and face.\n\n"
        "faces : (N,) int32, that it covers, none twice.\n"
        "first, is_near : (F,) int64, (F,) bool, in and out: first camera that sees each face, -1 "
        "for none; True where\n    the rays to all others lie within half the angle of that to the "
        "first, so that no two differ by the angle.\n"
        "last : (F,) int64, in and out: the pair of the last camera that sees each face, -1 for "
        "none.\n"
        "before, camera : (M,) int64, in and out: of each pair, the pair before it of the same "
        "face, and its camera;\n    room for N more.\n"
        "n_seen : pairs so far.\n"
        "is_spread : (F,) bool, in and out: True where the rays to two cameras of a face differ by "
        "the angle.",
        "c", "faces", "rays", "chains", "n_seen");
    def(m, "cameras_until_covered", cameras_until_covered,
        "Count the first cameras that together cover each face.\n\n"
        "covers : (K, F) bool, faces that each camera covers.\n"
        "need : (F,) int64, cameras that must cover a face, 1 or more.\n"
        "counts : (F,) int64, out: the least n for which the first n cameras cover the face; K + 1 "
        "for none.",
        "covers", "rays", "need", "counts");
    def(m, "worth_added", worth_added,
        "Weight that each of M candidates, cameras or rigs of them, adds to what others cover.\n\n"
        "rest : (K, F) bool, faces that each of the others covers.\n"
        "starts, items : (M width + 1,) int64, (N,) int32, faces of each camera, ascending: "
        "items[starts[c]] ... items[starts[c + 1] - 1].\n"
        "width : cameras of each candidate, which follow one another and may be without faces.\n"
        "eyes : (K + M width, 3).\n"
        "n_rest, is_spread : (F,) int64, (F,) bool, number of the others that cover each face, and "
        "whether the rays to two of them differ.\n"
        "weights, need : (F,) int64, weight of each face, and cameras that must cover it.\n"
        "added : (M,) int64, out: weight of the faces that are covered with the candidate and not "
        "without.",
        "rest", "trials", "rays", "n_rest", "is_spread", "weights", "need", "added");
    const auto add = [&](auto best_densities) {
        def(m, "best_densities", best_densities,
            "Take in the cameras with one lens: the greatest density of each element, and its "
            "camera.\n\n"
            "points, normals : (E, 3), where the density is taken.\n"
            "lens_of_pose : (P,) int32; poses whose value is `index` are taken in, `lens` is "
            "theirs.\n"
            "best, by : (E,) float64, (E,) int32, in and out; the first of equals.",
            "elements", "poses", "lens_of_pose", "index", "lens", "best", "by");
    };
    add(best_densities<Lens>);
    add(best_densities<ParallelLens>);
    add(best_densities<CurvedLens>);
    def(m, "widest_angles", widest_angles,
        "Set `widest`, (E,), to the greatest angle between the rays from each element to two of "
        "its cameras, radians.",
        "starts", "camera", "points", "eyes", "widest");
}

} // namespace rastercov
