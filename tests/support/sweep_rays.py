"""A laser line by rays: each point is judged at the moment when the sheet is on it."""

import numpy as np
from exact_cases import box
from scenes import joined

import rastercov as rc
from rastercov.core.coverage.task import tasks_of

LASER = rc.Camera.from_fov(1000, 1, hfov_deg=100)
CAMERA = rc.Camera.from_fov(1000, 800, hfov_deg=70)
TASK = rc.Task(max_incidence_deg=80)
DOWN = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
"""Axes of a laser that looks down, with its sheet across x."""


def parts():
    """Turned blocks on a plate of 0.3 x 0.2 m: 60 faces."""
    blocks = [box((-0.3, -0.2, -0.02), (0.3, 0.2, 0.0))]
    for row, (x, y, size, high) in enumerate(
        [
            (-0.15, 0.05, 0.08, 0.06),
            (0.02, -0.06, 0.1, 0.11),
            (0.17, 0.07, 0.06, 0.2),
            (0.05, 0.11, 0.05, 0.03),
        ]
    ):
        own, turn = box((-size / 2, -size / 2, 1e-4), (size / 2, size / 2, high)), 0.4 + row
        c, s = np.cos(turn), np.sin(turn)
        own = rc.Mesh(
            own.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + (x, y, 0), own.faces
        )
        blocks.append(own)
    whole = joined(*blocks)
    return rc.Mesh(whole.vertices / 2, whole.faces)


def head(tilt_deg=25.0, laser_deg=75.0):
    """A laser, and a camera beside it that is turned to its sheet."""
    places = np.tile(np.eye(4), (2, 1, 1))
    t = np.radians(tilt_deg)
    places[1, :3, :3] = [[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]]
    places[1, :3, 3] = 0, 0.2, 0
    tasks = {"laser": rc.Task(max_incidence_deg=laser_deg)}
    return rc.Rig([LASER, CAMERA], ["laser", "camera"], places, rule=rc.All(), tasks=tasks)


def start(x=0.0, z=0.5):
    """Pose of the rig above a point of the axis x."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = DOWN, (x, 0, z)
    return pose


def along_x(points, first):
    """Poses (N, 4, 4) of the rig when its sheet, which is across x, is on each point."""
    poses = np.tile(first, (len(points), 1, 1))
    poses[:, 0, 3] = points[:, 0]
    return [poses]


def around_z(points, first):
    """Poses of a rig that is turned about z, both times when its sheet is on each point."""
    n, c = first[:3, 1], first[:3, 3]
    a = n[0] * points[:, 0] + n[1] * points[:, 1]
    b = n[0] * points[:, 1] - n[1] * points[:, 0]
    cosine = (n @ c - n[2] * points[:, 2]) / np.maximum(np.hypot(a, b), 1e-300)
    items = []
    for sign in (1, -1):
        angle = np.arctan2(b, a) + sign * np.arccos(np.clip(cosine, -1, 1))
        turn = np.tile(np.eye(4), (len(points), 1, 1))
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
        turn[:, 1, 0] = np.sin(angle)
        turn[:, 0, 1] = -turn[:, 1, 0]
        poses = turn @ first
        poses[np.abs(cosine) > 1] = np.nan  # never
        items.append(poses)
    return items


def measured(mesh, rig, moments, task, points, face):
    """(N,) points that all devices see at one of their moments, by rays; pinholes alone."""
    measures = np.zeros(len(points), np.bool_)
    for poses in moments:
        holds = np.ones(len(points), np.bool_)
        for camera, place, own in zip(
            rig.cameras, rig.rig_from_camera, tasks_of(rig, task), strict=True
        ):
            holds &= _sees(mesh, camera, poses @ place, own, points, face)
        measures |= holds
    return measures


def _sees(mesh, camera, poses, task, points, face):
    eyes, normals = poses[:, :3, 3], mesh.normals[face]
    away = eyes - points
    local = np.einsum("nji,nj->ni", poses[:, :3, :3], -away)
    with np.errstate(all="ignore"):
        x = camera.fx * local[:, 0] / local[:, 2] + camera.cx
        y = camera.fy * local[:, 1] / local[:, 2] + camera.cy
    # The height of a laser is that of its sheet, in which the point is.
    is_high = (y >= 0) & (y <= camera.height) if camera.height > 1 else True
    cosine = np.einsum("ni,ni->n", away, normals) / np.linalg.norm(away, axis=1)
    sees = (local[:, 2] > 0) & (x >= 0) & (x <= camera.width) & is_high
    sees &= cosine >= np.cos(np.radians(task.max_incidence_deg))
    rows = np.flatnonzero(sees)
    origin, ray = points[rows] + 1e-9 * normals[rows], away[rows]
    hit = np.zeros(len(rows), np.bool_)
    for number, (a, b, c) in enumerate(mesh.vertices[mesh.faces]):  # few faces, many points
        e, f = b - a, c - a
        p = np.cross(ray, f)
        det = p @ e
        with np.errstate(all="ignore"):
            s = origin - a
            u = np.einsum("ni,ni->n", s, p) / det
            q = np.cross(s, e)
            v = np.einsum("ni,ni->n", ray, q) / det
            t = q @ f / det
            hit |= (
                (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (t < 1) & (face[rows] != number)
            )
    sees[rows[hit]] = False
    return sees
