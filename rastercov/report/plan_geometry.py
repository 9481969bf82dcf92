"""Plane geometry of a plan sheet: lines of sight, and fields of view.

The visibility polygon is that of an angular sweep: between the directions of two neighbouring ends
of walls, one wall is the nearest. A field of view to a distance is a solid, and the part of it at a
height is its section, so that pinholes and lenses take one way.

T. Asano. An efficient algorithm for finding the visibility polygon for a polygonal region with
holes. 1985.
"""

from typing import Any

import numpy as np
import shapely

from rastercov.base.errors import CameraError
from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_image, view_border
from rastercov.mesh import Mesh
from rastercov.mesh.sections import cross, section, solid
from rastercov.mesh.topology import edge_table

CREASE = np.cos(np.deg2rad(30))
"""Cosine of the angle between two faces from which their edge is drawn."""
PARTS = 24
"""Parts of each side of the image of a lens, and of the way from its axis to its border."""
STEP = 1e-5
"""Half the angle over which the density of a lens is measured, rad."""


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
    turn = cross(ends[:, 0], ends[:, 1])
    ends[turn < 0] = ends[turn < 0, ::-1]
    ends, turn = ends[turn != 0], np.abs(turn[turn != 0])
    along, angle = ends[:, 1] - ends[:, 0], np.arctan2(ends[..., 1], ends[..., 0])
    angles, at = np.unique(angle, return_index=True)
    directions, n = ends.reshape(-1, 2)[at], len(angles)
    first, last = np.searchsorted(angles, angle).T
    spans = (last - first) % n  # gaps between neighbouring directions; a wall spans less than pi
    wall = np.repeat(np.arange(len(ends)), spans)
    gap = (np.arange(len(wall)) + np.repeat(first - (np.cumsum(spans) - spans), spans)) % n
    middle = angles + np.diff(angles, append=angles[0] + 2 * np.pi) / 2
    ray = np.stack((np.cos(middle), np.sin(middle)), axis=1)[gap]
    order = np.lexsort((turn[wall] / cross(ray, along[wall]), gap))
    nearest = order[np.flatnonzero(np.diff(gap[order], prepend=-1))]
    gap, wall = gap[nearest], wall[nearest]
    rays = directions[np.stack((gap, (gap + 1) % n))]
    away = turn[wall] / cross(rays, along[wall])
    points = np.moveaxis(away[..., None] * rays + eye, 0, 1).reshape(-1, 2)
    found = shapely.Polygon(points)
    return shapely.make_valid(found, method="structure", keep_collapsed=False)


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
    reach = _facing_density(camera, rays) / density
    for ring in range(1, n + 1):  # beyond the border of what a lens shows there is no density
        reach[ring] = np.where(reach[ring] > 0, reach[ring], reach[ring - 1])
    ends = pose[:3, 3] + (rays * reach[..., None]) @ pose[:3, :3].T
    vertices = np.concatenate((ends.reshape(-1, 3), pose[None, :3, 3]))
    inner = np.arange(4 * n * (n + 1)).reshape(n + 1, -1)
    inner[0] = 0  # one point on the axis
    after = np.roll(inner, -1, axis=1)
    eye = np.full(4 * n, len(vertices) - 1)
    triangles = [(inner[:-1], inner[1:], after[1:]), (inner[:-1], after[1:], after[:-1])]
    triangles.append((eye, after[-1], inner[-1]))
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in triangles])
    return solid(section(vertices, faces, height))


def _facing_density(camera: Camera, rays: FloatArray) -> FloatArray:
    """Pixels a metre of a target at distance 1 that faces the camera, for unit rays (..., 3).

    The least over its directions: the least singular value of the image of a step across the ray;
    0 where a lens has no image.
    """
    if camera.is_pinhole:
        return np.asarray(min(camera.fx, camera.fy) / rays[..., 2], np.float64)
    across = STEP * np.linalg.svd(rays[..., None, :])[2][..., 1:, :]
    ends = (to_image(rays[..., None, :] + side * across, camera) for side in (1, -1))
    moved = np.nan_to_num(np.subtract(*ends)) / (2 * STEP)
    return np.asarray(np.linalg.norm(moved, -2, axis=(-2, -1)), np.float64)


def edges_between(mesh: Mesh, low: float, high: float) -> FloatArray:
    """Creases above 30 degrees, and borders, between two heights in plan, (N, 2, 2)."""
    table = edge_table(mesh.welded_faces, mesh.n_vertices)
    one, other = (table.faces[table.first + rest] for rest in (0, table.n_uses - 1))
    is_crease = np.einsum("ij,ij->i", mesh.normals[one], mesh.normals[other]) < CREASE
    ends = mesh.vertices[table.vertices[is_crease | (table.n_uses != 2)].astype(np.int64)]
    ends = ends[((ends[..., 2] >= low) & (ends[..., 2] <= high)).all(axis=1), :, :2]
    return np.asarray(ends[(ends[:, 0] != ends[:, 1]).any(axis=1)], np.float64)
