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
// Near one of the devices M is large and turns fast, and its least eigenvalue, by the others, is
// neither. So it is taken in a frame that turns with the nearest device, the lead: with its ray u,
// or its stripe, see `Frame`. There N = s^2 M, the directions y of the lead stand still, and those
// of others turn by the difference of the rays only, z = u - u_lead: for a base b and all distances
// at least m it is |z| <= b / m, |z'| <= C b / m^2 and |z''| <= 3 b / m^3.
//
// With v the eigenvector at the middle, q = v^T (N - Q) v is smooth and not below g. In the basis
// of v the matrix is (q f; f^T B), and g >= q - f^2 / (least B - q). All weights of N fall within r
// to the share c at least, so that B >= c B(0) - (1 - c) - T r, T a bound of what turns; g
// likewise. The least eigenvalue of one device, 0, has v = u, so that v x y is small for all y
// where bases are: bounds of q'' and f'' have it as a factor, see `Most`.
//
// Sources: M. Henry, J. Christian. LOSTU: Fast, Scalable, and Uncertainty-Aware Triangulation.
// 2023. F. Blais. Review of 20 Years of Range Sensor Development. 2004. S. Soudarissanane et al.
// Incidence Angle Influence on the Quality of Terrestrial Laser Scanning Points. 2009.
//
// Twins: tests/area/test_uncertainty.py.
#pragma once
#include "area/criteria.hpp"

namespace rastercov::area::smooth {

constexpr double SQRT2 = 1.4142135623730952; // rounded up
constexpr Value FAILS = {-1.0, 0.0, 0.0, 0.0};

// Eigenvalues in ascending order, and the vector of the first, by Jacobi's rotations.
struct Eigen {
    std::array<double, 3> values;
    Vector first;

