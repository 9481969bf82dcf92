"""Shards of a visibility matrix made by a worker, from the folder of the matrix alone."""

import math
import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses, renumbered
from rastercov.camera.rig import Rig
from rastercov.cluster.files import contents
from rastercov.cluster.job import FolderLostError
from rastercov.cluster.scene_file import read_scene
from rastercov.coverage.area.cells import Cells, cells
from rastercov.coverage.engine import Engine
from rastercov.coverage.observer import open_observer
from rastercov.coverage.task import Task
from rastercov.placement.explain.candidate_visibility import CandidateBounds
from rastercov.placement.matrix_shards import (
    SCENE,
    Batch,
    batches_of,
    region_observer,
    write_bounds,
    write_shard,
)
from rastercov.placement.mounts import Mounts
from rastercov.placement.shards import read_header, read_poses, shards_of

OPEN = 2
"""Matrices that a worker keeps open: that of a plan, and that of its cavities."""


class _Open(NamedTuple):
    """Matrix that this process makes shards of."""

    header: dict[str, Any]
    poses: Poses
    observer: Any
    cells: Cells | None
    task: Task
    mounts: Mounts | None
    bounds: CandidateBounds
    bounded: list[int]
    file: str


def make(
    folder: Path, number: int, *, leave_out: Sequence[int] = (), only: Sequence[int] | None = None
) -> int:
    """Make a shard, as `rastercov.cluster.job` wants it; gives the number of its poses.

    Raises
    ------
    ConfigError
        Where this process measures by another device than the header says.
    FolderLostError
        Where the files of the matrix are not there.
    """
    opened = _opened(folder, _modified(folder))
    header = opened.header
    shard, rows = list(shards_of(len(opened.poses), header["poses_a_shard"]))[number]
    chosen = np.arange(rows.start, rows.stop)
    if only is not None:
        for _ in _batches(opened, chosen[list(only)]):
            pass
        return len(only)
    chosen = np.delete(chosen, list(leave_out))
    write_shard(folder, shard, header, _batches(opened, chosen, opened.bounds), chosen)
    opened.bounded.append(number)
    write_bounds(folder, opened.file, opened.bounds, opened.bounded)
    return int(rows.stop - rows.start)


def _batches(opened: _Open, chosen: Any, bounds: CandidateBounds | None = None) -> Iterator[Batch]:
    poses = renumbered(opened.poses[chosen])
    return batches_of(opened.observer, poses, opened.task, opened.cells, bounds, opened.mounts)


def _modified(folder: Path) -> int:
    try:
        return (folder / SCENE).stat().st_mtime_ns
    except OSError:
        raise FolderLostError(f"{folder}: {SCENE} is missing") from None


@lru_cache(OPEN)
def _opened(folder: Path, modified: int) -> _Open:
    """Matrix of a folder; its observer lives as long as this process, or until two others."""
    header, data = read_header(folder), contents(folder, SCENE)
    poses = None if header is None else read_poses(folder, header)
    if header is None or data is None or poses is None:
        raise FolderLostError(f"{folder}: files of the matrix are missing")
    scene = read_scene(data)
    task = Task(**header["task"])
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
    bounds = CandidateBounds(scene.mesh.n_faces, scene.mesh.task_mask)
    file = f"{os.uname().nodename}-{os.getpid()}-{secrets.token_hex(4)}"
    mounts = None
    if scene.more:
        starts, places = scene.more["starts"], scene.more["places"]
        names = tuple(f"mount {index}" for index in range(len(starts) - 1))
        mounts = Mounts(names, Rig(scene.cameras, None, places), starts)
    return _Open(header, poses, observer, made_on, task, mounts, bounds, [], file)


def _engine_of(header: dict[str, Any]) -> Engine:
    """Engine that a matrix is measured by, on one thread."""
    by = header["measured_by"]
    if by["backend"] == "analytic":
        return Engine(by["plan"], threads=1)
    return Engine("sampled", by["backend"], math.isqrt(header["samples"]), threads=1)
