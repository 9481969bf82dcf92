// Parts of faces that a pinhole covers whatever the errors of its mounting, and those that it may
// cover with some.
//
// The camera centre lies anywhere within a distance of its place, the camera is turned by any
// vector up to an angle, and its focal length is off by up to a share. Each criterion is met for
// all errors in a part of the nominal regions that is cut off by lines, by a smaller disc, or, for
// occlusion, by the shadows of edges from the ball of camera centres: docs/appendix/tolerance.md.
//
// Invariants: what is sure lies in the nominal regions; each method can be called again after an
// error.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "area/overlay.hpp"
#include "area/shadow.hpp"
#include "exact/segments.hpp"
#include "solver/plane_solver.hpp"
#include "solver/regions.hpp"
#include <span>

namespace rastercov::engine {

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

// Pieces by face and the faces with a bound, of one pose in a table.
struct RegionRows {
    FloatRows<2> xy;
    IntArray starts; // of the pieces, and the end of the last
    Int32Array face, listed;
    FloatArray bound; // of the listed faces, m^2
};

// What is found of a pose.
struct Tolerated {
    Regions regions;
    double nearest = 0.0;    // distance of the surface from the camera centre, metres
    bool is_left = false;    // the surface may reach a camera centre: nothing is sure
    int64_t n_events = 0;    // edges that are an event for some camera centre
    int64_t n_shadows = 0;   // that were cast on faces
    int64_t n_unbounded = 0; // faces on which a shadow has no end: nothing of them is sure
};

// Normals of the opaque faces and the values of their planes at the origin; no length for a face
// without area.
struct FacePlanes {
    explicit FacePlanes(const Surface &surface);
    std::vector<area::Vector> normal;
    std::vector<double> offset;
    std::vector<int32_t> mesh_face; // of each face of the surface
};

// Edges that are an event for some camera centre, listed by the cells of a grid over the image.
class EventField {
  public:
    struct Edge {
        area::Hiding hiding;
        double u0, v0, u1, v1; // ends in the image, at depth 1
        double nearest;        // least depth
        double grow; // distance in the image within which it may seem to be, by depth: see `reach`
        int32_t index;
        double tangent = 0.0; // of the disc of parallel rays

        // That distance for what it hides up to a depth.
        double reach(double deepest, double d) const {
            if (tangent > 0) return tangent * (deepest - nearest);
            return grow * std::clamp(1 - (nearest - d) / deepest, 0.0, 1.0);
        }
        // Its extent in the image, and a margin.
        exact::Bounds box(double margin) const {
            return {std::min(u0, u1) - margin, std::max(u0, u1) + margin, std::min(v0, v1) - margin,
                    std::max(v0, v1) + margin};
        }
        // Sets its ends in the image.
        void project();
        // Sets it to a part of what it was, from 0 to 1.
        void set_part(const Edge &whole, const exact::Part &part);
    };

    // False if the surface may be so near to a camera centre, in view, that nothing is bounded.
    // `border` has the inward normals of the widest image.
    bool set(const Surface &surface, const FacePlanes &planes, const Mount &mount,
             const std::array<area::Vector, 4> &border, double widest);
    // The same of a disc of parallel rays, whose image has this half side.
    void set_parallel(const Surface &surface, const FacePlanes &planes, const Mount &mount,
                      double widest);
    void clear() {
        _edges.clear();
        _n_events = 0;
    }
    const std::vector<Edge> &edges() const { return _edges; }
    // Sets it to some of its edges, or parts of these.
    void set(std::vector<Edge> &&edges);
    int64_t n_events() const { return _n_events; }
    // Greatest tangent of the angle of a ray in view with the nominal axis.
    double widest() const { return _widest; }

    // Calls with the edges whose extent and margin reach into a box of the image, each once until
    // `begin`.
    void begin() { _round++; }
    template <class Each> void each_in(const exact::Bounds &box, Each each);

  private:
    bool is_plain(const exact::Edges &edges, int64_t e) const;
    void list_edges();
    template <class Visit> void each_cell(const Edge &edge, Visit visit) const;
    int64_t cell_of(double at) const {
        return std::clamp(int64_t((at / _widest + 1) * double(_side) / 2), int64_t(0), _side - 1);
    }

    double _widest = 0.0;
    int64_t _side = 1;
    int64_t _n_events = 0;
    std::vector<Edge> _edges;
    std::vector<int8_t> _sides; // of faces: which all camera centres see, 0 for none
    std::vector<int64_t> _starts;
    std::vector<int32_t> _entries;
    std::vector<int64_t> _seen;
    int64_t _round = 0;
};

class ToleranceCutter {
  public:
    ToleranceCutter(const Surface &surface, const FacePlanes &face_planes)
        : _surface(surface), _face_planes(face_planes) {}

    // Part of nominal regions that is covered whatever the errors.
    Tolerated sure(const Mount &mount, const area::Planes &planes, const RegionRows &nominal);
    // Parts that are covered with some errors, of what the nominal camera centre sees of both sides
    // of all faces in a wider image.
    Tolerated possible(const Mount &mount, const area::Planes &planes, const RegionRows &seen);
    // Areas of faces by a disc of parallel rays, (F, 3), m^2: what all of it lights, at least and
    // at most, and what some of it may light. `lit` are the regions of its middle, of both sides.
    void sweep(const Mount &mount, const area::Planes &planes, const RegionRows &lit,
               Array<double, Any, 3> areas);

