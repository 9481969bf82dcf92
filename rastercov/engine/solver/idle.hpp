// Objects that calls take and give back, and threads that work with them.
//
// Without a lock, so that neither a fork nor the handler of a signal finds it locked.
//
// Twins: tests/test_threads.py.
#pragma once
#include "solver/threads.hpp"
#include <algorithm>
#include <memory>

namespace rastercov::engine {

template <class T> class Idle {
  public:
    explicit Idle(int64_t most) : _slots(size_t(most)) {}
    ~Idle() { close(); }
    Idle(const Idle &) = delete;

    // One that nothing else uses; none where all are in use.
    std::unique_ptr<T> take() {
        std::unique_ptr<T> taken;
        for (auto &slot : _slots)
            if (!taken) taken.reset(slot.exchange(nullptr));
        return taken;
    }
    // Keeps what a call that ended well has taken; what an error has left half changed is dropped.
    void give_back(std::unique_ptr<T> taken) {
        for (auto &slot : _slots) {
            T *none = nullptr;
            if (_is_open && slot.compare_exchange_strong(none, taken.get())) {
                taken.release();
                break;
            }
        }
        if (!_is_open) close();
    }
    void close() {
        _is_open = false;
        for (auto &slot : _slots) delete slot.exchange(nullptr);
    }
    int64_t size() const {
        return std::count_if(_slots.begin(), _slots.end(),
                             [](const auto &slot) { return slot != nullptr; });
    }

  private:
    std::vector<std::atomic<T *>> _slots;
    std::atomic<bool> _is_open = true;
};

// Shares n pieces of work among threads, each with an idle object or one that `prepare` makes of
// what was idle, which may be none.
template <class T, class Prepare, class Work>
void share(int64_t n, int64_t n_threads, Idle<T> &idle, Prepare prepare, Pace &pace,
           const GoOn &go_on, const Work &work) {
    std::vector<std::unique_ptr<T>> used(size_t(std::max<int64_t>(n_threads, 1)));
    std::atomic<size_t> n_used = 0;
    const auto make = [&]() -> Worker {
        auto &slot = used[n_used++];
        slot = prepare(idle.take());
        return [&work, &own = *slot](int64_t i) { work(own, i); };
    };
    if (n > 0) Sharing(n, make, pace, go_on).run(std::min(n_threads, n));
    for (auto &each : used)
        if (each) idle.give_back(std::move(each));
}

} // namespace rastercov::engine
