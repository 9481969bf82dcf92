// Decimal numbers of files as the nearest doubles, the same on every system.
//
// W. D. Clinger. How to Read Floating Point Numbers Accurately. 1990.
//
// Twin: tests/mesh/test_mesh_numbers.py, by Python's float.
#include "readers/decimal.hpp"
#include "readers/text.hpp"
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace rastercov::readers {
namespace {
using Whole = unsigned __int128;
constexpr int64_t FAR = int64_t(1) << 40; // of exponents; more is as much
constexpr int SHORT = 19;                 // digits that 64 bits hold
constexpr int64_t MOST_FIVES = 27;        // whose product 63 bits hold
constexpr int64_t MOST_TENS = 22;         // whose product is a double

// The nearest double of any digits times a power of ten.
double long_number(Text digits, int64_t power) {
    String plain;
    for (const char each : digits)
        if (each != '.') plain += each;
    const size_t point = std::min(digits.find('.'), digits.size() - 1);
    power -= int64_t(digits.size() - 1 - point);
    return decimal(text(plain, "e", power).c_str());
}

// The nearest double of up to 19 digits times a power of ten.
double short_number(uint64_t digits, int64_t power) {
    const int64_t n = std::abs(power);
    Whole fives = 1;
    double tens = 1.0;
    for (int64_t k = 0; k < n; k++) {
        fives *= 5;
        tens *= 10.0;
    }
    if (digits >> 53 == 0 && n <= MOST_TENS)
        return power < 0 ? double(digits) / tens : double(digits) * tens;
    if (power >= 0) return std::ldexp(double(digits * fives), int(power));
    const int up = 64 + std::countl_zero(digits);
    const Whole whole = Whole(digits) << up, quotient = whole / fives;
    const bool has_rest = quotient * fives != whole; // below all digits that count
    return std::ldexp(double(quotient | Whole(has_rest)), int(power) - up);
}

bool read_name(Text word, double &number) {
    for (const Text name : {"nan", "inf", "infinity"}) {
        const bool is_it = std::equal(word.begin(), word.end(), name.begin(), name.end(),
                                      [](char a, char b) { return (a | 32) == b; });
        if (!is_it) continue;
        number = name[0] == 'n' ? std::numeric_limits<double>::quiet_NaN()
                                : std::numeric_limits<double>::infinity();
        return true;
    }
    return false;
}

bool is_digit(char each) { return each >= '0' && each <= '9'; }

bool read_size(Text word, double &number) {
    uint64_t digits = 0;
    int64_t power = 0;
    int64_t exponent = 0;
    int n_kept = 0;
    bool has_digits = false;
    bool has_point = false;
    bool has_rest = false;
    size_t k = 0;
    for (; k < word.size() && (is_digit(word[k]) || (word[k] == '.' && !has_point)); k++) {
        if (word[k] == '.') {
            has_point = true;
            continue;
        }
        has_digits = true;
        if (n_kept < SHORT) {
            digits = 10 * digits + uint64_t(word[k] - '0');
            n_kept += digits != 0;
            power -= has_point;
        } else {
            has_rest |= word[k] != '0';
            power += !has_point;
        }
    }
    if (!has_digits) return read_name(word, number);
    const bool is_whole = k == word.size();
    if (!is_whole && ((word[k] | 32) != 'e' || !read_whole(word.substr(k + 1), exponent)))
        return false;
    exponent = std::clamp(exponent, -FAR, FAR);
    power += exponent;
    if (!digits) number = 0.0;
    else if (!has_rest && std::abs(power) <= MOST_FIVES) number = short_number(digits, power);
    else number = long_number(word.substr(0, k), exponent);
    return true;
}
} // namespace

bool is_digits(Text word) {
    return !word.empty() && std::all_of(word.begin(), word.end(), is_digit);
}

bool read_number(Text word, double &number) {
    const bool is_negative = word.starts_with('-');
    if (is_negative || word.starts_with('+')) word.remove_prefix(1);
    if (!read_size(word, number)) return false;
    if (is_negative) number = -number;
    return true;
}

bool read_whole(Text word, int64_t &number) {
    const bool is_negative = word.starts_with('-');
    if (is_negative || word.starts_with('+')) word.remove_prefix(1);
    if (!is_digits(word)) return false;
    constexpr auto MOST = uint64_t(INT64_MAX);
    uint64_t size = 0;
    for (const char each : word) {
        const auto digit = uint64_t(each - '0');
        if (size > (MOST + is_negative - digit) / 10) return false;
        size = 10 * size + digit;
    }
    number = int64_t(is_negative ? 0 - size : size);
    return true;
}
} // namespace rastercov::readers
