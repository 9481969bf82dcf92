// Visible part of every cell of a grid of heights, from a point, front to back.
//
// The observer is the origin; a cell has two triangles. In an octant 0 <= b <= a of the plane, with
//
//     u = b / a,   v = z / a,   w = 1 / a,
//
// edges are straight lines in (u, v), w is affine on a triangle, and a point is visible if v is at
// least the horizon, the greatest v at its u of all that is nearer. Strips along a, and in each the
// cells along b, are in that order. Of a triangle, the part above the horizon between u0 and u1 is
//
//     (u1 - u0) / 2 |1 / (w0 w1) at the top - 1 / (w0 w1) at the bottom|.
//
// Heights are above a sphere of radius R, near the observer a paraboloid: z falls by (a^2 + b^2) /
// 2 R. An error of z is 8 units of rounding of it; each line has that of its v, and the bound of an
// area is its difference between horizons that are lower and higher by both errors.
//
// J. Wang, G. J. Robinson, K. White. Generating viewsheds without using sightlines. 2000, for the
// horizon of what is nearer, here without its approximations. Twin:
// tests/support/viewshed_by_fractions.py.
#include "bind.hpp"
#include "interrupt.hpp"
#include <cmath>

namespace rastercov {
namespace survey {
namespace {

constexpr double ROUNDING = 0x1p-53;
constexpr double BELOW_ALL = -1e300;

struct Line { // in (u, v), from its left end
    double u, v, slope;
    double error; // of v

    double at(double u1) const { return v + slope * (u1 - u); }
    bool operator==(const Line &other) const {
        return u == other.u && v == other.v && slope == other.slope;
    }
};

struct Corner { // of a triangle in an octant
    double a, b, z;
    double size; // of the numbers that z is the sum of
};

struct Projected {
    double u, v, w;
    double raised; // v of the target above it
    double size;
};

// u between two where lines cross; the first where they do not.
double crossing(const Line &line, const Line &other, double u0, double u1) {
    const double d0 = line.at(u0) - other.at(u0), d1 = line.at(u1) - other.at(u1);
    const bool is_crossing = (d0 > 0 && d1 < 0) || (d0 < 0 && d1 > 0);
    return is_crossing ? u0 + (u1 - u0) * (d0 / (d0 - d1)) : u0;
}

// The greatest v of all that is nearer, for u from 0 to 1: pieces of lines, before and after a
// place that moves along with the cells.
class Horizon {
  public:
    struct Piece {
        double start;
        Line line;
    };

    void clear() {
        _before.clear();
        _after.assign(1, {0.0, {0.0, BELOW_ALL, 0.0, 0.0}});
    }

    // Calls `each` with u0, u1 and the line of each piece of an interval.
    template <class Each> void visit(double first, double last, Each each) {
        move_to(first);
        for (size_t n = _after.size(); n > 0 && _after[n - 1].start < last; n--) {
            const size_t i = n - 1;
            const double u0 = std::max(first, _after[i].start);
            const double u1 = std::min(last, end_of(i));
            if (u1 > u0) each(u0, u1, _after[i].line);
        }
    }

    // Raises it to a line between two u.
    void raise(const Line &line, double first, double last) {
        bool rises = false;
        visit(first, last, [&](double u0, double u1, const Line &old) {
            rises |= line.at(u0) > old.at(u0) || line.at(u1) > old.at(u1);
        });
        if (!rises) return;
        _new.clear();
        const double end = end_of_those_before(last);
        if (_after.back().start < first) put(_after.back().start, _after.back().line);
        visit(first, last, [&](double u0, double u1, const Line &old) {
            const double u = crossing(line, old, u0, u1);
            const double d0 = line.at(u0) - old.at(u0), d1 = line.at(u1) - old.at(u1);
            const bool is_within = u > u0 && u < u1;
            if (is_within) put(u0, d0 > 0 ? line : old);
            put(is_within ? u : u0, (is_within ? d1 : d0 + d1) > 0 ? line : old);
        });
        Line rest = _after.back().line;
        while (!_after.empty() && _after.back().start < last) {
            rest = _after.back().line;
            _after.pop_back();
        }
        if (last < end) put(last, rest);
        while (!_after.empty() && !_new.empty() && _after.back().line == _new.back().line)
            _after.pop_back();
        _after.insert(_after.end(), _new.rbegin(), _new.rend());
    }

  private:
    std::vector<Piece> _before, _after, _new; // `_after` from the last to the first

    double end_of(size_t i) const { return i > 0 ? _after[i - 1].start : 1.0; }

