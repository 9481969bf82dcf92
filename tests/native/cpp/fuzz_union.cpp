// Random calls of Union: fuzz_union N SEED. Pieces and pairs that are right, and those with one
// array spoilt; memory that runs out, interrupts and progress that throws at any place. A crash, an
// index outside, or a union that a call which failed has changed, is a fault; the counts of the
// outcomes are printed.
#include "interrupt.hpp"
#include "solver/union.hpp"
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <numbers>
#include <random>

namespace {
// Allocations that succeed, and looks at interrupts that find none, from now on; -1 for all.
int64_t allocations = -1, looks = -1;
bool is_at_end(int64_t &left) { return left >= 0 && left-- == 0; }
} // namespace

// None is inlined, where a compiler would hold malloc and free against one another's operators.
[[gnu::noinline]] void *operator new(size_t size, const std::nothrow_t &) noexcept {
    return is_at_end(allocations) ? nullptr : std::malloc(size ? size : 1);
}
[[gnu::noinline]] void *operator new(size_t size) {
    void *memory = operator new(size, std::nothrow);
    if (!memory) throw std::bad_alloc();
    return memory;
}
[[gnu::noinline]] void operator delete(void *memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void *memory, size_t) noexcept { std::free(memory); }

void rastercov::look_at_signals() { // in place of that of the library
    if (is_at_end(looks)) throw Interrupted();
}

namespace {
using namespace rastercov;
using namespace rastercov::engine;

std::mt19937_64 numbers;
int64_t below(int64_t n) { return int64_t(numbers() % uint64_t(n)); }
double between(double a, double b) {
    return a + (b - a) * double(numbers() >> 11) * 0x1p-53; // the same with any library
}
template <class T> auto rows_of(const std::vector<T> &values) {
    return Array<const T, Any>{values.data(), {int64_t(values.size())}};
}

// Sets some values to odd ones, or to others of the same array.
template <class T> void spoil(std::vector<T> &values) {
    static const double ODD[] = {0.0, -0.0, 1, -2.5, 1e-300, 1e300, INFINITY, -INFINITY, NAN};
    static const int64_t WHOLE[] = {0, 1, 3, -1, 7, 40, INT32_MAX, INT32_MIN, int64_t(1) << 62};
    if (values.empty()) return;
    const auto any = [&]() -> T & { return values[size_t(below(int64_t(values.size())))]; };
    for (int64_t n = 1 + below(3); n > 0; n--)
        if (below(2)) any() = any();
        else if constexpr (std::is_same_v<T, double>) any() = ODD[below(9)];
        else any() = T(WHOLE[below(9)]);
}

struct Faces {
    std::vector<double> corners, areas;
    Faces() {
        for (int64_t n = 1 + below(3); n > 0; n--) {
            const double length = between(3, 8), x = between(0, length), y = between(1, 5);
            corners.insert(corners.end(), {0.0, 0.0, length, 0.0, x, y});
            areas.push_back(length * y / 2);
        }
        if (below(8) == 0) spoil(corners);
        if (below(10) == 0) spoil(areas);
    }
    int64_t n() const { return int64_t(areas.size()); }
    FlatFaces view() const { return {{corners.data(), {n(), 3, 2}}, rows_of(areas)}; }
};

constexpr int64_t N_POSES = 3;
enum Kind { ANY, LARGE, THIN, MANY_SIDED };

// Convex pieces of some poses, by pose and face, their pairs and the bits of the poses.
struct Given {
    std::vector<double> xy, area, bound, excess;
    std::vector<int64_t> starts = {0}, number;
    std::vector<int32_t> face, pose, pair_face, pair_pose;

    Given(const Faces &faces, bool are_sets) {
        const auto kind = Kind(below(4));
        const int64_t n = kind == LARGE ? below(30) : below(3) ? below(80) : below(250);
        std::vector<std::pair<int32_t, int32_t>> keys;
        for (int64_t i = 0; i < n; i++)
            keys.emplace_back(int32_t(below(N_POSES)), int32_t(below(faces.n())));
        std::sort(keys.begin(), keys.end());
        for (const auto &[of_pose, of_face] : keys) {
            pose.push_back(of_pose);
            face.push_back(of_face);
            add_piece(kind);
        }
        keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
        for (const auto &[of_pose, of_face] : keys) {
            pair_pose.push_back(of_pose);
            pair_face.push_back(of_face);
            area.push_back(below(12) ? 0.1 : faces.areas[size_t(of_face)]);
            bound.push_back(between(0, 1e-8));
            excess.push_back(between(0, 1e-9));
        }
        for (int64_t p = 0; are_sets && p < N_POSES; p++) number.push_back(below(64));
        if (below(3) == 0) spoil_one();
    }

    void add_piece(Kind kind) {
        const double x = between(0.3, 3), y = between(0.1, 1.2), turn = between(0, 6);
        const double size = between(0.01, kind == LARGE ? 1.5 : 0.3);
        const int64_t n = 3 + (kind == MANY_SIDED ? below(below(4) ? 8 : 60) : below(3));
        for (int64_t k = 0; k < n; k++) {
            const double angle = 2 * std::numbers::pi * double(k) / double(n);
            const double u = size * std::cos(angle);
            const double v = size * (kind == THIN ? 1e-3 : 1.0) * std::sin(angle);
            xy.push_back(x + u * std::cos(turn) - v * std::sin(turn));
            xy.push_back(y + u * std::sin(turn) + v * std::cos(turn));
        }
        starts.push_back(starts.back() + n);
    }

