// Vectors of 16 lanes over the registers of the level: one of AVX-512, 2 to 4 of AVX2, 4 to 8 of
// SSE or NEON; and `Doubles`, one register of them, for loops that hold many vectors at a time.
//
// Written over the vector extension of GCC and Clang, so that operators are those of C++; only
// what the extension lacks (masks, gather) names an instruction set. A comparison
// gives a mask, `Vec<T>::M`: all bits of a lane, or a bit in a mask register of AVX-512. Its
// operators are & | ~; take `bits` only where scalar code needs them. Every operation rounds as the
// scalar one does: results are equal on all levels. tests/native/test_levels.py holds each level
// against numpy.
#pragma once
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#define INLINE __attribute__((always_inline)) inline
#define EACH(k) [&](auto k) __attribute__((always_inline))

namespace rastercov {

// Calls `of` with the constants 0 to n - 1.
template <int n, class Of> INLINE void unroll(Of of) {
    [&]<int... k>(std::integer_sequence<int, k...>) __attribute__((always_inline)) {
        (of(std::integral_constant<int, k>()), ...);
    }(std::make_integer_sequence<int, n>());
}

constexpr int LANES = 16;
#if defined(__AVX512F__) && defined(__AVX512DQ__)
constexpr int REGISTER = 64;
#elif defined(__AVX2__)
constexpr int REGISTER = 32;
#else
constexpr int REGISTER = 16;
#endif

template <class T, int BYTES> struct RegisterOf {
    typedef T type __attribute__((vector_size(BYTES)));
};
template <class T, int BYTES = REGISTER> using Register = typename RegisterOf<T, BYTES>::type;
template <int BYTES> struct IntOf;
template <> struct IntOf<4> {
    using type = int32_t;
};
template <> struct IntOf<8> {
    using type = int64_t;
};

// Lanes in which sums, differences and products of integers wrap around.
template <class T> struct WrappingOf {
    using type = T;
};
template <> struct WrappingOf<int32_t> {
    using type = uint32_t;
};
template <> struct WrappingOf<int64_t> {
    using type = uint64_t;
};

template <class T, int L> struct Vec;
#if defined(__AVX512F__) && defined(__AVX512DQ__)
// A mask of L lanes of that many bytes.
template <int BYTES, int L> struct LaneMask {
    using R = std::conditional_t<BYTES == 4, __mmask16, __mmask8>;
    static constexpr int WIDTH = REGISTER / BYTES, N = L / WIDTH;
    R r[N];

    LaneMask() = default;
    template <class Make> static INLINE LaneMask make(Make make_register) {
        LaneMask m;
        unroll<N>(EACH(k) { m.r[k] = R(make_register(k)); });
        return m;
    }
    friend INLINE LaneMask operator&(LaneMask a, LaneMask b) {
        return make(EACH(k) { return a.r[k] & b.r[k]; });
    }
    friend INLINE LaneMask operator|(LaneMask a, LaneMask b) {
        return make(EACH(k) { return a.r[k] | b.r[k]; });
    }
    INLINE LaneMask operator~() const {
        return make(EACH(k) { return ~r[k]; });
    }
};
template <class T, int L> struct MaskOf {
    using type = LaneMask<sizeof(T), L>;
};
// By the numbers of a comparison of floats and of integers.
template <class T, int OF_FLOATS, int OF_INTS> INLINE auto compare(Register<T> a, Register<T> b) {
    if constexpr (std::is_same_v<T, float>)
        return _mm512_cmp_ps_mask((__m512)a, (__m512)b, OF_FLOATS);
    else if constexpr (std::is_same_v<T, double>)
        return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, OF_FLOATS);
    else if constexpr (sizeof(T) == 4)
        return _mm512_cmp_epi32_mask((__m512i)a, (__m512i)b, OF_INTS);
    else return _mm512_cmp_epi64_mask((__m512i)a, (__m512i)b, OF_INTS);
}
template <class T> INLINE Register<T> blend(auto mask, Register<T> a, Register<T> b) {
    if constexpr (sizeof(T) == 4)
        return Register<T>(_mm512_mask_blend_epi32(mask, (__m512i)b, (__m512i)a));
    else return Register<T>(_mm512_mask_blend_epi64(mask, (__m512i)b, (__m512i)a));
}
#define COMPARE(op, floats, ints)                                                                  \
    friend INLINE M operator op(Vec a, Vec b) {                                                    \
        return M::make(EACH(k) { return (compare<T, floats, ints>(a.r[k], b.r[k])); });            \
    }