    // End of the last piece that starts before some u.
    double end_of_those_before(double last) const {
        for (size_t n = _after.size(); n > 0; n--)
            if (_after[n - 1].start >= last) return _after[n - 1].start;
        return 1.0;
    }

    void put(double start, const Line &line) {
        if (_new.empty() || !(_new.back().line == line)) _new.push_back({start, line});
    }

    // Makes the piece that has u the first one after the place.
    void move_to(double u) {
        while (!_before.empty() && _after.back().start > u) {
            _after.push_back(_before.back());
            _before.pop_back();
        }
        while (_after.size() > 1 && _after[_after.size() - 2].start <= u) {
            _before.push_back(_after.back());
            _after.pop_back();
        }
    }
};

struct Area {
    double value = 0.0;
    double bound = 0.0;

    void operator+=(const Area &other) {
        value += other.value;
        bound += other.bound;
    }
};

struct Edge { // of a polygon in (u, v), from its left end
    Line line;
    double last; // u of its right end
    double w0, w1;

    double w(double u) const { return w0 + (u - line.u) / (last - line.u) * (w1 - w0); }
};

Edge edge_of(const Projected &one, const Projected &other, bool is_raised) {
    const Projected &p = one.u < other.u ? one : other, &q = one.u < other.u ? other : one;
    const double v0 = is_raised ? p.raised : p.v, v1 = is_raised ? q.raised : q.v;
    const double slope = (v1 - v0) / (q.u - p.u);
    const double size = std::max(p.size, q.size) + std::abs(slope) * q.u;
    return {{p.u, v0, slope, 8 * ROUNDING * size}, q.u, p.w, q.w};
}

// Area above a horizon between two sides, from u0 to u1; calls `each` with its parts: u, and w of
// bottom and top, at both ends.
template <class Each>
double above(const Line &horizon, const Edge &low, const Edge &top, double first, double last,
             Each each) {
    const double one = crossing(horizon, low.line, first, last);
    const double other = crossing(horizon, top.line, first, last);
    const double cuts[4] = {first, std::min(one, other), std::max(one, other), last};
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        const double u0 = cuts[k], u1 = cuts[k + 1], middle = 0.5 * (u0 + u1);
        const double at = horizon.at(middle);
        if (!(u1 > u0) || at >= top.line.at(middle)) continue;
        const bool is_whole = at <= low.line.at(middle);
        const auto bottom = [&](double u) {
            const double v = low.line.at(u), height = top.line.at(u) - v, w = low.w(u);
            const double part = is_whole || !(height > 0) ? 0.0 : (horizon.at(u) - v) / height;
            return w + std::min(std::max(part, 0.0), 1.0) * (top.w(u) - w);
        };
        const double low0 = bottom(u0), low1 = bottom(u1), high0 = top.w(u0), high1 = top.w(u1);
        each(u0, u1, {low0, low1, high0, high1});
        sum += 0.5 * (u1 - u0) * std::abs(1 / (high0 * high1) - 1 / (low0 * low1));
    }
    return sum;
}

struct Axis { // of an octant: cells of the grid from that of the observer on
    double origin, step;
    int64_t sign, start, count;

    double position(int64_t line) const { return double(sign) * (double(line) * step - origin); }
    int64_t near(int64_t cell) const { return sign > 0 ? cell : cell + 1; }
    int64_t far(int64_t cell) const { return sign > 0 ? cell + 1 : cell; }
    bool has(int64_t cell) const { return cell >= 0 && cell < count; }
};

struct Ground {
    Array<const double, Any, Any> heights; // NaN where there is none
    Array<const double, 2> spacing;        // of columns and rows, metres
    double inverse_radius;                 // 0 for a plane

    int64_t rows() const { return heights.extent(0); }
    int64_t columns() const { return heights.extent(1); }
};

struct View {
    Array<const double, 3> eye; // from the first sample along columns and rows, and height
    double target;              // height of what is seen above the surface
    double reach;               // of cells that count, metres
};

struct Result {
    Array<double, Any, Any, 2> share, bound; // of cells: of their south-west, north-east triangles
    Array<double, Any, 8> pieces;            // visible parts on the map: four corners
};

class Viewshed {
  public:
    Viewshed(const Ground &ground, const View &view, const Result &result)
        : _ground(ground), _view(view), _result(result) {}

    // Number of visible parts.
    int64_t solve() {
        Poll poll(64);
        for (int octant = 0; octant < 8; octant++) {
            set(octant);
            _horizon.clear();
            for (int64_t i = _major.start; _major.has(i); i += _major.sign) {
                poll();
                strip(i);
            }
        }
        return _n_pieces;
    }

