"""Exact regions: what they hold, point by point, and how well their areas are known."""

import math
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest
from exact_cases import box
from exact_views import SEEDS, soup
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet, square
from surface_cases import (
    assert_pointwise,
    building,
    hostile_scene,
    in_regions,
    room,
    turned,
)

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.polygons import frames_of, to_plane, to_world
from rastercov.core.area.regions import OF_A_FACE, RegionPass
from rastercov.reference.regions import points_on

pytestmark = pytest.mark.native

AHEAD = np.eye(4)[None]
CAMERA = rc.Camera(width=200, height=200, fx=100, fy=100)
TASKS = {
    "visible": rc.Task(),
    "oblique": rc.Task(max_incidence_deg=60),
    "per m^2": rc.Task(min_pixels_per_m2=4000),
    "density": rc.Task(min_pixel_density=60),
    "facing": rc.Task(min_facing_density=120),
    "outside": rc.Task(max_incidence_deg=75, min_pixels_per_m2=900),
    "all": rc.Task(max_incidence_deg=70, min_pixels_per_m2=4000, min_pixel_density=55),
}


# --- what is covered ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "exact"])
@pytest.mark.parametrize(("scene", "task"), [*((room, t) for t in TASKS), (building, "outside")])
def test_a_point_is_in_a_region_exactly_if_it_meets_every_criterion(scene, task, method):
    assert_pointwise(*scene(), TASKS[task], 20_000, method=method)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(13, at_night=40)
def test_regions_of_hostile_scenes_hold_their_covered_points(seed):
    mesh, camera, pose = hostile_scene(seed)
    density = 10.0 ** np.random.default_rng(seed).uniform(-1, 3)
    for task in (
        rc.Task(),
        rc.Task(max_incidence_deg=50),
        rc.Task(min_pixel_density=density, min_pixels_per_m2=density**2 / 2),
        rc.Task(min_facing_density=density),
    ):
        assert_pointwise(mesh, camera, pose[None], task, 3000, seed % 1000)


@pytest.mark.slow
@given(seed=SEEDS, scale=st.sampled_from([1e-6, 1e-3, 1.0, 1e3, 1e6]))
@examples(7, at_night=20)
def test_regions_of_any_scale_hold_their_covered_points(seed, scale):
    mesh = soup(np.random.default_rng(seed), n=20)
    mesh = rc.Mesh(mesh.vertices * scale, mesh.faces)
    task = rc.Task(max_incidence_deg=65, min_pixel_density=20 / scale)
    camera = rc.Camera(width=640, height=480, fx=400, fy=420, focus_range=(4 * scale, 6 * scale))
    regions, _ = assert_pointwise(mesh, camera, AHEAD, task, 3000)
    assert regions.bound.sum() <= 1e-4 * mesh.areas.sum()


@pytest.mark.slow
@given(seed=SEEDS)
@examples(10, at_night=30)
def test_regions_of_hostile_scenes_have_the_visible_area_in_the_image(seed):
    mesh, camera, pose = hostile_scene(seed)
    assert_visible_area(mesh.with_groups(two_sided="all"), camera, pose[None])


