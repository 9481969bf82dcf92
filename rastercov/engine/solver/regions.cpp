// Steps by which regions are cut, and regions of several planes as one.
//
// Twins: tests/area/test_regions.py, tests/area/test_lens_regions.py.
#include "solver/regions.hpp"
#include "sort.hpp"

namespace rastercov::engine {

namespace {
constexpr int64_t FIRST_PIECES = 1024, FIRST_CORNERS = 8192;

template <class T> void append(std::vector<T> &all, const std::vector<T> &more) {
    all.insert(all.end(), more.begin(), more.end());
}
} // namespace

Regions copy_regions(const area::Found &found) {
    Regions out;
    const int64_t n = found.used[0];
    out.xy.assign(found.xy.data, found.xy.data + 2 * found.used[1]);
    out.face.assign(found.face.data, found.face.data + n);
    out.n_corners.resize(size_t(n));
    for (int64_t p = 0; p < n; p++)
        out.n_corners[size_t(p)] = found.starts[p + 1] - found.starts[p];
    for (int64_t f = 0; f < found.area.rows(); f++) {
        if (!(found.area[f] > 0 || found.bound[f] > 0)) continue;
        out.listed.push_back(int32_t(f));
        out.area.push_back(found.area[f]);
        out.bound.push_back(found.bound[f]);
        out.excess.push_back(found.bound[f] - found.doubt[f]);
    }
    out.cut_short = {found.cut_short[0]};
    return out;
}

void RegionCutter::make(Room2 &room, int64_t n, int64_t corners, int64_t n_faces) {
    room.xy.take(2 * corners);
    room.starts.take(n + 1);
    room.starts.fill(0);
    room.face.take(n);
    room.area.take(n_faces);
    room.bound.take(n_faces);
    room.doubt.take(n_faces);
    room.found = {room.xy.rows<2>(corners), room.starts.all(),     room.face.all(),
                  {room.used, {2}},         room.area.all(),       room.bound.all(),
                  room.doubt.all(),         {&room.cut_short, {1}}};
}

// What a step finds, with more room as it needs it.
template <class Step>
const area::Found &RegionCutter::run(Room2 &room, int64_t n_faces, Step step) {
    if (room.area.size() != n_faces)
        make(room, first_room(FIRST_PIECES), first_room(FIRST_CORNERS), n_faces);
    while (true) {
        step(room.found);
        if (room.used[0] <= room.face.size() && 2 * room.used[1] <= room.xy.size())
            return room.found;
        make(room, more_room(room.used[0]), more_room(room.used[1]), n_faces);
    }
}

void RegionCutter::cut(const PlaneSolver &solved, const area::Planes &planes,
                       const area::LensCriteria &given, bool is_lens, std::vector<Regions> &out) {
    const exact::Pinhole &camera = solved.camera();
    const exact::Projected &image = solved.image().everything();
    const double diagonal = solved.surface().diagonal();
    const area::Seen seen = {
        camera.rotation,          camera.centre,       camera.near,
        solved.surface().place(), image.state,         image.side,
        solved.areas().visible,   solved.areas().area, solved.areas().area_error,
        solved.is_certified(),    solved.kept()};
    area::LensCriteria criteria = given;
    criteria.pinhole.gap = given.pinhole.gap * diagonal;
    criteria.pinhole.pixel_error = camera.pixel_error;
    criteria.pinhole.is_parallel = camera.is_parallel();
    criteria.gap = given.gap * diagonal;
    const int64_t n_faces = planes.areas.rows();
    const area::Found *found = &run(_rooms[0], n_faces, [&](const area::Found &into) {
        area::cut_regions(planes, criteria.pinhole, seen, into);
    });
    int slot = 0;
    const auto then = [&](area::Step step) {
        slot = 1 - slot;
        const area::Found &source = *found;
        found = &run(_rooms[slot], n_faces, [&](const area::Found &into) {
            area::cut_pieces(planes, criteria, seen, source, step, into);
        });
    };
    if (is_lens) {
        const Rules &rules = criteria.rules;
        if (criteria.by_distance && rules.z_f < area::INF) then(area::TO_DISCS);
        then(area::TO_VIEW);
        const double densest =
            std::max({rules.min_pixels_per_m2, rules.min_pixel_density, rules.min_facing_density});
        if (densest > 0 || (criteria.by_distance && rules.z_n > 0)) then(area::TO_DENSITIES);
    }
    out.push_back(copy_regions(*found));
}

Regions join_regions(std::vector<Regions> parts, const area::Planes &planes) {
    if (parts.empty()) return {};
    if (parts.size() == 1) return std::move(parts[0]);
    Regions all;
    std::vector<int32_t> face;
    std::vector<int64_t> n_corners, starts = {0};
    std::vector<double> xy;
    for (const Regions &part : parts) {
        append(xy, part.xy);
        append(face, part.face);
        append(n_corners, part.n_corners);
        append(all.cut_short, part.cut_short);
        append(all.listed, part.listed);
    }
    for (const int64_t n : n_corners) starts.push_back(starts.back() + n);
    for (const int64_t p : order_of(face)) {
        const auto at = size_t(p);
        all.face.push_back(face[at]);
        all.n_corners.push_back(n_corners[at]);
        all.xy.insert(all.xy.end(), xy.begin() + 2 * starts[at], xy.begin() + 2 * starts[at + 1]);
    }
    sort_range(all.listed.begin(), all.listed.end());
    all.listed.erase(std::unique(all.listed.begin(), all.listed.end()), all.listed.end());
    const size_t n = all.listed.size();
    all.area.assign(n, 0.0);
    all.bound.assign(n, 0.0);
    all.excess.assign(n, 0.0);
    for (const Regions &part : parts)
        for (size_t k = 0; k < part.listed.size(); k++) {
            const auto found =
                std::lower_bound(all.listed.begin(), all.listed.end(), part.listed[k]);
            const auto row = size_t(found - all.listed.begin());
            all.area[row] += part.area[k];
            all.bound[row] += part.bound[k];
            all.excess[row] += part.excess[k];
        }
    for (size_t row = 0; row < n; row++) {
        const double whole = planes.areas[all.listed[row]];
        all.bound[row] = std::min(all.bound[row], whole);
        all.excess[row] = std::min(all.excess[row], whole);
    }
    return all;
}

} // namespace rastercov::engine
