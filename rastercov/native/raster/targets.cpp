// Samples of faces one by one against an image that is drawn.
//
// Each face is filled by itself and nothing is written to the image, so it hides nothing: targets
// are counted so, and what faces cover alone through a lens. Positions are rounded to 1/256 sample
// and edge functions are integers, as in rastercov.raster.cpu: the samples that a face covers are
// the same as those of a face that hides.
//
// J. Pineda. A Parallel Algorithm for Polygon Rasterization. 1988.
//
// Twin: rastercov.reference.raster_stages.count_triangle.
#include "bind.hpp"
#include "raster/clipping.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace raster {
namespace {

// Depth by which a surface must be in front of a target to hide it, relative: 8 roundings to
// float32, by which the depths of one surface differ between devices.
constexpr double TIE_REL = 0x1p-20;
// Samples of a row, at most, that are tested one by one.
constexpr int64_t MOST_TESTED = 24;
constexpr int64_t MAX_SIDE = GUARD_BAND / STEPS;
constexpr double INF = std::numeric_limits<double>::infinity();

// Part of a canvas, in samples.
struct Tile {
    int64_t left, top, width, height;
};
// First sample of each row of the canvas that counts, and the one after the last.
struct Runs {
    Array<const int32_t, Any> first, last;
};
// Corners of faces in space, metres; rotation world_from_camera with its first two axes mixed as by
// SampleGrid.axes, and camera centre, from the same origin as the corners; fx, fy, cx, cy in
// samples; depth of the near plane, metres.
struct View {
    Array<const double, Any, 3, 3> corners;
    Array<const double, 3, 3> axes;
    Array<const double, 3> eye;
    Array<const double, 4> lens;
    double near;
};
// Depth of the nearest surface at each sample of the tile, metres, inf for none; empty where what
// is in front does not matter: then none is counted as seen.
using Depth = Array<const float, Any, Any>;
// How often the samples of each row of the tile count, those before each column together; empty
// where each counts once.
using Sums = Array<const int32_t, Any, Any>;

void require_tile(const Tile &tile, const Runs &runs, const Depth &depth, const Sums &sums) {
    const auto &[left, top, width, height] = tile;
    for (const int64_t one : {left, top, width, height})
        require(one >= 0 && one <= MAX_SIDE, "tile must be of a canvas");
    require(runs.first.rows() == runs.last.rows() && top + height <= runs.first.rows(),
            "runs must have one row for each row of the canvas");
    require(depth.size() == 0 || (depth.rows() == height && depth.extent(1) == width),
            "depth must have one element for each sample of the tile, or none");
    require(sums.rows() == 0 || (sums.rows() == height && sums.extent(1) == width + 1),
            "sums must have one element more than samples in each row of the tile, or none");
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

struct Corner {
    int64_t x, y;
};
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
        const auto next = [&] { a += steps[0], b += steps[1], c += steps[2]; };
        while (run.first <= run.last && (a | b | c) < 0) next(), run.first++;
        int64_t last = run.first - 1;
        while (last < run.last && (a | b | c) >= 0) next(), last++;
        return {run.first, last};
    }
    const int64_t start = run.first, values[3] = {a, b, c};
    for (int k = 0; k < 3 && run.first <= run.last; k++) {
        const int64_t step = sides[k].step();
        run = samples_right_of(values[k] + (run.first - start) * step, step, run);
    }
    return run;
}

// A triangle on the canvas: corners in steps; 1/z, and its extremes at the corners: a sample can
// lie beyond them by rounding, its depth must not.
struct Triangle {
    Corner corners[3];
    Plane plane;
    double least, greatest;
};
// Samples of a tile that a triangle covers, and those of them that no surface is in front of.
std::pair<int64_t, int64_t> count_samples(const Triangle &triangle, const Tile &tile,
                                          const Runs &runs, const Depth &depth, const Sums &sums) {
    const auto &corners = triangle.corners;
    Corner a = corners[0], b = corners[1], c = corners[2];
    const int64_t area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if (area == 0) return {0, 0};
    if (area < 0) std::swap(b, c);
    const auto first = [](int64_t step) { return (step + HALF_SAMPLE - 1) >> STEP_BITS; };
    const auto [low_x, high_x] = std::minmax({a.x, b.x, c.x});
    const auto [low_y, high_y] = std::minmax({a.y, b.y, c.y});
    const int64_t left = tile.left, top = tile.top;
    const int64_t first_row = std::max(first(low_y), top);
    const int64_t last_row = std::min(first(high_y), top + tile.height);
    const int64_t first_column = std::max(first(low_x), left);
    const int64_t last_column = std::min(first(high_x), left + tile.width);
    const Side sides[3] = {{a, b}, {b, c}, {c, a}};
    const bool is_weighted = sums.rows() > 0, sees = depth.size() > 0;
    const auto &[origin, across, down] = triangle.plane;
    int64_t covered = 0, seen = 0;
    for (int64_t row = first_row; row < last_row; row++) {
        const auto weight = [&](int64_t begin, int64_t end) {
            if (!is_weighted) return end - begin;
            return int64_t(sums(row - top, end - left)) - sums(row - top, begin - left);
        };
        const Run run = covered_run(sides, row,
                                    {std::max<int64_t>(first_column, runs.first[row]),
                                     std::min<int64_t>(last_column, runs.last[row]) - 1});
        if (run.first > run.last) continue;
        const int64_t n = weight(run.first, run.last + 1);
        covered += n;
        if (n == 0 || !sees) continue;
        const double start = origin + down * row;
        for (int64_t column = run.first; column <= run.last; column++) {
            const double inverse =
                std::min(std::max(start + across * column, triangle.least), triangle.greatest);
            if (inverse * depth(row - top, column - left) * (1 + TIE_REL) >= 1)
                seen += weight(column, column + 1);
        }
    }
    return {covered, seen};
}

