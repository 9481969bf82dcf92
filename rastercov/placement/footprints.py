"""Footprints: polygons on the plan, z up, of what each image covers of a surface.

    poses -> exact regions -> those of the ground, or seen from above -> on the plan -> union

The surface is some groups, such as the ground, or what is seen from above, by parallel rays. A part
counts where both the image and this view cover it. Overlaps of a survey are those of the images
whose footprints do not end at the outer edge of the surface.
"""

import re
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np
import shapely
from numpy.typing import NDArray

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    FloatArray,
    Int32Array,
    IntArray,
    MeshError,
    ReadByName,
    cos,
    dots,
    frozen_record,
    matmul,
    norm,
    offsets_of,
    owners_of,
    percent,
    read_only,
)
from rastercov.core.area import polygons
from rastercov.core.area.polygons import frames_of, to_world
from rastercov.core.area.regions import RegionPass, check_pointwise
from rastercov.core.area.table import Regions, join, take_rows
from rastercov.core.camera import Camera, Cameras, Poses, cameras_of, look_at
from rastercov.core.coverage.coverage import in_batches
from rastercov.core.coverage.face_pass import lens_of
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import faces_of_groups, names_of
from rastercov.core.mesh.sections import polygons_in
from rastercov.engine import coverage_spread

SNAP_REL = 1e-8
"""Grid of the corners of footprints, relative to the extent: neighbours meet at equal corners."""
WHOLE_REL = 1e-9
"""Part of its area that a whole face may lack."""
TURN_DEG = 30.0
"""Change of direction at which a strip of images ends."""
LEAST_OF_STRIP = 3
"""Images of a strip."""
STRAIGHT_REL = 0.9
"""Distance between the ends of a strip at least, of its length; shorter ones have no sides."""
EDGE_GRID = 10
"""Distance, in steps of the grid, up to which a footprint ends at the edge of the surface."""
SPREAD = 0.005
"""Relative difference of densities on a piece that may hold the median."""
LEAST_PART = 1e-6
"""Part of the area of an image that is divided no further."""
PLACES_OF_TRIANGLE = np.array(
    [*np.eye(3), *(1 - np.eye(3)) / 2, np.full(3, 1 / 3)]  # corners, middles of sides, centroid
)
"""(7, 3) weights of the corners at places of a triangle where densities are compared."""
PLAN_IMAGE = 1000
"""Pixels of the view from above; what it sees does not depend on them."""


