// What is covered with some errors of a pose, and what a disc of parallel rays lights.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "interrupt.hpp"
#include "tolerance/cutter.hpp"

namespace rastercov::engine {

namespace {
// Lines in the plane of a face of what depth and border may be with some errors, each from its
// offset on, less a slack that grows with the distance.
struct PossibleLines {
    std::array<area::Affine, 6> lines;
    std::array<double, 6> offsets;
    int n = 0;

    PossibleLines(const Mount &mount, const std::array<Vector, 4> &border, const Plane &plane) {
        const double cosine = std::cos(mount.errors.angle);
        const auto add = [&](const Vector &by, double offset) {
            lines[size_t(n)] = area::line_in_plane(by.x, by.y, by.z, plane);
            offsets[size_t(n++)] = offset;
        };
        const DepthRange depths =
            depths_of(mount, mount.criteria.rules, std::abs(plane.height), 1.0);
        add({0, 0, cosine}, depths.least);
        if (depths.most < INFINITY) add({0, 0, -cosine}, -depths.most);
        for (const Vector &normal : border) add(cosine * normal, 0.0);
    }

    // Cuts a polygon; its corner count.
    int64_t cut(const Mount &mount, const Plane &plane, const Points &polygon,
                int64_t n_corners) const {
        double reach = 0.0;
        for (int64_t p = 0; p < n_corners; p++) {
            const Vector at = point_of(plane, polygon(p, U), polygon(p, V));
            reach = std::max(reach, dot(at, at));
        }
        const double slack = slack_of(mount.errors, std::sqrt(reach));
        for (int k = 0; k < n && n_corners >= 3; k++) {
            const auto &[value, x, y] = lines[size_t(k)];
            n_corners = cut_by({value - (offsets[size_t(k)] - slack), x, y}, polygon, n_corners);
        }
        return n_corners >= 3 ? n_corners : 0;
    }
};

// Cuts a polygon by the octagon around a disc about the foot of the camera centre. Corner count.
int64_t keep_around(const Plane &plane, double radius, const Points &polygon, int64_t n) {
    static const auto TURNS = area::around<8>(0.0);
    for (const auto &[c, s] : TURNS)
        if (n >= 3) n = cut_by({radius + c * plane.foot_x + s * plane.foot_y, -c, -s}, polygon, n);
    return n;
}

double area_of(const Corners &polygon) { return area::twice_area(polygon, polygon.rows()) / 2; }
} // namespace

// Appends a part of a face to `_overlay`, but for slivers; its area.
double ToleranceCutter::lay(const Corners &polygon) {
    area::Polygon tidy, memory;
    const Points corners = tidy.points();
    const double nearest = _overlay.nearest;
    const int64_t n = area::without_needless(polygon, polygon.rows(), nearest, corners);
    if (n < 3) return 0.0;
    const double size = area::twice_area(corners, n) / 2;
    if (!(size > nearest * area::perimeter_of(corners, n))) return 0.0;
    for (int64_t first = 1; first + 1 < n;) {
        const int64_t m = exact::corners_of_part(first, n);
        exact::copy_part(corners, first, m, memory.points());
        _overlay.append(memory.points(), m, 1);
        first += m - 2;
    }
    return size;
}

// Sets `_hidden` to what the nominal camera centre does not see of a convex part of a face.
void ToleranceCutter::hide_seen(int64_t f, const Posed &seen, const Corners &whole) {
    _hidden_xy.clear();
    _hidden_starts.assign(1, 0);
    _shapes.clear(_overlay.nearest);
    seen.each_piece(f, [&](const Corners &piece) {
        _shapes.add(piece, exact::extent_of(piece, piece.rows()));
    });
    _shapes.each_outside_of_many(whole, [&](const Points &part) {
        _hidden_xy.insert(_hidden_xy.end(), part.begin(), part.end());
        _hidden_starts.push_back(int64_t(_hidden_xy.size()) / 2);
    });
}

// Fills `_overlay` with what shadows reach of what is hidden, all of it where one has no end; the
// area that is left out in slivers.
double ToleranceCutter::lay_shadows(const Posed &seen, Tolerated &result) {
    const area::PieceTable pieces = hidden();
    const bool is_bounded = cast(seen, pieces, 0, n_hidden(), result);
    double left = 0.0;
    const auto put = [&](const Corners &part) { left += area_of(part) - lay(part); };
    for (int64_t q = 0; q < n_hidden(); q++) {
        const Corners piece = piece_of(pieces, q);
        if (is_bounded) _shapes.each_inside_of_many(piece, put);
        else put(piece);
    }
    return left;
}

// Fills `_overlay` with the parts of a face that some camera centre sees; false for none.
bool ToleranceCutter::lay_possible(int64_t f, const Posed &seen, const Corners &whole,
                                   const area::Found &out, Tolerated &result) {
    const Plane &plane = _scratch.plane;
    _overlay.clear(plane.nearest_corners());
    if (result.is_left || std::abs(plane.height) <= seen.d()) {
        out.bound[f] += _overlay.fill(whole, whole.rows(), 1);
        return _overlay.count() > 0;
    }
    double left = area_of(whole);
    if (seen.d() > 0) {
        hide_seen(f, seen, whole);
        for (int64_t q = 0; q < n_hidden(); q++) left -= area_of(piece_of(hidden(), q));
        if (n_hidden() > 0) out.bound[f] += lay_shadows(seen, result);
    }
    // What is seen is beside the rest: no piece of these is held against it.
    area::Polygon memory, spare;
    const Points part = memory.points();
    const exact::Sides<Corners> sides = {whole, whole.rows()};
    seen.each_piece(f, [&](const Corners &piece) {
        area::copy_polygon(piece, piece.rows(), part);
        const int64_t m = exact::clip(part, piece.rows(), sides, sides.n, spare.points());
        if (m >= 3) left -= lay({part.data, {m}});
    });
    if (seen.d() > 0) out.bound[f] += std::max(left, 0.0);
    return _overlay.count() > 0;
}

// Appends the parts of a face that are covered with some errors.
void ToleranceCutter::add_possible(int64_t f, const Posed &seen, const area::Found &out,
                                   Tolerated &result) {
    const Mount &mount = seen.mount;
    Plane &plane = _scratch.plane;
    const double d = seen.d();
    const auto [least, most] = seen.set_plane(f, plane);
    if (most <= -d || (!seen.planes.two_sided[f] && plane.height <= -d)) return;
    area::Polygon memory;
    const Points whole = memory.points();
    area::copy_polygon(seen.planes.corners[f], 3, whole);
    area::Criteria criteria = mount.criteria;
    const double tangent = criteria.rules.tan_incidence;
    const double wanted = criteria.rules.min_pixel_density;
    Plane higher = plane;
    if (tangent > 0)
        higher.height = std::copysign(
            std::abs(plane.height) + d / (tangent * criteria.rules.cos_incidence), plane.height);
    const PossibleLines lines(mount, _border, plane);
    int64_t n = lines.cut(mount, plane, whole, 3);
    if (tangent > 0) n = keep_around(plane, tangent * std::abs(higher.height), whole, n);
    if (n < 3 || !lay_possible(f, seen, {whole.data, {n}}, out, result)) return;
    area::Circle circle(higher, tangent, criteria.gap);
    area::Polygon copy;
    const Points part = copy.points();
    for (int64_t q = 0; q < _overlay.count(); q++) {
        int64_t m = _overlay.n_corners(q);
        if (m < 3) continue;
        area::copy_polygon(_overlay.corners(q), m, part);
        m = lines.cut(mount, plane, part, m); // closer than of the whole face
        if (m < 3) continue;
        const Points kept = {part.data, {m}};
        if (wanted > 0)
            criteria.rules.min_pixel_density =
                wanted * density_factor(mount, plane, kept) / (1 + mount.errors.focal);
        append_criteria(f, kept, circle, criteria, _scratch, out);
    }
}

Tolerated ToleranceCutter::possible(const Posed &seen) {
    Tolerated result;
    const area::Planes &planes = seen.planes;
    const int64_t n_faces = planes.areas.rows();
    const bool is_known = begin(seen, false, result);
    if (is_known && seen.d() > 0) _field.narrow(seen);
    _cut.run(n_faces, [&](const area::Found &out) {
        result.n_shadows = result.n_unbounded = 0;
        for (int64_t k = 0; k < seen.rows.listed.rows(); k++)
            if (planes.is_asked[seen.rows.listed[k]])
                out.bound[seen.rows.listed[k]] = seen.rows.bound[k];
        Poll poll(16);
        for (int64_t f = 0; f < n_faces; f++) {
            poll();
            if (planes.is_asked[f] && planes.areas[f] > 0) add_possible(f, seen, out, result);
            out.bound[f] = std::min(out.bound[f], planes.areas[f]);
        }
    });
    result.regions = copy_regions(_cut.all());
    result.regions.excess = result.regions.bound;
    return result;
}

// Area that shadows leave of some pieces of the face of `_scratch`, or one if a shadow has no end.
double ToleranceCutter::left_of(const Posed &of, const area::PieceTable &pieces, int64_t first,
                                int64_t last, double if_unbounded) {
    Tolerated result;
    if (first == last) return 0.0;
    if (!cast(of, pieces, first, last, result)) return if_unbounded;
    double left = 0.0;
    for (int64_t k = first; k < last; k++)
        _shapes.each_outside_of_many(piece_of(pieces, k),
                                     [&](const Points &part) { left += area_of(part); });
    return left;
}

void ToleranceCutter::sweep(const Posed &lit, Array<double, Any, 3> areas) {
    _field.set_parallel(lit, lit.surface.diagonal());
    _field.narrow(lit);
    Posed within = lit;
    within.mount.disc = {lit.mount.disc.tangent * (1 - MARGIN_REL), true};
    Poll poll(16);
    for (int64_t f = 0; f < lit.planes.areas.rows(); f++) {
        poll();
        const double whole = lit.planes.areas[f];
        if (!lit.planes.is_asked[f] || !(whole > 0)) continue;
        lit.set_plane(f, _scratch.plane);
        _overlay.clear(_scratch.plane.nearest_corners());
        double all = 0.0;
        lit.each_piece(f, [&](const Corners &piece) { all += area_of(piece); });
        const int64_t first = lit.first[size_t(f)], last = lit.first[size_t(f) + 1];
        areas(f, 0) = left_of(lit, lit.rows.pieces, first, last, 0.0);
        areas(f, 1) = left_of(within, lit.rows.pieces, first, last, all);
        hide_seen(f, lit, {lit.planes.corners[f].data, {3}});
        areas(f, 2) = whole - left_of(lit, hidden(), 0, n_hidden(), 0.0);
    }
}

} // namespace rastercov::engine
