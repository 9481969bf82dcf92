// A host in C has no signals to look at: its callbacks stop a call. A test has its own function.
//
// Twin: tests/native/test_c_border.py.
#include "interrupt.hpp"

namespace rastercov {
[[gnu::weak]] void look_at_signals() {}
} // namespace rastercov
