// Records and constants that the kernels of the exact methods share.
//
// Image coordinates are u to the right and v down, in pixels; w is 1/z, z being the depth in
// metres, or farthest - z of parallel rays: affine on a face in the image, greater is nearer. A
// polygon is rows of corners, clockwise in the image, with a corner count beside it; a line is (u0,
// v0, du, dv, offset), and its inner side is where du (v - v0) - dv (u - u0) + offset
// >= 0.
//
// Invariants: faces, edges and blocks are those of an engine::Surface; a grid, a forest, crossings
// and pieces are what these kernels have written, in memory of engine/. Nothing is checked again.
//
// Twins: tests/exact/test_exactness.py.
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
        256,          // it is of a target, which hides nothing and which nothing at its depth hides
    ABSENT = 512,     // of a block only: not all of its faces are live
    UNEVEN = 1024,    // of a block only: its faces were measured one by one, so that any may be
                      // clipped, doubtful or thin
    EDGE_ON = 2048,   // the camera centre is exactly in its plane: nothing of it is seen or hides
    HAS_LOOSE = 4096, // LOOSE is known
    LOOSE = 8192,     // faces nearly coincide with it that do not all coincide with one another
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
using Vertices = FloatRows<3>;

// Camera and pose. Beyond u_min ... v_max, px, well outside the image, faces are clipped in space
// before they are projected. `longest_ray` is the greatest length of a ray to the plane z = 1,
// through the image and half as far around it; `pixel_error` the largest error of a projected
// position, px; `w_error_rel` that of w, relative; `border` the sides of the image. Parallel rays
// run along z: fx and fy are in px/m, `farthest` is beyond all vertices, and x and y are not
// divided by z; of a pinhole `farthest` is 0.
struct Pinhole {
    Array<const double, 3, 3> rotation; // world_from_camera
    Array<const double, 3> centre;
    double near, fx, fy, cx, cy, width, height, u_min, u_max, v_min, v_max, longest_ray,
        pixel_error, w_error_rel;
    Array<const double, 4, 5> border;
    double farthest;

    bool is_parallel() const { return farthest > 0; }
    double w_at(double z) const { return is_parallel() ? farthest - z : 1.0 / z; }
    // What x and y are divided by at a depth.
    double divisor_at(double z) const { return is_parallel() ? 1.0 : z; }
    // Depth of the near plane as a pinhole has it, whose inverse is w.
    double near_depth() const { return is_parallel() ? 1.0 / w_at(near) : near; }
};

// Blocks of BLOCK faces of a surface, and of BLOCK consecutive edges. A patch is a part of a block
// whose faces are joined by edges that two of them use in opposite directions.
struct Blocks {
    BoolArray has_flat;                 // blocks with a face without area
    Int32Array patch;                   // of each face
    Int32Array patch_starts;            // first patch of each block, and their number
    Int32Array of_patch, lowest;        // block, and lowest face, of each patch
    Array<const int32_t, Any, 2> joins; // patches with a common edge of two faces, lower
                                        // first; ~c where both run along it one way
    BoolArray is_plain;                 // blocks of edges that all have two faces which
                                        // run along them in opposite directions
    Int32Array starts, of_edges;        // of those, blocks of faces:
                                        // of_edges[starts[m]] ... [starts[m + 1] - 1]
};

// Images of the faces that are clipped in space: corners, clockwise, lines that bound each, and
// 1/z: a point (u, v, w), slopes and errors.
struct Clipped {
    Array<double, Any, CORNERS, 2> polygons;
    Column<int32_t> n_corners;
    Array<double, Any, SIDES, 5> lines;
    Array<double, Any, 7> planes;
};

// Image of a surface. w of a vertex is 0 where it lies before the near plane or too far outside the
// image to be projected, so that faces and edges that use it must be clipped in space.
struct Projected {
    Array<const int32_t, Any, 3> faces;
    Int32Array rank; // place of each opaque face in the mesh: of two that tie, the
                     // lower one is in front
    Array<double, Any, 3> uvw;
    Column<int8_t> side; // 1 seen from the front, -1 from behind, 0 left out; exact
    Column<uint16_t> state;
    Array<double, Any, 6> box;     // of the live and thin faces of blocks that have boxes
    Column<double> area;           // inside the image, px^2
    Column<int32_t> clipped_index; // row in `clipped`, of clipped faces
    Clipped clipped;
    Blocks blocks;
    Array<double, Any, 4> block_box; // of live and thin faces; from inf to -inf for none
    Column<uint16_t> block_state;    // bits that any face of a block has after set_up, and ABSENT
                                     // and UNEVEN
    Column<int8_t> block_side;       // of all faces of a block, or MIXED
    Column<bool> has_boxes;          // blocks of which `box` is filled in: where one is needed
};

