import errno
import hashlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matrix_damage import campaign, contents_of, files_of, flip
from nightly import IS_NIGHTLY

import rastercov as rc
from rastercov.base.errors import ConfigError, PoseError
from rastercov.cluster.store import store
from rastercov.coverage import shards as evaluation_shards
from rastercov.mesh import shapes
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.matrix_folder import shortened
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of

CAMERA = rc.Camera(width=64, height=64, fx=70, fy=70)
TASK = rc.Task(min_coverage=0.3, max_incidence_deg=80)
N_POSES = 11
MESH = shapes.torus(12, 8)
POSES = rc.sphere_of_poses((0, 0, 0), 4.2, N_POSES)


def build(folder=None, **options):
    return build_matrix((MESH, CAMERA), POSES, TASK, folder, **options)


def dense(matrix):
    values = np.zeros((matrix.n_poses, matrix.n_faces), np.float32)
    pose = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    values[pose, matrix.face] = matrix.coverage
    return values


def same(one, other):
    for name in ("poses", "indptr", "face", "coverage"):
        first, second = getattr(one, name), getattr(other, name)
        np.testing.assert_array_equal(first, second, err_msg=name)
        assert first.dtype == second.dtype
    assert (one.task, one.header, one.n_task_faces) == (other.task, other.header, one.n_task_faces)


def watched(folder, **options):
    """A matrix, the poses that were done whenever some were, and what was noted."""
    seen, notes = [], []
    options |= {"progress": lambda done, total: seen.append(done), "note": notes.append}
    return build(folder, **options), seen, notes


def test_the_matrix_is_the_coverage_of_every_pair():
    matrix = build()
    coverage = rc.evaluate(MESH, CAMERA, POSES, TASK)
    np.testing.assert_allclose(dense(matrix), coverage.coverage, rtol=1e-6)
    assert (dense(matrix) > 0).tolist() == (coverage.coverage > 0).tolist()
    covered = np.zeros(matrix.n_poses * matrix.n_faces, bool)
    pose = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    covered[(pose * matrix.n_faces + matrix.face)[matrix.covered]] = True
    np.testing.assert_array_equal(
        covered.reshape(coverage.reason.shape), coverage.reason == rc.Reason.COVERED
    )
    assert matrix.mean_coverage == pytest.approx(coverage.coverage.mean(axis=1))


def test_occluders_are_left_out():
    labels = np.arange(MESH.n_faces) % 2
    groups = (rc.Group("part"), rc.Group("fixture", is_occluder=True))
    scene = rc.Mesh(MESH.vertices, MESH.faces, groups, labels)
    matrix = build_matrix((scene, CAMERA), POSES, TASK)
    assert len(matrix.face)
    assert (labels[matrix.face] == 0).all()
    assert matrix.n_task_faces == (labels == 0).sum()


