// Sums over poses of the coverage (3.6) of each face, and rows of a table.
//
// add_poses judges the faces in some poses, adds the figures to the sums of a network, and keeps
// those of chosen pairs as rows; add_rows adds figures that are there, and add_sums other sums.
//
// Invariants: of equal coverages the least row of the batch is the best, whatever the order in
// which rows come. Totals do not depend on the level: see sum.hpp.
//
// Twins: rastercov.reference.coverage.
#include "bind.hpp"
#include "coverage/face.hpp"
#include "sum.hpp"

namespace rastercov {
namespace coverage {
namespace {

// Indices of rastercov.core.coverage.network.CHOICES.
enum Choice : int64_t { NO_PAIRS, COVERED_PAIRS, SEEN_PAIRS, ALL_PAIRS };

// Of the distance of a point from a plane, to the sum of their coordinates: greater than the error,
// so that a point beyond it is behind the face in any order of operations.
constexpr double PLANE_ROUNDING = 1e-12;

// See rastercov.core.coverage.face_pass.
struct Sums {
    Column<int64_t> views;
    Column<double> best;
    Column<int64_t> best_row;
    Column<uint8_t> reason, alone;
    Array<int64_t, 3> kinds;
    Array<double, 2> bounds;
    Column<int64_t> covered_faces;
    Column<double> totals;
};
struct PairRows {
    Column<int32_t> pose, face;
    Column<bool> in_view;
    Column<float> in_view_fraction, projected_area, visible_pixels, drawn_pixels, resolution,
        pixel_density, facing_density;
    Column<bool> in_focus;
    Column<float> visibility, visibility_bound;
    Column<int32_t> visibility_kind;
    Column<float> incidence, coverage;
    Column<int32_t> reason;
};
struct Sink {
    int64_t choice;
    IntArray pose_ids;
    Column<int64_t> counts;
    PairRows rows;
};

} // namespace
} // namespace coverage

RECORD(coverage::Sums, views, best, best_row, reason, alone, kinds, bounds, covered_faces, totals);
RECORD(coverage::PairRows, pose, face, in_view, in_view_fraction, projected_area, visible_pixels,
       drawn_pixels, resolution, pixel_density, facing_density, in_focus, visibility,
       visibility_bound, visibility_kind, incidence, coverage, reason);
RECORD(coverage::Sink, choice, pose_ids, counts, rows);

namespace coverage {
namespace {

using Scored = BoolArray; // faces that count in the figures of the network

void require_sums(const Sums &sums, Scored is_scored, int64_t n_faces, int64_t n_poses) {
    require(have_rows(n_faces, sums.views, sums.best, sums.best_row, sums.reason, sums.alone,
                      is_scored),
            "sums must have one row for each face");
    require(have_rows(n_poses, sums.covered_faces, sums.totals),
            "sums must have one row for each pose");
}

// Total coverage of the faces that are scored; their coverage goes to the front of the array.
double total_of(Column<double> coverage, Scored is_scored) {
    const bool *const end = is_scored.end();
    int64_t n = std::find(is_scored.begin(), end, false) - is_scored.begin();
    for (int64_t f = n; f < coverage.rows(); f++) {
        coverage[n] = coverage[f];
        n += is_scored[f];
    }
    return pairwise_sum(coverage.begin(), n);
}

// Keeps the greater coverage of faces from f on, of equal ones that of the lesser row.
template <class N> INLINE void keep_best(const Sums &sums, int64_t f, N coverage, Whole<N> row) {
    int64_t *const best_row = sums.best_row.begin() + f;
    double *const best = sums.best.begin() + f;
    const N before = read<N>(best);
    const Whole<N> row_before = read<Whole<N>>(best_row);
    const Mask<N> is_tie = (coverage == before) & (row_before > row);
    const Mask<N> is_best = (coverage > N(0.0)) & ((coverage > before) | is_tie);
    write(best, select(is_best, coverage, before));
    write(best_row, select(is_best, row, row_before));
}
// Keeps the reason that is nearer to covering.
template <class N> INLINE void keep_nearer(const Sums &sums, int64_t f, Whole<N> here) {
    uint8_t *const reason = sums.reason.begin() + f;
    const auto before = read<Whole<N>>(reason);
    write(reason, select(nearness<N>(here) > nearness<N>(before), here, before));
}

// Figures of faces that a network adds up.
template <class N> struct Summand {
    N coverage, bound, part;
    Whole<N> reason, kind;
};

// Adds the figures of faces from f on in one pose. A pair that fails no later than for its back is
// not in view.
template <class N>
INLINE void add_pair(int64_t row, int64_t f, Scored is_scored, const Summand<N> &face,
                     const Sums &sums) {
    using W = Whole<N>;
    const Mask<N> covers = face.reason == W(COVERED);
    const Mask<N> counts = read_mask<N>(is_scored.begin() + f);
    int64_t *const views = sums.views.begin() + f;
    if (any(covers)) write(views, read<W>(views) + select(covers, W(1), W(0)));
    if (any(face.coverage > N(0.0))) keep_best(sums, f, face.coverage, W(row));
    keep_nearer<N>(sums, f, face.reason);
    uint8_t *const alone = sums.alone.begin() + f;
    W fails = read<W>(alone);
    for (const Fails each : {IS_BLURRED, IS_COARSE, IS_HIDDEN, IS_STEEP})
        fails = select(face.reason == W(REASON_OF[each]), fails | W(each), fails);
    write(alone, fails);
    const Mask<N> in_view = counts & (face.reason > W(BACK_FACING)) & (face.part > N(0.0));
    for (const Kind kind : {STATISTICAL, CERTIFIED, EXACT})
        sums.kinds[kind] += count_of(in_view & (face.kind == W(kind)));
    const Mask<N> is_covered = covers & counts;
    const auto keep_bound = [&](double &most, Mask<N> counted) __attribute__((always_inline)) {
        if (most < 1) most = std::max(most, greatest(select(counted, face.bound, N(0.0))));
    };
    keep_bound(sums.bounds[0], in_view);
    keep_bound(sums.bounds[1], is_covered);
    sums.covered_faces[row] += count_of(is_covered);
}

// Adds the faces of one pose to the sums, and keeps rows of the pairs that are asked for.
template <class View> struct Adder {
    const View &view;
    Scored is_scored;
    const Sums &sums;
    const Sink &sink;
    Column<double> coverage;
    int64_t choice, n_rows; // rows so far
    double rounding;

    // Adds faces that the camera is behind, or parallel rays leave from their back, or that have no
    // area, without measuring them.
    template <class N> INLINE bool leaves_out(int64_t f) const {
        if (choice == ALL_PAIRS) return false;
        const Scene &scene = view.scene;
        const Pose pose = view.pose();
        const auto [a, b, c] = read_triple<N>(scene.normals.begin() + 3 * f);
        const auto along = [&](int column) __attribute__((always_inline)) {
            return a * N(pose(0, column)) + b * N(pose(1, column)) + c * N(pose(2, column));
        };
        const N height = has_parallel_rays(view.camera)
                             ? -along(2)
                             : along(3) - read<N>(scene.offsets.begin() + f);
        const Mask<N> is_degenerate = read<Whole<N>>(scene.own.begin() + f) == Whole<N>(DEGENERATE);
        const Mask<N> is_behind =
            (height < N(-rounding)) & !read_mask<N>(scene.two_sided.begin() + f);
        if (!all(is_behind | is_degenerate)) return false;
        using W = Whole<N>;
        keep_nearer<N>(sums, f, select(is_degenerate, W(DEGENERATE), W(BACK_FACING)));
        write(coverage.begin() + f, N(0.0));
        return true;
    }

    template <class N> INLINE Mask<N> covers(const Face<N> &face) const {
        return face.decision.reason == Whole<N>(COVERED);
    }
    template <class N> INLINE Mask<N> is_in_view(const Face<N> &face) const {
        return (face.decision.reason > Whole<N>(BACK_FACING)) & (face.part > N(0.0));
    }
    template <class N> INLINE Mask<N> is_row(const Face<N> &face) const {
        const Mask<N> none = covers(face) & !covers(face);
        return choice == ALL_PAIRS    ? !none
               : choice == SEEN_PAIRS ? covers(face) | is_in_view(face)
               : choice == NO_PAIRS   ? none
                                      : covers(face);
    }
    // The sums hold the largest bounds, and none exceeds 1.
    template <class N> INLINE bool asks_bound(const Face<N> &face) const {
        return any(is_row(face)) || (sums.bounds[0] < 1 && any(is_in_view(face))) ||
               (sums.bounds[1] < 1 && any(covers(face)));
    }

    template <class N> INLINE void take(int64_t f, const Face<N> &face) {
        const auto &decision = face.decision;
        write(coverage.begin() + f, decision.coverage);
        const Summand<N> summand = {decision.coverage, face.bound, face.part, decision.reason,
                                    face.kind};
        add_pair(view.row, f, is_scored, summand, sums);
        if (choice == NO_PAIRS) return;
        for (int64_t left = lanes_of(is_row(face)); left; left = without_lowest(left))
            add_row(f, face, lowest(left));
    }

    // Keeps the figures of the face in lane k. The bound includes the rounding of the visible
    // fraction to float, so that it still holds.
    template <class N> void add_row(int64_t f, const Face<N> &face, int k) {
        const PairRows &rows = sink.rows;
        const int64_t at = n_rows++;
        const auto put = [&](const auto &array, const auto &value) {
            array[at] = std::remove_cvref_t<decltype(array[at])>(lane_of(value, k));
        };
        const auto &is = face.measures;
        const auto &decision = face.decision;
        rows.pose[at] = int32_t(sink.pose_ids[view.row]);
        rows.face[at] = int32_t(f + k);
        put(rows.in_view, is.is_inside);
        put(rows.in_view_fraction, face.part);
        put(rows.projected_area, face.area);
        put(rows.visible_pixels, is.visible);
        put(rows.drawn_pixels, is.drawn);
        put(rows.resolution, decision.resolution);
        put(rows.pixel_density, is.density);
        put(rows.facing_density, is.facing);
        put(rows.in_focus, is.is_focused);
        put(rows.visibility_kind, face.kind);
        put(rows.coverage, decision.coverage);
        put(rows.reason, decision.reason);
        const double visibility = lane_of(decision.visibility, k);
        const float short_visibility = float(visibility);
        const double bound = lane_of(face.bound, k) + std::abs(short_visibility - visibility);
        float short_bound = float(bound);
        if (short_bound < bound) short_bound = std::nextafter(short_bound, INFINITY);
        rows.visibility[at] = short_visibility;
        rows.visibility_bound[at] = short_bound;
        rows.incidence[at] = float(incidence_angle(lane_of(face.cosine, k)));
    }
};

// Judges the faces in poses `first` to `last` - 1 and adds them to the sums.
//
// `coverage`, (F,), is scratch. Rows of the pairs that the sink asks for go to its rows from
// first * F on, their number to its counts[first].
template <class Camera, class Count>
void add_poses(int64_t first, int64_t last, const Scope<Camera, Count> &scope, const Rules &rules,
               Scored is_scored, const Sums &sums, Column<double> coverage, const Sink &sink) {
    const int64_t n_faces = scope.scene.faces.rows(), n_poses = scope.seen.poses.rows();
    require_sums(sums, is_scored, n_faces, n_poses);
    require(coverage.rows() == n_faces, "coverage must have one row for each face");
    require(have_rows(n_poses, sink.pose_ids, sink.counts),
            "a sink must have one row for each pose");
    const int64_t room = sink.choice == NO_PAIRS ? 0 : last * n_faces;
    each_field(sink.rows, Record<PairRows>::fields, [&](const auto &rows) {
        require(rows.rows() >= room, "a sink must have room for all pairs");
    });
    if (first == last) return;
    const bool has_rows = sink.choice != NO_PAIRS;
    int64_t n_rows = first * n_faces;
    const Asked asked(rules, has_rows, has_rows, has_rows);
    each_view(first, last, scope, rules, asked, [&](const auto &view) {
        const Pose pose = view.pose();
        const double reach = std::abs(pose(0, 3)) + std::abs(pose(1, 3)) + std::abs(pose(2, 3));
        Adder<View<Camera, Count>> adder = {
            view,     is_scored,   sums,   sink,
            coverage, sink.choice, n_rows, PLANE_ROUNDING * (reach + view.scene.reach)};
        judge_pose(view, 0, adder);
        n_rows = adder.n_rows;
        sums.totals[view.row] = total_of(coverage, is_scored);
    });
    sink.counts[first] = n_rows - first * n_faces;
}

// Calls `add` with each face of n, as many at a time as a register holds.
template <class Add> INLINE void each_lanes(int64_t n, Add add) {
    int64_t f = 0;
    for (; f + AT_A_TIME<Doubles> <= n; f += AT_A_TIME<Doubles>) add(f, Doubles());
    for (; f < n; f++) add(f, double());
}

// Adds figures of faces in other poses to ours; their row 0 is row `first` of these. Of equal
// coverages ours is the best where they are later, else the least row.
void add_sums(const Sums &ours, const Sums &theirs, int64_t first, bool are_later) {
    const int64_t n = ours.views.rows();
    for (const Sums *each : {&ours, &theirs})
        require(have_rows(n, each->views, each->best, each->best_row, each->reason, each->alone),
                "sums must have one row for each face");
    each_lanes(n, [&]<class N>(int64_t f, N) {
        using W = Whole<N>;
        int64_t *const views = ours.views.begin() + f;
        write(views, read<W>(views) + read<W>(theirs.views.begin() + f));
        N best = read<N>(theirs.best.begin() + f);
        if (are_later) best = select(best > read<N>(ours.best.begin() + f), best, N(0.0));
        keep_best(ours, f, best, read<W>(theirs.best_row.begin() + f) + W(first));
        keep_nearer<N>(ours, f, read<W>(theirs.reason.begin() + f));
        uint8_t *const alone = ours.alone.begin() + f;
        write(alone, read<W>(alone) | read<W>(theirs.alone.begin() + f));
    });
    for (int k = 0; k < 3; k++) ours.kinds[k] += theirs.kinds[k];
    for (int k = 0; k < 2; k++) ours.bounds[k] = std::max(ours.bounds[k], theirs.bounds[k]);
}

// Copies counts to bytes; false where one is too large for that.
template <class T> bool as_bytes(Array<const T, Any, Any> counts, Array<uint8_t, Any, Any> bytes) {
    require(bytes.shape == counts.shape, "there must be a byte for each count");
    T most = 0;
    for (int64_t i = 0; i < counts.size(); i++) {
        bytes.data[i] = uint8_t(int64_t(counts.data[i]));
        most = std::max(most, counts.data[i]);
    }
    return most < 256;
}

// Adds some rows of figures, (P, F) each, to the sums.
void add_rows(IntArray rows, Scored is_scored, Array<const double, Any, Any> coverage,
              Array<const uint8_t, Any, Any> reason, Array<const double, Any, Any> bound,
              Array<const uint8_t, Any, Any> kind, Array<const double, Any, Any> fraction,
              const Sums &sums) {
    const int64_t n_poses = coverage.rows(), n_faces = coverage.shape[1];
    require_sums(sums, is_scored, n_faces, n_poses);
    require_indices(rows, n_poses, "rows must be rows of the figures");
    require(reason.shape == coverage.shape && bound.shape == coverage.shape &&
                kind.shape == coverage.shape && fraction.shape == coverage.shape,
            "figures must have one shape");
    std::vector<double> own(n_faces);
    for (const int64_t row : rows) {
        each_lanes(n_faces, [&]<class N>(int64_t f, N) {
            const int64_t at = row * n_faces + f;
            const Summand<N> face = {read<N>(coverage.begin() + at), read<N>(bound.begin() + at),
                                     read<N>(fraction.begin() + at),
                                     read<Whole<N>>(reason.begin() + at),
                                     read<Whole<N>>(kind.begin() + at)};
            add_pair(row, f, is_scored, face, sums);
        });
        const auto from = coverage[row];
        std::copy(from.begin(), from.end(), own.begin());
        sums.totals[row] = total_of({own.data(), {n_faces}}, is_scored);
    }
}

} // namespace
} // namespace coverage

void register_coverage_network(nanobind::module_ &m) {
    using namespace coverage;
    each_kind([&]<class Camera, class Count> {
        def(m, "add_poses", add_poses<Camera, Count>,
            "Judge the faces in poses `first` to `last` - 1 and add them to the sums.\n\n"
            "`coverage`, (F,), is scratch. Rows of the pairs that the sink asks for go to its rows "
            "from\nfirst * F on, their number to its counts[first].",
            "first", "last", "scope", "rules", "is_scored", "sums", "coverage", "sink");
    });
    def(m, "add_rows", add_rows, "Add some rows of figures, (P, F) each, to the sums.", "rows",
        "is_scored", "coverage", "reason", "bound", "kind", "fraction", "sums");
    const char *doc = "Copy counts to bytes; false where one is too large for that.";
    def(m, "as_bytes", as_bytes<int32_t>, doc, "counts", "bytes");
    def(m, "as_bytes", as_bytes<double>, doc, "counts", "bytes");
    def(m, "add_sums", add_sums,
        "Add figures of faces in other poses to ours; their row 0 is row `first` of these.\n\n"
        "Of equal coverages ours is the best where they are later, else the least row.",
        "ours", "theirs", "first", "are_later");
}

} // namespace rastercov
