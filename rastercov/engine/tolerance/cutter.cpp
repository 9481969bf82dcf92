// What the steps of a pose need: event edges, their shadows on a face, and bounds of criteria.
//
// Twins: rastercov.reference.tolerance, point by point.
#include "tolerance/cutter.hpp"
#include "camera/near.hpp"
#include "mesh/triangles.hpp"
#include "solver/limits.hpp"

namespace rastercov::engine {

namespace {
constexpr double WIDEST = 1.5; // radians; a wider view may see what is beside the camera
constexpr double WIDER = 1.001;

// Angle between the nominal axis and a ray in view with some errors.
double widest_angle(const Mount &mount, double nearest) {
    const double d = mount.errors.position;
    const double turned = d > 0 ? std::asin(std::min(d / nearest, 1.0)) : 0.0;
    return std::atan(widest_of(mount.criteria.lens) / (1 - mount.errors.focal)) +
           mount.errors.angle + turned;
}

// Distance of the nearest face of a part from a point, at most `best`.
double nearest_of(const Part &part, const FacePlanes *planes, const double *eye, double best) {
    for (int64_t f = 0; f < part.faces.rows(); f++) {
        if (planes) {
            const double height = planes->height(size_t(f), {eye[0], eye[1], eye[2]});
            const Vector &n = planes->normal[size_t(f)];
            if (std::abs(height) >= best || (n.x == 0 && n.y == 0 && n.z == 0)) continue;
        }
        double corners[9], out[3];
        double apart = 0.0; // square of the distance of the box of the face
        for (int k = 0; k < 3; k++) {
            for (int c = 0; c < 3; c++) corners[3 * c + k] = part.vertices(part.faces(f, c), k);
            const auto [low, high] = std::minmax({corners[k], corners[3 + k], corners[6 + k]});
            const double gap = std::max({low - eye[k], eye[k] - high, 0.0});
            apart += gap * gap;
        }
        if (apart > best * best) continue;
        const double found = std::sqrt(mesh::nearest_on_triangle(eye, corners, out));
        if (found < best) best = found; // false for a face without area
    }
    return best;
}

exact::Bounds bounds_of(const Rectangle &box) {
    return {box.x.least, box.x.most, box.y.least, box.y.most};
}
} // namespace

DepthRange depths_of(const Mount &mount, const Rules &rules, double height, double sign) {
    const Lens &lens = mount.criteria.lens;
    const double d = mount.errors.position, scale = 1 + sign * mount.errors.focal;
    const double near = mount.near - sign * NEAR_TO_FAR * d;
    DepthRange range = {std::max(near, rules.z_n), rules.z_f};
    if (rules.min_facing_density > 0)
        range.most =
            std::min(range.most, scale * std::min(lens.fx, lens.fy) / rules.min_facing_density);
    if (rules.min_pixels_per_m2 > 0)
        range.most = std::min(range.most, std::pow(scale * scale * lens.fx * lens.fy *
                                                       std::max(height + sign * d, 0.0) /
                                                       rules.min_pixels_per_m2,
                                                   1.0 / 3));
    return range;
}

double density_factor(const Mount &mount, const Plane &plane, const Corners &polygon) {
    const Errors &errors = mount.errors;
    const Lens &lens = mount.criteria.lens;
    const double d = errors.position, height = std::abs(plane.height);
    double least = INFINITY;
    double widest = 0.0;
    for (int64_t p = 0; p < polygon.rows(); p++) {
        const Vector at = point_of(plane, polygon(p, U), polygon(p, V));
        least = std::min(least, at.z);
        widest = std::max(widest, at.z > 0 ? area::length2(at.x, at.y) / at.z : INFINITY);
    }
    if (!(height > d && least > 2 * d)) return 0.0;
    const double angle = std::atan(widest) + errors.angle + std::asin(d / least);
    if (!(angle < WIDEST)) return 0.0;
    const double x = std::tan(angle), across = area::length2(plane.normal.x, plane.normal.y);
    // Pixels that are not square turn and shear a little more.
    const double ratio = std::max(lens.fx / lens.fy, lens.fy / lens.fx);
    const double skew = (ratio - 1) / 2 * x + (ratio - 1 / ratio) / 2;
    const double steps = 1 / (least - d) + ratio * std::sqrt(1 + x * x) * across / (height - d);
    return std::exp(-mount.margins.density * ((2 * x + skew) * errors.angle + d * steps));
}

void append_criteria(int64_t f, const Points &polygon, area::Circle &circle,
                     area::Criteria criteria, area::Scratch &scratch, const area::Found &out) {
    const int64_t n = polygon.rows();
    if (criteria.rules.min_pixel_density > 0) {
        const int side = area::dense_by_corners(polygon, n, scratch.plane, criteria);
        if (side < 0) return;
        if (side > 0) criteria.rules.min_pixel_density = 0.0;
    }
    area::append_within_angle(f, polygon, n, circle, criteria, scratch, out);
    area::decide_densities(f, criteria, scratch, out);
}

bool ToleranceCutter::begin(const Posed &of, bool is_sure, Tolerated &result) {
    const Mount &mount = of.mount;
    const Surface &surface = of.surface;
    _border = border_of(mount.criteria.lens, -mount.errors.focal);
    double best = nearest_of({surface.vertices(), surface.faces(), {}, {}}, &of.face_planes,
                             mount.pose.centre, INFINITY);
    if (surface.has_targets())
        best = nearest_of(surface.targets(), nullptr, mount.pose.centre, best);
    result.nearest = best;
    const double angle = widest_angle(mount, best);
    const double widest = angle < WIDEST ? std::tan(angle) * WIDER : INFINITY;
    // Before the near plane a surface hides nothing: what is beyond it depends on the errors.
    const bool is_near = !(best > of.d() + mount.near * std::sqrt(1 + widest * widest));
    if (of.d() == 0) {
        _field.clear();
        // What is sure is in the image and, without a turn, behind the same near plane.
        result.is_left = is_near && (!is_sure || mount.errors.angle > 0);
        return !result.is_left;
    }
    result.is_left = is_near || !_field.set(of, _border, widest);
    result.n_events = _field.n_events();
    return !result.is_left;
}

bool ToleranceCutter::cast(const Posed &of, const area::PieceTable &pieces, int64_t first,
                           int64_t last, Tolerated &result) {
    const Plane &plane = _scratch.plane;
    _shadows.clear();
    Rectangle flat, image;
    double deepest = 0.0;
    std::vector<exact::Bounds> boxes;
    for (int64_t piece = first; piece < last; piece++) {
        Rectangle own;
        const Corners polygon = piece_of(pieces, piece);
        for (int64_t p = 0; p < polygon.rows(); p++) {
            const Vector at = point_of(plane, polygon(p, U), polygon(p, V));
            const double widest = _field.widest();
            deepest = std::max(deepest, at.z);
            flat.add(polygon(p, U), polygon(p, V));
            if (of.mount.disc.tangent > 0) own.add(at.x, at.y);
            else if (at.z > 0) own.add(at.x / at.z, at.y / at.z);
            else own = {{-widest, widest}, {-widest, widest}};
        }
        image.x.add(own.x);
        image.y.add(own.y);
        boxes.push_back(bounds_of(own));
    }
    const area::ShadowCaster caster = of.caster(plane, of.mount.margins.shadow * of.d(), deepest);
    bool is_bounded = true;
    _field.begin();
    const auto cast = [&](size_t k) {
        const EventField::Edge &edge = _field.edges()[k];
        if (!is_bounded) return;
        const double reach = edge.reach(deepest, of.d());
        if (!(reach > 0) || are_apart(edge.box(reach), bounds_of(image))) return;
        Cast shadow;
        const Points points = {shadow.xy, {area::MOST_SHADOW_CORNERS}};
        const area::Shadow kind = caster.cast(edge.hiding, points, shadow.n);
        is_bounded = kind != area::Shadow::UNBOUNDED;
        if (kind != area::Shadow::BOUNDED) return;
        shadow.box = exact::extent_of(points, shadow.n);
        if (are_apart(shadow.box, bounds_of(flat))) return;
        shadow.n = tidy_hull(points, shadow.n, plane.nearest_corners());
        if (shadow.n < 3) return;
        shadow.area = area::twice_area(points, shadow.n);
        _shadows.push_back(shadow);
    };
    for (const exact::Bounds &own : boxes) _field.each_in(own, cast);
    result.n_shadows += int64_t(_shadows.size());
    if (!is_bounded) result.n_unbounded++;
    std::sort(_shadows.begin(), _shadows.end(), [](const Cast &a, const Cast &b) {
        return std::tie(b.area, a.xy[0], a.xy[1]) < std::tie(a.area, b.xy[0], b.xy[1]);
    });
    _shapes.clear(plane.nearest_corners());
    for (const Cast &each : _shadows) _shapes.add({each.xy, {each.n}}, each.box);
    return is_bounded;
}

} // namespace rastercov::engine
