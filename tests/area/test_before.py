"""`evaluate --before`: what other poses covered and these do not, and the reverse."""

import json
import re

import numpy as np
import pytest
from commands import done, enter, refusal
from plans import write_obj
from scipy.spatial.transform import Rotation

import rastercov as rc
from rastercov.advice.before import compare, lines_of
from rastercov.core.camera.pose import Poses

CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=40)
TASKS = {
    "one view": rc.Task(max_incidence_deg=70),
    "two views": rc.Task(views=2),
    "an angle": rc.Task(views=2, min_angle_deg=15),
}


def scene(seed):
    """Two boxes of which one hides the other, and poses before and now."""
    rng = np.random.default_rng(seed)
    parts = rc.shapes.box((0.3, 0.2, 0.1)), rc.shapes.box((0.05, 0.3, 0.3))
    off = np.repeat([[0, 0, 0], [0.25, 0, 0]], [len(each.vertices) for each in parts], axis=0)
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)])
    mesh = rc.Mesh(np.concatenate([each.vertices for each in parts]) + off, faces)
    eyes = rng.normal(size=(2, 5, 3))
    eyes *= 0.7 / np.linalg.norm(eyes, axis=2, keepdims=True)
    return mesh, *(Poses.of(rc.look_at(each, rng.normal(scale=0.05, size=3))) for each in eyes)


def area(mesh, poses, task):
    summary = rc.evaluate(mesh, CAMERA, poses, task, by="area", fields=()).areas.summary()
    return summary["m2"], summary["bound_m2"]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", TASKS)
def test_what_is_lost_less_what_is_gained_is_the_change_of_the_area(name, seed):
    (mesh, before, now), task = scene(seed), TASKS[name]
    told = compare(mesh, (CAMERA, now), (CAMERA, before), task)
    sums = [area(mesh, each, task) for each in (before, now)]
    change = told["lost"]["m2"] - told["gained"]["m2"]
    bound = told["lost"]["bound_m2"] + 1e-9
    assert change == pytest.approx(sums[0][0] - sums[1][0], abs=bound)
    assert told["lost"]["m2"] > 1e-4
    assert told["gained"]["m2"] > 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_what_all_cameras_cover_is_what_they_cover_now_and_what_is_lost(seed):
    (mesh, before, now), task = scene(seed), TASKS["one view"]
    told = compare(mesh, (CAMERA, now), (CAMERA, before), task)
    every = Poses.of(np.concatenate([before.world_from_camera, now.world_from_camera]))
    both = area(mesh, every, task)[0]
    for kind, poses in (("lost", now), ("gained", before)):
        assert told[kind]["m2"] == pytest.approx(both - area(mesh, poses, task)[0], abs=1e-9)
        listed = sum(zone["area_m2"] for zone in told[kind]["zones"])
        assert listed <= told[kind]["m2"] * (1 + 1e-9)
        reasons = {*told[kind]["zones"][0]["reason"].split("+")}
        assert reasons <= {"occluded", "outside", "too_oblique", "back_facing"}


def test_the_same_poses_lose_nothing():
    mesh, before, _ = scene(0)
    told = compare(mesh, (CAMERA, before), (CAMERA, before), rc.Task())
    assert told["cameras"] == []
    for kind in ("lost", "gained"):
        assert told[kind]["n_zones"] == 0
        assert told[kind]["m2"] == 0


def test_cameras_that_differ_are_named():
    mesh, before, _ = scene(0)
    poses = before.world_from_camera.copy()
    poses[1, :3, :3] = poses[1, :3, :3] @ Rotation.from_euler("z", 60, degrees=True).as_matrix()
    poses[3, 0, 3] += 0.25
    other, row = rc.Camera.from_fov(640, 480, hfov_deg=50), np.array([0, 0, 0, 0, 1])
    cameras, now = (CAMERA, other), Poses.of(poses, camera=row)
    told = compare(mesh, (cameras, now), (CAMERA, before), rc.Task())
    items = [(each["before"], each["now"], each["is_exchanged"]) for each in told["cameras"]]
    assert items == [(1, 1, False), (3, 3, False), (4, 4, True)]
    assert [each["moved_m"] for each in told["cameras"]] == pytest.approx([0, 0.25, 0], abs=1e-12)
    assert [each["turned_deg"] for each in told["cameras"]] == pytest.approx([60, 0, 0], abs=1e-6)
    lines = [line for line in lines_of({"poses": "old.json", **told}) if "changed" in line]
    assert [re.sub(r"at \(.*\) m", "at HERE", line) for line in lines] == [
        "changed: camera 2 at HERE: turned by 60°",
        "changed: camera 4 at HERE: moved by 0.25 m",
        "changed: camera 5 at HERE: exchanged",
    ]


def test_cameras_that_are_added_or_removed_are_named():
    mesh, before, now = scene(0)
    own = before.world_from_camera
    fewer = Poses.of(np.concatenate([own[[4, 0, 2]], now.world_from_camera[:1]]))
    told = compare(mesh, (CAMERA, fewer), (CAMERA, before), rc.Task())
    items = [(each["before"], each["now"]) for each in told["cameras"]]
    assert items == [(1, None), (3, None), (None, 3)]
    words = [line.split(" m: ")[-1] for line in lines_of({"poses": "", **told}) if "chang" in line]
    assert words == ["removed", "removed", "added"]


def test_without_cameras_all_is_lost():
    mesh, before, now = scene(0)
    told = compare(mesh, (CAMERA, now[:0]), (CAMERA, before), rc.Task())
    assert told["lost"]["m2"] == pytest.approx(area(mesh, before, rc.Task())[0], rel=1e-9)
    assert {zone["reason"] for zone in told["lost"]["zones"]} == {"no_cameras"}
    assert told["gained"]["m2"] == 0
    assert lines_of({"poses": "old.json", **told})[0].startswith("compared with old.json: lost ")


def test_the_command_compares_with_earlier_poses(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    mesh, before, now = scene(1)
    write_obj("part.obj", mesh)
    for name, poses in (("old", before), ("new", now)):
        rc.write_poses(f"{name}.json", poses)
    line = "evaluate part.obj -c 'width = 640, height = 480, hfov_deg = 40' -p new.json -o out"
    out, _ = done(capsys, f"{line} --before old.json")
    assert "compared with old.json: lost " in out
    assert "gained: " in out
    told = json.loads(done(capsys, f"{line} --before old.json --json")[0])["before"]
    mesh = rc.Mesh.load("part.obj")
    expected = compare(mesh, (CAMERA, now), (CAMERA, before), rc.Task())
    for kind in ("lost", "gained"):
        assert told[kind]["m2"] == pytest.approx(expected[kind]["m2"], rel=1e-6)
    assert "--before" in refusal(capsys, f"{line} --before old.json --by face")
    assert "min_pixels" in refusal(capsys, f"{line} --before old.json --min-pixels 5")
