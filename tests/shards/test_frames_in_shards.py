"""Frames of a motion in shards: the same figures as in one run, by workers and after an end."""

import json

import numpy as np
import pytest
from swept_arm import CAMERAS, cell, frames, sweep
from timed import evaluate_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.coverage import shards
from rastercov.core.coverage.shards import UNFINISHED
from rastercov.motion import over_time
from rastercov.shards.store import store

CAMERA = rc.Camera(width=320, height=240, fx=250, fy=250)
TASK = rc.Task(max_incidence_deg=75)
MESH = cell(n=8)
RIG = rc.Rig([CAMERA] * 2, ["left", "right"])
PLACED = RIG.poses(CAMERAS[:2])
NAMES = ("pose_ids", "xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound")


def motion_of(n=7, there=None, **options):
    moves = frames(sweep(n))
    present = {"link6": [row % 3 != 1 for row in range(n)]}
    return rc.Motion(MESH, moves, present if there is None else there, **options)


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    """Shards of two frames of four poses; workers read their size from the header."""
    monkeypatch.setattr(over_time, "PAIRS_A_SHARD", 8 * MESH.n_faces)


def same(one, other):
    for name in NAMES:
        assert getattr(one.regions, name).tobytes() == getattr(other.regions, name).tobytes()
    assert json.dumps(one.summary()) == json.dumps(other.summary())


CASES = {
    "cameras": ((CAMERA, CAMERAS), {}),
    "on a body": ((CAMERA, CAMERAS), {"body": "link3"}),
    "heads": ((rc.Rig([CAMERA] * 2, ["left", "right"], rule=rc.All()), PLACED), {}),
}


@pytest.mark.parametrize("case", CASES)
def test_shards_have_the_figures_of_one_run_to_the_bit(tmp_path, case):
    assert_kept(tmp_path, *CASES[case])


def assert_kept(tmp_path, scene, options):
    plain = evaluate_over_time(motion_of(), *scene, TASK, 0.5, **options)
    kept = evaluate_over_time(motion_of(), *scene, TASK, 0.5, shards=tmp_path, **options)
    same(plain, kept)
    assert sorted(len(list(each.glob("shards/*"))) for each in tmp_path.iterdir()) >= [1, 2]


@pytest.mark.slow
def test_workers_make_the_shards_of_one_process(tmp_path):
    results = [
        evaluate_over_time(motion_of(), CAMERA, CAMERAS, TASK, shards=(tmp_path / name, workers))
        for name, workers in (("alone", None), ("workers", rc.Workers(2)))
    ]
    same(*results)
    made = [
        {path.name: path.read_bytes() for path in (tmp_path / name).glob("*/shards/*")}
        for name in ("alone", "workers")
    ]
    assert made[0] == made[1]
    assert len(made[0]) == 4


def test_shards_of_another_motion_with_their_checksums_are_made_again(tmp_path):
    scene, (one, other) = (CAMERA, CAMERAS, TASK), (tmp_path / name for name in ("one", "other"))
    plain = evaluate_over_time(motion_of(), *scene, shards=one)
    evaluate_over_time(rc.Motion(MESH, frames(sweep(7)[::-1])), *scene, shards=other)
    # The poses at rest are the same in both.
    (own,), (theirs,) = (
        [path for path in here.iterdir() if not (there / path.name).exists()]
        for here, there in ((one, other), (other, one))
    )
    for number in (0, 2):
        data = (theirs / f"shards/shard-0000{number}.npz").read_bytes()
        store(own, f"shards/shard-0000{number}.npz", data)
    same(plain, evaluate_over_time(motion_of(), *scene, shards=one))


