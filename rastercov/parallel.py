"""Many poses in several threads: compiled loops hold no lock, so they run side by side."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from rastercov.errors import ConfigError

POSES_A_TURN = 16
"""Most poses a thread takes at a time: enough to stay in the loops."""


def thread_count(threads: int | None) -> int:
    """Threads to use: those asked for, or one for each core; ConfigError for less than 1."""
    if threads is not None and (isinstance(threads, bool) or threads < 1):
        raise ConfigError(f"threads must be 1 or more, got {threads!r}")
    return threads or len(os.sched_getaffinity(0))


def share_poses(n_poses: int, workers: Sequence[Callable[[slice], None]]) -> None:
    """Call the workers, each in a thread of its own, with slices that together cover the poses.

    What one of them raises is raised, and ends all; so does an interrupt, after their turn.
    """
    turns = []
    start = 0
    while start < n_poses:  # smaller ones at the end, so that all end together
        step = max(1, min(POSES_A_TURN, (n_poses - start) // (2 * len(workers))))
        turns.append(slice(start, start + step))
        start += step
    turns.reverse()  # taken from the end

    def work(worker: Callable[[slice], None]) -> None:
        try:
            while turns:
                try:
                    turn = turns.pop()
                except IndexError:  # another thread took the last one
                    return
                worker(turn)
        finally:
            turns.clear()  # empty already, unless something went wrong: then all stop

    if len(workers) == 1:
        work(workers[0])
        return
    with ThreadPoolExecutor(len(workers)) as pool:
        try:
            list(pool.map(work, workers))
        finally:
            turns.clear()  # an interrupt comes here
