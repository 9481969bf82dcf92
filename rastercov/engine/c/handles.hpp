// Handles of C: numbers that are never used again, and the objects behind those that are alive.
//
// A call holds the object that it works on, so that another thread may free the handle meanwhile.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "error.hpp"
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

namespace rastercov::c {

// Its address is that of a kind of objects.
template <class T> inline constexpr char KIND = 0;

// A handle that is null, freed, or of another kind.
struct BadHandle : Error {
    using Error::Error;
};

#ifdef __cpp_exceptions
[[noreturn]] inline void refuse(const char *text) { throw BadHandle(text); }
#else
[[noreturn]] void refuse(const char *text);
#endif

class Handles {
  public:
    template <class Handle, class T> Handle *add(std::shared_ptr<T> object) {
        return reinterpret_cast<Handle *>(append(std::move(object), &KIND<T>)); // NOLINT: a number
    }

    // The object of a kind behind a handle.
    template <class T> std::shared_ptr<T> get(const void *handle, const char *kind) {
        return std::static_pointer_cast<T>(find(handle, &KIND<T>, kind, false));
    }

    template <class T> void free(const void *handle, const char *kind) {
        find(handle, &KIND<T>, kind, true); // destroyed without the lock
    }

    int64_t count();

  private:
    struct Entry {
        uintptr_t number;
        std::shared_ptr<void> object; // null once it was freed
        const char *kind;
    };

    uintptr_t append(std::shared_ptr<void> object, const char *kind);
    std::shared_ptr<void> find(const void *handle, const char *kind, const char *name, bool frees);

    std::mutex _changes;
    std::vector<Entry> _all; // in the order of their numbers
    size_t _n_freed = 0;     // at most half of them
    uintptr_t _last = 0;
};

} // namespace rastercov::c
