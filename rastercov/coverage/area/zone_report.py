"""Dead zones with the reason of each, ready for JSON, and as lines for people.

The reason is that of most of some points of the zone, spread evenly over its area: for a point, the
criterion that fails last, in the order of `rastercov.Reason`, in any camera.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.format import area as in_square_metres
from rastercov.base.format import signed
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras
from rastercov.coverage.area.failures import first_failures
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.zones import DeadZones
from rastercov.coverage.reasons import REASONS
from rastercov.coverage.task import Reason, Task

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_POINTS, LEAST_POINTS = 32, 4
"""Points of a zone that are judged; fewer for many cameras."""
PAIRS = 4_000_000
"""Pairs of point and camera up to which there are more than `LEAST_POINTS`: a few seconds."""
ZONES = ("dead_zones", "other_dead_zones")
"""Keys of `summary_of`."""
MOST_LINES = 5
"""Zones that have a line for people."""
LEAST_PERCENT = 1e-3
"""Part of the task, in percent, from which a zone has one."""


def summary_of(
    zones: DeadZones, camera: Cameras, task: Task, poses: ArrayLike | Poses
) -> dict[str, Any]:
    """`dead_zones`, the largest first, and the sum of all that are not listed.

    A zone has its area, centroid (which may lie off a bent surface), extent, groups by falling
    area, reason, and for "occluded" the group that hides it most often, or None.

    Parameters
    ----------
    zones : DeadZones
        What the cameras leave.
    camera, task
        Camera or cameras, and thresholds of their regions.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of all cameras.
    """
    n = zones.listed()
    why = _reasons(zones, camera, task, Poses.of(poses), n)
    return {
        "dead_zones": [place | said for place, said in zip(zones.places(n), why, strict=True)],
        "other_dead_zones": zones.others(),
    }


def zone_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines about the largest zones of a summary; none where it has none."""
    zones = [each for each in summary.get("dead_zones", ()) if each["percent"] >= LEAST_PERCENT]
    return [zone_line(zone) for zone in zones[:MOST_LINES]]


def zone_line(zone: Mapping[str, Any]) -> str:
    """Line about one zone."""
    size = math.sqrt(zone["area_m2"])
    digits = min(max(0, 1 - math.floor(math.log10(size))), 9)
    at = ", ".join(signed(value, digits) for value in zone["centroid"])
    first, *others = zone["groups"]
    more = f" and {len(others)} more" if others else ""
    text = f"dead zone {in_square_metres(zone['area_m2'])} at ({at}) in group {first}{more}: "
    text += REASONS[zone["reason"]].label
    if zone["hidden_by"] is not None:
        text += f" by {'itself' if zone['hidden_by'] == first else zone['hidden_by']}"
    return text


def _reasons(
    zones: DeadZones, camera: Cameras, task: Task, poses: Poses, n: int
) -> list[dict[str, Any]]:
    """Reason and hiding group of the first n zones."""
    if not len(poses):
        return [{"reason": "no_cameras", "hidden_by": None}] * n
    if not n:
        return []
    each = int(np.clip(PAIRS // (n * len(poses)), LEAST_POINTS, MOST_POINTS))
    points, piece = _points(zones, n, each)
    face = zones.face[piece].astype(np.int64)
    is_seen = zones.views[piece] > 0
    reason = np.where(is_seen, Reason.COVERED, Reason.DEGENERATE).astype(np.uint8)
    mesh = zones.mesh
    hidden = np.zeros((len(points), len(mesh.groups)), np.int32)
    rows = np.flatnonzero(~is_seen)
    for found, hidden_by in first_failures(mesh, camera, task, poses, points[rows], face[rows]):
        # No camera covers these points: where none of the criteria fails, it is a coincident
        # surface in front, or rounding.
        reason[rows] = np.maximum(reason[rows], np.minimum(found, Reason.TOO_OBLIQUE))
        unclear = found == Reason.COVERED
        reason[rows[unclear]] = np.maximum(reason[rows[unclear]], Reason.OCCLUDED)
        at = np.flatnonzero(hidden_by >= 0)
        np.add.at(hidden, (rows[at], mesh.face_group[hidden_by[at]]), 1)
    zone = zones.zone[piece]
    votes = np.zeros((n, len(Reason)), np.int64)
    np.add.at(votes, (zone, reason), 1)
    winner = votes.argmax(axis=1)
    counts = np.zeros((n, len(mesh.groups)), np.int64)
    is_hidden = reason == Reason.OCCLUDED
    np.add.at(counts, zone[is_hidden], hidden[is_hidden])
    return [_said(winner[row], counts[row], mesh.groups) for row in range(n)]


def _said(reason: int, counts: IntArray, groups: Any) -> dict[str, Any]:
    name = "too_few_views" if reason == Reason.COVERED else Reason(reason).name.lower()
    hides = reason == Reason.OCCLUDED and counts.any()
    return {"reason": name, "hidden_by": groups[int(counts.argmax())].name if hides else None}


def _points(zones: DeadZones, n: int, each: int) -> tuple[FloatArray, IntArray]:
    """Points of the first n zones, the same number of each, and their pieces.

    At equal steps of the area of the triangles that the pieces are fans of; within a triangle,
    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018 (R2).
    """
    pieces = np.flatnonzero(zones.zone < n)
    pieces = pieces[np.argsort(zones.zone[pieces], kind="stable")]
    fans = np.diff(zones.starts)[pieces] - 2
    piece = np.repeat(pieces, fans)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = zones.starts[piece]
    a, b, c = zones.xy[first], zones.xy[first + number + 1], zones.xy[first + number + 2]
    u, v = b - a, c - a
    areas = np.maximum(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], 0.0) / 2
    total = np.cumsum(areas)
    ends = total[np.searchsorted(zones.zone[piece], np.arange(n), side="right") - 1]
    starts = np.concatenate([[0.0], ends[:-1]])
    steps = (np.arange(each) + 0.5) / each
    at = (starts[:, None] + steps * (ends - starts)[:, None]).ravel()
    chosen = np.minimum(np.searchsorted(total, at), len(total) - 1)
    k = np.arange(len(at)) + 1
    x, y = k * 0.7548776662466927 % 1, k * 0.5698402909980532 % 1
    over = x + y > 1
    x[over], y[over] = 1 - x[over], 1 - y[over]
    xy = a[chosen] + x[:, None] * u[chosen] + y[:, None] * v[chosen]
    return to_world(zones.mesh, zones.face[piece[chosen]], xy), piece[chosen]
