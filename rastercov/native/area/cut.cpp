// Regions where smooth criteria hold: angles between rays, light, highlights, beams of scanners.
//
// See area/cut.hpp, area/criteria.hpp and area/uncertainty.hpp. Kept parts go through
// without_needless: halving leaves corners that coincide, whose sides have no direction.
//
// Twins: tests/area/test_cut.py and test_point_criteria.py, by points.
#include "area/uncertainty.hpp"
#include "bind.hpp"

namespace rastercov {
namespace area {
namespace {

struct Pieces {
    Array<const double, Any, 2> xy;
    Starts starts;
    Array<const int32_t, Any> face, row;
    Array<const int64_t, Any> set;
};

struct Planes {
    Array<const double, Any, 3> origin, x_axis, y_axis;
};

struct Parts {
    Points xy;
    Array<int64_t, Any> starts, piece, used;
};

void check_planes(const Planes &planes, const Array<const int32_t, Any> &face) {
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
    for (int64_t first = 1; first + 1 < n;) {
        const int64_t m = exact::corners_of_part(first, n);
        exact::copy_part(polygon, first, m, exact::from(out.xy, at));
        out.piece[count] = piece;
        at += m;
        count++;
        out.starts[count] = at;
        first += m - 2;
    }
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
    std::array<double, PIECE_ROOM * 2> room;
    const Points tidy = {room.data(), {PIECE_ROOM, 2}};
    for (int64_t i = first; i < n; i++) {
        const auto piece = piece_at(i, pieces.starts, pieces.xy);
        const auto g = criteria.of(plane_of(planes, pieces.face[i]), pieces.row[i], pieces.set[i]);
        const int64_t before[2] = {out.used[0], out.used[1]};
        bool has_room = true;
        double lost = 0.0;
        const auto keep = [&](Points polygon, int64_t m) {
            const double area = twice_area(polygon, m) / 2;
            const int64_t kept = without_needless(polygon, m, nearest, tidy);
            const double left = kept >= 3 ? twice_area(tidy, kept) / 2 : 0.0;
            if (left > 0) has_room = has_room && append(tidy, kept, i, out);
            lost += std::abs(area - std::max(left, 0.0));
        };
        const Undecided doubtful = cutter.cut(piece, g, width, keep);
        if (!has_room) {
            out.used[0] = before[0];
            out.used[1] = before[1];
            return i;
        }
        undecided(i, 0) = doubtful.area + lost;
        undecided(i, 1) = doubtful.cut_short;
    }
    return n;
}

// Sets `out` to value, slopes along the axes of the plane, and doubt within radii of points of
// faces.
template <class Criteria>
void find_values(Planes planes, Criteria criteria, Array<const int32_t, Any> face,
                 Array<const int32_t, Any> row, Array<const int64_t, Any> set,
                 Array<const double, Any, 3> xyr, Array<double, Any, 4> out) {
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
} // namespace area

template <> struct Record<area::Pieces> {
    static constexpr auto fields =
        Fields<&area::Pieces::xy, &area::Pieces::starts, &area::Pieces::face, &area::Pieces::row,
               &area::Pieces::set>();
};
template <> struct Record<area::Planes> {
    static constexpr auto fields =
        Fields<&area::Planes::origin, &area::Planes::x_axis, &area::Planes::y_axis>();
};
template <> struct Record<area::Parts> {
    static constexpr auto fields =
        Fields<&area::Parts::xy, &area::Parts::starts, &area::Parts::piece, &area::Parts::used>();
};

template <> struct Record<area::RayAngles> {
    using S = area::RayAngles;
    static constexpr auto fields = Fields<&S::eyes, &S::sign, &S::limit>();
};
template <> struct Record<area::Webs> {
    using S = area::Webs;
    static constexpr auto fields = Fields<&S::angle, &S::turn, &S::share, &S::starts>();
};
template <> struct Record<area::Lamps> {
    using S = area::Lamps;
    static constexpr auto fields =
        Fields<&S::centre, &S::axis, &S::intensity, &S::exponent, &S::table, &S::knots, &S::starts,
               &S::web, &S::frame, &S::webs>();
};
template <> struct Record<area::Illuminances> {
    using S = area::Illuminances;
    static constexpr auto fields = Fields<&S::lamps, &S::sign, &S::limit>();
};
template <> struct Record<area::Highlights> {
    using S = area::Highlights;
    static constexpr auto fields = Fields<&S::eye, &S::lamp, &S::device, &S::sign, &S::cosine>();
};
template <> struct Record<area::Beams> {
    using S = area::Beams;
    static constexpr auto fields = Fields<&S::centre, &S::axis, &S::scale, &S::limit>();
};

template <> struct Record<area::Devices> {
    using S = area::Devices;
    static constexpr auto fields = Fields<&S::centre, &S::axis, &S::noise, &S::range>();
};
template <> struct Record<area::Uncertainties> {
    using S = area::Uncertainties;
    static constexpr auto fields = Fields<&S::devices, &S::limit, &S::along_normal>();
};

template <class Criteria>
void def_both(nanobind::module_ &m, const char *cut, const char *values, const char *where) {
    def(m, cut, area::cut_pieces<Criteria>, where, "pieces", "planes", "criteria", "width",
        "nearest", "first", "undecided", "out");
    def(m, values, area::find_values<Criteria>, where, "planes", "criteria", "face", "row", "set",
        "xyr", "out");
}

void register_area_cut(nanobind::module_ &m) {
    using namespace area;
    m.attr("COINCIDENT_REL") = COINCIDENT_REL;
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
