// Parts of the integrals along edges, for tests and for the bounds of their errors; see edges.hpp.
//
// Twin: tests/lenses/test_quadrature.py.
#include "bind.hpp"
#include "lens/edges.hpp"
#include <nanobind/stl/pair.h>

namespace rastercov {
namespace {
using namespace lens;

using Values = FloatArray;

int64_t degree_of(const Values &values) {
    require(values.rows() > FEWEST && values.rows() <= TABLE, "values must be those of a rule");
    return values.rows() - 1;
}

void rules(Array<double, TABLE, TABLE> nodes, Array<double, TABLE, TABLE, TABLE> weights) {
    for (int64_t n = 0; n < TABLE; n++) {
        std::copy(NODES[n].begin(), NODES[n].end(), nodes[n].begin());
        for (int64_t i = 0; i < TABLE; i++)
            std::copy(WEIGHTS[n][i].begin(), WEIGHTS[n][i].end(), weights[n][i].begin());
    }
}

void node_values(const PlaneRecord &plane, Array<const double, 4> edge, Array<double, Any, 2> out) {
    const int64_t n = out.rows() - 1;
    require(n >= FEWEST && n <= MOST, "out must have the rows of a rule");
    for (int64_t k = 0; k <= n; k++) {
        const auto [u, v] = node_value(plane, {edge[0], edge[1], edge[2], edge[3]}, n, k);
        out(k, 0) = u;
        out(k, 1) = v;
    }
}

double bulge_of(Values U, Values V) {
    require(U.rows() == V.rows(), "U and V must have the same length");
    return bulge(degree_of(U), U.data, V.data);
}

std::pair<int64_t, int64_t> nodes_for_edge(double half, Array<const double, TABLE> longest,
                                           int64_t parts_of) {
    require(parts_of >= FEWEST && parts_of <= MOST, "parts_of must be a rule");
    const auto [n, parts] = nodes_for(half, longest, parts_of);
    return {n, parts};
}

void bernstein(Values values, double level, Column<double> coefficients) {
    require(coefficients.rows() == values.rows(), "coefficients must have the length of values");
    bernstein_of(degree_of(values), values.data, level, coefficients.data);
}

int64_t roots_of(Values coefficients, Array<double, MOST_CUTS> places) {
    const int64_t n = degree_of(coefficients);
    EdgeScratch scratch;
    std::copy(coefficients.begin(), coefficients.end(), scratch.stack[0]);
    const int64_t count = roots(n, scratch, LEVEL_U, 0);
    for (int64_t k = 0; k < count; k++) places[k] = scratch.cuts[k].place;
    return count;
}

} // namespace

void register_lens_edges(nanobind::module_ &m) {
    m.attr("FEWEST") = FEWEST;
    m.attr("MOST") = MOST;
    m.attr("MOST_CUTS") = MOST_CUTS;
    m.attr("FLAT") = FLAT;
    def(m, "rules", rules,
        "Fill in by n the places of the n + 1 nodes of an edge, and the matrix S of pairs of them.",
        "nodes", "weights");
    def(m, "node_values", node_values,
        "Set `out`, (n + 1, 2), to the pixels of the nodes of an edge (ax, ay, bx, by).", "plane",
        "edge", "out");
    def(m, "bulge", bulge_of,
        "Signed area between the image of an edge and its chord, px^2, from values at its nodes.",
        "U", "V");
    def(m, "nodes_for", nodes_for_edge,
        "Rule for an edge of a half length, and the number of its parts: (n, parts).", "half",
        "longest", "parts_of");
    def(m, "bernstein_of", bernstein,
        "Fill Bernstein coefficients of the polynomial through values at the nodes, less a level.",
        "values", "level", "coefficients");
    def(m, "roots", roots_of,
        "Number of places, filled in, where a polynomial in Bernstein form changes its sign.",
        "coefficients", "places");
}
} // namespace rastercov
