"""Evaluations in shards: by this process, by workers, and gone on with after an end."""

import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from nightly import nightly

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.coverage import shards as evaluation_shards
from rastercov.core.coverage.shards import UNFINISHED
from rastercov.core.mesh import shapes
from rastercov.placement.audit import audit
from rastercov.report import coverage
from rastercov.report.coverage import Options, run
from rastercov.shards import Staff, Workers
from rastercov.shards.store import store

pytestmark = pytest.mark.slow
MESH = shapes.teapot(4)
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
POSES = rc.sphere_of_poses(MESH.bounds.mean(axis=0), 5.0 * np.ptp(MESH.bounds), 42)
CAMERAS = rc.Rig([CAMERA, rc.Camera(width=200, height=200, fx=150, fy=150)], ["tele", "wide"])
PLACED = rc.Poses.of(POSES, camera=np.arange(42) % 2)
TIMES = ("seconds", "poses_per_second")


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    """Shards of 8 poses; workers read their size from the header."""
    monkeypatch.setattr(evaluation_shards, "PAIRS_A_SHARD", 8 * MESH.n_faces)


def evaluated(out, poses=POSES, camera=CAMERA, task=None, workers=None, **options):
    options = Options(**{"pictures": 0, **options})
    return run(MESH, camera, poses, task or rc.Task(), out, options, Staff(workers))


def content(out):
    """Bytes of the files of a report but for its times, and the summary without them."""
    summary = json.loads((out / "summary.json").read_text())
    for name in TIMES:
        summary.pop(name)
    summary["run"].pop("options")
    bytes_of = {
        path.name: path.read_bytes()
        for path in out.iterdir()
        if path.is_file() and path.suffix != ".json"
    }
    return bytes_of, summary


def same(one, other):
    (files, summary), (others, other_summary) = content(one), content(other)
    assert files.keys() == others.keys()
    assert [name for name in files if files[name] != others[name]] == []
    assert summary == other_summary


CASES = {
    "area": {"pictures": 3},
    "face": {"by": "face", "pictures": 3},
    "sampled": {"method": "sampled:cpu@2"},
    "no table": {"table": "none"},
    "two cameras": {"poses": PLACED, "camera": CAMERAS, "pictures": 3},
}
AT_NIGHT = ("sampled", "no table", "two cameras")


@pytest.mark.parametrize(
    "case", [pytest.param(each, marks=nightly if each in AT_NIGHT else ()) for each in CASES]
)
def test_workers_leave_the_report_of_one_process(tmp_path, case, monkeypatch):
    options = CASES[case]
    evaluated(tmp_path / "streamed", **options)
    evaluated(tmp_path / "workers", workers=Workers(2), **options)
    monkeypatch.setattr(evaluation_shards, "LONG_RUN", 1)
    evaluated(tmp_path / "shards", **options)
    same(tmp_path / "workers", tmp_path / "shards")
    assert not (tmp_path / "workers" / UNFINISHED).exists()
    # Without shards, faces that are covered as a whole need no more regions: bounds may differ.
    (_, streamed), (_, result) = content(tmp_path / "streamed"), content(tmp_path / "workers")
    for name in ("covered", "not_covered", "mean_views", "visibility_figures", "per_pose"):
        assert streamed[name] == result[name]
    if "covered_area" in streamed:
        areas = [each["covered_area"]["m2"] for each in (streamed, result)]
        assert areas[0] == pytest.approx(areas[1], rel=1e-12)
    table = tmp_path / "streamed" / "coverage.parquet"
    if table.exists():
        assert pq.read_table(table).equals(pq.read_table(tmp_path / "workers/coverage.parquet"))


class EndedError(Exception):
    """The run was ended."""


def test_a_run_that_was_ended_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluation_shards, "LONG_RUN", 1)
    evaluated(tmp_path / "whole")
    measured, calls = evaluation_shards._measure_poses, []

    def counted(observer, poses, *arguments):
        calls.append(poses.ids.tolist())
        if len(calls) == 4:
            raise EndedError
        return measured(observer, poses, *arguments)

    monkeypatch.setattr(evaluation_shards, "_measure_poses", counted)
    with pytest.raises(EndedError):
        evaluated(tmp_path / "ended")
    assert not (tmp_path / "ended" / "summary.json").exists()
    (kept,) = (tmp_path / "ended" / UNFINISHED).iterdir()
    shards = sorted((kept / "shards").iterdir())
    assert len(shards) == 3
    shards[1].write_bytes(shards[1].read_bytes()[:-9])  # and one of them is damaged meanwhile
    store(kept, "shards/shard-00000.npz", shards[2].read_bytes())  # whole, and of other poses
    shutil.copytree(tmp_path / "ended", tmp_path / "without")
    evaluated(tmp_path / "ended")
    assert [ids[0] for ids in calls[4:]] == [0, 8, 24, 32, 40]
    same(tmp_path / "ended", tmp_path / "whole")
    assert not (tmp_path / "ended" / UNFINISHED).exists()
    monkeypatch.setattr(evaluation_shards, "LONG_RUN", 1 << 20)
    evaluated(tmp_path / "without")  # in no shards, as without --workers
    assert not (tmp_path / "without" / UNFINISHED).exists()


