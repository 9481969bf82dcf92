"""Plane geometry of a plan sheet: what cameras see at the height of its cut.

What crosses the cut hides everything behind: walls are drawn out to all heights, and the plane of
the cut is a target, of which cameras cover the part that they see.
"""

from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np
import shapely

from rastercov.base import BoolArray, FloatArray, dots, norm, owners_of, sort_order
from rastercov.core.area.polygons import to_world
from rastercov.core.area.regions import RegionPass
from rastercov.core.camera import Camera, Poses
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Group, Mesh
from rastercov.core.mesh.bodies import boxes_of, crease_edges
from rastercov.core.mesh.sections import cross, polygons_in, section, solid
from rastercov.core.mesh.solids import closed_faces
from rastercov.core.mesh.topology import components_of, edge_table
from rastercov.placement.candidates.ground import heights_at

APART = 1e-3
"""Least distance of a camera from the plane of the cut, m, into which it could not look."""
LEAF, LEAVES = 0.5, 100
"""Size of a leaf at most, m, and pieces of a group of that size from which they are leaves."""
WALL = 0.6
"""Distance around what is planned in which walls are drawn, m."""
GAP = 1e-5
"""Half of the mean width of a gap that is drawn at least, m."""
APART_FROM_OTHERS, LEAST_BUILDING = 1.0, 0.02
"""Distance of a wall from others that is apart, m; part of the largest box around walls that are
together that others have at least."""
PIECE = 0.05
"""Length of a piece of wall that a distance is measured along, m."""
UPRIGHT = 1e-7
"""Sine of the angle to the vertical below which a face is upright, and part of a drawing that its
corners are rounded to."""


def scene_of_plan(walls: FloatArray, box: FloatArray, cut: float, poses: Poses) -> Mesh:
    """The part of the plane z = `cut` in a box (2, 2), and walls (N, 2, 2) beside all cameras."""
    ends, heights = walls.reshape(-1, 2), np.append(poses.world_from_camera[:, 2, 3], cut)
    around = shapely.get_coordinates(shapely.box(*box.ravel()))[:4]
    sheets = (ends, heights.min() - 1), (ends, heights.max() + 1), (around, cut)
    vertices = np.concatenate([np.insert(xy, 2, height, axis=1) for xy, height in sheets])
    one, n = np.arange(0, len(ends), 2), len(ends)
    standing = np.stack((one, one + 1, one + 1 + n, one + n), axis=1)
    corners = np.concatenate((standing, [2 * n + np.arange(4)]))
    groups = Group("walls", is_occluder=True), Group("plan", is_two_sided=True, is_target=True)
    faces = corners[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3)
    return Mesh(vertices, faces, groups, np.repeat([0, 1], (n, 2)).astype(np.int32))


def views_on_plan(
    scene: Mesh, cameras: Sequence[Camera], poses: Poses, density: float
) -> list[Any]:
    """Area of the plane of a `scene_of_plan` that each pose sees at a facing density or more, px/m.

    A camera in the plane is lifted by `APART`.
    """
    placed, height = poses.world_from_camera.copy(), scene.vertices[-1, 2]
    placed[np.abs(placed[:, 2, 3] - height) < APART, 2, 3] = height + APART
    sharp = [each._without_focus() for each in cameras]
    task = Task(min_facing_density=density)
    with closing(RegionPass(scene, sharp, task, only_task=True)) as finder:
        result = finder.find(Poses.of(placed, camera=poses.camera))
    corner_of = owners_of(np.diff(result.starts))
    corners = to_world(scene, result.face[corner_of].astype(np.int64), result.xy)[:, :2]
    pieces = shapely.make_valid(shapely.polygons(shapely.linearrings(corners, indices=corner_of)))
    rows = range(len(poses))
    seen = (shapely.union_all(pieces[result.pose == row], grid_size=1e-6) for row in rows)
    return [_without_gaps(each) for each in seen]


def _without_gaps(shape: shapely.Geometry) -> shapely.Geometry:
    """An area without the gaps between its pieces, which are as narrow as their rounding."""

    def is_wide(ring: shapely.LinearRing) -> bool:
        return bool(shapely.Polygon(ring).area > GAP * ring.length)

    return shapely.union_all(
        [
            shapely.Polygon(each.exterior, list(filter(is_wide, each.interiors)))
            for each in polygons_in(shape)
        ]
    )


