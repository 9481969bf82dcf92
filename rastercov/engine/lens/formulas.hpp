// Equations of the lenses, written once for every number: doubles, lanes of them (`Lanes`) and
// numbers with a derivative (`Step`).
//
// A lens maps a ray (X, Y, Z) of the camera, x right, y down, z forward, to pixels in four steps:
//
//     base         (X, Y, Z) -> (x, y)    law of the ideal lens: pinhole, equidistant, unified, ...
//     distortion   (x, y) -> (a, b)       radial, tangential and thin-prism terms
//     tilt         (a, b) -> (a, b)       homography of a tilted sensor
//     pixels       u = fx a + skew b + cx,  v = fy b + cy
//
// A new base has its law in `image_of_base` and the inverse in `ray_of`; what else a number needs
// is an overload of sqrt, atan2 or angle_over_r.
//
// Sources: reference/lenses.py. Intervals and balls, by which images are bounded: series.hpp and
// ball.hpp. N. Shibata, F. Petrogalli. SLEEF: A Portable Vectorized Library
// of C Standard Mathematical Functions. 2020 (atan of lanes). W. Squire, G. Trapp. Using complex
// variables to estimate derivatives of real functions. 1998 (Step).
//
// Invariants: branches depend on coefficients only, never on rays; nothing allocates; the result of
// a lane depends on its ray alone.
//
// Twin: rastercov.reference.lenses.
#pragma once
#include "array.hpp"
#include "lens/rounded.hpp"
#include "number.hpp"
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace rastercov::lens {

// Names of a list, "A, B", in their order.
#define RASTERCOV_NAMES(...) #__VA_ARGS__
#define RASTERCOV_NAMES_IN(list) RASTERCOV_NAMES(list)

// Codes of the bases.
#define RASTERCOV_BASES                                                                            \
    PINHOLE, EQUIDISTANT, EQUISOLID, FOV, UNIFIED, DOUBLE_SPHERE, DIVISION, EQUIRECTANGULAR
enum Base : int64_t { RASTERCOV_BASES, N_BASES };
template <int64_t CODE> using BaseIs = std::integral_constant<int64_t, CODE>;

// Bases of points in front of the camera alone, whose sharpness depends on the depth.
template <class Code> constexpr bool is_planar(Code code) {
    return code == PINHOLE || code == FOV || code == DIVISION;
}

// Parameters of a lens: pixels; the radial numerator, 1 + K1 q + ... + K6 q^6, q = x^2 + y^2, and
// denominator, 1 + D1 q + D2 q^2 + D3 q^3; tangential terms and thin prism, with OpenCV's letters;
// the homography of the tilted sensor, whose other entries are 0; the base; LATE, 1 where
// tangential and prism terms take the radially distorted point, else 0; LIMIT, the largest radius
// of the plane of the base on which the distortion is certified to be injective; SLOPE, the border
// of the valid region, see is_valid.
#define RASTERCOV_PARAMETERS                                                                       \
    FX, FY, CX, CY, SKEW, K1, K2, K3, K4, K5, K6, D1, D2, D3, P1, P2, S1, S2, S3, S4, T00, T10,    \
        T11, T20, T21, T22, B0, B1, B2, LATE, LIMIT, SLOPE
enum { RASTERCOV_PARAMETERS, SIZE };
using Params = Array<const double, SIZE>;

constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();
constexpr double INFINITE = std::numeric_limits<double>::infinity();

template <class N> struct Point {
    N x, y;
};
template <class N> struct Pixel {
    N u, v;
};
struct Ray {
    double X, Y, Z;
};
constexpr Ray NO_RAY = {NOT_A_NUMBER, NOT_A_NUMBER, NOT_A_NUMBER};

using Lanes = Doubles; // rays that are projected together
using rastercov::sqrt;
using std::atan2;

// --- numbers with a derivative ---

constexpr double STEP = 1e-100; // its square is lost in any sum

// A complex number; with an imaginary part of STEP in an argument that of a result is STEP times
// the derivative, exact to rounding. Products and quotients are those of complex numbers, term by
// term.
struct Step {
    double real, imag;
    Step() = default;
    Step(double real_part, double imag_part = 0.0) : real(real_part), imag(imag_part) {}
    friend Step operator+(Step a, Step b) { return {a.real + b.real, a.imag + b.imag}; }
    friend Step operator-(Step a, Step b) { return {a.real - b.real, a.imag - b.imag}; }
    friend Step operator*(Step a, Step b) {
        return {a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real};
    }
    friend Step operator*(double a, Step b) { return {a * b.real, a * b.imag}; }
    friend Step operator*(Step a, double b) { return {a.real * b, a.imag * b}; }
    friend Step operator+(Step a, double b) { return {a.real + b, a.imag}; }
    friend Step operator+(double a, Step b) { return {a + b.real, b.imag}; }
    friend Step operator/(Step a, Step b) {
        if (std::abs(b.real) >= std::abs(b.imag)) {
            const double ratio = b.imag / b.real, size = b.real + b.imag * ratio;
            return {(a.real + a.imag * ratio) / size, (a.imag - a.real * ratio) / size};
        }
        const double ratio = b.real / b.imag, size = b.real * ratio + b.imag;
        return {(a.real * ratio + a.imag) / size, (a.imag * ratio - a.real) / size};
    }
};

inline Step sqrt(Step z) {
    const double root = std::sqrt(z.real);
    return {root, root > 0.0 ? 0.5 * z.imag / root : 0.0};
}

inline Step atan2(Step y, Step x) {
    const double square = x.real * x.real + y.real * y.real;
    return {std::atan2(y.real, x.real), (x.real * y.imag - y.real * x.imag) / square};
}

// --- the angle from the z axis over r, of a point at distance r = sqrt(r2) from the axis ---

inline double angle_over_r(double r2, double z) {
    const double r = std::sqrt(r2);
    if (r < 1e-4 * z) { // atan(t) / t = 1 - t^2 / 3 + t^4 / 5, t = r / z
        const double t = r2 / (z * z);
        return (1.0 - t / 3.0 + t * t / 5.0) / z;
    }
    return r > 0 ? std::atan2(r, z) / r : INFINITE;
}

inline Step angle_over_r(Step r2, Step z) {
    // With g = theta / r: dg/d(r2) = (z / n2 - g) / (2 r2), dg/dz = -1 / n2, n2 = r2 + z^2.
    const double real = std::max(r2.real, 0.0); // on the axis it is -STEP^2
    const double square = real + z.real * z.real;
    const double g = angle_over_r(real, z.real), t = real / (z.real * z.real);
    double by_r2;
    if (t < 1e-8 && z.real > 0.0) {
        const double cubed = z.real * z.real * z.real;
        by_r2 = (-1.0 / 3.0 + 0.4 * t) / cubed;
    } else {
        by_r2 = (z.real / square - g) / (2.0 * real);
    }
    return {g, by_r2 * r2.imag - z.imag / square};
}

// Coefficients of q, q^2, q^3 and q^4 in atan_over, each by powers of q^4.
constexpr double ATAN[4][5] = {
    {-0.333333333333311110369124, -0.090908995008245008229153, -0.0523674852303482457616113,
     -0.0254517624932312641616861, -0.00110611831486672482563471},
    {0.199999999996591265594148, 0.0769219538311769618355029, 0.0466667150077840625632675,
     0.016599329773529201970117, 0.000209850076645816976906797},
    {-0.14285714266771329383765, -0.0666573579361080525984562, -0.0407629191276836500001934,
     -0.00889896195887655491740809, -1.88796008463073496563746e-05},
    {0.111111105648261418443745, 0.0587666392926673580854313, 0.0337852580001353069993897,
     0.00370026744188713119232403, 0.0}};

// atan(t) / t for q = t^2 <= 1, by a polynomial of SLEEF; without a branch, also at 0. The error is
// a unit in the last place. Four chains, because the processor would wait for each step of one.
INLINE Lanes atan_over(Lanes q) {
    const Lanes r = q * q, s = r * r;
    const auto quartic = [&](const double *c) __attribute__((always_inline)) {
        return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * c[4])));
    };
    const Lanes a = quartic(ATAN[0]), b = quartic(ATAN[1]), d = quartic(ATAN[2]),
                e = quartic(ATAN[3]);
    return 1.0 + q * (a + q * b + r * (d + q * e));
}

