// Incremental gains while single candidates are added to a selection and removed.
//
// The gain of a candidate is the worth that choosing it next would add. When a face changes its
// state, the gains of exactly the candidates that cover it change. There is one pass over all
// pairs, at the start; a later step costs only the pairs it touches. Gains are integers: adding and
// removing a camera restores them exactly, in any order of summation.
//
// The progress of a face is min(cameras that cover it, `views`), plus one where an angle is
// required and two of their rays differ by it; at `need` the face is covered. Progress p is worth
//
//     step * p, and `bonus` more at p = need.
//
// A candidate is one camera, or a rig of several that are added and removed one after the other;
// the cameras of a rig are consecutive, and so are their pairs with a face: a run.
//
// A call touches a small part of the lists, so indices are checked where they are used.
//
// Twins: tests/placement/test_selection.py and test_lazy_selection.py, by dense arrays.
#include "bind.hpp"
#include "coverage/spread.hpp"
#include "interrupt.hpp"
#include <algorithm>
#include <array>

namespace rastercov {
namespace placement {
namespace {

using coverage::Rays;
using Limits = IntArray;
using Indices = Int32Array;
using Weights = IntArray;
using Gains = Array<const int64_t, Any, Any>; // of each candidate, by kind of face

// Worth of progress; unsigned, so that a sum or difference beyond 64 bits wraps.
using Worth = uint64_t;

// Pairs of K cameras and F faces, both ways, and the candidate of each camera, ascending.
struct Lists {
    Limits indptr;
    Indices face;
    Limits starts;
    Indices cameras, owner;

    int64_t n_cameras() const { return owner.rows(); }
    int64_t n_faces() const { return starts.rows() - 1; }
};

struct Faces { // what each face asks for, and its kind: the innermost requirement it counts towards
    Indices views, need;
    Weights step, bonus;
    Indices kind;
    Weights weights;

