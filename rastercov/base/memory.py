"""Checks of the memory of results against what is free, before any of it is allocated.

And arrays as loops want them; `Lists` has lists of numbers of any lengths in one array.

Linux gives memory that it does not have and ends the process when it is used, so `MemoryError`
comes too late or never.
"""

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from rastercov.base.errors import ResourceError

AnyArray = NDArray[Any]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
Float32Array = NDArray[np.float32]
WholeArray = NDArray[np.integer[Any]]

TINY = float(np.finfo(float).tiny)
"""Least positive number of full precision, in place of a divisor of 0."""
CACHE_LINE = 64
"""Bytes of a cache line."""
UNCHECKED = 1 << 28
"""Bytes up to which free memory is not checked: the check takes 0.1 ms."""
LARGEST_REUSED = 31 << 20
"""Bytes of a freed array that the allocator uses again. glibc gives the pages of a large array back
when it is freed, and maps fresh ones for the next, until it has seen one as large come and go; it
does so below 32 MiB. Fresh pages take a tenth of the time of a pass over poses."""
np.empty(LARGEST_REUSED, np.uint8)
_MEMINFO = Path("/proc/meminfo")
_CONTAINER_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def align_array(shape: tuple[int, ...], dtype: DTypeLike) -> AnyArray:
    """Array of any values that starts at a cache line: a row of one line is then in one."""
    n_bytes = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(n_bytes + CACHE_LINE, np.uint8)
    start = -memory.__array_interface__["data"][0] % CACHE_LINE
    return np.ndarray(shape, dtype, memory, start)


def read_only(array: ArrayLike, dtype: DTypeLike | None = None) -> AnyArray:
    """Contiguous view that is not writable, for what several calls share."""
    view: AnyArray = np.ascontiguousarray(array, dtype).view()
    view.flags.writeable = False
    return view


def check_memory(what: str, n_bytes: int, remedy: str) -> None:
    """Raise `ResourceError` where results take more memory than is free.

    `what` names them, such as "counts of 3 poses x 12 faces"; `remedy` ends the sentence.
    """
    if n_bytes > UNCHECKED and n_bytes > (free := free_memory()):
        raise ResourceError(
            f"expected {what} to fit in {free / 2**30:,.1f} GiB of free memory, got "
            f"{n_bytes / 2**30:,.1f} GiB; {remedy}"
        )


def free_memory() -> int:
    """Bytes that the process can still take: free memory and swap, at most its container's limit.

    All of the machine's memory where the system does not say what is free; no bound on Windows,
    which raises `MemoryError` before it gives memory that it does not have.
    """
    try:
        lines = (line.split() for line in _MEMINFO.read_text(encoding="ascii").splitlines())
        kilobytes = {words[0]: int(words[1]) for words in lines}
        free = 1024 * (kilobytes["MemAvailable:"] + kilobytes.get("SwapFree:", 0))
    except (OSError, ValueError, LookupError):
        if not hasattr(os, "sysconf"):
            return sys.maxsize
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for path in _CONTAINER_LIMITS:
        try:
            free = min(free, int(path.read_text(encoding="ascii")))
        except (OSError, ValueError):  # no container, or one without a limit: "max"
            continue
    return free


class Lists(NamedTuple):
    """N lists: list i is `items[starts[i]:starts[i + 1]]`.

    Attributes
    ----------
    starts : (N + 1,) int64
    items : (M,) int32
    """

    starts: NDArray[np.int64]
    items: NDArray[np.int32]

    @classmethod
    def of(cls, rows: Sequence[NDArray[np.integer]]) -> "Lists":
        """Lists of arrays."""
        starts = np.cumsum([0, *map(len, rows)])
        items = np.concatenate(rows) if len(rows) else np.empty(0)
        return cls(starts, items.astype(np.int32))

    @property
    def n(self) -> int:
        """Number of lists."""
        return len(self.starts) - 1

    def row(self, i: int) -> NDArray[np.int32]:
        """List i."""
        return self.items[self.starts[i] : self.starts[i + 1]]

    def part(self, first: int, last: int) -> "Lists":
        """Lists first ... last - 1, copied."""
        begin, end = self.starts[first], self.starts[last]
        return Lists(self.starts[first : last + 1] - begin, self.items[begin:end].copy())
