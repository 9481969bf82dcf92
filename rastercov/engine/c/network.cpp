// Networks for C: cameras of a surface together, and the dead zones that they leave, with the
// reason of each.
//
// A part that no camera covers has the smallest set of criteria without which one covers it; of
// equal ones the first in the order of rastercov.core.area.stages, which says more.
//
// Twins: rastercov.core.area.stages, rastercov.core.area.zones, by tests/native/test_c_border.py.
#include "area/reason.hpp"
#include "area/zone.hpp"
#include "c/partition.hpp"
#include "c/rule.hpp"
#include <bit>

namespace rastercov::c {
namespace {
using engine::Regions;
using RegionsPointer = std::shared_ptr<const RegionsObject>;
using Mask = engine::Room<bool>;

constexpr double LARGEST_SIDE = 131072; // of an image, pixels
// Results that are kept beyond those of the last two questions, and solvers of cameras.
constexpr size_t MOST_KEPT = 256, MOST_SOLVERS = 16;
// Height over a plane that is rounding, relative to distances from the origin.
constexpr double ROUNDING_REL = 1e-15;

// Criteria that are not asked; of steep views densities are at the angle that is allowed.
struct Stage {
    uint32_t bits = 0;
    bool is_steep = false;
};

struct Station {
    rc_camera camera;
    LensPointer lens;
    rc_task task;
    std::array<double, 16> pose;
};

// A rule with its own memory.
struct Gate {
    rc_gate given;
    size_t n_devices;
    std::vector<uint8_t> needs, stripes;
    std::vector<double> noise;

    Gate(const rc_gate &gate, size_t n) : given(gate), n_devices(n) {
        if (gate.needs) needs.assign(gate.needs, gate.needs + n);
        if (gate.stripes) stripes.assign(gate.stripes, gate.stripes + n);
        if (gate.noise) noise.assign(gate.noise, gate.noise + n);
    }
    rc_gate without(uint32_t bits) const {
        rc_gate gate = given;
        gate.needs = needs.empty() ? nullptr : needs.data();
        gate.stripes = stripes.empty() ? nullptr : stripes.data();
        gate.noise = noise.empty() ? nullptr : noise.data();
        if (bits & area::IS_UNCERTAIN) gate.most_deviation = 0.0;
        if (bits & area::IS_AT_ANGLE) {
            gate.least_deg = 0.0;
            gate.most_deg = 180.0;
        }
        return gate;
    }
    bool has_angles() const { return given.least_deg > 0.0 || given.most_deg < 180.0; }
    bool sees(const std::vector<int> &sides, size_t first, int side) const {
        int64_t n = 0;
        bool has_needed = true;
        for (size_t d = 0; d < n_devices; d++) {
            const bool is_there = sides[first + d] == side;
            n += is_there;
            has_needed &= is_there || needs.empty() || !needs[d];
        }
        return n >= given.k && has_needed;
    }
};

// A camera, or those of a rig that measure together.
struct Row {
    size_t first, n;
    std::shared_ptr<const Gate> gate; // none of a camera alone
};

// The camera with the largest image that one may have; of a lens, that which it has.
rc_camera widest(const Station &station) {
    rc_camera camera = station.camera;
    if (station.lens) return camera;
    const auto widen = [](double &side, double &middle) {
        const double more = std::floor((LARGEST_SIDE - side) / 2);
        side += 2 * more;
        middle += more;
    };
    widen(camera.width, camera.cx);
    widen(camera.height, camera.cy);
    return camera;
}

// Thresholds without the criteria of a stage, as rastercov.core.coverage.task.Rules.without.
rc_task without(const Station &station, const Stage &stage) {
    rc_task task = station.task;
    if (stage.is_steep && task.max_incidence_deg < 90.0) {
        const Rules rules = rules_of(task);
        task.min_facing_density =
            station.lens ? coverage::least_when_steep(rules, station.lens->curved)
                         : coverage::least_when_steep(rules, pinhole_of(station.camera));
        task.min_pixel_density = task.min_pixels_per_m2 = 0.0;
    }
    if (stage.bits & coverage::IS_COARSE)
        task.min_pixel_density = task.min_facing_density = task.min_pixels_per_m2 = 0.0;
    if (stage.bits & coverage::IS_BLURRED) {
        task.min_depth = 0.0;
        task.max_depth = INFINITY;
    }
    if (stage.bits & coverage::IS_STEEP) task.max_incidence_deg = 90.0;
    return task;
}

// Numbers that a result depends on.
struct Key {
    std::vector<uint64_t> all;
    void add(const double *values, int64_t n) {
        for (int64_t k = 0; k < n; k++) all.push_back(std::bit_cast<uint64_t>(values[k]));
    }
    void add(const void *object) { all.push_back(reinterpret_cast<uintptr_t>(object)); }
    void add(const std::vector<uint8_t> &values) {
        all.push_back(values.size());
        all.insert(all.end(), values.begin(), values.end());
    }
};

using Parts = std::vector<std::shared_ptr<const void>>;
struct Kept {
    std::vector<uint64_t> key;
    RegionsPointer regions;
    Parts parts; // whose addresses are in the key
    int64_t used;
};

struct Network {
    std::shared_ptr<const SurfaceObject> surface, bare; // bare: nothing hides anything
    int64_t n_threads;
    std::mutex changes;
    std::vector<Station> stations;
    std::vector<Row> rows;

