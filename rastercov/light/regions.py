"""Light: the parts of the surface that lamps reach, and what cameras cover of these.

A part is lit where one lamp or more reaches it, and a lamp of several points reaches what enough of
them see. Lamps and cameras are on one side of a face. Lamps that are fixed in the cell are found
once, and shared by all poses; those on the rig are found for each of its poses.

Light adds up: with a threshold of it, the surface is divided by the set of the points of lamps that
see a part, and cut where E = sum I(t) cos i / d^2 of this set, and the ambient light, is as the
task asks. A highlight is cut from what each camera sees, for each lamp of the set.
"""

from collections.abc import Callable, Hashable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    Once,
    norm,
    once_each,
    sort_order,
)
from rastercov.base.arguments import Quantity
from rastercov.core.area.cut import Kept
from rastercov.core.area.polygons import (
    choose_polygons,
    frames_of,
    in_front,
    points_on,
    polygon_areas,
    rows_at,
    spread_faces,
)
from rastercov.core.area.table import Condition, Cut, Finder, Regions, any_of, join, take_rows
from rastercov.core.camera import Cameras, Poses, Rig, apparent, eyes_of, movers
from rastercov.core.coverage.task import NAMES, NEEDED, Task, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.light.criteria import Highlight, Illuminance
from rastercov.light.lamp_file import lamps_on
from rastercov.light.lamp_words import REASONS
from rastercov.light.lamps import SUN, Lamps, are_lit, bits_of, illuminances, points_of
from rastercov.light.photometry import WEBS, web_of

UNLIT, TOO_DARK, TOO_BRIGHT, HIGHLIGHT = map(NAMES.index, REASONS)
"""Rows of the reasons of light."""
OF_LIGHT = tuple(name for name, word in NEEDED.items() if word == "lamps")
"""Thresholds of light."""
MOST_BATCHES = 64
"""Batches of rows whose light is kept."""
SCALE_OF_SUN = 2.0**-112
"""Unit of light beside a sun, whose intensity at its distance has no room; it rounds nothing."""
LIGHT_AT_RANGE = Quantity(1.0, "W/m2")
"""Irradiance at the range of a lamp."""
RANGE = (
    "infrared range: a point counts as lit if its irradiance is at least that of a lamp on its "
    f"axis at its range, defined as {LIGHT_AT_RANGE:g} W/m2"
)


