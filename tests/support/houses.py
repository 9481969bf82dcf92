"""A house of two rooms, with a door opening between them, a window, a loft and a roof."""

from exact_cases import box
from scenes import joined

import rastercov as rc

WALLS = (
    *[((0, 0, 0), (10, 0.2, 2.8)), ((0, 5.8, 0), (10, 6, 2.8)), ((0, 0.2, 0), (0.2, 5.8, 2.8))],
    # A window of 1.4 x 0.9 m in the wall of the east.
    *[((9.8, 0.2, 0), (10, 2, 2.8)), ((9.8, 3.4, 0), (10, 5.8, 2.8))],
    *[((9.8, 2, 0), (10, 3.4, 1.1)), ((9.8, 2, 2), (10, 3.4, 2.8))],
    # A door opening of 0.9 x 2.1 m between the kitchen in the west and the hall.
    *[((5.9, 0.2, 0), (6.1, 3, 2.8)), ((5.9, 3.9, 0), (6.1, 5.8, 2.8))],
    ((5.9, 3, 2.1), (6.1, 3.9, 2.8)),
)
EAVES = [(-0.5, -0.5, 3), (10.5, -0.5, 3), (10.5, 6.5, 3), (-0.5, 6.5, 3)]
RIDGE = [(-0.5, 3, 5), (10.5, 3, 5)]
ROOF = [(0, 1, 5), (0, 5, 4), (2, 3, 4), (2, 4, 5), (0, 4, 3), (1, 2, 5)]
DOOR = (5, 3.9, 0.01), (5.9, 3.94, 2.1)
KITCHEN = (0.2, 0.2, 0), (5.9, 5.8, 2.8)
HALL = (6.1, 0.2, 0), (9.8, 5.8, 2.8)


def house():
    """Groups floor, walls, ceiling, door (its leaf, open) and roof."""
    floor, ceiling = box((-0.2, -0.2, -0.3), (10.2, 6.2, 0)), box((-0.2, -0.2, 2.8), (10.2, 6.2, 3))
    walls, roof = [box(*ends) for ends in WALLS], rc.Mesh(EAVES + RIDGE, ROOF)
    mesh = joined(floor, *walls, ceiling, box(*DOOR), roof)
    group = [0] * 12 + [1] * 12 * len(walls) + [2] * 12 + [3] * 12 + [4] * len(ROOF)
    groups = [rc.Group(name) for name in ("floor", "walls", "ceiling", "door", "roof")]
    return rc.Mesh(mesh.vertices, mesh.faces, groups, group)
