// Lenses of C by their models, with all that is proved of them; see lens/proof.hpp.
//
// Twins: tests/native/test_c_border.py, tests/native/test_wasm.py.
#include "c/objects.hpp"
#include "lens/models.hpp"
#include "lens/proof.hpp"
#include "lens/rays.hpp"

namespace rastercov::c {
namespace {
#define SAME_CODE(name, ...) static_assert(int(RC_MODEL_##name) == int(lens::MODEL_##name));
RASTERCOV_MODELS(SAME_CODE)

// Ray of a pixel; where there is none, on the border of the valid region towards it.
lens::Ray ray_towards(const CurvedLens &curved, double u, double v) {
    using namespace lens;
    const auto &p = curved.params;
    Ray ray = unproject(curved.code, p, u, v);
    if (!std::isfinite(ray.X + ray.Y + ray.Z)) {
        const Cone cone(p);
        const double x = (u - p[CX]) / p[FX], y = (v - p[CY]) / p[FY], away = rounded::hypot(x, y);
        ray = {cone.sine * x / away, cone.sine * y / away, cone.cosine};
    }
    if (curved.by_distance) return ray;
    return {ray.X / ray.Z, ray.Y / ray.Z, 1.0};
}
} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_lens_prove(const rc_optics *optics, const double *coefficients, int64_t n,
                        rc_lens **lens) {
    return guard("proving a lens", [&] {
        expect_result(lens);
        expect_array(optics, "optics");
        expect(n >= 0, "0 or more coefficients", n, "pass their number");
        if (n > 0) expect_array(coefficients, "coefficients");
        const auto &[width, height, fx, fy, cx, cy, skew, angle, model] = *optics;
        for (const double each : {width, height})
            expect(each >= 1 && each <= 1 << 17 && each == std::floor(each),
                   "width and height of 1 to 131072 px", each, "give whole pixels");
        for (const double each : {fx, fy})
            expect(each >= 1e-12 && each <= 1e12, "fx and fy of 1e-12 to 1e12 px", each,
                   "convert them to pixels");
        for (const double each : {cx, cy, skew})
            expect(std::abs(each) <= 1e9, "cx, cy and skew within 1e9 px", each,
                   "convert them to pixels");
        expect(angle >= 0 && (angle <= 175 || angle == 180), "max_angle_deg up to 175, or 180",
               angle, "pass 0 for no limit");
        const double pixels[] = {fx, fy, cx, cy, skew};
        const lens::Terms terms = lens::terms_of(model, pixels, coefficients, n);
        constexpr double PI = std::numbers::pi;
        const auto region = lens::region_of(terms.code, terms.params, width, height,
                                            angle > 0 ? angle * (PI / 180) : PI);
        auto row = lens::pack_lens(terms.code, region, width, height, lens::EDGE_TOLERANCE,
                                   lens::FIELD_TOLERANCE);
        row[1] = terms.is_by_distance;
        row[2] = terms.has_closed_form;
        *lens = handles().add<rc_lens>(lens_from(std::move(row)));
    });
}
rc_status rc_lens_size(const rc_lens *lens, int64_t *n) {
    return guard("reading a lens",
                 [&] { *expect_result(n) = int64_t(object_of(lens)->numbers.size()); });
}
rc_status rc_lens_read(const rc_lens *lens, int64_t n, double *numbers) {
    return guard("reading a lens", [&] {
        const auto object = object_of(lens);
        expect(n == int64_t(object->numbers.size()), "as many numbers as rc_lens_size has", n,
               "ask it first");
        expect_array(numbers, "numbers");
        std::copy_n(object->numbers.data(), n, numbers);
    });
}
rc_status rc_lens_border(const rc_lens *lens, int64_t parts, double *rays) {
    return guard("reading a lens", [&] {
        const auto object = object_of(lens);
        expect(parts >= 1 && parts <= 1024, "1 to 1024 parts of a side", parts, "pass 8");
        expect_array(rays, "rays");
        const CurvedLens &curved = object->curved;
        // An image of all directions has no border: once around the horizon.
        const bool is_round = curved.code == lens::EQUIRECTANGULAR;
        constexpr double X[] = {0, 1, 1, 0, 0}, Y[] = {0, 0, 1, 1, 0};
        for (int side = 0; side < 4; side++)
            for (int64_t k = 0; k < parts; k++) {
                const double t = double(k) / double(parts);
                double x = X[side] + t * (X[side + 1] - X[side]);
                double y = Y[side] + t * (Y[side + 1] - Y[side]);
                if (is_round) x = (side + t) / 4;
                const double v = is_round ? curved.params[lens::CY] : y * curved.height;
                const auto ray = ray_towards(curved, x * curved.width, v);
                for (const double each : {ray.X, ray.Y, ray.Z}) *rays++ = each;
            }
    });
}
