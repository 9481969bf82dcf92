"""Frames: images of one instant, in COLMAP's and OpenSfM's models, our JSON and `Views`."""

import itertools
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import amount
from test_colmap import expected, model_of
from view_files import (
    SIZE,
    has_note,
    motion,
    pixels_of,
    same,
    same_pixels,
    some_points,
)
from wheels import with_wheel

import rastercov as rc
from rastercov.formats.cameras import read_views, write_views

pycolmap = with_wheel("pycolmap")

CAMERA = rc.Camera(width=640, height=480, fx=500, fy=510)


def rig_of(n, seed):
    """n cameras on a rig, the first one not at its origin."""
    rng = np.random.default_rng(seed)
    places = rc.look_at(rng.normal(0, 0.2, (n, 3)), rng.normal((0, 0, 3), 0.2, (n, 3)))
    return rc.Rig([CAMERA] * n, None, places)


def views_of(n_cameras, n_frames, seed):
    """Frames of a moving rig, as a file has them."""
    rng = np.random.default_rng(seed)
    rig = rig_of(n_cameras, seed)
    eyes = rng.normal((0, 0, -4), 1, (n_frames, 3))
    poses = rig.poses(rc.look_at(eyes, rng.normal(0, 0.1, (n_frames, 3)), (0, -1, 0)))
    frames = [f"t{row // n_cameras}" for row in range(len(poses))]
    names = tuple(f"{frame}/{camera}" for frame, camera in zip(frames, poses.camera, strict=True))
    return rc.Views(rig=rig, poses=poses, images=names, frames=tuple(frames))


def sets_of(frames):
    """Rows of each frame, whatever its name."""
    rows = {}
    for row, frame in enumerate(frames):
        rows.setdefault(frame, []).append(row)
    return sorted(rows.values())


def test_frames_of_one_image_each_say_nothing(tmp_path):
    model_of(["PINHOLE"], np.random.default_rng(5)).write_binary(tmp_path)
    assert (tmp_path / "frames.bin").exists()
    assert read_views(tmp_path).frames == ()


@pytest.mark.slow
@pytest.mark.parametrize("form", ["colmap", "colmap-text"])
@settings(max_examples=amount(8, 30), deadline=None)
@given(
    n=st.integers(2, 4), count=st.integers(1, 4), gone=st.integers(0, 5), seed=st.integers(0, 99)
)
def test_frames_and_rigs_come_back_from_colmap(tmp_path_factory, form, n, count, gone, seed):
    folder = tmp_path_factory.mktemp("model")
    views = views_of(n, count, seed)
    # Frames may lack images, and images may come in any order.
    rng = np.random.default_rng(seed)
    rows = rng.permutation(len(views.poses))[: max(1, len(views.poses) - gone)]
    views = replace(
        views,
        poses=views.poses[rows],
        images=tuple(views.images[row] for row in rows),
        frames=tuple(views.frames[row] for row in rows),
    )
    notes = write_views(folder / "out", views, format=form)
    assert not any("left out" in note for note in notes)
    again = read_views(folder / "out")
    points = some_points(rng)
    same_pixels(views, again, points)
    if len(set(views.frames)) < len(views.frames):
        assert sets_of(again.frames) == sets_of(views.frames)
    other = pycolmap.Reconstruction(folder / "out")
    index = {image.name: image for image in other.images.values()}
    frames = [index[name].frame_id for name in views.images]
    assert sets_of(frames) == sets_of(views.frames)
    # COLMAP takes poses from frames and rigs, we from the images.
    result, wanted = expected(other, points), pixels_of(views, points)
    order = [sorted(other.images).index(index[name].image_id) for name in views.images]
    inside = np.isfinite(wanted).all(axis=-1) & np.isfinite(result[order]).all(axis=-1)
    same(result[order][inside], wanted[inside], 1e-6)


def test_places_are_those_of_the_written_rig(tmp_path):
    views = views_of(3, 2, 4)
    write_views(tmp_path / "out", views)
    rig, given_ = read_views(tmp_path / "out").rig.rig_from_camera, views.rig.rig_from_camera
    same(np.linalg.inv(rig[:2]) @ rig[1:], np.linalg.inv(given_[:2]) @ given_[1:])


def test_frames_that_do_not_fit_the_rig_are_left_out_and_said(tmp_path):
    views = views_of(2, 3, 1)
    moved = views.poses.world_from_camera.copy()
    moved[3, 0, 3] += 1e-4
    bent = replace(views, poses=replace(views.poses, world_from_camera=moved))
    notes = write_views(tmp_path / "bent", bent)
    assert has_note(notes, "frames are left out: their images do not agree")
    assert not (tmp_path / "bent" / "frames.bin").exists()
    same_pixels(bent, read_views(tmp_path / "bent"), some_points(np.random.default_rng(0)))
    twice = replace(views, frames=("t",) * 6)
    notes = write_views(tmp_path / "twice", twice)
    assert "frames are left out: one of them has two images of a camera" in notes


