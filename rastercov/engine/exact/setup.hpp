// Boxes of the faces of a surface, block by block, and what describes a block.
//
// Faces are measured AT_A_TIME, by loops of that length that become vector instructions: the result
// of a lane depends on its face alone, so that it is the same on every processor.
//
// Twins: tests/exact/test_blocks.py.
#pragma once
#include "exact/clipping.hpp"
#include <bit>
#include <tuple>

namespace rastercov::exact {

constexpr int64_t AT_A_TIME = 8; // doubles of the longest registers

inline int lowest_bit(uint64_t bits) { return std::countr_zero(bits); }

// Positions of corner s of the AT_A_TIME faces from `first` on.
struct Lanes {
    double u[AT_A_TIME], v[AT_A_TIME];
};
inline Lanes corners_of(int64_t first, int s, const Projected &projected) {
    Lanes at;
    for (int k = 0; k < AT_A_TIME; k++) {
        const double *corner = &projected.uvw(projected.faces(first + k, s), U);
        at.u[k] = corner[U];
        at.v[k] = corner[V];
    }
    return at;
}

inline double least(double a, double b, double c) {
    const double two = a < b ? a : b;
    return two < c ? two : c;
}
inline double greatest(double a, double b, double c) {
    const double two = a > b ? a : b;
    return two > c ? two : c;
}

// Fills in the box of a face.
inline void lay_box(int64_t f, const Projected &projected) {
    const int64_t i = projected.faces(f, 0), j = projected.faces(f, 1), k = projected.faces(f, 2);
    for (int axis = U; axis <= W; axis++) {
        projected.box(f, 2 * axis) =
            least(projected.uvw(i, axis), projected.uvw(j, axis), projected.uvw(k, axis));
        projected.box(f, 2 * axis + 1) =
            greatest(projected.uvw(i, axis), projected.uvw(j, axis), projected.uvw(k, axis));
    }
}

// One past the last face of a block.
inline int64_t end_of_block(int64_t b, const Projected &projected) {
    return std::min((b + 1) * BLOCK, projected.blocks.patch.rows());
}

// Fills in the boxes of the faces of a block, the first time. None of them is clipped.
inline void lay_boxes_of_block(int64_t b, const Projected &projected) {
    if (projected.has_boxes[b]) return;
    projected.has_boxes[b] = true;
    for (int64_t f = b * BLOCK; f < end_of_block(b, projected); f++) lay_box(f, projected);
}

template <class Row> void clear_box(const Row &box) {
    box[U_MIN] = box[V_MIN] = INF;
    box[U_MAX] = box[V_MAX] = -INF;
}

// Lets a box hold a rectangle, too.
template <class Row> void widen_box(const Row &box, const Bounds &b) {
    box[U_MIN] = std::min(box[U_MIN], b.u_min);
    box[U_MAX] = std::max(box[U_MAX], b.u_max);
    box[V_MIN] = std::min(box[V_MIN], b.v_min);
    box[V_MAX] = std::max(box[V_MAX], b.v_max);
}

inline Bounds bounds_in(const Array<double, Any, 6> &box, int64_t f) {
    return {box(f, U_MIN), box(f, U_MAX), box(f, V_MIN), box(f, V_MAX)};
}

} // namespace rastercov::exact
