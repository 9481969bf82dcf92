// PLY files, text and binary. Every element of the header is read or skipped in the file's order;
// vertices and faces may have any other properties.
//
// G. Turk. The PLY Polygon File Format. 1994.
//
// Twins: tests/mesh/test_mesh_text.py, tests/mesh/test_mesh_binary.py.
#include "readers/text.hpp"
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

namespace rastercov::readers {
namespace {
struct Type {
    Text name, other;
    int size;
    char kind; // i, u, f
};
// Those of 1994, and what trimesh and meshio write beside them.
constexpr std::array<Type, 11> TYPES = {{{"char", "int8", 1, 'i'},
                                         {"uchar", "uint8", 1, 'u'},
                                         {"short", "int16", 2, 'i'},
                                         {"ushort", "uint16", 2, 'u'},
                                         {"int", "int32", 4, 'i'},
                                         {"uint", "uint32", 4, 'u'},
                                         {"float", "float32", 4, 'f'},
                                         {"double", "float64", 8, 'f'},
                                         {"int64", "", 8, 'i'},
                                         {"uint64", "", 8, 'u'},
                                         {"float16", "", 2, 'f'}}};

const Type *type_of(Text word) {
    const auto *const at = std::find_if(TYPES.begin(), TYPES.end(), [&](const Type &each) {
        return each.name == word || each.other == word;
    });
    return at == TYPES.end() ? nullptr : at;
}

// Values in all rows, and how many each row of a list has.
struct Column {
    Reals reals;
    Wholes wholes, counts;

    void reserve(int64_t n, bool is_list) {
        reals.reserve(is_list ? 0 : n);
        wholes.reserve(is_list ? 3 * n : 0);
        counts.reserve(is_list ? n : 0);
    }
};

struct Property {
    String name;
    const Type *type, *count_type; // null unless it is a list
    Column *kept = nullptr;        // where its values are wanted

    bool has_corners() const { return name == "vertex_indices" || name == "vertex_index"; }
};

template <class All> String list_all(const All &all) {
    String names;
    for (const auto &each : all) names += text(names.empty() ? "" : ", ", quote(Text(each.name)));
    return names;
}

struct Element {
    String name;
    int64_t count;
    std::vector<Property> properties;

    bool is_surface() const { return name == "face" || name == "tristrips"; }
    // The property that is wanted; refuses the element where there is none.
    template <class Is> Property &get(Text wanted, Is is_it) {
        for (Property &each : properties)
            if (is_it(each)) return each;
        refuse_again("element ", quote(name), ": expected a property ", quote(wanted), ", got [",
                     list_all(properties), "]");
    }
};

enum Order { TEXT, LITTLE, BIG, N_ORDERS };
constexpr std::array<Text, N_ORDERS> ORDERS = {"ascii", "binary_little_endian",
                                               "binary_big_endian"};

struct Header {
    int order = N_ORDERS;
    std::vector<Element> elements;

    Element *find(Text name) {
        for (Element &each : elements)
            if (each.name == name) return &each;
        return nullptr;
    }
    // False for a line of the header that is none.
    bool add(const Lines &lines);
};

bool Header::add(const Lines &lines) {
    const Words words = lines.words();
    const Text first = words[0];
    if (first == "format" && words.size() == 3 && words[2] == "1.0") {
        const auto *const at = std::find(ORDERS.begin(), ORDERS.end(), words[1]);
        order = at == ORDERS.end() ? order : int(at - ORDERS.begin());
        return at != ORDERS.end();
    }
    if (first == "element" && words.size() == 3 && is_digits(words[2])) {
        const String name = show(words[1]);
        if (find(name)) lines.refuse("each element once", words);
        elements.push_back({name, 0, {}});
        return read_whole(words[2], elements.back().count);
    }
    if (first == "property" && !elements.empty() && words.size() >= 3) {
        const bool is_list = words[1] == "list" && words.size() == 5;
        const Type *const type = type_of(words[is_list ? 3 : 1]);
        const Type *const count_type = is_list ? type_of(words[2]) : nullptr;
        if (!type || (is_list ? !count_type || count_type->kind == 'f' : words.size() != 3))
            return false;
        elements.back().properties.push_back({show(words.back()), type, count_type});
        return true;
    }
    return first == "comment" || first == "obj_info" || first == "end_header";
}

// Where the header ends: after a line of its own; 0 where it does not.
size_t end_of_header(Text data, const Limits &limits) {
    Lines lines(data.substr(0, 1 << 20), limits);
    while (lines.next())
        if (lines.words().size() == 1 && lines.words()[0] == "end_header" && !lines.is_cut())
            return lines.at() - data.data();
    return 0;
}

class Body {
  public:
    Body(Text data, size_t start, const Limits &limits)
        : _data(data), _at(start), _limits(limits) {}

