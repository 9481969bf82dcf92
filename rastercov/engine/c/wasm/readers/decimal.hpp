// The nearest double of digits and an exponent, by the host: strtod takes 16 kB, for floats of 128
// bits.
#pragma once
extern "C" __attribute__((import_module("host"), import_name("number"))) double
rc_host_number(const char *text);

namespace rastercov::readers {
inline double decimal(const char *text) { return rc_host_number(text); }
} // namespace rastercov::readers
