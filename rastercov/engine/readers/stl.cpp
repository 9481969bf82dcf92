// STL files, binary or ASCII. Of an ASCII file with several `solid` sections, each is a group.
//
// 3D Systems. StereoLithography Interface Specification. 1989.
//
// Twins: tests/mesh/test_mesh_text.py, tests/mesh/test_mesh_binary.py.
#include "readers/text.hpp"
#include <algorithm>
#include <array>
#include <cstring>

namespace rastercov::readers {
namespace {
constexpr size_t HEADER = 84, RECORD = 50, NORMAL = 12;

// First words of the lines after `facet`, and their numbers of words; 0 where a name may follow.
struct Wanted {
    Text word;
    size_t n_words;
};
constexpr std::array<Wanted, 6> FACET = {
    {{"outer", 2}, {"vertex", 4}, {"vertex", 4}, {"vertex", 4}, {"endloop", 1}, {"endfacet", 0}}};

bool is_word(Text word, Text wanted) {
    return std::equal(word.begin(), word.end(), wanted.begin(), wanted.end(), [](char a, char b) {
        return (a >= 'A' && a <= 'Z' ? a + ('a' - 'A') : a) == b;
    });
}

class Solids {
  public:
    Solids(Text data, const Limits &limits) : _lines(data, limits), _limits(limits) {}

    MeshFile read() {
        while (_lines.next()) read_line();
        if (_is_open) _lines.require_next("'endsolid'");
        // Many programs write no line end after `endsolid`, and do not repeat the solid's name.
        if (_lines.ends_inside_line() && _has_other_name) _mesh.notes.emplace_back(CUT_NOTE);
        // The name of a lone solid is often that of the program.
        if (_mesh.names.size() < 2) {
            _mesh.names.assign(1, "");
            std::fill(_mesh.group.begin(), _mesh.group.end(), 0);
        }
        merge_corners(_mesh, _limits);
        return std::move(_mesh);
    }

  private:
    void read_line() {
        const Words words = _lines.words();
        if (_is_open && is_word(words[0], "facet")) {
            read_facet();
        } else if (_is_open && (is_word(words[0], "endsolid") || is_word(words[0], "end"))) {
            const String name = join_words(words.subspan(1));
            _is_open = false;
            const bool is_part_of_word = words.size() == 1 && words[0].size() < 8;
            _has_other_name = is_part_of_word || (!name.empty() && name != _mesh.names.back());
        } else if (!_is_open && is_word(words[0], "solid")) {
            _is_open = true;
            _mesh.names.push_back(join_words(words.subspan(1)));
        } else {
            _lines.refuse(_is_open ? "'facet' or 'endsolid'" : "'solid'", words);
        }
    }

    void read_facet() {
        check_budget(int64_t(_mesh.group.size() + 1), _limits);
        for (const Wanted &wanted : FACET) {
            _lines.require_next("'endsolid'");
            const Words row = _lines.words();
            if (!is_word(row[0], wanted.word) || (wanted.n_words && row.size() != wanted.n_words))
                _lines.refuse(text("'", wanted.word, "' in a facet of 3 vertices"), row);
            if (wanted.word == "vertex")
                _lines.add_reals(row.subspan(1), "three coordinates", _mesh.vertices);
        }
        _mesh.group.push_back(int64_t(_mesh.names.size()) - 1);
    }

    Lines _lines;
    const Limits &_limits;
    MeshFile _mesh;
    bool _is_open = false;
    bool _has_other_name = false;
};

MeshFile read_binary(Text data, uint32_t declared, const Limits &limits) {
    const Wide n = data.size(), size = HEADER + RECORD * Wide(declared);
    const Wide extra = n - size;
    if (extra < 0)
        refuse_again("expected ", declared, " triangles, as declared (", size, " bytes), got ", n,
                     " bytes, to triangle ", (n - HEADER) / RECORD, "; truncated");
    if (!declared && extra >= RECORD)
        refuse_again("expected ", extra / RECORD,
                     " triangles from the file size, got 0 in its header");
    check_budget(declared, limits);
    MeshFile mesh;
    if (extra) mesh.notes.push_back(text("ignored ", extra, " bytes after the last triangle"));
    mesh.names.assign(1, "");
    mesh.group.assign(declared, 0);
    mesh.vertices.reserve(size_t(9) * declared);
    Poll poll(1 << 16);
    for (size_t f = 0; f < declared; f++) {
        std::array<float, 9> corners;
        std::memcpy(corners.data(), data.data() + HEADER + RECORD * f + NORMAL, sizeof corners);
        mesh.vertices.insert(mesh.vertices.end(), corners.begin(), corners.end());
        poll();
    }
    merge_corners(mesh, limits);
    return mesh;
}
} // namespace

// Many binary files begin with "solid" as well, so the size of the file is tested first.
MeshFile read_stl(Text data, const Limits &limits) {
    uint32_t declared = 0;
    if (data.size() >= HEADER) std::memcpy(&declared, data.data() + HEADER - 4, 4);
    const bool fits = data.size() == HEADER + RECORD * size_t(declared);
    Text start = without_mark(data.substr(0, 1024));
    while (!start.empty() && is_space(start[0])) start.remove_prefix(1);
    const bool is_text = is_word(start.substr(0, 5), "solid") && start.find('\0') == start.npos;
    if (is_text && !(data.size() >= HEADER && fits)) {
        while (data.back() == '\0' || data.back() == '\x1a') data.remove_suffix(1); // padding
        return Solids(data, limits).read();
    }
    if (data.size() < HEADER)
        refuse_again(
            text("expected 84 bytes before the triangles of a binary STL, got ", data.size()));
    return read_binary(data, declared, limits);
}
} // namespace rastercov::readers
