"""Ground of a scene, seen from above: its height at points of the plan, and its outline."""

from typing import TYPE_CHECKING

import numpy as np

from rastercov.base import ConfigError, FloatArray
from rastercov.core.mesh import Mesh

if TYPE_CHECKING:
    from shapely import Polygon

SLACK = 1e-9
"""Barycentric distance outside a face up to which a point is on it."""


def heights_at(mesh: Mesh, xy: FloatArray, *, is_lowest: bool = False) -> FloatArray:
    """(N,) z of the highest or lowest surface at points (N, 2) of the plan; NaN for none."""
    import shapely

    heights = np.full(len(xy), np.nan)
    surface = mesh.opaque
    corners = surface.vertices[surface.faces]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    tree = shapely.STRtree(shapely.box(*low.T, *high.T))
    point, face = tree.query(shapely.points(xy))
    a, b, c = (corners[face, k] for k in range(3))
    u, v, w = b - a, c - a, xy[point] - a[:, :2]
    twice = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    whole = np.where(twice == 0, 1.0, twice)  # upright faces are the border of others
    s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / whole
    t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / whole
    inside = (twice != 0) & (s >= -SLACK) & (t >= -SLACK) & (s + t <= 1 + SLACK)
    z = a[:, 2] + s * u[:, 2] + t * v[:, 2]
    (np.fmin if is_lowest else np.fmax).at(heights, point[inside], z[inside])
    return heights


def outline(mesh: Mesh) -> "Polygon":
    """Convex outline of the evaluated faces on the plan; ConfigError without such faces."""
    import shapely

    if not mesh.task_mask.any():
        raise ConfigError(
            "expected faces to evaluate, got occluders only; change a role, or give a polygon"
        )
    used = mesh.vertices[np.unique(mesh.faces[mesh.task_mask])]
    return shapely.MultiPoint(used[:, :2]).convex_hull
