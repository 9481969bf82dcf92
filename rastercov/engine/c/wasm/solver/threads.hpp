// In place of solver/threads.hpp in a module without threads and exceptions: work in turn. The host
// stops a call by dropping its instance.
//
// Twin: tests/native/test_wasm.py.
#pragma once
#include "interrupt.hpp"
#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <mutex>
#include <vector>

namespace rastercov::engine {

using Pace = std::atomic<double>;
using GoOn = std::function<bool()>;
using Worker = std::function<void(int64_t)>;

class Sharing {
  public:
    Sharing(int64_t n, const std::function<Worker()> &make, Pace &, const GoOn &)
        : _n(n), _make(make) {}

    // Calls a worker with 0 ... n - 1.
    void run(int64_t) {
        const Worker worker = _make();
        for (int64_t i = 0; i < _n; i++) worker(i);
    }

  private:
    const int64_t _n;
    const std::function<Worker()> &_make;
};

} // namespace rastercov::engine
