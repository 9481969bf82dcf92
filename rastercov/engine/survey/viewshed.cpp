// Visible part of every cell of a grid of points, from another one, front to back.
//
// The observer is the origin; a cell has two triangles. In a quadrant x, y >= 0 of the plane, with
//
//     u = x / (x + y),   v = z / (x + y),   w = 1 / (x + y),
//
// sides are straight lines in (u, v), w is affine on a triangle, and a point is visible if v is at
// least the horizon, the greatest v at its u of all that is nearer. Strips between rows go
// outwards, cells of a strip from where the observer is between their sides: a straight ray crosses
// straight sides in this order, on maps and on a grid of meridians (rows) and parallels. Over each
// u a triangle lies between two of its sides; from u0 to u1 it has
//
//     (u1 - u0) / 2 |1 / (w0 w1) at the top - 1 / (w0 w1) at the bottom|
//
// above the horizon. The ground below the observer starts at w = inf, if eyes are above its plane.
//
// An error of v is 16 units of rounding of the numbers that it is the sum of. The bound of an
// area is its difference between horizons that are lower and higher by these errors, and, for the
// triangle and for each visible part, 48 units of rounding of the distance times the sides of a
// cell.
//
// J. Wang, G. J. Robinson, K. White. Generating viewsheds without using sightlines. 2000, for the
// horizon of what is nearer, here without its approximations. Twin:
// tests/support/viewshed_by_fractions.py.
#include "bind.hpp"
#include "interrupt.hpp"
#include <cmath>
#include <list>

namespace rastercov {
namespace survey {
namespace {

constexpr double ROUNDING = 0x1p-53;

struct Line { // in (u, v), from its far end
    double u, v, slope;
    double error; // of v

    double at(double u1) const { return v + slope * (u1 - u); }
    bool operator==(const Line &) const = default;
};

constexpr Line BELOW_ALL = {0.0, -1e300, 0.0, 0.0};

// u between two where lines cross; the first where they do not.
double crossing(const Line &line, const Line &other, double u0, double u1) {
    const double d0 = line.at(u0) - other.at(u0), d1 = line.at(u1) - other.at(u1);
    return d0 * d1 < 0 ? u0 + (u1 - u0) * (d0 / (d0 - d1)) : u0;
}

// The greatest v of all that is nearer, for u from 0 to 1: lines and where they start, from a place
// on that moves along with the cells.
class Horizon {
  public:
    // Raises it to a line between two u; calls `each` with u0, u1 and the line of a piece before.
    template <class Each> void raise(const Line &line, double first, double last, Each each) {
        while (_at->first > first) --_at;
        while (std::next(_at)->first <= first) ++_at;
        for (auto at = _at; at->first < last; ++at) {
            const Line old = at->second;
            const double next = std::next(at)->first;
            const double u0 = std::max(first, at->first), u1 = std::min(last, next);
            each(u0, u1, old);
            const double d0 = line.at(u0) - old.at(u0), d1 = line.at(u1) - old.at(u1);
            if (!(d0 > 0 || d1 > 0)) continue;
            const double cut = crossing(line, old, u0, u1), end = d1 < 0 ? cut : u1;
            at = put(at, d0 < 0 ? cut : u0, line);
            if (end < next) at = put(at, end, old);
        }
    }

  private:
    using Pieces = std::list<std::pair<double, Line>>;

    Pieces _pieces = {{0.0, BELOW_ALL}, {1.0, BELOW_ALL}};
    Pieces::iterator _at = _pieces.begin();

