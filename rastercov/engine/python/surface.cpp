// The border of `Surface` to Python: rastercov.engine.solver_surface.
//
// Twin: rastercov.core.exact.surface.
#include "bind.hpp"
#include "python/handle.hpp"
#include "python/views.hpp"
#include "solver/build.hpp"

namespace rastercov {
namespace {
namespace nb = nanobind;
using engine::Part;
using engine::Surface;
using engine::Welded;
using Positions = FloatRows<3>;

template <class T> engine::Room<T> copy_of(const Column<const T> &array) {
    engine::Room<T> held(array.rows());
    std::copy(array.begin(), array.end(), held.begin());
    return held;
}
template <class T> engine::Room<T> copy_of(nb::handle array) {
    return copy_of<T>(nb::cast<Column<const T>>(array));
}

// A function of Python that threads without its lock may call, and give up.
auto held_by(nb::object function) {
    const std::shared_ptr<nb::object> held(new nb::object(std::move(function)),
                                           [](const nb::object *last) {
                                               const nb::gil_scoped_acquire locked;
                                               delete last;
                                           });
    return [held](double distance, auto read) {
        const nb::gil_scoped_acquire locked;
        const nb::object found = (*held)(distance);
        return read(found);
    };
}

// Contacts by a function of Python, which returns faces, and starts and faces of partners; and
// whether backs are hidden, by another one.
engine::ContactFinder finder_by(double diagonal, nb::object find, nb::object hides_its_back) {
    engine::ContactFinder finder = {diagonal, {}, {}};
    finder.find = [call = held_by(std::move(find))](double distance) {
        return call(distance, [](const nb::object &found) -> engine::Contacts {
            return {copy_of<bool>(found[0]), copy_of<int64_t>(found[1]),
                    copy_of<int32_t>(found[2])};
        });
    };
    if (!hides_its_back.is_none())
        finder.hides_its_back = [call = held_by(std::move(hides_its_back))](double distance) {
            return call(distance, [](const nb::object &found) { return nb::cast<bool>(found); });
        };
    return finder;
}

using Handle = SurfaceHandle;

void build(Handle *self, const Welded &opaque, const Welded &all, BoolArray is_target,
           double diagonal, nb::object find_contacts, int64_t least_sorted,
           nb::object hides_its_back) {
    auto finder = finder_by(diagonal, std::move(find_contacts), std::move(hides_its_back));
    call_within_memory("Build the surface of a mesh", [&] {
        const nb::gil_scoped_release unlocked;
        new (self)
            Handle{engine::build_surface(opaque, all, is_target, std::move(finder), least_sorted)};
    });
}

Handle moved(const Handle &rest, Positions vertices, Positions all_vertices, double diagonal,
             nb::object find_contacts, nb::object hides_its_back) {
    auto finder = finder_by(diagonal, std::move(find_contacts), std::move(hides_its_back));
    return call_within_memory("Move the surface of a mesh", [&]() -> Handle {
        const nb::gil_scoped_release unlocked;
        return {engine::move_surface(rest.surface, vertices, all_vertices, std::move(finder))};
    });
}

// The same surface, no block of which is decided at once, for tests.
Handle one_by_one(const Handle &whole) {
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
        return {copy_of<bool>(found.faces.rows()), copy_of<int64_t>(found.starts.rows()),
                copy_of<int32_t>(found.partners.rows())};
    };
    return {
        std::make_shared<const Surface>(arrays, kept, engine::ContactFinder{of.diagonal(), find})};
}

const Surface &surface_of(nb::handle self) { return *nb::cast<const Handle &>(self).surface; }

nb::tuple edges_of(nb::handle_t<Handle> self) {
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
nb::tuple contacts_of(nb::handle_t<Handle> self, double distance) {
    const engine::Contacts *found = nullptr;
    {
        const Surface &surface = surface_of(self);
        const nb::gil_scoped_release unlocked;
        found = &surface.contacts(distance);
    }
    return nb::make_tuple(view_of(found->faces.rows(), self), view_of(found->starts.rows(), self),
                          view_of(found->partners.rows(), self));
}
} // namespace

void register_solver_surface(nb::module_ &m) {
    m.attr("LEAST_SORTED") = engine::LEAST_SORTED;
    def(m, "find_first_equal", engine::find_first_equal,
        "Set `first`, (N,), to the first of the rows that equals each, bit for bit.", "rows",
        "first");
    nb::class_<Handle> type(m, "Surface", "Surface of a mesh; see rastercov.core.exact.surface.");
    type.def(
        "__init__", build, nb::arg("opaque"), nb::arg("all"), nb::arg("is_target"),
        nb::arg("diagonal"), nb::arg("find_contacts"), nb::arg("least_sorted"),
        nb::arg("hides_its_back") = nb::none(),
        nb::sig(signature<void, Welded, Welded, BoolArray, double, nb::object, int64_t, nb::object>(
                    "__init__", true, "opaque", "all", "is_target", "diagonal", "find_contacts",
                    "least_sorted", "hides_its_back")
                    .c_str()));
    type.def("moved", moved, nb::arg("vertices"), nb::arg("all_vertices"), nb::arg("diagonal"),
             nb::arg("find_contacts"), nb::arg("hides_its_back"),
             nb::sig(("def moved(self, vertices: object, all_vertices: object, diagonal: float, "
                      "find_contacts: object, hides_its_back: object) -> Surface")),
             "The same faces at other positions.");
    type.def("one_by_one", one_by_one, nb::sig("def one_by_one(self) -> Surface"),
             "The same surface, no block of which is decided at once, for tests.");
    constexpr auto PART = "tuple[typing.Any, ...]", ARRAY = "typing.Any";
    offer(type, "opaque", PART, [](nb::handle_t<Handle> self) {
        return part_of(surface_of(self).arrays().opaque, self);
    });
    offer(type, "targets", PART,
          [](nb::handle_t<Handle> self) { return part_of(surface_of(self).targets(), self); });
    offer(type, "edges", PART, edges_of);
    offer(type, "rank", ARRAY,
          [](nb::handle_t<Handle> self) { return view_of(surface_of(self).rank(), self); });
    offer(type, "place", ARRAY,
          [](nb::handle_t<Handle> self) { return view_of(surface_of(self).place(), self); });
    offer(type, "centre", "tuple[float, float, float]", [](const Handle &self) {
        const auto &at = self.surface->centre();
        return nb::make_tuple(at[0], at[1], at[2]);
    });
    offer(type, "diagonal", "float", [](const Handle &self) { return self.surface->diagonal(); });
    type.def("contacts", contacts_of, nb::arg("distance"),
             nb::sig("def contacts(self, distance: float) -> tuple[typing.Any, ...]"),
             "Faces in contact, (F,), and starts and faces of partners, for cameras within a "
             "distance.");
}

} // namespace rastercov
