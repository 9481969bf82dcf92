"""How loops are compiled: by numba, without a lock, kept on disk; and said so the first time.

numba keeps what it compiled by file, and does not notice when a loop calls into another file that
has changed. So loops that call each other stand in one file.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on first use and keep the result on disk, where there is a disk to keep it on."""
    try:
        return numba.njit(nogil=True, error_model="numpy", cache=True)(function)
    except RuntimeError:  # nowhere to write: compile in every process
        return numba.njit(nogil=True, error_model="numpy")(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Put in the place of each call: for small functions in hot loops, which take arrays."""
    return numba.njit(nogil=True, error_model="numpy", inline="always")(function)


def announce_compilation(loop: Any) -> None:
    """Say that loops are compiled, where no earlier run has left this one on disk."""
    folder = getattr(loop.stats, "cache_path", None)
    module = loop.py_func.__module__.rpartition(".")[2]
    pattern = f"{module}.{loop.py_func.__name__}-*.nbi"
    if not folder or not any(Path(folder).glob(pattern)):
        print("rastercov: compiling, once after installation", file=sys.stderr, flush=True)
