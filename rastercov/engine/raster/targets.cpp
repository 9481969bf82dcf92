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
#include "raster/clipping.hpp"
#include "raster/cover.hpp"
#include <limits>

namespace rastercov {
namespace raster {
namespace {

// Samples of a row, at most, that are tested one by one.
constexpr int64_t MOST_TESTED = 24;
constexpr double INF = std::numeric_limits<double>::infinity();

void require_size(const Tile &tile) {
    for (const int64_t one : {tile.left, tile.top, tile.width, tile.height})
        require(one >= 0 && one <= MAX_SIDE, "tile must be of a canvas");
}

// Samples of a row.
struct Run {
    int64_t first, last;
};
// Those of a run in which value + step x >= 0, x counted from its first one.
Run samples_right_of(int64_t value, int64_t step, Run run) {
    auto [first, last] = run;
    if (step > 0) {
        if (value < 0) first += (-value + step - 1) / step;
    } else if (step < 0) {
        last = value >= 0 ? std::min(last, first + value / -step) : first - 1;
    } else if (value < 0) {
        last = first - 1;
    }
    return {first, last};
}

// Values at a sample of the edge function from one corner to another, and its step to the next
// column; a sample on a left or upper edge is inside.
struct Side {
    Corner from, to;
    int64_t step() const { return (from.y - to.y) << STEP_BITS; }
    int64_t at(int64_t u, int64_t v) const {
        const bool is_in = to.y < from.y || (to.y == from.y && to.x > from.x);
        return (to.x - from.x) * (v - from.y) - (to.y - from.y) * (u - from.x) - !is_in;
    }
};

// The part of a run of samples of a row that a triangle covers; first > last for none.
Run covered_run(const Side (&sides)[3], int64_t row, Run run) {
    if (run.first > run.last) return run;
    const int64_t v = (row << STEP_BITS) + HALF_SAMPLE, u = (run.first << STEP_BITS) + HALF_SAMPLE;
    int64_t a = sides[0].at(u, v), b = sides[1].at(u, v), c = sides[2].at(u, v);
    if (run.last - run.first < MOST_TESTED) {
        const int64_t steps[3] = {sides[0].step(), sides[1].step(), sides[2].step()};
        const auto next = [&] {
            a += steps[0];
            b += steps[1];
            c += steps[2];
        };
        while (run.first <= run.last && (a | b | c) < 0) {
            next();
            run.first++;
        }
        int64_t last = run.first - 1;
        while (last < run.last && (a | b | c) >= 0) {
            next();
            last++;
        }
        return {run.first, last};
    }
    const int64_t start = run.first, values[3] = {a, b, c};
    for (int k = 0; k < 3 && run.first <= run.last; k++) {
        const int64_t step = sides[k].step();
        run = samples_right_of(values[k] + (run.first - start) * step, step, run);
    }
    return run;
}

// The same turned so that edge functions are positive inside; false where it has no area.
bool turn(Triangle &triangle) {
    auto &[a, b, c] = triangle.corners;
    const int64_t area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (area < 0) std::swap(b, c);
    return area != 0;
}
// True where no surface is in front of the triangle, at a place in samples from the first centre.
INLINE bool sees(const Triangle &triangle, double x, double y, float depth) {
    const auto &[origin, across, down] = triangle.plane;
    const double inverse =
        std::min(std::max(origin + down * y + across * x, triangle.least), triangle.greatest);
    return inverse * depth * (1 + TIE_REL) >= 1;
}

} // namespace

Counted count_samples(Triangle triangle, const Tile &tile, const Runs &runs, const Depth &depth) {
    if (!turn(triangle)) return {0, 0};
    const auto &[a, b, c] = triangle.corners;
    const auto first = [](int64_t step) { return (step + HALF_SAMPLE - 1) >> STEP_BITS; };
    const auto [low_x, high_x] = std::minmax({a.x, b.x, c.x});
    const auto [low_y, high_y] = std::minmax({a.y, b.y, c.y});
    const int64_t left = tile.left, top = tile.top;
    const int64_t first_row = std::max(first(low_y), top);
    const int64_t last_row = std::min(first(high_y), top + tile.height);
    const int64_t first_column = std::max(first(low_x), left);
    const int64_t last_column = std::min(first(high_x), left + tile.width);
    const Side sides[3] = {{a, b}, {b, c}, {c, a}};
    int64_t covered = 0;
    int64_t seen = 0;
    for (int64_t row = first_row; row < last_row; row++) {
        const Run run = covered_run(sides, row,
                                    {std::max<int64_t>(first_column, runs.first[row]),
                                     std::min<int64_t>(last_column, runs.last[row]) - 1});
        if (run.first > run.last) continue;
        covered += run.last + 1 - run.first;
        if (depth.size() == 0) continue;
        for (int64_t column = run.first; column <= run.last; column++)
            seen += sees(triangle, double(column), double(row), depth(row - top, column - left));
    }
    return {covered, seen};
}

namespace {
// The same of scattered samples.
Counted count_lanes(Triangle triangle, const Tile &tile, const Lanes &lanes) {
    if (!turn(triangle)) return {0, 0};
    constexpr int BLOCK_BITS = FINE_STEP_BITS + SIDE_BITS;
    constexpr double SAMPLES = 1.0 / (1 << FINE_STEP_BITS);
    const auto &[a, b, c] = triangle.corners;
    const auto [low_x, high_x] = std::minmax({a.x, b.x, c.x});
    const auto [low_y, high_y] = std::minmax({a.y, b.y, c.y});
    const int64_t right = (tile.width - 1) >> SIDE_BITS, bottom = (tile.height - 1) >> SIDE_BITS;
    const Side sides[3] = {{a, b}, {b, c}, {c, a}};
    int64_t covered = 0;
    int64_t seen = 0;
    for (int64_t y = std::max<int64_t>(low_y >> BLOCK_BITS, 0),
                 last_y = std::min(high_y >> BLOCK_BITS, bottom);
         y <= last_y; y++)
        for (int64_t x = std::max<int64_t>(low_x >> BLOCK_BITS, 0),
                     last_x = std::min(high_x >> BLOCK_BITS, right);
             x <= last_x; x++) {
            const int64_t block = y * lanes.columns + x;
            for (int64_t used = lanes.used[block]; used; used = without_lowest(used)) {
                const int64_t lane = block * LANES + lowest(used);
                const int32_t packed = lanes.offsets[lane];
                const int64_t u = (x << BLOCK_BITS) + (packed & 0xFFFF);
                const int64_t v = (y << BLOCK_BITS) + (packed >> 16);
                if ((sides[0].at(u, v) | sides[1].at(u, v) | sides[2].at(u, v)) < 0) continue;
                covered++;
                seen += sees(triangle, double(u) * SAMPLES - 0.5, double(v) * SAMPLES - 0.5,
                             lanes.depth[lane]);
            }
        }
    return {covered, seen};
}

Lens lens_of(const View &view) {
    return {{view.lens[0], view.lens[1]}, {view.lens[2], view.lens[3]}};
}

// True where a face is wholly beyond one side of a tile.
bool is_beside(const Polygon &face, const Lens &lens, const Tile &tile) {
    const int64_t begins[2] = {tile.left, tile.top}, sizes[2] = {tile.width, tile.height};
    for (int axis = 0; axis < 2; axis++) {
        const double first = double(begins[axis]) - lens.centre[axis], last = first + sizes[axis];
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

void count_targets(const View &view, Array<const int64_t, Any, 2> rows, const Tile &tile,
                   const Runs &runs, Depth depth, Column<int64_t> visible, Column<int64_t> drawn) {
    const int64_t n = view.corners.rows();
    const Lens lens = lens_of(view);
    Poll poll(64);
    for (int64_t f = 0; f < n; f++) {
        poll();
        if (rows(f, 1) <= tile.top || rows(f, 0) >= tile.top + tile.height) continue;
        const Polygon face = face_in_camera(view, f);
        if (is_beside(face, lens, tile)) continue;
        visit_triangles(face, lens, view.near, STEPS, [&](const Triangle &triangle) {
            const auto [covered, seen] = count_samples(triangle, tile, runs, depth);
            drawn[f] += covered;
            visible[f] += seen;
        });
    }
}

void count_scattered(const View &view, const Tile &tile, const Lanes &lanes,
                     Column<int64_t> visible, Column<int64_t> drawn) {
    const int64_t n = view.corners.rows(), n_rows = (tile.height + SIDE - 1) >> SIDE_BITS;
    require_size(tile);
    require(have_rows(n, visible, drawn), "visible and drawn must have one row for each target");
    require(lanes.columns >= (tile.width + SIDE - 1) >> SIDE_BITS && lanes.columns <= MAX_SIDE &&
                lanes.used.rows() >= n_rows * lanes.columns &&
                lanes.offsets.rows() >= n_rows * lanes.columns * LANES &&
                lanes.depth.rows() >= n_rows * lanes.columns * LANES,
            "lanes must be of all blocks of the tile");
    const Lens lens = lens_of(view);
    Poll poll(64);
    for (int64_t f = 0; f < n; f++) {
        poll();
        const Polygon face = face_in_camera(view, f);
        if (is_beside(face, lens, tile)) continue;
        visit_triangles(face, lens, view.near, 1 << FINE_STEP_BITS, [&](const Triangle &triangle) {
            const auto [covered, seen] = count_lanes(triangle, tile, lanes);
            drawn[f] += covered;
            visible[f] += seen;
        });
    }
}

void rows_of_targets(const View &view, int64_t height, Array<int64_t, Any, 2> rows) {
    const Lens lens = lens_of(view);
    const auto within = [&](double row) {
        return int64_t(std::min(std::max(row, 0.0), double(height)));
    };
    for (int64_t f = 0; f < rows.rows(); f++) {
        const Polygon part =
            clip_to_guard_band(clip_to_near(face_in_camera(view, f), view.near), lens, STEPS);
        double least = INF;
        double most = -INF;
        for (int i = 0; i < (part.n >= 3 ? part.n : 0); i++) {
            const double v =
                lens.focal[1] * part.corners[i][1] / part.corners[i][2] + lens.centre[1];
            least = std::min(least, v);
            most = std::max(most, v);
        }
        const bool is_seen = least <= most;
        rows(f, 0) = is_seen ? within(least - 1.0) : 0;
        rows(f, 1) = is_seen ? within(most + 2.0) : 0;
    }
}

} // namespace raster
} // namespace rastercov
