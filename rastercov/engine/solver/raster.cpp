// CPU rasteriser: samples of each face in the images of pinholes; loops over poses and bands.
//
// rastercov.core.raster.cpu has the stages in a table, and their files.
//
// Invariants: every sample belongs to exactly one of two faces that share an edge; results depend
// neither on the number of threads, nor on the bands, nor on what was counted before.
//
// Twin: rastercov.reference.samples.
#include "solver/raster.hpp"
#include <cmath>
#include <tuple>

namespace rastercov::raster {

namespace {
// Seconds a face, of a first pose: by it the first call has threads.
constexpr double FIRST_PACE = 5e-9;

template <class T, int64_t... E> Column<T> row_of(const Array<T, Any, Any> &array, int64_t i) {
    return array.rows() ? array[i] : Column<T>{};
}
} // namespace

void Scene::set_bounds(const Array<const double, BOUNDS_OF_CLUSTER, Any> &bounds) {
    require(bounds.extent(1) == _memory.stride, "bounds must have one column for each cluster");
    std::copy(bounds.begin(), bounds.end(), _memory.bounds.all.begin());
}

void Scene::set_radius() {
    const Clusters of = clusters();
    for (int64_t k = 0; k < of.n; k++) {
        double square = 0.0;
        for (int axis = 0; axis < 3; axis++)
            square += of.bounds(CENTRE + axis, k) * of.bounds(CENTRE + axis, k);
        _radius = std::max(_radius, std::sqrt(square) + of.bounds(RADIUS, k));
    }
}

// --- canvas ---

Canvas::Canvas(const Scattered &scattered, const Grid &grid, int64_t max_band)
    : width(grid.width), height(grid.height), scattered(scattered), is_rolled(grid.is_rolled),
      is_parallel(grid.is_parallel) {
    const auto &lens = grid.lens;
    const auto &mix = grid.mix;
    const auto &runs = grid.runs;
    require(width > 0 && width <= MAX_SIDE && height > 0 && height <= MAX_SIDE,
            "width and height must be from 1 to 2^21");
    require(runs.extent(1) == height, "runs must have one column for each row of samples");
    std::copy_n(lens.data, 4, this->lens);
    std::copy_n(mix.data, 4, this->mix[0]);
    constexpr int64_t STRIP = SIDE << STRIP_BITS;
    const int64_t n_strips = (width + STRIP - 1) / STRIP, n = (height + SIDE - 1) / SIDE;
    columns = n_strips << STRIP_BITS;
    block_rows = std::max(max_band / (n_strips * STRIP * SIDE), int64_t(is_scattered() ? SIDE : 1));
    block_rows = std::min(block_rows, n);
    if (n > block_rows && block_rows > SIDE) block_rows -= block_rows % SIDE; // whole cells
    _first.take(height);
    _last.take(height);
    _inner.take(2 * n);
    std::copy_n(runs[0].data, height, _first.data());
    std::copy_n(runs[1].data, height, _last.data());
    for (int64_t row = 0; row < n; row++) {
        int32_t first = 0;
        int32_t last = height < SIDE * (row + 1) ? 0 : INT32_MAX;
        for (int64_t y = SIDE * row; y < std::min(height, SIDE * (row + 1)); y++) {
            first = std::max(first, _first[y]);
            last = std::min(last, _last[y]);
        }
        _inner[2 * row] = (int64_t(first) + SIDE - 1) >> SIDE_BITS;
        _inner[2 * row + 1] = last >> SIDE_BITS;
    }
    magnification[0] = std::min(lens[0], lens[1]);
    magnification[1] = std::max(lens[0], lens[1]);
    check();
}

void Canvas::check() const {
    const auto &[offsets, used, cell_bounds, lanes, samples, places] = scattered;
    require(have_rows(lanes.rows(), samples, places) && lanes.rows() <= INT32_MAX,
            "lanes, samples and places must be as long as one another");
    if (!is_scattered()) return;
    require(!is_rolled && width % (SIDE * SIDE) == 0 && height % (SIDE * SIDE) == 0,
            "a canvas of scattered samples must be whole cells, and not rolled");
    const int64_t n_blocks = n_rows() * columns;
    require(offsets.rows() == n_blocks * LANES && used.rows() == n_blocks &&
                cell_bounds.rows() == n_blocks / LANES,
            "offsets, used and cell_bounds must be of all of the canvas");
}

Window Canvas::window(int64_t top, int64_t bottom, bool hides_back) const {
    Window window = {int(width - 1),
                     int(top),
                     int(bottom - 1),
                     hides_back,
                     int(columns),
                     int(height),
                     is_rolled ? 0 : int(width >> SIDE_BITS),
                     is_rolled ? 0 : int(height >> SIDE_BITS),
                     _inner.rows<2>(n_rows()),
                     _first.all(),
                     _last.all()};
    if (is_scattered()) {
        const int64_t n = ((bottom - top + SIDE - 1) >> SIDE_BITS) * columns * LANES;
        window.offsets = raster::part(scattered.offsets, (top >> SIDE_BITS) * columns * LANES, n);
    }
    return window;
}

// --- one thread ---

namespace {
struct Look {
    Array<const double, 4, 4> pose;
    double near;
    bool cull;
};
Look look_of(const Looks &looks, int64_t view, int64_t pose) {
    return {looks.world_from_camera[view][pose], looks.near[pose], looks.cull[pose]};
}
// Rows of samples of a band.
struct Band {
    int64_t top, bottom;
};
constexpr auto ALL = [](const Band &) { return true; };
} // namespace

class Worker {
  public:
    explicit Worker(const Scene &scene)
        : _scene(scene), _clusters(scene.clusters()), _memory(_clusters.stride),
          _radius(scene.radius()) {}

