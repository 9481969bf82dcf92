"""Area that one rig covers and another does not, for `evaluate --before`.

Both unions are parts of the exact partition of the surface, so that a loss and a gain on one face
do not cancel out.
"""

import math
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from typing import NamedTuple

import numpy as np

from rastercov.base import ByName, FloatArray, IntArray, ReadByName, norm, percent, plural
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import coordinates, distance, percent_of
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import add_rows
from rastercov.core.area.union import Covered, RegionUnion, with_rest
from rastercov.core.area.zones import (
    MOST_LINES,
    DeadZones,
    Divide,
    division,
    explain_zones,
    zone_line,
    zones_of,
)
from rastercov.core.camera import Cameras, Poses, cameras_of
from rastercov.core.coverage.task import NO_CAMERAS, TOO_FEW_VIEWS, Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.shards import Progress, silent

MOST_LISTED = 20
"""Zones that are lost, and that are gained, in a summary."""
STILL = 1e-6
"""Metres and radians by which a camera may differ that has not been moved."""

Placed = tuple[Cameras, Poses]
"""Cameras, and their poses."""


def lost_zones(
    before: Covered, now: Covered, wanted: IntArray, divide: Divide | None, left: int
) -> DeadZones:
    """Zones of what as many cameras as are wanted, (F,), covered before, and do not cover now.

    `divide` and `left` are those of `zones_of`.
    """
    mesh, before = now.mesh, with_rest(before)
    union = RegionUnion(mesh)
    # What is covered now, and what was not covered before, overlap: the rest is lost.
    union.add_parts(before, before.views < wanted[before.face])
    union.add_parts(now, now.views >= wanted[now.face])
    ones, never = np.ones(mesh.n_faces, np.int64), np.zeros(mesh.n_faces, bool)
    return zones_of(union.covered(), ones, never, divide, left)


def check(now: Placed, before: Placed, task: Task) -> None:
    """ConfigError for a task by face."""
    for camera, poses in (before, now):
        unit_of_result("area", task, Engine(), camera, len(poses))


def compare(
    mesh: Mesh,
    now: Placed,
    before: Placed,
    task: Task,
    progress: Progress = silent,
) -> ByName:
    """Area that the cameras before covered and those now do not, `lost`, and `gained`, the reverse.

    Each has its area with its bound and its zones, the largest first, with the reason why the other
    rig does not cover it. `cameras` are those that differ, with their rows. Ready for JSON.

    Raises
    ------
    ConfigError
        For a task by face.
    """
    check(now, before, task)
    total, done = len(before[1]) + len(now[1]), 0

    def step(n: int) -> None:
        nonlocal done
        done += n
        progress(done, total)

    first, second = (_coverage_of(mesh, each, task, step) for each in (before, now))
    return {
        "cameras": [each._asdict() for each in compare_cameras(now, before)],
        "lost": _tell_changes(first, second, now, task),
        "gained": _tell_changes(second, first, before, task),
    }


class Changed(NamedTuple):
    """A camera that differs between two rigs.

    Attributes
    ----------
    before, now : int or None
        Its row; None where it was added or removed.
    position : list of float
        Now, or before where it was removed, metres.
    moved_m, turned_deg : float
    is_exchanged : bool
        True for another lens or sensor.
    """

    before: int | None
    now: int | None
    position: list[float]
    moved_m: float = 0.0
    turned_deg: float = 0.0
    is_exchanged: bool = False

    @property
    def in_words(self) -> str:
        """Number, counted from 1, place, and what was done."""
        row = self.before if self.now is None else self.now
        done = [
            "added" if self.before is None else "",
            "removed" if self.now is None else "",
            f"moved by {distance(self.moved_m)}" if self.moved_m > STILL else "",
            f"turned by {self.turned_deg:.3g}°" if self.turned_deg > math.degrees(STILL) else "",
            "exchanged" if self.is_exchanged else "",
        ]
        at = coordinates(self.position, 2)
        return f"camera {1 + (row or 0)} at ({at}) m: {', '.join(filter(None, done))}"


