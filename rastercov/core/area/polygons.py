"""Tables of polygons in planes, points that fill an area evenly, and quantiles by area.

Polygon i of a table has the corners xy[starts[i]] ... xy[starts[i + 1] - 1], counter-clockwise.
"""

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import BoolArray, FloatArray, IntArray


def starts_of(counts: ArrayLike) -> IntArray:
    """(N + 1,) sums of the counts before each polygon, and of all."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])


def choose_polygons(
    xy: FloatArray, starts: IntArray, rows: IntArray
) -> tuple[FloatArray, IntArray]:
    """Corners and starts of some of the polygons, in this order."""
    counts = np.diff(starts)[rows]
    ends = starts_of(counts)
    corners = np.repeat(starts[rows] - ends[:-1], counts) + np.arange(ends[-1])
    return xy[corners], ends


def following(starts: IntArray) -> IntArray:
    """(C,) the corner after each corner."""
    after = np.arange(1, starts[-1] + 1)
    after[starts[1:] - 1] = starts[:-1]
    return after


def extents(values: FloatArray, starts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value of the corners of each polygon."""
    if len(starts) < 2:
        return values[:0], values[:0]
    return np.minimum.reduceat(values, starts[:-1]), np.maximum.reduceat(values, starts[:-1])


def boxes(xy: FloatArray, starts: IntArray) -> FloatArray:
    """(N, 4) least and most x, least and most y."""
    low, high = extents(xy, starts)
    return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)


def _triangles(xy: FloatArray, starts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Sums of two corners, and twice the area, of the triangle of each side and the first corner.

    Corners are relative to the first.
    """
    away = xy - xy[np.repeat(starts[:-1], np.diff(starts))]
    after = away[following(starts)] if len(xy) else away
    return away + after, away[:, 0] * after[:, 1] - away[:, 1] * after[:, 0]


def polygon_areas(xy: FloatArray, starts: IntArray) -> FloatArray:
    """(N,) areas."""
    twice = _triangles(xy, starts)[1]
    return np.add.reduceat(twice, starts[:-1]) / 2 if len(starts) > 1 else np.zeros(0)


def centroids(xy: FloatArray, starts: IntArray, areas: FloatArray) -> FloatArray:
    """(N, 2) centroids of polygons of areas (N,) > 0."""
    if len(starts) < 2:
        return np.zeros((0, 2))
    sums, twice = _triangles(xy, starts)
    moments = np.add.reduceat(sums * twice[:, None] / 6, starts[:-1])
    return xy[starts[:-1]] + moments / areas[:, None]


def fans(starts: IntArray) -> tuple[IntArray, IntArray]:
    """(T, 3) corners of the triangles that convex polygons are fans of, (T,) polygon of each."""
    counts = np.maximum(np.diff(starts) - 2, 0)
    ends, polygon = starts_of(counts), np.repeat(np.arange(len(counts)), counts)
    first, side = starts[polygon], np.arange(ends[-1]) - ends[polygon] + 1
    return np.stack((first, first + side, first + side + 1), axis=1), polygon


def quantile(values: FloatArray, weights: FloatArray, mask: BoolArray, share: float = 0.5) -> float:
    """Value below which a share of the weight is, the median unless given; 0 for nothing."""
    chosen = np.flatnonzero(mask & (weights > 0))
    if not len(chosen):
        return 0.0
    order = chosen[np.argsort(values[chosen], kind="stable")]
    below = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(below, share * below[-1])]])


def even_points(n: int) -> tuple[FloatArray, FloatArray]:
    """Coordinates x, y >= 0, x + y <= 1 of n points, evenly over the triangle.

    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018 (R2).
    """
    k: FloatArray = np.arange(1.0, n + 1.0)
    x, y = k * 0.7548776662466927 % 1, k * 0.5698402909980532 % 1
    over = x + y > 1
    x[over], y[over] = 1 - x[over], 1 - y[over]
    return x, y


def clip_polygons(
    xy: FloatArray, starts: IntArray, values: FloatArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """Parts of convex polygons where an affine function, by its (C,) values at corners, is >= 0.

    Returns
    -------
    xy, starts : (D, 2) float64, (M + 1,) int64
        Parts with three corners or more.
    rows : (M,) int64
        Polygon of each.
    """
    n, after = len(starts) - 1, following(starts) if len(xy) else np.zeros(0, np.int64)
    is_kept, other = values >= 0, values[after]
    is_crossed = ((values > 0) & (other < 0)) | ((values < 0) & (other > 0))
    share = np.where(is_crossed, values / np.where(is_crossed, values - other, 1.0), 0.0)
    # Each corner that is kept, then where the side behind it is crossed.
    both = np.stack([xy, xy + share[:, None] * (xy[after] - xy)], axis=1).reshape(-1, 2)
    mask = np.stack([is_kept, is_crossed], axis=1)
    counts = np.bincount(np.repeat(np.arange(n), np.diff(starts)), mask.sum(axis=1), n)
    result, ends = both[mask.ravel()], starts_of(counts.astype(np.int64))
    rows = np.flatnonzero(counts >= 3)
    return (*choose_polygons(result, ends, rows), rows)


MOST_CORNERS = 20
"""Corners of a piece of regions."""


def with_few_corners(xy: FloatArray, starts: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Convex polygons in parts of `MOST_CORNERS` corners at most, and the polygon of each part."""
    parts: list[IntArray] = []
    counts = np.diff(starts)
    if counts.max(initial=0) <= MOST_CORNERS:
        return xy, starts, np.arange(len(counts))
    for first, count in zip(
        starts[:-1].tolist(), counts.tolist(), strict=True
    ):  # 1 us each, seldom
        if count <= MOST_CORNERS:
            parts.append(np.arange(first, first + count))
            continue
        for at in range(1, count - 1, MOST_CORNERS - 2):
            own = np.arange(at, min(at + MOST_CORNERS - 1, count))
            parts.append(first + np.append(0, own))
    corners = np.concatenate([*parts, np.zeros(0, np.int64)])
    ends = starts_of([len(each) for each in parts])
    polygon = np.searchsorted(starts, corners[ends[:-1]], side="right") - 1
    return xy[corners], ends, polygon
