// Devices of a rig that measure together, for C: k of n of them from one side of a face, within
// limits of the angle between their rays and of the deviation of a point.
//
// Sums are those of Python, in its order.
//
// Twin: tests/native/test_c_border.py, by Python.
#include "area/rule.hpp"
#include "c/partition.hpp"
#include "c/rule.hpp"
#include "sum.hpp"

namespace rastercov::c {
namespace {
namespace smooth = area::smooth;
using engine::Regions;
using Poses = std::vector<const Regions *>;

constexpr int64_t MOST_DEVICES = 64;
constexpr double RADIAN = 3.14159265358979323846 / 180.0;

smooth::Vector row_of(const engine::Room<double> &rows, int32_t face) {
    return {rows[3 * face], rows[3 * face + 1], rows[3 * face + 2]};
}

// What at least k of some poses cover.
Regions count_views(const engine::Mesh &mesh, const Poses &poses, int64_t k) {
    const int64_t n = mesh.n_faces();
    std::vector<int32_t> number(static_cast<size_t>(n));
    for (const Regions *each : poses)
        for (const int32_t f : each->listed) number[size_t(f)]++;
    // A face of fewer poses is not covered, and that is exact.
    const auto is_asked = [&](int32_t f) { return number[size_t(f)] >= k; };
    std::vector<Regions> some;
    for (const Regions *each : poses) some.push_back(choose_regions(*each, is_asked));
    Poses asked;
    for (const Regions &each : some) asked.push_back(&each);
    const area::Planes planes = mesh.arrays->planes();
    engine::Union all({planes.corners, planes.areas}, FLOOR_REL * mesh.diagonal, k);
    add_poses(all, asked);
    Partition parts(all);
    parts.keep([&](int64_t p) { return parts.tag[size_t(p)] >= k; });
    const engine::Room<double> both = all.bounds();
    engine::Room<double> area(n, 0.0);
    Regions out;
    for (int64_t p = 0; p < parts.size(); p++) {
        area[parts.face[size_t(p)]] += parts.area[size_t(p)];
        out.n_corners.push_back(parts.starts[size_t(p + 1)] - parts.starts[size_t(p)]);
    }
    out.xy = std::move(parts.xy);
    out.face = std::move(parts.face);
    for (int32_t f = 0; f < n; f++) {
        if (!is_asked(f) || !(area[f] > 0 || both[f] > 0)) continue;
        out.listed.push_back(f);
        out.area.push_back(area[f]);
        out.bound.push_back(both[f]);
        out.excess.push_back(both[n + f]);
    }
    return out;
}

// Area of a polygon, added up as by numpy.
double area_of(area::Points corners, int64_t n) {
    std::array<double, area::PIECE_ROOM> twice;
    for (int64_t i = 1; i < n; i++) {
        const int64_t next = i + 1 < n ? i + 1 : 0;
        const double x = corners(i, 0) - corners(0, 0), y = corners(i, 1) - corners(0, 1);
        const double u = corners(next, 0) - corners(0, 0), v = corners(next, 1) - corners(0, 1);
        twice[size_t(i - 1)] = x * v - y * u;
    }
    return pairwise_sum(twice.data(), n - 1) / 2;
}

// A criterion in any plane: its calls take little beside it, and one cutter serves all.
struct Limit {
    virtual smooth::Value at(const smooth::Plane &plane, double x, double y, double r) const = 0;

  protected:
    ~Limit() = default;
};

struct AngleLimit final : Limit {
    smooth::Vector eye, other;
    double sign, limit;

    AngleLimit(const smooth::Vector &a, const smooth::Vector &b, double of_sign, double degrees)
        : eye(a), other(b), sign(of_sign), limit(of_sign * cosine_of(degrees * RADIAN)) {}
    smooth::Value at(const smooth::Plane &plane, double x, double y, double r) const override {
        return smooth::RayAngle{plane, eye, other, sign, limit}.at(x, y, r);
    }
};

struct DeviationLimit final : Limit {
    smooth::Uncertainties all;

