// Shadow of an edge in the plane of a face from a ball of camera centres, or from a cone of
// parallel rays, as a convex polygon.
//
// Lemma. For a convex set M and a ball B the points P = Q + s (Q - E), s >= 0, Q in M, E in B are a
// convex set: P = (1 + s) Q - s E, and the mean of two of them with weights l and m is of the same
// form with s' = l s_1 + m s_2. In a plane that all these rays meet, the shadow of an edge is so
// the hull of the shadows of its ends. That of an end Q at the distance D from the centre of a ball
// of radius d is where a cone of half angle asin(d / D) meets the plane; a pyramid round the cone
// gives a polygon round it. Of rays of directions in a cone, such as those from the disc of the
// sun, all cones are equal; a pyramid inside gives a polygon inside. Proof:
// docs/appendix/tolerance.md.
//
// T. Nishita, E. Nakamae. Half-Tone Representation of 3-D Objects Illuminated by Area Sources or
// Polyhedron Sources. 1983 (penumbrae of convex lights).
//
// Invariants: a polygon holds the shadow, to rounding; lengths are metres in camera axes, whose
// origin is the centre of the ball.
//
// Twins: rastercov.reference.tolerance, point by point.
#pragma once
#include "area/plane.hpp"
#include <array>
#include <numbers>

namespace rastercov::area {

// Sides of the pyramid round a cone of shadow, and corners of the shadow of an edge.
constexpr int GENERATORS = 12, MOST_SHADOW_CORNERS = 2 * GENERATORS;
// Relative to the least height of the eyes: an edge up to this height has a bounded shadow.
constexpr double HIGHEST_REL = 0.999;
// Half angle of the disc of parallel rays about the axis, as its tangent, 0 for a ball; whether
// shadows are inside the true ones, not round them.
struct Disc {
    double tangent = 0.0;
    bool is_within = false;
};
// Sine of the angle between a ray and the plane below which a shadow counts as unbounded.
constexpr double LEAST_FALL = 1e-6;

// Two unit vectors at right angles to a unit vector and to each other, the first also to another
// one where that has another direction.
inline std::array<Vector, 2> across(const Vector &axis, const Vector &other) {
    Vector u = cross(axis, other);
    const double size = length(u);
    if (size <= 1e-6 * length(other)) // false of what is no number, and ends
        return across(axis, std::abs(axis.x) < 0.7 ? Vector{1, 0, 0} : Vector{0, 1, 0});
    u = 1 / size * u;
    return {u, cross(axis, u)};
}

struct Turn {
    double cosine, sine;
};
// Those of N directions round an axis, from a part of their step on.
template <int N> std::array<Turn, N> around(double from) {
    std::array<Turn, N> found;
    for (int k = 0; k < N; k++) {
        const double angle = 2 * std::numbers::pi * (k + from) / N;
        found[size_t(k)] = {std::cos(angle), std::sin(angle)};
    }
    return found;
}

// An edge in camera axes; nearer than `least_depth` no part of it hides anything in view.
struct Hiding {
    Vector ends[2];
    double least_depth;
};

// What the shadow of an edge is: nothing above the plane, or nothing before the depth that is
// asked for; a polygon; or without an end.
enum class Shadow { NONE, BOUNDED, UNBOUNDED };

// The plane of a face from its side of the eyes, and the ball of radius d, or a disc.
class ShadowCaster {
  public:
    // Shadows count up to the depth `deepest`.
    ShadowCaster(const Plane &plane, double d, double deepest, double least_height,
                 const Disc &disc)
        : _plane(plane), _d(d), _deepest(deepest), _least_height(least_height), _disc(disc) {
        const bool is_back = disc.tangent > 0 ? plane.normal.z > 0 : plane.height < 0;
        _normal = (is_back ? -1.0 : 1.0) * plane.normal;
        _height = is_back ? -plane.height : plane.height;
    }

    // Height of a point over the plane, on the side of the eyes.
    double over(const Vector &at) const { return dot(_normal, at) + _height; }