    Pieces::iterator put(Pieces::iterator at, double start, const Line &line) {
        if (at->first < start) at = _pieces.insert(std::next(at), {start, line});
        at->second = line;
        if (at == _pieces.begin() || !(std::prev(at)->second == line)) return at;
        if (at == _at) --_at;
        return std::prev(_pieces.erase(at));
    }
};

using Corner = std::array<double, 4>; // x, y, z, and the size of the numbers that z is the sum of

double cross(const Corner &p, const Corner &q) { return p[0] * q[1] - p[1] * q[0]; }
Corner less(const Corner &p, const Corner &q) { return {p[0] - q[0], p[1] - q[1]}; }
double u_of(const Corner &corner) { return corner[0] / (corner[0] + corner[1]); }

struct Edge { // v of the ground and of targets above it, and w, between two u
    Line ground, seen, depth;
    double first, last;
};

constexpr Edge OBSERVER = {BELOW_ALL, BELOW_ALL, {0.0, 1e300, 0.0, 0.0}, 0.0, 1.0};

// What is in the quadrant of a side of a triangle: the same for both triangles.
Edge edge_of(Corner p, Corner q, double target) {
    for (size_t axis = 0; axis < 2; axis++) {
        if (p[axis] < q[axis]) std::swap(p, q);
        if (!(p[axis] > 0)) return {};
        if (q[axis] >= 0) continue;
        // The sign of `cross` stays: a side beside the observer does not go through it.
        const double inside = p[axis], outside = -q[axis];
        for (size_t k = 0; k < 4; k++) q[k] = (q[k] * inside + p[k] * outside) / (inside + outside);
        q[axis] = 0;
    }
    if (u_of(p) > u_of(q)) std::swap(p, q);
    const double u0 = u_of(p), u1 = u_of(q), w0 = 1 / (p[0] + p[1]), w1 = 1 / (q[0] + q[1]);
    if (!(u0 < u1)) return {};
    const auto line = [&](double v0, double v1) {
        const double slope = (v1 - v0) / (u1 - u0);
        const double size = std::max(p[3] * w0, q[3] * w1) + std::abs(slope) * u1;
        const double error = 16 * ROUNDING * size;
        return w0 < w1 ? Line{u0, v0, slope, error} : Line{u1, v1, slope, error};
    };
    const auto seen = line((p[2] + target) * w0, (q[2] + target) * w1);
    return {line(p[2] * w0, q[2] * w1), seen, line(w0, w1), u0, u1};
}

struct View {
    Array<const double, Any, Any, 4> points; // corners from the observer; z is NaN where none is
    int64_t row, column;                     // of the cell of the observer
    double target;                           // height of what is seen above the surface
    double reach;                            // to the middle of cells that count
    Array<double, Any, Any, 2> share, bound; // of the two triangles of cells
    Array<double, Any, 4, 2> pieces;         // visible parts: row and column of four corners
};

class Viewshed : View {
  public:
    explicit Viewshed(const View &view) : View(view) {}

    // Number of visible parts.
    int64_t solve() {
        Poll poll(64);
        for (const int64_t step : {1, -1}) {
            int64_t first = column;
            for (int64_t i = step > 0 ? row : row - 1; i >= 0 && i < share.extent(0); i += step) {
                poll();
                // Of a side across the strip, the cell on which the observer is goes first.
                while (first > 0 && is_beyond(i, first)) first--;
                while (first + 1 < share.extent(1) && !is_beyond(i, first + 1)) first++;
                for (int64_t j = first; j < share.extent(1) && cell(i, j);) j++;
                for (int64_t j = first - 1; j >= 0 && cell(i, j);) j--;
            }
        }
        return _n_pieces;
    }

  private:
    std::array<Horizon, 4> _horizons;
    Horizon *_horizon = nullptr; // of the quadrant
    std::array<double, 2> _signs{};
    std::array<Corner, 3> _corners{}; // of the triangle
    std::array<int64_t, 3> _place{};  // its cell and half
    double *_share = nullptr;
    double *_bound = nullptr;
    double _width = 0.0;  // of the cell
    double _area = 0.0;   // of the triangle
    bool _counts = false; // within reach
    int64_t _n_pieces = 0;

    Corner corner(int64_t i, int64_t j) const {
        return {points(i, j, 0), points(i, j, 1), points(i, j, 2), points(i, j, 3)};
    }

    // The observer is before the line of a side across a strip, in the order of its cells.
    bool is_beyond(int64_t i, int64_t j) const { return cross(corner(i, j), corner(i + 1, j)) > 0; }

