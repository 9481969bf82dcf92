// A mesh of the bytes of a file, by its format.
//
// Twin: tests/mesh/test_mesh_file.py.
#include "readers/text.hpp"
#include <algorithm>
#include <array>

namespace rastercov::readers {
namespace {
void put_utf_8(String &to, uint32_t code) {
    if (code < 0x80) {
        to += char(code);
        return;
    }
    const int n = code < 0x800 ? 1 : code < 0x10000 ? 2 : 3; // bytes that follow
    to += char((0xf00 >> (n + 1) & 0xff) | code >> 6 * n);
    for (int k = n - 1; k >= 0; k--) to += char(0x80 | (code >> 6 * k & 0x3f));
}

// A text in UTF-8 of one in UTF-16 with a byte order mark; empty for other data.
String utf_8(Text data) {
    String all;
    const bool is_big = data.starts_with("\xfe\xff");
    if ((!is_big && !data.starts_with("\xff\xfe")) || data.size() % 2) return all;
    const auto unit = [&](size_t k) {
        return uint32_t(uint8_t(data[k + !is_big])) << 8 | uint8_t(data[k + is_big]);
    };
    for (size_t k = 2; k < data.size(); k += 2) {
        uint32_t code = unit(k);
        if (code >> 11 == 0x1b) { // a surrogate
            k += 2;
            const uint32_t low = k < data.size() ? unit(k) : 0;
            if (code >> 10 != 0x36 || low >> 10 != 0x37) return {};
            code = 0x10000 + ((code & 0x3ff) << 10) + (low & 0x3ff);
        }
        put_utf_8(all, code);
    }
    const char first = all.empty() ? '\0' : all[0];
    const bool is_word = (first | 32) >= 'a' && (first | 32) <= 'z';
    const bool is_text = is_space(first) || is_word || first == '#' || first == '_' ||
                         (first >= '0' && first <= '9');
    return is_text ? all : String();
}

void check_faces(const MeshFile &mesh) {
    if (mesh.polygon.empty())
        refuse("expected triangles, got no faces; export the surface, not points");
    const auto n = mesh.n_vertices();
    for (size_t f = 0; f < mesh.polygon.size(); f++) {
        const auto [low, high] = std::minmax(
            {int64_t(0), mesh.faces[3 * f], mesh.faces[3 * f + 1], mesh.faces[3 * f + 2]});
        if (low < 0 || high >= n)
            refuse_again("face ", mesh.polygon[f], ": expected vertex indices in 0 ... ", n - 1,
                         ", got ", low, " ... ", high);
    }
}
} // namespace

MeshFile read(Format format, Text data, const Limits &limits) {
    constexpr std::array READERS = {read_stl, read_obj, read_ply, read_off};
    if (data.empty()) refuse_again("expected triangles, got an empty file");
    const String converted = utf_8(data);
    MeshFile mesh = READERS[format](converted.empty() ? data : converted, limits);
    check_faces(mesh);
    if (mesh.names.empty()) mesh.names.assign(1, ""); // one group
    mesh.group.resize(mesh.polygon.size(), 0);
    return mesh;
}
} // namespace rastercov::readers