    int64_t n_faces() const { return surface->mesh.n_faces(); }

    // Forgets what the last two questions have not used, if it is much.
    void begin() {
        now++;
        if (kept.size() > MOST_KEPT)
            std::erase_if(kept, [&](const Kept &each) { return each.used + 2 < now; });
    }

    // What a camera covers without the criteria of a stage.
    RegionsPointer seen_by(const Station &station, const Stage &stage) {
        const bool is_bare = stage.bits & coverage::IS_HIDDEN;
        const rc_camera camera =
            stage.bits & coverage::IS_OUTSIDE ? widest(station) : station.camera;
        const rc_task task = without(station, stage);
        Key key;
        key.all.push_back(is_bare);
        key.add(&camera.width, 7);
        key.add(station.lens.get());
        key.add(&task.min_depth, 6);
        key.add(station.pose.data(), 16);
        return keep(key, {station.lens}, [&] {
            return found_by(*solver_of(camera, station.lens, is_bare), camera, station.lens, task,
                            Placed(station.pose.data(), 1), {});
        });
    }

    // The same where each view is judged by its own angle, allowed or steep.
    RegionsPointer at_any_angle(const Station &station, const Stage &stage) {
        const RegionsPointer flat = seen_by(station, {stage.bits}), steep = seen_by(station, stage);
        std::vector<double> poses(station.pose.begin(), station.pose.end());
        poses.insert(poses.end(), station.pose.begin(), station.pose.end());
        Key key;
        key.add(flat.get());
        key.add(steep.get());
        rc_gate any = {};
        any.k = 1;
        any.most_deg = 180.0;
        return keep(key, {flat, steep},
                    [&] { return united_by(any, poses, {&flat->poses[0], &steep->poses[0]}); });
    }

    // What a row covers without them.
    RegionsPointer covered_by(const Row &row, const Stage &stage) {
        Parts parts;
        std::vector<const Regions *> seen;
        std::vector<double> poses;
        Key key;
        for (size_t d = row.first; d < row.first + row.n; d++) {
            if (!row.gate) return seen_by(stations[d], stage);
            const RegionsPointer own =
                stage.is_steep ? at_any_angle(stations[d], stage) : seen_by(stations[d], stage);
            parts.push_back(own);
            seen.push_back(&own->poses[0]);
            key.add(own.get());
            poses.insert(poses.end(), stations[d].pose.begin(), stations[d].pose.end());
        }
        const rc_gate gate = row.gate->without(stage.bits);
        key.all.push_back(uint64_t(gate.k));
        key.add(&gate.least_deg, 3);
        key.add(row.gate->needs);
        key.add(row.gate->stripes);
        key.add(row.gate->noise.data(), int64_t(row.gate->noise.size()));
        return keep(key, std::move(parts), [&] { return united_by(gate, poses, seen); });
    }