    explicit Eigen(Symmetric a) {
        Symmetric v = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
        for (int sweep = 0; sweep < 12; sweep++)
            for (int p = 0; p < 2; p++)
                for (int q = p + 1; q < 3; q++) {
                    const double size = std::abs(a[p][p]) + std::abs(a[q][q]);
                    if (std::abs(a[p][q]) <= 1e-18 * size) continue;
                    const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                    const double sign = theta < 0 ? -1.0 : 1.0;
                    const double t = sign / (std::abs(theta) + std::sqrt(theta * theta + 1));
                    turn_axes(a, v, p, q, t);
                }
        std::array<int, 3> order = {0, 1, 2};
        const auto set_right = [&](int i) { // equal ones stay as they are
            if (a[order[i + 1]][order[i + 1]] < a[order[i]][order[i]])
                std::swap(order[i], order[i + 1]);
        };
        for (const int i : {0, 1, 0}) set_right(i);
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
    bool along_normal;

    // A device seen from a point within r.
    struct Seen {
        Vector u, m;                   // ray, normal of the stripe
        double d, near, rho, near_rho; // distances from the centre and from the axis, less r
        double scale, weight;          // (s / sigma)^2, and over d^2
        double along;                  // (s h / s_0)^2, 0 where no range is measured
        bool has_stripes;
        int64_t index;
    };

    bool see(int64_t i, const Vector &p, double r, Seen &out) const {
        out.u = minus(p, vector_of(devices.centre[row][i]));
        const Vector a = vector_of(devices.axis[row][i]);
        const double h = std::abs(dot(out.u, normal)), range = devices.range(row, i);
        const double sigma = devices.noise(row, i) / limit;
        out.d = length(out.u);
        out.near = out.d - r;
        out.scale = 1 / (sigma * sigma);
        out.weight = out.scale / (out.d * out.d);
        out.along = range > 0 ? h * h * (limit / range) * (limit / range) : 0.0;
        out.has_stripes = dot(a, a) > 0;
        out.index = i;
        if (!(out.near > 0)) return false;
        const double along = dot(out.u, a);
        Vector t;
        for (int k = 0; k < 3; k++) {
            t[k] = out.u[k] - along * a[k];
            out.u[k] /= out.d;
        }
        out.rho = length(t);
        out.near_rho = out.rho - r;
        if (!out.has_stripes) return true;
        if (!(out.near_rho > 0)) return false;
        out.m = cross(a, t);
        for (double &each : out.m) each /= out.rho;
        return true;
    }

    // Derivative of the normal of the stripe along e.
    Vector turn_of(const Seen &device, const Vector &e) const {
        const Vector a = vector_of(devices.axis[row][device.index]), t = cross(device.m, a);
        const double along = dot(a, e), radial = dot(t, e);
        Vector out;
        for (int k = 0; k < 3; k++) out[k] = (e[k] - along * a[k] - radial * t[k]) / device.rho;
        return cross(a, out);
    }

    // How the frame of the lead turns along the axes of the plane, and bounds of it and of its
    // derivative. With stripes it turns about their axis by 1 / rho at most, and about m by 1 / d.
    struct Frame {
        std::array<Vector, 2> spin;
        double first, second;
    };

    Frame frame_of(const Seen &lead) const {
        const double o = 1 / (lead.has_stripes ? lead.near_rho : lead.near);
        Frame found = {{}, o, (lead.has_stripes ? 2.3 : 1.0) * o * o}; // 2.3^2 > 1 + 2^2 + 1 / 2^2
        for (int along = 0; along < 2; along++) {
            const Vector &e = along == 0 ? plane.x_axis : plane.y_axis;
            Vector &spin = found.spin[along];
            spin = cross(lead.u, e);
            for (double &each : spin) each /= lead.d;
            if (!lead.has_stripes) continue;
            const Vector a = vector_of(devices.axis[row][lead.index]);
            const double about_a = dot(lead.m, e) / lead.rho, about_m = dot(lead.m, spin);
            for (int k = 0; k < 3; k++) spin[k] = about_a * a[k] + about_m * lead.m[k];
        }
        return found;
    }

    // N - Q and its derivatives along the axes of the plane, in a frame.
    struct Sum {
        Symmetric whole = {};
        std::array<Symmetric, 2> by = {};
    };

    // Adds iso + k y y^T of a device, or of none, to a sum.
    void include(const Frame &frame, double iso, double k, const Vector &y, const Seen *one,
                 Sum &out) const {
        for (int along = 0; along < 2; along++) {
            const Vector &e = along == 0 ? plane.x_axis : plane.y_axis;
            const Vector turned = cross(frame.spin[along], y);
            const double fall = one ? -2 * dot(one->u, e) / one->d : 0.0;
            Vector dy = {0.0, 0.0, 0.0};
            if (one && one->has_stripes) dy = turn_of(*one, e);
            else if (one)
                for (int l = 0; l < 3; l++) dy[l] = (e[l] - dot(y, e) * y[l]) / one->d;
            for (int l = 0; l < 3; l++) dy[l] -= turned[l];
            for (int l = 0; l < 3; l++)
                for (int m = 0; m < 3; m++) {
                    const double own = (l == m ? iso : 0.0) + k * y[l] * y[m];
                    if (along == 0) out.whole[l][m] += own;
                    out.by[along][l][m] += fall * own + k * (dy[l] * y[m] + y[l] * dy[m]);
                }
        }
    }

    using Both = std::array<double, 2>; // bounds of a first and of a second derivative

    // Bounds within r of q'', of f'', and of what turns in N'.
    struct Most {
        double bend = 0.0;
        double side = 0.0;
        double turn = 0.0;

        // Of k y y^T, k <= weight, at least 1 / fall away, or of k (1 - y y^T), for `size` of |v .
        // y| or |v x y|, `own` of its derivatives and `of_y` of those of y.
        void add(double weight, double fall, double size, Both own, Both of_y) {
            const auto [first, second] = own;
            bend += weight * (6 * size * size * fall * fall + 8 * size * first * fall +
                              2 * first * first + 2 * size * second);
            side += weight *
                    (6 * size * fall * fall + 4 * of_y[0] * fall + of_y[1] + of_y[0] * of_y[0]);
            turn += weight * of_y[0];
        }
    };

    // Adds a device, for an eigenvector v at p.
    void bound(const Frame &frame, const Seen &lead, const Seen &one, const Vector &v,
               const Vector &p, double r, Most &most) const {
        const Vector centre = vector_of(devices.centre[row][one.index]);
        const Vector at_lead = vector_of(devices.centre[row][lead.index]);
        const auto size = [&](double value, double first) {
            return std::min(1.0, std::abs(value) + first * r);
        };
        const double a = 1 / one.near, l = 1 / lead.near, o = frame.first;
        const double base = length_between(centre, at_lead), o2 = frame.second + o * o;
        const double near = from_segment(p, at_lead, centre) - r;
        double z = 2.0;
        double z1 = a + l;
        double z2 = C * (a * a + l * l);
        if (near > 0) {
            z = std::min(z, base / near);
            z1 = std::min(z1, C * base / (near * near));
            z2 = std::min(z2, 3 * base / (near * near * near));
        }
        const double weight = one.scale * a * a;
        if (!one.has_stripes) {
            const Both turn = {std::min(a + o, z1 + z * o),
                               std::min(C * a * a + 2 * o * a + o2, z2 + 2 * o * z1 + z * o2)};
            most.add(weight, a, size(sine(one.u, v), turn[0]), turn, turn);
            if (one.along > 0)
                most.add(one.along * a * a, a, size(dot(one.u, v), turn[0]), turn, turn);
            return;
        }
        // v . m is -z . m and what is of v off the ray of the lead.
        const double t = 1 / one.near_rho, t2 = C * t * t, off = SQRT2 * sine(lead.u, v);
        const Both turn = {t + o, t2 + 2 * o * t + o2};
        const Both own = {std::min(turn[0], z1 + z * t + off * turn[0]),
                          std::min(turn[1], z2 + 2 * z1 * t + z * t2 + off * turn[1])};
        if (&one == &lead) most.add(weight, a, size(dot(one.m, v), 0.0), {}, {});
        else most.add(weight, a, size(dot(one.m, v), own[0]), own, turn);
    }

    Value at(double x, double y, double r) const {
        const Vector p = plane.point(x, y);
        std::array<Seen, 64> every;
        int64_t n = 0;
        int64_t first = 0;
        double least = 1.0; // share of the weights that is left within r
        for (int64_t i = 0; i < devices.centre.extent(1); i++) {
            if (!has(set, i)) continue;
            if (!see(i, p, r, every[n])) return UNKNOWN;
            const double left = every[n].d / (every[n].d + r);
            least = std::min(least, left * left);
            if (every[n].weight > every[first].weight) first = n;
            n++;
        }
        if (n == 0) return FAILS;
        const Seen &lead = every[first];
        const Frame frame = frame_of(lead);
        Sum sum;
        for (int64_t j = 0; j < n; j++) {
            const Seen &one = every[j];
            if (one.has_stripes) include(frame, 0.0, one.weight, one.m, &one, sum);
            else
                include(frame, one.weight, one.along / (one.d * one.d) - one.weight, one.u, &one,
                        sum);
        }
        if (along_normal) include(frame, 0.0, -1.0, normal, nullptr, sum);
        else
            for (int l = 0; l < 3; l++) sum.whole[l][l] -= 1.0;
        const Eigen eigen(sum.whole);
        const Vector &v = eigen.first;
        Most most;
        for (int64_t j = 0; j < n; j++) bound(frame, lead, every[j], v, p, r, most);
        if (along_normal) {
            const Both turn = {frame.first, frame.second + frame.first * frame.first};
            most.add(1.0, 0.0, std::min(1.0, std::abs(dot(normal, v)) + turn[0] * r), turn, turn);
        }
        // Slopes of q along the axes, and lengths of those of N v across v.
        Both slope = {}, across = {};
        for (int along = 0; along < 2; along++) {
            Vector turned;
            for (int l = 0; l < 3; l++) turned[l] = dot(sum.by[along][l], v);
            slope[along] = dot(turned, v);
            for (int l = 0; l < 3; l++) turned[l] -= slope[along] * v[l];
            across[along] = length(turned);
        }
        const double value = eigen.values[0], rest = most.bend * r * r / 2;
        const double high = value + length2(slope[0], slope[1]) * r + rest;
        const double side = length2(across[0], across[1]) * r + most.side * r * r / 2;
        const double fall = 1 - least + most.turn * r;
        const double gap = least * eigen.values[1] - fall - high;
        const double doubt = rest + (gap > 0 ? side * side / gap / 2 : INFINITE);
        const double half = (high - least * value + fall) / 2;
        if (doubt <= half) return {value + rest - doubt, slope[0], slope[1], doubt};
        return std::isfinite(half) ? Value{high - half, 0.0, 0.0, half} : UNKNOWN;
    }

    // Sine of the angle between unit vectors.
    static double sine(const Vector &a, const Vector &b) { return length(cross(a, b)); }

    // Distance of a point from the segment between two others.
    static double from_segment(const Vector &p, const Vector &a, const Vector &b) {
        const Vector side = minus(b, a), to = minus(p, a);
        const double whole = dot(side, side);
        const double t = whole > 0 ? std::clamp(dot(to, side) / whole, 0.0, 1.0) : 0.0;
        return length_between(p, {a[0] + t * side[0], a[1] + t * side[1], a[2] + t * side[2]});
    }
};

struct Uncertainties {
    Devices devices;
    double limit;
    bool along_normal;
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
        return {plane, plane.normal(), devices, row, set, limit, along_normal};
    }
};

} // namespace rastercov::area::smooth
