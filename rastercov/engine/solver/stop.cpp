// Stops of threads, and what poll_interrupt looks at.
//
// Twin: tests/test_signals.py.
#include "interrupt.hpp"
#include <atomic>
#include <vector>

namespace rastercov {

struct Stop::Flag {
    std::atomic<bool> is_set = false;
    std::shared_ptr<Flag> above;
    static thread_local std::vector<std::shared_ptr<Flag>> followed; // the last one is at work
    static thread_local const Flag *current;
};
thread_local std::vector<std::shared_ptr<Stop::Flag>> Stop::Flag::followed;
thread_local const Stop::Flag *Stop::Flag::current = nullptr;

Stop::Stop() : _flag(std::make_shared<Flag>()) {
    if (!Flag::followed.empty()) _flag->above = Flag::followed.back();
}
void Stop::set() { _flag->is_set = true; }
bool Stop::is_set() const { return _flag->is_set.load(std::memory_order_relaxed); }
void Stop::enter() {
    Flag::followed.push_back(_flag);
    Flag::current = _flag.get();
}
void Stop::leave() {
    auto &followed = Flag::followed;
    if (!followed.empty()) followed.pop_back();
    Flag::current = followed.empty() ? nullptr : followed.back().get();
}

void poll_interrupt() {
    for (const Stop::Flag *flag = Stop::Flag::current; flag; flag = flag->above.get())
        if (flag->is_set.load(std::memory_order_relaxed)) throw Interrupted();
    look_at_signals();
}

} // namespace rastercov
