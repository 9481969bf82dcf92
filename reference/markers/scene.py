"""Plates with ArUco markers: their poses, faces and print.

Plates become a mesh for the engine, and the same faces with their print for the renderer. A plate
is a white board with a marker; a detector needs the white margin, one cell wide, around its border.

Axes of a plate are those of a camera that sees it head-on: x right, y down, z away from the viewer.
Scenes are in camera axes, so the pose of their camera is the identity.

E. S. Eissa. Image Space Coverage Model. 2020, section 5.2: 0.30 m markers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rastercov.base.memory import FloatArray, IntArray
from rastercov.mesh import Group, Mesh

MARKER_SIDE = 0.30
"""Side of a marker with its black border, metres."""
CELLS = 8
"""Cells along it: 6 of code and the border on either side."""
MARGIN = 1.0
"""White around it, in cells."""
PLAIN, BLANK = -2, -1
"""Print of a face without a marker: uniform grey, or nothing on white."""
FACES_A_PLATE = 10
"""Two of the marker, eight of the margin."""


@dataclass(frozen=True, eq=False)
class Plate:
    """A square board with or without a marker."""

    pose: FloatArray  # camera_from_plate, (4, 4); its origin is the middle of the marker
    marker: int = PLAIN  # index in the dictionary, or `PLAIN` for a grey board that only occludes
    side: float = MARKER_SIDE  # of the marker, metres

    @property
    def corners(self) -> FloatArray:
        """Corners of the marker in camera axes: top left, top right, bottom right, bottom left."""
        return self._square(self.side / 2)

    @property
    def board_corners(self) -> FloatArray:
        """Corners of the board, in the same order."""
        return self._square(self.side * (0.5 + MARGIN / CELLS))

    def _square(self, half: float) -> FloatArray:
        square = half * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
        return square @ self.pose[:3, :3].T + self.pose[:3, 3]


@dataclass(frozen=True, eq=False)
class PlateScene:
    """Plates as faces and print.

    The mesh has `FACES_A_PLATE` faces a plate, in order: the two of the marker first. Group
    "marker i" of the plate's position i in `plates` is scored, "board i" only occludes.
    """

    plates: tuple[Plate, ...]  # those with a marker are the task
    mesh: Mesh
    place: FloatArray  # corners of the faces, in cells from the marker's top left, (F, 3, 2)
    printed: IntArray  # index of the marker on each face, or `BLANK`, or `PLAIN`, (F,)

    @classmethod
    def of(cls, plates: Sequence[Plate]) -> "PlateScene":
        """Scene of some plates."""
        inner = [(0, 0), (CELLS, 0), (CELLS, CELLS), (0, CELLS)]
        outer = [
            (-MARGIN, -MARGIN),
            (CELLS + MARGIN, -MARGIN),
            (CELLS + MARGIN, CELLS + MARGIN),
            (-MARGIN, CELLS + MARGIN),
        ]
        places = np.array(inner + outer, np.float64)
        # Counter-clockwise from the front, where x is right and y down.
        faces = [(0, 2, 1), (0, 3, 2)]
        for corner in range(4):
            following = (corner + 1) % 4
            faces += [(corner, following, 4 + corner), (following, 4 + following, 4 + corner)]
        square = np.array(faces)
        vertices = [np.concatenate((plate.corners, plate.board_corners)) for plate in plates]
        groups, printed, group = [], [], []
        for index, plate in enumerate(plates):
            is_task = plate.marker != PLAIN
            groups += [
                Group(f"marker {index}", is_occluder=not is_task),
                Group(f"board {index}", is_occluder=True),
            ]
            group += [2 * index] * 2 + [2 * index + 1] * 8
            printed += [plate.marker] * 2 + [BLANK if is_task else PLAIN] * 8
        mesh = Mesh(
            np.concatenate(vertices),
            np.concatenate([square + 8 * index for index in range(len(plates))]),
            groups,
            group,
        )
        place = np.tile(places[square], (len(plates), 1, 1))
        return cls(tuple(plates), mesh, place, np.array(printed, np.int64))

    @property
    def targets(self) -> list[int]:
        """Positions in `plates` of those with a marker."""
        return [index for index, plate in enumerate(self.plates) if plate.marker != PLAIN]

    def faces_of(self, index: int) -> slice:
        """The two faces of a plate's marker."""
        return slice(FACES_A_PLATE * index, FACES_A_PLATE * index + 2)


def plate_pose(
    centre: Sequence[float] | FloatArray,
    tilt: float = 0.0,
    tilt_axis: float = 0.0,
    roll: float = 0.0,
) -> FloatArray:
    """camera_from_plate of a plate that is parallel to the image plane and then turned, (4, 4).

    Parameters
    ----------
    centre : (3,)
        Middle of the marker in camera axes, metres.
    tilt : float
        Turn about an axis in the image plane, radians.
    tilt_axis : float
        Direction of that axis from x towards y, radians.
    roll : float
        Turn in its own plane, before the tilt, from x towards y, radians.
    """
    c, s = np.cos(roll), np.sin(roll)
    rolled = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
    a = np.array([np.cos(tilt_axis), np.sin(tilt_axis), 0.0])
    cross = np.array([(0, -a[2], a[1]), (a[2], 0, -a[0]), (-a[1], a[0], 0)])
    tilted = np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross
    pose = np.eye(4)
    pose[:3, :3] = tilted @ rolled
    pose[:3, 3] = centre
    return pose
