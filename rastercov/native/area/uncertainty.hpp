// Uncertainty of a point that several devices measure: a criterion of cuts, see area/criteria.hpp.
//
// Device i at c_i, at distance d_i in the direction u_i, gives the information
//
//   rays     (I - u u^T) / (sigma d)^2                        camera; sigma in radians
//   stripes  m m^T / (sigma d)^2                              m the normal of the stripe, or sheet
//   ranges   cos(i)^2 u u^T / s_0^2 + (I - u u^T) / (sigma d)^2   i the incidence
//
// and C = (sum M_i)^-1. C <= s^2 in all directions is M >= I / s^2, and n^T C n <= s^2 along the
// normal is M >= n n^T / s^2 by Schur's complement. So g is the least eigenvalue of s^2 M - Q.
//
// With v the eigenvector at the middle, q = v^T (s^2 M - Q) v is smooth and not below g. Let E be
// the change of s^2 M within r, |E| <= e = L r, and D the gap to the next eigenvalue. In the basis
// of v the matrix is (q b; b^T B) with |b| <= f = |P (M' v)| r + K r^2 / 2, P across v, and B >= q
// + D - 2 e, so that g >= q - f^2 / (D - 2 e). Also |g - g(0)| <= e, whatever the gap.
//
// Of two devices in all directions, rays of both, or rays and stripes, g has the sign of
//
//   (1 - A) (1 - B) - T,  A = (sigma d / s)^2, B likewise, T = (u . v)^2 or 1 - (u . m)^2,
//
// where A and B are below 1, and is negative elsewhere: (trace, det) = (w + w', w w' (1 - T)). That
// needs no gap, and loses no digits where rays are nearly parallel.
//
// Sources: M. Henry, J. Christian. LOSTU: Fast, Scalable, and Uncertainty-Aware Triangulation.
// 2023. F. Blais. Review of 20 Years of Range Sensor Development. 2004. S. Soudarissanane et al.
// Incidence Angle Influence on the Quality of Terrestrial Laser Scanning Points. 2009.
//
// Twins: tests/area/test_uncertainty.py.
#pragma once
#include "area/criteria.hpp"

namespace rastercov::area {

constexpr Value FAILS = {-1.0, 0.0, 0.0, 0.0};

using Symmetric = std::array<std::array<double, 3>, 3>;

// Eigenvalues in ascending order, and the vector of the first, by Jacobi's rotations.
struct Eigen {
    std::array<double, 3> values;
    Vector first;

    explicit Eigen(Symmetric a) {
        Symmetric v = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        for (int sweep = 0; sweep < 12; sweep++)
            for (int p = 0; p < 2; p++)
                for (int q = p + 1; q < 3; q++) {
                    if (a[p][q] == 0) continue;
                    const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                    const double sign = theta < 0 ? -1.0 : 1.0;
                    const double t = sign / (std::abs(theta) + std::sqrt(theta * theta + 1));
                    const double c = 1 / std::sqrt(t * t + 1), s = t * c;
                    for (int k = 0; k < 3; k++) {
                        const double at = a[k][p], bt = a[k][q];
                        a[k][p] = c * at - s * bt, a[k][q] = s * at + c * bt;
                    }
                    for (int k = 0; k < 3; k++) {
                        const double at = a[p][k], bt = a[q][k];
                        a[p][k] = c * at - s * bt, a[q][k] = s * at + c * bt;
                        const double av = v[k][p], bv = v[k][q];
                        v[k][p] = c * av - s * bv, v[k][q] = s * av + c * bv;
                    }
                }
        int order[3] = {0, 1, 2};
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < 2 - i; k++)
                if (a[order[k]][order[k]] > a[order[k + 1]][order[k + 1]])
                    std::swap(order[k], order[k + 1]);
        for (int k = 0; k < 3; k++) {
            values[k] = a[order[k]][order[k]];
            first[k] = v[k][order[0]];
        }
    }
};

// Devices, n for each row of regions: noise in radians; axes of stripes, (0, 0, 0) for rays; range
// noise at right angles, m, 0 for none.
struct Devices {
    Array<const double, Any, Any, 3> centre, axis;
    Array<const double, Any, Any> noise, range;
};

struct Uncertainty {
    Plane plane;
    Vector normal;
    Devices devices;
    int64_t row, set;
    double limit;
    bool along_normal, is_closed;

    // A device seen from a point within r.
    struct Seen {
        Vector u, m;                   // ray, normal of the stripe
        double d, near, rho, near_rho; // distances from the centre and from the axis, less r
        double scale;                  // (s / sigma)^2
        double along;                  // (s h / s_0)^2, 0 where no range is measured
        bool has_stripes;
        int64_t index;
    };

