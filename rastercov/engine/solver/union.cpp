// Partition of faces: addition of regions face by face, division into cells, closed faces.
//
// Bounds are added up in the order of stages: pairs, pieces cut on the way down the tree, pieces of
// cells that are divided, slivers. Pieces of a cell keep their order, but new ones are added large
// ones first.
//
// Twins: tests/area/test_union.py, by Clipper2; tests/area/test_division.py.
#include "solver/union.hpp"
#include "interrupt.hpp"
#include "solver/addition.hpp"
#include "sort.hpp"
#include <numeric>

namespace rastercov::engine {
namespace {

using area::CountTo, area::SetOf;

// Part of the area of a cell that may be missing from what counts as all of it.
constexpr double WHOLE_REL = 1e-9;
// Sides of a cell that is divided no more: as many as a piece may have.
constexpr int64_t MOST_SIDES = 20;
// Pieces that are added between two signs of progress: less than a second of work.
constexpr int64_t PIECES_A_STEP = 4096;
// Pieces that no cell has any more, above which the others are moved together.
constexpr int64_t LEAST_UNUSED = 4096;

constexpr double WHOLE = 1 - WHOLE_REL;

// Rows of an array from the first to before the last.
template <class Rows> Rows rows_of(const Rows &of, int64_t first, int64_t last) {
    return {of.data + first, {last - first}};
}
} // namespace

// --- a change, which is whole or not at all ---

class Union::Change {
  public:
    explicit Change(Union &of)
        : _of(of), _n_cells(of._cells.size()), _n_pieces(of._pieces.size()), _n_used(of._n_used),
          _n_pairs(of._n_pairs) {
        of._cells_before.clear();
        of._bounds_before.clear();
        of._waiting_next.clear();
        _waiting = of._waiting;
    }
    Change(const Change &) = delete;
    Change &operator=(const Change &) = delete;

    // After the last face of some poses.
    void next() {
        std::swap(_of._waiting, _of._waiting_next);
        _of._waiting_next.clear();
    }
    void keep() { _is_kept = true; }
    ~Change() {
        if (_is_kept) return;
        _of._waiting = std::move(_waiting);
        const int64_t n_halves = int64_t(_n_cells) - _of.n_faces();
        _of._cells.resize(_n_cells, Cell());
        _of._outlines.shorten(n_halves);
        _of._dividers.resize(size_t(n_halves / 2));
        _of._pieces.shorten(_n_pieces);
        for (size_t i = _of._cells_before.size(); i-- > 0;)
            _of._cells[_of._cells_before[i].first] = _of._cells_before[i].second;
        for (size_t i = _of._bounds_before.size(); i-- > 0;)
            _of._bounds[_of._bounds_before[i].first] = _of._bounds_before[i].second;
        _of._n_used = _n_used;
        _of._n_pairs = _n_pairs;
    }

  private:
    Union &_of;
    size_t _n_cells;
    int64_t _n_pieces, _n_used;
    double _n_pairs;
    std::vector<int64_t> _waiting;
    bool _is_kept = false;
};

Union::Cell &Union::change(int64_t cell) {
    _cells_before.emplace_back(cell, _cells[cell]);
    return _cells[cell];
}

void Union::add_bound(int64_t face, double area) {
    _bounds[face].bound += area;
    _bounds[face].excess += area;
}

// Signs of progress.
class Union::Report {
  public:
    Report(const Progress &progress, int64_t n_pieces) : _progress(progress), _total(n_pieces) {}
    // Counts pieces as done.
    void add(int64_t n) {
        _done += n;
        if (!_progress || n == 0 || (_done - _said < PIECES_A_STEP && _done < _total)) return;
        _said = _done;
        _progress(_done, _total);
    }