@frozen_record
class Footprints:
    """Footprints of P images.

    Attributes
    ----------
    names : tuple of str
        Of the images.
    polygons : (P,) object
        shapely geometry of each on the plan, x and y in metres, with its holes.
    area_m2 : (P,) float64
        Area on the plan, of the exact regions.
    surface_m2 : (P,) float64
        Covered area of the surface itself.
    gsd : (P,) float64
        Median ground sampling distance by area, to 1 %, metres per pixel in the worst direction on
        the surface; NaN for an image that covers nothing.
    height : (P,) float64
        Mean z of what each covers, metres.
    at_edge : (P,) bool
        True where the footprint ends at the outer edge of the surface, or is empty.
    poses : Poses
        Of the images, with the camera of each.
    surface : str
        Name of the surface, for people.
    """

    names: tuple[str, ...]
    polygons: NDArray[np.object_]
    area_m2: FloatArray
    surface_m2: FloatArray
    gsd: FloatArray
    height: FloatArray
    at_edge: BoolArray
    poses: Poses
    surface: str

    @classmethod
    def empty(cls) -> Self:
        """Those of no image."""
        none = np.zeros(0)
        poses = Poses.of(np.zeros((0, 4, 4)))
        return cls((), np.zeros(0, object), none, none, none, none, none > 0, poses, "")

    @property
    def _eyes(self) -> FloatArray:
        """(P, 2) centres of the cameras on the plan."""
        return self.poses.world_from_camera[:, :2, 3]

    @cached_property
    def strips(self) -> list[IntArray]:
        """Rows of the images of each flight strip of a camera, in the order of their names."""
        order = np.array(sorted(range(len(self.names)), key=lambda row: _natural(self.names[row])))
        items = []
        for index in np.unique(self.poses.camera).tolist():
            rows = order[self.poses.camera[order] == index]
            items += [rows[own] for own in _strips(self._eyes[rows])]
        return items

    @cached_property
    def overlaps(self) -> tuple[FloatArray, FloatArray]:
        """Front and side overlap of each image, shares of its footprint, (P,); NaN for none.

        Front is the share that the next image of the strip covers, side the share that the images
        of the nearest strip to one side cover, the greater of both sides.
        """
        (front, side), _ = self._pairs
        return front, side

    @cached_property
    def _pairs(self) -> tuple[FloatArray, BoolArray]:
        """Front and side overlaps (2, P), and which of them the edge of nothing cuts short.

        Those are of images that do not reach the edge, and for the side, between the ends of the
        strip that covers most.
        """
        front, side = values = np.full((2, len(self.names)), np.nan)
        is_inner = np.tile(~self.at_edge, (2, 1))
        whole = np.maximum(shapely.area(self.polygons), TINY)
        for strip in self.strips:
            for row, after in pairwise(strip.tolist()):
                shared = shapely.intersection(self.polygons[row], self.polygons[after])
                front[row] = shapely.area(shared) / whole[row]
        united = [shapely.union_all(self.polygons[strip]) for strip in self.strips]
        for one, strip in enumerate(self.strips):
            same = self.poses.camera[strip[0]]
            own = [
                row for row, each in enumerate(self.strips) if self.poses.camera[each[0]] == same
            ]
            beside = _beside(self._eyes, [self.strips[row] for row in own], own.index(one))
            for other in (own[row] for row in beside):
                shared = shapely.intersection(self.polygons[strip], united[other])
                share = shapely.area(shared) / whole[strip]
                is_more = ~(share <= side[strip])
                is_along = _is_along(self._eyes[strip], self._eyes[self.strips[other]])
                is_inner[1, strip[is_more]] = (is_along & ~self.at_edge[strip])[is_more]
                side[strip[is_more]] = share[is_more]
        return values, is_inner & np.isfinite(values)

    def overlap_figures(self) -> dict[str, float | None]:
        """Median and least of the overlaps that no edge cuts short, percent; None for none."""
        values, is_inner = self._pairs
        figures = {}
        for name, own, kept in zip(("front", "side"), values, is_inner, strict=True):
            inner = 100 * own[kept]
            figures[f"{name}_percent"] = _median(inner)
            figures[f"{name}_least_percent"] = float(inner.min()) if len(inner) else None
        return figures

    def summary(self) -> ByName:
        """Figures, ready for JSON: metres, and shares in percent; None where there are none."""
        front, side = self.overlaps
        entries = [
            {
                "name": name,
                "plan_m2": float(self.area_m2[row]),
                "surface_m2": float(self.surface_m2[row]),
                "gsd_per_px": _or_none(self.gsd[row]),
                "front_percent": _or_none(100 * front[row]),
                "side_percent": _or_none(100 * side[row]),
                "at_edge": bool(self.at_edge[row]),
            }
            for row, name in enumerate(self.names)
        ]
        return {
            "surface": self.surface,
            "union_m2": float(shapely.area(shapely.union_all(self.polygons))),
            "strips": len(self.strips),
            "gsd_per_px": _median(self.gsd),
            **self.overlap_figures(),
            "images": entries,
        }


def overlap_words(figures: ReadByName) -> str:
    """Words on the overlaps in a summary; none without strips."""
    words = [
        f"{name} {percent(median / 100)} (least {percent(figures[f'{name}_least_percent'] / 100)})"
        for name in ("front", "side")
        if (median := figures[f"{name}_percent"]) is not None
    ]
    if words:
        return f"median overlap: {', '.join(words)}"
    unknown = "overlap unknown, as each image of a strip reaches the edge of the surface"
    return unknown if figures["strips"] else ""


def _natural(name: str) -> list[tuple[int, int | str]]:
    """Key by which "image 9" comes before "image 10"."""
    parts = re.split(r"(\d+)", name)
    return [(1, int(part)) if part.isdecimal() else (0, part) for part in parts]


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _median(values: FloatArray) -> float | None:
    """Median of the finite ones."""
    own = values[np.isfinite(values)]
    return float(np.median(own)) if len(own) else None


