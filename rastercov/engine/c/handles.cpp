// What all calls of a library share.
//
// Twin: tests/native/test_c_border.py.
#include "c/objects.hpp"

namespace rastercov::c {
Handles &handles() {
    static Handles all;
    return all;
}

std::string &last_error() {
    thread_local std::string text = "no call of this thread has failed";
    return text;
}
} // namespace rastercov::c
