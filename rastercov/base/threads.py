"""Threads, processes, and objects that must be closed.

Many poses in several threads: compiled loops hold no lock, so they run side by side. A value that
threads share is `Once`.
"""

import os
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import update_wrapper
from pathlib import Path
from typing import Concatenate, Generic, NoReturn, ParamSpec, Self, TypeVar
from weakref import WeakKeyDictionary

from rastercov.base.arguments import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.typed import guard_class
from rastercov.engine import base_interrupt

POSES_A_TURN = 16
"""Most poses a thread takes at a time: enough to stay in the loops."""
MOST_THREADS = 1024
"""Threads that may be asked for: each takes memory of its own."""


THREADS = "RASTERCOV_THREADS"
"""Variable of the environment with the number of threads, where none is asked for."""


def thread_count(threads: int | None) -> int:
    """Threads to use: those asked for, else of `THREADS`, or one for each core.

    ConfigError for no whole number.
    """
    if threads is None and (given := os.environ.get(THREADS, "")).isdecimal():
        threads = int(given)
    if threads is None:
        if hasattr(os, "sched_getaffinity"):  # of the system's scheduler, on Linux
            return len(os.sched_getaffinity(0))
        return os.cpu_count() or 1
    number = finite_number(threads)
    if not number.is_integer() or not 1 <= number <= MOST_THREADS:
        raise ConfigError(
            f"expected threads to be a whole number from 1 to {MOST_THREADS}, got "
            f"{shown(threads)}; pass None for one per core"
        )
    return int(number)


def share_poses(n_poses: int, workers: Sequence[Callable[[slice], None]]) -> None:
    """Call the workers side by side with slices that together cover the poses.

    The first works in the thread of the caller, the others each in one of its own, as far as the
    system gives threads. What one of them raises first is raised, and ends all; so does an
    interrupt. Loops in C++ of the others end at their next look, all else after a turn.
    """
    turns = []
    start = 0
    shares = 2 * len(workers) if len(workers) > 1 else 1
    while start < n_poses:  # smaller ones at the end, so that all end together
        step = max(1, min(POSES_A_TURN, (n_poses - start) // shares))
        turns.append(slice(start, start + step))
        start += step
    if len(turns) == 1:
        workers[0](turns[0])
        return
    turns.reverse()  # taken from the end
    raised: list[BaseException] = []
    # A pool would start all threads anew as well, and takes twice as long to do so.
    threads: list[threading.Thread] = []
    stop = base_interrupt.Stop()

    def work(worker: Callable[[slice], None]) -> None:
        stop.enter()
        try:
            while turns:
                try:
                    turn = turns.pop()
                except IndexError:  # another thread took the last one
                    return
                worker(turn)
        except BaseException as error:
            raised.append(error)
            stop.set()
            turns.clear()  # then all stop
        finally:
            stop.leave()

    try:
        threads.extend(threading.Thread(target=work, args=(worker,)) for worker in workers[1:])
        with suppress(RuntimeError):  # the system gives no more threads, or Python is about to end:
            for thread in threads:  # those that run share all turns
                thread.start()
        work(workers[0])
        _join(threads)
    except BaseException:  # an interrupt comes here
        stop.set()
        raise
    finally:
        turns.clear()
        _join(threads)
    if raised:
        raise raised[0]


def _join(threads: Iterable[threading.Thread]) -> None:
    for thread in threads:
        if thread.ident is not None:  # it was started
            thread.join()


T = TypeVar("T")


class Once(Generic[T]):
    """One value, made at most once in a process; any thread may ask for it at any time.

    The first that asks works it out, the others wait for it. `functools.cached_property` has no
    lock, so threads that ask at the same time each compute the value for themselves. That is right
    for what is frozen and quickly made; `Once` is for what takes seconds, takes much memory, or
    must not happen twice.
    """

    def __init__(self) -> None:
        self._made: list[T] = []
        # One lock for each process: in a forked child the lock of its parent may be held by a
        # thread that the child does not have. A thread may take its own lock again, as a signal
        # handler does that asks for the value while the thread is making it.
        self._locks: dict[int, threading.RLock] = {}

    def get(self, make: Callable[[], T]) -> T:
        """Give the value, from `make` where no call has returned it yet.

        What `make` raises is raised in this thread only; the next one that asks calls its own.
        """
        if not self._made:
            with self._locks.setdefault(os.getpid(), threading.RLock()):
                if not self._made:
                    self._made.append(make())
        return self._made[0]


Key = TypeVar("Key")
Further = ParamSpec("Further")


def once_each(
    make: Callable[Concatenate[Key, Further], T],
) -> Callable[Concatenate[Key, Further], T]:
    """Function of an object that is called `Once` for each, and kept as long as the object exists.

    The value must not hold the object.
    """
    kept: WeakKeyDictionary[Key, Once[T]] = WeakKeyDictionary()

    def value(key: Key, /, *others: Further.args, **named: Further.kwargs) -> T:
        once = kept.get(key) or kept.setdefault(key, Once())
        return once.get(lambda: make(key, *others, **named))

    update_wrapper(value, make)
    return value


DEVICE = "RASTERCOV_DEVICE"
"""Variable of the environment of a worker with the device of its run, "" for any."""


def child_environment() -> dict[str, str]:
    """Environment of a process that finds the modules of this one, and none in the working folder.

    Python itself would put the working folder first for `-c` and `-m`, and takes an empty entry of
    PYTHONPATH for it. It stays only where this package lies in it.
    """
    return os.environ | {"PYTHONPATH": os.pathsep.join(_paths()), "PYTHONSAFEPATH": "1"}


def _paths() -> list[str]:
    """Entries of the path of this process, without the working folder."""
    here, root = None, Path(__file__).resolve().parents[2]
    with suppress(OSError):  # it was removed
        here = Path.cwd()
    paths = [Path(here or "", entry) for entry in sys.path]
    return [
        str(path)
        for path in paths
        if path.is_absolute() and (path.resolve() == root or path.resolve() != here)
    ]


class Unique:
    """Base of objects that cannot be copied: they hold a device, threads or scratch memory.

    A copy would give back what the first still uses, and a pickle would reach a process that has
    none of it, so `copy`, `deepcopy` and `pickle` raise `ConfigError`.
    """

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        name = type(self).__name__.lstrip("_")
        raise ConfigError(
            f"expected a {name} to stay in its process, got a copy or pickle of it; open another "
            "one there"
        )


class Closing(Unique, ABC):
    """Closed at the end of a `with` block, whatever ends it."""

    def __init_subclass__(cls) -> None:
        guard_class(cls)  # callers have its instances for an Observer or a Rasterizer

    @abstractmethod
    def close(self) -> None:
        """Give back what it holds; again it does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
