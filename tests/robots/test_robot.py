"""Robots: forward and inverse kinematics, files that are refused in one line, paths of joints."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from mesh_files import binary_stl
from nightly import amount
from robots import seven_axes
from scipy.spatial.transform import Rotation

import rastercov as rc
from rastercov.base.errors import ConfigError, MeshError, ResourceError
from rastercov.robots.kinematics import pose_error
from rastercov.robots.robot import _check_size
from rastercov.robots.urdf import LinkShape

ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"
BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1"/>'


def link(name, shape=BOX):
    return f'<link name="{name}">{shape}</link>'


def joint(name, parent, child, kind="revolute", more=LIMIT):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"{more}</joint>"
    )


def robot(folder, *parts, **options):
    path = folder / "own.urdf"
    path.write_text(f"<robot name='own'>{''.join(parts)}</robot>")
    return rc.Robot.load(path, **options)


@pytest.fixture(scope="module")
def arm():
    return rc.Robot.load(ARM)


def configurations(arm, n, seed=0):
    low, high = np.clip(arm.limits, -3, 3).T
    return np.random.default_rng(seed).uniform(low, high, (n, len(low)))


def matrix(xyz, rotation):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), xyz
    return pose


def test_the_flange_is_where_the_chain_of_joints_leads(arm):
    """Products of scipy's rotations, written out for this arm."""
    way = [(0, 0, 0.1), (0, 0.13, 0.08), (0, -0.11, 0.42), (0, 0.09, 0.38), (0, 0, 0.072)]
    way.append((0, 0.057, 0.05))
    axes = "zyyyzy"
    for joints in configurations(arm, 20):
        pose = np.eye(4)
        for step, axis, angle in zip(way, axes, joints, strict=True):
            pose = pose @ matrix(step, Rotation.from_euler(axis, angle))
        pose = pose @ matrix((0, 0.016, 0), Rotation.from_euler("x", -90, degrees=True))
        assert np.abs(arm.frames(joints)["flange"][0] - pose).max() <= 1e-12


def test_fixed_angles_are_about_x_then_y_then_z(tmp_path):
    angles = (0.3, -1.1, 2.2)
    origin = f'<origin xyz="1 2 3" rpy="{" ".join(map(str, angles))}"/>'
    result = robot(tmp_path, link("a"), link("b"), joint("j", "a", "b", "fixed", origin))
    wanted = matrix((1, 2, 3), Rotation.from_euler("xyz", angles))
    assert np.abs(result.frames(np.zeros((1, 0)))["b"][0] - wanted).max() <= 1e-15


def test_a_moved_robot_is_the_robot_loaded_in_that_pose(arm):
    joints = configurations(arm, 3)
    motion = rc.Motion(arm.mesh, arm.poses(joints))
    for row in range(3):
        mesh, _ = motion.frame(row)
        other = rc.Robot.load(ARM, rest=joints[row]).mesh
        assert np.abs(mesh.vertices[mesh.faces] - other.vertices[other.faces]).max() <= 1e-12


def test_a_base_moves_all_links(arm):
    base = matrix((1, 2, 3), Rotation.from_euler("xyz", (0.1, 0.2, 0.3)))
    joints = configurations(arm, 2)
    moved = rc.Robot.load(ARM, base=base).frames(joints)
    assert np.abs(moved["head"] - base @ arm.frames(joints)["head"]).max() <= 1e-14


def test_links_hide_and_are_groups(arm):
    assert [group.name for group in arm.mesh.groups][:2] == ["arm/base", "arm/shoulder"]
    assert not arm.mesh.task_mask.any()
    assert "arm/base" not in arm.poses(arm.rest)
    assert arm.mesh.is_closed_outward


def test_mimics_and_prismatic_joints_follow(tmp_path):
    mimic = '<mimic joint="slide" multiplier="-2" offset="0.1"/>'
    along = '<axis xyz="0 0 2"/><limit lower="0" upper="0.5"/>'
    result = robot(
        tmp_path, link("a"), link("b"), link("c"),
        joint("slide", "a", "b", "prismatic", along),
        joint("other", "a", "c", "prismatic", mimic + '<limit lower="-0.5" upper="0.1"/>'),
    )  # fmt: skip
    assert result.joint_names == ("slide",)
    assert result.limits.tolist() == [[0, 0.3]]  # 0.1 - 2 q >= -0.5
    frames = result.frames([[0.2]])
    assert frames["b"][0, :3, 3].tolist() == [0, 0, 0.2]
    assert np.allclose(frames["c"][0, :3, 3], (0.1 - 0.4, 0, 0), atol=1e-15)
    assert np.allclose(result.solve(frames["c"], "c").joints, 0.2, atol=1e-6)


