// One face in one pose, or as many faces as a register holds: measured, judged, and handed on.
//
// judge_pose hands each face to a consumer, which keeps its figures or adds them up. Lanes are of
// faces of which neither the border of the image of a pinhole nor the near plane cuts one; all
// others are measured one by one, by the same order of operations.
//
// Invariants: the figures of a face do not depend on those beside it, so not on the level either.
//
// Twins: rastercov.reference.coverage.
#pragma once
#include "coverage/bounds.hpp"
#include "coverage/lens_faces.hpp"
#include "interrupt.hpp"
#include <memory>

namespace rastercov {
namespace coverage {

// An observation: rastercov.core.coverage.face_pass.Seen. Areas are visible / scale and drawn /
// scale, px^2: counts of samples are double or int32_t. `kind` is (0, 0) where all figures are
// counted, and `area_error` where it is 0 everywhere.
template <class Count> struct Seen {
    FloatRows<4, 4> poses;
    FloatArray near;
    Array<const Count, Any, Any> visible, drawn;
    double scale;
    Array<const uint8_t, Any, Any> kind;
    Array<const double, Any, Any> area_error;
    double samples_per_pixel;
};

// Faces in some poses of a camera, and memory for their projected vertices.
template <class Camera, class Count> struct Scope {
    Scene scene;
    Camera camera;
    Seen<Count> seen;
    VertexRows<Camera> points;
    void check(int64_t first, int64_t last) const;
};

// What is known of a face in one pose: in the image, part in view, area of the image, px^2, cosine
// of the angle of incidence, bound of the visible fraction and its kind, and the decision.
template <class N> struct Face {
    Corners<N> corners;
    Measures<N> measures;
    N state, part, area, cosine, bound;
    Whole<N> kind;
    Decision<N> decision;
};

// Figures that are asked for, or that a decision needs: of a target that faces the camera the
// density; a density that is not is 0, and an area may be any positive number.
struct Asked {
    bool area, density, facing, per_m2;

