"""Ctrl-C and SIGTERM: a command ends within a second, and a loop at its next look.

Loops in C++ look at signals in the main thread (`engine/interrupt.hpp`), and so does Python between
its own lines; what they raise ends the call. Calls in other threads complete normally, except for
those that share the work of the call (`rastercov.base.threads.share_poses`). A library may look at
nothing: so the process of a command ends `END_S` after the signal, whatever its threads are at,
except for a swap of files that has begun. Files are written beside their place and renamed, so
that nothing is left half written.
"""

import _thread
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

END_S = 0.75
"""Seconds from a signal to the end of the process of a command."""
_came: list[int] = []
_watch: list[Any] = []
_descriptors: list[int] = []
_announced: list[bool] = []


def interrupt(number: int, frame: object) -> NoReturn:
    """Raise KeyboardInterrupt, as a handler of signals, and note it for `was_interrupted`."""
    _came.append(number)
    raise KeyboardInterrupt


def was_interrupted() -> bool:
    """True once a signal came, whatever error the code that it met made of it."""
    return bool(_came)


def code_of_interrupt() -> int:
    """Exit code of a command that a signal ended: 130 of SIGINT, 143 of SIGTERM."""
    return 128 + (_came[-1] if _came else signal.SIGINT)


def take_signals() -> None:
    """Make this process that of a command: SIGINT and SIGTERM raise KeyboardInterrupt, and end it.

    SIGPIPE stays ignored, as Python leaves it: a reader that goes away is an error of the write.
    """
    signal.signal(signal.SIGTERM, interrupt)  # as Ctrl-C: what is done is kept
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored by a shell
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = come_again
    if sys.platform != "win32":  # whose descriptor would be a socket
        _descriptors[:] = os.pipe()
        os.set_blocking(_descriptors[1], False)
        signal.set_wakeup_fd(_descriptors[1], warn_on_full_buffer=False)


def watch_signals() -> None:
    """Begin to end this process after a signal, where it is that of a command; again: nothing."""
    if _descriptors and not _watch:
        from rastercov.engine import base_interrupt  # loads numpy, which help does without

        _watch.append(base_interrupt.Watch(_descriptors[0], END_S))
        _watch[0].start()


def announce_end() -> None:
    """Note that the line on an interrupt is printed."""
    _announced.append(True)
    for watch in _watch:
        watch.announce()


def is_announced() -> bool:
    """True where the line on an interrupt is printed."""
    return bool(_announced)


def ignore_signals() -> None:
    """Let nothing interrupt the end of the process."""
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, signal.SIG_IGN)


def forget_interrupts() -> None:
    """Begin anew: signals that came before say nothing about what follows."""
    _came.clear()


AGAIN_S = 0.05
"""Seconds until an interrupt comes again that was lost."""
_again: list[threading.Timer] = []


def come_again(lost: "sys.UnraisableHookArgs") -> None:
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


@contextmanager
def hold_end() -> Iterator[None]:
    """Complete the block, a swap of files, before an interrupt is raised or ends the process."""
    for watch in _watch:
        watch.hold()
    try:
        with hold_interrupts():
            yield
    finally:
        for watch in _watch:
            watch.release()


ABANDONED = "rastercov-abandoned"
"""Prefix of the names of threads that an interrupted program does not wait for."""


@contextmanager
def hold_interrupts() -> Iterator[None]:
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
