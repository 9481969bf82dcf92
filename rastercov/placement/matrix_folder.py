"""Folder of a visibility matrix: header, poses, Parquet shards, checksums, bits.

Two checks detect every change: each file has a checksum (`rastercov.cluster.store`), and each shard
holds the header of its matrix and its own name, so that a shard of another matrix, or of other
poses of the same matrix, is refused. Pages of shards also have the checksums of Parquet, for other
readers (`page_checksum_verification` of pyarrow); those exclude headers, statistics and footer.

Shards are made in this process or by workers (`make`). Of the shards, bits are derived:

bits/covered-0.5.words   (C, W) uint64, one row a candidate, of pairs with coverage >= 0.5
bits/covered-0.5.npz     total coverage of each candidate, and the SHA-256 of these words and of the
                         checksums of all shards

One file for all shards, because a process has some thousand open files and mappings, and a matrix
has more shards. It is made again where its hash is another, so a kill at any moment, a damaged disk
and an exchanged shard lose only time.
"""

import hashlib
import io
import json
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError, ResourceError
from rastercov.base.memory import IntArray
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.pose import Poses
from rastercov.camera.rig import cameras_of
from rastercov.cluster import ShardStore
from rastercov.cluster.run import counted
from rastercov.cluster.store import SUMS, DamagedError, Note, contents, locked, store, sum_file
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.observer import Observer
from rastercov.coverage.provenance import sha256
from rastercov.coverage.shards import inputs_of
from rastercov.coverage.task import Task
from rastercov.kernels import placement_bits as kernels
from rastercov.placement.bits import CoveredBits, n_words
from rastercov.placement.mounts import Mounts

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
import math
import os
import secrets
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import asdict
from functools import lru_cache
from typing import NamedTuple

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.pose import renumbered
from rastercov.camera.rig import Rig
from rastercov.cluster.scene_file import read_scene, scene_bytes
from rastercov.cluster.store import renew
from rastercov.cluster.work import FolderLostError
from rastercov.coverage.area.cells import cells
from rastercov.coverage.area.frames import check_same_mesh
from rastercov.coverage.area.regions import RegionObserver
from rastercov.coverage.coverage import evaluate_batches, judged, measurements
from rastercov.coverage.engine import Engine
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.observer import ExactObserver, open_observer
from rastercov.placement.uncovered import FIGURES, CandidateBounds

FUNCTION = "rastercov.placement.matrix_folder:make"
"""Function by which workers make a shard."""
PAIRS_A_SHARD = 1 << 22
"""Pose-face pairs, seen or not, of one shard: several seconds of work."""
FORMAT = 2
HEADER, POSES, CAMERAS = "header.json", "poses.npy", "cameras.npy"
PAIRS, BITS = "pairs", "bits"
"""Folders of the shards, and of what is derived from them."""
WORDS = {
    "format": "in another file format",
    "rastercov": "by another version of rastercov",
    "mesh": "from another mesh",
    "cells": "for faces, or for cells of another size",
    "camera": "for another camera",
    "poses": "from other poses",
    "pose_camera": "for other cameras of the poses",
    "mounts": "for other rigs",
    "pairs": "with pairs of rigs, not of their cameras",
    "task": "for another task",
    "measured_by": "by another method or device",
    "samples": "with another supersample",
    "poses_a_shard": "with another poses_a_shard",
}
"""Words on a header that differs in an entry."""


def log_warning(line: str) -> None:
    """Log one line on the channel of the library; without logging set up, on standard error."""
    logging.getLogger("rastercov").warning("warning: %s", line)