#else
template <class T, int L> struct MaskOf {
    using type = Vec<typename IntOf<sizeof(T)>::type, L>;
};
template <class T> INLINE Register<T> blend(auto mask, Register<T> a, Register<T> b) {
    return mask ? a : b;
}
#define COMPARE(op, floats, ints)                                                                  \
    friend INLINE M operator op(Vec a, Vec b) {                                                    \
        return M::make(EACH(k) { return typename M::R(a.r[k] op b.r[k]); });                       \
    }
#endif

template <class T, int L = LANES> struct Vec {
    using R = Register<T>;
    using U = Register<typename WrappingOf<T>::type>; // integers wrap around
    using M = typename MaskOf<T, L>::type;
    static constexpr int WIDTH = REGISTER / sizeof(T), N = L / WIDTH;
    R r[N];

    Vec() = default;
    INLINE Vec(T one) { // in every lane, -0.0 as it is
        unroll<N>(EACH(k) { r[k] = one - R{}; });
    }
    template <class Make> static INLINE Vec make(Make make_register) {
        Vec v;
        unroll<N>(EACH(k) { v.r[k] = make_register(k); });
        return v;
    }
    static INLINE Vec load(const T *from) {
        return make(EACH(k) {
            R x;
            std::memcpy(&x, from + k * WIDTH, sizeof x);
            return x;
        });
    }
    INLINE void store(T *to) const {
        unroll<N>(EACH(k) { std::memcpy(to + k * WIDTH, &r[k], sizeof(R)); });
    }
#define BINARY(op)                                                                                 \
    friend INLINE Vec operator op(Vec a, Vec b) {                                                  \
        return make(EACH(k) { return R(a.r[k] op b.r[k]); });                                      \
    }
#define WRAPPING(op)                                                                               \
    friend INLINE Vec operator op(Vec a, Vec b) {                                                  \
        return make(EACH(k) { return R(U(a.r[k]) op U(b.r[k])); });                                \
    }
    WRAPPING(+)
    WRAPPING(-)
    WRAPPING(*)
    BINARY(/)
    BINARY(&)
    BINARY(|)
    COMPARE(<, _CMP_LT_OS, _MM_CMPINT_LT)
    COMPARE(<=, _CMP_LE_OS, _MM_CMPINT_LE)
    COMPARE(>, _CMP_GT_OS, _MM_CMPINT_NLE)
    COMPARE(>=, _CMP_GE_OS, _MM_CMPINT_NLT)
    COMPARE(==, _CMP_EQ_OQ, _MM_CMPINT_EQ)
#undef BINARY
#undef WRAPPING
#undef COMPARE
    INLINE Vec operator-() const {
        return make(EACH(k) { return R(-U(r[k])); });
    }
    INLINE Vec operator~() const {
        return make(EACH(k) { return R(~r[k]); });
    }
    INLINE Vec operator>>(int n) const {
        return make(EACH(k) { return R(r[k] >> n); });
    }
    INLINE Vec operator<<(int n) const {
        return make(EACH(k) { return R(r[k] << n); });
    }
};
using Int = Vec<int32_t>;
using Long = Vec<int64_t>;
using Float = Vec<float>;
using Double = Vec<double>;
using Doubles = Vec<double, REGISTER / sizeof(double)>;

template <class T> INLINE Vec<T> select(typename Vec<T>::M mask, Vec<T> a, Vec<T> b) {
    return Vec<T>::make(EACH(k) { return blend<T>(mask.r[k], a.r[k], b.r[k]); });
}
template <class T, int L>
    requires(L != LANES)
