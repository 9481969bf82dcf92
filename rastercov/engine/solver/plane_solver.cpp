// Passes over a pose: half planes, certificate, targets.
//
// A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
//
// Twins: tests/exact/test_exactness.py, tests/exact/test_certificate.py.
#include "solver/plane_solver.hpp"
#include "exact/clipping.hpp"
#include "exact/intersection.hpp"
#include "vector.hpp"
#include <cmath>
#include <tuple>

namespace rastercov::engine {

using exact::CORNERS, exact::LIVE, exact::PIECE_ROOM, exact::Projected, exact::SIDES,
    exact::STACK_ROOM, exact::THIN, exact::UNIT_ROUNDING;

namespace {
// Area tolerance when a region's largest face is classified as wholly visible or wholly hidden,
// relative to that face. A partial result means that an event edge was missed; the whole region is
// then computed face by face.
constexpr double CERTAIN_AREA_REL = 1e-6;
// Cells of the grid for each event edge from which on faces are listed only where they run.
constexpr int64_t CELLS_PER_EVENT = 1;
// Share of the cells around event edges above which faces are listed in all.
constexpr double MOST_ASKED = 0.5;
// Distance up to which an edge that passes a face counts as crossing it, and width below which
// rounding may decide on which side of a face an edge runs, relative to the scale of positions.
constexpr double CROSSING_TOLERANCE_REL = 1e-9, THIN_TOLERANCE_REL = 1e-8;
// Visible parts of an event edge in a cell that are kept apart.
constexpr int64_t MOST_RANGES = 16;
constexpr int64_t FIRST_PIECES = 64;
constexpr int64_t FIRST_KEPT = 4096;
constexpr int64_t FIRST_KEPT_CORNERS = 32768;
constexpr int64_t FIRST_CROSSINGS = 1024;
constexpr int64_t EDGES_A_CROSSING = 16;
} // namespace

PlaneSolver::PlaneSolver(Handle surface, bool is_certifying, bool keeps_pieces)
    : _surface(std::move(surface)), _is_certifying(is_certifying), _n_opaque(_surface->n_opaque()),
      _n_faces(_surface->n_faces()),
      _own{Room<double>(_n_faces), Room<double>(_n_faces), Room<double>(_n_faces)},
      _areas{_own[0].all(), _own[1].all(), _own[2].all()}, _image(*_surface, _areas.area),
      _grid(_n_opaque), _is_certified(_n_faces), _is_event(_surface->edges().kind.rows()),
      _marks(_n_opaque + 1), _chosen(_n_faces) {
    _is_certified.fill(false);
    _marks.fill(0);
    make_scratch(keeps_pieces);
    if (is_certifying) make_certificate();
}

void PlaneSolver::make_scratch(bool keeps_pieces) {
    _target.take(4 * CORNERS);
    _own_lines.take(5 * SIDES);
    _corners.take(2 * CORNERS);
    _lines.take(5 * (SIDES + 1));
    _spare.take(2 * PIECE_ROOM);
    _other.take(2 * PIECE_ROOM);
    _values.take(PIECE_ROOM);
    _ranges.take(2 * MOST_RANGES);
    _cell.take(20);
    _parts.take(STACK_ROOM * 2 * CORNERS * 2);
    _part_counts.take(STACK_ROOM);
    _levels.take(STACK_ROOM);
    _intersections.take(7 * exact::MOST_INTERSECTIONS);
    _work = {_target.rows<2>(2 * CORNERS),
             _own_lines.rows<5>(SIDES),
             _corners.rows<2>(CORNERS),
             _lines.rows<5>(SIDES + 1),
             _spare.rows<2>(PIECE_ROOM),
             _other.rows<2>(PIECE_ROOM),
             _values.all(),
             _ranges.rows<2>(MOST_RANGES),
             {_cell.data(), {4, 5}},
             {{_parts.data(), {STACK_ROOM, 2 * CORNERS, 2}}, _part_counts.all()},
             _levels.all(),
             _intersections.rows<7>(exact::MOST_INTERSECTIONS),
             {},
             {&_counts.n_compared, {1}}};
    make_pieces(first_room(FIRST_PIECES));
    if (keeps_pieces) make_kept(first_room(FIRST_KEPT), first_room(FIRST_KEPT_CORNERS));
    else make_kept(0, 0);
}

void PlaneSolver::make_certificate() {
    const int64_t n_edges = _surface->edges().kind.rows();
    const int64_t n_nodes = _surface->blocks().lowest.rows() + _n_opaque;
    _events.take(n_edges);
    _is_hidden.take(n_edges);
    _is_at_event.take(_surface->vertices().rows());
    _targets.take(_n_opaque);
    _parent.take(n_nodes);
    _region.take(n_nodes);
    _left.take(_n_opaque);
    _decision.take(_n_opaque);
    _last.take(_n_opaque);
    _last.fill(-1);
    make_crossings(first_room(std::max(FIRST_CROSSINGS, n_edges / EDGES_A_CROSSING)));
}

void PlaneSolver::make_pieces(int64_t n) {
    _piece_corners.take(n * PIECE_ROOM * 2);
    _piece_counts.take(n);
    _pieces = {{_piece_corners.data(), {n, PIECE_ROOM, 2}}, _piece_counts.all()};
}

void PlaneSolver::make_kept(int64_t n, int64_t corners) {
    _kept_corners.take(2 * corners);
    _kept_starts.take(n + 1);
    _kept_starts.fill(0);
    _kept_faces.take(n);
    _work.kept = {
        _kept_corners.rows<2>(corners), _kept_starts.all(), _kept_faces.all(), {_kept_used, {3}}};
}

void PlaneSolver::make_crossings(int64_t n) {
    _before.take(n);
    _edge.take(n);
    _number.take(n);
    _crossing_segments.take(7 * n);
    _crossings = {
        _last.all(),     _before.all(), _edge.all(), _number.all(), _crossing_segments.rows<7>(n),
        _is_hidden.all()};
}

// Makes twice the room for pieces that are kept, if there was too little; true if so.
bool PlaneSolver::grow_kept() {
    if (!_kept_used[2]) return false;
    const int64_t n = _kept_faces.size(), corners = _kept_corners.size() / 2;
    const int64_t n_used = std::min(n, _kept_used[0]);
    _kept_corners.grow(4 * corners, 2 * std::min(corners, _kept_used[1]));
    _kept_faces.grow(2 * n, n_used);
    Room<int64_t> starts(2 * n + 1);
    starts.fill(0);
    std::copy_n(_kept_starts.data(), n_used + 1, starts.data());
    _kept_starts = std::move(starts);
    _kept_used[2] = 0;
    _work.kept = {_kept_corners.rows<2>(2 * corners),
                  _kept_starts.all(),
                  _kept_faces.all(),
                  {_kept_used, {3}}};
    _has_grown = true;
    return true;
}

void PlaneSolver::leave_out(BoolArray faces) {
    _leaves_out = faces.rows() > 0;
    if (!_leaves_out) return;
    require(faces.rows() <= _n_faces, "faces to leave out must be of the mesh");
    _left_out.take(_n_faces);
    _left_out.fill(false);
    const auto &place = _surface->place();
    for (int64_t f = 0; f < faces.rows(); f++)
        _left_out.data()[place.rows() ? place[f] : f] = faces[f];
}

void PlaneSolver::write_to(const Areas *out) {
    _areas = out ? *out : Areas{_own[0].all(), _own[1].all(), _own[2].all()};
    _image.write_to(_areas.area);
}

// --- pose ---

void PlaneSolver::set_camera(const Lens &of) {
    // Off the axis, rounding of z moves a point in proportion to its distance from the axis.
    const double across = std::max(of.cx, of.width - of.cx);
    const double down = std::max(of.cy, of.height - of.cy);
    const double steep = std::max({of.width * of.width / of.fx, of.height * of.height / of.fy,
                                   across * across / of.fx, down * down / of.fy});
    _scale = std::max({of.width, of.height, of.fx, of.fy, std::abs(of.cx), std::abs(of.cy), steep});
    const double x = 1.5 * across / of.fx, y = 1.5 * down / of.fy;
    const double longest_ray = std::sqrt(1.0 + x * x + y * y);
    const double us[5] = {0, of.width, of.width, 0, 0}, vs[5] = {0, 0, of.height, of.height, 0};
    for (int k = 0; k < 4; k++) {
        double *const line = _border + 5 * k;
        line[0] = us[k];
        line[1] = vs[k];
        line[2] = us[k + 1] - us[k];
        line[3] = vs[k + 1] - vs[k];
        line[4] = 0;
    }
    const double margin = exact::CLIP_MARGIN;
    _camera = {{_rotation, {3, 3}},
               {_centre, {3}},
               1.0,
               of.fx,
               of.fy,
               of.cx,
               of.cy,
               of.width,
               of.height,
               -margin * of.width - 1,
               (1 + margin) * of.width + 1,
               -margin * of.height - 1,
               (1 + margin) * of.height + 1,
               longest_ray,
               UNIT_ROUNDING * _scale,
               UNIT_ROUNDING * (longest_ray / 2),
               {_border, {4, 5}},
               0.0};
}

Box box_of(const Surface &surface) {
    Box box = surface.bounds();
    const exact::Vertices targets = surface.targets().vertices;
    for (int64_t v = 0; v < targets.rows(); v++)
        for (size_t k = 0; k < 3; k++) {
            box[0][k] = std::min(box[0][k], targets(v, int64_t(k)));
            box[1][k] = std::max(box[1][k], targets(v, int64_t(k)));
        }
    return box;
}

Extent extent_along(const Box &opaque, const Box &box, const Pose &pose) {
    Extent extent = {INFINITY, -INFINITY, 0.0, length(minus(opaque[1], opaque[0]))};
    for (unsigned corner = 0; corner < 8; corner++) {
        double depth = 0.0;
        double square = 0.0;
        for (int k = 0; k < 3; k++) {
            const double at = box[corner >> k & 1][size_t(k)] - pose.centre[k];
            depth += at * pose.at(k, 2);
            square += at * at;
        }
        extent.least = std::min(extent.least, depth);
        extent.most = std::max(extent.most, depth);
        extent.reach = std::max(extent.reach, std::sqrt(square));
    }
    extent.size = std::max(extent.size, extent.most - extent.least);
    if (!(extent.size > 0)) extent.size = 1.0;
    return extent;
}

// Makes the rays of the camera parallel. A position is a sum of products of three differences; w is
// at least the size of the surface.
void PlaneSolver::set_parallel(const Pose &pose, double near) {
    const Extent extent = extent_along(_surface->bounds(), box_of(*_surface), pose);
    const double focal = std::max(_camera.fx, _camera.fy);
    _scale = std::max({_camera.width, _camera.height, std::abs(_camera.cx), std::abs(_camera.cy),
                       focal * extent.reach});
    _distance = extent.distance(near);
    _camera.pixel_error = UNIT_ROUNDING * _scale;
    _camera.farthest = extent.farthest(near);
    _camera.w_error_rel = UNIT_ROUNDING * ((extent.reach + _camera.farthest) / extent.size);
}

void PlaneSolver::set_pose(const Lens &pinhole, const Pose &pose, double near, bool front_only,
                           bool is_parallel) {
    require(near > 0 && near < INFINITY, "near must be positive and finite");
    set_camera(pinhole);
    std::copy_n(pose.rotation, 9, _rotation);
    std::copy_n(pose.centre, 3, _centre);
    _camera.near = near;
    if (is_parallel) set_parallel(pose, near);
    _front_only = front_only;
    set_up();
}

void PlaneSolver::set_up() {
    const SetUp found =
        _image.set_up(*_surface, _camera, _front_only, _areas.area_error, extent7());
    _counts = {};
    _counts.n_clipped = found.n_clipped;
    std::fill_n(_kept_used, 3, 0);
    _grid.lay(found.n_live, _extent);
    _is_listed = false;
}

void PlaneSolver::solve_all() {
    // The grid remembers what hides a face, and a face that is measured again finds it there: a
    // pose whose scratch memory grew is done again, as one that had enough from the start.
    do {
        if (_has_grown) set_up();
        _has_grown = false;
        if (_is_certifying) certify();
        else measure_all();
    } while (_has_grown);
}

void PlaneSolver::measure_all() {
    const auto &state = _image.opaque().state;
    std::fill(_areas.visible.begin(), _areas.visible.end(), 0.0);
    int64_t n = 0;
    for (int64_t f = 0; f < _n_opaque; f++)
        if (state[f] & (LIVE | THIN)) _chosen.data()[n++] = int32_t(f);
    solve(_chosen.first(measure(_chosen.first(n), _chosen.data())));
    solve_targets();
}

void PlaneSolver::solve(Int32Array faces) {
    if (faces.rows() == 0) return;
    if (!_is_listed) {
        exact::ask_for_all(_grid.grid());
        list_faces();
    }
    run(faces, _image.opaque());
}

// Copies those of some opaque faces that are not left out; returns their number.
int64_t PlaneSolver::measure(Int32Array faces, int32_t *out) {
    int64_t n = 0;
    for (const int32_t f : faces) {
        if (_leaves_out && _left_out.data()[f] && _image.opaque().state[f] & LIVE) {
            _areas.visible[f] = 0.0;
            _areas.area_error[f] += _areas.area[f];
        } else {
            out[n++] = f;
        }
    }
    return n;
}

// Computes some faces, with more scratch memory as they need it.
void PlaneSolver::run(Int32Array faces, const Projected &projected) {
    int64_t done = 0;
    while (true) {
        done = exact::visible_areas(faces, done, _surface->vertices(), view(projected),
                                    _marks.all(), _pieces);
        if (done == faces.rows()) break;
        if (!grow_kept()) make_pieces(2 * _piece_counts.size());
        _has_grown = true;
    }
    limit_errors(faces);
}

// No area exceeds the image; a face that rounds to a point may be some roundings wide.
void PlaneSolver::limit_errors(const Int32Array &faces) {
    const double error = _camera.pixel_error;
    const double least = exact::OUTLINE_ERROR_FACTOR * 2 * (error * error);
    const double most = 2 * (_camera.width * _camera.height);
    for (const int32_t f : faces)
        _areas.area_error[f] = std::min(std::max(_areas.area_error[f], least), most);
}

void PlaneSolver::list_faces() {
    _grid.list(_image.opaque());
    _is_listed = true;
}

// Computes all targets from the opaque faces in the cells that they touch. Last, so that nothing
// they leave in the grid changes the figures of opaque faces.
void PlaneSolver::solve_targets() {
    const Projected &all = _image.everything();
    int64_t n = 0;
    for (int64_t f = _n_opaque; f < _n_faces; f++)
        if (all.state[f] & (LIVE | THIN)) _chosen.data()[n++] = int32_t(f);
    if (n == 0) return;
    if (exact::ask_for_faces(_chosen.first(n), all.box, _grid.grid()) || !_is_listed) list_faces();
    // Cells asked for so far are listed; others may have to be.
    _is_listed = _grid.is_whole();
    run(_chosen.first(n), all);
}

exact::View PlaneSolver::view(const Projected &projected) const {
    return {_camera,         projected, _grid.grid(),   _surface->edges(),
            _is_event.all(), _work,     _areas.visible, _areas.area_error};
}

// --- certificate ---

void PlaneSolver::certify() {
    const Column<bool> is_certified = _is_certified.first(_n_opaque);
    const bool *const left_out = _left_out.data();
    if (_leaves_out && std::find(left_out, left_out + _n_opaque, false) == left_out + _n_opaque) {
        std::fill(is_certified.begin(), is_certified.end(), false);
        measure_all();
        return;
    }
    std::fill(_areas.visible.begin() + _n_opaque, _areas.visible.end(), 0.0);
    if (!_camera.is_parallel()) {
        const auto &middle = _surface->centre();
        _distance =
            std::hypot(_centre[0] - middle[0], _centre[1] - middle[1], _centre[2] - middle[2]) +
            _surface->diagonal() / 2;
    }
    const Contacts &contacts = _surface->contacts(_distance);
    const Projected &projected = _image.opaque();
    _counts.n_events =
        exact::find_event_edges(_surface->edges(), projected, _is_event.all(), _events.all());
    const Int32Array events = _events.first(_counts.n_events);
    exact::mark_uncertifiable(events, _surface->edges(), projected, contacts.faces.rows(),
                              contacts.blocks.rows(), contacts.starts.rows(),
                              THIN_TOLERANCE_REL * _scale, _is_at_event.all());
    list_around(events);
    find_crossings(events);
    std::tie(_counts.n_crossed, _counts.n_regions) = exact::find_regions(
        events, _is_hidden.all(), view(projected), _parent.all(), _region.all(), _targets.all());
    const int64_t n_crossed = _counts.n_crossed, n_regions = _counts.n_regions;
    const Int32Array largest = {_targets.data() + n_crossed, {n_regions}};
    const int64_t n_asked = measure(_targets.first(n_crossed), _chosen.data());
    std::copy(largest.begin(), largest.end(), _chosen.data() + n_asked);
    const int64_t n_left = divide_crossed(_chosen.first(n_asked + n_regions),
                                          {contacts.starts.rows(), contacts.partners.rows()});
    for (const int32_t f : _left.first(n_left))
        _counts.n_left += (projected.state[f] & exact::CROSSED) != 0;
    solve(_left.first(n_left));
    const int64_t n_doubtful = exact::classify_regions(projected, _areas.visible, _region.all(),
                                                       largest, _decision.first(n_regions),
                                                       is_certified, _left.all(), CERTAIN_AREA_REL);
    _counts.n_doubtful = n_doubtful;
    _is_listed = n_doubtful == 0;
    solve(_left.first(measure(_left.first(n_doubtful), _left.data())));
    solve_targets();
}

double PlaneSolver::crossing_tolerance() const { return CROSSING_TOLERANCE_REL * _scale; }

// Lists the faces in the cells around event edges, or in all cells if these are not few.
void PlaneSolver::list_around(Int32Array events) {
    const bool are_few =
        _counts.n_clipped == 0 && CELLS_PER_EVENT * events.rows() <= _grid.n_cells();
    if (!are_few ||
        !exact::ask_for_events(events, _surface->edges(), _surface->vertices(), _camera,
                               _image.opaque(), crossing_tolerance(), _grid.grid(), segment()) ||
        double(_grid.n_asked()) > MOST_ASKED * double(_grid.n_cells()))
        exact::ask_for_all(_grid.grid());
    list_faces();
}

void PlaneSolver::find_crossings(Int32Array events) {
    if (_has_crossings) _last.fill(-1); // a pose was left before its end
    _has_crossings = true;
    while (true) {
        const int64_t n =
            exact::mark_crossed(events, _surface->vertices(), view(_image.opaque()), extent7(),
                                crossing_tolerance(), _counts.n_clipped, segment(), _crossings);
        if (n <= _crossings.edge.rows()) return;
        _last.fill(-1);
        make_crossings(2 * n);
        _has_grown = true;
    }
}

// Computes crossed faces, and those that decide over their regions, by the cells of their
// crossings; returns how many are left to half planes.
int64_t PlaneSolver::divide_crossed(Int32Array faces, const exact::Partners &partners) {
    const Projected &projected = _image.opaque();
    exact::lay_boxes(faces, projected);
    if (exact::ask_for_faces(faces, projected.box, _grid.grid())) list_faces();
    if (_piece_counts.size() < exact::MOST_CELLS) make_pieces(exact::MOST_CELLS);
    int64_t n_left;
    while (true) {
        n_left = exact::arrangement_areas(faces, _crossings, partners, view(projected), _pieces,
                                          _left.all());
        if (!grow_kept()) break;
        std::fill_n(_kept_used, 3, 0);
    }
    // The next pose starts without crossings; only faces among the targets have any.
    for (const int32_t f : _targets.first(_counts.n_crossed + _counts.n_regions))
        _last.data()[f] = -1;
    _has_crossings = false;
    limit_errors(faces);
    return n_left;
}

} // namespace rastercov::engine