def describe(
    observer: Observer,
    poses: Poses,
    task: Task,
    poses_a_shard: int | None,
    cells: Cells | None = None,
    mounts: Mounts | None = None,
) -> dict[str, Any]:
    """Header of a matrix: all that it depends on, ready for JSON.

    That of a matrix of cells has their size under "cells", and counts them as faces.
    """
    mesh, cameras = observer.mesh, cameras_of(observer.camera)
    n_mounts = len(cameras) if mounts is None else len(mounts)
    poses.check_cameras(n_mounts)
    if poses_a_shard is not None and (isinstance(poses_a_shard, bool) or poses_a_shard < 1):
        raise ConfigError(f"poses_a_shard must be 1 or more, got {poses_a_shard!r}")
    n_faces = mesh.n_faces if cells is None else len(cells)
    header = inputs_of(observer, task) | {
        "format": FORMAT,
        "poses": sha256(poses.world_from_camera),
        "samples": observer.observe(np.empty((0, 4, 4))).samples_per_pixel,
        "poses_a_shard": poses_a_shard or max(1, PAIRS_A_SHARD // max(1, n_faces)),
        "n_poses": len(poses),
        "n_faces": n_faces,
        "n_task_faces": int(mesh.task_mask.sum()) if cells is None else n_faces,
    }
    if max(n_mounts, len(cameras)) > 1:
        header["pose_camera"] = sha256(poses.camera)
    if mounts is not None and mounts.has_rigs:
        header["mounts"] = sha256(mounts.starts, mounts.rig.rig_from_camera)
        header["pairs"] = "of the cameras of rigs"
    return header if cells is None else header | {"cells": cells.size}


@dataclass(frozen=True, eq=False)
class MatrixFolder:
    """A complete folder of a visibility matrix, verified, of which nothing is in memory.

    Attributes
    ----------
    path : Path
    header : dict
        Inputs of the matrix.
    n_pairs : int
        Pairs of pose and face, or cell, with coverage above 0.
    """

    path: Path
    header: dict[str, Any]
    n_pairs: int

    @classmethod
    def open(cls, folder: str | Path) -> Self:
        """Verify all files of a folder.

        Raises
        ------
        ConfigError
            When it holds no matrix, when it is incomplete, or when one of its files is damaged.
        """
        folder = Path(folder)
        with _remade_by_build():
            header = read_header(folder)
            if header is None:
                raise ConfigError(f"{folder}: there is no matrix in this folder")
            shards = store_of(folder, header)
            if missing := shards.missing():
                raise ConfigError(
                    f"{folder}: {len(missing)} of {len(shards)} shards are missing; "
                    "call build_matrix with the same inputs to make them"
                )
            names = map(shards.name, range(len(shards)))
            return cls(folder, header, sum(rows_in(folder, header, name) for name in names))

    @property
    def store(self) -> ShardStore:
        """Shards of the folder."""
        return store_of(self.path, self.header)

    def shards(self) -> list[tuple[str, slice]]:
        """Name and poses of each shard."""
        store = self.store
        return [(store.name(number), store.rows(number)) for number in range(len(store))]

    def poses(self) -> Poses:
        """Candidates; ConfigError where they are damaged."""
        with _remade_by_build():
            return read_poses(self.path, self.header)

    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        with _remade_by_build():
            return self.store.quarantined()

    def pairs_of(
        self, shard: str, rows: slice
    ) -> tuple[IntArray, NDArray[np.int32], NDArray[np.float32], NDArray[np.uint16]]:
        """Number of pairs of each pose of a shard, and face, coverage and camera of each pair.

        Cameras are numbers on a rig; empty where poses are of single cameras.

        Raises
        ------
        ConfigError
            When the shard is damaged or missing by now.
        """
        with _remade_by_build():
            file = open_shard(self.path, self.header, shard)
        is_of_rigs = "pairs" in self.header
        names = ["pose", "face", "coverage", *(["camera_on_rig"] if is_of_rigs else [])]
        table = file.read(names, use_threads=False)
        of_pose = table["pose"].to_numpy() - rows.start
        counts = np.bincount(of_pose, minlength=rows.stop - rows.start)
        on_rig = table["camera_on_rig"].to_numpy() if is_of_rigs else np.zeros(0, np.uint16)
        return counts, table["face"].to_numpy(), table["coverage"].to_numpy(), on_rig


def covered_bits(
    folder: MatrixFolder,
    least: float,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[CoveredBits, FloatArray]:
    """Pairs of a matrix with coverage of at least `least`, and (C,) total coverage of each pose.

    Makes the file of bits where it is missing, damaged, or of other shards.

    Parameters
    ----------
    progress : callable
        Called with the poses done and the total.

    Raises
    ------
    ConfigError
        When another process is writing to the folder, or a shard is damaged.
    ResourceError
        Where the disk has no room.
    """
    header = folder.header
    shape = (header["n_poses"], n_words(header["n_faces"]))
    name = f"{BITS}/covered-{least!r}"
    path = folder.path / f"{name}.words"
    if 0 in shape:
        return CoveredBits.of(np.zeros(shape, np.uint64), header["n_faces"]), np.zeros(shape[0])
    with locked(folder.path):
        total = _total_in(folder, path, f"{name}.npz")
        if total is None:
            path.parent.mkdir(exist_ok=True)
            total = _write_bits(folder, path, shape, least, progress)
            file = io.BytesIO()
            digest = np.frombuffer(_hash_of_bits(folder, path), np.uint8)
            np.savez(file, digest=digest, total=total)
            store(folder.path, f"{name}.npz", file.getvalue())
    progress(shape[0], shape[0])
    words = np.memmap(path, "<u8", "r", shape=shape)
    return CoveredBits.of(words, header["n_faces"]), total


def _hash_of_bits(folder: MatrixFolder, path: Path) -> bytes:
    """SHA-256 of a file of bits and of the checksums of the shards that it is derived from."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
    for shard, _ in folder.shards():
        digest.update(sum_file(folder.path, shard).read_bytes())
    return digest.digest()


def _total_in(folder: MatrixFolder, path: Path, record: str) -> FloatArray | None:
    """Total coverage of each pose from the record of a file of bits; None unless both are whole."""
    try:
        with np.load(io.BytesIO(contents(folder.path, record) or b"")) as file:
            digest, total = file["digest"].tobytes(), file["total"]
        return total if digest == _hash_of_bits(folder, path) else None
    except (DamagedError, OSError, EOFError, ValueError, KeyError):
        return None


def _write_bits(
    folder: MatrixFolder,
    path: Path,
    shape: tuple[int, int],
    least: float,
    progress: Callable[[int, int], None],
) -> FloatArray:
    """Write all rows, with threads that each take the next shard; (C,) total coverage."""
    try:
        with path.open("wb") as file:  # so large that no write to it finds the disk full
            os.posix_fallocate(file.fileno(), 0, 8 * shape[0] * shape[1])
    except OSError as error:
        raise ResourceError(
            f"{path}: {8 * shape[0] * shape[1]:,} bytes cannot be reserved ({error.strerror}); "
            "make room on the disk, or use fewer candidates"
        ) from None
    shards, total, lock = folder.shards(), np.zeros(shape[0]), threading.Lock()
    did = counted(shape[0], progress)

    def work(part: slice) -> None:
        for shard, rows in shards[part]:
            words, total[rows] = _bits_of(folder, shard, rows, shape[1], least)
            if len(words):
                at = 8 * shape[1] * rows.start
                np.memmap(path, "<u8", "r+", at, words.shape)[:] = words
            with lock:
                did(len(words))

    threads = max(1, min(thread_count(None), MOST_THREADS, len(shards)))
    share_poses(len(shards), [work] * threads)
    return total


def _bits_of(
    folder: MatrixFolder, shard: str, rows: slice, width: int, least: float
) -> tuple[NDArray[np.uint64], FloatArray]:
    """Bits and total coverage of the poses of a shard."""
    counts, face, coverage, on_rig = folder.pairs_of(shard, rows)
    if len(on_rig):
        counts, face, coverage = greatest(counts, face, coverage)
    words = np.zeros((len(counts), width), np.uint64)
    enough = coverage >= np.float64(least)
    kernels.set_pairs(np.repeat(np.arange(len(counts)), counts)[enough], face[enough], words)
    return words, totals_of(counts, coverage)


def totals_of(counts: IntArray, coverage: NDArray[np.float32]) -> FloatArray:
    """(C,) total coverage of poses, from the number of pairs of each and the coverage of all."""
    # Pose by pose, 10 us each: `reduceat` does not give 0 for a pose without pairs.
    ends = np.cumsum(counts)
    total = [coverage[b - n : b].sum(dtype=np.float64) for b, n in zip(ends, counts, strict=True)]
    return np.array(total, np.float64)


def greatest(
    counts: IntArray, face: NDArray[np.int32], coverage: NDArray[np.float32]
) -> tuple[IntArray, NDArray[np.int32], NDArray[np.float32]]:
    """Pairs of poses, each face once, with the greatest coverage of those that follow one another.

    Arguments are the number of pairs of each pose, and face and coverage of each.
    """
    starts = np.ones(len(face), np.bool_)
    starts[1:] = face[1:] != face[:-1]
    first = np.cumsum(counts) - counts
    starts[first[first < len(face)]] = True
    rows = np.flatnonzero(starts)
    pose = np.repeat(np.arange(len(counts)), counts)[rows]
    best = np.maximum.reduceat(coverage, rows) if len(rows) else coverage
    return np.bincount(pose, minlength=len(counts)), face[rows], best


@contextmanager
def _remade_by_build() -> Iterator[None]:
    """Name `build_matrix` in the error of a damaged file: it makes the file again."""
    try:
        yield
    except DamagedError as error:
        raise ConfigError(
            f"{error}; call build_matrix with the same inputs to make it again"
        ) from None


def store_of(folder: Path, header: dict[str, Any]) -> ShardStore:
    """Shards of the matrix of a header."""
    n_poses, size = header["n_poses"], header["poses_a_shard"]
    return ShardStore(folder, f"{PAIRS}/pairs-{{}}.parquet", n_poses, size, FUNCTION)


def claim(
    folder: Path,
    header: dict[str, Any],
    poses: Poses,
    shard_size_given: bool,
    note: Note,
) -> dict[str, Any]:
    """Header of the folder: the present one where it agrees with `header`, or `header`.

    A damaged or missing header is restored from an undamaged shard, and the poses from `poses`;
    `note` is called with a line on each. Shards beyond the last one are removed.
    """
    try:
        kept = read_header(folder)
    except DamagedError as error:
        note(f"{error}; made again")
        kept = None
    is_missing = kept is None
    if kept is None:
        found = sorted(folder.glob(f"{PAIRS}/*"))
        if found and not _has_sums(folder):
            raise ConfigError(f"{folder}: shards without a header; name another folder")
        if found and not (folder / HEADER).exists():
            note(f"{folder / HEADER}: missing; made again")
        headers = [each for path in found if (each := _header_in(folder, path.name))]
        same = [each for each in headers if _difference(each, header, shard_size_given) is None]
        kept = [*same, *headers, header][0]
    words = _difference(kept, header, shard_size_given)
    if words is not None:
        raise ConfigError(_made(folder, words))
    if is_missing:
        store(folder, HEADER, json.dumps(kept, indent=2).encode() + b"\n")
    arrays: tuple[NDArray[Any], ...] = (poses.world_from_camera, poses.camera)
    try:
        read_poses(folder, kept)
    except DamagedError as error:
        if all((folder / name).exists() for name, _ in _files_of_poses(kept)):
            note(f"{error}; made again")
        for (name, _), array in zip(_files_of_poses(kept), arrays, strict=False):
            file = io.BytesIO()
            np.save(file, array)
            store(folder, name, file.getvalue())
    shards = store_of(folder, kept)
    names = {folder / shards.name(number) for number in range(len(shards))}
    for stray in sorted(set(folder.glob(f"{PAIRS}/pairs-*.parquet")) - names):
        note(f"{stray}: no shard of this matrix; removed")
        stray.unlink()
    return kept


def _difference(kept: dict[str, Any], header: dict[str, Any], shard_size_given: bool) -> str | None:
    """Words on the first entry in which two headers differ, None where they agree."""
    for name, words in WORDS.items():
        if name == "poses_a_shard" and not shard_size_given:
            continue
        if kept.get(name) != header.get(name):
            return words
    return None


def _made(folder: Path, words: str) -> str:
    return (
        f"{folder}: the matrix in this folder was made {words}; "
        "name another folder, or delete this one to start again"
    )


def read_header(folder: Path) -> dict[str, Any] | None:
    """Header of a folder, None where there is none.

    Raises
    ------
    DamagedError
        As for `contents`.
    ConfigError
        When it is of another format, or not a header.
    """
    try:
        data = contents(folder, HEADER)
    except DamagedError:
        if _has_sums(folder):
            raise
        raise ConfigError(
            f"{folder / HEADER}: this is no header of a matrix; name another folder"
        ) from None
    header: dict[str, Any] | None = None if data is None else json.loads(data)
    if header is not None and header["format"] != FORMAT:
        raise ConfigError(_made(folder, WORDS["format"]))
    return header


def _has_sums(folder: Path) -> bool:
    """True when a file of a folder has a checksum, as every file of a matrix has."""
    return any((folder / SUMS).glob("*.sha256"))


def read_poses(folder: Path, header: dict[str, Any]) -> Poses:
    """Poses of a matrix, each with its camera.

    Raises
    ------
    DamagedError
        As for `contents`, where a file is missing, and for poses of another matrix.
    """
    arrays = []
    for name, key in _files_of_poses(header):
        data = contents(folder, name)
        if data is None:
            raise DamagedError(folder / name, "it is missing")
        arrays.append(np.load(io.BytesIO(data), allow_pickle=False))
        if sha256(arrays[-1]) != header[key]:
            raise DamagedError(
                folder / name, f"these are {key} of another matrix".replace("_", " ")
            )
    return Poses.of(arrays[0], camera=arrays[1] if arrays[1:] else None)


def _files_of_poses(header: dict[str, Any]) -> list[tuple[str, str]]:
    """Name of each file of poses, and the entry of the header with its hash."""
    files = [(POSES, "poses"), (CAMERAS, "pose_camera")]
    return files if "pose_camera" in header else files[:1]


@cache
def pair_schema(of_rigs: bool = False) -> "pa.Schema":
    """Columns of a shard, one row a pose-face pair; loads pyarrow, which takes 0.15 s.

    Of rigs, a row is of a pose, a face and a camera, by its number on the rig.
    """
    import pyarrow as pa

    types = {
        "pose": pa.int32(),
        "face": pa.int32(),
        "coverage": pa.float32(),
        "covered": pa.bool_(),
    }
    if of_rigs:
        types["camera_on_rig"] = pa.uint16()
    return pa.schema([pa.field(name, kind, False) for name, kind in types.items()])


def schema_of(shard: str, header: dict[str, Any]) -> "pa.Schema":
    """Schema of a shard; its metadata name the shard and hold the header of its matrix."""
    columns = pair_schema("pairs" in header)
    return columns.with_metadata({"rastercov": json.dumps({**header, "shard": shard})})


def open_shard(folder: Path, header: dict[str, Any], shard: str) -> "pq.ParquetFile":
    """A verified shard.

    Raises
    ------
    DamagedError
        As for `contents`, where it is missing, and for a shard of another matrix or of other poses
        of this one.
    """
    found, written_with = _opened(folder, shard)
    if written_with != {**header, "shard": shard}:
        raise DamagedError(
            folder / shard, "this is a shard of another matrix, or of other poses of this one"
        )
    return found


def rows_in(folder: Path, header: dict[str, Any], shard: str) -> int:
    """Number of pairs in a shard; errors as for `open_shard`."""
    return int(open_shard(folder, header, shard).metadata.num_rows)


def _opened(folder: Path, shard: str) -> "tuple[pq.ParquetFile, dict[str, Any]]":
    """A shard, and what `schema_of` put into it; nothing for a table of other columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = contents(folder, shard)
    if data is None:
        raise DamagedError(folder / shard, "it is missing")
    try:
        found = pq.ParquetFile(pa.BufferReader(data))
    except (pa.ArrowException, OSError):
        raise DamagedError(folder / shard, "this is no Parquet file") from None
    schema = found.schema_arrow
    entries = json.loads((schema.metadata or {}).get(b"rastercov", b"{}"))
    return found, entries if schema.equals(pair_schema("pairs" in entries)) else {}


def _header_in(folder: Path, name: str) -> dict[str, Any] | None:
    """Header of the matrix from an undamaged shard, None for any other file."""
    try:
        _, header = _opened(folder, f"{PAIRS}/{name}")
    except DamagedError:
        return None
    return header if header.pop("shard", None) == f"{PAIRS}/{name}" else None


MOST_THREADS = 4
"""Threads that read shards at a time; each takes some ten bytes a pair of one."""
SCENE = "scene.npz"
"""Mesh and cameras in the folder of a matrix that workers make."""
BOUNDS = "bounds"
"""Folder of the bounds that workers found, a file for each."""
OPEN = 2
"""Matrices that a worker keeps open: that of a plan, and that of its cavities."""
ROWS_A_GROUP = 1 << 20
"""Rows of a shard that Parquet compresses together."""
OnRig = NDArray[np.uint16]
Batch = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32], BoolArray, OnRig, int]
"""Row, face, coverage, covered mask and, of rigs, the number of the camera on its rig of each pair
of some poses; and the number of poses."""
NOT_ON_RIGS = np.zeros(0, np.uint16)