    // Counts of faces that a call works in, or does not want.
    Column<int32_t> counts(int k) {
        if (_counts[k].size() == 0) _counts[k].take(_scene.n_faces());
        _counts[k].fill(0);
        return _counts[k].all();
    }

    // Sets the camera of a pose: world_from_camera by rows, from the centre of the scene.
    void set_camera(const Canvas &canvas, const Look &look) {
        Camera &camera = _memory.scratch->camera;
        const auto &[pose, near, _] = look;
        for (int i = 0; i < 3; i++) {
            for (int k = 0; k < 3; k++)
                camera.axes[3 * i + k] =
                    canvas.is_rolled && k < 2
                        ? canvas.mix[k][0] * pose(i, 0) + canvas.mix[k][1] * pose(i, 1)
                        : pose(i, k);
            camera.eye[i] = pose(i, 3) - _scene.centre()[i];
        }
        const auto &lens = canvas.lens;
        camera.fx = lens[0];
        camera.fy = lens[1];
        camera.cx = lens[2];
        camera.cy = lens[3];
        const int shift = canvas.is_scattered() ? FINE_STEP_BITS - STEP_BITS : 0;
        camera.near = near;
        camera.farthest = canvas.is_parallel ? farthest_of(look) : 0.0;
        camera.magnification = canvas.magnification[1] * (1 << shift); // of the guard band
    }
    // Faces as that pose sees them.
    View view(const Canvas &canvas, const FloatRows<3, 3> &corners) const {
        const Camera &camera = _memory.scratch->camera;
        const double farthest = camera.farthest;
        const double near = camera.is_parallel() ? 1.0 / (farthest - camera.near) : camera.near;
        return {corners, {camera.axes, {}}, {camera.eye, {}}, {canvas.lens, {}}, near, farthest};
    }

