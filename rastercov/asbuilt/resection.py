"""Resection: the pose of a camera from pixels of known points.

The sum of Huber's function of the reprojection errors is minimised over rotation and translation
(six parameters; five for parallel rays, whose pixels do not depend on the distance), by
Levenberg's and Marquardt's steps with weights. It starts from the pose of the plan and from poses
of three points each (P3P), whose consensus says which pairs are wrong.

    minimise over p   sum_i rho(|u_i - project(p, x_i)| / sigma)

    covariance of p   (J^T J)^-1 sigma^2

where sigma is the expected error of a pixel, or the larger one that the residuals show (a test of
the variance at 1 %).

J. A. Grunert. Das Pothenotische Problem in erweiterter Gestalt. 1841.
P. J. Huber. Robust Estimation of a Location Parameter. 1964.
M. A. Fischler, R. C. Bolles. Random Sample Consensus. 1981.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray, norm, sort_order
from rastercov.core.camera import Camera, from_vectors
from rastercov.core.camera.projection import rays_of, to_camera, to_image
from rastercov.core.mesh.arrays import quaternions_of

HUBER = 2.0
"""Residual, in standard deviations, beyond which Huber's function is linear.

Of normal errors in two coordinates the variance is 1.8 % above the least, within that of `Fit`.
"""
WRONG = 4.0
"""Residual, in standard deviations, beyond which a pair counts as wrong."""
STEPS = 60
"""Most steps of an optimisation."""
SETS = 300
"""Most sets of three points from which poses are computed."""
LEAST_PAIRS = 4
"""Pairs of a pixel and a point below which there is no pose: one more than determine it."""
VARIANCE_QUANTILE = 2.326
"""Of the normal distribution at 1 %, for the test of the variance."""


@dataclass(frozen=True)
class Fit:
    """An optimum of a resection.

    Attributes
    ----------
    pose : (4, 4) float64
        world_from_camera.
    covariance : (6, 6) float64
        Of rotation (radians) and translation (metres), in camera axes; inf where nothing is known.
    residuals : (N, 2) float64
        Pixel found minus pixel given, px; NaN where the lens has no pixel for the point.
    is_inlier : (N,) bool
    cost : float
        Sum of Huber's function, in units of sigma^2.
    """

    pose: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    is_inlier: BoolArray
    cost: float


def displaced(pose: FloatArray, step: FloatArray) -> FloatArray:
    """Pose, or poses, after a step (..., 6): rotation vector, radians, translation, metres.

    Both are in camera axes.
    """
    moved = from_vectors(step[..., :3], step[..., 3:])
    return np.asarray(pose @ moved.reshape(*step.shape[:-1], 4, 4))


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, the inverse of `from_vectors`."""
    scalar, *vector = quaternions_of(matrix[None])[0]
    sine = float(norm(vector))
    angle = 2 * np.arctan2(sine, abs(scalar))
    return np.array(vector) * np.copysign(angle / sine if sine else 2.0, scalar)


def difference(pose: FloatArray, other: FloatArray) -> FloatArray:
    """Step (6,) from a pose to another one near it, the inverse of `displaced`."""
    back = pose[:3, :3].T
    return np.concatenate(
        (rotation_vector(back @ other[:3, :3]), back @ (other[:3, 3] - pose[:3, 3]))
    )


def pixels_of(points: FloatArray, camera: Camera, pose: FloatArray) -> FloatArray:
    """Pixels (..., 2) of world points (..., 3); NaN behind a pinhole and outside a lens."""
    return pixels_in_axes(to_camera(points, pose), camera)


def pixels_in_axes(local: FloatArray, camera: Camera) -> FloatArray:
    """Pixels (..., 2), as of `pixels_of`, of points (..., 3) in camera axes."""
    with np.errstate(all="ignore"):
        pixels = to_image(local, camera)
    if camera.is_pinhole and not camera.is_parallel:
        pixels[local[..., 2] <= 0] = np.nan
    return pixels


def free_of(camera: Camera) -> int:
    """Parameters of a pose that change the picture: five of parallel rays, the last is distance."""
    return 5 if camera.is_parallel else 6


def fit(
    points: FloatArray, pixels: FloatArray, camera: Camera, starts: FloatArray, sigma: float
) -> list[Fit]:
    """Optima from several starts, best first, each once.

    Parameters
    ----------
    points, pixels : (N, 3), (N, 2) float64
        Pairs of points of the world, metres, and their pixels.
    camera : Camera
    starts : (S, 4, 4) float64
        Poses to start from, world_from_camera.
    sigma : float
        Expected standard deviation of a coordinate of a pixel, px.
    """
    found = (_fit_from(points, pixels, camera, start, sigma) for start in starts)
    optima: list[Fit] = []
    for each in sorted(
        (one for one in found if one is not None),
        key=lambda one: (-int(one.is_inlier.sum()), one.cost),
    ):
        if all(distance(each.pose, other.pose, points) > 1e-4 for other in optima):
            optima.append(each)
    return optima


