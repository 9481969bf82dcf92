"""Sunlit area, hours and energy of faces and groups by directions to the sun, with self-shadowing.

Each direction is a view along parallel rays, solved as exactly as that of a camera:

    hours = sum w V / D,    energy = sum w E V,

with the area V of a face that the sun lights and D of the whole face, both across the rays, m^2, a
weight w, hours, and the irradiance E across the rays, W/m^2. Energy is not divided by the cosine of
incidence, so that grazing light stays bounded. The hours of a group are those by the lit share of
its silhouette from the sun, so that frames, panes and triangles do not change them. A group with
several pieces, such as windows, has the least hours of one of them, too.

The disc of the sun is its middle, or an octagon around it: what all of its corners light, or some.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import check_choice, finite_points
from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import InOneLine
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.parallel import SUN_RADIUS_DEG
from rastercov.camera.pose import Poses
from rastercov.camera.sun import unit_directions, views_from
from rastercov.camera.viewpoints import cone_of_directions
from rastercov.coverage.area.cells import cells
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.coverage import in_batches
from rastercov.coverage.engine import Engine
from rastercov.coverage.exact_pass import ExactPass, room_for
from rastercov.mesh import Mesh
from rastercov.mesh.topology import Topology, components_of

EDGE_ON = 1e-9
"""Radians between rays and a face up to which the face gets nothing."""
PAIRS_TOGETHER = 1 << 14
"""Pairs of directions and faces that are summed at a time: their figures stay in the cache."""
CORNERS = 8
"""Corners of the polygon around the disc of the sun."""
MOST_PIECES, MOST_COMPONENTS = 100, 2000
"""Pieces, and connected components, of a group beyond which it is taken as one."""
TOUCHING = 1e-6
"""Distance of bounding boxes of one piece, relative to the diagonal of the mesh."""
LIT_BY = {"middle": 0, "all": CORNERS, "some": 1}
"""Corners of the disc that must light a point, 0 for its middle alone."""
Progress = Callable[[int, int], None]


class Lit(NamedTuple):
    """Areas across the rays in n directions, m^2, (n, F): lit, whole, bounds of their errors."""

    lit: FloatArray
    whole: FloatArray
    bound: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Sunlight(InOneLine):
    """Sunlight on the faces and groups of a mesh, from N directions.

    Attributes
    ----------
    directions : (N, 3) float64
        Unit vectors to the sun.
    weights, irradiance : (N,) float64
        Hours of each direction, and W/m^2 across the rays.
    hours, hours_bound : (F,) float64
        Hours of sun on each face, mean over its area, and the bound of their error.
    energy, energy_bound : (F,) float64
        Wh on each face, and the bound of its error.
    names : (K,) tuple of str
        Groups to evaluate, and the outermost parts above them, such as storeys.
    lit, lit_bound : (N, K) float64
        Lit area of each across the rays, m^2, and the bound of its error.
    share, share_bound : (N, K) float64
        Lit share of its silhouette from the sun, and the bound of its error.
    part_hours, part_hours_bound : (K,) float64
        Hours of each by that share, and the bound of their error.
    part_energy, part_energy_bound : (K,) float64
        Wh on each, and the bound of its error.
    n_pieces : (K,) int64
        Pieces of each, whose bounding boxes do not touch; 1 for a group of more than `MOST_PIECES`.
    least_hours, least_hours_bound : (K,) float64
        Hours of the piece that gets the least, and the bound of their error.
    least_at : (K, 3) float64
        Its middle, metres.

    Examples
    --------
    >>> import rastercov as rc
    >>> found = rc.sunlit(rc.shapes.box((2, 2, 2)), [(0, 0, 1), (1, 0, 0)], weights=[1, 3])
    >>> found.hours[[0, 2, 8, 10]].round(6).tolist()  # below, and three of the other sides
    [0.0, 3.0, 0.0, 1.0]
    >>> found.names, found.part_hours.round(6).tolist(), found.part_energy.round(6).tolist()
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
    n_pieces: IntArray
    least_hours: FloatArray
    least_hours_bound: FloatArray
    least_at: FloatArray


