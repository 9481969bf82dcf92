// A lens as one row of numbers, which Python and engine/c/lens.cpp read, and live pages carry.
//
// Twins: rastercov.core.camera.lenses.of_camera, tests/native/test_c_border.py.
#include "lens/proof.hpp"

namespace rastercov::lens {
namespace {
class Numbered {
  public:
    template <class... Values> void put(Values... values) { (_all.push_back(double(values)), ...); }
    template <class List> void put_all(const List &list) {
        _all.insert(_all.end(), list.begin(), list.end());
    }
    void put(const Outline &outline) {
        for (const auto &[x, y] : outline) put(x, y);
    }
    std::vector<double> take() { return std::move(_all); }

  private:
    std::vector<double> _all;
};

void put_plane(const Proved &proved, double tolerance, Numbered &to) {
    const PlaneRecord record = proved.record();
    to.put(record.code);
    to.put_all(record.params);
    to.put_all(record.frame);
    to.put(record.fx, record.fy, record.cx, record.cy);
    to.put(proved.plane.region.size(), proved.plane.hole.size(), proved.window.size());
    to.put(proved.plane.region);
    to.put(proved.plane.hole);
    to.put(proved.window);
    to.put_all(record.longest);
    to.put(record.parts_of, record.is_graded);
    to.put(record.width, record.height, record.bend, record.stretch, record.speed, record.tolerance,
           record.arc_half, record.arc_bend);
    const Pinhole &pinhole = proved.pinhole;
    to.put(pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy, pinhole.width, pinhole.height);
    const OwnTree tree = field_of(proved, tolerance);
    to.put(tree.kinds.size(), tree.root);
    to.put_all(tree.lines);
    to.put_all(tree.children);
    to.put_all(tree.kinds);
    const SlopeGrid &slopes = proved.slopes;
    to.put(slopes.low_x, slopes.low_y, slopes.per_x, slopes.per_y);
    for (const auto *each : {&slopes.second, &slopes.third, &slopes.sizes}) to.put_all(*each);
    to.put_all(slopes.near_axis);
}
} // namespace

std::vector<double> pack_lens(int64_t code, const Region &valid, double width, double height,
                              double edge_tolerance, double field_tolerance) {
    const auto planes =
        prove_all(ideal_planes(code, valid, width, height), width, height, edge_tolerance);
    double seen = 0.0;
    for (const Proved &each : planes) seen += seen_area(each);
    Numbered row;
    row.put(code, 0, 0, planes.size(), width, height, width * height - seen);
    row.put_all(valid.params);
    for (const Proved &each : planes) put_plane(each, field_tolerance, row);
    return row.take();
}

} // namespace rastercov::lens
