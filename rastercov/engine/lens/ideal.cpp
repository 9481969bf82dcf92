// Ideal planes of a lens: pinhole cameras that together see its valid region.
//
// Straight edges of a mesh are straight in an ideal plane, so visibility is computed there; the
// lens then moves the pieces to pixels.
//
// Twins: tests/lenses/test_region.py, tests/lenses/test_quadrature.py.
#include "lens/proof.hpp"

namespace rastercov::lens {
namespace {
constexpr double PI = std::numbers::pi;
// Largest angle from the axis of a lens with one plane, unless its base is a plane itself.
constexpr double ONE_PLANE_DEG = 72.0;
constexpr double MARGIN = 1.02;                       // of what an image shows, as of the region
constexpr double MOST_SIDE = 1 << 17, LONGEST = 1e12; // pixels of an image, and of a focal length
// Distance of corners of a region that are one, in units of the plane.
constexpr double SAME_CORNER = 1e-9;
// Size of the box that holes are cut to, in that of the region: sides of a hole that are not those
// of the valid cone are far from the region, so that no sliver is left between the two.
constexpr double HOLE_SCALE = 2.0;

// Rotations of the sides of a cube: front, right, left, down, up, back.
constexpr double CUBE[6][9] = {{1, 0, 0, 0, 1, 0, 0, 0, 1},  {0, 0, 1, 0, 1, 0, -1, 0, 0},
                               {0, 0, -1, 0, 1, 0, 1, 0, 0}, {1, 0, 0, 0, 0, 1, 0, -1, 0},
                               {1, 0, 0, 0, 0, -1, 0, 1, 0}, {-1, 0, 0, 0, 1, 0, 0, 0, -1}};
const Outline SQUARE = {{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}};

// Polygon of a box in flat sides around the cone of a slope, or within that around -z.
Outline on_plane(double slope, const std::array<double, 9> &frame, Outline polygon) {
    if (!(slope > 0.0)) slope *= rounded::cos(PI / SECTORS);
    for (int64_t k = 0; k < SECTORS && polygon.size() >= 3; k++) {
        const double turn = 2 * PI * (double(k) + 0.5) / SECTORS;
        const double n[] = {rounded::cos(turn), rounded::sin(turn)};
        // slope Z - n . (X, Y) >= 0, with the ray frame @ (x, y, 1)
        const auto of = [&](size_t axis) {
            return slope * frame[6 + axis] - (n[0] * frame[axis] + n[1] * frame[3 + axis]);
        };
        polygon = keep(polygon, {of(0), of(1), of(2)});
    }
    if (polygon.size() < 3) return {};
    // Corners of the cone lie on edges of the cube. What rounding makes two corners of would be an
    // edge without a direction.
    Outline apart;
    for (size_t i = 0; i < polygon.size(); i++) {
        const auto &here = polygon[i], &before = polygon[(i ? i : polygon.size()) - 1];
        if (std::max(std::abs(here.x - before.x), std::abs(here.y - before.y)) > SAME_CORNER)
            apart.push_back(here);
    }
    return apart;
}

double area_of(const Outline &polygon) {
    double area = 0.0;
    for (size_t i = 0; i < polygon.size(); i++) {
        const auto &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
        area += a.x * b.y - b.x * a.y;
    }
    return 0.5 * area;
}

// Pixels of the image to a unit of the plane, on the axis.
double central_focal(int64_t code, const Params &p) {
    const Jacobian d = jacobian(code, p, 0.0, 0.0, 1.0);
    const double focal = std::sqrt(std::abs(d.ux * d.vy - d.uy * d.vx));
    return focal < LONGEST ? focal : LONGEST;
}

Ideal one_plane(int64_t code, const Region &valid, double width, double height) {
    Ideal plane = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {}, {}, {}, code, valid.params};
    // Corners of the cone: its sides are at the distance of its slope from the axis.
    const double far = valid.params[SLOPE] / rounded::cos(PI / SECTORS);
    for (int64_t k = 0; k < SECTORS; k++) {
        const double turn = 2 * PI * double(k) / SECTORS;
        plane.region.push_back({far * rounded::cos(turn), far * rounded::sin(turn)});
    }
    auto [x, y] = box_of(plane.region);
    Rectangle seen;
    bool is_seen = true;
    for (const Ray &ray : border_rays(code, view_of(valid.params), width, height)) {
        const double at_x = ray.X / ray.Z, at_y = ray.Y / ray.Z;
        is_seen = is_seen && std::isfinite(at_x) && std::isfinite(at_y);
        seen.add(at_x, at_y);
    }
    const auto narrow = [&](Range &range, const Range &to) {
        const double more = (MARGIN - 1) * (to.most - to.least);
        if (is_seen)
            range = {std::max(range.least, to.least - more), std::min(range.most, to.most + more)};
    };
    narrow(x, seen.x);
    narrow(y, seen.y);
    const double across = x.most - x.least, down = y.most - y.least;
    const double focal = std::min(central_focal(code, view_of(valid.params)),
                                  (MOST_SIDE - 1) / std::max(across, down));
    plane.pinhole = {focal,
                     focal,
                     -focal * x.least,
                     -focal * y.least,
                     std::max(1.0, std::ceil(focal * across)),
                     std::max(1.0, std::ceil(focal * down))};
    return plane;
}

// Parameters of an equirectangular lens with longitudes around a quarter turn.
Numbers rotate(Numbers params, double sign) {
    params[B0] = sign * PI / 2;
    params[B1] = 0.0;
    params[B2] = sign;
    return params;
}

// Boxes of a side of the cube, each with parameters that are continuous on it.
//
// Longitude jumps across the half plane X = 0, Z < 0, and at the poles it has no value; the three
// sides of the cube that they meet are divided along X = 0.
std::vector<std::pair<Outline, Numbers>> parts_of(int64_t code, const Numbers &params,
                                                  const double (&frame)[9]) {
    if (code != EQUIRECTANGULAR || (frame[0] == 0.0 && frame[2] == 0.0)) return {{SQUARE, params}};
    if (frame[2] != 0.0) return {{SQUARE, rotate(params, frame[2])}};
    if (frame[8] > 0.0) return {{SQUARE, params}};
    const double sign = frame[0]; // X = sign x on this side
    return {{keep(SQUARE, {1.0, 0.0, 0.0}), rotate(params, sign)},
            {keep(SQUARE, {-1.0, 0.0, 0.0}), rotate(params, -sign)}};
}

// Greatest signed distance of a point from the sides of a convex polygon, < 0 inside.
double distance_from(const std::vector<Straight> &sides, double x, double y) {
    double least = INFINITE;
    for (const Straight &side : sides) least = std::min(least, side.value(x, y));
    return -least;
}
} // namespace

