// Areas of parts of a surface, and what is covered of each: the figures by which goals are judged.
//
// Twin: tests/area/test_sums.py.
#pragma once
#include "array.hpp"
#include "sum.hpp"
#include <vector>

namespace rastercov::area {

// Areas of F faces, what at least 1 ... k cameras cover of each, and bound and excess of that.
struct CoveredFaces {
    Array<const double, Any, Any> levels;
    Array<const double, 2, Any> bounds;
    FloatArray areas;
};

// Sets a row of `out` for each part, of the faces that have its number in `part`: k areas that are
// covered, their bound, what `views` cameras may cover besides, and the area of the part.
inline void sum_parts(const CoveredFaces &of, Int32Array part, Int32Array views,
                      Array<double, Any, Any> out) {
    const auto &[levels, bounds, areas] = of;
    const int64_t k = levels.rows();
    std::vector<std::vector<int64_t>> faces(size_t(views.rows()));
    for (int64_t f = 0; f < areas.rows(); f++)
        if (part[f] >= 0) faces[size_t(part[f])].push_back(f);
    std::vector<double> own;
    for (int64_t p = 0; p < views.rows(); p++) {
        const auto sum = [&](const auto &value) {
            own.clear();
            for (const int64_t f : faces[size_t(p)]) own.push_back(value(f));
            return pairwise_sum(own.data(), int64_t(own.size()));
        };
        const auto most = [&](int64_t f, int64_t bound) {
            return std::min(levels(views[p] - 1, f) + bounds(bound, f), areas[f]);
        };
        const double whole = sum([&](int64_t f) { return areas[f]; });
        for (int64_t level = 0; level < k; level++)
            out(p, level) = std::min(sum([&](int64_t f) { return levels(level, f); }), whole);
        out(p, k) = std::min(sum([&](int64_t f) { return bounds(1, f); }), whole);
        out(p, k + 1) = sum([&](int64_t f) { return most(f, 0) - most(f, 1); });
        out(p, k + 2) = whole;
    }
}

} // namespace rastercov::area
