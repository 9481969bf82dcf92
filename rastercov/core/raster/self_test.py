"""Self-test scene with known counts, for devices and compilers that give wrong results.

Three rectangles of whole pixels, one behind the other, from two poses. No diagonal passes through a
pixel centre (odd width, even height), so every rasteriser must give the same counts. Parallax makes
the two poses differ, so that a stale image is detected.
"""

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh

PASSED = "passed"
WIDTH, HEIGHT = 16, 12
CAMERA = Camera(width=WIDTH, height=HEIGHT, fx=16, fy=16)

# left, top, right, bottom in pixels from the first pose, and depth in metres
_RECTANGLES = ((3, 3, 8, 7, 1.0), (1, 2, 12, 10, 2.0), (5, 5, 8, 7, 4.0))


def _corners() -> FloatArray:
    """Corners (6, 3, 3) of the faces: two triangles a rectangle, facing a camera at the origin."""
    faces = []
    for left, top, right, bottom, z in _RECTANGLES:
        a, b, c, d = (
            ((u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z)
            for u, v in ((left, top), (left, bottom), (right, bottom), (right, top))
        )
        faces += [(a, c, b), (a, d, c)]
    return np.array(faces)


MESH = Mesh(vertices=_corners().reshape(-1, 3), faces=np.arange(18).reshape(6, 3))
POSES = np.tile(np.eye(4), (2, 1, 1))
"""The second shifts surfaces at 1 m to the left by 4 px, at 4 m by 1."""
POSES[1, 0, 3] = 4 / CAMERA.fx
VISIBLE = np.array([(10, 10, 36, 32, 0, 0), (6, 10, 25, 39, 0, 0)])
DRAWN = np.array([(10, 10, 44, 44, 3, 3), (6, 10, 36, 44, 3, 3)])
"""Samples of each face in each pose."""
