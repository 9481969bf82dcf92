// Lines and words of mesh files in text, the text of errors, and polygons as fans.
//
// Twin: tests/mesh/test_mesh_text.py.
#include "readers/text.hpp"
#include "solver/build.hpp"
#include <algorithm>
#include <bit>
#include <cmath>

namespace rastercov::readers {
namespace {
constexpr int64_t BYTES_PER_CHARACTER = 40;     // of a line, for its words
constexpr int64_t FREE_CHARACTERS = 1 << 16;    // of a line that any budget allows
constexpr size_t MOST_WORDS = 60, LONGEST = 60; // of a line in an error
constexpr int64_t PEAK_BYTES_PER_FACE = 300, PEAK_BYTES_PER_VERTEX = 150;
} // namespace

void put(String &to, Wide number) {
    if (number < 0) to += '-';
    char digits[40];
    char *const end = digits + sizeof digits, *at = end;
    do {
        const Wide rest = number / 10;
        *--at = char('0' + std::abs(int(number - 10 * rest)));
        number = rest;
    } while (number);
    to.append(at, end);
}

namespace {
template <class... Parts> [[noreturn]] void refuse_size(const Parts &...parts) {
#ifdef __cpp_exceptions
    throw TooLarge(text(parts...));
#else
    refuse(parts...);
#endif
}
} // namespace

void check_budget(int64_t n_faces, const Limits &limits, int64_t n_vertices) {
    const int64_t n_more = std::max<int64_t>(0, n_vertices - n_faces);
    const Wide need = Wide(n_faces) * PEAK_BYTES_PER_FACE + Wide(n_more) * PEAK_BYTES_PER_VERTEX;
    if (n_faces <= limits.faces && need <= limits.bytes) return;
    const auto vertices = n_more ? text(" with ", n_vertices, " vertices") : "";
    refuse_size("expected at most ", limits.bytes, " bytes and ", limits.faces, " triangles, got ",
                need, " bytes for ", n_faces, " triangles", vertices,
                "; simplify the mesh, split it, or raise memory_budget");
}

void check_count(Wide count, Text what, int64_t least_bytes, size_t available) {
    const Wide need = count * least_bytes;
    if (need < 0 || need > available + least_bytes) // the last newline may be missing
        refuse("expected ", count, " ", what, ", as declared, of at least ", need, " bytes, got ",
               available, " bytes; the file is truncated or its header is wrong");
}

void fan_polygons(MeshFile &mesh, const Wholes &corners, const Wholes &n_corners,
                  const Limits &limits) {
    const auto n_faces = int64_t(corners.size() - 2 * n_corners.size());
    check_budget(n_faces, limits, mesh.n_vertices());
    mesh.faces.reserve(size_t(3 * n_faces));
    mesh.polygon.reserve(size_t(n_faces));
    const int64_t *first = corners.data();
    for (size_t p = 0; p < n_corners.size(); first += n_corners[p++])
        for (int64_t k = 2; k < n_corners[p]; k++) {
            mesh.faces.insert(mesh.faces.end(), {first[0], first[k - 1], first[k]});
            mesh.polygon.push_back(int64_t(p));
        }
}

void merge_corners(MeshFile &mesh, const Limits &limits) {
    const auto n = mesh.n_vertices();
    std::vector<uint64_t> bits(mesh.vertices.size());
    std::transform(mesh.vertices.begin(), mesh.vertices.end(), bits.begin(),
                   [](double each) { return std::bit_cast<uint64_t>(each); });
    mesh.faces.resize(size_t(n));
    engine::find_first_equal({bits.data(), {n, 3}}, {mesh.faces.data(), {n}});
    bits = {};
    int64_t n_vertices = 0;
    for (int64_t k = 0; k < n; k++) { // the first of each comes before all others
        int64_t &own = mesh.faces[k];
        if (own < k) {
            own = mesh.faces[own];
            continue;
        }
        std::copy_n(mesh.vertices.begin() + 3 * k, 3, mesh.vertices.begin() + 3 * n_vertices);
        own = n_vertices++;
    }
    check_budget(n / 3, limits, n_vertices);
    mesh.vertices.resize(size_t(3 * n_vertices));
    mesh.vertices.shrink_to_fit();
    for (int64_t f = 0; f < n / 3; f++) mesh.polygon.push_back(f);
}

String quote(Text words) {
    const bool is_double = words.find('\'') != words.npos && words.find('"') == words.npos;
    const char quote = is_double ? '"' : '\'';
    String all(1, quote);
    for (const char each : words) {
        if (each == quote || each == '\\') all += '\\';
        all += each;
    }
    return all + quote;
}

String show(Text bytes) {
    String all;
    for (const char each : bytes)
        if (each >= ' ' && each <= '~') all += each;
        else all += "\xef\xbf\xbd";
    return all;
}

String join_words(Words words) {
    String all;
    for (const Text each : words) all.append(all.empty() ? "" : " ").append(each);
    return all;
}

String plural(int64_t count, Text noun) {
    String all = text(count);
    for (auto at = int64_t(all.size()) - 3; at > 0; at -= 3) all.insert(size_t(at), 1, ',');
    if (count == 1) return text(all, " ", noun);
    return text(all, " ", noun == "vertex" ? "vertice" : noun, "s");
}

Lines::Lines(Text data, const Limits &limits, int comment, bool joins, int64_t number)
    : _longest(size_t(std::max(limits.bytes / BYTES_PER_CHARACTER, FREE_CHARACTERS))),
      _comment(comment), _joins(joins), _number(number) {
    data = without_mark(data);
    _at = data.data();
    _end = _at + data.size();
    _ends_inside = data.empty() || (data.back() != '\n' && data.back() != '\r');
}

bool Lines::split() {
    const size_t n_before = _words.size();
    while (_at != _end && *_at != '\n' && *_at != '\r' && uint8_t(*_at) != _comment) {
        if (is_space(*_at)) {
            _at++;
            continue;
        }
        const char *const first = _at;
        while (_at != _end && !is_space(*_at) && uint8_t(*_at) != _comment) _at++;
        if (_words.size() <= _longest) _words.emplace_back(first, size_t(_at - first));
    }
    const char *const end = _at; // of the words; a comment may follow
    while (_at != _end && *_at != '\n' && *_at != '\r') _at++;
    _is_cut = _at == _end;
    if (!_is_cut) _at += *_at == '\r' && _at + 1 != _end && _at[1] == '\n' ? 2 : 1;
    if (!_joins || _words.size() == n_before || !_words.back().ends_with('\\')) return false;
    Text &last = _words.back();
    if (_is_cut && last.data() + last.size() != end) return false;
    last.remove_suffix(1);
    if (last.empty()) _words.pop_back();
    _ends_inside |= _at == _end;
    return !_is_cut;
}

bool Lines::next() {
    _words.clear();
    while (_at != _end && _words.empty()) {
        _poll();
        const char *const first = _at;
        do _number++;
        while (split());
        const auto length = size_t(_at - first);
        if (length > _longest)
            refuse_size("line ", _number, ": expected at most ",
                        Wide(_longest) * BYTES_PER_CHARACTER, " bytes, got ", length,
                        " characters of ", BYTES_PER_CHARACTER,
                        " bytes; split the line, or raise memory_budget");
    }
    return !_words.empty();
}

void Lines::require_next(Text wanted) {
    if (!next())
        readers::refuse("expected ", wanted, " after line ", _number,
                        ", got the end of the file; it is truncated");
}

void Lines::take(int64_t k, int64_t n, Text what) {
    if (!next()) require_next(text(what, " ", k, " of ", n));
}

void Lines::refuse(Text wanted, Words got) const {
    const String all = join_words(got.first(std::min(got.size(), MOST_WORDS)));
    readers::refuse("line ", _number, ": expected ", wanted, ", got ",
                    quote(show(Text(all).substr(0, LONGEST))), "; correct the line");
}

void Lines::add_reals(Words from, Text wanted, Reals &to, size_t kept) const {
    for (size_t k = 0; k < from.size(); k++) {
        double number = 0.0;
        if (!read_number(from[k], number)) refuse(wanted, from);
        if (k < kept) to.push_back(number);
    }
}

void Lines::add_wholes(Words from, Text wanted, Wholes &to) const {
    for (const Text word : from) {
        to.push_back(0);
        if (!read_whole(word, to.back())) refuse(wanted, from);
    }
}

int64_t Lines::whole(Text word, Text wanted) const {
    int64_t number = 0;
    if (!read_whole(word, number)) refuse(wanted, {&word, 1});
    return number;
}

void Lines::add_point(Words from, std::initializer_list<size_t> more, Reals &to) const {
    const size_t n = from.size();
    if (n != 3 && (n < 3 || std::find(more.begin(), more.end(), n - 3) == more.end()))
        refuse("three coordinates", from);
    add_reals(from, n == 3 ? "three coordinates" : "three coordinates and other numbers", to, 3);
}

void Lines::note_rest(bool is_cut, Strings &notes) {
    const int64_t last = _number;
    if (is_cut) notes.emplace_back(CUT_NOTE);
    else if (next()) notes.push_back(text("ignored the lines after line ", last));
}
} // namespace rastercov::readers
