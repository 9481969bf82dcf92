"""Blocks: groups of 64 faces that the passes over a surface decide together.

A pose sees most blocks from one side, wholly inside or wholly outside the image, and no event edge
near them. What follows from that for all of their faces is then decided once. Blocks are
consecutive faces of the surface, in the order of the mesh where that is local, as generators and
CAD programs write it, or where the mesh is small; otherwise sorted along a curve that fills space.

G. M. Morton. A Computer Oriented Geodetic Data Base and a New Technique in File Sequencing. 1966.
"""

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels import exact_setup as kernels
from rastercov.kernels.exact_records import BLOCK, Blocks, Edges

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]

MOST_VERTICES = 96
"""Vertices of the faces of a block, on average, up to which the order of the mesh is local: a strip
of them has 66, faces in any order 192."""
LEAST_FACES = 1 << 14
"""Faces from which on they are sorted: figures of fewer fit the cache in any order."""
BITS = 10
"""Bits of each coordinate along the curve."""


def is_large(n_faces: int) -> bool:
    """True for a mesh whose figures do not fit the cache, so that its order in memory matters."""
    return n_faces >= LEAST_FACES


def local_order(vertices: FloatArray, faces: IntArray) -> IntArray | None:
    """(F,) faces in an order in which neighbours are close; None where that of the mesh is."""
    n = len(faces) // BLOCK
    if not is_large(len(faces)):
        return None
    used = np.sort(faces[: n * BLOCK].reshape(n, 3 * BLOCK), axis=1)
    n_vertices = n + np.count_nonzero(used[:, 1:] != used[:, :-1])
    return _along_curve(vertices, faces) if n_vertices > MOST_VERTICES * n else None


def blocks_of_targets(flat: BoolArray) -> Blocks:
    """Blocks of targets, which no result spreads over."""
    return _with_faces(flat)


def blocks_of(flat: BoolArray, edges: Edges) -> Blocks:
    """Blocks of the faces of a surface, which are in an order of `local_order`."""
    blocks = _with_faces(flat)
    patch, lowest = blocks.patch, np.empty(len(flat), np.int32)
    n = kernels.find_patches(edges, patch, lowest, blocks.patch_starts)
    met, joins = np.empty(n, np.int32), np.empty((len(edges.kind), 2), np.int32)
    n_joins = kernels.list_joins(edges, patch, met, joins)
    if n_joins > len(joins):
        joins = np.empty((n_joins, 2), np.int32)
        kernels.list_joins(edges, patch, met, joins)
    is_plain = np.empty(-(-len(edges.kind) // BLOCK), np.bool_)
    starts, met = np.empty(len(is_plain) + 1, np.int32), np.empty(len(blocks.has_flat), np.int32)
    of_edges = np.empty(2 * len(edges.kind), np.int32)
    n_blocks = kernels.list_blocks_of_edges(edges, met, is_plain, starts, of_edges)
    return blocks._replace(
        of_patch=np.repeat(np.arange(len(blocks.has_flat)), np.diff(blocks.patch_starts)).astype(
            np.int32
        ),
        lowest=lowest[:n].copy(),
        joins=joins[:n_joins].copy(),
        is_plain=is_plain,
        starts=starts,
        of_edges=of_edges[:n_blocks].copy(),
    )


def _with_faces(flat: BoolArray) -> Blocks:
    """Blocks of faces, without what follows from their edges."""
    n = -(-len(flat) // BLOCK)
    has_flat = np.zeros(n, np.bool_)
    has_flat[np.flatnonzero(flat) // BLOCK] = True
    return Blocks(
        has_flat=has_flat,
        patch=np.zeros(len(flat), np.int32),
        patch_starts=np.zeros(n + 1, np.int32),
        of_patch=np.empty(0, np.int32),
        lowest=np.empty(0, np.int32),
        joins=np.empty((0, 2), np.int32),
        is_plain=np.empty(0, np.bool_),
        starts=np.zeros(1, np.int32),
        of_edges=np.empty(0, np.int32),
    )


def _along_curve(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Faces in the order of their centroids along a curve that fills space."""
    centroids = vertices[faces].mean(axis=1)
    low, high = centroids.min(axis=0), centroids.max(axis=0)
    extent = float((high - low).max())
    cells = (1 << BITS) - 1
    place = (centroids - low) / extent * cells if extent > 0 else np.zeros_like(centroids)
    column = np.clip(np.nan_to_num(place), 0, cells).astype(np.uint32)
    key = np.zeros(len(faces), np.uint32)
    for bit in range(BITS):
        for axis in range(3):
            key |= (column[:, axis] >> np.uint32(bit) & np.uint32(1)) << np.uint32(3 * bit + axis)
    return np.argsort(key, kind="stable").astype(np.int32)