def is_foliage(mesh: Mesh) -> BoolArray:
    """(F,) faces of leaves: of groups with many small pieces that are no solids, those pieces."""
    piece = mesh.topology.components()
    low, high = boxes_of(piece, mesh.vertices[mesh.faces])
    is_small = norm(high - low) < LEAF
    is_small[piece[closed_faces(mesh)]] = False
    small = is_small[piece]
    count = max(len(is_small), 1)
    pieces = np.unique(mesh.face_group[small].astype(np.int64) * count + piece[small])
    n_small = np.bincount(pieces // count, minlength=len(mesh.groups))
    return small & (n_small >= LEAVES)[mesh.face_group]


def middle_part(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Box (2, 2) with 99 % of the weight of points (N, 2) along each axis, or none."""
    if not weights.sum() > 0:
        return np.empty((0, 2))
    ends = []
    for values in points.T:
        order = sort_order(values)
        passed = np.cumsum(weights[order]) / weights.sum()
        rows = np.searchsorted(passed, ((1 - 0.99) / 2, (1 + 0.99) / 2))
        ends.append(values[order[np.minimum(rows, len(order) - 1)]])
    return np.array(ends).T


def plan_lines(mesh: Mesh, poses: Poses, cut: float) -> FloatArray:
    """Box (2, 2) in plan of cameras, and of 99 % of targets and of evaluated buildings at the cut.

    Of all evaluated faces where there are neither. Around targets alone, with the walls near them.
    """
    is_own = mesh.task_mask & ~mesh.target_mask
    scored = mesh.faces[is_own & ~is_foliage(mesh)]
    walls = _buildings(section(mesh.vertices, scored, cut))
    lengths = norm(walls[:, 0] - walls[:, 1])
    targets = mesh.vertices[mesh.faces[mesh.target_mask]]
    boxes = [
        middle_part(walls.reshape(-1, 2), np.repeat(lengths, 2)),
        middle_part(targets[..., :2].reshape(-1, 2), np.repeat(mesh.areas[mesh.target_mask], 3)),
    ]
    if not any(map(len, boxes)):
        corners = mesh.vertices[mesh.faces[is_own]][..., :2].reshape(-1, 2)
        boxes.append(middle_part(corners, np.repeat(mesh.areas[is_own], 3)))
    values = np.concatenate((*boxes, poses.world_from_camera[:, :2, 3]))
    low, high = values.min(axis=0), values.max(axis=0)
    if not len(walls):
        ends = np.asarray(mesh.opaque.bounds)[:, :2]
        low = np.minimum(low, np.maximum(low - WALL, ends[0]))
        high = np.maximum(high, np.minimum(high + WALL, ends[1]))
    return np.stack((low, high))


def _buildings(walls: FloatArray) -> FloatArray:
    """Walls (N, 2, 2) without those that are apart and go around little, such as trunks."""
    if not len(walls):
        return walls
    lines = shapely.linestrings(walls)
    near = shapely.STRtree(lines).query(lines, "dwithin", APART_FROM_OTHERS)
    block = components_of(len(walls), near.T)
    low, high = boxes_of(block, walls)
    around = np.prod(high - low, axis=1)
    return walls[(around >= LEAST_BUILDING * around.max())[block]]


def distances_to_walls(walls: FloatArray, at: FloatArray) -> list[FloatArray]:
    """Shortest lines (2, 2) from a point to walls (N, 2, 2): along the nearest one, and across."""
    start, step = walls[:, 0], walls[:, 1] - walls[:, 0]
    length = norm(step)
    start, step = start[length > PIECE], step[length > PIECE]
    if not len(start):
        return []
    share = dots(at - start, step) / dots(step, step)
    nearest = start + np.clip(share, 0, 1)[:, None] * step
    row = norm(nearest - at).argmin()
    along = step[row] / norm(step[row])
    distances = []
    for axis in (along, np.array((-along[1], along[0]))):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = cross(start - at, step) / cross(axis, step)
            s = cross(start - at, np.broadcast_to(axis, start.shape)) / cross(axis, step)
        hits = t[(s >= -1e-9) & (s <= 1 + 1e-9) & (abs(t) > 1e-3)]
        if len(hits):
            distances.append(np.stack((at, at + hits[abs(hits).argmin()] * axis)))
    return distances


def edges_between(mesh: Mesh, drawn: BoolArray, low: float, high: float) -> FloatArray:
    """Creases above 30 degrees, and borders, between two heights in plan, (N, 2, 2).

    Of the faces that are `drawn`, (F,).
    """
    ends = crease_edges(mesh, drawn)
    ends = ends[((ends[..., 2] >= low) & (ends[..., 2] <= high)).all(axis=1), :, :2]
    return np.asarray(ends[(ends[:, 0] != ends[:, 1]).any(axis=1)], np.float64)


def outline_from_above(mesh: Mesh) -> Any:
    """Area of the plan that faces cover.

    Its border is of edges that do not have one face on either side in plan; these edges go around
    places that are covered as a whole, or not at all.
    """
    table, middle = edge_table(mesh.welded_faces, mesh.n_vertices), mesh.centre[:2]
    ends = mesh.vertices[table.vertices.astype(np.int64), :2] - middle
    start, step = ends[:, 0], ends[:, 1] - ends[:, 0]
    rows = (table.faces[table.first + rest] for rest in (0, table.n_uses - 1))
    sides = np.array([cross(step, mesh.centroids[row, :2] - middle - start) for row in rows])
    sides[np.abs(sides) <= UPRIGHT * dots(step, step)] = 0.0
    border = shapely.linestrings(ends[np.sign(sides).prod(axis=0) >= 0])
    lines = shapely.union_all(border, grid_size=UPRIGHT * float(np.ptp(mesh.bounds, axis=0).max()))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    within = shapely.get_coordinates(shapely.point_on_surface(cells)) + middle
    area = shapely.union_all(cells[~np.isnan(heights_at(mesh, within))])
    return shapely.transform(area, lambda xy: xy + middle)


def rooms_of(mesh: Mesh, cut: float) -> list[tuple[str, str, Any]]:
    """Name, number and outline of each space of a building that a cut crosses."""
    rooms = []
    for product, inside in mesh.spaces:
        low, high = np.asarray(inside.bounds)[:, 2]
        if low <= cut < high:
            number = product.name if product.long_name else ""
            name = product.long_name or product.name or product.global_id
            outline = solid(section(inside.vertices, inside.welded_faces, cut))
            rooms.append((name, number, outline))
    return rooms
