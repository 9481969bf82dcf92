"""Many poses in several threads: compiled loops hold no lock, so they run side by side."""

import os
import threading
from collections.abc import Callable, Sequence

from rastercov.errors import ConfigError

POSES_A_TURN = 16
"""Most poses a thread takes at a time: enough to stay in the loops."""


def thread_count(threads: int | None) -> int:
    """Threads to use: those asked for, or one for each core; ConfigError for less than 1."""
    if threads is not None and (isinstance(threads, bool) or threads < 1):
        raise ConfigError(f"threads must be 1 or more, got {threads!r}")
    return threads or len(os.sched_getaffinity(0))


def share_poses(n_poses: int, workers: Sequence[Callable[[slice], None]]) -> None:
    """Call the workers side by side with slices that together cover the poses.

    The first works in the thread of the caller, the others each in one of its own. What one of them
    raises is raised, and ends all; so does an interrupt, after their turn.
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
        for thread in threads:
            thread.start()
        work(workers[0])
    finally:
        turns.clear()  # an interrupt comes here
        for thread in threads:
            if thread.ident is not None:
                thread.join()
    if raised:
        raise raised[0]
