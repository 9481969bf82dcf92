"""The folder of a visibility matrix: its header, its shards, and whose turn it is to write.

Serves `matrix`. Nothing appears under its name before it is whole and on the disk.
"""

import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from rastercov.coverage import Task
from rastercov.errors import ConfigError
from rastercov.visibility import Observer

FloatArray = NDArray[np.float64]

PAIRS_A_SHARD = 1 << 22
"""Pose-face pairs, seen or not, that a shard stands for: several seconds of work."""
FORMAT = 1
SCHEMA = pa.schema(
    [
        pa.field("pose", pa.int32(), False),
        pa.field("face", pa.int32(), False),
        pa.field("coverage", pa.float32(), False),
        pa.field("covered", pa.bool_(), False),
    ]
)
WORDS = {
    "format": "in another file format",
    "rastercov": "by another version of rastercov",
    "mesh": "from another mesh",
    "camera": "for another camera",
    "poses": "from other poses",
    "task": "for another task",
    "measured_by": "by another method or device",
    "samples": "with another supersample",
    "poses_a_shard": "with another poses_a_shard",
}
"""What to say when an entry of the header is not what it was."""


def describe(
    observer: Observer, poses: FloatArray, task: Task, poses_a_shard: int | None
) -> dict[str, Any]:
    """What a matrix depends on, ready for JSON: its header."""
    mesh, camera = observer.mesh, observer.camera
    groups = json.dumps([asdict(group) for group in mesh.groups])
    if poses_a_shard is not None and (isinstance(poses_a_shard, bool) or poses_a_shard < 1):
        raise ConfigError(f"poses_a_shard must be 1 or more, got {poses_a_shard!r}")
    return {
        "format": FORMAT,
        "rastercov": version("rastercov"),
        "mesh": _sha256(mesh.vertices, mesh.faces, mesh.face_group, groups),
        "camera": _sha256(json.dumps(asdict(camera), sort_keys=True)),
        "poses": _sha256(poses),
        "task": asdict(task),
        "measured_by": asdict(observer.info),
        "samples": observer.observe(np.empty((0, 4, 4))).samples,
        "poses_a_shard": poses_a_shard or max(1, PAIRS_A_SHARD // mesh.n_faces),
        "n_poses": len(poses),
        "n_faces": mesh.n_faces,
        "n_task_faces": int(mesh.task_mask.sum()),
    }


def _sha256(*parts: NDArray[Any] | str) -> str:
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            total.update(part.encode())
        else:
            total.update(f"{part.dtype.str} {part.shape}".encode())
            total.update(np.ascontiguousarray(part).data)
    return total.hexdigest()


@contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """The folder, made when it is missing, for this process alone; a killed one leaves no lock."""
    try:
        (folder / "pairs").mkdir(parents=True, exist_ok=True)
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
        for left in (*folder.glob(".*.part"), *(folder / "pairs").glob(".*.part")):
            left.unlink()
        yield folder
    finally:
        os.close(descriptor)


def claim(
    folder: Path, header: dict[str, Any], poses: FloatArray, shard_size_given: bool
) -> dict[str, Any]:
    """The header of the folder: the one that is there, when it says the same, or this one."""
    kept = read_header(folder)
    if kept is None:
        if any((folder / "pairs").iterdir()):
            raise ConfigError(f"{folder}: shards without a header; name another folder")
        with whole(folder / "poses.npy") as file:
            np.save(file, poses)
        with whole(folder / "header.json") as file:
            file.write(json.dumps(header, indent=2).encode() + b"\n")
        return header
    for name, words in WORDS.items():
        if name == "poses_a_shard" and not shard_size_given:
            continue
        if kept.get(name) != header[name]:
            raise ConfigError(
                f"{folder}: the matrix in this folder was made {words}; "
                "name another folder, or delete this one to start again"
            )
    return kept


def read_header(folder: Path) -> dict[str, Any] | None:
    """The header of a folder, None where there is none; ConfigError where it cannot be read."""
    try:
        header: dict[str, Any] = json.loads((folder / "header.json").read_bytes())
        return {**header, "poses_a_shard": int(header["poses_a_shard"])}
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError, OSError):
        raise ConfigError(f"{folder}/header.json: this is no header of a matrix") from None


def shards_of(folder: Path, n_poses: int, poses_a_shard: int) -> Iterator[tuple[Path, slice]]:
    """File and poses of each shard, at least one."""
    starts = range(0, max(1, n_poses), poses_a_shard)
    digits = max(5, len(str(len(starts) - 1)))
    for number, start in enumerate(starts):
        rows = slice(start, min(start + poses_a_shard, n_poses))
        yield folder / "pairs" / f"pairs-{number:0{digits}d}.parquet", rows


def rows_of(shard: Path, header: dict[str, Any]) -> int | None:
    """Rows of a shard, None where it is missing, not whole, or of another matrix."""
    try:
        with shard.open("rb") as file:
            about = pq.ParquetFile(file)
            schema, n_rows = about.schema_arrow, int(about.metadata.num_rows)
    except (OSError, pa.ArrowException):
        return None
    if not schema.equals(SCHEMA) or not schema.metadata:
        return None
    return n_rows if json.loads(schema.metadata[b"rastercov"]) == header else None


@contextmanager
def whole(path: Path) -> Iterator[Any]:
    """File that appears under its name when the block ends well, and is on the disk by then."""
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)  # noqa: PTH105 - the atomic one by name
    finally:
        part.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name, too
    finally:
        os.close(folder)
