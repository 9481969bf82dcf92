// Decision about a face, or about lanes of faces, and about a point.
//
// A face is covered by (3.6) and our criteria beside it, from its measures; a point of the surface
// by those of docs/area.md. Both go by the `Rules` of a task, and give a `Reason`.
//
// E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section
// 3.3.
//
// Twins: rastercov.reference.coverage, rastercov.reference.regions.
#pragma once
#include "camera/camera.hpp"
#include "number.hpp"
#include <bit>
#include <optional>

namespace rastercov {

// rastercov.core.coverage.task.Rules, where they are described.
struct Rules {
    double min_pixels, min_visibility, min_coverage, min_pixel_density, min_facing_density,
        min_pixels_per_m2, z_n, z_f, max_incidence, cos_incidence, tan_incidence;
    bool focus_of_centroid, cap_resolution;
};
RECORD(Rules, min_pixels, min_visibility, min_coverage, min_pixel_density, min_facing_density,
       min_pixels_per_m2, z_n, z_f, max_incidence, cos_incidence, tan_incidence, focus_of_centroid,
       cap_resolution);

namespace coverage {

// Values of rastercov.Reason.
enum Reason : uint8_t {
    DEGENERATE,
    BACK_FACING,
    OUTSIDE,
    OUT_OF_FOCUS,
    UNSAMPLED,
    TOO_COARSE,
    OCCLUDED,
    TOO_OBLIQUE,
    COVERED,
    FIRST_OF_SEVERAL,
    LAST_OF_SEVERAL = FIRST_OF_SEVERAL + 25,
    ANGLE_OUT_OF_RANGE = LAST_OF_SEVERAL + 3, // BASELINE of rastercov.core.coverage.task
    TOO_UNCERTAIN,
};

// Criteria that may fail together, as bits: rastercov.core.coverage.task.TOGETHER.
enum Fails : uint8_t {
    IS_OUTSIDE = 1,
    IS_BLURRED = 2,
    IS_COARSE = 4,
    IS_HIDDEN = 8,
    IS_STEEP = 16
};
constexpr int N_SETS = 32;

// Reasons by the bits of the criteria that fail; of several the rows of SETS there.
constexpr std::array<uint8_t, N_SETS> REASON_OF = [] {
    std::array<uint8_t, N_SETS> found = {COVERED, OUTSIDE, OUT_OF_FOCUS};
    found[IS_COARSE] = TOO_COARSE;
    found[IS_HIDDEN] = OCCLUDED;
    found[IS_STEEP] = TOO_OBLIQUE;
    uint8_t next = FIRST_OF_SEVERAL;
    for (int count = 5; count > 1; count--)
        for (unsigned bits = 0; bits < N_SETS; bits++)
            if (std::popcount(bits) == count) found[bits] = next++;
    return found;
}();

// The criteria of a reason as bits, and all bits where it is none of these.
constexpr uint8_t NOT_OF_CAMERA = 255;
constexpr std::array<uint8_t, 256> FAILS_OF = [] {
    std::array<uint8_t, 256> found = {};
    found.fill(NOT_OF_CAMERA);
    for (int bits = 0; bits < N_SETS; bits++) found[REASON_OF[size_t(bits)]] = uint8_t(bits);
    return found;
}();

// Reasons of faces by the bits of the criteria that fail: by one instruction where there is one.
template <class W> INLINE W reason_of(W fails) {
    const auto one = [](int64_t set)
                         __attribute__((always_inline)) { return int64_t(REASON_OF[size_t(set)]); };
    if constexpr (std::is_integral_v<W>) {
        return one(fails);
    } else {
#if defined(__AVX512BW__) && defined(__AVX512DQ__)
        static constexpr auto TABLE = [] {
            std::array<int16_t, N_SETS> found = {};
            for (size_t set = 0; set < N_SETS; set++) found[set] = REASON_OF[set];
            return found;
        }();
        const __m512i table = _mm512_loadu_si512(TABLE.data());
        return W::make(EACH(k) {
            return Register<int64_t>(_mm512_permutexvar_epi16((__m512i)fails.r[k], table)) & 0xFFFF;
        });
#else
        return each_lane(fails, one);
#endif
    }
}

// Rank of reasons by how near a camera is to covering: several together come after OUTSIDE, in
// their order, so that of two cameras the one that fails fewer criteria counts.
template <class N> INLINE Whole<N> nearness(Whole<N> reason) {
    using W = Whole<N>;
    constexpr int LATER = 64, LAST = 4 * LATER;
    const Mask<N> is_late = (reason > W(OUTSIDE)) & (W(FIRST_OF_SEVERAL) > reason);
    const Mask<N> is_own = reason > W(LAST_OF_SEVERAL);
    const W found = select(is_late | is_own, reason + W(LATER), reason);
    return select(reason == W(COVERED), W(LAST), found);
}

// Values of rastercov.BoundKind.
enum Kind : uint8_t { STATISTICAL, CERTIFIED, EXACT };

constexpr double LARGEST_RESOLUTION = 1e300; // of one face; a smaller R_min gives no more

// Facts that the coverage of faces depends on: whether the angle of incidence is too large, areas,
// px^2, densities, and the cosine of that angle. What is not asked for is 0.
template <class N> struct Measures {
    Mask<N> is_front, is_inside, has_part, is_focused, is_oblique;
    N visible, drawn, density, facing, per_m2, cosine;
    Whole<N> own; // reason of the surface itself, COVERED where there is none
};

template <class N> struct Decision {
    N visibility, resolution, coverage;
    Whole<N> reason;
};

// Least density of a target that faces the camera, foreshortened by the largest angle that is
// allowed, from which densities suffice there: see rastercov.core.coverage.task.Rules.without.
inline double across(const Lens &lens) {
    return std::min(lens.fx, lens.fy) / std::sqrt(lens.fx * lens.fy);
}
inline double across(const ParallelLens &lens) { return across(lens.scale); }
inline double across(const CurvedLens &) { return 1.0; }
template <class Camera> double least_when_steep(const Rules &rules, const Camera &camera) {
    const double cosine = rules.cos_incidence;
    return std::max({rules.min_facing_density, rules.min_pixel_density / cosine,
                     across(camera) * std::sqrt(rules.min_pixels_per_m2 / cosine)});
}

// Visible fraction, resolution, coverage (3.6) and `Reason`: the criteria that must be met for the
// product to reach the threshold.
template <class N, class Camera>
INLINE Decision<N> decide(const Rules &rules, const Measures<N> &face, const Camera &camera) {
    const N nothing = 0.0;
    const Mask<N> has_image = face.drawn > nothing;
    Decision<N> out;
    out.visibility =
        select(face.is_front & face.has_part & has_image, face.visible / face.drawn, nothing);
    out.resolution = min(face.drawn / N(rules.min_pixels), N(LARGEST_RESOLUTION));
    N product = rules.cap_resolution ? min(out.resolution, N(1.0)) : out.resolution;
    const auto ask = [&](N density, double least) __attribute__((always_inline)) {
        if (least > 0) product = select(density >= N(least), product, nothing);
    };
    ask(face.density, rules.min_pixel_density);
    ask(face.facing, rules.min_facing_density);
    ask(face.per_m2, rules.min_pixels_per_m2);
    const auto fails = [&](N value) __attribute__((always_inline)) -> Mask<N> {
        return (value < N(rules.min_coverage)) | (value == nothing);
    };
    const Mask<N> is_coarse = fails(product);
    const N shown = select(out.visibility >= N(rules.min_visibility), out.visibility, nothing);
    const N without = select(is_coarse, N(1.0), product);
    product = product * shown;
    const Mask<N> is_hidden = fails(without * shown), is_oblique = face.is_oblique;
    Mask<N> stays_coarse = is_coarse;
    if (any(is_coarse & is_oblique)) {
        const N tilted = min(out.resolution * N(rules.cos_incidence) / face.cosine, N(1.0));
        const N least = least_when_steep(rules, camera);
        stays_coarse = is_coarse & !(is_oblique & (face.facing >= least) & !fails(tilted));
    }
    const Mask<N> is_sampled = face.is_front & face.is_inside & face.is_focused & has_image;
    using W = Whole<N>;
    const Mask<N> is_left = is_sampled & !is_oblique & (face.own == W(COVERED));
    out.coverage = select(is_left, product, nothing);
    const auto bit = [](Mask<N> fails, uint8_t value) { return select(fails, W(value), W(0)); };
    const W bits = bit(is_oblique, IS_STEEP) + bit(is_hidden, IS_HIDDEN) +
                   bit(stays_coarse, IS_COARSE) + bit(!face.is_focused, IS_BLURRED);
    W reason = select(bits == W(0), face.own, reason_of(bits));
    reason = select(!has_image, W(UNSAMPLED), reason);
    reason = select(!face.is_inside, W(OUTSIDE), reason);
    reason = select(!face.is_front, W(BACK_FACING), reason);
    out.reason = select(face.own == W(DEGENERATE), W(DEGENERATE), reason);
    return out;
}

// Bits of the criteria but occlusion that a point fails, and its depth; from behind it, and where a
// lens has no image of it or it is before the near plane, `reason` stands alone.
struct Judged {
    uint8_t fails;
    std::optional<Reason> reason;
    double depth;
};

// A camera with the largest image that one may have: without_borders of
// rastercov.core.area.regions.
constexpr double LARGEST_SIDE = 1 << 17;
inline Lens widest(const Lens &lens) {
    const double right = std::floor((LARGEST_SIDE - lens.width) / 2),
                 down = std::floor((LARGEST_SIDE - lens.height) / 2);
    return {lens.fx,
            lens.fy,
            lens.cx + right,
            lens.cy + down,
            lens.width + 2 * right,
            lens.height + 2 * down};
}
inline ParallelLens widest(const ParallelLens &lens) { return {widest(lens.scale)}; }
inline const CurvedLens &widest(const CurvedLens &lens) { return lens; }

//
// `way` is that from the camera in the axes of the world; `rules` and `near` are in its unit of
// length. `rotation` is that of world_from_camera.
template <class Camera, class Rotation>
Judged judge_point(const Camera &camera, const Rules &rules, const Rotation &rotation, double near,
                   const Triple<double> &way, const Triple<double> &normal, bool is_two_sided) {
    const auto [x, y, z] = ray_along(camera, rotation, way);
    double height = -(x * normal.x + y * normal.y + z * normal.z);
    if (is_two_sided) height = std::abs(height);
    if (!(height > 0.0)) return {0, BACK_FACING, 0.0};
    const auto [right, down, ahead] = rotate(way, rotation);
    const auto [depth, is_inside] = place(camera, near, right, down, ahead);
    if (!is_inside && !place(widest(camera), near, right, down, ahead).is_inside)
        return {0, OUTSIDE, depth};
    uint8_t fails = is_inside ? 0 : IS_OUTSIDE;
    const double focus = focus_depth(camera, right, down, ahead);
    if (!(rules.z_n <= focus && focus <= rules.z_f)) fails |= IS_BLURRED;
    const bool is_steep = height < std::sqrt(x * x + y * y + z * z) * rules.cos_incidence;
    if (is_steep) fails |= IS_STEEP;
    const auto asks =
        std::max({rules.min_pixels_per_m2, rules.min_pixel_density, rules.min_facing_density});
    if (asks > 0.0) {
        const auto [a, b, c] = rotate(normal, rotation);
        const auto slopes = jacobian(camera, right, down, ahead);
        if (!(per_m2(slopes, a, b, c) >= rules.min_pixels_per_m2 &&
              facing(slopes) >= rules.min_facing_density &&
              along(slopes, a, b, c) >= rules.min_pixel_density) &&
            !(is_steep && facing(slopes) >= least_when_steep(rules, camera)))
            fails |= IS_COARSE;
    }
    return {fails, {}, depth};
}

} // namespace coverage
} // namespace rastercov
