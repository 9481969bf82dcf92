"""Regions of parallel rays: point by point, and as large as they are on paper."""

import numpy as np
import pytest
from exact_views import SEEDS, soup
from hypothesis import given
from nightly import examples
from scenes import square
from surface_cases import assert_pointwise, building, room

import rastercov as rc
from rastercov.core.camera.projection import to_image

pytestmark = pytest.mark.native

TASKS = {
    "visible": {},
    "oblique": {"max_incidence_deg": 55},
    "per m^2": {"min_pixels_per_m2": 0.6},
    "density": {"min_pixel_density": 0.6},
    "facing": {"min_facing_density": 1.1},
    "all": {"max_incidence_deg": 70, "min_pixels_per_m2": 0.4, "min_pixel_density": 0.45},
}
"""Thresholds of densities for one pixel per metre."""


def view_of(mesh, rng, *, stretched=False, near=0.0, focus=None):
    """Camera and poses around a mesh, which fills most of the image."""
    low, high = mesh.bounds
    size = float(np.linalg.norm(high - low))
    px_per_m = 300 / size
    own = {"fx": px_per_m, "fy": px_per_m * (1.3 if stretched else 1.0), "near": near * size}
    if focus is not None:
        own["focus_range"] = tuple(size * each for each in focus)
    camera = rc.Camera(width=320, height=290, model="telecentric", **own)
    away = rng.normal(size=(3, 3))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    middle = (low + high) / 2
    return camera, rc.look_at(middle + away, middle), px_per_m


def task_of(name, px_per_m):
    scales = {"min_pixels_per_m2": px_per_m**2, "max_incidence_deg": 1}
    own = {key: value * scales.get(key, px_per_m) for key, value in TASKS[name].items()}
    return rc.Task(**own)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "exact"])
@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("scene", [room, building])
def test_a_point_is_in_a_region_exactly_if_it_meets_every_criterion(scene, name, method):
    mesh = scene()[0]
    for stretched, near, focus in ((False, 0.0, None), (True, 0.9, (0.8, 1.1))):
        rng = np.random.default_rng(len(name))
        camera, poses, scale = view_of(mesh, rng, stretched=stretched, near=near, focus=focus)
        assert_pointwise(mesh, camera, poses, task_of(name, scale), 3000, method=method)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(8, at_night=40)
def test_regions_of_any_triangles_hold_their_covered_points(seed):
    rng = np.random.default_rng(seed)
    mesh = soup(rng, n=40)
    camera, poses, scale = view_of(mesh, rng, stretched=seed % 2 == 0, near=rng.uniform(0, 1.2))
    for name in TASKS:
        assert_pointwise(mesh, camera, poses[:1], task_of(name, scale), 1500, seed % 1000)


def test_areas_of_regions_are_those_of_images_over_the_cosine():
    mesh = rc.shapes.torus(24, 16)
    camera, poses, scale = view_of(mesh, np.random.default_rng(1))
    regions = rc.regions(mesh, camera, poses)
    with rc.open_observer(mesh, camera, "exact") as observer:
        seen = observer.observe(poses)
    cosine = np.abs(poses[:, :3, 2] @ mesh.normals.T)
    expected = seen.visible_pixels / (scale**2 * np.maximum(cosine, 1e-300))
    slack = regions.bounds() + seen.area_error / (scale**2 * np.maximum(cosine, 1e-300))
    expected[(poses[:, :3, 2] @ mesh.normals.T) >= 0] = 0
    assert (np.abs(regions.areas() - expected) <= slack + 1e-12).all()
    assert regions.bound.sum() <= 1e-6 * regions.area.sum()


@pytest.mark.parametrize(("least", "covers"), [(199.0, True), (200.0, True), (201.0, False)])
def test_a_face_before_the_rays_has_the_density_of_the_lens_at_any_depth(least, covers):
    camera = rc.Camera.orthographic(400, 400, px_per_m=200)
    mesh, task = square(0.5, 0.0), rc.Task(min_pixel_density=least, min_facing_density=least)
    normal = mesh.normals[0]
    poses = rc.look_at([away * normal for away in (0.1, 3.0, 1e4)], (0, 0, 0))
    regions = rc.regions(mesh, camera, poses, task)
    assert regions.areas().sum(axis=1) == pytest.approx(np.full(3, mesh.areas.sum() * covers))


@pytest.mark.parametrize(
    ("altitude", "azimuth", "expected"),
    [
        (45, 0, 20.0),
        (45, 30, 18.786327949541),
        (60, -20, 11.903337080193),
        (20, 70, 20.820124475322),
    ],
)
@pytest.mark.parametrize("halved", [0, 3])
def test_the_shadow_of_an_overhang_is_as_large_as_on_paper(altitude, azimuth, expected, halved):
    """A slab 1 m deep above a wall of 10 x 3 m; the sun is at angles from the wall's normal."""
    wall = np.array(
        [[(0, 0, 0), (10, 0, 0), (10, 0, 3)], [(0, 0, 0), (10, 0, 3), (0, 0, 3)]], float
    )
    for _ in range(halved):
        middle = (wall[:, 0] + wall[:, 2]) / 2
        a, b, c = wall.transpose(1, 0, 2)
        wall = np.concatenate((np.stack((b, c, middle), 1), np.stack((a, b, middle), 1)))
    slab = [[(0, 0, 3), (10, 0, 3), (10, -1, 3)], [(0, 0, 3), (10, -1, 3), (0, -1, 3)]]
    points = np.concatenate((wall, slab)).reshape(-1, 3)
    mesh = rc.Mesh(points, np.arange(len(points)).reshape(-1, 3))
    h, a = np.radians((altitude, azimuth))
    to_sun = np.array((np.cos(h) * np.sin(a), -np.cos(h) * np.cos(a), np.sin(h)))
    camera = rc.Camera.orthographic(1000, 1000, px_per_m=50)
    poses = rc.look_at((5, 0, 1.5) + 20 * to_sun, (5, 0, 1.5))
    regions = rc.regions(mesh, camera, poses)
    area = regions.areas()[0, : len(wall)].sum()
    assert area == pytest.approx(expected, abs=1e-10)