def footprints(
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    task: Task,
    *,
    names: Sequence[str],
    groups: Sequence[str] = (),
    method: str | Engine = "certified",
) -> Footprints:
    """Footprints of images on groups of a mesh, or on what is seen from above.

    Parameters
    ----------
    mesh, camera, poses, task
        As for `rastercov.regions`; z is up.
    names : sequence of str
        Name of each pose.
    groups : sequence of str
        Groups of the surface, names or patterns; what is seen from above if empty.
    method : {"certified", "exact"}, or Engine

    Raises
    ------
    MeshError
        For an unknown group, and for one that is not evaluated.
    ConfigError
        For thresholds of faces.
    """
    chosen = surface_of_footprints(mesh, task, groups, method)
    surface = project_down(_facing_up(mesh, chosen) if groups else mesh)
    above = None if groups else surface
    grid = SNAP_REL * float(np.ptp(mesh.bounds[:, :2], axis=0).max())
    values = np.empty(len(poses), object)
    sums = np.zeros((4, len(poses)))
    with closing(RegionPass(mesh, camera, task, method=method, only_task=True)) as finder:
        first = 0
        for part in in_batches(poses, mesh.n_faces, finder.threads):
            regions = finder.find(part, closed=~chosen)
            for condition in finder.conditions:
                regions = condition.of_cameras(regions, camera, part)
            seen = regions if above is None else _both(regions, above)
            rows = np.arange(first, first + len(part))
            values[rows] = _unite(seen, len(part), grid)
            sums[:, rows] = _figures(seen, part, cameras_of(camera))
            first += len(part)
    edge = shapely.MultiLineString(
        list(shapely.get_exterior_ring(_unite(surface, 1, grid)[0].geoms))
    )
    shapely.prepare(edge)
    return Footprints(
        names=tuple(names),
        polygons=values,
        area_m2=sums[0],
        surface_m2=sums[1],
        gsd=sums[2],
        height=sums[3],
        at_edge=shapely.is_empty(values) | shapely.dwithin(edge, values, EDGE_GRID * grid),
        poses=poses,
        surface=", ".join(groups) or "the surface seen from above",
    )


def surface_of_footprints(
    mesh: Mesh, task: Task, groups: Sequence[str], method: str | Engine
) -> BoolArray:
    """(F,) evaluated faces of groups, of all for none; arguments and errors of `footprints`."""
    check_pointwise(task, Engine.of(method).method)
    chosen = mesh.task_mask
    if groups:
        wanted = names_of_groups("surface", groups, names_of(mesh)) or set()
        chosen = faces_of_groups(mesh, wanted)
        if (chosen & ~mesh.task_mask).any():
            name = mesh.groups[int(mesh.face_group[chosen & ~mesh.task_mask][0])].name
            raise MeshError(
                f"expected an evaluated group as surface, got occluder {name}; give it another role"
            )
    return chosen


def _facing_up(mesh: Mesh, chosen: BoolArray) -> Mesh:
    """Some faces alone; two-sided ones with the side that is up."""
    faces = mesh.faces[chosen]
    is_down = (mesh.two_sided_mask & (mesh.normals[:, 2] < 0))[chosen]
    return Mesh(mesh.vertices, np.where(is_down[:, None], faces[:, ::-1], faces))


def project_down(mesh: Mesh) -> Regions:
    """Parts of the evaluated faces that parallel rays from above, along -z, meet; one row."""
    middle = mesh.centre
    extent = max(float(np.ptp(mesh.bounds, axis=0).max()), 1e-9)
    camera = Camera.orthographic(PLAN_IMAGE, PLAN_IMAGE, px_per_m=PLAN_IMAGE / 1.1 / extent)
    pose = look_at(np.add(middle, (0.0, 0.0, extent)), middle, (0.0, 1.0, 0.0))
    with closing(RegionPass(mesh, camera, Task(), only_task=True)) as finder:
        return replace(finder.find(Poses.of(pose)), columns=None)


def _both(regions: Regions, above: Regions) -> Regions:
    """Parts that each of P rows covers and that are seen from above."""
    n = len(regions.pose_ids)
    copies = replace(
        take_rows(above, np.zeros(n, np.int64)), camera=regions.camera, task=regions.task
    )
    rows = np.tile(np.arange(n), 2)
    return join([replace(regions, columns=None), replace(copies, columns=None)]).at_least(2, rows)


def _unite(regions: Regions, n: int, grid: float) -> NDArray[np.object_]:
    """(n,) shapely geometry on the plan of each row.

    Whole faces share corners, and are united without a search for crossings, which takes most of
    the time.
    """
    union = np.full(n, shapely.MultiPolygon(), object)
    corners = regions.points()[:, :2]
    counts = np.diff(regions.starts)
    # A ring is closed: its first corner once more at its end.
    ring = owners_of(counts + 1)
    ends = offsets_of(counts + 1)
    index = np.arange(ends[-1]) - np.repeat(ends[:-1], counts + 1)
    index = np.repeat(regions.starts[:-1], counts + 1) + index % np.repeat(counts, counts + 1)
    snapped = np.rint(corners[index] / grid) * grid
    pieces = shapely.polygons(shapely.linearrings(snapped, indices=ring))
    pieces, areas = shapely.normalize(pieces), shapely.area(pieces)
    own_area = polygons.polygon_areas(regions.xy, regions.starts)
    is_whole = own_area >= (1 - WHOLE_REL) * frames_of(regions.mesh).areas[regions.face]
    for row in np.unique(regions.pose).tolist():
        own = (regions.pose == row) & (areas > 0)
        whole, others = pieces[own & is_whole], shapely.make_valid(pieces[own & ~is_whole])
        merged = _of_whole(whole, float(areas[own & is_whole].sum()), grid)
        merged = shapely.union_all([merged, *others], grid_size=grid)
        union[row] = shapely.multipolygons(_without_slivers(merged, grid))
    return union


