"""glTF scenes, frusta and our own files."""

import json
import math
import struct
from operator import attrgetter

import numpy as np
import pytest
import trimesh
from view_files import SCENE, SIZE, has_note, lens_of, refused, same, same_pixels, some_points

import rastercov as rc
from rastercov.formats.cameras import POSE_CONVENTIONS, read_views, write_views


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


def scene(path, nodes):
    lens = {"yfov": 2 * math.atan(0.5), "aspectRatio": 4 / 3, "znear": 0.1}
    camera = {"name": "eye", "type": "perspective", "perspective": lens}
    sides = {"xmag": 0.04, "ymag": 0.03, "znear": 0.1, "zfar": 2.0}
    flat = {"name": "flat", "type": "orthographic", "orthographic": sides}
    path.write_text(json.dumps(SCENE | {"nodes": nodes, "cameras": [camera, flat]}))
    return path


def test_a_camera_of_a_scene_looks_along_minus_z_of_its_node(tmp_path):
    half = math.sqrt(0.5)
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0], "scale": [2, 2, 2]},
        # Turned by 90 degrees about y: it looks along -x.
        {"name": "cam", "camera": 0, "translation": [1, 0, 0], "rotation": [0, half, 0, half]},
        {"camera": 1},
    ]
    path = scene(tmp_path / "s.gltf", nodes)
    refused(path, "got none in a glTF scene")
    views = read_views(path, conventions=SIZE)
    camera, pose = views.cameras()[0], views.poses.world_from_camera[0]
    assert (camera.fx, camera.fy) == pytest.approx((480, 480))
    same(pose[:3, 3], [12, 0, 0])
    same(pose[:3, 2], [-1, 0, 0])  # forward
    same(pose[:3, 1], [0, -1, 0])  # down
    assert (views.images[0], views.rig.names) == ("cam", ("eye", "flat"))
    assert views.has_unit
    flat = views.cameras()[1]
    assert (flat.fx, flat.fy, flat.near) == pytest.approx((8000, 8000, 0.1))
    assert flat.is_parallel


def test_orthographic_cameras_are_read_back_and_drawn_as_boxes(tmp_path):
    camera = rc.Camera.orthographic(640, 480, px_per_m=4000, near=0.01)
    views = rc.Views(rc.Rig([camera]), rc.Poses.of(rc.look_at((1, 0, 0), (0, 0, 0))), images=["a"])
    assert not has_note(write_views(tmp_path / "rig.glb", views), "lens")
    again = read_views(tmp_path / "rig.glb", conventions=SIZE).camera()
    assert (again.fx, again.fy, again.near, again.model) == pytest.approx(
        (4000, 4000, 0.01, "telecentric")
    )
    corners = trimesh.load(tmp_path / "rig.glb").geometry["camera 1"].vertices
    own = np.abs(corners[np.isclose(np.abs(corners[:, 0]), 0.08)])
    assert len(own) > 20
    assert {round(float(z), 6) for z in own[:, 2]} == {0.0, 0.1}


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
    assert has_note(notes, "principal point")
    again = read_views(path, conventions=SIZE)
    same(again.poses.world_from_camera, views.poses.world_from_camera)
    assert again.images == views.images
    assert again.rig.names == ("left", "right")
    loaded = trimesh.load(path)
    assert set(loaded.geometry) == {"left", "right"}
    assert set(views.images) <= set(loaded.graph.nodes)
    # The first pose's lines: the border of the image, a rounding inside, the eye and the mark.
    corners = loaded.geometry["left"].vertices * (1, -1, -1)
    pixels = lens_of(views.cameras()[0]).project(corners[np.abs(corners).min(axis=1) > 0] * (
        1 - 1e-6, 1 - 1e-6, 1))  # fmt: skip
    at_border = np.minimum(np.abs(pixels), np.abs(pixels - (640, 480))).min(axis=1)
    assert (at_border < 0.02).mean() > 0.8


def test_frusta_have_the_turn_of_the_meshes_of_a_report(tmp_path):
    path = tmp_path / "rig.glb"
    write_views(path, views_of())
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    root = json.loads(data[20 : 20 + length])["nodes"][0]
    up = np.reshape(root["matrix"], (4, 4)).T @ [0, 0, 1, 0]
    assert up.tolist() == [0, 1, 0, 0]  # z up becomes y up


@pytest.mark.parametrize("name", ["transforms.json", "own.json", "model"])
@pytest.mark.parametrize(
    ("model", "distortion"),
    [
        ("pinhole", ()),
        ("opencv", (-0.1, 0.02, 0.001, -0.002, 0.003)),
        ("opencv_fisheye", (0.02, -0.01, 0.003, 0.001)),
        ("metashape", (-0.1, 0.02, 0.003, 0.04, 0.001, -0.002)),
        ("rad_tan_thin_prism_fisheye", [0.001 * (i - 5) for i in range(12)]),
    ],
)
def test_what_is_written_shows_the_same_points_when_it_is_read(tmp_path, name, model, distortion):
    views = views_of(model=model, distortion=distortion)
    if (name, model) == ("model", "metashape"):
        with pytest.raises(rc.CameraError, match="expected a lens of colmap, got metashape with"):
            write_views(tmp_path / name, views)
        return
    write_views(tmp_path / name, views)
    again = read_views(tmp_path / name)
    same_pixels(views, again, some_points(np.random.default_rng(1)))
    assert (again.images, again.notes) == (views.images, ())


# --- our own --------------------------------------------------------------------------------------


