// Lagrangian bounds: sums over the pairs of candidates and faces, and sets of least or greatest
// value.
//
//     earned_c = sum of u_f over the faces f of candidate c
//     cover_f  = sum of x_c over the candidates c of face f
//
// Pairs are in compressed rows: the faces of candidate c are face[indptr[c]] ... face[indptr[c + 1]
// - 1]. Of equal values the first counts as the less.
//
// M. Held, P. Wolfe, H. P. Crowder. Validation of Subgradient Optimization. 1974.
// G. B. Dantzig. Discrete-Variable Extremum Problems. 1957, for the fractional knapsack.
//
// Twin: rastercov.placement.select.bounds has the equations; tests/placement/test_selection.py.
#include "bind.hpp"
#include <algorithm>
#include <cmath>
#include <limits>

namespace rastercov {
namespace placement {
namespace {

using Limits = IntArray;
using Faces = Int32Array;
using Values = FloatArray;
using Out = Column<double>;

constexpr double INF = std::numeric_limits<double>::infinity();
constexpr double LEAST_COST = 1e-300; // of a candidate, in a quotient

void require_pairs(Limits indptr, Faces face, int64_t candidates, int64_t faces) {
    require(indptr.rows() == candidates + 1,
            "indptr must have one row for each candidate, and one more");
    bool is_right = indptr[0] >= 0 && indptr[candidates] <= face.rows();
    for (int64_t c = 0; c < candidates; c++) is_right &= indptr[c] <= indptr[c + 1];
    require(is_right, "indptr must rise, within the pairs");
    require_indices(face, faces, "face must hold faces");
}

void cheapest_share(Limits indptr, Faces face, Values costs, Out prices) {
    require_pairs(indptr, face, costs.rows(), prices.rows());
    std::fill(prices.begin(), prices.end(), INF);
    for (int64_t c = 0; c < costs.rows(); c++) {
        const double share = costs[c] / double(std::max<int64_t>(1, indptr[c + 1] - indptr[c]));
        for (int64_t j = indptr[c]; j < indptr[c + 1]; j++)
            prices[face[j]] = std::min(prices[face[j]], share);
    }
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

struct Ranked {
    double value;
    int64_t at;
    bool operator<(const Ranked &other) const { // NaN after all numbers
        if (value < other.value || other.value < value) return value < other.value;
        const bool is_nan = std::isnan(value);
        return is_nan != std::isnan(other.value) ? !is_nan : at < other.at;
    }
};

// Indices of the `most` least values, or more, least first; `value` gives that of an index.
template <class Value> std::vector<Ranked> least_of(int64_t n, int64_t most, Value value) {
    std::vector<Ranked> found(static_cast<size_t>(n));
    for (int64_t i = 0; i < n; i++) found[size_t(i)] = {value(i), i};
    if (most < n) std::nth_element(found.begin(), found.begin() + most, found.end());
    std::sort(found.begin(), found.begin() + most);
    return found;
}

double most_earned(Values earned, Values costs, int64_t cameras, double budget, Out amounts) {
    const int64_t n = earned.rows();
    require(have_rows(n, costs, amounts), "costs and amounts must have one row for each candidate");
    require(cameras >= 0, "cameras must be 0 or more");
    std::fill(amounts.begin(), amounts.end(), 0.0);
    const int64_t most = std::min(cameras, n);
    const auto valuable = least_of(n, most, [&](int64_t c) { return -earned[c]; });
    double income = 0.0;
    for (int64_t i = 0; i < most; i++) {
        const int64_t c = valuable[size_t(i)].at;
        amounts[c] = 1.0;
        income += earned[c];
    }
    if (!(budget < INF)) return income;
    const auto by_value =
        least_of(n, n, [&](int64_t c) { return -earned[c] / std::max(costs[c], LEAST_COST); });
    double left = budget;
    double by_cost = 0.0;
    size_t last = 0;
    for (; last < by_value.size() && costs[by_value[last].at] <= left; last++) {
        left -= costs[by_value[last].at];
        by_cost += earned[by_value[last].at];
    }
    const bool has_part = last < by_value.size();
    if (has_part) by_cost += earned[by_value[last].at] * left / costs[by_value[last].at];
    if (!(by_cost < income)) return income;
    std::fill(amounts.begin(), amounts.end(), 0.0);
    for (size_t i = 0; i < last; i++) amounts[by_value[i].at] = 1.0;
    if (has_part) amounts[by_value[last].at] = left / costs[by_value[last].at];
    return by_cost;
}

void cheapest(Values price, Values weights, Faces kind, Values least, double least_total, Out z) {
    const int64_t n = price.rows();
    require(have_rows(n, weights, kind, z), "weights, kind and z must have one row for each face");
    require_indices(kind, least.rows(), "kind must hold rows of least");
    const auto order = least_of(n, n, [&](int64_t f) { return price[f]; });
    std::vector<double> missing(least.begin(), least.end());
    double total = least_total;
    for (const auto &[value, f] : order) {
        double &of_kind = missing[size_t(kind[f])];
        const double part = std::min(weights[f], std::max(0.0, of_kind));
        of_kind -= part;
        total -= part;
        z[f] = part / weights[f];
    }
    for (const auto &[value, f] : order) {
        if (total <= 0) break;
        const double part = std::min(weights[f] * (1 - z[f]), total);
        total -= part;
        z[f] += part / weights[f];
    }
}

} // namespace
} // namespace placement

void register_placement_lagrange(nanobind::module_ &m) {
    using namespace placement;
    def(m, "cheapest_share", cheapest_share,
        "Set `prices`, (F,), to the least cost / faces over the candidates of each face.", "indptr",
        "face", "costs", "prices");
    def(m, "earn", earn,
        "Set `earned`, (C,), to the sum of the prices of the faces of each candidate.", "indptr",
        "face", "prices", "earned");
    def(m, "take", take,
        "Set `cover`, (F,), to the cover of each face by fractions of the candidates, (C,).",
        "indptr", "face", "amounts", "cover");
    def(m, "most_earned", most_earned,
        "Most that any candidates within the limits earn, or more.\n\n"
        "That of the `cameras` most valuable candidates; with a budget, also of the most valuable "
        "by\n"
        "cost, the last one in part. Each is a bound under both limits. `amounts`, (C,), are set "
        "to\n"
        "the part of each candidate in the lesser bound. The budget may be inf.",
        "earned", "costs", "cameras", "budget", "amounts");
    def(m, "cheapest", cheapest,
        "Set `z`, (F,), to the fractions of faces that give the required weights at the least "
        "price.\n\n"
        "`least`, (G,), is the weight wanted of each kind, `least_total` that of all faces.",
        "price", "weights", "kind", "least", "least_total", "z");
}

} // namespace rastercov
