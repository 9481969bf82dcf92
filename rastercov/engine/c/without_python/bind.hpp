// In place of bind.hpp where there is no Python: what loops offer to it is left out.
#pragma once
#include "array.hpp"

namespace nanobind {
struct module_ {
    struct Attribute {
        template <class T> void operator=(const T &) {}
    };
    static Attribute attr(const char *) { return {}; }
};
} // namespace nanobind

namespace rastercov {
template <class... What> void def(What &&...) {}
} // namespace rastercov
