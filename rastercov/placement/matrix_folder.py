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
import math
import os
import secrets
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError, ResourceError
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.base.threads import share_poses, thread_count
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Rig, cameras_of
from rastercov.cluster import ShardStore
from rastercov.cluster.run import counted
from rastercov.cluster.scene_file import read_scene, scene_bytes
from rastercov.cluster.store import (
    SUMS,
    DamagedError,
    Note,
    contents,
    locked,
    renew,
    store,
    sum_file,
)
from rastercov.cluster.work import FolderLostError
from rastercov.coverage.area.cells import Cells, cells
from rastercov.coverage.area.frames import check_same_mesh
from rastercov.coverage.area.regions import RegionObserver
from rastercov.coverage.coverage import evaluate_batches, judged, measurements
from rastercov.coverage.engine import Engine
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.observer import ExactObserver, Observer, open_observer
from rastercov.coverage.provenance import sha256
from rastercov.coverage.shards import inputs_of
from rastercov.coverage.task import Task
from rastercov.kernels import placement_bits as kernels
from rastercov.placement.bits import CoveredBits, n_words
from rastercov.placement.mounts import Mounts, places_on_rigs
from rastercov.placement.uncovered import FIGURES, CandidateBounds

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

FUNCTION = "rastercov.placement.matrix_folder:make"
"""Function by which workers make a shard."""
PAIRS_A_SHARD = 1 << 22
"""Pose-face pairs, seen or not, of one shard: several seconds of work."""
ROWS_A_GROUP = 1 << 20
"""Rows of a shard that Parquet compresses together."""
MOST_THREADS = 4
"""Threads that read shards at a time; each takes some ten bytes a pair of one."""
OPEN = 2
"""Matrices that a worker keeps open: that of a plan, and that of its cavities."""
FORMAT = 2
HEADER, POSES, CAMERAS = "header.json", "poses.npy", "cameras.npy"
SCENE = "scene.npz"
"""Mesh and cameras in the folder of a matrix that workers make."""
PAIRS, BITS, BOUNDS = "pairs", "bits", "bounds"
"""Folders of the shards, of bits that are derived from them, and of bounds, a file a worker."""
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


# --- pairs of poses and faces -----------------------------------------------------------------


class Pairs(NamedTuple):
    """Number of pairs of each pose; face, coverage, covered mask and camera of each pair.

    `on_rig` is the number of the camera on its rig, empty where poses are of single cameras.
    """

    counts: IntArray
    face: NDArray[np.int32]
    coverage: NDArray[np.float32]
    covered: BoolArray
    on_rig: NDArray[np.uint16]


KINDS: tuple[Any, ...] = (np.int64, np.int32, np.float32, np.bool_, np.uint16)
NO_PAIRS = Pairs(*(np.zeros(0, kind) for kind in KINDS))
NOT_ON_RIGS = NO_PAIRS.on_rig


def gathered(batches: Iterable[Pairs]) -> Pairs:
    """Pairs of all batches."""
    return Pairs(*map(np.concatenate, zip(NO_PAIRS, *batches, strict=True)))


def pairs_of(
    observer: Observer,
    poses: Poses,
    task: Task,
    cells: Cells | None,
    bounds: CandidateBounds | None = None,
    mounts: Mounts | None = None,
    did: Callable[[int], None] = lambda count: None,
) -> Pairs:
    """Pairs of some poses and faces, or cells; poses are those of mounts.

    A mount has a pair with a face for each of its cameras that has one, one after the other. `did`
    is called with the number of poses that each batch ends.
    """
    cameras, owner = (poses, np.arange(len(poses))) if mounts is None else mounts.cameras(poses)
    found, n_cameras, n_done = [], 0, 0
    for batch in (
        _of_faces(observer, cameras, task, bounds)
        if cells is None
        else _of_cells(observer, cells, cameras, task, bounds)
    ):
        found.append(batch)
        n_cameras += len(batch.counts)
        n_whole = int(owner[n_cameras]) if n_cameras < len(owner) else len(poses)
        if n_whole > n_done:
            did(n_whole - n_done)
        n_done = n_whole
    pairs = gathered(found)
    if mounts is None or not mounts.has_rigs:
        return pairs
    camera = np.repeat(np.arange(len(owner)), pairs.counts)
    on_rig = places_on_rigs(owner)[camera].astype(np.uint16)
    order = np.lexsort((pairs.face, owner[camera]))
    counts = np.bincount(owner[camera], minlength=len(poses))
    of_pairs: tuple[Any, ...] = (pairs.face, pairs.coverage, pairs.covered, on_rig)
    return Pairs(counts, *(column[order] for column in of_pairs))


