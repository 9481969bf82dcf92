// Stages 1 and 3 of the CPU rasteriser: culling of clusters and of faces.
//
// A cluster is outside where its sphere is beyond a plane of the frustum. It is back-facing, also
// after rounding to steps, where the planes of its faces are far enough from the camera: with D the
// greatest distance of the cluster and h that of the camera behind the plane of a face, the
// altitudes of the face in the image are at least magnification h / D^2 of those in space. Rounding
// moves a corner by at most 0.71 steps, so it turns no face whose altitudes are 3 steps or more. Of
// parallel rays along f the factor is magnification n . f, n the normal.
// Faces that are clipped are rounded again, so their clusters are kept.
//
// L. Shirman and S. Abi-Ezzi. The Cone of Normals Technique for Fast Processing of Curved Patches.
// 1993.
// Twin: rastercov.reference.samples.
#pragma once
#include "raster/setup.hpp"
#include <tuple>

namespace rastercov::raster {

// The frustum of the rows from `top` up to `bottom`: a point p from the camera centre is outside
// where normal . p < limit, that of the last plane being the near plane. Sides of parallel rays do
// not meet in the camera centre.
inline void put_frustum(const Camera &camera, double width, double top, double bottom,
                        Frustum &out) {
    for (int i = 0; i < 3; i++) {
        const double *axes = camera.axes + 3 * i, right = axes[0], down = axes[1];
        const double forward = camera.is_parallel() ? 0.0 : axes[2];
        out.normal[LEFT][i] = camera.fx * right + camera.cx * forward;
        out.normal[RIGHT][i] = (width - camera.cx) * forward - camera.fx * right;
        out.normal[TOP][i] = camera.fy * down + (camera.cy - top) * forward;
        out.normal[BOTTOM][i] = (bottom - camera.cy) * forward - camera.fy * down;
        out.normal[FORWARD][i] = axes[2];
    }
    const double ahead[4] = {camera.cx, width - camera.cx, camera.cy - top, bottom - camera.cy};
    for (int k = 0; k < FRUSTUM_PLANES; k++) {
        const auto &[x, y, z] = out.normal[k];
        out.length[k] = std::sqrt(x * x + y * y + z * z);
        out.limit[k] = k < FORWARD && camera.is_parallel() ? -ahead[k] : 0.0;
    }
    out.limit[FORWARD] = camera.near;
}

// Of a vector of clusters: those that may have to be drawn, and those that are safe, wholly beyond
// the near plane and within the guard band.
struct Kept {
    int64_t drawn, safe;
};
// `magnification` is the least one of a length parallel to the image over its depth, in samples.
// The down and forward coordinates of the centres go to `down` and `forward`.
inline Kept cull_clusters(const Array<const double, BOUNDS_OF_CLUSTER, Any> &bounds, int64_t first,
                          const Camera &camera, const Frustum &frustum, double magnification,
                          bool hides_backs, const Column<double> &down,
                          const Column<double> &forward) {
    const auto row = [&](int k) { return load(bounds[k], first); };
    const Double x = row(CENTRE) - camera.eye[0], y = row(CENTRE + 1) - camera.eye[1];
    const Double z = row(CENTRE + 2) - camera.eye[2], radius = row(RADIUS);
    auto is_outside = radius < Double(0);
    Double along_plane;
    for (int k = 0; k < FRUSTUM_PLANES; k++) {
        const double *n = frustum.normal[k];
        along_plane = x * n[0] + y * n[1] + z * n[2];
        is_outside =
            is_outside | (along_plane + radius * frustum.length[k] < Double(frustum.limit[k]));
    }
    // The last plane is across the camera axis.
    const Double nearest = along_plane - radius;
    store(x * camera.axes[1] + y * camera.axes[4] + z * camera.axes[7], down, first);
    store(along_plane, forward, first);
    const Double squared = x * x + y * y + z * z, distance = sqrt(squared);
    const Double reach = distance + radius;
    const Double over = camera.is_parallel() ? Double(1) : nearest;
    const auto is_safe =
        (nearest >= Double(camera.near)) &
        (reach * camera.magnification <= over * double(GUARD_BAND >> STEP_BITS >> 1));
    const Kept kept = {~bits(is_outside) & ALL_LANES, bits(is_safe)};
    if (!hides_backs || !(kept.drawn & kept.safe)) return kept;
    if (camera.is_parallel()) {
        const double *const f = frustum.normal[FORWARD];
        const Double against =
            -(row(CONE_AXIS) * f[0] + row(CONE_AXIS + 1) * f[1] + row(CONE_AXIS + 2) * f[2]);
        const Double across = sqrt(max(Double(1) - against * against, Double(0.0)));
        // The greatest -n . f over the normals n of the cone: 1 where -f is in it.
        const Double most = select<double>(against >= row(CONE_COS), Double(1),
                                           across * row(CONE_SIN) + against * row(CONE_COS));
        const auto is_back = most * row(ALTITUDE) * (magnification * STEPS) < Double(-3.1);
        return {kept.drawn & ~(bits(is_back) & kept.safe), kept.safe};
    }
    const Double along = x * row(CONE_AXIS) + y * row(CONE_AXIS + 1) + z * row(CONE_AXIS + 2);
    const Double across = sqrt(max(squared - along * along, Double(0.0)));
    // The greatest n . d over the normals n of the cone, d to the camera: |d| where d is in it.
    const auto is_in_cone = -along >= distance * row(CONE_COS);
    const Double highest =
        select<double>(is_in_cone, distance, across * row(CONE_SIN) - along * row(CONE_COS));
    const Double height = highest - row(PLANE_OFFSET);
    const auto is_back = height * row(ALTITUDE) * (magnification * STEPS) < reach * reach * -3.1;
    return {kept.drawn & ~(bits(is_back) & kept.safe), kept.safe};
}

// Rims of a band: samples from the principal point to the upper and to the lower one, and lengths
// of the normals of the planes through them.
struct Rims {
    double up, up_length, down, down_length;
};
// Of a vector of clusters, those that may reach into a band of the image; `forward` are the depths
// of their centres, 1 of parallel rays.
inline int64_t clusters_in_band(const FloatArray &radius, int64_t first, const FloatArray &down,
                                const FloatArray &forward, const Camera &camera, const Rims &rims) {
    const Double r = load(radius, first), below = load(down, first) * camera.fy;
    const Double z = camera.is_parallel() ? Double(1) : load(forward, first);
    return bits((below + Double(rims.up) * z + r * rims.up_length >= Double(0)) &
                (Double(rims.down) * z - below + r * rims.down_length >= Double(0)));
}

// Faces of a vector by the path that fills them: reaches at most 2 x 2 samples; a larger range;
// likewise of faces that turn their back where that hides them; wide, for 64 bits; needs clipping.
// Wide faces and those that need clipping are not tested further.
struct Binned {
    int64_t samples_2x2, larger, hidden_samples_2x2, hidden_larger, wide, clipped;
};
// Bins the vector of faces from slot `at` on. With `is_plain`, no face is wide or needs clipping.
INLINE Binned bin_faces(const Faces &faces, int at, const Window &window, bool is_plain) {
    const Places<int32_t> p = places_of<int32_t>(faces.corners + at, faces.vertices);
    const Bounds<int32_t> b = sample_bounds(p, window);
    const Int columns = b.last_x - b.first_x, rows = b.last_y - b.first_y, area = area_of(p);
    const int64_t can_cover = bits((columns | rows) >= Int(0));
    const int64_t is_2x2 = window.is_scattered() ? 0 : bits(max<int32_t>(columns, rows) <= Int(1));
    int64_t wide = 0;
    int64_t clipped = 0;
    int64_t rest = can_cover;
    if (!is_plain) [[unlikely]] {
        const Int low = least_of(p.x), high = greatest_of(p.x);
        const auto is_face = Int::load(faces.corners + at) > Int(0);
        const int64_t needs_clipping = bits((high >= Int(BEHIND)) & is_face);
        const auto is_behind = (low == Int(BEHIND)) & (high == Int(BEHIND));
        wide = bits(max<int32_t>(b.width, b.height) >= Int(LARGE)) & can_cover & ~needs_clipping;
        clipped = needs_clipping & ~bits(is_behind);
        rest &= ~(wide | needs_clipping);
    }
    const int64_t front = bits(area < Int(0)) & rest, back = bits(area > Int(0)) & rest;
    const int64_t shown = window.hides_back ? front : front | back;
    const int64_t hidden = window.hides_back ? back : 0;
    return {shown & is_2x2, shown & ~is_2x2, hidden & is_2x2, hidden & ~is_2x2, wide, clipped};
}

// Keeps those of listed faces, of at most 2 x 2 samples, that cover one, and writes which. Faces
// are compacted first: where they are small, few have a sample in reach.
inline void cover_samples_2x2(const Faces &faces, const Window &window, SmallList &list) {
    int kept = 0;
    for (int first = 0; first < list.n; first += LANES) {
        alignas(CACHE_LINE) int32_t packed[LANES], slots[LANES], coverage[LANES];
        Int::load(list.slots + first).store(slots);
        lookup(faces.corners, slots).store(packed);
        const Places<int32_t> p = places_of<int32_t>(packed, faces.vertices);
        const Bounds<int32_t> b = sample_bounds(p, window);
        Edge<int32_t> edges[3];
        edge_functions(p, area_of(p), b.first_x, b.first_y, window, edges);
        Int missed(0);
        unroll<4>([&](auto m) __attribute__((always_inline)) {
            constexpr int k = 3 - m, i = k & 1, j = k >> 1;
            Int sign = (b.last_x - b.first_x - Int(i)) | (b.last_y - b.first_y - Int(j));
            for (const auto &edge : edges) {
                Int value = edge.value;
                if (i) value = value + edge.dx;
                if (j) value = value + edge.dy;
                sign = sign | value;
            }
            missed = append_sign(missed, sign);
        });
        (Int(0xF) - missed).store(coverage);
        for (int k = 0; k < std::min(list.n - first, LANES); k++) {
            list.slots[kept] = slots[k];
            list.coverage[kept] = coverage[k];
            kept += coverage[k] > 0;
        }
    }
    list.n = kept;
}

// For each byte the indices of its set bits, in order, then of the others.
struct BitTable {
    uint8_t at[256][8];
    constexpr BitTable() : at{} {
        for (int byte = 0; byte < 256; byte++) {
            int n = 0;
            for (int set = 1; set >= 0; set--)
                for (int k = 0; k < 8; k++)
                    if ((byte >> k & 1) == set) at[byte][n++] = uint8_t(k);
        }
    }
};
alignas(CACHE_LINE) constexpr BitTable BIT_INDICES;

// Appends base + index of each of LANES bits to a list of length n; returns its new length. Stream
// compaction without a branch, which would be mispredicted; entries behind the new end are
// overwritten.
INLINE int64_t append_set_bits(int64_t bits, int64_t base, int32_t *listed, int64_t n) {
#if defined(__AVX512F__)
    compress(bits, lane_numbers() + Int(int32_t(base))).store(listed + n);
    return n + count(bits & ALL_LANES);
#else
    for (int k = 0; k < 2; k++) {
        const int byte = bits >> 8 * k & 0xFF;
        const auto words = words_of(BIT_INDICES.at[byte]) + int32_t(base + 8 * k);
        std::memcpy(listed + n, &words, sizeof words);
        n += count(byte);
    }
    return n;
#endif
}

// Lists the slots of faces that can cover a sample, by path; the cluster has `n_slots`, a multiple
// of LANES.
inline void cull_and_bin(const Faces &faces, int n_slots, const Target &target, bool is_plain,
                         Bins &bins) {
    int64_t n_small = 0;
    int64_t n_larger = 0;
    int64_t n_hidden_small = 0;
    int64_t n_hidden_larger = 0;
    int64_t n_wide = 0;
    int64_t n_clipped = 0;
    for (int at = 0; at < n_slots; at += LANES) {
        const Binned found = bin_faces(faces, at, target.window, is_plain);
        n_small = append_set_bits(found.samples_2x2, at, bins.samples_2x2.slots, n_small);
        n_larger = append_set_bits(found.larger, at, bins.larger.slots, n_larger);
        if (found.wide | found.clipped) [[unlikely]] {
            n_wide = append_set_bits(found.wide, at, bins.wide.slots, n_wide);
            n_clipped = append_set_bits(found.clipped, at, bins.clipped.slots, n_clipped);
        }
        if (target.counts.with_backs) {
            int64_t small = found.hidden_samples_2x2;
            int64_t larger = found.hidden_larger;
            if (target.counts_in_blocks()) { // the mask of 2 x 2 has no places
                larger |= small;
                small = 0;
            }
            n_hidden_small =
                append_set_bits(small, at, bins.hidden_samples_2x2.slots, n_hidden_small);
            n_hidden_larger =
                append_set_bits(larger, at, bins.hidden_larger.slots, n_hidden_larger);
        }
    }
    bins.samples_2x2.n = int(n_small);
    bins.larger.n = int(n_larger);
    bins.hidden_samples_2x2.n = int(n_hidden_small);
    bins.hidden_larger.n = int(n_hidden_larger);
    bins.wide.n = int(n_wide);
    bins.clipped.n = int(n_clipped);
    cover_samples_2x2(faces, target.window, bins.samples_2x2);
    cover_samples_2x2(faces, target.window, bins.hidden_samples_2x2);
}

} // namespace rastercov::raster
