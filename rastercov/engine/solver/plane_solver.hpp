// Exact visible areas of a surface through one pinhole: half planes, or a certificate and half
// planes of what it leaves.
//
// With a certificate, the half planes compute the largest face of each region; that face, which
// must be wholly visible or wholly hidden, classifies its region (exact/certificate.cpp). A crossed
// face is divided by the edges that cross it (exact/arrangement.cpp). The cost is proportional to
// the silhouettes, not to the faces or the pixels. Surfaces at equal depth coincide, and the face
// with the lower index is visible. Targets hide nothing, and nothing at their depth hides them.
//
// Arrays have the opaque faces first and then the targets. They are views of memory of the solver,
// or of what write_to took, until the next pose.
//
// Twins: tests/exact/test_exactness.py, tests/exact/test_certificate.py.
#pragma once
#include "camera/camera.hpp"
#include "camera/near.hpp"
#include "exact/records.hpp"
#include "solver/cell_grid.hpp"
#include "solver/image.hpp"
#include <cmath>

namespace rastercov::engine {

// Camera centre, and axes of the camera as columns: world_from_camera.
struct Pose {
    double rotation[9], centre[3];
    double at(int row, int column) const { return rotation[3 * row + column]; }
};

// Throws for a pose that is not finite; whether it is a rigid motion the caller knows.
inline Pose pose_of(Array<const double, 4, 4> world_from_camera) {
    constexpr double LARGEST = 1e31; // 10 times the largest coordinate of a mesh
    for (const double each : world_from_camera)
        expect(std::abs(each) <= LARGEST, "finite poses within 1e30 m", each, "check the poses");
    Pose pose;
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) pose.rotation[3 * i + k] = world_from_camera(i, k);
        pose.centre[i] = world_from_camera(i, 3);
    }
    return pose;
}

// A surface along the axis of a pose: least and greatest depth, greatest distance of a corner of
// its bounding box from the origin of the pose, and its size, metres.
struct Extent {
    double least, most, reach, size;
    // Beyond all vertices, and so far that rounding of w = farthest - z is relative to it.
    double farthest(double near) const { return std::max(most, near) + size; }
    // Distance of a camera for which contacts of parallel rays are as close: depths tie to a part
    // of w, and are rounded to a part of all that they come from.
    double distance(double near) const {
        return farthest(near) - std::min(least, near) + 1e-5 * (reach + farthest(near));
    }
};
// Of boxes of the opaque faces, and of all.
Extent extent_along(const Box &opaque, const Box &all, const Pose &pose);
Box box_of(const Surface &surface); // with the targets

// Counts of the last pose: event edges, faces that they cross, those of them that are left to half
// planes, regions, faces of regions that turned out neither wholly visible nor wholly hidden, faces
// that were clipped in space, and faces compared with event edges, or taken from others, once
// for each of these.
struct Counts {
    int64_t n_events = 0;
    int64_t n_crossed = 0;
    int64_t n_left = 0;
    int64_t n_regions = 0;
    int64_t n_doubtful = 0;
    int64_t n_clipped = 0;
    int64_t n_compared = 0;
};

using Handle = std::shared_ptr<const Surface>;

class PlaneSolver {
  public:
    PlaneSolver(Handle surface, bool is_certifying, bool keeps_pieces);
    PlaneSolver(const PlaneSolver &) = delete;

    // Takes a surface that differs in positions and contacts alone.
    void set_surface(Handle surface) { _surface = std::move(surface); }
    // Measures some opaque faces no more, in the order of the mesh; none for no rows. They hide
    // what they hid. Their visible area is 0, within their area in the image.
    void leave_out(BoolArray faces);
    // Writes figures to other arrays from now on; to its own for none.
    void write_to(const Areas *out);

    // Projects, sets up and lists the faces of one pose. `near` is the depth of the near plane,
    // metres. With front_only faces seen from behind neither hide nor are visible.
    // Parallel rays run along z, and have a pinhole with fx and fy in px/m.
    void set_pose(const Lens &pinhole, const Pose &pose, double near, bool front_only,
                  bool is_parallel);
    // Computes the figures of all faces of the pose, and those that are certified.
    void solve_all();
    // Computes the figures of some opaque faces.
    void solve(Int32Array faces);

    const Surface &surface() const { return *_surface; }
    const Handle &handle() const { return _surface; }
    const exact::Pinhole &camera() const { return _camera; }
    const Areas &areas() const { return _areas; }
    BoolArray is_certified() const { return _is_certified.all(); }
    const Image &image() const { return _image; }
    const exact::CellGrid &grid() const { return _grid.grid(); }
    // Of the faces solved since set_pose; wholly visible faces have none.
    const exact::VisiblePieces &kept() const { return _work.kept; }
    Array<const double, 7> extent() const { return {_extent, {7}}; }
    // Regions of patches, and of faces of other blocks.
    Int32Array regions() const { return _region.all(); }
    const Counts &counts() const { return _counts; }
    int64_t room_for_pieces() const { return _piece_counts.size(); }

  private:
    void set_camera(const Lens &of);
    void set_parallel(const Pose &pose, double near);
    void set_up();
    void make_scratch(bool keeps_pieces);
    void make_certificate();
    void make_pieces(int64_t n);
    void make_kept(int64_t n, int64_t corners);
    void make_crossings(int64_t n);
    bool grow_kept();

    void measure_all();
    void certify();
    void find_crossings(Int32Array events);
    void list_around(Int32Array events);
    int64_t divide_crossed(Int32Array faces, const exact::Partners &partners);
    void solve_targets();

    void run(Int32Array faces, const exact::Projected &projected);
    int64_t measure(Int32Array faces, int32_t *out);
    void limit_errors(const Int32Array &faces);
    void list_faces();
    double crossing_tolerance() const;
    exact::View view(const exact::Projected &projected) const;
    exact::Segment segment() { return {{_segment, {2, 4}}, {_segment_ends, {3}}}; }
    Array<double, 7> extent7() { return {_extent, {7}}; }

    Handle _surface;
    const bool _is_certifying;
    int64_t _n_opaque, _n_faces;
    exact::Pinhole _camera;
    double _scale = 0;    // largest number that positions come from, px: rounding is relative to it
    double _distance = 0; // from the farthest surface, of which contacts are a part, metres
    double _rotation[9], _centre[3], _border[20], _extent[7], _segment[8];
    int64_t _segment_ends[3], _kept_used[3] = {};
    Counts _counts;
    bool _is_listed = false;
    bool _has_crossings = false;
    bool _leaves_out = false;
    bool _front_only = false;
    bool _has_grown = false; // memory, since the pose was begun
    Room<double> _own[3];
    Areas _areas;
    Image _image;
    CellGridRoom _grid;
    Room<bool> _is_certified, _left_out, _is_event, _is_hidden, _is_at_event;
    Room<int32_t> _marks, _chosen, _events, _targets, _parent, _region, _left, _decision;
    // Scratch for one face.
    exact::Work _work;
    exact::Pieces _pieces;
    Room<double> _target, _own_lines, _corners, _lines, _spare, _other, _values, _ranges, _cell,
        _parts, _intersections, _piece_corners, _kept_corners;
    Room<int64_t> _part_counts, _levels, _piece_counts, _kept_starts;
    Room<int32_t> _kept_faces;
    exact::Crossings _crossings;
    Room<int32_t> _last, _before, _edge, _number;
    Room<double> _crossing_segments;
};

} // namespace rastercov::engine
