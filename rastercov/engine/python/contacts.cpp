// The border of contacts to Python: rastercov.engine.solver_contacts.
//
// Twin: tests/mesh/test_contacts.py.
#include "solver/contacts.hpp"
#include "bind.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace {
int64_t find_touching(const engine::Welded &mesh, BoolArray is_flat, Int32Array labels,
                      double tolerance, int64_t n_threads, int64_t most_at_corner,
                      int64_t leaves_a_part, Column<bool> touching) {
    require(touching.rows() == mesh.faces.rows(), "touching must have one value for each face");
    std::atomic<int64_t> n_steps = 0;
    const engine::ContactOptions options = {n_threads, most_at_corner, leaves_a_part, &n_steps};
    engine::Room<bool> found = engine::find_touching(mesh, is_flat, labels, tolerance, options);
    std::copy(found.begin(), found.end(), touching.begin());
    return n_steps;
}

// Partners of faces; the number of all, of which there may be more than room, and of the steps.
std::pair<int64_t, int64_t> find_partners(const engine::Welded &mesh, double tolerance,
                                          BoolArray touching, int64_t most_at_corner,
                                          Column<int64_t> starts, Column<int32_t> partners) {
    std::atomic<int64_t> n_steps = 0;
    engine::ContactOptions options;
    options.most_at_corner = most_at_corner;
    options.n_steps = &n_steps;
    engine::Room<bool> own(touching.rows());
    std::copy(touching.begin(), touching.end(), own.begin());
    const engine::Contacts found = engine::find_partners(mesh, std::move(own), tolerance, options);
    require(starts.rows() == found.starts.size(), "starts must have one value more than faces");
    std::copy_n(found.starts.rows().data, starts.rows(), starts.begin());
    std::copy_n(found.partners.rows().data, std::min(found.partners.size(), partners.rows()),
                partners.begin());
    return {found.partners.size(), n_steps};
}
} // namespace

void register_solver_contacts(nanobind::module_ &m) {
    m.attr("MOST_AT_A_CORNER") = engine::ContactOptions().most_at_corner;
    m.attr("LEAVES_A_PART") = engine::ContactOptions().leaves_a_part;
    m.attr("BOX_MARGIN") = engine::BOX_MARGIN;
    m.attr("ROUNDING_FACTOR") = engine::ROUNDING_FACTOR;
    m.attr("PAIRS_A_FACE") = engine::PAIRS_A_FACE;
    m.attr("CONTACT") = engine::CONTACT;
    m.attr("REACH") = engine::REACH;
    m.attr("MOST_PARTNERS") = engine::MOST_PARTNERS;
    def(m, "decade_of", engine::decade_of,
        "Decade of a distance of cameras, metres, for a mesh of a diagonal.", "distance",
        "diagonal");
    def(m, "find_touching", find_touching,
        "Mark the faces within a tolerance of another one; returns the steps that it took.", "mesh",
        "is_flat", "labels", "tolerance", "n_threads", "most_at_corner", "leaves_a_part",
        "touching");
    def(m, "find_partners", find_partners,
        "Faces in contact with each of those that touch; their number, whatever the room, and "
        "steps.",
        "mesh", "tolerance", "touching", "most_at_corner", "starts", "partners");
}

} // namespace rastercov
