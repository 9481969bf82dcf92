"""Alignment of a mesh with a photograph by edges, and whether to believe it.

Poses around the start are compared by how well the edges that they predict agree with the
photograph, coarse to fine; the best are refined by distances to edges of the photograph, found
across each predicted edge, with weights that leave out what the mesh does not explain.

A pose is believed where three things hold: its edges agree better than the same edges displaced
(200 poses), every other optimum agrees worse by more than chance, of these poses or edge by edge,
and its covariance is small.

T. Drummond, R. Cipolla. Real-Time Visual Tracking of Complex Structures. 2002.
"""

from dataclasses import dataclass, field

import numpy as np

from rastercov.asbuilt.edges import EdgePoints, MeshEdges, visible_points
from rastercov.asbuilt.photograph import DIRECTIONS, Level, pyramid, sample
from rastercov.asbuilt.resection import displaced, jacobian_of, pixels_of, spread_of
from rastercov.base import BoolArray, Float32Array, FloatArray, IntArray, norm, sort_order
from rastercov.core.camera import Camera
from rastercov.core.camera.projection import to_camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import open_rasterizer

COARSEST = 150
"""Longer side of the coarsest level, px."""
FINEST = 1_600
"""Longer side of the finest level that is used, px."""
TRIED = 400
"""Poses compared at the coarsest level."""
KEPT = (24, 10, 5, 4, 4, 4)
"""Poses that are kept from each level."""
BESIDE = (-12, -5, 5, 12)
"""Displacements of the best pose in the direction that it fixes least, px."""
DISPLACED = 200
"""Displaced poses by which chance is measured."""