    bool see(int64_t i, const Vector &p, double r, Seen &out) const {
        out.u = less(p, vector_of(devices.centre[row][i]));
        const Vector a = vector_of(devices.axis[row][i]);
        const double h = std::abs(dot(out.u, normal)), range = devices.range(row, i);
        const double sigma = devices.noise(row, i) / limit;
        out.d = std::sqrt(dot(out.u, out.u)), out.near = out.d - r;
        out.scale = 1 / (sigma * sigma);
        out.along = range > 0 ? h * h * (limit / range) * (limit / range) : 0.0;
        out.has_stripes = dot(a, a) > 0, out.index = i;
        if (!(out.near > 0)) return false;
        const double along = dot(out.u, a);
        Vector t;
        for (int k = 0; k < 3; k++) t[k] = out.u[k] - along * a[k], out.u[k] /= out.d;
        out.rho = std::sqrt(dot(t, t)), out.near_rho = out.rho - r;
        if (!out.has_stripes) return true;
        if (!(out.near_rho > 0)) return false;
        out.m = cross(a, t);
        for (double &each : out.m) each /= out.rho;
        return true;
    }

    static Vector cross(const Vector &a, const Vector &b) {
        return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    }

    Value at(double x, double y, double r) const {
        const Vector p = plane.point(x, y);
        int64_t chosen[2] = {0, 0}, n = 0, n_stripes = 0;
        bool has_range = false;
        for (int64_t i = 0; i < devices.centre.extent(1); i++) {
            if (!has(set, i)) continue;
            if (n < 2) chosen[n] = i;
            const Vector a = vector_of(devices.axis[row][i]);
            n_stripes += dot(a, a) > 0, has_range = has_range || devices.range(row, i) > 0, n++;
        }
        if (is_closed && !along_normal && n == 2 && n_stripes < 2 && !has_range)
            return of_two(p, r, chosen[0], chosen[1]);
        return of_all(p, r);
    }

    Value of_two(const Vector &p, double r, int64_t i, int64_t j) const {
        Seen one, two;
        if (!see(i, p, r, one) || !see(j, p, r, two)) return UNKNOWN;
        if (one.has_stripes) std::swap(one, two), std::swap(i, j);
        const double a = 1 / one.scale, b = 1 / two.scale; // A = a d^2
        if (a * one.near * one.near > 1 || b * two.near * two.near > 1) return FAILS;
        const double big_a = a * one.d * one.d, big_b = b * two.d * two.d;
        const double da = 2 * a * (one.d + r), db = 2 * b * (two.d + r); // |A'|, |B'|
        const Vector &v = two.has_stripes ? two.m : two.u;
        const double c = dot(one.u, v);
        // Of c = u . v, or u . m.
        const double across = two.has_stripes ? two.near_rho : two.near;
        const double both = 1 / one.near + 1 / across;
        double first = both, second = C * both * both;
        const double near = std::min(one.near, two.near);
        const double base =
            length_between(vector_of(devices.centre[row][i]), vector_of(devices.centre[row][j])) /
            near;
        if (!two.has_stripes) {
            first = std::min(first, 2 * base * base / near);
            second = std::min(second, (4 * base * base + 2 * C * base) / (near * near));
        }
        const double far_a = a * (one.d + r) * (one.d + r), far_b = b * (two.d + r) * (two.d + r);
        const double curvature = 2 * a * std::max(1.0, far_b - 1) +
                                 2 * b * std::max(1.0, far_a - 1) + 2 * da * db +
                                 2 * first * first + 2 * second;
        const double sign = two.has_stripes ? 1.0 : -1.0;
        const double rest = two.has_stripes ? 1 - c * c : c * c;
        const double value = (1 - big_a) * (1 - big_b) - rest;
        const auto slope_along = [&](const Vector &e) {
            const double ue = dot(one.u, e), we = dot(two.u, e);
            Vector du, dv;
            for (int k = 0; k < 3; k++) du[k] = (e[k] - ue * one.u[k]) / one.d;
            if (two.has_stripes) dv = turn_of(two, j, e);
            else
                for (int k = 0; k < 3; k++) dv[k] = (e[k] - we * two.u[k]) / two.d;
            return -2 * a * one.d * ue * (1 - big_b) - 2 * b * two.d * we * (1 - big_a) +
                   sign * 2 * c * (dot(du, v) + dot(one.u, dv));
        };
        const Value found = {value, slope_along(plane.x_axis), slope_along(plane.y_axis),
                             curvature * r * r / 2};
        if (far_a <= 1 && far_b <= 1) return found;
        // Where A or B may be 1, what is not certainly negative is halved.
        const double most = length2(found.along_x, found.along_y) * r + found.doubt;
        return value + most < 0 ? FAILS : UNKNOWN;
    }

