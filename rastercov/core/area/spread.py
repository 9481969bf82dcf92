"""Parts that two poses or more cover from directions that differ, pair by pair of poses."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rastercov.base import ConfigError
from rastercov.core.area.criteria import RayAngle
from rastercov.core.area.polygons import choose_polygons
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.area.union import Covered, RegionUnion
from rastercov.core.mesh import Mesh

MOST_POSES = 50
"""Poses of which all pairs are cut."""
BETWEEN_CAMERAS = "expected single cameras with min_angle_deg, got a rig with a rule; limit its own"
PAIRS_AT_ONCE = 64
"""Pairs that are cut before faces that are done are left out."""


def check_poses(n: int) -> None:
    """Raise `ConfigError` for more poses than `MOST_POSES`."""
    if n > MOST_POSES:
        raise ConfigError(
            f"expected at most {MOST_POSES} poses for min_angle_deg by area, got {n}; use by face"
        )


class SpreadUnion:
    """Union of regions by the number of poses that cover a part.

    The number is 1 where no two poses differ by the angle.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the regions.
    views : int
        k: poses up to which they are counted, 2 or more.
    degrees : float
        Least angle between the rays to two of them.
    """

    def __init__(self, mesh: Mesh, views: int, degrees: float) -> None:
        self.mesh, self.views, self._degrees = mesh, views, degrees
        self._counts, self._spread = RegionUnion(mesh, views), RegionUnion(mesh)
        self._seen: list[Regions] = []

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that need no further regions."""
        return self._counts.closed & self._spread.closed

    def add(self, regions: Regions) -> None:
        """Add the regions of further poses.

        Raises
        ------
        ConfigError
            For more than `MOST_POSES` of them in all, and for rows of several cameras.
        """
        if np.isnan(regions.eyes).any():
            raise ConfigError(BETWEEN_CAMERAS)
        before = sum(len(each.pose_ids) for each in self._seen)
        check_poses(before + len(regions.pose_ids))
        self._seen.append(regions)
        self._counts.add(regions)
        every = join(self._seen)
        second, first = np.tril_indices(len(every.pose_ids), -1)
        pairs = np.stack([first, second], axis=1)[second >= before]
        for start in range(0, len(pairs), PAIRS_AT_ONCE):
            some = pairs[start : start + PAIRS_AT_ONCE]
            rows, pair = np.unique(some, return_inverse=True)
            is_open = ~self._spread.closed
            own = take_rows(take_rows(every, rows)._of_faces(is_open), pair.ravel())
            both = own.at_least(2, np.repeat(np.arange(len(some)), 2), one_side=False)
            self._spread.add(both.where(RayAngle(every.eyes[some], self._degrees)))

    def covered(self) -> Covered:
        """Area that the regions so far cover, and its pieces."""
        counts = self._counts.covered()
        if not self._seen:
            return counts
        some = _as_regions(self._seen[0], self._spread.covered(), 1)
        levels = [_as_regions(self._seen[0], counts, 1), some]
        for k in range(3, self.views + 1):
            both = join([_as_regions(self._seen[0], counts, k), some])
            levels.append(both.at_least(2, one_side=False))
        union = RegionUnion(self.mesh, self.views)
        for level in levels:
            union.add(level)
        return union.covered()


def union_of(mesh: Mesh, views: int, degrees: float) -> RegionUnion | SpreadUnion:
    """A union of that many views, from directions that differ where degrees are above 0."""
    return SpreadUnion(mesh, views, degrees) if degrees > 0 else RegionUnion(mesh, views)


def _as_regions(like: Regions, covered: Covered, k: int) -> Regions:
    """Area that at least k cameras cover, as regions of one row."""
    area, bound, rows = covered.area[k - 1], covered.bound, np.flatnonzero(covered.views >= k)
    listed = np.flatnonzero((area > 0) | (bound > 0)).astype(np.int32)
    xy, starts = choose_polygons(covered.xy, covered.starts, rows)
    return replace(
        take_rows(like, np.zeros(1, np.int64)),
        xy=xy,
        starts=starts,
        face=covered.face[rows],
        pose=np.zeros(len(rows), np.int32),
        pair_pose=np.zeros(len(listed), np.int32),
        pair_face=listed,
        area=area[listed],
        bound=bound[listed],
        excess=covered.excess[listed],
        devices=None,
    )
