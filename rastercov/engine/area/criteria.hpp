// Smooth criteria on a face: value, slope and doubt of g within r of a point; see area/cut.hpp.
//
// Symbols: p a point of the face, x = p - a device, d = |x| and u = x / d, n the normal of the
// face, h = |n . x|, which is constant on the face. Along a unit vector e of the plane: |d'| <= 1,
// |u'| <= 1 / d, |u''| <= C / d^2 with C = 2 / sqrt(3), |(d^-k)'| <= k d^-(k+1) and
// -k <= d^(k+2) (d^-k)'' <= k (k + 1). Distances in bounds are the least within r: d - r.
//
// A record of criteria, one for each row of regions, gives that of a piece: criteria.of(plane, row,
// set) with the devices of the piece as bits, criteria.rows(), and criteria.check().
//
// Twins: tests/area/test_point_criteria.py, by finite differences.
#pragma once
#include "area/cut.hpp"

namespace rastercov::area::smooth {

constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr double C = 1.1547005383792517; // 2 / sqrt(3), rounded up
constexpr Value UNKNOWN = {0.0, 0.0, 0.0, INFINITE};
constexpr Value HOLDS = {1.0, 0.0, 0.0, 0.0};

inline Vector vector_of(Array<const double, 3> row) { return {row[0], row[1], row[2]}; }
inline bool has(int64_t set, int64_t device) { return uint64_t(set) >> device & 1; }

// sign * cos(angle between the rays to two eyes) - limit.
//
// For unit vectors u, v to eyes at distances d, e: |(u . v)''| <= C (1 / d + 1 / e)^2. For eyes b
// apart, both at m or more, w = u - v: |w| <= b / m, |w'| <= |1 / d - 1 / e| + |w| / e <= 2 b /
// m^2, |w''| <= 2 C / m^2, and from u . v = 1 - w^2 / 2 it is |(u . v)''| <= 4 b^2 / m^4 + 2 C b /
// m^3: less where b is small.
struct RayAngle {
    Plane plane;
    Vector eye, other;
    double sign, limit;

    Value at(double x, double y, double r) const {
        const Vector p = plane.point(x, y);
        Vector u = minus(eye, p), v = minus(other, p);
        const double d = length(u), e = length(v);
        if (!(d > r && e > r)) return UNKNOWN;
        for (int k = 0; k < 3; k++) {
            u[k] /= d;
            v[k] /= e;
        }
        const double cosine = dot(u, v), near = 1 / (d - r) + 1 / (e - r);
        const double m = std::min(d, e) - r, b = length_between(eye, other) / m;
        Vector slope;
        for (int k = 0; k < 3; k++)
            slope[k] = -sign * ((v[k] - cosine * u[k]) / d + (u[k] - cosine * v[k]) / e);
        const double curvature = std::min(C * near * near, (4 * b * b + 2 * C * b) / (m * m));
        return {sign * cosine - limit, dot(slope, plane.x_axis), dot(slope, plane.y_axis),
                curvature * r * r / 2};
    }
};

struct RayAngles {
    FloatRows<2, 3> eyes;
    double sign, limit;
    int64_t rows() const { return eyes.rows(); }
    void check() const {}
    RayAngle of(const Plane &plane, int64_t row, int64_t) const {
        const auto eye = eyes[row];
        return {plane, vector_of(eye[0]), vector_of(eye[1]), sign, limit};
    }
};

// Least and greatest cosine of the angle to an axis within r of a point at distance d > r.
struct Cosines {
    double low, high;
    Cosines(double cosine, double d, double r) {
        constexpr double ROUNDING = 1e-12;
        const double turn = r / d, rest = std::sqrt(std::max(0.0, 1 - turn * turn));
        const double across = std::sqrt(std::max(0.0, 1 - cosine * cosine)) * turn;
        low = (cosine <= -rest ? -1.0 : cosine * rest - across) - ROUNDING;
        high = (cosine >= rest ? 1.0 : cosine * rest + across) + ROUNDING;
    }
    // Greatest sine.
    double sine() const {
        if (low <= 0 && high >= 0) return 1.0;
        return std::sqrt(std::max(0.0, 1 - std::min(low * low, high * high)));
    }
};

// Intensity of a lamp by the cosine c of the angle to its axis, relative: c^m where c > 0, 1 for m
// = 0; or a table of knots (c, value, slope before, slope after), cubic in between.
struct Intensity {
    struct Bounds { // greatest absolute values
        double value = 0.0;
        double slope = 0.0;
        double curvature = 0.0;
    };
    double exponent;
    FloatRows<4> knots; // none for c^m

