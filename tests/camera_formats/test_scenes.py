"""glTF scenes, frusta and our own files."""

import json
import math
import struct

import numpy as np
import pytest
import trimesh
from view_files import lens_of, same_pixels, some_points

import rastercov as rc
from rastercov.camera.formats import gltf, read_views, write_views
from rastercov.camera.formats.conventions import Conventions

SIZE = Conventions(image_size=(640, 480))


def views_of(n=5, **lens):
    """A rig of two cameras, and poses that look at the origin."""
    rng = np.random.default_rng(3)
    cameras = [
        rc.Camera(width=640, height=480, fx=500.0 + 10 * row, fy=505, cx=322, cy=237, **lens)
        for row in range(2)
    ]
    places = np.tile(np.eye(4), (2, 1, 1))
    places[1, 0, 3] = 0.25
    poses = rc.look_at(eyes=rng.uniform(3, 4, (n, 3)), targets=(0, 0, 0))
    poses = rc.Poses.of(poses, camera=np.arange(n) % 2)
    names = tuple(f"image {row}" for row in range(n))
    return rc.Views(rc.Rig(cameras, ["left", "right"], places), poses, names)


# --- glTF -----------------------------------------------------------------------------------------


def scene(path, nodes, **perspective):
    lens = {"yfov": 2 * math.atan(0.5), "aspectRatio": 4 / 3, "znear": 0.1} | perspective
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "cameras": [{"name": "eye", "type": "perspective", "perspective": lens}],
    }
    path.write_text(json.dumps(content))
    return path


def test_a_camera_of_a_scene_looks_along_minus_z_of_its_node(tmp_path):
    half = math.sqrt(0.5)
    nodes = [
        {"children": [1], "translation": [10, 0, 0], "scale": [2, 2, 2]},
        # Turned by 90 degrees about y: it looks along -x.
        {"name": "cam", "camera": 0, "translation": [1, 0, 0], "rotation": [0, half, 0, half]},
    ]
    path = scene(tmp_path / "s.gltf", nodes)
    with pytest.raises(rc.CameraError, match="a glTF scene has no image size"):
        read_views(path)
    views = read_views(path, conventions=SIZE)
    camera, pose = views.camera(), views.poses.world_from_camera[0]
    assert (camera.fx, camera.fy) == pytest.approx((480, 480))
    np.testing.assert_allclose(pose[:3, 3], [12, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 2], [-1, 0, 0], atol=1e-12)  # forward
    np.testing.assert_allclose(pose[:3, 1], [0, -1, 0], atol=1e-12)  # down
    assert views.images == ("cam",)
    assert views.has_unit


@pytest.mark.parametrize(
    ("nodes", "lens", "words"),
    [
        ([{}], {}, "a node with a camera wanted"),
        ([{"camera": 3}], {}, "'cameras' has 1 objects, number 3"),
        ([{"children": [1]}, {"children": [0], "camera": 0}], {}, "some form a ring"),
        ([{"children": [1]}, {"camera": 0, "children": [1]}], {}, "two parents|a ring"),
        ([{"children": [7], "camera": 0}], {}, "'nodes' has 1 objects, number 7"),
        ([{"camera": 0, "matrix": [1] * 15}], {}, "'matrix' must be 16 finite numbers"),
        ([{"camera": 0, "matrix": [0] * 15 + [1]}], {}, "pose 0 is not"),
        ([{"camera": 0, "rotation": [0, 0, 0, 0]}], {}, "quaternion of length 1, got"),
        ([{"camera": 0}], {"yfov": 4}, "yfov must be above 0 and below pi"),
        ([{"camera": 0}], {"aspectRatio": 2}, "give one that fits, such as 960x480"),
    ],
)
def test_each_fault_of_a_scene_is_one_line(tmp_path, nodes, lens, words):
    path = scene(tmp_path / "s.gltf", nodes, **lens)
    with pytest.raises((rc.CameraError, rc.PoseError), match=rf"^[^\n]*({words})[^\n]*$"):
        read_views(path, conventions=SIZE)


@pytest.mark.slow
def test_deep_scenes_do_not_recurse(tmp_path):
    nodes = [{"children": [row + 1]} for row in range(5000)] + [{"camera": 0}]
    assert len(read_views(scene(tmp_path / "s.gltf", nodes), conventions=SIZE).poses) == 1


