// The passes over a pose, in the order in which solver/plane_solver.cpp runs them.
//
// Arrays have room as engine/ makes it: nothing is checked here. Each is described where it is
// defined, in the file that is named.
//
// Twins: tests/exact/test_exactness.py.
#pragma once
#include "exact/records.hpp"
#include "lens/planes.hpp"
#include <utility>

namespace rastercov::exact {

// Crossings of a face beyond which it is left to half planes, which divide the image by cells: it
// is UNFIT, and no more are listed.
constexpr int64_t MOST_CROSSINGS = 24;
// Cells of a face beyond which it is left to half planes.
constexpr int64_t MOST_CELLS = 128;

// Faces in contact with face f: faces[starts[f]] ... faces[starts[f + 1] - 1].
struct Partners {
    IntArray starts;
    Int32Array faces;
};

// --- setup.cpp ---

int64_t project(Vertices vertices, const Pinhole &camera, Array<double, Any, 3> uvw);
std::pair<int64_t, int64_t> set_up_plain(const Pinhole &camera, bool front_only, int64_t n_out,
                                         const Projected &projected, Column<double> area_error,
                                         Array<double, 7> extent, Column<int32_t> rest);
std::pair<int64_t, int64_t> set_up(Vertices vertices, Int32Array rest, const Pinhole &camera,
                                   bool front_only, const Projected &projected,
                                   Column<double> area_error, Array<double, 7> extent);
void lay_boxes(Int32Array faces, const Projected &projected);

// --- grid.cpp ---

void ask_for_all(const CellGrid &grid);
bool ask_for_faces(Int32Array faces, Array<double, Any, 6> box, const CellGrid &grid);
int64_t fill_grid(const Projected &projected, const CellGrid &grid);

// --- half_plane.cpp ---

int64_t visible_areas(Int32Array targets, int64_t first, Vertices vertices, const View &view,
                      Column<int32_t> marks, const Pieces &pieces);

// --- event.cpp ---

int64_t find_event_edges(const Edges &edges, const Projected &projected, Column<bool> is_event,
                         Column<int32_t> events);
bool ask_for_events(Int32Array events, const Edges &edges, Vertices vertices, const Pinhole &camera,
                    const Projected &projected, double tolerance, const CellGrid &grid,
                    const Segment &segment);
int64_t mark_crossed(Int32Array events, Vertices vertices, const View &view,
                     Array<double, 7> extent, double tolerance, int64_t n_clipped,
                     const Segment &segment, const Crossings &crossings);

// --- certificate.cpp ---

void mark_uncertifiable(Int32Array events, const Edges &edges, const Projected &projected,
                        BoolArray in_contact, BoolArray has_contact, IntArray partner_starts,
                        double thinnest, Column<bool> is_at_event);
std::pair<int64_t, int64_t> find_regions(Int32Array events, BoolArray is_hidden, const View &view,
                                         Column<int32_t> parent, Column<int32_t> region,
                                         Column<int32_t> out);
int64_t classify_regions(const Projected &projected, Column<double> visible, Int32Array region,
                         Int32Array largest, Column<int32_t> decision, Column<bool> is_certified,
                         Column<int32_t> doubtful, double certain);

// --- arrangement.cpp ---

int64_t arrangement_areas(Int32Array targets, const Crossings &crossings, const Partners &partners,
                          const View &view, const Pieces &pieces, Column<int32_t> left);

// --- lens.cpp ---

// Rounding of the area under an edge, relative to its length and the size of the image: positions
// to 2^-50 of the size, some ten times over.
constexpr double EDGE_ROUNDING = 0x1p-46;

// Sums over the planes of a camera: areas, px^2, and planes by the kind of their figure:
// `n_certified` with a certified figure, `n_visible` those of them in which the face is visible,
// `n_computed` the others that show it.
struct PlaneSums {
    Column<double> area, visible, area_error;
    Column<int8_t> n_certified, n_visible, n_computed;
};

// Fills in the places of vertices in a plane and in the image, NaN outside its window.
void vertex_images(Vertices uvw, const lens::PlaneRecord &plane, Array<double, Any, 4> places,
                   Column<bool> is_inside);
// Fills in the area between the image of each edge and its chord, px^2, from its first end to its
// second; the number of edges that are too long for any rule, NaN and listed in `longer`.
int64_t edge_bulges(const lens::PlaneRecord &plane, Array<const int32_t, Any, 2> ends,
                    FloatRows<4> places, Column<double> bulge, Column<int32_t> longer);
// Measures the opaque faces that are wholly inside the image or outside it, by shared edges: `own`,
// the drawn area of each face in this plane, and `is_done`, faces that need no more. `sides` are
// the edges from each corner of a face to the next, ~e where one runs backwards.
void measure_simple(const Projected &projected, Array<const int32_t, Any, 3> sides,
                    FloatRows<4> places, FloatArray bulge, const lens::PlaneRecord &plane,
                    Column<double> own, Column<bool> is_done, const PlaneSums &out);
// Lists the outlines of the faces that are not done, and the kept pieces, in units of a plane; the
// number of outlines, which come first.
int64_t collect(Vertices vertices, BoolArray is_done, const Projected &projected,
                const VisiblePieces &kept, const Pinhole &camera, const lens::PlaneRecord &plane,
                const VisiblePieces &found);
// Adds the images of polygons, (M, 2), to the figures of faces.
void add_images(const VisiblePieces &found, int64_t n_outlines, FloatRows<2> images,
                const lens::PlaneRecord &plane, Column<double> own, const PlaneSums &out);
// Adds what a plane shows and certifies, whose areas are magnified by `stretch` at most; `own` is
// lost.
void add_figures(Column<const uint16_t> state, const VisiblePieces &kept, FloatArray visible,
                 FloatArray area_error, BoolArray is_certified, double stretch, Column<double> own,
                 const PlaneSums &out);
// Fills in the faces that are certified, and limits bounds to `largest`, px^2.
void settle(const PlaneSums &figures, double largest, Column<bool> is_certified);
// True where all points are on the outer side of one plane through the eye. `sides` are inner
// normals, `margin` is the distance that is no rounding, relative to that of the farthest point.
bool are_beyond(Vertices points, Array<const double, 3> eye, Array<const double, 5, 3> sides,
                double margin);

} // namespace rastercov::exact