INLINE Vec<T, L> select(typename Vec<T, L>::M mask, Vec<T, L> a, Vec<T, L> b) {
    return Vec<T, L>::make(EACH(k) { return blend<T>(mask.r[k], a.r[k], b.r[k]); });
}
// In each lane the sum of the products of its two signed halves of 16 bits.
INLINE Int dot_halves(Int a, Int b) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    return Int::make(
        EACH(k) { return Int::R(_mm512_madd_epi16((__m512i)a.r[k], (__m512i)b.r[k])); });
#elif defined(__AVX2__)
    return Int::make(
        EACH(k) { return Int::R(_mm256_madd_epi16((__m256i)a.r[k], (__m256i)b.r[k])); });
#elif defined(__SSE2__)
    return Int::make(EACH(k) { return Int::R(_mm_madd_epi16((__m128i)a.r[k], (__m128i)b.r[k])); });
#else
    return (a << 16 >> 16) * (b << 16 >> 16) + (a >> 16) * (b >> 16);
#endif
}
template <class T, int L> INLINE Vec<T, L> min(Vec<T, L> a, Vec<T, L> b) {
    return Vec<T, L>::make(EACH(k) { return a.r[k] < b.r[k] ? a.r[k] : b.r[k]; });
} // b where one is NaN
template <class T, int L> INLINE Vec<T, L> max(Vec<T, L> a, Vec<T, L> b) {
    return Vec<T, L>::make(EACH(k) { return a.r[k] > b.r[k] ? a.r[k] : b.r[k]; });
}

// Half k of a register, and two halves side by side: in registers, not by way of memory.
template <int k, class R> INLINE auto half_of(R whole) {
    constexpr int N = sizeof whole / sizeof whole[0] / 2;
    return [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
        return __builtin_shufflevector(whole, whole, (k * N + i)...);
    }(std::make_integer_sequence<int, N>());
}
template <class R> INLINE auto join_halves(R low, R high) {
    return [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
        return __builtin_shufflevector(low, high, i...);
    }(std::make_integer_sequence<int, 2 * sizeof low / sizeof low[0]>());
}

// Lanes converted to another type; floats to integers by truncation.
template <class U, class T> INLINE Vec<U> to(Vec<T> v) {
    using V = Vec<U>;
    if constexpr (std::is_same_v<T, U>) {
        return v;
    } else if constexpr (sizeof(T) == sizeof(U)) {
        return V::make(EACH(k) { return __builtin_convertvector(v.r[k], typename V::R); });
    } else if constexpr (sizeof(T) < sizeof(U)) {
        return V::make(
            EACH(k) { return __builtin_convertvector(half_of<k % 2>(v.r[k / 2]), typename V::R); });
    } else {
        return V::make(EACH(k) {
            using Half = Register<U, REGISTER / 2>;
            return join_halves(__builtin_convertvector(v.r[2 * k], Half),
                               __builtin_convertvector(v.r[2 * k + 1], Half));
        });
    }
}