    explicit DeviationLimit(const smooth::Uncertainties &given) : all(given) {}
    smooth::Value at(const smooth::Plane &plane, double x, double y, double r) const override {
        return all.of(plane, 0, -1).at(x, y, r);
    }
};

struct OnPlane {
    const Limit &limit;
    smooth::Plane plane;
    smooth::Value at(double x, double y, double r) const { return limit.at(plane, x, y, r); }
};

// Parts where a criterion holds.
Regions where(const engine::Mesh &mesh, const Regions &from, const Limit &limit) {
    const engine::MeshArrays &own = *mesh.arrays;
    const double width = STRIP_REL * mesh.diagonal, nearest = area::COINCIDENT_REL * mesh.diagonal;
    engine::Room<double> area(mesh.n_faces(), 0.0), lost(mesh.n_faces(), 0.0);
    smooth::Cutter cutter;
    Regions out;
    int64_t at = 0;
    for (size_t p = 0; p < from.face.size(); p++) {
        const int32_t f = from.face[p];
        const OnPlane g = {limit,
                           {row_of(own.origin, f), row_of(own.x_axis, f), row_of(own.y_axis, f)}};
        const auto take = [&](area::Points part, int64_t n) {
            out.xy.insert(out.xy.end(), part.data, part.data + 2 * n);
            out.n_corners.push_back(n);
            out.face.push_back(f);
            area[f] += area_of(part, n);
        };
        const auto keep = [&](area::Points polygon, int64_t n) {
            smooth::each_part(polygon, n, take);
        };
        const FloatRows<2> piece = {from.xy.data() + at, {from.n_corners[p], 2}};
        lost[f] += smooth::cut_tidily(cutter, piece, g, width, nearest, keep).area;
        at += 2 * from.n_corners[p];
    }
    for (size_t k = 0; k < from.listed.size(); k++) {
        const int32_t f = from.listed[k];
        const double bound = std::min(from.bound[k] + lost[f], own.areas[f]);
        if (!(area[f] > 0 || bound > 0)) continue;
        out.listed.push_back(f);
        out.area.push_back(area[f]);
        out.bound.push_back(bound);
        out.excess.push_back(std::min(from.excess[k] + lost[f], own.areas[f]));
    }
    return out;
}

// A rule at one place of its devices.
struct Rule {
    const engine::Mesh &mesh;
    const rc_gate &gate;
    std::vector<smooth::Vector> eyes;
    std::vector<double> axes, centres; // of stripes, and of all

    Rule(const engine::Mesh &of, const rc_gate &by, const double *poses, int64_t n)
        : mesh(of), gate(by) {
        for (int64_t d = 0; d < n; d++) {
            const double *const pose = poses + 16 * d;
            eyes.push_back({pose[3], pose[7], pose[11]});
            centres.insert(centres.end(), eyes.back().begin(), eyes.back().end());
            const bool is_stripe = gate.stripes && gate.stripes[d];
            const double size =
                std::sqrt(pose[1] * pose[1] + pose[5] * pose[5] + pose[9] * pose[9]);
            for (const int k : {1, 5, 9}) axes.push_back(is_stripe ? pose[k] / size : 0.0);
        }
    }

    Regions within_angles(Regions found) const {
        for (size_t a = 0; gate.most_deg < 180.0 && a < eyes.size(); a++)
            for (size_t b = a + 1; b < eyes.size(); b++)
                found = where(mesh, found, AngleLimit(eyes[a], eyes[b], 1.0, gate.most_deg));
        if (!(gate.least_deg > 0.0)) return found;
        std::vector<Regions> parts;
        for (size_t a = 0; a < eyes.size(); a++)
            for (size_t b = a + 1; b < eyes.size(); b++)
                parts.push_back(
                    where(mesh, found, AngleLimit(eyes[a], eyes[b], -1.0, gate.least_deg)));
        if (parts.size() == 1) return std::move(parts[0]);
        Poses all;
        for (const Regions &each : parts) all.push_back(&each);
        return count_views(mesh, all, 1);
    }

    Regions within_deviation(const Regions &found) const {
        const auto n = int64_t(eyes.size());
        const std::vector<double> none(eyes.size());
        const smooth::Devices devices = {{centres.data(), {1, n}},
                                         {axes.data(), {1, n}},
                                         {gate.noise, {1, n}},
                                         {none.data(), {1, n}}};
        return where(mesh, found, DeviationLimit({devices, gate.most_deviation, false}));
    }

    // What enough of the devices cover, of those on one side of each face.
    Regions together(const Poses &poses) const {
        Poses needed, others;
        for (size_t d = 0; d < poses.size(); d++)
            (gate.needs && gate.needs[d] ? needed : others).push_back(poses[d]);
        const auto least = int64_t(needed.size());
        Regions found = count_views(mesh, least > 0 ? needed : others, least > 0 ? least : gate.k);
        if (least > 0 && gate.k > least) {
            const Regions rest = count_views(mesh, others, gate.k - least);
            found = count_views(mesh, {&found, &rest}, 2);
        }
        if (gate.least_deg > 0.0 || gate.most_deg < 180.0) found = within_angles(std::move(found));
        return gate.most_deviation > 0.0 ? within_deviation(found) : found;
    }