  private:
    const Progress &_progress;
    int64_t _total, _done = 0, _said = 0;
};

// --- the union ---

Union::Union(const FlatFaces &faces, double least, int64_t views, int64_t most, int64_t together)
    : _faces(faces), _least(least), _views(views), _most(most), _together(together) {
    const int64_t n = n_faces();
    require(faces.corners.rows() == n, "corners and areas must have one row for each face");
    expect(n < std::numeric_limits<int32_t>::max() / 4, "fewer than 2^29 faces", n,
           "split the mesh");
    const auto is_finite = [](double value) { return std::isfinite(value); };
    require(std::all_of(faces.corners.begin(), faces.corners.end(), is_finite) &&
                std::isfinite(least) && least >= 0,
            "corners must be finite, and least not negative");
    require(views >= 0 && views < std::numeric_limits<int32_t>::max(),
            "views must be a number of poses, or 0 for sets");
    require(most >= 1 && most <= std::numeric_limits<int64_t>::max() / 4,
            "most must be a number of pieces");
    require(together >= 1 && together <= ALL_TOGETHER, "together must be a number of poses");
    Cell whole;
    whole.most = most;
    _cells.assign(size_t(n), whole);
    for (int64_t f = 0; f < n; f++) _cells[f].face = int32_t(f);
    _bounds.resize(size_t(n));
}

void Union::begin(const RegionPieces &pieces, IntArray tags, FloatArray bound, FloatArray excess) {
    const int64_t n = pieces.face.rows();
    require(_pieces.size() == 0, "a union must begin before anything is added");
    require(pieces.starts.rows() == n + 1 && tags.rows() == n,
            "face and tags must have one row for each piece, starts one more");
    require(have_rows(n_faces(), bound, excess),
            "bound and excess must have one row for each face");
    require_indices(pieces.face, n_faces(), "face must hold faces");
    require(std::is_sorted(pieces.face.begin(), pieces.face.end()),
            "pieces must be in the order of faces");
    Change all(*this);
    for (int64_t row = 0; row < n; row++) {
        const Polygon piece = piece_on(_faces, pieces.face[row], pieces, row);
        require(piece.rows() <= exact::MOST_CORNERS && (_views == 0 || tags[row] > 0),
                "pieces must have at most 20 corners, and a pose that covers them");
        _pieces.append(piece, _views > 0 ? std::min(tags[row], _views) : tags[row]);
        Cell &cell = change(pieces.face[row]);
        if (cell.count == 0) _waiting_next.push_back(pieces.face[row]);
        if (cell.count == 0) cell.first = row;
        cell.count++;
    }
    _n_used = n;
    for (int64_t f = 0; f < n_faces(); f++) _bounds[f] = {bound[f], excess[f]};
    all.next();
    all.keep();
}

void Union::add(const RegionPieces &pieces, const RegionPairs &pairs, IntArray number,
                const Progress &progress) {
    const int64_t n = pieces.face.rows(), n_pairs = pairs.face.rows();
    require(pieces.starts.rows() == n + 1 && pieces.pose.rows() == n,
            "face and pose must have one row for each piece, starts one more");
    require(have_rows(n_pairs, pairs.pose, pairs.area, pairs.bound, pairs.excess),
            "pairs must have one row in each array");
    require_indices(pieces.face, n_faces(), "face must hold faces");
    require_indices(pairs.face, n_faces(), "pairs must be of faces");
    require(_views == 0 || number.rows() == 0, "number must have no rows but for sets");
    if (_views == 0) {
        require_indices(pairs.pose, number.rows(), "number must have one row for each pose");
        require_indices(pieces.pose, number.rows(), "number must have one row for each pose");
    }
    require_indices(number, area::N_NUMBERS, "number must be 0 to 63, of a kind");
    const int64_t kind = number.rows() ? SetOf::kind_of(number[0]) : area::ADDS;
    for (const int64_t own : number)
        require(SetOf::kind_of(own) == kind, "numbers must be of one kind");
    tidy();
    Change all(*this);
    Report report(progress, n);
    for (int64_t piece = 0, pair = 0; piece < n || pair < n_pairs; all.next()) {
        const int64_t pose = std::min(piece < n ? pieces.pose[piece] : INT32_MAX,
                                      pair < n_pairs ? pairs.pose[pair] : INT32_MAX);
        const int64_t end = pose - pose % _together + _together;
        const int64_t first = piece, pairs_before = pair;
        while (piece < n && pieces.pose[piece] < end) piece++;
        while (pair < n_pairs && pairs.pose[pair] < end) pair++;
        const auto own = [&](const auto &of, int64_t more = 0) {
            return rows_of(of, first, piece + more);
        };
        const auto of_pairs = [&](const auto &of) { return rows_of(of, pairs_before, pair); };
        const RegionPieces some = {pieces.xy, own(pieces.starts, 1), own(pieces.face),
                                   own(pieces.pose)};
        const RegionPairs some_pairs = {of_pairs(pairs.pose), of_pairs(pairs.face),
                                        of_pairs(pairs.area), of_pairs(pairs.bound),
                                        of_pairs(pairs.excess)};
        Addition from(_faces, some, some_pairs, number);
        report.add(piece - first - from.n_pieces());
        if (_views > 0) add_to_faces(from, CountTo{_views}, report);
        else add_to_faces(from, SetOf{kind == area::ADDS ? 0 : area::FIRST}, report);
    }
    all.keep();
}

void Union::fill(BoolArray chosen) {
    require(chosen.rows() == n_faces(), "chosen must have one row for each face");
    require(_views > 0, "sets have no pose more");
    std::vector<int32_t> face;
    std::vector<double> areas;
    for (int64_t f = 0; f < n_faces(); f++) {
        if (!chosen[f]) continue;
        face.push_back(int32_t(f));
        areas.push_back(_faces.areas[f]);
    }
    const int64_t n = int64_t(face.size()), start = 0;
    const std::vector<int32_t> pose(face.size());
    const std::vector<double> none(face.size());
    const RegionPairs pairs = {{pose.data(), {n}},
                               {face.data(), {n}},
                               {areas.data(), {n}},
                               {none.data(), {n}},
                               {none.data(), {n}}};
    add({{}, {&start, {1}}, {}, {}}, pairs, {}, {});
}

// Moves the pieces of cells together where many others are among them.
void Union::tidy() {
    if (_pieces.size() <= 2 * _n_used + LEAST_UNUSED) return;
    PieceList kept;
    std::vector<int64_t> first(_cells.size());
    for (size_t cell = 0; cell < _cells.size(); cell++) {
        first[cell] = kept.size();
        for (int64_t i = 0; i < _cells[cell].count; i++) {
            const int64_t at = _cells[cell].first + i;
            kept.append(_pieces[at], _pieces.tag(at));
        }
    }
    for (size_t cell = 0; cell < _cells.size(); cell++) _cells[cell].first = first[cell];
    _pieces = std::move(kept);
}

template <class Tally> void Union::add_to_faces(Addition &from, Tally tally, Report &report) {
    Poll poll(16);
    while (true) {
        const int64_t face = from.next_face(_waiting);
        if (face == n_faces()) return;
        poll();
        int64_t whole = 0;
        const bool is_waiting = from.take_waiting(face, _waiting);
        const bool is_closed = _cells[face].is_closed;
        const Bounds more = from.take_pairs(face, whole);
        _parts.clear();
        if (is_closed || (Tally::CLOSES && whole >= _views)) report.add(from.leave_pieces(face));
        else from.take_pieces(face, _parts);
        if (is_closed) continue;
        _bounds_before.emplace_back(face, _bounds[face]);
        Bounds &bounds = _bounds[face];
        bounds.bound += more.bound;
        bounds.excess += more.excess;
        const bool is_settled = Tally::CLOSES && whole >= _views && close_bare(face);
        if (!is_settled && (whole != 0 || _parts.pieces.size() > 0 || is_waiting))
            unite_face(face, whole, is_waiting, tally, report);
        bounds.bound = std::min(bounds.bound, _faces.areas[face]);
        bounds.excess = std::min(bounds.excess, _faces.areas[face]);
    }
}

// Adds the parts in `_parts`, and the poses that cover all of a face.
template <class Tally>
void Union::unite_face(int64_t face, int64_t whole, bool is_waiting, Tally tally, Report &report) {
    int64_t n_own = _parts.pieces.size();
    bool has_crowd = false;
    double slivers = 0.0;
    descend(face);
    std::vector<int64_t> &cells = _leaves;
    find_leaves(face, cells);
    while (!cells.empty()) {
        const int64_t n_cells = int64_t(_cells.size());
        double lost = 0.0;
        order_parts();
        int64_t first = 0;
        int64_t n_left = int64_t(_order.size());
        _next.clear();
        for (const int64_t cell : cells) {
            int64_t last = first;
            while (last < int64_t(_order.size()) && _parts.cell[_order[last]] == cell) last++;
            const Rows parts = {_order.data() + first, {last - first}};
            first = last;
            if (divide(cell, parts, lost)) continue;
            if (whole == 0 && !is_waiting && parts.rows() == 0) continue;
            slivers += unite_cell(cell, parts, whole, tally);
            has_crowd = has_crowd || _cells[cell].count > _cells[cell].most;
            const int64_t done = n_left > 0 ? n_own * parts.rows() / n_left : 0;
            report.add(done);
            n_own -= done;
            n_left -= parts.rows();
        }
        add_bound(face, lost);
        cells.resize(_cells.size() - size_t(n_cells));
        std::iota(cells.begin(), cells.end(), n_cells);
        std::swap(_parts, _next);
    }
    add_bound(face, slivers);
    report.add(n_own);
    if (Tally::CLOSES) close_whole(face);
    if (has_crowd) _waiting_next.push_back(face);
}

// Cuts the parts along the lines of the tree, until each is in one cell.
void Union::descend(int64_t face) {
    bool is_cut = _cells[face].half >= 0;
    while (is_cut) {
        is_cut = false;
        double lost = 0.0;
        _next.clear();
        for (int64_t i = 0; i < _parts.pieces.size(); i++) {
            const int64_t cell = _parts.cell[i], half = _cells[cell].half;
            const int64_t tag = _parts.pieces.tag(i);
            if (half < 0) {
                _next.append(_parts.pieces[i], tag, cell, false);
                continue;
            }
            is_cut = true;
            const Divider &line = _dividers[(half - n_faces()) / 2];
            const auto keep = [&](bool is_above) {
                _next.cell.push_back(half + is_above);
                _next.is_old.push_back(false);
            };
            lost +=
                _halver.halve(_parts.pieces[i], tag, line, nearest_of(face), _next.pieces, keep);
        }
        add_bound(face, lost);
        std::swap(_parts, _next);
    }
}

// Sets `_order` to the parts by cell, without new ones in closed cells.
void Union::order_parts() {
    _order.clear();
    for (int64_t i = 0; i < _parts.pieces.size(); i++)
        if (_parts.is_old[i] || !_cells[_parts.cell[i]].is_closed) _order.push_back(i);
    const auto is_less = [&](int64_t a, int64_t b) {
        return std::pair(_parts.cell[a], a) < std::pair(_parts.cell[b], b);
    };
    if (!std::is_sorted(_order.begin(), _order.end(), is_less))
        sort_range(_order.begin(), _order.end(), is_less);
}

// Divides a cell with too many pieces where a line helps, and puts them into `_next`. What that may
// do to their area is added to `lost`.
bool Union::divide(int64_t cell, Rows parts, double &lost) {
    const Cell before = _cells[cell];
    const int64_t count = before.count + parts.rows();
    if (count <= before.most) return false;
    _crowd.clear();
    for (int64_t i = before.first; i < before.first + before.count; i++)
        _crowd.append(_pieces[i], _pieces.tag(i), cell, true);
    for (const int64_t i : parts)
        _crowd.append(_parts.pieces[i], _parts.pieces.tag(i), cell, _parts.is_old[i] != 0);
    Divider line = {};
    const double nearest = nearest_of(before.face);
    if (!find_divider(_crowd.pieces, nearest, line) || !make_halves(cell, line)) {
        change(cell).most = 2 * count; // by then it may have changed
        return false;
    }
    for (int64_t i = 0; i < count; i++) {
        const auto keep = [&](bool is_above) {
            _next.cell.push_back(_cells[cell].half + is_above);
            _next.is_old.push_back(_crowd.is_old[i]);
        };
        lost += _halver.halve(_crowd.pieces[i], _crowd.pieces.tag(i), line, nearest, _next.pieces,
                              keep);
    }
    _n_used -= before.count;
    _cells[cell].count = 0;
    return true;
}

// Makes the halves of a cell; false where they have too many sides, or no area.
bool Union::make_halves(int64_t cell, const Divider &line) {
    const Polygon outline = outline_of(cell);
    if (outline.rows() >= MOST_SIDES) return false;
    PieceList halves;
    std::vector<bool> sides;
    const int32_t face = _cells[cell].face;
    _halver.halve(outline, 0, line, nearest_of(face), halves,
                  [&](bool is_above) { sides.push_back(is_above); });
    if (sides != std::vector<bool>{false, true}) return false;
    expect(_cells.size() < size_t(std::numeric_limits<int32_t>::max() - 2),
           "a union of fewer than 2^31 pieces", _cells.size(),
           "unite fewer poses or faces at once");
    Cell half;
    half.most = _most;
    half.face = face;
    change(cell).half = int32_t(_cells.size());
    for (int64_t side = 0; side < 2; side++) {
        _outlines.append(halves[side], 0);
        _cells.push_back(half);
    }
    _dividers.push_back(line);
    return true;
}

// Sets `_by_area` to the new ones of the parts, large ones first.
void Union::sort_new(Rows parts) {
    _by_area.clear();
    for (const int64_t i : parts)
        if (!_parts.is_old[i]) _by_area.emplace_back(-area_of(_parts.pieces[i]), i);
    const auto is_less = [](const auto &a, const auto &b) { // what is no number last
        if (a.first < b.first || b.first < a.first) return a.first < b.first;
        return std::pair(std::isnan(a.first), a.second) < std::pair(std::isnan(b.first), b.second);
    };
    sort_range(_by_area.begin(), _by_area.end(), is_less);
}

// Adds parts to a cell, and the poses that cover all of it; the area that is left out.
template <class Tally>
double Union::unite_cell(int64_t cell, Rows parts, int64_t whole, Tally tally) {
    const Cell before = _cells[cell];
    if (before.is_closed) return 0.0;
    const auto is_full = [&](int64_t tag) { return tally.is_full(tag); };
    const Polygon all = outline_of(cell);
    const double total = area_of(all), wanted = WHOLE * total, close = nearest_of(before.face);
    _overlay.clear(close);
    for (int64_t i = before.first; i < before.first + before.count; i++)
        _overlay.append(_pieces[i], _pieces[i].rows(), _pieces.tag(i));
    for (const int64_t i : parts)
        if (_parts.is_old[i])
            _overlay.append(_parts.pieces[i], _parts.pieces[i].rows(), _parts.pieces.tag(i));
    _n_pairs += double(before.count + parts.rows()) * double(before.count + parts.rows());
    double slivers = 0.0;
    if (whole != 0) {
        for (int64_t q = 0; q < _overlay.count(); q++)
            _overlay.set_tag(q, tally.plus(_overlay.tag(q), whole));
        if (tally.adds()) slivers += _overlay.fill(all, all.rows(), tally.plus(0, whole));
    }
    // No more than a piece's own area is won by it, so that the sum need not be made each time.
    double most = Tally::CLOSES ? _overlay.area_of(is_full) : 0.0;
    bool is_closed = Tally::CLOSES && most >= wanted;
    Poll poll(8);
    sort_new(parts);
    for (const auto &[_, i] : _by_area) {
        if (is_closed) break;
        poll();
        const Polygon piece = _parts.pieces[i];
        const int64_t n = piece.rows();
        tally.begin(_parts.pieces.tag(i));
        // A corner near a line counts as on it, on either side.
        slivers += _overlay.add(piece, n, tally) +
                   4 * area::SLACK_REL * close * area::perimeter_of(piece, n);
        if (!Tally::CLOSES) continue;
        most += area::twice_area(piece, n) / 2;
        if (most < wanted) continue;
        most = _overlay.area_of(is_full);
        is_closed = most >= wanted;
    }
    if (is_closed) {
        slivers += std::max(total - _overlay.area_of(is_full), 0.0);
        _overlay.clear(close);
        _overlay.append(all, all.rows(), tally.plus(0, _views));
    }
    store(cell);
    _cells[cell].is_closed = is_closed;
    return slivers;
}

// Stores the pieces of the overlay as those of a cell.
void Union::store(int64_t cell) {
    const int64_t first = _pieces.size();
    for (int64_t q = 0; q < _overlay.count(); q++) {
        const int64_t n = _overlay.n_corners(q);
        if (n > 0) _pieces.append({_overlay.corners(q).data, {n, 2}}, _overlay.tag(q));
    }
    Cell &own = change(cell);
    _n_used += _pieces.size() - first - own.count;
    own.first = first;
    own.count = _pieces.size() - first;
}

// Closes a face without pieces, as unite_face does where enough poses cover all of it; false where
// it has some, or may be a sliver.
bool Union::close_bare(int64_t face) {
    if (_cells[face].count > 0 || _cells[face].half >= 0) return false;
    const Polygon all = outline_of(face);
    const double nearest = nearest_of(face);
    std::array<double, 6> corners;
    const bool is_tidy = area::without_needless(all, 3, nearest, {corners.data(), {3, 2}}) == 3;
    if (!is_tidy || !(area_of(all) > nearest * area::perimeter_of(all, 3))) return false;
    Cell &whole = change(face);
    whole.first = _pieces.size();
    whole.count = 1;
    whole.is_closed = true;
    _pieces.append(all, _views);
    _n_used++;
    return true;
}

// Makes a divided face, all cells of which are closed, one cell of one piece again.
void Union::close_whole(int64_t face) {
    if (_cells[face].half < 0) return;
    std::vector<int64_t> leaves;
    find_leaves(face, leaves);
    for (const int64_t leaf : leaves)
        if (!_cells[leaf].is_closed) return;
    for (const int64_t leaf : leaves) {
        Cell &cell = change(leaf);
        _n_used -= cell.count;
        cell.count = 0;
    }
    Cell &whole = change(face);
    whole.first = _pieces.size();
    whole.count = 1;
    whole.half = -1;
    whole.is_closed = true;
    _pieces.append(outline_of(face), _views);
    _n_used++;
}

Polygon Union::outline_of(int64_t cell) const {
    if (cell >= n_faces()) return _outlines[cell - n_faces()];
    return {_faces.corners.data + 6 * cell, {3, 2}};
}

// Least distance of two corners of a face that do not coincide, m.
double Union::nearest_of(int64_t face) const {
    return std::max(area::COINCIDENT_REL * _faces.corners(face, 1, 0), _least);
}

// Sets `found` to the cells of a face that are not divided, in ascending order.
void Union::find_leaves(int64_t face, std::vector<int64_t> &found) const {
    found.assign(1, face);
    for (size_t at = 0; at < found.size();) {
        const int64_t half = _cells[found[at]].half;
        if (half < 0) {
            at++;
            continue;
        }
        found[at] = half;
        found.push_back(half + 1);
    }
    sort_range(found.begin(), found.end());
}

// --- the partition ---

// Calls `each(face, i)` for all pieces, by face and cell.
template <class Each> void Union::each_piece(Each each) const {
    const auto each_of = [&](int64_t face, const Cell &cell) {
        for (int64_t i = cell.first; i < cell.first + cell.count; i++) each(face, i);
    };
    std::vector<int64_t> leaves;
    for (int64_t face = 0; face < n_faces(); face++) {
        const Cell &whole = _cells[face];
        if (whole.half < 0) {
            each_of(face, whole);
            continue;
        }
        find_leaves(face, leaves);
        for (const int64_t leaf : leaves) each_of(face, _cells[leaf]);
    }
}

std::pair<int64_t, int64_t> Union::size() const {
    int64_t corners = 0;
    each_piece([&](int64_t, int64_t i) { corners += _pieces[i].rows(); });
    return {_n_used, corners};
}

void Union::write(area::Points xy, Column<int64_t> starts, Column<int32_t> face,
                  Column<int64_t> tag, Column<double> area) const {
    const auto [n, n_corners] = size();
    require(xy.rows() == n_corners && starts.rows() == n + 1 && have_rows(n, face, tag, area),
            "arrays must have the size of the union");
    int64_t row = 0;
    int64_t at = 0;
    starts[0] = 0;
    each_piece([&](int64_t f, int64_t i) {
        const Polygon piece = _pieces[i];
        area::copy_polygon(piece, piece.rows(), exact::from(xy, at));
        face[row] = int32_t(f);
        tag[row] = _pieces.tag(i);
        area[row] = area_of(piece);
        at += piece.rows();
        row++;
        starts[row] = at;
    });
}

void Union::write_areas(Array<double, Any, Any> out) const {
    require(out.extent(1) == n_faces(), "out must have one column for each face");
    std::fill(out.begin(), out.end(), 0.0);
    each_piece([&](int64_t face, int64_t i) {
        const double area = area_of(_pieces[i]);
        const int64_t n = std::min(_pieces.tag(i), out.rows());
        for (int64_t level = 0; level < n; level++) out(level, face) += area;
    });
}

void Union::write_bounds(Array<double, 2, Any> out) const {
    require(out.extent(1) == n_faces(), "out must have one column for each face");
    for (int64_t f = 0; f < n_faces(); f++) {
        out(0, f) = _bounds[f].bound;
        out(1, f) = _bounds[f].excess;
    }
}

void Union::write_closed(Column<bool> out) const {
    require(out.rows() == n_faces(), "out must have one row for each face");
    for (int64_t f = 0; f < n_faces(); f++) out[f] = _cells[f].is_closed;
}

} // namespace rastercov::engine