def test_views_of_both_sides_of_a_sheet_do_not_count_together():
    sheet = square(0.5, 0.0)
    mesh = rc.Mesh(sheet.vertices, sheet.faces, [rc.Group("leaf", is_two_sided=True)])
    camera = rc.Camera.orthographic(300, 300, px_per_m=100)
    axes = np.array([(0, 0.1, -1), (0.2, 0, -1), (0, 0, 1), (0.999999, 0, 1e-6)])
    regions = rc.regions(mesh, camera, rc.look_at(2 * axes, (0, 0, 0)))
    assert regions.areas().sum(axis=1) == pytest.approx(np.ones(4))
    assert regions.at_least(2).area.sum() == pytest.approx(1)
    assert regions.at_least(4, one_side=False).area.sum() == pytest.approx(1)
    assert regions.at_least(3).area.sum() == 0


def test_lines_of_a_moving_part_are_one_parallel_image():
    """Each line sees a strip of the part as wide as it moves; strips of single lines add up."""
    part = rc.shapes.torus(24, 16)
    size = float(np.ptp(part.bounds, axis=0).max())
    lens = {"magnification": 0.1, "pixel_size": 0.1 * size / 400, "vy": -size / 30}
    pose = rc.look_at((0.4 * size, 0.3 * size, 2 * size), (0, 0, 0))
    whole = rc.regions(part, rc.Camera.line_scan(500, 40, **lens), pose).area.sum()
    line = rc.Camera.line_scan(500, 1, **lens)
    steps = np.repeat(pose, 40, axis=0)
    moves = (np.arange(40) - 19.5) * size / 30
    steps[:, :3, 3] += moves[:, None] * pose[0, :3, 1]
    strips = rc.regions(part, line, steps)
    assert strips.area.sum() == pytest.approx(whole, rel=1e-9)
    assert rc.unite(strips).area.sum() == pytest.approx(whole, rel=1e-6)
    with pytest.raises(rc.CameraError, match="expected vz of 0"):
        rc.Camera.line_scan(500, 1, **(lens | {"vz": 1e-5}))
    with pytest.raises(rc.CameraError, match="vy"):
        rc.Camera.line_scan(500, 1, **(lens | {"vy": 0.0}))
    with pytest.raises(rc.CameraError, match="expected no distortion for a line sensor"):
        rc.Camera.line_scan(500, 1, **lens, distortion=(1.0,))


@pytest.mark.parametrize("vy", [-1.0, 1.0])
@pytest.mark.parametrize("vx", [0.4, -0.7])
def test_a_part_that_moves_along_the_line_too_has_a_skewed_image(vx, vy):
    part = rc.shapes.torus(24, 16)
    size = float(np.ptp(part.bounds, axis=0).max())
    v = np.array((vx, vy)) * size / 30
    lens = {"magnification": 0.1, "pixel_size": 0.1 * size / 400, "vx": v[0], "vy": v[1]}
    camera = rc.Camera.line_scan(500, 40, **lens)
    pose = rc.look_at((0.4 * size, 0.3 * size, 2 * size), (0, 0, 0))
    places = np.random.default_rng(1).uniform(-size / 2, size / 2, (50, 3))
    time = -places[:, 1] / v[1]  # at which a point is at the line
    u = (places[:, 0] + time * v[0]) * 400 / size + 250
    line = 20 + places[:, 1] / abs(v[1])
    assert np.abs(to_image(places, camera) - np.stack((u, line), axis=1)).max() <= 1e-9
    wide = rc.Camera.line_scan(900, 40, **lens)
    whole = rc.regions(part, wide, pose)
    steps = np.repeat(pose, 40, axis=0)
    moves = np.arange(40)[:, None] - 19.5
    steps[:, :3, 3] -= np.sign(-v[1]) * moves * (v @ pose[0, :3, :2].T)
    lines = rc.regions(part, rc.Camera.line_scan(900, 1, **lens), steps)
    bound = whole.bound.sum() + lines.bound.sum()
    assert abs(lines.area.sum() - whole.area.sum()) <= bound <= 1e-6 * part.areas.sum()
    assert_pointwise(part, camera, pose, rc.Task(max_incidence_deg=80), 2000)


@pytest.mark.parametrize("method", ["certified", "exact"])
def test_a_camera_that_is_mounted_on_a_wall_looks_through_it(method):
    """As a pinhole does: a wall within rounding of its origin is nearer than the near plane."""
    camera = rc.Camera.orthographic(100, 100, px_per_m=100)
    cube = rc.shapes.box((2, 2, 2))
    rng = np.random.default_rng(0)
    for off in (0.0, 1e-12, -1e-12, 1e-7, -1e-7):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        inside = rc.Mesh(cube.vertices @ turn.T, cube.faces[:, ::-1])
        pose = rc.look_at(turn @ (0.1, 0.2, 1 + off), turn @ (0.1, 0.2, -1))
        regions = rc.regions(inside, camera, pose, method=method)
        assert regions.areas().sum() == pytest.approx(1, rel=1e-12)
        with rc.open_rasterizer(inside, camera, "cpu") as rasterizer:
            assert rasterizer.count(pose).visible.sum() == 100 * 100
