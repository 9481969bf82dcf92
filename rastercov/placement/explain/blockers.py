"""Blocking groups: the share of a face's image that each group of faces hides from a camera.

Serves `uncovered`. A rasteriser renders the face from the camera centre through a window that just
holds it; other faces drawn at the samples of the face are in front of it. The exact method measures
the hidden area but not the occluder, which would take one run for every pair of groups. One window
of 64 x 64 samples takes about 0.1 ms and ranks the groups.
"""

import math

import numpy as np

from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.placement._arrays import BoolArray, FloatArray, IntArray
from rastercov.projection import to_camera
from rastercov.raster import open_rasterizer
from rastercov.viewpoints import look_at

SIDE = 64
"""Samples along each side of a window; a face spans a half of it or more."""
WIDEST = 8
"""Tangent of half the widest window, as a power of two."""
EDGE_MARGIN_REL = 1 / 128
"""Distance to an edge of the face, in sample spacings, within which samples are ignored: they may
belong to its neighbours."""


def in_front(mesh: Mesh, eyes: FloatArray, faces: IntArray) -> FloatArray:
    """(N, G) share of each face's image that each group hides from a camera centre.

    The image is that of a camera aimed at the centroid. The near limit of the real camera does not
    apply: surfaces nearer than that block too.

    `eyes`, (N, 3), lie on either side of the planes of `faces`, (N,); all faces of the mesh may
    block. A share is from about 500 to 4,000 samples, fewer for thin faces; 0 for a face so thin
    that it owns none.
    """
    shares = np.zeros((len(faces), len(mesh.groups)))
    if not len(faces):
        return shares
    poses = look_at(eyes, mesh.centroids[faces])
    points = np.stack(
        [to_camera(mesh.vertices[mesh.faces[f]], p) for f, p in zip(faces, poses, strict=True)]
    )
    slopes = points[..., :2] / points[..., 2:]
    reach = np.abs(slopes).max(axis=(1, 2))
    level = np.ceil(np.log2(np.maximum(reach, 2.0**-40))).astype(np.int64).clip(-40, WIDEST)
    for power in np.unique(level).tolist():
        scale = SIDE / 2 / math.ldexp(1.0, power)
        window = Camera(width=SIDE, height=SIDE, fx=scale, fy=scale, cx=SIDE / 2, cy=SIDE / 2)
        with open_rasterizer(mesh, window, "cpu") as rasterizer:
            for row in np.flatnonzero(level == power):
                drawn = rasterizer.render(poses[row]).face
                own = _samples_within(slopes[row] * scale + SIDE / 2)
                before = drawn[own]
                before = before[(before >= 0) & (before != faces[row])]
                counts = np.bincount(mesh.face_group[before], minlength=len(mesh.groups))
                shares[row] = counts / max(1, own.sum())
    return shares


def _samples_within(corners: FloatArray) -> BoolArray:
    """(SIDE, SIDE) the pixel centres inside a triangle, (3, 2) px."""
    centre = np.arange(SIDE) + 0.5
    inside = np.ones((SIDE, SIDE), np.bool_)
    following = np.roll(corners, -1, axis=0)
    (ax, ay), (bx, by), (cx, cy) = corners
    turn = math.copysign(1.0, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    for (px, py), (qx, qy) in zip(corners, following, strict=True):
        length = math.hypot(qx - px, qy - py)
        along = (qx - px) * (centre[:, None] - py) - (qy - py) * (centre[None] - px)
        inside &= turn * along > EDGE_MARGIN_REL * length
    return inside
