// Rasteriser of one mesh: poses through canvases, shared among threads; counts, images, targets.
//
// A pose runs in one thread from start to end, or in parts where poses are few. Any number of
// threads may use a rasteriser at the same time; each call takes memory of its own.
//
// Twins: tests/raster/test_cpu.py, tests/raster/test_lenses.py.
#pragma once
#include "raster/band.hpp"
#include "raster/clusters.hpp"
#include "raster/targets.hpp"
#include "solver/idle.hpp"
#include "solver/room.hpp"
#include "solver/threads.hpp"

namespace rastercov::raster {

using engine::Room;

// Most samples of a canvas that are in memory at a time.
constexpr int64_t MAX_BAND = 1 << 17;

// A mesh in clusters, which never changes; its vertices are from a centre.
class Scene {
  public:
    Scene(const Points &vertices, const Triples &faces, const Array<const double, 3> &centre,
          bool is_wound)
        : _memory(group_faces(vertices, faces, centre, is_wound)), _n_faces(faces.rows()) {
        std::copy_n(centre.data, 3, _centre);
        set_radius();
    }
    Clusters clusters() const { return _memory.clusters(); }
    int64_t n_faces() const { return _n_faces; }
    const double *centre() const { return _centre; }
    double radius() const { return _radius; } // of a sphere around the centre that has all vertices
    // Other bounds of its clusters, for tests.
    void set_bounds(const Array<const double, BOUNDS_OF_CLUSTER, Any> &bounds);

  private:
    void set_radius();
    ClusterMemory _memory;
    int64_t _n_faces;
    double _centre[3], _radius = 0.0;
};

// Places of samples of a lens in blocks of a pinhole, of which none but `lanes` may be written by
// others; all empty where samples are the centres of a grid. Places of the lanes of all blocks, and
// the lanes of each that count (see Window); bounds of the depth of cells, inf where none counts.
// Of pictures: lanes in rising order, the elements of the image that they are, and X / Z and Y / Z
// of their rays.
struct Scattered {
    Int32Array offsets;
    Column<const uint16_t> used;
    Column<const float> cell_bounds;
    Int32Array lanes, samples;
    Array<const float, Any, 2> places;
};

// Rows of blocks, from the first up to the last.
struct Rows {
    int64_t first, last;
};

// Samples of an image: fx, fy, cx, cy in samples of camera axes whose first two are mixed by `mix`,
// to rotate samples; the samples of each row that count, from the first up to the last. Of parallel
// rays fx and fy are in samples per metre.
struct Grid {
    int64_t width, height;
    Array<const double, 4> lens;
    Array<const double, 2, 2> mix;
    Array<const int32_t, 2, Any> runs;
    bool is_rolled, is_parallel;
};

// Samples of an image in blocks. Its scattered samples are arrays of whoever made it.
class Canvas {
  public:
    Canvas(const Scattered &scattered, const Grid &grid, int64_t max_band);

    int64_t width, height, columns, block_rows; // columns of blocks in memory, rows of a band
    Scattered scattered;
    double lens[4], mix[2][2];
    double magnification[2]; // least and greatest, of a length parallel to the image by its depth
    bool is_rolled, is_parallel;

    bool is_scattered() const { return scattered.offsets.rows() > 0; }
    int64_t n_rows() const { return _inner.size() / 2; }
    Rows part(int64_t k, int64_t n) const { return {n_rows() * k / n, n_rows() * (k + 1) / n}; }
    int64_t n_marks() const { return block_rows * (columns >> STRIP_BITS); }
    int64_t n_cells() const {
        return ((block_rows + SIDE - 1) >> SIDE_BITS) * (columns >> SIDE_BITS);
    }
    // What is drawn of the rows of samples `top` up to `bottom`.
    Window window(int64_t top, int64_t bottom, bool hides_back) const;

  private:
    void check() const;
    Room<int32_t> _first, _last;
    Room<int64_t> _inner; // of each row of blocks those that are wholly inside
};
using Canvases = std::vector<const Canvas *>;

// Poses of V canvases, (V, P): world_from_camera; depths of near planes, and whether back faces are
// hidden, (P,).
struct Looks {
    Array<const double, Any, Any, 4, 4> world_from_camera;
    FloatArray near;
    BoolArray cull;
};
// Samples of each face, and if it is not empty of each face alone, (P, F); samples with a face in
// them, of scattered ones also those that do not count. Whether they are added to what is there.
template <class T> struct Output {
    Array<T, Any, Any> visible, drawn;
    Column<int64_t> filled;
    bool adds;
};

// Takes the counts of a pose while they are in the cache of its thread.
using Take = std::function<void(int64_t, const Counts &)>;

class Worker; // memory of one thread

class Rasterizer {
  public:
    // The scene must outlive it.
    Rasterizer(const Scene &scene, int64_t n_idle);
    ~Rasterizer();

    // Counts poses, the canvases of each in `n_parts` parts.
    template <class T>
    void count(const Canvases &canvases, const Looks &looks, const Output<T> &out, int64_t n_parts,
               int64_t n_threads);
    // Counts poses in memory that threads use again, and hands each over. What is seen from behind
    // and left out is counted as nothing.
    void count_each(const Canvases &canvases, const Looks &looks, int64_t n_threads,
                    const Take &take);
    // Adds the samples of targets, whose corners are from the centre of the scene: those that no
    // face is in front of, and all, (P, N).
    void count_targets(const Canvases &canvases, const Looks &looks, const FloatRows<3, 3> &corners,
                       const Array<int64_t, Any, Any> &visible,
                       const Array<int64_t, Any, Any> &drawn, int64_t n_threads);
    // Images of poses: the nearest face, -1 for none, and its depth in metres, inf for none.
    void render(const Canvas &canvas, const Looks &looks, const Array<int32_t, Any, Any, Any> &face,
                const Array<float, Any, Any, Any> &depth, int64_t n_threads);
    // Writes the samples of a pose that show a face to elements of an image. Their depths are those
    // of the planes of the faces, of these corners, or distances along their rays.
    void render_lanes(const Canvases &canvases, const Looks &looks, const FloatRows<3, 3> &corners,
                      bool by_distance, const Column<int32_t> &face, const Column<float> &depth,
                      int64_t n_threads);

    // Gives memory back; calls after it keep none.
    void close();
    int64_t n_idle() const;

  private:
    using Work = std::function<void(Worker &, int64_t)>;
    void share(int64_t n, int64_t n_threads, const Work &work);

    const Scene &_scene;
    engine::Idle<Worker> _idle;
    engine::Pace _pace;
};

} // namespace rastercov::raster