    // False beyond the reach.
    bool cell(int64_t i, int64_t j) {
        const Corner nw = corner(i, j), se = corner(i + 1, j + 1);
        const double distance = 0.5 * std::hypot(nw[0] + se[0], nw[1] + se[1]);
        _width = std::hypot(nw[0] - se[0], nw[1] - se[1]);
        const int64_t first = cross(nw, se) >= 0 ? 0 : 1; // the side on which the observer is
        for (const int64_t half : {first, 1 - first}) {
            _place = {i, j, half};
            _counts = distance <= reach;
            _share = &share(i, j, half);
            _bound = &bound(i, j, half);
            _corners = {nw, corner(i + 1 - half, j + half), se};
            triangle();
        }
        return distance <= reach + 2 * _width;
    }

    void triangle() {
        const auto &[p, q, r] = _corners;
        if (std::isnan(p[2] + q[2] + r[2])) return;
        _area = 0.5 * std::abs(cross(less(q, p), less(r, p)));
        if (_counts && std::isnan(*_share)) *_share = *_bound = 0.0;
        if (_counts) *_bound += rounding_at(std::abs(q[0]) + std::abs(q[1]) + _width);
        const double sides[] = {cross(q, r), cross(r, p), cross(p, q)};
        const bool is_beside = std::ranges::min(sides) < 0 && std::ranges::max(sides) > 0;
        const double area = sides[0] + sides[1] + sides[2];
        const double rise = (sides[0] * p[2] + sides[1] * q[2] + sides[2] * r[2]) / area;
        // The eyes are on this ground, to rounding.
        if (_counts && !is_beside && target == 0 && rise >= -16 * ROUNDING * (p[3] + q[3] + r[3])) {
            *_bound += 1;
            _counts = false;
        }
        for (size_t quadrant = 0; quadrant < 4; quadrant++) {
            _signs = {quadrant % 2 ? 1.0 : -1.0, quadrant < 2 ? 1.0 : -1.0};
            _horizon = &_horizons[quadrant];
            std::array<Corner, 3> own = _corners;
            std::array<double, 2> most = {0.0, 0.0};
            for (size_t k = 0; k < 6; k++) {
                own[k / 2][k % 2] *= _signs[k % 2];
                most[k % 2] = std::max(most[k % 2], own[k / 2][k % 2]);
            }
            if (!(most[0] > 0 && most[1] > 0)) continue;
            std::array<Edge, 3> edges;
            double top = -1e300; // of its seen sides, with the greatest error, and their u
            double error = 0.0;
            double low = 1.0;
            double high = 0.0;
            for (size_t k = 0; k < 3; k++) {
                edges[k] = edge_of(own[k], own[(k + 1) % 3], target);
                const auto &[ground, seen, depth, u0, u1] = edges[k];
                if (!(u0 < u1)) continue;
                top = std::max({top, seen.at(u0), seen.at(u1)});
                error = std::max(error, seen.error);
                low = std::min(low, u0);
                high = std::max(high, u1);
            }
            // Below the horizon by more than the errors of both: not seen, and changes nothing.
            bool is_below = is_beside && low < high;
            if (is_below)
                _horizon->raise(BELOW_ALL, low, high, [&](double u0, double u1, const Line &line) {
                    is_below &=
                        std::min(line.at(u0), line.at(u1)) > top + 2 * line.error + 4 * error;
                });
            if (is_below) continue;
            for (size_t k = 0; k < 3; k++)
                between(edges[k], is_beside ? edges[(k + 1) % 3] : OBSERVER);
        }
    }

    // Adds what is visible of a triangle between two of its sides, and raises the horizon to it.
    void between(const Edge &one, const Edge &other) {
        const double first = std::max(one.first, other.first);
        const double last = std::min(one.last, other.last), middle = 0.5 * (first + last);
        if (!(first < last)) return;
        const bool is_near = one.depth.at(middle) > other.depth.at(middle);
        const bool is_low = one.seen.at(middle) < other.seen.at(middle);
        const Line &near = (is_near ? one : other).ground, &far = (is_near ? other : one).ground;
        const double error = near.error + far.error, rise = far.at(middle) - near.at(middle);
        const bool hides_itself = !(rise > error);
        if (hides_itself) _horizon->raise(near, first, last, [](double, double, const Line &) {});
        _horizon->raise(far, first, last, [&](double u0, double u1, const Line &old) {
            if (!_counts) return;
            Line line = &other == &OBSERVER ? BELOW_ALL : old;
            if (hides_itself) line.v += error;
            add(line, is_low ? one : other, is_low ? other : one, u0, u1);
        });
    }