def _of_faces(
    observer: Observer, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Pairs]:
    """Pairs of poses and faces with coverage > 0."""
    figures = ("coverage", *(FIGURES if bounds is not None else ()))
    for batch in evaluate_batches(observer, poses, task, fields=figures):
        pose, face = np.nonzero((batch.coverage > 0) & batch.mesh.task_mask)
        short, covered = shortened(batch.coverage[pose, face], batch.task.min_coverage)
        counts = np.bincount(pose, minlength=len(batch.pose_ids))
        yield Pairs(counts, face.astype(np.int32), short, covered, NOT_ON_RIGS)
        if bounds is not None and len(batch.pose_ids):
            bounds.add(batch)


def _of_cells(
    observer: Any, cells: Cells, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Pairs]:
    """Pairs of poses and cells with a covered share; visibility is computed once for both."""
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    for part, seen in measurements(observer, poses):
        found = cells.share(seen.regions)  # type: ignore[union-attr] # of a RegionObserver
        covered = shortened(found.share, task.min_coverage)
        yield Pairs(np.diff(found.starts), found.cell, *covered, NOT_ON_RIGS)
        if bounds is not None and len(part):
            bounds.add(judged(observer, judge, task, part, seen, FIGURES))


def region_observer(observer: Observer, cells: Cells, task: Task) -> RegionObserver:
    """Observer of the regions in the mesh of some cells, by the method of another one."""
    check_same_mesh(cells.mesh, observer.mesh)
    if not isinstance(observer, ExactObserver):
        raise ConfigError("cells need method certified or exact, got sampled")
    engine = Engine(observer.info.plan, threads=observer.threads)
    return RegionObserver(observer.mesh, observer.camera, task, engine, only_task=True)


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


# --- header, poses and shards -----------------------------------------------------------------


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
    """A folder of a visibility matrix, of which nothing is in memory.

    Attributes
    ----------
    path : Path
    header : dict
        Inputs of the matrix.
    n_pairs : int
        Pairs of pose and face, or cell, with coverage above 0, once all shards are there.
    """

    path: Path
    header: dict[str, Any]
    n_pairs: int = 0

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
            found = cls(folder, header)
            n_shards = len(found.store)
            if missing := found.store.missing():
                raise ConfigError(
                    f"{folder}: {len(missing)} of {n_shards} shards are missing; "
                    "call build_matrix with the same inputs to make them"
                )
            return replace(found, n_pairs=sum(map(found.rows_in, range(n_shards))))

    @property
    def store(self) -> ShardStore:
        """Shards of the folder."""
        n_poses, size = self.header["n_poses"], self.header["poses_a_shard"]
        return ShardStore(self.path, f"{PAIRS}/pairs-{{}}.parquet", n_poses, size, FUNCTION)

    @property
    def is_of_rigs(self) -> bool:
        """True where pairs are of the cameras of rigs."""
        return "pairs" in self.header

    def poses(self) -> Poses:
        """Candidates; ConfigError where they are damaged."""
        with _remade_by_build():
            return read_poses(self.path, self.header)

    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        with _remade_by_build():
            return self.store.quarantined()

    def pairs_of(
        self, number: int
    ) -> tuple[IntArray, NDArray[np.int32], NDArray[np.float32], NDArray[np.uint16]]:
        """Number of pairs of each pose of a shard, and face, coverage and camera of each pair.

        Raises
        ------
        ConfigError
            When the shard is damaged or missing by now.
        """
        with _remade_by_build():
            file = self._shard(number)
        names = ["pose", "face", "coverage", *(["camera_on_rig"] if self.is_of_rigs else [])]
        table, rows = file.read(names, use_threads=False), self.store.rows(number)
        pose, *columns = (table[name].to_numpy() for name in names)
        counts = np.bincount(pose - rows.start, minlength=rows.stop - rows.start)
        face, coverage, on_rig = (*columns, NOT_ON_RIGS)[:3]
        return counts, face, coverage, on_rig

    def rows_in(self, number: int) -> int:
        """Number of pairs in a shard; DamagedError unless it is whole, and of this matrix."""
        return int(self._shard(number).metadata.num_rows)

    def _shard(self, number: int) -> "pq.ParquetFile":
        """A verified shard."""
        name = self.store.name(number)
        found, written_with = _opened(self.path, name)
        if written_with != {**self.header, "shard": name}:
            raise DamagedError(
                self.path / name,
                "this is a shard of another matrix, or of other poses of this one",
            )
        return found

    def shard_bytes(self, number: int | None, pairs: Pairs, numbers: IntArray) -> memoryview:
        """File of a shard of the poses of these numbers; without a number it is of no use."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        # Metadata name the shard and hold the header of its matrix.
        own = {**self.header, "shard": "" if number is None else self.store.name(number)}
        schema = pair_schema(self.is_of_rigs).with_metadata({"rastercov": json.dumps(own)})
        counts, *columns = pairs
        columns = [np.repeat(numbers, counts).astype(np.int32), *columns][: len(schema)]
        sink = pa.BufferOutputStream()
        # In one piece: the bytes depend on neither batches nor threads.
        with pq.ParquetWriter(sink, schema, compression="zstd", write_page_checksum=True) as writer:
            writer.write_table(pa.table(columns, schema=schema), row_group_size=ROWS_A_GROUP)
        return memoryview(sink.getvalue())


@contextmanager
def _remade_by_build() -> Iterator[None]:
    """Name `build_matrix` in the error of a damaged file: it makes the file again."""
    try:
        yield
    except DamagedError as error:
        raise ConfigError(
            f"{error}; call build_matrix with the same inputs to make it again"
        ) from None


def claim(
    folder: Path, header: dict[str, Any], poses: Poses, shard_size_given: bool, note: Note
) -> MatrixFolder:
    """The folder with its present header where it agrees with `header`, or with `header`.

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
    files = _files_of_poses(kept)
    try:
        read_poses(folder, kept)
    except DamagedError as error:
        if all((folder / name).exists() for name in files):
            note(f"{error}; made again")
        arrays: tuple[NDArray[Any], ...] = (poses.world_from_camera, poses.camera)
        for name, array in zip(files, arrays, strict=False):
            file = io.BytesIO()
            np.save(file, array)
            store(folder, name, file.getvalue())
    claimed = MatrixFolder(folder, kept)
    names = {folder / claimed.store.name(number) for number in range(len(claimed.store))}
    for stray in sorted(set(folder.glob(f"{PAIRS}/pairs-*.parquet")) - names):
        note(f"{stray}: no shard of this matrix; removed")
        stray.unlink()
    return claimed


