"""Blocking groups: the share of a face's image that each group of faces hides from a camera.

Serves `uncovered`. A rasteriser renders the face from the camera centre through a window that just
holds it; other faces drawn at the samples of the face are in front of it. The exact method measures
the hidden area but not the occluder, which would take one run for every pair of groups. One window
of 64 x 64 samples takes about 0.1 ms and ranks the groups.
"""

import math
from collections.abc import Callable

import numpy as np

from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.raster.cpu import CPURasterizer

SIDE = 64
"""Samples along each side of a window; a face spans a half of it or more."""
WIDEST = 8
"""Tangent of half the widest window, as a power of two."""
EDGE_MARGIN_REL = 1 / 128
"""Distance to an edge of the face, in sample spacings, within which samples are ignored: they may
belong to its neighbours."""
DEPTH_MARGIN_REL = 1e-5
"""Depth by which a surface must be in front of a target to count, relative."""
WINDOWS_AT_ONCE = 128
"""Windows in memory: 4 MB."""


def in_front(
    mesh: Mesh,
    eyes: FloatArray,
    faces: IntArray,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> FloatArray:
    """(N, G) share of each face's image that each group hides from a camera centre.

    The image is that of a camera aimed at the centroid. The near limit of the real camera does not
    apply: surfaces nearer than that block too.

    `eyes`, (N, 3), lie on either side of the planes of `faces`, (N,); all faces of the mesh but
    those of targets may block. A share is from about 500 to 4,000 samples, fewer for thin faces; 0
    for a face so thin that it owns none.
    """
    shares = np.zeros((len(faces), len(mesh.groups)))
    if not len(faces):
        return shares
    poses = look_at(eyes, mesh.centroids[faces])
    points = mesh.vertices[mesh.faces[faces]] - poses[:, None, :3, 3]
    points = points @ poses[:, :3, :3]
    slopes = points[..., :2] / points[..., 2:]
    reach = np.abs(slopes).max(axis=(1, 2))
    level = np.ceil(np.log2(np.maximum(reach, 2.0**-40))).astype(np.int64).clip(-40, WIDEST)
    done = 0
    for power in np.unique(level).tolist():
        scale = SIDE / 2 / math.ldexp(1.0, power)
        window = Camera(width=SIDE, height=SIDE, fx=scale, fy=scale, cx=SIDE / 2, cy=SIDE / 2)
        rows = np.flatnonzero(level == power)
        with CPURasterizer(mesh, window) as rasterizer:
            for some in np.split(rows, range(WINDOWS_AT_ONCE, len(rows), WINDOWS_AT_ONCE)):
                image = rasterizer.render_all(poses[some])
                drawn = image.face
                own = _samples_within(slopes[some] * scale + SIDE / 2)
                before = own & (drawn >= 0) & (drawn != faces[some, None, None])
                # Targets are not drawn: what is seen at their samples may be behind them.
                transparent = np.flatnonzero(mesh.target_mask[faces[some]])
                depth = _depths(points[some[transparent]], scale)
                before[transparent] &= image.depth[transparent] < depth * (1 - DEPTH_MARGIN_REL)
                window_of = np.nonzero(before)[0]
                cell = window_of * len(mesh.groups) + mesh.face_group[drawn[before]]
                counts = np.bincount(cell, minlength=len(some) * len(mesh.groups))
                n_own = np.maximum(own.sum(axis=(1, 2)), 1)
                shares[some] = counts.reshape(len(some), -1) / n_own[:, None]
                done += len(some)
                progress(done, len(faces))
    return shares


def _depths(corners: FloatArray, scale: float) -> FloatArray:
    """(N, SIDE, SIDE) depths of the planes of triangles, (N, 3, 3) in camera axes, metres.

    Not finite or negative where a plane is not met; within the triangle it is.
    """
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slope = (np.arange(SIDE) + 0.5 - SIDE / 2) / scale
    towards = normal[:, 0, None, None] * slope + normal[:, 1, None, None] * slope[:, None]
    towards += normal[:, 2, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        depths: FloatArray = np.einsum("ni,ni->n", normal, corners[:, 0])[:, None, None] / towards
    return depths


def _samples_within(corners: FloatArray) -> BoolArray:
    """(N, SIDE, SIDE) the pixel centres inside triangles, (N, 3, 2) px."""
    centre = np.arange(SIDE) + 0.5
    inside = np.ones((len(corners), SIDE, SIDE), np.bool_)
    following = np.roll(corners, -1, axis=1)
    (ax, ay), (bx, by), (cx, cy) = np.moveaxis(corners, 0, -1)
    turn = np.copysign(1.0, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    for corner in range(3):
        px, py = corners[:, corner].T
        dx, dy = (following - corners)[:, corner].T
        # Along x it varies with the column alone, along y with the row alone.
        rows = turn[:, None] * dx[:, None] * (centre - py[:, None])
        columns = turn[:, None] * dy[:, None] * (centre - px[:, None])
        least = EDGE_MARGIN_REL * np.hypot(dx, dy)
        inside &= rows[:, :, None] - columns[:, None] > least[:, None, None]
    return inside
