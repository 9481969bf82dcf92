"""Laser lines: by rays of each point at its moment, laws of sweeps, and what is refused."""

import numpy as np
import pytest
from sweep_rays import CAMERA, LASER, TASK, along_x, around_z, head, measured, parts, start

import rastercov as rc
from rastercov.core.area import polygons
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh.arrays import rotation_about
from rastercov.reference.regions import points_on
from rastercov.sensors.laser import _between, _with_sheet

MESH = parts()
LENGTH = 0.3 + 2e-9


def straight(n):
    path = np.tile(np.eye(4), (n + 1, 1, 1))
    path[:, 0, 3] = np.linspace(0, LENGTH, n + 1)
    return path @ start(-0.15 - 1e-9)


def turned(n):
    path = np.tile(np.eye(4), (n, 1, 1))
    for row, angle in enumerate(np.linspace(0, 2 * np.pi, n, endpoint=False)):
        path[row, :3, :3] = rotation_about((0, 0, 1), angle)
    return np.concatenate([path, path[:1]]) @ start(0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "moments", "first"), [(straight, along_x, start()), (turned, around_z, start(0.01))]
)
def test_stations_are_near_rays_and_say_how_near(path, moments, first):
    rig = head()
    points, face = points_on(MESH, 150_000)
    truth = 100 * measured(MESH, rig, moments(points, first), TASK, points, face).mean()
    assert 5 < truth < 95
    off = {}
    for n in (16, 32):
        result = rc.LaserLine.of(MESH, rig, path(n), TASK)
        off[n] = abs(result.percent - truth)
        assert result.stations == n
        assert str(result) == (
            f"{result.percent:.3f} % of the area by {n} stations; at {2 * n}: "
            f"{result.doubled_percent - result.percent:+.3f} percentage points"
        )
    assert off[32] <= 0.05
    assert off[16] <= 0.05


def test_doubling_is_what_twice_the_stations_give():
    few, many = (rc.LaserLine.of(MESH, head(), straight(n), TASK) for n in (4, 8))
    assert few.doubled_percent == pytest.approx(many.percent, abs=1e-9)
    assert few.percent != many.percent


def test_a_path_backwards_and_a_moved_scene_give_the_same():
    rig, path = head(), straight(5)
    there = rc.LaserLine.of(MESH, rig, path, TASK).regions.areas()
    back = rc.LaserLine.of(MESH, rig, path[::-1], TASK).regions.areas()
    assert np.allclose(there, back, atol=1e-12)
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = rotation_about((1, 2, 3), 1.1), (3, -2, 5)
    moved = rc.Mesh(MESH.vertices @ move[:3, :3].T + move[:3, 3], MESH.faces)
    there = rc.LaserLine.of(MESH, rig, path, TASK).percent
    assert rc.LaserLine.of(moved, rig, move @ path, TASK).percent == pytest.approx(there, abs=1e-6)


def test_nothing_is_measured_twice_and_all_that_the_sheets_pass_is_looked_at():
    """A plate alone, seen by both all over: what is measured is what the sheet goes over."""
    plate = rc.Mesh(
        [(-1, -0.1, 0), (1, -0.1, 0), (1, 0.1, 0), (-1, 0.1, 0)], [(0, 1, 2), (0, 2, 3)]
    )
    for n in (1, 3, 17, 40):
        result = rc.LaserLine.of(plate, head(), straight(n), TASK)
        if n > 3:  # the camera looks at the sheet, and sees wide stations in part
            assert result.regions.area.sum() == pytest.approx(0.3 * 0.2, rel=1e-7)
        assert result.regions.bound.sum() < 1e-9


def test_a_fixed_camera_beside_a_moving_laser_is_of_the_rule():
    rig = head()
    places = np.stack([np.eye(4), look_at([(0, -0.6, 0.8)], (0, 0, 0))[0]])
    own = rc.Rig([LASER, CAMERA], ["laser", "camera"], places, rule=rc.All(), tasks=rig.tasks,
                 fixed=["camera"])  # fmt: skip
    result = rc.LaserLine.of(MESH, own, straight(24), TASK)
    points, face = points_on(MESH, 40_000)
    laser = rc.Rig([LASER], ["laser"], tasks=rig.tasks)
    lit = measured(MESH, laser, along_x(points, start()), TASK, points, face)
    still = rc.Rig([CAMERA], ["camera"])
    seen = measured(MESH, still, [np.tile(places[1], (len(points), 1, 1))], TASK, points, face)
    assert result.percent == pytest.approx(100 * (lit & seen).mean(), abs=0.15)


