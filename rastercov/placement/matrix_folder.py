"""Folder of a visibility matrix: inputs, shards, checksums.

Two checks detect every change: each file has a checksum (`rastercov.shards.store`), and each shard
holds the header of its matrix and its own name, so that a shard of another matrix, or of other
poses of the same matrix, is refused.

A shard is a file of `numpy.savez_compressed`: `counts` of the pairs of each pose; of each pair
`face_step`, the face less that of the pair before it, `coverage`, and of rigs `camera_on_rig`. Of a
matrix of covered pairs alone it has `packed` in place of these, as of `CoverageBits`.

Shards are made in this process or by workers (`make`). Of the shards, bits are derived, (C, W)
uint64, one row per candidate. They are in one mapped file without a name, because a process has
some thousand open files and mappings, and a matrix has more shards; it ends with the process.
"""

import json
import math
import os
import platform
import secrets
import threading
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import field, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple, Self
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    ResourceError,
    frozen_record,
    owners_of,
    share_poses,
    thread_count,
)
from rastercov.core.area.cells import Cells, cells
from rastercov.core.area.regions import RegionObserver
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions
from rastercov.core.camera import Poses, cameras_of, renumber, rows_of_result
from rastercov.core.camera.rig import with_places
from rastercov.core.coverage.coverage import ExactObserver, Observer, measurements, open_observer
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.network import NetworkOfBits, can_judge
from rastercov.core.coverage.shards import (
    HEADER,
    PAIRS_OF_COUNTS,
    POSES,
    Inputs,
    hash_of,
    info_of,
    inputs_of,
    npz_bytes,
    open_once,
    read_npz,
    read_poses,
    write_inputs,
)
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.raster.contract import room_for_bits
from rastercov.placement.bits import CoveredBits, n_words
from rastercov.placement.mounts import Mounts, places_on_rigs
from rastercov.placement.uncovered import CandidateBounds, Greatest, list_pairs
from rastercov.shards import ShardStore, Staff, fill
from rastercov.shards.store import SUMS, DamagedError, Note, contents, remove, store, whole

PAIRS_A_SHARD = 1 << 22
"""Pairs of a pose and an element in one shard: several seconds of work."""
FUNCTION = "rastercov.placement.matrix_folder:make"
"""Function by which workers make a shard."""
MOST_THREADS = 4
"""Threads that read shards at a time; each takes some ten bytes per pair of a shard."""
FORMAT = 4
LEVEL = 1
"""Of zlib: steps of faces and coverage are mostly 1, and compress at 0.2 GB/s."""
COLUMNS = ("counts", "face_step", "coverage", "camera_on_rig", "packed")
PAIRS, BOUNDS = "pairs", "bounds"
"""Folders of the shards, and of bounds, a file per worker."""
WORDS = {
    "format": "in another file format",
    "rastercov": "by another version of rastercov",
    "mesh": "from another mesh",
    "cells": "for faces, or for patches of another size",
    "camera": "for another camera",
    "poses": "from other poses, or for other cameras of them",
    "mounts": "for other rigs",
    "task": "for another task",
    "measured_by": "by another method or device",
    "bits": "with coverage of pairs, or with bits alone",
    "samples": "with another supersample",
    "poses_a_shard": "with another poses_a_shard",
}
"""Words on a header that differs in an entry."""


# --- pairs of poses and faces -----------------------------------------------------------------


class Pairs(NamedTuple):
    """Number of pairs of each pose; face, coverage and camera of each pair.

    `on_rig` is the number of the camera on its rig, empty where poses are of single cameras.
    """

    counts: IntArray
    face: Int32Array
    coverage: Float32Array
    on_rig: NDArray[np.uint16]

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return len(self.counts)

    @property
    def n_pairs(self) -> int:
        """Number of pairs."""
        return len(self.face)

    def pairs(self) -> "Iterator[Pairs]":
        """These, as those of a folder."""
        yield self

    def unite(self) -> "Pairs":
        """Each face of a pose once, with the greatest coverage of those that follow one another."""
        if not len(self.on_rig):
            return self
        pose = owners_of(self.counts)
        rows = np.flatnonzero(np.diff(pose, prepend=-1) | np.diff(self.face, prepend=-1))
        best = np.maximum.reduceat(self.coverage, rows) if len(rows) else self.coverage
        counts = np.bincount(pose[rows], minlength=self.n_poses)
        return Pairs(counts, self.face[rows], best, NOT_ON_RIGS)

    def rows_and_areas(self, least: float, n_faces: int) -> tuple[CoveredBits, FloatArray]:
        """Pairs with coverage of at least `least`, and (C,) total coverage of each pose."""
        counts, face, coverage, _ = self.unite()
        row, enough = owners_of(counts), coverage >= np.float64(least)
        bits = CoveredBits.from_pairs(row[enough], face[enough], len(counts), n_faces)
        return bits, np.bincount(row, coverage, len(counts)).astype(np.float64)


