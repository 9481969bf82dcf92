// Surface of a mesh, as the engine sees it: welded vertices, faces, edges, blocks, contacts.
//
// It never changes, so that threads and solvers share one. Its arrays are views of memory that it
// keeps alive, as build_surface makes them. The opaque faces come first, and all but `place` and
// `targets` are theirs, bit for bit as without targets.
//
// Twin: rastercov.core.exact.surface.
#pragma once
#include "exact/records.hpp"
#include "solver/room.hpp"
#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

namespace rastercov::engine {

using Faces = Array<const int32_t, Any, 3>;
using Owner = std::shared_ptr<const void>; // what keeps the memory of views alive, or null

// Faces in contact with another one. The partners of face f are
// partners[starts[f]] ... partners[starts[f + 1] - 1]; none are listed of a face with very many.
struct Contacts {
    Room<bool> faces;
    Room<int64_t> starts; // one more than faces
    Room<int32_t> partners;
    Room<bool> blocks = {}; // blocks with a face in contact, which the surface fills in
};

// The way to contacts of the opaque faces of a mesh, in their order there. What it throws is passed
// on, and the next query asks again.
struct ContactFinder {
    double diagonal = 0.0; // of which tolerances are a part, metres
    std::function<Contacts(double distance)> find = nullptr; // for cameras with no surface beyond
    // True if no camera outside, with no surface beyond, sees a back; without it some may.
    std::function<bool(double distance)> hides_its_back = nullptr;
};

// Decade of a distance of cameras, metres, on which contacts depend: 0 up to REACH diagonals.
constexpr double REACH = 30.0;
int decade_of(double distance, double diagonal);

// Faces with their vertices.
struct Part {
    exact::Vertices vertices; // (V, 3) positions that faces use, each once, metres; not shifted
    Faces faces;              // (F, 3)
    exact::Blocks blocks;
    IntArray source; // (V,) vertex of the mesh, or of its opaque part, of each
};

struct SurfaceArrays {
    Part opaque;
    exact::Edges edges;
    Int32Array rank; // (F,) place among the opaque faces of the mesh: the lower wins
    IntArray place;  // of each face of the mesh among all; no rows: its own index
    Part targets;    // faces that hide nothing; no rows without any
};

class Surface {
  public:
    Surface(const SurfaceArrays &arrays, Owner owner, ContactFinder finder = {});
    Surface(const Surface &) = delete;
    Surface &operator=(const Surface &) = delete;

    // Of the bounding box of the opaque faces, metres.
    const std::array<double, 3> &centre() const { return _centre; }
    double diagonal() const { return _diagonal; }
    const exact::Vertices &vertices() const { return _arrays.opaque.vertices; }
    const Faces &faces() const { return _arrays.opaque.faces; }
    const exact::Edges &edges() const { return _arrays.edges; }
    const exact::Blocks &blocks() const { return _arrays.opaque.blocks; }
    const Int32Array &rank() const { return _arrays.rank; }
    const IntArray &source() const { return _arrays.opaque.source; }
    const IntArray &place() const { return _arrays.place; }
    const Part &targets() const { return _arrays.targets; }
    const SurfaceArrays &arrays() const { return _arrays; }

    // Least and greatest coordinates of the opaque faces.
    const std::array<std::array<double, 3>, 2> &bounds() const { return _bounds; }

    int64_t n_opaque() const { return faces().rows(); }
    int64_t n_faces() const { return n_opaque() + targets().faces.rows(); } // with the targets
    bool has_targets() const { return targets().faces.rows() > 0; }
    bool is_sorted() const { return place().rows() > 0; } // faces are not in the order of the mesh

    // Contacts for cameras with no surface beyond a distance, metres, found at the first query for
    // a decade of distances; without a finder there are none. They live as long as the surface.
    const Contacts &contacts(double distance) const;
    // True if back faces cannot be the nearest surface for a camera outside; as of contacts.
    bool hides_its_back(double distance) const;

  private:
    SurfaceArrays _arrays;
    std::array<std::array<double, 3>, 2> _bounds;
    std::array<double, 3> _centre;
    double _diagonal;
    Owner _owner;
    ContactFinder _finder;
    mutable std::mutex _finds; // held while contacts are looked up or found
    mutable std::vector<std::pair<int, std::unique_ptr<const Contacts>>> _contacts; // by decade
    mutable std::vector<std::pair<int, bool>> _hides_its_back;
};

} // namespace rastercov::engine