    void read_text(Element &element, Lines &lines) {
        if (element.properties.empty()) return;
        String names = "values for";
        for (const Property &each : element.properties) names += " " + each.name;
        const int64_t count = element.count;
        bool is_kept = false;
        for (const Property &each : element.properties) is_kept |= each.kept != nullptr;
        for (int64_t k = 0; k < count; k++) {
            lines.take(k, count, element.name);
            _numbers.clear();
            lines.add_reals(lines.words(), names, _numbers);
            add_row(element, lines, names);
        }
        if (count) _is_cut = is_kept && lines.is_cut();
    }

    void read_binary(Element &element, bool is_big) {
        Poll poll;
        for (const Property &each : element.properties)
            if (each.kept) each.kept->reserve(element.count, each.count_type);
        for (int64_t k = 0; k < element.count && !element.properties.empty(); k++, poll())
            for (Property &each : element.properties) {
                const int64_t n = each.count_type ? count_of(each, is_big) : 1;
                const int64_t begin = int64_t(_at);
                const Wide size = Wide(n) * each.type->size;
                if (n < 0 || begin + size > Wide(_data.size()))
                    refuse_again("expected ", n, " values of ", quote(each.name), " of element ",
                                 quote(element.name), " up to byte ", begin + size, ", got ",
                                 _data.size(), " bytes; truncated");
                if (each.kept) add_values(each, n, is_big);
                _at = size_t(begin + int64_t(size));
            }
    }

    size_t n_left() const { return _data.size() - _at; }
    bool is_cut() const { return _is_cut; }

  private:
    void add_row(Element &element, const Lines &lines, Text names) {
        const Words words = lines.words();
        size_t at = 0;
        for (Property &each : element.properties) {
            int64_t n = 1;
            if (each.count_type) n = lines.whole(at < words.size() ? words[at++] : "", names);
            if (n < 0 || n > int64_t(words.size() - at)) lines.refuse(names, words);
            if (each.kept && each.count_type) {
                lines.add_wholes(words.subspan(at, size_t(n)), names, each.kept->wholes);
                add_count(*each.kept, n);
            } else if (each.kept) {
                each.kept->reals.push_back(_numbers[at]);
            }
            at += size_t(n);
        }
        if (at < words.size()) lines.refuse(names, words);
    }

    void add_count(Column &to, int64_t n) {
        to.counts.push_back(n);
        const auto more = int64_t(to.wholes.size()) - 2 * int64_t(to.counts.size());
        check_budget(std::max<int64_t>(0, more), _limits);
    }

    // The bytes of a value, from the highest on, as bits.
    uint64_t bits_at(const Type &type, size_t at, bool is_big) const {
        uint64_t bits = 0;
        if (at + 8 <= _data.size()) std::memcpy(&bits, _data.data() + at, 8);
        else std::memcpy(&bits, _data.data() + at, type.size);
        return is_big ? __builtin_bswap64(bits) : bits << (64 - 8 * type.size);
    }

    // A whole number; the greatest one for what is beyond it.
    int64_t whole_at(const Type &type, size_t at, bool is_big) const {
        const uint64_t bits = bits_at(type, at, is_big);
        const int unused = 64 - 8 * type.size;
        if (type.kind == 'i') return int64_t(bits) >> unused;
        return int64_t(std::min(bits >> unused, uint64_t(INT64_MAX)));
    }

    double value_at(const Type &type, size_t at, bool is_big) const {
        if (type.kind != 'f') return double(whole_at(type, at, is_big));
        const uint64_t bits = bits_at(type, at, is_big);
        if (type.size == 8) return std::bit_cast<double>(bits);
        if (type.size == 4) return std::bit_cast<float>(uint32_t(bits >> 32));
        // Of 16 bits: with the exponent of 32.
        const auto half = uint32_t(bits >> 48 & 0x7fff);
        const double size = half < 0x7c00 ? std::bit_cast<float>(half << 13) * 0x1p112 : NAN;
        return bits >> 63 ? -size : size;
    }

    // The number of values of a list, 1 where the file ends before it.
    int64_t count_of(const Property &list, bool is_big) {
        const size_t at = _at;
        _at += list.count_type->size;
        return _at <= _data.size() ? whole_at(*list.count_type, at, is_big) : 1;
    }

    void add_values(const Property &from, int64_t n, bool is_big) {
        Column &to = *from.kept;
        for (int64_t k = 0; k < n; k++) {
            const size_t at = _at + k * from.type->size;
            if (from.count_type) to.wholes.push_back(whole_at(*from.type, at, is_big));
            else to.reals.push_back(value_at(*from.type, at, is_big));
        }
        if (from.count_type) add_count(to, n);
    }

