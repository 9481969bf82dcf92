"""Plane geometry of a plan sheet: what cameras see at the height of its cut.

What crosses the cut hides everything behind: walls are drawn out to all heights, and the plane of
the cut is a target, of which cameras cover the part that they see.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.coverage.area.frames import to_world
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.task import Task
from rastercov.mesh import Group, Mesh
from rastercov.mesh.topology import edge_table

CREASE = np.cos(np.deg2rad(30))
"""Cosine of the angle between two faces from which their edge is drawn."""
APART = 1e-3
"""Least distance of a camera from the plane of the cut, m, into which it could not look."""


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


def seen_on_plan(scene: Mesh, cameras: Sequence[Camera], poses: Poses, density: float) -> list[Any]:
    """Area of the plane of a `scene_of_plan` that each pose sees at a facing density or more, px/m.

    A camera in the plane is lifted by `APART`.
    """
    placed, height = poses.world_from_camera.copy(), scene.vertices[-1, 2]
    placed[np.abs(placed[:, 2, 3] - height) < APART, 2, 3] = height + APART
    sharp = [
        replace(each, aperture=None, focus_distance=None, focus_range=None) for each in cameras
    ]
    task = Task(min_facing_density=density)
    with closing(RegionPass(scene, sharp, task, only_task=True)) as finder:
        found = finder.find(Poses.of(placed, camera=poses.camera))
    corner_of = np.repeat(np.arange(len(found.face)), np.diff(found.starts))
    corners = to_world(scene, found.face[corner_of].astype(np.int64), found.xy)[:, :2]
    pieces = shapely.make_valid(shapely.polygons(shapely.linearrings(corners, indices=corner_of)))
    rows = range(len(poses))
    return [shapely.union_all(pieces[found.pose == row], grid_size=1e-6) for row in rows]


def edges_between(mesh: Mesh, low: float, high: float) -> FloatArray:
    """Creases above 30 degrees, and borders, between two heights in plan, (N, 2, 2)."""
    table = edge_table(mesh.welded_faces, mesh.n_vertices)
    one, other = (table.faces[table.first + rest] for rest in (0, table.n_uses - 1))
    is_crease = np.einsum("ij,ij->i", mesh.normals[one], mesh.normals[other]) < CREASE
    ends = mesh.vertices[table.vertices[is_crease | (table.n_uses != 2)].astype(np.int64)]
    ends = ends[((ends[..., 2] >= low) & (ends[..., 2] <= high)).all(axis=1), :, :2]
    return np.asarray(ends[(ends[:, 0] != ends[:, 1]).any(axis=1)], np.float64)
