"""Visibility matrices made by workers: the same bytes as those of this process."""

import shutil
from dataclasses import replace

import killing_shards
import numpy as np
import pytest
from killing_shards import POISONED, SMALL

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.cells import cells
from rastercov.core.mesh import shapes
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.mounts import Mounts
from rastercov.placement.uncovered import CandidateBounds
from rastercov.shards import Workers

pytestmark = pytest.mark.slow
MESH = shapes.teapot(4)
CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
POSES = rc.sphere_of_poses(MESH.bounds.mean(axis=0), 5.0 * np.ptp(MESH.bounds), 42)


def files(folder):
    return {path.name: path.read_bytes() for path in sorted((folder / "pairs").iterdir())}


def both(tmp_path, poses, view, **options):
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


ASIDE = np.eye(4)
ASIDE[0, 3] = 0.3
WIDE = rc.Camera(width=200, height=200, fx=150, fy=150)
LENS = replace(CAMERA, model="opencv", distortion=(-0.2, 0.05, 0.001, 0.0))
MOUNTS = Mounts.of({"alone": CAMERA, "pair": rc.Rig([CAMERA, WIDE], None, [np.eye(4), ASIDE])})
CASES = {
    "certified": {},
    "sampled": {"engine": "sampled:cpu@2"},
    "cells": {"cells": cells(MESH, 0.2 * float(np.ptp(MESH.bounds)))},
    "lens": {"camera": LENS},
    "rigs": {
        "camera": MOUNTS.rig,
        "poses": rc.Poses.of(POSES, camera=np.arange(42) % 2),
        "mounts": MOUNTS,
    },
}


@pytest.mark.parametrize("case", CASES)
def test_shards_of_workers_have_the_same_bytes(tmp_path, case):
    options = {"camera": CAMERA, "engine": "certified", "poses": POSES} | CASES[case]
    with rc.open_observer(MESH, options.pop("camera"), options.pop("engine")) as observer:
        assert len(both(tmp_path, view=observer, **options).face) > 1000


def test_bounds_of_workers_are_those_of_one_process(tmp_path):
    one, many = (CandidateBounds(MESH.n_faces, MESH.task_mask) for _ in range(2))
    build_matrix((MESH, CAMERA), POSES, bounds=one)
    build_matrix((MESH, CAMERA), POSES, None, tmp_path / "m", poses_a_shard=8, bounds=many,
                 workers=Workers(2))  # fmt: skip
    assert one.n_poses == many.n_poses == len(POSES)
    for name in ("low", "high", "covering"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


FEW = POSES[:6]


def test_a_pose_that_kills_its_worker_has_no_pairs(tmp_path):
    plain = build_matrix((MESH, CAMERA), FEW)
    left = killing_shards.build((MESH, CAMERA), FEW, None, tmp_path / "m", workers=Workers(2))
    assert left.quarantined == {POISONED: "was killed by SIGKILL"}
    for pose in range(len(FEW)):
        rows = slice(plain.indptr[pose], plain.indptr[pose + 1])
        kept = slice(left.indptr[pose], left.indptr[pose + 1])
        expected = plain.face[rows] if pose != POISONED else []
        np.testing.assert_array_equal(left.face[kept], expected)
    again = VisibilityMatrix.load(tmp_path / "m")
    assert again.quarantined == left.quarantined
    # A shard that is made again by this process has all its poses, and the note goes.
    (tmp_path / "m" / "pairs" / "pairs-00001.npz").unlink()
    whole = build_matrix((MESH, CAMERA), FEW, None, tmp_path / "m", poses_a_shard=SMALL)
    assert not whole.quarantined
    np.testing.assert_array_equal(whole.face, plain.face)


@pytest.fixture(scope="module")
def with_note(tmp_path_factory):
    """A matrix with a pose left out."""
    folder = tmp_path_factory.mktemp("with_note") / "m"
    killing_shards.build((MESH, CAMERA), FEW, None, folder, workers=Workers(1))
    assert (folder / NOTE).exists()
    return folder


NOTE, ITS_SUM = "quarantine/shard-1.json", "sha256/shard-1.json.sha256"
DAMAGE = {
    "cut": lambda folder: (folder / NOTE).write_bytes((folder / NOTE).read_bytes()[:-9]),
    "another pose": lambda folder: (folder / NOTE).write_bytes(b'{"0": "was killed"}'),
    "missing": lambda folder: (folder / NOTE).unlink(),
    "without a sum": lambda folder: (folder / ITS_SUM).unlink(),
    "of another shard": lambda folder: (folder / NOTE).rename(folder / "quarantine/shard-0.json"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_note_on_poses_left_out_is_named_and_its_shard_made_again(
    tmp_path, with_note, kind
):
    folder, lines = tmp_path / "m", []
    shutil.copytree(with_note, folder)
    DAMAGE[kind](folder)
    with pytest.raises(
        ConfigError, match=r"quarantine/shard-\d\.json: expected .*, got .* build_matrix"
    ):
        VisibilityMatrix.load(folder).quarantined  # noqa: B018 - read at once, or when asked for
    whole = build_matrix((MESH, CAMERA), FEW, None, folder, poses_a_shard=SMALL, note=lines.append)
    assert all(
        "quarantine/shard-" in line and "evaluated its poses again" in line for line in lines
    )
    assert lines
    assert not whole.quarantined
    np.testing.assert_array_equal(whole.face, build_matrix((MESH, CAMERA), FEW).face)
    assert not list(folder.glob("quarantine/*"))


def test_workers_find_the_pose_again_whose_note_was_damaged(tmp_path, with_note):
    folder, lines = tmp_path / "m", []
    shutil.copytree(with_note, folder)
    (folder / NOTE).write_bytes(b"")
    inputs = (MESH, CAMERA), FEW, None, folder
    again = killing_shards.build(*inputs, workers=Workers(1), note=lines.append)
    assert again.quarantined == {POISONED: "was killed by SIGKILL"}
    assert NOTE in lines[0]
    assert (folder / NOTE).read_bytes() == (with_note / NOTE).read_bytes()


def test_workers_need_a_folder():
    with pytest.raises(ConfigError, match="expected a folder for workers"):
        build_matrix((MESH, CAMERA), POSES, workers=Workers(1))
