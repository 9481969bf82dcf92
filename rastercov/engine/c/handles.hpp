// Handles of C: numbers that are never used again, and the objects behind those that are alive.
//
// A call holds the object that it works on, so that another thread may free the handle meanwhile.
//
// Twin: tests/native/test_c_border.py.
#pragma once
#include "error.hpp"
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

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
        const std::scoped_lock lock(_changes);
        _alive.emplace(++_last, Entry{std::move(object), &KIND<T>});
        return reinterpret_cast<Handle *>(uintptr_t(_last)); // NOLINT: a number, never an address
    }

    // The object of a kind behind a handle.
    template <class T> std::shared_ptr<T> get(const void *handle, const char *kind) const {
        const std::scoped_lock lock(_changes);
        const auto found = _alive.find(reinterpret_cast<uintptr_t>(handle));
        if (found == _alive.end() || found->second.kind != &KIND<T>) refuse_handle(handle, kind);
        return std::static_pointer_cast<T>(found->second.object);
    }

    template <class T> void free(const void *handle, const char *kind) {
        const auto object = get<T>(handle, kind); // destroyed without the lock
        const std::scoped_lock lock(_changes);
        _alive.erase(reinterpret_cast<uintptr_t>(handle));
    }

    int64_t count() const {
        const std::scoped_lock lock(_changes);
        return int64_t(_alive.size());
    }

  private:
    struct Entry {
        std::shared_ptr<void> object;
        const char *kind;
    };

    [[noreturn]] static void refuse_handle(const void *handle, const char *kind) {
        const auto text = std::string("expected a live handle of type ") + kind + ", got " +
                          (handle ? "one that was freed or has another type" : "null") +
                          "; create one, and free it once";
        refuse(text.c_str());
    }

    mutable std::mutex _changes;
    std::map<uintptr_t, Entry> _alive;
    uintptr_t _last = 0;
};

} // namespace rastercov::c
