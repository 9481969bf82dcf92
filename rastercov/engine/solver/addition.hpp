// What a union is about to take in: pieces and pairs of poses, by face.
//
// Twins: tests/area/test_union.py, by Clipper2.
#pragma once
#include "area/overlay.hpp"
#include "solver/division.hpp"
#include <algorithm>
#include <numeric>

namespace rastercov::engine {

// Convex pieces of poses, ordered by pose, then by face.
struct RegionPieces {
    FloatRows<2> xy;
    IntArray starts;
    Int32Array face, pose;
};

// Pairs of pose and face with a piece or a bound, in the same order. The true area is within
// `bound` of `area`, and at least `area - excess`, m^2.
struct RegionPairs {
    Int32Array pose, face;
    FloatArray area, bound, excess;
};

// Faces in their planes, metres, and their areas, m^2.
struct FlatFaces {
    FloatRows<3, 2> corners; // from (0, 0) along the longest edge
    FloatArray areas;
};

// A piece of a table; throws unless it is near its face, which no piece leaves but by rounding.
inline Polygon piece_on(const FlatFaces &faces, int64_t face, const RegionPieces &pieces,
                        int64_t row) {
    const Polygon piece = area::piece_at(row, pieces.starts, pieces.xy);
    const double size = faces.corners(face, 1, 0);
    for (const double at : piece)
        require(-size <= at && at <= 2 * size, "pieces must lie in their faces");
    return piece;
}

// Bounds of the area of a face, see RegionPairs.
struct Bounds {
    double bound = 0.0;
    double excess = 0.0;
};

// Parts of pieces in cells of one face: new ones, and those that a cell has had.
struct Placed {
    PieceList pieces;
    std::vector<int64_t> cell;
    std::vector<uint8_t> is_old;

    void clear() {
        pieces.shorten(0);
        cell.clear();
        is_old.clear();
    }
    void append(Polygon polygon, int64_t tag, int64_t in_cell, bool was_there) {
        pieces.append(polygon, tag);
        cell.push_back(in_cell);
        is_old.push_back(was_there);
    }
};

class Addition {
  public:
    // `number` is the bit of each pose, for sets, and has no rows else. Throws unless pieces and
    // pairs are ordered by pose, then by face.
    Addition(const FlatFaces &faces, const RegionPieces &pieces, const RegionPairs &pairs,
             IntArray number)
        : _faces(faces), _pieces(pieces), _pairs(pairs), _number(number) {
        find_whole();
        keep_parts();
        sort_by_face(_pair_rows, _pairs.face);
        sort_by_face(_piece_rows, _pieces.face);
    }

    // Pieces of pairs that are not whole.
    int64_t n_pieces() const { return int64_t(_piece_rows.size()); }
    // The next face of which there is something, or that waits; the number of faces after the last.
    int64_t next_face(const std::vector<int64_t> &waiting) const {
        int64_t face = _faces.areas.rows();
        if (_pair < _pair_rows.size()) face = std::min<int64_t>(face, face_of_pair());
        if (_piece < _piece_rows.size()) face = std::min<int64_t>(face, face_of_piece());
        if (_wait < waiting.size()) face = std::min(face, waiting[_wait]);
        return face;
    }
    // True if the face waits, which it does no more.
    bool take_waiting(int64_t face, const std::vector<int64_t> &waiting) {
        const bool is_waiting = _wait < waiting.size() && waiting[_wait] == face;
        if (is_waiting) _wait++;
        return is_waiting;
    }
    // Takes the pairs of a face: the sums of their bounds; and the number, or the set, of the poses
    // that cover all of it.
    Bounds take_pairs(int64_t face, int64_t &whole) {
        Bounds sums;
        for (; _pair < _pair_rows.size() && face_of_pair() == face; _pair++) {
            const int64_t row = _pair_rows[_pair];
            double missing = 0.0;
            if (_is_whole[row]) {
                missing = std::max(_faces.areas[face] - _pairs.area[row], 0.0);
                if (_number.rows() == 0) whole++;
                else whole |= area::SetOf::set_of(_number[_pairs.pose[row]]);
            }
            sums.bound += _pairs.bound[row] + missing;
            sums.excess += _pairs.excess[row] + missing;
        }
        return sums;
    }
    // Takes the pieces of a face to `out`, with their number for sets, else 0.
    void take_pieces(int64_t face, Placed &out) {
        for (; _piece < _piece_rows.size() && face_of_piece() == face; _piece++) {
            const int64_t row = _piece_rows[_piece];
            const Polygon piece = piece_on(_faces, face, _pieces, row);
            out.append(piece, _number.rows() ? _number[_pieces.pose[row]] : 0, face, false);
        }
    }
    // Leaves them out; their number.
    int64_t leave_pieces(int64_t face) {
        const size_t first = _piece;
        while (_piece < _piece_rows.size() && face_of_piece() == face) _piece++;
        return int64_t(_piece - first);
    }

  private:
    // Part of the area of a face that a pose may miss and still count as covering all of it.
    static constexpr double WHOLE_PAIR_REL = 1e-9;

    int32_t face_of_pair() const { return _pairs.face[_pair_rows[_pair]]; }
    int32_t face_of_piece() const { return _pieces.face[_piece_rows[_piece]]; }

    void find_whole() {
        const int64_t n = _pairs.face.rows();
        _pair_rows.resize(size_t(n));
        std::iota(_pair_rows.begin(), _pair_rows.end(), 0);
        _is_whole.resize(size_t(n));
        for (int64_t row = 0; row < n; row++) {
            const double least = (1 - WHOLE_PAIR_REL) * _faces.areas[_pairs.face[row]];
            _is_whole[row] = _pairs.area[row] >= least;
        }
    }

    // Keeps the pieces of pairs that are not whole.
    void keep_parts() {
        using Key = std::pair<int32_t, int32_t>;
        const int64_t n = _pieces.face.rows(), n_pairs = _pairs.face.rows();
        Key last = {-1, -1}, before = {-1, -1};
        int64_t pair = -1;
        for (int64_t row = 0; row < n; row++) {
            const Key own = {_pieces.pose[row], _pieces.face[row]};
            require(last <= own, "pieces must be in the order of poses, then of faces");
            last = own;
            while (before < own && pair < n_pairs) {
                pair++;
                if (pair == n_pairs) break;
                const Key next = {_pairs.pose[pair], _pairs.face[pair]};
                require(before < next, "pairs must be in the order of poses, then of faces");
                before = next;
            }
            if (pair == n_pairs || before != own || !_is_whole[pair]) _piece_rows.push_back(row);
        }
    }

    // Sorts rows by face; those of one face stay in their order.
    void sort_by_face(std::vector<int64_t> &rows, Int32Array face) const {
        const auto is_less = [&](int64_t a, int64_t b) { return face[a] < face[b]; };
        if (std::is_sorted(rows.begin(), rows.end(), is_less)) return;
        std::vector<int64_t> end(size_t(_faces.areas.rows() + 1)), sorted(rows.size());
        for (const int64_t row : rows) end[face[row] + 1]++;
        std::partial_sum(end.begin(), end.end(), end.begin());
        for (const int64_t row : rows) sorted[end[face[row]]++] = row;
        rows = std::move(sorted);
    }

    const FlatFaces &_faces;
    const RegionPieces &_pieces;
    const RegionPairs &_pairs;
    IntArray _number;
    std::vector<uint8_t> _is_whole;
    std::vector<int64_t> _pair_rows, _piece_rows; // by face
    // The next of each.
    size_t _pair = 0;
    size_t _piece = 0;
    size_t _wait = 0;
};

} // namespace rastercov::engine
