"""How loops are compiled: by numba, without a lock, kept on disk; and said so the first time.

numba keeps what it compiled by file, and does not notice when a loop calls into another file that
has changed. So loops that call each other stand in one file, or name the others to `compiled_with`.

numba compiles in one thread of a process at a time, whichever asks; a fork waits until it is done.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from numba.core.compiler_lock import global_compiler_lock

from rastercov.once import Once

# A process that is forked while another thread compiles would find the compiler locked for ever,
# and half way through a loop: no lock of its own could mend that.
os.register_at_fork(
    before=global_compiler_lock.acquire,
    after_in_parent=global_compiler_lock.release,
    after_in_child=global_compiler_lock.release,
)

_ANNOUNCED: dict[str, Once[None]] = {}


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on first use and keep the result on disk, where there is a disk to keep it on."""
    try:
        return numba.njit(nogil=True, error_model="numpy", cache=True)(function)
    except RuntimeError:  # nowhere to write: compile in every process
        return numba.njit(nogil=True, error_model="numpy")(function)


def compiled_with(*others: ModuleType) -> Callable[[Callable[..., Any]], Any]:
    """As `compiled`, for loops that are made of what stands in other files too.

    What is on disk is then used only while all of these files are as they were.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        loop = compiled(function)
        cache = getattr(loop._cache, "_cache_file", None)
        if cache is not None:
            files = [Path(str(module.__file__)).stat() for module in others]
            cache._source_stamp = (
                cache._source_stamp,
                *((file.st_mtime, file.st_size) for file in files),
            )
        return loop

    return decorate


def part_of(function: Callable[..., Any]) -> Any:
    """Compiled into the loop that calls it, as if it stood there: for what is called often.

    It must not take arrays, whose references would be counted at each call.
    """
    return numba.njit(nogil=True, error_model="numpy", forceinline=True)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Put in the place of each call: for small functions in hot loops, which take arrays."""
    return numba.njit(nogil=True, error_model="numpy", inline="always")(function)


def announce_compilation(loop: Any) -> bool:
    """Say that loops are compiled, once a process, where no earlier run has left this one on disk.

    True where they are, and will be kept.
    """
    folder = getattr(loop.stats, "cache_path", None)
    module = loop.py_func.__module__.rpartition(".")[2]
    pattern = f"{module}.{loop.py_func.__name__}-*.nbi"
    if folder and any(Path(folder).glob(pattern)):
        return False
    _ANNOUNCED.setdefault(pattern, Once()).get(_announce)
    return folder is not None


def _announce() -> None:
    print("rastercov: compiling, once after installation", file=sys.stderr, flush=True)


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
