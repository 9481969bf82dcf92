"""Faces that cameras cover by number and angle of the views, or see, with whole arrays.

The twin of `engine/coverage/spread.hpp` and of `rastercov.placement.uncovered.CandidateBounds`.
"""

from itertools import combinations

import numpy as np

from rastercov.base import TINY, BoolArray, ByteArray, FloatArray, IntArray
from rastercov.core.coverage.task import Reason
from rastercov.core.raster.contract import BoundKind


def covered_faces(
    covers: BoolArray,
    eyes: FloatArray,
    centroids: FloatArray,
    need: IntArray,
    min_cosine: float,
) -> BoolArray:
    """(F,) faces that `need`, (F,), of K cameras cover, two of them with rays that differ enough.

    `covers` is (K, F), `eyes` (K, 3), `centroids` (F, 3); a pair of rays differs enough where its
    cosine is `min_cosine` or less, any pair and a single ray where `min_cosine` is above 1. A ray
    without length differs from none.
    """
    covered: BoolArray = covers.sum(axis=0) >= need
    if min_cosine > 1:
        return covered
    rays = eyes[:, None] - centroids
    lengths = np.linalg.norm(rays, axis=-1)
    rays /= np.maximum(lengths[..., None], TINY)
    is_spread = np.zeros(covers.shape[1], np.bool_)
    for one, other in combinations(range(len(covers)), 2):
        cosine = np.einsum("fi,fi->f", rays[one], rays[other])
        is_spread |= (
            covers[one]
            & covers[other]
            & (cosine <= min_cosine)
            & (lengths[[one, other]] > 0).all(axis=0)
        )
    return covered & is_spread


def candidate_bounds(
    visibility: FloatArray,
    bound: FloatArray,
    kind: ByteArray,
    drawn: FloatArray,
    reason: ByteArray,
    edge_on: float,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Bounds of the greatest visible fraction of each face, (F,), and how many poses cover it.

    Figures of a `Coverage` are (P, F). An image of `edge_on` square pixels or less shows nothing,
    unless it was sampled.
    """
    low = (visibility - bound).max(axis=0, initial=0).clip(0, 1)
    is_edge_on = (drawn <= edge_on) & (kind != BoundKind.STATISTICAL)
    high = np.where(is_edge_on, 0.0, visibility + bound).max(axis=0, initial=0).clip(0, 1)
    return low, high, (reason == Reason.COVERED).sum(axis=0)