def assert_visible_area(mesh, camera, poses):
    """The pieces, projected, have the area that the observer gives, within both bounds."""
    regions = rc.regions(mesh, camera, poses)
    with rc.open_observer(mesh, camera, threads=1) as observer:
        seen = observer.observe(poses)
    for row, pose in enumerate(poses):
        local = (regions.points() - pose[:3, 3]) @ pose[:3, :3]
        local[:, 2] = np.maximum(local[:, 2], 1e-12)  # rounded off the near plane
        image = local[:, :2] / local[:, 2:] * (camera.fx, camera.fy)
        area = np.zeros(mesh.n_faces)
        for piece in np.flatnonzero(regions.pose == row):
            u, v = image[regions.starts[piece] : regions.starts[piece + 1]].T
            u, v = u - u[0], v - v[0]
            area[regions.face[piece]] += abs(u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2
        # px^2 of a m^2, at the point of the face that is nearest to the camera
        corners = (mesh.vertices[mesh.faces] - pose[:3, 3]) @ pose[:3, :3]
        height = np.abs(np.einsum("fi,fi->f", corners[:, 0], mesh.normals @ pose[:3, :3]))
        near = max(camera.near, 1e-9)
        nearest = np.maximum(corners[..., 2].min(axis=1), near)
        per_m2 = camera.fx * camera.fy * height / nearest**3
        bound = seen.area_error[row] + regions.bounds()[row] * per_m2
        bound = bound + 1e-9 * seen.drawn_pixels[row] + 1e-12 * camera.width * camera.height
        is_known = regions.bounds()[row] < 0.01 * np.maximum(mesh.areas, 1e-300)
        off = np.abs(area - seen.visible_pixels[row])
        assert (off <= bound)[is_known].all(), (off - bound)[is_known].max()


def test_moving_mesh_and_camera_together_changes_nothing():
    mesh, camera, poses = room()
    task = TASKS["all"]
    there, theirs = turned(mesh, poses)
    here = rc.regions(mesh, camera, poses, task)
    moved = rc.regions(there, camera, theirs, task)
    off = np.abs(here.areas() - moved.areas())
    assert (off <= here.bounds() + moved.bounds() + 1e-12 * mesh.areas).all()
    assert off.sum() <= 1e-6 * mesh.areas.sum()


def test_threads_change_no_bit():
    mesh, camera, poses = room()
    one, two = (rc.regions(mesh, camera, poses, TASKS["all"], threads=n) for n in (1, 2))
    for name in ("xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


def test_regions_come_in_batches_of_poses():
    mesh, camera, poses = room()
    finder = RegionPass(mesh, camera, threads=1)
    batches = list(finder.batches(rc.Poses.of(poses)))
    assert np.concatenate([batch.pose_ids for batch in batches]).tolist() == list(range(6))
    (empty,) = finder.batches(rc.Poses.of(np.empty((0, 4, 4))))
    assert len(empty) == 0
    assert empty.areas().shape == (0, mesh.n_faces)


# --- sides, groups, planes ------------------------------------------------------------------------


def test_the_back_of_a_face_is_covered_only_if_its_group_is_two_sided():
    front = square(0.5, 2)
    back = rc.Mesh(front.vertices, front.faces[:, ::-1])
    assert math.isclose(rc.regions(front, CAMERA, AHEAD).area.sum(), 1, rel_tol=1e-12)
    assert len(rc.regions(back, CAMERA, AHEAD)) == 0
    task = rc.Task(max_incidence_deg=10, min_pixel_density=50 * 0.99)
    for mesh in (front, back.with_groups(two_sided="all")):
        points, face = points_on(mesh, 2000)
        regions = rc.regions(mesh, CAMERA, AHEAD, task)
        inside = in_regions(regions, 0, points, face)
        assert math.isclose(inside.mean(), math.pi * (2 * math.tan(math.radians(10))) ** 2,
                            abs_tol=0.02)  # fmt: skip


def test_the_incidence_region_of_a_wall_is_a_disc():
    wall = sheet((-4, -4), (4, 4), 2)
    for degrees in (10, 30, 44):
        regions = rc.regions(wall, CAMERA, AHEAD, rc.Task(max_incidence_deg=degrees))
        exact = math.pi * (2 * math.tan(math.radians(degrees))) ** 2
        area, bound = regions.area.sum(), regions.bound.sum()
        assert exact - bound <= area <= exact + 1e-12
        assert bound < 1e-4 * exact


@pytest.mark.parametrize(
    ("camera", "task", "low", "high"),
    [
        (CAMERA, rc.Task(min_pixels_per_m2=100 * 100 / 8.0**3), 1, 8),  # reached at z = 8
        (replace(CAMERA, near=2.0, focus_range=(1.0, 5.0)), rc.Task(), 2, 5),
    ],
    ids=["density", "near plane and focus"],
)
def test_depths_cut_a_slanted_face_along_lines(camera, task, low, high):
    floor = rc.Mesh([(-50, 1, -9), (50, 1, -9), (50, 1, 99), (-50, 1, 99)], [(0, 2, 1), (0, 3, 2)])
    regions = rc.regions(floor.with_groups(two_sided="all"), camera, AHEAD, task)
    assert math.isclose(regions.points()[:, 2].max(), high, rel_tol=1e-9)
    assert math.isclose(regions.area.sum(), high**2 - low**2, rel_tol=1e-9)  # |x| <= z


def test_occluders_hide_and_have_no_regions():
    mesh = joined(square(0.25, 1), square(0.5, 2))
    groups = [rc.Group("plate", is_occluder=True), rc.Group("wall")]
    regions = rc.regions(rc.Mesh(mesh.vertices, mesh.faces, groups, [0, 0, 1, 1]), CAMERA, AHEAD)
    assert set(regions.face.tolist()) <= {2, 3}
    assert regions.area.sum() <= 1e-12  # at half the distance, half the size hides all


def test_a_camera_in_the_plane_of_a_face_covers_nothing_of_it():
    mesh = box((-1, -1, 2), (1, 1, 4))
    pose = np.eye(4)[None].copy()
    pose[0, :3, 3] = (1, 0, 0)  # in the plane x = 1 of two faces
    regions = rc.regions(mesh, CAMERA, pose)
    in_plane = np.abs(mesh.normals[:, 0] - 1) < 1e-12
    assert in_plane.sum() == 2
    assert not regions.areas()[0, in_plane].any()
    task = rc.Task(max_incidence_deg=89)
    assert not rc.regions(mesh, CAMERA, pose, task).bounds()[0, in_plane].any()


def test_pieces_are_convex_counter_clockwise_and_in_their_faces():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses, TASKS["all"])
    corners = frames_of(mesh).corners
    counts = np.diff(regions.starts)
    assert counts.min() >= 3
    assert counts.max() <= 20
    for piece in range(0, len(regions), 7):
        polygon = regions.xy[regions.starts[piece] : regions.starts[piece + 1]]
        sides = np.roll(polygon, -1, axis=0) - polygon
        nexts = np.roll(sides, -1, axis=0)
        assert (sides[:, 0] * nexts[:, 1] - sides[:, 1] * nexts[:, 0] >= -1e-12).all()
        face = corners[regions.face[piece]]
        edges = np.roll(face, -1, axis=0) - face
        away = polygon[:, None] - face
        assert (edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] >= -1e-12).all()


