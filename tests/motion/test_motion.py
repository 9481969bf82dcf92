"""Coverage over time: regions of moving bodies, on the mesh at rest, and counts of frames."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import joined as joined_meshes
from surface_cases import building
from timed import over_time, regions_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError, MeshError
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.table import join

CAMERA = rc.Camera(width=200, height=160, fx=150, fy=150)
TASK = rc.Task(max_incidence_deg=75)


def part_and_screen():
    """A part at the origin, and a plate that may be before it."""
    part = rc.shapes.icosahedron()
    plate = rc.Mesh([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], [(0, 1, 2), (0, 2, 3)])
    mesh = joined_meshes(part, plate)
    labels = np.repeat([0, 1], [part.n_faces, plate.n_faces])
    return rc.Mesh(mesh.vertices, mesh.faces, [rc.Group("part"), rc.Group("plate")], labels)


def ico():
    return rc.shapes.by_name("icosahedron")


ABOVE = rc.look_at(eyes=[(0.3, 0.2, 4)], targets=(0, 0, 0), up=(0, 1, 0))


def test_a_motion_that_moves_nothing_gives_the_regions_to_the_bit():
    mesh, camera, poses = building()
    motion = rc.Motion(mesh, {"mesh": np.eye(4)[None]})
    regions, still = regions_over_time(motion, camera, poses, TASK), rc.regions(
        mesh, camera, poses, TASK)  # fmt: skip
    for name in ("xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound"):
        assert getattr(regions, name).tobytes() == getattr(still, name).tobytes()


def test_a_frame_is_a_mesh_of_moved_vertices():
    mesh = part_and_screen()
    motion = rc.Motion(mesh, {"plate": rc.conveyor(4, direction=(1, 0, 0), distance=3)})
    result = regions_over_time(motion, CAMERA, ABOVE, TASK).areas()
    for row in range(4):
        moved = mesh.moved(translation=(row, 0, 0), groups=["plate"])
        areas = rc.regions(moved, CAMERA, ABOVE, TASK).areas()[0]
        assert np.abs(result[row] - areas).max() <= 1e-9 * mesh.areas.sum()
    assert result[3, :-2].sum() > result[0, :-2].sum()


@pytest.mark.parametrize("name", ["icosahedron", "sphere", "box", "torus"])
def test_a_part_on_a_turntable_is_a_camera_that_is_turned(name):
    mesh, steps = rc.shapes.by_name(name), 8
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    eye = mesh.bounds.mean(axis=0) + size * np.array((1.1, 0.7, 0.5))
    pose = rc.look_at(eyes=[eye], targets=mesh.bounds.mean(axis=0))
    table = rc.turntable(steps, centre=(0.1, 0.2, 0))
    motion = rc.Motion(mesh, {"mesh": table})
    regions = regions_over_time(motion, CAMERA, pose, TASK)
    turned = rc.regions(mesh, CAMERA, np.linalg.inv(table) @ pose, TASK)
    total = mesh.areas.sum()
    for k in range(1, steps + 1):
        areas = [each.at_least(k, one_side=False).area.sum() for each in (regions, turned)]
        assert abs(areas[0] - areas[1]) <= 1e-6 * total


def test_frames_of_faces_are_turned_and_not_chosen_anew():
    mesh = ico()
    motion = rc.Motion(mesh, {"mesh": rc.turntable(5, axis=(0.3, 0.5, 0.8))})
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    others = 0
    for row in range(1, 5):
        moved = motion.frame(row)[0]
        x_axis = frames_of(mesh).x_axis @ motion.world_from_body[row, 1, :3, :3].T
        anew = frames_of(rc.Mesh(moved.vertices, moved.faces)).x_axis
        others += int((np.abs(x_axis - anew).max(axis=1) > 1e-6).sum())
    assert others > 0  # rounding decides between equal edges
    assert regions.mesh is mesh


def test_without_frames_at_rest_counts_of_an_icosahedron_would_be_wrong():
    mesh, steps = ico(), 8
    motion = rc.Motion(mesh, {"mesh": rc.turntable(steps, axis=(1, 2, 3))})
    pose = rc.look_at(eyes=[(0.3, 0.2, 4)], targets=(0, 0, 0), up=(0, 1, 0))
    task = rc.Task(max_incidence_deg=25)  # arcs cut the faces
    right = regions_over_time(motion, CAMERA, pose, task)
    anew = []
    for row in range(steps):
        moved = motion.frame(row)[0]
        plain = rc.Mesh(moved.vertices, moved.faces)
        regions = rc.regions(plain, CAMERA, pose, task)
        anew.append(replace(regions, mesh=mesh))
    wrong = join(anew)
    total, gaps = mesh.areas.sum(), []
    for k in range(1, steps + 1):
        areas = [each.at_least(k, one_side=False).area.sum() for each in (right, wrong)]
        gaps.append(abs(areas[0] - areas[1]) / total)
    assert wrong.area.sum() == pytest.approx(right.area.sum(), rel=1e-5)
    assert max(gaps) > 1e-3


def test_too_many_pictures_at_a_time_are_refused():
    motion = rc.Motion(ico(), {"mesh": rc.turntable(5001)})
    with pytest.raises(ConfigError, match="10,000 images"):
        regions_over_time(motion, CAMERA, np.repeat(ABOVE, 2, axis=0), TASK)


def test_areas_fall_with_the_number_of_frames_and_add_up():
    mesh = part_and_screen()
    motion = rc.Motion(mesh, {"plate": rc.conveyor(5, direction=(1, 0.2, 0), distance=4)})
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    areas = [regions.at_least(k, one_side=False).area.sum() for k in range(1, 6)]
    assert areas == sorted(areas, reverse=True)
    assert sum(areas) == pytest.approx(regions.area.sum(), rel=1e-9)
    some, always = (over_time(regions, motion, over).area.sum() for over in ("some", "all"))
    assert (some, always) == pytest.approx((areas[0], areas[4]), abs=1e-12)
    assert over_time(regions, motion, 0.5).area.sum() == pytest.approx(areas[2], abs=1e-12)
    assert always < some


def test_a_body_that_is_absent_is_not_there():
    mesh = part_and_screen()
    motion = rc.Motion(mesh, {"plate": np.eye(4)}, present={"plate": [False]})
    result = regions_over_time(motion, CAMERA, ABOVE, TASK).areas()[0]
    alone = rc.Mesh(mesh.vertices, mesh.faces[:-2])
    areas = rc.regions(alone, CAMERA, ABOVE, TASK).areas()[0]
    assert np.abs(result[:-2] - areas).max() <= 1e-12
    assert not result[-2:].any()


def test_always_is_of_the_frames_in_which_a_body_is_there():
    mesh, there = part_and_screen(), [True, False, False, True]
    still = np.tile(np.eye(4), (4, 1, 1))
    motion = rc.Motion(mesh, {"plate": still}, present={"plate": there})
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    always = over_time(regions, motion, "all").areas()[0]
    still_there = rc.regions(mesh, CAMERA, ABOVE, TASK).areas()[0]
    assert np.allclose(always, still_there, atol=1e-9)


def test_a_camera_on_a_body_moves_with_it():
    mesh = part_and_screen()
    table = rc.turntable(6, axis=(0, 1, 0))
    motion = rc.Motion(mesh, {"part": table, "plate": table})
    areas = regions_over_time(motion, CAMERA, ABOVE, TASK, body="part").areas()
    assert np.abs(areas - areas[0]).max() <= 1e-7 * mesh.areas.sum()


def test_heads_are_measured_together_in_each_frame():
    mesh = part_and_screen()
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.4
    rig = rc.Rig([CAMERA] * 2, None, places, rule=rc.All())
    motion = rc.Motion(mesh, {"plate": rc.conveyor(3, direction=(1, 0, 0), distance=3)})
    regions = regions_over_time(motion, rig, rig.poses(ABOVE), TASK)
    assert len(regions.pose_ids) == 3
    moved = mesh.moved(translation=(3, 0, 0), groups=["plate"])
    last = rc.regions(moved, rig, rig.poses(ABOVE), TASK).areas()[0]
    assert np.abs(regions.areas()[2] - last).max() <= 1e-9


TWO = np.tile(np.eye(4), (2, 1, 1))
SHEARED = np.eye(4) + np.eye(4, k=1) * 0.1


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: rc.Motion(m, {}), "bodies to be"),
        (lambda m: rc.Motion(m, {"lid": np.eye(4)}), "lid"),
        (lambda m: rc.Motion(m, {"part": SHEARED}), "rigid"),
        (lambda m: rc.Motion(m, {"part": np.eye(4) * np.nan}), "rigid"),
        (lambda m: rc.Motion(m, {"part": np.diag((1.0, 1, -1, 1))}), "rigid"),
        (lambda m: rc.Motion(m, {"part": np.eye(3)}), "shape"),
        (lambda m: rc.Motion(m, {"part": TWO, "plate": np.tile(np.eye(4), (3, 1, 1))}), "as many"),
        (lambda m: rc.Motion(m, {"part": TWO}, present={"lid": [1, 1]}), "present to name bodies"),
        (lambda m: rc.Motion(m, {"part": TWO}, present={"part": [True]}), "True or False"),
        (lambda m: rc.turntable(0), "steps"),
        (lambda m: rc.turntable(3, axis=(0, 0, 0)), "direction"),
        (lambda m: rc.turntable(3, degrees=float("inf")), "finite"),
        (lambda m: rc.conveyor(2.5, direction=(1, 0, 0), distance=1), "steps"),
        (lambda m: rc.conveyor(2, direction=(0, 0, 0), distance=1), "zero"),
    ],
)
def test_motions_that_cannot_be_are_refused_in_one_line(make, words):
    with pytest.raises((ConfigError, MeshError), match=words) as error:
        make(part_and_screen())
    assert "\n" not in str(error.value)


def test_times_that_cannot_be_are_refused():
    mesh = part_and_screen()
    motion = rc.Motion(mesh, {"part": TWO})
    regions = regions_over_time(motion, CAMERA, ABOVE, TASK)
    for over in (0.0, 1.5, "ever", -1):
        with pytest.raises(ConfigError, match="over"):
            over_time(regions, motion, over)
    with pytest.raises(ConfigError, match="expected a body"):
        regions_over_time(motion, CAMERA, ABOVE, TASK, body="tool")
    with pytest.raises(ConfigError, match="got those of another"):
        over_time(rc.regions(ico(), CAMERA, ABOVE), motion)


def test_questions_of_a_motion_that_cannot_be_are_refused_before_the_work(monkeypatch):
    motion = rc.Motion(part_and_screen(), {"plate": rc.turntable(3)})
    mesh, many = motion.mesh, rc.Motion(motion.mesh, {"plate": rc.turntable(5001)})
    monkeypatch.setattr("rastercov.core.coverage.job.open_for", lambda *_: pytest.fail("opened"))
    for mesh_of, asked, task, by, words in (
        (
            ico(),
            motion,
            TASK,
            None,
            "the mesh of the motion, at rest, got another; give motion.mesh",
        ),
        (
            mesh,
            motion,
            rc.Task(min_pixels=3),
            None,
            "by area, got one by face; min_pixels applies",
        ),
        (mesh, motion, rc.Task(min_angle_deg=5), None, "expected no min_angle_deg over time"),
        (mesh, motion, TASK, "face", "by area, got one by face; leave out 'by'"),
        (mesh, rc.MotionQuery(motion, body="plat"), TASK, None, "got 'plat'"),
        (mesh, rc.MotionQuery(motion, body=["plate"] * 2), TASK, None, "one for each of 1 camera"),
        (mesh, many, TASK, None, r"5,001 frames of 2 cameras; .* evaluate with a folder"),
    ):
        with pytest.raises(ConfigError, match=words):
            rc.evaluate(mesh_of, CAMERA, np.repeat(ABOVE, 2, axis=0), task, motion=asked, by=by)
    for options, words in (
        ({"motion": 3}, "motion to be a Motion or MotionQuery, got 3"),
        (
            {"motion": motion, "method": "sampled:cpu"},
            "by area, got one by face; method sampled",
        ),
    ):
        with pytest.raises(ConfigError, match=words):
            rc.evaluate(mesh, CAMERA, ABOVE, TASK, **options)
    with pytest.raises(ConfigError, match="expected the mesh of the motion"):
        rc.regions(ico(), CAMERA, ABOVE, TASK, motion=motion)
    for over, views_at in ((0, "one time"), ("always", "one time"), ("some", "now")):
        with pytest.raises(ConfigError, match=r"over to be|views_at to be"):
            rc.MotionQuery(motion, over, views_at)


def test_a_motion_in_which_nothing_moves_has_the_areas_of_none():
    mesh = part_and_screen()
    still = rc.evaluate(mesh, CAMERA, ABOVE, TASK)
    motion = rc.Motion(mesh, {"plate": np.eye(4)})
    result = rc.evaluate(mesh, CAMERA, ABOVE, TASK, motion=motion)
    assert np.abs(result.covered.area - still.covered.area).max() <= 1e-12
    assert result.over_time.share() == pytest.approx(still.areas.summary()["percent"] / 100)
    assert np.array_equal(result.reason, still.reason)  # of the mesh at rest
    with pytest.raises(ConfigError, match="got a static scene; give motion="):
        _ = still.over_time
