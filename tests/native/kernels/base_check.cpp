// What the compiler must not change, computed: for tests of each level.
//
// A fused operation rounds once where two operations round twice; error-free transformations, such
// as those of double-double numbers, need the two (T. J. Dekker. A floating-point technique for
// extending the available precision. 1971). Twin: numpy, in tests/native/test_levels.py.
#include "bind.hpp"
#include "simd.hpp"

namespace rastercov {
namespace {

double multiply_add(double a, double b, double c) { return a * b + c; }

struct Lanes {
    Array<const double, LANES> a, b, c;
    Array<const int32_t, LANES> index;
    bool is_squared;
};

// Rows of `out`: a * b + c, floor(a), sqrt(|a|), the lesser and the greater of a and b, a at
// indices; or their squares. `masks`: bits of a < b of doubles and of floats, and those bits made a
// mask and read again.
void combine(const Lanes &lanes, Array<double, 6, LANES> out, Array<int64_t, 3> masks) {
    const auto &[a, b, c, index, is_squared] = lanes;
    require_indices(index, LANES, "index must hold lanes");
    const Double x = Double::load(a.data), y = Double::load(b.data), z = Double::load(c.data);
    (x * y + z).store(out[0].data);
    floor(x).store(out[1].data);
    sqrt(abs(x)).store(out[2].data);
    min(x, y).store(out[3].data);
    max(x, y).store(out[4].data);
    gather(a.data, Int::load(index.data)).store(out[5].data);
    if (is_squared)
        for (double &value : out) value *= value;
    masks[0] = bits(x < y);
    masks[1] = bits(to<float>(x) < to<float>(y));
    masks[2] = bits(as_mask(masks[1]));
}

} // namespace

RECORD(Lanes, a, b, c, index, is_squared);

void register_base_check(nanobind::module_ &m) {
    def(m, "multiply_add", multiply_add, "a b + c, rounded twice.", "a", "b", "c");
    def(m, "combine", combine, "Operations of vectors; see tests/native/test_levels.py.", "lanes",
        "out", "masks");
}

} // namespace rastercov