class Pairs(NamedTuple):
    """Number of pairs of each pose; face, coverage, covered mask and camera of each pair.

    `on_rig` is empty where poses are of single cameras.
    """

    counts: IntArray
    face: NDArray[np.int32]
    coverage: NDArray[np.float32]
    covered: BoolArray
    on_rig: OnRig


def gathered(batches: Iterable[Batch]) -> Pairs:
    """Pairs of all batches."""
    parts = [
        Pairs(np.bincount(pose, minlength=n_poses), face, value, covered, on_rig)
        for pose, face, value, covered, on_rig, n_poses in batches
    ]
    none = np.zeros(0, np.int64)
    parts.append(Pairs(none, none.astype(np.int32), none.astype(np.float32), none > 0, NOT_ON_RIGS))
    return Pairs(*map(np.concatenate, zip(*parts, strict=True)))


def batches_of(
    observer: Observer,
    poses: Poses,
    task: Task,
    cells: Cells | None,
    bounds: CandidateBounds | None = None,
    mounts: Mounts | None = None,
    did: Callable[[int], None] = lambda count: None,
) -> Iterator[Batch]:
    """Pairs of some poses and faces, or cells, batch by batch; poses are those of mounts.

    `did` is called with the number of poses of each batch, once it was taken.
    """
    part, owner = poses, None
    if mounts is not None and mounts.has_rigs:
        part, owner = mounts.cameras(poses)
    found = (
        _of_faces(observer, part, task, bounds)
        if cells is None
        else _of_cells(observer, cells, part, task, bounds)
    )
    for batch in found if owner is None else _of_mounts(found, owner, len(poses)):
        if batch[-1]:
            yield batch
            did(batch[-1])


