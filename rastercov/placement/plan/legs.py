"""Legs of a flight: their distance from the surface, and the way over what is in between.

Distances of segments from triangles are exact up to rounding: a segment is a triangle that repeats
a corner. A leg that comes nearer than the clearance, or meets a keep-out volume, leads straight up,
across above the scene and straight down. From home the way leads straight up to the height of its
first position, and back in the same way.
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rastercov.base import FloatArray, IntArray, frozen_record, hypot, norm
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.engine import mesh_clearance
from rastercov.placement.candidates.rooms import KeepOutBox, KeepOutSphere
from rastercov.placement.improve.tour import tour

LEAST_CLEARANCE = 1.0
"""Height of a climb, and of a way over the scene above it, at least, metres."""
UP = (0.0, 0.0, 1.0)
STEP = 1.05
"""Ratio of heights of a climb with one required distance, that of the upper height."""
ON_GROUND = 0.05
"""Height above home below which a climb is not tested, metres."""
SAME_REL = 1e-9
"""Difference of distances that are the same."""
MOST_TOURED = 300
"""Positions up to which a shorter order is searched; of more, that of the patterns is kept."""
MOST_TOURS = 4
"""Orders that are tried, each with the legs that were not clear in those before."""


@frozen_record
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
        return self.mesh.centre

    @cached_property
    def _tree(self) -> TriangleTree | None:
        faces = self.mesh.faces[~self.mesh.degenerate_mask & ~self.mesh.target_mask]
        return TriangleTree.over(self.mesh.vertices - self._middle, faces) if len(faces) else None

    def distance(self, stops: FloatArray, most: float = np.inf) -> float:
        """Distance of a way through (N, 3) stops from the surface, metres; `most` if greater."""
        values = np.full(1, most)
        if self._tree is None or len(stops) < 2:
            return most
        rows = np.arange(len(stops) - 1)
        legs = np.stack((rows, rows + 1, rows + 1), axis=1)
        way = TriangleTree.over(stops - self._middle, legs)
        own = self._tree.corners, self._tree.nodes, way.corners, way.nodes
        mesh_clearance.distances(*own, np.eye(4)[None], values)
        return float(values[0])

    def _is_kept_out(self, stops: FloatArray) -> bool:
        return any(each.meets(stops[:-1], stops[1:]).any() for each in self.keep_out)

    def is_clear(self, stops: FloatArray, clearance: float | None = None) -> bool:
        """True for a way that keeps a clearance, or its own, and meets no keep-out volume."""
        least = self.clearance if clearance is None else clearance
        if self._is_kept_out(stops):
            return False
        away = self.distance(stops, 2 * least or 1.0)
        return away > 0 and away >= (1 - SAME_REL) * least

    def is_clear_climb(self, home: FloatArray, top: float) -> bool:
        """True for a way straight up from home that keeps the clearance.

        Near home the surface is its ground: half the height above home is enough.
        """
        upper, least = top - home[2], self.clearance
        lower = 2 * least / STEP
        while lower > ON_GROUND:
            if lower < upper and not self.is_clear(home + np.outer((lower, upper), UP), least):
                return False
            upper = min(lower, upper)
            least, lower = lower / 2, lower / STEP
        near = home + np.outer((min(ON_GROUND, upper), upper), UP)
        ways = np.stack((home, *near))
        return self.is_clear(near, least) and not self._is_kept_out(ways)

    def _over(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """(2, 3) points above a start and an end, and above the scene."""
        over = np.stack((start, end))
        above = self.mesh.bounds[1, 2] + max(self.clearance, LEAST_CLEARANCE)
        over[:, 2] = np.maximum(over[:, 2], above)
        return over

    def between(self, start: FloatArray, end: FloatArray) -> FloatArray | None:
        """(K, 3) points of a way from a start to an end, none if it is straight; None for no way.

        Ways over the scene are above all of it.
        """
        for way in (np.zeros((0, 3)), self._over(start, end)):
            if self.is_clear(np.stack((start, *way, end))):
                return way
        return None

    def from_home(self, home: FloatArray, end: FloatArray) -> FloatArray | None:
        """(K, 3) points of a way from the ground to an end, at least the top of its climb."""
        top = np.append(home[:2], max(home[2] + LEAST_CLEARANCE, end[2]))
        for way in (top[None], self._over(top, end)):
            if self.is_clear(np.stack((*way, end))) and self.is_clear_climb(home, way[0, 2]):
                return way
        return None


class Course(NamedTuple):
    """Order of positions, and the points on the way to each.

    Attributes
    ----------
    rows : (N,) int64
        Positions in the order of flight.
    over : list of (K, 3) float64 or None
        Points on each of N + 1 legs, from home through the positions and back, none where it is
        straight; None where there is no way.
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

    def measure(order: IntArray) -> tuple[Course, float]:
        """Course in an order, and its length, rounded."""
        over, total = [], 0.0
        is_clear = space.is_clear(eyes[order])
        own = [0, *(order + 1).tolist()]
        for a, b in [*pairwise(own), (0, own[-1])]:
            if a and is_clear:
                known[a, b] = np.zeros((0, 3))
            elif (a, b) not in known:
                known[a, b] = (
                    space.between(stops[a], stops[b]) if a else space.from_home(home, stops[b])
                )
            between = known[a, b]
            over.append(between)
            total += np.inf if between is None else length_of(stops[a], *between, stops[b])
        last = over[-1]
        over[-1] = None if last is None else last[::-1]
        return Course(order, over), round(total, 6)

    best, least = measure(rows)
    if n > MOST_TOURED:
        return best
    ways = norm(stops[:, None] - stops[None])
    tops = np.maximum(home[2] + LEAST_CLEARANCE, eyes[:, 2])
    across = norm((eyes - home)[:, :2])
    ways[0, 1:] = ways[1:, 0] = tops - home[2] + hypot(across, tops - eyes[:, 2])
    dear = 1 + 2 * float(ways.sum())
    for _ in range(MOST_TOURS):
        n_known = len(known)
        for (a, b), between in known.items():
            cost = dear if between is None else length_of(stops[a], *between, stops[b])
            ways[a, b] = ways[b, a] = cost
        other, length = measure(tour(ways))
        if length < least:
            best, least = other, length
        if len(known) == n_known or all(is_straight(other.over)):
            break
    return best


def is_straight(over: Sequence[FloatArray | None]) -> list[bool]:
    """True for each leg of a course that has no points but the top of the climb at home."""
    n_straight = [1, *[0] * (len(over) - 2), 1]
    return [each is not None and len(each) == n for each, n in zip(over, n_straight, strict=True)]


def length_of(*stops: FloatArray) -> float:
    """Length of a way through points."""
    return float(norm(np.diff(stops, axis=0)).sum())
