"""Functions with equal bits on every processor, for what decides where cameras are.

Sines of numpy depend on the level of the processor and on the library of C, products of matrices on
BLAS, and `einsum` on whether the compiler fuses a product and a sum. These round each step alike
everywhere: sums have a fixed order, and functions are those of lenses (`engine/lens/rounded.hpp`).
"""

from collections.abc import Callable
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import FloatArray, IntArray
from rastercov.engine import base_rounded


class _Function:
    """A kernel over arrays that broadcast, or over numbers; radians."""

    def __init__(self, kernel: Callable[..., None]) -> None:
        self._kernel = kernel

    @overload
    def __call__(self, a: float, b: float = 0.0) -> float: ...
    @overload
    def __call__(self, a: ArrayLike, b: ArrayLike = 0.0) -> FloatArray: ...
    def __call__(self, a: ArrayLike, b: ArrayLike = 0.0) -> FloatArray | float:
        pair = np.array(np.broadcast_arrays(a, b), np.float64)
        out = np.empty(pair.shape[1:])
        one, other = pair.reshape(2, -1)
        self._kernel(one, other, out.reshape(-1))
        return out if out.ndim else float(out)


sin, cos, tan = map(_Function, (base_rounded.sin, base_rounded.cos, base_rounded.tan))
arctan2, hypot = _Function(base_rounded.arctan2), _Function(base_rounded.hypot)


def arccos(cosine: ArrayLike) -> FloatArray:
    """Angles of cosines from -1 to 1, radians."""
    x = np.asarray(cosine, np.float64)
    return arctan2(np.sqrt((1.0 - x) * (1.0 + x)), x)


def arcsin(sine: ArrayLike) -> FloatArray:
    """Angles of sines from -1 to 1, radians."""
    x = np.asarray(sine, np.float64)
    return arctan2(x, np.sqrt((1.0 - x) * (1.0 + x)))


def matmul(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Matrix product, as by `@`, of (..., N, K) and (..., K, M), or of (K, M) or (K,) and (K,)."""
    one, other = np.asarray(a), np.asarray(b)
    if other.ndim == 1 or one.ndim == 1:
        return dots(one, other.T)
    total: FloatArray = one[..., :1] * other[..., :1, :]
    for k in range(1, other.shape[-2]):
        total = total + one[..., k : k + 1] * other[..., k : k + 1, :]
    return total


def dots(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Inner products along the last axis, of (..., K) and (..., K) (...,)."""
    products: FloatArray = np.multiply(a, b)
    if not 0 < products.shape[-1] < 8:
        return products.sum(axis=-1)
    # numpy's own order of so few, in a quarter of its time.
    total: FloatArray = 0 + products[..., 0]
    for k in range(1, products.shape[-1]):
        total = total + products[..., k]
    return total


def norm(vectors: ArrayLike) -> FloatArray:
    """Lengths along the last axis, of (..., K) vectors (...,)."""
    return np.sqrt(dots(vectors, vectors))


def draw_between(
    low: FloatArray | float,
    high: FloatArray | float,
    shape: int | tuple[int, ...],
    rng: "np.random.Generator",
) -> FloatArray:
    """Random numbers of a shape from `low` to `high`; `Generator.uniform` fuses its last step."""
    return low + (high - low) * rng.random(shape)


def sort_order(values: ArrayLike) -> IntArray:
    """Rows of ascending values along the last axis; equal ones stay in their order."""
    return np.argsort(values, kind="stable")