  private:
    const Ground &_ground;
    const View &_view;
    const Result &_result;
    Horizon _horizon;
    Axis _major{}, _minor{};
    bool _is_swapped = false;
    int64_t _n_pieces = 0;
    int64_t _row = 0; // of the triangle
    int64_t _column = 0;
    int64_t _half = 0;
    std::vector<Corner> _inside, _clipped; // of the triangle in the octant
    std::vector<Edge> _edges;
    std::vector<double> _cuts; // their ends

    void set(int octant) {
        const auto axis = [&](int k, bool is_back) {
            const double step = _ground.spacing[k], at = _view.eye[k];
            const int64_t count = (k == 0 ? _ground.columns() : _ground.rows()) - 1;
            const int64_t cell = std::min(int64_t(std::floor(at / step)), count - 1);
            return Axis{at, step, is_back ? -1 : 1, std::max(cell, int64_t(0)), count};
        };
        _is_swapped = (octant & 1) != 0;
        _major = axis(_is_swapped ? 1 : 0, (octant & 2) != 0);
        _minor = axis(_is_swapped ? 0 : 1, (octant & 4) != 0);
    }

    Corner corner(int64_t major, int64_t minor) const {
        const double a = _major.position(major), b = _minor.position(minor);
        const double fall = 0.5 * _ground.inverse_radius * (a * a + b * b);
        const double h =
            _is_swapped ? _ground.heights(major, minor) : _ground.heights(minor, major);
        const double above = h - _view.eye[2];
        return {a, b, above - fall, std::abs(above) + fall + _view.target};
    }

    void strip(int64_t i) {
        const double far = _major.position(_major.far(i));
        const double near = std::max(0.0, _major.position(_major.near(i)));
        if (!(far > 0) || near > _view.reach) return;
        for (int64_t j = _minor.start; _minor.has(j); j += _minor.sign) {
            const double side = std::max(0.0, _minor.position(_minor.near(j)));
            if (side >= far || std::hypot(near, side) > _view.reach) break;
            if (_minor.position(_minor.far(j)) > 0) cell(i, j);
        }
    }

    void cell(int64_t i, int64_t j) {
        const int64_t i0 = _major.near(i), i1 = _major.far(i);
        const int64_t j0 = _minor.near(j), j1 = _minor.far(j);
        const Corner nn = corner(i0, j0), fn = corner(i1, j0);
        const Corner nf = corner(i0, j1), ff = corner(i1, j1);
        const bool is_main = _major.sign == _minor.sign; // the diagonal is from nn to ff
        const Corner &p = is_main ? nn : fn, &q = is_main ? ff : nf;
        const Corner one[3] = {p, is_main ? fn : nn, q}, other[3] = {p, q, is_main ? nf : ff};
        // The side of the diagonal on which the observer is goes first.
        const double side = p.a * q.b - p.b * q.a;
        const double of_one = (q.a - p.a) * (one[1].b - p.b) - (q.b - p.b) * (one[1].a - p.a);
        const bool is_one_first = side * of_one >= 0;
        _row = _is_swapped ? i : j;
        _column = _is_swapped ? j : i;
        const int64_t line = _is_swapped ? j0 : (is_main ? i1 : i0); // of one that is no other's
        const int64_t half = line > _column ? 1 : 0;
        for (const bool is_one : {is_one_first, !is_one_first}) {
            _half = is_one ? half : 1 - half;
            triangle(is_one ? one : other);
        }
    }

    // Has no observer below its edges or inside.
    static bool is_beside(const Corner (&c)[3]) {
        double least = INFINITY;
        double most = -INFINITY;
        for (int k = 0; k < 3; k++) {
            const Corner &p = c[k], &q = c[(k + 1) % 3];
            const double side = p.a * q.b - p.b * q.a;
            least = std::min(least, side);
            most = std::max(most, side);
        }
        return least < 0 && most > 0;
    }

    void triangle(const Corner (&corners)[3]) {
        if (std::isnan(corners[0].z + corners[1].z + corners[2].z)) return;
        _inside.assign(corners, corners + 3);
        for (int side = 0; side < 2; side++)
            if (!is_inside(_inside, side)) clip(side);
        if (_inside.size() < 3) return;
        const double below = plane_below(corners);
        if (!is_beside(corners)) {
            raise_edges();
            add_whole(_view.target > 0 || below < 0);
            return;
        }
        if (_view.target > 0) raise([](double w_low, double w_top) { return w_top > w_low; });
        if (_view.target > 0 || below < 0) {
            add(visible());
        } else if (below == 0) {
            add_whole(false);
        }
        raise([](double, double) { return true; });
    }

