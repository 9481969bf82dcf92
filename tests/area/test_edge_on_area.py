"""Areas of cameras in the planes of faces: edge-on is nothing, and what is in doubt only adds."""

import json

import numpy as np
import pytest
from exact_cases import box
from exact_views import exact_sides
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from scenes import joined
from timed import regions_over_time

import rastercov as rc
from rastercov.placement.plan.check import check
from rastercov.placement.plan.file import read_plan

CUBE = box((0, 0, 0), (1, 1, 1))
CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=60)
WIDE = rc.Camera(width=640, height=480, fx=300, fy=300, model="opencv_fisheye")
PANORAMA = rc.Camera(width=720, height=360, fx=360 / np.pi, fy=360 / np.pi, model="equirectangular")
IN_PLANE = np.eye(4)
IN_PLANE[:3, 3] = 0, 0.5, -3
"""A camera before the front of the cube, exactly in the plane of its side x = 0."""


def covered(mesh, camera, poses, task=None, **options):
    result = rc.evaluate(mesh, camera, poses, task or rc.Task(), by="area", **options)
    return result.areas.summary()


def turned(angle):
    """The cube and the camera rotated by an angle and moved: in the plane but for rounding."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1.0)])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, rotation @ IN_PLANE[:3, 3] + (0.1, 0.2, 0.3)
    return rc.Mesh(CUBE.vertices @ rotation.T + (0.1, 0.2, 0.3), CUBE.faces), pose


def warehouse():
    """A floor of 20 x 20 m and six shelves 2 m high: edges at whole metres."""
    shelves = [box((x, y, 0), (x + 6, y + 1, 2)) for x in (2, 11) for y in (3, 9, 15)]
    floor = rc.Mesh([(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0)], [(0, 1, 2), (0, 2, 3)])
    return joined(floor, *shelves)


@pytest.mark.parametrize("camera", [CAMERA, WIDE, PANORAMA], ids=lambda camera: camera.model)
@pytest.mark.parametrize("method", ["certified", "exact"])
def test_a_cube_seen_from_the_plane_of_a_side_shows_its_front(camera, method):
    is_covered = covered(CUBE, camera, IN_PLANE[None], method=method)
    assert is_covered["m2"] == pytest.approx(1.0, abs=1e-5)
    assert is_covered["bound_m2"] < 6e-5
    assert "doubtful_m2" not in is_covered


@pytest.mark.parametrize("height", [2.0, 2.1])
def test_cameras_at_the_height_of_shelves_have_no_bound_of_their_tops(height):
    eyes = [(10, 0.2, height), (0.2, 10, height)]  # y = 10 is the plane of sides, too
    poses = rc.look_at(eyes, [(10, 10, 0)] * 2)
    is_covered = covered(warehouse(), CAMERA, poses)
    steep = covered(warehouse(), CAMERA, poses, rc.Task(max_incidence_deg=89.99))
    assert is_covered["bound_m2"] < 1e-6 * is_covered["of_m2"]
    assert steep["m2"] - steep["bound_m2"] <= is_covered["m2"] + is_covered["bound_m2"]
    if height == 2.0:
        assert is_covered["m2"] == pytest.approx(164.2469, abs=1e-3)  # 164.3 +- 0.44 by points


@given(angle=st.floats(0, 6.25))
@examples(13, at_night=40)
def test_what_is_in_doubt_by_rounding_adds_to_the_upper_end_alone(angle):
    mesh, pose = turned(angle)
    is_covered = covered(mesh, CAMERA, pose[None])
    assert is_covered["m2"] - is_covered["bound_m2"] == pytest.approx(1.0, abs=6e-5)
    assert is_covered["bound_m2"] < 6e-5
    is_before = (exact_sides(mesh, pose)[:2] > 0).any()
    most = is_covered["m2"] + is_covered["bound_m2"] + is_covered.get("doubtful_m2", 0.0)
    assert most >= 1.0 + mesh.areas[:2][exact_sides(mesh, pose)[:2] > 0].sum() - 1e-9
    assert is_before == ("doubtful_m2" in is_covered)


def before_by_rounding():
    """A cube and a camera before the plane of its side x = 0 by less than rounding."""
    for angle in np.linspace(0.1, 6, 200):
        mesh, pose = turned(angle)
        if (exact_sides(mesh, pose)[:2] > 0).all():
            return mesh, pose
    raise AssertionError("no angle rounds that way")


def test_what_another_camera_covers_is_not_in_doubt():
    mesh, pose = before_by_rounding()
    side = mesh.vertices[mesh.faces[:2]].mean(axis=(0, 1))
    normal = mesh.normals[0]
    other = rc.look_at(side + 3 * normal, side, (0, 0, 1))[0]
    alone, both = (covered(mesh, CAMERA, np.array(each)) for each in ([pose], [pose, other]))
    assert alone["doubtful_m2"] == pytest.approx(1.0)
    assert both["m2"] == pytest.approx(2.0, abs=1e-4)
    assert both["bound_m2"] < 1e-4
    assert both.get("doubtful_m2", 0.0) < 1e-9


def test_what_is_seen_in_part_stays_certain_beside_a_doubt_of_another_camera():
    mesh, pose = before_by_rounding()
    side = mesh.vertices[mesh.faces[:2]].mean(axis=(0, 1))
    near = rc.look_at(side + 0.5 * mesh.normals[0], side, (0, 0, 1))[0]
    alone, both = (covered(mesh, CAMERA, np.array(each)) for each in ([near], [pose, near]))
    assert 0.1 < alone["m2"] < 0.9
    certain = both["m2"] - both["bound_m2"]
    assert certain == pytest.approx(1 + alone["m2"], abs=1e-4)
    assert both["doubtful_m2"] == pytest.approx(1 - alone["m2"], abs=1e-4)


def test_groups_and_several_views_have_the_doubt_of_their_own_faces():
    mesh, pose = before_by_rounding()
    groups = [rc.Group("side"), rc.Group("rest")]
    parted = rc.Mesh(mesh.vertices, mesh.faces, groups, [0, 0] + [1] * 10)
    summary = rc.evaluate(parted, CAMERA, np.array([pose, pose]), rc.Task(views=2), by="area")
    side, rest = (each["covered_area"] for each in summary.summary()["groups"])
    assert side["m2"] == side["bound_m2"] == 0
    assert side["doubtful_m2"] == pytest.approx(1.0)
    assert "doubtful_m2" not in rest
    assert rest["m2"] == pytest.approx(1.0, abs=1e-4)


def test_a_moved_body_is_edge_on_by_its_moved_coordinates():
    shifts = 0.0, 0.25, 0.1, 0.3, -0.7
    moves = np.tile(np.eye(4), (len(shifts), 1, 1))
    moves[:, 0, 3] = shifts
    motion = rc.Motion(CUBE, {"mesh": moves})
    for row, shift in enumerate(shifts):
        pose = IN_PLANE.copy()
        pose[0, 3] = shift
        regions = regions_over_time(motion, CAMERA, pose[None], rc.Task())
        own = regions.of_poses(np.arange(len(shifts)) == row)
        side = exact_sides(motion.frame(row)[0], pose)
        unseen = side <= 0
        assert unseen[:2].all()  # coordinates 0 + shift are the eye's
        assert (own.bounds()[0][unseen] == 0).all()
        assert own.area.sum() == pytest.approx(1.0, abs=1e-5)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_faces_whose_plane_has_the_eye_have_neither_area_nor_bound(seed):
    rng = np.random.default_rng(seed)
    low = rng.integers(-4, 5, (3, 3)) / 2
    mesh = joined(*(box(at, at + rng.integers(1, 5, 3) / 2) for at in low))
    eyes = rng.integers(-8, 9, (6, 3)) / 2
    poses = np.array([rc.look_at(eye, eye + rng.normal(size=3))[0] for eye in eyes])
    for camera in (CAMERA, WIDE):
        regions = rc.regions(mesh, camera, poses)
        for row, pose in enumerate(poses):
            unseen = exact_sides(mesh, pose) <= 0
            assert (regions.areas()[row][unseen] == 0).all()
            assert (regions.bounds()[row][unseen] == 0).all()
        assert (regions.excess == regions.bound).all()


def test_check_holds_by_what_is_certain(tmp_path):
    mesh, pose = before_by_rounding()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    (tmp_path / "cube.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "plan.toml").write_text(
        '[[meshes]]\npath = "cube.obj"\nunit = "m"\n[camera]\nwidth = 640\nheight = 480\n'
        "hfov_deg = 60\n[selection]\ngoal = 'best_coverage'\ncameras = 1\n"
        '[[candidates]]\ngenerator = "on_sphere"\ncentre = [0, 0, 0]\ndistances = [3]\ncount = 6\n'
    )
    np.save(tmp_path / "rig.npy", pose[None])
    plan = read_plan(tmp_path / "plan.toml")
    for wanted, status in ((0.16, "holds"), (0.2, "undecided"), (0.4, "fails")):
        (requirements,) = check(plan, tmp_path / "rig.npy", {None: wanted}).requirements
        assert requirements.status == status, json.dumps(
            [requirements.low, requirements.share, requirements.high]
        )