    // The cubic between two knots by t, (c - c0) / w: its coefficients.
    std::array<double, 4> cubic(int64_t k) const {
        const double w = knots(k + 1, 0) - knots(k, 0);
        const double a = knots(k, 1), b = knots(k + 1, 1);
        const double at_a = w * knots(k, 3), at_b = w * knots(k + 1, 2);
        return {a, at_a, 3 * (b - a) - 2 * at_a - at_b, 2 * (a - b) + at_a + at_b};
    }

    std::array<double, 2> at(double c) const {
        if (knots.rows() < 2) {
            if (exponent == 0) return {1.0, 0.0};
            if (!(c > 0)) return {0.0, 0.0};
            return {std::pow(c, exponent), exponent * std::pow(c, exponent - 1)};
        }
        c = std::min(std::max(c, knots(0, 0)), knots(knots.rows() - 1, 0));
        int64_t k = 0;
        while (k + 2 < knots.rows() && c > knots(k + 1, 0)) k++;
        const auto f = cubic(k);
        const double w = knots(k + 1, 0) - knots(k, 0), t = (c - knots(k, 0)) / w;
        return {((f[3] * t + f[2]) * t + f[1]) * t + f[0],
                ((3 * f[3] * t + 2 * f[2]) * t + f[1]) / w};
    }

    Bounds within(double low, double high) const {
        if (knots.rows() >= 2) return of_table(low, high);
        const double m = exponent;
        if (m == 0) return {1.0, 0.0, 0.0};
        if (!(high > 0)) return {};
        low = std::max(low, 0.0);
        // The greatest of c^k is at the end of the interval.
        const auto power = [&](double k) { return std::pow(k < 0 ? low : high, k); };
        const double curvature = m == 1 ? (low > 0 ? 0.0 : INFINITE) : m * (m - 1) * power(m - 2);
        return {power(m), m * power(m - 1), curvature};
    }

  private:
    Bounds of_table(double low, double high) const {
        Bounds found;
        for (int64_t k = 0; k + 1 < knots.rows(); k++) {
            const double a = knots(k, 0), b = knots(k + 1, 0), w = b - a;
            if (b < low || a > high) continue;
            if (k > 0 && a >= low && knots(k, 2) != knots(k, 3)) found.curvature = INFINITE;
            const auto f = cubic(k);
            const double first = (std::max(low, a) - a) / w, last = (std::min(high, b) - a) / w;
            const double half = (last - first) / 2, t = (first + last) / 2;
            // By t: greatest values in the middle, and what half the interval adds.
            const double second = std::max(std::abs(2 * f[2] + 6 * f[3] * first),
                                           std::abs(2 * f[2] + 6 * f[3] * last));
            const double slope = std::abs((3 * f[3] * t + 2 * f[2]) * t + f[1]) + second * half;
            const double value = std::abs(((f[3] * t + f[2]) * t + f[1]) * t + f[0]) + slope * half;
            found.value = std::max(found.value, value);
            found.slope = std::max(found.slope, slope / w);
            found.curvature = std::max(found.curvature, second / (w * w));
        }
        return found;
    }
};

// What a criterion of light takes of the intensity f of a lamp along u: f; its gradient on the
// sphere; bounds of d^4 |(f / d^3)'|, of d^5 |(f / d^3)''|, and of the sum of the jumps of the
// gradient on the way to a point within r.
struct Emission {
    double f;
    Vector gradient;
    double first, second, jump;
};

// Intensity by two angles, radians, from a pole and around it: linear in both in each cell of a
// grid.
//
// At the angle a from the pole and the turn t the gradient on the sphere is (f_a, f_t / sin a), and
// the second derivatives there are 0, (f_at - cot a f_t) / sin a and cot a f_a. Of f along x / d,
// with G and H bounds of both, |f'| <= G / d and |f''| <= (G + H) / d^2. A line crosses a circle
// about the pole twice at most, and a half plane through the pole once, unless the cone of radius r
// about u has a pole: there the slopes alone are bounds.
struct Web {
    Array<const double, 3, 3> axes; // of turns of 0 and 90 degrees, and of the pole
    FloatArray angle, turn;
    Array<const double, Any, Any> share; // of turns, at angles

