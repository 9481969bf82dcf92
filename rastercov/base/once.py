"""A value that threads share: the first that asks works it out, the others wait for it.

`functools.cached_property` has no lock, so threads that ask at the same time each compute the value
for themselves. That is right for what is frozen and quickly made; `Once` is for what takes seconds,
takes much memory, or must not happen twice.
"""

import os
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Once(Generic[T]):
    """One value, made at most once in a process; any thread may ask for it at any time."""

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
