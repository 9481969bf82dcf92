// Least depth of a surface inside a pyramid, or inside the prism of parallel rays.
//
// On each face it lies on a corner of what the pyramid cuts from it: a vertex, an edge through a
// side of the pyramid, or the face where an edge of the pyramid pierces it.
//
// Twin: tests/test_projection.py, by a linear programme.
#pragma once
#include "exact/polygon.hpp"

namespace rastercov::exact {

// Least depth of faces beyond `near` inside a pyramid, metres; `enough` where none is less.
// `rotation` and `centre` are world_from_camera; `sides` are normals in camera axes, inwards, or of
// a prism (a, b, c) with a x + b y + c >= 0.
template <class Faces>
double least_depth(Vertices vertices, const Faces &faces, Array<const double, 3, 3> rotation,
                   Array<const double, 3> centre, FloatRows<3> sides, bool is_prism, double near,
                   double enough) {
    constexpr int64_t ROOM = 16; // corners of a face cut by a near plane and the sides of a pyramid
    double corners[3 * ROOM], others[3 * ROOM];
    const Array<double, Any, 3> polygon = {corners, {ROOM, 3}}, spare = {others, {ROOM, 3}};
    const auto along = [&](int axis, int64_t vertex) {
        double total = 0.0;
        for (int k = 0; k < 3; k++) total += (vertices(vertex, k) - centre[k]) * rotation(k, axis);
        return total;
    };
    double least = enough;
    for (int64_t f = 0; f < faces.rows(); f++) {
        for (int corner = 0; corner < 3; corner++) polygon(corner, 2) = along(2, faces(f, corner));
        const double a = polygon(0, 2), b = polygon(1, 2), c = polygon(2, 2);
        if (!(std::min(std::min(a, b), c) < least && std::max(std::max(a, b), c) >= near)) continue;
        for (int corner = 0; corner < 3; corner++)
            for (int axis = 0; axis < 2; axis++)
                polygon(corner, axis) = along(axis, faces(f, corner));
        int64_t n = cut_in_space(polygon, 3, 0.0, 0.0, 1.0, near, spare);
        for (int64_t side = 0; side < sides.rows(); side++) {
            const double c = sides(side, 2);
            n = cut_in_space(polygon, n, sides(side, 0), sides(side, 1), is_prism ? 0.0 : c,
                             is_prism ? -c : 0.0, spare);
        }
        for (int64_t corner = 0; corner < n; corner++) least = std::min(least, polygon(corner, 2));
    }
    return least;
}

} // namespace rastercov::exact