def test_poses_are_kept_in_shards_and_taken_from_there(tmp_path, monkeypatch):
    plain = rc.evaluate(MESH, CAMERA, CAMERAS, TASK, fields=())
    monkeypatch.setattr(shards, "PAIRS_A_SHARD", 2 * MESH.n_faces)
    first = rc.evaluate(MESH, CAMERA, CAMERAS, TASK, shards=tmp_path)
    assert len(list(tmp_path.glob("*/shards/*.npz"))) == 2
    monkeypatch.setattr(shards, "_measure_poses", lambda *_: pytest.fail("measured again"))
    second = rc.evaluate(MESH, CAMERA, CAMERAS, TASK, shards=tmp_path)
    assert first.covered.area.tobytes() == second.covered.area.tobytes()
    assert np.abs(first.covered.area - plain.covered.area).max() <= 1e-12
    assert first.network.summary() == second.network.summary() == plain.network.summary()
    with pytest.raises(ConfigError, match="expected reason among the fields"):
        _ = first.reason


class EndedError(Exception):
    """The run was ended."""


def test_a_run_that_was_ended_goes_on_and_other_motions_do_not_mix(tmp_path, monkeypatch):
    measured, calls, last = over_time._of_frames, [], [[4, 5]]

    def counted(job, rows):
        calls.append(rows.tolist())
        if calls[-1:] == last:
            last.clear()
            raise EndedError
        return measured(job, rows)

    monkeypatch.setattr(over_time, "_of_frames", counted)
    scene = CAMERA, CAMERAS, TASK
    with pytest.raises(EndedError):
        evaluate_over_time(motion_of(), *scene, shards=tmp_path)
    # Another motion takes none of them, and other durations or another question all.
    other = rc.Motion(MESH, frames(sweep(7)[::-1]))
    same(evaluate_over_time(other, *scene, shards=tmp_path), evaluate_over_time(other, *scene))
    assert calls[3:] == [[0, 1], [2, 3], [4, 5], [6]]
    (kept,) = (path for path in tmp_path.iterdir() if len(list(path.glob("shards/*"))) == 2)
    damaged = kept / "shards" / "shard-00000.npz"
    damaged.write_bytes(damaged.read_bytes()[:-9])
    del calls[:]
    evaluate_over_time(motion_of(), *scene, shards=tmp_path)
    timed = motion_of(durations=[1, 1, 2, 1, 1, 3, 1])
    kept = evaluate_over_time(timed, *scene, "all", shards=tmp_path)
    same(kept, evaluate_over_time(timed, *scene, "all"))
    assert calls == [[0, 1], [4, 5], [6]]


def test_a_report_of_a_motion_is_that_of_one_run(tmp_path, monkeypatch):
    from rastercov.motion.over_time import OfFrames
    from rastercov.report.coverage import Options, run

    phases = OfFrames(rc.MotionQuery(motion_of(), "all"))
    own = Options(pictures=0)

    def report(name):
        run_result = run(MESH, CAMERA, CAMERAS, TASK, tmp_path / name, own, phases=phases)
        assert not (tmp_path / name / UNFINISHED).exists()
        return run_result["over_time"]

    plain = report("plain")
    monkeypatch.setattr(shards, "LONG_RUN", 2)
    assert json.dumps(report("shards")) == json.dumps(plain)


def test_what_cannot_be_is_refused_in_one_line(tmp_path, monkeypatch):
    motion = motion_of()
    with pytest.raises(
        ConfigError,
        match=r"expected further arguments motion.*, got 'workers'; give shards=\(FOLDER",
    ):
        evaluate_over_time(motion, CAMERA, CAMERAS, TASK, workers=rc.Workers(1))
    with pytest.raises(ConfigError, match="fields or a folder for shards, got both"):
        rc.evaluate(MESH, CAMERA, CAMERAS, TASK, fields=["reason"], shards=tmp_path)
    many = rc.Motion(MESH, {"link1": rc.turntable(5001)})
    with pytest.raises(ConfigError, match=r"10,000 images.*folder") as error:
        evaluate_over_time(many, CAMERA, CAMERAS[:2], TASK)
    assert "\n" not in str(error.value)
    for frame in (1, 4):
        noted = {frame: "was killed by SIGKILL"}
        monkeypatch.setattr(shards.ShardStore, "quarantined", lambda self, noted=noted: noted)
        with pytest.raises(ConfigError, match=f"a result of frame {frame}, got none: its") as error:
            evaluate_over_time(motion, CAMERA, CAMERAS, TASK, shards=tmp_path)
        assert "\n" not in str(error.value)