    // A union of what the rows cover, counted up to some views.
    std::shared_ptr<UnionObject> united(int64_t views) {
        auto made = union_of(surface, views);
        for (const Row &row : rows) add_poses(*made->all, {&covered_by(row, {})->poses[0]});
        return made;
    }

    // What the rows cover of some faces without the criteria of a stage, added at once.
    std::shared_ptr<UnionObject> united(const Stage &stage, const Mask &asked, int64_t views = 1) {
        auto made = union_of(surface, views);
        std::vector<Regions> own;
        std::vector<const Regions *> all;
        const auto is_asked = [&](int32_t f) { return asked[f]; };
        for (const Row &row : rows)
            own.push_back(choose_regions(covered_by(row, stage)->poses[0], is_asked));
        for (const Regions &each : own) all.push_back(&each);
        add_poses(*made->all, all);
        return made;
    }

    // Criteria that some camera or rule asks.
    uint32_t asked() const {
        uint32_t bits = coverage::IS_HIDDEN;
        for (const Row &row : rows) {
            if (row.gate && row.gate->given.most_deviation > 0.0) bits |= area::IS_UNCERTAIN;
            if (row.gate && row.gate->has_angles()) bits |= area::IS_AT_ANGLE;
            for (size_t d = row.first; d < row.first + row.n; d++) {
                const rc_task &task = stations[d].task;
                if (task.max_incidence_deg < 90.0) bits |= coverage::IS_STEEP;
                if (task.min_pixel_density > 0.0 || task.min_facing_density > 0.0 ||
                    task.min_pixels_per_m2 > 0.0)
                    bits |= coverage::IS_COARSE;
                if (task.min_depth > 0.0 || task.max_depth < INFINITY) bits |= coverage::IS_BLURRED;
                if (!stations[d].lens) bits |= coverage::IS_OUTSIDE;
            }
        }
        return bits;
    }

    // Faces that enough cameras of some row are in front of, not edge-on.
    Mask in_front() const {
        const engine::MeshArrays &mesh = *surface->mesh.arrays;
        Mask found(n_faces(), false);
        std::vector<int> sides(stations.size());
        for (int64_t f = 0; f < n_faces(); f++) {
            const double *const origin = &mesh.origin[3 * f];
            const double *const normal = &mesh.normal[3 * f];
            for (size_t s = 0; s < stations.size(); s++) {
                double height = 0.0;
                double of_eye = 0.0;
                double of_face = 0.0;
                for (size_t k = 0; k < 3; k++) {
                    const double eye = stations[s].pose[4 * k + 3];
                    height += (eye - origin[k]) * normal[k];
                    of_eye += eye * eye;
                    of_face += origin[k] * origin[k];
                }
                const double most = ROUNDING_REL * (std::sqrt(of_eye) + std::sqrt(of_face));
                sides[s] = height > most ? 1 : height < -most ? -1 : 0;
            }
            const auto sees = [&](const Row &row, int side) {
                return row.gate ? row.gate->sees(sides, row.first, side) : sides[row.first] == side;
            };
            for (const Row &row : rows)
                found[f] |= sees(row, 1) || (mesh.two_sided[f] && sees(row, -1));
        }
        return found;
    }

    // Whether densities depend on the angle of incidence.
    bool is_foreshortened() const {
        return std::any_of(stations.begin(), stations.end(), [](const Station &each) {
            return each.task.min_pixel_density > 0.0 || each.task.min_pixels_per_m2 > 0.0;
        });
    }

