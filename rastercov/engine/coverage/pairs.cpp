// Pairs of poses and faces for a matrix of visibility, and bounds of what the poses see of faces.
//
// Twin: tests/placement/test_uncovered.py.
#include "bind.hpp"
#include "coverage/face.hpp"

namespace rastercov {
namespace coverage {
namespace {

// px^2: an image of at most this area is that of a face seen edge-on, which shows nothing.
constexpr double EDGE_ON = 1e-6;

// Number of pairs of each pose; those of pose p are from p * F on.
struct Pairs {
    Column<int64_t> counts;
    Column<int32_t> face;
    Column<float> coverage;
};
// Of each face, or empty: bounds of the greatest visible fraction, poses that cover it.
struct Greatest {
    Column<double> low, high;
    Column<int64_t> covering;
};

// Coverage that no threshold is between it and the rounded one, more than 0.
inline float shorten(double coverage, double least) {
    const float value = float(coverage);
    if ((coverage >= least && value < least) || value == 0) return std::nextafter(value, INFINITY);
    if (coverage < least && value >= least) return std::nextafter(value, -INFINITY);
    return value;
}

} // namespace
} // namespace coverage

RECORD(coverage::Pairs, counts, face, coverage);
RECORD(coverage::Greatest, low, high, covering);

namespace coverage {
namespace {

struct Lister {
    BoolArray is_wanted;
    double least;
    const Pairs &pairs;
    const Greatest &greatest;
    int64_t end; // of the pairs so far

    template <class N> bool leaves_out(int64_t) const { return false; }
    template <class N> bool asks_bound(const Face<N> &) const { return greatest.low.size(); }
    template <class N> INLINE void take(int64_t f, const Face<N> &face) {
        const auto &[visibility, _, coverage, reason] = face.decision;
        if (greatest.low.size()) {
            using W = Whole<N>;
            double *const low = greatest.low.begin() + f, *const high = greatest.high.begin() + f;
            int64_t *const covering = greatest.covering.begin() + f;
            // A smaller image shows nothing, unless it was sampled.
            const Mask<N> shows =
                (face.measures.drawn > N(EDGE_ON)) | (face.kind == W(STATISTICAL));
            write(low, max(read<N>(low), visibility - face.bound));
            write(high, max(read<N>(high), select(shows, visibility + face.bound, N(0.0))));
            write(covering, read<W>(covering) + select(reason == W(COVERED), W(1), W(0)));
        }
        const Mask<N> wanted = (coverage > N(0.0)) & read_mask<N>(is_wanted.begin() + f);
        for (int64_t left = lanes_of(wanted); left; left = without_lowest(left)) {
            const int k = lowest(left);
            pairs.face[end] = int32_t(f + k);
            pairs.coverage[end++] = shorten(lane_of(coverage, k), least);
        }
    }
};

template <class Camera, class Count>
void list_pairs(int64_t first, int64_t last, const Scope<Camera, Count> &scope, const Rules &rules,
                BoolArray is_wanted, const Pairs &pairs, const Greatest &greatest) {
    const int64_t n_faces = scope.scene.faces.rows();
    require(pairs.counts.rows() == scope.seen.poses.rows() && pairs.face.rows() >= last * n_faces &&
                pairs.coverage.rows() >= last * n_faces,
            "pairs must have room for all of the poses");
    require(is_wanted.rows() == n_faces &&
                (greatest.low.size() == 0 ||
                 have_rows(n_faces, greatest.low, greatest.high, greatest.covering)),
            "faces must have one row each");
    each_view(first, last, scope, rules, Asked(rules), [&](const auto &view) {
        Lister lister = {is_wanted, rules.min_coverage, pairs, greatest, view.row * n_faces};
        judge_pose(view, 0, lister);
        pairs.counts[view.row] = lister.end - view.row * n_faces;
    });
}

} // namespace
} // namespace coverage

void register_coverage_pairs(nanobind::module_ &m) {
    using namespace coverage;
    m.attr("EDGE_ON") = EDGE_ON;
    each_kind([&]<class Camera, class Count> {
        def(m, "list_pairs", list_pairs<Camera, Count>,
            "List the pairs with coverage, and add to the bounds of faces.", "first", "last",
            "scope", "rules", "is_wanted", "pairs", "greatest");
    });
}

} // namespace rastercov
