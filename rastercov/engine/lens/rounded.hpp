// Functions whose bits are equal in every library of C and in pages, for what is proved of lenses.
//
// Sums of two numbers, 106 bits, are rounded once: T. J. Dekker. A Floating-Point Technique for
// Extending the Available Precision. 1971. Where the library's own value is the start of a step of
// Newton's method, the last digits of it do not count.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include <cmath>

namespace rastercov::rounded {

// For angles up to 1e6.
double sin(double angle);
double cos(double angle);
double tan(double angle);
double atan2(double y, double x);
double hypot(double a, double b);
double sinh(double x); // for |x| < 30, as its inverse
double asinh(double x);
double power(double x, int n); // n >= 0

// The k-th of n numbers from one to another, in equal ratios.
double geometric(double first, double last, int k, int n);

inline double acos(double x) { return atan2(std::sqrt((1.0 - x) * (1.0 + x)), x); }
inline double atan(double x) { return atan2(x, 1.0); }

} // namespace rastercov::rounded
