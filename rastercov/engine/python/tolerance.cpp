// The border of errors of mounting to Python: rastercov.engine.solver_tolerance.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/tolerance.hpp"
#include "bind.hpp"
#include "python/handle.hpp"
#include "python/tables.hpp"

namespace rastercov {

RECORD(engine::Mounts, world_from_camera, errors, near, margins);
RECORD(engine::Source, xy, starts, face, pieces, listed, bound, pairs);

namespace {
constexpr auto FIND =
    "Find what is covered whatever the errors, or with some: arrays of Pass.find; and of each pose "
    "the distance of the surface, event edges, shadows, faces without a bound, and whether it is "
    "left out.";

constexpr auto SWEEP =
    "Areas of faces by discs of parallel rays, m^2: what all of the disc lights, at least and at "
    "most, and what some of it may light.\n\n"
    "source : regions of the middle of each disc, of both sides of all faces.\n"
    "tangent : of half the angle of the disc.\n"
    "(P F, 3) float64 is returned.";

nb::object sweep(const SurfaceHandle &surface, const area::Planes &planes,
                 const area::Criteria &criteria, const engine::Mounts &mounts,
                 const engine::Source &source, double tangent, int64_t n_threads) {
    const auto work = [&] {
        return engine::sweep_discs({surface.surface, planes, criteria, mounts, source}, tangent,
                                   n_threads);
    };
    return call_within_memory(SWEEP, [&] {
        return array_of(call_apart(SWEEP, work, planes, criteria, mounts, source), 3);
    });
}

nb::tuple find_tolerated(const SurfaceHandle &surface, const area::Planes &planes,
                         const area::Criteria &criteria, const engine::Mounts &mounts,
                         const engine::Source &source, bool is_sure, int64_t n_threads) {
    const auto work = [&] {
        return engine::tolerate({surface.surface, planes, criteria, mounts, source}, is_sure,
                                n_threads);
    };
    return call_within_memory(FIND, [&] {
        std::vector<engine::Tolerated> found =
            call_apart(FIND, work, planes, criteria, mounts, source);
        std::vector<engine::Regions> regions;
        std::vector<int64_t> turns, figures;
        std::vector<double> nearest;
        for (engine::Tolerated &each : found) {
            turns.push_back(int64_t(regions.size()));
            regions.push_back(std::move(each.regions));
            nearest.push_back(each.nearest);
            figures.insert(figures.end(),
                           {each.n_events, each.n_shadows, each.n_unbounded, each.is_left});
        }
        Table table = table_of(std::move(regions), {turns.data(), {int64_t(turns.size())}});
        return nb::make_tuple(arrays_of(std::move(table)), array_of(std::move(nearest)),
                              array_of(std::move(figures), 4));
    });
}
} // namespace

void register_solver_tolerance(nb::module_ &m) {
    m.def("find", find_tolerated, nb::arg("surface"), nb::arg("planes"), nb::arg("criteria"),
          nb::arg("mounts"), nb::arg("source"), nb::arg("is_sure"), nb::arg("n_threads"),
          nb::sig("def find(surface: rastercov.engine.solver_surface.Surface, "
                  "planes: tuple[typing.Any, ...], criteria: tuple[typing.Any, ...], "
                  "mounts: tuple[typing.Any, ...], source: tuple[typing.Any, ...], "
                  "is_sure: bool, n_threads: int) -> "
                  "tuple[tuple[typing.Any, ...], typing.Any, typing.Any]"),
          FIND);
    m.def("sweep", sweep, nb::arg("surface"), nb::arg("planes"), nb::arg("criteria"),
          nb::arg("mounts"), nb::arg("source"), nb::arg("tangent"), nb::arg("n_threads"),
          nb::sig("def sweep(surface: rastercov.engine.solver_surface.Surface, "
                  "planes: tuple[typing.Any, ...], criteria: tuple[typing.Any, ...], "
                  "mounts: tuple[typing.Any, ...], source: tuple[typing.Any, ...], "
                  "tangent: float, n_threads: int) -> typing.Any"),
          SWEEP);
    def(m, "find_unmet", engine::find_unmet,
        "Set `reason` to the first criterion that some errors break at points that a pose covers, "
        "in the planes of faces.",
        "planes", "criteria", "mount", "points", "face", "reason");
}

} // namespace rastercov