// tan(a / 2) = tan(a) / (1 + sqrt(1 + tan(a)^2)), twice: a quarter of an angle is at most 45
// degrees. The error is a few units in the last place.
INLINE Lanes angle_over_r(Lanes r2, Lanes z) {
    Lanes c = 1.0 / (z + sqrt(r2 + z * z));
    c = c / (1.0 + sqrt(1.0 + r2 * c * c));
    return 4.0 * c * atan_over(r2 * c * c);
}

// For z = 1 in all lanes: the angle is less than 90 degrees, and halved once.
struct One {};
INLINE Lanes angle_over_r(Lanes r2, One) {
    const Lanes c = 1.0 / (1.0 + sqrt(r2 + 1.0));
    return 2.0 * c * atan_over(r2 * c * c);
}

INLINE Lanes atan2(Lanes y, Lanes x) {
    constexpr int N = AT_A_TIME<Lanes>;
    double each[N], other[N];
    y.store(each);
    x.store(other);
    for (int k = 0; k < N; k++) each[k] = std::atan2(each[k], other[k]);
    return Lanes::load(each);
}

// A sum of four terms. Lanes add the last three first, so that no sum waits for all others.
template <class N> INLINE N sum_of(N a, N one, N two, N three) { return a + one + two + three; }
template <> INLINE Lanes sum_of(Lanes a, Lanes one, Lanes two, Lanes three) {
    return a + (one + two + three);
}