    void add(const Line &line, const Edge &low, const Edge &top, double u0, double u1) {
        // Not 0, as of ground at the height of the eyes: pieces are put where the shift is.
        const double error = line.error + low.seen.error + top.seen.error + 1e-300;
        const auto is_hidden = [&](double u) { return line.at(u) - error > top.seen.at(u); };
        if (is_hidden(u0) && is_hidden(u1)) return;
        const auto above = [&](double shift) {
            return area_above({line.u, line.v + shift, line.slope, 0.0}, low, top, u0, u1,
                              shift == 0);
        };
        *_share += above(0.0) / _area;
        *_bound += (above(-error) - above(error)) / _area;
        *_bound += rounding_at(1 / std::min(top.depth.at(u0), top.depth.at(u1)));
    }

    // Of a share, by the rounding of corners and areas at a distance.
    double rounding_at(double distance) const { return 48 * ROUNDING * _width * distance / _area; }

    // Above a line between two sides, from u0 to u1.
    double area_above(const Line &line, const Edge &low, const Edge &top, double u0, double u1,
                      bool is_put) {
        std::array<double, 4> cuts = {u0, crossing(line, low.seen, u0, u1),
                                      crossing(line, top.seen, u0, u1), u1};
        std::ranges::sort(cuts);
        double sum = 0.0;
        for (size_t k = 1; k < 4; k++) {
            const double first = cuts[k - 1], last = cuts[k], middle = 0.5 * (first + last);
            if (!(first < last) || line.at(middle) >= top.seen.at(middle)) continue;
            const bool is_free = line.at(middle) <= low.seen.at(middle);
            const auto bottom = [&](double u) {
                const double v = low.seen.at(u), w = low.depth.at(u);
                const double part = (line.at(u) - v) / (top.seen.at(u) - v);
                return is_free || !(part > 0) ? w : w + std::min(part, 1.0) * (top.depth.at(u) - w);
            };
            const double u[] = {first, last, last, first};
            const double w[] = {bottom(first), bottom(last), top.depth.at(last),
                                top.depth.at(first)};
            sum += 0.5 * (last - first) * std::abs(1 / (w[2] * w[3]) - 1 / (w[0] * w[1]));
            if (!is_put || _n_pieces++ >= pieces.rows()) continue;
            for (int n = 0; n < 4; n++)
                put(n, {_signs[0] * u[n] / w[n], _signs[1] * (1 - u[n]) / w[n]});
        }
        return sum;
    }

    // A corner of the latest piece, by its weights: a side is straight on maps in degrees, too.
    void put(int n, const Corner &at) {
        const auto &[i, j, half] = _place;
        const auto &[p, q, r] = _corners;
        const double whole = cross(less(q, p), less(r, p));
        const double second = cross(less(at, p), less(r, p)) / whole;
        const double third = cross(less(q, p), less(at, p)) / whole;
        pieces(_n_pieces - 1, n, 0) = double(i) + third + double(1 - half) * second;
        pieces(_n_pieces - 1, n, 1) = double(j) + third + double(half) * second;
    }
};

int64_t viewshed(const View &view) {
    for (int k = 0; k < 2; k++) {
        const int64_t cells = view.points.extent(k) - 1, at = k == 0 ? view.row : view.column;
        require(at >= 0 && at < cells && view.share.extent(k) == cells &&
                    view.bound.extent(k) == cells,
                "the observer must be over a cell, share and bound have a row and column fewer");
    }
    return Viewshed(view).solve();
}

} // namespace
} // namespace survey

RECORD(survey::View, points, row, column, target, reach, share, bound, pieces);

void register_survey_viewshed(nanobind::module_ &m) {
    def(m, "viewshed", survey::viewshed,
        "Add the visible share of the two triangles of each cell of a grid, and its bound; the "
        "number "
        "of visible pieces.\n\n"
        "`points`, (H, W, 4), are x along rows, y along columns and z from the observer, NaN "
        "where\n"
        "there is no ground, and the size of the numbers that z is the sum of. NaN of ground "
        "within\n"
        "reach becomes 0. `pieces`, (N, 4, 2), get rows and columns of the first N.",
        "view");
}

} // namespace rastercov