alignas(64) constexpr int32_t LANE_BITS[LANES] = {1,   2,   4,    8,    16,   32,   64,    128,
                                                  256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
#if defined(__AVX512F__) && defined(__AVX512DQ__)
// Masks of lanes of other bytes, with the same bits.
template <class U, int L>
INLINE LaneMask<4, L> to(LaneMask<8, L> m)
    requires(sizeof(U) == 4)
{
    return LaneMask<4, L>::make(EACH(k) { return m.r[2 * k] | m.r[2 * k + 1] << 8; });
}
template <class U, int L>
INLINE LaneMask<8, L> to(LaneMask<4, L> m)
    requires(sizeof(U) == 8)
{
    return LaneMask<8, L>::make(EACH(k) { return m.r[k / 2] >> k % 2 * 8; });
}
template <int BYTES, int L>
INLINE LaneMask<BYTES, L> select(LaneMask<BYTES, L> mask, LaneMask<BYTES, L> a,
                                 LaneMask<BYTES, L> b) {
    return (mask & a) | (~mask & b);
}
// 1 in the lanes of a mask, else 0.
template <class T, int BYTES, int L> INLINE Vec<T, L> ones(LaneMask<BYTES, L> mask) {
    return Vec<T, L>::make(
        EACH(k) { return blend<T>(mask.r[k], Register<T>{} + T(1), Register<T>{}); });
}
// Bits of a mask, lane 0 lowest.
template <int BYTES, int L> INLINE int64_t bits(LaneMask<BYTES, L> mask) {
    int64_t found = 0;
    const auto of_register = EACH(k) {
        uint32_t its; // not by conversion: GCC 12 may spill 16 bits of it, and read 64 back
        if constexpr (BYTES == 4) asm("kmovw %1, %0" : "=r"(its) : "k"(mask.r[k]));
        else asm("kmovb %1, %0" : "=r"(its) : "k"(mask.r[k]));
        return its;
    };
    unroll<mask.N>(EACH(k) { found |= int64_t(of_register(k)) << k * mask.WIDTH; });
    return found;
}
INLINE Int::M as_mask(int64_t lanes) {
    return Int::M::make(EACH(k) { return lanes; });
}
// Bits of the signs of integers, lane 0 lowest.
template <class T, int L> INLINE int64_t signs(Vec<T, L> v) {
    return bits(Vec<T, L>::M::make(EACH(k) {
        if constexpr (sizeof(T) == 4) return _mm512_movepi32_mask((__m512i)v.r[k]);
        else return _mm512_movepi64_mask((__m512i)v.r[k]);
    }));
}
#else
// 1 in the lanes of a mask, else 0.
template <class T, int L> INLINE Vec<T, L> ones(Vec<T, L> mask) { return -mask; }
// Bits of a mask, lane 0 lowest.
template <class T, int L> INLINE int64_t bits(Vec<T, L> mask) {
    using V = Vec<T, L>;
    int64_t found = 0;
    const auto of_register = EACH(k) {
#if defined(__AVX2__)
        if constexpr (sizeof(T) == 4) return uint32_t(_mm256_movemask_ps((__m256)mask.r[k]));
        else return uint32_t(_mm256_movemask_pd((__m256d)mask.r[k]));
#elif defined(__SSE2__)
        if constexpr (sizeof(T) == 4) return uint32_t(_mm_movemask_ps((__m128)mask.r[k]));
        else return uint32_t(_mm_movemask_pd((__m128d)mask.r[k]));
#elif defined(__aarch64__)
        if constexpr (sizeof(T) == 4) {
            const uint32x4_t weights = {1, 2, 4, 8};
            return uint32_t(vaddvq_u32(vandq_u32((uint32x4_t)mask.r[k], weights)));
        } else {
            const uint64x2_t weights = {1, 2};
            return uint32_t(vaddvq_u64(vandq_u64((uint64x2_t)mask.r[k], weights)));
        }
#else
        uint32_t some = 0;
        for (int i = 0; i < V::WIDTH; i++) some |= uint32_t(mask.r[k][i] < 0) << i;
        return some;
#endif
    };
    unroll<V::N>(EACH(k) { found |= int64_t(of_register(k)) << (k * V::WIDTH); });
    return found;
}

// Bits of the signs of integers, lane 0 lowest.
template <class T, int L> INLINE int64_t signs(Vec<T, L> v) {
#if defined(__SSE2__)
    return bits(v);
#else
    return bits(v < Vec<T, L>(0));
#endif
}
INLINE Int as_mask(int64_t lanes) {
    const Int bit = Int::load(LANE_BITS);
    return (Int(int32_t(lanes)) & bit) == bit;
}
#endif

alignas(64) constexpr int32_t LANE_NUMBERS[LANES] = {0, 1, 2,  3,  4,  5,  6,  7,
                                                     8, 9, 10, 11, 12, 13, 14, 15};
INLINE Int lane_numbers() { return Int::load(LANE_NUMBERS); }

// Elements of an array at indices, one load a lane; gathering instructions of AVX2 are slower on
// many processors. `at` gives the index of a lane.
template <class T, class At> INLINE Vec<T> gather_at(const T *from, At at) {
    return Vec<T>::make(EACH(k) {
        constexpr int W = Vec<T>::WIDTH;
        return [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
            return typename Vec<T>::R{from[at(k * W + i)]...};
        }(std::make_integer_sequence<int, W>());
    });
}
template <class T> INLINE Vec<T> gather(const T *from, Int index) {
    alignas(64) int32_t at[LANES];
    index.store(at);
    return gather_at(from, [&](int i) __attribute__((always_inline)) { return at[i]; });
}
// Byte k of each of LANES words.
INLINE auto bytes_of(const int32_t *words, int k) {
    const auto *bytes = reinterpret_cast<const uint8_t *>(words) + k;
    return [bytes](int i) __attribute__((always_inline)) { return bytes[4 * i]; };
}
constexpr bool PERMUTES = REGISTER == 64; // two registers by one instruction

// Elements of an array of 64 at indices below that: where registers can be permuted, its 4 or 8
// are, two at a time, which takes a fraction of the loads.
INLINE Int lookup(const int32_t *table, Int index) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    const __m512i at = (__m512i)index.r[0];
    const auto two = [&](int k) __attribute__((always_inline)) {
        return _mm512_permutex2var_epi32(_mm512_loadu_si512(table + 32 * k), at,
                                         _mm512_loadu_si512(table + 32 * k + 16));
    };
    Int found;
    found.r[0] = Int::R(
        _mm512_mask_blend_epi32(_mm512_test_epi32_mask(at, _mm512_set1_epi32(32)), two(0), two(1)));
    return found;
#else
    return gather(table, index);
#endif
}
INLINE Int lookup(const int32_t *table, const int32_t *index) {
    if constexpr (PERMUTES) return lookup(table, Int::load(index));
    return gather_at(table, [=](int i) __attribute__((always_inline)) { return index[i]; });
}
INLINE Double lookup(const double *table, Int index) {
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    return Double::make(EACH(k) {
        const __m512i at =
            _mm512_cvtepi32_epi64(k ? _mm512_extracti64x4_epi64((__m512i)index.r[0], 1)
                                    : _mm512_castsi512_si256((__m512i)index.r[0]));
        const auto two = [&](int i) __attribute__((always_inline)) {
            return _mm512_permutex2var_pd(_mm512_loadu_pd(table + 16 * i), at,
                                          _mm512_loadu_pd(table + 16 * i + 8));
        };
        const __mmask8 is_odd = _mm512_test_epi64_mask(at, _mm512_set1_epi64(16));
        return Double::R(_mm512_mask_blend_pd(_mm512_test_epi64_mask(at, _mm512_set1_epi64(32)),
                                              _mm512_mask_blend_pd(is_odd, two(0), two(1)),
                                              _mm512_mask_blend_pd(is_odd, two(2), two(3))));
    });
#else
    return gather(table, index);
#endif
}

