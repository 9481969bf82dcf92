// Rigs with a rule at points, for Python: see rule.hpp.
//
// Twin: tests/viewer/test_live_rules.py.
#include "area/rule.hpp"
#include "bind.hpp"

namespace rastercov {

RECORD(area::RigRule, k, needs, stripes, least_deg, most_deg, most_deviation, noise);

namespace area {
namespace {
using Poses = Array<const double, Any, 4, 4>;

PlacedRule placed(const RigRule &rule, const Poses &poses) {
    const int64_t n = poses.rows();
    require(n >= 1 && n <= int64_t(PlacedRule::MOST_DEVICES), "expected 1 to 64 devices");
    require(rule.needs.rows() <= n && rule.stripes.rows() <= n,
            "needs and stripes must have one row for each device, or none");
    require(rule.most_deviation <= 0 || rule.noise.rows() == n,
            "noise must have one row for each device");
    return {rule, poses};
}

// Reason of points with normals, and the device that is missed most or -1, of those of each of n
// devices there, (n, N).
void find_failures(RigRule rule, Poses poses, FloatRows<3> points, FloatRows<3> normals,
                   Array<const uint8_t, Any, Any> reasons, Column<uint8_t> reason,
                   Column<int32_t> device) {
    const PlacedRule own = placed(rule, poses);
    require(have_rows(points.rows(), normals, reason, device) &&
                reasons.extent(1) == points.rows() && reasons.rows() == poses.rows(),
            "normals, reason and device must have one row for each point, reasons one column");
    own.judge(points.rows(), points.data, normals.data, reasons.data, reason.data, device.data);
}

// Least cosine of the angle between two rays, and deviation, m, at points, in one pose or one each.
void measure_points(RigRule rule, Array<const double, Any, Any, 4, 4> poses, FloatRows<3> points,
                    Column<double> cosine, Column<double> deviation) {
    require(have_rows(points.rows(), cosine, deviation) &&
                (poses.rows() == 1 || poses.rows() == points.rows()),
            "cosine, deviation and poses must have one row for each point");
    for (int64_t i = 0; i < points.rows(); i++) {
        const PlacedRule own = placed(rule, poses[poses.rows() == 1 ? 0 : i]);
        const smooth::Vector point = PlacedRule::row_of(points.data, i);
        cosine[i] = own.least_cosine(point);
        deviation[i] = rule.most_deviation > 0 ? own.deviation(point) : 0.0;
    }
}

// How near cameras with some reasons are to covering.
void rank_reasons(Column<const uint8_t> reason, Column<int64_t> rank) {
    require(have_rows(reason.rows(), rank), "rank must have one row for each reason");
    for (int64_t i = 0; i < reason.rows(); i++)
        rank[i] = coverage::nearness<double>(int64_t(reason[i]));
}

} // namespace
} // namespace area

void register_area_rule(nanobind::module_ &m) {
    using namespace area;
    def(m, "find_failures", find_failures,
        "Reason of points in a rig with a rule, and the device that is missed most or -1.", "rule",
        "poses", "points", "normals", "reasons", "reason", "device");
    def(m, "measure_points", measure_points,
        "Least cosine of the angle between two rays to points, and their deviations, m.", "rule",
        "poses", "points", "cosine", "deviation");
    def(m, "rank_reasons", rank_reasons, "How near cameras with some reasons are to covering.",
        "reason", "rank");
}

} // namespace rastercov