def _of_mounts(batches: Iterable[Batch], owner: NDArray[np.int64], n: int) -> Iterator[Batch]:
    """Batches of n mounts from those of their cameras, (K,) of which `owner` is the mount.

    A mount has a pair with a face for each of its cameras that has one, one after the other.
    """
    on_rig = (np.arange(len(owner)) - np.searchsorted(owner, owner)).astype(np.uint16)
    waiting: list[tuple[NDArray[Any], ...]] = []
    at = done = 0
    for pose, face, value, covered, _, count in batches:
        waiting.append((owner[at + pose], face, value, covered, on_rig[at + pose]))
        at += count
        whole = int(owner[at]) if at < len(owner) else n  # mounts before this one are complete
        if whole == done:
            continue
        columns = [np.concatenate(column) for column in zip(*waiting, strict=True)]
        is_whole = columns[0] < whole
        waiting = [tuple(column[~is_whole] for column in columns)]
        columns = [column[is_whole] for column in columns]
        mount, face, value, covered, camera = columns
        order = np.lexsort((camera, face, mount))
        mount, face, camera = mount[order] - done, face[order], camera[order]
        yield mount, face, value[order], covered[order], camera, whole - done
        done = whole


def region_observer(observer: Observer, cells: Cells, task: Task) -> RegionObserver:
    """Observer of the regions in the mesh of some cells, by the method of another one."""
    check_same_mesh(cells.mesh, observer.mesh)
    if not isinstance(observer, ExactObserver):
        raise ConfigError("cells need method certified or exact, got sampled")
    engine = Engine(observer.info.plan, threads=observer.threads)
    return RegionObserver(observer.mesh, observer.camera, task, engine, only_task=True)