// --- the equations ---

// Base of the lens: point (x, y) of its plane. Z is One for points of the plane ahead.
template <class Code, class N, class Depth>
INLINE Point<N> image_of_base(Code code, const Params &p, N X, N Y, Depth depth) {
    const auto Z = [&] {
        if constexpr (std::is_same_v<Depth, One>) return 1.0;
        else return depth;
    }();
    N g;
    if (code == EQUIDISTANT) {
        g = angle_over_r(X * X + Y * Y, depth);
    } else if (code == EQUISOLID) { // 2 sin(theta / 2)
        const N rho = sqrt(X * X + Y * Y + Z * Z);
        g = std::numbers::sqrt2 / sqrt(rho * (rho + Z));
    } else if (code == UNIFIED) {
        g = 1.0 / (p[B0] * sqrt(p[B2] * (X * X + Y * Y) + Z * Z) + p[B1] * Z);
    } else if (code == DOUBLE_SPHERE) {
        const N r2 = X * X + Y * Y;
        const N c = p[B0] * sqrt(r2 + Z * Z) + Z;
        g = 1.0 / (p[B1] * sqrt(r2 + c * c) + (1.0 - p[B1]) * c);
    } else if (code == FOV) { // atan(B0 R / Z) B1 / (B0 R)
        g = angle_over_r((X * X + Y * Y) * (p[B0] * p[B0]), depth) * p[B1];
    } else if (code == DIVISION) {
        g = 2.0 / (Z + sqrt(Z * Z - 4.0 * p[B0] * (X * X + Y * Y)));
    } else {
        g = 1.0 / Z;
    }
    return {X * g, Y * g};
}

