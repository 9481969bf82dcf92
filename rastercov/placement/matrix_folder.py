"""Folder of a visibility matrix: header, poses, Parquet shards, checksums.

Two checks detect every change: each file has a checksum (`rastercov.cluster.store`), and each shard
holds the header of its matrix and its own name, so that a shard of another matrix, or of other
poses of the same matrix, is refused. Pages of shards also have the checksums of Parquet, for other
readers (`page_checksum_verification` of pyarrow); those exclude headers, statistics and footer.
"""

import io
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses
from rastercov.camera.rig import cameras_of
from rastercov.cluster import ShardStore
from rastercov.cluster.store import SUMS, DamagedError, Note, contents, store
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.observer import Observer
from rastercov.coverage.provenance import sha256
from rastercov.coverage.shards import inputs_of
from rastercov.coverage.task import Task
from rastercov.placement._arrays import IntArray
from rastercov.placement.mounts import Mounts

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq


FUNCTION = "rastercov.placement.matrix_shards:make"
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
