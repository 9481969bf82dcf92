// The nearest double of digits and an exponent, without a point, which depends on the locale.
//
// Twin: tests/mesh/test_page_readers.py.
#pragma once
#include <cstdlib>

namespace rastercov::readers {
inline double decimal(const char *text) { return std::strtod(text, nullptr); }
} // namespace rastercov::readers
