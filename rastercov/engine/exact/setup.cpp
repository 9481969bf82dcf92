// Projection of vertices and set-up of faces, the first two passes over a pose.
//
// `project` is the first, and the second goes block by block. In most blocks all faces are wholly
// inside the image, or wholly outside: `set_up_plain` measures them together. `set_up` measures the
// others one by one; faces that reach behind the camera or far out of the image are clipped in
// space before they are projected. Boxes of plain blocks are made by `lay_boxes` where they are
// needed, which is near event edges.
//
// Twins: rastercov.reference.polygons for the images of faces; tests/exact/test_blocks.py.
#include "exact/setup.hpp"
#include "bind.hpp"
#include "exact/orientation.hpp"
#include "exact/passes.hpp"
#include <nanobind/stl/pair.h>
#include <tuple>

namespace rastercov {
namespace exact {
namespace {

// A face that has less than this many pixels of twice its area for each pixel of extent and of
// rounding is measured by itself: more than three times THIN_TOLERANCE_REL of certificates.
constexpr double NARROW_FACTOR = 0x1p25;

} // namespace

// Projects world points to `uvw`, pixels and 1/z. w is 0 for a vertex before the near plane or
// beyond camera.u_min ... camera.v_max; returns the number of these.
int64_t project(Vertices vertices, const Pinhole &camera, Array<double, Any, 3> uvw) {
    const auto &[r, eye] = std::tie(camera.rotation, camera.centre);
    int64_t n_out = 0;
    for (int64_t i = 0; i < vertices.rows(); i++) {
        const double a = vertices(i, 0) - eye[0];
        const double b = vertices(i, 1) - eye[1];
        const double c = vertices(i, 2) - eye[2];
        const double z = a * r(0, 2) + b * r(1, 2) + c * r(2, 2);
        double w = z >= camera.near ? camera.w_at(z) : 0.0;
        const double scale = camera.is_parallel() ? 1.0 : w;
        const double right = a * r(0, 0) + b * r(1, 0) + c * r(2, 0);
        const double down = a * r(0, 1) + b * r(1, 1) + c * r(2, 1);
        const double u = camera.fx * (right * scale) + camera.cx;
        const double v = camera.fy * (down * scale) + camera.cy;
        if (!(camera.u_min <= u && u <= camera.u_max && camera.v_min <= v && v <= camera.v_max))
            w = 0.0;
        n_out += w == 0;
        uvw(i, U) = u;
        uvw(i, V) = v;
        uvw(i, W) = w;
    }
    return n_out;
}

void lay_boxes(Int32Array faces, const Projected &projected) {
    for (const int32_t f : faces) lay_boxes_of_block(f / BLOCK, projected);
}

namespace {

// --- blocks ---

// Areas and bounds of the BLOCK faces of a block.
struct Measures {
    double twice[BLOCK], extent[BLOCK]; // twice the signed area of each face; width plus height
    Bounds bounds;                      // of the corners
    double least, most;                 // of twice the signed areas
    double margin;                      // least of twice the areas less `narrow` times the extent
    double widths, heights, areas;      // sums over the boxes of the faces
};

// A value in each lane.
using Lane = std::array<double, AT_A_TIME>;
constexpr Lane everywhere(double value) {
    Lane all;
    all.fill(value);
    return all;
}

// One value of all lanes, by halves.
template <class Operation> double reduce(Lane lanes, Operation of) {
    for (size_t n = AT_A_TIME / 2; n; n /= 2)
        for (size_t k = 0; k < n; k++) lanes[k] = of(lanes[k], lanes[k + n]);
    return lanes[0];
}

// A face is wide enough where twice its area is at least `narrow` times its extent. By itself: in
// the loop over the blocks GCC keeps some of its vectors in memory.
[[gnu::noinline]] void measure_block(int64_t first, const Projected &projected, double narrow,
                                     Measures &out) {
    Lane least_u = everywhere(INF), least_v = least_u, least_twice = least_u, margin = least_u;
    Lane most_u = everywhere(-INF), most_v = most_u, most_twice = most_u;
    Lane widths = everywhere(0.0), heights = widths, areas = widths;
    for (int64_t at = 0; at < BLOCK; at += AT_A_TIME) {
        const Lanes p = corners_of(first + at, 0, projected),
                    q = corners_of(first + at, 1, projected),
                    r = corners_of(first + at, 2, projected);
        for (size_t k = 0; k < AT_A_TIME; k++) {
            const double twice =
                (q.u[k] - p.u[k]) * (r.v[k] - p.v[k]) - (r.u[k] - p.u[k]) * (q.v[k] - p.v[k]);
            const double low_u = least(p.u[k], q.u[k], r.u[k]);
            const double high_u = greatest(p.u[k], q.u[k], r.u[k]);
            const double low_v = least(p.v[k], q.v[k], r.v[k]);
            const double high_v = greatest(p.v[k], q.v[k], r.v[k]);
            const double width = high_u - low_u, height = high_v - low_v, extent = width + height;
            const double spare = std::abs(twice) - extent * narrow;
            out.twice[at + k] = twice;
            out.extent[at + k] = extent;
            least_u[k] = low_u < least_u[k] ? low_u : least_u[k];
            least_v[k] = low_v < least_v[k] ? low_v : least_v[k];
            least_twice[k] = twice < least_twice[k] ? twice : least_twice[k];
            margin[k] = spare < margin[k] ? spare : margin[k];
            most_u[k] = high_u > most_u[k] ? high_u : most_u[k];
            most_v[k] = high_v > most_v[k] ? high_v : most_v[k];
            most_twice[k] = twice > most_twice[k] ? twice : most_twice[k];
            widths[k] += width;
            heights[k] += height;
            areas[k] += width * height;
        }
    }
    const auto lesser = [](double a, double b) { return a < b ? a : b; };
    const auto greater = [](double a, double b) { return a > b ? a : b; };
    const auto sum = [](double a, double b) { return a + b; };
    out.bounds = {reduce(least_u, lesser), reduce(most_u, greater), reduce(least_v, lesser),
                  reduce(most_v, greater)};
    out.least = reduce(least_twice, lesser);
    out.most = reduce(most_twice, greater);
    out.margin = reduce(margin, lesser);
    out.widths = reduce(widths, sum);
    out.heights = reduce(heights, sum);
    out.areas = reduce(areas, sum);
}

// Adds the faces of a block to its box and to the extent of all.
void widen_boxes(int64_t b, const Measures &block, const Projected &projected,
                 Array<double, 7> extent) {
    widen_box(projected.block_box[b], block.bounds);
    widen_box(extent, block.bounds);
    extent[SUM_OF_WIDTHS] += block.widths;
    extent[SUM_OF_HEIGHTS] += block.heights;
    extent[SUM_OF_AREAS] += block.areas;
}

// Fills in block_state and block_side from the faces of a block, with some flags more.
void describe_block(int64_t b, uint16_t flags, const Projected &projected) {
    int8_t common = projected.side[b * BLOCK];
    for (int64_t f = b * BLOCK; f < end_of_block(b, projected); f++) {
        flags |= projected.state[f];
        if (!(projected.state[f] & LIVE)) flags |= ABSENT;
        if (projected.side[f] != common) common = MIXED;
    }
    projected.block_state[b] = flags;
    projected.block_side[b] = flags & DOUBTFUL ? MIXED : common;
}

// Least 1/z of the corners of a whole block: 0 where one of them has no image.
double least_w_of_block(int64_t b, const Projected &projected) {
    double found = INF;
    for (int64_t f = b * BLOCK; f < (b + 1) * BLOCK; f++)
        for (int s = 0; s < 3; s++)
            found = std::min(found, projected.uvw(projected.faces(f, s), W));
    return found;
}

// --- set-up ---

// True if all rays to a face are exactly in its plane, or the face has no area. If not,
// `side` becomes the side that it sees, where the numbers are such that it can be found.
bool is_edge_on(Vertices vertices, const int64_t (&face)[3], const Pinhole &camera, int8_t &side) {
    const auto [i, j, k] = face;
    if (i == j || j == k || k == i) return true;
    const Array<const double, 3, 3> &rotation = camera.rotation;
    const double along[3] = {rotation(0, 2), rotation(1, 2), rotation(2, 2)};
    const int8_t seen = camera.is_parallel()
                            ? exact_side_along(vertices[i], vertices[j], vertices[k], along)
                            : exact_side(vertices[i], vertices[j], vertices[k], camera.centre);
    if (seen != SIDE_NOT_KNOWN) side = seen;
    return seen == EDGE_ON_EXACTLY;
}

} // namespace

// Measures the faces of blocks that lie wholly inside or wholly outside the image; n_out is that of
// `project`. Out: what `set_up` fills in, of these blocks, and in `rest` the others, which `set_up`
// is for. Returns the live faces, and the number of the other blocks.
std::pair<int64_t, int64_t> set_up_plain(const Pinhole &camera, bool front_only, int64_t n_out,
                                         const Projected &projected, Column<double> area_error,
                                         Array<double, 7> extent, Column<int32_t> rest) {
    const Blocks &blocks = projected.blocks;
    const double width = camera.width, height = camera.height, pixel_error = camera.pixel_error;
    const double narrow = NARROW_FACTOR * pixel_error, most_error = 2 * width * height;
    const double rounding = 2 * OUTLINE_ERROR_FACTOR * pixel_error;
    for (double &value : extent) value = 0.0;
    clear_box(extent);
    int64_t n_live = 0;
    int64_t n_rest = 0;
    Measures block;
    for (int64_t b = 0; b < blocks.has_flat.rows(); b++) {
        const int64_t first = b * BLOCK, last = end_of_block(b, projected);
        bool is_plain = last - first == BLOCK && !blocks.has_flat[b];
        bool is_out = false;
        if (is_plain) {
            measure_block(first, projected, narrow, block);
            const Bounds &of = block.bounds;
            is_out = of.u_max <= -pixel_error || of.u_min >= width + pixel_error;
            is_out = is_out || of.v_max <= -pixel_error || of.v_min >= height + pixel_error;
            const bool is_in =
                of.u_min >= 0 && of.v_min >= 0 && of.u_max <= width && of.v_max <= height;
            is_plain = (is_in || is_out) && block.margin > 0;
            is_plain = is_plain && (n_out == 0 || least_w_of_block(b, projected) > 0);
        }
        if (!is_plain) {
            rest[n_rest++] = int32_t(b);
            continue;
        }
        const bool is_mixed = block.least < 0 && 0 < block.most;
        const bool is_culled = front_only && block.least > 0, is_live = !(is_out || is_culled);
        const int8_t behind = front_only ? 0 : -1, common = block.least < 0 ? 1 : behind;
        const uint16_t flags = is_live ? LIVE : 0;
        const double some = is_out ? 0.0 : 0.5;
        std::fill_n(&projected.side[first], BLOCK, common);
        std::fill_n(&projected.state[first], BLOCK, flags);
        double *const areas = &projected.area[first], *const errors = &area_error[first];
        for (int64_t k = 0; k < BLOCK; k++) {
            const double error = rounding * block.extent[k] * some;
            errors[k] = error < most_error ? error : most_error;
            areas[k] = std::abs(block.twice[k]) * some;
        }
        if (is_mixed)
            for (int64_t k = 0; k < BLOCK; k++)
                projected.side[first + k] = block.twice[k] < 0 ? 1 : behind;
        if (front_only && block.most > 0 && !is_out)
            for (int64_t k = 0; k < BLOCK; k++)
                projected.state[first + k] = block.twice[k] < 0 ? LIVE : 0;
        const bool has_all = is_live && !(is_mixed && front_only);
        projected.block_state[b] = has_all ? flags : uint16_t(flags | ABSENT);
        projected.block_side[b] = is_mixed ? MIXED : common;
        projected.has_boxes[b] = false;
        clear_box(projected.block_box[b]);
        if (!is_live) continue;
        widen_boxes(b, block, projected, extent);
        n_live += BLOCK;
    }
    return {n_live, n_rest};
}

namespace {

// What faces are measured by themselves with.
struct Measuring {
    Vertices vertices;
    const Pinhole &camera;
    bool front_only;
    const Projected &projected;
    Column<double> area_error;
    ClippedFace cut = {};
    int64_t n_clipped = 0;
};

// Image of a face: its box, area inside the image, the largest error of its outline, and flags.
struct FaceImage {
    Box around;
    double inside, outline_error;
    uint16_t flags;
    bool is_culled;
};

// Measures a face all of whose corners are projected; false if nothing of it is in the image.
bool measure_projected(int64_t f, const int64_t (&face)[3], Measuring &with, FaceImage &image) {
    const auto &uvw = with.projected.uvw;
    const double width = with.camera.width, height = with.camera.height,
                 pixel_error = with.camera.pixel_error;
    const auto [i, j, k] = face;
    const double u0 = uvw(i, U), v0 = uvw(i, V), w0 = uvw(i, W);
    const double u1 = uvw(j, U), v1 = uvw(j, V), w1 = uvw(j, W);
    const double u2 = uvw(k, U), v2 = uvw(k, V), w2 = uvw(k, W);
    const double twice = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0);
    image.around = {least(u0, u1, u2),    greatest(u0, u1, u2), least(v0, v1, v2),
                    greatest(v0, v1, v2), least(w0, w1, w2),    greatest(w0, w1, w2)};
    const auto [u_min, u_max, v_min, v_max, w_min, w_max] = image.around;
    const bool is_doubtful =
        std::abs(twice) <= EDGE_ON_FACTOR * pixel_error * (u_max - u_min + v_max - v_min);
    const int8_t of_image = twice < 0 ? 1 : twice > 0 ? -1 : 0;
    int8_t seen = of_image;
    if (is_doubtful && is_edge_on(with.vertices, face, with.camera, seen)) {
        with.projected.state[f] = EDGE_ON;
        return false;
    }
    const bool is_out = u_max <= 0 || v_max <= 0 || u_min >= width || v_min >= height;
    if (is_out && !(u_max <= -pixel_error || v_max <= -pixel_error ||
                    u_min >= width + pixel_error || v_min >= height + pixel_error)) {
        // Rounding may have moved it out of the image.
        const double inner = std::min(u_max, width) - std::max(u_min, 0.0) +
                             std::min(v_max, height) - std::max(v_min, 0.0);
        with.area_error[f] = 4 * EDGE_ON_FACTOR * (inner + 2 * pixel_error) * pixel_error;
    }
    image.is_culled = with.front_only && seen < 0;
    if (!image.is_culled) with.projected.side[f] = seen;
    if (is_out) return false;
    // An image of the wrong side is one that rounds to nothing.
    image.inside = seen == of_image ? std::abs(twice) / 2 : 0.0;
    image.outline_error = pixel_error;
    image.flags = is_doubtful ? LIVE | DOUBTFUL : LIVE;
    if (image.inside > 0 && (u_min < 0 || v_min < 0 || u_max > width || v_max > height)) {
        image.flags |= PARTLY;
        const Points polygon = with.cut.corners();
        for (int corner = 0; corner < 3; corner++)
            for (const int axis : {U, V}) polygon(corner, axis) = uvw(face[corner], axis);
        const int64_t n =
            clip(polygon, 3, with.camera.border, with.camera.border.rows(), with.cut.scratch());
        image.inside = n >= 3 ? std::abs(twice_area(polygon, n)) / 2 : 0.0;
    }
    return true;
}

// The same of a face with a corner that is not: it is clipped in space.
bool measure_clipped(int64_t f, const int64_t (&face)[3], Measuring &with, FaceImage &image) {
    const auto &[camera, projected, cut] = std::tie(with.camera, with.projected, with.cut);
    const double pixel_error = camera.pixel_error;
    Side seen = {0, side_if_out_of_sight(with.vertices, face, camera)};
    if (seen.front == 0) {
        Corners corners;
        for (int s = 0; s < 3; s++) to_camera(with.vertices[face[s]], camera, corners.at[s]);
        seen = clip_in_space(corners, camera, cut);
    }
    if (seen.front == 0) {
        // The camera centre is on its plane to 2^-98: nothing of it is wide enough to count, unless
        // it is exactly so: then there is nothing.
        const bool is_exact = is_edge_on(with.vertices, face, camera, projected.side[f]);
        projected.state[f] = is_exact ? EDGE_ON : DOUBTFUL;
        if (!is_exact)
            with.area_error[f] = 4 * EDGE_ON_FACTOR * (camera.width + camera.height) * pixel_error;
        return false;
    }
    image.is_culled = with.front_only && seen.front < 0;
    if (!image.is_culled) projected.side[f] = seen.front;
    if (seen.n == 0) return false;
    image.around = bounds_of_clipped(cut, std::abs(seen.n));
    image.inside = seen.n >= 3 ? std::max(twice_area(cut.corners(), seen.n) / 2, 0.0) : 0.0;
    image.outline_error = std::max(pixel_error, cut.plane[OUTLINE_ERROR]);
    image.flags = LIVE | CLIPPED | PARTLY;
    if (image.is_culled) return true;
    if (with.n_clipped < projected.clipped.polygons.rows()) {
        projected.clipped_index[f] = int32_t(with.n_clipped);
        store_clipped(projected.clipped, with.n_clipped, cut, seen.n);
    }
    with.n_clipped++;
    return true;
}

// Fills in what was measured of a face; true if it is live.
bool store_image(int64_t f, const FaceImage &image, const Measuring &with) {
    const auto [u_min, u_max, v_min, v_max, w_min, w_max] = image.around;
    const double around_it = std::max(u_max - u_min + v_max - v_min, 2 * image.outline_error);
    with.area_error[f] = std::min(OUTLINE_ERROR_FACTOR * around_it * image.outline_error,
                                  2 * with.camera.width * with.camera.height);
    if (image.is_culled) {
        with.projected.area[f] = image.inside;
        return false;
    }
    const double sides[] = {u_min, u_max, v_min, v_max, w_min, w_max};
    std::copy_n(sides, 6, &with.projected.box(f, U_MIN));
    widen_box(with.projected.block_box[f / BLOCK], {u_min, u_max, v_min, v_max});
    if (!(image.inside > 0)) {
        with.projected.state[f] = THIN | DOUBTFUL | (image.flags & CLIPPED);
        return false;
    }
    with.projected.state[f] = image.flags;
    with.projected.area[f] = image.inside;
    return true;
}

} // namespace

// Measures the faces of some blocks, those that set_up_plain left in `rest`; returns how many are
// live, and how many clipped. If more are clipped than projected.clipped has room for, nothing is
// added to `extent`: call again with more room.
//
// A face whose plane has the camera centre in it, exactly, as that of one without area has, neither
// hides anything nor is visible; in all others the sign of the rounded image gives way to the exact
// one. front_only leaves out faces that are seen from behind: they hide nothing. Out: all of
// `projected` but its first arrays, `area` also of faces that are left out; area_error, px^2, the
// rounding of the outline, also of faces that rounding leaves out; extent, in and out, bounds of u
// and v of all live faces, within the image, and the sums of the widths, heights and areas of their
// boxes.
std::pair<int64_t, int64_t> set_up(Vertices vertices, Int32Array rest, const Pinhole &camera,
                                   bool front_only, const Projected &projected,
                                   Column<double> area_error, Array<double, 7> extent) {
    Measuring with = {vertices, camera, front_only, projected, area_error};
    int64_t n_live = 0;
    double sums[] = {0.0, 0.0, 0.0};
    double all[7];
    std::copy(extent.begin(), extent.end(), all);
    const Array<double, 7> bounds = {all, {7}};
    for (const int32_t b : rest) {
        projected.has_boxes[b] = true;
        clear_box(projected.block_box[b]);
        for (int64_t f = b * BLOCK; f < end_of_block(b, projected); f++) {
            projected.state[f] = 0;
            projected.side[f] = 0;
            projected.area[f] = area_error[f] = 0.0;
            const int64_t face[3] = {projected.faces(f, 0), projected.faces(f, 1),
                                     projected.faces(f, 2)};
            const bool is_projected = projected.uvw(face[0], W) > 0 &&
                                      projected.uvw(face[1], W) > 0 &&
                                      projected.uvw(face[2], W) > 0;
            FaceImage image;
            if (!(is_projected ? measure_projected(f, face, with, image)
                               : measure_clipped(f, face, with, image)) ||
                !store_image(f, image, with))
                continue;
            n_live++;
            const Box &its = image.around;
            const Bounds inner = {std::max(its.u_min, 0.0), std::min(its.u_max, camera.width),
                                  std::max(its.v_min, 0.0), std::min(its.v_max, camera.height)};
            const double across = inner.u_max - inner.u_min, down = inner.v_max - inner.v_min;
            sums[0] += across;
            sums[1] += down;
            sums[2] += across * down;
            widen_box(bounds, inner);
        }
        describe_block(b, UNEVEN, projected);
    }
    if (with.n_clipped <= projected.clipped.polygons.rows()) {
        std::copy(bounds.begin(), bounds.end(), extent.begin());
        for (int k = 0; k < 3; k++) extent[SUM_OF_WIDTHS + k] += sums[k];
    }
    return {n_live, with.n_clipped};
}

} // namespace exact
} // namespace rastercov