    // Draws those bands of some rows that are wanted, adds to the counts, and visits each; returns
    // the samples with a face in them.
    template <class Wants, class Visit>
    int64_t draw(const Canvas &canvas, const Look &look, Rows rows, Counts counts, Wants wants,
                 Visit visit) {
        if (rows.first == rows.last) return 0;
        _memory.fit(canvas.n_marks(), canvas.n_cells());
        set_camera(canvas, look);
        cull(canvas, look.cull && !counts.with_backs, band_of(canvas, rows));
        const bool is_only = rows.last - rows.first <= canvas.block_rows;
        int64_t filled = 0;
        for (int64_t first = rows.first; first < rows.last; first += canvas.block_rows) {
            const int64_t end = std::min(first + canvas.block_rows, rows.last);
            const Band band = band_of(canvas, {first, end});
            if (!wants(band)) continue;
            poll_interrupt();
            Column<const float> cell_bounds;
            if (canvas.is_scattered()) {
                const int64_t begin = first * canvas.columns, n = (end - first) * canvas.columns;
                counts.used = part(canvas.scattered.used, begin, n);
                cell_bounds = part(canvas.scattered.cell_bounds, begin / LANES, n / LANES);
            }
            filled += draw_band(_clusters, canvas.window(band.top, band.bottom, look.cull),
                                double(canvas.width), is_only, counts, cell_bounds, _memory);
            visit(band);
        }
        return filled;
    }

    // Copies the band that was drawn last to the rows of an image; w = farthest - depth, or for 0
    // the inverse of the depth.
    void read(const Canvas &canvas, const Band &band, float near, double farthest,
              const Array<float, Any, Any> &depth, const Array<int32_t, Any, Any> &face) const;
    // Its samples in lanes `from` up to `to` of a canvas.
    void read_lanes(const Canvas &canvas, const Band &band, const View &view, bool by_distance,
                    const Column<int32_t> &face, const Column<float> &depth);

    void count_targets(const Canvas &canvas, const Look &look, const FloatRows<3, 3> &corners,
                       Column<int64_t> visible, Column<int64_t> drawn);

    double farthest() const { return _memory.scratch->camera.farthest; }

  private:
    // Beyond all vertices by the size of the scene.
    double farthest_of(const Look &look) const {
        double middle = 0.0;
        for (int i = 0; i < 3; i++)
            middle += (_scene.centre()[i] - look.pose(i, 3)) * look.pose(i, 2);
        const double radius = _radius > 0 ? _radius : 1.0;
        return std::max(middle + radius, look.near) + 2 * radius;
    }
    static Band band_of(const Canvas &canvas, Rows rows) {
        return {SIDE * rows.first, std::min(SIDE * rows.last, canvas.height)};
    }

    // 1/z of a sample of memory; 0 without a face.
    float inverse_of(int64_t sample) const {
        return _memory.marks.all[sample / STRIP_SAMPLES] ? _memory.depth.all[sample] : 0.0f;
    }
    // Marks the clusters that may be visible in some rows.
    void cull(const Canvas &canvas, bool hides_backs, const Band &all) {
        const Camera &camera = _memory.scratch->camera;
        Frustum &frustum = _memory.scratch->frustum;
        put_frustum(camera, double(canvas.width), double(all.top), double(all.bottom), frustum);
        for (int64_t at = 0; at < _clusters.n; at += LANES) {
            const Kept found =
                cull_clusters(_clusters.bounds, at, camera, frustum, canvas.magnification[0],
                              hides_backs, _memory.down.all, _memory.forward.all);
            _memory.kept.all[at / LANES] = int32_t(found.drawn & first_lanes(_clusters.n - at));
            _memory.safe.all[at / LANES] = int32_t(found.safe);
        }
    }

