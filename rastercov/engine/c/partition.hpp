// The parts of a union with their memory, for calls of C that take them further.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "area/polygon.hpp"
#include "c/objects.hpp"
#include <algorithm>

namespace rastercov::c {

// The parts of a union, with their memory.
struct Partition {
    std::vector<double> xy, area;
    std::vector<int64_t> starts, tag;
    std::vector<int32_t> face;

    explicit Partition(const engine::Union &from) {
        const auto [n, n_corners] = from.size();
        xy.resize(size_t(2 * n_corners));
        starts.resize(size_t(n + 1));
        area.resize(size_t(n));
        tag.resize(size_t(n));
        face.resize(size_t(n));
        from.write(points(), {starts.data(), {n + 1}}, {face.data(), {n}}, {tag.data(), {n}},
                   {area.data(), {n}});
    }
    area::Points points() { return {xy.data(), {int64_t(xy.size() / 2), 2}}; }
    int64_t size() const { return int64_t(face.size()); }
    // Keeps the parts that a test chooses.
    template <class Test> void keep(Test test) {
        int64_t n = 0;
        int64_t at = 0;
        for (int64_t p = 0; p < size(); p++) {
            if (!test(p)) continue;
            const int64_t first = starts[size_t(p)], count = starts[size_t(p + 1)] - first;
            std::copy_n(xy.begin() + 2 * first, 2 * count, xy.begin() + 2 * at);
            face[size_t(n)] = face[size_t(p)];
            tag[size_t(n)] = tag[size_t(p)];
            area[size_t(n)] = area[size_t(p)];
            starts[size_t(n++)] = at;
            at += count;
        }
        starts.resize(size_t(n + 1));
        starts[size_t(n)] = at;
        xy.resize(size_t(2 * at));
        face.resize(size_t(n));
        tag.resize(size_t(n));
        area.resize(size_t(n));
    }
    engine::RegionPieces pieces(const std::vector<int32_t> &pose) {
        return {points(),
                {starts.data(), {size() + 1}},
                {face.data(), {size()}},
                {pose.data(), {size()}}};
    }
};

// Distance outside a piece up to which a point counts as inside, relative to the diagonal.
constexpr double SLACK_REL = 1e-9;
// An empty union, counting up to some views, or of sets for 0.
std::shared_ptr<UnionObject> union_of(const std::shared_ptr<const SurfaceObject> &surface,
                                      int64_t views);
// The union of one view more, with a further pose that covers all evaluated faces.
std::shared_ptr<UnionObject> complete_union(const UnionObject &from);
// Adds what a union covers by `views` poses or more, or by fewer than -views, as a bit of sets.
void add_set(engine::Union &sets, const engine::Union &more, int64_t views, int64_t bit);

} // namespace rastercov::c