@dataclass(frozen=True)
class Basin:
    """Range around the start in which a pose is looked for.

    Attributes
    ----------
    angle : float
        Largest rotation about each axis, radians.
    share : float
        Largest translation along each axis, as a share of the distance of the surface.
    """

    angle: float
    share: float

    def steps(self, distance: float, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, 6) random rotation vectors and translations, in camera axes."""
        scale = np.array((self.angle,) * 3 + (self.share * distance,) * 3)
        return rng.uniform(-1, 1, (count, 6)) * scale


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


@dataclass(frozen=True)
class Chance:
    """Scores of displaced edges.

    Attributes
    ----------
    mean, deviation : float
    largest : float
    """

    mean: float
    deviation: float
    largest: float

    def z(self, score: float) -> float:
        """Deviations of a score above chance."""
        return (score - self.mean) / max(self.deviation, 1e-9)


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
        levels = pyramid(self.grey, COARSEST)
        self.levels = [each for each in levels if max(each.grey.shape) <= FINEST] or levels[:1]

    def points_at(self, level: Level, pose: FloatArray, step: float) -> EdgePoints:
        """Visible points of edges in a pose, `step` px of a level apart."""
        with open_rasterizer(self.mesh, self.camera.resized(level.scale), "cpu") as rasterizer:
            return visible_points(self.edges, rasterizer, pose, step)

    def find(self, start: FloatArray, basin: Basin) -> tuple[list[Optimum], float]:
        """Optima, best first, and the distance of the surface that the edges are on, metres."""
        coarse = self.levels[0]
        seen = self.points_at(coarse, start, 1.5)
        if len(seen) < 12:
            return [], 0.0
        distance = float(np.median(norm(to_camera(seen.points, start))))
        rng = np.random.default_rng(0)
        steps = basin.steps(distance, TRIED, rng)
        steps[0] = 0
        steps[:, _free(self.camera) :] = 0
        poses = [displaced(start, step) for step in steps]
        scores = [agreement(coarse, self.camera, seen, pose) for pose in poses]
        order = sort_order(scores)[::-1][: KEPT[0]]
        poses = [poses[row] for row in order.tolist()]
        for number, level in enumerate(self.levels):
            if number == len(self.levels) - 1:
                poses += self._beside(level, poses[0])
            poses = self._refine_level(level, poses, KEPT[min(number, len(KEPT) - 1)])
        return [self._judge(self.levels[-1], pose) for pose in poses], distance

    def _beside(self, level: Level, pose: FloatArray) -> list[FloatArray]:
        """Poses beside one in the direction that it fixes least, where a better one may hide."""
        found = self._judge(level, pose)
        if not np.isfinite(found.covariance).all():
            return []
        scale = np.sqrt(np.diag(found.covariance))
        values, axes = np.linalg.eigh(found.covariance / np.outer(scale, scale))
        weakest = axes[:, -1] * np.sqrt(values[-1]) * scale / found.spread
        return [displaced(pose, away * weakest) for away in BESIDE]

    def _refine_level(self, level: Level, poses: list[FloatArray], kept: int) -> list[FloatArray]:
        """Poses refined at a level, the best of those that differ, best first."""
        refined = []
        for pose in poses:
            points = self.points_at(level, pose, 2.0)
            moved = refine(level, self.camera, points, pose, 5.0)
            points = self.points_at(level, moved, 2.0)
            moved = refine(level, self.camera, points, moved, 3.0)
            refined.append((agreement(level, self.camera, points, moved), moved, points))
        refined.sort(key=lambda each: -each[0])
        best: list[FloatArray] = []
        for _, pose, points in refined:
            if all(self._apart(points, pose, other) * level.scale > 1.0 for other in best):
                best.append(pose)
        return best[:kept]

    def _apart(self, points: EdgePoints, pose: FloatArray, other: FloatArray) -> float:
        """Typical distance of the images of points in two poses, px of the photograph."""
        if not len(points):
            return np.inf
        first = pixels_of(points.points, self.camera, pose)
        moved = norm(first - pixels_of(points.points, self.camera, other))
        return float(np.nanquantile(moved, 0.9)) if np.isfinite(moved).any() else np.inf

    def _judge(self, level: Level, pose: FloatArray) -> Optimum:
        """Agreement and covariance of a pose at the finest level."""
        points = self.points_at(level, pose, 2.0)
        matches = Matches.of(level, self.camera, points, pose, 3.0)
        score = agreement(level, self.camera, points, pose)
        good = matches.is_found & (np.abs(matches.distance) < 1.5)
        covariance = covariance_of(level, self.camera, points, pose, matches)
        return Optimum(
            pose,
            covariance,
            score,
            float(good.mean()) if len(good) else 0.0,
            spread_of(covariance, points.points, self.camera, pose),
        )

    def chance(self, pose: FloatArray, distance: float) -> Chance:
        """Agreement of the edges of a pose, seen from `DISPLACED` others around it."""
        level = self.levels[-1]
        points = self.points_at(level, pose, 2.0)
        rng = np.random.default_rng(1)
        scores: list[float] = []
        while len(scores) < DISPLACED:
            for step in Basin(np.radians(6), 0.08).steps(distance, DISPLACED, rng):
                other = displaced(pose, step)
                if self._apart(points, pose, other) * level.scale > 8:
                    scores.append(agreement(level, self.camera, points, other))
        values = np.array(scores[:DISPLACED])
        return Chance(float(values.mean()), float(values.std()), float(values.max()))

    def lead(self, pose: FloatArray, rival: FloatArray) -> float:
        """Standard deviations by which the edges of two poses agree better with the first."""
        level, gains, edges = self.levels[-1], [], []
        for seen in (pose, rival):
            points = self.points_at(level, seen, 2.0)
            first, other = [strengths(level, self.camera, points, at) for at in (pose, rival)]
            gains.append((first - other) / max(len(points), 1))
            edges.append(points.edge)
        sums = _sums(np.concatenate(gains)[:, None], np.concatenate(edges))
        return float(sums.sum() / np.sqrt((sums**2).sum() + 1e-300))


def _free(camera: Camera) -> int:
    """Parameters of a pose that change the picture: five of parallel rays, the last is distance."""
    return 5 if camera.is_parallel else 6


def _sums(values: FloatArray, group: IntArray) -> FloatArray:
    """Sums of the rows of values (N, K) by group."""
    _, number = np.unique(group, return_inverse=True)
    sums = np.zeros((int(number.max(initial=-1)) + 1, values.shape[1]))
    np.add.at(sums, number, values)
    return sums


def directions_of(
    level: Level, camera: Camera, points: EdgePoints, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels (N, 2) of points at a level, and unit normals (N, 2) of their edges; NaN outside."""
    local = norm(to_camera(points.points, pose))[..., None]
    pixels = pixels_of(points.points, camera, pose)
    ahead = pixels_of(points.points + points.tangents * (1e-4 * local), camera, pose)
    along = ahead - pixels
    length = norm(along)[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        along = along / length
    return pixels * level.scale, np.stack((-along[:, 1], along[:, 0]), axis=1)


def agreement(level: Level, camera: Camera, points: EdgePoints, pose: FloatArray) -> float:
    """Mean of `strengths`; 0 without points."""
    return float(strengths(level, camera, points, pose).sum()) / max(len(points), 1)


def strengths(level: Level, camera: Camera, points: EdgePoints, pose: FloatArray) -> FloatArray:
    """Strengths (N,) of the photograph's edges under predicted ones, in their directions."""
    pixels, normals = directions_of(level, camera, points, pose)
    h, w = level.grey.shape
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels < (w, h)), axis=1) & np.isfinite(normals[:, 0])
    column, row = np.where(inside[:, None], pixels, 0).astype(np.int64).T
    x, y = np.where(inside[:, None], normals, 0).T
    direction = np.rint(np.arctan2(y, x) / np.pi * DIRECTIONS).astype(np.int64) % DIRECTIONS
    return np.asarray(level.channels[direction, row, column] * inside, np.float64)


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
        Relative strength of it, 0 where there is none.
    is_found : (N,) bool
    """

    normals: FloatArray
    distance: FloatArray
    strength: FloatArray
    is_found: BoolArray

    @classmethod
    def of(
        cls, level: Level, camera: Camera, points: EdgePoints, pose: FloatArray, reach: float
    ) -> "Matches":
        """The strongest edge within `reach` px of each point, nearer ones preferred."""
        pixels, normals = directions_of(level, camera, points, pose)
        usable = np.all(np.isfinite(np.hstack((normals, pixels))), axis=1)
        pixels, normals = (
            np.where(usable[:, None], pixels, -9),
            np.where(usable[:, None], normals, 0),
        )
        n = int(np.ceil(reach * 2)) + 1
        offsets = np.arange(-n, n + 1) / 2
        found = sample(level.gradient, pixels[:, None] + normals[:, None] * offsets[:, None])
        turned = found * (normals @ (1, -1j))[:, None]
        along = np.abs(turned.real)
        profile = np.where(np.abs(turned.imag) < 0.7 * along, along, 0)
        is_peak = (profile[:, 1:-1] >= profile[:, :-2]) & (profile[:, 1:-1] > profile[:, 2:])
        value = np.where(is_peak & (profile[:, 1:-1] > 1.2), profile[:, 1:-1], 0)
        preferred = value * (1 - 0.5 * np.abs(offsets[1:-1]) / offsets[-2])
        best = preferred.argmax(axis=1)
        rows = np.arange(len(best))
        left, middle, right = profile[rows, best], profile[rows, best + 1], profile[rows, best + 2]
        bend = left - 2 * middle + right
        shift = np.where(bend < 0, 0.5 * (left - right) / np.minimum(bend, -1e-9), 0)
        distance = offsets[1:-1][best] + np.clip(shift, -0.5, 0.5) / 2
        strength = value[rows, best] * usable
        return cls(normals, distance, np.minimum(strength / 4, 1), strength > 0)


def refine(
    level: Level, camera: Camera, points: EdgePoints, pose: FloatArray, reach: float
) -> FloatArray:
    """Pose moved so that predicted edges lie on those of the photograph: Tukey's weights."""
    if len(points) < 12:
        return pose
    for _ in range(8):
        matches = Matches.of(level, camera, points, pose, reach)
        rows, weights = _weighted(matches, reach)
        if len(rows) < 12:
            return pose
        jacobian = _jacobian(level, camera, points.take(rows), pose, matches.normals[rows])
        usable = np.isfinite(jacobian).all(axis=1)
        jacobian, weights = jacobian[usable], weights[usable]
        distance = matches.distance[rows][usable]
        square = jacobian.T @ (jacobian * weights[:, None])
        slope = jacobian.T @ (distance * weights)
        step = np.linalg.lstsq(square + 1e-6 * np.diag(np.diag(square)), slope, rcond=None)[0]
        pose = displaced(pose, np.asarray(step, np.float64))
        if np.abs(jacobian @ step).max(initial=0) < 0.02:
            break
        reach = max(reach * 0.8, 1.5)
    return pose