def test_half_of_a_screw_twice_is_the_screw():
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (40, 1, 1))
    for pose in poses:
        pose[:3, :3] = rotation_about(rng.normal(size=3), rng.uniform(-0.7, 0.7))
        pose[:3, 3] = rng.normal(size=3)
    half = np.linalg.inv(poses[:-1]) @ _between(poses)
    assert np.allclose(poses[:-1] @ half @ half, poses[1:], atol=1e-12)


def test_clipped_polygons_are_the_parts_of_a_half_plane():
    rng = np.random.default_rng(1)
    angles = np.sort(rng.uniform(0, 2 * np.pi, (60, 7)), axis=1)
    xy = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(-1, 2)
    starts = np.arange(0, 421, 7)
    values = xy @ (0.6, -0.8) - 0.1
    values[::11] = 0.0  # as if corners were on the line
    whole = polygons.polygon_areas(xy, starts)
    parts = [polygons.clip_polygons(xy, starts, sign * values) for sign in (1.0, -1.0)]
    for part, corners, rows in parts:
        assert (np.diff(corners) >= 3).all()
        assert (polygons.polygon_areas(part, corners) >= -1e-15).all()
        assert rows.max() < 60
    values = xy @ (0.6, -0.8) - 0.1
    parts = [polygons.clip_polygons(xy, starts, sign * values) for sign in (1.0, -1.0)]
    sums = sum(np.bincount(rows, polygons.polygon_areas(p, s), 60) for p, s, rows in parts)
    assert np.allclose(sums, whole, atol=1e-14)
    assert len(polygons.clip_polygons(np.empty((0, 2)), np.zeros(1, np.int64), np.empty(0))[2]) == 0


def test_polygons_of_many_corners_are_divided():
    turn = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    xy, starts = np.concatenate([circle, circle[::10]]), np.array([0, 50, 55])
    with_few_corners, ends, polygon = polygons.with_few_corners(xy, starts)
    assert np.diff(ends).max() <= polygons.MOST_CORNERS
    assert polygon.tolist() == [0, 0, 0, 1]
    sums = np.bincount(polygon, polygons.polygon_areas(with_few_corners, ends))
    assert np.allclose(sums, polygons.polygon_areas(xy, starts))


def bad(**changes):
    rig = head()
    given = {"cameras": rig.cameras, "names": rig.names, "rig_from_camera": rig.rig_from_camera,
             "rule": rig.rule, "tasks": rig.tasks} | changes  # fmt: skip
    return rc.Rig(**given)


TURNS = np.tile(np.eye(4), (2, 1, 1))
TURNS[1, :3, :3] = rotation_about((0, 0, 1), 2.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rig": bad(tasks={})}, "max_incidence_deg below 90"),
        ({"rig": bad(tasks={"laser": rc.Task()})}, "max_incidence_deg below 90"),
        ({"rig": bad(tasks={"laser": rc.Task(max_incidence_deg=70, min_pixels_per_m2=1)})},
         "expected no pixel density"),
        ({"rig": bad(rule=rc.Any())}, "with a rule"),
        ({"rig": CAMERA}, "expected a Rig"),
        ({"laser": "sheet"}, "got 'sheet'"),
        ({"rig": bad(cameras=[rc.Camera.preset("vlp16"), CAMERA])}, "pinhole"),
        ({"path": straight(1)[:1]}, "2 to 4097 poses of the rig, got 1"),
        ({"path": TURNS}, "90 degrees"),
        ({"path": np.full((3, 4, 4), np.nan)}, "finite"),
        ({"method": "sampled"}, "sampled"),
        ({"task": rc.Task(min_pixels=3)}, "min_pixels"),
    ],
)  # fmt: skip
def test_what_is_no_laser_line_is_refused_in_one_line(change, words):
    given = {"rig": head(), "path": straight(2), "task": TASK, "laser": "laser"} | change
    with pytest.raises(rc.RastercovError, match=words) as error:
        rc.LaserLine.of(MESH, given.pop("rig"), given.pop("path"), given.pop("task"), **given)
    assert "\n" not in str(error.value)


def test_the_sheet_that_is_swept_has_the_noise_of_the_laser():
    rule = rc.All(max_uncertainty=1e-3, noise_px=0.3)
    own = rc.Rig([LASER, CAMERA], ["laser", "camera"], rule=rule, tasks=head().tasks)
    assert _with_sheet(own, "laser", TASK).gates == own.gates
    assert own.gates[0].noise[0] == pytest.approx(0.3 / min(LASER.fx, LASER.fy))
