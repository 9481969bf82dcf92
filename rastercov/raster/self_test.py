"""Self-test scene with known counts, for devices and compilers that give wrong results.

Three rectangles of whole pixels, one behind the other, from two poses. No diagonal passes through a
pixel centre (odd width, even height), so every rasteriser must give the same counts. Parallax makes
the two poses differ, so that a stale image is detected.
"""

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.mesh import Mesh

WIDTH, HEIGHT = 16, 12
CAMERA = Camera(width=WIDTH, height=HEIGHT, fx=16, fy=16)

# left, top, right, bottom in pixels from the first pose, and depth in metres
_RECTANGLES = ((3, 3, 8, 7, 1.0), (1, 2, 12, 10, 2.0), (5, 5, 8, 7, 4.0))


def _corners() -> NDArray[np.float64]:
    """Corners (6, 3, 3) of the faces: two triangles a rectangle, facing a camera at the origin."""
    faces = []
    for left, top, right, bottom, z in _RECTANGLES:
        a, b, c, d = (
            ((u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z)
            for u, v in ((left, top), (left, bottom), (right, bottom), (right, top))
        )
        faces += [(a, c, b), (a, d, c)]
    return np.array(faces)


def _poses() -> NDArray[np.float64]:
    """Two poses, (2, 4, 4); the second shifts surfaces at 1 m to the left by 4 px, at 4 m by 1."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 4 / CAMERA.fx
    return poses


def _expected() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Visible and drawn samples (2, 6), from the sign of three edge functions a pixel centre."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    visible, drawn = np.zeros((2, 6), np.int64), np.zeros((2, 6), np.int64)
    for view, pose in enumerate(_poses()):
        nearest = np.full((HEIGHT, WIDTH), -1)
        for face, corners in reversed(list(enumerate(_corners() - pose[:3, 3]))):
            image = corners[:, :2] / corners[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
            ahead = np.roll(image, -1, axis=0) - image
            edges = [
                d[0] * (v - p[1]) - d[1] * (u - p[0]) for p, d in zip(image, ahead, strict=True)
            ]
            inside = np.all(np.greater(edges, 0), axis=0) | np.all(np.less(edges, 0), axis=0)
            drawn[view, face] = inside.sum()
            nearest[inside] = face  # from back to front
        visible[view] = np.bincount(nearest[nearest >= 0], minlength=6)
    return visible, drawn


MESH = Mesh(vertices=_corners().reshape(-1, 3), faces=np.arange(18).reshape(6, 3))
POSES = _poses()
VISIBLE, DRAWN = _expected()
