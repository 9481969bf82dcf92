// Covered pairs of candidates and faces as bits, one row a candidate.
//
//     out[n, k] = sum of values[k, f] over the faces f of row n within mask k
//
// Face f is bit f % 64 of word f / 64 of a row. Arrays over faces have 64 W entries for W words.
// Words that are 0 are skipped, the bits of others taken as lanes, without branches: of 10,000
// faces that takes 1 us at any density. Sums of integers do not depend on their order, and lose
// bits beyond 64, as hashes do.
//
// Twins: tests/placement/test_bits.py, by dense arrays.
#include "bind.hpp"
#include "interrupt.hpp"
#include "simd.hpp"

namespace rastercov {
namespace placement {
namespace {

using Words = Array<const uint64_t, Any, Any>;
using Rows = IntArray; // of words
using Mask = Column<const uint64_t>;

constexpr int64_t BITS = 64;

// Lanes of 16 bits of a word from bit `first` on.
INLINE Long::M lanes(uint64_t word, int first) {
    const Long bit = to<int64_t>(Int::load(LANE_BITS));
    return (Long(int64_t(word >> first & 0xFFFF)) & bit) == bit;
}

// Calls visit(bit) for each bit of a word, the lowest first.
template <class Visit> INLINE void each_bit(uint64_t word, Visit visit) {
    for (; word; word &= word - 1) visit(std::countr_zero(word));
}

void set_pairs(IntArray row, Int32Array face, Array<uint64_t, Any, Any> words) {
    require(row.rows() == face.rows(), "row and face must have one entry for each pair");
    require_indices(row, words.rows(), "row must hold rows of words");
    require_indices(face, BITS * words.extent(1), "face must hold bits of a row of words");
    for (int64_t j = 0; j < row.rows(); j++)
        words(row[j], face[j] / BITS) |= uint64_t(1) << face[j] % BITS;
}

void sums(Words words, Rows rows, Words masks, Array<const int64_t, Any, Any> values,
          Array<int64_t, Any, Any> out) {
    const int64_t n_words = words.extent(1), n_values = values.rows();
    require(out.rows() == rows.rows() && out.extent(1) == n_values && masks.rows() == n_values,
            "out must have a row for each row, and a column for each row of masks and of values");
    require(masks.extent(1) == n_words, "masks must have as many words as rows");
    require(n_values == 0 || values.extent(1) == BITS * n_words,
            "values must have 64 columns for each word");
    require_indices(rows, words.rows(), "rows must hold rows of words");
    Poll poll(64);
    for (int64_t n = 0; n < rows.rows(); n++) {
        poll();
        const uint64_t *row = words[rows[n]].data;
        for (int64_t k = 0; k < n_values; k++) {
            Long total(0);
            for (int64_t i = 0; i < n_words; i++)
                if (const uint64_t word = row[i] & masks(k, i))
                    for (int b = 0; b < BITS; b += LANES)
                        total = total + select<int64_t>(lanes(word, b),
                                                        Long::load(&values(k, BITS * i + b)), 0);
            out(n, k) = sum(total);
        }
    }
}

void count_up(Words words, Array<uint64_t, Any, Any> planes) {
    const int64_t n_words = words.extent(1);
    require(planes.rows() == 0 || planes.extent(1) == n_words,
            "planes must have as many words as rows");
    if (planes.rows() == 0) return;
    Poll poll(64);
    for (int64_t n = 0; n < words.rows(); n++) {
        poll();
        const uint64_t *row = words[n].data;
        for (int64_t k = planes.rows() - 1; k > 0; k--) {
            const uint64_t *below = planes[k - 1].data;
            uint64_t *plane = planes[k].data;
            for (int64_t i = 0; i < n_words; i++) plane[i] |= below[i] & row[i];
        }
        uint64_t *plane = planes[0].data;
        for (int64_t i = 0; i < n_words; i++) plane[i] |= row[i];
    }
}

void list_pairs(Words words, Rows rows, Mask mask, Int32Array column, Column<int32_t> out) {
    const int64_t n_words = words.extent(1);
    require(mask.rows() == n_words && column.rows() == BITS * n_words,
            "mask must have as many words as rows, and column 64 entries for each");
    require_indices(rows, words.rows(), "rows must hold rows of words");
    int64_t at = 0;
    for (int64_t n = 0; n < rows.rows(); n++)
        for (int64_t i = 0; i < n_words; i++) {
            const uint64_t word = words(rows[n], i) & mask[i];
            require(std::popcount(word) <= out.rows() - at, "out must have a row for each pair");
            each_bit(word, [&](int b) { out[at++] = column[BITS * i + b]; });
        }
}

void by_face(IntArray indptr, Int32Array face, Column<int64_t> starts, Column<int32_t> candidates) {
    const int64_t n_faces = starts.rows() - 1, n = indptr.rows() - 1;
    require(n_faces >= 0 && candidates.rows() == face.rows(),
            "starts must have one row for each face, and one more, candidates one for each pair");
    bool is_right = n >= 0 && indptr[0] == 0 && indptr[n] == face.rows();
    for (int64_t c = 0; c < n; c++) is_right &= indptr[c] <= indptr[c + 1];
    require(is_right, "indptr must rise from 0 to the number of pairs");
    require_indices(face, n_faces, "face must hold faces");
    std::fill(starts.begin(), starts.end(), 0);
    for (const int32_t f : face) starts[f + 1]++;
    for (int64_t f = 0; f < n_faces; f++) starts[f + 1] += starts[f];
    std::vector<int64_t> at(starts.begin(), starts.end());
    for (int64_t c = 0; c < n; c++)
        for (int64_t j = indptr[c]; j < indptr[c + 1]; j++)
            candidates[at[size_t(face[j])]++] = int32_t(c);
}

} // namespace
} // namespace placement

void register_placement_bits(nanobind::module_ &m) {
    using namespace placement;
    def(m, "set_pairs", set_pairs,
        "Set the bits of pairs of row and face, (N,) each, in `words`, (C, W).", "row", "face",
        "words");
    def(m, "sums", sums,
        "Set `out`, (N, V), to the sums of values over the faces of each row.\n\n"
        "Of (C, W) words the N rows are added; (V, W) masks are the faces that count in each sum "
        "of\n"
        "the (V, 64 W) values. Sums that exceed 64 bits lose their upper ones.",
        "words", "rows", "masks", "values", "out");
    def(m, "count_up", count_up,
        "Add rows to the (K, W) planes, of which plane k has the faces of more than k rows.",
        "words", "planes");
    def(m, "list_pairs", list_pairs,
        "Set `out` to the columns of the faces of each row within a mask, row after row.", "words",
        "rows", "mask", "column", "out");
    def(m, "by_face", by_face,
        "Set the (F + 1,) row limits by face, and the candidate of each pair, (N,).\n\n"
        "The pairs are given by candidate: (C + 1,) limits `indptr` of the (N,) faces.",
        "indptr", "face", "starts", "candidates");
}

} // namespace rastercov