@pytest.mark.parametrize("poses_a_shard", [1, 4, 100])
def test_on_disk_and_in_memory_are_the_same(tmp_path, poses_a_shard, monkeypatch):
    monkeypatch.setattr("rastercov.coverage.coverage.POSES_A_BATCH", 3)
    with rc.open_observer(MESH, CAMERA) as observer:
        seen = []
        matrix = build_matrix(
            observer, POSES, TASK, tmp_path, poses_a_shard=poses_a_shard,
            progress=lambda done, total: seen.append((done, total)),
        )  # fmt: skip
    same(matrix, build(poses_a_shard=poses_a_shard))
    same(matrix, VisibilityMatrix.load(tmp_path))
    assert seen[0] == (0, N_POSES)
    assert seen[-1] == (N_POSES, N_POSES)
    assert len(list((tmp_path / "pairs").iterdir())) == -(-N_POSES // poses_a_shard)


def test_the_shards_are_a_plain_table(tmp_path):
    matrix = build(tmp_path, poses_a_shard=4)
    table = pq.read_table(tmp_path / "pairs")
    assert table.column_names == ["pose", "face", "coverage", "covered"]
    pose = np.repeat(np.arange(N_POSES), np.diff(matrix.indptr))
    np.testing.assert_array_equal(table["pose"].to_numpy(), pose)
    np.testing.assert_array_equal(table["face"].to_numpy(), matrix.face)
    np.testing.assert_array_equal(table["coverage"].to_numpy(), matrix.coverage)
    np.testing.assert_array_equal(table["covered"].to_numpy(), matrix.covered)


def test_no_pose_and_nothing_in_view_give_an_empty_matrix(tmp_path):
    away = rc.look_at([[0, 0, 5.0]], [[0, 0, 9.0]])
    for name, poses in (("none", np.empty((0, 4, 4))), ("away", away)):
        for matrix in (
            build_matrix((MESH, CAMERA), poses, TASK),
            build_matrix((MESH, CAMERA), poses, TASK, tmp_path / name),
        ):
            assert matrix.indptr.tolist() == [0] * (len(poses) + 1)
            assert matrix.mean_coverage.tolist() == [0.0] * len(poses)


def test_a_run_goes_on_where_it_was_stopped(tmp_path):
    def stop(done, total):
        if done >= 6:
            raise InterruptedError(errno.EINTR, "interrupted")

    with pytest.raises(InterruptedError):
        build(tmp_path, poses_a_shard=4, progress=stop)
    assert [path.name for path in (tmp_path / "pairs").iterdir()] == ["pairs-00000.parquet"]
    with pytest.raises(ConfigError, match="2 of 3 shards are missing"):
        VisibilityMatrix.load(tmp_path)
    matrix, seen, _ = watched(tmp_path)
    assert seen[0] == 4
    same(matrix, build(poses_a_shard=4))
    assert watched(tmp_path)[1] == [N_POSES]


def moved(mesh):
    return rc.Mesh(mesh.vertices + np.array([1e-9, 0, 0]), mesh.faces)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: a | {"view": (moved(a["view"][0]), CAMERA)}, "from another mesh"),
        (lambda a: a | {"view": (a["view"][0].with_groups(two_sided="all"), CAMERA)}, "mesh"),
        (lambda a: a | {"view": (a["view"][0], replace(CAMERA, fx=71.0))}, "for another camera"),
        (lambda a: a | {"poses": a["poses"][:-1]}, "from other poses"),
        (lambda a: a | {"task": replace(TASK, min_coverage=0.31)}, "for another task"),
        (lambda a: a | {"poses_a_shard": 5}, "with another poses_a_shard"),
    ],
)
def test_a_folder_of_other_inputs_is_refused(tmp_path, change, words):
    inputs = {"view": (MESH, CAMERA), "poses": POSES, "task": TASK, "folder": tmp_path}
    build_matrix(**inputs)
    with pytest.raises(ConfigError, match=words) as error:
        build_matrix(**change(inputs))
    assert "\n" not in str(error.value)


def test_another_method_and_another_version_are_refused(tmp_path, monkeypatch):
    build(tmp_path)
    with (
        rc.open_observer(MESH, CAMERA, method="exact") as observer,
        pytest.raises(ConfigError, match="by another method"),
    ):
        build_matrix(observer, POSES, TASK, tmp_path)
    for supersample in (1, 2):
        with rc.open_observer(
            MESH, CAMERA, method="sampled", backend="cpu", supersample=supersample
        ) as observer:
            if supersample == 1:
                build_matrix(observer, POSES, TASK, tmp_path / "sampled")
                continue
            with pytest.raises(ConfigError, match="another supersample"):
                build_matrix(observer, POSES, TASK, tmp_path / "sampled")
    monkeypatch.setattr(evaluation_shards, "version", lambda name: "0.0.0")
    with pytest.raises(ConfigError, match="another version"):
        build(tmp_path)


def test_a_matrix_of_an_earlier_format_and_a_strange_header_are_refused(tmp_path):
    build(tmp_path)
    path = tmp_path / "header.json"
    reads = (lambda: build(tmp_path), lambda: VisibilityMatrix.load(tmp_path))
    header = json.loads(path.read_text()) | {"format": 1}
    store(tmp_path, path.name, json.dumps(header).encode())
    before = contents_of(tmp_path)
    for read in reads:
        with pytest.raises(ConfigError, match="in another file format; name another folder"):
            read()
    assert contents_of(tmp_path) == before
    shutil.rmtree(tmp_path / "sha256")  # the first format had no checksums
    before = contents_of(tmp_path)
    for text in ("{", "[]", "{}", '{"format": 1}', "[" * 100_000, '"of something else"'):
        path.write_text(text)
        for read in reads:
            with pytest.raises(ConfigError, match="no header") as error:
                read()
            assert "\n" not in str(error.value)
    path.write_bytes(before["header.json"])
    assert contents_of(tmp_path) == before