KINDS: tuple[Any, ...] = (np.int64, np.int32, np.float32, np.uint16)
NO_PAIRS = Pairs(*(np.zeros(0, kind) for kind in KINDS))
NOT_ON_RIGS = NO_PAIRS.on_rig


class PackedPairs(NamedTuple):
    """Covered pairs of poses and evaluated faces as bits, (P, 8 W); see `room_for_bits`."""

    packed: ByteArray

    @property
    def counts(self) -> IntArray:
        """(P,) pairs of each pose."""
        bits, _ = self.rows_and_areas(0.0, 8 * self.packed.shape[1])
        return bits.counts(np.full(bits.n_words, ~np.uint64(0)))

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return len(self.packed)

    @property
    def n_pairs(self) -> int:
        """Number of pairs."""
        return int(self.counts.sum())

    def pairs(self) -> Iterator[Pairs]:
        """ConfigError: there is no coverage of pairs."""
        raise ConfigError("expected coverage of pairs, got bits; build without bits")

    def rows_and_areas(self, least: float, n_faces: int) -> tuple[CoveredBits, FloatArray]:
        """The pairs, whatever `least`; no coverage is known, so that its sums are not numbers."""
        bits = CoveredBits.of(self.packed.view("<u8").astype(np.uint64, copy=False), n_faces)
        return bits, np.full(len(self.packed), math.nan)


AnyPairs = Pairs | PackedPairs
Measure = Callable[[slice, Callable[[int], None]], AnyPairs]
"""Pairs of some rows; its second argument is called with the number of poses that are done."""


def gather_pairs(batches: Iterable[Pairs]) -> Pairs:
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
    cameras, owner = cameras_at(poses, mounts)
    items, n_cameras, n_done = [], 0, 0
    for batch in (
        _of_faces(observer, cameras, task, bounds)
        if cells is None
        else _of_cells(observer, cells, cameras, task, bounds)
    ):
        items.append(batch)
        n_cameras += len(batch.counts)
        n_whole = int(owner[n_cameras]) if n_cameras < len(owner) else len(poses)
        if n_whole > n_done:
            did(n_whole - n_done)
        n_done = n_whole
    return pairs_of_mounts(gather_pairs(items), owner, len(poses), mounts)


def cameras_at(poses: Poses, mounts: Mounts | None) -> tuple[Poses, IntArray]:
    """Cameras of poses, which are those of mounts, and the pose of each row of their result."""
    if mounts is None:
        return poses, np.arange(len(poses))
    cameras, owner = mounts.cameras(poses)
    return cameras, mounts.rows(cameras, owner)


def pairs_of_mounts(pairs: Pairs, owner: IntArray, n_poses: int, mounts: Mounts | None) -> Pairs:
    """Pairs of poses of mounts, from those of their cameras."""
    if mounts is None or not mounts.has_rigs:
        return pairs
    camera = owners_of(pairs.counts)
    on_rig = places_on_rigs(owner)[camera].astype(np.uint16)
    order = np.lexsort((pairs.face, owner[camera]))
    counts = np.bincount(owner[camera], minlength=n_poses)
    return Pairs(counts, pairs.face[order], pairs.coverage[order], on_rig[order])


