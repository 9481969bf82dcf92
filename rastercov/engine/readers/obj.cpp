// OBJ files: polygons in groups. A face belongs to the last group or object named before it.
//
// Wavefront Technologies. Advanced Visualizer Manual, appendix B1. 1993.
//
// Twin: tests/mesh/test_mesh_text.py.
#include "readers/text.hpp"
#include <algorithm>
#include <array>
#include <bit>

namespace rastercov::readers {
namespace {
// Keywords of the format without influence on the shape of polygons.
constexpr std::array<Text, 15> IGNORED = {
    "vt",  "vn",     "vp",     "s",      "mg",     "bevel",      "c_interp", "d_interp",
    "lod", "usemtl", "mtllib", "usemap", "maplib", "shadow_obj", "trace_obj"};
constexpr size_t WITH_WEIGHT = 5; // words of a vertex with a weight alone

// A corner: 1, 1/2, 1//3 or 1/2/3.
bool is_corner(Text word) {
    for (int k = 0; k < 3; k++) {
        const size_t n = std::min(word.find('/'), word.size());
        Text index = word.substr(0, n);
        if (k == 0 || !index.empty()) {
            if (index.starts_with('+') || index.starts_with('-')) index.remove_prefix(1);
            if (!is_digits(index)) return false;
        }
        if (n == word.size()) return true;
        word.remove_prefix(n + 1);
    }
    return false;
}

// A line of three corners or more, whose keyword may be that of a face with one bit changed.
bool may_be_face(Words words) {
    return words.size() > 3 && std::all_of(words.begin() + 1, words.end(), is_corner);
}

class Objects {
  public:
    Objects(Text data, const Limits &limits) : _lines(data, limits, '#', true), _limits(limits) {
        _mesh.names.assign(1, "");
    }

    MeshFile read() {
        while (_lines.next()) read_line(_lines.words());
        check_corners();
        note();
        fan_polygons(_mesh, _corners, _n_corners, _limits);
        for (const int64_t polygon : _mesh.polygon) _mesh.group.push_back(_group_of[polygon]);
        return std::move(_mesh);
    }

  private:
    int64_t n_vertices() const { return _mesh.n_vertices(); }

    void read_line(Words words) {
        const Text keyword = words[0];
        if (keyword == "v") read_vertex(words);
        else if (keyword == "f" || keyword == "fo") read_face(words); // fo: version 2.11
        else if (keyword == "g" || keyword == "o") read_group(words);
        else if (keyword == "l") add_without("polyline");
        else if (keyword == "p") add_without("point element");
        else if (std::find(IGNORED.begin(), IGNORED.end(), keyword) == IGNORED.end())
            _lines.refuse("a keyword of polygonal OBJ files", words);
    }

    void read_vertex(Words words) {
        const int64_t line = _lines.number();
        if (!_doubtful.empty() && _doubtful.back() == line - 1)
            _doubtful.pop_back(); // the first of several vertices, after the faces of an object
        else if (!_face_line.empty() && _face_line.back() == line - 1 && may_be_face(words))
            _doubtful.push_back(line);
        _lines.add_point(words.subspan(1), {1, 3, 4}, _mesh.vertices); // weight, colour, both
        double weight = 1.0;
        if (words.size() == WITH_WEIGHT) read_number(words[WITH_WEIGHT - 1], weight);
        if (weight != 1.0) _weighted.push_back(line);
        check_budget(int64_t(_n_corners.size()), _limits, n_vertices());
    }

    // Corners of "f 1/2/3 ...", from 0; negative ones count back from the latest vertex.
    void read_face(Words words) {
        Words indices = words.subspan(1);
        if (std::any_of(indices.begin(), indices.end(),
                        [](Text each) { return each.find('/') != each.npos; })) {
            if (!std::all_of(indices.begin(), indices.end(), is_corner))
                _lines.refuse("corners of whole numbers, as 1, 1/2, 1//3 or 1/2/3", words);
            _indices.assign(indices.begin(), indices.end());
            for (Text &each : _indices) each = each.substr(0, each.find('/'));
            indices = _indices;
        }
        const auto first = std::ptrdiff_t(_corners.size());
        _lines.add_wholes(indices, "whole numbers as vertex indices", _corners);
        if (indices.size() < 3) _lines.refuse("a face of 3 or more vertices", words);
        const int64_t n = n_vertices();
        const auto low = std::min_element(_corners.begin() + first, _corners.end());
        if (*low < -n || std::find(_corners.begin() + first, _corners.end(), 0) != _corners.end())
            _lines.refuse(text("vertex indices from 1, or from -1 to -", n), words);
        std::for_each(_corners.begin() + first, _corners.end(),
                      [n](int64_t &each) { each += each > 0 ? -1 : n; });
        _n_corners.push_back(int64_t(indices.size()));
        _group_of.push_back(_group);
        _face_line.push_back(_lines.number());
        check_budget(int64_t(_corners.size() - 2 * _n_corners.size()), _limits, n);
    }

    void read_group(Words words) {
        if (may_be_face(words)) _doubtful.push_back(_lines.number());
        const String name = join_words(words.subspan(1));
        Strings &names = _mesh.names;
        uint64_t hash = 14695981039346656037U; // FNV-1a
        for (const char each : name) hash = (hash ^ uint8_t(each)) * 1099511628211U;
        for (_group = 0; names[size_t(_group)] != name; hash = std::rotl(hash, 1)) {
            int64_t &next = _others[size_t(_group)][hash >> 63];
            const bool is_new = next == 0;
            if (is_new) next = int64_t(names.size());
            _group = next;
            if (!is_new) continue;
            names.push_back(name);
            _others.emplace_back();
        }
    }

    // Elements without a surface.
    void add_without(Text noun) {
        for (auto &[name, n] : _without)
            if (name == noun) {
                n++;
                return;
            }
        _without.emplace_back(noun, 1);
    }

    void check_corners() const {
        const int64_t n = n_vertices(), *first = _corners.data();
        for (size_t f = 0; f < _n_corners.size(); first += _n_corners[f++])
            for (int64_t k = 0; k < _n_corners[f]; k++)
                if (first[k] >= n)
                    refuse_again("line ", _face_line[f], ": expected vertex indices in 1 ... ", n,
                                 ", got ", Wide(first[k]) + 1);
    }

    void note() {
        Strings &notes = _mesh.notes;
        if (_lines.ends_inside_line()) notes.emplace_back(CUT_NOTE);
        if (const size_t n = _doubtful.size())
            notes.push_back(text("line ", _doubtful[0],
                                 n > 1 ? text(" (and ", n - 1, " others)") : "",
                                 " may be a face: its keyword is not f"));
        if (!_weighted.empty())
            notes.push_back(text(
                "ignored the weights of ", plural(int64_t(_weighted.size()), "vertex"),
                ", the first in line ", _weighted[0], ": coordinates are not divided by them"));
        for (const auto &[noun, n] : _without)
            notes.push_back(text("ignored ", plural(n, noun), ": no surface"));
    }

    Lines _lines;
    const Limits &_limits;
    MeshFile _mesh;
    // Groups below each in a tree by the bits of their hashes, 0 for none.
    std::vector<std::array<int64_t, 2>> _others = {{}};
    int64_t _group = 0;
    Wholes _corners, _n_corners, _group_of, _face_line;
    Wholes _weighted, _doubtful; // lines
    std::vector<Text> _indices;
    std::vector<std::pair<Text, int64_t>> _without;
};
} // namespace

MeshFile read_obj(Text data, const Limits &limits) { return Objects(data, limits).read(); }
} // namespace rastercov::readers