def _of_faces(
    observer: Observer, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Batch]:
    """Pairs of poses and faces with coverage > 0."""
    figures = ("coverage", *(FIGURES if bounds is not None else ()))
    for batch in evaluate_batches(observer, poses, task, fields=figures):
        pose, face = np.nonzero((batch.coverage > 0) & batch.mesh.task_mask)
        short, covered = shortened(batch.coverage[pose, face], batch.task.min_coverage)
        yield pose, face.astype(np.int32), short, covered, NOT_ON_RIGS, len(batch.pose_ids)
        if bounds is not None and len(batch.pose_ids):
            bounds.add(batch)


def _of_cells(
    observer: Any, cells: Cells, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Batch]:
    """Pairs of poses and cells with a covered share; visibility is computed once for both."""
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    for part, seen in measurements(observer, poses):
        found = cells.share(seen.regions)  # type: ignore[union-attr] # of a RegionObserver
        pose = np.repeat(np.arange(len(part)), np.diff(found.starts))
        short, covered = shortened(found.share, task.min_coverage)
        yield pose, found.cell, short, covered, NOT_ON_RIGS, len(part)
        if bounds is not None and len(part):
            bounds.add(judged(observer, judge, task, part, seen, FIGURES))


def shortened(coverage: FloatArray, least: float) -> tuple[NDArray[np.float32], BoolArray]:
    """Coverage in float32, and the mask of values of at least `least`; both are consistent.

    No value is rounded across the threshold, nor down to 0. Thresholds other than 0 are 1e-30 or
    more, which is near the least float32.
    """
    covered: BoolArray = coverage >= least
    short = coverage.astype(np.float32)
    too_low = (covered & (short.astype(np.float64) < least)) | (short == 0)
    too_high = ~covered & (short.astype(np.float64) >= least) & ~too_low
    short[too_low] = np.nextafter(short[too_low], np.float32(np.inf))
    short[too_high] = np.nextafter(short[too_high], np.float32(-np.inf))
    return short, covered


