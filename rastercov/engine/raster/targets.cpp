// Samples of faces one by one against an image that is drawn.
//
// Each face is filled by itself and nothing is written to the image, so it hides nothing: targets
// are counted so. Positions are rounded to steps and edge functions are integers, as in
// rastercov.core.raster.cpu: the samples that a face covers are the same as those of a face that
// hides.
//
// J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
//
// Twin: tests/support/triangle_samples.py.
#include "raster/targets.hpp"
#include "interrupt.hpp"
#include "raster/coverage.hpp"
#include <limits>
#include <tuple>

namespace rastercov {
namespace raster {
namespace {

constexpr double INF = std::numeric_limits<double>::infinity();

// Values of the edge function from one corner to another; a sample on a left or upper edge is
// inside.
struct Side {
    int64_t x, y, origin;
    Side(const Corner &from, const Corner &to) : x(to.x - from.x), y(to.y - from.y) {
        const bool is_in = y < 0 || (y == 0 && x > 0);
        origin = y * from.x - x * from.y - !is_in;
    }
    int64_t at(int64_t u, int64_t v) const { return origin + x * v - y * u; }
    // The greatest in a square.
    int64_t most(int64_t u, int64_t v, int64_t size) const {
        return at(y < 0 ? u + size : u, x > 0 ? v + size : v);
    }
};

// The same turned so that edge functions are positive inside; false where it has no area.
bool turn(Triangle &triangle) {
    auto &[a, b, c] = triangle.corners;
    const int64_t area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (area < 0) std::swap(b, c);
    return area != 0;
}
// Place of a lane in its block, in steps, where samples are a grid.
int32_t centre_of_lane(int lane) {
    const int x = lane & (SIDE - 1), y = lane >> SIDE_BITS;
    return (x << STEP_BITS) + HALF_SAMPLE + (((y << STEP_BITS) + HALF_SAMPLE) << 16);
}
} // namespace

Counted count_samples(Triangle triangle, const Window &window, const Lanes &lanes) {
    if (!turn(triangle)) return {0, 0};
    const int bits = window.step_bits(), block_bits = bits + SIDE_BITS;
    const double samples = 1.0 / (1 << bits);
    const auto &[a, b, c] = triangle.corners;
    const auto [low_x, high_x] = std::minmax({a.x, b.x, c.x});
    const auto [low_y, high_y] = std::minmax({a.y, b.y, c.y});
    const int64_t right = window.right >> SIDE_BITS, bottom = window.bottom >> SIDE_BITS;
    const int64_t top = window.top >> SIDE_BITS, size = int64_t(1) << block_bits;
    const Side one(a, b), two(b, c), three(c, a);
    const auto [plane, least, greatest] =
        std::tuple(triangle.plane, triangle.least, triangle.greatest);
    int32_t places[LANES];
    for (int lane = 0; lane < LANES; lane++) places[lane] = centre_of_lane(lane);
    int64_t covered = 0;
    int64_t seen = 0;
    for (int64_t y = std::max(low_y >> block_bits, top),
                 last_y = std::min(high_y >> block_bits, bottom);
         y <= last_y; y++)
        for (int64_t x = std::max<int64_t>(low_x >> block_bits, 0),
                     last_x = std::min(high_x >> block_bits, right);
             x <= last_x; x++) {
            const int64_t left_u = x << block_bits, top_v = y << block_bits;
            const auto most = [&](const Side &side) { return side.most(left_u, top_v, size); };
            if ((most(one) | most(two) | most(three)) < 0) continue;
            const int64_t block = (y - top) * window.columns + x;
            const int64_t first = block * LANES;
            const int64_t used = window.is_scattered()
                                     ? int64_t(lanes.used[block])
                                     : mask_in_image(ALL_LANES, int(x), int(y), window);
            if (window.is_scattered()) std::copy_n(&window.offsets[first], LANES, places);
            const bool is_drawn = lanes.marks[first / STRIP_SAMPLES];
            const float *const drawn = lanes.inverse.data + first;
            int64_t values[LANES];
            double inverse[LANES];
            for (int lane = 0; lane < LANES; lane++) {
                const int64_t u = left_u + (places[lane] & 0xFFFF),
                              v = top_v + (places[lane] >> 16);
                values[lane] = one.at(u, v) | two.at(u, v) | three.at(u, v);
                inverse[lane] = plane.origin + plane.slope_y * (double(v) * samples - 0.5) +
                                plane.slope_x * (double(u) * samples - 0.5);
            }
            for (int lane = 0; lane < LANES; lane++) {
                const double here = std::min(std::max(inverse[lane], least), greatest);
                const int64_t is_in = ~values[lane] >> 63 & used >> lane & 1;
                covered += is_in;
                const float depth = float(1.0 / double(is_drawn ? drawn[lane] : 0.0f));
                seen += is_in & (here * depth * (1 + TIE_REL) >= 1 ? 1 : 0);
            }
        }
    return {covered, seen};
}

namespace {
Lens lens_of(const View &view) {
    return {{view.lens[0], view.lens[1]}, {view.lens[2], view.lens[3]}};
}

// True where a face is wholly beyond one side of a band.
bool is_beside(const Polygon &face, const Lens &lens, const Window &window) {
    const int begins[2] = {0, window.top}, ends[2] = {window.right + 1, window.bottom + 1};
    for (int axis = 0; axis < 2; axis++) {
        const double first = begins[axis] - lens.centre[axis],
                     last = ends[axis] - lens.centre[axis];
        int n_before = 0;
        int n_behind = 0;
        for (int i = 0; i < 3; i++) {
            const double position = lens.focal[axis] * face.corners[i][axis];
            n_before += position < first * face.corners[i][2];
            n_behind += position > last * face.corners[i][2];
        }
        if (n_before == 3 || n_behind == 3) return true;
    }
    return false;
}

// Calls `visit` with each triangle that is left of a face in camera axes when it is cut at the near
// plane and at the guard band.
template <class Visit>
void visit_triangles(const Polygon &face, const Lens &lens, double near, int steps, Visit visit) {
    Triangle triangle = {{}, plane_of(face, lens), INF, 0.0};
    const Polygon part = clip_to_guard_band(clip_to_near(face, near), lens, steps);
    Corner places[CLIP_CORNERS];
    for (int i = 0; i < part.n; i++) {
        const auto [u, v, w] = image_of(part.corners[i], lens, steps);
        places[i] = {to_step(u), to_step(v)};
        triangle.least = std::min(triangle.least, w);
        triangle.greatest = std::max(triangle.greatest, w);
    }
    if (!is_finite(triangle.plane)) triangle.plane = {triangle.greatest, 0.0, 0.0};
    for (int k = 0; k < part.n - 2; k++) {
        triangle.corners[0] = places[0];
        triangle.corners[1] = places[k + 1];
        triangle.corners[2] = places[k + 2];
        visit(triangle);
    }
}

} // namespace

bool reach_band(const View &view, const Window &window) {
    const Lens lens = lens_of(view);
    for (int64_t f = 0; f < view.corners.rows(); f++)
        if (!is_beside(face_in_camera(view, f), lens, window)) return true;
    return false;
}

void count_targets(const View &view, const Window &window, const Lanes &lanes,
                   Column<int64_t> visible, Column<int64_t> drawn) {
    const Lens lens = lens_of(view);
    Poll poll(64);
    for (int64_t f = 0; f < view.corners.rows(); f++) {
        poll();
        const Polygon face = face_in_camera(view, f);
        if (is_beside(face, lens, window)) continue;
        visit_triangles(face, lens, view.near, 1 << window.step_bits(), [&](const Triangle &part) {
            const auto [covered, seen] = count_samples(part, window, lanes);
            drawn[f] += covered;
            visible[f] += seen;
        });
    }
}

} // namespace raster
} // namespace rastercov