@pytest.mark.parametrize(
    "lens",
    [
        {},
        {"model": "opencv", "distortion": (-0.1, 0.02, 0.001, -0.002)},
        {"model": "opencv_fisheye", "distortion": (0.02, -0.01, 0.003, 0.001)},
    ],
)
def test_frusta_are_read_back_and_drawn_at_the_border_of_the_image(tmp_path, lens):
    views = views_of(**lens)
    path = tmp_path / "rig.glb"
    notes = write_views(path, views)
    assert any("principal point" in note for note in notes)
    again = read_views(path, conventions=SIZE)
    np.testing.assert_allclose(
        again.poses.world_from_camera, views.poses.world_from_camera, atol=1e-12
    )
    assert again.images == views.images
    assert again.rig.names == ("left", "right")
    loaded = trimesh.load(path)
    assert set(loaded.geometry) == {"left", "right"}
    assert set(views.images) <= set(loaded.graph.nodes)
    camera = views.cameras()[0]
    points, lines = gltf._pyramid(camera, 0.5)
    pixels = lens_of(camera).project(points[:-2] * (1, -1, -1) * (1 - 1e-9))
    at_border = np.minimum(np.abs(pixels), np.abs(pixels - (640, 480))).min(axis=1)
    assert np.nanmax(at_border) < 1e-4
    assert lines.max() == len(points) - 1


@pytest.mark.parametrize("fx", [100, 430, 2000])
def test_a_border_that_no_ray_reaches_is_drawn_where_the_lens_ends(tmp_path, fx):
    poses, images = rc.Poses.of(np.eye(4)), ("a",)
    camera = rc.Camera(
        width=640, height=480, fx=fx, fy=fx, model="opencv", distortion=(-0.35, 0, 0, 0)
    )
    path = tmp_path / "rig.glb"
    write_views(path, rc.Views(rc.Rig([camera]), poses, images))
    assert len(trimesh.load(path).geometry) == 1
    base = gltf._pyramid(camera, 0.5)[0][:-2] * (1, -1, -1)
    angles = np.arccos(base[:, 2] / np.linalg.norm(base, axis=1))
    limit = lens_of(camera).valid_angle
    assert angles.max() == pytest.approx(limit, rel=1e-6 if fx < 500 else 0.03)
    assert angles.min() == pytest.approx(limit) if fx == 100 else angles.min() < 0.99 * limit


def test_frusta_have_the_turn_of_the_meshes_of_a_report(tmp_path):
    views = views_of()
    path = tmp_path / "rig.glb"
    write_views(path, views)
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    root = json.loads(data[20 : 20 + length])["nodes"][0]
    up = np.reshape(root["matrix"], (4, 4)).T @ [0, 0, 1, 0]
    assert up.tolist() == [0, 1, 0, 0]  # z up becomes y up


# --- our own --------------------------------------------------------------------------------------


def test_our_own_file_keeps_everything(tmp_path):
    views = views_of(model="opencv", distortion=(-0.1, 0.02, 0.001, -0.002), near=0.1)
    path = tmp_path / "rig.json"
    assert write_views(path, views) == []
    again = read_views(path)
    assert again.cameras() == views.cameras()
    assert (again.rig.names, again.images) == (views.rig.names, views.images)
    np.testing.assert_array_equal(again.poses.camera, views.poses.camera)
    np.testing.assert_array_equal(again.rig.rig_from_camera, views.rig.rig_from_camera)
    np.testing.assert_array_equal(again.poses.world_from_camera, views.poses.world_from_camera)
    np.testing.assert_array_equal(rc.read_poses(path), views.poses.world_from_camera)
    same_pixels(views, again, some_points(np.random.default_rng(0)))


def test_our_own_file_keeps_a_focus_to_infinity(tmp_path):
    camera = rc.Camera(width=64, height=48, fx=50, fy=50, focus_range=(0.1, math.inf))
    views = rc.Views(rc.Rig([camera]), rc.Poses.of(np.eye(4)), ("a",))
    assert write_views(tmp_path / "c.json", views) == []
    assert read_views(tmp_path / "c.json").camera() == camera
    assert any("focus_range" in note for note in write_views(tmp_path / "model", views))


def test_a_camera_file_and_a_pose_file_are_views_too(tmp_path):
    camera = views_of().cameras()[0]
    camera.save(tmp_path / "camera.json")
    assert read_views(tmp_path / "camera.json").camera() == camera
    (tmp_path / "camera.toml").write_text('preset = "khepra"\nnear = 0.1\n')
    assert read_views(tmp_path / "camera.toml").camera().near == 0.1
    poses = views_of().poses.world_from_camera
    rc.write_poses(tmp_path / "p.npy", poses)
    views = read_views(tmp_path / "p.npy")
    np.testing.assert_array_equal(views.poses.world_from_camera, poses)
    assert views.has_unit
    with pytest.raises(rc.CameraError, match="there are poses and no camera"):
        views.camera()