def shard_bytes(
    shard: str, header: dict[str, Any], batches: Iterable[Batch], numbers: IntArray
) -> memoryview:
    """File of a shard of the poses of these numbers."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, sink = schema_of(shard, header), pa.BufferOutputStream()
    counts, *columns = gathered(batches)
    columns = columns[: len(schema) - 1]
    table = pa.table([np.repeat(numbers, counts).astype(np.int32), *columns], schema=schema)
    # In one piece: the bytes depend on neither batches nor threads.
    with pq.ParquetWriter(sink, schema, compression="zstd", write_page_checksum=True) as writer:
        writer.write_table(table, row_group_size=ROWS_A_GROUP)
    return memoryview(sink.getvalue())


def write_scene(folder: Path, observer: Observer, mounts: Mounts | None) -> None:
    """Write mesh, cameras and mounts into the folder of a matrix, for workers."""
    arrays = {}
    if mounts is not None and mounts.has_rigs:
        arrays = {"starts": mounts.starts, "places": mounts.rig.rig_from_camera}
    renew(folder, SCENE, scene_bytes(observer.mesh, observer.camera, arrays))


def add_bounds(folder: Path, n_shards: int, bounds: CandidateBounds) -> None:
    """Add the bounds that workers left of all shards, unless some are missing or damaged."""
    found = []
    for path in sorted((folder / BOUNDS).glob("*.npz")):
        try:
            data = contents(folder, f"{BOUNDS}/{path.name}")
        except DamagedError:
            return
        with np.load(io.BytesIO(data or b""), allow_pickle=False) as file:
            found.append({name: file[name] for name in file.files})
    of_file = [part["shards"] for part in found]
    if not found or sorted(np.concatenate(of_file).tolist()) != list(range(n_shards)):
        return  # a shard was made again, by another worker
    for part in found:
        np.maximum(bounds.low, part["low"], out=bounds.low)
        np.maximum(bounds.high, part["high"], out=bounds.high)
        bounds.covering += part["covering"]
        bounds.n_poses += int(part["n_poses"])


class _Open(NamedTuple):
    """Matrix that this process makes shards of, and the bounds that it has found."""

    header: dict[str, Any]
    batches: Callable[[IntArray, CandidateBounds | None], Iterator[Batch]]
    bounds: CandidateBounds
    bounded: list[int]
    file: str


def make(folder: Path, number: int | None, chosen: IntArray) -> memoryview:
    """Content of a shard, as `rastercov.cluster.ShardStore` wants it.

    The bounds of the poses of its shards so far are written in place of earlier ones.

    Raises
    ------
    ConfigError
        Where this process measures by another device than the header says.
    FolderLostError
        Where the files of the matrix are not there.
    """
    try:
        modified = (folder / SCENE).stat().st_mtime_ns
    except OSError:
        raise FolderLostError(f"{folder}: {SCENE} is missing") from None
    header, batches, bounds, bounded, file = _opened_once(folder, modified)
    if number is None:
        return shard_bytes("", header, batches(chosen, None), chosen)
    shard = store_of(folder, header).name(number)
    data = shard_bytes(shard, header, batches(chosen, bounds), chosen)
    bounded.append(number)
    arrays = {name: getattr(bounds, name) for name in ("low", "high", "covering", "n_poses")}
    content = io.BytesIO()
    np.savez(content, shards=np.array(bounded, np.int64), **arrays)
    store(folder, f"{BOUNDS}/{file}.npz", content.getvalue())
    return data


@lru_cache(OPEN)
def _opened_once(folder: Path, modified: int) -> _Open:
    """Matrix of a folder; its observer lives as long as this process, or until two others."""
    header, data = read_header(folder), contents(folder, SCENE)
    if header is None or data is None:
        raise FolderLostError(f"{folder}: files of the matrix are missing")
    poses, scene, task = read_poses(folder, header), read_scene(data), Task(**header["task"])
    with ExitStack() as opened:
        observer: Any = open_observer(scene.mesh, scene.cameras, _engine_of(header))
        opened.callback(observer.close)
        made_on = cells(scene.mesh, header["cells"]) if "cells" in header else None
        if made_on is not None:
            observer = region_observer(observer, made_on, task)
            opened.callback(observer.close)
        info = asdict(observer.info)
        if info != header["measured_by"]:
            raise ConfigError(
                f"{folder}: a worker measures by {info['renderer']}, and the run by "
                f"{header['measured_by']['renderer']}; use the same versions and devices"
            )
        opened.pop_all()
    mounts = None
    if scene.more:
        starts, places = scene.more["starts"], scene.more["places"]
        names = tuple(f"mount {index}" for index in range(len(starts) - 1))
        mounts = Mounts(names, Rig(scene.cameras, None, places), starts)

    def batches(chosen: IntArray, bounds: CandidateBounds | None) -> Iterator[Batch]:
        return batches_of(observer, renumbered(poses[chosen]), task, made_on, bounds, mounts)

    bounds = CandidateBounds(scene.mesh.n_faces, scene.mesh.task_mask)
    file = f"{os.uname().nodename}-{os.getpid()}-{secrets.token_hex(4)}"
    return _Open(header, batches, bounds, [], file)


def _engine_of(header: dict[str, Any]) -> Engine:
    """Engine that a matrix is measured by, on one thread."""
    by = header["measured_by"]
    if by["backend"] == "analytic":
        return Engine(by["plan"], threads=1)
    return Engine("sampled", by["backend"], math.isqrt(header["samples"]), threads=1)
