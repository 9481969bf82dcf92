// Poses of a rig with their errors, many at a time.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/tolerance.hpp"
#include "camera/near.hpp"
#include "solver/idle.hpp"
#include "tolerance/cutter.hpp"

namespace rastercov::engine {

namespace {
void check(const Tolerance &job) {
    const auto &[poses, errors, near, margins] = job.mounts;
    const Source &source = job.source;
    const int64_t n = poses.rows(), n_faces = job.planes.areas.rows();
    require(have_rows(n, errors) && have_rows(n + 1, source.pieces, source.pairs),
            "errors and regions must have a row for each pose");
    require_planes(job.planes);
    require_starts(source.starts, source.face.rows(), source.xy.rows(),
                   "starts must rise, within xy");
    require_starts(source.pieces, n, source.face.rows(), "pieces must rise, within face");
    require_starts(source.pairs, n, source.listed.rows(), "pairs must rise, within listed");
    require(source.bound.rows() == source.listed.rows(), "bound must have one row for each pair");
    require_indices(source.face, n_faces, "face must hold faces");
    require_indices(source.listed, n_faces, "listed must hold faces");
    for (int64_t i = 0; i < n; i++)
        require(errors(i, 0) >= 0 && errors(i, 0) < INFINITY && errors(i, 1) >= 0 &&
                    errors(i, 1) < 1 && errors(i, 2) >= 0 && errors(i, 2) < 1,
                "errors must be metres, radians below 1, and a share below 1");
    require(job.surface->n_faces() == n_faces, "planes must be of the faces of the surface");
}

// Regions of pose i.
RegionRows rows_of(const Source &source, int64_t i) {
    const auto rows = [i](const auto &array, const auto &ends, int64_t more = 0) {
        return std::remove_cvref_t<decltype(array)>{array.data + ends[i],
                                                    {ends[i + 1] - ends[i] + more}};
    };
    return {{source.xy, rows(source.starts, source.pieces, 1), rows(source.face, source.pieces)},
            rows(source.listed, source.pairs),
            rows(source.bound, source.pairs)};
}

// Calls with a cutter, each pose, and its number.
template <class Work>
void each_pose(const Tolerance &job, const area::Disc &disc, int64_t n_threads, const Work &work) {
    check(job);
    const Surface &surface = *job.surface;
    const FacePlanes face_planes(surface);
    area::Criteria criteria = job.criteria;
    criteria.gap *= surface.diagonal();
    Idle<ToleranceCutter> idle(n_threads);
    const auto prepare = [&](std::unique_ptr<ToleranceCutter> one) {
        return one ? std::move(one) : std::make_unique<ToleranceCutter>();
    };
    Pace pace = INFINITY;
    const auto with_pose = [&](ToleranceCutter &cutter, int64_t i) {
        Mount mount = mount_of(job.mounts, i, criteria, MARGIN_REL * surface.diagonal());
        mount.near = near_of(mount.near, farthest_of(surface.bounds(), [&](int axis) {
                                 return mount.pose.centre[axis];
                             }));
        mount.disc = disc;
        work(cutter, Posed(surface, face_planes, job.planes, mount, rows_of(job.source, i)), i);
    };
    share(job.mounts.errors.rows(), n_threads, idle, prepare, pace, {}, with_pose);
    idle.close();
}
} // namespace

Mount mount_of(const Mounts &mounts, int64_t i, const area::Criteria &criteria, double margin) {
    const auto errors = mounts.errors[i];
    const auto &m = mounts.margins;
    return {pose_of(mounts.world_from_camera[i]),
            mounts.near,
            {errors[0] > 0 ? errors[0] + margin : 0.0, errors[1], errors[2]},
            criteria,
            {m[0], m[1], m[2], m[3], m[4], m[5]}};
}

std::vector<double> sweep_discs(const Tolerance &job, double tangent, int64_t n_threads) {
    const int64_t n_faces = job.planes.areas.rows();
    std::vector<double> areas(size_t(3 * job.mounts.world_from_camera.rows() * n_faces));
    each_pose(job, {tangent * (1 + MARGIN_REL)}, n_threads,
              [&](ToleranceCutter &cutter, const Posed &lit, int64_t i) {
                  cutter.sweep(lit, {areas.data() + 3 * n_faces * i, {n_faces}});
              });
    return areas;
}

std::vector<Tolerated> tolerate(const Tolerance &job, bool is_sure, int64_t n_threads) {
    std::vector<Tolerated> results(size_t(job.mounts.world_from_camera.rows()));
    each_pose(job, {}, n_threads, [&](ToleranceCutter &cutter, const Posed &of, int64_t i) {
        results[size_t(i)] = is_sure ? cutter.sure(of) : cutter.possible(of);
    });
    return results;
}

} // namespace rastercov::engine