def sunlit(
    mesh: Mesh,
    directions: ArrayLike,
    weights: ArrayLike | None = None,
    irradiance: ArrayLike = 1.0,
    *,
    lit_by: str = "middle",
    threads: int | None = None,
    progress: Progress = lambda done, total: None,
) -> Sunlight:
    """Hours and energy of sun on each face and group, exactly, with the bounds of their errors.

    Occluders shade, targets do not. A face is lit from its front, a two-sided one from either side.

    Parameters
    ----------
    mesh : Mesh
    directions : (N, 3) array_like
        Vectors to the sun, of any length; see `rastercov.sun_directions`.
    weights : (N,) array_like, optional
        Hours of each, 0 or more; 1 unless given.
    irradiance : float or (N,) array_like
        Across the rays, W/m^2, 0 or more. For 1, energies are areas across the rays by hours.
    lit_by : {"middle", "all", "some"}
        Middle of the sun; or all or some of the corners of an octagon around its disc, between
        which the penumbra is.
    threads : int, optional
        One per core unless given.
    progress : callable, optional
        Called with the views done and their total: directions, and those of each part alone.

    Raises
    ------
    ConfigError
        For directions of length 0, and values outside these limits.

    Examples
    --------
    >>> import rastercov as rc
    >>> roof = rc.shapes.box((1, 1, 0.1), centre=(0.5, 0, 2))
    >>> scene = rc.Mesh.joined([rc.shapes.box((2, 2, 1)), roof], ["house", "roof"])
    >>> found = rc.sunlit(scene, [(0, 0, 1)], irradiance=1000)
    >>> dict(zip(found.names, found.part_energy.round(6).tolist()))  # Wh
    {'house': 3000.0, 'roof': 1000.0}
    """
    towards = unit_directions(directions)
    n = len(towards)
    hours = _each("weights", 1.0 if weights is None else weights, n)
    power = _each("irradiance", irradiance, n)
    check_choice("lit_by", lit_by, list(LIT_BY))
    corners, parts, labels = LIT_BY[lit_by], parts_of(mesh), labels_of(mesh)
    n_labels, n_groups = int(labels.max()) + 1, len(mesh.groups)
    units = [*parts.values(), *([row] for row in range(n_groups + 1, n_labels))]
    rates, total = np.stack((hours, hours, hours * power, hours * power)), n * (1 + len(units))
    sums, alone, of_label = (
        np.zeros((4, mesh.n_faces)),
        np.zeros((2, n)),
        np.zeros((2, n, n_labels)),
    )
    left_out = None if mesh.task_mask.all() else ~mesh.task_mask
    found = _observed(mesh, towards, left_out, threads)
    if corners:
        found = _of_disc(mesh, towards, corners, threads)
    row = 0
    for some in found:
        rows = np.arange(row, row + len(some.lit))
        alone[:, rows] = some.lit.sum(axis=1), some.bound.sum(axis=1)
        lit, whole, bound = _facing(mesh, towards[rows], some)
        each = np.stack((_over(lit, whole), _over(2 * bound, whole), lit, bound))
        each *= rates[:, rows, None]
        each[:, 0] += sums
        sums = each.sum(axis=1)  # one row after the other, whatever their number
        of_label[:, rows] = _totals(lit, labels), _totals(bound, labels)
        row += len(rows)
        progress(row, total)
    every = np.zeros((4, n, len(units)))
    for unit, own in enumerate(units):
        faces = np.logical_or.reduce(np.isin(labels, own))
        known = alone if faces.all() and not (corners or mesh.has_targets) else None
        sizes = of_label[:, :, own].sum(axis=2)
        every[:, :, unit] = *sizes, *_shares(mesh, towards, faces, sizes, known, threads)
        progress(n * (2 + unit), total)
    lit, lit_bound, share, share_bound = every[:, :, : len(parts)]
    unit_hours = hours @ every[2]
    pieces = _pieces_of_parts(parts, labels, n_groups)
    least = [min(own, key=unit_hours.tolist().__getitem__) for own in pieces]
    middles = [_middle(mesh, np.logical_or.reduce(np.isin(labels, units[row]))) for row in least]
    return Sunlight(
        *(mesh, towards, hours, power, sums[0], sums[1], sums[2], sums[3], tuple(parts)),
        *(lit, lit_bound, share, share_bound, hours @ share, hours @ share_bound),
        *(rates[2] @ lit, rates[2] @ lit_bound),
        np.array([len(own) for own in pieces], np.int64),
        *(unit_hours[least], (hours @ every[3])[least], np.reshape(middles, (-1, 3))),
    )