def compare_cameras(now: Placed, before: Placed) -> list[Changed]:
    """Cameras that were moved, turned, exchanged, added or removed.

    Those of equal rows are compared if there are as many. Else a camera that is where one was is
    the same, and the others were removed and added.
    """
    (old, first), (new, second) = before, now
    if len(first) != len(second):
        return [*_beyond(first, second, is_added=False), *_beyond(second, first, is_added=True)]
    one, other = first.world_from_camera, second.world_from_camera
    moved = norm(other[:, :3, 3] - one[:, :3, 3])
    chords = np.linalg.norm(other[:, :3, :3] - one[:, :3, :3], axis=(1, 2))
    turned = 2 * np.arcsin(np.minimum(chords / math.sqrt(8), 1.0))
    kinds = cameras_of(old), cameras_of(new)
    items = []
    for row in range(len(first)):
        is_exchanged = kinds[0][first.camera[row]] != kinds[1][second.camera[row]]
        if max(moved[row], turned[row]) > STILL or is_exchanged:
            own = Changed(int(first.ids[row]), int(second.ids[row]), other[row, :3, 3].tolist())
            by, angle = float(moved[row]), math.degrees(turned[row])
            items.append(own._replace(moved_m=by, turned_deg=angle, is_exchanged=is_exchanged))
    return items


def _beyond(poses: Poses, others: Poses, *, is_added: bool) -> list[Changed]:
    """Poses of which others have fewer, that were added to them, or removed."""
    there = Counter(map(_key, others.world_from_camera))
    beyond = []
    for row, pose in zip(poses.ids.tolist(), poses.world_from_camera, strict=True):
        if there[_key(pose)]:
            there[_key(pose)] -= 1
            continue
        before, now = (None, row) if is_added else (row, None)
        beyond.append(Changed(before, now, pose[:3, 3].tolist()))
    return beyond


def _key(pose: FloatArray) -> bytes:
    """Pose in steps of `STILL`."""
    return bytes(np.rint(pose / STILL).astype(np.int64).tobytes())


def _coverage_of(mesh: Mesh, rig: Placed, task: Task, step: Callable[[int], None]) -> Covered:
    """Area that cameras cover."""
    (camera, poses), areas = rig, AreaNetwork(mesh, task)
    with closing(RegionPass(mesh, camera, task)) as finder:
        add_rows(finder, poses, areas, step)
    return areas.covered


def _tell_changes(before: Covered, now: Covered, rig: Placed, task: Task) -> ByName:
    """Area and zones of what is covered before and not by a rig now."""
    mesh, k, (camera, poses) = now.mesh, len(now.area), rig
    divide = division(mesh, camera, task, poses) if k == 1 else None
    left = TOO_FEW_VIEWS if len(poses) else NO_CAMERAS
    zones = lost_zones(before, now, np.full(mesh.n_faces, k), divide, left)
    n = zones.count()
    scored = mesh.task_mask
    m2 = float(zones.area[:n].sum())
    return {
        "m2": m2,
        "bound_m2": float(before.bound[scored].sum() + now.bound[scored].sum()),
        "percent": percent_of(m2, zones.total()),
        "n_zones": n,
        "zones": explain_zones(zones, camera, poses, task, min(n, MOST_LISTED)),
    }


def lines_of(told: ReadByName) -> list[str]:
    """The differences in words; `poses` names the rig before."""
    sums = ", ".join(
        f"{kind} {in_square_metres(told[kind]['m2'])} ({percent(told[kind]['percent'] / 100)})"
        for kind in ("lost", "gained")
    )
    lines = [f"compared with {told['poses']}: {sums}"]
    changed = [Changed(**each).in_words for each in told["cameras"]]
    lines += [f"changed: {each}" for each in changed[:MOST_LINES]]
    if changed[MOST_LINES:]:
        lines.append(f"changed: and {plural(len(changed) - MOST_LINES, 'more camera')}")
    for kind, whose in (("lost", "now"), ("gained", "before")):
        zones = told[kind]["zones"][:MOST_LINES]
        lines += [f"{kind}: {zone_line(zone).removeprefix('dead zone ')} {whose}" for zone in zones]
        if more := told[kind]["n_zones"] - len(zones):
            lines.append(f"{kind}: and {plural(more, 'more zone')}")
    return lines
