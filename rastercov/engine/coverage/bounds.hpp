// Bounds of the visible fraction of a face, and what rounding may decide.
//
// Twins: rastercov.reference.coverage.
#pragma once
#include "coverage/criteria.hpp"
#include "exact/orientation.hpp"

namespace rastercov::coverage {

// Greater than the error of n . (a + b + c), relative to the sizes of the corners a, b, c and over
// the sine of the angle between two edges: the normal n is off by 8 * 2^-53 over that sine.
constexpr double SIDE_ROUNDING = 0x1p-47;
// Cosine above which a face inside the image, needle or not, is in doubt only if its area is.
constexpr double MOST_DOUBTFUL = 0x1p-6;
// Greater than the error of a position in the image, relative to the numbers it is made from.
constexpr double BORDER_ROUNDING = 0x1p-46;
constexpr double ROUNDING = 0x1p-52; // of a quotient

// Arrays of a mesh: rastercov.core.coverage.face_pass.Scene.
struct Scene {
    FloatRows<3> vertices;
    Array<const uint64_t, Any, 3> faces; // unsigned: no index is negative
    FloatRows<3> normals;
    Column<const uint8_t> own; // reason of the surface itself, COVERED where there is none
    BoolArray two_sided;
    FloatArray offsets;
    double reach, doubtful_cosine; // greatest coordinate; below it a face may be edge-on

    Indices indices(int64_t f) const {
        return {int64_t(faces(f, 0)), int64_t(faces(f, 1)), int64_t(faces(f, 2))};
    }
    void check() const {
        require(have_rows(faces.rows(), normals, own, two_sided, offsets),
                "arrays of a scene must have one row for each face");
        require_indices(faces, vertices.rows(), "faces must hold rows of vertices");
    }
};

// Bound of visible / drawn of a face that is seen, at most 1.
//
// |v/d - v'/d'| <= (|v - v'| + |d - d'|) / d with d the true area; see
// rastercov.core.raster.contract for counts. `length` is the perimeter, px. Nothing is known of
// a face whose image rounds to nothing, or that owns no sample.
template <class N>
INLINE N bound_of_fraction(Whole<N> kind, N drawn, N error, N length, double samples) {
    const Mask<N> is_counted = kind == Whole<N>(STATISTICAL);
    const N least = drawn - error;
    const N computed = select(least > N(0.0), error / least, N(1.0)) + N(ROUNDING);
    N bound = select(kind == Whole<N>(EXACT), computed, N(0.0));
    if (any(is_counted)) {
        length = length * sqrt(N(samples));
        const N deviation = N(3 * 0.27) * sqrt(N(1.25) * length + N(1.0)) + length / N(20.0);
        bound = select(is_counted, deviation / (drawn * N(samples)), bound);
    }
    return min(select(drawn > N(0.0), bound, N(1.0)), N(1.0));
}

// Height of the camera above the plane of a face, times three, and the size of its corners.
template <class N> struct Steepness {
    N height, size;
};
template <class N, class Camera>
INLINE Steepness<N> steepness_of(const Corners<N> &corners, N cosine, const Camera &) {
    N size = 0.0;
    unroll<3>(
        EACH(s) { size = size + (abs(corners[s][X]) + abs(corners[s][Y]) + abs(corners[s][Z])); });
    return {abs(cosine) * length(corner_sums(corners)), size};
}

// Of parallel rays both are relative.
template <class N>
INLINE Steepness<N> steepness_of(const Corners<N> &, N cosine, const ParallelLens &) {
    return {abs(cosine), 4.0};
}
inline Steepness<double> steepness_of(const Corners<double> &corners, double cosine,
                                      const CurvedLens &lens) {
    if (lens.is_parallel()) return steepness_of(corners, cosine, ParallelLens{});
    return steepness_of(corners, cosine, Lens{});
}

// True for faces that are not edge-on, for certain.
template <class N>
INLINE Mask<N> is_steep(const Scene &scene, const Steepness<N> &steepness, N state) {
    const Mask<N> is_above = steepness.height > N(scene.doubtful_cosine) * steepness.size;
    const bool has_needles = scene.doubtful_cosine == MOST_DOUBTFUL;
    return has_needles ? is_above & (state == N(INSIDE)) : is_above;
}

// True if the camera is on the side of a face, or on either side of a two-sided one, from which it
// is seen: not in its plane, exactly.
inline bool has_parallel_rays(const Lens &) { return false; }
inline bool has_parallel_rays(const ParallelLens &) { return true; }
inline bool has_parallel_rays(const CurvedLens &lens) { return lens.is_parallel(); }
template <class Camera>
bool is_on_side(const Scene &scene, int64_t f, const Pose &pose, const Camera &camera) {
    const auto [i, j, k] = scene.indices(f);
    const auto &at = scene.vertices;
    const bool is_parallel = has_parallel_rays(camera);
    const int column = is_parallel ? 2 : 3; // the axis, or the camera centre
    const double from[3] = {pose(0, column), pose(1, column), pose(2, column)};
    const int8_t side = is_parallel ? exact::exact_side_along(at[i], at[j], at[k], from)
                                    : exact::exact_side(at[i], at[j], at[k], from);
    return side > 0 || (side < 0 && scene.two_sided[f]);
}

// True if rounding may decide which side of a face the camera sees.
template <class Camera>
bool is_edge_on(const Scene &scene, int64_t f, const Corners<double> &corners, double cosine,
                double state, const Camera &camera) {
    if (scene.own[f] == DEGENERATE) return true;
    const auto steepness = steepness_of(corners, cosine, camera);
    if (is_steep(scene, steepness, state)) return false;
    const auto [i, j, k] = scene.indices(f);
    const auto &at = scene.vertices;
    double ax = at(j, 0) - at(i, 0), ay = at(j, 1) - at(i, 1), az = at(j, 2) - at(i, 2);
    double bx = at(k, 0) - at(i, 0), by = at(k, 1) - at(i, 1), bz = at(k, 2) - at(i, 2);
    const double scale = std::max(
        {std::abs(ax), std::abs(ay), std::abs(az), std::abs(bx), std::abs(by), std::abs(bz)});
    for (double *const part : {&ax, &ay, &az, &bx, &by, &bz}) *part /= scale;
    const double cross =
        length(Triple<double>{ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx});
    const double product = std::sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz));
    return steepness.height * cross <= SIDE_ROUNDING * steepness.size * product;
}

