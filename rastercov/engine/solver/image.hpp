// Memory for the image of a surface: of its opaque faces, of its targets, and of both together.
//
// Twins: tests/exact/test_targets_exact.py.
#pragma once
#include "exact/passes.hpp"
#include "solver/room.hpp"
#include "solver/surface.hpp"

namespace rastercov::engine {

// Figures of faces, px^2: the area inside the image, the visible part of it, and the bound of the
// errors of both together.
struct Areas {
    Column<double> visible, area, area_error;
};

// Faces that are clipped in space.
struct ClippedRoom {
    Room<double> polygons, lines, planes;
    Room<int32_t> n_corners;

    exact::Clipped take(int64_t n);
};

// What a set-up finds.
struct SetUp {
    int64_t n_live, n_clipped;
};

// Image of one part of a surface, in memory of its own and rows of the memory of all faces.
class PartImage {
  public:
    PartImage() = default;
    PartImage(const Part &part, const exact::Projected &everything, int64_t first_face,
              int64_t first_vertex);

    // Projects and sets up all faces. Out: `extent`, and of `area_error` their rows.
    SetUp set_up(exact::Vertices vertices, const exact::Pinhole &camera, bool front_only,
                 Column<double> area_error, Array<double, 7> extent);
    const exact::Projected &projected() const { return _projected; }
    // Has the areas written to another array from now on.
    void write_to(Column<double> area) { _projected.area = area; }

  private:
    exact::Projected _projected;
    Room<double> _block_box;
    Room<uint16_t> _block_state;
    Room<int8_t> _block_side;
    Room<bool> _has_boxes;
    Room<int32_t> _rest;
    ClippedRoom _clipped;
};

class Image {
  public:
    Image(const Surface &surface, Column<double> area);
    Image(const Image &) = delete;

    // As PartImage, of all faces; targets are seen from both sides.
    SetUp set_up(const Surface &surface, const exact::Pinhole &camera, bool front_only,
                 Column<double> area_error, Array<double, 7> extent);
    void write_to(Column<double> area);

    const exact::Projected &opaque() const { return _opaque.projected(); }
    // The opaque faces and then the targets, without blocks.
    const exact::Projected &everything() const { return _everything; }

  private:
    void join_clipped(int64_t n_opaque, int64_t n_targets);

    int64_t _n_opaque, _n_faces;
    Room<int32_t> _faces, _clipped_index;
    Room<double> _uvw, _box;
    Room<int8_t> _side;
    Room<uint16_t> _state;
    exact::Projected _everything;
    PartImage _opaque, _targets;
    ClippedRoom _clipped;
};

} // namespace rastercov::engine
