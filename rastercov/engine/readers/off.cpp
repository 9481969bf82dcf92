// OFF files in text, with or without colours, normals and texture.
//
// The Geometry Center. Geomview Manual, section OFF Files.
//
// Twin: tests/mesh/test_mesh_text.py.
#include "readers/text.hpp"
#include <algorithm>

namespace rastercov::readers {
namespace {
// Numbers after the coordinates of a vertex, by the prefix of OFF: normals, a colour of three or
// four numbers, texture coordinates. Some programs write colours into files with a plain OFF.
struct Kind {
    Text prefix;
    std::initializer_list<size_t> more;
};
constexpr Kind KINDS[] = {{"", {0, 3, 4}}, {"C", {3, 4}},   {"N", {3}},   {"CN", {6, 7}},
                          {"ST", {2}},     {"STC", {5, 6}}, {"STN", {5}}, {"STCN", {8, 9}}};
constexpr auto COUNTS = "the counts of vertices, faces, edges";
constexpr auto INDICES = "a corner count and vertex indices";

const Kind *kind_of(Text word) {
    if (!word.ends_with("OFF")) return nullptr;
    word.remove_suffix(3);
    const auto *const at = std::find_if(std::begin(KINDS), std::end(KINDS),
                                        [&](const Kind &each) { return each.prefix == word; });
    return at == std::end(KINDS) ? nullptr : at;
}

// Corners of "n i1 ... in", their number; numbers that follow are a colour.
int64_t add_polygon(const Lines &lines, Wholes &corners) {
    const Words words = lines.words();
    const int64_t n = lines.whole(words[0], INDICES);
    const int64_t more = int64_t(words.size()) - 1 - std::max<int64_t>(n, 0);
    if (n < 3 || more < 0 || more == 2 || more > 4)
        lines.refuse("a corner count of 3 or more and as many vertex indices, with or without a "
                     "colour",
                     words);
    Reals colour;
    lines.add_reals(words.subspan(size_t(1 + n)), "a colour after the vertex indices", colour);
    lines.add_wholes(words.subspan(1, size_t(n)), INDICES, corners);
    return n;
}
} // namespace

MeshFile read_off(Text data, const Limits &limits) {
    Lines lines(data, limits, '#');
    lines.require_next("'OFF'");
    Words words = lines.words();
    const bool has_keyword = !is_digits(words[0]); // some collections lack it
    const Kind *const kind = has_keyword ? kind_of(words[0]) : KINDS;
    if (!kind || std::find(words.begin(), words.end(), "BINARY") != words.end())
        lines.refuse("'OFF' (in text, three coordinates)", words);
    words = words.subspan(has_keyword);
    if (words.empty()) {
        lines.require_next(COUNTS);
        words = lines.words();
    }
    if (words.size() != 2 && words.size() != 3) lines.refuse(COUNTS, words);
    Wholes counts, corners, n_corners;
    lines.add_wholes(words, COUNTS, counts);
    const int64_t n_vertices = counts[0], n_faces = counts[1];
    check_count(n_vertices, "vertices", 6, data.size());
    check_count(n_faces, "faces", 8, data.size());
    check_budget(n_faces, limits, n_vertices);
    MeshFile mesh;
    for (int64_t k = 0; k < n_vertices; k++) {
        lines.take(k, n_vertices, "vertex");
        lines.add_point(lines.words(), kind->more, mesh.vertices);
    }
    bool is_cut = false;
    for (int64_t k = 0; k < n_faces; k++) {
        lines.take(k, n_faces, "face");
        n_corners.push_back(add_polygon(lines, corners));
        check_budget(int64_t(corners.size() - 2 * n_corners.size()), limits, n_vertices);
        is_cut = lines.is_cut() && int64_t(lines.words().size()) == n_corners.back() + 1;
    }
    lines.note_rest(is_cut, mesh.notes);
    fan_polygons(mesh, corners, n_corners, limits);
    return mesh;
}
} // namespace rastercov::readers
