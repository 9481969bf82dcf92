"""Visibility matrices as lists and as bits: their pairs, and the folders that keep them."""

import errno
import hashlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matrix_damage import ARRAYS, contents_of, files_of, flip
from nightly import IS_NIGHTLY

import rastercov as rc
from rastercov.base.errors import ConfigError, PoseError, ResourceError
from rastercov.base.locks import lock
from rastercov.core.mesh import shapes
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.matrix_folder import MatrixFolder, shorten_coverage
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of
from rastercov.shards.store import store

CAMERA = rc.Camera(width=64, height=64, fx=70, fy=70)
TASK = rc.Task(min_coverage=0.3, max_incidence_deg=80)
N_POSES = 11
MESH = shapes.torus(12, 8)
POSES = rc.sphere_of_poses((0, 0, 0), 4.2, N_POSES)
AWAY = rc.look_at([[0, 0, 5.0]], [[0, 0, 9.0]])
SHARD = Path("pairs") / "pairs-00001.npz"


def build(folder=None, poses=POSES, **options):
    return build_matrix((MESH, CAMERA), poses, TASK, folder, **options)


def bits_of(folder, poses=POSES):
    return build_matrix((MESH, CAMERA), poses, TASK, folder, poses_a_shard=4)


def dense(matrix):
    values = np.zeros((matrix.n_poses, matrix.n_faces), np.float32)
    pose = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    values[pose, matrix.face] = matrix.coverage
    return values


def covered(bits):
    is_covered = np.zeros((bits.n_rows, bits.n_faces), bool)
    for row in range(bits.n_rows):
        is_covered[row, bits.faces_of(row)] = True
    return is_covered


def same(one, other):
    for name in ARRAYS:
        first, second = getattr(one, name), getattr(other, name)
        np.testing.assert_array_equal(first, second, err_msg=name)
        assert first.dtype == second.dtype
    assert (one.task, one.header, one.n_task_faces) == (other.task, other.header, one.n_task_faces)


def watched(folder, **options):
    """A matrix, the poses that were done whenever some were, and what was noted."""
    seen, notes = [], []
    options |= {"progress": lambda done, total: seen.append(done), "note": notes.append}
    return build(folder, **options), seen, notes


@pytest.fixture(scope="module")
def lists():
    return build()


# --- pairs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [1, 2])
def test_the_matrix_is_the_coverage_of_every_pair_without_occluders(step):
    labels = np.arange(MESH.n_faces) % step
    groups = (rc.Group("part"), rc.Group("fixture", is_occluder=True))[:step]
    scene = rc.Mesh(MESH.vertices, MESH.faces, groups, labels)
    matrix = build_matrix((scene, CAMERA), POSES, TASK)
    coverage = rc.evaluate(scene, CAMERA, POSES, TASK, by="face")
    wanted = np.where(labels == 0, coverage.coverage, 0)
    np.testing.assert_allclose(dense(matrix), wanted, rtol=1e-6)
    assert (dense(matrix) > 0).tolist() == (wanted > 0).tolist()
    is_covered = coverage.reason[:, labels == 0] == rc.Reason.COVERED
    assert is_covered.sum() == matrix.covered.sum()
    assert (dense(matrix)[:, labels == 0][is_covered] >= 0.3).all()
    assert matrix.n_task_faces == (labels == 0).sum()
    assert matrix.mean_coverage == pytest.approx(wanted[:, labels == 0].mean(axis=1))


def test_bits_are_the_covered_pairs_of_the_matrix_and_its_shards_those_of_a_plain_run(
    tmp_path, lists
):
    matrix = bits_of(tmp_path / "bits")
    np.testing.assert_array_equal(matrix.poses, lists.poses)
    np.testing.assert_array_equal(matrix.mean_coverage, lists.mean_coverage)
    assert (matrix.n_pairs, matrix.n_faces, matrix.task) == (len(lists.face), MESH.n_faces, TASK)
    again = VisibilityMatrix.load(tmp_path / "bits")
    np.testing.assert_array_equal(covered(again.bits()), covered(matrix.bits()))
    same(build(tmp_path / "plain", poses_a_shard=4), VisibilityMatrix.load(tmp_path / "bits"))
    assert contents_of(tmp_path / "bits") == contents_of(tmp_path / "plain")
    for least in (0.0, 0.3, 0.9):
        wanted = (dense(lists) >= np.float64(least)) & (dense(lists) > 0)
        np.testing.assert_array_equal(covered(matrix.bits(least)), wanted)