def test_plane_coordinates_lead_to_space_and_back():
    mesh, _, _ = building()
    points, face = points_on(mesh, 1000)
    assert np.allclose(to_world(mesh, face, to_plane(mesh, face, points)), points, atol=1e-12)
    frames = frames_of(mesh)
    assert np.allclose(np.cross(frames.x_axis, frames.y_axis), mesh.normals, atol=1e-12)
    assert np.allclose(frames.areas, mesh.areas, rtol=1e-12)
    assert (frames.corners[:, 2, 0] >= 0).all()


# --- thresholds -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("threshold", "value"),
    [
        ("min_pixels", 10.0),
        ("min_visibility", 0.5),
        ("min_coverage", 0.1),
        ("focus_rule", "centroid"),
        ("cap_resolution", False),
    ],
)
def test_a_threshold_of_a_face_is_refused_by_name(threshold, value):
    with pytest.raises(ConfigError, match=f"{threshold} applies to faces"):
        rc.regions(square(1, 2), CAMERA, AHEAD, rc.Task(**{threshold: value}))
    assert threshold in OF_A_FACE


def test_counting_samples_has_no_regions():
    with pytest.raises(ConfigError, match="method certified or exact, got sampled"):
        rc.regions(square(1, 2), CAMERA, AHEAD, method="sampled")


@pytest.mark.slow
def test_ctrl_c_ends_a_long_run_between_two_poses():
    mesh, camera, poses = room()
    many = np.repeat(poses, 5000, axis=0)
    finder = RegionPass(mesh, camera, TASKS["all"], threads=2)
    finder.find(rc.Poses.of(poses))  # loads the compiled loops
    # A shell starts what runs in the background with interrupts ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.5, signal.raise_signal, [signal.SIGINT])
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            finder.find(rc.Poses.of(many))
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    assert len(finder.find(rc.Poses.of(poses))) > 0
