// Balls of complex numbers, and the operations of formulas.hpp on them.
//
// A ball is a centre and a radius, complex numbers within the radius of the centre; an operation
// gives a ball that holds all its results. Where a ball meets a pole or a branch, the radius is
// infinite.
//
// Invariants: an infinite radius has the centre 0, so that no centre is infinite for it.
//
// Twin: tests/lenses/test_balls.py.
#pragma once
#include "lens/formulas.hpp"

namespace rastercov::lens {

struct Ball {
    double re = 0.0;
    double im = 0.0;
    double off = 0.0;
    // Bound quotients of polynomials by expansions, narrower where the denominator is small.
    bool is_near_pole = false;

    Ball() = default;
    Ball(double value, double radius = 0.0) : re(value), off(radius) {}
    Ball(double real, double imag, double radius, bool near_pole)
        : re(real), im(imag), off(radius), is_near_pole(near_pole) {}
    double size() const { return rounded::hypot(re, im); }

    friend Ball operator+(const Ball &a, const Ball &b) {
        return {a.re + b.re, a.im + b.im, a.off + b.off, a.is_near_pole || b.is_near_pole};
    }
    friend Ball operator-(const Ball &a, const Ball &b) { return a + -1.0 * b; }
    friend Ball operator*(double factor, const Ball &a) {
        if (factor == 0.0) return limit_to(0.0, 0.0, 0.0, a.off < INFINITE);
        return {a.re * factor, a.im * factor, a.off * std::abs(factor), a.is_near_pole};
    }
    friend Ball operator*(const Ball &a, double factor) { return factor * a; }
    friend Ball operator*(const Ball &a, const Ball &b) {
        const double off = a.size() * b.off + b.size() * a.off + a.off * b.off;
        return limit_to(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re, off, off < INFINITE,
                        a.is_near_pole || b.is_near_pole);
    }
    friend Ball operator/(const Ball &a, const Ball &b) { return a * b.inverse(); }