class Lit(NamedTuple):
    """Lit parts of the surface, for R rows of a result.

    Attributes
    ----------
    sides : tuple of Regions
        Parts that are lit from the front, and from the rear of two-sided faces.
    row : (R,) int64
        Row of these for each row of the result.
    positions : (L, K, 3) float64
        Points of lamps, of each of their rows, whose bits are in `Regions.devices` of the parts;
        empty where no threshold of light asks for these.
    """

    sides: tuple[Regions, Regions]
    row: IntArray
    positions: FloatArray

    def within(self, regions: Regions, *, is_rear: bool) -> Regions:
        """Lit parts of R rows of regions, all of them on one side of their faces."""
        return self._gate(self.sides[is_rear], regions)

    def without_highlights(self, regions: Regions, degrees: float, *, is_rear: bool) -> Regions:
        """Lit parts in which cameras, of R rows of regions, see no lamp mirrored."""
        sets, lit = _by_sets(self.sides[is_rear])
        n, n_lit = len(self.row), len(self.sides[is_rear].pose_ids)
        n_faces, every = regions.mesh.n_faces, []
        keys = regions.pair_pose.astype(np.int64) * n_faces + regions.pair_face
        number, own = np.divmod(lit.pair_pose.astype(np.int64), n_lit)
        for row in range(n):  # a batch of poses
            pairs = np.flatnonzero(own == self.row[row])
            wanted = row * n_faces + lit.pair_face[pairs].astype(np.int64)
            at, is_there = _find_keys(keys, wanted)
            every.append((pairs[is_there], at[is_there], number[pairs[is_there]] * n + row))
        pairs, seen, group = map(np.concatenate, zip(*every, strict=True))
        order = np.lexsort((lit.pair_face[pairs], group))
        pairs, seen, group = pairs[order], seen[order], group[order].astype(np.int32)
        rows = np.tile(np.arange(n), len(sets))
        eyes, ids = regions.eyes[rows], regions.pose_ids[rows]
        # Sets have nothing in common, so that the bounds of each pair count once in their union.
        first = _is_first(seen)
        parts = [
            _gather_regions(source, at, group, ids, eyes)
            for source, at in ((regions, seen), (lit, pairs))
        ]
        parts = [
            replace(
                each, bound=np.where(first, each.bound, 0), excess=np.where(first, each.excess, 0)
            )
            for each in parts
        ]
        groups = np.tile(np.arange(len(rows)), 2)
        both = join([replace(each, devices=None) for each in parts])
        both = both.at_least(2, groups, one_side=False)
        both = replace(both, devices=sets[both.pose // n])
        cut = both.where(Highlight(eyes, self.positions[self.row][rows], degrees))
        return replace(cut, devices=None).at_least(1, rows)

    def _gate(self, lit: Regions, regions: Regions) -> Regions:
        row = np.tile(np.arange(len(self.row)), 2)
        own = replace(_spread(lit, regions, self.row), devices=None)
        return join([regions, own]).at_least(2, row, one_side=False)


class KnownLight:
    """Light of lamps in a scene: what fixed ones reach and light, and batches of rows of a result.

    Reasons ask for the same batches again, once a stage.
    """

    def __init__(self) -> None:
        self.regions: Once[Regions] = Once()
        self.lit: Once[Lit] = Once()
        self.rows: dict[tuple[bytes, bytes], list[Lit]] = {}


@once_each
def _lights_of(lamps: Lamps) -> dict[tuple[Mesh, Hashable], KnownLight]:
    """Light of lamps in the last scene that was asked for, by its mesh and by a key."""
    return {}


def known_light(lamps: Lamps, mesh: Mesh, key: Hashable) -> KnownLight:
    """Light of lamps, the same for the same mesh, which it keeps, and key."""
    known = _lights_of(lamps)
    if any(of is not mesh for of, _ in [*known]):
        known.clear()
    return known.setdefault((mesh, key), KnownLight())


class Light(Condition):
    """Parts of one mesh that lamps light, as a task asks; any number of threads may use it.

    Parameters
    ----------
    lamps : Lamps
    task : Task
    rig : Rig
        The cameras, on which lamps may ride.
    find : callable
        Regions of poses of `Lamps.eyes`.
    finder : Finder, optional
        Their pass, which is closed with the light.
    known : KnownLight, optional
        That of the same lamps and thresholds of light in the same scene.
    """

    reason = UNLIT

    def __init__(
        self,
        lamps: Lamps,
        task: Task,
        rig: Rig,
        find: Callable[[Poses], Regions],
        finder: Finder | None = None,
        known: KnownLight | None = None,
    ) -> None:
        self.lamps, self.task, self._find, self._finder = lamps, task, find, finder
        self._carried, self._rides = carried_on(rig, lamps)
        self._rig = rig
        self._known = known or KnownLight()

    def in_scene(self, mesh: Mesh) -> "Light":
        """See `Condition`: nothing that the lamps light is known."""
        self.lamps._check_around(mesh.bounds)
        if self._finder is not None:
            self._finder.set_mesh(mesh)
        return Light(self.lamps, self.task, self._rig, self._find, self._finder)

    def find_by(self, find: Callable[[Finder, Poses], Regions]) -> "Light":
        """See `Condition`."""
        assert self._finder is not None
        return Light(self.lamps, self.task, self._rig, partial(find, self._finder), self._finder)

    def alone(self) -> "Light":
        """The same lamps, whatever the thresholds of light."""
        return Light(self.lamps, self.task._without(OF_LIGHT), self._rig, self._find)

    def rows(self, leads: Poses) -> list[Lit]:
        """Lit parts for rows of a result, by a pose of each of a camera that moves with the rig.

        Of the lamps that are fixed, and of those that ride: a part is lit where either has it; of
        all together where light adds up.
        """
        world = self._rig._rigs(leads)
        key = world.tobytes(), leads.camera.tobytes()
        known = self._known.rows
        rows = known.get(key) or self._rows(leads, world)
        if len(known) == MOST_BATCHES:
            known.clear()
        known[key] = rows
        return rows

    def cut_of(self, leads: Poses) -> Cut:
        """See `Condition`."""
        lit = self.rows(leads)

        def cut(regions: Regions, is_rear: bool) -> Regions:
            parts = [each.within(regions, is_rear=is_rear) for each in lit]
            return parts[0] if len(parts) == 1 else any_of(parts)

        return cut

    def of_rows(self, regions: Regions, camera: Cameras, poses: Poses, leads: Poses) -> Regions:
        """See `Condition`; what highlights were cut from is lit already."""
        if self._limits_highlights(camera, poses).all():
            return regions
        return super().of_rows(regions, camera, poses, leads)

    def _limits_highlights(self, camera: Cameras, poses: Poses) -> BoolArray:
        """(P,) poses of cameras whose own task limits highlights."""
        tasks = tasks_of(camera, self.task)
        return np.array([task.max_highlight_deg > 0 for task in tasks])[poses.camera]

    def of_cameras(self, regions: Regions, camera: Cameras, poses: Poses) -> Regions:
        """Lit parts in which P poses see no lamp mirrored, of cameras that limit highlights."""
        is_asked = self._limits_highlights(camera, poses)
        if not is_asked.any():
            return regions
        some, limit = regions.of_poses(is_asked), self.task.max_highlight_deg
        (lit,) = self.rows(movers(camera, poses)[is_asked])
        cut = some._by_side(
            lambda part, is_rear: lit.without_highlights(part, limit, is_rear=is_rear)
        )
        cut = replace(cut, eyes=some.eyes, columns=some.columns)
        both = join([cut, regions.of_poses(~is_asked)])
        order = sort_order(np.concatenate([np.flatnonzero(is_asked), np.flatnonzero(~is_asked)]))
        return take_rows(both, order)

    def _rows(self, leads: Poses, world: FloatArray) -> list[Lit]:
        n, rides, still = len(leads), self._rides, ~self._rides
        rows = []
        if still.any() and not (asks_for_light(self.task) and rides.any()):
            fixed = self._known.lit.get(
                lambda: self._light(self._regions_of_fixed(), self._poses(still), 1)
            )
            rows.append(fixed._replace(row=np.zeros(n, np.int64)))
        if rides.any() and n:
            poses = self._poses(rides, world)
            regions = self._find(poses)
            is_there = self._carried[poses.camera, np.repeat(leads.camera, len(poses) // n)]
            if not is_there.all():
                regions = _only(regions, is_there[regions.pose])
            if asks_for_light(self.task) and still.any():
                poses, regions = self._add_fixed(poses, regions, n)
            rows.append(self._light(regions, poses, n))
        return rows

    def shares(self) -> FloatArray:
        """Share of the evaluated area that each fixed lamp reaches, and its bound, (L, 2).

        NaN of those that ride.
        """
        result = np.full((len(self.lamps), 2), np.nan)
        for lamp in np.flatnonzero(~self._rides).tolist():
            poses = self._poses(np.arange(len(self.lamps)) == lamp)
            own = self._reach(self._find(poses), poses.camera, np.zeros(len(poses), np.int64))
            areas = frames_of(own.mesh).areas
            total = float(areas[own.mesh.task_mask].sum())
            sums = np.array((own.area.sum(), own.bound.sum()))
            result[lamp] = np.minimum(sums / total, 1.0) if total > 0 else 0.0
        return result

    def carry(self, leads: Poses) -> Iterator[tuple[str, Regions]]:
        """Parts that each lamp on the rig reaches from rows of a result, by its name."""
        world, n = self._rig._rigs(leads), len(leads)
        for lamp in np.flatnonzero(self._rides).tolist() if n else ():
            poses = self._poses(np.arange(len(self.lamps)) == lamp, world)
            regions = self._find(poses)
            row = np.repeat(np.arange(n), len(poses) // n)
            is_there = self._carried[poses.camera, leads.camera[row]]
            regions = _only(regions, is_there[regions.pose])
            yield self.lamps.names[lamp], self._reach(regions, poses.camera, row)

    def sample(self) -> FloatArray | None:
        """Illuminance by the fixed lamps of up to 1024 points at equal steps of the evaluated area.

        On the side that gets more; None without fixed lamps or area.
        """
        if self._rides.all():
            return None
        own, poses = self._regions_of_fixed(), self._poses(~self._rides)
        mesh, n = own.mesh, 1024
        areas = frames_of(mesh).areas * mesh.task_mask
        if not areas.any():
            return None
        face = spread_faces(areas, n)
        points = points_on(mesh, face)
        reached = rows_at(own, own.pose, len(poses), face, points).T
        on = points, frames_of(mesh).normal[face]
        return brighter_side(self.lamps, poses, reached, on, mesh.two_sided_mask[face])

    def _poses(self, lamps: BoolArray, world: FloatArray | None = None) -> Poses:
        return points_of(self.lamps, lamps, world)

    def _regions_of_fixed(self) -> Regions:
        return self._known.regions.get(lambda: self._find(self._poses(~self._rides)))

    def _add_fixed(self, poses: Poses, regions: Regions, n_rows: int) -> tuple[Poses, Regions]:
        """Points of lamps on the rig, of a number of rows, each with those that are fixed."""
        fixed, still = self._regions_of_fixed(), self._poses(~self._rides)
        of_row, of_cell = len(poses) // n_rows, len(still)
        both = join([fixed, regions])
        at = np.arange(n_rows)[:, None]
        rows = np.concatenate(
            [np.tile(np.arange(of_cell), (n_rows, 1)), of_cell + at * of_row + np.arange(of_row)],
            axis=1,
        ).ravel()
        matrices = np.concatenate([still.world_from_camera, poses.world_from_camera])[rows]
        camera = np.concatenate([still.camera, poses.camera])[rows]
        return Poses.of(matrices, camera=camera), take_rows(both, rows)

    def _light(self, regions: Regions, poses: Poses, n_rows: int) -> Lit:
        """Lit parts of rows by poses of the points of their lamps, the same number for each."""
        row = np.repeat(np.arange(n_rows), len(poses) // n_rows)
        sides = [
            self._light_enough(side, poses, row)
            if asks_for_light(self.task)
            else self._reach(side, poses.camera, row)
            for side in regions._sides()
        ]
        if len(sides) == 1:
            sides.append(_only(sides[0], np.zeros(len(sides[0]), bool)))
        positions = eyes_of(self.lamps.eyes, poses).reshape(n_rows, -1, 3)
        return Lit((sides[0], sides[1]), np.arange(n_rows), positions)

    def _light_enough(self, regions: Regions, poses: Poses, row: IntArray) -> Regions:
        """Parts of rows with as much light as the task asks for, with their sets of points."""
        by_devices = regions.by_devices(row)
        assert by_devices.devices is not None
        n = len(poses) // (int(row.max(initial=0)) + 1)
        sets, index = np.unique(by_devices.devices, return_inverse=True)
        is_lit = are_lit(self.lamps, bits_of(sets, n), poses.camera[:n])
        by_devices = _only(by_devices, is_lit[index])
        for criterion in self._limits(poses, n):
            by_devices = by_devices.where(criterion)
        return by_devices

    def _limits(self, poses: Poses, n: int) -> Iterator[Illuminance]:
        """Least and greatest illuminance as criteria, of rows of n points of lamps each."""
        task, ambient = self.task, self.lamps.ambient
        scale = SCALE_OF_SUN if any(lamp.kind == SUN for lamp in self.lamps.lamps) else 1.0
        matrices = apparent(self.lamps.eyes, poses).reshape(-1, n, 4, 4)
        own = [self.lamps.lamps[lamp] for lamp in poses.camera[:n].tolist()]
        has_web = np.array([bool(lamp.planes) for lamp in own])
        tables = [lamp.table for lamp in own]
        has_table = np.array([each is not None for each in tables])
        frames = np.array([WEBS[lamp.web] for lamp in own]) @ np.swapaxes(
            matrices[:, :, :3, :3], -1, -2
        )
        for limit, is_least in ((task.min_illuminance, True), (task.max_illuminance, False)):
            if limit is not None and limit > ambient:
                yield Illuminance(
                    matrices[:, :, :3, 3],
                    (limit - ambient) * scale,
                    [lamp.intensity_of_point * scale for lamp in own],
                    matrices[:, :, :3, 2],
                    [lamp.exponent for lamp in own],
                    [each for each in tables if each is not None],
                    np.where(has_table, np.cumsum(has_table) - 1, -1),
                    is_least=is_least,
                    webs=[web_of(lamp.profile, lamp.planes) for lamp in own if lamp.planes],
                    web=np.where(has_web, np.cumsum(has_web) - 1, -1),
                    frames=frames,
                )

    def _reach(self, regions: Regions, lamp: Int32Array, row: IntArray) -> Regions:
        """Parts of rows that one lamp or more reaches, from regions of points of lamps."""
        needed = np.array([each.points_needed for each in self.lamps.lamps])
        if (needed == 1).all():
            return regions.at_least(1, row)
        of, k_of = row * len(needed) + lamp, needed[lamp]
        parts, rows = [], []
        for k in np.unique(k_of).tolist():
            own = np.where(k_of == k, of, -1)
            parts.append(regions.at_least(k, own))
            rows.append(np.unique(own[own >= 0]) // len(needed))
        return join(parts).at_least(1, np.concatenate(rows))


def narrow_to_lamps(task: Task, lamps: Lamps | None) -> Task:
    """The task within what lamps ask for: the band of their exposure, the light at their range."""
    if lamps is None:
        return task
    if lamps.has_range and not task.min_illuminance:
        task = replace(task, min_illuminance=LIGHT_AT_RANGE)
    task = task.exposed(lamps.exposure, lamps.unit)
    limits = (getattr(task, name) for name in OF_LIGHT[:2])
    least, most = (x and Quantity(x, getattr(x, "unit", "") or lamps.unit) for x in limits)
    return replace(task, min_illuminance=least, max_illuminance=most)


def brighter_side(
    lamps: Lamps,
    poses: Poses,
    reached: BoolArray,
    on: tuple[FloatArray, FloatArray],
    two_sided: BoolArray,
) -> FloatArray:
    """(N,) illuminance of places with normals, on the side of two-sided faces that gets more."""
    fronts = in_front(eyes_of(lamps.eyes, poses), *on)
    sides = [illuminances(lamps, poses, reached & side, *on) for side in (fronts, ~fronts)]
    return np.where(two_sided, np.maximum(*sides), sides[0])


def carried_on(rig: Rig, lamps: Lamps) -> tuple[BoolArray, BoolArray]:
    """(L, N) lamps that move with a camera of a rig, or one that it measures with; (L,) all these.

    None are on fixed cameras.
    """
    carried = lamps.carried_by(rig.names)
    rides = np.asarray(carried.any(axis=1))
    for at, gate in rig.gates.items():
        own = carried[:, at : at + gate.n]
        own |= own.any(axis=1, keepdims=True)
    return carried & ~rig.is_fixed, rides


def asks_for_light(task: Task) -> bool:
    """True if a threshold applies to light, other than that some lamp reaches a part."""
    return task.max_illuminance is not None or max(task.min_illuminance, task.max_highlight_deg) > 0


def failing_lamp(rig: Rig, lead: Poses, point: FloatArray, normal: FloatArray, reason: int) -> str:
    """Name of the lamp that fails a point, (3,), for a reason of light in one pose.

    The nearest one; for `HIGHLIGHT` the one that is mirrored best.
    """
    lamps = lamps_on(rig)
    assert lamps is not None
    world, (_, rides) = rig._rigs(lead), carried_on(rig, lamps)
    lamps = lamps._around(np.stack((point, point)))
    places = np.where(rides[:, None, None], world @ lamps.places, lamps.places)
    away = eyes_of(lamps.eyes, Poses.of(places, camera=np.arange(len(lamps)))) - point
    distance = norm(away)
    if reason != HIGHLIGHT:
        return lamps.names[int(distance.argmin())]
    ray = eyes_of(rig, lead[:1])[0] - point
    half = away / np.maximum(distance, TINY)[:, None] + ray / max(float(norm(ray)), TINY)
    along = np.abs(half @ normal) / np.maximum(norm(half), TINY)
    return lamps.names[int(along.argmax())]


def _only(regions: Regions, kept: BoolArray) -> Regions:
    """Some of the pieces of regions, (N,) bool, of all rows; bounds stay."""
    rows = np.flatnonzero(kept)
    xy, starts = choose_polygons(regions.xy, regions.starts, rows)
    undecided = np.zeros(len(regions))
    return regions._with_parts(Kept(xy, starts, rows, polygon_areas(xy, starts), undecided))


def _by_sets(lit: Regions) -> tuple[IntArray, Regions]:
    """Sets of devices (S,), at least one, and regions with a row for each set and row of `lit`.

    Pairs of `lit` without a piece, of which all is undecided, are in those of the first set.
    """
    bits = np.zeros(len(lit), np.int64) if lit.devices is None else lit.devices
    sets, index = np.unique(bits, return_inverse=True)
    sets = sets if len(sets) else np.zeros(1, np.int64)
    n, n_faces = len(lit.pose_ids), lit.mesh.n_faces
    pose = index * n + lit.pose
    order = np.lexsort((lit.face, pose))
    some = lit._with(order, np.arange(0))
    own = lit.pair_pose.astype(np.int64) * n_faces + lit.pair_face
    is_bare = ~np.isin(own, lit.pose.astype(np.int64) * n_faces + lit.face)
    of_pieces = pose[order] * n_faces + some.face
    keys, of = np.unique(np.concatenate([of_pieces, own[is_bare]]), return_inverse=True)
    areas = polygon_areas(some.xy, some.starts)
    at, _ = _find_keys(own, keys % (n * n_faces))
    return sets, replace(
        some,
        pose=pose[order].astype(np.int32),
        pair_pose=(keys // n_faces).astype(np.int32),
        pair_face=(keys % n_faces).astype(np.int32),
        area=np.bincount(of[: len(areas)], areas, len(keys)).astype(np.float64),
        bound=lit.bound[at] if len(keys) else np.zeros(0),
        excess=lit.excess[at] if len(keys) else np.zeros(0),
        pose_ids=np.tile(lit.pose_ids, len(sets)),
        eyes=np.tile(lit.eyes, (len(sets), 1)),
        columns=None,
    )


def _find_keys(keys: IntArray, wanted: IntArray) -> tuple[IntArray, BoolArray]:
    """Rows of ascending keys that are wanted, and whether they are there."""
    at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
    return at, keys[at] == wanted if len(keys) else np.zeros(len(wanted), bool)


def _is_first(keys: IntArray) -> BoolArray:
    """(N,) True at the first of equal keys."""
    is_first = np.zeros(len(keys), bool)
    is_first[np.unique(keys, return_index=True)[1]] = True
    return is_first


def _spread(lit: Regions, regions: Regions, row: IntArray) -> Regions:
    """Pieces of `lit` of a row (R,) each, on the faces where R rows of regions have something."""
    n_faces = lit.mesh.n_faces
    keys = lit.pair_pose.astype(np.int64) * n_faces + lit.pair_face
    at, is_lit = _find_keys(keys, row[regions.pair_pose] * n_faces + regions.pair_face)
    pose = regions.pair_pose[is_lit]
    return _gather_regions(lit, at[is_lit], pose, regions.pose_ids, regions.eyes)


def _gather_regions(
    regions: Regions, pairs: IntArray, pose: Int32Array, pose_ids: IntArray, eyes: FloatArray
) -> Regions:
    """Pieces of some pairs of pose and face, (M,), in other rows of a result, (M,) ascending."""
    n_faces = regions.mesh.n_faces
    of_piece = regions.pose.astype(np.int64) * n_faces + regions.face
    wanted = regions.pair_pose[pairs].astype(np.int64) * n_faces + regions.pair_face[pairs]
    first, last = (np.searchsorted(of_piece, wanted, side) for side in ("left", "right"))
    counts = last - first
    pieces = np.repeat(first - (np.cumsum(counts) - counts), counts) + np.arange(counts.sum())
    return replace(
        regions._with(pieces, pairs),
        pose=np.repeat(pose, counts),
        pair_pose=pose,
        pose_ids=pose_ids,
        eyes=eyes,
        columns=None,
    )
