// Division of the pieces of a face by lines, for their union, and lists that hold them.
//
// Twins: tests/area/test_division.py.
#pragma once
#include "area/polygon.hpp"
#include <vector>

namespace rastercov::engine {

using Polygon = FloatRows<2>;

// Area, m^2, with the sums of numpy's add.reduceat: of more than 8 triangles in eight of them.
double area_of(Polygon polygon);

// Convex polygons of 3 to PIECE_ROOM corners, one after another, with a number for each.
class PieceList {
  public:
    int64_t size() const { return int64_t(_tags.size()); }
    int64_t n_corners() const { return _starts.back(); }
    int64_t tag(int64_t i) const { return _tags[i]; }
    Polygon operator[](int64_t i) const {
        const int64_t start = _starts[i];
        return {_xy.data() + 2 * start, {_starts[i + 1] - start, 2}};
    }
    // All corners, and where pieces start.
    const std::vector<double> &xy() const { return _xy; }
    const std::vector<int64_t> &starts() const { return _starts; }

    // Appends a polygon, which no memory of this list holds. Where memory runs out, nothing.
    void append(Polygon polygon, int64_t tag);
    // Leaves the first n.
    void shorten(int64_t n);

  private:
    std::vector<double> _xy;
    std::vector<int64_t> _starts = {0}, _tags;
};

// Line a x + b y = c; its upper side is where a x + b y > c.
struct Divider {
    double a, b, c;
};

// Sets `line` to one that leaves few of the pieces in both halves together; false if none helps.
// By an axis through the middle where that separates half of them or more; or the best of some
// lines, also along long pieces. Corners nearer than `nearest` coincide, m.
//
// J. Bentley. Multidimensional Binary Search Trees Used for Associative Searching. 1975.
bool find_divider(const PieceList &pieces, double nearest, Divider &line);

// Parts of polygons on the two sides of lines.
class Halver {
  public:
    // Appends the parts of a polygon, those below the line first, and calls `each(is_above)` for
    // each. Returns the bound of what that does to its area and its overlap with others, m^2.
    template <class Each>
    double halve(Polygon polygon, int64_t tag, const Divider &line, double nearest, PieceList &out,
                 Each each) {
        const Parts parts = cut(polygon, line, nearest);
        if (!parts.is_cut) {
            out.append(polygon, tag);
            each(parts.is_above);
            return 0.0;
        }
        const int64_t first = out.size();
        double after = append_part(parts.n_below, false, tag, nearest, out);
        const int64_t n_below = out.size() - first;
        after += append_part(parts.n_above, true, tag, nearest, out);
        for (int64_t i = first; i < out.size(); i++) each(i - first >= n_below);
        return std::abs(parts.area - after) + parts.slack;
    }

  private:
    struct Parts {
        bool is_cut, is_above;
        int64_t n_below, n_above;
        double area, slack;
    };
    Parts cut(Polygon polygon, const Divider &line, double nearest);
    double append_part(int64_t n, bool is_above, int64_t tag, double nearest, PieceList &out);

    using Room = std::array<double, area::PIECE_ROOM * 2>;
    Room _polygon, _above, _below, _tidy;
    std::array<double, area::PIECE_ROOM> _values;
};

} // namespace rastercov::engine
