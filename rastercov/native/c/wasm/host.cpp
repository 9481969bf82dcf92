// What a module of WebAssembly asks of its host: a way out of a call that fails.
//
// The host makes an error of its code and line, and drops the instance: nothing is unwound here.
//
// Twin: tests/native/test_wasm.py.
#include "c/handles.hpp"
#include "interrupt.hpp"
#include "rastercov.h"
#include <math.h>
#include <new>

extern "C" {
// Rounded once, as nearly all results of other libraries of C are: borders of the angle of
// incidence have their bits.
double sin(double angle) { return double(sinl(angle)); }
double cos(double angle) { return double(cosl(angle)); }
// Of .ci/wasm_table: names, types and offsets of rastercov.h, as JSON.
extern const char rc_table_text[];
[[noreturn]] __attribute__((import_module("host"), import_name("fail"))) void
rc_host_fail(int status, const char *text);
__attribute__((export_name("rc_table"))) const char *rc_table(void) { return rc_table_text; }
__attribute__((export_name("rc_allocate"))) void *rc_allocate(int64_t n) {
    return operator new(size_t(n));
}
// Objects of a thread live as long as the module.
int __cxa_thread_atexit(void (*)(void *), void *, void *) { return 0; }
__attribute__((export_name("rc_release"))) void rc_release(void *bytes) { operator delete(bytes); }
}

namespace rastercov {
void fail(const char *wanted) { rc_host_fail(RC_BAD_ARGUMENT, wanted); }
void c::refuse(const char *text) { rc_host_fail(RC_BAD_HANDLE, text); }

Stop::Stop() = default;
void Stop::set() {}
bool Stop::is_set() const { return false; }
void Stop::enter() {}
void Stop::leave() {}
void poll_interrupt() {}

namespace {
// Where memory ends operator new asks this: by it the line is that of the library.
const auto at_end = std::set_new_handler([] {
    rc_host_fail(
        RC_OUT_OF_MEMORY,
        "expected memory of up to 4 GiB, got too little; take a smaller mesh or fewer cameras");
});
} // namespace
} // namespace rastercov