def distance(pose: FloatArray, other: FloatArray, points: FloatArray) -> float:
    """Largest displacement of points (N, 3) between two poses, relative to their distance."""
    local = to_camera(points, pose)
    length = float(norm(local).max())
    return float(np.abs(local - to_camera(points, other)).max()) / length


def _fit_from(
    points: FloatArray, pixels: FloatArray, camera: Camera, start: FloatArray, sigma: float
) -> Fit | None:
    """Optimum of all pairs, and then of those that are not wrong; None where it has no pixels."""
    is_inlier = np.ones(len(points), bool)
    pose = start
    for _ in range(4):
        kept = np.flatnonzero(is_inlier)
        pose = minimise(points[kept], pixels[kept], camera, pose, sigma)
        errors = pixels_of(points, camera, pose) - pixels
        lengths = norm(errors)
        if not np.isfinite(lengths[kept]).all():
            return None
        now = lengths <= WRONG * sigma
        if now.sum() < LEAST_PAIRS or (now == is_inlier).all():
            break
        is_inlier = now
    jacobian = jacobian_of(points[is_inlier], camera, pose).reshape(-1, 6)
    freedom = 2 * int(is_inlier.sum()) - free_of(camera)
    variance = float((errors[is_inlier] ** 2).sum()) / freedom
    part = 2 / (9 * freedom)  # Wilson and Hilferty
    limit = (1 - part + VARIANCE_QUANTILE * np.sqrt(part)) ** 3
    found = variance if variance > sigma**2 * limit else sigma**2
    return Fit(
        pose,
        covariance_of(jacobian, pose, points) * found,
        errors,
        is_inlier,
        _cost(errors, sigma),
    )


def covariance_of(jacobian: FloatArray, pose: FloatArray, points: FloatArray) -> FloatArray:
    """Inverse of J^T J, (6, 6), with inf in the directions that J does not determine.

    Translations are scaled by the distance of the points first, so that ranks mean something.
    """
    length = float(norm(points - pose[:3, 3]).mean())
    scale = np.array((1, 1, 1, length, length, length))
    _, values, axes = np.linalg.svd(jacobian * scale, full_matrices=False)
    known = values > 1e-7 * values[0]
    inverse = np.zeros(len(values))
    inverse[known] = values[known] ** -2.0
    out = (axes.T * inverse) @ axes
    unknown = (axes[~known] ** 2).sum(axis=0) > 1e-9
    out[unknown] = out[:, unknown] = 0
    out[unknown, unknown] = np.inf
    return np.asarray(out * np.outer(scale, scale))


def spread_of(
    covariance: FloatArray, points: FloatArray, camera: Camera, pose: FloatArray
) -> float:
    """Largest standard deviation of the pixels of points (N, 3) by the covariance of a pose, px."""
    parts = jacobian_of(points, camera, pose)
    unknown = ~np.isfinite(np.diag(covariance))
    covariance = np.where(np.isfinite(covariance), covariance, 0)
    if np.abs(parts[..., unknown]).max(initial=0) > 1e-6:
        return np.inf
    parts = parts[np.isfinite(parts).all(axis=(1, 2))]
    squares = parts @ covariance @ parts.transpose(0, 2, 1)
    return float(np.sqrt(max(np.linalg.eigvalsh(squares).max(initial=0), 0)))


def jacobian_of(points: FloatArray, camera: Camera, pose: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 6) of the pixels of points by steps of `displaced`, by differences."""
    local = to_camera(points, pose)
    size = 1e-6 * norm(local)[..., None]
    ends = [
        pixels_in_axes(local + size * axis, camera) for axis in np.vstack((np.eye(3), -np.eye(3)))
    ]
    slopes = np.stack([(ends[k] - ends[k + 3]) / (2 * size) for k in range(3)], axis=-1)
    return np.concatenate((np.cross(slopes, local[:, None]), -slopes), axis=-1)


def minimise(
    points: FloatArray, pixels: FloatArray, camera: Camera, start: FloatArray, sigma: float
) -> FloatArray:
    """Pose at which the sum of Huber's function has a minimum, by weighted, damped steps."""
    pose, damping = start, 1e-3
    errors = pixels_of(points, camera, pose) - pixels
    cost = _cost(errors, sigma)
    for _ in range(STEPS):
        lengths = norm(errors) / sigma
        weights = np.repeat(np.minimum(1, HUBER / np.maximum(lengths, 1e-12)), 2)
        jacobian = jacobian_of(points, camera, pose).reshape(-1, 6)
        if not np.isfinite(jacobian).all() or not np.isfinite(cost):
            return pose
        square = jacobian.T @ (jacobian * weights[:, None])
        slope = jacobian.T @ (errors.ravel() * weights)
        diagonal = np.diag(square) + 1e-12 * np.trace(square)
        while True:
            step = np.linalg.lstsq(square + damping * np.diag(diagonal), -slope, rcond=None)[0]
            next_pose = displaced(pose, step)
            next_errors = pixels_of(points, camera, next_pose) - pixels
            gain = cost - _cost(next_errors, sigma)
            if gain > 0:
                break
            damping *= 10
            if damping >= 1e12:
                return pose
        pose, errors, cost = next_pose, next_errors, cost - gain
        damping = max(damping / 10, 1e-9)
        if gain <= 1e-12 * cost:
            return pose
    return pose


