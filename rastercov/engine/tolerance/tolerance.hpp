// Regions of poses whose mounting has errors.
//
// The camera centre lies anywhere within a distance of its place, the camera is turned by any
// vector up to an angle, and its focal length is off by up to a share. Each criterion is met for
// all errors in a part of the nominal regions that is cut off by lines, by a smaller disc, or, for
// occlusion, by the shadows of edges from the ball of camera centres: docs/appendix/tolerance.md.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "solver/regions.hpp"
#include "tolerance/mount.hpp"

namespace rastercov::engine {

// What is found of a pose.
struct Tolerated {
    Regions regions;
    double nearest = 0.0;    // distance of the surface from the camera centre, metres
    bool is_left = false;    // the surface may reach a camera centre: nothing is sure
    int64_t n_events = 0;    // edges that are an event for some camera centre
    int64_t n_shadows = 0;   // that were cast on faces
    int64_t n_unbounded = 0; // faces on which a shadow has no end: nothing of them is sure
};

// Poses of one camera with their errors (position, angle, focal), a row each.
struct Mounts {
    FloatRows<4, 4> world_from_camera;
    FloatRows<3> errors;
    double near;                    // of the camera, metres
    Array<const double, 6> margins; // of Margins, in their order
};

// Mount i, with a margin of its position, metres.
Mount mount_of(const Mounts &mounts, int64_t i, const area::Criteria &criteria, double margin);

// Regions in a table: pieces and pairs of pose and face, with the first of each pose, and the end
// of the last.
struct Source {
    FloatRows<2> xy;
    IntArray starts;
    Int32Array face;
    IntArray pieces;
    Int32Array listed;
    FloatArray bound;
    IntArray pairs;
};

// Mounts and their regions: what is sure of nominal regions, or what is possible.
struct Tolerance {
    Handle surface;
    const area::Planes &planes;
    area::Criteria criteria; // gap relative to the diagonal
    const Mounts &mounts;
    const Source &source;
};

// Areas of faces by discs of parallel rays about the axes of poses, (P, F, 3): see
// ToleranceCutter::sweep.
std::vector<double> sweep_discs(const Tolerance &job, double tangent, int64_t n_threads);

// What is found of each pose.
std::vector<Tolerated> tolerate(const Tolerance &job, bool is_sure, int64_t n_threads);

// Sets `reason` to the coverage::Reason of the first criterion that some errors of one mount break
// at points, in the planes of faces, that it covers; OCCLUDED where all others hold.
void find_unmet(const area::Planes &planes, const area::Criteria &criteria, const Mounts &mount,
                FloatRows<2> points, IntArray face, Column<uint8_t> reason);

} // namespace rastercov::engine