// Elements of an array at byte k of each of LANES words; IS_SHORT where these are below 64.
template <bool IS_SHORT, int k> INLINE Double find(const double *table, const int32_t *words) {
    if constexpr (IS_SHORT && PERMUTES) return lookup(table, Int::load(words) >> 8 * k & Int(0xFF));
    else return gather_at(table, bytes_of(words, k));
}

#if defined(__AVX512F__)
// The lanes whose bits are set, in order, and then 0.
INLINE Int compress(int64_t bits, Int v) {
    return Int::make(
        EACH(k) { return (Int::R)_mm512_maskz_compress_epi32(__mmask16(bits), (__m512i)v.r[k]); });
}
#endif
// Eight bytes as words. GCC 12 would take a conversion in one step apart, byte by byte.
INLINE auto words_of(const uint8_t *bytes) {
    typedef int32_t Words __attribute__((vector_size(32)));
#if defined(__AVX2__)
    return Words(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)bytes)));
#else
    typedef uint8_t Bytes __attribute__((vector_size(8)));
    typedef uint16_t Halves __attribute__((vector_size(16)));
    Bytes narrow;
    std::memcpy(&narrow, bytes, sizeof narrow);
    return __builtin_convertvector(__builtin_convertvector(narrow, Halves), Words);
#endif
}

