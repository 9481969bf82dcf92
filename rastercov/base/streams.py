"""Standard output, kept for this program: what a library prints there of itself goes elsewhere.

A result on standard output may be read by a program, as JSON is. `own_output` serves a command,
whose process is its own. In a program of others the descriptor belongs to all of its threads, and
`no_printing` leaves it alone.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from io import TextIOWrapper

STANDARD_OUTPUT = 1
"""Its descriptor."""


def own_output() -> None:
    """Give `sys.stdout` a descriptor of its own; 1 is standard error for the whole process.

    Where one of both is closed, it leads nowhere. Streams that are not of the system stay.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - for the whole process
    stdout, stderr = sys.stdout, sys.stderr
    if not (stdout is sys.__stdout__ and isinstance(stdout, TextIOWrapper)):
        return
    with suppress(OSError):
        stdout.flush()
        own = os.dup(stdout.fileno())
        os.dup2(stderr.fileno(), STANDARD_OUTPUT)
        replaced = open(  # noqa: SIM115 - for the whole process
            own, "w", encoding=stdout.encoding, errors=stdout.errors, closefd=False
        )
        replaced.reconfigure(line_buffering=stdout.line_buffering)
        # Whoever asks for the width of the terminal asks the original one.
        sys.stdout = sys.__stdout__ = replaced  # type: ignore[misc] # typeshed has it final


@contextmanager
def no_printing() -> Iterator[None]:
    """Let no C code in the block print: HiGHS does so before it can be given an option.

    The stream `stdout` of the C library is another one meanwhile, if that is glibc. Python has
    streams of its own, so other threads may print.
    """
    library, nowhere = _nowhere()
    if library is None:
        yield
        return
    stream = ctypes.c_void_p.in_dll(library, "stdout")
    before = stream.value
    stream.value = nowhere
    try:
        yield
    finally:
        stream.value = before
        library.fflush(ctypes.c_void_p(nowhere))


@cache
def _nowhere() -> tuple[ctypes.CDLL | None, int]:
    """C library of this process, and a stream of it that leads nowhere; None for another one."""
    if not sys.platform.startswith("linux") or "CS_GNU_LIBC_VERSION" not in os.confstr_names:
        return None, 0
    try:
        library = ctypes.CDLL(None)
        library.fopen.restype = ctypes.c_void_p
        ctypes.c_void_p.in_dll(library, "stdout")
        opened = library.fopen(os.devnull.encode(), b"w")
    except (OSError, ValueError, AttributeError):
        return None, 0
    return (library, opened) if opened else (None, 0)
