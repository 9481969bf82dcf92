"""Exact areas through lenses: laws that hold for any lens, and the pinhole as a lens."""

import math
from dataclasses import replace

import numpy as np
import pytest
from exact_views import Certificate, HalfPlanes
from hypothesis import example, given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import amount, examples
from scenes import joined, square
from surfaces import surface_of

from rastercov.core.area.regions import RegionPass
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.lenses.of_camera import blind_area, lens_of, optics_of, planes_of
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.coverage import FIGURES, open_observer
from rastercov.core.coverage.exact_pass import room_for
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.raster.contract import BoundKind

ROOM = shapes.room()
TORUS = shapes.torus(40, 20)
PINHOLE = Camera(width=640, height=480, fx=500, fy=510)
SAME = Camera(width=640, height=480, fx=500, fy=510, max_angle_deg=80)
"""The same camera through the path of lenses."""
each_lens = pytest.mark.parametrize("name", CAMERAS)


def inside(mesh, seed):
    """A pose inside the bounding box of a mesh, in any direction."""
    rng = np.random.default_rng(seed)
    low, high = mesh.bounds
    eye = low + (high - low) * rng.uniform(0.2, 0.8, 3)
    return look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))[0]


def solved(mesh, camera, pose, kind=Certificate, near=1e-3):
    solver = kind(surface_of(mesh), camera)
    solver.solve(pose, near, False)
    return solver


@pytest.mark.slow
@each_lens
@pytest.mark.parametrize("seed", range(3))
def test_visible_areas_in_a_closed_room_add_up_to_the_image(name, seed):
    camera = CAMERAS[name]
    solution = solved(ROOM, camera, inside(ROOM, seed))
    assert abs(solution.visible.sum() - camera.width * camera.height) < 1e-6
    assert np.all(solution.visible <= solution.area + solution.area_error + 1e-9)


@pytest.mark.slow
@examples(5, at_night=15)
@example(seed=1, focal=300.0, k=(-0.35, 0.0), p=0.0, tau=0.0)  # it folds within the image
@given(
    seed=st.integers(0, 10_000),
    focal=st.floats(200, 2000),
    k=st.tuples(st.floats(-0.3, 0.5), st.floats(-0.1, 0.2)),
    p=st.floats(-5e-3, 5e-3),
    tau=st.floats(-0.05, 0.05),
)
def test_pixels_with_a_ray_see_the_room_through_random_lenses(seed, focal, k, p, tau):
    camera = Camera(
        width=800, height=600, fx=focal, fy=1.1 * focal, cx=390, cy=310, skew=0.5, model="opencv",
        distortion=(*k, p, -p / 2, 0, 0, 0, 0, 0, 0, 0, 0, tau, -tau),
    )  # fmt: skip
    lens, solution = lens_of(camera), solved(ROOM, camera, inside(ROOM, seed))
    blind = 0.0 if lens.is_whole else blind_area(lens)  # of pixels without a ray
    assert abs(solution.visible.sum() + blind - 800 * 600) < 1e-6 + solution.area_error.sum()


BEHIND = {
    "fisheye to 130": ("opencv_fisheye", (0, 0, 0, 0), 130),
    "fisheye to 150": ("opencv_fisheye", (-0.02, 0.005, -0.002, 0.0003), 150),
    "omni, its pole behind": ("omni", (0.85,), 130),
    "omni, its pole beside": ("omni", (0.4,), 95),
    "eucm, its pole beside": ("eucm", (0.3, 1.0), 95),
    "double sphere, its pole beside": ("double_sphere", (0.3, 0.3), 95),
}
"""Lenses that see beyond 90 degrees, and whose equations end or fold where they do not see."""