// As many bytes as integers, and back: shifted apart, and together. GCC 12 would take a conversion
// apart, byte by byte.
constexpr auto BYTE_SHIFTS = []<int... i>(std::integer_sequence<int, i...>) {
    return Register<uint64_t>{8 * i...};
}(std::make_integer_sequence<int, REGISTER / 8>());
template <class Bytes> INLINE Register<int64_t> longs_of(Bytes bytes) {
    uint64_t all = 0;
    std::memcpy(&all, &bytes, sizeof bytes);
    return Register<int64_t>((Register<uint64_t>{} + all) >> BYTE_SHIFTS & 0xFF);
}
INLINE void write_bytes(Register<int64_t> values, void *to) {
    constexpr int W = REGISTER / 8;
#if defined(__AVX512F__) && defined(__AVX512DQ__)
    const __m128i found = _mm512_cvtepi64_epi8((__m512i)values);
    std::memcpy(to, &found, W);
#else
    const auto apart = Register<uint64_t>(values) << BYTE_SHIFTS;
    uint64_t all = 0;
    unroll<W>(EACH(k) { all |= apart[int(k)]; });
    std::memcpy(to, &all, W);
#endif
}

// Pairs of words that are looked up a vector at a time: in two columns where registers can be
// permuted, else side by side, so that one load reads both.
template <int N> struct Pairs {
    alignas(64) int32_t columns[2][PERMUTES ? N : 1];
    alignas(64) int64_t pairs[PERMUTES ? 1 : N];

    INLINE void put(int at, int32_t first, int32_t second) {
        if constexpr (PERMUTES) {
            columns[0][at] = first;
            columns[1][at] = second;
        } else pairs[at] = int64_t(uint32_t(first)) | int64_t(second) << 32;
    }
    INLINE void store(int at, Int first, Int second) {
        if constexpr (PERMUTES) {
            first.store(columns[0] + at);
            second.store(columns[1] + at);
        } else {
            unroll<2 * Int::N>([&](auto k) __attribute__((always_inline)) {
                constexpr int W = Int::WIDTH, half = k % 2 * (W / 2);
                const Int::R both =
                    [&]<int... i>(std::integer_sequence<int, i...>) __attribute__((always_inline)) {
                        return __builtin_shufflevector(first.r[k / 2], second.r[k / 2],
                                                       (i % 2 * W + i / 2 + half)...);
                    }(std::make_integer_sequence<int, W>());
                std::memcpy(pairs + at + k * (W / 2), &both, sizeof both);
            });
        }
    }
    // At byte k of each of LANES words; IS_SHORT where these are below 64.
    template <bool IS_SHORT, int k>
    INLINE void find(const int32_t *words, Int &first, Int &second) const {
        if constexpr (PERMUTES) {
            const Int index = Int::load(words) >> 8 * k & Int(0xFF);
            first = IS_SHORT ? lookup(columns[0], index) : gather(columns[0], index);
            second = IS_SHORT ? lookup(columns[1], index) : gather(columns[1], index);
        } else {
            const auto at = bytes_of(words, k);
            unroll<Int::N>([&](auto r) __attribute__((always_inline)) {
                // Pairs 0, 1, 4, 5 of 8 in one register, and 2, 3, 6, 7: columns need no crossing.
                constexpr int W = Int::WIDTH;
                const auto some = [&]<int... i>(std::integer_sequence<int, i...>,
                                                int from) __attribute__((always_inline)) {
                    return Int::R(
                        Register<int64_t>{pairs[at(r * W + i / 2 * 4 + i % 2 + from)]...});
                };
                const auto column = [](Int::R a, Int::R b,
                                       auto which) __attribute__((always_inline)) {
                    return [&]<int... i>(std::integer_sequence<int, i...>)
                               __attribute__((always_inline)) {
                                   return __builtin_shufflevector(
                                       a, b, (i % 4 / 2 * W + i / 4 * 4 + i % 2 * 2 + which)...);
                               }(std::make_integer_sequence<int, W>());
                };
                const auto halves = std::make_integer_sequence<int, W / 2>();
                const Int::R a = some(halves, 0), b = some(halves, 2);
                first.r[r] = column(a, b, std::integral_constant<int, 0>());
                second.r[r] = column(a, b, std::integral_constant<int, 1>());
            });
        }
    }
};