def packed_pairs(
    observer: Observer,
    poses: Poses,
    task: Task,
    bounds: CandidateBounds | None,
    did: Callable[[int], None] = lambda count: None,
) -> PackedPairs:
    """Covered pairs of poses that the observer judges; other arguments are those of `pairs_of`."""
    n_faces, scored = observer.mesh.n_faces, observer.mesh.task_mask
    packed, at = room_for_bits(len(poses), n_faces), 0
    mask = np.packbits(scored, bitorder="little")
    for batch in NetworkOfBits(observer.mesh, task, None).judge(observer, poses):
        assert batch.bits is not None
        n = len(batch.poses)
        np.bitwise_and(batch.bits.packed, mask, out=packed[at : at + n, : len(mask)])
        at += n
        if bounds is not None:
            unknown = np.zeros(n_faces), np.ones(n_faces)
            bounds.add(n, [Greatest(*unknown, batch.bits.views)])
        did(n)
    return PackedPairs(packed)


def _of_faces(
    observer: Observer, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Pairs]:
    """Pairs of poses and faces with coverage > 0."""
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    for part, seen in measurements(observer, poses):
        yield Pairs(*list_pairs(judge, part, seen, bounds), NOT_ON_RIGS)


def _of_cells(
    observer: Observer, cells: Cells, poses: Poses, task: Task, bounds: CandidateBounds | None
) -> Iterator[Pairs]:
    """Pairs of poses and cells with a covered share; visibility is computed once for both."""
    judge = FacePass(observer.mesh, observer.camera, observer.threads, task)
    for part, seen in measurements(observer, poses, rows_of_result(observer.camera, poses)):
        regions = seen.regions  # type: ignore[union-attr] # of a RegionObserver
        yield pairs_of_cells(cells, with_rule(regions, observer.camera, part), task)
        if bounds is not None and len(part):
            list_pairs(judge, part, seen, bounds)


def pairs_of_cells(cells: Cells, regions: Regions, task: Task) -> Pairs:
    """Pairs of the poses of regions and cells with a covered share."""
    shares = cells.share(regions)
    short, _ = shorten_coverage(shares.share, task.min_coverage)
    return Pairs(np.diff(shares.starts), shares.cell, short, NOT_ON_RIGS)


def region_observer(observer: Observer, cells: Cells, task: Task) -> RegionObserver:
    """Observer of the regions in the mesh of some cells, by the method of another one."""
    cells.mesh._check_same(observer.mesh)
    if not isinstance(observer, ExactObserver):
        raise ConfigError("expected method certified or exact for patches, got sampled; change it")
    engine = Engine(observer.info.plan, threads=observer.threads)
    return RegionObserver(observer.mesh, observer.camera, task, engine, only_task=True)


def shorten_coverage(coverage: FloatArray, least: float) -> tuple[Float32Array, BoolArray]:
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


def can_pack(
    observer: Observer, poses: Poses, task: Task, cells: Cells | None, mounts: Mounts | None
) -> bool:
    """True where covered pairs can be kept alone: single cameras that the observer judges."""
    is_single = cells is None and (mounts is None or not mounts.has_rigs)
    return is_single and can_judge(observer, poses, task)


# --- header, poses and shards -----------------------------------------------------------------


def describe(
    observer: Observer,
    poses: Poses,
    task: Task,
    poses_a_shard: int | None,
    cells: Cells | None = None,
    mounts: Mounts | None = None,
    bits: bool = False,
) -> ByName:
    """Header of a matrix: all that it depends on, ready for JSON.

    That of a matrix of cells has their size under "cells", and counts them as faces; that of
    covered pairs alone has "bits".
    """
    mesh, cameras = observer.mesh, cameras_of(observer.camera)
    n_mounts = len(cameras) if mounts is None else len(mounts)
    poses.check_cameras(n_mounts)
    if poses_a_shard is not None and (isinstance(poses_a_shard, bool) or poses_a_shard < 1):
        raise ConfigError(
            f"expected poses_a_shard of 1 or more, got {poses_a_shard!r}; increase it"
        )
    n_faces = mesh.n_faces if cells is None else len(cells)
    size = PAIRS_OF_COUNTS if bits else PAIRS_A_SHARD
    header = inputs_of(observer, poses, task, n_faces, size) | {
        "format": FORMAT,
        "samples": observer.observe(np.empty((0, 4, 4))).samples_per_pixel,
        "n_poses": len(poses),
        "n_faces": n_faces,
        "n_task_faces": int(mesh.task_mask.sum()) if cells is None else n_faces,
    }
    if poses_a_shard is not None:
        header["poses_a_shard"] = poses_a_shard
    if parallel := [row for row, each in enumerate(cameras) if each.is_parallel]:
        header["parallel"] = parallel
    if mounts is not None and mounts.has_rigs:
        places = mounts.rig.rig_from_camera
        header["mounts"] = {"starts": mounts.starts.tolist(), "places": places.tolist()}
    header |= {"bits": True} if bits else {}
    return header if cells is None else header | {"cells": cells.size}


