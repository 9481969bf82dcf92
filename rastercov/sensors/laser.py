"""Area that a laser line measures as its sheet is swept over a surface, or the part is turned.

A point is measured when the sheet crosses it, from the positions of laser and camera at that time:
this is not a perspective view, and shadows are bounded by curves. So the sweep is N stations, each
with the regions of laser and camera from its middle, within what its sheet passes: there two
heights over planes have other signs. Stations add up; the error falls with their width, see
`LaserLine`.

F. Blais. Review of 20 years of range sensor development. 2004.
"""

from contextlib import closing
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    CameraError,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    PoseError,
    dots,
    frozen_record,
    offsets_of,
    shown,
    sort_order,
)
from rastercov.base.typed import check_fields
from rastercov.core.area import polygons
from rastercov.core.area.cut import Kept
from rastercov.core.area.polygons import frames_of, to_world
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Regions, join
from rastercov.core.camera import Rig, valid_poses
from rastercov.core.coverage.task import Engine, Task, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import matrices_of

MOST_STATIONS = 4096
"""Stations of a sweep."""
AT_A_TIME = 8
"""Stations between which faces that no sheet passes are left out."""
ACROSS = 1.7320508075688772
"""Tangent of 60 degrees: of the laser, to both sides of its sheet, so that it lights a station."""
MOST_TURN = 0.0
"""Cosine of the largest rotation between successive poses."""


@frozen_record(repr=False)
class LaserLine(InOneLine):
    """Area that a laser line measures on a path, in N stations; made by `LaserLine.of`.

    A station is the part of the path between two successive poses of the rig.

    Attributes
    ----------
    regions : Regions
        Parts measured in N stations; one row. The bound excludes the error due to their spacing.
    stations : int
        Number N of stations.
    percent, doubled_percent : float
        Measured percentage of the evaluated area in N stations, and in 2 N: their difference shows
        whether N is enough. It is not a bound.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> laser = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> tilted = rc.look_at((0, 0.2, 0), (0, 0, 0.5), up=(0, 1, 0))[0]
    >>> limit = {"laser": rc.Task(max_incidence_deg=70)}
    >>> head = rc.Rig(
    ...     [laser, laser], ["laser", "camera"], [np.eye(4), tilted], rule=rc.All(), tasks=limit
    ... )
    >>> above = rc.look_at((0, -0.2, 0.6), (0, -0.2, 0), up=(0, 1, 0))
    >>> path = np.tile(above, (21, 1, 1))
    >>> path[:, 1, 3] += np.linspace(0, 0.4, 21)
    >>> result = rc.LaserLine.of(rc.shapes.box((0.2, 0.2, 0.2)), head, path)
    >>> result.stations, round(result.percent, 1)  # the top, a sixth of the box
    (20, 16.7)
    """

    regions: Regions
    stations: int
    percent: float
    doubled_percent: float

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        rig: Rig,
        world_from_rig: ArrayLike,
        task: Task | None = None,
        *,
        laser: str = "laser",
        method: str | Engine = "certified",
        threads: int | None = None,
    ) -> "LaserLine":
        """Area that a laser line and its cameras measure along a path, by the rule of their rig.

        Parameters
        ----------
        mesh : Mesh
            The surface.
        rig : Rig
            Laser and cameras with a rule. The sheet of the laser is the plane of its x and z axes,
            between the left and right side of its image, whose height does not matter. It needs its
            own thresholds in `tasks`, including `max_incidence_deg`, without which half the area of
            faces along the sheet would count.
        world_from_rig : (N + 1, 4, 4) array_like
            Poses of the rig that bound the N stations, in order. For a rotating part, rotate the
            rig the other way.
        task : Task, optional
            As for `rastercov.regions`.
        laser : str
            Name of the laser in the rig.
        method, threads
            As for `rastercov.regions`.

        Raises
        ------
        CameraError
            For a rig without a rule, and for a laser that is not in it or not a pinhole.
        ConfigError
            For a laser without its own thresholds, with pixel densities, or without an incidence
            limit.
        PoseError
            For fewer than two poses, more than 4097, and steps of more than 90 degrees.
        """
        rig = _with_sheet(rig, laser, Task() if task is None else task)
        poses = valid_poses(world_from_rig)
        if not 2 <= len(poses) <= MOST_STATIONS + 1:
            raise PoseError(
                f"expected 2 to {MOST_STATIONS + 1} poses of the rig, got {len(poses)}; change them"
            )
        middle = _between(poses)
        doubled = np.empty((2 * len(poses) - 1, 4, 4))
        doubled[::2], doubled[1::2] = poses, middle
        own = task, laser, Engine.of(method, threads)
        sweep = _swept(mesh, rig, poses, middle, *own)
        finer = _swept(mesh, rig, doubled, _between(doubled), *own)
        total = float(frames_of(mesh).areas[mesh.task_mask].sum())
        percents = [100 * float(each.area.sum()) / max(total, 1e-300) for each in (sweep, finer)]
        return cls(sweep, len(middle), *percents)

    def __str__(self) -> str:
        change = self.doubled_percent - self.percent
        return (
            f"{self.percent:.3f} % of the area by {self.stations} stations; at "
            f"{2 * self.stations}: {change:+.3f} percentage points"
        )


