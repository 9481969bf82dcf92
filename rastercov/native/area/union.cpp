// Union of regions in the planes of the faces, and how many or which cameras cover each part.
//
// A face of few pieces is one cell, see rastercov.coverage.area.division. The pieces of a cell are
// an Overlay, with numbers of cameras that stop at k, from where on pieces are not divided any
// more, or with sets of cameras. halve_pieces divides pieces by lines, for the division.
//
// Twins: tests/area/test_union.py, by Clipper2.
#include "area/union.hpp"
#include "bind.hpp"

namespace rastercov {
namespace area {
namespace {

enum { DONE, PARTITION_TOO_SMALL }; // results of unite_cells
// Part of the area of a face that may be missing from what counts as all of it.
constexpr double WHOLE_REL = 1e-9;

using Corners = Array<const double, Any, 2>;
using Numbers = Array<const int64_t, Any>;

struct Cells {
    Corners xy;
    Starts starts;
    Array<const double, Any> areas, nearest;
    Numbers whole;
};

struct Old {
    Corners xy;
    Starts starts;
    Numbers cell;
    Numbers tag;
};

struct New {
    Corners xy;
    Starts starts;
    Numbers cell, thing;
};

struct Partition {
    Points xy;
    Array<int64_t, Any> starts, cell, tag;
    Array<int64_t, 2> used;
};

// Adds new pieces, order[first] ... order[last - 1], to a cell that is not closed, and the cameras
// that cover all of it; the area that is left out. `is_closed` is set where k cameras cover it.
template <class Tally>
double unite_cell(int64_t f, const Cells &cells, Tally tally, const New &pieces,
                  const Numbers &order, int64_t first, int64_t last, Overlay<Tally> &overlay,
                  bool &is_closed) {
    const auto is_full = [&](int64_t tag) { return tally.is_full(tag); };
    const double wanted = (1 - WHOLE_REL) * cells.areas[f], close = cells.nearest[f];
    double slivers = 0.0;
    if (cells.whole[f] != 0) {
        for (int64_t q = 0; q < overlay.count(); q++)
            overlay.set_tag(q, tally.plus(overlay.tag(q), cells.whole[f]));
        const Corners all = piece_at(f, cells.starts, cells.xy);
        slivers += overlay.fill(all, all.rows(), tally.plus(0, cells.whole[f]));
    }
    // No more than a piece's own area is won by it, so that the sum need not be made each time.
    double most = Tally::CLOSES ? overlay.area_of(is_full) : 0.0;
    is_closed = Tally::CLOSES && most >= wanted;
    for (int64_t index = first; index < last && !is_closed; index++) {
        const Corners piece = piece_at(order[index], pieces.starts, pieces.xy);
        const int64_t n = piece.rows();
        tally.begin(pieces.thing[order[index]]);
        // A corner near a line counts as on it, on either side.
        slivers += overlay.add(piece, n, tally) + 4 * SLACK_REL * close * perimeter_of(piece, n);
        if constexpr (Tally::CLOSES) {
            most += twice_area(piece, n) / 2;
            if (most < wanted) continue;
            most = overlay.area_of(is_full);
            is_closed = most >= wanted;
        }
    }
    if (is_closed) {
        slivers += std::max(cells.areas[f] - overlay.area_of(is_full), 0.0);
        const Corners all = piece_at(f, cells.starts, cells.xy);
        overlay.clear(close);
        overlay.append(all, all.rows(), tally.plus(0, std::numeric_limits<int32_t>::max()));
    }
    return slivers;
}

// Appends the pieces of a cell to a partition; false, and nothing, where there is no room.
template <class Tally>
bool store_partition(int64_t cell, const Overlay<Tally> &overlay, const Partition &out) {
    int64_t n_corners = 0, &piece = out.used[0], &at = out.used[1];
    for (int64_t q = 0; q < overlay.count(); q++) n_corners += overlay.n_corners(q);
    if (piece + overlay.count() > out.cell.rows() || at + n_corners > out.xy.rows()) return false;
    for (int64_t q = 0; q < overlay.count(); q++) {
        const int64_t n = overlay.n_corners(q);
        if (n == 0) continue;
        copy_polygon(overlay.corners(q), n, exact::from(out.xy, at));
        out.cell[piece] = cell, out.tag[piece] = overlay.tag(q);
        at += n, piece++;
        out.starts[piece] = at;
    }
    return true;
}

// Adds new pieces to a partition, cell by cell; DONE, or PARTITION_TOO_SMALL: call again with more
// room in `out`, to continue. `old` has the pieces so far, by cell; `order` the new pieces to be
// added, by cell, large ones first; `cells` their polygons, areas, distance below which corners
// coincide, and cameras that cover all of each, besides: a number of them, or a set.
//
// Changed: `is_closed`, cells that k cameras cover, to which nothing is added any more; `bound`, to
// which the area of slivers that are left out is added; `span`: the first cell, its first pieces in
// `old` and `order`, and the cell to end at.
template <class Tally>
int64_t unite(Cells cells, Tally tally, Old old, New pieces, Numbers order,
              Array<bool, Any> is_closed, Array<double, Any> bound, Partition out,
              Array<int64_t, 4> span) {
    const int64_t n = cells.areas.rows();
    require(cells.starts.rows() == n + 1 && cells.nearest.rows() == n && cells.whole.rows() == n &&
                is_closed.rows() == n && bound.rows() == n,
            "cells, is_closed and bound must have one row for each cell, starts one more");
    require(old.starts.rows() == old.cell.rows() + 1 && old.tag.rows() == old.cell.rows() &&
                pieces.starts.rows() == pieces.cell.rows() + 1 &&
                pieces.thing.rows() == pieces.cell.rows(),
            "cell, tag and thing must have one row for each piece, starts one more");
    require(out.starts.rows() == out.cell.rows() + 1 && out.tag.rows() == out.cell.rows() &&
                out.used[0] >= 0 && out.used[0] <= out.cell.rows() && out.used[1] >= 0 &&
                out.used[1] <= out.xy.rows(),
            "out must have one row for each piece, and used what is within it");
    require(span[0] >= 0 && span[1] >= 0 && span[2] >= 0 && span[3] <= n, "span must be cells");
    Overlay<Tally> overlay;
    for (int64_t f = span[0]; f < span[3]; f++) {
        span[0] = f;
        int64_t at_old = span[1], at_new = span[2];
        overlay.clear(cells.nearest[f]);
        for (; at_old < old.cell.rows() && old.cell[at_old] == f; at_old++) {
            const Corners piece = piece_at(at_old, old.starts, old.xy);
            require(tally.is_right(old.tag[at_old]), "tags must be 0 ... k");
            overlay.append(piece, piece.rows(), old.tag[at_old]);
        }
        for (; at_new < order.rows(); at_new++) {
            require(order[at_new] >= 0 && order[at_new] < pieces.cell.rows(),
                    "order must hold pieces");
            if (pieces.cell[order[at_new]] != f) break;
        }
        bool closed = false;
        double slivers = 0.0;
        if (!is_closed[f])
            slivers = unite_cell(f, cells, tally, pieces, order, span[2], at_new, overlay, closed);
        if (!store_partition(f, overlay, out)) return PARTITION_TOO_SMALL;
        is_closed[f] = is_closed[f] || closed;
        bound[f] += slivers;
        span[0] = f + 1, span[1] = at_old, span[2] = at_new;
    }
    return DONE;
}

int64_t unite_cells(Cells cells, int64_t k, Old old, New pieces, Numbers order,
                    Array<bool, Any> is_closed, Array<double, Any> bound, Partition out,
                    Array<int64_t, 4> span) {
    require(k >= 1 && k < std::numeric_limits<int32_t>::max(), "k must be a number of cameras");
    for (const int64_t number : cells.whole) require(number >= 0, "whole must be numbers");
    return unite(cells, CountTo{k}, old, pieces, order, is_closed, bound, out, span);
}

int64_t unite_sets(Cells cells, Old old, New pieces, Numbers order, Array<bool, Any> is_closed,
                   Array<double, Any> bound, Partition out, Array<int64_t, 4> span) {
    return unite(cells, SetOf{}, old, pieces, order, is_closed, bound, out, span);
}

// Parts of pieces on the two sides of lines: corners, starts, row of the piece, and side; `used`
// has the parts and their corners.
struct Halves {
    Points xy;
    Array<int64_t, Any> starts, row, side;
    Array<int64_t, 2> used;
};

// Counts a part of n corners, which are stored.
void count_half(int64_t n, int64_t row, int64_t side, const Halves &out) {
    const int64_t part = out.used[0], end = out.used[1] + n;
    out.row[part] = row, out.side[part] = side, out.starts[part + 1] = end;
    out.used[0] = part + 1, out.used[1] = end;
}

bool has_room(int64_t parts, int64_t corners, const Halves &out) {
    return out.used[0] + parts <= out.row.rows() && out.used[1] + corners <= out.xy.rows();
}

// Appends a part of a piece without needless corners; its area, 0 for a sliver, left out.
double append_half(Points polygon, int64_t n, int64_t row, int64_t side, double nearest,
                   Points spare, const Halves &out) {
    const int64_t kept = n >= 3 ? without_needless(polygon, n, nearest, spare) : 0;
    const double area = kept >= 3 ? twice_area(spare, kept) / 2 : 0.0;
    if (!(area > nearest * perimeter_of(spare, kept))) return 0.0;
    for (int64_t first = 1; first + 1 < kept;) {
        const int64_t m = exact::corners_of_part(first, kept);
        require(has_room(1, m, out), "out must have room for all parts");
        exact::copy_part(spare, first, m, exact::from(out.xy, out.used[1]));
        count_half(m, row, side, out);
        first += m - 2;
    }
    return area;
}

// Divides pieces, each by a line of its own: (a, b, c), of which side 1 is a x + b y > c. Out:
// their parts, and the bound of what that does to the area of a piece and its overlap with others.
// `nearest` is the least distance of two corners that do not coincide, metres.
void halve_pieces(Corners xy, Starts starts, Array<const double, Any, 3> lines,
                  Array<const double, Any> nearest, Array<double, Any> change, Halves out) {
    const int64_t n_pieces = lines.rows();
    require(starts.rows() == n_pieces + 1 && nearest.rows() == n_pieces &&
                change.rows() == n_pieces,
            "lines, nearest and change must have one row for each piece, starts one more");
    require(out.starts.rows() == out.row.rows() + 1 && out.side.rows() == out.row.rows(),
            "out must have one row for each part");
    double room[4][PIECE_ROOM * 2], values[PIECE_ROOM];
    const auto points = [&](int k) { return Points{room[k], {PIECE_ROOM, 2}}; };
    const Points polygon = points(0), spare = points(1), inside = points(2), outside = points(3);
    out.used[0] = out.used[1] = 0;
    for (int64_t row = 0; row < n_pieces; row++) {
        const int64_t n = corners_of(row, starts, xy.rows());
        const double close = nearest[row], slack = SLACK_REL * close;
        const double a = lines(row, 0), b = lines(row, 1), c = lines(row, 2);
        double least = 0.0, most = 0.0;
        copy_polygon(piece_at(row, starts, xy), n, polygon);
        for (int64_t p = 0; p < n; p++) {
            const double value = a * polygon(p, U) + b * polygon(p, V) - c;
            values[p] = std::abs(value) > slack ? value : 0.0;
            least = std::min(least, values[p]), most = std::max(most, values[p]);
        }
        change[row] = 0.0;
        if (least < 0 && 0 < most) {
            const double before = twice_area(polygon, n) / 2;
            const auto [kept, lost] =
                exact::split(polygon, n, {values, {PIECE_ROOM}}, inside, outside);
            double after = append_half(outside, lost, row, 0, close, spare, out);
            after += append_half(inside, kept, row, 1, close, spare, out);
            change[row] = std::abs(before - after) + 4 * slack * perimeter_of(polygon, n);
            continue;
        }
        require(has_room(1, n, out), "out must have room for all parts");
        copy_polygon(polygon, n, exact::from(out.xy, out.used[1]));
        count_half(n, row, most > 0 ? 1 : 0, out);
    }
}

} // namespace
} // namespace area

template <> struct Record<area::Cells> {
    using S = area::Cells;
    static constexpr auto fields = Fields<&S::xy, &S::starts, &S::areas, &S::nearest, &S::whole>();
};
template <> struct Record<area::Old> {
    using S = area::Old;
    static constexpr auto fields = Fields<&S::xy, &S::starts, &S::cell, &S::tag>();
};
template <> struct Record<area::New> {
    using S = area::New;
    static constexpr auto fields = Fields<&S::xy, &S::starts, &S::cell, &S::thing>();
};
template <> struct Record<area::Partition> {
    using S = area::Partition;
    static constexpr auto fields = Fields<&S::xy, &S::starts, &S::cell, &S::tag, &S::used>();
};
template <> struct Record<area::Halves> {
    using S = area::Halves;
    static constexpr auto fields = Fields<&S::xy, &S::starts, &S::row, &S::side, &S::used>();
};

void register_area_union(nanobind::module_ &m) {
    using namespace area;
    m.attr("COINCIDENT_REL") = COINCIDENT_REL;
    m.attr("PARTITION_TOO_SMALL") = int(PARTITION_TOO_SMALL);
    def(m, "unite_cells", unite_cells,
        "Add new pieces to a partition, cell by cell; DONE, or PARTITION_TOO_SMALL: call again "
        "with more room, to continue.",
        "cells", "k", "old", "new", "order", "is_closed", "bound", "out", "span");
    def(m, "unite_sets", unite_sets,
        "Add new pieces to a partition by sets of cameras; see unite_cells.", "cells", "old", "new",
        "order", "is_closed", "bound", "out", "span");
    def(m, "halve_pieces", halve_pieces, "Divide pieces, each by a line of its own.", "xy",
        "starts", "lines", "nearest", "change", "out");
}

} // namespace rastercov