def _weighted(matches: Matches, reach: float) -> tuple[IntArray, FloatArray]:
    """Rows of matches that are used, and their weights."""
    limit = reach * 1.2
    inside = 1 - (matches.distance / limit) ** 2
    weights = np.where(matches.is_found, np.maximum(inside, 0) ** 2 * matches.strength, 0)
    rows = np.flatnonzero(weights > 0)
    return rows, weights[rows]


def _jacobian(
    level: Level, camera: Camera, points: EdgePoints, pose: FloatArray, normals: FloatArray
) -> FloatArray:
    """Derivatives (N, 6) of places across edges, px of the level, by steps of `displaced`."""
    moved = jacobian_of(points.points, camera, pose)
    return np.asarray((moved * normals[:, :, None]).sum(axis=1) * level.scale)


def covariance_of(
    level: Level, camera: Camera, points: EdgePoints, pose: FloatArray, matches: Matches
) -> FloatArray:
    """Covariance (6, 6) of a refined pose; errors of one direction in one place count as one.

    H^-1 (sum over places of g g^T) H^-1, where g is the sum of the weighted residuals of a place,
    an eighth of the photograph. Of parallel rays the distance is open: its variance is inf.
    """
    rows, weights = _weighted(matches, 3.0)
    free = _free(camera)
    out = np.diag(np.full(6, np.inf))
    if len(rows) < 12:
        return out
    normals = matches.normals[rows]
    jacobian = _jacobian(level, camera, points.take(rows), pose, normals)[:, :free]
    usable = np.isfinite(jacobian).all(axis=1)
    jacobian, weights = jacobian[usable], weights[usable]
    rows, normals = rows[usable], normals[usable]
    square = jacobian.T @ (jacobian * weights[:, None])
    scale = np.sqrt(np.diag(square))
    if not (scale > 0).all():
        return out
    scaled = square / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e10:
        return out
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    pixels = pixels_of(points.points[rows], camera, pose)
    place = (pixels * (8 / max(camera.width, camera.height))).astype(np.int64)
    turn = np.rint(np.arctan2(normals[:, 1], normals[:, 0]) / np.pi * 4).astype(np.int64) % 4
    sums = _sums(jacobian * (weights * matches.distance[rows])[:, None], place @ (32, 4) + turn)
    out[:free, :free] = inverse @ (sums.T @ sums) @ inverse
    return out
