// What fails of a rig with a rule at a point, of the criteria that each of its devices fails there.
//
// Devices on one side of a face count together: k of n, those that are needed among them. The
// reason is the fewest criteria that they must meet, of as many the later ones. Where none suffice,
// it is that of the device that is missed most: the lowest that must rise for the rule to hold.
// What enough of them see fails a limit, of the angle between rays or of the deviation.
//
// Twin: tests/viewer/test_live_rules.py.
#pragma once
#include "area/uncertainty.hpp"
#include "coverage/decision.hpp"

namespace rastercov::area {

// `needs` and `stripes` mark devices, or are empty; `noise` is in radians, where the deviation has
// a limit.
struct RigRule {
    int64_t k;
    Column<const uint8_t> needs, stripes;
    double least_deg, most_deg, most_deviation;
    FloatArray noise;
};

// Its devices in one pose, (n, 4, 4) world_from_device.
struct PlacedRule {
    const RigRule &rule;
    Array<const double, Any, 4, 4> poses;

    static constexpr size_t MOST_DEVICES = 64;
    static constexpr double TINY = std::numeric_limits<double>::min();

    using Vector = smooth::Vector;

    bool is_needed(int64_t d) const { return d < rule.needs.rows() && rule.needs[d]; }
    Vector column(int64_t d, int64_t k) const {
        return {poses(d, 0, k), poses(d, 1, k), poses(d, 2, k)};
    }
    static Vector row_of(const double *rows, int64_t i) {
        return {rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]};
    }

    // Judges n points with normals by the reasons of each device there.
    void judge(int64_t n, const double *points, const double *normals, const uint8_t *reasons,
               uint8_t *reason, int32_t *device) const {
        for (int64_t i = 0; i < n; i++) {
            const Vector point = row_of(points, i), normal = row_of(normals, i);
            Devices all;
            for (int64_t d = 0; d < poses.rows(); d++) {
                all.reason[size_t(d)] = reasons[d * n + i];
                const double height = dot(column(d, 3), normal);
                all.is_front[size_t(d)] = height - dot(point, normal) >= 0;
            }
            const Failure found = failure(all, point);
            reason[i] = found.reason;
            device[i] = found.device;
        }
    }

    // Least cosine of the angle between the rays to two devices.
    double least_cosine(const Vector &point) const {
        std::array<Vector, MOST_DEVICES> rays;
        double found = 1.0;
        for (int64_t d = 0; d < poses.rows(); d++) {
            rays[size_t(d)] = minus(column(d, 3), point);
            const double size = std::max(length(rays[size_t(d)]), TINY);
            for (double &each : rays[size_t(d)]) each /= size;
            for (int64_t e = 0; e < d; e++)
                found = std::min(found, dot(rays[size_t(d)], rays[size_t(e)]));
        }
        return found;
    }

    // Standard deviation of a point in its worst direction, metres; infinite where it is not fixed.
    double deviation(const Vector &point) const {
        std::array<double, MOST_DEVICES> sizes;
        double nearest = INFINITY; // relative to it, so that nothing overflows
        for (int64_t d = 0; d < poses.rows(); d++) {
            const double away = length(minus(point, column(d, 3)));
            sizes[size_t(d)] = std::max(rule.noise[d] * away, TINY);
            nearest = std::min(nearest, sizes[size_t(d)]);
        }
        Symmetric sum = {};
        for (int64_t d = 0; d < poses.rows(); d++) {
            const bool is_stripe = d < rule.stripes.rows() && rule.stripes[d];
            Vector axis = minus(point, column(d, 3));
            if (is_stripe) axis = cross(axis, column(d, 1));
            const double size = std::max(length(axis), TINY);
            const double weight = nearest / sizes[size_t(d)] * (nearest / sizes[size_t(d)]);
            for (size_t i = 0; i < 3; i++)
                for (size_t j = 0; j < 3; j++) {
                    const double square = axis[i] / size * (axis[j] / size);
                    sum[i][j] += weight * (is_stripe ? square : double(i == j) - square);
                }
        }
        const double least = smooth::Eigen(sum).values[0];
        return nearest / std::sqrt(std::max(least, 0.0));
    }

