"""Visibility matrix whose covered pairs are bits in a memory-mapped file.

Serves selections from more pairs than the memory holds: `measure_matrix` -> `BitMatrix.of` ->
`problem_of` -> `select_greedy`. Coverage itself stays on the disk, in the shards.

The file is derived from the shards of a matrix:

bits/covered-0.5.words   (C, W) uint64, one row a candidate, of pairs with coverage >= 0.5
bits/covered-0.5.npz     what it was made from: for each shard the SHA-256 of its Parquet file and
                         of its rows, and the total coverage of each candidate

One file for all shards, because a process has some thousand open files and mappings, and a matrix
has more shards. Rows whose hash is not the one recorded, or whose shard has changed since, are made
again from the shard, so a kill at any moment, a damaged disk and an exchanged shard lose only time.
"""

import hashlib
import io
import os
import threading
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError, ResourceError
from rastercov.base.threads import share_poses, thread_count
from rastercov.cluster.store import SUMS, DamagedError, contents, locked, store
from rastercov.coverage.task import Task
from rastercov.kernels import placement_bits as kernels
from rastercov.placement._arrays import FloatArray
from rastercov.placement.bits import CoveredBits, n_words
from rastercov.placement.matrix_folder import BITS, MatrixFolder, greatest

MOST_THREADS = 4
"""Threads that read shards at a time; each takes some ten bytes a pair of one."""
SECONDS_A_RECORD = 10.0
"""Seconds after which the rows made so far are recorded, so that another run has them."""
DIGEST = 32
"""Bytes of a SHA-256."""


@dataclass(frozen=True, eq=False)
class _Record:
    """Hashes of the S shards that rows were made from and of these rows, and sums of coverage."""

    made_from: NDArray[np.uint8]  # (S, 32)
    of_rows: NDArray[np.uint8]  # (S, 32)
    total: FloatArray  # (C,)

    @classmethod
    def empty(cls, n_shards: int, n_poses: int) -> Self:
        digests = np.zeros((2, n_shards, DIGEST), np.uint8)
        return cls(digests[0], digests[1], np.zeros(n_poses))

    @classmethod
    def read(cls, folder: MatrixFolder, name: str) -> Self:
        """The record of a file, an empty one where there is none that can be trusted."""
        empty = cls.empty(len(folder.shards()), folder.header["n_poses"])
        try:
            data = contents(folder.path, name)
            if data is None:
                return empty
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                found = cls(*(file[field] for field in vars(empty)))
        except (DamagedError, ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile):
            return empty
        same = all(
            getattr(found, field).shape == value.shape
            and getattr(found, field).dtype == value.dtype
            for field, value in vars(empty).items()
        )
        return found if same else empty

    def write(self, folder: MatrixFolder, name: str) -> None:
        file = io.BytesIO()
        np.savez(file, **vars(self))
        store(folder.path, name, file.getvalue())