    const Scene &_scene;
    Clusters _clusters;
    Memory _memory;
    double _radius; // of a sphere around the centre of the scene that has all that is drawn
    Room<int32_t> _counts[2];
    std::vector<FacePlane> _planes;
};

void Worker::read(const Canvas &canvas, const Band &band, float near, double farthest,
                  const Array<float, Any, Any> &depth, const Array<int32_t, Any, Any> &face) const {
    for (int64_t row = band.top; row < band.bottom; row++) {
        const int64_t first = ((row - band.top) >> SIDE_BITS) * canvas.columns;
        const auto depths = depth[row];
        const auto faces = face[row];
        for (int64_t column = 0; column < canvas.width; column++) {
            const int64_t in_block = (row & (SIDE - 1)) << SIDE_BITS | (column & (SIDE - 1));
            const int64_t sample = (first + (column >> SIDE_BITS)) << 2 * SIDE_BITS | in_block;
            const float inverse = inverse_of(sample);
            const double depth =
                farthest > 0 && inverse > 0 ? farthest - double(inverse) : 1.0 / double(inverse);
            depths[column] = std::max(float(depth), near); // inf of none
            faces[column] = inverse > 0 ? _memory.face.all[sample] : -1;
        }
    }
}

void Worker::read_lanes(const Canvas &canvas, const Band &band, const View &view, bool by_distance,
                        const Column<int32_t> &face, const Column<float> &depth) {
    // Neighbours show the same faces again and again.
    constexpr int MOST_PLANES = 256;
    const auto &[_, __, ___, lanes, samples, places] = canvas.scattered;
    const int64_t first = (band.top >> SIDE_BITS) * canvas.columns * LANES;
    const int64_t last = ((band.bottom + SIDE - 1) >> SIDE_BITS) * canvas.columns * LANES;
    _planes.assign(MOST_PLANES, {});
    for (int64_t i = std::lower_bound(lanes.begin(), lanes.end(), first) - lanes.begin();
         i < lanes.rows() && lanes[i] < last; i++) {
        const int64_t sample = lanes[i] - first, to = samples[i];
        require(sample >= 0, "lanes must rise");
        require(to >= 0 && to < face.rows(), "samples must be elements of the image");
        if (!_memory.marks.all[sample / STRIP_SAMPLES]) { // on to the next strip
            const int64_t end = (lanes[i] / STRIP_SAMPLES + 1) * STRIP_SAMPLES;
            i = std::lower_bound(lanes.data + i + 1, lanes.end(), end) - lanes.data - 1;
            continue;
        }
        const float inverse = _memory.depth.all[sample];
        if (!(inverse > 0)) continue;
        const int32_t f = face[to] = _memory.face.all[sample];
        FacePlane &plane = _planes[uint32_t(f) % MOST_PLANES];
        if (f != plane.face) plane = plane_of_face(view, f);
        const double z = depth_at(plane, places(i, 0), places(i, 1), by_distance, inverse);
        depth[to] = float(view.farthest > 0 ? view.farthest - 1.0 / z : z);
    }
}

void Worker::count_targets(const Canvas &canvas, const Look &look, const FloatRows<3, 3> &corners,
                           Column<int64_t> visible, Column<int64_t> drawn) {
    const int64_t n = corners.rows();
    const Counts unwanted = {counts(0), {}, {}, false};
    const struct Restore {
        double &radius;
        double own;
        ~Restore() { radius = own; }
    } restore = {_radius, _radius};
    for (int64_t k = 0; k < (canvas.is_parallel ? n : 0); k++)
        for (int64_t i = 0; i < 3; i++) {
            const auto at = corners[k][i];
            _radius = std::max(_radius, std::sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]));
        }
    set_camera(canvas, look);
    const View seen = view(canvas, corners);
    const auto window = [&](const Band &band) {
        return canvas.window(band.top, band.bottom, false);
    };
    const auto wants = [&](const Band &band) { return reach_band(seen, window(band)); };
    draw(canvas, look, canvas.part(0, 1), unwanted, wants, [&](const Band &band) {
        Lanes lanes = {{}, _memory.depth.all, _memory.marks.all};
        if (canvas.is_scattered()) {
            const int64_t row = band.top >> SIDE_BITS;
            lanes.used = part(canvas.scattered.used, row * canvas.columns,
                              (canvas.n_rows() - row) * canvas.columns);
        }
        raster::count_targets(seen, window(band), lanes, visible, drawn);
    });
}

// --- poses ---