    // The shadow of an edge as corners in no order, 2 GENERATORS at most; their number.
    Shadow cast(const Hiding &edge, Points out, int64_t &n) const {
        n = 0;
        Vector ends[2] = {edge.ends[0], edge.ends[1]};
        double height[2] = {over(ends[0]), over(ends[1])};
        if (std::max(height[0], height[1]) <= _least_height) return Shadow::NONE;
        // A ray from E through Q reaches the depth z_P at (1 + s) (z_Q - z_E) = z_P - z_E, and the
        // plane where height(Q) = height(E) s / (1 + s).
        const double nearest = std::max(edge.least_depth - _d, 0.0);
        const double eyes = _disc.tangent > 0 ? INFINITY : _height;
        const double most = _disc.tangent > 0 ? eyes : (eyes + _d) * (1 - nearest / _deepest);
        if (std::min(height[0], height[1]) >= most) return Shadow::NONE;
        for (int k = 0; k < 2; k++) {
            const double wanted = std::clamp(height[k], 0.0, most);
            if (wanted == height[k]) continue;
            const double t = (wanted - height[k]) / (height[1 - k] - height[k]);
            ends[k] = ends[k] + t * (ends[1 - k] - ends[k]);
            height[k] = wanted;
        }
        if (std::max(height[0], height[1]) > HIGHEST_REL * (eyes - _d)) return Shadow::UNBOUNDED;
        const Vector along = edge.ends[1] - edge.ends[0];
        for (int k = 0; k < 2; k++)
            if (!add_end(ends[k], height[k], along, out, n)) return Shadow::UNBOUNDED;
        return Shadow::BOUNDED;
    }

  private:
    const Plane &_plane;
    double _d, _deepest, _least_height, _height;
    Disc _disc;
    Vector _normal;

    // Two sides of the pyramid are along the edge: the shadow of its inside is exact.
    bool add_end(const Vector &end, double height, const Vector &along, Points out,
                 int64_t &n) const {
        static const auto ROUND_IT = around<GENERATORS>(0.5), WITHIN_IT = around<GENERATORS>(0.0);
        const auto put = [&](const Vector &at) {
            out(n, U) = dot(at, _plane.x_axis) + _plane.foot_x;
            out(n, V) = dot(at, _plane.y_axis) + _plane.foot_y;
            n++;
        };
        if (height <= _least_height) { // a point, whose sides would have no direction
            put(end);
            return true;
        }
        static const double ROUND = std::cos(std::numbers::pi / GENERATORS);
        double tangent = _disc.tangent;
        Vector axis = {0, 0, 1};
        if (!(tangent > 0)) {
            const double distance = length(end);
            if (!(distance > _d)) return false;
            tangent = _d / std::sqrt(distance * distance - _d * _d);
            axis = 1 / distance * end;
        }
        if (!_disc.is_within) tangent /= ROUND;
        const auto [u, v] = across(axis, along);
        const double fall = -dot(axis, _normal), by_u = -tangent * dot(u, _normal),
                     by_v = -tangent * dot(v, _normal);
        for (const auto &[c, s] : _disc.is_within ? WITHIN_IT : ROUND_IT) {
            const double down = fall + c * by_u + s * by_v;
            if (!(down > LEAST_FALL)) return false;
            const Vector ray = axis + tangent * (c * u + s * v);
            put(end + height / down * ray);
        }
        return true;
    }
};

// Sorts points into their convex hull, counter-clockwise, in place; the number of corners, 0 for
// none. A. Andrew. Another Efficient Algorithm for Convex Hulls in Two Dimensions. 1979.
inline int64_t make_hull(Points points, int64_t n) {
    using P = std::array<double, 2>;
    P all[MOST_SHADOW_CORNERS], hull[2 * MOST_SHADOW_CORNERS];
    for (int64_t k = 0; k < n; k++) all[k] = {points(k, U), points(k, V)};
    std::sort(all, all + n);
    int64_t m = 0;
    const auto add = [&](const P &at, int64_t first) {
        while (m - first > 1) {
            const P &a = hull[m - 2], &b = hull[m - 1];
            if ((b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0]) > 0) break;
            m--;
        }
        hull[m++] = at;
    };
    for (int64_t k = 0; k < n; k++) add(all[k], 0);
    const int64_t lower = m - 1;
    for (int64_t k = n - 2; k >= 0; k--) add(all[k], lower);
    m--; // the first point again
    if (m < 3) return 0;
    for (int64_t k = 0; k < m; k++) {
        points(k, U) = hull[k][0];
        points(k, V) = hull[k][1];
    }
    return m;
}

} // namespace rastercov::area
