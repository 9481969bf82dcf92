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

namespace rastercov {

// rastercov.coverage.task.Rules, where they are described.
struct Rules {
    double min_pixels, min_visibility, min_coverage, min_pixel_density, min_facing_density,
        min_pixels_per_m2, z_n, z_f, max_incidence, cos_incidence, tan_incidence;
    bool focus_of_centroid, cap_resolution;
};
template <> struct Record<Rules> {
    using S = Rules;
    static constexpr auto fields =
        Fields<&S::min_pixels, &S::min_visibility, &S::min_coverage, &S::min_pixel_density,
               &S::min_facing_density, &S::min_pixels_per_m2, &S::z_n, &S::z_f, &S::max_incidence,
               &S::cos_incidence, &S::tan_incidence, &S::focus_of_centroid, &S::cap_resolution>();
};

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
};

// Values of rastercov.BoundKind.
enum Kind : uint8_t { STATISTICAL, CERTIFIED, EXACT };

constexpr double LARGEST_RESOLUTION = 1e300; // of one face; a smaller R_min gives no more

// Facts that the coverage of faces depends on: whether the angle of incidence is too large, areas,
// px^2, and densities. What is not asked for is 0.
template <class N> struct Measures {
    Mask<N> is_front, is_inside, has_part, is_focused, is_oblique;
    N visible, drawn, density, facing, per_m2;
    Whole<N> own; // reason of the surface itself, COVERED where there is none
};

template <class N> struct Decision {
    N visibility, resolution, coverage;
    Whole<N> reason;
};

// Visible fraction, resolution, coverage (3.6) and `Reason`. One factor at a time: the reason is
// the first that brings the product below the threshold.
template <class N> INLINE Decision<N> decide(const Rules &rules, const Measures<N> &face) {
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
    product = product * select(out.visibility >= N(rules.min_visibility), out.visibility, nothing);
    const Mask<N> is_hidden = fails(product);
    const Mask<N> is_oblique = face.is_oblique & !(product == nothing);
    const Mask<N> is_sampled = face.is_front & face.is_inside & face.is_focused & has_image;
    using W = Whole<N>;
    const Mask<N> is_left = is_sampled & !is_oblique & (face.own == W(COVERED));
    out.coverage = select(is_left, product, nothing);
    W reason = select(is_oblique, W(TOO_OBLIQUE), face.own);
    reason = select(is_hidden, W(OCCLUDED), reason);
    reason = select(is_coarse, W(TOO_COARSE), reason);
    reason = select(!has_image, W(UNSAMPLED), reason);
    reason = select(!face.is_focused, W(OUT_OF_FOCUS), reason);
    reason = select(!face.is_inside, W(OUTSIDE), reason);
    reason = select(!face.is_front, W(BACK_FACING), reason);
    out.reason = select(face.own == W(DEGENERATE), W(DEGENERATE), reason);
    return out;
}

struct Judged {
    Reason reason;
    double depth;
};

// First criterion but occlusion that a point fails, and its depth.
//
// `way` is that from the camera in the axes of the world; `rules` and `near` are in its unit of
// length. `rotation` is that of world_from_camera.
template <class Camera, class Rotation>
Judged judge_point(const Camera &camera, const Rules &rules, const Rotation &rotation, double near,
                   const Triple<double> &way, const Triple<double> &normal, bool is_two_sided) {
    const auto [x, y, z] = ray_along(camera, rotation, way);
    double height = -(x * normal.x + y * normal.y + z * normal.z);
    if (is_two_sided) height = std::abs(height);
    if (!(height > 0.0)) return {BACK_FACING, 0.0};
    const auto [right, down, ahead] = turned(way, rotation);
    const auto [depth, is_inside] = place(camera, near, right, down, ahead);
    if (!is_inside) return {OUTSIDE, depth};
    const double focus = focus_depth(camera, right, down, ahead);
    if (!(rules.z_n <= focus && focus <= rules.z_f)) return {OUT_OF_FOCUS, depth};
    const auto asks =
        std::max({rules.min_pixels_per_m2, rules.min_pixel_density, rules.min_facing_density});
    if (asks > 0.0) {
        const auto [a, b, c] = turned(normal, rotation);
        const auto slopes = jacobian(camera, right, down, ahead);
        if (!(per_m2(slopes, a, b, c) >= rules.min_pixels_per_m2 &&
              facing(slopes) >= rules.min_facing_density &&
              along(slopes, a, b, c) >= rules.min_pixel_density))
            return {TOO_COARSE, depth};
    }
    if (height < std::sqrt(x * x + y * y + z * z) * rules.cos_incidence)
        return {TOO_OBLIQUE, depth};
    return {COVERED, depth};
}

} // namespace coverage
} // namespace rastercov
