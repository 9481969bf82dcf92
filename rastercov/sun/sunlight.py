"""Sunlit area, hours and energy of faces and groups by directions to the sun, with self-shadowing.

Each direction is a view along parallel rays, solved as exactly as that of a camera:

    hours = sum w V / D,    energy = sum w E V,

with the area V of a face that the sun lights and D of the whole face, both projected along the
rays, m^2, a weight w, hours, and the irradiance E perpendicular to the rays, W/m^2. Energy is not
divided by the cosine of incidence, so that grazing light stays bounded. The hours of a group are
those by the lit share of its silhouette from the sun, so that frames, panes and triangles do not
change them. A group with several pieces, such as windows, has the least hours of one of them, too.

What all of the disc of the sun lights is bounded from both sides by shadows that edges cast from
it, as in `rastercov.tolerance`. What some of it lights is at least what its middle or one of
`rim_of` lights, and at most what is lit or in such a shadow.
"""

import math
from collections.abc import Iterator
from contextlib import closing
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    check_array,
    check_choice,
    finite_number,
    finite_points,
    frozen_record,
    norm,
    shown,
)
from rastercov.core.area.cells import cells
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.swept import from_both_sides, swept
from rastercov.core.camera import Poses
from rastercov.core.camera.parallel import SUN_RADIUS_DEG
from rastercov.core.camera.sun import unit_directions, views_from
from rastercov.core.camera.viewpoints import cone_of_directions
from rastercov.core.coverage.coverage import in_batches
from rastercov.core.coverage.exact_pass import ExactPass, room_for
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import boxes_of
from rastercov.core.mesh.topology import Topology, components_of
from rastercov.engine import camera_pose
from rastercov.shards import Progress, silent

EDGE_ON = camera_pose.EDGE_ON_RAD
"""Radians between rays and a face up to which the face gets nothing."""
PAIRS_TOGETHER = 1 << 14
"""Pairs of directions and faces that are summed at a time: their figures stay in the cache."""
RINGS = (8, 0.6), (16, 1.0)
"""Directions within the disc of the sun, and their distance from its middle in radii."""
DOUBT_REL = 1e-9
"""Part of a face that some of the disc may light, below which it is not looked for."""
MOST_PIECES = 1000
"""Connected components of a group beyond which it is taken as one piece."""
TOUCHING = 1e-6
"""Distance of bounding boxes of one piece, relative to the diagonal of the mesh."""
MOST = np.array([[[1.0]], [[0.0]]])
"""Largest share, and energy, of what is nearly edge-on."""
LIT_BY = "middle", "all", "some"
"""Parts of the disc that light a point."""


class SunlitAreas(NamedTuple):
    """Areas projected along n directions, m^2, (n, F): lit, whole, bounds of their errors."""

    lit: FloatArray
    whole: FloatArray
    bound: FloatArray


class SunlitPieces(NamedTuple):
    """Figures of M pieces of groups, parts whose bounding boxes do not touch, such as windows.

    Attributes
    ----------
    of_face : (F,) int64
        Piece of each face; -1 for occluders.
    hours, hours_bound : (M,) float64
        Hours of each piece, weighted by the lit share of its silhouette, and the bound of their
        error.
    energy, energy_bound : (M,) float64
        Energy on each piece, Wh, and the bound of its error.
    share, share_bound : (N, M) float64
        Lit share of the silhouette of each piece from the sun, and the bound of its error.
    turned : (N, M) bool
        True where the silhouette of a piece was edge-on since the direction before; for times.
    at : (M, 3) float64
        Middle of the bounding box of each piece, metres.
    """

    of_face: IntArray
    hours: FloatArray
    hours_bound: FloatArray
    energy: FloatArray
    energy_bound: FloatArray
    share: FloatArray
    share_bound: FloatArray
    turned: BoolArray
    at: FloatArray