def _difference(kept: dict[str, Any], header: dict[str, Any], shard_size_given: bool) -> str | None:
    """Words on the first entry in which two headers differ, None where they agree."""
    left_out = () if shard_size_given else ("poses_a_shard",)
    differing = (name for name in WORDS if kept.get(name) != header.get(name))
    return next((WORDS[name] for name in differing if name not in left_out), None)


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


def _whole(folder: Path, name: str) -> bytes:
    """Bytes of a file; DamagedError as for `contents`, and where it is missing."""
    data = contents(folder, name)
    if data is None:
        raise DamagedError(folder / name, "it is missing")
    return data


def read_poses(folder: Path, header: dict[str, Any]) -> Poses:
    """Poses of a matrix, each with its camera.

    Raises
    ------
    DamagedError
        As for `contents`, where a file is missing, and for poses of another matrix.
    """
    arrays = []
    for name, key in _files_of_poses(header).items():
        array = np.load(io.BytesIO(_whole(folder, name)), allow_pickle=False)
        if sha256(array) != header[key]:
            what = key.replace("_", " ")
            raise DamagedError(folder / name, f"these are {what} of another matrix")
        arrays.append(array)
    return Poses.of(arrays[0], camera=arrays[1] if arrays[1:] else None)


def _files_of_poses(header: dict[str, Any]) -> dict[str, str]:
    """Entry of the header with the hash of each file of poses, by the name of the file."""
    files = {POSES: "poses", CAMERAS: "pose_camera"}
    return {name: key for name, key in files.items() if key in header}


@cache
def pair_schema(of_rigs: bool = False) -> "pa.Schema":
    """Columns of a shard, one row a pose-face pair; loads pyarrow, which takes 0.15 s.

    Of rigs, a row is of a pose, a face and a camera, by its number on the rig.
    """
    import pyarrow as pa

    types = {"pose": pa.int32(), "face": pa.int32(), "coverage": pa.float32()}
    types |= {"covered": pa.bool_()} | ({"camera_on_rig": pa.uint16()} if of_rigs else {})
    return pa.schema([pa.field(name, kind, False) for name, kind in types.items()])