Rasterizer::Rasterizer(const Scene &scene, int64_t n_idle)
    : _scene(scene), _idle(n_idle), _pace(FIRST_PACE * double(scene.n_faces())) {}
Rasterizer::~Rasterizer() = default;
void Rasterizer::close() { _idle.close(); }
int64_t Rasterizer::n_idle() const { return _idle.size(); }

void Rasterizer::share(int64_t n, int64_t n_threads, const Work &work) {
    const auto prepare = [&](std::unique_ptr<Worker> idle) {
        return idle ? std::move(idle) : std::make_unique<Worker>(_scene);
    };
    engine::share(n, n_threads, _idle, prepare, _pace, {}, work);
}

namespace {
void require_looks(const Canvases &canvases, const Looks &looks) {
    const int64_t n = looks.near.rows();
    for (const Canvas *each : canvases) require(each, "canvases must not be None");
    require(looks.world_from_camera.rows() == int64_t(canvases.size()) &&
                looks.world_from_camera.extent(1) == n && looks.cull.rows() == n,
            "looks must have one row for each canvas, and one pose for each near plane");
}
template <class T> void add(const Column<int32_t> &found, const Column<T> &sums) {
    for (int64_t f = 0; f < sums.rows(); f++) sums[f] += found[f];
}
} // namespace

template <class T>
void Rasterizer::count(const Canvases &canvases, const Looks &looks, const Output<T> &out,
                       int64_t n_parts, int64_t n_threads) {
    require_looks(canvases, looks);
    const int64_t n_poses = looks.near.rows(), n_faces = _scene.n_faces();
    const bool with_drawn = out.drawn.rows() > 0;
    require(have_rows(n_poses, out.visible, out.filled) &&
                (!with_drawn || out.drawn.rows() == n_poses),
            "output must have one row for each pose");
    require(out.visible.extent(1) == n_faces && (!with_drawn || out.drawn.extent(1) == n_faces),
            "visible and drawn must have one column for each face");
    require(n_parts > 0 && n_parts <= MAX_SIDE, "n_parts must be from 1 to 2^21");
    const auto clear = [&](int64_t pose) {
        if (out.adds) return;
        for (const auto &each : {row_of(out.visible, pose), row_of(out.drawn, pose)})
            std::fill(each.begin(), each.end(), 0);
        out.filled[pose] = 0;
    };
    const int64_t n_own = int64_t(canvases.size()) * n_parts;
    const bool is_split = n_poses < n_threads && n_own > 1;
    std::mutex adding;
    const auto count_part = [&](Worker &worker, int64_t pose, int64_t k) {
        const int64_t index = k / n_parts;
        const Canvas &canvas = *canvases[size_t(index)];
        require(n_parts == 1 || !canvas.is_scattered(), "scattered samples are in one part");
        const auto visible = row_of(out.visible, pose), drawn = row_of(out.drawn, pose);
        const bool is_direct = std::is_same_v<T, int32_t> && !is_split;
        Counts counts = {{}, {}, {}, with_drawn};
        if (is_direct) {
            if constexpr (std::is_same_v<T, int32_t>) {
                counts.visible = visible;
                counts.drawn = drawn;
            }
        } else {
            counts.visible = worker.counts(0);
            if (with_drawn) counts.drawn = worker.counts(1);
        }
        const int64_t filled =
            worker.draw(canvas, look_of(looks, index, pose), canvas.part(k % n_parts, n_parts),
                        counts, ALL, [](const Band &) {});
        const std::unique_lock lock =
            is_split ? std::unique_lock(adding) : std::unique_lock<std::mutex>();
        out.filled[pose] += filled;
        if (is_direct) return;
        if (filled) add(counts.visible, visible);
        if (with_drawn) add(counts.drawn, drawn);
    };
    if (is_split) {
        for (int64_t pose = 0; pose < n_poses; pose++) clear(pose);
        share(n_poses * n_own, n_threads,
              [&](Worker &worker, int64_t i) { count_part(worker, i / n_own, i % n_own); });
        return;
    }
    share(n_poses, n_threads, [&](Worker &worker, int64_t pose) {
        clear(pose); // while it is in the cache of the thread
        for (int64_t k = 0; k < n_own; k++) count_part(worker, pose, k);
    });
}
template void Rasterizer::count(const Canvases &, const Looks &, const Output<int32_t> &, int64_t,
                                int64_t);