    // The same on either side of two-sided faces.
    Regions on_sides(const Poses &poses) const {
        std::array<std::vector<Regions>, 2> parts;
        for (size_t d = 0; d < poses.size(); d++) {
            const auto is_behind = [&](int32_t f) {
                if (!mesh.arrays->two_sided[f]) return false;
                const smooth::Vector away = minus(eyes[d], row_of(mesh.arrays->origin, f));
                return dot(away, row_of(mesh.arrays->normal, f)) < 0;
            };
            parts[0].push_back(choose_regions(*poses[d], [&](int32_t f) { return !is_behind(f); }));
            parts[1].push_back(choose_regions(*poses[d], is_behind));
        }
        std::array<Regions, 2> found;
        for (size_t side = 0; side < 2; side++) {
            Poses own;
            for (const Regions &each : parts[side]) own.push_back(&each);
            found[side] = together(own);
        }
        if (found[1].listed.empty()) return std::move(found[0]);
        if (found[0].listed.empty()) return std::move(found[1]);
        return count_views(mesh, {&found[0], &found[1]}, 1);
    }
};

} // namespace

void check_gate(const rc_gate *gate, int64_t n) {
    expect_array(gate, "gate");
    expect(n >= 2 && n <= MOST_DEVICES, "2 to 64 devices", n, "pass one of regions for each");
    int64_t needed = 0;
    for (int64_t d = 0; gate->needs && d < n; d++) needed += gate->needs[d] != 0;
    expect(gate->k >= std::max<int64_t>(needed, 1) && gate->k <= n,
           "k from 1, and those that are needed, to n", gate->k, "pass how many must see a point");
    for (const double each : {gate->least_deg, gate->most_deg})
        expect(each >= 0.0 && each <= 180.0, "angles of 0 to 180 degrees", each,
               "pass 0 and 180 for no limits");
    expect(gate->least_deg <= gate->most_deg, "least_deg up to most_deg", gate->least_deg,
           "exchange them");
    expect(gate->most_deviation >= 0.0 && gate->most_deviation <= engine::LARGEST_COORDINATE,
           "most_deviation of 0 to 1e30 m", gate->most_deviation, "pass 0 for no limit");
    if (!(gate->most_deviation > 0.0)) return;
    expect_array(gate->noise, "noise");
    for (int64_t d = 0; d < n; d++)
        expect(gate->noise[d] > 0.0 && std::isfinite(gate->noise[d]), "noise above 0",
               gate->noise[d], "pass radians");
}

engine::Regions measured_by(const engine::Mesh &mesh, const rc_gate &gate, const double *poses,
                            const Poses &regions) {
    return Rule(mesh, gate, poses, int64_t(regions.size())).on_sides(regions);
}

namespace {
area::RigRule rule_of(const rc_gate &gate, int64_t n) {
    const auto marks = [&](const uint8_t *given) {
        return Column<const uint8_t>{given, {given ? n : 0}};
    };
    return {gate.k,        marks(gate.needs),   marks(gate.stripes), gate.least_deg,
            gate.most_deg, gate.most_deviation, {gate.noise, {n}}};
}

void check_rows(int64_t n, const double *rows) {
    expect(n >= 0 && n <= MOST_FACES, "0 to 715827882 points", n, "pass the number of rows");
    if (n > 0) expect_array(rows, "points and normals");
}
} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

int32_t rc_nearness(int32_t reason) { return int32_t(coverage::nearness<double>(int64_t(reason))); }

rc_status rc_judge_together(const rc_gate *gate, const double *poses, int64_t n, int64_t n_points,
                            const double *points, const double *normals, const uint8_t *reasons,
                            const rc_rule_failures *failures) {
    return guard("judging points", [&] {
        check_gate(gate, n);
        const Placed placed(poses, n);
        check_rows(n_points, points);
        if (n_points == 0) return;
        check_rows(n_points, normals);
        expect_array(reasons, "reasons");
        expect_array(failures, "failures");
        expect_array(failures->reasons, "reasons of failures");
        expect_array(failures->devices, "devices");
        const area::RigRule rule = rule_of(*gate, n);
        const area::PlacedRule own = {rule, {placed.matrices.data(), {n}}};
        own.judge(n_points, points, normals, reasons, failures->reasons, failures->devices);
    });
}

rc_status rc_measure_points(const rc_gate *gate, const double *poses, int64_t n, int64_t n_points,
                            const double *points, double *deviations) {
    return guard("measuring points", [&] {
        check_gate(gate, n);
        expect_array(gate->noise, "noise");
        const Placed placed(poses, n);
        check_rows(n_points, points);
        if (n_points == 0) return;
        expect_array(deviations, "deviations");
        const area::RigRule rule = rule_of(*gate, n);
        const area::PlacedRule own = {rule, {placed.matrices.data(), {n}}};
        for (int64_t i = 0; i < n_points; i++) deviations[i] = own.deviation(own.row_of(points, i));
    });
}

rc_status rc_regions_together(const rc_gate *gate, const rc_regions *const *regions,
                              const double *poses, int64_t n, rc_regions **together) {
    return guard("counting devices", [&] {
        expect_result(together);
        check_gate(gate, n);
        expect_array(regions, "regions");
        const Placed placed(poses, n);
        std::vector<std::shared_ptr<RegionsObject>> kept;
        Poses own;
        for (int64_t d = 0; d < n; d++) {
            kept.push_back(object_of(regions[d]));
            require(kept[0]->surface == kept.back()->surface && kept.back()->poses.size() == 1,
                    "expected regions of one pose each, of one surface, got others; find them for "
                    "each device");
            own.push_back(&kept.back()->poses[0]);
        }
        const auto made = std::make_shared<RegionsObject>();
        made->surface = kept[0]->surface;
        made->poses.push_back(measured_by(made->surface->mesh, *gate, placed.matrices.data(), own));
        *together = handles().add<rc_regions>(made);
    });
}