    // A ball where it is good, else one without limit.
    static Ball limit_to(double re, double im, double off, bool is_good, bool near_pole = false) {
        if (!is_good) return {0.0, 0.0, INFINITE, near_pole};
        return {re, im, off, near_pole};
    }
    Ball inverse() const {
        const double own = size();
        const Step one = Step(1.0) / Step(re, im);
        return limit_to(one.real, one.imag, off / (own * (own - off)), own > off, is_near_pole);
    }
};

namespace complex {

// The root with a real part of 0 or more.
inline Step root_of(Step z) {
    const double half = std::sqrt(0.5 * (rounded::hypot(z.real, z.imag) + std::abs(z.real)));
    if (half == 0.0) return {0.0, z.imag};
    if (z.real >= 0.0) return {half, 0.5 * z.imag / half};
    return {0.5 * std::abs(z.imag) / half, std::copysign(half, z.imag)};
}

inline Step atan_of(Step z) {
    const double x = z.real, y = z.imag, below = x * x + (y - 1.0) * (y - 1.0);
    return {0.5 * std::atan2(2.0 * x, (1.0 - y) * (1.0 + y) - x * x),
            0.25 * std::log1p(4.0 * y / below)};
}

// Theta / r of complex r^2 and real z.
inline Step angle_over_r(Step r2, double z) {
    if (rounded::hypot(r2.real, r2.imag) < 1e-8 * z * z && z > 0.0) {
        const Step t = r2 / Step(z * z);
        return (Step(1.0) - t / Step(3.0) + t * t / Step(5.0)) / Step(z);
    }
    const Step r = root_of(r2);
    return (Step(0.5 * std::numbers::pi) - atan_of(Step(z) / r)) / r;
}

// Integral of 1 / (r^2 + t^2)^2 over t > z, for real r^2 > -z^2, or > 0 where z <= 0.
inline double steepest(double r2, double z) {
    const double square = z * z;
    if (std::abs(r2) < 0.01 * square && z > 0.0) {
        const double s = r2 / square;
        const double series =
            1.0 / 3 - s * (2.0 / 5 - s * (3.0 / 7 - s * (4.0 / 9 - s * 5.0 / 11)));
        return series / (square * z);
    }
    return (angle_over_r(Step(r2), z).real - z / (r2 + square)) / (2.0 * r2);
}

} // namespace complex

inline Ball smaller(const Ball &one, const Ball &other) {
    return one.off <= other.off ? one : other;
}

inline Ball sqrt(const Ball &z) {
    // |sqrt z - sqrt c| = |z - c| / |sqrt z + sqrt c|; both roots are within 45 degrees of 1.
    const Step root = complex::root_of({z.re, z.im});
    return Ball::limit_to(root.real, root.imag, z.off / std::sqrt(z.size()), z.re > z.off,
                          z.is_near_pole);
}

inline Ball atan(const Ball &z) {
    // The derivative is 1 / ((z - i)(z + i)); the cuts are on the imaginary axis beyond i and -i.
    const double to_i = rounded::hypot(z.re, z.im - 1.0) - z.off;
    const double to_minus_i = rounded::hypot(z.re, z.im + 1.0) - z.off;
    const bool is_off_cut = std::abs(z.im) + z.off < 1.0 || std::abs(z.re) > z.off;
    const Step angle = complex::atan_of({z.re, z.im});
    return Ball::limit_to(angle.real, angle.imag, z.off / (to_i * to_minus_i),
                          to_i > 0.0 && to_minus_i > 0.0 && is_off_cut);
}

// Theta / r, the integral of 1 / (r^2 + t^2) over t > z.
inline Ball angle_over_r(const Ball &r2, const Ball &z) {
    // First along z at each r2, where the derivative is -1 / (r2 + z^2); then along r2 at the
    // centre of z, where it is the integral of -1 / (r2 + t^2)^2, whose size is largest at the
    // least real part of r2, because |r2 + t^2| is at least that and t^2.
    const double c = z.re, least = r2.re - r2.off;
    const Ball square = r2 + z * z;
    const bool is_good =
        least + (c > 0.0 ? c * c : 0.0) > 0.0 && z.im == 0.0 && square.size() > square.off;
    Ball found = Ball(0.0, INFINITE);
    if (is_good) {
        const double off = z.off / (square.size() - square.off);
        const Step angle = complex::angle_over_r({r2.re, r2.im}, c);
        found = {angle.real, angle.imag, off + r2.off * complex::steepest(least, c), false};
    }
    const Ball r = sqrt(r2);
    Ball best = smaller(found, (0.5 * std::numbers::pi - atan(z / r)) / r);
    best.is_near_pole = r2.is_near_pole;
    return best;
}

inline Ball atan2(const Ball &y, const Ball &x) {
    // Valid on the half plane x > 0 and around the y axis; a base turns the longitude to be there.
    constexpr double QUARTER = 0.5 * std::numbers::pi;
    Ball right = atan(y / x), side = (y.re >= 0.0 ? QUARTER : -QUARTER) - atan(x / y);
    right = Ball::limit_to(right.re, right.im, right.off, x.re > x.off);
    side = Ball::limit_to(side.re, side.im, side.off, std::abs(y.re) > y.off);
    return smaller(right, side);
}

// 1 + c_1 x + ... + c_n x^n by its expansion at the centre, so that no root near it is lost.
inline Ball polynomial(const double *c, int n, const Ball &x) {
    double coefficients[7] = {1.0};
    std::copy_n(c, n, coefficients + 1);
    Ball found;
    double power = 1.0;
    for (int order = 0; order <= n; order++, power *= x.off) {
        Step term(0.0);
        for (int k = n; k >= order; k--) {
            double binomial = 1.0;
            for (int i = 0; i < order; i++) binomial = binomial * (k - i) / (i + 1);
            term = Step(x.re, x.im) * term + binomial * coefficients[k];
        }
        if (order == 0) found = {term.real, term.imag, 0.0, x.is_near_pole};
        else found.off += rounded::hypot(term.real, term.imag) * power;
    }
    return found;
}

inline Ball radial_factor(const Params &p, const Ball &q) {
    if (!q.is_near_pole) return radial_factor<Ball>(p, q);
    return polynomial(&p[K1], 6, q) / polynomial(&p[D1], 3, q);
}

} // namespace rastercov::lens
