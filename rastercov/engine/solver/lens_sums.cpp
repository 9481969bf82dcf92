// Sums of areas over the ideal planes of a lens.
//
// Twins: tests/exact/test_lens_solver.py.
#include "solver/lens_sums.hpp"
#include "lens/polygons.hpp"
#include <cmath>

namespace rastercov::engine {

namespace {
// Distance of a surface from the side of a plane's image, relative to its own, that is no rounding.
constexpr double BESIDE_REL = 1e-9;
constexpr int64_t FIRST_FOUND = 1024, FIRST_CORNERS = 8192;

// Edge e from each corner of a face to the next, ~e where it runs backwards.
void direct_sides(const Surface &surface, int32_t *out) {
    const auto &faces = surface.faces();
    const exact::Edges &edges = surface.edges();
    for (int64_t f = 0; f < faces.rows(); f++)
        for (int s = 0; s < 3; s++) {
            const int32_t e = edges.of_face(f, s);
            *out++ = edges.vertices(e, 0) == faces(f, s) ? e : ~e;
        }
}

int64_t n_vertices_of(const Surface &surface) {
    return surface.vertices().rows() + surface.targets().vertices.rows();
}
} // namespace

LensSums::LensSums(const Surface &surface)
    : _own{Room<double>(surface.n_faces()), Room<double>(surface.n_faces()),
           Room<double>(surface.n_faces())},
      _places(4 * surface.vertices().rows()), _bulge(surface.edges().kind.rows()),
      _drawn(surface.n_faces()), _images(2 * first_room(FIRST_FOUND)),
      _counts{Room<int8_t>(surface.n_faces()), Room<int8_t>(surface.n_faces()),
              Room<int8_t>(surface.n_faces())},
      _is_certified(surface.n_faces()), _is_inside(surface.vertices().rows()),
      _is_done(surface.n_faces()), _sides(3 * surface.n_opaque()),
      _longer(surface.edges().kind.rows()) {
    _is_certified.fill(false);
    direct_sides(surface, _sides.data());
    make_found(first_room(FIRST_FOUND), first_room(FIRST_CORNERS));
    begin(nullptr);
    set_surface(surface);
}

void LensSums::set_surface(const Surface &surface) {
    _surface = &surface;
    _vertices.take(3 * n_vertices_of(surface));
    const auto &opaque = surface.vertices(), &targets = surface.targets().vertices;
    std::copy(targets.begin(), targets.end(),
              std::copy(opaque.begin(), opaque.end(), _vertices.data()));
    Range along[3];
    for (int64_t k = 0; k < _vertices.size(); k++) along[k % 3].add(_vertices.data()[k]);
    for (int corner = 0; corner < 8; corner++) {
        _box[3 * corner] = corner >> 1 & 1 ? along[0].most : along[0].least;
        _box[3 * corner + 1] = corner >> 2 & 1 ? along[1].most : along[1].least;
        _box[3 * corner + 2] = corner & 1 ? along[2].most : along[2].least;
    }
}

void LensSums::begin(const Areas *out) {
    const Areas own = {_own[0].all(), _own[1].all(), _own[2].all()};
    const Areas &areas = out ? *out : own;
    _sums = {areas.area,       areas.visible,    areas.area_error,
             _counts[0].all(), _counts[1].all(), _counts[2].all()};
    for (const auto &array : {areas.area, areas.visible, areas.area_error})
        std::fill(array.begin(), array.end(), 0.0);
    for (Room<int8_t> &each : _counts) each.fill(0);
}

bool LensSums::may_see(const IdealPlane &plane, const Pose &pose, bool is_parallel) const {
    if (plane.record.window.rows() == 0) return false;
    if (is_parallel) return true;
    const Lens &of = plane.pinhole;
    const double left = -of.cx / of.fx, top = -of.cy / of.fy;
    const double right = left + of.width / of.fx, bottom = top + of.height / of.fy;
    // Inner normals of the plane, and of the four sides of its image, in units of it.
    const double sides[5][3] = {
        {0, 0, 1}, {1, 0, -left}, {-1, 0, right}, {0, 1, -top}, {0, -1, bottom}};
    double normals[15], steepest = 0.0;
    for (int s = 0; s < 5; s++)
        for (int i = 0; i < 3; i++) {
            double total = 0.0;
            for (int k = 0; k < 3; k++) total += sides[s][k] * pose.at(i, k);
            normals[3 * s + i] = total;
        }
    for (int s = 1; s < 5; s++) steepest = std::max(steepest, std::abs(sides[s][2]));
    const double margin = BESIDE_REL * (1 + steepest);
    // A box decides in most cases.
    const auto is_beside = [&](exact::Vertices points) {
        return exact::are_beyond(points, {pose.centre, {3}}, {normals, {5, 3}}, margin);
    };
    return !is_beside({_box, {8, 3}}) && !is_beside(_vertices.rows<3>(_vertices.size() / 3));
}

void LensSums::add(const IdealPlane &plane, const PlaneSolver &solved) {
    const lens::PlaneRecord &record = plane.record;
    const exact::Projected &projected = solved.image().everything();
    const int64_t n_vertices = _is_inside.size();
    const auto places = _places.rows<4>(n_vertices);
    const auto &ends = _surface->edges().vertices;
    exact::vertex_images({projected.uvw.data, {n_vertices, 3}}, record, places, _is_inside.all());
    const int64_t n_longer = exact::edge_bulges(record, ends, places, _bulge.all(), _longer.all());
    if (n_longer)
        lens::bulges_by_parts(record, _longer.first(n_longer), ends, places, _bulge.all());
    exact::measure_simple(projected, _sides.rows<3>(_surface->n_opaque()), places, _bulge.all(),
                          record, _drawn.all(), _is_done.all(), _sums);
    int64_t n_outlines;
    while (true) {
        n_outlines = exact::collect(_vertices.rows<3>(_vertices.size() / 3), _is_done.all(),
                                    projected, solved.kept(), solved.camera(), record, _found);
        if (!_found_used[2]) break;
        make_found(more_room(_found_used[0]), more_room(_found_used[1]));
    }
    const int64_t n = _found_used[0];
    if (_images.size() < 2 * n) _images.take(2 * more_room(n));
    lens::measure_polygons(record, _found.corners, _found.starts, {_images.data(), {n, 2}});
    exact::add_images(_found, n_outlines, _images.rows<2>(n), record, _drawn.all(), _sums);
    exact::add_figures(projected.state, solved.kept(), solved.areas().visible,
                       solved.areas().area_error, solved.is_certified(), record.stretch,
                       _drawn.all(), _sums);
}

void LensSums::end(const Lens &image) {
    exact::settle(_sums, 2.0 * image.width * image.height, _is_certified.all());
}

void LensSums::make_found(int64_t n, int64_t corners) {
    _found_corners.take(2 * corners);
    _found_starts.take(n + 1);
    _found_starts.fill(0);
    _found_faces.take(n);
    _found = {_found_corners.rows<2>(corners),
              _found_starts.all(),
              _found_faces.all(),
              {_found_used, {3}}};
}

} // namespace rastercov::engine
