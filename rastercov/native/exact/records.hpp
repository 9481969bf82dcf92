// Records and constants that the kernels of the exact methods share.
//
// Image coordinates are u to the right and v down, in pixels; w is 1/z, z being the depth in
// metres. A polygon is rows of corners, clockwise in the image, with a corner count beside it; a
// line is (u0, v0, du, dv, offset), and its inner side is where du (v - v0) - dv (u - u0) + offset
// >= 0.
//
// Invariants: faces, edges and blocks are those of a surface that check_surface has seen; a grid, a
// forest, crossings and pieces are what these kernels have written. Lengths are checked each time.
//
// Each record is a named tuple of rastercov.exact.records, where its attributes are described; its
// arrays are written by some kernels and read by others.
//
// Twin: rastercov.exact.records.
#pragma once
#include "array.hpp"

namespace rastercov::exact {

// Columns of a projected vertex, of a polygon's corner (u and v only) and of a plane.
enum { U, V, W };
// Columns of a face's box, and of the extent of all faces (u and v only), whose further columns are
// sums over the boxes of all faces, within the image.
enum { U_MIN, U_MAX, V_MIN, V_MAX, W_MIN, W_MAX };
enum { SUM_OF_WIDTHS = 4, SUM_OF_HEIGHTS, SUM_OF_AREAS };
// Further columns of a line. The error of the offset is kept for clipped faces only.
enum { DU = 2, DV, OFFSET, LINE_ERROR };
// Further columns of a crossing (u, v, du, dv): the range of its edge, 0 at the start, 1 at the
// end; and the largest error of the edge, pixels.
enum { FIRST = 4, LAST, EDGE_ERROR };
// Further columns of a plane: slope of w along u and v, the largest error of w within the image,
// and the largest error in pixels of the lines that bound the face.
enum { SLOPE_U = 3, SLOPE_V, W_ERROR, OUTLINE_ERROR };
enum { POSITION_ERROR = 3 }; // further column of an end of a segment (u, v, w)

// Bits of a face's state, and of the states of the faces of a block together.
enum : uint16_t {
    LIVE = 1,         // the face reaches into the image
    CLIPPED = 2,      // its image is a polygon made by clipping in space
    PARTLY = 4,       // it reaches out of the image
    CROSSED = 8,      // its visibility may change within it, so that it cannot be certified
    DOUBTFUL = 16,    // rounding may decide which side is seen
    THIN = 32,        // its image rounds to nothing, so that it hides nothing, and the bounds of
                      // the faces behind it include what it may hide
    UNFIT = 64,       // its visibility may change elsewhere than at event edges
    IN_CONTACT = 128, // another face touches or cuts it
    TRANSPARENT =
        256,       // it is of a target, which hides nothing and which nothing at its depth hides
    ABSENT = 512,  // of a block only: not all of its faces are live
    UNEVEN = 1024, // of a block only: its faces were measured one by one, so that any may be
                   // clipped, doubtful or thin
};

// Kinds of edges: one face, or two that run along it in opposite directions; two that run in the
// same direction; more than two faces, or no length.
enum : int8_t { CONSISTENT = 1, REVERSED = -1, NON_MANIFOLD = 2 };
// Depth order of an occluder relative to a face, over the overlap of their images.
enum Order { BEHIND, IN_FRONT, IN_FRONT_IN_PART, TIED };

// Relative difference of 1/z up to which two surfaces coincide: the lower index is in front.
constexpr double DEPTH_TIE_REL = 1e-10;
constexpr int64_t SPARE_ENTRIES = 8; // values behind the last of an array that may be touched
constexpr int64_t BLOCK = 64;        // faces, or edges, that are looked at together
constexpr int8_t MIXED = 2;          // side of a block not seen from one side, or in doubt
constexpr int64_t CORNERS = 12;      // room for a face clipped to the near plane and the image: 8
constexpr int64_t SIDES = 4;         // lines that bound a face: edges and, if clipped, near plane
constexpr int64_t STACK_ROOM = 64;   // room for the parts of a face that are still to be done
constexpr int64_t PIECE_ROOM = 64;   // room for the corners of a piece, between cuts

using Lines = Array<double, Any, 5>;
using Points = Array<double, Any, 2>; // corners of a polygon
using Vertices = Array<const double, Any, 3>;
using Extent7 = Array<double, 7>;

struct Pinhole {
    Array<const double, 3, 3> rotation; // world_from_camera
    Array<const double, 3> centre;
    double near, fx, fy, cx, cy, width, height, u_min, u_max, v_min, v_max, longest_ray,
        pixel_error, w_error_rel;
    Array<const double, 4, 5> border;
};

struct Blocks {
    Array<const bool, Any> has_flat;
    Array<const int32_t, Any> patch, patch_starts, of_patch, lowest;
    Array<const int32_t, Any, 2> joins;
    Array<const bool, Any> is_plain;
    Array<const int32_t, Any> starts, of_edges;
};

struct Clipped {
    Array<double, Any, CORNERS, 2> polygons;
    Array<int32_t, Any> n_corners;
    Array<double, Any, SIDES, 5> lines;
    Array<double, Any, 7> planes;
};

struct Projected {
    Array<const int32_t, Any, 3> faces;
    Array<const int32_t, Any> rank;
    Array<double, Any, 3> uvw;
    Array<int8_t, Any> side;
    Array<uint16_t, Any> state;
    Array<double, Any, 6> box;
    Array<double, Any> area;
    Array<int32_t, Any> clipped_index;
    Clipped clipped;
    Blocks blocks;
    Array<double, Any, 4> block_box;
    Array<uint16_t, Any> block_state;
    Array<int8_t, Any> block_side;
    Array<bool, Any> has_boxes;
};

struct CellGrid {
    double left, top, per_u, per_v;
    int64_t columns, rows;
    Array<uint8_t, Any> asked;
    Array<bool, Any> is_near;
    Array<uint64_t, Any, Any> fresh_bits;
    Array<int32_t, Any> fresh;
    Array<int64_t, 1> n_fresh;
    Array<int64_t, Any> starts, stops;
    Array<int32_t, Any> entries;
    Array<int64_t, 1> n_entries;
    Array<double, Any> nearest;
    Array<bool, Any> is_sorted;
    Array<double, 6, Any> bounds;
    Array<bool, Any> has_bounds;
    Array<int32_t, Any> hider;
    Array<int64_t, Any> buckets;
    Array<int32_t, Any> faces;
    Array<int64_t, 1> n_faces;
    Array<int32_t, Any> found;
    Array<int32_t, Any, 2> pairs;
    Array<bool, Any> is_whole;
};

struct Pieces {
    Array<double, Any, Any, 2> corners;
    Array<int64_t, Any> n_corners;
};

struct VisiblePieces {
    Points corners;
    Array<int64_t, Any> starts;
    Array<int32_t, Any> faces;
    Array<int64_t, 3> used;
};

struct Work {
    Points target;
    Lines own;
    Points corners;
    Lines lines;
    Points spare, other;
    Array<double, Any> values;
    Array<double, Any, 2> ranges;
    Array<double, 4, 5> cell;
    Pieces parts;
    Array<int64_t, Any> levels;
    Array<double, Any, 7> intersections;
    VisiblePieces kept;
};

struct Segment {
    Array<double, 2, 4> uvw;
    Array<int64_t, 3> ends;
};

struct Edges {
    Array<const int32_t, Any, 2> vertices, faces;
    Array<const int8_t, Any> kind;
    Array<const int32_t, Any, 3> of_face;
};

struct Crossings {
    Array<int32_t, Any> last, before, edge;
    Array<double, Any, 7> segments;
};

struct View {
    Pinhole camera;
    Projected projected;
    CellGrid grid;
    Edges edges;
    Array<bool, Any> is_event;
    Work work;
    Array<double, Any> visible, area_error;
};

} // namespace rastercov::exact

