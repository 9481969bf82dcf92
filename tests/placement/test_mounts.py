"""Rigs as candidates: one choice, with the pairs of each of its cameras."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.mesh import shapes
from rastercov.placement import (
    BestCoverage,
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
from rastercov.placement.mounts import Mounts
from rastercov.tolerances.installation import InstallationError

MESH = shapes.torus(16, 8)
WIDE = rc.Camera(width=160, height=120, fx=90, fy=90)
LONG = rc.Camera(width=120, height=120, fx=200, fy=200)
TASK = rc.Task(min_pixels=4)
POSES = rc.sphere_of_poses((0, 0, 0), 4.0, 8)


@pytest.fixture(autouse=True, scope="module")
def small_batches():
    """Batches that end within a rig."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rastercov.core.coverage.coverage.POSES_A_BATCH", 2)
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


def by_camera(matrix, n_faces, first=None):
    """(K, F) coverage by each row of the matrix, or by each camera of mounts that begin at some."""
    row = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    n = matrix.n_poses
    if first is not None:
        row, n = first[row] + matrix.on_rig, first[-1]
    result = np.zeros((n, n_faces), np.float32)
    np.maximum.at(result, (row, matrix.face), matrix.coverage)
    return result


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["faces", "cells"])
@examples(4, at_night=12)
@given(seed=st.integers(0, 1000), index=st.lists(st.integers(0, 2), min_size=8, max_size=8))
def test_a_rig_covers_what_any_of_its_cameras_covers(kind, seed, index):
    mounts, placed = mounts_of(seed), rc.Poses.of(POSES, camera=index)
    cells = rc.cells(MESH, 0.4) if kind == "cells" else None
    task = rc.Task() if kind == "cells" else TASK
    cameras, owner = mounts.cameras(placed)
    first = np.searchsorted(owner, np.arange(9))
    assert np.diff(first).tolist() == np.array([1, 2, 3])[index].tolist()
    n = MESH.n_faces if cells is None else len(cells)
    with rc.open_observer(MESH, mounts.rig) as observer:
        matrix = build_matrix(observer, placed, task, cells=cells, mounts=mounts)
        alone = by_camera(build_matrix(observer, cameras, task, cells=cells), n)
        if cells is None:
            objective = Objective.of(observer, task, mounts=mounts)
        else:
            finder = RegionPass(MESH, mounts.rig, task)
            objective = CellObjective.of_cells(observer, finder, cells, mounts=mounts)
        covers = objective.covers(placed)
    wanted = np.maximum.reduceat(alone, first[:-1])
    np.testing.assert_array_equal(by_camera(matrix, n), wanted)
    np.testing.assert_array_equal(by_camera(matrix, n, first), alone)
    np.testing.assert_array_equal(by_camera(matrix.united(), n), wanted)
    assert matrix.united().n_pairs == np.count_nonzero(wanted)
    mean = wanted.sum(axis=1, dtype=np.float64) / matrix.n_task_faces
    np.testing.assert_allclose(matrix.mean_coverage, mean, rtol=1e-6)
    is_covered = wanted >= np.float32(task.min_coverage)
    np.testing.assert_array_equal(covers & (wanted > 0), is_covered)


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
    with pytest.raises(rc.PoseError, match="camera indices below 3, got 3"):
        mounts.cameras(rc.Poses.of(POSES, camera=3))


def test_a_rig_of_one_camera_is_that_camera():
    alone = Mounts.of({"eye": WIDE})
    rig = Mounts.of({"eye": rc.Rig([WIDE], ["a"])})
    assert not rig.has_rigs
    assert not Mounts.of_cameras(rc.Rig([WIDE, LONG], None, [place_of(0), place_of(1)])).has_rigs
    with rc.open_observer(MESH, WIDE) as observer:
        plain = build_matrix(observer, POSES, TASK)
        for mounts in (alone, rig):
            matrix = build_matrix(observer, POSES, TASK, mounts=mounts)
            assert matrix.header == plain.header
            np.testing.assert_array_equal(matrix.coverage, plain.coverage)
        # One camera away from the origin of its rig is that camera at its place.
        turned = Mounts.of({"eye": rc.Rig([WIDE], ["a"], [place_of(5)])})
        moved = build_matrix(observer, POSES, TASK, mounts=turned)
        wanted = build_matrix(observer, POSES @ place_of(5), TASK)
    assert turned.has_rigs
    for name in ("indptr", "face", "coverage"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(wanted, name))


