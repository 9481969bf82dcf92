// Lagrangian bounds: sums over the pairs of candidates and faces.
//
//     earned_c = sum of u_f over the faces f of candidate c
//     cover_f  = sum of x_c over the candidates c of face f
//
// Pairs are in compressed rows: the faces of candidate c are face[indptr[c]] ... face[indptr[c + 1]
// - 1].
//
// M. Held, P. Wolfe, H. P. Crowder. Validation of Subgradient Optimization. 1974.
//
// Twin: rastercov.placement.select.bounds has the equations; tests/placement/test_selection.py.
#include "bind.hpp"
#include <algorithm>

namespace rastercov {
namespace placement {
namespace {

using Limits = IntArray;
using Faces = Int32Array;
using Values = FloatArray;
using Out = Column<double>;

void require_pairs(Limits indptr, Faces face, int64_t candidates, int64_t faces) {
    require(indptr.rows() == candidates + 1,
            "indptr must have one row for each candidate, and one more");
    bool is_right = indptr[0] >= 0 && indptr[candidates] <= face.rows();
    for (int64_t c = 0; c < candidates; c++) is_right &= indptr[c] <= indptr[c + 1];
    require(is_right, "indptr must rise, within the pairs");
    require_indices(face, faces, "face must hold faces");
}

// Each sum is in the order of its faces. Several at a time: one alone waits for each addition.
void earn(Limits indptr, Faces face, Values prices, Out earned) {
    constexpr int AT_ONCE = 4;
    const int64_t n = earned.rows();
    require_pairs(indptr, face, n, prices.rows());
    int64_t row[AT_ONCE], next = 0; // the candidate of each sum
    const int32_t *at[AT_ONCE], *end[AT_ONCE];
    double total[AT_ONCE];
    const auto begin = [&](int k) {
        while (next < n && indptr[next] == indptr[next + 1]) earned[next++] = 0.0;
        row[k] = next < n ? next++ : -1;
        total[k] = 0.0;
        at[k] = face.data + (row[k] < 0 ? 0 : indptr[row[k]]);
        end[k] = face.data + (row[k] < 0 ? 0 : indptr[row[k] + 1]);
        return row[k] >= 0;
    };
    bool all = true;
    for (int k = 0; k < AT_ONCE; k++) all &= begin(k);
    while (all) {
        int64_t steps = end[0] - at[0];
        for (int k = 1; k < AT_ONCE; k++) steps = std::min<int64_t>(steps, end[k] - at[k]);
        for (int64_t j = 0; j < steps; j++)
            for (int k = 0; k < AT_ONCE; k++) total[k] += prices[at[k][j]];
        for (int k = 0; k < AT_ONCE; k++) {
            at[k] += steps;
            if (at[k] < end[k]) continue;
            earned[row[k]] = total[k];
            all &= begin(k);
        }
    }
    for (int k = 0; k < AT_ONCE; k++)
        if (row[k] >= 0) {
            for (; at[k] < end[k]; at[k]++) total[k] += prices[*at[k]];
            earned[row[k]] = total[k];
        }
}

void take(Limits indptr, Faces face, Values amounts, Out cover) {
    require_pairs(indptr, face, amounts.rows(), cover.rows());
    std::fill(cover.begin(), cover.end(), 0.0);
    for (int64_t c = 0; c < amounts.rows(); c++)
        if (amounts[c] > 0)
            for (int64_t j = indptr[c]; j < indptr[c + 1]; j++) cover[face[j]] += amounts[c];
}

} // namespace
} // namespace placement

void register_placement_lagrange(nanobind::module_ &m) {
    using namespace placement;
    def(m, "earn", earn,
        "Set `earned`, (C,), to the sum of the prices of the faces of each candidate.", "indptr",
        "face", "prices", "earned");
    def(m, "take", take,
        "Set `cover`, (F,), to the cover of each face by fractions of the candidates, (C,).",
        "indptr", "face", "amounts", "cover");
}

} // namespace rastercov