def test_our_own_file_keeps_everything(tmp_path):
    lens = {"model": "opencv", "distortion": (-0.1, 0.02, 0.001, -0.002)}
    views = views_of(**lens, near=0.1, focus_range=(0.1, math.inf))
    path = tmp_path / "rig.json"
    assert write_views(path, views) == []
    again = read_views(path)
    assert again.cameras() == views.cameras()
    assert (again.rig.names, again.images) == (views.rig.names, views.images)
    for name in ("poses.camera", "poses.world_from_camera", "rig.rig_from_camera"):
        np.testing.assert_array_equal(*(attrgetter(name)(each) for each in (again, views)))
    np.testing.assert_array_equal(rc.read_poses(path), views.poses.world_from_camera)
    assert has_note(write_views(tmp_path / "model", views), "near")


def test_a_camera_file_is_views_too(tmp_path):
    camera = views_of().cameras()[0]
    camera.save(tmp_path / "camera.json")
    assert read_views(tmp_path / "camera.json").camera() == camera
    path = tmp_path / "camera.toml"
    path.write_text('preset = "khepra"\nnear = 0.1\n')
    khepra = read_views(path)
    assert khepra.camera().near == 0.1
    assert write_views(path, khepra, overwrite=True) == []
    assert read_views(path).cameras() == khepra.cameras()


def test_a_file_of_poses_may_name_cameras_of_another(tmp_path):
    views, path = views_of(), tmp_path / "poses.json"
    rc.write_poses(path, views.poses, [views.rig.names[row] for row in views.poses.camera])
    alone = read_views(path)
    assert alone.camera_names == ("left", "right")
    joined = alone.through(views, by_name=True)
    np.testing.assert_array_equal(joined.poses.camera, views.poses.camera)
    assert joined.rig is views.rig
    assert alone.through(views, "right").poses.ids.tolist() == [1, 3]
    write_views(tmp_path / "again.json", alone)
    assert read_views(tmp_path / "again.json").camera_names == alone.camera_names
    with pytest.raises(rc.CameraError, match="expected cameras, got only poses"):
        alone.camera()
    with pytest.raises(rc.PoseError, match="expected poses of cameras 'left', got camera 'right'"):
        alone.with_cameras(views.of_camera("left").rig)
    with pytest.raises(
        rc.PoseError, match="expected the camera of each pose, one of 'left', 'right', got none"
    ):
        read_views_of(tmp_path, views).with_cameras(views.rig)


def read_views_of(folder, views):
    """The poses of views through a file of matrices."""
    notes = write_views(folder / "p.npy", views)
    assert has_note(notes, "holds poses alone")
    return read_views(folder / "p.npy")


@pytest.mark.parametrize("name", POSE_CONVENTIONS)
@pytest.mark.parametrize("suffix", [".npy", ".json"])
def test_bare_matrices_have_the_convention_that_is_named(tmp_path, name, suffix):
    poses = views_of().poses.world_from_camera
    given = poses @ np.diag([1, -1, -1, 1]) if "opengl" in name else poses
    given = np.linalg.inv(given) if "camera-from-world" in name else given
    path = tmp_path / f"p{suffix}"
    if suffix == ".npy":
        np.save(path, given)
    else:
        path.write_text(json.dumps({"world_from_camera": given.tolist()}))
    views = read_views(path, conventions=rc.Conventions(pose_convention=name, pose_unit="cm"))
    poses[:, :3, 3] /= 100
    same(views.poses.world_from_camera, poses)
    assert views.notes == ()


def test_bad_poses_are_named_or_left_out(tmp_path):
    poses = views_of().poses.world_from_camera.copy()
    poses[2, 0, 0] = 5
    poses[3, 0, 3] = np.nan
    np.save(tmp_path / "p.npy", poses)
    for name in ("opencv", "opengl-camera-from-world"):
        answers = rc.Conventions(pose_convention=name)
        error = refused(tmp_path / "p.npy", "p.npy: pose ", " is not", conventions=answers)
        assert error.pose_ids == (2, 3)
    views = read_views(tmp_path / "p.npy", conventions=rc.Conventions(skip_bad_poses=True))
    assert sorted(views.poses.rejected) == [2, 3]
    assert views.images == ("camera 1", "camera 2", "camera 5")


def test_views_of_one_camera_are_its_poses():
    views = views_of()
    right = views.of_camera("right")
    assert right.images == ("image 1", "image 3")
    assert right.rig.rig_from_camera[0, 0, 3] == 0.25
    assert right.camera() == views.cameras()[1]
    for name, words in (
        (None, "expected one of 2 cameras, 'left', 'right', got no name"),
        ("up", "expected camera name to be one of 'left', 'right', got 'up'"),
    ):
        with pytest.raises(rc.CameraError, match=words):
            views.camera(name)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"pixel_centre": 1}, "pixel centre to be 0 or 0.5, got 1"),
        ({"lens_model": "wide"}, "lens model to be brown or fisheye"),
        ({"pose_unit": "furlong"}, "unit to be one of m, mm"),
        ({"pose_unit": -1}, "unit to be one of m, mm"),
        ({"image_size": (640, -1)}, "image height to be a whole number"),
        ({"image_size": 640}, "image size to be two numbers"),
        ({"pose_convention": "blender"}, "pose convention to be opencv, opengl, camera-fr"),
        ({"skip_bad_poses": 1}, "skip_bad_poses to be True or False"),
    ],
)
def test_answers_that_are_none_are_refused(arguments, words):
    with pytest.raises(rc.ConfigError, match=words):
        rc.Conventions(**arguments)