CONVENTIONS = {
    "opencv": lambda m: m,
    "opengl": lambda m: m @ np.diag([1, -1, -1, 1]),
    "camera-from-world": np.linalg.inv,
    "opengl-camera-from-world": lambda m: np.linalg.inv(m @ np.diag([1, -1, -1, 1])),
}


@pytest.mark.parametrize("name", CONVENTIONS)
@pytest.mark.parametrize("suffix", [".npy", ".json"])
def test_bare_matrices_have_the_convention_that_is_named(tmp_path, name, suffix):
    poses = views_of().poses.world_from_camera
    given = CONVENTIONS[name](poses)
    path = tmp_path / f"p{suffix}"
    if suffix == ".npy":
        np.save(path, given)
    else:
        path.write_text(json.dumps({"world_from_camera": given.tolist()}))
    views = read_views(path, conventions=Conventions(pose_convention=name, pose_unit="cm"))
    poses = poses.copy()
    poses[:, :3, 3] /= 100
    np.testing.assert_allclose(views.poses.world_from_camera, poses, atol=1e-12)
    assert views.notes == ()


def test_bad_poses_are_named_or_left_out(tmp_path):
    poses = views_of().poses.world_from_camera.copy()
    poses[2, 0, 0] = 5
    poses[3, 0, 3] = np.nan
    np.save(tmp_path / "p.npy", poses)
    for name in ("opencv", "opengl-camera-from-world"):
        with pytest.raises(rc.PoseError, match=r"p.npy: pose [23] is not") as caught:
            read_views(tmp_path / "p.npy", conventions=Conventions(pose_convention=name))
        assert caught.value.pose_ids == (2, 3)
    views = read_views(tmp_path / "p.npy", conventions=Conventions(skip_bad_poses=True))
    assert sorted(views.poses.rejected) == [2, 3]
    assert views.images == ("pose 0", "pose 1", "pose 4")


def test_views_of_one_camera_are_its_poses():
    views = views_of()
    right = views.of_camera("right")
    assert right.images == ("image 1", "image 3")
    assert right.rig.rig_from_camera[0, 0, 3] == 0.25
    assert right.camera() == views.cameras()[1]
    for name, words in (
        (None, "there are 2 cameras, 'left', 'right'; choose one by --camera-name"),
        ("up", "there is no camera 'up'; cameras are 'left', 'right'"),
    ):
        with pytest.raises(rc.CameraError, match=words):
            views.camera(name)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"cameras": []}, "at least one camera wanted"),
        ({"cameras": {"a": {"width": 3}}}, "cameras must be a list of tables, each with its name"),
        ({"cameras": [{"name": "a", "width": 3}]}, "camera 'a': missing height"),
        ({"cameras": [{"name": 3}]}, "name must be a text"),
        (
            {"cameras": [{"name": "a", "width": 9, "height": 9, "fx": 9, "fy": 9}] * 2},
            "two cameras are named 'a'",
        ),
        ({"camera": [0]}, "camera must be 5 indices or names of 2 cameras"),
        ({"camera": None}, "do not say which of 2 cameras each is of; add camera, a list of 5"),
        ({"camera": [0, 1, 2, 0, 1]}, "camera must be 5 indices or names of 2 cameras"),
        ({"images": ["a"]}, "images must be 5 texts"),
        ({"rig_from_camera": [[1]]}, "rig_from_camera must be 2 x 4 x 4"),
        ({"world_from_camera": [[1]]}, r"poses must have shape \(P, 4, 4\)"),
    ],
)
def test_each_fault_of_our_own_file_is_one_line(tmp_path, entries, words):
    path = tmp_path / "rig.json"
    write_views(path, views_of())
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))
    with pytest.raises((rc.CameraError, rc.PoseError), match=rf"^[^\n]*{words}[^\n]*$"):
        read_views(path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"pixel_centre": 1}, "pixel centre must be 0 or 0.5, got 1"),
        ({"lens_model": "wide"}, "lens model must be brown or fisheye"),
        ({"pose_unit": "furlong"}, "unit must be one of m, mm"),
        ({"pose_unit": -1}, "unit must be one of m, mm"),
        ({"image_size": (640, -1)}, "image height must be a whole number"),
        ({"image_size": 640}, "image size must be two numbers"),
        (
            {"pose_convention": "blender"},
            "pose convention must be opencv, opengl, camera-from-world or",
        ),
        ({"skip_bad_poses": 1}, "skip_bad_poses must be True or False"),
    ],
)
def test_answers_that_are_none_are_refused(arguments, words):
    with pytest.raises(rc.ConfigError, match=words):
        Conventions(**arguments)
