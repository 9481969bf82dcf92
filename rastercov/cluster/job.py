"""Job of many shards: a folder, and the function that makes a shard of it by number.

`function` is named as "module:function", so that a worker imports it by itself:

    function(folder: Path, number: int, *, leave_out: Sequence[int], only: Sequence[int] | None)

It writes the shard into the folder, without the poses `leave_out` (numbers within the shard), and
gives the number of its poses. With `only` it measures those poses and writes nothing.
"""

import os
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from rastercov.base.errors import ConfigError
from rastercov.kernels.stopwatch import Stopwatch


class FolderLostError(OSError):
    """The folder of a job cannot be reached from a worker, now."""


class Job(NamedTuple):
    """Folder and function of many shards.

    Attributes
    ----------
    folder : str
        Absolute path, the same for every worker.
    function : str
        As "module:function", see `rastercov.cluster.job`.
    version : str
        Version of rastercov that the shards are made with.
    """

    folder: str
    function: str
    version: str

    @classmethod
    def of(cls, folder: Path, function: str) -> "Job":
        """Job of this version of rastercov."""
        return cls(str(folder.resolve()), function, version("rastercov"))


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
    job: Job, number: int, leave_out: Sequence[int] = (), only: Sequence[int] | None = None
) -> Made:
    """Make a shard in this process.

    Raises
    ------
    ConfigError
        Where the worker has another version of rastercov.
    FolderLostError
        Where the folder cannot be reached.
    """
    if job.version != version("rastercov"):
        raise ConfigError(
            f"worker {_name()} has rastercov {version('rastercov')}, and the run {job.version}; "
            "install the same on both"
        )
    folder = Path(job.folder)
    if not folder.is_dir():
        raise FolderLostError(f"{folder}: no such folder on worker {_name()}")
    clock, cpu, compiled = Stopwatch(), time.thread_time(), Stopwatch.left_out
    n_poses = _function(job.function)(folder, number, leave_out=leave_out, only=only)
    cpu, compiled = time.thread_time() - cpu, Stopwatch.left_out - compiled
    return Made(number, n_poses, _name(), clock.seconds, cpu, compiled_s=compiled)


@cache
def _function(name: str) -> Callable[..., int]:
    module, _, attribute = name.partition(":")
    found: Callable[..., int] = getattr(import_module(module), attribute)
    return found


def _name() -> str:
    return f"{os.uname().nodename}:{os.getpid()}"
