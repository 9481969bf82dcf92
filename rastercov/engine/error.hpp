// The one error of the engine, and the ways to raise it; no Python in this file.
//
// A build without exceptions has its own `fail`, which leaves through its host.
#pragma once
#include <cstdio>
#include <stdexcept>
#include <type_traits>

namespace rastercov {

// What was wanted of an argument; ValueError in Python.
struct Error : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

#ifdef __cpp_exceptions
[[noreturn]] inline void fail(const char *wanted) { throw Error(wanted); }
#else
[[noreturn]] void fail(const char *wanted);
[[noreturn]] void fail(const char *wanted, double got, const char *remedy);
#endif

// Checks what a user passes: expected `wanted`, got a number; do `remedy`.
template <class Number>
void expect(bool is_right, const char *wanted, Number got, const char *remedy) {
    if (is_right) return;
#ifdef __cpp_exceptions
    char text[200];
    if constexpr (std::is_floating_point_v<Number>)
        std::snprintf(text, sizeof text, "expected %s, got %.9g; %s", wanted, got, remedy);
    else
        std::snprintf(text, sizeof text, "expected %s, got %lld; %s", wanted,
                      static_cast<long long>(got), remedy);
    fail(text);
#else
    fail(wanted, double(got), remedy);
#endif
}

} // namespace rastercov
