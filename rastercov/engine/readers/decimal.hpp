// The nearest double of digits and an exponent, without a point, which depends on the locale.
#pragma once
#include <cstdlib>

namespace rastercov::readers {
inline double decimal(const char *text) { return std::strtod(text, nullptr); }
} // namespace rastercov::readers