// The same, for tests; corners x, y in steps.
std::pair<int64_t, int64_t> count_triangle(Array<const int64_t, 3> x, Array<const int64_t, 3> y,
                                           const Plane &plane, double least, double greatest,
                                           const Tile &tile, const Runs &runs, Depth depth,
                                           Sums sums) {
    require_tile(tile, runs, depth, sums);
    for (int k = 0; k < 3; k++)
        for (const int64_t step : {x[k], y[k]})
            require(step >= -GUARD_BAND && step <= GUARD_BAND, "corners must be within 2^29 steps");
    return count_samples({{{x[0], y[0]}, {x[1], y[1]}, {x[2], y[2]}}, plane, least, greatest}, tile,
                         runs, depth, sums);
}

// A face in camera axes.
Polygon face_in_camera(const View &view, int64_t f) {
    Polygon face;
    face.n = 3;
    for (int i = 0; i < 3; i++) {
        const auto corner = view.corners[f][i];
        const double x = corner[0] - view.eye[0], y = corner[1] - view.eye[1],
                     z = corner[2] - view.eye[2];
        for (int k = 0; k < 3; k++)
            face.corners[i][k] = x * view.axes(0, k) + y * view.axes(1, k) + z * view.axes(2, k);
    }
    return face;
}
Lens lens_of(const View &view) {
    return {{view.lens[0], view.lens[1]}, {view.lens[2], view.lens[3]}};
}

// True where a face is wholly beyond one side of a tile.
bool is_beside(const Polygon &face, const Lens &lens, const Tile &tile) {
    const int64_t begins[2] = {tile.left, tile.top}, sizes[2] = {tile.width, tile.height};
    for (int axis = 0; axis < 2; axis++) {
        const double first = double(begins[axis]) - lens.centre[axis], last = first + sizes[axis];
        int n_before = 0, n_behind = 0;
        for (int i = 0; i < 3; i++) {
            const double position = lens.focal[axis] * face.corners[i][axis];
            n_before += position < first * face.corners[i][2];
            n_behind += position > last * face.corners[i][2];
        }
        if (n_before == 3 || n_behind == 3) return true;
    }
    return false;
}

// Adds the samples of targets in a tile of one pose to their counts. `rows` are those of
// rows_of_targets, or empty.
template <class Count>
void count_targets(const View &view, Array<const int64_t, Any, 2> rows, const Tile &tile,
                   const Runs &runs, Depth depth, Sums sums, Array<Count, Any> visible,
                   Array<Count, Any> drawn) {
    const int64_t n = view.corners.rows();
    require_tile(tile, runs, depth, sums);
    require((rows.rows() == 0 || rows.rows() == n) && visible.rows() == n && drawn.rows() == n,
            "rows, visible and drawn must have one row for each target");
    const Lens lens = lens_of(view);
    for (int64_t f = 0; f < n; f++) {
        if (rows.rows() && (rows(f, 1) <= tile.top || rows(f, 0) >= tile.top + tile.height))
            continue;
        const Polygon face = face_in_camera(view, f);
        if (is_beside(face, lens, tile)) continue;
        Triangle triangle = {{}, plane_of(face, lens), INF, 0.0};
        const Polygon part = clip_to_guard_band(clip_to_near(face, view.near), lens);
        Corner places[CLIP_CORNERS];
        for (int i = 0; i < part.n; i++) {
            const auto &[x, y, z] = part.corners[i];
            const double w = 1.0 / z;
            const double u = (lens.focal[0] * x * w + lens.centre[0]) * STEPS;
            const double v = (lens.focal[1] * y * w + lens.centre[1]) * STEPS;
            places[i] = {to_step(u), to_step(v)};
            triangle.least = std::min(triangle.least, w);
            triangle.greatest = std::max(triangle.greatest, w);
        }
        if (!is_finite(triangle.plane)) triangle.plane = {triangle.greatest, 0.0, 0.0};
        for (int k = 0; k < part.n - 2; k++) {
            triangle.corners[0] = places[0];
            triangle.corners[1] = places[k + 1], triangle.corners[2] = places[k + 2];
            const auto [covered, seen] = count_samples(triangle, tile, runs, depth, sums);
            drawn[f] += Count(covered);
            visible[f] += Count(seen);
        }
    }
}

