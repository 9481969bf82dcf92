// Lines between the pieces of a face, and pieces cut by them.
//
// Twins: tests/area/test_division.py.
#include "solver/division.hpp"
#include "area/overlay.hpp"
#include "interrupt.hpp"

namespace rastercov::engine {
namespace {

using area::Points, area::PIECE_ROOM, area::U, area::V;

// Pairs of pieces in both halves, relative to those before, above which no line helps.
constexpr double LEAST_GAIN = 0.95;
// The same, below which no further line is tried.
constexpr double ENOUGH = 0.75;
// Places of lines among the beginnings of pieces: the first, and others where it is no help.
constexpr std::array<double, 3> QUANTILES = {0.5, 0.2, 0.8};
// Pieces whose longest side gives the direction of a line, where no axis does: slivers.
constexpr std::array<double, 2> SAMPLES = {0.25, 0.75};

// Ascending, and what is no number last.
bool is_before(double a, double b) { return a < b || (std::isnan(b) && !std::isnan(a)); }

Points points_of(std::array<double, PIECE_ROOM * 2> &room) {
    return {room.data(), {PIECE_ROOM, 2}};
}

// Directions and places of lines, and the best of them.
class DividerSearch {
  public:
    DividerSearch(const PieceList &pieces, double nearest)
        : _pieces(pieces), _nearest(nearest), _n(double(pieces.size())),
          _least(LEAST_GAIN * _n * _n), _low(size_t(pieces.size())), _high(size_t(pieces.size())) {}

    bool is_found() const { return _is_found; }
    bool is_enough() const { return _least <= ENOUGH * _n * _n; }
    const Divider &best() const { return _best; }

    // Tries the first of the quantiles along a direction.
    void along(double a, double b, size_t n_quantiles) {
        poll_interrupt();
        measure(a, b);
        _ordered = _low;
        for (size_t k = 0; k < n_quantiles; k++) {
            const auto at = _ordered.begin() + int64_t(QUANTILES[k] * _n);
            std::nth_element(_ordered.begin(), at, _ordered.end(), is_before);
            consider({a, b, *at});
        }
    }

    // Tries all of them across the longest side of a piece.
    void across_piece(int64_t number) {
        const Polygon piece = _pieces[number];
        double longest = -1.0;
        double x = 0.0;
        double y = 0.0;
        for (int64_t p = 0; p < piece.rows(); p++) {
            const int64_t q = p + 1 < piece.rows() ? p + 1 : 0;
            const double dx = piece(q, U) - piece(p, U), dy = piece(q, V) - piece(p, V);
            const double length = std::hypot(dx, dy);
            if (!(length > longest)) continue;
            longest = length;
            x = dx;
            y = dy;
        }
        if (longest > 0) along(-(y / longest), x / longest, QUANTILES.size());
    }

  private:
    // Extents of all pieces along a direction.
    void measure(double a, double b) {
        for (size_t i = 0; i < _low.size(); i++) {
            const Polygon piece = _pieces[int64_t(i)];
            Range all;
            for (int64_t p = 0; p < piece.rows(); p++) all.add(piece(p, U) * a + piece(p, V) * b);
            _low[i] = all.least;
            _high[i] = all.most;
        }
    }

    void consider(const Divider &line) {
        int64_t n_low = 0;
        int64_t n_high = 0;
        for (size_t i = 0; i < _low.size(); i++) {
            n_low += _low[i] < line.c - _nearest;
            n_high += _high[i] > line.c + _nearest;
        }
        const double pairs = double(n_low) * double(n_low) + double(n_high) * double(n_high);
        if (!(pairs < _least)) return;
        _best = line;
        _least = pairs;
        _is_found = true;
    }

