// Images of faces through a lens.
//
// These are the functions of criteria.hpp for a lens that is no pinhole: the same arguments, the
// same results. The area and the field of view come from integrals along the edges.
//
// Twins: rastercov.reference.coverage for the criteria, tests/lenses/test_face_kernels.py.
#pragma once
#include "coverage/criteria.hpp"
#include "lens/polygons.hpp"

namespace rastercov::coverage {

// First of six columns of a vertex, behind those of a pinhole: the derivative of the lens, found
// when a density asks for it; NaN before.
constexpr int64_t SLOPES = 8;
template <> inline constexpr int64_t COLUMNS_OF<CurvedLens> = SLOPES + 6;

template <> struct Memory<CurvedLens> {
    lens::EdgeScratch edges;
    double polygon[lens::MOST_CORNERS][2], spare[lens::MOST_CORNERS][2],
        corners[lens::MOST_CORNERS][3], spare_corners[lens::MOST_CORNERS][3];
};

// Projects the vertices of a face that have no state yet and are in the valid region of the lens.
void finish(const uint64_t *face, double near, const CurvedLens &lens,
            VertexRows<CurvedLens> points);

// Area of the image of a face in the valid region, and of its part in the image, px^2.
struct Areas {
    double whole, inside;
};
Areas curved_areas(const Corners<double> &face, double near, const CurvedLens &lens,
                   Memory<CurvedLens> &memory);

// Field of view of a face. The state is that of its worst vertex, but not INSIDE where an edge
// leaves the image. `known` is the area in the image where that is known; negative otherwise.
FieldOfView<double> field_of_view(const Corners<double> &corners, double near,
                                  const CurvedLens &lens, Memory<CurvedLens> &memory, double known);

// Faces within the core of a lens are inside the image; all others may be cut. The area is any
// number: it is for those that ask for none.
template <class N>
INLINE FieldOfView<N> quick_field_of_view(const Corners<N> &corners, double near,
                                          const CurvedLens &lens) {
    N room = INFINITY;
    for (const auto &at : corners) {
        const N edge = N(lens.core) * (lens.is_parallel() ? N(lens.unit) : at[Z]);
        room = min(room, edge * edge - (at[X] * at[X] + at[Y] * at[Y]));
    }
    const Mask<N> is_inside = (min3(column(corners, Z)) >= N(near)) & (room > N(0.0));
    return {INSIDE, 1.0, 1.0, !is_inside};
}

// Derivative of the lens at vertex p in its valid region; six faces share a vertex.
inline CurvedSlopes slopes_at(VertexRows<CurvedLens> points, int64_t p, const CurvedLens &lens) {
    const auto row = points[p];
    if (std::isnan(row[SLOPES])) {
        const auto [ux, uy, uz, vx, vy, vz] = jacobian(lens, row[X], row[Y], row[Z]);
        const double slopes[6] = {ux, uy, uz, vx, vy, vz};
        std::copy(slopes, slopes + 6, &row[SLOPES]);
    }
    const double *found = &row[SLOPES];
    return {found[0], found[1], found[2], found[3], found[4], found[5]};
}

// Areas through a lens have bounds that hold at the border of the image, too.
inline bool may_reach_image(const Corners<double> &, double, double, const CurvedLens &,
                            bool is_edge_on) {
    return is_edge_on;
}

} // namespace rastercov::coverage