std::vector<Straight> sides_of(const Outline &polygon) {
    std::vector<Straight> sides;
    for (size_t i = 0; i < polygon.size(); i++) {
        const auto &start = polygon[i], &end = polygon[(i + 1) % polygon.size()];
        const double x = end.x - start.x, y = end.y - start.y, size = rounded::hypot(x, y);
        if (!(size > 0.0)) continue;
        const double a = -(y / size), b = x / size;
        sides.push_back({a, b, -(a * start.x + b * start.y)});
    }
    return sides;
}

Outline keep(const Outline &polygon, const Straight &line) {
    Outline kept;
    const auto value = [&](const Point<double> &at) { return line.value(at.x, at.y); };
    for (size_t i = 0; i < polygon.size(); i++) {
        const auto &here = polygon[i], &next = polygon[(i + 1) % polygon.size()];
        const double own = value(here), other = value(next);
        if (own >= 0.0) kept.push_back(here);
        if ((own < 0.0) != (other < 0.0)) {
            const double t = own / (own - other);
            kept.push_back({here.x + t * (next.x - here.x), here.y + t * (next.y - here.y)});
        }
    }
    return kept;
}

std::vector<Ideal> ideal_planes(int64_t code, const Region &valid, double width, double height) {
    if (code == PINHOLE || valid.angle <= ONE_PLANE_DEG * (PI / 180))
        return {one_plane(code, valid, width, height)};
    const double half = std::min(central_focal(code, view_of(valid.params)), MOST_SIDE / 2);
    const double side = std::max(2.0, 2 * std::ceil(half));
    std::vector<Ideal> planes;
    for (const auto &rows : CUBE)
        for (const auto &[box, own] : parts_of(code, valid.params, rows)) {
            Ideal plane = {{}, {side / 2, side / 2, side / 2, side / 2, side, side}, box, {}, code,
                           own};
            std::copy_n(rows, 9, plane.frame.begin());
            bool is_all = false;
            if (code == EQUIRECTANGULAR) {
                plane.has_pole = rows[5] != 0.0;
            } else {
                const double slope = valid.params[SLOPE];
                const Outline polygon = on_plane(slope, plane.frame, box);
                if (slope > 0.0) {
                    plane.region = polygon;
                } else if (polygon.size() >= 3) {
                    Outline around = box;
                    for (auto &[x, y] : around) x *= HOLE_SCALE, y *= HOLE_SCALE;
                    plane.hole = on_plane(slope, plane.frame, around);
                    is_all = std::abs(area_of(polygon) - area_of(box)) < 1e-12;
                }
            }
            if (plane.region.size() >= 3 && !is_all) planes.push_back(plane);
        }
    return planes;
}

std::vector<Outline> Ideal::parts() const {
    if (hole.empty()) return {region};
    std::vector<Outline> found;
    Outline rest = region;
    for (const auto &[a, b, c] : sides_of(hole)) {
        const Outline part = keep(rest, {-a, -b, -c});
        if (part.size() >= 3) found.push_back(part);
        rest = keep(rest, {a, b, c});
        if (rest.size() < 3) break;
    }
    return found;
}

bool Sides::meet(double x, double y, double half_x, double half_y) const {
    const double reach = rounded::hypot(half_x, half_y);
    return distance_from(region, x, y) <= reach &&
           (hole.empty() || distance_from(hole, x, y) >= -reach);
}

Cells Ideal::cells(double n_x, double n_y) const {
    const auto [along, down] = box_of(region);
    Cells found = {
        {}, {}, (along.most - along.least) / (2 * n_x), (down.most - down.least) / (2 * n_y)};
    const Sides around = sides();
    for (int64_t row = 0; double(row) < n_y; row++)
        for (int64_t column = 0; double(column) < n_x; column++) {
            const double x = along.least + found.half_x * double(2 * column + 1);
            const double y = down.least + found.half_y * double(2 * row + 1);
            if (!around.meet(x, y, found.half_x, found.half_y)) continue;
            found.x.push_back(x);
            found.y.push_back(y);
        }
    return found;
}

Pixel<double> Ideal::pixel(double x, double y) const {
    const Ray ray = ray_in_plane(axes(), x, y);
    return project(code, view_of(params), ray.X, ray.Y, ray.Z);
}

} // namespace rastercov::lens