    // Derivative of the normal of the stripe along e.
    Vector turn_of(const Seen &device, int64_t i, const Vector &e) const {
        const Vector a = vector_of(devices.axis[row][i]), t = cross(device.m, a);
        const double along = dot(a, e), radial = dot(t, e);
        Vector out;
        for (int k = 0; k < 3; k++) out[k] = (e[k] - along * a[k] - radial * t[k]) / device.rho;
        return cross(a, out);
    }

    // Bounds within r: of q'', of b'', and of the turning part of N', see `add`.
    struct Most {
        double bend = 0.0, side = 0.0, turn = 0.0;

        // Of k y y^T, k <= weight at the distance 1 / fall, or of k (1 - y y^T), where `size` is at
        // least |v . y|, or |v x y|, first and second bound its derivatives, and turn those of y.
        void add(double weight, double fall, double size, std::array<double, 2> own,
                 std::array<double, 2> of_y) {
            const auto [first, second] = own;
            bend += weight * (6 * size * size * fall * fall + 8 * size * first * fall +
                              2 * first * first + 2 * size * second);
            side += weight * (6 * size * fall * fall + 4 * of_y[0] * fall + of_y[1] +
                              of_y[0] * of_y[0]);
            turn += weight * of_y[0];
        }
    };

    Value of_all(const Vector &p, double r) const {
        std::array<Seen, 64> every;
        int64_t n = 0;
        for (int64_t i = 0; i < devices.centre.extent(1); i++)
            if (has(set, i) && !see(i, p, r, every[n++])) return UNKNOWN;
        if (n == 0) return FAILS;
        const auto nearness = [](const Seen &one) { return one.scale / (one.d * one.d); };
        const Seen &lead = *std::max_element(
            every.begin(), every.begin() + n,
            [&](const Seen &one, const Seen &two) { return nearness(one) < nearness(two); });
        // How the frame turns along the axes of the plane, and bounds of it and of its derivative.
        const std::array<const Vector *, 2> axes = {&plane.x_axis, &plane.y_axis};
        std::array<Vector, 2> spin;
        for (int along = 0; along < 2; along++) {
            spin[along] = cross(lead.u, *axes[along]);
            for (double &each : spin[along]) each /= lead.d;
            if (!lead.has_stripes) continue;
            const Vector a = vector_of(devices.axis[row][lead.index]);
            const double about = dot(lead.m, *axes[along]) / lead.rho;
            const double rise = dot(lead.m, spin[along]);
            for (int k = 0; k < 3; k++) spin[along][k] = about * a[k] + rise * lead.m[k];
        }
        const double o = 1 / (lead.has_stripes ? lead.near_rho : lead.near);
        const double o2 = (lead.has_stripes ? 2.3 : 1.0) * o * o;
        Symmetric sum = {};
        std::array<Symmetric, 2> by = {};
        // iso + k y y^T of a device, or of none.
        const auto include = [&](double iso, double k, const Vector &y, const Seen *one) {
            for (int along = 0; along < 2; along++) {
                const Vector &e = *axes[along], turned = cross(spin[along], y);
                const double fall = one ? -2 * dot(one->u, e) / one->d : 0.0;
                Vector dy = {0.0, 0.0, 0.0};
                if (one && one->has_stripes) dy = turn_of(*one, one->index, e);
                else if (one)
                    for (int l = 0; l < 3; l++) dy[l] = (e[l] - dot(y, e) * y[l]) / one->d;
                for (int l = 0; l < 3; l++) dy[l] -= turned[l];
                for (int l = 0; l < 3; l++)
                    for (int m = 0; m < 3; m++) {
                        const double own = (l == m ? iso : 0.0) + k * y[l] * y[m];
                        if (along == 0) sum[l][m] += own;
                        by[along][l][m] += fall * own + k * (dy[l] * y[m] + y[l] * dy[m]);
                    }
            }
        };
        double least = 1.0; // share of each weight that stays within r
        for (int64_t j = 0; j < n; j++) {
            const Seen &one = every[j];
            const double w = nearness(one), range = one.along / (one.d * one.d);
            if (one.has_stripes) include(0.0, w, one.m, &one);
            else include(w, range - w, one.u, &one);
            least = std::min(least, square(one.d / (one.d + r)));
        }
        if (along_normal) include(0.0, -1.0, normal, nullptr);
        else
            for (int l = 0; l < 3; l++) sum[l][l] -= 1.0;
        const Eigen eigen(sum);
        const Vector &v = eigen.first;
        Most most;
        const double off = std::sqrt(std::max(0.0, 2 - 2 * std::abs(dot(lead.u, v))));
        const Vector at_lead = vector_of(devices.centre[row][lead.index]);
        for (int64_t j = 0; j < n; j++) {
            const Seen &one = every[j];
            const Vector centre = vector_of(devices.centre[row][one.index]);
            const double a = 1 / one.near, l = 1 / lead.near;
            const double base = length_between(centre, at_lead);
            const double near = from_segment(p, at_lead, centre) - r;
            double z = 2.0, z1 = a + l, z2 = C * (a * a + l * l); // of u - that of the lead
            if (near > 0) {
                z = std::min(z, base / near), z1 = std::min(z1, C * base / (near * near));
                z2 = std::min(z2, 3 * base / (near * near * near));
            }
            const auto size = [&](double cosine, double first) {
                return std::min(1.0, std::abs(cosine) + first * r);
            };
            const double weight = one.scale * a * a;
            if (one.has_stripes) {
                if (&one == &lead) {
                    most.add(weight, a, size(dot(one.m, v), 0.0), {}, {});
                    continue;
                }
                const double t = 1 / one.near_rho, t2 = C * t * t;
                const std::array<double, 2> turn = {t + o, t2 + 2 * o * t + o2 + o * o};
                const double first = std::min(turn[0], z1 + z * t + off * turn[0]);
                const double second = std::min(turn[1], z2 + 2 * z1 * t + z * t2 + off * turn[1]);
                most.add(weight, a, size(dot(one.m, v), first), {first, second}, turn);
                continue;
            }
            const double cosine = dot(one.u, v), sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
            const std::array<double, 2> turn = {std::min(a + o, z1 + z * o),
                                                z2 + 2 * o * z1 + z * (o2 + o * o)};
            most.add(weight, a, size(sine, turn[0]), turn, turn);
            if (one.along > 0)
                most.add(one.along * a * a, a, size(cosine, turn[0]), turn, turn);
        }
        const std::array<double, 2> turn = {o, o2 + o * o};
        if (along_normal)
            most.add(1.0, 0.0, std::min(1.0, std::abs(dot(normal, v)) + o * r), turn, turn);
        const auto form = [&](const Symmetric &matrix) {
            double total = 0.0;
            for (int l = 0; l < 3; l++)
                for (int m = 0; m < 3; m++) total += v[l] * matrix[l][m] * v[m];
            return total;
        };
        // Length of the parts of both derivatives of N v that are across v.
        double across2 = 0.0;
        for (const Symmetric &matrix : by)
            for (int l = 0; l < 3; l++) {
                double across = -form(matrix) * v[l];
                for (int m = 0; m < 3; m++) across += matrix[l][m] * v[m];
                across2 += across * across;
            }
        const double value = eigen.values[0], x = form(by[0]), y = form(by[1]);
        const double rest = most.bend * r * r / 2;
        const double high = value + length2(x, y) * r + rest;
        const double side = std::sqrt(across2) * r + most.side * r * r / 2;
        const double fall = (1 - least) + most.turn * r; // N >= least N(0) - fall
        const double gap = least * eigen.values[1] - fall - high;
        const double loss = gap > 0 ? side * side / gap : INFINITE;
        const double low = least * value - fall, doubt = (high - low) / 2;
        if (rest + loss / 2 < doubt) return {value - loss / 2, x, y, rest + loss / 2};
        return std::isfinite(doubt) ? Value{(high + low) / 2, 0.0, 0.0, doubt} : UNKNOWN;
    }

    static double square(double x) { return x * x; }

    // Distance of a point from the line between two others.
    static double from_segment(const Vector &p, const Vector &a, const Vector &b) {
        const Vector side = less(b, a), to = less(p, a);
        const double whole = dot(side, side);
        const double t = whole > 0 ? std::clamp(dot(to, side) / whole, 0.0, 1.0) : 0.0;
        return length_between(p, {a[0] + t * side[0], a[1] + t * side[1], a[2] + t * side[2]});
    }
};

struct Uncertainties {
    Devices devices;
    double limit;
    bool along_normal, is_closed;
    int64_t rows() const { return devices.centre.rows(); }
    void check() const {
        const auto is_like = [&](const auto &other) {
            return other.rows() == rows() && other.extent(1) == devices.centre.extent(1);
        };
        require(is_like(devices.axis) && is_like(devices.noise) && is_like(devices.range),
                "devices must have one row for each row of regions, of as many devices");
        require(devices.centre.extent(1) <= 64, "devices must be 64 at most");
    }
    Uncertainty of(const Plane &plane, int64_t row, int64_t set) const {
        return {plane, plane.normal(), devices, row, set, limit, along_normal, is_closed};
    }
};

} // namespace rastercov::area