template void Rasterizer::count(const Canvases &, const Looks &, const Output<int64_t> &, int64_t,
                                int64_t);

void Rasterizer::count_each(const Canvases &canvases, const Looks &looks, int64_t n_threads,
                            const Take &take) {
    require_looks(canvases, looks);
    share(looks.near.rows(), n_threads, [&](Worker &worker, int64_t pose) {
        const Counts counts = {worker.counts(0), worker.counts(1), {}, true, false};
        for (size_t k = 0; k < canvases.size(); k++) {
            const Canvas &canvas = *canvases[k];
            worker.draw(canvas, look_of(looks, int64_t(k), pose), canvas.part(0, 1), counts, ALL,
                        [](const Band &) {});
        }
        take(pose, counts);
    });
}

void Rasterizer::count_targets(const Canvases &canvases, const Looks &looks,
                               const FloatRows<3, 3> &corners,
                               const Array<int64_t, Any, Any> &visible,
                               const Array<int64_t, Any, Any> &drawn, int64_t n_threads) {
    require_looks(canvases, looks);
    const int64_t n_poses = looks.near.rows();
    for (const auto &each : {visible, drawn})
        require(each.rows() == n_poses && each.extent(1) == corners.rows(),
                "visible and drawn must have a row for each pose, a column for each target");
    share(n_poses, n_threads, [&](Worker &worker, int64_t pose) {
        for (size_t k = 0; k < canvases.size(); k++)
            worker.count_targets(*canvases[k], look_of(looks, int64_t(k), pose), corners,
                                 visible[pose], drawn[pose]);
    });
}

void Rasterizer::render(const Canvas &canvas, const Looks &looks,
                        const Array<int32_t, Any, Any, Any> &face,
                        const Array<float, Any, Any, Any> &depth, int64_t n_threads) {
    require_looks({&canvas}, looks);
    const int64_t n_poses = looks.near.rows();
    require(face.shape == depth.shape && face.rows() == n_poses &&
                face.extent(1) == canvas.height && face.extent(2) == canvas.width,
            "face and depth must have one element for each sample of each pose");
    share(n_poses, n_threads, [&](Worker &worker, int64_t pose) {
        const Look look = look_of(looks, 0, pose);
        // A face cut at the near plane can own a sample 1/512 of one beyond its rim.
        worker.draw(canvas, look, canvas.part(0, 1), {worker.counts(0), {}, {}, false}, ALL,
                    [&](const Band &band) {
                        worker.read(canvas, band, float(look.near), worker.farthest(), depth[pose],
                                    face[pose]);
                    });
    });
}

void Rasterizer::render_lanes(const Canvases &canvases, const Looks &looks,
                              const FloatRows<3, 3> &corners, bool by_distance,
                              const Column<int32_t> &face, const Column<float> &depth,
                              int64_t n_threads) {
    require_looks(canvases, looks);
    require(looks.near.rows() == 1 && depth.rows() == face.rows(),
            "there must be one pose, and depths for all elements");
    require(corners.rows() == _scene.n_faces(), "corners must be those of all faces");
    share(int64_t(canvases.size()), n_threads, [&](Worker &worker, int64_t k) {
        const Canvas &canvas = *canvases[size_t(k)];
        require(canvas.is_scattered(), "samples must be scattered");
        worker.draw(canvas, look_of(looks, k, 0), canvas.part(0, 1),
                    {worker.counts(0), {}, {}, false}, ALL, [&](const Band &band) {
                        worker.read_lanes(canvas, band, worker.view(canvas, corners), by_distance,
                                          face, depth);
                    });
    });
}

} // namespace rastercov::raster
