// Overlay of convex pieces in one cell of a face: a partition, and what covers each part of it.
//
// The pieces of a cell do not overlap, and each has a tag of what was added over it. A new piece P
// changes a piece Q of tag t into Q n P of tag `tally.with(t)` and the parts of Q outside P of tag
// t; what no Q covers of P is new, of tag `tally.first()`. All cuts are those of
// exact::clip_subtract, which keeps no topology, so that nothing can become inconsistent.
//
// A tally says what tags, numbers of 64 bits, are:
//
//   void begin(int64_t)  before a piece, of a thing
//   Tag first()        of what only the new piece covers
//   Tag with(Tag)      of what it covers besides
//   bool is_full(Tag)  pieces that are not divided any more
//   bool adds()        what nothing covers yet of the new piece is new
//   bool only_adds()   no piece is divided: what is covered already is done
//   Tag plus(Tag, Tag)  of what things of the second tag cover besides
//
// CountTo counts up to k. SetOf has up to 64 things as bits, or those that divide, with the first.
//
// Invariants: pieces have 3 to MOST_CORNERS corners, or 0 where they are left out; memory grows
// as needed and is kept from cell to cell.
//
// Twins: tests/area/test_union.py, by Clipper2.
#pragma once
#include "area/polygon.hpp"
#include "interrupt.hpp"
#include "simd.hpp"
#include <array>
#include <vector>

namespace rastercov::area {

using exact::Bounds, exact::MOST_CORNERS, exact::Sides;

// Distance from a line up to which a corner is on it, relative to that of coincident corners.
constexpr double SLACK_REL = 0.1;

struct CountTo {
    int64_t k;
    static constexpr bool CLOSES = true; // a cell that k cover is done
    void begin(int64_t) {}
    int64_t first() const { return 1; }
    int64_t with(int64_t views) const { return views + 1; }
    int64_t plus(int64_t views, int64_t more) const { return std::min(views + more, k); }
    bool is_full(int64_t views) const { return views == k; }
    bool adds() const { return true; }
    bool only_adds() const { return k == 1; }
};

// Things that divide what is there, or what none of them covers yet, and add nothing.
enum Kind : int64_t { ADDS, DIVIDES, DIVIDES_FIRST };

// Of the number of a thing: its bit in a set, its kind from the sixth bit on, and from the eighth
// its place among those that divide, of which a set has the first, above its bits.
constexpr int64_t IN_SET = 64, N_NUMBERS = 1 << 23;
constexpr int KIND_AT = 6, PLACE_AT = 8, FIRST_AT = 48;
constexpr int64_t FIRST = -(int64_t(1) << FIRST_AT); // bits of the place

struct SetOf {
    int64_t first_of = 0; // bits of the place, where things divide
    int64_t own = 0;
    static constexpr bool CLOSES = false;
    static int64_t kind_of(int64_t thing) { return thing >> KIND_AT & 3; }
    static int64_t set_of(int64_t thing) {
        const uint64_t bit = kind_of(thing) == DIVIDES_FIRST ? 0 : uint64_t(1) << thing % IN_SET;
        return int64_t(bit) | thing >> PLACE_AT << FIRST_AT;
    }
    void begin(int64_t thing) { own = set_of(thing); }
    int64_t first() const { return own; }
    int64_t with(int64_t set) const { return plus(set, own); }
    int64_t plus(int64_t set, int64_t more) const {
        return set | (set & first_of ? more & ~FIRST : more);
    }
    bool is_full(int64_t set) const { return with(set) == set; }
    bool adds() const { return first_of == 0; }
    bool only_adds() const { return false; }
};

// Convex polygons of up to PIECE_ROOM corners, whose number grows.
class Parts {
  public:
    explicit Parts(int64_t n) { grow(n); }
    void grow(int64_t n) {
        xy.resize(n * PIECE_ROOM * 2);
        counts.resize(n);
    }
    int64_t room() const { return int64_t(counts.size()); }
    int64_t n(int64_t at) const { return counts[at]; }
    Points operator[](int64_t at) { return {xy.data() + at * PIECE_ROOM * 2, {PIECE_ROOM, 2}}; }
    // Sets the first of them to a polygon.
    template <class Source> void set_first(const Source &polygon, int64_t n) {
        copy_polygon(polygon, n, (*this)[0]);
        counts[0] = n;
    }
    exact::Pieces view() {
        return {{xy.data(), {room(), PIECE_ROOM, 2}}, {counts.data(), {room()}}};
    }