    Emission at(const Vector &u, double d, double r) const {
        const Vector x = vector_of(axes[0]), y = vector_of(axes[1]), pole = vector_of(axes[2]);
        const double along_x = dot(u, x), along_y = dot(u, y), across = length2(along_x, along_y);
        const double a = std::atan2(across, dot(u, pole));
        const double t = wrap(std::atan2(along_y, along_x));
        const int64_t i = cell(turn, t), j = cell(angle, a);
        const double p = std::clamp((t - turn[i]) / (turn[i + 1] - turn[i]), 0.0, 1.0);
        const double q = std::clamp((a - angle[j]) / (angle[j + 1] - angle[j]), 0.0, 1.0);
        Emission found = bounds(a, t, across, r / d);
        found.f = (1 - p) * ((1 - q) * share(i, j) + q * share(i, j + 1)) +
                  p * ((1 - q) * share(i + 1, j) + q * share(i + 1, j + 1));
        if (!(across > 0)) return found;
        const double f_a = (1 - p) * by_angle(i, j) + p * by_angle(i + 1, j);
        const double f_t = ((1 - q) * by_turn(i, j) + q * by_turn(i, j + 1)) / across;
        const double down = dot(u, pole), c = along_x / across, s = along_y / across;
        for (int k = 0; k < 3; k++)
            found.gradient[k] = f_a * (down * (c * x[k] + s * y[k]) - across * pole[k]) +
                                f_t * (c * y[k] - s * x[k]);
        return found;
    }

  private:
    static constexpr double HALF = 3.141592653589793;
    static constexpr double ROUNDING = 1e-12;

    struct Most {
        double value = 0.0;
        double by_angle = 0.0;
        double by_turn = 0.0; // over the sine of the angle
        double second = 0.0;
        double jump = 0.0;
    };

    static int64_t cell(const FloatArray &knots, double at) {
        const double *above = std::upper_bound(knots.begin(), knots.end(), at);
        return std::clamp<int64_t>(above - knots.begin() - 1, 0, knots.rows() - 2);
    }
    static double sine_of(double angle) { return angle < HALF ? std::sin(angle) : 0.0; }

    double wrap(double t) const {
        const double from = std::fmod(t - turn[0], 2 * HALF);
        return turn[0] + (from < 0 ? from + 2 * HALF : from);
    }
    // Slopes by one angle from a knot to the next, at a knot of the other.
    double by_angle(int64_t i, int64_t j) const {
        return (share(i, j + 1) - share(i, j)) / (angle[j + 1] - angle[j]);
    }
    double by_turn(int64_t i, int64_t j) const {
        return (share(i + 1, j) - share(i, j)) / (turn[i + 1] - turn[i]);
    }

    // Bounds within a cone about a direction by its radius, whose sine is given.
    Emission bounds(double a, double t, double across, double sine) const {
        const double radius = std::asin(std::min(sine, 1.0)) + ROUNDING;
        const double low = std::max(a - radius, 0.0), high = std::min(a + radius, HALF);
        const int64_t n = turn.rows() - 1, bottom = cell(angle, low), top = cell(angle, high);
        const bool has_pole = !(across > sine + ROUNDING);
        const double half =
            has_pole ? 2 * HALF : std::asin(std::min(sine / across, 1.0)) + ROUNDING;
        const double start = half < HALF ? wrap(t - half) : turn[0];
        int64_t i = cell(turn, start);
        double left = std::min(2 * half, 2 * HALF) + start - turn[i];
        Most most;
        for (int64_t done = 0; done <= n; done++) {
            for (int64_t j = bottom; j <= top; j++) add_cell(i, j, low, high, most);
            left -= turn[i + 1] - turn[i];
            if (left < 0) break;
            const int64_t next = i + 1 < n ? i + 1 : 0;
            double jump = 0.0;
            for (int64_t j = bottom; j <= top; j++)
                jump =
                    std::max(jump, over_sine(j, by_turn(next, j) - by_turn(i, j),
                                             by_turn(next, j + 1) - by_turn(i, j + 1), low, high));
            most.jump += jump;
            i = next;
        }
        for (int64_t j = bottom; j < top; j++) {
            double jump = 0.0;
            for (int64_t k = 0; k <= n; k++)
                jump = std::max(jump, std::abs(by_angle(k, j + 1) - by_angle(k, j)));
            most.jump += 2 * jump;
        }
        const double slope = length2(most.by_angle, most.by_turn);
        return {0.0,
                {},
                slope + 3 * most.value,
                has_pole ? INFINITE : most.second + 7 * slope + 12 * most.value,
                most.jump};
    }

