"""Samples of parallel rays: on the surfaces that they meet, and as many as areas are large."""

from contextlib import ExitStack

import numpy as np
import pytest
from scenes import joined, large_and_small
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.core.camera.camera import Camera
from rastercov.gl import PLANS, GLRasterizer

pytestmark = pytest.mark.native

SCENES = {
    "torus": lambda: rc.shapes.torus(40, 24),
    "teapot": lambda: rc.shapes.by_name("teapot"),
    "hostile": lambda: large_and_small()[0],
}


def views_of(mesh, rng, window=1.0, side=240):
    low, high = mesh.bounds
    size = float(np.linalg.norm(high - low))
    away = rng.normal(size=(3, 3))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    camera = Camera(
        width=side, height=side + 20, model="telecentric", fx=side * window / size,
        fy=1.1 * side * window / size, near=size * 0.6,
    )  # fmt: skip
    return camera, rc.look_at((low + high) / 2 + away, (low + high) / 2)


def nearest_by_rays(mesh, camera, pose):
    """Least depth at each pixel beyond the near plane, by all triangles, (H, W), inf for none."""
    local = (mesh.vertices - pose[:3, 3]) @ pose[:3, :3]
    u, v = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    across, down = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    nearest = np.full((camera.height, camera.width), np.inf)
    for a, b, c in local[mesh.faces]:
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        columns = slice(across.searchsorted(low[0]), across.searchsorted(high[0], "right"))
        rows = slice(down.searchsorted(low[1]), down.searchsorted(high[1], "right"))
        x, y = across[columns], down[rows, None]
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if det == 0:
            continue
        s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
        t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
        depth = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
        is_in = (s >= 0) & (t >= 0) & (s + t <= 1) & (depth >= camera.near)
        own = nearest[rows, columns]
        own[is_in] = np.minimum(own, depth)[is_in]
    return nearest


@pytest.mark.parametrize("window", [1.0, 30.0])
@pytest.mark.parametrize("name", SCENES)
def test_pixels_show_the_surface_that_their_ray_meets_first(name, window):
    mesh = SCENES[name]()
    camera, poses = views_of(mesh, np.random.default_rng(len(name)), window, side=60)
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        for pose in poses:
            seen = rasterizer.render(pose)
            depth = nearest_by_rays(mesh, camera, pose)
            scale = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
            with np.errstate(invalid="ignore"):
                is_close = np.abs(seen.depth - depth) <= 1e-4 * scale
            agree = is_close | (np.isinf(depth) & np.isinf(seen.depth))
            assert (~agree).mean() <= 0.01  # steps of 1/256 px at edges
            assert (np.isinf(seen.depth) == (seen.face < 0)).all()


@pytest.mark.parametrize("name", SCENES)
def test_samples_lie_on_faces_that_areas_say_are_visible(name):
    mesh = SCENES[name]()
    camera, poses = views_of(mesh, np.random.default_rng(3))
    with rc.open_observer(mesh, camera, "certified") as observer:
        areas = observer.observe(poses)
    with rc.open_observer(mesh, camera, "sampled") as observer:
        counted = observer.observe(poses)
    shares, sure = (rc.visibility(mesh, camera, poses, method=m) for m in ("sampled", "certified"))
    assert (np.abs(shares.value - sure.value) <= shares.bound + sure.bound).mean() >= 0.995
    assert counted.visible_pixels.sum(axis=1) == pytest.approx(
        areas.visible_pixels.sum(axis=1), rel=5e-3
    )
    assert counted.clipped.tolist() == areas.clipped.tolist()
    seen = counted.visible_pixels > 0
    is_there = areas.drawn_pixels + areas.area_error > 0
    assert not (seen & ~is_there).any()
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:  # culled or not, the same
        assert (rasterizer.count(poses).visible <= rasterizer.count(poses).drawn).all()


