// Angle at a face between the rays to cameras: the one decision on whether two rays differ by it.
//
// For selection, networks and the objective of pose optimisation.
//
// Twins: rastercov.reference.views.
#pragma once
#include "array.hpp"
#include <algorithm>
#include <cmath>

namespace rastercov {
namespace coverage {

using Places = FloatRows<3>;

constexpr double HALF_TOLERANCE = 1e-9; // cosine; greater than the error of half an angle

// Rays from faces to cameras: eyes (K, 3) and centroids (F, 3), metres, and the largest cosine of
// two rays that differ by the angle, above 1 where any two do.
struct Rays {
    Places eyes, centroids;
    double min_cosine;

    // Product of the rays from a face to two cameras, and of their lengths.
    struct Products {
        double product, lengths;
    };
    Products products(int64_t a, int64_t b, int64_t f) const {
        const double ax = eyes(a, 0) - centroids(f, 0), bx = eyes(b, 0) - centroids(f, 0);
        const double ay = eyes(a, 1) - centroids(f, 1), by = eyes(b, 1) - centroids(f, 1);
        const double az = eyes(a, 2) - centroids(f, 2), bz = eyes(b, 2) - centroids(f, 2);
        return {ax * bx + ay * by + az * bz,
                std::sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))};
    }

    // True where the rays from a face to two cameras differ by the angle; without length none.
    bool differ(int64_t a, int64_t b, int64_t f) const {
        const auto [product, lengths] = products(a, b, f);
        return lengths > 0 && product <= min_cosine * lengths;
    }

    // True where the ray to camera c differs from that to one of the first n of some cameras.
    template <class Cameras>
    bool differs_from_any(int64_t c, const Cameras &cameras, int64_t n, int64_t f) const {
        for (int64_t i = 0; i < n; i++)
            if (differ(c, int64_t(cameras[i]), f)) return true;
        return false;
    }

    // True where the rays to two of cameras[first] ... cameras[last - 1] differ.
    template <class Cameras>
    bool any_differ(const Cameras &cameras, int64_t first, int64_t last, int64_t f) const {
        for (int64_t i = first; i < last; i++)
            for (int64_t j = i + 1; j < last; j++)
                if (differ(int64_t(cameras[i]), int64_t(cameras[j]), f)) return true;
        return false;
    }

    // Cosine of half the angle: rays nearer than that to one ray cannot differ by the angle.
    double half_angle() const {
        return std::cos(std::acos(std::min(std::max(min_cosine, -1.0), 1.0)) / 2) + HALF_TOLERANCE;
    }

    // True where the rays from a face to two cameras have a cosine above `half`.
    bool are_near(int64_t a, int64_t b, int64_t f, double half) const {
        const auto [product, lengths] = products(a, b, f);
        return product > half * lengths;
    }
};

} // namespace coverage

RECORD(coverage::Rays, eyes, centroids, min_cosine);

} // namespace rastercov
