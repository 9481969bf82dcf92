"""Cells of equal size on the faces of a mesh: elements for choosing cameras, and for colours.

Cells are targets only. What hides is the mesh itself, and the share of a cell that a camera covers
is the area of the camera's regions in it, so that cells need not fit along the edges of the mesh.
"""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    ConfigError,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    ResourceError,
    finite_number,
    frozen_record,
    norm,
    offsets_of,
    read_only,
    shown,
)
from rastercov.core.area.polygons import frames_of, to_world
from rastercov.core.area.table import Regions
from rastercov.core.mesh import Mesh
from rastercov.engine import area_cell

MOST_CELLS = 5_000_000
"""Cells of a mesh."""
USUAL_CELLS = 10_000
"""Cells of `usual_size`, beyond two per face."""
LEAST_CELLS = 500
"""The same of one of many meshes: 1/20 of the diagonal of a plane."""
TOGETHER = 8
"""Meshes that have as many cells as a lone one; more share the cells of these."""
FINEST_REL = 1 / 500
"""Least size of `usual_size`, relative to the diagonal of the evaluated faces."""


class Trees(NamedTuple):
    """Cells of all faces as leaves of binary trees, see `rastercov.engine.area_cell`.

    Attributes
    ----------
    corners : (F, 3, 2) float64
        The faces in their planes.
    first_cell, first_node : (F + 1,) int64
        First cell and first node of each face.
    leaves : (N,) int32
        Leaves below each node.
    areas : (C,) float64
        m^2 of each cell.
    """

    corners: FloatArray
    first_cell: IntArray
    first_node: IntArray
    leaves: Int32Array
    areas: FloatArray


@frozen_record(repr=False)
class CellShares(InOneLine):
    """Covered shares of surface patches by P poses: M pairs of a pose and a patch.

    Attributes
    ----------
    pose_ids : (P,) int64
        Row of each pose in the input.
    starts : (P + 1,) int64
        The pairs of pose i are starts[i] ... starts[i + 1] - 1.
    cell : (M,) int32
        Patch of each pair, in ascending order for each pose.
    share : (M,) float64
        Covered area over the area of the patch, (0, 1].

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> seen = rc.regions(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> shares = rc.cells(mesh, size=0.1).share(seen)
    >>> len(shares.cell), shares.share.min().round(6).item()  # patches of a side, wholly covered
    (24, 1.0)
    """

    pose_ids: IntArray
    starts: IntArray
    cell: Int32Array
    share: FloatArray