@pytest.mark.parametrize("kind", ["link", "file"])
def test_a_report_leaves_alone_what_is_in_the_place_of_shards(tmp_path, kind):
    (tmp_path / "other").mkdir()
    for name in ("out", "audit"):
        there = tmp_path / name / UNFINISHED
        there.parent.mkdir()
        there.symlink_to(tmp_path / "other") if kind == "link" else there.write_text("mine")
    evaluated(tmp_path / "out", POSES[:2])
    rc.audit(MESH, rc.Views(CAMERAS, PLACED[:2], ("a", "b")), out=tmp_path / "audit")
    assert (tmp_path / "audit" / "audit.html").exists()
    assert {path.name for path in tmp_path.glob(f"*/{UNFINISHED}")} == {UNFINISHED}


def test_other_settings_do_not_take_old_shards(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluation_shards, "LONG_RUN", 1)
    evaluated(tmp_path / "whole", task=rc.Task(min_pixels=40), by="face")
    with monkeypatch.context() as patch:
        patch.setattr(coverage, "remove", lambda folder: None)
        evaluated(tmp_path / "both", by="face")
    assert (tmp_path / "both" / UNFINISHED).exists()
    evaluated(tmp_path / "both", task=rc.Task(min_pixels=40), by="face")
    same(tmp_path / "both", tmp_path / "whole")
    assert not (tmp_path / "both" / UNFINISHED).exists()


POISONED = 3
FEW, SMALL = POSES[:6], 2
"""Poses, and those of each shard, where processes die: each suspect is tried in a process."""


def poisoned(folder, number, chosen):
    """`evaluation_shards.make`, which one pose kills."""
    if POISONED in chosen:
        os.kill(os.getpid(), signal.SIGKILL)
    return evaluation_shards.make(folder, number, chosen)


@pytest.fixture
def a_killer(monkeypatch):
    monkeypatch.setattr(evaluation_shards, "PAIRS_A_SHARD", SMALL * MESH.n_faces)
    shards = evaluation_shards.EvaluationShards
    monkeypatch.setattr(shards, "function", "test_evaluation_workers:poisoned")
    monkeypatch.syspath_prepend(Path(__file__).parent)


@pytest.mark.parametrize("by", ["area", "face"])
def test_workers_audit_like_one_process(tmp_path, by):
    options = {"by": by, "names": [f"image {row}" for row in range(42)]}
    alone = audit(MESH, CAMERAS, PLACED, **options)
    kept = audit(MESH, CAMERAS, PLACED, folder=tmp_path / "kept", **options)
    many = audit(MESH, CAMERAS, PLACED, folder=tmp_path / "w", staff=Staff(Workers(2)), **options)
    assert files(tmp_path / "kept") == files(tmp_path / "w")
    for item in (kept, many):
        np.testing.assert_array_equal(alone.views, item.views)
        for one, other in zip(alone.problem.bits.pairs(), item.problem.bits.pairs(), strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(alone.subset.chosen, item.subset.chosen)
        np.testing.assert_array_equal(alone.lost_m2, item.lost_m2)
    with pytest.raises(ConfigError, match="expected a folder for workers"):
        audit(MESH, CAMERAS, PLACED, staff=Staff(Workers(1)))


def files(folder):
    shards = sorted(folder.glob("*/shards/*"))
    assert len(shards) == 6
    return {path.name: path.read_bytes() for path in shards}


def test_a_pose_that_kills_its_worker_is_left_out(tmp_path, a_killer):
    result = evaluated(tmp_path / "m", FEW, by="face", workers=Workers(2))
    assert result["quarantined"] == {str(POISONED): "was killed by SIGKILL"}
    assert result["poses"] == len(FEW) - 1
    alone = evaluated(tmp_path / "others", np.delete(FEW, POISONED, axis=0), by="face")
    assert alone["covered"] == result["covered"]