    // Worth of the progress of a face that n cameras cover.
    Worth worth(int64_t f, int64_t n, bool is_spread) const {
        const int64_t progress = std::min<int64_t>(n, views[f]) + is_spread;
        return Worth(progress) * Worth(step[f]) + (progress >= need[f] ? Worth(bonus[f]) : 0);
    }
};

struct State {                     // of a selection
    Column<int32_t> count;         // chosen cameras that cover each face
    Array<int64_t, Any, Any> gain; // of each candidate, by kind of face
    Column<int64_t> done;          // weight of the covered faces, by kind
    Array<int64_t, 1> total;       // worth of the progress of all faces
};

struct Seen {
    Array<int32_t, Any, Any> cameras; // that cover each face, the first `count` of them
    Column<bool> is_spread;           // where the rays to two of these differ by the angle
};

bool is_below(int64_t i, int64_t n) { return uint64_t(i) < uint64_t(n); }
void add_to(int64_t &sum, Worth amount) { sum = int64_t(Worth(sum) + amount); }

void require_lists(const Lists &lists) {
    require(lists.indptr.rows() == lists.n_cameras() + 1 && lists.starts.rows() > 0,
            "indptr must have one row for each camera, and one more, starts one for each face");
}

void require_faces(const Faces &faces, int64_t n) {
    require(
        have_rows(n, faces.views, faces.need, faces.step, faces.bonus, faces.kind, faces.weights),
        "views, need, step, bonus, kind and weights must have one row for each face");
}

void require_state(const State &state, int64_t n_faces) {
    require(state.count.rows() == n_faces && state.done.rows() == state.gain.extent(1),
            "count must have one row for each face, done one for each column of gain");
}

void require_rays(const Rays &rays, int64_t n_cameras, int64_t n_faces) {
    require(rays.eyes.rows() == n_cameras && rays.centroids.rows() == n_faces,
            "eyes must have one row for each camera, centroids one for each face");
}

struct Range {
    int64_t first, last;
};

Range row_of(Limits limits, int64_t row, int64_t pairs) {
    const Range range = {limits[row], limits[row + 1]};
    require(0 <= range.first && range.first <= range.last && range.last <= pairs,
            "limits of rows must rise, within the pairs");
    return range;
}

int64_t face_of(const Lists &lists, int64_t j) {
    require(is_below(lists.face[j], lists.n_faces()), "face must hold faces");
    return lists.face[j];
}

// Calls visit(candidate, first, last) for the run of each candidate that covers a face.
template <class Visit>
void each_run(Limits starts, Indices cameras, Indices owner, int64_t candidates, int64_t f,
              Visit visit) {
    const Range range = row_of(starts, f, cameras.rows());
    const auto owner_of = [&](int64_t i) {
        require(is_below(cameras[i], owner.rows()), "cameras must hold cameras");
        return owner[cameras[i]];
    };
    const bool has_rigs = owner.rows() > candidates;
    for (int64_t i = range.first, end; i < range.last; i = end) {
        const int32_t candidate = owner_of(i);
        require(is_below(candidate, candidates), "owner must hold candidates");
        end = i + 1;
        while (has_rigs && end < range.last && owner_of(end) == candidate) end++;
        visit(candidate, i, end);
    }
}

void first_gains(const Lists &lists, const Faces &faces, const Rays &rays,
                 Array<int64_t, Any, Any> gain) {
    const int64_t n_faces = lists.n_faces();
    require_lists(lists);
    require_faces(faces, n_faces);
    Poll poll(64);
    for (int64_t f = 0; f < n_faces; f++) {
        poll();
        const bool is_angled = faces.need[f] > faces.views[f];
        if (is_angled) require_rays(rays, lists.n_cameras(), n_faces);
        require(is_below(faces.kind[f], gain.extent(1)), "kind must hold columns of gain");
        const Worth nothing = faces.worth(f, 0, false);
        each_run(lists.starts, lists.cameras, lists.owner, gain.rows(), f,
                 [&](int64_t candidate, int64_t first, int64_t last) {
                     const bool is_spread =
                         is_angled && rays.any_differ(lists.cameras, first, last, f);
                     add_to(gain(candidate, faces.kind[f]),
                            faces.worth(f, last - first, is_spread) - nothing);
                 });
    }
}

// Work of a change of a camera: `visit(face, number of cameras before)` gives that of each face.
template <class Visit>
int64_t change_faces(int64_t row, int64_t sign, const Lists &lists, const Faces &faces,
                     const State &state, Visit visit) {
    require_lists(lists);
    require_faces(faces, lists.n_faces());
    require_state(state, lists.n_faces());
    require(is_below(row, lists.n_cameras()), "row must be a camera");
    require(sign == 1 || sign == -1, "sign must be 1 or -1");
    const Range range = row_of(lists.indptr, row, lists.face.rows());
    int64_t work = range.last - range.first;
    for (int64_t j = range.first; j < range.last; j++) {
        const int64_t f = face_of(lists, j);
        require(is_below(faces.kind[f], state.done.rows()), "kind must hold columns of gain");
        work += visit(f, int64_t(state.count[f]));
    }
    return work;
}

int64_t change(int64_t row, int64_t sign, const Lists &lists, const Faces &faces,
               const State &state) {
    const int64_t candidates = state.gain.rows();
    const bool has_rigs = lists.n_cameras() > candidates;
    return change_faces(row, sign, lists, faces, state, [&](int64_t f, int64_t old) -> int64_t {
        const int64_t wanted = faces.need[f], now = old + sign, kind = faces.kind[f];
        const auto worth = [&](int64_t n) { return faces.worth(f, n, false); };
        state.count[f] = int32_t(now);
        if (std::min(old, now) >= wanted) return 0;
        const Worth before = worth(old), here = worth(now);
        add_to(state.total[0], here - before);
        if ((old >= wanted) != (now >= wanted))
            add_to(state.done[kind], Worth(sign) * Worth(faces.weights[f]));
        const Range range = row_of(lists.starts, f, lists.cameras.rows());
        if (has_rigs) {
            each_run(lists.starts, lists.cameras, lists.owner, candidates, f,
                     [&](int64_t candidate, int64_t first, int64_t last) {
                         const Worth added = worth(now + last - first) - here;
                         const Worth was = worth(old + last - first) - before;
                         add_to(state.gain(candidate, kind), added - was);
                     });
            return range.last - range.first;
        }
        const Worth amount = before - here + worth(now + 1) - worth(old + 1);
        if (amount == 0) return 0;
        for (int64_t i = range.first; i < range.last; i++) {
            const int64_t camera = lists.cameras[i];
            require(is_below(camera, candidates), "cameras must hold cameras");
            add_to(state.gain(camera, kind), amount);
        }
        return range.last - range.first;
    });
}

// A face before and after a camera is added, `sign` 1, or removed, -1: the number of its cameras,
// and whether the rays to two of them differ.
struct Step {
    int64_t sign, old, now;
    bool was_spread, is_spread;

