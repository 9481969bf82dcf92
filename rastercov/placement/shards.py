"""On-disk layout of a visibility matrix: header, poses, Parquet shards, checksums, writer lock.

Serves `matrix`. A file appears under its name only when it is complete and on the disk. Two checks
detect every change:

- each file has its SHA-256 in `sha256/`, in the format of `sha256sum -c`. It is computed from the
  bytes that are then decoded, so that no decoder reads damaged ones;
- each shard holds the header of its matrix and its own name, so that a shard of another matrix, or
  of other poses of the same matrix, is refused.

The checksum is written before its file: a run killed between the two leaves a missing file, or one
that is made again. Pages of shards also have the checksums of Parquet, for other readers
(`page_checksum_verification` of pyarrow); those exclude headers, statistics and footer.
"""

import fcntl
import hashlib
import io
import json
import logging
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rastercov.area.cells import Cells
from rastercov.errors import ConfigError
from rastercov.observer import Observer
from rastercov.placement._arrays import FloatArray
from rastercov.placement.mounts import Mounts
from rastercov.pose import Poses
from rastercov.provenance import sha256
from rastercov.rig import cameras_of
from rastercov.task import Task

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq


PAIRS_A_SHARD = 1 << 22
"""Pose-face pairs, seen or not, of one shard: several seconds of work."""
FORMAT = 2
HEADER, POSES = "header.json", "poses.npy"
PAIRS, SUMS = "pairs", "sha256"
"""Folders of the shards, and of the checksums of all files."""
WORDS = {
    "format": "in another file format",
    "rastercov": "by another version of rastercov",
    "mesh": "from another mesh",
    "cells": "for faces, or for cells of another size",
    "camera": "for another camera",
    "poses": "from other poses",
    "pose_camera": "for other cameras of the poses",
    "mounts": "for other rigs",
    "task": "for another task",
    "measured_by": "by another method or device",
    "samples": "with another supersample",
    "poses_a_shard": "with another poses_a_shard",
}
"""Words on a header that differs in an entry."""
Note = Callable[[str], None]


class DamagedError(ConfigError):
    """A file of a matrix has changed since it was written; the message names file and reason."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: damaged, {why}")


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
    plain = [json.dumps(camera.plain(), sort_keys=True) for camera in cameras]
    groups = json.dumps([group.plain() for group in mesh.groups])
    if poses_a_shard is not None and (isinstance(poses_a_shard, bool) or poses_a_shard < 1):
        raise ConfigError(f"poses_a_shard must be 1 or more, got {poses_a_shard!r}")
    n_faces = mesh.n_faces if cells is None else len(cells)
    header = {
        "format": FORMAT,
        "rastercov": version("rastercov"),
        "mesh": sha256(mesh.vertices, mesh.faces, mesh.face_group, groups),
        "camera": sha256(*plain),
        "poses": sha256(poses.world_from_camera),
        "task": asdict(task),
        "measured_by": asdict(observer.info),
        "samples": observer.observe(np.empty((0, 4, 4))).samples_per_pixel,
        "poses_a_shard": poses_a_shard or max(1, PAIRS_A_SHARD // max(1, n_faces)),
        "n_poses": len(poses),
        "n_faces": n_faces,
        "n_task_faces": int(mesh.task_mask.sum()) if cells is None else n_faces,
    }
    if max(n_mounts, len(cameras)) > 1:
        header["pose_camera"] = poses.camera.tolist()
    if mounts is not None and mounts.has_rigs:
        header["mounts"] = sha256(mounts.starts, mounts.rig.rig_from_camera)
    return header if cells is None else header | {"cells": cells.size}


@contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Lock the folder for this process, and make it when it is missing; a kill leaves no lock."""
    parts = (folder, folder / PAIRS, folder / SUMS)
    try:
        for part in parts:
            part.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise ConfigError(f"{folder}: the folder cannot be made ({error.strerror})") from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(
                f"{folder}: another process is writing to this folder; wait or name another"
            ) from None
        except OSError:
            pass  # a file system without locks
        for part in parts:
            for left in part.glob(".*.part"):
                left.unlink()
        yield folder
    finally:
        os.close(descriptor)


def claim(
    folder: Path,
    header: dict[str, Any],
    poses: FloatArray,
    shard_size_given: bool,
    note: Note,
) -> dict[str, Any]:
    """Header of the folder: the present one where it agrees with `header`, or `header`.

    A damaged or missing header is restored from an undamaged shard, and the poses from `poses`;
    `note` is called with a line on each. Shards beyond the last one are removed.
    """
    kept = None
    try:
        kept = read_header(folder)
    except DamagedError as error:
        note(f"{error}; made again")
    is_missing = kept is None
    if kept is None:
        found = sorted((folder / PAIRS).iterdir())
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
    try:
        is_missing = read_poses(folder, kept) is None
    except DamagedError as error:
        note(f"{error}; made again")
        is_missing = True
    if is_missing:
        file = io.BytesIO()
        np.save(file, poses)
        store(folder, POSES, file.getvalue())
    shards = {folder / name for name, _ in shards_of(len(poses), kept["poses_a_shard"])}
    for stray in sorted(set((folder / PAIRS).glob("pairs-*.parquet")) - shards):
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
    path = folder / HEADER
    try:
        data = contents(folder, HEADER)
        if data is None:
            return None
    except DamagedError:
        # Without any checksum the folder is of another format, or has lost all of them.
        if _has_sums(folder) or _loaded(path)["format"] == FORMAT:
            raise
    header = _loaded(path)
    if header["format"] != FORMAT:
        raise ConfigError(_made(folder, WORDS["format"]))
    return header


