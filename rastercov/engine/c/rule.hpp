// Devices of a rig that measure together, for calls of C that take them further.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "c/objects.hpp"

namespace rastercov::c {

// Regions of the faces that a test chooses.
template <class Test> engine::Regions choose_regions(const engine::Regions &from, Test test) {
    engine::Regions out;
    auto at = from.xy.begin();
    for (size_t p = 0; p < from.face.size(); p++) {
        const auto next = at + 2 * from.n_corners[p];
        if (test(from.face[p])) {
            out.xy.insert(out.xy.end(), at, next);
            out.n_corners.push_back(from.n_corners[p]);
            out.face.push_back(from.face[p]);
        }
        at = next;
    }
    for (size_t k = 0; k < from.listed.size(); k++) {
        if (!test(from.listed[k])) continue;
        out.listed.push_back(from.listed[k]);
        out.area.push_back(from.area[k]);
        out.bound.push_back(from.bound[k]);
        out.excess.push_back(from.excess[k]);
    }
    return out;
}

void check_gate(const rc_gate *gate, int64_t n);
// What n devices measure together, of what each sees in its pose.
engine::Regions measured_by(const engine::Mesh &mesh, const rc_gate &gate, const double *poses,
                            const std::vector<const engine::Regions *> &regions);

} // namespace rastercov::c