    // Change of the worth of the face.
    Worth change(const Faces &faces, int64_t f) const {
        return faces.worth(f, now, is_spread) - faces.worth(f, old, was_spread);
    }
    // Change of the gain of n further cameras: far from none, from this one only, from others.
    std::array<Worth, 3> amounts(const Faces &faces, int64_t f, int64_t n) const {
        std::array<Worth, 3> amounts;
        for (int which = 0; which < 3; which++) {
            const bool far_before = which == 2 || (which == 1 && sign < 0);
            const bool far_after = which == 2 || (which == 1 && sign > 0);
            amounts[size_t(which)] = faces.worth(f, now + n, is_spread || far_after) -
                                     faces.worth(f, old + n, was_spread || far_before) -
                                     change(faces, f);
        }
        return amounts;
    }
};

// Adds a camera to those that cover a face, or removes it.
Step step_of(int64_t f, int64_t row, int64_t sign, int64_t old, const Rays &rays,
             const Seen &seen) {
    const auto others = seen.cameras[f];
    bool &is_spread = seen.is_spread[f];
    const bool was_spread = is_spread;
    const int64_t now = old + sign;
    require(std::min(old, now) >= 0 && std::max(old, now) <= others.rows(),
            "count must be that of seen");
    for (int64_t i = 0; i < old; i++)
        require(is_below(others[i], rays.eyes.rows()), "seen must hold cameras");
    if (sign > 0) {
        is_spread = was_spread || rays.differs_from_any(row, others, old, f);
        others[old] = int32_t(row);
    } else {
        int64_t at = 0;
        while (at < old && others[at] != row) at++;
        require(at < old, "seen must hold the camera that is removed");
        for (int64_t later = at; later < now; later++) others[later] = others[later + 1];
        if (was_spread) is_spread = rays.any_differ(others, 0, now, f);
    }
    return {sign, old, now, was_spread, is_spread};
}

// Changes the gains of the candidates that cover a face by a step of camera `row`.
void change_gains(int64_t f, int64_t row, const Step &step, const Lists &lists, const Faces &faces,
                  const State &state, const Rays &rays, const Seen &seen) {
    const auto others = seen.cameras[f];
    const int64_t n_rest = std::min(step.old, step.now);
    int64_t n = 1;
    std::array<Worth, 3> amounts = step.amounts(faces, f, n);
    each_run(lists.starts, lists.cameras, lists.owner, state.gain.rows(), f,
             [&](int64_t candidate, int64_t first, int64_t last) {
                 if (last - first != n) {
                     n = last - first;
                     amounts = step.amounts(faces, f, n);
                 }
                 int64_t &gain = state.gain(candidate, faces.kind[f]);
                 if (amounts[0] == amounts[1] && amounts[1] == amounts[2])
                     return add_to(gain, amounts[0]); // wherever its cameras are
                 const auto differs = [&](auto is_far_from) {
                     return std::any_of(lists.cameras.begin() + first, lists.cameras.begin() + last,
                                        is_far_from);
                 };
                 // Where the rays differ already, those of a further candidate add nothing.
                 const bool is_far = (step.was_spread && step.is_spread) ||
                                     (n > 1 && rays.any_differ(lists.cameras, first, last, f)) ||
                                     differs([&](int64_t camera) {
                                         return rays.differs_from_any(camera, others, n_rest, f);
                                     });
                 const bool is_far_of_all =
                     is_far || step.was_spread || step.is_spread ||
                     differs([&](int64_t camera) { return rays.differ(camera, row, f); });
                 add_to(gain, amounts[size_t(is_far) + is_far_of_all]);
             });
}

int64_t change_spread(int64_t row, int64_t sign, const Lists &lists, const Faces &faces,
                      const State &state, const Rays &rays, const Seen &seen) {
    require_rays(rays, lists.n_cameras(), lists.n_faces());
    require(have_rows(lists.n_faces(), seen.cameras, seen.is_spread),
            "seen and is_spread must have one row for each face");
    return change_faces(row, sign, lists, faces, state, [&](int64_t f, int64_t old) -> int64_t {
        const Step step = step_of(f, row, sign, old, rays, seen);
        state.count[f] = int32_t(step.now);
        const int64_t views = faces.views[f], need = faces.need[f];
        const bool was_done = std::min(old, views) + step.was_spread >= need;
        const bool is_done = std::min(step.now, views) + step.is_spread >= need;
        if (was_done && is_done) return 0;
        add_to(state.total[0], step.change(faces, f));
        if (was_done != is_done)
            add_to(state.done[faces.kind[f]], Worth(sign) * Worth(faces.weights[f]));
        change_gains(f, row, step, lists, faces, state, rays, seen);
        const Range range = row_of(lists.starts, f, lists.cameras.rows());
        return (range.last - range.first) * (old + 1);
    });
}

struct Choice {
    Gains gain;
    Weights ends; // requirement g is of kinds g ... ends[g] - 1
    Weights room; // upper limit of the gain that counts, by requirement
    FloatArray costs;
    Column<const uint8_t> barred;
    double most_cost;
    bool by_cost;

