// Morton order of triangles, and the boxes over them; see tree.hpp.
//
// Twin: tests/mesh/test_triangle_tree.py.
#pragma once
#include "mesh/tree.hpp"

namespace rastercov::mesh {

template <class I> using Faces = Array<const I, Any, 3>;

constexpr double CELLS = 1048575.0; // 2^20 - 1: highest cell of the curve along each axis

// Moves bit i of a number below 2^21 to bit 3 i.
inline uint64_t spread_bits(uint64_t v) {
    v = (v | v << 32) & 0x001F00000000FFFF;
    v = (v | v << 16) & 0x001F0000FF0000FF;
    v = (v | v << 8) & 0x100F00F00F00F00F;
    v = (v | v << 4) & 0x10C30C30C30C30C3;
    return (v | v << 2) & 0x1249249249249249;
}

// Least and greatest coordinate of a face along an axis.
template <class I>
std::pair<double, double> extent_of(Points points, Faces<I> faces, int64_t f, int k) {
    const double p = points(faces(f, 0), k), q = points(faces(f, 1), k), r = points(faces(f, 2), k);
    return {least(p, q, r), greatest(p, q, r)};
}

template <class I> double box_centre(Points points, Faces<I> faces, int64_t f, int k) {
    const auto [low, high] = extent_of(points, faces, f, k);
    return 0.5 * (low + high);
}

template <class I> void order_keys(Points points, Faces<I> faces, Column<uint64_t> keys) {
    require(keys.rows() == faces.rows(), "keys must have one row for each face");
    require_indices(faces, points.rows(), "faces must hold rows of points");
    double low[3] = {INF, INF, INF}, high[3] = {-INF, -INF, -INF};
    for (int64_t f = 0; f < faces.rows(); f++)
        for (int k = 0; k < 3; k++) {
            const double centre = box_centre(points, faces, f, k);
            low[k] = std::min(low[k], centre);
            high[k] = std::max(high[k], centre);
        }
    const double size = std::max(std::numeric_limits<double>::min(),
                                 greatest(high[0] - low[0], high[1] - low[1], high[2] - low[2]));
    for (int64_t f = 0; f < faces.rows(); f++) {
        uint64_t key = 0;
        for (int k = 0; k < 3; k++) {
            const double cell = (box_centre(points, faces, f, k) - low[k]) / size * CELLS;
            key |= spread_bits(cell >= 0.0 && cell <= CELLS ? uint64_t(cell) : 0) << k;
        }
        keys[f] = key;
    }
}

template <class I, class B>
void grow_boxes(Points points, Faces<I> faces, double margin, Array<B, Any, 6> boxes,
                Array<B, Any, 6> nodes) {
    const int64_t leaves = nodes.rows() / 2;
    require(boxes.rows() == faces.rows(), "boxes must have one row for each face");
    require(nodes.rows() >= 2 && nodes.rows() % 2 == 0 && faces.rows() <= leaves * LEAF,
            "nodes must have two rows for each leaf, of 4 triangles");
    require_indices(faces, points.rows(), "faces must hold rows of points");
    std::fill(nodes.begin(), nodes.end(), B(INF));
    for (int64_t f = 0; f < faces.rows(); f++) {
        const int64_t leaf = leaves + f / LEAF;
        for (int k = 0; k < 3; k++) {
            const auto [low, high] = extent_of(points, faces, f, k);
            boxes(f, k) = B(low - margin);
            boxes(f, 3 + k) = B(-high - margin);
        }
        for (int k = 0; k < 6; k++) nodes(leaf, k) = std::min(nodes(leaf, k), boxes(f, k));
    }
    for (int64_t n = leaves - 1; n > 0; n--)
        for (int k = 0; k < 6; k++) nodes(n, k) = std::min(nodes(2 * n, k), nodes(2 * n + 1, k));
}

} // namespace rastercov::mesh
