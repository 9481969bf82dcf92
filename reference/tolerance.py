"""Points that a camera covers whatever the errors of its mounting: twin of the engine's regions.

Point by point, without event edges, shadows in planes, or grids. A face M hides a point P from a
centre E exactly if E lies in the pyramid of the rays from P through M, beyond M. So M hides P from
some centre of a ball exactly if that pyramid, a convex set, is no farther from the middle of the
ball than its radius. Its surface is M and, for each edge, the part of a plane between two rays.
The other criteria are evaluated for the worst error, by the formulas of docs/appendix/tolerance.md.
"""

import math

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray
from rastercov.core.area.polygons import frames_of
from rastercov.core.camera import Camera, near_limit
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh


def surely_covers(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    task: Task,
    size: FloatArray,
    points: FloatArray,
    face: IntArray,
) -> BoolArray:
    """(N,) points of faces that a pinhole covers with all errors, without `min_pixel_density`.

    Parameters
    ----------
    pose : (4, 4) float64
        world_from_camera.
    size : (3,) float64
        Greatest errors: of the centre, metres, more than 0; of the rotation, radians; of the focal
        length, relative.
    points, face : (N, 3) float64, (N,) int
        Points of faces, metres.
    """
    d, a, p = size.tolist()
    rules, eye = task.rules(camera), pose[:3, 3]
    normal = frames_of(mesh).normal[face]
    height = np.einsum("ni,ni->n", eye - points, normal)
    height = np.where(mesh.two_sided_mask[face], np.abs(height), height)
    at = (points - eye) @ pose[:3, :3]
    near = float(near_limit(camera, mesh.bounds, pose[None])[0]) + 1e-6 * d
    holds = (height > d) & meets_view(camera, a, p, d, max(near, rules.z_n), at)
    distance = np.linalg.norm(at, axis=1)
    off_axis = np.arctan2(np.hypot(*at[:, :2].T), at[:, 2])
    deepest = distance * np.cos(np.maximum(off_axis - a, 0)) + d
    holds &= deepest <= rules.z_f
    holds &= (1 - p) * min(camera.fx, camera.fy) >= rules.min_facing_density * deepest
    scale = (1 - p) ** 2 * camera.fx * camera.fy
    holds &= scale * np.maximum(height - d, 0) >= rules.min_pixels_per_m2 * deepest**3
    if rules.tan_incidence > 0:
        flat = np.sqrt(np.maximum(distance**2 - height**2, 0))
        holds &= flat <= height * rules.tan_incidence - d / rules.cos_incidence
    for row in np.flatnonzero(holds).tolist():
        holds[row] = not is_hidden(mesh, points[row], int(face[row]), eye, d)
    return holds


def meets_view(
    camera: Camera, a: float, p: float, d: float, near: float, at: FloatArray
) -> BoolArray:
    """Points in camera axes that are in the image, and beyond a depth, with all errors.

    A direction v is within a half space of unit normal n for all n' up to the angle a from n if
    |v| cos(angle(n, v) + a) >= d.
    """
    normals = np.array(
        [
            (camera.fx, 0, camera.cx),
            (-camera.fx, 0, camera.width - camera.cx),
            (0, camera.fy, camera.cy),
            (0, -camera.fy, camera.height - camera.cy),
            (0, 0, 1),
        ]
    )
    normals[:, :2] *= 1 + p * np.where(normals[:, 2:] < 0, -1, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    size = np.linalg.norm(at, axis=1, keepdims=True)
    angle = np.arccos(np.clip(at @ normals.T / size, -1, 1)) + a
    least = size * np.cos(np.minimum(angle, math.pi))
    return (least >= np.array([d, d, d, d, near + d])).all(axis=1)


def is_hidden(mesh: Mesh, point: FloatArray, own: int, eye: FloatArray, d: float) -> bool:
    """True if an opaque face other than its own hides a point from some centre of a ball."""
    others = ~(mesh.target_mask | mesh.degenerate_mask)
    others[own] = False
    faces = mesh.vertices[mesh.faces[others]]
    # Faces in the plane of its own hide nothing from in front of it.
    height = (faces - point) @ frames_of(mesh).normal[own]
    front = np.sign((eye - point) @ frames_of(mesh).normal[own])
    faces = faces[(height * front > 1e-12 * mesh.diagonal).any(axis=1)]
    return bool((pyramid_distance(point, faces, eye) <= d).any())


def pyramid_distance(point: FloatArray, faces: FloatArray, eye: FloatArray) -> FloatArray:
    """(F,) distances of a centre from the pyramids beyond faces (F, 3, 3), seen from a point."""
    away = faces - point
    normals = np.cross(away, np.roll(away, -1, axis=1))
    sign = np.sign(np.linalg.det(away))
    inside = (sign[:, None] * (normals @ (eye - point)) >= 0).all(axis=1)
    plane = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    beyond = np.einsum("fi,fi->f", plane, eye - faces[:, 0])
    before = np.einsum("fi,fi->f", plane, point - faces[:, 0])
    values = np.where(inside & (beyond * before <= 0), 0.0, np.inf)
    for k in range(3):
        start, end = faces[:, k], faces[:, (k + 1) % 3]
        values = np.minimum(values, _fan_distance(point, start, end, eye))
    return np.minimum(values, _triangle_distance(faces, eye))


def _fan_distance(
    point: FloatArray, start: FloatArray, end: FloatArray, eye: FloatArray
) -> FloatArray:
    """Distances from the parts of planes that edges bound on the far side of a point."""
    u, v = start - point, end - point
    off = eye - point
    normal = np.cross(u, v)
    size = np.linalg.norm(normal, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = normal / size[:, None]
        lift = unit @ off
        flat = off - lift[:, None] * unit
        # flat = a u + b v; in the fan where a, b >= 0 and a + b >= 1.
        a = np.einsum("fi,fi->f", np.cross(flat, v), unit) / size
        b = np.einsum("fi,fi->f", np.cross(u, flat), unit) / size
    inside = (a >= 0) & (b >= 0) & (a + b >= 1) & (size > 0)
    sides = [_segment_distance(start, end - start, eye, 1.0)]
    sides += [_segment_distance(each, each - point, eye, math.inf) for each in (start, end)]
    return np.where(inside, np.abs(lift), np.minimum.reduce(sides))


def _segment_distance(
    start: FloatArray, along: FloatArray, eye: FloatArray, most: float
) -> FloatArray:
    """Distances from segments, or from rays."""
    square = np.maximum(np.einsum("fi,fi->f", along, along), 1e-300)
    t = np.clip(np.einsum("fi,fi->f", eye - start, along) / square, 0, most)
    return np.asarray(np.linalg.norm(eye - start - t[:, None] * along, axis=1))


def _triangle_distance(faces: FloatArray, eye: FloatArray) -> FloatArray:
    """Distances from the insides of triangles; infinite where the foot is outside."""
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    lift = np.einsum("fi,fi->f", unit, eye - faces[:, 0])
    foot = eye - lift[:, None] * unit
    sides = [
        np.einsum(
            "fi,fi->f", np.cross(faces[:, (k + 1) % 3] - faces[:, k], foot - faces[:, k]), unit
        )
        for k in range(3)
    ]
    return np.where(np.min(sides, axis=0) >= 0, np.abs(lift), np.inf)