    // Greatest |b + (c - b) (a - first) / step| / sin a between angles low and high of a cell.
    double over_sine(int64_t j, double b, double c, double low, double high) const {
        const double first = angle[j], last = angle[j + 1], step = last - first;
        low = std::max(low, first);
        high = std::min(high, last);
        if (b == 0 && c == 0) return 0.0;
        if (b == 0 && first <= 0) // a / sin a rises
            return std::abs(c) / step * (high > 0 ? high / sine_of(high) : 1.0);
        if (c == 0 && last >= HALF)
            return std::abs(b) / step * (low < HALF ? (HALF - low) / sine_of(low) : 1.0);
        const double least = std::min(sine_of(low), sine_of(high));
        if (!(least > 0)) return INFINITE;
        const auto at = [&](double a) { return std::abs(b + (c - b) * (a - first) / step); };
        return std::max(at(low), at(high)) / least;
    }

    void add_cell(int64_t i, int64_t j, double low, double high, Most &most) const {
        const double b = by_turn(i, j), c = by_turn(i, j + 1);
        const double twist = std::abs(c - b) / (angle[j + 1] - angle[j]);
        const double slope = std::max(std::abs(by_angle(i, j)), std::abs(by_angle(i + 1, j)));
        const double around = over_sine(j, b, c, low, high);
        const double least =
            std::min(sine_of(std::max(low, angle[j])), sine_of(std::min(high, angle[j + 1])));
        for (int64_t k = i; k <= i + 1; k++)
            most.value = std::max({most.value, share(k, j), share(k, j + 1)});
        most.by_angle = std::max(most.by_angle, slope);
        most.by_turn = std::max(most.by_turn, around);
        const double second = slope + twist + around;
        if (second > 0) most.second = std::max(most.second, least > 0 ? second / least : INFINITE);
    }
};

// Webs of lamps, w of them: angles, turns and shares of web k start at starts(k, 0), (k, 1) and
// (k, 2).
struct Webs {
    FloatArray angle, turn, share;
    Array<const int64_t, Any, 3> starts;

    Web of(int64_t k, Array<const double, 3, 3> axes) const {
        const int64_t n = starts(k + 1, 0) - starts(k, 0), m = starts(k + 1, 1) - starts(k, 1);
        return {axes,
                {angle.data + starts(k, 0), {n}},
                {turn.data + starts(k, 1), {m}},
                {share.data + starts(k, 2), {m, n}}};
    }
    void check() const {
        const int64_t w = starts.rows() - 1;
        require(w >= 0 && starts(0, 0) == 0 && starts(0, 1) == 0 && starts(0, 2) == 0 &&
                    starts(w, 0) == angle.rows() && starts(w, 1) == turn.rows() &&
                    starts(w, 2) == share.rows(),
                "starts must be of all angles, turns and shares");
        for (int64_t k = 0; k < w; k++) {
            const int64_t n = starts(k + 1, 0) - starts(k, 0), m = starts(k + 1, 1) - starts(k, 1);
            require(n >= 2 && m >= 2 && starts(k + 1, 2) - starts(k, 2) == n * m,
                    "webs must have a share for each angle and turn, two or more of both");
        }
    }
};

// Lamps, n for each row of regions, and tables of intensities: of a lamp with table t >= 0 the
// knots starts[t] ... starts[t + 1] - 1; a web >= 0 counts in place of it.
struct Lamps {
    Array<const double, Any, Any, 3> centre, axis;
    Array<const double, Any, Any> intensity, exponent;
    Array<const int64_t, Any, Any> table;
    FloatRows<4> knots;
    Starts starts;
    Array<const int64_t, Any, Any> web;
    Array<const double, Any, Any, 3, 3> frame;
    Webs webs;

