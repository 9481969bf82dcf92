"""Rejected views that would cover dead zones of a placement, with the reasons."""

import numpy as np

from rastercov.base import ByName, plural
from rastercov.core.area.failures import failures_of_rows
from rastercov.core.area.zones import MOST_LINES, DeadZones, points_of
from rastercov.core.camera import Poses, led_by
from rastercov.core.coverage.reasons import Reason
from rastercov.core.coverage.task import Task
from rastercov.placement.candidates.refusals import Refusal, by_words, in_words
from rastercov.placement.mounts import Mounts

MOST_VIEWS = 256
"""Views that are examined, evenly spread over all."""
POINTS = 32
"""Of each zone."""
ENOUGH = 0.5
"""Share of a zone that a view covers, or more."""


def views_for_zones(
    mounts: Mounts, task: Task, zones: DeadZones, refusals: tuple[Refusal, ...]
) -> list[list[Refusal]]:
    """Views that would cover half of each of the first zones, or more."""
    n, mesh = min(zones.listed(), MOST_LINES), zones.mesh
    some = np.unique(np.linspace(0, len(refusals) - 1, MOST_VIEWS).astype(np.int64))
    result: list[list[Refusal]] = [[] for _ in range(n)]
    if not n or not refusals:
        return result
    chosen = [refusals[row] for row in some.tolist()]
    camera = np.array([each.camera for each in chosen], np.int32)
    poses, owner = mounts.cameras(Poses.of(np.array([e.pose for e in chosen]), camera=camera))
    points, piece = points_of(zones, n, POINTS)
    zone, face = zones.zone[piece], zones.face[piece].astype(np.int64)
    covers = np.zeros((len(chosen), len(points)), np.bool_)
    judged = failures_of_rows(mesh, mounts.rig, task, poses, points, face)
    for row, (_, reason, _) in zip(owner[led_by(mounts.rig, poses)], judged, strict=True):
        covers[row] |= reason == Reason.COVERED
    for row in range(n):
        of_zone = covers[:, zone == row]
        result[row] = [chosen[at] for at in np.flatnonzero(of_zone.mean(axis=1) >= ENOUGH)]
    return result


def entries_of(views: list[Refusal]) -> ByName:
    """Views of a zone by their reasons, ready for JSON."""
    return {"refused": by_words(views)} if views else {}


def line_of(views: list[Refusal], zone: str) -> list[str]:
    """Sentence on the views of a zone, none where there are no views."""
    if not views:
        return []
    rejected = f"{plural(len(views), 'rejected candidate')} would cover at least half of it"
    return [f"{zone}: {rejected} ({in_words(views)})"]
