// Lines, words and numbers of mesh files in text, and the text of errors and notes.
//
// Twin: tests/mesh/test_mesh_text.py.
#pragma once
#include "interrupt.hpp"
#include "readers/mesh_file.hpp"
#include <initializer_list>
#include <span>

namespace rastercov::readers {

using Text = std::string_view;
using Words = std::span<const Text>;
using Wide = __int128; // a count of a file times the bytes of one

inline void put(String &to, Text words) { to += words; }
void put(String &to, Wide number);
// Words and whole numbers, one after another.
template <class... Parts> String text(const Parts &...parts) {
    String all;
    (put(all, parts), ...);
    return all;
}

template <class... Parts> [[noreturn]] void refuse(const Parts &...parts) {
    fail(text(parts...).c_str());
}
// With the advice of most faults.
template <class... Parts> [[noreturn]] void refuse_again(const Parts &...parts) {
    refuse(parts..., "; export it again");
}
// Refuses, before memory is allocated, what needs more than the limits allow. Of the vertices known
// so far only those beyond one a face count.
void check_budget(int64_t n_faces, const Limits &limits, int64_t n_vertices = 0);
// Refuses a count of things that cannot be in the bytes there are.
void check_count(Wide count, Text what, int64_t least_bytes, size_t available);
// Sets the faces and polygons of a mesh to fans about the first of their corners, at least 3 each.
void fan_polygons(MeshFile &mesh, const Wholes &corners, const Wholes &n_corners,
                  const Limits &limits);
// Makes vertices that are equal bit for bit one: three of each face.
void merge_corners(MeshFile &mesh, const Limits &limits);

// Text in quotes, as Python writes it; and bytes that are not printable ASCII replaced by a mark.
String quote(Text words);
String show(Text bytes);
String join_words(Words words); // a space between two
// A count with its noun, such as "1,200 vertices".
String plural(int64_t count, Text noun);

bool is_digits(Text word); // one or more
// The nearest double, ties to even; nan and inf are numbers. False where the word is none.
bool read_number(Text word, double &number);
// A whole number of 64 bits.
bool read_whole(Text word, int64_t &number);

constexpr Text BYTE_ORDER_MARK = "\xef\xbb\xbf"; // UTF-8; Windows programs write it
constexpr auto CUT_NOTE =
    "the file ends within a line: its last number may be cut, and lines may be missing";

inline bool is_space(char each) { return each == ' ' || (each >= '\t' && each <= '\r'); }
inline Text without_mark(Text data) {
    return data.starts_with(BYTE_ORDER_MARK) ? data.substr(BYTE_ORDER_MARK.size()) : data;
}

// Lines of a text as words; blank ones are left out. A line ends with a line feed, a carriage
// return or both. Where lines join, a backslash at the end of one continues it.
class Lines {
  public:
    static constexpr int NO_COMMENT = -1;
    Lines(Text data, const Limits &limits, int comment = NO_COMMENT, bool joins = false,
          int64_t number = 0);

    bool next(); // false at the end
    void require_next(Text wanted);
    // Takes the next line, where k of n are behind it, one `what` a line.
    void take(int64_t k, int64_t n, Text what);

    const char *at() const { return _at; }     // behind the latest line
    Words words() const { return _words; }     // of the latest line
    int64_t number() const { return _number; } // of it; of its last part, if lines were joined
    bool is_cut() const { return _is_cut; }    // the file ends inside it
    bool ends_inside_line() const { return _ends_inside; } // or with a backslash

    [[noreturn]] void refuse(Text wanted, Words got) const;
    // Appends numbers; all are checked, and the first of them kept.
    void add_reals(Words from, Text wanted, Reals &to, size_t kept = SIZE_MAX) const;
    void add_wholes(Words from, Text wanted, Wholes &to) const;
    int64_t whole(Text word, Text wanted) const;
    // Appends three coordinates, which some counts of other numbers may follow.
    void add_point(Words from, std::initializer_list<size_t> more, Reals &to) const;
    // A note if lines are left over, or if the latest one is cut.
    void note_rest(bool is_cut, Strings &notes);

  private:
    bool split(); // true where the next line continues this one

    const char *_at, *_end;
    size_t _longest;
    int _comment;
    bool _joins, _ends_inside, _is_cut = false;
    int64_t _number;
    std::vector<Text> _words;
    Poll _poll;
};

MeshFile read_stl(Text data, const Limits &limits);
MeshFile read_obj(Text data, const Limits &limits);
MeshFile read_ply(Text data, const Limits &limits);
MeshFile read_off(Text data, const Limits &limits);

} // namespace rastercov::readers