    Projected projected(const Corner &corner) const {
        const double w = 1 / corner.a;
        return {corner.b * w, corner.z * w, w, (corner.z + _view.target) * w, corner.size * w};
    }

    // Height of the plane of a triangle at the place of the observer, who sees its front where it
    // is negative; 0 where rounding hides it.
    double plane_below(const Corner (&c)[3]) const {
        const double a1 = c[1].a - c[0].a, b1 = c[1].b - c[0].b, z1 = c[1].z - c[0].z;
        const double a2 = c[2].a - c[0].a, b2 = c[2].b - c[0].b, z2 = c[2].z - c[0].z;
        const double whole = a1 * b2 - a2 * b1;
        const double x = (z1 * b2 - z2 * b1) / whole * c[0].a;
        const double y = (a1 * z2 - a2 * z1) / whole * c[0].b;
        const double size = c[0].size + c[1].size + c[2].size;
        const double step = std::min(_ground.spacing[0], _ground.spacing[1]);
        const double reach = 1 + (std::abs(c[0].a) + std::abs(c[0].b)) / step;
        const double below = c[0].z - x - y;
        const double error = 16 * ROUNDING * (size * reach + std::abs(x) + std::abs(y));
        return std::abs(below) <= error ? 0.0 : below;
    }

    static double outside(const Corner &corner, int side) {
        return side == 0 ? -corner.b : corner.b - corner.a;
    }

    static bool is_inside(const std::vector<Corner> &corners, int side) {
        return std::none_of(corners.begin(), corners.end(),
                            [&](const Corner &each) { return outside(each, side) > 0; });
    }

    // Keeps what is in the octant.
    void clip(int side) {
        _clipped.clear();
        for (size_t k = 0; k < _inside.size(); k++) {
            const Corner &p = _inside[k], &q = _inside[(k + 1) % _inside.size()];
            const double d = outside(p, side), e = outside(q, side);
            if (d <= 0) _clipped.push_back(p);
            if (d < 0 && e > 0) _clipped.push_back(on_border(p, q, d, e, side));
            if (d > 0 && e < 0) _clipped.push_back(on_border(q, p, e, d, side));
        }
        _inside.swap(_clipped);
    }

    // Between a corner inside and one outside: the same for both triangles of an edge.
    static Corner on_border(const Corner &p, const Corner &q, double d, double e, int side) {
        const double part = d / (d - e);
        const double a = p.a + part * (q.a - p.a);
        return {a, side == 0 ? 0.0 : a, p.z + part * (q.z - p.z), std::max(p.size, q.size)};
    }

    // Adds all of the triangle in the octant, or nothing with all of it as the bound.
    void add_whole(bool is_visible) {
        double twice = 0.0;
        for (size_t k = 0; k < _inside.size(); k++) {
            const Corner &p = _inside[k], &q = _inside[(k + 1) % _inside.size()];
            twice += p.a * q.b - p.b * q.a;
        }
        const double area = 0.5 * std::abs(twice);
        add(is_visible ? Area{area, 0.0} : Area{0.0, area});
        for (size_t k = 2; is_visible && k < _inside.size(); k++)
            put_piece({_inside[0], _inside[k - 1], _inside[k], _inside[0]});
    }

    // Sets the sides of the triangle in (u, v), or of targets above it, that are seen in front.
    void set_edges(bool is_raised) {
        _edges.clear();
        for (size_t k = 0; k < _inside.size(); k++) {
            const Corner &one = _inside[k], &other = _inside[(k + 1) % _inside.size()];
            if (!(one.a > 0 && other.a > 0)) continue;
            const Projected p = projected(one), q = projected(other);
            if (p.u != q.u) _edges.push_back(edge_of(p, q, is_raised));
        }
    }

    // Of a triangle that is below the observer.
    void raise_edges() {
        set_edges(false);
        for (const Edge &edge : _edges) _horizon.raise(edge.line, edge.line.u, edge.last);
    }

