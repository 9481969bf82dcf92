// The border of Union to Python: rastercov.engine.solver_union.
//
// Twins: tests/area/test_union.py, by Clipper2.
#include "solver/union.hpp"
#include "bind.hpp"
#include <atomic>
#include <nanobind/stl/pair.h>

namespace rastercov {

using engine::FlatFaces, engine::RegionPairs, engine::RegionPieces;
RECORD(FlatFaces, corners, areas);
RECORD(RegionPieces, xy, starts, face, pose);
RECORD(RegionPairs, pose, face, area, bound, excess);

namespace {
namespace nb = nanobind;
using Numbers = IntArray;

constexpr auto ADD =
    "Add regions; `progress(done, total)` may raise, and the union is as before then.";

// A union that one thread at a time uses.
struct Handle {
    engine::Union united;
    std::atomic<bool> is_busy = false;
    Handle(const FlatFaces &faces, double least, int64_t views, int64_t most, int64_t together)
        : united(faces, least, views, most, together) {}
};

template <class Use> auto use(Handle &self, Use with) {
    require(!self.is_busy.exchange(true),
            "expected one thread in a union, got a second one; pass each thread its own");
    struct Leave {
        Handle &self;
        ~Leave() { self.is_busy = false; }
    } leave = {self};
    return with(self.united);
}

// A method of unions.
template <auto METHOD, class R, class... Args> R forward(Handle &self, Args... args) {
    return use(self, [&](engine::Union &all) { return (all.*METHOD)(args...); });
}
template <auto METHOD, class R, class... Args> auto as_function(R (engine::Union::*)(Args...)) {
    return forward<METHOD, R, Args...>;
}
template <auto METHOD, class R, class... Args>
auto as_function(R (engine::Union::*)(Args...) const) {
    return forward<METHOD, R, Args...>;
}
template <auto METHOD> const auto METHOD_OF = as_function<METHOD>(METHOD);

void add(Handle &self, const RegionPieces &pieces, const RegionPairs &pairs, Numbers number,
         const nb::object &callback) {
    engine::Progress progress;
    if (!callback.is_none())
        progress = [&callback](int64_t done, int64_t total) {
            const nb::gil_scoped_acquire locked;
            callback(done, total);
        };
    const auto work = [&] {
        use(self, [&](engine::Union &all) { all.add(pieces, pairs, number, progress); });
    };
    call_apart(ADD, work, pieces, pairs, number);
}
struct Callback {}; // in signatures
} // namespace

template <> inline void put_type<Callback>(std::string &text, Type<Callback>) { text += "object"; }

void register_solver_union(nb::module_ &m) {
    m.attr("MOST_PIECES") = engine::MOST_PIECES;
    m.attr("ALL_TOGETHER") = engine::ALL_TOGETHER;
    m.attr("FEW_FACES") = engine::FEW_FACES;
    m.attr("POSES_TOGETHER") = engine::POSES_TOGETHER;
    nb::class_<Handle> type(m, "Union", "Union of regions of poses; one thread at a time uses it.");
    def(type, nb::init<const FlatFaces &, double, int64_t, int64_t, int64_t>(), "faces", "least",
        "views", "most", "together");
    def(type, "begin", METHOD_OF<&engine::Union::begin>,
        "Begin with a partition, by face, and its bounds.", "pieces", "tags", "bound", "excess");
    type.def("add", add, nb::arg("pieces"), nb::arg("pairs"), nb::arg("number"),
             nb::arg("progress").none(),
             nb::sig(signature<void, RegionPieces, RegionPairs, Numbers, Callback>(
                         "add", true, "pieces", "pairs", "number", "progress")
                         .c_str()),
             ADD);
    def(type, "fill", METHOD_OF<&engine::Union::fill>,
        "Add one more pose, which covers all of some faces.", "chosen");
    def(type, "size", METHOD_OF<&engine::Union::size>, "Pieces of the partition, and corners.");
    def(type, "write", METHOD_OF<&engine::Union::write>,
        "Fill arrays of that size with the pieces by face.", "xy", "starts", "face", "tag", "area");
    def(type, "write_areas", METHOD_OF<&engine::Union::write_areas>,
        "Fill row j with the area of each face that at least j + 1 poses cover, m^2.", "out");
    def(type, "write_bounds", METHOD_OF<&engine::Union::write_bounds>,
        "Fill bound and excess of each area, m^2.", "out");
    def(type, "write_closed", METHOD_OF<&engine::Union::write_closed>,
        "Mark the faces that k poses cover as a whole.", "out");
    def(type, "n_pairs", METHOD_OF<&engine::Union::n_pairs>,
        "Pairs of pieces in one cell so far: what a union compares.");
}

} // namespace rastercov