    Text _data;
    size_t _at;
    const Limits &_limits;
    Reals _numbers; // of a line
    bool _is_cut = false;
};

// Corners of polygons, one list each.
void add_faces(Column from, Column &to) {
    for (size_t f = 0; f < from.counts.size(); f++)
        if (from.counts[f] < 3)
            refuse_again("face ", f, ": expected 3 or more vertices, got ", from.counts[f]);
    const auto append = [](Wholes &all, const Wholes &more) {
        all.insert(all.end(), more.data(), more.data() + more.size());
    };
    append(to.wholes, from.wholes);
    append(to.counts, from.counts);
}

// Corners of triangles; -1 ends a strip within its list, odd triangles are reversed.
void add_strips(const Column &from, Column &to, const Limits &limits) {
    check_budget(int64_t(from.wholes.size()), limits);
    size_t at = 0;
    for (const int64_t count : from.counts) {
        int64_t n = 0; // corners of the strip
        for (int64_t k = 0; k < count; k++, at++) {
            const bool is_gap = from.wholes[at] == -1, is_last = is_gap || k + 1 == count;
            n += !is_gap;
            if (is_last && n > 0 && n < 3)
                refuse_again("expected a strip of 3 or more vertices, got one that ends at "
                             "value ",
                             at);
            if (n >= 3 && !is_gap) {
                const size_t odd = n % 2 == 0;
                const int64_t *const last = from.wholes.data() + at;
                to.wholes.insert(to.wholes.end(), {last[-2], *(last - 1 + odd), *(last - odd)});
                to.counts.push_back(3);
            }
            if (is_gap) n = 0;
        }
    }
}

Header header_of(Lines &lines) {
    Header header;
    lines.require_next("'ply'");
    while (lines.next())
        if (!header.add(lines)) lines.refuse("a format, element or property", lines.words());
    if (header.order == N_ORDERS)
        refuse_again("expected a line 'format' with one of ['ascii', 'binary_little_endian', "
                     "'binary_big_endian'], got none");
    return header;
}

// Refuses counts that cannot be in the bytes that are left.
void check_counts(Header &header, size_t n_left) {
    bool has_surface = false;
    for (const Element &each : header.elements) {
        int64_t least = 0;
        for (const Property &own : each.properties)
            least += header.order == TEXT ? 2 : (own.count_type ? own.count_type : own.type)->size;
        check_count(each.count, text("elements ", quote(each.name)), std::max<int64_t>(1, least),
                    n_left);
        has_surface |= each.is_surface();
    }
    if (!has_surface || !header.find("vertex"))
        refuse_again(
            text("expected elements vertex and face, got [", list_all(header.elements), "]"));
}

void note_others(const Header &header, Strings &notes) {
    std::vector<Element> others;
    for (const Element &each : header.elements) {
        const bool has_corners =
            std::any_of(each.properties.begin(), each.properties.end(),
                        [](const Property &p) { return p.count_type && p.has_corners(); });
        if (!each.is_surface() && each.count && has_corners && others.size() < 5)
            others.push_back({each.name.substr(0, 40), 0, {}});
    }
    if (!others.empty())
        notes.push_back(text("ignored elements ", list_all(others), ", which have vertices"));
}
} // namespace

MeshFile read_ply(Text data, const Limits &limits) {
    data = without_mark(data);
    const size_t start = end_of_header(data, limits);
    if (!data.starts_with("ply") || !start)
        refuse("expected 'ply' ... 'end_header' at the start, got none; name a PLY file");
    Lines head(data.substr(0, start), limits);
    Header header = header_of(head);
    check_counts(header, data.size() - start);
    std::array<Column, 3> axes;
    Element &vertex = *header.find("vertex");
    for (size_t k = 0; k < 3; k++) {
        const Text axis = Text("xyz").substr(k, 1);
        vertex.get(axis, [&](const Property &p) { return p.name == axis && !p.count_type; }).kept =
            &axes[k];
    }
    std::array<Column, 2> lists; // of the surfaces, in the order of the file
    Column *list = lists.data();
    for (Element &each : header.elements)
        if (each.is_surface())
            each.get("vertex_indices",
                     [](const Property &p) {
                         return p.has_corners() && p.count_type && p.type->kind != 'f';
                     })
                .kept = list++;
    const Element *const face = header.find("face");
    check_budget(face ? face->count : 0, limits, vertex.count);
    Body body(data, start, limits);
    Lines lines(data.substr(start), limits, Lines::NO_COMMENT, false, head.number());
    for (Element &each : header.elements) {
        if (header.order == TEXT) body.read_text(each, lines);
        else body.read_binary(each, header.order == BIG);
    }
    MeshFile mesh;
    if (header.order == TEXT) lines.note_rest(body.is_cut(), mesh.notes);
    else if (body.n_left())
        mesh.notes.push_back(text("ignored ", body.n_left(), " bytes after the last element"));
    note_others(header, mesh.notes);
    mesh.vertices.reserve(3 * axes[0].reals.size());
    for (size_t v = 0; v < axes[0].reals.size(); v++)
        for (const Column &axis : axes) mesh.vertices.push_back(axis.reals[v]);
    Column polygons;
    list = lists.data();
    for (const Element &each : header.elements)
        if (each.name == "face") add_faces(std::move(*list++), polygons);
        else if (each.is_surface()) add_strips(*list++, polygons, limits);
    fan_polygons(mesh, polygons.wholes, polygons.counts, limits);
    return mesh;
}
} // namespace rastercov::readers