def _cost(errors: FloatArray, sigma: float) -> float:
    """Sum of Huber's function, twice: of squares of residuals in deviations, if they are small."""
    scaled = np.nan_to_num(norm(errors) / sigma, nan=np.inf)
    return float(np.where(scaled <= HUBER, scaled**2, HUBER * (2 * scaled - HUBER)).sum())


def starts_of(
    points: FloatArray, pixels: FloatArray, camera: Camera, near: FloatArray | None, sigma: float
) -> FloatArray:
    """Poses to start from: that of the plan, and the best of sets of three pairs, (S, 4, 4).

    Of parallel rays that of the plan alone.
    """
    found = [] if near is None else [near]
    if camera.is_parallel:
        return np.array(found).reshape(-1, 4, 4)
    rays = rays_of(pixels, camera)
    rays /= norm(rays)[..., None]
    usable = np.flatnonzero(np.isfinite(rays).all(axis=1))
    poses = [pose for rows in _sets(usable) for pose in p3p(points[rows], rays[rows])]
    if poses:
        agreements = [_agreement(points, pixels, camera, pose, sigma) for pose in poses]
        best = sort_order(agreements)[:8]
        found += [poses[row] for row in best.tolist()]
    return np.array(found).reshape(-1, 4, 4)


def _sets(usable: IntArray) -> Iterator[IntArray]:
    """Sets of three rows: all, or `SETS` of them at random."""
    n = len(usable)
    if n * (n - 1) * (n - 2) // 6 <= SETS:
        yield from (usable[list(rows)] for rows in combinations(range(n), 3))
        return
    rng = np.random.default_rng(0)
    for _ in range(SETS):
        yield rng.choice(usable, 3, replace=False)


def _agreement(
    points: FloatArray, pixels: FloatArray, camera: Camera, pose: FloatArray, sigma: float
) -> float:
    """Sum of the squares of residuals, each at most that of a wrong pair: MSAC's measure."""
    errors = norm(pixels_of(points, camera, pose) - pixels) / sigma
    return float(np.minimum(np.nan_to_num(errors, nan=np.inf), 3 * WRONG).sum())


def p3p(points: FloatArray, rays: FloatArray) -> list[FloatArray]:
    """Poses, up to four, in which three points (3, 3) lie on three rays (3, 3) of unit length.

    Grunert's quartic in the ratio v of the third distance to the first, from the second's, u =
    over / under; points on a line have none.
    """
    a, b, c = (float(norm(points[i] - points[j])) for i, j in ((1, 2), (0, 2), (0, 1)))
    area = float(norm(np.cross(points[1] - points[0], points[2] - points[0])))
    if area <= 1e-9 * max(a, b, c) ** 2:
        return []
    alpha, beta, gamma = (float(rays[i] @ rays[j]) for i, j in ((1, 2), (0, 2), (0, 1)))
    p, ratio = (a * a - c * c) / (b * b), (c / b) ** 2
    over = np.poly1d((p - 1, -2 * p * beta, 1 + p))
    under = np.poly1d((-2 * alpha, 2 * gamma))
    square = np.poly1d((1, -2 * beta, 1))
    quartic = over * over + (under - 2 * gamma * over - ratio * square * under) * under
    found = []
    for root in quartic.roots:
        v = float(root.real)
        if abs(root.imag) > 1e-6 * max(1.0, abs(v)) or v <= 0 or abs(under(v)) < 1e-12:
            continue
        u, below = over(v) / under(v), square(v)
        if u <= 0 or below <= 0:
            continue
        lengths = b / np.sqrt(below) * np.array((1.0, u, v))
        found.append(aligned(rays * lengths[:, None], points))
    return found


def aligned(local: FloatArray, points: FloatArray) -> FloatArray:
    """Rigid transform (4, 4) that maps points (N, 3) in camera axes best onto the world's."""
    middle, centre = local.mean(axis=0), points.mean(axis=0)
    left, _, right = np.linalg.svd((points - centre).T @ (local - middle))
    sign = np.sign(np.linalg.det(left @ right))
    pose = np.eye(4)
    pose[:3, :3] = (left * (1.0, 1.0, sign)) @ right
    pose[:3, 3] = centre - pose[:3, :3] @ middle
    return pose
