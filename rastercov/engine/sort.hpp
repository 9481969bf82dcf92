// Sorts by an order without ties. In a module for pages it is a loop of 200 bytes; std::sort is 3
// kB for each order there.
//
// D. L. Shell. A High-Speed Sorting Procedure. 1959.
//
// Twin: tests/native/test_wasm.py.
#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

namespace rastercov {

template <class At, class Less = std::less<>>
void sort_range(At first, At last, Less is_less = {}) {
#ifdef __wasm__
    const auto n = last - first;
    auto gap = n - n + 1;
    while (gap < n / 3) gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3)
        for (auto i = gap; i < n; i++) {
            const auto value = first[i];
            auto k = i;
            for (; k >= gap && is_less(value, first[k - gap]); k -= gap) first[k] = first[k - gap];
            first[k] = value;
        }
#else
    std::sort(first, last, is_less);
#endif
}

// Rows in the order of their keys, equal ones by row.
template <class Keys> std::vector<int64_t> order_of(const Keys &keys) {
    std::vector<int64_t> order(keys.size());
    std::iota(order.begin(), order.end(), 0);
    sort_range(order.begin(), order.end(), [&](int64_t a, int64_t b) {
        return std::pair(keys[size_t(a)], a) < std::pair(keys[size_t(b)], b);
    });
    return order;
}

} // namespace rastercov
