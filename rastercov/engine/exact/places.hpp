// Places of vertices in a plane and in the image of a lens, gathered for several faces or edges.
//
// Twin: tests/exact/test_lens_measures.py.
#pragma once
#include "lens/planes.hpp"

namespace rastercov::exact {

using lens::GROUP;

// Places of GROUP vertices, column by column.
struct Places {
    double x[GROUP], y[GROUP], u[GROUP], v[GROUP];
};

// Fills in the places of vertices, four rows of four at a time.
template <class VertexOf>
INLINE void gather_places(const FloatRows<4> &places, VertexOf vertex_of, Places &out) {
    typedef double Row __attribute__((vector_size(32), aligned(8)));
    const auto row_of = [&](int64_t k) __attribute__((always_inline)) {
        return *reinterpret_cast<const Row *>(&places(vertex_of(k), 0));
    };
    const auto four = [&](int64_t k) __attribute__((always_inline)) {
        const Row a = row_of(k), b = row_of(k + 1), c = row_of(k + 2), d = row_of(k + 3);
        const Row xu = __builtin_shufflevector(a, b, 0, 4, 2, 6),
                  yv = __builtin_shufflevector(a, b, 1, 5, 3, 7),
                  more_xu = __builtin_shufflevector(c, d, 0, 4, 2, 6),
                  more_yv = __builtin_shufflevector(c, d, 1, 5, 3, 7);
        const auto put = [&](double *to, const Row &row) __attribute__((always_inline)) {
            *reinterpret_cast<Row *>(to + k) = row;
        };
        put(out.x, __builtin_shufflevector(xu, more_xu, 0, 1, 4, 5));
        put(out.y, __builtin_shufflevector(yv, more_yv, 0, 1, 4, 5));
        put(out.u, __builtin_shufflevector(xu, more_xu, 2, 3, 6, 7));
        put(out.v, __builtin_shufflevector(yv, more_yv, 2, 3, 6, 7));
    };
    four(0);
    four(4);
}

// Vector of what a function gives for each lane.
template <class V, class Each> INLINE V lanes_of(Each each) {
    return V::make(EACH(k) {
        typename V::R found;
        for (int i = 0; i < V::WIDTH; i++) found[i] = each(k * V::WIDTH + i);
        return found;
    });
}

} // namespace rastercov::exact
