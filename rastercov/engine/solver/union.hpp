// Union of regions of poses: a partition of the faces by how many or which poses cover each part.
//
// Regions are added pose by pose or many at once. Where poses are taken together by their numbers,
// a caller may divide them at multiples of these as it likes, for the same bits. A face that k
// poses cover as a whole is closed: it is one piece from then on, and costs nothing more. A face
// with many pieces is divided into cells by a tree of lines; pieces of two cells cannot overlap, so
// that a union takes time in proportion to their number. Cells last as long as the union: no piece
// is cut twice by one line.
//
// One thread at a time uses a union, also while progress is told. After an error, an interrupt or a
// lack of memory it is as it was before.
//
// Twins: tests/area/test_union.py, by Clipper2.
#pragma once
#include "area/overlay.hpp"
#include "solver/addition.hpp"
#include "solver/room.hpp"
#include <functional>

namespace rastercov::engine {

// Pieces of a cell up to which each is compared with all others.
constexpr int64_t MOST_PIECES = 256;
// Poses that a union adds at once: all, or of few faces many, large pieces first, and of others
// one.
constexpr int64_t ALL_TOGETHER = std::numeric_limits<int32_t>::max();
constexpr int64_t FEW_FACES = 2048, POSES_TOGETHER = 256;

// Called with the number of pieces done and of all, some times a second; it may throw.
using Progress = std::function<void(int64_t, int64_t)>;

class Union {
  public:
    // Of faces whose memory lives longer than the union. Poses are counted up to `views`; for 0,
    // parts have sets of up to 64 poses. `least` is the least distance of two corners that do not
    // coincide, m; cells of more than `most` pieces are divided; `together` poses are added at
    // once.
    Union(const FlatFaces &faces, double least, int64_t views, int64_t most = MOST_PIECES,
          int64_t together = ALL_TOGETHER);
    Union(const Union &) = delete;
    Union &operator=(const Union &) = delete;

    // Begins with a partition: pieces by face, and the number or the set of poses of each; and with
    // its bounds, of each face.
    void begin(const RegionPieces &pieces, IntArray tags, FloatArray bound, FloatArray excess);
    // Adds regions. For sets, `number` is the bit of each pose, and 64 times their kind.
    void add(const RegionPieces &pieces, const RegionPairs &pairs, IntArray number,
             const Progress &progress);
    // Adds one more pose, which covers all of some faces; not for sets.
    void fill(BoolArray chosen);

    int64_t n_faces() const { return _faces.areas.rows(); }
    int64_t views() const { return _views; }
    // Pieces of the partition, and corners.
    std::pair<int64_t, int64_t> size() const;
    // Fills arrays of that size with the pieces by face: `tag` is the number, up to k, or the set
    // of poses, `area` in m^2.
    void write(area::Points xy, Column<int64_t> starts, Column<int32_t> face, Column<int64_t> tag,
               Column<double> area) const;
    // Row j: area of each face that at least j + 1 poses cover, m^2.
    void write_areas(Array<double, Any, Any> out) const;
    // Bound and excess of each of these areas, m^2.
    void write_bounds(Array<double, 2, Any> out) const;
    // The same in memory of their own, one row after another.
    Room<double> areas(int64_t views) const {
        Room<double> out(views * n_faces());
        write_areas({out.data(), {views, n_faces()}});
        return out;
    }
    Room<double> bounds() const {
        Room<double> out(2 * n_faces());
        write_bounds({out.data(), {2, n_faces()}});
        return out;
    }
    // Faces that k poses cover as a whole.
    void write_closed(Column<bool> out) const;
    // Pairs of pieces in one cell so far: what a union compares.
    double n_pairs() const { return _n_pairs; }

  private:
    using Rows = IntArray;

    // All of a face, or one half of a cell. A cell with halves has no pieces.
    struct Cell {
        int64_t first = 0;
        int64_t count = 0; // pieces
        int64_t most = 0;  // pieces up to which no line is tried
        int32_t face = 0;
        int32_t half = -1; // the lower half, before the upper one, or -1
        bool is_closed = false;
    };
    class Change;
    class Report;

    Polygon outline_of(int64_t cell) const;
    double nearest_of(int64_t face) const;
    void find_leaves(int64_t face, std::vector<int64_t> &found) const;
    template <class Each> void each_piece(Each each) const;

    Cell &change(int64_t cell);
    void add_bound(int64_t face, double area);
    void tidy();
    template <class Tally> void add_to_faces(Addition &from, Tally tally, Report &report);
    template <class Tally>
    void unite_face(int64_t face, int64_t whole, bool is_waiting, Tally tally, Report &report);
    template <class Tally> double unite_cell(int64_t cell, Rows parts, int64_t whole, Tally tally);
    void descend(int64_t face);
    void order_parts();
    void sort_new(Rows parts);
    bool divide(int64_t cell, Rows parts, double &lost);
    bool make_halves(int64_t cell, const Divider &line);
    void store(int64_t cell);
    bool close_bare(int64_t face);
    void close_whole(int64_t face);

    FlatFaces _faces;
    double _least;
    int64_t _views, _most, _together;
    std::vector<Cell> _cells;       // those of the faces, then pairs of halves
    std::vector<Divider> _dividers; // of the cell of each pair
    PieceList _outlines;            // of the halves
    PieceList _pieces;              // of all cells, and some that no cell has any more
    int64_t _n_used = 0;            // pieces that cells have
    std::vector<Bounds> _bounds;
    std::vector<int64_t> _waiting; // faces to look at again in the next addition
    double _n_pairs = 0.0;

    // What a change replaces, to take it back.
    std::vector<std::pair<int64_t, Cell>> _cells_before;
    std::vector<std::pair<int64_t, Bounds>> _bounds_before;
    std::vector<int64_t> _waiting_next;
    // Scratch memory.
    area::Overlay _overlay;
    Halver _halver;
    Placed _parts, _next, _crowd;
    std::vector<int64_t> _leaves, _order;
    std::vector<std::pair<double, int64_t>> _by_area;
};

} // namespace rastercov::engine
