"""Animations of glTF nodes: keys, the ways between them, and what is refused."""

import json

import numpy as np
import pytest
from mesh_files import Glb
from timed import over_time, regions_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError, MeshError
from rastercov.core.area.union import unite
from rastercov.core.mesh import shapes
from rastercov.core.mesh.arrays import (
    quaternions_of,
    rotation_about,
    rotations_of_quaternions,
    unit,
)
from rastercov.motion.frames import animate_motion
from rastercov.motion.gltf_animation import slerp
from rastercov.report.coverage_files import write_covered_mesh


def quaternion(axis, degrees):
    half = np.radians(degrees) / 2
    return (*(np.sin(half) * np.array(axis) / np.linalg.norm(axis)), np.cos(half))


@pytest.fixture
def glb():
    """A part that stays, and an arm with a tool on it."""
    made = Glb()
    made.nodes(
        {"mesh": 0, "name": "part"},
        {"mesh": 0, "name": "arm", "translation": [5, 0, 0], "children": [2]},
        {"mesh": 0, "name": "tool", "translation": [0, 2, 0]},
    )
    made.header["scenes"] = [{"nodes": [0, 1]}]
    return made


def animate(glb, *channels, name="move"):
    samplers, of = [], []
    for node, path, times, values, way in channels:
        samplers.append({
            "input": glb.accessor(np.array(times, float)), "output": glb.accessor(values),
            **({} if way is None else {"interpolation": way}),
        })  # fmt: skip
        of.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
    glb.header.setdefault("animations", []).append(
        {"name": name, "samplers": samplers, "channels": of}
    )


@pytest.fixture
def loaded(glb, tmp_path):
    def load(**options):
        (tmp_path / "a.glb").write_bytes(glb.data())
        mesh = rc.Mesh.load(tmp_path / "a.glb")
        return rc.load_motion(mesh, tmp_path / "a.glb", **options)

    return load


def test_children_move_with_their_parents_and_others_stay(glb, loaded):
    animate(glb, (1, "rotation", [0, 1], [(0, 0, 0, 1), quaternion((0, 0, 1), 90)], "LINEAR"))
    motion = loaded(steps=3)
    # Both move by one table: one body.
    assert motion.names == ("world", "arm")
    assert (motion.poses_of("world") == np.eye(4)).all()
    pose = motion.poses_of("arm")[2]
    assert np.allclose(pose @ (5, 2, 0, 1), (3, 0, 0, 1), atol=1e-6)
    half = motion.poses_of("arm")[1]
    turn = rotation_about(np.array((0, 0, 1.0)), np.radians(45))
    assert np.allclose(half[:3, :3], turn, atol=1e-6)


def test_the_ways_between_keys(glb, loaded):
    values = [(5, 0, 0), (6, 0, 0), (6, 4, 0)]
    animate(glb, (1, "translation", [0, 1, 2], values, "STEP"), name="step")
    animate(glb, (1, "translation", [0, 1, 2], values, None), name="linear")
    flat = [each for value in values for each in ((0, 0, 0), value, (0, 0, 0))]
    animate(glb, (1, "translation", [0, 1, 2], flat, "CUBICSPLINE"), name="spline")
    for name, expected in (
        ("step", [(0, 0), (0, 0), (1, 0), (1, 0), (1, 4)]),
        ("linear", [(0, 0), (0.5, 0), (1, 0), (1, 2), (1, 4)]),
        ("spline", [(0, 0), (0.5, 0), (1, 0), (1, 2), (1, 4)]),
    ):
        poses = loaded(animation=name, steps=5).poses_of("arm")[:, :2, 3]
        assert np.allclose(poses, expected, atol=1e-6), name
    # Without slope at the keys a spline is t^2 (3 - 2 t).
    poses = loaded(animation="spline", steps=9).poses_of("arm")[:, 0, 3]
    assert poses[1] == pytest.approx(0.25**2 * (3 - 0.5), abs=1e-6)


def test_slerp_turns_evenly_the_short_way():
    one, other = np.array([quaternion((1, 2, 3), 10)]), np.array([quaternion((1, 2, 3), 100)])
    for t in (0.0, 0.3, 1.0):
        expected = np.array(quaternion((1, 2, 3), 10 + 90 * t))
        for end in (other, -other):
            result = slerp(one, end, np.array([[t]]))[0]
            assert np.allclose(result * np.sign(result @ expected), expected, atol=1e-12)
    same = slerp(one, one, np.array([[0.5]]))
    assert np.allclose(same, one, atol=1e-15)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 3.0, 1e200, 1.7e308])
def test_a_direction_of_any_length_becomes_a_unit_vector(length):
    axis = np.array((0, 0, 1.0))
    assert np.array_equal(unit(length * axis), axis)
    assert np.array_equal(rotation_about(length * axis, 0.3), rotation_about(axis, 0.3))
    poses = rc.conveyor(2, direction=(0, 0, min(length, 1e30)), distance=2)
    assert np.array_equal(poses[1, :3, 3], (0, 0, 2))


