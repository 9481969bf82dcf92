"""Work on one shard: make it, or find the poses of it that kill their process.

These are found by halving a shard, in processes of their own that the worker starts; the worker
itself lives on. A shard whose worker died by accident is made at the first attempt; otherwise the
poses that kill are found one by one, noted before the shard is written, and left out of it.
"""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

from rastercov.base.errors import ConfigError, RastercovError
from rastercov.base.format import plural
from rastercov.cluster.process import Process, ProcessEndedError
from rastercov.cluster.store import ShardStore
from rastercov.kernels.stopwatch import Stopwatch


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
        Wall clock without compilation, and time of the CPU.
    quarantined : dict of int to str
        Poses left out, by their number within the shard, and why.
    compiled_s : float
        Seconds of compilation.
    """

    number: int
    n_poses: int
    worker: str
    seconds: float
    cpu_seconds: float
    quarantined: dict[int, str] = {}  # noqa: RUF012 - never changed
    compiled_s: float = 0.0


def work(
    store: ShardStore,
    number: int,
    leave_out: Sequence[int] = (),
    only: Sequence[int] | None = None,
) -> Made:
    """Make a shard in this process, without some of its poses; with `only` some are tried out.

    Raises
    ------
    ConfigError
        Where the worker has another version of rastercov.
    FolderLostError
        Where the folder cannot be reached.
    """
    worker, own = f"{os.uname().nodename}:{os.getpid()}", version("rastercov")
    if store.version != own:
        raise ConfigError(
            f"worker {worker} has rastercov {own}, and the run {store.version}; "
            "install the same on both"
        )
    if not store.folder.is_dir():
        raise FolderLostError(f"{store.folder}: no such folder on worker {worker}")
    poses = np.arange(store.rows(number).start, store.rows(number).stop)
    n_poses = len(poses)
    poses = np.delete(poses, list(leave_out)) if only is None else poses[list(only)]
    clock, cpu, compiled = Stopwatch(), time.thread_time(), Stopwatch.left_out
    data = _function(store.function)(store.folder, number if only is None else None, poses)
    if only is None:
        store.write(number, data)
    cpu, compiled = time.thread_time() - cpu, Stopwatch.left_out - compiled
    return Made(number, n_poses, worker, clock.seconds, cpu, compiled_s=compiled)


@cache
def _function(name: str) -> Callable[..., bytes]:
    module, _, attribute = name.partition(":")
    found: Callable[..., bytes] = getattr(import_module(module), attribute)
    return found


def alone(store: ShardStore, number: int) -> Made:
    """Make a shard in a process of its own, without the poses that kill it."""
    made = _in_process(store, number)
    if isinstance(made, Made):
        return made
    rows = store.rows(number)
    guilty = dict(_guilty(store, number, range(rows.stop - rows.start), made))
    if guilty:
        store.note(number, guilty)
        made = _in_process(store, number, leave_out=list(guilty))
    if not isinstance(made, Made):
        raise RastercovError(
            f"shard {number}: its process {made}, also without poses {guilty} that kill it; "
            "run again with fewer workers, so that each has more memory"
        )
    return made._replace(quarantined=guilty)


def _guilty(
    store: ShardStore, number: int, poses: Sequence[int], end: str
) -> list[tuple[int, str]]:
    """Poses of a part that kills its process, each with the end of the process."""
    if len(poses) == 1:
        return [(poses[0], end)]
    found = []
    for half in (poses[: len(poses) // 2], poses[len(poses) // 2 :]):
        outcome = _in_process(store, number, only=list(half))
        if not isinstance(outcome, Made):
            found += _guilty(store, number, half, outcome)
    return found


def _in_process(
    store: ShardStore,
    number: int,
    leave_out: Sequence[int] = (),
    only: Sequence[int] | None = None,
) -> Made | str:
    """Cost of a shard in a process of its own, or words on how the process was killed.

    Raises
    ------
    RastercovError, FolderLostError
        For an error that the process reports.
    """
    with Process() as process:
        try:
            made: Made = process.call(work, store, number, leave_out, only)
        except ProcessEndedError as error:
            if not error.was_killed:
                raise RastercovError(f"a worker failed: its process {error}") from None
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

    def to_json(self) -> dict[str, Any]:
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
            f"{seconds:.1f} s, of these {cpu:.1f} s on the CPU "
            f"({1e3 * cpu / max(1, poses):.2f} ms a pose)"
            for worker, (shards, poses, seconds, cpu) in sorted(self.by_worker.items())
        ]
