// Size and memory of the grid; what it lists is exact/grid.cpp's.
//
// Twins: tests/exact/test_blocks.py, tests/exact/test_needles.py.
#include "solver/cell_grid.hpp"
#include "exact/grid.hpp"
#include <cmath>

namespace rastercov::engine {

using exact::SPARE_ENTRIES;

namespace {
// Columns, or rows, of the grid.
constexpr double MOST_COLUMNS = 1 << 14;
// Pixels; width and height that the grid covers at least.
constexpr double LEAST_EXTENT = 1e-100;
// Cells of the grid for each face, unless that makes more entries than ENTRIES_PER_FACE.
constexpr int64_t CELLS_PER_FACE = 1, ENTRIES_PER_FACE = 3;
// Width to height of boxes, or height to width, on average, from which on cells have that shape.
constexpr double NEEDLE = 16;
constexpr int64_t BOUNDS = 12; // rows of CellGrid.bounds
} // namespace

CellGridRoom::CellGridRoom(int64_t n_faces)
    : _is_whole(n_faces), _faces(n_faces), _found(n_faces), _buckets(exact::BUCKETS + 1) {
    _is_whole.fill(false);
    _grid.n_fresh = {&_n_fresh, {1}};
    _grid.n_entries = {&_n_entries, {1}};
    _grid.n_faces = {&_n_listed, {1}};
    _grid.faces = _faces.all();
    _grid.found = _found.all();
    _grid.buckets = _buckets.all();
    _grid.is_whole = _is_whole.all();
    make_entries(first_room(2 * n_faces));
}

void CellGridRoom::lay(int64_t n_live, const double (&extent)[7]) {
    const double nothing[7] = {0, 1, 0, 1, 0, 0, 0};
    const double *const of = n_live ? extent : nothing;
    const double widths = of[exact::SUM_OF_WIDTHS], heights = of[exact::SUM_OF_HEIGHTS];
    const double wide = std::max(of[exact::U_MAX] - of[exact::U_MIN], LEAST_EXTENT);
    const double high = std::max(of[exact::V_MAX] - of[exact::V_MIN], LEAST_EXTENT);
    double cells = double(CELLS_PER_FACE * n_live) + 1.0, aspect = wide / high;
    if (std::max(widths, heights) > NEEDLE * std::min(widths, heights)) // needles along an axis
        aspect *= widths > 0 ? heights / widths : NEEDLE * NEEDLE;
    while (true) {
        const double columns = std::max(1.0, std::sqrt(cells * aspect));
        _grid.columns = int64_t(std::min(columns, MOST_COLUMNS));
        const double rows = std::max(1.0, cells / double(_grid.columns));
        _grid.rows = int64_t(std::min(rows, MOST_COLUMNS));
        _grid.per_u = double(_grid.columns) / wide;
        _grid.per_v = double(_grid.rows) / high;
        // A box w wide and h high touches (1 + w per_u)(1 + h per_v) cells, on average.
        const double entries = double(n_live) + widths * _grid.per_u + heights * _grid.per_v +
                               of[exact::SUM_OF_AREAS] * _grid.per_u * _grid.per_v;
        if (entries <= double(ENTRIES_PER_FACE * n_live) || n_cells() == 1) break;
        cells /= 2;
    }
    _grid.left = of[exact::U_MIN];
    _grid.top = of[exact::V_MIN];
    const int64_t n = n_cells(), words = (_grid.columns + 63) / 64;
    if (_fresh_bits.size() < _grid.rows * words) _fresh_bits.take(_grid.rows * words);
    _grid.fresh_bits = {_fresh_bits.data(), {_grid.rows, words}};
    std::fill(_grid.fresh_bits.begin(), _grid.fresh_bits.end(), 0);
    if (_hider.size() < n) make_cells(n);
    std::fill_n(_asked.data(), n, uint8_t(exact::NOT_ASKED));
    std::fill_n(_is_near.data(), n, false);
    _n_fresh = 0;
    _n_entries = 0;
}

void CellGridRoom::list(const exact::Projected &projected) {
    while (true) {
        const int64_t needed = exact::fill_grid(projected, _grid);
        if (needed <= _grid.entries.rows()) return;
        make_entries(more_room(needed));
    }
}

bool CellGridRoom::is_whole() const {
    const uint8_t *const end = _asked.data() + n_cells();
    return std::find(static_cast<const uint8_t *>(_asked.data()), end, uint8_t(exact::NOT_ASKED)) ==
           end;
}

void CellGridRoom::make_cells(int64_t n) {
    _asked.take(n);
    _is_near.take(n);
    _fresh.take(n);
    _starts.take(n);
    _stops.take(n);
    _is_sorted.take(n);
    _has_bounds.take(n);
    _hider.take(n);
    _grid.asked = _asked.all();
    _grid.is_near = _is_near.all();
    _grid.fresh = _fresh.all();
    _grid.starts = _starts.all();
    _grid.stops = _stops.all();
    _grid.is_sorted = _is_sorted.all();
    _grid.has_bounds = _has_bounds.all();
    _grid.hider = _hider.all();
}

void CellGridRoom::make_entries(int64_t n) {
    const int64_t spare = n + SPARE_ENTRIES, before = _grid.bounds.extent(1);
    Room<double> bounds(BOUNDS * spare);
    for (int64_t row = 0; row < BOUNDS && _n_entries; row++)
        std::copy_n(_bounds.data() + row * before, _n_entries, bounds.data() + row * spare);
    _bounds = std::move(bounds);
    const int64_t n_groups = 2 * (n / exact::GROUP_SIZE + 1);
    _groups.grow(n_groups, std::min(n_groups, _groups.size()));
    _entries.grow(n, _n_entries);
    _nearest.grow(n, _n_entries);
    _pairs.take(2 * spare);
    _grid.bounds = {_bounds.data(), {BOUNDS, spare}};
    _grid.entries = _entries.all();
    _grid.groups = _groups.all();
    _grid.nearest = _nearest.all();
    _grid.pairs = _pairs.rows<2>(spare);
}

} // namespace rastercov::engine