@frozen_record(repr=False)
class Sunlight(InOneLine):
    """Sunlight on the faces and groups of a mesh, from N directions.

    Attributes
    ----------
    mesh : Mesh
    directions : (N, 3) float64
        Unit vectors to the sun.
    weights, irradiance : (N,) float64
        Hours of each direction, and W/m^2 perpendicular to the rays.
    hours, hours_bound : (F,) float64
        Hours of sun on each face, mean over its area, and the bound of their error.
    energy, energy_bound : (F,) float64
        Energy on each face, Wh, and the bound of its error.
    names : (K,) tuple of str
        Evaluated groups, and the outermost parts that contain them, such as storeys; below, both
        are called groups.
    lit, lit_bound : (N, K) float64
        Lit area of each group, perpendicular to the rays, m^2, and the bound of its error.
    share, share_bound : (N, K) float64
        Lit share of the silhouette of each group from the sun, and the bound of its error.
    part_hours, part_hours_bound : (K,) float64
        Hours of each group, weighted by that share, and the bound of their error.
    part_energy, part_energy_bound : (K,) float64
        Energy on each group, Wh, and the bound of its error.
    part_pieces : (K,) tuple of tuple of int
        Pieces of each group, from 0: parts whose bounding boxes do not touch, such as windows; one
        for a group of more than 1000 of them.
    pieces : SunlitPieces
        Figures of the pieces.
    least : (K,) int64
        Piece of each group with the fewest hours.

    Examples
    --------
    >>> import rastercov as rc
    >>> sunlit = rc.sunlit(rc.shapes.box((2, 2, 2)), [(0, 0, 1), (1, 0, 0)], weights=[1, 3])
    >>> sunlit.hours[[0, 2, 8, 10]].round(6).tolist()  # below, and three of the other sides
    [0.0, 3.0, 0.0, 1.0]
    >>> sunlit.names, sunlit.part_hours.round(6).tolist(), sunlit.part_energy.round(6).tolist()
    (('mesh',), [4.0], [16.0])
    """

    mesh: Mesh
    directions: FloatArray
    weights: FloatArray
    irradiance: FloatArray
    hours: FloatArray
    hours_bound: FloatArray
    energy: FloatArray
    energy_bound: FloatArray
    names: tuple[str, ...]
    lit: FloatArray
    lit_bound: FloatArray
    share: FloatArray
    share_bound: FloatArray
    part_hours: FloatArray
    part_hours_bound: FloatArray
    part_energy: FloatArray
    part_energy_bound: FloatArray
    part_pieces: tuple[tuple[int, ...], ...]
    pieces: SunlitPieces
    least: IntArray


