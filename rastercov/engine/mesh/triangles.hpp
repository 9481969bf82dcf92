// Two triangles, or a point and one: the axes that part them, and nearest points.
//
// Two triangles are apart if their projections on some axis are: the axes tried are the normals,
// the products of edges, and those across the edges in the planes of both. The nearest point of a
// triangle is found by its regions of Voronoi.
//
// S. Gottschalk, M. C. Lin, D. Manocha. OBBTree: A Hierarchical Structure for Rapid Interference
// Detection. 1996, for separating axes. C. Ericson. Real-Time Collision Detection. 2004, sections
// 5.1.5 and 5.1.9, for nearest points.
//
// Twin: tests/mesh/test_contacts.py compares all pairs.
#pragma once
#include "mesh/tree.hpp"

namespace rastercov::mesh {

constexpr double LEAST_AXIS_SQUARED = 1e-200; // length of an axis that is tried

inline Vector vector_of(const double *p) { return {p[0], p[1], p[2]}; }

struct Interval {
    double low, high;
};

struct Triangle {
    Vector corner[3];

    Interval along(Vector axis) const {
        const double a = dot(corner[0], axis), b = dot(corner[1], axis), c = dot(corner[2], axis);
        return {least(a, b, c), greatest(a, b, c)};
    }
    Vector edge(int k) const { return corner[k < 2 ? k + 1 : 0] - corner[k]; }
};

inline Vector normal_of(const Triangle &t) {
    return cross(t.corner[1] - t.corner[0], t.corner[2] - t.corner[0]);
}
// Of nine numbers.
inline Triangle triangle_of(const double *p) {
    return {{vector_of(p), vector_of(p + 3), vector_of(p + 6)}};
}

// True if two triangles are more than `reach` away from each other along an axis.
inline bool is_gap(const Triangle &one, const Triangle &other, Vector axis, double reach) {
    const double length = dot(axis, axis);
    if (!(length > LEAST_AXIS_SQUARED)) return false;
    const Interval a = one.along(axis), b = other.along(axis);
    return std::max(b.low - a.high, a.low - b.high) > reach * std::sqrt(length);
}

// True if a separating axis proves that two triangles are more than `reach` apart. True is correct
// for any axis, whatever its rounding. False may be wrong where the nearest points are two corners:
// the axes tried underestimate that distance. A segment is a triangle that repeats a corner.
inline bool are_apart(const Triangle &one, const Triangle &other, double reach) {
    const auto &a = one.corner, &b = other.corner;
    // Between the centroids: not a necessary axis, but the best first guess.
    if (is_gap(one, other, (b[0] + b[1] + b[2]) - (a[0] + a[1] + a[2]), reach)) return true;
    const Vector edges[6] = {one.edge(0),   one.edge(1),   one.edge(2),
                             other.edge(0), other.edge(1), other.edge(2)};
    for (int64_t side = 0; side < 2; side++) {
        const Vector normal = cross(edges[3 * side], edges[3 * side + 1]);
        if (is_gap(one, other, normal, reach)) return true;
        for (const Vector &edge : edges) // in the plane of one triangle, across the edges of both
            if (is_gap(one, other, cross(normal, edge), reach)) return true;
    }
    for (int i = 0; i < 3; i++)
        for (int j = 3; j < 6; j++)
            if (is_gap(one, other, cross(edges[i], edges[j]), reach)) return true;
    return false;
}

// Squared distance of a point from a triangle with an area, nine numbers; `out` is its nearest
// point.
inline double nearest_on_triangle(const double *p, const double *a, double *out) {
    const double *b = a + 3, *c = a + 6;
    double ab[3], ac[3], bc[3], ap[3], bp[3], cp[3], gap[3];
    for (int k = 0; k < 3; k++) {
        ab[k] = b[k] - a[k];
        ac[k] = c[k] - a[k];
        bc[k] = c[k] - b[k];
        ap[k] = p[k] - a[k];
        bp[k] = p[k] - b[k];
        cp[k] = p[k] - c[k];
    }
    const double d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp);
    const double d4 = dot(ac, bp), d5 = dot(ab, cp), d6 = dot(ac, cp);
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    const auto put = [&](const double *from, double s, const double *along) {
        for (int k = 0; k < 3; k++) out[k] = from[k] + s * along[k];
    };
    if (d1 <= 0.0 && d2 <= 0.0) std::copy_n(a, 3, out);
    else if (d3 >= 0.0 && d4 <= d3) std::copy_n(b, 3, out);
    else if (d6 >= 0.0 && d5 <= d6) std::copy_n(c, 3, out);
    else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) put(a, d1 / (d1 - d3), ab);
    else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) put(a, d2 / (d2 - d6), ac);
    else if (va <= 0.0 && d4 >= d3 && d5 >= d6) put(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), bc);
    else {
        const double total = va + vb + vc;
        for (int k = 0; k < 3; k++) out[k] = a[k] + vb / total * ab[k] + vc / total * ac[k];
    }
    for (int k = 0; k < 3; k++) gap[k] = p[k] - out[k];
    return dot(gap, gap);
}

} // namespace rastercov::mesh