  private:
    RegionsPointer united_by(const rc_gate &gate, const std::vector<double> &poses,
                             const std::vector<const Regions *> &seen) const {
        auto made = std::make_shared<RegionsObject>();
        made->surface = surface;
        made->poses.push_back(measured_by(surface->mesh, gate, poses.data(), seen));
        return made;
    }
    // A result of some numbers, or what `make` makes of them.
    template <class Make> RegionsPointer keep(Key &key, Parts parts, Make make) {
        for (Kept &each : kept) {
            if (each.key != key.all) continue;
            each.used = now;
            return each.regions;
        }
        kept.push_back({std::move(key.all), make(), std::move(parts), now});
        return kept.back().regions;
    }

    std::shared_ptr<SolverObject> solver_of(const rc_camera &camera, const LensPointer &lens,
                                            bool is_bare) {
        if (is_bare && !bare) bare = without_occlusion();
        for (const auto &each : solvers)
            if (each->lens == lens && each->surface == (is_bare ? bare : surface) &&
                each->camera.fx == camera.fx && each->camera.cx == camera.cx)
                return each;
        if (solvers.size() >= MOST_SOLVERS) solvers.clear();
        auto solver = std::make_shared<SolverObject>();
        solver->surface = is_bare ? bare : surface;
        solver->is_certifying = true;
        solver->n_threads = n_threads;
        solvers.push_back(solver);
        return solver;
    }

    std::shared_ptr<const SurfaceObject> without_occlusion() const {
        const engine::MeshArrays &mesh = *surface->mesh.arrays;
        const std::vector<int32_t> faces(mesh.faces.rows().begin(), mesh.faces.rows().end());
        std::vector<uint8_t> roles;
        for (int64_t f = 0; f < n_faces(); f++)
            roles.push_back(uint8_t(engine::TARGET | (mesh.is_asked[f] ? 0 : engine::OCCLUDER) |
                                    (mesh.two_sided[f] ? engine::TWO_SIDED : 0)));
        auto made = std::make_shared<SurfaceObject>();
        made->mesh = engine::make_mesh(mesh.vertices.rows<3>(), {faces.data(), {n_faces()}},
                                       {roles.data(), {n_faces()}});
        return made;
    }

    std::vector<Kept> kept;
    std::vector<std::shared_ptr<SolverObject>> solvers; // of cameras alike
    int64_t now = 0;
};

// Each set of criteria that are asked, small ones first, of equal ones those of late criteria.
std::vector<Stage> stages_of(uint32_t asked) {
    std::vector<Stage> found;
    for (int size = 1; size <= std::popcount(asked); size++)
        for (uint32_t set = asked; set > 0; set = (set - 1) & asked) {
            if (std::popcount(set) != size) continue;
            found.push_back({set, false});
            if (set & coverage::IS_STEEP && asked & coverage::IS_COARSE & ~set)
                found.push_back({set, true});
        }
    return found;
}

// What is asked of the faces of a surface.
struct Wanted {
    const int32_t *views, *groups;
    const double *unseeable; // area that no camera can ever see, m^2
};

struct Zones {
    std::shared_ptr<const SurfaceObject> surface;
    std::vector<double> xy, area, sizes; // of corners, pieces, and zones
    std::vector<int64_t> starts = {0}, zone;
    std::vector<int32_t> face, views;
    std::vector<uint32_t> reason;