def covered_bits(
    folder: MatrixFolder,
    least: float,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[CoveredBits, FloatArray]:
    """Pairs of a matrix with coverage of at least `least`, and (C,) total coverage of each pose.

    Makes the file, or the part of it that is missing or damaged.

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
        (folder.path / BITS).mkdir(exist_ok=True)
        record = _Record.read(folder, f"{name}.npz")
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _reserve(descriptor, path, 8 * shape[0] * shape[1])
            _make_rows(folder, descriptor, shape[1], least, record, f"{name}.npz", progress)
        finally:
            os.close(descriptor)
    words = np.memmap(path, "<u8", "r", shape=shape)
    return CoveredBits.of(words, header["n_faces"]), record.total


def _reserve(descriptor: int, path: Path, n_bytes: int) -> None:
    """Give a file its size on the disk, so that no write to it finds the disk full."""
    try:
        if os.fstat(descriptor).st_size != n_bytes:
            os.ftruncate(descriptor, n_bytes)
        os.posix_fallocate(descriptor, 0, n_bytes)
    except OSError as error:
        raise ResourceError(
            f"{path}: {n_bytes:,} bytes cannot be reserved ({error.strerror}); "
            "make room on the disk, or use fewer candidates"
        ) from None


def _make_rows(
    folder: MatrixFolder,
    descriptor: int,
    width: int,
    least: float,
    record: _Record,
    name: str,
    progress: Callable[[int, int], None],
) -> None:
    """Make all rows that are not there, with threads that each take the next shard."""
    shards = folder.shards()
    lock, done, recorded, n_new = threading.Lock(), 0, time.monotonic(), 0
    progress(0, folder.header["n_poses"])

    def work(part: slice) -> None:
        nonlocal done, recorded, n_new
        for number in range(part.start, part.stop):
            shard, rows = shards[number]
            at, size = 8 * width * rows.start, 8 * width * (rows.stop - rows.start)
            source = _recorded_hash(folder.path, shard)
            is_there = (record.made_from[number] == source).all() and (
                record.of_rows[number] == _hash(os.pread(descriptor, size, at))
            ).all()
            if not is_there:
                words, total = _rows_of(folder, shard, rows, width, least)
                _write_at(descriptor, words, at)
                of_rows = _hash(words)
            with lock:
                done += rows.stop - rows.start
                progress(done, folder.header["n_poses"])
                if is_there:
                    continue
                n_new += 1
                record.made_from[number], record.of_rows[number] = source, of_rows
                record.total[rows] = total
                if time.monotonic() - recorded > SECONDS_A_RECORD:
                    record.write(folder, name)
                    recorded = time.monotonic()

    threads = max(1, min(thread_count(None), MOST_THREADS, len(shards)))
    try:
        share_poses(len(shards), [work] * threads)
    finally:
        if n_new:
            record.write(folder, name)


def _rows_of(
    folder: MatrixFolder, shard: str, rows: slice, width: int, least: float
) -> tuple[NDArray[np.uint64], FloatArray]:
    """Bits and total coverage of the poses of a shard."""
    counts, face, coverage, on_rig = folder.pairs_of(shard, rows)
    if len(on_rig):
        counts, face, coverage = greatest(counts, face, coverage)
    words = np.zeros((len(counts), width), np.uint64)
    enough = coverage >= np.float64(least)
    row = np.repeat(np.arange(len(counts)), counts)
    if enough.all():
        kernels.set_pairs(row, face, words)
    else:
        kernels.set_pairs(row[enough], face[enough], words)
    ends = np.cumsum(counts)
    # Pose by pose, 10 us each, as in `VisibilityMatrix.mean_coverage`.
    total = [coverage[b - n : b].sum(dtype=np.float64) for b, n in zip(ends, counts, strict=True)]
    return words, np.array(total, np.float64)


def _recorded_hash(folder: Path, shard: str) -> NDArray[np.uint8]:
    """SHA-256 of a verified shard, as the folder has recorded it; zeros where it has not."""
    try:
        text = (folder / SUMS / f"{Path(shard).name}.sha256").read_text(encoding="ascii")
        return np.frombuffer(bytes.fromhex(text.split()[0]), np.uint8)
    except (OSError, ValueError, IndexError):
        return np.zeros(DIGEST, np.uint8)


def _hash(data: Any) -> NDArray[np.uint8]:
    return np.frombuffer(hashlib.sha256(data).digest(), np.uint8)


def _write_at(descriptor: int, words: NDArray[np.uint64], at: int) -> None:
    data = memoryview(words.astype("<u8").tobytes())
    while data:
        n_written = os.pwrite(descriptor, data, at)
        data, at = data[n_written:], at + n_written


@dataclass(frozen=True, eq=False)
class BitMatrix:
    """Faces, or cells, that each candidate pose covers, one bit each.

    Attributes
    ----------
    poses : (C, 4, 4) float64
        world_from_camera of the candidates.
    camera : (C,) int32
        Index of the camera of each pose; 0 where there is one.
    folders : tuple of MatrixFolder
        Folders of the matrices of consecutive candidates.
    bits : CoveredBits
        Pairs that count as covered by `task`.
    mean_coverage : (C,) float64
        Mean coverage of each pose over the faces that are scored.
    """

    poses: FloatArray
    camera: NDArray[np.int32]
    folders: tuple[MatrixFolder, ...]
    bits: CoveredBits
    mean_coverage: FloatArray

    @classmethod
    def of(
        cls,
        folder: MatrixFolder,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Self:
        """Matrix of a complete folder, which gets the file of bits.

        Parameters
        ----------
        folder : MatrixFolder
            See `measure_matrix`.
        progress : callable
            Called with the poses done and the total.

        Raises
        ------
        ConfigError
            When another process is writing to the folder, or a file of it is damaged.
        ResourceError
            When the disk has no room for the bits.
        """
        header = folder.header
        bits, total = covered_bits(folder, Task(**header["task"]).min_coverage, progress)
        mean = total / max(1, header["n_task_faces"])
        poses = folder.poses()
        return cls(poses.world_from_camera, poses.camera, (folder,), bits, mean)

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `measure_matrix` or `build_matrix` left in a folder; errors as for `of`."""
        return cls.of(MatrixFolder.open(folder))

    @property
    def header(self) -> dict[str, Any]:
        """Inputs of the first matrix."""
        return self.folders[0].header

    @property
    def task(self) -> Task:
        """Thresholds of coverage."""
        return Task(**self.header["task"])

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.poses)

    @property
    def n_faces(self) -> int:
        """Faces F of the mesh; of a matrix of cells, their number."""
        return int(self.header["n_faces"])

    @property
    def n_pairs(self) -> int:
        """Pairs with coverage above 0."""
        return sum(folder.n_pairs for folder in self.folders)

    @property
    def is_of_cells(self) -> bool:
        """True where the elements are cells, not faces."""
        return "cells" in self.header

    @property
    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        found: dict[int, str] = {}
        first = 0
        for folder in self.folders:
            found |= {first + pose: end for pose, end in folder.quarantined().items()}
            first += folder.header["n_poses"]
        return found

    def covered_at(self, least: float) -> CoveredBits:
        """Pairs with coverage of at least `least`, from another file that is made where missing."""
        if least == self.task.min_coverage:
            return self.bits
        parts = [covered_bits(folder, float(least))[0].parts for folder in self.folders]
        return CoveredBits(tuple(part for each in parts for part in each), self.n_faces)

    def joined(self, other: "BitMatrix") -> "BitMatrix":
        """Matrix of the poses of both, of one mesh and one task."""
        if self.n_faces != other.n_faces or self.task != other.task:
            raise ConfigError("matrices of other faces or another task cannot be joined")
        return BitMatrix(
            np.concatenate((self.poses, other.poses)),
            np.concatenate((self.camera, other.camera)),
            (*self.folders, *other.folders),
            self.bits.joined(other.bits),
            np.concatenate((self.mean_coverage, other.mean_coverage)),
        )
