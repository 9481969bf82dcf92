"""Faces in small groups that lie together and look the same way.

A pose can leave out a whole group without a look at its faces: when it lies outside the image, or
when all of it turns its back. Each group has its own vertices, one after the other, so that what
belongs to it stays in the nearest cache.

Faces are told apart by the main direction of their normals, and halved across the longest side of
where they lie until few enough are left.

A. Kubisch. Introduction to Turing Mesh Shaders. 2018, for the form.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.raster.cpu import cluster_kernels as kernels
from rastercov.raster.cpu.memory import FACES, LANES, aligned_zeros

FloatArray = NDArray[np.float64]
WordArray = NDArray[np.int32]

SMALLEST = 1e-290
"""Metres: faces of a mesh that is smaller are not told apart by where they lie."""


class Clusters(NamedTuple):
    """A mesh in clusters.

    Attributes
    ----------
    points : (3 N,) float64
        For each cluster, the x of its vertices, their y, and their z.
    corners : (M,) int32
        Vertices of each face, counted within the cluster: a + 256 b + 65536 c. 0 is a face that
        fills up.
    faces : (M,) int32
        Index of each face in the mesh.
    lines : (L,) int32
        Where the counts of a cluster's faces lie: their indices / 16, each once.
    vertex_starts, face_starts, line_starts : (K + 1,) int32
        Where clusters start.
    bounds : (11, K or up to 15 more) float64
        Centre (3) and radius of a sphere around it; the axis (3) of a cone that holds the normals
        of all its faces, cosine and sine of the cone's half angle; the least distance of a face's
        plane from the centre, along the face's normal; and the least altitude of a face, 0 where
        the normals fit no cone.
    n, stride : int
        K, and columns of `bounds`.
    """

    points: FloatArray
    corners: WordArray
    faces: WordArray
    lines: WordArray
    vertex_starts: WordArray
    face_starts: WordArray
    line_starts: WordArray
    bounds: FloatArray
    n: int
    stride: int


def group_faces(vertices: FloatArray, faces: WordArray, is_wound: bool) -> Clusters:
    """Vertices (V, 3) float64 and faces (F, 3) int32 in clusters.

    With `is_wound` false the order of a face's corners says nothing about its outside.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((high - low).max())
    scale = 1 / extent if extent > SMALLEST else 0.0
    middles, directions = np.empty((3, len(faces)), np.float32), np.empty(len(faces), np.uint8)
    kernels.measure(vertices, faces, low, scale, is_wound, middles, directions)
    order = np.argsort(directions, kind="stable").astype(np.int32)
    group_starts = np.concatenate(([0], np.cumsum(np.bincount(directions, minlength=6))))
    marks = np.full(len(vertices), -1, np.int32)
    starts = np.empty(len(faces) + 1, np.int32)
    n, n_slots = kernels.cut(faces, order, group_starts, middles, marks, starts)
    del middles, directions
    read = n_slots + FACES  # all that a cluster can have are read at once
    corners, face_of = aligned_zeros(read, np.int32), aligned_zeros(read, np.int32)
    face_starts, vertex_starts, line_starts = np.zeros((3, n + 1), np.int32)
    lines = np.empty(len(faces), np.int32)
    marks[:] = -1
    local = np.empty(len(vertices), np.uint8)
    kernels.number(
        faces, order, starts, n, marks, local, corners, face_of, face_starts, vertex_starts,
        lines, line_starts,
    )  # fmt: skip
    lines = lines[: line_starts[-1]].copy()
    points = aligned_zeros(3 * int(vertex_starts[-1]) + LANES, np.float64)  # read beyond the last
    width = -(-n // LANES) * LANES  # sixteen are read at once
    bounds = aligned_zeros((kernels.BOUNDS, width), np.float64)
    marks[:] = -1
    kernels.place(vertices, faces, order, starts, n, marks, vertex_starts, points)
    kernels.bound(vertices, faces, order, starts, n, vertex_starts, points, bounds)
    return Clusters(
        points, corners, face_of, lines, vertex_starts, face_starts, line_starts, bounds, n, width
    )
