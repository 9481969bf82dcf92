"""Rules of sensors, and angles between rays, of cameras with errors.

Errors of cameras are independent and rules only rise with what cameras see, so a rule holds with
all errors exactly where it holds for the sure parts of its cameras. A step d of a camera turns the
ray from a point at a distance D by at most asin(d / D), so the angle between two rays changes by at
most the sum of both. See docs/appendix/tolerance.md.
"""

import math

import numpy as np

from rastercov.base import TINY, FloatArray, dots, sort_order
from rastercov.base.arguments import LEAST_RAY_ANGLE
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.rows import through, with_rule
from rastercov.core.area.spread import union_of
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.area.union import Covered
from rastercov.core.camera import Cameras, Poses, by_gate, gates_of
from rastercov.core.coverage.task import Task

SURE, POSSIBLE = 1, -1


def nearest_of(regions: Regions) -> FloatArray:
    """(P,) distance of each camera centre from the pieces that it covers; infinite for none."""
    frames, nearest = frames_of(regions.mesh), np.full(len(regions.pose_ids), np.inf)
    if not len(regions.face):
        return nearest
    face, first = regions.face, regions.starts[:-1]
    away = regions.eyes[regions.pose] - frames.origin[face]
    height, x, y = (
        dots(away, axes[face]) for axes in (frames.normal, frames.x_axis, frames.y_axis)
    )
    counts = np.diff(regions.starts)
    start = regions.xy - np.repeat(np.column_stack([x, y]), counts, axis=0)
    following = np.arange(1, len(start) + 1)
    following[regions.starts[1:] - 1] = first
    end = start[following]
    along = end - start
    size = np.maximum(dots(along, along), TINY)
    t = np.clip(-dots(start, along) / size, 0.0, 1.0)
    flat = np.hypot(*(start + t[:, None] * along).T)
    inside = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0] >= 0
    is_over = np.logical_and.reduceat(inside, first)
    flat = np.where(is_over, 0.0, np.minimum.reduceat(flat, first))
    np.minimum.at(nearest, regions.pose, np.hypot(flat, height))
    return nearest


def turns_of(sizes: FloatArray, nearest: FloatArray) -> FloatArray:
    """(P,) angles by which errors (P, 3) turn rays from points at distances, radians."""
    share = np.divide(sizes[:, 0], nearest, out=np.ones(len(sizes)), where=nearest > 0)
    return np.where(share < 1, np.arcsin(np.minimum(share, 1.0)), math.pi)


def _of_two(turns: FloatArray) -> float:
    """Greatest change of the angle between two rays, degrees."""
    return math.degrees(float(np.sort(turns)[-2:].sum()))


def rows_with_errors(
    regions: Regions, camera: Cameras, poses: Poses, sizes: FloatArray, nearest: FloatArray, of: int
) -> Regions:
    """Rows of the result of `SURE` regions of each pose, or of `POSSIBLE` ones.

    `nearest` are distances of the surface from the camera centres, (P,).
    """
    if not gates_of(camera):
        return regions
    parts, rows = [], []
    for gate, own, row in by_gate(camera, poses):
        for of_rig, at in zip(own, row.tolist(), strict=True):
            part = take_rows(regions, of_rig)
            if gate is not None:
                changed = gate.off_by(of * _of_two(turns_of(sizes[of_rig], nearest[of_rig])))
                # With some errors, a camera next to the plane of a face may be on either side.
                part = through(part, changed, one_side=of == SURE)
            parts.append(part)
            rows.append(at)
    return take_rows(join(parts), sort_order(rows))


def unite_regions(
    regions: Regions,
    camera: Cameras,
    poses: Poses,
    task: Task,
    views: int,
    errors: tuple[FloatArray, FloatArray, int] | None = None,
) -> Covered:
    """Area that 1 to k rows of the result cover; with `sizes, nearest, of` of `rows_with_errors`.

    Without these, of cameras as they are.
    """
    if errors is None:
        rows, by = with_rule(regions, camera, poses), 0.0
    else:
        sizes, nearest, of = errors
        rows = rows_with_errors(regions, camera, poses, sizes, nearest, of)
        by = of * _of_two(turns_of(sizes, np.maximum(nearest, nearest_of(regions))))
    angle = min(task.min_angle_deg + by, 180.0) if task.min_angle_deg > 0 else 0.0
    union = union_of(rows.mesh, views, angle if angle >= LEAST_RAY_ANGLE else 0.0)
    union.add(rows)
    return union.covered()