    int64_t size() const { return int64_t(face.size()); }
    // The zone of each point of a face, or -1, and its reason.
    void find(int64_t n, const double *points, const int32_t *faces, int32_t *of_zones,
              int32_t *reasons) const {
        const engine::MeshArrays &mesh = *surface->mesh.arrays;
        std::vector<std::vector<size_t>> of_face(size_t(surface->mesh.n_faces()));
        for (size_t p = 0; p < face.size(); p++) of_face[size_t(face[p])].push_back(p);
        for (int64_t i = 0; i < n; i++) {
            double x = 0.0;
            double y = 0.0;
            for (int64_t k = 0; k < 3; k++) {
                const int64_t at = 3 * int64_t(faces[i]) + k;
                const double away = points[3 * i + k] - mesh.origin[at];
                x += away * mesh.x_axis[at];
                y += away * mesh.y_axis[at];
            }
            of_zones[i] = -1;
            reasons[i] = RC_COVERED;
            for (const size_t p : of_face[size_t(faces[i])])
                if (area::is_inside(x, y, xy.data() + 2 * starts[p], starts[p + 1] - starts[p],
                                    SLACK_REL * surface->mesh.diagonal)) {
                    of_zones[i] = int32_t(zone[p]);
                    reasons[i] = int32_t(reason[p]);
                    break;
                }
        }
    }
    template <class From> void add(const From &from, int64_t p, int32_t seen, uint32_t code) {
        const auto at = from.xy.begin();
        xy.insert(xy.end(), at + 2 * from.starts[size_t(p)], at + 2 * from.starts[size_t(p + 1)]);
        starts.push_back(int64_t(xy.size() / 2));
        face.push_back(from.face[size_t(p)]);
        area.push_back(from.area[size_t(p)]);
        views.push_back(seen);
        reason.push_back(code);
    }
};

// Pieces of zones, or of a partition.
template <class Parts> area::PieceTable table_of(const Parts &parts) {
    return {{parts.xy.data(), {int64_t(parts.xy.size() / 2)}},
            {parts.starts.data(), {parts.size() + 1}},
            {parts.face.data(), {parts.size()}}};
}

// Faces that no camera can see; none where cameras see into bodies.
Mask unseeable_of(const engine::Mesh &mesh, const engine::Room<double> &seen,
                  const double *unseeable) {
    const int64_t n = mesh.n_faces();
    Mask found(n, false);
    if (!unseeable) return found;
    bool sees_into = false;
    for (int64_t f = 0; f < n; f++) {
        const double area = mesh.arrays->areas[f];
        found[f] = unseeable[f] > 0.0;
        sees_into |= found[f] && seen[f] > 2 * (area - unseeable[f]) + area::SLIVER_REL * area;
    }
    if (sees_into) found.fill(false);
    return found;
}

class Divider {
  public:
    explicit Divider(Network &network)
        : _network(network), _n(network.n_faces()), _open(_n, false), _reached(_n, false),
          _doubt(_n, 0.0), _sets(union_of(network.surface, 0)) {}

    // Adds the parts of faces that only the pose that completes a union covers, by their reasons.
    void divide(const engine::Union &whole, const Mask &unseeable, Zones &out) {
        add_set(*_sets->all, whole, -2, 0);
        Mask rest(_n, false);
        const Partition parts(*_sets->all);
        for (int64_t p = 0; p < parts.size(); p++) {
            const int32_t f = parts.face[size_t(p)];
            rest[f] |= !unseeable[f] && parts.area[size_t(p)] > 0.0;
        }
        const uint32_t asked = _network.asked();
        const auto reached = _network.united({asked, false}, rest);
        measure(*reached->all);
        for (int64_t f = 0; f < _n; f++) _reached[f] = _open[f] = _areas[f] > 0.0;
        for (const Stage &stage : stages_of(asked))
            if (!stage.is_steep || _network.is_foreshortened()) try_stage(stage);
        add(*reached->all, asked);
        name(unseeable, out);
    }

  private:
    // Areas of a union, and its bounds, which are doubts of all reasons.
    void measure(const engine::Union &all) {
        _areas = all.areas(1);
        const engine::Room<double> both = all.bounds();
        for (int64_t f = 0; f < _n; f++) _doubt[f] += both[f];
    }

    void try_stage(const Stage &stage) {
        // A face that a set covers as a whole needs no larger one.
        const Mask &asked = std::has_single_bit(stage.bits) ? _reached : _open;
        if (std::find(asked.rows().begin(), asked.rows().end(), true) == asked.rows().end()) return;
        const auto passed = _network.united(stage, asked);
        measure(*passed->all);
        bool covers = false;
        for (int64_t f = 0; f < _n; f++) {
            covers |= _areas[f] > 0.0;
            _open[f] &=
                _areas[f] < (1 - area::SLIVER_REL) * _network.surface->mesh.arrays->areas[f];
        }
        if (!covers) return;
        add(*passed->all, stage.bits);
    }

