"""Covered pairs as bits in the folder of a matrix: derived, verified, made again where damaged."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
from matrix_damage import contents_of, flip
from test_matrix import CAMERA, MESH, N_POSES, POSES, TASK

import rastercov as rc
from rastercov.base.errors import ConfigError, ResourceError
from rastercov.cluster.store import locked
from rastercov.placement.matrix import BitMatrix, VisibilityMatrix, build_matrix, measure_matrix
from rastercov.placement.matrix_folder import MatrixFolder

WORDS = Path("bits") / "covered-0.3.words"
RECORD = Path("bits") / "covered-0.3.npz"
SUM_OF_RECORD = Path("sha256") / "covered-0.3.npz.sha256"


def measure(folder, poses=POSES, **options):
    return measure_matrix((MESH, CAMERA), poses, TASK, folder, poses_a_shard=4, **options)


def dense(bits):
    rows = [bits.faces_of(row) for row in range(bits.n_rows)]
    found = np.zeros((bits.n_rows, bits.n_faces), bool)
    for row, faces in enumerate(rows):
        found[row, faces] = True
    return found


def covered(matrix, least=None):
    """(C, F) covered pairs of a matrix of lists."""
    found = np.zeros((matrix.n_poses, matrix.n_faces), bool)
    pose = np.repeat(np.arange(matrix.n_poses), np.diff(matrix.indptr))
    enough = matrix.covered if least is None else matrix.coverage >= np.float64(least)
    found[pose[enough], matrix.face[enough]] = True
    return found


@pytest.fixture(scope="module")
def lists():
    return build_matrix((MESH, CAMERA), POSES, TASK)


def test_bits_are_the_covered_pairs_of_the_matrix(tmp_path, lists):
    folder = measure(tmp_path)
    matrix = BitMatrix.of(folder)
    np.testing.assert_array_equal(dense(matrix.bits), covered(lists))
    np.testing.assert_array_equal(matrix.poses, lists.poses)
    np.testing.assert_array_equal(matrix.mean_coverage, lists.mean_coverage)
    assert (matrix.n_pairs, matrix.n_faces, matrix.task) == (len(lists.face), MESH.n_faces, TASK)
    for least in (0.0, 0.3, 0.9):
        np.testing.assert_array_equal(dense(matrix.covered_at(least)), covered(lists, least))
    np.testing.assert_array_equal(dense(BitMatrix.load(tmp_path).bits), covered(lists))


def test_the_shards_are_those_of_a_plain_run(tmp_path):
    BitMatrix.of(measure(tmp_path / "bits"))
    build_matrix((MESH, CAMERA), POSES, TASK, tmp_path / "plain", poses_a_shard=4)
    found, plain = contents_of(tmp_path / "bits"), contents_of(tmp_path / "plain")
    further = {str(WORDS), str(RECORD), f"sha256/{RECORD.name}.sha256"}
    assert set(found) == set(plain) | further
    assert {name: found[name] for name in plain} == plain
    digest, name = found[f"sha256/{RECORD.name}.sha256"].decode().split()
    assert digest == hashlib.sha256(found[name]).hexdigest()
    assert VisibilityMatrix.load(tmp_path / "bits").n_poses == N_POSES


def test_matrices_of_two_folders_are_one(tmp_path, lists):
    parts = [measure(tmp_path / "one", POSES[:6]), measure(tmp_path / "two", POSES[6:])]
    matrix = BitMatrix.of(parts[0]).joined(BitMatrix.of(parts[1]))
    np.testing.assert_array_equal(dense(matrix.bits), covered(lists))
    np.testing.assert_array_equal(dense(matrix.covered_at(0.9)), covered(lists, 0.9))
    np.testing.assert_array_equal(matrix.mean_coverage, lists.mean_coverage)
    assert matrix.n_pairs == len(lists.face)
    other = measure_matrix((MESH, CAMERA), POSES, rc.Task(), tmp_path / "three")
    with pytest.raises(ConfigError, match="another task"):
        matrix.joined(BitMatrix.of(other))


@pytest.fixture
def made(monkeypatch):
    """Shards whose rows are made, as they are made."""
    names, pairs_of = [], MatrixFolder.pairs_of

    def watched(folder, number):
        names.append(number)
        return pairs_of(folder, number)

    monkeypatch.setattr(MatrixFolder, "pairs_of", watched)
    return names


def test_a_damaged_or_exchanged_file_is_made_again(tmp_path, lists, made):
    folder, other = measure(tmp_path / "one"), measure(tmp_path / "two", POSES[::-1])
    for each in (folder, other):
        BitMatrix.of(each)
    one, two = tmp_path / "one", tmp_path / "two"
    whole = (one / WORDS).read_bytes()

    def n_made():
        made.clear()
        seen = []
        matrix = BitMatrix.of(folder, lambda done, total: seen.append((done, total)))
        np.testing.assert_array_equal(dense(matrix.bits), covered(lists))
        np.testing.assert_array_equal(matrix.mean_coverage, lists.mean_coverage)
        assert seen[-1] == (N_POSES, N_POSES)
        assert (one / WORDS).read_bytes() == whole
        return len(made)

    assert n_made() == 0
    flip(one / WORDS, [8 * 8 * 3 * 5 + 1])
    assert n_made() == 3
    for content in (whole[:-8], whole + b"more"):
        (one / WORDS).write_bytes(content)
        assert n_made() == 3
    for name in (WORDS, RECORD, SUM_OF_RECORD):
        (one / name).unlink()
        assert (n_made(), n_made()) == (3, 0)
    for name in (RECORD, SUM_OF_RECORD):
        flip(one / name, [500])
        assert (n_made(), n_made()) == (3, 0)
    for name in (WORDS, RECORD, SUM_OF_RECORD):
        (one / name).write_bytes((two / name).read_bytes())
    assert n_made() == 3


def test_a_damaged_shard_is_named_and_a_locked_folder_is_left_alone(tmp_path):
    folder = measure(tmp_path)
    with locked(tmp_path), pytest.raises(ConfigError, match="another process is writing"):
        BitMatrix.of(folder)
    flip(tmp_path / "pairs" / "pairs-00001.parquet", [8 * 200])
    for read in (lambda: BitMatrix.of(folder), lambda: BitMatrix.load(tmp_path)):
        with pytest.raises(ConfigError, match=r"pairs-00001\.parquet: damaged.*call build_matrix"):
            read()
    with pytest.raises(ConfigError, match="there is no matrix"):
        BitMatrix.load(tmp_path / "nowhere")


def test_a_full_disk_is_said_in_one_line(tmp_path, monkeypatch):
    folder = measure(tmp_path)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(ResourceError, match="264 bytes cannot be reserved") as error:
        BitMatrix.of(folder)
    assert "\n" not in str(error.value)


def test_no_pose_and_no_pair_are_no_rows(tmp_path):
    away = rc.look_at([[0, 0, 5.0]], [[0, 0, 9.0]])
    for name, poses in (("none", np.empty((0, 4, 4))), ("away", away)):
        matrix = BitMatrix.of(measure(tmp_path / name, poses))
        assert matrix.bits.n_rows == len(poses)
        assert not dense(matrix.bits).any()
        assert matrix.mean_coverage.tolist() == [0.0] * len(poses)
