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
    offer(type, "diagonal", "float", [](const Handle &self) { return self.surface->diagonal(); });
}

} // namespace rastercov
