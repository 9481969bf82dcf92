// What is covered whatever the errors of a pose.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "interrupt.hpp"
#include "tolerance/cutter.hpp"

namespace rastercov::engine {

namespace {
// Sides of the hull round a cap of directions.
constexpr int CAP = 24;

// Directions whose hull holds a cap of directions.
struct Cap {
    Vector middle;
    std::array<Vector, CAP> around;
    int n = 0;

    // Those up to an angle from a unit vector.
    static Cap of(const Vector &axis, double angle) {
        static const auto TURNS = area::around<CAP>(0.0);
        if (angle == 0) return {axis, {axis}, 1};
        Cap cap = {axis, {}, 0};
        const auto [u, v] = area::across(axis, {1, 0, 0});
        const double out = std::sin(angle) / std::cos(std::numbers::pi / CAP);
        for (const auto &[c, s] : TURNS)
            cap.around[size_t(cap.n++)] = std::cos(angle) * axis + out * (c * u + s * v);
        return cap;
    }
};

// Pieces of one face of a table: the one after the last.
int64_t end_of_face(const Int32Array &face, int64_t first) {
    int64_t end = first;
    while (end < face.rows() && face[end] == face[first]) end++;
    return end;
}
} // namespace

// Directions of the criteria of a pose, in camera axes.
struct Directions {
    Cap axis;
    std::array<Cap, 4> border;
    double cosine, sine;

    explicit Directions(const Mount &mount) {
        const double angle = mount.margins.cap * mount.errors.angle;
        axis = Cap::of({0, 0, 1}, angle);
        const auto normals =
            border_of(mount.criteria.lens, mount.margins.focal * mount.errors.focal);
        for (size_t k = 0; k < 4; k++) border[k] = Cap::of(normals[k], angle);
        cosine = std::cos(angle);
        sine = std::sin(angle);
    }

