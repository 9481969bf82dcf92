// Level of this processor: 2, 3 or 4 for x86-64-v2, v3, v4; 0 for none of them.
//
// Built for any processor and imported first, by rastercov.engine. A level counts only if the
// operating system keeps its registers, which XGETBV says. CMake runs it as a program, too.
// Source: System V ABI, x86-64 psABI, section 3.1.1, for the features of each level.
#if defined(__x86_64__)
#include <cpuid.h>

static bool has(unsigned word, unsigned wanted) { return (word & wanted) == wanted; }

static int level() {
    unsigned a, b, c, d, features, more, ext, low, high;
    if (!__get_cpuid(1, &a, &b, &features, &d)) return 0;
    // SSE3, SSSE3, SSE4.1, SSE4.2, POPCNT
    if (!has(features, 1u << 0 | 1u << 9 | 1u << 19 | 1u << 20 | 1u << 23)) return 0;
    // FMA, MOVBE, OSXSAVE, AVX, F16C
    if (!has(features, 1u << 12 | 1u << 22 | 1u << 27 | 1u << 28 | 1u << 29)) return 2;
    if (!__get_cpuid_count(7, 0, &a, &more, &c, &d)) return 2;
    if (!__get_cpuid(0x80000001, &a, &b, &ext, &d)) return 2;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    // BMI1, AVX2, BMI2; LZCNT; registers of AVX
    if (!has(more, 1u << 3 | 1u << 5 | 1u << 8) || !has(ext, 1u << 5) || !has(low, 0x6)) return 2;
    // AVX512 F, DQ, CD, BW, VL; registers of AVX-512
    const unsigned wide = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;
    return has(more, wide) && has(low, 0xe6) ? 4 : 3;
}
#else
static int level() { return 0; }
#endif

#ifdef RASTERCOV_PROBE
int main() { return level(); }
#else
#include <Python.h>

static PyObject *python_level(PyObject *, PyObject *) { return PyLong_FromLong(level()); }

static PyMethodDef methods[] = {
    {"level", python_level, METH_NOARGS, "Number of the x86-64 level, 0 for none."},
    {nullptr, nullptr, 0, nullptr},
};
static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_cpu", nullptr, 0, methods, nullptr, nullptr, nullptr, nullptr,
};
PyMODINIT_FUNC PyInit__cpu() { return PyModule_Create(&definition); }
#endif
