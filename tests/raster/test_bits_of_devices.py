"""Bits that `evaluate` takes from a device: those of the CPU, and what else is asked for later."""

import logging
from dataclasses import replace

import hostile_scenes
import judged_scenes
import numpy as np
import pytest
from gl_device import DEVICE, IN_SOFTWARE

import rastercov as rc
from rastercov.base.errors import PartMadeError
from rastercov.core.coverage import network
from rastercov.core.coverage import shards as evaluation_shards
from rastercov.core.coverage.network import LATER
from rastercov.gl import GLRasterizer
from rastercov.gl.libraries import Egl
from rastercov.shards import Workers

pytestmark = pytest.mark.matter("opengl")
MESH = rc.shapes.torus(12, 8)
CAMERA = rc.Camera.from_fov(80, 60, hfov_deg=50)
POSES = rc.sphere_of_poses((0, 0, 0), 2 * MESH.diagonal, 23)
TASK = rc.Task(max_incidence_deg=60)
BITS = ("packed", "area_units", "views")


@pytest.fixture
def judged(monkeypatch):
    """Batches that a device judged; software is given the plan of GPUs."""
    calls, honest = [], GLRasterizer._judge
    monkeypatch.setattr(GLRasterizer, "_choose_plan", lambda self, plan: "compute")

    def noted(self, poses, criteria):
        calls.append(len(poses))
        return honest(self, poses, criteria)

    monkeypatch.setattr(GLRasterizer, "_judge", noted)
    return calls


def evaluate(mesh, camera, poses, task, device, supersample=1, **options):
    engine = rc.Engine("sampled", device, supersample)
    return rc.evaluate(mesh, camera, poses, task, method=engine, **options)


def check_same(ours, theirs):
    for name in BITS:
        np.testing.assert_array_equal(getattr(ours.bits, name), getattr(theirs.bits, name))
    np.testing.assert_array_equal(ours.clipped, theirs.clipped)
    np.testing.assert_array_equal(ours.pose_ids, theirs.pose_ids)
    np.testing.assert_array_equal(ours.network.views, theirs.network.views)
    assert ours.network.clipped_poses == theirs.network.clipped_poses


@pytest.mark.parametrize("seed", range(6))
def test_evaluate_has_the_bits_of_the_cpu_and_all_else_when_it_is_read(judged, seed):
    rng = np.random.default_rng(seed)
    make = (hostile_scenes.scene, judged_scenes.scene)[seed % 2]
    mesh, camera, poses, supersample = make(rng)
    task = rc.Task(max_incidence_deg=70, min_visibility=0.2, min_pixels=2, views=1 + seed % 2)
    scene = (mesh, camera, poses, task)
    ours, theirs = (
        evaluate(*scene, device, supersample, fields=("covered",)) for device in (DEVICE, "cpu")
    )
    assert sum(judged) == len(poses)
    check_same(ours, theirs)
    assert not set(LATER) & set(vars(ours.network))
    for name in LATER:
        expected = getattr(theirs.network, name)
        np.testing.assert_array_equal(getattr(ours.network, name), expected, err_msg=name)
    assert ours.network.summary() == theirs.network.summary()


@pytest.mark.every_day
def test_shards_keep_the_bits_that_a_device_judged(judged, tmp_path):
    run = (MESH, CAMERA, POSES, TASK, DEVICE)
    ours = evaluate(*run, fields=("covered",), shards=tmp_path)
    assert sum(judged) == len(POSES)
    again = evaluate(*run, fields=("covered",), shards=tmp_path)
    assert sum(judged) == len(POSES)  # none is judged again
    theirs = evaluate(*run[:-1], "cpu", fields=("covered",))
    check_same(ours, theirs)
    check_same(again, theirs)