    explicit Asked(const Rules &rules, bool area = false, bool density = false, bool facing = false)
        : area(area), density(density || rules.min_pixel_density > 0),
          facing(facing || rules.min_facing_density > 0), per_m2(rules.min_pixels_per_m2 > 0) {
        this->facing |= rules.cos_incidence > 0 && (rules.min_pixel_density > 0 || per_m2);
    }
};

template <class Camera, class Count>
void Scope<Camera, Count>::check(int64_t first, int64_t last) const {
    require_lens(camera);
    const int64_t n_faces = scene.faces.rows(), n = seen.poses.rows();
    scene.check();
    require(points.rows() >= scene.vertices.rows(), "points must have a row for each vertex");
    require(0 <= first && first <= last && last <= n && seen.near.rows() == n,
            "an observation must have one row for each pose");
    const auto has_pairs = [&](const auto &array) {
        return array.shape[0] == n && array.shape[1] == n_faces;
    };
    require(has_pairs(seen.visible) && has_pairs(seen.drawn) &&
                (seen.kind.size() == 0 || has_pairs(seen.kind)) &&
                (seen.area_error.size() == 0 || has_pairs(seen.area_error)),
            "an observation must have one column for each face");
}

// A pose to be judged, and how.
template <class Camera, class Count> struct View {
    const Scene &scene;
    const Camera &camera;
    const Seen<Count> &seen;
    const Rules &rules;
    VertexRows<Camera> points;
    Memory<Camera> &memory;
    Asked asked;
    int64_t row;

    Pose pose() const { return seen.poses[row]; }
    double near() const { return seen.near[row]; }
    int64_t at(int64_t f) const { return row * scene.faces.rows() + f; }
};

// Calls `each` with a view of each of some poses.
template <class Camera, class Count, class Each>
void each_view(int64_t first, int64_t last, const Scope<Camera, Count> &scope, const Rules &rules,
               const Asked &asked, Each each) {
    scope.check(first, last);
    const auto &[scene, camera, seen, points] = scope;
    const auto memory = std::make_unique<Memory<Camera>>();
    for (int64_t row = first; row < last; row++) {
        poll_interrupt();
        each(View<Camera, Count>{scene, camera, seen, rules, points, *memory, asked, row});
    }
}

// Calls `add` for all kinds of cameras and of counts.
template <class Add> void each_kind(Add add) {
    add.template operator()<Lens, double>();
    add.template operator()<Lens, int32_t>();
    add.template operator()<ParallelLens, double>();
    add.template operator()<ParallelLens, int32_t>();
    add.template operator()<CurvedLens, double>();
    add.template operator()<CurvedLens, int32_t>();
}

template <class N, class T> INLINE N area_at(const T *areas, double scale) {
    const N area = read<N>(areas);
    return scale == 1.0 ? area : area / N(scale);
}
// Kinds of the bounds of visible fractions from a face on.
template <class N, class View> INLINE Whole<N> kind_at(int64_t f, const View &view) {
    const auto &kind = view.seen.kind;
    return kind.size() ? read<Whole<N>>(kind.begin() + view.at(f)) : Whole<N>(STATISTICAL);
}
template <class N, class View> INLINE N error_at(int64_t f, const View &view) {
    const auto &error = view.seen.area_error;
    return error.size() ? read<N>(error.begin() + view.at(f)) : N(0.0);
}

template <class View>
constexpr bool IS_PINHOLE = std::is_same_v<std::remove_cvref_t<decltype(View::camera)>, Lens>;
template <class View>
constexpr bool IS_CURVED = std::is_same_v<std::remove_cvref_t<decltype(View::camera)>, CurvedLens>;
template <class Consumer>
constexpr bool ASKS_BOUNDS = requires(Consumer consumer) { consumer.asks_bound(Face<double>()); };
template <class Consumer> constexpr bool ASKS_DECISIONS_ALONE = requires { Consumer::DECISIONS; };

// Measures faces from f on; false, and nothing, for lanes of which one is cut.
// The bound is 1, see put_bound. A face is seen, by definition, not from behind or outside the
// image.
template <class N, class View> INLINE bool measure(int64_t f, const View &view, Face<N> &face) {
    const auto &[scene, camera, seen, rules, points, memory, asked, row] = view;
    if constexpr (std::is_same_v<N, double>)
        finish(scene.faces.begin() + 3 * f, view.near(), camera, points);
    face.corners = corners_of<N>(scene.faces.begin() + 3 * f, points);
    const Corners<N> &corners = face.corners;
    auto &is = face.measures;
    is.visible = area_at<N>(seen.visible.begin() + view.at(f), seen.scale);
    is.drawn = area_at<N>(seen.drawn.begin() + view.at(f), seen.scale);
    FieldOfView<N> field;
    if constexpr (std::is_same_v<N, double>) {
        // A count is no area.
        const double known = seen.kind.size() || !asked.area ? is.drawn : -1.0;
        field = field_of_view(corners, view.near(), camera, memory, known);
    } else {
        field = quick_field_of_view(corners, view.near(), camera);
        if (any(field.is_cut)) return false;
    }
    face.state = field.state;
    face.part = field.part;
    face.area = field.area;
    const Triple<N> normal = rotate(read_triple<N>(scene.normals.begin() + 3 * f), view.pose());
    const Mask<N> is_two_sided = read_mask<N>(scene.two_sided.begin() + f);
    face.cosine = incidence_cosine(corners, normal, is_two_sided, camera);
    is.own = read<Whole<N>>(scene.own.begin() + f);
    is.is_front = (face.cosine > N(0.0)) & !(is.own == Whole<N>(DEGENERATE));
    is.is_inside = face.state == N(INSIDE);
    is.has_part = is.is_inside | !(face.part == N(0.0));
    is.cosine = face.cosine;
    is.is_oblique = exceeds_incidence(face.cosine, rules);
    is.is_focused = in_focus(corners, camera, rules);
    is.density = is.facing = is.per_m2 = 0.0;
    if constexpr (std::is_same_v<N, double> || IS_PINHOLE<View>) // others ask for none in lanes
        put_densities(f, normal, view, face);
    face.bound = 1.0;
    face.kind = select(is.is_front & is.has_part, kind_at<N>(f, view), Whole<N>(EXACT));
    return true;
}

// Derivative of the image at vertex s of faces from f on.
template <class N, class View>
INLINE auto slopes_of(int64_t f, int s, const View &view, const Face<N> &face) {
    const auto &lens = view.camera;
    if constexpr (IS_PINHOLE<View>) {
        const Vertex<N> &at = face.corners[s];
        return Slopes<N>{N(lens.fx), N(lens.fy), at[RIGHT], at[DOWN], at[Z]};
    } else if constexpr (std::is_same_v<std::remove_cvref_t<decltype(lens)>, ParallelLens>) {
        return jacobian(lens, 0.0, 0.0, 0.0);
    } else return slopes_at(view.points, int64_t(view.scene.faces(f, s)), lens);
}

// Pixels a metre along the worst direction and of a facing target, and pixels a square metre, each
// at the worst vertex; 0 where it is not asked for, and for a face not wholly beyond the near
// plane, or not in the valid region of the lens.
template <class N, class View>
INLINE void put_densities(int64_t f, const Triple<N> &normal, const View &view, Face<N> &face) {
    auto &is = face.measures;
    const Mask<N> is_ahead = face.state > N(BEHIND);
    const Mask<N> has_density = is.is_front & is_ahead & (face.part > N(0.0));
    Asked asked = view.asked;
    asked.density = asked.density && any(has_density);
    if (!(asked.density || asked.facing || asked.per_m2) || !any(is_ahead)) return;
    N density = INFINITY;
    N facing_density = INFINITY;
    N pixels_per_m2 = INFINITY;
    unroll<3>(EACH(s) {
        const auto slopes = slopes_of(f, s, view, face);
        if (asked.density) {
            const N here = along(slopes, normal.x, normal.y, normal.z);
            density = select(here >= density, density, here);
        }
        if (asked.facing) facing_density = min(facing(slopes), facing_density);
        if (asked.per_m2)
            pixels_per_m2 = min(per_m2(slopes, normal.x, normal.y, normal.z), pixels_per_m2);
    });
    if (asked.density) is.density = select(has_density, density, N(0.0));
    if (asked.facing) is.facing = select(is_ahead, facing_density, N(0.0));
    if (asked.per_m2) is.per_m2 = select(is_ahead, pixels_per_m2, N(0.0));
}

// True if nothing is drawn of a face for certain: the camera sees it edge-on, exactly, or is behind
// its plane by less than rounding.
template <class View> bool is_surely_unseen(int64_t f, const View &view, const Face<double> &face) {
    return !(face.measures.drawn > 0) &&
           is_edge_on(view.scene, f, face.corners, face.cosine, face.state, view.camera) &&
           !is_on_side(view.scene, f, view.pose(), view.camera);
}

// True if rounding may decide whether a face is seen from the front and in the image.
template <class View> bool is_in_doubt(int64_t f, const View &view, const Face<double> &face) {
    const auto &[scene, camera, seen, rules, points, memory, asked, row] = view;
    const auto &is = face.measures;
    if (!is.has_part && !(is.drawn > 0)) {
        const bool edge_on = is_edge_on(scene, f, face.corners, face.cosine, face.state, camera);
        return (face.cosine > 0 || edge_on) &&
               may_reach_image(face.corners, face.state, view.near(), camera, edge_on);
    }
    const bool is_computed = kind_at<double>(f, view) == EXACT && seen.area_error.size() > 0;
    const double error = error_at<double>(f, view);
    if (is_computed && is.drawn <= error && error > 0) return true;
    if (face.cosine > 0 && (scene.two_sided[f] || !is.has_part)) return !is.has_part;
    return is_edge_on(scene, f, face.corners, face.cosine, face.state, camera);
}

// Puts the bound of the visible fraction of measured faces: 1 where rounding decides which side is
// seen. False, and nothing, for lanes of which one may be edge-on.
template <class N, class View> INLINE bool put_bound(int64_t f, const View &view, Face<N> &face) {
    const auto &is = face.measures;
    const Whole<N> kind = kind_at<N>(f, view);
    const N error = error_at<N>(f, view);
    Mask<N> is_doubtful;
    if constexpr (std::is_same_v<N, double>) {
        if (is_surely_unseen(f, view, face)) {
            face.bound = 0.0;
            return true;
        }
        is_doubtful = is_in_doubt(f, view, face);
    } else {
        const auto &[scene, camera, seen, rules, points, memory, asked, row] = view;
        const Mask<N> is_known =
            is_steep(scene, steepness_of(face.corners, face.cosine, camera), face.state);
        const Mask<N> is_computed =
            seen.area_error.size()
                ? (kind == Whole<N>(EXACT)) & (is.drawn <= error) & (error > N(0.0))
                : Mask<N>{};
        is_doubtful = is_computed;
        if (!all(is_known & is.is_inside)) {
            const Mask<N> faces_camera = face.cosine > N(0.0);
            const Mask<N> is_drawn = is.drawn > N(0.0), is_in = is.has_part | is_drawn;
            const Mask<N> is_sure = read_mask<N>(scene.two_sided.begin() + f) | !is.has_part;
            const Mask<N> is_out =
                is_far_off(face.corners, face.state, view.near(), image_of(camera));
            const Mask<N> is_clear =
                select(is_in, (is_drawn & (is_computed | (faces_camera & is_sure))) | is_known,
                       is_out | (is_known & !faces_camera));
            if (!all(is_clear)) return false;
            is_doubtful = is_in & (is_computed | (faces_camera & !is.has_part));
        }
    }
    const N outline = select(face.state > N(BEHIND), perimeter(face.corners), N(INFINITY));
    const N bound = bound_of_fraction(kind, is.drawn, error, outline, view.seen.samples_per_pixel);
    face.bound = select(is.is_front & is.has_part, bound, N(0.0));
    face.bound = select(is_doubtful, N(1.0), face.bound);
    return true;
}

// Judges faces from f on and hands them to the consumer; false, and nothing, for lanes that must be
// judged one by one.
template <class N, class View, class Consumer>
INLINE bool judge(int64_t f, const View &view, Consumer &consumer) {
    if (consumer.template leaves_out<N>(f)) return true;
    Face<N> face;
    if (!measure(f, view, face)) return false;
    face.decision = decide(view.rules, face.measures, view.camera);
    if constexpr (ASKS_BOUNDS<Consumer>)
        if (consumer.asks_bound(face) && !put_bound(f, view, face)) return false;
    consumer.take(f, face);
    return true;
}

constexpr int64_t LATER = 64; // faces whose counts are on their way from memory meanwhile

// Judges all faces in a pose. Lanes begin at multiples of their number behind `skew`; densities of
// other cameras than pinholes, and all but decisions of curved lenses, one face after another.
template <class View, class Consumer>
void judge_pose(const View &view, int64_t skew, Consumer &consumer) {
    constexpr int W = AT_A_TIME<Doubles>;
    const int64_t n = view.scene.faces.rows();
    const bool in_lanes =
        IS_PINHOLE<View> || !(view.asked.density || view.asked.facing || view.asked.per_m2);
    project(view.scene.vertices, view.pose(), view.near(), view.camera, view.points);
    for (int64_t f = 0; f < n;) {
        const int64_t some = std::min(W - (skew + f) % W, n - f), later = view.at(f) + LATER;
        __builtin_prefetch(view.seen.visible.begin() + later);
        __builtin_prefetch(view.seen.drawn.begin() + later);
        if constexpr (!IS_CURVED<View> || ASKS_DECISIONS_ALONE<Consumer>) {
            if (in_lanes && some == W && judge<Doubles>(f, view, consumer)) {
                f += W;
                continue;
            }
        }
        for (const int64_t end = f + some; f < end; f++) judge<double>(f, view, consumer);
    }
}

} // namespace coverage

RECORD(coverage::Scene, vertices, faces, normals, own, two_sided, offsets, reach, doubtful_cosine);
template <class Count> struct Record<coverage::Seen<Count>> {
    using S = coverage::Seen<Count>;
    static constexpr auto fields = Fields<&S::poses, &S::near, &S::visible, &S::drawn, &S::scale,
                                          &S::kind, &S::area_error, &S::samples_per_pixel>();
};
template <class Camera, class Count> struct Record<coverage::Scope<Camera, Count>> {
    using S = coverage::Scope<Camera, Count>;
    static constexpr auto fields = Fields<&S::scene, &S::camera, &S::seen, &S::points>();
};

} // namespace rastercov