def parts_of(mesh: Mesh) -> dict[str, list[int]]:
    """Groups to evaluate by their names, and those below each outermost part."""
    counts = np.bincount(mesh.face_group, minlength=len(mesh.groups))
    rows = [row for row, group in enumerate(mesh.groups) if counts[row] and not group.is_occluder]
    outer: dict[str, list[int]] = {}
    for row in rows:
        if "/" in (name := mesh.groups[row].name):
            outer.setdefault(name.split("/")[0], []).append(row)
    return {mesh.groups[row].name: [row] for row in rows} | outer


def labels_of(mesh: Mesh) -> IntArray:
    """(L, F) group of each face, and if a group has several pieces, numbers of pieces.

    Pieces have numbers above that of groups, which is that of faces of groups of one piece.
    """
    n_groups, n_vertices = len(mesh.groups), mesh.n_vertices
    apart = mesh.welded_faces + mesh.face_group[:, None].astype(np.int64) * n_vertices
    component = Topology.of(apart, n_groups * n_vertices).components()
    _, first, of_face = np.unique(component, return_index=True, return_inverse=True)
    low, high = np.full((len(first), 3), np.inf), np.full((len(first), 3), -np.inf)
    places = mesh.vertices[mesh.faces]
    np.minimum.at(low, of_face, places.min(axis=1))
    np.maximum.at(high, of_face, places.max(axis=1))
    margin = TOUCHING * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    piece, n = np.full(len(first), n_groups, np.int64), n_groups + 1
    for group in range(n_groups):
        own = np.flatnonzero(mesh.face_group[first] == group)
        if mesh.groups[group].is_occluder or not 1 < len(own) <= MOST_COMPONENTS:
            continue
        cluster = _apart(low[own] - margin, high[own])
        if 1 < (k := int(cluster.max()) + 1) <= MOST_PIECES:
            piece[own] = n + cluster
            n += k
    groups = mesh.face_group.astype(np.int64)
    return groups[None] if n == n_groups + 1 else np.stack((groups, piece[of_face]))


def _apart(low: FloatArray, high: FloatArray) -> IntArray:
    """(C,) number of the cluster of each box, so that boxes around clusters do not touch."""
    cluster = np.arange(len(low))
    while True:
        touch = ((low[:, None] <= high) & (high[:, None] >= low)).all(axis=2)
        of = components_of(len(low), np.argwhere(touch))
        if (k := int(of.max()) + 1) == len(low):
            return cluster
        cluster = of[cluster]
        order, starts = np.argsort(of, kind="stable"), np.searchsorted(np.sort(of), np.arange(k))
        low = np.minimum.reduceat(low[order], starts)
        high = np.maximum.reduceat(high[order], starts)


def _pieces_of_parts(
    parts: dict[str, list[int]], labels: IntArray, n_groups: int
) -> list[list[int]]:
    """Pieces of each part, as units: parts, and then the pieces of groups of several."""
    split: dict[int, list[int]] = {}
    if len(labels) > 1:
        for group, piece in np.unique(labels[:, labels[1] > n_groups], axis=1).T.tolist():
            split.setdefault(group, []).append(len(parts) + piece - n_groups - 1)
    for row, own in enumerate(parts.values()):
        if len(own) == 1:
            split.setdefault(own[0], [row])
    return [[each for group in own for each in split[group]] for own in parts.values()]


def _totals(areas: FloatArray, labels: IntArray) -> FloatArray:
    """(n, max + 1) sums of areas, (n, F), by labels, (L, F)."""
    n = int(labels.max()) + 1
    keys = np.add.outer(np.arange(len(areas)) * n, labels)
    repeated = np.broadcast_to(areas[:, None], keys.shape)
    sums = np.bincount(keys.ravel(), repeated.ravel(), len(areas) * n)
    return sums.reshape(-1, n).astype(np.float64, copy=False)


