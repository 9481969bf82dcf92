// Regions where smooth criteria hold: angles between rays, light, highlights, beams of scanners.
//
// See area/cut.hpp, area/criteria.hpp and area/uncertainty.hpp.
//
// Twin: tests/area/test_point_criteria.py, by points.
#include "area/uncertainty.hpp"
#include "bind.hpp"

namespace rastercov {
namespace area::smooth {
namespace {

struct Pieces {
    FloatRows<2> xy;
    Starts starts;
    Int32Array face, row;
    IntArray set;
};

struct Planes {
    FloatRows<3> origin, x_axis, y_axis;
};

struct Parts {
    Points xy;
    Column<int64_t> starts, piece, used;
};

void check_planes(const Planes &planes, const Int32Array &face) {
    require(have_rows(planes.origin.rows(), planes.x_axis, planes.y_axis),
            "planes must have one row for each face");
    require_indices(face, planes.origin.rows(), "face must hold rows of planes");
}

Plane plane_of(const Planes &planes, int64_t face) {
    return {vector_of(planes.origin[face]), vector_of(planes.x_axis[face]),
            vector_of(planes.y_axis[face])};
}

// Appends a polygon in parts of few corners; false, and nothing, where there is no room.
bool append(Points polygon, int64_t n, int64_t piece, const Parts &out) {
    int64_t &count = out.used[0], &at = out.used[1];
    if (count + n > out.piece.rows() || at + 3 * n > out.xy.rows()) return false;
    each_part(polygon, n, [&](Points part, int64_t m) {
        exact::copy_polygon(part, m, exact::from(out.xy, at));
        out.piece[count] = piece;
        at += m;
        count++;
        out.starts[count] = at;
    });
    return true;
}

// Parts of pieces where a criterion holds for certain; the number of pieces that are done: fewer
// than all where `out` has too little room, to continue from there with more. `row` and `set` are
// the row of the criteria of each piece, and the devices that count there, as bits. `undecided` is
// the area of each piece in parts that are not decided, to a mean width, m, or left out as
// needless; and that in parts that are wider because cuts ended.
template <class Criteria>
int64_t cut_pieces(Pieces pieces, Planes planes, Criteria criteria, double width, double nearest,
                   int64_t first, Array<double, Any, 2> undecided, Parts out) {
    const int64_t n = pieces.face.rows();
    require(pieces.starts.rows() == n + 1 && have_rows(n, pieces.row, pieces.set, undecided),
            "face, row, set and undecided must have one row for each piece, starts one more");
    check_planes(planes, pieces.face);
    criteria.check();
    require_indices(pieces.row, criteria.rows(), "row must hold rows of the criteria");
    require(out.starts.rows() == out.piece.rows() + 1 && out.used.rows() == 2 && out.used[0] >= 0 &&
                out.used[0] <= out.piece.rows() && out.used[1] >= 0 && out.used[1] <= out.xy.rows(),
            "out must have one row for each part, and used what is within it");
    require(first >= 0 && first <= n, "first must be a piece");
    require(width > 0 && nearest >= 0, "width must be positive, nearest not negative");
    Cutter cutter;
    for (int64_t i = first; i < n; i++) {
        const auto piece = piece_at(i, pieces.starts, pieces.xy);
        const auto g = criteria.of(plane_of(planes, pieces.face[i]), pieces.row[i], pieces.set[i]);
        const int64_t before[2] = {out.used[0], out.used[1]};
        bool has_room = true;
        const auto keep = [&](Points polygon, int64_t m) {
            has_room = has_room && append(polygon, m, i, out);
        };
        const Undecided doubtful = cut_tidily(cutter, piece, g, width, nearest, keep);
        if (!has_room) {
            out.used[0] = before[0];
            out.used[1] = before[1];
            return i;
        }
        undecided(i, 0) = doubtful.area;
        undecided(i, 1) = doubtful.cut_short;
    }
    return n;
}

// Sets `out` to value, slopes along the axes of the plane, and doubt within radii of points of
// faces.
template <class Criteria>
void find_values(Planes planes, Criteria criteria, Int32Array face, Int32Array row, IntArray set,
                 FloatRows<3> xyr, Array<double, Any, 4> out) {
    const int64_t n = face.rows();
    require(have_rows(n, row, set, xyr, out),
            "row, set, xyr and out must have one row for each face");
    check_planes(planes, face);
    criteria.check();
    require_indices(row, criteria.rows(), "row must hold rows of the criteria");
    for (int64_t i = 0; i < n; i++) {
        const auto g = criteria.of(plane_of(planes, face[i]), row[i], set[i]);
        const Value found = g.at(xyr(i, 0), xyr(i, 1), xyr(i, 2));
        out(i, 0) = found.value;
        out(i, 1) = found.along_x;
        out(i, 2) = found.along_y;
        out(i, 3) = found.doubt;
    }
}

} // namespace
} // namespace area::smooth

RECORD(area::smooth::Pieces, xy, starts, face, row, set);
RECORD(area::smooth::Planes, origin, x_axis, y_axis);
RECORD(area::smooth::Parts, xy, starts, piece, used);

RECORD(area::smooth::RayAngles, eyes, sign, limit);
RECORD(area::smooth::Webs, angle, turn, share, starts);
RECORD(area::smooth::Lamps, centre, axis, intensity, exponent, table, knots, starts, web, frame,
       webs);
RECORD(area::smooth::Illuminances, lamps, sign, limit);
RECORD(area::smooth::Highlights, eye, lamp, device, sign, cosine);
RECORD(area::smooth::Beams, centre, axis, scale, limit);

RECORD(area::smooth::Devices, centre, axis, noise, range);
RECORD(area::smooth::Uncertainties, devices, limit, along_normal);

template <class Criteria>
void def_both(nanobind::module_ &m, const char *cut, const char *values, const char *where) {
    def(m, cut, area::smooth::cut_pieces<Criteria>, where, "pieces", "planes", "criteria", "width",
        "nearest", "first", "undecided", "out");
    def(m, values, area::smooth::find_values<Criteria>, where, "planes", "criteria", "face", "row",
        "set", "xyr", "out");
}

void register_area_cut(nanobind::module_ &m) {
    using namespace area::smooth;
    m.attr("COINCIDENT_REL") = area::COINCIDENT_REL;
    def_both<RayAngles>(m, "cut_by_angle", "values_of_angle",
                        "sign * cos(angle between the rays to two eyes) >= limit.");
    def_both<Illuminances>(m, "cut_by_light", "values_of_light",
                           "sign * illuminance by lamps >= limit.");
    def_both<Highlights>(m, "cut_by_highlight", "values_of_highlight",
                         "sign * (cos(delta) |s| - n . s) >= 0 for the half vector s.");
    def_both<Beams>(m, "cut_by_beams", "values_of_beams",
                    "At least `limit` beams of scanners a m^2.");
    def_both<Uncertainties>(m, "cut_by_uncertainty", "values_of_uncertainty",
                            "Standard deviations of points of at most `limit`.");
}

} // namespace rastercov
