"""Rows of a table: the figures of chosen pairs of pose and face, of some poses at a time.

A network adds up the figures of a pair where they are computed; here the pairs that a table holds
are kept as well, without an array of all of them.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError

if TYPE_CHECKING:
    from rastercov.kernels.network import PairRows, Sink

CHOICES = ("none", "covered", "seen", "all")
"""Pairs that a table may hold: those covered; those seen, that is with some part of the face in the
image and its front to the camera, though other faces may hide it; or every pair."""


class PairBuffer:
    """Memory for the rows of a batch of poses, used again for each batch.

    Parameters
    ----------
    choice : {"none", "covered", "seen", "all"}
        Pairs to keep.
    n_poses, n_faces : int
        Size of the largest batch.

    Raises
    ------
    ConfigError
        For another choice.
    """

    def __init__(self, choice: str, n_poses: int, n_faces: int) -> None:
        from rastercov.kernels import network as kernels  # loads numba

        check_choice(choice)
        self.choice, self._kernels, self._n_faces = CHOICES.index(choice), kernels, n_faces
        size = n_poses * n_faces if self.choice else 0
        # Memory that no row is written to is never taken from the system.
        self._memory = kernels.PairRows(
            *(np.empty(size, kernels.ROW_TYPES[name]) for name in kernels.PairRows._fields)
        )
        self._counts: NDArray[np.int64] = np.zeros(0, np.int64)

    def sink(self, pose_ids: NDArray[np.int64]) -> "Sink":
        """Empty memory for the rows of these poses, (P,)."""
        self._counts = np.zeros(len(pose_ids), np.int64)
        return self._kernels.Sink(self.choice, pose_ids, self._counts, self._memory)

    def rows(self) -> "PairRows":
        """Copy of the rows of the batch, by pose, then by face."""
        starts = np.flatnonzero(self._counts)
        spans = [(at * self._n_faces, self._counts[at]) for at in starts.tolist()]
        return self._kernels.PairRows(*(_joined(column, spans) for column in self._memory))


def check_choice(choice: object) -> None:
    """Raise `ConfigError` for what is no choice of pairs."""
    if choice not in CHOICES:
        raise ConfigError(f"pairs must be one of {', '.join(CHOICES)}, got {shown(choice)}")


def _joined(column: NDArray[Any], spans: list[tuple[int, int]]) -> NDArray[Any]:
    return np.concatenate([column[:0], *(column[at : at + n] for at, n in spans)])