def _middle(mesh: Mesh, faces: BoolArray) -> FloatArray:
    """Middle of the bounding box of some faces, (F,)."""
    places = mesh.vertices[mesh.faces[faces]].reshape(-1, 3)
    middle: FloatArray = (places.min(axis=0) + places.max(axis=0)) / 2
    return middle


def divided(mesh: Mesh, size: float) -> Mesh:
    """The mesh with faces to evaluate whose sides are up to a size, m, and its occluders."""
    pieces, others = cells(mesh, size), np.flatnonzero(~mesh.task_mask)
    corners = [pieces.vertices, mesh.vertices[mesh.faces[others]].reshape(-1, 3)]
    group = np.concatenate([mesh.face_group[pieces.source_face], mesh.face_group[others]])
    faces = np.arange(3 * len(group)).reshape(-1, 3)
    return Mesh(np.concatenate(corners), faces, mesh.groups, group)


def _each(name: str, values: ArrayLike, n: int) -> FloatArray:
    """(n,) values of 0 or more of the directions; ConfigError for others."""
    is_one = isinstance(values, float | int)
    if is_one and not finite_number(values) >= 0:
        raise ConfigError(f"expected {name} of 0 or more, got {shown(values)}; correct it")
    wanted = f"{n} numbers of 0 or more"
    given = np.full(n, values) if np.ndim(values) == 0 else values
    found = finite_points(name, given, (n,), wanted)
    if not (found >= 0).all():
        raise ConfigError(
            f"expected {name} to be {wanted}, got {shown(values)}; leave out the rest"
        )
    return found


def _over(areas: FloatArray, whole: FloatArray) -> FloatArray:
    """Areas over those of the whole, at most 1, 0 where there is none."""
    return np.minimum(np.divide(areas, whole, np.zeros(areas.shape), where=whole > 0), 1)


def _facing(mesh: Mesh, directions: FloatArray, some: Lit) -> Lit:
    """Areas of the faces to evaluate, 0 of those that turn away or are edge-on."""
    task = mesh.task_mask & ~mesh.degenerate_mask
    cosine = directions @ mesh.normals.T
    facing = np.where(task, np.where(mesh.two_sided_mask, np.abs(cosine), cosine), -1.0)
    is_lit = facing > EDGE_ON
    lit, whole, bound = (np.where(is_lit, each, 0.0) for each in some)
    return Lit(lit, whole, np.where((facing > 0) & ~is_lit, facing * mesh.areas, bound))


def _observed(
    mesh: Mesh, directions: FloatArray, left_out: BoolArray | None, threads: int | None
) -> Iterator[Lit]:
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
                yield Lit(*(each[row : row + step] / per_m2 for each in every))


def _of_disc(mesh: Mesh, directions: FloatArray, k: int, threads: int | None) -> Iterator[Lit]:
    """The same of what k corners of the disc of the sun light."""
    corners = cone_of_directions(directions, CORNERS, SUN_RADIUS_DEG).reshape(-1, 3)
    camera, matrices = views_from(corners, mesh.bounds)
    of = np.repeat(np.arange(len(directions)), CORNERS)
    with closing(RegionPass(mesh, camera, threads=threads, only_task=True)) as finder:
        for poses in in_batches(Poses.of(matrices), mesh.n_faces, finder.threads, of):
            found = finder.find(poses).at_least(k, of[poses.ids])
            cosine = np.abs(directions[np.unique(of[poses.ids])] @ mesh.normals.T)
            yield Lit(found.areas() * cosine, mesh.areas * cosine, found.bounds() * cosine)


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
        every = _observed(alone, directions[rows], None, threads)
        sums = [(some.lit.sum(axis=1), some.bound.sum(axis=1)) for some in every]
        whole = np.zeros((2, len(directions)))
        if sums:
            whole[:, rows] = np.concatenate(sums, axis=1)
    return _over(np.stack((lit[0], lit[1] + whole[1])), np.where(lit[0], whole[0], 0.0))
