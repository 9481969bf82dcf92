// Surface: its bounding box, and contacts, found once a decade of distances.
//
// Twin: rastercov.core.exact.surface.
#include "solver/surface.hpp"
#include "range.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov::engine {
namespace {
using exact::BLOCK;

int64_t blocks_of(int64_t n) { return (n + BLOCK - 1) / BLOCK; }

// Contacts of the faces of a mesh in the order of the surface.
Contacts sort_contacts(Contacts own, const Int32Array &rank) {
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
    : _arrays(arrays), _owner(std::move(owner)), _finder(std::move(finder)) {
    double squared = 0.0;
    for (size_t axis = 0; axis < 3; axis++) {
        Range all;
        for (int64_t v = 0; v < vertices().rows(); v++) all.add(vertices()(v, int64_t(axis)));
        const auto [low, high] = all;
        _bounds[0][axis] = low;
        _bounds[1][axis] = high;
        _centre[axis] = (low + high) / 2.0;
        squared += (high - low) * (high - low);
    }
    _diagonal = std::sqrt(squared);
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
    if (_finder.find) found = sort_contacts(_finder.find(distance), rank());
    found.blocks = Room<bool>(blocks_of(n), false);
    for (int64_t f = 0; f < n; f++)
        if (found.faces[f]) found.blocks[f / BLOCK] = true;
    _contacts.emplace_back(decade, std::make_unique<const Contacts>(std::move(found)));
    return *_contacts.back().second;
}

} // namespace rastercov::engine