@pytest.fixture
def of_rigs(tmp_path):
    """Mounts, poses of each, and how their matrix is made in the folder of the test."""
    mounts = mounts_of(1)
    placed = rc.Poses.of(POSES, camera=[0, 1, 2, 2, 1, 0, 1, 2])

    def build(poses=placed, folder=tmp_path, mounts=mounts):
        with rc.open_observer(MESH, mounts.rig) as observer:
            return build_matrix(observer, poses, TASK, folder, mounts=mounts, poses_a_shard=3)

    return mounts, placed, build


def test_shards_of_rigs_resume_and_are_told_from_others(tmp_path, of_rigs):
    _, placed, build = of_rigs
    whole = build(folder=None)
    build()
    (tmp_path / "pairs" / "pairs-00001.npz").unlink()
    for again in (build(), VisibilityMatrix.load(tmp_path)):
        for name in ("indptr", "face", "coverage", "on_rig"):
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
        assert again.camera.tolist() == placed.camera.tolist()
    with pytest.raises(rc.ConfigError, match="for other rigs"):
        build(mounts=mounts_of(2))
    with pytest.raises(rc.ConfigError, match="for other cameras of them"):
        build(rc.Poses.of(placed, camera=0))


def test_bits_of_rigs_are_those_of_the_united_matrix(tmp_path, of_rigs):
    mounts, placed, build = of_rigs
    lists = build()
    bits, united, goal = VisibilityMatrix.load(tmp_path), lists.united(), BestCoverage(2)
    for row in range(len(placed)):
        pairs = slice(united.indptr[row], united.indptr[row + 1])
        wanted = united.face[pairs][united.covered[pairs]]
        np.testing.assert_array_equal(bits.bits().faces_of(row), wanted)
    np.testing.assert_allclose(bits.mean_coverage, lists.mean_coverage, rtol=1e-12)
    one, other = (select_greedy(problem_of(each, MESH, goal)) for each in (lists, bits))
    assert one.share == pytest.approx(other.share)
    with pytest.raises(rc.ConfigError, match="expected the mounts of the rigs"):
        problem_of(lists, MESH, goal, views=2)
    assert problem_of(lists, MESH, goal, views=2, mounts=mounts).has_rigs
    assert not problem_of(lists, MESH, goal).has_rigs


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
@examples(2, at_night=12)
@given(seed=st.integers(0, 1000), index=st.lists(st.integers(0, 2), min_size=2, max_size=5))
def test_cameras_of_rigs_are_views_of_an_objective(need, least, seed, index):
    mounts = mounts_of(seed)
    task = rc.Task(min_pixels=2, views=need, min_angle_deg=least)
    placed = rc.Poses.of(POSES[: len(index)], camera=index)
    trials = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 3.5, 4), camera=index[0])
    with rc.open_observer(MESH, mounts.rig) as observer:
        objective = Objective.of(observer, task, mounts=mounts)
        weights = objective.integer_weights

        def definition(*parts):
            poses = rc.Poses.of(
                np.concatenate([part.world_from_camera for part in parts]),
                camera=np.concatenate([part.camera for part in parts]),
            )
            cameras = mounts.cameras(poses)[0]
            result = rc.evaluate(MESH, mounts.rig, cameras, task, by="face")
            return seen_by(MESH, result, cameras, need, least)

        covers, eyes, width = objective.covers(placed), objective.eyes(placed), objective.width
        covered, others = definition(placed), placed[1:]
        np.testing.assert_array_equal(objective.covered(covers, eyes) & MESH.task_mask, covered)
        assert objective.share_of(placed) == weights[covered].sum() / weights.sum()
        added = objective.worth_added(
            covers[width:], eyes[width:], objective.listed(trials), objective.eyes(trials)
        )
        before = weights[definition(others)].sum() if len(others) else 0
        for row in range(len(trials)):
            after = weights[definition(others, trials[row : row + 1])].sum()
            assert added[row] == after - before