@pytest.mark.slow
def test_no_damage_to_a_matrix_is_believed_and_all_of_it_is_mended(tmp_path):
    with rc.open_observer(MESH, CAMERA) as observer:
        inputs = {"view": observer, "poses": POSES, "task": TASK, "poses_a_shard": 4}
        assert campaign(tmp_path, inputs, POSES[::-1], 88 if IS_NIGHTLY else 22) == {}


@pytest.mark.parametrize("name", ["header.json", "poses.npy"])
def test_a_damaged_header_or_pose_loses_no_shard_and_opens_the_folder_to_no_other(tmp_path, name):
    matrix = build(tmp_path, poses_a_shard=4)
    whole = contents_of(tmp_path)
    for harm in (lambda path: flip(path, [1000]), lambda path: path.unlink()):
        harm(tmp_path / name)
        with pytest.raises(ConfigError, match=rf"{name}|no matrix in this folder"):
            VisibilityMatrix.load(tmp_path)
        with pytest.raises(ConfigError, match="from other poses"):
            build_matrix((MESH, CAMERA), POSES[::-1], TASK, tmp_path)
        again, seen, notes = watched(tmp_path)
        same(again, matrix)
        assert seen == [N_POSES]
        assert contents_of(tmp_path) == whole
        assert all(name in line for line in notes)


def test_only_the_damaged_shard_is_measured_again_and_somebody_is_told(tmp_path, caplog):
    matrix = build(tmp_path, poses_a_shard=4)
    whole = contents_of(tmp_path)
    shard = tmp_path / "pairs" / "pairs-00001.parquet"
    flip(shard, [8 * 200])
    with pytest.raises(ConfigError, match=r"pairs-00001\.parquet: damaged.*call build_matrix"):
        VisibilityMatrix.load(tmp_path)
    seen = []
    again = build(tmp_path, progress=lambda done, total: seen.append(done))
    assert seen[0] == N_POSES - 4
    same(again, matrix)
    assert contents_of(tmp_path) == whole
    assert [record.getMessage() for record in caplog.records] == [
        f"warning: {shard}: damaged, its checksum is not the one recorded; "
        "its poses are measured again"
    ]
    caplog.clear()
    build(tmp_path)
    assert not caplog.records
    flip(shard, [8 * 200])
    (tmp_path / "header.json").unlink()  # it is restored from another shard
    again, seen, notes = watched(tmp_path)
    assert (seen[0], len(notes)) == (N_POSES - 4, 2)
    assert contents_of(tmp_path) == whole


def test_every_file_has_the_checksum_that_sha256sum_gives(tmp_path):
    build(tmp_path, poses_a_shard=4)
    files = {path for path in files_of(tmp_path) if path.parent.name != "sha256"}
    assert len(files) == 5
    for line in (tmp_path / "sha256").glob("*.sha256"):
        digest, name = line.read_text().removesuffix("\n").split("  ")
        files.remove(tmp_path / name)
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    assert files == set()