  private:
    std::vector<double> xy;
    std::vector<int64_t> counts;
};

class Overlay {
  public:
    using Tag = int64_t;
    using Polygon = FloatRows<2>;

    double nearest = 0.0; // least distance of two corners of this cell that do not coincide, m

    int64_t count() const { return n_pieces; }
    int64_t n_corners(int64_t q) const { return counts[q]; }
    double area(int64_t q) const { return areas[q]; }
    Tag tag(int64_t q) const { return tags[q]; }
    void set_tag(int64_t q, Tag tag) { tags[q] = tag; }
    Polygon corners(int64_t q) const { return {at(q), {MOST_CORNERS, 2}}; }

    // Begins a cell without pieces.
    void clear(double least_distance) {
        n_pieces = 0;
        nearest = least_distance;
    }
    // Appends a piece as it is.
    void append(Polygon polygon, int64_t n, Tag tag) {
        require(n <= MOST_CORNERS, "pieces of a partition must have at most 20 corners");
        const int64_t q = new_piece();
        copy_polygon(polygon, n, points(q));
        set_piece(q, n, tag);
    }

    // Adds a piece, of at most PIECE_ROOM corners; the area that is left out in slivers, m^2.
    template <class Tally> double add(Polygon polygon, int64_t n, const Tally &tally) {
        find_near(exact::extent_of(polygon, n));
        double slivers = tally.adds() ? fill_near(polygon, n, tally.first()) : 0.0;
        if (tally.only_adds()) return slivers;
        const Sides<Polygon> sides = {polygon, n};
        for (const int64_t q : near) {
            poll();
            if (tally.is_full(tags[q])) continue;
            const double whole = areas[q];
            if (is_missed(q, sides) && std::isfinite(whole)) continue;
            const int64_t m = counts[q];
            const Tag before = tags[q];
            const int64_t n_rest = subtract_all(
                corners(q), m, [&](int64_t n_rest) { return subtract(sides, n, n_rest); });
            double outside = 0.0;
            for (int64_t r = 0; r < n_rest; r++)
                outside += std::max(twice_area(rest[r], rest.n(r)) / 2, 0.0);
            if (whole - outside <= nearest * perimeter_of(corners(q), m)) continue;
            if (n_rest == 0) {
                tags[q] = tally.with(before);
                continue;
            }
            const Points common = {cut.data(), {PIECE_ROOM, 2}};
            copy_polygon(corners(q), m, common);
            const int64_t n_common = exact::clip(common, m, sides, n, spare_points());
            slivers += put_piece(common, n_common, tally.with(before), q);
            for (int64_t r = 0; r < n_rest; r++)
                slivers += put_piece(rest[r], rest.n(r), before, n_pieces);
        }
        return slivers;
    }

    // Appends the part of a polygon that no piece covers; the area that is left out in slivers.
    double fill(Polygon polygon, int64_t n, Tag tag) {
        find_near(exact::extent_of(polygon, n));
        return fill_near(polygon, n, tag);
    }

    // Area of the pieces with wanted tags, m^2.
    template <class Wanted> double area_of(Wanted is_wanted) const {
        double total = 0.0;
        for (int64_t q = 0; q < n_pieces; q++)
            if (counts[q] > 0 && is_wanted(tags[q])) total += areas[q];
        return total;
    }

  private:
    int64_t n_pieces = 0;
    int64_t capacity = 0;
    std::vector<double> xy, areas;
    std::vector<int64_t> counts, near;
    std::vector<Tag> tags;
    std::array<std::vector<double>, 4> box; // extents of the pieces; nowhere of those left out
    Parts rest{64};
    Poll poll{64};
    std::array<double, PIECE_ROOM * 2> spare, cut;
    std::array<double, PIECE_ROOM> values;

    double fill_near(Polygon polygon, int64_t n, Tag tag) {
        const int64_t n_rest = subtract_all(polygon, n, [&](int64_t n_rest) {
            for (size_t k = 0; k < near.size() && n_rest > 0; k++) {
                poll();
                const Polygon piece = corners(near[k]);
                n_rest = subtract({piece, counts[near[k]]}, counts[near[k]], n_rest);
            }
            return n_rest;
        });
        double slivers = 0.0;
        for (int64_t r = 0; r < n_rest; r++)
            slivers += put_piece(rest[r], rest.n(r), tag, n_pieces);
        return slivers;
    }

    const double *at(int64_t q) const { return xy.data() + q * MOST_CORNERS * 2; }
    Points points(int64_t q) { return {xy.data() + q * MOST_CORNERS * 2, {MOST_CORNERS, 2}}; }
    Points spare_points() { return {spare.data(), {PIECE_ROOM, 2}}; }