def _of_whole(faces: NDArray[np.object_], total: float, grid: float) -> shapely.Geometry:
    """Union of faces of a total area; an error or the area shows where some overlap on the plan."""
    with suppress(shapely.GEOSException):
        merged = shapely.coverage_union_all(faces)
        is_all = abs(shapely.area(merged) - total) <= WHOLE_REL * total
        if is_all and shapely.is_valid(merged):
            return merged
    return shapely.union_all(faces, grid_size=grid)


def _without_slivers(merged: shapely.Geometry, grid: float) -> NDArray[np.object_]:
    """Polygons of a geometry without parts and holes that are no wider than the grid."""
    rings, polygon = shapely.get_rings(polygons_in(merged), return_index=True)
    sizes = shapely.area(shapely.polygons(rings))
    is_outer = np.diff(polygon, prepend=-1) > 0
    kept = sizes > grid * shapely.length(rings)
    items = []
    for row in polygon[is_outer & kept].tolist():
        own = polygon == row
        holes = rings[own & kept & ~is_outer]
        items.append(shapely.Polygon(rings[own & is_outer][0], list(holes)))
    return shapely.orient_polygons(np.array(items, object))


def _figures(regions: Regions, poses: Poses, cameras: Sequence[Camera]) -> FloatArray:
    """Plan area, surface area, median GSD and mean height of each row, (4, P)."""
    n, areas = len(poses), polygons.polygon_areas(regions.xy, regions.starts)
    kept = np.flatnonzero(areas > 0)
    areas, pose, face = areas[kept], regions.pose[kept], regions.face[kept]
    normals = frames_of(regions.mesh).normal[face]
    xy, starts = polygons.choose_polygons(regions.xy, regions.starts, kept)
    middles = to_world(regions.mesh, face, polygons.centroids(xy, starts, areas))
    surface = np.bincount(pose, areas, n)
    plan = np.bincount(pose, areas * np.abs(normals[:, 2]), n)
    height = np.bincount(pose, areas * middles[:, 2], n) / np.maximum(surface, 1e-300)
    density = np.full(n, np.nan)
    corners, piece = polygons.fans(starts)
    points = to_world(regions.mesh, np.repeat(face, np.diff(starts)), xy)
    for row in np.unique(pose).tolist():
        own = np.flatnonzero(pose[piece] == row)

        def at(points: FloatArray, normals: FloatArray, row: int = row) -> FloatArray:
            """(N,) least pixel density on the surface at points in this pose, px/m."""
            starts, own = np.arange(len(points) + 1), np.full(len(points), row, np.int32)
            return best_densities(starts, own, (points, normals), poses, cameras)[0]

        density[row] = _median_density(points[corners[own]], normals[piece[own]], at)
    gsd = np.divide(1.0, density, np.full(n, np.nan), where=density > 0)
    return np.stack((plan, surface, gsd, np.where(surface > 0, height, np.nan)))


