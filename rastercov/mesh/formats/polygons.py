"""Polygons of a file, as every reader returns them, and the checks that readers share.

A reader trusts no number of its file: a count is compared with the bytes that are present before
memory is allocated, and content that cannot be parsed is an error with its line or byte. Readers
keep the file's order of vertices and polygons and neither merge nor drop any, except for STL.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.errors import MeshError, ResourceError
from rastercov.mesh.arrays import MOST_FACES

PEAK_BYTES_PER_FACE = 300
"""Peak memory of a face and its vertex: 250 measured with a binary STL of 10^7, the worst case."""
PEAK_BYTES_PER_VERTEX = 150
"""Peak memory of each vertex beyond one a face."""


@dataclass(frozen=True)
class Polygons:
    """Content of a file.

    Attributes
    ----------
    vertices : (V, 3) float64
        In the file's unit, or in metres: `is_in_metres`.
    faces : (F, 3) int64
        Vertex indices, not checked yet; polygons are triangulated as fans.
    source_face : (F,) int64
        Polygon of each face.
    face_group : (F,) int64
        Index into `group_names`.
    group_names : sequence of str or None
        None for faces outside any group.
    notes : sequence of str
        Oddities that the user should know.
    is_in_metres : bool
        True where the file states its unit; the vertices are then in metres.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    source_face: NDArray[np.int64]
    face_group: NDArray[np.int64]
    group_names: Sequence[str | None] = (None,)
    notes: Sequence[str] = ()
    is_in_metres: bool = False


def check_budget(n_faces: int, budget: int, n_vertices: int = 0, n_bytes: int = 0) -> None:
    """Raise ResourceError, before memory is allocated, when reading needs more bytes than `budget`.

    `n_vertices` are known so far, and only those beyond one a face count. `n_bytes` are those of
    other arrays that are held at the same time.
    """
    n_more = max(0, n_vertices - n_faces)
    need = n_faces * PEAK_BYTES_PER_FACE + n_more * PEAK_BYTES_PER_VERTEX + n_bytes
    if n_faces > MOST_FACES or need > budget:
        vertices = f" with {n_vertices} vertices" if n_more or n_bytes else ""
        raise ResourceError(
            f"{n_faces} triangles{vertices} need about {need} bytes, the budget is {budget} bytes "
            f"(and {MOST_FACES} triangles); simplify the mesh, split it, or raise memory_budget"
        )


def fan_polygons(
    vertices: ArrayLike,
    corners: ArrayLike,
    n_corners: ArrayLike,
    budget: int,
    notes: Sequence[str] = (),
) -> Polygons:
    """Triangulate polygons as fans about their first corner.

    `corners` are the (N,) vertex indices of all polygons, concatenated; `n_corners` those of each
    polygon, at least 3.
    """
    n_corners = np.asarray(n_corners, np.int64)
    n_triangles = n_corners - 2
    check_budget(int(n_triangles.sum()), budget, np.size(vertices) // 3)
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.asarray(corners, np.int64)
    polygon = np.repeat(np.arange(len(n_corners)), n_triangles)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(n_triangles) - n_triangles)[polygon]
    faces = np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)
    return Polygons(points, faces, polygon, np.zeros_like(polygon), notes=notes)


def check_count(count: int, what: str, least_bytes: int, available: int) -> None:
    """Raise MeshError when `count` items of `least_bytes` each cannot be in `available` bytes."""
    if not 0 <= count * least_bytes <= available + least_bytes:  # the last newline may be missing
        raise MeshError(
            f"the header promises {count} {what}, at least {count * least_bytes} bytes, "
            f"{available} bytes are there; the file is truncated or its header is wrong"
        )