// Finds the rows of samples that each target may reach in one pose: the first one and the one
// after the last; both 0 for none.
void rows_of_targets(const View &view, int64_t height, Array<int64_t, Any, 2> rows) {
    require(rows.rows() == view.corners.rows(), "rows must have one row for each target");
    require(height >= 0 && height <= MAX_SIDE, "height must be of a canvas");
    const Lens lens = lens_of(view);
    const auto within = [&](double row) {
        return int64_t(std::min(std::max(row, 0.0), double(height)));
    };
    for (int64_t f = 0; f < rows.rows(); f++) {
        const Polygon part =
            clip_to_guard_band(clip_to_near(face_in_camera(view, f), view.near), lens);
        double least = INF, most = -INF;
        for (int i = 0; i < (part.n >= 3 ? part.n : 0); i++) {
            const double v =
                lens.focal[1] * part.corners[i][1] / part.corners[i][2] + lens.centre[1];
            least = std::min(least, v), most = std::max(most, v);
        }
        const bool is_seen = least <= most;
        rows(f, 0) = is_seen ? within(least - 1.0) : 0;
        rows(f, 1) = is_seen ? within(most + 2.0) : 0;
    }
}

// Adds the samples that show each face of an image, -1 for none, to counts; returns their number.
template <class Count>
int64_t count_shown(Array<const int32_t, Any, Any> face, Sums sums, Array<Count, Any> visible) {
    require(sums.rows() == face.rows() && sums.extent(1) == face.extent(1) + 1,
            "sums must have one element more than samples in each row of the image");
    int64_t total = 0;
    for (int64_t row = 0; row < face.rows(); row++)
        for (int64_t column = 0; column < face.extent(1); column++) {
            const int64_t n = int64_t(sums(row, column + 1)) - sums(row, column);
            const int32_t f = face(row, column);
            if (n <= 0 || f < 0) continue;
            require(f < visible.rows(), "face must hold rows of visible");
            visible[f] += Count(n);
            total += n;
        }
    return total;
}

} // namespace
} // namespace raster

template <> struct Record<raster::Plane> {
    using S = raster::Plane;
    static constexpr auto fields = Fields<&S::origin, &S::slope_x, &S::slope_y>();
};
template <> struct Record<raster::Tile> {
    using S = raster::Tile;
    static constexpr auto fields = Fields<&S::left, &S::top, &S::width, &S::height>();
};
template <> struct Record<raster::Runs> {
    using S = raster::Runs;
    static constexpr auto fields = Fields<&S::first, &S::last>();
};
template <> struct Record<raster::View> {
    using S = raster::View;
    static constexpr auto fields = Fields<&S::corners, &S::axes, &S::eye, &S::lens, &S::near>();
};

namespace raster {
namespace {
template <class Count> void define_counts(nanobind::module_ &m) {
    def(m, "count_targets", count_targets<Count>,
        "Add the samples of targets in a tile of one pose to their counts.", "view", "rows", "tile",
        "runs", "depth", "sums", "visible", "drawn");
    def(m, "count_shown", count_shown<Count>,
        "Add the samples that show each face of an image to counts; returns their number.", "face",
        "sums", "visible");
}
} // namespace
} // namespace raster

void register_raster_targets(nanobind::module_ &m) {
    using namespace raster;
    m.attr("TIE_REL") = TIE_REL;
    def(m, "count_triangle", count_triangle,
        "Samples of a tile that a triangle covers, and those that no surface is in front of.", "x",
        "y", "plane", "least", "greatest", "tile", "runs", "depth", "sums");
    def(m, "rows_of_targets", rows_of_targets,
        "Rows of samples that each target may reach in one pose.", "view", "height", "rows");
    define_counts<int32_t>(m);
    define_counts<int64_t>(m);
}

} // namespace rastercov
