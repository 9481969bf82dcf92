"""A photograph as gradients: a pyramid of halves, and how strongly each direction has an edge.

An edge of the model is compared with the gradient across it, never along it, relative to the
gradients around: light and contrast change the photograph, not where its edges are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from rastercov.base import ConfigError, Float32Array, FloatArray, StrPath
from rastercov.core.camera import Camera

DIRECTIONS = 12
"""Directions, over half a turn, in which gradients are stored."""
NEIGHBOURHOOD = 12
"""Half the side, px, of the square in which the strength of gradients is compared."""


def read_photograph(path: StrPath, camera: Camera) -> Float32Array:
    """Brightness (H, W) of a photograph, 0 to 1, of the size of its camera.

    ConfigError for another size; UnreadableError for a file that is no picture.
    """
    try:
        with Image.open(path) as picture:
            size = picture.size
            check_size(str(path), size, camera)
            grey = np.asarray(picture.convert("F"), dtype=np.float32)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ConfigError(f"expected a picture in {path}, got: {error}") from error
    return grey / max(float(grey.max()), 1e-6)


def brightness(photo: ArrayLike, camera: Camera) -> Float32Array:
    """Brightness (H, W), 0 to 1, of an array (H, W) or (H, W, 3) of the size of its camera."""
    image = np.asarray(photo, dtype=np.float64)
    most = np.abs(image).max(initial=0)
    if image.ndim not in (2, 3) or not most <= np.finfo(np.float32).max:
        raise ConfigError(
            f"expected a photograph as finite numbers (H, W) or (H, W, 3), got {image.shape}"
        )
    image = image.astype(np.float32)
    grey = image if image.ndim == 2 else image[..., :3].mean(axis=2)
    check_size("a photograph", (grey.shape[1], grey.shape[0]), camera)
    return np.asarray(grey / max(float(grey.max()), 1e-6), np.float32)


def check_size(name: str, size: tuple[int, int], camera: Camera) -> None:
    """ConfigError unless a picture has the size of a camera; it names the scale that fits."""
    wanted = camera.width, camera.height
    if size == wanted:
        return
    got = (
        f"expected {name} of {wanted[0]} x {wanted[1]} px as its camera, got {size[0]} x {size[1]}"
    )
    scale = size[0] / wanted[0]
    if size[1] == round(scale * wanted[1]):
        raise ConfigError(
            f"{got}; resize it to {wanted[0]} x {wanted[1]}, or scale the camera by {scale:.6g}"
        )
    if size == wanted[::-1]:
        raise ConfigError(f"{got}; turn it by a quarter turn")
    raise ConfigError(f"{got}; use the whole picture as it was calibrated, neither cut nor padded")


@dataclass(frozen=True)
class Level:
    """A photograph at one scale.

    Attributes
    ----------
    grey : (H, W) float32
    scale : float
        Pixels of this level in one of the photograph.
    """

    grey: Float32Array
    scale: float

    @cached_property
    def gradient(self) -> tuple[Float32Array, Float32Array]:
        """Derivatives by x and y, each (H, W), divided by the strength of those around."""
        smooth = blur(self.grey, 1.0)
        down, across = np.gradient(smooth)
        strength = np.hypot(across, down)
        n = NEIGHBOURHOOD
        around = box_mean(strength, n)
        floor = 0.25 * float(strength.mean()) + 1e-6
        level = np.maximum(around, floor)
        return np.asarray(across / level, np.float32), np.asarray(down / level, np.float32)

    def channels(self, reach: float) -> Float32Array:
        """Strength of edges of each direction, (DIRECTIONS, H, W), 0 to 1, blurred by `reach` px.

        Direction k has its normal at pi k / DIRECTIONS from +x.
        """
        across, down = self.gradient
        out = np.empty((DIRECTIONS, *self.grey.shape), np.float32)
        for k in range(DIRECTIONS):
            angle = np.pi * k / DIRECTIONS
            along = np.abs(across * np.float32(np.cos(angle)) + down * np.float32(np.sin(angle)))
            beside = np.abs(down * np.float32(np.cos(angle)) - across * np.float32(np.sin(angle)))
            clean = np.clip((along - beside) / 3, 0, 1)
            out[k] = blur(clean.astype(np.float32), reach)
        return out


def pyramid(grey: Float32Array, least: int) -> list[Level]:
    """Levels from the coarsest, whose longer side is at least `least` px, to the photograph's."""
    levels = [Level(grey, 1.0)]
    while max(levels[0].grey.shape) >= 2 * least and min(levels[0].grey.shape) >= 32:
        finer = levels[0].grey
        h, w = finer.shape[0] // 2 * 2, finer.shape[1] // 2 * 2
        half = finer[:h, :w].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3))
        levels.insert(0, Level(half, levels[0].scale / 2))
    return levels


def box_mean(image: Float32Array, n: int) -> Float32Array:
    """Mean over a square of 2 n + 1 pixels around each, at borders of what is inside."""
    for axis in (0, 1):
        size = image.shape[axis]
        total = np.cumsum(np.insert(image.astype(np.float64), 0, 0, axis=axis), axis=axis)
        low = np.maximum(np.arange(size) - n, 0)
        high = np.minimum(np.arange(size) + n + 1, size)
        count = (high - low).reshape((-1, 1) if axis == 0 else (1, -1))
        image = ((total.take(high, axis) - total.take(low, axis)) / count).astype(np.float32)
    return image


def blur(image: Float32Array, sigma: float) -> Float32Array:
    """Image blurred by three boxes, which together are nearly a Gaussian of that deviation, px."""
    n = max(1, round((np.sqrt(4 * sigma**2 + 1) - 1) / 2))
    for _ in range(3):
        image = box_mean(image, n)
    return image


def sample(image: Float32Array, pixels: FloatArray) -> FloatArray:
    """Values of an image (H, W) at places (N, 2) px from its top-left corner; 0 outside."""
    h, w = image.shape
    place = pixels - 0.5
    with np.errstate(invalid="ignore"):
        inside = np.all((place > -0.5) & (place < (w - 0.5, h - 0.5)), axis=1)
    place = np.where(inside[:, None], place, 0)
    cell = np.clip(np.floor(place).astype(np.int64), 0, (w - 2, h - 2))
    x, y = (place - cell).T
    column, row = cell.T
    top = image[row, column] * (1 - x) + image[row, column + 1] * x
    bottom = image[row + 1, column] * (1 - x) + image[row + 1, column + 1] * x
    return np.asarray(np.where(inside, top * (1 - y) + bottom * y, 0.0))
