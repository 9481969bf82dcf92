"""Legs of a flight: their distance from the surface, and the way over what is in between.

Distances of segments from triangles are exact up to rounding: a segment is a triangle that repeats
a corner. A leg that comes nearer than the clearance, or meets a keep-out volume, leads straight up,
across above the scene and straight down.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rastercov.base.memory import FloatArray, IntArray
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import TriangleTree
from rastercov.native import mesh_clearance
from rastercov.placement.candidates.clearance import KeepOutBox, KeepOutSphere
from rastercov.placement.improve.tour import tour

LEAST_CLEARANCE = 1.0
"""Height above the scene of a way over it at least, metres."""
SAME_REL = 1e-9
"""Difference of distances that are the same."""
MOST_TOURED = 300
"""Positions up to which a shorter order is searched; of more, that of the patterns is kept."""
MOST_TOURS = 4
"""Orders that are tried, each with the legs that were not clear in those before."""


@dataclass(frozen=True, eq=False)
class Airspace:
    """Scene, and bodies besides it, that a vehicle keeps away from.

    Attributes
    ----------
    mesh : Mesh
        All its faces except those of targets.
    clearance : float
        Least distance from it, metres.
    keep_out : sequence of KeepOutBox or KeepOutSphere
    """

    mesh: Mesh
    clearance: float = 0.0
    keep_out: Sequence[KeepOutBox | KeepOutSphere] = ()

    @cached_property
    def _middle(self) -> FloatArray:
        return np.asarray(self.mesh.bounds.mean(axis=0))

    @cached_property
    def _tree(self) -> TriangleTree | None:
        faces = self.mesh.faces[~self.mesh.degenerate_mask & ~self.mesh.target_mask]
        return TriangleTree.over(self.mesh.vertices - self._middle, faces) if len(faces) else None

    def distance(self, stops: FloatArray, most: float = np.inf) -> float:
        """Distance of a way through (N, 3) stops from the surface, metres; `most` if greater."""
        found = np.full(1, most)
        if self._tree is None or len(stops) < 2:
            return most
        rows = np.arange(len(stops) - 1)
        legs = np.stack((rows, rows + 1, rows + 1), axis=1)
        way = TriangleTree.over(stops - self._middle, legs)
        own = self._tree.corners, self._tree.nodes, way.corners, way.nodes
        mesh_clearance.distances(*own, np.eye(4)[None], found)
        return float(found[0])

    def is_clear(self, stops: FloatArray) -> bool:
        """True for a way that keeps the clearance and meets no keep-out volume."""
        if any(each.meets(stops[:-1], stops[1:]).any() for each in self.keep_out):
            return False
        away = self.distance(stops, 2 * self.clearance or 1.0)
        return away > 0 and away >= (1 - SAME_REL) * self.clearance

    def between(self, start: FloatArray, end: FloatArray) -> FloatArray | None:
        """(K, 3) points of a way from a start to an end, none if it is straight; None for no way.

        Ways over the scene are above all of it.
        """
        if self.is_clear(np.stack((start, end))):
            return np.zeros((0, 3))
        over = np.stack((start, end))
        above = self.mesh.bounds[1, 2] + max(self.clearance, LEAST_CLEARANCE)
        over[:, 2] = np.maximum(over[:, 2], above)
        return over if self.is_clear(np.stack((start, *over, end))) else None


class Course(NamedTuple):
    """Order of positions, and the points on the way to each.

    Attributes
    ----------
    rows : (N,) int64
        Positions in the order of flight.
    over : list of (K, 3) float64 or None
        Points on the way to each, from home to the first, none where it is straight; None where
        there is no way.
    """

    rows: IntArray
    over: list[FloatArray | None]


def course_of(space: Airspace, home: FloatArray, eyes: FloatArray, rows: IntArray) -> Course:
    """Shortest known course from home through (N, 3) positions.

    The order is that of `rows`, or a tour. Legs that are not clear cost the way over the scene.
    """
    n = len(eyes)
    known: dict[tuple[int, int], FloatArray | None] = {}
    stops = np.concatenate((home[None], eyes))

    def measured(order: IntArray) -> tuple[Course, float]:
        """Course in an order, and its length with the way back, rounded."""
        over, total = [], length_of(eyes[order[-1]], home)
        first = np.append(home[:2], max(home[2], eyes[order[0], 2]))
        is_clear = space.is_clear(np.concatenate((first[None], eyes[order])))
        for a, b in zip(np.append(0, order[:-1] + 1).tolist(), (order + 1).tolist(), strict=True):
            if is_clear:
                known[a, b] = np.zeros((0, 3))
            elif (a, b) not in known:
                known[a, b] = space.between(stops[a] if a else first, stops[b])
            between = known[a, b]
            over.append(between)
            total += np.inf if between is None else length_of(stops[a], *between, stops[b])
        return Course(order, over), round(total, 6)

    best, least = measured(rows)
    if n > MOST_TOURED:
        return best
    ways = np.linalg.norm(stops[:, None] - stops[None], axis=2)
    dear = 1 + 2 * float(ways.sum())
    for _ in range(MOST_TOURS):
        n_known = len(known)
        for (a, b), between in known.items():
            cost = dear if between is None else length_of(stops[a], *between, stops[b])
            ways[a, b] = ways[b, a] = cost
        other, length = measured(tour(ways))
        if length < least:
            best, least = other, length
        if len(known) == n_known or all(each is not None and not len(each) for each in other.over):
            break
    return best


def length_of(*stops: FloatArray) -> float:
    """Length of a way through points."""
    return float(np.linalg.norm(np.diff(stops, axis=0), axis=1).sum())
