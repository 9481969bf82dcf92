// Loops of presolve: pairs by face, and hashes of sets.
//
// The hash of a set is the sum of those of its members, so that their order does not matter; two
// different sets have the same 128 bits once in 10^38 pairs.
//
// G. L. Steele, D. Lea, C. H. Flood. Fast Splittable Pseudorandom Number Generators. 2014, for the
// mixing of 64 bits.
//
// Twin: tests/placement/test_lazy_selection.py, by dense arrays.
#include "bind.hpp"

namespace rastercov {
namespace placement {
namespace {

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

uint64_t mixed(uint64_t number) {
    uint64_t z = number + 0x9E3779B97F4A7C15;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
    z = (z ^ z >> 27) * 0x94D049BB133111EB;
    return z ^ z >> 31;
}

void hashes_of(Column<const uint64_t> keys, Array<uint64_t, Any, 2> hashes) {
    require(hashes.rows() == keys.rows(), "hashes must have one row for each key");
    for (int64_t i = 0; i < keys.rows(); i++) {
        hashes(i, 0) = mixed(keys[i]);
        hashes(i, 1) = mixed(hashes(i, 0) ^ 0x5851F42D4C957F2D);
    }
}

} // namespace
} // namespace placement

void register_placement_presolve(nanobind::module_ &m) {
    using namespace placement;
    def(m, "by_face", by_face,
        "Set the (F + 1,) row limits by face, and the candidate of each pair, (N,).\n\n"
        "The pairs are given by candidate: (C + 1,) limits `indptr` of the (N,) faces.",
        "indptr", "face", "starts", "candidates");
    def(m, "hashes_of", hashes_of, "Set the two hashes of each key, (N, 2).", "keys", "hashes");
}

} // namespace rastercov
