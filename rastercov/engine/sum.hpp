// Sums as numpy adds: pairwise, so that they do not depend on the level (N. Higham. The Accuracy of
// Floating Point Summation. 1993).
//
// Twin: numpy, by tests/area/test_sums.py.
#pragma once
#include <algorithm>
#include <cstdint>

namespace rastercov {

// Sum of some numbers, pairwise from 128 on.
inline double pairwise_sum(const double *a, int64_t n) {
    constexpr int64_t BLOCK = 128, UNROLLED = 8;
    if (n > BLOCK) {
        const int64_t half = n / 2 - n / 2 % UNROLLED;
        return pairwise_sum(a, half) + pairwise_sum(a + half, n - half);
    }
    double total = 0.0;
    int64_t i = 0;
    if (n >= UNROLLED) {
        double r[UNROLLED];
        std::copy(a, a + UNROLLED, r);
        for (i = UNROLLED; i + UNROLLED <= n; i += UNROLLED)
            for (int64_t k = 0; k < UNROLLED; k++) r[k] += a[i + k];
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    }
    for (; i < n; i++) total += a[i];
    return total;
}

} // namespace rastercov