namespace rastercov {

template <> struct Record<exact::Pinhole> {
    using S = exact::Pinhole;
    static constexpr auto fields =
        Fields<&S::rotation, &S::centre, &S::near, &S::fx, &S::fy, &S::cx, &S::cy, &S::width,
               &S::height, &S::u_min, &S::u_max, &S::v_min, &S::v_max, &S::longest_ray,
               &S::pixel_error, &S::w_error_rel, &S::border>();
};
template <> struct Record<exact::Blocks> {
    using S = exact::Blocks;
    static constexpr auto fields =
        Fields<&S::has_flat, &S::patch, &S::patch_starts, &S::of_patch, &S::lowest, &S::joins,
               &S::is_plain, &S::starts, &S::of_edges>();
};
template <> struct Record<exact::Clipped> {
    using S = exact::Clipped;
    static constexpr auto fields = Fields<&S::polygons, &S::n_corners, &S::lines, &S::planes>();
};
template <> struct Record<exact::Projected> {
    using S = exact::Projected;
    static constexpr auto fields =
        Fields<&S::faces, &S::rank, &S::uvw, &S::side, &S::state, &S::box, &S::area,
               &S::clipped_index, &S::clipped, &S::blocks, &S::block_box, &S::block_state,
               &S::block_side, &S::has_boxes>();
};
template <> struct Record<exact::CellGrid> {
    using S = exact::CellGrid;
    static constexpr auto fields =
        Fields<&S::left, &S::top, &S::per_u, &S::per_v, &S::columns, &S::rows, &S::asked,
               &S::is_near, &S::fresh_bits, &S::fresh, &S::n_fresh, &S::starts, &S::stops,
               &S::entries, &S::n_entries, &S::nearest, &S::is_sorted, &S::bounds, &S::has_bounds,
               &S::hider, &S::buckets, &S::faces, &S::n_faces, &S::found, &S::pairs,
               &S::is_whole>();
};
template <> struct Record<exact::Pieces> {
    using S = exact::Pieces;
    static constexpr auto fields = Fields<&S::corners, &S::n_corners>();
};
template <> struct Record<exact::VisiblePieces> {
    using S = exact::VisiblePieces;
    static constexpr auto fields = Fields<&S::corners, &S::starts, &S::faces, &S::used>();
};
template <> struct Record<exact::Work> {
    using S = exact::Work;
    static constexpr auto fields =
        Fields<&S::target, &S::own, &S::corners, &S::lines, &S::spare, &S::other, &S::values,
               &S::ranges, &S::cell, &S::parts, &S::levels, &S::intersections, &S::kept>();
};
template <> struct Record<exact::Segment> {
    using S = exact::Segment;
    static constexpr auto fields = Fields<&S::uvw, &S::ends>();
};
template <> struct Record<exact::Edges> {
    using S = exact::Edges;
    static constexpr auto fields = Fields<&S::vertices, &S::faces, &S::kind, &S::of_face>();
};
template <> struct Record<exact::Crossings> {
    using S = exact::Crossings;
    static constexpr auto fields = Fields<&S::last, &S::before, &S::edge, &S::segments>();
};
template <> struct Record<exact::View> {
    using S = exact::View;
    static constexpr auto fields = Fields<&S::camera, &S::projected, &S::grid, &S::edges,
                                          &S::is_event, &S::work, &S::visible, &S::area_error>();
};

} // namespace rastercov
