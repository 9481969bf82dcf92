"""Scenes in which faces of one plane overlap, and the samples where an image of them is wrong."""

from functools import cache
from itertools import pairwise

import numpy as np
from image_laws import EDGE, GAP, reference_view

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh

CAMERA = Camera(width=96, height=72, fx=80, fy=84, cx=47.3, cy=36.9)
TIE = 1e-10
APART = 1e-13
"""Metres between the planes of faces that are meant to lie in one."""


def polygons(rng):
    """Convex polygons that overlap in one to three planes, some of them `APART`."""
    parts = []
    for _ in range(rng.integers(1, 4)):
        flat = []
        for _ in range(rng.integers(2, 6)):
            angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
            rim = np.stack((np.cos(angles), np.sin(angles)), axis=1) * rng.uniform(0.3, 1, 2)
            flat.append(_fan(rim + rng.uniform(-0.5, 0.5, 2), rng.choice((0, 0, 1, -1)) * APART))
        parts.append(np.concatenate(flat) @ _rotation(rng) + rng.normal(size=3) * 0.2)
    return _mesh(rng, parts)


def triangulations(rng):
    """One rectangle, cut into triangles in two or three ways."""
    parts = []
    for _ in range(rng.integers(2, 4)):
        columns, rows = (
            np.concatenate(((-1,), np.sort(rng.uniform(-1, 1, rng.integers(1, 4))), (1,)))
            for _ in range(2)
        )
        cells = []
        for x0, x1 in pairwise(columns):
            for y0, y1 in pairwise(rows):
                rim = np.array(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
                cells.append(_fan(np.roll(rim, rng.integers(2), axis=0), 0.0))
        parts.append(np.concatenate(cells))
    return _mesh(rng, [np.concatenate(parts) @ _rotation(rng)])


def stacks(rng):
    """Boxes on boxes, some of them flush with a side: closed, and on each other."""
    boxes = [np.array(((-0.5, -0.5, 0.0), rng.uniform(0.3, 0.8, 3)))]
    for _ in range(rng.integers(1, 4)):
        below = boxes[rng.integers(len(boxes))]
        low = np.append(rng.uniform(below[0, :2] - 0.2, below[1, :2] - 0.1), below[1, 2])
        low[:2] = np.where(rng.random(2) < 0.4, below[0, :2], low[:2])
        low[2] += rng.choice((0, 0, 1, -1)) * APART
        boxes.append(np.array((low, low + rng.uniform(0.2, 0.8, 3))))
    return _mesh(rng, [np.concatenate([_box(*box) for box in boxes]) @ _rotation(rng)], mix=False)


SCENES = {"polygons": polygons, "triangulations": triangulations, "stacks": stacks}


def views(rng, mesh, n=2):
    """Poses that look at about the middle of a mesh, from all sides and from close by."""
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    away = rng.normal(size=(n, 3))
    away *= size * rng.uniform(0.3, 1.5, (n, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    return look_at(centre + away, centre + rng.normal(size=(n, 3)) * 0.1 * size)


@cache
def scene_of(kind, seed, n=2):
    """Mesh of a kind, and n views of it: the same objects for all rasterisers."""
    rng = np.random.default_rng(seed)
    mesh = SCENES[kind](rng)
    return mesh, views(rng, mesh, n)


def wrong_samples(mesh, camera, pose, face):
    """Pixels whose face is not the reference's, further than `EDGE` from any edge.

    Nor is one wrong whose depth differs by more than `TIE`, which counts as equal, and less than
    `GAP`, which float32 need not tell apart.
    """
    expected = reference_view(mesh, camera, pose)
    rows, columns = np.nonzero((face != expected.face) & (expected.edge_distance > EDGE))
    result = face[rows, columns]
    corners = (mesh.vertices[mesh.faces[result]] - pose[:3, 3]) @ pose[:3, :3]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rays = np.stack((columns + 0.5 - camera.cx, rows + 0.5 - camera.cy, columns * 0 + 1.0), axis=1)
    rays /= (camera.fx, camera.fy, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (normals * corners[:, 0]).sum(axis=1) / (normals * rays).sum(axis=1)
    gap = np.abs(depth / expected.depth[rows, columns] - 1)
    is_close = (result >= 0) & (gap > TIE) & (gap < GAP)
    return np.stack((rows, columns), axis=1)[~is_close]


def _fan(rim, height):
    points = np.column_stack((rim, np.full(len(rim), height)))
    return np.stack([points[[0, k, k + 1]] for k in range(1, len(rim) - 1)])


def _box(low, high):
    corner = np.array([(low, high)[k][i] for n in range(8) for i, k in enumerate(_bits(n))])
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    faces = [(q[0], q[k], q[k + 1]) for q in quads for k in (1, 2)]
    return corner.reshape(8, 3)[np.array(faces)]


def _bits(n):
    return n & 1, n >> 1 & 1, n >> 2 & 1


def _rotation(rng):
    """Any, or one that leaves the axes alone, so that coordinates stay exact."""
    return np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.7 else np.eye(3)


def _mesh(rng, parts, mix=True):
    triangles = np.concatenate(parts) + rng.normal(size=3) * 10.0 ** rng.uniform(-1, 2)
    if mix:
        triangles = rng.permutation(triangles)
    points, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(vertices=points, faces=faces.reshape(-1, 3))
