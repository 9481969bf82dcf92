"""Sunlit area, hours and energy of faces and groups by directions to the sun, with self-shadowing.

Each direction is a view along parallel rays, solved as exactly as that of a camera:

    hours = sum w V / D,    energy = sum w E V,

with the area V of a face that the sun lights and D of the whole face, both across the rays, m^2, a
weight w, hours, and the irradiance E across the rays, W/m^2. Energy is not divided by the cosine of
incidence, so that grazing light stays bounded. The hours of a group are those by the lit share of
its silhouette from the sun, so that frames, panes and triangles do not change them.

The disc of the sun is its middle, or an octagon around it: what all of its corners light, or some.
"""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import check_choice, finite_points
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import InOneLine
from rastercov.base.memory import BoolArray, FloatArray, IntArray
from rastercov.camera.pose import Poses
from rastercov.camera.sun import disc, unit_directions, views_from
from rastercov.coverage.area.cells import cells
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.coverage import in_batches
from rastercov.coverage.engine import Engine
from rastercov.coverage.exact_pass import ExactPass, room_for
from rastercov.mesh import Mesh

EDGE_ON = 1e-9
"""Radians between rays and a face up to which the face gets nothing."""
CORNERS = 8
"""Corners of the polygon around the disc of the sun."""
LIT_BY = {"middle": 0, "all": CORNERS, "some": 1}
"""Corners of the disc that must light a point, 0 for its middle alone."""
Progress = Callable[[int, int], None]


class Lit(NamedTuple):
    """Areas of faces across the rays, m^2, in some directions, (n, F) each, and these (n,)."""

    rows: slice
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

    @property
    def part_hours(self) -> FloatArray:
        """(K,) hours of each part, by the lit share of its silhouette."""
        return self.weights @ self.share

    @property
    def part_hours_bound(self) -> FloatArray:
        """(K,) bounds of their errors."""
        return self.weights @ self.share_bound

    @property
    def part_energy(self) -> FloatArray:
        """(K,) Wh on each part."""
        return (self.weights * self.irradiance) @ self.lit

    @property
    def part_energy_bound(self) -> FloatArray:
        """(K,) bounds of their errors."""
        return (self.weights * self.irradiance) @ self.lit_bound


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
        Hours that each stands for, 0 or more; 1 unless given.
    irradiance : float or (N,) array_like
        Across the rays, W/m^2, 0 or more. For 1, energies are areas across the rays by hours.
    lit_by : {"middle", "all", "some"}
        Middle of the sun; or all or some of the corners of an octagon around its disc, between
        which the penumbra is.
    threads : int, optional
        One per core unless given.
    progress : callable, optional
        Called with the directions done and their total.

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
    once, own = np.unique(towards, axis=0, return_inverse=True)
    per_hour = np.bincount(own, hours, len(once))
    per_watt = np.bincount(own, hours * power, len(once))
    names, of_part = parts_of(mesh)
    sums = np.zeros((4, mesh.n_faces))
    lit, bound, share, off = np.zeros((4, len(once), len(names)))
    for some in _lit(mesh, once, LIT_BY[lit_by], threads):
        hour, watt = per_hour[some.rows], per_watt[some.rows]
        sums[0] += hour @ np.minimum(_over(some.lit, some.whole), 1)
        sums[1] += hour @ np.minimum(_over(2 * some.bound, some.whole), 1)
        sums[2] += watt @ some.lit
        sums[3] += watt @ some.bound
        for part, faces in enumerate(of_part):
            lit[some.rows, part] = some.lit[:, faces].sum(axis=1)
            bound[some.rows, part] = some.bound[:, faces].sum(axis=1)
        progress(some.rows.stop, len(once))
    for part, faces in enumerate(of_part):
        rows = np.flatnonzero(lit[:, part])
        whole, error = _silhouettes(mesh, faces, once[rows], threads)
        share[rows, part] = np.minimum(_over(lit[rows, part], whole), 1)
        off[rows, part] = np.minimum(_over(bound[rows, part] + error, whole), 1)
    given = mesh, towards, hours, power
    of_parts = lit[own], bound[own], share[own], off[own]
    return Sunlight(*given, sums[0], sums[1], sums[2], sums[3], names, *of_parts)


def parts_of(mesh: Mesh) -> tuple[tuple[str, ...], list[IntArray]]:
    """Groups to evaluate with the outermost parts above them, and the faces of each."""
    of_group = {
        group.name: np.flatnonzero(mesh.face_group == row)
        for row, group in enumerate(mesh.groups)
        if not group.is_occluder
    }
    of_group = {name: faces for name, faces in of_group.items() if len(faces)}
    outer: dict[str, list[IntArray]] = {}
    for name, faces in of_group.items():
        if "/" in name:
            outer.setdefault(name.split("/")[0], []).append(faces)
    found = of_group | {name: np.concatenate(faces) for name, faces in outer.items()}
    return tuple(found), list(found.values())


