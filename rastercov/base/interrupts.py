"""Ctrl-C: noted where it comes, and held back while something must not be left half done."""

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

_came: list[int] = []


def interrupt(number: int, frame: object) -> NoReturn:
    """Raise KeyboardInterrupt, as a handler of signals, and note it for `was_interrupted`."""
    _came.append(number)
    raise KeyboardInterrupt


def was_interrupted() -> bool:
    """True once a signal came, whatever error the code that it met made of it."""
    return bool(_came)


def forget_interrupts() -> None:
    """Begin anew: signals that came before say nothing about what follows."""
    _came.clear()


AGAIN_S = 0.05
"""Seconds until an interrupt comes again that was lost."""
_again: list[threading.Timer] = []


def come_again(lost: Any) -> None:
    """Raise an interrupt anew that a callback of a library swallowed, as `sys.unraisablehook`."""
    if lost.exc_type is KeyboardInterrupt and _came:
        for earlier in _again:  # one is enough, and a second would meet the report of the first
            earlier.cancel()
        _again[:] = [threading.Timer(AGAIN_S, _send, (_came[-1],))]
        _again[0].daemon = True
        _again[0].start()
    else:
        sys.__unraisablehook__(lost)


def _send(number: int) -> None:
    """Send a signal to the main thread, whose call of the system it ends except on Windows."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(signal.Signals(number))


ABANDONED = "rastercov-abandoned"
"""Prefix of the names of threads that an interrupted program does not wait for."""


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back until the block has ended; SIGTERM too, where it does the same."""
    held: list[int] = []
    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():  # the only one that is interrupted
        for name in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(name) in (signal.default_int_handler, interrupt):
                before[name] = signal.signal(name, lambda number, frame: held.append(number))
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)
    if held:
        interrupt(held[0], None)
