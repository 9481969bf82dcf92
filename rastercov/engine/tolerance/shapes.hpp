// Convex shapes in the plane of a face, and what is outside and inside of them of polygons.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "area/overlay.hpp"
#include "tolerance/mount.hpp"
#include <numeric>
#include <span>

namespace rastercov::engine {

class Shapes {
  public:
    // Forgets all. Corners no farther than `nearest` from each other are one.
    void clear(double nearest) {
        _nearest = nearest;
        _shapes.clear();
    }
    // Adds one, of corners that stay where they are, and its extent.
    void add(const Corners &corners, const exact::Bounds &box) {
        _shapes.push_back({corners, box});
    }

    // Calls with the parts of a convex polygon outside of all shapes.
    template <class Each> void each_outside(const Corners &polygon, const Each &each) {
        each_rest(polygon, list_all(), each);
    }
    // The same where the shapes may be many.
    template <class Each> void each_outside_of_many(const Corners &polygon, const Each &each) {
        const auto few = [&](const Points &part, List list) { each_rest(part, list, each); };
        divide_all(polygon, few, [](const Points &) {});
    }
    // Calls with the parts inside of some shape, each once.
    template <class Each> void each_inside_of_many(const Corners &polygon, const Each &each) {
        area::Polygon memory, spare;
        const Points part = memory.points();
        const auto few = [&](const Points &own, List list) {
            for (size_t at = 0; at < list.size(); at++) {
                const Sides sides = sides_of(list[at]);
                area::copy_polygon(own, own.rows(), part);
                const int64_t m = exact::clip(part, own.rows(), sides, sides.n, spare.points());
                if (m >= 3) each_rest({part.data, {m}}, list.first(at), each);
            }
        };
        divide_all(polygon, few, each);
    }

  private:
    using List = std::span<const int32_t>;
    using Sides = exact::Sides<Corners>;
    struct Shape {
        Corners corners;
        exact::Bounds box;
    };
    // Shapes that are held against one another; more are divided by place, so many times at most.
    static constexpr size_t MOST_AT_ONCE = 20;
    static constexpr int DEEPEST = 16;

    Sides sides_of(int32_t k) const {
        const Corners &corners = _shapes[size_t(k)].corners;
        return {corners, corners.rows()};
    }
    List list_all() {
        _list.resize(_shapes.size());
        std::iota(_list.begin(), _list.end(), 0);
        return _list;
    }
    // Calls with the parts of a polygon outside of the shapes of a list.
    template <class Each> void each_rest(const Corners &polygon, List list, const Each &each) {
        const exact::Bounds box = exact::extent_of(polygon, polygon.rows());
        area::Polygon spare;
        double values[area::PIECE_ROOM];
        int64_t n_parts = -1; // for lack of room
        while (n_parts < 0) {
            _own.set_first(polygon, polygon.rows());
            n_parts = 1;
            for (const int32_t k : list) {
                if (n_parts <= 0) break;
                if (are_apart(_shapes[size_t(k)].box, box)) continue;
                const Sides sides = sides_of(k);
                n_parts = exact::clip_subtract(_own.view(), n_parts, sides, sides.n, sides.n,
                                               area::SLACK_REL * _nearest, spare.points(),
                                               {values, {area::PIECE_ROOM}});
            }
            if (n_parts < 0) _own.grow(2 * _own.room());
        }
        for (int64_t q = 0; q < n_parts; q++) each(Points{_own[q].data, {_own.n(q)}});
    }
    template <class Few, class Within>
    void divide_all(const Corners &polygon, const Few &few, const Within &within) {
        area::Polygon own;
        const int64_t n = polygon.rows();
        area::copy_polygon(polygon, n, own.points());
        list_all();
        divide({own.corners, {n}}, 0, 0, few, within);
    }
    // Divides a convex polygon by place until few of the shapes of `_list`, from one on, reach into
    // a part: calls few(part, list) for such parts, and within(part) for those within a shape.
    template <class Few, class Within>
    void divide(const Points &polygon, size_t first, int depth, const Few &few,
                const Within &within) {
        const int64_t n = polygon.rows();
        const exact::Bounds box = exact::extent_of(polygon, n);
        const size_t last = _list.size();
        bool is_within = false;
        for (size_t at = first; at < last && !is_within; at++) {
            const int32_t k = _list[at];
            const Sides sides = sides_of(k);
            if (are_apart(_shapes[size_t(k)].box, box) ||
                exact::separates(sides, sides.n, polygon, n))
                continue;
            is_within = exact::contains(sides, sides.n, polygon, n);
            _list.push_back(k);
        }
        if (is_within) {
            within(polygon);
        } else if (_list.size() - last <= MOST_AT_ONCE || depth == DEEPEST) {
            few(polygon, List(_list).subspan(last));
        } else {
            const double width = box.u_max - box.u_min, height = box.v_max - box.v_min;
            const bool is_wide = width > height;
            const double middle = is_wide ? box.u_min + width / 2 : box.v_min + height / 2;
            area::Polygon memory;
            const Points part = memory.points();
            for (const double sign : {1.0, -1.0}) {
                area::copy_polygon(polygon, n, part);
                const int64_t m =
                    cut_by({-sign * middle, is_wide ? sign : 0.0, is_wide ? 0.0 : sign}, part, n);
                if (m >= 3) divide({part.data, {m}}, last, depth + 1, few, within);
            }
        }
        _list.resize(last);
    }

    double _nearest = 0.0;
    std::vector<Shape> _shapes;
    std::vector<int32_t> _list;
    area::Parts _own{64};
};

} // namespace rastercov::engine
