// Models of lenses: the parameters of the equations that their coefficients are.
//
// Twins: tests/lenses/test_against_others.py, tests/reference/test_lens_models.py.
#include "lens/models.hpp"
#include "lens/proof.hpp"
#include <initializer_list>

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Coefficients that are no parameters themselves; the greatest number of coefficients.
enum : int { TAU_X = SIZE, TAU_Y, OMEGA, PLACES };

struct Model {
    int64_t base;
    std::initializer_list<int> places;
};
#define TERMS_OF(name, base, names, counts, ...) {base, {__VA_ARGS__}},
const Model MODELS[] = {RASTERCOV_MODELS(TERMS_OF)};

// Where the equations of a model are a lens.
bool is_in_range(int64_t model, int place, double value) {
    if (!(std::abs(value) <= LARGEST_COEFFICIENT)) return false;
    if (place == TAU_X || place == TAU_Y) return std::abs(value) <= PI / 3;
    if (place == OMEGA) return value >= 0.0 && value < PI;
    if (model == MODEL_OMNI && place == B0) return value >= 0.0;
    if (model == MODEL_EUCM && place == B2) return value > 0.0;
    if (place == B0 && MODELS[model].base == DOUBLE_SPHERE) return value > -1.0 && value <= 1.0;
    if (place == B1 || (model == MODEL_EUCM && place == B0)) return value >= 0.0 && value <= 1.0;
    return true;
}
} // namespace

bool is_coefficient(int64_t model, int64_t k, double value) {
    const bool is_known = model >= 0 && model < N_MODELS && k >= 0;
    require(is_known && k < int64_t(MODELS[model].places.size()),
            "expected a coefficient of a model of a lens; choose one of MODELS");
    return is_in_range(model, MODELS[model].places.begin()[k], value);
}

Terms terms_of(int64_t model, const double *pixels, const double *coefficients, int64_t n) {
    expect(model >= 0 && model < N_MODELS, "a model of a lens", model, "choose an RC_MODEL_...");
    const auto &[base, places] = MODELS[model];
    expect(n <= int64_t(places.size()), "no more coefficients than the model has", n,
           "leave the rest out");
    double given[PLACES] = {};
    std::copy_n(pixels, 5, given + FX);
    for (int64_t k = 0; k < int64_t(places.size()); k++) {
        const int place = places.begin()[k];
        const double value = k < n ? coefficients[k] : 0.0;
        expect(is_in_range(model, place, value), "coefficients in the range of their model", value,
               "correct them");
        given[place] = value;
    }
    const double c_x = rounded::cos(given[TAU_X]), c_y = rounded::cos(given[TAU_Y]);
    const double s_x = rounded::sin(given[TAU_X]), s_y = rounded::sin(given[TAU_Y]);
    // OpenCV's homography of tau_x, tau_y; its first and second row have no more entries.
    const double tilt[] = {c_x, -s_x * s_y, c_y, s_y, -c_y * s_x, c_y * c_x};
    std::copy_n(tilt, 6, given + T00);
    Terms found = {base, {}, !is_planar(base), false};
    const double omega = given[OMEGA];
    if (base == FOV && omega != 0.0) {
        given[B0] = 2 * rounded::tan(omega / 2);
        given[B1] = given[B0] / omega;
    } else if (base == FOV) {
        found.code = PINHOLE;
    } else if (model == MODEL_OMNI) {
        given[B1] = given[B2] = 1.0;
    } else if (model == MODEL_EUCM) {
        given[B1] = 1.0 - given[B0];
    } else if (base == EQUIRECTANGULAR) {
        given[B1] = 1.0; // longitude around 0; its cosine and sine
    }
    given[LATE] = model == MODEL_RAD_TAN_THIN_PRISM_FISHEYE;
    std::copy_n(given, SIZE, found.params.begin());
    const auto is_zero = [](double value) { return value == 0.0; };
    found.has_closed_form =
        base == EQUIRECTANGULAR ||
        (base == EQUISOLID && std::all_of(coefficients, coefficients + n, is_zero));
    return found;
}

} // namespace rastercov::lens