    // What is covered without some criteria, where nothing is without fewer.
    void add(const engine::Union &covered, uint32_t criteria) {
        _codes.push_back(criteria);
        const auto place = int64_t(_codes.size());
        add_set(*_sets->all, covered, 1,
                place << area::PLACE_AT | area::DIVIDES_FIRST << area::KIND_AT);
    }

    void name(const Mask &unseeable, Zones &out) const {
        Partition parts(*_sets->all);
        parts.keep([&](int64_t p) {
            return parts.area[size_t(p)] > 0.0 && !unseeable[parts.face[size_t(p)]];
        });
        const int64_t n = parts.size();
        std::vector<uint32_t> code(static_cast<size_t>(n));
        const std::vector<uint32_t> own(static_cast<size_t>(_n));
        engine::Room<double> doubt(_n);
        for (int64_t f = 0; f < _n; f++)
            doubt[f] = _doubt[f] + area::SLIVER_REL * _network.surface->mesh.arrays->areas[f];
        const Mask in_front = _network.in_front();
        area::name_parts({table_of(parts), {parts.tag.data(), {n}}, {parts.area.data(), {n}}},
                         {_codes.data(), {int64_t(_codes.size())}},
                         {area::CRITERIA.data(), {int64_t(area::CRITERIA.size())}},
                         {in_front.rows(), {own.data(), {_n}}, doubt.rows()}, {code.data(), {n}});
        for (int64_t p = 0; p < n; p++) out.add(parts, p, 0, code[size_t(p)]);
    }

