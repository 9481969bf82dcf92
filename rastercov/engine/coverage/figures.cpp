// Coverage (3.6) of each face in some poses.
//
// judge_poses takes what an observer measured and gives every figure of rastercov.Coverage.
//
// E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section
// 3.3.
//
// Twins: rastercov.reference.coverage.
#include "bind.hpp"
#include "coverage/face.hpp"

namespace rastercov {
namespace coverage {
namespace {

template <class T> using Pairs = Array<T, Any, Any>;

// rastercov.core.coverage.face_pass.FIGURES: (P, F), or (0, 0) where a figure is not asked for.
struct Figures {
    Pairs<bool> in_view;
    Pairs<double> in_view_fraction, projected_area, visible_pixels, drawn_pixels, resolution,
        pixel_density, facing_density;
    Pairs<bool> in_focus;
    Pairs<double> visibility, visibility_bound;
    Pairs<uint8_t> visibility_kind;
    Pairs<double> incidence, coverage;
    Pairs<uint8_t> reason;
};

} // namespace
} // namespace coverage

RECORD(coverage::Figures, in_view, in_view_fraction, projected_area, visible_pixels, drawn_pixels,
       resolution, pixel_density, facing_density, in_focus, visibility, visibility_bound,
       visibility_kind, incidence, coverage, reason);

namespace coverage {
namespace {

struct Keeper {
    const Figures &out;
    int64_t start; // of the pose in the arrays
    bool has_bounds;

    template <class N> bool leaves_out(int64_t) const { return false; }
    template <class N> bool asks_bound(const Face<N> &) const { return has_bounds; }
    template <class N> INLINE void take(int64_t f, const Face<N> &face) const {
        const auto put = [&](const auto &array, const auto &value) __attribute__((always_inline)) {
            if (array.size()) write(array.begin() + start + f, value);
        };
        const auto &is = face.measures;
        const auto &decision = face.decision;
        put(out.in_view, is.is_inside);
        put(out.in_view_fraction, face.part);
        put(out.projected_area, face.area);
        put(out.visible_pixels, is.visible);
        put(out.drawn_pixels, is.drawn);
        put(out.resolution, decision.resolution);
        put(out.pixel_density, is.density);
        put(out.facing_density, is.facing);
        put(out.in_focus, is.is_focused);
        put(out.visibility, decision.visibility);
        put(out.visibility_bound, face.bound);
        put(out.visibility_kind, face.kind);
        if (out.incidence.size()) put(out.incidence, incidence_angle(face.cosine));
        put(out.coverage, decision.coverage);
        put(out.reason, decision.reason);
    }
};

// Fills rows `first` to `last` - 1 of `out` with the figures of these poses. What is not asked for
// is not computed, unless the coverage depends on it.
template <class Camera, class Count>
void judge_poses(int64_t first, int64_t last, const Scope<Camera, Count> &scope, const Rules &rules,
                 const Figures &out) {
    const int64_t n_poses = scope.seen.poses.rows(), n_faces = scope.scene.faces.rows();
    int64_t skew = 0; // lanes begin at cache lines in the arrays of double
    each_field(out, Record<Figures>::fields, [&](const auto &array) {
        require(array.size() == 0 || (array.shape[0] == n_poses && array.shape[1] == n_faces),
                "figures must have one row for each pose and one column for each face");
        if (array.size() && sizeof(*array.begin()) == sizeof(double))
            skew = int64_t(reinterpret_cast<uintptr_t>(array.begin()) / sizeof(double));
    });
    const Asked asked(rules, out.projected_area.size() > 0, out.pixel_density.size() > 0,
                      out.facing_density.size() > 0);
    const bool has_bounds = out.visibility_bound.size() > 0 || out.visibility_kind.size() > 0;
    each_view(first, last, scope, rules, asked, [&](const auto &view) {
        Keeper keeper = {out, view.row * n_faces, has_bounds};
        judge_pose(view, skew + keeper.start, keeper);
    });
}

} // namespace
} // namespace coverage

void register_coverage_figures(nanobind::module_ &m) {
    using namespace coverage;
    const char *doc = "Fill rows `first` to `last` - 1 of `out` with the figures of these poses.";
    each_kind([&]<class Camera, class Count> {
        def(m, "judge_poses", judge_poses<Camera, Count>, doc, "first", "last", "scope", "rules",
            "out");
    });
    m.attr("COLUMNS") = COLUMNS_OF<Lens>;
    m.attr("CURVED_COLUMNS") = COLUMNS_OF<CurvedLens>;
    m.attr("SIDE_ROUNDING") = SIDE_ROUNDING;
    m.attr("MOST_DOUBTFUL") = MOST_DOUBTFUL;
    m.attr("BORDER_ROUNDING") = BORDER_ROUNDING;
}

} // namespace rastercov
