// Vectors in space: by the names of their axes, and as arrays of three where an axis is a number.
#pragma once
#include <array>
#include <cmath>

namespace rastercov {

struct Vector {
    double x, y, z;
};
inline Vector operator+(const Vector &a, const Vector &b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Vector operator-(const Vector &a, const Vector &b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Vector operator*(double s, const Vector &a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(const Vector &a, const Vector &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vector cross(const Vector &a, const Vector &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(const Vector &a) { return std::sqrt(dot(a, a)); }

using Coordinates = std::array<double, 3>;
inline Coordinates minus(const Coordinates &a, const Coordinates &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
double dot(const auto &a, const auto &b)
    requires requires { a[0] * b[0]; }
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Coordinates cross(const Coordinates &a, const Coordinates &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double length(const Coordinates &a) { return std::sqrt(dot(a, a)); }

using Symmetric = std::array<Coordinates, 3>;
// Rotation of Jacobi: turns axes p and q of a symmetric matrix by the angle of tangent t, and with
// them the vectors in the columns of `v`.
inline void turn_axes(Symmetric &a, Symmetric &v, int p, int q, double t) {
    const double c = 1 / std::sqrt(t * t + 1), s = t * c;
    const auto turn = [&](double &one, double &other) {
        const double from = one;
        one = c * from - s * other;
        other = s * from + c * other;
    };
    for (int k = 0; k < 3; k++) turn(a[k][p], a[k][q]);
    for (int k = 0; k < 3; k++) {
        turn(a[p][k], a[q][k]);
        turn(v[k][p], v[k][q]);
    }
}

} // namespace rastercov