    Network &_network;
    int64_t _n;
    Mask _open, _reached;
    engine::Room<double> _doubt, _areas;
    std::shared_ptr<UnionObject> _sets;
    std::vector<uint32_t> _codes; // criteria of each set
};

void link(Zones &zones, const engine::Room<double> &excess, const int32_t *groups) {
    const engine::Mesh &mesh = zones.surface->mesh;
    const engine::MeshArrays &own = *mesh.arrays;
    const int64_t n = zones.size(), n_faces = mesh.n_faces();
    const std::vector<int32_t> one_group(static_cast<size_t>(groups ? 0 : n_faces));
    double farthest = 0.0;
    for (const int64_t v : own.faces.rows())
        for (int64_t k = 0; k < 3; k++)
            farthest = std::max(farthest, std::abs(own.vertices[3 * v + k]));
    const area::ZoneSurface surface = {own.vertices.rows<3>(),
                                       own.faces.rows<3>(),
                                       {groups ? groups : one_group.data(), {n_faces}},
                                       own.origin.rows<3>(),
                                       own.x_axis.rows<3>(),
                                       own.y_axis.rows<3>(),
                                       own.normal.rows<3>(),
                                       own.corners.rows<3, 2>(),
                                       own.areas.rows(),
                                       std::max(mesh.diagonal, 0x1p-20 * farthest)};
    zones.zone.resize(size_t(n));
    zones.sizes.resize(size_t(n));
    zones.sizes.resize(size_t(area::find_zones(
        surface, table_of(zones), {zones.reason.data(), {n}}, {zones.area.data(), {n}},
        excess.rows(), {zones.zone.data(), {n}}, {zones.sizes.data(), {n}})));
}

// Drops the pieces of no zone, which may be covered.
Zones certain(Zones from) {
    Zones out;
    out.surface = std::move(from.surface);
    out.sizes = std::move(from.sizes);
    for (size_t p = 0; p < from.face.size(); p++) {
        if (from.zone[p] < 0) continue;
        out.add(from, int64_t(p), from.views[p], from.reason[p]);
        out.zone.push_back(from.zone[p]);
    }
    return out;
}

Zones zones_of(Network &network, const Wanted &wanted) {
    network.begin();
    const int64_t n = network.n_faces();
    const int64_t views = std::max(1, *std::max_element(wanted.views, wanted.views + n));
    const auto all = network.united(views);
    const Mask unseeable =
        unseeable_of(network.surface->mesh, all->all->areas(1), wanted.unseeable);
    const auto whole = complete_union(*all);
    const Partition parts(*whole->all);
    const bool has_rows = !network.rows.empty();
    Zones zones;
    zones.surface = network.surface;
    for (int64_t p = 0; p < parts.size(); p++) {
        const int32_t f = parts.face[size_t(p)], seen = int32_t(parts.tag[size_t(p)]) - 1;
        if (!(seen < wanted.views[f]) || !(parts.area[size_t(p)] > 0.0)) continue;
        if (seen == 0 && has_rows && !unseeable[f]) continue;
        const uint32_t left = seen > 0 ? RC_TOO_FEW_VIEWS : RC_NO_CAMERAS;
        zones.add(parts, p, seen, unseeable[f] ? uint32_t(RC_UNSEEABLE) : left);
    }
    if (has_rows) Divider(network).divide(*whole->all, unseeable, zones);
    engine::Room<double> excess(n);
    std::copy_n(all->all->bounds().data() + n, n, excess.begin());
    link(zones, excess, wanted.groups);
    return certain(std::move(zones));
}
} // namespace

RASTERCOV_HANDLE(rc_network, Network);
RASTERCOV_HANDLE(rc_zones, Zones);
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_network_create(const rc_surface *surface, int32_t n_threads, rc_network **network) {
    return guard("making a network", [&] {
        expect_result(network);
        expect(n_threads >= 1 && n_threads <= MOST_THREADS, "1 to 1024 threads", n_threads,
               "pass the number of processor cores");
        const auto made = std::make_shared<Network>();
        made->surface = object_of(surface);
        made->n_threads = n_threads;
        *network = handles().add<rc_network>(made);
    });
}
rc_status rc_network_free(rc_network *network) { return free_handle(network); }

rc_status rc_network_clear(rc_network *network) {
    return guard("clearing a network", [&] {
        const auto object = object_of(network);
        const std::scoped_lock lock(object->changes);
        object->stations.clear();
        object->rows.clear();
        object->begin();
    });
}

rc_status rc_network_add(rc_network *network, const rc_camera *camera, const rc_task *task,
                         const double *pose) {
    return guard("adding a camera", [&] {
        const auto object = object_of(network);
        check_camera(camera);
        expect_array(task, "task");
        rules_of(*task);
        expect_array(pose, "pose");
        check_pose(pose);
        Station station = {*camera, lens_of(*camera), *task, {}};
        std::copy_n(pose, 16, station.pose.begin());
        const std::scoped_lock lock(object->changes);
        object->rows.push_back({object->stations.size(), 1, {}});
        object->stations.push_back(std::move(station));
    });
}

rc_status rc_network_join(rc_network *network, const rc_gate *gate, int64_t n) {
    return guard("joining cameras", [&] {
        const auto object = object_of(network);
        check_gate(gate, n);
        const std::scoped_lock lock(object->changes);
        auto &rows = object->rows;
        expect(n <= int64_t(rows.size()), "as many cameras as were added", n, "add them first");
        const auto of_rule = [](const Row &row) { return row.gate != nullptr; };
        require(std::none_of(rows.end() - n, rows.end(), of_rule),
                "expected cameras without a rule, got one of a rig; add its own for each rig");
        rows.resize(rows.size() - size_t(n - 1));
        rows.back().n = size_t(n);
        rows.back().gate = std::make_shared<Gate>(*gate, size_t(n));
    });
}

rc_status rc_network_regions(rc_network *network, int64_t row, rc_regions **regions) {
    return guard("finding regions", [&] {
        expect_result(regions);
        const auto object = object_of(network);
        const std::scoped_lock lock(object->changes);
        expect(row >= 0 && row < int64_t(object->rows.size()), "a row of the network", row,
               "count cameras, and rigs, from 0");
        const RegionsPointer found = object->covered_by(object->rows[size_t(row)], {});
        *regions = handles().add<rc_regions>(std::const_pointer_cast<RegionsObject>(found));
    });
}

rc_status rc_network_unite(rc_network *network, int32_t views, rc_union **unite) {
    return guard("uniting regions", [&] {
        expect_result(unite);
        const auto object = object_of(network);
        expect(views >= 1 && views <= MOST_VIEWS, "views of 1 to 10000", views,
               "pass the largest number of cameras to count");
        const std::scoped_lock lock(object->changes);
        *unite = handles().add<rc_union>(object->united(views));
    });
}

rc_status rc_find_zones(rc_network *network, int64_t n_faces, const int32_t *views,
                        const int32_t *groups, const double *unseeable, rc_zones **zones) {
    return guard("finding dead zones", [&] {
        expect_result(zones);
        const auto object = object_of(network);
        check_faces(*object->surface, n_faces);
        expect_array(views, "views");
        for (int64_t f = 0; f < n_faces; f++) {
            expect(views[f] >= 1 && views[f] < MOST_VIEWS, "views of 1 to 9999", views[f],
                   "pass the cameras that each face needs");
            expect(!unseeable || unseeable[f] >= 0.0, "areas of 0 m^2 or more",
                   unseeable ? unseeable[f] : 0.0, "pass 0 where nothing is proved");
        }
        const std::scoped_lock lock(object->changes);
        *zones = handles().add<rc_zones>(
            std::make_shared<Zones>(zones_of(*object, {views, groups, unseeable})));
    });
}
rc_status rc_zones_free(rc_zones *zones) { return free_handle(zones); }

rc_status rc_zones_size(const rc_zones *zones, int64_t *n_zones, int64_t *n_polygons,
                        int64_t *n_corners) {
    return guard("reading zones", [&] {
        const auto object = object_of(zones);
        *expect_result(n_zones) = int64_t(object->sizes.size());
        *expect_result(n_polygons) = object->size();
        *expect_result(n_corners) = int64_t(object->xy.size() / 2);
    });
}

rc_status rc_zones_read(const rc_zones *zones, int64_t n_polygons, int64_t n_corners,
                        const rc_parts *parts) {
    return guard("reading zones", [&] {
        const auto object = object_of(zones);
        expect(n_polygons == object->size() && n_corners == int64_t(object->xy.size() / 2),
               "n_polygons and n_corners of rc_zones_size", n_polygons, "call it first");
        if (n_polygons == 0) return;
        expect_array(parts, "parts");
        expect_arrays("each of parts", parts->faces, parts->counts, parts->views, parts->zones,
                      parts->reasons, parts->areas, parts->corners);
        for (size_t p = 0; p < object->face.size(); p++) {
            parts->faces[p] = object->face[p];
            parts->counts[p] = int32_t(object->starts[p + 1] - object->starts[p]);
            parts->views[p] = object->views[p];
            parts->zones[p] = int32_t(object->zone[p]);
            parts->reasons[p] = int32_t(object->reason[p]);
            parts->areas[p] = object->area[p];
        }
        write_corners(*object->surface, object->face, parts->counts, object->xy.data(),
                      parts->corners);
    });
}

rc_status rc_reason_at(const rc_zones *zones, int64_t n_points, const double *points,
                       const int32_t *faces, int32_t *of_zones, int32_t *reasons) {
    return guard("finding reasons", [&] {
        const auto object = object_of(zones);
        expect(n_points >= 0 && n_points <= MOST_FACES, "0 to 715827882 points", n_points,
               "pass the number of rows");
        if (n_points == 0) return;
        expect_array(points, "points");
        expect_array(faces, "faces");
        expect_array(of_zones, "zones");
        expect_array(reasons, "reasons");
        for (int64_t i = 0; i < n_points; i++)
            expect(faces[i] >= 0 && faces[i] < object->surface->mesh.n_faces(), "indices of faces",
                   faces[i], "count faces from 0");
        object->find(n_points, points, faces, of_zones, reasons);
    });
}
