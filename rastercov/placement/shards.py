"""On-disk layout of a visibility matrix: header, poses, Parquet shards, checksums, writer lock.

Serves `matrix`. Two checks detect every change: each file has a checksum
(`rastercov.cluster.files`), and each shard holds the header of its matrix and its own name, so that
a shard of another matrix, or of other poses of the same matrix, is refused. Pages of shards also
have the checksums of Parquet, for other readers (`page_checksum_verification` of pyarrow); those
exclude headers, statistics and footer.
"""

import fcntl
import io
import json
import logging
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses
from rastercov.camera.rig import cameras_of
from rastercov.cluster.files import SUMS, DamagedError, contents, has_sums, store
from rastercov.coverage.area.cells import Cells
from rastercov.coverage.observer import Observer
from rastercov.coverage.provenance import sha256
from rastercov.coverage.task import Task
from rastercov.placement.mounts import Mounts

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq


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
Note = Callable[[str], None]


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
    plain = [json.dumps(camera.to_json(), sort_keys=True) for camera in cameras]
    groups = json.dumps([group.to_json() for group in mesh.groups])
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
        header["pose_camera"] = sha256(poses.camera)
    if mounts is not None and mounts.has_rigs:
        header["mounts"] = sha256(mounts.starts, mounts.rig.rig_from_camera)
        header["pairs"] = "of the cameras of rigs"
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
        for part in (*parts, folder / BITS):
            for left in part.glob(".*.part"):
                left.unlink()
        yield folder
    finally:
        os.close(descriptor)


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
    kept = None
    try:
        kept = read_header(folder)
    except DamagedError as error:
        note(f"{error}; made again")
    is_missing = kept is None
    if kept is None:
        found = sorted((folder / PAIRS).iterdir())
        if found and not has_sums(folder):
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
        for name, array in _arrays_of(poses, kept):
            file = io.BytesIO()
            np.save(file, array)
            store(folder, name, file.getvalue())
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
        if has_sums(folder) or _loaded(path)["format"] == FORMAT:
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


def read_poses(folder: Path, header: dict[str, Any]) -> Poses | None:
    """Poses of a matrix, each with its camera, None where a file is missing.

    Raises
    ------
    DamagedError
        As for `contents`, and for poses of another matrix.
    """
    arrays = []
    for name, key in _files_of_poses(header):
        data = contents(folder, name)
        if data is None:
            return None
        try:
            arrays.append(np.load(io.BytesIO(data), allow_pickle=False))
        except (ValueError, EOFError):
            raise DamagedError(folder / name, "this is no array") from None
        if sha256(arrays[-1]) != header[key]:
            raise DamagedError(
                folder / name, f"these are {key} of another matrix".replace("_", " ")
            )
    return Poses.of(arrays[0], camera=arrays[1] if arrays[1:] else None)


def _files_of_poses(header: dict[str, Any]) -> list[tuple[str, str]]:
    """Name of each file of poses, and the entry of the header with its hash."""
    files = [(POSES, "poses"), (CAMERAS, "pose_camera")]
    return files if "pose_camera" in header else files[:1]


def _arrays_of(poses: Poses, header: dict[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and array of each file of poses."""
    arrays: tuple[NDArray[Any], ...] = (poses.world_from_camera, poses.camera)
    for (name, _), array in zip(_files_of_poses(header), arrays, strict=False):
        yield name, array


def shards_of(n_poses: int, poses_a_shard: int) -> Iterator[tuple[str, slice]]:
    """Name in the folder and poses of each shard, at least one."""
    starts = range(0, max(1, n_poses), poses_a_shard)
    digits = max(5, len(str(len(starts) - 1)))
    for number, start in enumerate(starts):
        rows = slice(start, min(start + poses_a_shard, n_poses))
        yield f"{PAIRS}/pairs-{number:0{digits}d}.parquet", rows


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
    if not schema.metadata:
        return {}
    entries: dict[str, Any] = json.loads(schema.metadata.get(b"rastercov", b"{}"))
    return entries if schema.equals(pair_schema("pairs" in entries)) else {}


def _header_in(folder: Path, name: str) -> dict[str, Any] | None:
    """Header of the matrix from an undamaged shard, None for any other file."""
    try:
        found = _opened(folder, f"{PAIRS}/{name}")
    except DamagedError:
        return None
    header = _written_with(found) if found else {}
    return header if header.pop("shard", None) == f"{PAIRS}/{name}" else None
