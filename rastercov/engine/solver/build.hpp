// Surface of the faces of a mesh: welded vertices, their order, edges, patches and blocks.
//
// Twin: tests/exact/test_surface.py, by numpy.
#pragma once
#include "solver/surface.hpp"

namespace rastercov {
namespace engine {

// Faces from which on they, and vertices, are sorted: figures of fewer fit the cache in any order.
constexpr int64_t LEAST_SORTED = 1 << 14;

constexpr double LARGEST_COORDINATE = 1e30; // metres

using Rows = Array<const uint64_t, Any, Any>;

// Sets `first`, (N,), to the first of the rows that equals each row, bit for bit; its own if none.
void find_first_equal(Rows rows, Column<int64_t> first);

// True for a triangle without area, to within rounding.
bool is_flat(const double *first, const double *second, const double *third);

// Faces of a mesh by the vertices of their corners; one number for all vertices at one point.
struct Welded {
    exact::Vertices vertices;           // (V, 3) metres
    Array<const int64_t, Any, 3> faces; // (F, 3)
};

// Number of the edge-connected part of each face, -1 with a repeated vertex, (F,); none unless
// every edge has two faces in opposite senses, and every part a volume greater than rounding.
Room<int32_t> find_outward_parts(const Welded &mesh);

// Surface of `opaque` faces, and of the targets of `all`: those that `is_target`, (F,), marks; no
// rows where there are none. The opaque faces are those of `all` that are left, in their order, or
// one that is none of them.
std::shared_ptr<const Surface> build_surface(const Welded &opaque, const Welded &all,
                                             BoolArray is_target, ContactFinder finder,
                                             int64_t least_sorted = LEAST_SORTED);

// The surface with other positions of the mesh; those of all faces are for its targets.
std::shared_ptr<const Surface> move_surface(std::shared_ptr<const Surface> rest,
                                            exact::Vertices opaque, exact::Vertices all,
                                            ContactFinder finder);

} // namespace engine

RECORD(engine::Welded, vertices, faces);

} // namespace rastercov
