"""A house of two rooms, with a door opening between them, a window and a roof with a loft."""

from exact_cases import box
from scenes import joined

import rastercov as rc

WALLS = [
    ((0, 0, 0), (10, 0.2, 2.8)),
    ((0, 5.8, 0), (10, 6, 2.8)),
    ((0, 0.2, 0), (0.2, 5.8, 2.8)),
    # A window of 1.4 x 0.9 m in the wall of the east.
    ((9.8, 0.2, 0), (10, 2, 2.8)),
    ((9.8, 3.4, 0), (10, 5.8, 2.8)),
    ((9.8, 2, 0), (10, 3.4, 1.1)),
    ((9.8, 2, 2), (10, 3.4, 2.8)),
    # A door opening of 0.9 x 2.1 m between kitchen (west) and hall.
    ((5.9, 0.2, 0), (6.1, 3, 2.8)),
    ((5.9, 3.9, 0), (6.1, 5.8, 2.8)),
    ((5.9, 3, 2.1), (6.1, 3.9, 2.8)),
]
KITCHEN = (0.2, 0.2, 0), (5.9, 5.8, 2.8)
HALL = (6.1, 0.2, 0), (9.8, 5.8, 2.8)


def house():
    """Groups floor, walls, ceiling, roof and door: a thin leaf that is open, at the wall."""
    eaves = [(-0.5, -0.5, 3), (10.5, -0.5, 3), (10.5, 6.5, 3), (-0.5, 6.5, 3)]
    ridge = [(-0.5, 3, 5), (10.5, 3, 5)]
    faces = [(0, 1, 5), (0, 5, 4), (2, 3, 4), (2, 4, 5), (0, 4, 3), (1, 2, 5)]
    parts = {
        "floor": [box((-0.2, -0.2, -0.3), (10.2, 6.2, 0))],
        "walls": [box(*ends) for ends in WALLS],
        "ceiling": [box((-0.2, -0.2, 2.8), (10.2, 6.2, 3))],
        "roof": [rc.Mesh(eaves + ridge, faces)],
        "door": [box((5, 3.9, 0.01), (5.9, 3.94, 2.1))],
    }
    mesh = joined(*(part for own in parts.values() for part in own))
    group = [i for i, own in enumerate(parts.values()) for part in own for _ in part.faces]
    return rc.Mesh(mesh.vertices, mesh.faces, [rc.Group(name) for name in parts], group)
