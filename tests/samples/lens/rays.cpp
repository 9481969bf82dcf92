// Images of random rays by a model, and the rays of these images.
#include "lens/models.hpp"
#include "rastercov.h"
#include <cstdio>
#include <random>

using namespace rastercov::lens;

#define CODE(name, ...) static_assert(int(RC_MODEL_##name) == int(MODEL_##name));
RASTERCOV_MODELS(CODE)

int main() {
    const double none[SIZE] = {};
    std::mt19937_64 numbers(1);
    std::normal_distribution<double> normal;
    std::printf("%d\n", int(STEREOGRAPHIC));
    for (int n = 0; n < 1000; n++) {
        const double X = normal(numbers);
        const double Y = normal(numbers);
        const double Z = normal(numbers);
        const auto [x, y] = image_of_base(STEREOGRAPHIC, Params{none}, X, Y, Z);
        const Ray ray = ray_of(STEREOGRAPHIC, Params{none}, x, y);
        std::printf("%a %a %a %a %a %a %a %a\n", X, Y, Z, x, y, ray.X, ray.Y, ray.Z);
    }
}
