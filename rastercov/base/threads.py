"""Many poses in several threads: compiled loops hold no lock, so they run side by side.

An object that measures poses may itself be used from several threads at once. So what its loops
work in belongs to a call, not to the object: a call takes it from a `ScratchPool`.
"""

import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Generic, TypeVar

from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError

Scratch = TypeVar("Scratch")

POSES_A_TURN = 16
"""Most poses a thread takes at a time: enough to stay in the loops."""
MOST_THREADS = 1024
"""Threads that may be asked for: each takes memory of its own."""


def thread_count(threads: int | None) -> int:
    """Threads to use: those asked for, or one for each core; ConfigError for no whole number."""
    if threads is None:
        return len(os.sched_getaffinity(0))
    number = finite_number(threads)
    if not number.is_integer() or not 1 <= number <= MOST_THREADS:
        raise ConfigError(
            f"threads must be 1 or more, got {shown(threads)}; pass a whole number up to "
            f"{MOST_THREADS}, or None for one a core"
        )
    return int(number)


def share_poses(n_poses: int, workers: Sequence[Callable[[slice], None]]) -> None:
    """Call the workers side by side with slices that together cover the poses.

    The first works in the thread of the caller, the others each in one of its own, as far as the
    system gives threads. What one of them raises is raised, and ends all; so does an interrupt,
    after their turn.
    """
    turns = []
    start = 0
    shares = 2 * len(workers) if len(workers) > 1 else 1
    while start < n_poses:  # smaller ones at the end, so that all end together
        step = max(1, min(POSES_A_TURN, (n_poses - start) // shares))
        turns.append(slice(start, start + step))
        start += step
    turns.reverse()  # taken from the end
    raised: list[BaseException] = []

    def work(worker: Callable[[slice], None]) -> None:
        try:
            while turns:
                try:
                    turn = turns.pop()
                except IndexError:  # another thread took the last one
                    return
                worker(turn)
        except BaseException as error:
            raised.append(error)
        finally:
            turns.clear()  # empty already, unless something went wrong: then all stop

    # A pool would start all threads anew as well, and takes twice as long to do so.
    threads = [threading.Thread(target=work, args=(worker,)) for worker in workers[1:]]
    try:
        try:
            for thread in threads:
                thread.start()
        except RuntimeError:  # the system gives no more threads, or Python is about to end
            pass  # those that run share all turns
        work(workers[0])
    finally:
        turns.clear()  # an interrupt comes here
        for thread in threads:
            if thread.ident is not None:
                thread.join()
    if raised:
        raise raised[0]


class ScratchPool(Generic[Scratch]):
    """Scratch memory of one object for calls from any number of threads.

    Each call takes what it works in, so that no two calls ever write to the same memory, and gives
    it back for later calls when it has ended well. What an error or an interrupt has left half
    changed, as arrays of which one has grown and another has not, is never used again.

    There is no lock: single operations of a deque are atomic. So neither a fork nor a handler of a
    signal can find the pool locked.

    Parameters
    ----------
    make : callable
        Gives new scratch memory. It must not hold the object that owns the pool, which would then
        outlive its last use.
    most_idle : int
        Scratch memory kept between calls; more is dropped, so that memory does not grow with the
        number of threads that have ever called.
    """

    def __init__(self, make: Callable[[], Scratch], most_idle: int) -> None:
        self._make = make
        self._idle: deque[Scratch] = deque(maxlen=min(most_idle, sys.maxsize))
        self._is_open = True

    def take(self, n: int) -> list[Scratch]:
        """Scratch memory for `n` workers that nothing else uses, idle or new."""
        return [self._take_one() for _ in range(n)]

    def give_back(self, scratch: Iterable[Scratch]) -> None:
        """Keep what a call that ended well has taken; a closed pool keeps nothing."""
        self._idle.extend(scratch)
        if not self._is_open:
            self._idle.clear()

    def close(self) -> None:
        """Drop what is idle, and what calls give back from now on."""
        self._is_open = False
        self._idle.clear()

    def _take_one(self) -> Scratch:
        try:
            return self._idle.pop()
        except IndexError:
            return self._make()