  private:
    struct Failure {
        uint8_t reason;
        int32_t device; // that is missed most, -1 where none is
    };
    // Reason of each device, and the side of the face that it is on.
    struct Devices {
        std::array<uint8_t, MOST_DEVICES> reason;
        std::array<bool, MOST_DEVICES> is_front;
    };

    Failure failure(const Devices &devices, const Vector &point) const {
        Failure found = missed(devices, true);
        const Failure other = missed(devices, false);
        if (rank(other.reason) > rank(found.reason)) found = other;
        if (const uint8_t reason = fewest(devices); reason != coverage::NOT_OF_CAMERA)
            found.reason = reason;
        if (found.reason != coverage::COVERED) return found;
        if (has_angles() && !has_angle(least_cosine(point)))
            return {coverage::ANGLE_OUT_OF_RANGE, -1};
        const bool is_certain =
            !(rule.most_deviation > 0) || deviation(point) <= rule.most_deviation;
        return {is_certain ? coverage::COVERED : coverage::TOO_UNCERTAIN, -1};
    }

    static int64_t rank(uint8_t reason) { return coverage::nearness<double>(int64_t(reason)); }
    bool has_angles() const { return rule.least_deg > 0 || rule.most_deg < 180; }
    bool has_angle(double cosine) const {
        constexpr double RADIAN = 3.14159265358979323846 / 180;
        return (rule.most_deg >= 180 || cosine >= std::cos(rule.most_deg * RADIAN)) &&
               (!(rule.least_deg > 0) || cosine <= std::cos(rule.least_deg * RADIAN));
    }

    // From one side, of which devices on the other see the face from behind.
    Failure missed(const Devices &devices, bool from_front) const {
        std::array<uint8_t, MOST_DEVICES> own;
        int64_t more = rule.k;
        for (int64_t d = 0; d < poses.rows(); d++) {
            const uint8_t reason = devices.reason[size_t(d)];
            const bool is_seen = devices.is_front[size_t(d)] == from_front ||
                                 rank(reason) < rank(coverage::BACK_FACING);
            own[size_t(d)] = is_seen ? reason : uint8_t(coverage::BACK_FACING);
            more -= is_needed(d);
        }
        // The one at that place among those that are not needed, by falling rank.
        const auto place = [&](int64_t d) {
            int64_t before = 0;
            for (int64_t e = 0; e < poses.rows(); e++) {
                const int64_t by = rank(own[size_t(e)]) - rank(own[size_t(d)]);
                before += !is_needed(e) && (by > 0 || (by == 0 && e < d));
            }
            return before + 1;
        };
        Failure found = {coverage::COVERED, -1};
        for (int64_t d = 0; d < poses.rows() && more > 0; d++)
            if (!is_needed(d) && place(d) == more) found = {own[size_t(d)], int32_t(d)};
        for (int64_t d = 0; d < poses.rows(); d++) {
            const uint8_t reason = own[size_t(d)];
            if (is_needed(d) && (found.device < 0 || rank(reason) < rank(found.reason)))
                found = {reason, int32_t(d)};
        }
        return found;
    }

    // Reason of the fewest criteria, NOT_OF_CAMERA where none suffice.
    uint8_t fewest(const Devices &devices) const {
        for (int count = 0; count <= 5; count++)
            for (int bits = coverage::N_SETS - 1; bits >= 0; bits--)
                if (std::popcount(unsigned(bits)) == count &&
                    (holds(devices, bits, true) || holds(devices, bits, false)))
                    return coverage::REASON_OF[size_t(bits)];
        return coverage::NOT_OF_CAMERA;
    }

    // Whether enough devices on one side fail no others than these criteria.
    bool holds(const Devices &devices, int bits, bool from_front) const {
        int64_t n = 0;
        for (int64_t d = 0; d < poses.rows(); d++) {
            const uint8_t fails = coverage::FAILS_OF[devices.reason[size_t(d)]];
            const bool passes = devices.is_front[size_t(d)] == from_front && (fails & ~bits) == 0;
            if (!passes && is_needed(d)) return false;
            n += passes;
        }
        return n >= rule.k;
    }
};

} // namespace rastercov::area
