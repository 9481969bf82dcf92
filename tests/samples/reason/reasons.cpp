// Reasons of a face by the area of its image, px^2.
#include "coverage/decision.hpp"
#include <cstdio>

using namespace rastercov;
using namespace rastercov::coverage;

int main() {
    Rules rules = {};
    rules.min_pixels = 1.0;
    const Lens lens = {100.0, 100.0, 50.0, 50.0, 100.0, 100.0};
    for (const double drawn : {0.0, 1e-4, 1.0}) {
        Measures<double> face = {};
        face.is_front = face.is_inside = face.has_part = face.is_focused = true;
        face.visible = face.drawn = drawn;
        face.cosine = 1.0;
        face.own = COVERED;
        std::printf("%d\n", int(decide<double>(rules, face, lens).reason));
    }
    std::printf("%d %d\n", int(FIRST_OF_SEVERAL), int(ANGLE_OUT_OF_RANGE));
}
