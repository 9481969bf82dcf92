// The poses that cover most together, chosen one after another, for C.
//
// What a pose adds never grows as others are chosen: a last gain that is still the largest after it
// is found again is that of the best pose.
//
// M. Minoux. Accelerated Greedy Algorithms for Maximizing Submodular Set Functions. 1978.
//
// Twin: tests/native/test_c_border.py.
#include "c/objects.hpp"
#include "c/rule.hpp"
#include "interrupt.hpp"
#include <algorithm>
#include <queue>
#include <tuple>

namespace rastercov::c {
namespace {
using engine::Regions;

class Greedy {
  public:
    Greedy(const SurfaceObject &surface, std::vector<const Regions *> poses, const int32_t *views)
        : _surface(surface), _poses(std::move(poses)), _worth(surface.mesh.n_faces(), 0.0),
          _views(surface.mesh.n_faces(), 1) {
        if (views) std::copy_n(views, _views.size(), _views.begin());
        for (const int32_t each : _views) {
            expect(each >= 1 && each <= MOST_VIEWS, "views of 1 to 10000", each,
                   "pass the poses that each face needs");
            _most = std::max<int64_t>(_most, each);
        }
    }

    // Area that a pose adds to those chosen, counted up to the views of each face; it may join
    // them.
    double add(int64_t pose, bool joins) {
        const Regions &own = *_poses[size_t(pose)];
        engine::Room<bool> asked(_worth.size(), false);
        for (const int32_t f : own.listed) asked[f] = true;
        std::vector<Regions> some;
        for (const Regions *each : _chosen)
            some.push_back(choose_regions(*each, [&](int32_t f) { return asked[f]; }));
        std::vector<const Regions *> all;
        for (const Regions &each : some) all.push_back(&each);
        all.push_back(&own);
        const area::Planes planes = _surface.mesh.arrays->planes();
        engine::Union together({planes.corners, planes.areas}, FLOOR_REL * _surface.mesh.diagonal,
                               _most);
        add_poses(together, all);
        const engine::Room<double> areas = together.areas(_most);
        double gain = 0.0;
        for (const int32_t f : own.listed) {
            double worth = 0.0;
            for (int64_t k = 0; k < _views[f]; k++) worth += areas[k * _worth.size() + f];
            gain += worth - _worth[f];
            if (joins) _worth[f] = worth;
        }
        if (joins) _chosen.push_back(&own);
        return gain;
    }

    // Area of a pose alone.
    double alone(int64_t pose) const {
        double sum = 0.0;
        for (const double each : _poses[size_t(pose)]->area) sum += each;
        return sum;
    }

  private:
    const SurfaceObject &_surface;
    std::vector<const Regions *> _poses, _chosen;
    engine::Room<double> _worth; // of each face, by those chosen
    engine::Room<int32_t> _views;
    int64_t _most = 1;
};

} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_place(const rc_regions *const *regions, int64_t n, const rc_search *search,
                   rc_go_on go_on, void *context, int64_t *chosen, double *gains,
                   int64_t *n_chosen) {
    return guard("choosing poses", [&] {
        const RegionsList all(regions, n);
        expect_arrays("search, chosen, gains and n_chosen", search, chosen, gains, n_chosen);
        expect(search->size == sizeof(rc_search), "size of sizeof(rc_search) bytes", search->size,
               "set it, and compile against the header of the library");
        const auto n_poses = int64_t(all.poses.size());
        expect(search->n_given >= 0 && search->n_given <= n_poses, "n_given of 0 to all poses",
               search->n_given, "pass how many are there already");
        expect(search->most >= 1, "1 pose or more to choose", search->most, "pass how many");
        expect(search->least >= 0, "least of 0 m^2 or more", search->least, "pass 0 for any gain");
        if (n_poses == 0) {
            *n_chosen = 0;
            return;
        }
        if (search->views) check_faces(*all.surface, search->n_faces);
        Greedy greedy(*all.surface, all.poses, search->views);
        for (int64_t pose = 0; pose < search->n_given; pose++) greedy.add(pose, true);
        // The greatest gain that a pose may have, the first of equal ones, and how many were chosen
        // when it was found.
        std::priority_queue<std::tuple<double, int64_t, int64_t>> open;
        for (int64_t pose = search->n_given; pose < n_poses; pose++)
            open.emplace(greedy.alone(pose), -pose, -1);
        *n_chosen = 0;
        while (*n_chosen < search->most && !open.empty()) {
            const auto [gain, pose, when] = open.top();
            if (!(gain > search->least)) break;
            open.pop();
            if (when == *n_chosen) {
                greedy.add(-pose, true);
                chosen[*n_chosen] = -pose;
                gains[(*n_chosen)++] = gain;
            } else {
                if (go_on && go_on(context) == 0) throw Interrupted();
                open.emplace(greedy.add(-pose, false), pose, *n_chosen);
            }
        }
    });
}