def test_matrices_that_are_joined_are_that_of_all_poses(tmp_path, lists):
    halves = (POSES[:6], POSES[6:])
    one, two = (build(poses=some) for some in halves)
    np.testing.assert_array_equal(dense(one.joined(two)), dense(lists))
    np.testing.assert_array_equal(one.joined(two).poses, POSES)
    one, two = (bits_of(tmp_path / str(len(some)), some) for some in halves)
    matrix = one.joined(two)
    np.testing.assert_array_equal(covered(matrix.bits(0.9)), dense(lists) >= 0.9)
    np.testing.assert_array_equal(covered(matrix.bits()), dense(lists) >= 0.3)
    np.testing.assert_array_equal(matrix.mean_coverage, lists.mean_coverage)
    assert matrix.n_pairs == len(lists.face)
    other = build_matrix((MESH, CAMERA), POSES, rc.Task(), tmp_path / "other")
    with pytest.raises(ConfigError, match="one mesh and task"):
        matrix.joined(other)


@pytest.mark.parametrize("poses", [POSES[:0], AWAY], ids=["none", "away"])
def test_no_pose_and_nothing_in_view_give_an_empty_matrix(tmp_path, poses):
    for matrix in (build(poses=poses), build(tmp_path / "lists", poses)):
        assert matrix.indptr.tolist() == [0] * (len(poses) + 1)
        assert matrix.mean_coverage.tolist() == [0.0] * len(poses)
    matrix = bits_of(tmp_path / "bits", poses)
    assert covered(matrix.bits()).shape == (len(poses), MESH.n_faces)
    assert not covered(matrix.bits()).any()
    assert matrix.mean_coverage.tolist() == [0.0] * len(poses)


@pytest.mark.slow
@given(
    st.just(0.0) | st.floats(1e-30, 1),
    st.lists(st.floats(0, 1), min_size=1, max_size=20),
    st.integers(-3, 3),
)
def test_rounding_carries_no_pair_across_the_threshold(least, values, ulps):
    near = least * (1 + ulps * 2.0**-52)
    exact = np.array([*values, near, least, 5e-324, 1e-46, 1.0])
    wanted = exact[exact > 0]
    short, is_covered = shorten_coverage(wanted, least)
    np.testing.assert_array_equal(short >= np.float64(least), wanted >= least)
    np.testing.assert_array_equal(is_covered, wanted >= least)
    assert (short > 0).all()
    np.testing.assert_allclose(short, wanted, rtol=2.4e-7, atol=3e-45)


def test_a_problem_has_the_pairs_views_and_weights_that_count(lists):
    coverage = rc.evaluate(MESH, CAMERA, POSES, TASK, by="face")
    goal = BestCoverage(3)
    for least, wanted in (
        (None, coverage.reason == rc.Reason.COVERED),
        (0.0, coverage.coverage > 0),
        (0.9, coverage.coverage >= 0.9),
    ):
        problem = problem_of(lists, MESH, goal, min_coverage=least, weight_by="count")
        np.testing.assert_array_equal(covered(problem.bits), wanted)
    area = problem_of(lists, MESH, goal)
    some = np.arange(MESH.n_faces) < 5
    assert area.share(some) == pytest.approx(MESH.areas[some].sum() / MESH.areas.sum())
    np.testing.assert_array_equal(area.eyes, POSES[:, :3, 3])
    labels = np.arange(MESH.n_faces) % 3
    groups = (rc.Group("a"), rc.Group("b"), rc.Group("jig", is_occluder=True))
    scene = rc.Mesh(MESH.vertices, MESH.faces, groups, labels)
    matrix = build_matrix((scene, CAMERA), POSES, replace(TASK, views=2))
    of = partial(problem_of, matrix, scene, FewestCameras(0.0, {"b": 0.5}, of_reachable=True))
    problem = of(views={"b": 3}, weight_by="count")
    assert problem.weights.tolist() == [float(label != 2) for label in labels]
    assert problem.views.tolist() == [3 if label == 1 else 1 for label in labels]
    assert of().views.tolist() == [2] * scene.n_faces
    for options, words in (
        ({"views": {"c": 2}}, "expected a group, got 'c'"),
        ({"weight_by": "m"}, "area, see"),
    ):
        with pytest.raises(ConfigError, match=words):
            of(**options)


# --- folders --------------------------------------------------------------------------------------