def test_fingers_of_one_range_that_mirror_each_other_move(tmp_path):
    """As those of the PR2: the limits of what mimics leave its master no room."""
    mimic = '<mimic joint="j" multiplier="-1"/>'
    ends = '<limit lower="0" upper="0.5"/>'
    parts = (
        *map(link, "abc"),
        joint("k", "a", "c", more=ends + mimic),
        joint("j", "a", "b", more=ends),
    )
    result = robot(tmp_path, *parts)
    assert result.limits.tolist() == [[0, 0.5]]
    assert "ignored limits of 'k', which leave no range to 'j'" in result.mesh.warnings
    wider = joint("k", "a", "c", more='<limit lower="-0.3" upper="0"/>' + mimic)
    result = robot(tmp_path, *map(link, "abc"), wider, joint("j", "a", "b", more=ends))
    assert result.limits.tolist() == [[0, 0.3]]
    assert not np.signbit(result.limits).any()
    assert "room" not in str(result.mesh.warnings)


def test_prefixes_that_nothing_declares_are_other_names(tmp_path):
    """As in descriptions for Drake."""
    ends = '<limit drake:lower="9" lower="-1" upper="1" drake:acceleration="2"/>'
    result = robot(tmp_path, link("a"), link("b"), joint("j", "a", "b", more=ends))
    plain = robot(tmp_path, link("a"), link("b"), joint("j", "a", "b"))
    assert result.limits.tolist() == plain.limits.tolist() == [[-1, 1]]
    with pytest.raises(MeshError, match="expected the file to be XML, got"):
        robot(tmp_path, link("a"), "<drake:b>")


def test_meshes_of_packages_are_read_scaled_and_mirrored(tmp_path):
    part = rc.shapes.torus(8, 6)
    folder = tmp_path / "desc"
    folder.mkdir()
    (folder / "part.stl").write_bytes(binary_stl(part.vertices, part.faces))
    shape = (
        '<visual><origin xyz="0 0 1"/><geometry><mesh scale="0.1 0.1 -0.2" '
        'filename="package://made/part.stl"/></geometry></visual>'
    )
    options = {"packages": {"made": folder}, "geometry": "visual"}
    rooted = shape.replace("package://", "package:///")
    assert robot(tmp_path, link("a", rooted), **options).mesh.n_faces == part.n_faces
    mesh = robot(tmp_path, link("a", shape), **options).mesh
    wanted = part.vertices[part.faces[:, ::-1]] * (0.1, 0.1, -0.2) + (0, 0, 1)
    assert np.abs(mesh.vertices[mesh.faces] - wanted).max() <= 1e-6
    assert mesh.is_closed_outward
    with pytest.raises(MeshError, match="try geometry"):
        robot(tmp_path, link("a", shape), packages={"made": folder})
    with pytest.raises(
        MeshError,
        match=r"expected the folder of the package of 'package://made/part\.stl', got none; "
        r'set packages = \{"made" = "its folder"\}',
    ):
        robot(tmp_path, link("a", shape), geometry="visual")
    with pytest.raises(MeshError, match=r"part\.stl', got no file"):
        robot(tmp_path, link("a", shape), geometry="visual", packages={"made": tmp_path})


def mesh_shape(name):
    return f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'