def _median_density(
    corners: FloatArray,
    normals: FloatArray,
    density: Callable[[FloatArray, FloatArray], FloatArray],
) -> float:
    """Median by area, to `SPREAD`, of a density on triangles, (T, 3, 3).

    Triangles on which densities differ are halved where they may hold the median.
    """
    areas, lengths = np.zeros(0), np.zeros((0, 3))
    low, high, new = np.zeros(0), np.zeros(0), slice(None)
    while True:
        own = corners[new]
        lengths = np.concatenate((lengths, norm(own - np.roll(own, -1, axis=1))))
        across = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        areas = np.concatenate((areas, norm(across) / 2))
        places = matmul(PLACES_OF_TRIANGLE, own)
        result = density(places.reshape(-1, 3), np.repeat(normals[new], places.shape[1], axis=0))
        each = result.reshape(len(own), -1)
        low, high = np.append(low, each.min(axis=1)), np.append(high, each.max(axis=1))
        least, most = (polygons.quantile(values, areas, high > 0) for values in (low, high))
        is_open = (high > least) & (low < most) & (high > (1 + SPREAD) * low)
        is_open &= areas > LEAST_PART * areas.sum()
        if most <= (1 + SPREAD) * least or not is_open.any():
            return (least + most) / 2
        rows = np.flatnonzero(is_open)
        turned = corners[rows[:, None], (lengths[rows].argmax(axis=1)[:, None] + range(3)) % 3]
        middle = turned[:, :2].mean(axis=1)
        halves = np.stack((turned, turned), axis=1)
        halves[:, 0, 1] = halves[:, 1, 0] = middle
        kept, new = ~is_open, slice(-2 * len(rows), None)
        corners = np.concatenate((corners[kept], halves.reshape(-1, 3, 3)))
        normals = np.concatenate((normals[kept], np.repeat(normals[rows], 2, axis=0)))
        areas, lengths, low, high = areas[kept], lengths[kept], low[kept], high[kept]


def best_densities(
    starts: IntArray,
    pose: Int32Array,
    on: tuple[FloatArray, FloatArray],
    poses: Poses,
    cameras: Sequence[Camera],
) -> tuple[FloatArray, Int32Array]:
    """Greatest least density by the poses that see each of N points, (N,) px/m, and its camera.

    `starts`, (N + 1,), are the limits in `pose` of those of each point; `on` are points and
    normals, (N, 3).
    """
    n = len(starts) - 1
    best, by = np.zeros(n), np.full(n, -1, np.int32)
    points, normals, matrices = (
        read_only(array, np.float64) for array in (*on, poses.world_from_camera)
    )
    for index, _ in poses.by_camera():
        lens, pairs = lens_of(cameras[index]), (starts, pose, points, normals)
        coverage_spread.best_densities(pairs, matrices, poses.camera, index, lens, best, by)
    return best, by


def _strips(eyes: FloatArray) -> list[IntArray]:
    """Runs of (P, 2) places in one direction."""
    steps = np.diff(eyes, axis=0)
    if len(steps) < LEAST_OF_STRIP - 1:
        return []
    length = norm(steps)
    unit = steps / np.maximum(length, 1e-300)[:, None]
    usual = float(np.median(length))
    is_same = dots(unit[:-1], unit[1:]) > cos(np.radians(TURN_DEG))
    is_step = (length > 0) & (length < 3 * usual)
    items, own = [], [0]
    for row in range(len(steps)):  # 1 us each
        turns = len(own) > 1 and not is_same[row - 1]
        if not is_step[row] or turns:
            items.append(own)
            own = [row + 1] if not turns or not is_step[row] else [row, row + 1]
            continue
        own.append(row + 1)
    items.append(own)
    return [np.array(each) for each in items if len(each) >= LEAST_OF_STRIP]


def _is_straight(eyes: FloatArray) -> bool:
    steps = norm(np.diff(eyes, axis=0))
    return bool(norm(eyes[-1] - eyes[0]) >= STRAIGHT_REL * steps.sum())


def _is_along(eyes: FloatArray, other: FloatArray) -> BoolArray:
    """True for each place between the ends of another strip, along it."""
    direction = other[-1] - other[0]
    share = matmul(eyes - other[0], direction) / max(float(matmul(direction, direction)), 1e-300)
    return (share >= -SNAP_REL) & (share <= 1 + SNAP_REL)


def _beside(eyes: FloatArray, strips: Sequence[IntArray], one: int) -> list[int]:
    """The nearest strip to the left of a straight strip and to its right."""
    own = eyes[strips[one]]
    if not _is_straight(own):
        return []
    direction = own[-1] - own[0]
    left = np.array((-direction[1], direction[0])) / max(norm(direction), 1e-300)
    length = norm(direction)
    offsets = []
    for strip in strips:
        away = eyes[strip].mean(axis=0) - own.mean(axis=0)
        way = eyes[strip[-1]] - eyes[strip[0]]
        is_parallel = abs(matmul(way, left)) < 0.5 * norm(way)
        is_parallel &= _is_straight(eyes[strip])
        offset = float(matmul(away, left))
        is_near = is_parallel and abs(offset) > 0.05 * length / max(1, len(own) - 1)
        offsets.append(offset if is_near else np.nan)
    beside = []
    for sign in (1, -1):
        to_side = [sign * offset if sign * offset > 0 else np.inf for offset in offsets]
        nearest = int(np.argmin(to_side))
        beside += [nearest] if np.isfinite(to_side[nearest]) else []
    return beside
