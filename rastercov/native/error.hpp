// The one error of the engine, and the one way to raise it; no Python in this file.
//
// A build without exceptions replaces `fail`, which leaves through its host.
#pragma once
#include <stdexcept>

namespace rastercov {

// What was wanted of an argument; ValueError in Python.
struct Error : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

[[noreturn]] inline void fail(const char *wanted) { throw Error(wanted); }

} // namespace rastercov
