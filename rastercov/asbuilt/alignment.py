"""Alignment of a mesh with a photograph by edges, and whether to believe it.

Poses around the start are compared by how well the edges that they predict agree with the
photograph, coarse to fine; the best are refined by distances to edges of the photograph, found
across each predicted edge, with weights that leave out what the mesh does not explain. Gradients
are averaged along edges first: light and dark keep their sides there.

A pose is believed where four things hold: its edges agree better than the same edges displaced
(200 poses), every other optimum agrees worse by more than chance, of these poses or piece by piece
of the edges, its covariance is small, and so are the steps to the poses of random halves of the
edges: where some places draw another way than the rest, or one place decides, halves lie apart.

Where the photograph shows few of the edges that a place has in a direction, those that it shows are
there by chance, such as of a texture: all of them count by that share.

Weights that leave out what disagrees hide errors of the pose too: what a place shows that is left
out, the residuals of the rest do not. So the pose is estimated again with weights that reach
farther; were the mesh right, both would estimate the same. Their difference, of twice the variance
of one, is a further error.

T. Drummond, R. Cipolla. Real-Time Visual Tracking of Complex Structures. 2002.
J. A. Hausman. Specification Tests in Econometrics. 1978.
J. A. Hartigan. Using Subsample Values as Typical Values. 1969.
"""

from dataclasses import dataclass, field

import numpy as np

from rastercov.asbuilt.edges import EdgePoints, MeshEdges, visible_points
from rastercov.asbuilt.photograph import DIRECTIONS, Gradients, Level, pyramid, sample, strength_of
from rastercov.asbuilt.resection import covariance_of as inverse_of
from rastercov.asbuilt.resection import (
    difference,
    displaced,
    free_of,
    jacobian_of,
    pixels_of,
    spread_of,
)
from rastercov.base import Float32Array, FloatArray, IntArray, dots, norm
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer

BASIN = np.array((np.radians(4),) * 3 + (0.06,) * 3)
"""Range around the start in which a pose is looked for.

Largest rotations about the axes, radians, and translations, as shares of the surface's distance.
"""
COARSEST = 150
"""Longer side of the coarsest level, px."""
FINEST = 1_600
"""Longer side of the finest level that is used, px."""
TRIED = 800
"""Poses compared at the coarsest level."""
STARTS = 24
"""Poses of these that are refined."""
KEPT = 6
"""Poses that are kept from each level."""
SHARE = 0.7
"""Part of the best pose's agreement below which another is not kept."""
BESIDE = (-5, 5)
"""Displacements of the best pose in each direction, px: parallel edges may be so far apart."""
BESIDE_POINT = 4
"""Points of an edge to each side over which its gradient is averaged."""
LEAST_STRENGTH = 1.8
"""Relative gradient of a single point above which it is an edge of the photograph."""
NEAR = 0.7
"""Standard deviation of the distance of an edge of the photograph from its prediction, px."""
FINAL, WIDE = 1.0, 2.5
"""Reaches of weights, px: of the pose, and of one that counts more of the edges that disagree."""
PLACES = 8
"""Squares along the longer side of a photograph; errors within one are taken as one."""
COMMON = 0.15
"""Standard deviation of the displacement that edges of a direction share, in a place and in all.

Of rendered photographs it is 0.11 px in a place and 0.06 px in all.
"""
MOST_SPREAD = 2 / 2.576
"""Largest deviation of a pixel of a pose that is believed, px: of 99 %, errors are below 2 px."""
DISPLACED = 200
"""Displaced poses by which chance is measured."""
HALVES = 50
"""Random halves of the places of a photograph."""


@dataclass(frozen=True)
class Optimum:
    """A pose at which edges agree best with a photograph.

    Attributes
    ----------
    pose : (4, 4) float64
        world_from_camera.
    covariance : (6, 6) float64
        As of `rastercov.asbuilt.resection.Fit`.
    score : float
        Mean agreement of the edges, 0 to 1.
    explained : float
        Share of the points of edges that lie on an edge of the photograph.
    spread : float
        Largest standard deviation of a pixel of the edges, by the covariance, px.
    """

    pose: FloatArray
    covariance: FloatArray
    score: float
    explained: float
    spread: float