@pytest.mark.slow
@pytest.mark.parametrize(("need", "least"), [(1, 0), (2, 0), (1, 15)])
def test_a_rig_is_moved_for_its_cameras_as_views(need, least):
    mounts = mounts_of(2)
    task = rc.Task(min_pixels=2, views=need, min_angle_deg=least)
    placed = rc.Poses.of(POSES[:3], camera=[1, 0, 2])
    with rc.open_observer(MESH, mounts.rig) as observer:
        objective = Objective.of(observer, task, mounts=mounts)
        space = PoseSpace(mesh=MESH, boxes=MESH.bounds + np.array([[-4.0], [4.0]]))
        refinement = refine(objective, space, placed, budget=150)
        cameras, _ = mounts.cameras(rc.Poses.of(refinement.poses, camera=placed.camera))
        coverage = rc.evaluate(MESH, mounts.rig, cameras, task, by="face")
        spread = tolerance(objective, placed, InstallationError(position_mm=0.0), draws=2)
    covered = seen_by(MESH, coverage, cameras, need, least)
    assert refinement.share > refinement.start_share
    share = MESH.areas[covered].sum() / MESH.areas[MESH.task_mask].sum()
    assert refinement.share == pytest.approx(share, abs=1e-9)
    assert spread.nominal == pytest.approx(refinement.start_share, abs=1e-12)
    assert spread.together.worst == pytest.approx(refinement.start_share, abs=1e-12)
    assert [each.alone.mean for each in spread.cameras] == pytest.approx([spread.nominal] * 3)


@given(seed=st.integers(0, 1000), index=st.lists(st.integers(0, 2), min_size=8, max_size=8))
def test_placed_cameras_have_the_mounts_that_they_were_placed_by(seed, index):
    mounts, placed = mounts_of(seed), rc.Poses.of(POSES, camera=index)
    cameras, owner = mounts.cameras(placed)
    found, rows = mounts.mounted(cameras)
    assert found.camera.tolist() == index
    assert rows.tolist() == owner.tolist()
    assert found.ids.tolist() == np.searchsorted(owner, np.arange(8)).tolist()
    np.testing.assert_allclose(found.world_from_camera, POSES, atol=1e-9)
    row = int(np.argmax(cameras.camera > 0))
    moved = cameras.world_from_camera.copy()
    moved[row, 0, 3] += 1e-3
    rig_lacks = np.arange(len(cameras)) != row
    for wrong in (replace(cameras, world_from_camera=moved), cameras[rig_lacks]):
        if any(index):
            with pytest.raises(rc.PoseError, match="expected all cameras of a rig in its order"):
                mounts.mounted(wrong)


def test_mounts_are_found_by_the_camera_that_moves():
    own = {"fixed": ["a"], "rule": rc.All()}
    rig = rc.Rig([WIDE, LONG, WIDE], ["a", "b", "c"], [place_of(k) for k in range(3)], **own)
    mounts = Mounts.of({"eye": WIDE, "three": rig})
    placed = rc.Poses.of(POSES, camera=[0, 1] * 4)
    cameras, owner = mounts.cameras(placed)
    found, rows = mounts.mounted(cameras)
    assert (found.camera.tolist(), rows.tolist()) == ([0, 1] * 4, owner.tolist())
    np.testing.assert_allclose(found.world_from_camera, POSES, atol=1e-9)
