"""Dead zones: connected parts of the task surface that too few cameras cover.

The pieces of a partition with fewer cameras than wanted are connected where they share a part of
their boundary: within a face, and across an edge of the mesh. Faces that meet along a part of an
edge only, as where a vertex lies on the edge of another face, are connected, too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind, checked_array
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import InOneLine
from rastercov.base.typed import typed
from rastercov.coverage.area.frames import frames_of, to_world
from rastercov.coverage.area.rest import with_rest
from rastercov.coverage.area.union import Covered, polygon_areas
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TOLERANCE_REL = 1e-10
"""Distance of two sides in one plane that are one, relative to the diagonal of the mesh and its
distance from the origin: a hundred times the distance of corners that the union merges."""
LEAST_REL = 1e-8
"""Length of contact from which pieces are connected, relative to the same: a hundred times the
tolerance, so that lines that cross at more than 0.01 rad are not one."""
OPEN_TOLERANCE_REL = 1e-6
"""Distance of open edges that are one: files in float32 have vertices that far from the edge on
which they lie."""
SWEEP = np.array([0.4794, 0.6367, 0.6040])
"""Direction of the sweep in space; the first two, in a plane."""
MOST_ZONES = 100
"""Zones that a summary lists."""
SLIVER_REL = 1e-9
"""Part of the area of the task below which a zone is rounding, and is not listed."""


@dataclass(frozen=True, eq=False, repr=False)
class DeadZones(InOneLine):
    """Connected parts that too few cameras cover: Z zones, the largest first, of N pieces.

    Attributes
    ----------
    xy, starts, face, views
        The pieces, as in `Covered`.
    zone : (N,) int64
        Zone of each piece.
    area : (Z,) float64
        m^2, descending.
    piece_area : (N,) float64
        m^2.
    """

    mesh: Mesh
    xy: FloatArray
    starts: NDArray[np.int64]
    face: NDArray[np.int32]
    views: NDArray[np.int32]
    zone: IntArray
    area: FloatArray
    piece_area: FloatArray

    def __len__(self) -> int:
        return len(self.area)

    @typed
    def places(self, n: int) -> list[dict[str, Any]]:
        """Area, centroid, extent and groups of the first n zones, ready for JSON.

        Groups are named by falling area; `m2_by_views` is the area that exactly 0, 1, ... cameras
        cover.
        """
        n = min(max(int(n), 0), len(self.area))
        rows = np.flatnonzero(self.zone < n)
        corners = np.repeat(np.arange(len(self.face)), np.diff(self.starts))
        listed = self.zone[corners] < n
        corners = corners[listed]
        points = to_world(self.mesh, self.face[corners], self.xy[listed])
        zone = self.zone[corners]
        low, high = np.full((n, 3), np.inf), np.full((n, 3), -np.inf)
        np.minimum.at(low, zone, points)
        np.maximum.at(high, zone, points)
        centres = to_world(self.mesh, self.face[rows], self.centroids()[rows])
        weight = self.piece_area[rows]
        moment = np.zeros((n, 3))
        np.add.at(moment, self.zone[rows], centres * weight[:, None])
        group = self.mesh.face_group[self.face[rows]]
        of_group = np.zeros((n, len(self.mesh.groups)))
        np.add.at(of_group, (self.zone[rows], group), weight)
        by_views = np.zeros((n, int(self.views[rows].max(initial=0)) + 1))
        np.add.at(by_views, (self.zone[rows], self.views[rows]), weight)
        names = [group.name for group in self.mesh.groups]
        total = self.total()
        return [
            {
                "area_m2": float(self.area[row]),
                "percent": 100 * float(self.area[row]) / total,
                "centroid": (moment[row] / self.area[row]).tolist(),
                "extent": [low[row].tolist(), high[row].tolist()],
                "groups": [
                    names[each] for each in np.argsort(-of_group[row]) if of_group[row, each] > 0
                ],
                "m2_by_views": by_views[row].tolist(),
            }
            for row in range(n)
        ]

    def listed(self) -> int:
        """Number of zones that a summary lists: at most `MOST_ZONES`, and none that is rounding."""
        return min(int((self.area > SLIVER_REL * self.total()).sum()), MOST_ZONES)

    def others(self) -> dict[str, Any]:
        """Number and area of the zones that a summary does not list."""
        rest = self.area[self.listed() :]
        total = self.total()
        percent = 100 * float(rest.sum()) / total if total > 0 else 0.0
        return {"zones": len(rest), "area_m2": float(rest.sum()), "percent": percent}

    def total(self) -> float:
        """Area of all task faces, m^2."""
        return float(frames_of(self.mesh).areas[self.mesh.task_mask].sum())

    def centroids(self) -> FloatArray:
        """(N, 2) centroids of the pieces in their planes."""
        counts = np.diff(self.starts)
        first = np.repeat(self.starts[:-1], counts)
        following = np.arange(1, len(self.xy) + 1)
        following[self.starts[1:] - 1] = self.starts[:-1]
        away = self.xy - self.xy[first]
        after = away[following] if len(away) else away
        twice = away[:, 0] * after[:, 1] - away[:, 1] * after[:, 0]
        moment = (away + after) * twice[:, None] / 6
        sums: FloatArray = (
            np.add.reduceat(moment, self.starts[:-1]) if len(counts) else np.zeros((0, 2))
        )
        found: FloatArray = self.xy[self.starts[:-1]] + sums / self.piece_area[:, None]
        return found


def dead_zones(covered: Covered, views: ArrayLike | None = None) -> DeadZones:
    """Connected parts of the task surface that fewer than `views` cameras cover.

    Parameters
    ----------
    covered : Covered
        What `rastercov.unite` gives.
    views : int, or (F,) int array_like, optional
        Cameras wanted, of all faces or of each, 1 ... k; k of `covered` unless given.

    Raises
    ------
    ConfigError
        For `views` beyond those that `covered` counts.
    """
    from rastercov.kernels import area_zone as kernels

    check_kind("covered", covered, Covered, "what unite gives", ConfigError)
    mesh, k = covered.mesh, len(covered.area)
    words = f"whole numbers of 1 to {k}, as covered counts them: one, or one a face"
    wanted = checked_array("views", k if views is None else views, "iu", words, ConfigError)
    is_shape = wanted.shape in ((), (mesh.n_faces,))
    if not is_shape or not ((wanted >= 1) & (wanted <= k)).all():
        raise ConfigError(f"views must be {words}, got {shown(views)}")
    wanted = np.broadcast_to(wanted, mesh.n_faces)
    whole = with_rest(covered)
    areas = polygon_areas(whole.xy, whole.starts)
    kept = (whole.views < wanted[whole.face]) & (areas > 0)
    counts = np.diff(whole.starts)
    xy = np.ascontiguousarray(whole.xy[np.repeat(kept, counts)])
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts[kept])])
    face, number, areas = whole.face[kept], whole.views[kept], areas[kept]
    parent = np.arange(len(face))
    if len(face):
        _link(mesh, xy, starts, face, parent)
    root = np.empty_like(parent)
    kernels.find_roots(parent, root)
    zone, area = _by_area(root, areas)
    return DeadZones(mesh, xy, starts, face, number, zone, area, areas)


def _by_area(root: IntArray, areas: FloatArray) -> tuple[IntArray, FloatArray]:
    """Zone of each piece and area of each zone, the largest first."""
    _, zone = np.unique(root, return_inverse=True)
    sums: FloatArray = np.asarray(np.bincount(zone, weights=areas), np.float64)
    order = np.argsort(-sums, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rank[zone], sums[order]


def _link(mesh: Mesh, xy: FloatArray, starts: IntArray, face: Any, parent: IntArray) -> None:
    """Link the pieces that are connected, by their parents."""
    from rastercov.kernels import area_zone as kernels

    frames = frames_of(mesh)
    scale = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    scale = max(scale, 2.0**-20 * float(np.abs(mesh.bounds).max()))
    tolerance, least = TOLERANCE_REL * scale, LEAST_REL * scale
    low, high = (each.reduceat(xy, starts[:-1]) for each in (np.minimum, np.maximum))
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
    along = xy @ SWEEP[:2]
    ends = [each.reduceat(along, starts[:-1]) for each in (np.minimum, np.maximum)]
    interval = np.stack(ends, axis=1)
    order = np.lexsort((interval[:, 0], face))
    kernels.link_in_faces(xy, starts, face, boxes, interval, order, tolerance, least, parent)

    side = np.empty(len(xy), np.int64)
    kernels.find_sides(xy, starts, face, np.array(frames.corners), tolerance, side)
    at = np.flatnonzero(side >= 0)
    piece = np.repeat(np.arange(len(face)), np.diff(starts))
    following = np.arange(1, len(xy) + 1)
    following[starts[1:] - 1] = starts[:-1]
    piece_of = piece[at]
    faces = face[piece_of].astype(np.int64)
    points = np.stack([to_world(mesh, faces, xy[rows]) for rows in (at, following[at])], axis=1)
    one, other, is_open = _edges(mesh, faces, side[at])
    edge = one * mesh.n_vertices + other
    start = mesh.vertices[one]
    away = mesh.vertices[other] - start
    away /= np.linalg.norm(away, axis=1)[:, None]
    along_edge = np.einsum("nki,ni->nk", points - start[:, None], away)
    interval = np.sort(along_edge, axis=1)
    order = np.lexsort((interval[:, 0], edge))
    kernels.link_along_edges(edge[order], interval[order], piece_of[order], face, least, parent)

    rows = np.flatnonzero(is_open)
    ends_in_space = points[rows]
    interval = np.sort(ends_in_space @ SWEEP, axis=1)
    order = np.argsort(interval[:, 0], kind="stable")
    kernels.link_in_space(
        ends_in_space[order], interval[order], piece_of[rows][order], face,
        OPEN_TOLERANCE_REL * scale, 10 * OPEN_TOLERANCE_REL * scale, parent,
    )  # fmt: skip


def _edges(mesh: Mesh, faces: IntArray, side: IntArray) -> tuple[IntArray, IntArray, Any]:
    """Lower and higher vertex of the edges on which sides of pieces lie, and the open ones.

    An edge is open if it is of one face only. Faces without area do not count.
    """
    frames, corners = frames_of(mesh), mesh.welded_faces
    off = mesh.vertices[mesh.faces] - frames.origin[:, None]
    first = np.einsum("fki,fki->fk", off, off).argmin(axis=1)

    def ends(rows: IntArray, sides: IntArray) -> tuple[IntArray, IntArray]:
        from_, to = ((first[rows] + sides + k) % 3 for k in (0, 1))
        a, b = corners[rows, from_], corners[rows, to]
        return np.minimum(a, b), np.maximum(a, b)

    solid = np.flatnonzero(frames.areas > 0)
    low, high = ends(np.repeat(solid, 3), np.tile(np.arange(3), len(solid)))
    keys, uses = np.unique(low * mesh.n_vertices + high, return_counts=True)
    one, other = ends(faces, side)
    is_open = uses[np.searchsorted(keys, one * mesh.n_vertices + other)] == 1
    return one, other, is_open
