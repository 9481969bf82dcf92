// Rules by which images of edges are integrated: nodes, weights of pairs of them, and Bernstein
// coefficients.
//
// With U, V of u, v at the n + 1 Gauss-Lobatto nodes of an edge, the area between the image of the
// edge and its chord is
//
//     bulge = sum over j < i of S_ij ((U_i - U_0) (V_j - V_0) - (U_j - U_0) (V_i - V_0)),
//
// S constant and antisymmetric: S_ij = (w_i D_ij - w_j D_ji) / 2, w the weights and D the
// derivatives of the Lagrange polynomials. It is exact where the degrees of u and v add up to 2 n
// at most.
//
// With P the Legendre polynomial of degree n over [0, 1], w_i D_ij = 1 / (n (n + 1) P(x_i) P(x_j)
// (x_i - x_j)), which is antisymmetric by itself, and stationary at the nodes.
//
// The nodes are written out, and all else follows from them as the compiler runs, by sums, products
// and quotients of doubles: areas have equal bits wherever they are computed.
//
// Twin: tests/lenses/test_quadrature.py.
#pragma once
#include "lens/lens.hpp"
#include <algorithm>
#include <array>
#include <cstdint>

namespace rastercov::lens {

// Pages make the tables as they begin: their loops have fewer bytes.
#ifdef __wasm__
#define RASTERCOV_LIST const volatile
#define RASTERCOV_TABLE const
#else
#define RASTERCOV_LIST constexpr
#define RASTERCOV_TABLE constexpr
#endif

// clang-format off
// n = 2, 3, ...: places of the n + 1 nodes.
inline RASTERCOV_LIST double LISTED_NODES[] = {
    0.0, 0.5, 1.0, 0.0, 0.27639320225002095, 0.723606797749979, 1.0, 0.0, 0.17267316464601135, 0.5,
    0.8273268353539887, 1.0, 0.0, 0.11747233803526769, 0.3573842417596773, 0.6426157582403227,
    0.8825276619647323, 1.0, 0.0, 0.0848880518607169, 0.2655756032646429, 0.5, 0.7344243967353571,
    0.9151119481392831, 1.0, 0.0, 0.06412992574519638, 0.2041499092834288, 0.3953503910487605,
    0.6046496089512395, 0.7958500907165712, 0.9358700742548036, 1.0, 0.0, 0.050121002294269856,
    0.16140686024463136, 0.3184412680869108, 0.5, 0.6815587319130891, 0.8385931397553686,
    0.9498789977057301, 1.0, 0.0, 0.04023304591677013, 0.13061306744724743, 0.26103752509477784,
    0.41736052116680633, 0.5826394788331937, 0.7389624749052222, 0.8693869325527526,
    0.9597669540832299, 1.0, 0.0, 0.03299928479597014, 0.10775826316842807, 0.21738233650189742,
    0.35212093220653023, 0.5, 0.6478790677934698, 0.7826176634981026, 0.8922417368315719,
    0.9670007152040299, 1.0, 0.0, 0.027550363888559026, 0.09036033917799607, 0.1835619234840699,
    0.3002345295173255, 0.43172353357253623, 0.5682764664274638, 0.6997654704826746,
    0.81643807651593, 0.9096396608220039, 0.972449636111441, 1.0};
// clang-format on

using Row = std::array<double, TABLE>;
using Square = std::array<Row, TABLE>;

// By n: places of the nodes, 0 to 1; node k and node n - k add up to 1, to rounding.
inline RASTERCOV_TABLE Square NODES = [] {
    Square table = {};
    for (int64_t n = FEWEST, at = 0; n <= MOST; n++)
        for (int64_t k = 0; k <= n; k++) table[n][k] = LISTED_NODES[at++];
    return table;
}();

// By n: S_ij.
inline RASTERCOV_TABLE std::array<Square, TABLE> WEIGHTS = [] {
    std::array<Square, TABLE> table = {};
    for (int64_t n = FEWEST; n <= MOST; n++) {
        Row legendre = {};
        for (int64_t i = 0; i <= n; i++) {
            const double x = 2 * NODES[n][i] - 1;
            double before = 1.0;
            legendre[i] = x;
            for (int64_t k = 2; k <= n; k++) {
                const double next =
                    (double(2 * k - 1) * x * legendre[i] - double(k - 1) * before) / double(k);
                before = legendre[i];
                legendre[i] = next;
            }
            for (int64_t j = 0; j < i; j++) {
                table[n][i][j] = 1 / (double(n * (n + 1)) * legendre[i] * legendre[j] *
                                      (NODES[n][i] - NODES[n][j]));
                table[n][j][i] = -table[n][i][j];
            }
        }
    }
    return table;
}();

// By n: factor of the value at node j in Bernstein coefficient k, of the Lagrange polynomial of the
// node as a product of its linear factors; all terms of a coefficient have one sign.
inline RASTERCOV_TABLE std::array<Square, TABLE> BERNSTEIN = [] {
    std::array<Square, TABLE> table = {};
    for (int64_t n = FEWEST; n <= MOST; n++)
        for (int64_t j = 0; j <= n; j++) {
            const Row &x = NODES[n];
            Row found = {1.0};
            int64_t degree = 0;
            for (int64_t m = 0; m <= n; m++) {
                if (m == j) continue;
                const double first = -x[m] / (x[j] - x[m]), last = (1 - x[m]) / (x[j] - x[m]);
                degree++;
                for (int64_t k = degree; k > 0; k--)
                    found[k] =
                        (double(degree - k) * found[k] * first + double(k) * found[k - 1] * last) /
                        double(degree);
                found[0] *= first;
            }
            for (int64_t k = 0; k <= n; k++) table[n][k][j] = found[k];
        }
    return table;
}();

// By n: largest distance of neighbouring nodes, in lengths of the edge.
inline RASTERCOV_TABLE Row GAP = [] {
    Row table = {};
    for (int64_t n = FEWEST; n <= MOST; n++)
        for (int64_t k = 0; k < n; k++)
            table[n] = std::max(table[n], NODES[n][k + 1] - NODES[n][k]);
    return table;
}();

// By n: largest Bernstein coefficient of a polynomial that is at most 1 at the nodes.
inline RASTERCOV_TABLE Row GROWTH = [] {
    Row table = {};
    for (int64_t n = FEWEST; n <= MOST; n++)
        for (const Row &row : BERNSTEIN[n]) {
            double sum = 0.0;
            for (const double factor : row) sum += factor < 0 ? -factor : factor;
            table[n] = std::max(table[n], sum);
        }
    return table;
}();

} // namespace rastercov::lens