def _loaded(path: Path) -> dict[str, Any]:
    try:
        header: dict[str, Any] = json.loads(path.read_bytes())
        return {**header, "format": header["format"], "poses_a_shard": int(header["poses_a_shard"])}
    except (ValueError, KeyError, TypeError, RecursionError, OSError):
        raise ConfigError(f"{path}: this is no header of a matrix; name another folder") from None


def _has_sums(folder: Path) -> bool:
    """True when a file of a folder has a checksum, as every file of this format has."""
    return any((folder / SUMS).glob("*.sha256"))


def read_poses(folder: Path, header: dict[str, Any]) -> FloatArray | None:
    """(C, 4, 4) poses of a matrix, None where the file is missing.

    Raises
    ------
    DamagedError
        As for `contents`, and for poses of another matrix.
    """
    data = contents(folder, POSES)
    if data is None:
        return None
    try:
        poses: FloatArray = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError):
        raise DamagedError(folder / POSES, "this is no array") from None
    if sha256(poses) != header["poses"]:
        raise DamagedError(folder / POSES, "these are poses of another matrix")
    return poses


def shards_of(n_poses: int, poses_a_shard: int) -> Iterator[tuple[str, slice]]:
    """Name in the folder and poses of each shard, at least one."""
    starts = range(0, max(1, n_poses), poses_a_shard)
    digits = max(5, len(str(len(starts) - 1)))
    for number, start in enumerate(starts):
        rows = slice(start, min(start + poses_a_shard, n_poses))
        yield f"{PAIRS}/pairs-{number:0{digits}d}.parquet", rows


@cache
def pair_schema() -> "pa.Schema":
    """Columns of a shard, one row a pose-face pair; loads pyarrow, which takes 0.15 s."""
    import pyarrow as pa

    types = {
        "pose": pa.int32(),
        "face": pa.int32(),
        "coverage": pa.float32(),
        "covered": pa.bool_(),
    }
    return pa.schema([pa.field(name, kind, False) for name, kind in types.items()])


def schema_of(shard: str, header: dict[str, Any]) -> "pa.Schema":
    """Schema of a shard; its metadata name the shard and hold the header of its matrix."""
    return pair_schema().with_metadata({"rastercov": json.dumps({**header, "shard": shard})})


def open_shard(folder: Path, shard: str, header: dict[str, Any]) -> "pq.ParquetFile | None":
    """A verified shard, None where it is missing.

    Raises
    ------
    DamagedError
        As for `contents`, and for a shard of another matrix or of other poses of this one.
    """
    found = _opened(folder, shard)
    if found is not None and _written_with(found) != {**header, "shard": shard}:
        raise DamagedError(
            folder / shard, "this is a shard of another matrix, or of other poses of this one"
        )
    return found


def _opened(folder: Path, shard: str) -> "pq.ParquetFile | None":
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = contents(folder, shard)
    if data is None:
        return None
    try:
        return pq.ParquetFile(pa.BufferReader(data))
    except (pa.ArrowException, OSError):
        raise DamagedError(folder / shard, "this is no Parquet file") from None


def _written_with(shard: "pq.ParquetFile") -> dict[str, Any]:
    """Metadata that `schema_of` put into a shard; empty for a table of other columns."""
    schema = shard.schema_arrow
    if not schema.equals(pair_schema()) or not schema.metadata:
        return {}
    entries: dict[str, Any] = json.loads(schema.metadata.get(b"rastercov", b"{}"))
    return entries


def _header_in(folder: Path, name: str) -> dict[str, Any] | None:
    """Header of the matrix from an undamaged shard, None for any other file."""
    try:
        found = _opened(folder, f"{PAIRS}/{name}")
    except DamagedError:
        return None
    header = _written_with(found) if found else {}
    return header if header.pop("shard", None) == f"{PAIRS}/{name}" else None


def contents(folder: Path, name: str) -> bytes | None:
    """Bytes of a file of a matrix, None where it is missing.

    Raises
    ------
    DamagedError
        When they cannot be read, or do not match the checksum.
    """
    try:
        data = (folder / name).read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DamagedError(folder / name, f"it cannot be read ({error.strerror})") from None
    try:
        is_whole = _sum_file(folder, name).read_bytes() == _sum_line(name, data)
    except OSError:
        raise DamagedError(folder / name, "its checksum is missing") from None
    if not is_whole:
        raise DamagedError(folder / name, "its checksum is not the one recorded")
    return data


def store(folder: Path, name: str, data: bytes | memoryview) -> None:
    """Write a file of a matrix, and its checksum before it."""
    _write(_sum_file(folder, name), _sum_line(name, data))
    _write(folder / name, data)


def _sum_file(folder: Path, name: str) -> Path:
    return folder / SUMS / f"{Path(name).name}.sha256"


def _sum_line(name: str, data: bytes | memoryview) -> bytes:
    """Line of `sha256sum` for a file, relative to the folder of the matrix."""
    return f"{hashlib.sha256(data).hexdigest()}  {name}\n".encode()


def _write(path: Path, data: bytes | memoryview) -> None:
    """Write a file atomically: it appears under its name when it is complete and on the disk."""
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)  # noqa: PTH105 - the atomic one by name
    finally:
        part.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # makes the new name durable
    finally:
        os.close(folder)
