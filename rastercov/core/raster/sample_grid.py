"""Sample grid of a count: square, over the image, rotated about its centre by the roll.

The area error of a count is much larger for edges along the rows of the grid than for edges at an
odd angle, and the edges of manufactured parts are often along the rows of the image. So the grid
can be rotated. With c, s the cosine and sine of the roll and W x H the image, a point (u, v) in
pixels is at

    x = S ( c (u - W/2) + s (v - H/2)) + width/2,
    y = S (-s (u - W/2) + c (v - H/2)) + height/2

of a canvas of width x height samples that contains the rotated image. Samples are at the centres of
the unit squares of the canvas. The image is convex, so a row of samples crosses it in one run;
samples outside the runs are drawn but not counted, so no face is clipped at the image border.

Rasterisers need no other change: x = fx' X/Z + cx' and y = fy' Y/Z + cy' hold for camera axes X and
Y that are mixed beforehand.
"""

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rastercov.base import FloatArray, Int32Array, cos, sin
from rastercov.core.camera import Camera

Box = tuple[int, int, int, int]
"""Part of a canvas: left, top, width, height, in samples."""


class SampleGrid:
    """S^2 samples per pixel in rows at an angle to those of the image.

    Parameters
    ----------
    camera : Camera
        Image size and intrinsics.
    supersample : int
        S.
    roll : float
        Radians from the image's u axis to the rows of samples, towards its v axis. A square grid
        repeats every quarter turn, so the angle is reduced by that.

    Attributes
    ----------
    supersample, roll : int, float
        As given.
    width, height : int
        Size of the canvas in samples; without a roll, S times that of the image.
    lens : (4,) float64
        fx, fy, cx, cy of the canvas in samples, for the axes of `axes`; of pinholes, and of
        parallel rays, fx and fy in samples per metre.
    """

    def __init__(self, camera: Camera, supersample: int = 1, roll: float = 0.0) -> None:
        self.supersample, self.roll = int(supersample), float(roll)
        scale = self.supersample
        angle = math.remainder(roll, math.pi / 2)
        self._c, self._s = c, s = cos(angle), sin(angle)
        self._ratio = camera.fy / camera.fx
        self.is_rolled, self.is_parallel = angle != 0, camera.is_parallel
        half = scale * camera.width / 2, scale * camera.height / 2
        # Slightly less, so that rounding adds no row to an image that fills its canvas.
        self.width = math.ceil(2 * (c * half[0] + abs(s) * half[1]) - 1e-9)
        self.height = math.ceil(2 * (abs(s) * half[0] + c * half[1]) - 1e-9)
        self._middle = self.width / 2, self.height / 2
        self._half = half
        self.lens: FloatArray = np.array(
            (
                scale * camera.fx,
                scale * camera.fy,
                scale * (c * camera.cx + s * camera.cy) + self._from_corner[0],
                scale * (c * camera.cy - s * camera.cx) + self._from_corner[1],
            )
        )

    @property
    def _from_corner(self) -> tuple[float, float]:
        """Position of the corner (0, 0) of the image on the canvas, in samples."""
        c, s, (a, b) = self._c, self._s, self._half
        return self._middle[0] - (c * a + s * b), self._middle[1] - (c * b - s * a)

    @property
    def mix(self) -> FloatArray:
        """Matrix (2, 2) by which `axes` mixes the first two camera axes."""
        c, s = self._c, self._s
        return np.array(((c, s * self._ratio), (-s / self._ratio, c)))

    @cached_property
    def n_samples(self) -> int:
        """Samples inside the image; without a roll, S^2 times its pixels."""
        return int(np.diff(self.runs, axis=0).sum(dtype=np.int64))

    @property
    def count_type(self) -> type[np.int32] | type[np.int64]:
        """Integer type of counts: int32 where all samples fit, else int64."""
        return np.int32 if self.n_samples < 1 << 31 else np.int64

    @cached_property
    def runs(self) -> Int32Array:
        """First sample of each row inside the image, and the one after the last; (2, height)."""
        c, s = self._c, self._s
        x = self._middle[0]
        y = np.arange(self.height) + 0.5 - self._middle[1]
        # Relative to the centre, u is (c x - s y) / S and v is (s x + c y) / S; within the image
        # |c x - s y| <= S W/2
        low, high = (s * y - self._half[0]) / c, (s * y + self._half[0]) / c
        if s:  # and |s x + c y| <= S H/2 here
            with np.errstate(over="ignore"):
                one, other = (-c * y - self._half[1]) / s, (-c * y + self._half[1]) / s
            low = np.maximum(low, np.minimum(one, other))
            high = np.minimum(high, np.maximum(one, other))
        first = np.clip(np.ceil(low + x - 0.5), 0, self.width).astype(np.int32)
        last = np.clip(np.floor(high + x - 0.5) + 1, 0, self.width).astype(np.int32)
        return np.stack((first, np.maximum(first, last)))

    def positions(self, top: int, bottom: int) -> FloatArray:
        """Pixels (u, v) of the samples of some rows of the canvas, (bottom - top, width, 2)."""
        result = np.empty((bottom - top, self.width, 2))
        c, s, (a, b) = self._c, self._s, self._half
        x = np.arange(self.width) + 0.5 - self._middle[0]
        y = np.arange(top, bottom)[:, None] + 0.5 - self._middle[1]
        result[..., 0] = (c * x - s * y + a) / self.supersample
        result[..., 1] = (s * x + c * y + b) / self.supersample
        return result

    def tiles(self, size: tuple[int, int]) -> Iterator[Box]:
        """Yield tiles of the canvas of at most `size` (width, height)."""
        for y in range(0, self.height, size[1]):
            for x in range(0, self.width, size[0]):
                yield x, y, min(size[0], self.width - x), min(size[1], self.height - y)

    def axes(self, poses: FloatArray) -> FloatArray:
        """Poses (P, 4, 4) whose first two axes are mixed so that `lens` gives canvas positions.

        X = c right + s fy/fx down and Y = c down - s fx/fy right, at right angles only where fx is
        fy. What the poses are otherwise used for wants them as they were.
        """
        if not self.is_rolled:
            return poses
        mixed, mix = poses.copy(), self.mix
        for axis in range(2):
            mixed[:, :3, axis] = mix[axis, 0] * poses[:, :3, 0] + mix[axis, 1] * poses[:, :3, 1]
        return mixed

    def inside(self, values: NDArray[np.uint32], box: Box) -> NDArray[np.uint32]:
        """Values inside the image, flat, of those (height, width) of a part of the canvas."""
        if not self.is_rolled:
            return values.ravel()
        left, top, width, height = box
        first, last = (self.runs[:, top : top + height, None] - left).clip(0, width)
        column = np.arange(width, dtype=np.int32)
        return values[(column >= first) & (column < last)]
