// Reasons of parts that no camera covers: the criteria that must be met to cover them, of the first
// set of criteria without which cameras cover the part.
//
// Twin: tests/area/test_stages.py, by rastercov.reference.regions.
#pragma once
#include "area/overlay.hpp"
#include "coverage/decision.hpp"
#include <array>

namespace rastercov {
namespace area {

// Criteria as bits, those of coverage::Fails and these; further ones are of features.
constexpr uint32_t IS_AT_ANGLE = 32, IS_UNCERTAIN = 64;
// Reason of each bit, as rastercov.core.coverage.task.CRITERIA.
constexpr std::array<uint8_t, 7> CRITERIA = {
    coverage::OUTSIDE,     coverage::OUT_OF_FOCUS,       coverage::TOO_COARSE,   coverage::OCCLUDED,
    coverage::TOO_OBLIQUE, coverage::ANGLE_OUT_OF_RANGE, coverage::TOO_UNCERTAIN};
// Bit of the code of several criteria that have no number together; lower ones are theirs.
constexpr uint32_t SEVERAL = uint32_t(1) << 31;
// Part of a face below which a reason is rounding.
constexpr double SLIVER_REL = 1e-9;

// Parts by face, (N,), with their tags of `SetOf`, the first of which is a row of the sets and one.
struct TaggedParts {
    PieceTable pieces;
    IntArray tag;
    FloatArray area;
};

// Of each face: whether a camera is in front of it, criteria of the surface itself that it fails,
// and the area that no reason is certain of, m^2.
struct FaceFacts {
    BoolArray in_front;
    Column<const uint32_t> own;
    FloatArray doubt;
};

// Writes the code of the reason of each part. `sets` have the criteria of each set as bits, `rows`
// the reason of each bit. What is not certain of a face lies along the borders of its parts: a
// reason of no more area than its share of that, by length, takes that of most of the face.
void name_parts(const TaggedParts &parts, Column<const uint32_t> sets, Column<const uint8_t> rows,
                const FaceFacts &faces, Column<uint32_t> reason);

} // namespace area

RECORD(area::TaggedParts, pieces, tag, area);
RECORD(area::FaceFacts, in_front, own, doubt);

} // namespace rastercov