def divided(mesh: Mesh, size: float) -> Mesh:
    """The mesh with faces to evaluate whose sides are up to a size, m, and its occluders."""
    pieces, others = cells(mesh, size), np.flatnonzero(~mesh.task_mask)
    corners = [pieces.vertices, mesh.vertices[mesh.faces[others]].reshape(-1, 3)]
    group = np.concatenate([mesh.face_group[pieces.source_face], mesh.face_group[others]])
    faces = np.arange(3 * len(group)).reshape(-1, 3)
    return Mesh(np.concatenate(corners), faces, mesh.groups, group)


def _each(name: str, values: ArrayLike, n: int) -> FloatArray:
    """(n,) values of 0 or more of the directions; ConfigError for others."""
    given = np.full(n, values) if np.ndim(values) == 0 else values
    wanted = f"{n} numbers of 0 or more"
    found = finite_points(name, given, (n,), wanted)
    if not (found >= 0).all():
        raise ConfigError(
            f"expected {name} to be {wanted}, got {shown(values)}; leave out the rest"
        )
    return found


def _over(area: FloatArray, whole: FloatArray) -> FloatArray:
    """Areas over those of the whole, 0 where there is none."""
    return np.divide(area, whole, np.zeros(area.shape), where=whole > 0)


def _lit(mesh: Mesh, directions: FloatArray, corners: int, threads: int | None) -> Iterator[Lit]:
    """Areas of the faces to evaluate, 0 of those that turn away or are edge-on."""
    task = mesh.task_mask & ~mesh.degenerate_mask
    found = (
        _of_disc(mesh, directions, corners, threads)
        if corners
        else _observed(mesh, directions, ~task, threads)
    )
    for some in found:
        cosine = directions[some.rows] @ mesh.normals.T
        faces = np.where(mesh.two_sided_mask, np.abs(cosine), cosine) > EDGE_ON
        areas = some.lit, some.whole, some.bound
        yield Lit(some.rows, *(np.where(faces & task, each, 0.0) for each in areas))


def _observed(
    mesh: Mesh, directions: FloatArray, left_out: BoolArray | None, threads: int | None
) -> Iterator[Lit]:
    """Lit and whole areas of faces in some directions after the other."""
    camera, matrices = views_from(directions, mesh.bounds)
    per_m2 = camera.fx * camera.fy
    engine = Engine.of("certified", threads)
    with closing(ExactPass(mesh, camera, engine)) as solver:
        done = 0
        for poses in in_batches(Poses.of(matrices), mesh.n_faces, solver.threads):
            seen = room_for(len(poses), mesh.n_faces)
            solver.observe(poses, seen, left_out)
            areas = seen.visible_pixels, seen.drawn_pixels, seen.area_error
            yield Lit(slice(done, done + len(poses)), *(each / per_m2 for each in areas))
            done += len(poses)


def _of_disc(mesh: Mesh, directions: FloatArray, k: int, threads: int | None) -> Iterator[Lit]:
    """The same of what k corners of the disc of the sun light."""
    corners = disc(directions, CORNERS).reshape(-1, 3)
    camera, matrices = views_from(corners, mesh.bounds)
    of = np.repeat(np.arange(len(directions)), CORNERS)
    finder = RegionPass(mesh, camera, threads=threads, only_task=True)
    with closing(finder):
        for poses in in_batches(Poses.of(matrices), mesh.n_faces, finder.threads, of):
            rows = of[poses.ids]
            own = slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)
            found = finder.find(poses).at_least(k, rows)
            cosine = np.abs(directions[own] @ mesh.normals.T)
            areas = found.areas(), np.broadcast_to(mesh.areas, cosine.shape), found.bounds()
            yield Lit(own, *(each * cosine for each in areas))


def _silhouettes(
    mesh: Mesh, faces: IntArray, directions: FloatArray, threads: int | None
) -> tuple[FloatArray, FloatArray]:
    """(n,) areas of faces alone across the rays, m^2, and bounds of their errors."""
    used, corners = np.unique(mesh.faces[faces], return_inverse=True)
    alone = Mesh(mesh.vertices[used], corners.reshape(-1, 3))
    areas, bounds = np.zeros((2, len(directions)))
    for some in _observed(alone, directions, None, threads) if len(directions) else ():
        areas[some.rows], bounds[some.rows] = some.lit.sum(axis=1), some.bound.sum(axis=1)
    return areas, bounds