def _opened(folder: Path, shard: str) -> "tuple[pq.ParquetFile, dict[str, Any]]":
    """A shard, and the header with its name in it; nothing for a table of other columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.ParquetFile(pa.BufferReader(_whole(folder, shard)))
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


# --- bits -------------------------------------------------------------------------------------


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
    for number in range(len(folder.store)):
        digest.update(sum_file(folder.path, folder.store.name(number)).read_bytes())
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
    size = 8 * shape[0] * shape[1]
    try:
        with path.open("wb") as file:  # so large that no write to it finds the disk full
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        raise ResourceError(
            f"{path}: {size:,} bytes cannot be reserved ({error.strerror}); "
            "make room on the disk, or use fewer candidates"
        ) from None
    shards, total, lock = folder.store, np.zeros(shape[0]), threading.Lock()
    did = counted(shape[0], progress)

    def work(part: slice) -> None:
        for number in range(part.start, part.stop):
            rows = shards.rows(number)
            words, total[rows] = _bits_of(folder, number, shape[1], least)
            if len(words):
                at = 8 * shape[1] * rows.start
                np.memmap(path, "<u8", "r+", at, words.shape)[:] = words
            with lock:
                did(len(words))

    threads = max(1, min(thread_count(None), MOST_THREADS, len(shards)))
    share_poses(len(shards), [work] * threads)
    return total


def _bits_of(
    folder: MatrixFolder, number: int, width: int, least: float
) -> tuple[NDArray[np.uint64], FloatArray]:
    """Bits and total coverage of the poses of a shard."""
    counts, face, coverage, on_rig = folder.pairs_of(number)
    if len(on_rig):
        counts, face, coverage = greatest(counts, face, coverage)
    words = np.zeros((len(counts), width), np.uint64)
    enough = coverage >= np.float64(least)
    kernels.set_pairs(np.repeat(np.arange(len(counts)), counts)[enough], face[enough], words)
    return words, totals_of(counts, coverage)


# --- workers ----------------------------------------------------------------------------------


def write_scene(folder: Path, observer: Observer, mounts: Mounts | None) -> None:
    """Write mesh, cameras and mounts into the folder of a matrix, for workers."""
    arrays = {}
    if mounts is not None and mounts.has_rigs:
        arrays = {"starts": mounts.starts, "places": mounts.rig.rig_from_camera}
    renew(folder, SCENE, scene_bytes(observer.mesh, observer.camera, arrays))


def add_bounds(folder: MatrixFolder, bounds: CandidateBounds) -> None:
    """Add the bounds that workers left of all shards, unless some are missing or damaged."""
    found = []
    for path in sorted((folder.path / BOUNDS).glob("*.npz")):
        try:
            data = _whole(folder.path, f"{BOUNDS}/{path.name}")
        except DamagedError:
            return
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            found.append(dict(file))
    of_file = [np.zeros(0, np.int64), *(part["shards"] for part in found)]
    if sorted(np.concatenate(of_file).tolist()) != list(range(len(folder.store))):
        return  # a shard was made again, by another worker
    for part in found:
        np.maximum(bounds.low, part["low"], out=bounds.low)
        np.maximum(bounds.high, part["high"], out=bounds.high)
        bounds.covering += part["covering"]
        bounds.n_poses += int(part["n_poses"])


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
    return _opened_once(folder, modified)(number, chosen)


@lru_cache(OPEN)
def _opened_once(folder: Path, modified: int) -> Callable[[int | None, IntArray], memoryview]:
    """Function `make` of a folder; its observer lives as long as this process, or two others."""
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
        if asdict(observer.info) != header["measured_by"]:
            raise ConfigError(
                f"{folder}: a worker measures by {observer.info.renderer}, and the run by "
                f"{header['measured_by']['renderer']}; use the same versions and devices"
            )
        opened.pop_all()
    mounts = None
    if scene.more:
        starts, places = scene.more["starts"], scene.more["places"]
        names = tuple(f"mount {index}" for index in range(len(starts) - 1))
        mounts = Mounts(names, Rig(scene.cameras, None, places), starts)

    matrix = MatrixFolder(folder, header)
    bounds = CandidateBounds(scene.mesh.n_faces, scene.mesh.task_mask)
    file = f"{os.uname().nodename}-{os.getpid()}-{secrets.token_hex(4)}"
    bounded: list[int] = []

    def make_shard(number: int | None, chosen: IntArray) -> memoryview:
        placed, added = renumbered(poses[chosen]), None if number is None else bounds
        pairs = pairs_of(observer, placed, task, made_on, added, mounts)
        data = matrix.shard_bytes(number, pairs, chosen)
        if number is not None:
            bounded.append(number)
            content = io.BytesIO()
            np.savez(content, shards=np.array(bounded, np.int64), **vars(bounds))
            store(folder, f"{BOUNDS}/{file}.npz", content.getvalue())
        return data

    return make_shard


def _engine_of(header: dict[str, Any]) -> Engine:
    """Engine that a matrix is measured by, on one thread."""
    by = header["measured_by"]
    if by["backend"] == "analytic":
        return Engine(by["plan"], threads=1)
    return Engine("sampled", by["backend"], math.isqrt(header["samples"]), threads=1)