@frozen_record(repr=False)
class Cells(InOneLine):
    """Surface patches: triangles that divide the evaluated faces, with sides up to `size`.

    The patches of a face are consecutive, and made by repeated bisection. They share no vertices.

    Attributes
    ----------
    mesh : Mesh
        Mesh that is divided.
    size : float
        Longest permitted side, metres.
    vertices : (3 C, 3) float64
        Metres.
    faces : (C, 3) int64
        Vertices of each patch, wound like its face.
    source_face : (C,) int32
        Face of the mesh that each patch is a part of.
    area : (C,) float64
        Area of each patch, m^2.
    trees : Trees
        Bisection trees of the faces.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> grid = rc.cells(mesh, size=0.1)
    >>> len(grid), grid.area.sum().round(6).item()  # m^2
    (144, 0.24)
    >>> grid.elements.n_faces
    144
    """

    mesh: Mesh
    size: float
    vertices: FloatArray
    faces: IntArray
    source_face: Int32Array
    area: FloatArray
    trees: Trees

    def __len__(self) -> int:
        return len(self.area)

    @cached_property
    def elements(self) -> Mesh:
        """The patches as faces of a mesh, in the groups of their faces; they occlude nothing."""
        mesh = self.mesh
        return Mesh(self.vertices, self.faces, mesh.groups, mesh.face_group[self.source_face])

    def share(self, regions: Regions) -> CellShares:
        """Covered share of each patch by each pose; `ConfigError` for regions of another mesh.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> seen = rc.regions(mesh, camera, rc.look_at((0.15, 0, 0), (0, 0, 0)))
        >>> shares = rc.cells(mesh, size=0.1).share(seen)
        >>> len(shares.cell), shares.share.max().round(6).item()  # patches in view, greatest share
        (8, 0.3125)
        """
        self.mesh._check_same(regions.mesh)
        ends = np.searchsorted(regions.pose, np.arange(len(regions.pose_ids) + 1)).tolist()
        starts, face = read_only(regions.starts, np.int64), read_only(regions.face, np.int32)
        pieces = read_only(regions.xy, np.float64), starts, face
        room = 1024 + 2 * len(regions)
        cell, share = np.empty(room, np.int32), np.empty(room)
        counts = [0]
        for row in range(len(ends) - 1):  # 10 us each, and the loop over its pieces
            while True:
                done = area_cell.find_shares(
                    pieces, ends[row], ends[row + 1], self.trees, cell, share, counts[-1]
                )
                if done <= len(cell):
                    break
                cell, share = np.resize(cell, done * 3 // 2), np.resize(share, done * 3 // 2)
            counts.append(done)
        used, starts_of_poses = counts[-1], np.array(counts, np.int64)
        return CellShares(
            regions.pose_ids, starts_of_poses, cell[:used].copy(), share[:used].copy()
        )


def cells(mesh: Mesh, size: float) -> Cells:
    """Patches of the evaluated faces of a mesh, by bisection of the longest side.

    Parameters
    ----------
    mesh : Mesh
        Mesh to divide; faces without area and occluders have no patches.
    size : float
        Longest side of a patch, metres.

    Raises
    ------
    ConfigError
        For a size that is not a positive number.
    ResourceError
        For more than 5,000,000 patches; the message names a size that fits.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> len(rc.cells(mesh, size=0.3)), len(rc.cells(mesh, size=0.1))
    (12, 144)
    """
    longest = finite_number(size)
    if not longest > 0:
        raise ConfigError(f"expected size above 0 m, got {shown(size)}; give metres")
    counter = _Counter(mesh)
    # A triangle without a longer side has at most this times the square of it as area.
    least = math.sqrt(counter.area / (math.sqrt(3) / 4 * MOST_CELLS))
    if not longest >= least or counter.count(longest) > MOST_CELLS:
        fits = max(longest, least)
        while counter.count(fits) > MOST_CELLS:
            fits *= 1.25
        raise ResourceError(
            f"expected at most {MOST_CELLS:,} patches, got more with sides of {longest:.3g} m; "
            f"use {round_up(fits):g} m"
        )
    counts, corners = counter.counts, counter.corners
    n_cells = int(counts.sum())
    first_cell, first_node = offsets_of(counts), offsets_of(np.maximum(2 * counts - 1, 0))
    leaves, areas = np.empty(first_node[-1], np.int32), np.empty(n_cells)
    triangles = np.empty((n_cells, 3, 2))
    trees = Trees(corners, first_cell, first_node, leaves, areas)
    area_cell.fill_cells(
        corners, counter.is_asked, longest, first_cell, first_node, leaves, areas, triangles
    )
    source = np.repeat(np.arange(mesh.n_faces, dtype=np.int32), counts)
    vertices = to_world(mesh, np.repeat(source, 3), triangles.reshape(-1, 2))
    faces = np.arange(3 * n_cells).reshape(-1, 3)
    return Cells(mesh, longest, vertices, faces, source, areas, trees)


def usual_size(mesh: Mesh, n_meshes: int = 1) -> float:
    """Default size of cells, metres, two digits: 5,000 to 10,000 cells of large faces.

    The smallest in steps of 2^(1/4) with at most `USUAL_CELLS` cells and two per face, not below
    `FINEST_REL` of the diagonal of the evaluated faces. Above `TOGETHER` meshes, as of goals, each
    has fewer, so that all of them fit in memory.
    """
    counter = _Counter(mesh)
    n_faces = int(counter.is_asked.sum())
    if not n_faces:
        return 1.0
    fair = max(LEAST_CELLS, USUAL_CELLS * TOGETHER // max(n_meshes, TOGETHER))
    most = min(fair + 2 * n_faces, MOST_CELLS)
    points = mesh.vertices[mesh.faces[counter.is_asked]].reshape(-1, 3)
    size = diagonal = float(norm(np.ptp(points, axis=0)))
    while size / 2**0.25 >= FINEST_REL * diagonal and counter.count(size / 2**0.25, most) <= most:
        size /= 2**0.25
    return round_up(size)


class _Counter:
    """Number of cells of each face that is asked for, `counts`, by their size."""

    def __init__(self, mesh: Mesh) -> None:
        frames = frames_of(mesh)
        self.is_asked = read_only(mesh.task_mask & (frames.areas > 0), np.bool_)
        self.area = float(frames.areas[self.is_asked].sum())
        self.corners = read_only(frames.corners, np.float64)
        self.counts = np.zeros(mesh.n_faces, np.int64)

    def count(self, side: float, most: int = MOST_CELLS) -> int:
        """Number of cells with sides up to this; any number above `most` if there are more."""
        return area_cell.count_cells(self.corners, self.is_asked, side, most, self.counts)


def round_up(size: float) -> float:
    """`size` rounded up to two digits."""
    exponent = math.floor(math.log10(size)) - 1
    return float(f"{math.ceil(size / 10.0**exponent - 1e-9)}e{exponent}")
