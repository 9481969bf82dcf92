"""Content of the shards of a visibility matrix: pairs as they are measured, here or by workers."""

import io
import math
import os
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Rig
from rastercov.cluster.scene_file import read_scene, scene_bytes
from rastercov.cluster.store import DamagedError, contents, renew, store
from rastercov.cluster.work import FolderLostError
from rastercov.coverage.area.cells import Cells, cells
from rastercov.coverage.area.frames import check_same_mesh
from rastercov.coverage.area.regions import RegionObserver
from rastercov.coverage.coverage import Coverage, evaluate_batches, judged, measurements
from rastercov.coverage.engine import Engine
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.observer import ExactObserver, Observer, open_observer
from rastercov.coverage.task import Task
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.placement.explain.candidate_visibility import FIGURES, CandidateBounds
from rastercov.placement.matrix_folder import read_header, read_poses, schema_of, store_of
from rastercov.placement.mounts import Mounts

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
) -> Iterator[Batch]:
    """Pairs of some poses and faces, or cells, batch by batch; poses are those of mounts."""
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
        yield _pairs(batch)
        if bounds is not None and len(batch.pose_ids):
            bounds.add(batch)


def _pairs(batch: Coverage) -> Batch:
    """Pairs of a batch with coverage > 0."""
    pose, face = np.nonzero((batch.coverage > 0) & batch.mesh.task_mask)
    short, covered = shortened(batch.coverage[pose, face], batch.task.min_coverage)
    return pose, face.astype(np.int32), short, covered, NOT_ON_RIGS, len(batch.pose_ids)


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
    header, batches, bounds, bounded, file = _opened(folder, modified)
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
def _opened(folder: Path, modified: int) -> _Open:
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
