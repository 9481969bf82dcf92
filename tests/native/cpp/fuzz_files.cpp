// Files of meshes that are cut at every byte and changed at random: fuzz_files N SEED. Each is a
// mesh whose faces have vertices, or one line; a crash, or anything else, is a fault.
#include "rastercov.h"
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <vector>

namespace {
struct File {
    int32_t format;
    std::string bytes;
};

std::string numbers_of(std::initializer_list<float> all) {
    std::string bytes(4 * all.size(), '\0');
    std::memcpy(bytes.data(), all.begin(), bytes.size());
    return bytes;
}

std::vector<File> seeds() {
    using namespace std::string_literals;
    const std::string corners = numbers_of({0, 0, 0, 1, 0, 0, 0, 1, 0});
    const std::string facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
                              "vertex 0 1e0 0\nendloop\nendfacet\n";
    const std::string head = "element vertex 4\nproperty float x\nproperty float y\n"
                             "property float z\nelement face 2\nproperty list uchar int "
                             "vertex_indices\nelement tristrips 1\nproperty list int int "
                             "vertex_indices\nend_header\n";
    const std::string lists = "\3\0\0\0\0\1\0\0\0\2\0\0\0"s +
                              "\4\0\0\0\0\1\0\0\0\3\0\0\0\2\0\0\0"s +
                              "\5\0\0\0\0\0\0\0\1\0\0\0\2\0\0\0\xff\xff\xff\xff\1\0\0\0"s;
    return {
        {RC_STL, "solid a\n" + facet + "endsolid a\nsolid b\n" + facet + "end"},
        {RC_STL, std::string(80, ' ') + "\2\0\0\0"s + std::string(12, '\0') + corners + "\0\0"s +
                     std::string(12, '\0') + corners + "\0\0 "s},
        {RC_OBJ, "# a\nv 0 0 0 2\nv 1 0 0 .1 .2 .3\nv 1 1 0\nv 0 1e-1 0\ng a \\\nb\nf 1/2/3 2 -2 "
                 "\\\n 4\no c\nfo 1//2 2 3/\nl 1 2\np 1\nvt 1 1\n"},
        {RC_OBJ, "\xff\xfev\0 \0"
                 "0\0 \0"
                 "1\0 \0"
                 "2\0\n\0f\0 \0"
                 "1\0 \0"
                 "1\0 \0"
                 "1\0"s},
        {RC_PLY, "ply\nformat ascii 1.0\ncomment a\n" + head +
                     "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3\n7 0 1 2 -1 1 2 3\n"},
        {RC_PLY,
         "ply\nformat binary_little_endian 1.0\n" + head + corners + corners.substr(0, 12) + lists},
        {RC_PLY, "ply\nformat binary_big_endian 1.0\n" + head + std::string(48, '\0') + lists},
        {RC_OFF, "STCNOFF # a\n3 1 0\n0 0 0 0 0 1 9 9 9 .5 .5\n1 0 0 0 0 1 9 9 9 .5 .5\n"
                 "0 1 0 0 0 1 9 9 9 .5 .5\n3 0 1 2 9 9 9"},
        {RC_OFF, "4 2\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2 255 0 0"},
    };
}

// The mesh, or "" for what is right.
std::string fault_of(const File &file, int64_t counts[2]) {
    rc_mesh *mesh = nullptr;
    const std::vector<uint8_t> bytes(file.bytes.begin(), file.bytes.end()); // of exactly its size
    const rc_status status =
        rc_read_mesh(bytes.empty() ? reinterpret_cast<const uint8_t *>("") : bytes.data(),
                     int64_t(bytes.size()), file.format, 0.5, 1 << 20, 1 << 28, &mesh);
    counts[status == RC_OK]++;
    if (status == RC_BAD_ARGUMENT) {
        const std::string line = rc_last_error();
        const bool is_line = line.find("expected") != line.npos && line.find('\n') == line.npos &&
                             line.find(';') != line.npos;
        return is_line && !mesh ? "" : "says " + line;
    }
    if (status != RC_OK) return std::string("code of ") + rc_last_error();
    int64_t n_vertices = 0, n_faces = 0, n_groups = 0, n_text = 0;
    if (rc_mesh_size(mesh, &n_vertices, &n_faces, &n_groups, &n_text)) return rc_last_error();
    std::vector<double> vertices(size_t(3 * n_vertices));
    std::vector<int32_t> faces(size_t(3 * n_faces)), polygons(static_cast<size_t>(n_faces)),
        groups = polygons;
    std::vector<uint8_t> text(size_t(n_text) + 1);
    if (rc_mesh_read(mesh, n_vertices, n_faces, vertices.data(), faces.data(), polygons.data(),
                     groups.data()) ||
        rc_mesh_text(mesh, n_text, text.data()) || rc_mesh_free(mesh))
        return rc_last_error();
    for (const double each : vertices)
        if (!(std::abs(each) <= 1e30)) return "a coordinate that is none";
    for (const int32_t each : faces)
        if (each < 0 || each >= n_vertices) return "a corner without a vertex";
    for (const int32_t each : groups)
        if (each < 0 || each >= n_groups) return "a face without a group";
    return n_faces > 0 ? "" : "no faces";
}

void change(std::string &bytes, std::mt19937_64 &random) {
    static const std::array<std::string, 24> WORDS = {"-1",
                                                      "0",
                                                      "99",
                                                      "1e999",
                                                      "nan",
                                                      "9223372036854775807",
                                                      "-9223372036854775808",
                                                      "1e-9",
                                                      "\\\n",
                                                      "\\",
                                                      "#",
                                                      " ",
                                                      "\n",
                                                      "\r",
                                                      "f ",
                                                      "v ",
                                                      "list",
                                                      "solid",
                                                      "1/",
                                                      "18446744073709551615",
                                                      "\xff\xfe",
                                                      "int",
                                                      "OFF",
                                                      "4294967295"};
    const auto below = [&](size_t n) { return size_t(random() % (n ? n : 1)); };
    const size_t at = below(bytes.size() + 1), n = below(9);
    switch (below(5)) {
    case 0:
        if (at < bytes.size()) bytes[at] = char(bytes[at] ^ 1 << below(8));
        break;
    case 1:
        bytes.insert(at, bytes.substr(at, n));
        break;
    case 2:
        bytes.resize(at);
        break;
    case 3:
        bytes.erase(at, n);
        break;
    default:
        bytes.insert(at, WORDS[below(WORDS.size())]);
    }
}
} // namespace

int main(int n_arguments, char **arguments) {
    const int64_t n = n_arguments > 1 ? std::atoll(arguments[1]) : 20000;
    std::mt19937_64 random(n_arguments > 2 ? std::strtoull(arguments[2], nullptr, 10) : 1);
    const std::vector<File> all = seeds();
    int64_t counts[2] = {};
    const auto is_right = [&](const File &file) {
        const std::string fault = fault_of(file, counts);
        if (!fault.empty())
            std::printf("format %d, %s:\n%s\n", int(file.format), fault.c_str(),
                        file.bytes.c_str());
        return fault.empty();
    };
    for (const File &file : all) {
        if (!is_right(file) || !counts[1]) return 1;
        for (size_t size = 0; size < file.bytes.size(); size++)
            if (!is_right({file.format, file.bytes.substr(0, size)})) return 1;
    }
    for (int64_t k = 0; k < n; k++) {
        File file = all[random() % all.size()];
        for (uint64_t times = 1 + random() % 3; times > 0; times--) change(file.bytes, random);
        if (!is_right(file)) return 1;
    }
    std::printf("%lld meshes, %lld lines\n", static_cast<long long>(counts[1]),
                static_cast<long long>(counts[0]));
    return 0;
}