@frozen_record
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
    header: ByName
    n_pairs: int = 0
    _derived: dict[float, tuple[CoveredBits, FloatArray]] = field(default_factory=dict)

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
                raise ConfigError(
                    f"{folder}: expected a visibility matrix, got none; call build_matrix"
                )
            result = cls(folder, header)
            n_shards = len(result.store)
            if missing := result.store.missing():
                raise ConfigError(
                    f"{folder}: expected {n_shards} shards, got {n_shards - len(missing)}; call "
                    "build_matrix with the same inputs to make the others"
                )
            return replace(result, n_pairs=sum(map(result.rows_in, range(n_shards))))

    @property
    def store(self) -> ShardStore:
        """Shards of the folder."""
        n_poses, size = self.header["n_poses"], self.header["poses_a_shard"]
        return ShardStore(self.path, f"{PAIRS}/pairs-{{}}.npz", n_poses, size, FUNCTION)

    @property
    def is_of_rigs(self) -> bool:
        """True where pairs are of the cameras of rigs."""
        return "mounts" in self.header

    def poses(self) -> Poses:
        """Candidates; ConfigError where they are damaged, or of another matrix."""
        with _remade_by_build():
            poses = read_poses(self.path)
            if hash_of(poses) != self.header["poses"]:
                raise DamagedError(self.path / POSES, "poses of another matrix")
            return poses

    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        with _remade_by_build():
            return self.store.quarantined()

    @property
    def n_poses(self) -> int:
        """Number of candidates."""
        return int(self.header["n_poses"])

    def pairs(self) -> Iterator[Pairs]:
        """Pairs of each shard; errors as of `pairs_of`."""
        return (each for number in range(len(self.store)) for each in self.pairs_of(number).pairs())

    def pairs_of(self, number: int) -> AnyPairs:
        """Pairs of a shard.

        Raises
        ------
        ConfigError
            When the shard is damaged or missing by now.
        """
        with _remade_by_build():
            shard = self._shard(number)
        if "packed" in shard:
            return PackedPairs(shard["packed"])
        face = np.cumsum(shard["face_step"], dtype=np.int32)
        on_rig = shard.get("camera_on_rig", NOT_ON_RIGS)
        return Pairs(shard["counts"], face, shard["coverage"], on_rig)

    def rows_in(self, number: int) -> int:
        """Number of pairs in a shard; DamagedError unless it is whole, and of this matrix."""
        return int(self._shard(number, ("counts",))["counts"].sum())

    def _shard(self, number: int, names: Collection[str] = COLUMNS) -> dict[str, AnyArray]:
        """Some arrays of a verified shard."""
        name = self.store.name(number)
        data = whole(self.path, name)
        try:
            npz = read_npz(data, ("of", *names))
        except (ValueError, OSError, BadZipFile):
            raise DamagedError(self.path / name, "no shard") from None
        if npz["of"].tobytes() != self._words(number):
            raise DamagedError(
                self.path / name,
                "a shard of another matrix or of other poses",
            )
        return npz

    def _words(self, number: int | None) -> bytes:
        """Header of the matrix with the name of a shard."""
        own = {**self.header, "shard": "" if number is None else self.store.name(number)}
        return json.dumps(own, sort_keys=True).encode()

    def shard_bytes(self, number: int | None, pairs: AnyPairs, numbers: IntArray) -> memoryview:
        """File of a shard of the poses of these numbers; without a number it is of no use."""

        def of_all(values: AnyArray) -> AnyArray:
            """Values of all poses of the shard, 0 for those that are left out."""
            if number is None:
                return values
            rows = self.store.rows(number)
            whole = np.zeros((rows.stop - rows.start, *values.shape[1:]), values.dtype)
            whole[numbers - rows.start] = values
            return whole

        arrays = {
            "of": np.frombuffer(self._words(number), np.uint8),
            "counts": of_all(pairs.counts),
        }
        if isinstance(pairs, PackedPairs):
            return memoryview(npz_bytes(arrays | {"packed": of_all(pairs.packed)}))
        arrays |= {
            "face_step": np.diff(pairs.face, prepend=np.int32(0)),
            "coverage": pairs.coverage,
        }
        if self.is_of_rigs:
            arrays["camera_on_rig"] = pairs.on_rig
        return memoryview(npz_bytes(arrays, level=LEVEL))

    def fill(self, measure: Measure, staff: Staff, device: str = "") -> Self:
        """The folder with all shards; those that are missing have the pairs that are measured.

        Workers of this machine open the `device` of that label, if one is given.
        """
        sizes = dict[int, int]()

        def check(number: int) -> None:
            sizes[number] = self.rows_in(number)

        def make(number: int, did: Callable[[int], None]) -> memoryview:
            rows = self.store.rows(number)
            return self.shard_bytes(number, measure(rows, did), np.arange(rows.start, rows.stop))

        for number in fill(replace(self.store, device=device), make, check, staff):
            if number not in sizes:
                check(number)
        return replace(self, n_pairs=sum(sizes.values()))

    def rows_and_areas(self, least: float, n_faces: int) -> tuple[CoveredBits, FloatArray]:
        """Pairs with coverage of at least `least`, and (C,) total coverage of each pose.

        Derived at the first call, by threads that each take the next shard, into a mapped file.

        Raises
        ------
        ConfigError
            When a shard is damaged.
        ResourceError
            Where the disk has no room.
        """
        if least in self._derived:
            return self._derived[least]
        shards, shape = self.store, (self.n_poses, n_words(n_faces))
        total, lock = np.zeros(shape[0]), threading.Lock()
        with TemporaryFile(dir=self.path) as file:
            size = max(8, 8 * shape[0] * shape[1])  # nothing cannot be mapped
            try:  # so large that no write to it finds the disk full, where the system sees to that
                file.truncate(size)
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, size)
            except OSError as error:
                raise ResourceError(
                    f"{self.path}: expected room for {size:,} bytes, got an error "
                    f"({error.strerror}); free some disk space, or use fewer candidates"
                ) from None

            def work(part: slice) -> None:
                for number in range(part.start, part.stop):
                    rows = shards.rows(number)
                    bits, total[rows] = self.pairs_of(number).rows_and_areas(least, n_faces)
                    with lock:
                        file.seek(8 * shape[1] * rows.start)
                        file.write(bits.parts[0].data)

            threads = max(1, min(thread_count(None), MOST_THREADS, len(shards)))
            share_poses(len(shards), [work] * threads)
            file.flush()
            words = np.memmap(file, "<u8", "r", shape=(size // 8,))[: shape[0] * shape[1]]
        is_covered = CoveredBits.of(words.reshape(shape), n_faces), total
        self._derived[least] = is_covered
        return is_covered


@contextmanager
def _remade_by_build() -> Iterator[None]:
    """Name `build_matrix` in the error of a damaged file: it makes the file again."""
    try:
        yield
    except DamagedError as error:
        raise ConfigError(f"{error}; call build_matrix with the same inputs") from None


def claim(
    folder: Path,
    header: ByName,
    observer: Observer,
    poses: Poses,
    shard_size_given: bool,
    note: Note,
) -> MatrixFolder:
    """The folder with all inputs of a matrix; its shards keep their size unless one is given.

    Damaged inputs are written again, and `note` is called with a line on each.

    Raises
    ------
    ConfigError
        For a folder of other inputs, and one of other files.
    """
    try:
        kept = read_header(folder)
    except DamagedError:
        kept = None
    if kept is None:
        remove(folder, [f"{BOUNDS}/*.npz"])  # they may be of other inputs
    else:
        if not shard_size_given:
            header = header | {"poses_a_shard": kept["poses_a_shard"]}
        for name, words in WORDS.items():
            if kept.get(name) != header.get(name):
                raise ConfigError(_check_origin(folder, words))
    write_inputs(folder, header, observer.mesh, observer.camera, poses, note)
    return MatrixFolder(folder, header)


def _check_origin(folder: Path, words: str) -> str:
    return (
        f"{folder}: expected a matrix of the same inputs, got one made {words}; name another "
        "folder, or delete this one"
    )


def read_header(folder: Path) -> ByName | None:
    """Header of a folder, None where there is none.

    Raises
    ------
    DamagedError
        As for `contents`.
    ConfigError
        When it is of another format, and for other files of these names: every file of a matrix has
        a checksum.
    """
    if not (folder / SUMS).is_dir() and ((folder / HEADER).exists() or (folder / PAIRS).exists()):
        raise ConfigError(f"{folder}: expected a matrix, got other files; name another folder")
    data = contents(folder, HEADER)
    header: ByName | None = None if data is None else json.loads(data)
    if header is not None and header["format"] != FORMAT:
        raise ConfigError(_check_origin(folder, WORDS["format"]))
    return header


# --- workers ----------------------------------------------------------------------------------


def add_bounds(folder: MatrixFolder, bounds: CandidateBounds) -> None:
    """Add the bounds that workers left of all shards, unless some are missing or damaged."""
    items = []
    for path in sorted((folder.path / BOUNDS).glob("*.npz")):
        try:
            data = whole(folder.path, f"{BOUNDS}/{path.name}")
        except DamagedError:
            return
        items.append(read_npz(data))
    of_file = [np.zeros(0, np.int64), *(part["shards"] for part in items)]
    if sorted(np.concatenate(of_file).tolist()) != list(range(len(folder.store))):
        return  # a shard was made again, by another worker
    for part in items:
        np.maximum(bounds.low, part["low"], out=bounds.low)
        np.maximum(bounds.high, part["high"], out=bounds.high)
        bounds.covering += part["covering"]
        bounds.n_poses += int(part["n_poses"])


def make(folder: Path, number: int | None, chosen: IntArray) -> memoryview:
    """Content of a shard, as `rastercov.shards.ShardStore` wants it.

    The bounds of the poses of its shards so far are written in place of earlier ones.

    Raises
    ------
    ConfigError
        Where this process measures by another device than the header says.
    FolderLostError
        Where the files of the matrix are not there.
    """
    return _open_shards(folder)(number, chosen)


@open_once
def _open_shards(folder: Path, scene: Inputs) -> Callable[[int | None, IntArray], memoryview]:
    """Function `make` of a folder."""
    header, task = scene.header, Task(**scene.header["task"])
    with ExitStack() as opened:
        observer: Any = open_observer(scene.mesh, scene.cameras, _engine_of(header))
        opened.callback(observer.close)
        made_on = cells(scene.mesh, header["cells"]) if "cells" in header else None
        if made_on is not None:
            observer = region_observer(observer, made_on, task)
            opened.callback(observer.close)
        if info_of(observer) != header["measured_by"]:
            raise ConfigError(
                f"{folder}: expected a worker with {header['measured_by']['renderer']}, as the "
                f"run, got {observer.info.renderer}; use the same versions and devices"
            )
        opened.pop_all()
    mounts = None
    if entry := header.get("mounts"):
        starts, places = np.array(entry["starts"]), np.array(entry["places"])
        names = tuple(f"mount {index}" for index in range(len(starts) - 1))
        mounts = Mounts(names, with_places(scene.cameras, places), starts)

    matrix = MatrixFolder(folder, header)
    bounds = CandidateBounds(scene.mesh.n_faces, scene.mesh.task_mask)
    file = f"{platform.node()}-{os.getpid()}-{secrets.token_hex(4)}"
    bounded: list[int] = []

    def make_shard(number: int | None, chosen: IntArray) -> memoryview:
        placed, added = renumber(scene.poses[chosen]), None if number is None else bounds
        pairs: AnyPairs
        if "bits" in header:
            pairs = packed_pairs(observer, placed, task, added)
        else:
            pairs = pairs_of(observer, placed, task, made_on, added, mounts)
        data = matrix.shard_bytes(number, pairs, chosen)
        if number is not None:
            bounded.append(number)
            arrays = vars(bounds) | {"shards": np.array(bounded, np.int64)}
            store(folder, f"{BOUNDS}/{file}.npz", npz_bytes(arrays))
        return data

    return make_shard


def _engine_of(header: ByName) -> Engine:
    """Engine that a matrix is measured by, on one thread."""
    by = header["measured_by"]
    if by["backend"] == "analytic":
        return Engine(by["plan"], threads=1)
    return Engine("sampled", by["backend"], math.isqrt(header["samples"]), threads=1)