    // Which criteria all corners of a polygon meet in all poses: least and most depth, four
    // borders.
    std::array<bool, 6> met_by(const Corners &polygon, const Plane &plane, double least,
                               double most, double d) const {
        std::array<bool, 6> is_met;
        is_met.fill(true);
        for (int64_t p = 0; p < polygon.rows(); p++) {
            const Vector at = point_of(plane, polygon(p, U), polygon(p, V));
            // Least along a cap: its cosine along the middle, less its sine across.
            const auto holds = [&](const Vector &middle, double limit) {
                const double along = dot(middle, at), square = dot(at, at);
                const double across = std::sqrt(std::max(square - along * along, 0.0));
                return cosine * along - sine * std::sqrt(square) >= limit ||
                       cosine * along - sine * across >= limit;
            };
            is_met[0] &= holds(axis.middle, least);
            is_met[1] &= at.z + sine * area::length2(at.x, at.y) <= most;
            for (size_t k = 0; k < 4; k++) is_met[k + 2] &= holds(border[k].middle, d);
        }
        return is_met;
    }
};

namespace {
// The height of a plane from which the disc of incidence is that of all camera centres.
double lower_height(const Mount &mount, double height) {
    const Rules &rules = mount.criteria.rules;
    return height -
           mount.margins.disc * mount.errors.position / (rules.tan_incidence * rules.cos_incidence);
}

// Criterion that some errors break at a point of a face, first of the depths that some of the rules
// allow.
coverage::Reason unmet(const Mount &mount, const Directions &directions, const Plane &plane,
                       Points corner) {
    area::Criteria criteria = mount.criteria;
    const Rules &rules = mount.criteria.rules;
    const double d = mount.errors.position, height = std::abs(plane.height);
    const auto are_met = [&](const Rules &some) {
        const auto [least, most] = depths_of(mount, some, height, -1.0);
        const auto each = directions.met_by(corner, plane, least + d, most - d, d);
        return std::find(each.begin(), each.end(), false) == each.end();
    };
    if (height <= d) return coverage::BACK_FACING;
    Rules some = {};
    some.z_f = INFINITY;
    if (!are_met(some)) return coverage::OUTSIDE;
    some.z_n = rules.z_n;
    some.z_f = rules.z_f;
    if (!are_met(some)) return coverage::OUT_OF_FOCUS;
    const double factor = (1 - mount.errors.focal) * density_factor(mount, plane, corner);
    criteria.rules.min_pixel_density /= factor;
    const bool is_dense =
        !(rules.min_pixel_density > 0) || area::dense_by_corners(corner, 1, plane, criteria) > 0;
    if (!are_met(rules) || !is_dense) return coverage::TOO_COARSE;
    const double away = area::length2(corner(0, U) - plane.foot_x, corner(0, V) - plane.foot_y);
    const bool is_steep =
        rules.tan_incidence > 0 && away > lower_height(mount, height) * rules.tan_incidence;
    return is_steep ? coverage::TOO_OBLIQUE : coverage::OCCLUDED;
}
} // namespace

void find_unmet(const area::Planes &planes, const area::Criteria &criteria, const Mounts &mount,
                FloatRows<2> points, IntArray face, Column<uint8_t> reason) {
    require(have_rows(1, mount.world_from_camera, mount.errors) &&
                have_rows(reason.rows(), points, face),
            "mount must have one row, points, face and reason equally many");
    require_planes(planes);
    require_indices(face, planes.areas.rows(), "face must hold faces");
    const Mount own = mount_of(mount, 0, criteria, 0.0);
    const Directions directions(own);
    for (int64_t k = 0; k < reason.rows(); k++) {
        Plane plane;
        area::set_plane(planes, face[k], seen_of(own), plane);
        double corner[] = {points(k, U), points(k, V)};
        reason[k] = unmet(own, directions, plane, {corner, {1}});
    }
}

// Cuts the pieces of a face by depth, border, incidence and density.
void ToleranceCutter::cut_face(int64_t f, const Posed &of, const Directions &directions,
                               int64_t first, int64_t last, const area::Found &out) {
    const Mount &mount = of.mount;
    Plane &plane = _scratch.plane;
    const double d = of.d(), height = std::abs(plane.height);
    area::Criteria criteria = mount.criteria;
    const double tangent = criteria.rules.tan_incidence;
    Plane lower = plane;
    if (tangent > 0) {
        lower.height = lower_height(mount, height);
        if (!(lower.height > 0)) return;
        lower.height = std::copysign(lower.height, plane.height);
    }
    area::Circle circle(lower, tangent, criteria.gap);
    const DepthRange depths = depths_of(mount, criteria.rules, height, -1.0);
    const double least = depths.least + d, most = depths.most - d;
    const double wanted = criteria.rules.min_pixel_density;
    area::Polygon memory;
    const Points polygon = memory.points();
    for (int64_t piece = first; piece < last; piece++) {
        const Corners corners = piece_of(of.rows.pieces, piece);
        int64_t n = corners.rows();
        area::copy_polygon(corners, n, polygon);
        const auto is_met = directions.met_by(corners, plane, least, most, d);
        const auto keep = [&](const Vector &by, double offset) {
            const auto [value, x, y] = area::line_in_plane(by.x, by.y, by.z, plane);
            if (n >= 3) n = cut_by({value - offset, x, y}, polygon, n);
        };
        const auto cut_all = [&](const Cap &cap, double offset) {
            for (int k = 0; k < cap.n; k++) keep(cap.around[size_t(k)], offset);
        };
        if (!is_met[0]) cut_all(directions.axis, least);
        for (int k = 0; k < directions.axis.n && !is_met[1]; k++) {
            const Vector &axis = directions.axis.middle;
            const Vector turned = directions.axis.around[size_t(k)] - directions.cosine * axis;
            keep(-1.0 * (directions.axis.n > 1 ? axis + turned : axis), -most);
        }
        for (size_t k = 0; k < 4; k++)
            if (!is_met[k + 2]) cut_all(directions.border[k], d);
        if (n < 3) continue;
        const Points kept = {polygon.data, {n}};
        if (wanted > 0) {
            const double factor = (1 - mount.errors.focal) * density_factor(mount, plane, kept);
            if (!(factor > 0)) continue;
            criteria.rules.min_pixel_density = wanted / factor;
        }
        append_criteria(f, kept, circle, criteria, _scratch, out);
    }
}

void ToleranceCutter::cut_criteria(const Posed &of, const area::Found &out) {
    const Directions directions(of.mount);
    const Int32Array &face = of.rows.pieces.face;
    Poll poll(64);
    for (int64_t first = 0, last = 0; first < face.rows(); first = last) {
        poll();
        last = end_of_face(face, first);
        const int64_t f = face[first];
        of.set_plane(f, _scratch.plane);
        const double height = _scratch.plane.height;
        const double above = of.planes.two_sided[f] ? std::abs(height) : height;
        if (of.d() > 0 && above <= of.d()) continue;
        cut_face(f, of, directions, first, last, out);
    }
}

// Takes the shadows from pieces.
void ToleranceCutter::subtract_shadows(const Posed &of, const area::PieceTable &from,
                                       const area::Found &out, Tolerated &result) {
    result.n_shadows = result.n_unbounded = 0;
    Poll poll(16);
    for (int64_t first = 0, last = 0; first < from.face.rows(); first = last) {
        poll();
        last = end_of_face(from.face, first);
        const int64_t f = from.face[first];
        of.set_plane(f, _scratch.plane);
        const double nearest = _scratch.plane.nearest_corners();
        if (!cast(of, from, first, last, result)) continue;
        const auto append = [&](const Points &part) {
            const int64_t m = part.rows();
            if (m >= 3 && area::twice_area(part, m) > 2 * nearest * area::perimeter_of(part, m))
                area::append_piece(f, part, m, nearest, out);
        };
        for (int64_t piece = first; piece < last; piece++)
            _shapes.each_outside(piece_of(from, piece), append);
    }
}

Tolerated ToleranceCutter::sure(const Posed &nominal) {
    Tolerated result;
    if (!begin(nominal, true, result)) {
        result.regions.cut_short = {0.0};
        return result;
    }
    const int64_t n_faces = nominal.planes.areas.rows();
    Pieces *last = &_cut;
    _cut.run(n_faces, [&](const area::Found &out) { cut_criteria(nominal, out); });
    if (nominal.d() > 0 && nominal.mount.margins.shadow > 0) {
        const area::Found cut = _cut.all();
        const area::PieceTable from = {cut.xy, cut.starts, _cut.face.first(_cut.used[0])};
        last = &_left;
        last->run(n_faces,
                  [&](const area::Found &out) { subtract_shadows(nominal, from, out, result); });
        last->cut_short = _cut.cut_short;
    }
    // What is left out where nothing decides can only be missing: as of the nominal regions, the
    // bound is what may be too much.
    last->bound.fill(0.0);
    for (int64_t k = 0; k < nominal.rows.listed.rows(); k++)
        last->bound[nominal.rows.listed[k]] = nominal.rows.bound[k];
    result.regions = copy_regions(last->all());
    result.regions.excess = result.regions.bound;
    return result;
}

} // namespace rastercov::engine
