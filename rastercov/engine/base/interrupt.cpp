// Interrupts of loops: what poll_interrupt looks at, and the end of a process that cannot look.
//
// `Stop` ends the loops of some threads together. `Watch` ends a process some time after a signal,
// whatever its threads are at: they may be in a library that looks at nothing, and hold the lock of
// Python. Python writes the number of each signal to a descriptor, which a thread here reads.
// Twin: tests/test_signals.py.
#include "interrupt.hpp"
#include "bind.hpp"
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <memory>
#include <thread>
#include <vector>
#ifndef _WIN32
#include <csignal>
#include <unistd.h>
#endif

namespace rastercov {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto LOOK = std::chrono::milliseconds(50); // between two looks at signals

unsigned long main_thread = 0;
thread_local Clock::time_point next_look;

std::atomic<int> n_holds = 0;
std::atomic<bool> is_announced = false;

void wait_and_end(int descriptor, double seconds) {
#ifndef _WIN32
    unsigned char number = 0;
    while (number != SIGINT && number != SIGTERM) {
        const auto n = read(descriptor, &number, 1);
        if (n == 0 || (n < 0 && errno != EINTR)) return;
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    while (n_holds > 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    static constexpr char LINE[] = "interrupted\n";
    if (!is_announced) (void)!write(STDERR_FILENO, LINE, sizeof LINE - 1);
    _exit(128 + number);
#endif
}

// End of this process, `seconds` after SIGINT or SIGTERM was read from a descriptor.
struct Watch {
    int64_t descriptor;
    double seconds;
    Watch(int64_t descriptor, double seconds) : descriptor(descriptor), seconds(seconds) {}
};

void start(Watch &watch) {
#ifndef _WIN32
    sigset_t all, before; // signals are for the other threads, whose calls of the system they end
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    std::thread(wait_and_end, int(watch.descriptor), watch.seconds).detach();
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
#endif
}
void hold(Watch &) { n_holds++; }
void release(Watch &) { n_holds--; }
void announce(Watch &) { is_announced = true; }

void leave(Stop &) { Stop::leave(); }

// Polls that many times, for tests.
void poll(int64_t count) {
    for (int64_t i = 0; i < count; i++) poll_interrupt();
}

} // namespace

void look_at_signals() {
    const auto now = Clock::now();
    if (now < next_look) return;
    next_look = now + LOOK;
    if (PyThread_get_thread_ident() != main_thread) return;
    const nanobind::gil_scoped_acquire locked;
    if (PyErr_CheckSignals()) throw nanobind::python_error();
}

void register_base_interrupt(nanobind::module_ &m) {
    namespace nb = nanobind;
    main_thread = nb::cast<unsigned long>(
        nb::module_::import_("threading").attr("main_thread")().attr("ident"));
    nb::class_<Stop> stop(m, "Stop", "End of the loops of the threads that have entered it.");
    stop.def(nb::init<>(), nb::sig("def __init__(self) -> None"));
    def(stop, "set", &Stop::set, "End them; again it does nothing.");
    def(stop, "enter", &Stop::enter, "Follow it in this thread.");
    def(stop, "leave", leave, "Follow again what this thread followed before.");
    nb::class_<Watch> watch(m, "Watch", "End of this process some time after SIGINT or SIGTERM.");
    watch.def(nb::init<int64_t, double>(), nb::arg("descriptor"), nb::arg("seconds"),
              nb::sig("def __init__(self, descriptor: int, seconds: float) -> None"));
    def(watch, "start", start, "Read the numbers of signals from the descriptor.");
    def(watch, "hold", hold, "Put the end off.");
    def(watch, "release", release, "Let the end come.");
    def(watch, "announce", announce, "Leave out the line on standard error.");
    def(m, "poll", poll, "Poll that many times; an interrupt ends it.", "count");
}

} // namespace rastercov
