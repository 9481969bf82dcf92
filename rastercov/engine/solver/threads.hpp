// Work that is shared among threads: the one header of the engine with threads and mutexes.
//
// Twins: tests/exact/test_batch.py.
#pragma once
#include "interrupt.hpp"
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace rastercov::engine {

// Seconds of one piece of work in the calls of an object, by which threads are started; infinite
// before the first.
using Pace = std::atomic<double>;
// Asked by the thread of the caller between two pieces of work: false ends all.
using GoOn = std::function<bool()>;
using Worker = std::function<void(int64_t)>;

// Seconds of work in all up to which it stays in the thread of the caller, and of work that is left
// for each further thread: one takes 0.05 ms to start.
constexpr double LEAST_WORK = 1e-3, LEAST_SHARE = 0.3e-3;
constexpr auto WAIT = std::chrono::milliseconds(20); // between two looks at interrupts

class Sharing {
  public:
    Sharing(int64_t n, const std::function<Worker()> &make, Pace &pace, const GoOn &go_on)
        : _n(n), _make(make), _pace(pace), _go_on(go_on) {}

    // Calls workers, one made for each of up to n_threads threads, with 0 ... n - 1. What one of
    // them throws first is thrown, and ends all; so does an interrupt.
    void run(int64_t n_threads) {
        start(n_threads);
        work(n_threads, true);
        wait();
        for (std::thread &each : _threads) each.join();
        if (_raised) std::rethrow_exception(_raised);
    }

  private:
    using Clock = std::chrono::steady_clock;

    // Starts the threads that what is left is worth.
    void start(int64_t n_threads) {
        const double left = double(_n - _next) * _pace;
        if (!_threads.empty() || !(left >= LEAST_WORK && left < INFINITY)) return;
        const double most = std::min(double(n_threads - 1), left / LEAST_SHARE);
        try {
            for (int64_t k = 0; k < int64_t(most); k++) {
                _n_working++;
                _threads.emplace_back([this] { work(0, false); });
            }
        } catch (const std::system_error &) { // no more threads: those that run share all
            _n_working--;
        }
    }

    void work(int64_t n_threads, bool is_caller) {
        _stop.enter();
        try {
            const Worker worker = _make();
            for (int64_t i = _next++; i < _n && !_stop.is_set(); i = _next++) {
                const auto began = Clock::now();
                worker(i);
                if (!is_caller) continue;
                _pace = std::chrono::duration<double>(Clock::now() - began).count();
                start(n_threads);
                go_on();
            }
        } catch (...) {
            keep_raised();
        }
        Stop::leave();
        if (is_caller) return;
        const std::scoped_lock lock(_changes);
        _n_working--;
        _has_ended.notify_all();
    }

    void go_on() {
        poll_interrupt();
        if (_go_on && !_go_on()) throw Interrupted();
    }

    void keep_raised() {
        const std::scoped_lock lock(_changes);
        if (!_raised) _raised = std::current_exception();
        _stop.set();
    }

    // Waits for the other threads, and looks at interrupts.
    void wait() {
        while (true) {
            {
                std::unique_lock lock(_changes);
                if (_has_ended.wait_for(lock, WAIT, [&] { return _n_working == 0; })) return;
            }
            try {
                if (!_stop.is_set()) go_on();
            } catch (...) {
                keep_raised();
            }
        }
    }

    const int64_t _n;
    const std::function<Worker()> &_make;
    Pace &_pace;
    const GoOn &_go_on;
    Stop _stop;
    std::atomic<int64_t> _next = 0;
    std::atomic<int64_t> _n_working = 0;
    std::vector<std::thread> _threads;
    std::mutex _changes;
    std::condition_variable _has_ended;
    std::exception_ptr _raised;
};

} // namespace rastercov::engine