    // Calls `each` with the bottom and top sides of the triangle over each interval.
    template <class Each> void visit(bool is_raised, Each each) {
        set_edges(is_raised);
        _cuts.clear();
        for (const Edge &edge : _edges) _cuts.insert(_cuts.end(), {edge.line.u, edge.last});
        std::sort(_cuts.begin(), _cuts.end());
        for (size_t k = 1; k < _cuts.size(); k++) {
            const double u0 = _cuts[k - 1], u1 = _cuts[k], middle = 0.5 * (u0 + u1);
            if (!(u1 > u0)) continue;
            const Edge *low = nullptr, *top = nullptr;
            for (const Edge &edge : _edges) {
                if (edge.line.u > u0 || edge.last < u1) continue;
                const double v = edge.line.at(middle);
                if (low == nullptr || v < low->line.at(middle)) low = &edge;
                if (top == nullptr || v >= top->line.at(middle)) top = &edge;
            }
            if (top != nullptr) each(u0, u1, *low, *top);
        }
    }

    // Raises the horizon to the top of the triangle, or to its bottom, by w of both.
    template <class IsTop> void raise(IsTop is_top) {
        visit(false, [&](double u0, double u1, const Edge &low, const Edge &top) {
            const double middle = 0.5 * (u0 + u1);
            _horizon.raise((is_top(low.w(middle), top.w(middle)) ? top : low).line, u0, u1);
        });
    }

    Area visible() {
        Area sum;
        visit(_view.target > 0, [&](double first, double last, const Edge &low, const Edge &top) {
            _horizon.visit(first, last, [&](double u0, double u1, const Line &line) {
                const double error = line.error + low.line.error + top.line.error;
                const auto is_hidden = [&](double u) {
                    return line.at(u) - error > top.line.at(u);
                };
                if (!is_hidden(u0) || !is_hidden(u1)) sum += area_of(line, low, top, u0, u1);
            });
        });
        return sum;
    }

    Area area_of(const Line &line, const Edge &low, const Edge &top, double first, double last) {
        const double error = line.error + low.line.error + top.line.error;
        const auto put = [&](double u0, double u1, const double (&w)[4]) {
            const auto at = [](double u, double of) { return Corner{1 / of, u / of, 0.0, 0.0}; };
            put_piece({at(u0, w[0]), at(u1, w[1]), at(u1, w[3]), at(u0, w[2])});
        };
        const auto moved = [&](double by) {
            const Line other = {line.u, line.v + by, line.slope, 0.0};
            return above(other, low, top, first, last, [](double, double, const double (&)[4]) {});
        };
        const double value = above(line, low, top, first, last, put);
        const double most = moved(-error), least = moved(error);
        return {value, std::max(most - value, value - least) + 16 * ROUNDING * most};
    }

    void put_piece(const std::array<Corner, 4> &corners) {
        if (_n_pieces < _result.pieces.rows())
            for (int k = 0; k < 4; k++) {
                const double a = _major.origin + double(_major.sign) * corners[size_t(k)].a;
                const double b = _minor.origin + double(_minor.sign) * corners[size_t(k)].b;
                _result.pieces(_n_pieces, 2 * k) = _is_swapped ? b : a;
                _result.pieces(_n_pieces, 2 * k + 1) = _is_swapped ? a : b;
            }
        _n_pieces++;
    }

    // Adds an area on the map to the triangle.
    void add(const Area &area) {
        const double cell = _ground.spacing[0] * _ground.spacing[1];
        _result.share(_row, _column, _half) += area.value / cell;
        _result.bound(_row, _column, _half) += area.bound / cell;
    }
};

int64_t viewshed(const Ground &ground, const View &view, const Result &result) {
    const int64_t rows = ground.rows() - 1, columns = ground.columns() - 1;
    require(rows > 0 && columns > 0, "heights must have two rows and columns or more");
    for (const auto &each : {result.share, result.bound})
        require(each.extent(0) == rows && each.extent(1) == columns,
                "share and bound must have one row and column fewer than heights");
    const auto is_inside = [&](int k, int64_t count) {
        return view.eye[k] >= 0 && view.eye[k] <= ground.spacing[k] * double(count);
    };
    require(ground.spacing[0] > 0 && ground.spacing[1] > 0 && is_inside(0, columns) &&
                is_inside(1, rows),
            "eye must be on the grid, spacing must be positive");
    return Viewshed(ground, view, result).solve();
}

} // namespace
} // namespace survey

RECORD(survey::Ground, heights, spacing, inverse_radius);
RECORD(survey::View, eye, target, reach);
RECORD(survey::Result, share, bound, pieces);

void register_survey_viewshed(nanobind::module_ &m) {
    using namespace survey;
    def(m, "viewshed", viewshed,
        "Add the visible share of each triangle of a cell and its bound; the number of visible "
        "pieces.\n\n"
        "Heights, (H, W), are NaN where there is no ground. `pieces`, (N, 8), get the corners of "
        "the\n"
        "first N.",
        "ground", "view", "result");
}

} // namespace rastercov
