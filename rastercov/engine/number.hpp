// Numbers of a template: one double, or `Doubles`, a register of them, by the same operations.
//
// A function over N computes the same bits for one face as for each lane. Masks of one number are
// bool, its whole numbers int64_t; write ! & | on masks, never ~.
#pragma once
#include "array.hpp"
#include "simd.hpp"

namespace rastercov {

template <class N> struct NumberOf; // Mask, Whole: integers, AT_A_TIME: how many numbers it holds
template <> struct NumberOf<double> {
    using Mask = bool;
    using Whole = int64_t;
    static constexpr int AT_A_TIME = 1;
};
template <int L> struct NumberOf<Vec<double, L>> {
    using Mask = typename Vec<double, L>::M;
    using Whole = Vec<int64_t, L>;
    static constexpr int AT_A_TIME = L;
};
template <class N> using Mask = typename NumberOf<N>::Mask;
template <class N> using Whole = typename NumberOf<N>::Whole;
template <class N> constexpr int AT_A_TIME = NumberOf<N>::AT_A_TIME;

template <class M>
concept MaskOfLanes = requires(M mask) { bits(mask); };
template <MaskOfLanes M> INLINE M operator!(M mask) { return ~mask; }

INLINE double select(bool mask, double a, double b) { return mask ? a : b; }
INLINE int64_t select(bool mask, int64_t a, int64_t b) { return mask ? a : b; }
INLINE bool select(bool mask, bool a, bool b) { return mask ? a : b; }
// b where one is NaN, unlike std::min and std::max.
INLINE double min(double a, double b) { return a < b ? a : b; }
INLINE double max(double a, double b) { return a > b ? a : b; }
INLINE double sqrt(double value) { return std::sqrt(value); }
INLINE double abs(double value) { return std::abs(value); }
// 1 with the sign of a value, also of -0.0.
INLINE double sign(double value) { return std::copysign(1.0, value); }
template <int L> INLINE Vec<double, L> sign(Vec<double, L> v) {
    using V = Vec<double, L>;
    using I = Register<int64_t>;
    return V::make(EACH(k) {
        const I one = I(Register<double>{} + 1.0);
        return Register<double>((I(v.r[k]) & (I{} + std::numeric_limits<int64_t>::min())) | one);
    });
}

INLINE bool any(bool mask) { return mask; }
INLINE bool all(bool mask) { return mask; }
INLINE int count_of(bool mask) { return mask; }
INLINE double greatest(double value) { return value; }
template <MaskOfLanes M> INLINE bool any(M mask) { return bits(mask) != 0; }
template <MaskOfLanes M> INLINE bool all(M mask) {
    return bits(mask) == (int64_t(1) << mask.N * mask.WIDTH) - 1;
}
template <MaskOfLanes M> INLINE int count_of(M mask) { return count(bits(mask)); }

// A bit for each lane, from the lowest on.
template <class M> INLINE int64_t lanes_of(M mask) {
    if constexpr (std::is_integral_v<M>) return mask;
    else return bits(mask);
}

// Elements of an array of another type, converted to those of N: as many as it holds.
template <class N, class T> INLINE N read(const T *from) {
    if constexpr (std::is_arithmetic_v<N>) {
        return N(*from);
    } else {
        typedef T Part __attribute__((vector_size(N::WIDTH * sizeof(T))));
        return N::make(EACH(k) {
            Part part;
            std::memcpy(&part, from + k * N::WIDTH, sizeof part);
            if constexpr (sizeof(T) == 1 && N::WIDTH > 2)
                return __builtin_convertvector(longs_of(part), typename N::R);
            else return __builtin_convertvector(part, typename N::R);
        });
    }
}
template <class N> INLINE Mask<N> read_mask(const bool *from) {
    if constexpr (std::is_same_v<N, double>) return *from;
    else return read<Whole<N>>(reinterpret_cast<const uint8_t *>(from)) > Whole<N>(0);
}

// The number in lane k.
INLINE double lane_of(double value, int) { return value; }
INLINE int64_t lane_of(int64_t value, int) { return value; }
INLINE bool lane_of(bool value, int) { return value; }
template <class T, int L> INLINE T lane_of(Vec<T, L> v, int k) {
    return v.r[k / v.WIDTH][k % v.WIDTH];
}

template <MaskOfLanes M> INLINE bool lane_of(M mask, int k) { return bits(mask) >> k & 1; }

// Values put into an array of another type.
template <class N, class T> INLINE void write(T *to, N value) {
    if constexpr (std::is_arithmetic_v<N>) {
        *to = T(value);
    } else {
        typedef T Part __attribute__((vector_size(N::WIDTH * sizeof(T))));
        unroll<N::N>(EACH(k) {
            if constexpr (sizeof(T) == 1 && N::WIDTH > 2) {
                write_bytes(value.r[k], to + k * N::WIDTH);
            } else {
                const Part part = __builtin_convertvector(value.r[k], Part);
                std::memcpy(to + k * N::WIDTH, &part, sizeof part);
            }
        });
    }
}
template <class M> INLINE void write(bool *to, M mask) {
    if constexpr (std::is_same_v<M, bool>) *to = mask;
    else write(reinterpret_cast<uint8_t *>(to), ones<int64_t>(mask));
}

// Three coordinates of as many vectors as N holds, which follow one another in memory.
template <class N> struct Triple {
    N x, y, z;
};
template <class N> INLINE Triple<N> read_triple(const double *from) {
    if constexpr (std::is_same_v<N, double>) return {from[0], from[1], from[2]};
    else {
        constexpr int W = N::WIDTH;
        const auto column =
            [&]<int... i>(auto k, std::integer_sequence<int, i...>) __attribute__((always_inline)) {
                return N::make(EACH(row) {
                    Register<double> rows[3];
                    std::memcpy(rows, from + 3 * W * row, sizeof rows);
                    const auto first = __builtin_shufflevector(
                        rows[0], rows[1], (3 * i + k < 2 * W ? 3 * i + k : i)...);
                    return __builtin_shufflevector(first, rows[2],
                                                   (3 * i + k < 2 * W ? i : 3 * i + k - W)...);
                });
            };
        constexpr auto LANES_OF_ROW = std::make_integer_sequence<int, W>();
        return {column(std::integral_constant<int, 0>(), LANES_OF_ROW),
                column(std::integral_constant<int, 1>(), LANES_OF_ROW),
                column(std::integral_constant<int, 2>(), LANES_OF_ROW)};
    }
}

} // namespace rastercov
