// Looks at interrupts from inside loops; no Python in this file.
//
// A loop that can take over 0.1 s calls poll_interrupt() once for each of its larger parts (a pose,
// a face with its neighbours, a cell), or a `Poll` once for each small one. In the main thread of
// Python this runs the handlers of signals every 50 ms, and passes on what they raise. In a thread
// that follows a `Stop` it raises Interrupted, which is KeyboardInterrupt in Python, once the stop
// is set. Any other thread goes on: its call completes normally. Nothing is kept between calls, so
// no call meets the interrupt of an earlier one. What a loop that was left has half written is used
// by no one; locks and memory are given back by destructors.
#pragma once
#include <exception>
#include <memory>

namespace rastercov {

// Left a loop because its stop is set.
struct Interrupted : std::exception {
    const char *what() const noexcept override { return "interrupted"; }
};

// Raises where the loop must end: 30 ns, for parts of some microseconds or more.
void poll_interrupt();

// What it asks at last, of the border that a program has: signals of Python, or nothing.
void look_at_signals();

// Ends the loops of the threads that have entered it, once it is set; also by a stop above it: that
// of the thread that made it.
class Stop {
  public:
    Stop();
    void set();
    bool is_set() const;
    void enter();        // follow it in this thread
    static void leave(); // follow again what this thread followed before

  private:
    struct Flag;
    friend void poll_interrupt();
    std::shared_ptr<Flag> _flag;
};

// poll_interrupt at every `every`-th call: 1 ns, for short parts.
class Poll {
  public:
    explicit Poll(unsigned every = 256) : _every(every) {}
    void operator()() {
        if (++_calls < _every) return;
        _calls = 0;
        poll_interrupt();
    }

  private:
    unsigned _every, _calls = 0;
};

} // namespace rastercov
