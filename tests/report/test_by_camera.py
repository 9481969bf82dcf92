"""Reports of several cameras: figures by camera are those of its poses alone."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

import rastercov as rc
from rastercov.core.coverage.evaluation import MOST_CAMERAS, cameras_apart
from rastercov.core.mesh import shapes
from rastercov.report.coverage import Options, run
from rastercov.report.tables import shares_by_type

MESH = shapes.torus(24, 12)
WIDE = rc.Camera(width=160, height=120, fx=90, fy=90)
LONG = rc.Camera(width=240, height=240, fx=400, fy=400, cx=100, near=0.5, focus_range=(2, 6))
RIG = rc.Rig([WIDE, LONG], ["wide", "long"])
MATRICES = rc.sphere_of_poses((0, 0, 0), 4.0, 8)
INDICES = np.array([0, 1, 1, 0, 1, 0, 0, 1])
POSES = rc.Poses.of(MATRICES, camera=INDICES)
TASKS = {"area": rc.Task(max_incidence_deg=70, views=2), "face": rc.Task(min_pixels=4, views=2)}


@pytest.mark.slow
@pytest.mark.parametrize("by", TASKS)
@pytest.mark.parametrize("table", ["none", "seen"])
def test_each_camera_has_the_figures_of_its_poses_alone(by, table, tmp_path):
    options = Options(pictures=0, table=table)
    summary = run(MESH, RIG, POSES, TASKS[by], tmp_path / "all", options)
    assert summary["by"] == by
    for index, entry in enumerate(summary["by_camera"]):
        own, one = index == INDICES, replace(TASKS[by], views=1)
        wanted = run(MESH, RIG.cameras[index], MATRICES[own], one, tmp_path / str(index), options)
        alone = {name: wanted[name] for name in ("covered", "covered_area") if name in wanted}
        values = entry | alone | {"poses": int(own.sum())}
        assert close(entry, json.loads(json.dumps(values)))  # sums of floats in another order
        assert entry["camera"] == RIG.names[index]
    assert [each["camera"] for each in summary["per_pose"]] == [RIG.names[k] for k in INDICES]


def close(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(close(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(close, one, other))
    return one == (other if isinstance(one, str) else pytest.approx(other, rel=1e-9, abs=1e-9))


def test_all_cameras_together_are_one_network(tmp_path):
    summary = run(MESH, RIG, POSES, TASKS["face"], tmp_path, Options(pictures=0, table="all"))
    coverage = rc.evaluate(MESH, RIG, POSES, TASKS["face"], by="face")
    network = rc.Network(MESH, TASKS["face"])
    network.add(coverage)
    assert summary["covered"] == network.summary()["covered"]
    table = pq.read_table(tmp_path / "coverage.parquet")
    pose = np.repeat(np.arange(8), MESH.n_faces)
    np.testing.assert_array_equal(table["pose"], pose)
    assert table["camera"].to_pylist() == [RIG.names[k] for k in INDICES[pose]]
    values = coverage.coverage.ravel()
    np.testing.assert_allclose(np.array(table["coverage"]), values, rtol=1e-6, atol=1e-7)


def test_one_camera_has_the_report_it_always_had(tmp_path):
    one, other = (
        run(MESH, camera, MATRICES, TASKS["face"], tmp_path, Options(pictures=0, table="seen"))
        for camera in (WIDE, rc.Rig([WIDE], ["wide"]))
    )
    times = {"seconds": 0, "poses_per_second": 0}
    assert one | times == other | times
    assert "by_camera" not in one
    assert one["run"]["camera"] == WIDE.to_json()
    assert shares_by_type(one) == []
    assert "camera" not in pq.read_table(tmp_path / "coverage.parquet").schema.names


def test_poses_are_drawn_through_their_own_cameras(tmp_path, monkeypatch):
    drawn, key = {}, lambda pose: pose.world_from_camera.tobytes()

    def opened(mesh, camera, *arguments, **options):
        made = rc.open_rasterizer(mesh, camera, *arguments, **options)
        render = made.render
        made.render = lambda pose: drawn.update({key(pose): camera}) or render(pose)
        return made

    monkeypatch.setattr("rastercov.report.coverage.open_rasterizer", opened)
    run(MESH, RIG, POSES, TASKS["face"], tmp_path, Options())
    assert [drawn[pose.tobytes()] for pose in MATRICES] == [RIG.cameras[k] for k in INDICES]


def test_too_many_cameras_have_no_figures_of_their_own():
    poses = rc.Poses.of(np.repeat(MATRICES[:1], MOST_CAMERAS + 1, axis=0))
    cameras = [WIDE] * (MOST_CAMERAS + 1)
    every = rc.Poses.of(poses, camera=np.arange(len(poses)))
    assert cameras_apart(cameras, every) == []
    assert cameras_apart(cameras, every[1:]) == list(range(1, MOST_CAMERAS + 1))
    assert cameras_apart(WIDE, poses) == []


def test_the_table_of_a_terminal_names_each_camera():
    left = {"camera": "left", "poses": 3, "covered": {"faces": 1200, "percent": 40.0}}
    right = left | {"camera": "right", "covered_area": {"m2": 2.5, "percent": 50.0}}
    summary = {"by_camera": [left, right]}
    assert shares_by_type(summary) == ["left 40.0 %", "right 50.0 %"]


def test_poses_of_a_camera_that_is_not_there_are_refused(tmp_path):
    with pytest.raises(rc.PoseError, match="camera indices below 1, got 1"):
        run(MESH, WIDE, POSES, rc.Task(), tmp_path, Options(pictures=0))