    // Emission of a lamp along u, for points within r of one at distance d.
    Emission shine(int64_t row, int64_t i, const Vector &u, double d, double r) const {
        if (web(row, i) >= 0) return webs.of(web(row, i), frame[row][i]).at(u, d, r);
        const int64_t t = table(row, i), first = t < 0 ? 0 : starts[t];
        const int64_t n = t < 0 ? 0 : starts[t + 1] - first;
        const Intensity shape = {exponent(row, i), {knots.data + 4 * first, {n, 4}}};
        const Vector w = vector_of(axis[row][i]);
        const double c = dot(w, u);
        const Cosines cosines(c, d, r);
        const auto [f, f1] = shape.at(c);
        const auto most = shape.within(cosines.low, cosines.high);
        const double s = cosines.sine();
        Vector gradient;
        for (int k = 0; k < 3; k++) gradient[k] = f1 * (w[k] - c * u[k]);
        return {f, gradient, s * most.slope + 3 * most.value,
                s * s * most.curvature + (6 * s + C) * most.slope + 12 * most.value, 0.0};
    }
    void check() const {
        const auto is_like = [&](const auto &other) {
            return other.rows() == centre.rows() && other.extent(1) == centre.extent(1);
        };
        require(is_like(axis) && is_like(intensity) && is_like(exponent) && is_like(table) &&
                    is_like(web) && is_like(frame),
                "lamps must have one row for each row of regions, of as many lamps");
        require(centre.extent(1) <= 64, "lamps must be 64 at most");
        require_starts(starts, starts.rows() - 1, knots.rows(), "starts must rise, within knots");
        for (const int64_t t : table)
            require(t >= -1 && t < starts.rows() - 1, "table must be a row of tables, or -1");
        webs.check();
        for (const int64_t k : web)
            require(k >= -1 && k < webs.starts.rows() - 1, "web must be a row of webs, or -1");
    }
};

// sign * sum of f h / d^3 over the lamps of a set, less limit.
//
// With f = I(c), |c'| <= s / d for s the greatest sine, |c''| <= C / d^2: the second derivative is
// at most h d^-5 (s^2 |f''| + (6 s + C) |f'| + 12 |f|), the first h d^-4 (s |f'| + 3 |f|) =: G, and
// what is not linear at most 2 G r, too, where f has a corner.
struct Illuminance {
    Plane plane;
    Vector normal;
    Lamps lamps;
    int64_t row, set;
    double sign, limit;

    Value at(double x, double y, double r) const {
        const Vector p = plane.point(x, y);
        double value = 0.0;
        double doubt = 0.0;
        Vector slope = {0.0, 0.0, 0.0};
        for (int64_t i = 0; i < lamps.centre.extent(1); i++) {
            if (!has(set, i)) continue;
            Vector u = minus(p, vector_of(lamps.centre[row][i]));
            const double h = std::abs(dot(u, normal)) * lamps.intensity(row, i);
            if (h == 0) continue; // in its plane
            const double d = length(u);
            if (!(d > r)) return UNKNOWN;
            for (double &each : u) each /= d;
            const double near = d - r, cube = h / (d * d * d);
            const Emission light = lamps.shine(row, i, u, d, r);
            const double first = h * light.first / (near * near * near * near);
            const double curvature = h * light.second / (near * near * near * near * near);
            const double jump = h * light.jump / (near * near * near * near);
            value += cube * light.f;
            for (int k = 0; k < 3; k++)
                slope[k] += cube * (light.gradient[k] - 3 * light.f * u[k]) / d;
            doubt += std::min(2 * first * r, curvature * r * r / 2 + jump * r);
        }
        return {sign * value - limit, sign * dot(slope, plane.x_axis),
                sign * dot(slope, plane.y_axis), doubt};
    }
};

struct Illuminances {
    Lamps lamps;
    double sign, limit;
    int64_t rows() const { return lamps.centre.rows(); }
    void check() const { lamps.check(); }
    Illuminance of(const Plane &plane, int64_t row, int64_t set) const {
        return {plane, plane.normal(), lamps, row, set, sign, limit};
    }
};

// sign * (cos(delta) |s| - n . s), s = u + v for unit vectors to an eye and to a lamp: the normal
// is at least, or at most, delta off the half vector.
//
// |s'| <= 1 / d + 1 / e, |s''| <= C (1 / d^2 + 1 / e^2) and ||s|''| <= |s''| + |s'|^2 / |s|.
struct Highlight {
    Plane plane;
    Vector normal, eye, lamp;
    double sign, cosine;
    bool is_asked;

