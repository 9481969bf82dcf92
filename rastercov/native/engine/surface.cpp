// Surface: what is checked of its arrays, and contacts, found once a decade of distances.
//
// Twin: rastercov.exact.surface.
#include "engine/surface.hpp"
#include <algorithm>
#include <cmath>
#include <limits>

namespace rastercov::engine {
namespace {
using exact::BLOCK;

int64_t blocks_of(int64_t n) { return (n + BLOCK - 1) / BLOCK; }

void check_part(const Part &part) {
    const exact::Blocks &blocks = part.blocks;
    const int64_t n = part.faces.rows(), patches = blocks.lowest.rows(), of_faces = blocks_of(n);
    require_indices(part.faces, part.vertices.rows(), "faces must hold vertices");
    require(part.source.rows() == part.vertices.rows(), "source must have one row for each vertex");
    require(blocks.has_flat.rows() == of_faces && blocks.patch.rows() == n &&
                blocks.patch_starts.rows() == of_faces + 1 && blocks.of_patch.rows() == patches &&
                blocks.starts.rows() == blocks.is_plain.rows() + 1,
            "blocks must be those of the faces");
    require_indices(blocks.patch, patches, "patch must hold patches");
    require_indices(blocks.patch_starts, patches + 1, "patch_starts must hold patches");
    require_indices(blocks.of_patch, of_faces, "of_patch must hold blocks");
    require_indices(blocks.lowest, n, "lowest must hold faces");
    require_indices(blocks.of_edges, of_faces, "of_edges must hold blocks");
    require_indices(blocks.starts, blocks.of_edges.rows() + 1, "starts must hold rows of of_edges");
    for (int64_t k = 0; k < blocks.joins.rows(); k++) {
        const int64_t one = blocks.joins(k, 0), other = blocks.joins(k, 1);
        require(0 <= one && std::max(one, other < 0 ? ~other : other) < patches,
                "joins must hold patches");
    }
}

void check_edges(const exact::Edges &edges, const Part &part) {
    const int64_t n = part.faces.rows(), n_edges = edges.kind.rows();
    require(edges.faces.rows() == n_edges && edges.vertices.rows() == n_edges &&
                edges.of_face.rows() == n,
            "edges must have one row in each array");
    require(part.blocks.is_plain.rows() == blocks_of(n_edges), "blocks must be those of the edges");
    require_indices(edges.vertices, part.vertices.rows(), "edges must hold vertices");
    require_indices(edges.of_face, n_edges, "of_face must hold edges");
    for (int64_t e = 0; e < n_edges; e++)
        require(0 <= edges.faces(e, 0) && std::max(edges.faces(e, 0), edges.faces(e, 1)) < n,
                "edges must hold faces");
}

std::array<std::array<double, 3>, 2> bounds_of(const exact::Vertices &vertices) {
    constexpr double INF = std::numeric_limits<double>::infinity();
    std::array<std::array<double, 3>, 2> bounds = {{{INF, INF, INF}, {-INF, -INF, -INF}}};
    for (int64_t v = 0; v < vertices.rows(); v++)
        for (size_t axis = 0; axis < 3; axis++) {
            const double at = vertices(v, int64_t(axis));
            bounds[0][axis] = std::min(bounds[0][axis], at);
            bounds[1][axis] = std::max(bounds[1][axis], at);
        }
    return bounds;
}

// Contacts of the faces of a mesh in the order of the surface.
Contacts sorted(Contacts own, const Array<const int32_t, Any> &rank) {
    const int64_t n = rank.rows(), n_partners = own.partners.size();
    require(own.faces.size() == n && own.starts.size() == n + 1 && own.starts[0] == 0 &&
                own.starts[n] == n_partners && std::is_sorted(own.starts.begin(), own.starts.end()),
            "contacts must have one row for each opaque face");
    require_indices(own.partners.rows(), n, "partners must hold opaque faces");
    if (std::is_sorted(rank.begin(), rank.end())) return own;
    Room<int32_t> place(n);
    for (int64_t f = 0; f < n; f++) place[rank[f]] = int32_t(f);
    Contacts found = {Room<bool>(n), Room<int64_t>(n + 1), Room<int32_t>(n_partners)};
    found.starts[0] = 0;
    for (int64_t f = 0; f < n; f++) {
        int64_t at = found.starts[f];
        found.faces[f] = own.faces[rank[f]];
        for (int64_t k = own.starts[rank[f]]; k < own.starts[rank[f] + 1]; k++)
            found.partners[at++] = place[own.partners[k]];
        found.starts[f + 1] = at;
    }
    return found;
}
} // namespace

Surface::Surface(const SurfaceArrays &arrays, Owner owner, ContactFinder finder)
    : _arrays(arrays), _bounds(bounds_of(arrays.opaque.vertices)), _owner(std::move(owner)),
      _finder(std::move(finder)) {
    check_part(arrays.opaque);
    check_edges(arrays.edges, arrays.opaque);
    if (has_targets()) check_part(arrays.targets);
    require(rank().rows() == n_opaque(), "rank must have one row for each opaque face");
    require_indices(rank(), n_opaque(), "rank must hold opaque faces");
    require_indices(place(), n_faces(), "place must hold faces");
}

Surface::Surface(std::shared_ptr<const Surface> rest, const SurfaceArrays &arrays, Owner owner,
                 ContactFinder finder)
    : _arrays(rest->_arrays), _bounds(bounds_of(arrays.opaque.vertices)),
      _finder(std::move(finder)) {
    require(arrays.opaque.vertices.rows() == vertices().rows() &&
                arrays.targets.vertices.rows() == targets().vertices.rows(),
            "there must be one position for each vertex");
    _arrays.centre = arrays.centre;
    _arrays.diagonal = arrays.diagonal;
    _arrays.opaque.vertices = arrays.opaque.vertices;
    _arrays.targets.vertices = arrays.targets.vertices;
    _owner = std::make_shared<std::pair<std::shared_ptr<const Surface>, Owner>>(std::move(rest),
                                                                                std::move(owner));
}

int decade_of(double distance, double diagonal) {
    const double far = diagonal > 0.0 ? distance / (REACH * diagonal) : 1.0;
    return far > 1.0 ? int(std::ceil(std::log10(std::min(far, 1e300)))) : 0;
}

bool Surface::hides_its_back(double distance) const {
    if (!_finder.hides_its_back) return false;
    const int decade = decade_of(distance, _finder.diagonal);
    const std::scoped_lock lock(_finds);
    for (const auto &[own, found] : _hides_its_back)
        if (own == decade) return found;
    return _hides_its_back.emplace_back(decade, _finder.hides_its_back(distance)).second;
}

const Contacts &Surface::contacts(double distance) const {
    const int decade = decade_of(distance, _finder.diagonal);
    const std::scoped_lock lock(_finds);
    for (const auto &[own, found] : _contacts)
        if (own == decade) return *found;
    const int64_t n = n_opaque();
    Contacts found = {Room<bool>(n, false), Room<int64_t>(n + 1, 0), {}};
    if (_finder.find) found = sorted(_finder.find(distance), rank());
    found.blocks = Room<bool>(blocks_of(n), false);
    for (int64_t f = 0; f < n; f++)
        if (found.faces[f]) found.blocks[f / BLOCK] = true;
    _contacts.emplace_back(decade, std::make_unique<const Contacts>(std::move(found)));
    return *_contacts.back().second;
}

} // namespace rastercov::engine
