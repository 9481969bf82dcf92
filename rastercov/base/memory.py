"""Memory that results would take, held against what the machine has before any of it is taken.

Linux gives memory that it does not have and ends the process when it is used, so `MemoryError`
comes too late or never.
"""

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rastercov.base.errors import ResourceError

CACHE_LINE = 64
"""Bytes of a cache line."""
UNCHECKED = 1 << 28
"""Bytes up to which results are not held against the machine: to ask it takes 0.1 ms."""
_MEMINFO = Path("/proc/meminfo")
_CONTAINER_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def aligned_array(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Array of any values that starts at a cache line: a row of one line is then in one."""
    n_bytes = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(n_bytes + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    array: NDArray[Any] = memory[start : start + n_bytes].view(dtype).reshape(shape)
    return array


def read_only(array: ArrayLike, dtype: DTypeLike | None = None) -> NDArray[Any]:
    """Contiguous view that is not writable: loops are compiled for each layout of an argument."""
    view: NDArray[Any] = np.ascontiguousarray(array, dtype).view()
    view.flags.writeable = False
    return view


def check_memory(what: str, n_bytes: int, remedy: str) -> None:
    """Raise `ResourceError` where results take more memory than is free.

    `what` names them, such as "counts of 3 poses x 12 faces"; `remedy` ends the sentence.
    """
    if n_bytes > UNCHECKED and n_bytes > (free := free_memory()):
        raise ResourceError(
            f"{what} take {n_bytes:,} bytes ({n_bytes / 2**30:,.1f} GiB), but only "
            f"{free / 2**30:,.1f} GiB of memory are free; {remedy}"
        )


def free_memory() -> int:
    """Bytes that the process can still take: free memory and swap, at most its container's limit.

    All of the machine's memory where the system does not say what is free.
    """
    try:
        lines = (line.split() for line in _MEMINFO.read_text(encoding="ascii").splitlines())
        kilobytes = {words[0]: int(words[1]) for words in lines}
        free = 1024 * (kilobytes["MemAvailable:"] + kilobytes.get("SwapFree:", 0))
    except (OSError, ValueError, LookupError):
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for path in _CONTAINER_LIMITS:
        try:
            free = min(free, int(path.read_text(encoding="ascii")))
        except (OSError, ValueError):  # no container, or one without a limit: "max"
            continue
    return free