// A function of each lane. Compilers make one instruction a register of those that it has.
template <class T, int L, class Of> INLINE Vec<T, L> each_lane(Vec<T, L> v, Of of) {
    return Vec<T, L>::make(EACH(k) {
        Register<T> found;
        for (int i = 0; i < Vec<T, L>::WIDTH; i++) found[i] = of(v.r[k][i]);
        return found;
    });
}
template <class T, int L> INLINE Vec<T, L> floor(Vec<T, L> v) {
    return each_lane(v, [](T lane) __attribute__((always_inline)) { return std::floor(lane); });
}
template <int L> INLINE Vec<double, L> sqrt(Vec<double, L> v) {
    return each_lane(v, [](double lane) __attribute__((always_inline)) { return std::sqrt(lane); });
}
template <class T, int L> INLINE Vec<T, L> abs(Vec<T, L> v) {
    using I = Vec<typename IntOf<sizeof(T)>::type, L>;
    return Vec<T, L>::make(EACH(k) {
        const auto all =
            typename I::R(v.r[k]) &
            (typename I::R{} + std::numeric_limits<typename IntOf<sizeof(T)>::type>::max());
        return typename Vec<T, L>::R(all);
    });
}
// 2 a + (b < 0).
INLINE Int append_sign(Int a, Int b) { return a + a - (b >> 31); }

template <class T, int L, class Pick> INLINE T reduce(Vec<T, L> v, Pick pick) {
    alignas(64) T lane[L];
    v.store(lane);
    for (int n = L / 2; n; n /= 2)
        for (int i = 0; i < n; i++) lane[i] = pick(lane[i], lane[i + n]);
    return lane[0];
}
template <class T, int L> INLINE T greatest(Vec<T, L> v) {
    return reduce(v, [](T a, T b) { return a > b ? a : b; });
}
template <class T, int L> INLINE T least(Vec<T, L> v) {
    return reduce(v, [](T a, T b) { return a < b ? a : b; });
}
// Of integers modulo their range, as hashes are added.
template <class T, int L> INLINE T sum(Vec<T, L> v) {
    return reduce(v, [](T a, T b) {
        if constexpr (std::is_integral_v<T>)
            return T(std::make_unsigned_t<T>(a) + std::make_unsigned_t<T>(b));
        else return T(a + b);
    });
}

// Transposes a square of registers, a row each: bit by bit, the bit of a row's number and that of a
// lane's change places.
template <class T, int... k>
INLINE void change_bit(Register<T> *rows, auto bit, std::integer_sequence<int, k...>) {
    constexpr int W = sizeof...(k);
    unroll<W>(EACH(i) {
        if constexpr (!(i & bit)) {
            const Register<T> a = rows[i], b = rows[i | bit];
            rows[i] = __builtin_shufflevector(a, b, (k & bit ? W + (k ^ bit) : k)...);
            rows[i | bit] = __builtin_shufflevector(a, b, (k & bit ? W + k : k | bit)...);
        }
    });
}
template <class T> INLINE void transpose(Register<T> *rows) {
    constexpr int W = REGISTER / sizeof(T);
    unroll<std::bit_width(unsigned(W)) - 1>(EACH(k) {
        change_bit<T>(rows, std::integral_constant<int, 1 << k>(),
                      std::make_integer_sequence<int, W>());
    });
}

INLINE int count(int64_t bits) { return std::popcount(uint64_t(bits)); }
INLINE int lowest(int64_t bits) { return std::countr_zero(uint64_t(bits)); }
// Bits but for the lowest; bit 63 alone is the least number, from which 1 would overflow.
template <class T> INLINE T without_lowest(T bits) {
    using U = std::make_unsigned_t<T>;
    return T(U(bits) & (U(bits) - 1));
}

} // namespace rastercov
