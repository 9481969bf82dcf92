"""Arrays of an observation that solvers fill, pose by pose."""

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.raster.observation import BoundKind

FloatArray = NDArray[np.float64]


class Figures(NamedTuple):
    """Figures of P poses and F faces, and whether the near plane cuts each pose.

    Attributes
    ----------
    visible, area, error : (P, F) float64
        Visible area, area in the image and the bound of both, px^2.
    kind : (P, F) uint8
        `BoundKind`.
    clipped : (P,) bool
    """

    visible: FloatArray
    area: FloatArray
    error: FloatArray
    kind: NDArray[np.uint8]
    clipped: NDArray[np.bool_]

    @classmethod
    def room(cls, n_poses: int, n_faces: int) -> Self:
        """Memory for them.

        Not one array of three: the allocator uses memory of less than 32 MiB again, where fresh
        pages take a tenth of the time of a large pose.
        """
        visible, area, error = (np.empty((n_poses, n_faces)) for _ in range(3))
        kind = np.empty((n_poses, n_faces), np.uint8)
        return cls(visible, area, error, kind, np.empty(n_poses, np.bool_))

    def lend(self, solver: Any, row: int) -> bool:
        """Have a solver write a pose here; False if it keeps its own arrays."""
        is_lent: bool = solver.write_to(self.visible[row], self.area[row], self.error[row])
        return is_lent

    def take(self, solver: Any, row: int, *, is_lent: bool) -> None:
        """Take what a solver has found of a pose, in the order of the mesh."""
        rows = solver.surface.rows
        if not is_lent:
            # All rows are in range: with another mode `take` makes a copy first.
            solver.visible.take(rows, out=self.visible[row], mode="clip")
            solver.area.take(rows, out=self.area[row], mode="clip")
            solver.area_error.take(rows, out=self.error[row], mode="clip")
        # `EXACT` less 1 is `CERTIFIED`; assignment by a mask takes far longer.
        is_certified = solver.is_certified[rows].view(np.uint8)
        np.subtract(np.uint8(BoundKind.EXACT), is_certified, out=self.kind[row])
