// Functions of lens/rounded.hpp against those of more digits: one rounding, nearly always.
#include "lens/rounded.hpp"
#include <doctest.h>
#include <limits>
#include <random>

using namespace rastercov;

namespace {
using Wide = long double;
struct Count {
    int off = 0, all = 0;
    void add(double found, Wide wanted) {
        const double nearest = double(wanted);
        all++;
        if (found == nearest) return;
        off++;
        CHECK(std::abs(found - nearest) <=
              std::numeric_limits<double>::epsilon() * std::max(std::abs(nearest), 1e-300));
    }
    // Numbers of `long double` are rounded twice themselves: one in a thousand may differ.
    bool is_rounded() const { return 1000 * off <= all; }
};
} // namespace

TEST_CASE("functions of angles and lengths are rounded once") {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> part(-1.0, 1.0), size(-12.0, 12.0);
    Count sine, cosine, tangent, turn, length, up, back;
    for (int k = 0; k < 20'000; k++) {
        const double a = 10 * part(random), x = part(random) * std::exp2(size(random)),
                     y = part(random) * std::exp2(size(random));
        sine.add(rounded::sin(a), std::sin(Wide(a)));
        cosine.add(rounded::cos(a), std::cos(Wide(a)));
        tangent.add(rounded::tan(a), std::tan(Wide(a)));
        turn.add(rounded::atan2(y, x), std::atan2(Wide(y), Wide(x)));
        length.add(rounded::hypot(x, y), std::hypot(Wide(x), Wide(y)));
        up.add(rounded::sinh(a), std::sinh(Wide(a)));
        back.add(rounded::asinh(x), std::asinh(Wide(x)));
    }
    for (const Count &each : {sine, cosine, tangent, turn, up, back}) CHECK(each.is_rounded());
    CHECK(100 * length.off <= length.all);
}

TEST_CASE("lengths of any size, and of what is no number") {
    constexpr double MOST = std::numeric_limits<double>::max(),
                     INF = std::numeric_limits<double>::infinity(), NONE = std::nan("");
    CHECK(rounded::hypot(0.0, -0.0) == 0.0);
    CHECK(rounded::hypot(-3e-320, 4e-320) == std::hypot(3e-320, 4e-320));
    CHECK(rounded::hypot(3e300, -4e300) == std::hypot(3e300, 4e300));
    CHECK(rounded::hypot(MOST, MOST) == INF);
    CHECK(rounded::hypot(NONE, -INF) == INF);
    CHECK(std::isnan(rounded::hypot(NONE, 1.0)));
    CHECK(std::isnan(rounded::hypot(1.0, NONE)));
    CHECK(std::isnan(rounded::sin(INF)));
}

TEST_CASE("powers, and numbers in equal ratios") {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> part(0.1, 2.0);
    Count powers;
    for (int k = 0; k < 20'000; k++) {
        const double x = part(random);
        powers.add(rounded::power(x, k % 64), std::pow(Wide(x), Wide(k % 64)));
    }
    CHECK(powers.is_rounded());
    for (const int n : {3, 12, 2049})
        for (int k = 0; k < n; k++)
            CHECK(rounded::geometric(1e-3, 1.5, k, n) ==
                  doctest::Approx(1e-3 * std::pow(1500.0, double(k) / (n - 1))).epsilon(1e-14));
    CHECK(rounded::geometric(1e-3, 1.5, 11, 12) == 1.5);
}