struct Group; // of faces in a cell, see grid.hpp

// Live and thin faces listed by the cells of a regular grid over the image that their boxes touch.
// Arrays of cells have a row for each, or more.
struct CellGrid {
    double left, top, per_u, per_v; // least u and v; columns and rows a pixel
    int64_t columns, rows;
    Column<uint8_t> asked; // NOT_ASKED, ASKED or LISTED: faces are listed in the last only
    Column<bool> is_near;  // that cell, the next, or one of these two in the next row is asked
                           // for and not listed
    Array<uint64_t, Any, Any> fresh_bits; // bits of these cells by row, of the first columns lowest
    Column<int32_t> fresh;                // the same cells, and their number
    Array<int64_t, 1> n_fresh;
    Column<int64_t> starts, stops; // entries[starts[c]] ... entries[stops[c] - 1] of a cell
    Column<int32_t> entries;       // by index until the cell is sorted
    Array<int64_t, 1> n_entries;
    Column<double> nearest;        // greatest 1/z of the faces of sorted cells
    Column<bool> is_sorted;        // by their nearest depth, from front to back
    Array<double, 12, Any> bounds; // boxes of the faces of cells with bounds, and, in cells of
                                   // many, u, v of their three corners
    Column<Group> groups;          // of them
    Column<bool> has_bounds;
    Column<int32_t> hider;   // a face that hid something there, looked at first; -1 for none
    Column<int64_t> buckets; // scratch
    Column<int32_t> faces;   // those that are listed, and their number
    Array<int64_t, 1> n_faces;
    Column<int32_t> found;        // scratch: faces that are found in a cell
    Array<int32_t, Any, 2> pairs; // scratch: cells, and faces to be listed there
    Column<bool> is_whole;        // faces that are listed in all cells that their boxes touch
};

// Convex polygons, clockwise.
struct Pieces {
    Array<double, Any, Any, 2> corners;
    Column<int64_t> n_corners;
};

// Visible parts of faces that are partly visible; no rows where no caller asks. Piece p has
// corners[starts[p]] ... corners[starts[p + 1] - 1]; those of a face follow one another. `used` are
// pieces and corners so far, also where there is no room for them, and 1 if there was none.
struct VisiblePieces {
    Points corners;
    Column<int64_t> starts;
    Column<int32_t> faces;
    Array<int64_t, 3> used;
};

// Scratch for one face: its image and lines; those of an occluder, with the line of equal depth;
// two polygons, and values at corners; parts of an edge; lines of a cell; a stack of convex parts
// of the face, and how often each was halved; lines along which faces in contact pass through it,
// as Crossings.segments; pieces that are handed out; Counts.n_compared.
struct Work {
    Points target;
    Lines own;
    Points corners;
    Lines lines;
    Points spare, other;
    Column<double> values;
    Array<double, Any, 2> ranges;
    Array<double, 4, 5> cell;
    Pieces parts;
    Column<int64_t> levels;
    Array<double, Any, 7> intersections;
    VisiblePieces kept;
    Array<int64_t, 1> n_compared;
};

// Edge in the image: both ends, and the vertices there, -1 for none; 1 if it is not wholly hidden.
struct Segment {
    Array<double, 2, 4> uvw;
    Array<int64_t, 3> ends;
};

// Edges of a surface: vertices, the lower one first; two of its faces, -1 for no second one; the
// edge from each corner of a face to the next.
struct Edges {
    Array<const int32_t, Any, 2> vertices, faces;
    Column<const int8_t> kind;
    Array<const int32_t, Any, 3> of_face;
};

// Parts of event edges that cross faces in the image, as a linked list for each face: the last
// crossing of each, -1 for none, the one before, -1 for the first, its edge, -1 for a rim, and its
// number in the list. And which event edges faces in front hide from end to end.
struct Crossings {
    Column<int32_t> last, before, edge, number;
    Array<double, Any, 7> segments;
    Column<bool> is_hidden;
};

// Pose of a surface, with what is found of it; `area_error` bounds the errors of both areas, px^2.
struct View {
    Pinhole camera;
    Projected projected;
    CellGrid grid;
    Edges edges;
    Column<bool> is_event; // unused by half planes
    Work work;
    Column<double> visible, area_error;
};

} // namespace rastercov::exact
