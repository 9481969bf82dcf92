// The border of what is proved of lenses to Python: rastercov.engine.solver_lens.
//
// Twin: rastercov.core.camera.lenses.of_camera.
#include "bind.hpp"
#include "lens/models.hpp"
#include "lens/proof.hpp"
#include "python/tables.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace {
using namespace lens;

// Line of a model: its name, its base, its coefficients and the numbers of them.
#define LINE_OF(name, base, names, counts, ...) #name ";" #base ";" names ";" counts "\n"

// Sets each of some names, "A, B", to its place among them.
void set_names(nb::module_ &m, const char *names) {
    int place = 0;
    for (const auto each : nb::str(names).attr("split")(", ")) m.attr(each) = place++;
}

int64_t set_terms(int64_t model, Array<const double, 5> pixels, FloatArray coefficients,
                  Array<double, SIZE> params) {
    const Terms found = terms_of(model, pixels.data, coefficients.data, coefficients.rows());
    std::copy(found.params.begin(), found.params.end(), params.begin());
    return found.code;
}

using Limits = std::pair<double, bool>;

Limits find_region(int64_t code, double width, double height, double max_angle,
                   Array<double, SIZE> params) {
    Numbers given;
    std::copy(params.begin(), params.end(), given.begin());
    const Region found = region_of(code, given, width, height, max_angle);
    std::copy(found.params.begin(), found.params.end(), params.begin());
    return {found.angle, found.is_whole};
}

nb::object pack(int64_t code, Array<const double, SIZE> params, double angle, double width,
                double height, double edge_tolerance, double field_tolerance) {
    constexpr auto DOING = "Bound the images of a lens";
    Region valid = {{}, angle, false};
    std::copy(params.begin(), params.end(), valid.params.begin());
    return call_within_memory(DOING, [&] {
        return array_of(call_apart(
            DOING,
            [&] { return pack_lens(code, valid, width, height, edge_tolerance, field_tolerance); },
            params));
    });
}

Outline outline_of(const Corners &polygon) {
    Outline found;
    for (int64_t k = 0; k < polygon.rows(); k++) found.push_back({polygon(k, 0), polygon(k, 1)});
    return found;
}

void find_met(Corners region, Corners hole, FloatArray x, FloatArray y, Array<const double, 2> half,
              Column<bool> out) {
    require(have_rows(out.rows(), x, y), "x, y and out must have the same length");
    const Sides sides = {sides_of(outline_of(region)), sides_of(outline_of(hole))};
    for (int64_t k = 0; k < out.rows(); k++) out[k] = sides.meet(x[k], y[k], half[0], half[1]);
}
} // namespace

void register_solver_lens(nb::module_ &m) {
    m.attr("BASES") = RASTERCOV_NAMES_IN(RASTERCOV_BASES);
    m.attr("MODELS") = RASTERCOV_MODELS(LINE_OF);
    m.attr("LARGEST_COEFFICIENT") = LARGEST_COEFFICIENT;
    set_names(m, RASTERCOV_NAMES_IN(RASTERCOV_BASES));
    set_names(m, RASTERCOV_NAMES_IN(RASTERCOV_PARAMETERS));
    m.attr("SIZE") = int(SIZE);
    m.attr("MOST") = MOST;
    m.attr("CELLS") = CELLS;
    m.attr("PARTS") = PARTS;
    m.attr("EDGE_TOLERANCE") = EDGE_TOLERANCE;
    m.attr("FIELD_TOLERANCE") = FIELD_TOLERANCE;
    def(m, "set_terms", set_terms,
        "Set the parameters of a lens of a model; the code of its base. `pixels` are fx, fy, cx, "
        "cy and skew.",
        "model", "pixels", "coefficients", "params");
    def(m, "is_coefficient", is_coefficient,
        "True where the equations of a model with coefficient k are a lens.", "model", "k",
        "value");
    def(m, "is_planar", is_planar<int64_t>, "True for a base whose sharpness depends on the depth.",
        "code");
    def(m, "find_region", find_region,
        "Set LIMIT and SLOPE of the valid region of a lens; its angle, and whether it is whole.",
        "code", "width", "height", "max_angle", "params");
    m.def("pack", pack, nb::arg("code"), nb::arg("params"), nb::arg("angle"), nb::arg("width"),
          nb::arg("height"), nb::arg("edge_tolerance"), nb::arg("field_tolerance"),
          nb::sig("def pack(code: int, params: object, angle: float, width: float, height: float, "
                  "edge_tolerance: float, field_tolerance: float) -> typing.Any"),
          "Row of numbers of a lens that is valid up to an angle.");
    def(m, "find_met", find_met, "Set `out` to whether cells may have a point of the region.",
        "region", "hole", "x", "y", "half", "out");
}

} // namespace rastercov