@pytest.mark.slow
@pytest.mark.parametrize("name", BEHIND)
def test_edges_that_run_where_a_wide_lens_does_not_see_change_nothing(name):
    model, distortion, angle = BEHIND[name]
    camera = Camera(
        width=300, height=300, fx=50, fy=50, model=model, distortion=distortion,
        max_angle_deg=angle,
    )  # fmt: skip
    walls = shapes.box((4, 5, 3))
    room = Mesh(walls.vertices, walls.faces[:, ::-1])
    rng = np.random.default_rng(1)
    blind, poses = blind_area(lens_of(camera)), []
    for _ in range(amount(15, at_night=40)):
        # The direction opposite to the axis is at an edge, or so near to one.
        start, end = room.vertices[room.faces[rng.integers(12)]][:2]
        offset = rng.normal(size=3) * 10.0 ** rng.uniform(-6, -1)
        eye, edge = rng.normal(0, 0.2, 3), start + (end - start) * rng.uniform(0.2, 0.8) + offset
        poses.append(look_at(eye, 2 * eye - edge, rng.normal(size=3))[0])
        solution = solved(room, camera, poses[-1])
        seen = solution.visible.sum()
        assert abs(seen + blind - 300**2) <= 1e-6 + solution.area_error.sum()
        assert np.all(solution.visible <= solution.area + solution.area_error + 1e-9)
    figures = evaluate(room, camera, poses, fields=("projected_area", "drawn_pixels"), by="face")
    assert np.all(figures.projected_area >= figures.drawn_pixels - 1e-5)
    all_seen = figures.projected_area.sum(axis=1)
    if name == "fisheye to 130":  # whose image is a disc of this radius
        disc = 50 * math.radians(130)
        assert np.allclose(all_seen, math.pi * disc**2, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("focal", [60, 80])
def test_edges_next_to_the_horizon_cross_the_border_where_the_lens_does(focal):
    """There a polynomial by area is off by much in its place."""
    camera = Camera(width=300, height=300, fx=focal, fy=focal, model="eucm", distortion=(0.25, 1.2))
    walls, inner = shapes.box((4, 5, 3)), shapes.box((0.6, 0.5, 0.8))
    turned_in = Mesh(walls.vertices, walls.faces[:, ::-1])
    room = joined(turned_in, Mesh(inner.vertices + np.array([0.9, 0.4, -0.7]), inner.faces))
    rng = np.random.default_rng(5)
    for _ in range(12):
        eye = rng.normal(0, 0.2, 3)
        pose = look_at(eye, eye + rng.normal(size=3), rng.normal(size=3))[0]
        assert abs(solved(room, camera, pose).visible.sum() - 300**2) <= 1e-8


@pytest.mark.slow
@each_lens
def test_half_planes_and_the_certificate_agree(name):
    camera = CAMERAS[name]
    for seed in range(2):
        pose = inside(ROOM, 10 + seed)
        one = solved(ROOM, camera, pose)
        other = solved(ROOM, camera, pose, HalfPlanes)
        apart = np.abs(one.visible - other.visible)
        assert np.all(apart <= one.area_error + other.area_error)
        np.testing.assert_allclose(one.area, other.area, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "exact"])
def test_a_pinhole_as_a_lens_has_the_figures_of_a_pinhole(method):
    poses = sphere_of_poses((0, 0, 0), 2.4, 5)
    task = Task(min_pixels=3, max_incidence_deg=70)
    one = evaluate(TORUS, PINHOLE, poses, task, method=method, by="face")
    other = evaluate(TORUS, SAME, poses, task, method=method, by="face")
    for figure in set(FIGURES) - {"facing_density", "visibility_bound", "visibility_kind"}:
        first, second = getattr(one, figure), getattr(other, figure)
        if first.dtype == np.float64:
            np.testing.assert_allclose(first, second, rtol=1e-11, atol=2e-9, err_msg=figure)
        else:
            np.testing.assert_array_equal(first, second, err_msg=figure)
    # Of a pinhole it is a bound, exact for square pixels.
    assert np.all(other.facing_density >= one.facing_density * (1 - 1e-12))
    assert np.all(other.facing_density <= one.facing_density * (510 / 500 + 1e-12))


@each_lens
def test_what_is_hidden_has_no_area_and_a_lone_face_has_all_of_it(name):
    camera = CAMERAS[name]
    front, back = square(0.2, 1.0), square(0.19, 1.5)
    both = joined(front, back)
    solution = solved(both, camera, np.eye(4))
    np.testing.assert_array_equal(solution.visible[:2], solution.area[:2])
    assert np.all(solution.area[:2] > 100)
    assert np.all(solution.visible[2:] <= solution.area_error[2:])
    assert np.all(solution.area[2:] > 50)


@pytest.mark.slow
def test_a_bulging_edge_leaves_the_image_though_its_corners_do_not():
    barrel = Camera(
        width=200, height=200, fx=150, fy=150, model="opencv", distortion=(-0.15, 0.01, 0, 0)
    )
    rays = lens_of(barrel).unproject([[2, 2], [198, 2], [198, 198], [2, 198]])
    corners = rays / rays[:, 2:] * 3.0
    bulging = Mesh(corners, [(0, 2, 1), (0, 3, 2)])
    seen = evaluate(bulging, barrel, np.eye(4)[None], by="face")
    assert not seen.in_view.any()
    assert np.all(seen.in_view_fraction < 1)
    smaller = Mesh(corners * (0.5, 0.5, 1), [(0, 2, 1), (0, 3, 2)])
    assert evaluate(smaller, barrel, np.eye(4)[None], by="face").in_view.all()


