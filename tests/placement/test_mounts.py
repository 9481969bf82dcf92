"""Rigs as candidates: one choice, with the pairs of each of its cameras."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rastercov as rc
from rastercov.coverage.area.regions import RegionPass
from rastercov.mesh import shapes
from rastercov.placement import (
    BestCoverage,
    BitMatrix,
    CellObjective,
    Objective,
    PoseSpace,
    VisibilityMatrix,
    build_matrix,
    problem_of,
    refine,
    select_greedy,
    tolerance,
)
from rastercov.placement.improve.tolerance import InstallationError
from rastercov.placement.mounts import Mounts

MESH = shapes.torus(16, 8)
WIDE = rc.Camera(width=160, height=120, fx=90, fy=90)
LONG = rc.Camera(width=120, height=120, fx=200, fy=200)
TASK = rc.Task(min_pixels=4)
POSES = rc.sphere_of_poses((0, 0, 0), 4.0, 8)


@pytest.fixture(autouse=True, scope="module")
def small_batches():
    """Batches that end within a rig."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rastercov.coverage.coverage.POSES_A_BATCH", 2)
        yield


def place_of(seed):
    """A small motion."""
    rng = np.random.default_rng(seed)
    return rc.look_at(rng.normal(scale=0.3, size=3), (0, 0, 4 + rng.normal()), (0, -1, 0))[0]


def mounts_of(seed):
    """A lone camera, a rig of two and a rig of three."""
    rigs = [
        rc.Rig([WIDE, LONG, WIDE][:n], ["a", "b", "c"][:n], [place_of(seed + k) for k in range(n)])
        for n in (2, 3)
    ]
    return Mounts.of({"eye": WIDE, "pair": rigs[0], "three": rigs[1]})


def dense(matrix, n_faces):
    found = np.zeros((matrix.n_poses, n_faces), np.float32)
    row = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    np.maximum.at(found, (row, matrix.face), matrix.coverage)
    return found


def by_camera(matrix, owner, n_faces):
    """(K, F) coverage by each camera of the mounts."""
    row = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    first = np.searchsorted(owner, np.arange(matrix.n_poses))
    found = np.zeros((len(owner), n_faces), np.float32)
    found[first[row] + matrix.on_rig, matrix.face] = matrix.coverage
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["faces", "cells"])
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 1000), index=st.lists(st.integers(0, 2), min_size=8, max_size=8))
def test_a_rig_covers_what_any_of_its_cameras_covers(kind, seed, index):
    mounts = mounts_of(seed)
    cells = rc.cells(MESH, 0.4) if kind == "cells" else None
    task = rc.Task() if kind == "cells" else TASK
    placed = rc.Poses.of(POSES, camera=index)
    cameras, owner = mounts.cameras(placed)
    n = MESH.n_faces if cells is None else len(cells)
    with rc.open_observer(MESH, mounts.rig) as observer:
        own = {"cells": cells, "mounts": mounts}
        matrix = build_matrix(observer, placed, task, **own)
        found, united = dense(matrix, n), matrix.united()
        alone = dense(build_matrix(observer, cameras, task, cells=cells), n)
        if cells is None:
            objective = Objective.of(observer, task, mounts=mounts)
        else:
            finder = RegionPass(MESH, mounts.rig, task)
            objective = CellObjective.of_cells(observer, finder, cells, mounts=mounts)
        covers = objective.covers(placed)
    wanted = np.array([alone[owner == row].max(axis=0) for row in range(8)])
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(by_camera(matrix, owner, n), alone)
    np.testing.assert_array_equal(dense(united, n), wanted)
    assert united.n_pairs == np.count_nonzero(wanted)
    mean = wanted.sum(axis=1, dtype=np.float64) / matrix.n_task_faces
    np.testing.assert_allclose(matrix.mean_coverage, mean, rtol=1e-6)
    np.testing.assert_array_equal(covers & (found > 0), found >= np.float32(task.min_coverage))
    assert np.array_equal(np.bincount(owner), np.array([1, 2, 3])[index])


