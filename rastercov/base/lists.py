"""Lists of numbers of any lengths in one array."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


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
        starts = np.zeros(len(rows) + 1, np.int64)
        np.cumsum([len(row) for row in rows], out=starts[1:])
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