    int64_t new_piece() {
        if (n_pieces == capacity) {
            const int64_t more = std::max(2 * capacity, int64_t(4 * LANES));
            xy.resize(more * MOST_CORNERS * 2);
            areas.resize(more);
            counts.resize(more);
            tags.resize(more);
            for (auto &side : box) side.resize(more);
            capacity = more; // where there was memory for all
        }
        return n_pieces++;
    }
    void set_piece(int64_t q, int64_t n, Tag tag) {
        counts[q] = n;
        tags[q] = tag;
        areas[q] = twice_area(points(q), n) / 2;
        const Bounds b = exact::extent_of(points(q), n);
        box[0][q] = b.u_min;
        box[1][q] = b.u_max;
        box[2][q] = b.v_min;
        box[3][q] = b.v_max;
    }
    void leave_out(int64_t q) {
        counts[q] = 0;
        box[0][q] = std::numeric_limits<double>::infinity();
    }

    // Stores a piece at q, or, in parts of at most MOST_CORNERS corners, from the last on. The
    // first part is stored at q, which may be the number of pieces. Returns the area that is left
    // out because it is a sliver.
    double put_piece(Points polygon, int64_t n, Tag tag, int64_t q) {
        const Points tidy = spare_points();
        const double whole = n >= 3 ? twice_area(polygon, n) / 2 : 0.0;
        const double before = std::max(whole, 0.0);
        const int64_t kept = without_needless(polygon, n, nearest, tidy);
        const double area = kept == n ? whole : kept >= 3 ? twice_area(tidy, kept) / 2 : 0.0;
        if (kept < 3 || !(area > nearest * perimeter_of(tidy, kept))) {
            if (q < n_pieces) leave_out(q);
            return before;
        }
        for (int64_t first = 1; first + 1 < kept;) {
            if (first > 1 || q == n_pieces) q = new_piece();
            const int64_t m = exact::corners_of_part(first, kept);
            exact::copy_part(tidy, first, m, points(q));
            set_piece(q, m, tag);
            first += m - 2;
        }
        return std::abs(area - before);
    }

    // Fills `near` with the pieces that reach into a box.
    void find_near(const Bounds &wanted) {
        near.clear();
        int64_t q = 0;
        for (; q + LANES <= n_pieces; q += LANES) {
            const auto u = (Double::load(&box[0][q]) < Double(wanted.u_max)) &
                           (Double::load(&box[1][q]) > Double(wanted.u_min));
            const auto v = (Double::load(&box[2][q]) < Double(wanted.v_max)) &
                           (Double::load(&box[3][q]) > Double(wanted.v_min));
            for (int64_t found = bits(u & v); found; found = without_lowest(found))
                near.push_back(q + std::countr_zero(uint64_t(found)));
        }
        for (; q < n_pieces; q++)
            if (box[0][q] < wanted.u_max && box[1][q] > wanted.u_min && box[2][q] < wanted.v_max &&
                box[3][q] > wanted.v_min)
                near.push_back(q);
    }

    // True if a side of a polygon has a piece beyond it, as clip_subtract finds before it cuts.
    bool is_missed(int64_t q, const Sides<Polygon> &sides) const {
        const Polygon piece = corners(q);
        for (int64_t s = 0; s < sides.n; s++) {
            const Line line = exact::line_at(sides, s);
            const double slack = exact::slack_of(line, SLACK_REL * nearest);
            bool is_beyond = slack >= 0;
            for (int64_t p = 0; p < counts[q] && is_beyond; p++)
                is_beyond = !(line.value(piece(p, U), piece(p, V)) > slack);
            if (is_beyond) return true;
        }
        return false;
    }

    // Takes a convex polygon from the `n_rest` parts of `rest`; their number, -1 for no room.
    int64_t subtract(const Sides<Polygon> &sides, int64_t n, int64_t n_rest) {
        return exact::clip_subtract(rest.view(), n_rest, sides, n, n, SLACK_REL * nearest,
                                    spare_points(), {values.data(), {PIECE_ROOM}});
    }

    // Sets `rest` to a polygon less what `take(n_rest)` subtracts, again with more room where there
    // is too little; the number of parts.
    template <class Take> int64_t subtract_all(Polygon polygon, int64_t n, Take take) {
        while (true) {
            rest.set_first(polygon, n);
            const int64_t n_rest = take(1);
            if (n_rest >= 0) return n_rest;
            rest.grow(2 * rest.room());
        }
    }
};

} // namespace rastercov::area
