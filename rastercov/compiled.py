"""How loops are compiled: by numba, without a lock, kept on disk; and said so the first time.

numba keeps what it compiled by file, and does not notice when a loop calls into another file that
has changed. So loops that call each other stand in one file.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on first use and keep the result on disk, where there is a disk to keep it on."""
    try:
        return numba.njit(nogil=True, error_model="numpy", cache=True)(function)
    except RuntimeError:  # nowhere to write: compile in every process
        return numba.njit(nogil=True, error_model="numpy")(function)


def forced(function: Callable[..., Any]) -> Any:
    """Part of the loop that calls it, as if it stood there: for what is called once, and often."""
    return numba.njit(nogil=True, error_model="numpy", forceinline=True)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Put in the place of each call: for small functions in hot loops, which take arrays."""
    return numba.njit(nogil=True, error_model="numpy", inline="always")(function)


def announce_compilation(loop: Any) -> bool:
    """Say that loops are compiled, where no earlier run has left this one on disk.

    True where they are, and will be kept.
    """
    folder = getattr(loop.stats, "cache_path", None)
    module = loop.py_func.__module__.rpartition(".")[2]
    pattern = f"{module}.{loop.py_func.__name__}-*.nbi"
    if folder and any(Path(folder).glob(pattern)):
        return False
    print("rastercov: compiling, once after installation", file=sys.stderr, flush=True)
    return folder is not None


@contextmanager
def compiled_aside(code: str) -> Iterator[None]:
    """Run code that compiles some loops in a process of its own, while the block compiles others.

    numba compiles one loop at a time in a process; what both leave on disk is shared. Should the
    other process fail, this one compiles its loops when it needs them.
    """
    aside = None
    with suppress(OSError):
        aside = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    try:
        yield
        if aside:
            aside.wait()
    finally:
        if aside and aside.poll() is None:
            aside.kill()
            aside.wait()