@pytest.mark.parametrize("name", ["transforms.json", "scene.glb"])
def test_what_has_no_frames_says_so(tmp_path, name):
    notes = write_views(tmp_path / name, views_of(2, 3, 1))
    assert has_note(notes, "frames are left out")
    assert not read_views(tmp_path / name, conventions=SIZE).frames


def test_our_json_keeps_frames(tmp_path):
    views = views_of(2, 3, 1)
    write_views(tmp_path / "a.json", views)
    assert read_views(tmp_path / "a.json").frames == views.frames
    with pytest.raises(rc.PoseError, match="frames to have a name for each of 6 poses"):
        replace(views, frames=("t",))


@pytest.mark.parametrize(
    ("times", "rows"),
    [
        ([0, 0.5, 0, 0.5], [0, 1, 0, 1]),
        ([0, 1, 2, 3], []),
        ([0, 0, 1, None], [0, 0, 2, 3]),
        ([1.7e9 + 0.1, 1.7e9 + 0.1, 1.7e9 + 0.2, 1.7e9 + 0.3], [0, 0, 2, 3]),  # since 1970
    ],
)
def test_images_of_a_scene_in_motion_have_the_frame_of_their_time(tmp_path, times, rows):
    frames = [
        {"file_path": "a", "transform_matrix": np.eye(4).tolist(), "time": time} for time in times
    ]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"fl_x": 500, "w": 640, "h": 480, "frames": frames}))
    result = read_views(path).frames
    assert [result.index(name) for name in result] == rows
    assert all(name == "image 3" or name.startswith("time ") for name in result)


def test_instances_of_an_opensfm_rig_are_frames(tmp_path):
    camera = {"projection_type": "perspective", "width": 640, "height": 480, "focal": 0.8}
    on_rig = {"left": ([0.1, 0, 0], [0, 0, 0.5]), "right": ([0, 0.3, 0], [1, 2, 3])}
    instances = {"x": ([0.1, 0.2, 0.3], [3, 2, 1]), "y": ([0.3, 0, -0.2], [5, 6, 7])}
    path, names = tmp_path / "reconstruction.json", ("rotation", "translation")
    shots, ids = {}, {"x": {}, "y": {}}
    for name, side in itertools.product(instances, on_rig):
        both = motion(*on_rig[side]) @ motion(*instances[name])  # camera_from_rig, rig_from_world
        pose = cv2.Rodrigues(both[:3, :3])[0].ravel().tolist(), both[:3, 3].tolist()
        shots[f"{name} {side}"] = {**dict(zip(names, pose, strict=True)), "camera": side}
        ids[name][f"{name} {side}"] = side
    rig = {side: dict(zip(names, place, strict=True)) for side, place in on_rig.items()}
    instances = {name: {"rig_camera_ids": its} for name, its in ids.items()}
    content = {"cameras": dict.fromkeys(on_rig, camera), "shots": shots, "rig_cameras": rig}

    def read():
        path.write_text(json.dumps([content | {"rig_instances": instances}]))
        return read_views(path)

    views = read()
    assert views.frames == ("x", "x", "y", "y")
    same(views.rig.rig_from_camera, [np.linalg.inv(motion(*its)) for its in on_rig.values()])
    # So that COLMAP gets the rig.
    write_views(tmp_path / "model", views)
    assert (tmp_path / "model" / "frames.bin").exists()
    again = read_views(tmp_path / "model").poses.world_from_camera
    same(again, views.poses.world_from_camera)
    # One lens at two places of the rig has no place of its own, and frames of one image are none.
    for shot in shots.values():
        shot["camera"] = "left"
    assert read().frames == views.frames
    np.testing.assert_array_equal(read().rig.rig_from_camera[0], np.eye(4))
    for name, its in ids.items():
        its.pop(f"{name} right")
    assert read().frames == ()
    instances["x"]["rig_camera_ids"] = ["x left"]
    with pytest.raises(rc.CameraError, match="rig_camera_ids to be a table of images"):
        read()


def test_frames_with_names_that_print_alike_stay_apart(tmp_path):
    long = "x" * 250
    frames = [f"{long}1", f"{long}1", f"{long}2", f"{long}2", "a", "a ", "", "\n"]
    table = {"cameras": [CAMERA.to_json()], "world_from_camera": [np.eye(4).tolist()] * 8}
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(table | {"frame": frames}))
    result = read_views(path).frames
    assert [result.index(name) for name in result] == [frames.index(name) for name in frames]
    assert all(name.isprintable() and name for name in result)