def test_other_readers_can_check_the_pages_of_a_shard(tmp_path):
    build(tmp_path)
    shard = tmp_path / "pairs" / "pairs-00000.parquet"
    assert pq.read_table(shard, page_checksum_verification=True).num_rows
    column = pq.ParquetFile(shard).metadata.row_group(0).column(1)
    flip(shard, [8 * (column.data_page_offset + column.total_compressed_size // 2)])
    with pytest.raises(OSError, match="CRC"):
        pq.read_table(shard, page_checksum_verification=True)


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
    for steps in range(10):
        folder, left, notes = tmp_path / str(steps), steps, []
        with pytest.raises(InterruptedError):
            build(folder, poses_a_shard=4, note=notes.append)
        left = 100
        again, seen, further = watched(folder, poses_a_shard=4)
        same(again, matrix)
        assert seen[0] == 4 * max(0, (steps - 4) // 2)
        assert notes + further == []
        assert contents_of(folder) == contents_of(tmp_path / "quiet")


def test_what_is_no_folder_of_ours_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be made"):
        build(tmp_path / "file")
    with pytest.raises(ConfigError, match="there is no matrix"):
        VisibilityMatrix.load(tmp_path)
    (tmp_path / "pairs").mkdir()
    (tmp_path / "pairs" / "pairs-00000.parquet").write_bytes(b"")
    with pytest.raises(ConfigError, match="without a header"):
        build(tmp_path)
    with pytest.raises(PoseError):
        build_matrix((MESH, CAMERA), np.zeros((1, 4, 4)), TASK)


@pytest.mark.slow
@given(
    st.just(0.0) | st.floats(1e-30, 1),
    st.lists(st.floats(0, 1), min_size=1, max_size=20),
    st.integers(-3, 3),
)
def test_rounding_carries_no_pair_across_the_threshold(least, values, ulps):
    near = least * (1 + ulps * 2.0**-52)
    exact = np.array([*values, near, least, 5e-324, 1e-46, 1.0])
    short, covered = shortened(exact[exact > 0], least)
    wanted = exact[exact > 0]
    np.testing.assert_array_equal(short >= np.float64(least), wanted >= least)
    np.testing.assert_array_equal(covered, wanted >= least)
    assert (short > 0).all()
    np.testing.assert_allclose(short, wanted, rtol=2.4e-7, atol=3e-45)


def test_matrices_that_are_joined_are_that_of_all_poses():
    parts = [
        replace(build_matrix((MESH, CAMERA), some, TASK), quarantined={1: "was killed"})
        for some in (POSES[:6], POSES[6:])
    ]
    joined = parts[0].joined(parts[1])
    np.testing.assert_array_equal(dense(joined), dense(build()))
    np.testing.assert_array_equal(joined.poses, POSES)
    assert joined.quarantined.keys() == {1, 7}


def test_a_problem_has_the_pairs_that_count():
    matrix = build()
    coverage = rc.evaluate(MESH, CAMERA, POSES, TASK)
    goal = BestCoverage(3)
    for least, wanted in (
        (None, coverage.reason == rc.Reason.COVERED),
        (0.0, coverage.coverage > 0),
        (0.9, coverage.coverage >= 0.9),
    ):
        problem = problem_of(matrix, MESH, goal, min_coverage=least, weight_by="count")
        pairs = [problem.faces_of(c).tolist() for c in range(N_POSES)]
        assert pairs == [np.flatnonzero(row).tolist() for row in wanted]
    area = problem_of(matrix, MESH, goal)
    assert area.share(np.arange(MESH.n_faces) < 5) == pytest.approx(
        MESH.areas[:5].sum() / MESH.areas.sum()
    )
    np.testing.assert_array_equal(area.eyes, POSES[:, :3, 3])
    assert area.views.tolist() == [1] * MESH.n_faces


def test_views_and_weights_go_by_group():
    labels = np.arange(MESH.n_faces) % 3
    groups = (rc.Group("a"), rc.Group("b"), rc.Group("jig", is_occluder=True))
    scene = rc.Mesh(MESH.vertices, MESH.faces, groups, labels)
    matrix = build_matrix((scene, CAMERA), POSES, replace(TASK, views=2))
    goal = FewestCameras(0.0, {"b": 0.5}, of_reachable=True)
    problem = problem_of(matrix, scene, goal, views={"b": 3}, weight_by="count")
    assert problem.weights.tolist() == [float(label != 2) for label in labels]
    assert problem.views.tolist() == [3 if label == 1 else 1 for label in labels]
    assert problem_of(matrix, scene, goal).views.tolist() == [2] * scene.n_faces
    with pytest.raises(ConfigError, match="no group 'c'"):
        problem_of(matrix, scene, goal, views={"c": 2})
    with pytest.raises(ConfigError, match="area or count"):
        problem_of(matrix, scene, goal, weight_by="volume")


@pytest.mark.slow
def test_kill_9_loses_nothing_but_the_shard_in_flight(tmp_path):
    script = Path(__file__).parents[1] / "support" / "kill_matrix.py"
    kills, n_poses = ("20", "160") if IS_NIGHTLY else ("6", "48")
    command = [sys.executable, str(script), kills, n_poses, str(tmp_path)]
    result = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert result["same"]
    assert (result["rewritten"], result["left"]) == (0, [])
    assert result["kills"] >= 2