HOSTILE = {
    "one link": lambda file: link("a", file * 400),
    "many links": lambda file: "".join(
        [link("a", file * 4)]
        + [link(f"l{i}", file * 4) + joint(f"j{i}", "a", f"l{i}") for i in range(99)]
    ),
    "scales": lambda file: link("a", (file + file.replace("/></g", ' scale="1 -2 1"/></g')) * 200),
    "boxes beside": lambda file: link("a", (file + BOX) * 400),
    "spheres": lambda _: link("a", BOX.replace('box size="1 1 1"', 'sphere radius="1"') * 4000),
    "boxes": lambda _: link("a", BOX * 60_000),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_faces_are_counted_before_shapes_are_made(tmp_path, name, monkeypatch):
    ball = rc.shapes.sphere(4)
    (tmp_path / "ball.stl").write_bytes(binary_stl(ball.vertices, ball.faces))
    monkeypatch.setattr("rastercov.robots.robot._link_of", lambda *_: pytest.fail("made"))
    with pytest.raises(
        ResourceError, match="expected at most 314572800 bytes and 2147483647 triangles, got"
    ):
        robot(tmp_path, HOSTILE[name](mesh_shape("ball.stl")))


def test_points_without_faces_are_counted_too(tmp_path):
    rows = "\n".join(f"v {i} {i % 7} 0" for i in range(30_000))
    (tmp_path / "cloud.obj").write_text(f"{rows}\nf 1 2 3\n")
    with pytest.raises(ResourceError, match="400 triangles with 12000000 vertices"):
        robot(tmp_path, link("a", mesh_shape("cloud.obj") * 400))


def test_meshes_of_several_names_are_read_once_and_placed_each_time(tmp_path, monkeypatch):
    (tmp_path / "part.stl").write_bytes(binary_stl(np.eye(3), [[0, 1, 2]]))
    (tmp_path / "soft.stl").symlink_to("part.stl")
    (tmp_path / "hard.stl").hardlink_to(tmp_path / "part.stl")
    names = ["part.stl", "./part.stl", "././part.stl", "soft.stl", "hard.stl",
             f"file://{tmp_path}/part.stl", "package://own/part.stl"]  # fmt: skip
    load, read = rc.Mesh.load, []
    monkeypatch.setattr(rc.Mesh, "load", lambda path: read.append(path) or load(path))
    parts = [mesh_shape(name) for name in names] * 2
    result = robot(tmp_path, link("a", "".join(parts)), packages={"own": tmp_path})
    assert (len(read), result.mesh.n_faces, len(result.mesh.sources)) == (1, 14, 1)


@pytest.mark.parametrize(("n", "is_read"), [(49, True), (51, False)])
def test_a_large_mesh_may_be_used_fifty_times(n, is_read):
    mesh = rc.shapes.torus(200, 100)
    own = [LinkShape("mesh", np.eye(4), (1.0, 1.0, 1.0), "a.stl")] * n
    with nullcontext() if is_read else pytest.raises(ResourceError):
        _check_size(own, {"a.stl": mesh})


AB = link("a") + link("b")
BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
REFUSED = {
    "no link": ("", "links, got none"),
    "unnamed": ("<link/>", "expected a name of every link, got none"),
    "twice": (link("a") * 2, "expected each link once, got 'a' twice"),
    "roots": (AB, r"one link without a parent, got \['a', 'b'\]"),
    "cycle": (AB + joint("j", "a", "b") + joint("k", "b", "a"), "without a parent, got a cycle"),
    "cycle beside a tree": (
        AB + link("c") + joint("j", "b", "c") + joint("k", "c", "b"), "no cycle, got one at 'b'"),
    "loop": (AB + link("c") + joint("j", "a", "c") + joint("k", "b", "c"), "got two joints to 'c'"),
    "no such link": (link("a") + joint("j", "a", "z"), "expected a link of the robot, got 'z'"),
    "floating": (AB + joint("j", "a", "b", "floating"), "got floating; make it fixed"),
    "planar": (AB + joint("j", "a", "b", "planar"), "got planar"),
    "kind": (AB + joint("j", "a", "b", "screw"), "type to be one of .* got 'screw'"),
    "no limits": (AB + joint("j", "a", "b", more=""), "expected limits, got none"),
    "limits": (
        AB + joint("j", "a", "b", more='<limit lower="2" upper="1"/>'), "lower <= upper, got 2"),
    "nan": (AB + joint("j", "a", "b", more='<limit lower="nan" upper="1"/>'), "finite number, got"),
    "axis": (AB + joint("j", "a", "b", more=LIMIT + '<axis xyz="0 0 0"/>'), "axis, got 0 0 0"),
    "mimics none": (
        AB + joint("j", "a", "b", more=LIMIT + '<mimic joint="k"/>'), "that moves, got 'k'"),
    "mimics itself": (
        AB + joint("j", "a", "b", more=LIMIT + '<mimic joint="j"/>'), "another joint, got a cycle"),
    "shape": (
        link("a", "<collision><geometry><capsule/></geometry></collision>"), "got 'capsule'"),
    "size": (
        link("a", BOX.replace("1 1 1", "1 0 1")), "a box of sizes above 0"),
    "numbers": (link("a", BOX.replace("1 1 1", "1 1")), "size to be 3 finite numbers"),
    "scale": (
        link("a", mesh_shape('x.stl" scale="0 1 1')), "a scale other than 0"),
    "missing": (link("a", mesh_shape("x.stl")), r"expected the mesh 'x\.stl', got no file"),
    "url": (link("a", mesh_shape("http://x/y.stl")), "a file or package://"),
    "outside": (link("a", mesh_shape("package://p/../../x.stl")), "a file in a package"),
    "slip": (link("a") + link("b") + joint("j", "a", "b").replace("limit", "limti"), "got 'limti'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_robot_of_rigid_links_is_refused_in_one_line(tmp_path, name):
    text, words = REFUSED[name]
    with pytest.raises(MeshError, match=words) as caught:
        robot(tmp_path, text, packages={"p": tmp_path})
    assert str(caught.value).isprintable()
    assert "own.urdf: " in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.xacro", "<robot/>", "run xacrodoc a.xacro -o a.urdf"),
        (
            "a.urdf",
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="b"/>'
            "</robot>",
            "run xacrodoc a.urdf -o a.whole.urdf",
        ),
        ("b.urdf", "<model/>", "an element robot, got 'model'"),
        (
            "c.urdf",
            BOMB + "<robot>&b;</robot>",
            "expected the file without a document type, got one",
        ),
        ("d.urdf", "<robot>", "expected the file to be XML, got"),
        ("e.urdf", "<robot>" + "<link>" * 20_000 + "</link>" * 20_000 + "</robot>", "a name"),
        (
            "f.urdf",
            f"<robot>{'<link name=%r/>' * 1001}</robot>" % tuple(map(str, range(1001))),
            "1000",
        ),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises((MeshError, ResourceError), match=words) as caught:
        rc.Robot.load(tmp_path / name)
    assert str(caught.value).isprintable()
    with pytest.raises(MeshError, match="no such file"):
        rc.Robot.load(tmp_path / "none.urdf")


def test_a_path_has_a_column_for_each_joint_in_any_order(arm, tmp_path):
    names = [*reversed(arm.joint_names), "duration"]
    rows = np.column_stack([configurations(arm, 4)[:, ::-1], (1, 2, 3, 4)])
    path = tmp_path / "path.csv"
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines))
    result = arm.read_path(path)
    assert np.array_equal(result.joints, configurations(arm, 4))
    assert result.duration.tolist() == [1, 2, 3, 4]
    spoiled = {
        "header": (lines[0].replace("elbow", "knee"), *lines[1:]),
        "nan": (*lines[:2], lines[2].replace("2.0", "nan")),
        "short": (*lines[:2], "1,2"),
        "limits": (*lines[:2], "9,9,9,9,9,9,1"),
        "time": (*lines[:2], "0,0,0,0,0,0,-1"),
        "empty": lines[:1],
        "none": (),
    }
    words = (
        *("columns pan", "frame 1: expected a number within .*", "frame 1: expected 7 numbers"),
        *(
            r"expected pan in -3\.1 \.\.\. 3\.1, got 9",
            "frame 1: expected a duration above 0",
            "1 to 10,000 frames",
        ),
        "1 to 10,000 frames",
    )
    for text, expected in zip(spoiled.values(), words, strict=True):
        path.write_text("\n".join(text))
        with pytest.raises(ConfigError, match=expected) as caught:
            arm.read_path(path)
        assert str(caught.value).isprintable()


def test_every_solution_meets_its_pose_within_the_limits(arm):
    tip = matrix((0.01, 0, 0.1), Rotation.from_euler("x", 0.2))
    goals = arm.frames(configurations(arm, 40))["head"] @ tip
    goals = np.concatenate([goals, goals + np.diag([0, 0, 0, 0])])
    goals[40:, :3, 3] += (5, 0, 0)  # out of reach
    solution = arm.solve(goals, "head", tip)
    assert (np.diff(solution.pose) >= 0).all()
    assert set(solution.pose) == set(range(40))
    assert np.bincount(solution.pose).max() <= 8
    back = arm.frames(solution.joints)["head"] @ tip
    assert np.linalg.norm(pose_error(back, goals[solution.pose]), axis=1).max() <= 1e-6
    for pose in range(40):
        own = solution.joints[solution.pose == pose]
        for row, one in enumerate(own):
            for other in own[:row]:
                assert arm.kinematics.difference(one, other).max() > 1e-2
    again = arm.solve(goals, "head", tip)
    assert again.joints.tobytes() == solution.joints.tobytes()


@pytest.mark.slow
def test_sixteen_starts_reach_what_ninety_six_reach(arm):
    rng = np.random.default_rng(4)
    eyes = rng.uniform((-0.9, -0.9, 0.0), (0.9, 0.9, 1.0), (200, 3))
    poses = rc.look_at(eyes, rng.uniform((0.2, -0.3, -0.2), (0.8, 0.3, 0.4), (200, 3)))
    few = set(arm.solve(poses, "head").pose.tolist())
    many = set(arm.solve(poses, "head", starts=96, seed=1).pose.tolist())
    assert len(many) > 60
    assert len(few & many) >= 0.99 * len(many)


@pytest.mark.slow
def test_an_arm_of_seven_axes_loses_no_view_that_64_starts_reach(tmp_path):
    """Solutions are many, and most are beyond a limit: the first starts miss some."""
    (tmp_path / "seven.urdf").write_text(seven_axes())
    seven = rc.Robot.load(tmp_path / "seven.urdf")
    rng = np.random.default_rng(17)
    n, seeds = amount((300, (1,)), at_night=(1000, (1, 2, 3)))
    eyes = rng.uniform((-1.1, -1.1, 0.0), (1.1, 1.1, 1.2), (n, 3))
    poses = rc.look_at(eyes, rng.uniform((0.2, -0.3, -0.2), (0.8, 0.3, 0.4), (n, 3)))
    reached = set(seven.solve(poses, "link_7").pose.tolist())
    first = seven.kinematics.solve(poses, "link_7", np.eye(4), (16,), 0, 1)
    assert set(first.pose.tolist()) < reached
    for seed in seeds:
        others = seven.kinematics.solve(poses, "link_7", np.eye(4), (64,), seed, 1)
        assert set(others.pose.tolist()) <= reached
    assert len(reached) > 0.08 * n


def test_how_far_a_pose_is_beyond_a_limit_is_known(tmp_path):
    """Two joints in a plane: the elbow must bend by 90 degrees, either way, and may by less."""
    ends = '<axis xyz="0 0 1"/><limit lower="{}" upper="{}"/>'
    parts = (
        link("a"), link("b"), link("c"), link("d"),
        joint("pan", "a", "b", more=ends.format(-3, 3)),
        joint("elbow", "b", "c", more='<origin xyz="1 0 0"/>' + ends.format(-1, 0.4)),
        joint("tip", "c", "d", "fixed", '<origin xyz="1 0 0"/>'),
    )  # fmt: skip
    result = robot(tmp_path, *parts)
    poses = np.stack([matrix((1, 1, 0), Rotation.from_euler("z", a)) for a in (np.pi / 2, 0)])
    poses = np.concatenate([poses, poses[:1] + np.diag([0, 0, 0, 0])])
    poses[2, :3, 3] = 0.3, 5, 0
    solved = result.solve(poses, "d")
    assert not len(solved.pose)
    assert np.allclose(solved.beyond[0], (0, np.pi / 2 - 0.4), atol=1e-5)
    assert np.allclose(solved.beyond[1], (0, np.pi / 2 - 1), atol=1e-5)
    assert np.isinf(solved.beyond[2]).all()
    within = result.frames([(0.2, 0.3)])["d"]
    assert not result.solve(within, "d").beyond.any()


def test_wrong_links_and_numbers_are_refused(arm):
    with pytest.raises(ConfigError, match=r"expected a link of .*, got 'hand'"):
        arm.solve(np.eye(4), "hand")
    with pytest.raises(ConfigError, match=r"expected lift in -2\.2 \.\.\. 2\.2, got 3"):
        arm.poses([0, 3, 0, 0, 0, 0])
    with pytest.raises(ConfigError, match="values of pan"):
        arm.poses(np.zeros((2, 5)))
    with pytest.raises(ConfigError, match="starts to be from 1"):
        arm.solve(np.eye(4), "head", starts=0)
    with pytest.raises(ConfigError, match="base to be"):
        rc.Robot.load(ARM, base=np.ones((4, 4)))