@pytest.mark.parametrize("poses_a_shard", [1, 4, 100])
def test_on_disk_and_in_memory_are_the_same_and_the_shards_plain_arrays(
    tmp_path, poses_a_shard, monkeypatch
):
    monkeypatch.setattr("rastercov.core.coverage.coverage.POSES_A_BATCH", 3)
    with rc.open_observer(MESH, CAMERA) as observer:
        seen = []
        matrix = build_matrix(
            observer, POSES, TASK, tmp_path, poses_a_shard=poses_a_shard,
            progress=lambda done, total: seen.append((done, total)),
        )  # fmt: skip
    same(matrix, build(poses_a_shard=poses_a_shard))
    same(matrix, VisibilityMatrix.load(tmp_path))
    assert (seen[0], seen[-1]) == ((0, N_POSES), (N_POSES, N_POSES))
    assert len(list((tmp_path / "pairs").iterdir())) == -(-N_POSES // poses_a_shard)
    shards = [np.load(path) for path in sorted((tmp_path / "pairs").glob("*.npz"))]
    for name, values in (("counts", np.diff(matrix.indptr)), ("coverage", matrix.coverage)):
        np.testing.assert_array_equal(np.concatenate([shard[name] for shard in shards]), values)
    faces = [np.cumsum(shard["face_step"]) for shard in shards]
    np.testing.assert_array_equal(np.concatenate(faces), matrix.face)


def moved(mesh):
    return rc.Mesh(mesh.vertices + np.array([1e-9, 0, 0]), mesh.faces)


SAMPLED = rc.Engine("sampled", "cpu", 1)
INPUTS = {"mesh": MESH, "camera": CAMERA, "method": "certified"}
INPUTS |= {"poses": POSES, "task": TASK, "poses_a_shard": 4}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mesh": moved(MESH)}, "from another mesh"),
        ({"mesh": MESH.with_groups(two_sided="all")}, "mesh"),
        ({"camera": replace(CAMERA, fx=71.0)}, "for another camera"),
        ({"poses": POSES[:-1]}, "from other poses"),
        ({"task": replace(TASK, min_coverage=0.31)}, "for another task"),
        ({"poses_a_shard": 5}, "with another poses_a_shard"),
        ({"method": "exact"}, "by another method"),
        ({"method": replace(SAMPLED, supersample=2)}, "another supersample"),
        ({}, "another version"),
    ],
)
def test_a_folder_of_other_inputs_is_refused(tmp_path, monkeypatch, change, words):
    def made(mesh, camera, method, **inputs):
        with rc.open_observer(mesh, camera, method) as observer:
            return build_matrix(observer, folder=tmp_path, **inputs)

    made(**INPUTS | {"method": SAMPLED if "supersample" in words else "certified"})
    if not change:
        monkeypatch.setattr(rc, "__version__", "0.0.0")
    with pytest.raises(ConfigError, match=words) as error:
        made(**INPUTS | change)
    assert "\n" not in str(error.value)


def test_a_matrix_of_an_earlier_format_and_a_strange_header_are_refused(tmp_path):
    build(tmp_path)
    path = tmp_path / "header.json"
    whole = path.read_bytes()

    def assert_refused(words):
        before = contents_of(tmp_path)
        for read in (build, VisibilityMatrix.load):
            with pytest.raises(ConfigError, match=words) as error:
                read(tmp_path)
            assert "\n" not in str(error.value)
        assert contents_of(tmp_path) == before

    store(tmp_path, path.name, json.dumps(json.loads(whole) | {"format": 1}).encode())
    assert_refused("in another file format; name another folder")
    shutil.rmtree(tmp_path / "sha256")  # the first format had no checksums
    for text in ("{", "[]", "{}", '{"format": 1}', "[" * 100_000, '"of something else"'):
        path.write_text(text)
        assert_refused("expected a matrix")


@pytest.mark.parametrize("name", ["header.json", "poses.npz", "scene.npz"])
def test_a_damaged_header_or_pose_loses_no_shard(tmp_path, lists, name):
    build(tmp_path, poses_a_shard=4)
    whole = contents_of(tmp_path)
    for harm in (lambda path: flip(path, [1000]), Path.unlink):
        harm(tmp_path / name)
        if name != "scene.npz":  # which readers do without
            with pytest.raises(ConfigError, match=rf"{name}|matrix, got none"):
                VisibilityMatrix.load(tmp_path)
        if name != "header.json":
            with pytest.raises(ConfigError, match="from other poses"):
                build(tmp_path, POSES[::-1])
        again, seen, notes = watched(tmp_path, poses_a_shard=4)
        np.testing.assert_array_equal(dense(again), dense(lists))
        assert seen == [N_POSES]
        assert contents_of(tmp_path) == whole
        assert all(name in line for line in notes)


def test_a_folder_without_its_header_is_that_of_the_next_inputs(tmp_path):
    build(tmp_path / "m", poses_a_shard=1)
    (tmp_path / "m" / "header.json").unlink()
    _, seen, notes = watched(tmp_path / "m", poses=POSES[::-1], poses_a_shard=4)
    assert (seen[0], len(notes)) == (0, N_POSES)  # shards that are no longer any, and of others
    build(tmp_path / "other", POSES[::-1], poses_a_shard=4)
    assert contents_of(tmp_path / "m") == contents_of(tmp_path / "other")


