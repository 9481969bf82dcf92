// Reasons of parts that no camera covers.
//
// Twin: tests/area/test_stages.py, by rastercov.reference.regions.
#include "area/reason.hpp"
#include "bind.hpp"
#include <algorithm>
#include <array>
#include <bit>
#include <map>

namespace rastercov {
namespace area {
namespace {

uint32_t code_of(uint32_t bits, Column<const uint8_t> rows) {
    if (std::has_single_bit(bits)) return rows[std::countr_zero(bits)];
    return bits < coverage::N_SETS ? coverage::REASON_OF[bits] : SEVERAL | bits;
}

// Of what no set covers, the surface may fail a criterion itself; where nothing fails, a coincident
// surface is in front, or it is rounding.
uint32_t reason_of(int64_t tag, uint32_t own, bool in_front, Column<const uint32_t> sets,
                   Column<const uint8_t> rows) {
    const int64_t place = tag >> FIRST_AT;
    if (place == 0 && own == 0) return in_front ? coverage::OUTSIDE : coverage::BACK_FACING;
    uint32_t bits = place == 0 ? 0 : sets[place - 1];
    if (own != 0 && bits == coverage::IS_OUTSIDE) bits = 0; // nothing else has a value there
    bits |= own;
    return bits == 0 ? uint32_t(coverage::OCCLUDED) : code_of(bits, rows);
}

// Gives reasons of parts of one face, [first, last), that are too small that of most of it.
void without_slivers(int64_t first, int64_t last, const TaggedParts &parts, double doubt,
                     Column<uint32_t> reason) {
    std::map<uint32_t, std::array<double, 2>> sums; // area and length of borders of each reason
    double borders = 0.0;
    for (int64_t p = first; p < last; p++) {
        const auto piece = piece_at(p, parts.pieces.starts, parts.pieces.xy);
        const double border = perimeter_of(piece, piece.rows());
        auto &[area, own] = sums[reason[p]];
        area += parts.area[p];
        own += border;
        borders += border;
    }
    const uint32_t most =
        std::max_element(sums.begin(), sums.end(), [](const auto &one, const auto &other) {
            return one.second[0] < other.second[0];
        })->first;
    for (int64_t p = first; p < last; p++) {
        const auto [area, own] = sums[reason[p]];
        if (!(area * borders > doubt * own)) reason[p] = most;
    }
}

} // namespace

void name_parts(const TaggedParts &parts, Column<const uint32_t> sets, Column<const uint8_t> rows,
                const FaceFacts &faces, Column<uint32_t> reason) {
    const auto &[pieces, tag, area] = parts;
    const Int32Array &face = pieces.face;
    const int64_t n = face.rows();
    require(have_rows(n, tag, area, reason) && pieces.starts.rows() == n + 1,
            "parts must have one row of each array");
    require(have_rows(faces.doubt.rows(), faces.in_front, faces.own),
            "faces must have one row of each array");
    require_indices(face, faces.doubt.rows(), "face must hold faces");
    for (int64_t first = 0, p = 0; p < n; p++) {
        const int32_t f = face[p];
        require(uint64_t(tag[p]) >> FIRST_AT <= uint64_t(sets.rows()), "tags must be of the sets");
        reason[p] = reason_of(tag[p], faces.own[f], faces.in_front[f], sets, rows);
        if (p + 1 < n && face[p + 1] == f) continue;
        without_slivers(first, p + 1, parts, faces.doubt[f], reason);
        first = p + 1;
    }
}

} // namespace area

void register_area_reason(nanobind::module_ &m) {
    def(m, "name_parts", area::name_parts, "Reasons of parts that no camera covers.", "parts",
        "sets", "rows", "faces", "reason");
}

} // namespace rastercov