def test_two_processes_use_a_device_at_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluation_shards, "PAIRS_OF_COUNTS", 3 * MESH.n_faces)
    camera = replace(CAMERA, model="telecentric", fx=20, fy=20)  # by shaders that compute
    run, made = (MESH, camera, POSES, TASK), {"fields": ("covered",)}
    ours = evaluate(*run, DEVICE, shards=(tmp_path, Workers(2)), **made)
    assert ours.info.plan == "compute"
    assert ours.bits.views.any()
    check_same(ours, evaluate(*run, "cpu", **made))


@pytest.mark.skipif(not IN_SOFTWARE, reason="the devices are Mesa's")
def test_two_devices_share_a_folder_by_a_process_each(judged, tmp_path, monkeypatch):
    devices = Egl.devices
    monkeypatch.setattr(Egl, "devices", lambda self: devices(self)[:1] * 2)
    for name in ("PAIRS_A_SHARD", "PAIRS_OF_COUNTS"):
        monkeypatch.setattr(evaluation_shards, name, 4 * MESH.n_faces)
    run, made = (MESH, CAMERA, POSES, TASK), {"fields": ("covered",)}
    for number in range(2):
        part = tmp_path, Workers(only=(number, 3))
        with pytest.raises(PartMadeError, match="run the command without --only"):
            evaluate(*run, f"egl:{number}", shards=part, **made)
    assert 0 < sum(judged) < len(POSES)
    ours = evaluate(*run, "egl:1", shards=tmp_path, **made)
    assert sum(judged) == len(POSES)  # none is judged again
    assert ours.info.device.startswith("egl:1 ")
    check_same(ours, evaluate(*run, "cpu", **made))


@pytest.mark.parametrize("seconds", [0.0, 1e9])
def test_how_many_poses_are_judged_at_a_time_changes_no_bit(judged, monkeypatch, seconds):
    monkeypatch.setattr(network, "SECONDS_JUDGED", seconds)
    monkeypatch.setattr(network, "batch_size", lambda n_faces, threads: 4)
    ours = evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=("covered",))
    assert judged == ([4, 8, 11] if seconds else [4, 2, *[1] * 17])
    check_same(ours, evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=("covered",)))


@pytest.mark.parametrize("fields", [("covered", "reason"), (), None])
def test_what_bits_alone_do_not_have_is_judged_from_counts(judged, fields):
    result = evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=fields)
    theirs = evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=fields)
    assert not judged
    assert result.network.summary() == theirs.network.summary()


@pytest.mark.parametrize(
    ("camera", "task"),
    [
        (CAMERA, replace(TASK, min_angle_deg=10)),
        ([CAMERA, CAMERA.resized(0.5)], TASK),
        (
            rc.Camera(
                width=80, height=60, fx=60, fy=60, model="opencv", distortion=[-0.1, 0, 0, 0]
            ),
            TASK,
        ),
    ],
)
def test_what_a_device_does_not_judge_has_the_same_bits(judged, camera, task):
    n = len(camera) if isinstance(camera, list) else 1
    poses = rc.Poses.of(POSES, camera=np.arange(len(POSES)) % n)
    ours = evaluate(MESH, camera, poses, task, DEVICE, fields=("covered",))
    assert not judged
    check_same(ours, evaluate(MESH, camera, poses, task, "cpu", fields=("covered",)))


def test_a_run_says_once_why_the_host_judges_what_a_device_counts(judged, monkeypatch, caplog):
    monkeypatch.setattr(GLRasterizer, "_choose_plan", lambda self, plan: "pipeline")
    with caplog.at_level(logging.WARNING, "rastercov"):
        ours = evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=("covered",))
    (line,) = caplog.messages
    assert line == (
        "the CPU judges what the device counts: plan 'pipeline' judges nothing on the device"
    )
    caplog.clear()
    check_same(ours, evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=("covered",)))
    assert not judged
    assert not caplog.messages


