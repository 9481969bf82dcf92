"""Faces that cameras cover by number and angle of the views, or see, with whole arrays.

The twin of `engine/coverage/spread.hpp`.
"""

from itertools import combinations

import numpy as np

from rastercov.base import TINY, BoolArray, FloatArray, IntArray


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
    is_spread = np.zeros(covers.shape[1], bool)
    for one, other in combinations(range(len(covers)), 2):
        cosine = np.einsum("fi,fi->f", rays[one], rays[other])
        is_spread |= (
            covers[one]
            & covers[other]
            & (cosine <= min_cosine)
            & (lengths[[one, other]] > 0).all(axis=0)
        )
    return covered & is_spread