    Value at(double x, double y, double r) const {
        if (!is_asked) return HOLDS;
        const Vector p = plane.point(x, y);
        Vector u = minus(eye, p), v = minus(lamp, p);
        const double d = length(u), e = length(v);
        if (!(d > r && e > r)) return UNKNOWN;
        Vector s;
        for (int k = 0; k < 3; k++) {
            u[k] /= d;
            v[k] /= e;
            s[k] = u[k] + v[k];
        }
        const double a = 1 / (d - r), b = 1 / (e - r), size = length(s);
        const double least = size - r * (a + b);
        if (!(least > 0)) return UNKNOWN;
        const double side = dot(minus(eye, p), normal) < 0 ? -1.0 : 1.0;
        Vector w, slope;
        for (int k = 0; k < 3; k++) w[k] = cosine * s[k] / size - side * normal[k];
        const double along_u = dot(w, u), along_v = dot(w, v);
        for (int k = 0; k < 3; k++)
            slope[k] = -sign * ((w[k] - along_u * u[k]) / d + (w[k] - along_v * v[k]) / e);
        const double curvature =
            C * (a * a + b * b) * (1 + cosine) + cosine * (a + b) * (a + b) / least;
        return {sign * (cosine * size - side * dot(normal, s)), dot(slope, plane.x_axis),
                dot(slope, plane.y_axis), curvature * r * r / 2};
    }
};

// Of one lamp a row, number `device` of the sets; pieces without it are kept.
struct Highlights {
    FloatRows<3> eye, lamp;
    int64_t device;
    double sign, cosine;
    int64_t rows() const { return eye.rows(); }
    void check() const {
        require(lamp.rows() == eye.rows(), "lamp must have one row for each eye");
        require(device >= 0 && device < 64, "device must be 0 to 63");
    }
    Highlight of(const Plane &plane, int64_t row, int64_t set) const {
        return {plane, plane.normal(), vector_of(eye[row]), vector_of(lamp[row]),
                sign,  cosine,         has(set, device)};
    }
};

// scale * h / (d^2 rho) - limit, rho the distance from an axis: pixels a m^2 of a panorama about
// it, or beams of a scanner that turns by equal steps, also in elevation. Without an axis, (0, 0,
// 0), rho = d: pixels a m^2 of a lens of equal area. The derivatives of d serve for rho as well:
// |rho'| <= 1, |(1 / rho)'| <= rho^-2, |(1 / rho)''| <= 2 rho^-3.
struct Beam {
    Plane plane;
    Vector normal, centre, axis;
    double scale, limit;

    Value at(double x, double y, double r) const {
        if (limit <= 0) return HOLDS;
        const Vector u = minus(plane.point(x, y), centre);
        const double h = scale * std::abs(dot(u, normal)), along = dot(u, axis);
        Vector v;
        for (int k = 0; k < 3; k++) v[k] = u[k] - along * axis[k];
        const double d = length(u), rho = length(v);
        if (!(rho > r)) {
            const double most = d + r;
            return h >= limit * most * most * (rho + r) && h > 0 ? HOLDS : UNKNOWN;
        }
        const double value = h / (d * d * rho), a = 1 / (d - r), b = 1 / (rho - r);
        Vector slope;
        for (int k = 0; k < 3; k++) slope[k] = -value * (2 * u[k] / (d * d) + v[k] / (rho * rho));
        const double curvature = h * a * a * b * (6 * a * a + 4 * a * b + 2 * b * b);
        return {value - limit, dot(slope, plane.x_axis), dot(slope, plane.y_axis),
                curvature * r * r / 2};
    }
};

struct Beams {
    FloatRows<3> centre, axis;
    FloatArray scale, limit;
    int64_t rows() const { return centre.rows(); }
    void check() const {
        require(have_rows(rows(), axis, scale, limit),
                "axis, scale and limit must have one row for each centre");
    }
    Beam of(const Plane &plane, int64_t row, int64_t) const {
        return {plane,      plane.normal(), vector_of(centre[row]), vector_of(axis[row]),
                scale[row], limit[row]};
    }
};

} // namespace rastercov::area::smooth