def test_cameras_of_a_rig_are_at_their_places():
    mounts = mounts_of(3)
    assert mounts.rig.names == ("eye", "pair/a", "pair/b", "three/a", "three/b", "three/c")
    placed = rc.Poses.of(POSES[:2], camera=[2, 0])
    cameras, owner = mounts.cameras(placed)
    assert cameras.camera.tolist() == [3, 4, 5, 0]
    assert owner.tolist() == [0, 0, 0, 1]
    np.testing.assert_allclose(
        cameras.world_from_camera[1], POSES[0] @ mounts.rig.rig_from_camera[4], atol=1e-12
    )
    np.testing.assert_array_equal(cameras.world_from_camera[3], POSES[1])
    assert mounts.first_camera(1) is WIDE
    with pytest.raises(rc.PoseError, match="has camera 3, but there are 3"):
        mounts.cameras(rc.Poses.of(POSES, camera=3))


def test_a_rig_of_one_camera_is_that_camera():
    alone = Mounts.of({"eye": WIDE})
    rig = Mounts.of({"eye": rc.Rig([WIDE], ["a"])})
    assert not rig.has_rigs
    assert not Mounts.of_cameras(rc.Rig([WIDE, LONG], None, [place_of(0), place_of(1)])).has_rigs
    with rc.open_observer(MESH, WIDE) as observer:
        plain = build_matrix(observer, POSES, TASK)
        for mounts in (alone, rig):
            found = build_matrix(observer, POSES, TASK, mounts=mounts)
            assert found.header == plain.header
            np.testing.assert_array_equal(found.coverage, plain.coverage)
        # One camera away from the origin of its rig is that camera at its place.
        turned = Mounts.of({"eye": rc.Rig([WIDE], ["a"], [place_of(5)])})
        moved = build_matrix(observer, POSES, TASK, mounts=turned)
        wanted = build_matrix(observer, POSES @ place_of(5), TASK)
    assert turned.has_rigs
    np.testing.assert_array_equal(dense(moved, MESH.n_faces), dense(wanted, MESH.n_faces))


def test_shards_of_rigs_resume_and_are_told_from_others(tmp_path):
    mounts = mounts_of(1)
    placed = rc.Poses.of(POSES, camera=[0, 1, 2, 2, 1, 0, 1, 2])
    with rc.open_observer(MESH, mounts.rig) as observer:
        whole = build_matrix(observer, placed, TASK, mounts=mounts)
        build_matrix(observer, placed, TASK, tmp_path, mounts=mounts, poses_a_shard=3)
        (tmp_path / "pairs" / "pairs-00001.parquet").unlink()
        again = build_matrix(observer, placed, TASK, tmp_path, mounts=mounts, poses_a_shard=3)
        for name in ("indptr", "face", "coverage", "on_rig"):
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
        assert again.camera.tolist() == placed.camera.tolist()
        with pytest.raises(rc.ConfigError, match="for other rigs"):
            build_matrix(observer, placed, TASK, tmp_path, mounts=mounts_of(2), poses_a_shard=3)
        other = rc.Poses.of(placed, camera=0)
        with pytest.raises(rc.ConfigError, match="for other cameras of the poses"):
            build_matrix(observer, other, TASK, tmp_path, mounts=mounts, poses_a_shard=3)


def test_bits_of_rigs_are_those_of_the_united_matrix(tmp_path):
    mounts = mounts_of(1)
    placed = rc.Poses.of(POSES, camera=[0, 1, 2, 2, 1, 0, 1, 2])
    with rc.open_observer(MESH, mounts.rig) as observer:
        lists = build_matrix(observer, placed, TASK, tmp_path, mounts=mounts, poses_a_shard=3)
    again = VisibilityMatrix.load(tmp_path)
    np.testing.assert_array_equal(again.on_rig, lists.on_rig)
    bits, united = BitMatrix.load(tmp_path), lists.united()
    for row in range(len(placed)):
        pairs = slice(united.indptr[row], united.indptr[row + 1])
        wanted = united.face[pairs][united.covered[pairs]]
        np.testing.assert_array_equal(bits.bits.faces_of(row), wanted)
    np.testing.assert_allclose(bits.mean_coverage, lists.mean_coverage, rtol=1e-12)
    one = problem_of(lists, MESH, BestCoverage(2))
    assert select_greedy(problem_of(bits, MESH, BestCoverage(2))).share == pytest.approx(
        select_greedy(one).share
    )
    with pytest.raises(rc.ConfigError, match="bits do not count the cameras of a rig, and views"):
        problem_of(bits, MESH, BestCoverage(2), views=2)
    with pytest.raises(rc.ConfigError, match="the matrix is of rigs; give their mounts"):
        problem_of(lists, MESH, BestCoverage(2), views=2)
    two = problem_of(lists, MESH, BestCoverage(2), views=2, mounts=mounts)
    assert two.has_rigs
    assert not one.has_rigs


