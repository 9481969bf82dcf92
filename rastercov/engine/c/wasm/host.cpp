// What a module of WebAssembly asks of its host: a way out of a call that fails.
//
// The host makes an error of its code and line, and drops the instance: nothing is unwound here.
//
// Twin: tests/native/test_wasm.py.
#include "c/handles.hpp"
#include "interrupt.hpp"
#include "rastercov.h"
#include <new>

extern "C" {
// Of .ci/wasm_table: names, types and offsets of rastercov.h, as JSON.
extern const char rc_table_text[];
[[noreturn]] __attribute__((import_module("host"), import_name("fail"))) void
rc_host_fail(int status, const char *text, double got, const char *remedy);
__attribute__((export_name("rc_table"))) const char *rc_table(void) { return rc_table_text; }
__attribute__((export_name("rc_allocate"))) void *rc_allocate(int64_t n) {
    return operator new(size_t(n));
}
// Objects of a thread live as long as the module.
int __cxa_thread_atexit(void (*)(void *), void *, void *) { return 0; }
__attribute__((export_name("rc_release"))) void rc_release(void *bytes) { operator delete(bytes); }
}

// In place of that of libc++, which has the formats of printf: where it would throw.
namespace std {
inline namespace __1 {
void __libcpp_verbose_abort(const char *text, ...) noexcept {
    rc_host_fail(RC_FAILED, text, 0.0, nullptr);
}
} // namespace __1
} // namespace std

namespace rastercov {
void fail(const char *wanted) { fail(wanted, 0.0, nullptr); }
void fail(const char *wanted, double got, const char *remedy) {
    rc_host_fail(RC_BAD_ARGUMENT, wanted, got, remedy);
}
void c::refuse(const char *text) { rc_host_fail(RC_BAD_HANDLE, text, 0.0, nullptr); }

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
        "expected memory of up to 4 GiB, got too little; take a smaller mesh or fewer cameras", 0.0,
        nullptr);
});
} // namespace
} // namespace rastercov