def test_quaternions_of_rotations_are_theirs():
    rng = np.random.default_rng(4)
    turns = [rotation_about(rng.normal(size=3), rng.uniform(-np.pi, np.pi)) for _ in range(200)]
    turns += [np.diag(each) for each in ((1.0, -1, -1), (-1.0, 1, -1), (-1.0, -1, 1), (1.0, 1, 1))]
    quaternions = quaternions_of(np.array(turns))
    again = rotations_of_quaternions(quaternions[:, [1, 2, 3, 0]])
    assert np.abs(again - turns).max() <= 1e-14
    assert (np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1]) >= 0).all()


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (
            (1, "scale", [0, 1], [(1, 1, 1), (2, 2, 2)], None),
            "expected the scale of node 1 to be constant, or 0 where it is absent, got another;",
        ),
        ((1, "weights", [0, 1], [(1, 1, 1), (2, 2, 2)], None), "morph"),
        (
            (1, "translation", [1, 0], [(1, 1, 1), (2, 2, 2)], None),
            "expected strictly increasing times of an animation, got other times;",
        ),
        ((1, "translation", [0, 1], [(1, 1, 1)], None), "values for 2 times"),
        ((1, "translation", [0, 1], [(1, 1, 1)] * 2, "WAVY"), "interpolation"),
        ((1, "colour", [0, 1], [(1, 1, 1)] * 2, None), "path to be"),
        ((1, "rotation", [0, 1], [(0, 0, 0, 2)] * 2, "STEP"), "length 1"),
        ((1, "rotation", [0, 1], [(0, 0, 0, 1), (0, 0, 0.6, 0.8015)], None), "node 1 over time"),
        (
            (1, "rotation", [0, 1], [*[(0, 0, 0, 1)] * 4, (0, 2, 1, 2), (0,) * 4], "CUBICSPLINE"),
            "length 1",
        ),
        (
            (1, "translation", [0, 1], [(5, 0, 0)] * 2, None),
            "expected an animation that moves a mesh, got none",
        ),
    ],
)
def test_animations_that_are_not_rigid_are_refused_in_one_line(channel, words, glb, loaded):
    animate(glb, channel)
    with pytest.raises((ConfigError, MeshError), match=words) as error:
        loaded(steps=3)
    assert "\n" not in str(error.value)
    assert "a.glb" in str(error.value)


def test_skins_and_names_that_are_none_are_refused(glb, loaded):
    with pytest.raises(MeshError, match="expected an animation, got none"):
        loaded()
    animate(glb, (1, "translation", [0, 1], [(5, 0, 0), (6, 0, 0)], None))
    with pytest.raises(MeshError, match="expected one of the animations 'move', got 'walk'"):
        loaded(animation="walk")
    with pytest.raises(ConfigError, match="steps"):
        loaded(steps=0)
    glb.header["nodes"][0]["skin"] = 0
    with pytest.raises(MeshError, match="skin"):
        loaded()


def test_a_node_of_no_size_is_not_there(glb, loaded):
    animate(glb, (1, "scale", [0, 1], [(1, 1, 1), (0, 0, 0)], "STEP"))
    motion = loaded(steps=3)
    assert motion.present[:, 1].tolist() == [True, True, False]
    assert (motion.world_from_body == np.eye(4)).all()


def test_the_animation_of_a_result_is_its_motion(tmp_path):
    one, other = rc.shapes.box(), rc.shapes.box().moved(translation=(3, 0, 0))
    mesh = rc.Mesh(
        np.concatenate((one.vertices, other.vertices)),
        np.concatenate((one.faces, other.faces + one.n_vertices)),
        [rc.Group("part"), rc.Group("arm")], np.repeat([0, 1], 12),
    )  # fmt: skip
    there = [True, True, False, True]
    table = rc.turntable(4, axis=(1, 2, 3), centre=(3, 0, 0), degrees=200)
    motion = rc.Motion(mesh, {"arm": table}, {"arm": there}, [1, 1, 2, 1])
    camera = rc.Camera(width=64, height=48, fx=50, fy=50)
    pose = rc.look_at(eyes=[(1, 9, 2)], targets=(1, 0, 0))
    covered = unite(over_time(regions_over_time(motion, camera, pose), motion))
    write_covered_mesh(tmp_path / "network.glb", covered, [animate_motion(motion)])
    read = rc.Mesh.load(tmp_path / "network.glb")
    # The file is y up; a frame a second.
    again = rc.load_motion(read, tmp_path / "network.glb", steps=6)
    up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    values = np.linalg.inv(up) @ again.poses_of("arm") @ up
    rows = [0, 1, 2, 2, 3, 3]
    own = np.array(there)[rows]
    assert np.allclose(values[own], table[rows][own], atol=1e-5)
    assert again.present[:, 1].tolist() == own.tolist()


def test_a_wrong_pose_of_a_table_is_told_with_the_name_of_the_file(tmp_path):
    mesh, path = shapes.box((1, 1, 1)), tmp_path / "moves.json"
    poses = np.diag([2.0, 1, 1, 1])[None].tolist()
    path.write_text(json.dumps({"bodies": {mesh.groups[0].name: {"poses": poses}}}))
    with pytest.raises(
        ConfigError,
        match=r"expected poses of 'mesh' to be \(T, 4, 4\) rigid transforms, got another matrix",
    ):
        rc.load_motion(mesh, path)
