// What tests read of surfaces and solvers: arrays as they are, one pose at a time.
//
// Twins: tests/exact/test_surface.py, tests/exact/test_blocks.py, tests/mesh/test_outward.py.
#include "bind.hpp"
#include "python/handle.hpp"
#include "python/tables.hpp"
#include "python/views.hpp"
#include "solver/limits.hpp"
#include "solver/mesh.hpp"
#include "solver/pass.hpp"
#include <atomic>

namespace rastercov {
namespace {
namespace nb = nanobind;
using engine::Camera;
using engine::Part;
using engine::Surface;
using Mask = BoolArray;
using Of = nb::handle_t<SurfaceHandle>;

template <class T, int64_t... E> nb::object copy_of(const Array<T, E...> &array) {
    using Value = std::remove_const_t<T>;
    using Kept = std::conditional_t<std::is_same_v<Value, bool>, uint8_t, Value>;
    std::vector<Kept> values(array.begin(), array.end());
    size_t columns = 0;
    if constexpr (sizeof...(E) == 2) columns = size_t(array.extent(1));
    nb::object found = array_of(std::move(values), columns);
    return std::is_same_v<Value, bool> ? found.attr("view")("bool") : found;
}

template <class T> engine::Room<T> room_of(const Column<const T> &array) {
    engine::Room<T> held(array.rows());
    std::copy(array.begin(), array.end(), held.begin());
    return held;
}

// --- surfaces ---

// The same surface, no block of which is decided at once.
SurfaceHandle one_by_one(const SurfaceHandle &whole) {
    const Surface &of = *whole.surface;
    struct Kept {
        std::shared_ptr<const Surface> whole;
        engine::Room<bool> has_flat, is_plain;
    };
    const int64_t n_blocks = of.blocks().has_flat.rows(), n_edges = of.blocks().is_plain.rows();
    const auto kept = std::make_shared<Kept>(whole.surface, engine::Room<bool>(n_blocks, true),
                                             engine::Room<bool>(n_edges, false));
    engine::SurfaceArrays arrays = of.arrays();
    arrays.opaque.blocks.has_flat = kept->has_flat.rows();
    arrays.opaque.blocks.is_plain = kept->is_plain.rows();
    const auto find = [kept](double distance) -> engine::Contacts {
        const engine::Contacts &found = kept->whole->contacts(distance);
        return {room_of<bool>(found.faces.rows()), room_of<int64_t>(found.starts.rows()),
                room_of<int32_t>(found.partners.rows())};
    };
    return {
        std::make_shared<const Surface>(arrays, kept, engine::ContactFinder{of.diagonal(), find})};
}

const Surface &surface_of(Of self) { return *nb::cast<const SurfaceHandle &>(self).surface; }

nb::tuple edges_of(Of self) {
    const exact::Edges &edges = surface_of(self).edges();
    return nb::make_tuple(view_of(edges.vertices, self), view_of(edges.faces, self),
                          view_of(edges.kind, self), view_of(edges.of_face, self));
}

// Vertices, faces, blocks and source.
nb::tuple part_of(const Part &part, nb::handle self) {
    const exact::Blocks &b = part.blocks;
    const nb::tuple blocks = nb::make_tuple(
        view_of(b.has_flat, self), view_of(b.patch, self), view_of(b.patch_starts, self),
        view_of(b.of_patch, self), view_of(b.lowest, self), view_of(b.joins, self),
        view_of(b.is_plain, self), view_of(b.starts, self), view_of(b.of_edges, self));
    return nb::make_tuple(view_of(part.vertices, self), view_of(part.faces, self), blocks,
                          view_of(part.source, self));
}

// Faces in contact, and starts and faces of their partners.
nb::tuple contacts_of(Of self, double distance) {
    const engine::Contacts *found = nullptr;
    {
        const Surface &surface = surface_of(self);
        const nb::gil_scoped_release unlocked;
        found = &surface.contacts(distance);
    }
    return nb::make_tuple(view_of(found->faces.rows(), self), view_of(found->starts.rows(), self),
                          view_of(found->partners.rows(), self));
}
// Whether the mesh of a host without Python hides its back.
bool hides_its_back(exact::Vertices vertices, engine::Faces faces, Column<const uint8_t> roles,
                    double distance) {
    return engine::make_mesh(vertices, faces, roles).surface->hides_its_back(distance);
}

template <class Get> void def_read(nb::module_ &m, const char *name, Get get) {
    const std::string text = "def " + std::string(name) +
                             "(surface: rastercov.engine.solver_surface.Surface) -> typing.Any";
    m.def(name, get, nb::arg("surface"), nb::sig(text.c_str()));
}

void def_surfaces(nb::module_ &m) {
    m.def("one_by_one", one_by_one, nb::arg("surface"),
          nb::sig("def one_by_one(surface: rastercov.engine.solver_surface.Surface) -> "
                  "rastercov.engine.solver_surface.Surface"),
          "The same surface, no block of which is decided at once.");
    def_read(m, "opaque", [](Of self) { return part_of(surface_of(self).arrays().opaque, self); });
    def_read(m, "targets", [](Of self) { return part_of(surface_of(self).targets(), self); });
    def_read(m, "edges", edges_of);
    def_read(m, "rank", [](Of self) { return view_of(surface_of(self).rank(), self); });
    def_read(m, "place", [](Of self) { return view_of(surface_of(self).place(), self); });
    def_read(m, "centre", [](Of self) {
        const auto &at = surface_of(self).centre();
        return nb::make_tuple(at[0], at[1], at[2]);
    });
    m.def("contacts", contacts_of, nb::arg("surface"), nb::arg("distance"),
          nb::sig("def contacts(surface: rastercov.engine.solver_surface.Surface, "
                  "distance: float) -> tuple[typing.Any, ...]"),
          "Faces in contact, (F,), and starts and faces of partners, for cameras within a "
          "distance.");
    def(m, "hides_its_back", hides_its_back,
        "True if no camera outside, with no surface within a distance, sees the back of a face.",
        "vertices", "faces", "roles", "distance");
}

// --- solvers ---

// A solver that one thread at a time uses, until a pose fails.
struct OneSolver {
    engine::Solver solver;
    std::atomic<bool> is_busy = false;
    bool is_whole = true;
    OneSolver(const SurfaceHandle &surface, bool is_certifying, bool keeps_pieces)
        : solver(surface.surface, is_certifying, keeps_pieces) {}
};

// Uses a solver; what fails on the way leaves it useless.
template <class Use> auto use(OneSolver &self, Use with) {
    require(!self.is_busy.exchange(true),
            "expected one thread in a solver, got a second one; pass each thread its own");
    struct Leave {
        OneSolver &self;
        ~Leave() { self.is_busy = false; }
    } leave = {self};
    require(self.is_whole,
            "expected a working solver, got one whose last call failed; create another one");
    self.is_whole = false;
    struct Keep {
        OneSolver &self;
        int n = std::uncaught_exceptions();
        ~Keep() { self.is_whole = std::uncaught_exceptions() == n; }
    } keep = {self};
    return with(self.solver);
}

void solve(OneSolver &self, const Camera &camera, const Array<const double, 4, 4> &pose,
           double near, bool front_only) {
    const engine::View view = {camera, engine::pose_of(pose), near, front_only};
    use(self, [&](engine::Solver &solver) { solver.solve(view, nullptr); });
}
void leave_out(OneSolver &self, const Mask &faces) {
    use(self, [&](engine::Solver &solver) { solver.leave_out(faces); });
}

template <class Get> void def_array(nb::class_<OneSolver> &type, const char *name, Get get) {
    const auto read = [get](OneSolver &self) {
        return use(self, [&](engine::Solver &solver) { return copy_of(get(solver)); });
    };
    offer(type, name, "typing.Any", read);
}

// Boxes of all opaque faces, also of blocks that no pass has needed them of.
FloatRows<6> boxes_of(engine::Solver &solver) {
    const exact::Projected &projected = solver.plane().image().opaque();
    for (int32_t f = 0; f < projected.faces.rows(); f += int32_t(exact::BLOCK))
        exact::lay_boxes({&f, {1}}, projected);
    return projected.box;
}

nb::tuple kept_of(OneSolver &self) {
    return use(self, [](engine::Solver &solver) {
        const exact::VisiblePieces &kept = solver.plane().kept();
        const int64_t n = kept.used[0];
        const Array<double, Any, 2> corners = {kept.corners.data, {kept.used[1], 2}};
        const Column<int64_t> starts = {kept.starts.data, {n + 1}};
        const Column<int32_t> faces = {kept.faces.data, {n}};
        return nb::make_tuple(copy_of(corners), copy_of(starts), copy_of(faces));
    });
}

nb::dict counts_of(OneSolver &self) {
    return use(self, [](engine::Solver &solver) {
        const engine::Counts &counts = solver.plane().counts();
        nb::dict found;
        found["n_events"] = counts.n_events;
        found["n_crossed"] = counts.n_crossed;
        found["n_left"] = counts.n_left;
        found["n_regions"] = counts.n_regions;
        found["n_doubtful"] = counts.n_doubtful;
        found["n_clipped"] = counts.n_clipped;
        found["n_compared"] = counts.n_compared;
        return found;
    });
}

// Constants by which the arrays of a solver are read.
void offer_constants(nb::module_ &m) {
    using namespace exact;
    const std::pair<const char *, int64_t> constants[] = {{"BLOCK", BLOCK},
                                                          {"MIXED", MIXED},
                                                          {"LIVE", LIVE},
                                                          {"CROSSED", CROSSED},
                                                          {"UNEVEN", UNEVEN},
                                                          {"U_MIN", U_MIN},
                                                          {"U_MAX", U_MAX},
                                                          {"V_MIN", V_MIN},
                                                          {"V_MAX", V_MAX},
                                                          {"SUM_OF_WIDTHS", SUM_OF_WIDTHS},
                                                          {"CONSISTENT", CONSISTENT},
                                                          {"REVERSED", REVERSED},
                                                          {"NON_MANIFOLD", NON_MANIFOLD}};
    for (const auto &[name, value] : constants) m.attr(name) = value;
}

void def_solver(nb::module_ &m) {
    using S = engine::Solver;
    offer_constants(m);
    auto type = nb::class_<OneSolver>(m, "Solver", "A surface, one pose at a time.");
    type.def(nb::init<const SurfaceHandle &, bool, bool>(), nb::arg("surface"),
             nb::arg("is_certifying"), nb::arg("keeps_pieces"));
    def(type, "solve", solve, "Compute all figures of a pose.", "camera", "pose", "near",
        "front_only");
    def(type, "leave_out", leave_out, "Measure some faces no more; none for no rows.", "faces");
    def_array(type, "visible", [](S &s) { return s.areas().visible; });
    def_array(type, "area", [](S &s) { return s.areas().area; });
    def_array(type, "area_error", [](S &s) { return s.areas().area_error; });
    def_array(type, "is_certified", [](S &s) { return s.is_certified(); });
    def_array(type, "state", [](S &s) { return s.plane().image().everything().state; });
    def_array(type, "side", [](S &s) { return s.plane().image().everything().side; });
    def_array(type, "block_state", [](S &s) { return s.plane().image().opaque().block_state; });
    def_array(type, "block_side", [](S &s) { return s.plane().image().opaque().block_side; });
    def_array(type, "block_box", [](S &s) { return s.plane().image().opaque().block_box; });
    def_array(type, "regions", [](S &s) { return s.plane().regions(); });
    def_array(type, "boxes", boxes_of);
    def_array(type, "extent", [](S &s) { return s.plane().extent(); });
    offer(type, "kept", "tuple[typing.Any, ...]", kept_of);
    offer(type, "counts", "dict[str, int]", counts_of);
    offer(type, "room_for_pieces", "int", [](OneSolver &self) {
        return use(self, [](S &s) { return s.plane().room_for_pieces(); });
    });
}

} // namespace

void register_solver_parts(nb::module_ &m) {
    def_surfaces(m);
    def_solver(m);
}

} // namespace rastercov