def sunlit(
    mesh: Mesh,
    directions: ArrayLike,
    weights: ArrayLike | None = None,
    irradiance: ArrayLike = 1.0,
    *,
    lit_by: str = "middle",
    step: float = 0.0,
    starts: ArrayLike | None = None,
    threads: int | None = None,
    progress: Progress = silent,
) -> Sunlight:
    """Hours and energy of sun on each face and group, exactly, with the bounds of their errors.

    Occluders shade, targets do not. A face is lit from its front, a two-sided one from either side.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    directions : (N, 3) array_like
        Vectors to the sun, of any length; see `rastercov.sun_directions`.
    weights : (N,) array_like, optional
        Hours of each direction, 0 or more; 1 unless given.
    irradiance : float or (N,) array_like
        Irradiance perpendicular to the rays, W/m^2, 0 or more. With 1, the default, an energy is
        the lit projected area times the hours, m^2 h.
    lit_by : {"middle", "all", "some"}
        A point is lit by the centre of the sun, by all of its disc, or by some of it: the middle
        between two bounds, which are `hours_bound` apart from it. The penumbra lies between what
        "all" and "some" light.
    step : float
        Hours from each direction to the next where these are of times: bounds are then those of
        integrals over time, where values between two times only rise or only fall: an integral is
        then off by half a step of the change. Shade by slats needs steps in which it moves by less
        than one; where a face or piece turns to or from the sun, its share may be any.
    starts : (N,) array_like of bool, optional
        True for directions that do not follow the one before, such as those of sunrise.
    threads : int, optional
        Number of threads; one per core unless given.
    progress : callable, optional
        Called with the number of views done and their total.

    Raises
    ------
    ConfigError
        For directions of length 0, and values outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> roof = rc.shapes.box((1, 1, 0.1), centre=(0.5, 0, 2))
    >>> scene = rc.Mesh.joined([rc.shapes.box((2, 2, 1)), roof], ["house", "roof"])
    >>> sunlit = rc.sunlit(scene, [(0, 0, 1)], irradiance=1000)
    >>> dict(zip(sunlit.names, sunlit.part_energy.round(6).tolist()))  # Wh
    {'house': 3000.0, 'roof': 1000.0}
    """
    towards = unit_directions(directions)
    n = len(towards)
    hours = _each("weights", 1.0 if weights is None else weights, n)
    power = _each("irradiance", irradiance, n)
    check_choice("lit_by", lit_by, list(LIT_BY))
    step, is_first = float(_each("step", step, 1)[0]), np.arange(n) == 0
    if starts is not None:
        wanted = f"{n} of True or False"
        is_first = check_array("starts", starts, "b", wanted, ConfigError)
        if is_first.shape != (n,):
            raise ConfigError(f"expected starts to be {wanted}, got shape {is_first.shape}")
    piece, task = pieces_of(mesh), mesh.task_mask
    piece = np.where(task, np.searchsorted(np.unique(piece[task]), piece), -1)  # in their order
    parts = parts_of(mesh, piece)
    single = [(row,) for row in range(int(piece.max()) + 1)]
    units = {own: row for row, own in enumerate(dict.fromkeys([*parts.values(), *single]))}
    factors, total = np.stack((np.ones(n), power)), n * (1 + len(units))
    rates = np.repeat(hours * factors, 2, axis=0)
    sums, alone = np.zeros((4, mesh.n_faces)), np.zeros((2, n))
    rate, changes = np.zeros((2, 1, mesh.n_faces)), 0.0
    of_piece, sides = np.zeros((3, n, max(len(single), 1))), np.zeros((1, mesh.n_faces))
    edge_on = np.zeros((n, len(units)), bool)
    left_out = None if mesh.task_mask.all() else ~mesh.task_mask
    observation = _observe_sun(mesh, towards, left_out, threads)
    if lit_by != "middle":
        observation = _of_disc(mesh, towards, lit_by, threads)
    row = 0
    for some in observation:
        if not len(some.lit):
            continue
        rows = np.arange(row, row + len(some.lit))
        alone[:, rows] = some.lit.sum(axis=1), some.bound.sum(axis=1)
        lit, whole, bound = some if lit_by == "some" else _facing(mesh, towards[rows], some)
        each = np.stack((_over(lit, whole), _over(2 * bound, whole), lit, bound))
        if step:
            rate = np.append(rate[:, -1:], each[::2] * factors[:, rows, None], axis=1)
            sides = np.append(sides[-1:], np.sign(towards[rows] @ mesh.normals.T) * (whole > 0), 0)
            turned = sides[1:] != sides[:-1]
            change = _changes(rate, is_first[rows], turned)
            change[:, 0] += changes
            changes = change.sum(axis=1)  # as below
            of_piece[2, rows] = _totals(
                np.where(turned, 1.0, -mesh.n_faces * abs(sides[1:])), piece
            )
        each *= rates[:, rows, None]
        each[:, 0] += sums
        sums = each.sum(axis=1)  # one row after the other, whatever their number
        of_piece[:2, rows] = _totals(lit, piece), _totals(bound, piece)
        row += len(rows)
        progress(row, total)
    every = np.zeros((4, n, len(units)))
    for own, row in units.items():
        faces = np.isin(piece, own)
        known = alone if faces.all() and lit_by == "middle" and not mesh.has_targets else None
        lit = of_piece[:, :, own].sum(axis=2)
        edge_on[:, row] = lit[2] > 0
        every[:, :, row] = *lit[:2], *_shares(mesh, towards, faces, lit, known, threads)
        progress(n * (2 + row), total)
    integrals = np.stack((hours @ every[2:], rates[2] @ every[:2]))
    integrals[:, 1] += step_error(every[2::-2] * factors[..., None], step, is_first, edge_on)
    sums[1::2] += step / 2 * (changes + rate[:, -1])
    rows_of = [[units[own] for own in some] for some in (parts.values(), single)]
    sizes = [np.concatenate([each[:, rows] for each in integrals]) for rows in rows_of]
    least = [min(each, key=sizes[1][0].tolist().__getitem__) for each in parts.values()]
    low, high = boxes_of(piece[mesh.task_mask], mesh.vertices[mesh.faces[mesh.task_mask]])
    figures = piece, *sizes[1], *every[2:].take(rows_of[1], axis=2), edge_on[:, rows_of[1]]
    pieces = SunlitPieces._make((*figures, (low + high) / 2))
    totals = *every.take(rows_of[0], axis=2), *sizes[0], tuple(parts.values()), pieces
    names = tuple(parts)
    return Sunlight(*(mesh, towards, hours, power, *sums, names, *totals, np.array(least, int)))