def test_only_the_damaged_shard_is_measured_again_and_somebody_is_told(tmp_path, caplog):
    build(tmp_path, poses_a_shard=4)
    whole = contents_of(tmp_path)
    flip(tmp_path / SHARD, [8 * 200])
    with pytest.raises(ConfigError, match=r"pairs-00001\.npz: expected .*call build_matrix"):
        VisibilityMatrix.load(tmp_path)
    seen = []
    build(tmp_path, progress=lambda done, total: seen.append(done))
    assert seen[0] == N_POSES - 4
    assert contents_of(tmp_path) == whole
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path / SHARD}: expected the file as it was written, got another checksum; "
        "evaluated its poses again"
    ]
    assert watched(tmp_path)[1:] == ([N_POSES], [])


def test_bits_are_derived_once_a_threshold(tmp_path, monkeypatch):
    names, pairs_of = [], MatrixFolder.pairs_of

    def watched_pairs(folder, number):
        names.append(number)
        return pairs_of(folder, number)

    monkeypatch.setattr(MatrixFolder, "pairs_of", watched_pairs)
    matrix = bits_of(tmp_path)
    assert not names
    assert matrix.bits().parts[0].base is matrix.bits(0.3).parts[0].base
    assert len(matrix.mean_coverage) == N_POSES
    assert sorted(names) == [0, 1, 2]
    assert len(names) == 3
    matrix.bits(0.9)
    assert len(names) == 6


def test_every_file_has_the_checksum_that_sha256sum_can_check(tmp_path):
    bits_of(tmp_path)
    files = {path for path in files_of(tmp_path) if path.parent.name != "sha256"}
    assert len(files) == 6
    for line in (tmp_path / "sha256").glob("*.sha256"):
        digest, name = line.read_text().removesuffix("\n").split("  ")
        files.remove(tmp_path / name)
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    assert not files


@pytest.mark.slow
def test_a_run_that_ends_between_any_two_files_goes_on(tmp_path, monkeypatch):
    matrix = build(tmp_path / "quiet", poses_a_shard=4)
    replace_file, left = os.replace, 0

    def end(*names):
        nonlocal left
        left -= 1
        if left < 0:
            raise InterruptedError(errno.EINTR, "interrupted")
        replace_file(*names)

    monkeypatch.setattr(os, "replace", end)
    for steps in range(12):
        folder, left, notes = tmp_path / str(steps), steps, []
        with pytest.raises(InterruptedError):
            build(folder, poses_a_shard=4, note=notes.append)
        with pytest.raises(ConfigError, match=r"got none|shards, got"):
            VisibilityMatrix.load(folder)
        left = 100
        again, seen, further = watched(folder, poses_a_shard=4)
        same(again, matrix)
        assert seen[0] == 4 * max(0, (steps - 6) // 2)
        assert notes + further == []
        assert contents_of(folder) == contents_of(tmp_path / "quiet")


def test_what_is_no_folder_of_ours_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    (tmp_path / "mine" / "pairs").mkdir(parents=True)
    (tmp_path / "mine" / "pairs" / "pairs-00000.npz").write_bytes(b"")
    for call, words in (
        (lambda: build(tmp_path / "file"), "expected a folder, got a file"),
        (lambda: build(tmp_path / "mine"), "expected a matrix"),
        (lambda: VisibilityMatrix.load(tmp_path), "expected a visibility matrix, got none"),
        (
            lambda: VisibilityMatrix.load(tmp_path / "nowhere"),
            "expected a visibility matrix, got none",
        ),
    ):
        with pytest.raises(ConfigError, match=words):
            call()
    with pytest.raises(PoseError):
        build(poses=np.zeros((1, 4, 4)))
    matrix = build_matrix((MESH, CAMERA), POSES, TASK, tmp_path / "bits")
    with lock(tmp_path / "bits"), pytest.raises(ConfigError, match="another process is writing"):
        build(tmp_path / "bits")

    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(
        ResourceError, match=r"room for 264 bytes, got an error \(No space"
    ) as error:
        matrix.bits(0.3)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_kill_9_loses_nothing_but_the_shard_in_flight(tmp_path):
    script = Path(__file__).parents[1] / "support" / "kill_matrix.py"
    kills, n_poses = ("20", "160") if IS_NIGHTLY else ("6", "48")
    command = [sys.executable, str(script), kills, n_poses, str(tmp_path)]
    result = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert result["same"]
    assert (result["rewritten"], result["left"]) == (0, [])
    assert result["kills"] >= 2
