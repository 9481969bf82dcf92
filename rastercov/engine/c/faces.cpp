// Whole faces for C: reasons, coverage (3.6) and densities in one pose, as pictures colour them.
//
// Twin: rastercov.core.coverage.face_pass, by tests/native/test_c_border.py.
#include "c/objects.hpp"
#include "camera/near.hpp"
#include "coverage/face.hpp"

namespace rastercov::c {
namespace {
// Least coverage of a face that counts, as of rastercov.Task.
constexpr double MIN_COVERAGE = 0.5;

// Figures of one pose, and arrays of the mesh.
struct Measured {
    std::vector<double> visible, drawn, error;
    std::vector<uint8_t> kind, own;
    std::vector<uint64_t> faces;
    std::vector<double> none; // for bounds, which are not asked for

    explicit Measured(const engine::MeshArrays &mesh) : none(size_t(mesh.areas.size())) {
        const auto n = size_t(mesh.areas.size());
        visible.resize(n);
        drawn.resize(n);
        error.resize(n);
        kind.assign(n, uint8_t(engine::EXACT));
        own.assign(n, uint8_t(coverage::COVERED));
        for (size_t f = 0; f < n; f++)
            if (!(mesh.areas[int64_t(f)] > 0)) own[f] = coverage::DEGENERATE;
        const auto corners = mesh.faces.rows();
        faces.assign(corners.begin(), corners.end());
    }
    coverage::Scene scene(const engine::MeshArrays &mesh) const {
        const int64_t n = mesh.areas.size();
        return {mesh.vertices.rows<3>(),
                {faces.data(), {n}},
                mesh.normal.rows<3>(),
                {own.data(), {n}},
                mesh.two_sided.rows(),
                {none.data(), {n}},
                0.0,
                0.0};
    }
};

struct Keeper {
    const rc_judged &out;

    template <class N> bool leaves_out(int64_t) const { return false; }
    template <class N> INLINE void take(int64_t f, const coverage::Face<N> &face) const {
        if (out.reasons) write(out.reasons + f, face.decision.reason);
        if (out.coverage) write(out.coverage + f, face.decision.coverage);
        if (out.densities) write(out.densities + f, face.measures.density);
        if (out.facing) write(out.facing + f, face.measures.facing);
    }
};

template <class Camera>
void judge(const Camera &camera, const coverage::Scene &scene, const coverage::Seen<double> &seen,
           const Rules &rules, const rc_judged &out) {
    const auto columns = size_t(coverage::COLUMNS_OF<Camera>);
    std::vector<double> memory(size_t(scene.vertices.rows()) * columns);
    const coverage::VertexRows<Camera> points = {memory.data(), {scene.vertices.rows()}};
    const auto scratch = std::make_unique<coverage::Memory<Camera>>();
    const coverage::Asked asked(rules, false, out.densities, out.facing);
    const coverage::View<Camera, double> view = {scene,  camera,   seen,  rules,
                                                 points, *scratch, asked, 0};
    const Keeper keeper = {out};
    coverage::judge_pose(view, 0, keeper);
}
} // namespace
} // namespace rastercov::c

using namespace rastercov;
using namespace rastercov::c;

rc_status rc_judge_faces(rc_solver *solver, const rc_camera *camera, const rc_task *task,
                         const double *pose, int64_t n_faces, const rc_judged *judged) {
    return guard("judging faces", [&] {
        const auto object = object_of(solver);
        check_camera(camera);
        expect_array(task, "task");
        expect_array(judged, "judged");
        Rules rules = rules_of(*task);
        rules.min_coverage = MIN_COVERAGE;
        check_faces(*object->surface, n_faces);
        const engine::Mesh &mesh = object->surface->mesh;
        const Placed placed(pose, 1);
        Measured whole(*mesh.arrays);
        const std::array<int64_t, 2> shape = {1, n_faces};
        bool is_clipped = false;
        engine::Job job = {mesh.surface, placed.poses(), {}, nullptr, {}};
        job.figures = {{whole.visible.data(), shape},
                       {whole.drawn.data(), shape},
                       {whole.kind.data(), shape},
                       {whole.error.data(), shape},
                       {&is_clipped, {1}}};
        const auto lens = lens_of(*camera);
        pass_of(*object, *camera, lens, nullptr)->run(job, 1);
        const double near =
            near_of(camera->near,
                    farthest_of(mesh.surface->bounds(), [&](int k) { return pose[4 * k + 3]; }));
        const coverage::Seen<double> seen = {
            {placed.matrices.data(), {1}}, {&near, {1}}, {whole.visible.data(), shape},
            {whole.drawn.data(), shape},   1.0,          {whole.kind.data(), shape},
            {whole.error.data(), shape},   1.0};
        const coverage::Scene scene = whole.scene(*mesh.arrays);
        if (lens) judge(lens->curved, scene, seen, rules, *judged);
        else judge(pinhole_of(*camera), scene, seen, rules, *judged);
    });
}
