"""Ctrl-C held back while something is done that must not be left half done."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

ABANDONED = "rastercov-abandoned"
"""Prefix of the names of threads that an interrupted program does not wait for."""


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back until the block has ended; SIGTERM too, where it does the same."""
    held: list[int] = []
    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():  # the only one that is interrupted
        for name in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(name) is signal.default_int_handler:
                before[name] = signal.signal(name, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
    if held:
        raise KeyboardInterrupt