@pytest.mark.parametrize("device", [DEVICE, "cpu"])
def test_a_run_says_that_views_at_angles_are_judged_on_the_host(judged, caplog, device):
    with caplog.at_level(logging.WARNING, "rastercov"):
        evaluate(MESH, CAMERA, POSES, replace(TASK, min_angle_deg=10), device, fields=("covered",))
    why = "rigs with a rule, and angles of views, need more than bits"
    line = f"the CPU judges what the device counts: {why}"
    assert caplog.messages == ([] if device == "cpu" else [line])


# --- the device that is taken, and one that fails -------------------------------------------------


@pytest.fixture
def gpu(monkeypatch):
    """The device of the tests takes the place of a GPU that passed its self-test."""
    asked = []
    hooks = type("Hooks", (), {"find_gpu": lambda self: asked.append(1) or DEVICE})()
    monkeypatch.setattr(network, "drawer", lambda: hooks)
    monkeypatch.setattr(network, "LEAST_PAIRS", len(POSES) * MESH.n_faces)
    return asked


def test_auto_takes_a_gpu_for_large_runs_and_says_so(judged, gpu, caplog):
    with caplog.at_level(logging.WARNING, "rastercov"):
        ours = evaluate(MESH, CAMERA, POSES, TASK, "auto", fields=("covered",))
    assert caplog.messages == [f"device auto is {DEVICE}, for 23 poses"]
    assert sum(judged) == len(POSES)
    assert ours.info.backend == "gl"
    check_same(ours, evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=("covered",)))


LENS = rc.Camera(width=80, height=60, fx=60, fy=60, model="opencv", distortion=[-0.1, 0, 0, 0])


@pytest.mark.parametrize(
    ("device", "n", "camera", "fields"),
    [
        ("auto", -1, CAMERA, ("covered",)),  # one pose too few
        ("cpu", None, CAMERA, ("covered",)),
        ("auto", None, CAMERA, ("reason",)),
        ("auto", None, CAMERA, ()),
        ("auto", None, LENS, ("covered",)),
    ],
)
def test_auto_is_the_cpu_where_a_gpu_is_of_no_use(judged, gpu, device, n, camera, fields):
    result = evaluate(MESH, camera, POSES[:n], TASK, device, fields=fields)
    assert result.info.backend == "cpu"
    assert not gpu
    assert not judged


@pytest.mark.parametrize("after", [0, 1, 2])
def test_the_cpu_continues_where_a_device_fails(judged, monkeypatch, caplog, after):
    monkeypatch.setattr(network, "batch_size", lambda n_faces, threads: 4)
    noted = GLRasterizer._judge

    def lost(self, poses, criteria):
        if len(judged) == after:
            raise rc.DeviceError("expected a working device, got a lost one; open another")
        return noted(self, poses, criteria)

    monkeypatch.setattr(GLRasterizer, "_judge", lost)
    with caplog.at_level(logging.WARNING, "rastercov"):
        ours = evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=("covered",))
    (line,) = caplog.messages
    assert line.startswith("the CPU continues in place of a device: expected a working device")
    assert len(judged) == after
    theirs = evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=("covered",))
    check_same(ours, theirs)
    assert ours.network.summary() == theirs.network.summary()


@pytest.mark.parametrize("room", [1, 5, 23])
def test_batches_shrink_to_the_memory_that_is_there(judged, monkeypatch, room):
    noted = GLRasterizer._judge

    def short(self, poses, criteria):
        if len(poses) > room:
            raise rc.ResourceError("expected memory, got none")
        return noted(self, poses, criteria)

    monkeypatch.setattr(GLRasterizer, "_judge", short)
    ours = evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=("covered",))
    assert max(judged) <= room
    check_same(ours, evaluate(MESH, CAMERA, POSES, TASK, "cpu", fields=("covered",)))
    room = 0
    with pytest.raises(rc.ResourceError, match="expected memory, got none"):
        evaluate(MESH, CAMERA, POSES, TASK, DEVICE, fields=("covered",))
