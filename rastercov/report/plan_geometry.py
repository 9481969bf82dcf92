"""Plane geometry of a plan sheet: horizontal sections, lines of sight, and fields of view.

A section is exact: the points in which a plane cuts the edges of the faces. The visibility polygon
is that of an angular sweep: between the directions of two neighbouring ends of walls, one wall is
the nearest. A field of view to a distance is a solid, and the part of it at a height is its section
again, so that pinholes and lenses take one way.

T. Asano. An efficient algorithm for finding the visibility polygon for a polygonal region with
holes. 1985.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rastercov.base.errors import CameraError
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_image, view_border
from rastercov.mesh import Mesh
from rastercov.mesh.topology import edge_table

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CREASE = np.cos(np.deg2rad(30))
"""Cosine of the angle between two faces from which their edge is drawn."""
PARTS = 24
"""Parts of each side of the image of a lens, and of the way from its axis to its border."""
STEP = 1e-5
"""Half the angle over which the density of a lens is measured, rad."""


def section(vertices: FloatArray, faces: IntArray, height: float) -> tuple[FloatArray, IntArray]:
    """Segments (N, 2, 2) in which the plane z = `height` cuts faces, and keys (N, 2) of their ends.

    Ends on one edge have one key and are equal bit by bit. What a face is the front of lies to the
    right of its segment, so that the section of a solid is counter-clockwise. A vertex in the plane
    counts as above it: the section is the limit of those slightly below.
    """
    is_above = vertices[:, 2] >= height
    corners = is_above[faces]
    cut = np.flatnonzero(corners.any(axis=1) & ~corners.all(axis=1))
    own, above = faces[cut], corners[cut]
    following, next_above = np.roll(own, -1, axis=1), np.roll(above, -1, axis=1)
    rows, edges = np.arange(len(cut)), np.empty((len(cut), 2, 2), np.int64)
    for end, crosses in enumerate((above & ~next_above, ~above & next_above)):
        side = crosses.argmax(axis=1)
        edges[:, end] = np.sort(np.stack((own[rows, side], following[rows, side]), axis=1), axis=1)
    low, high = vertices[edges[..., 0]], vertices[edges[..., 1]]
    share = (height - low[..., 2]) / (high[..., 2] - low[..., 2])
    segments = low[..., :2] + share[..., None] * (high - low)[..., :2]
    return segments, edges[..., 0] * len(vertices) + edges[..., 1]


def chains(segments: FloatArray, keys: IntArray) -> list[FloatArray]:
    """Polylines (N, 2) of the segments of a section; the first point of a closed one is its last.

    Points on a straight line between their neighbours are left out.
    """
    after: dict[int, list[int]] = defaultdict(list)
    starts, ends = keys.T.tolist()
    for row, start in enumerate(starts):
        after[start].append(row)
    reached, found = set(ends), []
    order = sorted(range(len(starts)), key=lambda row: starts[row] in reached)  # open ones first
    for first in order:
        if first not in after[starts[first]]:
            continue
        row, points = first, [segments[first, 0]]
        while True:
            after[starts[row]].remove(row)
            points.append(segments[row, 1])
            if ends[row] == starts[first] or not after.get(ends[row]):
                break
            row = after[ends[row]][0]
        line = shapely.simplify(shapely.linestrings(np.array(points)), 0.0)
        found.append(shapely.get_coordinates(line))
    return found


def is_closed(line: FloatArray) -> bool:
    """True for a polyline that ends where it begins, around an area."""
    return len(line) > 3 and bool((line[0] == line[-1]).all())


def solid(lines: Sequence[FloatArray]) -> Any:
    """Area within the closed polylines of a section: a counter-clockwise one adds, others cut."""
    found = shapely.Polygon()
    rings = [shapely.LinearRing(line) for line in lines if is_closed(line)]
    for ring in sorted(rings, key=lambda ring: -shapely.Polygon(ring).area):
        part = shapely.make_valid(shapely.Polygon(ring))
        found = found.union(part) if ring.is_ccw else found.difference(part)
    return found


def noded(segments: FloatArray, box: FloatArray) -> FloatArray:
    """Segments (N, 2, 2), and the sides of a box (2, 2), cut where they cross each other."""
    whole = shapely.union_all([*shapely.linestrings(segments), shapely.box(*box.ravel()).exterior])
    lines = [shapely.get_coordinates(part) for part in shapely.get_parts(whole)]
    return np.concatenate([np.stack((line[:-1], line[1:]), axis=1) for line in lines])


def visible_from(eye: FloatArray, walls: FloatArray) -> Any:
    """Visibility polygon of a point (2,) among walls that do not cross and that enclose it.

    A wall in line with the point hides nothing. The walls are those of `noded`, (N, 2, 2).
    """
    ends = walls - eye
    turn = _cross(ends[:, 0], ends[:, 1])
    ends[turn < 0] = ends[turn < 0, ::-1]
    ends, turn = ends[turn != 0], np.abs(turn[turn != 0])
    along = ends[:, 1] - ends[:, 0]
    angles, at = np.unique(np.arctan2(ends[..., 1], ends[..., 0]), return_index=True)
    directions, n = ends.reshape(-1, 2)[at], len(angles)
    first, last = np.searchsorted(angles, np.arctan2(ends[..., 1], ends[..., 0])).T
    spans = (last - first) % n  # gaps between neighbouring directions; a wall spans less than pi
    wall = np.repeat(np.arange(len(ends)), spans)
    gap = (np.arange(len(wall)) + np.repeat(first - (np.cumsum(spans) - spans), spans)) % n
    middle = angles + np.diff(angles, append=angles[0] + 2 * np.pi) / 2
    ray = np.stack((np.cos(middle), np.sin(middle)), axis=1)[gap]
    away = turn[wall] / _cross(ray, along[wall])
    order = np.lexsort((away, gap))
    gap, wall = gap[order], wall[order]
    nearest = np.flatnonzero(np.diff(gap, prepend=-1))
    gap, wall = gap[nearest], wall[nearest]
    points = np.empty((len(gap), 2, 2))
    for side in (0, 1):
        ray = directions[(gap + side) % n]
        points[:, side] = (turn[wall] / _cross(ray, along[wall]))[:, None] * ray + eye
    return shapely.make_valid(shapely.Polygon(points.reshape(-1, 2)))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    found: FloatArray = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return found


def field_of_view(camera: Camera, pose: FloatArray, density: float, height: float) -> Any:
    """Part of the plane z = `height` that is in the image at a facing density or more, px/m.

    Walls are not regarded. Of a pinhole it is exact, with depths to min(fx, fy) / density; of other
    lenses the least density over all directions, on `PARTS` steps a side.

    Raises
    ------
    CameraError
        For an image of all directions.
    """
    if camera.model == "equirectangular":
        raise CameraError("a plan sheet has no field of view of an image of all directions")
    n = 1 if camera.is_pinhole else PARTS
    border = view_border(camera, n)
    axis = border.mean(axis=0) if camera.is_pinhole else np.array((0.0, 0.0, 1.0))
    border = border / np.linalg.norm(border, axis=1, keepdims=True)
    steps = np.arange(n + 1)[:, None, None] / n
    rays = (1 - steps) * axis / np.linalg.norm(axis) + steps * border  # (n + 1, 4 n, 3)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    reach = _facing_density(camera, rays)
    for ring in range(1, n + 1):  # the border of what the lens shows has no density of its own
        reach[ring] = np.where(np.isfinite(reach[ring]), reach[ring], reach[ring - 1])
    ends = pose[:3, 3] + (rays * (reach / density)[..., None]) @ pose[:3, :3].T
    vertices = np.concatenate((pose[None, :3, 3], ends.reshape(-1, 3)))
    m = 4 * n
    rows = 1 + np.arange(n * m).reshape(n, m)
    a, b, c, d = rows, np.roll(rows, -1, axis=1), rows + m, np.roll(rows + m, -1, axis=1)
    sides = np.stack((np.zeros(m, np.int64), d[-1], c[-1]), axis=1)
    caps = [np.stack(each, axis=-1).reshape(-1, 3) for each in ((a[1:], d[1:], b[1:]), (a, c, d))]
    faces = np.concatenate((*caps, sides))
    faces[(faces >= 1) & (faces <= m)] = 1  # one point on the axis
    return solid(chains(*section(vertices, faces, height)))


def _facing_density(camera: Camera, rays: FloatArray) -> FloatArray:
    """Pixels a metre of a target at distance 1 that faces the camera, for unit rays (..., 3).

    The least over its directions: the least singular value of the image of a step across the ray.
    """
    if camera.is_pinhole:
        nearest: FloatArray = min(camera.fx, camera.fy) / rays[..., 2]
        return nearest
    across = np.cross(rays, np.where(np.abs(rays[..., :1]) < 0.5, (1.0, 0, 0), (0, 1.0, 0)))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    moved = [
        to_image(rays + STEP * way, camera) - to_image(rays - STEP * way, camera)
        for way in (across, np.cross(rays, across))
    ]
    (a, b), (c, d) = (np.moveaxis(each / (2 * STEP), -1, 0) for each in moved)
    # Least singular value of (a b; c d), by its sum of squares and determinant.
    total, product = a * a + b * b + c * c + d * d, np.abs(a * d - b * c)
    most = (np.sqrt(total + 2 * product) + np.sqrt(np.maximum(total - 2 * product, 0.0))) / 2
    return np.asarray(product / most, np.float64)


def edges_below(mesh: Mesh, floor: float, height: float) -> FloatArray:
    """Edges (N, 2, 2) in plan, of creases above 30 degrees and of borders, between two heights."""
    table = edge_table(mesh.welded_faces, mesh.n_vertices)
    normals, faces = mesh.normals, table.faces
    one, other = (normals[faces[table.first + rest]] for rest in (0, table.n_uses - 1))
    sharp = (table.n_uses != 2) | (np.einsum("ij,ij->i", one, other) < CREASE)
    ends = mesh.vertices[table.vertices[sharp].astype(np.int64)]
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = (np.array((floor, height)) - start[:, 2:]) / along[:, 2:]
    bounds = np.where(along[:, 2:] == 0, (0.0, 1.0), np.sort(bounds, axis=1)).clip(0, 1)
    level = along[:, 2] == 0
    kept = np.where(level, (start[:, 2] >= floor) & (start[:, 2] < height), np.ptp(bounds, 1) > 0)
    kept &= np.abs(along[:, :2]).max(axis=1) > 0
    found: FloatArray = (start[:, None] + bounds[..., None] * along[:, None])[kept][..., :2]
    return found