@dataclass
class Aligner:
    """A mesh, a camera and a photograph, level by level."""

    mesh: Mesh
    camera: Camera
    grey: Float32Array
    edges: MeshEdges = field(init=False)
    levels: list[Level] = field(init=False)

    def __post_init__(self) -> None:
        self.edges = MeshEdges.of(self.mesh)
        levels = pyramid(self.grey, self.camera, COARSEST)
        self.levels = [each for each in levels if max(each.grey.shape) <= FINEST] or levels[:1]

    def points_at(self, level: Level, pose: FloatArray, step: float = 2.0) -> EdgePoints:
        """Visible points of edges in a pose, `step` px of a level apart."""
        with open_rasterizer(self.mesh, self.camera.resized(level.scale), "cpu") as rasterizer:
            return visible_points(self.edges, rasterizer, pose, step)

    def find(self, start: FloatArray) -> tuple[list[Optimum], float]:
        """Optima, and the distance of the surface that the edges are on, metres.

        Those that the edges fix come first, each by their scores.
        """
        coarse = self.levels[0]
        seen = self.points_at(coarse, start, 3.0)
        if len(seen) < 12:
            return [], 0.0
        distance = float(np.median(norm(seen.points - start[:3, 3])))
        rng = np.random.default_rng(0)
        steps = _steps(distance, TRIED, rng) * rng.uniform(0, 1, (TRIED, 1))
        steps[0] = 0
        steps[:, free_of(self.camera) :] = 0
        tried = displaced(start, steps)
        poses = sorted(tried, key=lambda pose: -likeness(coarse, seen, pose))[:STARTS]
        finer = self.levels[1:] or self.levels
        for level in finer:
            poses = self._refine_level(level, poses)
        poses = self._refine_level(finer[-1], poses + self._beside(poses[0]))
        found = [self._judge(pose) for pose in poses]
        found.sort(key=lambda each: (not each.spread <= MOST_SPREAD, -each.score))
        return found, distance

    def _beside(self, pose: FloatArray) -> list[FloatArray]:
        """Poses beside one in each direction of its covariance, where a better one may hide."""
        covariance = self._judge(pose).covariance
        if not np.isfinite(covariance).all():
            return []
        scale = np.sqrt(np.diag(covariance))
        steps = np.linalg.eigh(covariance / np.outer(scale, scale))[1].T * scale
        points = self.points_at(self.levels[-1], pose, 4.0).points
        sizes = [spread_of(np.outer(one, one), points, self.camera, pose) for one in steps]
        units = steps / np.array(sizes)[:, None]
        return [displaced(pose, away * unit) for unit in units for away in BESIDE]

    def _refine_level(self, level: Level, poses: list[FloatArray]) -> list[FloatArray]:
        """Poses refined at a level, the best of those that differ, best first."""
        refined = []
        for pose in poses:
            for step, reach in ((4.0, 5.0), (2.0, 3.0)):
                points = self.points_at(level, pose, step)
                pose = refine(level, points, pose, reach)
            refined.append((agreement(level, points, pose), pose, points))
        refined.sort(key=lambda each: -each[0])
        best: list[FloatArray] = []
        for score, pose, points in refined:
            apart = [self._apart(points, pose, other) * level.scale for other in best]
            if score >= SHARE * refined[0][0] and min(apart, default=np.inf) > 1.0:
                best.append(pose)
        return best[:KEPT]

    def _apart(self, points: EdgePoints, pose: FloatArray, other: FloatArray) -> float:
        """Typical distance of the images of points in two poses, px of the photograph."""
        first = pixels_of(points.points, self.camera, pose)
        moved = norm(first - pixels_of(points.points, self.camera, other))
        return float(np.nanquantile(moved, 0.9)) if np.isfinite(moved).any() else np.inf

    def _judge(self, pose: FloatArray) -> Optimum:
        """Agreement and covariance of a pose, refined with weights of the least reach."""
        level = self.levels[-1]
        points = self.points_at(level, pose)
        pose = refine(level, points, pose, FINAL)
        matches = Matches.of(level, points, pose, FINAL)
        wide = difference(pose, refine(level, points, pose, WIDE, WIDE)) / 2**0.5
        covariance = covariance_of(level, points, pose, matches) + np.outer(wide, wide)
        return Optimum(
            pose,
            covariance,
            agreement(level, points, pose),
            np.count_nonzero(matches.strength) / max(len(points), 1),
            spread_of(covariance, points.points, self.camera, pose),
        )

    def chance(self, pose: FloatArray, distance: float) -> FloatArray:
        """Agreement of the edges of a pose, seen from `DISPLACED` others around it."""
        level = self.levels[-1]
        points = self.points_at(level, pose)
        steps = 1.5 * _steps(distance, DISPLACED, np.random.default_rng(1))
        return np.array([agreement(level, points, each) for each in displaced(pose, steps)])

    def by_halves(self, pose: FloatArray) -> float:
        """Pixels from a pose within which 95 % of those by random halves of the places lie."""
        level = self.levels[-1]
        points = self.points_at(level, pose)
        places = Matches.of(level, points, pose, FINAL).group // 4 % PLACES**2  # of the border, too
        rng = np.random.default_rng(2)
        moved = []
        for is_kept in rng.random((HALVES, PLACES**2)) < 0.5:
            half = refine(level, points.take(is_kept[places]), pose, WIDE, WIDE)
            step = difference(pose, half)
            moved.append(spread_of(np.outer(step, step), points.points, self.camera, pose))
        return float(np.quantile(moved, 0.95))

    def lead(self, pose: FloatArray, rival: FloatArray) -> float:
        """Standard deviations by which edges lie closer to the photograph's in the first pose.

        Edges are compared piece by piece, an eighth of the photograph each.
        """
        seen = self.points_at(self.levels[-1], pose)
        found = [Matches.of(self.levels[-1], seen, at, WIDE) for at in (pose, rival)]
        first, second = (
            each.strength * np.exp(-0.5 * (each.distance / NEAR) ** 2) for each in found
        )
        pieces = seen.edge * 4 * PLACES**2 + found[0].group
        sums = _sums((first - second)[:, None], pieces)
        return float(sums.sum() / np.sqrt((sums**2).sum() + 1e-300))