@pytest.mark.slow
def test_a_rig_of_pinholes_and_lenses():
    rig = Rig([PINHOLE, CAMERAS["brown"].resized(0.5), CAMERAS["wide fisheye"].resized(0.25)])
    poses = rig.poses(sphere_of_poses((0, 0, 0), 2.4, 3))
    with open_observer(TORUS, rig) as observer:
        together = observer.observe(poses)
    for index, camera in enumerate(rig.cameras):
        rows = np.flatnonzero(poses.camera == index)
        with open_observer(TORUS, camera) as observer:
            alone = observer.observe(poses.world_from_camera[rows])
        np.testing.assert_array_equal(together.visible_pixels[rows], alone.visible_pixels)
        np.testing.assert_array_equal(together.kind[rows], alone.kind)
        assert (alone.kind == BoundKind.CERTIFIED).any()


def test_targets_hide_nothing_and_are_measured():
    sheet, wall = square(0.3, 1.0), square(0.3, 2.0)
    scene = joined(sheet, wall)
    marked = Mesh(
        scene.vertices, scene.faces, [Group("sheet", is_target=True), Group("wall")], [0, 0, 1, 1]
    )
    camera = CAMERAS["brown"]
    with open_observer(marked, camera) as observer:
        seen = observer.observe(np.eye(4)[None])
    np.testing.assert_allclose(seen.visible_pixels, seen.drawn_pixels, rtol=1e-12)
    with open_observer(wall, camera) as observer:
        alone = observer.observe(np.eye(4)[None])
    np.testing.assert_allclose(seen.visible_pixels[0, 2:], alone.visible_pixels[0], rtol=1e-12)


@pytest.mark.slow
def test_planes_of_a_lens_are_found_once():
    camera = replace(CAMERAS["brown"], fx=902)  # no other test has asked for its planes
    planes = planes_of(camera)
    assert planes_of(camera) is planes
    for other in (replace(camera, near=0.1), replace(camera, focus_range=(1.0, 6.0))):
        assert planes_of(other) is planes
        assert lens_of(other) is lens_of(camera)
    for changed in ({"fx": 901}, {"max_angle_deg": 20.0}, {"cy": 500.0}, {"width": 1281}):
        assert planes_of(replace(camera, **changed)) is not planes


@pytest.mark.parametrize("name", ["wide fisheye", "equirectangular"])
def test_planes_that_see_nothing_of_the_mesh_change_no_figure(name):
    mesh = shapes.torus(12, 16)
    poses = look_at([(0.0, 4.0, 1.0), (3.0, -2.0, 0.5)], [(0, 0, 0), (0.5, 0.5, 0)])
    poses[:, :3, :3] = poses[:, :3, :3] @ look_at((0, 0, 0), (0.3, 1, 0.2))[0][:3, :3]
    with open_observer(mesh, CAMERAS[name]) as observer:
        seen = observer.observe(poses)
    # Regions are looked for in all planes.
    other = room_for(len(poses), mesh.n_faces)
    RegionPass(mesh, CAMERAS[name]).find(Poses.of(poses), seen=other)
    for figure in ("visible_pixels", "drawn_pixels", "area_error", "kind"):
        np.testing.assert_array_equal(getattr(seen, figure), getattr(other, figure))
    assert seen.visible_pixels.max() > 0


@each_lens
def test_optics_keep_all_that_a_lens_is_made_of(name):
    near = replace(CAMERAS[name], near=0.5, focus_range=(1.0, 6.0))
    assert optics_of(near) == CAMERAS[name]


@pytest.mark.parametrize("seed", range(amount(12, 300)))
def test_areas_through_a_lens_are_0_or_more(seed):
    """Of needles and of faces parallel to the rays, whose sums of signed parts round below 0."""
    rng, n = np.random.default_rng(seed), 12
    corners = rng.normal(size=(n, 3, 3)) / 2 + (0, 0, 3)
    for k in range(0, n, 2):
        a, b = rng.uniform(0.3, 0.8, 2)
        middle = corners[k, 0] + a * (corners[k, 1] - corners[k, 0])
        needle = middle + rng.normal(size=3) * 10.0 ** -rng.integers(6, 17)
        corners[k, 2] = needle if k % 4 else a * corners[k, 0] + b * corners[k, 1]
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    mesh = mesh.with_groups(two_sided="all")
    for name in ("brown", "fisheye"):
        with open_observer(mesh, CAMERAS[name], "certified") as observer:
            seen = observer.observe(np.eye(4)[None])
        assert min(seen.visible_pixels.min(), seen.drawn_pixels.min()) >= 0
