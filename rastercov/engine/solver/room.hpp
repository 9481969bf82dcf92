// Memory of an array, which may grow and is never cleared.
//
// With RASTERCOV_TIGHT rooms that grow begin with one value at most, so that tests take every way
// to grow.
//
// Twins: tests/exact/test_exactness.py, whose poses use memory again; tests/exact/test_surface.py.
#pragma once
#include "array.hpp"
#include <algorithm>
#include <memory>

namespace rastercov::engine {

#ifdef RASTERCOV_TIGHT
constexpr int64_t first_room(int64_t n) { return std::min<int64_t>(n, 1); }
constexpr int64_t more_room(int64_t needed) { return needed; }
#else
constexpr int64_t first_room(int64_t n) { return n; }
constexpr int64_t more_room(int64_t needed) { return needed * 5 / 4; }
#endif

template <class T> class Room {
  public:
    Room() : Room(0) {}
    explicit Room(int64_t n) { take(n); }
    Room(int64_t n, T value) : Room(n) { fill(value); }

    // Room for n values; what was there is lost.
    void take(int64_t n) {
        _memory.reset(new T[size_t(n)]);
        _size = n;
    }
    // Room for n values, the first `kept` of which stay.
    void grow(int64_t n, int64_t kept) {
        Room more(n);
        std::copy_n(data(), kept, more.data());
        *this = std::move(more);
    }

    int64_t size() const { return _size; }
    T *data() const { return _memory.get(); }
    void fill(T value) { std::fill(data(), data() + _size, value); }

    T *begin() { return data(); }
    T *end() { return data() + _size; }
    T &operator[](int64_t i) {
        check_index(i, _size);
        return _memory[size_t(i)];
    }
    const T &operator[](int64_t i) const {
        check_index(i, _size);
        return _memory[size_t(i)];
    }

    // All values, as rows of K elements or of one; the first n of them, or rows.
    template <int64_t... K> Array<T, Any, K...> rows() const & {
        return {data(), {_size / (K * ... * 1), K...}};
    }
    template <int64_t... K> Array<T, Any, K...> rows() && = delete; // memory that is gone
    Column<T> all() const { return {data(), {_size}}; }
    Column<T> first(int64_t n) const { return {data(), {n}}; }
    template <int64_t N> Array<T, Any, N> rows(int64_t n) const { return {data(), {n, N}}; }
    template <int64_t N, int64_t M> Array<T, Any, N, M> rows(int64_t n) const {
        return {data(), {n, N, M}};
    }

  private:
    std::unique_ptr<T[]> _memory;
    int64_t _size = 0;
};

} // namespace rastercov::engine
