"""Clusters: groups of up to 64 faces that lie close together and face the same way.

A pose culls a whole cluster that is outside the image or back-facing without reading its faces.
Each cluster has its own consecutive copy of its vertices, which fits the level-1 cache.

Faces are grouped by the main direction of their normals, then by median splits of their centroids.

A. Kubisch. Introduction to Turing Mesh Shaders. 2018, for the data layout.
"""

from typing import NamedTuple

import numpy as np

from rastercov.base.memory import FloatArray, Int32Array, aligned_zeros
from rastercov.native import raster_clusters as kernels
from rastercov.native.raster_clusters import BOUNDS_OF_CLUSTER, FACES, LANES

MIN_EXTENT = 1e-290
"""Metres: faces of a smaller mesh are not split by position."""


class Clusters(NamedTuple):
    """A mesh in clusters.

    Attributes
    ----------
    points : (3 N,) float64
        For each cluster, the x of its vertices, their y, and their z.
    corners : (M,) int32
        Vertices of each face, by index within the cluster: a + 256 b + 65536 c. 0 is padding.
    faces : (M,) int32
        Index of each face in the mesh.
    lines : (L,) int32
        Cache lines of the counts of a cluster's faces: indices / 16, without repetition.
    vertex_starts, face_starts, line_starts : (K + 1,) int32
        First entries of the clusters.
    bounds : (11, K or up to 15 more) float64
        Centre (3) and radius of the bounding sphere; axis (3) of the cone that contains all face
        normals, cosine and sine of its half angle; least distance of a face's plane from the
        centre, along its normal; least altitude of a face, 0 where no cone contains the normals.
    n, stride : int
        K, and columns of `bounds`.
    """

    points: FloatArray
    corners: Int32Array
    faces: Int32Array
    lines: Int32Array
    vertex_starts: Int32Array
    face_starts: Int32Array
    line_starts: Int32Array
    bounds: FloatArray
    n: int
    stride: int


def group_faces(vertices: FloatArray, faces: Int32Array, is_wound: bool) -> Clusters:
    """Group faces (F, 3) int32 of vertices (V, 3) float64 into clusters.

    With `is_wound` false the order of a face's corners does not define its front.
    """
    vertices, faces = np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int32)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((high - low).max())
    scale = 1 / extent if extent > MIN_EXTENT else 0.0
    centroids, directions = np.empty((3, len(faces)), np.float32), np.empty(len(faces), np.uint8)
    kernels.face_centroids(vertices, faces, low, scale, bool(is_wound), centroids, directions)
    order = np.argsort(directions, kind="stable").astype(np.int32)
    direction_starts = np.concatenate(([0], np.cumsum(np.bincount(directions, minlength=6))))
    marks, sizes = np.full(len(vertices), -1, np.int32), np.empty(2, np.int64)
    starts = np.empty(len(faces) + 1, np.int32)
    kernels.split_at_medians(faces, order, direction_starts, centroids, marks, starts, sizes)
    del centroids, directions
    n, n_slots = sizes.tolist()
    grouped = faces, order, starts[: n + 1]
    read = n_slots + FACES  # whole clusters are read
    corners, face_of = aligned_zeros(read, np.int32), aligned_zeros(read, np.int32)
    face_starts, vertex_starts, line_starts = np.zeros((3, n + 1), np.int32)
    lines = np.empty(len(faces), np.int32)
    marks[:] = -1
    local = np.empty(len(vertices), np.uint8)
    kernels.index_local_vertices(
        *grouped, marks, local, corners, face_of, face_starts, vertex_starts, lines, line_starts
    )
    lines = lines[: line_starts[-1]].copy()
    points = aligned_zeros(3 * int(vertex_starts[-1]) + LANES, np.float64)  # read beyond the last
    width = -(-n // LANES) * LANES  # whole vectors are read
    bounds = aligned_zeros((BOUNDS_OF_CLUSTER, width), np.float64)
    marks[:] = -1
    kernels.gather_positions(vertices, *grouped, marks, vertex_starts, points)
    kernels.cluster_bounds(vertices, *grouped, vertex_starts, points, bounds)
    arrays = points, corners, face_of, lines, vertex_starts, face_starts, line_starts, bounds
    for array in arrays:
        array.flags.writeable = False  # loops have looked at them once
    return Clusters(*arrays, n, width)