def step_error(
    values: FloatArray, step: float, is_first: BoolArray, turned: BoolArray
) -> FloatArray:
    """(2, K) bound of the error of integrals of shares and energies at times, (2, n, K)."""
    change = _changes(np.pad(values, ((0, 0), (1, 0), (0, 0))), is_first, turned)
    return step / 2 * (change.sum(axis=1) + values[:, -1:].sum(axis=1))


def _changes(values: FloatArray, is_first: BoolArray, turned: BoolArray) -> FloatArray:
    """(2, n, K) changes of n + 1 shares and energies, that of the first of an arc from and to 0.

    What turned, (n, K), was edge-on meanwhile: its energy was 0, its share anything.
    """
    before, after = values[:, :-1], values[:, 1:]
    both = before + after
    change = np.where(turned, np.maximum(both, 2 * MOST - both), abs(after - before))
    return np.where(is_first[:, None], both, change)


def parts_of(mesh: Mesh, piece: IntArray) -> dict[str, tuple[int, ...]]:
    """Pieces of the groups to evaluate by their names, and of each outermost part."""
    numbers_by_key: dict[str, tuple[int, ...]] = {}
    outer: dict[str, tuple[int, ...]] = {}
    own, first = np.unique(piece, return_index=True)
    group = mesh.face_group[first]
    for row in np.unique(group).tolist():
        name, pieces = mesh.groups[row].name, tuple(own[group == row].tolist())
        if not mesh.groups[row].is_occluder:
            numbers_by_key[name] = pieces
            if "/" in name:
                above = name.split("/")[0]
                outer[above] = (*outer.get(above, ()), *pieces)
    return numbers_by_key | outer


def pieces_of(mesh: Mesh, *, are_judged: bool = False) -> IntArray:
    """(F,) number of the piece of each face; pieces of a group have boxes that do not touch.

    A group of one piece, or of more than `MOST_PIECES`, has its own number. ConfigError for these
    where pieces are judged.
    """
    n, n_vertices = len(mesh.groups), mesh.n_vertices
    piece = mesh.face_group.astype(np.int64)
    component = Topology.of(
        mesh.welded_faces + piece[:, None] * n_vertices, n * n_vertices
    ).components()
    boxes = np.stack(boxes_of(component, mesh.vertices[mesh.faces]), axis=1)
    group = np.zeros(len(boxes), np.int64)
    group[component] = piece
    margin = TOUCHING * float(norm(np.ptp(mesh.bounds, axis=0)))
    number = group.copy()
    for row in np.flatnonzero(np.bincount(group) > 1).tolist():
        own = np.flatnonzero(group == row)
        if mesh.groups[row].is_occluder:
            continue
        if len(own) > MOST_PIECES:
            if are_judged:
                raise ConfigError(
                    f"--at-least: expected at most {MOST_PIECES:,} pieces of a group, got "
                    f"{len(own):,} of {mesh.groups[row].name}; divide it, or take others with --of"
                )
            continue
        cluster = _separate(boxes[own], margin)
        if (k := int(cluster.max()) + 1) > 1:
            number[own] = n + cluster
            n += k
    return number[component]


