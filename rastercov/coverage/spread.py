"""Angle between views: faces to which the rays of two cameras differ enough, camera by camera."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def least_cosine(min_angle: float) -> float:
    """Largest cosine of two rays that differ by an angle, radians; 2 where any two do."""
    return math.cos(min_angle) + 1e-12 if min_angle > 0 else 2.0


class ViewSpread:
    """Faces with two views from directions that differ by an angle, as cameras are added.

    Memory grows with the pairs of camera and face until the face has two such views.

    Parameters
    ----------
    centroids : (F, 3) float64
        Centroids of the faces, metres.
    min_angle : float
        Least angle at the centroid between two rays, radians; with 0 any face has it.

    Attributes
    ----------
    is_spread : (F,) bool
        Faces with two views that differ by it.
    """

    def __init__(self, centroids: FloatArray, min_angle: float) -> None:
        n = len(centroids)
        self._centroids = np.array(centroids, np.float64)
        self._min_cosine, self._is_asked = least_cosine(min_angle), min_angle > 0
        self.is_spread = np.full(n, not self._is_asked)
        self._first, self._last = np.full((2, n), -1, np.int64)
        self._is_near = np.ones(n, np.bool_)
        self._before: NDArray[Any] = np.empty(0, np.int64)
        self._camera: NDArray[Any] = np.empty(0, np.int64)
        self._eyes: NDArray[Any] = np.empty((0, 3))
        self._n_eyes = self._n_pairs = 0

    def add(self, eye: ArrayLike, faces: NDArray[np.integer]) -> None:
        """Add a camera at `eye`, (3,), that covers faces (N,), none of them twice."""
        if not self._is_asked:
            return
        from rastercov.kernels.spread import add_rays

        self._eyes = _with_room(self._eyes, self._n_eyes + 1)
        self._before = _with_room(self._before, self._n_pairs + len(faces))
        self._camera = _with_room(self._camera, self._n_pairs + len(faces))
        self._eyes[self._n_eyes] = eye
        self._n_pairs = add_rays(
            self._n_eyes, faces.astype(np.int32), self._eyes, self._centroids, self._min_cosine,
            self._first, self._is_near, self._last, self._before, self._camera, self._n_pairs,
            self.is_spread,
        )  # fmt: skip
        self._n_eyes += 1


def _with_room(array: NDArray[Any], n: int) -> NDArray[Any]:
    """The array with room for n rows or more; twice as much as it had where it grows."""
    if len(array) >= n:
        return array
    grown = np.empty((max(n, 2 * len(array)), *array.shape[1:]), array.dtype)
    grown[: len(array)] = array
    return grown