def seen_by(mesh, coverage, cameras, need, least):
    """(F,) faces that enough cameras cover, with two rays that differ: the definition."""
    covers = coverage.reason == rc.Reason.COVERED
    eyes, out = cameras.world_from_camera[:, :3, 3], []
    for f in range(mesh.n_faces):
        rays = eyes[covers[:, f]] - mesh.centroids[f]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        widest = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1))).max(initial=0)
        out.append(len(rays) >= need and (least == 0 or widest >= least))
    return np.array(out) & mesh.task_mask


@pytest.mark.slow
@pytest.mark.parametrize(("need", "least"), [(1, 0), (2, 0), (3, 0), (1, 8), (2, 25)])
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 1000), index=st.lists(st.integers(0, 2), min_size=2, max_size=5))
def test_cameras_of_rigs_are_views_of_an_objective(need, least, seed, index):
    mounts, k = mounts_of(seed), len(index)
    task = rc.Task(min_pixels=2, views=need, min_angle_deg=least)
    placed = rc.Poses.of(POSES[:k], camera=index)
    trials = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 3.5, 4), camera=index[0])
    with rc.open_observer(MESH, mounts.rig) as observer:
        objective = Objective.of(observer, task, mounts=mounts)
        weights = objective.integer_weights

        def definition(poses):
            cameras = mounts.cameras(poses)[0]
            found = rc.evaluate(MESH, mounts.rig, cameras, task)
            return seen_by(MESH, found, cameras, need, least)

        covers, eyes, width = objective.covers(placed), objective.eyes(placed), objective.width
        covered = definition(placed)
        np.testing.assert_array_equal(objective.covered(covers, eyes) & MESH.task_mask, covered)
        assert objective.share_of(placed) == weights[covered].sum() / weights.sum()
        others = placed[1:]
        rest, rest_eyes = covers[width:], eyes[width:]
        added = objective.worth_added(
            rest, rest_eyes, objective.listed(trials), objective.eyes(trials)
        )
        before = definition(others) if k > 1 else np.zeros(MESH.n_faces, bool)
        for row in range(len(trials)):
            every = rc.Poses.of(
                np.concatenate([others.world_from_camera, trials.world_from_camera[row : row + 1]]),
                camera=[*others.camera, index[0]],
            )
            after = definition(every)
            assert added[row] == weights[after].sum() - weights[before].sum()


@pytest.mark.slow
@pytest.mark.parametrize(("need", "least"), [(1, 0), (2, 0), (1, 15)])
def test_a_rig_is_moved_for_its_cameras_as_views(need, least):
    mounts = mounts_of(2)
    task = rc.Task(min_pixels=2, views=need, min_angle_deg=least)
    placed = rc.Poses.of(POSES[:3], camera=[1, 0, 2])
    with rc.open_observer(MESH, mounts.rig) as observer:
        objective = Objective.of(observer, task, mounts=mounts)
        space = PoseSpace(mesh=MESH, boxes=MESH.bounds + np.array([[-4.0], [4.0]]))
        found = refine(objective, space, placed, budget=150)
        cameras, _ = mounts.cameras(rc.Poses.of(found.poses, camera=placed.camera))
        coverage = rc.evaluate(MESH, mounts.rig, cameras, task)
        spread = tolerance(objective, placed, InstallationError(position_mm=0.0), draws=2)
    covered = seen_by(MESH, coverage, cameras, need, least)
    assert found.share > found.start_share
    share = MESH.areas[covered].sum() / MESH.areas[MESH.task_mask].sum()
    assert found.share == pytest.approx(share, abs=1e-9)
    assert spread.nominal == pytest.approx(found.start_share, abs=1e-12)
    assert spread.together.worst == pytest.approx(found.start_share, abs=1e-12)
    assert [each.alone.mean for each in spread.cameras] == pytest.approx([spread.nominal] * 3)
