"""Compiled loops of `spread`: angles at a face between the rays to cameras."""

import numpy as np

from rastercov.kernels.jit import compiled


@compiled
def ray_cosine(eyes, a, b, centroids, f):
    """Cosine of the angle at a face between the rays to two cameras."""
    ax, bx = eyes[a, 0] - centroids[f, 0], eyes[b, 0] - centroids[f, 0]
    ay, by = eyes[a, 1] - centroids[f, 1], eyes[b, 1] - centroids[f, 1]
    az, bz = eyes[a, 2] - centroids[f, 2], eyes[b, 2] - centroids[f, 2]
    length = np.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    return (ax * bx + ay * by + az * bz) / length if length > 0 else 1.0


@compiled
def add_rays(c, faces, eyes, centroids, min_cosine, last, before, camera, n_seen, is_spread):
    """Add a camera to the lists of the faces it covers; number of pairs of camera and face.

    Parameters
    ----------
    c : int
        Row of the camera in `eyes`, (K, 3) float64.
    faces : (N,) int32
        Faces that it covers, none twice.
    last : (F,) int64
        In and out: the pair of the last camera that sees each face, -1 for none.
    before, camera : (M,) int64
        In and out: of each pair, the pair before it of the same face, and its camera; room for N
        more.
    n_seen : int
        Pairs so far.
    is_spread : (F,) bool
        In and out: True where the rays to two cameras of a face differ by the angle.
    """
    for f in faces:
        if is_spread[f]:
            continue
        pair = last[f]
        while pair >= 0:
            if ray_cosine(eyes, c, camera[pair], centroids, f) <= min_cosine:
                is_spread[f] = True
                break
            pair = before[pair]
        before[n_seen], camera[n_seen] = last[f], c
        last[f] = n_seen
        n_seen += 1
    return n_seen
