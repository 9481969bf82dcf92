"""Plates with ArUco markers, parallel to the image: their corners and their mesh.

A plate is a white board with a marker; a detector needs the white margin, one cell wide, around its
border. Places are in camera axes (x right, y down, z forward), so the pose of the camera is the
identity.

E. S. Eissa. Image Space Coverage Model. 2020, section 5.2: 0.30 m markers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.mesh import Group, Mesh

MARKER_SIDE = 0.30
"""Side of a marker with its black border, metres."""
CELLS = 8
"""Cells along it: 6 of code and the border on either side."""
BOARD_SIDE = MARKER_SIDE * (CELLS + 2) / CELLS
"""Side of a board: the marker and a white cell on either side, metres."""
SQUARE = np.array([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)])
"""Corners of a square: top left, top right, bottom right, bottom left."""


@dataclass(frozen=True)
class Plate:
    """A marker by its number in the dictionary, and its middle, metres."""

    marker: int
    centre: tuple[float, float, float]

    @property
    def corners(self) -> FloatArray:
        """Corners of the marker, (4, 3), in the order of `SQUARE`."""
        return MARKER_SIDE * SQUARE + self.centre


def mesh_of(plates: Sequence[Plate]) -> Mesh:
    """Mesh of N plates: faces 2 i and 2 i + 1 are marker i, the others are boards and only hide.

    A board has its marker's depth, where the face with the lower index is in front.
    """
    boards = [BOARD_SIDE * SQUARE + plate.centre for plate in plates]
    squares = np.array([*(plate.corners for plate in plates), *boards])
    # Counter-clockwise from the front, where x is right and y down.
    faces = 4 * np.arange(len(squares))[:, None, None] + np.array([(0, 2, 1), (0, 3, 2)])
    groups = [Group("markers"), Group("boards", is_occluder=True)]
    return Mesh(
        squares.reshape(-1, 3),
        faces.reshape(-1, 3),
        groups,
        np.repeat((0, 1), 2 * len(plates)),
    )
