// What parallel rays light, such as those of the sun, for C.
//
// Twin: tests/native/test_c_border.py.
#include "camera/sun.hpp"
#include "c/objects.hpp"
#include <algorithm>

namespace rastercov::c {
namespace {
constexpr int64_t PAIRS_TOGETHER = 1 << 20; // of directions and faces: some 25 MB

// Unit vectors of directions.
std::vector<double> units_of(const double *directions, int64_t n) {
    std::vector<double> units;
    for (int64_t i = 0; i < n; i++, directions += 3) {
        const Coordinates all = {directions[0], directions[1], directions[2]};
        for (const double each : all)
            expect(std::abs(each) <= engine::LARGEST_COORDINATE, "directions within 1e30", each,
                   "pass vectors to the sun");
        expect(length(all) > 0, "directions of a length above 0", length(all), "leave these out");
        const Coordinates unit = unit_of(all);
        units.insert(units.end(), unit.begin(), unit.end());
    }
    return units;
}

class Sun {
  public:
    explicit Sun(const SolverObject &solver)
        : _mesh(solver.surface->mesh), _views(box_of(*_mesh.arrays)), _n_threads(solver.n_threads),
          _pass(solver.is_certifying, false, 1, _n_threads) {
        const double scale = _views.px_per_m();
        auto image = std::make_shared<engine::Camera>();
        image->image = {scale, scale, SUN_SIDE / 2, SUN_SIDE / 2, SUN_SIDE, SUN_SIDE};
        image->near = 0.0;
        image->is_parallel = true;
        _pass.set_camera(0, std::move(image), {});
        const auto asked = _mesh.arrays->is_asked.rows();
        if (std::all_of(asked.begin(), asked.end(), [](bool each) { return each; })) return;
        _left_out = engine::Room<bool>(_mesh.n_faces());
        for (int64_t f = 0; f < _mesh.n_faces(); f++) _left_out[f] = !asked[f];
    }

    // Directions that are solved together.
    int64_t step() const { return std::max(_n_threads, PAIRS_TOGETHER / _mesh.n_faces()); }

    // Writes rows of some directions, once all of them are known.
    void light(const double *units, int64_t n, const engine::GoOn &go_on, const rc_lit &out,
               int64_t first) {
        std::vector<double> poses(size_t(16 * n));
        for (int64_t i = 0; i < n; i++) _views.write(units + 3 * i, poses.data() + 16 * i);
        const Placed placed(poses.data(), n);
        const int64_t n_faces = _mesh.n_faces();
        const std::array<int64_t, 2> shape = {n, n_faces};
        std::array<engine::Room<double>, 3> areas;
        for (auto &each : areas) each = engine::Room<double>(n * n_faces);
        engine::Room<uint8_t> kinds(n * n_faces);
        engine::Room<bool> clipped(n);
        engine::Job job = {_mesh.surface, placed.poses(), {}, nullptr, _left_out.rows()};
        job.figures = {{areas[0].data(), shape},
                       {areas[1].data(), shape},
                       {kinds.data(), shape},
                       {areas[2].data(), shape},
                       clipped.rows()};
        _pass.run(job, _n_threads, go_on);
        const engine::MeshArrays &mesh = *_mesh.arrays;
        const double per_m2 = _views.px_per_m() * _views.px_per_m();
        for (auto &each : areas)
            for (double &value : each) value /= per_m2;
        for (int64_t k = 0; k < n * n_faces; k++) {
            const int64_t f = k % n_faces;
            const double area = mesh.is_asked[f] ? mesh.areas[f] : 0.0;
            const double *const unit = units + 3 * (k / n_faces);
            double cosine = 0.0;
            for (int64_t axis = 0; area > 0 && axis < 3; axis++)
                cosine += unit[axis] * mesh.normal[3 * f + axis];
            SunlitFace{areas[0][k], areas[1][k], areas[2][k]}.keep_front(cosine, mesh.two_sided[f],
                                                                         area);
        }
        double *const to[] = {out.lit, out.whole, out.bound};
        for (size_t k = 0; k < 3; k++)
            std::copy(areas[k].begin(), areas[k].end(), to[k] + first * n_faces);
    }

  private:
    const engine::Mesh &_mesh;
    SunViews _views;
    int64_t _n_threads;
    engine::Pass _pass;
    engine::Room<bool> _left_out;
};
} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_sunlit(const rc_solver *solver, const double *directions, int64_t n_directions,
                    rc_go_on go_on, void *context, const rc_lit *lit) {
    return guard("finding lit areas", [&] {
        const auto object = object_of(solver);
        expect_array(lit, "lit");
        expect(lit->size == sizeof(rc_lit), "size of sizeof(rc_lit) bytes", lit->size,
               "set it, and compile against the header of the library");
        expect(n_directions >= 0 && n_directions <= MOST_FACES, "0 to 715827882 directions",
               n_directions, "pass the number of rows");
        if (n_directions == 0) return;
        expect_arrays("directions and each of lit", directions, lit->lit, lit->whole, lit->bound);
        const std::vector<double> units = units_of(directions, n_directions);
        Sun sun(*object);
        for (int64_t first = 0, n = 0; first < n_directions; first += n) {
            n = std::min(sun.step(), n_directions - first);
            sun.light(units.data() + 3 * first, n, go_on_of(go_on, context), *lit, first);
        }
    });
}
