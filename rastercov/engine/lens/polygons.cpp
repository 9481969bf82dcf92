// Areas of polygons of an ideal plane in the image of a lens, many at a time; see polygons.hpp.
//
// Twin: tests/lenses/test_areas.py, by polygons of many corners.
#include "lens/polygons.hpp"

namespace rastercov::lens {

// Corners of polygon i are rows starts[i] ... starts[i + 1] - 1. Without the first of three columns
// of `out` the whole area is not found.
void measure_polygons(const PlaneRecord &plane, Corners corners, IntArray starts,
                      Array<double, Any, Any> out) {
    require_plane(plane);
    const int64_t n = out.rows(), first = out.extent(1) - 2;
    require(first == 0 || first == 1, "out must have two or three columns");
    require(n == 0 || starts.rows() > n, "starts must have one row more than out");
    EdgeScratch scratch;
    for (int64_t i = 0; i < n; i++) {
        require(0 <= starts[i] && starts[i + 1] <= corners.rows(),
                "starts must be rows of corners");
        const Image image =
            polygon_image(plane, corners, starts[i], starts[i + 1], scratch, first > 0);
        out(i, 0) = image.whole;
        out(i, first) = image.inside;
        out(i, first + 1) = double(image.rules);
    }
}

void bulges_by_parts(const PlaneRecord &plane, Int32Array edges, Array<const int32_t, Any, 2> ends,
                     FloatRows<4> places, Column<double> bulge) {
    if (plane.is_graded) return;
    EdgeScratch scratch;
    double *const u = scratch.u, *const v = scratch.v;
    for (const int32_t e : edges) {
        const auto a = places[ends(e, 0)], b = places[ends(e, 1)];
        const Edge edge = {a[X], a[Y], b[X], b[Y]};
        const auto [n, parts] =
            nodes_for(0.5 * std::sqrt(length2_of(edge)), plane.longest, plane.parts_of);
        if (parts > MOST_PARTS || n * parts > MOST_NODES) continue;
        Listed listed = {0, 0, 0.0};
        for (int64_t part = 0; part < parts; part++)
            lay_part(
                part_of_edge(edge, double(part) / double(parts), double(part + 1) / double(parts)),
                n, 0.0, listed, scratch);
        lay_end(listed, {b[X], b[Y]}, scratch);
        project_lanes(plane, scratch.x, scratch.y, listed.nodes + 1, u, v);
        double total = 0.0;
        for (int64_t at = 0; at < listed.nodes; at += n)
            total += under_edge(n, u + at, v + at, a[U]);
        bulge[e] = total - 0.5 * (b[U] - a[U]) * (b[V] - a[V]);
    }
}

} // namespace rastercov::lens
