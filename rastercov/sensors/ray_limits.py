"""Limits of rules: angles between the rays of devices, and uncertainties of points."""

from itertools import combinations

import numpy as np

from rastercov.base import ConfigError, FloatArray, norm
from rastercov.core.area.criteria import RayAngle, Uncertainty
from rastercov.core.area.cut import values_of
from rastercov.core.area.polygons import following, to_world
from rastercov.core.area.table import Regions, any_of
from rastercov.core.camera import Gate
from rastercov.core.camera.parallel import FAR
from rastercov.core.camera.rule import Limited, limits_of

MOST_INFORMATION = 1e7
"""Largest limit of a deviation, in that of one ray at a diagonal of the mesh: its square is the
information of rays beside 1, and rounded by 1e-16."""
MOST_HALVINGS = 8
"""Of triangles in which the largest deviation is looked for."""
QUARTERS = np.array([
    [(2, 0, 0), (1, 1, 0), (1, 0, 1)], [(1, 1, 0), (0, 2, 0), (0, 1, 1)],
    [(1, 0, 1), (0, 1, 1), (0, 0, 2)], [(1, 1, 0), (0, 1, 1), (1, 0, 1)],
]) / 2  # fmt: skip
"""Corners of the quarters of a triangle by its corners."""


def _within_baseline(regions: Regions, gate: Limited, eyes: FloatArray) -> Regions:
    """Parts where the rays to cameras (P, n, 3) of a gate differ as it asks.

    By at least its least angle in some two of them, and by at most its greatest in any two.
    """
    pairs = list(combinations(range(eyes.shape[1]), 2))
    for pair in pairs if gate.most_deg < 180 else ():
        regions = regions.where(RayAngle(eyes[:, pair], gate.most_deg, is_least=False))
    if gate.least_deg <= 0 or not pairs:
        return regions
    parts = [regions.where(RayAngle(eyes[:, pair], gate.least_deg)) for pair in pairs]
    return parts[0] if len(parts) == 1 else any_of(parts)


def _within_deviation(regions: Regions, gate: Limited, devices: Regions) -> Regions:
    """Parts where the standard deviation is within its limit."""
    away = norm(devices.eyes[: gate.n])
    reach = np.where(away > FAR / 2, FAR, regions.mesh.diagonal)  # FAR of parallel rays
    scales = np.array(gate.noise)[: len(away)] * reach
    most = MOST_INFORMATION * float(scales.min(initial=np.inf))
    if most > 0 and not gate.most_deviation <= most:
        raise ConfigError(
            f"expected max_uncertainty up to {most:.2g} m for this noise and mesh, got "
            f"{gate.most_deviation:g} m; reduce it: above it, rounding dominates"
        )
    return regions.where(uncertainty_of(gate, devices))


def uncertainty_of(gate: Limited, devices: Regions) -> Uncertainty:
    """Criterion of rigs with a limit of the deviation, by the regions of their devices."""
    assert devices.columns is not None
    eyes, columns = (each.reshape(-1, gate.n, 3) for each in (devices.eyes, devices.columns))
    stripes = np.zeros_like(columns)
    stripes[..., gate.stripes, :] = columns[..., gate.stripes, :]
    return Uncertainty(eyes, gate.most_deviation, gate.noise, stripes)


def measure_limits(
    gate: Limited, placed: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(N,) largest angle between two rays to points (N, 3), degrees, and their deviations, m.

    By devices (n, 4, 4) or (N, n, 4, 4). The deviation is that in the worst direction, infinite
    where they fix no point, and 0 without a limit of it.
    """
    from rastercov.engine import area_rule as kernels

    cosine, deviation = np.empty((2, len(points)))
    poses = np.ascontiguousarray(placed[None] if placed.ndim == 3 else placed)
    kernels.measure_points(
        gate._for_kernels(), poses, np.ascontiguousarray(points), cosine, deviation
    )
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), deviation


def worst_deviations(
    covered: Regions, regions: Regions, gate: Limited
) -> tuple[FloatArray, FloatArray | None]:
    """(2, F) largest standard deviation of what rigs cover of each face, from below and above, m.

    And the point, (3,), of the largest of all, None where nothing is covered.

    The first is that of some point, and the second at most 1.001 times as much, or what is certain
    of triangles of 2^-`MOST_HALVINGS` of a piece. 0 where nothing is covered. `covered` is
    `through` of `regions`, those of single cameras.
    """
    mesh, values = covered.mesh, np.zeros((2, covered.mesh.n_faces))
    place: FloatArray | None = None
    if regions.columns is None:
        return values, place
    (cut,) = uncertainty_of(gate, regions)._cuts(len(covered.pose_ids))
    counts = np.diff(covered.starts)
    row, face = (np.repeat(each, counts).astype(np.int64) for each in (covered.pose, covered.face))
    fan = covered.xy[np.repeat(covered.starts[:-1], counts)], covered.xy
    triangles = np.stack([*fan, covered.xy[following(covered.starts)]], axis=1)

    def deviation(value: FloatArray) -> FloatArray:
        """Value of the least eigenvalue of the criterion, g + 1 = (limit / deviation)^2."""
        return np.asarray(gate.most_deviation / np.sqrt(1 + np.maximum(value, 0.0)))

    for halving in range(MOST_HALVINGS + 1):  # a few us a triangle
        centre = triangles.mean(axis=1)
        off = triangles - centre[:, None]
        radius = norm(off).max(axis=1, initial=0.0)
        value = values_of(mesh, cut, face, centre, row=row, radius=radius)
        linear = np.einsum("nki,ni->nk", off, value[:, 1:3])
        at = triangles[np.arange(len(face)), linear.argmin(axis=1)]
        here = deviation(values_of(mesh, cut, face, at, row=row)[:, 0])
        if len(here) and here.max() > values[0].max():
            top = [int(here.argmax())]
            place = to_world(mesh, face[top], at[top])[0]
        np.maximum.at(values[0], face, here)
        most = deviation(value[:, 0] + linear.min(axis=1) - value[:, 3])
        is_open = most > 1.001 * values[0, face]
        ends = ~is_open if halving < MOST_HALVINGS else np.ones(len(face), bool)
        np.maximum.at(values[1], face[ends], most[ends])
        row, face = (np.repeat(each[is_open], 4) for each in (row, face))
        triangles = np.einsum("qij,njk->nqik", QUARTERS, triangles[is_open]).reshape(-1, 3, 2)
    values[1] = values.max(axis=0)
    return values, place


def within_limits(regions: Regions, gate: Gate, devices: Regions) -> Regions:
    """Parts that rigs cover within the limits of their rule, which are those of all devices."""
    for limits in limits_of([gate]):
        if limits.has_baseline:
            regions = _within_baseline(regions, limits, devices.eyes.reshape(-1, gate.n, 3))
        if limits.has_deviation and devices.columns is not None:
            regions = _within_deviation(regions, limits, devices)
    return regions
