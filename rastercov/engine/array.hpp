// Views of arrays, the only type by which kernels take them; no Python in this file.
//
// Array<const double, Any, 3> are rows of three numbers that a kernel reads, Array<int64_t, Any>
// numbers that it writes: C-contiguous, of exactly this type, aligned. bind.hpp makes them of numpy
// arrays and refuses all others. a(i, k) is an element, a[i] a row, which is a view again, or an
// element of a one-dimensional array. With RASTERCOV_CHECKED each index is checked, and
// IndexError raised in Python.
#pragma once
#include "error.hpp"
#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <type_traits>

namespace rastercov {

// A struct that Python passes as a (named) tuple of arrays, scalars and such structs specialises
// Record: static constexpr auto fields = Fields<&S::a, &S::b>(), in the order of the tuple, which
// is RECORD(S, a, b). The expansion again and again is that of all, up to 64.
template <auto... FIELDS> struct Fields {};
template <class S> struct Record;
#define RECORD(S, ...)                                                                             \
    template <> struct Record<S> {                                                                 \
        static constexpr auto fields = Fields<RECORD_64(RECORD_FIELD(S, __VA_ARGS__))>();          \
    }
#define RECORD_FIELD(S, first, ...) &S::first __VA_OPT__(, RECORD_NEXT RECORD_NONE(S, __VA_ARGS__))
#define RECORD_NEXT() RECORD_FIELD
#define RECORD_NONE ()
#define RECORD_64(...) RECORD_16(RECORD_16(RECORD_16(RECORD_16(__VA_ARGS__))))
#define RECORD_16(...) RECORD_4(RECORD_4(RECORD_4(RECORD_4(__VA_ARGS__))))
#define RECORD_4(...) RECORD_1(RECORD_1(RECORD_1(RECORD_1(__VA_ARGS__))))
#define RECORD_1(...) __VA_ARGS__

constexpr int64_t Any = -1; // an extent that only the call knows

#ifdef RASTERCOV_CHECKED
inline void check_index(int64_t i, int64_t n) {
    if (i < 0 || i >= n)
        throw std::out_of_range("index " + std::to_string(i) + " of " + std::to_string(n));
}
#else
inline void check_index(int64_t, int64_t) {}
#endif

template <class T, int64_t... Extents> struct Array {
    using Element = T;
    static constexpr int N = sizeof...(Extents);
    static constexpr std::array<int64_t, N> EXTENTS = {Extents...};

    T *data = nullptr;
    std::array<int64_t, N> shape = {};

    // Length along an axis, a constant where the type says it.
    constexpr int64_t extent(int k) const { return EXTENTS[k] == Any ? shape[k] : EXTENTS[k]; }
    constexpr int64_t rows() const { return extent(0); }
    constexpr int64_t size() const {
        int64_t n = 1;
        for (int k = 0; k < N; k++) n *= extent(k);
        return n;
    }

    template <class... Index> T &operator()(Index... index) const {
        static_assert(sizeof...(Index) == N, "one index an axis");
        int64_t at = 0;
        int64_t k = 0;
        ((check_index(index, extent(k)), at = at * extent(k) + int64_t(index), k++), ...);
        return data[at];
    }
    decltype(auto) operator[](int64_t i) const {
        check_index(i, rows());
        if constexpr (N == 1) return static_cast<T &>(data[i]);
        else return row<Extents...>(i);
    }
    T *begin() const { return data; }
    T *end() const { return data + size(); }

    // What is written may be read.
    operator Array<const T, Extents...>() const
        requires(!std::is_const_v<T>)
    {
        return {data, shape};
    }

  private:
    template <int64_t First, int64_t... Rest> Array<T, Rest...> row(int64_t i) const {
        Array<T, Rest...> one;
        int64_t length = 1;
        for (int k = 1; k < N; k++) {
            length *= extent(k);
            one.shape[k - 1] = shape[k];
        }
        one.data = data + i * length;
        return one;
    }
};

// Of one dimension; those of numbers that a kernel reads have the names of rastercov.base.
template <class T> using Column = Array<T, Any>;
using FloatArray = Column<const double>;
using IntArray = Column<const int64_t>;
using Int32Array = Column<const int32_t>;
using BoolArray = Column<const bool>;
// Rows of some numbers each, or of small matrices.
template <int64_t... Lengths> using FloatRows = Array<const double, Any, Lengths...>;

// Kernels check what types cannot say, once, before their loops: that lengths
// belong together, and that indices are inside.
inline void require(bool is_right, const char *wanted) {
    if (!is_right) fail(wanted);
}

template <class... Arrays> bool have_rows(int64_t n, const Arrays &...arrays) {
    return ((arrays.rows() == n) && ...);
}

// Where n lists of `items` things start, and the end of the last.
inline void require_starts(const IntArray &starts, int64_t n, int64_t items, const char *wanted) {
    require(n >= 0 && starts.rows() == n + 1 && starts[0] >= 0 && starts[n] <= items &&
                std::is_sorted(starts.begin(), starts.end()),
            wanted);
}

// All of them from 0 to n - 1.
template <class Indices>
void require_indices(const Indices &indices, int64_t n, const char *wanted) {
    using I = std::make_unsigned_t<std::remove_const_t<typename Indices::Element>>;
    I most = 0; // of what is negative more than any
    for (const auto i : indices) most = most < I(i) ? I(i) : most;
    require(indices.size() == 0 || (n > 0 && uint64_t(most) < uint64_t(n)), wanted);
}

} // namespace rastercov