def _with_sheet(rig: Rig, laser: str, task: Task) -> Rig:
    """The rig, whose laser reaches to both sides of its sheet; see `LaserLine.of` for errors."""
    if not isinstance(rig, Rig) or not rig.is_one:
        raise CameraError(
            f"expected a Rig with a rule, got {shown(rig)}; give it one, such as All()"
        )
    if laser not in rig.names:
        raise CameraError(f"expected a camera of the rig as laser, got {shown(laser)}; name it")
    row = rig.names.index(laser)
    own, sheet = tasks_of(rig, task)[row], rig.cameras[row]
    sheet.check_pinhole("expected a pinhole as laser", "make it by Camera.from_fov")
    if laser not in rig.tasks or not own.max_incidence_deg < 90:
        raise ConfigError(
            f"expected max_incidence_deg below 90 for {shown(laser)}, got "
            f"{own.max_incidence_deg:g}; set it in tasks of the rig"
        )
    if own.min_pixels_per_m2 or own.min_pixel_density or own.min_facing_density:
        raise ConfigError(
            f"expected no pixel density for {shown(laser)}, got one; leave it out of its task"
        )
    side = sheet.width
    wide = replace(sheet, height=side, cy=side / 2, fy=side / 2 / ACROSS)
    return rig._with(cameras=(*rig.cameras[:row], wide, *rig.cameras[row + 1 :]))


def _between(poses: FloatArray) -> FloatArray:
    """(N, 4, 4) poses half way between successive ones of N + 1, along screw motions."""
    step = np.linalg.inv(poses[:-1]) @ poses[1:]
    turn, moved = step[:, :3, :3], step[:, :3, 3]
    if not (np.trace(turn, axis1=1, axis2=2) >= 1 + 2 * MOST_TURN).all():
        raise PoseError(
            "expected rotations of at most 90 degrees between poses, got larger ones; add poses"
        )
    # R^1/2 is the rotation nearest to I + R, and (I + R^1/2) t' = t.
    u, _, vt = np.linalg.svd(np.eye(3) + turn)
    half = u @ vt
    way = np.linalg.solve(np.eye(3) + half, moved[..., None])[..., 0]
    return poses[:-1] @ matrices_of(half, way)


def _swept(
    mesh: Mesh,
    rig: Rig,
    ends: FloatArray,
    middle: FloatArray,
    task: Task | None,
    laser: str,
    engine: Engine,
) -> Regions:
    """Regions of the stations together, one row."""
    row, parts = np.full(len(ends), rig.names.index(laser)), []
    sheets = rig._place(ends, row)
    with closing(RegionPass(mesh, rig, task, method=engine)) as finder:
        for first in range(0, len(middle), AT_A_TIME):
            own = sheets[first : first + AT_A_TIME + 1]
            placed = rig.poses(middle[first : first + AT_A_TIME])
            height = (mesh.vertices @ own[:, :3, 1].T - _levels(own))[mesh.faces]
            is_above: BoolArray = height >= 0
            is_passed = (is_above != is_above[:, :1]).any(axis=(1, 2))
            is_passed |= (is_above != is_above[..., :1]).any(axis=(1, 2))  # between two sheets
            result = finder.find(placed, closed=~is_passed)
            parts.append(with_rule(_within(result, own, len(rig)), rig, placed))
    whole = join(parts)
    return whole.at_least(1, np.zeros(len(whole.pose_ids), np.int64), one_side=False)


def _levels(sheets: FloatArray) -> FloatArray:
    """(N,) height of the centre of each laser along the normal of its sheet."""
    return dots(sheets[:, :3, 1], sheets[:, :3, 3])


def _within(regions: Regions, sheets: FloatArray, n: int) -> Regions:
    """Parts of the regions of N stations of n devices between their sheets, (N + 1, 4, 4)."""
    station, levels = regions.pose // n, _levels(sheets)

    def heights(xy: FloatArray, starts: IntArray, rows: IntArray, of: int) -> FloatArray:
        """Heights of corners of parts of the pieces of rows over a sheet of their station."""
        piece = np.repeat(rows, np.diff(starts))
        points, own = to_world(regions.mesh, regions.face[piece], xy), station[piece] + of
        return dots(points, sheets[own, :3, 1]) - levels[own]

    every = np.arange(len(regions))
    before = heights(regions.xy, regions.starts, every, 0)
    xy, counts, piece = [], [], []
    for sign in (1.0, -1.0):
        first, starts, kept = polygons.clip_polygons(regions.xy, regions.starts, sign * before)
        height = heights(first, starts, kept, 1)
        second, starts, own = polygons.clip_polygons(first, starts, -sign * height)
        xy.append(second)
        counts.append(np.diff(starts))
        piece.append(kept[own])
    order = sort_order(np.concatenate(piece))
    ends = offsets_of(np.concatenate(counts))
    ordered, ends = polygons.choose_polygons(np.concatenate(xy), ends, order)
    with_few_corners, ends, part = polygons.with_few_corners(ordered, ends)
    areas, rows = polygons.polygon_areas(with_few_corners, ends), np.concatenate(piece)[order][part]
    return regions._with_parts(Kept(with_few_corners, ends, rows, areas, np.zeros(len(regions))))
