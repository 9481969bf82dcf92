// Image of a surface: projection and set-up of its opaque faces and of its targets.
//
// Twins: tests/exact/test_targets_exact.py, tests/exact/test_blocks.py.
#include "solver/image.hpp"
#include <limits>

namespace rastercov::engine {

using exact::CORNERS, exact::SIDES, exact::SPARE_ENTRIES;

constexpr int64_t FIRST_CLIPPED = 8;

exact::Clipped ClippedRoom::take(int64_t n) {
    polygons.take(n * CORNERS * 2);
    n_corners.take(n);
    lines.take(n * SIDES * 5);
    planes.take(n * 7);
    return {polygons.rows<CORNERS, 2>(n), n_corners.all(), lines.rows<SIDES, 5>(n),
            planes.rows<7>(n)};
}

PartImage::PartImage(const Part &part, const exact::Projected &everything, int64_t first_face,
                     int64_t first_vertex)
    : _projected(everything), _block_box(4 * part.blocks.has_flat.rows()),
      _block_state(part.blocks.has_flat.rows()), _block_side(part.blocks.has_flat.rows()),
      _has_boxes(part.blocks.has_flat.rows()), _rest(part.blocks.has_flat.rows()) {
    const int64_t n = part.faces.rows();
    _projected.faces = part.faces;
    _projected.uvw = {everything.uvw.data + 3 * first_vertex, {part.vertices.rows(), 3}};
    _projected.side = {everything.side.data + first_face, {n}};
    _projected.state = {everything.state.data + first_face, {n}};
    _projected.box = {everything.box.data + 6 * first_face, {n, 6}};
    _projected.area = {everything.area.data + first_face, {n}};
    _projected.clipped_index = {everything.clipped_index.data + first_face, {n}};
    _projected.clipped = _clipped.take(first_room(FIRST_CLIPPED));
    _projected.blocks = part.blocks;
    _projected.block_box = _block_box.rows<4>(part.blocks.has_flat.rows());
    _projected.block_state = _block_state.all();
    _projected.block_side = _block_side.all();
    _projected.has_boxes = _has_boxes.all();
}

SetUp PartImage::set_up(exact::Vertices vertices, const exact::Pinhole &camera, bool front_only,
                        Column<double> area_error, Array<double, 7> extent) {
    const int64_t n_out = exact::project(vertices, camera, _projected.uvw);
    const auto [n_plain, n_rest] =
        exact::set_up_plain(camera, front_only, n_out, _projected, area_error, extent, _rest.all());
    while (true) {
        const auto [n_live, n_clipped] = exact::set_up(vertices, _rest.first(n_rest), camera,
                                                       front_only, _projected, area_error, extent);
        if (n_clipped <= _projected.clipped.polygons.rows()) return {n_plain + n_live, n_clipped};
        _projected.clipped = _clipped.take(n_clipped);
    }
}

Image::Image(const Surface &surface, Column<double> area)
    : _n_opaque(surface.n_opaque()), _n_faces(surface.n_faces()), _clipped_index(_n_faces),
      _uvw(3 * (surface.vertices().rows() + surface.targets().vertices.rows() + SPARE_ENTRIES)),
      _box(6 * _n_faces), _side(_n_faces), _state(_n_faces + SPARE_ENTRIES) {
    const Part &opaque = surface.arrays().opaque, &targets = surface.targets();
    const int64_t n_vertices = opaque.vertices.rows();
    _clipped_index.fill(0);
    _everything.faces = surface.faces();
    if (surface.has_targets()) {
        _faces.take(3 * _n_faces);
        std::copy(opaque.faces.begin(), opaque.faces.end(), _faces.data());
        for (int64_t k = 0; k < targets.faces.size(); k++)
            _faces.data()[3 * _n_opaque + k] = targets.faces.data[k] + int32_t(n_vertices);
        _everything.faces = _faces.rows<3>(_n_faces);
    }
    _everything.rank = surface.rank();
    _everything.uvw = _uvw.rows<3>(n_vertices + targets.vertices.rows());
    _everything.side = _side.all();
    _everything.state = _state.first(_n_faces);
    _everything.box = _box.rows<6>(_n_faces);
    _everything.area = area;
    _everything.clipped_index = _clipped_index.all();
    _opaque = PartImage(opaque, _everything, 0, 0);
    if (surface.has_targets()) _targets = PartImage(targets, _everything, _n_opaque, n_vertices);
}

void Image::write_to(Column<double> area) {
    _everything.area = area;
    _opaque.write_to({area.data, {_n_opaque}});
    _targets.write_to({area.data + _n_opaque, {_n_faces - _n_opaque}});
}

SetUp Image::set_up(const Surface &surface, const exact::Pinhole &camera, bool front_only,
                    Column<double> area_error, Array<double, 7> extent) {
    const int64_t n_targets = _n_faces - _n_opaque;
    const SetUp found = _opaque.set_up(surface.vertices(), camera, front_only,
                                       {area_error.data, {_n_opaque}}, extent);
    _everything.clipped = _opaque.projected().clipped;
    if (n_targets == 0) return found;
    double of_targets[7];
    const Column<double> its_error = {area_error.data + _n_opaque, {n_targets}};
    const SetUp beside =
        _targets.set_up(surface.targets().vertices, camera, false, its_error, {of_targets, {7}});
    const exact::Projected &own = _targets.projected();
    for (int64_t f = 0; f < n_targets; f += exact::BLOCK) {
        const auto first = int32_t(f);
        exact::lay_boxes({&first, {1}}, own);
    }
    for (int64_t f = 0; f < n_targets; f++) {
        if (own.state[f] & exact::CLIPPED) own.clipped_index[f] += int32_t(found.n_clipped);
        own.state[f] |= exact::TRANSPARENT;
    }
    join_clipped(found.n_clipped, beside.n_clipped);
    return found;
}

void Image::join_clipped(int64_t n_opaque, int64_t n_targets) {
    const exact::Clipped one = _opaque.projected().clipped, other = _targets.projected().clipped;
    const exact::Clipped both = _clipped.take(n_opaque + n_targets);
    const auto join = [&](const auto &from, const auto &beside, const auto &to) {
        if (to.size() == 0) return;
        const int64_t width = to.size() / to.rows();
        std::copy_n(beside.data, n_targets * width,
                    std::copy_n(from.data, n_opaque * width, to.data));
    };
    join(one.polygons, other.polygons, both.polygons);
    join(one.n_corners, other.n_corners, both.n_corners);
    join(one.lines, other.lines, both.lines);
    join(one.planes, other.planes, both.planes);
    _everything.clipped = both;
}

} // namespace rastercov::engine
