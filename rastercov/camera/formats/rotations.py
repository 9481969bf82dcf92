"""Motions from quaternions and rotation vectors, and the reverse."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def from_quaternions(wxyz: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) motions of quaternions (N, 4), scalar first, of any length but 0, and (N, 3).

    NaN for a quaternion of length 0.
    """
    q = np.asarray(wxyz, dtype=np.float64).reshape(-1, 4)
    with np.errstate(all="ignore"):
        q = q / np.abs(q).max(axis=1, keepdims=True)  # no square overflows
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return motions(np.moveaxis(np.array(rows), -1, 0), translation)


def to_quaternions(rotations: FloatArray) -> FloatArray:
    """(N, 4) unit quaternions, scalar first and not negative, of rotations (N, 3, 3)."""
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    diagonal = np.einsum("nii->ni", r)
    # Four times the squares of w, x, y, z: the largest is divided by, so that no digit is lost.
    squares = np.concatenate([trace[:, None], 2 * diagonal - trace[:, None]], axis=1) + 1
    products = np.empty((len(r), 4, 4))
    products[:, range(4), range(4)] = squares
    for row, column, value in (
        (0, 1, r[:, 2, 1] - r[:, 1, 2]),
        (0, 2, r[:, 0, 2] - r[:, 2, 0]),
        (0, 3, r[:, 1, 0] - r[:, 0, 1]),
        (1, 2, r[:, 1, 0] + r[:, 0, 1]),
        (1, 3, r[:, 0, 2] + r[:, 2, 0]),
        (2, 3, r[:, 2, 1] + r[:, 1, 2]),
    ):
        products[:, row, column] = products[:, column, row] = value
    largest = squares.argmax(axis=1)
    q = products[np.arange(len(r)), largest]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    result: FloatArray = np.where(q[:, :1] < 0, -q, q)
    return result


def from_vectors(vectors: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) motions of rotation vectors (N, 3), radians about their direction, and (N, 3)."""
    v = np.asarray(vectors, dtype=np.float64).reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        angle = np.linalg.norm(v, axis=1, keepdims=True)
        half = angle / 2
        # sin(a / 2) / a, which is 1/2 at 0.
        factor = np.where(angle > 1e-9, np.sin(half) / np.where(angle > 0, angle, 1), 0.5)
        return from_quaternions(np.concatenate([np.cos(half), factor * v], axis=1), translation)


def motions(rotations: ArrayLike, translation: ArrayLike) -> FloatArray:
    """(N, 4, 4) of rotations (N, 3, 3) and translations (N, 3)."""
    r = np.asarray(rotations, dtype=np.float64).reshape(-1, 3, 3)
    out = np.zeros((len(r), 4, 4))
    out[:, :3, :3] = r
    out[:, :3, 3] = np.asarray(translation, dtype=np.float64).reshape(-1, 3)
    out[:, 3, 3] = 1.0
    return out