  private:
    // Regions that grow; see area::Found.
    struct Pieces {
        Room<double> xy, area, bound, doubt;
        Room<int64_t> starts;
        Room<int32_t> face;
        int64_t used[2];
        double cut_short;
        area::Found found() {
            return {xy.rows<2>(xy.size() / 2),
                    starts.all(),
                    face.all(),
                    {used, {2}},
                    area.all(),
                    bound.all(),
                    doubt.all(),
                    {&cut_short, {1}}};
        }
    };
    struct Directions;
    template <class Step> void run(Pieces &pieces, int64_t n_faces, Step step);

    bool begin(const Mount &mount, bool is_sure, Tolerated &told);
    void cut_criteria(const Mount &mount, const area::Planes &planes, const RegionRows &source,
                      const area::Found &out);
    void cut_face(int64_t f, const Mount &mount, const Directions &directions,
                  const RegionRows &source, int64_t first, int64_t last, const area::Found &out);
    bool cast_all(const Mount &mount, int64_t first, int64_t last, const area::Found &from,
                  Tolerated &told);
    // A convex shape in the plane of a face.
    struct Shape {
        FloatRows<2> corners;
        exact::Bounds box;
    };
    Shape shape_of(int32_t k) {
        Cast &shadow = _shadows[size_t(k)];
        return {{shadow.xy.data(), {shadow.n, 2}}, shadow.box};
    }
    template <class Shapes>
    int64_t subtract(const FloatRows<2> &polygon, int64_t n, const Shapes &shapes,
                     std::span<const int32_t> list, double nearest);
    template <class Shapes, class Few, class All>
    void divide(area::Points polygon, int64_t n, size_t first, int depth, const Shapes &shapes,
                const Few &few, const All &all);
    void subtract_shadows(const Mount &mount, const area::Planes &planes, const area::Found &from,
                          const area::Found &out, Tolerated &told);
    bool faces_of(const EventField::Edge &edge, const area::Planes &planes,
                  std::array<int64_t, 2> &found) const;
    void add_seen(int64_t f, const EventField::Edge &edge, const area::Plane &plane,
                  const RegionRows &seen, exact::Part &all) const;
    exact::Part seen_part(const EventField::Edge &edge, const area::Planes &planes,
                          const RegionRows &seen) const;
    exact::Part reached_part(const EventField::Edge &edge, const EventField::Edge &other,
                             const Mount &mount, const area::Planes &planes) const;
    void narrow_edges(const Mount &mount, const area::Planes &planes, const RegionRows &seen);
    double left_of(const Mount &mount, int64_t first, int64_t last, const area::Found &from,
                   double if_unbounded);
    void index_pieces(const RegionRows &rows, int64_t n_faces);
    double lay(area::Points polygon, int64_t n);
    void hide_seen(int64_t f, const RegionRows &seen, area::Points whole, int64_t n);
    double lay_shadows(const Mount &mount, Tolerated &told);
    bool lay_possible(int64_t f, const Mount &mount, const RegionRows &seen, area::Points whole,
                      int64_t n, const area::Found &out, Tolerated &told);
    void add_possible(int64_t f, const Mount &mount, const area::Planes &planes,
                      const RegionRows &seen, const area::Found &out, Tolerated &told);

    const Surface &_surface;
    const FacePlanes &_face_planes;
    area::Seen _seen = {};
    std::array<area::Vector, 4> _border; // inward normals of the widest image
    EventField _field;
    Pieces _cut, _left;
    area::Scratch _scratch;
    area::Overlay _overlay;
    area::Parts _own{64};
    std::vector<double> _hidden_xy; // of parts that are not seen
    std::vector<int64_t> _hidden_starts;
    // Shadows on a face: corners, their number, extents.
    struct Cast {
        std::array<double, 2 * area::MOST_SHADOW_CORNERS> xy;
        int64_t n;
        exact::Bounds box;
        double area;
        area::Points points() { return {xy.data(), {area::MOST_SHADOW_CORNERS, 2}}; }
    };
    std::vector<Cast> _shadows;
    std::vector<int32_t> _list;        // of shadows
    std::vector<exact::Bounds> _boxes; // of pieces
    std::vector<int64_t> _first;       // piece of each face, and the end of the last
};

// Poses of one camera with their errors (position, angle, focal), a row each, and their regions in
// a table: what is sure of nominal regions, or what is possible.
struct Tolerance {
    Handle surface;
    const area::Planes *planes;
    area::Criteria criteria; // gap relative to the diagonal
    double near;             // of the camera, metres
    bool is_sure;
    FloatRows<4, 4> world_from_camera;
    FloatRows<3> errors;
    Margins margins;
    FloatRows<2> xy;
    IntArray starts;
    Int32Array face;
    IntArray pieces; // first of each pose, and the end of the last
    Int32Array listed;
    FloatArray bound;
    IntArray pairs; // as pieces, of listed faces
};

// Areas of faces by discs of parallel rays about the axes of poses, (P, F, 3): see `sweep`.
std::vector<double> sweep_discs(const Tolerance &job, double tangent, int64_t n_threads);

// What is found of each pose.
std::vector<Tolerated> tolerate(const Tolerance &job, int64_t n_threads);

} // namespace rastercov::engine