    const PieceList &_pieces;
    double _nearest, _n, _least;
    bool _is_found = false;
    Divider _best = {};
    std::vector<double> _low, _high, _ordered;
};

} // namespace

double area_of(Polygon polygon) {
    const int64_t n = polygon.rows() - 1, last = n - n % 8;
    if (n < 8) return area::twice_area(polygon, n + 1) / 2;
    const auto twice = [&](int64_t k) { // of the triangle from corner k + 1 on; 0 for the last
        const int64_t p = k + 1, q = p < n ? p + 1 : 0;
        return (polygon(p, U) - polygon(0, U)) * (polygon(q, V) - polygon(0, V)) -
               (polygon(p, V) - polygon(0, V)) * (polygon(q, U) - polygon(0, U));
    };
    std::array<double, 8> sums = {};
    for (int64_t k = 0; k < last; k++) sums[k % 8] += twice(k);
    double total =
        ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
    for (int64_t k = last; k < n; k++) total += twice(k);
    return total / 2;
}

void PieceList::append(Polygon polygon, int64_t tag) {
    const int64_t end = _starts.back() + polygon.rows();
    _tags.reserve(_tags.size() + 1 > _tags.capacity() ? 2 * _tags.size() + 64 : 0);
    _starts.reserve(_tags.capacity() + 1);
    _xy.insert(_xy.end(), polygon.begin(), polygon.end());
    _starts.push_back(end);
    _tags.push_back(tag);
}

void PieceList::shorten(int64_t n) {
    _tags.resize(size_t(n));
    _starts.resize(size_t(n + 1));
    _xy.resize(size_t(2 * _starts.back()));
}

bool find_divider(const PieceList &pieces, double nearest, Divider &line) {
    DividerSearch search(pieces, nearest);
    search.along(1.0, 0.0, 1);
    search.along(0.0, 1.0, 1);
    if (!search.is_enough()) {
        search.along(1.0, 0.0, QUANTILES.size());
        search.along(0.0, 1.0, QUANTILES.size());
        for (const double part : SAMPLES)
            search.across_piece(int64_t(part * double(pieces.size())));
    }
    line = search.best();
    return search.is_found();
}

Halver::Parts Halver::cut(Polygon polygon, const Divider &line, double nearest) {
    const int64_t n = polygon.rows();
    const double slack = area::SLACK_REL * nearest;
    Range all = {0.0, 0.0};
    for (int64_t p = 0; p < n; p++) {
        const double value = line.a * polygon(p, U) + line.b * polygon(p, V) - line.c;
        _values[p] = std::abs(value) > slack ? value : 0.0;
        all.add(_values[p]);
    }
    if (!(all.least < 0 && 0 < all.most)) return {false, all.most > 0, 0, 0, 0.0, 0.0};
    const Points copy = points_of(_polygon);
    area::copy_polygon(polygon, n, copy);
    const auto [kept, lost] =
        exact::split(copy, n, {_values.data(), {PIECE_ROOM}}, points_of(_above), points_of(_below));
    return {true,
            false,
            lost,
            kept,
            area::twice_area(polygon, n) / 2,
            4 * slack * area::perimeter_of(polygon, n)};
}

// Appends a part without needless corners; its area, 0 for a sliver, which is left out.
double Halver::append_part(int64_t n, bool is_above, int64_t tag, double nearest, PieceList &out) {
    const Points part = points_of(is_above ? _above : _below), tidy = points_of(_tidy);
    const int64_t kept = n >= 3 ? area::without_needless(part, n, nearest, tidy) : 0;
    const double area = kept >= 3 ? area::twice_area(tidy, kept) / 2 : 0.0;
    if (!(area > nearest * area::perimeter_of(tidy, kept))) return 0.0;
    for (int64_t first = 1; first + 1 < kept;) {
        const int64_t m = exact::corners_of_part(first, kept);
        exact::copy_part(tidy, first, m, points_of(_polygon));
        out.append({_polygon.data(), {m, 2}}, tag);
        first += m - 2;
    }
    return area;
}

} // namespace rastercov::engine
