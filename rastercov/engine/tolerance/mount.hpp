// A camera with the errors of its mounting, and what is asked of it: regions of one pose.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "area/shadow.hpp"
#include "solver/plane_solver.hpp"

namespace rastercov::engine {

using area::Plane, area::Points, area::U, area::V;
using Corners = FloatRows<2>;

// Greatest errors: of the camera centre, metres; of the rotation, radians; of the focal length,
// relative.
struct Errors {
    double position, angle, focal;
};

// Factors on the margins of criteria, all 1: with less than that, a test sees that draws find out.
struct Margins {
    double event = 1.0;   // in the side of a face that is seen, by which edges are an event
    double shadow = 1.0;  // radius of the ball that casts shadows
    double cap = 1.0;     // angle of rotations, for depth and border
    double disc = 1.0;    // in the radius of the disc of incidence
    double density = 1.0; // exponent of the factor of densities
    double focal = 1.0;   // error of the focal length, for the border
};

// A camera with its errors; `near` is the least depth that the camera sees, metres.
struct Mount {
    Pose pose;
    double near;
    Errors errors;
    area::Criteria criteria; // gap in metres
    Margins margins;
    area::Disc disc = {}; // of a mount of parallel rays, which is without errors
};

// A point of the world in the axes of a camera.
template <class Point> Vector in_axes(const Point &point, const Pose &pose) {
    double away[3];
    for (int k = 0; k < 3; k++) away[k] = point[k] - pose.centre[k];
    const auto along = [&](int k) {
        return away[0] * pose.at(0, k) + away[1] * pose.at(1, k) + away[2] * pose.at(2, k);
    };
    return {along(0), along(1), along(2)};
}

inline area::Seen seen_of(const Mount &mount) {
    area::Seen seen = {};
    seen.rotation = {mount.pose.rotation, {3, 3}};
    seen.centre = {mount.pose.centre, {3}};
    seen.near = mount.near;
    return seen;
}
inline void require_planes(const area::Planes &planes) {
    require(have_rows(planes.areas.rows(), planes.origin, planes.x_axis, planes.y_axis,
                      planes.normal, planes.corners, planes.two_sided, planes.is_asked),
            "planes must have one row for each face");
}

// Normals of the opaque faces and the values of their planes at the origin; no length for a face
// without area.
struct FacePlanes {
    explicit FacePlanes(const Surface &surface);
    double height(size_t f, const Vector &at) const { return dot(normal[f], at) + offset[f]; }
    std::vector<Vector> normal;
    std::vector<double> offset;
    std::vector<int32_t> mesh_face; // of each face of the surface
};

// Pieces by face and the faces with a bound, of one pose in a table.
struct RegionRows {
    area::PieceTable pieces;
    Int32Array listed;
    FloatArray bound; // of the listed faces, m^2
};
inline Corners piece_of(const area::PieceTable &table, int64_t k) {
    return area::piece_at(k, table.starts, table.xy);
}

// A pose with its errors, and pieces: nominal regions, or what its camera centre sees.
struct Posed {
    Posed(const Surface &surface, const FacePlanes &face_planes, const area::Planes &planes,
          const Mount &mount, const RegionRows &rows);

    const Surface &surface;
    const FacePlanes &face_planes;
    const area::Planes &planes;
    Mount mount;
    RegionRows rows;
    area::Seen seen = seen_of(mount);
    std::vector<int64_t> first; // piece of each face, and the end of the last

    double d() const { return mount.errors.position; }
    area::Depths set_plane(int64_t f, Plane &plane) const {
        return area::set_plane(planes, f, seen, plane);
    }
    area::ShadowCaster caster(const Plane &plane, double radius, double deepest) const;
    // Calls with the pieces of a face.
    template <class Each> void each_piece(int64_t f, Each each) const {
        for (int64_t k = first[size_t(f)]; k < first[size_t(f) + 1]; k++)
            each(piece_of(rows.pieces, k));
    }
};

// Point of a face in camera axes.
inline Vector point_of(const Plane &plane, double x, double y) {
    return plane.origin + x * plane.x_axis + y * plane.y_axis;
}

// Clips a polygon in place to where a line is 0 or more; its corner count.
inline int64_t cut_by(const area::Affine &line, Points polygon, int64_t n) {
    area::Polygon spare;
    return exact::cut(polygon, n, area::line_of(line, 1.0), spare.points());
}

// Inward normals of the four planes through the border of an image, of a focal length longer by a
// share; shorter for a side between the image and its principal point, which moves the other way.
std::array<Vector, 4> border_of(const Lens &of, double longer);

// Least of n.v for what is on the inner side of a plane of normal n, turned and shifted, with some
// errors: max n'.v over the n' up to an angle a from n is at most cos a n.v + sin a |v|.
inline double slack_of(const Errors &errors, double reach) {
    return reach * std::sin(errors.angle) + errors.position;
}

// The hull of points without corners that rounding may have put anywhere: a side between two of
// them has no direction, and may seem to have all of a piece beyond it.
int64_t tidy_hull(Points points, int64_t n, double nearest);

} // namespace rastercov::engine
