"""Work on one shard: make it, or find the poses of it that kill their process.

These are found by halving a shard, in processes of their own that the worker starts; the worker
itself lives on. A shard whose worker died by accident is made at the first attempt; otherwise the
poses that kill are found one by one, noted before the shard is written, and left out of it.
"""

import os
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pkgutil import resolve_name
from typing import NamedTuple

import numpy as np

import rastercov
from rastercov.base import ByName, ConfigError, RastercovError, plural, shown
from rastercov.shards.process import Process, ProcessEndedError
from rastercov.shards.store import ShardStore


class FolderLostError(OSError):
    """The folder of a store cannot be reached from a worker, now."""


class Made(NamedTuple):
    """Shard that was made, and its cost.

    Attributes
    ----------
    number, n_poses : int
        Shard, and its poses.
    worker : str
        Machine and process.
    seconds, cpu_seconds : float
        Wall clock, and time of the CPU.
    quarantined : dict of int to str
        Poses left out, by their number within the shard, and why.
    """

    number: int
    n_poses: int
    worker: str
    seconds: float
    cpu_seconds: float
    quarantined: dict[int, str] = {}  # noqa: RUF012 - never changed


def work(
    store: ShardStore, number: int, chosen: Sequence[int] | None = None, *, is_trial: bool = False
) -> Made:
    """Make a shard in this process, of all its poses or of some; a trial writes nothing.

    Raises
    ------
    ConfigError
        Where the worker has another version of rastercov.
    FolderLostError
        Where the folder cannot be reached.
    """
    worker, own = f"{platform.node()}:{os.getpid()}", rastercov.__version__
    if store.version != own:
        raise ConfigError(
            f"worker {worker}: expected rastercov {store.version} of this run, got {own}; update it"
        )
    if not store.folder.is_dir():
        raise FolderLostError(f"{store.folder}: expected the folder on worker {worker}, got none")
    every = np.arange(store.rows(number).start, store.rows(number).stop)
    poses = every if chosen is None else every[list(chosen)]
    began, cpu = time.perf_counter(), time.thread_time()
    data = resolve_name(store.function)(store.folder, None if is_trial else number, poses)
    if not is_trial:
        store.write(number, data)
    return Made(number, len(every), worker, time.perf_counter() - began, time.thread_time() - cpu)


def alone(store: ShardStore, number: int) -> Made:
    """Make a shard in a process of its own, without the poses that kill it."""
    made = _in_process(store, number)
    if isinstance(made, Made):
        return made
    poses = range(store.rows(number).stop - store.rows(number).start)
    guilty = dict(_guilty(store, number, poses, made))
    if guilty:
        store.note(number, guilty)
        made = _in_process(store, number, [pose for pose in poses if pose not in guilty])
    if not isinstance(made, Made):
        when = f"also without poses {shown(list(guilty))}" if guilty else "but not for one pose"
        raise RastercovError(
            f"shard {number}: expected a result, got a process that {made}, {when}; use fewer "
            "workers, so that each has more memory"
        )
    return made._replace(quarantined=guilty)


def _guilty(
    store: ShardStore, number: int, poses: Sequence[int], end: str
) -> list[tuple[int, str]]:
    """Poses of a part that kills its process, each with the end of the process."""
    if len(poses) == 1:
        return [(poses[0], end)]
    guilty = []
    for half in (poses[: len(poses) // 2], poses[len(poses) // 2 :]):
        outcome = _in_process(store, number, half, is_trial=True)
        if not isinstance(outcome, Made):
            guilty += _guilty(store, number, half, outcome)
    return guilty


def _in_process(
    store: ShardStore, number: int, chosen: Sequence[int] | None = None, *, is_trial: bool = False
) -> Made | str:
    """Cost of a shard in a process of its own, or words on how the process was killed.

    Raises
    ------
    RastercovError, FolderLostError
        For an error that the process reports.
    """
    with Process() as process:
        try:
            made: Made = process.call(partial(work, is_trial=is_trial), store, number, chosen)
        except ProcessEndedError as error:
            if not error.was_killed:
                raise RastercovError(
                    f"expected a result, got a worker process that {error}; run again"
                ) from None
            return str(error)
    return made


@dataclass
class Tally:
    """Shards, poses and time of each worker.

    Attributes
    ----------
    by_worker : dict of str to list
        Shards, poses, seconds and CPU seconds of each worker process.
    """

    by_worker: dict[str, list[float]] = field(default_factory=dict)

    def add(self, made: Made) -> None:
        """Count a shard."""
        sums = self.by_worker.setdefault(made.worker, [0, 0, 0.0, 0.0])
        for place, value in enumerate((1, made.n_poses, made.seconds, made.cpu_seconds)):
            sums[place] += value

    def to_json(self) -> ByName:
        """Sums by worker, ready for JSON; empty where no worker made a shard."""
        names = ("shards", "poses", "seconds", "cpu_seconds")
        return {
            worker: dict(zip(names, sums, strict=True))
            for worker, sums in sorted(self.by_worker.items())
        }

    def lines(self) -> list[str]:
        """A line for each worker, for people."""
        return [
            f"worker {worker}: {plural(int(shards), 'shard')}, {plural(int(poses), 'pose')}, "
            f"{seconds:.1f} s, CPU time {cpu:.1f} s "
            f"({1e3 * cpu / max(1, poses):.2f} ms per pose)"
            for worker, (shards, poses, seconds, cpu) in sorted(self.by_worker.items())
        ]
