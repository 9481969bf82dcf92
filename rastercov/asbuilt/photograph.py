"""A photograph as gradients: a pyramid of halves, and how strongly each direction has an edge.

An edge of the model is compared with the gradient across it, never along it, relative to the
gradients around: light and contrast change the photograph, not where its edges are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageOps

from rastercov.base import ConfigError, Float32Array, FloatArray, StrPath, shown
from rastercov.base.files import reason_of
from rastercov.core.camera import Camera

DIRECTIONS = 12
"""Directions, over half a turn, in which gradients are stored."""
NEIGHBOURHOOD = 12
"""Half the side, px, of the square in which the strength of gradients is compared."""
Gradients = NDArray[np.complex64]


def read_photograph(path: StrPath, camera: Camera) -> Float32Array:
    """Brightness (H, W) of a photograph, 0 to 1, of the size of its camera.

    It is turned as its EXIF data say, as in browsers, where points are clicked. ConfigError for
    another size; UnreadableError for a file that is no picture.
    """
    try:
        with Image.open(path) as picture:
            grey = np.asarray(ImageOps.exif_transpose(picture).convert("F"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ConfigError(
            f"expected a picture in {shown(str(path))}, got: {reason_of(error)}"
        ) from error
    return brightness(grey, camera)


def brightness(photo: ArrayLike, camera: Camera) -> Float32Array:
    """Brightness (H, W), 0 to 1, of an array (H, W) or (H, W, 3) of the size of its camera."""
    image = np.asarray(photo, np.float64)
    most = np.abs(image).max(initial=0)
    if image.ndim not in (2, 3) or not most <= np.finfo(np.float32).max:
        raise ConfigError(
            f"expected a photograph as finite numbers (H, W) or (H, W, 3), got {image.shape}"
        )
    image = image.astype(np.float32)
    grey = image if image.ndim == 2 else image[..., :3].mean(axis=2)
    check_size("a photograph", grey.shape[::-1], camera)
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
    camera : Camera
        Of the photograph.
    scale : float
        Pixels of this level in one of the photograph.
    """

    grey: Float32Array
    camera: Camera
    scale: float = 1.0

    @cached_property
    def gradient(self) -> Gradients:
        """Derivative by x + i derivative by y, (H, W), divided by the strength of those around."""
        down, across = np.gradient(smooth(self.grey))
        strength = np.hypot(across, down)
        floor = 0.25 * float(strength.mean()) + 1e-6
        level = np.maximum(box_mean(strength, NEIGHBOURHOOD), floor)
        return np.asarray((across + 1j * down) / level, np.complex64)

    @cached_property
    def channels(self) -> Float32Array:
        """Strength of edges of each direction, (DIRECTIONS, H, W), 0 to 1, smooth.

        Direction k has its normal at pi k / DIRECTIONS from +x.
        """
        turns = np.exp(-1j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS).astype(np.complex64)
        return np.stack([smooth(strength_of(self.gradient * turn)) for turn in turns])


def strength_of(turned: Gradients) -> Float32Array:
    """Strength, 0 to 1, of edges by gradients in axes whose real one is across the edges."""
    return np.clip((np.abs(turned.real) - np.abs(turned.imag)) / 3, 0, 1)


def pyramid(grey: Float32Array, camera: Camera, least: int) -> list[Level]:
    """Levels from the coarsest, whose longer side is at least `least` px, to the photograph's."""
    levels = [Level(grey, camera)]
    while max(levels[0].grey.shape) >= 2 * least and min(levels[0].grey.shape) >= 32:
        finer = levels[0].grey
        h, w = finer.shape[0] // 2 * 2, finer.shape[1] // 2 * 2
        half = finer[:h, :w].reshape(h // 2, 2, w // 2, 2).mean(axis=(1, 3))
        levels.insert(0, Level(half, camera, levels[0].scale / 2))
    return levels


def box_mean(image: Float32Array, n: int) -> Float32Array:
    """Mean over a square of 2 n + 1 pixels around each, at borders of what is inside."""
    for _ in range(2):
        size = len(image)
        total = np.cumsum(np.insert(image.astype(np.float64), 0, 0, axis=0), axis=0)
        low = np.maximum(np.arange(size) - n, 0)
        high = np.minimum(np.arange(size) + n + 1, size)
        image = ((total[high] - total[low]) / (high - low)[:, None]).astype(np.float32).T
    return image


def smooth(image: Float32Array) -> Float32Array:
    """Image (H, W) blurred by 1, 2, 1, borders repeated: edges 4 px apart stay apart."""
    for _ in range(2):
        padded = np.pad(image, ((1, 1), (0, 0)), mode="edge")
        image = ((padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4).T.astype(np.float32)
    return image


def sample(image: Gradients, pixels: FloatArray) -> Gradients:
    """Values of an image (H, W) at places (..., 2) px from its top-left corner; 0 outside."""
    h, w = image.shape
    x, y = np.moveaxis(pixels - 0.5, -1, 0)
    with np.errstate(invalid="ignore"):
        inside = (x > -0.5) & (x < w - 0.5) & (y > -0.5) & (y < h - 0.5)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    column = np.clip(x.astype(np.int64), 0, w - 2)
    row = np.clip(y.astype(np.int64), 0, h - 2)
    first = row * w + column
    flat = image.ravel()
    x, y = np.float32(x - column), np.float32(y - row)
    top = flat[first] * (1 - x) + flat[first + 1] * x
    bottom = flat[first + w] * (1 - x) + flat[first + w + 1] * x
    return inside * (top * (1 - y) + bottom * y)
