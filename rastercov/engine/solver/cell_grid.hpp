// Grid over the image in which live faces are listed, with its memory.
//
// Twins: tests/exact/test_blocks.py, tests/exact/test_needles.py.
#pragma once
#include "exact/grid.hpp"
#include "exact/passes.hpp"
#include "solver/room.hpp"

namespace rastercov::engine {

class CellGridRoom {
  public:
    explicit CellGridRoom(int64_t n_faces);
    CellGridRoom(const CellGridRoom &) = delete;

    // Lays it over n_live faces, of as many cells as the entries of large ones allow; `extent` is
    // that of set_up. No cell of it is asked for, and no face listed.
    void lay(int64_t n_live, const double (&extent)[7]);
    // Lists the faces of an image in the cells asked for.
    void list(const exact::Projected &projected);

    const exact::CellGrid &grid() const { return _grid; }
    int64_t n_cells() const { return _grid.columns * _grid.rows; }
    int64_t n_asked() const { return _n_fresh; }
    // True if all cells are listed.
    bool is_whole() const;

  private:
    void make_cells(int64_t n);
    void make_entries(int64_t n);

    exact::CellGrid _grid = {};
    int64_t _n_fresh = 0;
    int64_t _n_entries = 0;
    int64_t _n_listed = 0;
    Room<uint8_t> _asked;
    Room<bool> _is_near, _is_sorted, _has_bounds, _is_whole;
    Room<uint64_t> _fresh_bits;
    Room<int32_t> _fresh, _hider, _faces, _found, _entries, _pairs;
    Room<int64_t> _starts, _stops, _buckets;
    Room<double> _nearest, _bounds;
    Room<exact::Group> _groups;
};

} // namespace rastercov::engine