// Ray of unit length of a point of the plane of the base, the inverse of
// `image_of_base`.
inline Ray ray_of(int64_t code, const Params &p, double x, double y) {
    constexpr double PI = std::numbers::pi;
    const double r = rounded::hypot(x, y);
    double z;
    if (code == EQUIDISTANT) {
        if (!(r <= PI)) return NO_RAY;
        const double g = r > 0.0 ? std::sin(r) / r : 1.0;
        return {x * g, y * g, std::cos(r)};
    }
    if (code == EQUISOLID) {
        const double half = 0.25 * r * r; // sin^2(theta / 2)
        const double g = std::sqrt(1.0 - half);
        return {x * g, y * g, 1.0 - 2.0 * half};
    }
    if (code == FOV) {
        if (!(r / p[B1] * p[B0] < 0.5 * PI)) return NO_RAY;
        z = r > 0.0 ? r * p[B0] / std::tan(r / p[B1] * p[B0]) : p[B1];
    } else if (code == UNIFIED) {
        const double a2 = p[B0] * p[B0], near = 1.0 - a2 * p[B2] * r * r;
        z = near / (p[B1] + std::sqrt(p[B1] * p[B1] + (a2 - p[B1] * p[B1]) * near));
    } else if (code == DOUBLE_SPHERE) {
        const double q = r * r;
        const double m = (1.0 - p[B1] * p[B1] * q) /
                         (p[B1] * std::sqrt(1.0 - (2.0 * p[B1] - 1.0) * q) + 1.0 - p[B1]);
        const double g = (m * p[B0] + std::sqrt(m * m + (1.0 - p[B0] * p[B0]) * q)) / (m * m + q);
        x = g * x;
        y = g * y;
        z = g * m - p[B0];
    } else if (code == DIVISION) {
        z = 1.0 + p[B0] * r * r;
    } else {
        z = 1.0;
    }
    const double size = std::sqrt(x * x + y * y + z * z);
    return {x / size, y / size, z / size};
}

// Radial distortion at squared radius q: distorted radius over radius.
template <class N> INLINE N radial_factor(const Params &p, N q) {
    N factor = p[K6];
    for (int k = K5; k >= K1; k--) factor = q * factor + p[k];
    factor = q * factor + 1.0;
    if (p[D1] != 0.0 || p[D2] != 0.0 || p[D3] != 0.0)
        factor = factor / (q * (q * (q * p[D3] + p[D2]) + p[D1]) + 1.0);
    return factor;
}

// True where the distortion has no tangential and no prism term.
inline bool is_radial(const Params &p) {
    return p[P1] == 0.0 && p[P2] == 0.0 && p[S1] == 0.0 && p[S2] == 0.0 && p[S3] == 0.0 &&
           p[S4] == 0.0;
}

// Radial, tangential and thin-prism distortion of a point of the plane of the base.
template <class N> INLINE Point<N> distort(const Params &p, N x, N y) {
    const N radial = radial_factor(p, x * x + y * y);
    N a = x * radial;
    N b = y * radial;
    if (!is_radial(p)) {
        if (p[LATE] != 0.0) {
            x = a;
            y = b;
        }
        const N q = x * x + y * y, xy = 2.0 * (x * y);
        a = sum_of<N>(a, p[P1] * xy, p[P2] * (q + 2.0 * (x * x)), q * (q * p[S2] + p[S1]));
        b = sum_of<N>(b, p[P1] * (q + 2.0 * (y * y)), p[P2] * xy, q * (q * p[S4] + p[S3]));
    }
    return {a, b};
}

// Tilt and pixels of a distorted point.
template <class N> INLINE Pixel<N> image_of(const Params &p, N a, N b) {
    if (p[T20] != 0.0 || p[T21] != 0.0) {
        const N w = 1.0 / (p[T20] * a + p[T21] * b + p[T22]);
        b = (p[T10] * a + p[T11] * b) * w;
        a = p[T00] * a * w;
    }
    return {p[FX] * a + p[SKEW] * b + p[CX], p[FY] * b + p[CY]};
}

// Pixel (u, v) of a ray by the equations alone, wherever it is.
template <class Code, class N, class Depth>
INLINE Pixel<N> projected(Code code, const Params &p, N X, N Y, Depth Z) {
    if constexpr (!std::is_same_v<Depth, One>)
        if (code == EQUIRECTANGULAR) { // longitude is continuous within half a turn of B0
            const N a = p[B0] + atan2(X * p[B1] - Z * p[B2], Z * p[B1] + X * p[B2]);
            const N b = atan2(Y, sqrt(X * X + Z * Z));
            return image_of<N>(p, a, b);
        }
    const auto [x, y] = image_of_base(code, p, X, Y, Z);
    const auto [a, b] = distort<N>(p, x, y);
    return image_of<N>(p, a, b);
}

} // namespace rastercov::lens
