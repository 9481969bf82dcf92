"""Area that one rig covers and another does not, for `evaluate --before`.

Both unions are parts of the exact partition of the surface, so that a loss and a gain on one face
do not cancel out.
"""

from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from typing import Any

import numpy as np

from rastercov.base.format import area as in_square_metres
from rastercov.base.format import percent, plural
from rastercov.base.memory import FloatArray
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, rows_of_result
from rastercov.coverage.area.network import AreaNetwork, unit_of_result
from rastercov.coverage.area.overlay import Progress
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.rows import gated, tasks_of
from rastercov.coverage.area.stages import Parts, divided, passes, stages_of
from rastercov.coverage.area.union import Covered, RegionUnion, with_rest
from rastercov.coverage.area.zones import (
    MOST_LINES,
    DeadZones,
    Divide,
    explained,
    zone_line,
    zones_of,
)
from rastercov.coverage.coverage import in_batches
from rastercov.coverage.engine import Engine
from rastercov.coverage.reasons import NO_CAMERAS, TOO_FEW_VIEWS
from rastercov.coverage.surface import own_reasons
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

MOST_LISTED = 20
"""Zones that are lost, and that are gained, in a summary."""


Placed = tuple[Cameras, Poses]
"""Cameras, and their poses."""


def lost_zones(before: Covered, now: Covered, divide: Divide | None, left: int) -> DeadZones:
    """Zones of what as many cameras as are counted covered before, and do not cover now.

    `divide` and `left` are those of `zones_of`.
    """
    mesh, before, k = now.mesh, with_rest(before), len(now.area)
    union = RegionUnion(mesh)
    # What is covered now, and what was not covered before, overlap: the rest is lost.
    union.add_parts(before, before.views < k)
    union.add_parts(now, now.views >= k)
    wanted, never = np.ones(mesh.n_faces, np.int64), np.zeros(mesh.n_faces, np.bool_)
    return zones_of(union.covered(), wanted, never, divide, left)


def compared(
    mesh: Mesh,
    now: Placed,
    before: Placed,
    task: Task,
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Area that the cameras before covered and those now do not, `lost`, and `gained`, the reverse.

    Each has its area with its bound and its zones, the largest first, with the reason why the other
    rig does not cover it. Ready for JSON.

    Raises
    ------
    ConfigError
        For a task by face.
    """
    for camera, poses in (before, now):
        unit_of_result("area", task, Engine(), camera, len(poses))
    total, done = len(before[1]) + len(now[1]), 0

    def step(n: int) -> None:
        nonlocal done
        done += n
        progress(done, total)

    first, second = (_covered(mesh, each, task, step) for each in (before, now))
    return {
        "lost": _told(first, second, now, task),
        "gained": _told(second, first, before, task),
    }


def _covered(mesh: Mesh, rig: Placed, task: Task, step: Callable[[int], None]) -> Covered:
    """Area that cameras cover."""
    (camera, poses), areas = rig, AreaNetwork(mesh, task)
    rows = rows_of_result(camera, poses)
    with closing(RegionPass(mesh, camera, task)) as finder:
        for part in in_batches(poses, mesh.n_faces, finder.threads, rows):
            areas.add(gated(finder.find(part, closed=areas.closed), camera, part))
            step(len(part))
    return areas.covered


def _told(before: Covered, now: Covered, rig: Placed, task: Task) -> dict[str, Any]:
    """Area and zones of what is covered before and not by a rig now."""
    mesh, k, (camera, poses) = now.mesh, len(now.area), rig
    divide: Divide | None = None
    if k == 1 and len(poses):
        make = partial(passes, mesh, poses)
        own = own_reasons(mesh, tasks_of(camera, task)[0])

        def divide(rest: Parts) -> tuple[Parts, FloatArray]:
            return divided(mesh, rest, stages_of(mesh, camera, task), make, own)

    left = TOO_FEW_VIEWS if len(poses) else NO_CAMERAS
    zones = lost_zones(before, now, divide, left)
    n, total = zones.count(), zones.total()
    scored = mesh.task_mask
    m2 = float(zones.area[:n].sum())
    return {
        "m2": m2,
        "bound_m2": float(before.bound[scored].sum() + now.bound[scored].sum()),
        "percent": 100 * m2 / total if total > 0 else 0.0,
        "n_zones": n,
        "zones": explained(zones, camera, poses, task, min(n, MOST_LISTED)),
    }


def lines_of(told: Mapping[str, Any]) -> list[str]:
    """The differences in words; `poses` names the rig before."""
    sums = ", ".join(
        f"{kind} {in_square_metres(told[kind]['m2'])} ({percent(told[kind]['percent'] / 100)})"
        for kind in ("lost", "gained")
    )
    lines = [f"compared with {told['poses']}: {sums}"]
    for kind, whose in (("lost", "now"), ("gained", "before")):
        zones = told[kind]["zones"][:MOST_LINES]
        lines += [f"{kind}: {zone_line(zone).removeprefix('dead zone ')} {whose}" for zone in zones]
        if more := told[kind]["n_zones"] - len(zones):
            lines.append(f"{kind}: and {plural(more, 'more zone')}")
    return lines