// True for faces that are farther from the image, or behind the near plane, than any rounding.
template <class N>
INLINE Mask<N> is_far_off(const Corners<N> &corners, N state, double near, const Lens &lens) {
    const N border = near * (1 - BORDER_ROUNDING);
    return select(state > N(BEHIND), is_beside(corners, lens, N(1.0)),
                  max3(column(corners, Z)) < border);
}

// Numbers that positions in the image are made from, px.
inline double numbers_of(const Corners<double> &, const Lens &lens) {
    double numbers =
        lens.width + lens.height + lens.fx + lens.fy + std::abs(lens.cx) + std::abs(lens.cy);
    numbers += lens.width * lens.width / lens.fx + lens.height * lens.height / lens.fy;
    return numbers;
}
inline double numbers_of(const Corners<double> &corners, const ParallelLens &camera) {
    const Lens &lens = camera.scale;
    double reach = 0.0;
    for (const auto &at : corners)
        reach = std::max(reach, std::abs(at[X]) + std::abs(at[Y]) + std::abs(at[Z]));
    return lens.width + lens.height + std::abs(lens.cx) + std::abs(lens.cy) +
           (lens.fx + lens.fy) * reach;
}

// True if a face without area in the image of a camera without distortion may have some within
// rounding.
template <class Camera>
bool may_reach_image(const Corners<double> &corners, double state, double near,
                     const Camera &camera, bool) {
    const Lens &lens = image_of(camera);
    if (is_far_off(corners, state, near, lens)) return false;
    double margin = BORDER_ROUNDING * numbers_of(corners, camera);
    Polygon memory;
    const exact::Points here = memory.view();
    const int64_t n = image_beyond(corners, near * (1 - BORDER_ROUNDING), camera, here);
    for (int64_t p = 0; p < n; p++)
        margin = std::max(margin,
                          BORDER_ROUNDING * std::max(std::abs(here(p, 0)), std::abs(here(p, 1))));
    return cut_to_image(here, n, lens, margin) > 0;
}

} // namespace rastercov::coverage