def _separate(boxes: FloatArray, margin: float) -> IntArray:
    """(C,) number of the cluster of each box, (C, 2, 3); those around clusters are apart."""
    cluster = np.arange(len(boxes))
    while True:
        is_below = (boxes[:, None, 0] - boxes[:, 1] <= margin).all(axis=2)
        of = components_of(len(boxes), np.argwhere(is_below & is_below.T))
        if of.max() == len(boxes) - 1:
            return cluster
        cluster, boxes = of[cluster], np.stack(boxes_of(of, boxes), axis=1)


def _totals(areas: FloatArray, piece: IntArray) -> FloatArray:
    """(n, max + 1) sums of areas, (n, F), by pieces; those of no piece are 0."""
    number = np.maximum(piece, 0)
    n = int(number.max()) + 1
    keys = np.add.outer(np.arange(len(areas)) * n, number)
    sums = np.bincount(keys.ravel(), areas.ravel(), len(areas) * n)
    return sums.reshape(-1, n).astype(np.float64, copy=False)


def divide_targets(mesh: Mesh, size: float) -> Mesh:
    """The mesh with faces to evaluate whose sides are up to a size, m, and its occluders."""
    pieces, others = cells(mesh, size), np.flatnonzero(~mesh.task_mask)
    corners = [pieces.vertices, mesh.vertices[mesh.faces[others]].reshape(-1, 3)]
    group = np.concatenate([mesh.face_group[pieces.source_face], mesh.face_group[others]])
    faces = np.arange(3 * len(group)).reshape(-1, 3)
    return Mesh(np.concatenate(corners), faces, mesh.groups, group, spaces=mesh.spaces)


def _each(name: str, values: ArrayLike, n: int) -> FloatArray:
    """(n,) values of 0 or more of the directions; ConfigError for others."""
    is_one = isinstance(values, float | int)
    if is_one and not finite_number(values) >= 0:
        raise ConfigError(f"expected {name} of 0 or more, got {shown(values)}; correct it")
    wanted = f"{n} numbers of 0 or more"
    given = np.full(n, values) if np.ndim(values) == 0 else values
    points = finite_points(name, given, (n,), wanted)
    if not (points >= 0).all():
        raise ConfigError(
            f"expected {name} to be {wanted}, got {shown(values)}; leave out the rest"
        )
    return points


def _over(areas: FloatArray, whole: FloatArray) -> FloatArray:
    """Areas over those of the whole, at most 1, 0 where there is none."""
    return np.minimum(np.divide(areas, whole, np.zeros(areas.shape), where=whole > 0), 1)


def _facing(mesh: Mesh, directions: FloatArray, some: SunlitAreas) -> SunlitAreas:
    """Areas of the faces to evaluate, 0 of those that turn away or are edge-on, in place."""
    areas = np.where(mesh.task_mask, mesh.areas, 0.0)
    faces = np.ascontiguousarray(mesh.normals), areas, mesh.two_sided_mask
    camera_pose.keep_front(np.ascontiguousarray(directions), faces, *some)
    return some