def _steps(distance: float, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 6) random rotation vectors and translations of the basin, in camera axes."""
    return rng.uniform(-1, 1, (count, 6)) * BASIN * np.array((1, 1, 1, *[distance] * 3))


def _sums(values: FloatArray, group: IntArray) -> FloatArray:
    """Sums of the rows of values (N, K) by group."""
    _, number = np.unique(group, return_inverse=True)
    sums = np.zeros((int(number.max(initial=-1)) + 1, values.shape[1]))
    np.add.at(sums, number, values)
    return sums


def _along(values: Gradients, edge: IntArray) -> tuple[Gradients, IntArray]:
    """Means of values (N, K) over up to 2 `BESIDE_POINT` + 1 points of an edge, and their number.

    Light and dark keep their sides along an edge; noise and textures do not.
    """
    n = len(edge)
    place = np.arange(n)
    starts = np.flatnonzero(np.diff(edge, prepend=-1))
    run = np.searchsorted(starts, place, side="right")
    low = np.maximum(place - BESIDE_POINT, starts[run - 1])
    high = np.minimum(place + BESIDE_POINT + 1, np.append(starts, n)[run])
    total = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    count = high - low
    return (total[high] - total[low]) / count[:, None], count


def directions_of(
    level: Level, points: EdgePoints, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels (N, 2) of points at a level, and unit normals (N, 2) of their edges.

    Points without a pixel, or a normal, lie outside of the image, and have the normal 0.
    """
    away = norm(points.points - pose[:3, 3])[..., None]
    pixels = pixels_of(points.points, level.camera, pose)
    ahead = pixels_of(points.points + points.tangents * (1e-4 * away), level.camera, pose)
    along = ahead - pixels
    length = norm(along)[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.stack((-along[:, 1], along[:, 0]), axis=1) / length
    usable = np.isfinite(dots(normals + pixels, (1, 1)))[:, None]
    return np.where(usable, pixels * level.scale, -9), np.where(usable, normals, 0)


def _turns(normals: FloatArray, count: int) -> IntArray:
    """Angles (N,) of normals from +x in half turns divided by `count`, to the nearest."""
    x, y = normals.T
    return np.rint(np.arctan2(y, x) / np.pi * count).astype(np.int64)


def likeness(level: Level, points: EdgePoints, pose: FloatArray) -> float:
    """Mean strength, 0 to 1, of the photograph's edges near predicted ones, in their directions."""
    pixels, normals = directions_of(level, points, pose)
    h, w = level.grey.shape
    inside = np.all((pixels >= 0) & (pixels < (w, h)), axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(np.int64).T
    direction = _turns(normals, DIRECTIONS) % DIRECTIONS
    return float((level.channels[direction, row, column] * inside).sum()) / max(len(points), 1)


def agreement(level: Level, points: EdgePoints, pose: FloatArray) -> float:
    """Mean strength, 0 to 1, of the photograph's edges on predicted ones, in their directions."""
    pixels, normals = directions_of(level, points, pose)
    turned = sample(level.gradient, pixels[:, None]) * dots(normals, (1, -1j))[:, None]
    mean = _along(turned, points.edge)[0]
    return float(strength_of(mean).sum(dtype=np.float64)) / max(len(points), 1)


@dataclass(frozen=True)
class Matches:
    """Edges of the photograph across predicted ones.

    Attributes
    ----------
    normals : (N, 2) float64
        Unit normals of predicted edges.
    distance : (N,) float64
        Signed distance of the photograph's edge along the normal, px of the level.
    strength : (N,) float64
        Relative strength of it, 0 where there is none, times the share of the points of its group
        that have one: where few have, they have it by chance.
    group : (N,) int64
        Number of the edges of a place, an eighth of the photograph, that have one direction.
    """

    normals: FloatArray
    distance: FloatArray
    strength: FloatArray
    group: IntArray

    @classmethod
    def of(cls, level: Level, points: EdgePoints, pose: FloatArray, reach: float) -> "Matches":
        """The edge near each point that has the most weight within `reach` px."""
        pixels, normals = directions_of(level, points, pose)
        n = int(np.ceil(reach)) + 1
        offsets = np.arange(-n, n + 1.0)
        found = sample(level.gradient, pixels[:, None] + normals[:, None] * offsets[:, None])
        turned, n_points = _along(found * dots(normals, (1, -1j))[:, None], points.edge)
        across = np.abs(turned.real)
        profile = np.where(np.abs(turned.imag) < 0.7 * across, across, 0)
        inner = profile[:, 1:-1]
        is_peak = (inner >= profile[:, :-2]) & (inner > profile[:, 2:])
        is_edge = inner > LEAST_STRENGTH / np.sqrt(n_points)[:, None]
        value = np.where(is_peak & is_edge, inner, 0)
        best = (value * _weight(offsets[1:-1], reach)).argmax(axis=1)
        rows = np.arange(len(best))
        left, middle, right = profile[rows, best], profile[rows, best + 1], profile[rows, best + 2]
        bend = left - 2 * middle + right
        shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0)
        distance = offsets[1:-1][best] + np.clip(shift, -0.5, 0.5)
        strength = np.minimum(value[rows, best] / 4, 1)
        column, row = (pixels * PLACES / max(level.grey.shape)).astype(np.int64).T
        group = (row * PLACES + column) * 4 + _turns(normals, 4) % 4
        _, number, size = np.unique(group, return_inverse=True, return_counts=True)
        share = np.bincount(number, strength > 0) / size
        return cls(normals, distance, strength * share[number], group)


def refine(
    level: Level,
    points: EdgePoints,
    pose: FloatArray,
    reach: float,
    least: float = FINAL,
) -> FloatArray:
    """Pose moved so that predicted edges lie on those of the photograph: Tukey's weights.

    Their reach falls to the least one, px.
    """
    for _ in range(8):
        matches = Matches.of(level, points, pose, reach)
        rows, jacobian, weights = _equations(level, points, pose, matches, reach)
        if len(rows) < 12:
            return pose
        weighted = jacobian * weights[:, None]
        square = np.einsum("ni,nj->ij", weighted, jacobian)  # threads of BLAS wait at work
        slope = dots(weighted.T, matches.distance[rows])
        step = np.linalg.lstsq(square + 1e-6 * np.diag(np.diag(square)), slope, rcond=None)[0]
        pose = displaced(pose, step)
        if np.abs(dots(jacobian, step)).max(initial=0) < 0.02:
            break
        reach = max(reach * 0.8, least)
    return pose


def _weight(distance: FloatArray, reach: float) -> FloatArray:
    """Tukey's weights of distances, px."""
    return np.asarray(np.maximum(1 - (distance / (1.2 * reach)) ** 2, 0) ** 2)


def _equations(
    level: Level,
    points: EdgePoints,
    pose: FloatArray,
    matches: Matches,
    reach: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Rows (M,) of matches that are used, derivatives (M, 6) of their distances, weights (M,)."""
    weights = _weight(matches.distance, reach) * matches.strength
    rows = np.flatnonzero(weights > 0)
    moved = jacobian_of(points.points[rows], level.camera, pose)
    jacobian = np.einsum("nij,ni->nj", moved, matches.normals[rows]) * level.scale
    usable = np.isfinite(jacobian).all(axis=1)
    return rows[usable], jacobian[usable], weights[rows[usable]]


def covariance_of(
    level: Level, points: EdgePoints, pose: FloatArray, matches: Matches
) -> FloatArray:
    """Covariance (6, 6) of a refined pose; errors of one direction in one place count as one.

    H^-1 (sum over places of g g^T + s^2 (n n^T + N N^T)) H^-1, where g is the sum of the weighted
    residuals of a place, an eighth of the photograph, n that of residuals of 1 px, N that of all
    places (light from one side shifts all edges of a direction), and s is `COMMON`. Of parallel
    rays the distance is open: its variance is inf.
    """
    rows, jacobian, weights = _equations(level, points, pose, matches, FINAL)
    if len(rows) < 12:
        return np.diag(np.full(6, np.inf))
    slopes = jacobian * weights[:, None]
    inverse = inverse_of(jacobian * np.sqrt(weights)[:, None], pose, points.points[rows])
    unknown = np.isinf(np.diag(inverse))
    inverse[unknown, unknown] = 0
    turn, group = _turns(matches.normals[rows], 4), matches.group[rows]
    residuals = slopes * matches.distance[rows, None]
    shifted = COMMON * slopes * (1 - turn // 4 % 2 * 2)[:, None]
    sums = [_sums(residuals, group), _sums(shifted, group), _sums(shifted, turn % 4)]
    parts = np.concatenate(sums) @ inverse
    out = parts.T @ parts
    out[unknown, unknown] = np.inf
    return out
