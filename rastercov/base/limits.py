"""Work that ends at a limit of time, by its name, for lines of progress."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

_LIMITED: list[tuple[str, float]] = []
"""Names of what is done and when it ends at the latest, by `time.monotonic`, the innermost last."""


@contextmanager
def limit_time(what: str, seconds: float) -> Iterator[None]:
    """Note that the work in the block ends within some seconds."""
    entry = what, time.monotonic() + seconds
    _LIMITED.append(entry)
    try:
        yield
    finally:
        _LIMITED.remove(entry)


def time_limit_in_words() -> str:
    """Name of the work that has a time limit and the seconds left, or ""."""
    if not _LIMITED:
        return ""
    what, end = _LIMITED[-1]
    return f"{what}: at most {max(end - time.monotonic(), 0.0):,.0f} s left"
