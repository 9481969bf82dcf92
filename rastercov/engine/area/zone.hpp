// Dead zones: connected parts of a surface, of convex pieces that share a part of their boundary.
//
// Pieces of one group and one reason are connected within a face, and across an edge of the mesh
// unless it is a crease. Faces that meet along a part of an edge only, as where a vertex lies on
// the edge of another face, are connected, too.
//
// Twin: tests/area/test_zones.py, by GEOS and by numpy.
#pragma once
#include "area/polygon.hpp"

namespace rastercov {
namespace area {

// Faces with their frames, (F,): `faces` are rows of vertices, the same one for all at one point;
// `scale` is the diagonal, or the distance from the origin by rounding, metres.
struct ZoneSurface {
    FloatRows<3> vertices;
    Array<const int64_t, Any, 3> faces;
    Int32Array group;
    FloatRows<3> origin, x_axis, y_axis, normal;
    FloatRows<3, 2> corners;
    FloatArray areas;
    double scale;
};

// Writes the zone of each piece, (N,), the largest first, and -1 where a zone has no more area than
// `excess` of its faces, (F,), together, m^2; and the areas of zones, of which it returns the
// number, into the first rows of `sizes`, (N,).
int64_t find_zones(const ZoneSurface &surface, const PieceTable &pieces,
                   Column<const uint32_t> reason, FloatArray areas, FloatArray excess,
                   Column<int64_t> zone, Column<double> sizes);

} // namespace area

RECORD(area::ZoneSurface, vertices, faces, group, origin, x_axis, y_axis, normal, corners, areas,
       scale);

} // namespace rastercov
