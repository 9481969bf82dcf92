"""Samples of parallel rays: on the surfaces that they meet, and as many as areas are large."""

import numpy as np
import pytest
from scenes import large_and_small
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.camera.camera import Camera

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
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    nearest = np.full(x.shape, np.inf)
    for a, b, c in local[mesh.faces]:
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if det == 0:
            continue
        s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
        t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
        depth = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
        is_in = (s >= 0) & (t >= 0) & (s + t <= 1) & (depth >= camera.near)
        nearest = np.where(is_in, np.minimum(nearest, depth), nearest)
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