def test_targets_are_counted_through_what_is_before_them():
    mesh = beside(
        sheet_at((-1, -1), (1, 1), 0),
        sheet_at((-0.5, -0.5), (0.5, 0.5), -1),
        sheet_at((-0.5, 0), (0.5, 0.5), 3),
    )
    camera = rc.Camera.orthographic(100, 100, px_per_m=50)
    poses = rc.look_at([(0, 0, 2.0), (0, 0, -3.0), (0, 0, 5.0)], (0, 0, 0))
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        counts = rasterizer.count(poses)
    low, high = (mesh.face_group == k + 1 for k in range(2))
    assert counts.visible[:, low].sum(axis=1).tolist() == [0, 2500, 0]
    assert counts.visible[:, high].sum(axis=1).tolist() == [0, 0, 1250]
    assert counts.drawn[:, low].sum(axis=1).tolist() == [2500, 2500, 2500]
    assert counts.visible[:, ~mesh.target_mask].sum(axis=1).tolist() == [10000, 10000, 10000]


@pytest.fixture(params=PLANS)
def open_gl(device, request):
    plan = request.param
    with ExitStack() as stack:
        yield lambda mesh, camera, **options: stack.enter_context(
            GLRasterizer(mesh, camera, device=device, plan=plan, **options)
        )


def stacked():
    """Plates in one plane, which overlap, before and behind others of equal depth."""
    places = (0, 0), (0.5, 0), (1, 0), (0.7, 1)
    plates = [sheet_at((x, x), (x + 2, x + 1.5), z) for x, z in places]
    return joined(*(rc.Mesh(each.vertices, each.faces) for each in plates))


@pytest.mark.parametrize("name", [*SCENES, "stacked", "far"])
@pytest.mark.parametrize("window", [1.0, 8.0])
def test_opengl_draws_what_the_processor_draws(open_gl, name, window):
    mesh = stacked() if name == "stacked" else SCENES.get(name, SCENES["torus"])()
    shift = np.array((1e5, -2e5, 3e5)) * (name == "far")
    mesh = rc.Mesh(mesh.vertices + shift, mesh.faces)
    camera, poses = views_of(mesh, np.random.default_rng(5), window, side=100)
    poses[2, :3, 3] -= 1e3 * poses[2, :3, 2]  # from far away
    scale = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    with rc.open_rasterizer(mesh, camera, "cpu") as other:
        rasterizer = open_gl(mesh, camera)
        for pose in poses:
            one, two = rasterizer.render(pose), other.render(pose)
            assert (one.face != two.face).mean() <= 0.01
            same = (one.face == two.face) & (one.face >= 0)
            far = float(np.abs(two.depth[same]).max(initial=0.0))
            np.testing.assert_allclose(
                one.depth[same], two.depth[same], atol=1e-4 * scale + 1e-6 * far
            )
        counts, others = rasterizer.count(poses), other.count(poses)
        for name in ("visible", "drawn"):
            one, two = (getattr(each, name).sum() for each in (counts, others))
            assert one == pytest.approx(two, rel=0.01)
        assert counts.clipped.tolist() == others.clipped.tolist()


def test_of_equal_depths_the_lowest_face_wins_in_opengl(open_gl):
    mesh = stacked()
    camera = rc.Camera.orthographic(60, 50, px_per_m=20, near=0.5)
    poses = rc.look_at([(1.2, 1, 4), (1.2, 1, -4), (3, 2, 5)], (1.2, 1, 0.2))
    with rc.open_rasterizer(mesh, camera, "cpu") as other:
        rasterizer = open_gl(mesh, camera)
        for pose in poses:
            differ = rasterizer.render(pose).face != other.render(pose).face
            assert differ.mean() <= 0.005


@pytest.mark.parametrize("options", [{"supersample": 3}, {"roll": 0.3}, {"roll": 1.0}])
def test_counts_of_finer_and_rotated_grids_agree(open_gl, options):
    mesh = SCENES["teapot"]()
    camera, poses = views_of(mesh, np.random.default_rng(6), side=90)
    with rc.open_rasterizer(mesh, camera, "cpu", **options) as other:
        expected = other.count(poses).visible
    visible = open_gl(mesh, camera, **options).count(poses).visible
    assert np.abs(visible.astype(int) - expected).sum() <= 0.01 * expected.sum()


def test_the_pipeline_leaves_parallel_rays_to_compute_shaders(device):
    mesh, camera = SCENES["torus"](), rc.Camera.orthographic(100, 100, px_per_m=50)
    with GLRasterizer(mesh, camera, device=device, plan="pipeline") as rasterizer:
        assert rasterizer.info.plan == "compute"