    void check() const {
        const int64_t n = gain.extent(1);
        require(have_rows(gain.rows(), costs, barred) && have_rows(n, ends, room),
                "costs and barred must have one row for each candidate, ends and room for each "
                "column of gain");
        for (const int64_t end : ends) require(end <= n, "ends must be within the columns of gain");
    }

    // Gain of a candidate that counts, or gain by cost; 0 where it cannot be chosen.
    double score(int64_t c) const {
        constexpr double LEAST_COST = 1e-12;
        if (barred[c] || costs[c] > most_cost) return 0.0;
        Worth worth = 0;
        for (int64_t g = 0; g < room.rows(); g++) {
            Worth own = 0;
            for (int64_t kind = g; kind < ends[g]; kind++) own += Worth(gain(c, kind));
            worth += Worth(std::min(int64_t(own), room[g]));
        }
        if (int64_t(worth) <= 0) return 0.0;
        return double(int64_t(worth)) / (by_cost ? std::max(costs[c], LEAST_COST) : 1.0);
    }
};

void scores(Gains gain, Weights ends, Weights room, FloatArray costs, Column<const uint8_t> barred,
            double most_cost, bool by_cost, Column<double> found) {
    const Choice choice = {gain, ends, room, costs, barred, most_cost, by_cost};
    choice.check();
    require(found.rows() == gain.rows(), "found must have one row for each candidate");
    for (int64_t c = 0; c < gain.rows(); c++) found[c] = choice.score(c);
}

int64_t next_camera(Gains gain, Weights ends, Weights room, FloatArray costs, Weights rank,
                    Column<const uint8_t> barred, double most_cost, bool by_cost) {
    const Choice choice = {gain, ends, room, costs, barred, most_cost, by_cost};
    choice.check();
    require(rank.rows() == gain.rows(), "rank must have one row for each candidate");
    int64_t best = -1;
    double best_score = 0.0;
    for (int64_t c = 0; c < gain.rows(); c++) {
        const double score = choice.score(c);
        if (score > best_score || (score == best_score && best >= 0 && rank[c] < rank[best])) {
            best = c;
            best_score = score;
        }
    }
    return best;
}

void missing_directions(Limits starts, Indices cameras, Indices owner, BoolArray is_chosen,
                        Weights views, const Rays &rays, Column<int64_t> ends,
                        Column<int32_t> found) {
    const int64_t n_faces = starts.rows() - 1;
    require(n_faces >= 0 && ends.rows() == n_faces + 1 && views.rows() == n_faces &&
                found.rows() == cameras.rows(),
            "starts and ends must have one row for each face and one more, views one for each, "
            "found one for each pair");
    require_rays(rays, owner.rows(), n_faces);
    std::vector<int32_t> close; // cameras around the chosen ones of which no two differ
    const auto each = [&](int64_t f, auto visit) {
        each_run(starts, cameras, owner, is_chosen.rows(), f, visit);
    };
    int64_t n_found = 0;
    ends[0] = 0;
    Poll poll(64);
    for (int64_t f = 0; f < n_faces; f++) {
        poll();
        close.clear();
        const auto add = [&](int64_t first, int64_t last) {
            for (int64_t i = first; i < last; i++) close.push_back(cameras[i]);
        };
        each(f, [&](int64_t candidate, int64_t first, int64_t last) {
            if (is_chosen[candidate]) add(first, last);
        });
        const auto n = int64_t(close.size());
        if (n >= views[f] && !rays.any_differ(close, 0, n, f))
            each(f, [&](int64_t candidate, int64_t first, int64_t last) {
                if (is_chosen[candidate]) return;
                bool is_far = rays.any_differ(cameras, first, last, f);
                for (int64_t i = first; i < last && !is_far; i++)
                    is_far = rays.differs_from_any(cameras[i], close, int64_t(close.size()), f);
                if (!is_far) return add(first, last);
                require(n_found < found.rows(), "starts must not overlap");
                found[n_found++] = int32_t(candidate);
            });
        ends[f + 1] = n_found;
    }
}

} // namespace
} // namespace placement

RECORD(placement::Lists, indptr, face, starts, cameras, owner);
RECORD(placement::Faces, views, need, step, bonus, kind, weights);
RECORD(placement::State, count, gain, done, total);
RECORD(placement::Seen, cameras, is_spread);

void register_placement_selection(nanobind::module_ &m) {
    using namespace placement;
    def(m, "first_gains", first_gains,
        "Add the gain of each candidate as the first one to `gain`, (C, G), which is 0.", "lists",
        "faces", "rays", "gain");
    def(m, "change", change,
        "Add (sign 1) or remove (-1) a camera, where any two rays will do; the work it took.\n\n"
        "`views` and `need` of the faces are equal here.",
        "row", "sign", "lists", "faces", "state");
    def(m, "change_spread", change_spread,
        "Add or remove a camera as `change`, where rays to two cameras of a face must differ.",
        "row", "sign", "lists", "faces", "state", "rays", "seen");
    def(m, "scores", scores,
        "Set `found`, (C,), to the gain of each candidate that counts, or gain by cost.\n\n"
        "`room`, (G,), is the greatest gain that counts, by requirement; requirement g is of the\n"
        "columns g ... `ends[g]` - 1. Barred candidates, and those above `most_cost`, have 0.",
        "gain", "ends", "room", "costs", "barred", "most_cost", "by_cost", "found");
    def(m, "next_camera", next_camera,
        "Candidate with the greatest of `scores`; ties by rank, (C,); -1 for none.", "gain", "ends",
        "room", "costs", "rank", "barred", "most_cost", "by_cost");
    def(m, "missing_directions", missing_directions,
        "Set candidates of which a face needs one, where the chosen see it from one direction.\n\n"
        "`ends`, (F + 1,), are row limits by face, `found` all candidates that cover it, except a\n"
        "maximal set around the chosen ones of which no two cameras differ by the angle. Faces\n"
        "with fewer chosen cameras than their `views` are skipped.",
        "starts", "cameras", "owner", "is_chosen", "views", "rays", "ends", "found");
}

} // namespace rastercov