def _observe_sun(
    mesh: Mesh, directions: FloatArray, left_out: BoolArray | None, threads: int | None
) -> Iterator[SunlitAreas]:
    """Lit and whole areas of faces, some directions after the others."""
    camera, matrices = views_from(directions, mesh.bounds)
    per_m2, step = camera.fx * camera.fy, max(1, PAIRS_TOGETHER // mesh.n_faces)
    engine = Engine.of("certified", threads)
    with closing(ExactPass(mesh, camera, engine)) as solver:
        for poses in in_batches(Poses.of(matrices), mesh.n_faces, solver.threads):
            seen = room_for(len(poses), mesh.n_faces)
            solver.observe(poses, seen, left_out)
            every = seen.visible_pixels, seen.drawn_pixels, seen.area_error
            for row in range(0, len(poses), step):
                yield SunlitAreas(*(each[row : row + step] / per_m2 for each in every))


def _of_disc(
    mesh: Mesh, directions: FloatArray, lit_by: str, threads: int | None
) -> Iterator[SunlitAreas]:
    """The same of what all or some of the disc of the sun lights."""
    both = from_both_sides(mesh)
    camera, matrices = views_from(directions, mesh.bounds)
    tangent = math.tan(math.radians(SUN_RADIUS_DEG))
    inner = rim_of(directions)
    _, rim = views_from(inner.reshape(-1, 3), mesh.bounds)
    rim = rim.reshape(*inner.shape[:2], 4, 4)
    with (
        closing(RegionPass(both, camera, threads=threads)) as finder,
        closing(RegionPass(mesh, camera, threads=threads, only_task=True)) as samples,
    ):
        for poses in in_batches(Poses.of(matrices), mesh.n_faces, finder.threads):
            seen = finder.find(poses)
            least, most, possible = np.moveaxis(
                swept(finder, poses, seen, mesh.task_mask, tangent), 2, 0
            )
            height = directions[poses.ids] @ mesh.normals.T
            cosine = np.abs(height)
            crossed = cosine <= math.sin(math.atan(tangent)) * (1 + EDGE_ON)
            if lit_by == "some":
                most, is_away = np.where(crossed, mesh.areas, possible), height <= 0
                is_away &= ~mesh.two_sided_mask  # only the middle is behind crossed ones
                least = _of_rim(samples, rim[poses.ids], seen.areas(), most) * ~is_away
                cosine = np.maximum(cosine, EDGE_ON) * (mesh.task_mask & (crossed | ~is_away))
            else:
                least, most = np.where(crossed, 0.0, least), np.where(crossed, 0.0, most)
            bound = np.maximum(most - least, 0) / 2 + seen.bounds()
            yield SunlitAreas((least + most) / 2 * cosine, mesh.areas * cosine, bound * cosine)


def rim_of(directions: FloatArray) -> FloatArray:
    """(N, K, 3) unit vectors to the disc of the sun around unit vectors, in `RINGS`."""
    tangent = math.tan(math.radians(SUN_RADIUS_DEG))
    angles = [math.atan(part * tangent * math.cos(math.pi / n)) for n, part in RINGS]
    rings = [
        cone_of_directions(directions, n, math.degrees(angle))
        for (n, _), angle in zip(RINGS, angles, strict=True)
    ]
    return np.concatenate(rings, axis=1)


def _of_rim(
    finder: RegionPass, matrices: FloatArray, least: FloatArray, most: FloatArray
) -> FloatArray:
    """Areas that `rim_of` lights, (P, F), where more than at least may be; poses (P, K, 4, 4)."""
    of_rim = least.copy()
    for row, own in enumerate(matrices):
        closed = most[row] - least[row] <= DOUBT_REL * finder.mesh.areas
        if not closed.all():
            seen = finder.find(Poses.of(own), closed).at_least(1, np.zeros(len(own), np.int64))
            lit = seen.areas()[0] - seen.bounds()[0]
            of_rim[row] = np.where(closed, least[row], np.maximum(lit, least[row]))
    return of_rim


def _shares(
    mesh: Mesh,
    directions: FloatArray,
    faces: BoolArray,
    lit: FloatArray,
    whole: FloatArray | None,
    threads: int | None,
) -> FloatArray:
    """(2, n) lit shares of the silhouette of faces, and bounds, of areas and their bounds, (2, n).

    `whole` are those of the silhouette if they are known; otherwise the faces are solved alone.
    """
    rows = np.flatnonzero(lit[0])
    used, corners = np.unique(mesh.faces[faces], return_inverse=True)
    if whole is None:
        alone = Mesh(mesh.vertices[used], corners.reshape(-1, 3))
        every = _observe_sun(alone, directions[rows], None, threads)
        sums = [(some.lit.sum(axis=1), some.bound.sum(axis=1)) for some in every]
        whole = np.zeros((2, len(directions)))
        if sums:
            whole[:, rows] = np.concatenate(sums, axis=1)
    return _over(np.stack((lit[0], lit[1] + whole[1])), np.where(lit[0], whole[0], 0.0))