    void spoil_one() {
        const auto spoil_at = [k = below(9)](auto &...arrays) {
            int64_t at = 0;
            ((at++ == k ? spoil(arrays) : void()), ...);
        };
        spoil_at(xy, starts, face, pose, pair_pose, pair_face, area, bound, number);
    }

    RegionPieces pieces() const {
        return {
            {xy.data(), {int64_t(xy.size() / 2)}}, rows_of(starts), rows_of(face), rows_of(pose)};
    }
    RegionPairs pairs() const {
        return {rows_of(pair_pose), rows_of(pair_face), rows_of(area), rows_of(bound),
                rows_of(excess)};
    }
};

// All that a union tells, as bytes.
std::vector<char> state_of(const Union &all) {
    std::vector<char> bytes;
    const auto read = [&](int64_t n, auto value, auto write) {
        const auto values = std::make_unique<decltype(value)[]>(size_t(n));
        write(values.get());
        const auto *first = reinterpret_cast<const char *>(values.get());
        bytes.insert(bytes.end(), first, first + size_t(n) * sizeof value);
    };
    const auto [n, n_corners] = all.size();
    const int64_t n_faces = all.n_faces(), views = 3;
    std::vector<double> xy(size_t(2 * n_corners)), area(static_cast<size_t>(n));
    std::vector<int64_t> starts(size_t(n + 1)), tag(static_cast<size_t>(n));
    read(n, int32_t(), [&](int32_t *face) {
        all.write({xy.data(), {n_corners}}, {starts.data(), {n + 1}}, {face, {n}},
                  {tag.data(), {n}}, {area.data(), {n}});
    });
    read(2 * n_corners, 0.0, [&](double *out) { std::copy(xy.begin(), xy.end(), out); });
    read(n, 0.0, [&](double *out) { std::copy(area.begin(), area.end(), out); });
    read(n + 1, n, [&](int64_t *out) { std::copy(starts.begin(), starts.end(), out); });
    read(n, n, [&](int64_t *out) { std::copy(tag.begin(), tag.end(), out); });
    read(views * n_faces, 0.0, [&](double *out) { all.write_areas({out, {views, n_faces}}); });
    read(2 * n_faces, 0.0, [&](double *out) { all.write_bounds({out, {2, n_faces}}); });
    read(n_faces, bool(), [&](bool *out) { all.write_closed({out, {n_faces}}); });
    return bytes;
}

enum Outcome { DONE, REFUSED, INTERRUPTED, NO_MEMORY, THROWN, N_OUTCOMES };

// One call that changes a union, or fails.
Outcome change(Union &all, const Faces &faces) {
    const Given given(faces, all.views() == 0);
    const auto chosen = std::make_unique<bool[]>(size_t(faces.n()));
    for (int64_t f = 0; f < faces.n(); f++) chosen[size_t(f)] = below(2);
    int64_t told = below(5) ? -1 : below(3);
    const bool fills = all.views() > 0 && below(12) == 0;
    const Progress progress = [&](int64_t done, int64_t total) {
        if (done > total) std::abort();
        if (is_at_end(told)) throw 7;
    };
    looks = below(6) ? -1 : below(30);
    allocations = below(6) ? -1 : below(200);
    Outcome outcome = DONE;
    try {
        if (fills) all.fill({chosen.get(), {faces.n()}});
        else all.add(given.pieces(), given.pairs(), rows_of(given.number), progress);
    } catch (const Error &) {
        outcome = REFUSED;
    } catch (const Interrupted &) {
        outcome = INTERRUPTED;
    } catch (const std::bad_alloc &) {
        outcome = NO_MEMORY;
    } catch (int) {
        outcome = THROWN;
    }
    looks = allocations = -1;
    return outcome;
}
} // namespace

int main(int n_arguments, char **arguments) {
    const int64_t n = n_arguments > 1 ? std::atoll(arguments[1]) : 2000;
    numbers.seed(n_arguments > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1);
    long long counts[N_OUTCOMES] = {};
    for (int64_t k = 0; k < n;) {
        const Faces faces;
        std::unique_ptr<Union> all;
        try {
            const double least = below(9) ? 1e-15 : 0.1;
            all = std::make_unique<Union>(faces.view(), least, below(4), 1 + below(40));
        } catch (const Error &) {
            counts[REFUSED]++;
            k++;
            continue;
        }
        for (const int64_t end = k + 5; k < end; k++) {
            const std::vector<char> before = state_of(*all);
            const Outcome outcome = change(*all, faces);
            counts[outcome]++;
            if (outcome == DONE || state_of(*all) == before) continue;
            std::printf("call %lld failed, and has changed the union\n", static_cast<long long>(k));
            return 1;
        }
    }
    std::printf("%lld calls: %lld done, %lld refused, %lld interrupted, %lld out of memory, "
                "%lld ended by their progress\n",
                static_cast<long long>(n), counts[DONE], counts[REFUSED], counts[INTERRUPTED],
                counts[NO_MEMORY], counts[THROWN]);
    return 0;
}
