// Sine, cosine, tangent and length of pages, those of lens/rounded.hpp.
//
// Twin: tests/native/test_wasm.py.
#include "c/objects.hpp"
#include "lens/rounded.hpp"

double rastercov::c::tangent_of(double angle) { return rounded::tan(angle); }

extern "C" {
double sin(double angle) { return rastercov::rounded::sin(angle); }
double cos(double angle) { return rastercov::rounded::cos(angle); }
double hypot(double a, double b) { return rastercov::rounded::hypot(a, b); }
}
