"""Visibility matrices made by workers: the same bytes as those of this process."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

import rastercov as rc
from rastercov import shapes
from rastercov.area.cells import cells
from rastercov.cluster import Workers
from rastercov.errors import ConfigError
from rastercov.placement import matrix as matrix_module
from rastercov.placement import shard_work
from rastercov.placement.explain.candidate_visibility import CandidateBounds
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.mounts import Mounts

pytestmark = [pytest.mark.slow, pytest.mark.compile]
MESH = shapes.teapot(4)
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
POSES = rc.sphere_of_poses(MESH.bounds.mean(axis=0), 5.0 * np.ptp(MESH.bounds), 42)


def files(folder):
    return {path.name: path.read_bytes() for path in sorted((folder / "pairs").iterdir())}


def both(tmp_path, poses=POSES, view=(MESH, CAMERA), **options):
    plain = build_matrix(view, poses, None, tmp_path / "plain", poses_a_shard=8, **options)
    made = []
    by_workers = build_matrix(
        view, poses, None, tmp_path / "workers", poses_a_shard=8, workers=Workers(2),
        watch=made.append, **options,
    )  # fmt: skip
    assert files(tmp_path / "plain") == files(tmp_path / "workers")
    np.testing.assert_array_equal(plain.face, by_workers.face)
    assert sum(each.n_poses for each in made) == len(poses)
    return plain


@pytest.mark.parametrize("engine", ["certified", "sampled:cpu@2"])
def test_shards_of_workers_have_the_same_bytes(tmp_path, engine):
    with rc.open_observer(MESH, CAMERA, engine) as observer:
        assert len(both(tmp_path, view=observer).face) > 1000


def test_shards_of_cells_have_the_same_bytes(tmp_path):
    small = cells(MESH, 0.2 * float(np.ptp(MESH.bounds)))
    assert both(tmp_path, cells=small).is_of_cells


def test_shards_through_a_lens_have_the_same_bytes(tmp_path):
    lens = rc.Camera(
        width=320, height=240, fx=300, fy=300, model="opencv", distortion=(-0.2, 0.05, 0.001, 0.0)
    )
    both(tmp_path, view=(MESH, lens))


def test_shards_of_rigs_have_the_same_bytes(tmp_path):
    aside = np.eye(4)
    aside[0, 3] = 0.3
    wide = rc.Camera(width=200, height=200, fx=150, fy=150)
    pair = rc.Rig([CAMERA, wide], ["tele", "wide"], [np.eye(4), aside])
    mounts = Mounts.of({"alone": CAMERA, "pair": pair})
    placed = rc.Poses.of(POSES, camera=np.arange(42) % 2)
    both(tmp_path, placed, (MESH, mounts.rig), mounts=mounts)


def test_bounds_of_workers_are_those_of_one_process(tmp_path):
    one, many = (CandidateBounds(MESH.n_faces, MESH.task_mask) for _ in range(2))
    build_matrix((MESH, CAMERA), POSES, bounds=one)
    build_matrix((MESH, CAMERA), POSES, None, tmp_path / "m", poses_a_shard=8, bounds=many,
                 workers=Workers(2))  # fmt: skip
    assert one.n_poses == many.n_poses == len(POSES)
    for name in ("low", "high", "covering"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


POISONED = 3
FEW, SMALL = POSES[:6], 2
"""Poses, and those of each shard, where processes die: each suspect is tried in a process."""


def poisoned(folder, number, *, leave_out=(), only=None):
    """`shard_work.make`, which one pose kills."""
    rows = list(matrix_module.shards_of(len(FEW), SMALL))[number][1]
    chosen = np.delete(np.arange(rows.start, rows.stop), list(leave_out))
    if POISONED in (chosen if only is None else rows.start + np.array(only)):
        os.kill(os.getpid(), signal.SIGKILL)
    return shard_work.make(folder, number, leave_out=leave_out, only=only)


def test_a_pose_that_kills_its_worker_has_no_pairs(tmp_path, monkeypatch):
    monkeypatch.setattr(matrix_module, "SHARD_FUNCTION", "test_matrix_workers:poisoned")
    monkeypatch.syspath_prepend(Path(__file__).parent)
    plain = build_matrix((MESH, CAMERA), FEW)
    left = build_matrix((MESH, CAMERA), FEW, None, tmp_path / "m", poses_a_shard=SMALL,
                        workers=Workers(2))  # fmt: skip
    assert left.quarantined == {POISONED: "was killed by SIGKILL"}
    for pose in range(len(FEW)):
        rows = slice(plain.indptr[pose], plain.indptr[pose + 1])
        kept = slice(left.indptr[pose], left.indptr[pose + 1])
        expected = plain.face[rows] if pose != POISONED else []
        np.testing.assert_array_equal(left.face[kept], expected)
    again = VisibilityMatrix.load(tmp_path / "m")
    assert again.quarantined == left.quarantined
    # A shard that is made again by this process has all its poses, and the note goes.
    (tmp_path / "m" / "pairs" / "pairs-00001.parquet").unlink()
    whole = build_matrix((MESH, CAMERA), FEW, None, tmp_path / "m", poses_a_shard=SMALL)
    assert not whole.quarantined
    np.testing.assert_array_equal(whole.face, plain.face)


def test_workers_need_a_folder():
    with pytest.raises(ConfigError, match="workers make shards in a folder"):
        build_matrix((MESH, CAMERA), POSES, workers=Workers(1))
